"""What every command shares at run time: output, errors, exit codes, progress.

A command's body computes and returns a `Report`; this module prints it. The rules (one JSON
document on stdout and nothing else, one line on stderr for an error, no file left behind) hold for
every command because they are written once, here.
"""

from __future__ import annotations

import errno
import functools
import json
import logging
import math
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO
from unicodedata import category

import click
from vfplan.cli.plain import heed_no_settings
from vfplan.cli.stopping import Stopped, stoppable

from vfplan.errors import OutputError, VfplanError
from vfplan.io.clock import now_utc
from vfplan.io.disk import Placed, beside, create, made_folder, move_whole, working_in

# Unicode's kinds of signs that are not to be seen: controls, directions, halves, unknown ones.
STEERING = ("Cc", "Cf", "Cs", "Co", "Cn")
PLACED = "vfplan.cli.placed"  # under this key in click's context: what the command wrote


@dataclass(frozen=True)
class Report:
    """What a command found: `data` for `--json`, `text` for a person, `exit_code` for a script.

    `failed` says in a line what check did not hold; the exit code is then 1.
    """

    data: dict[str, Any]
    text: str = ""
    exit_code: int = 0
    warnings: list[str] = field(default_factory=list)
    failed: str = ""

    def __post_init__(self) -> None:
        """A check that failed is exit code 1."""
        if self.failed:
            object.__setattr__(self, "exit_code", 1)


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


def command(name: str, **attrs: Any) -> Callable[[Callable[..., Report]], click.Command]:
    """A click command whose function returns a `Report`.

    Adds `--json`, `-q` and `-v`, times the call (`elapsed_s`), and turns every `VfplanError` into
    one line and its exit code.
    """

    def wrap(function: Callable[..., Report]) -> click.Command:
        @functools.wraps(function)
        def body(as_json: bool, quiet: bool, verbose: int, **kwargs: Any) -> None:
            _configure_log(verbose)
            heed_no_settings()
            with stoppable() as heeded:
                try:
                    _run(lambda: heeded(function(**kwargs)), as_json, quiet, verbose)
                except Stopped as stop:
                    _fail("Stopped", str(stop), None, stop.exit_code, as_json, verbose)
                finally:
                    _take_back()

        for option in (
            click.option("-v", "--verbose", count=True, help="More detail; -vv adds tracebacks."),
            click.option(
                "-q", "--quiet", is_flag=True, help="No report and no progress; warnings, failures."
            ),
            click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout."),
        ):
            body = option(body)
        return click.command(name, **attrs)(body)

    return wrap


def _run(work: Callable[[], Report], as_json: bool, quiet: bool, verbose: int) -> None:
    started = time.perf_counter()
    try:
        now_utc()  # a SOURCE_DATE_EPOCH that is no time is refused before NumPy stumbles on it
        report = work()
    except VfplanError as error:
        _fail(error.kind, error.message, error.where, error.exit_code, as_json, verbose)
    except OSError as error:  # a device, a name or a folder that nobody foresaw
        reason = error.strerror or type(error).__name__
        _fail("OSError", reason, error.filename, 3, as_json, verbose)
    except MemoryError:
        _fail("MemoryError", "not enough memory for this input", None, 3, as_json, verbose)
    except (click.ClickException, click.Abort):
        raise
    except Exception as error:  # nobody foresaw it: still one line, never a traceback
        what = f"unforeseen {type(error).__name__}: {error} (-vv shows where; please report)"
        _fail(type(error).__name__, what, None, 3, as_json, verbose)
    try:
        _emit(report, time.perf_counter() - started, as_json, quiet)
    except OSError as error:
        what = f"cannot be written: {error.strerror}; no output file is kept"
        if not as_json:
            _silence(sys.stdout)
        _fail("OutputError", what, "the report", 2, as_json, verbose)
    _keep()
    sys.exit(report.exit_code)


