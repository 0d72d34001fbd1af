"""Stage sample: spacing against the error of the fixture's surface and against the cost of a tick.

The surface that a cloud renders is where the nearest point is R away; the surface that was planned
is where the curve is R away. The error is the gap between the two at places of the planned surface
(0 where a point stands abreast, the dimple's depth between two). The time is that of a tick of the
robust engine on this cloud, along the curve; how long the sampling itself took stands beside it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from vfplan.bench.record import Array, Record, Trial, errors_of, timed_ticks
from vfplan.engine.proxy import ProxyEngine
from vfplan.planning.tolerance import choose, sample_curve
from vfplan.scenes.outline import Run, arc, segment

R = 5e-3
FINE_M = 20e-6  # arc between the true curve's vertices
TOLERANCES = {True: (1e-4, 1e-5, 1e-6), False: (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7)}
PAPER_DENSITY = 5.3e3  # points a metre of Experiment 2
TICKS = 600
PRESS_M = 1e-3


@dataclass(frozen=True, eq=False)
class Line:
    """A true curve in the plane z = 0."""

    name: str  # of the scene
    run: Run

    @cached_property
    def fine(self) -> Array:
        """(M, 3) [m], every 20 µm of arc."""
        return np.pad(self.run.sample(FINE_M), ((0, 0), (0, 1)))

    @property
    def closed(self) -> bool:
        """Whether its last place joins the first."""
        return self.run.closed


def scenes(quick: bool, tolerance_m: float) -> Iterator[list[Trial]]:
    """The trials of each curve."""
    for line in lines()[1:] if quick else lines():
        yield _trials(line, TOLERANCES[quick], tolerance_m)


def lines() -> list[Line]:
    """A straight line, a circle of 30 mm, an S of 8 mm bends, and a hairpin of 2 mm."""
    there = segment((-30e-3, 2e-3), (0, 2e-3)), arc((0, 0), 2e-3, np.pi / 2, -np.pi)
    bends = arc((0, 0), 8e-3, np.pi, -np.pi), arc((16e-3, 0), 8e-3, np.pi, np.pi)
    return [
        Line("line", Run((segment((0, 0), (0.1, 0)),))),
        Line("circle, 30 mm", Run((arc((0, 0), 30e-3, 0, 2 * np.pi),), closed=True)),
        Line("S, 8 mm bends", Run(bends)),
        Line("hairpin, 2 mm", Run((*there, segment((0, -2e-3), (-30e-3, -2e-3))))),
    ]


def _trials(line: Line, tolerances: tuple[float, ...], tolerance_m: float) -> list[Trial]:
    surface = planned_surface(line)
    hips = _along(line)
    settings = [("by curvature", {"tolerance_m": t}) for t in tolerances]
    settings += [("even, by R alone", {"tolerance_m": t}) for t in tolerances]
    settings += [("the paper's density", {"density_per_m": PAPER_DENSITY})]
    chosen = {"tolerance_m": choose(tolerance_m, R).sampling_tolerance_m}
    trials = [_trial(line, method, given, surface, hips) for method, given in settings]
    return [*trials, _trial(line, "by curvature", chosen, surface, hips, chosen=True)]


def _trial(
    line: Line,
    method: str,
    settings: dict[str, float],
    surface: Array,
    hips: Array,
    chosen: bool = False,
) -> Trial:
    began = time.perf_counter()
    points = METHODS[method](line, **settings)
    plan_us = (time.perf_counter() - began) * 1e6
    engine = ProxyEngine(points, contact_radius=R, ignore_axis="z")

    def score(trace: object) -> Record:
        more = {"points": len(points), "plan_us": plan_us}
        return errors_of(surface_error(points, surface), **more)

    run = lambda: timed_ticks(engine, hips)  # noqa: E731 - reads as the field it fills
    return Trial(line.name, method, dict(settings), run, score, "m", chosen)


def planned_surface(line: Line) -> Array:
    """(K, 3) places of the planned surface: R beside the curve and round its ends [m].

    What another part of the curve swallows does not belong to it.
    """
    fine = line.fine
    normal = _normals(line)
    places = [fine + R * normal, fine - R * normal]
    if not line.closed:
        half = np.linspace(0, np.pi, 400)[:, None]
        for end, out in ((0, -1), (-1, 1)):
            n = normal[end]
            ahead = out * np.array([n[1], -n[0], 0.0])
            places.append(fine[end] + R * (np.cos(half) * n + np.sin(half) * ahead))
    everything = np.vstack(places)
    nearest, _ = cKDTree(fine).query(everything)
    return everything[nearest >= R * (1 - 1e-5)]


def _normals(line: Line) -> Array:
    f = line.fine
    padded = np.vstack([f[-1:], f, f[:1]]) if line.closed else f
    tangent = np.gradient(padded, axis=0)
    tangent = tangent[1:-1] if line.closed else tangent
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.column_stack([-tangent[:, 1], tangent[:, 0], 0 * tangent[:, 0]])


def surface_error(points: Array, surface: Array) -> Array:
    """(K,) how far the nearest point is beyond R from each place of the planned surface [m]."""
    nearest, _ = cKDTree(points).query(surface)
    return np.maximum(nearest - R, 0.0)


def _along(line: Line) -> Array:
    """(T, 3) a HIP that runs along the curve's left side, pressed in by 1 mm."""
    pick = np.linspace(0, len(line.fine) - 1, TICKS).astype(int)
    path = (line.fine + (R - PRESS_M) * _normals(line))[pick]
    start = line.fine[0] + 3 * R * _normals(line)[0]
    return np.vstack([start + np.linspace(0, 1, 40)[:, None] * (path[0] - start), path])


def _by_curvature(line: Line, tolerance_m: float) -> Array:
    return sample_curve(line.fine, line.closed, radius_m=R, tolerance_m=tolerance_m).points


def _even(line: Line, tolerance_m: float) -> Array:
    """What the flat dimple formula h²/8R = tolerance allows, bends or not."""
    return _dense(line, 1 / np.sqrt(8 * R * tolerance_m))


def _dense(line: Line, density_per_m: float) -> Array:
    return sample_curve(line.fine, line.closed, radius_m=R, density_per_m=density_per_m).points


METHODS: dict[str, Callable[..., Array]] = {
    "by curvature": _by_curvature,
    "even, by R alone": _even,
    "the paper's density": _dense,
}
