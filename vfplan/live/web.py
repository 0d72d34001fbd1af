"""A page to watch, and its ticks by WebSocket: on the loopback, for pages that came from here."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.io.loopback import Loopback, reply
from vfplan.live.sources import MOST_CLIENTS, Feed

QUIET_S = 0.2  # a client that went is noticed as soon, at least


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
        self._page, self._row, self._scene, self._feed = page.encode(), row, scene, feed
        self.refused = 0  # clients beyond the most
        self._server = Loopback(port, self._answer, self._show)
        self.port = self._server.port

    def close(self) -> None:
        """Let every client go, also one that takes nothing."""
        self._server.close()

    def _answer(self, connection: Any, request: Any) -> Any:
        """The page, or nothing for the WebSocket."""
        if request.path == "/ticks":
            return None
        if request.path != "/":
            return connection.respond(404, "there is one page, /")
        return reply(connection, self._page, "text/html; charset=utf-8")

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
