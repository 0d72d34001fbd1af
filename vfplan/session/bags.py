"""Sessions from ROS bags (extra `[ros]`), and a controller's ticks as MCAP, to the bit, and back.

The ticks are in the channel `/vfplan/tick`, ROS 2 messages (CDR) with their own definition. Beside
them are messages that Foxglove shows (`vfplan.session.foxglove`). MCAP: https://mcap.dev.
"""

from __future__ import annotations

import hashlib
import itertools
import shlex
from array import array
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MissingExtra, SessionError, SettingError
from vfplan.fixture import Fixture
from vfplan.geometry import TURN_ROUNDED, UNIT_ROUNDED
from vfplan.io.files import naming_place, opened_file
from vfplan.io.sandbox import raise_limits
from vfplan.session.channels import CDR_LITTLE_ENDIAN, Part, library, mcap_part, opened_bag
from vfplan.session.session import BLOCK, FRAMES, Array, Blocks, WithPrevious, portions

# Fields that are tried when none is named, in this order; the first that a message has is taken.
FIELDS = ("O_T_EE", "o_t_ee", "pose", "transform", "point", "position", "translation", "")

# Topics that every robot has; they are read where no other holds a position.
TF_TOPICS = ("/tf", "/tf_static")

# Three numbers of these types are a place only in a field whose name says so.
NO_PLACES = {"Vector3": "a direction or a force", "Quaternion": "a rotation"}
PLACE_FIELDS = ("position", "translation", "point")


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
    # The `frame_id` and `child_frame_id` of the messages to read; `None`: all have the same
    frame: str | None = None
    child_frame: str | None = None
    # Number of the topic's connection to read, the first being 1; `None`: all, one after another
    sender: int | None = None
    # "header" or "log" (when the bag got the message); `None`: "header" if all messages have one
    time: str | None = None
    # 16 numbers are row-major
    row_major: bool = False


class Sender(NamedTuple):
    """Who sent a message of a topic, and in which frames."""

    number: int
    type: str
    frame: str
    child_frame: str

    def __str__(self) -> str:
        child = f" to {self.child_frame!r}" if self.child_frame else ""
        return f"sender {self.number} ({self.type}, frame {self.frame!r}{child})"


def bag_files(path: Path) -> list[Path]:
    """The files that a bag consists of, in order of their names."""
    return [path] if path.is_file() else sorted(part for part in path.iterdir() if part.is_file())


def bag_stamp(path: Path) -> list[tuple[str, int, int, int]]:
    """Name, inode, size and time of change of each of a bag's files."""
    stamps = [(part.name, part.stat()) for part in bag_files(path)]
    return [(name, stamp.st_ino, stamp.st_size, stamp.st_mtime_ns) for name, stamp in stamps]


def bag_sha256(path: Path) -> str:
    """SHA-256 of a bag's file, or of a bag folder's names and files in order of their names."""
    whole = hashlib.sha256()
    for part in bag_files(path):
        with part.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256")
        if path.is_file():
            return digest.hexdigest()
        whole.update(part.name.encode() + b"\0" + digest.digest())
    return whole.hexdigest()


# The functions from here on run in the sandbox (`vfplan.io.sandbox`): a crafted bag can take all
# memory.


def prepare() -> None:
    """Load the library before any bag is read, if it is installed."""
    for name in ("rosbags.rosbag1", "rosbags.rosbag2", "rosbags.typesys", "mcap.reader"):
        with suppress(MissingExtra):
            library(name)


