"""A replay of a fixture that moves, is exchanged, is edited: a controller's ticks again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.engine.checks import Vector
from vfplan.engine.moving import MovingFrame, matrices
from vfplan.engine.parameters import Status, Trace
from vfplan.errors import SettingError
from vfplan.fixture import Fixture
from vfplan.replaying.engines import make_engine
from vfplan.replaying.quantities import dots
from vfplan.session.events import Event, read_events
from vfplan.session.poses import Poses, read_poses

_TRACE = ("proxy", "normal", "force", "state", "status")
NOWHERE_M = 1e3  # where a fixture without a pose is for the metrics: out of reach of any tool


class Changing:
    """An engine with what happened to its fixture, tick by tick.

    It runs as an engine does, in the session's frame; what the metrics are made of, in the
    fixture's, is in `inner`.
    """

    def __init__(
        self,
        fixture: Fixture,
        rule: str,
        poses: Poses | str | Path | None,
        events: Sequence[Event] | str | Path | None,
        moving: dict[str, Any],
        trust: Any,
    ) -> None:
        if fixture.guidance is not None:
            raise SettingError("poses and events are for forbidden regions, not for a guide")
        self._events = list(read_events(events) if isinstance(events, str | Path) else events or [])
        self._edits = any(event.kind != "exchange" for event in self._events)
        self._rule = rule
        self._engine = self._made(fixture, rule)
        self._frame = None if poses is None else MovingFrame(**moving)
        self._poses = read_poses(poses) if isinstance(poses, str | Path) else poses
        self._trust = trust
        self._changes = bool(self._events)
        self._tick = self._posed = 0
        self._last: tuple[Vector, Vector] | None = None  # force, frame
        self._counts = dict.fromkeys(("stale", "changing", "exchange", "edit"), 0)
        self._energy = self._age = 0.0
        self._clearance = np.inf

    @property
    def parameters(self) -> Any:
        """The engine's, as they are now."""
        return self._engine.parameters

    @property
    def left_out(self) -> dict[str, int]:
        """The engine's."""
        return self._engine.left_out

    def reset(self, hip: Vector) -> None:
        """Begin at `hip`; a moving fixture begins at the first HIP after its first pose."""
        if self._frame is None:
            self._engine.reset(hip)

    def at(self, times: Vector) -> Changing:
        """The times of the ticks that are run next."""
        self._times = times
        return self

    def run_timed(self, hips: Vector) -> tuple[Trace, Vector]:
        """One tick a row, from the times told; as the engine's own."""
        parts, start = [], 0
        while start < len(hips):
            self._take_up(float(self._times[start]))
            end = self._until(start, len(hips))
            parts.append(self._stretch(slice(start, end), hips[start:end]))
            self._tick += end - start
            start = end
        traces, micros, frames = zip(*parts, strict=True)
        trace = Trace(*(np.concatenate([getattr(t, name) for t in traces]) for name in _TRACE))
        self._note(hips, trace, np.concatenate(frames))
        return trace, np.concatenate(micros)

    def _take_up(self, t: float) -> None:
        """All that the tick at `t` begins with."""
        poses = self._poses
        while poses is not None and self._posed < len(poses.time):
            if poses.arrived[self._posed] > t:
                break
            row = poses.pose[self._posed]
            self._frame.native.pose(poses.time[self._posed], row[:3].copy(), row[3:].copy())
            self._posed += 1
            if self._posed % 32 == 0:  # of many before the first tick; the frame holds 64
                self._frame.native.at(t)
        while self._events and self._events[0].tick <= self._tick:
            self._apply(self._events.pop(0))

    def _apply(self, event: Event) -> None:
        if event.kind == "remake":
            self._engine.native.remake()
        elif event.kind == "edit":
            self._engine.edit(event.remove, event.add)
            self._counts["edit"] += len(event.remove) + len(event.add)
        else:
            self._counts["exchange"] += 1
            self._engine.exchange(self._made(*self._fixture(event.fixture)))

    def _made(self, fixture: Fixture, rule: str) -> Any:
        engine = make_engine(fixture, rule)
        if self._edits and rule != "exact":
            engine.make_editable()
        return engine

    def _fixture(self, given: Any) -> tuple[Fixture, str]:
        if not isinstance(given, Fixture):
            from vfplan.bundle import read_bundle
            from vfplan.bundle.content import from_content

            demanded = {} if self._trust is None else {"trust": self._trust}
            given = from_content(read_bundle(given, **demanded)[0])
        from vfplan.engine.renderable import best_rule

        best = best_rule(given)  # a curve's own only where it was rendered by it before
        return given, best if self._rule == "exact" else self._rule

    def _until(self, start: int, end: int) -> int:
        """The tick before which the next thing happens."""
        if self._events:
            end = min(end, start + self._events[0].tick - self._tick)
        if self._poses is not None and self._posed < len(self._poses.time):
            late = self._poses.arrived[self._posed]
            end = min(end, start + int(np.searchsorted(self._times[start:], late)))
        return max(end, start + 1)

    def _stretch(self, rows: slice, hips: Vector) -> tuple[Trace, Vector, Vector]:
        if self._frame is None:
            trace, micros = self._engine.run_timed(hips)
            frames = np.tile([0.0, 0, 0, 1, 0, 0, 0], (len(hips), 1))
        else:
            times = self._times[rows]
            trace, frames, ages, micros = self._frame.traced(self._engine, times, hips)
            known = np.isfinite(ages)
            self._age = max(self._age, float(ages[known].max(initial=0.0)))
            frames[~known, 0] = NOWHERE_M
        if self._changes:
            out = trace.status & Status.INSIDE == 0
            proxies = _inner(frames[out], trace.proxy[out] - frames[out, :3])
            clear = self._engine.distance(proxies) - self._radius()
            self._clearance = min(self._clearance, float(clear.min(initial=np.inf)))
        return trace, micros, frames

    def _radius(self) -> float:
        p = self._engine.parameters
        return p.contact_radius + p.point_radius

    def _note(self, hips: Vector, trace: Trace, frames: Vector) -> None:
        moved = trace.proxy - frames[:, :3], hips - frames[:, :3]
        proxy, hip = (_inner(frames, rows) for rows in moved)
        normal, force = _inner(frames, trace.normal), _inner(frames, trace.force)
        self.inner = hip, Trace(proxy, normal, force, trace.state, trace.status)
        forces, before = trace.force, frames
        if self._last is not None:
            forces = np.concatenate((self._last[0], forces))
            before = np.concatenate((self._last[1], frames))
            hip, hips = (np.concatenate((rows[:1], rows)) for rows in (hip, hips))
        # What the hand gets because the frame goes on while the hip in it is where it was.
        carried = hips[1:] - _outer(before[:-1], hip[1:]) - before[:-1, :3]
        self._energy += float(dots(forces[:-1], carried).sum())
        self._last = trace.force[-1:], frames[-1:]
        for name in ("stale", "changing"):
            flag = Status[name.upper()]
            self._counts[name] += int(np.count_nonzero(trace.status & flag))

    def report(self) -> dict[str, Any]:
        """What a replay's report has of it."""
        report: dict[str, Any] = {
            "exchanges": self._counts["exchange"],
            "edits": self._counts["edit"],
            "changing_ticks": self._counts["changing"],
        }
        if self._frame is not None:
            report |= {
                "fixture_energy_j": self._energy,
                "pose_age_max_s": self._age,
                "stale_ticks": self._counts["stale"],
                "poses_refused": self._frame.refused,
            }
        if self._changes and np.isfinite(self._clearance):
            report["clearance_min_m"] = self._clearance
        return report


def _inner(frames: Vector, rows: Vector) -> Vector:
    """Directions (T, 3) as seen from the frames (T, 7)."""
    return np.einsum("tji,tj->ti", matrices(frames)[:, :3, :3], rows)


def _outer(frames: Vector, rows: Vector) -> Vector:
    return np.einsum("tij,tj->ti", matrices(frames)[:, :3, :3], rows)
