"""Which line is the curve, or the refusal where only a person can settle it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, product
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import tuned
from vfplan.curve.candidates import (
    Candidate,
    Candidates,
    dotted_line,
    find_candidates,
    find_groups,
    find_pieces,
    gap_px,
)
from vfplan.curve.centreline import MeasuredStroke, error_at, middle_of
from vfplan.curve.coverage import Ink, Pen, Pixels, Region, colour_name, find_ink, main_pens
from vfplan.display import coordinates
from vfplan.errors import CurveError, SettingError
from vfplan.findings import Finding, doubt
from vfplan.geometry.lines import BEYOND, Array, running_median, runs, windows

# Lines that an error message describes.
DESCRIBED = 8
# Pieces of another pen's ink, the largest, among which its longest line is looked for.
MOST_PIECES = 40

Choice = int | Literal["all", "longest"] | None


def finding_at(
    place: NDArray, code: str, text: str, severity: Callable[..., Finding] = doubt
) -> Finding:
    """A finding on what the picture shows at a place (u, v) [px]."""
    u, v = (round(float(x), 1) for x in place)
    return severity(code, "extract", f"At ({coordinates((u, v))}): {text}", place_px=(u, v))


def two_runs_finding(place: tuple[float, float]) -> Finding:
    """The doubt about a line that was refused as two runs side by side, once it is chosen."""
    text = "two runs may lie side by side. Is all of it the curve?"
    return finding_at(np.array(place), "width-changes", text)


def choose_lines(
    lines: Candidates,
    passing: Candidates,
    choice: Choice,
    ink: Ink,
    pen: Pen,
    region: Region,
    max_gap_px: float,
) -> Candidates:
    """Those of the passing lines that are meant; raises `CurveError` where that is left open.

    Candidates are the longest line and those that are at least half as long. A frame is none. A
    number counts all lines, the frames last.
    """
    numbered = in_number_order(lines, ink)
    if isinstance(choice, int):
        if choice > len(numbered):
            raise CurveError(
                f"There is no line number {choice}. Choose one of the {len(numbered)} lines.",
                code="stroke-number",
                numbers={"number": choice, "lines": len(numbered)},
            )
        return [numbered[choice - 1]]
    others = [line for line in numbered if line in passing and not is_frame(line, ink)]
    candidates = [line for line in others if line.length >= tuned.RIVAL_SHARE * others[0].length]
    if not candidates:
        raise _no_line_error(numbered, ink, pen, region)
    if choice == "all":
        return candidates
    if choice is None and len(candidates) > 1:
        raise _several_error(candidates, numbered, max_gap_px)
    return candidates[:1]


def in_number_order(lines: Candidates, ink: Ink) -> Candidates:
    """The lines as `--stroke N` counts them: the longest first, and frames last."""
    return sorted(lines, key=lambda line: is_frame(line, ink))


def is_frame(line: Candidate, ink: Ink) -> bool:
    """Whether a line is a frame: no hand's curve, but a box, or a bar on the picture's border.

    It is one if it runs along the sides of the upright rectangle around it, all the way round, or
    if at least half of it lies flush with the border of the picture.
    """
    low, high = line.path.min(0), line.path.max(0)
    to_side = np.minimum(line.path - low, high - line.path).min(1)
    on_side = (to_side <= tuned.FLANK_PX).mean() >= tuned.FRAME_SHARE
    goes_round = len(line.path) >= tuned.FRAME_SHARE * 2 * (high - low).sum()
    return (on_side and goes_round) or len(on_border(line, ink)) >= line.length / 2


def on_border(line: Candidate, ink: Ink) -> Pixels:
    """(N, 2) pixels of a line's ink that lie flush with the border of the picture."""
    pixels = np.concatenate(line.pieces)
    to_border = np.minimum(pixels, ink.size - 1 - pixels).min(1)
    return pixels[(to_border == to_border.min()) & (to_border <= tuned.FLANK_PX)]


