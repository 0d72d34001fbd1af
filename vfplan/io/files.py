"""Read files from outside: regular files of a bounded size, whole or through one open descriptor.

Also strict decimal numbers and lengths of time as text holds them, and the time that outputs are
stamped with.

Headers of `.npy` files, read with a limit on their length.

Values as JSON holds them.
"""

from __future__ import annotations

import inspect
import io
import math
import os
import re
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import IO, Any, BinaryIO, cast

import numpy as np

from vfplan.errors import InputError

MAX_FILE_BYTES = 1 << 30
"""Bytes of a file that is read whole, where the caller names no other limit."""

MAX_DECOMPRESSED_BYTES = MAX_FILE_BYTES
"""Bytes that packed data may unpack to."""

MAX_SETTINGS_BYTES = 1 << 20
"""Bytes of a file of settings, keys, a robot or an arm. A real one is a hundred times smaller."""

MAX_TEXT_BYTES = 1 << 28
"""Bytes of a file of text. Parsing text takes several times its size in memory."""

MAX_LINE_BYTES = 1 << 16
"""Bytes of a line of text. No program that exports tables writes a longer one."""

UNITS_OF_TIME = {"s": "seconds", "min": "minutes", "h": "hours", "d": "days"}
"""The units of a length of time, with their names in `timedelta`."""

# Digits, a point, an exponent. Python and NumPy would also take 1_000, nan and digits of other
# scripts, and other readers take 0x10 and 1d3.
_DECIMAL = re.compile(r"[ \t]*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)[ \t]*")


@contextmanager
def naming_place(where: object | None) -> Iterator[None]:
    """Add a place to input errors that are raised inside and name none; `None` adds nothing."""
    try:
        yield
    except InputError as error:
        if where is not None and not error.where:
            error.where = str(where)
        raise


def opened_file(path: Path, kind: type[InputError] = InputError) -> BinaryIO:
    """A regular file, open for reading.

    Raises an error of the `kind` given if there is none, it is a directory, a pipe or a device,
    or it cannot be read.
    """
    try:
        # O_NONBLOCK: opening a named pipe would otherwise wait until somebody writes to it.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise kind(
            "cannot be read: there is no such file. Check its name",
            where=str(path),
            code="file-missing",
        ) from None
    except (OSError, ValueError) as error:
        reason = str(error)
        if isinstance(error, OSError):
            reason = error.strerror
        raise kind(
            f"cannot be read: {reason}. Check the file and its permissions",
            where=str(path),
            code="file-unreadable",
        ) from error
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        what = "a directory" if stat.S_ISDIR(mode) else "a device or a pipe"
        raise kind(
            f"cannot be read: it is {what}, not a file. Name a file",
            where=str(path),
            code="not-a-file",
        )
    return open(descriptor, "rb")


def read_whole(path: Path, max_bytes: int, kind: type[InputError] = InputError) -> bytes:
    """The bytes of a regular file of at most `max_bytes` bytes.

    A file that is longer is refused before it is read. Raises as `opened_file` does.
    """
    with opened_file(path, kind) as file:
        size = os.fstat(file.fileno()).st_size
        data = b""
        if size <= max_bytes:
            # One byte more, because the file may grow while it is read.
            data = file.read(min(size, max_bytes) + 1)
    if max(size, len(data)) > max_bytes:
        raise kind(
            f"is longer than {max_bytes} bytes, the most that is read. Give a shorter file",
            where=str(path),
            code="file-too-long",
            numbers={"bytes": max(size, len(data)), "max_bytes": max_bytes},
        )
    return data


def read_bytes(
    path: Path, max_bytes: int = MAX_FILE_BYTES, kind: type[InputError] = InputError
) -> tuple[bytes, str]:
    """A file's bytes and their SHA-256; raises as `read_whole` does."""
    data = read_whole(path, max_bytes, kind)
    import hashlib  # Here and not above, because `vfplan COMMAND --help` needs none of it.

    return data, hashlib.sha256(data).hexdigest()


class OpenedFile:
    """A regular file, opened once: if another file takes its name meanwhile, this one is read.

    path, kind: as for `opened_file`, which raises
    """

    def __init__(self, path: Path, kind: type[InputError] = InputError) -> None:
        with opened_file(path, kind) as file:
            self.descriptor = os.dup(file.fileno())
        self._kind = kind
        self._where = str(path)
        self._stamp = self._size_and_time()

    def __del__(self) -> None:
        if hasattr(self, "descriptor"):
            os.close(self.descriptor)

    def fileno(self) -> int:
        """The descriptor, under the name that every Python file has for it."""
        return self.descriptor

    def view(self) -> BinaryIO:
        """A stream over the whole file, with a position of its own."""
        return stream_over(self.descriptor, self)

    def sha256(self) -> str:
        """SHA-256 of the file's bytes, hexadecimal."""
        import hashlib  # Here and not above, because `vfplan COMMAND --help` needs none of it.

        return hashlib.file_digest(self.view(), "sha256").hexdigest()

    def require_unchanged(self) -> None:
        """Refuse a file that was written to since it was opened: its digest would be wrong."""
        if self._size_and_time() != self._stamp:
            raise self._kind(
                "was changed while it was read", where=self._where, code="file-changed"
            )

    def _size_and_time(self) -> tuple[int, int]:
        status = os.fstat(self.descriptor)
        return status.st_size, status.st_mtime_ns


def stream_over(descriptor: int, owner: object = None) -> BinaryIO:
    """A stream with a position of its own in an open file.

    owner: the object that closes the descriptor; the stream keeps it alive
    """
    return cast("BinaryIO", io.BufferedReader(_View(descriptor, owner), 1 << 16))


