"""The tables of a report."""

from __future__ import annotations

import re
from html import escape
from itertools import zip_longest
from typing import Any

from vfplan.display import MAX_LISTED, count, millimetres
from vfplan.fixture import Fixture
from vfplan.replaying.findings import open_words, untested_reason
from vfplan.replaying.metrics import NUMBERS, episode_count, unit_of


def table(head: list[str], rows: list[list[str]], kind: str = "") -> str:
    """A table of cells that are HTML already; a narrow screen shows each with its column's name."""
    text = "".join(f'<th scope="col">{cell}</th>' for cell in head)
    text = f"<thead><tr>{text}</tr></thead>" if head else ""
    names = [f' data-name="{name}"' if name else "" for name in head]
    lines = [
        "".join(f"<td{name}>{cell}</td>" for name, cell in zip_longest(names, row, fillvalue=""))
        for row in rows
    ]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f'<table class="{kind}">{text}<tbody>{body}</tbody></table>'


def verdict_sentence(metrics: dict[str, Any]) -> str:
    """How far the tool went beyond the line, then the limits that were asked, and what is open."""
    limits = metrics.get("checks", [])
    asked = ", ".join(f"{limit['name']} {bound_text(limit)}" for limit in limits)
    if metrics["verdict"] == "fail":
        failed = sum(not limit["pass"] for limit in limits)
        words = f"{failed} of {count(len(limits), 'limit')} broken: {asked}"
    elif metrics["verdict"] == "pass":
        words = f"{count(len(limits), 'limit')} asked and held: {asked}{open_words(metrics)}"
    else:
        words = untested_reason(metrics) or "no limits were given"
    return f"{beyond_words(metrics)}; {words}"


def beyond_words(metrics: dict[str, Any]) -> str:
    """How far the tool went beyond what was drawn, or from a guide's line."""
    scene = metrics["scene"]
    if "guide" in metrics and "region_force_max_n" not in metrics["guide"]:
        return f"up to {millimetres(metrics['lateral_max_m'], 2)} from the guide's line"
    drawn = "the drawn line" if scene["planar"] else "the points"
    if "triangles" in scene:
        drawn = "the surface"
    if "start_depth_m" in metrics:
        return f"began {millimetres(metrics['start_depth_m'], 2)} inside {drawn}"
    beyond_m = metrics.get("overlap_max_m", 0.0)
    return (
        f"up to {millimetres(beyond_m, 2)} beyond {drawn}" if beyond_m else f"never beyond {drawn}"
    )


def bound_text(check: dict[str, Any]) -> str:
    """The bound of a limit, such as "at most 20 N"."""
    sense = "at_most" if "at_most" in check else "at_least"
    unit = unit_of(check["name"])
    unit = "" if unit.startswith("tick") else f" {unit}".rstrip()
    return f"{sense.replace('_', ' ')} {check[sense]:g}{unit}"


def identity(fixture: Fixture) -> str:
    """The case, who approved the plan, and which findings nobody answered; as HTML."""
    words = [f"Case {fixture.case}" if fixture.case else "Of no named case"]
    reviewed = fixture.reviewed
    words.append(f"approved by {reviewed.by}, {reviewed.utc}" if reviewed else "approved by nobody")
    unanswered = ", ".join(finding.code for finding in fixture.open_findings)
    words.append(f"nobody answered: {unanswered}" if unanswered else "no finding is unanswered")
    return f"<p>{escape('; '.join(words))}.</p>"


def code(value: Any) -> str:
    """A value as it stands in a file; a digest on one line in print."""
    text = _text(value)
    kind = "digest" if re.fullmatch("[0-9a-f]{64}", text) else ""
    return f'<code class="{kind}">{escape(text)}</code>'


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return str(value)


