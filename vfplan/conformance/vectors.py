"""The files that break one rule of docs/format.md each, and what is wrong with them.

Each is a row of a table: the rule, the name, what is wrong, the function that makes the file, and
what to call it with.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from vfplan.bundle import seal
from vfplan.bundle.content import Content, to_content
from vfplan.bundle.write import completed
from vfplan.conformance import fixtures
from vfplan.conformance.fixtures import Item, Items, MessageType, add, space_of

# Length of a seal with short texts [bytes].
SEAL = seal.LENGTHS[0]


# --- Sound contents, items, payloads and files --------------------------------------------------


def content_of(name: str) -> Content:
    """The complete content of a fixture, to be changed."""
    return completed(to_content(getattr(fixtures, name)()))


def items(name: str) -> Items:
    """The items of a fixture, to be changed; "later": of a later minor version.

    That file is sound, and has parts that this version does not know.
    """
    if name != "later":
        return fixtures.items_of(content_of(name))
    later = fixtures.items_of(content_of("curve") | {"/@version": "2.9"})
    add(later, "/surprise", floats(1.0, 2.0))
    later["/points"].attributes[b"colour"] = fixtures.stored("red", "text")
    return later


def floats(*values: float) -> Item:
    """A dataset of numbers, without unit and frame."""
    return Item(datatype=F8, dataspace=space_of((len(values),)), data=fixtures.floats(values))


def payload_of(name: str, more: bytes = b"") -> bytes:
    """The payload of a fixture, with more bytes behind it, stating the end of the whole file."""
    payload = fixtures.to_payload(items(name)) + more
    return seal.with_end_of_file(payload, len(payload) + SEAL)


def sealed_as_it_is(payload: bytes) -> bytes:
    """A payload under a seal, its superblock left alone."""
    return payload + seal.seal_of(payload)


def of_content(content: Content) -> bytes:
    """The bundle of a content, whatever it is."""
    return of_items(fixtures.items_of(content))


def of_items(items: Items) -> bytes:
    """The bundle of items, whatever they are."""
    return b"".join(seal.sealed_file(fixtures.to_payload(items)))


def sound_file() -> bytes:
    """The bundle of the minimal fixture."""
    return of_items(items("minimal"))


# Seed of the key with which the kit is signed: no secret.
KIT_SEED = bytes(32)


def key_of(seed: bytes) -> Any:
    """The private Ed25519 key that this seed gives."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    return Ed25519PrivateKey.from_private_bytes(seed)


def signed(
    name: str, despite_findings: bool, seed: bytes = KIT_SEED, domain: bytes = seal.DOMAIN
) -> bytes:
    """A fixture signed by the key of a seed; `domain` are the first bytes that are signed."""
    payload = payload_of(name)
    return payload + seal.seal_of(
        payload, key_of(seed), case="case 17", robot_serial="R-0042", signed_at=1_767_323_045,
        despite_findings=despite_findings, domain=domain,
    )  # fmt: skip


# --- Changes of a content -----------------------------------------------------------------------


def with_values(content: Content, values: Content) -> Content:
    """A content with other values; a function makes the new value of the old one.

    `None` takes out every path that begins so.
    """
    for path, value in values.items():
        if value is None:
            content = {kept: old for kept, old in content.items() if not kept.startswith(path)}
        else:
            content[path] = value(content[path]) if callable(value) else value
    return content


def put(place: Any, value: Any) -> Callable[[np.ndarray], np.ndarray]:
    """A change of an array: another value at a place."""
    return lambda array: replaced(array, place, value)


def moved(place: Any, step: float) -> Callable[[np.ndarray], np.ndarray]:
    """A change of an array: the values at a place are larger by a step."""
    return lambda array: replaced(array, place, array[place] + step)


def replaced(array: np.ndarray, place: Any, value: Any) -> np.ndarray:
    """A copy of an array with another value at a place."""
    changed = array.copy()
    changed[place] = value
    return changed


