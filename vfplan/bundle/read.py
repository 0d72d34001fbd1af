"""Read bundles from disk by the reader, which is written in C++ (vfplan/bundle/*.hpp)."""

from __future__ import annotations

from vfplan.bundle.content import Content, from_content
from vfplan.bundle.seal import Trust, check_trust, describe, opened_source, unsealed
from vfplan.display import Report
from vfplan.errors import SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import FilePath


def read_fixture(path: FilePath, *, trust: Trust | None = None) -> Fixture:
    """Read a bundle; either the whole of it is sound or nothing is returned.

    With `trust`, the bytes that are read must also be signed by one of its keys, for its case and
    robot, and not too long ago. Without it, the bundle is known to be whole, undamaged and within
    the format's rules; not who made it, for which patient, or when.

    Raises
    ------
    InputError
        There is no such file.
    BundleError
        The bundle is corrupt, unsafe, of a version this program does not read, or not signed as
        demanded.
    SettingError
        `trust` is no `Trust`.
    """
    return read_sealed(path, trust=trust)[0]


def read_sealed(path: FilePath | bytes, *, trust: Trust | None = None) -> tuple[Fixture, Report]:
    """The fixture, and the bundle's seal as `info` shows it; raises as `read_fixture` does."""
    content, seal = read_bundle(path, trust=trust)
    return from_content(content), seal


def read_bundle(source: FilePath | bytes, *, trust: Trust | None = None) -> tuple[Content, Report]:
    """Every value of a bundle, by its path in the format's table, and its seal.

    Raises as `read_fixture` does.
    """
    with opened_source(source) as stream:
        if trust is not None and not isinstance(trust, Trust):
            raise SettingError(
                f"trust is {trust!r}. Give a `vfplan.Trust`, as Trust(read_keys(PATH))."
            )
        sealed = unsealed(stream)
        if trust is not None:
            check_trust(sealed, trust)
        return sealed.read()[0], describe(sealed)