def summary(metrics: dict[str, Any]) -> str:
    """The main numbers; two rules are compared, a column each and one of their difference."""
    rules = {escape(metrics["rule"]): metrics}
    if "paper" in metrics:
        rules["paper"] = metrics["paper"]
    columns = [
        {**rule["scene"], **rule, **rule["step_us"], "contact_episodes": episode_count(rule)}
        for rule in rules.values()
    ]
    difference = [f"paper − {next(iter(rules))}"] if len(rules) == 2 else []
    head = ["number", *(f"rule {name}" for name in rules), *difference, "unit"]
    rows = []
    # How far beyond the line comes first.
    for number in sorted(NUMBERS, key=lambda number: number.key != "overlap_max_m"):
        values = [column.get(number.key) for column in columns]
        if not number.label or values == [None] * len(values):
            continue
        if len(values) == 2:
            values.append(values[1] - values[0] if None not in values else None)
        rows.append([escape(number.label), *map(number.text, values), number.unit])
    text = table(head, rows, "numbers")
    if len(rules) == 2:
        apart = metrics["apart"]
        text += (
            f"<p>The proxies of the two rules are at most {millimetres(apart['proxy_max_m'])} "
            f"apart, their forces {apart['force_max_n']:.3f} N.</p>"
        )
    return text


def checks(metrics: dict[str, Any]) -> str:
    """Each limit that was given, and whether it holds."""
    rows = []
    for check in metrics.get("checks", []):
        word = "pass" if check["pass"] else "fail"
        verdict = f'<b class="{word}">{word.upper()}</b>'
        name, unit = check["name"], unit_of(check["name"])
        allowed = bound_text(check).removesuffix(f" {unit}")
        rows.append([verdict, escape(name), f"{check['value']:.6g}", allowed, unit])
    if not rows:
        return ""
    return table(["verdict", "limit on", "found", "allowed", "unit"], rows)


def findings(metrics: dict[str, Any]) -> str:
    """What a person should look at."""
    rows = [
        [f'<b class="{finding["severity"]}">{finding["severity"]}</b>', finding["code"],
         escape(finding["message"])]
        for finding in metrics["findings"]
    ]  # fmt: skip
    if not rows:
        return "<p>Nothing to remark.</p>"
    return table(["severity", "finding", "what it says"], rows)


def episodes(metrics: dict[str, Any]) -> str:
    """One row an episode; a click moves the scrubber to its deepest tick."""
    listed = metrics["episodes"]
    if not listed:
        return "<p>No contact.</p>"
    has_curve = "deepest_along" in listed[0]
    numbers = [number for number in NUMBERS if number.column]
    head = ["episode", *(f"{number.column} [{number.unit}]" for number in numbers)]
    head += ["along [mm]", "passive"] if has_curve else ["passive"]
    rows = []
    for row, episode in enumerate(listed):
        time = episode["deepest"]["t_s"]
        button = (
            f'<button class="go" data-time="{time!r}" data-episode="{row}" '
            f'aria-label="show episode {episode["index"]}">{episode["index"]}</button>'
        )
        cells = [number.text(episode.get(number.key)) for number in numbers]
        if has_curve:
            cells.append(f"{1e3 * episode['deepest_along']['s_m']:.1f}")
        passive = "yes" if episode["passive"] else '<b class="warning">no</b>'
        rows.append([button, *cells, passive])
    text = table(head, rows, "numbers")
    more = episode_count(metrics) - len(listed)
    return f"{text}<p>and {more} more</p>" if more else text


def settings(metrics: dict[str, Any], fixture: Fixture) -> str:
    """Provenance and settings, by their names in the JSON report."""
    names = ("fixture", "scene", "session", "link", "robot", "left_out")
    groups = {name: metrics[name] for name in names if metrics.get(name)}
    provenance = fixture.provenance
    groups["provenance"] = {
        "created_utc": provenance.created_utc,
        "software": provenance.software,
        **{f"setting {name}": value for name, value in provenance.settings.items()},
        **{f"input {role}": digest for role, digest in provenance.inputs.items()},
    }
    text = ""
    for group, values in groups.items():
        rows = [
            [escape(str(name)), code(value)]
            for name, value in values.items()
            if value is not None and not (isinstance(value, (dict, list)) and len(value) > 3)
        ]
        # A long group takes the whole width of the page.
        kind = "long" if len(rows) > MAX_LISTED else "group"
        heading = escape(group.replace("_", " "))
        text += f'<div class="{kind}"><h3>{heading}</h3>{table([], rows, "settings")}</div>'
    return text
