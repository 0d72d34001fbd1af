"""Sessions that go along a drawn curve, for the question whether an arm can do so at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.fixture import Fixture
from vfplan.session import Session

Array = NDArray[np.float64]

SPEED_M_S = 0.05  # of a hand that follows a drawn line with care
DEEP_M = 5e-3  # how far past contact the hand wants to go, the drawn line at most
CLEAR = 1.5  # of the distance at which the proxy stops, where a way begins and ends


def approach_sessions(
    fixture: Fixture, rate_hz: float = 1000.0, *, to_ends: bool = True
) -> list[Session]:
    """Hands that press on the drawn curve: along each stroke, on each of its sides.

    Beside a curve that is endless along an axis; of one in space above and below it, in the
    robot's frame. Each begins and ends clear of the curve.

    to_ends: whether open strokes are followed to their ends. A hand that presses there slips round
        them; without it, it stays as far from them as the proxy stops and the hand presses.
    Raises InputError: a fixture that was not drawn as a curve, or an open stroke with nothing
        between its ends
    """
    if fixture.curve is None or fixture.rendering is None:
        raise InputError("no drawn curve to go along; a session is wanted")
    numbers = fixture.curve.stroke
    sessions = []
    for stroke in np.unique(numbers).tolist():
        part = fixture.points[numbers == stroke]
        beside = _beside(part, fixture.ignore_axis)
        if not (to_ends or fixture.curve.closed[stroke]):
            inner = _between_ends(part, fixture.contact_radius + fixture.point_radius + DEEP_M)
            part, beside = part[inner], beside[inner]
        for name, side in (("left", beside), ("right", -beside)):
            hip = _way(fixture, part, side, rate_hz)
            time = np.arange(len(hip)) / rate_hz
            called = f"stroke {stroke}, {name} side"
            sessions.append(Session(time, hip, frame=fixture.frame, name=called))
    return sessions


def _between_ends(part: Array, clear: float) -> NDArray[np.bool_]:
    """(n,) which points of an open stroke are further along it from both ends than `clear` [m]."""
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(part, axis=0), axis=1))))
    inner = (along >= clear) & (along[-1] - along >= clear)
    if inner.sum() < 2:
        raise InputError(
            f"a drawn stroke is {1e3 * along[-1]:.3g} mm long; a hand that presses on it slips "
            f"round an end within {1e3 * clear:.3g} mm of it: a session is wanted"
        )
    return inner


def _beside(part: Array, axis: Array | None) -> Array:
    """(n, 3) unit vectors to one side of a stroke."""
    if axis is None or len(part) < 2:
        return np.tile([0.0, 0.0, 1.0], (len(part), 1))
    across = np.cross(axis, np.gradient(part, axis=0))
    return across / np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]


def _way(fixture: Fixture, part: Array, side: Array, rate_hz: float) -> Array:
    """(T, 3) at an even speed: from clear of the stroke, along it, and clear again."""
    stop = fixture.contact_radius + fixture.point_radius
    near = part + max(0.0, stop - DEEP_M) * side
    ends = part[[0, -1]] + CLEAR * stop * side[[0, -1]]
    way = np.concatenate((ends[:1], near, ends[1:]))
    run = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))))
    at = np.linspace(0.0, run[-1], max(2, int(run[-1] * rate_hz / SPEED_M_S) + 1))
    return np.column_stack([np.interp(at, run, way[:, k]) for k in range(3)])
