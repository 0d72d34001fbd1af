"""Several files written together, all or none, and values as JSON holds them."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from vfplan.errors import OutputError
from vfplan.io.files import (
    NO_LINKS,
    beside,
    create,
    put_in_place,
    remove_quietly,
    sync,
    working_in,
)


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


def write_together(files: list[tuple[Path, bytes, int]], *, overwrite: bool) -> None:
    """Write several files, each (path, bytes, mode): all of them or none.

    Raises `OutputError` as `move_whole` does.
    """
    moves = [(beside(path, "tmp"), path) for path, _, _ in files]
    with ExitStack() as held:
        for folder in {path.parent for path, _, _ in files}:
            held.enter_context(working_in(folder))
        for temporary, _ in moves:
            held.callback(remove_quietly, temporary)
        for (temporary, at), (_, data, mode) in zip(moves, files, strict=True):
            try:
                with create(temporary, mode) as file:
                    file.write(data)
            except OSError as error:
                raise OutputError(f"cannot be written: {error.strerror}", where=str(at)) from error
        move_whole(moves, overwrite=overwrite).keep()


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
            put_in_place(temporary, target, overwrite=overwrite)
        except BaseException:
            if old is not None:
                old.unlink(missing_ok=True)
            raise
        self._done.append((target, old))

    def undo(self) -> None:
        """Take the new files away and put the old ones back; a second call does nothing.

        Raises OutputError: an old file cannot be put back; the message says under which name it is
        """
        lost: list[tuple[Path, Path | None, OSError]] = []
        for target, old in reversed(self._done):
            try:
                _put_back(target, old)
            except OSError as error:  # the others are put back all the same
                lost.append((target, old, error))
        self._done.clear()
        for target, old, error in lost:
            if old is None:
                text = f"cannot be taken away again: {error.strerror}"
            else:
                text = f"cannot be put back: {error.strerror}; what it held is in {old}"
            raise OutputError(text, where=str(target), code="not-put-back")

    def keep(self) -> None:
        """Let the old files go; one that cannot be removed now is swept away by the next writer."""
        for _, old in self._done:
            if old is not None:
                with suppress(OSError):
                    old.unlink(missing_ok=True)
        self._done.clear()


def _put_back(target: Path, old: Path | None) -> None:
    """Give an old file its name again, also where the file system refuses to rename.

    Raises OSError: neither a rename nor a second name nor a copy works; the target is as it was
    """
    if old is None:
        target.unlink(missing_ok=True)
        return
    try:
        os.replace(old, target)
    except OSError:
        spare = beside(target, "old")
        _name_again(old, spare)  # whether it works is tried before the name is given up
        target.unlink(missing_ok=True)
        _name_again(old, target)
        for left_over in (old, spare):
            with suppress(OSError):
                left_over.unlink()


def _name_again(old: Path, name: Path) -> None:
    """Give a file a second name, or copy it where the file system has no second names."""
    try:
        os.link(old, name, follow_symlinks=False)
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        import shutil  # here and not above: `vfplan COMMAND --help` needs none of it

        shutil.copy2(old, name, follow_symlinks=False)


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


def _set_aside(target: Path) -> Path | None:
    """A second name for a file that will be replaced; `None` if there is no file."""
    if not os.path.lexists(target):
        return None
    old = beside(target, "old")
    _name_again(target, old)
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
