"""What a robot may demand of a bundle's signature. Needs the extra `[sign]`."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

from vfplan._core import Sealed
from vfplan.errors import SettingError, SignatureError

CLOCK_SKEW = 60
"""How far a time of signing may lie in the future, because two clocks differ [s]."""


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

    Raises `SettingError` when `keys` is not what `read_keys` returns, or `max_age` is negative or
    not finite.
    """

    keys: dict[bytes, Any]
    case: str | None = None
    robot_serial: str | None = None
    max_age: float | None = None

    def __post_init__(self) -> None:
        """Refuse what are no keys, and an age that no comparison would ever exceed."""
        if not isinstance(self.keys, dict) or not all(isinstance(i, bytes) for i in self.keys):
            raise SettingError(
                f"The trusted keys are {self.keys!r}. Give what `vfplan.bundle.read_keys(PATH)` "
                "returns."
            )
        if self.max_age is not None and not 0 <= self.max_age < math.inf:
            raise SettingError(f"The maximum age is {self.max_age} s. Give a finite number from 0.")


def check_trust(seal: Sealed, trust: Trust, now: float | None = None) -> None:
    """Refuse a seal that no trusted key signed for this case, this robot and this day.

    What must be signed are the bytes of the file, as they are.

    now: the time to count the age to [s since 1970 UTC]; without it the present

    Raises `SignatureError`.
    """
    if not seal.signed:
        raise SignatureError("is not signed. Sign it: vfplan sign.")
    key = trust.keys.get(seal.key_id)
    if key is None:
        raise SignatureError(
            f"is signed by key {seal.key_id.hex()}, which is not trusted. Sign it with a trusted "
            "key, or add the public key to the trusted ones."
        )
    from cryptography.exceptions import InvalidSignature

    try:
        key.verify(seal.signature, seal.signed_message)
    except InvalidSignature:
        raise SignatureError(
            f"The signature by key {seal.key_id.hex()} does not hold: the file is not what was "
            "signed. Fetch it once more from the planner."
        ) from None
    if trust.case is not None and not seal.case:
        raise SignatureError(
            f"is signed for no particular case. Sign it for {trust.case!r}: vfplan sign --case."
        )
    if trust.case is not None and seal.case != trust.case:
        raise SignatureError(
            f"is signed for case {seal.case!r}. Sign it for {trust.case!r}, or demand its own case."
        )
    if trust.robot_serial is not None and not seal.robot_serial:
        raise SignatureError(
            "is signed for no particular robot. "
            f"Sign it for {trust.robot_serial!r}: vfplan sign --robot-serial."
        )
    if trust.robot_serial is not None and seal.robot_serial != trust.robot_serial:
        raise SignatureError(
            f"is signed for robot {seal.robot_serial!r}. Sign it for {trust.robot_serial!r}, or "
            "load it on its own robot."
        )
    if trust.max_age is None:
        return
    if not seal.signed_at:
        raise SignatureError("does not state when it was signed. Sign it once more with its time.")
    if now is None:
        now = time.time()
    age = now - seal.signed_at
    if age > trust.max_age:
        raise SignatureError(
            f"was signed {age:.0f} s ago, and at most {trust.max_age:.0f} s are allowed. Review "
            "the plan and sign it once more."
        )
    if age < -CLOCK_SKEW:
        raise SignatureError(
            f"was signed {-age:.0f} s in the future. Set the clocks of planner and robot."
        )
