"""ROS bags: poses, Franka states and points, the tool's tip, and bags that cannot be used."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refuses

from vfplan.errors import SessionError, SettingError
from vfplan.session.bags import RosOptions, tip_position
from vfplan.session.read import read_session

rosbags = pytest.importorskip("rosbags")

T0 = 1_700_000_000_000_000_000
TIP = (0.01, -0.02, 0.1)


def rotation(axis, angle):
    """Rodrigues' formula."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def motion(count=50):
    """Stamps [ns], origins (T, 3), rotations (T, 3, 3) and quaternions x, y, z, w (T, 4)."""
    rng = np.random.default_rng(5)
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    angles = np.linspace(0, 2.0, count)
    turns = np.array([rotation(axis, a) for a in angles])
    quats = np.c_[np.sin(angles / 2)[:, None] * axis, np.cos(angles / 2)]
    stamps = T0 + np.cumsum(rng.integers(900_000, 1_100_000, count))
    return stamps, rng.normal(0.4, 0.1, (count, 3)), turns, quats


def pose_of(store, place, quat):
    pose, point, quaternion = (
        store.types[f"geometry_msgs/msg/{name}"] for name in ("Pose", "Point", "Quaternion")
    )
    return pose(point(*map(float, place)), quaternion(*map(float, quat)))


def header_of(store, stamp, *sequence, frame="panda_link0"):
    time = store.types["builtin_interfaces/msg/Time"](*divmod(int(stamp), 10**9))
    return store.types["std_msgs/msg/Header"](*sequence, time, frame)


def write_poses(path, extra_topic=False):
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    stamps, places, turns, quats = motion()
    kind = "geometry_msgs/msg/PoseStamped"
    with Writer(path, version=9) as writer:
        topics = ["/measured_cp"] + ["/setpoint_cp"] * extra_topic
        for topic in topics:
            to = writer.add_connection(topic, kind, typestore=store)
            for stamp, place, quat in zip(stamps, places, quats, strict=True):
                body = pose_of(store, place, quat)
                message = store.types[kind](header_of(store, stamp), body)
                # The bag's own clock runs late; the header's is the one that counts.
                writer.write(to, int(stamp) + 5_000_000, store.serialize_cdr(message, kind))
        note = writer.add_connection("/note", "std_msgs/msg/String", typestore=store)
        text = store.types["std_msgs/msg/String"]("hello")
        writer.write(note, T0, store.serialize_cdr(text, "std_msgs/msg/String"))
    return (stamps - stamps[0]) * 1e-9, places, turns


def test_pose_with_and_without_a_tip(tmp_path):
    time, places, turns = write_poses(tmp_path / "bag")
    session = read_session(tmp_path / "bag")
    np.testing.assert_allclose(session.time, time, atol=1e-12)
    np.testing.assert_allclose(session.hip, places, atol=1e-15)
    assert session.notes["topic"] == "/measured_cp"
    assert session.notes["ros_frame_id"] == "panda_link0"
    assert session.notes["stamp"] == "header"
    tipped = read_session(tmp_path / "bag", ros=RosOptions(tool_tip=TIP))
    np.testing.assert_allclose(tipped.hip, places + turns @ TIP, atol=1e-12)
    by_name = RosOptions("/measured_cp", "pose.position")
    np.testing.assert_array_equal(read_session(tmp_path / "bag", ros=by_name).hip, session.hip)


def test_several_topics_need_a_choice(tmp_path):
    write_poses(tmp_path / "bag", extra_topic=True)
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


