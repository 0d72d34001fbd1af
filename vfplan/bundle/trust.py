"""What a robot may demand of a bundle's signature. Needs the extra `[sign]`."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

from vfplan._core import Sealed
from vfplan.errors import SettingError, SignatureError

CLOCK_SKEW = 60  # s a signature may seem to lie in the future


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
        How long ago it may have been signed [s]; `None`: not checked. Where the signer stated when
        the patient was registered, that counts.

    Raises `SettingError` when `max_age` is negative or not finite.
    """

    keys: dict[bytes, Any]
    case: str | None = None
    robot_serial: str | None = None
    max_age: float | None = None

    def __post_init__(self) -> None:
        """Refuse an age that no comparison would ever exceed: NaN, infinite, negative."""
        if self.max_age is not None and not 0 <= self.max_age < math.inf:
            raise SettingError(f"maximum age {self.max_age} s. Give a finite number from 0.")


def check_trust(seal: Sealed, trust: Trust, now: float | None = None) -> None:
    """Refuse a seal that no trusted key signed for this case, this robot and this day.

    What must be signed are the bytes of the file, as they are.

    `now` is in seconds since 1970 UTC.

    Raises SignatureError: the signature is missing, wrong, by an unknown key, or for something else
    """
    if not seal.signed:
        raise SignatureError("is not signed. Give a signature of a trusted key.")
    key = trust.keys.get(seal.key_id)
    if key is None:
        raise SignatureError(f"is signed by key {seal.key_id.hex()}, which is not a trusted one.")
    from cryptography.exceptions import InvalidSignature

    try:
        key.verify(seal.signature, seal.signed_message)
    except InvalidSignature:
        raise SignatureError(f"the signature by key {seal.key_id.hex()} does not hold.") from None
    for what, signed, wanted in (
        ("case", seal.case, trust.case),
        ("robot", seal.robot_serial, trust.robot_serial),
    ):
        if wanted is not None and signed != wanted:
            raise SignatureError(f"is signed for {what} {signed!r}. {wanted!r} is demanded.")
    if trust.max_age is not None:
        _check_age(seal, trust.max_age, time.time() if now is None else now)


def _check_age(seal: Sealed, max_age: float, now: float) -> None:
    if not seal.signed_at:
        raise SignatureError("does not state when it was signed, and a maximum age is demanded.")
    age = now - seal.signed_at
    if age > max_age:
        raise SignatureError(
            f"was signed {age:.0f} s ago. At most {max_age:.0f} s old is demanded."
        )
    if age < -CLOCK_SKEW:
        raise SignatureError(f"the time of signing lies {-age:.0f} s in the future.")