def read_bag(place: str, *options: Any) -> Iterator[Any]:
    """What of the bag at `place` is read, and then its (time [s], hip) a block at a time.

    Empty lists come while the messages are looked at; the first block follows notes about them.

    options: the fields of a `RosOptions`, its tool tip in the units of the messages
    Raises SessionError: no bag; no topic with a position, or several and none chosen; a topic of
        several senders or frames and none chosen; a message without a position
    Raises MissingExtra: the library `rosbags` is not installed
    """
    ros = RosOptions(*options)
    # Its samples take up to four times as much memory as a packed file; 2 GiB of it are given.
    size = sum(size for _, _, size, _ in bag_stamp(Path(place)))
    raise_limits(min(4 * size, 2 << 30), 0)
    # A frame of vfplan's own names the session's frame; where no message has it, it chooses none.
    any_frame = replace(ros, frame=None) if ros.frame in FRAMES else ros
    # Each sender's number, and of each message that of its sender, its times by the header (0:
    # none) and by the log [ns], its place and whether its quaternion was rounded.
    senders = {}
    which, stamps, places, rounded = array("q"), array("q"), array("d"), array("b")
    failures = {}
    with opened_bag(Path(place)) as bag:
        topic = _choose_topic(bag, ros)
        for k, (sender, *times, message) in enumerate(_messages(bag, topic)):
            if not k:
                field = _choose_field(message, ros)
            which.append(senders.setdefault(sender, len(senders)))
            stamps.extend(times)
            position, is_rounded = np.full(3, np.nan), False
            try:
                if is_chosen(sender, any_frame):
                    position, is_rounded = tip_position(_value_at(message, field), ros, field)
            except (SessionError, SettingError) as error:
                failures.setdefault(sender, error)
            places.extend(position)
            rounded.append(is_rounded)
            if k % BLOCK == BLOCK - 1:
                yield []
    if not senders:
        message = f"topic {topic!r} has no messages. Choose another"
        raise SessionError(message, code="topic-empty")
    if all(sender.frame != ros.frame for sender in senders):
        ros = any_frame
    chosen = [sender for sender in senders if is_chosen(sender, ros)]
    counts = np.bincount(which)
    is_used = np.isin(which, [senders[sender] for sender in chosen])
    times = np.reshape(stamps, (-1, 2))[is_used]
    unstamped = int(np.count_nonzero(times[:, 0] <= 0))
    if ros.time == "header" and unstamped:
        message = f"not every message of {topic!r} has a time of its own. Give --time log"
        raise SessionError(message, code="no-header-time")
    column = int(ros.time == "log" or unstamped > 0)
    times, numbers = times[:, column], np.array(which)[is_used]
    check_senders(topic, list(senders), {s: times[numbers == senders[s]] for s in chosen})
    for sender in chosen:
        if sender in failures:
            raise failures[sender]

    start = int(times.min())
    notes = {
        "topic": topic,
        "message": chosen[0].type,
        "field": field,
        "stamp": "bag" if column else "header",
        "left_out": int(np.count_nonzero(~is_used)),
        "connections": [
            {**sender._asdict(), "samples": int(counts[number]), "used": sender in chosen}
            for sender, number in senders.items()
        ],
    }
    if ros.time is None and 0 < unstamped < len(times):
        notes["unstamped"] = unstamped
    if start > 1e18:
        notes["start_utc"] = f"{datetime.fromtimestamp(start // 10**9, UTC):%Y-%m-%dT%H:%M:%SZ}"
    if bag.is_cut:
        notes["cut"] = True
    if chosen[0].frame:
        notes["ros_frame_id"] = chosen[0].frame
    if ros.tool_tip is not None:
        notes["poses_rounded"] = int(np.count_nonzero(np.array(rounded)[is_used]))
    yield notes
    yield from portions((times - start) * 1e-9, np.reshape(places, (-1, 3))[is_used])


def is_chosen(sender: Sender, ros: RosOptions) -> bool:
    """Whether the options leave the messages of a sender in."""
    wanted = (ros.sender, None, ros.frame, ros.child_frame)
    return all(want in (None, value) for want, value in zip(wanted, sender, strict=True))


def check_senders(topic: str, senders: list[Sender], times: dict[Sender, Array]) -> None:
    """Refuse a topic whose chosen messages are not of one tool.

    times: of the messages of each chosen sender [ns]
    """
    if not times:
        found = "; ".join(map(str, senders))
        message = f"no message of {topic!r} is of this sender and these frames. Choose: {found}"
        raise SessionError(message, code="frame-missing")
    chosen, told = list(times), "; ".join(map(str, times))
    ordered = sorted(times, key=lambda sender: times[sender].min())
    meet = any(
        one.number != two.number and times[two].min() <= times[one].max()
        for one, two in itertools.combinations(ordered, 2)
    )
    if meet or len({sender.type for sender in chosen}) > 1:
        message = (
            f"several senders share topic {topic!r} at the same time, or send different messages: "
            f"{told}. Choose one with --sender {chosen[0].number}"
        )
        raise SessionError(message, code="several-connections")
    for option, name in (("--frame", "frame"), ("--child-frame", "child_frame")):
        values = [getattr(sender, name) for sender in chosen]
        if len(set(values)) > 1:
            choice = f"{option} {shlex.quote(values[0])}"
            message = f"the frame changes within topic {topic!r}: {told}. Choose one with {choice}"
            raise SessionError(message, code="frame-changes")


