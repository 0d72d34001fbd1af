"""The datagrams of `vfplan/telemetry.hpp`: bytes -> ticks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
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
