"""Read a vfplan fixture bundle of version 2.x with Python's standard library alone.

    python vfplan_reader.py FILE

prints the values of a sound bundle as JSON, path by path, and exits 0. Of a file that breaks a rule
of the format it prints the rule and what is wrong to stderr, and exits 1. Signatures are not
verified: Python's standard library has no Ed25519.

Written from docs/format.md; the numbers of rules are those of that page.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import struct
import sys
from itertools import pairwise

# The table of section 2: path; type and shape; unit; frame; range; whether it must be there; mark.
ROWS = """
/ ; group ;  ;  ;  ; always
/@format ; text ;  ;  ; vfplan-fixture ; always
/@version ; text ;  ;  ;  ; always
/@frame ; text ;  ;  ; image | robot_base | patient_lps ; always ; rendered
/@id ; text ;  ;  ;  ; always
/@case ; text ;  ;  ;  ; optional ; reviewed
/@must_understand ; text ;  ;  ;  ; optional
/points ; f8 (N, 3) ; @frame ; @frame ; abs ≤ 100 m, abs ≤ 1e+06 px ; always ; rendered
/sigma ; f8 (N,) ; @frame ;  ; ≥ 0 ; optional
/curve ; group ;  ;  ;  ; optional
/curve/stroke ; i4 (N,) ; 1 ;  ; ≥ 0 ; group ; rendered
/curve/closed ; u1 (S,) ; 1 ;  ; ≤ 1 ; group ; rendered
/curve/bridged ; u1 (N,) ; 1 ;  ; ≤ 1 ; optional
/curve/edited ; u1 (N,) ; 1 ;  ; ≤ 1 ; optional
/pieces ; group ;  ;  ;  ; optional
/pieces/vertices ; f8 (V, 3) ; @frame ; @frame ; abs ≤ 100 m, abs ≤ 1e+06 px ; group ; rendered
/pieces/bulges ; f8 (V,) ; 1 ;  ; ≥ -1, ≤ 1 ; group ; rendered
/pieces/stroke ; i4 (V,) ; 1 ;  ; ≥ 0 ; group ; rendered
/pieces@error_m ; f8 ; m ;  ; ≥ 0, ≤ 0.0001 ; group ; reviewed
/mesh ; group ;  ;  ;  ; optional
/mesh/triangles ; i4 (K, 3) ; 1 ;  ; ≥ 0 ; group ; rendered
/mesh@sample_radius_m ; f8 ; m ;  ; > 0, ≤ 1 ; optional ; rendered
/image ; group ;  ;  ;  ; optional
/image@width_px ; i4 ; px ;  ; ≥ 1, ≤ 1e+06 ; group
/image@height_px ; i4 ; px ;  ; ≥ 1, ≤ 1e+06 ; group
/image/pixel_spacing ; f8 (2,) ; mm/px ; image ; > 0, ≤ 1000 ; optional
/rendering ; group ;  ;  ;  ; optional
/rendering/stiffness ; f8 (3,) ; N/m ; @frame ; ≥ 0, ≤ 1e+06 ; group ; rendered
/rendering/ignore_axis ; f8 (3,) ; 1 ; @frame ; ≥ -1, ≤ 1 ; optional ; rendered
/rendering@contact_radius_m ; f8 ; m ;  ; > 0, ≤ 1 ; group ; rendered
/rendering@band_m ; f8 ; m ;  ; > 0, ≤ 1 ; group ; rendered
/rendering@point_radius_m ; f8 ; m ;  ; ≥ 0, ≤ 1 ; group ; rendered
/rendering@max_iterations ; i4 ; 1 ;  ; ≥ 1, ≤ 10000 ; optional ; rendered
/rendering@robot ; text ;  ;  ;  ; optional ; reviewed
/rendering/stability ; f8 (7,) ; kg, N s/m, Hz, 1, N/m, N/m, 1 ;  ; ≥ 0 ; optional ; reviewed
/guidance ; group ;  ;  ;  ; optional
/guidance@radius_m ; f8 ; m ;  ; > 0, ≤ 1 ; group ; rendered
/guidance@stiffness_n_per_m ; f8 ; N/m ;  ; > 0, ≤ 1e+06 ; group ; rendered
/guidance@ends ; text ;  ;  ; stop | open ; group ; rendered
/guidance@lead_force_n ; f8 ; N ;  ; ≥ -1000, ≤ 1000 ; optional ; rendered
/guidance@lead_speed_m_s ; f8 ; m/s ;  ; > 0, ≤ 10 ; optional ; rendered
/guidance@stroke ; i4 ; 1 ;  ; ≥ 0, ≤ 99999 ; optional ; rendered
/registration ; group ;  ;  ;  ; optional
/registration@model ; text ;  ;  ; affine | similarity | rigid ; group ; reviewed
/registration@source_frame ; text ;  ;  ; image | patient_lps ; group ; reviewed
/registration@fre_rms_m ; f8 ; m ;  ; ≥ 0 ; group ; reviewed
/registration@loo_rms_m ; f8 ; m ;  ; ≥ 0 ; optional ; reviewed
/registration@tre_rms_m ; f8 ; m ;  ; ≥ 0 ; optional ; reviewed
/registration/T_robot_image ; f8 (Q, Q) ; m/@source_frame ; robot_base ;  ; group ; reviewed
/registration/labels ; text (M,) ;  ;  ;  ; group ; reviewed
/registration/source ; f8 (M, D) ; @source_frame ; @source_frame ; abs ≤ 100 m, abs ≤ 1e+06 px ; group ; reviewed
/registration/target ; f8 (M, 3) ; m ; robot_base ; abs ≤ 100 m ; group ; reviewed
/registration@tool ; text ;  ;  ;  ; optional ; reviewed
/registration/tip ; f8 (3,) ; m ; tool ; abs ≤ 100 m ; optional ; reviewed
/registration/residuals ; f8 (M,) ; m ;  ; ≥ 0 ; group ; reviewed
/registration/covariance ; f8 (U, U) ; T_robot_image^2 ;  ;  ; optional ; reviewed
/registration/tre ; f8 (N,) ; m ;  ; ≥ 0 ; optional ; reviewed
/leak ; group ;  ;  ;  ; optional
/leak@kind ; text ;  ;  ; curve | mesh | cloud ; group
/leak@certified ; u1 ; 1 ;  ; ≤ 1 ; group
/leak@largest_m ; f8 ; m ;  ; ≥ 0 ; group
/leak@limit_m ; f8 ; m ;  ; > 0 ; optional
/leak/place ; f8 (3,) ; @frame ; @frame ; abs ≤ 100 m ; group
/leak/open_ends ; f8 (E, 3) ; @frame ; @frame ; abs ≤ 100 m ; optional
/leak@between_m ; f8 ; m ;  ; ≥ 0 ; optional
/leak/between_place ; f8 (3,) ; @frame ; @frame ; abs ≤ 100 m ; optional
/leak@open_edges ; i4 ; 1 ;  ; ≥ 1 ; optional
/findings ; group ;  ;  ;  ; optional
/findings/code ; text (F,) ;  ;  ;  ; group ; reviewed
/findings/severity ; text (F,) ;  ;  ; note | doubt ; group ; reviewed
/findings/text ; text (F,) ;  ;  ;  ; group ; reviewed
/findings/stage ; text (F,) ;  ;  ;  ; group ; reviewed
/findings/has_place_px ; u1 (F,) ; 1 ;  ; ≤ 1 ; optional ; reviewed
/findings/place_px ; f8 (F, 2) ; px ; image ; abs ≤ 1e+06 px ; optional ; reviewed
/findings/has_place_m ; u1 (F,) ; 1 ;  ; ≤ 1 ; optional ; reviewed
/findings/place_m ; f8 (F, 3) ; m ; @frame ; abs ≤ 100 m ; optional ; reviewed
/findings/answered_by ; text (F,) ;  ;  ;  ; optional ; reviewed
/findings/answered_utc ; text (F,) ;  ;  ;  ; optional ; reviewed
/review ; group ;  ;  ;  ; optional
/review@by ; text ;  ;  ;  ; group
/review@utc ; text ;  ;  ;  ; group
/review@digest ; text ;  ;  ;  ; group
/provenance ; group ;  ;  ;  ; always
/provenance@created_utc ; text ;  ;  ;  ; always
/provenance@software ; text ;  ;  ;  ; always
/provenance/input_roles ; text (I,) ;  ;  ;  ; optional
/provenance/input_sha256 ; text (I,) ;  ;  ;  ; optional
/provenance/setting_names ; text (C,) ;  ;  ;  ; optional
/provenance/setting_values ; text (C,) ;  ;  ;  ; optional
/provenance/history ; text (H,) ;  ;  ;  ; optional
"""  # noqa: E501
# The second table of section 2: letters of shapes, and at most how much they stand for.
SIZES = (
    "N 4000000, S 100000, M 10000, D 3, Q 4, U 12, K 4000000, I 64, C 256, H 64, "
    "E 200000, V 1000000, F 1000"
)
LETTERS = {}
for _words in SIZES.split(", "):
    _letter, _largest = _words.split()
    LETTERS[_letter] = int(_largest)
MAX_PAYLOAD = 268_435_456  # bytes
MAX_TEXT = 4096  # bytes
MAX_ATTRIBUTES = 16
MAX_LINKS = 32
UNDEFINED = 2**64 - 1
GEOMETRY = ("/points", "/mesh/triangles", "/pieces/vertices", "/pieces/bulges", "/pieces/stroke")
# The hidden characters of V19, first and last of each range.
HIDDEN = []
for _words in [
    "0-1F",
    "7F-A0",
    "AD-AD",
    "34F-34F",
    "61C-61C",
    "115F-1160",
    "1680-1680",
    "17B4-17B5",
    "180B-180F",
    "2000-200F",
    "2028-202F",
    "205F-206F",
    "3000-3000",
    "3164-3164",
    "E000-F8FF",
    "FE00-FE0F",
    "FEFF-FEFF",
    "FFA0-FFA0",
    "FFF0-FFFB",
    "FFFE-FFFF",
    "E0000-10FFFF",
]:
    HIDDEN.append([int(word, 16) for word in _words.split("-")])
SEAL_LENGTHS = [512, 1024, 2048, 4096]  # bytes
END_OF_9999 = 253_402_300_799  # seconds since 1970 UTC
F8 = bytes.fromhex("11203f000800000000004000340b0034ff030000")
I4 = bytes.fromhex("100800000400000000002000")
U1 = bytes.fromhex("100000000100000000000800")
NUMBERS = {F8: ("f8", "d", 8), I4: ("i4", "i", 4), U1: ("u1", "B", 1)}
TIME = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z")
NAME = re.compile(r"[A-Za-z0-9_.-]+")
JSON_NUMBER = re.compile(r"-?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)?")


class FormatError(Exception):
    """The file breaks a rule of the format."""

    def __init__(self, rule, message):
        super().__init__(f"{rule}: {message}")


def require(condition, rule, message):
    """Refuse the file unless the condition is true."""
    if not condition:
        raise FormatError(rule, message)


class Row:
    """One line of the table."""

    def __init__(self, line):
        cells = [cell.strip() for cell in line.split(" ; ")]
        self.path, kind, self.unit, self.frame, self.range, self.required = cells[:6]
        self.is_marked = len(cells) == 7
        self.is_group = kind == "group"
        self.type, _, shape = kind.partition(" ")
        self.shape = [part.strip() for part in shape.strip("()").split(",") if part.strip()]
        self.is_attribute = "@" in self.path
        if self.is_attribute:
            before, _, self.name = self.path.partition("@")
            self.parent = before
        else:
            before, _, self.name = self.path.rpartition("/")
            self.parent = before or "/"


TABLE = {}
for _line in ROWS.strip().splitlines():
    _row = Row(_line)
    TABLE[_row.path] = _row


# --- The seal (section 4) ---------------------------------------------------------------------


def read_seal(data):
    """Check S1 to S6; returns the length of the payload, the seal's flags and its case."""
    length = len(data)
    require(data[:8] == b"\x89HDF\r\n\x1a\n", "S1", "the file does not begin as HDF5 does")
    require(length >= 560 and data[-8:] == b"VFPLTAIL", "S1", "its seal is missing")
    size, zero = struct.unpack_from("<II", data, length - 16)
    require(size in SEAL_LENGTHS and size <= length - 48, "S2", f"a seal of {size} bytes")
    end = length - size
    magic, version, flags, same_size, same_end, digest = struct.unpack_from("<8sHHIQ32s", data, end)
    require(magic == b"VFPLSEAL", "S2", "the seal does not begin as a seal does")
    require(version == 2, "S2", f"seal version {version}")
    require(same_size == size and same_end == end and zero == 0, "S2", "its lengths differ")
    signed_at, case, serial = struct.unpack_from("<QHH", data, end + 136)
    texts_end = 148 + case + serial
    require(texts_end + 48 <= size, "S3", "the texts do not fit")
    shortest = min(length for length in SEAL_LENGTHS if texts_end + 48 <= length)
    require(size == shortest, "S3", "the seal is longer than its texts need")
    require(not any(data[end + texts_end : length - 48]), "S3", "bytes behind the texts")
    require(flags <= 3, "S3", "an unknown flag")
    for text in (data[end + 148 : end + 148 + case], data[end + 148 + case : end + texts_end]):
        decoded(text, "S3")
    sealed = hashlib.sha256(data[end : length - 48]).digest()
    require(sealed == data[length - 48 : length - 16], "S4", "the seal is damaged")
    if not flags & 1:
        blank = not any(data[end + 56 : length - 48]) and not flags & 2
        require(blank, "S5", "an unsigned seal holds what only a signature covers")
    require(signed_at <= END_OF_9999, "S5", "signed after the year 9999")
    require(hashlib.sha256(data[:end]).digest() == digest, "S6", "the bytes are not those sealed")
    return end, flags, decoded(data[end + 148 : end + 148 + case], "S3")


