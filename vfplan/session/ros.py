"""Sessions from ROS 1 and ROS 2 bags, through the `rosbags` library (extra `[ros]`)."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.errors import MissingExtra, SessionError, SettingError, needing
from vfplan.session.types import BLOCK, Array, Pair

# Fields looked for when none is named, in this order; the first that a message has is taken.
_FIELDS = ("O_T_EE", "o_t_ee", "pose", "transform", "point", "position", "translation", "")


@dataclass(frozen=True)
class RosOptions:
    """Which part of a bag holds the positions."""

    topic: str | None = None  # `None`: the only one whose messages hold a position
    # Dotted path to a point, a pose, a transform, or 16 numbers: a column-major 4 x 4 matrix as in
    # a Franka state's `O_T_EE`. `None`: the first that is found.
    field: str | None = None
    # (x, y, z) of the tip in the frame of the pose [m]; `None`: the pose's own origin
    tool_tip: tuple[float, float, float] | None = None


def is_bag(path: Path) -> bool:
    """Whether a path looks like a ROS 1 or ROS 2 bag."""
    return path.suffix in (".bag", ".mcap", ".db3") or (path / "metadata.yaml").is_file()


def bag_stamp(path: Path) -> list[tuple[str, int, int, int]]:
    """Which files a bag is made of, and when each was written."""
    parts = [path] if path.is_file() else sorted(p for p in path.iterdir() if p.is_file())
    found = ((part.name, part.stat()) for part in parts)
    return [(name, s.st_ino, s.st_size, s.st_mtime_ns) for name, s in found]


def bag_sha256(path: Path) -> str:
    """SHA-256 of a bag's file, or of a bag folder's names and files in order of their names."""
    if path.is_file():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    whole = hashlib.sha256()
    for part in sorted(p for p in path.iterdir() if p.is_file()):
        with part.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").digest()
        whole.update(part.name.encode() + b"\0" + digest)
    return whole.hexdigest()


# What follows runs in a process apart (`vfplan.io.apart`): a bag can be made to take all memory.


def prepare() -> None:
    """Load the library before any bag is read, if it is there."""
    with suppress(MissingExtra):
        _library()


def bag_header(place: str, *asked: Any) -> Iterator[list[Any]]:
    """Of the bag at `place`: the topic and field that will be read, and what to note of them.

    `asked` are the parts of a `RosOptions`.

    Raises SessionError: no bag, or no topic with a position, or several and none chosen
    Raises MissingExtra: the library `rosbags` is not installed
    """
    path, options = Path(place), RosOptions(*asked)
    with _opened(path) as reader:
        connection = _connection(reader, options.topic, options.field, path.name)
        messages = reader.messages(connections=[connection])
        first = next(messages, None)
        if first is None:
            raise SessionError(f"topic {connection.topic!r} has no messages", where=path.name)
        message = reader.deserialize(first[2], connection.msgtype)
    field = _chosen_field(message, options.field, path.name)
    notes: dict[str, object] = {
        "topic": connection.topic,
        "message": connection.msgtype,
        "field": field,
        "stamp": "header" if _stamp(message) is not None else "bag",
    }
    if getattr(getattr(message, "header", None), "frame_id", ""):
        notes["ros_frame_id"] = message.header.frame_id
    if options.tool_tip is not None:
        notes["tool_tip_m"] = list(options.tool_tip)
    yield [[connection.topic, field, options.tool_tip], notes]


def read_bag(place: str, factor: float, *asked: Any) -> Iterator[Pair]:
    """Yield (time since the first message [s], hip [m]) piece by piece."""
    path, options = Path(place), RosOptions(*asked)
    tip = None if options.tool_tip is None else np.asarray(options.tool_tip, float)
    start: int | None = None
    stamps: list[float] = []
    places: list[Array] = []
    with _opened(path) as reader:
        connection = _connection(reader, options.topic, options.field, path.name)
        for _, recorded, raw in reader.messages(connections=[connection]):
            message = reader.deserialize(raw, connection.msgtype)
            header = _stamp(message)
            stamp = recorded if header is None else header
            start = stamp if start is None else start
            stamps.append((stamp - start) * 1e-9)
            places.append(tip_position(_part(message, options.field or ""), tip, factor, path.name))
            if len(stamps) == BLOCK:
                yield np.array(stamps), np.array(places)
                stamps, places = [], []
    if stamps:
        yield np.array(stamps), np.array(places)


def tip_position(value: Any, tip: Array | None, factor: float, where: str) -> Array:
    """(3,) position of the tip [m] from a point, a pose, a transform or a 4 x 4 matrix.

    `factor` turns the message's lengths into metres; `tip` is in metres.

    Raises SessionError: 16 numbers that are no column-major transform, a quaternion that is not of
        unit length, or something that holds no position
    Raises SettingError: a tip for a value without orientation
    """
    matrix = _matrix(value, where)
    if matrix is not None:
        place, turn = matrix[:3, 3], matrix[:3, :3]
    else:
        for inner, outer in (("position", "orientation"), ("translation", "rotation")):
            if hasattr(value, inner):
                place = _xyz(getattr(value, inner), where)
                turn = _rotation(getattr(value, outer, None), where)
                break
        else:
            place, turn = _xyz(value, where), None
    if tip is None:
        return place * factor
    if turn is None:
        raise SettingError("a tool tip needs a pose; the field holds a position only", where=where)
    return place * factor + turn @ tip


def _matrix(value: Any, where: str) -> Array | None:
    if not isinstance(value, (list, tuple, np.ndarray)) or len(value) != 16:
        return None
    matrix = np.asarray(value, float).reshape(4, 4).T
    if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-6):
        raise SessionError(
            f"16 numbers whose last row, read column-major, is {matrix[3].tolist()}; a transform's "
            "is 0, 0, 0, 1",
            where=where,
        )
    return matrix


def _xyz(value: Any, where: str) -> Array:
    if isinstance(value, (list, tuple, np.ndarray)) and len(value) == 3:
        return np.asarray(value, float)
    if all(hasattr(value, axis) for axis in "xyz"):
        return np.array([value.x, value.y, value.z], float)
    raise SessionError(f"{type(value).__name__} holds no position", where=where)


def _rotation(q: Any, where: str) -> Array | None:
    """(3, 3) rotation of a unit quaternion with fields x, y, z, w."""
    if q is None:
        return None
    from scipy.spatial.transform import Rotation

    quaternion = [float(getattr(q, axis)) for axis in "xyzw"]
    norm = np.linalg.norm(quaternion)
    if not abs(norm - 1) < 1e-3:
        raise SessionError(f"a quaternion of length {norm:.6g}; 1 wanted", where=where)
    return Rotation.from_quat(quaternion).as_matrix()


def _stamp(message: Any) -> int | None:
    """The header's time [ns]; `None` where there is no header, or it was never set."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    return (int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)) or None


