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

from vfplan.errors import MissingExtra, SessionError, requires_extra
from vfplan.io.files import opened_file
from vfplan.session.session import BLOCK, Samples

TICK = np.dtype([
    ("index", "<u8"), ("t", "<f8"), ("hip", "<f8", 3), ("proxy", "<f8", 3), ("normal", "<f8", 3),
    ("force", "<f8", 3), ("state", "i1"), ("status", "u1"), ("nothing", "V6"),
])  # fmt: skip
"""A tick as a controller sends it: count, time [s], places [m], force [N]; 120 bytes."""

TOPIC = "/vfplan/tick"
SCHEMA = "vfplan_msgs/msg/Tick"
ENCODING = "cdr"
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
CHUNK_BYTES = 2**20
"""Bytes of a chunk. MCAP's own default; readers seek by whole chunks."""

RESERVE_BYTES = 4 * CHUNK_BYTES
"""Bytes that are reserved ahead: more than the last chunk and the index of an hour need."""


class ReservingFile(io.FileIO):
    """A file that reserves room ahead, so that its end can still be written on a full disk."""

    # Bytes of the file that are reserved.
    reserved = 0.0
    # Why no more could be reserved.
    full: OSError | None = None

    def write(self, data: Any) -> int:
        """Write, after room has been reserved beyond the data."""
        needed = self.tell() + len(data) + RESERVE_BYTES
        if needed > self.reserved and self.full is None:
            try:
                os.posix_fallocate(self.fileno(), 0, needed)
                self.reserved = needed
            except OSError as error:
                if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                    self.full = error
                else:
                    self.reserved = math.inf  # This file system cannot reserve room.
        return super().write(data)

    def close(self) -> None:
        """Give back the room that was not needed."""
        if not self.closed:
            self.truncate(self.tell())
        super().close()


class McapWriter:
    """Write ticks as they come; the file is whole once it is closed, also on a full disk.

    path: made anew
    Raises MissingExtra: without the package mcap
    """

    def __init__(self, path: Path) -> None:
        # Ticks that are in the file, and why later ones are not.
        self.kept = 0
        self.full: OSError | None = None
        writer_module = _mcap_module("writer")
        self._raw_file = ReservingFile(path, "wb")
        self._file = io.BufferedWriter(self._raw_file)
        self._writer = writer_module.Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="", library="vfplan")
        schema = self._writer.register_schema(SCHEMA, "ros2msg", DEFINITION)
        self._channel = self._writer.register_channel(TOPIC, ENCODING, schema)

    def write(self, ticks: NDArray[np.void], received_s: float) -> None:
        """Add (n,) of `TICK`; `received_s` since 1970. Nothing is added once it is `full`."""
        now = int(received_s * 1e9)
        for tick in ticks:
            if self._raw_file.full:
                self.full = self._raw_file.full
                return
            self.kept += 1
            body = CDR_LITTLE_ENDIAN + tick.tobytes()[:MESSAGE_BYTES]
            # MCAP's times are unsigned whole nanoseconds, its sequence numbers have 32 bits.
            publish_ns = min(max(0, round(float(tick["t"]) * 1e9)), 2**63 - 1)
            sequence = int(tick["index"]) % 2**32
            self._writer.add_message(self._channel, now, body, publish_ns, sequence)

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


def has_our_topic(stream: BinaryIO, name: str) -> Iterator[bool]:
    """Yield whether an MCAP file has our channel; a file of others is a ROS bag."""
    try:
        summary = _mcap_module("reader").make_reader(stream).get_summary()
        yield any(channel.topic == TOPIC for channel in summary.channels.values())
    except Exception:  # The reader of ROS bags then says what is wrong with the file.
        yield False


def read_hips(stream: BinaryIO, name: str, factor: float) -> Iterator[Samples]:
    """Yield (time [s], hip [m]) a block at a time, as sessions are read; raises `SessionError`."""
    for ticks in blocks(stream, name):
        yield np.ascontiguousarray(ticks["t"]), ticks["hip"] * factor


def read_ticks(path: Path) -> NDArray[np.void]:
    """(T,) of `TICK`, in the order of the loop; raises `SessionError` as `blocks` does."""
    with opened_file(path, SessionError) as stream:
        return np.concatenate([np.zeros(0, TICK), *blocks(stream, path.name)])


def blocks(stream: BinaryIO, name: str) -> Iterator[NDArray[np.void]]:
    """Yield (n,) of `TICK`.

    Raises SessionError: damaged, or of another layout
    """
    messages: list[bytes] = []
    try:
        reader = _mcap_module("reader").make_reader(stream, validate_crcs=True)
        for _, channel, message in reader.iter_messages(topics=[TOPIC], log_time_order=False):
            if channel.message_encoding != ENCODING or len(message.data) != MESSAGE_BYTES + 4:
                raise SessionError(
                    f"{TOPIC} is of another layout. Record it with this version of vfplan",
                    where=name,
                    code="layout-unknown",
                )
            messages.append(message.data[4:] + PADDING)
            if len(messages) == BLOCK:
                yield np.frombuffer(b"".join(messages), TICK)
                messages = []
    except (MissingExtra, SessionError):
        raise
    except Exception as error:  # The package passes on the errors of struct, lz4 and zstd.
        raise SessionError(
            f"cannot be read as MCAP: {error}. Record or copy it again",
            where=name,
            code="mcap-broken",
        ) from None
    if messages:
        yield np.frombuffer(b"".join(messages), TICK)


def _mcap_module(name: str) -> ModuleType | Any:
    import importlib

    with requires_extra("MCAP needs the package mcap", "live"):
        return importlib.import_module(f"mcap.{name}")
