"""PLY and STL: points and triangles from the bytes of a file, all that it promises or an error.

PLY: ASCII, or binary of either order, with whatever other properties and elements; STL: ASCII or
binary. Numbers keep the precision they are written in; nothing is repaired.
"""

from __future__ import annotations

import io
import itertools
import re
import struct
import warnings
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.io.reading import require_short

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
# Odd numbers without structure, to tell points apart by one number each.
MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)

Columns = dict[str, NDArray]


@dataclass(frozen=True, eq=False)
class Mesh:
    """What a file holds."""

    points: NDArray[np.float64]  # (N, 3) float64, in the file's unit
    # (K, 3) int32, rows of `points`; `None` when the file holds no faces
    triangles: NDArray[np.int32] | None = None
    left_out: tuple[str, ...] = ()  # what else the file says, each as "element.property"


def read_mesh(data: bytes, suffix: str, where: str) -> Mesh:
    """The points and triangles of a file's bytes; `suffix` is ".ply" or ".stl".

    The corners of STL facets that agree to the last bit become one point; facets two of whose
    corners are one point bound nothing and are left out.

    Raises `InputError` when the file is not whole, or holds faces that are not triangles.
    """
    reader: Callable[[bytes], Mesh] = _ply if suffix == ".ply" else _stl
    try:
        return reader(data)
    except (KeyError, ValueError, IndexError, OverflowError, TypeError) as error:
        what = f"{error} is unknown or missing" if isinstance(error, KeyError) else str(error)
        raise InputError(f"cannot be read as {suffix[1:].upper()}: {what}", where=where) from error


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
    tables: dict[str, Columns] = {}
    for element in elements:
        row, lists = _row_type(data, at, element, order)
        size = element.count * row.itemsize
        if len(data) - at < size:
            raise ValueError(
                f"{size} bytes wanted for {element.count} of {element.name!r},"
                f" {len(data) - at} are left"
            )
        table = np.frombuffer(data, row, element.count, at)
        for name, length in lists.items():
            _same_lengths(table["#" + name], length, element.name)
        tables[element.name] = {name: table[name] for name, _, _ in element.properties}
        at += size
    if data[at:].strip():
        raise ValueError(f"{len(data) - at} bytes follow its last element")
    return tables


def _row_type(
    data: bytes, at: int, element: _Element, order: str
) -> tuple[np.dtype, dict[str, int]]:
    """(type of an element's rows, length of each list), from the lengths in its first row."""
    fields: list[tuple] = []
    lists: dict[str, int] = {}
    for name, kind, length in element.properties:
        if length:
            first = at + np.dtype(fields).itemsize
            counter = np.dtype(order + length)
            there = element.count and first + counter.itemsize <= len(data)
            lists[name] = int(np.frombuffer(data, counter, 1, first)[0]) if there else 0
            if not 0 <= lists[name] <= len(data):
                raise ValueError(f"{element.name!r} begins with a list of {lists[name]}")
            fields += [("#" + name, counter), (name, order + kind, (lists[name],))]
        else:
            fields.append((name, order + kind))
    return np.dtype(fields), lists


def _text_elements(
    data: bytes, at: int, elements: list[_Element], order: str
) -> dict[str, Columns]:
    require_short(data)
    lines = (line for line in io.BytesIO(data[at:]) if line.strip())
    tables: dict[str, Columns] = {}
    wanted, found = sum(element.count for element in elements), 0
    for element in elements:
        table = np.empty((0, 0))
        if element.count:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # no lines at all: refused below
                rows = itertools.islice(lines, element.count)
                table = np.loadtxt(rows, comments=None, ndmin=2, encoding="latin-1")
        found += len(table)
        if len(table) != element.count:
            raise ValueError(f"{found} lines of data; {wanted} wanted")
        tables[element.name] = _columns(table, element)
    if more := sum(1 for _ in lines):
        raise ValueError(f"{found + more} lines of data; {wanted} wanted")
    return tables


def _columns(table: NDArray, element: _Element) -> Columns:
    """The properties of an element from the numbers of its lines."""
    columns: Columns = {}
    at = 0
    for name, _, length in element.properties:
        if len(table) == 0:
            columns[name] = np.empty((0, 3) if length else 0)
        elif length:
            size = int(table[0, at]) if table.shape[1] > at else -1
            _same_lengths(table[:, at], size, element.name)
            columns[name] = table[:, at + 1 : at + 1 + size]
            at += 1 + size
        else:
            columns[name] = table[:, at]
            at += 1
    if at != table.shape[1]:
        raise ValueError(f"lines of {table.shape[1]} numbers for {element.name!r}; {at} wanted")
    return columns


def _same_lengths(found: NDArray, wanted: int, name: str) -> None:
    if np.any(found != wanted):
        raise ValueError(f"the lists of {name!r} differ in length; triangles alone can be read")


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
    points, index = merged(corners.reshape(-1, 3))
    triangles = index.reshape(-1, 3).astype(np.int32)
    a, b, c = triangles.T
    return Mesh(points, triangles[(a != b) & (b != c) & (c != a)])


def _text_corners(data: bytes) -> NDArray[np.float64]:
    """(K, 3, 3) corners of the facets of all solids."""
    require_short(data)
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


def merged(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """(points that differ, in order of their first appearance; (N,) which of them each is)."""
    points = points + 0.0  # one zero, not two
    bits = np.ascontiguousarray(points).view(np.uint64)
    bits = bits ^ bits >> np.uint64(32)  # short numbers differ in their high bits alone
    mixed = (bits * MIX).sum(axis=1, dtype=np.uint64)
    _, first, which = np.unique(mixed, return_index=True, return_inverse=True)
    if not np.array_equal(points[first][which], points):  # two points of the same number
        _, first, which = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.intp)
    rank[order] = np.arange(len(order))
    return points[first[order]], rank[which.ravel()]
