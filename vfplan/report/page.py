"""The page of a replay: verdict, slice and force first, files and hashes last.

Its scrubber and plots get frames, envelopes and the cloud in mm, rounded.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from html import escape
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vfplan.display import MAX_DRAWN, MM, resolved
from vfplan.engine.browser import bodies_of, module, packed
from vfplan.figures.replay import axis_names, guide_plot, plane_basis, scene, slice_depth, timeline
from vfplan.figures.style import WIDTH_PX, png_bytes
from vfplan.fixture import Fixture
from vfplan.geometry.lines import Array
from vfplan.images.read import PlannedImage, read_slice_of
from vfplan.io.files import now_utc
from vfplan.palette import palette_css
from vfplan.replaying.findings import beyond, check_text, guides_alone, limits_n, verdict_sentence
from vfplan.replaying.link import apart_text, link_text
from vfplan.replaying.metrics import NUMBERS, Report, episode_count, row_norms
from vfplan.replaying.replay import Replay, thinned
from vfplan.review.plan import Plan
from vfplan.review.sheet import draw_sheet
from vfplan.session.result import TickBlock

# Number of columns of the whole session's envelope, one for each pixel of the plot's width.
COLUMNS = WIDTH_PX

# How much wider a figure is here than its letters want, which are then as large as the page's.
WIDER = 1.3

# Number of columns of an episode's envelope. It is drawn coarser, to keep the page small.
ZOOM_COLUMNS = COLUMNS // 2

# Number of episodes with an envelope of their own. A page of more would be slow to open.
MAX_ZOOMS = 40

# Parts of a report that tell of a lossy link, a governor, or a fixture that moved or changed.
MORE_THAN_THE_ENGINE = {"link", "governor", "exchanges"}


def placing(fixture: Fixture) -> tuple[Array, Callable[[Array], Array]]:
    """The picture's axes as columns, (3, 2) in a plane or (3, 3), and what takes places there [mm].

    The middle of the fixture's points is 0.
    """
    basis, centre = plane_basis(fixture.ignore_axis), fixture.points.mean(axis=0)
    return basis, lambda places: MM * (places - centre) @ basis


def scene_data(fixture: Fixture) -> Report:
    """What stands still in the scene."""
    basis, placed = placing(fixture)
    step, region = -(-len(fixture.points) // MAX_DRAWN), fixture.region
    return {
        "axes": axis_names(basis),
        "basis": basis.tolist(),
        "centre": fixture.points.mean(axis=0).tolist(),
        "radius": MM * fixture.contact_radius,
        "forbids": region is not None,
        "wall": region
        and region.mesh is None
        and {
            "radius": MM * (region.contact_radius + region.point_radius),
            "points": _flat(placed(region.points[::step]), 3),
        },
        "tube": fixture.guidance
        and {
            "radius": MM * fixture.guidance.radius,
            "cap": {"stop": "round", "open": "butt"}[fixture.guidance.ends],
            "lines": [_flat(placed(line), 3) for line in fixture.guiding_lines],
        },
        "cloud": _flat(placed(fixture.points[::step]), 3),
    }


def scrubber_data(replayed: Replay) -> Report:
    """Frames as flat lists in the picture's axes; the third axis of a planar scene is left out.

    Lengths in mm to 1 µm, times in s, forces in N. Longer sessions show of each stretch the tick
    with the deepest penetration.
    """
    ticks = thinned(replayed.ticks, -(-len(replayed.ticks) // MAX_DRAWN))
    basis, placed = placing(replayed.fixture)
    episodes = replayed.metrics["episodes"]
    drawn, beyond_m = beyond(replayed.metrics, replayed.ticks.overlap)
    every = replace(replayed.ticks, overlap=beyond_m)
    # An envelope of each episode with what is around it, and one of the whole session.
    zooms = []
    for episode in episodes[:MAX_ZOOMS]:
        start, end = episode["start_s"], episode["end_s"]
        margin = max(0.05, 0.2 * (end - start))
        zooms.append(envelope(every, (start - margin, end + margin), ZOOM_COLUMNS))
    zooms.append(envelope(every, every.time[[0, -1]].tolist(), COLUMNS))
    return {
        **scene_data(replayed.fixture),
        "played": played_data(replayed),
        "time": _flat(ticks.time, 6),
        "hip": _flat(placed(ticks.hip), 3),
        "proxy": _flat(placed(ticks.proxy), 3),
        "normal": _flat(ticks.normal @ basis, 3),
        "force": _flat(ticks.force @ basis, 4),
        "depth": _flat(MM * ticks.penetration, 4),
        "state": ticks.state.tolist(),
        "episodes": [
            [episode["start_s"], episode["end_s"], episode["index"] + 1] for episode in episodes
        ],
        "zooms": zooms,
        "deep": f"beyond {drawn}" if beyond_m.any() else "",
        "limits": limits_n(replayed.metrics),
    }


def played_data(replayed: Replay) -> Report | None:
    """What the page's own engine needs to make the session's ticks again, and their SHA-256.

    `None` where ticks were left out, or where more than the engine made them.
    """
    ticks = replayed.ticks
    is_more = not MORE_THAN_THE_ENGINE.isdisjoint(replayed.metrics)
    if is_more or replayed.stride > 1 or replayed.engine != "native":
        return None
    answers = np.hstack([ticks.proxy, ticks.force]).tobytes()
    return {
        "module": packed(module()),
        "bodies": bodies_of(replayed.fixture, replayed.record["rule"]),
        "rows": packed(np.column_stack([ticks.time, ticks.hip]).tobytes()),
        "sha256": hashlib.sha256(answers).hexdigest(),
    }


def envelope(ticks: TickBlock, span: Sequence[float], columns: int) -> Report:
    """Smallest and largest force [N] and depth [mm] of stretches of equal length.

    The depth is the overlap, where there is any.
    """
    depth = ticks.overlap if ticks.overlap.any() else ticks.penetration
    first = np.searchsorted(ticks.time, span[0])
    last = np.searchsorted(ticks.time, span[1], "right")
    starts = np.unique(np.linspace(first, last, columns, endpoint=False).astype(int))
    data = {"span": list(span), "time": _flat(ticks.time[starts], 6)}
    for name, values in (("force", row_norms(ticks.force)), ("depth", MM * depth)):
        for end, extreme in (("low", np.minimum), ("high", np.maximum)):
            data[f"{name}_{end}"] = _flat(extreme.reduceat(values[:last], starts), 4)
    return data


def tick_row(fixture: Fixture) -> Callable[[NDArray[np.void]], list[float]]:
    """How a tick of telemetry goes to the live page.

    t, state, status, HIP, proxy, normal and force in the picture's axes, |F| and |proxy - HIP|.
    """
    basis, placed = placing(fixture)

    def row(tick: NDArray[np.void]) -> list[float]:
        parts = [
            [tick["t"], tick["state"], tick["status"]],
            placed(tick["hip"]),
            placed(tick["proxy"]),
            tick["normal"] @ basis,
            tick["force"] @ basis,
            [np.linalg.norm(tick["force"]), MM * np.linalg.norm(tick["proxy"] - tick["hip"])],
        ]
        return _flat(np.concatenate(parts), 4)

    return row


def _flat(rows: Array, decimals: int) -> list[float]:
    # Adding 0 turns -0.0 into 0.0.
    return (np.round(rows, decimals) + 0.0).ravel().tolist()


# The page may show what it carries and fetch nothing; its own engine is WebAssembly.
POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline' "
    "'wasm-unsafe-eval'"
)
# What a live page may do in addition: listen to the server that it came from.
LIVE_POLICY = "; connect-src 'self'"


def page(replayed: Replay, *, image: Path | None = None, command: str = "") -> str:
    """The HTML text of the report, which needs nothing else.

    Parameters
    ----------
    replayed
        A replay that kept ticks.
    image
        The planned slice, to map depth back onto it.
    command
        The command line that led to it, if one did.

    Raises
    ------
    InputError
        The image is not the one that the fixture was planned on.
    """
    metrics = replayed.metrics
    title = f"Replay of {escape(metrics['session']['name'])}"
    verdict = kind = metrics["verdict"]
    if verdict == "pass" and beyond(metrics, metrics.get("overlap_max_m", 0.0))[1]:
        kind = "beyond"
    # A limit that holds hides no warning.
    told = [f"{f['severity']}: {f['code']}" for f in metrics["findings"] if f["severity"] != "info"]
    words = escape("; ".join([in_words(verdict_sentence(metrics), metrics), *told]))
    line = f'<p class="verdict {kind}">{verdict.replace("-", " ").upper()}: {words}</p>'
    body = [f"<header><h1>{title}</h1>{line}</header>", identity(replayed)]
    if "link" in metrics:
        body.append(f"<p>Replayed over a lossy link: {link_text(metrics['link'])}.</p>")

    # What a reader wants first: where it happened, and with what force.
    planned_slice = None if image is None else read_slice_of(replayed.fixture, image)
    plan = planned(replayed, planned_slice)
    if planned_slice is not None and replayed.fixture.curve is not None:
        on_slice = slice_depth(replayed, planned_slice, plan.outlines)
        # Around the slice the page is seen, light or dark.
        on_slice.set_facecolor("none")
        body.append(section("On the slice", picture(on_slice, "penetration on the slice", "slice")))
    words = "line, wall or tube, paths of tip and proxy, and where they were in contact"
    body += [
        section("In space", picture(scene(replayed), words, "tall")),
        section("Over time", picture(timeline(replayed), "force and penetration over time")),
        section("Summary", summary(metrics) + checks(metrics) + findings(metrics)),
        # Then all of it, to look into.
        section("Frame by frame", scrubber(replayed)),
        section("Contact episodes", episodes(metrics)),
    ]
    if metrics.get("arc_m") is not None:
        words = "distance from the guide's line, and force, along it"
        body.append(section("Along the guide", picture(guide_plot(replayed), words)))
    if plan is not None:
        pages = draw_sheet(plan, "What was planned").page_pngs()
        sheets = (_embedded(png, "review sheet of the fixture", "sheet") for png in pages)
        body.append(section("What was planned", "".join(sheets)))

    # Last what identifies it: settings, files and hashes.
    body.append(section("What was replayed", settings(metrics, replayed.fixture)))
    facts = {"command": command}
    for role in ("fixture", "session"):
        record = metrics.get(role, {})
        facts[role] = record.get("name", "made in memory")
        facts[f"{role}'s SHA-256"] = record.get("sha256", "")
    body.append(facts_table(facts))
    body.append(scripts(scrubber_data(replayed), part("scrubber.js")))
    return document(title, "\n".join(body))


def scrubber(replayed: Replay) -> str:
    """The scene and the plots that move through time."""
    ticks = f"all {replayed.metrics['ticks']} ticks"
    if replayed.stride > 1:
        ticks = f"the ticks kept, of each {replayed.stride} in a row the deepest"
    return part("scrubber.html").replace("{scene}", part("scene.html")).replace("{ticks}", ticks)


def facts_table(facts: dict[str, str]) -> str:
    """When the page was made, by which program, and the facts given; empty ones are left out."""
    made = {"made": now_utc(), "program": f"vfplan {version('vfplan')}"}
    return section("About this page", settings_table(made | facts))


def part(name: str, package: str = "vfplan.report") -> str:
    """The text of a package's file; without a package, of a file beside this one."""
    return (files(package) / name).read_text("utf-8")


