"""What a replay is held against: limits of a robot and of the caller, and what else is odd."""

from __future__ import annotations

from typing import Any

import numpy as np

from vfplan.engine.parameters import ProxyParameters
from vfplan.errors import SettingError
from vfplan.replaying.quantities import Steps
from vfplan.replaying.watch import JUMP_M_S
from vfplan.robot import Robot, read_robot

# name -> (the robot's limit, the number of the report that it bounds)
LIMITS = {
    "force": ("force_limit_n", "force_max_n"),
    "force_step": ("force_step_limit_n", "force_step_max_n"),
    "speed": ("speed_limit_m_s", "session.speed_max_m_s"),
}


class RobotWatch:
    """Count the ticks in which a robot would have objected.

    A Franka arm refuses a change of torque above 1 N·m from one tick to the next (about 1.2 N at
    the tip at a reach of 0.85 m) and stops at its reflex threshold.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._over: dict[str, int] = {}
        self._first: dict[str, int] = {}

    def update(self, steps: Steps) -> None:
        """Take in the next ticks."""
        # The step from tick k to k + 1 is the robot's at k + 1.
        for name, values, first in (
            ("force", steps.force_n, steps.first),
            ("force_step", steps.force_step_n, steps.first + 1),
            ("speed", steps.speed, steps.first + 1),
        ):
            limit = getattr(self._robot, LIMITS[name][0])
            over = np.flatnonzero(values > limit) if limit is not None else ()
            self._over[name] = self._over.get(name, 0) + len(over)
            if len(over):
                self._first.setdefault(name, first + int(over[0]))

    def report(self) -> dict[str, Any]:
        """The `robot` part of a replay's report; a limit the robot does not have is absent."""
        robot = self._robot
        data: dict[str, Any] = {"name": robot.name, "rate_hz": robot.rate_hz}
        for name, (key, _) in LIMITS.items():
            if getattr(robot, key) is None:
                continue
            data[key] = getattr(robot, key)
            data[f"{name}_over_ticks"] = self._over.get(name, 0)
            if name in self._first:
                data[f"{name}_over_first_tick"] = self._first[name]
        return data


def robot_limits(robot: Robot) -> tuple[tuple[str, str, float], ...]:
    """The robot's limits as checks of a replay's report."""
    found = ((number, getattr(robot, key)) for key, number in LIMITS.values())
    return tuple((number, "at_most", limit) for number, limit in found if limit is not None)


def check_limits(
    report: dict[str, Any], limits: tuple[tuple[str, str, float], ...]
) -> list[dict[str, Any]]:
    """Each limit against the report.

    report: as a replay gives it
    limits: (name of a number in the report, "at_most" or "at_least", limit); `a.b` is b within a
    Raises SettingError: a name that is no number of the report
    """
    checks = []
    for name, sense, limit in limits:
        value: Any = report
        for part in name.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            numbers = [k for k, v in report.items() if isinstance(v, (int, float))]
            raise SettingError(
                f"no number {name!r} in the report to hold against {limit:g}; there are "
                f"{', '.join(numbers)}"
            )
        holds = value <= limit if sense == "at_most" else value >= limit
        checks.append({"name": name, "value": value, sense: limit, "pass": bool(holds)})
    return checks


def has_touched(report: dict[str, Any]) -> bool:
    """Whether the fixture did anything: it pushed the tool, or a guide had hold of the tip.

    report: as `Metrics.report` gives it
    """
    return report["contact_ticks"] > 0 or report.get("arc_m") is not None


def verdict_of(report: dict[str, Any], checks: list[dict[str, Any]]) -> str:
    """How a replay ended: "pass", "fail" or "not-tested".

    A replay passes if every limit holds and the tool touched the fixture. Limits that hold because
    the tool stayed away, and a replay without limits, test nothing.
    """
    if any(not check["pass"] for check in checks):
        return "fail"
    if not checks or not has_touched(report):
        return "not-tested"
    return "pass"


# Rounding in the independent measurement of clearance [m].
_ROUNDING_M = 1e-9
# A session that stays farther than this from the fixture is likely in other units or another frame.
FAR_M = 0.5
# Rates that a tracked tool is recorded at; outside, the time is likely not in seconds.
RATES_HZ = (5.0, 50_000.0)


def finding(code: str, severity: str, message: str) -> dict[str, str]:
    """One finding: "info", "warning" or "error"."""
    return {"code": code, "severity": severity, "message": message}


def findings(
    report: dict[str, Any], record: dict[str, Any], parameters: ProxyParameters, robot: Robot | None
) -> list[dict[str, str]]:
    """Of the recording, of the link, of the run, and where no robot was named, of a common arm.

    report: as `Metrics.report` gives it
    record: `session`, as `SessionWatch.report` gives it, and `link` where there is one
    """
    said = [
        *_of_session(record["session"], robot),
        *_of_link(record.get("link", {})),
        *_of_run(report, parameters),
        *([] if robot is not None else _of_arm(report, record["session"])),
    ]
    return [finding(*words) for so, *words in said if so]


