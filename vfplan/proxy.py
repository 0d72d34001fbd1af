"""The native proxy engine's Python face: checks, then calls `_core`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vfplan import _core
from vfplan.checks import check_hip, check_path, check_points
from vfplan.rendering import ProxyParameters, Status, Step, Trace


class ProxyEngine:
    """Proxy engine over a point cloud; see `ProxyParameters.make` for the arguments."""

    def __init__(
        self,
        points: ArrayLike,
        contact_radius: float = 5e-3,
        band: float | None = None,
        point_radius: float = 0.0,
        stiffness: float | ArrayLike = 1000.0,
        rule: str = "robust",
        ignore_axis: str | ArrayLike | None = None,
        outer_radius: float | None = None,
        gain: float = 1.0,
        max_iterations: int | None = None,
    ) -> None:
        par = self.parameters = ProxyParameters.make(
            points,
            contact_radius=contact_radius,
            band=band,
            point_radius=point_radius,
            stiffness=stiffness,
            rule=rule,
            ignore_axis=ignore_axis,
            outer_radius=outer_radius,
            gain=gain,
        )
        axis = np.zeros(3) if par.ignore_axis is None else par.ignore_axis
        self._core = _core.Engine(
            np.ascontiguousarray(check_points(points)),
            rule == "robust",
            par.rc,
            par.band,
            par.rv,
            par.r3,
            par.xi,
            list(par.stiffness),
            list(axis),
            par.ignore_axis is not None,
            max_iterations or 16,
        )

    @property
    def left_out(self) -> dict[str, int]:
        """What the scene did not need."""
        return {}

    def reset(self, hip: ArrayLike) -> None:
        """Put the proxy at `hip` (3,) [m]."""
        self._core.reset(list(check_hip(hip, finite=True)))

    def step(self, hip: ArrayLike) -> Step:
        """One tick."""
        t = self.run(np.asarray(check_hip(hip))[None])
        return Step(t.proxy[0], t.normal[0], t.force[0], int(t.state[0]), Status(int(t.status[0])))

    def run(self, hips: ArrayLike) -> Trace:
        """One tick a row of `hips` (T, 3) [m]."""
        path = np.ascontiguousarray(check_path(hips))
        n = len(path)
        out = [np.empty((n, 3)) for _ in range(3)]
        state, status = np.empty(n, np.int8), np.empty(n, np.uint8)
        self._core.run(path, *out, state, status)
        return Trace(*out, state, status)
