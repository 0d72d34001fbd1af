"""Lengths, normals and even steps along a line of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def ring_of(points: NDArray, closed: bool) -> Array:
    """The points of a line; those of a closed one end with the first again."""
    return np.vstack([points, points[:1]]) if closed else np.asarray(points, float)


def step_lengths(points: NDArray) -> Array:
    """(M - 1,) the distances of neighbouring points."""
    steps = np.diff(points, axis=0)
    return np.hypot(*steps.T) if steps.shape[1] == 2 else np.linalg.norm(steps, axis=1)


def arc_lengths(points: NDArray, closed: bool) -> Array:
    """(M,) the length of the line up to each point; of a closed one (M + 1,), back to the first."""
    return np.concatenate([[0.0], np.cumsum(step_lengths(ring_of(points, closed)))])


def length_of(points: NDArray, closed: bool) -> float:
    """The length of the line, of a closed one back to the first point."""
    return float(step_lengths(ring_of(points, closed)).sum())


def evenly(points: NDArray, closed: bool) -> Array:
    """The line at equal steps of about one unit; its ends stay where they are."""
    ring = ring_of(points, closed)
    arc = arc_lengths(points, closed)
    count = max(4, round(arc[-1]))
    at = np.linspace(0.0, arc[-1], count + 1)
    even = np.column_stack([np.interp(at, arc, column) for column in ring.T])
    return even[:-1] if closed else even


def normals(points: NDArray, closed: bool) -> Array:
    """(M, 2) unit normals of a line in the plane."""
    if closed:
        step = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    else:
        step = np.gradient(points, axis=0)
    step = step / np.maximum(np.hypot(*step.T), 1e-9)[:, None]
    return np.column_stack([-step[:, 1], step[:, 0]])


def values_at(values: NDArray, parameter: NDArray) -> Array:
    """Values (M,) or (M, K) of a line's points at float indices (N,) of these points.

    Between the last point of a closed line (index M - 1) and M lies the step back to the first.
    """
    ring = np.concatenate([values, values[:1]])
    below = np.minimum(parameter.astype(int), len(values) - 1)
    part = (parameter - below).reshape(-1, *[1] * (values.ndim - 1))
    return ring[below] * (1 - part) + ring[below + 1] * part
