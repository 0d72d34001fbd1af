"""The server of the review page: it shows the session and takes the page's steps.

It listens on 127.0.0.1. The slice and the steps need the token, which is made anew for every run
and stands in the address behind "#", where no browser sends it on. Messages to the page are JSON
objects: `state` with all there is, `quick` with what is known at once after a step, `preview` of a
marker that is being dragged, `error`, `answered` with the number of a change, `approved`.

The steps also stand in a draft, a file beside the output, written after every step. Whatever ends
the program, the next call with the same files takes the review up where it was. What somebody
looked at is in no draft: it belongs to the name that stands on the page, and ends with the program.
"""

from __future__ import annotations

import hashlib
import json
import os
import queue
import re
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit
from weakref import WeakKeyDictionary

import cv2
import numpy as np

from vfplan.engine.browser import module
from vfplan.errors import CheckFailed, InputError, SettingError, VfplanError
from vfplan.fixture import Fixture
from vfplan.io.files import MAX_TEXT_BYTES, flags, now_utc, opened_file, to_json_types
from vfplan.io.sandbox import Loopback, reply
from vfplan.io.writing import lock_file, not_written, remove_quietly, write_whole
from vfplan.palette import palette_css
from vfplan.review.rendered import visible_name
from vfplan.review.session import Session, marker_state
from vfplan.review.steps import move_marker

# Largest size of a draft. Thousands of steps take some megabytes.
MAX_BYTES = MAX_TEXT_BYTES // 4

# What the page and the server send each other, as JSON holds it.
Message = dict[str, Any]


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

    `found` says of the draft that was taken up who wrote it, when, and how many steps it has.
    """

    def __init__(self, path: Path, sha256: dict[str, str], settings: dict[str, Any]) -> None:
        self.path = path
        texts = {name: repr(value) for name, value in sorted(settings.items())}
        self._header = {"format": "vfplan-draft", "version": "2.0", "sha256": sha256,
                        "settings": texts}  # fmt: skip
        self.found: dict[str, Any] | None = None

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep the draft to this process while the block runs.

        Raises
        ------
        InputError
            Another process holds it.
        OutputError
            The folder takes no file.
        """
        name = hashlib.sha256(os.fsencode(self.path.name)).hexdigest()[:16]
        path = self.path.with_name(f".vfplan-{name}.lock")
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | flags("O_NOFOLLOW"), 0o600)
        except OSError as error:
            raise not_written(path, error) from error
        with open(descriptor, "r+") as lock:
            try:
                lock_file(descriptor)
                # Whoever held it before may have removed the file meanwhile.
                is_held = os.path.samestat(os.fstat(descriptor), os.stat(path))
            except OSError:
                is_held = False
            if not is_held:
                text = f"Process {lock.read(20)} reviews into this draft. End that review first."
                raise InputError(text, where=str(self.path), code="draft-in-use")
            lock.truncate()
            lock.write(str(os.getpid()))
            lock.flush()
            try:
                yield
            finally:
                remove_quietly(path)

    def take_up(self, session: Session) -> Session:
        """The session with the draft's steps applied; as it is if there is no draft.

        Raises
        ------
        InputError
            The file is no draft, belongs to another user, to other files or settings, or holds a
            step that does not fit.
        """
        if not self.path.exists():
            return session
        where = str(self.path)
        advice = f"Move {self.path.name} away to begin anew."
        with opened_file(self.path) as file:
            owner, text = os.fstat(file.fileno()).st_uid, file.read(MAX_BYTES)
        if hasattr(os, "geteuid") and owner != os.geteuid():
            message = f"This draft is another user's (id {owner}). {advice}"
            raise InputError(message, where=where, code="draft-of-another-user")
        try:
            draft = json.loads(text)
            steps, undone = draft["steps"], tuple(draft["undone"])
            found = {"by": draft["by"], "utc": draft["utc"], "steps": len(steps)}
            header = {name: draft[name] for name in self._header}
        except (ValueError, KeyError, TypeError, RecursionError):
            message = f"This is no draft of a review. {advice}"
            raise InputError(message, where=where, code="no-draft") from None
        if header != self._header:
            what = "other settings" if header["sha256"] == self._header["sha256"] else "other files"
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
        self.found = found
        return replace(session, undone=undone, seen={})

    def keep(self, session: Session, by: str = "") -> None:
        """Write the session's steps and who took the last; raises `OutputError` if that fails."""
        known = {"by": by, "utc": now_utc(), "steps": session.steps, "undone": session.undone}
        text = json.dumps(self._header | known, indent=0)
        write_whole(self.path, [text.encode()], overwrite=True, mode=0o600)

    def discard(self) -> None:
        """Take the file away: the review is approved, or begins anew."""
        remove_quietly(self.path)


