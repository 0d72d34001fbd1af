"""Whether something drawn later hides where a line goes on: a coloured patch, a box, a panel.

Another colour is seen at once. What has none cuts the ink off along its own outline: an edge as
sharp as the pen's that runs through the end and on to both sides. Where it ends in a corner there,
a box, disc or panel in white, black or grey is told as a drawn thing: level, plain in shape, as its
outline is nearly its own convex hull, and sharp nearly all round, without the ramp that air and
bone end in. An end that is surely round, a dot or a point is the pen's own, whatever lies beyond.
Under a half transparent cover ink goes on, fainter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.light import LUMINANCE
from vfplan.curve.pen import Pen, sample_pixels
from vfplan.curve.profile import FOREIGN
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
# An edge through an end: how it leans and bends [rad, 1/px], how far before or beyond the ink's own
# [px]; as far along it to either side, from so far off the ink; what lies so far across it [px].
LEAN, BEND = np.radians(np.arange(-60, 61, 7.5)), (-0.08, -0.03, 0.0, 0.03, 0.08)
SHIFT_PX, ALONG_PX, OFF_INK_PX = np.arange(-1.0, 1.1, 0.5), np.arange(4.0), 1.5
DEPTH_PX = np.array([-5, -4, -3, -2, -1, 1, 2, 3, 4, 5])
EDGE_REACH_PX = 14
CONTRAST, ROUGH = 6.0, 3.0  # times what changes over 2 px before it and behind; levels at least


def covered_ends(
    rgb: NDArray, line: Candidate, found: Centreline, origin: tuple[int, int]
) -> list[str]:
    """A warning for each end of a measured open line that something may hide."""
    if line.closed or len(found.points) <= STRETCH:
        return []
    warnings = []
    for points, own in zip((found.points, found.points[::-1]), found.own_ends, strict=True):
        at, inner = points[0], points[STRETCH]
        onward = (at - inner) / np.hypot(*(at - inner))
        what = _cover(rgb, line.mark.pen, line.width_px, at, onward, own)
        if what:
            u, v = at + origin
            warnings.append(
                f"the curve ends at ({u:.0f}, {v:.0f}) where {what} begins: what that hides of it "
                "is not followed"
            )
    return warnings


def _cover(rgb: NDArray, pen: Pen, width: float, at: NDArray, onward: NDArray, own: bool) -> str:
    """What begins at an end; empty where nothing does, or nothing without colour cuts it off."""
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
    if own:
        return ""
    if _edge_through(rgb, pen, width, at, onward):
        return "a sharp edge that runs on to both sides"
    if _meets_drawn(rgb, pen, width, at, onward, noisy):
        return "an evenly grey, white or black area with a sharp edge"
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


def _edge_through(rgb: NDArray, pen: Pen, width: float, at: NDArray, onward: NDArray) -> bool:
    """Whether an edge of brightness, sharp on both sides of the ink, runs through its end.

    What lies over a line cuts it off along its own outline; the edges of bones seldom pass there.
    """
    import cv2

    cut = at + _ink_beyond(rgb, pen, width, at, onward) * onward
    reach = int(width / 2 + EDGE_REACH_PX)
    low = np.maximum(np.rint(cut).astype(int) - reach, 0)
    u, v = np.maximum(np.rint(cut).astype(int) + reach + 1, 1)
    near = rgb[low[1] : v, low[0] : u].astype(np.float32) @ LUMINANCE.astype(np.float32)
    aside = np.array([-onward[1], onward[0]])
    steps = []
    for side in (1, -1):
        along, ahead = _across_edges(side * (width / 2 + OFF_INK_PX + ALONG_PX))
        places = (cut - low + ahead[..., None] * onward + along[..., None] * aside).astype("f4")
        flat = places.reshape(len(places), -1, 2)
        grey = cv2.remap(
            near, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE
        )
        level = grey.reshape(places.shape[:-1]).mean(1) * (255.0 / np.iinfo(rgb.dtype).max)
        slow = np.abs(level[:, 2:] - level[:, :-2])[:, [0, 1, 2, 5, 6, 7]].max(1)
        steps.append(np.abs(level[:, 5] - level[:, 4]) / np.maximum(slow, ROUGH))
    return bool(np.minimum(*steps).max() >= CONTRAST)


def _across_edges(q: NDArray) -> tuple[NDArray, NDArray]:
    """Where (E, Q, D) places lie across edges through an end, at (Q,) along them: aside, ahead."""
    lean, bend, shift = (g.reshape(-1, 1, 1) for g in np.meshgrid(LEAN, BEND, SHIFT_PX))
    q = q[:, None]
    turned = lean + np.arctan(bend * q)
    off = shift + bend * q**2 / 2
    aside = q * np.cos(lean) - off * np.sin(lean) - DEPTH_PX * np.sin(turned)
    ahead = q * np.sin(lean) + off * np.cos(lean) + DEPTH_PX * np.cos(turned)
    return aside, ahead


def _meets_drawn(
    rgb: NDArray, pen: Pen, width: float, at: NDArray, onward: NDArray, noisy: bool
) -> bool:
    """Whether an end's ink stops at something level, plain in shape and sharp all round."""
    cut = at + _ink_beyond(rgb, pen, width, at, onward) * onward
    low = np.maximum(np.rint(cut).astype(int) - AROUND, 0)
    u, v = np.maximum(np.rint(cut).astype(int) + AROUND + 1, 0)
    near = np.ascontiguousarray(rgb[low[1] : v, low[0] : u])
    if near.dtype != np.uint8:
        near = (near * (255.0 / np.iinfo(rgb.dtype).max)).astype(np.float32)
    aside = (width / 2 + 3) * np.array([-onward[1], onward[0]])
    back = [cut - low - 4 * onward, *(cut - low - 5 * onward + side * aside for side in (1, -1))]
    for within in LEVELS[noisy]:
        area = _level_area(near, cut - low + AHEAD_PX * onward, width, within)
        if area is None:
            continue
        outline, level = area
        own, left, right = (_encloses(outline, place) for place in back)
        off = np.hypot(*(outline - (cut - low)).T).min()
        if off > REACH_PX or own or (left and right):
            continue
        if _is_sharp(near, outline, level, STEP[noisy], SHARP[noisy]):
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


def _encloses(outline: NDArray, place: NDArray) -> bool:
    import cv2

    return cv2.pointPolygonTest(outline[:, None].astype(np.float32), place.tolist(), False) >= 0


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
