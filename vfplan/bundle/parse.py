"""Bytes -> content: read an HDF5 file from memory, trusting nothing in it.

Deny by default. Links are walked one component at a time and must be hard; every type, shape,
layout, filter, size and attribute is compared with the table before a value is read; no byte is
allocated on the word of the file alone, because all chunks must be there, in the file, at their
full size.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vfplan.bundle.content import Content
from vfplan.bundle.fields import (
    Wrong,
    check_range,
    checked_storage,
    checked_type,
    decoded,
    scalar_attribute,
)
from vfplan.bundle.findings import KINDS, Findings
from vfplan.bundle.seal import BLOCKS
from vfplan.bundle.skeleton import check_skeleton
from vfplan.bundle.store import frame_of, unit_of
from vfplan.bundle.table import Row, Table
from vfplan.bundle.table import table as current
from vfplan.errors import BundleError, CorruptError
from vfplan.io.hdf5 import h5py

h5a, h5d, h5f, h5g, h5o, h5p, h5s, h5fd = (
    getattr(h5py, n) for n in ("h5a", "h5d", "h5f", "h5g", "h5o", "h5p", "h5s", "h5fd")
)
SIGNATURE = b"\x89HDF\r\n\x1a\n"
SUPERBLOCK = 48  # bytes of a version 2 or 3 superblock
NOWHERE = b"\xff" * 8
# Relative to the payload, or to the bundle with its seal in front: libhdf5 takes either.
BASES = (0, *BLOCKS)
# What h5py raises when libhdf5 finds something wrong.
LIBRARY_ERRORS = (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError)


@dataclass
class _Reading:
    """One pass over a file."""

    table: Table
    findings: Findings
    newer: bool
    content: Content = field(default_factory=dict)
    sizes: dict[str, int] = field(default_factory=dict)
    budget: int = 0


def check_superblock(payload: bytes) -> None:
    """Refuse a payload whose first 48 bytes are not a plain superblock of HDF5 1.10.

    Old superblocks carry no checksum; an extension can hold a driver's own data.
    """
    if payload[:8] != SIGNATURE:
        raise CorruptError("no HDF5 file: the signature is missing")
    if len(payload) < SUPERBLOCK:
        raise CorruptError(f"{len(payload)} bytes, too short for an HDF5 file")
    version, offset_size, length_size, flags = payload[8:12]
    if (version not in (2, 3)) or (offset_size, length_size, flags) != (8, 8, 0):
        raise CorruptError(
            f"superblock version {version}, sizes {offset_size} and {length_size}, flags {flags};"
            " version 2 or 3, 8, 8 and 0 wanted",
        )
    if payload[20:28] != NOWHERE:
        raise CorruptError("the superblock has an extension; none is allowed")
    base = int.from_bytes(payload[12:20], "little")
    if base not in BASES:
        raise CorruptError(f"the superblock's base address is {base}; one of {BASES} wanted")
    end = int.from_bytes(payload[28:36], "little") - base
    if end != len(payload):
        raise CorruptError(f"the superblock claims {end} bytes, {len(payload)} are there")


@contextmanager
def opened(payload: bytes) -> Iterator[Any]:
    """The root group of an HDF5 file that lies in memory."""
    stream = io.BytesIO(payload)  # shares the bytes, copies nothing
    fapl = h5p.create(h5p.FILE_ACCESS)
    fapl.set_fileobj_driver(h5fd.fileobj_driver, stream)
    fapl.set_fclose_degree(h5f.CLOSE_STRONG)
    file = h5f.open(b"bundle", h5f.ACC_RDONLY, fapl=fapl)
    try:
        yield h5g.open(file, b"/")
    finally:
        file.close()


def parse(payload: bytes, table: Table, findings: Findings, *, newer: bool = False) -> Content:
    """Everything in a payload that a version's table knows.

    The payload must have passed `peek_version`, which looks at its bones. `newer` files may hold
    unknown names, which are ignored; in others they are errors.

    Raises
    ------
    BundleError
        With strict findings, at the first thing that is wrong.
    """
    try:
        with opened(payload) as root:
            reading = _Reading(table, findings, newer, budget=len(payload))
            _read(root, reading)
            return reading.content
    except BundleError:
        raise
    except LIBRARY_ERRORS as error:
        raise CorruptError(f"libhdf5 cannot read it: {_first_line(error)}") from error


def peek_version(payload: bytes) -> tuple[str, str]:
    """(format, version) of a payload, after superblock and object headers were looked at."""
    check_superblock(payload)
    check_skeleton(payload, current())
    rows = {row.path: row for row in current().rows}
    try:
        with opened(payload) as root:
            return tuple(scalar_attribute(root, rows[path]) for path in ("/@format", "/@version"))
    except Wrong as wrong:
        raise KINDS[wrong.code.partition(".")[0]](wrong.message, where="/") from None
    except LIBRARY_ERRORS as error:
        raise CorruptError(f"libhdf5 cannot read it: {_first_line(error)}") from error


def _first_line(error: Exception) -> str:
    return " ".join(str(error.args[0] if error.args else error).split())[:200]


def _read(root: Any, reading: _Reading) -> None:
    groups = {"/": root}
    for row in reading.table.of("group"):
        if row.path == "/":
            with _row(row, reading):
                _check_names(root, "/", reading)
        elif _linked(root, row.name):
            with _row(row, reading):
                groups[row.path] = _open(root, row, h5g.GroupID)
                _check_names(groups[row.path], row.path, reading)
        elif row.required == "always" or (row.required == "rendering" and "/rendering" in groups):
            reading.findings.error("corrupt.missing", row.path, "is missing")
    # Attributes first: units and frames of datasets depend on them.
    for kind in ("attribute", "dataset"):
        for row in reading.table.of(kind):
            if row.parent in groups:
                with _row(row, reading):
                    _take(groups[row.parent], row, reading)


@contextmanager
def _row(row: Row, reading: _Reading) -> Iterator[None]:
    try:
        yield
    except Wrong as wrong:
        reading.findings.error(wrong.code, row.path, wrong.message)
    except LIBRARY_ERRORS as error:
        reading.findings.error("corrupt.hdf5", row.path, f"cannot be read: {_first_line(error)}")


def _take(group: Any, row: Row, reading: _Reading) -> None:
    if row.kind == "attribute":
        there = h5a.exists(group, row.name.encode())
    else:
        there = _linked(group, row.name)
    if not there:
        if row.required in ("always", "group"):
            raise Wrong("corrupt.missing", "is missing")
        return
    if row.kind == "attribute":
        value = scalar_attribute(group, row)
    else:
        value = _dataset(group, row, reading)
    check_range(value, row, reading.content)
    reading.content[row.path] = value


def _check_names(group: Any, path: str, reading: _Reading) -> None:
    limits = reading.table.limits
    count = group.get_num_objs()
    if count > limits["links_per_group"]:
        raise Wrong("unsafe.cap", f"{count} links; at most {limits['links_per_group']} allowed")
    known = reading.table.children(path)
    for index in range(count):
        name = group.get_objname_by_idx(index)
        kind = group.links.get_info(name).type
        if kind != h5py.h5l.TYPE_HARD:
            raise Wrong("unsafe.link", f"{_shown(name)} is not a hard link; no other is allowed")
        if _text(name) not in known and not reading.newer:
            raise Wrong("unsafe.unknown", f"holds {_shown(name)}, which this format does not have")
    attributes = {r.name for r in reading.table.of("attribute", path)}
    _check_attributes(group, attributes, reading)


def _check_attributes(where: Any, known: set[str], reading: _Reading) -> None:
    cap = reading.table.limits["attributes_per_object"]
    count = h5a.get_num_attrs(where)
    if count > cap:
        raise Wrong("unsafe.cap", f"{count} attributes; at most {cap} allowed")
    for index in range(count):
        name = h5a.open(where, index=index).name
        if _text(name) not in known and not reading.newer:
            raise Wrong("unsafe.unknown", f"has an attribute {_shown(name)} that this format lacks")


def _linked(group: Any, name: str) -> bool:
    return name.encode() in group


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace")


def _shown(name: bytes) -> str:
    return repr(_text(name)[:64])


def _open(group: Any, row: Row, kind: type) -> Any:
    thing = h5o.open(group, row.name.encode())
    if not isinstance(thing, kind):
        raise Wrong("corrupt.kind", f"is not a {row.kind}")
    links = h5o.get_info(thing).rc
    if links != 1:
        raise Wrong("unsafe.link", f"has {links} links to it; one is allowed")
    return thing


def _dataset(group: Any, row: Row, reading: _Reading) -> Any:
    dataset = _open(group, row, h5d.DatasetID)
    own = {"unit": unit_of(row, reading.content), "frame": frame_of(row, reading.content)}
    wanted = {name: text for name, text in own.items() if text is not None}
    _check_attributes(dataset, set(wanted), reading)
    shape = _shape(dataset, row, reading)
    datatype = checked_type(dataset.get_type(), row)
    reading.budget -= checked_storage(
        dataset, shape, datatype.get_size(), reading.budget, reading.table.limits
    )
    for name, text in wanted.items():
        if not h5a.exists(dataset, name.encode()):
            raise Wrong("corrupt.missing", f"has no attribute {name!r}")
        plain = Row(f"{row.path}@{name}", "attribute", "always", "", "", type="text")
        found = scalar_attribute(dataset, plain)
        if found != text:
            raise Wrong(f"corrupt.{name}", f"{name} is {found!r}; {text!r} wanted")
    value = np.empty(shape, dtype=datatype.dtype)
    dataset.read(h5s.ALL, h5s.ALL, value, mtype=datatype)
    return tuple(decoded(bytes(v)) for v in value) if row.type == "text" else value


def _shape(dataset: Any, row: Row, reading: _Reading) -> tuple[int, ...]:
    space = dataset.get_space()
    if space.get_simple_extent_type() != h5s.SIMPLE:
        raise Wrong("corrupt.shape", "is not an array")
    if space.get_simple_extent_ndims() != len(row.shape):
        found = space.get_simple_extent_ndims()
        raise Wrong("corrupt.shape", f"has {found} dimensions; {len(row.shape)} wanted")
    shape = space.get_simple_extent_dims()
    if space.get_simple_extent_dims(True) != shape:
        raise Wrong("unsafe.layout", "can grow; only arrays of fixed size are allowed")
    for size, wanted in zip(shape, row.shape, strict=True):
        _check_size(size, wanted, reading)
    return shape


def _check_size(size: int, wanted: int | str, reading: _Reading) -> None:
    if isinstance(wanted, int):
        if size != wanted:
            raise Wrong("corrupt.shape", f"has {size} where {wanted} is wanted")
        return
    cap = reading.table.sizes[wanted]
    if not 1 <= size <= cap:
        raise Wrong("unsafe.cap", f"{wanted} is {size}; 1 to {cap} allowed")
    if reading.sizes.setdefault(wanted, size) != size:
        known = reading.sizes[wanted]
        raise Wrong("corrupt.shape", f"{wanted} is {size} here and {known} elsewhere")