def draft_path(output: Path) -> Path:
    """Where the draft of an output is kept."""
    return output.with_name(f"{output.name}.draft.json")


# Size of a message from the page at most; 500 clicks take 20 kB, a table of 200 markers 16 kB.
MAX_MESSAGE_BYTES = 64 * 1024

POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; "
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
        self.session = session
        self._draft = draft
        self._about = {"by": by, "signs": signs, "draft": draft.found}
        self._version = 0
        # Each tab on which a name stands -> the name. Until then the tab itself counts as a person.
        self._names: WeakKeyDictionary[Any, str] = WeakKeyDictionary()
        self._lock = threading.RLock()
        self._wanted: queue.Queue = queue.Queue()
        self._stale = threading.Event()
        self._stale.set()
        self._closing = False
        self._server = Loopback(port, self._answer, self._talk, MAX_MESSAGE_BYTES)
        self.token, self.port = self._server.token, self._server.port
        # What to open in a browser; whoever knows it can review.
        self.address = self._server.address
        self._planner = threading.Thread(target=self._plan, daemon=True)
        self._planner.start()

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
                    words = write(self._approved(wish))
                    # No step follows, which would write the draft again.
                    self._closing = True
            except VfplanError as error:
                self._refuse(connection, error)
                continue
            self._send_all({"approved": {"by": wish["by"], "text": words}})
            self._draft.discard()
            return wish["by"]
        return None

    def _approved(self, wish: Message) -> Fixture:
        """The fixture that a person approves, if it is the one that the page shows."""
        if (wish.get("version"), wish.get("digest")) != (self._version, self.session.digest):
            text = "The plan has changed since. Look at it as it is now, and approve it again."
            raise SettingError(text, code="stale-approval")
        if self._about["draft"] is not None:
            text = "The plan begins with a draft. Resume it or start anew, then approve it."
            raise CheckFailed(text, code="draft-not-chosen")
        return self.session.approve(wish["by"])

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
        if name in ("/steps", "/slice.png", "/bodies.json"):
            query = parse_qs(address.query)
            if not self._server.has_token(query):
                return connection.respond(403, "the address lacks this review's token")
            if name == "/steps":
                return None
            if name == "/bodies.json":
                body = json.dumps(self.session.bodies()).encode()
                return reply(connection, body, "application/json", HEADERS)
            rgb = self.session.current.source.image.rgb
            grey_max = int(np.iinfo(rgb.dtype).max)
            low, high = query.get("low", ["0"])[0], query.get("high", [str(grey_max)])[0]
            is_grey = GREY_LEVEL.fullmatch(low) and GREY_LEVEL.fullmatch(high)
            if not is_grey or not int(low) < int(high) <= grey_max:
                return connection.respond(400, "low and high are no greys of the slice")
            # 8 bits, as browsers show them, with the slice's full depth between the two greys.
            shown = np.interp(np.arange(grey_max + 1), (int(low), int(high)), (0, 255))
            rgb = np.rint(shown).astype(np.uint8)[rgb]
            # A low compression: the bytes do not leave this computer.
            _, data = cv2.imencode(".png", rgb[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
            return reply(connection, data.tobytes(), "image/png", HEADERS)
        page = _pages().get(name)
        if page is None:
            return connection.respond(404, "there is no such page")
        body, kind = page
        return reply(connection, body, kind, HEADERS)

    # Messages by WebSocket.

    def _talk(self, connection: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            _send(connection, {"about": self._about})
            self._show([connection])
            for text in connection:
                try:
                    message = json.loads(text)
                except (ValueError, RecursionError):
                    message = None
                if isinstance(text, bytes) or not isinstance(message, dict):
                    connection.close(1008, "not understood")
                    return
                self._take(connection, message)

    def _take(self, connection: Any, message: Message) -> None:
        """Do what a message says, and answer it."""
        try:
            wish = message.get("preview", message.get("approve", {}))
            if not isinstance(wish, dict):
                text = 'A wish is no object. Send one such as {"marker": LABEL, "to": [u, v]}.'
                raise SettingError(text, code="step-malformed")
            if "preview" in message:
                # The registration as it would be with a marker elsewhere; nothing is changed.
                plan = move_marker(self.session.current, {**wish, "do": "move_marker"})
                _send(connection, {"preview": to_json_types(marker_state(plan))})
            elif "name" in message:
                self._name(connection, message["name"])
            elif "draft" in message:
                self._choose_draft(is_anew=message["draft"] == "anew")
            elif "approve" in message:
                wish["by"] = self._name(connection, wish.get("by"))
                self._wanted.put((connection, wish))
            elif "leave" in message:
                self._wanted.put((connection, None))
            else:
                self._change(message, connection)
        except VfplanError as error:
            self._refuse(connection, error, is_preview="preview" in message)
        if "number" in message:
            # The page sends its next change once it has this answer.
            _send(connection, {"answered": message["number"]})

    def _refuse(self, connection: Any, error: VfplanError, *, is_preview: bool = False) -> None:
        """Say what is wrong; what the page moved goes back to its place, if it is let go."""
        _send(connection, {"error": {"code": error.code, "message": str(error)}})
        if not is_preview:
            self._show([connection])

    def _name(self, connection: Any, name: Any) -> str:
        """Give a tab to a person, with what was looked at on it while it had no name."""
        name = visible_name(name if isinstance(name, str) else "")
        with self._lock:
            places = self.session.seen.get(connection)
            if connection not in self._names and places is not None:
                self.session = self.session.with_seen(name, places)
            self._names[connection] = name
        self._show([connection])
        return name

    def _choose_draft(self, *, is_anew: bool) -> None:
        """Go on with the draft that was found, or begin without it."""
        with self._lock:
            if is_anew and self._about["draft"] is not None:
                self._draft.discard()
                self.session = self.session.anew()
                self._version += 1
            self._about["draft"] = None
        self._send_all({"about": self._about})
        self._show(self._server.connections)

    def _change(self, message: Message, connection: Any) -> None:
        """Apply a step, undo or redo; the draft has it before any page shows it."""
        with self._lock:
            if self._closing:
                return
            step = message.get("step")
            # A look changes nothing that a step could refer to.
            is_look = isinstance(step, dict) and step.get("do") == "viewed"
            if message.get("version") != self._version:
                if is_look:
                    return  # What was in view belongs to a line that has changed since.
                text = "The page showed an earlier state. Look again, and repeat the step."
                raise SettingError(text, code="stale-step")
            if is_look:
                self.session = self.session.looked_at(step, self._names.get(connection, connection))
            else:
                if "undo" in message:
                    session = self.session.undo()
                else:
                    session = self.session.redo() if "redo" in message else self.session.apply(step)
                self._draft.keep(session, self._names.get(connection, self._about["by"]))
                self.session = session
                self._version += 1
        self._show(self._server.connections)

    def _show(self, connections: Iterable[Any], *, is_whole: bool = False) -> None:
        """Send the state to tabs, each as its person sees it; the whole state follows."""
        with self._lock:
            session, version = self.session, self._version
        kind, state_of = ("state", session.state) if is_whole else ("quick", session.quick_state)
        shown = {}
        for connection in connections:
            who = self._names.get(connection, connection)
            if who not in shown:
                shown[who] = to_json_types(state_of(who))
            if version == self._version or not is_whole:
                _send(connection, {kind: shown[who], "version": version})
        if not is_whole:
            self._stale.set()

    def _plan(self) -> None:
        """Make the whole plan of the latest state, again and again, and show it."""
        while True:
            self._stale.wait()
            self._stale.clear()
            if self._closing:
                return
            self._show(self._server.connections, is_whole=True)

    def _send_all(self, message: Message) -> None:
        for connection in list(self._server.connections):
            _send(connection, message)


def _send(connection: Any, message: Message) -> None:
    """Send a message; a page that has gone hears nothing."""
    from websockets.exceptions import ConnectionClosed

    with suppress(ConnectionClosed, OSError):
        connection.send(json.dumps(message))


def _pages() -> dict[str, tuple[bytes, str]]:
    """Path -> (body, media type) of all that is served without a token: no word of the slice."""
    pages = {}
    for file in files("vfplan.review").joinpath("page").iterdir():
        suffix = Path(file.name).suffix
        if suffix in MEDIA_TYPES:
            pages[f"/{file.name}"] = (file.read_bytes(), f"{MEDIA_TYPES[suffix]}; charset=utf-8")
    pages["/"] = pages.pop("/index.html")
    pages["/palette.css"] = (palette_css().encode(), "text/css; charset=utf-8")
    style = files("vfplan.report").joinpath("style.css").read_bytes()
    pages["/report.css"] = (style, "text/css; charset=utf-8")
    pages["/engine.wasm"] = (module(), "application/wasm")
    return pages
