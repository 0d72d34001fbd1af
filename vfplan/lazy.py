"""Names of a package that are imported when they are first used, so that importing it is cheap."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from typing import Any


def on_demand(package: str, defined: dict[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a package.

    package: its name
    defined: of each module of the package the names that it defines, separated by blanks
    """
    home = {}
    for module, names in defined.items():
        for name in names.split():
            home[name] = module

    def get(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(f"{package}.{home[name]}")
        # All names of the module at once: importing it sets its own name in the package, which one
        # of its functions may bear, as `vfplan.stability.gate` does.
        for other in defined[home[name]].split():
            setattr(sys.modules[package], other, getattr(module, other))
        return getattr(module, name)

    return get
