"""A skeleton's path -> the line's centre to a few hundredths of a pixel, with its deviation.

At each point of the path the coverage is read across the line; its centroid is the line's centre
there. A smoothing spline through all of them follows the hand and not the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import tuned
from vfplan.curve.candidates import Candidate
from vfplan.curve.coverage import Ink
from vfplan.curve.profiles import End, Profiles, find_ends, read_profiles
from vfplan.errors import CurveError
from vfplan.fixture import Stroke
from vfplan.geometry import lines
from vfplan.geometry.lines import Array, Flags, Spline, evenly, gaussian, normals, runs, windows

# Pixels: standard deviation of a skeleton's pixels across the line.
SKELETON_SIGMA_PX = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredStroke(Stroke):
    """A stroke as it was measured in the ink, and what it was measured from.

    Parameters
    ----------
    ends
        The first and the last end; none of a closed line.
    profiles
        What was read along a path of M points; `None` of a skeleton.
    path
        (M, 2) the centre line at the profiles' points.
    whole
        (M,) bool, where the profiles count.
    """

    ends: tuple[End, ...]
    profiles: Profiles | None
    path: Array
    whole: Flags

    @property
    def inside(self) -> Array:
        """(2, M) how far inward from each end each profile lies; (0, M) of a closed line [px]."""
        at = np.arange(len(self.path))
        ends = zip(self.ends, (1, -1), strict=False)
        return np.array([way * (at - end.place) for end, way in ends]).reshape(-1, len(at))


def measure(ink: Ink, line: Candidate) -> MeasuredStroke:
    """The centre line of a line of ink; raises `CurveError` where too little of it shows."""
    mode = "wrap" if line.closed else "edge"
    path = skeleton = gaussian(line.path, tuned.SMOOTH_PX, mode)
    noisy = is_noisy(ink, line.path, line.width)
    smooth_px = tuned.SMOOTH_NOISY_PX if noisy else tuned.SMOOTH_PX
    # Twice: the second time the profiles stand at right angles to the line itself.
    for _ in range(2):
        if not line.closed:
            # Carried on beyond both ends, far enough to see the ink end.
            path = np.vstack([onward(path[::-1])[::-1], path, onward(path)])
        path = evenly(path, line.closed)
        normal = normals(path, line.closed)
        profiles = read_profiles(ink, path, normal, line.width)
        in_gap = line.bridged[_core.nearest(skeleton, path)[1]] & (profiles.mass < tuned.HALF)
        valid = profiles.valid & ~in_gap
        if not line.closed:
            valid = without_ink_ahead(valid)
        if valid.sum() < tuned.MIN_PROFILES:
            raise _too_little_error(line, int(valid.sum()))
        ends: tuple[End, ...] = ()
        whole = valid
        if not line.closed:
            ends = find_ends(profiles, valid, noisy)
            valid, whole = _up_to_ends(valid, ends)
            profiles = replace(profiles, valid=profiles.valid | valid)
        offset = profiles.offset(ink, path, normal, noisy)
        measured = path + offset[:, None] * normal
        spline = fit_spline(measured, whole, profiles.mass, smooth_px, line.closed)
        smooth = spline(np.arange(len(path)))
        residual = np.where(whole, offset - ((smooth - path) * normal).sum(1), 0.0)
        path = smooth
        if not line.closed:
            inner = np.flatnonzero(whole)
            path = smooth[inner[0] : inner[-1] + 1]
    deviation = deviation_of(residual, whole, smooth_px, noisy, mode)

    # Points about a pixel apart between the ends, each with its deviation.
    first, last = (end.place for end in ends) if ends else (0.0, float(len(valid)))
    at = _places(ink, line, spline, first, last)
    nearest = np.clip(np.rint(at).astype(int), 0, len(valid) - 1)
    bridged = ~valid[nearest]
    sigma = deviation[nearest]
    if not line.closed:  # Beyond the last valid point the line runs out, which is no gap.
        visible = np.flatnonzero(valid)
        bridged &= (nearest > visible[0]) & (nearest < visible[-1])
        inward = np.minimum(at - at[0], at[-1] - at)
        sigma = sigma * (1 + tuned.END_FACTOR * np.exp(-inward / smooth_px))
    points = spline(at)
    curvature = usual_bend(points, bridged)
    sigma = with_sway(Stroke(points, line.closed, sigma, bridged, width=line.width), curvature)
    # Another colour at the edge may hide a part of the line that nobody sees; what lacks there
    # moves the centre by half of it.
    lacking = np.abs(1 - profiles.mass.clip(0, 2)) * line.width / 2
    beside = np.hypot(tuned.OTHER_SIGMA_NOISY_PX if noisy else tuned.OTHER_SIGMA_PX, lacking)
    sigma = np.hypot(sigma, np.where(profiles.has_other & valid, beside, 0.0)[nearest])
    # Half of what was added for a side that another colour hides may be wrong.
    sigma = np.hypot(sigma, profiles.covered[nearest] / 4)
    if not line.closed:
        # Beyond the last whole profile the point of a drawn out pen may lie to either side.
        known = np.flatnonzero(whole)
        beyond = np.maximum(np.maximum(known[0] - at, at - known[-1]), 0)
        sideways = curvature * beyond**2 / 2
        sigma = np.hypot(sigma, sideways)
        ends = tuple(
            replace(end, sigma=float(np.hypot(end.sigma, aside)))
            for end, aside in zip(ends, sideways[[0, -1]], strict=True)
        )
    return MeasuredStroke(
        points=np.clip(points, -0.5, ink.size - 0.5),
        sigma=sigma,
        bridged=bridged,
        hidden=profiles.hidden[nearest],
        closed=line.closed,
        width=line.width,
        ends=ends,
        profiles=profiles,
        path=smooth,
        whole=whole,
    )


def usual_bend(points: NDArray, bridged: Flags) -> float:
    """How much a line with a point a pixel may bend behind a bridge [1/px]: as it does elsewhere.

    What a bridge bends itself shows nothing of the hand, and the less shows, the less is known.
    """
    seen = ~(bridged[:-2] | bridged[1:-1] | bridged[2:])
    bend = np.hypot(*np.diff(points, 2, axis=0)[seen].T)
    return tuned.SWAY * float(np.sqrt((bend**2).sum() * len(seen))) / max(1, len(bend))


def with_sway(line: Stroke, curvature: float) -> Array:
    """(P,) deviations of a line's points, with how far its bridges may lie off [px].

    curvature: a usual one [1/px]
    Raises `CurveError` where a bridge may lie farther off than it is long, which says nothing.
    """
    tip, points, sigma = int((line.width or 0) / 2), line.points, line.sigma.copy()
    ends = [] if line.closed else [0, len(points) - 1]
    for run in runs(line.bridged, line.closed):
        if len(run) == len(points) or np.isin(ends, run).any():
            continue  # The line runs out, which is no gap.
        aside = sway(curvature, len(run))
        if 2 * aside.max() > len(run):
            text = f"Nothing tells where the curve runs in a gap of {len(run)} px. Draw it there."
            raise error_at(points[middle_of(run)], text, code="gap-unknown", gap_px=len(run))
        sigma[run] = np.hypot(sigma[run], aside)
        # A corner may lie in a gap that turns otherwise than its sides foretell. The tips of the
        # pen on both sides belong to it, because a tip shows a part of the line's width.
        gap = run[0] - tip + np.arange(len(run) + 2 * tip)
        gap = gap % len(points) if line.closed else gap[(gap >= 0) & (gap < len(points))]
        sigma[gap] = np.hypot(sigma[gap], corner_sway(points, gap, line.closed, curvature))
    return sigma


def sway(curvature: float, length: int) -> Array:
    """(L,) how far an unknown curvature [1/px] moves the points of a gap with known ends [px]."""
    # A curvature of deviation k leaves k x (L - x) / 2 at x of L.
    x = np.arange(length) + 0.5
    return curvature * x * (length - x) / 2


def corner_sway(points: NDArray, gap: NDArray, closed: bool, curvature: float) -> Array:
    """(G,) how far from each point of a bridge the pen may have run, where it may hold a corner.

    0 where the sides of the bridge foretell its turn: carried on as they bend, both arrive in its
    middle in its direction. At a corner the pen may have gone straight across the gap, or straight
    on from both sides.

    points: (P, 2) of the line [px]
    gap: (G,) indices of the points of the bridge, in order
    curvature: a usual one [1/px], whose turn across the gap is expected
    """
    # The spline rounds a corner, so that its points closest to the gap show no direction.
    reach, mode = np.arange(1, tuned.TANGENT_PX + 3), "wrap" if closed else "clip"
    before = np.take(points, gap[0] - reach, axis=0, mode=mode)
    behind = np.take(points, gap[-1] + reach, axis=0, mode=mode)
    bridge, inner, middle = points[gap], reach[1:-1], (len(gap) - 1) / 2
    steps = [(before[:-2] - before[2:])[::-1], bridge[-1:] - bridge[:1], behind[2:] - behind[:-2]]
    heading = np.unwrap(np.arctan2(*np.concatenate(steps).T[::-1]))
    heading -= heading[len(inner)]
    arriving = np.polyval(np.polyfit(-inner[::-1], heading[: len(inner)], 1), middle)
    leaving = np.polyval(np.polyfit(inner, heading[len(inner) + 1 :], 1), -middle)
    turn = max(abs(heading[-1] - heading[0]), curvature * len(gap), 1e-9)
    share = np.interp((abs(arriving) + abs(leaving)) / turn, tuned.CORNER_SHARES, (0, 1))

    ways = [bridge[[0, -1]]]
    # Both headings point into the gap: start + s a = stop + t b.
    (a, start), (b, stop) = (np.polyfit(-reach[2:], side[2:], 1) for side in (before, behind))
    s, t = np.linalg.lstsq(np.column_stack([a, -b]), stop - start, rcond=None)[0]
    # Round a U-turn both go the same way, and may meet anywhere or nowhere.
    meets = s > 0 and t > 0
    if meets or a @ b > 0:
        far = np.hypot(*(stop - start)) / np.hypot(*a)
        corner = start + (min(s, far) if meets else far) * a
        ways.append(np.array([bridge[0], corner, bridge[-1]]))
    distance = np.zeros(len(gap))
    for way in ways:
        pen = evenly(way, False)
        to_bridge, nearest = _core.nearest(bridge, pen)
        np.maximum.at(distance, nearest, to_bridge)
        distance = np.maximum(distance, _core.nearest(pen, bridge)[0])
    return share * np.hypot(sway(curvature, len(gap)), distance / tuned.CORNER_SIGMAS)


def deviation_of(residual: NDArray, seen: Flags, smooth_px: float, noisy: bool, mode: str) -> Array:
    """(M,) standard deviation of a spline across the line [px], but for gaps and ends.

    residual: (M,) how far what was measured lies off the spline [px]; 0 where nothing was
    seen: (M,) bool, where something was measured
    """
    # Neighbouring residuals hang together, so that smoothing averages fewer of them. The equivalent
    # kernel of a smoothing spline averages 2 sqrt(2) times its scale in points.
    noise = np.sqrt((residual**2).sum() / seen.sum())
    if noisy:
        noise *= tuned.CORRELATED_NOISY
    noise = np.hypot(noise / np.sqrt(2 * np.sqrt(2) * smooth_px), tuned.GRID_PX)
    # What neighbouring residuals have in common is a corner that the spline cuts.
    return np.hypot(noise, gaussian(residual, smooth_px, mode))


def skeleton_line(line: Candidate) -> MeasuredStroke:
    """A line's skeleton, pixel by pixel, as a centre line."""
    return MeasuredStroke(
        points=line.path,
        sigma=np.full(len(line.path), SKELETON_SIGMA_PX),
        bridged=line.bridged,
        closed=line.closed,
        width=line.width,
        ends=(),
        profiles=None,
        path=line.path,
        whole=~line.bridged,
    )


