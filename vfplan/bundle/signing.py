"""Sign a bundle.

Needs the extra `[sign]` (the package `cryptography`).
"""

from __future__ import annotations

import hashlib
import shlex
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from vfplan.bundle.content import from_content
from vfplan.bundle.read import opened_source, unsealed
from vfplan.bundle.seal import Seal, seal_length, signed_message, to_bytes, with_end_of_file
from vfplan.bundle.trust import key_id_of, read_private
from vfplan.errors import CheckFailed, SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import now_utc
from vfplan.io.writing import write_whole


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
    if registered_utc is None:
        registered_utc = now_utc()
    signed_at = seconds_since_1970(registered_utc)
    for what, text in (("case token", case), ("robot serial", robot_serial)):
        if not text.isprintable():
            raise SettingError(
                f"The {what} {text!r} holds control characters. Type it without them."
            )
    key = read_private(key_path)
    with opened_source(source) as stream:
        sealed = unsealed(stream)
        fixture = from_content(sealed.read()[0])
        payload = sealed.payload
    if not despite_findings:
        check_is_approved(fixture, str(source))
    payload = with_end_of_file(payload, len(payload) + seal_length(case, robot_serial))
    seal = Seal(
        len(payload),
        hashlib.sha256(payload).digest(),
        key_id=key_id_of(key.public_key()),
        signature=bytes(64),
        case=case,
        robot_serial=robot_serial,
        signed_at=signed_at,
        despite_findings=bool(fixture.open_findings) or fixture.reviewed is None,
    )
    seal = replace(seal, signature=key.sign(signed_message(seal)))
    write_whole(Path(target), [payload, to_bytes(seal)], overwrite=overwrite)
    return seal


def check_is_approved(fixture: Fixture, where: str) -> None:
    """Refuse a fixture with open doubts, or one that nobody has reviewed."""
    slice_option = "--slice IMAGE " if fixture.image is not None else ""
    approved = Path(where).with_name(f"{Path(where).stem}-approved.h5")
    page = f"vfplan review {shlex.quote(where)} {slice_option}-o {shlex.quote(str(approved))}"
    how = f"{page}. Or sign it all the same with --despite-findings"
    codes = [finding.code for finding in fixture.open_findings]
    if codes:
        subject, answer = f"{len(codes)} findings are", "Answer them"
        if len(codes) == 1:
            subject, answer = "1 finding is", "Answer it"
        raise CheckFailed(
            f"{subject} not answered: {', '.join(sorted(set(codes)))}. {answer}: {how}.",
            where=where,
            code="findings-unanswered",
            numbers={"unanswered": len(codes), "codes": codes},
        )
    if fixture.reviewed is None:
        raise CheckFailed(
            f"Nobody has reviewed it. Review it: {how}.", where=where, code="not-reviewed"
        )


def seconds_since_1970(text: str) -> int:
    """A time in ISO 8601 as seconds since 1970 UTC."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise SettingError(f"{text!r} is no time. Write it like 2026-01-31T12:00:00Z.") from None
    if moment.tzinfo is None:
        raise SettingError(f"{text!r} has no time zone. End it with Z for UTC.")
    seconds = int((moment - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds())
    # In UTC, a moment of the year 9999 may lie in the year after it.
    if seconds <= 0 or moment > datetime.max.replace(tzinfo=UTC):
        raise SettingError(f"{text!r} lies outside 1970 to 9999. Give the time of today.")
    return seconds
