"""Where a person says that the curve begins and ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.ridge import Centreline
from vfplan.errors import CurveError

NEAR_WIDTHS, NEAR_PX = 3.0, 10.0  # from the line: a place farther off is not meant to be on it

Place = tuple[float, float] | None


def through(candidates: list[Candidate], places: list[NDArray]) -> list[Candidate]:
    """The candidates that pass by all of the places [px]."""
    return [c for c in candidates if all(_distance(c.path, p) <= _reach(c) for p in places)]


def between(
    line: Candidate, found: Centreline, start: Place, end: Place, origin: tuple[int, int]
) -> Centreline:
    """The measured line from `start` to `end` (u, v) [px], in that direction.

    One of them alone gives the direction, and cuts off what lies beyond it; on a ring `start` says
    where it begins.

    Raises CurveError: a place lies off the line; both are the same place; an `end` was given for a
        ring
    """
    if start is None and end is None:
        return found
    if found.closed:
        if end is not None:
            raise CurveError("the curve is closed and has no end; leave --end out")
        return _rolled(found, -_index(line, found, start, "--start", origin))
    last = len(found.points) - 1
    first = None if start is None else _index(line, found, start, "--start", origin)
    stop = None if end is None else _index(line, found, end, "--end", origin)
    if first is None:
        first = 0 if stop > last / 2 else last
    if stop is None:
        stop = last if first < last / 2 else 0
    if first == stop:
        raise CurveError("--start and --end lie on the same point of the curve")
    keep = np.arange(min(first, stop), max(first, stop) + 1)
    keep = keep if first < stop else keep[::-1]
    points = found.points[keep]
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return replace(
        found,
        points=points,
        sigma=found.sigma[keep],
        bridged=found.bridged[keep],
        length=length,
    )


def _rolled(found: Centreline, by: int) -> Centreline:
    names = ("points", "sigma", "bridged")
    return replace(found, **{name: np.roll(getattr(found, name), by, axis=0) for name in names})


def _index(
    line: Candidate, found: Centreline, place: Place, option: str, origin: tuple[int, int]
) -> int:
    at = np.subtract(place, origin)
    away = _distance(found.points, at)
    if away > _reach(line):
        raise CurveError(
            f"{option} {place[0]:g},{place[1]:g} lies {away:.0f} px off the curve; at most "
            f"{_reach(line):.0f} px are allowed"
        )
    return int(np.hypot(*(found.points - at).T).argmin())


def _distance(points: NDArray, place: NDArray) -> float:
    return float(np.hypot(*(points - place).T).min())


def _reach(line: Candidate) -> float:
    return max(NEAR_WIDTHS * line.width_px, NEAR_PX)
