"""The server of the review page: it shows the session and takes the page's steps.

It listens on 127.0.0.1. The slice and the steps need the token, which is made anew for every run
and stands in the address behind "#", where no browser sends it on. Messages to the page are JSON
objects: `state` with all there is, `quick` with what is known at once after a step, `preview` of a
marker that is being dragged, `error`, `answered` with the number of a change, `approved`.

The steps also stand in a draft, a file beside the output, written after every step. Whatever ends
the program, the next call with the same files takes the review up where it was.
"""

from __future__ import annotations

import hmac
import json
import queue
import re
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np

from vfplan.errors import InputError, SettingError, VfplanError
from vfplan.fixture import Fixture
from vfplan.io.files import MAX_TEXT_BYTES, read_whole, to_json_types
from vfplan.io.sandbox import Loopback, reply
from vfplan.io.writing import write_whole
from vfplan.palette import DARK, LIGHT
from vfplan.review.session import Session, marker_state
from vfplan.review.steps import move_marker

# Largest size of a draft. Thousands of steps take some megabytes.
MAX_BYTES = MAX_TEXT_BYTES // 4


class Draft:
    """The file of a draft, and what the draft belongs to.

    Parameters
    ----------
    path
        Where it is kept.
    sha256
        Role ("source", "markers", "markers2", "slice", "curve") -> SHA-256 of a file of the review.
    settings
        The settings that were given, by name.
    """

    def __init__(self, path: Path, sha256: dict[str, str], settings: dict[str, Any]) -> None:
        self.path = path
        texts = {name: repr(value) for name, value in sorted(settings.items())}
        self._header = {"format": "vfplan-draft", "version": "1.0", "sha256": sha256,
                        "settings": texts}  # fmt: skip

    def take_up(self, session: Session) -> Session:
        """The session with the draft's steps applied; as it is if there is no draft.

        Raises
        ------
        InputError
            The file is no draft, belongs to other files or settings, or holds a step that does not
            fit.
        """
        if not self.path.exists():
            return session
        where = str(self.path)
        advice = f"Move {self.path.name} away to begin anew."
        text = read_whole(self.path, MAX_BYTES, InputError)
        try:
            draft = json.loads(text)
            steps, undone = draft["steps"], draft["undone"]
            header = {name: draft[name] for name in self._header}
            if not isinstance(steps, list) or not isinstance(undone, list):
                raise TypeError
        except (ValueError, KeyError, TypeError, RecursionError):
            message = f"This is no draft of a review. {advice}"
            raise InputError(message, where=where, code="no-draft") from None
        if header != self._header:
            what = "other settings"
            if header["sha256"] != self._header["sha256"]:
                what = "other files"
            message = f"This is the draft of a review with {what}. {advice}"
            raise InputError(message, where=where, code="another-draft")
        try:
            for step in steps:
                session = session.apply(step)
            after = session
            for step in undone:
                after = after.apply(step)
        except SettingError as error:
            message = f"The draft holds a step that does not fit. {error.message} {advice}"
            raise InputError(message, where=where, code="draft-does-not-fit") from None
        return replace(session, undone=tuple(undone))

    def keep(self, session: Session) -> None:
        """Write the session's steps; raises `OutputError` if that fails."""
        steps = {"steps": list(session.steps), "undone": list(session.undone)}
        text = json.dumps(self._header | steps, indent=0)
        write_whole(self.path, [text.encode()], overwrite=True, mode=0o600)

    def discard(self) -> None:
        """Take the file away: the review is approved."""
        self.path.unlink(missing_ok=True)


def draft_path(output: Path) -> Path:
    """Where the draft of an output is kept."""
    return output.with_name(f"{output.name}.draft.json")


# Size of a message from the page at most; 500 clicks take 20 kB, a table of 200 markers 16 kB.
MAX_MESSAGE_BYTES = 64 * 1024

# Messages a second that are taken; a screen that drags sends at most 60.
MESSAGES_PER_S = 100.0

# Messages that may come at once, as after a browser's pause.
BURST = 3 * MESSAGES_PER_S

# Pages that are served at a time.
MAX_TABS = 8

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
# A grey of a slice, as a page asks for it.
GREY_LEVEL = re.compile("[0-9]{1,6}")

MEDIA_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}


