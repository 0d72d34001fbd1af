"""What a grid does to a line's offset, learnt from where the line crosses it often.

Where a pen cannot be drawn anew (`phase`), as under JPEG's coarse colour cut off at white, blending
in linear light, or an enlarged picture, the grid still shifts the measured line by a pattern of
where it lies between two grid lines. On a slanting run the pattern changes quickly and stands out
from the smooth line; what it is there is taken off on runs nearly along the grid, where it is slow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

WAVES = np.pi * np.array([1, 2, 3, 4])  # of a grid of 2 px, JPEG's for colour, and of one of 1 px
SLANTS = (0.1, 0.6)  # sines of the angle to the grid's nearer axis, of runs to learn from
LEAST = 60  # of their points
ALIKE = 5.0  # points of line that share their noise
MORE = 3  # waves of another grid, such as a picture's before it was enlarged,
FOUND = (0.25, 1.6)  # of so many turns a pixel,
SURE_FOUND = 6.0  # and looked for among many, so to be surer of
BIN_PX = 0.1
SURE = 3.5  # standard errors of a wave that is there


def learnt_pattern(
    points: NDArray, normal: NDArray, residual: NDArray, valid: NDArray
) -> tuple[NDArray[np.float64], bool]:
    """(M,) the grid's share of the measured offsets [px], 0 if none; whether it could be learnt.

    Parameters
    ----------
    points, normal
        (M, 2) the line, and its unit normals.
    residual, valid
        (M,) measured offsets less the smooth line [px], and where there are any.
    """
    steep = np.abs(normal[:, 0]) > np.abs(normal[:, 1])
    place = np.where(steep, points[:, 0], points[:, 1])
    share = np.where(steep, normal[:, 0], normal[:, 1])
    slant = np.abs(normal).min(1)
    taught = valid & (slant > SLANTS[0]) & (slant < SLANTS[1])
    none = np.zeros(len(points))
    if taught.sum() < LEAST:
        return none, False
    wanted = residual[taught]
    waves = list(WAVES)
    for _ in range(MORE + 1):
        every = _sines(place, share, waves)
        basis = every[taught]
        inverse = np.linalg.pinv(basis.T @ basis)
        size = inverse @ (basis.T @ wanted)
        left = wanted - basis @ size
        if len(waves) == len(WAVES) + MORE:
            break
        waves.append(_strongest(place[taught], share[taught] * left))
    error = np.sqrt(ALIKE * (left @ left) / len(wanted) * np.diag(inverse))
    limit = np.where(np.arange(len(size)) % len(waves) < len(WAVES), SURE, SURE_FOUND)
    return every @ np.where(np.abs(size) > limit * error, size, 0.0), True


def _sines(place: NDArray, share: NDArray, waves: list[float]) -> NDArray:
    turns = place[:, None] * np.array(waves)
    return np.hstack([np.sin(turns), np.cos(turns)]) * share[:, None]


def _strongest(place: NDArray, values: NDArray) -> float:
    """The wave number that stands out most in values at places [rad/px]."""
    bins = np.rint((place - place.min()) / BIN_PX).astype(int)
    count = 1 << int(np.ceil(np.log2(2 * (bins.max() + 1))))
    power = np.abs(np.fft.rfft(np.bincount(bins, values, count)))
    number = np.arange(len(power)) / (count * BIN_PX)
    power[(number < FOUND[0]) | (number > FOUND[1])] = 0.0
    return float(2 * np.pi * number[np.argmax(power)])
