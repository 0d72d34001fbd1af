"""Write files so that the old one or the new one is there, whole, whatever happens.

A file is written under a hidden name in its own folder, flushed to the disk, and then renamed.
Several files that belong together are renamed together: all of them or none.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from vfplan.errors import OutputError

EXISTS = "exists already. Give --overwrite to replace it"

NO_HARD_LINKS = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EINVAL)
"""Error numbers by which a file system says that it has no hard links."""

HIDDEN = re.compile(r"\.vfplan-[0-9a-f]{16}\..+")
"""The names that `hidden_name` gives."""

LAST_COPY = stat.S_ISVTX
"""Mode bit of a hidden file that is all that remains of an old file. Linux gives the bit no other
meaning on a file, and setting it needs neither room nor a new name."""


def hidden_name(path: Path, suffix: str) -> Path:
    """A hidden name in the folder of `path` that no file has."""
    # Not made of the file's own name, which may be as long as the file system allows.
    return path.with_name(f".vfplan-{os.urandom(8).hex()}.{suffix}")


def create(path: Path, mode: int = 0o666) -> BinaryIO:
    """A new file, open for writing and reading.

    Raises OSError: the file cannot be made, or something has its name, also a link
    """
    # O_EXCL: in a folder that others may write to, nothing is written through a link of theirs.
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    return open(os.open(path, flags, mode), "w+b")


def sync(path: Path, flags: int = os.O_DIRECTORY) -> None:
    """Wait until a folder's names, or a file's bytes, are on the disk; raises `OSError`."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove_quietly(path: Path) -> None:
    """Remove a file where possible, without an error: the error before this one says more."""
    with suppress(OSError):
        path.unlink(missing_ok=True)


@contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """Mark a folder as one that is being written to, and remove what killed writers left there.

    Every writer holds a shared lock on the folder while it has hidden files there. A process that
    gets the lock alone knows that the writers of its user's hidden files have ended. Where a file
    system has no locks, or somebody else keeps the folder locked, nothing is removed. The last copy
    of a file that could not be put back (`PlacedFiles.rollback`) is never removed.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:  # The writer that follows says what is wrong.
        yield
        return
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for entry in os.scandir(folder):
                if not HIDDEN.fullmatch(entry.name):
                    continue
                status = entry.stat(follow_symlinks=False)
                is_own = status.st_uid == os.geteuid() and stat.S_ISREG(status.st_mode)
                if is_own and not status.st_mode & LAST_COPY:
                    os.unlink(entry.path)
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder and those above it; remove the new ones when the block fails."""
    new = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for place in new:
            with suppress(OSError):
                place.rmdir()
        raise


def write_whole(path: Path, parts: list[bytes], *, overwrite: bool, mode: int = 0o666) -> None:
    """Write a file so that, whatever happens, the old one or the new one is there, whole.

    Without `overwrite` no file is ever replaced, not even one that appears meanwhile.

    Raises OutputError: the path exists and `overwrite` is false, is a directory, or cannot be
        written
    """
    with whole_file(Path(path), overwrite=overwrite, mode=mode) as file:
        file.writelines(parts)
        file.seek(0)
        for part in parts:
            require_same(file.read(len(part)), part)


def require_same(read: object, written: object) -> None:
    """Raise `OSError` where a file does not read back as it was written."""
    if read != written:
        raise OSError(errno.EIO, "it reads back otherwise than it was written")


@contextmanager
def whole_file(path: Path, *, overwrite: bool, mode: int = 0o666) -> Iterator[BinaryIO]:
    """A file to fill: it gets its name when the block ends well, and is removed otherwise.

    Keeps the promises of `write_whole`, and raises as it does.
    """
    temporary = hidden_name(path, "tmp")
    try:
        if path.is_dir():
            raise OutputError(
                "is a directory. Name a file", where=str(path), code="output-is-folder"
            )
        if path.exists() and not overwrite:
            raise OutputError(EXISTS, where=str(path), code="output-exists")
        with working_in(path.parent), ExitStack() as cleanup:
            with create(temporary, mode) as file:
                cleanup.callback(remove_quietly, temporary)
                yield file
                file.flush()
                os.fsync(file.fileno())
            put_in_place(temporary, path, overwrite=overwrite)
            if not overwrite:
                cleanup.callback(path.unlink, missing_ok=True)
            sync(path.parent)
            cleanup.pop_all()
    except OSError as error:
        raise _not_written(path, error) from error


def write_together(files: list[tuple[Path, bytes, int]], *, overwrite: bool) -> None:
    """Write several files, each (path, bytes, mode): all of them or none.

    Raises OutputError: as `move_into_place`
    """
    moves = [(hidden_name(path, "tmp"), path) for path, _, _ in files]
    with ExitStack() as cleanup:
        for folder in {path.parent for path, _, _ in files}:
            cleanup.enter_context(working_in(folder))
        for temporary, _ in moves:
            cleanup.callback(remove_quietly, temporary)
        for (temporary, path), (_, data, mode) in zip(moves, files, strict=True):
            try:
                with create(temporary, mode) as file:
                    file.write(data)
            except OSError as error:
                raise _not_written(path, error) from error
        move_into_place(moves, overwrite=overwrite).commit()


