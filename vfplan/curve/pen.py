"""The pen: its colour, how much of it lies on each pixel, and ink too faint for its mask.

Over grey (g, g, g) a pen of colour c and coverage α shows p = (1 − α) g n + α c, n = (1, 1, 1).
The part of p across the grey axis is α c⊥ **whatever g is**, so with e = c⊥/|c⊥|

    α |c⊥| = p · e

is exact and linear in the pixel: bones and air under the pen drop out. For pure red e is
(2, −1, −1)/√6 and the formula is α = (R − (G + B)/2) / 255. The direction across e in the same
plane shows what is *not* the pen: yellow labels, cyan markers.

Blended in linear light, a pen half opaque is less than half as strong over bone as over air. A line
cut off there would be a wrong curve with nothing to show for it. So what is faint is followed, but
only as a line is: a run away from the strong mask, without forks, no wider than a pen, that begins
where a strong line ends and leads on as it does. Tinted regions and the blur beside a line do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.skeleton import branches_of, thin
from vfplan.errors import SettingError

HUE_GATE_DEG = 32.0  # red to crimson and tomato; yellow and magenta are 60° away
STRIP_ROWS = 256
MIN_CHROMA = 30.0  # of a named pen's colour, on the 0..255 scale

FAINT = 0.25  # of the strong line's strength, at least
AWAY_PX = 4  # from the strong mask: nearer, it is the line's own blur
LEAST_PIXELS, LEAST_PX, MOST_PIXELS = 12, 5, 20000
ISLAND_PIXELS = 80  # a smaller piece of the strong mask is no line of its own
BROADER = 1.8  # times the strong line's width, at most
JOIN_PX = 8  # beyond `AWAY_PX`, between a strong line's end and the faint run's
STRETCH_PX = 10  # of skeleton, from which a direction is taken
MAX_TURN_DEG = 50.0


@dataclass(frozen=True, eq=False)
class Pen:
    """A pen's colour in the chroma plane (the plane across grey), on the scale 0..255."""

    along: NDArray[np.float64]  # (3,) unit vector: the pen's own direction, e
    across: NDArray[np.float64]  # (3,) unit vector of the same plane at right angles to it
    strength: float  # |c⊥| times the opacity: what p · e reaches in the middle of the line

    @classmethod
    def of_chroma(cls, chroma: NDArray) -> Pen:
        """The pen whose full line has this (3,) chroma."""
        chroma = chroma - chroma.mean()
        strength = float(np.linalg.norm(chroma))
        along = chroma / strength
        return cls(along, np.cross(np.ones(3), along) / np.sqrt(3.0), strength)

    @classmethod
    def of_colour(cls, colour: str) -> Pen:
        """The pen of a named colour or `#rrggbb`; raises `SettingError` for grey or nonsense."""
        rgb = parse_colour(colour)
        chroma = np.linalg.norm(rgb - rgb.mean())
        if chroma < MIN_CHROMA:
            raise SettingError(
                f"colour {colour!r} is grey (chroma {chroma:.0f} of 255; at least "
                f"{MIN_CHROMA:.0f} is wanted): it cannot be told from the slice"
            )
        return cls.of_chroma(rgb)


def parse_colour(colour: str) -> NDArray[np.float64]:
    """(3,) RGB on 0..255 of `#rrggbb` or a CSS colour name; raises `SettingError`."""
    if colour == "red":  # the default spares an import
        return np.array([255.0, 0.0, 0.0])
    from matplotlib.colors import to_rgb

    try:
        return 255.0 * np.array(to_rgb(colour))
    except ValueError:
        raise SettingError(f"colour {colour!r} is neither a colour's name nor #rrggbb") from None


def pen_score(rgb: NDArray, pen: Pen, sigma_px: float) -> NDArray[np.uint8]:
    """(H, W) uint8: p · along, smoothed; 0 where the hue is not the pen's.

    Smoothing over `sigma_px` keeps the noise of JPEG from fraying the mask; the line itself is
    measured on the picture as it is. Works in strips of rows: one byte a pixel, and no more.
    """
    import cv2

    slope = np.tan(np.radians(HUE_GATE_DEG))
    rows = np.array([pen.along, slope * pen.along - pen.across, slope * pen.along + pen.across])
    rows *= 255.0 / np.iinfo(rgb.dtype).max
    height, halo = rgb.shape[0], int(np.ceil(3 * sigma_px))
    score = np.empty(rgb.shape[:2], np.uint8)
    for top in range(0, height, STRIP_ROWS):
        bottom = min(top + STRIP_ROWS, height)
        first = max(top - halo, 0)
        strip = cv2.GaussianBlur(rgb[first : min(bottom + halo, height)], (0, 0), sigma_px)
        # Saturates: what is below 0 becomes 0.
        parts = cv2.transform(strip[top - first : bottom - first], rows)
        inside = (parts[..., 1] > 0) & (parts[..., 2] > 0)
        score[top:bottom] = np.minimum(parts[..., 0], 255) * inside
    return score