# Whether it is so, its code, its severity, and what to say.
Rows = list[tuple[Any, str, str, str]]


def _of_session(session: dict[str, Any], robot: Robot | None) -> Rows:
    """What the recording itself shows; `session` as `SessionWatch.report` gives it."""
    (slow, fast), rate = RATES_HZ, session["rate_hz"]
    robots = rate if robot is None else robot.rate_hz
    aside = session.get("ignored_columns", ())
    return [
        (session["gaps"], "session-gap", "warning",
         f"{session['gaps']} gaps, about {session['missing_samples']} samples missing; the longest "
         f"interval is {session['dt_max_s']:.6g} s of {session['dt_nominal_s']:.6g} s"),
        ("jumps" in session, "session-jump", "error",
         f"{session.get('jumps')} jumps faster than {JUMP_M_S:g} m/s; the fastest is "
         f"{session['speed_max_m_s']:.6g} m/s at tick {session['speed_max_tick']}"),
        (aside, "session-columns", "info", f"columns not used: {', '.join(aside)}"),
        (not slow <= rate <= fast, "session-time", "warning",
         f"{rate:.6g} samples a second; {slow:g} to {fast:g} are usual: is the time in seconds?"),
        (not 0.9 < rate / robots < 1.1, "session-rate", "warning",
         f"recorded at {rate:.6g} Hz, the robot runs at {robots:g} Hz; --rate resamples"),
    ]  # fmt: skip


def _of_link(link: dict[str, Any]) -> Rows:
    """What a lossy link did that a robot does not forgive."""
    return [
        (link.get("robot_stops"), "robot-stops", "error",
         f"{link.get('lost_longest')} packets lost in a row from tick "
         f"{link.get('lost_longest_tick')}; the robot stops after {link.get('lost_limit')}"),
    ]  # fmt: skip


def _of_arm(report: dict[str, Any], session: dict[str, Any]) -> Rows:
    """Where no robot was named: whether the forces would stop a common arm, the shipped Panda."""
    panda = read_robot("franka")
    step, limit = report["force_step_max_n"], panda.force_step_limit_n
    return [
        (step > limit and session["rate_hz"] >= 0.9 * panda.rate_hz, "force-step", "warning",
         f"the force changes by {step:.3g} N in one tick (tick {report['force_step_max_tick']}); a "
         f"Franka arm stops above about {limit:g} N: --robot counts such ticks, --governor holds "
         "them back"),
    ]  # fmt: skip


def _of_run(report: dict[str, Any], parameters: ProxyParameters) -> Rows:
    """What the numbers of a run say; `report` as `Metrics.report` gives it."""
    clearance, inside = report.get("clearance_min_m", 0.0), report["inside_ticks"]
    fast, why = "info", "the engine used up its iterations; the proxy is safe and follows later"
    if parameters.rule == "paper":
        fast = "warning"
        why = f"the HIP moved more than r1 = {1e3 * parameters.r1:.3g} mm, as far as the proxy may"
    active = [e["index"] for e in report["episodes"] if not e["passive"]]
    more = report.get("episodes_left_out", {"active": 0})["active"]
    of = " of those listed" if more else ""
    first = f" (the first{of} is {active[0]})" if active else ""
    return [
        (clearance < -parameters.band - _ROUNDING_M, "proxy-inside",
         "warning" if inside else "error",
         f"the proxy came {-clearance:.3g} m inside the fixture; the band is "
         f"{parameters.band:.3g} m"),
        (clearance > FAR_M, "never-near", "warning",
         f"the tool never came nearer to the cloud than {clearance:.3g} m: are units and frame the "
         "fixture's?"),
        (inside, "started-inside", "warning",
         f"{inside} ticks in which the proxy was on its way out of the fixture"),
        (report.get("crossed_ticks"), "crossed", "warning",
         f"in {report.get('crossed_ticks')} ticks after an exchange no way out was found on the "
         "side where the proxy had been: it was led out another way"),
        (report.get("stale_ticks"), "stale", "warning",
         f"in {report.get('stale_ticks')} of {report['ticks']} ticks the pose was too old, or none "
         "had come"),
        (report.get("poses_refused"), "poses-refused", "warning",
         f"{report.get('poses_refused')} poses were refused: too far away, of no rotation, or "
         "earlier than one before"),
        (report.get("events_left"), "events-left", "warning",
         f"{report.get('events_left')} events are of ticks after the session's last"),
        (report["too_fast_ticks"], "too-fast", fast,
         f"in {report['too_fast_ticks']} ticks {why}"),
        (report["bad_hip_ticks"], "hip-out-of-range", "error",
         f"{report['bad_hip_ticks']} ticks farther than 1e6 m: the engine held its answer"),
        (active or more, "active", "warning",
         f"in {len(active) + more} episodes{first} the fixture gave the hand more energy than "
         "holding each force for a tick explains"),
    ]  # fmt: skip
