"""Replay a session: every tick goes through the engine, and every number comes from the ticks.

A session is a recording of where a hand held the tool. `replay` feeds it to the engine that the
controller would run, with the rule that is asked for:

    exact    renders lines, arcs and triangles as they are
    robust   renders points, and never lets the proxy inside
    paper    renders points as the paper published it, and may let the proxy inside
    both     robust, and paper beside it, to compare the two
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bundle.leak import open_edges
from vfplan.engine.governor import Governor
from vfplan.engine.parameters import ProxyParameters
from vfplan.engine.proxy import as_rendered, best_rule
from vfplan.errors import SessionError, SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import FilePath, naming_place
from vfplan.replaying.changing import ChangingFixture
from vfplan.replaying.findings import (
    Limits,
    check_limits,
    replay_findings,
    robot_limits,
    verdict_of,
)
from vfplan.replaying.guiding import RULES, GovernorMeasure, Guided, make_engine
from vfplan.replaying.link import Comparison, Link, LossyLink
from vfplan.replaying.metrics import (
    Metrics,
    PairedTicks,
    Report,
    StepTimes,
    dots,
    episode_count,
    rendered_ticks,
    row_norms,
)
from vfplan.robot import Robot
from vfplan.session.events import CHANGE_COLUMNS, Event, Poses, as_the_loop_saw
from vfplan.session.read import open_session
from vfplan.session.result import TickBlock, concatenate_ticks, select_ticks
from vfplan.session.session import Array, SamplingReport, SessionSource

Sink = Callable[[str, TickBlock], None]

# Shares of all directions in which a mesh encloses a place: of a place inside a closed mesh, which
# is 1 but for rounding, and of one inside an open mesh, more than a trough has about its bottom.
ENCLOSED, WITHIN = 0.99, 0.8

# Number of the deepest episodes of which it is asked whether they were within an open mesh. A large
# mesh takes a tenth of a second for each.
ASKED_WITHIN = 20


class ThinnedTicks:
    """Keep at most `capacity` ticks; every tick while the session is that short.

    capacity: ticks kept, 2 at least; 0: none; `None`: all of them
    """

    def __init__(self, capacity: int | None) -> None:
        self._capacity = np.inf if capacity is None else capacity
        # What was kept, in order.
        self.ticks = None
        self.stride = 1

    def update(self, block: TickBlock) -> None:
        """Take in the next ticks."""
        if self._capacity == 0:
            block = block[:0]
        block = thinned(block, self.stride)
        self.ticks = block if self.ticks is None else concatenate_ticks([self.ticks, block])
        while len(self.ticks) > self._capacity:
            self.ticks = thinned(self.ticks, 2)
            self.stride *= 2


def thinned(block: TickBlock, stride: int) -> TickBlock:
    """Of every `stride` ticks in a row the one with the deepest penetration (the first)."""
    n = len(block)
    depth = np.full(-(-n // stride) * stride, -1.0)
    depth[:n] = block.penetration
    rows = depth.reshape(-1, stride)
    picks = rows.argmax(axis=1) + np.arange(len(rows)) * stride
    return block[picks]


class EngineRun:
    """Feed a session through one engine, block by block, and measure it.

    fixture, rule, engine: as for `make_engine`
    robot: whose limits to watch, or `None`
    link: the link between hand and controller; `None`: a perfect one
    governed_robot: whose limits a governor holds the forces to; `None`: there is no governor
    keep: how many ticks are kept for pictures; `None`: all
    changing: what happens to the fixture meanwhile; it then takes the engine's place
    """

    def __init__(
        self, fixture: Fixture, rule: str, engine: str, *, robot: Robot | None,
        governed_robot: Robot | None, keep: int | None, changing: ChangingFixture | None,
        link: Link | None = None,
    ) -> None:  # fmt: skip
        self.rule = rule
        self.changing = changing
        self.engine = changing or make_engine(fixture, rule, engine)
        self.link = None if link is None else LossyLink(link)
        self.kept = ThinnedTicks(keep)
        self._robot, self._governor, self._governed = governed_robot, None, GovernorMeasure()
        if governed_robot is not None:
            stiffness = getattr(self.engine, "stiffness", self.engine.parameters.stiffness)
            self._governor = Governor.of(governed_robot, float(stiffness.max()))
        # From this depth on the HIP is beyond the points themselves; a guide has no surface.
        self._surface_depth = np.inf if fixture.region is None else fixture.contact_radius
        self._pairs = PairedTicks()
        self._metrics = Metrics(fixture, self.engine, robot)
        self._times = StepTimes()
        # HIP of the last packet that arrived, and the engine's answer to it.
        self._last_packet = None

    def feed(self, time: Array, hand: Array) -> TickBlock:
        """Run the engine over the next samples, measure them, and give them back as ticks.

        time: (n,) [s]
        hand: (n, 3) where the tool truly was [m]
        """
        if self.changing is not None:
            self.changing.times = time

        hip, (trace, *governed) = self._answers(time, hand)
        if isinstance(self.engine, Guided):
            self.engine.measure(hip, trace)
        for forces in governed:
            self._governed.update(trace.force, forces, hip)
            trace = replace(trace, force=forces.force)
        ticks = rendered_ticks(time, hip, trace, self._surface_depth)

        measured, hand_in_frame = ticks, hand
        if self.changing is not None:
            hand_in_frame, in_frame = self.changing.in_fixture_frame(hip, trace)
            measured = rendered_ticks(time, hand_in_frame, in_frame, self._surface_depth)

        self._metrics.note_status(trace.status)
        steps = self._pairs.push(measured, hand_in_frame)
        if steps is not None:
            self._metrics.update(steps)
        self.kept.update(ticks)
        return ticks

    def _answers(self, time: Array, hand: Array) -> tuple[Array, list[Any]]:
        """(n, 3) the HIP that the controller had at each tick [m], and what `_run` gave for it.

        Behind a lossy link the engine steps on the packets that arrive. A tick without one repeats
        the answer to the last packet, which may be of an earlier block.
        """
        if self.link is None:
            return hand, self._run(hand)
        hip, row = self.link.deliver(time, hand)
        # The last packet of this block. Where none arrived this is -1, the packet before.
        last = len(hip) - 1
        answers = self._run(hip)
        if self._last_packet is not None:
            # Rows: the packets of this block, 0 to n - 1, and then the packet before them. A tick
            # before this block's first packet has row -1, which NumPy reads as that last row.
            hip = np.concatenate((hip, self._last_packet[0]))
            pairs = zip(answers, self._last_packet[1], strict=True)
            answers = [concatenate_ticks(pair) for pair in pairs]
        self._last_packet = hip[[last]], [select_ticks(part, np.array([last])) for part in answers]
        return hip[row], [select_ticks(part, row) for part in answers]

    def _run(self, hip: Array) -> list[Any]:
        """The engine's answers and, where there is a governor, what it made of their forces."""
        if not self._times.ticks:
            self.engine.reset(hip[0])
        trace = self._times.run(self.engine, hip)
        return [trace] if self._governor is None else [trace, self._governor.trace(trace.force)]

    def finish(self) -> Report:
        """The numbers of the whole session."""
        self._metrics.update(self._pairs.finish())
        report = self._metrics.report() | {"step_us": self._times.report()}
        if self.changing is not None:
            report |= self.changing.report(self._metrics.status)
        if isinstance(self.engine, Guided):
            report |= self.engine.report(report["duration_s"] / report["ticks"])
        if self._governor is not None:
            report["governor"] = {
                "force_step_n": self._robot.force_step_limit_n,
                "force_max_n": self._robot.force_limit_n,
                "mass_kg": self._robot.mass_kg,
                **self._governed.report(self._governor),
            }
        return report


