"""What the review knows of the slice: its curve, or why there is none, and all other ink.

`Geometry` is immutable. It says what `vfplan extract` would say of the slice, and holds what a
person made of it since. A mended curve has another account than the measured one, so the review
makes the account anew, by the same rule and with the same numbers. A piece of ink has the routes
that a curve may take over it: from each free end to each other one.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import account, tuned
from vfplan.curve.account import AccountEntry, Leftover, find_leftover, list_account
from vfplan.curve.candidates import (
    Candidate,
    dotted_line,
    find_candidates,
    find_groups,
    find_pieces,
    skeleton_graph,
    walked_back,
)
from vfplan.curve.centreline import drawn_length
from vfplan.curve.choose import two_runs_finding
from vfplan.errors import CurveError, SettingError
from vfplan.findings import Finding, note
from vfplan.fixture import Fixture, Stroke
from vfplan.images.read import PlannedImage
from vfplan.planning.extraction import extract
from vfplan.planning.settings import ExtractSettings
from vfplan.registration.registration import own_bound
from vfplan.review.strokes import (
    CLOSE_PX,
    JOIN_PX,
    MIN_LINE_PX,
    MendedStroke,
    SliceInk,
    nearest_point,
)
from vfplan.settings import recalled

Array = NDArray[np.float64]

# Entries that are listed at most; more is a photograph, not a drawing.
MAX_ENTRIES = 200


def extraction_of(fixture: Fixture, settings: ExtractSettings) -> ExtractSettings:
    """The settings with which a bundle's curve was extracted; these where it records none."""
    return recalled(ExtractSettings, fixture.provenance.settings) or settings


# Routes that are offered at most: one digit chooses among them.
MAX_ROUTES = 9

# Free ends of a forked line at most, from which a route is offered.
MAX_FREE_ENDS = 12

# Times the longest gap that is bridged, up to which a person is offered lines joined over a gap.
JOINED_GAPS = 3.0

# Length [px] of the way around a hole from which that is no letter's.
MIN_RING_PX = 60


def route_along(pixels: NDArray, closed: bool) -> Stroke:
    """A route that a curve may take over the ink, along skeleton pixels (u, v) in order."""
    return Stroke(pixels, closed, known_length=drawn_length(pixels, closed))


