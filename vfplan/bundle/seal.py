"""The seal: the HDF5 user block that says what the payload's bytes are, and who vouches for them.

Layout, little-endian, in front of the payload (see docs/format.md):

    0  8  magic "VFPLSEAL"              136  8  registered [s since 1970-01-01T00:00Z], 0: not given
    8  2  seal version, 1               144  2  length of the case token
    10 2  flags, bit 0: signed          146  2  length of the robot's serial
    12 4  block length                  148     case token, serial (UTF-8), zeros
    16 8  payload length                -32 32  SHA-256 of the block up to here
    24 32 SHA-256 of the payload
    56 16 key id
    72 64 Ed25519 signature
"""

from __future__ import annotations

import hashlib
import re
import struct
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import BinaryIO

from vfplan.errors import CorruptError, SettingError, UnsafeError, VersionError

MAGIC = b"VFPLSEAL"
SEAL_VERSION = 1
SIGNED = 1
BLOCKS = (512, 1024, 2048, 4096)
HEAD = struct.Struct("<8sHHIQ32s16s64sQHH")
DIGEST = 32
SIGNATURE = slice(72, 136)
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")
DOMAIN = b"vfplan bundle seal 1\0"  # what is signed can be taken for nothing else
HDF5 = b"\x89HDF\r\n\x1a\n"
HINT = (
    "has no seal; this program reads versions 1.x, which have one, and a bundle of version 0.1 is"
    " brought up to date by `vfplan migrate OLD.h5 -o NEW.h5`"
)


@dataclass(frozen=True)
class Seal:
    """What a bundle's user block says; every field but the last five is about the payload.

    Parameters
    ----------
    payload_length, sha256
        Of the HDF5 file that follows the block.
    key_id
        First 16 bytes of SHA-256 of the raw public key; `None` when unsigned.
    signature
        64 bytes; `None` when unsigned.
    case, robot_serial
        The case and the robot this bundle was approved for; "" when not given.
    registered
        When the patient was registered [s since 1970 UTC]; `None` when not given.
    """

    payload_length: int
    sha256: bytes
    key_id: bytes | None = None
    signature: bytes | None = None
    case: str = ""
    robot_serial: str = ""
    registered: int | None = None

    @property
    def signed(self) -> bool:
        """Whether there is a signature; says nothing about its worth."""
        return self.key_id is not None

    def describe(self) -> dict[str, object]:
        """The seal as `vfplan info --json` shows it: what is not there is absent."""
        key_id = self.key_id.hex() if self.key_id else None
        data: dict[str, object] = {"ok": True, "signed": self.signed, "key_id": key_id}
        data["sha256"] = self.sha256.hex()
        if self.case:
            data["case"] = self.case
        if self.robot_serial:
            data["robot_serial"] = self.robot_serial
        if self.registered is not None:
            moment = datetime.fromtimestamp(self.registered, UTC)
            data["registered_utc"] = moment.strftime("%Y-%m-%dT%H:%M:%SZ")
        return data


def seal_of(payload: bytes) -> Seal:
    """The seal of an unsigned payload."""
    return Seal(len(payload), hashlib.sha256(payload).digest())


def to_block(seal: Seal) -> bytes:
    """The user block: 512 bytes, or the next power of two that fits.

    Raises `SettingError` when case token and serial together do not fit into 4096 bytes.
    """
    case, serial = seal.case.encode(), seal.robot_serial.encode()
    needed = HEAD.size + len(case) + len(serial) + DIGEST
    length = next((block for block in BLOCKS if block >= needed), None)
    if length is None:
        room = BLOCKS[-1] - HEAD.size - DIGEST
        raise SettingError(
            f"case and serial have {len(case + serial)} bytes; at most {room} allowed"
        )
    head = HEAD.pack(
        MAGIC,
        SEAL_VERSION,
        SIGNED if seal.signed else 0,
        length,
        seal.payload_length,
        seal.sha256,
        seal.key_id or bytes(16),
        seal.signature or bytes(64),
        seal.registered or 0,
        len(case),
        len(serial),
    )
    body = (head + case + serial).ljust(length - DIGEST, b"\0")
    return body + hashlib.sha256(body).digest()


def signed_message(seal: Seal) -> bytes:
    """The bytes a signature covers: the whole block but for the signature and the block's hash."""
    block = to_block(seal)
    return DOMAIN + block[: SIGNATURE.start] + block[SIGNATURE.stop : -DIGEST]


def unseal(stream: BinaryIO, cap: int) -> tuple[Seal, bytes]:
    """Seal and payload of a bundle, checked against each other; nothing is parsed.

    Raises
    ------
    CorruptError
        The bytes are not those that were sealed.
    VersionError
        There is no seal, or one of another version.
    UnsafeError
        The payload is longer than `cap`.
    """
    start = stream.read(BLOCKS[0])
    if start[:8] == HDF5:
        raise VersionError(HINT)
    if start[:8] != MAGIC:
        raise CorruptError(f"is no fixture bundle: it begins with {start[:8]!r}, not {MAGIC!r}")
    if len(start) < BLOCKS[0]:
        raise CorruptError(f"ends after {len(start)} bytes, within its seal")
    version, length = struct.unpack_from("<H2xI", start, 8)
    if version != SEAL_VERSION:
        raise VersionError(
            f"seal version {version}; this program reads {SEAL_VERSION}: a newer vfplan wrote it,"
            " `pip install --upgrade vfplan` gets it"
        )
    if length not in BLOCKS:
        raise CorruptError(f"seal of {length} bytes; one of {BLOCKS} wanted")
    block = start + stream.read(length - BLOCKS[0])
    seal = _parsed(block)
    if seal.payload_length > cap:
        raise UnsafeError(f"payload of {seal.payload_length} bytes; at most {cap} allowed")
    payload = stream.read(seal.payload_length + 1)
    if len(payload) != seal.payload_length:
        more = "more are" if len(payload) > seal.payload_length else f"{len(payload)} are"
        raise CorruptError(f"{seal.payload_length} bytes were sealed, {more} there")
    if hashlib.sha256(payload).digest() != seal.sha256:
        raise CorruptError("SHA-256 differs from the sealed one: the bytes are not those written")
    return seal, payload


def _parsed(block: bytes) -> Seal:
    if hashlib.sha256(block[:-DIGEST]).digest() != block[-DIGEST:]:
        raise CorruptError("the seal itself is damaged: its SHA-256 differs")
    _, _, flags, _, length, digest, key_id, signature, registered, n_case, n_serial = (
        HEAD.unpack_from(block)
    )
    end = HEAD.size + n_case + n_serial
    if end > len(block) - DIGEST:
        raise CorruptError("the seal's texts do not fit into it")
    if flags & ~SIGNED or any(block[end:-DIGEST]):
        raise CorruptError("the seal holds something unknown")
    texts = block[HEAD.size : HEAD.size + n_case], block[HEAD.size + n_case : end]
    if not flags & SIGNED:
        if any(key_id) or any(signature) or registered or n_case or n_serial:
            raise CorruptError("the seal is unsigned and yet holds what only a signature covers")
        return Seal(length, digest)
    try:
        case, serial = (text.decode("utf-8") for text in texts)
    except UnicodeDecodeError:
        raise CorruptError("the seal's texts are not UTF-8") from None
    if CONTROL.search(case + serial):
        raise CorruptError("the seal's texts hold control characters")
    if registered > LATEST:
        raise CorruptError(f"registered {registered} s after 1970; at most {LATEST} allowed")
    return Seal(length, digest, key_id, signature, case, serial, registered or None)


LATEST = 253_402_300_799  # 9999-12-31T23:59:59Z
