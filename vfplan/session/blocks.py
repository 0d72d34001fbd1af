"""Consecutive blocks of rows, and the differences between rows of two blocks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class WithPrevious:
    """Arrays of a block after the last rows of the block before: for differences across blocks."""

    def __init__(self) -> None:
        self._last: tuple[Array, ...] | None = None

    def __call__(self, *rows: Array) -> tuple[Array, ...]:
        """The arrays, a row longer from the second block on."""
        extended = list(rows)
        if self._last is not None:
            for i, last in enumerate(self._last):
                extended[i] = np.concatenate((last, rows[i]))
        self._last = tuple(array[-1:] for array in extended)
        return tuple(extended)
