"""The page of a replay: verdict, slice and force first, files and hashes last."""

from __future__ import annotations

import base64
import json
import tempfile
from html import escape
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from vfplan.figures.depth import depth_plot, slice_depth
from vfplan.figures.replay import MARK_HZ, scene, timeline
from vfplan.figures.style import png_bytes
from vfplan.io.files import now_utc
from vfplan.io.writing import made_folder, write_whole
from vfplan.palette import DARK, LIGHT
from vfplan.replaying import Replay
from vfplan.replaying.verdict import change_words, gap_words, has_touched
from vfplan.report.scrubber import scrubber_data
from vfplan.report.tables import checks, code, episodes, findings, settings, summary, table

# The page may show what it carries and fetch nothing.
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
LIVE_POLICY = "; connect-src 'self'"
"""What a live page may do in addition: listen to the server that it came from."""


def write_report(
    replayed: Replay, folder: Path, *, image: Path | None = None, overwrite: bool = False,
    command: str = "",
) -> Path:  # fmt: skip
    """Write `folder/index.html`, a page that needs nothing else.

    Parameters
    ----------
    replayed
        A replay that kept ticks.
    folder
        Made if it does not exist; with `overwrite` its `index.html` is replaced.
    image
        The planned slice, to map depth back onto it.
    command
        The command line that led to it, if one did.

    Raises
    ------
    InputError
        The image is not the one that the fixture was planned on.
    """
    folder = Path(folder)
    text = page(replayed, image=image, command=command)
    with made_folder(folder):
        write_whole(folder / "index.html", [text.encode("utf-8")], overwrite=overwrite)
    return folder / "index.html"


def page(replayed: Replay, *, image: Path | None = None, command: str = "") -> str:
    """The HTML text of the report: verdict, slice and force first, files and hashes last."""
    metrics = replayed.metrics
    title = f"Replay of {escape(metrics['session']['name'])}"
    body = [f"<header><h1>{title}</h1>{verdict_line(metrics)}</header>"]

    # What a reader wants first: where it happened, and with what force.
    if image is not None and _has_depth(replayed):
        from vfplan.images.read import read_image

        on_slice = picture(slice_depth(replayed, read_image(image)), "depth on the slice")
        body.append(section("On the slice", on_slice))
    else:
        body.append(section("In space", _in_space(replayed, image)))
    body.append(section("Over time", picture(timeline(replayed), "force and depth over time")))
    body.append(section("Summary", summary(metrics) + checks(metrics) + findings(metrics)))

    # Then all of it, to look into.
    body.append(section("Frame by frame", scrubber(replayed)))
    if image is not None and _has_depth(replayed):
        body.append(section("In space", _in_space(replayed, image)))
    if metrics.get("arc_m") is not None:
        from vfplan.figures.replay import guide_plot

        words = "lateral error and force over arc length"
        body.append(section("Along the guide", picture(guide_plot(replayed), words)))
    if _has_depth(replayed):
        words = "depth along the planned curve"
        body.append(section("Along the planned curve", picture(depth_plot(replayed), words)))
    body.append(section("Contact episodes", episodes(metrics)))
    body.append(section("What was planned", review_sheet(replayed, image)))

    # Last what identifies it: settings, files and hashes.
    body.append(section("What was replayed", settings(metrics, replayed.fixture)))
    facts = {"command": command}
    for role in ("fixture", "session"):
        record = metrics.get(role, {})
        facts[role] = record.get("name", "made in memory")
        facts[f"{role}'s SHA-256"] = record.get("sha256", "")
    body.append(facts_table(facts))
    text = "\n".join(body)
    return document(title, text + scripts(scrubber_data(replayed), part("scrubber.js")))


def _has_depth(replayed: Replay) -> bool:
    """Whether the hand touched a fixture that was drawn as a curve."""
    return replayed.fixture.curve is not None and bool(replayed.metrics["contact_ticks"])


def scrubber(replayed: Replay) -> str:
    """The scene and the plots that move through time."""
    ticks = f"of {replayed.metrics['ticks']} ticks"
    if replayed.stride > 1:
        ticks = f"of the ticks kept, of each {replayed.stride} in a row the deepest"
    words = f"Each column reaches from the least to the largest value {ticks}."
    text = part("scrubber.html").replace("{scene}", part("scene.html"))
    return text.replace("{envelope}", words)


def facts_table(facts: dict[str, str]) -> str:
    """When the page was made, by which program, and the facts given; empty ones are left out."""
    rows = {"made": now_utc(), "program": f"vfplan {version('vfplan')}", **facts}
    lines = [[escape(name), code(value)] for name, value in rows.items() if value]
    return section("About this page", table([], lines, "settings"))


