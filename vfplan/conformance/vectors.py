"""The files that break one rule of docs/format.md each, and what is wrong with them."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vfplan.bundle import seal
from vfplan.bundle.content import Content, to_content
from vfplan.bundle.write import completed
from vfplan.conformance import fixtures
from vfplan.conformance import fixtures as hdf5
from vfplan.conformance.fixtures import Item, MessageType, add, set_attribute

SEAL = seal.LENGTHS[0]
"""Length of a seal with short texts [bytes]."""


@dataclass(frozen=True)
class Vector:
    """A file that a reader must refuse."""

    name: str
    rule: str
    why: str
    make: Callable[[], bytes]


VECTORS: list[Vector] = []

NOT_BY_A_FILE = {
    "L11": "binds a writer: a reader cannot know what identifies a patient",
    "C5": "binds a writer: whether a fixture was changed after its review is not in the file",
    "S9": "binds a reader: the order in which it works",
    "K5": "binds a reader that renders points: the paths render/drawn_mesh-*.json hold it",
    "M3": "binds a reader to read a file: the valid file newer_minor holds it",
}
"""Rules that no file of the folder `invalid` breaks, each with the reason."""


def vector(rule: str) -> Callable[[Callable[[], bytes]], Callable[[], bytes]]:
    """Enter a function that makes a file which breaks `rule`; its docstring says what is wrong."""

    def enter(make: Callable[[], bytes]) -> Callable[[], bytes]:
        VECTORS.append(Vector(make.__name__, rule, make.__doc__ or "", make))
        return make

    return enter


def content_of(name: str) -> Content:
    """The complete content of a fixture, to be changed."""
    return completed(to_content(getattr(fixtures, name)()))


def sealed(payload: bytes) -> bytes:
    """A payload as an unsigned bundle."""
    return b"".join(seal.unsigned(payload))


def sealed_as_it_is(payload: bytes) -> bytes:
    """A payload under a seal, its superblock left alone."""
    return payload + seal.to_bytes(seal.Seal(len(payload), hashlib.sha256(payload).digest()))


def of_content(content: Content) -> bytes:
    """The bundle of a content, whatever it is."""
    return sealed(hdf5.to_payload(hdf5.items_of(content)))


def of_items(items: dict[str, Item]) -> bytes:
    """The bundle of items, whatever they are."""
    return sealed(hdf5.to_payload(items))


def items(name: str) -> dict[str, Item]:
    """The items of a fixture, to be changed."""
    return hdf5.items_of(content_of(name))


def changed(name: str, **values: Any) -> bytes:
    """The bundle of a fixture with other values after its id and certificate were made.

    The path of a keyword is written with `__` for `/` and `_at_` for `@`.
    """
    content = content_of(name)
    for key, value in values.items():
        content["/" + key.replace("_at_", "@").replace("__", "/").removeprefix("root")] = value
    return of_content(content)


def remade(name: str, change: Callable[[Content], None]) -> bytes:
    """The bundle of a fixture that was changed before its id and certificate were made."""
    content = content_of(name)
    change(content)
    return of_content(completed(content))


def payload_of(name: str) -> bytes:
    """The payload of a fixture, stating the end of the whole file."""
    payload = hdf5.to_payload(items(name))
    return seal.with_end_of_file(payload, len(payload) + SEAL)


def sound_file() -> bytes:
    """The bundle of the minimal fixture."""
    return of_content(content_of("minimal"))


def with_seal(at: int, value: bytes, data: bytes | None = None) -> bytes:
    """A bundle with other bytes in its seal, whose own digest is made anew."""
    if data is None:
        data = sound_file()
    block = bytearray(data[-SEAL:])
    block[at : at + len(value)] = value
    block[-48:-16] = hashlib.sha256(block[:-48]).digest()
    return data[:-SEAL] + bytes(block)


KIT_SEED = bytes(32)
"""Seed of the key with which the kit is signed: no secret."""


def key_of(seed: bytes) -> Any:
    """The private Ed25519 key that this seed gives."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    return Ed25519PrivateKey.from_private_bytes(seed)


