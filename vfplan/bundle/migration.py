"""Forward, never back: an old bundle's content in a new file of this version."""

from __future__ import annotations

import hashlib
from pathlib import Path

from vfplan import __version__
from vfplan._core import read_payload
from vfplan.bundle.content import Content, most_bytes
from vfplan.bundle.read import opened_source
from vfplan.bundle.write import MAGIC, VERSION, completed, write_content
from vfplan.errors import InputError
from vfplan.io.files import now_utc

HISTORY = "/provenance/history"


def migrate(old: str | Path, new: str | Path, *, overwrite: bool = False) -> Content:
    """Write the content of an older bundle as one of this version; the old file is not touched.

    What is kept is kept bit for bit; the migration, with the SHA-256 of the old file, is added to
    `/provenance/history`. Returns the new content.

    Raises
    ------
    InputError
        There is no such file, or it has the present version already.
    BundleError
        It is not sound.
    SceneError
        The old fixture leaks between samples, which the old version did not check.
    """
    content, digest = _content_of_0_1(old)
    line = (
        f"{now_utc()} vfplan {__version__}: migrated from {content['/@version']} to {VERSION},"
        f" SHA-256 {digest}"
    )
    content = completed(content | {HISTORY: (*content.get(HISTORY, ()), line)})
    write_content(content, Path(new), overwrite=overwrite)
    return content


def _content_of_0_1(path: str | Path) -> tuple[Content, str]:
    """The content of a bundle of version 0.1, which had no seal, and the SHA-256 of its bytes."""
    with opened_source(path) as stream:
        payload = stream.read(most_bytes() + 1)
        if payload.startswith(MAGIC):
            raise InputError("has a seal, so it needs no migration", where=str(path))
        content, _ = read_payload(payload, sealed=False)
        return content, hashlib.sha256(payload).hexdigest()
