"""Contact episodes: when and where on the curve the fixture pushed, how hard, and what it cost."""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.fixture import Fixture
from vfplan.io.json_types import to_json_types
from vfplan.replaying.quantities import PEAKS, SUMS, Steps, flattened

Array = NDArray[np.float64]

# Runs of contact closer than this [s] are one episode: a touch that flickers is one touch.
JOIN_S = 0.01
# The deepest so many are reported one by one; of the rest, how many there were and what they were.
MOST = 1000
# What an episode holds besides what is reported of it.
HELD = ("press_path", "drag_work", "touch", "leave")


def _joined(run: dict[str, Any], later: dict[str, Any]) -> dict[str, Any]:
    """Two runs of the same contact as one."""
    deeper = later["penetration_max_m"] > run["penetration_max_m"]
    peak = max(run["energy_peak_j"], run["energy_j"] + later["energy_peak_j"])
    return {
        **run,
        **{name: later[name] for name in ("end_s", "end_tick", "leave")},
        **{name: run[name] + later[name] for name in ("ticks", *SUMS)},
        **{name: max(run[name], later[name]) for name in PEAKS},
        "energy_peak_j": peak,
        "deepest": (later if deeper else run)["deepest"],
    }


class Episodes:
    """Collect episodes from `Steps`, block after block: the `MOST` deepest of them.

    An episode, or the part of it seen so far, is held as it is reported, with the proxy's places
    where it began and ended; sums run over its ticks.

    slack_m: how far the proxy may move out under the peak force of a passive episode
    """

    def __init__(self, slack_m: float) -> None:
        self._slack_m = slack_m
        self._speed: float | None = None  # of the step that led to the next tick
        self._entry = 0.0  # energy by holding, of that step; 0 within a contact
        self._last: dict[str, Any] | None = None
        # A heap: the least deep, latest, first
        self._kept: list[tuple[float, int, dict[str, Any]]] = []
        self._left_out: dict[str, Any] = {"count": 0, "penetration_max_m": 0.0, "active": 0}
        self.count = 0

    def update(self, steps: Steps) -> None:
        """Take in the next ticks."""
        held = steps.held.astype(np.int8)
        edges = np.diff(held, prepend=0, append=0)
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            run = self._run(steps, start, end)
            if self._last is not None and run["start_s"] - self._last["end_s"] <= JOIN_S:
                self._last = _joined(self._last, run)
            else:
                self._close()
                self._last = run
        self._speed = float(steps.speed[-1])
        self._entry = 0.0 if steps.held[-1] else float(steps.hold_j[-1])

    def report(self, ruler: CurveRuler | None) -> dict[str, Any]:
        """`episodes`, in the order of time, and `episodes_left_out` where there were more."""
        self._close()
        kept = sorted(((-late, e) for _, late, e in self._kept), key=lambda pair: pair[0])
        found: dict[str, Any] = {
            "episodes": [{"index": i, **self._reported(e, ruler)} for i, e in kept]
        }
        if self._left_out["count"]:
            found["episodes_left_out"] = dict(self._left_out)
        return found

    def _passive(self, run: dict[str, Any]) -> bool:
        """Whether its energy is what holding each force for a tick explains."""
        slack = self._slack_m * run["force_max_n"]
        return bool(run["energy_j"] <= run["energy_hold_j"] + slack)

    def _reported(self, run: dict[str, Any], ruler: CurveRuler | None) -> dict[str, Any]:
        data = {k: v for k, v in run.items() if k not in HELD and v is not None}
        data["passive"] = self._passive(run)
        if run["press_path"] > 0:
            data["friction"] = run["drag_work"] / run["press_path"]
        if ruler is not None:
            places = {
                "start": run["touch"],
                "deepest": run["deepest"]["proxy_m"],
                "end": run["leave"],
            }
            data |= {f"{name}_along": ruler.locate(place) for name, place in places.items()}
        return to_json_types(data)

    def _close(self) -> None:
        """Put the last episode to the others; it is not joined any more."""
        if self._last is None:
            return
        entry = self._last["penetration_max_m"], -self.count, self._last
        self._last = None
        self.count += 1
        if len(self._kept) < MOST:
            heapq.heappush(self._kept, entry)
            return
        depth, _, left = heapq.heappushpop(self._kept, entry)
        self._left_out["count"] += 1
        self._left_out["penetration_max_m"] = max(self._left_out["penetration_max_m"], depth)
        self._left_out["active"] += not self._passive(left)

    def _run(self, steps: Steps, start: int, end: int) -> dict[str, Any]:
        part, ticks = slice(start, end), steps.ticks
        deep = start + int(np.argmax(ticks.penetration[part]))
        sums = {name: values[part].sum(axis=0) for name, values in steps.sums.items()}
        # The step into contact loads the spring, though its force was still 0.
        sums["energy_hold_j"] += steps.hold_j[start - 1] if start else self._entry
        # Copies: a view would keep its whole block in memory.
        return {
            "start_s": float(ticks.time[start]),
            "end_s": float(ticks.time[end - 1] + steps.dt[end - 1]),
            "start_tick": steps.first + start,
            "end_tick": steps.first + end - 1,
            "ticks": end - start,
            **{name: float(values[part].max()) for name, values in steps.peaks.items()},
            **sums,
            # The sum of all is one of the sums on the way, but for its rounding.
            "energy_peak_j": max(0.0, float(np.cumsum(steps.work_j[part]).max()), sums["energy_j"]),
            "speed_at_touch_m_s": steps.speed[start - 1] if start else self._speed,
            "deepest": {
                "t_s": ticks.time[deep],
                "tick": steps.first + deep,
                "hip_m": ticks.hip[deep].copy(),
                "proxy_m": ticks.proxy[deep].copy(),
            },
            "touch": ticks.proxy[start].copy(),
            "leave": ticks.proxy[end - 1].copy(),
        }


def episode_count(report: dict[str, Any]) -> int:
    """How many episodes a replay's report speaks of, those it leaves out too."""
    return len(report["episodes"]) + report.get("episodes_left_out", {"count": 0})["count"]


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
