"""The fixture bundle: a versioned, sealed HDF5 file that a robot can trust.

    read_fixture(path) -> Fixture        write_fixture(fixture, path)

docs/format.md is the normative text, schemas/bundle-2.0.json its machine-readable twin.

A module is imported when one of its names is first used: who reads a bundle needs neither the
writer nor the rules of `validate`.
"""

from __future__ import annotations

import importlib
from typing import Any

_DEFINED = {
    "clouds": ("import_cloud", "mesh_band", "sample_band"),
    "describe": ("describe", "diff"),
    "exporting": ("export", "left_out"),
    "keys": ("keygen", "read_keys"),
    "migration": ("migrate",),
    "read": ("read_bundle", "read_fixture", "read_sealed", "require_signature"),
    "signing": ("sign",),
    "trust": ("Trust",),
    "validation": ("Issue", "mesh_doubts", "validate"),
    "write": ("write_fixture",),
}
"""Module -> the public names that it defines."""
_HOME = {}
for _module, _names in _DEFINED.items():
    _HOME.update(dict.fromkeys(_names, _module))

__all__ = [
    "Issue", "Trust", "describe", "diff", "export", "import_cloud", "keygen", "left_out",
    "mesh_band", "mesh_doubts", "migrate", "read_bundle", "read_fixture", "read_keys",
    "read_sealed", "require_signature", "sample_band", "sign", "validate", "write_fixture",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = importlib.import_module(f"{__name__}.{_HOME[name]}")
    # All names of the module at once: importing it sets its own name here, which one of its
    # functions may bear, as `describe` does.
    for defined in _DEFINED[_HOME[name]]:
        globals()[defined] = getattr(module, defined)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted(__all__)
