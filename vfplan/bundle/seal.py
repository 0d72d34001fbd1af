"""The seal behind a bundle's HDF5 file: what the bytes are, who signed them, and whom to trust.

Layout, little-endian (docs/format.md, section 4). L is the length of the whole file, B that of the
seal, and P = L - B:

    P + 0     8  magic "VFPLSEAL"        P + 136    8  time of signing [s since 1970], 0: not given
    P + 8     2  seal version, 2         P + 144    2  length of the case token
    P + 10    2  flags                   P + 146    2  length of the robot's serial
    P + 12    4  B                       P + 148       case token, serial (UTF-8), zeros
    P + 16    8  P                       L - 48    32  SHA-256 of bytes P to L - 48
    P + 24   32  SHA-256 of 0 to P       L - 16     4  B
    P + 56   16  key id                  L - 12     4  zero
    P + 72   64  Ed25519 signature       L - 8      8  magic "VFPLTAIL"

Flags: bit 0: signed; bit 1: signed although findings were open, or nobody had reviewed the plan.

The HDF5 file states L as its own end (`with_end_of_file`): a bundle that was cut anywhere, in its
seal too, is then a truncated file to every HDF5 library.

Seals are written here, and read and checked by the reader (vfplan/bundle/seal.hpp). Keys are
Ed25519, in PEM files: private ones to sign with, public ones to trust.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import re
import shlex
import stat
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from vfplan._core import Sealed, lookup3
from vfplan.bundle.content import document, from_content
from vfplan.display import Report, command_of
from vfplan.errors import (
    BundleError,
    CheckFailed,
    InputError,
    OutputError,
    SettingError,
    SignatureError,
)
from vfplan.fixture import Fixture
from vfplan.io.files import MAX_SETTINGS_BYTES, FilePath, now_utc, opened_file
from vfplan.io.writing import write_together, write_whole

HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
MAGIC = b"VFPLSEAL"
TAIL_MAGIC = b"VFPLTAIL"
SEAL_VERSION = 2
# Lengths that a seal may have: 512, 1024, 2048 and 4096 bytes.
LENGTHS = tuple(512 << doublings for doublings in range(4))
HEAD = struct.Struct("<8sHHIQ32s16s64sQHH")
TAIL = struct.Struct("<32sII8s")
SIGNATURE = slice(72, 136)
# In front of what is signed, so that a signature can be taken for no other one.
DOMAIN = b"vfplan bundle seal 2\0"


# The bits of a seal's flags.
SIGNED = 1
DESPITE_FINDINGS = 2


def describe(sealed: Sealed) -> Report:
    """A seal as `vfplan info --json` shows it: what is not there is absent."""
    data = {
        "ok": True,
        "signed": sealed.signed,
        "key_id": sealed.key_id.hex() if sealed.signed else None,
        "sha256": sealed.sha256.hex(),
    }
    if sealed.signed_at:
        moment = datetime.fromtimestamp(sealed.signed_at, UTC)
        data["signed_utc"] = moment.strftime("%Y-%m-%dT%H:%M:%SZ")
    given = {name: getattr(sealed, name) for name in ("case", "robot_serial", "despite_findings")}
    return data | {name: value for name, value in given.items() if value}


# --- Bytes --------------------------------------------------------------------------------------


def seal_length(case: str, robot_serial: str) -> int:
    """The least length of a seal that has room for its texts [bytes].

    Raises `SettingError` when they do not fit into the longest.
    """
    text_bytes = len(case.encode()) + len(robot_serial.encode())
    for length in LENGTHS:
        if HEAD.size + text_bytes + TAIL.size <= length:
            return length
    max_bytes = LENGTHS[-1] - HEAD.size - TAIL.size
    raise SettingError(
        f"Case and serial have {text_bytes} bytes. Give at most {max_bytes}.",
        code="seal-texts-too-long", numbers={"bytes": text_bytes, "max_bytes": max_bytes},
    )  # fmt: skip


def with_end_of_file(payload: bytes, length: int) -> bytes:
    """An HDF5 file that states `length` as its end, in its superblock of version 2."""
    head = payload[:28] + struct.pack("<Q", length) + payload[36:44]
    return head + struct.pack("<I", lookup3(head)) + payload[48:]


def sealed_file(payload: bytes, key: Any = None, **signed_for: Any) -> list[bytes]:
    """The parts of a bundle's file: the payload, and its seal, which a private key signs."""
    length = seal_length(signed_for.get("case", ""), signed_for.get("robot_serial", ""))
    payload = with_end_of_file(payload, len(payload) + length)
    return [payload, seal_of(payload, key, **signed_for)]


