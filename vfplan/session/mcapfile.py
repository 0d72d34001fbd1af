"""Every tick of a controller as MCAP, to the bit, and back as a session.

One channel, `/vfplan/tick`, of ROS 2 messages (CDR) with their own definition in the file, so that
Foxglove, rerun and `ros2 bag` read and plot them without vfplan. MCAP: https://mcap.dev.
"""

from __future__ import annotations

from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MissingExtra, SessionError

TICK = np.dtype([
    ("index", "<u8"), ("t", "<f8"), ("hip", "<f8", 3), ("proxy", "<f8", 3), ("normal", "<f8", 3),
    ("force", "<f8", 3), ("state", "i1"), ("status", "u1"), ("nothing", "V6"),
])  # fmt: skip
"""A tick as a controller sends it: count, time [s], places [m], force [N]; 120 bytes."""

TOPIC, SCHEMA, ENCODING = "/vfplan/tick", "vfplan_msgs/msg/Tick", "cdr"
DEFINITION = b"""# One tick of a haptic loop. Lengths in m, time in s, force in N on the hand.
uint64 index
float64 t
float64[3] hip
float64[3] proxy
float64[3] normal
float64[3] force
int8 state
uint8 status
"""
CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
MESSAGE_BYTES = TICK.itemsize - 6  # without the padding at the end
MOST_TICKS = 10**8


class McapWriter:
    """Write ticks as they come; the file is whole once it is closed.

    Parameters
    ----------
    path
        Made anew.

    Raises
    ------
    MissingExtra
        Without the package mcap.
    """

    def __init__(self, path: Path) -> None:
        writing = _mcap("writer")
        self._file = path.open("wb")
        self._writer = writing.Writer(self._file, chunk_size=2**20)
        self._writer.start(profile="", library="vfplan")
        schema = self._writer.register_schema(SCHEMA, "ros2msg", DEFINITION)
        self._channel = self._writer.register_channel(TOPIC, ENCODING, schema)

    def write(self, ticks: NDArray[np.void], received_s: float) -> None:
        """Add (n,) of `TICK`; `received_s` since 1970."""
        now = int(received_s * 1e9)
        for tick in ticks:
            body = CDR_LITTLE_ENDIAN + tick.tobytes()[:MESSAGE_BYTES]
            at = max(0, round(float(tick["t"]) * 1e9))
            self._writer.add_message(self._channel, now, body, at, int(tick["index"]) % 2**32)

    def close(self) -> None:
        """Write the index; nothing may be added afterwards."""
        self._writer.finish()
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.close()


def is_ours(path: Path) -> bool:
    """Whether a file is MCAP with our channel; one of others is a ROS bag."""
    if path.suffix != ".mcap" or not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            summary = _mcap("reader").make_reader(file).get_summary()
            return any(c.topic == TOPIC for c in summary.channels.values())
    except Exception:
        return False  # whoever reads bags says what is wrong with it


def read_ticks(path: Path) -> NDArray[np.void]:
    """(T,) of `TICK`, in the order of the loop.

    Raises
    ------
    SessionError
        Damaged, no ticks, another layout, more than 10⁸ of them, or not in order.
    """
    parts: list[bytes] = []
    try:
        with path.open("rb") as file:
            reader = _mcap("reader").make_reader(file, validate_crcs=True)
            for _, channel, message in reader.iter_messages(topics=[TOPIC], log_time_order=False):
                if channel.message_encoding != ENCODING or len(message.data) != MESSAGE_BYTES + 4:
                    raise SessionError(f"{TOPIC} of another layout", where=path.name)
                parts.append(message.data[4:])
                if len(parts) > MOST_TICKS:
                    raise SessionError(f"more than {MOST_TICKS} ticks", where=path.name)
    except (MissingExtra, SessionError):
        raise
    except Exception as error:  # the package lets through what struct, lz4 and zstd raise
        raise SessionError(f"cannot be read as MCAP: {error}", where=path.name) from None
    if len(parts) < 2:
        raise SessionError(f"{len(parts)} ticks; at least 2 are wanted", where=path.name)
    packed = np.dtype(TICK.descr[:-1])
    ticks = np.zeros(len(parts), TICK)
    found = np.frombuffer(b"".join(parts), packed)
    for name in packed.names or ():
        ticks[name] = found[name]
    if not (np.diff(ticks["t"]) > 0).all():
        raise SessionError("ticks whose time does not increase", where=path.name)
    return ticks


def _mcap(module: str) -> ModuleType | Any:
    import importlib

    try:
        return importlib.import_module(f"mcap.{module}")
    except ImportError:
        raise MissingExtra("MCAP needs the package mcap: pip install 'vfplan[live]'") from None
