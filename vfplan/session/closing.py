"""What writers of ticks share: their file appears whole, when the `with` block ends well."""

from __future__ import annotations

import errno
import os
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO, Self

from vfplan.io.files import whole_file


def require_same(found: object, written: object) -> None:
    """Raise `OSError` where a file reads back otherwise than it was written."""
    if found != written:
        raise OSError(errno.EIO, "it reads back otherwise than it was written")


class Whole:
    """A writer whose file gets its name when the `with` statement ends well, and else is no more.

    Subclasses fill `file`; `_close` lets go of what else is open, and `_verify` reads it back.
    Raises `OutputError` when the file exists already, or cannot be written.
    """

    def __init__(self, path: str | Path) -> None:
        with ExitStack() as held:
            file = held.enter_context(whole_file(Path(path), overwrite=False))
            self._begin(file)
            held.push(self._end)
            self._held = held.pop_all()

    def _begin(self, file: BinaryIO) -> None:
        raise NotImplementedError

    def _close(self) -> None:
        """Nothing else is open."""

    def _verify(self) -> None:
        raise NotImplementedError

    def _end(self, failure: type | None, *_: object) -> None:
        self._close()
        if failure is None:
            self._verify()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failure: Any) -> bool | None:
        return self._held.__exit__(*failure)


class Steady:
    """A file for libhdf5, which crashes where a write fails while it closes: failures are kept.

    From the first failed write on, what is written is held in memory, so that libhdf5 can come to
    its end; `check` raises what happened.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._descriptor = file.fileno()
        self._at = self._size = 0
        self._failure: OSError | None = None
        self._lost: list[tuple[int, bytes]] = []

    def check(self) -> None:
        """Raise the `OSError` of the first write that failed."""
        if self._failure is not None:
            raise self._failure

    def write(self, data: memoryview) -> int:
        """As of any file."""
        rest, at = memoryview(data).cast("B"), self._at
        try:
            while len(rest) and self._failure is None:
                done = os.pwrite(self._descriptor, rest, at)
                rest, at = rest[done:], at + done
        except OSError as error:
            self._failure = error
        if len(rest):
            self._lost.append((at, bytes(rest)))
        self._at += len(data)
        self._size = max(self._size, self._at)
        return len(data)

    def readinto(self, buffer: memoryview) -> int:
        """As of any file, with what could not be written."""
        view, first = memoryview(buffer).cast("B"), self._at
        os.preadv(self._descriptor, [view], first)
        for at, data in self._lost:
            low, high = max(at, first), min(at + len(data), first + len(view))
            if low < high:
                view[low - first : high - first] = data[low - at : high - at]
        self._at += len(view)
        return len(view)

    def read(self, size: int) -> bytes:
        """As of any file."""
        data = bytearray(size)
        self.readinto(memoryview(data))
        return bytes(data)

    def seek(self, at: int, whence: int = os.SEEK_SET) -> int:
        """As of any file."""
        self._at = at if whence == os.SEEK_SET else self._size + at
        return self._at

    def tell(self) -> int:
        """As of any file."""
        return self._at

    def truncate(self, size: int) -> int:
        """As of any file."""
        try:
            os.ftruncate(self._descriptor, size)
        except OSError as error:
            self._failure = self._failure or error
        self._size = size
        return size

    def flush(self) -> None:
        """Nothing is held back."""
