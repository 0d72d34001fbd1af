"""Which ends of lines belong together over a pen lift, and the chains that they make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.marks import Mark

TANGENT_PX = 14.0  # length of line from which an end's direction is taken
MAX_TURN_DEG = 60.0  # between the directions on both sides of a gap
MAX_ASIDE_DEG = 45.0  # between a direction and the gap itself
PIXEL_NOISE = 2.0
INK_WIDTHS, INK_PX, INK_STEP_PX = 2.0, 6.0, 0.25  # how far beyond a thinned end ink is looked for
EDGE_PX = 0.5  # by which a gap between inked pixels may seem wider than it is

PARALLEL_DEG = 15.0  # tangents nearer to parallel meet nowhere in particular
# A handle's size at most; its border's and its middle's grey; pixels of either.
HANDLE_PX, HANDLE_GREY, HANDLE_PIXELS = 16.0, (60.0, 225.0), 6


@dataclass(frozen=True, eq=False)
class End:
    """An end of a line's path: the line's number, whether it is the last point, and its pen."""

    piece: int
    last: bool
    at: NDArray
    outward: NDArray
    mark: Mark
    ink: float = 0.0  # how far the ink runs on beyond `at`


def ends_at(piece: int, path: NDArray, mark: Mark) -> list[End]:
    """Both ends of a path, with the direction in which it would go on; none of a short one."""
    reach = min(int(TANGENT_PX), len(path) - 1)
    if reach < 3:
        return []
    skip = reach // 6  # thinning, and what hides the line, bend its last pixels
    out = []
    for last, run in ((False, path[skip : reach + 1]), (True, path[::-1][skip : reach + 1])):
        outward = _direction(run)
        out.append(End(piece, last, path[-1 if last else 0], outward, mark))
    return out


def ink_beyond(end: End, mask: NDArray[np.bool_]) -> float:
    """How far the ink runs on from a thinned end [px]: thinning takes half a width, or more."""
    t = np.arange(0.0, INK_WIDTHS * end.mark.width_px + INK_PX, INK_STEP_PX)
    u, v = np.rint(end.at + t[:, None] * end.outward).astype(int).T
    on = (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
    on[on] = mask[v[on], u[on]]
    return float(t[np.argmin(on)] if not on.all() else t[-1])


def _direction(run: NDArray) -> NDArray:
    """Unit direction at the first point of a run, pointing away from the rest of it."""
    t = np.arange(len(run), dtype=float)
    degree = 2 if len(run) > 7 else 1  # a parabola follows a bend up to the end
    slope = np.polynomial.polynomial.polyfit(t, run, degree)[1]
    return -slope / np.hypot(*slope)


def joined_ends(
    ends: list[End], paths: list[NDArray], max_gap: float, rgb: NDArray
) -> list[tuple[End, End]]:
    """The pairs that belong together, the surest first; an end with two good partners has none."""
    costs: dict[tuple[int, int], float] = {}
    rivals: dict[int, list[tuple[float, tuple[int, int]]]] = {}
    for pair in _near(ends, max_gap):
        cost = _cost(ends[pair[0]], ends[pair[1]], paths, max_gap, rgb)
        if cost is not None:
            costs[pair] = cost
            for end in pair:
                rivals.setdefault(end, []).append((cost, pair))
    joined, used = [], set()
    for pair, cost in sorted(costs.items(), key=lambda item: (item[1], item[0])):
        others = [c for end in pair for c, other in rivals[end] if other != pair]
        if used & set(pair) or any(c < 1.5 * cost for c in others):
            continue
        used |= set(pair)
        joined.append((ends[pair[0]], ends[pair[1]]))
    return joined


def _near(ends: list[End], max_gap: float) -> list[tuple[int, int]]:
    """Pairs of ends that may lie within `max_gap` of each other, in order."""
    if len(ends) < 2:
        return []
    from scipy.spatial import cKDTree

    reach = max_gap + EDGE_PX + 2 * max(e.ink for e in ends)
    return sorted(cKDTree([e.at for e in ends]).query_pairs(reach))


def _cost(a: End, b: End, paths: list[NDArray], max_gap: float, rgb: NDArray) -> float | None:
    width = (a.mark.width_px + b.mark.width_px) / 2
    across = b.at - a.at
    distance = float(np.hypot(*across))
    gap = distance - a.ink - b.ink
    if gap > max_gap + EDGE_PX or not same_pen(a.mark, b.mark):
        return None
    if min(len(paths[a.piece]), len(paths[b.piece])) + width < gap:
        return None
    if a.piece == b.piece and len(paths[a.piece]) < 3 * distance + 10:
        return None
    doubt = np.degrees(np.arctan2(PIXEL_NOISE, distance))  # a pixel aside is an angle, up close
    turn = angle_deg(a.outward, -b.outward)
    aside = max(angle_deg(a.outward, across), angle_deg(-b.outward, across)) - doubt
    if distance <= width:  # what lies across the line bends thinned tips that all but touch
        aside = 0.0
    bent = turn > MAX_TURN_DEG or aside > MAX_ASIDE_DEG
    if bent and not under_handle((a.at, a.outward), (b.at, b.outward), rgb):
        return None
    return distance * (1 + (turn + max(aside, 0.0)) / 45)


def under_handle(
    first: tuple[NDArray, NDArray], second: tuple[NDArray, NDArray], rgb: NDArray
) -> bool:
    """Whether two ends' tangents meet in a small bright square with a dark border."""
    (a, out), (b, back) = first, second
    sides = np.column_stack([out, -back])
    if abs(np.linalg.det(sides)) < np.sin(np.radians(PARALLEL_DEG)):
        meet, ways = (a + b) / 2, np.zeros(2)
    else:
        ways = np.linalg.solve(sides, b - a)
        meet = a + ways[0] * out
    size = np.hypot(*(b - a))
    if size > HANDLE_PX or not (ways >= -2).all() or not (ways <= size + 2).all():
        return False
    u, v = np.rint((meet + (a + b) / 2) / 2).astype(int)
    reach = int(size // 2) + 2
    grey = rgb[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1].mean(2)
    grey = grey * (255.0 / np.iinfo(rgb.dtype).max)
    bright = (grey > HANDLE_GREY[1]).sum()
    return bool(bright >= HANDLE_PIXELS and (grey < HANDLE_GREY[0]).sum() >= HANDLE_PIXELS)


def same_pen(a: Mark, b: Mark) -> bool:
    """Whether two marks are alike in hue, strength and width."""
    hue = angle_deg(a.pen.along, b.pen.along)
    strength = a.pen.strength / b.pen.strength
    width = a.width_px / b.width_px
    return hue < 20 and 0.5 < strength < 2 and 0.5 < width < 2


def angle_deg(a: NDArray, b: NDArray) -> float:
    """Between two directions, 0..180."""
    cosine = np.dot(a, b) / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def chains_of(
    count: int, closed: list[bool], joins: list[tuple[End, End]]
) -> list[tuple[list[tuple[int, bool]], bool]]:
    """Pieces in order, each with whether it runs backwards; and whether the chain is a ring."""
    link = {}
    for a, b in joins:
        link[a.piece, a.last] = (b.piece, b.last)
        link[b.piece, b.last] = (a.piece, a.last)
    chains, seen = [], {i for i in range(count) if closed[i]}
    starts = [(i, last) for i in range(count) for last in (False, True) if (i, last) not in link]
    starts += [(i, False) for i in range(count)]  # what is left are rings
    for piece, entry in starts:
        if piece in seen:
            continue
        chain, ring = [], False
        while True:
            seen.add(piece)
            chain.append((piece, entry))
            onward = link.get((piece, not entry))
            if onward is None:
                break
            if onward[0] in seen:
                ring = True
                break
            piece, entry = onward
        chains.append((chain, ring))
    return chains