def decoded(raw, rule="L6"):
    """A text without control characters."""
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        raise FormatError(rule, "a text is not UTF-8") from None
    for character in text:
        code = ord(character)
        require(code >= 0x20 and not 0x7F <= code <= 0x9F, rule, "a control character")
    return text


# --- The payload (section 1) ------------------------------------------------------------------


def lookup3(data):
    """Bob Jenkins' hash `hashlittle` with the initial value 0."""
    mask = 0xFFFFFFFF

    def rotate(x, k):
        return ((x << k) | (x >> (32 - k))) & mask

    length = len(data)
    a = b = c = (0xDEADBEEF + length) & mask
    at = 0
    while length - at > 12:
        x, y, z = struct.unpack_from("<III", data, at)
        a, b, c = (a + x) & mask, (b + y) & mask, (c + z) & mask
        a = ((a - c) & mask) ^ rotate(c, 4)
        c = (c + b) & mask
        b = ((b - a) & mask) ^ rotate(a, 6)
        a = (a + c) & mask
        c = ((c - b) & mask) ^ rotate(b, 8)
        b = (b + a) & mask
        a = ((a - c) & mask) ^ rotate(c, 16)
        c = (c + b) & mask
        b = ((b - a) & mask) ^ rotate(a, 19)
        a = (a + c) & mask
        c = ((c - b) & mask) ^ rotate(b, 4)
        b = (b + a) & mask
        at += 12
    if at == length:
        return c
    x, y, z = struct.unpack("<III", bytes(data[at:]).ljust(12, b"\0"))
    a, b, c = (a + x) & mask, (b + y) & mask, (c + z) & mask
    c = ((c ^ b) - rotate(b, 14)) & mask
    a = ((a ^ c) - rotate(c, 11)) & mask
    b = ((b ^ a) - rotate(a, 25)) & mask
    c = ((c ^ b) - rotate(b, 16)) & mask
    a = ((a ^ c) - rotate(c, 4)) & mask
    b = ((b ^ a) - rotate(a, 14)) & mask
    return ((c ^ b) - rotate(b, 24)) & mask


