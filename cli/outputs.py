"""The files a command writes: all of them, or after an error none."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import click
from vfplan.cli.options import OutputFile

from vfplan.errors import OutputError, VfplanError
from vfplan.io.writing import (
    create,
    hidden_name,
    made_folder,
    move_into_place,
    not_written,
    remove_quietly,
)

# Under this key in click's context: raises where a signal has told the running command to stop.
RAISE_IF_STOPPED = "vfplan.cli.raise_if_stopped"


def refuse_outputs(*more: Path | None) -> None:
    """Check every file that the running command is to write, before any work is done.

    more: files that the command names by itself besides its options

    Raises
    ------
    OutputError
        A path exists and there is no `--overwrite`, its folder is missing, it is no plain file, or
        two outputs share it. A path that is also an input of this call is refused even with
        `--overwrite`.
    """
    context = click.get_current_context()
    params = [param.name for param in context.command.params if isinstance(param.type, OutputFile)]
    outputs = [path for path in map(context.params.get, params) if path]
    _refuse([*outputs, *(path for path in more if path is not None and path not in outputs)])


def refuse_folder(folder: Path | None, *names: str) -> None:
    """As `refuse_outputs`, for files in a folder that is made; without names it must be empty."""
    if folder is None:
        return
    if not folder.exists():
        _refuse([folder])
    elif not folder.is_dir():
        raise refusal(folder, "is a file. Name a folder", "folder-is-a-file")
    elif names:
        _refuse([folder / name for name in names])
    elif any(folder.iterdir()) and not is_overwriting():
        message = "is not empty. Give --overwrite to replace what is in it, or name a new folder"
        raise refusal(folder, message, "folder-not-empty")


def refusal(path: Path, message: str, code: str) -> OutputError:
    """The error of a path that is no place for an output."""
    return OutputError(message, where=path, code=code)


def _refuse(paths: list[Path]) -> None:
    """Raise `OutputError` for the first path that cannot become an output of this call."""
    values = list(getattr(click.get_current_context(silent=True), "params", {}).values())
    # Some arguments are several files.
    values += [value for several in values if isinstance(several, tuple) for value in several]
    inputs = {
        os.path.realpath(value)  # It takes a loop of links as it is.
        for value in values
        if isinstance(value, Path) and not any(value is path for path in paths)
    }
    resolved = set()
    for path in paths:
        place = os.path.realpath(path)
        if place in resolved:
            message = "is given for two outputs. Give each its own name"
            raise refusal(path, message, "output-twice")
        resolved.add(place)
        if place in inputs:
            message = "is an input of this call. Give the output another name"
            raise refusal(path, message, "output-is-input")
        try:
            refuse_place(path)
        except OSError as error:
            # The name is too long, or the folder may not be looked into.
            message = f"{error.strerror or error}. Name another file"
            raise refusal(path, message, "output-place") from None
        try:
            # A folder may exist and take no file.
            trial = hidden_name(path.parent / "trial", "tmp")
            create(trial).close()
            trial.unlink()
        except OSError as error:
            raise not_written(path, error) from None


def refuse_place(path: Path) -> None:
    """Raise `OutputError` where no file may be written at a path."""
    if path.is_dir():
        raise refusal(path, "is a directory. Name a file", "output-is-a-directory")
    if path.exists() and not path.is_file():
        # To move a file there would unmake the device.
        raise refusal(path, "is a device or a pipe. Name a file", "output-is-a-device")
    if path.exists() and not is_overwriting():
        raise refusal(path, "exists already. Give --overwrite to replace it", "output-exists")
    if not path.parent.is_dir():
        raise refusal(path, "its folder does not exist. Make it first", "no-output-folder")


@contextmanager
def outputs(*paths: Path | None) -> Iterator[tuple[Path | None, ...]]:
    """Write several files together: all of them appear, or none; a missing folder is made.

    Yields a temporary path for each path, in the same folder and with the same suffix; `None` stays
    `None`. Moves them into place when the block ends well, those that it made, and deletes them
    when it does not. A
    power cut leaves the old file or the new one, whole. A file that exists is replaced only where
    the running command has `--overwrite`.

    Raises
    ------
    OutputError
        A file cannot be made or written, or it exists.
    """
    temporaries = [
        None if path is None else hidden_name(path, "".join(path.suffixes[-2:])[1:] or "tmp")
        for path in paths
    ]
    pairs = [(t, path) for t, path in zip(temporaries, paths, strict=True) if t and path]
    with ExitStack() as cleanup:
        try:
            for folder in {path.parent for _, path in pairs}:
                cleanup.enter_context(made_folder(folder))
            for temporary, _ in pairs:
                cleanup.callback(remove_quietly, temporary)
            yield tuple(temporaries)
            context = click.get_current_context(silent=True)
            if context is not None and RAISE_IF_STOPPED in context.meta:
                context.meta[RAISE_IF_STOPPED]()
            pairs = [(temporary, path) for temporary, path in pairs if temporary.exists()]
            move_into_place(pairs, overwrite=is_overwriting())
        except OSError as error:
            raise not_written(pairs[0][1] if pairs else None, error) from error
        except VfplanError as error:
            # The error names the file as the caller knows it.
            for temporary, path in pairs:
                if error.where == str(temporary):
                    error.where = str(path)
            raise


def is_overwriting() -> bool:
    """Whether the running command was given `--overwrite`."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.params.get("overwrite"))