def chroma_at(rgb: NDArray, rows: NDArray, cols: NDArray, pen: Pen) -> tuple[NDArray, NDArray]:
    """p · along and p · across of the pixels (rows, cols), on the scale 0..255."""
    pixels = rgb[rows, cols] * (255.0 / np.iinfo(rgb.dtype).max)
    return pixels @ pen.along, pixels @ pen.across


def sample_pixels(rgb: NDArray, u: NDArray, v: NDArray) -> NDArray[np.float64]:
    """(..., 3) colour on 0..255 at sub-pixel places, bilinear; outside the image the edge goes on.

    Only the four pixels around each place are read, so the cost follows the curve, not the image.
    """
    h, w = rgb.shape[:2]
    u = np.clip(u, 0, w - 1)
    v = np.clip(v, 0, h - 1)
    col = np.minimum(u.astype(np.intp), max(w - 2, 0))
    row = np.minimum(v.astype(np.intp), max(h - 2, 0))
    fu, fv = (u - col)[..., None], (v - row)[..., None]
    right, below = np.minimum(col + 1, w - 1), np.minimum(row + 1, h - 1)
    mixed = (1 - fv) * ((1 - fu) * rgb[row, col] + fu * rgb[row, right])
    mixed += fv * ((1 - fu) * rgb[below, col] + fu * rgb[below, right])
    return mixed * (255.0 / np.iinfo(rgb.dtype).max)


def faint_runs(
    smooth: NDArray[np.uint8],
    pieces: tuple[NDArray, NDArray],
    where: NDArray,
    label: NDArray,
    level: NDArray,
    strong: NDArray,
) -> list[NDArray[np.int64]]:
    """The pixels, as indices into `where`, that carry lines on; a list for each run.

    smooth: (H, W) uint8, 1 in the strong mask
    pieces: the strong mask's flat pixels, in order, and the connected piece of each, from 1
    where, label, level: (P,) flat indices of all that has the pen's hue, in order, the connected
        mark each belongs to, and how strong it is
    strong: (P,) strength of that mark
    """
    low = level > FAINT * strong
    firm = _without_islands(smooth, where, label, pieces)
    weak = np.flatnonzero(low & (firm.ravel()[where] == 0))
    far = weak[~_near(firm, where[weak])] if len(weak) >= LEAST_PIXELS else weak
    if not LEAST_PIXELS <= len(far) <= MOST_PIXELS:
        return []
    width = smooth.shape[1]
    runs = []
    for pixels in _connected(where[far], width):
        rows, cols = np.divmod(pixels, width)
        box = _around(rows, cols, smooth.shape)
        if len(pixels) >= LEAST_PIXELS and _leads_on(rows, cols, firm, box):
            runs.append(_grown(pixels, where, level, weak, box, width))
    return runs


def _without_islands(
    smooth: NDArray[np.uint8], where: NDArray, label: NDArray, pieces: tuple[NDArray, NDArray]
) -> NDArray[np.uint8]:
    """Without the specks that a line close to the threshold breaks into, beside a larger piece."""
    bright, piece = pieces
    area = np.bincount(piece)
    owner = np.zeros(len(area), label.dtype)  # the mark that each piece is of
    owner[piece] = label[np.searchsorted(where, bright)]
    largest = np.zeros(int(label.max()) + 1, area.dtype)
    np.maximum.at(largest, owner, area)
    island = (area < ISLAND_PIXELS) & (largest[owner] >= ISLAND_PIXELS)
    if not island[piece].any():
        return smooth
    firm = smooth.copy()
    firm.ravel()[bright[island[piece]]] = 0
    return firm


