"""A command that is told to stop (SIGINT, SIGTERM, SIGHUP) cleans up first, as after an error.

Left alone, Python dies of the last two at once and its unfinished files stay. And its handler runs
between two of Python's own instructions: a signal just before a wait in C, or one that the system
hands to another thread, would be heeded after the wait, however long. A thread sees to that.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
AGAIN_S = 0.25  # so long a wait may stand before it is interrupted once more
# A second signal so soon would cut the cleaning up short; a later one counts again.
PATIENCE_S = 1.0
Result = TypeVar("Result")


class Stopped(BaseException):
    """Raised in the main thread where a signal arrives; `exit_code` is the shell's 128 + number."""

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by {signal.Signals(number).name}; no output file is kept")
        self.exit_code = 128 + number


@contextmanager
def stoppable() -> Iterator[Callable[[Result], Result]]:
    """Raise `Stopped` on a signal inside; one that is ignored, as by nohup, stays so.

    Yields a function that hands its argument back, or raises again if there was a signal: Python
    drops what is raised while a destructor runs.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda result: result
        return
    before = {number: signal.getsignal(number) for number in SIGNALS}
    taken = [n for n in SIGNALS if before[n] in (signal.SIG_DFL, signal.default_int_handler)]
    came: list[tuple[float, int]] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        now = time.monotonic()
        if came and now - came[-1][0] < PATIENCE_S:
            return
        came.append((now, number))
        raise Stopped(number)

    def unheard(since: float) -> bool:
        return not came or since - came[-1][0] >= PATIENCE_S

    def heeded(result: Result) -> Result:
        if came:
            raise Stopped(came[0][1])
        return result

    for number in taken:
        signal.signal(number, stop)
    try:
        with _insistent(stop, unheard):
            yield heeded
    finally:
        for number in taken:
            signal.signal(number, before[number])


@contextmanager
def _insistent(
    stop: Callable[[int, FrameType | None], None], unheard: Callable[[float], bool]
) -> Iterator[None]:
    """Interrupt whatever the main thread waits in, until `stop` has heard the signal that came.

    Python's wakeup descriptor is written to in the very moment a signal comes.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    main, over = threading.get_ident(), threading.Event()

    def insist() -> None:
        with open(reading, "rb", 0) as pipe:
            while came := pipe.read(1):
                since = time.monotonic()
                if signal.getsignal(came[0]) is not stop:  # a command takes it in its own way
                    continue
                while unheard(since) and not over.wait(AGAIN_S):
                    signal.pthread_kill(main, came[0])

    thread = threading.Thread(target=insist, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        signal.set_wakeup_fd(before)
        os.close(writing)
        thread.join()


@contextmanager
def noted_signals() -> Iterator[Callable[[], bool]]:
    """Take the signals of stopping as an ordinary end; yields whether one came.

    One that is ignored, as by nohup, stays so.
    """
    came: list[int] = []
    numbers = [number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    before = {}
    for number in numbers:
        before[number] = signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