def changed(name: str, values: Content) -> bytes:
    """The bundle of a fixture that was changed after its id and certificate were made."""
    return of_content(with_values(content_of(name), values))


def remade(name: str, values: Content, stated: Content | None = None) -> bytes:
    """The bundle of a fixture that was changed before its id and certificate were made.

    `stated` are values that stand in place of those that were made.
    """
    return of_content(completed(with_values(content_of(name), values)) | (stated or {}))


def verdict(stiffness: float, max_stiffness: float) -> Content:
    """A robot's stability verdict about a stiffness [N/m], of which twice must be stable."""
    numbers = np.array([4.0, 20.0, 1000.0, 1.0, stiffness, max_stiffness, 2.0])
    return {"/rendering@robot": "arm", "/rendering/stability": numbers}


def rendering_of_a_slice() -> bytes:
    """A slice's curve with the rendering and certificate of one in front of a robot."""
    rendered = {
        path: value
        for path, value in content_of("curve").items()
        if path.startswith(("/rendering", "/leak")) and path != "/leak/open_ends"
    }
    return changed("pixels", rendered)


def transform_to_a_line() -> bytes:
    """The registered curve, its residuals those of the new transform."""
    content = content_of("registered")
    T = content["/registration/T_robot_image"].copy()
    T[:, 1] = T[:, 0]
    mapped = np.column_stack([content["/registration/source"], np.ones(4)]) @ T.T
    residuals = np.linalg.norm(mapped - content["/registration/target"], axis=1)
    values = {"/registration/T_robot_image": T, "/registration/residuals": residuals}
    return changed("registered", values)


def triangle_beyond_the_points() -> bytes:
    """The sheet, with the id of the new triangles and the certificate of the old ones."""
    content = content_of("mesh")
    certificate = {path: value for path, value in content.items() if path.startswith("/leak")}
    return remade("mesh", {"/mesh/triangles": put((0, 0), 9)}, certificate)


def pieces_with_a_corner(aside: float, bulge: float = 0.0) -> bytes:
    """The pieces with one corner more, between the second and the third point.

    The corner lies `aside` from the line [m]; the piece to it has this bulge.
    """
    content = content_of("pieces")
    points, vertices = content["/points"], content["/pieces/vertices"]
    corner = (points[1] + points[2]) / 2 + [0.0, aside, 0.0]
    rows = np.insert(vertices, 1, [points[1], corner, points[2]], axis=0)
    bulges = np.insert(content["/pieces/bulges"], 1, [bulge, 0.0, 0.0])
    stroke = np.insert(content["/pieces/stroke"], 1, [0, 0, 0])
    values = {"/pieces/vertices": rows, "/pieces/bulges": bulges, "/pieces/stroke": stroke}
    return remade("pieces", values)


def answered_after_the_review() -> bytes:
    """The approved curve with findings, of which one more was answered afterwards."""
    approved = fixtures.approved(fixtures.findings())
    answers = {"/findings/answered_by": ("A. Planner", "", "A. Planner"),
               "/findings/answered_utc": (fixtures.TIME, "", fixtures.TIME)}  # fmt: skip
    return of_content(with_values(completed(to_content(approved)), answers))


# --- Changes of items ---------------------------------------------------------------------------


def with_fields(name: str, path: str, fields: dict[str, Any]) -> bytes:
    """The bundle of a fixture with other fields of one item."""
    changed_items = items(name)
    changed_items[path] = replace(changed_items[path], **fields)
    return of_items(changed_items)


def with_message(name: str, path: str, kind: int, body: bytes) -> bytes:
    """The bundle of a fixture with one more message in the header of an item."""
    return with_fields(name, path, {"more": [(kind, body)]})


def with_attribute(name: str, path: str, key: str, value: str | tuple | None) -> bytes:
    """The bundle of a fixture with an attribute, a text or (datatype, dataspace, bytes).

    `None` takes it out.
    """
    changed_items = items(name)
    attributes = changed_items[path].attributes
    attributes[key.encode()] = fixtures.stored(value, "text") if isinstance(value, str) else value
    if value is None:
        del attributes[key.encode()]
    return of_items(changed_items)


