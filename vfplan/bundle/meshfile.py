"""PLY and STL: points and triangles from the bytes of a file, all that it promises or an error.

PLY: ASCII, or binary of either order, with whatever other properties and elements; STL: ASCII or
binary. Numbers keep the precision they are written in; nothing is repaired.
"""

from __future__ import annotations

import io
import itertools
import re
import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.io.files import check_text_size

HEADER_BYTES = 1 << 16
"""Longest header of a PLY file that is looked for [bytes]."""
TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
"""PLY's name of a type -> NumPy's."""
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
USED_PROPERTIES = {"vertex": ("x", "y", "z"), "face": ("vertex_indices", "vertex_index")}
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STL_HEAD = struct.calcsize("<80sI")
"""Length of a binary STL file's header and count of facets [bytes]."""
TEXT_SOLID = re.compile(rb"\s*solid\b[^\n]*\n", re.IGNORECASE)
TEXT_END = re.compile(rb"\s*endsolid\b[^\n]*", re.IGNORECASE)
TEXT_FACET = re.compile(
    rb"\s*facet\s+normal(?:\s+\S+){3}\s+outer\s+loop"
    + 3 * rb"\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)"
    + rb"\s+endloop\s+endfacet\b",
    re.IGNORECASE,
)

Columns = dict[str, NDArray]
"""Name of a property -> its values, a row for each vertex or face."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """What a file holds."""

    points: NDArray[np.float64]
    """(N, 3) in the file's unit."""
    triangles: NDArray[np.integer] | None = None
    """(K, 3) rows of `points`; `None` when the file holds no faces."""
    left_out: tuple[str, ...] = ()
    """What else the file says, each as "element.property"."""


def read_mesh(data: bytes, suffix: str, where: str) -> Mesh:
    """The points and triangles of a file's bytes; `suffix` is ".ply" or ".stl".

    Of STL every facet has three points of its own (`refined` makes them one).

    Raises `InputError` when the file is not whole, or holds faces that are not triangles.
    """
    try:
        return read_ply(data) if suffix == ".ply" else read_stl(data)
    except KeyError as error:
        raise unreadable(suffix, f"{error} is unknown or missing", where) from error
    except (ValueError, IndexError, OverflowError, TypeError) as error:
        raise unreadable(suffix, str(error), where) from error


def unreadable(suffix: str, reason: str, where: str) -> InputError:
    """The error of a file that is not what its name says."""
    return InputError(
        f"cannot be read as {suffix[1:].upper()}: {reason}. Export it once more, with triangles "
        "alone.",
        where=where,
    )


# --- PLY ---------------------------------------------------------------------------------------


@dataclass
class Element:
    """One element of a header: its vertices, for example."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)
    """Each as (name, type, type of the list's length, which is "" for a single number)."""


def read_ply(data: bytes) -> Mesh:
    """The points and triangles of a PLY file."""
    order, elements, start = read_ply_header(data)
    if order == "":
        tables = text_tables(data, start, elements)
    else:
        tables = binary_tables(data, start, elements, order)
    vertex = tables["vertex"]
    points = np.column_stack([vertex["x"], vertex["y"], vertex["z"]]).astype(float)
    if points.shape[1:] != (3,):
        raise ValueError("its vertices have lists for coordinates")
    ignored = []
    for element in elements:
        for name, _, _ in element.properties:
            if element.count > 0 and name not in USED_PROPERTIES.get(element.name, ()):
                ignored.append(f"{element.name}.{name}")
    left_out = tuple(ignored)
    faces = None
    for name in USED_PROPERTIES["face"]:
        if faces is None:
            faces = tables.get("face", {}).get(name)
    if faces is None or len(faces) == 0:
        return Mesh(points, left_out=left_out)
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise ValueError("it holds faces that are not triangles")
    lowest = float(faces.min())
    highest = float(faces.max())
    if not (lowest >= 0 and highest < len(points)) or np.any(faces != np.floor(faces)):
        raise ValueError(f"its faces name vertices {lowest:g} to {highest:g} of {len(points)}")
    return Mesh(points, faces.astype(np.int32), left_out)


def read_ply_header(data: bytes) -> tuple[str, list[Element], int]:
    """(byte order, elements, offset of what follows)."""
    end = re.search(rb"^end_header[ \t\r]*\n", data[:HEADER_BYTES], re.MULTILINE)
    if data[:3] != b"ply" or end is None:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    order: str | None = None
    elements: list[Element] = []
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", form, "1.0"]:
                order = ORDERS[form]
            case ["element", name, count]:
                elements.append(Element(name, int(count)))
                if not 0 <= int(count) <= len(data):
                    raise ValueError(f"{count} of {name!r} in {len(data)} bytes")
            case ["property", "list", length, kind, name]:
                elements[-1].properties.append((name, TYPES[kind], TYPES[length]))
            case ["property", kind, name]:
                elements[-1].properties.append((name, TYPES[kind], ""))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"its header says {line.strip()[:60]!r}")
    if order is None:
        raise ValueError("its header names no format")
    return order, elements, end.end()


