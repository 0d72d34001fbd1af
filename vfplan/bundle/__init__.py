"""The fixture bundle: a versioned HDF5 file that a robot can trust.

read_fixture(path) -> Fixture        write_fixture(fixture, path)
"""

from vfplan.bundle.files import describe, read_fixture, write_fixture

__all__ = ["describe", "read_fixture", "write_fixture"]
