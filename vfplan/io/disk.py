"""Files, whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from vfplan.errors import InputError, OutputError

EXISTS = "exists already; give --overwrite to replace it"
# What a file system answers that has no hard links.
NO_LINKS = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EINVAL)


def write_whole(path: Path, parts: list[bytes], *, overwrite: bool, mode: int = 0o666) -> None:
    """Write a file so that, whatever happens, the old one or the new one is there, whole.

    A temporary file in the same folder, fsync, rename, fsync of the folder. Without `overwrite` no
    file is ever replaced, not even one that appears meanwhile.

    Raises
    ------
    OutputError
        The path exists and `overwrite` is false, is a directory, or cannot be written.
    """
    path = Path(path)
    temporary = _beside(path, "tmp")
    try:
        if path.is_dir():
            raise OutputError("is a directory; a file is wanted", where=str(path))
        if path.exists() and not overwrite:
            raise OutputError(EXISTS, where=str(path))
        _write_synced(temporary, parts, mode)
        _put(temporary, path, overwrite=overwrite)
        sync(path.parent)
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror}", where=str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_together(files: list[tuple[Path, bytes, int]], *, overwrite: bool) -> None:
    """Write several files, each (path, bytes, mode): all of them or none.

    Raises `OutputError` as `move_whole` does.
    """
    moves = [(_beside(path, "tmp"), path) for path, _, _ in files]
    try:
        for (temporary, at), (_, data, mode) in zip(moves, files, strict=True):
            try:
                _write_synced(temporary, [data], mode)
            except OSError as error:
                raise OutputError(f"cannot be written: {error.strerror}", where=str(at)) from error
        move_whole(moves, overwrite=overwrite).keep()
    finally:
        for temporary, _ in moves:
            temporary.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Wait until a file's bytes, or a folder's names, are on the disk; raises `OSError`."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class Placed:
    """Files that were put into their places together, and can be taken out again.

    Until `keep` or `undo` is called, each file that was replaced stays beside the new one under a
    hidden name.
    """

    def __init__(self) -> None:
        self._done: list[tuple[Path, Path | None]] = []

    def put(self, temporary: Path, target: Path, *, overwrite: bool) -> None:
        """Give a finished file its name; raises `OSError`, or `OutputError` if it exists."""
        old = _set_aside(target) if overwrite else None
        try:
            _put(temporary, target, overwrite=overwrite)
        except BaseException:
            if old is not None:
                old.unlink(missing_ok=True)
            raise
        self._done.append((target, old))

    def undo(self) -> None:
        """Take the new files away and put the old ones back; a second call does nothing."""
        for target, old in reversed(self._done):
            if old is None:
                target.unlink(missing_ok=True)
            else:
                os.replace(old, target)
        self._done.clear()

    def keep(self) -> None:
        """Let the old files go."""
        for _, old in self._done:
            if old is not None:
                old.unlink(missing_ok=True)
        self._done.clear()


def move_whole(moves: Iterable[tuple[Path, Path]], *, overwrite: bool) -> Placed:
    """Put finished files, (from, to) in the same folder, into place: all of them or none.

    Every file's bytes are on the disk before the first rename, every rename before this returns;
    a power cut leaves the old or the new of each, whole. The caller says `keep` or `undo`.

    Raises
    ------
    OutputError
        A file cannot be put into its place, or is there already and `overwrite` is false; the
        others are as they were.
    """
    pairs = list(moves)
    placed, at = Placed(), pairs[0][1] if pairs else Path()
    try:
        for temporary, at in pairs:  # noqa: B007 - `at` is named in the error
            sync(temporary)
        for temporary, at in pairs:
            placed.put(temporary, at, overwrite=overwrite)
        for folder in {target.parent for _, target in pairs}:
            sync(folder)
    except BaseException as error:
        placed.undo()
        if isinstance(error, OSError):
            raise OutputError(f"cannot be written: {error.strerror}", where=str(at)) from error
        raise
    return placed


def _beside(path: Path, suffix: str) -> Path:
    return path.with_name(f".vfplan-{secrets.token_hex(8)}.{suffix}")  # never too long a name


def _put(temporary: Path, target: Path, *, overwrite: bool) -> None:
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


def _set_aside(target: Path) -> Path | None:
    """A second name for a file that will be replaced; `None` if there is no file."""
    if not os.path.lexists(target):
        return None
    old = _beside(target, "old")
    try:
        os.link(target, old, follow_symlinks=False)
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        shutil.copy2(target, old, follow_symlinks=False)
    return old


def _write_synced(path: Path, parts: list[bytes], mode: int) -> None:
    # O_EXCL: never through a link that somebody put there.
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    with open(descriptor, "wb") as file:
        file.writelines(parts)
        file.flush()
        os.fsync(file.fileno())


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
