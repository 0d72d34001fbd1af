"""A planned slice -> the surgeon's curve in sub-pixel points, or a refusal that says why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import account, candidates, choose, tuned
from vfplan.curve.account import AccountEntry
from vfplan.curve.candidates import Candidate, Candidates
from vfplan.curve.centreline import MeasuredStroke, drawn_length, measure, skeleton_line
from vfplan.curve.coverage import Box, Ink, Pen, Region, find_ink
from vfplan.errors import CurveError, SettingError
from vfplan.findings import Finding, Findings, note
from vfplan.fixture import Stroke
from vfplan.geometry.lines import distance_to, nearest_to
from vfplan.images.read import PlannedImage, as_image

# Pen widths from the line: a place that is farther away is not meant to be on it.
REACH_WIDTHS = 3.0
# The same in pixels, for thin lines. A person clicks this well.
REACH_PX = 10.0

Place = tuple[float, float] | None


def lines_through(lines: Candidates, start: Place, end: Place) -> Candidates:
    """The lines that pass by the named places (u, v) [px].

    Raises `CurveError` where there are lines and none passes by all of the places. The error names
    the place that the nearest line misses.
    """
    errors = [_off_curve_error(line.path, line.width, start, end) for line in lines]
    if lines and all(errors):
        raise min(errors, key=lambda error: error.numbers["distance_px"])
    return [line for line, error in zip(lines, errors, strict=True) if error is None]


def cut_to(curve: MeasuredStroke, start: Place, end: Place) -> MeasuredStroke:
    """The curve from `start` to `end` (u, v) [px], in that direction.

    One of them alone gives the direction, and cuts off what lies beyond it. On a ring, `start` says
    where it begins.

    Raises `CurveError` where a place lies off the line, both are the same place, or an `end` is
    given for a ring.
    """
    if start is None and end is None:
        return curve
    if curve.closed and end is not None:
        raise CurveError(
            "The curve is closed, so it has no end. Leave --end out.", code="end-of-a-ring"
        )
    if error := _off_curve_error(curve.points, curve.width, start, end):
        raise error
    first, stop = (None if at is None else nearest_to(at, curve.points) for at in (start, end))
    last = len(curve.points) - 1
    if curve.closed:
        return _with_points(curve, np.roll(np.arange(last + 1), -first))
    if first is None:
        first = last if stop <= last / 2 else 0
    if stop is None:
        stop = last if first < last / 2 else 0
    if first == stop:
        raise CurveError(
            "--start and --end lie on the same point of the curve. Move one of them.",
            code="start-is-end",
        )
    step = 1 if first < stop else -1
    kept = _with_points(curve, np.arange(first, stop + step, step))
    return replace(kept, ends=curve.ends[::step])


def _with_points(curve: MeasuredStroke, keep: NDArray) -> MeasuredStroke:
    """The curve through those of its points, in this order."""
    names = ("points", "sigma", "bridged", "hidden")
    return replace(curve, **{name: getattr(curve, name)[keep] for name in names})


def without_cut_off(findings: list[Finding], curve: Stroke, cut: Stroke) -> list[Finding]:
    """The findings that speak of the part of a curve that is left."""
    return [
        finding
        for finding in findings
        if finding.place_px is None
        or distance_to(finding.place_px, cut.points)
        <= distance_to(finding.place_px, curve.points) + 1.0
    ]


def _off_curve_error(points: NDArray, width: float, start: Place, end: Place) -> CurveError | None:
    """The error for the place farther off a line, if it is too far off; otherwise `None`."""
    named = [pair for pair in ((start, "--start"), (end, "--end")) if pair[0] is not None]
    place, option = max(named, key=lambda pair: distance_to(pair[0], points))
    distance = distance_to(place, points)
    reach = max(REACH_WIDTHS * width, REACH_PX)
    if distance <= reach:
        return None
    return CurveError(
        f"{option} {place[0]:g},{place[1]:g} lies {distance:.0f} px off the curve. Name a "
        f"place within {reach:.0f} px of it.",
        code="place-off-curve",
        numbers={"distance_px": distance, "distance_max_px": reach},
    )


Method = Literal["ridge", "skeleton", "mask"]
METHODS: tuple[Method, ...] = get_args(Method)


@dataclass(frozen=True, eq=False)
class Extraction:
    """What was found on a slice.

    Parameters
    ----------
    mask
        (H, W) bool, the pixels in the pen's colour within `roi` and beside `exclude`; none of a
        vector curve.
    strokes
        The chosen lines, the longest first.
    method
        How they were measured.
    account
        All other ink of the pen, the largest piece first.
    findings
        What a person should look at before trusting the result.
    """

    mask: NDArray[np.bool_]
    strokes: tuple[Stroke, ...]
    method: Method | Literal["vector"]
    account: tuple[AccountEntry, ...] = ()
    findings: Findings = ()


def extract_curve(
    image: PlannedImage | NDArray,
    *,
    colour: str = "red",
    method: Method = "ridge",
    roi: Box | None = None,
    stroke: int | Literal["all", "longest"] | None = None,
    max_gap_px: float = 20.0,
    exclude: Sequence[Box] = (),
    start: Place = None,
    end: Place = None,
    accept_width: bool = False,
) -> Extraction:
    """Extract the planned curve from a slice.

    Parameters
    ----------
    image
        A `PlannedImage`, or an (H, W, 3) array of uint8 or uint16, red first.
    colour
        The pen: a CSS colour name or `#rrggbb`.
    method
        "ridge" measures the line's centre in coverage, "skeleton" thins the mask to pixels,
        "mask" takes every pixel of the chosen line's ink as the paper does.
    roi
        (u, v, width, height) px: look only there.
    stroke
        Which line: its number in the error message, counting from 1; "longest"; "all". `None`
        wants exactly one candidate. Numbers beyond the candidates' name the other lines.
    max_gap_px
        Pen lifts up to this long are bridged where both tangents agree.
    exclude
        Rectangles as `roi`, in which nothing is looked at.
    start, end
        (u, v) px on the curve: where it begins and ends, and so its direction. Of several
        candidates the one through them is taken. A place that lies off every line is refused.
    accept_width
        Take a run that is wider than the rest as one pen's, pressed harder.

    Raises
    ------
    CurveError
        No line, or too many pieces of ink to tell one; several candidates and none chosen; the
        chosen line forks or crosses itself, is two lines side by side, has a gap that is too long,
        or was measured away from its ink; `start` or `end` lies off the lines. `code` says which,
        `numbers` where.
    SettingError
        A parameter outside its range.
    """
    rgb = as_image(image).rgb
    places = [place for place in (start, end) if place is not None]
    _check_settings(method, stroke, max_gap_px, places)
    region = Region.of(roi, exclude, rgb.shape)

    # Ink: how much of each pixel the pen covers, and the pixels that hang together.
    pen = Pen.of_colour(colour)
    ink = find_ink(rgb, pen, region)
    groups = candidates.find_groups(ink)

    # Lines: skeletons joined over pen lifts; one of them is the curve.
    lines = candidates.find_candidates(candidates.find_pieces(ink, groups), max_gap_px)
    try:
        passing = lines_through(lines, start, end) if places and stroke is None else lines
        chosen = choose.choose_lines(lines, passing, stroke, ink, pen, region, max_gap_px)
        unchosen = [line for line in lines if line not in chosen]
        chosen = [line.in_order() for line in chosen]

        # Centre lines: measured across the ink, or refused where that is ambiguous.
        curves = []
        for line in chosen:
            if method != "mask":
                choose.refuse_junctions(line)
            if method != "ridge":
                curves.append(skeleton_line(line))
                continue
            curve = measure(ink, line)
            if not accept_width:
                choose.refuse_two_runs(curve)
            choose.refuse_double_line(curve)
            choose.refuse_long_bridge(curve, max_gap_px)
            choose.refuse_fit_off_ink(curve, line)
            curves.append(account.with_joined_ink(ink, curve))
    except CurveError as error:
        raise choose.with_other_pens(error, lines, ink, pen) from None

    # All other ink is listed, and what a person should look at is said.
    leftover = account.find_leftover(ink, curves)
    findings = [*account.leftover_findings(leftover, max_gap_px)]
    if stroke == "all":
        findings += account.shorter_findings(unchosen, lines, ink)
    if len(chosen) == 1:
        findings = account.doubts_of_line(chosen[0], lines, ink, pen) + findings
    for curve, line in zip(curves, chosen, strict=True):
        findings += account.end_findings(ink, curve, leftover)
        findings += account.ahead_findings(line, unchosen, max_gap_px)
        findings += account.ring_findings(line, max_gap_px)
        findings += account.stretch_findings(curve)
        if curve.profiles is not None:
            findings += account.width_findings(ink, curve)
    findings += account.gap_findings(chosen)
    findings += account.join_findings(leftover, (), ink, max_gap_px, findings)
    if method != "mask":
        findings += account.fold_findings(curves)
    strokes = []
    for curve, line in zip(curves, chosen, strict=True):
        cut = cut_to(curve, start, end)
        findings = without_cut_off(findings, curve, cut)
        findings += _region_findings(cut, region, ink.size)
        if method == "ridge":
            findings += account.corner_findings(cut)
        strokes.append(_stroke(ink, cut, line, method))
        findings += account.border_findings(strokes[-1], ink.size)
    mask, entries = candidates.pen_mask(ink, groups), account.list_account(leftover, curves, ink)
    return Extraction(mask, tuple(strokes), method, entries, tuple(findings))


def vector_stroke(stroke: Stroke, image: PlannedImage, where: str) -> Extraction:
    """A curve that was drawn as vectors on an image, as an `Extraction` with an empty mask.

    Raises `CurveError` when it does not lie in the image.
    """
    limit = np.array([image.width_px, image.height_px]) - 0.5
    outside = ((stroke.points < -0.5) | (stroke.points > limit)).any(1)
    if outside.any():
        u, v = (float(x) for x in stroke.points[np.argmax(outside)])
        raise CurveError(
            f"The curve leaves the image of {image.width_px}x{image.height_px} px at "
            f"({u:z.1f}, {v:z.1f}). Give the image that it was drawn on.",
            where=where,
            code="vector-outside-image",
            numbers={"u_px": u, "v_px": v},
        )
    return Extraction(np.zeros(image.rgb.shape[:2], bool), (stroke,), "vector")


def _check_settings(method: str, stroke: int | str | None, max_gap_px: float, places: list) -> None:
    if method not in METHODS:
        raise SettingError(
            f"The method {method!r} is unknown. Choose {', '.join(METHODS)}.", code="method-unknown"
        )
    is_number = isinstance(stroke, int) and stroke is not True and stroke >= 1
    if stroke not in (None, "all", "longest") and not is_number:
        raise SettingError(
            f"The stroke {stroke!r} is unknown. Give 'all', 'longest' or a number from 1.",
            code="stroke-unknown",
        )
    if not 0 <= max_gap_px < float("inf"):
        text = f"A gap of {max_gap_px} px cannot be bridged. Give a finite number from 0."
        raise SettingError(text, code="max-gap", numbers={"max_gap_px": max_gap_px})
    if places and (method == "mask" or stroke == "all"):
        raise SettingError(
            "Method 'mask' and stroke 'all' have no order, and so no start or end. Leave "
            "--start and --end out.",
            code="start-without-order",
        )


def _region_findings(curve: MeasuredStroke, region: Region, size: NDArray) -> list[Finding]:
    """A note for each open end on a border of the region, beyond which nothing was looked at."""
    if region == Region():
        return []
    is_seen = region.shown(np.ones(size[::-1], bool))
    text = "the curve ends on the border of the region. Widen the region if it goes on."
    return [
        account.finding_at(place, "end-at-region", text, note)
        for place in curve.end_points
        if not account.around(is_seen, place, curve.width + tuned.FLANK_PX).all()
    ]


def _stroke(ink: Ink, curve: MeasuredStroke, line: Candidate, method: Method) -> Stroke:
    """The measured curve as it is returned."""
    length = None if method == "ridge" else drawn_length(curve.points, curve.closed)
    drawn = curve.points, curve.closed, curve.sigma, curve.bridged
    measured = Stroke(*drawn, hidden=curve.hidden, width=line.width, known_length=length)
    if method != "mask":
        return measured
    # Every pixel of the line's ink; its error across is that of an even distribution.
    covered = [candidates.half_covered(ink, pixels) for pixels in line.pieces]
    points = np.vstack(covered).astype(float)
    points = points[np.lexsort((points[:, 0], points[:, 1]))]
    sigma = np.full(len(points), line.width / np.sqrt(12))
    return replace(
        measured, points=points, sigma=sigma, bridged=None, edited=None, hidden=None,
        is_ordered=False,
    )  # fmt: skip
