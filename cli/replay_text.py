"""A replay as text: the figures that decide."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vfplan.cli.run import command_line

from vfplan.display import command_of, count, length, micrometres, millijoules, millimetres
from vfplan.replaying.findings import has_touched, untested_reason
from vfplan.replaying.metrics import NUMBERS, episode_count, unit_of
from vfplan.report.tables import bound_text

FORMS = {number.key: number for number in NUMBERS}


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
    lines += ["{severity}: {code}: {message}".format(**found) for found in report["findings"]]
    for check in report.get("checks", []):
        lines.append(f"{'pass' if check['pass'] else 'FAIL'}: {check_text(check)}")
    return "\n".join(lines)


def figure_lines(report: dict[str, Any]) -> list[str]:
    """The figures of one rule: penetration, force, clearance, and what only some replays have."""
    lines = [
        f"penetration  max {written(report, 'penetration_max_m')}",
        f"force        max {written(report, 'force_max_n')}, step max "
        f"{written(report, 'force_step_max_n')}",
    ]
    if "clearance_min_m" in report:
        lines.append(
            f"clearance    min {length(report['clearance_min_m'])}; "
            f"{report['entrenched_ticks']} ticks entrenched"
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
            f"up to {1e3 * report['pose_age_max_s']:.1f} ms old, {report['stale_ticks']} ticks "
            f"stale, {report['poses_refused']} poses refused"
        )
    if "governor" in report:
        governor = report["governor"]
        lines.append(
            f"governor     {governor['force_step_n']:g} N a tick, {governor['force_max_n']:g} N at "
            f"most: up to {governor['held_back_max_n']:.3f} N held back in "
            f"{governor['held_ticks']} ticks, of an engine that steps by "
            f"{governor['engine_force_step_max_n']:.3f} N"
        )
    return lines


def guide_line(report: dict[str, Any]) -> str:
    """What a guide did."""
    guide = report["guide"]
    if not report.get("arc_m"):
        return "guide        never had hold of the tip"
    return (
        f"guide        tube of {millimetres(guide['radius_m'])}: lateral max "
        f"{written(report, 'lateral_max_m')} (tick {guide['lateral_max_tick']}); outside for "
        f"{guide['outside_s']:.3f} s, force max {guide['force_max_n']:.3f} N"
    )


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
    return line


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
    return command_of("stability", fixture, "--robot", str(robot or "franka"))


def check_text(check: dict[str, Any]) -> str:
    """A limit and the value that was measured."""
    name = check["name"]
    unit = "" if name.endswith(("_ticks", "_tick")) else f" {unit_of(name)}".rstrip()
    return f"{name} is {check['value']:.6g}{unit}, {bound_text(check)} is allowed"
