"""Write files so that the old one or the new one is there, whole, whatever happens.

A file is written under a hidden name in its own folder, flushed to the disk, and then renamed.
Several files that belong together are renamed one after the other. After an error all of them are
there or none; after a kill between two renames some may be the new ones, each whole.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from vfplan.errors import OutputError
from vfplan.io.files import flags

EXISTS = "exists already. Give --overwrite to replace it"

# Place of the byte that Windows locks, behind all that the file holds.
LOCKED_BYTE = 2**20

# Error numbers by which a file system says that it has no hard links.
NO_HARD_LINKS = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EINVAL)


def hidden_name(path: Path, suffix: str) -> Path:
    """A hidden name in the folder of `path` that no file has."""
    # Not made of the file's own name, which may be as long as the file system allows.
    return path.with_name(f".vfplan-{os.urandom(8).hex()}.{suffix}")


def create(path: Path, mode: int = 0o666) -> BinaryIO:
    """A new file, open for writing and reading.

    Raises OSError: the file cannot be made, or something has its name, also a link
    """
    # O_EXCL: in a folder that others may write to, nothing is written through a link of theirs.
    how = os.O_RDWR | os.O_CREAT | os.O_EXCL | flags("O_CLOEXEC O_BINARY")
    return open(os.open(path, how, mode), "w+b")


def sync(path: Path, how: str = "O_DIRECTORY") -> None:
    """Wait until a folder's names, or a file's bytes, are on the disk; raises `OSError`."""
    if not hasattr(os, "O_DIRECTORY"):
        return  # Windows opens no folder, and flushes only what is open for writing.
    descriptor = os.open(path, os.O_RDONLY | flags(f"O_CLOEXEC {how}"))
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def lock_file(descriptor: int) -> None:
    """Lock a file for this process until it is closed; raises `OSError` where another has it."""
    try:
        import fcntl
    except ImportError:
        import msvcrt

        # The bytes there name the process, which others may read. So one far behind is locked.
        os.lseek(descriptor, LOCKED_BYTE, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        os.lseek(descriptor, 0, os.SEEK_SET)
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def remove_quietly(path: Path) -> None:
    """Remove a file where possible, without an error: the error before this one says more."""
    with suppress(OSError):
        path.unlink(missing_ok=True)


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


@contextmanager
def whole_file(path: Path, *, overwrite: bool, mode: int = 0o666) -> Iterator[BinaryIO]:
    """A file to fill: it gets its name when the block ends well, and is removed otherwise.

    Keeps the promises of `write_whole`, and raises as it does.
    """
    try:
        if path.is_dir():
            raise OutputError("is a directory. Name a file", where=path, code="output-is-folder")
        if path.exists() and not overwrite:
            raise OutputError(EXISTS, where=path, code="output-exists")
        with unfinished(path, mode) as (temporary, file):
            yield file
            file.flush()
            move_into_place([(temporary, path)], overwrite=overwrite)
    except OSError as error:
        raise not_written(path, error) from error


@contextmanager
def unfinished(path: Path, mode: int) -> Iterator[tuple[Path, BinaryIO]]:
    """A new file under a hidden name beside `path`, which is removed at the end of the block."""
    temporary = hidden_name(path, "tmp")
    with create(temporary, mode) as file:
        try:
            yield temporary, file
        finally:
            remove_quietly(temporary)


def write_together(files: list[tuple[Path, bytes, int]], *, overwrite: bool) -> None:
    """Write several files, each (path, bytes, mode): all of them, or after an error none.

    Raises OutputError: as `move_into_place`
    """
    moves = []
    with ExitStack() as stack:
        for path, data, mode in files:
            try:
                temporary, file = stack.enter_context(unfinished(path, mode))
                file.write(data)
                file.flush()
            except OSError as error:
                raise not_written(path, error) from error
            moves.append((temporary, path))
        move_into_place(moves, overwrite=overwrite)


def move_into_place(moves: list[tuple[Path, Path]], *, overwrite: bool) -> None:
    """Give finished files, (from, to) in the same folder, their names: all, or after an error none.

    Every file's bytes are on the disk before the first rename, and every rename before this
    returns: a power cut or a kill between two renames leaves the old or the new of each, whole.

    Raises OutputError: a file cannot be put into its place, or its name is taken and `overwrite`
        is false; the others are as they were
    """
    old_files = []
    current = Path()
    try:
        with ExitStack() as undo:
            for temporary, current in moves:  # noqa: B007 - the error below names it
                sync(temporary, "O_NOFOLLOW O_NONBLOCK")
            for temporary, current in moves:
                old = None
                if overwrite and os.path.lexists(current):
                    old = hidden_name(current, "old")
                    give_second_name(current, old)
                    old_files.append(old)
                try:
                    put_in_place(temporary, current, overwrite=overwrite)
                except BaseException:
                    # The old file has its name still, so its second name is of no use.
                    remove_quietly(old or temporary)
                    raise
                undo.callback(put_back, current, old)
            for folder in {target.parent for _, target in moves}:
                sync(folder)
            undo.pop_all()
    except OSError as error:
        raise not_written(current, error) from error
    for old in old_files:
        remove_quietly(old)


def not_written(path: Path | None, error: OSError) -> OutputError:
    """The error of an output that the system does not let write."""
    return OutputError(
        f"cannot be written: {error.strerror or error}. Check the folder and its free space",
        where=None if path is None else str(path), code="output-not-written",
        numbers={"errno": error.errno},
    )  # fmt: skip


def put_back(target: Path, old: Path | None) -> None:
    """Give an old file its name again, or remove a new one.

    Raises OutputError: the system refuses; the message says under which name the old file is
    """
    try:
        if old is None:
            target.unlink(missing_ok=True)
        else:
            os.replace(old, target)
            remove_quietly(old)  # A rename leaves both of two names of one file.
    except OSError as error:
        text = f"cannot be removed again: {error.strerror}. Remove it by hand"
        if old is not None:
            text = f"cannot be put back: {error.strerror}. What it held is in {old}"
        raise OutputError(text, where=target, code="not-put-back") from error


def give_second_name(old: Path, name: Path) -> None:
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
            target.touch(exist_ok=False)
            try:
                os.replace(temporary, target)
            except OSError:
                os.unlink(target)
                raise
            return
    except FileExistsError:
        raise OutputError(EXISTS, where=target, code="output-exists") from None
    os.unlink(temporary)
