"""Files, read or written whole; numbers as text holds them, and the time.

What comes from outside is a regular file of a bounded size; what is written is there whole, or not
at all.
"""

from __future__ import annotations

import errno
import fcntl
import math
import os
import re
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from vfplan.errors import InputError, OutputError

MOST_FILE = 1 << 30  # bytes
EXISTS = "exists already; give --overwrite to replace it"
# What a file system answers that has no hard links.
NO_LINKS = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EINVAL)
HIDDEN = re.compile(r"\.vfplan-[0-9a-f]{16}\..+")  # the names that `beside` gives

# Digits, a point, an exponent: not the 1_000, 0x10, 1d3, nan or digits of other scripts that one
# reader or another takes.
_REAL = re.compile(r"[ \t]*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)[ \t]*")


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


def read_bytes(
    path: Path, most: int = MOST_FILE, kind: type[InputError] = InputError
) -> tuple[bytes, str]:
    """A file's bytes and their SHA-256; raises as `read_whole` does."""
    with suppress(OSError):  # what is not there, `read_whole` names
        most = min(most, path.stat().st_size + 1)  # a read takes room for all that it may get
    data = read_whole(path, most, kind)
    import hashlib  # here and not above: `vfplan COMMAND --help` needs none of it

    return data, hashlib.sha256(data).hexdigest()


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


@contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """Mark a folder as one that is being written to, and first take away what a kill left there.

    Every writer holds a shared lock on the folder while it has hidden files there. Whoever gets
    the lock alone knows that the hidden files of its user have lost their writer. Where a file
    system has no locks, or somebody else keeps the folder locked, nothing is taken away.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:  # the writer that follows says what is wrong
        yield
        return
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _sweep(folder)
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        yield
    finally:
        os.close(descriptor)


def _sweep(folder: Path) -> None:
    for entry in os.scandir(folder):
        if not HIDDEN.fullmatch(entry.name):
            continue
        found = entry.stat(follow_symlinks=False)
        if found.st_uid == os.geteuid() and stat.S_ISREG(found.st_mode):
            os.unlink(entry.path)


def create(path: Path, mode: int = 0o666) -> BinaryIO:
    """A new file, open for writing and reading; raises `OSError`, also where a link has its name.

    O_EXCL: in a folder that others may write to, nothing is written through a link of theirs.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    return open(os.open(path, flags, mode), "w+b")


def write_whole(path: Path, parts: list[bytes], *, overwrite: bool, mode: int = 0o666) -> None:
    """Write a file so that, whatever happens, the old one or the new one is there, whole.

    A temporary file in the same folder, fsync, rename, fsync of the folder. Without `overwrite` no
    file is ever replaced, not even one that appears meanwhile.

    Raises OutputError: the path exists and `overwrite` is false, is a directory, or cannot be
        written
    """
    with whole_file(Path(path), overwrite=overwrite, mode=mode) as file:
        file.writelines(parts)
        file.seek(0)
        if any(file.read(len(part)) != part for part in parts):
            raise OSError(errno.EIO, "it reads back otherwise than it was written")


@contextmanager
def whole_file(path: Path, *, overwrite: bool, mode: int = 0o666) -> Iterator[BinaryIO]:
    """A file to fill that gets its name when the block ends well, and else is taken away.

    What `write_whole` says of files holds; raises as it does.
    """
    temporary = beside(path, "tmp")
    try:
        if path.is_dir():
            raise OutputError("is a directory; a file is wanted", where=str(path))
        if path.exists() and not overwrite:
            raise OutputError(EXISTS, where=str(path))
        with working_in(path.parent), ExitStack() as left:
            with create(temporary, mode) as file:
                left.callback(remove_quietly, temporary)
                yield file
                file.flush()
                os.fsync(file.fileno())
            put_in_place(temporary, path, overwrite=overwrite)
            if not overwrite:
                left.callback(path.unlink, missing_ok=True)
            sync(path.parent)
            left.pop_all()
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror}", where=str(path)) from error


def sync(path: Path, flags: int = os.O_DIRECTORY) -> None:
    """Wait until a folder's names, or a file's bytes, are on the disk; raises `OSError`."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def beside(path: Path, suffix: str) -> Path:
    """A hidden name in the same folder, that no file has."""
    return path.with_name(f".vfplan-{os.urandom(8).hex()}.{suffix}")  # never too long a name


def remove_quietly(path: Path) -> None:
    """Take a file away, if it is there and can be; an error before this one says more."""
    with suppress(OSError):
        path.unlink(missing_ok=True)


def put_in_place(temporary: Path, target: Path, *, overwrite: bool) -> None:
    """Rename; without `overwrite` in one step with the question whether the name is free."""
    if overwrite:
        os.replace(temporary, target)
        return
    try:
        try:
            os.link(temporary, target)  # unlike a rename, never replaces
        except OSError as error:
            if error.errno not in NO_LINKS:
                raise
            os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC))
            try:
                os.replace(temporary, target)
            except OSError:
                os.unlink(target)
                raise
            return
    except FileExistsError:
        raise OutputError(EXISTS, where=str(target)) from None
    os.unlink(temporary)