def signed(
    name: str,
    *,
    case: str = "case 17",
    despite_findings: bool = True,
    seed: bytes = KIT_SEED,
    domain: bytes = seal.DOMAIN,
) -> bytes:
    """A fixture signed by the key of a seed; `domain` are the first bytes that are signed."""
    key = key_of(seed)
    payload = payload_of(name)
    unsigned = seal.Seal(
        len(payload),
        hashlib.sha256(payload).digest(),
        key_id=hashlib.sha256(key.public_key().public_bytes_raw()).digest()[:16],
        signature=bytes(64),
        case=case,
        robot_serial="R-0042",
        signed_at=1_767_323_045,
        despite_findings=despite_findings,
    )
    message = domain + seal.signed_message(unsigned).removeprefix(seal.DOMAIN)
    done = replace(unsigned, signature=key.sign(message))
    return payload + seal.to_bytes(done)


# --- L: the file ------------------------------------------------------------------------------


@vector("L1")
def superblock_of_version_3() -> bytes:
    """The superblock has version 3."""
    payload = payload_of("minimal")
    return sealed_as_it_is(hdf5.checked(payload[:8] + b"\x03" + payload[9:]))


@vector("L1")
def superblock_with_a_flag() -> bytes:
    """A flag of the superblock is set."""
    payload = payload_of("minimal")
    return sealed_as_it_is(hdf5.checked(payload[:11] + b"\x01" + payload[12:]))


@vector("L1")
def base_address_512() -> bytes:
    """The base address is 512."""
    payload = payload_of("minimal")
    return sealed_as_it_is(hdf5.checked(payload[:12] + struct.pack("<Q", 512) + payload[20:]))


@vector("L1")
def superblock_extension() -> bytes:
    """The superblock names an extension."""
    payload = payload_of("minimal")
    return sealed_as_it_is(hdf5.checked(payload[:20] + payload[36:44] + payload[28:]))


@vector("L2")
def end_of_file_before_the_seal() -> bytes:
    """The end of file is that of the payload, before the seal."""
    payload = payload_of("minimal")
    return sealed_as_it_is(seal.with_end_of_file(payload, len(payload)))


@vector("L2")
def superblock_checksum() -> bytes:
    """The superblock's checksum is wrong."""
    payload = payload_of("minimal")
    return sealed_as_it_is(payload[:44] + bytes([payload[44] ^ 1]) + payload[45:])


@vector("L3")
def header_checksum() -> bytes:
    """The checksum of the root's header is wrong."""
    payload = bytearray(payload_of("minimal"))
    size = struct.unpack_from("<I", payload, 54)[0]
    payload[58 + size] ^= 1
    return sealed_as_it_is(bytes(payload))


@vector("L3")
def comment_message() -> bytes:
    """A header holds a message of another kind, a comment."""
    changed_items = items("minimal")
    changed_items["/points"].more.append((0x0D, b"hidden\0"))
    return of_items(changed_items)


@vector("L3")
def shared_message() -> bytes:
    """A datatype's message is shared."""
    changed_items = items("minimal")
    changed_items["/points"].flags = 2
    return of_items(changed_items)


@vector("L3")
def group_info_twice() -> bytes:
    """A group has two messages of group info."""
    changed_items = items("minimal")
    changed_items["/provenance"].more.append((MessageType.GROUP_INFO, b"\0\0"))
    return of_items(changed_items)


@vector("L3")
def bytes_behind_a_message() -> bytes:
    """A message has bytes behind its fields."""
    changed_items = items("minimal")
    changed_items["/points"].dataspace += bytes(8)
    return of_items(changed_items)


@vector("L3")
def fill_value_of_a_group() -> bytes:
    """A group has a fill value, as if it were a dataset."""
    changed_items = items("minimal")
    changed_items["/provenance"].more.append((MessageType.FILL, b"\x03\x06"))
    return of_items(changed_items)


@vector("L4")
def filtered_dataset() -> bytes:
    """A dataset passes through a filter."""
    changed_items = items("minimal")
    body = struct.pack("<BBHHH", 2, 1, 3, 0, 0)
    changed_items["/points"].more.append((0x0B, body))
    return of_items(changed_items)


