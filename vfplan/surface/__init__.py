"""From a stack of outlined slices to a surface that a proxy can touch.

A leaf room: no other package imports it. Its command is `vfplan surface`.
"""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["Surface", "SurfaceSettings", "surface"]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: `vfplan surface --help` needs none of them."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.build"), name)
