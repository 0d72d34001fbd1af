"""Whether something drawn later hides where a line goes on: a coloured patch, a box, a panel.

Another colour is seen at once. A box in white, black or grey is told by its edge: level ground that
begins along a row or column just where the ink ends, and without the ramp that a bone's edge has.
Under a box that is half transparent the ink goes on, fainter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.light import LUMINANCE
from vfplan.curve.pen import Pen, sample_pixels
from vfplan.curve.unmixing import FOREIGN

WIDE, NOISE = 24, 0.5  # px around an end; levels of colour there, as JPEG's, not of clean ground
STRETCH, OVER_PX = 6, 4.0  # points back, px beyond a line's half width: the way ahead of an end
VEILED, FULL = (0.05, 0.12), 0.6  # of the pen's strength, and in JPEG: more is a dot
VEIL_PX = (2.0, 10.0)  # ahead
# Where a box begins, the ink is cut off along a row or column, and beside it over `LONG` pixels
# either level ground begins there or the brightness changes at once. Over CT slices of a phantom
# with flat faces 2 % of random ends lie at such an edge, 3 % in JPEG.
NEAR, LONG = (1, 4), 12  # pixels back and onward from the ink's end; of edge
BEFORE, BEYOND, ASIDE = 0.4, 0.3, 2  # of the ink across the line, two pixels off the edge
LEVEL = (3.0, 7.0)  # grey levels that level ground varies by; in JPEG
STEP, RAMP, EVEN, SHOWN = 15.0, 0.85, 0.85, 0.6  # grey levels; shares of the pixels
LEAP, BESIDE, SHARP = 20.0, 0.25, 0.8  # grey levels; of the leap, a pixel farther; of the pixels
STEEP = 0.3  # cosine of the widest angle between a line and the edge's normal


def covered_ends(
    rgb: NDArray, line: Candidate, points: NDArray, origin: tuple[int, int]
) -> list[str]:
    """A warning for each end of a measured open line, (M, 2) points, that something may hide."""
    if line.closed or len(points) <= STRETCH:
        return []
    warnings = []
    for at, inner in ((points[0], points[STRETCH]), (points[-1], points[-1 - STRETCH])):
        onward = (at - inner) / np.hypot(*(at - inner))
        what = _cover(rgb, line.mark.pen, line.width_px, at, onward)
        if what:
            u, v = at + origin
            warnings.append(
                f"the curve ends at ({u:.0f}, {v:.0f}) where {what} begins: what that hides of it "
                "is not followed"
            )
    return warnings


def _cover(rgb: NDArray, pen: Pen, width: float, at: NDArray, onward: NDArray) -> str:
    """What begins at an end; empty where nothing does."""
    ahead = at + np.arange(1.0, width + OVER_PX)[:, None] * onward
    pixels = sample_pixels(rgb, *ahead.T)
    foreign = np.maximum(np.abs(pixels @ pen.across), -pixels @ pen.along)
    if (foreign > FOREIGN * pen.strength).sum() >= 2:
        return "something of another colour"
    around = at + np.mgrid[-WIDE : WIDE + 1 : 3, -WIDE : WIDE + 1 : 3].reshape(2, -1).T
    tint = np.abs(sample_pixels(rgb, *around.T) @ pen.across)
    noisy = bool(np.quantile(tint, 0.8) > NOISE)
    if _shows_through(rgb, pen, width, at, onward, VEILED[noisy]):
        return "something that its ink shows through faintly"
    if _meets_edge(rgb, pen, width, at, onward, LEVEL[noisy]):
        return "the straight edge of something evenly grey, white or black"
    return ""


def _shows_through(
    rgb: NDArray, pen: Pen, width: float, at: NDArray, onward: NDArray, veiled: float
) -> bool:
    """Whether ink goes on ahead, too faint for the mask, and none does beside it."""
    far = at + (VEIL_PX[1] + width / 2) * onward
    if (far < 0).any() or (far > np.array(rgb.shape[1::-1]) - 1).any():
        return False
    t = np.arange(*np.add(VEIL_PX, width / 2))[:, None, None]
    x = np.arange(-width, width + 0.1, 0.5)
    aside, lanes = np.array([-onward[1], onward[0]]), []
    for off in (0.0, *(side * (3 * width + OVER_PX) for side in (1, -1))):
        places = at + t * onward + (off + x)[:, None] * aside
        share = sample_pixels(rgb, *np.moveaxis(places, 2, 0)) @ pen.along / pen.strength
        lanes.append(np.quantile(share.max(1), (0.2, 0.8)))
    (least, most), *beside = lanes
    return bool(veiled + max(lane[0] for lane in beside) < least and most < FULL)


def _meets_edge(
    rgb: NDArray, pen: Pen, width: float, at: NDArray, onward: NDArray, within: float
) -> bool:
    """Whether an end is cut off by the edge of something along a row or column."""
    size = sum(NEAR) + LONG + round(width / STEEP)
    u, v = np.rint(at).astype(int)
    rows, cols = np.ogrid[v - size : v + size + 1, u - size : u + size + 1]
    inside = (rows >= 0) & (rows < rgb.shape[0]) & (cols >= 0) & (cols < rgb.shape[1])
    pixels = rgb[rows.clip(0, rgb.shape[0] - 1), cols.clip(0, rgb.shape[1] - 1)]
    pixels = pixels * (255.0 / np.iinfo(rgb.dtype).max)
    grey, ink = pixels @ LUMINANCE, np.maximum(pixels @ pen.along / pen.strength, 0.0)
    grey[~inside] = np.nan
    off, way = at - (u, v), np.array(onward)
    for _ in range(4):  # turned so that the edge lies ahead, along a row
        if way[1] > STEEP:
            reach = round(width / 2 / way[1]) + 1
            first = round(off[1]) + size
            along = np.arange(len(grey)) - size - off[1]
            middle = np.rint(size + off[0] + way[0] / way[1] * along)
            for row in range(first - NEAR[0], first + NEAR[1] + 1):
                if _is_edge(grey, ink, row, middle.astype(int), reach, within):
                    return True
        grey, ink = np.rot90(grey), np.rot90(ink)
        off, way = off[::-1] * (1, -1), way[::-1] * (1, -1)
    return False


def _is_edge(
    grey: NDArray, ink: NDArray, row: int, middle: NDArray, reach: int, within: float
) -> bool:
    """Whether ink that is `reach` px to either side of (R,) `middle` is cut off at a row."""
    mass = [
        ink[j, max(middle[j] - reach - 1, 0) : middle[j] + reach + 2].sum()
        for j in (*range(row - 8, row - 3), row - 2, row + 2)
    ]
    usual = np.median(mass[:5])
    beside = reach + 1 + np.arange(LONG)
    cols = middle[row] + np.r_[-beside[::-1], beside]
    cut = mass[5] >= BEFORE * usual and mass[6] <= BEYOND * usual
    if not cut or cols[0] < 0 or cols[-1] >= len(grey):
        return False
    level = np.median(grey[row + 1 : row + 4, middle[row] - ASIDE : middle[row] + ASIDE + 1])
    lines = grey[row - 5 : row + 6][:, cols]
    parts = (slice(LONG), slice(LONG // 2, -LONG // 2), slice(LONG, None))  # it may be a corner
    return any(_begins(lines[:, part] - level, within) or _leaps(lines[:, part]) for part in parts)


def _begins(lines: NDArray, within: float) -> bool:
    """Whether level ground, 0, begins amid (11, `LONG`) lines, without a ramp before."""
    even = (np.abs(lines[6:9]) <= within).all(0)
    on = even & (np.abs(lines[4]) >= STEP)
    if even.mean() < EVEN or on.mean() < SHOWN:
        return False
    near, far = (np.median(np.abs(lines[k])[on]) for k in (4, 2))
    return bool(near >= RAMP * far)


def _leaps(lines: NDArray) -> bool:
    """Whether the brightness changes one way in the middle of (11, `LONG`) lines, not beside."""
    leap = lines[6] - lines[4]
    most = BESIDE * np.abs(leap) + 3.0
    alone = (np.abs(lines[4] - lines[2]) <= most) & (np.abs(lines[8] - lines[6]) <= most)
    return max((alone & (way * leap >= LEAP)).mean() for way in (1, -1)) >= SHARP