def seal_of(
    payload: bytes, key: Any = None, *, case: str = "", robot_serial: str = "",
    signed_at: int = 0, despite_findings: bool = False, domain: bytes = DOMAIN,
) -> bytes:  # fmt: skip
    """The seal as it stands behind the payload; raises as `seal_length` does.

    signed_at: when it was signed, or the earlier time from which its age counts [s since 1970]
    despite_findings: whether findings were open, or nobody had reviewed the plan
    domain: what is signed in front of the seal, which without its signature and tail follows
    """
    texts = case.encode(), robot_serial.encode()
    length = seal_length(case, robot_serial)
    flags, key_id = 0, bytes(16)
    if key is not None:
        flags = SIGNED | DESPITE_FINDINGS * despite_findings
        key_id = key_id_of(key.public_key())
    head = HEAD.pack(
        MAGIC, SEAL_VERSION, flags, length, len(payload), hashlib.sha256(payload).digest(),
        key_id, bytes(64), signed_at, *map(len, texts),
    )  # fmt: skip
    body = (head + b"".join(texts)).ljust(length - TAIL.size, b"\0")
    if key is not None:
        before, after = body[: SIGNATURE.start], body[SIGNATURE.stop :]
        body = before + key.sign(domain + before + after) + after
    return body + TAIL.pack(hashlib.sha256(body).digest(), length, 0, TAIL_MAGIC)


@contextmanager
def opened_source(source: FilePath | bytes) -> Iterator[BinaryIO]:
    """A binary stream over a path or over bytes; errors raised within name the path."""
    if isinstance(source, bytes):
        yield io.BytesIO(source)
        return
    with opened_file(Path(source)) as stream, naming_bundle(Path(source)):
        yield stream


@contextmanager
def naming_bundle(path: Path) -> Iterator[None]:
    """Name the file in front of the place in it, in errors that are raised inside."""
    try:
        yield
    except BundleError as error:
        error.where = f"{path}:{error.where}" if error.where else str(path)
        raise


def is_bundle(path: Path) -> bool:
    """Whether a file is a bundle, by its name or its first bytes."""
    if path.suffix.lower() in (".h5", ".hdf5"):
        return True
    if not path.is_file():
        return False
    with opened_file(path) as stream:
        return stream.read(len(HDF5_MAGIC)) == HDF5_MAGIC


def unsealed(stream: BinaryIO) -> Sealed:
    """The bytes of a bundle whose seal holds; its payload is not looked at.

    Raises `BundleError`.
    """
    data = stream.read(len(HDF5_MAGIC))
    # Of any other file the first bytes are enough for the reader to say what it is.
    if data == HDF5_MAGIC:
        stream.seek(0)
        data = stream.read(document()["limits"]["payload_bytes"] + LENGTHS[-1] + 1)
    return Sealed(data)


# --- Trust --------------------------------------------------------------------------------------

# How far a time of signing may lie in the future, because two clocks differ [s].
CLOCK_SKEW = 60


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
                f"The trusted keys are {self.keys!r}. Give what `vfplan.read_keys(PATH)` returns."
            )
        if self.max_age is not None and not 0 <= self.max_age < math.inf:
            raise SettingError(f"The maximum age is {self.max_age} s. Give a finite number from 0.")


def check_trust(seal: Sealed, trust: Trust) -> None:
    """Refuse a seal that no trusted key signed for this case, this robot and this day.

    What must be signed are the bytes of the file, as they are.

    Raises `SignatureError`.
    """
    if not seal.signed:
        raise SignatureError("is not signed. Sign it with vfplan sign.")
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
    for what, demanded, given, option, otherwise in (
        ("case", trust.case, seal.case, "--case", "demand its own case"),
        ("robot", trust.robot_serial, seal.robot_serial, "--robot-serial",
         "load it on its own robot"),
    ):  # fmt: skip
        if demanded is not None and not given:
            raise SignatureError(
                f"is signed for no particular {what}. Sign it for {demanded!r}: vfplan sign "
                f"{option}."
            )
        if demanded not in (None, given):
            raise SignatureError(
                f"is signed for {what} {given!r}. Sign it for {demanded!r}, or {otherwise}."
            )
    if trust.max_age is None:
        return
    if not seal.signed_at:
        raise SignatureError("does not state when it was signed. Sign it once more with its time.")
    age = time.time() - seal.signed_at
    if age > trust.max_age:
        raise SignatureError(
            f"was signed {age:.0f} s ago, and at most {trust.max_age:.0f} s are allowed. Review "
            "the plan and sign it once more."
        )
    if age < -CLOCK_SKEW:
        raise SignatureError(
            f"was signed {-age:.0f} s in the future. Set the clocks of planner and robot."
        )


# --- Keys ---------------------------------------------------------------------------------------