def _messages(bag: Part, topic: str) -> Iterator[tuple[Sender, int, int, Any]]:
    """Every message of the topic, merged by the log's time.

    Yields the sender, the header's time (0: none) and the log's [ns], and the message. A message of
    `/tf` is as many as it has transforms.
    """
    for channel, recorded, raw in bag.messages(topic):
        whole = channel.decode(raw)
        for message in getattr(whole, "transforms", [whole]):
            header = getattr(message, "header", None)
            frames = (getattr(header, "frame_id", ""), getattr(message, "child_frame_id", ""))
            stamp = getattr(header, "stamp", None)
            nanoseconds = 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)
            yield Sender(channel.number, channel.type, *frames), nanoseconds, recorded, message


def tip_position(value: Any, ros: RosOptions, field: str = "") -> tuple[Array, bool]:
    """(3,) position of the tip from a point, a pose, a transform or a 4 x 4 matrix.

    With it whether its quaternion was needed and taken at length 1; `field` is where it stood.

    Raises SessionError: 16 numbers that are no transform, a quaternion that is not of unit length
        and is needed, or something that holds no position
    Raises SettingError: a tip for a value without orientation
    """
    turn = None
    if isinstance(value, (list, tuple, np.ndarray)) and len(value) == 16:
        order, how = ("C", "without") if ros.row_major else ("F", "with")
        matrix = np.reshape(np.asarray(value, float), (4, 4), order)
        if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-6):
            message = (
                f"16 numbers are no transform: their last row is {matrix[3].tolist()}. Read them "
                f"{how} --row-major, or choose others"
            )
            raise SessionError(message, code="not-a-transform")
        position, turn = matrix[:3, 3], matrix[:3, :3]
    elif hasattr(value, "position"):
        position = _coordinates(value.position, "position")
        turn = getattr(value, "orientation", None)
    elif hasattr(value, "translation"):
        position = _coordinates(value.translation, "translation")
        turn = getattr(value, "rotation", None)
    else:
        position = _coordinates(value, field.rpartition(".")[2])
    if ros.tool_tip is None:
        return position, False
    if turn is None:
        message = "a tool tip needs a pose, and the field holds none. Leave the tool tip out"
        raise SettingError(message, code="tip-without-orientation")
    length = 1.0
    if not isinstance(turn, np.ndarray):
        from scipy.spatial.transform import Rotation

        xyzw = [float(getattr(turn, axis)) for axis in "xyzw"]
        length = np.linalg.norm(xyzw)
        if not abs(length - 1) < TURN_ROUNDED:
            message = f"a quaternion has length {length:.6g}. Record it right, or give no tool tip"
            raise SessionError(message, code="quaternion-not-unit")
        turn = Rotation.from_quat(xyzw).as_matrix()
    return position + turn @ np.asarray(ros.tool_tip, float), bool(abs(length - 1) >= UNIT_ROUNDED)


def _coordinates(value: Any, name: str) -> Array:
    """(3,) the numbers of a place; what only looks like one is refused by its name."""
    kind = _type_name(value)
    meaning = NO_PLACES.get(kind) if name not in PLACE_FIELDS else None
    if isinstance(value, (list, tuple, np.ndarray)):
        meaning = "a row of numbers, such as joint angles"
    if meaning is None and all(hasattr(value, axis) for axis in "xyz"):
        return np.array([value.x, value.y, value.z], float)
    what = f", {meaning}," if meaning else ""
    message = f"{name or 'the message'} is {kind}{what} and no position. Choose another field"
    raise SessionError(message, code="no-position")


def _type_name(value: Any) -> str:
    return getattr(value, "__msgtype__", type(value).__name__).rpartition("/")[2]


def _value_at(message: Any, field: str) -> Any:
    """What a message holds at a dotted path; raises `SessionError` where it has none."""
    for name in filter(None, field.split(".")):
        if name.isdecimal() and isinstance(message, list) and int(name) < len(message):
            message = message[int(name)]
        elif not hasattr(message, name):
            text = f"a message of {_type_name(message)} has no {name!r}. Choose another field"
            raise SessionError(text, code="field-missing")
        else:
            message = getattr(message, name)
    return message