class Object:
    """A group or dataset: its attributes, links, and the bodies of its other messages."""

    def __init__(self):
        self.attributes = {}
        self.links = {}
        self.messages = {}

    @property
    def is_group(self):
        """Whether it is a group; else it is a dataset."""
        return 0x02 in self.messages


class Value:
    """What an attribute or dataset holds."""

    def __init__(self, type_, shape, items):
        self.type, self.shape, self.items = type_, shape, items

    def nested(self):
        """A scalar, or nested lists."""
        if not self.shape:
            return self.items[0]
        if len(self.shape) == 1:
            return list(self.items)
        width = self.shape[1]
        return [list(self.items[i : i + width]) for i in range(0, len(self.items), width)]

    def rows(self):
        """The rows of a table of two dimensions."""
        return self.nested()


class Payload:
    """The HDF5 file in front of the seal."""

    def __init__(self, data, end):
        self.data, self.end = data, end
        self.spans = [(0, 48)]
        self.addresses = set()
        require(end <= MAX_PAYLOAD, "C4", f"{end} bytes")
        require(end % 8 == 0, "L9", "the payload's length is no multiple of 8")
        head = struct.unpack_from("<8sBBBBQQQQI", data, 0)
        _, version, offsets, lengths, flags, base, extension, stated, root, checksum = head
        is_known = (version, offsets, lengths, flags, base, extension) == (2, 8, 8, 0, 0, UNDEFINED)
        require(is_known, "L1", "a superblock of another kind")
        require(stated == len(data), "L2", f"its end of file is {stated}")
        require(checksum == lookup3(data[:44]), "L2", "the superblock's checksum differs")
        self.root = root

    def take(self, first, length):
        """Bytes that belong to one object."""
        inside = first >= 48 and length <= self.end and first + length <= self.end
        require(inside, "L8", "an address or length outside of the payload")
        self.spans.append((first, first + length))
        return self.data[first : first + length]

    def enter_address(self, address):
        """Enter where a link leads: no other link may lead there."""
        require(address not in self.addresses, "L5", "two links lead to one object")
        self.addresses.add(address)

    def object_at(self, address):
        """The object whose header is at an address."""
        self.enter_address(address)
        require(48 <= address <= self.end - 16, "L8", "an object outside of the payload")
        require(self.data[address : address + 5] == b"OHDR\x02", "L3", "no header of version 2")
        flags = self.data[address + 5]
        require(not flags & 0xCC, "L5", "a creation order")
        width = 1 << (flags & 3)
        front = 6 + 16 * bool(flags & 0x20) + 4 * bool(flags & 0x10)
        size = int.from_bytes(self.data[address + front : address + front + width], "little")
        front += width
        block = self.take(address, front + size + 4)
        result = Object()
        blocks = [block_body(block, front)]
        while blocks:
            for kind, body in messages_of(blocks.pop(0)):
                if kind == 0x10:
                    require(len(body) == 16, "L3", "a continuation of another size")
                    first, length = struct.unpack("<QQ", body)
                    more = self.take(first, length)
                    require(length >= 8 and more[:4] == b"OCHK", "L3", "no continuation")
                    blocks.append(block_body(more, 4))
                else:
                    self.enter(result, kind, body)
        require(len(result.links) <= MAX_LINKS, "L5", "too many links")
        require(len(result.attributes) <= MAX_ATTRIBUTES, "L5", "too many attributes")
        types = result.messages.keys()
        is_group = {0x02} <= types and not types & {0x01, 0x03, 0x05, 0x08}
        is_dataset = {0x01, 0x03, 0x08} <= types and not types & {0x02, 0x0A}
        is_dataset = is_dataset and not result.links
        require(is_group or is_dataset, "L3", "neither a group nor a dataset")
        return result

    def enter(self, owner, kind, body):
        """Enter a message of a header into the object that the header belongs to."""
        if kind == 0x00:
            require(not any(body), "L9", "an empty message is not zero")
        elif kind == 0x06:
            name, address = hard_link(body)
            require(name not in owner.links, "L5", f"two links {name!r}")
            owner.links[name] = address
        elif kind == 0x0C:
            name, value = attribute(body)
            require(name not in owner.attributes, "C1", f"two attributes {name!r}")
            owner.attributes[name] = value
        elif kind in (0x02, 0x15):
            is_compact = body == b"\0\0" + b"\xff" * 16
            require(is_compact, "L5", "links or attributes in a heap, or with a creation order")
            require(kind not in owner.messages, "L3", "a message twice")
            owner.messages[kind] = body
        elif kind == 0x0A:
            known = body[:1] == b"\0" and len(body) >= 2 and body[1] <= 3
            known = known and len(body) == 2 + 4 * (body[1] & 1) + 2 * (body[1] & 2)
            require(known, "L3", "a group info of another kind")
            require(kind not in owner.messages, "L3", "a message twice")
            owner.messages[kind] = body
        elif kind in (0x01, 0x03, 0x05, 0x08):
            require(kind not in owner.messages, "L3", "a message twice")
            owner.messages[kind] = body
        else:
            raise FormatError("L3", f"a header message of kind {kind}")

    def dataset_value(self, dataset):
        """The value of a dataset."""
        messages = dataset.messages
        layout = messages[0x08]
        require(layout[:2] == b"\x03\x01" and len(layout) == 18, "L4", "not in one piece")
        address, size = struct.unpack_from("<QQ", layout, 2)
        require(address != UNDEFINED, "L4", "no data")
        type_, item, shape = type_and_shape(messages[0x03], messages[0x01])
        if 0x05 in messages:
            check_fill(messages[0x05], item)
        require(shape != (), "C1", "a scalar dataset")
        require(math.prod(shape) * item == size, "L4", "its size is not that of its shape")
        return value_of(type_, item, shape, self.take(address, size))

    def check_spans(self, check_gaps):
        """L8 and L9: no byte belongs to two objects, and those that belong to none are zero.

        check_gaps: whether L9 is checked, which needs every object to be known
        """
        last = 0
        for first, end in sorted(self.spans):
            require(first >= last, "L8", f"byte {first} belongs to two objects")
            if check_gaps:
                gap = self.data[last:first]
                require(not any(gap), "L9", f"bytes from {last} belong to no object")
            last = end
        if check_gaps:
            gap = self.data[last : self.end]
            require(not any(gap), "L9", f"bytes from {last} belong to no object")


