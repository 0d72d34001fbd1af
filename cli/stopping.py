"""A command that is stopped by SIGINT, SIGTERM or SIGHUP cleans up first, as after an error.

Without this module Python would die of the last two at once and leave unfinished files. Python also
runs a signal handler between two of its own instructions only, so a signal just before a wait in C,
or one that the system hands to another thread, would count after the wait, however long. A thread
repeats the signal until the main thread has noticed it.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

REPEAT_S = 0.25
"""Seconds after which a signal is repeated while the main thread still waits in C."""

SAME_STOP_S = 1.0
"""Seconds in which a second signal counts as the same stop, so that it cannot cut the cleaning up
short. A later one counts again."""


class Stopped(BaseException):
    """Raised in the main thread by a signal; `exit_code` is the shell's 128 + number."""

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by {signal.Signals(number).name}; no output file is kept")
        self.exit_code = 128 + number


class _Stopper:
    """Raises `Stopped` on a signal, and remembers when."""

    def __init__(self) -> None:
        self.arrivals: list[tuple[float, int]] = []

    def handle(self, number: int, _frame: FrameType | None) -> None:
        now = time.monotonic()
        if self.arrivals and now - self.arrivals[-1][0] < SAME_STOP_S:
            return
        self.arrivals.append((now, number))
        raise Stopped(number)

    def has_missed(self, since: float) -> bool:
        """Whether the signal that arrived at this time was not handled yet."""
        return not self.arrivals or since - self.arrivals[-1][0] >= SAME_STOP_S

    def raise_if_stopped(self) -> None:
        """Raise once more: Python drops what is raised while a destructor runs."""
        if self.arrivals:
            raise Stopped(self.arrivals[0][1])


@contextmanager
def stoppable() -> Iterator[Callable[[], None]]:
    """Raise `Stopped` on a signal inside; one that is ignored, as by nohup, stays so.

    Yields a function that raises again if there was a signal.
    """
    stopper = _Stopper()
    if threading.current_thread() is not threading.main_thread():
        yield stopper.raise_if_stopped
        return
    before = {}
    for number in SIGNALS:
        handler = signal.getsignal(number)
        if handler in (signal.SIG_DFL, signal.default_int_handler):
            before[number] = handler
            signal.signal(number, stopper.handle)
    try:
        with _repeated_signals(stopper):
            yield stopper.raise_if_stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _repeated_signals(stopper: _Stopper) -> Iterator[None]:
    """Interrupt the main thread, whatever it waits in, until `stopper` has handled the signal.

    Python writes to the wakeup descriptor in the very moment in which a signal arrives.
    """
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    before = signal.set_wakeup_fd(write_end, warn_on_full_buffer=False)
    main = threading.get_ident()
    is_over = threading.Event()

    def repeat() -> None:
        with open(read_end, "rb", 0) as pipe:
            while True:
                arrival = pipe.read(1)
                if not arrival:
                    return
                number = arrival[0]
                since = time.monotonic()
                if signal.getsignal(number) != stopper.handle:
                    # The command handles this signal in a manner of its own.
                    continue
                while stopper.has_missed(since) and not is_over.wait(REPEAT_S):
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
    arrivals: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        arrivals.append(number)

    before = {}
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            before[number] = signal.signal(number, note)
    try:
        yield lambda: bool(arrivals)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