def scripts(data: Report, script: str) -> str:
    """The page's data, and what draws it: the common scripts, then the text of its own."""
    # "</" inside the data would end the script element.
    text = json.dumps(data, allow_nan=False).replace("</", "<\\/")
    engine = part("page/engine.js", "vfplan.review").replace("export ", "")
    drawing = engine + "".join(map(part, ("canvas.js", "scene.js", "plot.js", "hand.js"))) + script
    return f'<script type="application/json" id="data">{text}</script><script>{drawing}</script>'


def document(title: str, body: str, *, live: bool = False) -> str:
    """A whole page: title and body are HTML text; `live`: it may listen to where it came from."""
    policy = POLICY + LIVE_POLICY if live else POLICY
    style = palette_css() + part("style.css")
    return part("document.html").format(policy=policy, title=title, style=style, body=body)


def planned(replayed: Replay, planned_slice: PlannedImage | None) -> Plan | None:
    """What was planned; `None` where that was on a slice, which is not given.

    Raises InputError: the slice is not the one that the fixture was planned on
    """
    fixture = replayed.fixture
    if fixture.provenance.inputs.get("image") is None:
        planned_slice = None
    elif planned_slice is None:
        return None
    name = replayed.metrics.get("fixture", {}).get("name", "a fixture made in memory")
    return Plan.of(fixture, name, planned_slice)


