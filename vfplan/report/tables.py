"""The tables of a report."""

from __future__ import annotations

import re
from html import escape
from typing import Any

from vfplan.fixture import Fixture
from vfplan.replaying.episodes import episode_count

_SUMMARY = (
    # name in the report, words, factor, unit, decimals
    ("duration_s", "duration", 1, "s", 3),
    ("contact_s", "time in contact", 1, "s", 3),
    ("penetration_max_m", "penetration |proxy − HIP|, largest", 1e3, "mm", 3),
    ("penetration_rms_m", "penetration, RMS over the session", 1e3, "mm", 3),
    ("overlap_max_m", "overlap beyond the cloud's surface, largest", 1e3, "mm", 3),
    ("force_max_n", "force, largest", 1, "N", 3),
    ("force_rms_n", "force, RMS over the session", 1, "N", 3),
    ("force_step_max_n", "change of force in one tick, largest", 1, "N", 3),
    ("clearance_min_m", "clearance of the proxy's ball, least", 1e6, "µm", 2),
    ("energy_j", "energy given to the hand", 1e3, "mJ", 4),
    ("energy_hold_j", "of it by holding the force over a tick", 1e3, "mJ", 4),
    ("friction", "apparent friction", 1, "", 5),
    ("lag_rms_m", "lag of the proxy while sliding, RMS", 1e6, "µm", 2),
    ("lateral_max_m", "distance from the guide, largest", 1e3, "mm", 3),
    ("entrenched_ticks", "ticks entrenched", 1, "", 0),
    ("too_fast_ticks", "ticks too fast for the rule", 1, "", 0),
)
_EPISODE = (
    ("start_s", "start", 1, "s", 3),
    ("end_s", "end", 1, "s", 3),
    ("dwell_s", "dwell", 1, "s", 3),
    ("penetration_max_m", "deepest", 1e3, "mm", 3),
    ("overlap_max_m", "overlap", 1e3, "mm", 3),
    ("force_max_n", "force", 1, "N", 3),
    ("energy_j", "energy", 1e3, "mJ", 4),
    ("speed_at_touch_m_s", "touch", 1e3, "mm/s", 1),
)
EPISODES = 200


def _number(value: Any, factor: float, decimals: int) -> str:
    # Adding 0 after rounding turns -0.0 into 0.0.
    return "" if value is None else f"{round(factor * value, decimals) + 0.0:.{decimals}f}"


def table(head: list[str], rows: list[list[str]], kind: str = "") -> str:
    """A table of cells that are HTML already."""
    heads = "".join(f"<th>{cell}</th>" for cell in head)
    lines = "".join("<tr>" + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for row in rows)
    thead = f"<thead><tr>{heads}</tr></thead>" if head else ""
    return f'<table class="{kind}">{thead}<tbody>{lines}</tbody></table>'


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, list):
        return ", ".join(_shown(part) for part in value)
    return str(value)


def _code(value: Any) -> str:
    text = _shown(value)
    kind = "digest" if re.fullmatch("[0-9a-f]{64}", text) else ""  # one line in print
    return f'<code class="{kind}">{escape(text)}</code>'


def summary(found: dict[str, Any]) -> str:
    """The main numbers; with two rules a column each."""
    columns = [found] if "paper" not in found else [found, found["paper"]]
    names = ["robust", "paper"] if len(columns) == 2 else [escape(found["rule"])]
    rows = []
    for key, words, factor, unit, decimals in _SUMMARY:
        if key in found:
            values = [_number(column.get(key), factor, decimals) for column in columns]
            rows.append([escape(words), *values, unit])
    times = [column["step_us"] for column in columns]
    rows.append(["time a tick, p99.9", *(f"{t['p999']:.2f}" for t in times), "µs"])
    return table(["", *(f"rule {name}" for name in names), ""], rows, "numbers")


def checks(found: dict[str, Any]) -> str:
    """Each limit that was given, and whether it holds."""
    rows = []
    for check in found.get("checks", []):
        sense = "at_most" if "at_most" in check else "at_least"
        word = "pass" if check["pass"] else "fail"
        rows.append(
            [
                f'<b class="{word}">{word.upper()}</b>',
                escape(check["name"]),
                f"{check['value']:.6g}",
                f"{sense.replace('_', ' ')} {check[sense]:g}",
            ]
        )
    return table(["", "limit on", "found", "allowed"], rows) if rows else ""


def findings(found: dict[str, Any]) -> str:
    """What a person should look at."""
    rows = [
        [f'<b class="{f["severity"]}">{f["severity"]}</b>', f["code"], escape(f["message"])]
        for f in found["findings"]
    ]
    return table(["", "finding", ""], rows) if rows else "<p>Nothing to remark.</p>"


def episodes(found: dict[str, Any]) -> str:
    """One row an episode; a click moves the scrubber to its deepest tick."""
    shown = found["episodes"][:EPISODES]
    if not shown:
        return "<p>No contact.</p>"
    along = any("deepest_along" in episode for episode in shown)
    head = ["", *(f"{words} [{unit}]" for _, words, _, unit, _ in _EPISODE)]
    head += (["along [mm]"] if along else []) + ["passive"]
    rows = []
    for episode in shown:
        time = episode["deepest"]["t_s"]
        row = [f'<button class="go" data-time="{time!r}">{episode["index"]}</button>']
        row += [_number(episode.get(key), f, d) for key, _, f, _, d in _EPISODE]
        if along:
            row.append(_number(episode["deepest_along"]["s_m"], 1e3, 1))
        rows.append([*row, "yes" if episode["passive"] else '<b class="warning">no</b>'])
    more = episode_count(found) - len(shown)
    return table(head, rows, "numbers") + (f"<p>and {more} more</p>" if more else "")


def settings(found: dict[str, Any], fixture: Fixture) -> str:
    """Provenance and settings, by their names in the JSON report."""
    groups: dict[str, Any] = {
        name: found[name]
        for name in ("fixture", "scene", "session", "link", "robot", "left_out")
        if found.get(name)
    }
    born = fixture.provenance
    groups["provenance"] = {
        "created_utc": born.created_utc,
        "software": born.software,
        **{f"input {role}": digest for role, digest in born.inputs.items()},
        **{f"setting {name}": value for name, value in born.settings.items()},
    }
    text = ""
    for group, values in groups.items():
        flat = {k: v for k, v in values.items() if not isinstance(v, (dict, list)) or len(v) <= 3}
        rows = [[escape(str(k)), _code(v)] for k, v in flat.items() if v is not None]
        shown = f"<h3>{escape(group.replace('_', ' '))}</h3>" + table([], rows, "settings")
        text += f'<div class="{"long" if len(rows) > 20 else "group"}">{shown}</div>'
    return text
