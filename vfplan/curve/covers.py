"""Whether something drawn later hides where a line goes on: a coloured patch, a box, a panel.

Another colour is seen at once. What has none cuts the ink off along its own outline, which goes on
into the ground to one side of the end at least: there it is parted in two, sharply, by level or by
texture. How much it is parted is held against as many places along the same line, so that the
picture itself says what its bones and its noise do. Where it ends in a thin frame, or the line runs
along others, a box, disc or panel in white, black or grey is told as a drawn thing: level, plain in
shape, as its outline is nearly its own convex hull, and sharp nearly all round. An end that is
surely round, a dot or a point is the pen's own, if what lies beyond is not clearer yet. Under a
half transparent cover ink goes on, fainter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.boxes import boxed
from vfplan.curve.candidates import Candidate
from vfplan.curve.ends import CUT_OFF
from vfplan.curve.pen import Pen, sample_pixels
from vfplan.curve.profile import FOREIGN, LUMINANCE
from vfplan.curve.ridge import Centreline

WIDE, NOISE = 24, 0.5  # px around an end; levels of colour there, as JPEG's, not of clean ground
STRETCH, OVER_PX = 6, 4.0  # points back, px beyond a line's half width: the way ahead of an end
VEILED, FULL = (0.05, 0.12), 0.6  # of the pen's strength, and in JPEG: more is a dot
VEIL_PX = (2.0, 10.0)  # ahead
# A drawn area: grey levels that its own differ by, one after the other; in JPEG. Then pixels to
# either side that are looked at.
LEVELS = (1.0, 2.0), (2.5, 5.0)
AHEAD_PX, REACH_PX, AROUND = 4.0, 5.5, 160  # beyond the ink: where it is looked for, and begins
LEVEL_SHARE, GREY = 0.3, 3.0  # of the pixels there, at least; times what its levels differ by
CONVEX, FILLED = 0.9, 0.5  # as boxes and discs are, words on them or none
LEAST_AREA, LEAST_EDGE = 150, 25  # pixels
STEP, SHARP, EDGED = (8.0, 15.0), (0.8, 0.75), 0.5  # levels; of the change 2 px on; of the edge
OUTWARD_PX, BLUR_PX = np.arange(0.0, 6.1, 0.5), 1.5
# Rays from an end that may part the ground: their lean [rad], how far before or beyond the ink's
# own [px]; as far along it, from so far off the ink; what lies so far across it [px].
LEAN, SHIFT_PX = np.radians(np.arange(-60, 61, 15)), np.array([-0.75, 0.0, 0.75])
ALONG_PX, OFF_INK_PX = np.arange(0.0, 8.0, 1.4), 1.5
DEPTH_PX = np.array([-2.5, -1.6, -0.75, 0.75, 1.6, 2.5])
ENDS_PX, PLACES = 20, 24  # from the ends, where along the line the same is looked for
# More than anywhere there, and of a box's outline; then where the end is surely the pen's own.
BROKEN, BOXED = (0.36, 0.5), (0.63, 0.9)
BORDER_PX = 30.0  # of a straight border that is sharp beyond doubt
SMOOTH = -0.5  # what the ground may lack of a break where something drawn begins
INKED = 0.3  # of the pen's strength: a ray on which other ink lies tells nothing
LEVEL, ROUGH = 0.6, 3.0  # of grey: what rounding spreads, and what is no change


def covered_ends(rgb: NDArray, line: Candidate, found: Centreline) -> list[str]:
    """A warning for each end of a measured open line that something may hide, or that is odd.

    Where a cover is seen, that the ink is cut off says no more.
    """
    if line.closed or len(found.points) <= STRETCH:
        return []
    pen, width, warnings = line.mark.pen, line.width_px, []
    at, inner = found.points[[0, -1]], found.points[[STRETCH, -1 - STRETCH]]
    onward = (at - inner) / np.hypot(*(at - inner).T)[:, None]
    cut = at + [_ink_beyond(rgb, pen, width, *end) * end[1] for end in zip(at, onward, strict=True)]
    broken = _breaks(rgb, pen, found.points, width, cut, onward)
    for k in np.flatnonzero(~np.array(line.cut)):
        what = _cover(rgb, pen, width, at[k], onward[k])
        if not what:
            noisy = _noisy(rgb, pen, at[k])
            what = _cut_by(rgb, pen, width, cut[k], onward[k], noisy, broken[k], found.own_ends[k])
        odd = [phrase for phrase in found.odd[k] if not (what and phrase == CUT_OFF)]
        if what:
            odd.insert(0, f"lies where {what}: what that hides of it is not followed")
        if odd:
            u, v = at[k]
            warnings.append(f"the curve's end at ({u:.0f}, {v:.0f}) {'; it '.join(odd)}")
    return warnings


def _cut_by(
    rgb: NDArray,
    pen: Pen,
    width: float,
    cut: NDArray,
    onward: NDArray,
    noisy: bool,
    broken: float,
    own: bool,
) -> str:
    """What without a colour of its own begins where the ink is cut; empty where nothing does."""
    if broken > BROKEN[own]:
        return "the ground changes more sharply than anywhere along the line"
    outline, border = boxed(rgb, pen, cut, onward)
    if outline > BOXED[own] or border > BORDER_PX:
        return "a side of a box passes"
    if broken > SMOOTH and not own and _meets_drawn(rgb, width, cut, onward, noisy):
        return "an evenly grey, white or black area with a sharp edge begins"
    return ""


def _cover(rgb: NDArray, pen: Pen, width: float, at: NDArray, onward: NDArray) -> str:
    """What of another colour, or faintly of its own, begins at an end; empty where nothing does."""
    ahead = at + np.arange(1.0, width + OVER_PX)[:, None] * onward
    pixels = sample_pixels(rgb, *ahead.T)
    foreign = np.maximum(np.abs(pixels @ pen.across), -pixels @ pen.along)
    if (foreign > FOREIGN * pen.strength).sum() >= 2:
        return "something of another colour begins"
    if _shows_through(rgb, pen, width, at, onward, VEILED[_noisy(rgb, pen, at)]):
        return "something that its ink shows through faintly begins"
    return ""


def _noisy(rgb: NDArray, pen: Pen, at: NDArray) -> bool:
    """Whether there is colour around a place, as JPEG leaves it."""
    around = at + np.mgrid[-WIDE : WIDE + 1 : 3, -WIDE : WIDE + 1 : 3].reshape(2, -1).T
    tint = np.abs(sample_pixels(rgb, *around.T) @ pen.across)
    return bool(np.quantile(tint, 0.8) > NOISE)


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


def _breaks(
    rgb: NDArray, pen: Pen, points: NDArray, width: float, cut: NDArray, onward: NDArray
) -> NDArray[np.float64]:
    """How much more abruptly the ground changes at both ends' cuts than anywhere along the line.

    From a place beside the line the ground is parted in two by rays at many angles. What parts it
    is how much likelier two normal distributions make the grey levels on both sides of a ray than
    one, and how much of that change falls to the ray itself; and so at places along the line.
    """
    spare = min(ENDS_PX, len(points) // 4)
    along = np.linspace(spare, len(points) - spare - 1, PLACES).astype(int)
    way = points[along] - points[along - 1]
    at = np.vstack([cut, points[along]])
    ahead = np.vstack([onward, way / np.hypot(*way.T)[:, None]])
    out, on = _across_rays(width)
    aside = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    places = at[:, None, None] + on[..., None] * ahead[:, None, None]
    places = np.stack([places + side * out[..., None] * aside[:, None, None] for side in (1, -1)])
    read = sample_pixels(rgb, *np.moveaxis(places, -1, 0))
    read = read.reshape(2, len(at), len(out), -1, len(DEPTH_PX), 3)
    inked = (read @ pen.along > INKED * pen.strength).any((-1, -2))
    parted = np.where(inked, 0.0, _parted(read @ LUMINANCE)).max((0, 2))
    return parted[: len(cut)] - parted[len(cut) :].max()


def _across_rays(width: float) -> tuple[NDArray, NDArray]:
    """(E, Q * D) places across rays from a line of this width: so far aside, so far ahead [px]."""
    lean, shift = (g.reshape(-1, 1, 1) for g in np.meshgrid(LEAN, SHIFT_PX))
    off = (width / 2 + OFF_INK_PX) / np.cos(lean) + ALONG_PX[:, None]
    aside = off * np.cos(lean) - DEPTH_PX * np.sin(lean)
    ahead = off * np.sin(lean) + DEPTH_PX * np.cos(lean) + shift
    return aside.reshape(len(lean), -1), ahead.reshape(len(lean), -1)


def _parted(grey: NDArray) -> NDArray[np.float64]:
    """How surely (..., Q, D) levels part in the middle of D: by their spread, and sharply there."""
    half = grey.shape[-1] // 2
    spread = (
        np.log(g.var((-1, -2)) + LEVEL**2) for g in (grey, grey[..., :half], grey[..., half:])
    )
    both, *parts = spread
    step = np.abs(np.diff(grey.mean(-2), axis=-1))
    slow = np.maximum(step[..., : half - 1].max(-1), step[..., half:].max(-1))
    sharp = np.log((step[..., half - 1] + ROUGH) / (slow + ROUGH))
    return np.minimum(both - sum(parts) / 2, sharp)


def _meets_drawn(rgb: NDArray, width: float, cut: NDArray, onward: NDArray, noisy: bool) -> bool:
    """Whether ink stops at something level, plain in shape and sharp all round."""
    low = np.maximum(np.rint(cut).astype(int) - AROUND, 0)
    u, v = np.maximum(np.rint(cut).astype(int) + AROUND + 1, 0)
    near = np.ascontiguousarray(rgb[low[1] : v, low[0] : u])
    if near.dtype != np.uint8:
        near = (near * (255.0 / np.iinfo(rgb.dtype).max)).astype(np.float32)
    for within in LEVELS[noisy]:
        area = _level_area(near, cut - low + AHEAD_PX * onward, width, within)
        if area is None or np.hypot(*(area[0] - (cut - low)).T).min() > REACH_PX:
            continue
        if _is_sharp(near, *area, STEP[noisy], SHARP[noisy]):
            return True
    return False


def _ink_beyond(rgb: NDArray, pen: Pen, width: float, at: NDArray, onward: NDArray) -> float:
    """How far beyond an end the ink falls to half [px]."""
    aside = np.array([-onward[1], onward[0]])
    t = np.arange(-9.0, width / 2 + 6, 0.25)
    lanes = np.linspace(-width / 4, width / 4, 3)[:, None]
    places = at + t[:, None, None] * onward + lanes * aside
    ink = sample_pixels(rgb, *np.moveaxis(places, 2, 0)) @ pen.along
    ink = np.maximum(ink, 0.0).mean(1)
    ended = (t > -2) & (ink < np.median(ink[t < -3]) / 2)
    return float(t[ended.argmax()]) if ended.any() else 0.0


def _level_area(
    near: NDArray, at: NDArray, width: float, within: float
) -> tuple[NDArray, float] | None:
    """The (K, 2) outline of the level area round a place, and its level, if its shape is plain."""
    import cv2

    (u, v), reach = np.rint(at).astype(int), max(3, int(np.ceil(width / 2)))
    if min(u, v) < reach or u + reach >= near.shape[1] or v + reach >= near.shape[0]:
        return None
    here = (slice(v - reach, v + reach + 1), slice(u - reach, u + reach + 1))
    pixels = near[here].reshape(-1, 3).astype(float)
    grey = pixels[np.ptp(pixels, axis=1) <= GREY * within].mean(1)
    alike = np.abs(grey[:, None] - grey) <= within
    if alike.sum(1).max(initial=0) < LEVEL_SHARE * len(pixels):
        return None
    level = float(np.median(grey[alike[alike.sum(1).argmax()]]))
    even = cv2.inRange(near, *(np.full(3, level + side * (within + 0.5)) for side in (-1, 1)))
    _, label, boxes, _ = cv2.connectedComponentsWithStats(even, connectivity=4)
    own = max(np.unique(label[here][label[here] > 0]), key=lambda k: boxes[k, 4], default=0)
    if not own:
        return None
    outlines, _ = cv2.findContours(
        (label == own).view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    outline = max(outlines, key=len)
    size = cv2.contourArea(outline)
    plain = size >= max(LEAST_AREA, CONVEX * cv2.contourArea(cv2.convexHull(outline)))
    return (outline[:, 0], level) if plain and boxes[own, 4] >= FILLED * size else None


def _is_sharp(near: NDArray, outline: NDArray, level: float, step: float, sharp: float) -> bool:
    """Whether at most of a level area's outline the picture changes at once, and not by a ramp."""
    import cv2

    filled = cv2.fillPoly(np.zeros(near.shape[:2], np.float32), [outline[:, None]], 1.0)
    slope = np.gradient(cv2.GaussianBlur(filled, (0, 0), BLUR_PX))[::-1]
    normal = -np.column_stack([part[outline[:, 1], outline[:, 0]] for part in slope])
    normal /= np.maximum(np.hypot(*normal.T), 1e-9)[:, None]
    places = (outline[:, None] + OUTWARD_PX[:, None] * normal[:, None]).astype(np.float32)
    inside = ((places[:, 9] >= 0) & (places[:, 9] <= np.array(near.shape[1::-1]) - 1)).all(1)
    pixels = cv2.remap(near, places[..., 0], places[..., 1], cv2.INTER_LINEAR)
    off = np.abs(pixels - level).max(2)
    begins = (off >= off[:, 5:6] / 2).argmax(1)
    row, last = np.arange(len(off)), len(OUTWARD_PX) - 1
    soon, later = (off[row, np.minimum(begins + k, last)] for k in (3, 7))
    good = inside & (np.maximum(soon, later) >= step) & (soon >= sharp * later)
    return bool(good.sum() >= max(LEAST_EDGE, EDGED * inside.sum()))