@dataclass(frozen=True, eq=False)
class Replay:
    """What a replay found.

    Parameters
    ----------
    rule, engine
        What ran: "exact", "robust", "paper" or "both"; "native" or "reference".
    ticks
        One row for each tick. If fewer rows were asked for than there are ticks, one row stands
        for `stride` ticks: it is the one in which the tool was deepest.
    metrics
        The report: the contract's keys and more, defined in docs/replay.md.
    fixture
        The fixture that was rendered.
    stride
        The number of ticks that each row of `ticks` stands for.
    other
        With rule "both" the replay by rule "paper"; `ticks` are then those of rule "robust".
    """

    rule: str
    engine: str
    ticks: TickBlock
    metrics: Report
    fixture: Fixture
    stride: int = 1
    other: Replay | None = field(default=None, repr=False)

    @property
    def trace(self) -> TickBlock:
        """The same as `ticks`: `trace.proxy`, `.normal`, `.force` (T, 3), `.state` (T,)."""
        return self.ticks

    @property
    def record(self) -> Report:
        """What a result file keeps beside the ticks: what was replayed against what, and how."""
        names = ("rule", "engine", "scene", "session", "fixture", "link", "governor")
        record = {name: self.metrics[name] for name in names if name in self.metrics}
        if self.other is not None:
            record["rule"] = "robust"
        return record

    @property
    def verdict(self) -> str:
        """ "pass", "fail", or "not-tested": without limits, or if the tool never touched."""
        return self.metrics["verdict"]


