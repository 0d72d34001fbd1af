"""Regular files opened to be read, once: what takes their name meanwhile is another file."""

from __future__ import annotations

import hashlib
import io
import os
import stat
from pathlib import Path
from typing import BinaryIO, cast

from vfplan.errors import InputError


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
