"""What a person should look at, out of a replay's numbers."""

from __future__ import annotations

from typing import Any

from vfplan.engine.parameters import ProxyParameters
from vfplan.replaying.watch import JUMP_M_S
from vfplan.robot import Robot, read_robot

# Rounding in the independent measurement of clearance [m].
_ROUNDING_M = 1e-9
# A session that stays farther than this from the fixture is likely in other units or another frame.
FAR_M = 0.5
# Rates that a tracked tool is recorded at; outside, the time is likely not in seconds.
RATES_HZ = (5.0, 50_000.0)


def finding(code: str, severity: str, message: str) -> dict[str, str]:
    """One finding: "info", "warning" or "error"."""
    return {"code": code, "severity": severity, "message": message}


def session_findings(session: dict[str, Any], robot: Robot | None) -> list[dict[str, str]]:
    """What the recording itself shows; `session` as `SessionWatch.report` gives it."""
    found = []
    nominal = session["dt_nominal_s"]
    if session["gaps"]:
        message = (
            f"{session['gaps']} gaps, about {session['missing_samples']} samples missing; the "
            f"longest interval is {session['dt_max_s']:.6g} s of {nominal:.6g} s"
        )
        found.append(finding("session-gap", "warning", message))
    if "jumps" in session:
        message = (
            f"{session['jumps']} jumps faster than {JUMP_M_S:g} m/s; the fastest is "
            f"{session['speed_max_m_s']:.6g} m/s at tick {session['speed_max_tick']}"
        )
        found.append(finding("session-jump", "error", message))
    if "ignored_columns" in session:
        names = ", ".join(session["ignored_columns"])
        found.append(finding("session-columns", "info", f"columns not used: {names}"))
    slow, fast = RATES_HZ
    if not slow <= session["rate_hz"] <= fast:
        message = (
            f"{session['rate_hz']:.6g} samples a second; {slow:g} to {fast:g} are usual: is the "
            "time in seconds?"
        )
        found.append(finding("session-time", "warning", message))
    if robot is not None and not 0.9 < session["rate_hz"] / robot.rate_hz < 1.1:
        message = (
            f"recorded at {session['rate_hz']:.6g} Hz, the robot runs at {robot.rate_hz:g} Hz; "
            "--rate resamples"
        )
        found.append(finding("session-rate", "warning", message))
    return found


def link_findings(link: dict[str, Any]) -> list[dict[str, str]]:
    """What a lossy link did that a robot does not forgive."""
    if not link.get("robot_stops"):
        return []
    message = (
        f"{link['lost_longest']} packets lost in a row from tick {link['lost_longest_tick']}; "
        f"the robot stops after {link['lost_limit']}"
    )
    return [finding("robot-stops", "error", message)]


def arm_findings(report: dict[str, Any], session: dict[str, Any]) -> list[dict[str, str]]:
    """Where no robot was named: whether the forces would stop a common arm, the shipped Panda."""
    panda = read_robot("franka")
    step, limit = report["force_step_max_n"], panda.force_step_limit_n
    if step <= limit or session["rate_hz"] < 0.9 * panda.rate_hz:
        return []
    message = (
        f"the force changes by {step:.3g} N in one tick (tick {report['force_step_max_tick']}); a "
        f"Franka arm stops above about {limit:g} N: --robot counts such ticks, --governor holds "
        "them back"
    )
    return [finding("force-step", "warning", message)]


def findings(report: dict[str, Any], parameters: ProxyParameters) -> list[dict[str, str]]:
    """What the numbers of a run say; `report` as `Metrics.report` gives it."""
    found = []

    def say(code: str, severity: str, message: str) -> None:
        found.append(finding(code, severity, message))

    clearance, inside = report.get("clearance_min_m", 0.0), report["inside_ticks"]
    if clearance < -parameters.band - _ROUNDING_M:
        say("proxy-inside", "warning" if inside else "error",
            f"the proxy came {-clearance:.3g} m inside the fixture; the band is "
            f"{parameters.band:.3g} m")  # fmt: skip
    if clearance > FAR_M:
        say("never-near", "warning", f"the tool never came nearer to the cloud than "
            f"{clearance:.3g} m: are units and frame the fixture's?")  # fmt: skip
    if inside:
        say("started-inside", "warning",
            f"{inside} ticks in which the proxy was on its way out of the fixture")  # fmt: skip
    if report.get("crossed_ticks"):
        say("crossed", "warning",
            f"in {report['crossed_ticks']} ticks after an exchange no way out was found on the "
            "side where the proxy had been: it was led out another way")  # fmt: skip
    if report.get("stale_ticks"):
        say("stale", "warning", f"in {report['stale_ticks']} of {report['ticks']} ticks the pose "
            "was too old, or none had come")  # fmt: skip
    if report.get("poses_refused"):
        say("poses-refused", "warning", f"{report['poses_refused']} poses were refused: too far "
            "away, of no rotation, or earlier than one before")  # fmt: skip
    if report.get("events_left"):
        say("events-left", "warning",
            f"{report['events_left']} events are of ticks after the session's last")  # fmt: skip
    if report["too_fast_ticks"]:
        why = "the engine used up its iterations; the proxy is safe and follows later"
        severity, r1 = "info", f"r1 = {1e3 * parameters.r1:.3g} mm"
        if parameters.rule == "paper":
            severity, why = "warning", f"the HIP moved more than {r1}, as far as the proxy may"
        say("too-fast", severity, f"in {report['too_fast_ticks']} ticks {why}")
    if report["bad_hip_ticks"]:
        say("hip-out-of-range", "error",
            f"{report['bad_hip_ticks']} ticks farther than 1e6 m: the engine held its answer"
            )  # fmt: skip
    active = [e["index"] for e in report["episodes"] if not e["passive"]]
    more = report.get("episodes_left_out", {"active": 0})["active"]
    if active or more:
        first = f" (the first of those listed is {active[0]})" if more and active else ""
        first = f" (the first is {active[0]})" if active and not more else first
        say("active", "warning", f"in {len(active) + more} episodes{first} the fixture gave the "
            "hand more energy than holding each force for a tick explains")  # fmt: skip
    return found
