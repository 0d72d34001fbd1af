"""A replay or live ticks as Foxglove shows them: frames, fixture, tool, proxy, force, numbers.

The messages are protobuf of Foxglove's own schemas, for which Foxglove and Rerun need no extension:
https://docs.foxglove.dev/docs/sdk/schemas. One table holds the fields, and both the messages and
the descriptors that the file must hold are made of it.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.fixture import Fixture

# Message -> its fields in the order of their numbers, of the types of `KINDS` or a message's name;
# * means repeated. A number alone leaves fields out up to that one.
SCHEMAS: dict[str, str] = {
    "google.protobuf.Timestamp": "seconds:int64 nanos:int32",
    "foxglove.Vector3": "x:double y:double z:double",
    "foxglove.Point3": "x:double y:double z:double",
    "foxglove.Quaternion": "x:double y:double z:double w:double",
    "foxglove.Color": "r:double g:double b:double a:double",
    "foxglove.Pose": "position:foxglove.Vector3 orientation:foxglove.Quaternion",
    "foxglove.ArrowPrimitive": "pose:foxglove.Pose shaft_length:double shaft_diameter:double "
    "head_length:double head_diameter:double color:foxglove.Color",
    "foxglove.SpherePrimitive": "pose:foxglove.Pose size:foxglove.Vector3 color:foxglove.Color",
    "foxglove.LinePrimitive": "type:int32 pose:foxglove.Pose thickness:double 5 "
    "points:foxglove.Point3* color:foxglove.Color",
    "foxglove.TriangleListPrimitive": "pose:foxglove.Pose points:foxglove.Point3* "
    "color:foxglove.Color 5 indices:fixed32*",
    "foxglove.SceneEntity": "timestamp:google.protobuf.Timestamp frame_id:string id:string 7 "
    "arrows:foxglove.ArrowPrimitive* 9 spheres:foxglove.SpherePrimitive* 11 "
    "lines:foxglove.LinePrimitive* triangles:foxglove.TriangleListPrimitive*",
    "foxglove.SceneUpdate": "2 entities:foxglove.SceneEntity*",
    "foxglove.FrameTransform": "timestamp:google.protobuf.Timestamp parent_frame_id:string "
    "child_frame_id:string translation:foxglove.Vector3 rotation:foxglove.Quaternion",
    "foxglove.FrameTransforms": "transforms:foxglove.FrameTransform*",
    "foxglove.PackedElementField": "name:string offset:fixed32 type:int32",
    "foxglove.PointCloud": "timestamp:google.protobuf.Timestamp frame_id:string "
    "pose:foxglove.Pose point_stride:fixed32 fields:foxglove.PackedElementField* data:bytes",
    "vfplan.Numbers": "force_n:double depth_mm:double speed_mm_s:double state:int32 status:int32",
}

# Type -> its number in a descriptor, and the type on the wire.
KINDS = {
    "double": (1, 1), "int64": (3, 0), "int32": (5, 0), "fixed32": (7, 5), "string": (9, 2),
    "bytes": (12, 2),
}  # fmt: skip
MESSAGE = (11, 2)

# Colours as (r, g, b, a), and the length of a newton's arrow [m].
BONE, TOOL = (0.8, 0.2, 0.2, 1), (0.2, 0.4, 0.9, 0.5)
PROXY, PUSH = (0.9, 0.6, 0.1, 1), (0, 0.6, 0, 1)
ARROW_M_PER_N = 0.005

# The pose of what does not move, as place and quaternion x y z w.
STILL = ((0, 0, 0), (0, 0, 0, 1))

# Code of FLOAT32 in `PackedElementField`.
FLOAT32 = 7


def fields_of(name: str) -> dict[str, tuple[int, str, bool]]:
    """Field -> its number, its type, and whether it is repeated."""
    fields, number = {}, 1
    for word in SCHEMAS[name].split():
        if word.isdigit():
            number = int(word)
            continue
        field, _, kind = word.partition(":")
        fields[field] = (number, kind.rstrip("*"), kind.endswith("*"))
        number += 1
    return fields


FIELDS = {name: fields_of(name) for name in SCHEMAS}


def varint(value: int) -> bytes:
    """A whole number as protobuf writes it, seven bits a byte."""
    value %= 2**64
    out = bytearray()
    while value > 127:
        out.append(value % 128 + 128)
        value //= 128
    return bytes([*out, value])


def entry(number: int, wire: int, data: bytes) -> bytes:
    """A field; those of wire type 2 have their length before them."""
    return varint(8 * number + wire) + (varint(len(data)) + data if wire == 2 else data)


def encode(name: str, values: dict[str, Any]) -> bytes:
    """A message; a value that is bytes already is taken as it is."""
    out = b""
    for field, value in values.items():
        number, kind, is_repeated = FIELDS[name][field]
        # Repeated numbers stand in one piece.
        if kind == "fixed32" and is_repeated:
            value, kind, is_repeated = np.asarray(value, "<u4").tobytes(), "bytes", False
        for one in value if is_repeated else [value]:
            out += entry(number, KINDS.get(kind, MESSAGE)[1], encode_value(kind, one))
    return out


def encode_value(kind: str, value: Any) -> bytes:
    """A value of a type; a message is a dictionary, its numbers in order, or bytes already."""
    if kind == "double":
        return struct.pack("<d", value)
    if kind == "fixed32":
        return struct.pack("<I", value)
    if kind in ("int64", "int32"):
        return varint(int(value))
    if isinstance(value, bytes):
        return value
    if isinstance(value, str):
        return value.encode()
    if not isinstance(value, dict):
        value = dict(zip(FIELDS[kind], value, strict=True))
    return encode(kind, value)


def descriptors(name: str) -> bytes:
    """The FileDescriptorSet of a message and of all that it consists of, as protoc writes it."""
    needed = [name]
    for one in needed:
        needed += [k for _, k, _ in FIELDS[one].values() if k in SCHEMAS and k not in needed]
    packages = dict.fromkeys(one.rpartition(".")[0] for one in reversed(needed))
    # A file may use what stands in files before it.
    files, before = b"", b""
    for package in sorted(packages, reverse=True):
        body = entry(1, 2, f"{package}.proto".encode()) + entry(2, 2, package.encode()) + before
        for one in needed:
            if one.rpartition(".")[0] == package:
                body += entry(4, 2, descriptor(one))
        files += entry(1, 2, body + entry(12, 2, b"proto3"))
        before += entry(3, 2, f"{package}.proto".encode())
    return files


def descriptor(name: str) -> bytes:
    """The DescriptorProto of a message."""
    text = entry(1, 2, name.rpartition(".")[2].encode())
    for field, (number, kind, is_repeated) in FIELDS[name].items():
        about = entry(1, 2, field.encode()) + entry(3, 0, varint(number))
        about += entry(4, 0, varint(3 if is_repeated else 1))
        about += entry(5, 0, varint(KINDS.get(kind, MESSAGE)[0]))
        if kind in SCHEMAS:
            about += entry(6, 2, f".{kind}".encode())
        text += entry(2, 2, about)
    return text


# Topic -> its message.
TOPICS = {
    "/vfplan/transforms": "foxglove.FrameTransforms", "/vfplan/fixture": "foxglove.SceneUpdate",
    "/vfplan/points": "foxglove.PointCloud", "/vfplan/scene": "foxglove.SceneUpdate",
    "/vfplan/numbers": "vfplan.Numbers",
}  # fmt: skip


class FoxgloveChannels:
    """Write ticks into an MCAP file as pictures: numbers of each tick, the scene at a rate.

    writer: of the package mcap, started
    fixture: at rest; it is written with the first tick
    """

    def __init__(self, writer: Any, fixture: Fixture, rate_hz: float) -> None:
        self._writer, self._fixture, self._rate_hz = writer, fixture, rate_hz
        self._channels: dict[str, int] = {}
        self._period = self._last = None
        for topic, name in TOPICS.items():
            schema = writer.register_schema(name, "protobuf", descriptors(name))
            self._channels[topic] = writer.register_channel(topic, "protobuf", schema)

    def write(self, tick: NDArray[np.void], stamp_ns: int) -> None:
        """Add a tick of `vfplan.session.bags.TICK`, which was at `stamp_ns` since 1970."""
        stamp = divmod(stamp_ns, 10**9)
        if self._last is None:
            self._add("/vfplan/fixture", {"entities": [self._shape(stamp)]}, stamp_ns)
            self._add("/vfplan/points", self._cloud(stamp), stamp_ns)
        numbers = {
            "force_n": np.linalg.norm(tick["force"]),
            "depth_mm": 1e3 * np.linalg.norm(tick["proxy"] - tick["hip"]),
            "state": tick["state"], "status": tick["status"],
        }  # fmt: skip
        if self._last is not None and tick["t"] > self._last["t"]:
            way_mm = 1e3 * np.linalg.norm(tick["hip"] - self._last["hip"])
            numbers["speed_mm_s"] = way_mm / (tick["t"] - self._last["t"])
        self._last = tick
        self._add("/vfplan/numbers", numbers, stamp_ns)

        period = np.floor(tick["t"] * self._rate_hz + 1e-6)
        if period == self._period:
            return
        self._period = period
        frame = self._fixture.frame
        places = {"vfplan_tool": tick["hip"], "vfplan_proxy": tick["proxy"]}
        frames = [(stamp, frame, name, place, (0, 0, 0, 1)) for name, place in places.items()]
        self._add("/vfplan/transforms", {"transforms": frames}, stamp_ns)
        radius_m = self._fixture.contact_radius
        balls = [ball(tick["hip"], radius_m, TOOL), ball(tick["proxy"], radius_m / 4, PROXY)]
        entity = {"timestamp": stamp, "frame_id": frame, "id": "tool", "spheres": balls}
        if numbers["force_n"] > 0:
            entity["arrows"] = [arrow(tick["hip"], tick["force"], radius_m)]
        self._add("/vfplan/scene", {"entities": [entity]}, stamp_ns)

    def _add(self, topic: str, values: dict[str, Any], stamp_ns: int) -> None:
        data = encode(TOPICS[topic], values)
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns)

    def _shape(self, stamp: tuple[int, int]) -> dict[str, Any]:
        """The fixture's triangles, or its lines; a bare cloud has none, and shows as points."""
        entity = {"timestamp": stamp, "frame_id": self._fixture.frame, "id": "fixture"}
        if self._fixture.mesh is not None:
            body = {"points": list(self._fixture.points), "indices": self._fixture.mesh.ravel()}
            entity["triangles"] = [body | {"pose": STILL, "color": BONE}]
            return entity
        entity["lines"] = []
        for stroke in self._fixture.strokes:
            # 0: a strip, 1: a loop
            line = {"type": int(stroke.closed), "pose": STILL, "thickness": 0.001, "color": BONE}
            entity["lines"].append(line | {"points": list(stroke.points)})
        return entity

    def _cloud(self, stamp: tuple[int, int]) -> dict[str, Any]:
        fields = [(name, 4 * k, FLOAT32) for k, name in enumerate("xyz")]
        data = self._fixture.points.astype("<f4").tobytes()
        values = (stamp, self._fixture.frame, STILL, 12, fields, data)
        return dict(zip(FIELDS["foxglove.PointCloud"], values, strict=True))


def ball(place: NDArray[np.float64], radius_m: float, colour: tuple[float, ...]) -> Any:
    """A sphere."""
    return {"pose": (place, (0, 0, 0, 1)), "size": 3 * [2 * radius_m], "color": colour}


def arrow(place: NDArray[np.float64], force: NDArray[np.float64], width_m: float) -> Any:
    """The arrow of a force; an arrow without rotation points along x."""
    force_n = np.linalg.norm(force)
    x, y, z = force / force_n
    # The shortest turn from x; the one to -x is about any axis across it.
    turn = np.array([0.0, -z, y, 1.0 + x]) if x > -0.999999 else np.array([0.0, 0.0, 1.0, 0.0])
    length_m = ARROW_M_PER_N * force_n
    return {
        "pose": (place, turn / np.linalg.norm(turn)),
        "shaft_length": 0.7 * length_m, "shaft_diameter": 0.4 * width_m,
        "head_length": 0.3 * length_m, "head_diameter": 0.8 * width_m, "color": PUSH,
    }  # fmt: skip
