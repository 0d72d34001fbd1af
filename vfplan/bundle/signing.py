"""Approval of a bundle: Ed25519 keys, signatures, and what a robot may demand of them.

Needs the extra `[sign]` (the package `cryptography`).
"""

from __future__ import annotations

import hashlib
import math
import os
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from vfplan.bundle.seal import LATEST, Seal, seal_of, signed_message, to_block
from vfplan.disk import opened_file, write_whole
from vfplan.errors import InputError, MissingExtra, SettingError, SignatureError

PEM_END = b"-----END PUBLIC KEY-----"
KEY_FILE_BYTES = 1 << 20
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


def _ed25519() -> tuple[Any, Any]:
    try:
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ImportError:
        raise MissingExtra(
            "signatures need the package cryptography: pip install 'vfplan[sign]'"
        ) from None
    return ed25519, serialization


def key_id_of(public: Any) -> bytes:
    """The first 16 bytes of SHA-256 of the raw public key."""
    return hashlib.sha256(public.public_bytes_raw()).digest()[:16]


def keygen(private_path: str | Path, *, overwrite: bool = False) -> tuple[Path, str]:
    """Make a key pair: PEM files NAME (PKCS 8, for its owner only) and NAME with suffix `.pub`.

    Returns the public key's path and its key id in hex.

    Raises
    ------
    OutputError
        One of the two exists and `overwrite` is false.
    MissingExtra
        `cryptography` is not installed.
    """
    ed25519, serialization = _ed25519()
    private_path = Path(private_path)
    public_path = private_path.with_suffix(".pub")
    if public_path == private_path:
        raise SettingError("the private key's name may not end in .pub", where=str(private_path))
    key = ed25519.Ed25519PrivateKey.generate()
    private = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    public = key.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    old = public_path.read_bytes() if public_path.is_file() else None
    write_whole(public_path, [public], overwrite=overwrite)
    try:
        write_whole(private_path, [private], overwrite=overwrite, mode=0o600)
    except BaseException:
        if old is None:
            os.unlink(public_path)
        else:
            write_whole(public_path, [old], overwrite=True)
        raise
    return public_path, key_id_of(key.public_key()).hex()


def _read_pem(path: str | Path) -> bytes:
    with opened_file(Path(path)) as file:
        data = file.read(KEY_FILE_BYTES + 1)
    if len(data) > KEY_FILE_BYTES:
        raise InputError(f"more than {KEY_FILE_BYTES} bytes; no file of keys", where=str(path))
    return data


def read_keys(path: str | Path) -> dict[bytes, Any]:
    """The public keys of a file of PEM keys, one after the other, by key id.

    Raises `InputError` when there is no such file, or it holds anything but Ed25519 public keys.
    """
    ed25519, serialization = _ed25519()
    keys = {}
    for part in _read_pem(path).split(PEM_END)[:-1]:
        try:
            key = serialization.load_pem_public_key(part.lstrip() + PEM_END + b"\n")
        except Exception as error:  # the library raises many kinds for a damaged key
            raise InputError("holds a public key that cannot be read", where=str(path)) from error
        if not isinstance(key, ed25519.Ed25519PublicKey):
            raise InputError("holds a key that is not Ed25519", where=str(path))
        keys[key_id_of(key)] = key
    if not keys:
        raise InputError("holds no public key in PEM form", where=str(path))
    return keys


def _read_private(path: str | Path) -> Any:
    ed25519, serialization = _ed25519()
    try:
        key = serialization.load_pem_private_key(_read_pem(path), password=None)
    except InputError:
        raise
    except Exception as error:  # as above
        raise InputError("holds no private key in PEM form", where=str(path)) from error
    if not isinstance(key, ed25519.Ed25519PrivateKey):
        raise InputError("holds a key that is not Ed25519", where=str(path))
    return key


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
        There is no such key, or the time is none.
    OutputError
        The target exists and `overwrite` is false.
    """
    from vfplan.bundle.files import checked_payload

    registered = None if registered_utc is None else _seconds(registered_utc)
    for what, text in (("case token", case), ("robot serial", robot_serial)):
        if not text.isprintable():
            raise SettingError(f"{what} {text!r} holds control characters")
    key = _read_private(key_path)
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
