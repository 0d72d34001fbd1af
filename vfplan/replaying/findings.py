"""What a replay is held against: findings, limits of a robot and of the caller, and the verdict.

A replay's findings inform and decide nothing; limits do.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Any

import numpy as np

from vfplan.display import count, in_singular, length, millimetres, three_digits
from vfplan.engine.parameters import ProxyParameters
from vfplan.errors import SettingError
from vfplan.geometry import ROUNDING_M, UNIT_ROUNDED
from vfplan.replaying.metrics import FACTORS, LIMITS, Report, unit_of
from vfplan.robot import Robot, read_robot
from vfplan.session.events import CHANGE_COLUMNS
from vfplan.session.session import JUMP_M_S

# A session that stays farther away than this [m] is likely in other units or another frame.
NEVER_NEAR_M = 0.5
# A frame that lags by more than this [m] when its next pose comes is told with the verdict.
LAG_TOLD_M = 1e-3
# No tracked tool is recorded at a lower rate [Hz]: the time is then likely not in seconds.
SLOWEST_HZ = 5.0
# No hand holds a tool so still for a whole session that it never moves faster than this [m/s].
SLOWEST_M_S = 2e-3
# Positions that repeat for less than this [s] at a time are held, and not those of a tool at rest.
LONGEST_HOLD_S = 0.1
# No tracked tool is recorded at a higher rate [Hz]: the time is then likely not in seconds.
FASTEST_HZ = 50_000.0


# A limit is drawn up to so many times the largest force. Beyond, the force would be a flat line.
ROOM_FOR_LIMITS = 3.0

# As `--json` has it.
Finding = dict[str, str]


def finding(code: str, severity: str, text: str) -> Finding:
    """A finding of a replay; its severity is "info", "warning" or "error"."""
    return {"code": code, "severity": severity, "message": text}


def told(numbers: Report, *findings: tuple[Any, str, str, str]) -> Iterator[Finding]:
    """Those findings before which something is true; their sentences name some of the numbers."""
    for is_told, code, severity, text in findings:
        if is_told:
            yield finding(code, severity, in_singular(text.format_map(numbers)))


def replay_findings(
    report: Report, record: Report, parameters: ProxyParameters, robot: Robot | None
) -> Iterator[Finding]:
    """Of the recording, of the link, of the run, and where no robot was named, of a common arm.

    report: as `Metrics.report` gives it
    record: `session`, as `SamplingReport.report` gives it, and `link` where there is one
    """
    session, link = record["session"], record.get("link", {})
    yield from recording_findings(session, robot)
    depth_m = record.get("start_depth_m", 0.0)
    rounded = session.get("poses_rounded", 0) + report.get("poses_rounded", 0)
    numbers = {"depth_mm": 1e3 * depth_m, "rounded": rounded, "limit": UNIT_ROUNDED}
    yield from told(
        link | numbers,
        (link.get("robot_stops"), "robot-stops", "error",
            "{lost_longest} packets in a row are lost from tick {lost_longest_tick} on, and the "
            "robot stops after {lost_limit}. Mend the link, or raise its speed."),
        ("start_depth_m" in record, "started-in-mesh", "error",
            "The tool begins {depth_mm:.3g} mm inside the closed mesh, and its inner side is "
            "rendered. Begin outside; check units and registration."),
        (rounded, "poses-rounded", "info",
            "The quaternions of {rounded} poses differ from length 1 by more than {limit:g}, and "
            "were taken at it. Record them with more digits."),
    )  # fmt: skip
    yield from run_findings(report | {"link": link}, parameters)
    # Where no robot was named: whether the forces would stop a common arm, the shipped Panda.
    panda = read_robot("franka")
    is_fast = session["rate_hz"] >= 0.9 * panda.rate_hz
    is_beyond = report["force_step_max_n"] > panda.force_step_limit_n
    yield from told(
        report | {"limit_n": panda.force_step_limit_n},
        (robot is None and is_beyond and is_fast, "force-step", "warning",
            "The force changes by {force_step_max_n:.3g} N in one tick (tick "
            "{force_step_max_tick}), and a Franka arm stops above about {limit_n:g} N. Count such "
            "ticks with --robot, or hold them back with --governor."),
    )  # fmt: skip


def recording_findings(session: Report, robot: Robot | None) -> Iterator[Finding]:
    """What the recording itself shows; `session` as `SamplingReport.report` gives it."""
    rate, fastest = session["rate_hz"], session["speed_max_m_s"]
    robot_rate = getattr(robot, "rate_hz", rate)
    recorded, mended = session.get("recorded", session), session.get("mended", {})
    held_s = recorded["repeats_longest"] * recorded["dt_nominal_s"]
    is_held = recorded["repeats"] > recorded["changes"] and held_s < LONGEST_HOLD_S
    is_slow = not SLOWEST_HZ <= rate <= FASTEST_HZ or 0 < fastest < SLOWEST_M_S
    # What its columns tell that the replay does not use.
    changes = [c for c in session.get("ignored_columns", ()) if c in CHANGE_COLUMNS]
    numbers = {
        "recorded": recorded, "robot_rate": robot_rate, "columns": " and ".join(changes),
        "changes_hz": recorded["changes"] / (recorded["samples"] - 1) * recorded["rate_hz"],
        "jump_m_s": JUMP_M_S, "slowest_hz": SLOWEST_HZ, "fastest_hz": FASTEST_HZ,
    }  # fmt: skip
    yield from told(
        session | numbers,
        (recorded["gaps"], "session-gap", "warning",
            "About {recorded[missing_samples]} samples are missing, in gaps of "
            "{recorded[gap_s]:.3g} s together; the longest interval is {recorded[dt_max_s]:.6g} s "
            "instead of {recorded[dt_nominal_s]:.6g} s. Record without gaps, or do not rely on the "
            "ticks there."),
        (any(mended.values()), "session-unordered", "warning",
            "{mended[swapped]} samples came late and were put in order; {mended[doubled]} were "
            "there twice or far too late, and were left out. Check its source."),
        (is_held, "session-held", "warning",
            "Positions are held: they change {changes_hz:.4g} times a second, of "
            "{recorded[rate_hz]:.6g} samples. Speeds and force steps are those of the jumps "
            "between. Record each sample, or resample at that rate with --rate."),
        (session.get("unstamped"), "session-stamp", "warning",
            "{unstamped} messages have no time of their own, so the times are those of the log. If "
            "they are right, say --time log; if not, record the headers."),
        (session.get("ros_frame_id") not in (None, session["frame"]), "session-frame", "info",
            "The messages are in frame {ros_frame_id!r}, taken as {frame!r}. Check that it is the "
            "same one."),
        (session.get("cut"), "session-cut", "warning",
            "The recording was cut off, and all of it that is whole is replayed. Record it anew."),
        (session.get("open_end"), "session-open-end", "info",
            "The file's last line has no line break, so its last number may be cut short. Compare "
            "it with the recording, or leave the line out."),
        ("jumps" in session, "session-jump", "error",
            "Ticks in which the tool moves faster than {jump_m_s:g} m/s: {jumps}. The highest "
            "speed is {speed_max_m_s:.6g} m/s, in tick {speed_max_tick}. Check --units and the "
            "tracker."),
        (changes, "session-changes", "warning",
            "The fixture moved or was changed while this session was recorded, as its columns "
            "{columns} tell, and this replay renders it as planned. Give the files of that run: "
            "--poses, --events."),
        (is_slow, "session-time", "warning",
            "The session has {rate_hz:.6g} samples a second, where {slowest_hz:g} to "
            "{fastest_hz:g} are usual, and a highest speed of {speed_max_m_s:.3g} m/s. Is the time "
            "in seconds?"),
        (not 0.9 < rate / robot_rate < 1.1, "session-rate", "warning",
            "The session was recorded at {rate_hz:.6g} Hz, and the robot runs at {robot_rate:g} "
            "Hz. Resample it with --rate."),
    )  # fmt: skip


def run_findings(report: Report, parameters: ProxyParameters) -> Iterator[Finding]:
    """What the numbers of a run say; `report` as `Metrics.report` gives it, `link` beside it."""
    clearance_m, is_paper = report.get("clearance_min_m", 0.0), parameters.rule == "paper"
    active = sum(not episode["passive"] for episode in report["episodes"])
    active += report.get("episodes_left_out", {"active": 0})["active"]
    numbers = {
        "depth": length(-clearance_m), "band": length(parameters.band), "active": active,
        "or_link": ", or mend the lossy link" if report.get("link") else "",
        "other_rule": ", with another rule" if is_paper else "", "r1_mm": 1e3 * parameters.r1,
    }  # fmt: skip
    # A session that starts inside is led out; only an entry from outside is the rule's fault.
    severity = "warning" if report["inside_ticks"] else "error"
    yield from told(
        report | numbers,
        (clearance_m < -parameters.band - ROUNDING_M, "proxy-inside", severity,
            "The proxy came {depth} inside the fixture, further than the band of {band}. Begin the "
            "session outside{other_rule}."),
        (clearance_m > NEVER_NEAR_M, "never-near", "warning",
            "The tool never came nearer to the fixture than {clearance_min_m:.3g} m. Are the units "
            "and the frame the fixture's?"),
        (report["inside_ticks"], "started-inside", "warning",
            "In {inside_ticks} ticks the proxy was on its way out of the fixture, in which it was "
            "at the start or after a change. Start the hand outside, and change a fixture while "
            "the tool is away."),
        (report.get("enclosed_episodes"), "started-in-mesh", "error",
            "In {enclosed_episodes} episodes (of the 20 deepest) the tool pressed from within the "
            "closed mesh. Begin outside; check units, poses and events."),
        (report.get("within_episodes"), "pressed-within", "warning",
            "In {within_episodes} episodes (of the 20 deepest) the tool pressed from within the "
            "mesh, which is open, so it may have come in through an opening. Close the mesh, or "
            "make sure that this side is meant."),
        (report.get("crossed_ticks"), "crossed", "warning",
            "In {crossed_ticks} ticks after an exchange no way out was found on the proxy's side, "
            "so it was led out another way. Exchange fixtures while the tool is away."),
        (report.get("stale_ticks"), "stale", "warning",
            "In {stale_ticks} of {ticks} ticks the pose was too old, or none had come. Check the "
            "pose stream's rate."),
        (report.get("pose_jumps"), "pose-jump", "warning",
            "{pose_jumps} poses jumped, the first at {pose_jump_first_s:.6g} s: each is farther "
            "from the pose before than the frame may go meanwhile. Check the tracker and its "
            "reference."),
        (report.get("poses_refused"), "poses-refused", "warning",
            "{poses_refused} poses were refused: too far away, of no rotation, or earlier than one "
            "before. Check the pose stream."),
        (report.get("events_left"), "events-left", "warning",
            "{events_left} events are of ticks after the session's last. Correct their ticks."),
        (is_paper and report["too_fast_ticks"], "too-fast", "warning",
            "In {too_fast_ticks} ticks the hand moved more than r1 = {r1_mm:.3g} mm, as far as the "
            "proxy may in one. Move more slowly, or take rule 'robust'."),
        (active, "active", "warning",
            "In {active} episodes the fixture gave the hand more energy than holding each force "
            "for a tick explains. Lower the stiffness, or move more slowly{or_link}."),
    )  # fmt: skip


# Of each limit the number's name in the report, "at_most" or "at_least", the bound, and the name
# of the robot whose limit it is; of the caller's own there is none.
Limits = tuple[tuple[str, str, float] | tuple[str, str, float, str], ...]


def robot_limits(robot: Robot) -> Limits:
    """The robot's limits as checks of a replay's report."""
    limits = [(n, "at_most", getattr(robot, key), robot.name) for key, n in LIMITS.values()]
    return tuple(limit for limit in limits if limit[2] is not None)


def check_limits(report: Report, limits: Limits) -> Iterator[Report]:
    """Each limit against the report.

    report: as a replay gives it; `a.b` names b within a
    Raises SettingError: a name that is no number of the report
    """
    for name, sense, limit, *robot in limits:
        value = report
        for part in name.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        if not is_number(value):
            numbers = sorted(key for key in report if is_number(report[key]))
            (similar,) = difflib.get_close_matches(name, numbers, 1, 0.0)
            message = f"the report has no number {name!r}. Did you mean {similar}? "
            message += f"Give one of {', '.join(numbers)}"
            raise SettingError(message, code="no-such-number")
        holds = {"at_most": value <= limit, "at_least": value >= limit}[sense]
        check = {"name": name, "value": value, sense: limit, "pass": bool(holds)}
        if robot and [other[0] for other in limits].count(name) > 1:
            # The caller has one of this name too.
            check["robot"] = robot[0]
        yield check


def is_number(value: Any) -> bool:
    """Whether a limit may be set on it."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def has_touched(report: Report) -> bool:
    """Whether the fixture did anything: it pushed the tool, or a guide had hold of the tip.

    report: as `Metrics.report` gives it
    """
    return report["contact_ticks"] > 0 or report.get("arc_m") is not None


