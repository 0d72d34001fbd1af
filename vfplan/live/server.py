"""Servers of a live view, OpenIGTLink and a page to watch, and a receiver of a tracker's poses.

Each OpenIGTLink client has a thread of its own, so that a client that stalls only misses ticks and
delays nobody. What does not move (the cloud or the curve, the contact sphere) goes out once to each
client, and again when it asks. Messages have headers of version 1, which every version reads.
Lengths are in mm. Slicer's world is RAS, so x and y change their signs.

The page of `vfplan live --web` is the report's scene. It gets its ticks by a WebSocket, on the
loopback, if it came from here.

Source: the OpenIGTLink protocol, versions 1 and 2 (J. Tokuda et al., Int. J. Med. Robot. 5, 2009,
423-434), and the ECMA-182 CRC.
"""

from __future__ import annotations

import hashlib
import json
import socket
import socketserver
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.moving import is_rigid
from vfplan.engine.proxy import Status
from vfplan.errors import InputError, OutputError
from vfplan.fixture import Fixture
from vfplan.geometry.lines import Array
from vfplan.io.sandbox import Loopback, reply
from vfplan.live.sources import MAX_CLIENTS, SILENT_S, WAIT_S, PositionStream, host_and_port
from vfplan.report.page import document, part, scene_data, scripts, tick_row
from vfplan.session.bags import TickRows
from vfplan.session.events import POSE_COLUMNS

HEADER = struct.Struct(">H12s20sQQQ")

# What a body begins with in version 2: the sizes of this, of the index and the text of the
# metadata, and the message's number.
EXTENDED_HEADER = struct.Struct(">HHII")

# The protocol's code of the unit N.
NEWTON = (0x0B << 54) | (1 << 50)

# Generator of the ECMA-182 CRC.
POLYNOMIAL = 0x42F0E1EBA9EA3693


# The protocol's codes that this server sends: all is well; something is not as it should be.
OK, WARNING = 1, 13


@cache
def crc_table() -> list[int]:
    """The CRC's remainder of each byte."""
    table = []
    for byte in range(256):
        crc = byte << 56
        for _ in range(8):
            crc = (crc << 1) % 2**64 ^ (POLYNOMIAL if crc >> 63 else 0)
        table.append(crc)
    return table


def crc64(data: bytes) -> int:
    """The ECMA-182 CRC of 64 bits, from 0."""
    table = crc_table()
    crc = 0
    for byte in data:
        crc = ((crc << 8) % 2**64) ^ table[(crc >> 56) ^ byte]
    return crc


def message(kind: str, device: str, time_s: float, body: bytes) -> bytes:
    """Header and body; `time_s` since 1970."""
    stamp = (int(time_s) << 32) | int((time_s % 1.0) * 2**32)
    return HEADER.pack(1, kind.encode(), device.encode(), stamp, len(body), crc64(body)) + body


# Factors of each coordinate from m to Slicer's mm in RAS. Points of the robot's frame are taken for
# LPS as well, as in every file that `vfplan export` writes.
TO_RAS = np.array([-1e3, -1e3, 1e3])


def transform(device: str, time_s: float, place_mm: Array) -> bytes:
    """TRANSFORM: a place (3,) [mm], without rotation."""
    columns = np.vstack([np.eye(3), place_mm])
    return message("TRANSFORM", device, time_s, columns.astype(">f4").tobytes())


def sensor(device: str, time_s: float, values: Array) -> bytes:
    """SENSOR: an array of at most 255 numbers [N]."""
    body = struct.pack(">BBQ", len(values), 0, NEWTON) + np.asarray(values, ">f8").tobytes()
    return message("SENSOR", device, time_s, body)


def status(device: str, time_s: float, code: int, name: str, text: str) -> bytes:
    """STATUS: a code of the protocol, a name of at most 19 letters, and words."""
    body = struct.pack(">Hq20s", code, 0, name.encode()[:19]) + text.encode() + b"\0"
    return message("STATUS", device, time_s, body)


# The kinds of cells that a POLYDATA may have, in its order.
CELLS = ("vertices", "lines", "triangles", "strips")


