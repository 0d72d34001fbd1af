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

# The package's own folder. In a clone's root, whose source shadows the installed package and has no
# compiled part, the installed one.
_source = Path(__file__).parent
__path__ = [str(_source)]
if not list(_source.glob("_core.*")):
    _elsewhere = [entry for entry in sys.path if Path(entry).resolve() != _source.parent]
    _spec = PathFinder.find_spec("vfplan", _elsewhere)
    if _spec is not None and _spec.submodule_search_locations:
        __path__ = [_spec.submodule_search_locations[0]]

# Module -> the public names that it defines
_DEFINED = {
    "bundle.read": "read_fixture",
    "bundle.seal": "Trust read_keys",
    "bundle.write": "write_fixture",
    "controller": "Command Controller",
    "curve.extraction": "Extraction extract_curve",
    "engine.governor": "Governor GovernorStatus",
    "engine.guide": "Guide GuideStep GuideTrace",
    "engine.moving": "MovingFrame",
    "engine.parameters": "ProxyParameters",
    "engine.proxy": "ProxyEngine Status Step Trace",
    "images.read": "PlannedImage read_image",
    "markers.correspondences": "Correspondences read_markers",
    "planning.extraction": "extract",
    "planning.plan": "plan register",
    "planning.settings": "ExtractSettings FixtureSettings",
    "planning.tolerance": "sample_curve",
    "registration.registration": "Registration fit_registration",
    "replaying.replay": "Replay replay",
    "robot": "Robot read_robot",
    "session.read": "read_session",
    "session.result": "read_result write_result",
    "session.session": "Session",
}
_LAZY = {name: f"vfplan.{home}" for home, names in _DEFINED.items() for name in names.split()}
# Public names that are modules
_MODULES = ("markers", "reference", "registration", "scenes")

__all__ = ["VfplanError", "__version__", "cmake_dir", *_LAZY, *_MODULES]


def cmake_dir() -> Path:
    """The folder to give CMake, as `vfplan_DIR` or in `CMAKE_PREFIX_PATH`."""
    return Path(__path__[0]) / "share" / "cmake" / "vfplan"


def __getattr__(name: str) -> Any:
    if name == "__version__":
        value: Any = importlib.import_module("vfplan._core").__version__
    elif name in _LAZY:
        value = getattr(importlib.import_module(_LAZY[name]), name)
    elif name in _MODULES:
        value = importlib.import_module(f"vfplan.{name}")
    elif name == "_core" and not list(Path(__path__[0]).glob("_core.*")):
        raise ImportError(
            f"vfplan's compiled part is not in {__path__[0]}: that is the source tree, "
            "and the package is not installed (make install)"
        )
    else:
        raise AttributeError(f"module 'vfplan' has no attribute {name!r}")
    # Python asks this function only for names that the module does not have yet.
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
