"""Recordings of every form, type, sender, frame and stamp, against the table that rosbags reads."""

from __future__ import annotations

import os
import re
import shlex
import struct
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from motion import turned
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refuses

from vfplan.errors import SessionError, SettingError
from vfplan.session.bags import RosOptions, bag_stamp, tip_position
from vfplan.session.read import open_session, read_session

pytest.importorskip("rosbags")
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

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


def pose_of(store, place, quat):
    pose, point, quaternion = (
        store.types[f"geometry_msgs/msg/{name}"] for name in ("Pose", "Point", "Quaternion")
    )
    return pose(point(*map(float, place)), quaternion(*map(float, quat)))


def header_of(store, stamp, *sequence, frame="panda_link0"):
    time = store.types["builtin_interfaces/msg/Time"](*divmod(int(stamp), 10**9))
    return store.types["std_msgs/msg/Header"](*sequence, time, frame)


def message(store, kind, stamp, place, frame, child, k):
    """A message of a kind with its header's stamp [ns]."""
    types = store.types
    sequence = (k,) if "seq" in types["std_msgs/msg/Header"].__annotations__ else ()
    header = header_of(store, stamp, *sequence, frame=frame)
    pose = pose_of(store, place, (0, 0, 0, 1))
    if kind == "PointStamped":
        return types["geometry_msgs/msg/PointStamped"](header, pose.position)
    vector = types["geometry_msgs/msg/Vector3"]
    if kind == "TransformStamped":
        place = vector(*map(float, place))
        body = types["geometry_msgs/msg/Transform"](place, pose.orientation)
        return types["geometry_msgs/msg/TransformStamped"](header, child, body)
    if kind == "PoseStamped":
        return types["geometry_msgs/msg/PoseStamped"](header, pose)
    still = types["geometry_msgs/msg/Twist"](vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    pose = types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
    twist = types["geometry_msgs/msg/TwistWithCovariance"](still, np.zeros(36))
    return types["nav_msgs/msg/Odometry"](header, child, pose, twist)


def bag_of(path, store, kind, rows, topics=("/tip",), senders=1):
    """Write (number of the sender or topic, log time [ns], message) as a bag of ROS 1 or ROS 2."""
    is_ros1 = path.suffix == ".bag"
    write = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    with rosbag1.Writer(path) if is_ros1 else rosbag2.Writer(path, version=9) as writer:
        ids = [{"callerid": f"/n{k}"} if is_ros1 else {} for k in range(senders)]
        to = [writer.add_connection(topic, kind, typestore=store, **more)
              for topic in topics for more in ids]  # fmt: skip
        for number, time, one in rows:
            writer.write(to[number], int(time), write(one, kind))
        if not is_ros1:
            text = "std_msgs/msg/String"
            note = writer.add_connection("/note", text, typestore=store)
            writer.write(note, T0, store.serialize_cdr(store.types[text]("hello"), text))
    return path


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
    _, kind, spans, *_ = case
    is_ros1 = form == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    name = ("nav_msgs/msg/" if kind == "Odometry" else "geometry_msgs/msg/") + kind
    path = path / (form if form == "sqlite" else f"{form}.{'bag' if is_ros1 else 'mcap'}")
    rows = [(row[0], row[1], message(store, kind, *row[2:], k)) for k, row in enumerate(sent(case))]
    if form in ("bag", "sqlite"):
        return bag_of(path, store, name, rows, senders=len(spans))
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
            writer.add_message(to[number], time, bytes(store.serialize_cdr(raw, name)), time)
        writer.finish()
    return path


def table(path, kind, ros, factor):
    """What rosbags alone reads of a bag: times [s] and places of the chosen messages."""
    from rosbags.highlevel import AnyReader

    rows = []
    with AnyReader([path]) as reader:
        tips = [one for one in reader.connections if one.topic == "/tip"]
        numbers = {c.id: k for k, c in enumerate(tips, 1)}
        for connection, log, raw in reader.messages(tips):
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


TIP = (0.01, -0.02, 0.1)


def motion():
    """Stamps [ns], origins (50, 3), rotations (50, 3, 3) and quaternions x, y, z, w (50, 4)."""
    rng = np.random.default_rng(5)
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    angles = np.linspace(0, 2.0, 50)
    turns = np.array([turned(axis, a) for a in angles])
    quats = np.c_[np.sin(angles / 2)[:, None] * axis, np.cos(angles / 2)]
    stamps = T0 + np.cumsum(rng.integers(900_000, 1_100_000, 50))
    return stamps, rng.normal(0.4, 0.1, (50, 3)), turns, quats


def write_poses(path, topics=("/measured_cp",), length=1.0, unstamped=0):
    store = get_typestore(Stores.ROS2_HUMBLE)
    stamps, places, turns, quats = motion()
    kind = "geometry_msgs/msg/PoseStamped"
    rows = []
    for k, (stamp, place, quat) in enumerate(zip(stamps, places, quats, strict=True)):
        body = pose_of(store, place, length * np.array(quat))
        sent = store.types[kind](header_of(store, stamp if k >= unstamped else 0), body)
        # The bag's own clock runs late; the header's is the one that counts.
        rows += [(number, stamp + 5_000_000, sent) for number in range(len(topics))]
    bag_of(path, store, kind, rows, topics)
    return (stamps - stamps[0]) * 1e-9, places, turns


def test_pose_with_and_without_a_tip(tmp_path):
    time, places, turns = write_poses(tmp_path / "bag")
    session = read_session(tmp_path / "bag")
    assert_allclose(session.time, time, atol=1e-12)
    told = [session.notes[name] for name in ("topic", "ros_frame_id", "stamp")]
    assert told == ["/measured_cp", "panda_link0", "header"]
    tipped = read_session(tmp_path / "bag", ros=RosOptions(tool_tip=TIP))
    assert_allclose(tipped.hip, places + turns @ TIP, atol=1e-12)
    assert tipped.notes["poses_rounded"] == 0
    write_poses(tmp_path / "rounded", length=1.0014)
    rounded = read_session(tmp_path / "rounded", ros=RosOptions(tool_tip=TIP))
    assert_allclose(rounded.hip, tipped.hip, atol=1e-12)
    assert rounded.notes["poses_rounded"] == rounded.ticks
    by_name = RosOptions("/measured_cp", "pose.position")
    assert_array_equal(read_session(tmp_path / "bag", ros=by_name).hip, session.hip)


@pytest.mark.parametrize("unstamped", [0, 1, 50])
def test_a_clock_that_some_messages_lack_is_named(unstamped, tmp_path):
    time, *_ = write_poses(tmp_path / "bag", unstamped=unstamped)
    session = read_session(tmp_path / "bag")
    assert session.notes.get("unstamped", 0) == unstamped % 50
    assert session.notes["stamp"] == ("bag" if unstamped else "header")
    assert_allclose(session.time, time, atol=1e-12)
    assert "unstamped" not in read_session(tmp_path / "bag", ros=RosOptions(time="log")).notes


def test_several_topics_need_a_choice(tmp_path):
    write_poses(tmp_path / "bag", ("/measured_cp", "/setpoint_cp"))
    with refuses(SessionError, "several-topics"):
        read_session(tmp_path / "bag")
    assert read_session(tmp_path / "bag", ros=RosOptions(topic="/setpoint_cp")).ticks == 50
    for ros, error, code in (
        (RosOptions("/nowhere"), SessionError, "topic-missing"),
        (RosOptions("/note"), SessionError, "field-missing"),
        (RosOptions("/setpoint_cp", "pose.position", TIP), SettingError, "tip-without-orientation"),
    ):
        with refuses(error, code):
            read_session(tmp_path / "bag", ros=ros)


@pytest.mark.parametrize("kind, field, code", [
    ("sensor_msgs/msg/JointState", None, "no-position"),
    ("sensor_msgs/msg/JointState", "position", "no-position"),
    ("geometry_msgs/msg/Vector3Stamped", None, "field-missing"),
    ("geometry_msgs/msg/Vector3Stamped", "vector", "no-position"),
    ("geometry_msgs/msg/QuaternionStamped", "quaternion", "no-position"),
    ("geometry_msgs/msg/WrenchStamped", "wrench.force", "no-position"),
    ("geometry_msgs/msg/Point", None, "no-header-time"),
    ("geometry_msgs/msg/PoseArray", None, "several-poses"),
    ("geometry_msgs/msg/PoseArray", "poses.2", "field-missing"),
    ("geometry_msgs/msg/PoseArray", "poses.1", None),
])  # fmt: skip
def test_three_numbers_alone_are_no_position(tmp_path, kind, field, code):
    store = get_typestore(Stores.ROS2_HUMBLE)
    three = np.array([0.1, 0.2, 0.3])
    make = {name: store.types[f"geometry_msgs/msg/{name}"] for name in
            ("Vector3", "Quaternion", "Wrench")}  # fmt: skip
    vector = make["Vector3"](*three)
    bodies = {
        "JointState": (["a", "b", "c"], three, three, three),
        "Vector3Stamped": (vector,),
        "QuaternionStamped": (make["Quaternion"](0.0, 0.0, 0.0, 1.0),),
        "WrenchStamped": (make["Wrench"](vector, vector),),
        "PoseArray": (
            [pose_of(store, three, (0, 0, 0, 1)), pose_of(store, 2 * three, (0, 0, 0, 1))],
        ),
    }
    rows = []
    for k in range(3):
        body = bodies.get(kind.rpartition("/")[2])
        parts = three if body is None else (header_of(store, T0 + k), *body)
        rows.append((0, T0 + k, store.types[kind](*parts)))
    bag_of(tmp_path / "bag", store, kind, rows)
    ros = RosOptions("/tip", field, time="header")
    if code is None:
        assert read_session(tmp_path / "bag", ros=ros).hip[2].tolist() == (2 * three).tolist()
        return
    with refuses(SessionError, code):
        read_session(tmp_path / "bag", ros=ros)


def test_franka_state_in_a_ros1_bag(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    name = "franka_msgs/msg/FrankaState"
    definition = "std_msgs/Header header\nfloat64[6] O_F_ext_hat_K\nfloat64[16] O_T_EE\n"
    store.register(get_types_from_msg(definition, name))
    stamps, places, turns, _ = motion()
    rows = []
    for k, (stamp, place, turn) in enumerate(zip(stamps, places, turns, strict=True)):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, place
        header = header_of(store, stamp, k, frame="base")
        rows.append((0, stamp, store.types[name](header, np.zeros(6), pose.T.ravel())))
    bag_of(tmp_path / "arm.bag", store, name, rows)
    session = read_session(tmp_path / "arm.bag", ros=RosOptions(tool_tip=TIP))
    assert_allclose(session.hip, places + turns @ TIP, atol=1e-12)
    assert session.notes["field"] == "O_T_EE"
    assert len(session.sha256) == 64


def test_a_row_major_matrix_is_refused():
    pose = np.eye(4)
    pose[:3, 3] = 0.3, 0.1, 0.5
    for row_major in (False, True):
        ros, sent = RosOptions(row_major=row_major), pose if row_major else pose.T
        assert_array_equal(tip_position(sent.ravel(), ros)[0], pose[:3, 3])
        with refuses(SessionError, "not-a-transform") as refused:
            tip_position(sent.T.ravel(), ros)
        assert "last row is [0.3, 0.1, 0.5, 1.0]" in str(refused.value)


def test_a_sender_that_is_not_chosen_refuses_nothing(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/PoseStamped"
    rows = []
    for k in range(100):
        frame, length = ("camera", 0) if k % 2 else ("robot_base", 1)
        pose = pose_of(store, (k, 0, 0), (0, 0, 0, length))
        rows.append((0, T0 + k * 10**6, store.types[kind](header_of(store, T0, frame=frame), pose)))
    bag_of(tmp_path / "bag", store, kind, rows)
    ros = RosOptions("/tip", time="log", frame="robot_base", tool_tip=(0, 0, 1))
    assert read_session(tmp_path / "bag", ros=ros).hip[:, 0].tolist() == list(range(0, 100, 2))
    with refuses(SessionError, "quaternion-not-unit"):
        read_session(tmp_path / "bag", ros=replace(ros, frame="camera"))
    # Without a tip no turn is needed.
    assert read_session(tmp_path / "bag", ros=RosOptions(frame="camera", time="log")).ticks == 50


def test_a_bag_that_is_replaced_by_one_of_its_size_and_time_is_another(tmp_path):
    path, other = tmp_path / "s.bag", tmp_path / "o.bag"
    for one in (path, other):
        one.write_bytes(b"12")
        os.utime(one, ns=(T0, T0))
    stamp = bag_stamp(path)
    other.replace(path)
    assert bag_stamp(path) != stamp


def test_types_in_idl_are_decoded(tmp_path):
    struct_text = "struct Tip { double x; double y; double z; };"
    text = (
        f"{'=' * 80}\nIDL: lab_msgs/msg/Tip\nmodule lab_msgs {{ module msg {{ {struct_text} }}; }};"
    )
    with (tmp_path / "s.mcap").open("wb") as file:
        writer = mcap.Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("lab_msgs/msg/Tip", "ros2idl", text.encode())
        channel = writer.register_channel("/tip", "cdr", schema)
        for time in (T0, T0 + 10**9):
            writer.add_message(channel, time, struct.pack("<4B3d", 0, 1, 0, 0, 1, 2, 3), time)
        writer.finish()
    assert read_session(tmp_path / "s.mcap").hip.tolist() == [[1, 2, 3]] * 2


def test_broken_bags_and_options_without_a_bag(tmp_path):
    (tmp_path / "bad.bag").write_bytes(b"#ROSBAG V2.0\nnothing")
    with refuses(SessionError, "bag-broken"):
        read_session(tmp_path / "bad.bag")
    (tmp_path / "s.csv").write_text("t,x,y,z\n0,1,2,3\n1,2,3,4\n")
    with refuses(SettingError, "ros-options-unused"):
        read_session(tmp_path / "s.csv", ros=RosOptions(topic="/a"))
