"""Read bundles from disk by the reader, which is written in C++ (vfplan/bundle/*.hpp)."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from vfplan._core import Sealed
from vfplan.bundle.content import Content, from_content, max_payload_bytes
from vfplan.bundle.seal import HDF5_MAGIC, LENGTHS, Seal
from vfplan.bundle.trust import Trust, check_trust, read_keys
from vfplan.errors import BundleError, SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import opened_file


def read_fixture(path: str | Path, *, trust: Trust | None = None) -> Fixture:
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


def read_sealed(path: str | Path, *, trust: Trust | None = None) -> tuple[Fixture, Seal]:
    """The fixture, and the bundle's seal; raises as `read_fixture` does."""
    content, seal = read_bundle(path, trust=trust)
    return from_content(content), seal


def read_bundle(source: str | Path | bytes, *, trust: Trust | None = None) -> tuple[Content, Seal]:
    """Every value of a bundle, by its path in the format's table, and its seal.

    Raises as `read_fixture` does.
    """
    with opened_source(source) as stream:
        sealed = unsealed(stream, trust)
        return sealed.read()[0], Seal.of(sealed)


def unsealed(stream: BinaryIO, trust: Trust | None = None) -> Sealed:
    """The bytes of a bundle whose seal holds, signed as demanded; its payload is not looked at.

    Raises `BundleError`, and `SettingError` when `trust` is no `Trust`.
    """
    if trust is not None and not isinstance(trust, Trust):
        raise SettingError(
            f"trust is {trust!r}. Give a `vfplan.bundle.Trust`, as Trust(read_keys(PATH))."
        )
    data = stream.read(len(HDF5_MAGIC))
    # Of any other file the first bytes are enough for the reader to say what it is.
    if data == HDF5_MAGIC:
        stream.seek(0)
        data = stream.read(max_payload_bytes() + LENGTHS[-1] + 1)
    sealed = Sealed(data)
    if trust is not None:
        check_trust(sealed, trust)
    return sealed


def require_signature(
    source: str | Path | bytes,
    keys: str | Path,
    *,
    case: str | None = None,
    robot_serial: str | None = None,
    max_age: float | None = None,
) -> Seal:
    """The seal of a bundle that is sound and signed by a key of the file `keys`.

    To load what was checked, and not what the file holds a moment later, give a `Trust` to
    `read_fixture` instead. `max_age` is in seconds since the signing.

    Raises as `read_fixture` does, and `MissingExtra` without the extra `[sign]`.
    """
    trust = Trust(read_keys(keys), case, robot_serial, max_age)
    return read_bundle(source, trust=trust)[1]


@contextmanager
def opened_source(source: str | Path | bytes) -> Iterator[BinaryIO]:
    """A binary stream over a path or over bytes; errors raised within name the path."""
    if isinstance(source, bytes):
        yield io.BytesIO(source)
        return
    with opened_file(Path(source)) as stream:
        try:
            yield stream
        except BundleError as error:
            error.where = within_file(source, error.where)
            raise


def within_file(path: str | Path, where: str | None) -> str:
    """A place inside a bundle with the file's name in front."""
    return f"{Path(path)}:{where}" if where else str(Path(path))
