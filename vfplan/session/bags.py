"""Sessions from ROS bags (extra `[ros]`), and a controller's ticks as MCAP, to the bit, and back.

The MCAP file has one channel, `/vfplan/tick`, of ROS 2 messages (CDR) with their own definition, so
that Foxglove, rerun and `ros2 bag` read and plot them without vfplan. MCAP: https://mcap.dev.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import io
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MissingExtra, SessionError, SettingError, requires_extra
from vfplan.geometry import UNIT_ROUNDED
from vfplan.io.files import opened_file
from vfplan.session.session import BLOCK, Array, Samples

# Fields that are tried when none is named, in this order; the first that a message has is taken.
FIELDS = ("O_T_EE", "o_t_ee", "pose", "transform", "point", "position", "translation", "")


@dataclass(frozen=True)
class RosOptions:
    """Which part of a bag holds the positions."""

    # `None`: the only topic whose messages hold a position
    topic: str | None = None
    # Dotted path to a point, a pose, a transform, or 16 numbers: a column-major 4 x 4 matrix as in
    # a Franka state's `O_T_EE`. `None`: the first of `FIELDS` that a message has.
    field: str | None = None
    # (x, y, z) of the tip in the frame of the pose [m]; `None`: the pose's own origin
    tool_tip: tuple[float, float, float] | None = None


def is_bag(path: Path) -> bool:
    """Whether a path looks like a ROS 1 or ROS 2 bag."""
    return path.suffix in (".bag", ".mcap", ".db3") or (path / "metadata.yaml").is_file()


def bag_files(path: Path) -> list[Path]:
    """The files that a bag consists of, in order of their names."""
    if path.is_file():
        return [path]
    return sorted(part for part in path.iterdir() if part.is_file())


def bag_stamp(path: Path) -> list[tuple[str, int, int, int]]:
    """Name, inode, size and time of change of each of a bag's files."""
    stamps = [(part.name, part.stat()) for part in bag_files(path)]
    return [(name, stamp.st_ino, stamp.st_size, stamp.st_mtime_ns) for name, stamp in stamps]


def bag_sha256(path: Path) -> str:
    """SHA-256 of a bag's file, or of a bag folder's names and files in order of their names."""
    if path.is_file():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    whole = hashlib.sha256()
    for part in bag_files(path):
        with part.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").digest()
        whole.update(part.name.encode() + b"\0" + digest)
    return whole.hexdigest()


# The functions from here on run in the sandbox (`vfplan.io.sandbox`): a crafted bag can take all
# memory.


def prepare() -> None:
    """Load the library before any bag is read, if it is installed."""
    with suppress(MissingExtra):
        _library()


def bag_header(place: str, *options: Any) -> Iterator[list[Any]]:
    """Which topic and field of the bag at `place` will be read, and notes about them.

    options: the fields of a `RosOptions`
    Raises SessionError: no bag, or no topic with a position, or several and none chosen
    Raises MissingExtra: the library `rosbags` is not installed
    """
    path = Path(place)
    ros = RosOptions(*options)
    with _opened_bag(path) as reader:
        connection = _choose_connection(reader, ros.topic, ros.field, path.name)
        first = next(reader.messages(connections=[connection]), None)
        if first is None:
            message = f"topic {connection.topic!r} has no messages. Choose another"
            raise SessionError(message, where=path.name, code="topic-empty")
        message = reader.deserialize(first[2], connection.msgtype)
    field = _choose_field(message, ros.field, path.name)
    notes = {
        "topic": connection.topic,
        "message": connection.msgtype,
        "field": field,
        "stamp": "bag" if _header_stamp(message) is None else "header",
    }
    if getattr(getattr(message, "header", None), "frame_id", ""):
        notes["ros_frame_id"] = message.header.frame_id
    if ros.tool_tip is not None:
        notes["tool_tip_m"] = list(ros.tool_tip)
    yield [[connection.topic, field, ros.tool_tip], notes]


