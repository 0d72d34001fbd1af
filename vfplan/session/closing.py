"""What writers of ticks share: they are used in a `with` statement, and close their file."""

from __future__ import annotations

from typing import Protocol


class _File(Protocol):
    def close(self) -> None: ...


class Closing:
    """A writer that closes its `_file` at the end of the `with` statement."""

    _file: _File

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
