"""What `vfplan replay` tells a person."""

from __future__ import annotations

from typing import Any

from vfplan.cli.values import mm

from vfplan.replaying.checks import LIMITS
from vfplan.replaying.episodes import episode_count

EPISODES = 20  # listed; --json has all


def replay_text(found: dict[str, Any]) -> str:
    """The short report."""
    lines = [_head(found), *_numbers(found)]
    if "paper" in found:
        lines += ["rule paper, side by side:", *("  " + text for text in _numbers(found["paper"]))]
        lines.append(_apart("the rules", found["apart"]))
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
    session = found["session"]
    engine = "" if found["engine"] == "native" else f" ({found['engine']} engine)"
    return (
        f"rule {found['rule']}{engine}: {found['ticks']} ticks at {session['rate_hz']:.6g} Hz, "
        f"{found['duration_s']:.3f} s, {found['contact_ticks']} in contact, "
        f"{episode_count(found)} episodes"
    )


def _numbers(found: dict[str, Any]) -> list[str]:
    lines = [
        f"penetration  max {mm(found['penetration_max_m'])}, "
        f"rms {mm(found['penetration_rms_m'])}"
        + (f"; overlap max {mm(found['overlap_max_m'])}" if "overlap_max_m" in found else ""),
        f"force        max {found['force_max_n']:.3f} N, rms {found['force_rms_n']:.3f} N, "
        f"step max {found['force_step_max_n']:.3f} N",
        *_clearance(found),
        f"energy       {1e3 * found['energy_j']:.4f} mJ net given to the hand; holding each force "
        f"for a tick alone gives {1e3 * found['energy_hold_j']:.4f} mJ",
    ]
    if "friction" in found:
        friction = round(found["friction"], 5) + 0.0
        lines.append(
            f"sliding      {mm(found['slide_m'])}, apparent friction {friction:.5f}, "
            f"lag rms {1e6 * found['lag_rms_m']:.2f} µm"
        )
    if "guide" in found:
        lines.append(_guide(found))
    if "exchanges" in found:
        lines.append(_changes(found))
    if "governor" in found:
        lines.append(_governor(found["governor"]))
    times = found["step_us"]
    lines.append(
        f"time a tick  {times['median']:.2f} µs median, {times['p999']:.2f} µs p99.9, "
        f"{times['max']:.2f} µs max; all of it {found['real_time_factor']:.0f} times real time"
    )
    return lines


def _changes(found: dict[str, Any]) -> str:
    text = (
        f"changes      {found['exchanges']} exchanges, {found['edits']} points edited; "
        f"{found['changing_ticks']} ticks until the force was there"
    )
    if "fixture_energy_j" not in found:
        return text
    return (
        f"{text}\nmotion       gave the hand {1e3 * found['fixture_energy_j']:.4f} mJ besides; "
        f"poses up to {1e3 * found['pose_age_max_s']:.1f} ms old, "
        f"{found['stale_ticks']} ticks stale, {found['poses_refused']} poses refused"
    )


def _clearance(found: dict[str, Any]) -> list[str]:
    if "clearance_min_m" not in found:
        return []
    scene = found["scene"]
    of = f"{scene.get('lines_and_arcs')} lines and arcs"
    if "triangles" in scene:
        of = f"the corners of {scene['triangles']} triangles"
    if "band_m" in scene:
        of = f"band {1e6 * scene['band_m']:.1f} µm"
    return [
        f"clearance    min {round(1e6 * found['clearance_min_m'], 2) + 0.0:.2f} µm ({of}); "
        f"{found['entrenched_ticks']} ticks entrenched"
    ]


def _guide(found: dict[str, Any]) -> str:
    guide = found["guide"]
    if found["arc_m"] is None:
        return "guide        never had hold of the tip"
    first, last = found["arc_m"]
    line = (
        f"guide        tube of {mm(guide['radius_m'])}: lateral max {mm(found['lateral_max_m'])} "
        f"(tick {guide['lateral_max_tick']}), rms {mm(guide['lateral_rms_m'])}; "
        f"arc {1e3 * first:.2f} to {1e3 * last:.2f} mm; outside for {guide['outside_s']:.3f} s, "
        f"force max {guide['force_max_n']:.3f} N, work {1e3 * guide['work_j']:.4f} mJ"
    )
    if "region_force_max_n" in guide:
        line += f"; the region's force max {guide['region_force_max_n']:.3f} N"
    return line


def _apart(who: str, apart: dict[str, Any]) -> str:
    if not apart["span_count"]:
        return f"{who} never part by more than {1e6 * apart['threshold_m']:.0f} µm"
    return (
        f"{who} part {apart['span_count']} times, first at tick {apart['first_tick']} "
        f"({apart['first_s']:.3f} s); at most {mm(apart['proxy_max_m'])} and "
        f"{apart['force_max_n']:.3f} N apart"
    )


def _link(link: dict[str, Any]) -> str:
    names = ("drop", "jitter_s", "delay_ticks", "quantum_m", "seed")
    faults = ", ".join(f"{name} {link[name]:g}" for name in names if name in link)
    perfect = link["perfect"]
    lost = ""
    if "lost" in link:
        lost = f"; {link['lost']} packets lost, {link['lost_longest']} in a row"
    return (
        f"lossy link   {faults}{lost}; over a perfect link: force max "
        f"{perfect['force_max_n']:.3f} N, energy {1e3 * perfect['energy_j']:.4f} mJ; forces differ "
        f"by up to {link['apart']['force_max_n']:.3f} N"
    )


def _governor(found: dict[str, Any]) -> str:
    mj = {name: f"{1e3 * found[name]:.4f}" for name in found if name.endswith("_j")}
    return (
        f"governor     {found['force_step_n']:g} N a tick, {found['force_max_n']:g} N at most: up "
        f"to {found['held_back_max_n']:.3f} N held back in {found['held_ticks']} ticks, of an "
        f"engine that steps by {found['engine_force_step_max_n']:.3f} N; its work {mj['work_j']} "
        f"mJ; a free mass is given {mj['energy_given_j']} of {mj['energy_stored_j']} mJ stored"
    )


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
    along = episode.get("deepest_along")
    if along is None:
        place = ", ".join(f"{1e3 * x:.1f}" for x in episode["deepest"]["proxy_m"])
        place = f" near ({place}) mm"
    else:
        place = f", {1e3 * along['s_m']:.1f} mm along stroke {along['stroke']}"
    return (
        f"  episode {episode['index']}: {episode['start_s']:.3f}-{episode['end_s']:.3f} s, "
        f"up to {mm(episode['penetration_max_m'])} deep{place}, "
        f"up to {episode['force_max_n']:.3f} N"
    )


def check_line(check: dict[str, Any]) -> str:
    """One limit, whether it holds, and the value found."""
    sense = "at_most" if "at_most" in check else "at_least"
    verdict = "pass" if check["pass"] else "FAIL"
    words = sense.replace("_", " ")
    return f"{verdict}: {check['name']} is {check['value']:.6g}, {words} {check[sense]:g} wanted"
