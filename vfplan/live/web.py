"""A page to watch, and its ticks by WebSocket: on the loopback, for pages that came from here."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.io.loopback import Loopback, reply
from vfplan.live.sources import MAX_CLIENTS, WAIT_S, PositionStream


class Web:
    """Serves until it is closed.

    page: HTML text; it opens a WebSocket at /ticks
    row: a tick as the page's script takes it
    scene: names what the page shows; a page that shows another scene loads itself anew
    port: 0: one that the system chooses; see `port`
    feed: what is shown
    Raises MissingExtra: without the package websockets
    Raises OutputError: the port is taken
    """

    def __init__(
        self,
        page: str,
        row: Callable[[NDArray[np.void]], list[float]],
        scene: str,
        port: int,
        feed: PositionStream,
    ) -> None:
        self._page = page.encode()
        self._row = row
        self._scene = scene
        self._feed = feed
        # Clients that were refused because there were too many.
        self.refused = 0
        self._server = Loopback(port, self.answer, self.show)
        self.port = self._server.port

    def close(self) -> None:
        """Disconnect every client, also one that takes nothing."""
        self._server.close()

    def answer(self, connection: Any, request: Any) -> Any:
        """Answer a request: the page, or nothing for the WebSocket."""
        if request.path == "/ticks":
            return None
        if request.path != "/":
            return connection.respond(404, "there is one page, /")
        return reply(connection, self._page, "text/html; charset=utf-8")

    def show(self, connection: Any) -> None:
        """Send ticks until the connection is closed, which sending or receiving raises."""
        if len(self._server.connections) > MAX_CLIENTS:
            self.refused += 1
            connection.close(1013, f"{MAX_CLIENTS} clients are served, and no more")
            return
        count = -1
        connection.send(json.dumps({"scene": self._scene}))
        while True:
            count, ticks = self._feed.after(count, WAIT_S)
            if ticks:
                connection.send(json.dumps({"ticks": [self._row(tick) for tick in ticks]}))
            with suppress(TimeoutError):
                connection.recv(timeout=0)
