"""An OpenIGTLink server: the fixture and its ticks, to any number of clients.

Each client has a thread of its own, so that a client that stalls only misses ticks and delays
nobody. What does not move (the cloud or the curve, the contact sphere) goes out once to each
client, and again when it asks.
"""

from __future__ import annotations

import functools
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import OutputError
from vfplan.fixture import Fixture
from vfplan.live import igtl
from vfplan.live.sources import MAX_CLIENTS, WAIT_S, PositionStream

Array = NDArray[np.float64]

STALLED_S = 5.0
"""A client that takes nothing for so long is disconnected [s]."""

MAX_REQUEST_BYTES = 2**20
"""Bytes of a client's message. No request to this server is nearly as long."""

STATE_NAMES = {"-1": "no neighbour", "0": "free", "1": "in contact", "2": "entrenched"}
FLAGS = ((1, "bad HIP"), (2, "inside"), (4, "limit"))


class Server:
    """Serves on the loopback until it is closed.

    fixture: shown once to each client
    port: 0: one that the system chooses; see `port`
    feed: what goes out
    Raises OutputError: the port is taken
    """

    def __init__(self, fixture: Fixture, port: int, feed: PositionStream) -> None:
        self._scale = igtl.to_ras(fixture.frame)
        self._static = static_messages(fixture)
        self._feed = feed
        self._closing = threading.Event()
        # Clients that were refused because there were too many.
        self.refused = 0
        self._clients: set[socket.socket] = set()
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind(("127.0.0.1", port))
        except OSError as error:
            self._listener.close()
            raise OutputError(
                f"port {port} of 127.0.0.1 cannot be used: {error.strerror}. Give another port",
                code="port-taken",
                numbers={"port": port},
            ) from None
        self._listener.listen()
        self._listener.settimeout(WAIT_S)
        self._accepting = threading.Thread(target=self.accept_clients, daemon=True)
        self._serving: list[threading.Thread] = []
        self._accepting.start()

    @property
    def port(self) -> int:
        """The port of 127.0.0.1."""
        return self._listener.getsockname()[1]

    @property
    def clients(self) -> int:
        """How many are being served."""
        return sum(thread.is_alive() for thread in self._serving)

    def close(self) -> None:
        """Disconnect every client."""
        self._closing.set()
        for client in list(self._clients):
            with suppress(OSError):
                # This also ends a sending that waits for its reader.
                client.shutdown(socket.SHUT_RDWR)
        for thread in (self._accepting, *self._serving):
            thread.join()
        self._listener.close()

    def accept_clients(self) -> None:
        """Give each client that comes a thread of its own, until the server is closed."""
        while not self._closing.is_set():
            try:
                client, _ = self._listener.accept()
            except TimeoutError:
                continue
            except OSError:  # No descriptor is free: wait until a client goes.
                self._closing.wait(WAIT_S)
                continue
            if self.clients >= MAX_CLIENTS:
                self.refused += 1
                text = f"{MAX_CLIENTS} clients are served, and no more"
                refusal = igtl.status(
                    "vfplan_status", time.time(), igtl.StatusCode.BUSY, "refused", text
                )
                with client, suppress(OSError):
                    client.sendall(refusal)
                continue
            thread = threading.Thread(target=self.serve, args=(client,), daemon=True)
            self._serving = [other for other in self._serving if other.is_alive()]
            self._serving.append(thread)
            thread.start()

    def serve(self, client: socket.socket) -> None:
        """Send a client ticks until it goes or stalls, or the server is closed."""
        client.settimeout(STALLED_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients.add(client)
        count = -1
        unread = b""
        try:
            with client:
                self._send_static(client)
                while not self._closing.is_set():
                    count, ticks = self._feed.after(count, WAIT_S)
                    messages = b"".join(tick_messages(tick, self._scale) for tick in ticks)
                    client.sendall(messages)
                    unread = self._answer_requests(client, unread)
        except OSError:
            return  # The client has gone, or took nothing for too long.
        finally:
            self._clients.discard(client)

    def _send_static(self, client: socket.socket) -> None:
        now = time.time()
        for device, make_message in self._static:
            client.sendall(make_message(device, now))

    def _answer_requests(self, client: socket.socket, unread: bytes) -> bytes:
        """Send what does not move again if GET_POLYDATA came; returns the unread input."""
        client.setblocking(False)
        try:
            data = client.recv(65536)
        except BlockingIOError:
            return unread
        finally:
            client.settimeout(STALLED_S)
        if not data:
            raise ConnectionError
        unread += data
        wants_static = False
        while len(unread) >= igtl.HEADER.size:
            _, kind, _, _, size, _ = igtl.HEADER.unpack_from(unread)
            if size > MAX_REQUEST_BYTES:
                raise ConnectionError
            if len(unread) < igtl.HEADER.size + size:
                break
            unread = unread[igtl.HEADER.size + size :]
            if kind.rstrip(b"\0") == b"GET_POLYDATA":
                wants_static = True
        # Once, however often it was requested at a time.
        if wants_static:
            self._send_static(client)
        return unread


def static_messages(fixture: Fixture) -> list[tuple[str, Callable[[str, float], bytes]]]:
    """What does not move: each device with the function that makes its message."""
    scale = igtl.to_ras(fixture.frame)
    lines = None
    if fixture.mesh is None and fixture.curve is not None:
        lines = []
        for stroke, closed in enumerate(fixture.curve.closed):
            line = np.flatnonzero(fixture.curve.stroke == stroke)
            if closed:
                line = np.append(line, line[0])
            lines.append(line)
    cloud = functools.partial(
        igtl.polydata, points_mm=fixture.points * scale, lines=lines, triangles=fixture.mesh
    )
    radius_m = fixture.contact_radius + fixture.point_radius
    points, faces = igtl.ball(1e3 * radius_m)
    sphere = functools.partial(igtl.polydata, points_mm=points, triangles=faces)
    return [("vfplan_cloud", cloud), ("vfplan_contact", sphere)]


def tick_messages(tick: NDArray[np.void], scale: Array) -> bytes:
    """What moves: HIP, proxy, force and status of a tick; `scale` (3,) as of `igtl.to_ras`."""
    now = time.time()
    flags = [name for bit, name in FLAGS if tick["status"] & bit]
    state = STATE_NAMES.get(str(tick["state"]), "unknown")
    text = ", ".join([state, *flags]) + f", t = {tick['t']:.3f} s"
    code = igtl.StatusCode.WARNING if flags or tick["state"] == 2 else igtl.StatusCode.OK
    return (
        igtl.transform("vfplan_hip", now, tick["hip"] * scale)
        + igtl.transform("vfplan_proxy", now, tick["proxy"] * scale)
        + igtl.sensor("vfplan_force", now, tick["force"] * np.sign(scale))
        + igtl.status("vfplan_status", now, code, state, text)
    )
