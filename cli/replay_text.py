"""What `vfplan replay` tells a person."""

from __future__ import annotations

from typing import Any

from vfplan.cli.telling import told

from vfplan.display import length
from vfplan.replaying.episodes import episode_count
from vfplan.replaying.limits import LIMITS, has_touched

EPISODES = 20  # listed; --json has all
NEVER_TOUCHED = "the tool never touched the fixture"
NUMBERS = (
    "penetration  max {penetration_max_m:mm}, rms {penetration_rms_m:mm}",
    "; overlap max {overlap_max_m:mm}",
    "\nforce        max {force_max_n:.3f} N, rms {force_rms_n:.3f} N, "
    "step max {force_step_max_n:.3f} N",
    "\nclearance    min {clearance} ({of}); {entrenched_ticks} ticks entrenched",
    "\nenergy       {energy_j:mJ} net given to the hand; holding each force for a tick alone gives "
    "{energy_hold_j:mJ}",
    "\nsliding      {slide_m:mm}, apparent friction {friction:z.5f}, lag rms {lag_rms_m:um}",
    "\nguide        tube of {guide[radius_m]:mm}: lateral max {lateral_max_m:mm} "
    "(tick {guide[lateral_max_tick]}), rms {guide[lateral_rms_m]:mm}; "
    "arc {arc}; outside for {guide[outside_s]:.3f} s, "
    "force max {guide[force_max_n]:.3f} N, work {guide[work_j]:mJ}",
    "{no_guide}",
    "; the region's force max {region_force_max_n:.3f} N",
    "\nchanges      {exchanges} exchanges, {edits} points edited; {changing_ticks} ticks until the "
    "force was there",
    "\nmotion       gave the hand {fixture_energy_j:mJ} besides; poses up to {pose_age_max_s:ms} "
    "old, {stale_ticks} ticks stale, {poses_refused} poses refused",
    "\ngovernor     {governor[force_step_n]:g} N a tick, {governor[force_max_n]:g} N at most: up "
    "to {governor[held_back_max_n]:.3f} N held back in {governor[held_ticks]} ticks, of an engine "
    "that steps by {governor[engine_force_step_max_n]:.3f} N; its work {governor[work_j]:mJ}; a "
    "free mass is given {governor[energy_given_j]:mJ} of {governor[energy_stored_j]:mJ} stored",
    "\ntime a tick  {step_us[median]:.2f} µs median, {step_us[p999]:.2f} µs p99.9; all of it "
    "{real_time_factor:.0f} times real time (the longest, {step_us[max]:.0f} µs, is this "
    "computer's: it is no real-time system)",
)
OF = "band {band_m:um.1}", "{lines_and_arcs} lines and arcs", "{triangles} triangles"
APART = (
    " part {span_count} times, first at tick {first_tick} ({first_s:.3f} s); at most "
    "{proxy_max_m:mm} and {force_max_n:.3f} N apart"
)
LINK = (
    "lossy link   {faults}",
    "; {lost} packets lost, {lost_longest} in a row",
    "; over a perfect link: force max {perfect[force_max_n]:.3f} N, energy {perfect[energy_j]:mJ}; "
    "forces differ by up to {apart[force_max_n]:.3f} N",
)
EPISODE = (
    "  episode {index}: {start_s:.3f}-{end_s:.3f} s, up to {penetration_max_m:mm} deep",
    ", {deepest_along[s_m]:mm.1} along stroke {deepest_along[stroke]}",
    "{near}, up to {force_max_n:.3f} N",
)


def replay_text(found: dict[str, Any]) -> str:
    """The short report."""
    lines = [_head(found), _numbers(found)]
    if not has_touched(found):
        lines.insert(0, f"NOT TESTED: {NEVER_TOUCHED}")
    if "paper" in found:
        paper = _numbers(found["paper"]).replace("\n", "\n  ")
        lines += ["rule paper, side by side:", f"  {paper}", f"the rules{_apart(found['apart'])}"]
    if "link" in found:
        lines.append(_link(found["link"]))
    if "robot" in found:
        lines.append(_robot(found["robot"]))
    lines += [_episode(episode) for episode in found["episodes"][:EPISODES]]
    if len(found["episodes"]) > EPISODES:
        has = "the deepest" if "episodes_left_out" in found else "all"
        lines.append(f"  and {episode_count(found) - EPISODES} more (--json has {has})")
    lines += [f"{f['severity']}: {f['code']}: {f['message']}" for f in found["findings"]]
    lines += [check_line(check) for check in found.get("checks", [])]
    return "\n".join(lines)


