"""The fixture bundle: a versioned, sealed HDF5 file that a robot can trust.

    read_fixture(path) -> Fixture        write_fixture(fixture, path)

docs/format.md is the normative text, schemas/bundle-1.0.json its machine-readable twin.
"""

from vfplan.bundle.describe import describe
from vfplan.bundle.files import read_bundle, read_fixture, write_fixture

__all__ = ["describe", "read_bundle", "read_fixture", "write_fixture"]
