"""vfplan: turn a surgeon's drawing into a virtual fixture a robot can trust.

Names are loaded when they are first used, so that `import vfplan` stays cheap: it loads none of
OpenCV, scikit-image, SciPy, Matplotlib, PyVista or h5py.
"""

from __future__ import annotations

import importlib
import sys
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from vfplan.errors import VfplanError


def _folder() -> str:
    """Where the package is; in a clone's root, whose source shadows it, the installed one."""
    here = Path(__file__).parent
    if not list(here.glob("_core.*")):
        found = PathFinder.find_spec(
            "vfplan", [p for p in sys.path if Path(p).resolve() != here.parent]
        )
        if found is not None and found.submodule_search_locations:
            return found.submodule_search_locations[0]
    return str(here)


__path__ = [_folder()]

# module -> the public names that it defines
_DEFINED = {
    "bundle": "read_fixture write_fixture",
    "curve": "Extraction extract_curve",
    "engine.governor": "Governor GovernorStatus",
    "engine.guide": "Guide GuideStep GuideTrace",
    "engine.moving": "MovingFrame",
    "engine.parameters": "ProxyParameters",
    "engine.proxy": "ProxyEngine",
    "engine.ticks": "Status Step Trace",
    "images.read": "PlannedImage read_image",
    "markers": "Correspondences read_markers",
    "planning": "ExtractSettings FixtureSettings extract plan register",
    "planning.tolerance": "sample_curve",
    "registration": "Registration fit_registration",
    "replaying": "Replay replay",
    "robot": "Robot read_robot",
    "session": "Session read_result read_session write_result",
}
_LAZY = {name: f"vfplan.{home}" for home, names in _DEFINED.items() for name in names.split()}
# public name -> the module that it is
_MODULES: dict[str, str] = {
    "markers": "vfplan.markers",
    "reference": "vfplan.reference",
    "registration": "vfplan.registration",
    "scenes": "vfplan.scenes",
}

__all__ = ["VfplanError", "__version__", "cmake_dir", *_LAZY, *_MODULES]


def cmake_dir() -> Path:
    """The folder to give CMake, as `vfplan_DIR` or in `CMAKE_PREFIX_PATH`."""
    return Path(__path__[0]) / "share" / "cmake" / "vfplan"


def __getattr__(name: str) -> Any:
    value = globals()[name] = _made(name)  # asked for once
    return value


def _made(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("vfplan")
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    if name in _MODULES:
        return importlib.import_module(_MODULES[name])
    if name == "_core" and not list(Path(__path__[0]).glob("_core.*")):
        raise ImportError(
            f"vfplan's compiled part is not in {__path__[0]}: that is the source tree, "
            "and the package is not installed (make install)"
        )
    raise AttributeError(f"module 'vfplan' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
