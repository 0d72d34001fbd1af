"""A replay of a fixture that moves, is exchanged or is edited: a controller's ticks again."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, takewhile
from typing import Any

import numpy as np

from vfplan.engine.moving import MovingFrame, matrices
from vfplan.engine.parameters import Vector
from vfplan.engine.proxy import Status, Trace, best_rule, check_renderable
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Fixture
from vfplan.geometry.lines import step_lengths
from vfplan.io.files import naming_place
from vfplan.replaying.guiding import make_engine
from vfplan.replaying.metrics import CONTACT_M, Report, dots, row_norms
from vfplan.session.events import Event, Poses, accepted_poses, give_pose
from vfplan.session.result import concatenate_ticks
from vfplan.session.session import WithPrevious

# Where the metrics have a fixture without a pose [m]: out of reach of any tool.
NO_POSE_M = 1e3

# A pose that is farther from the one before than this [m, rad], and faster than the frame may be,
# has jumped: the tracker or its reference slipped.
POSE_JUMP_M, POSE_JUMP_RAD = 5e-3, 0.035


class ChangingFixture:
    """An engine whose fixture changes, tick by tick.

    It runs as an engine does, in the session's frame. The metrics are computed from what
    `in_fixture_frame` gives.
    """

    def __init__(
        self, fixture: Fixture, rule: str, poses: Poses | None, events: Sequence[Event] | None,
        moving: dict[str, Any], trust: Any,
    ) -> None:  # fmt: skip
        if fixture.guidance is not None:
            message = "poses and events are for regions, and this fixture guides. Leave them out"
            raise SettingError(message, code="changes-guide")
        self._events, self._poses = list(events or ()), poses
        self._has_edits = any(event.kind != "exchange" for event in self._events)

        # The fixture of each exchange, with its rule; all are read before the first tick.
        self._exchanges = []
        for i, event in enumerate(self._events):
            with naming_place(self._place_of_event(i)):
                self._exchanges.append(load_exchange(event, rule, trust))

        changes = zip(self._events, self._exchanges, strict=True)
        self._fixtures = [(0, fixture), *((e.tick, pair[0]) for e, pair in changes if pair)]
        self._engine = self._make_engine(fixture, rule)
        self.stiffness = np.max([each.stiffness for _, each in self._fixtures], axis=0)
        self._frame = None if poses is None else MovingFrame(**moving)

        # The tick that runs next, and how many poses and events have been applied.
        self._tick = self._poses_applied = self._events_applied = 0
        self._with_previous = WithPrevious()
        # Of the ticks that are run next [s].
        self.times = np.empty(0)
        # What is found, by its name in the report.
        self._found = {"exchanges": 0, "edits": 0}
        if poses is not None:
            names = ("missing_pose_ticks", "stale_contact_ticks", "fixture_energy_j",
                     "pose_age_max_s", "frame_lag_max_m")  # fmt: skip
            self._first_pose = poses.pose[np.argmax(accepted_poses(poses))]
            jumps = jumps_of(poses, self._frame)
            self._found |= dict.fromkeys(names, 0)
            self._found |= {"poses_rounded": poses.rounded, "pose_jumps": len(jumps)}
            if len(jumps):
                self._found["pose_jump_first_s"] = float(jumps[0])

    @property
    def parameters(self) -> Any:
        """The engine's parameters, as they are now."""
        return self._engine.parameters

    @property
    def left_out(self) -> dict[str, int]:
        """What the engine did not need."""
        return self._engine.left_out

    def fixture_at(self, tick: int) -> Fixture:
        """The fixture that is rendered in a tick."""
        return [fixture for first, fixture in self._fixtures if first <= tick][-1]

    def distance(self, positions: Vector) -> Vector:
        """Distance (T,) [m] of `positions` (T, 3) [m] in the fixture's frame from it."""
        return self._engine.distance(positions)

    def reset(self, hip: Vector) -> None:
        """Begin at `hip`; a moving fixture begins at the first HIP after its first pose."""
        if self._frame is None:
            self._engine.reset(hip)

    def run_timed(self, hips: Vector) -> tuple[Trace, Vector]:
        """One tick a row, at `times`; as the engine's own."""
        # The rows before which poses arrive and events are due.
        cuts = {0, len(hips), *(event.tick - self._tick for event in self._events)}
        if self._poses is not None:
            cuts.update(np.searchsorted(self.times, self._poses.arrived).tolist())
        parts = []
        for start, end in pairwise(sorted(cut for cut in cuts if 0 <= cut <= len(hips))):
            self._apply_changes(float(self.times[start]), self._tick + start)
            parts.append(self._run_unchanged(slice(start, end), hips))
        self._tick += len(hips)
        traces, micros, frames = zip(*parts, strict=True)
        self._frames = np.concatenate(frames)
        return concatenate_ticks(traces), np.concatenate(micros)

    def _apply_changes(self, time: float, tick: int) -> None:
        """Apply the poses that have arrived by a tick at `time` [s], and its events."""
        poses = self._poses
        arrived = () if poses is None else poses.arrived[self._poses_applied :]
        for _ in takewhile(lambda at: at <= time, arrived):
            give_pose(self._frame, poses, self._poses_applied, time)
            self._poses_applied += 1
        for i in range(self._events_applied, len(self._events)):
            event, exchange = self._events[i], self._exchanges[i]
            if event.tick > tick:
                break
            with naming_place(self._place_of_event(i)):
                if exchange is not None:
                    self._found["exchanges"] += 1
                    self._engine.exchange(self._make_engine(*exchange))
                elif event.remake:
                    self._engine.make_editable()
                    self._engine.native.remake()
                else:
                    self._engine.edit(event.remove, event.add)
                    self._found["edits"] += len(event.remove) + len(event.add)
            self._events_applied += 1

    def _place_of_event(self, i: int) -> str:
        return self._events[i].where or f"event {i + 1}, tick {self._events[i].tick}"

    def _make_engine(self, fixture: Fixture, rule: str) -> Any:
        engine = make_engine(fixture, rule)
        if self._has_edits and rule != "exact":
            engine.make_editable()
        return engine

    def _run_unchanged(self, rows: slice, all_hips: Vector) -> tuple[Trace, Vector, Vector]:
        """The engine's answers in rows without a change, their times, and the frames (n, 7)."""
        hips = all_hips[rows]
        if self._frame is None:
            trace, micros = self._engine.run_timed(hips)
            frames = np.tile([0.0, 0, 0, 1, 0, 0, 0], (len(hips), 1))
        else:
            trace, frames, ages, micros = self._frame.traced(self._engine, self.times[rows], hips)
            has_pose = np.isfinite(ages)
            self._raise("pose_age_max_s", ages[has_pose].max(initial=0.0))
            frames[~has_pose, 0] = NO_POSE_M
            if has_pose[-1]:
                self._raise("frame_lag_max_m", self._frame.lag_m(hips[-1]))
            self._count_untrue(hips, trace, has_pose)
        if self._events:
            # The fixture of these ticks is gone later, so their clearance is measured now.
            outside = trace.status & Status.INSIDE == 0
            proxies = to_frame(frames[outside], trace.proxy[outside] - frames[outside, :3])
            clearances = self._engine.distance(proxies) - self._engine.parameters.R
            if len(clearances):
                least = self._found.get("clearance_min_m", np.inf)
                self._found["clearance_min_m"] = float(clearances.min(initial=least))
        return trace, micros, frames

    def _raise(self, name: str, value: float) -> None:
        self._found[name] = max(self._found[name], float(value))

    def _count_untrue(self, hips: Vector, trace: Trace, has_pose: Any) -> None:
        """Count the ticks of a contact with an old pose, or that the first pose would have had."""
        missing = int(np.count_nonzero(~has_pose))
        is_stale = trace.status & Status.STALE > 0
        in_contact = row_norms(trace.proxy - hips) > CONTACT_M
        first = np.tile(self._first_pose, (missing, 1))
        places = to_frame(first, hips[~has_pose] - first[:, :3])
        touched = self._engine.distance(places) < self._engine.parameters.R
        untrue = np.count_nonzero(is_stale & in_contact) + np.count_nonzero(touched)
        self._found["missing_pose_ticks"] += missing
        self._found["stale_contact_ticks"] += int(untrue)

    def in_fixture_frame(self, hips: Vector, trace: Trace) -> tuple[Vector, Trace]:
        """The HIPs and ticks just run, with the forces commanded, in the fixture's frame."""
        frames = self._frames
        proxy = to_frame(frames, trace.proxy - frames[:, :3])
        hip = to_frame(frames, hips - frames[:, :3])
        normal = to_frame(frames, trace.normal)
        force = to_frame(frames, trace.force)
        moved = hip, Trace(proxy, normal, force, trace.state, trace.status)

        # The hand gets energy because the frame moves on while the HIP in it stays where it was.
        forces, before, hip, hips = self._with_previous(trace.force, frames, hip, hips)
        if self._frame is not None:
            rotated = np.einsum("tij,tj->ti", matrices(before[:-1])[:, :3, :3], hip[1:])
            carried = hips[1:] - rotated - before[:-1, :3]
            self._found["fixture_energy_j"] += float(dots(forces[:-1], carried).sum())
        return moved

    def report(self, status: dict[str, int]) -> Report:
        """What a replay's report says of the changes; `status` as `Metrics` counts it."""
        report = self._found | {f"{name}_ticks": status[name] for name in ("changing", "crossed")}
        if self._frame is not None:
            report |= {"stale_ticks": status["stale"], "poses_refused": self._frame.refused}
        if self._events_applied < len(self._events):
            report["events_left"] = len(self._events) - self._events_applied
        return report


