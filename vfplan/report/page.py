"""The page: verdict, numbers, pictures, scrubber, episodes, settings."""

from __future__ import annotations

import base64
import json
import tempfile
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from vfplan.figures.depth import depth_plot, slice_depth
from vfplan.figures.replay import MARK_HZ, scene, timeline
from vfplan.figures.style import png_bytes
from vfplan.io.disk import made_folder, write_whole
from vfplan.replaying import Replay
from vfplan.report.scrubber import scrubber_data
from vfplan.report.tables import checks, episodes, findings, settings, summary

# The page may show what it carries and fetch nothing.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


def write_report(
    replayed: Replay, folder: Path, *, image: Path | None = None, overwrite: bool = False
) -> Path:
    """Write `folder/index.html`, a page that needs nothing else.

    Parameters
    ----------
    replayed
        A replay that kept ticks.
    folder
        Made when it is not there; with `overwrite` its `index.html` is replaced.
    image
        The planned slice, to map depth back onto it.

    Raises
    ------
    InputError
        An image that is not the one the fixture was planned on.
    """
    folder = Path(folder)
    text = page(replayed, image=image)
    with made_folder(folder):
        write_whole(folder / "index.html", [text.encode("utf-8")], overwrite=overwrite)
    return folder / "index.html"


def page(replayed: Replay, *, image: Path | None = None) -> str:
    """The HTML text of the report."""
    found = replayed.metrics
    parts = files("vfplan.report")
    # "</" inside the data would end the script element.
    data = json.dumps(scrubber_data(replayed), allow_nan=False).replace("</", "<\\/")
    title = f"Replay of {escape(found['session']['name'])}"
    body = "\n".join(
        [
            f"<header><h1>{title}</h1>{_verdict(found)}</header>",
            section("Summary", summary(found) + checks(found) + findings(found)),
            section("Over time", picture(timeline(replayed), "force and depth over time")),
            section("Frame by frame", (parts / "scrubber.html").read_text("utf-8")),
            *_places(replayed, image),
            section("Contact episodes", episodes(found)),
            section("What was replayed", settings(found, replayed.fixture)),
        ]
    )
    script = (
        f'<script type="application/json" id="data">{data}</script>'
        f"<script>{(parts / 'scrubber.js').read_text('utf-8')}</script>"
    )
    return document(title, f"{body}\n{script}")


def document(title: str, body: str) -> str:
    """A whole page: title and body are HTML text."""
    styles = (files("vfplan.report") / "style.css").read_text("utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title>"
        f"<style>{styles}</style></head><body>\n{body}</body></html>\n"
    )


def _verdict(found: dict[str, Any]) -> str:
    if "checks" not in found:
        return '<p class="verdict none">no limits given</p>'
    failed = sum(not check["pass"] for check in found["checks"])
    if failed:
        return f'<p class="verdict fail">FAIL: {failed} of {len(found["checks"])} limits</p>'
    return f'<p class="verdict pass">PASS: all {len(found["checks"])} limits hold</p>'


def _places(replayed: Replay, image: Path | None) -> list[str]:
    shown = [section("In space", _in_space(replayed))]
    if replayed.metrics.get("arc_m") is not None:
        from vfplan.figures.guide import guide_plot

        words = "lateral error and force over arc length"
        shown.append(section("Along the guide", picture(guide_plot(replayed), words)))
    if replayed.fixture.curve is not None and replayed.metrics["contact_ticks"]:
        pictures = picture(depth_plot(replayed), "depth along the planned curve")
        if image is not None:
            from vfplan.images.read import read_image

            pictures += picture(slice_depth(replayed, read_image(image)), "depth on the slice")
        shown.append(section("Along the planned curve", pictures))
    return shown


def _in_space(replayed: Replay) -> str:
    """In its plane, or by PyVista; by Matplotlib where PyVista cannot render."""
    words = "cloud, HIP and proxy path, contact circles and normals at 10 Hz"
    if replayed.fixture.ignore_axis is None:
        from vfplan import view3d
        from vfplan.io import opengl

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