@vector("L4")
def compact_dataset() -> bytes:
    """A dataset is stored compact, in its header."""
    changed_items = items("minimal")
    changed_items["/points"].layout = b"\x03\x00"
    return of_items(changed_items)


@vector("L4")
def growing_dataset() -> bytes:
    """A dataset may grow: its maximal shape is another one."""
    changed_items = items("minimal")
    shape = struct.pack("<QQQQ", 6, 3, 7, 3)
    changed_items["/points"].dataspace = struct.pack("<BBBB", 2, 2, 1, 1) + shape
    return of_items(changed_items)


@vector("L4")
def unwritten_dataset() -> bytes:
    """A dataset was never written: it has no address."""
    changed_items = items("curve")
    changed_items["/sigma"].data_at = hdf5.UNDEFINED
    changed_items["/sigma"].data = bytes(80)
    return of_items(changed_items)


@vector("L4")
def fill_value() -> bytes:
    """A fill value is not zero."""
    changed_items = items("minimal")
    changed_items["/points"].fill = struct.pack("<BBId", 3, 0x26, 8, 1.0)
    return of_items(changed_items)


@vector("L5")
def soft_link() -> bytes:
    """A link is soft."""
    changed_items = items("registered")
    hdf5.remove(changed_items, "/registration/tre")
    changed_items["/registration"].links[b"tre"] = hdf5.soft_link(b"tre", b"/sigma")
    return of_items(changed_items)


@vector("L5")
def two_links_to_one_object() -> bytes:
    """Two links lead to one object."""
    changed_items = items("curve")
    hdf5.remove(changed_items, "/curve/edited")
    changed_items["/curve"].links[b"edited"] = "/curve/bridged"
    return of_items(changed_items)


@vector("L5")
def two_attributes_of_one_name() -> bytes:
    """Two attributes of an object have one name."""
    changed_items = items("minimal")
    second = hdf5.attribute(b"software", *hdf5.stored("kit 2", "text"))
    changed_items["/provenance"].more.append((MessageType.ATTRIBUTE, second))
    return of_items(changed_items)


@vector("L5")
def two_unknown_links_to_one_object() -> bytes:
    """In a file of a later minor version, two unknown links lead to one object."""
    later = later_items()
    later["/"].links[b"again"] = "/surprise"
    return of_items(later)


@vector("L6")
def slash_in_a_name() -> bytes:
    """In a file of a later minor version, the name of an unknown attribute holds a slash."""
    later = later_items()
    set_attribute(later["/points"], "dark/light", "red")
    return of_items(later)


@vector("L6")
def control_character() -> bytes:
    """A text holds a control character."""
    return changed("minimal", provenance_at_software="kit\x1b[2J")


@vector("L6")
def text_that_is_not_utf8() -> bytes:
    """A text is not UTF-8."""
    changed_items = items("minimal")
    value = (hdf5.text_type(2), hdf5.space_of(()), b"\xff\xfe")
    changed_items["/provenance"].attributes[b"software"] = value
    return of_items(changed_items)


@vector("L6")
def text_too_long() -> bytes:
    """A text is longer than 4096 bytes."""
    return changed("minimal", provenance_at_software="k" * 4097)


@vector("L7")
def text_padded_with_blanks() -> bytes:
    """A text is padded with blanks."""
    changed_items = items("minimal")
    value = (hdf5.text_type(5, padding=2), hdf5.space_of(()), b"kit 1")
    changed_items["/provenance"].attributes[b"software"] = value
    return of_items(changed_items)


@vector("L6")
def nul_inside_a_text() -> bytes:
    """A text goes on behind a NUL."""
    changed_items = items("minimal")
    value = (hdf5.text_type(5), hdf5.space_of(()), b"kit\0" + b"1")
    changed_items["/provenance"].attributes[b"software"] = value
    return of_items(changed_items)


@vector("L7")
def datatype_of_version_3() -> bytes:
    """A datatype's message has version 3."""
    changed_items = items("minimal")
    changed_items["/points"].datatype = b"\x31" + hdf5.DATATYPES["f8"][1:]
    return of_items(changed_items)


@vector("L7")
def big_endian() -> bytes:
    """Numbers are big-endian."""
    changed_items = items("minimal")
    datatype = bytearray(hdf5.DATATYPES["f8"])
    datatype[1] |= 1
    changed_items["/points"].datatype = bytes(datatype)
    return of_items(changed_items)