def replay(
    fixture: Fixture | FilePath,
    session: SessionSource | FilePath,
    *,
    rule: str | None = None,
    engine: str = "native",
    robot: Robot | None = None,
    link: Link | None = None,
    governor: Robot | None = None,
    limits: Limits = (),
    keep: int | None = None,
    sinks: Sequence[Sink] = (),
    trust: Any = None,
    poses: Poses | FilePath | None = None,
    events: Sequence[Event] | FilePath | None = None,
    moving: dict[str, Any] | None = None,
) -> Replay:
    """Replay a session against a fixture.

    Parameters
    ----------
    fixture
        A registered fixture, or the path of a bundle.
    session
        A `Session`, a `SessionStream`, or the path of a session file.
    rule
        "exact", "robust", "paper" or "both", as above. `None`: "exact" where the fixture has lines
        and arcs, or triangles that a tick has time for; else "robust".
    engine
        "native": the controller's own. "reference": the paper's algorithms in NumPy, which have
        rule "paper" only.
    robot
        Check forces, steps of the force and speeds against the limits of this robot.
    link
        Let the positions come through a lossy link, and compare with a perfect one.
    governor
        Hold the forces to the limits of this robot, as `vfplan.Governor` does. The forces of the
        ticks are then those that it let through.
    limits
        (name of a number of the report, "at_most" or "at_least", limit) each.
    keep
        The most rows that `ticks` of the result may have; `None`: one for each tick.
    sinks
        Functions that get (rule, block of ticks) during the replay, as writers of files do.
    trust
        A `vfplan.Trust`: who must have signed the bundle, and for what.
    poses
        Where the fixture was: a CSV of t,x,y,z,qw,qx,qy,qz, or `Poses`. The numbers of the report
        are then in the frame of the fixture. The energy that the moving fixture gave to the tool is
        a number of its own.
    events
        When the fixture was exchanged or edited: a file, or `Event`s. A controller learns of poses
        and events some ticks late. If the session is the log of a controller, with columns `poses`
        and `events`, the replay takes both up in the same ticks as that controller did.
    moving
        Settings of the controller's `MovingFrame` that are not its defaults.

    Raises
    ------
    SessionError
        The session cannot be read, or its frame is not that of the fixture.
    InputError, SettingError, BundleError
        The fixture cannot be rendered, the rule or engine is unknown, or the bundle is bad.
    """
    # The longest function of the package: an account of a replay in the order of what happens. Each
    # part uses most names of the parts above it, so that functions for them would take them all.
    started = clock.perf_counter()

    # Fixture and session, which must be in one frame. `common` is what every report will hold.
    path = None
    common = {}
    if not isinstance(fixture, Fixture):
        from vfplan.bundle.read import read_sealed

        path = Path(fixture)
        fixture, seal = read_sealed(path, trust=trust)
        common["fixture"] = {"name": path.name, **seal, "signature_checked": trust is not None}
    poses, events = as_the_loop_saw(session, poses, events)
    if isinstance(session, (str, Path)):
        session = open_session(session)
    if session.frame != fixture.frame:
        message = f"is in frame {session.frame!r}, the fixture in {fixture.frame!r}. Give one frame"
        raise SessionError(message, where=session.name, code="frame-differs")

    # One run for each rule. With a lossy link one more run has a perfect link, to compare.
    if rule is not None and rule not in RULES:
        raise SettingError(f"rule is {rule!r}. Give {', '.join(RULES)}", code="unknown-rule")
    rules = ["robust", "paper"] if rule == "both" else [rule or best_rule(fixture)]
    if link is not None and link.report().keys() == {"seed"}:
        link = None
    with naming_place(path):
        drawn = fixture
        # Rules "robust" and "paper" render the same points: of a mesh, samples of its triangles.
        fixture = as_rendered(fixture, rules[0])
        changing = None
        if poses is not None or events is not None:
            if len(rules) > 1 or engine != "native" or link is not None:
                message = "poses and events need one rule of the native engine, and no lossy link"
                raise SettingError(message, code="changes-alone")
            changing = ChangingFixture(fixture, rules[0], poses, events, moving or {}, trust)
        settings = {"robot": robot, "governed_robot": governor, "changing": changing}
        runs = [EngineRun(fixture, r, engine, link=link, keep=keep, **settings) for r in rules]
        if link is not None:
            runs.append(EngineRun(fixture, rules[0], engine, keep=0, **settings))

    # The session, block by block through each run.
    recording = SamplingReport()
    between_rules, between_links = Comparison(), Comparison()
    start = None
    for times, positions in session.blocks():
        if start is None:
            start = positions[:1]
        recording.update(times, positions)
        blocks = [run.feed(times, positions) for run in runs]
        for name, block in zip(rules, blocks, strict=False):
            for sink in sinks:
                sink(name, block)
        if rule == "both":
            between_rules.update(*blocks[:2])
        if link is not None:
            between_links.update(blocks[0], blocks[-1])

    # A tool that was not led out of the body in which it began is rendered the inner side.
    ends = (start[0], blocks[0].proxy[-1])
    is_body = drawn.mesh is not None and changing is None
    if is_body and all(share_around(place, drawn) > ENCLOSED for place in ends):
        common["start_depth_m"] = float(runs[0].engine.distance(start)[0])

    # What all reports hold: the session, the link and the time that it all took.
    seen = {"name": session.name, "frame": session.frame, **session.notes, **recording.report()}
    if changing is not None and "ignored_columns" in seen:
        seen["ignored_columns"] = [c for c in seen["ignored_columns"] if c not in CHANGE_COLUMNS]
    if session.sha256 is not None:
        seen["sha256"] = session.sha256
    common |= {
        "session": seen,
        "samples_read": seen["samples"],
        "samples_left_out": seen.pop("left_out", 0) + seen.get("mended", {}).get("doubled", 0),
        "connections": seen.pop("connections", []),
    }
    if link is not None:
        clean = runs.pop().finish()
        numbers = {name: value for name, value in clean.items() if isinstance(value, (int, float))}
        common["link"] = {
            **link.report(),
            **runs[0].link.report(getattr(robot, "lost_packets_limit", None)),
            "apart": between_links.report(),
            "perfect": {**numbers, "episodes": episode_count(clean)},
        }
    common["elapsed_s"] = clock.perf_counter() - started

    # The report of each run: its numbers, the findings, and whether the limits hold.
    if robot is not None:
        limits = (*limits, *robot_limits(robot))
    results = []
    for run in runs:
        numbers = run.finish()
        # In how many of the deepest episodes the tool pressed from within an open or a closed mesh.
        by_depth = sorted(numbers["episodes"], key=lambda episode: -episode["penetration_max_m"])
        for place in (episode["deepest"] for episode in by_depth[:ASKED_WITHIN]):
            touched = drawn if changing is None else changing.fixture_at(place["tick"])
            if touched.mesh is None:
                continue
            key, least = "enclosed_episodes", ENCLOSED
            if open_edges(touched.mesh):
                key, least = "within_episodes", WITHIN
            share = share_around(np.array(place["proxy_m"]), touched)
            numbers[key] = numbers.get(key, 0) + int(share > least)
        parameters = run.engine.parameters
        metrics = {
            "rule": run.rule,
            "engine": engine,
            **numbers,
            "scene": scene_report(fixture, parameters),
            "left_out": dict(run.engine.left_out),
            **common,
            "findings": list(replay_findings(numbers, common, parameters, robot)),
            "real_time_factor": numbers["duration_s"] / common["elapsed_s"],
        }
        if limits:
            metrics["checks"] = [*check_limits(metrics, limits)]
        metrics["verdict"] = verdict_of(metrics)
        kept = run.kept
        results.append(Replay(run.rule, engine, kept.ticks, metrics, fixture, kept.stride))
    if len(results) == 1:
        return results[0]

    # Rule "both": the report of rule "robust", with that of rule "paper" inside, and how far apart
    # the two were.
    robust, paper = results
    shared = ("session", "fixture", "link")
    paper_numbers = {name: part for name, part in paper.metrics.items() if name not in shared}
    beside = {"rule": "both", "paper": paper_numbers, "apart": between_rules.report()}
    return replace(robust, rule="both", metrics=robust.metrics | beside, other=paper)


