"""A replay of a fixture that moves, is exchanged, is edited: a controller's ticks again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.engine.moving import MovingFrame, matrices
from vfplan.engine.parameters import Vector
from vfplan.engine.renderable import best_rule, check_renderable
from vfplan.engine.ticks import Status, Trace
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import naming_place
from vfplan.replaying.engines import make_engine
from vfplan.replaying.quantities import WithPrevious, dots
from vfplan.session.events import Event, read_events
from vfplan.session.poses import Poses, read_poses
from vfplan.session.result import concatenate_ticks

NOWHERE_M = 1e3  # where a fixture without a pose is for the metrics: out of reach of any tool


class ChangingFixture:
    """An engine with what happened to its fixture, tick by tick.

    It runs as an engine does, in the session's frame. The metrics are made of what
    `in_fixture_frame` gives.
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
        self._rule, self._trust = rule, trust
        self._others = [self._other(i) for i in range(len(self._events))]
        self._engine = self._made(fixture, rule)
        others = [self._engine.parameters, *(check_renderable(o[0]) for o in self._others if o)]
        self.stiffness = np.max([parameters.stiffness for parameters in others], axis=0)
        self._frame = None if poses is None else MovingFrame(**moving)
        self._poses = read_poses(poses) if isinstance(poses, str | Path) else poses
        self._tick = self._posed = self._done = 0
        self._carry = WithPrevious()
        self._counts = dict.fromkeys(("stale", "changing", "crossed", "exchange", "edit"), 0)
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

    def apply_until(self, times: Vector) -> None:
        """The times of the ticks that are run next."""
        self._times = times

    def run_timed(self, hips: Vector) -> tuple[Trace, Vector]:
        """One tick a row, from the times told; as the engine's own."""
        parts, start = [], 0
        while start < len(hips):
            self._begin_tick(float(self._times[start]))
            end = self._until(start, len(hips))
            parts.append(self._stretch(slice(start, end), hips[start:end]))
            self._tick += end - start
            start = end
        traces, micros, frames = zip(*parts, strict=True)
        self._frames = np.concatenate(frames)
        return concatenate_ticks(traces), np.concatenate(micros)

    def _begin_tick(self, t: float) -> None:
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
        while self._done < len(self._events) and self._events[self._done].tick <= self._tick:
            with naming_place(self._where(self._done)):
                self._apply(self._events[self._done], self._others[self._done])
            self._done += 1

    def _where(self, i: int) -> str:
        return self._events[i].where or f"event {i + 1}, tick {self._events[i].tick}"

    def _apply(self, event: Event, other: tuple[Fixture, str] | None) -> None:
        if other is not None:
            self._counts["exchange"] += 1
            self._engine.exchange(self._made(*other))
        elif event.remake:
            self._engine.make_editable()
            self._engine.native.remake()
        else:
            self._engine.edit(event.remove, event.add)
            self._counts["edit"] += len(event.remove) + len(event.add)

    def _made(self, fixture: Fixture, rule: str) -> Any:
        engine = make_engine(fixture, rule)
        if self._edits and rule != "exact":
            engine.make_editable()
        return engine

    def _other(self, i: int) -> tuple[Fixture, str] | None:
        """For an exchange: the fixture and its rule."""
        given = self._events[i].fixture
        if given is None:
            return None
        with naming_place(self._where(i)):
            if not isinstance(given, Fixture):
                from vfplan.bundle import read_fixture

                given = read_fixture(given, trust=self._trust)
            if given.guidance is not None:
                raise SceneError("an exchange for a fixture that guides; a forbidden region wanted")
            check_renderable(given)
            # A curve's own rule only where it was rendered by it before.
            return given, best_rule(given) if self._rule == "exact" else self._rule

    def _until(self, start: int, end: int) -> int:
        """The tick before which the next thing happens."""
        if self._done < len(self._events):
            end = min(end, start + self._events[self._done].tick - self._tick)
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
        if self._events:
            out = trace.status & Status.INSIDE == 0
            proxies = _inner(frames[out], trace.proxy[out] - frames[out, :3])
            clear = self._engine.distance(proxies) - self._radius()
            self._clearance = min(self._clearance, float(clear.min(initial=np.inf)))
        return trace, micros, frames

    def _radius(self) -> float:
        p = self._engine.parameters
        return p.contact_radius + p.point_radius

    def in_fixture_frame(self, hips: Vector, trace: Trace) -> tuple[Vector, Trace]:
        """HIPs and ticks just run, with the forces commanded, as the fixture's frame has them."""
        frames = self._frames
        moved = trace.proxy - frames[:, :3], hips - frames[:, :3]
        proxy, hip = (_inner(frames, rows) for rows in moved)
        normal, force = _inner(frames, trace.normal), _inner(frames, trace.force)
        inner = hip, Trace(proxy, normal, force, trace.state, trace.status)
        forces, before, hip, hips = self._carry(trace.force, frames, hip, hips)
        # What the hand gets because the frame goes on while the hip in it is where it was.
        carried = hips[1:] - _outer(before[:-1], hip[1:]) - before[:-1, :3]
        self._energy += float(dots(forces[:-1], carried).sum())
        for name in ("stale", "changing", "crossed"):
            flag = Status[name.upper()]
            self._counts[name] += int(np.count_nonzero(trace.status & flag))
        return inner

    def report(self) -> dict[str, Any]:
        """What a replay's report has of it."""
        report: dict[str, Any] = {
            "exchanges": self._counts["exchange"],
            "edits": self._counts["edit"],
            "changing_ticks": self._counts["changing"],
            "crossed_ticks": self._counts["crossed"],
        }
        if self._frame is not None:
            report |= {
                "fixture_energy_j": self._energy,
                "pose_age_max_s": self._age,
                "stale_ticks": self._counts["stale"],
                "poses_refused": self._frame.refused,
            }
        if self._done < len(self._events):
            report["events_left"] = len(self._events) - self._done
        if self._events and np.isfinite(self._clearance):
            report["clearance_min_m"] = self._clearance
        return report


def _inner(frames: Vector, rows: Vector) -> Vector:
    """Directions (T, 3) as seen from the frames (T, 7)."""
    return np.einsum("tji,tj->ti", matrices(frames)[:, :3, :3], rows)


def _outer(frames: Vector, rows: Vector) -> Vector:
    return np.einsum("tij,tj->ti", matrices(frames)[:, :3, :3], rows)
