"""Matplotlib without anybody's settings, for commands.

When it is first imported, Matplotlib reads a `matplotlibrc` of the current folder, or one that the
environment or the user has. Without this module pictures would differ, or fail, with the folder in
which a command is called.
"""

from __future__ import annotations

import os
import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any


class DefaultMatplotlib:
    """A finder of modules that starts Matplotlib in the folder of its own defaults."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """The usual spec of `matplotlib`; `None` for any other module."""
        if name != "matplotlib":
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is None or spec.loader is None or spec.origin is None:
            return None
        run_module = spec.loader.exec_module
        defaults = Path(spec.origin).parent / "mpl-data"

        def run_in_defaults(module: Any) -> None:
            # Matplotlib looks into the current folder first, so that folder is its own for a while.
            before = os.open(os.curdir, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            try:
                os.chdir(defaults)
                run_module(module)
            finally:
                os.fchdir(before)
                os.close(before)

        spec.loader.exec_module = run_in_defaults  # type: ignore[method-assign]
        return spec


def ignore_matplotlib_settings() -> None:
    """Let Matplotlib, if it is not imported yet, start without settings of a user or a folder."""
    if DefaultMatplotlib not in sys.meta_path:
        sys.meta_path.insert(0, DefaultMatplotlib)
