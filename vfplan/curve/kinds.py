"""What a line is, by its shape and its company: a curve, or text, arrow, frame, symbol, bar.

The rules are careful in one direction: a line is set aside only where its shape says plainly that
it is no drawn curve, most often with a line at least `DOMINANT` times longer beside it. In doubt it
stays a candidate, and several candidates are the user's to choose from.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.path import is_straight

MIN_LENGTH_PX = 20.0
DOMINANT = 4.0
GLYPH_PX = 100  # height of a letter at most
SYMBOL_PX = 64  # size of a marker's sign at most
RULED = 0.8  # of a ruled line's pixels lie in one row or column; the rest are ticks
RECTANGLE = 0.07  # of its sides: how near to them a small frame runs; a small ring does not
CURLED = 1.7  # length over diagonal: a half circle has 1.57, the letter S 2
POINTERS = {"arrow": 2.0, "scale bar": 1.0}  # how many times longer is a curve
LONGER_PX, ASIDE_PX = 6, 1.5  # a head: beyond two widths of shaft, beyond half a one beside it
NEAR_WORDS_PX, THINNER = 20.0, 0.7  # a leader begins at words; its width over the curve's
WORD_PX = 50  # of line in a letter at most


def tell_apart(
    candidates: list[Candidate], mask: NDArray[np.bool_]
) -> tuple[list[Candidate], list[Candidate]]:
    """Split into what may be the curve and what is set aside, each with its kind.

    candidates: the longest first
    mask: (H, W) bool, the pen's mask
    """
    named = [replace(c, kind=_alone(c, mask)) for c in candidates]
    longest = max((c.length_px for c in named if c.kind == "curve"), default=0.0)
    named = [replace(c, kind=_beside(c, longest)) for c in named]
    named = _texts(named, longest)
    named = [replace(c, kind=_thinner(c, named)) for c in named]
    kept = [c for c in named if c.is_candidate]
    return kept, [c for c in named if not c.is_candidate]


def _alone(line: Candidate, mask: NDArray) -> str:
    """The kind that a line's own shape proves, whatever stands beside it."""
    if line.length_px < MIN_LENGTH_PX:
        return "speck"
    if _is_frame(line, mask.shape):
        return "frame"
    heads = _heads(line, mask)
    return line.kind if not heads else "arrow" if heads == 1 else "scale bar"


def _beside(line: Candidate, longest: float) -> str:
    """The kind beside the longest curve: of a small mark, and of an arrow or a scale bar.

    A straight cut whose pen dwelt at its ends looks like one of these, so none is where no curve is
    longer enough; one alone stays what it is.
    """
    if line.kind in POINTERS and 0 < longest < POINTERS[line.kind] * line.length_px:
        return line.marks[0].kind
    if not line.is_candidate or line.length_px * DOMINANT > longest:
        return line.kind
    curled = line.length_px > CURLED * np.hypot(*line.box[2:])
    if max(line.box[2:]) <= SYMBOL_PX and (line.closed or line.junctions or curled):
        return "symbol"
    return "bar" if _is_ruled(line) else line.kind


def _is_frame(line: Candidate, shape: tuple[int, ...]) -> bool:
    """Whether the line runs along a rectangle's sides, or along the border of the image."""
    import cv2

    path = line.pixels
    reach = 1.5 + line.width_px / 2
    border = np.minimum(path, np.array(shape[1::-1]) - 1 - path).min(1)
    if line.length_px > 0.5 * max(shape[:2]) and np.mean(border <= reach + 2) > 0.8:
        return True
    if not line.closed:
        return False
    rectangle = cv2.minAreaRect(path.astype(np.float32))
    near = min(1.5, RECTANGLE * min(rectangle[1]))
    corners = cv2.boxPoints(rectangle)
    off = [cv2.pointPolygonTest(corners, (u, v), True) for u, v in path.astype(float)]
    return bool(np.mean(np.abs(off) <= near) > 0.8)


def _is_ruled(line: Candidate) -> bool:
    """Whether the line is drawn straight along rows or columns, with or without ticks."""
    return all(_ruled(b.path) for m in line.marks for b in m.branches)


def _ruled(path: NDArray) -> bool:
    on_line = np.abs(path - np.median(path, axis=0)) <= 1
    return bool(on_line.mean(0).max() >= RULED or len(path) <= 3)


