"""What comes from outside: regular files, opened once, of a bounded size; numbers in text; time.

The size is bounded also once files are unpacked.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import re
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, cast

from vfplan.errors import InputError

MOST_FILE = MOST_UNPACKED = 1 << 30  # bytes

# Digits, a point, an exponent: not the 1_000, 0x10, 1d3, nan or digits of other scripts that one
# reader or another takes.
_REAL = re.compile(r"[ \t]*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)[ \t]*")


# More no program writes: bytes of a line, numbers in one, bytes of a file of text.
MOST_LINE, MOST_COLUMNS, MOST_TEXT = 1 << 16, 1000, 1 << 28


@contextmanager
def at(where: object | None) -> Iterator[None]:
    """Errors of input raised inside, if they name no place, name this one, if there is any."""
    try:
        yield
    except InputError as error:
        if where is not None:
            error.where = error.where or str(where)
        raise


def opened_file(path: Path, kind: type[InputError] = InputError) -> BinaryIO:
    """A regular file, open for reading.

    Raises an error of the `kind` given if there is none, it is a directory, a pipe or a device,
    or it cannot be read.
    """
    try:
        # Not to hang on a named pipe, which opens only when somebody writes to it.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise kind("cannot be read: there is no such file", where=str(path)) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise kind(f"cannot be read: {reason}", where=str(path)) from error
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        what = "a directory" if stat.S_ISDIR(mode) else "a device or a pipe"
        raise kind(f"cannot be read: it is {what}, not a file", where=str(path))
    return open(descriptor, "rb")


def read_whole(path: Path, most: int, kind: type[InputError] = InputError) -> bytes:
    """The bytes of a regular file of at most `most` bytes; raises as `opened_file` does."""
    with opened_file(path, kind) as file:
        size = os.fstat(file.fileno()).st_size
        data = b"" if size > most else file.read(most + 1)
    if max(size, len(data)) > most:
        raise kind(f"is longer than {most} bytes, the most read", where=str(path))
    return data


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


def read_bytes(path: Path, most: int = MOST_FILE) -> tuple[bytes, str]:
    """A file's bytes and their SHA-256; raises `InputError` as `read_whole` does."""
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


def real(text: str) -> float:
    """A decimal number, blanks around it allowed; raises `ValueError` for anything else.

    What is beyond the largest float64, 1.8e308, is no number either.
    """
    match = _REAL.fullmatch(text)
    if match is None:
        raise ValueError(f"{text[:40]!r} is no number" if text.strip() else "a number is missing")
    value = float(match[1])
    if math.isinf(value):
        raise ValueError(f"{text[:40]!r} is larger than a float64 holds, 1.8e308")
    return value


def now_utc() -> str:
    """Now, or what SOURCE_DATE_EPOCH says (reproducible-builds.org), as ISO 8601 in whole seconds.

    Raises `InputError` where SOURCE_DATE_EPOCH is no time.
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if epoch is None:
        moment = datetime.now(UTC)
    elif epoch.isascii() and epoch.isdigit() and len(epoch) < 12:
        moment = datetime.fromtimestamp(int(epoch), UTC)
    else:
        raise InputError(
            f"the environment's SOURCE_DATE_EPOCH is {epoch!r}; whole seconds since 1970 are wanted"
        )
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")
