"""Everything drawn in the pen's colour, taken apart and told what it is.

A planned slice may hold more in red than the curve: text, arrows, swatches, panels, frames. Each
connected mark gets a kind; only those of kind "curve" and "junction" are candidates, the others
are set aside *and reported*, so that nothing disappears in silence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import Branch, branches_of, is_straight, normals, thin
from vfplan.curve.pen import Pen, chroma_at, pen_score
from vfplan.errors import CurveError

FLOOR = 18.0  # chroma below which a pixel is never pen, on 0..255: JPEG noise reaches about 12
SMOOTHING_PX = 0.8
OTHER_HUE_DEG = 22.0  # from the pen's: crimson and orange red are 15° from red, an orange bar 28°
MIN_PIXELS = 6
PANEL_PIXELS = 100
MOST_MARKS = 3000  # more is noise
MAX_WIDTH_PX = 30.0  # of a pen
MIN_ASPECT = 4.0  # a line is at least this many times longer than wide,
BROAD_PX, BROAD_ASPECT = 10.0, 8.0  # and a broad one more;
DASH_ASPECT = 1.8  # of a dash, which may belong to a dashed line
FILLED = 0.35  # of its box: more is a panel with holes
# So far beside a mark, colour so many times as strong: in JPEG, the edge of a bar in that colour.
FRINGE_PX, FRINGE = 4, (0.5, 1.6)  # of a mark in another hue than the pen's, of one in the pen's
THINNER = 0.85  # of the line's width: the corners of a dot or an arrow's head are broader
LEADER = 0.7  # of the line's ink: a straight branch of less is a sign's, drawn with another pen
FAINT = 0.2  # coverage at which a line's ink ends


@dataclass(frozen=True, eq=False)
class Mark:
    """One connected mark in the pen's colour."""

    # "curve" (a line without forks), "junction" (a line with forks), or what it was taken for:
    # "panel", "other colour", "speck"
    kind: str
    pen: Pen  # its own colour and strength, measured
    width_px: float  # its area over its length
    # Its skeleton, spurs cut off; (u, v) pixels where branches meet
    branches: tuple[Branch, ...]
    junctions: tuple[tuple[int, int], ...]
    area_px: int  # pixels
    box: tuple[int, int, int, int]  # (u, v, width, height) px
    offshoots: tuple[tuple[int, int], ...] = ()  # (u, v) in spurs that are thinner than the line

    @property
    def length_px(self) -> float:
        """Of all branches along their pixels."""
        return sum(branch.length for branch in self.branches)


def find_marks(rgb: NDArray, pen: Pen, colour: str) -> tuple[list[Mark], NDArray[np.bool_]]:
    """All marks in the pen's colour, and the (H, W) mask they were made from.

    The threshold is half of each mark's own strength, so a thin or transparent line keeps its
    width whatever stands beside it. Raises `CurveError` when there are more than anyone draws.
    """
    import cv2

    smooth, mask, where, label = _masks(rgb, pen)
    if not len(label):
        return [], mask
    count = int(label.max())
    drawn = mask.ravel()[where]
    drawings = int((np.bincount(label[drawn]) >= MIN_PIXELS).sum())
    if drawings > MOST_MARKS:
        raise CurveError(
            f"no planned curve: {drawings} marks in {colour} (at most {MOST_MARKS}): noise or a "
            "coloured picture; look in a part of it (--roi)"
        )
    left, top, width, height = cv2.boundingRect(smooth.view(np.uint8))
    bone = np.flatnonzero(thin(smooth[top : top + height, left : left + width]))
    rows, cols = np.divmod(bone, width)
    bone = (rows + top) * rgb.shape[1] + cols + left
    bones = _by_label(bone, label[np.searchsorted(where, bone)], count, rgb.shape[1])
    bodies = _by_label(where[drawn], label[drawn], count, rgb.shape[1])
    marks = [
        _mark(rgb, pen, body, bone)
        for body, bone in zip(bodies, bones, strict=True)
        if len(body[0]) >= MIN_PIXELS and len(bone[0])
    ]
    return marks, mask