@vector("L7")
def attribute_array() -> bytes:
    """An attribute is an array."""
    changed_items = items("cloud")
    value = (hdf5.DATATYPES["f8"], hdf5.space_of((1,)), hdf5.floats([1e-5]))
    changed_items["/rendering"].attributes[b"band_m"] = value
    return of_items(changed_items)


@vector("L8")
def data_in_the_seal() -> bytes:
    """Data lie in the seal."""
    changed_items = items("minimal")
    end = len(hdf5.to_payload(changed_items))
    changed_items["/points"].data_at = end
    return of_items(changed_items)


@vector("L8")
def two_datasets_in_one_place() -> bytes:
    """Two datasets lie in one place."""
    changed_items = items("curve")
    changed_items["/curve/edited"].data_at = "/curve/bridged"
    changed_items["/curve/edited"].data = bytes(10)
    return of_items(changed_items)


@vector("L9")
def bytes_behind_the_last_object() -> bytes:
    """Bytes behind the last object are not zero."""
    return sealed(hdf5.to_payload(items("minimal")) + b"DOE^JANE")


@vector("L9")
def name_in_an_empty_message() -> bytes:
    """An empty message holds a name."""
    changed_items = items("minimal")
    changed_items["/points"].more.append((0, b"DOE^JANE"))
    return of_items(changed_items)


@vector("L9")
def odd_length() -> bytes:
    """The payload's length is no multiple of 8."""
    payload = hdf5.to_payload(items("minimal")) + bytes(4)
    return sealed_as_it_is(seal.with_end_of_file(payload, len(payload) + SEAL))


@vector("L10")
def table_without_rows() -> bytes:
    """A table has no rows."""
    changed_items = items("minimal")
    item = Item(datatype=hdf5.text_type(1), dataspace=hdf5.space_of((0,)), data=b"")
    add(changed_items, "/provenance/history", item)
    return of_items(changed_items)


# --- C: the content ---------------------------------------------------------------------------


@vector("C1")
def no_points() -> bytes:
    """A dataset that must be there is missing."""
    changed_items = items("minimal")
    hdf5.remove(changed_items, "/points")
    return of_items(changed_items)


@vector("C1")
def group_for_a_dataset() -> bytes:
    """A group stands where a dataset belongs."""
    changed_items = items("curve")
    changed_items["/curve/edited"] = Item()
    return of_items(changed_items)


@vector("C1")
def integers_for_floats() -> bytes:
    """A table has another type."""
    changed_items = items("minimal")
    item = changed_items["/points"]
    item.datatype, item.data = hdf5.DATATYPES["i4"], bytes(72)
    return of_items(changed_items)


@vector("C1")
def points_of_two_columns() -> bytes:
    """A table has another shape."""
    changed_items = items("minimal")
    item = changed_items["/points"]
    item.dataspace, item.data = hdf5.space_of((6, 2)), bytes(96)
    return of_items(changed_items)


@vector("C2")
def no_unit() -> bytes:
    """A table has no unit."""
    changed_items = items("minimal")
    del changed_items["/points"].attributes[b"unit"]
    return of_items(changed_items)


@vector("C2")
def points_in_mm() -> bytes:
    """A table has the unit mm where the page says m."""
    changed_items = items("minimal")
    set_attribute(changed_items["/points"], "unit", "mm")
    return of_items(changed_items)


@vector("C2")
def points_of_another_frame() -> bytes:
    """A table names another frame than the file."""
    changed_items = items("minimal")
    set_attribute(changed_items["/points"], "frame", "patient_lps")
    return of_items(changed_items)


@vector("C3")
def not_a_number() -> bytes:
    """A coordinate is not a number."""

    def change(content: Content) -> None:
        content["/points"][2, 1] = np.nan

    return remade("minimal", change)


@vector("C3")
def point_beyond_the_range() -> bytes:
    """A point lies 200 m away."""

    def change(content: Content) -> None:
        content["/points"][2, 1] = 200.0

    return remade("minimal", change)


