"""What the review knows of the slice: its curve, or why there is none, and all other ink.

`Geometry` is immutable. It says what `vfplan extract` would say of the slice, and holds what a
person made of it since.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, SettingError
from vfplan.findings import Finding, note
from vfplan.planning import ExtractSettings, extract
from vfplan.review.ink import MIN_INK_PX, MIN_LINE_PX, Ink, Way, ways_through
from vfplan.review.paths import nearest_point
from vfplan.review.strokes import Stroke

MENDED_PX = 12.0
"""Distance [px] from a changed stretch within which what was found there is taken as mended."""

MOVED_PX = 0.5
"""Distance [px] from its old line from which a point counts as changed."""

BESIDE_PX = 2.0
"""Distance [px] beyond the pen's edge up to which ink belongs to the curve: the edge's blur."""

MAX_ACCOUNT = 200
"""How many pieces of other ink are listed at most; more is a photograph, not a drawing."""


@dataclass(frozen=True)
class Refusal:
    """Why there is no curve yet: the code, the words and, where known, the place (u, v) [px]."""

    code: str
    text: str
    place_px: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class OtherInk:
    """A piece of ink that is not the curve."""

    number: int  # from 1, the largest first
    place: tuple[float, float]  # a pixel of it
    pixels: int
    share: float  # of all ink
    box: tuple[int, int, int, int]
    mask: NDArray[np.bool_]  # (height, width) of the box

    @property
    def outline(self) -> list[list[list[float]]]:
        """Its outlines, half a pixel outside of it: a list of (K, 2) places."""
        padded = cv2.copyMakeBorder(self.mask.view(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT)
        found, _ = cv2.findContours(padded, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        corner = np.array(self.box[:2]) - 1.0
        return [(contour[:, 0] + corner).round(1).tolist() for contour in found]


@dataclass(frozen=True, eq=False)
class Geometry:
    """The curve on its slice, as far as it is settled.

    Parameters
    ----------
    strokes
        The lines of the curve; none while it is not settled which they are.
    ink
        The pen's ink; `None` where the slice is not at hand.
    findings
        What extraction doubts or notes, less what was mended.
    refusal
        Why extraction gave no curve; `None` where it did, or where a person gave one.
    candidates
        Ways that the curve may take, from which a person can choose.
    left
        Places of ink that a person leaves out of the curve.
    """

    strokes: tuple[Stroke, ...] = ()
    ink: Ink | None = None
    findings: tuple[Finding, ...] = ()
    refusal: Refusal | None = None
    candidates: tuple[Way, ...] = ()
    left: frozenset[tuple[float, float]] = field(default_factory=frozenset)

    @cached_property
    def account(self) -> tuple[OtherInk, ...]:
        """The ink that is not the curve, the largest piece first."""
        if self.ink is None:
            return ()
        mask = self.ink.mask.view(np.uint8)
        left, top, width, height = cv2.boundingRect(mask)
        if not width:
            return ()
        rest = mask[top : top + height, left : left + width].copy()
        total = int(np.count_nonzero(rest))
        for stroke in self.strokes:
            pen = self.ink.width_along(stroke.points, stroke.closed)
            line = np.rint((stroke.points - (left, top)) * 16).astype(np.int32)
            thick = max(1, round(pen + 2 * BESIDE_PX))
            cv2.polylines(rest, [line[:, None]], stroke.closed, 0, thick, cv2.LINE_8, shift=4)
        count, label, sizes, _ = cv2.connectedComponentsWithStats(rest, connectivity=8)
        order = sorted(range(1, count), key=lambda k: (-sizes[k, cv2.CC_STAT_AREA], k))
        pieces = []
        for k in order[:MAX_ACCOUNT]:
            u, v, columns, rows, pixels = (int(x) for x in sizes[k])
            if pixels < MIN_INK_PX:
                break
            own = label[v : v + rows, u : u + columns] == k
            inside = np.argwhere(own)
            middle = inside.mean(axis=0)
            place = inside[np.hypot(*(inside - middle).T).argmin()]
            pieces.append(
                OtherInk(
                    number=len(pieces) + 1,
                    place=(float(place[1] + u + left), float(place[0] + v + top)),
                    pixels=pixels,
                    share=pixels / total,
                    box=(u + left, v + top, columns, rows),
                    mask=own,
                )
            )
        return tuple(pieces)

    @property
    def all_findings(self) -> tuple[Finding, ...]:
        """What extraction found, and where a hand placed the curve."""
        return self.findings + tuple(
            note(
                "drawn-by-hand",
                "extract",
                f"{int(stroke.edited.sum())} px of the curve were placed by hand where no ink "
                "shows them. Their deviation is taken as 1 px.",
                place_px=tuple(stroke.points[np.flatnonzero(stroke.edited)[0]].tolist()),
            )
            for stroke in self.strokes
            if stroke.edited.any()
        )

    def stroke(self, number: int) -> Stroke:
        """A stroke by its number from 0; raises `SettingError` where there is none."""
        if not 0 <= number < len(self.strokes):
            raise SettingError(
                f"there is no stroke {number}; the curve has {len(self.strokes)}",
                code="no-such-stroke",
                numbers={"stroke": number, "strokes": len(self.strokes)},
            )
        return self.strokes[number]

    def looked_at(self, number: int, start: float, stop: float) -> Geometry:
        """The geometry with a part of a stroke seen; nothing else changes."""
        strokes = list(self.strokes)
        strokes[number] = self.stroke(number).look_at(start, stop)
        return self._same_ink(strokes=tuple(strokes))

    def leaving(self, place: tuple[float, float]) -> Geometry:
        """The geometry with the ink at a place left out of the curve."""
        return self._same_ink(left=self.left | {place})

    def _same_ink(self, **changes: Any) -> Geometry:
        """A change by which the account stays what it is."""
        new = replace(self, **changes)
        if "account" in self.__dict__:
            new.__dict__["account"] = self.account
        return new

    def with_stroke(self, number: int, stroke: Stroke) -> Geometry:
        """The geometry with a stroke in another's place; what was found there is mended."""
        strokes = list(self.strokes)
        before = strokes[number]
        strokes[number] = stroke
        changed = _changed(before, stroke)
        return replace(self, strokes=tuple(strokes), findings=_unmended(self.findings, changed))

    def with_strokes(self, strokes: tuple[Stroke, ...]) -> Geometry:
        """The geometry with another curve, given by a person."""
        points = [stroke.points for stroke in strokes]
        findings = _unmended(self.findings, np.vstack(points)) if points else self.findings
        return replace(self, strokes=strokes, findings=findings, refusal=None)

    def other_ink(self, number: int) -> OtherInk:
        """A piece of the account; raises `SettingError` where there is none of that number."""
        for piece in self.account:
            if piece.number == number:
                return piece
        raise SettingError(
            f"there is no ink {number} in the account; it lists {len(self.account)}",
            code="no-such-ink",
            numbers={"ink": number, "pieces": len(self.account)},
        )

    def way(self, number: int) -> Way:
        """A candidate by its number from 1; raises `SettingError` where there is none."""
        if not 1 <= number <= len(self.candidates):
            raise SettingError(
                f"there is no candidate {number}; there are {len(self.candidates)}, from 1",
                code="no-such-candidate",
                numbers={"candidate": number, "candidates": len(self.candidates)},
            )
        return self.candidates[number - 1]