def is_level(line: Candidate) -> bool:
    """Whether nearly all of a line runs along rows and columns, as a bar or a box does."""
    size = min(2 * tuned.TANGENT_PX + 1, len(line.path))
    spans = [np.ptp(windows(axis, size, "edge"), axis=1) for axis in line.path.T]
    return (np.min(spans, axis=0) <= 1).mean() >= tuned.FRAME_SHARE


def describe(path: NDArray, closed: bool, length: float) -> str:
    """A line in words: its shape, its length, and where it is."""
    (u, v), (last_u, last_v) = path[[0, -1]]
    if closed:
        return f"closed, {length:.0f} px long, through ({u:z.0f}, {v:z.0f})"
    return (
        f"open, {length:.0f} px long, from ({u:z.0f}, {v:z.0f}) to ({last_u:z.0f}, {last_v:z.0f})"
    )


def _several_error(candidates: Candidates, numbered: Candidates, max_gap_px: float) -> CurveError:
    told = []
    for line in candidates[:DESCRIBED]:
        words = describe(line.path, line.closed, line.length)
        forks = ", forked: only the page takes it" if len(line.junctions) else ""
        told.append(f"{numbered.index(line) + 1}: {words}{forks}")
    message = (
        f"There are {len(candidates)} candidates. Choose one with --stroke N, or look in a part "
        f"of the picture with --roi: {'; '.join(told)}"
    )
    numbers: dict[str, Any] = {"candidates": len(candidates)}
    open_lines = [line for line in candidates[:DESCRIBED] if line.may_go_on]
    ends = product(combinations(open_lines, 2), product((0, -1), repeat=2))
    gaps = [(gap_px(one, end, other, at), one, end, other, at) for (one, other), (end, at) in ends]
    if gaps:
        gap, one, end, other, at = min(gaps, key=lambda found: found[0])
        u, v = (one.path[end] + other.path[at]) / 2
        message += f". Two of them end {gap:.0f} px apart at ({u:z.0f}, {v:z.0f})"
        longer_px = float(np.ceil(gap))
        if gap > max_gap_px and len(find_candidates([one, other], longer_px)) == 1:
            message += f"; --max-gap {longer_px:.0f} joins them"
        numbers |= {"gap_px": gap, "u_px": float(u), "v_px": float(v)}
    error = CurveError(f"{message}.", code="several-candidates", numbers=numbers)
    error.candidates = tuple(line.path for line in candidates)
    return error


def _no_line_error(lines: Candidates, ink: Ink, pen: Pen, region: Region) -> CurveError:
    """The refusal where the pen drew no line, or frames only."""
    if region == Region() and (ink.rgb == ink.rgb[..., :1]).all():
        return CurveError(
            "The picture is grey, so no pen can be told from it. Give a curve that was drawn as "
            "vectors: --curve FILE.",
            code="image-grey",
        )
    if lines:
        error = CurveError(
            f"The only line in {pen.name} is a frame: a box, or a bar on the picture's border. "
            "Take it all the same with --stroke 1.",
            code="only-a-frame",
        )
        error.candidates = tuple(line.path for line in lines)
        return error
    dotted = dotted_line(ink, find_groups(ink))
    if dotted is not None:
        u, v = middle_of(dotted.points)
        error = CurveError(
            f"The line in {pen.name} is dotted, {dotted.length:.0f} px long through "
            f"({u:z.0f}, {v:z.0f}). Take it as one line: vfplan review IMAGE.",
            code="line-dotted",
            numbers={"u_px": float(u), "v_px": float(v)},
        )
        error.lines = (dotted.points,)
        return error
    where, advice = "", ""
    if region != Region():
        where = " within what --roi and --exclude leave"
        advice = "Move or widen that, unless another pen drew the line. "
    return CurveError(
        f"No line was drawn in {pen.name}{where}. {advice}Name the pen's colour with --colour NAME "
        "or #rrggbb, or draw again if the pen was black, grey or white.",
        code="no-line",
        numbers={"mask_pixels": int(ink.mask.sum())},
    )


