"""The fixture bundle: a versioned, sealed HDF5 file that a robot can trust.

    read_fixture(path) -> Fixture        write_fixture(fixture, path)

docs/format.md is the normative text, schemas/bundle-1.0.json its machine-readable twin.
"""

from vfplan.bundle.clouds import import_cloud
from vfplan.bundle.compare import diff
from vfplan.bundle.describe import describe
from vfplan.bundle.exporting import export, left_out
from vfplan.bundle.files import read_bundle, read_fixture, require_signature, write_fixture
from vfplan.bundle.findings import Issue
from vfplan.bundle.keys import keygen, read_keys
from vfplan.bundle.migration import migrate
from vfplan.bundle.plausible import size_doubt
from vfplan.bundle.signing import Trust, sign
from vfplan.bundle.validation import validate

__all__ = [
    "Issue",
    "Trust",
    "describe",
    "diff",
    "export",
    "import_cloud",
    "keygen",
    "left_out",
    "migrate",
    "read_bundle",
    "read_fixture",
    "read_keys",
    "require_signature",
    "sign",
    "size_doubt",
    "validate",
    "write_fixture",
]