def geometry_of_slice(path: Path, settings: ExtractSettings, ink: Ink) -> Geometry:
    """What `vfplan extract` makes of a slice; a refusal becomes a part of the answer."""
    try:
        extracted = extract(path, settings)
    except CurveError as error:
        return Geometry(
            ink=ink, refusal=_refusal_of(error), candidates=_candidates(error, ink, settings)
        )
    strokes = []
    for line in extracted.extraction.strokes:
        strokes.append(Stroke.measured(line.points_px, line.sigma_px, line.closed, line.bridged))
    return Geometry(tuple(strokes), ink, extracted.findings)


def chosen(path: Path, settings: ExtractSettings, geometry: Geometry, number: int) -> Geometry:
    """The geometry with one of its candidates as the curve.

    `vfplan extract` measures the candidate where it can. Where it would refuse the line, because
    it forks or something lies beside it, the line is measured along the way that was chosen.
    """
    way = geometry.way(number)
    settled = replace(geometry, refusal=None)
    try:
        extracted = extract(path, replace(settings, stroke=number))
    except CurveError as error:
        extracted = None
        branches = _branches(geometry, way)
        if branches:
            return replace(geometry, refusal=_refusal_of(error), candidates=branches)
    if extracted is not None:
        lines = extracted.extraction.strokes
        off = [nearest_point(line.points_px, place)[1] for line in lines for place in way.path[::8]]
        if len(lines) == 1 and max(off) < 4.0:
            line = lines[0]
            stroke = Stroke.measured(line.points_px, line.sigma_px, line.closed, line.bridged)
            return replace(settled, strokes=(stroke,), findings=extracted.findings)
    line = geometry.ink.trace(way.path, way.closed)
    return replace(settled, strokes=(Stroke.from_ink(line, way.closed),), findings=())