def move_into_place(moves: Iterable[tuple[Path, Path]], *, overwrite: bool) -> PlacedFiles:
    """Give finished files, (from, to) in the same folder, their names: all of them or none.

    Every file's bytes are on the disk before the first rename, and every rename before this
    returns: a power cut leaves the old or the new of each, whole. The caller then calls `commit`
    or `rollback` of what is returned.

    Raises OutputError: a file cannot be put into its place, or its name is taken and `overwrite`
        is false; the others are as they were
    """
    pairs = list(moves)
    placed = PlacedFiles()
    current = Path()
    try:
        for temporary, current in pairs:  # noqa: B007 - the error below names it
            sync(temporary, os.O_NOFOLLOW | os.O_NONBLOCK)
        for temporary, current in pairs:
            placed.put(temporary, current, overwrite=overwrite)
        for folder in {target.parent for _, target in pairs}:
            sync(folder)
    except BaseException as error:
        placed.rollback()
        if isinstance(error, OSError):
            raise _not_written(current, error) from error
        raise
    return placed


def _not_written(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"cannot be written: {error.strerror}. Check the folder and its free space",
        where=str(path),
        code="output-not-written",
        numbers={"errno": error.errno},
    )


class PlacedFiles:
    """Files that got their names together, and can be withdrawn again.

    Until `commit` or `rollback` is called, each file that was replaced stays in the folder under a
    hidden name.
    """

    def __init__(self) -> None:
        # The name that was given, and the hidden name of the file that had it before, if any.
        self._done: list[tuple[Path, Path | None]] = []

    def put(self, temporary: Path, target: Path, *, overwrite: bool) -> None:
        """Give a finished file its name; raises `OSError`, or `OutputError` if it is taken."""
        old = None
        if overwrite and os.path.lexists(target):
            old = hidden_name(target, "old")
            _give_second_name(target, old)
        try:
            put_in_place(temporary, target, overwrite=overwrite)
        except BaseException:
            if old is not None:
                old.unlink(missing_ok=True)
            raise
        self._done.append((target, old))

    def rollback(self) -> None:
        """Remove the new files and put the old ones back; a second call does nothing.

        Raises OutputError: an old file cannot be put back; the message says under which name it is
        """
        failures: list[OutputError] = []
        for target, old in reversed(self._done):
            try:
                put_back(target, old)
            except OSError as error:  # The other files are put back all the same.
                text = f"cannot be removed again: {error.strerror}. Remove it by hand"
                if old is not None:
                    text = f"cannot be put back: {error.strerror}. What it held is in {old}"
                    with suppress(OSError):
                        old.chmod(stat.S_IMODE(old.stat().st_mode) | LAST_COPY)
                failures.append(OutputError(text, where=str(target), code="not-put-back"))
        self._done.clear()
        if failures:
            raise failures[0]

    def commit(self) -> None:
        """Remove the old files; the next writer in the folder removes any that resists now."""
        for _, old in self._done:
            if old is not None:
                remove_quietly(old)
        self._done.clear()


def put_back(target: Path, old: Path | None) -> None:
    """Give an old file its name again, also where the file system refuses to rename.

    Raises OSError: neither a rename nor a second name nor a copy works; the target is as it was
    """
    if old is None:
        target.unlink(missing_ok=True)
        return
    try:
        os.replace(old, target)
    except OSError:
        # A second hidden name shows first that names can be given; only then the new file goes.
        spare = hidden_name(target, "old")
        _give_second_name(old, spare)
        target.unlink(missing_ok=True)
        _give_second_name(old, target)
        remove_quietly(old)
        remove_quietly(spare)


def _give_second_name(old: Path, name: Path) -> None:
    """Give a file a second name, or copy it where the file system has no hard links."""
    try:
        os.link(old, name, follow_symlinks=False)
    except OSError as error:
        if error.errno not in NO_HARD_LINKS:
            raise
        import shutil  # Here and not above, because `vfplan COMMAND --help` needs none of it.

        shutil.copy2(old, name, follow_symlinks=False)


def put_in_place(temporary: Path, target: Path, *, overwrite: bool) -> None:
    """Rename a file; without `overwrite` a name that is taken is refused in the same step.

    Raises OutputError: the name is taken
    Raises OSError: the system refuses
    """
    if overwrite:
        os.replace(temporary, target)
        return
    try:
        try:
            os.link(temporary, target)  # Unlike a rename, a link never replaces a file.
        except OSError as error:
            if error.errno not in NO_HARD_LINKS:
                raise
            # An empty file takes the name in one step, and is then replaced.
            os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC))
            try:
                os.replace(temporary, target)
            except OSError:
                os.unlink(target)
                raise
            return
    except FileExistsError:
        raise OutputError(EXISTS, where=str(target), code="output-exists") from None
    os.unlink(temporary)
