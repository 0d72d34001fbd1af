"""What the review knows of the slice: its curve, or why there is none, and all other ink.

`Geometry` is immutable. It says what `vfplan extract` would say of the slice, and holds what a
person made of it since. A mended curve has another account than the measured one, so the review
makes the account anew, by the same rule and with the same numbers. A piece of ink has the routes
that a curve may take over it: from each free end to each other one.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import chain, count
from string import ascii_lowercase
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import account, tuned
from vfplan.curve.account import AccountEntry, Leftover, find_leftover, list_account
from vfplan.curve.candidates import (
    Candidate,
    branches_of,
    dotted_line,
    find_candidates,
    find_groups,
    find_pieces,
    skeleton_graph,
    walked_back,
)
from vfplan.curve.centreline import drawn_length
from vfplan.curve.choose import describe, in_number_order, two_runs_finding
from vfplan.curve.coverage import Pen
from vfplan.curve.extraction import extract_curve
from vfplan.errors import CurveError, SettingError
from vfplan.findings import Finding, Findings, note
from vfplan.fixture import Fixture, Stroke
from vfplan.geometry.lines import Array, Flags, distance_to, evenly
from vfplan.images.read import PlannedImage
from vfplan.planning.extraction import extract, slice_findings
from vfplan.planning.settings import ExtractSettings
from vfplan.registration.registration import own_bound
from vfplan.review.strokes import CLOSE_PX, JOIN_PX, MIN_LINE_PX, MendedStroke, SliceInk
from vfplan.settings import recalled

# Least cosine of a turn with which a line goes straight on where ink forks.
MIN_STRAIGHT = 0.7

# Distance [px] from the points of its old line from which a point counts as changed: half of it may
# be a step along the line.
MOVED_PX = 1.0

# Entries that are listed at most; more is a photograph, not a drawing.
MAX_ENTRIES = 200


def extraction_of(fixture: Fixture, settings: ExtractSettings) -> ExtractSettings:
    """The settings with which a bundle's curve was extracted; these where it records none."""
    return recalled(ExtractSettings, fixture.provenance.settings) or settings


# Routes that are offered at most: one digit chooses among them.
MAX_ROUTES = 9

# Free ends of a forked line at most, from which a route is offered.
MAX_FREE_ENDS = 12

# Length [px] of the way around a hole from which that is no letter's.
MIN_RING_PX = 60


def route_of(line: Candidate) -> Stroke:
    """The route along a line of extraction, as long as that says."""
    return Stroke(line.path, line.closed, known_length=line.length)


def route_along(pixels: NDArray, closed: bool) -> Stroke:
    """A route that a curve may take over the ink, along skeleton pixels (u, v) in order."""
    return Stroke(pixels, closed, known_length=drawn_length(pixels, closed))