def _choose_field(message: Any, ros: RosOptions) -> str:
    """The field that holds a position: the one that is named, or the first of `FIELDS`.

    Raises SessionError: why the first field that might hold one does not
    """
    reason, without_tip = None, replace(ros, tool_tip=None)
    for name in FIELDS if ros.field is None else (ros.field,):
        try:
            value = _value_at(message, name)
            # PoseWithCovariance and the like wrap the pose once more.
            if ros.field is None and hasattr(value, "pose"):
                name = f"{name}.pose"
                value = value.pose
            tip_position(value, without_tip, name)
            return name
        except SessionError as error:
            if name and error.code != "field-missing":
                reason = reason or error
    if reason is not None:
        raise reason
    if ros.field is None and hasattr(message, "poses"):
        number = len(message.poses)
        text = f"{_type_name(message)} holds {number} poses. Choose one: --field poses.0"
        raise SessionError(text, code="several-poses")
    present = ", ".join(name for name in vars(message) if not name.startswith("_"))
    where = ros.field or "a field of a usual name"
    text = f"{_type_name(message)} holds no position in {where}. Choose a --field of {present}"
    raise SessionError(text, code="field-missing")


def _choose_topic(bag: Part, ros: RosOptions) -> str:
    """The topic that is named, or the only one whose first message holds a position."""
    present = sorted({channel.topic for channel in bag.channels})
    if ros.topic in present:
        return ros.topic
    topics, reasons = [], []
    for topic in present if ros.topic is None else ():
        try:
            for *_, message in itertools.islice(_messages(bag, topic), 1):
                _choose_field(message, ros)
                topics.append(topic)
        except SessionError as error:
            if error.code == "type-undefined" or len(present) == 1:
                reasons.append(error)
            elif error.code != "field-missing":
                error.message = f"topic {topic!r}: {error.message}"
                reasons.insert(0, error)
    topics = [topic for topic in topics if topic not in TF_TOPICS] or topics
    if len(topics) == 1:
        return topics[0]
    if topics:
        message = f"several topics hold positions: {', '.join(topics)}. Choose one with --topic"
        raise SessionError(message, code="several-topics")
    if reasons:
        raise reasons[0]
    wanted, there = ros.topic or "with a position", ", ".join(present) or "none"
    message = f"there is no topic {wanted}. Choose one of {there}"
    raise SessionError(message, code="topic-missing")


# A tick as a controller sends it: count, time [s], places [m], force [N]; 120 bytes.
TICK = np.dtype([
    ("index", "<u8"), ("t", "<f8"), ("hip", "<f8", 3), ("proxy", "<f8", 3), ("normal", "<f8", 3),
    ("force", "<f8", 3), ("state", "i1"), ("status", "u1"), ("nothing", "V6"),
])  # fmt: skip


# (n,) of `TICK`.
TickRows = NDArray[np.void]


def as_ticks(block: Any, first: int = 0) -> TickRows:
    """(n,) of `TICK`, of a `TickBlock`; `first`: the number of its first tick."""
    ticks = np.zeros(len(block), TICK)
    ticks["index"] = first + np.arange(len(ticks))
    ticks["t"] = block.time
    for name in ("hip", "proxy", "normal", "force", "state"):
        ticks[name] = getattr(block, name)
    return ticks


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
PADDING = bytes(6)
MESSAGE_BYTES = TICK.itemsize - len(PADDING)
# Bytes of a chunk, a second of ticks at 1 kHz: as much as is lost where the program is killed.
CHUNK_BYTES = 2**17

# Latest time of a message [s since 1970]: Foxglove's seconds have 32 bits.
MAX_STAMP_S = 2**32

# A time that goes back by more than this [s] is that of a controller that began again.
RESTART_S = 1.0