@vector("C3")
def unknown_model() -> bytes:
    """A text is none of those listed."""
    return changed("registered", registration_at_model="projective")


@vector("C4")
def fewer_sigmas_than_points() -> bytes:
    """One letter means two numbers: fewer sigmas than points."""
    return changed("curve", sigma=np.full(9, 1e-5))


@vector("C4")
def too_many_inputs() -> bytes:
    """There are more inputs than 64."""
    names = tuple(f"i{i}" for i in range(65))
    sums = tuple(["ab" * 32] * 65)
    return changed("minimal", provenance__input_roles=names, provenance__input_sha256=sums)


# --- V: values that fit together --------------------------------------------------------------


@vector("V1")
def must_understand_unknown() -> bytes:
    """A path that must be understood is unknown."""
    content = content_of("minimal")
    content["/@version"] = "2.9"
    content["/@must_understand"] = "/points /surprise"
    changed_items = hdf5.items_of(content)
    return of_items(changed_items)


@vector("V2")
def rendering_of_a_slice() -> bytes:
    """A slice's curve has a rendering."""
    content = content_of("pixels")
    for path, value in content_of("curve").items():
        if path.startswith(("/rendering", "/leak")) and path != "/leak/open_ends":
            content[path] = value
    return of_content(content)


@vector("V2")
def mesh_beside_a_curve() -> bytes:
    """A mesh and a curve are in one file."""

    def change(content: Content) -> None:
        content["/curve/stroke"] = np.zeros(9, np.int32)
        content["/curve/closed"] = np.zeros(1, np.uint8)

    return remade("mesh", change)


@vector("V3")
def depth_on_a_slice() -> bytes:
    """A point of a slice has a depth."""

    def change(content: Content) -> None:
        content["/points"][0, 2] = 1.0

    return remade("pixels", change)


@vector("V4")
def id_of_other_points() -> bytes:
    """The id is that of other points."""
    content = content_of("minimal")
    content["/points"][1, 1] += 1e-6
    return of_content(content)


@vector("V5")
def stroke_that_jumps() -> bytes:
    """The strokes jump from 0 to 2."""
    content = content_of("curve")
    content["/curve/stroke"] = np.repeat([0, 2], [6, 4]).astype(np.int32)
    return of_content(content)


@vector("V5")
def stroke_that_goes_back() -> bytes:
    """A stroke goes back."""
    content = content_of("curve")
    content["/curve/stroke"][8] = 0
    return of_content(content)


@vector("V6")
def pieces_without_an_axis() -> bytes:
    """Pieces have no axis."""
    content = content_of("pieces")
    del content["/rendering/ignore_axis"]
    return of_content(content)


@vector("V6")
def pieces_of_a_third_stroke() -> bytes:
    """Pieces name a stroke that is not there."""

    def change(content: Content) -> None:
        content["/pieces/stroke"] = np.array([0, 0, 0, 1, 2], np.int32)

    return remade("pieces", change)


@vector("V7")
def pieces_moved() -> bytes:
    """The pieces lie 50 mm from the points."""

    def change(content: Content) -> None:
        content["/pieces/vertices"][:, 1] += 0.05

    return remade("pieces", change)


@vector("V7")
def pieces_that_go_on() -> bytes:
    """The pieces go on 30 mm beyond the last point."""

    def change(content: Content) -> None:
        content["/pieces/vertices"][0, 0] -= 0.03

    return remade("pieces", change)


@vector("V8")
def triangle_beyond_the_points() -> bytes:
    """A triangle names a row that is not there."""
    content = content_of("mesh")
    content["/mesh/triangles"][0, 0] = 9
    return remade_id(content)


@vector("V8")
def point_of_no_triangle() -> bytes:
    """A point belongs to no triangle."""

    def change(content: Content) -> None:
        content["/points"] = np.vstack([content["/points"], [[0.001, 0.001, 0.0]]])

    return remade("mesh", change)


@vector("V9")
def axis_of_length_one_half() -> bytes:
    """The ignored axis has length 0.5."""

    def change(content: Content) -> None:
        content["/rendering/ignore_axis"] = np.array([0.0, 0.0, 0.5])

    return remade("curve", change)


