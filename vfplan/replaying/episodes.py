"""Contact episodes: when and where on the curve the fixture pushed, how hard, and what it cost."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.fixture import Fixture
from vfplan.replaying.quantities import Steps, flattened

Array = NDArray[np.float64]

# Runs of contact closer than this [s] are one episode: a touch that flickers is one touch.
JOIN_S = 0.01
# The deepest so many are reported one by one; of the rest, how many there were and what they were.
MOST = 1000


@dataclass(eq=False)
class Episode:
    """One contact, or the part of it seen so far.

    Sums run over the ticks in contact; `energy_peak_j` is the highest value its running energy
    reached, 0 at least.
    """

    start_tick: int
    end_tick: int
    start_s: float
    end_s: float
    speed_at_touch: float | None
    touch: Array
    leave: Array
    deepest_tick: int
    deepest_s: float
    deepest_hip: Array
    deepest_proxy: Array
    penetration: float
    overlap: float
    force: float
    force_step: float
    ticks: int
    dwell_s: float
    impulse: Array
    energy: float
    energy_peak: float
    hold: float
    drag_work: float
    press_path: float
    path: float
    lag: float

    def join(self, later: Episode) -> None:
        """Take in the next run of the same contact."""
        if later.penetration > self.penetration:
            self.penetration = later.penetration
            self.deepest_tick, self.deepest_s = later.deepest_tick, later.deepest_s
            self.deepest_hip, self.deepest_proxy = later.deepest_hip, later.deepest_proxy
        self.end_tick, self.end_s, self.leave = later.end_tick, later.end_s, later.leave
        self.energy_peak = max(self.energy_peak, self.energy + later.energy_peak)
        for name in ("overlap", "force", "force_step", "lag"):
            setattr(self, name, max(getattr(self, name), getattr(later, name)))
        for name in (
            "ticks", "dwell_s", "impulse", "energy", "hold", "drag_work", "press_path", "path",
        ):  # fmt: skip
            setattr(self, name, getattr(self, name) + getattr(later, name))

    def passive(self, slack_m: float) -> bool:
        """Whether its energy is what holding each force for a tick explains, to force · slack."""
        return bool(self.energy <= self.hold + slack_m * self.force)

    def report(self, ruler: CurveRuler | None, slack_m: float) -> dict[str, Any]:
        """The episode as JSON holds it."""
        data: dict[str, Any] = {
            "start_s": self.start_s,
            "end_s": self.end_s,
            "start_tick": self.start_tick,
            "end_tick": self.end_tick,
            "ticks": self.ticks,
            "dwell_s": self.dwell_s,
            "penetration_max_m": self.penetration,
            "overlap_max_m": self.overlap,
            "force_max_n": self.force,
            "force_step_max_n": self.force_step,
            "impulse_ns": self.impulse.tolist(),
            "energy_j": self.energy,
            "energy_peak_j": self.energy_peak,
            "energy_hold_j": self.hold,
            "passive": self.passive(slack_m),
            "slide_m": self.path,
            "lag_max_m": self.lag,
        }
        if self.press_path > 0:
            data["friction"] = self.drag_work / self.press_path
        if self.speed_at_touch is not None:
            data["speed_at_touch_m_s"] = self.speed_at_touch
        data["deepest"] = {
            "t_s": self.deepest_s,
            "tick": self.deepest_tick,
            "hip_m": self.deepest_hip.tolist(),
            "proxy_m": self.deepest_proxy.tolist(),
        }
        if ruler is not None:
            places = (self.touch, self.deepest_proxy, self.leave)
            for name, place in zip(("start", "deepest", "end"), places, strict=True):
                data[f"{name}_along"] = ruler.locate(place)
        return data


class Episodes:
    """Collect episodes from `Steps`, block after block: the `MOST` deepest of them.

    slack_m: as of `Episode.passive`
    """

    def __init__(self, slack_m: float, join_s: float = JOIN_S) -> None:
        self._slack_m = slack_m
        self._join_s = join_s
        self._speed: float | None = None  # of the step that led to the next tick
        self._entry = 0.0  # energy by holding, of that step; 0 within a contact
        self._last: Episode | None = None
        self._kept: list[tuple[float, int, Episode]] = []  # a heap: the least deep, latest, first
        self._left_out: dict[str, Any] = {"count": 0, "penetration_max_m": 0.0, "active": 0}
        self.count = 0

    def update(self, steps: Steps) -> None:
        """Take in the next ticks."""
        held = steps.held.astype(np.int8)
        edges = np.diff(held, prepend=0, append=0)
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        for start, end in zip(starts, ends, strict=True):
            self._add(self._run(steps, int(start), int(end)))
        self._speed = float(steps.speed[-1])
        self._entry = 0.0 if steps.held[-1] else float(steps.hold_j[-1])

    def report(self, ruler: CurveRuler | None) -> dict[str, Any]:
        """`episodes`, in the order of time, and `episodes_left_out` where there were more."""
        self._close()
        kept = sorted(((-late, e) for _, late, e in self._kept), key=lambda pair: pair[0])
        found: dict[str, Any] = {
            "episodes": [{"index": i, **e.report(ruler, self._slack_m)} for i, e in kept]
        }
        if self._left_out["count"]:
            found["episodes_left_out"] = dict(self._left_out)
        return found

    def _add(self, run: Episode) -> None:
        if self._last is not None and run.start_s - self._last.end_s <= self._join_s:
            self._last.join(run)
            return
        self._close()
        self._last = run

    def _close(self) -> None:
        """Put the last episode to the others; it is not joined any more."""
        if self._last is None:
            return
        entry = self._last.penetration, -self.count, self._last
        self._last = None
        self.count += 1
        if len(self._kept) < MOST:
            heapq.heappush(self._kept, entry)
            return
        depth, _, left = heapq.heappushpop(self._kept, entry)
        self._left_out["count"] += 1
        self._left_out["penetration_max_m"] = max(self._left_out["penetration_max_m"], depth)
        self._left_out["active"] += not left.passive(self._slack_m)

    def _run(self, steps: Steps, start: int, end: int) -> Episode:
        part, ticks = slice(start, end), steps.ticks
        deep = start + int(np.argmax(ticks.penetration[part]))
        running = np.cumsum(steps.work_j[part])
        # The step into contact loads the spring, though its force was still 0.
        entry = float(steps.hold_j[start - 1]) if start else self._entry
        press, drag, path = (column[part] for column in steps.sliding)
        # Copies: a view would keep its whole block in memory.
        return Episode(
            start_tick=steps.first + start,
            end_tick=steps.first + end - 1,
            start_s=float(ticks.time[start]),
            end_s=float(ticks.time[end - 1] + steps.dt[end - 1]),
            speed_at_touch=float(steps.speed[start - 1]) if start else self._speed,
            touch=ticks.proxy[start].copy(),
            leave=ticks.proxy[end - 1].copy(),
            deepest_tick=steps.first + deep,
            deepest_s=float(ticks.time[deep]),
            deepest_hip=ticks.hip[deep].copy(),
            deepest_proxy=ticks.proxy[deep].copy(),
            penetration=float(ticks.penetration[deep]),
            overlap=float(ticks.overlap[part].max()),
            force=float(steps.force_n[part].max()),
            force_step=float(steps.force_step_n[part].max()),
            ticks=end - start,
            dwell_s=float(steps.dt[part].sum()),
            impulse=steps.impulse_ns[part].sum(axis=0),
            energy=float(running[-1]),
            energy_peak=max(0.0, float(running.max())),
            hold=entry + float(steps.hold_j[part].sum()),
            drag_work=float((drag * path).sum()),
            press_path=float((press * path).sum()),
            path=float(path.sum()),
            lag=float(np.abs(steps.lag_m[part]).max()),
        )


def episode_count(report: dict[str, Any]) -> int:
    """How many episodes a replay's report speaks of, those it leaves out too."""
    return len(report["episodes"]) + report.get("episodes_left_out", {"count": 0})["count"]


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