class ReviewServer:
    """Serves one review until `run` returns.

    Parameters
    ----------
    session
        Where the review stands.
    draft
        Where its steps are kept.
    port
        0: one that the system chooses.
    by
        The name that the page proposes for answers and for the approval.
    signs
        Whether the output will be signed, for the words of the page.

    Raises `OutputError` where the port is taken.
    """

    def __init__(
        self, session: Session, draft: Draft, *, port: int = 0, by: str = "", signs: bool = False
    ) -> None:
        self.token = secrets.token_urlsafe(32)
        self._session = session
        self._draft = draft
        self._about = {"by": by, "signs": signs}
        self._version = 0
        self._lock = threading.RLock()
        self._wanted: queue.Queue = queue.Queue()
        self._stale = threading.Event()
        self._stale.set()
        self._closing = False
        self._server = Loopback(port, self._answer, self._talk, MAX_MESSAGE_BYTES)
        self._planner = threading.Thread(target=self._plan, daemon=True)
        self._planner.start()

    @property
    def port(self) -> int:
        """Where it listens on 127.0.0.1."""
        return self._server.port

    @property
    def address(self) -> str:
        """What to open in a browser; whoever knows it can review."""
        return f"http://127.0.0.1:{self.port}/#{self.token}"

    @property
    def session(self) -> Session:
        """Where the review stands."""
        return self._session

    def run(self, write: Callable[[Fixture], str], stopped: Callable[[], bool]) -> str | None:
        """Serve until the person approves or leaves, or `stopped` says so.

        Parameters
        ----------
        write
            Writes an approved fixture; returns the words that the page shows.
        stopped
            Whether to end; looked at every fifth of a second.

        Returns
        -------
        str or None
            Who approved; `None` where nobody did.
        """
        while not stopped():
            try:
                connection, wish = self._wanted.get(timeout=0.2)
            except queue.Empty:
                continue
            if wish is None:
                self._send_all({"left": True})
                return None
            try:
                with self._lock:
                    words = write(self._session.approve(wish))
            except VfplanError as error:
                self._send(connection, _described(error))
                continue
            self._draft.discard()
            self._send_all({"approved": {"by": wish, "text": words}})
            return wish
        return None

    def close(self) -> None:
        """Let every page go."""
        self._closing = True
        self._stale.set()
        self._server.close()
        self._planner.join()

    # Requests by HTTP.

    def _answer(self, connection: Any, request: Any) -> Any:
        address = urlsplit(request.path)
        name = address.path
        if name in ("/steps", "/slice.png"):
            query = parse_qs(address.query)
            token = query.get("token", [""])[0]
            if not hmac.compare_digest(token.encode(), self.token.encode()):
                return connection.respond(403, "the address lacks this review's token")
            if name == "/steps":
                return None
            rgb = self._session.source.image.rgb
            grey_max = int(np.iinfo(rgb.dtype).max)
            low, high = query.get("low", ["0"])[0], query.get("high", [str(grey_max)])[0]
            is_grey = GREY_LEVEL.fullmatch(low) and GREY_LEVEL.fullmatch(high)
            if not is_grey or not int(low) < int(high) <= grey_max:
                return connection.respond(400, "low and high are no greys of the slice")
            # 8 bits, as browsers show them, with the slice's full depth between the two greys.
            if (int(low), int(high)) != (0, 255) or rgb.dtype != np.uint8:
                greys = np.arange(grey_max + 1)
                shown = np.clip((greys - int(low)) * (255.0 / (int(high) - int(low))), 0, 255)
                rgb = np.rint(shown).astype(np.uint8)[rgb]
            # A low compression: the bytes do not leave this computer.
            is_encoded, data = cv2.imencode(
                ".png", rgb[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1]
            )
            assert is_encoded
            return reply(connection, data.tobytes(), "image/png", HEADERS)
        page = _pages().get(name)
        if page is None:
            return connection.respond(404, "there is no such page")
        body, kind = page
        return reply(connection, body, kind, HEADERS)

    # Messages by WebSocket.

    def _talk(self, connection: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        if len(self._server.connections) > MAX_TABS:
            connection.close(1013, f"{MAX_TABS} pages are served, and no more")
            return
        with suppress(ConnectionClosed):
            self._send(connection, {"about": self._about})
            self._send(connection, self._quick())
            self._stale.set()
            allowance, before = BURST, time.monotonic()
            for text in connection:
                now = time.monotonic()
                allowance = min(BURST, allowance + (now - before) * MESSAGES_PER_S) - 1.0
                before = now
                if allowance < 0.0:
                    connection.close(1008, "too many messages")
                    return
                try:
                    message = json.loads(text)
                except (ValueError, RecursionError):
                    message = None
                if isinstance(text, bytes) or not isinstance(message, dict):
                    connection.close(1008, "not understood")
                    return
                self._take(connection, message)

    def _take(self, connection: Any, message: dict[str, Any]) -> None:
        """Do what a message says, and answer it."""
        try:
            if "preview" in message:
                self._send(connection, self._preview(message["preview"]))
            elif "approve" in message:
                self._wanted.put((connection, str(message["approve"])[:200]))
            elif "leave" in message:
                self._wanted.put((connection, None))
            else:
                self._change(message)
        except VfplanError as error:
            self._send(connection, _described(error))
            if "preview" not in message:
                # What the page moved already goes back to its place.
                self._send(connection, self._quick())
                self._stale.set()
        if "number" in message:
            # The page sends its next change once it has this answer.
            self._send(connection, {"answered": message["number"]})

    def _change(self, message: dict[str, Any]) -> None:
        """Apply a step, undo or redo; the draft has it before any page shows it."""
        with self._lock:
            step = message.get("step")
            # A look changes nothing that a step could refer to.
            is_look = isinstance(step, dict) and step.get("do") == "viewed"
            if message.get("version") != self._version:
                if is_look:
                    return  # What was in view belongs to a line that has changed since.
                text = "The page showed an earlier state. Look again, and repeat the step."
                raise SettingError(text, code="stale-step", numbers={"version": self._version})
            if "undo" in message:
                session = self._session.undo()
            elif "redo" in message:
                session = self._session.redo()
            else:
                session = self._session.apply(step)
            self._draft.keep(session)
            self._session = session
            if not is_look:
                self._version += 1
        self._send_all(self._quick())
        self._stale.set()

    def _preview(self, wish: Any) -> dict[str, Any]:
        """The registration as it would be with a marker elsewhere; nothing is changed."""
        if not isinstance(wish, dict):
            text = 'A preview is no object. Send {"marker": LABEL, "to": [u, v]}.'
            raise SettingError(text, code="step-malformed")
        plan = move_marker(self._session.current, {**wish, "do": "move_marker"})
        return {"preview": to_json_types(marker_state(plan))}

    def _quick(self) -> dict[str, Any]:
        with self._lock:
            session, version = self._session, self._version
        return {"quick": to_json_types(session.quick_state()), "version": version}

    def _plan(self) -> None:
        """Make the whole plan of the latest state, again and again, and show it."""
        while True:
            self._stale.wait()
            self._stale.clear()
            if self._closing:
                return
            with self._lock:
                session, version = self._session, self._version
            state = to_json_types(session.state())
            if version == self._version:
                self._send_all({"state": state, "version": version})

    def _send_all(self, message: dict[str, Any]) -> None:
        text = json.dumps(message)
        for connection in list(self._server.connections):
            _send_text(connection, text)

    def _send(self, connection: Any, message: dict[str, Any]) -> None:
        _send_text(connection, json.dumps(message))


def _send_text(connection: Any, text: str) -> None:
    from websockets.exceptions import ConnectionClosed

    with suppress(ConnectionClosed, OSError):
        connection.send(text)


def _described(error: VfplanError) -> dict[str, Any]:
    return {"error": {"code": error.code, "message": str(error)}}


def _pages() -> dict[str, tuple[bytes, str]]:
    """Path -> (body, media type) of all that is served without a token: no word of the slice."""
    pages = {}
    for file in files("vfplan.review").joinpath("page").iterdir():
        suffix = file.name[file.name.rfind(".") :]
        if suffix in MEDIA_TYPES:
            pages[f"/{file.name}"] = (file.read_bytes(), f"{MEDIA_TYPES[suffix]}; charset=utf-8")
    pages["/"] = pages.pop("/index.html")
    # The colours of every picture, as the page's variables.
    light, dark = (
        "; ".join(f"--{name}: {colour}" for name, colour in colours.items())
        for colours in (LIGHT, DARK)
    )
    palette = f":root {{ {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
    pages["/palette.css"] = (palette.encode(), "text/css; charset=utf-8")
    style = files("vfplan.report").joinpath("style.css").read_bytes()
    pages["/report.css"] = (style, "text/css; charset=utf-8")
    return pages
