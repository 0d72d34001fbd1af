"""Every error that vfplan raises on purpose.

One tree, so that a caller can catch as much or as little as it wants:

    VfplanError                 base; `exit_code` is what the command line returns
    ├── InputError          3   bad input; its subclasses say which
    │   ├── ImageError          an image that cannot be read or used
    │   ├── CurveError          no planned curve, or one that would have to be guessed
    │   ├── MarkerError         marker files or correspondences that determine no transform
    │   ├── SessionError        a recording of HIP positions that cannot be replayed
    │   └── SceneError          a point cloud the engine cannot render
    ├── BundleError         4   a bundle that had to be loaded and cannot be trusted
    │   ├── CorruptError        the bytes are not what was written
    │   ├── UnsafeError         the file uses a feature the format forbids
    │   ├── VersionError        a version this program does not read
    │   └── SignatureError      a signature is missing, wrong, or by an unknown key
    ├── CheckFailed         1   a check found something: a gate, a validation, a difference
    ├── SettingError        2   a parameter outside its range
    ├── OutputError         2   an output path that exists already or cannot be written
    └── MissingExtra        2   an optional dependency that this call needs is not installed

The message says what is wrong, the value found and what is allowed; `where` names the place
(a file, a marker's label, a dataset's path, a pixel).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class VfplanError(Exception):
    """Base of every error raised for bad input, files and versions.

    Parameters
    ----------
    message
        What is wrong, the value found, and what is allowed.
    where
        The place: a file's name, a label, a path inside a bundle; `None` when there is none.
    """

    exit_code = 1

    def __init__(self, message: str, *, where: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.where = where

    @property
    def kind(self) -> str:
        """The class name, as scripts read it from `--json`."""
        return type(self).__name__

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" if self.where else self.message


class InputError(VfplanError):
    """Bad input: the caller's data cannot be used."""

    exit_code = 3


class ImageError(InputError):
    """An image that cannot be read or used."""


class CurveError(InputError):
    """No planned curve in the image, or one that would have to be guessed.

    `candidates` are the lines there were to choose from, (n, 2) [px] each, in their numbers' order.
    """

    candidates: tuple[Any, ...] = ()


class MarkerError(InputError):
    """Marker files or correspondences that determine no transform."""


class SessionError(InputError):
    """A recording of HIP positions that cannot be replayed."""


class SceneError(InputError, ValueError):
    """A point cloud or a HIP path the engine cannot render."""


class BundleError(VfplanError):
    """A bundle that had to be loaded and cannot be trusted."""

    exit_code = 4
    code = ""  # of the finding, as `vfplan validate` prints it; "" where no reader found it


class CorruptError(BundleError):
    """The bytes are not what was written."""


class UnsafeError(BundleError):
    """The file uses a feature that the format forbids."""


class VersionError(BundleError):
    """A format version that this program does not read."""


class SignatureError(BundleError):
    """A signature is missing, wrong, or by an unknown key."""


class CheckFailed(VfplanError):  # noqa: N818 - a verdict, not a malfunction
    """A check found something: a gate that did not hold, an invalid file, a difference."""

    exit_code = 1


class SettingError(VfplanError, ValueError):
    """A parameter outside its range."""

    exit_code = 2


class OutputError(VfplanError):
    """An output path that exists already or cannot be written."""

    exit_code = 2


class MissingExtra(VfplanError):  # noqa: N818 - names the missing thing
    """An optional dependency that this call needs is not installed."""

    exit_code = 2


@contextmanager
def needing(what: str, extra: str, where: str | None = None) -> Iterator[None]:
    """An import inside that fails is a `MissingExtra`: `what` needs a package of the extra."""
    try:
        yield
    except ImportError:
        raise MissingExtra(f"{what}: pip install 'vfplan[{extra}]'", where=where) from None