def _texts(candidates: list[Candidate], longest: float) -> list[Candidate]:
    """Name as text what stands in a row with others of its height."""
    rows: list[list[Candidate]] = []
    for glyph in (c for c in candidates if _is_glyph(c, longest)):
        met = [row for row in rows if any(_in_a_row(glyph.box, c.box) for c in row)]
        rows = [row for row in rows if row not in met] + [sum(met, [glyph])]
    texts = {id(c) for row in rows if _is_text(row, longest) for c in row if c.kind != "speck"}
    return [replace(c, kind="text") if id(c) in texts else c for c in candidates]


def _is_text(row: list[Candidate], longest: float) -> bool:
    small = all(DOMINANT * c.length_px <= longest for c in row)
    return len(row) >= 4 or (len(row) >= 2 and small)


def _is_glyph(line: Candidate, longest: float) -> bool:
    height = line.box[3]
    one = len(line.marks) == 1 or DOMINANT * line.length_px <= longest
    return one and 5 <= height <= GLYPH_PX and line.length_px < 12 * height + 20


def _in_a_row(a: tuple[int, ...], b: tuple[int, ...]) -> bool:
    (ua, va, wa, ha), (ub, vb, wb, hb) = a, b
    gap = max(ua, ub) - min(ua + wa, ub + wb)
    shared = min(va + ha, vb + hb) - max(va, vb)
    tall, low = max(ha, hb), min(ha, hb)
    return gap <= 1.2 * tall and shared >= 0.5 * low and tall <= 2.5 * low


def _heads(line: Candidate, mask: NDArray) -> int:
    """How many ends of a straight shaft carry a head: a tick, a cross, a dot, barbs, words."""
    import cv2
    from scipy.spatial import cKDTree

    path = _shaft(line)
    if line.closed or len(line.marks) > 1 or not _straight(path, _head(line)):
        return 0
    low = np.minimum(line.pixels.min(0), line.box[:2])  # of a faded line some lie outside its box
    high = np.maximum(line.pixels.max(0) + 1, np.add(line.box[:2], line.box[2:]))
    crop = np.ascontiguousarray(mask[low[1] : high[1], low[0] : high[0]]).view(np.uint8)
    label = cv2.connectedComponents(crop, connectivity=8)[1]
    own = label[tuple((path[len(path) // 2] - low)[::-1])]
    ink = np.vstack([np.argwhere(label == (own or -1))[:, ::-1] + low, line.pixels])
    off, at = cKDTree(path).query(ink)
    first, last = path[[len(path) // 4, 3 * len(path) // 4]]
    along = (last - first) / np.hypot(*(last - first))
    off = np.minimum(off, np.abs((ink - first) @ [-along[1], along[0]]))
    thirds = np.unique(3 * at[off > line.width_px / 2 + ASIDE_PX] // len(path))
    if 1 in thirds or (len(thirds) == 1 and not _straight(path, 0)):
        return 0
    others = [b.path for b in line.marks[0].branches if b.path is not path]
    return len(thirds) if len(thirds) > 1 or all(2 * len(b) < len(path) for b in others) else 0


def _shaft(line: Candidate) -> NDArray[np.int64]:
    return max((b.path for m in line.marks for b in m.branches), key=len)


def _thinner(line: Candidate, told: list[Candidate]) -> str:
    """The kind of a straight line beside a longer and broader curve: a leader begins at words.

    One without words is a bar where it is half as long: what it may carry on is told of.
    """
    shaft = _shaft(line)
    if (
        not (line.is_candidate or line.kind == "arrow")
        or line.closed
        or not _straight(shaft, _head(line))
    ):
        return line.kind
    broader = [
        c.length_px
        for c in told
        if c.kind == "curve" and c.length_px >= len(shaft) and line.width_px < THINNER * c.width_px
    ]
    if not broader:
        return line.kind
    small = [c.pixels for c in told if c is not line and c.length_px < WORD_PX]
    small += [b.path for m in line.marks for b in m.branches if len(b.path) < len(shaft) / 2]
    near = [
        any(np.hypot(*(glyph - end).T).min() < NEAR_WORDS_PX for glyph in small)
        for end in (shaft[0], shaft[-1])
    ]
    if sum(near) == 1:
        return "leader"
    one = line.is_candidate and len(line.marks) == 1
    return "bar" if one and max(broader) >= 2 * line.length_px else line.kind


def _head(line: Candidate) -> int:
    return 2 * round(line.width_px) + LONGER_PX


def _straight(path: NDArray, spare: int) -> bool:
    """Whether a path is straight but for so many pixels at its ends; a short one is not."""
    spare = min(spare, len(path) // 4)
    path = path[spare : len(path) - spare]
    return bool(np.hypot(*(path[-1] - path[0])) >= 8) and is_straight(path)