def block_body(block, front):
    """The messages' bytes of a header's block whose checksum holds."""
    require(struct.unpack("<I", block[-4:])[0] == lookup3(block[:-4]), "L3", "a checksum differs")
    return block[front:-4]


def messages_of(body):
    """(kind, body) of the messages of a block."""
    at = 0
    has_empty = False
    while len(body) - at >= 4:
        kind, size, flags = struct.unpack_from("<BHB", body, at)
        at += 4
        require(not flags & ~5, "L3", f"a message with flags {flags}")
        require(at + size <= len(body), "L3", "a message that leaves its header")
        has_empty = has_empty or kind == 0
        yield kind, body[at : at + size]
        at += size
    gap = body[at:]
    require(not any(gap), "L9", "a gap is not zero")
    require(not (gap and has_empty), "L3", "a gap beside an empty message")


def hard_link(body):
    """Name and address of a link's message."""
    try:
        version, flags = body[0], body[1]
        require(version == 1, "L5", "a link of another version")
        require(not flags & 0xE4, "L5", "a link with a creation order")
        at = 2
        if flags & 0x08:
            require(body[at] == 0, "L5", "a link that is not hard")
            at += 1
        if flags & 0x10:
            require(body[at] <= 1, "L6", "a name in an unknown encoding")
            at += 1
        width = 1 << (flags & 3)
        size = int.from_bytes(body[at : at + width], "little")
        at += width
        require(len(body) == at + size + 8, "L5", "a link of another size")
        return name_of(body[at : at + size]), struct.unpack_from("<Q", body, at + size)[0]
    except (IndexError, struct.error):
        raise FormatError("L5", "a link of another size") from None


def name_of(data):
    """The name of a link or an attribute."""
    name = decoded(data)
    require(name != "" and "/" not in name, "L6", f"a name {name!r}")
    return name


def attribute(body):
    """Name and parts (datatype, dataspace, bytes) of an attribute's message."""
    require(len(body) >= 9 and body[0] == 3 and body[1] == 0, "L3", "an attribute of another kind")
    name_size, type_size, space_size = struct.unpack_from("<HHH", body, 2)
    require(body[8] <= 1, "L6", "a name in an unknown encoding")
    at = 9
    name = body[at : at + name_size]
    require(name.endswith(b"\0"), "L6", "a name without an end")
    at += name_size
    datatype = body[at : at + type_size]
    at += type_size
    dataspace = body[at : at + space_size]
    at += space_size
    return name_of(name[:-1]), (datatype, dataspace, body[at:])


def attribute_value(parts):
    """The value of an attribute, a scalar."""
    datatype, dataspace, raw = parts
    type_, item, shape = type_and_shape(datatype, dataspace)
    require(shape == (), "L7", "an attribute is not a scalar")
    require(len(raw) == item, "L3", "an attribute of another size")
    return value_of(type_, item, shape, raw)


def type_and_shape(datatype, dataspace):
    """(type, bytes of an item, shape)."""
    code = bytes(datatype)
    if code[:1] == b"\x13" and len(code) >= 8:
        bits, item = code[1], struct.unpack_from("<I", code, 4)[0]
        utf8 = bits in (0x00, 0x01, 0x10, 0x11) and code[2:4] == b"\0\0" and len(code) == 8
        require(utf8, "L7", "a text padded with blanks, or in an unknown encoding")
        require(1 <= item <= MAX_TEXT, "L6", f"a text of {item} bytes")
        type_ = "text"
    else:
        require(code in NUMBERS, "L7", "a type that is none of f8, i4, u1 and text")
        type_, _, item = NUMBERS[code]
    require(len(dataspace) >= 4 and dataspace[0] == 2, "L3", "a dataspace of another kind")
    rank, flags, kind = dataspace[1:4]
    is_array = int(rank > 0)
    require(rank <= 2 and flags <= 1 and kind == is_array, "C1", "another rank")
    require(rank or not flags, "C1", "a scalar with a maximal shape")
    # A maximal shape may stand behind the shape.
    count = rank
    if flags:
        count = 2 * rank
    require(len(dataspace) == 4 + 8 * count, "L3", "a dataspace of another size")
    sizes = struct.unpack_from(f"<{count}Q", dataspace, 4)
    require(sizes[:rank] == sizes[count - rank :], "L4", "it can grow")
    require(all(size >= 1 for size in sizes), "L10", "a table without rows")
    require(all(size <= MAX_PAYLOAD for size in sizes), "C4", "a table too large")
    return type_, item, sizes[:rank]


def value_of(type_, item, shape, raw):
    """The value that bytes hold."""
    if type_ == "text":
        texts = []
        for first in range(0, len(raw), item):
            texts.append(decoded(raw[first : first + item].rstrip(b"\0")))
        return Value(type_, shape, texts)
    code = next(code for name, code, _ in NUMBERS.values() if name == type_)
    return Value(type_, shape, struct.unpack(f"<{len(raw) // item}{code}", raw))