@pytest.mark.parametrize(
    ("kind", "field", "code"),
    [
        ("sensor_msgs/msg/JointState", None, "no-position"),
        ("sensor_msgs/msg/JointState", "position", "no-position"),
        ("geometry_msgs/msg/Vector3Stamped", None, "topic-missing"),
        ("geometry_msgs/msg/Vector3Stamped", "vector", "no-position"),
        ("geometry_msgs/msg/QuaternionStamped", "quaternion", "no-position"),
        ("geometry_msgs/msg/WrenchStamped", "wrench.force", "no-position"),
        ("geometry_msgs/msg/Point", None, "no-header-time"),
        ("geometry_msgs/msg/PoseArray", None, "several-poses"),
        ("geometry_msgs/msg/PoseArray", "poses.2", "topic-missing"),
        ("geometry_msgs/msg/PoseArray", "poses.1", None),
    ],
)
def test_three_numbers_alone_are_no_position(tmp_path, kind, field, code):
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

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
    with Writer(tmp_path / "bag", version=9) as writer:
        to = writer.add_connection("/thing", kind, typestore=store)
        for k in range(3):
            body = bodies.get(kind.rpartition("/")[2])
            parts = three if body is None else (header_of(store, T0 + k), *body)
            message = store.types[kind](*parts)
            writer.write(to, T0 + k, store.serialize_cdr(message, kind))
    ros = RosOptions(field=field, time="header")
    if code is None:
        assert read_session(tmp_path / "bag", ros=ros).hip[2].tolist() == (2 * three).tolist()
        return
    with refuses(SessionError, code):
        read_session(tmp_path / "bag", ros=ros)


def test_franka_state_in_a_ros1_bag(tmp_path):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    name = "franka_msgs/msg/FrankaState"
    definition = "std_msgs/Header header\nfloat64[6] O_F_ext_hat_K\nfloat64[16] O_T_EE\n"
    store.register(get_types_from_msg(definition, name))
    stamps, places, turns, _ = motion()
    with Writer(tmp_path / "arm.bag") as writer:
        to = writer.add_connection("/franka_state", name, typestore=store)
        for k, (stamp, place, turn) in enumerate(zip(stamps, places, turns, strict=True)):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = turn, place
            header = header_of(store, stamp, k, frame="base")
            message = store.types[name](header, np.zeros(6), pose.T.ravel())  # column-major
            writer.write(to, int(stamp), store.serialize_ros1(message, name))
    session = read_session(tmp_path / "arm.bag", ros=RosOptions(tool_tip=TIP))
    np.testing.assert_allclose(session.hip, places + turns @ TIP, atol=1e-12)
    assert session.notes["field"] == "O_T_EE"
    assert len(session.sha256) == 64


def test_a_row_major_matrix_is_refused():
    pose = np.eye(4)
    pose[:3, 3] = 0.3, 0.1, 0.5
    np.testing.assert_array_equal(tip_position(pose.T.ravel(), None, 1.0), pose[:3, 3])
    with refuses(SessionError, "not-a-transform"):
        tip_position(pose.ravel(), None, 1.0)
    read = tip_position(pose.ravel(), None, 1.0, row_major=True)
    np.testing.assert_array_equal(read, pose[:3, 3])


def test_a_quaternion_that_is_not_of_unit_length_is_refused():
    point = SimpleNamespace(x=0.0, y=0.0, z=0.0)
    pose = SimpleNamespace(position=point, orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.0))
    with refuses(SessionError, "quaternion-not-unit"):
        tip_position(pose, np.zeros(3), 1.0)
    assert not tip_position(pose, None, 1.0).any(), "without a tip no turn is needed"


def test_broken_bags_and_options_without_a_bag(tmp_path):
    (tmp_path / "bad.bag").write_bytes(b"#ROSBAG V2.0\nnothing")
    with refuses(SessionError, "bag-broken"):
        read_session(tmp_path / "bad.bag")
    with pytest.raises(SessionError, match="ROS bag"):
        read_session(tmp_path / "missing.bag")
    (tmp_path / "s.csv").write_text("t,x,y,z\n0,1,2,3\n1,2,3,4\n")
    with refuses(SettingError, "ros-options-unused"):
        read_session(tmp_path / "s.csv", ros=RosOptions(topic="/a"))


def test_the_library_is_loaded_for_bags_only(tmp_path):
    (tmp_path / "s.csv").write_text("t,x,y,z\n0,1,2,3\n1,2,3,4\n")
    code = "import sys, vfplan; vfplan.read_session('s.csv'); assert 'rosbags' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)
