"""Sessions that follow a drawn curve, for the question whether an arm can do so at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.fixture import Fixture
from vfplan.session import Session

Array = NDArray[np.float64]

SPEED_M_S = 0.05
"""Speed of the hand [m/s]. A hand that follows a drawn line with care is about as fast."""

PRESS_DEPTH_M = 5e-3
"""How far beyond contact the hand wants to be [m], but never beyond the drawn line."""

START_DISTANCE = 1.5
"""Where a session begins and ends, in units of the distance at which the proxy stops. Above 1, so
that the hand starts without contact."""


def approach_sessions(
    fixture: Fixture, rate_hz: float = 1000.0, *, to_ends: bool = True
) -> list[Session]:
    """Hands that press on the drawn curve: along each stroke, on each of its sides.

    Left and right of a curve that is endless along an axis; above and below one in space, in the
    robot's frame. Each begins and ends clear of the curve.

    to_ends: whether open strokes are followed to their ends. A hand that presses there slips round
        them; without it, it stays as far from them as the proxy stops and the hand presses.
    Raises InputError: a fixture that was not drawn as a curve, or an open stroke with nothing
        between its ends
    """
    if fixture.curve is None or fixture.rendering is None:
        raise InputError(
            "the fixture has no drawn curve to follow. Give a session", code="no-curve"
        )
    stop = fixture.contact_radius + fixture.point_radius
    sessions = []
    for number, stroke in enumerate(fixture.strokes):
        points = stroke.points
        normals = side_normals(points, fixture.ignore_axis)
        if not to_ends and not stroke.closed:
            arc = arc_length(points)
            clear = stop + PRESS_DEPTH_M
            inner = (arc >= clear) & (arc[-1] - arc >= clear)
            if inner.sum() < 2:
                raise InputError(
                    f"a drawn stroke is {1e3 * arc[-1]:.3g} mm long, and a hand that presses "
                    f"on it slips round an end within {1e3 * clear:.3g} mm of it. Give a "
                    "session",
                    code="stroke-too-short",
                    numbers={"length_m": float(arc[-1]), "clear_m": clear},
                )
            points = points[inner]
            normals = normals[inner]
        for name, side in (("left", normals), ("right", -normals)):
            # Clear of the stroke, along it, and clear again, at an even speed.
            pressed = points + max(0.0, stop - PRESS_DEPTH_M) * side
            ends = points[[0, -1]] + START_DISTANCE * stop * side[[0, -1]]
            path = np.concatenate((ends[:1], pressed, ends[1:]))
            arc = arc_length(path)
            ticks = max(2, int(arc[-1] * rate_hz / SPEED_M_S) + 1)
            wanted = np.linspace(0.0, arc[-1], ticks)
            hip = np.empty((ticks, 3))
            for axis in range(3):
                hip[:, axis] = np.interp(wanted, arc, path[:, axis])
            time = np.arange(ticks) / rate_hz
            title = f"stroke {number}, {name} side"
            sessions.append(Session(time, hip, frame=fixture.frame, name=title))
    return sessions


def arc_length(points: Array) -> Array:
    """(n,) length along a polyline from its first point to each of its points (n, 3)."""
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))


def side_normals(points: Array, axis: Array | None) -> Array:
    """(n, 3) unit vectors from the points of a stroke to one of its sides."""
    if axis is None or len(points) < 2:
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))
    normals = np.cross(axis, np.gradient(points, axis=0))
    return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