def check_fill(body, item):
    """A fill value is zero."""
    require(body[:1] == b"\x03" and len(body) >= 2, "L3", "a fill value of another kind")
    flags = body[1]
    require(not flags & 0xC0 and flags & 0x30 != 0x30, "L4", "a fill value with unknown flags")
    value = b""
    if flags & 0x20:
        require(len(body) >= 6, "L3", "a fill value of another size")
        size = struct.unpack_from("<I", body, 2)[0]
        value = body[6:]
        require(len(value) == size and size in (0, item), "L3", "a fill value of another size")
    else:
        require(len(body) == 2, "L3", "a fill value of another size")
    require(not any(value), "L4", "a fill value is not zero")


# --- The content (section 2) ------------------------------------------------------------------


def read_content(payload):
    """The values of all known paths, and whether the file held unknown names."""
    objects = {"/": payload.object_at(payload.root)}
    root = objects["/"]
    require(root.is_group, "L3", "the root is no group")
    head = {}
    for name in ("format", "version"):
        require(name in root.attributes, "M1", f"/@{name} is missing")
        head[name] = attribute_value(root.attributes[name])
        require(head[name].type == "text", "M1", f"/@{name} is no text")
    require(head["format"].items[0] == "vfplan-fixture", "M1", "another format")
    version = re.fullmatch(r"(0|[1-9][0-9]*)\.(0|[1-9][0-9]*)", head["version"].items[0], re.ASCII)
    require(version, "M1", "a version of another form")
    require(version[1] == "2", "M2", f"version {version[0]}; this program reads 2.x")
    newer = int(version[2]) > 0
    content, has_unknown = {}, False
    waiting = ["/"]
    while waiting:
        path = waiting.pop(0)
        item = objects[path]
        if item.is_group:
            require(path == "/" or item.links or item.attributes, "L10", f"{path} is empty")
        for name, address in item.links.items():
            inner = path.rstrip("/") + "/" + name
            if inner not in TABLE or TABLE[inner].is_attribute:
                require(newer, "M4", f"{inner} is unknown")
                payload.enter_address(address)
                has_unknown = True
                continue
            objects[inner] = payload.object_at(address)
            require(objects[inner].is_group == TABLE[inner].is_group, "C1", f"{inner}: its kind")
            waiting.append(inner)
        if item.is_group:
            for name, parts in item.attributes.items():
                inner = path + "@" + name
                if inner not in TABLE:
                    require(newer, "M4", f"{inner} is unknown")
                    continue
                content[inner] = attribute_value(parts)
        else:
            content[path] = payload.dataset_value(item)
    payload.check_spans(check_gaps=not has_unknown)
    check_table(content, objects, newer)
    return content


def check_table(content, objects, newer):
    """C1 to C4."""
    for row in TABLE.values():
        is_held = row.path in content
        if row.is_group:
            is_held = row.path in objects
        needed = row.required == "always" or (row.required == "group" and row.parent in objects)
        require(is_held or not needed, "C1", f"{row.path} is missing")
    frame = text_of(content, "/@frame")
    source = text_of(content, "/registration@source_frame")
    units = {"image": "px", "robot_base": "m", "patient_lps": "m"}
    sizes = {}
    if source == "image":
        sizes = {"D": 2, "Q": 3}
    elif source is not None:
        sizes = {"D": 3, "Q": 4}
    for path, value in content.items():
        row = TABLE[path]
        require(value.type == row.type, "C1", f"{path} is of another type")
        require(len(value.shape) == len(row.shape), "C1", f"{path} has another rank")
        for size, wanted in zip(value.shape, row.shape, strict=True):
            if wanted.isdigit():
                require(size == int(wanted), "C1", f"{path} has {size} for {wanted}")
                continue
            require(size <= LETTERS[wanted], "C4", f"{path}: {wanted} is {size}")
            known = sizes.setdefault(wanted, size)
            require(known == size, "C4", f"{path}: {wanted} is {size} here and {known} elsewhere")
        unit = row.unit.replace("@source_frame", units.get(source, ""))
        unit = unit.replace("@frame", units.get(frame, ""))
        if not row.is_attribute:
            wanted_frame = {"@frame": frame, "@source_frame": source}.get(row.frame, row.frame)
            check_unit_and_frame(path, objects[path], unit, wanted_frame, newer)
        check_range(path, row, value, unit)


def check_unit_and_frame(path, dataset, unit, frame, newer):
    """C2."""
    wanted = {}
    if unit:
        wanted["unit"] = unit
    if frame:
        wanted["frame"] = frame
    for name, text in wanted.items():
        require(name in dataset.attributes, "C2", f"{path} has no {name}")
        value = attribute_value(dataset.attributes[name])
        same = value.type == "text" and value.items[0] == text
        require(same, "C2", f"{path}: its {name} is not {text!r}")
    for name in dataset.attributes:
        require(name in wanted or newer, "C2", f"{path} has an attribute {name!r}")


def check_range(path, row, value, unit):
    """C3."""
    if value.type == "text":
        if row.range:
            allowed = [word.strip() for word in row.range.split("|")]
            require(all(t in allowed for t in value.items), "C3", f"{path} is none of {allowed}")
        return
    require(all(map(math.isfinite, value.items)), "C3", f"{path} is not finite")
    low, high = min(value.items), max(value.items)
    for part in filter(None, row.range.split(", ")):
        words = part.split()
        if words[0] == "abs":
            if words[3] == unit:
                limit = float(words[2])
                require(-limit <= low and high <= limit, "C3", f"{path} is beyond {limit} {unit}")
            continue
        limit = float(words[1])
        kept = {"≥": low >= limit, "≤": high <= limit, ">": low > limit}[words[0]]
        require(kept, "C3", f"{path} is not {part}")


def text_of(content, path):
    """A text attribute, or `None`."""
    if path not in content:
        return None
    return content[path].items[0]


# --- Values that fit together (section 3) -----------------------------------------------------