@vector("V9")
def band_as_wide_as_the_radius() -> bytes:
    """The band is as wide as the radius."""
    return changed("cloud", rendering_at_band_m=0.005)


@vector("V10")
def stability_of_another_stiffness() -> bytes:
    """The verdict is about another stiffness."""
    verdict = np.array([4.0, 20.0, 1000.0, 1.0, 900.0, 3000.0, 2.0])
    return changed("cloud", rendering_at_robot="arm", rendering__stability=verdict)


@vector("V10")
def stability_that_is_not_there() -> bytes:
    """The stiffness times the margin exceeds the largest stable one."""
    verdict = np.array([4.0, 20.0, 1000.0, 1.0, 1000.0, 1500.0, 2.0])
    return changed("cloud", rendering_at_robot="arm", rendering__stability=verdict)


@vector("V10")
def robot_without_a_verdict() -> bytes:
    """A robot is named without a verdict."""
    return changed("cloud", rendering_at_robot="arm")


@vector("V11")
def guide_that_need_not_be_understood() -> bytes:
    """A guide is not named in must_understand."""
    content = content_of("guided")
    del content["/@must_understand"]
    return of_content(content)


@vector("V11")
def guide_along_a_third_stroke() -> bytes:
    """A stroke guides that is not there."""
    return changed("guided", guidance_at_stroke=2)


@vector("V12")
def transform_with_a_perspective() -> bytes:
    """The last row of a 4 x 4 transform is not 0 0 0 1."""
    T = content_of("navigated")["/registration/T_robot_image"].copy()
    T[3, 0] = 1e-9
    return changed("navigated", registration__T_robot_image=T)


@vector("V12")
def labels_twice() -> bytes:
    """Two markers have one label."""
    return changed("registered", registration__labels=("a", "a", "c", "d"))


@vector("V12")
def negative_variance() -> bytes:
    """A variance is negative."""
    return changed("registered", registration__covariance=-np.eye(9))


@vector("V12")
def covariance_of_other_parameters() -> bytes:
    """The covariance has 12 rows, and the transform 9 parameters."""
    return changed("registered", registration__covariance=np.eye(12))


@vector("V13")
def transform_to_a_line() -> bytes:
    """The transform takes the slice to a line."""
    content = content_of("registered")
    T = np.array(content["/registration/T_robot_image"])
    T[:, 1] = T[:, 0]
    mapped = np.column_stack([content["/registration/source"], np.ones(4)]) @ T.T
    residuals = np.linalg.norm(mapped - content["/registration/target"], axis=1)
    return changed("registered", registration__T_robot_image=T, registration__residuals=residuals)


@vector("V13")
def residuals_of_other_markers() -> bytes:
    """The residuals are those of other markers."""
    return changed("registered", registration__residuals=np.zeros(4))


@vector("V13")
def point_off_the_plane() -> bytes:
    """A point lies 1 mm off the slice's plane."""

    def change(content: Content) -> None:
        content["/points"][2, 2] += 1e-3

    return remade("registered", change)


@vector("V14")
def place_of_a_finding_without_one() -> bytes:
    """A finding without a place has one."""
    place = content_of("findings")["/findings/place_px"].copy()
    place[1] = (1.0, 2.0)
    return changed("findings", findings__place_px=place)


@vector("V14")
def answered_at_no_time() -> bytes:
    """A finding was answered by somebody at no time."""
    content = content_of("findings")
    content["/findings/answered_utc"] = ("", "", "")
    return of_content(content)


@vector("V14")
def code_of_two_words() -> bytes:
    """A code holds a blank."""
    return changed("findings", findings__code=("very odd", "b", "c"))


@vector("V15")
def review_by_nobody() -> bytes:
    """The review is by nobody."""
    return changed("reviewed", review_at_by="")


@vector("V15")
def digest_in_capitals() -> bytes:
    """The digest of what was shown has capital letters."""
    return changed("reviewed", review_at_digest="0F" * 32)


@vector("V16")
def time_without_a_zone() -> bytes:
    """A time has another form."""
    return changed("minimal", provenance_at_created_utc="2026-01-02 03:04:05")


