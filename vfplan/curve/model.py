"""What an extraction gives: strokes, and what else was found on the slice."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Method = Literal["ridge", "skeleton", "mask"]
METHODS: tuple[Method, ...] = ("ridge", "skeleton", "mask")


@dataclass(frozen=True, eq=False)
class Stroke:
    """One extracted line.

    Parameters
    ----------
    points_px
        (M, 2) float64 (u, v), in drawing order (an unordered set for method "mask").
    sigma_px
        (M,) standard deviation of each point across the line; `None` for a vector curve.
    closed
        Whether the last point joins the first.
    bridged
        (M,) bool, points carried across a pen lift or under something drawn over the line.
    length_px
        Arc length, the closing step included.
    width_px
        Mean width of the pen; `None` for a vector curve.
    """

    points_px: NDArray[np.float64]
    sigma_px: NDArray[np.float64] | None
    closed: bool
    bridged: NDArray[np.bool_]
    length_px: float
    width_px: float | None

    @property
    def ends_px(self) -> NDArray[np.float64]:
        """(2, 2) first and last point; (0, 2) for a closed line."""
        return np.zeros((0, 2)) if self.closed else self.points_px[[0, -1]]


@dataclass(frozen=True, eq=False)
class Extraction:
    """What was found on a slice.

    Parameters
    ----------
    mask
        (H, W) bool, every pixel in the pen's colour.
    strokes
        The chosen lines, the longest first.
    method
        How they were measured.
    set_aside
        Marks in the pen's colour that were not taken for curves, and candidates not chosen: each a
        dict with `kind`, `box`, `length_px` and the number that chooses it, `stroke`. Specks are
        named just beyond a curve's end only.
    warnings
        What a person should know before trusting the result.
    ink
        The pixels of the mask by what they were taken for: "curve", or a kind as in `set_aside`.
    """

    mask: NDArray[np.bool_]
    strokes: tuple[Stroke, ...]
    method: Method | Literal["vector"]
    set_aside: tuple[dict, ...] = ()
    warnings: tuple[str, ...] = field(default=())
    ink: dict[str, int] = field(default_factory=dict)