def open_words(report: Report) -> str:
    """What a "pass" leaves open, to stand after it; empty where it leaves nothing open.

    In a session that was resampled lines fill the gaps, so those of the recording count.
    """
    session = report["session"]
    recorded = session.get("recorded", session)
    codes = {finding["code"] for finding in report["findings"]}
    left_out, within = report["samples_left_out"], report.get("within_episodes")
    stale, missing = report.get("stale_ticks", 0), report.get("missing_pose_ticks", 0)
    jumps, lag_m = report.get("pose_jumps", 0), report.get("frame_lag_max_m", 0.0)
    words = (
        (recorded["gaps"], f"nothing is known of {recorded['gap_s']:.3g} s without samples"),
        (session.get("cut"), "the recording was cut off"),
        (session.get("unstamped"), "the times are those of the log"),
        ("session-jump" in codes, "the tool jumps"),
        (left_out, f"{left_out} samples of the recording were left out"),
        (
            "session-changes" in codes,
            "the fixture moved or changed during the recording, and here it did not",
        ),
        (within, f"in {within} episodes the tool pressed from within the open mesh"),
        (missing, f"no pose had come in {missing} ticks"),
        (stale > missing, f"the pose was too old in {stale - missing} ticks"),
        (jumps, f"{count(jumps, 'pose')} jumped"),
        (lag_m > LAG_TOLD_M, f"the frame lagged by up to {1e3 * lag_m:.3g} mm"),
    )
    return "".join(f", but {text}" for is_open, text in words if is_open)


