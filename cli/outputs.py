"""The files a command writes: all of them or none, and none where its report cannot be printed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import click
from vfplan.cli.options import OutputFile

from vfplan.errors import OutputError, VfplanError
from vfplan.io.writing import (
    create,
    hidden_name,
    made_folder,
    move_into_place,
    remove_quietly,
    working_in,
)

PLACED = "vfplan.cli.placed"
"""Under this key in click's context: the files that the running command wrote."""


def refuse_outputs() -> None:
    """Check every file that the running command is to write, before any work is done.

    Raises
    ------
    OutputError
        A path exists and there is no `--overwrite`, its folder is missing, it is no plain file, or
        two outputs share it. A path that is also an input of this call is refused even with
        `--overwrite`.
    """
    _refuse(_output_options())


def refuse_named_files(*paths: Path | None) -> None:
    """As `refuse_outputs`, with files that the command names by itself besides its options."""
    outputs = _output_options()
    for path in paths:
        if path is not None and path not in outputs:
            outputs.append(path)
    _refuse(outputs)


def refuse_folder(folder: Path | None, *names: str) -> None:
    """As `refuse_outputs`, for files in a folder that is made; without names it must be empty."""
    if folder is None:
        return
    if folder.is_dir():
        _refuse([folder / name for name in names])
        if not names and any(folder.iterdir()) and not is_overwriting():
            raise OutputError(
                "is not empty. Give --overwrite to replace what is in it, or name a new "
                "folder",
                where=str(folder), code="folder-not-empty",
            )  # fmt: skip
    elif folder.exists():
        raise OutputError("is a file. Name a folder", where=str(folder), code="folder-is-a-file")
    else:
        _refuse([folder])


def _output_options() -> list[Path]:
    """The files that the options of the running command name as its outputs."""
    context = click.get_current_context()
    paths = []
    for param in context.command.params:
        path = context.params.get(param.name)
        if isinstance(param.type, OutputFile) and path:
            paths.append(path)
    return paths


def _refuse(paths: list[Path]) -> None:
    """Raise `OutputError` for the first path that cannot become an output of this call."""
    inputs = set()
    context = click.get_current_context(silent=True)
    if context is not None:
        for value in context.params.values():
            if isinstance(value, Path) and not any(value is path for path in paths):
                inputs.add(value.resolve())
    resolved: set[Path] = set()
    for path in paths:
        if path.resolve() in resolved:
            raise OutputError(
                "is given for two outputs. Give each its own name",
                where=str(path), code="output-twice",
            )  # fmt: skip
        resolved.add(path.resolve())
        if path.resolve() in inputs:
            raise OutputError(
                "is an input of this call. Give the output another name",
                where=str(path), code="output-is-input",
            )  # fmt: skip
        try:
            refuse_place(path)
        except OSError as error:
            # The name is too long, or the folder may not be looked into.
            reason = error.strerror or str(error)
            raise OutputError(
                f"{reason}. Name another file", where=str(path), code="output-place"
            ) from None
        try:
            check_takes_files(path.parent)
        except OSError as error:
            raise not_written(path, error) from None


def check_takes_files(folder: Path) -> None:
    """Make an empty file in a folder and remove it; raises `OSError` where that cannot be done."""
    trial = hidden_name(folder / "trial", "tmp")
    create(trial).close()
    trial.unlink()


def not_written(path: Path | None, error: OSError) -> OutputError:
    """The error of an output that the system does not let write."""
    reason = error.strerror or str(error)
    where = str(path) if path is not None else None
    return OutputError(
        f"cannot be written: {reason}. Check the folder and its free space",
        where=where,
        code="output-not-written",
    )


def refuse_place(path: Path) -> None:
    """Raise `OutputError` where no file may be written at a path."""
    if path.is_dir():
        raise OutputError(
            "is a directory. Name a file", where=str(path), code="output-is-a-directory"
        )
    if path.exists() and not path.is_file():
        # To move a file there would unmake the device.
        raise OutputError(
            "is a device or a pipe. Name a file", where=str(path), code="output-is-a-device"
        )
    if path.exists() and not is_overwriting():
        raise OutputError(
            "exists already. Give --overwrite to replace it", where=str(path), code="output-exists"
        )
    if not path.parent.is_dir():
        raise OutputError(
            "its folder does not exist. Make it first", where=str(path), code="no-output-folder"
        )


@contextmanager
def outputs(*paths: Path | None) -> Iterator[tuple[Path | None, ...]]:
    """Write several files together: all of them appear, or none; a missing folder is made.

    Yields a temporary path for each path, in the same folder and with the same suffix; `None` stays
    `None`. Moves them into place when the block ends well and deletes them when it does not. A
    power cut leaves the old file or the new one, whole. A file that exists is replaced only where
    the running command has `--overwrite`, and it comes back when the report cannot be printed.

    Raises
    ------
    OutputError
        A file cannot be made or written, or it exists.
    """
    temporaries: list[Path | None] = []
    for path in paths:
        temporary = None
        if path is not None:
            suffix = "".join(path.suffixes[-2:])[1:]
            temporary = hidden_name(path, suffix or "tmp")
        temporaries.append(temporary)
    pairs = [
        (temporary, path)
        for temporary, path in zip(temporaries, paths, strict=True)
        if temporary is not None
    ]
    with ExitStack() as folders:
        try:
            for folder in {path.parent for _, path in pairs}:
                folders.enter_context(made_folder(folder))
                folders.enter_context(working_in(folder))
            # A folder that takes no file is refused before the long work. The writers make the
            # temporary files anew, so that nothing is written through another program's link.
            for temporary, _ in pairs:
                create(temporary).close()
                temporary.unlink()
            yield tuple(temporaries)
            placed = move_into_place(pairs, overwrite=is_overwriting())
            # The command's report is printed next, and only then do the files stay. Their folders
            # are locked until then. Without a running command there is nothing to wait for.
            locks = folders.pop_all()
            context = click.get_current_context(silent=True)
            if context is None:
                placed.commit()
                locks.close()
            else:
                context.meta.setdefault(PLACED, []).append((placed, locks))
        except OSError as error:
            first = pairs[0][1] if pairs else None
            raise not_written(first, error) from error
        except VfplanError as error:
            # The error names the file as the caller knows it.
            for temporary, path in pairs:
                if error.where == str(temporary):
                    error.where = str(path)
            raise
        finally:
            for temporary, _ in pairs:
                remove_quietly(temporary)


def is_overwriting() -> bool:
    """Whether the running command was given `--overwrite`."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.params.get("overwrite"))


class _RolledBack(Exception):  # noqa: N818
    """Makes a folder that was made for an output go again."""


def commit() -> None:
    """Leave the files that the running command wrote: its report is printed."""
    for placed, folders in click.get_current_context().meta.pop(PLACED, []):
        placed.commit()
        folders.close()


def rollback() -> None:
    """Undo the files that the running command wrote and that no `commit` has settled."""
    for placed, folders in reversed(click.get_current_context().meta.pop(PLACED, [])):
        with suppress(_RolledBack), folders:
            try:
                placed.rollback()
            except OutputError as error:
                click.echo(f"vfplan: error: {error.where}: {error.message}", err=True)
            raise _RolledBack