def lines_of_other_pens(ink: Ink, pen: Pen, from_px: float) -> list[tuple[str, Candidate]]:
    """The longest line of each other pen, as `#rrggbb` and line; the longest of them first.

    from_px: the length from which a line is named
    """
    found: list[tuple[str, Candidate]] = []
    known = [pen]
    for other in main_pens(ink.rgb):
        try:
            others_ink = find_ink(ink.rgb, other)
            groups = sorted(find_groups(others_ink), key=lambda group: -np.ptp(group, axis=0).max())
            lines = find_candidates(find_pieces(others_ink, groups[:MOST_PIECES]), 0.0)
            line = in_number_order(lines, others_ink)[0]
            name = colour_name(others_ink, line.path)
            own = Pen.of_colour(name)
        except (CurveError, SettingError, IndexError):  # Too many pieces, too grey, or no line.
            continue
        is_other = all(abs(own.degrees_from(pen)) > tuned.HUE_GATE_DEG for pen in known)
        if is_other and line.length >= from_px:
            found.append((name, line))
            known.append(own)
    return sorted(found, key=lambda pair: -pair[1].length)


def advice_on_pens(others: list[tuple[str, Candidate]]) -> str:
    """The lines of other pens in words, each with the option that takes it."""
    return "; ".join(
        "{:.0f} px through ({:.0f}, {:.0f}): --colour '{}'".format(line.length, *line.middle, name)
        for name, line in others[:DESCRIBED]
    )


def with_other_pens(error: CurveError, lines: Candidates, ink: Ink, pen: Pen) -> CurveError:
    """The refusal with all lines, which names much longer lines of other pens."""
    if error.code == "line-dotted":
        return error
    numbered = in_number_order(lines, ink)
    error.lines = tuple(line.path for line in numbered)
    error.forked = tuple(k for k, line in enumerate(numbered, 1) if len(line.junctions))
    own_px = numbered[0].length if lines else tuned.CRUMB_PX / 2
    others = lines_of_other_pens(ink, pen, own_px / tuned.RIVAL_SHARE)
    if others:
        name, line = others[0]
        wrong, _, advice = error.message.partition(". ")
        found = f"Longest lines of other pens: {advice_on_pens(others)}."
        error.message = f"{wrong.removesuffix('.')}. {found} {advice}".rstrip()
        u, v = (float(x) for x in line.middle)
        numbers = {"other_colour": name, "other_length_px": line.length, "u_px": u, "v_px": v}
        error.numbers = numbers | error.numbers
    return error


def refuse_junctions(line: Candidate) -> None:
    """Raise `CurveError` for a line that forks or crosses itself."""
    if len(line.junctions):
        text = (
            "The line forks or crosses itself here, so it has several ways to go on. "
            "Choose one: vfplan review IMAGE."
        )
        raise error_at(middle_of(line.junctions), text, code="line-forks")


def relative_width(curve: MeasuredStroke) -> Array:
    """(M,) the line's width at each profile over its usual width.

    The lesser of two ratios: another opacity changes the ink across the line but not its width,
    another blur its width but not the ink.
    """
    profiles = curve.profiles
    width = profiles.mass / np.maximum(profiles.peak, 1e-6)
    usable = curve.whole & ~profiles.hidden & profiles.is_line[:, profiles.core].all(1)
    # The picture need not show more of the paper beside the line than its blurred edge.
    near = np.abs(profiles.x) <= curve.width / 2 + tuned.FLANK_PX / 2
    usable = np.flatnonzero(usable & profiles.inside[:, near].all(1))
    if len(usable) < tuned.MIN_PROFILES:
        return np.ones(len(width))
    ratio = np.minimum(width / np.quantile(width[usable], tuned.USUAL_SHARE), profiles.mass)
    ratio = np.interp(np.arange(len(ratio)), usable, ratio[usable])
    return windows(ratio, round(tuned.INK_HANGS_PX), BEYOND[curve.closed]).mean(axis=1)


def changes(values: Array, half: int) -> Array:
    """(M,) by how much values change over `half` points to either side of each point."""
    change = np.zeros(len(values))
    change[half:-half] = np.abs(values[2 * half :] - values[: -2 * half])
    return change


