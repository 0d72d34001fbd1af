"""Write bundles: content -> bytes -> disk, whole, and read back before they get their name."""

from __future__ import annotations

import ctypes
import hashlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from vfplan._core import read_payload
from vfplan.bundle import leak
from vfplan.bundle.content import Content, to_content
from vfplan.bundle.format import UNITS_OF_FRAME, Row, seal_of, table, to_block
from vfplan.errors import InputError, OutputError, SceneError
from vfplan.fixture import Fixture
from vfplan.io.disk import write_whole
from vfplan.io.hdf5 import h5py

h5f, h5p = h5py.h5f, h5py.h5p
CHUNK_BYTES = 1 << 20
COMPACT_LINKS = 8  # of a group that libhdf5 keeps in its header unasked
FORMAT = "vfplan-fixture"
VERSION = "1.0"  # at least: a bundle is of the first version that has all it holds


def write_fixture(fixture: Fixture, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a fixture as a sealed, unsigned bundle: whole or not at all.

    The leak certificate is computed here. The bytes are read back and checked before the file
    appears under its name.

    Raises
    ------
    OutputError
        The path exists and `overwrite` is false, or cannot be written.
    SceneError
        The fixture leaks between samples: its own proxy can pass through.
    InputError
        The fixture breaks another rule of the format.
    """
    write_content(completed(to_content(fixture)), Path(path), overwrite=overwrite)


def completed(content: Content) -> Content:
    """A content with what the format adds: head, object id and leak certificate."""
    since = max([VERSION, *(row.since for row in table() if row.path in content)])
    head = {"/@format": FORMAT, "/@version": since}
    if "/guidance@radius_m" in content:  # an older reader would forbid what shall guide
        head["/@must_understand"] = "/guidance"
    content = head | {p: v for p, v in content.items() if p not in head and "/leak" not in p}
    _check_texts(content)
    # The id of the geometry: equal for equal points in the same frame.
    digest = hashlib.sha256(content["/@frame"].encode() + b"\0")
    digest.update(np.ascontiguousarray(content["/points"], dtype="<f8").data)
    content["/@id"] = digest.hexdigest()[:32]
    if "/rendering@contact_radius_m" in content:
        # Of arrays that do not fit together there is none: the reader says what is wrong.
        with suppress(IndexError, ValueError), np.errstate(invalid="ignore", over="ignore"):
            content |= leak.certificate(content)
    return content


def _check_texts(content: Content) -> None:
    """Refuse a text that ends in NUL, which would be read back without it."""
    for path, value in content.items():
        for text in value if isinstance(value, tuple) else (value,):
            if isinstance(text, str) and text.endswith("\0"):
                raise InputError(f"{text!r} ends in a control character", where=path)


def write_content(content: Content, path: Path, *, overwrite: bool) -> None:
    """Seal a content and write it, after reading it back."""
    payload = to_payload(content)
    found = read_payload(payload, strict=False)[1]
    errors = [(where, code, message) for where, code, kind, message in found if kind == "error"]
    if errors:  # the certificate is missing where something else is wrong
        where, code, message = min(errors, key=lambda error: error[0].startswith("/leak"))
        if code == "unsafe.leak":
            raise SceneError(message)
        raise InputError(f"no bundle can hold this: {message}", where=where)
    write_whole(path, [to_block(seal_of(payload)), payload], overwrite=overwrite)


def to_payload(content: Content) -> bytes:
    """The bytes of an HDF5 file with this content: the same content gives the same bytes.

    Readable by libhdf5 1.10 and later (`libver` v110). No time stamps, no variable-length data;
    datasets in chunks guarded by fletcher32, everything else guarded by libhdf5's own checksums.
    """
    fapl = h5p.create(h5p.FILE_ACCESS)
    fapl.set_libver_bounds(h5f.LIBVER_V110, h5f.LIBVER_V110)
    fapl.set_fapl_core(1 << 16, False)
    fcpl = h5p.create(h5p.FILE_CREATE)
    fcpl.set_obj_track_times(False)
    used = {r.parent for r in table() if r.path in content}
    inside = {r.path for r in table() if r.kind != "attribute" and r.parent == "/"} - {"/"}
    links = inside & (used | content.keys())
    if len(links) > COMPACT_LINKS:
        _keep_compact(fcpl, len(links))
    with h5py.File(h5f.create(b"bundle", h5f.ACC_TRUNC, fcpl=fcpl, fapl=fapl)) as file:
        for row in table():
            if row.kind == "group" and row.path != "/" and row.path in used:
                file.create_group(row.path)
            elif row.path in content:
                _put(file[row.parent], row, content)
        file.flush()
        return file.id.get_file_image()


def _keep_compact(plist: Any, links: int) -> None:
    """So many links of a group stay in its header; h5py has no name for this call of libhdf5."""
    call = ctypes.CDLL(h5p.__file__).H5Pset_link_phase_change
    call.argtypes, call.restype = [ctypes.c_int64, ctypes.c_uint, ctypes.c_uint], ctypes.c_int
    if call(plist.id, links, COMPACT_LINKS) < 0:
        raise OutputError(f"libhdf5 keeps no {links} links in a group's header")


def _put(group: Any, row: Row, content: Content) -> None:
    data = _coded(content[row.path], row.type)
    if row.kind == "attribute":
        group.attrs.create(row.name, data)
        return
    if not data.size:
        raise InputError(f"has shape {data.shape}; nothing in it", where=row.path)
    chunks = chunk_shape(data.shape, data.dtype.itemsize)
    dataset = group.create_dataset(
        row.name, data=data, chunks=chunks, fletcher32=True, fill_time="never"
    )
    for name, text in (("unit", unit_of(row, content)), ("frame", frame_of(row, content))):
        if text is not None:
            dataset.attrs.create(name, _coded(text, "text"))


def chunk_shape(shape: tuple[int, ...], itemsize: int) -> tuple[int, ...]:
    """Whole rows, as many as fit into 1 MiB."""
    row_bytes = itemsize * int(np.prod(shape[1:], dtype=np.int64))
    return (max(1, min(shape[0], CHUNK_BYTES // row_bytes)), *shape[1:])


def _coded(value: Any, kind: str) -> np.ndarray:
    """A value as it is stored; texts in as many bytes as the longest takes, without an end."""
    if kind != "text":
        return np.asarray(value, dtype=f"<{kind}", order="C")
    bare = np.char.encode(np.array(value, dtype=str), "utf-8")
    return bare.astype(h5py.string_dtype("utf-8", max(1, bare.itemsize)))


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
