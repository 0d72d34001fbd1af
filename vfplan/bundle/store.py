"""Content -> the bytes of an HDF5 file."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from vfplan.bundle.content import Content
from vfplan.bundle.table import UNITS_OF_FRAME, Row, Table
from vfplan.errors import OutputError
from vfplan.io.hdf5 import h5py

h5a, h5d, h5f, h5g, h5p, h5s, h5t, h5z = (
    getattr(h5py, name) for name in ("h5a", "h5d", "h5f", "h5g", "h5p", "h5s", "h5t", "h5z")
)
NUMBERS = {"f8": h5t.IEEE_F64LE, "i4": h5t.STD_I32LE, "u1": h5t.STD_U8LE}
CHUNK_BYTES = 1 << 20
COMPACT_LINKS = 8  # of a group that libhdf5 keeps in its header unasked


def to_payload(content: Content, table: Table) -> bytes:
    """The bytes of an HDF5 file with this content: the same content gives the same bytes.

    Readable by libhdf5 1.10 and later (`libver` v110). No time stamps, no variable-length data;
    datasets in chunks guarded by fletcher32, everything else guarded by libhdf5's own checksums.
    """
    fapl = h5p.create(h5p.FILE_ACCESS)
    fapl.set_libver_bounds(h5f.LIBVER_V110, h5f.LIBVER_V110)
    fapl.set_fapl_core(1 << 16, False)
    fcpl = h5p.create(h5p.FILE_CREATE)
    fcpl.set_obj_track_times(False)
    used = {r.parent for r in table.rows if r.path in content}
    links = [r for r in table.children("/").values() if {r.path} & (used | content.keys())]
    if len(links) > COMPACT_LINKS:
        _keep_compact(fcpl, len(links))
    file = h5f.create(b"bundle", h5f.ACC_TRUNC, fcpl=fcpl, fapl=fapl)
    try:
        root = h5g.open(file, b"/")
        groups = {"/": root}
        for row in table.rows:
            if row.kind == "group" and row.path != "/" and row.path in used:
                gcpl = h5p.create(h5p.GROUP_CREATE)
                gcpl.set_obj_track_times(False)
                groups[row.path] = h5g.create(root, row.path[1:].encode(), gcpl=gcpl)
            elif row.path in content:
                _put(groups[row.parent], row, content)
        for group in groups.values():
            group.close()
        h5f.flush(file)
        return file.get_file_image()
    finally:
        file.close()


def _keep_compact(plist: Any, links: int) -> None:
    """So many links of a group stay in its header; h5py has no name for this call of libhdf5."""
    call = ctypes.CDLL(h5p.__file__).H5Pset_link_phase_change
    call.argtypes, call.restype = [ctypes.c_int64, ctypes.c_uint, ctypes.c_uint], ctypes.c_int
    if call(plist.id, links, COMPACT_LINKS) < 0:
        raise OutputError(f"libhdf5 keeps no {links} links in a group's header")


def _put(group: Any, row: Row, content: Content) -> None:
    value = content[row.path]
    if row.kind == "attribute":
        _attribute(group, row.name, value, row)
        return
    data, datatype = _coded(value, row)
    space = h5s.create_simple(data.shape)
    dcpl = h5p.create(h5p.DATASET_CREATE)
    dcpl.set_obj_track_times(False)
    dcpl.set_chunk(chunk_shape(data.shape, data.dtype.itemsize))
    dcpl.set_fletcher32()
    dcpl.set_fill_time(h5d.FILL_TIME_NEVER)
    dataset = h5d.create(group, row.name.encode(), datatype, space, dcpl=dcpl)
    dataset.write(h5s.ALL, h5s.ALL, data, mtype=datatype)
    for name, text in (("unit", unit_of(row, content)), ("frame", frame_of(row, content))):
        if text is not None:
            _attribute(dataset, name, text)
    dataset.close()


def chunk_shape(shape: tuple[int, ...], itemsize: int) -> tuple[int, ...]:
    """Whole rows, as many as fit into 1 MiB."""
    row_bytes = itemsize * int(np.prod(shape[1:], dtype=np.int64))
    return (max(1, min(shape[0], CHUNK_BYTES // row_bytes)), *shape[1:])


def _attribute(where: Any, name: str, value: Any, row: Row | None = None) -> None:
    if isinstance(value, str):
        data, datatype = _texts((value,))
        data = data.reshape(())
    else:
        datatype = NUMBERS[row.type if row else "f8"]
        data = np.asarray(value, dtype=datatype.dtype)
    attribute = h5a.create(where, name.encode(), datatype, h5s.create(h5s.SCALAR))
    attribute.write(data, mtype=datatype)
    attribute.close()


def _coded(value: Any, row: Row) -> tuple[np.ndarray, Any]:
    if row.type == "text":
        return _texts(value)
    datatype = NUMBERS[row.type]
    return np.ascontiguousarray(value, dtype=datatype.dtype), datatype


def _texts(values: tuple[str, ...]) -> tuple[np.ndarray, Any]:
    coded = [value.encode("utf-8") for value in values]
    size = max(1, *(len(c) for c in coded)) if coded else 1
    datatype = h5t.C_S1.copy()
    datatype.set_size(size)
    datatype.set_cset(h5t.CSET_UTF8)
    datatype.set_strpad(h5t.STR_NULLPAD)
    return np.array(coded, dtype=f"S{size}"), datatype


def frame_of(row: Row, content: Content) -> str | None:
    """The frame to write beside a dataset, "@frame" and "@source_frame" filled in."""
    if row.frame == "@frame":
        return content.get("/@frame")
    if row.frame == "@source_frame":
        return content.get("/registration@source_frame")
    return row.frame


def unit_of(row: Row, content: Content) -> str | None:
    """The unit to write beside a dataset, "@frame" and "@source_frame" filled in."""
    if row.unit is None:
        return None
    for name, path in (("@frame", "/@frame"), ("@source_frame", "/registration@source_frame")):
        if name in row.unit:
            return row.unit.replace(name, UNITS_OF_FRAME.get(content.get(path, ""), "?"))
    return row.unit
