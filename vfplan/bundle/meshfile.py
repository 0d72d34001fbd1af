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
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.io.files import check_text_size

HEADER_BYTES = 1 << 16
TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
USED = {"vertex": ("x", "y", "z"), "face": ("vertex_indices", "vertex_index")}
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STL_HEAD = 84
TEXT_SOLID = re.compile(rb"\s*solid\b[^\n]*\n", re.IGNORECASE)
TEXT_END = re.compile(rb"\s*endsolid\b[^\n]*", re.IGNORECASE)
TEXT_FACET = re.compile(
    rb"\s*facet\s+normal(?:\s+\S+){3}\s+outer\s+loop"
    + 3 * rb"\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)"
    + rb"\s+endloop\s+endfacet\b",
    re.IGNORECASE,
)

Columns = dict[str, NDArray]


@dataclass(frozen=True, eq=False)
class Mesh:
    """What a file holds."""

    points: NDArray[np.float64]  # (N, 3) float64, in the file's unit
    # (K, 3) rows of `points`; `None` when the file holds no faces
    triangles: NDArray[np.integer] | None = None
    left_out: tuple[str, ...] = ()  # what else the file says, each as "element.property"


def read_mesh(data: bytes, suffix: str, where: str) -> Mesh:
    """The points and triangles of a file's bytes; `suffix` is ".ply" or ".stl".

    Of STL every facet has three points of its own (`refined` makes them one).

    Raises `InputError` when the file is not whole, or holds faces that are not triangles.
    """
    reader: Callable[[bytes], Mesh] = _ply if suffix == ".ply" else _stl
    try:
        return reader(data)
    except (KeyError, ValueError, IndexError, OverflowError, TypeError) as error:
        what = f"{error} is unknown or missing" if isinstance(error, KeyError) else str(error)
        raise InputError(f"cannot be read as {suffix[1:].upper()}: {what}.", where=where) from error


# --- PLY ---------------------------------------------------------------------------------------


@dataclass
class _Element:
    """One element of a header; a property is (name, type, type of the list's length or "")."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)


def _ply(data: bytes) -> Mesh:
    order, elements, at = _header(data)
    read = _text_elements if order == "" else _binary_elements
    tables = read(data, at, elements, order)
    vertex = tables["vertex"]
    points = np.column_stack([vertex[axis].astype(float) for axis in "xyz"])
    if points.shape[1:] != (3,):
        raise ValueError("its vertices have lists for coordinates")
    left_out = tuple(
        f"{element.name}.{name}"
        for element in elements
        for name, _, _ in element.properties
        if element.count and name not in USED.get(element.name, ())
    )
    face = tables.get("face", {})
    faces = next((face[name] for name in USED["face"] if name in face), None)
    if faces is None or len(faces) == 0:
        return Mesh(points, left_out=left_out)
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise ValueError("it holds faces that are not triangles")
    low, high = float(faces.min()), float(faces.max())
    if not (low >= 0 and high < len(points)) or np.any(faces != np.floor(faces)):
        raise ValueError(f"its faces name vertices {low:g} to {high:g} of {len(points)}")
    return Mesh(points, faces.astype(np.int32), left_out)


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    """(byte order, elements, offset of what follows)."""
    end = re.search(rb"^end_header[ \t\r]*\n", data[:HEADER_BYTES], re.MULTILINE)
    if data[:3] != b"ply" or end is None:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    order: str | None = None
    elements: list[_Element] = []
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", form, "1.0"]:
                order = ORDERS[form]
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
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


def _binary_elements(
    data: bytes, at: int, elements: list[_Element], order: str
) -> dict[str, Columns]:
    tables = {}
    for element in elements:
        row = _row_type(element, order, memoryview(data)[at:])
        size = element.count * row.itemsize
        if len(data) - at < size:
            raise ValueError(
                f"{size} bytes wanted for {element.count} of {element.name!r},"
                f" {len(data) - at} are left"
            )
        tables[element.name] = _columns(np.frombuffer(data, row, element.count, at), element)
        at += size
    if data[at:].strip():
        raise ValueError(f"{len(data) - at} bytes follow its last element")
    return tables


def _text_elements(
    data: bytes, at: int, elements: list[_Element], order: str
) -> dict[str, Columns]:
    check_text_size(data)
    wanted = sum(element.count for element in elements)
    found = sum(1 for line in io.BytesIO(data[at:]) if line.strip())
    if found != wanted:
        raise ValueError(f"{found} lines of data; {wanted} wanted")
    lines = (line for line in io.BytesIO(data[at:]) if line.strip())
    tables = {}
    for element in elements:
        mine = itertools.islice(lines, element.count)
        first = next(mine, b"")
        row = _row_type(element, order, memoryview(np.array(first.split(), dtype=float)).cast("B"))
        table = np.empty(0, row)
        if element.count:
            rows = itertools.chain([first], mine)
            table = np.loadtxt(rows, row, comments=None, ndmin=1, encoding="latin-1")
        tables[element.name] = _columns(table, element)
    return tables


def _row_type(element: _Element, order: str, first: memoryview) -> np.dtype:
    """The type of an element's rows, every list as long as in the first of them; text: float64."""
    fields: list[tuple] = []
    for name, kind, length in element.properties:
        if length:
            at = np.dtype(fields).itemsize
            counter = np.dtype(order + length if order else "f8")
            there = element.count and at + counter.itemsize <= len(first)
            size = int(np.frombuffer(first, counter, 1, at)[0]) if there else 0
            if not 0 <= size <= len(first):
                raise ValueError(f"{element.name!r} begins with a list of {size}")
            fields += [("#" + name, counter), (name, order + kind if order else "f8", (size,))]
        else:
            fields.append((name, order + kind if order else "f8"))
    return np.dtype(fields)


def _columns(table: NDArray, element: _Element) -> Columns:
    """The properties of an element by their names."""
    for name, _, length in element.properties:
        if length and np.any(table["#" + name] != table[name].shape[1]):
            raise ValueError(
                f"the lists of {element.name!r} differ in length; triangles alone can be read"
            )
    return {name: table[name] for name, _, _ in element.properties}


# --- STL ---------------------------------------------------------------------------------------


def _stl(data: bytes) -> Mesh:
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= STL_HEAD else 0
    wanted = STL_HEAD + count * STL_FACET.itemsize
    if len(data) == wanted:  # even if it begins with "solid", as some binary ones do
        corners = np.frombuffer(data, STL_FACET, count, STL_HEAD)["corners"].astype(float)
    elif TEXT_SOLID.match(data):
        corners = _text_corners(data)
    else:
        raise ValueError(f"{len(data)} bytes; {wanted} wanted by its own count")
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _text_corners(data: bytes) -> NDArray[np.float64]:
    """(K, 3, 3) corners of the facets of all solids."""
    check_text_size(data)
    numbers, at = array("d"), 0
    while solid := TEXT_SOLID.match(data, at):
        at = solid.end()
        while facet := TEXT_FACET.match(data, at):
            numbers.extend(map(float, facet.groups()))
            at = facet.end()
        end = TEXT_END.match(data, at)
        if end is None:
            raise ValueError(f"neither a facet nor 'endsolid' follows byte {at}")
        at = end.end()
    if data[at:].strip():
        raise ValueError(f"something else follows its last 'endsolid', at byte {at}")
    return np.array(numbers).reshape(-1, 3, 3)