def polydata(
    device: str, time_s: float, points_mm: Array, kind: str, cells: Sequence[NDArray[np.integer]]
) -> bytes:
    """POLYDATA: points (N, 3) [mm], joined by cells of one of the kinds `CELLS`."""
    data = b"".join(np.array([len(cell), *cell], ">u4").tobytes() for cell in cells)
    # Of each kind how many there are, and their bytes.
    sizes = np.zeros((len(CELLS), 2), int)
    sizes[CELLS.index(kind)] = len(cells), len(data)
    head = struct.pack(">10I", len(points_mm), *sizes.ravel(), 0)
    return message("POLYDATA", device, time_s, head + np.asarray(points_mm, ">f4").tobytes() + data)


# A client that takes nothing for so long is disconnected [s].
STALLED_S = 5.0

# The kind of a client's message that is answered.
REQUEST = b"GET_POLYDATA"

STATE_NAMES = {"-1": "no neighbour", "0": "free", "1": "in contact", "2": "entrenched"}


class Server(socketserver.ThreadingTCPServer):
    """Serves on the loopback until it is closed.

    fixture: shown once to each client
    port: 0: one that the system chooses; see `port`
    feed: what goes out
    Raises OutputError: the port is taken
    """

    allow_reuse_address = daemon_threads = True

    def __init__(self, fixture: Fixture, port: int, feed: PositionStream) -> None:
        self._static = static_bodies(fixture)
        self._feed = feed
        self._closing = threading.Event()
        # Clients that were refused because there were too many, and those that are served.
        self.refused = 0
        self.clients: set[socket.socket] = set()
        try:
            super().__init__(("127.0.0.1", port), socketserver.BaseRequestHandler)
        except OSError as error:
            message = f"port {port} of 127.0.0.1 cannot be used: {error.strerror}. Give another"
            raise OutputError(message, code="port-taken", numbers={"port": port}) from None
        self.port = self.server_address[1]
        threading.Thread(target=self.serve_forever, args=(WAIT_S,), daemon=True).start()

    def close(self) -> None:
        """Disconnect every client."""
        self._closing.set()
        for client in list(self.clients):
            with suppress(OSError):
                # This also ends a sending that waits for its reader.
                client.shutdown(socket.SHUT_RDWR)
        self.shutdown()
        self.server_close()

    def verify_request(self, client: socket.socket, _: Any) -> bool:
        """Whether there is room for a client."""
        if len(self.clients) < MAX_CLIENTS:
            self.clients.add(client)
            return True
        self.refused += 1
        return False

    def finish_request(self, client: socket.socket, _: Any) -> None:
        """Send a client ticks, in a thread of its own, until it goes or stalls, or we close."""
        count, unread, told = -1, b"", time.monotonic()
        try:
            client.settimeout(STALLED_S)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._send_static(client)
            while not self._closing.is_set():
                count, ticks = self._feed.after(count, WAIT_S)
                told_silent = self._feed.silent
                client.sendall(b"".join(tick_messages(tick, told_silent) for tick in ticks))
                if ticks:
                    told = time.monotonic()
                elif time.monotonic() - told >= SILENT_S:
                    told = time.monotonic()
                    text = f"no tick has come for {SILENT_S:g} s"
                    client.sendall(status("vfplan_status", time.time(), WARNING, "silent", text))
                unread = self._answer_requests(client, unread)
        except OSError:
            return  # The client has gone, or took nothing for too long.
        finally:
            self.clients.discard(client)

    def _send_static(self, client: socket.socket) -> None:
        for device, *body in self._static:
            client.sendall(polydata(device, time.time(), *body))

    def _answer_requests(self, client: socket.socket, unread: bytes) -> bytes:
        """Send what does not move again if GET_POLYDATA came; returns the end of the input."""
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
        if REQUEST not in unread:
            return unread[-len(REQUEST) :]
        # Once, however often it was requested at a time.
        self._send_static(client)
        return b""


def static_bodies(fixture: Fixture) -> list[tuple[str, Array, str, Any]]:
    """What does not move: device, points [mm], and cells of which kind, as for `polydata`."""
    kind, cells = "vertices", np.arange(len(fixture.points))[:, None]
    if fixture.mesh is not None:
        kind, cells = "triangles", fixture.mesh
    elif fixture.curve is not None:
        kind, cells = "lines", []
        for stroke, closed in enumerate(fixture.curve.closed):
            line = np.flatnonzero(fixture.curve.stroke == stroke)
            cells.append(np.append(line, line[: int(closed)]))
    import pyvista

    ball = pyvista.Sphere(radius=1e3 * (fixture.contact_radius + fixture.point_radius))
    return [
        ("vfplan_cloud", fixture.points * TO_RAS, kind, cells),
        ("vfplan_contact", ball.points, "triangles", ball.regular_faces),
    ]