def sudden_changes(ratio: Array) -> Array:
    """(M,) change of a relative width over a short stretch, 0 where it is not sudden.

    A pressed pen changes its width all along; a dot, a letter or a second run begins at once.
    """
    change = changes(ratio, tuned.SUDDEN_PX // 2)
    return np.where(change < tuned.AT_ONCE * np.median(change), 0.0, change)


def lasting_width(curve: MeasuredStroke) -> Array:
    """(M,) the relative width that at least half of a stretch around each profile has."""
    ratio = np.where(curve.whole, relative_width(curve), 1.0)
    run = round(max(2 * tuned.HANDLE_PX, tuned.WIDE_RUN_WIDTHS * curve.width))
    beyond = {"mode": "wrap"} if curve.closed else {"mode": "constant", "constant_values": 1.0}
    return running_median(ratio, min(run, len(ratio)), **beyond)


def refuse_two_runs(curve: MeasuredStroke) -> None:
    """Raise `CurveError` where a lasting stretch of the line grows wide at once.

    A second run may begin there beside the first.
    """
    sudden, lasting = sudden_changes(relative_width(curve)), lasting_width(curve)
    widest, place = float(lasting.max()), curve.path[lasting.argmax()]
    if widest <= tuned.WIDE or (widest - 1) * curve.width <= 1.0:
        return
    # At its ends the line falls to nothing, however evenly it was pressed.
    falls = np.array([[end.fall] for end in curve.ends]).reshape(-1, 1)
    is_inner = (curve.inside > tuned.SUDDEN_PX + curve.width / 2 + falls).all(axis=0)
    change = float(sudden[is_inner].max(initial=0.0))
    range_px = widest - float(lasting[is_inner].min(initial=1.0))
    if change < tuned.HALF * range_px:
        return
    text = (
        f"The line is {widest:.2f} times as wide here as elsewhere, so two runs may lie side by "
        "side. Look at it: vfplan review IMAGE. If one pen was pressed harder: --accept-width."
    )
    raise error_at(place, text, code="runs-side-by-side", width_ratio=widest)


def refuse_double_line(curve: MeasuredStroke) -> None:
    """Raise `CurveError` where the mean profile has a valley: two lines side by side."""
    profiles = curve.profiles
    mean = profiles.coverage[profiles.valid].mean(0)[profiles.core]
    left = np.maximum.accumulate(mean)
    right = np.maximum.accumulate(mean[::-1])[::-1]
    dip = float((np.minimum(left, right) - mean).max() / mean.max())
    if dip <= tuned.VALLEY:
        return
    text = (
        "Two lines run side by side, or only the outline of the pen's line is drawn. "
        "Look at it: vfplan review IMAGE."
    )
    raise error_at(middle_of(curve.path), text, code="double-line", dip=dip)


def refuse_long_bridge(curve: MeasuredStroke, max_gap_px: float) -> None:
    """Raise `CurveError` where more of the line is hidden than may be bridged."""
    for run in runs(curve.bridged, curve.closed):
        gap = len(run) - curve.width
        if gap > max_gap_px + tuned.FLANK_PX:
            text = (
                f"{gap:.0f} px of the line do not show here; at most {max_gap_px:g} px are bridged."
                f" If the curve goes straight on: --max-gap {np.ceil(gap):.0f}."
            )
            numbers = {"gap_px": float(gap), "max_gap_px": max_gap_px}
            raise error_at(curve.points[middle_of(run)], text, code="bridge-too-long", **numbers)


def refuse_fit_off_ink(curve: MeasuredStroke, line: Candidate) -> None:
    """Raise `CurveError` where the measured line lies off the ink that it was measured from."""
    visible = curve.points[~curve.bridged]
    distance, nearest = _core.nearest(line.path, visible)
    if not line.closed:  # Beyond the skeleton's ends the line runs on to the end of its ink.
        distance[(nearest == 0) | (nearest == len(line.path) - 1)] = 0
    if distance.max() <= line.width + tuned.FLANK_PX:
        return
    farthest = float(distance.max())
    text = (
        f"The fitted line lies {farthest:.1f} px off its ink here. Look at it: "
        "vfplan review IMAGE, or take the ink's skeleton: --method skeleton."
    )
    raise error_at(visible[distance.argmax()], text, code="fit-left-ink", distance_px=farthest)