def part(name: str, package: str = "vfplan.report") -> str:
    """The text of a package's file; without a package, of a file beside this one."""
    return (files(package) / name).read_text("utf-8")


def scripts(data: dict[str, Any], script: str) -> str:
    """The page's data, and what draws it: the common scripts, then the text of its own."""
    # "</" inside the data would end the script element.
    text = json.dumps(data, allow_nan=False).replace("</", "<\\/")
    drawing = part("canvas.js") + part("scene.js") + part("plot.js") + script
    return f'<script type="application/json" id="data">{text}</script><script>{drawing}</script>'


def document(title: str, body: str, *, live: bool = False) -> str:
    """A whole page: title and body are HTML text; `live`: it may listen to where it came from."""
    policy, icon = POLICY, ""
    if live:
        policy += LIVE_POLICY
        icon = "<link rel=icon href=data:,>"
    style = palette_css(LIGHT, DARK) + part("style.css")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title>{icon}<style>{style}</style></head>"
        f"<body><main>\n{body}</main></body></html>\n"
    )


def palette_css(light: dict[str, str], dark: dict[str, str]) -> str:
    """The colours of every picture as variables of a page, for light and for dark screens."""
    variables = {"light": "", "dark": ""}
    for theme, colours in (("light", light), ("dark", dark)):
        for name, colour in colours.items():
            variables[theme] += f"--{name}: {colour}; "
    return (
        f":root {{ {variables['light']}}}\n@media (prefers-color-scheme: dark) "
        f"{{ :root {{ {variables['dark']}}} }}\n"
    )


def verdict_line(metrics: dict[str, Any]) -> str:
    """The first line of the page: green, red, or grey if nothing was tested."""
    limits = metrics.get("checks", [])
    if metrics["verdict"] == "fail":
        failed = sum(not check["pass"] for check in limits)
        return f'<p class="verdict fail">FAIL: {failed} of {len(limits)} limits</p>'
    if metrics["verdict"] == "pass":
        words = f"all {len(limits)} limits hold" if len(limits) > 1 else "the limit holds"
        words += gap_words(metrics) + change_words(metrics)
        return f'<p class="verdict pass">PASS: {words}</p>'
    if has_touched(metrics):
        return '<p class="verdict none">NOT TESTED: no limits were given</p>'
    return '<p class="verdict none">NOT TESTED: the tool never touched the fixture</p>'


def review_sheet(replayed: Replay, image: Path | None) -> str:
    """The review sheet of the fixture, or how to get it if its slice was not given."""
    from vfplan.images.read import read_image
    from vfplan.review.sheet import draw_sheet
    from vfplan.review.sheet_input import of_fixture

    fixture = replayed.fixture
    planned_slice = None
    if fixture.provenance.inputs.get("image") is not None:
        if image is None:
            return "<p>Give the planned slice (--image) to see its review sheet here.</p>"
        planned_slice = read_image(image)
    name = replayed.metrics.get("fixture", {}).get("name", "a fixture made in memory")
    text = ""
    for sheet in draw_sheet(of_fixture(fixture, name, image=planned_slice)).page_pngs():
        text += _embedded(sheet, "review sheet of the fixture", "sheet")
    return text


def _in_space(replayed: Replay, image: Path | None) -> str:
    """In its plane, or by PyVista; by Matplotlib if PyVista cannot render."""
    words = "fixture, HIP and proxy path, contact circles and normals at 10 Hz"
    if replayed.fixture.ignore_axis is None:
        from vfplan import view3d
        from vfplan.images.read import read_image
        from vfplan.view3d.opengl import offscreen_window

        if offscreen_window() is not None:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "view.png"
                planned_slice = read_image(image) if image is not None else None
                view3d.draw_view(
                    replayed.fixture,
                    path,
                    ticks=replayed.ticks,
                    mark_hz=MARK_HZ,
                    image=planned_slice,
                )
                return _embedded(path.read_bytes(), words, "tall")
    return picture(scene(replayed), words, "tall")


def section(title: str, content: str) -> str:
    """A part of the page under its title."""
    return f"<section><h2>{escape(title)}</h2>{content}</section>"


def picture(figure: Figure, words: str, kind: str = "") -> str:
    """A figure within the page; `words` say what it shows."""
    return _embedded(png_bytes(figure), words, kind)


def _embedded(png: bytes, words: str, kind: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return f'<img class="{kind}" alt="{escape(words)}" src="data:image/png;base64,{data}">'