def read_bag(place: str, factor: float, *options: Any) -> Iterator[Samples]:
    """Yield (time since the first message [s], hip [m]) a block at a time."""
    path = Path(place)
    ros = RosOptions(*options)
    tip = None
    if ros.tool_tip is not None:
        tip = np.asarray(ros.tool_tip, float)
    start = None
    times, hips = [], []
    with _opened_bag(path) as reader:
        connection = _choose_connection(reader, ros.topic, ros.field, path.name)
        for _, recorded, raw in reader.messages(connections=[connection]):
            message = reader.deserialize(raw, connection.msgtype)
            stamp = _header_stamp(message)
            if stamp is None:
                stamp = recorded
            if start is None:
                start = stamp
            times.append((stamp - start) * 1e-9)
            value = _value_at(message, ros.field or "")
            hips.append(tip_position(value, tip, factor, path.name))
            if len(times) == BLOCK:
                yield np.array(times), np.array(hips)
                times, hips = [], []
    if times:
        yield np.array(times), np.array(hips)


def tip_position(value: Any, tip: Array | None, factor: float, where: str) -> Array:
    """(3,) position of the tip [m] from a point, a pose, a transform or a 4 x 4 matrix.

    `factor` turns the message's lengths into metres; `tip` is in metres.

    Raises SessionError: 16 numbers that are no column-major transform, a quaternion that is not of
        unit length, or something that holds no position
    Raises SettingError: a tip for a value without orientation
    """
    rotation = None
    if isinstance(value, (list, tuple, np.ndarray)) and len(value) == 16:
        matrix = np.asarray(value, float).reshape(4, 4).T
        if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-6):
            message = (
                f"16 numbers have the last row {matrix[3].tolist()}, read column-major, "
                "where a transform has 0, 0, 0, 1. Choose another field"
            )
            raise SessionError(message, where=where, code="not-a-transform")
        position = matrix[:3, 3]
        rotation = matrix[:3, :3]
    elif hasattr(value, "position"):
        position = _coordinates(value.position, where)
        rotation = _rotation_matrix(getattr(value, "orientation", None), where)
    elif hasattr(value, "translation"):
        position = _coordinates(value.translation, where)
        rotation = _rotation_matrix(getattr(value, "rotation", None), where)
    else:
        position = _coordinates(value, where)
    if tip is None:
        return position * factor
    if rotation is None:
        message = (
            "a tool tip needs a pose, and the field holds a position only. Leave the tool tip out"
        )
        raise SettingError(message, where=where, code="tip-without-orientation")
    return position * factor + rotation @ tip


def _coordinates(value: Any, where: str) -> Array:
    if isinstance(value, (list, tuple, np.ndarray)) and len(value) == 3:
        return np.asarray(value, float)
    if all(hasattr(value, axis) for axis in "xyz"):
        return np.array([value.x, value.y, value.z], float)
    message = f"{type(value).__name__} holds no position. Choose another topic or field"
    raise SessionError(message, where=where, code="no-position")


def _rotation_matrix(quaternion: Any, where: str) -> Array | None:
    """(3, 3) rotation of a unit quaternion with fields x, y, z, w; `None` of `None`."""
    if quaternion is None:
        return None
    from scipy.spatial.transform import Rotation

    xyzw = [float(getattr(quaternion, axis)) for axis in "xyzw"]
    length = np.linalg.norm(xyzw)
    if not abs(length - 1) < UNIT_ROUNDED:
        message = f"a quaternion has length {length:.6g}. Record it with length 1"
        raise SessionError(message, where=where, code="quaternion-not-unit")
    return Rotation.from_quat(xyzw).as_matrix()