BEGIN = b"-----BEGIN PUBLIC KEY-----"
PUBLIC_KEY = re.compile(
    rb"^-----BEGIN PUBLIC KEY-----\n(?:(?!-----).*\n)*-----END PUBLIC KEY-----$", re.M
)
COPY_KEY = "Copy the file that vfplan keygen wrote with .pub"
MAKE_KEY = "Make a pair of keys: vfplan keygen"


def key_id_of(public: Any) -> bytes:
    """The first 16 bytes of SHA-256 of the raw public key."""
    return hashlib.sha256(public.public_bytes_raw()).digest()[:16]


def keygen(private_path: FilePath, *, overwrite: bool = False) -> tuple[Path, str]:
    """Make a key pair: PEM files NAME (PKCS 8, for its owner only) and NAME with suffix `.pub`.

    Both are written or none. Returns the public key's path and its key id in hex.

    Raises
    ------
    OutputError
        One of the two exists and `overwrite` is false, or cannot be written.
    """
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ed25519

    private_path = Path(private_path)
    public_path = private_path.with_suffix(".pub")
    if public_path == private_path:
        raise SettingError(
            "The private key's name may not end in .pub. Give another name.",
            where=private_path,
        )
    if public_path.exists() and not private_path.exists() and not overwrite:
        raise OutputError(
            f"exists already, and may be the public half of a private key other than "
            f"{private_path.name}. Give the new key another name",
            where=public_path, code="public-key-exists",
        )  # fmt: skip
    key = ed25519.Ed25519PrivateKey.generate()
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    public = key.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    pair = [(public_path, public, 0o666), (private_path, private, 0o600)]
    write_together(pair, overwrite=overwrite)
    return public_path, key_id_of(key.public_key()).hex()


def read_keys(path: FilePath) -> dict[bytes, Any]:
    """The public keys of a file of PEM keys, one after the other, by key id.

    Between them there may be empty lines and comments, lines that begin with `#`.

    Raises `InputError` when there is no such file, or it holds anything but Ed25519 public keys.
    """
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    text = b"\n".join(line.strip(b" \t\r") for line in read_pem(path, COPY_KEY)[0].split(b"\n"))
    # What is left in place of a key keeps the lines' numbers.
    left = PUBLIC_KEY.sub(lambda block: b"\n" * block[0].count(b"\n"), text).split(b"\n")
    for number, line in enumerate(left, start=1):
        if line == BEGIN:
            raise InputError(f"It ends within a public key. {COPY_KEY}.", where=path)
        if line.startswith(b"-----BEGIN") and line.endswith(b"PRIVATE KEY-----"):
            wanted = f"its public half, {Path(path).with_suffix('.pub').name}"
            if Path(path).suffix == ".pub":
                wanted = "a file of public keys alone"
            raise InputError(
                f"Line {number} begins a private key, which no robot needs. Give {wanted}.",
                where=path, code="private-key",
            )  # fmt: skip
        if line and not line.startswith(b"#"):
            raise InputError(
                f"Line {number} belongs to no public key in PEM form. Remove it, or begin it with "
                "#.", where=path,
            )  # fmt: skip
    keys = [
        ed25519_key(lambda block: load_pem_public_key(block + b"\n"), block, COPY_KEY, path)
        for block in PUBLIC_KEY.findall(text)
    ]
    if not keys:
        raise InputError(f"It holds no public key in PEM form. {COPY_KEY}.", where=path)
    return {key_id_of(key): key for key in keys}


def ed25519_key(load: Callable[[bytes], Any], data: bytes, advice: str, path: FilePath) -> Any:
    """The Ed25519 key that the library loads; `advice` where it loads none."""
    try:
        key = load(data)
    # The library raises many kinds of errors for a damaged key.
    except Exception as error:
        raise InputError(f"It holds a key that cannot be read. {advice}.", where=path) from error
    if not type(key).__name__.startswith("Ed25519"):
        raise InputError(f"It holds a key that is not Ed25519. {MAKE_KEY}.", where=path)
    return key


def read_private(path: FilePath) -> Any:
    """The private key of a PEM file that belongs to the caller, who alone can read it.

    Raises `InputError` when there is no such file, it holds no Ed25519 key, it belongs to somebody
    else, or its mode lets others read or write it.
    """
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    data, status = read_pem(path, f"{MAKE_KEY} -o {shlex.quote(str(path))}")
    if BEGIN in data:
        raise InputError(
            "It is a public key, which signs nothing. Give the private one, whose file keygen "
            "named without .pub.",
            where=path, code="public-key",
        )  # fmt: skip
    mode = stat.S_IMODE(status.st_mode)
    if hasattr(os, "geteuid") and status.st_uid != os.geteuid():
        raise InputError(
            f"This private key belongs to another user (id {status.st_uid}), who can sign with it "
            "too. Give a key of your own.",
            where=path,
        )
    if mode & 0o077:
        raise InputError(
            f"Others can read or write this private key: its mode is {mode:04o}. Give it mode 0600 "
            "(chmod 600), or make a new key if somebody may have copied it.",
            where=path,
        )
    return ed25519_key(lambda block: load_pem_private_key(block, None), data, MAKE_KEY, path)


