"""What a line is, by its shape and its company: a curve, or text, arrow, frame, symbol, bar.

The rules are careful in one direction: a line is set aside only where its shape says plainly that
it is no drawn curve, most often with a line at least `DOMINANT` times longer beside it. In doubt it
stays a candidate, and several candidates are the user's to choose from.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import MAX_TURN_DEG, Candidate, ends_of
from vfplan.curve.path import Branch

MIN_LENGTH_PX = 20.0
DOMINANT = 4.0
GLYPH_PX = 100  # height of a letter at most
SYMBOL_PX = 64  # size of a marker's sign at most
RULED = 0.8  # of a ruled line's pixels lie in one row or column; the rest are ticks
TINY_PX, TINY_SHARE = 30.0, 1 / 16  # a stray dash or a lone letter "l"
RECTANGLE = 0.07  # of its sides: how near to them a small frame runs; a small ring does not
CURLED = 1.7  # length over diagonal: a half circle has 1.57, the letter S 2
POINTERS = {"arrow": 2.0, "scale bar": 1.0}  # and how many times shorter than the curve
TICK_PX, TICK = 6, 1.5  # a scale's ticks reach so far along it, and so far aside of it [px]
SHAFT = 0.75  # of a straight mark's path, at least
NEAR_WORDS_PX, THINNER = 20.0, 0.7  # a leader begins at words; its width over the curve's
WORD_PX = 50  # of line in a letter at most


def tell_apart(
    candidates: list[Candidate], mask: NDArray[np.bool_], max_gap_px: float
) -> tuple[list[Candidate], list[Candidate]]:
    """Split into what may be the curve and what is set aside, each with its kind.

    candidates: the longest first
    mask: (H, W) bool, the pen's mask
    max_gap_px: how near to a curve's end an arrow may be the curve's own other part
    """
    named = [replace(c, kind=_alone(c, mask)) for c in candidates]
    longest = max((c.length_px for c in named if c.kind == "curve"), default=0.0)
    named = [replace(c, kind=_beside(c, longest)) if c.is_candidate else c for c in named]
    named = _texts(named, longest)
    named = [_doubted(c, named, max_gap_px) if c.kind in POINTERS else c for c in named]
    named = [replace(c, kind="leader") if is_leader(c, named) else c for c in named]
    kept = [c for c in named if c.is_candidate]
    return kept, [c for c in named if not c.is_candidate]


def _alone(line: Candidate, mask: NDArray) -> str:
    """The kind that a line's own shape proves, whatever stands beside it."""
    if line.length_px < MIN_LENGTH_PX:
        return "speck"
    if _is_frame(line, mask.shape):
        return "frame"
    if is_scale(line, mask):
        return "scale bar"
    if is_arrow(line, mask):
        return "arrow"
    return line.kind


def _beside(line: Candidate, longest: float) -> str:
    """The kind of a small mark beside a line that is much longer."""
    if line.length_px * DOMINANT > longest:
        return line.kind
    _, _, width, height = line.box
    small = max(width, height) <= SYMBOL_PX
    curled = line.length_px > CURLED * np.hypot(width, height)
    if small and (line.closed or line.junctions or curled):
        return "symbol"
    if line.length_px < min(TINY_PX, TINY_SHARE * longest):
        return "symbol"
    if _is_ruled(line):
        return "bar"
    return line.kind


def _is_frame(line: Candidate, shape: tuple[int, ...]) -> bool:
    """Whether the line runs along a rectangle's sides, or along the border of the image."""
    import cv2

    path = line.pixels
    reach = 1.5 + line.width_px / 2
    border = np.minimum(path, np.array(shape[1::-1]) - 1 - path).min(1)
    if line.length_px > 0.5 * max(shape[:2]) and np.mean(border <= reach + 2) > 0.8:
        return True
    if line.junctions:  # a grid: ruled, and closed somewhere
        sides = [b for b in line.marks[0].branches if not any(b.free)]
        return len(sides) > 1 and _is_ruled(line)
    if not line.closed:
        return False
    centre, size, angle = cv2.minAreaRect(path.astype(np.float32))
    turn = np.radians(angle)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    from_side = np.abs(np.abs((path - centre) @ axes.T) - np.array(size) / 2)
    inside = np.abs((path - centre) @ axes.T) <= np.array(size) / 2 + 1
    near = min(1.5, RECTANGLE * min(size))
    on_side = ((from_side <= near) & inside[:, ::-1]).any(1)
    return bool(on_side.mean() > 0.8)


