"""The frames of `vfplan ar --window` in a page of this computer's browser, with their latency."""

from __future__ import annotations

import hmac
import json
import secrets
import threading
import time
from html import escape
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2

from vfplan.camera.pose import Picture
from vfplan.io.sandbox import Loopback, reply
from vfplan.report.page import document, part
from vfplan.review.server import HEADERS

# Seconds after which a page that waits for a frame is looked after: it may have gone.
WAIT_S = 0.2

# The page's own policy stands in it, because its script does too.
PAGE_HEADERS = HEADERS.copy()
del PAGE_HEADERS["Content-Security-Policy"]


class Window:
    """Serves one page, and its frames to whoever has the token, until it is closed.

    A page gets the newest frame once it has drawn the one before, so that none waits in a queue.

    name: stands on the page
    port: 0: one that the system chooses
    Raises MissingExtra: without the package websockets
    Raises OutputError: the port is taken
    """

    def __init__(self, name: str, port: int) -> None:
        self._token = secrets.token_urlsafe(32)
        # From the reading of a frame to the page's answer that it is drawn [ms].
        self.latencies_ms: list[float] = []
        self._frame, self._words, self._read_s = None, {"frame": 0}, 0.0
        self._has_changed = threading.Condition()
        title = f"Camera: {escape(name)}"
        body = f"<header><h1>{title}</h1></header>" + part("window.html", "vfplan.camera")
        body += f"<script>{part('window.js', 'vfplan.camera')}</script>"
        self._page = document(title, body, live=True).encode()
        self._server = Loopback(port, self._answer, self._talk)
        self.close = self._server.close
        # What to open in a browser; whoever knows it sees the frames.
        self.address = f"http://127.0.0.1:{self._server.port}/#{self._token}"

    def show(self, frame: Picture, refused: str | None, read_s: float) -> None:
        """Show a frame, blue first, that was read at a time of `time.monotonic`."""
        with self._has_changed:
            self._words = {"frame": self._words["frame"] + 1, "refused": refused}
            self._frame, self._read_s = frame, read_s
            self._has_changed.notify_all()

    def _answer(self, connection: Any, request: Any) -> Any:
        address = urlsplit(request.path)
        if address.path == "/":
            return reply(connection, self._page, "text/html; charset=utf-8", PAGE_HEADERS)
        if address.path != "/frames":
            return connection.respond(404, "there is one page, /")
        token = parse_qs(address.query).get("token", [""])[0]
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return connection.respond(403, "the address lacks the token of this run")
        return None

    def _talk(self, connection: Any) -> None:
        """Send frames until the connection is closed, which sending or receiving raises."""
        shown, latency_ms = 0, None
        while True:
            with self._has_changed:
                if self._words["frame"] == shown:
                    self._has_changed.wait(WAIT_S)
                words, frame, read_s = self._words, self._frame, self._read_s
            if words["frame"] == shown:
                # This raises where the page has gone.
                connection.ping()
                continue
            connection.send(json.dumps(words | {"latency_ms": latency_ms}))
            connection.send(cv2.imencode(".jpg", frame)[1].tobytes())
            connection.recv()
            shown, latency_ms = words["frame"], 1e3 * (time.monotonic() - read_s)
            self.latencies_ms.append(latency_ms)
