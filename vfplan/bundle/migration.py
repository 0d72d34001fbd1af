"""Forward, never back: an old bundle's content in a new file of this version."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vfplan import __version__
from vfplan.bundle.content import VERSION, Content, rows_by_path
from vfplan.bundle.read import read_bundle, within_file
from vfplan.bundle.seal import HDF5_MAGIC, MAGIC, TAIL_MAGIC
from vfplan.bundle.write import completed, write_content
from vfplan.errors import BundleError, CorruptError, InputError, SettingError, UnsafeError
from vfplan.io.files import OpenedFile, now_utc, opened_file
from vfplan.io.sandbox import run_in_sandbox

HISTORY = "/provenance/history"
JOB = "vfplan.bundle.oldformats:old_content"
"""Reads an old bundle, in a process apart: libhdf5 can crash on what somebody else wrote."""


def migrate(old: str | Path, new: str | Path, *, overwrite: bool = False) -> Content:
    """Write the content of an older bundle as one of this version; the old file is not touched.

    What is kept is kept bit for bit. The migration, with the SHA-256 of the old file and the key
    of who had signed it, is added to `/provenance/history`. The new bundle is unsigned, and nobody
    has reviewed it. Returns the new content.

    Raises
    ------
    InputError
        There is no such file, or it has the present version already.
    BundleError
        It is not sound, its seal is missing, or its parts do not agree.
    SceneError
        The old fixture leaks between samples, which version 0.1 did not check.
    """
    check_is_older(Path(old))
    head, content = read_old(Path(old))
    line = (
        f"{now_utc()} vfplan {__version__}: migrated from {head['version']} to {VERSION},"
        f" SHA-256 {head['sha256']}"
    )
    if head["signed_by"] is not None:
        line += f", was signed by key {head['signed_by']}"
    content[HISTORY] = (*content.get(HISTORY, ()), line)
    content = completed(content)
    try:
        write_content(content, Path(new), overwrite=overwrite)
    except SettingError as error:
        # It is the old file whose parts do not agree.
        raise UnsafeError(error.message, where=f"{old}:{error.where}", code=error.code) from None
    return content


def check_is_older(path: Path) -> None:
    """Refuse a bundle of the present version: a sound one needs no migration."""
    with opened_file(path) as stream:
        start = stream.read(len(MAGIC))
        size = stream.seek(0, 2)
        stream.seek(max(0, size - len(TAIL_MAGIC)))
        is_current = start == HDF5_MAGIC and stream.read() == TAIL_MAGIC
    if is_current:
        read_bundle(path)
        raise InputError(
            f"has version {VERSION} already. Use it as it is.",
            where=str(path),
            code="no-migration-needed",
        )


def read_old(path: Path) -> tuple[dict[str, Any], Content]:
    """The head that `old_content` yields, and the content of an old bundle."""
    file = OpenedFile(path)
    try:
        answers = run_in_sandbox(JOB, file=file, where=str(path), kind=CorruptError)
        head = next(answers)
        content: Content = {}
        for name, value in head["values"].items():
            if isinstance(value, list):
                value = tuple(value)
            content[name] = value
        for name, (values,) in zip(head["tables"], answers, strict=True):
            content[name] = np.ascontiguousarray(values, dtype=f"<{rows_by_path()[name].type}")
    except BundleError as error:
        error.where = within_file(path, error.where)
        raise
    return head, content