def _near(mask: NDArray[np.uint8], flat: NDArray) -> NDArray[np.bool_]:
    """Whether flat pixels lie within `AWAY_PX` of a mask."""
    import cv2

    rows, cols = np.divmod(flat, mask.shape[1])
    box = _around(rows, cols, mask.shape)
    size = 2 * AWAY_PX + 1
    wide = cv2.dilate(mask[box], np.ones((size, size), np.uint8))
    return wide[rows - box[0].start, cols - box[1].start] > 0


def _connected(flat: NDArray, width: int) -> list[NDArray]:
    """Flat pixels, split into connected groups."""
    import cv2

    rows, cols = np.divmod(flat, width)
    crop = np.zeros((np.ptp(rows) + 1, np.ptp(cols) + 1), np.uint8)
    at = (rows - rows.min(), cols - cols.min())
    crop[at] = 1
    label = cv2.connectedComponents(crop, connectivity=8)[1][at]
    return [flat[label == k] for k in range(1, int(label.max()) + 1)]


def _around(rows: NDArray, cols: NDArray, shape: tuple[int, ...]) -> tuple[slice, slice]:
    reach = AWAY_PX + JOIN_PX + 2 * STRETCH_PX
    return (
        slice(max(int(rows.min()) - reach, 0), min(int(rows.max()) + reach + 1, shape[0])),
        slice(max(int(cols.min()) - reach, 0), min(int(cols.max()) + reach + 1, shape[1])),
    )


def _leads_on(rows: NDArray, cols: NDArray, smooth: NDArray, box: tuple[slice, slice]) -> bool:
    """Whether a faint group is a line that carries on where a strong line ends."""
    origin = np.array([box[1].start, box[0].start])
    crop = np.zeros((box[0].stop - box[0].start, box[1].stop - box[1].start), np.uint8)
    crop[rows - origin[1], cols - origin[0]] = 1
    branches, junctions = branches_of(*np.nonzero(thin(crop)), crop.shape[1])
    strong = smooth[box]
    bone = thin(np.ascontiguousarray(strong))
    if junctions or len(branches) != 1 or not bone.any():
        return False
    path, pen = branches[0].path, strong.sum() / bone.sum()
    if branches[0].length < LEAST_PX or len(rows) > BROADER * pen * (branches[0].length + pen):
        return False
    skeleton = np.column_stack(np.nonzero(bone)[::-1])
    ends = _free_ends(bone)
    return any(_continues(run, end, skeleton) for run in (path, path[::-1]) for end in ends)


def _free_ends(bone: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(N, 2) pixels (u, v) where a skeleton ends."""
    import cv2

    count = cv2.filter2D(bone.view(np.uint8), -1, np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT)
    return np.column_stack(np.nonzero(bone & (count == 2))[::-1])


def _continues(run: NDArray, end: NDArray, skeleton: NDArray) -> bool:
    """Whether a faint path begins near a strong line's end and all three directions agree."""
    across = (run[0] - end).astype(float)
    distance = float(np.hypot(*across))
    if not 0 < distance <= AWAY_PX + JOIN_PX:
        return False
    stretch = run[: STRETCH_PX + 1]
    onward = (stretch[-1] - stretch[0]).astype(float)
    away = np.hypot(*(skeleton - end).T)
    inner = (end - skeleton[away <= STRETCH_PX].mean(0)).astype(float)
    least = np.cos(np.radians(MAX_TURN_DEG))
    pairs = ((across, onward), (inner, onward), (inner, across))
    return all(a @ b > least * np.hypot(*a) * np.hypot(*b) for a, b in pairs)


def _grown(
    run: NDArray, where: NDArray, level: NDArray, weak: NDArray, box: tuple, width: int
) -> NDArray[np.int64]:
    """The run with what is half as strong as it around it, up to the strong mask."""
    import cv2

    crop = np.zeros((box[0].stop - box[0].start, box[1].stop - box[1].start), np.uint8)
    rows, cols = np.divmod(run, width)
    crop[rows - box[0].start, cols - box[1].start] = 1
    size = 2 * (AWAY_PX + 1) + 1
    crop = cv2.dilate(crop, np.ones((size, size), np.uint8))
    own = np.quantile(level[np.searchsorted(where, run)], 0.9)
    rows, cols = np.divmod(where[weak], width)
    rows, cols = rows - box[0].start, cols - box[1].start
    inside = (rows >= 0) & (rows < crop.shape[0]) & (cols >= 0) & (cols < crop.shape[1])
    near = inside.copy()
    near[inside] = crop[rows[inside], cols[inside]] > 0
    return weak[near & (level[weak] > 0.5 * own)]
