"""What every command shares at run time: output, errors, exit codes, progress.

A command's body computes and returns a `Report`; this module prints it. The rules (one JSON
document on stdout and nothing else, one line on stderr for an error, no file left behind) hold for
every command because they are written once, here.
"""

from __future__ import annotations

import errno
import functools
import json
import os
import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO
from unicodedata import category

import click
from vfplan.cli.outputs import keep, refuse_outputs, take_back
from vfplan.cli.paged_help import PagedCommand
from vfplan.cli.plain import heed_no_settings
from vfplan.cli.settings_file import with_settings_of
from vfplan.cli.stopping import Stopped, stoppable
from vfplan.cli.values import FILE

from vfplan.errors import VfplanError
from vfplan.findings import Finding
from vfplan.io.files import now_utc
from vfplan.io.json_types import to_json_types

SETTINGS = click.option(
    "--settings", "settings_file", type=FILE, metavar="FILE.json",
    help="Options from a file: the fields of ExtractSettings and FixtureSettings, in their units. "
    "What is typed wins.",
)  # fmt: skip
# Unicode's kinds of signs that are not to be seen: controls, directions, halves, unknown ones.
STEERING = ("Cc", "Cf", "Cs", "Co", "Cn")


@dataclass(frozen=True)
class Report:
    """What a command found: `data` for `--json`, `text` for a person, `exit_code` for a script.

    `failed` says in a line what check did not hold; the exit code is then 1, if no other is given.
    `verdict` says in a line how it ended, `next_step` what to do now: the text ends with both, and
    JSON holds them as `verdict` and `next` unless `data` has a `verdict` of its own.
    `findings` are what a person should look at before the result is used; `warnings` are sentences
    about the call itself that need no answer.
    """

    data: dict[str, Any]
    text: str = ""
    exit_code: int = 0
    warnings: list[str] = field(default_factory=list)
    failed: str = ""
    findings: Sequence[Finding] | None = None  # None where the command looks for none
    verdict: str = ""
    next_step: str = ""

    def __post_init__(self) -> None:
        """A check that failed is exit code 1."""
        if self.failed and not self.exit_code:
            object.__setattr__(self, "exit_code", 1)


def command_line() -> str:
    """The running command as it was typed."""
    return shlex.join(["vfplan", *sys.argv[1:]])


def command(
    name: str, *, first_screen: str = "", settings_file: bool = False, **attrs: Any
) -> Callable[[Callable[..., Report]], click.Command]:
    """A click command whose function returns a `Report`.

    Its parameters are the options and arguments above it, which say what each may be. Adds
    `--json`, `-q` and `-v`, times the call (`elapsed_s`), and turns every `VfplanError` into
    one line and its exit code. What the command is to write is checked before it is called, and
    `--overwrite` is heeded by `vfplan.cli.outputs`: the function does not get it.

    first_screen: the options that `--help` lists, apart by blanks; `--help-all` lists all. Without
        it `--help` lists all.
    settings_file: whether options may come from a file, `--settings FILE.json`
    """

    def wrap(function: Callable[..., Report]) -> click.Command:
        @functools.wraps(function)
        def body(as_json: bool, quiet: bool, verbose: int, **kwargs: Any) -> None:
            _configure_log(verbose)
            heed_no_settings()
            kwargs.pop("overwrite", None)
            settings = kwargs.pop("settings_file", None)

            def work() -> Report:
                return function(**with_settings_of(settings, kwargs))

            with stoppable() as heeded:
                try:
                    _run(lambda: heeded(work()), as_json, quiet, verbose)
                except Stopped as stop:
                    _fail("Stopped", str(stop), None, stop.exit_code, as_json, verbose)
                finally:
                    take_back()

        for option in (
            click.option("-v", "--verbose", count=True, help="More detail; -vv adds tracebacks."),
            click.option(
                "-q", "--quiet", is_flag=True, help="No report and no progress; warnings, failures."
            ),
            click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout."),
        ):
            body = option(body)
        if settings_file:
            body = SETTINGS(body)
        return click.command(name, cls=PagedCommand, first_screen=first_screen.split(), **attrs)(
            body
        )

    return wrap


