"""Read, write and describe bundles on disk."""

from __future__ import annotations

import io
import os
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

import numpy as np

from vfplan.bundle import check, leak
from vfplan.bundle.content import Content, from_content, to_content
from vfplan.bundle.findings import Findings
from vfplan.bundle.keys import read_keys
from vfplan.bundle.parse import parse, peek_version
from vfplan.bundle.seal import Seal, seal_of, to_block, unseal
from vfplan.bundle.signing import Trust, check_trust
from vfplan.bundle.store import to_payload
from vfplan.bundle.table import table
from vfplan.errors import BundleError, CorruptError, InputError, SceneError, VersionError
from vfplan.fixture import Fixture
from vfplan.io.disk import opened_file, write_whole

FORMAT = "vfplan-fixture"
VERSION = "1.0"
MAJOR_MINOR = re.compile(r"(0|[1-9][0-9]{0,4})\.(0|[1-9][0-9]{0,4})")


def now_utc() -> str:
    """The time for a bundle's provenance: now, or what SOURCE_DATE_EPOCH says."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if epoch is None:
        moment = datetime.now(UTC)
    elif epoch.isascii() and epoch.isdigit() and len(epoch) < 12:
        moment = datetime.fromtimestamp(int(epoch), UTC)
    else:
        raise InputError(f"SOURCE_DATE_EPOCH is {epoch!r}; seconds since 1970 wanted")
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


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
    head = {"/@format": FORMAT, "/@version": VERSION}
    content = head | {p: v for p, v in content.items() if p not in head and "/leak" not in p}
    _check_arrays(content)
    _check_texts(content)
    content["/@id"] = check.object_id(content)
    if "/rendering@contact_radius_m" in content:
        content |= leak.certificate(content)
        if content["/leak@kind"] != "cloud" and not content["/leak@certified"]:
            raise SceneError(check.leaking(content))
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
        payload_content(payload, Findings())
    except BundleError as error:
        raise InputError(f"no bundle can hold this: {error.message}", where=error.where) from error
    write_whole(path, [to_block(seal_of(payload)), payload], overwrite=overwrite)


def read_fixture(path: str | Path, *, trust: Trust | None = None) -> Fixture:
    """Read a bundle; either the whole of it is sound or nothing is returned.

    With `trust`, the bytes that are read must also be signed by one of its keys, for its case and
    robot, and not too long ago.

    Raises
    ------
    InputError
        There is no such file.
    BundleError
        The bundle is corrupt, unsafe, of a version this program does not read, or not signed as
        demanded.
    """
    return from_content(read_bundle(path, trust=trust)[0])


def read_bundle(source: str | Path | bytes, *, trust: Trust | None = None) -> tuple[Content, Seal]:
    """Every value of a bundle, by its path in the format's table, and its seal.

    Raises as `read_fixture` does.
    """
    with opened_source(source) as stream:
        seal, payload = _trusted(stream, trust)
        return payload_content(payload, Findings()), seal


def _trusted(stream: BinaryIO, trust: Trust | None) -> tuple[Seal, bytes]:
    seal, payload = unseal(stream, table().limits["payload_bytes"])
    if trust is not None:
        check_trust(seal, trust)
    return seal, payload


def require_signature(
    source: str | Path | bytes,
    keys: str | Path,
    *,
    case: str | None = None,
    robot_serial: str | None = None,
    max_age: float | None = None,
) -> Seal:
    """The seal of a bundle that is sound and signed by a key of the file `keys`.

    To load what was checked, and not what the file holds a moment later, give a `Trust` to
    `read_fixture` instead. `max_age` is in seconds since the registration.

    Raises as `read_fixture` does, and `MissingExtra` without the extra `[sign]`.
    """
    trust = Trust(read_keys(keys), case, robot_serial, max_age)
    return read_bundle(source, trust=trust)[1]


def checked_payload(source: str | Path) -> bytes:
    """The payload of a sound bundle. Raises as `read_fixture` does."""
    with opened_source(source) as stream:
        _, payload = unseal(stream, table().limits["payload_bytes"])
        payload_content(payload, Findings())
        return payload


class opened_source:  # noqa: N801 - used as a function
    """A binary stream over a path or over bytes; errors raised within name the path."""

    def __init__(self, source: str | Path | bytes) -> None:
        self.path = None if isinstance(source, bytes) else Path(source)
        self.stream: BinaryIO = (
            io.BytesIO(source) if isinstance(source, bytes) else opened_file(Path(source))
        )

    def __enter__(self) -> BinaryIO:
        return self.stream

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.stream.close()
        if self.path and isinstance(error, BundleError):
            error.where = str(self.path) + (f":{error.where}" if error.where else "")


def payload_content(payload: bytes, findings: Findings) -> Content:
    """The checked content of a payload whose seal is known to be good."""
    version = checked_version(*peek_version(payload))
    content = parse(payload, table(), findings, newer=version != VERSION)
    check.check(content, table(), findings)
    return content


def checked_version(found_format: str, version: str) -> str:
    """The version, if this program reads it.

    Raises
    ------
    CorruptError
        This is no fixture bundle.
    VersionError
        Its major version is another; names both and the command that helps.
    """
    if found_format != FORMAT:
        raise CorruptError(f"format is {found_format!r}; {FORMAT!r} wanted", where="/@format")
    match = MAJOR_MINOR.fullmatch(version)
    if match is None:
        raise CorruptError(f"version is {version!r}; MAJOR.MINOR wanted", where="/@version")
    if match[1] != VERSION.partition(".")[0]:
        older = int(match[1]) < 1
        help_ = (
            "`vfplan migrate OLD.h5 -o NEW.h5` brings it up to date"
            if older
            else "`pip install --upgrade vfplan` gets a program that reads it"
        )
        raise VersionError(
            f"version {version}; this program reads versions 1.x (writes {VERSION}); {help_}",
            where="/@version",
        )
    return version
