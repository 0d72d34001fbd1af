"""The whole study: which cases run, in how many processes, and the report."""

from __future__ import annotations

import csv
import io
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from operator import call
from typing import Any

from vfplan.engine.parameters import RULES, Rule, number
from vfplan.engine.renderable import best_rule
from vfplan.fixture import Fixture, StabilityVerdict
from vfplan.io.processes import worker_processes
from vfplan.robot import Robot
from vfplan.stability import contacts
from vfplan.stability.closedloop import closed_loop, scenes_for
from vfplan.stability.extremes import CASES, try_cases
from vfplan.stability.gate import MARGIN, ROBOT_KEYS, felt_stiffness, judge, refusal
from vfplan.stability.passivity import passivity
from vfplan.stability.rows import Row
from vfplan.stability.theory import Plant, exact_bound

DEFAULT_ROBOT = Robot("default", mass_kg=1.0, damping_n_s_per_m=5.0, rate_hz=1000.0)
LIMITS = {"friction_n": "N", "quantum_m": "m", "force_limit_n": "N", "force_step_limit_n": "N"}
ALL_RULES: tuple[Rule, ...] = (*RULES, "exact")
DEFAULT_STIFFNESS = 1000.0  # [N/m], where there is no bundle to ask

Task = Callable[[], list[Row]]
Done = Callable[[int], None]
Bar = Callable[[str, int], AbstractContextManager[Done]]


@dataclass(frozen=True)
class Study:
    """What a study found."""

    rows: list[Row]  # in the order of the tables
    verdict: StabilityVerdict  # on the K asked about
    left_out: dict[str, str]  # case -> why this bundle cannot meet it
    elapsed_s: float  # run time [s]

    @property
    def failed(self) -> list[Row]:
        """Rows that did not hold; findings about rule `paper` are not among them."""
        return [row for row in self.rows if row.outcome == "fail"]

    def as_dict(self) -> dict[str, Any]:
        """As the command's JSON holds it."""
        verdict, found = self.verdict, self.verdict.as_dict()
        robot = {name: found.pop(name) for name in ("robot", *ROBOT_KEYS)}
        return {
            **found,
            "k_max_by_rule_n_per_m": _smallest(self.rows),
            "k_exact_bound_n_per_m": exact_bound(Plant.of(verdict), verdict.delay_ticks),
            "robot": robot,
            "failed": [row.case for row in self.failed],
            "cases": [row.as_dict() for row in self.rows],
            "left_out": self.left_out,
            "elapsed_s": round(self.elapsed_s, 3),
        }

    def as_csv(self) -> str:
        """The table: case, outcome, limit, measured, unit, detail."""
        out = io.StringIO()
        table = csv.writer(out, lineterminator="\n")
        table.writerow(["case", "outcome", "limit", "measured", "unit", "detail"])
        for row in self.rows:
            limits = ["" if x is None else f"{x:.6g}" for x in (row.limit, row.measured)]
            table.writerow([row.case, row.outcome, *limits, row.unit, row.detail])
        return out.getvalue()

    def as_text(self, every_case: bool = False) -> str:
        """The short report a person reads: the verdict and what failed, or every case."""
        counts = Counter(row.outcome for row in self.rows)
        stable = "stable" if self.verdict.stable else "NOT STABLE"
        told = f"{stable}; {len(self.rows)} cases: {counts['pass']} pass"
        if counts["fail"]:
            told += f", {counts['fail']} fail"
        if counts["finding"]:
            told += f"; {counts['finding']} show what the paper's rule does, which no robot renders"
        lines = [refusal(self.verdict), told]
        for row in self.rows:
            if every_case or row.outcome == "fail":
                lines.append(f"{row.outcome:8}{row.case}: {row.detail}")
        if every_case:
            lines += [f"left out {case}: {why}" for case, why in self.left_out.items()]
        return "\n".join(lines)