def _run(work: Callable[[], Report], as_json: bool, quiet: bool, verbose: int) -> None:
    started = time.perf_counter()
    try:
        now_utc()  # a SOURCE_DATE_EPOCH that is no time is refused before NumPy stumbles on it
        refuse_outputs()
        report = work()
    except VfplanError as error:
        _fail(
            error.kind,
            error.message,
            error.where,
            error.exit_code,
            as_json,
            verbose,
            code=error.code,
            numbers=error.numbers,
        )
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
    keep()
    sys.exit(report.exit_code)


def _configure_log(verbose: int) -> None:
    import logging

    class Printable(logging.Formatter):
        def format(self, record: logging.LogRecord) -> str:
            return shown(super().format(record))

    level = (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    logging.basicConfig(level=level, stream=sys.stderr, force=True)
    logging.getLogger().handlers[0].setFormatter(Printable("vfplan: %(message)s"))


def _emit(report: Report, elapsed: float, as_json: bool, quiet: bool) -> None:
    findings = report.findings or ()
    for finding in findings:
        word = "warning" if finding.severity == "doubt" else "note"
        click.echo(shown(f"vfplan: {word}: {finding.text}"), err=True)
    for warning in report.warnings:
        click.echo(shown(f"vfplan: warning: {warning}"), err=True)
    if report.exit_code:
        words = " ".join((report.failed or "a check did not hold").split())
        click.echo(shown(f"vfplan: failed: {words}"), err=True)
    if as_json:
        name = click.get_current_context().info_name
        data = {"format": f"vfplan-{name}", "version": "1.0", **report.data}
        warnings = [finding.text for finding in findings] + list(report.warnings)
        if warnings:
            data.setdefault("warnings", warnings)
        if report.findings is not None:
            data.setdefault("findings", [finding.as_dict() for finding in findings])
        if report.verdict:
            data.setdefault("verdict", report.verdict)
            data.setdefault("next", report.next_step)
        data.setdefault("elapsed_s", round(elapsed, 6))
        text = json.dumps(to_json_types(data), indent=2, allow_nan=False)
        if sys.stdout is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        click.echo(text)
    elif not quiet:
        click.echo(shown(report.text + last_lines(report)))


def last_lines(report: Report) -> str:
    """The last two lines of a command's text: how it ended, and what to do next."""
    text = ""
    if report.verdict:
        text += f"\nverdict: {report.verdict}"
    if report.next_step:
        text += f"\nnext: {report.next_step}"
    return text


def shown(text: str) -> str:
    """Text for a terminal: what would steer it or turn the writing round is spelled out.

    Names and labels come from files that others wrote.
    """
    return "".join(
        sign if sign == "\n" or category(sign) not in STEERING else ascii(sign)[1:-1]
        for sign in text
    )


def _fail(
    kind: str,
    message: str,
    where: str | None,
    exit_code: int,
    as_json: bool,
    verbose: int,
    *,
    code: str | None = None,
    numbers: dict[str, Any] | None = None,
) -> None:
    if verbose >= 2:
        import traceback

        traceback.print_exc()
    line = f"{where}: {message}" if where else message
    texts = [(shown("vfplan: error: " + " ".join(line.split())), sys.stderr)]
    if as_json:
        error: dict[str, Any] = {"kind": kind, "message": message, "where": where}
        if code is not None:
            error |= {"code": code, "numbers": to_json_types(numbers or {})}
        texts.insert(0, (json.dumps({"error": error}, indent=2), sys.stdout))
    for text, stream in texts:
        try:
            click.echo(text, file=stream)
        except OSError:
            _silence(stream)
    sys.exit(exit_code)


def _silence(stream: TextIO | None) -> None:
    """Let what is left in a stream that failed go nowhere, or it would fail again at the end."""
    if stream is None:
        return
    with suppress(OSError), open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


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


def rough_ticks(session: Path) -> int:
    """About how many ticks a session file of text holds: enough for a progress bar."""
    return max(1, session.stat().st_size // 40)


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