def _masks(rgb: NDArray, pen: Pen) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """The smoothed picture's mask, to be thinned, and that of the picture as it is.

    Then, of the smoothed mask's pixels, the flat indices in order and the connected mark of each,
    from 1: few numbers in place of a label for every pixel of the image.
    """
    score = pen_score(rgb, pen, SMOOTHING_PX)
    smooth = (score > FLOOR).view(np.uint8)
    mask = np.zeros(smooth.shape, bool)
    where, label = _labelled(smooth)
    if len(label):
        count = int(label.max()) + 1
        level = score.ravel()[where]
        strong = _quantile_by_label(level, label, count, 0.9)[label]
        smooth.ravel()[where] = level > 0.5 * strong
        sharp, _ = chroma_at(rgb, *np.divmod(where, rgb.shape[1]), pen)
        mask.ravel()[where] = sharp > 0.5 * _quantile_by_label(sharp, label, count, 0.9)[label]
        where, label = _labelled(smooth)
    return smooth.view(bool), mask, where, label


def _labelled(mask: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    import cv2

    _, labels = cv2.connectedComponents(mask, connectivity=8, ltype=cv2.CV_32S)
    where = np.flatnonzero(mask)
    return where, labels.ravel()[where]


def _quantile_by_label(values: NDArray, label: NDArray, count: int, q: float) -> NDArray:
    order = np.lexsort((values, label))
    ends = np.cumsum(np.bincount(label, minlength=count))
    starts = np.r_[0, ends[:-1]]
    at = starts + ((ends - starts - 1) * q).astype(np.int64)
    return values[order][np.clip(at, 0, len(values) - 1)]


def _by_label(where: NDArray, label: NDArray, count: int, width: int) -> list[tuple]:
    """(rows, cols) of the pixels of each label 1..count, sorted by row, then column."""
    rows, cols = np.divmod(where, width)
    order = np.argsort(label, kind="stable")
    ends = np.cumsum(np.bincount(label, minlength=count + 1))
    cuts = [order[a:b] for a, b in pairwise(ends)]
    return [(rows[cut], cols[cut]) for cut in cuts]


def _mark(rgb: NDArray, pen: Pen, body: tuple, bone: tuple) -> Mark:
    rows, cols = body
    corner, area = (int(cols.min()), int(rows.min())), len(rows)
    box = (*corner, int(np.ptp(cols)) + 1, int(np.ptp(rows)) + 1)
    own = _own_pen(rgb, rows, cols, pen)
    branches, junctions, spurs = _pruned(*bone, rgb, own, area / len(bone[0]))
    # A path along pixels is about 5 % longer than the line; each end is short of half a width.
    length = sum(b.length for b in branches) / 1.05
    width = area / max(length, 1.0)
    width = area / (length + width / 2 * sum(map(any, (b.free for b in branches))) + 1)
    thin = _thinner(spurs, rows, cols, box, width)
    mark = Mark("", own, width, tuple(branches), tuple(junctions), area, box, thin)
    other = own.along @ pen.along < np.cos(np.radians(OTHER_HUE_DEG))
    beside = _colour_beside(rgb, rows, cols, pen) / own.strength
    other = (other and area > PANEL_PIXELS) or beside > FRINGE[not other]
    kind = "other colour" if other else _kind(mark)
    return replace(mark, kind=kind)


def _thinner(
    spurs: list[Branch], rows: NDArray, cols: NDArray, box: tuple[int, ...], width: float
) -> tuple[tuple[int, int], ...]:
    """A place in each spur that is thinner than the line: another stroke's, as a letter's is."""
    import cv2

    if not spurs:
        return ()
    ink = np.zeros((box[3] + 2, box[2] + 2), np.uint8)
    ink[rows - box[1] + 1, cols - box[0] + 1] = 1
    half = cv2.distanceTransform(ink, cv2.DIST_L2, 5)
    paths = (np.clip(s.path, box[:2], np.add(box[:2], box[2:]) - 1) for s in spurs)
    widths = ((p[0], 2 * np.median(half[tuple((p - box[:2] + 1).T[::-1])])) for p in paths)
    return tuple((int(u), int(v)) for (u, v), across in widths if across < THINNER * width)


def _colour_beside(rgb: NDArray, rows: NDArray, cols: NDArray, pen: Pen) -> float:
    """The chroma of what lies all along a mark in another hue, as beside the edge of a bar."""
    strongest = np.zeros(len(rows))
    for down, right in ((FRINGE_PX, 0), (-FRINGE_PX, 0), (0, FRINGE_PX), (0, -FRINGE_PX)):
        v, u = (rows + down).clip(0, rgb.shape[0] - 1), (cols + right).clip(0, rgb.shape[1] - 1)
        along, across = chroma_at(rgb, v, u, pen)
        other = np.abs(across) > np.tan(np.radians(OTHER_HUE_DEG)) * along
        strongest = np.maximum(strongest, np.where(other, np.hypot(along, across), 0.0))
    return float(np.median(strongest))


def _own_pen(rgb: NDArray, rows: NDArray, cols: NDArray, pen: Pen) -> Pen:
    along, across = chroma_at(rgb, rows, cols, pen)
    full = along >= np.quantile(along, 0.6)
    return Pen.of_chroma(along[full].mean() * pen.along + across[full].mean() * pen.across)


def _pruned(
    rows: NDArray, cols: NDArray, rgb: NDArray, pen: Pen, pen_width: float
) -> tuple[list[Branch], list[tuple[int, int]], list[Branch]]:
    """The skeleton without spurs, and these: short ones, as thinning leaves on a line's edge, and
    straight ones of a thinner pen, as a leader that touches the line.
    """
    gone: list[Branch] = []
    while True:
        branches, junctions = branches_of(rows, cols, rgb.shape[1])
        free = [b for b in branches if any(b.free)] if junctions else []
        spurs = [b for b in free if b.length + 1 < 1.5 * pen_width + 2]
        spurs = spurs or _leaders(free, branches, rgb, pen, pen_width)
        if not spurs or len(spurs) == len(branches):
            return branches, junctions, gone
        shortest = min(spurs, key=lambda b: (b.length, tuple(b.path[0])))
        gone.append(shortest)
        pixels = {tuple(pixel) for pixel in shortest.path.tolist()}
        keep = np.array([(u, v) not in pixels for u, v in zip(cols, rows, strict=True)])
        rows, cols = rows[keep], cols[keep]


def _leaders(
    free: list[Branch], branches: list[Branch], rgb: NDArray, pen: Pen, width: float
) -> list[Branch]:
    """The free branches that are straight and hold less ink than the longest branch."""
    longest = max(branches, key=lambda b: b.length, default=None)
    straight = [b for b in free if b is not longest and is_straight(b.path)]
    if not straight:
        return []
    most = LEADER * _ink_across(longest.path, rgb, pen, width)
    return [b for b in straight if _ink_across(b.path, rgb, pen, width) < most]


def _ink_across(path: NDArray, rgb: NDArray, pen: Pen, width: float) -> float:
    """How much of the pen's ink lies across a line: its width, blurred or not [px]."""
    from scipy.ndimage import gaussian_filter1d

    smooth = gaussian_filter1d(path.astype(float), 2.0, axis=0, mode="nearest")
    across, limit = normals(smooth, False), np.array(rgb.shape[1::-1]) - 1
    ink = np.zeros(len(path))
    for side, first in ((1, 0), (-1, 1)):
        away = side * np.arange(first, 2 * width + 2)[:, None, None]
        u, v = np.moveaxis(np.rint(smooth + away * across).astype(int).clip(0, limit), 2, 0)
        cover = chroma_at(rgb, v, u, pen)[0] / pen.strength
        ink += (cover * np.logical_and.accumulate(cover > FAINT)).sum(0)
    return float(np.median(ink))


def _kind(mark: Mark) -> str:
    if mark.area_px < MIN_PIXELS or not mark.branches:
        return "speck"
    aspect = mark.length_px / mark.width_px
    filled = mark.area_px > FILLED * mark.box[2] * mark.box[3]
    broad = mark.width_px > BROAD_PX
    small = mark.area_px <= PANEL_PIXELS
    least = DASH_ASPECT if small else BROAD_ASPECT if broad else MIN_ASPECT
    if mark.width_px > MAX_WIDTH_PX or aspect < least:
        return "speck" if small else "panel"
    if broad and filled and mark.junctions:
        return "panel"
    return "junction" if mark.junctions else "curve"