def routes_through(
    mask: NDArray[np.bool_], corner: tuple[int, int] = (0, 0)
) -> tuple[list[Stroke], list[tuple[float, float]]]:
    """The routes through one connected piece of ink, the longest first, and where it forks.

    A line has one route, from end to end, or around. A forked line has one for each pair of its
    free ends, and one around its largest hole, as its ends may overlap or cross. `corner` is where
    (0, 0) of the mask lies on the slice.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    pixels, edges = skeleton_graph(_core.thinned(np.pad(mask, 2)).astype(bool))
    pixels = pixels + np.array(corner) - 2.0
    degree = np.bincount(edges.ravel(), minlength=len(pixels))
    forks = [tuple(place) for place in pixels[degree > 2].tolist()]
    routes = around_hole(mask, corner)
    ends = np.flatnonzero(degree == 1)
    if len(ends) > 1:
        lengths = np.hypot(*(pixels[edges[:, 0]] - pixels[edges[:, 1]]).T)
        graph = coo_matrix((lengths, edges.T), shape=(len(pixels),) * 2).tocsr()
        if len(ends) > MAX_FREE_ENDS:
            # Letters on the line have many short branches; the line's own ends are the longest.
            at_forks = np.flatnonzero(degree > 2)
            reach = dijkstra(graph, directed=False, indices=at_forks, min_only=True)
            ends = np.sort(ends[np.argsort(-reach[ends], kind="stable")[:MAX_FREE_ENDS]])
        # The shortest path from each end to each other one.
        distance, before = dijkstra(graph, directed=False, indices=ends, return_predecessors=True)
        routes += [
            route_along(pixels[walked_back(before[i], start, stop)], False)
            for i, start in enumerate(ends)
            for stop in ends[i + 1 :]
            if np.isfinite(distance[i, stop])
        ]
    routes.sort(key=lambda route: -route.length)
    return routes[:MAX_ROUTES], forks


def around_hole(mask: NDArray[np.bool_], corner: tuple[int, int]) -> list[Stroke]:
    """The one route around the largest hole in the ink, if that is larger than a letter's."""
    if not mask.any():
        return []
    contours, relations = cv2.findContours(
        mask.view(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    # The ink at a hole has the outline of a piece as its parent.
    holes = [
        contour[:, 0]
        for contour, (*_, parent) in zip(contours, relations[0], strict=True)
        if parent >= 0 and len(contour) >= MIN_RING_PX
    ]
    if not holes:
        return []
    return [route_along(max(holes, key=cv2.contourArea) + np.array(corner, float), True)]


# Findings that are made anew from the strokes after each step, not kept; the first need the ink.
OF_INK = {"ink-joins", "ink-touches", "leaves-picture"}
MADE_ANEW = OF_INK | {
    *("bridge", "bridge-long", "bridge-near-end", "curve-crosses", "curve-folds", "drawn-by-hand")
}

# Distance [px] from the points of its old line from which a point counts as changed: half of it may
# be a step along the line.
MOVED_PX = 1.0


@dataclass(frozen=True, eq=False)
class Geometry:
    """The curve on its slice, as far as it is settled.

    Parameters
    ----------
    strokes
        The lines of the curve; none while it is not settled which they are.
    ink
        The pen's ink; `None` if the slice is not at hand, or the curve was not drawn by a pen.
    findings
        The findings of extraction, less what was mended.
    refusal
        Why extraction gave no curve, as the page shows it: code, words, place and, where another
        pen drew the longest line, its colour; `None` if it did, or if a person gave one.
    candidates
        Routes that the curve may take, from which a person can choose.
    excluded_ink
        Middles of the ink that a person left out of the curve.
    max_gap_px
        Pen lifts up to this long are bridged.
    """

    strokes: tuple[MendedStroke, ...] = ()
    ink: SliceInk | None = None
    findings: tuple[Finding, ...] = ()
    refusal: dict[str, Any] | None = None
    candidates: tuple[Stroke, ...] = ()
    excluded_ink: frozenset[tuple[float, float]] = field(default_factory=frozenset)
    max_gap_px: float = ExtractSettings.max_gap_px

    @cached_property
    def lines(self) -> tuple[Stroke, ...]:
        """The strokes, each with the width of its pen."""
        lines = []
        for stroke in self.strokes:
            width = stroke.width if stroke.is_ordered else 0.0
            if width is None and self.ink is not None:
                width = self._pen_width(stroke)
            lines.append(replace(stroke, width=width))
        return tuple(lines)

    def _pen_width(self, stroke: Stroke) -> float:
        """The width of the line that extraction finds where a stroke runs, else of its ink [px]."""
        for line in lines_of(self.ink, self.max_gap_px):
            if np.median(_core.nearest(line.path, stroke.points)[0]) <= CLOSE_PX:
                return line.width
        return self.ink.width_along(stroke.points, stroke.closed)

    @cached_property
    def leftover(self) -> list[Leftover]:
        """The pen's ink that is not the curve, piece by piece."""
        return find_leftover(self.ink.found, self.lines)

    @cached_property
    def account(self) -> tuple[AccountEntry, ...]:
        """The ink that is not the curve and its bridged stretches, the largest first."""
        if self.ink is None:
            return ()
        return list_account(self.leftover, self.lines, self.ink.found)[:MAX_ENTRIES]

    @cached_property
    def all_findings(self) -> tuple[Finding, ...]:
        """What a person should look at, made anew for the strokes as they are."""
        if not self.strokes:
            return self.findings
        # Of extraction, and of a bundle, what still holds.
        told = {(finding.code, finding.text): finding for finding in self.findings}
        made = [] if self.ink is None else self._of_ink()
        made += account.fold_findings(self.strokes)
        for stroke in self.strokes:
            made += account.stretch_findings(stroke)
            if stroke.edited.any():
                first = stroke.points[np.flatnonzero(stroke.edited)[0]]
                within_px = own_bound(self.strokes)[
                    np.concatenate([s.edited for s in self.strokes])
                ]
                text = (
                    f"{int(stroke.edited.sum())} px of the curve were placed by hand where no ink "
                    f"shows them. They are taken to lie within {within_px.max():.1f} px (95 %)."
                )
                place_px = tuple(first.tolist())
                made.append(note("drawn-by-hand", "extract", text, place_px=place_px))
        made = [told.get((finding.code, finding.text), finding) for finding in made]
        made_anew = MADE_ANEW if self.ink is not None else MADE_ANEW - OF_INK
        is_left = [f for f in self.findings if f.code not in made_anew and self._holds(f)]
        findings = (*is_left, *(finding for finding in made if finding not in is_left))
        return tuple(self.as_settled(finding) for finding in findings)

    def as_settled(self, finding: Finding) -> Finding:
        """The finding, as a note if it asks about ink that a person left out."""
        asks_about_ink = finding.code in ("ink-at-end", "ink-joins", "ink-touches")
        if not (finding.is_open and asks_about_ink and finding.place_px):
            return finding
        for piece in self.leftover if self.excluded_ink else ():
            # The pen's width in a bundle differs a little, and so do the edges of its pieces.
            places = np.array([piece.middle, piece.nearest])
            is_of_piece = nearest_point(places, finding.place_px)[1] <= CLOSE_PX
            if is_of_piece and tuple(piece.middle.tolist()) in self.excluded_ink:
                return replace(finding, severity="note")
        return finding

    def _of_ink(self) -> list[Finding]:
        """What the pen's ink leaves open: what was left out, and ends at the picture's border."""
        told = {(finding.code, finding.text) for finding in self.findings}
        again = account.leftover_findings(self.leftover, self.max_gap_px)
        findings = [finding for finding in again if (finding.code, finding.text) in told]
        lines = [account.line_of(line, self.ink.found) for line in self.lines]
        findings += account.join_findings(
            self.leftover, lines, self.ink.found, self.max_gap_px, findings
        )
        for line in self.lines:
            findings += account.border_findings(line, self.ink.found.size)
        return findings

    def _holds(self, finding: Finding) -> bool:
        """Whether a finding on the picture is still true of the strokes."""
        place = finding.place_px
        if place is None or finding.stage != "extract":
            return True
        if finding.code == "ink-at-end":
            ends = [stroke.end_points for stroke in self.strokes if len(stroke.end_points)]
            places = [*ends, *(pair.mean(axis=0, keepdims=True) for pair in ends)]
            return bool(ends) and nearest_point(np.concatenate(places), place)[1] <= CLOSE_PX
        if finding.code == "curve-short" and self.strokes[0].length >= tuned.CRUMB_PX:
            return False
        points = np.concatenate([stroke.points for stroke in self.strokes])
        is_near = nearest_point(points, place)[1] <= JOIN_PX
        return is_near != (finding.code == "ink-outweighs")

    def stroke(self, number: int) -> MendedStroke:
        """A stroke by its number from 0; raises `SettingError` if there is none."""
        if not 0 <= number < len(self.strokes):
            text = f"There is no stroke {number}. The curve has {len(self.strokes)}, from 0."
            raise SettingError(text, code="no-such-stroke")
        return self.strokes[number]

    def entry(self, number: int) -> AccountEntry:
        """The ink of this number in the account; raises `SettingError` if there is none."""
        for entry in self.account:
            if entry.number == number and entry.what == "ink":
                return entry
        text = f"There is no ink {number} in the account. It lists {len(self.account)} entries."
        raise SettingError(text, code="no-such-ink")

    def with_stroke(self, number: int, stroke: MendedStroke) -> Geometry:
        """The geometry with a stroke in another's place; findings there are mended."""
        strokes = list(self.strokes)
        before, strokes[number] = strokes[number], stroke
        # Points of either line that are not on the other.
        changed = [
            one.points[_core.nearest(other.points, one.points)[0] > MOVED_PX]
            for one, other in ((before, stroke), (stroke, before))
        ]
        findings = unmended(self.findings, np.vstack(changed))
        return replace(self, strokes=tuple(strokes), findings=findings)

    def with_strokes(self, strokes: tuple[MendedStroke, ...]) -> Geometry:
        """The geometry with another curve, given by a person."""
        findings = self.findings
        if strokes:
            findings = unmended(findings, np.vstack([stroke.points for stroke in strokes]))
        return replace(self, strokes=strokes, findings=findings, refusal=None)


def geometry_of_slice(image: PlannedImage, settings: ExtractSettings, ink: SliceInk) -> Geometry:
    """What `vfplan extract` makes of a slice; a refusal becomes a part of the answer."""
    try:
        extracted = extract(image, settings)
    except CurveError as error:
        candidates = candidates_of(error, ink, settings)
        return Geometry(
            ink=ink, refusal=refusal_of(error), candidates=candidates,
            max_gap_px=settings.max_gap_px,
        )  # fmt: skip
    strokes = tuple(MendedStroke.of(stroke) for stroke in extracted.extraction.strokes)
    return Geometry(strokes, ink, extracted.findings, max_gap_px=settings.max_gap_px)


@lru_cache(maxsize=8)
def lines_of(ink: SliceInk, max_gap_px: float) -> list[Candidate]:
    """The lines of the ink as extraction finds them; none among too many pieces."""
    try:
        pieces = find_pieces(ink.found, find_groups(ink.found))
    except CurveError:
        return []
    return find_candidates(pieces, max_gap_px)


def ink_at(ink: SliceInk, place: Array) -> list[AccountEntry]:
    """The pieces of ink at a place, which a click misses by a little."""
    return [
        entry
        for entry in Geometry(ink=ink).account
        if nearest_point(entry.piece.places, place)[1] <= CLOSE_PX
    ]


def candidate_at(geometry: Geometry, place: Array) -> tuple[Geometry, int]:
    """The number of the longest candidate at a place on the slice, and the candidates with it.

    Where no candidate lies there, the longest route over the ink there becomes one.
    """
    candidates = list(geometry.candidates)
    if not any(nearest_point(route.points, place)[1] <= JOIN_PX for route in candidates):
        for entry in ink_at(geometry.ink, place):
            candidates += routes_over(entry)[0]
    distances = [nearest_point(route.points, place)[1] for route in candidates]
    nearest = min(distances, default=np.inf)
    if nearest > JOIN_PX:
        text = (
            f"No line of the pen lies at ({place[0]:z.0f}, {place[1]:z.0f}). Click on a line, or "
            "draw the curve."
        )
        raise SettingError(text, code="no-line-there")
    # A click misses by a little, and lines that meet lie at one place.
    there = [k for k in range(len(candidates)) if distances[k] <= nearest + CLOSE_PX]
    longest = max(there, key=lambda k: candidates[k].length)
    return replace(geometry, candidates=tuple(candidates)), longest + 1


def with_chosen(
    image: PlannedImage, settings: ExtractSettings, geometry: Geometry, number: int
) -> Geometry:
    """The geometry with one of its candidates as the curve.

    `vfplan extract` measures the candidate if it can. If it refuses the line, because it forks or
    something lies beside it, the line is measured along the candidate itself. Where it refuses two
    runs side by side, it is asked whether both are the curve.
    """
    asked: tuple[Finding, ...] = ()
    candidates = geometry.candidates
    if not 1 <= number <= len(candidates):
        text = f"There is no candidate {number}. There are {len(candidates)}, from 1."
        raise SettingError(text, code="no-such-candidate")
    route = candidates[number - 1]
    settled = replace(geometry, refusal=None)
    if route.sigma is not None:
        # A dotted line is measured already.
        strokes = (MendedStroke.of(route),)
        return replace(settled, strokes=strokes, findings=(account.dotted_finding(route),))
    try:
        extracted = extract(image, replace(settings, stroke=number))
    except CurveError as error:
        branches = branches_of(geometry, route)
        if branches:
            return replace(geometry, refusal=refusal_of(error), candidates=branches)
        if error.code == "runs-side-by-side":
            asked = (two_runs_finding((error.numbers["u_px"], error.numbers["v_px"])),)
    else:
        strokes = extracted.extraction.strokes
        to_route = [nearest_point(strokes[0].points, place)[1] for place in route.points[::8]]
        if len(strokes) == 1 and max(to_route) < CLOSE_PX:
            mended = MendedStroke.of(strokes[0])
            return replace(settled, strokes=(mended,), findings=extracted.findings)
    line = geometry.ink.trace(route.points, route.closed)
    return replace(settled, strokes=(MendedStroke.of(line),), findings=asked)


def branches_of(geometry: Geometry, route: Stroke) -> tuple[Stroke, ...]:
    """The routes through the forked ink of a candidate; none if the candidate is one of them."""
    for entry in ink_at(geometry.ink, route.points[len(route.points) // 2]):
        routes, forks = routes_over(entry)
        is_one = any(np.array_equal(other.points, route.points) for other in routes)
        if forks and len(routes) > 1 and not is_one:
            return tuple(routes)
    return ()


def routes_over(entry: AccountEntry) -> tuple[list[Stroke], list[tuple[float, float]]]:
    """The routes through a piece of ink, and where it forks."""
    return routes_through(entry.piece.mask, entry.box[:2])


def route_over(entry: AccountEntry) -> Stroke:
    """The line that a piece of ink draws; raises `SettingError` if it is none, or forks."""
    routes, _ = routes_over(entry)
    if not routes or routes[0].length < tuned.MIN_PROFILES:
        text = f"Ink {entry.number} is no line. Draw the curve by clicks instead."
        raise SettingError(text, code="ink-no-line")
    if len(routes) > 1:
        text = f"Ink {entry.number} forks. Draw the curve along the branch that is meant."
        raise SettingError(text, code="ink-forks")
    return routes[0]


def refusal_of(error: CurveError) -> dict[str, Any]:
    """The refusal without its advice to open the page, since it stands on that page."""
    other_pen = error.numbers.get("other_colour", "")
    # The page has a button for the other pen.
    options = ("vfplan review", "--colour") if other_pen else ("vfplan review",)
    sentences = re.split(r"(?<=\.) ", error.message)
    kept = [words for words in sentences if not any(option in words for option in options)]
    places = [error.numbers[name] for name in ("u_px", "v_px") if name in error.numbers]
    place = tuple(map(float, places)) if len(places) == 2 else None
    text = " ".join(kept) or error.message
    return {"code": error.code, "text": text, "place_px": place, "stage": "extract",
            "other_pen": other_pen}  # fmt: skip


def candidates_of(
    error: CurveError, ink: SliceInk, settings: ExtractSettings
) -> tuple[Stroke, ...]:
    """The candidates that extraction names, or every route through the lines of the ink.

    Behind them, lines joined over longer pen lifts, and a dotted line.
    """
    named = [np.asarray(path, float) for path in error.candidates]
    routes = []
    for path in named:
        is_ring = len(path) > 8 and np.hypot(*(path[0] - path[-1])) < 2.0
        routes.append(route_along(path, bool(is_ring)))
    if not named:
        for entry in Geometry(ink=ink).account:
            if max(entry.box[2:]) >= MIN_LINE_PX:
                routes += routes_over(entry)[0]
        routes.sort(key=lambda route: -route.length)
    for line in lines_of(ink, JOINED_GAPS * settings.max_gap_px):
        is_new = not any(np.array_equal(line.path, path) for path in named)
        if is_new and line.bridged.any():
            routes.append(route_along(line.path, line.closed))
    with suppress(CurveError):  # Too many pieces.
        dotted = dotted_line(ink.found, find_groups(ink.found))
        routes += [] if dotted is None else [dotted]
    if named:
        return tuple(routes)
    u, v, width, height = settings.roi or (0, 0, np.inf, np.inf)

    def is_offered(route: Stroke) -> bool:
        inside = (route.points >= (u, v)) & (route.points < (u + width, v + height))
        return route.length >= MIN_LINE_PX and bool(inside.all())

    return tuple(filter(is_offered, routes))[:MAX_ROUTES]


def unmended(findings: tuple[Finding, ...], changed: NDArray) -> tuple[Finding, ...]:
    """The findings without those whose place lies on what was changed."""
    if not len(changed):
        return findings

    def is_away(finding: Finding) -> bool:
        place = finding.place_px
        return place is None or nearest_point(changed, place)[1] > JOIN_PX

    return tuple(filter(is_away, findings))


def describe_candidate(number: int, route: Stroke) -> dict[str, Any]:
    """A candidate as the page shows it."""
    shape = "closed" if route.closed else "open"
    return {
        "number": number,
        "points_px": route.points[:: max(1, len(route.points) // 200)].round(1).tolist(),
        "closed": route.closed,
        "length_px": route.length,
        "text": f"{shape}, {route.length:.0f} px long",
    }
