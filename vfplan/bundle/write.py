"""Write bundles: fixture -> content -> HDF5 bytes -> sealed -> disk.

A file gets its name when it is whole and has been read back.
"""

from __future__ import annotations

import ctypes
import hashlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from vfplan._core import read_payload
from vfplan.bundle import leak, seal
from vfplan.bundle.content import to_content
from vfplan.bundle.schema import FORMAT, VERSION, Content, Row, document, table
from vfplan.errors import InputError, OutputError, SceneError, SettingError
from vfplan.fixture import Fixture
from vfplan.io.hdf5 import h5py
from vfplan.io.staging import write_whole

h5f, h5g, h5p = h5py.h5f, h5py.h5g, h5py.h5p
GEOMETRY = (
    "/points",
    "/mesh/triangles",
    "/pieces/vertices",
    "/pieces/bulges",
    "/pieces/stroke",
)
"""What `/@id` is the digest of, behind the frame."""

DISAGREEING = ("unsafe.pieces", "unsafe.mesh", "unsafe.stability", "unsafe.registration")
"""Codes of values that are sound each, and do not fit together."""

UNITS_OF_FRAME = {"image": "px", "robot_base": "m", "patient_lps": "m"}


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
    SettingError
        Its parts do not agree: its lines and arcs are not the curve of its points, its stability
        verdict is about another stiffness, its registration about other markers or points.
    InputError
        The fixture breaks another rule of the format.
    """
    write_content(completed(to_content(fixture)), Path(path), overwrite=overwrite)


def completed(content: Content) -> Content:
    """A content with what the format adds: head, object id and leak certificate."""
    head: Content = {"/@format": FORMAT, "/@version": VERSION}
    if "/guidance@radius_m" in content:  # a reader that does not know it would forbid what guides
        head["/@must_understand"] = "/guidance"
    for path, value in content.items():
        if path not in head and not path.startswith("/leak"):
            head[path] = value
    content = head
    _check_texts(content)
    # The id of the geometry: equal for equal points in the same frame.
    digest = hashlib.sha256(content["/@frame"].encode() + b"\0")
    for path in GEOMETRY:
        if path in content:
            digest.update(np.ascontiguousarray(content[path]).data)
    content["/@id"] = digest.hexdigest()[:32]
    if "/rendering@contact_radius_m" in content:
        # Of arrays that do not fit together there is none: the reader says what is wrong.
        with suppress(IndexError, ValueError), np.errstate(invalid="ignore", over="ignore"):
            content |= leak.certificate(content)
    return content


def _check_texts(content: Content) -> None:
    """Refuse a text that ends in NUL, which would be read back without it."""
    for path, value in content.items():
        texts = value if isinstance(value, tuple) else (value,)
        for text in texts:
            if isinstance(text, str) and text.endswith("\0"):
                raise InputError(f"{text!r} ends in a control character.", where=path)


def write_content(content: Content, path: Path, *, overwrite: bool) -> None:
    """Seal a content and write it, after reading it back.

    Raises as `write_fixture` does.
    """
    parts = seal.unsigned(to_payload(content))
    payload, length = parts[0], sum(map(len, parts))
    found = read_payload(payload, length, strict=False)[1]
    errors = [(where, code, message) for where, code, kind, message in found if kind == "error"]
    if errors:  # the certificate is missing where something else is wrong
        where, code, message = min(errors, key=lambda error: error[0].startswith("/leak"))
        if code == "unsafe.leak":
            raise SceneError(message)
        if code in DISAGREEING:
            raise SettingError(message, where=where, code=code)
        raise InputError(f"no bundle can hold this: {message}.", where=where)
    write_whole(path, parts, overwrite=overwrite)


def to_payload(content: Content) -> bytes:
    """The bytes of an HDF5 file with this content: the same content gives the same bytes.

    Any HDF5 library since 1.8 reads it (`libver` v108). Datasets stand in one piece and pass
    through no filter; there are no time stamps and no data of variable length.
    """
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_libver_bounds(h5f.LIBVER_V18, h5f.LIBVER_V18)
    access.set_fapl_core(1 << 16, False)
    creation = _group_properties(h5p.FILE_CREATE)
    used = {row.parent for row in table() if row.path in content}
    with h5py.File(h5f.create(b"bundle", h5f.ACC_TRUNC, fcpl=creation, fapl=access)) as file:
        for row in table():
            if row.kind == "group" and row.path != "/" and row.path in used:
                properties = _group_properties(h5p.GROUP_CREATE)
                h5g.create(file.id, row.path.encode(), gcpl=properties)
            elif row.path in content:
                _put(file[row.parent], row, content)
        file.flush()
        image = file.id.get_file_image()
    return image + bytes(-len(image) % 8)


def _group_properties(kind: Any) -> Any:
    """Of a group, or of a file's root: without time stamps, and with all links in its header.

    libhdf5 would move a group's ninth link, and all with it, into a heap. h5py has no name for the
    call that prevents this.
    """
    properties = h5p.create(kind)
    properties.set_obj_track_times(False)
    most = document()["limits"]["links_per_group"]
    call = ctypes.CDLL(h5p.__file__).H5Pset_link_phase_change
    call.argtypes, call.restype = [ctypes.c_int64, ctypes.c_uint, ctypes.c_uint], ctypes.c_int
    if call(properties.id, most, most - 1) < 0:
        raise OutputError(f"libhdf5 keeps no {most} links in a group's header.")
    return properties


def _put(group: Any, row: Row, content: Content) -> None:
    data = as_stored(content[row.path], row.type)
    if row.kind == "attribute":
        group.attrs.create(row.name, data)
        return
    if not data.size:
        raise InputError(f"has shape {data.shape}. Give at least one row.", where=row.path)
    dataset = group.create_dataset(row.name, data=data, fill_time="never")
    for name, text in unit_and_frame(row, content).items():
        dataset.attrs.create(name, as_stored(text, "text"))


def as_stored(value: Any, kind: str) -> np.ndarray:
    """A value as it is stored; texts in as many bytes as the longest takes, without an end."""
    if kind != "text":
        return np.asarray(value, dtype=f"<{kind}", order="C")
    bare = np.char.encode(np.array(value, dtype=str), "utf-8")
    return bare.astype(h5py.string_dtype("utf-8", max(1, bare.itemsize)))


def unit_and_frame(row: Row, content: Content) -> dict[str, str]:
    """Unit and frame to write beside a dataset, "@frame" and "@source_frame" filled in."""
    frame, unit = row.frame, row.unit
    for name, path in (("@frame", "/@frame"), ("@source_frame", "/registration@source_frame")):
        known = content.get(path)
        if frame == name:
            frame = known
        if unit is not None:
            unit = unit.replace(name, UNITS_OF_FRAME.get(known, "?"))
    return {name: text for name, text in (("unit", unit), ("frame", frame)) if text is not None}
