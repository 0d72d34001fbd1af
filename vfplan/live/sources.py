"""Ticks to show: of a result at its pace, or of datagrams, handed out at a display's rate."""

from __future__ import annotations

import socket
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError, SettingError
from vfplan.session import read_result
from vfplan.session.mcapfile import TICK

MAGIC, VERSION, MOST_TICKS = b"VFPT", 1, 11
LARGEST = 1e9  # seconds, metres or newtons: nothing real is larger, and MCAP counts nanoseconds
HEADER = np.dtype([("magic", "S4"), ("version", "<u2"), ("count", "<u2"), ("sequence", "<u8"),
                   ("dropped", "<u8")])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Datagram:
    """One datagram."""

    sequence: int  # how many datagrams went before it
    dropped: int  # ticks that the controller's ring had to drop so far
    # (n,) of `vfplan.session.mcapfile.TICK`, 1 to 11; `index` counts every tick of the loop,
    # dropped ones too
    ticks: NDArray[np.void]


def decode(data: bytes) -> Datagram:
    """Read a datagram; raises `InputError` for bytes that are none, or not finite."""
    if len(data) < HEADER.itemsize:
        raise InputError(f"a datagram of {len(data)} bytes; at least {HEADER.itemsize} are wanted")
    head = np.frombuffer(data, HEADER, 1)[0]
    count = int(head["count"])
    if head["magic"] != MAGIC or head["version"] != VERSION:
        raise InputError(f"a datagram that begins {data[:6]!r}; VFPT of version 1 is wanted")
    size = HEADER.itemsize + count * TICK.itemsize
    if not 1 <= count <= MOST_TICKS or len(data) != size:
        raise InputError(f"a datagram of {len(data)} bytes for {count} ticks; {size} are wanted")
    ticks = np.frombuffer(data, TICK, count, HEADER.itemsize)
    for name in ("t", "hip", "proxy", "normal", "force"):
        if not (np.abs(ticks[name]) <= LARGEST).all():  # false on NaN
            raise InputError(f"a datagram with a {name} that is not finite, or beyond {LARGEST:g}")
    return Datagram(int(head["sequence"]), int(head["dropped"]), ticks)


WAIT_S = 0.2  # a source says at least this often that there is nothing


@dataclass(frozen=True, eq=False)
class Ticks:
    """Some ticks; none where a source has nothing to tell for the moment."""

    ticks: NDArray[np.void]  # (n,) of `vfplan.session.mcapfile.TICK`
    # Ticks that the controller dropped, and datagrams that did not arrive, so far
    dropped: int = 0
    lost: int = 0
    bad: int = 0  # datagrams that were none, so far


def of_result(path: Path, *, pace: bool = True) -> Iterator[Ticks]:
    """The ticks of a result of `vfplan replay -o`; `pace`: at the speed they had."""
    found, _ = read_result(path)
    ticks = np.zeros(len(found.time), TICK)
    ticks["index"], ticks["t"] = np.arange(len(ticks)), found.time
    for name in ("hip", "proxy", "normal", "force", "state"):
        ticks[name] = getattr(found, name)
    began, first = time.monotonic(), float(found.time[0])
    block = 10
    for k in range(0, len(ticks), block):
        if pace:
            time.sleep(max(0.0, began + float(ticks["t"][k]) - first - time.monotonic()))
        yield Ticks(ticks[k : k + block])


def of_port(address: str) -> Iterator[Ticks]:
    """What arrives at `udp://HOST:PORT`, without end; the socket is bound before this returns."""
    host, port = where(address)
    listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**22)  # the system may give less
    try:
        listening.bind((host, port))
    except OSError as error:
        listening.close()
        raise InputError(f"cannot be listened at: {error.strerror}", where=address) from None
    listening.settimeout(WAIT_S)
    return _received(listening)


def where(address: str) -> tuple[str, int]:
    """Host and port of `udp://HOST:PORT`; raises `SettingError`."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not address.startswith("udp://") or host is None or port is None:
        raise SettingError(f"{address!r}: udp://HOST:PORT is wanted")
    return host, port


def _received(listening: socket.socket) -> Iterator[Ticks]:
    expected, lost, dropped, bad = None, 0, 0, 0
    with listening:
        while True:
            try:
                data = listening.recv(65536)
            except TimeoutError:
                yield Ticks(np.zeros(0, TICK), dropped, lost, bad)
                continue
            try:
                found = decode(data)
            except InputError:
                bad += 1
                continue
            if expected is not None and found.sequence > expected:
                lost += found.sequence - expected
            expected, dropped = found.sequence + 1, found.dropped
            yield Ticks(found.ticks, dropped, lost, bad)


MOST_CLIENTS = 32  # of one server
BEHIND_S = 0.5  # a reader that is further behind misses the oldest


class Feed:
    """Takes in every tick, and holds the first one of each period of the rate for a short while.

    rate_hz: how many ticks a second are handed out, in the ticks' own time
    """

    def __init__(self, rate_hz: float = 100.0) -> None:
        self.rate_hz = rate_hz
        self._held: deque[NDArray[np.void]] = deque(maxlen=max(1, int(BEHIND_S * rate_hz)))
        self._count, self._period = 0, np.nan
        self._news = threading.Condition()

    def put(self, ticks: NDArray[np.void]) -> None:
        """Take in (n,) of `vfplan.session.mcapfile.TICK`, n at least 1."""
        periods = np.floor(ticks["t"] * self.rate_hz + 1e-6)
        due = ticks[np.diff(periods, prepend=self._period) != 0]
        with self._news:
            self._period = periods[-1]
            self._held.extend(due)
            self._count += len(due)
            self._news.notify_all()

    def after(self, seen: int, wait_s: float) -> tuple[int, list[NDArray[np.void]]]:
        """What a reader has seen now, and the ticks that are new to it; none after `wait_s`.

        `seen` is what the call before gave; -1 at first, for the newest tick alone.
        """
        with self._news:
            self._news.wait_for(lambda: self._count > max(seen, 0), wait_s)
            new = min(self._count, 1) if seen < 0 else self._count - seen
            held = list(self._held)
            return self._count if self._count else seen, held[max(0, len(held) - new) :]
