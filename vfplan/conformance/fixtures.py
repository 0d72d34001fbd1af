"""The small fixtures from which the conformance kit's files are made, and a small writer of HDF5.

It writes what docs/format.md allows, byte by byte and without libhdf5, so that the kit's files
depend on no library's version. It can also write what a bundle must not hold: a vector changes the
`Item`s before they are laid out.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np

from vfplan._core import lookup3
from vfplan.bundle.content import Content, review_digest, rows_of
from vfplan.bundle.write import as_stored, unit_and_frame
from vfplan.findings import doubt, note
from vfplan.fixture import (
    Curve,
    Fixture,
    Guidance,
    Pieces,
    Provenance,
    RegistrationRecord,
    Rendering,
    Review,
    SourceImage,
)

TIME = "2026-01-02T03:04:05Z"
AXIS = np.array([0.0, 0.0, 1.0])


def minimal() -> Fixture:
    """Six points, nothing optional."""
    points = np.array([[0.4 + 0.004 * i, 0.0, 0.1] for i in range(6)])
    return Fixture("robot_base", points, Provenance(created_utc=TIME, software="kit 1"))


def cloud() -> Fixture:
    """The same as a bare cloud that is rendered."""
    rendering = Rendering(np.array([1000.0, 1000.0, 800.0]), contact_radius=0.005, band=1e-5)
    return replace(minimal(), rendering=rendering)


def curve() -> Fixture:
    """An open and a closed stroke with every table of a curve."""
    base = cloud()
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]]) * 1e-3 + [0.45, 0.02]
    points = np.vstack([base.points, np.column_stack([square, np.full(4, 0.1)])])
    row = np.arange(10)
    stroke = np.repeat([0, 1], [6, 4]).astype(np.int32)
    return replace(
        base,
        points=points,
        sigma=np.full(10, 1e-5),
        curve=Curve(stroke, np.array([False, True]), bridged=row == 3, edited=row == 4),
        rendering=replace(base.rendering, ignore_axis=AXIS),
        provenance=replace(
            base.provenance,
            inputs={"image": "ab" * 32, "markers": "cd" * 32},
            settings={"method": "ridge", "tolerance_m": 1e-5, "robust": False},
            history=("2026-01-01T00:00:00Z made up",),
        ),
    )


def registered() -> Fixture:
    """The curve, mapped from a slice whose plane is that of the points."""
    T = np.array([[5e-4, 0, 0.25], [0, -5e-4, 0.31], [0, 0, 0.1]])
    source = np.array([[100.0, 100.0], [700.0, 100.0], [100.0, 700.0], [700.0, 700.0]])
    mapped = np.column_stack([source, np.ones(4)]) @ T.T
    target = mapped + np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]) * 2.0**-12
    residuals = np.linalg.norm(target - mapped, axis=1)
    record = RegistrationRecord(
        "affine", "image", T, ("a", "b", "c", "d"), source, target, residuals,
        fre_rms_m=2.0**-12, loo_rms_m=5e-4, tre_rms_m=2e-4,
        covariance=np.diag(np.full(9, 1e-12)), tre_m=np.full(10, 2e-4),
    )  # fmt: skip
    return replace(curve(), registration=record, image=SourceImage(871, 786, (0.5, 0.5)))


def touched() -> Fixture:
    """The same, whose markers a known tool touched."""
    tip = np.array([0.0, 0.0, 0.125])
    made = registered()
    return replace(made, registration=replace(made.registration, tool="probe 1", tip=tip))


def navigated() -> Fixture:
    """A cloud that came from a navigation system's axes."""
    T = np.eye(4)
    T[:3, 3] = (0.5, -0.25, 0.125)
    source = np.array([[0.0, 0, 0], [0.125, 0, 0], [0, 0.125, 0], [0, 0, 0.125]])
    record = RegistrationRecord(
        "rigid", "patient_lps", T, ("a", "b", "c", "d"), source, source + T[:3, 3], np.zeros(4), 0.0
    )
    return replace(cloud(), registration=record)


def pixels() -> Fixture:
    """A curve on a slice, not registered yet."""
    points = np.array([[300.0 + 3 * i, 400.0, 0.0] for i in range(10)])
    image = SourceImage(871, 786, None)
    return replace(curve(), frame="image", points=points, rendering=None, image=image)


def patient() -> Fixture:
    """A cloud in the patient's axes."""
    return replace(cloud(), frame="patient_lps")


def mesh(side: int = 3) -> Fixture:
    """A square sheet of `side` points a side, 3 mm apart; each square is two triangles."""
    x, y = np.meshgrid(np.arange(side) * 0.003, np.arange(side) * 0.003)
    points = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + side])
    upper = np.column_stack([corner + 1, corner + side + 1, corner + side])
    return replace(cloud(), points=points, mesh=np.vstack([lower, upper]).astype(np.int32))


