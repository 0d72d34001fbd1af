"""Recordings of every form, type, sender, frame and stamp, against the table that rosbags reads."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from refusals import refuses

from vfplan.errors import SessionError
from vfplan.session.bags import RosOptions
from vfplan.session.read import open_session

pytest.importorskip("rosbags")
mcap = pytest.importorskip("mcap.writer")

T0 = 1_700_000_000_000_000_000
KINDS = {
    # type of the messages -> where their position stands
    "PoseStamped": "pose.position", "TransformStamped": "transform.translation",
    "PointStamped": "point", "Odometry": "pose.pose.position",
}  # fmt: skip
FORMS = ("bag", "sqlite", "plain", "zstd", "lz4", "chunks", "foreign")
# Of each sender the first and last tenth of a second.
SENDERS = ([(0, 40)], [(0, 20), (20, 40)], [(0, 40), (10, 30)])
STAMPS = ("sound", "none", "doubled", "swapped", "far")


def message(store, kind, stamp, place, frame, child, k):
    """A message of a kind with its header's stamp [ns]."""
    types = store.types
    make = {name: types[f"geometry_msgs/msg/{name}"] for name in
            ("Point", "Vector3", "Quaternion", "Pose", "Transform", "Twist")}  # fmt: skip
    sequence = (k,) if "seq" in types["std_msgs/msg/Header"].__annotations__ else ()
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
    header = types["std_msgs/msg/Header"](*sequence, time, frame)
    turn, place = make["Quaternion"](0.0, 0.0, 0.0, 1.0), list(map(float, place))
    if kind == "PointStamped":
        return types["geometry_msgs/msg/PointStamped"](header, make["Point"](*place))
    if kind == "TransformStamped":
        body = make["Transform"](make["Vector3"](*place), turn)
        return types["geometry_msgs/msg/TransformStamped"](header, child, body)
    pose = make["Pose"](make["Point"](*place), turn)
    if kind == "PoseStamped":
        return types["geometry_msgs/msg/PoseStamped"](header, pose)
    still = make["Twist"](make["Vector3"](0.0, 0.0, 0.0), make["Vector3"](0.0, 0.0, 0.0))
    pose = types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
    twist = types["geometry_msgs/msg/TwistWithCovariance"](still, np.zeros(36))
    return types["nav_msgs/msg/Odometry"](header, child, pose, twist)


def sent(case):
    """(sender, log time [ns], header time [ns], place, frame, child frame) of each message."""
    _, _, spans, stamps, frames, children = case
    rows = []
    for number, (first, last) in enumerate(spans):
        for k in range(first, last):
            time = T0 + k * 10**8 + 1000 * number
            place = (k / 3, number, k * number / 7)
            frame, child = frames[k % len(frames)], children[k % len(children)]
            rows.append([number, time + 777, time, place, frame, child])
    rows.sort(key=lambda row: row[1])
    for k in {"doubled": (5,), "swapped": (5,), "far": range(1, 20, 3)}.get(stamps, ()):
        one, two = rows[k], rows[k + 1]
        one[2], two[2] = (two[2], one[2]) if stamps == "swapped" else (one[2], one[2])
    for row in rows if stamps == "none" else ():
        row[2] = 0
    return rows


def record(path, case, form):
    """Write a case as a bag of a form; the bag's path."""
    from rosbags.typesys import Stores, get_typestore

    _, kind, spans, *_ = case
    is_ros1 = form == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    name = ("nav_msgs/msg/" if kind == "Odometry" else "geometry_msgs/msg/") + kind
    write = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    rows = [(row[0], row[1], bytes(write(message(store, kind, *row[2:], k), name)))
            for k, row in enumerate(sent(case))]  # fmt: skip
    path = path / (form if form == "sqlite" else f"{form}.{'bag' if is_ros1 else 'mcap'}")
    if form in ("bag", "sqlite"):
        from rosbags import rosbag1, rosbag2

        writer = rosbag1.Writer(path) if is_ros1 else rosbag2.Writer(path, version=9)
        with writer:
            options = [{"callerid": f"/n{k}"} if is_ros1 else {} for k in range(len(spans))]
            to = [writer.add_connection("/tip", name, typestore=store, **o) for o in options]
            for number, time, raw in rows:
                writer.write(to[number], time, raw)
        return path
    packing = {"zstd": "ZSTD", "lz4": "LZ4"}.get(form, "NONE")
    index = mcap.IndexType.CHUNK if form == "chunks" else mcap.IndexType.ALL
    with path.open("wb") as file:
        writer = mcap.Writer(
            file, 500, compression=mcap.CompressionType[packing], index_types=index
        )
        writer.start("" if form == "foreign" else "ros2")
        schema = writer.register_schema(name, "ros2msg", store.generate_msgdef(name)[0].encode())
        to = [writer.register_channel("/tip", "cdr", schema) for _ in spans]
        if form == "foreign":
            other = writer.register_schema("a.B", "protobuf", b"\x0a\x00")
            writer.add_message(writer.register_channel("/b", "protobuf", other), T0, b"\x08", T0)
        for number, time, raw in rows:
            writer.add_message(to[number], time, raw, time)
        writer.finish()
    return path


