"""Worker processes for long work, isolated from the current folder, that end with the program."""

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
def worker_processes(
    count: int, initializer: Callable[..., None] | None = None, *args: Any
) -> Iterator[ProcessPoolExecutor]:
    """A pool of `count` processes, each of which first calls `initializer(*args)`.

    They import nothing from the current folder. An exception in the block, and thus a signal, ends
    them at once, whatever they do.
    """
    others = set(active_children())
    safe_path_before = os.environ.get(SAFE_PATH)
    # Python is started by -c, which would look for modules in the current folder.
    os.environ[SAFE_PATH] = "1"
    # "spawn", because a forked copy of a process with threads may hang.
    pool = ProcessPoolExecutor(count, get_context("spawn"), begin_worker, (initializer, *args))
    try:
        yield pool
    except BaseException:
        for child in set(active_children()) - others:
            child.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        if safe_path_before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = safe_path_before


def begin_worker(initializer: Callable[..., None] | None, *args: Any) -> None:
    """Prepare a worker: its signals, its end with the program, and what the caller wants."""
    # Ctrl-C reaches the workers too, but the program alone decides what ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # On Linux the system ends this process when the program ends, also by SIGKILL (prctl's
    # PR_SET_PDEATHSIG). Elsewhere a killed program leaves its workers waiting.
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    if initializer is not None:
        initializer(*args)
