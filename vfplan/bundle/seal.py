"""The seal behind a bundle's HDF5 file: it says what the bytes are, and who vouches for them.

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

Seals are written here, and read and checked by the reader (vfplan/bundle/seal.hpp).
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import IntFlag

from vfplan._core import Sealed, lookup3
from vfplan.errors import SettingError

MAGIC = b"VFPLSEAL"
TAIL_MAGIC = b"VFPLTAIL"
HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
SEAL_VERSION = 2
LENGTHS = tuple(512 << doublings for doublings in range(4))
"""Lengths that a seal may have: 512, 1024, 2048 and 4096 bytes."""
HEAD = struct.Struct("<8sHHIQ32s16s64sQHH")
TAIL = struct.Struct("<32sII8s")
SIGNATURE = slice(72, 136)
DOMAIN = b"vfplan bundle seal 2\0"
"""In front of what is signed, so that a signature can be taken for no other one."""


class SealFlag(IntFlag):
    """The bits of a seal's flags."""

    SIGNED = 1
    DESPITE_FINDINGS = 2


@dataclass(frozen=True)
class Seal:
    """What a bundle's seal says.

    Parameters
    ----------
    payload_length, sha256
        Of the HDF5 file in front of the seal.
    key_id
        The first 16 bytes of SHA-256 of the raw public key; `None` when unsigned.
    signature
        64 bytes; `None` when unsigned.
    case, robot_serial
        What the bundle was approved for; "" when not given.
    signed_at
        When it was signed, or the earlier time from which its signer lets its age count, as when
        the patient was registered [s since 1970 UTC]; `None` when not given.
    despite_findings
        Whether it was signed although findings were open, or nobody had reviewed the plan.
    """

    payload_length: int
    sha256: bytes
    key_id: bytes | None = None
    signature: bytes | None = None
    case: str = ""
    robot_serial: str = ""
    signed_at: int | None = None
    despite_findings: bool = False

    @classmethod
    def of(cls, sealed: Sealed) -> Seal:
        """The seal of a bundle's bytes, as the reader found it."""
        if not sealed.signed:
            return cls(sealed.payload_length, sealed.sha256)
        return cls(
            sealed.payload_length,
            sealed.sha256,
            key_id=sealed.key_id,
            signature=sealed.signature,
            case=sealed.case,
            robot_serial=sealed.robot_serial,
            signed_at=sealed.signed_at or None,
            despite_findings=sealed.despite_findings,
        )

    @property
    def signed(self) -> bool:
        """Whether there is a signature; says nothing about its worth."""
        return self.key_id is not None

    def describe(self) -> dict[str, object]:
        """The seal as `vfplan info --json` shows it: what is not there is absent."""
        data: dict[str, object] = {"ok": True, "signed": self.signed, "key_id": None}
        if self.key_id is not None:
            data["key_id"] = self.key_id.hex()
        data["sha256"] = self.sha256.hex()
        if self.case:
            data["case"] = self.case
        if self.robot_serial:
            data["robot_serial"] = self.robot_serial
        if self.signed_at is not None:
            moment = datetime.fromtimestamp(self.signed_at, UTC)
            data["signed_utc"] = moment.strftime("%Y-%m-%dT%H:%M:%SZ")
        if self.despite_findings:
            data["despite_findings"] = True
        return data


def seal_length(case: str = "", robot_serial: str = "") -> int:
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
        code="seal-texts-too-long",
        numbers={"bytes": text_bytes, "max_bytes": max_bytes},
    )


def with_end_of_file(payload: bytes, length: int) -> bytes:
    """An HDF5 file that states `length` as its end, in its superblock of version 2."""
    head = payload[:28] + struct.pack("<Q", length) + payload[36:44]
    return head + struct.pack("<I", lookup3(head)) + payload[48:]


def unsigned(payload: bytes) -> list[bytes]:
    """The parts of a bundle's file: the payload, and the seal of one that nobody signed."""
    payload = with_end_of_file(payload, len(payload) + seal_length())
    return [payload, to_bytes(Seal(len(payload), hashlib.sha256(payload).digest()))]


def to_bytes(seal: Seal) -> bytes:
    """The seal as it stands behind the payload; raises as `seal_length` does."""
    length = seal_length(seal.case, seal.robot_serial)
    body = to_body(seal, length)
    return body + TAIL.pack(hashlib.sha256(body).digest(), length, 0, TAIL_MAGIC)


def signed_message(seal: Seal) -> bytes:
    """The bytes a signature covers: all of the seal but the signature and the tail."""
    body = to_body(seal, seal_length(seal.case, seal.robot_serial))
    return DOMAIN + body[: SIGNATURE.start] + body[SIGNATURE.stop :]


def to_body(seal: Seal, length: int) -> bytes:
    """The seal without its tail, filled up with zeros."""
    case = seal.case.encode()
    serial = seal.robot_serial.encode()
    flags = SealFlag(0)
    if seal.signed:
        flags |= SealFlag.SIGNED
    if seal.despite_findings:
        flags |= SealFlag.DESPITE_FINDINGS
    head = HEAD.pack(
        MAGIC,
        SEAL_VERSION,
        flags,
        length,
        seal.payload_length,
        seal.sha256,
        seal.key_id or bytes(16),
        seal.signature or bytes(64),
        seal.signed_at or 0,
        len(case),
        len(serial),
    )
    return (head + case + serial).ljust(length - TAIL.size, b"\0")
