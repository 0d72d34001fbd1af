"""Files, whole or not at all."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from vfplan.errors import InputError, OutputError


def write_whole(path: Path, parts: list[bytes], *, overwrite: bool, mode: int = 0o666) -> None:
    """Write a file so that, whatever happens, the old one or the new one is there, whole.

    A temporary file in the same folder, fsync, rename, fsync of the folder.

    Raises
    ------
    OutputError
        The path exists and `overwrite` is false, is a directory, or cannot be written.
    """
    path = Path(path)
    if path.is_dir():
        raise OutputError("is a directory; a file is wanted", where=str(path))
    if path.exists() and not overwrite:
        raise OutputError("exists already; give --overwrite to replace it", where=str(path))
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        _write_synced(temporary, parts, mode)
        if not overwrite and path.exists():
            raise OutputError("exists already; give --overwrite to replace it", where=str(path))
        os.replace(temporary, path)
        sync(path.parent)
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror}", where=str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Wait until a file's bytes, or a folder's names, are on the disk; raises `OSError`."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def move_whole(moves: Iterable[tuple[Path, Path]]) -> None:
    """Put finished files, (from, to) in the same folder, into place: old or new, whatever happens.

    Every file's bytes are on the disk before the first rename, every rename before this returns.

    Raises
    ------
    OutputError
        A file cannot be put into its place.
    """
    pairs = list(moves)
    try:
        for temporary, _ in pairs:
            sync(temporary)
        for temporary, target in pairs:
            os.replace(temporary, target)
        for folder in {target.parent for _, target in pairs}:
            sync(folder)
    except OSError as error:
        where = ", ".join(str(target) for _, target in pairs)
        raise OutputError(f"cannot be written: {error.strerror}", where=where) from error


def _write_synced(path: Path, parts: list[bytes], mode: int) -> None:
    # O_EXCL: never through a link that somebody put there.
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    with open(descriptor, "wb") as file:
        file.writelines(parts)
        file.flush()
        os.fsync(file.fileno())


def opened_file(path: Path) -> BinaryIO:
    """A regular file, open for reading.

    Raises `InputError` if there is none, it is a directory or a device, or it cannot be read.
    """
    try:
        # Not to hang on a named pipe, which opens only when somebody writes to it.
        file = open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")  # noqa: SIM115
    except IsADirectoryError:
        raise InputError("is a directory; a bundle is wanted", where=str(path)) from None
    except FileNotFoundError:
        raise InputError("there is no such file", where=str(path)) from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", where=str(path)) from error
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise InputError("is not a regular file; a bundle is wanted", where=str(path))
    return file
