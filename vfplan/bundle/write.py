"""Write bundles to disk: whole, and read back by the reader before they get their name."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from vfplan._core import read_payload
from vfplan.bundle import leak
from vfplan.bundle.content import Content, to_content
from vfplan.bundle.seal import seal_of, to_block
from vfplan.bundle.store import to_payload
from vfplan.bundle.table import table
from vfplan.errors import BundleError, InputError, SceneError
from vfplan.fixture import Fixture
from vfplan.io.disk import write_whole

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
    since = max([VERSION, *(row.since for row in table().rows if row.path in content)])
    head = {"/@format": FORMAT, "/@version": since}
    if "/guidance@radius_m" in content:  # an older reader would forbid what shall guide
        head["/@must_understand"] = "/guidance"
    content = head | {p: v for p, v in content.items() if p not in head and "/leak" not in p}
    _check_arrays(content)
    _check_texts(content)
    # The id of the geometry: equal for equal points in the same frame.
    digest = hashlib.sha256(content["/@frame"].encode() + b"\0")
    digest.update(np.ascontiguousarray(content["/points"], dtype="<f8").data)
    content["/@id"] = digest.hexdigest()[:32]
    if "/rendering@contact_radius_m" in content:
        content |= leak.certificate(content)
        if content["/leak@kind"] != "cloud" and not content["/leak@certified"]:
            raise SceneError(leak.leaking(content))
    return content


def _check_arrays(content: Content) -> None:
    """Refuse arrays of another shape than the format's, before anything is computed from them."""
    sizes: dict[str, int] = {}
    for row in table().of("dataset"):
        if row.path not in content:
            continue
        shape = np.shape(content[row.path])
        same = len(shape) == len(row.shape) and all(
            found == (wanted if isinstance(wanted, int) else sizes.setdefault(wanted, found))
            for found, wanted in zip(shape, row.shape, strict=True)
        )
        if not same or 0 in shape:
            wanted = ", ".join(str(sizes.get(str(s), s)) for s in row.shape)
            raise InputError(f"has shape {shape}; ({wanted}) wanted", where=row.path)
        if row.type == "f8" and not np.all(np.isfinite(content[row.path])):
            raise InputError("holds a number that is not finite", where=row.path)
    stroke = content.get("/curve/stroke")
    if stroke is not None and (stroke.min() < 0 or stroke.max() >= sizes["S"]):
        raise InputError(f"names strokes that are not 0 to {sizes['S'] - 1}", where="/curve/stroke")
    triangles = content.get("/mesh/triangles")
    if triangles is not None and (triangles.min() < 0 or triangles.max() >= sizes["N"]):
        raise InputError("names points that are not there", where="/mesh/triangles")


def _check_texts(content: Content) -> None:
    """Refuse a text that ends in NUL, which would be read back without it."""
    for path, value in content.items():
        for text in value if isinstance(value, tuple) else (value,):
            if isinstance(text, str) and text.endswith("\0"):
                raise InputError(f"{text!r} ends in a control character", where=path)


def write_content(content: Content, path: Path, *, overwrite: bool) -> None:
    """Seal a content and write it, after reading it back."""
    payload = to_payload(content, table())
    try:
        read_payload(payload)
    except BundleError as error:
        raise InputError(f"no bundle can hold this: {error.message}", where=error.where) from error
    write_whole(path, [to_block(seal_of(payload)), payload], overwrite=overwrite)