def _is_ruled(line: Candidate) -> bool:
    """Whether the line is drawn straight along rows or columns, with or without ticks."""
    return all(_ruled(b.path) for m in line.marks for b in m.branches)


def _ruled(path: NDArray) -> bool:
    on_line = np.abs(path - np.median(path, axis=0)) <= 1
    return bool(on_line.mean(0).max() >= RULED or len(path) <= 3)


def _doubted(arrow: Candidate, told: list[Candidate], max_gap_px: float) -> Candidate:
    """An arrow or a scale bar no more where no curve is longer enough, or where it carries one on.

    A straight cut whose pen dwelt at one end looks like an arrow. So does half of a curve that a
    sign drawn over it cuts in two, for the ends beside the sign fork. An arrow alone stays one.
    """
    curves = [c for c in told if c.kind == "curve"]
    if not curves:
        return arrow
    pointer = any(c.length_px >= POINTERS[arrow.kind] * arrow.length_px for c in curves)
    if pointer and not any(_carries_on(arrow, c, max_gap_px) for c in curves):
        return arrow
    return replace(arrow, kind="junction" if arrow.junctions else "curve")


def _carries_on(arrow: Candidate, line: Candidate, max_gap_px: float) -> bool:
    """Whether the arrow lies where a line of its own size ends, and leads on."""
    if line.length_px > DOMINANT * arrow.length_px:
        return False
    pixels = arrow.pixels.astype(float)
    for at, outward in ends_of(line):
        away = np.hypot(*(pixels - at).T)
        far = pixels[away.argmax()] - at
        ahead = far @ outward > np.cos(np.radians(MAX_TURN_DEG)) * np.hypot(*far)
        if ahead and away.min() <= max_gap_px + line.width_px:
            return True
    return False


def _texts(candidates: list[Candidate], longest: float) -> list[Candidate]:
    """Name as text what stands in a row with others of its height."""
    boxes = [c.box for c in candidates]
    glyphs = [
        i
        for i, (c, box) in enumerate(zip(candidates, boxes, strict=True))
        if 5 <= box[3] <= GLYPH_PX
        and c.length_px < 12 * box[3] + 20
        and (len(c.marks) == 1 or DOMINANT * c.length_px <= longest)
    ]
    group = list(range(len(candidates)))
    for a in glyphs:
        for b in glyphs:
            if a < b and group[a] != group[b] and _in_a_row(boxes[a], boxes[b]):
                old, new = group[b], group[a]
                group = [new if g == old else g for g in group]
    out, rows = list(candidates), {}
    for i in glyphs:
        rows.setdefault(group[i], []).append(i)
    for i in glyphs:
        row = rows[group[i]]
        small = all(DOMINANT * candidates[j].length_px <= longest for j in row)
        if candidates[i].kind != "speck" and (len(row) >= 4 or (len(row) >= 2 and small)):
            out[i] = replace(candidates[i], kind="text")
    return out


def _in_a_row(a: tuple[int, ...], b: tuple[int, ...]) -> bool:
    (ua, va, wa, ha), (ub, vb, wb, hb) = a, b
    gap = max(ua, ub) - min(ua + wa, ub + wb)
    shared = min(va + ha, vb + hb) - max(va, vb)
    tall, low = max(ha, hb), min(ha, hb)
    return gap <= 1.2 * tall and shared >= 0.5 * low and tall <= 2.5 * low


