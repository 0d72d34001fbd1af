"""PLY and STL: whether a file holds all that its header promises, before VTK reads it.

VTK trusts the counts: one that is too large ends the process, one that the file does not fill gives
a surface with parts missing.
"""

from __future__ import annotations

import struct
from pathlib import Path

from vfplan.errors import InputError

HEADER_BYTES = 1 << 16
_SIZES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}


def check_mesh(path: Path) -> None:
    """Refuse a .ply or .stl file that is shorter than its own counts say.

    Raises `InputError`; names the length found and the one wanted.
    """
    try:
        (_check_ply if path.suffix.lower() == ".ply" else _check_stl)(path)
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(f"its header cannot be read: {error}", where=str(path)) from error


def _check_stl(path: Path) -> None:
    size = path.stat().st_size
    with open(path, "rb") as file:
        start = file.read(1024)
        file.seek(max(0, size - 1024))
        end = file.read()
    if start.lstrip().startswith(b"solid") and b"facet" in start:
        if b"endsolid" not in end:
            raise InputError("ends before its `endsolid`", where=str(path))
        return
    if size < 84:
        raise InputError(f"{size} bytes; a binary STL has 84 and more", where=str(path))
    wanted = 84 + 50 * struct.unpack_from("<I", start, 80)[0]
    if size != wanted:
        raise InputError(f"{size} bytes; {wanted} wanted by its own count", where=str(path))


def _check_ply(path: Path) -> None:
    size = path.stat().st_size
    with open(path, "rb") as file:
        head, end, _ = file.read(HEADER_BYTES).partition(b"end_header")
        if not end:
            raise InputError("has no end_header", where=str(path))
        file.seek(len(head) + len(end))
        file.readline()
        there = size - file.tell()
        counts, widths, binary = _elements(head)
        if any(count > size for count in counts):
            raise InputError(f"{max(counts)} elements in {size} bytes", where=str(path))
        if binary:
            wanted = sum(n * width for n, width in zip(counts, widths, strict=True))
        else:
            there, wanted = sum(1 for line in file if line.strip()), sum(counts)
    if there < wanted:
        unit = "bytes" if binary else "lines"
        raise InputError(f"{there} {unit} of data; at least {wanted} wanted", where=str(path))


def _elements(head: bytes) -> tuple[list[int], list[int], bool]:
    """Count and least width [bytes] of each element, and whether they are binary."""
    counts: list[int] = []
    widths: list[int] = []
    binary = True
    for words in (line.split() for line in head.decode("latin-1").splitlines()):
        if words[:1] == ["format"]:
            binary = words[1] != "ascii"
        elif words[:1] == ["element"]:
            count = int(words[2])
            if count < 0:
                raise ValueError(f"{count} elements")
            counts.append(count)
            widths.append(0)
        elif words[:2] == ["property", "list"]:
            widths[-1] += _SIZES[words[2]]  # an empty list is the shortest
        elif words[:1] == ["property"]:
            widths[-1] += _SIZES[words[1]]
    return counts, widths, binary
