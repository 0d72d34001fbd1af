"""The files a command writes: all of them or none, and taken back where its report fails."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import click
from vfplan.cli.values import Written

from vfplan.errors import OutputError, VfplanError
from vfplan.io.staging import (
    PlacedFiles,
    create,
    hidden_name,
    made_folder,
    move_into_place,
    remove_quietly,
    working_in,
)

PLACED = "vfplan.cli.placed"  # under this key in click's context: what the command wrote


def refuse_outputs() -> None:
    """Check every file that the running command is to write, before any work is done.

    Raises `OutputError` when a path exists and there is no `--overwrite`, its folder is missing, it
    is no plain file, two outputs share it, of which only the last would remain, or it is also an
    input of this call: no `--overwrite` allows that.
    """
    context = click.get_current_context()
    written = [p.name for p in context.command.params if isinstance(p.type, Written)]
    _refuse(*filter(None, map(context.params.get, written)))


def _refuse(*paths: Path) -> None:
    inputs = _inputs(paths)
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise OutputError("is given for two outputs; each needs its own", where=str(path))
        seen.add(path.resolve())
        if path.resolve() in inputs:
            raise OutputError("is an input of this call; another name wanted", where=str(path))
        try:
            _refuse_place(path)
        except OSError as error:  # a name too long, a folder that may not be looked into
            raise OutputError(error.strerror or str(error), where=str(path)) from None


def refuse_beside(path: Path | None) -> None:
    """As `refuse_outputs`, of a file that the command names by itself beside the others."""
    if path is None:
        return
    context = click.get_current_context()
    others = [p.name for p in context.command.params if isinstance(p.type, Written)]
    _refuse(*filter(None, map(context.params.get, others)), path)


def refuse_folder(folder: Path | None, *names: str) -> None:
    """As `refuse_outputs`, of files in a folder that is made; without names it must be empty."""
    if folder is None:
        return
    if folder.is_dir():
        _refuse(*(folder / name for name in names))
        if not names and any(folder.iterdir()) and not overwriting():
            raise OutputError("is not empty; give --overwrite to replace it", where=str(folder))
    elif folder.exists():
        raise OutputError("is a file; a folder is wanted", where=str(folder))
    else:
        _refuse(folder)


def _refuse_place(path: Path) -> None:
    if path.exists() and not overwriting():
        raise OutputError("exists already; give --overwrite to replace it", where=str(path))
    if path.is_dir():
        raise OutputError("is a directory; a file is wanted", where=str(path))
    if path.exists() and not path.is_file():  # moving a file there would unmake a device
        raise OutputError("is a device or a pipe; a file is wanted", where=str(path))
    if not path.parent.is_dir():
        raise OutputError("its folder does not exist", where=str(path))


def _inputs(outputs: tuple[Path, ...]) -> set[Path]:
    """The other paths that the running command was called with."""
    context = click.get_current_context(silent=True)
    given = [] if context is None else context.params.values()
    paths = [value for value in given if isinstance(value, Path)]
    return {path.resolve() for path in paths if not any(path is out for out in outputs)}


@contextmanager
def outputs(*paths: Path | None) -> Iterator[tuple[Path | None, ...]]:
    """Write several files together: all of them appear, or none; a missing folder is made.

    Yields one temporary path a given path (same folder, same suffix; `None` stays `None`); moves
    them into place when the block ends well and deletes them when it does not. A power cut leaves
    the old file or the new one, whole. What exists is replaced only if the running command's
    `--overwrite` says so; the old files come back when the command's report cannot be written.

    Raises `OutputError` where the system lets a file not be made or written, or it exists.
    """
    # Writers make them with `vfplan.io.staging.create`: no link of others is written through.
    temporaries = tuple(p and hidden_name(p, "".join(p.suffixes[-2:])[1:] or "tmp") for p in paths)
    with ExitStack() as folders:
        try:
            for folder in {path.parent for path in paths if path is not None}:
                folders.enter_context(made_folder(folder))
                folders.enter_context(working_in(folder))
            for temporary in filter(None, temporaries):  # no long work for a folder that takes none
                create(temporary).close()
                temporary.unlink()
            yield temporaries
            moves = [(t, p) for p, t in zip(paths, temporaries, strict=True) if p and t]
            _remember(move_into_place(moves, overwrite=overwriting()), folders.pop_all())
        except OSError as error:
            reason = error.strerror or str(error)
            where = next((str(p) for p in paths if p is not None), None)
            raise OutputError(f"cannot be written: {reason}", where=where) from error
        except VfplanError as error:
            for path, temporary in zip(paths, temporaries, strict=True):
                if temporary is not None and error.where == str(temporary):
                    error.where = str(path)  # the name that the caller knows
            raise
        finally:
            for temporary in filter(None, temporaries):
                remove_quietly(temporary)


def overwriting() -> bool:
    """Whether the running command was given `--overwrite`."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.params.get("overwrite"))


def _remember(placed: PlacedFiles, folders: ExitStack) -> None:
    """Keep what the running command wrote in mind until its report is out, its folders locked."""
    context = click.get_current_context(silent=True)
    if context is None:
        placed.commit()
        folders.close()
    else:
        context.meta.setdefault(PLACED, []).append((placed, folders))


class _TakenBack(Exception):  # noqa: N818 - tells a folder that was made to go again
    pass


def keep() -> None:
    """Leave what the running command wrote: its report is out."""
    for placed, folders in click.get_current_context().meta.pop(PLACED, []):
        placed.commit()
        folders.close()


def take_back() -> None:
    """Undo what the running command wrote and no `keep` has settled."""
    for placed, folders in reversed(click.get_current_context().meta.pop(PLACED, [])):
        with suppress(_TakenBack), folders:
            try:
                placed.rollback()
            except OutputError as error:
                click.echo(f"vfplan: error: {error.where}: {error.message}", err=True)
            raise _TakenBack
