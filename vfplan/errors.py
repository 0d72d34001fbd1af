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

The message says what is wrong, the value found, what is allowed and what to do. `where` names the
place (a file, a marker's label, a dataset's path, a pixel). `code` is a stable name of what is
wrong, and `numbers` holds the values that the message speaks of: no caller has to read the words.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class VfplanError(Exception):
    """Base of every error raised for bad input, files and versions.

    Parameters
    ----------
    message
        What is wrong, the value found, and what is allowed.
    where
        The place: a file, a label, a path inside a bundle; `None` when there is none.
    code
        A stable name of what is wrong, such as "line-forks". Without one it is the class's own.
    numbers
        The values that the message speaks of, by name, with the unit in the name.
    """

    exit_code = 1
    code = "error"

    def __init__(
        self,
        message: str,
        *,
        where: str | Path | None = None,
        code: str | None = None,
        numbers: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.where = None if where is None else str(where)
        if code is not None:
            self.code = code
        self.numbers = dict(numbers or {})

    def __init_subclass__(cls) -> None:
        """The code of a class is its name, unless it gives itself another: "check-failed"."""
        if "code" not in vars(cls):
            name = cls.__name__.removesuffix("Error")
            cls.code = re.sub("(?<=[a-z])(?=[A-Z])", "-", name).lower()

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

    `candidates` are the lines there were to choose from, (n, 2) [px] each, and `lines` all lines in
    the order of their numbers. `forked` are the numbers of those that fork, so that no number takes
    them.
    """

    code = "curve"
    candidates: tuple[Any, ...] = ()
    lines: tuple[Any, ...] = ()
    forked: tuple[int, ...] = ()


class MarkerError(InputError):
    """Marker files or correspondences that determine no transform."""

    code = "markers"


class SessionError(InputError):
    """A recording of HIP positions that cannot be replayed."""


class SceneError(InputError, ValueError):
    """A point cloud or a HIP path the engine cannot render."""


class BundleError(VfplanError):
    """A bundle that had to be loaded and cannot be trusted."""

    exit_code = 4


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
def requires_extra(what: str, extra: str, where: str | None = None) -> Iterator[None]:
    """Turn a failed import inside into a `MissingExtra`: `what` needs a package of the extra."""
    try:
        yield
    except ImportError:
        raise MissingExtra(f"{what}. Run pip install 'vfplan[{extra}]'", where=where) from None
