"""Every tick of a controller as MCAP, to the bit, and back as a session.

One channel, `/vfplan/tick`, of ROS 2 messages (CDR) with their own definition in the file, so that
Foxglove, rerun and `ros2 bag` read and plot them without vfplan. MCAP: https://mcap.dev.
"""

from __future__ import annotations

import errno
import io
import math
import os
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MissingExtra, SessionError, needing
from vfplan.io.files import opened_file
from vfplan.session.types import Pair

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
PADDING = bytes(6)
MESSAGE_BYTES = TICK.itemsize - len(PADDING)
BLOCK = 2**16
CHUNK, AHEAD = 2**20, 2**22  # bytes: one chunk, and what the last chunk and the index need at most


class _Roomy(io.FileIO):
    """A file that takes room ahead, so that what is held can still be written on a full disk."""

    taken = 0.0  # bytes of room
    full: OSError | None = None

    def write(self, data: Any) -> int:
        need = self.tell() + len(data) + AHEAD
        if need > self.taken and self.full is None:
            try:
                os.posix_fallocate(self.fileno(), 0, need)
                self.taken = need
            except OSError as error:
                if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                    self.full = error
                else:
                    self.taken = math.inf  # a file system that takes no room ahead
        return super().write(data)

    def close(self) -> None:
        if not self.closed:
            self.truncate(self.tell())
        super().close()


class McapWriter:
    """Write ticks as they come; the file is whole once it is closed, also on a full disk.

    path: made anew
    Raises MissingExtra: without the package mcap
    """

    def __init__(self, path: Path) -> None:
        writing = _mcap("writer")
        self.kept, self.full = 0, None  # ticks; why the later ones were left out
        self._room = _Roomy(path, "wb")
        self._file = io.BufferedWriter(self._room)
        self._writer = writing.Writer(self._file, chunk_size=CHUNK)
        self._writer.start(profile="", library="vfplan")
        schema = self._writer.register_schema(SCHEMA, "ros2msg", DEFINITION)
        self._channel = self._writer.register_channel(TOPIC, ENCODING, schema)

    def write(self, ticks: NDArray[np.void], received_s: float) -> None:
        """Add (n,) of `TICK`; `received_s` since 1970. Nothing is added once it is `full`."""
        now = int(received_s * 1e9)
        for tick in ticks:
            if self._room.full:
                self.full = self._room.full
                return
            self.kept += 1
            body = CDR_LITTLE_ENDIAN + tick.tobytes()[:MESSAGE_BYTES]
            at = min(max(0, round(float(tick["t"]) * 1e9)), 2**63 - 1)
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


def is_ours(stream: BinaryIO, name: str) -> Iterator[bool]:
    """Yield whether MCAP has our channel; a file of others is a ROS bag."""
    try:
        summary = _mcap("reader").make_reader(stream).get_summary()
        yield any(channel.topic == TOPIC for channel in summary.channels.values())
    except Exception:  # whoever reads bags says what is wrong with it
        yield False


def read_hips(stream: BinaryIO, name: str, factor: float) -> Iterator[Pair]:
    """Yield (time [s], hip [m]) piece by piece, as sessions are read; raises `SessionError`."""
    for ticks in blocks(stream, name):
        yield np.ascontiguousarray(ticks["t"]), ticks["hip"] * factor


def read_ticks(path: Path) -> NDArray[np.void]:
    """(T,) of `TICK`, in the order of the loop; raises `SessionError` as `blocks` does."""
    with opened_file(path, SessionError) as stream:
        found = list(blocks(stream, path.name))
    return np.concatenate(found) if found else np.zeros(0, TICK)


def blocks(stream: BinaryIO, name: str) -> Iterator[NDArray[np.void]]:
    """Yield (n,) of `TICK`.

    Raises SessionError: damaged, or of another layout
    """
    held: list[bytes] = []
    try:
        reader = _mcap("reader").make_reader(stream, validate_crcs=True)
        for _, channel, message in reader.iter_messages(topics=[TOPIC], log_time_order=False):
            if channel.message_encoding != ENCODING or len(message.data) != MESSAGE_BYTES + 4:
                raise SessionError(f"{TOPIC} of another layout", where=name)
            held.append(message.data[4:] + PADDING)
            if len(held) == BLOCK:
                yield np.frombuffer(b"".join(held), TICK)
                held = []
    except (MissingExtra, SessionError):
        raise
    except Exception as error:  # the package lets through what struct, lz4 and zstd raise
        raise SessionError(f"cannot be read as MCAP: {error}", where=name) from None
    if held:
        yield np.frombuffer(b"".join(held), TICK)


def _mcap(module: str) -> ModuleType | Any:
    import importlib

    with needing("MCAP needs the package mcap", "live"):
        return importlib.import_module(f"mcap.{module}")
