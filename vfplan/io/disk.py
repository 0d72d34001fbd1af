"""What is written: files, whole or not at all, and values as JSON holds them."""

from __future__ import annotations

import errno
import fcntl
import math
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from vfplan.errors import OutputError

EXISTS = "exists already; give --overwrite to replace it"
# What a file system answers that has no hard links.
NO_LINKS = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EINVAL)
HIDDEN = re.compile(r"\.vfplan-[0-9a-f]{16}\..+")  # the names that `beside` gives


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


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder, and those above it; what was made is taken away when the block fails."""
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for place in made:
            with suppress(OSError):
                place.rmdir()
        raise


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
                left.callback(temporary.unlink, missing_ok=True)
                yield file
                file.flush()
                os.fsync(file.fileno())
            _put(temporary, path, overwrite=overwrite)
            if not overwrite:
                left.callback(path.unlink, missing_ok=True)
            sync(path.parent)
            left.pop_all()
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror}", where=str(path)) from error


def write_together(files: list[tuple[Path, bytes, int]], *, overwrite: bool) -> None:
    """Write several files, each (path, bytes, mode): all of them or none.

    Raises `OutputError` as `move_whole` does.
    """
    moves = [(beside(path, "tmp"), path) for path, _, _ in files]
    with ExitStack() as held:
        for folder in {path.parent for path, _, _ in files}:
            held.enter_context(working_in(folder))
        for temporary, _ in moves:
            held.callback(temporary.unlink, missing_ok=True)
        for (temporary, at), (_, data, mode) in zip(moves, files, strict=True):
            try:
                with create(temporary, mode) as file:
                    file.write(data)
            except OSError as error:
                raise OutputError(f"cannot be written: {error.strerror}", where=str(at)) from error
        move_whole(moves, overwrite=overwrite).keep()


def sync(path: Path, flags: int = os.O_DIRECTORY) -> None:
    """Wait until a folder's names, or a file's bytes, are on the disk; raises `OSError`."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | flags)
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
        """Let the old files go; one that cannot be removed now is swept away by the next writer."""
        for _, old in self._done:
            if old is not None:
                with suppress(OSError):
                    old.unlink(missing_ok=True)
        self._done.clear()


def move_whole(moves: Iterable[tuple[Path, Path]], *, overwrite: bool) -> Placed:
    """Put finished files, (from, to) in the same folder, into place: all of them or none.

    Every file's bytes are on the disk before the first rename, every rename before this returns;
    a power cut leaves the old or the new of each, whole. The caller says `keep` or `undo`.

    Raises OutputError: a file cannot be put into its place, or is there already and `overwrite` is
        false; the others are as they were
    """
    pairs = list(moves)
    placed, at = Placed(), pairs[0][1] if pairs else Path()
    try:
        for temporary, at in pairs:  # noqa: B007 - `at` is named in the error
            sync(temporary, os.O_NOFOLLOW | os.O_NONBLOCK)
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


def beside(path: Path, suffix: str) -> Path:
    """A hidden name in the same folder, that no file has."""
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
    old = beside(target, "old")
    try:
        os.link(target, old, follow_symlinks=False)
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        shutil.copy2(target, old, follow_symlinks=False)
    return old


def jsonable(value: Any) -> Any:
    """The value as JSON holds it: arrays as nested lists, NaN and infinities as `null`."""
    if isinstance(value, dict):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [jsonable(v) for v in value]
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, without importing NumPy here
        return jsonable(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
