"""replay(fixture, session): every tick through the engine, every number from the ticks."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vfplan.engine.choosing import as_rendered, best_rule
from vfplan.engine.parameters import ProxyParameters
from vfplan.errors import SessionError, SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import naming_place
from vfplan.replaying.changing import ChangingFixture
from vfplan.replaying.compare import Comparison
from vfplan.replaying.engines import RULES
from vfplan.replaying.episodes import episode_count
from vfplan.replaying.findings import replay_findings
from vfplan.replaying.limits import Limits, check_limits, robot_limits, verdict_of
from vfplan.replaying.link import Link
from vfplan.replaying.recording import SamplingReport
from vfplan.replaying.run import EngineRun
from vfplan.robot import Robot
from vfplan.session import SessionSource, TickBlock, open_session
from vfplan.session.events import Event, as_the_loop_saw
from vfplan.session.poses import Poses

Sink = Callable[[str, TickBlock], None]


@dataclass(frozen=True, eq=False)
class Replay:
    """What a replay found.

    Parameters
    ----------
    rule, engine
        What ran: "robust" or "paper"; "native" or "reference".
    ticks
        One row a tick; of every `stride` ticks the deepest where a bound was set.
    metrics
        The report: the contract's keys and more, defined in docs/replay.md.
    fixture
        What was replayed against.
    stride
        Ticks of the session each row of `ticks` stands for.
    other
        With rule "both": the run of the paper's rule; this one is then the robust one.
    """

    rule: str
    engine: str
    ticks: TickBlock
    metrics: dict[str, Any]
    fixture: Fixture
    stride: int = 1
    other: Replay | None = field(default=None, repr=False)

    @property
    def trace(self) -> TickBlock:
        """The ticks: `trace.proxy`, `.normal`, `.force` (T, 3), `.state` (T,)."""
        return self.ticks

    @property
    def record(self) -> dict[str, Any]:
        """What a result file keeps beside the ticks."""
        return result_record(self.metrics)

    @property
    def passed(self) -> bool:
        """Whether every limit that was given holds; see `verdict` for what that is worth."""
        return all(check["pass"] for check in self.metrics.get("checks", []))

    @property
    def verdict(self) -> str:
        """ "pass", "fail", or "not-tested": without limits, or if the tool never touched."""
        return self.metrics["verdict"]


def result_record(metrics: dict[str, Any]) -> dict[str, Any]:
    """The part of a report that belongs in a result file: what was replayed, how, on what."""
    names = ("rule", "engine", "scene", "session", "fixture", "link", "governor")
    return {name: metrics[name] for name in names if name in metrics}


def replay(
    fixture: Fixture | str | Path,
    session: SessionSource | str | Path,
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
    poses: Poses | str | Path | None = None,
    events: Sequence[Event] | str | Path | None = None,
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
        "robust", "paper", "exact", or "both": robust and paper. `None`: the fixture's best.
    engine
        "native", or "reference": the paper's algorithms in NumPy (rule "paper" only).
    robot
        Hold forces, their steps and speeds against its limits.
    link
        Deliver the session through a lossy link, and compare with a perfect one.
    governor
        Hold the forces to this robot's limits, as `vfplan.Governor` does; `force` is then what was
        commanded.
    limits
        (number in the report, "at_most" or "at_least", limit), to be checked.
    keep
        At most this many ticks in the result's `ticks`; `None`: all of them.
    sinks
        Called with (rule, block of ticks) as the replay goes.
    trust
        A `vfplan.bundle.Trust`: what a bundle's signature must show.
    poses
        Where the fixture was: a CSV of t,x,y,z,qw,qx,qy,qz, or `Poses`. Numbers of the report are
        then those of the fixture's frame, and the energy of its own motion is told apart.
    events
        Exchanges and edits, each with its tick: a file, or `Event`s. A session's path to a log with
        columns `poses` and `events` says in which ticks the loop knew of them.
    moving
        The settings of the controller's `MovingFrame`, where they are not the defaults.

    Raises
    ------
    SessionError
        A session that cannot be read, or one in another frame than the fixture.
    InputError, SettingError, BundleError
        A fixture that cannot be replayed, an unknown rule or engine, a bad bundle.
    """
    started = clock.perf_counter()

    # What is replayed against what: both in one frame.
    path = None
    record: dict[str, Any] = {}
    if not isinstance(fixture, Fixture):
        from vfplan.bundle import read_sealed

        path = Path(fixture)
        fixture, seal = read_sealed(path, trust=trust)
        is_checked = trust is not None
        record["fixture"] = {
            "name": path.name, **seal.describe(), "signature_checked": is_checked,
        }  # fmt: skip
    if isinstance(session, (str, Path)):
        poses, events = as_the_loop_saw(session, poses, events)
        session = open_session(session)
    if session.frame != fixture.frame:
        raise SessionError(
            f"positions are in frame {session.frame!r}, the fixture in {fixture.frame!r}. "
            "Give both in one frame",
            where=session.name,
            code="frame-differs",
        )

    # One run of each rule, and behind a lossy link one more over a perfect link. On a mesh, a rule
    # for points renders the mesh's samples; of two rules, both are rules for points.
    rules = chosen_rules(rule, fixture)
    if link is not None and not link.faulty:
        link = None
    with naming_place(path):
        fixture = as_rendered(fixture, rules[0])
        changing = None
        if poses is not None or events is not None:
            if len(rules) > 1 or engine != "native" or link is not None:
                raise SettingError(
                    "poses and events need one rule of the native engine, without a lossy "
                    "link. Leave --compare, --engine or --link out",
                    code="changes-alone",
                )
            changing = ChangingFixture(fixture, rules[0], poses, events, moving or {}, trust)
        settings = {"robot": robot, "governor": governor, "changing": changing}
        runs = []
        for name in rules:
            runs.append(EngineRun(fixture, name, engine, link=link, keep=keep, **settings))
        perfect = None
        if link is not None:
            perfect = EngineRun(fixture, rules[0], engine, keep=0, **settings)

    # The session, block by block through each run.
    recording = SamplingReport()
    between_rules = Comparison()
    between_links = Comparison()
    for time, hand in session.blocks():
        recording.update(time, hand)
        blocks = []
        for run in runs:
            ticks = run.feed(time, hand)
            blocks.append(ticks)
            for sink in sinks:
                sink(run.rule, ticks)
        if rule == "both":
            between_rules.update(*blocks)
        if perfect is not None:
            between_links.update(blocks[0], perfect.feed(time, hand))

    # What is the same for every run.
    record["session"] = {
        "name": session.name, "frame": session.frame, **session.notes, **recording.report(),
    }  # fmt: skip
    if session.sha256 is not None:
        record["session"]["sha256"] = session.sha256
    if perfect is not None:
        record["link"] = link_report(link, runs[0], perfect, between_links, robot)
    record["elapsed_s"] = clock.perf_counter() - started

    # Each run's report: its numbers, what a person should look at, and the limits that were given.
    if robot is not None:
        limits = (*limits, *robot_limits(robot))
    results = []
    for run in runs:
        numbers = run.finish()
        parameters = run.engine.parameters
        metrics = {
            "rule": run.rule,
            "engine": engine,
            **numbers,
            "scene": scene_report(fixture, parameters),
            "left_out": dict(run.engine.left_out),
            **record,
            "findings": replay_findings(numbers, record, parameters, robot),
            "real_time_factor": numbers["duration_s"] / record["elapsed_s"],
        }
        if limits:
            metrics["checks"] = check_limits(metrics, limits)
        metrics["verdict"] = verdict_of(metrics, metrics.get("checks", []))
        ticks = run.kept.ticks
        results.append(Replay(run.rule, engine, ticks, metrics, fixture, run.kept.stride))
    if len(results) == 1:
        return results[0]

    # The robust rule's report, with the paper's inside and how far the two differ.
    robust, paper = results
    paper_numbers = dict(paper.metrics)
    for name in ("session", "fixture", "link"):
        paper_numbers.pop(name, None)
    metrics = {
        **robust.metrics, "rule": "both", "paper": paper_numbers, "apart": between_rules.report(),
    }  # fmt: skip
    return Replay("both", engine, robust.ticks, metrics, fixture, robust.stride, paper)


def chosen_rules(rule: str | None, fixture: Fixture) -> list[str]:
    """The rules that run: the one asked for, both for points, or the fixture's best."""
    if rule is None:
        return [best_rule(fixture)]
    if rule == "both":
        return ["robust", "paper"]
    if rule not in RULES:
        raise SettingError(f"rule is {rule!r}. Give {', '.join(RULES)}", code="unknown-rule")
    return [rule]


def link_report(
    link: Link, run: EngineRun, perfect: EngineRun, comparison: Comparison, robot: Robot | None
) -> dict[str, Any]:
    """What the link did, and what the same session gives over a perfect one."""
    assert run.link is not None
    unaffected = perfect.finish()
    numbers = {k: v for k, v in unaffected.items() if isinstance(v, (int, float))}
    lost_limit = None
    if robot is not None:
        lost_limit = robot.lost_packets_limit
    return {
        **link.report(),
        **run.link.report(lost_limit),
        "apart": comparison.report(),
        "perfect": {**numbers, "episodes": episode_count(unaffected)},
    }


def scene_report(fixture: Fixture, parameters: ProxyParameters) -> dict[str, Any]:
    """What was rendered."""
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
