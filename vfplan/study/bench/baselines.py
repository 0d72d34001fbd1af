"""What a user would write instead of a proxy engine."""

from __future__ import annotations

from typing import Any

import numpy as np

from vfplan.engine.parameters import ProxyParameters, Status, Step
from vfplan.study.bench.record import Array


class NearestPointPenalty:
    """A vector field: pushed out of the ball of radius R around the nearest point, no memory.

    The "proxy" of a penalty force F = K (R - |x|) x/|x| is where that force would be zero. Once the
    HIP is past the cloud it is pushed out on the other side.

    points: (N, 3) [m]
    parameters: as for `ProxyEngine`
    """

    def __init__(self, points: Array, **parameters: Any) -> None:
        from scipy.spatial import cKDTree

        self.parameters = ProxyParameters.make(points, rule="paper", **parameters)
        axis = self.parameters.ignore_axis
        self._flat = np.eye(3) if axis is None else np.eye(3) - np.outer(axis, axis)
        self._points = points @ self._flat
        self._tree = cKDTree(self._points)

    def reset(self, hip: Array) -> None:
        """Nothing to remember."""

    def step(self, hip: Array) -> Step:
        """One tick."""
        x = self._flat @ hip
        distance, i = self._tree.query(x)
        away = x - self._points[i]
        short = self.parameters.R - distance
        normal = away / distance if distance > 0 else np.zeros(3)
        push = normal * max(short, 0.0)
        force = self.parameters.stiffness * push
        return Step(hip + push, normal, force, 1 if short > 0 else 0, Status.OK)
