"""What a replay steps: an engine by its rule, with a guide in it or a governor behind it.

`Guided` adds the forces of a guide to those of the forbidden region of the other strokes;
`GovernorMeasure` says what a governor held back.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from vfplan.engine.governor import Governed, Governor, GovernorStatus
from vfplan.engine.guide import Guide, GuideTrace
from vfplan.engine.parameters import ProxyParameters, Vector
from vfplan.engine.proxy import ProxyEngine, Trace, check_renderable, sampled, settings_of
from vfplan.errors import SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import to_json_types
from vfplan.replaying.metrics import Report, dots, row_norms, timed
from vfplan.session.session import Largest, WithPrevious

# Bins of the profile along all strokes together. A picture of it is about as wide in pixels.
BINS = 512


class ForceMeasure:
    """Largest force and largest change of it in a tick [N], and its work on the hand [J]."""

    def __init__(self) -> None:
        self.max_n = self.step_max_n = self.work_j = 0.0
        self._with_previous = WithPrevious()

    def update(self, forces: Vector, hips: Vector) -> None:
        """Take in the next ticks, (T, 3) each, T at least 1."""
        self.max_n = max(self.max_n, float(row_norms(forces).max()))
        forces, hips = self._with_previous(forces, hips)
        steps = row_norms(np.diff(forces, axis=0))
        self.step_max_n = max(self.step_max_n, float(steps.max(initial=0.0)))
        self.work_j += float(dots(forces[:-1], np.diff(hips, axis=0)).sum())


@dataclass(frozen=True, eq=False)
class GuidedTrace(Trace):
    """The answers of a guide and a region together, and those of each."""

    guide: GuideTrace
    region: Trace


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
        # The guide numbers its own strokes from 0; the fixture may have others before it.
        self._first_stroke = fixture.guidance.stroke or 0
        self._starts = np.concatenate(([0.0], np.cumsum(self._guide.lengths_m)))
        # Largest distance from the curve and largest force, over the arc length along all strokes.
        self._lateral = np.full(BINS, np.nan)
        self._force = np.zeros(BINS)
        self._ticks = 0
        self._counts = {"held": 0, "outside": 0, "moving": 0}
        self._lateral_max = Largest()
        self._lateral_squares = 0.0
        self._arc_min, self._arc_max = np.inf, -np.inf
        self._force_measure, self._region_measure = ForceMeasure(), ForceMeasure()
        self._strokes = set()

    @property
    def stiffness(self) -> Vector:
        """(3,) of all springs together [N/m]."""
        stiffness = np.full(3, self._guide.stiffness)
        return stiffness if self.region is None else self.parameters.stiffness + stiffness

    @property
    def left_out(self) -> dict[str, int]:
        """What this scene did not need."""
        return {"region": 1} if self.region is None else self.region.left_out

    def distance(self, positions: Vector) -> Vector:
        """Distance (T,) [m] of `positions` (T, 3) [m] from the region."""
        return self.region.distance(positions)

    def reset(self, hip: Vector) -> None:
        """Both begin with the tip at `hip` (3,) [m]."""
        self._guide.reset(hip)
        if self.region is not None:
            self.region.reset(hip)

    def run_timed(self, hips: Vector) -> tuple[Trace, Vector]:
        """The answers, and how long each tick took (T,) [µs]; the guide's part is a mean."""
        began = time.perf_counter()
        guide = self._guide.run(hips)
        micros = np.full(len(hips), 1e6 * (time.perf_counter() - began) / max(1, len(hips)))
        if self.region is None:
            size = row_norms(guide.force)
            normal = guide.force / np.where(size > 0, size, 1.0)[:, None]
            state = np.where(size > 0, 1, np.where(guide.held, 0, -1)).astype(np.int8)
            trace, force = Trace(guide.proxy, normal, guide.force, state, guide.status), guide.force
        else:
            trace, region_micros = timed(self.region, hips)
            micros += region_micros
            force = trace.force + guide.force
        parts = vars(trace) | {"force": force}
        return GuidedTrace(**parts, guide=guide, region=trace), micros

    def measure(self, hips: Vector, trace: GuidedTrace) -> None:
        """Take in the next ticks, T at least 1; a lossy link gives an answer to several."""
        guide, region = trace.guide, trace.region
        held = guide.held
        lateral = np.where(held, guide.lateral_m, 0.0)
        self._lateral_max.update(lateral, self._ticks)
        self._lateral_squares += float((lateral**2).sum())
        self._ticks += len(hips)
        outside, moving = guide.lateral_m > self._guide.radius, guide.status != 0
        for name, flags in {"held": held, "outside": outside, "moving": moving}.items():
            self._counts[name] += int((held & flags).sum())
        self._force_measure.update(guide.force, hips)
        self._region_measure.update(region.force, hips)
        if held.any():
            arc = guide.arc_m[held]
            self._arc_min = min(self._arc_min, float(arc.min()))
            self._arc_max = max(self._arc_max, float(arc.max()))
            self._strokes.update(np.unique(guide.stroke[held]).tolist())
            along_all = self._starts[guide.stroke[held]] + arc
            bins = np.minimum((along_all / self._starts[-1] * BINS).astype(int), BINS - 1)
            np.fmax.at(self._lateral, bins, guide.lateral_m[held])
            np.maximum.at(self._force, bins, row_norms(guide.force[held]))

    def report(self, tick_s: float) -> Report:
        """`arc_m`, `lateral_max_m` and the part `guide` of a replay's report.

        `tick_s`: the session's mean interval [s].
        """
        held_ticks = self._counts["held"]
        guide = {
            "radius_m": self._guide.radius,
            "stiffness_n_per_m": self._guide.stiffness,
            "ends": self._guide.ends,
            "lengths_m": self._guide.lengths_m,
            "strokes": sorted(self._first_stroke + stroke for stroke in self._strokes),
            "held_ticks": held_ticks,
            "outside_ticks": self._counts["outside"],
            "outside_s": self._counts["outside"] * tick_s,
            "moving_ticks": self._counts["moving"],
            "lateral_rms_m": float(np.sqrt(self._lateral_squares / max(1, held_ticks))),
            "lateral_max_tick": self._lateral_max.tick,
            "force_max_n": self._force_measure.max_n,
            "force_step_max_n": self._force_measure.step_max_n,
            "work_j": self._force_measure.work_j,
            "profile": {
                "arc_m": ((np.arange(BINS) + 0.5) / BINS * self._starts[-1]).tolist(),
                "lateral_m": to_json_types(self._lateral),
                "force_n": self._force.tolist(),
            },
        }
        if self.region is not None:
            guide["region_force_max_n"] = self._region_measure.max_n
        arc = [self._arc_min, self._arc_max] if held_ticks else None
        return {"arc_m": arc, "lateral_max_m": self._lateral_max.value, "guide": guide}


