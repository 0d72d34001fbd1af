"""What every command shares: its help, its output, its errors, its progress, and how it is stopped.

A command's function computes and returns a `CommandResult`, and this module prints it: one JSON
document on stdout and nothing else, or text, and one line on stderr for an error.

SIGINT, SIGTERM and SIGHUP end a command as an error does, so that it cleans up first. Python runs a
signal handler between two of its own instructions only. A signal just before a wait in C, or one
that the system hands to another thread, would count after the wait, however long. So a thread
repeats it until the main thread has noticed it.
"""

from __future__ import annotations

import errno
import functools
import json
import logging
import os
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, TextIO
from unicodedata import category

import click
from vfplan.cli.options import FILE, option, options_in_order, settings_of_file
from vfplan.cli.outputs import RAISE_IF_STOPPED, refuse_outputs

from vfplan.display import Advance, Report
from vfplan.errors import VfplanError
from vfplan.findings import Finding
from vfplan.io.files import now_utc, to_json_types

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)

# Seconds after which a signal is repeated while the main thread still waits in C.
REPEAT_S = 0.25

# Seconds in which a second signal counts as the same stop, so that it cannot cut the cleaning up
# short. A later one counts again.
SAME_STOP_S = 1.0


class Stopped(BaseException):
    """Raised in the main thread by a signal; `exit_code` is the shell's 128 + number."""

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by {signal.Signals(number).name}; no output file is kept")
        self.exit_code = 128 + number


@contextmanager
def stoppable() -> Iterator[Callable[[], None]]:
    """Raise `Stopped` on a signal inside; one that is ignored, as by nohup, stays so.

    Yields a function that raises once more if there was a signal: Python drops what is raised while
    a destructor runs.
    """
    arrivals = []

    def stop(number: int, _frame: FrameType | None) -> None:
        now = time.monotonic()
        if not arrivals or now - arrivals[-1][0] >= SAME_STOP_S:
            arrivals.append((now, number))
            raise Stopped(number)

    def raise_if_stopped() -> None:
        if arrivals:
            raise Stopped(arrivals[0][1])

    if threading.current_thread() is not threading.main_thread():
        yield raise_if_stopped
        return
    usual = (signal.SIG_DFL, signal.default_int_handler)
    heard = [number for number in SIGNALS if signal.getsignal(number) in usual]
    with ExitStack() as handled:
        handled.enter_context(_handled_by(stop, heard))
        if hasattr(signal, "pthread_kill"):
            handled.enter_context(_repeated_signals(stop, arrivals))
        yield raise_if_stopped


@contextmanager
def _handled_by(handler: Callable[[int, FrameType | None], None], numbers: list) -> Iterator[None]:
    """Handle these signals inside."""
    before = [(number, signal.signal(number, handler)) for number in numbers]
    try:
        yield
    finally:
        for number, handler_before in before:
            signal.signal(number, handler_before)


@contextmanager
def _repeated_signals(
    stop: Callable[..., None], arrivals: list[tuple[float, int]]
) -> Iterator[None]:
    """Interrupt the main thread, whatever it waits in, until `stop` has noted the signal.

    Python writes to the wakeup descriptor in the very moment in which a signal arrives.
    """
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    before = signal.set_wakeup_fd(write_end, warn_on_full_buffer=False)
    main = threading.get_ident()
    is_over = threading.Event()

    def repeat() -> None:
        with open(read_end, "rb", 0) as pipe:
            while arrival := pipe.read(1):
                number = arrival[0]
                since = time.monotonic()
                if signal.getsignal(number) is not stop:
                    # The command handles this signal in a manner of its own.
                    continue
                while not arrivals or since - arrivals[-1][0] >= SAME_STOP_S:
                    if is_over.wait(REPEAT_S):
                        return
                    signal.pthread_kill(main, number)

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        signal.set_wakeup_fd(before)
        os.close(write_end)
        thread.join()


