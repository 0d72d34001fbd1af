"""A replay as text: the figures that decide, and with `-v` the statistics."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from vfplan.cli.run import command_line, is_verbose

from vfplan.display import (
    MAX_LISTED,
    count,
    length,
    micrometres,
    millijoules,
    millimetres,
    milliseconds,
)
from vfplan.replaying.findings import LIMITS, has_touched, untested_reason
from vfplan.replaying.metrics import NUMBERS, episode_count, unit_of
from vfplan.report.tables import bound_text

FORMS = {number.key: number for number in NUMBERS}

# The unit of each limit of a robot.
UNITS_OF_LIMITS = {"force": "N", "force_step": "N a tick", "speed": "m/s"}


def written(report: dict[str, Any], key: str) -> str:
    """A number of the report with its unit, e.g. "0.248 mm"."""
    form = FORMS[key]
    return f"{form.text(report[key])} {form.unit}".rstrip()


def replay_text(report: dict[str, Any]) -> str:
    """The report of a replay on a screen."""
    engine = f" ({report['engine']} engine)" if report["engine"] != "native" else ""
    untested = untested_reason(report)
    lines = [f"NOT TESTED: {untested}"] if untested else []
    lines.append(
        f"rule {report['rule']}{engine}: {report['ticks']} ticks at "
        f"{report['session']['rate_hz']:.6g} Hz, {written(report, 'duration_s')}, "
        f"{report['contact_ticks']} in contact, {count(episode_count(report), 'episode')}"
    )
    lines += figure_lines(report)
    if "paper" in report:
        lines.append("rule paper, side by side:")
        lines += [f"  {line}" for line in figure_lines(report["paper"])]
        lines.append(comparison_line(report["apart"]))
    if "link" in report:
        lines.append(link_line(report["link"]))
    if "robot" in report:
        lines.append(robot_line(report["robot"]))
    if is_verbose():
        lines += episode_lines(report)
    lines += ["{severity}: {code}: {message}".format(**found) for found in report["findings"]]
    for check in report.get("checks", []):
        lines.append(f"{'pass' if check['pass'] else 'FAIL'}: {check_text(check)}")
    return "\n".join(lines)


def figure_lines(report: dict[str, Any]) -> list[str]:
    """The figures of one rule: penetration, force, clearance, and what only some replays have."""
    penetration = f"penetration  max {written(report, 'penetration_max_m')}"
    force = f"force        max {written(report, 'force_max_n')}"
    if is_verbose():
        penetration += f", rms {written(report, 'penetration_rms_m')}"
        if "overlap_max_m" in report:
            penetration += f"; overlap max {written(report, 'overlap_max_m')}"
        force += f", rms {written(report, 'force_rms_n')}"
    lines = [penetration, f"{force}, step max {written(report, 'force_step_max_n')}"]
    if "clearance_min_m" in report:
        geometry = f" ({geometry_text(report['scene'])})" if is_verbose() else ""
        lines.append(
            f"clearance    min {length(report['clearance_min_m'])}{geometry}; "
            f"{report['entrenched_ticks']} ticks entrenched"
        )
    if is_verbose():
        lines.append(
            f"energy       {written(report, 'energy_j')} net given to the hand; holding each force "
            f"for a tick alone gives {written(report, 'energy_hold_j')}"
        )
        if "slide_m" in report and "friction" in report:
            lines.append(
                f"sliding      {written(report, 'slide_m')}, apparent friction "
                f"{written(report, 'friction')}, lag rms {written(report, 'lag_rms_m')}"
            )
    if "guide" in report:
        lines.append(guide_line(report))
    if "exchanges" in report:
        lines.append(
            f"changes      {report['exchanges']} exchanges, {report['edits']} points edited; "
            f"{report['changing_ticks']} ticks until the force was there"
        )
    if "fixture_energy_j" in report:
        lines.append(
            f"motion       gave the hand {millijoules(report['fixture_energy_j'])} besides; poses "
            f"up to {milliseconds(report['pose_age_max_s'])} old, {report['stale_ticks']} ticks "
            f"stale, {report['poses_refused']} poses refused"
        )
    if "governor" in report:
        lines.append(governor_line(report["governor"]))
    if is_verbose():
        times = report["step_us"]
        lines.append(
            f"time a tick  {times['median']:.2f} µs median, {written(times, 'p999')} p99.9; all of "
            f"it {report['real_time_factor']:.0f} times real time (the longest, "
            f"{times['max']:.0f} µs, is this computer's: it is no real-time system)"
        )
    return lines


def geometry_text(scene: dict[str, Any]) -> str:
    """The geometry that the clearance is measured to."""
    if "band_m" in scene:
        return f"band {micrometres(scene['band_m'], 1)}"
    if "lines_and_arcs" in scene:
        return f"{scene['lines_and_arcs']} lines and arcs"
    return f"{scene.get('triangles', 0)} triangles"


def guide_line(report: dict[str, Any]) -> str:
    """What a guide did."""
    guide = report["guide"]
    if not report.get("arc_m"):
        return "guide        never had hold of the tip"
    first, last = report["arc_m"]
    line = (
        f"guide        tube of {millimetres(guide['radius_m'])}: lateral max "
        f"{written(report, 'lateral_max_m')} (tick {guide['lateral_max_tick']}), rms "
        f"{millimetres(guide['lateral_rms_m'])}; arc {1e3 * first:.2f} to {1e3 * last:.2f} mm; "
        f"outside for {guide['outside_s']:.3f} s, force max {guide['force_max_n']:.3f} N, work "
        f"{millijoules(guide['work_j'])}"
    )
    if "region_force_max_n" in guide:
        line += f"; the region's force max {guide['region_force_max_n']:.3f} N"
    return line


def governor_line(governor: dict[str, Any]) -> str:
    """What a governor held back."""
    line = (
        f"governor     {governor['force_step_n']:g} N a tick, {governor['force_max_n']:g} N at "
        f"most: up to {governor['held_back_max_n']:.3f} N held back in {governor['held_ticks']} "
        f"ticks, of an engine that steps by {governor['engine_force_step_max_n']:.3f} N"
    )
    if is_verbose():
        line += (
            f"; its work {millijoules(governor['work_j'])}; a free mass is given "
            f"{millijoules(governor['energy_given_j'])} of "
            f"{millijoules(governor['energy_stored_j'])} stored"
        )
    return line


def comparison_line(comparison: dict[str, Any]) -> str:
    """Where two rules part."""
    if not comparison["span_count"]:
        return f"the rules never part by more than {micrometres(comparison['threshold_m'], 0)}"
    return (
        f"the rules part {count(comparison['span_count'], 'time')}, first at tick "
        f"{comparison['first_tick']} ({comparison['first_s']:.3f} s); at most "
        f"{millimetres(comparison['proxy_max_m'])} and {comparison['force_max_n']:.3f} N apart"
    )


def link_line(link: dict[str, Any]) -> str:
    """What a lossy link lost, and what that changed."""
    names = ("drop", "jitter_s", "delay_ticks", "quantum_m", "seed")
    faults = [f"{name} {link[name]:g}" for name in names if name in link]
    line = f"lossy link   {', '.join(faults)}"
    if "lost" in link:
        line += f"; {link['lost']} packets lost, {link['lost_longest']} in a row"
    if "perfect" in link:
        perfect = link["perfect"]
        line += (
            f"; over a perfect link: force max {written(perfect, 'force_max_n')}, energy "
            f"{written(perfect, 'energy_j')}; forces differ by up to "
            f"{written(link['apart'], 'force_max_n')}"
        )
    return line


def robot_line(robot: dict[str, Any]) -> str:
    """In how many ticks a robot would have objected."""
    parts = [
        f"{name.replace('_', ' ')} over {robot[LIMITS[name][0]]:g} {unit} in "
        f"{robot[f'{name}_over_ticks']} ticks"
        for name, unit in UNITS_OF_LIMITS.items()
        if LIMITS[name][0] in robot
    ]
    return f"robot {robot['name']}: " + ", ".join(parts)


def episode_lines(report: dict[str, Any]) -> list[str]:
    """The contacts one by one."""
    lines = []
    for episode in report["episodes"][:MAX_LISTED]:
        if "deepest_along" in episode:
            along = episode["deepest_along"]
            place = f", {millimetres(along['s_m'], 1)} along stroke {along['stroke']}"
        else:
            near = ", ".join(f"{1e3 * x:.1f}" for x in episode["deepest"]["proxy_m"])
            place = f" near ({near}) mm"
        lines.append(
            f"  episode {episode['index']}: {episode['start_s']:.3f}-{written(episode, 'end_s')}, "
            f"up to {written(episode, 'penetration_max_m')} deep{place}, up to "
            f"{written(episode, 'force_max_n')}"
        )
    if len(report["episodes"]) > MAX_LISTED:
        kept = "the deepest" if "episodes_left_out" in report else "all"
        lines.append(f"  and {episode_count(report) - MAX_LISTED} more (--json has {kept})")
    return lines


def failed_line(report: dict[str, Any]) -> str:
    """Why the exit code is 1; empty where it is 0."""
    checks = report.get("checks", [])
    broken = [check_text(check) for check in checks if not check["pass"]]
    if broken:
        return "; ".join(broken)
    if checks and report["verdict"] == "not-tested":
        return f"not tested: {untested_reason(report)}"
    return ""


def next_step(
    report: dict[str, Any], fixture: Path, robot: Path | None, index_page: Path | None,
    wrote_files: bool,
) -> str:  # fmt: skip
    """What to do after the replay of a fixture; fixture and robot are named as they were typed.

    index_page: the page of the report, if one was made
    wrote_files: whether the same command finds its own files when it is given again
    """
    again = command_line()
    if wrote_files and "--overwrite" not in again:
        again += " --overwrite"
    if not has_touched(report):
        return "replay a session that touches the fixture; check --units and the session's frame"
    if "checks" not in report:
        return f"hold it against a robot's limits, such as: {again} --robot franka"
    if report["verdict"] == "fail":
        drawing = f"draw the session tick by tick: {again} --report DIR"
        return f"look at the ticks that failed: {index_page}" if index_page else drawing
    return shlex.join(["vfplan", "stability", str(fixture), "--robot", str(robot or "franka")])


def check_text(check: dict[str, Any]) -> str:
    """A limit and the value that was measured."""
    name = check["name"]
    unit = "" if name.endswith(("_ticks", "_tick")) else f" {unit_of(name)}".rstrip()
    return f"{name} is {check['value']:.6g}{unit}, {bound_text(check)} is allowed"
