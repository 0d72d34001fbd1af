"""An OpenIGTLink server: what there is to see, to any number of clients.

Each client has a thread of its own that sends what the feed holds, so that one that stalls holds
up nobody: it misses ticks. What does not move (the cloud or the curve, the contact sphere) goes out
once to each client, and again when it asks.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import OutputError
from vfplan.fixture import Fixture
from vfplan.live import igtl
from vfplan.live.sources import MOST_CLIENTS, Feed

ASKED_S = 0.2  # what a client asks for is looked at as often, at least
STALLED_S = 5.0  # a client that takes nothing for so long is let go
STATE = {-1: "no neighbour", 0: "free", 1: "in contact", 2: "entrenched"}
FLAGS = ((1, "bad HIP"), (2, "inside"), (4, "limit"))


class Server:
    """Serves on the loopback until it is closed.

    fixture: shown once to each client
    port: 0: one that the system chooses; see `port`
    feed: what goes out
    Raises OutputError: the port is taken
    """

    def __init__(self, fixture: Fixture, port: int, feed: Feed) -> None:
        self._scale = igtl.to_ras(fixture.frame)
        self._still = still(fixture)
        self._feed = feed
        self._closing = threading.Event()
        self.refused = 0  # clients beyond the most
        self._served: set[socket.socket] = set()
        self._listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listening.bind(("127.0.0.1", port))
        except OSError as error:
            self._listening.close()
            raise OutputError(f"port {port} of 127.0.0.1: {error.strerror}") from None
        self._listening.listen()
        self._listening.settimeout(0.2)
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    @property
    def port(self) -> int:
        """Where it listens on 127.0.0.1."""
        return self._listening.getsockname()[1]

    @property
    def clients(self) -> int:
        """How many are being served."""
        return sum(thread.is_alive() for thread in self._threads[1:])

    def close(self) -> None:
        """Let every client go."""
        self._closing.set()
        for client in list(self._served):
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)  # ends a sending that waits for its reader
        for thread in self._threads:
            thread.join()
        self._listening.close()

    def _accept(self) -> None:
        while not self._closing.is_set():
            try:
                client, _ = self._listening.accept()
            except TimeoutError:
                continue
            except OSError:  # no descriptor is left: wait until a client goes
                self._closing.wait(0.2)
                continue
            if self.clients >= MOST_CLIENTS:
                self._refuse(client)
                continue
            thread = threading.Thread(target=self._serve, args=(client,), daemon=True)
            self._threads = [self._threads[0], *(t for t in self._threads[1:] if t.is_alive())]
            self._threads.append(thread)
            thread.start()

    def _refuse(self, client: socket.socket) -> None:
        self.refused += 1
        text = f"{MOST_CLIENTS} clients are served, and no more"
        with client, suppress(OSError):
            client.sendall(igtl.status("vfplan_status", time.time(), igtl.BUSY, "refused", text))

    def _serve(self, client: socket.socket) -> None:
        client.settimeout(STALLED_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        seen, asked = -1, b""
        try:
            with client, self._counted(client):
                self._send_still(client)
                while not self._closing.is_set():
                    seen, due = self._feed.after(seen, ASKED_S)
                    client.sendall(b"".join(map(self._moving, due)))
                    asked = self._answer(client, asked)
        except OSError:  # it went, or took nothing: its own loss
            return

    @contextmanager
    def _counted(self, client: socket.socket) -> Iterator[None]:
        self._served.add(client)
        try:
            yield
        finally:
            self._served.discard(client)

    def _send_still(self, client: socket.socket) -> None:
        now = time.time()
        for device, make in self._still:
            client.sendall(make(device, now))

    def _answer(self, client: socket.socket, held: bytes) -> bytes:
        """Send what does not move again where GET_POLYDATA came; what is left of the input."""
        client.setblocking(False)
        try:
            data = client.recv(65536)
        except BlockingIOError:
            return held
        finally:
            client.settimeout(STALLED_S)
        if not data:
            raise ConnectionError
        held += data
        wanted = False
        while len(held) >= igtl.HEADER.size:
            _, kind, _, _, size, _ = igtl.HEADER.unpack_from(held)
            if size > 2**20:
                raise ConnectionError  # nothing that a client says to us is that long
            if len(held) < igtl.HEADER.size + size:
                break
            held = held[igtl.HEADER.size + size :]
            wanted |= kind.rstrip(b"\0") == b"GET_POLYDATA"
        if wanted:  # once, however often it was asked for at a time
            self._send_still(client)
        return held

    def _moving(self, tick: NDArray[np.void]) -> bytes:
        now = time.time()
        flags = [name for bit, name in FLAGS if tick["status"] & bit]
        state = STATE.get(int(tick["state"]), "unknown")
        text = ", ".join([state, *flags]) + f", t = {tick['t']:.3f} s"
        code = igtl.WARNING if flags or tick["state"] == 2 else igtl.OK
        return (
            igtl.transform("vfplan_hip", now, tick["hip"] * self._scale)
            + igtl.transform("vfplan_proxy", now, tick["proxy"] * self._scale)
            + igtl.sensor("vfplan_force", now, tick["force"] * np.sign(self._scale))
            + igtl.status("vfplan_status", now, code, state, text)
        )


def still(fixture: Fixture) -> list:
    """What does not move: each device with the function that makes its message."""
    scale = igtl.to_ras(fixture.frame)
    points = fixture.points * scale
    lines, triangles = None, None
    if fixture.mesh is not None:
        triangles = fixture.mesh
    elif fixture.curve is not None:
        lines = []
        for k, closed in enumerate(fixture.curve.closed):
            own = np.flatnonzero(fixture.curve.stroke == k)
            lines.append(np.append(own, own[0]) if closed else own)
    radius = 1e3 * (fixture.contact_radius + fixture.point_radius)
    centre, faces = igtl.ball(radius)
    return [
        ("vfplan_cloud",
         lambda d, t: igtl.polydata(d, t, points, lines=lines, triangles=triangles)),
        ("vfplan_contact", lambda d, t: igtl.polydata(d, t, centre, triangles=faces)),
    ]  # fmt: skip
