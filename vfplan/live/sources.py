"""Ticks to show: of a result at its pace, or of datagrams, handed out at a display's rate."""

from __future__ import annotations

import socket
import threading
import time
from collections import deque
from collections.abc import Iterator
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np

from vfplan.errors import InputError, SettingError
from vfplan.io.files import MAX_NUMBER
from vfplan.session.bags import TICK, TickRows, as_ticks
from vfplan.session.result import read_result

# How a datagram begins: its magic, and version 1 in two bytes.
SIGNATURE = b"VFPT\x01\x00"

HEADER = np.dtype([("signature", "V6"), ("count", "<u2"), ("sequence", "<u8"), ("dropped", "<u8")])

# Ticks of a datagram: as many as fit into one Ethernet frame (`telemetry.hpp`).
MAX_TICKS = 11

# Seconds after which whoever waits for ticks looks around: whether to stop, whether a client has
# gone or asks for something.
WAIT_S = 0.2

# Bytes that the system is asked to buffer: three seconds of a controller's ticks; it may give less.
RECEIVE_BUFFER_BYTES = 2**22

# Largest time of a tick [s], after any epoch: MCAP counts nanoseconds in 64 bits.
MAX_TICK_S = 9e9

# A source that sends nothing for so long [s] has stopped: its last tick is shown to nobody who
# comes later, and another may take its place.
SILENT_S = 1.0

# Datagrams by which a sender that goes on goes back at most; beyond, it began again.
SWAPPED = 1000

# A tick that is shown, with the time of its receipt since 1970 [s].
SHOWN = np.dtype([*TICK.descr, ("received", "<f8")])

# Ticks of a result that are handed out at a time, a hundredth of a second at 1 kHz.
RESULT_BLOCK = 10

# Clients of one server. Each has a thread of its own.
MAX_CLIENTS = 32

# A reader that is further behind misses the oldest ticks [s]. A picture that is later would
# mislead.
MAX_DELAY_S = 0.5


def decode(data: bytes) -> tuple[int, int, TickRows]:
    """How many datagrams went before one, how many ticks the controller dropped, and its ticks.

    The ticks are 1 to 11 of `vfplan.session.bags.TICK`; `index` counts every tick of the loop,
    dropped ones too.

    Raises InputError: bytes that are no datagram, or numbers that are not finite
    """
    if len(data) < HEADER.itemsize:
        message = f"a datagram has {len(data)} bytes, fewer than a header. Check what sends"
        raise InputError(message, code="datagram-short")
    head = np.frombuffer(data, HEADER, 1)[0]
    count = int(head["count"])
    if not data.startswith(SIGNATURE):
        message = f"a datagram begins with {data[:6]!r}, not VFPT of version 1. Check what sends"
        raise InputError(message, code="datagram-unknown")
    size = HEADER.itemsize + count * TICK.itemsize
    if not 1 <= count <= MAX_TICKS or len(data) != size:
        message = f"a datagram has {len(data)} bytes of {size} (ticks: {count}). Check what sends"
        raise InputError(message, code="datagram-size")
    ticks = np.frombuffer(data, TICK, count, HEADER.itemsize)
    limits = dict.fromkeys(("hip", "proxy", "normal", "force"), MAX_NUMBER) | {"t": MAX_TICK_S}
    for name, limit in limits.items():
        # NaN is not <= anything, so it is refused too.
        if not (np.abs(ticks[name]) <= limit).all():
            message = f"a datagram holds a {name} not within {limit:g}. Check the controller"
            raise InputError(message, code="datagram-number")
    return int(head["sequence"]), int(head["dropped"]), ticks


# (n,) ticks of `vfplan.session.bags.TICK`, and what is counted so far by its name in the report:
# ticks that the controller dropped, datagrams that did not arrive or were none, and why the first
# of these was none.
Portion = tuple[TickRows, dict[str, Any]]


def stream_of(source: str, fixture_sha256: str | None) -> Iterator[Portion]:
    """The ticks of a controller that sends to `udp://HOST:PORT`, or of a result at its pace.

    A result of `vfplan replay -o` is read before this returns; `fixture_sha256` as in
    `read_result`.
    """
    if source.startswith("udp:"):
        return stream_udp(source)
    return paced(as_ticks(read_result(source, fixture_sha256)[0]))


def paced(ticks: TickRows) -> Iterator[Portion]:
    """Ticks at the speed that they had."""
    started = time.monotonic()
    for k in range(0, len(ticks), RESULT_BLOCK):
        due = started + float(ticks["t"][k] - ticks["t"][0])
        time.sleep(max(0.0, due - time.monotonic()))
        yield ticks[k : k + RESULT_BLOCK], {}


