"""Matplotlib without anybody's settings, for commands.

When it is first imported, Matplotlib reads a `matplotlibrc` of the current folder, or one that the
environment or the user has: pictures would differ, or fail, by where a command is called.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any


class PlainMatplotlib:
    """A finder of modules that lets Matplotlib start in the folder of its own defaults."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """The usual spec of `matplotlib`; `None` for any other module."""
        spec = PathFinder.find_spec(name, path, target) if name == "matplotlib" else None
        if spec is None or spec.loader is None or spec.origin is None:
            return None
        run, defaults = spec.loader.exec_module, Path(spec.origin).parent / "mpl-data"

        def run_there(module: Any) -> None:
            with _standing_in(defaults):  # whose matplotlibrc is the one that is looked for first
                run(module)

        spec.loader.exec_module = run_there  # type: ignore[method-assign]
        return spec


@contextmanager
def _standing_in(folder: Path) -> Iterator[None]:
    here = os.open(os.curdir, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.chdir(folder)
        yield
    finally:
        os.fchdir(here)
        os.close(here)


def heed_no_settings() -> None:
    """Let Matplotlib, if it is not there yet, start without settings."""
    if PlainMatplotlib not in sys.meta_path:
        sys.meta_path.insert(0, PlainMatplotlib)
