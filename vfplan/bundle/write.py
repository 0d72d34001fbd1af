"""Write bundles: fixture -> content -> HDF5 bytes -> sealed -> disk.

A file gets its name when it is whole, and a reader found its bytes to be sound.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from vfplan._core import read_payload
from vfplan.bundle import leak, seal
from vfplan.bundle.content import (
    FORMAT,
    UNITS_OF_FRAME,
    VERSION,
    Content,
    Row,
    document,
    geometry_digest,
    rows_of,
    to_content,
)
from vfplan.errors import InputError, SceneError, SettingError
from vfplan.fixture import Fixture
from vfplan.io.hdf5 import h5py
from vfplan.io.writing import write_whole

h5f, h5g, h5p = h5py.h5f, h5py.h5g, h5py.h5p
# Codes of values that are sound each, and do not fit together.
DISAGREEING = ("unsafe.pieces", "unsafe.mesh", "unsafe.stability", "unsafe.registration",
               "unsafe.review")  # fmt: skip


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
        verdict is about another stiffness, its registration about other markers or points, its
        review about another plan.
    InputError
        The fixture breaks another rule of the format.
    """
    parts = seal.sealed_file(to_payload(completed(to_content(fixture))))
    issues = read_payload(parts[0], sum(map(len, parts)), strict=False)[1]
    errors = [issue for issue in issues if issue[2] == "error"]
    if errors:
        # Where something else is wrong the certificate is missing, so it is named last.
        where, code, _, message = min(errors, key=lambda error: error[0].startswith("/leak"))
        if code == "unsafe.leak":
            raise SceneError(message)
        if code in DISAGREEING:
            raise SettingError(message, where=where, code=code)
        raise InputError(f"No bundle can hold this: {message}", where=where)
    write_whole(Path(path), parts, overwrite=overwrite)


def completed(content: Content) -> Content:
    """A content with what the format adds: head, object id and leak certificate."""
    whole = {path: value for path, value in content.items() if not path.startswith("/leak")}
    whole |= {"/@format": FORMAT, "/@version": VERSION}
    if "/guidance@radius_m" in content:
        # A reader that does not know it would forbid what is to guide.
        whole["/@must_understand"] = "/guidance"
    whole["/@id"] = geometry_digest(whole).hex()[:32]
    if "/rendering@contact_radius_m" in whole:
        # Of arrays that do not fit together there is none: the reader says what is wrong.
        with (
            suppress(IndexError, TypeError, ValueError),
            np.errstate(invalid="ignore", over="ignore"),
        ):
            whole |= leak.certificate(whole)
    return whole


def to_payload(content: Content) -> bytes:
    """The bytes of an HDF5 file with this content: the same content gives the same bytes.

    Any HDF5 library since 1.8 reads it (`libver` v108). Datasets stand in one piece and pass
    through no filter; there are no time stamps and no data of variable length.
    """
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_libver_bounds(h5f.LIBVER_V18, h5f.LIBVER_V18)
    access.set_fapl_core(1 << 16, False)
    creation = group_properties(h5p.FILE_CREATE)
    with h5py.File(h5f.create(b"bundle", h5f.ACC_TRUNC, fcpl=creation, fapl=access)) as file:
        for row in rows_of(content):
            if row.kind == "group":
                h5g.create(file.id, row.path.encode(), gcpl=group_properties(h5p.GROUP_CREATE))
            else:
                put_value(file[row.parent], row, content)
        file.flush()
        image = file.id.get_file_image()
    return image + bytes(-len(image) % 8)


def group_properties(kind: Any) -> Any:
    """Of a group, or of a file's root: without time stamps, and with all links in its header.

    libhdf5 would move a group's ninth link, and all with it, into a heap. h5py has no name for the
    call that prevents this.
    """
    properties = h5p.create(kind)
    properties.set_obj_track_times(False)
    max_links = document()["limits"]["links_per_group"]
    set_phase_change = ctypes.CDLL(h5p.__file__).H5Pset_link_phase_change
    set_phase_change.argtypes = [ctypes.c_int64, ctypes.c_uint, ctypes.c_uint]
    set_phase_change.restype = ctypes.c_int
    set_phase_change(properties.id, max_links, max_links - 1)
    return properties


def put_value(group: Any, row: Row, content: Content) -> None:
    """Write the value of a row into its group, a dataset with its unit and frame."""
    value = content[row.path]
    texts = (value,) if isinstance(value, str) else value
    if row.type == "text" and any(text.endswith("\0") for text in texts):
        # It would be read back without its end.
        raise InputError(f"{value!r} ends in a control character. Remove it.", where=row.path)
    data = as_stored(value, row.type)
    if row.kind == "attribute":
        group.attrs.create(row.name, data)
        return
    dataset = group.create_dataset(row.name, data=data, fill_time="never")
    for name, text in unit_and_frame(row, content).items():
        dataset.attrs.create(name, as_stored(text, "text"))


def as_stored(value: Any, kind: str) -> np.ndarray:
    """A value as it is stored; texts in as many bytes as the longest takes, without an end."""
    if kind != "text":
        return np.asarray(value, dtype=f"<{kind}", order="C")
    encoded = value.encode() if isinstance(value, str) else [text.encode() for text in value]
    bare = np.array(encoded, dtype=bytes)
    return bare.astype(h5py.string_dtype("utf-8", max(1, bare.itemsize)))


def unit_and_frame(row: Row, content: Content) -> dict[str, str]:
    """Unit and frame to write beside a dataset, "@frame" and "@source_frame" filled in."""
    own_frames = {
        "@frame": content.get("/@frame"),
        "@source_frame": content.get("/registration@source_frame"),
    }
    unit = row.unit or ""
    for name, frame in own_frames.items():
        unit = unit.replace(name, UNITS_OF_FRAME.get(frame, "?"))
    texts = {"unit": unit, "frame": own_frames.get(row.frame, row.frame)}
    return {name: text for name, text in texts.items() if text}