def jumps_of(poses: Poses, frame: MovingFrame) -> Vector:
    """(n,) times of the poses that jumped away from the pose before them [s]."""
    order = np.argsort(poses.time, kind="stable")
    time, pose = poses.time[order], poses.pose[order]
    dt = np.diff(time)
    way = step_lengths(pose[:, :3])
    turn = 2 * np.arccos(np.clip(np.abs((pose[1:, 3:] * pose[:-1, 3:]).sum(1)), 0, 1))
    jumped = (way > POSE_JUMP_M) & (way > frame.max_speed_m_s * dt)
    jumped |= (turn > POSE_JUMP_RAD) & (turn > frame.max_turn_rad_s * dt)
    return time[1:][jumped]


def load_exchange(event: Event, rule: str, trust: Any) -> tuple[Fixture, str] | None:
    """For an exchange: the new fixture and its rule.

    Raises SceneError: the new fixture guides
    """
    if event.fixture is None:
        return None
    fixture = event.fixture
    if not isinstance(fixture, Fixture):
        from vfplan.bundle.read import read_fixture

        fixture = read_fixture(fixture, trust=trust)
    if fixture.guidance is not None:
        message = "an event exchanges a region for a fixture that guides. Name one of a region"
        raise SceneError(message, code="exchange-guides")
    check_renderable(fixture)
    # A curve is rendered by its own rule only where the fixture before was.
    return fixture, best_rule(fixture) if rule == "exact" else rule


def to_frame(frames: Vector, vectors: Vector) -> Vector:
    """(T, 3) vectors in the axes of the frames (T, 7)."""
    return np.einsum("tji,tj->ti", matrices(frames)[:, :3, :3], vectors)