def untested_reason(report: Report) -> str:
    """Why the ticks prove nothing, whatever the limits say; empty where they do."""
    if "start_depth_m" in report:
        return "the tool began inside the mesh, where nothing says which side is forbidden"
    if not has_touched(report):
        return "the tool never touched the fixture"
    if any(finding["code"] == "session-time" for finding in report["findings"]):
        return "the session's time may not be in seconds"
    if 0 < report["ticks"] == report.get("inside_ticks"):
        return "the proxy was not led out of the fixture in which it began"
    if pressed := report.get("enclosed_episodes"):
        return f"in {pressed} episodes the tool pressed from within the closed mesh"
    if untrue := report.get("stale_contact_ticks"):
        return f"in {untrue} ticks of contact the fixture's pose was too old, or had not come"
    return ""


def verdict_of(report: Report) -> str:
    """How a replay ended: "pass", "fail" or "not-tested".

    A replay passes if every limit holds and nothing makes it untested. A verdict speaks of the
    ticks that were recorded; `open_words` says what it leaves open.
    """
    checks = report.get("checks", [])
    if any(not check["pass"] for check in checks):
        return "fail"
    return "not-tested" if not checks or untested_reason(report) else "pass"


def verdict_sentence(metrics: Report) -> str:
    """How far the tool went beyond the line, then the limits that were asked, and what is open."""
    limits = metrics.get("checks", [])
    texts = {False: [], True: []}
    for limit in limits:
        texts[limit["pass"]].append(f"{limit['name']} {bound_text(limit)}")
    broken, held = texts[False], ", ".join(texts[True])
    if metrics["verdict"] == "fail":
        words = f"{len(broken)} of {count(len(limits), 'limit')} broken: {', '.join(broken)}"
        words += f"; held: {held}" if held else ""
    elif metrics["verdict"] == "pass":
        words = f"{count(len(limits), 'limit')} asked and held: {held}{open_words(metrics)}"
    else:
        words = untested_reason(metrics) or "no limits were given"
    return in_singular(f"{beyond_words(metrics)}; {words}")


