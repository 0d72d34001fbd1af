"""The page: verdict, numbers, pictures, scrubber, episodes, settings."""

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
from vfplan.io.staging import made_folder, write_whole
from vfplan.palette import DARK, LIGHT
from vfplan.replaying import Replay
from vfplan.replaying.limits import has_touched
from vfplan.report.scrubber import scrubber_data
from vfplan.report.tables import checks, code, episodes, findings, settings, summary, table

# The page may show what it carries and fetch nothing.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
_LIVE = "; connect-src 'self'"  # the live page's WebSocket


def write_report(
    replayed: Replay, folder: Path, *, image: Path | None = None, overwrite: bool = False,
    command: str = "",
) -> Path:  # fmt: skip
    """Write `folder/index.html`, a page that needs nothing else.

    replayed: a replay that kept ticks
    folder: made when it is not there; with `overwrite` its `index.html` is replaced
    image: the planned slice, to map depth back onto it
    command: the command line that led to it, if one did
    Raises InputError: an image that is not the one the fixture was planned on
    """
    folder = Path(folder)
    text = page(replayed, image=image, command=command)
    with made_folder(folder):
        write_whole(folder / "index.html", [text.encode("utf-8")], overwrite=overwrite)
    return folder / "index.html"


def page(replayed: Replay, *, image: Path | None = None, command: str = "") -> str:
    """The HTML text of the report."""
    found = replayed.metrics
    title = f"Replay of {escape(found['session']['name'])}"
    kept = f"of {found['ticks']} ticks"
    if replayed.stride > 1:
        kept = f"of the ticks kept, of each {replayed.stride} in a row the deepest"
    words = f"Each column reaches from the least to the largest value {kept}."
    scrubber = part("scrubber.html").replace("{scene}", part("scene.html"))
    body = "\n".join(
        [
            f"<header><h1>{title}</h1>{_verdict(found)}</header>",
            about({"command": command, **_named("fixture", found), **_named("session", found)}),
            section("Summary", summary(found) + checks(found) + findings(found)),
            section("Over time", picture(timeline(replayed), "force and depth over time")),
            section("Frame by frame", scrubber.replace("{envelope}", words)),
            *_places(replayed, image),
            section("Contact episodes", episodes(found)),
            section("What was planned", _review_sheet(replayed, image)),
            section("What was replayed", settings(found, replayed.fixture)),
        ]
    )
    return document(title, body + scripts(scrubber_data(replayed), part("scrubber.js")))


def _named(role: str, found: dict[str, Any]) -> dict[str, str]:
    """A file's name and digest, where it came from a file."""
    record = found.get(role, {})
    digest = record.get("sha256", "")
    return {role: record.get("name", "made in memory"), f"{role}'s SHA-256": digest}


def about(facts: dict[str, str]) -> str:
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
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}{_LIVE if live else ""}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title>{'<link rel=icon href=data:,>' if live else ''}"
        f"<style>{_colours()}{part('style.css')}</style></head><body><main>\n{body}</main></body>"
        "</html>\n"
    )


def _colours() -> str:
    """The palette, by its names."""
    light, dark = (
        "".join(f"--{name}: {value}; " for name, value in colours.items())
        for colours in (LIGHT, DARK)
    )
    return f":root {{ {light}}}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark}}} }}\n"


def _verdict(found: dict[str, Any]) -> str:
    """The first line of the page: green, red, or grey where nothing was tested."""
    limits = found.get("checks", [])
    if found["verdict"] == "fail":
        failed = sum(not check["pass"] for check in limits)
        return f'<p class="verdict fail">FAIL: {failed} of {len(limits)} limits</p>'
    if found["verdict"] == "pass":
        return f'<p class="verdict pass">PASS: all {len(limits)} limits hold</p>'
    if has_touched(found):
        return '<p class="verdict none">NOT TESTED: no limits were given</p>'
    return '<p class="verdict none">NOT TESTED: the tool never touched the fixture</p>'


def _places(replayed: Replay, image: Path | None) -> list[str]:
    shown = [section("In space", _in_space(replayed))]
    if replayed.metrics.get("arc_m") is not None:
        from vfplan.figures.replay import guide_plot

        words = "lateral error and force over arc length"
        shown.append(section("Along the guide", picture(guide_plot(replayed), words)))
    if replayed.fixture.curve is not None and replayed.metrics["contact_ticks"]:
        pictures = picture(depth_plot(replayed), "depth along the planned curve")
        if image is not None:
            from vfplan.images.read import read_image

            pictures += picture(slice_depth(replayed, read_image(image)), "depth on the slice")
        shown.append(section("Along the planned curve", pictures))
    return shown


def _review_sheet(replayed: Replay, image: Path | None) -> str:
    """The review sheet of the fixture, or how to get it where its slice was not given."""
    from vfplan.images.read import read_image
    from vfplan.review.sheet import draw_sheet
    from vfplan.review.sheet_input import of_fixture

    fixture, slice_ = replayed.fixture, None
    if fixture.provenance.inputs.get("image") is not None:
        if image is None:
            return "<p>Give the planned slice (--image) to see its review sheet here.</p>"
        slice_ = read_image(image)
    name = replayed.metrics.get("fixture", {}).get("name", "a fixture made in memory")
    pages = draw_sheet(of_fixture(fixture, name, image=slice_)).page_pngs()
    return "".join(_embedded(page, "review sheet of the fixture", "sheet") for page in pages)


def _in_space(replayed: Replay) -> str:
    """In its plane, or by PyVista; by Matplotlib where PyVista cannot render."""
    words = "fixture, HIP and proxy path, contact circles and normals at 10 Hz"
    if replayed.fixture.ignore_axis is None:
        from vfplan import view3d
        from vfplan.view3d import opengl

        if opengl.offscreen_window() is not None:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "view.png"
                view3d.draw_view(replayed.fixture, path, ticks=replayed.ticks, mark_hz=MARK_HZ)
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