def is_scale(line: Candidate, mask: NDArray) -> bool:
    """A straight shaft with a tick, a cross or a dot at both ends: a scale bar, a calliper."""
    import cv2

    if line.closed or len(line.marks) > 1:
        return False
    u, v, width, height = line.box
    reach = 2 * round(line.width_px) + TICK_PX
    top, left = max(v - reach, 0), max(u - reach, 0)
    crop = mask[top : v + height + reach, left : u + width + reach].view(np.uint8)
    label = cv2.connectedComponents(crop, connectivity=8)[1]
    path = max((b.path for b in line.marks[0].branches), key=len)
    if not _mostly_straight(path):
        return False
    begin, end = path[len(path) // 4] - [left, top], path[3 * len(path) // 4] - [left, top]
    ink = np.column_stack(np.nonzero(label == label[begin[1], begin[0]])[::-1])
    along = (end - begin) / np.hypot(*(end - begin))
    t = (ink - begin) @ along
    x = (ink - begin) @ [-along[1], along[0]]
    t -= t.min()
    head, tail = t < reach, t > t.max() - reach
    shaft = ~head & ~tail
    if not shaft.any() or np.abs(x[shaft]).max() > line.width_px + 0.02 * t.max() + 1:
        return False
    across = [side * x[end] for end in (head, tail) for side in (1, -1)]
    return min(part.max() for part in across) > line.width_px / 2 + TICK


def is_arrow(line: Candidate, mask: NDArray) -> bool:
    """A straight shaft with two barbs, or with a filled head, at one end."""
    if line.closed or len(line.marks) > 1:
        return False
    branches = sorted(line.marks[0].branches, key=lambda b: -b.length)
    shaft = branches[0].path
    if not _straight(shaft):
        return False
    if line.junctions:
        barbs = branches[1:]
        tip = np.mean(line.junctions, axis=0)
        near = all(np.hypot(*(np.array(j) - tip)) < 2.5 * line.width_px for j in line.junctions)
        short = all(b.length < 0.5 * branches[0].length for b in barbs)
        return (
            near and short and 2 <= len(barbs) <= 4 and not all(_carries(b, shaft) for b in barbs)
        )
    half = _half_widths(line, mask)
    usual = np.median(half)
    head = half > 1.6 * usual + 0.5
    ends = np.r_[head[: len(head) // 3], head[-(len(head) // 3) :]]
    return bool(ends.sum() >= 3 and ends.sum() == head.sum())


def is_leader(line: Candidate, told: list[Candidate]) -> bool:
    """A straight line, thinner than the longest curve and shorter by half, that words begin."""
    if not line.is_candidate or line.closed:
        return False
    shaft = max((b.path for m in line.marks for b in m.branches), key=len)
    curve = max((c for c in told if c.kind == "curve"), key=lambda c: c.length_px, default=line)
    thin = line.width_px < THINNER * curve.width_px
    if not (thin and POINTERS["arrow"] * len(shaft) <= curve.length_px and _mostly_straight(shaft)):
        return False
    small = [c.pixels for c in told if c is not line and c.length_px < WORD_PX]
    small += [b.path for m in line.marks for b in m.branches if len(b.path) < len(shaft) / 2]
    near = [
        sum(np.hypot(*(glyph - end).T).min() < NEAR_WORDS_PX for glyph in small)
        for end in (shaft[0], shaft[-1])
    ]
    return max(near) >= 1 and min(near) == 0


def _carries(branch: Branch, shaft: NDArray) -> bool:
    """Whether a branch merely carries the shaft on."""
    along, way = shaft[-1] - shaft[0], branch.path[-1] - branch.path[0]
    size = np.hypot(*way) * np.hypot(*along)
    return bool(size and abs(way @ along) > 0.95 * size)


def _straight(path: NDArray) -> bool:
    return bool(_on_chord(path, 0, len(path) - 1).all())


def _mostly_straight(path: NDArray) -> bool:
    """Whether a path is straight but for hooks at its ends."""
    return bool(_on_chord(path, len(path) // 4, 3 * len(path) // 4).mean() > SHAFT)


def _on_chord(path: NDArray, first: int, last: int) -> NDArray[np.bool_]:
    """(M,) what lies on the straight line between two points of a path; of a short one nothing."""
    chord = (path[last] - path[first]).astype(float)
    length = np.hypot(*chord)
    if length < 8:
        return np.zeros(len(path), bool)
    aside = np.abs((path - path[first]) @ np.array([-chord[1], chord[0]])) / length
    return aside < 1.2 + 0.02 * length


def _half_widths(line: Candidate, mask: NDArray) -> NDArray:
    """(M,) distance of each path pixel from the mark's edge [px]."""
    import cv2

    path = line.pixels  # of a faded line, some lie outside the box of its mask
    left, top = np.maximum(path.min(0) - 1, 0)
    right, bottom = path.max(0) + 2
    reach = int(np.ceil(line.width_px))
    left, top = max(left - reach, 0), max(top - reach, 0)
    crop = mask[top : bottom + reach, left : right + reach].view(np.uint8)
    distance = cv2.distanceTransform(np.pad(crop, 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    return distance[path[:, 1] - top, path[:, 0] - left]
