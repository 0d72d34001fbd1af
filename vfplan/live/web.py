"""A page to watch, and its ticks by WebSocket: on the loopback, for pages that came from here."""

from __future__ import annotations

import json
import logging
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import OutputError, needing
from vfplan.live.sources import MOST_CLIENTS, Feed

QUIET_S = 0.2  # a client that went is noticed as soon, at least
ASKED_S = 2.0  # a connection on which nothing is asked so long, as browsers open, is let go
_SILENT = logging.Logger("websockets", logging.CRITICAL + 1)


class Web:
    """Serves until it is closed.

    page: HTML text; it opens a WebSocket at /ticks
    row: a tick as the page's script takes it
    scene: names what the page shows: one that came from another program loads itself anew
    port: 0: one that the system chooses; see `port`
    feed: what is shown
    Raises MissingExtra: without the package websockets
    Raises OutputError: the port is taken
    """

    def __init__(
        self, page: str, row: Callable[[NDArray[np.void]], list[float]], scene: str, port: int,
        feed: Feed,
    ) -> None:  # fmt: skip
        serve = _serve()
        self._page, self._row, self._scene, self._feed = page.encode(), row, scene, feed
        self.refused = 0  # clients beyond the most
        try:
            listening = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            raise OutputError(f"port {port} of 127.0.0.1: {error.strerror}") from None
        self.port = listening.getsockname()[1]
        self._hosts = [f"{name}:{self.port}" for name in ("127.0.0.1", "localhost")]
        self._server = serve(
            self._show, sock=listening, origins=[f"http://{host}" for host in self._hosts],
            process_request=self._answer, open_timeout=ASKED_S, logger=_SILENT, compression=None,
        )  # fmt: skip
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Let every client go, also one that takes nothing."""
        for connection in self._server.connections:
            with suppress(OSError):
                connection.socket.shutdown(socket.SHUT_RDWR)
        self._server.shutdown()
        self._thread.join()

    def _answer(self, connection: Any, request: Any) -> Any:
        """The page, or nothing for the WebSocket; a foreign name for this place gets neither."""
        if request.headers.get("Host") not in self._hosts:
            return connection.respond(403, "this page is served to 127.0.0.1 and localhost only")
        if request.path == "/ticks":
            return None
        if request.path != "/":
            return connection.respond(404, "there is one page, /")
        answer = connection.respond(200, "")
        for name, value in {"Content-Type": "text/html; charset=utf-8",
                            "Content-Length": str(len(self._page))}.items():  # fmt: skip
            del answer.headers[name]
            answer.headers[name] = value
        answer.body = self._page
        return answer

    def _show(self, connection: Any) -> None:
        if len(self._server.connections) > MOST_CLIENTS:
            self.refused += 1
            connection.close(1013, f"{MOST_CLIENTS} clients are served, and no more")
            return
        seen = -1
        connection.send(json.dumps({"scene": self._scene}))
        while True:  # until the connection is closed, which sending and receiving raise
            seen, due = self._feed.after(seen, QUIET_S)
            if due:
                connection.send(json.dumps({"ticks": [self._row(tick) for tick in due]}))
            with suppress(TimeoutError):
                connection.recv(timeout=0)


def _serve() -> Callable[..., Any]:
    with needing("the page needs the package websockets", "live"):
        from websockets.sync.server import serve
    return serve
