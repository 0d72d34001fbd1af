"""Processes for long work, isolated from the current folder, that end with the program's work."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from typing import Any

SAFE_PATH = "PYTHONSAFEPATH"


@contextmanager
def workers(
    count: int, initializer: Callable[..., None] | None = None, *args: Any
) -> Iterator[ProcessPoolExecutor]:
    """A pool of `count` processes, each of which first calls `initializer(*args)`.

    They import nothing from the current folder. An exception in the block, and thus a signal, ends
    them at once, whatever they are at.
    """
    others, before = set(active_children()), os.environ.get(SAFE_PATH)
    # multiprocessing starts Python by -c, which would look for modules where the program stands.
    os.environ[SAFE_PATH] = "1"
    # spawn: a forked copy of a process with threads may hang.
    pool = ProcessPoolExecutor(count, get_context("spawn"), _begin, (initializer, *args))
    try:
        yield pool
    except BaseException:
        for child in set(active_children()) - others:
            child.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


def _begin(initializer: Callable[..., None] | None, *args: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches them too; the program decides
    _end_with_parent()
    if initializer is not None:
        initializer(*args)


def _end_with_parent() -> None:
    """Let the system end this process with the program's, were it by a signal that none can take.

    Linux only (prctl's PR_SET_PDEATHSIG); elsewhere a killed program leaves its workers waiting.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
