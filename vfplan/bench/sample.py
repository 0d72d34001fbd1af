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
from functools import cached_property, partial

import numpy as np
from scipy.spatial import cKDTree

from vfplan.bench.proxy import R
from vfplan.bench.record import Array, BenchRun, Record, Setting, errors_of, timed_ticks
from vfplan.engine.proxy import ProxyEngine
from vfplan.planning.tolerance import choose, sample_curve
from vfplan.scenes.outline import Run, arc, segment

FINE_M = 20e-6
"""Arc between the true curve's vertices [m]."""

PAPER_DENSITY = 5.3e3
"""Points a metre of the paper's Experiment 2."""

TICKS = 600
"""Number of ticks along the curve."""

PRESS_M = 1e-3
"""Depth to which the HIP is pressed in [m]."""


@dataclass(frozen=True, eq=False)
class TrueCurve:
    """A true curve in the plane z = 0, and the name of its scene."""

    name: str
    run: Run

    @cached_property
    def fine(self) -> Array:
        """(M, 3) [m], every 20 µm of arc."""
        return np.pad(self.run.sample(FINE_M), ((0, 0), (0, 1)))

    @cached_property
    def normals(self) -> Array:
        """(M, 3) unit normals at the vertices of `fine`, to the left."""
        if self.run.closed:
            padded = np.vstack([self.fine[-1:], self.fine, self.fine[:1]])
            tangent = np.gradient(padded, axis=0)[1:-1]
        else:
            tangent = np.gradient(self.fine, axis=0)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        return np.column_stack([-tangent[:, 1], tangent[:, 0], 0 * tangent[:, 0]])


def scenes(quick: bool, tolerance_m: float) -> Iterator[list[BenchRun]]:
    """The runs of each curve."""
    tolerances = [1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7]
    curves = lines()
    if quick:
        tolerances = [1e-4, 1e-5, 1e-6]
        curves = curves[1:]
    chosen_m = choose(tolerance_m, R).sampling_tolerance_m
    for line in curves:
        surface = planned_surface(line)

        # A HIP along the left side of the curve, pressed in, after an approach from outside.
        picked = np.linspace(0, len(line.fine) - 1, TICKS).astype(int)
        path = (line.fine + (R - PRESS_M) * line.normals)[picked]
        start = line.fine[0] + 3 * R * line.normals[0]
        approach = start + np.linspace(0, 1, 40)[:, None] * (path[0] - start)
        hips = np.vstack([approach, path])

        runs = []
        for tolerance in tolerances:
            for method in ("by curvature", "even, by R alone"):
                runs.append(sample_run(line, method, {"tolerance_m": tolerance}, surface, hips))
        density = {"density_per_m": PAPER_DENSITY}
        runs.append(sample_run(line, "the paper's density", density, surface, hips))
        chosen = {"tolerance_m": chosen_m}
        runs.append(sample_run(line, "by curvature", chosen, surface, hips, chosen=True))
        yield runs


def lines() -> list[TrueCurve]:
    """A straight line, a circle of 30 mm, an S of 8 mm bends, and a hairpin of 2 mm."""
    straight = Run((segment((0, 0), (0.1, 0)),))
    circle = Run((arc((0, 0), 30e-3, 0, 2 * np.pi),), closed=True)
    bends = Run((arc((0, 0), 8e-3, np.pi, -np.pi), arc((16e-3, 0), 8e-3, np.pi, np.pi)))
    hairpin = Run(
        (
            segment((-30e-3, 2e-3), (0, 2e-3)),
            arc((0, 0), 2e-3, np.pi / 2, -np.pi),
            segment((0, -2e-3), (-30e-3, -2e-3)),
        )
    )
    return [
        TrueCurve("line", straight),
        TrueCurve("circle, 30 mm", circle),
        TrueCurve("S, 8 mm bends", bends),
        TrueCurve("hairpin, 2 mm", hairpin),
    ]


def sample_run(
    line: TrueCurve,
    method: str,
    settings: dict[str, Setting],
    surface: Array,
    hips: Array,
    chosen: bool = False,
) -> BenchRun:
    """One method of sampling with one setting, and the engine's ticks on the cloud it gives."""
    started = time.perf_counter()
    points = METHODS[method](line, **settings)
    sampling_us = (time.perf_counter() - started) * 1e6
    engine = ProxyEngine(points, contact_radius=R, ignore_axis="z")

    def score(trace: object) -> Record:
        errors = surface_error(points, surface)
        return errors_of(errors, points=len(points), plan_us=sampling_us)

    run = partial(timed_ticks, engine, hips)
    return BenchRun(line.name, method, settings, run, score, "m", chosen)


def planned_surface(line: TrueCurve) -> Array:
    """(K, 3) places of the planned surface: R beside the curve and round its ends [m].

    What another part of the curve swallows does not belong to it.
    """
    fine = line.fine
    normals = line.normals
    places = [fine + R * normals, fine - R * normals]
    if not line.run.closed:
        half_turn = np.linspace(0, np.pi, 400)[:, None]
        for end, outwards in ((0, -1), (-1, 1)):
            normal = normals[end]
            ahead = outwards * np.array([normal[1], -normal[0], 0.0])
            rounded = np.cos(half_turn) * normal + np.sin(half_turn) * ahead
            places.append(fine[end] + R * rounded)
    everything = np.vstack(places)
    nearest, _ = cKDTree(fine).query(everything)
    return everything[nearest >= R * (1 - 1e-5)]


def surface_error(points: Array, surface: Array) -> Array:
    """(K,) how far the nearest point is beyond R from each place of the planned surface [m]."""
    nearest, _ = cKDTree(points).query(surface)
    return np.maximum(nearest - R, 0.0)


def sample_by_curvature(line: TrueCurve, tolerance_m: float) -> Array:
    """The points that a plan takes from a tolerance."""
    sampled = sample_curve(line.fine, line.run.closed, radius_m=R, tolerance_m=tolerance_m)
    return sampled.points


def sample_evenly(line: TrueCurve, tolerance_m: float) -> Array:
    """Points as dense as the flat dimple formula h²/8R = tolerance allows, bends or not."""
    return sample_densely(line, 1 / np.sqrt(8 * R * tolerance_m))


def sample_densely(line: TrueCurve, density_per_m: float) -> Array:
    """Points of one density."""
    sampled = sample_curve(line.fine, line.run.closed, radius_m=R, density_per_m=density_per_m)
    return sampled.points


METHODS: dict[str, Callable[..., Array]] = {
    "by curvature": sample_by_curvature,
    "even, by R alone": sample_evenly,
    "the paper's density": sample_densely,
}