def check_agreement(content, raw_bytes, flags, signed_case):
    """V1 to V20, K1 to K4, S8 and S10."""
    groups = {TABLE[path].parent for path in content if TABLE[path].parent != "/"}

    def number(path):
        return content[path].items[0]

    def has(path):
        return path in content or path in groups

    for path in (text_of(content, "/@must_understand") or "").split(" "):
        require(path == "" or path in TABLE, "V1", f"{path} must be understood")
    frame = text_of(content, "/@frame")
    excluded = {
        "image": ("/rendering", "/guidance", "/registration", "/mesh", "/findings/place_m"),
        "patient_lps": ("/image", "/registration"),
        "robot_base": (),
    }
    for path in excluded[frame]:
        require(not has(path), "V2", f"{path} in the frame {frame}")
    require(not (has("/mesh") and has("/curve")), "V2", "a mesh beside a curve")
    points = content["/points"].rows()
    if frame == "image":
        require(all(point[2] == 0 for point in points), "V3", "a point with a depth")
    geometry = geometry_digest(content, frame, raw_bytes)
    require(text_of(content, "/@id") == geometry.hex()[:32], "V4", "the id of another geometry")
    if has("/curve"):
        check_strokes("V5", content["/curve/stroke"].items, len(content["/curve/closed"].items))
    if has("/pieces"):
        together = has("/curve") and "/rendering/ignore_axis" in content
        require(together, "V6", "/pieces without /curve or an axis")
        check_strokes("V6", content["/pieces/stroke"].items, len(content["/curve/closed"].items))
    if has("/mesh"):
        named = set(content["/mesh/triangles"].items)
        require(named == set(range(len(points))), "V8", "triangles of other points")
    axis = None
    if has("/rendering"):
        if "/rendering/ignore_axis" in content:
            axis = content["/rendering/ignore_axis"].items
            require(abs(math.hypot(*axis) - 1) <= 1e-9, "V9", "the axis has another length than 1")
        radius = number("/rendering@contact_radius_m") + number("/rendering@point_radius_m")
        require(number("/rendering@band_m") < radius, "V9", "the band is as wide as R")
        check_stability(content, axis)
    if has("/guidance"):
        check_guidance(content, has)
    if has("/registration"):
        check_registration(content, points)
    if has("/findings"):
        check_findings(content)
    if has("/review"):
        check_plain(text_of(content, "/review@by"), "V15")
        digest = text_of(content, "/review@digest")
        require(re.fullmatch("[0-9a-f]{64}", digest), "V15", "a digest of another form")
        require(
            digest == review_digest(content, geometry, raw_bytes), "V20", "a review of another plan"
        )
        check_time(text_of(content, "/review@utc"))
    own_case = text_of(content, "/@case")
    if own_case is not None:
        check_plain(own_case, "V19")
    check_time(text_of(content, "/provenance@created_utc"))
    check_provenance(content)
    require(has("/leak") == has("/rendering"), "V18", "/leak and /rendering without each other")
    if has("/leak"):
        check_leak(content, points, axis, has)
    if has("/pieces"):
        check_pieces(content, points, axis)
    if flags & 1:
        is_open = not has("/review") or has_open_doubt(content)
        require(bool(flags & 2) == is_open, "S8", "the seal does not say what is open")
        require(own_case in (None, signed_case), "S10", "signed for another case")


def check_plain(text, rule):
    """Text that can be read off a page as it is."""
    is_plain = text != "" and text == text.strip(" ")
    for character in text:
        code = ord(character)
        is_plain = is_plain and not any(first <= code <= last for first, last in HIDDEN)
    require(is_plain, rule, f"{text!r} is empty or holds hidden characters")


def review_digest(content, geometry, raw_bytes):
    """The digest of V20: of every marked value that is there."""

    def number(n):
        return struct.pack("<Q", n)

    def text(t):
        return number(len(t.encode())) + t.encode()

    digest = hashlib.sha256(text("vfplan review 1") + geometry)
    for path in sorted(content):
        if not TABLE[path].is_marked:
            continue
        value = content[path]
        digest.update(text(path) + text(value.type))
        digest.update(b"".join(map(number, [len(value.shape), *value.shape])))
        if value.type == "text":
            digest.update(b"".join(map(text, value.items)))
        elif path not in GEOMETRY:
            digest.update(raw_bytes(value))
    return digest.hexdigest()


def geometry_digest(content, frame, raw_bytes):
    """The digest of V4."""
    digest = hashlib.sha256(frame.encode() + b"\0")
    for path in GEOMETRY:
        if path in content:
            digest.update(raw_bytes(content[path]))
    return digest.digest()


def check_strokes(rule, stroke, count):
    """The numbers start at 0, grow by 0 or 1, and end at the last stroke."""
    counts = stroke[0] == 0 and stroke[-1] == count - 1
    for before, after in pairwise(stroke):
        counts = counts and after - before in (0, 1)
    require(counts, rule, "strokes do not count 0, 1, ...")


def check_stability(content, axis):
    """V10."""
    names = ("/rendering@robot", "/rendering/stability")
    require((names[0] in content) == (names[1] in content), "V10", "a robot without a verdict")
    if names[1] not in content:
        return
    stiffness = largest_eigenvalue(content["/rendering/stiffness"].items, axis)
    rendered = stiffness
    if "/guidance@radius_m" in content:
        rendered = content["/guidance@stiffness_n_per_m"].items[0]
        if "/guidance@stroke" in content:
            rendered += stiffness
    judged, stable, margin = content[names[1]].items[4:]
    require(abs(judged - rendered) <= 1e-6 * rendered, "V10", "about another stiffness")
    require(judged * margin <= stable * (1 + 1e-6), "V10", "it is not stable with its margin")


def largest_eigenvalue(diagonal, axis):
    """Of P K P, with P the projection across the axis."""
    if axis is None:
        return max(diagonal)
    A = [[0.0] * 3, [0.0] * 3, [0.0] * 3]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                A[i][j] += (
                    ((i == k) - axis[i] * axis[k]) * diagonal[k] * ((k == j) - axis[k] * axis[j])
                )
    # One eigenvalue is 0; the other two have this sum and this product.
    trace = A[0][0] + A[1][1] + A[2][2]
    minors = 0.0
    for i, j in ((0, 1), (0, 2), (1, 2)):
        minors += A[i][i] * A[j][j] - A[i][j] * A[j][i]
    return trace / 2 + math.sqrt(max(trace * trace / 4 - minors, 0.0))


def check_guidance(content, has):
    """V11."""
    require(has("/curve") and has("/rendering"), "V11", "a guide without curve or rendering")
    names = (text_of(content, "/@must_understand") or "").split(" ")
    require("/guidance" in names, "V11", "/guidance is not named in must_understand")
    if "/guidance@stroke" in content:
        count = len(content["/curve/closed"].items)
        stroke = content["/guidance@stroke"].items[0]
        require(count >= 2 and stroke < count, "V11", "a stroke guides that is not there")


def check_registration(content, points):
    """V12 and V13."""
    T = content["/registration/T_robot_image"].rows()
    source = content["/registration/source"].rows()
    target = content["/registration/target"].rows()
    labels = content["/registration/labels"].items
    require(len(set(labels)) == len(labels) and "" not in labels, "V12", "labels twice or empty")
    if len(T) == 4:
        require(T[3] == [0, 0, 0, 1], "V12", "the last row is not 0 0 0 1")
    if "/registration/covariance" in content:
        covariance = content["/registration/covariance"].rows()
        require(len(covariance) == 3 * len(T), "V12", "a covariance of other parameters")
        for i, row in enumerate(covariance):
            require(row[i] >= 0, "V12", "a negative variance")
    residuals = content["/registration/residuals"].items
    for place, wanted, stated in zip(source, target, residuals, strict=True):
        vector = [*place, 1.0]
        mapped = [dot(T[i], vector) for i in range(3)]
        require(abs(math.dist(mapped, wanted) - stated) <= 1e-6, "V13", "other residuals")
    if len(T) == 3:
        u, v, origin = ([T[i][j] for i in range(3)] for j in range(3))
        normal = cross(u, v)
        length = math.hypot(*normal)
        require(length > 0, "V13", "the transform flattens the slice")
        for point in points:
            offset = [p - o for p, o in zip(point, origin, strict=True)]
            height = dot(normal, offset) / length
            require(abs(height) <= 1e-6, "V13", "a point beside the slice's plane")


