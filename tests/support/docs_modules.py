"""The programs in docs/ and samples/, loaded as modules."""

from __future__ import annotations

import importlib.util
import sys


def load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # A dataclass looks there for its module.
    spec.loader.exec_module(module)
    return module
