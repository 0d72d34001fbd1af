"""The page of `vfplan live --web`: the report's scene, fed by a WebSocket."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from html import escape
from typing import Any

from vfplan.fixture import Fixture
from vfplan.report.page import document, part, scripts
from vfplan.report.scrubber import scene_data, tick_row


def live_page(fixture: Fixture, name: str) -> tuple[str, Callable[[Any], list[float]], str]:
    """The HTML text, a function that makes a tick's row for it, and the name of its scene."""
    data = scene_data(fixture)
    scene = hashlib.sha256(json.dumps([name, data]).encode()).hexdigest()[:16]
    content = part("live.html", "vfplan.live").replace("{scene}", part("scene.html"))
    body = f"<header><h1>Live: {escape(name)}</h1></header>{content}"
    text = body + scripts({**data, "scene": scene}, part("live.js", "vfplan.live"))
    return document(f"Live: {escape(name)}", text, live=True), tick_row(fixture), scene
