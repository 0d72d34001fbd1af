"""What reading a pixel grid does to a line's measured offset: drawn anew, and taken off.

A pixel holds the pen's coverage of its whole square, and a profile is read between the pixels. For
a crisp pen the offset found in it errs by up to 0.04 px, one way or the other as the line lies to
the grid: on a line nearly along a row so slowly that no smoothing takes it out. But it can be told.
A straight piece of a pen covers a square, by its signed distance d, in closed form; so the line is
drawn once more where it was found, read as the picture was, and what comes out wrong is deducted.

In a bend blur, a pixel's square included, draws both edges inward, a disc's as well as a hole's: by
half its variance over the radius.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEAST = 30  # whole profiles, or nothing is deducted
ROWS = 100  # profiles from which the pen's own width and blur are learnt
STEPS = 3  # of learning the pen, by Gauss and Newton's method, and deducting in turn
CHANGE = 0.05  # of width [px] and blur [px²], for their derivatives
START_PX2 = 0.02  # blur of a crisp pen
WIDEST_PX = 0.75  # the mask's width errs by no more
BLURRED_PX2 = 0.3  # variance of a blur that hides the grid: less than 0.002 px is left of it
SQUARE_PX2 = 1 / 12  # variance of a pixel's square along either axis
SMOOTH_PX = 3.0
EXPLAINED = 0.01  # of full coverage: a picture left so little of is such a pen's,
SMOOTHER = 0.75  # and one of which more is left, if this takes half the scatter's power away
CRISP = 1.0  # how much is held against blur where the picture does not tell: a line along a row
CORNERS = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
NODES = ((0.0, 2 / 3), (np.sqrt(3.0), 1 / 6), (-np.sqrt(3.0), 1 / 6))  # Gauss and Hermite's


@dataclass(frozen=True, eq=False)
class Grid:
    """How the places read across a path lie to the pixels.

    Parameters
    ----------
    distance
        (M, K, 4) of the four pixels round each place from the path, along its normal [px].
    weight
        (M, K, 4) of each in the value read.
    long, short
        (M,) a pixel's square as seen across the line: its sides' larger and smaller shadow [px].
    bend
        (M,) curvature of the path, positive towards the normal [1/px].
    """

    distance: NDArray[np.float64]
    weight: NDArray[np.float64]
    long: NDArray[np.float64]
    short: NDArray[np.float64]
    bend: NDArray[np.float64]

    @classmethod
    def of_path(cls, x: NDArray, base: NDArray, normal: NDArray, bend: NDArray) -> Grid:
        """Of (K,) places across an (M, 2) path with (M, 2) unit normals and (M,) curvature."""
        place = base[:, None] + normal[:, None] * x[:, None]
        share = (place - np.floor(place))[:, :, None]
        off = CORNERS - share
        n = normal[:, None, None]
        along = off[..., 0] * n[..., 1] - off[..., 1] * n[..., 0]
        across = (off * n).sum(-1) + x[:, None]
        weight = np.where(CORNERS, share, 1 - share).prod(-1)
        sides = np.abs(normal)
        return cls(
            across - bend[:, None, None] * along**2 / 2,
            weight,
            sides.max(1),
            np.maximum(sides.min(1), 1e-6),
            bend,
        )

    def some(self, rows: NDArray) -> Grid:
        """Of these rows alone."""
        return Grid(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def read(self, offset: NDArray, width: float, blur: float) -> NDArray[np.float64]:
        """(M, K) read of a pen of `width` px at (M,) offsets; `blur` is a variance [px²]."""
        inward = self.bend * (blur + SQUARE_PX2) / 2
        distance = self.distance - (offset + inward)[:, None, None]
        share = np.zeros_like(distance)
        for node, part in NODES if blur > 0 else ((0.0, 1.0),):
            z = distance + node * np.sqrt(blur)
            share += part * (self._edge(z + width / 2) - self._edge(z - width / 2))
        return (share * self.weight).sum(-1)

    def _edge(self, z: NDArray) -> NDArray[np.float64]:
        """How much of a square lies below a straight edge z px beyond its middle, less a half."""
        long, short = self.long[:, None, None], self.short[:, None, None]
        far = np.minimum(np.abs(z), (long + short) / 2)
        slanted = np.maximum(far - (long - short) / 2, 0.0)
        return np.copysign(far / long - slanted**2 / (2 * long * short), z)


def phase_shift(
    grid: Grid,
    alpha: NDArray,
    whole: NDArray,
    offset: NDArray,
    width: float,
    measure: Callable[[NDArray], NDArray],
) -> tuple[NDArray[np.float64] | None, bool]:
    """(M,) what grid and bend add to the offset [px]; whether that explains the picture.

    `None` for a pen so soft that the grid does not show, and where this makes nothing better.

    Parameters
    ----------
    grid
        How the places read lie to the pixels.
    alpha, whole
        (M, K) coverage read, and (M,) which rows hold the line and nothing else.
    offset
        (M,) measured, of the line from the path [px].
    width
        The line's width by its mask [px].
    measure
        What made `offset` of `alpha`.
    """
    rows = np.flatnonzero(whole)
    if len(rows) < LEAST:
        return None, False
    rows = rows[:: -(-len(rows) // ROWS)]
    line = rough = _smooth(offset, whole)
    pen, few = (width, START_PX2), grid.some(rows)
    for _ in range(STEPS):
        pen = _pen_of(few, alpha[rows], line[rows], width, pen)
        if pen is None:
            return None, False
        drawn = grid.read(line, *pen)
        shift = measure(drawn) - line
        line = _smooth(offset - shift, whole)
    if _misfit(drawn[whole], alpha[whole]) < EXPLAINED:
        return shift, True
    before, after = (np.median(r[whole] ** 2) for r in (offset - rough, offset - shift - line))
    return (shift if after < SMOOTHER * before else None), False


def _misfit(drawn: NDArray, alpha: NDArray) -> float:
    """RMS coverage of the usual row that a drawn line leaves unexplained."""
    basis = np.column_stack([drawn.ravel(), np.ones(drawn.size)])
    left = alpha.ravel() - basis @ np.linalg.lstsq(basis, alpha.ravel(), rcond=None)[0]
    return float(np.sqrt(np.median((left.reshape(drawn.shape) ** 2).mean(1))))


def inward_lean(x: NDArray, profile: NDArray, bend: NDArray, width: float) -> NDArray[np.float64]:
    """(M,) how far blur draws a bent line inward, told by its (K,) mean profile alone [px]."""
    weight = np.clip(profile, 0.0, None)
    variance = float((weight * x**2).sum() / max(weight.sum(), 1e-9)) - width**2 / 12
    return bend * max(variance, 0.0) / 2


def _pen_of(
    grid: Grid, alpha: NDArray, offset: NDArray, mask: float, pen: tuple[float, float]
) -> tuple[float, float] | None:
    """The pen's width [px] and its blur's variance [px²], one step nearer than `pen`.

    `None` where blur hides the grid. The line's width by its `mask` bounds that of the pen.
    """
    width, blur = pen
    drawn = grid.read(offset, width, blur)
    wider = grid.read(offset, width + CHANGE, blur) - drawn
    softer = grid.read(offset, width, blur + CHANGE) - drawn
    basis = np.column_stack([f.ravel() for f in (drawn, wider, softer, np.ones_like(drawn))])
    basis = np.vstack([basis, [0.0, 0.0, CRISP * CHANGE, 0.0]])
    wanted = np.append(alpha, -CRISP * blur)
    height, more, soft, _ = np.linalg.lstsq(basis, wanted, rcond=None)[0]
    change = CHANGE * more / height
    width = float(np.clip(width + change, max(mask - WIDEST_PX, 0.5), mask + WIDEST_PX))
    blur = max(blur + CHANGE * float(soft / height), 0.0)
    return None if blur > BLURRED_PX2 else (width, blur)


def _smooth(values: NDArray, whole: NDArray) -> NDArray[np.float64]:
    from scipy.ndimage import gaussian_filter1d

    total = gaussian_filter1d(np.where(whole, values, 0.0), SMOOTH_PX)
    return total / np.maximum(gaussian_filter1d(whole.astype(float), SMOOTH_PX), 0.05)