def _configure_log(verbose: int) -> None:
    level = (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    logging.basicConfig(level=level, stream=sys.stderr, force=True)
    logging.getLogger().handlers[0].setFormatter(_Shown("vfplan: %(message)s"))


def _emit(report: Report, elapsed: float, as_json: bool, quiet: bool) -> None:
    for warning in report.warnings:
        click.echo(shown(f"vfplan: warning: {warning}"), err=True)
    if report.exit_code:
        words = " ".join((report.failed or "a check did not hold").split())
        click.echo(shown(f"vfplan: failed: {words}"), err=True)
    if as_json:
        name = click.get_current_context().info_name
        data = {"format": f"vfplan-{name}", "version": "1.0", **report.data}
        if report.warnings:
            data.setdefault("warnings", report.warnings)
        data.setdefault("elapsed_s", round(elapsed, 6))
        text = json.dumps(jsonable(data), indent=2, allow_nan=False)
        if sys.stdout is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        click.echo(text)
    elif not quiet:
        click.echo(shown(report.text))


def shown(text: str) -> str:
    """Text for a terminal: what would steer it or turn the writing round is spelled out.

    Names and labels come from files that others wrote.
    """
    return "".join(
        sign if sign == "\n" or category(sign) not in STEERING else ascii(sign)[1:-1]
        for sign in text
    )


class _Shown(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return shown(super().format(record))


def _fail(
    kind: str, message: str, where: str | None, code: int, as_json: bool, verbose: int
) -> None:
    if verbose >= 2:
        traceback.print_exc()
    line = f"{where}: {message}" if where else message
    texts = [(shown("vfplan: error: " + " ".join(line.split())), sys.stderr)]
    if as_json:
        error = {"kind": kind, "message": message, "where": where}
        texts.insert(0, (json.dumps({"error": error}, indent=2), sys.stdout))
    for text, stream in texts:
        try:
            click.echo(text, file=stream)
        except OSError:
            _silence(stream)
    sys.exit(code)


def _silence(stream: TextIO | None) -> None:
    """Let what is left in a stream that failed go nowhere, or it would fail again at the end."""
    if stream is None:
        return
    with suppress(OSError), open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def refuse_existing(*paths: Path | None, overwrite: bool) -> None:
    """Check every output path before any work is done.

    Raises `OutputError` when a path exists and `overwrite` is false, its folder is missing, it is
    no plain file, two outputs share it, of which only the last would remain, or it is also an input
    of this call: no `--overwrite` allows that.
    """
    inputs = _inputs(paths)
    seen: set[Path] = set()
    for path in paths:
        if path is None:
            continue
        if path.resolve() in seen:
            raise OutputError("is given for two outputs; each needs its own", where=str(path))
        seen.add(path.resolve())
        if path.resolve() in inputs:
            raise OutputError("is an input of this call; another name wanted", where=str(path))
        try:
            _refuse_place(path, overwrite)
        except OSError as error:  # a name too long, a folder that may not be looked into
            raise OutputError(error.strerror or str(error), where=str(path)) from None


def _refuse_place(path: Path, overwrite: bool) -> None:
    if path.exists() and not overwrite:
        raise OutputError("exists already; give --overwrite to replace it", where=str(path))
    if path.is_dir():
        raise OutputError("is a directory; a file is wanted", where=str(path))
    if path.exists() and not path.is_file():  # moving a file there would unmake a device
        raise OutputError("is a device or a pipe; a file is wanted", where=str(path))
    if not path.parent.is_dir():
        raise OutputError("its folder does not exist", where=str(path))


def _inputs(outputs: tuple[Path | None, ...]) -> set[Path]:
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
    # Writers make them anew (`vfplan.io.disk.create`): nothing is written through another's link.
    temporaries = tuple(p and beside(p, "".join(p.suffixes[-2:])[1:] or "tmp") for p in paths)
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
            _remember(move_whole(moves, overwrite=_overwrite()), folders.pop_all())
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
                temporary.unlink(missing_ok=True)


def _overwrite() -> bool:
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.params.get("overwrite"))


def _remember(placed: Placed, folders: ExitStack) -> None:
    """Keep what the running command wrote in mind until its report is out, its folders locked."""
    context = click.get_current_context(silent=True)
    if context is None:
        placed.keep()
        folders.close()
    else:
        context.meta.setdefault(PLACED, []).append((placed, folders))


class _TakenBack(Exception):  # noqa: N818 - tells a folder that was made to go again
    pass


def _keep() -> None:
    for placed, folders in click.get_current_context().meta.pop(PLACED, []):
        placed.keep()
        folders.close()


def _take_back() -> None:
    for placed, folders in reversed(click.get_current_context().meta.pop(PLACED, [])):
        with suppress(_TakenBack), folders:
            placed.undo()
            raise _TakenBack


def _silent() -> bool:
    """Whether progress is not shown: no terminal is there, or `-q` was given."""
    context = click.get_current_context(silent=True)
    return not sys.stderr.isatty() or (context is not None and bool(context.params.get("quiet")))


@contextmanager
def patience(doing: str, after_s: float = 1.0) -> Iterator[None]:
    """Say on a terminal what is being done when it takes longer than `after_s`; else nothing.

    For work that cannot tell how far it is; `progress` is for work that can.
    """
    if _silent():
        yield
        return
    timer = threading.Timer(after_s, lambda: click.echo(f"vfplan: {doing} ...", err=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def progress(label: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar on stderr for long work: shown on a terminal, silent in a pipe.

    Yields a function that takes the number of steps just done.
    """
    if _silent():
        yield lambda n: None
        return
    with click.progressbar(length=total, label=label, file=sys.stderr) as bar:
        yield bar.update