def tick_messages(tick: TickRows, silent: str = "") -> bytes:
    """What moves: HIP, proxy, force and status of a tick of `SHOWN`, stamped with its receipt.

    silent: what else should come and does not, in words
    """
    now = float(tick["received"])
    flags = [flag.name.lower().replace("_", " ") for flag in Status(int(tick["status"]))]
    state = STATE_NAMES.get(str(tick["state"]), "unknown")
    text = ", ".join(filter(None, [state, *flags, silent, f"t = {tick['t']:z.3f} s"]))
    code = WARNING if flags or silent or tick["state"] == 2 else OK
    return (
        transform("vfplan_hip", now, tick["hip"] * TO_RAS)
        + transform("vfplan_proxy", now, tick["proxy"] * TO_RAS)
        + sensor("vfplan_force", now, tick["force"] * np.sign(TO_RAS))
        + status("vfplan_status", now, code, state, text)
    )


# A message that announces more bytes is none: no volume that a tracker's server sends is larger.
MAX_MESSAGE_BYTES = 2**32

# Bytes of a long message that are read at once, so that a volume takes no memory.
PART_BYTES = 2**20


class PoseReceiver:
    """Receives the TRANSFORM messages of one device, as PLUS and Slicer send them, until closed.

    address: igtl://HOST:PORT/DEVICE of an OpenIGTLink server
    is_ras: the poses are of Slicer's world; they are turned into LPS
    take: is called in the receiver's thread with the time since 1970 [s] at which the tracker
        measured, by its computer's clock, and the pose (4, 4) [m], e.g. for a `MovingFrame`
    Raises SettingError: another address
    Raises InputError: nobody answers there
    """

    def __init__(
        self, address: str, *, is_ras: bool = False,
        take: Callable[[float, Array], Any] = lambda time_s, pose: None,
    ) -> None:  # fmt: skip
        host, port, self._device = host_and_port(address, "igtl")
        self._take = take
        self._signs = np.append(np.sign(TO_RAS), 1) if is_ras else np.ones(4)
        # Each with its time, and the time of its receipt.
        self.poses: list[tuple[float, float, Array]] = []
        # How many transforms of the device were not taken, by reason.
        self.left_out = Counter()
        # Names of other transforms that came, and how the connection fared.
        self.other_devices = set()
        self.has_ended, self.reconnected = False, 0
        self._server, self._closing, self._received = (host, port), threading.Event(), 0.0
        # How many poses `new_rows` gave, and when the last one came, by `time.monotonic`.
        self._given, self.heard_s = 0, time.monotonic()
        try:
            self._socket = socket.create_connection(self._server, STALLED_S)
        except OSError as error:
            message = f"cannot be reached: {error}. Check that PLUS or Slicer serves there"
            raise InputError(message, where=address, code="address-unusable") from None
        self._thread = threading.Thread(target=self.receive, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Disconnect; what came stays in `poses`."""
        self.has_ended = self._socket.fileno() < 0
        self._closing.set()
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()

    def new_rows(self, zero: float) -> str:
        """The poses that came since the last call, as `pose_rows`."""
        new = self.poses[self._given :]
        self._given += len(new)
        return pose_rows(new, zero)

    def receive(self) -> None:
        """Take messages; connect again when the connection ends, or holds what is no message."""
        while not self._closing.is_set():
            with suppress(OSError), self._socket, self._socket.makefile("rb") as stream:
                self._socket.settimeout(None)
                while len(head := stream.read(HEADER.size)) == HEADER.size:
                    version, kind, device, stamp, size, crc = HEADER.unpack(head)
                    if version not in (1, 2) or size > MAX_MESSAGE_BYTES:
                        break
                    for _ in range(size // PART_BYTES):
                        stream.read(PART_BYTES)
                    body = stream.read(size % PART_BYTES)
                    name = device.rstrip(b"\0").decode("utf-8", "replace")
                    # A clock that is set back makes no pose arrive before an earlier one.
                    received = self._received = max(self._received, time.time())
                    if kind.rstrip(b"\0") != b"TRANSFORM":
                        continue
                    if name != self._device:
                        self.other_devices.add(name)
                        continue
                    try:
                        matrix = decode_transform(body, version, crc)
                    except InputError as error:
                        self.left_out[error.message] += 1
                        continue
                    matrix = self._signs[:, None] * matrix * self._signs
                    measured = stamp / 2**32 or received
                    self.poses.append((measured, received, matrix))
                    self.heard_s = time.monotonic()
                    self._take(measured, matrix)
            if self._closing.wait(WAIT_S):
                return
            with suppress(OSError):
                self._socket = socket.create_connection(self._server, STALLED_S)
                self.reconnected += 1


def decode_transform(body: bytes, version: int, crc: int) -> Array:
    """(4, 4) the pose [m] in a TRANSFORM's body.

    Raises InputError: a damaged body, another size, a pose that its metadata call not valid, or a
        matrix that is not rigid
    """
    if crc64(body) != crc:
        raise InputError("it was damaged. Check the network", code="transform-damaged")
    start, index_size, text_size = 0, 0, 0
    if version == 2 and len(body) >= EXTENDED_HEADER.size:
        start, index_size, text_size, _ = EXTENDED_HEADER.unpack_from(body)
    end = len(body) - index_size - text_size
    if end - start != 48:
        raise InputError("it has no 48 bytes. Check which program sends", code="transform-size")
    if b"TransformStatus" in body[end:] and b"TransformStatusOK" not in body[end:]:
        raise InputError("the tracker calls it not valid", code="transform-not-valid")
    matrix = np.eye(4)
    matrix[:3] = np.frombuffer(body, ">f4", 12, start).reshape(4, 3).T
    matrix[:3, 3] *= 1e-3
    if not is_rigid(matrix):
        raise InputError("it is not rigid. Send it without scale", code="transform-not-rigid")
    return matrix


POSE_HEADER = ",".join([*POSE_COLUMNS, "arrived"]) + "\n"


def pose_rows(poses: Sequence[tuple[float, float, Array]], zero: float) -> str:
    """Rows of a table for `vfplan replay --poses`; `zero`: when its clock was 0 [s]."""
    from scipy.spatial.transform import Rotation

    lines = []
    for measured, received, pose in poses:
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
        row = [measured - zero, *pose[:3, 3], w, x, y, z, received - zero]
        lines.append(",".join(repr(float(number)) for number in row) + "\n")
    return "".join(lines)


class Web(Loopback):
    """Serves until it is closed.

    fixture, name: what the page shows; a page that shows another scene loads itself anew
    port: 0: one that the system chooses; see `port`
    feed: what is shown
    Raises MissingExtra: without the package websockets
    Raises OutputError: the port is taken
    """

    def __init__(self, fixture: Fixture, name: str, port: int, feed: PositionStream) -> None:
        data = scene_data(fixture)
        self._scene = hashlib.sha256(json.dumps([name, data]).encode()).hexdigest()[:16]
        content = part("live.html", "vfplan.live").replace("{scene}", part("scene.html"))
        body = f"<header><h1>Live: {escape(name)}</h1></header>{content}"
        body += scripts({**data, "scene": self._scene}, part("live.js", "vfplan.live"))
        self._page = document(f"Live: {escape(name)}", body, live=True).encode()
        self._row, self._feed = tick_row(fixture), feed
        # Clients that were refused because there were too many.
        self.refused = 0
        super().__init__(port, self.answer, self.show)

    def answer(self, connection: Any, request: Any) -> Any:
        """Answer a request: the page, or nothing for the WebSocket."""
        if request.path == "/ticks":
            return None
        if request.path != "/":
            return connection.respond(404, "there is one page, /")
        return reply(connection, self._page, "text/html; charset=utf-8")

    def show(self, connection: Any) -> None:
        """Send ticks until the connection is closed, which sending or receiving raises."""
        if len(self.connections) > MAX_CLIENTS:
            self.refused += 1
            connection.close(1013, f"{MAX_CLIENTS} clients are served, and no more")
            return
        count = -1
        connection.send(json.dumps({"scene": self._scene}))
        while True:
            count, ticks = self._feed.after(count, WAIT_S)
            if ticks:
                connection.send(json.dumps({"ticks": [self._row(tick) for tick in ticks]}))
            with suppress(TimeoutError):
                connection.recv(timeout=0)