def scene_report(fixture: Fixture, parameters: ProxyParameters) -> Report:
    """The fixture and the parameters that were rendered."""
    scene = {
        "planar": fixture.ignore_axis is not None,
        "points": len(fixture.points),
        "contact_radius_m": parameters.contact_radius,
        "point_radius_m": parameters.point_radius,
        "stiffness_n_per_m": parameters.stiffness.tolist(),
        "frame": fixture.frame,
    }
    if parameters.rule != "exact":
        scene["band_m"] = parameters.band
    elif fixture.pieces:
        scene["lines_and_arcs"] = fixture.region.pieces.count
    else:
        scene["triangles"] = len(fixture.mesh)
    if fixture.max_iterations is not None and parameters.rule == "robust":
        scene["max_iterations"] = fixture.max_iterations
    if fixture.ignore_axis is not None:
        scene["ignore_axis"] = fixture.ignore_axis.tolist()
    return scene


def share_around(place: Array, body: Fixture) -> float:
    """The share of all directions in which the triangles of a mesh, turned alike, enclose a place.

    It is 1 inside a closed mesh and 0 outside it.
    """
    # The solid angle of each triangle (A. van Oosterom and J. Strackee, 1983).
    a, b, c = np.moveaxis(body.points[body.mesh] - place, 1, 0)
    x, y, z = row_norms(a), row_norms(b), row_norms(c)
    below = x * y * z + dots(a, b) * z + dots(b, c) * x + dots(c, a) * y
    angle = 2 * np.arctan2(dots(a, np.cross(b, c)), below).sum()
    return abs(angle) / (4 * np.pi)