def with_item(name: str, path: str, item: Item) -> bytes:
    """The bundle of a fixture with one more item, or another one in its place."""
    changed_items = items(name)
    add(changed_items, path, item)
    return of_items(changed_items)


def with_link(name: str, path: str, target: str | bytes | None) -> bytes:
    """The bundle of a fixture with a link in place of an item; `None`: with nothing there."""
    changed_items = items(name)
    changed_items.pop(path, None)
    group, _, link = path.rpartition("/")
    links = changed_items[group or "/"].links
    links.pop(link.encode(), None)
    if target is not None:
        links[link.encode()] = target
    return of_items(changed_items)


# --- Changes of bytes ---------------------------------------------------------------------------


def with_superblock(at: int, value: bytes) -> bytes:
    """The minimal fixture with other bytes in its superblock, whose checksum is made anew."""
    payload = payload_of("minimal")
    payload = payload[:at] + value + payload[at + len(value) :]
    return sealed_as_it_is(fixtures.checked(payload))


def flipped(data: bytes, at: int) -> bytes:
    """The bytes with another bit in one of them."""
    return replaced(np.frombuffer(data, np.uint8), at, data[at] ^ 1).tobytes()


def with_flipped_bit(at: int) -> bytes:
    """The minimal fixture with another bit in a byte of its payload."""
    return sealed_as_it_is(flipped(payload_of("minimal"), at))


def header_checksum() -> bytes:
    """The checksum stands behind the messages, whose length begins at byte 54."""
    return with_flipped_bit(58 + struct.unpack_from("<I", payload_of("minimal"), 54)[0])


def end_of_file_before_the_seal() -> bytes:
    """The end of file is that of a file without a seal."""
    payload = payload_of("minimal")
    return sealed_as_it_is(seal.with_end_of_file(payload, len(payload)))


def with_more_bytes(more: bytes) -> bytes:
    """The minimal fixture with more bytes behind its last object."""
    return sealed_as_it_is(payload_of("minimal", more))


def with_seal(at: int, value: bytes, data: bytes | None = None) -> bytes:
    """A bundle with other bytes in its seal, whose own digest is made anew."""
    if data is None:
        data = sound_file()
    block = bytearray(data[-SEAL:])
    block[at : at + len(value)] = value
    block[-48:-16] = hashlib.sha256(block[:-48]).digest()
    return data[:-SEAL] + bytes(block)


def reviewed_with_seal(at: int, value: bytes, seed: bytes = KIT_SEED) -> bytes:
    """The reviewed fixture, with other bytes in its seal since it was signed."""
    return with_seal(at, value, signed("reviewed", False, seed))


F8, I4 = fixtures.DATATYPES["f8"], fixtures.DATATYPES["i4"]
SCALAR = space_of(())
GROWING = struct.pack("<BBBBQQQQ", 2, 2, 1, 1, 6, 3, 7, 3)
SOFTWARE = ("minimal", "/provenance", "software")
SECOND_SOFTWARE = fixtures.attribute(b"software", *fixtures.stored("kit 2", "text"))
# Seed of a key that nobody trusts.
OTHER_SEED = b"\x01" * 32

