"""Write bundles: content -> bytes -> sealed -> disk, whole, and read back before they have a name.

The seal is the HDF5 user block that says what the payload's bytes are, and who vouches for them; it
is written here, read and checked by the reader (vfplan/bundle/seal.hpp).

Layout, little-endian, in front of the payload (docs/format.md):

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

import ctypes
import hashlib
import struct
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from vfplan._core import Sealed, read_payload
from vfplan.bundle import leak
from vfplan.bundle.content import Content, Row, table, to_content
from vfplan.errors import InputError, OutputError, SceneError, SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import write_whole
from vfplan.io.hdf5 import h5py

h5f, h5p = h5py.h5f, h5py.h5p
CHUNK_BYTES = 1 << 20
COMPACT_LINKS = 8  # of a group that libhdf5 keeps in its header unasked
FORMAT = "vfplan-fixture"
VERSION = "1.0"  # at least: a bundle is of the first version that has all it holds
UNITS_OF_FRAME = {"image": "px", "robot_base": "m", "patient_lps": "m"}

MAGIC = b"VFPLSEAL"
SEAL_VERSION = 1
SIGNED = 1
BLOCKS = (512, 1024, 2048, 4096)
HEAD = struct.Struct("<8sHHIQ32s16s64sQHH")
DIGEST = 32
SIGNATURE = slice(72, 136)
DOMAIN = b"vfplan bundle seal 1\0"  # what is signed can be taken for nothing else
LATEST = 253_402_300_799  # 9999-12-31T23:59:59Z


def write_fixture(fixture: Fixture, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a fixture as a sealed, unsigned bundle: whole or not at all.

    The leak certificate is computed here. The bytes are read back and checked before the file
    appears under its name.

    Raises
    ------
    OutputError
        The path exists and `overwrite` is false, or cannot be written.
    SceneError
        The fixture leaks between samples: its own proxy can pass through.
    InputError
        The fixture breaks another rule of the format.
    """
    write_content(completed(to_content(fixture)), Path(path), overwrite=overwrite)


def completed(content: Content) -> Content:
    """A content with what the format adds: head, object id and leak certificate."""
    since = max([VERSION, *(row.since for row in table() if row.path in content)])
    head = {"/@format": FORMAT, "/@version": since}
    if "/guidance@radius_m" in content:  # an older reader would forbid what shall guide
        head["/@must_understand"] = "/guidance"
    content = head | {p: v for p, v in content.items() if p not in head and "/leak" not in p}
    _check_texts(content)
    # The id of the geometry: equal for equal points in the same frame.
    digest = hashlib.sha256(content["/@frame"].encode() + b"\0")
    digest.update(np.ascontiguousarray(content["/points"], dtype="<f8").data)
    content["/@id"] = digest.hexdigest()[:32]
    if "/rendering@contact_radius_m" in content:
        # Of arrays that do not fit together there is none: the reader says what is wrong.
        with suppress(IndexError, ValueError), np.errstate(invalid="ignore", over="ignore"):
            content |= leak.certificate(content)
    return content


def _check_texts(content: Content) -> None:
    """Refuse a text that ends in NUL, which would be read back without it."""
    for path, value in content.items():
        for text in value if isinstance(value, tuple) else (value,):
            if isinstance(text, str) and text.endswith("\0"):
                raise InputError(f"{text!r} ends in a control character", where=path)


def write_content(content: Content, path: Path, *, overwrite: bool) -> None:
    """Seal a content and write it, after reading it back."""
    payload = to_payload(content)
    found = read_payload(payload, strict=False)[1]
    errors = [(where, code, message) for where, code, kind, message in found if kind == "error"]
    if errors:  # the certificate is missing where something else is wrong
        where, code, message = min(errors, key=lambda error: error[0].startswith("/leak"))
        if code == "unsafe.leak":
            raise SceneError(message)
        raise InputError(f"no bundle can hold this: {message}", where=where)
    write_whole(path, [to_block(seal_of(payload)), payload], overwrite=overwrite)


def to_payload(content: Content) -> bytes:
    """The bytes of an HDF5 file with this content: the same content gives the same bytes.

    Readable by libhdf5 1.10 and later (`libver` v110). No time stamps, no variable-length data;
    datasets in chunks guarded by fletcher32, everything else guarded by libhdf5's own checksums.
    """
    fapl = h5p.create(h5p.FILE_ACCESS)
    fapl.set_libver_bounds(h5f.LIBVER_V110, h5f.LIBVER_V110)
    fapl.set_fapl_core(1 << 16, False)
    fcpl = h5p.create(h5p.FILE_CREATE)
    fcpl.set_obj_track_times(False)
    used = {r.parent for r in table() if r.path in content}
    inside = {r.path for r in table() if r.kind != "attribute" and r.parent == "/"} - {"/"}
    links = inside & (used | content.keys())
    if len(links) > COMPACT_LINKS:
        _keep_compact(fcpl, len(links))
    with h5py.File(h5f.create(b"bundle", h5f.ACC_TRUNC, fcpl=fcpl, fapl=fapl)) as file:
        for row in table():
            if row.kind == "group" and row.path != "/" and row.path in used:
                file.create_group(row.path)
            elif row.path in content:
                _put(file[row.parent], row, content)
        file.flush()
        return file.id.get_file_image()


def _keep_compact(plist: Any, links: int) -> None:
    """So many links of a group stay in its header; h5py has no name for this call of libhdf5."""
    call = ctypes.CDLL(h5p.__file__).H5Pset_link_phase_change
    call.argtypes, call.restype = [ctypes.c_int64, ctypes.c_uint, ctypes.c_uint], ctypes.c_int
    if call(plist.id, links, COMPACT_LINKS) < 0:
        raise OutputError(f"libhdf5 keeps no {links} links in a group's header")


def _put(group: Any, row: Row, content: Content) -> None:
    data = _coded(content[row.path], row.type)
    if row.kind == "attribute":
        group.attrs.create(row.name, data)
        return
    if not data.size:
        raise InputError(f"has shape {data.shape}; nothing in it", where=row.path)
    chunks = chunk_shape(data.shape, data.dtype.itemsize)
    dataset = group.create_dataset(
        row.name, data=data, chunks=chunks, fletcher32=True, fill_time="never"
    )
    for name, text in _beside(row, content).items():
        dataset.attrs.create(name, _coded(text, "text"))


def chunk_shape(shape: tuple[int, ...], itemsize: int) -> tuple[int, ...]:
    """Whole rows, as many as fit into 1 MiB."""
    row_bytes = itemsize * int(np.prod(shape[1:], dtype=np.int64))
    return (max(1, min(shape[0], CHUNK_BYTES // row_bytes)), *shape[1:])


def _coded(value: Any, kind: str) -> np.ndarray:
    """A value as it is stored; texts in as many bytes as the longest takes, without an end."""
    if kind != "text":
        return np.asarray(value, dtype=f"<{kind}", order="C")
    bare = np.char.encode(np.array(value, dtype=str), "utf-8")
    return bare.astype(h5py.string_dtype("utf-8", max(1, bare.itemsize)))


def _beside(row: Row, content: Content) -> dict[str, str]:
    """Unit and frame to write beside a dataset, "@frame" and "@source_frame" filled in."""
    frame, unit = row.frame, row.unit
    for name, path in (("@frame", "/@frame"), ("@source_frame", "/registration@source_frame")):
        known = content.get(path)
        frame = known if frame == name else frame
        unit = unit and unit.replace(name, UNITS_OF_FRAME.get(known, "?"))
    return {name: text for name, text in (("unit", unit), ("frame", frame)) if text is not None}


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
