"""The format of a bundle: the table of everything it may hold, and the seal before its payload.

The table is read from `schemas/bundle-1.1.json`; writer and describer ask it, and nothing about
paths, types, shapes or units is written down a second time in Python. The seal is the HDF5 user
block that says what the payload's bytes are, and who vouches for them; it is written here, read and
checked by the reader (vfplan/bundle/seal.hpp).

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

import functools
import hashlib
import json
import struct
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import resources
from typing import Any, Literal

from vfplan._core import Sealed
from vfplan.errors import SettingError

MAGIC = b"VFPLSEAL"
SEAL_VERSION = 1
SIGNED = 1
BLOCKS = (512, 1024, 2048, 4096)
HEAD = struct.Struct("<8sHHIQ32s16s64sQHH")
DIGEST = 32
SIGNATURE = slice(72, 136)
DOMAIN = b"vfplan bundle seal 1\0"  # what is signed can be taken for nothing else
LATEST = 253_402_300_799  # 9999-12-31T23:59:59Z

Kind = Literal["group", "dataset", "attribute"]
UNITS_OF_FRAME = {"image": "px", "robot_base": "m", "patient_lps": "m"}


@dataclass(frozen=True)
class Row:
    """One thing a bundle may hold.

    Parameters
    ----------
    path
        "/group/name", or "/group@name" for an attribute.
    kind, type, shape
        What it is; `shape` mixes numbers and the size symbols of the table.
    unit, frame
        As written in the file's own `unit` and `frame` attributes; "@frame" and "@source_frame"
        stand for the frame that attribute names (for a unit: px in "image", else m).
    required
        "always", "group" (whenever its group is there), "rendering" (whenever `/rendering` is
        there) or "optional".
    """

    path: str
    kind: Kind
    required: str
    since: str
    meaning: str
    type: str = ""
    shape: tuple[int | str, ...] = ()
    unit: str | None = None
    frame: str | None = None
    allowed: tuple[str, ...] | None = None
    min: float | None = None
    max: float | None = None
    above: float | None = None
    max_abs: dict[str, float] | None = None

    @property
    def parent(self) -> str:
        """The group that holds it."""
        holder, _, _ = self.path.partition("@")
        if self.kind == "attribute":
            return holder
        return holder.rpartition("/")[0] or "/"

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self.path.rpartition("@" if self.kind == "attribute" else "/")[2]


@functools.cache
def document() -> dict[str, Any]:
    """The whole of `bundle-1.1.json`."""
    text = resources.files("vfplan.schemas").joinpath("bundle-1.1.json").read_text("utf-8")
    return json.loads(text)


@functools.cache
def table() -> tuple[Row, ...]:
    """Everything a bundle may hold, in the order of the format."""
    lists = ("shape", "allowed")
    return tuple(
        Row(**{name: tuple(v) if name in lists else v for name, v in entry.items()})
        for entry in document()["rows"]
    )


def most(symbol: str) -> int:
    """The largest size that a symbol of the shapes stands for."""
    return document()["sizes"][symbol]["max"]


def most_bytes() -> int:
    """Of a payload."""
    return document()["limits"]["payload_bytes"]


@dataclass(frozen=True)
class Seal:
    """What a bundle's user block says; every field but the last five is about the payload."""

    # Of the HDF5 file that follows the block
    payload_length: int
    sha256: bytes
    # First 16 bytes of SHA-256 of the raw public key; `None` when unsigned
    key_id: bytes | None = None
    signature: bytes | None = None  # 64 bytes; `None` when unsigned
    # The case and the robot this bundle was approved for; "" when not given
    case: str = ""
    robot_serial: str = ""
    # When the patient was registered [s since 1970 UTC]; `None` when not given
    registered: int | None = None

    @classmethod
    def of(cls, sealed: Sealed) -> Seal:
        """The seal of a bundle's bytes, as the reader found it."""
        signed: dict[str, Any] = {}
        if sealed.signed:
            names = ("key_id", "signature", "case", "robot_serial")
            signed = {name: getattr(sealed, name) for name in names}
            signed["registered"] = sealed.registered or None
        return cls(sealed.payload_length, sealed.sha256, **signed)

    @property
    def signed(self) -> bool:
        """Whether there is a signature; says nothing about its worth."""
        return self.key_id is not None

    def describe(self) -> dict[str, object]:
        """The seal as `vfplan info --json` shows it: what is not there is absent."""
        key_id = self.key_id.hex() if self.key_id else None
        data: dict[str, object] = {"ok": True, "signed": self.signed, "key_id": key_id}
        data["sha256"] = self.sha256.hex()
        data |= {n: v for n in ("case", "robot_serial") if (v := getattr(self, n))}
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