def _head(found: dict[str, Any]) -> str:
    engine = "" if found["engine"] == "native" else f" ({found['engine']} engine)"
    return told(
        found | {"by": engine, "count": episode_count(found)},
        "rule {rule}{by}: {ticks} ticks at {session[rate_hz]:.6g} Hz, {duration_s:.3f} s, "
        "{contact_ticks} in contact, {count} episodes",
    )


def _numbers(found: dict[str, Any]) -> str:
    more: dict[str, Any] = {"of": told(found["scene"], *OF)}
    if "clearance_min_m" in found:
        more["clearance"] = length(found["clearance_min_m"])
    if found.get("arc_m"):
        first, last = found["arc_m"]
        more |= found["guide"] | {"arc": f"{1e3 * first:.2f} to {1e3 * last:.2f} mm"}
    elif "guide" in found:
        more["no_guide"] = "\nguide        never had hold of the tip"
    return told(more | found, *NUMBERS)


def _apart(apart: dict[str, Any]) -> str:
    if not apart["span_count"]:
        return told(apart, " never part by more than {threshold_m:um.0}")
    return told(apart, APART)


def _link(link: dict[str, Any]) -> str:
    names = ("drop", "jitter_s", "delay_ticks", "quantum_m", "seed")
    faults = ", ".join(f"{name} {link[name]:g}" for name in names if name in link)
    return told(link | {"faults": faults}, *LINK)


def _robot(robot: dict[str, Any]) -> str:
    units = {"force": "N", "force_step": "N a tick", "speed": "m/s"}
    parts = [
        f"{name.replace('_', ' ')} over {robot[LIMITS[name][0]]:g} {unit} in "
        f"{robot[f'{name}_over_ticks']} ticks"
        for name, unit in units.items()
        if LIMITS[name][0] in robot
    ]
    return f"robot {robot['name']}: " + ", ".join(parts)


def _episode(episode: dict[str, Any]) -> str:
    place = ", ".join(f"{1e3 * x:.1f}" for x in episode["deepest"]["proxy_m"])
    near = "" if "deepest_along" in episode else f" near ({place}) mm"
    return told(episode | {"near": near}, *EPISODE)


def failed_line(found: dict[str, Any]) -> str:
    """Why the exit code is 1; empty where it is 0."""
    checks = found.get("checks", [])
    broken = [check_text(check) for check in checks if not check["pass"]]
    if broken:
        return "; ".join(broken)
    if checks and found["verdict"] == "not-tested":
        return f"not tested: {NEVER_TOUCHED}"
    return ""


def next_step(found: dict[str, Any]) -> str:
    """What to do after a replay."""
    if not has_touched(found):
        return (
            "replay a session that touches the fixture, and check --units and the session's frame"
        )
    if "checks" not in found:
        return "give limits to hold it against: --robot NAME, --at-most force_max_n=NUMBER"
    if found["verdict"] == "fail":
        return "look at the failed limits: --report DIR draws the session tick by tick"
    return "vfplan stability FIXTURE.h5 --robot NAME says whether the stiffness is safe"


def check_line(check: dict[str, Any]) -> str:
    """One limit, whether it holds, and the value found."""
    word = "pass" if check["pass"] else "FAIL"
    return f"{word}: {check_text(check)}"


def check_text(check: dict[str, Any]) -> str:
    """One limit and the value found."""
    sense = "at_most" if "at_most" in check else "at_least"
    words = sense.replace("_", " ")
    return f"{check['name']} is {check['value']:.6g}, {words} {check[sense]:g} is allowed"