class _View(io.RawIOBase):
    name = ""  # Libraries ask an open file for its name.

    def __init__(self, descriptor: int, owner: object) -> None:
        self._descriptor = descriptor
        self._owner = owner
        self._position = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:
        count = os.preadv(self._descriptor, [buffer], self._position)
        self._position += count
        return count

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        size = os.fstat(self._descriptor).st_size
        origins = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: size}
        self._position = offset + origins[whence]
        return self._position

    def tell(self) -> int:
        return self._position


def decompress(
    data: bytes, kind: str, where: str, max_bytes: int = MAX_DECOMPRESSED_BYTES
) -> bytes:
    """What "gzip" or "bzip2" bytes hold, never more than `max_bytes`.

    Raises InputError: the data are damaged, cut short, or hold more
    """
    try:
        if kind == "gzip":
            decompressor = zlib.decompressobj(wbits=zlib.MAX_WBITS | 32)
        else:
            import bz2

            decompressor = bz2.BZ2Decompressor()
        content = decompressor.decompress(data, max_bytes + 1)
    except (zlib.error, OSError, ValueError):
        raise InputError(
            f"its {kind} data are damaged. Copy or save the file again",
            where=where,
            code="compressed-data-damaged",
        ) from None
    if len(content) > max_bytes:
        raise InputError(
            f"unpacks to more than {max_bytes} bytes. Give a shorter file",
            where=where,
            code="unpacks-too-large",
            numbers={"max_bytes": max_bytes},
        )
    if not decompressor.eof:
        raise InputError(
            f"its {kind} data are cut short. Copy or save the file again",
            where=where,
            code="compressed-data-cut",
        )
    return content


def first_decompressed(data: bytes, count: int = 540) -> bytes:
    """The first bytes that gzip data hold; fewer where the data are damaged."""
    try:
        return zlib.decompressobj(wbits=zlib.MAX_WBITS | 32).decompress(data, count)
    except zlib.error:
        return b""


def check_text_size(data: bytes) -> None:
    """Raise `ValueError` for text that is too long or has too long a line."""
    if len(data) > MAX_TEXT_BYTES:
        raise ValueError(f"{len(data)} bytes of text; at most {MAX_TEXT_BYTES} are read")
    start = 0
    while len(data) - start > MAX_LINE_BYTES:
        # The last line break within the next longest line; the search goes on behind it.
        end = data.rfind(b"\n", start, start + MAX_LINE_BYTES)
        if end < 0:
            raise ValueError(f"the line at byte {start} is longer than {MAX_LINE_BYTES} bytes")
        start = end + 1


def parse_decimal(text: str) -> float:
    """A decimal number, blanks around it allowed; raises `ValueError` for anything else.

    A number beyond the largest float64, 1.8e308, is refused as well.
    """
    match = _DECIMAL.fullmatch(text)
    if match is None:
        if not text.strip():
            raise ValueError("a number is missing")
        raise ValueError(f"{text[:40]!r} is no number")
    value = float(match[1])
    if math.isinf(value):
        raise ValueError(f"{text[:40]!r} is larger than a float64 holds, 1.8e308")
    return value


def parse_seconds(text: str) -> float:
    """A length of time, e.g. `90s`, `30min`, `12h` or `2d`, as seconds."""
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)(s|min|h|d)", text)
    if match is None:
        raise ValueError(f"{text!r} is not a time. Type one like 90s, 30min, 12h or 2d")
    try:
        return timedelta(**{UNITS_OF_TIME[match[2]]: float(match[1])}).total_seconds()
    except OverflowError:
        raise ValueError(f"{text!r} is longer than any bundle is old. Type less") from None


def now_utc() -> str:
    """The time as ISO 8601 in whole seconds.

    The environment's SOURCE_DATE_EPOCH (reproducible-builds.org) takes the place of the clock.

    Raises InputError: SOURCE_DATE_EPOCH is no time
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if epoch is None:
        moment = datetime.now(UTC)
    elif epoch.isascii() and epoch.isdigit() and len(epoch) < 12:
        moment = datetime.fromtimestamp(int(epoch), UTC)
    else:
        raise InputError(
            f"the environment's SOURCE_DATE_EPOCH is {epoch!r}. Give whole seconds since 1970",
            code="epoch-invalid",
        )
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


NUMPY_READER = inspect.signature(np.lib.format.read_array_header_1_0)
MAX_HEADER_BYTES: int = NUMPY_READER.parameters["max_header_size"].default
"""NumPy's own limit."""


def npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether stored by columns, and type of the array in a `.npy` file.

    The stream is left where the array's data begin. Raises `ValueError`, in one line, for a header
    that is none or too long.
    """
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        size_bytes = 2
        read_header = np.lib.format.read_array_header_1_0
    elif version == (2, 0):
        size_bytes = 4
        read_header = np.lib.format.read_array_header_2_0
    else:
        raise ValueError(f".npy version {version}; 1.0 and 2.0 are read")
    size = stream.read(size_bytes)
    length = int.from_bytes(size, "little")
    if length > MAX_HEADER_BYTES:
        raise ValueError(f"the header is longer than {MAX_HEADER_BYTES} bytes")
    header = io.BytesIO(size + stream.read(length))
    try:
        return read_header(header)
    except Exception as error:  # NumPy parses the header as Python source.
        first_line = str(error)[:80].partition("\n")[0]
        raise ValueError(f"the header is none: {first_line}") from None


def to_json_types(value: Any) -> Any:
    """The value in JSON's types: arrays as nested lists, NaN and infinities as `null`."""
    if isinstance(value, dict):
        return {str(k): to_json_types(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json_types(v) for v in value]
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, without importing NumPy here.
        return to_json_types(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
