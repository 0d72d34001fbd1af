"""Files that are read in pieces, opened once, and what is packed or long, of a bounded size."""

from __future__ import annotations

import hashlib
import io
import os
import zlib
from pathlib import Path
from typing import BinaryIO, cast

from vfplan.errors import InputError
from vfplan.io.files import opened_file

MOST_UNPACKED = 1 << 30  # bytes
# More no program writes: bytes of a line, numbers in one, bytes of a file of text.
MOST_LINE, MOST_COLUMNS, MOST_TEXT = 1 << 16, 1000, 1 << 28


class OneFile:
    """A regular file, opened once: whatever takes its name meanwhile, this one is read.

    path, kind: as for `opened_file`, which raises
    """

    def __init__(self, path: Path, kind: type[InputError] = InputError) -> None:
        with opened_file(path, kind) as file:
            self.descriptor = os.dup(file.fileno())
        self._kind, self._where = kind, str(path)
        self._stamp = self._seen()

    def __del__(self) -> None:
        if hasattr(self, "descriptor"):
            os.close(self.descriptor)

    def fileno(self) -> int:
        """The descriptor, as every file names it."""
        return self.descriptor

    def _seen(self) -> tuple[int, int]:
        status = os.fstat(self.descriptor)
        return status.st_size, status.st_mtime_ns

    def view(self) -> BinaryIO:
        """A stream over the whole file, with a place of its own in it."""
        return stream_over(self.descriptor, self)

    def sha256(self) -> str:
        """Of its bytes, hexadecimal."""
        return hashlib.file_digest(self.view(), "sha256").hexdigest()

    def require_unchanged(self) -> None:
        """Refuse what was written to since it was opened: its digest would be another one's."""
        if self._seen() != self._stamp:
            raise self._kind("was changed while it was read", where=self._where)


def stream_over(descriptor: int, owner: object = None) -> BinaryIO:
    """A stream with a place of its own in an open file; the `owner` of the descriptor lives on."""
    return cast("BinaryIO", io.BufferedReader(_View(descriptor, owner), 1 << 16))


class _View(io.RawIOBase):
    name = ""  # as a file that is open has one

    def __init__(self, descriptor: int, owner: object) -> None:
        self._descriptor, self._owner, self._at = descriptor, owner, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:
        count = os.preadv(self._descriptor, [buffer], self._at)
        self._at += count
        return count

    def seek(self, at: int, whence: int = os.SEEK_SET) -> int:
        size = os.fstat(self._descriptor).st_size
        self._at = at + (0, self._at, size)[whence]
        return self._at

    def tell(self) -> int:
        return self._at


def unpacked(data: bytes, kind: str, where: str, most: int = MOST_UNPACKED) -> bytes:
    """What "gzip" or "bzip2" bytes hold, never more than `most`.

    Raises `InputError` when they are damaged, cut short, or hold more.
    """
    try:
        if kind == "gzip":
            worker = zlib.decompressobj(wbits=zlib.MAX_WBITS | 32)
        else:
            import bz2

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


def require_short(data: bytes) -> None:
    """Raise `ValueError` for text that is long, or has a long line: tables take times its size."""
    if len(data) > MOST_TEXT:
        raise ValueError(f"{len(data)} bytes of text; at most {MOST_TEXT} are read")
    at = 0
    while len(data) - at > MOST_LINE:  # from each stretch of that length to its last line's end
        end = data.rfind(b"\n", at, at + MOST_LINE)
        if end < 0:
            raise ValueError(f"the line at byte {at} is longer than {MOST_LINE} bytes")
        at = end + 1