def drawn_length(path: NDArray, closed: bool) -> float:
    """Length of the line along a path of pixels, without its stairs [px]."""
    return lines.length_of(gaussian(path, tuned.SMOOTH_PX, lines.BEYOND[closed]), closed)


def is_noisy(ink: Ink, path: NDArray, width: float) -> bool:
    """Whether there is colour a few pixels beside a line, as the noise of JPEG is."""
    normal = normals(gaussian(path, tuned.SMOOTH_PX), False)
    flank = (width / 2 + 2 * tuned.FLANK_PX) * normal
    beside = np.abs(ink.coverage_at(np.vstack([path - flank, path + flank])))
    return float(np.median(beside)) > tuned.NOISY


def _too_little_error(line: Candidate, measured_px: int) -> CurveError:
    text = (
        f"Only {measured_px} px of the line can be measured. Draw it with a stronger pen, or take "
        "its skeleton: --method skeleton."
    )
    return error_at(line.middle, text, code="too-little-ink", measured_px=measured_px)


def middle_of(rows: NDArray) -> Any:
    """Half-way along: an index of a run, a place of a path."""
    return rows[len(rows) // 2]


def error_at(place: NDArray, message: str, *, code: str, **numbers: Any) -> CurveError:
    """The refusal for what a picture shows at a place (u, v) [px], with the `numbers` behind it."""
    u, v = (float(x) for x in place)
    where = f"pixel ({u:z.0f}, {v:z.0f})"
    return CurveError(message, where=where, code=code, numbers=numbers | {"u_px": u, "v_px": v})


def _up_to_ends(valid: Flags, ends: tuple[End, End]) -> tuple[Flags, Flags]:
    """(M,) bool each: what was seen of the line, and what of it has whole profiles.

    The last stretches of drawn out pens are seen too: little ink, but no other lies there. Beyond
    both ends' whole profiles a side is lacking.
    """
    at = np.arange(len(valid))
    visible = np.flatnonzero(valid)
    between = (at >= ends[0].whole) & (at <= ends[1].whole)
    in_view = valid | (between & ((at < visible[0]) | (at > visible[-1])))
    whole = in_view & between
    return in_view, in_view if whole.sum() < tuned.MIN_PROFILES else whole


def without_ink_ahead(valid: Flags) -> Flags:
    """Valid profiles less those ahead of an end, beyond paper: other ink lies there."""
    kept = valid.copy()
    for side in (slice(None), slice(None, None, -1)):
        ahead = kept[side][: tuned.TAPER_REACH_PX][::-1]
        ahead[np.argmin(ahead) :] &= bool(ahead.all())
    return kept


def onward(path: NDArray) -> Array:
    """Steps of a pixel beyond the last point, along the arc of the line's last stretch."""
    reach = min(9, (len(path) - 1) // 2)
    last = path[-1] - path[-1 - reach]
    before = path[-1 - reach] - path[-1 - 2 * reach]
    turn = np.arctan2(before[0] * last[1] - before[1] * last[0], before @ last)
    turn = turn / max(np.hypot(*last), 1.0)
    steps = np.arange(1, tuned.TAPER_REACH_PX + 1)
    bend = reach / 2 + reach * (1 - np.exp((0.5 - steps) / reach))
    heading = np.arctan2(last[1], last[0]) + turn * bend
    return path[-1] + np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)


def fit_spline(
    points: NDArray, valid: NDArray, mass: NDArray, smooth_px: float, closed: bool
) -> Spline:
    """The smoothing spline of (M, 2) points over their index, through the valid ones.

    It is fitted twice: the second time it is smoothed less where the line bends. Where the line has
    less ink than usual it is measured less well, and counts less.
    """
    at = np.arange(len(points))
    if closed:  # Wrapped, so that the seam is as smooth as the rest.
        reach = min(len(points) // 2, int(8 * smooth_px))
        at = np.arange(-reach, len(points) + reach)
    at = at[valid[at % len(points)]]
    y = points[at % len(points)]
    weight = np.clip(mass[at % len(points)], 0.1, 1.0) ** 2
    first = lines.smoothing_spline(at, y, weight, smooth_px**4)
    scale = _smoothing_scale(first, at, smooth_px)
    if not closed:  # A smoothing spline runs out straight, which a bent line does not.
        inward = np.minimum(at - at[0], at[-1] - at)
        scale *= 1 - (1 - tuned.END_SMOOTH) * np.exp(-inward / smooth_px)
    return lines.smoothing_spline(at, y, weight * (smooth_px / scale) ** 4, smooth_px**4)


def _smoothing_scale(spline: Spline, at: NDArray, smooth_px: float) -> Array:
    """(N,) the length over which a line is smoothed [px], shorter where it bends."""
    first, second = spline(at, 1), spline(at, 2)
    cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    curvature = np.abs(cross) / np.maximum(np.hypot(*first.T), 1e-9) ** 3
    curvature = windows(curvature, tuned.BEND_REACH_PX).max(axis=1)
    return np.clip(tuned.BEND_SHARE / np.maximum(curvature, 1e-6), tuned.SMOOTH_MIN_PX, smooth_px)


def _places(ink: Ink, line: Candidate, spline: Spline, first: float, last: float) -> Array:
    """(P,) places of the spline about a pixel apart between two others, in the picture.

    A line that leaves the picture ends there, even if it would come back.
    """
    if last - first < 2:
        raise _too_little_error(line, 0)
    dense = np.linspace(first, last, 4 * round(last - first) + 1)
    curve = spline(dense)
    # It has not left while a side of it shows.
    outside = np.maximum(-0.5 - curve, curve - (ink.size - 0.5)).max(1)
    kept = max(runs(outside < line.width / 2, False), key=len, default=np.arange(0))
    inside = np.flatnonzero(outside[kept] < 0)
    if len(inside) < tuned.MIN_PROFILES:
        raise _too_little_error(line, len(inside) // 4)
    kept = kept[inside[0] : inside[-1] + 1]
    arc = lines.arc_lengths(curve[kept], False)
    even = np.linspace(0, arc[-1], max(4, round(arc[-1])) + 1)
    return np.interp(even[:-1] if line.closed else even, arc, dense[kept])
