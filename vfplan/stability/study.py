"""Is a fixture's K safe with a robot? The gate, and the whole study with its report."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from operator import call
from typing import Any

import numpy as np

from vfplan.display import Progress, Report, count
from vfplan.engine.parameters import RULES, number
from vfplan.engine.proxy import best_rule, check_renderable
from vfplan.errors import CheckFailed, SceneError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture, StabilityVerdict
from vfplan.io.sandbox import worker_processes
from vfplan.robot import Robot
from vfplan.settings import incomplete_recipe, is_length, recalled, recorded
from vfplan.stability import contacts
from vfplan.stability.cases import CASES, passivity_cases, run_extreme_cases
from vfplan.stability.closed_loop import blow_case, closed_loop_case, scenes_for
from vfplan.stability.contacts import CaseResult
from vfplan.stability.loop import exact_bound, linear_bound, worst_delay

# Factor by which K may grow and the loop stays stable, unless the user gives another.
SAFETY_FACTOR = 1.25

# What a verdict holds of the robot.
ROBOT_KEYS = ("mass_kg", "damping_n_s_per_m", "rate_hz", "delay_ticks")


def gate(fixture: Fixture, robot: Robot, safety_factor: float = SAFETY_FACTOR) -> StabilityVerdict:
    """Run the loop on the fixture as its engine renders it, and judge its K.

    Raises
    ------
    CheckFailed
        K times the safety factor is not stable. The message has the largest K that passes.
    SceneError
        As `largest_rendered_stiffness`.
    """
    stiffness = largest_rendered_stiffness(fixture)
    results = closed_loop_case(fixture, best_rule(fixture), robot, stiffness)
    results += blow_case(robot, stiffness, safety_factor)
    verdict = judge(robot, stiffness, results, safety_factor)
    if not verdict.stable:
        raise CheckFailed(
            f"{verdict_text(verdict)}. Plan with a smaller stiffness, or judge it with the "
            "robot's true mass and damping."
        )
    return verdict


def with_verdict(fixture: Fixture, robot: Robot, safety_factor: float = SAFETY_FACTOR) -> Fixture:
    """The fixture with the gate's verdict, and the robot in its recipe, which nobody has reviewed.

    Raises as `gate` does.
    """
    known = fixture.provenance.settings.items()
    settings = {name: value for name, value in known if not name.startswith("robot_")}
    settings |= recorded(robot, "robot_") | {"robot_safety_factor": safety_factor}
    return replace(
        fixture,
        stability=gate(fixture, robot, safety_factor),
        provenance=replace(fixture.provenance, settings=settings),
        findings=(*fixture.findings, *strong_pull(fixture, robot)),
        reviewed=None,
    )


def judge_of(recipe: dict[str, Any]) -> tuple[Robot, float] | None:
    """The robot and the safety factor that a recipe records; `None` without a robot.

    Raises `InputError` for an incomplete recipe.
    """
    robot, safety_factor = recalled(Robot, recipe, "robot_"), recipe.get("robot_safety_factor")
    if robot is not None and not is_length(safety_factor):
        raise incomplete_recipe(f"robot_safety_factor is {safety_factor!r}")
    return robot and (robot, safety_factor)


def with_verdict_by(recipe: dict[str, Any], fixture: Fixture) -> Fixture:
    """The fixture with the verdict for the robot that a recipe records; raises as `gate` does."""
    judge = judge_of(recipe)
    return with_verdict(fixture, *judge) if judge else fixture


def strong_pull(fixture: Fixture, robot: Robot) -> list[Finding]:
    """A doubt where the robot cannot pull along the guide as strongly as the guide wants."""
    limit = robot.force_limit_n
    pull = None if fixture.guidance is None else fixture.guidance.lead_force
    if limit is None or not pull or abs(pull) <= limit:
        return []
    text = (
        f"The guide pulls with {abs(pull):g} N, but robot {robot.name!r} is limited to "
        f"{limit:g} N. Its governor holds the rest back, also of the tube's force."
    )
    return [doubt("guide-pull-strong", "plan", text)]


def largest_rendered_stiffness(fixture: Fixture) -> float:
    """The largest stiffness that the fixture renders in any direction [N/m].

    It is the largest eigenvalue of P K P, where P projects across the ignored axis. A guide's
    stiffness is added to it where a forbidden region may press at the same time.

    Raises
    ------
    SceneError
        A curve that is no fixture yet, or a rendering that no engine takes.
    """
    if fixture.frame != "robot_base":
        raise SceneError(
            f"frame {fixture.frame!r}: only a fixture in 'robot_base' has a stiffness to judge. "
            "Make one of it with `vfplan register`."
        )
    check_renderable(fixture)
    axis = np.zeros(3) if fixture.ignore_axis is None else fixture.ignore_axis
    across = np.eye(3) - np.outer(axis, axis)
    region = float(np.linalg.eigvalsh(across @ np.diag(fixture.stiffness) @ across).max())
    if fixture.guidance is None:
        return region
    guide = fixture.guidance.stiffness
    return guide + region if len(fixture.forbidden) > 0 else guide


def judge(
    robot: Robot, stiffness: float, results: list[CaseResult], safety_factor: float
) -> StabilityVerdict:
    """The verdict on K [N/m]: the least that the blows or a rule that robots render bear.

    A verdict names the longest delay of a robot whose delay varies.
    """
    measured = [row for row in results if row.unit == "N/m" and row.measured is not None]
    figures = {name: getattr(robot, name) for name in ROBOT_KEYS}
    figures["delay_ticks"] = worst_delay(robot)
    borne = [row.measured for row in measured if row.values.get("rule") != "paper"]
    return StabilityVerdict(
        robot=robot.name,
        **figures,
        k_n_per_m=stiffness,
        k_max_n_per_m=min(borne, default=0.0),
        margin=safety_factor,
    )


def verdict_text(verdict: StabilityVerdict) -> str:
    """The verdict on one line: what was judged, and up to which K the loop is stable."""
    return (
        f"K = {verdict.k_n_per_m:g} N/m with robot {verdict.robot!r} (m = {verdict.mass_kg:g} kg,"
        f" b = {verdict.damping_n_s_per_m:g} N·s/m, {verdict.rate_hz:g} Hz, delay "
        f"{count(verdict.delay_ticks, 'tick')}): the loop is stable up to "
        f"{verdict.k_max_n_per_m:.0f} N/m in all scenes tried, by all rules for robots; allowed "
        f"with a margin of {verdict.margin:g} is {verdict.k_pass_n_per_m:.0f} N/m"
    )


# The robot of the standard scenes: a mass of 1 kg with little damping, at 1 kHz.
DEFAULT_ROBOT = Robot("assumed", mass_kg=1.0, damping_n_s_per_m=5.0, rate_hz=1000.0)

# Stiffness that is judged where neither the caller nor a bundle gives one [N/m].
DEFAULT_STIFFNESS = 1000.0

# The parts of the study by name, in the order of the report.
PARTS = ("closed-loop", "passivity", "extremes")


@dataclass(frozen=True)
class Study:
    """The result of a study.

    Parameters
    ----------
    rows
        The results of all cases, in the order of the tables.
    verdict
        The verdict on the K in question.
    robot
        The robot that was judged.
    skipped
        Why this bundle cannot meet a case, by the case's name.
    elapsed_s
        Run time [s].
    """

    rows: list[CaseResult]
    verdict: StabilityVerdict
    robot: Robot
    skipped: dict[str, str]
    elapsed_s: float

    @property
    def failed(self) -> list[CaseResult]:
        """Results of cases that failed. Findings about rule "paper" are not among them."""
        return [row for row in self.rows if row.outcome == "fail"]

    @property
    def blows(self) -> CaseResult:
        """How the mass came to rest after hard blows."""
        return next(row for row in self.rows if "blows" in row.values)

    def as_dict(self) -> Report:
        """The study as `vfplan stability --json` reports it."""
        report = self.verdict.as_dict()
        # The K [N/m] that each rule bore in all scenes that were run.
        borne = {}
        for row in self.rows:
            rule = row.values.get("rule")
            if rule is not None and row.unit == "N/m" and row.measured is not None:
                borne[rule] = min(row.measured, borne.get(rule, math.inf))
        robot = {name: report.pop(name) for name in ("robot", *ROBOT_KEYS)}
        return {
            **report,
            "k_max_by_rule_n_per_m": borne,
            "k_linear_bound_n_per_m": linear_bound(self.robot),
            "k_exact_bound_n_per_m": exact_bound(self.robot),
            "robot": robot | {"filter_hz": self.robot.filter_hz or 0.0},
            "blows": self.blows.values["blows"],
            "failed": [row.case for row in self.failed],
            "cases": [row.as_dict() for row in self.rows],
            "left_out": self.skipped,
            "elapsed_s": round(self.elapsed_s, 3),
        }

    def as_text(self) -> str:
        """The short report: the verdict, and each case that failed."""
        outcomes = Counter(row.outcome for row in self.rows)
        summary = f"{count(len(self.rows), 'case')}: {outcomes['pass']} pass"
        if outcomes["fail"]:
            summary += f", {outcomes['fail']} fail"
        if outcomes["finding"]:
            summary += f", {outcomes['finding']} with a fault of rule paper alone, as known"
        lines = [verdict_text(self.verdict), self.blows.detail, summary]
        lines += [f"{row.outcome:8}{row.case}: {row.detail}" for row in self.failed]
        return "\n".join(lines)


def study(
    fixture: Fixture | None = None,
    robot: Robot = DEFAULT_ROBOT,
    *,
    stiffness: float | None = None,
    safety_factor: float = SAFETY_FACTOR,
    full: bool = False,
    parts: Iterable[str] = (),
    jobs: int = 1,
    progress: Progress = lambda label, total: nullcontext(lambda n: None),
) -> Study:
    """Run the parts of the study that this bundle and robot can meet.

    Parameters
    ----------
    fixture
        The bundle to judge. With `None` only the standard scenes run, and `stiffness` is judged.
    stiffness
        K to judge [N/m]. `None`: the bundle's largest, or `DEFAULT_STIFFNESS`.
    safety_factor
        K times this factor must be stable.
    full
        Whether to run the long cases too.
    parts
        Some of `PARTS`; none means all. The closed loop always runs, as the verdict needs it.
    jobs
        Number of processes.
    progress
        Makes a `with` block around the run from its name and its number of tasks. The block yields
        a function that is called after each task.

    Raises
    ------
    SceneError
        A curve that is no fixture yet.
    SettingError
        A stiffness, a safety factor or a figure of the robot that is not finite or out of range.
    """
    number("margin", safety_factor, "", least=1.0)
    rendered = largest_rendered_stiffness(fixture) if fixture is not None else DEFAULT_STIFFNESS
    if stiffness is not None:
        rendered = number("stiffness", stiffness, "N/m", above=0.0)
    stiffness = rendered

    # Which cases run, and why the others do not.
    parts = set(parts) or set(PARTS)
    names, reasons = scenes_for(fixture)
    pairs = [(rule, on) for rule in RULES for on in (fixture, *names) if on is not None]
    if fixture is not None and best_rule(fixture) == "exact":
        pairs.append(("exact", fixture))
    if fixture is None or fixture.mesh is None:
        pairs += [("exact", name) for name in names if name in contacts.SCENES_WITH_CURVE]
    tasks = [partial(closed_loop_case, on, rule, robot, stiffness) for rule, on in pairs]
    tasks.append(partial(blow_case, robot, stiffness, safety_factor))
    run_on_scenes = ["closed-loop"]
    if "passivity" in parts:
        tasks += [partial(passivity_cases, on, rule) for rule, on in pairs]
        run_on_scenes.append("passivity")
    skipped = {f"{part}/{name}": why for part in run_on_scenes for name, why in reasons.items()}
    if "extremes" in parts:
        # The long cases share a run, and so a process.
        long = [case for case in CASES if case.full]
        tasks.append(partial(run_extreme_cases, [c for c in CASES if not c.full], fixture))
        if full:
            tasks.append(partial(run_extreme_cases, long, fixture))
        else:
            skipped |= {f"extreme/{case.name}": "a long run: --full" for case in long}

    started = time.perf_counter()
    rows = []
    several = worker_processes(jobs) if jobs > 1 else nullcontext()
    with progress("stability", len(tasks)) as done, several as pool:
        for results in map(call, tasks) if pool is None else pool.map(call, tasks):
            rows += results
            done(1)
    verdict = judge(robot, stiffness, rows, safety_factor)
    return Study(rows, verdict, robot, skipped, time.perf_counter() - started)