Rows = tuple[tuple[Any, ...], ...]
# fmt: off
VECTORS: Rows = (
    # The file.
    ("L1", "superblock_of_version_3", "The superblock has version 3.", with_superblock, 8, b"\x03"),
    ("L1", "superblock_with_a_flag", "A flag of the superblock is set.",
     with_superblock, 11, b"\x01"),
    ("L1", "base_address_512", "The base address is 512.",
     with_superblock, 12, struct.pack("<Q", 512)),
    ("L1", "superblock_extension", "The superblock names an extension.",
     lambda: with_superblock(20, payload_of("minimal")[36:44])),
    ("L2", "end_of_file_before_the_seal",
     "The end of file is that of the payload, before the seal.", end_of_file_before_the_seal),
    ("L2", "superblock_checksum", "The superblock's checksum is wrong.", with_flipped_bit, 44),
    ("L3", "header_checksum", "The checksum of the root's header is wrong.", header_checksum),
    ("L3", "comment_message", "A header holds a message of another kind, a comment.",
     with_message, "minimal", "/points", 0x0D, b"hidden\0"),
    ("L3", "shared_message", "A datatype's message is shared.",
     with_fields, "minimal", "/points", {"flags": 2}),
    ("L3", "group_info_twice", "A group has two messages of group info.",
     with_message, "minimal", "/provenance", MessageType.GROUP_INFO, b"\0\0"),
    ("L3", "bytes_behind_a_message", "A message has bytes behind its fields.",
     with_fields, "minimal", "/points", {"dataspace": space_of((6, 3)) + bytes(8)}),
    ("L3", "fill_value_of_a_group", "A group has a fill value, as if it were a dataset.",
     with_message, "minimal", "/provenance", MessageType.FILL, b"\x03\x06"),
    ("L4", "filtered_dataset", "A dataset passes through a filter.",
     with_message, "minimal", "/points", 0x0B, struct.pack("<BBHHH", 2, 1, 3, 0, 0)),
    ("L4", "compact_dataset", "A dataset is stored compact, in its header.",
     with_fields, "minimal", "/points", {"layout": b"\x03\x00"}),
    ("L4", "growing_dataset", "A dataset may grow: its maximal shape is another one.",
     with_fields, "minimal", "/points", {"dataspace": GROWING}),
    ("L4", "unwritten_dataset", "A dataset was never written: it has no address.",
     with_fields, "curve", "/sigma", {"data_at": fixtures.UNDEFINED, "data": bytes(80)}),
    ("L4", "fill_value", "A fill value is not zero.",
     with_fields, "minimal", "/points", {"fill": struct.pack("<BBId", 3, 0x26, 8, 1.0)}),
    ("L5", "soft_link", "A link is soft.",
     with_link, "registered", "/registration/tre", fixtures.soft_link(b"tre", b"/sigma")),
    ("L5", "two_links_to_one_object", "Two links lead to one object.",
     with_link, "curve", "/curve/edited", "/curve/bridged"),
    ("L5", "two_attributes_of_one_name", "Two attributes of an object have one name.",
     with_message, "minimal", "/provenance", MessageType.ATTRIBUTE, SECOND_SOFTWARE),
    ("L5", "two_unknown_links_to_one_object",
     "In a file of a later minor version, two unknown links lead to one object.",
     with_link, "later", "/again", "/surprise"),
    ("L6", "slash_in_a_name",
     "In a file of a later minor version, the name of an unknown attribute holds a slash.",
     with_attribute, "later", "/points", "dark/light", "red"),
    ("L6", "control_character", "A text holds a control character.",
     changed, "minimal", {"/provenance@software": "kit\x1b[2J"}),
    ("L6", "text_that_is_not_utf8", "A text is not UTF-8.",
     with_attribute, *SOFTWARE, (fixtures.text_type(2), SCALAR, b"\xff\xfe")),
    ("L6", "text_too_long", "A text is longer than 4096 bytes.",
     changed, "minimal", {"/provenance@software": "k" * 4097}),
    ("L6", "nul_inside_a_text", "A text goes on behind a NUL.",
     with_attribute, *SOFTWARE, (fixtures.text_type(5), SCALAR, b"kit\x001")),
    ("L7", "text_padded_with_blanks", "A text is padded with blanks.",
     with_attribute, *SOFTWARE, (fixtures.text_type(5, padding=2), SCALAR, b"kit 1")),
    ("L7", "datatype_of_version_3", "A datatype's message has version 3.",
     with_fields, "minimal", "/points", {"datatype": b"\x31" + F8[1:]}),
    ("L7", "big_endian", "Numbers are big-endian.",
     with_fields, "minimal", "/points", {"datatype": F8[:1] + b"\x21" + F8[2:]}),
    ("L7", "attribute_array", "An attribute is an array.",
     with_attribute, "cloud", "/rendering", "band_m",
     (F8, space_of((1,)), fixtures.floats([1e-5]))),
    ("L8", "data_in_the_seal", "Data lie in the seal.",
     lambda: with_fields("minimal", "/points", {"data_at": len(payload_of("minimal"))})),
    ("L8", "two_datasets_in_one_place", "Two datasets lie in one place.",
     with_fields, "curve", "/curve/edited", {"data_at": "/curve/bridged", "data": bytes(10)}),
    ("L9", "bytes_behind_the_last_object", "Bytes behind the last object are not zero.",
     with_more_bytes, b"DOE^JANE"),
    ("L9", "name_in_an_empty_message", "An empty message holds a name.",
     with_message, "minimal", "/points", 0, b"DOE^JANE"),
    ("L9", "odd_length", "The payload's length is no multiple of 8.", with_more_bytes, bytes(4)),
    ("L10", "table_without_rows", "A table has no rows.",
     with_item, "minimal", "/provenance/history",
     Item(datatype=fixtures.text_type(1), dataspace=space_of((0,)), data=b"")),
    # The content.
    ("C1", "no_points", "A dataset that must be there is missing.",
     with_link, "minimal", "/points", None),
    ("C1", "group_for_a_dataset", "A group stands where a dataset belongs.",
     with_item, "curve", "/curve/edited", Item()),
    ("C1", "integers_for_floats", "A table has another type.",
     with_fields, "minimal", "/points", {"datatype": I4, "data": bytes(72)}),
    ("C1", "points_of_two_columns", "A table has another shape.",
     with_fields, "minimal", "/points", {"dataspace": space_of((6, 2)), "data": bytes(96)}),
    ("C2", "no_unit", "A table has no unit.", with_attribute, "minimal", "/points", "unit", None),
    ("C2", "points_in_mm", "A table has the unit mm where the page says m.",
     with_attribute, "minimal", "/points", "unit", "mm"),
    ("C2", "points_of_another_frame", "A table names another frame than the file.",
     with_attribute, "minimal", "/points", "frame", "patient_lps"),
    ("C3", "not_a_number", "A coordinate is not a number.",
     remade, "minimal", {"/points": put((2, 1), np.nan)}),
    ("C3", "point_beyond_the_range", "A point lies 200 m away.",
     remade, "minimal", {"/points": put((2, 1), 200.0)}),
    ("C3", "unknown_model", "A text is none of those listed.",
     changed, "registered", {"/registration@model": "projective"}),
    ("C4", "fewer_sigmas_than_points", "One letter means two numbers: fewer sigmas than points.",
     changed, "curve", {"/sigma": np.full(9, 1e-5)}),
    ("C4", "too_many_inputs", "There are more inputs than 64.",
     changed, "minimal", {"/provenance/input_roles": tuple(f"i{i}" for i in range(65)),
                          "/provenance/input_sha256": ("ab" * 32,) * 65}),
    # Values that fit together.
    ("V1", "must_understand_unknown", "A path that must be understood is unknown.",
     changed, "minimal", {"/@version": "2.9", "/@must_understand": "/points /surprise"}),
    ("V2", "rendering_of_a_slice", "A slice's curve has a rendering.", rendering_of_a_slice),
    ("V2", "mesh_beside_a_curve", "A mesh and a curve are in one file.",
     remade, "mesh", {"/curve/stroke": np.zeros(9, np.int32),
                      "/curve/closed": np.zeros(1, np.uint8)}),
    ("V3", "depth_on_a_slice", "A point of a slice has a depth.",
     remade, "pixels", {"/points": put((0, 2), 1.0)}),
    ("V4", "id_of_other_points", "The id is that of other points.",
     changed, "minimal", {"/points": moved((1, 1), 1e-6)}),
    ("V5", "stroke_that_jumps", "The strokes jump from 0 to 2.",
     changed, "curve", {"/curve/stroke": np.repeat([0, 2], [6, 4])}),
    ("V5", "stroke_that_goes_back", "A stroke goes back.",
     changed, "curve", {"/curve/stroke": put(8, 0)}),
    ("V6", "pieces_without_an_axis", "Pieces have no axis.",
     changed, "pieces", {"/rendering/ignore_axis": None}),
    ("V6", "pieces_of_a_third_stroke", "Pieces name a stroke that is not there.",
     remade, "pieces", {"/pieces/stroke": put(4, 2)}),
    ("V7", "pieces_moved", "The pieces lie 50 mm from the points.",
     remade, "pieces", {"/pieces/vertices": moved((..., 1), 0.05)}),
    ("V7", "pieces_that_go_on", "The pieces go on 30 mm beyond the last point.",
     remade, "pieces", {"/pieces/vertices": moved((0, 0), -0.03)}),
    ("V7", "pieces_that_begin_early", "The pieces begin 0.2 mm before the first point.",
     remade, "pieces", {"/pieces/vertices": moved((0, 0), -2e-4)}),
    ("V7", "coarse_pieces", "The error of the pieces is more than 1 % of R.",
     changed, "pieces", {"/pieces@error_m": 6e-5}),
    ("V7", "pieces_beside_the_points",
     "Between two points the pieces leave the line by 0.3 mm and come back.",
     pieces_with_a_corner, 3e-4),
    ("V7", "arc_between_two_points", "Between two points of a line the pieces are an arc.",
     pieces_with_a_corner, 0.0, 0.2),
    ("V8", "triangle_beyond_the_points", "A triangle names a row that is not there.",
     triangle_beyond_the_points),
    ("V8", "point_of_no_triangle", "A point belongs to no triangle.",
     remade, "mesh", {"/points": lambda points: np.vstack([points, [[0.001, 0.001, 0.0]]])}),
    ("V9", "axis_of_length_one_half", "The ignored axis has length 0.5.",
     remade, "curve", {"/rendering/ignore_axis": put(2, 0.5)}),
    ("V9", "band_as_wide_as_the_radius", "The band is as wide as the radius.",
     changed, "cloud", {"/rendering@band_m": 0.005}),
    ("V10", "stability_of_another_stiffness", "The verdict is about another stiffness.",
     changed, "cloud", verdict(900.0, 3000.0)),
    ("V10", "stability_that_is_not_there",
     "The stiffness times the margin exceeds the largest stable one.",
     changed, "cloud", verdict(1000.0, 1500.0)),
    ("V10", "robot_without_a_verdict", "A robot is named without a verdict.",
     changed, "cloud", {"/rendering@robot": "arm"}),
    ("V11", "guide_that_need_not_be_understood", "A guide is not named in must_understand.",
     changed, "guided", {"/@must_understand": None}),
    ("V11", "guide_along_a_third_stroke", "A stroke guides that is not there.",
     changed, "guided", {"/guidance@stroke": 2}),
    ("V12", "transform_with_a_perspective", "The last row of a 4 x 4 transform is not 0 0 0 1.",
     changed, "navigated", {"/registration/T_robot_image": put((3, 0), 1e-9)}),
    ("V12", "labels_twice", "Two markers have one label.",
     changed, "registered", {"/registration/labels": ("a", "a", "c", "d")}),
    ("V12", "negative_variance", "A variance is negative.",
     changed, "registered", {"/registration/covariance": -np.eye(9)}),
    ("V12", "covariance_of_other_parameters",
     "The covariance has 12 rows, and the transform 9 parameters.",
     changed, "registered", {"/registration/covariance": np.eye(12)}),
    ("V13", "transform_to_a_line", "The transform takes the slice to a line.", transform_to_a_line),
    ("V13", "residuals_of_other_markers", "The residuals are those of other markers.",
     changed, "registered", {"/registration/residuals": np.zeros(4)}),
    ("V13", "point_off_the_plane", "A point lies 1 mm off the slice's plane.",
     remade, "registered", {"/points": moved((2, 2), 1e-3)}),
    ("V14", "place_of_a_finding_without_one", "A finding without a place has one.",
     changed, "findings", {"/findings/place_px": put(1, (1.0, 2.0))}),
    ("V14", "answered_at_no_time", "A finding was answered by somebody at no time.",
     changed, "findings", {"/findings/answered_utc": ("", "", "")}),
    ("V14", "code_of_two_words", "A code holds a blank.",
     changed, "findings", {"/findings/code": ("very odd", "b", "c")}),
    ("V15", "review_by_nobody", "The review is by nobody.",
     changed, "reviewed", {"/review@by": ""}),
    ("V15", "digest_in_capitals", "The digest of what was shown has capital letters.",
     changed, "reviewed", {"/review@digest": "0F" * 32}),
    ("V15", "review_by_a_hidden_name", "The reviewer's name is turned by U+202E.",
     changed, "reviewed", {"/review@by": "A. \u202erennalP"}),
    ("V16", "time_without_a_zone", "A time has another form.",
     changed, "minimal", {"/provenance@created_utc": "2026-01-02 03:04:05"}),
    ("V16", "answered_on_a_day", "The time of an answer is a day alone.",
     changed, "findings", {"/findings/answered_utc": ("", "", "2026-01-02")}),
    ("V17", "names_without_values", "Settings have names and no values.",
     changed, "curve", {"/provenance/setting_values": None}),
    ("V17", "setting_that_is_an_object", "A setting's value is a JSON object.",
     changed, "curve", {"/provenance/setting_values": ("{}", "1e-05", "false")}),
    ("V18", "no_certificate", "A rendering has no certificate.", changed, "cloud", {"/leak": None}),
    ("V19", "case_with_a_hidden_character", "The case holds a blank of no width.",
     changed, "minimal", {"/@case": "case\u200b18"}),
    ("V19", "case_that_ends_in_a_blank", "The case ends in a blank.",
     changed, "minimal", {"/@case": "case 18 "}),
    ("V20", "digest_of_another_plan", "The digest is that of no plan.",
     changed, "reviewed", {"/review@digest": "0f" * 32}),
    ("V20", "stiffer_after_the_review", "The stiffness was doubled after the review.",
     changed, "reviewed", {"/rendering/stiffness": lambda stiffness: 2 * stiffness}),
    ("V20", "another_case_after_the_review", "The case was changed after the review.",
     changed, "of_a_case", {"/@case": "case 19"}),
    ("V20", "answered_after_the_review", "A doubt was answered after the review.",
     answered_after_the_review),
    # The seal.
    ("S1", "no_seal", "The seal is missing.", lambda: sound_file()[:-SEAL]),
    ("S1", "bytes_behind_the_seal", "Something follows the seal.", lambda: sound_file() + bytes(8)),
    ("S2", "seal_of_version_3", "The seal has a later version.", with_seal, 8, b"\x03\0"),
    ("S2", "seal_of_another_length", "The seal is about a payload of another length.",
     with_seal, 16, struct.pack("<Q", 8)),
    ("S3", "unknown_flag", "An unknown flag is set.", with_seal, 10, b"\x04\0"),
    ("S3", "texts_that_leave_the_seal", "The texts leave the seal.",
     lambda: with_seal(144, struct.pack("<H", 400), signed("minimal", True))),
    ("S4", "digest_of_the_seal", "The seal's own digest is wrong.",
     lambda: flipped(sound_file(), -48)),
    ("S5", "unsigned_with_a_key", "An unsigned seal names a key.", with_seal, 56, b"\x01"),
    ("S5", "signed_after_the_year_9999", "It was signed after the year 9999.",
     lambda: with_seal(136, struct.pack("<Q", 253_402_300_800), signed("minimal", True))),
    ("S6", "changed_payload", "A byte of the payload is another one.",
     lambda: flipped(sound_file(), -SEAL - 8)),
    ("S8", "signed_without_a_word",
     "It was signed without a review, and the seal does not say so.", signed, "minimal", False),
    ("S8", "signed_in_spite_of_nothing", "The seal says that something is open, and nothing is.",
     signed, "reviewed", True),
    ("S10", "signed_for_another_case", "It is for case 18, and signed for case 17.",
     signed, "of_a_case", False),
    # The certificate.
    ("K1", "curve_called_a_cloud", "A curve is certified as a cloud.",
     changed, "curve", {"/leak@kind": "cloud"}),
    ("K2", "smaller_opening", "The largest opening is larger than stated.",
     changed, "curve", {"/leak@largest_m": 1e-3}),
    ("K2", "another_limit", "The limit is another one.", changed, "mesh", {"/leak@limit_m": 1.0}),
    ("K2", "opening_of_other_samples",
     "The largest opening is that of the corners, although denser samples are asked for.",
     changed, "drawn_mesh", {"/leak@largest_m": 0.012 * 2**0.5}),
    ("K3", "mesh_that_leaks",
     "The corners are 17 mm from the middle of a triangle, and no samples are asked for.",
     remade, "drawn_mesh", {"/mesh@sample_radius_m": None}, {"/leak@certified": 1}),
    ("K3", "leak", "The fixture leaks: two neighbours are 12 mm apart.",
     remade, "curve", {"/points": lambda p: replaced(p, (5, 0), p[4, 0] + 0.012)},
     {"/leak@certified": 1}),
    ("K4", "certificate_withheld", "The certificate is withheld.",
     changed, "curve", {"/leak@certified": 0}),
    ("K4", "certified_cloud", "A bare cloud is called certified.",
     changed, "cloud", {"/leak@certified": 1}),
    # Versions.
    ("M1", "another_format", "It is another format.",
     changed, "minimal", {"/@format": "vfplan-result"}),
    ("M1", "version_with_a_leading_zero", "The version has a leading zero.",
     changed, "minimal", {"/@version": "2.00"}),
    ("M2", "next_major_version", "The major version is 3.",
     changed, "minimal", {"/@version": "3.0"}),
    ("M4", "unknown_dataset", "A dataset of this version is unknown.",
     with_item, "minimal", "/surprise", floats(1.0)),
    ("M4", "unknown_attribute", "An attribute of this version is unknown.",
     with_attribute, "minimal", "/provenance", "surprise", "boo"),
)
# Files that are sound, and that a reader must refuse where the kit's signature is demanded.
UNTRUSTED: Rows = (
    ("S7", "nobody_signed", "Nobody signed it.", sound_file),
    ("S7", "signed_by_another_key", "It is signed by a key that is not trusted.",
     signed, "reviewed", False, OTHER_SEED),
    ("S7", "key_id_of_a_trusted_key", "It is signed by another key, and names the trusted one.",
     reviewed_with_seal, 56, seal.key_id_of(key_of(KIT_SEED).public_key()), OTHER_SEED),
    ("S7", "signature_of_another_payload", "The signature is that of another bundle.",
     lambda: reviewed_with_seal(72, signed("registered", True)[-SEAL:][72:136])),
    ("S7", "case_changed_after_signing", "The case was changed after it was signed.",
     reviewed_with_seal, 148, b"case 18"),
    ("S7", "time_changed_after_signing", "The time of signing was changed.",
     reviewed_with_seal, 136, struct.pack("<Q", 1_767_409_445)),
    ("S7", "signature_of_version_1", "What was signed begins as in version 1.",
     signed, "reviewed", False, KIT_SEED, b"vfplan bundle seal 1\0"),
)
# fmt: on
