"""What the review knows of the slice: its curve, or why there is none, and all other ink.

`Geometry` is immutable. It says what `vfplan extract` would say of the slice, and holds what a
person made of it since. A mended curve has another account than the measured one, so the review
makes the account anew, by the same rule and with the same numbers. A piece of ink has the routes
that a curve may take over it: from each free end to each other one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned
from vfplan.curve.account import AccountEntry
from vfplan.curve.centreline import drawn_length
from vfplan.curve.coverage import Box
from vfplan.errors import CurveError, SettingError
from vfplan.findings import Finding, note
from vfplan.fixture import Fixture, Stroke
from vfplan.geometry.lines import runs
from vfplan.planning.extraction import extract
from vfplan.planning.settings import ExtractSettings
from vfplan.review.ink import CLOSE_PX, MIN_LINE_PX, SliceInk
from vfplan.review.strokes import JOIN_PX, MendedStroke, nearest_point

Array = NDArray[np.float64]

# Entries that are listed at most; more is a photograph, not a drawing.
MAX_ENTRIES = 200


@dataclass(frozen=True, eq=False)
class Entry(AccountEntry):
    """An entry of the account that also says which pixels it has.

    Parameters
    ----------
    what
        "ink", or "gap" of a stretch of the curve that shows no ink, whatever the reason.
    box
        (u, v, width, height) [px] of the ink.
    mask
        (height, width) bool, the ink in its box; `None` for a stretch.
    """

    what: str
    box: Box
    mask: NDArray[np.bool_] | None

    @property
    def middle(self) -> tuple[float, float]:
        """(u, v) [px]: the middle of the ink's box, or of the stretch."""
        return self.u, self.v

    @property
    def outline(self) -> list[list[list[float]]]:
        """The ink's outlines, half a pixel outside of it: a list of (K, 2) places."""
        if self.mask is None:
            return []
        padded = cv2.copyMakeBorder(self.mask.view(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT)
        contours, _ = cv2.findContours(padded, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        corner = np.array(self.box[:2]) - 1.0
        return [(contour[:, 0] + corner).round(1).tolist() for contour in contours]


def list_account(mask: NDArray[np.bool_], lines: Sequence[Stroke]) -> tuple[Entry, ...]:
    """All ink of a (H, W) mask beyond the lines' edges, and each bridged stretch, by size.

    The lines have the width of their pen.
    """
    from scipy.spatial import cKDTree

    pixels = np.argwhere(mask)[:, ::-1]
    if len(pixels) == 0:
        return ()
    edge_distance = np.full(len(pixels), np.inf)
    for line in lines:
        to_line, _ = cKDTree(line.points).query(pixels)
        edge_distance = np.minimum(edge_distance, to_line - line.width / 2)
    # Connected pieces, but for specks.
    outside = pixels[edge_distance > tuned.EDGE_BLUR_PX]
    pieces = []
    if len(outside):
        corner = outside.min(axis=0)
        width, height = (outside.max(axis=0) - corner + 1).tolist()
        picture = np.zeros((height, width), np.uint8)
        picture[outside[:, 1] - corner[1], outside[:, 0] - corner[0]] = 1
        _, labels = cv2.connectedComponents(picture, connectivity=8)
        label = labels[outside[:, 1] - corner[1], outside[:, 0] - corner[0]]
        sizes = np.bincount(label)[1:]
        pieces = np.split(np.argsort(label, kind="stable"), np.cumsum(sizes)[:-1])
    rows = []
    for members in pieces:
        if len(members) < tuned.SPECK_PX:
            continue
        piece = outside[members]
        low, high = piece.min(axis=0), piece.max(axis=0)
        box = (*low.tolist(), *(high - low + 1).tolist())
        piece_mask = np.zeros((box[3], box[2]), bool)
        piece_mask[piece[:, 1] - low[1], piece[:, 0] - low[0]] = True
        rows.append((len(piece), *((low + high) / 2).tolist(), "ink", box, piece_mask))
    for line in lines:
        for run in runs(line.bridged, line.closed):
            u, v = line.points[run[len(run) // 2]].tolist()
            rows.append((len(run), u, v, "gap", (round(u), round(v), 1, 1), None))
    rows.sort(key=lambda row: (-row[0], *row[1:3]))
    return tuple(
        Entry(
            number,
            u,
            v,
            count,
            count / len(pixels),
            float(max(box[2:]) if what == "ink" else count),
            what,
            box,
            piece_mask,
        )
        for number, (count, u, v, what, box, piece_mask) in enumerate(rows[:MAX_ENTRIES], 1)
    )


def extraction_of(fixture: Fixture, settings: ExtractSettings) -> ExtractSettings:
    """The settings with which a bundle's curve was extracted, as far as it records them."""
    known = fixture.provenance.settings
    names = ("colour", "method", "max_gap_px", "accept_width", "stroke", "density_per_mm")
    recorded = {name: known[name] for name in names if name in known}
    for name in ("start", "end"):
        if name in known:
            recorded[name] = tuple(float(number) for number in str(known[name]).split(","))
    roi = boxes_of(known.get("roi"))[-1:]
    exclude = boxes_of(known.get("exclude"))
    return replace(settings, **recorded, roi=roi[0] if roi else None, exclude=exclude or None)


def boxes_of(text: Any) -> tuple[Box, ...]:
    """The boxes of a bundle's setting, such as "1,2,30,40;5,6,7,8"."""
    areas = []
    for part in str(text or "").split(";"):
        numbers = part.split(",")
        if len(numbers) == 4 and all(number.strip().isdigit() for number in numbers):
            areas.append(tuple(int(number) for number in numbers))
    return tuple(areas)


# Routes that are offered at most: one digit chooses among them.
MAX_ROUTES = 9

# Free ends of a forked line beyond which it is writing, through which no route is offered.
MAX_FREE_ENDS = 12


def route_along(pixels: NDArray, closed: bool) -> Stroke:
    """A route that a curve may take over the ink, along skeleton pixels (u, v) in order."""
    return Stroke(pixels, closed, known_length=drawn_length(pixels, closed))


def routes_through(
    mask: NDArray[np.bool_], corner: tuple[int, int] = (0, 0)
) -> tuple[list[Stroke], list[tuple[float, float]]]:
    """The routes through one connected piece of ink, the longest first, and where it forks.

    A line has one route, from end to end, or around. A forked line has one for each pair of its
    free ends. `corner` is where (0, 0) of the mask lies on the slice.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra
    from skimage.morphology import skeletonize

    # The skeleton's pixels are the nodes of a graph, with an edge between neighbours.
    bone = skeletonize(np.pad(mask, 1), method="lee") > 0
    rows, columns = np.nonzero(bone)
    if len(rows) < 2:
        return [], []
    number = np.full(bone.shape, -1)
    number[rows, columns] = np.arange(len(rows))
    pairs, lengths = [], []
    for dv, du in ((0, 1), (1, 0), (1, 1), (1, -1)):
        neighbour = number[rows + dv, columns + du]
        keep = neighbour >= 0
        if dv and du:
            # The corner of a staircase is no fork.
            keep &= (number[rows + dv, columns] < 0) & (number[rows, columns + du] < 0)
        pairs.append(np.column_stack([np.flatnonzero(keep), neighbour[keep]]))
        lengths.append(np.full(keep.sum(), np.hypot(dv, du)))
    edges = np.concatenate(pairs)
    count = len(rows)
    degree = np.bincount(edges.ravel(), minlength=count)
    graph = coo_matrix((np.concatenate(lengths), edges.T), shape=(count, count)).tocsr()
    pixels = np.column_stack([columns, rows]) - 1.0 + np.array(corner, float)
    forks = [tuple(place) for place in pixels[degree > 2].tolist()]
    ends = np.flatnonzero(degree == 1)
    if len(ends) == 0:
        return _around(graph, pixels, edges), forks
    if len(ends) > MAX_FREE_ENDS:
        return [], forks

    # The shortest path from each end to each other one.
    distance, before = dijkstra(graph, directed=False, indices=ends, return_predecessors=True)
    routes = [
        route_along(pixels[_walked_back(before[i], start, stop)], False)
        for i, start in enumerate(ends)
        for stop in ends[i + 1 :]
        if np.isfinite(distance[i, stop])
    ]
    routes.sort(key=lambda route: -route.length)
    return routes[:MAX_ROUTES], forks


def _around(graph: Any, pixels: NDArray, edges: NDArray) -> list[Stroke]:
    """The one route around a ring: cut beside a pixel, and walked the other way round."""
    from scipy.sparse.csgraph import dijkstra

    cut = graph.tolil()
    start, stop = edges[0]
    cut[start, stop] = cut[stop, start] = 0
    cut = cut.tocsr()
    cut.eliminate_zeros()
    distance, before = dijkstra(cut, directed=False, indices=start, return_predecessors=True)
    if not np.isfinite(distance[stop]):
        return []
    return [route_along(pixels[_walked_back(before, start, stop)], True)]


def _walked_back(before: NDArray, start: int, stop: int) -> list[int]:
    """The pixels from `start` to `stop`, by each pixel's predecessor."""
    path = [stop]
    while path[-1] != start:
        path.append(before[path[-1]])
    return path[::-1]


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
    """

    strokes: tuple[MendedStroke, ...] = ()
    ink: SliceInk | None = None
    findings: tuple[Finding, ...] = ()
    refusal: dict[str, Any] | None = None
    candidates: tuple[Stroke, ...] = ()
    excluded_ink: frozenset[tuple[float, float]] = field(default_factory=frozenset)

    @cached_property
    def account(self) -> tuple[Entry, ...]:
        """The ink that is not the curve and its bridged stretches, the largest first."""
        if self.ink is None:
            return ()
        lines = []
        for stroke in self.strokes:
            width = stroke.width if stroke.is_ordered else 0.0
            if width is None:
                width = self.ink.width_along(stroke.points, stroke.closed)
            lines.append(replace(stroke, width=width))
        return list_account(self.ink.mask, lines)

    @property
    def all_findings(self) -> tuple[Finding, ...]:
        """The findings of extraction, and where a hand placed the curve."""
        findings = list(self.findings)
        for stroke in self.strokes:
            if not stroke.edited.any():
                continue
            first = stroke.points[np.flatnonzero(stroke.edited)[0]]
            text = (
                f"{int(stroke.edited.sum())} px of the curve were placed by hand where no ink "
                "shows them. Their deviation is taken as 1 px."
            )
            place_px = tuple(first.tolist())
            findings.append(note("drawn-by-hand", "extract", text, place_px=place_px))
        return tuple(findings)

    def stroke(self, number: int) -> MendedStroke:
        """A stroke by its number from 0; raises `SettingError` if there is none."""
        if not 0 <= number < len(self.strokes):
            raise SettingError(
                f"There is no stroke {number}. The curve has {len(self.strokes)}, from 0.",
                code="no-such-stroke",
                numbers={"stroke": number, "strokes": len(self.strokes)},
            )
        return self.strokes[number]

    def entry(self, number: int) -> Entry:
        """The ink of this number in the account; raises `SettingError` if there is none."""
        for entry in self.account:
            if entry.number == number and entry.what == "ink":
                return entry
        raise SettingError(
            f"There is no ink {number} in the account. It lists {len(self.account)} entries.",
            code="no-such-ink",
            numbers={"ink": number, "pieces": len(self.account)},
        )

    def candidate(self, number: int) -> Stroke:
        """A candidate by its number from 1; raises `SettingError` if there is none."""
        if not 1 <= number <= len(self.candidates):
            raise SettingError(
                f"There is no candidate {number}. There are {len(self.candidates)}, from 1.",
                code="no-such-candidate",
                numbers={"candidate": number, "candidates": len(self.candidates)},
            )
        return self.candidates[number - 1]

    def with_viewed(self, number: int, start: float, stop: float) -> Geometry:
        """The geometry with a part of a stroke viewed; nothing else changes."""
        strokes = list(self.strokes)
        strokes[number] = self.stroke(number).look_at(start, stop)
        return self._with_same_ink(strokes=tuple(strokes))

    def with_excluded(self, place: tuple[float, float]) -> Geometry:
        """The geometry with the ink at a place left out of the curve."""
        return self._with_same_ink(excluded_ink=self.excluded_ink | {place})

    def _with_same_ink(self, **changes: Any) -> Geometry:
        """A change by which the account stays what it is."""
        new = replace(self, **changes)
        if "account" in self.__dict__:
            new.__dict__["account"] = self.account
        return new

    def with_stroke(self, number: int, stroke: MendedStroke) -> Geometry:
        """The geometry with a stroke in another's place; findings there are mended."""
        from scipy.spatial import cKDTree

        strokes = list(self.strokes)
        before, strokes[number] = strokes[number], stroke
        # Points of either line that are not on the other.
        changed = []
        for one, other in ((before, stroke), (stroke, before)):
            distance, _ = cKDTree(other.points).query(one.points)
            changed.append(one.points[distance > MOVED_PX])
        findings = _unmended(self.findings, np.vstack(changed))
        return replace(self, strokes=tuple(strokes), findings=findings)

    def with_strokes(self, strokes: tuple[MendedStroke, ...]) -> Geometry:
        """The geometry with another curve, given by a person."""
        findings = self.findings
        if strokes:
            findings = _unmended(findings, np.vstack([stroke.points for stroke in strokes]))
        return replace(self, strokes=strokes, findings=findings, refusal=None)


def geometry_of_slice(
    path: Path, settings: ExtractSettings, ink: SliceInk | None, curve: Path | None = None
) -> Geometry:
    """What `vfplan extract` makes of a slice; a refusal becomes a part of the answer.

    `curve` is a file of a curve that was drawn on the slice as vectors.
    """
    try:
        extracted = extract(path, settings, curve=curve)
    except CurveError as error:
        if curve is not None:
            raise
        candidates = _candidates(error, ink, settings)
        return Geometry(ink=ink, refusal=_refusal_of(error), candidates=candidates)
    strokes = tuple(MendedStroke.of(stroke) for stroke in extracted.extraction.strokes)
    return Geometry(strokes, ink, extracted.findings)


def with_chosen(path: Path, settings: ExtractSettings, geometry: Geometry, number: int) -> Geometry:
    """The geometry with one of its candidates as the curve.

    `vfplan extract` measures the candidate if it can. If it refuses the line, because it forks or
    something lies beside it, the line is measured along the candidate itself.
    """
    route = geometry.candidate(number)
    settled = replace(geometry, refusal=None)
    try:
        extracted = extract(path, replace(settings, stroke=number))
    except CurveError as error:
        branches = _branches(geometry, route)
        if branches:
            return replace(geometry, refusal=_refusal_of(error), candidates=branches)
    else:
        strokes = extracted.extraction.strokes
        to_route = [nearest_point(strokes[0].points, place)[1] for place in route.points[::8]]
        if len(strokes) == 1 and max(to_route) < CLOSE_PX:
            mended = MendedStroke.of(strokes[0])
            return replace(settled, strokes=(mended,), findings=extracted.findings)
    line = geometry.ink.trace(route.points, route.closed)
    return replace(settled, strokes=(MendedStroke.of(line),), findings=())


def _branches(geometry: Geometry, route: Stroke) -> tuple[Stroke, ...]:
    """The routes through the forked ink of a candidate; none if the candidate is one of them."""
    middle = np.rint(route.points[len(route.points) // 2]).astype(int)
    for entry in Geometry(ink=geometry.ink).account:
        left_of, above = middle - entry.box[:2]
        inside = 0 <= left_of < entry.box[2] and 0 <= above < entry.box[3]
        if not inside or not entry.mask[above, left_of]:
            continue
        routes, forks = routes_through(entry.mask, entry.box[:2])
        if any(np.array_equal(other.points, route.points) for other in routes):
            return ()
        if forks and len(routes) > 1:
            return tuple(routes)
        return ()
    return ()


def route_over(entry: Entry) -> Stroke:
    """The line that a piece of ink draws; raises `SettingError` if it is none, or forks."""
    routes, _ = routes_through(entry.mask, entry.box[:2])
    if not routes or routes[0].length < tuned.MIN_PROFILES:
        raise SettingError(
            f"Ink {entry.number} is no line. Draw the curve by clicks instead.",
            code="ink-no-line",
            numbers={"ink": entry.number, "pixels": entry.pixels},
        )
    if len(routes) > 1:
        raise SettingError(
            f"Ink {entry.number} forks. Draw the curve along the branch that is meant.",
            code="ink-forks",
            numbers={"ink": entry.number, "ways": len(routes)},
        )
    return routes[0]


def _refusal_of(error: CurveError) -> dict[str, Any]:
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


def _candidates(error: CurveError, ink: SliceInk, settings: ExtractSettings) -> tuple[Stroke, ...]:
    """The candidates that extraction names, or every route through the lines of the ink."""
    routes = []
    if error.candidates:
        for path in error.candidates:
            path = np.asarray(path, float)
            closed = len(path) > 8 and np.hypot(*(path[0] - path[-1])) < 2.0
            routes.append(route_along(path, bool(closed)))
        return tuple(routes)
    for entry in Geometry(ink=ink).account:
        if max(entry.box[2:]) >= MIN_LINE_PX:
            routes += routes_through(entry.mask, entry.box[:2])[0]
    low, high = np.zeros(2), np.full(2, np.inf)
    if settings.roi is not None:
        low = np.array(settings.roi[:2], float)
        high = low + settings.roi[2:]
    long = [
        route
        for route in routes
        if route.length >= MIN_LINE_PX and ((route.points >= low) & (route.points < high)).all()
    ]
    long.sort(key=lambda route: -route.length)
    return tuple(long[:MAX_ROUTES])


def _unmended(findings: tuple[Finding, ...], changed: NDArray) -> tuple[Finding, ...]:
    """The findings without those whose place lies on what was changed."""
    kept = []
    for finding in findings:
        is_near = finding.place_px is not None and len(changed) > 0
        if not is_near or nearest_point(changed, finding.place_px)[1] > JOIN_PX:
            kept.append(finding)
    return tuple(kept)


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
