"""The fixture bundle: a versioned, sealed HDF5 file that a robot can trust.

    read_fixture(path) -> Fixture        write_fixture(fixture, path)

docs/format.md is the normative text, schemas/bundle-2.0.json its machine-readable twin.

A module is imported when one of its names is first used: who reads a bundle needs neither the
writer nor the rules of `validate`.
"""

from __future__ import annotations

__all__ = [
    "Issue", "Trust", "describe", "diff", "export", "import_cloud", "keygen", "left_out",
    "mesh_band", "mesh_doubts", "migrate", "read_bundle", "read_fixture", "read_keys",
    "read_sealed", "require_signature", "sample_band", "sign", "validate", "write_fixture",
]  # fmt: skip


def __dir__() -> list[str]:
    return sorted(__all__)