@vector("V16")
def answered_on_a_day() -> bytes:
    """The time of an answer is a day alone."""
    return changed("findings", findings__answered_utc=("", "", "2026-01-02"))


@vector("V17")
def names_without_values() -> bytes:
    """Settings have names and no values."""
    content = content_of("curve")
    del content["/provenance/setting_values"]
    return of_content(content)


@vector("V17")
def setting_that_is_an_object() -> bytes:
    """A setting's value is a JSON object."""
    return changed("curve", provenance__setting_values=("{}", "1e-05", "false"))


@vector("V18")
def no_certificate() -> bytes:
    """A rendering has no certificate."""
    content = content_of("cloud")
    for path in [path for path in content if path.startswith("/leak")]:
        del content[path]
    return of_content(content)


def remade_id(content: Content) -> bytes:
    """The bundle of a content with its id made anew, and its certificate as it was."""
    kept = {path: value for path, value in content.items() if path.startswith("/leak")}
    return of_content(completed(content) | kept)


# --- S: the seal ------------------------------------------------------------------------------


@vector("S1")
def no_seal() -> bytes:
    """The seal is missing."""
    return sound_file()[:-SEAL]


@vector("S1")
def bytes_behind_the_seal() -> bytes:
    """Something follows the seal."""
    return sound_file() + bytes(8)


@vector("S2")
def seal_of_version_3() -> bytes:
    """The seal has a later version."""
    return with_seal(8, b"\x03\0")


@vector("S2")
def seal_of_another_length() -> bytes:
    """The seal is about a payload of another length."""
    return with_seal(16, struct.pack("<Q", 8))


@vector("S3")
def unknown_flag() -> bytes:
    """An unknown flag is set."""
    return with_seal(10, b"\x04\0")


@vector("S3")
def texts_that_leave_the_seal() -> bytes:
    """The texts leave the seal."""
    return with_seal(144, struct.pack("<H", 400), signed("minimal"))


@vector("S4")
def digest_of_the_seal() -> bytes:
    """The seal's own digest is wrong."""
    data = bytearray(sound_file())
    data[-48] ^= 1
    return bytes(data)


@vector("S5")
def unsigned_with_a_key() -> bytes:
    """An unsigned seal names a key."""
    return with_seal(56, b"\x01")


@vector("S5")
def signed_after_the_year_9999() -> bytes:
    """It was signed after the year 9999."""
    return with_seal(136, struct.pack("<Q", 253_402_300_800), signed("minimal"))


@vector("S6")
def changed_payload() -> bytes:
    """A byte of the payload is another one."""
    data = bytearray(sound_file())
    data[len(data) - SEAL - 8] ^= 1
    return bytes(data)


@vector("S8")
def signed_without_a_word() -> bytes:
    """It was signed without a review, and the seal does not say so."""
    return signed("minimal", despite_findings=False)


@vector("S8")
def signed_in_spite_of_nothing() -> bytes:
    """The seal says that something is open, and nothing is."""
    return signed("reviewed", despite_findings=True)


# --- S7: where a signature is demanded ---------------------------------------------------------


def nobody_signed() -> bytes:
    """Nobody signed it."""
    return sound_file()


def signed_by_another_key() -> bytes:
    """It is signed by a key that is not trusted."""
    return signed("reviewed", despite_findings=False, seed=b"\x01" * 32)


def key_id_of_a_trusted_key() -> bytes:
    """It is signed by another key, and names the trusted one."""
    trusted = signed("reviewed", despite_findings=False)
    key_id = trusted[len(trusted) - SEAL + 56 : len(trusted) - SEAL + 72]
    return with_seal(56, key_id, signed_by_another_key())


def signature_of_another_payload() -> bytes:
    """The signature is that of another bundle."""
    other = signed("registered")
    signature = other[len(other) - SEAL + 72 : len(other) - SEAL + 136]
    return with_seal(72, signature, signed("reviewed", despite_findings=False))


def case_changed_after_signing() -> bytes:
    """The case was changed after it was signed."""
    return with_seal(148, b"case 18", signed("reviewed", despite_findings=False))


def time_changed_after_signing() -> bytes:
    """The time of signing was changed."""
    later = struct.pack("<Q", 1_767_409_445)
    return with_seal(136, later, signed("reviewed", despite_findings=False))