def check_findings(content):
    """V14."""
    for unit in ("px", "m"):
        flag, place = f"/findings/has_place_{unit}", f"/findings/place_{unit}"
        require((flag in content) == (place in content), "V14", f"{flag} without its places")
        if flag in content:
            for has_place, row in zip(content[flag].items, content[place].rows(), strict=True):
                require(has_place or not any(row), "V14", "a place of a finding without one")
    by, utc = "/findings/answered_by", "/findings/answered_utc"
    require((by in content) == (utc in content), "V14", "an answer without a time")
    if by in content:
        for who, when in zip(content[by].items, content[utc].items, strict=True):
            require((who == "") == (when == ""), "V14", "answered by somebody at no time")
            if when:
                check_time(when)
                check_plain(who, "V14")
    for name in ("code", "stage"):
        for text in content["/findings/" + name].items:
            require(NAME.fullmatch(text), "V14", f"a {name} of another form")


def has_open_doubt(content):
    """Whether a doubt is not answered."""
    if "/findings/severity" not in content:
        return False
    severities = content["/findings/severity"].items
    answered = [""] * len(severities)
    if "/findings/answered_by" in content:
        answered = content["/findings/answered_by"].items
    for severity, who in zip(severities, answered, strict=True):
        if severity == "doubt" and not who:
            return True
    return False


def check_time(text):
    """V16."""
    require(TIME.fullmatch(text), "V16", f"{text!r} is no time")


def check_provenance(content):
    """V17."""
    inside = "/provenance/"
    for a, b in (("input_roles", "input_sha256"), ("setting_names", "setting_values")):
        together = (inside + a in content) == (inside + b in content)
        require(together, "V17", f"{a} and {b} without each other")
        if inside + a in content:
            names = content[inside + a].items
            require(len(set(names)) == len(names), "V17", "a name twice")
            require(all(map(NAME.fullmatch, names)), "V17", "a name of another form")
    if inside + "input_sha256" in content:
        for digest in content[inside + "input_sha256"].items:
            require(re.fullmatch("[0-9a-f]{64}", digest), "V17", "a digest of another form")
    if inside + "setting_values" in content:
        for value in content[inside + "setting_values"].items:
            quoted = len(value) >= 2 and value[0] == value[-1] == '"'
            number = JSON_NUMBER.fullmatch(value) and math.isfinite(float(value))
            known = value in ("true", "false") or number or quoted
            require(known, "V17", f"a setting's value {value!r}")


# --- The leak certificate (section 5), and the pieces (V7) ------------------------------------


def check_leak(content, points, axis, has):
    """K1 to K4."""
    kind = "cloud"
    if has("/mesh"):
        kind = "mesh"
    elif has("/curve"):
        kind = "curve"
    require(text_of(content, "/leak@kind") == kind, "K1", f"it is a {kind}")
    certified = content["/leak@certified"].items[0]
    require(certified == (kind != "cloud"), "K4", f"certified is {certified}")
    if kind == "cloud":
        require("/leak@limit_m" not in content, "K2", "the limit of a cloud")
        return
    radius = content["/rendering@contact_radius_m"].items[0]
    radius += content["/rendering@point_radius_m"].items[0]
    limit = radius - content["/rendering@band_m"].items[0]
    flat = [across(point, axis) for point in points]
    if kind == "mesh":
        triangles = content["/mesh/triangles"].rows()
        openings = [covering_radius(*(flat[i] for i in row)) for row in triangles]
        if "/mesh@sample_radius_m" in content:
            openings = [min(max(openings), content["/mesh@sample_radius_m"].items[0])]
    else:
        limit *= 2
        openings = [0.0]
        for stroke, closed in zip(
            strokes(content, "/curve/stroke"), closed_of(content), strict=True
        ):
            places = [flat[i] for i in stroke]
            openings += [math.dist(a, b) for a, b in pairwise(places)]
            if closed:
                openings.append(math.dist(places[-1], places[0]))
    require("/leak@limit_m" in content, "K2", "no limit")
    for name, computed in (("limit_m", limit), ("largest_m", max(openings))):
        stated = content["/leak@" + name].items[0]
        close = abs(stated - computed) <= max(1e-9 * computed, 1e-12)
        require(close, "K2", f"{name} is {stated}; the fixture gives {computed}")
    require(content["/leak@largest_m"].items[0] <= content["/leak@limit_m"].items[0], "K3", "leaks")


def strokes(content, path):
    """The row numbers of each stroke."""
    rows = {}
    for row, stroke in enumerate(content[path].items):
        rows.setdefault(stroke, []).append(row)
    return list(rows.values())


def closed_of(content):
    """Which strokes are closed."""
    return content["/curve/closed"].items


def across(point, axis):
    """A point without its part along the axis."""
    if axis is None:
        return tuple(point)
    along = dot(axis, point)
    return tuple(p - along * a for a, p in zip(axis, point, strict=True))


def covering_radius(p, q, r):
    """The largest distance of a triangle's point from its nearest corner."""
    a, b, c = sorted((math.dist(p, q), math.dist(q, r), math.dist(r, p)))
    if c == 0:
        return 0.0
    if a * a + b * b <= c * c:
        return b * b * c / (b * b + c * c - a * a)
    s = math.sqrt((a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)))  # 4 area
    if s == 0:
        return c / 2
    return a * b * c / s


