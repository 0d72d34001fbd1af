"""Files from outside: whole, of a bounded size, also once they are unpacked."""

from __future__ import annotations

import bz2
import hashlib
import zlib
from contextlib import suppress
from pathlib import Path

from vfplan.errors import InputError
from vfplan.io.reading import read_whole

MOST_FILE = 1 << 30
MOST_UNPACKED = 1 << 30


def read_bytes(path: Path, most: int = MOST_FILE) -> tuple[bytes, str]:
    """A file's bytes and their SHA-256; raises `InputError` as `vfplan.io.disk.read_whole` does."""
    with suppress(OSError):  # what is not there, `read_whole` names
        most = min(most, path.stat().st_size + 1)  # a read takes room for all that it may get
    data = read_whole(path, most, InputError)
    return data, hashlib.sha256(data).hexdigest()


def unpacked(data: bytes, kind: str, where: str, most: int = MOST_UNPACKED) -> bytes:
    """What "gzip" or "bzip2" bytes hold, never more than `most`.

    Raises `InputError` when they are damaged, cut short, or hold more.
    """
    try:
        if kind == "gzip":
            worker = zlib.decompressobj(wbits=zlib.MAX_WBITS | 32)
            found = worker.decompress(data, most + 1)
        else:
            worker = bz2.BZ2Decompressor()
            found = worker.decompress(data, most + 1)
    except (zlib.error, OSError, ValueError):
        raise InputError(f"its {kind} data are damaged", where=where) from None
    if len(found) > most:
        raise InputError(f"unpacks to more than {most} bytes", where=where)
    if not worker.eof:
        raise InputError(f"its {kind} data are cut short", where=where)
    return found


def first_unpacked(data: bytes, count: int = 540) -> bytes:
    """The first bytes that gzip data hold; fewer where they are damaged."""
    try:
        return zlib.decompressobj(wbits=zlib.MAX_WBITS | 32).decompress(data, count)
    except zlib.error:
        return b""