def _branches(geometry: Geometry, way: Way) -> tuple[Way, ...]:
    """The ways through the forked ink of a candidate; none where the candidate is one of them."""
    middle = way.path[len(way.path) // 2]
    for piece in Geometry(ink=geometry.ink).account:
        u, v = np.rint(middle).astype(int) - piece.box[:2]
        if not (0 <= u < piece.box[2] and 0 <= v < piece.box[3] and piece.mask[v, u]):
            continue
        ways, forks = ways_through(piece.mask)
        corner = np.array(piece.box[:2], float)
        ways = [Way(each.path + corner, each.closed) for each in ways]
        for each in ways:
            if len(each.path) == len(way.path) and np.array_equal(each.path, way.path):
                return ()
        return tuple(ways) if forks and len(ways) > 1 else ()
    return ()


def way_over(piece: OtherInk) -> Way:
    """The line that a piece of ink draws; raises `SettingError` where it is none, or forks."""
    ways, _ = ways_through(piece.mask)
    if not ways or ways[0].length_px < 4.0:
        raise SettingError(
            f"ink {piece.number} is no line; draw the curve by clicks instead",
            code="ink-no-line",
            numbers={"ink": piece.number, "pixels": piece.pixels},
        )
    if len(ways) > 1:
        raise SettingError(
            f"ink {piece.number} forks; draw the curve along the branch that is meant",
            code="ink-forks",
            numbers={"ink": piece.number, "ways": len(ways)},
        )
    return Way(ways[0].path + np.array(piece.box[:2], float), ways[0].closed)


def _refusal_of(error: CurveError) -> Refusal:
    """The refusal without its advice to open the page, on which it is shown."""
    sentences = re.split(r"(?<=\.) ", error.message)
    text = " ".join(s for s in sentences if "vfplan review" not in s) or error.message
    place = None
    if {"u_px", "v_px"} <= set(error.numbers):
        place = (float(error.numbers["u_px"]), float(error.numbers["v_px"]))
    return Refusal(error.code, text, place)


def _candidates(error: CurveError, ink: Ink, settings: ExtractSettings) -> tuple[Way, ...]:
    """The candidates that extraction names, or every way through the lines that the ink draws."""
    if error.candidates:
        ways = []
        for path in error.candidates:
            path = np.asarray(path, float)
            ways.append(Way(path, bool(len(path) > 8 and np.hypot(*(path[0] - path[-1])) < 2.0)))
        return tuple(ways)
    ways = []
    for piece in Geometry(ink=ink).account:
        if max(piece.box[2:]) < MIN_LINE_PX:
            continue
        through, _ = ways_through(piece.mask)
        corner = np.array(piece.box[:2], float)
        ways += [Way(way.path + corner, way.closed) for way in through]
    if settings.roi is not None:
        u, v, width, height = settings.roi
        low, high = np.array([u, v]), np.array([u + width, v + height])
        ways = [way for way in ways if ((way.path >= low) & (way.path < high)).all()]
    long = [way for way in ways if way.length_px >= MIN_LINE_PX]
    long.sort(key=lambda way: -way.length_px)
    return tuple(long[:9])


def _changed(before: Stroke, after: Stroke) -> NDArray[np.float64]:
    """(M, 2) points of either line that lie off the other."""
    from scipy.spatial import cKDTree

    changed = []
    for one, other in ((before, after), (after, before)):
        distance, _ = cKDTree(other.points).query(one.points)
        changed.append(one.points[distance > MOVED_PX + 0.5])  # half a step between two points
    return np.vstack(changed)


def _unmended(findings: tuple[Finding, ...], changed: NDArray) -> tuple[Finding, ...]:
    """The findings without those whose place lies on what was changed."""
    if not len(changed):
        return findings
    kept = []
    for finding in findings:
        if finding.place_px is not None:
            _, distance = nearest_point(changed, finding.place_px)
            if distance <= MENDED_PX:
                continue
        kept.append(finding)
    return tuple(kept)


def describe_way(number: int, way: Way) -> dict[str, Any]:
    """A candidate as the page shows it."""
    shape = "closed" if way.closed else "open"
    return {
        "number": number,
        "points_px": way.path[:: max(1, len(way.path) // 200)].round(1).tolist(),
        "closed": way.closed,
        "length_px": way.length_px,
        "text": f"{shape}, {way.length_px:.0f} px long",
    }
