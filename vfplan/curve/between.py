"""The part of a measured curve between two places that the caller named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.centreline import MeasuredStroke
from vfplan.errors import CurveError
from vfplan.findings import Finding

REACH_WIDTHS = 3.0
"""Pen widths from the line: a place that is farther away is not meant to be on it."""
REACH_PX = 10.0
"""The same in pixels, for thin lines. A person clicks this well."""

Place = tuple[float, float] | None


def lines_through(lines: list[Candidate], start: Place, end: Place) -> list[Candidate]:
    """The lines that pass by the named places (u, v) [px].

    Raises `CurveError` where there are lines and none passes by all of the places. The error names
    the place that the nearest line misses.
    """
    passing = []
    errors = []
    for line in lines:
        error = _missed_place(line, start, end)
        if error is None:
            passing.append(line)
        else:
            errors.append(error)
    if errors and not passing:
        raise min(errors, key=lambda error: error.numbers["distance_px"])
    return passing


def _missed_place(line: Candidate, start: Place, end: Place) -> CurveError | None:
    """The error for the named place that lies farthest off a line, or `None` if both lie on it."""
    farthest = _reach(line.width)
    error = None
    for option, place in (("--start", start), ("--end", end)):
        if place is None:
            continue
        distance = _distance(line.path, place)
        if distance > farthest:
            farthest = distance
            error = _off_curve_error(option, place, distance, line.width)
    return error


def cut_to(curve: MeasuredStroke, start: Place, end: Place) -> MeasuredStroke:
    """The curve from `start` to `end` (u, v) [px], in that direction.

    One of them alone gives the direction, and cuts off what lies beyond it. On a ring, `start` says
    where it begins.

    Raises `CurveError` where a place lies off the line, both are the same place, or an `end` is
    given for a ring.
    """
    if start is None and end is None:
        return curve
    if curve.closed:
        if end is not None:
            raise CurveError(
                "The curve is closed, so it has no end. Leave --end out.", code="end-of-a-ring"
            )
        by = -_index(curve, start, "--start")
        return replace(
            curve,
            points=np.roll(curve.points, by, axis=0),
            sigma=np.roll(curve.sigma, by),
            bridged=np.roll(curve.bridged, by),
            hidden=np.roll(curve.hidden, by),
        )
    last = len(curve.points) - 1
    first = stop = None
    if start is not None:
        first = _index(curve, start, "--start")
    if end is not None:
        stop = _index(curve, end, "--end")
    if first is None:
        first = last if stop <= last / 2 else 0
    if stop is None:
        stop = last if first < last / 2 else 0
    if first == stop:
        raise CurveError(
            "--start and --end lie on the same point of the curve. Move one of them.",
            code="start-is-end",
        )
    return _cut(curve, first, stop)


def without_cut_off(
    findings: list[Finding], curve: MeasuredStroke, cut: MeasuredStroke
) -> list[Finding]:
    """The findings that speak of the part of a curve that is left."""
    kept = []
    for finding in findings:
        place = finding.place_px
        if place is None or _distance(cut.points, place) <= _distance(curve.points, place) + 1.0:
            kept.append(finding)
    return kept


def _cut(curve: MeasuredStroke, first: int, stop: int) -> MeasuredStroke:
    keep = np.arange(min(first, stop), max(first, stop) + 1)
    ends = curve.ends
    if first > stop:
        keep = keep[::-1]
        ends = ends[::-1]
    return replace(
        curve,
        points=curve.points[keep],
        sigma=curve.sigma[keep],
        bridged=curve.bridged[keep],
        hidden=curve.hidden[keep],
        ends=ends,
    )


def _index(curve: MeasuredStroke, place: tuple[float, float], option: str) -> int:
    distance = _distance(curve.points, place)
    if distance > _reach(curve.width):
        raise _off_curve_error(option, place, distance, curve.width)
    return int(np.hypot(*(curve.points - place).T).argmin())


def _off_curve_error(
    option: str, place: tuple[float, float], distance: float, width: float
) -> CurveError:
    reach = _reach(width)
    return CurveError(
        f"{option} {place[0]:g},{place[1]:g} lies {distance:.0f} px off the curve. Name a "
        f"place within {reach:.0f} px of it.",
        code="place-off-curve",
        numbers={"distance_px": distance, "distance_max_px": reach},
    )


def _distance(points: NDArray, place: tuple[float, float]) -> float:
    return float(np.hypot(*(points - place).T).min())


def _reach(width: float) -> float:
    return max(REACH_WIDTHS * width, REACH_PX)