def routes_through(mask: Flags, corner: tuple[int, int] = (0, 0)) -> list[Stroke]:
    """The routes through one connected piece of ink, the longest first.

    A line has one route, from end to end, or around. A forked line has one for each pair of its
    free ends, and one around its largest hole, as its ends may overlap or cross. `corner` is where
    (0, 0) of the mask lies on the slice.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    pixels, edges = skeleton_graph(_core.thinned(np.pad(mask, 2)).astype(bool))
    pixels = pixels + np.array(corner) - 2.0
    degree = np.bincount(edges.ravel(), minlength=len(pixels))
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
    return routes[:MAX_ROUTES]


def straight_on(entry: AccountEntry, place: Array) -> Stroke | None:
    """The line through a piece of ink at a place, straight on wherever the ink forks or crosses.

    `None` where the ink is shorter than a fork is wide.
    """
    mask, corner = entry.piece.mask, np.array(entry.box[:2], float)
    bone = _core.thinned(np.pad(mask, 2)).astype(bool)
    # A fork is as wide as the pen, and two that cross at a small angle are a little apart.
    reach = 3.0 * mask.sum() / max(bone.sum(), 1) + CLOSE_PX
    found = branches_of(bone)[0]
    branches = [pixels + corner - 2.0 for pixels, _ in found if len(pixels) > reach]
    if not branches:
        return None
    away = [distance_to(place, pixels) for pixels in branches]
    path = branches.pop(np.argmin(away))
    for _ in range(2):
        path = path[::-1]
        while branches:
            ways = [way for branch in branches for way in (branch, branch[::-1])]
            turns = [turn_onto(path, way, reach) for way in ways]
            straightest = int(np.argmax(turns))
            if turns[straightest] < MIN_STRAIGHT:
                break
            path = np.vstack([path, ways[straightest]])
            del branches[straightest // 2]
    return route_along(evenly(path, False), False)


def turn_onto(path: NDArray, way: NDArray, reach: float) -> float:
    """The cosine of the turn from the end of a path onto a way; -1 where that begins far off."""
    if np.hypot(*(way[0] - path[-1])) > reach:
        return -1.0
    before, after = path[-1] - path[-round(reach) :][0], way[: round(reach)][-1] - way[0]
    return float(before @ after / (np.hypot(*before) * np.hypot(*after)))


def around_hole(mask: Flags, corner: tuple[int, int]) -> list[Stroke]:
    """The one route around the largest hole in the ink, if that is larger than a letter's."""
    ink = mask.view(np.uint8)
    contours, relations = cv2.findContours(ink, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    # The ink at a hole has the outline of a piece as its parent.
    inner = np.flatnonzero(relations[0, :, 3] >= 0)
    holes = [contours[k][:, 0] for k in inner if len(contours[k]) >= MIN_RING_PX]
    holes.sort(key=cv2.contourArea, reverse=True)
    return [route_along(hole + np.array(corner, float), True) for hole in holes[:1]]


# Findings that ask about a piece of other ink.
ASKS_ABOUT_INK = ("ink-at-end", "ink-joins", "ink-touches", "line-left-out")

# The answer behind their question once a person left that ink out.
ON_PURPOSE = " A person left it out."

# Findings that are made anew from the strokes after each step, not kept; the first need the ink.
OF_INK = {
    "curve-on-border", "curve-straight", "curve-short", "ink-outweighs", "ink-joins", "ink-touches",
    "leaves-picture", "bridge", "bridge-long", "bridge-near-end", "stretch-hidden",
    "corner-near-end",
}  # fmt: skip
MADE_ANEW = OF_INK | {"curve-crosses", "curve-folds", "drawn-by-hand"}


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
    taken
        Those of the strokes that a person gave, for which extraction was not asked yet.
    refusal
        Why extraction gave no curve, as the page shows it: code, words, place and, where another
        pen drew the longest line, its colour; `None` if it did, or if a person gave one.
    candidates
        Routes that the curve may take, from which a person can choose, by number. A line of
        extraction has the number that `--stroke` takes; any other route has one beyond those.
    excluded_ink
        Middles of the ink that a person left out of the curve.
    max_gap_px
        Pen lifts up to this long are bridged.
    is_as_found
        Whether no step has changed the strokes since they were extracted, or read from a bundle.
    """

    strokes: tuple[MendedStroke, ...] = ()
    ink: SliceInk | None = None
    findings: Findings = ()
    taken: tuple[MendedStroke, ...] = ()
    refusal: dict[str, Any] | None = None
    candidates: dict[int, Stroke] = field(default_factory=dict)
    excluded_ink: frozenset[tuple[float, float]] = field(default_factory=frozenset)
    max_gap_px: float = ExtractSettings.max_gap_px
    is_as_found: bool = True

    @cached_property
    def lines(self) -> tuple[Stroke, ...]:
        """The strokes, each with the width of its pen."""
        return tuple(replace(stroke, width=self._pen_width(stroke)) for stroke in self.strokes)

    def _pen_width(self, stroke: Stroke) -> float | None:
        """A stroke's own width, else that of the line that extraction finds there, else of its ink.

        It is 0 for pixels in no order [px].
        """
        if not stroke.is_ordered:
            return 0.0
        if stroke.width is not None or self.ink is None:
            return stroke.width
        for line in lines_of(self.ink, self.max_gap_px):
            if runs_along(stroke, line.path):
                return line.width
        return self.ink.width_along(stroke.points, stroke.closed)

    @cached_property
    def numbered(self) -> dict[int, Candidate]:
        """The lines that extraction takes by number; one that forks has a number that none has."""
        lines = in_number_order(lines_of(self.ink, self.max_gap_px), self.ink and self.ink.found)
        return dict(enumerate(lines, 1))

    @cached_property
    def names(self) -> dict[str, int]:
        """The candidates' numbers by their names, as page, terminal and pictures count.

        A line is called by its number for `--stroke`, and a way over a line that forks has a letter
        behind that. Any other route has a number beyond those of the lines.
        """
        names, beyond = {}, map(str, count(len(self.numbered) + 1))
        forked = [
            (np.concatenate(line.pieces), chain(map(str(number).__add__, ascii_lowercase), beyond))
            for number, line in self.numbered.items()
            if len(line.junctions)
        ]
        for number, route in sorted(self.candidates.items()):
            free = next((ways for ink, ways in forked if runs_along(route, ink)), beyond)
            names[str(number) if number in self.numbered else next(free)] = number
        return names

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
    def kept(self) -> Findings:
        """The findings of extraction, less what was mended, with those of lines that were taken."""
        findings = list(self.findings)
        for stroke in self.taken:
            for number in numbers_of(stroke, self.numbered):
                findings += findings_of_line(self.ink, self.max_gap_px, number)
        return tuple(dict.fromkeys(findings))

    @cached_property
    def told(self) -> dict[tuple[str, str], Finding]:
        """The findings of `kept` by code and what they state."""
        return {stated(finding): finding for finding in self.kept}

    @cached_property
    def all_findings(self) -> Findings:
        """What a person should look at, made anew for the strokes as they are."""
        if not self.strokes or self.is_as_found:
            return tuple(map(self.as_settled, self.findings))
        # Of extraction, and of a bundle, what still holds.
        made, made_anew = [], MADE_ANEW - OF_INK
        if self.ink is not None:
            made, made_anew = self._of_ink(), MADE_ANEW
        made += account.fold_findings(self.lines)
        edited = np.concatenate([stroke.edited for stroke in self.strokes])
        for stroke in self.lines:
            places = stroke.points[stroke.edited]
            if len(places):
                within_px = own_bound(self.strokes)[edited].max()
                text = (
                    f"{len(places)} px of the curve were placed by hand and not measured. "
                    f"They are taken to lie within {within_px:.1f} px (95 %)."
                )
                place_px = tuple(places[0].tolist())
                made.append(note("drawn-by-hand", "extract", text, place_px=place_px))
        made = [self.told.get(stated(finding), finding) for finding in made]
        left = [f for f in self.kept if f.code not in made_anew and self._holds(f)]
        findings = (*left, *(finding for finding in made if finding not in left))
        return tuple(self.as_settled(finding) for finding in findings)

    def as_settled(self, finding: Finding) -> Finding:
        """The finding, as a note if it asks about ink that a person left out."""
        asks_about_ink = finding.code in ASKS_ABOUT_INK and finding.place_px
        if not (self.excluded_ink and finding.is_open and asks_about_ink):
            return finding
        piece = min(self.leftover, key=lambda piece: away_from(piece, finding), default=None)
        if piece is None or away_from(piece, finding) > CLOSE_PX:
            return finding
        if tuple(piece.middle.tolist()) in self.excluded_ink:
            return replace(finding, severity="note", text=finding.text + ON_PURPOSE)
        return finding

    def _of_ink(self) -> list[Finding]:
        """What the pen's ink leaves open: what was left out, and ends at the picture's border."""
        again = account.leftover_findings(self.leftover, self.max_gap_px)
        findings = [finding for finding in again if stated(finding) in self.told]
        lines = [account.line_of(line, self.ink.found) for line in self.lines]
        findings += account.join_findings(
            self.leftover, lines, self.ink.found, self.max_gap_px, findings
        )
        findings += account.gap_findings(lines)
        for line in self.lines:
            findings += account.border_findings(line, self.ink.found.size)
            findings += account.stretch_findings(line) + account.corner_findings(line)
        return self._of_line() + findings

    def _of_line(self) -> list[Finding]:
        """What makes the curve, if it is one stroke, look like no hand's drawing."""
        lines = lines_of(self.ink, self.max_gap_px)
        if len(self.lines) != 1 or not lines:
            return []
        [stroke] = self.lines
        pen = Pen.of_colour(self.ink.colour)
        for line in lines:
            if apart_px(line, stroke) <= JOIN_PX:
                return account.doubts_of_line(line.in_order(), lines, self.ink.found, pen)
        # Another line counts with the ink that it runs along, or else with that of a pen along it.
        pieces = [line.pieces for line in lines if runs_along(stroke, np.concatenate(line.pieces))]
        painted = np.zeros(self.ink.found.mask.shape, np.uint8)
        points = np.rint(16 * stroke.points).astype(np.int32)
        cv2.polylines(painted, [points], stroke.closed, 1, max(1, round(stroke.width)), shift=4)
        pieces.append((np.argwhere(painted)[:, ::-1],))
        line = replace(account.line_of(stroke, self.ink.found), pieces=pieces[0])
        return account.doubts_of_line(line, lines, self.ink.found, pen)

    def _holds(self, finding: Finding) -> bool:
        """Whether a finding on the picture is still true of the strokes."""
        place = finding.place_px
        if place is None or finding.stage != "extract" or finding.code == "ink-outweighs":
            return True
        if finding.code == "line-left-out" and self.ink is not None:
            return any(away_from(piece, finding) <= CLOSE_PX for piece in self.leftover)
        if finding.code == "ink-at-end":
            ends = [stroke.end_points for stroke in self.strokes if len(stroke.end_points)]
            places = [*ends, *(pair.mean(axis=0, keepdims=True) for pair in ends)]
            return bool(ends) and distance_to(place, np.concatenate(places)) <= CLOSE_PX
        points = np.concatenate([stroke.points for stroke in self.strokes])
        return distance_to(place, points) <= JOIN_PX

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
        before = self.strokes[number]
        strokes = (*self.strokes[:number], stroke, *self.strokes[number + 1 :])
        # Points of either line that are not on the other.
        changed = [
            one.points[_core.nearest(other.points, one.points)[0] > MOVED_PX]
            for one, other in ((before, stroke), (stroke, before))
        ]
        findings = unmended(self.kept, changed)
        return replace(self, strokes=strokes, findings=findings, taken=(), is_as_found=False)

    def with_strokes(self, strokes: tuple[MendedStroke, ...]) -> Geometry:
        """The geometry with another curve, given by a person."""
        taken = tuple(stroke for stroke in strokes if stroke not in self.strokes)
        gone = [stroke for stroke in self.strokes if stroke not in strokes]
        findings = unmended(self.kept, [stroke.points for stroke in (*taken, *gone)])
        return replace(
            self, strokes=strokes, findings=findings, taken=taken, refusal=None, is_as_found=False
        )


def stated(finding: Finding) -> tuple[str, str]:
    """Its code, and its words without the answer."""
    return finding.code, finding.text.removesuffix(ON_PURPOSE)


def away_from(piece: Leftover, finding: Finding) -> float:
    """How far a finding is from a piece of ink [px].

    The pen's width in a bundle differs a little, and so do the edges of its pieces.
    """
    return distance_to(finding.place_px, piece.places)


def ink_of(image: PlannedImage, settings: ExtractSettings) -> SliceInk:
    """The ink of the pen that the settings name."""
    exclude = tuple(tuple(box) for box in settings.exclude or ())
    return SliceInk(image.rgb, settings.colour, exclude, settings.roi)


def geometry_of_slice(image: PlannedImage, settings: ExtractSettings) -> Geometry:
    """What `vfplan extract` makes of a slice; a refusal becomes a part of the answer."""
    of_slice, ink = slice_findings(image, settings), ink_of(image, settings)
    geometry = Geometry((), ink, of_slice, max_gap_px=settings.max_gap_px)
    try:
        return geometry_of_extraction(image, settings, geometry)
    except CurveError as error:
        # The page leaves out the advice that it needs not.
        told = error.numbers
        place = (float(told["u_px"]), float(told["v_px"])) if "u_px" in told else None
        refusal = {"code": error.code, "text": error.message, "place_px": place, "stage": "extract",
                   "other_pen": told.get("other_colour", "")}  # fmt: skip
        return replace(with_candidates_of(error, geometry), refusal=refusal)


def geometry_of_extraction(
    image: PlannedImage, settings: ExtractSettings, before: Geometry
) -> Geometry:
    """What `vfplan extract` makes of a slice, in place of what was there; raises as it does."""
    extracted = extract(image, settings)
    strokes = tuple(map(MendedStroke.of, extracted.extraction.strokes))
    return replace(
        before, strokes=strokes, findings=extracted.findings, taken=(), refusal=None,
        is_as_found=True,
    )  # fmt: skip


@lru_cache(maxsize=8)
def lines_of(ink: SliceInk | None, max_gap_px: float) -> list[Candidate]:
    """The lines of the ink as extraction finds them; none without ink or among too many pieces."""
    if ink is not None:
        with suppress(CurveError):
            return find_candidates(find_pieces(ink.found, find_groups(ink.found)), max_gap_px)
    return []


@lru_cache(maxsize=8)
def findings_of_line(ink: SliceInk, max_gap_px: float, number: int) -> Findings:
    """What extraction finds at a line, by its number; or asks of one that it refuses."""
    where = {"colour": ink.colour, "roi": ink.roi, "exclude": ink.exclude}
    try:
        return extract_curve(ink.rgb, **where, stroke=number, max_gap_px=max_gap_px).findings
    except CurveError as error:
        if error.code != "runs-side-by-side":
            return ()
        return (two_runs_finding((error.numbers["u_px"], error.numbers["v_px"])),)


def numbers_of(stroke: Stroke, lines: dict[int, Candidate]) -> list[int]:
    """The numbers of the lines that a stroke may be, by how well it is them; none that forks."""
    apart = {number: apart_px(line, stroke) for number, line in lines.items()}
    is_whole = [n for n, px in apart.items() if px <= JOIN_PX and not len(lines[n].junctions)]
    return sorted(is_whole, key=apart.__getitem__)


def apart_px(line: Candidate, stroke: Stroke) -> float:
    """How far a stroke and one of the ink's lines lie apart at most, both as a whole [px]."""
    if line.closed != stroke.closed:
        return np.inf
    ways = (line.path, stroke.points), (stroke.points, line.path)
    return max(_core.nearest(*way)[0].max() for way in ways)


def runs_along(stroke: Stroke, places: NDArray) -> bool:
    """Whether at least half of a stroke lies on the places of a line (N, 2)."""
    return np.median(_core.nearest(places.astype(float), stroke.points)[0]) <= CLOSE_PX


def ink_at(ink: SliceInk, place: Array) -> list[AccountEntry]:
    """The pieces of ink at a place, which a click misses by a little."""
    entries = Geometry(ink=ink).account
    return [one for one in entries if distance_to(place, one.piece.places) <= CLOSE_PX]


def with_route(geometry: Geometry, route: Stroke) -> tuple[Geometry, int]:
    """The geometry with a route as a candidate, and its number.

    The route that is a line of extraction becomes that line. A dotted line is none.
    """
    lines = geometry.numbered
    numbers = numbers_of(route, lines) if route.sigma is None else []
    number = max([len(lines), *geometry.candidates]) + 1
    if numbers:
        number, route = numbers[0], route_of(lines[numbers[0]])
    return replace(geometry, candidates=geometry.candidates | {number: route}), number


def candidate_at(geometry: Geometry, place: Array) -> tuple[Geometry, int]:
    """The number of the longest candidate at a place on the slice, and the candidates with it.

    Where no candidate lies there, the lines of extraction become candidates, with the routes over
    the ink there; of ink that none of them follows, the line that goes straight on at its forks.
    """

    def distances() -> dict[int, float]:
        routes = geometry.candidates.items()
        return {number: distance_to(place, route.points) for number, route in routes}

    if min(distances().values(), default=np.inf) > JOIN_PX:
        lines = {n: route_of(one) for n, one in geometry.numbered.items() if not len(one.junctions)}
        geometry = replace(geometry, candidates=geometry.candidates | lines)
        entries = ink_at(geometry.ink, place)
        for route in chain.from_iterable(map(routes_over, entries)):
            geometry, _ = with_route(geometry, route)
        if min(distances().values(), default=np.inf) > JOIN_PX:
            for route in filter(None, [straight_on(entry, place) for entry in entries]):
                geometry, _ = with_route(geometry, route)
    away = distances()
    nearest = min(away.values(), default=np.inf)
    if nearest > JOIN_PX:
        raise SettingError(
            f"No line of the pen lies at ({place[0]:z.0f}, {place[1]:z.0f}). Click on a line, or "
            "draw the curve.",
            code="no-line-there",
        )
    # A click misses by a little, and lines that meet lie at one place.
    there = [number for number in away if away[number] <= nearest + CLOSE_PX]
    return geometry, max(there, key=lambda number: geometry.candidates[number].length)


def with_chosen(
    image: PlannedImage, settings: ExtractSettings, geometry: Geometry, name: str | int
) -> Geometry:
    """The geometry with one of its candidates, by name or number, as the curve.

    `vfplan extract` measures a line that it can. A route of another number, and a line that it
    refuses because something lies beside it, is measured along the candidate itself.
    """
    number = geometry.names.get(name, name)
    route = geometry.candidates.get(number)
    if route is None:
        known = ", ".join(geometry.names) or "none"
        text = f"There is no candidate {name}. The candidates are: {known}."
        raise SettingError(text, code="no-such-candidate")
    if route.sigma is not None:
        # A dotted line is measured already.
        settled = geometry.with_strokes((MendedStroke.of(route),))
        return replace(settled, findings=(*settled.findings, account.dotted_finding(route)))
    if number in geometry.numbered:
        with suppress(CurveError):
            return geometry_of_extraction(image, replace(settings, stroke=number), geometry)
    return geometry.with_strokes((MendedStroke.of(geometry.ink.trace(route.points, route.closed)),))


def routes_over(entry: AccountEntry) -> list[Stroke]:
    """The routes through a piece of ink, the longest first."""
    return routes_through(entry.piece.mask, entry.box[:2])


def route_over(entry: AccountEntry) -> Stroke:
    """The line that a piece of ink draws; raises `SettingError` if it is none, or forks."""
    routes = routes_over(entry)
    if not routes or routes[0].length < tuned.MIN_PROFILES:
        text = f"Ink {entry.number} is no line. Draw the curve by clicks instead."
        raise SettingError(text, code="ink-no-line")
    if len(routes) > 1:
        text = f"Ink {entry.number} forks. Draw the curve along the branch that is meant."
        raise SettingError(text, code="ink-forks")
    return routes[0]


def with_candidates_of(error: CurveError, geometry: Geometry) -> Geometry:
    """The geometry with the candidates that extraction names, or every route through the lines.

    Of a candidate that forks every branch is one.
    Behind them, lines joined over longer pen lifts, and a dotted line.
    """
    ink, routes, paths = geometry.ink, [], [*map(np.ndarray.tolist, error.candidates)]
    named = [line for line in geometry.numbered.values() if line.path.tolist() in paths]
    for line in named:
        if len(line.junctions):
            for entry in ink_at(ink, line.middle):
                routes += routes_over(entry)
        else:
            routes.append(route_of(line))
    if not named:
        for entry in Geometry(ink=ink).account:
            if max(entry.box[2:]) >= MIN_LINE_PX:
                routes += routes_over(entry)
        routes.sort(key=lambda route: -route.length)
    joined = lines_of(ink, account.JOINED_GAPS * geometry.max_gap_px)
    routes += [route_of(line) for line in joined if line.bridged.any()]
    with suppress(CurveError):  # Too many pieces.
        dotted = dotted_line(ink.found, find_groups(ink.found))
        if dotted is not None:
            routes.append(dotted)
    if not named:
        routes = [route for route in routes if route.length >= MIN_LINE_PX][:MAX_ROUTES]
    for route in routes:
        geometry, _ = with_route(geometry, route)
    return geometry


def unmended(findings: Findings, changed: list[NDArray]) -> Findings:
    """The findings without those whose place lies on lines that were changed."""
    if not any(map(len, changed)):
        return findings
    points = np.vstack(changed)
    return tuple(
        finding
        for finding in findings
        if finding.place_px is None or distance_to(finding.place_px, points) > JOIN_PX
    )


def describe_candidates(geometry: Geometry) -> list[dict[str, Any]]:
    """The candidates as the page shows them."""
    routes = {name: geometry.candidates[number] for name, number in geometry.names.items()}
    return [
        {
            "name": name,
            "points_px": route.points[:: max(1, len(route.points) // 200)].round(1).tolist(),
            "closed": route.closed,
            "length_px": route.length,
            "words": describe(route.points, route.closed, route.length),
        }
        for name, route in routes.items()
    ]
