"""The page about a rehearsal: verdict, numbers, the arm over the fixture, its forces over time."""

from __future__ import annotations

from html import escape
from typing import Any

from vfplan.arm import Rehearsal
from vfplan.arm.figures import draw_forces, draw_in_space
from vfplan.report.page import document, facts_table, picture, section
from vfplan.report.tables import table


def page(rehearsal: Rehearsal, facts: dict[str, str]) -> str:
    """The HTML text of the page; `facts` stand at its head: the command line, files, digests."""
    metrics = rehearsal.metrics
    if rehearsal.passed:
        verdict = '<p class="verdict pass">PASS: every place is reached, nothing stops the arm</p>'
    elif not metrics["reachable"]:
        verdict = '<p class="verdict fail">FAIL: the arm does not reach every place</p>'
    else:
        verdict = '<p class="verdict fail">FAIL: the arm would stop</p>'
    title = f"Rehearsal of {escape(rehearsal.session.name)} on {escape(rehearsal.arm.name)}"
    in_space = picture(draw_in_space(rehearsal), "arm, fixture and the tip's path", "tall")
    over_time = picture(draw_forces(rehearsal), "force, torques and joints", "tall")
    parts = [
        f"<header><h1>{title}</h1>{verdict}</header>",
        facts_table(facts | {"session": rehearsal.session.name, "arm": rehearsal.arm.name}),
        section("What would stop the arm", stops_table(metrics)),
        section("In space", in_space),
        section("Over time", over_time),
        section("Numbers", numbers_table(metrics)),
    ]
    return document(title, "\n".join(parts))


def stops_table(metrics: dict[str, Any]) -> str:
    """Each limit that was crossed and each place out of reach, a row each."""
    rows = []
    for stop in metrics["reflexes"]:
        value = ""
        limit = ""
        along = ""
        if "value" in stop:
            value = f"{stop['value']:.4g}"
        if "limit" in stop:
            limit = f"{stop['limit']:g}"
        if "s_m" in stop:
            along = f"{1e3 * stop['s_m']:.1f}"
        joint = str(stop.get("joint", ""))
        rows.append([str(stop["tick"]), escape(stop["kind"]), joint, value, limit, along])
    for place in metrics.get("unreached", []):
        short = f"{1e3 * place['left_m']:.1f} mm short"
        rows.append([str(place["tick"]), "not reached", "", short, "", ""])
    if not rows:
        return "<p>Nothing.</p>"
    return table(["tick", "what", "joint", "value", "limit", "along the curve [mm]"], rows)


def numbers_table(metrics: dict[str, Any]) -> str:
    """The numbers of the report, a row each."""
    flat = dict(metrics)
    for name, value in metrics.get("governor", {}).items():
        flat[f"governor.{name}"] = value
    rows = []
    for name, value in flat.items():
        if isinstance(value, float):
            rows.append([escape(name), f"{value:.6g}"])
        elif isinstance(value, (int, str)):
            rows.append([escape(name), escape(str(value))])
    return table(["number", "value"], rows)
