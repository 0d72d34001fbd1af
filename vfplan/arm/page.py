"""The page about a rehearsal: verdict, numbers, the arm over the fixture, its efforts over time."""

from __future__ import annotations

from html import escape
from typing import Any

from vfplan.arm import Rehearsal
from vfplan.arm.figures import draw_in_space, efforts
from vfplan.report.page import about, document, picture, section
from vfplan.report.tables import table


def page(rehearsal: Rehearsal, facts: dict[str, str]) -> str:
    """The HTML text of the page; `facts` stand at its head: the command line, files, digests."""
    found = rehearsal.metrics
    title = f"Rehearsal of {escape(rehearsal.session.name)} on {escape(rehearsal.arm.name)}"
    parts = [
        f"<header><h1>{title}</h1>{_verdict(rehearsal)}</header>",
        about(facts | {"session": rehearsal.session.name, "arm": rehearsal.arm.name}),
        section("What the arm said", _reflexes(found)),
        section(
            "In space", picture(draw_in_space(rehearsal), "arm, fixture and the tip's path", "tall")
        ),
        section("Over time", picture(efforts(rehearsal), "force, torques and joints", "tall")),
        section("Numbers", _numbers(found)),
    ]
    return document(title, "\n".join(parts))


def _verdict(rehearsal: Rehearsal) -> str:
    if rehearsal.passed:
        return '<p class="verdict pass">PASS: every place is reached, nothing stops the arm</p>'
    found = rehearsal.metrics
    why = "the arm does not reach every place" if not found["reachable"] else "the arm would stop"
    return f'<p class="verdict fail">FAIL: {why}</p>'


def _reflexes(found: dict[str, Any]) -> str:
    rows = [
        [
            f"{reflex['tick']}",
            escape(reflex["kind"]),
            str(reflex.get("joint", "")),
            f"{reflex['value']:.4g}" if "value" in reflex else "",
            f"{reflex['limit']:g}" if "limit" in reflex else "",
            f"{1e3 * reflex['s_m']:.1f}" if "s_m" in reflex else "",
        ]
        for reflex in found["reflexes"]
    ]
    rows += [
        [f"{place['tick']}", "not reached", "", f"{1e3 * place['left_m']:.1f} mm short", "", ""]
        for place in found.get("unreached", [])
    ]
    if not rows:
        return "<p>Nothing.</p>"
    return table(["tick", "what", "joint", "value", "limit", "along the curve [mm]"], rows)


def _numbers(found: dict[str, Any]) -> str:
    flat = {k: v for k, v in found.items() if isinstance(v, (int, float, str, bool))}
    flat |= {f"governor.{k}": v for k, v in found.get("governor", {}).items()}
    shown = [[escape(k), f"{v:.6g}" if isinstance(v, float) else escape(str(v))]
             for k, v in flat.items()]  # fmt: skip
    return table(["number", "value"], shown)