def drawn_mesh() -> Fixture:
    """Two triangles of 24 mm as they were drawn, to be sampled where points are rendered."""
    corners = 0.024 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)
    triangles = np.array([[0, 1, 2], [1, 3, 2]], dtype=np.int32)
    return replace(cloud(), points=corners, mesh=triangles, sample_radius=0.0015)


def pieces(line: int = 10, arc: int = 7, circle: int = 16) -> Fixture:
    """A line that goes on in a quarter circle, and a circle, with as many points on each."""
    along = np.linspace(0.40, 0.43, line + 1)[:-1]
    quarter = np.linspace(-np.pi / 2, 0, arc)
    ring = np.linspace(0, 2 * np.pi, circle, endpoint=False)
    x = np.concatenate([along, 0.43 + 0.01 * np.cos(quarter), 0.46 + 0.008 * np.cos(ring)])
    y = np.concatenate([0 * along, 0.01 + 0.01 * np.sin(quarter), 0.04 + 0.008 * np.sin(ring)])
    vertices = [(0.40, 0), (0.43, 0), (0.44, 0.01), (0.468, 0.04), (0.452, 0.04)]
    closed = np.array([False, True])
    drawn = Pieces(
        vertices=np.array([(*vertex, 0.1) for vertex in vertices]),
        bulges=np.array([0, np.tan(np.pi / 8), 0, 1, 1]),
        stroke=np.array([0, 0, 0, 1, 1], np.int32),
        closed=closed,
        error=1e-9,
    )
    stroke = np.repeat([0, 1], [line + arc, circle]).astype(np.int32)
    return replace(
        cloud(),
        points=np.column_stack([x, y, np.full_like(x, 0.1)]),
        curve=Curve(stroke, closed, pieces=drawn),
        rendering=replace(cloud().rendering, ignore_axis=AXIS),
    )


def mirrored_pieces() -> Fixture:
    """The same seen in a mirror: all arcs turn right."""
    base = pieces()
    mirror = np.array([1.0, -1.0, 1.0])
    bulges = 0.0 - base.pieces.bulges
    drawn = replace(base.pieces, vertices=base.pieces.vertices * mirror, bulges=bulges)
    return replace(base, points=base.points * mirror, curve=replace(base.curve, pieces=drawn))


def guided() -> Fixture:
    """The curve, whose closed stroke guides and whose open one is forbidden."""
    return replace(curve(), guidance=Guidance(radius=1e-3, stiffness=800.0, ends="stop", stroke=1))


def findings() -> Fixture:
    """The registered curve with an answered doubt, an open one and a note."""
    suspect = doubt("marker-suspect", "register", "Marker b is far away.")
    found = (
        doubt("end-other-colour", "extract", "Other ink lies here.", place_px=(318.5, 400.0)),
        note("bridge-short", "plan", "A gap was bridged.", place_m=(0.41, 0.0, 0.1)),
        replace(suspect, answered_by="A. Planner", answered_utc=TIME),
    )
    return replace(registered(), findings=found)


def reviewed() -> Fixture:
    """The registered curve, approved by a person."""
    return approved(registered())


def approved(fixture: Fixture) -> Fixture:
    """The fixture with the review of a person who approved it as it is."""
    return replace(fixture, reviewed=Review("A. Planner", TIME, review_digest(fixture)))


def of_a_case() -> Fixture:
    """The sheet for a case, approved."""
    return approved(replace(mesh(), case="case 18"))


# HDF5's address of nothing: all 64 bits are set.
UNDEFINED = int(np.iinfo(np.uint64).max)
DATATYPES = {
    "f8": bytes.fromhex("11203f000800000000004000340b0034ff030000"),
    "i4": bytes.fromhex("100800000400000000002000"),
    "u1": bytes.fromhex("100000000100000000000800"),
}


class MessageType(IntEnum):
    """The types of an object header's messages that a bundle holds."""

    DATASPACE = 0x01
    LINK_INFO = 0x02
    DATATYPE = 0x03
    FILL = 0x05
    LINK = 0x06
    LAYOUT = 0x08
    GROUP_INFO = 0x0A
    ATTRIBUTE = 0x0C


@dataclass
class Item:
    """A group, or a dataset (`data` is not `None`), before it has a place in the file."""

    # Name -> (datatype, dataspace, value).
    attributes: dict[bytes, tuple[bytes, bytes, bytes]] = field(default_factory=dict)
    # Name -> path of an item, or the body of a link message as it is.
    links: dict[bytes, str | bytes] = field(default_factory=dict)
    datatype: bytes = b""
    dataspace: bytes = b""
    data: bytes | None = None
    # Address to write in place of the true one, or the path of the item whose data to name.
    data_at: int | str | None = None
    layout: bytes = b"\x03\x01"
    fill: bytes = b"\x03\x06"
    # Further messages: (kind, body).
    more: list[tuple[int, bytes]] = field(default_factory=list)
    # Flags of the datatype's message; 2 says that it is shared.
    flags: int = 0


# Path -> its item.
Items = dict[str, Item]


