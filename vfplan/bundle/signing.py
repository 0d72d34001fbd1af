"""Approval of a bundle: signing it, and what a robot may demand of a signature.

Needs the extra `[sign]` (the package `cryptography`).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from vfplan.bundle.keys import key_id_of, read_private
from vfplan.bundle.seal import LATEST, Seal, seal_of, signed_message, to_block
from vfplan.errors import SettingError, SignatureError
from vfplan.io.disk import write_whole

CLOCK_SKEW = 60  # s a registration may seem to lie in the future


@dataclass(frozen=True)
class Trust:
    """What is demanded of a bundle's signature.

    Parameters
    ----------
    keys
        Public keys by key id (see `read_keys`).
    case, robot_serial
        What the bundle must have been signed for; `None`: not checked.
    max_age
        How long ago the patient may have been registered [s]; `None`: not checked.

    Raises `SettingError` when `max_age` is negative or not finite.
    """

    keys: dict[bytes, Any]
    case: str | None = None
    robot_serial: str | None = None
    max_age: float | None = None

    def __post_init__(self) -> None:
        """Refuse an age that no comparison would ever exceed: NaN, infinite, negative."""
        if self.max_age is not None and not 0 <= self.max_age < math.inf:
            raise SettingError(f"maximum age {self.max_age} s; finite and 0 or more wanted")


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
    """Approve a bundle: write it again, its payload unchanged, under a signed seal.

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
    from vfplan.bundle.files import checked_payload

    registered = None if registered_utc is None else _seconds(registered_utc)
    for what, text in (("case token", case), ("robot serial", robot_serial)):
        if not text.isprintable():
            raise SettingError(f"{what} {text!r} holds control characters")
    key = read_private(key_path)
    payload = checked_payload(source)
    seal = replace(
        seal_of(payload),
        key_id=key_id_of(key.public_key()),
        signature=bytes(64),
        case=case,
        robot_serial=robot_serial,
        registered=registered,
    )
    seal = replace(seal, signature=key.sign(signed_message(seal)))
    write_whole(Path(target), [to_block(seal), payload], overwrite=overwrite)
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


def check_trust(seal: Seal, trust: Trust, now: float | None = None) -> None:
    """Refuse a seal that no trusted key signed for this case, this robot and this day.

    `now` is in seconds since 1970 UTC.

    Raises
    ------
    SignatureError
        The signature is missing, wrong, by an unknown key, or for something else.
    """
    if seal.key_id is None:
        raise SignatureError("is not signed; a signature of a trusted key is demanded")
    key = trust.keys.get(seal.key_id)
    if key is None:
        raise SignatureError(f"is signed by key {seal.key_id.hex()}, which is not a trusted one")
    from cryptography.exceptions import InvalidSignature

    try:
        key.verify(seal.signature, signed_message(seal))
    except InvalidSignature:
        raise SignatureError(f"the signature by key {seal.key_id.hex()} does not hold") from None
    for what, signed, wanted in (
        ("case", seal.case, trust.case),
        ("robot", seal.robot_serial, trust.robot_serial),
    ):
        if wanted is not None and signed != wanted:
            raise SignatureError(f"is signed for {what} {signed!r}; {wanted!r} is demanded")
    if trust.max_age is not None:
        _check_age(seal, trust.max_age, time.time() if now is None else now)


def _check_age(seal: Seal, max_age: float, now: float) -> None:
    if seal.registered is None:
        raise SignatureError("no registration time is signed, and a maximum age is demanded")
    age = now - seal.registered
    if age > max_age:
        raise SignatureError(f"the registration is {age:.0f} s old; at most {max_age:.0f} allowed")
    if age < -CLOCK_SKEW:
        raise SignatureError(f"the registration lies {-age:.0f} s in the future")