def table(path, kind, ros, factor):
    """What rosbags alone reads of a bag: times [s] and places of the chosen messages."""
    from rosbags.highlevel import AnyReader

    rows = []
    with AnyReader([path]) as reader:
        numbers = {c.id: k for k, c in enumerate(reader.connections, 1)}
        for connection, log, raw in reader.messages():
            one = reader.deserialize(raw, connection.msgtype)
            stamp = one.header.stamp.sec * 10**9 + one.header.stamp.nanosec
            wanted = ((ros.sender, numbers[connection.id]), (ros.frame, one.header.frame_id),
                      (ros.child_frame, getattr(one, "child_frame_id", "")))  # fmt: skip
            if all(want in (None, value) for want, value in wanted):
                place = one
                for name in KINDS[kind].split("."):
                    place = getattr(place, name)
                rows.append((stamp, log, place.x, place.y, place.z))
    column = 1 if ros.time == "log" or not all(row[0] for row in rows) else 0
    first = min(row[column] for row in rows)
    found = {}
    for row in rows:
        found.setdefault(row[column], row[2:])
    times = sorted(found)
    return [(t - first) * 1e-9 for t in times], np.array([found[t] for t in times]) * factor


RNG = np.random.default_rng(57)
ALL = list(product(FORMS, KINDS, SENDERS, STAMPS, ("a", "ab"), ("t", "tu")))
ALL = [case for case in ALL if case[0] != "sqlite" or len(case[2]) == 1]
CHOSEN = [ALL[k] for k in RNG.choice(len(ALL), 300, replace=False)]
CASES = CHOSEN[:12] + [pytest.param(case, marks=pytest.mark.slow) for case in CHOSEN[12:]]


@pytest.mark.parametrize("case", CASES, ids=repr)
def test_a_recording_is_the_table_of_its_samples(tmp_path, case):
    path = record(tmp_path, case, case[0])
    plain = path if case[0] in ("bag", "sqlite") else record(tmp_path, case, "plain")
    ros, skip, units = RosOptions(), False, ("m", "mm")[len(case[4]) % 2]
    refusals = []
    for _ in range(5):
        try:
            opened = open_session(path, units=units, ros=ros, skip_unordered=skip)
            session = opened.load()
            break
        except SessionError as error:
            # The next step that it names is taken, as it stands.
            step = re.search(r"--(sender|frame|child-frame|skip-unordered)(?: (\S+))?", str(error))
            refusals.append(error.code)
            if step[1] == "skip-unordered":
                skip = True
            else:
                value = shlex.split(step[2])[0]
                value = int(value) if step[1] == "sender" else value
                ros = replace(ros, **{step[1].replace("-", "_"): value})
    times, places = table(plain, case[1], ros, {"m": 1.0, "mm": 1e-3}[units])
    assert session.time.tolist() == times
    assert session.hip.tolist() == places.tolist()
    used = sum(c["samples"] for c in session.notes["connections"] if c["used"])
    assert opened.notes["mended"]["doubled"] == used - session.ticks
    assert case[2] != SENDERS[2] or "several-connections" in refusals


def test_a_frame_that_no_message_has_is_refused_and_the_log_has_times_too(tmp_path):
    path = record(tmp_path, ("bag", "TransformStamped", SENDERS[1], "sound", "ab", "t"), "bag")
    for frame, code in (("c", "frame-missing"), ("robot_base", "frame-changes")):
        with refuses(SessionError, code):
            open_session(path, ros=RosOptions(frame=frame))
    read = open_session(path, ros=RosOptions(frame="b", time="log")).load()
    assert (read.notes["stamp"], read.ticks, read.notes["left_out"]) == ("bag", 20, 20)
    assert read.notes["start_utc"].startswith("2023-11-14T22:13:20")


def test_what_cannot_be_decoded_is_named_and_a_cut_file_read_as_far_as_it_goes(tmp_path):
    case = ("foreign", "PoseStamped", SENDERS[0], "sound", "a", "t")
    path = record(tmp_path, case, "foreign")
    with refuses(SessionError, "type-undefined"):
        open_session(path, ros=RosOptions("/b"))
    whole = record(tmp_path, case, "plain").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    read = open_session(tmp_path / "cut.mcap").load()
    assert read.notes["cut"]
    assert 10 < read.ticks < 40
    folder = record(tmp_path, ("sqlite", *case[1:]), "sqlite")
    (folder / "metadata.yaml").unlink()
    assert open_session(folder).load().ticks == 40
    (tmp_path / "m.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512))
    with refuses(SessionError, "matlab-file"):
        open_session(tmp_path / "m.mat")
