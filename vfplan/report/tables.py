"""The tables of a report."""

from __future__ import annotations

import re
from html import escape
from typing import Any, NamedTuple

from vfplan.display import MAX_LISTED
from vfplan.fixture import Fixture
from vfplan.replaying.metrics import episode_count


class Quantity(NamedTuple):
    """A number of the JSON report: its name there, and how a table writes it."""

    name: str
    words: str
    factor: float
    unit: str
    decimals: int


SUMMARY = (
    Quantity("duration_s", "duration", 1, "s", 3),
    Quantity("contact_s", "time in contact", 1, "s", 3),
    Quantity("contact_episodes", "contact episodes", 1, "", 0),
    Quantity("penetration_max_m", "penetration |proxy − HIP|, largest", 1e3, "mm", 3),
    Quantity("penetration_rms_m", "penetration, RMS over the session", 1e3, "mm", 3),
    Quantity("overlap_max_m", "overlap beyond the fixture's surface, largest", 1e3, "mm", 3),
    Quantity("force_max_n", "force, largest", 1, "N", 3),
    Quantity("force_rms_n", "force, RMS over the session", 1, "N", 3),
    Quantity("force_step_max_n", "change of force in one tick, largest", 1, "N", 3),
    Quantity("clearance_min_m", "clearance of the proxy's ball, least", 1e6, "µm", 2),
    Quantity("band_m", "band: the clearance may go down to minus this", 1e6, "µm", 2),
    Quantity("energy_j", "energy given to the hand", 1e3, "mJ", 4),
    Quantity("energy_hold_j", "of it by holding the force over a tick", 1e3, "mJ", 4),
    Quantity("friction", "apparent friction", 1, "", 5),
    Quantity("lag_rms_m", "lag of the proxy while sliding, RMS", 1e6, "µm", 2),
    Quantity("lateral_max_m", "distance from the guide, largest", 1e3, "mm", 3),
    Quantity("entrenched_ticks", "ticks entrenched", 1, "", 0),
    Quantity("too_fast_ticks", "ticks too fast for the rule", 1, "", 0),
    Quantity("p999", "time a tick, p99.9", 1, "µs", 2),
)
EPISODE = (
    Quantity("start_s", "start", 1, "s", 3),
    Quantity("end_s", "end", 1, "s", 3),
    Quantity("dwell_s", "dwell", 1, "s", 3),
    Quantity("penetration_max_m", "deepest", 1e3, "mm", 3),
    Quantity("overlap_max_m", "overlap", 1e3, "mm", 3),
    Quantity("force_max_n", "force", 1, "N", 3),
    Quantity("energy_j", "energy", 1e3, "mJ", 4),
    Quantity("speed_at_touch_m_s", "touch", 1e3, "mm/s", 1),
)

UNITS = {
    "_m_s": "m/s",
    "_n_per_m": "N/m",
    "_deg": "°",
    "_ticks": "ticks",
    "_tick": "tick",
    "_hz": "Hz",
    "_us": "µs",
    "_mm": "mm",
    "_nm": "N·m",
    "_j": "J",
    "_n": "N",
    "_s": "s",
    "_m": "m",
}
"""The last words of a number's name and their unit, the longest first."""


def table(head: list[str], rows: list[list[str]], kind: str = "") -> str:
    """A table of cells that are HTML already; a narrow screen shows each with its column's name."""
    parts = [f'<table class="{kind}">']
    if head:
        parts.append("<thead><tr>")
        for cell in head:
            parts.append(f'<th scope="col">{cell}</th>')
        parts.append("</tr></thead>")
    parts.append("<tbody>")
    for row in rows:
        parts.append("<tr>")
        for column, cell in enumerate(row):
            name = f' data-name="{head[column]}"' if column < len(head) and head[column] else ""
            parts.append(f"<td{name}>{cell}</td>")
        parts.append("</tr>")
    parts.append("</tbody></table>")
    return "".join(parts)


def code(value: Any) -> str:
    """A value as it stands in a file; a digest on one line in print."""
    text = _text(value)
    kind = "digest" if re.fullmatch("[0-9a-f]{64}", text) else ""
    return f'<code class="{kind}">{escape(text)}</code>'


def _text(value: Any) -> str:
    if value is True:
        return "yes"
    if value is False:
        return "no"
    if isinstance(value, float):
        return f"{value:.9g}"
    return ", ".join(map(_text, value)) if isinstance(value, list) else str(value)


def _number(value: float | None, quantity: Quantity) -> str:
    """A number in the unit of its quantity; nothing if there is none."""
    if value is None:
        return ""
    # Adding 0 after rounding turns -0.0 into 0.0.
    number = round(quantity.factor * value, quantity.decimals) + 0.0
    return f"{number:.{quantity.decimals}f}"


