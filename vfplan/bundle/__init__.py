"""The fixture bundle: a versioned, sealed HDF5 file that a robot can trust.

    read_fixture(path) -> Fixture        write_fixture(fixture, path)

docs/format.md is the normative text, schemas/bundle-2.0.json its machine-readable twin.
"""

from vfplan.bundle.clouds import import_cloud, mesh_band
from vfplan.bundle.describe import describe, diff
from vfplan.bundle.exporting import export, left_out
from vfplan.bundle.keys import keygen, read_keys
from vfplan.bundle.migration import migrate
from vfplan.bundle.read import read_bundle, read_fixture, read_sealed, require_signature
from vfplan.bundle.signing import sign
from vfplan.bundle.trust import Trust
from vfplan.bundle.validation import Issue, mesh_doubts, validate
from vfplan.bundle.write import write_fixture

__all__ = [
    "Issue", "Trust", "describe", "diff", "export", "import_cloud", "keygen", "left_out",
    "mesh_band", "mesh_doubts", "migrate", "read_bundle", "read_fixture", "read_keys",
    "read_sealed", "require_signature", "sign", "validate", "write_fixture",
]  # fmt: skip
