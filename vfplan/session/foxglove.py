"""A replay or live ticks as Foxglove shows them: frames, fixture, tool, proxy, force, numbers.

The messages have Foxglove's own schemas, for which Foxglove and Rerun need no extension:
https://docs.foxglove.dev/docs/sdk/schemas. The numbers are a ROS 2 message, as the ticks are.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from foxglove import messages as fg
from numpy.typing import NDArray

from vfplan.fixture import Fixture
from vfplan.geometry.lines import Array
from vfplan.session.channels import CDR_LITTLE_ENDIAN

BONE = fg.Color(r=0.8, g=0.2, b=0.2, a=1.0)
TOOL = fg.Color(r=0.2, g=0.4, b=0.9, a=0.5)
PROXY = fg.Color(r=0.9, g=0.6, b=0.1, a=1.0)
PUSH = fg.Color(r=0.0, g=0.6, b=0.0, a=1.0)

# Length of the arrow of a newton [m].
ARROW_M_PER_N = 0.005

# Thickness of a drawn line [m].
LINE_M = 0.001

# Topic -> its message.
TOPICS = {
    "/vfplan/transforms": fg.FrameTransforms, "/vfplan/fixture": fg.SceneUpdate,
    "/vfplan/points": fg.PointCloud, "/vfplan/scene": fg.SceneUpdate,
}  # fmt: skip

NUMBERS = "/vfplan/numbers"

# The numbers of a tick as a ROS 2 message, and the same for `struct`.
DEFINITION = b"""# The speed of the first tick is NaN.
float64 force_n
float64 depth_mm
float64 speed_mm_s
int8 state
uint8 status
"""
LAYOUT = struct.Struct("<dddbB")


class FoxgloveChannels:
    """Write ticks into an MCAP file as pictures: numbers of each tick, the scene at a rate.

    writer: of the package mcap, started
    fixture: at rest; it is written with the first tick
    """

    def __init__(self, writer: Any, fixture: Fixture, rate_hz: float) -> None:
        self._writer, self._fixture, self._rate_hz = writer, fixture, rate_hz
        self._period = self._last = None
        schema = writer.register_schema("vfplan_msgs/msg/Numbers", "ros2msg", DEFINITION)
        self._channels = {NUMBERS: writer.register_channel(NUMBERS, "cdr", schema)}
        for topic, message in TOPICS.items():
            described = message.get_schema()
            schema = writer.register_schema(described.name, described.encoding, described.data)
            self._channels[topic] = writer.register_channel(topic, "protobuf", schema)

    def write(self, tick: NDArray[np.void], stamp_ns: int) -> None:
        """Add a tick of `vfplan.session.bags.TICK`, which was at `stamp_ns` since 1970."""
        stamp = fg.Timestamp(*divmod(stamp_ns, 10**9))
        if self._last is None:
            shape = fg.SceneUpdate(entities=[self._shape(stamp)])
            self._add("/vfplan/fixture", shape.encode(), stamp_ns)
            self._add("/vfplan/points", self._cloud(stamp).encode(), stamp_ns)
        force_n = float(np.linalg.norm(tick["force"]))
        speed_mm_s = np.nan
        if self._last is not None and tick["t"] > self._last["t"]:
            way_mm = 1e3 * np.linalg.norm(tick["hip"] - self._last["hip"])
            speed_mm_s = way_mm / (tick["t"] - self._last["t"])
        self._last = tick
        depth_mm = 1e3 * np.linalg.norm(tick["proxy"] - tick["hip"])
        numbers = LAYOUT.pack(force_n, depth_mm, speed_mm_s, tick["state"], tick["status"])
        self._add(NUMBERS, CDR_LITTLE_ENDIAN + numbers, stamp_ns)

        period = np.floor(tick["t"] * self._rate_hz + 1e-6)
        if period == self._period:
            return
        self._period = period
        frame, radius_m = self._fixture.frame, self._fixture.contact_radius
        transforms = [
            fg.FrameTransform(
                timestamp=stamp, parent_frame_id=frame, child_frame_id=name,
                translation=vector(place), rotation=fg.Quaternion(w=1.0),
            )
            for name, place in {"vfplan_tool": tick["hip"], "vfplan_proxy": tick["proxy"]}.items()
        ]  # fmt: skip
        moved = fg.FrameTransforms(transforms=transforms)
        self._add("/vfplan/transforms", moved.encode(), stamp_ns)
        tool = fg.SceneEntity(
            timestamp=stamp, frame_id=frame, id="tool",
            spheres=[ball(tick["hip"], radius_m, TOOL), ball(tick["proxy"], radius_m / 4, PROXY)],
            arrows=[arrow(tick["hip"], tick["force"], radius_m)] if force_n > 0 else [],
        )  # fmt: skip
        self._add("/vfplan/scene", fg.SceneUpdate(entities=[tool]).encode(), stamp_ns)

    def _add(self, topic: str, data: bytes, stamp_ns: int) -> None:
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns)

    def _shape(self, stamp: fg.Timestamp) -> fg.SceneEntity:
        """The fixture's triangles, or its lines; a bare cloud has none, and shows as points."""
        if self._fixture.mesh is not None:
            triangles = fg.TriangleListPrimitive(
                points=corners(self._fixture.points), indices=self._fixture.mesh.ravel().tolist(),
                pose=pose(), color=BONE,
            )  # fmt: skip
            bodies = {"triangles": [triangles]}
        else:
            kinds = (fg.LinePrimitiveLineType.LineStrip, fg.LinePrimitiveLineType.LineLoop)
            bodies = {"lines": [
                fg.LinePrimitive(
                    type=kinds[stroke.closed], points=corners(stroke.points), thickness=LINE_M,
                    pose=pose(), color=BONE,
                )
                for stroke in self._fixture.strokes
            ]}  # fmt: skip
        return fg.SceneEntity(timestamp=stamp, frame_id=self._fixture.frame, id="fixture", **bodies)

    def _cloud(self, stamp: fg.Timestamp) -> fg.PointCloud:
        kind, make = fg.PackedElementFieldNumericType.Float32, fg.PackedElementField
        fields = [make(name=name, offset=4 * k, type=kind) for k, name in enumerate("xyz")]
        return fg.PointCloud(
            timestamp=stamp, frame_id=self._fixture.frame, pose=pose(),
            point_stride=12, fields=fields, data=self._fixture.points.astype("<f4").tobytes(),
        )  # fmt: skip