@contextmanager
def noted_signals() -> Iterator[Callable[[], bool]]:
    """Take the signals of stopping as an ordinary end; yields whether one arrived.

    A signal that is ignored, as by nohup, stays so.
    """
    arrivals = []
    heard = [number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    with _handled_by(lambda number, _frame: arrivals.append(number), heard):
        yield lambda: bool(arrivals)


# Under this key in click's context: whether the help lists every option.
SHOW_ALL = "vfplan.cli.show_all"


class PagedCommand(click.Command):
    """A click command whose `--help` lists the options of the first screen.

    Parameters
    ----------
    first_screen
        Their names as they are typed, as "--rule". Without names all options are listed.
    """

    def __init__(self, *args: Any, first_screen: Sequence[str] = (), **more: Any) -> None:
        super().__init__(*args, **more)
        self.first_screen = tuple(first_screen)
        self.params.append(click.Option(
            ["--help-all"], is_flag=True, is_eager=True, expose_value=False,
            callback=print_whole_help, help="Show every option.", hidden=not self.first_screen,
        ))  # fmt: skip
        unknown = set(first_screen) - {word for param in self.params for word in param.opts}
        assert not unknown, f"{self.name} has no option {unknown}"

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the options of the first screen, or every one."""
        listed = {"--help", "--help-all", *self.first_screen}
        is_whole = ctx.meta.get(SHOW_ALL) or not self.first_screen
        options = [param for param in self.get_params(ctx) if isinstance(param, click.Option)]
        records = [(option, option.get_help_record(ctx)) for option in options if not option.hidden]
        visible = [record for option, record in records if is_whole or listed & set(option.opts)]
        if visible:
            with formatter.section("Options"):
                formatter.write_dl(visible)
        if hidden_count := len(records) - len(visible):
            formatter.write_paragraph()
            formatter.write_text(f"{hidden_count} more options: {ctx.command_path} --help-all")


def print_whole_help(ctx: click.Context, option: click.Parameter, is_wanted: bool) -> None:
    """Print the help with every option, and end the command."""
    if is_wanted:
        ctx.meta[SHOW_ALL] = True
        click.echo(ctx.get_help(), color=ctx.color)
        ctx.exit()


# Unicode's categories of characters without a shape: controls, directions, surrogates, unknown.
INVISIBLE_CATEGORIES = ("Cc", "Cf", "Cs", "Co", "Cn")

# The level of the log for no `-v`, one and two.
LOG_LEVELS = (logging.WARNING, logging.INFO, logging.DEBUG)


@dataclass(frozen=True)
class CommandResult:
    """The result of a command: `data` for `--json`, `text` for a person, `exit_code` for a script.

    Parameters
    ----------
    failed
        The check that did not hold, in one line. The exit code is then 1 unless another is set.
    verdict, next_step
        How the command ended and what to do now, one line each. The text ends with both, and JSON
        holds them as `verdict` and `next` unless `data` has a `verdict` of its own.
    verdict_in_json
        Whether JSON holds verdict and next step. `info` prints a file's own names and no others.
    findings
        What a person should look at before the result is used. `None`: the command looks for none.
    warnings
        Sentences about the call itself, which need no answer.
    """

    data: Report
    text: str = ""
    exit_code: int = 0
    warnings: list[str] = field(default_factory=list)
    failed: str = ""
    findings: Sequence[Finding] | None = None
    verdict: str = field(kw_only=True)
    next_step: str = field(kw_only=True)
    verdict_in_json: bool = True

    def __post_init__(self) -> None:
        """Set exit code 1 where a check failed."""
        if self.failed and not self.exit_code:
            object.__setattr__(self, "exit_code", 1)


def statistics(report: Report, place: str = "") -> Iterator[str]:
    """What a report holds, a line for each name that `--json` has, and for each record."""
    for name, value in report.items():
        if isinstance(value, dict):
            yield from statistics(value, f"{place}{name}.")
        elif isinstance(value, list) and any(isinstance(part, dict) for part in value):
            yield from (f"  {place}{name}[{i}] = {json.dumps(one)}" for i, one in enumerate(value))
        else:
            shown = f"{value:z.9g}" if isinstance(value, float) else json.dumps(value)
            yield f"  {place}{name} = {shown}"


@dataclass(frozen=True)
class Printer:
    """Prints the result of a command, or the failure that ended it."""

    as_json: bool
    quiet: bool
    verbose: int

    def print_result(self, result: CommandResult, elapsed_s: float) -> None:
        """Print findings and warnings to stderr, then the result to stdout.

        Raises
        ------
        OSError
            Stdout takes no more, as on a full disk.
        """
        # A person reads the findings first, in the log.
        labelled = [
            ("warning" if finding.is_open else "note", finding.text)
            for finding in result.findings or ()
        ]
        labelled += [("warning", warning) for warning in result.warnings]
        for word, text in labelled:
            click.echo(printable(f"vfplan: {word}: {text}"), err=True)
        if result.exit_code:
            click.echo(printable(f"vfplan: failed: {' '.join(result.failed.split())}"), err=True)

        # The result itself is the only thing on stdout.
        name = click.get_current_context().info_name
        data = {"format": f"vfplan-{name}", "version": "1.0", **result.data}
        if labelled:
            data.setdefault("warnings", [text for _, text in labelled])
        if result.findings is not None:
            data.setdefault("findings", [finding.as_dict() for finding in result.findings])
        if result.verdict and result.verdict_in_json:
            data.setdefault("verdict", result.verdict)
            data.setdefault("next", result.next_step)
        data = to_json_types(data | {"elapsed_s": data.get("elapsed_s", round(elapsed_s, 6))})
        if self.as_json:
            text = json.dumps(data, indent=2, allow_nan=False)
            if sys.stdout is None:
                raise OSError(errno.EBADF, os.strerror(errno.EBADF))
            click.echo(text)
        elif not self.quiet:
            lines = [result.text, *(statistics(data) if self.verbose else ())]
            lines.append(f"verdict: {result.verdict}" if result.verdict else "")
            lines.append(f"next: {result.next_step}" if result.next_step else "")
            click.echo(printable("\n".join(filter(None, lines))))

    def exit_with(
        self, kind: str, message: str, where: str | None, exit_code: int, **more: Any
    ) -> NoReturn:
        """Print a failure: one line on stderr, and with `--json` a document on stdout."""
        if self.verbose >= 2:
            import traceback

            traceback.print_exc()
        if self.as_json:
            error = {"kind": kind, "message": message, "where": where, **more}
            echo_if_possible(json.dumps({"error": error}, indent=2), sys.stdout)
        line = f"{where}: {message}" if where else message
        echo_if_possible(printable("vfplan: error: " + " ".join(line.split())), sys.stderr)
        sys.exit(exit_code)

    def exit_with_error(self, error: Exception) -> NoReturn:
        """Print an exception as a failure."""
        kind, where = type(error).__name__, None
        if isinstance(error, VfplanError):
            self.exit_with(
                kind, error.message, error.where, error.exit_code, code=error.code,
                numbers=to_json_types(error.numbers),
            )  # fmt: skip
        message = f"unforeseen {kind}: {error} (-vv shows where; please report)"
        if isinstance(error, OSError):
            # A device, a name or a folder that nobody foresaw.
            kind, message, where = "OSError", error.strerror or kind, error.filename
        elif isinstance(error, MemoryError):
            message = "not enough memory for this input"
        self.exit_with(kind, message, where, 3)


# Options of every command, but for the first one, which only some have.
COMMON_OPTIONS = (
    option("--settings", "settings_file", type=FILE, metavar="FILE.json",
           help="Take options from a file, or from its text: fields of ExtractSettings and "
           "FixtureSettings in their units; a typed option wins."),
    option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout."),
    option("-q", "--quiet", is_flag=True, help="Print warnings and failures only."),
    option("-v", "--verbose", count=True,
           help="Print all of the report too; -vv adds the traceback of an error."),
)  # fmt: skip


def command_line(*, overwrite: bool = False) -> str:
    """The running command as it was typed; `overwrite`: to be given again over its own files."""
    words = ["vfplan", *sys.argv[1:]]
    if overwrite and "--overwrite" not in words:
        words.append("--overwrite")
    return shlex.join(words)


def command(
    name: str, *, first_screen: str = "", settings_file: bool = False, **attributes: Any
) -> Callable[[Callable[..., CommandResult]], click.Command]:
    """A click command whose function returns a `CommandResult`.

    Adds `--json`, `-q` and `-v`, times the call (`elapsed_s`), and turns every `VfplanError` into
    one line and its exit code. The files that the command is to write are checked before its
    function is called. `vfplan.cli.outputs` acts on `--overwrite`: the function does not get it.

    Parameters
    ----------
    first_screen
        The options that `--help` lists, separated by blanks; `--help-all` lists all. Without it
        `--help` lists all.
    settings_file
        Whether options may come from a file, `--settings FILE.json`.
    """

    def wrap(function: Callable[..., CommandResult]) -> click.Command:
        @functools.wraps(function)
        def body(as_json: bool, quiet: bool, verbose: int, **arguments: Any) -> None:
            logging.basicConfig(level=LOG_LEVELS[min(verbose, 2)], stream=sys.stderr, force=True)
            logging.getLogger().handlers[0].setFormatter(_PrintableLines("vfplan: %(message)s"))
            arguments.pop("overwrite", None)
            path = arguments.pop("settings_file", None)
            printer = Printer(as_json, quiet, verbose)
            with stoppable() as raise_if_stopped:
                click.get_current_context().meta[RAISE_IF_STOPPED] = raise_if_stopped
                try:
                    started = time.perf_counter()
                    try:
                        # NumPy would stumble on a SOURCE_DATE_EPOCH that is no time.
                        now_utc()
                        refuse_outputs()
                        if path is not None:
                            arguments["from_file"] = settings_of_file(path)
                        result = function(**arguments)
                        raise_if_stopped()
                    except (click.ClickException, click.Abort):
                        raise
                    except Exception as error:
                        printer.exit_with_error(error)
                    try:
                        printer.print_result(result, time.perf_counter() - started)
                    except OSError as error:
                        if not as_json:
                            silence(sys.stdout)
                        what = f"cannot be written: {error.strerror}. Check where it goes"
                        printer.exit_with("OutputError", what, "the report", 2)
                    sys.exit(result.exit_code)
                except Stopped as stop:
                    printer.exit_with("Stopped", str(stop), None, stop.exit_code)

        body = options_in_order(*COMMON_OPTIONS[not settings_file :])(body)
        listed = first_screen.split()
        return click.command(name, cls=PagedCommand, first_screen=listed, **attributes)(body)

    return wrap


class _PrintableLines(logging.Formatter):
    """Log lines as `printable` leaves them."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


def printable(text: str) -> str:
    """Text for a terminal, in which characters that would steer it are spelled out.

    Names and labels come from files that others wrote.
    """
    for sign in set(text) - {"\n"}:
        if category(sign) in INVISIBLE_CATEGORIES:
            text = text.replace(sign, ascii(sign)[1:-1])
    return text


def echo_if_possible(text: str, stream: TextIO | None) -> None:
    """Print a line; where the stream takes none, print nothing there from now on."""
    try:
        click.echo(text, file=stream)
    except OSError:
        silence(stream)


def silence(stream: TextIO | None) -> None:
    """Send the rest of a stream that failed to nowhere, or it would fail again at the exit."""
    if stream is None:
        return
    with suppress(OSError), open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def shows_progress() -> bool:
    """Whether progress is shown: stderr is a terminal, and there is no `-q`."""
    context = click.get_current_context(silent=True)
    is_quiet = context is not None and context.params.get("quiet")
    return not is_quiet and sys.stderr.isatty()


@contextmanager
def announce_if_slow(work: str, after_s: float = 1.0) -> Iterator[None]:
    """Name the work on a terminal when it takes longer than `after_s`.

    For work that cannot count its steps; `progress` is for work that can.
    """
    if not shows_progress():
        yield
        return
    timer = threading.Timer(after_s, lambda: click.echo(f"vfplan: {work} ...", err=True))
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
def progress(label: str, total: int) -> Iterator[Advance]:
    """A bar on stderr for long work: visible on a terminal, silent in a pipe.

    Yields a function that takes the number of steps just done.
    """
    if not shows_progress():
        yield lambda steps: None
        return
    with click.progressbar(length=total, label=label, file=sys.stderr) as bar:
        yield bar.update