def study(
    fixture: Fixture | None = None,
    robot: Robot = DEFAULT_ROBOT,
    *,
    stiffness: float | None = None,
    margin: float = MARGIN,
    full: bool = False,
    parts: Iterable[str] = (),
    jobs: int = 1,
    progress: Bar = lambda label, total: nullcontext(lambda n: None),
) -> Study:
    """Run the parts of the study that this bundle and robot can meet.

    fixture: the bundle to judge; `None`: the standard scenes, and `stiffness` is judged
    stiffness: K [N/m] to judge; `None`: the bundle's largest, or 1000
    margin: K times this must be stable
    full: also the long runs
    parts: of `PARTS`; none: all. The closed loop always runs: the verdict needs it.
    jobs: processes
    progress: a `with` block around the run, given its name and how many tasks it has; yields what
        is told of each
    Raises SceneError: a curve that is no fixture yet
    Raises SettingError: a stiffness, a margin or a figure of the robot that is not finite or
        outside its range
    """
    _check(robot, margin)
    felt = DEFAULT_STIFFNESS if fixture is None else felt_stiffness(fixture)
    stiffness = felt if stiffness is None else number("stiffness", stiffness, "N/m", above=0.0)
    tasks: list[Task] = []
    left_out: dict[str, str] = {}
    wanted = {"closed-loop", *parts} if parts else set(PARTS)
    for name, part in PARTS.items():
        if name in wanted:
            more, out = part(fixture, robot, stiffness, full)
            tasks += more
            left_out |= out
    started = time.perf_counter()
    with progress("stability", len(tasks)) as done:
        rows = [row for result in run_tasks(tasks, jobs, done) for row in result]
    verdict = judge(robot, stiffness, _loops(rows, "robust", "exact"), margin)
    return Study(rows, verdict, left_out, time.perf_counter() - started)


def _check(robot: Robot, margin: float) -> None:
    number("margin", margin, "", least=1.0)
    number("damping_n_s_per_m", robot.damping_n_s_per_m, "N·s/m", least=0.0)
    number("mass_kg", robot.mass_kg, "kg", above=0.0)
    number("rate_hz", robot.rate_hz, "Hz", above=0.0)
    for name, unit in LIMITS.items():
        if getattr(robot, name) is not None:
            number(name, getattr(robot, name), unit, above=0.0)


def _loops(rows: list[Row], *rules: Rule) -> list[Row]:
    """The rows that say what K these rules bear."""
    return [row for row in rows if row.values.get("rule") in rules and row.unit == "N/m"]


def _smallest(rows: list[Row]) -> dict[str, float]:
    """The smallest K [N/m] that each rule bore over the scenes run."""
    found = {}
    for rule in ALL_RULES:
        borne = [row.measured for row in _loops(rows, rule) if row.measured is not None]
        if borne:
            found[rule] = min(borne)
    return found


def run_tasks(tasks: list[Task], jobs: int, done: Done) -> list[list[Row]]:
    """Every task's rows, in the order of the tasks, run in `jobs` processes."""
    with worker_processes(jobs) if jobs > 1 else nullcontext() as pool:
        results = []
        for rows in (pool.map if pool else map)(call, tasks):
            results.append(rows)
            done(1)
    return results


Part = tuple[list[Task], dict[str, str]]


def _closed_loop(fixture: Fixture | None, robot: Robot, stiffness: float, full: bool) -> Part:
    turns = _turns(fixture)
    tasks = [partial(closed_loop, on, rule, robot, stiffness) for rule, on in turns]
    return tasks, _not_met("closed-loop", fixture)


def _passivity(fixture: Fixture | None, robot: Robot, stiffness: float, full: bool) -> Part:
    tasks: list[Task] = [partial(passivity, on, rule, stiffness) for rule, on in _turns(fixture)]
    return tasks, _not_met("passivity", fixture)


def _not_met(part: str, fixture: Fixture | None) -> dict[str, str]:
    return {f"{part}/{name}": why for name, why in scenes_for(fixture)[1].items()}


def _turns(fixture: Fixture | None) -> Iterator[tuple[Rule, Fixture | str]]:
    """Each rule with all that it renders: the bundle, and the scenes of contact that it can meet.

    Rule "exact" renders lines and arcs, or a bundle's triangles.
    """
    for rule in ALL_RULES:
        if fixture is not None and rule in (*RULES, best_rule(fixture)):
            yield rule, fixture
        known = contacts.CURVES if rule == "exact" else contacts.SCENES
        if rule == "exact" and fixture is not None and fixture.mesh is not None:
            known = ()
        yield from ((rule, name) for name in scenes_for(fixture)[0] if name in known)


def _extremes(fixture: Fixture | None, robot: Robot, stiffness: float, full: bool) -> Part:
    runs = [[case for case in CASES if case.full == long] for long in (False, True)[: 1 + full]]
    out = {f"extreme/{case.name}": "a long run: --full" for case in CASES if case.full > full}
    return [partial(try_cases, cases, fixture) for cases in runs], out


PARTS: dict[str, Callable[[Fixture | None, Robot, float, bool], Part]] = {
    "closed-loop": _closed_loop,
    "passivity": _passivity,
    "extremes": _extremes,
}
"""The parts of the study by name, in the order of the report."""