class McapWriter(ExitStack):
    """Write ticks as they come; a file that could not be ended is read as far as it is whole.

    path: made anew
    shown: a fixture at rest, to be shown with the ticks by viewers, and at which rate [Hz]
    Raises MissingExtra: without the package mcap, or foxglove-sdk where it is shown
    """

    def __init__(self, path: Path, shown: tuple[Fixture, float] | None = None) -> None:
        super().__init__()
        # Ticks that are in the file, once it is closed, and why later ones are not.
        self.kept = 0
        self.full: OSError | None = None
        writer_module = library("mcap.writer")
        self._path = path
        self._file = path.open("wb")
        self._writer = writer_module.Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="", library="vfplan")
        schema = self._writer.register_schema("vfplan_msgs/msg/Tick", "ros2msg", DEFINITION)
        self._channel = self._writer.register_channel(TOPIC, "cdr", schema)
        self._viewer = None
        if shown is not None:
            library("foxglove.messages")
            from vfplan.session.foxglove import FoxgloveChannels

            self._viewer = FoxgloveChannels(self._writer, *shown)
        # What a tick's time lacks to be the time since 1970, and the last tick's time [s].
        self._epoch_s, self._last_s = 0.0, np.inf
        self.callback(self._finish)

    def write(self, ticks: TickRows, received_s: float) -> None:
        """Add (n,) of `TICK`; `received_s` since 1970. Nothing is added once it is `full`.

        A tick is stamped by its own time, counted from the receipt of the first, or of the first
        after the controller began again.
        """
        try:
            for tick in ticks if self.full is None else ():
                time_s = float(tick["t"])
                if time_s < self._last_s - RESTART_S:
                    self._epoch_s = received_s - float(ticks["t"][-1])
                # A session that MCAP has no times for, such as one that begins below 0, is stamped
                # from 0 on.
                if not 0 <= time_s + self._epoch_s < MAX_STAMP_S:
                    self._epoch_s = -time_s
                self._last_s = time_s
                body = CDR_LITTLE_ENDIAN + tick.tobytes()[:MESSAGE_BYTES]
                stamp = round((time_s + self._epoch_s) * 1e9)
                # MCAP's sequence numbers have 32 bits.
                sequence = int(tick["index"]) % 2**32
                self._writer.add_message(self._channel, stamp, body, stamp, sequence)
                if self._viewer is not None:
                    self._viewer.write(tick, stamp)
                self.kept += 1
            self._file.flush()
        except OSError as error:
            self.full = error

    def _finish(self) -> None:
        """Write the index; nothing may be added afterwards."""
        try:
            if self.full is None:
                self._writer.finish()
            self._file.close()
        except OSError as error:
            self.full = self.full or error
        if self.full is not None:
            self.kept = len(read_ticks(self._path))


def has_our_topic(stream: BinaryIO) -> Iterator[list[bool]]:
    """Yield whether an MCAP file has our channel, and whether it was cut off.

    A file of others is a ROS bag, and the reader of ROS bags says what is wrong with it.
    """
    try:
        part = mcap_part(stream, in_file_order=True)
    except MissingExtra:
        raise
    except Exception:  # The package passes on the errors of struct, lz4 and zstd.
        yield [False, False]
    else:
        yield [any(channel.topic == TOPIC for channel in part.channels), part.is_cut]


def read_hips(stream: BinaryIO) -> Blocks:
    """Yield (time [s], hip) a block at a time, as sessions are read; raises `SessionError`.

    A controller that begins again with an earlier time goes on after the time that passed between
    the two ticks' receipts.
    """
    with_previous, shift = WithPrevious(), 0.0
    for ticks, received in blocks(stream):
        time, log = with_previous(ticks["t"], received)
        step = np.diff(time)
        waited = np.maximum(np.diff(log), RESTART_S) - step
        shifts = shift + np.cumsum(np.append(0.0, np.where(step < -RESTART_S, waited, 0.0)))
        shift = shifts[-1]
        yield ticks["t"] + shifts[-len(ticks) :], ticks["hip"]


def read_ticks(path: Path) -> TickRows:
    """(T,) of `TICK`, in the order of the loop; raises `SessionError` as `blocks` does."""
    with opened_file(path, SessionError) as stream, naming_place(path.name):
        return np.concatenate([np.zeros(0, TICK), *(one for one, _ in blocks(stream))])


def blocks(stream: BinaryIO) -> Iterator[tuple[TickRows, Array]]:
    """Yield (n,) of `TICK`, and when they were received [s]; of a cut recording its whole part.

    Raises SessionError: damaged, or of another layout
    """
    is_empty = True
    try:
        part = mcap_part(stream, in_file_order=True)
        messages = part.messages(TOPIC)
        while portion := list(itertools.islice(messages, BLOCK)):
            is_empty = False
            for channel, _, data in portion:
                if channel.encoding != "cdr" or len(data) != MESSAGE_BYTES + 4:
                    message = f"{TOPIC} is of another layout. Record it with this version of vfplan"
                    raise SessionError(message, code="layout-unknown")
            ticks = b"".join(data[4:] + PADDING for *_, data in portion)
            yield np.frombuffer(ticks, TICK), 1e-9 * np.array([stamp for _, stamp, _ in portion])
        if part.is_cut and is_empty:
            raise ValueError("it was cut off before its first tick")
    except (MissingExtra, SessionError, GeneratorExit):
        raise
    except Exception as error:  # The package passes on the errors of struct, lz4 and zstd.
        message = f"cannot be read as MCAP: {error}. Record or copy it again"
        raise SessionError(message, code="mcap-broken") from None