def vector(place: Any) -> fg.Vector3:
    """A place as Foxglove has it."""
    x, y, z = map(float, place)
    return fg.Vector3(x=x, y=y, z=z)


def corners(points: Array) -> list[fg.Point3]:
    """Points (N, 3) as Foxglove has them."""
    return [fg.Point3(x=x, y=y, z=z) for x, y, z in points.tolist()]


def pose(place: Any = (0.0, 0.0, 0.0), turn: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)) -> fg.Pose:
    """A place, and a unit quaternion x y z w."""
    x, y, z, w = turn
    return fg.Pose(position=vector(place), orientation=fg.Quaternion(x=x, y=y, z=z, w=w))


def ball(place: Array, radius_m: float, colour: fg.Color) -> fg.SpherePrimitive:
    """A sphere."""
    return fg.SpherePrimitive(pose=pose(place), size=vector([2 * radius_m] * 3), color=colour)


def arrow(place: Any, force: Array, width_m: float) -> fg.ArrowPrimitive:
    """The arrow of a force; an arrow without rotation points along x."""
    force_n = float(np.linalg.norm(force))
    x, y, z = force / force_n
    # The shortest turn from x; the one to -x is about any axis across it.
    turn = np.array([0.0, -z, y, 1.0 + x]) if x > -0.999999 else np.array([0.0, 0.0, 1.0, 0.0])
    turn /= np.linalg.norm(turn)
    length_m = ARROW_M_PER_N * force_n
    return fg.ArrowPrimitive(
        pose=pose(place, tuple(turn.tolist())), shaft_length=0.7 * length_m,
        shaft_diameter=0.4 * width_m, head_length=0.3 * length_m, head_diameter=0.8 * width_m,
        color=PUSH,
    )  # fmt: skip
