"""What a robot may demand of a bundle's signature. Needs the extra `[sign]`.

Ed25519 keys in PEM files: private ones to sign with, public ones to trust.

Needs the extra `[sign]` (the package `cryptography`).
"""

from __future__ import annotations

import hashlib
import math
import os
import stat
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vfplan._core import Sealed
from vfplan.errors import InputError, OutputError, SettingError, SignatureError, requires_extra
from vfplan.io.files import MAX_SETTINGS_BYTES, opened_file
from vfplan.io.writing import write_together

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


BEGIN = b"-----BEGIN PUBLIC KEY-----"
END = b"-----END PUBLIC KEY-----"

COPY_KEY = "Copy the file that vfplan keygen wrote with .pub"
MAKE_KEY = "Make a pair of keys: vfplan keygen"


def import_ed25519() -> tuple[Any, Any]:
    """The two modules of `cryptography` that keys need."""
    with requires_extra("signatures need the package cryptography", "sign"):
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    return ed25519, serialization


def key_id_of(public: Any) -> bytes:
    """The first 16 bytes of SHA-256 of the raw public key."""
    return hashlib.sha256(public.public_bytes_raw()).digest()[:16]


def keygen(private_path: str | Path, *, overwrite: bool = False) -> tuple[Path, str]:
    """Make a key pair: PEM files NAME (PKCS 8, for its owner only) and NAME with suffix `.pub`.

    Both are written or none. Returns the public key's path and its key id in hex.

    Raises
    ------
    OutputError
        One of the two exists and `overwrite` is false, or cannot be written.
    MissingExtra
        `cryptography` is not installed.
    """
    ed25519, serialization = import_ed25519()
    private_path = Path(private_path)
    public_path = private_path.with_suffix(".pub")
    if public_path == private_path:
        raise SettingError(
            "The private key's name may not end in .pub. Give another name.",
            where=str(private_path),
        )
    if public_path.exists() and not private_path.exists() and not overwrite:
        raise OutputError(
            f"exists already, and may be the public half of a private key other than "
            f"{private_path.name}. Give the new key another name",
            where=str(public_path),
            code="public-key-exists",
        )
    key = ed25519.Ed25519PrivateKey.generate()
    private = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    public = key.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    pair = [(public_path, public, 0o666), (private_path, private, 0o600)]
    write_together(pair, overwrite=overwrite)
    return public_path, key_id_of(key.public_key()).hex()


def read_keys(path: str | Path) -> dict[bytes, Any]:
    """The public keys of a file of PEM keys, one after the other, by key id.

    Between them there may be empty lines and comments, lines that begin with `#`.

    Raises `InputError` when there is no such file, or it holds anything but Ed25519 public keys.
    """
    ed25519, serialization = import_ed25519()
    keys = {}
    for block in public_key_blocks(read_pem(path)[0], str(path)):
        try:
            key = serialization.load_pem_public_key(block)
        # The library raises many kinds of errors for a damaged key.
        except Exception as error:
            raise InputError(
                f"It holds a public key that cannot be read. {COPY_KEY}.", where=str(path)
            ) from error
        if not isinstance(key, ed25519.Ed25519PublicKey):
            raise InputError(f"It holds a key that is not Ed25519. {MAKE_KEY}.", where=str(path))
        keys[key_id_of(key)] = key
    if not keys:
        raise InputError(f"It holds no public key in PEM form. {COPY_KEY}.", where=str(path))
    return keys


def public_key_blocks(data: bytes, where: str) -> Iterator[bytes]:
    """The PEM blocks of public keys; nothing but empty lines and comments stands between them."""
    block: list[bytes] = []
    for number, raw in enumerate(data.split(b"\n"), start=1):
        line = raw.strip(b" \t\r")
        if not block and (not line or line.startswith(b"#")):
            continue
        if not block and line.startswith(b"-----BEGIN") and line.endswith(b"PRIVATE KEY-----"):
            wanted = "a file of public keys alone"
            if Path(where).suffix != ".pub":
                wanted = f"its public half, {Path(where).with_suffix('.pub').name}"
            raise InputError(
                f"Line {number} begins a private key, which no robot needs. Give {wanted}.",
                where=where,
                code="private-key",
            )
        if not block and line != BEGIN:
            raise InputError(
                f"Line {number} belongs to no public key in PEM form. Remove it, or begin it with "
                "#.",
                where=where,
            )
        block.append(line)
        if line == END:
            yield b"\n".join([*block, b""])
            block.clear()
    if block:
        raise InputError(f"It ends within a public key. {COPY_KEY}.", where=where)


def read_private(path: str | Path) -> Any:
    """The private key of a PEM file that belongs to the caller, who alone can read it.

    Raises `InputError` when there is no such file, it holds no Ed25519 key, it belongs to somebody
    else, or its mode lets others read or write it.
    """
    ed25519, serialization = import_ed25519()
    data, status = read_pem(path)
    if BEGIN in data:
        raise InputError(
            "It is a public key, which signs nothing. Give the private one, whose file keygen "
            "named without .pub.",
            where=str(path),
            code="public-key",
        )
    mode = stat.S_IMODE(status.st_mode)
    if status.st_uid != os.geteuid():
        raise InputError(
            f"This private key belongs to another user (id {status.st_uid}), who can sign with it "
            "too. Give a key of your own.",
            where=str(path),
        )
    if mode & 0o077:
        raise InputError(
            f"Others can read or write this private key: its mode is {mode:04o}. Give it mode 0600 "
            "(chmod 600), or make a new key if somebody may have copied it.",
            where=str(path),
        )
    try:
        key = serialization.load_pem_private_key(data, password=None)
    # As in `read_keys`.
    except Exception as error:
        raise InputError(
            f"It holds no private key in PEM form. {MAKE_KEY}.", where=str(path)
        ) from error
    if not isinstance(key, ed25519.Ed25519PrivateKey):
        raise InputError(f"It holds a key that is not Ed25519. {MAKE_KEY}.", where=str(path))
    return key


def read_pem(path: str | Path) -> tuple[bytes, os.stat_result]:
    """The bytes of a file of keys, and its owner and mode."""
    with opened_file(Path(path)) as file:
        data = file.read(MAX_SETTINGS_BYTES + 1)
        status = os.fstat(file.fileno())
    if len(data) > MAX_SETTINGS_BYTES:
        raise InputError(
            f"It has more than {MAX_SETTINGS_BYTES} bytes, so it is no file of keys. {MAKE_KEY}.",
            where=str(path),
        )
    return data, status