def _header_stamp(message: Any) -> int | None:
    """The header's time [ns]; `None` where there is no header, or it was never set."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    nanoseconds = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
    return nanoseconds or None


def _value_at(message: Any, field: str) -> Any:
    for name in field.split("."):
        if name:
            message = getattr(message, name)
    return message


def _choose_field(message: Any, field: str | None, where: str) -> str:
    """The field that holds a position: the one that is named, or the first of `FIELDS`."""
    names = FIELDS
    if field is not None:
        names = (field,)
    for name in names:
        try:
            value = _value_at(message, name)
            # PoseWithCovariance and the like wrap the pose once more.
            if field is None and hasattr(value, "pose"):
                name = f"{name}.pose"
                value = value.pose
            tip_position(value, None, 1.0, where)
            return name
        except (AttributeError, TypeError):
            continue
        except SessionError:
            if field is not None:
                raise
    present = ", ".join(name for name in vars(message) if not name.startswith("_"))
    message = (
        f"no field {field or ''!r} holds a point, a pose, a transform or 16 numbers. Choose "
        f"one of {present}"
    )
    raise SessionError(message, where=where, code="field-missing")


def _choose_connection(reader: Any, topic: str | None, field: str | None, where: str) -> Any:
    """The topic that is named, or the only one whose messages hold a position."""
    fitting = []
    for connection in reader.connections:
        if topic not in (None, connection.topic) or connection.msgcount == 0:
            continue
        if topic is not None or holds_position(reader, connection, field):
            fitting.append(connection)
    topics = sorted({connection.topic for connection in fitting})
    if len(topics) == 1:
        return fitting[0]
    if topics:
        message = f"several topics hold positions: {', '.join(topics)}. Choose one"
        raise SessionError(message, where=where, code="several-topics")
    present = ", ".join(sorted({c.topic for c in reader.connections})) or "none"
    message = f"there is no topic {topic or 'with a position'}. Choose one of {present}"
    raise SessionError(message, where=where, code="topic-missing")


def holds_position(reader: Any, connection: Any, field: str | None) -> bool:
    """Whether the first message of a connection holds a position."""
    first = next(reader.messages(connections=[connection]), None)
    if first is None:
        return False
    with suppress(SessionError):
        _choose_field(reader.deserialize(first[2], connection.msgtype), field, "")
        return True
    return False


@functools.cache
def _library() -> tuple[Callable[..., Any], Any]:
    with requires_extra("ROS bags need the package rosbags", "ros"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    return AnyReader, get_typestore(Stores.LATEST)


@contextmanager
def _opened_bag(path: Path) -> Iterator[Any]:
    reader, types = _library()
    try:
        with reader([path], default_typestore=types) as bag:
            yield bag
    except (SessionError, SettingError, MissingExtra, GeneratorExit):
        raise
    except Exception as error:  # Each module of rosbags has its own class, and others come through.
        reason = str(error) or type(error).__name__
        message = f"cannot be read as a ROS bag: {reason}. Record or copy it again"
        raise SessionError(message, where=path.name, code="bag-broken") from None


# A tick as a controller sends it: count, time [s], places [m], force [N]; 120 bytes.
TICK = np.dtype([
    ("index", "<u8"), ("t", "<f8"), ("hip", "<f8", 3), ("proxy", "<f8", 3), ("normal", "<f8", 3),
    ("force", "<f8", 3), ("state", "i1"), ("status", "u1"), ("nothing", "V6"),
])  # fmt: skip

TOPIC = "/vfplan/tick"
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
# Bytes of a chunk. MCAP's own default; readers seek by whole chunks.
CHUNK_BYTES = 2**20

# Bytes that are reserved ahead: more than the last chunk and the index of an hour need.
RESERVE_BYTES = 4 * CHUNK_BYTES


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
        schema = self._writer.register_schema("vfplan_msgs/msg/Tick", "ros2msg", DEFINITION)
        self._channel = self._writer.register_channel(TOPIC, "cdr", schema)

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

    def __exit__(self, *failure: object) -> None:
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
    messages = []
    try:
        reader = _mcap_module("reader").make_reader(stream, validate_crcs=True)
        for _, channel, message in reader.iter_messages(topics=[TOPIC], log_time_order=False):
            if channel.message_encoding != "cdr" or len(message.data) != MESSAGE_BYTES + 4:
                message = f"{TOPIC} is of another layout. Record it with this version of vfplan"
                raise SessionError(message, where=name, code="layout-unknown")
            messages.append(message.data[4:] + PADDING)
            if len(messages) == BLOCK:
                yield np.frombuffer(b"".join(messages), TICK)
                messages = []
    except (MissingExtra, SessionError):
        raise
    except Exception as error:  # The package passes on the errors of struct, lz4 and zstd.
        message = f"cannot be read as MCAP: {error}. Record or copy it again"
        raise SessionError(message, where=name, code="mcap-broken") from None
    if messages:
        yield np.frombuffer(b"".join(messages), TICK)


def _mcap_module(name: str) -> ModuleType | Any:
    import importlib

    with requires_extra("MCAP needs the package mcap", "live"):
        return importlib.import_module(f"mcap.{name}")