def summary(metrics: dict[str, Any]) -> str:
    """The main numbers; two rules are compared, a column each and one of their difference."""
    rules = {escape(metrics["rule"]): metrics}
    if "paper" in metrics:
        rules["paper"] = metrics["paper"]
    columns = []
    for rule in rules.values():
        more = {
            "band_m": rule["scene"].get("band_m"),
            "contact_episodes": episode_count(rule),
            "p999": rule["step_us"]["p999"],
        }
        columns.append(rule | more)
    head = ["number", *(f"rule {name}" for name in rules)]
    if len(rules) == 2:
        head.append(f"paper − {next(iter(rules))}")
    head.append("unit")
    rows = []
    for quantity in SUMMARY:
        values = [column.get(quantity.name) for column in columns]
        if values == [None] * len(values):
            continue
        if len(values) == 2:
            difference = values[1] - values[0] if None not in values else None
            values.append(difference)
        numbers = [_number(value, quantity) for value in values]
        rows.append([escape(quantity.words), *numbers, quantity.unit])
    text = table(head, rows, "numbers")
    if len(rules) == 2:
        difference = metrics["apart"]
        text += (
            "<p>The proxies of the two rules are at most "
            f"{1e3 * difference['proxy_max_m']:.3f} mm apart, their forces "
            f"{difference['force_max_n']:.3f} N.</p>"
        )
    return text


def checks(metrics: dict[str, Any]) -> str:
    """Each limit that was given, and whether it holds."""
    rows = []
    for check in metrics.get("checks", []):
        sense, word = "at_least", "fail"
        if "at_most" in check:
            sense = "at_most"
        if check["pass"]:
            word = "pass"
        rows.append(
            [
                f'<b class="{word}">{word.upper()}</b>',
                escape(check["name"]),
                f"{check['value']:.6g}",
                f"{sense.replace('_', ' ')} {check[sense]:g}",
                unit_of(check["name"]),
            ]
        )
    return "" if not rows else table(["verdict", "limit on", "found", "allowed", "unit"], rows)


def unit_of(name: str) -> str:
    """The unit that a number's name in the JSON report ends with."""
    for ending, unit in UNITS.items():
        if name.endswith(ending):
            return unit
    return ""


def findings(metrics: dict[str, Any]) -> str:
    """What a person should look at."""
    rows = []
    for finding in metrics["findings"]:
        severity = f'<b class="{finding["severity"]}">{finding["severity"]}</b>'
        rows.append([severity, finding["code"], escape(finding["message"])])
    if not rows:
        return "<p>Nothing to remark.</p>"
    return table(["severity", "finding", "what it says"], rows)


def episodes(metrics: dict[str, Any]) -> str:
    """One row an episode; a click moves the scrubber to its deepest tick."""
    listed = metrics["episodes"]
    if not listed:
        return "<p>No contact.</p>"
    has_curve = "deepest_along" in listed[0]
    head = ["episode"]
    for quantity in EPISODE:
        head.append(f"{quantity.words} [{quantity.unit}]")
    if has_curve:
        head.append("along [mm]")
    head.append("passive")
    rows = []
    for number, episode in enumerate(listed):
        time = episode["deepest"]["t_s"]
        row = [
            f'<button class="go" data-time="{time!r}" data-episode="{number}" '
            f'aria-label="show episode {episode["index"]}">{episode["index"]}</button>'
        ]
        for quantity in EPISODE:
            row.append(_number(episode.get(quantity.name), quantity))
        if has_curve:
            row.append(f"{1e3 * episode['deepest_along']['s_m']:.1f}")
        passive = "yes" if episode["passive"] else '<b class="warning">no</b>'
        rows.append([*row, passive])
    text = table(head, rows, "numbers")
    more = episode_count(metrics) - len(listed)
    if more:
        text += f"<p>and {more} more</p>"
    return text


def settings(metrics: dict[str, Any], fixture: Fixture) -> str:
    """Provenance and settings, by their names in the JSON report."""
    groups: dict[str, Any] = {}
    for name in ("fixture", "scene", "session", "link", "robot", "left_out"):
        if metrics.get(name):
            groups[name] = metrics[name]
    provenance = fixture.provenance
    groups["provenance"] = {"created_utc": provenance.created_utc, "software": provenance.software}
    for name, value in provenance.settings.items():
        groups["provenance"][f"setting {name}"] = value
    for role, digest in provenance.inputs.items():
        groups["provenance"][f"input {role}"] = digest
    text = ""
    for group, values in groups.items():
        rows = []
        for name, value in values.items():
            is_large = isinstance(value, (dict, list)) and len(value) > 3
            if value is not None and not is_large:
                rows.append([escape(str(name)), code(value)])
        # A long group takes the whole width of the page.
        kind = "long" if len(rows) > MAX_LISTED else "group"
        heading = escape(group.replace("_", " "))
        text += f'<div class="{kind}"><h3>{heading}</h3>{table([], rows, "settings")}</div>'
    return text