def beyond_words(metrics: Report) -> str:
    """How far the tool went beyond what was drawn, or from a guide's line."""
    if guides_alone(metrics):
        return f"up to {millimetres(metrics['lateral_max_m'], 2)} from the guide's line"
    drawn, farthest_m = beyond(metrics, metrics.get("overlap_max_m", 0.0))
    if "start_depth_m" in metrics:
        return f"began {millimetres(metrics['start_depth_m'], 2)} inside {drawn}"
    if farthest_m == 0.0:
        return f"never beyond {drawn}"
    return f"up to {millimetres(farthest_m, 2)} beyond {drawn}"


def guides_alone(metrics: Report) -> bool:
    """Whether nothing but a guide was rendered, which has no rule and no contact."""
    return "guide" in metrics and "region_force_max_n" not in metrics["guide"]


def beyond(metrics: Report, overlap_m: Any) -> tuple[str, Any]:
    """What was drawn, and how far the tool is beyond it [m], of the overlap.

    The overlap begins at the margin around it. A fixture given in exchange may have another margin.
    """
    scene = metrics["scene"]
    drawn = "the drawn line" if scene["planar"] else "the points"
    if "triangles" in scene:
        drawn = "the surface"
    if metrics.get("exchanges"):
        return f"{drawn} with the margin", overlap_m
    return drawn, np.maximum(0.0, overlap_m - scene["point_radius_m"])