def stream_udp(address: str) -> Iterator[Portion]:
    """What arrives at `udp://HOST:PORT`, without end; the socket is bound before this returns."""
    host, port, _ = host_and_port(address)
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    try:
        receiver.bind((host, port))
    except OSError as error:
        receiver.close()
        message = f"cannot be received from: {error.strerror}. Check that no other program listens"
        raise InputError(message, where=address, code="address-unusable") from None
    receiver.settimeout(WAIT_S)
    return receive_ticks(receiver)


def host_and_port(address: str, scheme: str = "udp") -> tuple[str, int, str]:
    """Host, port and device of `udp://HOST:PORT`, without one, or of `igtl://HOST:PORT/DEVICE`.

    Raises SettingError: another address
    """
    try:
        parts = urlsplit(address)
        host, port, device = parts.hostname, parts.port, unquote(parts.path.strip("/"))
    except ValueError:
        host = port = device = None
    form, lengths = "udp://HOST:PORT", range(1)
    if scheme == "igtl":
        form, lengths = "igtl://HOST:PORT/DEVICE, DEVICE of 1 to 20 bytes", range(1, 21)
    is_complete = address.startswith(f"{scheme}://") and host is not None and port is not None
    if not is_complete or len(device.encode()) not in lengths:
        raise SettingError(f"source is {address!r}. Give {form}", code="address-invalid")
    return host, port, device


def receive_ticks(receiver: socket.socket) -> Iterator[Portion]:
    """What arrives at a bound socket from one sender at a time, without end.

    A datagram that is none is counted, and so is one of a second sender.
    """
    expected = lost = 0
    counts = {"dropped": 0, "lost_datagrams": 0, "bad_datagrams": 0, "first_bad_datagram": ""}
    sender, heard = None, -np.inf
    with receiver:
        while True:
            ticks = np.zeros(0, TICK)
            try:
                data, address = receiver.recvfrom(65536)
                sequence, dropped, ticks = decode(data)
                now = time.monotonic()
                if address != sender and now - heard < SILENT_S:
                    ticks = ticks[:0]
                    other = f"{address[0]}:{address[1]}"
                    message = f"a second program sends, from {other}. Give each a port of its own"
                    raise InputError(message, code="second-sender")
            except TimeoutError:
                pass
            except InputError as error:
                counts["bad_datagrams"] += 1
                counts["first_bad_datagram"] = counts["first_bad_datagram"] or error.message
            else:
                if address != sender or sequence < expected - SWAPPED:
                    expected = sequence
                sender, heard = address, now
                # One that comes late was counted as lost.
                lost += max(sequence - expected, -(lost > 0))
                expected = max(expected, sequence + 1)
                counts |= {"dropped": dropped, "lost_datagrams": lost}
            yield ticks, dict(counts)


class PositionStream:
    """Takes every tick, and keeps the first one of each period of the rate for a short while.

    rate_hz: how many ticks a second are handed out, in the ticks' own time
    """

    def __init__(self, rate_hz: float = 100.0) -> None:
        self.rate_hz = rate_hz
        self._kept: deque[TickRows] = deque(maxlen=max(1, int(MAX_DELAY_S * rate_hz)))
        # How many ticks were kept so far, and the period of the last tick.
        self._count = 0
        self._period = np.nan
        self._has_changed = threading.Condition()
        # When the ticks' clock was 0, since 1970 [s], by the tick that came fastest.
        self.zero_s = np.inf
        # When ticks came last, by `time.monotonic`, and what does not come, in words.
        self.heard_s, self.silent = time.monotonic(), ""

    def put(self, ticks: TickRows) -> None:
        """Take (n,) of `vfplan.session.bags.TICK`, n at least 1."""
        periods = np.floor(ticks["t"] * self.rate_hz + 1e-6)
        firsts = ticks[np.diff(periods, prepend=self._period) != 0]
        shown = np.zeros(len(firsts), SHOWN)
        shown[[*TICK.names]] = firsts
        shown["received"] = now = time.time()
        self.heard_s = time.monotonic()
        self.zero_s = min(self.zero_s, now - float(ticks["t"][-1]))
        with self._has_changed:
            self._period = periods[-1]
            self._kept.extend(shown)
            self._count += len(firsts)
            self._has_changed.notify_all()

    def after(self, count: int, wait_s: float) -> tuple[int, list[TickRows]]:
        """The count for the next call, and the ticks that are new, of `SHOWN`; none after `wait_s`.

        count: what the call before returned; -1 at first, for the newest tick alone, unless the
            source is silent
        """
        with self._has_changed:
            self._has_changed.wait_for(lambda: self._count > max(count, 0), wait_s)
            if not self._count:
                return count, []
            new = self._count - count
            if count < 0:
                new = int(time.time() - self._kept[-1]["received"] < SILENT_S)
            kept = list(self._kept)
            return self._count, kept[max(0, len(kept) - new) :]
