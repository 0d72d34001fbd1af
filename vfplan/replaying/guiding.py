"""A guide in a replay: alone, or beside the forbidden region of the other strokes; forces add."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from vfplan.engine.guide import Guide, GuideTrace
from vfplan.engine.parameters import ProxyParameters, Vector
from vfplan.engine.ticks import Trace
from vfplan.fixture import Fixture
from vfplan.replaying.quantities import WithPrevious, dots, row_norms
from vfplan.replaying.timing import timed

BINS = 512  # along the guide's strokes together, of the profile


class Guided:
    """An engine of a region, or none, and a guide: answers as one engine does.

    The proxy, normal and state are the region's; of a guide alone its own: state 1 where it pushes,
    else 0, and -1 while it has no hold of the tip.

    fixture: with guidance
    parameters: what the fixture's rendering asks for
    region: the engine of the forbidden strokes; `None`: every stroke guides
    """

    def __init__(self, fixture: Fixture, parameters: ProxyParameters, region: Any | None) -> None:
        self.region = region
        self.parameters = parameters
        self._guide = Guide.of(fixture)
        self._first = 0 if fixture.guidance.stroke is None else fixture.guidance.stroke
        self._axis = fixture.ignore_axis
        self._starts = np.concatenate(([0.0], np.cumsum(self._guide.lengths_m)))
        self._lateral = np.full(BINS, np.nan)  # largest, over the way along all strokes
        self._force = np.zeros(BINS)
        self._ticks = self._held = self._outside = self._moving = 0
        self._lateral_max, self._square, self._worst = 0.0, 0.0, 0
        self._arc: tuple[float, float] | None = None
        self._peak = self._step = self._region_peak = self._work = 0.0
        self._carry = WithPrevious()
        self._strokes: set[int] = set()

    @property
    def stiffness(self) -> Vector:
        """(3,) of all springs together [N/m]."""
        region = 0.0 if self.region is None else self.parameters.stiffness
        return region + np.full(3, self._guide.stiffness)

    @property
    def left_out(self) -> dict[str, int]:
        """What this scene did not need."""
        return {"region": 1} if self.region is None else self.region.left_out

    def reset(self, hip: Vector) -> None:
        """Both begin with the tip at `hip` (3,) [m]."""
        self._guide.reset(hip)
        if self.region is not None:
            self.region.reset(hip)

    def run(self, hips: Vector) -> Trace:
        """The answers to `hips` (T, 3) [m]."""
        return self.run_timed(hips)[0]

    def run_timed(self, hips: Vector) -> tuple[Trace, Vector]:
        """The answers, and how long each tick took (T,) [µs]; the guide's part is a mean."""
        began = time.perf_counter()
        guide = self._guide.run(hips)
        micros = np.full(len(hips), 1e6 * (time.perf_counter() - began) / max(1, len(hips)))
        if self.region is None:
            trace = _alone(guide)
        else:
            trace, own = timed(self.region, hips)
            micros += own
        if len(hips):
            self._note(hips, guide, trace)
        if self.region is not None:
            trace = replace(trace, force=trace.force + guide.force)
        return trace, micros

    def _note(self, hips: Vector, guide: GuideTrace, region: Trace) -> None:
        held = guide.held
        outside = held & (guide.lateral_m > self._guide.radius)
        lateral = np.where(held, guide.lateral_m, 0.0)
        if lateral.max() > self._lateral_max:
            self._lateral_max = float(lateral.max())
            self._worst = self._ticks + int(lateral.argmax())
        self._square += float((lateral**2).sum())
        self._ticks += len(hips)
        self._held += int(held.sum())
        self._outside += int(outside.sum())
        self._moving += int((held & (guide.status != 0)).sum())
        force = row_norms(guide.force)
        self._peak = max(self._peak, float(force.max()))
        if self.region is not None:
            self._region_peak = max(self._region_peak, float(row_norms(region.force).max()))
        if held.any():
            arc = guide.arc_m[held]
            seen = [*(self._arc or ()), float(arc.min()), float(arc.max())]
            self._arc = min(seen), max(seen)
            self._strokes |= set(np.unique(guide.stroke[held]).tolist())
            along = self._starts[guide.stroke[held]] + arc
            bins = np.minimum((along / self._starts[-1] * BINS).astype(int), BINS - 1)
            np.fmax.at(self._lateral, bins, guide.lateral_m[held])
            np.maximum.at(self._force, bins, force[held])
        hips, forces = self._carry(hips, guide.force)
        if len(hips) > 1:
            self._step = max(self._step, float(row_norms(np.diff(forces, axis=0)).max()))
            self._work += float(dots(forces[:-1], np.diff(hips, axis=0)).sum())

    def report(self, tick_s: float) -> dict[str, Any]:
        """`arc_m`, `lateral_max_m` and the part `guide` of a replay's report.

        `tick_s`: the session's mean interval [s].
        """
        guide = {
            "radius_m": self._guide.radius,
            "stiffness_n_per_m": self._guide.stiffness,
            "ends": self._guide.ends,
            "lengths_m": self._guide.lengths_m,
            "strokes": sorted(self._first + stroke for stroke in self._strokes),
            "held_ticks": self._held,
            "outside_ticks": self._outside,
            "outside_s": self._outside * tick_s,
            "moving_ticks": self._moving,
            "lateral_rms_m": float(np.sqrt(self._square / max(1, self._held))),
            "lateral_max_tick": self._worst,
            "force_max_n": self._peak,
            "force_step_max_n": self._step,
            "work_j": self._work,
            "profile": {
                "arc_m": ((np.arange(BINS) + 0.5) / BINS * self._starts[-1]).tolist(),
                "lateral_m": [None if np.isnan(v) else v for v in self._lateral.tolist()],
                "force_n": self._force.tolist(),
            },
        }
        if self.region is not None:
            guide["region_force_max_n"] = self._region_peak
        return {
            "arc_m": None if self._arc is None else list(self._arc),
            "lateral_max_m": self._lateral_max,
            "guide": guide,
        }


def _alone(guide: GuideTrace) -> Trace:
    size = row_norms(guide.force)
    normal = np.divide(
        guide.force, size[:, None], out=np.zeros_like(guide.force), where=size[:, None] > 0
    )
    state = np.where(size > 0, 1, np.where(guide.held, 0, -1)).astype(np.int8)
    return Trace(guide.proxy, normal, guide.force, state, guide.status)