def dot(a, b):
    """The scalar product."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a, b):
    """The vector product."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def check_pieces(content, points, axis):
    """V7."""
    radius = content["/rendering@contact_radius_m"].items[0]
    radius += content["/rendering@point_radius_m"].items[0]
    e = min(0.01 * radius, 1e-4)
    require(content["/pieces@error_m"].items[0] <= e, "V7", "the pieces are coarse")
    t = content["/pieces@error_m"].items[0] + 1e-6
    w = 2 * (content["/leak@largest_m"].items[0] + t)
    smallest = min(range(3), key=lambda i: abs(axis[i]))
    first = cross(axis, [float(i == smallest) for i in range(3)])
    first = [x / math.hypot(*first) for x in first]
    second = cross(axis, first)

    def flat(point):
        return dot(first, point), dot(second, point)

    vertices = [flat(vertex) for vertex in content["/pieces/vertices"].rows()]
    bulges = content["/pieces/bulges"].items
    of_points = strokes(content, "/curve/stroke")
    of_vertices = strokes(content, "/pieces/stroke")
    for rows, corners, closed in zip(of_points, of_vertices, closed_of(content), strict=True):
        pairs = list(pairwise(corners))
        if closed:
            pairs.append((corners[-1], corners[0]))
        pieces = []
        for a, b in pairs:
            pieces.append(Piece(vertices[a], vertices[b], bulges[a]))
        if len(corners) == 1 and not closed:
            pieces = [Piece(vertices[corners[0]], vertices[corners[0]], 0.0)]
        places = [flat(points[row]) for row in rows]
        if closed:
            starts = []
            for k, piece in enumerate(pieces):
                distance, arc = piece.foot(places[0])
                if distance <= t and len(starts) < 8:
                    starts.append((k, arc))
        else:
            starts = [(0, 0.0)]
        leads = any(walks(pieces, closed, start, places, t, w, e) for start in starts)
        require(leads, "V7", "the pieces are not the curve of the points")


def walks(pieces, closed, start, places, t, w, e):
    """Whether the walk of V7 reaches the end of a stroke."""
    current, arc = start
    remaining = sum(piece.length for piece in pieces)
    entries = len(pieces)
    # A closed stroke leads back to its first point.
    targets = [*places, places[0]] if closed else places
    for i, place in enumerate(targets):
        before, longest, h = place, t + e, math.inf
        if i > 0:
            before, longest = targets[i - 1], w
            bend = max(tangent_of_turn(places, closed, k) for k in (i - 1, i))
            h = e + t + math.dist(before, place) / 2 * bend
        # Parts of pieces that the step goes along: (piece, from, to).
        parts = []
        distance, next_arc = pieces[current].foot(place)
        step = next_arc - arc
        if distance > t or not -2 * t <= step <= longest:
            passed = pieces[current].length - arc
            while True:
                is_last = current + 1 == len(pieces) and not closed
                if passed > longest or entries == 0 or is_last:
                    return False
                parts.append((pieces[current], arc, pieces[current].length))
                current = (current + 1) % len(pieces)
                entries -= 1
                arc = 0.0
                distance, next_arc = pieces[current].foot(place)
                step = passed + next_arc
                if distance <= t and step <= longest:
                    break
                passed += pieces[current].length
        for piece, _, _ in parts:
            if distance_from_line(piece.end, before, place) > h:
                return False
        for piece, first, last in [*parts, (pieces[current], arc, next_arc)]:
            middle = piece.place_at((first + last) / 2)
            if piece.radius > 0 and distance_from_line(middle, before, place) > h:
                return False
        arc = next_arc
        remaining -= step
    return remaining <= t + e


def tangent_of_turn(places, closed, i):
    """Tangent of the angle by which a stroke's points turn at one of them, at most 60 degrees."""
    count = len(places)
    if not closed and i in (0, count - 1):
        return 0.0
    before, here, after = (places[k % count] for k in (i - 1, i, i + 1))
    dx, dy = here[0] - before[0], here[1] - before[1]
    ex, ey = after[0] - here[0], after[1] - here[1]
    along, aside = dx * ex + dy * ey, abs(dx * ey - dy * ex)
    if aside < math.sqrt(3) * along:
        return aside / along
    return math.sqrt(3)


def distance_from_line(place, start, end):
    """The distance of a place from the straight line between two others."""
    return Piece(start, end, 0.0).foot(place)[0]


class Piece:
    """A line or an arc in the plane."""

    def __init__(self, start, end, bulge):
        self.start, self.end = start, end
        chord = math.dist(start, end)
        self.sweep = 4 * math.atan(bulge)
        self.length = chord
        self.radius = 0.0
        if abs(bulge) >= 1e-8 and chord > 0:
            self.radius = chord * (1 + bulge * bulge) / (4 * abs(bulge))
            self.length = self.radius * abs(self.sweep)
            offset = (1 - bulge * bulge) / (4 * bulge)  # in chords, to the left
            dx, dy = end[0] - start[0], end[1] - start[1]
            middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
            self.centre = (middle[0] - dy * offset, middle[1] + dx * offset)

    def place_at(self, way):
        """The place so far along the piece."""
        share = 0.0
        if self.length > 0:
            share = way / self.length
        dx, dy = self.end[0] - self.start[0], self.end[1] - self.start[1]
        if self.radius == 0:
            return self.start[0] + share * dx, self.start[1] + share * dy
        angle = share * self.sweep
        dx, dy = self.start[0] - self.centre[0], self.start[1] - self.centre[1]
        c, s = math.cos(angle), math.sin(angle)
        return self.centre[0] + c * dx - s * dy, self.centre[1] + s * dx + c * dy

    def foot(self, point):
        """(distance, length along the piece) of the nearest place on it."""
        if self.radius > 0:
            return self.foot_on_arc(point)
        dx, dy = self.end[0] - self.start[0], self.end[1] - self.start[1]
        share = 0.0
        if self.length > 0:
            share = (point[0] - self.start[0]) * dx + (point[1] - self.start[1]) * dy
            share = min(max(share / self.length**2, 0.0), 1.0)
        place = (self.start[0] + share * dx, self.start[1] + share * dy)
        return math.dist(point, place), share * self.length

    def foot_on_arc(self, point):
        """The same on an arc."""
        angles = []
        for place in (self.start, point):
            angles.append(math.atan2(place[1] - self.centre[1], place[0] - self.centre[0]))
        turned = angles[1] - angles[0]
        if self.sweep < 0:
            turned = -turned
        turned %= 2 * math.pi
        if turned <= abs(self.sweep):
            distance = abs(math.dist(point, self.centre) - self.radius)
            return distance, turned * self.radius
        to_start, to_end = math.dist(point, self.start), math.dist(point, self.end)
        if to_start <= to_end:
            return to_start, 0.0
        return to_end, self.length


# --- The whole --------------------------------------------------------------------------------


def read(data):
    """The values of a bundle's bytes, by path; raises `FormatError`."""
    end, flags, signed_case = read_seal(data)
    content = read_content(Payload(data, end))

    def raw_bytes(value):
        code = {"f8": "d", "i4": "i", "u1": "B"}[value.type]
        return struct.pack(f"<{len(value.items)}{code}", *value.items)

    check_agreement(content, raw_bytes, flags, signed_case)
    return {path: content[path].nested() for path in TABLE if path in content}


def main(words):
    """Print the bundle that is named; returns the exit code."""
    if len(words) != 1:
        print("usage: vfplan_reader.py FILE", file=sys.stderr)
        return 2
    try:
        with open(words[0], "rb") as file:
            data = file.read(MAX_PAYLOAD + 4097)
        values = read(data)
    except (OSError, FormatError) as error:
        print(f"{words[0]}: {error}", file=sys.stderr)
        return 1
    print(json.dumps(values, ensure_ascii=False))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