def read_pem(path: FilePath, advice: str) -> tuple[bytes, os.stat_result]:
    """The bytes of a file of keys, and its owner and mode; `advice` for one that is not there."""
    try:
        opened = opened_file(Path(path))
    except InputError as error:
        error.message = f"{error.message}. {advice}"
        raise
    with opened as file:
        # What is longer than any file of keys ends within a line, which is refused.
        return file.read(MAX_SETTINGS_BYTES), os.fstat(file.fileno())


# --- Signing ------------------------------------------------------------------------------------


def sign(
    source: FilePath,
    target: FilePath,
    key_path: FilePath,
    *,
    case: str = "",
    robot_serial: str = "",
    registered_utc: str | None = None,
    despite_findings: bool = False,
    overwrite: bool = False,
) -> Report:
    """Sign a bundle: write it again, its content unchanged, with a signed seal, described here.

    `case`, `robot_serial` and the time of signing are covered by the signature. A bundle that is
    for a case is signed for that one. An earlier signature is replaced; what that was for stays,
    unless another case or robot is named. With `registered_utc` (ISO 8601, UTC), when the patient
    was registered, that time stands in place of the present one: the bundle's age counts from it.

    A bundle is signed when a person has reviewed it and answered all doubts. With
    `despite_findings` it is signed all the same; the seal says so, and whoever reads it sees it.

    Raises
    ------
    CheckFailed
        A doubt is not answered, or nobody reviewed the bundle, and `despite_findings` is false; or
        the bundle is for another case.
    BundleError
        The bundle is not sound.
    InputError
        There is no such key, or others than its owner can read it.
    SettingError
        The time is none, or a text does not fit into the seal.
    OutputError
        The target exists and `overwrite` is false.
    """
    signed_at = seconds_since_1970(now_utc() if registered_utc is None else registered_utc)
    if registered_utc is not None and signed_at > time.time() + CLOCK_SKEW:
        raise SettingError(
            f"{registered_utc!r} lies in the future. Give the time at which the patient was "
            "registered.",
            code="registered-later",
        )
    check_texts(case, robot_serial)
    key = read_private(key_path)
    with opened_source(source) as stream:
        sealed = unsealed(stream)
        fixture = from_content(sealed.read()[0])
    if fixture.case is not None and case not in ("", fixture.case):
        raise CheckFailed(
            f"The bundle is for case {fixture.case!r}, not for {case!r}. Leave --case out to sign "
            "it for its own case, or plan the other one.",
            where=source, code="case-other",
        )  # fmt: skip
    # An earlier signature goes on for the same case and robot.
    case = case or fixture.case or sealed.case
    robot_serial = robot_serial or sealed.robot_serial
    if not despite_findings:
        check_is_approved(fixture, str(source))
    parts = sealed_file(
        sealed.payload, key, case=case, robot_serial=robot_serial, signed_at=signed_at,
        despite_findings=bool(fixture.open_findings) or fixture.reviewed is None,
    )  # fmt: skip
    write_whole(Path(target), parts, overwrite=overwrite)
    return describe(Sealed(b"".join(parts)))


def check_texts(case: str, robot_serial: str = "") -> None:
    """Refuse texts that no seal can hold; raises `SettingError`."""
    for what, text in (("case token", case), ("robot serial", robot_serial)):
        if not text.isprintable():
            raise SettingError(
                f"The {what} {text!r} holds control characters. Type it without them."
            )
    seal_length(case, robot_serial)


def check_is_approved(fixture: Fixture, where: str) -> None:
    """Refuse a fixture with open doubts, or one that nobody has reviewed."""
    source = Path(where)
    slice_words = () if fixture.image is None else ("--slice", source.parent)
    approved = source.with_name(f"{source.stem}-approved.h5")
    page = command_of("review", source, *slice_words, "-o", approved)
    codes = [finding.code for finding in fixture.open_findings]
    if codes:
        subject = "1 finding is" if len(codes) == 1 else f"{len(codes)} findings are"
        raise CheckFailed(
            f"{subject} not answered: {', '.join(sorted(set(codes)))}. "
            f"Sign it all the same with --despite-findings, or answer first: {page}",
            where=where,
            code="findings-unanswered",
            numbers={"unanswered": len(codes), "codes": codes},
        )
    if fixture.reviewed is None:
        raise CheckFailed(
            "Nobody has reviewed it. Sign it all the same with --despite-findings, or review it: "
            f"{page}", where=where, code="not-reviewed",
        )  # fmt: skip


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