def bound_text(check: Report) -> str:
    """The bound of a limit and whose it is, such as "at most 20 N (robot franka)"."""
    (sense,) = {"at_most", "at_least"} & check.keys()
    factor, unit = unit_beside(check)
    whose = f" (robot {check['robot']})" if "robot" in check else ""
    return f"{sense.replace('_', ' ')} {factor * check[sense]:g}{unit}{whose}"


def limits_n(metrics: Report) -> list[float]:
    """The limits on the largest force [N] that a picture of the forces has room for."""
    checks = [check for check in metrics.get("checks", []) if check["name"] == "force_max_n"]
    highest = ROOM_FOR_LIMITS * metrics["force_max_n"]
    return [c["at_most"] for c in checks if c.get("at_most", np.inf) <= highest]


def check_text(check: Report) -> str:
    """A limit and the value that was measured."""
    factor, unit = unit_beside(check)
    value, bound = factor * check["value"], factor * check.get("at_most", check.get("at_least"))
    found = str(value) if isinstance(value, int) else three_digits(round(value, 6))
    # Digits that are not shown may decide.
    if np.sign(float(found) - float(f"{bound:g}")) != np.sign(value - bound):
        found = str(value)
    return f"{check['name']} is {found}{unit}, {bound_text(check)} is allowed"


def unit_beside(check: Report) -> tuple[float, str]:
    """How many of a number's unit are in the report's, and that unit after a blank.

    Ticks have none, as their name tells them.
    """
    unit = unit_of(check["name"])
    unit = {"m": "mm", "J": "mJ"}.get(unit, unit)
    return FACTORS.get(unit, 1), f" {unit}" if unit and not unit.startswith("tick") else ""