def text_type(size: int, padding: int = 1) -> bytes:
    """The datatype of a text of `size` bytes in UTF-8; padding 1: NUL, 2: blanks."""
    return struct.pack("<BBBBI", 0x13, padding | 0x10, 0, 0, size)


def space_of(shape: tuple[int, ...]) -> bytes:
    """The dataspace of an array; () is a scalar."""
    is_simple = len(shape) > 0
    return struct.pack(f"<BBBB{len(shape)}Q", 2, len(shape), 0, is_simple, *shape)


def stored(value: object, kind: str) -> tuple[bytes, bytes, bytes]:
    """(datatype, dataspace, bytes) of a value of the table's type `kind`."""
    data = as_stored(value, kind)
    datatype = text_type(data.itemsize) if kind == "text" else DATATYPES[kind]
    return datatype, space_of(data.shape), data.tobytes()


def items_of(content: Content) -> Items:
    """The groups and datasets of a content by their paths, the root first."""
    items = {"/": Item()}
    for row in rows_of(content):
        if row.kind == "group":
            add(items, row.path, Item())
        elif row.kind == "attribute":
            items[row.parent].attributes[row.name.encode()] = stored(content[row.path], row.type)
        else:
            item = Item({}, {}, *stored(content[row.path], row.type))
            for name, text in unit_and_frame(row, content).items():
                item.attributes[name.encode()] = stored(text, "text")
            add(items, row.path, item)
    return items


def add(items: Items, path: str, item: Item) -> None:
    """Put an item under its path, and a link to it into its group."""
    parent, _, name = path.rpartition("/")
    items[path] = item
    items[parent or "/"].links[name.encode()] = path


def to_payload(items: Items) -> bytes:
    """The HDF5 file of these items, up to a multiple of 8 bytes; its end of file is to be set."""
    headers, data, at = {}, {}, 48
    for path, item in items.items():
        headers[path] = at
        at += len(padded(header_of(item, dict.fromkeys(items, 0), 0)))
    for path, item in items.items():
        data[path] = at if item.data else UNDEFINED
        at += len(padded(item.data or b""))
    head = b"\x89HDF\r\n\x1a\n", 2, 8, 8, 0, 0, UNDEFINED, at, headers["/"]
    payload = padded(struct.pack("<8sBBBBQQQQ", *head))
    for path, item in items.items():
        stated = item.data_at or path
        payload += padded(header_of(item, headers, data.get(stated, stated)))
    return checked(payload + b"".join(padded(item.data or b"") for item in items.values()))


def padded(data: bytes) -> bytes:
    """The bytes, filled with zeros to a multiple of 8."""
    return data + bytes(-len(data) % 8)


def checked(payload: bytes) -> bytes:
    """The payload with its superblock's checksum made anew."""
    return payload[:44] + struct.pack("<I", lookup3(payload[:44])) + payload[48:]


def link(name: bytes, address: int) -> bytes:
    """The body of a hard link's message."""
    return struct.pack("<BBBB", 1, 0x10, 1, len(name)) + name + struct.pack("<Q", address)


def soft_link(name: bytes, target: bytes) -> bytes:
    """The body of a soft link's message, which no bundle holds."""
    head = struct.pack("<BBBBB", 1, 0x18, 1, 1, len(name))
    return head + name + struct.pack("<H", len(target)) + target


def attribute(name: bytes, datatype: bytes, dataspace: bytes, value: bytes) -> bytes:
    """The body of an attribute's message."""
    sizes = struct.pack("<BBHHHB", 3, 0, len(name) + 1, len(datatype), len(dataspace), 1)
    return sizes + name + b"\0" + datatype + dataspace + value


def header_of(item: Item, addresses: dict[str, int], data_at: int) -> bytes:
    """The object header of an item whose data lie at `data_at`."""
    if item.data is None:
        links = struct.pack("<BBQQ", 0, 0, UNDEFINED, UNDEFINED)
        messages = [(MessageType.LINK_INFO, 0, links), (MessageType.GROUP_INFO, 0, b"\0\0")]
    else:
        messages = [
            (MessageType.DATASPACE, 0, item.dataspace),
            (MessageType.DATATYPE, 1 | item.flags, item.datatype),
            (MessageType.FILL, 1, item.fill),
            (MessageType.LAYOUT, 0, item.layout + struct.pack("<QQ", data_at, len(item.data))),
        ]
    for name, stored_value in item.attributes.items():
        messages.append((MessageType.ATTRIBUTE, 0, attribute(name, *stored_value)))
    for name, target in item.links.items():
        body = target if isinstance(target, bytes) else link(name, addresses[target])
        messages.append((MessageType.LINK, 0, body))
    messages += [(kind, 0, body) for kind, body in item.more]
    body = b"".join(struct.pack("<BHB", k, len(b), f) + b for k, f, b in messages)
    header = b"OHDR\x02\x02" + struct.pack("<I", len(body)) + body
    return header + struct.pack("<I", lookup3(header))


def floats(values: object) -> bytes:
    """Numbers as the bytes of `f8`."""
    return np.asarray(values, "<f8").tobytes()
