"""Approval of a bundle: signing it.

Needs the extra `[sign]` (the package `cryptography`).
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from vfplan.bundle.keys import key_id_of, read_private
from vfplan.bundle.read import checked_payload
from vfplan.bundle.seal import (
    LATEST,
    Seal,
    seal_length,
    signed_message,
    to_bytes,
    with_end_of_file,
)
from vfplan.errors import SettingError
from vfplan.io.files import write_whole


def sign(
    source: str | Path,
    target: str | Path,
    key_path: str | Path,
    *,
    case: str = "",
    robot_serial: str = "",
    registered_utc: str | None = None,
    overwrite: bool = False,
) -> Seal:
    """Approve a bundle: write it again, its content unchanged, with a signed seal.

    `case`, `robot_serial` and `registered_utc` (ISO 8601, UTC) are covered by the signature. An
    earlier signature is replaced.

    Raises
    ------
    BundleError
        The bundle is not sound.
    InputError
        There is no such key, or others than its owner can read it.
    SettingError
        The time is none, or a text does not fit into the seal.
    OutputError
        The target exists and `overwrite` is false.
    """
    registered = None if registered_utc is None else _seconds(registered_utc)
    for what, text in (("case token", case), ("robot serial", robot_serial)):
        if not text.isprintable():
            raise SettingError(f"{what} {text!r} holds control characters")
    key = read_private(key_path)
    payload = checked_payload(source)
    payload = with_end_of_file(payload, len(payload) + seal_length(case, robot_serial))
    seal = Seal(
        len(payload),
        hashlib.sha256(payload).digest(),
        key_id=key_id_of(key.public_key()),
        signature=bytes(64),
        case=case,
        robot_serial=robot_serial,
        registered=registered,
    )
    seal = replace(seal, signature=key.sign(signed_message(seal)))
    write_whole(Path(target), [payload, to_bytes(seal)], overwrite=overwrite)
    return seal


def _seconds(text: str) -> int:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise SettingError(f"{text!r} is no time; 2026-01-31T12:00:00Z is one") from None
    if moment.tzinfo is None:
        raise SettingError(f"{text!r} has no time zone; end it with Z for UTC")
    seconds = int((moment.astimezone(UTC) - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds())
    if not 0 < seconds <= LATEST:
        raise SettingError(f"{text!r} lies outside 1970 to 9999")
    return seconds