def section(title: str, content: str) -> str:
    """A part of the page under its title."""
    return f"<section><h2>{escape(title)}</h2>{content}</section>"


def picture(figure: Figure, words: str, kind: str = "") -> str:
    """A figure within the page, with letters as large as the page's; `words` say what it shows."""
    figure.set_size_inches(WIDER * figure.get_size_inches())
    return _embedded(png_bytes(figure), words, kind)


def _embedded(png: bytes, words: str, kind: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return f'<img class="{kind}" alt="{escape(words)}" src="data:image/png;base64,{data}">'


# The tables.


def table(head: list[str], rows: list[list[str]], kind: str = "") -> str:
    """A table of cells that are HTML already; a narrow screen shows each with its column's name."""
    text = "".join(f'<th scope="col">{cell}</th>' for cell in head)
    if head:
        text = f"<thead><tr>{text}</tr></thead>"
    names = [f' data-name="{name}"' for name in head] or ("", "")
    lines = [
        "".join(f"<td{name}>{cell}</td>" for name, cell in zip(names, row, strict=True))
        for row in rows
    ]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f'<table class="{kind}">{text}<tbody>{body}</tbody></table>'


def identity(replayed: Replay) -> str:
    """The case, by plan or signature, who approved it, and the findings left open; as HTML."""
    fixture = replayed.fixture
    case = fixture.case or replayed.metrics.get("fixture", {}).get("case")
    words = ["Of no named case", "approved by nobody", "no finding of the plan is unanswered"]
    if case:
        words[0] = f"Case {case}"
    if fixture.reviewed:
        words[1] = f"approved by {fixture.reviewed.by}, {fixture.reviewed.utc}"
    if fixture.open_findings:
        codes = ", ".join(finding.code for finding in fixture.open_findings)
        words[2] = f"nobody answered of the plan: {codes}"
    return f"<p>{escape('; '.join(words))}.</p>"


def code(value: Any) -> str:
    """A value as it stands in a file; a digest on one line in print."""
    text = plain(value)
    kind = "digest" if re.fullmatch("[0-9a-f]{64}", text) else ""
    # A line may break after a comma.
    return f'<code class="{kind}">{escape(text).replace(",", ",<wbr>")}</code>'


def plain(value: Any) -> str:
    """A value of a report in plain words: yes or no, rounded numbers, lists without brackets."""
    if isinstance(value, list):
        return ", ".join(map(plain, value))
    if isinstance(value, bool):
        return ("no", "yes")[value]
    return resolved(value, 9) if isinstance(value, float) else str(value)


def summary(metrics: Report) -> str:
    """The main numbers; of two rules a column each."""
    rules = {metrics["rule"]: metrics}
    if "paper" in metrics:
        rules = {"robust": metrics, "paper": metrics["paper"]}
    columns = [
        {**metrics["session"], **rule["scene"], **rule, **rule["step_us"]}
        for rule in rules.values()
    ]
    for column in columns:
        column["contact_episodes"] = episode_count(column)
        drawn, column["overlap_max_m"] = beyond(metrics, column.get("overlap_max_m", 0.0))
    head = ["", *(f"rule {name}" for name in rules), "unit"]
    if guides_alone(metrics):
        head[1] = "guide"
        del columns[0]["band_m"], columns[0]["overlap_max_m"]
    rows = []
    # How far beyond the line comes first.
    for number in sorted(NUMBERS, key=lambda number: number.key != "overlap_max_m"):
        values = [column.get(number.key) for column in columns]
        if not number.label or {*values} == {None}:
            continue
        label, number = number.label.format(drawn=drawn), number.suiting(*values)
        rows.append([label, *map(number.text, values), number.unit])
    text = table(head, rows, "numbers")
    if len(rules) == 2:
        text += f"<p>Side by side, {apart_text(metrics['apart'])}.</p>"
    return text


def in_words(text: str, metrics: Report) -> str:
    """A text about limits in which each number of the summary has its words there for its name."""
    drawn, _ = beyond(metrics, 0.0)
    # A limit's overlap begins at the margin.
    if metrics["scene"]["point_radius_m"] and "margin" not in drawn:
        drawn += " with the margin"
    words = {number.key: number.label.format(drawn=drawn) for number in NUMBERS if number.label}
    return re.sub(r"(?:session\.)?(\w+_\w+)", lambda name: words.get(name[1], name[0]), text)


def checks(metrics: Report) -> str:
    """Each limit that was given, and whether it holds."""
    rows = []
    for check in metrics.get("checks", []):
        word = "pass" if check["pass"] else "fail"
        rows.append([f'<b class="{word}">{word.upper()}</b>', escape(check_text(check))])
    return in_words(table(["verdict", "limit"], rows, "group"), metrics) if rows else ""


def findings(metrics: Report) -> str:
    """What a person should look at."""
    rows = [
        [f'<b class="{finding["severity"]}">{finding["severity"]}</b>', finding["code"],
         escape(finding["message"])]
        for finding in metrics["findings"]
    ]  # fmt: skip
    if not rows:
        return "<p>No findings on the recording or on the run.</p>"
    return table(["severity", "finding", "what it says"], rows)


def episodes(metrics: Report) -> str:
    """One row an episode; a click moves the scrubber to its deepest tick."""
    listed = metrics["episodes"]
    if not listed:
        return "<p>No contact.</p>"
    # A guide alone has no overlap, and a cloud no line.
    has_none = {"overlap_max_m", "s_m"} - metrics.keys() - listed[0].get("deepest_along", {}).keys()
    numbers = [number for number in NUMBERS if number.column and number.key not in has_none]
    head = ["episode", *(f"{number.column} [{number.unit}]" for number in numbers), "passive"]
    rows = []
    for row, episode in enumerate(listed):
        time, name = episode["deepest"]["t_s"], episode["index"] + 1
        button = (
            f'<button class="go" data-time="{time!r}" data-episode="{row}" '
            f'aria-label="show episode {name}">{name}</button>'
        )
        told = episode | episode.get("deepest_along", {})
        _, told["overlap_max_m"] = beyond(metrics, episode["overlap_max_m"])
        cells = [number.text(told.get(number.key)) for number in numbers]
        passive = "yes" if episode["passive"] else '<b class="warning">no</b>'
        rows.append([button, *cells, passive])
    text = table(head, rows, "numbers")
    if more := episode_count(metrics) - len(listed):
        text += f"<p>and {more} more</p>"
    text += "<p>Passive: holding each force for a tick explains the energy that the hand got.</p>"
    return text


def settings_table(values: Report) -> str:
    """Values by their names; empty ones, parts of their own and long lists are left out."""
    rows = [
        [escape(name), code(value)]
        for name, value in values.items()
        if value not in (None, "") and not isinstance(value, dict)
        if not (isinstance(value, list) and len(value) > 3)
    ]
    return table([], rows, "settings")


def settings(metrics: Report, fixture: Fixture) -> str:
    """Provenance and settings, by their names in the JSON report."""
    names = ("fixture", "scene", "guide", "session", "link", "robot", "left_out")
    groups = {name: metrics[name] for name in names if metrics.get(name)}
    made = fixture.provenance
    groups["provenance"] = {"created_utc": made.created_utc, "software": made.software}
    groups |= {"settings of the plan": made.settings, "inputs of the plan": made.inputs}
    text = ""
    for group, values in groups.items():
        text += f"<h3>{escape(group.replace('_', ' '))}</h3>{settings_table(values)}"
    return f'<div class="columns">{text}</div>'