def signature_of_version_1() -> bytes:
    """What was signed begins as in version 1."""
    return signed("reviewed", despite_findings=False, domain=b"vfplan bundle seal 1\0")


UNTRUSTED = [
    Vector(make.__name__, "S7", make.__doc__ or "", make)
    for make in (
        nobody_signed,
        signed_by_another_key,
        key_id_of_a_trusted_key,
        signature_of_another_payload,
        case_changed_after_signing,
        time_changed_after_signing,
        signature_of_version_1,
    )
]
"""Files that are sound, and that a reader must refuse where the kit's signature is demanded."""

# --- K: the certificate -----------------------------------------------------------------------


@vector("K1")
def curve_called_a_cloud() -> bytes:
    """A curve is certified as a cloud."""
    return changed("curve", leak_at_kind="cloud")


@vector("K2")
def smaller_opening() -> bytes:
    """The largest opening is larger than stated."""
    return changed("curve", leak_at_largest_m=1e-3)


@vector("K2")
def another_limit() -> bytes:
    """The limit is another one."""
    return changed("mesh", leak_at_limit_m=1.0)


@vector("K2")
def opening_of_other_samples() -> bytes:
    """The largest opening is that of the corners, although denser samples are asked for."""
    return changed("drawn_mesh", leak_at_largest_m=0.012 * 2**0.5)


@vector("K3")
def mesh_that_leaks() -> bytes:
    """The corners are 17 mm from the middle of a triangle, and no samples are asked for."""
    content = content_of("drawn_mesh")
    del content["/mesh@sample_radius_m"]
    content = completed(content)
    content["/leak@certified"] = 1
    return of_content(content)


@vector("K3")
def leak() -> bytes:
    """The fixture leaks: two neighbours are 12 mm apart."""

    content = content_of("curve")
    content["/points"][5, 0] = content["/points"][4, 0] + 0.012
    content = completed(content)
    content["/leak@certified"] = 1
    return of_content(content)


@vector("K4")
def certificate_withheld() -> bytes:
    """The certificate is withheld."""
    return changed("curve", leak_at_certified=0)


@vector("K4")
def certified_cloud() -> bytes:
    """A bare cloud is called certified."""
    return changed("cloud", leak_at_certified=1)


# --- M: versions ------------------------------------------------------------------------------


@vector("M1")
def another_format() -> bytes:
    """It is another format."""
    return changed("minimal", root_at_format="vfplan-result")


@vector("M1")
def version_with_a_leading_zero() -> bytes:
    """The version has a leading zero."""
    return changed("minimal", root_at_version="2.00")


@vector("M2")
def next_major_version() -> bytes:
    """The major version is 3."""
    return changed("minimal", root_at_version="3.0")


@vector("M4")
def unknown_dataset() -> bytes:
    """A dataset of this version is unknown."""
    changed_items = items("minimal")
    item = Item(
        datatype=hdf5.DATATYPES["f8"], dataspace=hdf5.space_of((1,)), data=hdf5.floats([1.0])
    )
    add(changed_items, "/surprise", item)
    return of_items(changed_items)


@vector("M4")
def unknown_attribute() -> bytes:
    """An attribute of this version is unknown."""
    changed_items = items("minimal")
    set_attribute(changed_items["/provenance"], "surprise", "boo")
    return of_items(changed_items)


def later_items() -> dict[str, Item]:
    """The items of a sound file of a later minor version, with parts that this one lacks."""
    content = content_of("curve")
    content["/@version"] = "2.9"
    later = hdf5.items_of(content)
    item = Item(
        datatype=hdf5.DATATYPES["f8"], dataspace=hdf5.space_of((2,)), data=hdf5.floats([1.0, 2.0])
    )
    add(later, "/surprise", item)
    set_attribute(later["/points"], "colour", "red")
    return later


def newer_minor() -> bytes:
    """A sound file of a later minor version, with parts that this version does not know."""
    return of_items(later_items())


def quoted_setting() -> bytes:
    """A sound file with a setting's text that holds a double quote and a backslash."""
    return changed("curve", provenance__setting_values=('"a"b\\c"', "1e-05", "false"))