class GovernorMeasure:
    """What a governor changed of an engine's forces."""

    def __init__(self) -> None:
        # Of the force that the engine wanted, and of what the governor added to it.
        self._wanted, self._added = ForceMeasure(), ForceMeasure()
        # Ticks whose force was held back, and the most that was held back [N].
        self._held_ticks = self._overdrawn_ticks = 0
        self._held_back_max_n = 0.0

    def update(self, wanted: Vector, governed: Governed, hips: Vector) -> None:
        """Take in the next ticks: forces and HIPs (T, 3), T at least 1."""
        self._held_back_max_n = max(self._held_back_max_n, float(governed.held_back.max()))
        self._held_ticks += int(np.count_nonzero(governed.held_back))
        self._overdrawn_ticks += int(np.count_nonzero(governed.status & GovernorStatus.OVERDRAWN))
        self._wanted.update(wanted, hips)
        self._added.update(governed.force - wanted, hips)

    def report(self, governor: Governor) -> Report:
        """What replays and rehearsals report of it."""
        return {
            "engine_force_max_n": self._wanted.max_n,
            "engine_force_step_max_n": self._wanted.step_max_n,
            "held_ticks": self._held_ticks,
            "held_back_max_n": self._held_back_max_n,
            "energy_given_j": governor.energy_given_j,
            "energy_stored_j": governor.energy_stored_j,
            "overdrawn_ticks": self._overdrawn_ticks,
            "work_j": self._added.work_j,
        }


RULES = ("robust", "paper", "exact", "both")
ENGINES = ("native", "reference")


def make_engine(fixture: Fixture, rule: str, engine: str = "native") -> Any:
    """An engine that renders `fixture` by `rule` ("robust", "paper" or "exact").

    Raises SceneError: a fixture that is not registered, or has a rendering that no engine takes
    Raises SettingError: an unknown rule or engine, or the reference engine with a rule it does not
        have
    """
    if engine not in ENGINES:
        message = f"engine is {engine!r}. Give {' or '.join(ENGINES)}"
        raise SettingError(message, code="unknown-engine")
    if fixture.guidance is None:
        return _region_engine(fixture, rule, engine)

    # A guide, with the region of the forbidden strokes where there are any.
    if fixture.region is not None:
        region = _region_engine(fixture.region, rule, engine)
        return Guided(fixture, region.parameters, region)
    if (rule, engine) != ("robust", "native"):
        message = f"every stroke guides: no region has rule {rule!r} ({engine}). Leave it out"
        raise SettingError(message, code="rule-without-region")
    return Guided(fixture, check_renderable(fixture), None)


def _region_engine(fixture: Fixture, rule: str, engine: str) -> Any:
    if engine == "native":
        return ProxyEngine.of(fixture, rule, offline=True)
    check_renderable(fixture)
    if rule != "paper":
        message = f"the reference engine has rule 'paper' only, not {rule!r}. Choose another"
        raise SettingError(message, code="rule-not-paper")
    from vfplan.reference import PaperProxy

    return PaperProxy(sampled(fixture).points, **settings_of(fixture))
