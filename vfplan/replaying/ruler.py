"""Where along the planned curve a place is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.fixture import Fixture

Array = NDArray[np.float64]


class CurveRuler:
    """Arc length along a fixture's strokes.

    fixture: one with a `curve`
    """

    def __init__(self, fixture: Fixture) -> None:
        assert fixture.curve is not None, "a cloud without a curve has no arc length"
        self.points = flattened(fixture.points, fixture.ignore_axis)
        self._axis = fixture.ignore_axis
        self.stroke = fixture.curve.stroke
        step = np.linalg.norm(np.diff(fixture.points, axis=0), axis=1)
        step[np.diff(self.stroke) != 0] = 0.0
        run = np.concatenate(([0.0], np.cumsum(step)))
        first = np.searchsorted(self.stroke, self.stroke)  # each point's stroke's first point
        self.arclength = run - run[first]

    @staticmethod
    def of(fixture: Fixture) -> CurveRuler | None:
        """The ruler of a fixture, or `None` when it was not drawn as a curve."""
        return None if fixture.curve is None else CurveRuler(fixture)

    def locate(self, place: Array) -> dict[str, Any]:
        """The stroke, the arc length [m] and the index of the planned point nearest to a place."""
        k = int(self.nearest(place[None])[0])
        return {"stroke": int(self.stroke[k]), "s_m": float(self.arclength[k]), "point": k}

    def nearest(self, places: Array) -> NDArray[np.intp]:
        """(n,) index of the planned point nearest to each of (n, 3) places, by brute force."""
        flat = flattened(places, self._axis)
        found = np.empty(len(flat), dtype=np.intp)
        rows = max(1, 4_000_000 // len(self.points))
        for start in range(0, len(flat), rows):
            part = flat[start : start + rows]
            found[start : start + rows] = ((part[:, None] - self.points) ** 2).sum(2).argmin(1)
        return found


def flattened(places: Array, axis: Array | None) -> Array:
    """(n, 3) places without their part along an ignored axis (a unit vector, or `None`)."""
    return places if axis is None else places - np.outer(places @ axis, axis)
