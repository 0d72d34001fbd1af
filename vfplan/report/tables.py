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
    ("contact_episodes", "contact episodes", 1, "", 0),
    ("penetration_max_m", "penetration |proxy − HIP|, largest", 1e3, "mm", 3),
    ("penetration_rms_m", "penetration, RMS over the session", 1e3, "mm", 3),
    ("overlap_max_m", "overlap beyond the fixture's surface, largest", 1e3, "mm", 3),
    ("force_max_n", "force, largest", 1, "N", 3),
    ("force_rms_n", "force, RMS over the session", 1, "N", 3),
    ("force_step_max_n", "change of force in one tick, largest", 1, "N", 3),
    ("clearance_min_m", "clearance of the proxy's ball, least", 1e6, "µm", 2),
    ("band_m", "band: the clearance may go down to minus this", 1e6, "µm", 2),
    ("energy_j", "energy given to the hand", 1e3, "mJ", 4),
    ("energy_hold_j", "of it by holding the force over a tick", 1e3, "mJ", 4),
    ("friction", "apparent friction", 1, "", 5),
    ("lag_rms_m", "lag of the proxy while sliding, RMS", 1e6, "µm", 2),
    ("lateral_max_m", "distance from the guide, largest", 1e3, "mm", 3),
    ("entrenched_ticks", "ticks entrenched", 1, "", 0),
    ("too_fast_ticks", "ticks too fast for the rule", 1, "", 0),
    ("p999", "time a tick, p99.9", 1, "µs", 2),
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
# The last words of a number's name, the longest first.
_UNITS = {"_m_s": "m/s", "_n_per_m": "N/m", "_deg": "°", "_ticks": "ticks", "_tick": "tick",
          "_hz": "Hz", "_us": "µs", "_mm": "mm", "_nm": "N·m", "_j": "J", "_n": "N", "_s": "s",
          "_m": "m"}  # fmt: skip
EPISODES = 200


def _number(value: Any, factor: float, decimals: int) -> str:
    # Adding 0 after rounding turns -0.0 into 0.0.
    return "" if value is None else f"{round(factor * value, decimals) + 0.0:.{decimals}f}"


def table(head: list[str], rows: list[list[str]], kind: str = "") -> str:
    """A table of cells that are HTML already; a narrow screen shows each with its column's name."""
    heads = "".join(f'<th scope="col">{cell}</th>' for cell in head)
    names = [f' data-name="{cell}"' if cell else "" for cell in head] or [""] * 99
    lines = "".join(
        "<tr>" + "".join(f"<td{n}>{c}</td>" for n, c in zip(names, row, strict=False)) + "</tr>"
        for row in rows
    )
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


def code(value: Any) -> str:
    """A value as it stands in a file; a digest on one line in print."""
    text = _shown(value)
    kind = "digest" if re.fullmatch("[0-9a-f]{64}", text) else ""
    return f'<code class="{kind}">{escape(text)}</code>'


def summary(found: dict[str, Any]) -> str:
    """The main numbers; two rules are compared, a column each and one of their difference."""
    rules = [found] if "paper" not in found else [found, found["paper"]]
    names = [escape(found["rule"]), "paper"][: len(rules)]
    columns = [
        {**rule, "band_m": rule["scene"].get("band_m"), "contact_episodes": episode_count(rule),
         "p999": rule["step_us"]["p999"]}
        for rule in rules
    ]  # fmt: skip
    rows = []
    for key, words, factor, unit, decimals in _SUMMARY:
        values = [column.get(key) for column in columns]
        if any(value is not None for value in values):
            if len(values) == 2:
                values.append(None if None in values else values[1] - values[0])
            rows.append([escape(words), *(_number(v, factor, decimals) for v in values), unit])
    heads = [f"rule {name}" for name in names] + [f"paper − {names[0]}"] * (len(names) == 2)
    apart = ""
    if len(names) == 2:
        apart = (f"<p>The proxies of the two rules are at most "
                 f"{1e3 * found['apart']['proxy_max_m']:.3f} mm apart, their forces "
                 f"{found['apart']['force_max_n']:.3f} N.</p>")  # fmt: skip
    return table(["number", *heads, "unit"], rows, "numbers") + apart


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
                unit_of(check["name"]),
            ]
        )
    return table(["verdict", "limit on", "found", "allowed", "unit"], rows) if rows else ""


def unit_of(name: str) -> str:
    """The unit that a number's name in the JSON report ends with."""
    return next((unit for end, unit in _UNITS.items() if name.endswith(end)), "")


def findings(found: dict[str, Any]) -> str:
    """What a person should look at."""
    rows = [
        [f'<b class="{f["severity"]}">{f["severity"]}</b>', f["code"], escape(f["message"])]
        for f in found["findings"]
    ]
    if not rows:
        return "<p>Nothing to remark.</p>"
    return table(["severity", "finding", "what it says"], rows)


def episodes(found: dict[str, Any]) -> str:
    """One row an episode; a click moves the scrubber to its deepest tick."""
    shown = found["episodes"][:EPISODES]
    if not shown:
        return "<p>No contact.</p>"
    along = any("deepest_along" in episode for episode in shown)
    head = ["episode", *(f"{words} [{unit}]" for _, words, _, unit, _ in _EPISODE)]
    head += (["along [mm]"] if along else []) + ["passive"]
    rows = []
    for number, episode in enumerate(shown):
        time = episode["deepest"]["t_s"]
        row = [
            f'<button class="go" data-time="{time!r}" data-episode="{number}" '
            f'aria-label="show episode {episode["index"]}">{episode["index"]}</button>'
        ]
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
        rows = [[escape(str(k)), code(v)] for k, v in flat.items() if v is not None]
        shown = f"<h3>{escape(group.replace('_', ' '))}</h3>" + table([], rows, "settings")
        text += f'<div class="{"long" if len(rows) > 20 else "group"}">{shown}</div>'
    return text