def binary_tables(
    data: bytes, start: int, elements: list[Element], order: str
) -> dict[str, Columns]:
    """The elements' properties, by the elements' names, of a binary file from byte `start` on."""
    tables = {}
    for element in elements:
        row = binary_row(element, order, data[start : start + HEADER_BYTES])
        size = element.count * row.itemsize
        if len(data) - start < size:
            raise ValueError(
                f"{element.count} of {element.name!r} take {size} bytes, and {len(data) - start} "
                "are left"
            )
        table = np.frombuffer(data, row, element.count, start)
        tables[element.name] = columns_of(table, element)
        start += size
    if data[start:].strip():
        raise ValueError(f"{len(data) - start} bytes follow its last element")
    return tables


def binary_row(element: Element, order: str, data: bytes) -> np.dtype:
    """The type of an element's rows; each list is as long as in the first row, where `data` begins.

    A list is two fields: its length, under "#" and its name, and its items.
    """
    fields: list[tuple] = []
    for name, kind, length_kind in element.properties:
        if length_kind == "":
            fields.append((name, order + kind))
            continue
        offset = np.dtype(fields).itemsize
        length_type = np.dtype(order + length_kind)
        length = 0
        if element.count > 0 and offset + length_type.itemsize <= len(data):
            length = int(np.frombuffer(data, length_type, 1, offset)[0])
        if not 0 <= length <= len(data):
            raise ValueError(f"{element.name!r} begins with a list of {length}")
        fields.append(("#" + name, length_type))
        fields.append((name, order + kind, (length,)))
    return np.dtype(fields)


def text_tables(data: bytes, start: int, elements: list[Element]) -> dict[str, Columns]:
    """The elements' properties, by the elements' names, of a text file from byte `start` on."""
    check_text_size(data)
    count = sum(1 for _ in lines_of(data, start))
    wanted = sum(element.count for element in elements)
    if count != wanted:
        raise ValueError(f"it has {count} lines of data, and {wanted} by its header")
    # Lines are read one by one: a list of millions would take more memory than the file.
    lines = lines_of(data, start)
    tables = {}
    for element in elements:
        if element.count == 0:
            table = np.empty(0, text_row(element, b""))
        else:
            first = next(lines)
            rows = itertools.chain([first], itertools.islice(lines, element.count - 1))
            row = text_row(element, first)
            table = np.loadtxt(rows, row, comments=None, ndmin=1, encoding="latin-1")
        tables[element.name] = columns_of(table, element)
    return tables


def lines_of(data: bytes, start: int) -> Iterator[bytes]:
    """The lines from byte `start` on that are not blank."""
    for line in io.BytesIO(data[start:]):
        if line.strip():
            yield line


def text_row(element: Element, line: bytes) -> np.dtype:
    """The type of an element's rows, all float64; each list is as long as in this first line."""
    numbers = np.array(line.split(), dtype=float)
    fields: list[tuple] = []
    column = 0
    for name, _, length_kind in element.properties:
        if length_kind == "":
            fields.append((name, "f8"))
            column += 1
            continue
        length = int(numbers[column]) if column < len(numbers) else 0
        if not 0 <= length <= len(numbers):
            raise ValueError(f"{element.name!r} begins with a list of {length}")
        fields.append(("#" + name, "f8"))
        fields.append((name, "f8", (length,)))
        column += 1 + length
    return np.dtype(fields)


def columns_of(table: NDArray, element: Element) -> Columns:
    """The properties of an element by their names."""
    columns = {}
    for name, _, length_kind in element.properties:
        if length_kind != "" and np.any(table["#" + name] != table[name].shape[1]):
            raise ValueError(
                f"the lists of {element.name!r} differ in length; triangles alone can be read"
            )
        columns[name] = table[name]
    return columns


# --- STL ---------------------------------------------------------------------------------------


def read_stl(data: bytes) -> Mesh:
    """The facets of an STL file; each has three points of its own."""
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= STL_HEAD else 0
    size = STL_HEAD + count * STL_FACET.itemsize
    # Some binary files begin with "solid" as those of text do, so the length decides.
    if len(data) == size:
        corners = np.frombuffer(data, STL_FACET, count, STL_HEAD)["corners"].astype(float)
    elif TEXT_SOLID.match(data):
        corners = text_facets(data)
    else:
        raise ValueError(f"it has {len(data)} bytes, and {size} by its own count of facets")
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def text_facets(data: bytes) -> NDArray[np.float64]:
    """(K, 3, 3) corners of the facets of all solids of a text."""
    check_text_size(data)
    numbers = array("d")
    offset = 0
    solid = TEXT_SOLID.match(data)
    while solid is not None:
        offset = solid.end()
        facet = TEXT_FACET.match(data, offset)
        while facet is not None:
            numbers.extend(map(float, facet.groups()))
            offset = facet.end()
            facet = TEXT_FACET.match(data, offset)
        end = TEXT_END.match(data, offset)
        if end is None:
            raise ValueError(f"neither a facet nor 'endsolid' follows byte {offset}")
        offset = end.end()
        solid = TEXT_SOLID.match(data, offset)
    if data[offset:].strip():
        raise ValueError(f"something else follows its last 'endsolid', at byte {offset}")
    return np.array(numbers).reshape(-1, 3, 3)
