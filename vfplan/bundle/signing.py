"""Sign a bundle.

Needs the extra `[sign]` (the package `cryptography`).
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NoReturn

from vfplan.bundle.content import from_content
from vfplan.bundle.keys import key_id_of, read_private
from vfplan.bundle.read import opened_source, unsealed
from vfplan.bundle.seal import (
    LATEST,
    Seal,
    seal_length,
    signed_message,
    to_bytes,
    with_end_of_file,
)
from vfplan.errors import CheckFailed, SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import now_utc
from vfplan.io.staging import write_whole


def sign(
    source: str | Path,
    target: str | Path,
    key_path: str | Path,
    *,
    case: str = "",
    robot_serial: str = "",
    registered_utc: str | None = None,
    despite_findings: bool = False,
    overwrite: bool = False,
) -> Seal:
    """Sign a bundle: write it again, its content unchanged, with a signed seal.

    `case`, `robot_serial` and the time of signing are covered by the signature. With
    `registered_utc` (ISO 8601, UTC), when the patient was registered, that time stands in place of
    the present one: the bundle's age counts from it. An earlier signature is replaced.

    A bundle is signed when a person has reviewed it and answered all doubts. With
    `despite_findings` it is signed all the same; the seal says so, and whoever reads it sees it.

    Raises
    ------
    CheckFailed
        A doubt is not answered, or nobody reviewed the bundle, and `despite_findings` is false.
    BundleError
        The bundle is not sound.
    InputError
        There is no such key, or others than its owner can read it.
    SettingError
        The time is none, or a text does not fit into the seal.
    OutputError
        The target exists and `overwrite` is false.
    """
    signed_at = _seconds(now_utc() if registered_utc is None else registered_utc)
    for what, text in (("case token", case), ("robot serial", robot_serial)):
        if not text.isprintable():
            raise SettingError(f"{what} {text!r} holds control characters.")
    key = read_private(key_path)
    with opened_source(source) as stream:
        sealed = unsealed(stream)
        fixture = from_content(sealed.read()[0])
        payload = sealed.payload
    is_clear = not fixture.open_findings and fixture.reviewed is not None
    if not is_clear and not despite_findings:
        _refuse(fixture, str(source))
    payload = with_end_of_file(payload, len(payload) + seal_length(case, robot_serial))
    seal = Seal(
        len(payload),
        hashlib.sha256(payload).digest(),
        key_id=key_id_of(key.public_key()),
        signature=bytes(64),
        case=case,
        robot_serial=robot_serial,
        signed_at=signed_at,
        despite_findings=not is_clear,
    )
    seal = replace(seal, signature=key.sign(signed_message(seal)))
    write_whole(Path(target), [payload, to_bytes(seal)], overwrite=overwrite)
    return seal


def _refuse(fixture: Fixture, where: str) -> NoReturn:
    """Say which doubts are open, or that nobody reviewed the bundle."""
    how = "`vfplan review` shows it and asks; --despite-findings signs it all the same"
    codes = [finding.code for finding in fixture.open_findings]
    if codes:
        raise CheckFailed(
            f"{len(codes)} findings are not answered: {', '.join(sorted(set(codes)))}. {how}.",
            where=where,
            code="findings-unanswered",
            numbers={"unanswered": len(codes), "codes": codes},
        )
    raise CheckFailed(f"nobody has reviewed it. {how}.", where=where, code="not-reviewed")


def _seconds(text: str) -> int:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise SettingError(f"{text!r} is no time; 2026-01-31T12:00:00Z is one.") from None
    if moment.tzinfo is None:
        raise SettingError(f"{text!r} has no time zone. End it with Z for UTC.")
    seconds = int((moment.astimezone(UTC) - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds())
    if not 0 < seconds <= LATEST:
        raise SettingError(f"{text!r} lies outside 1970 to 9999.")
    return seconds