def _part(message: Any, field: str) -> Any:
    for name in filter(None, field.split(".")):
        message = getattr(message, name)
    return message


def _chosen_field(message: Any, asked: str | None, where: str) -> str:
    names = _FIELDS if asked is None else (asked,)
    for name in names:
        try:
            value = _part(message, name)
            # PoseWithCovariance and the like wrap the pose once more.
            if asked is None and hasattr(value, "pose"):
                name, value = f"{name}.pose", value.pose
            tip_position(value, None, 1.0, where)
        except (AttributeError, TypeError):
            continue
        except SessionError:
            if asked is not None:
                raise
            continue
        return name
    held = ", ".join(k for k in vars(message) if not k.startswith("_"))
    wanted = "with a point, a pose, a transform or 16 numbers"
    raise SessionError(f"no field {asked or ''!r} {wanted}; there are {held}", where=where)


def _connection(reader: Any, topic: str | None, field: str | None, where: str) -> Any:
    fits = [c for c in reader.connections if topic in (None, c.topic) and c.msgcount > 0]
    if topic is None:
        fits = [c for c in fits if _promising(reader, c, field)]
    if len({c.topic for c in fits}) == 1:
        return fits[0]
    names = ", ".join(sorted({c.topic for c in reader.connections})) or "none"
    if not fits:
        raise SessionError(f"no topic {topic or 'with a position'}; there are {names}", where=where)
    several = ", ".join(sorted({c.topic for c in fits}))
    raise SessionError(f"several topics hold positions: {several}; choose one", where=where)


def _promising(reader: Any, connection: Any, field: str | None) -> bool:
    raw = next(reader.messages(connections=[connection]), None)
    if raw is None:
        return False
    try:
        _chosen_field(reader.deserialize(raw[2], connection.msgtype), field, "")
    except SessionError:
        return False
    return True


@functools.cache
def _library() -> tuple[Callable[..., Any], Any]:
    with needing("ROS bags need the package rosbags", "ros"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    return AnyReader, get_typestore(Stores.LATEST)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    reader, types = _library()
    try:
        with reader([path], default_typestore=types) as opened:
            yield opened
    except (SessionError, SettingError, MissingExtra, GeneratorExit):
        raise
    except Exception as error:  # rosbags has one exception type a module, and lets others through
        what = str(error) or type(error).__name__
        raise SessionError(f"cannot be read as a ROS bag: {what}", where=path.name) from None
