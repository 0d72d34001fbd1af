"""Read, write and describe bundles on disk."""

from __future__ import annotations

import os
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from vfplan.bundle.content import Content, from_content, setting, to_content
from vfplan.bundle.findings import Findings
from vfplan.bundle.parse import parse, peek_version
from vfplan.bundle.store import read_whole, to_payload, write_whole
from vfplan.bundle.table import table
from vfplan.errors import BundleError, CorruptError, VersionError
from vfplan.fixture import Fixture

FORMAT = "vfplan-fixture"
VERSION = "0.1"


def now_utc() -> str:
    """The time for a bundle's provenance: now, or what SOURCE_DATE_EPOCH says."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    moment = datetime.now(UTC) if epoch is None else datetime.fromtimestamp(int(epoch), UTC)
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def write_fixture(fixture: Fixture, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a fixture as a bundle, whole or not at all.

    The bytes are read back and checked before the file appears under its name.

    Raises
    ------
    OutputError
        The path exists and `overwrite` is false, or cannot be written.
    BundleError
        The fixture breaks a rule of the format.
    """
    content = {"/@format": FORMAT, "/@version": VERSION, **to_content(fixture)}
    payload = to_payload(content, table(VERSION))
    _checked(payload)
    write_whole(Path(path), payload, overwrite=overwrite)


def read_fixture(path: str | Path) -> Fixture:
    """Read a bundle; either the whole of it is sound or nothing is returned.

    Raises
    ------
    InputError
        There is no such file.
    BundleError
        The bundle is corrupt, unsafe, or of a version this program does not read.
    """
    return from_content(read_content(path))


def read_content(path: str | Path) -> Content:
    """Every value of a bundle, by its path in the format's table."""
    try:
        return _checked(read_whole(Path(path), table(VERSION).limits["payload_bytes"]))
    except BundleError as error:
        if error.where is None or not error.where.startswith(str(path)):
            error.where = str(path) + (f":{error.where}" if error.where else "")
        raise


def _checked(payload: bytes) -> Content:
    found_format, found_version = peek_version(payload)
    if found_format != FORMAT:
        raise CorruptError(f"format is {found_format!r}; {FORMAT!r} wanted", where="/@format")
    if found_version != VERSION:
        raise VersionError(
            f"version {found_version!r}; this program reads {VERSION}", where="/@version"
        )
    content = parse(payload, VERSION, Findings())
    _check_settings(content)
    return content


def _check_settings(content: Content) -> None:
    if not re.fullmatch(
        r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", content["/provenance@created_utc"], re.ASCII
    ):
        raise CorruptError("is not a UTC time", where="/provenance@created_utc")
    for one, other in (("input_roles", "input_sha256"), ("setting_names", "setting_values")):
        pair = [content.get(f"/provenance/{name}") for name in (one, other)]
        if (pair[0] is None) != (pair[1] is None):
            raise CorruptError(f"{one} and {other} need each other", where="/provenance")
    for text in content.get("/provenance/setting_values", ()):
        setting(text)


def describe(path: str | Path) -> dict[str, Any]:
    """What `vfplan info --json` prints: head, then every value by its path in the table.

    Per-point tables are summed up by their shape and range.
    """
    content = read_content(path)
    described: dict[str, Any] = {
        "format": content["/@format"],
        "version": content["/@version"],
        "frame": content["/@frame"],
        "points": len(content["/points"]),
        "seal": {"ok": False, "signed": False, "key_id": None},
    }
    for row in table(VERSION).rows:
        if row.path in content:
            described[row.path] = _summary(content[row.path], row)
    return described


def _summary(value: Any, row: Any) -> Any:
    if not {"N", "K"} & set(row.shape):
        return list(value) if isinstance(value, tuple) else value
    return {"shape": list(value.shape), "min": value.min(), "max": value.max()}
