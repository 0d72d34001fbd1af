"""Worker processes for long work, isolated from the current folder, that end with the program.

A server for one program's own page: on the loopback only, and for that page only.

Any web page that is open in the same browser can reach a port of this computer. So a foreign name
for the address is refused (DNS rebinding), and a WebSocket is opened for pages from here alone.
"""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import active_children, get_context
from typing import Any

from vfplan.errors import OutputError, requires_extra

SAFE_PATH = "PYTHONSAFEPATH"


@contextmanager
def worker_processes(
    count: int, initializer: Callable[..., None] | None = None, *args: Any
) -> Iterator[ProcessPoolExecutor]:
    """A pool of `count` processes, each of which first calls `initializer(*args)`.

    They import nothing from the current folder. An exception in the block, and thus a signal, ends
    them at once, whatever they do.
    """
    others = set(active_children())
    safe_path_before = os.environ.get(SAFE_PATH)
    # Python is started by -c, which would look for modules in the current folder.
    os.environ[SAFE_PATH] = "1"
    # "spawn", because a forked copy of a process with threads may hang.
    pool = ProcessPoolExecutor(count, get_context("spawn"), begin_worker, (initializer, *args))
    try:
        yield pool
    except BaseException:
        for child in set(active_children()) - others:
            child.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        if safe_path_before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = safe_path_before


def begin_worker(initializer: Callable[..., None] | None, *args: Any) -> None:
    """Prepare a worker: its signals, its end with the program, and what the caller wants."""
    # Ctrl-C reaches the workers too, but the program alone decides what ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # On Linux the system ends this process when the program ends, also by SIGKILL (prctl's
    # PR_SET_PDEATHSIG). Elsewhere a killed program leaves its workers waiting.
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    if initializer is not None:
        initializer(*args)


OPEN_TIMEOUT_S = 2.0
"""Seconds after which a connection that asks for nothing is closed; browsers open such ones."""

_SILENT = logging.Logger("websockets", logging.CRITICAL + 1)


class Loopback:
    """Serves pages and WebSockets on 127.0.0.1 until it is closed.

    Parameters
    ----------
    port
        0: one that the system chooses; see `port`.
    answer
        Called with a connection and a request; returns what to send, `reply` makes it, or `None`
        where the request shall become a WebSocket.
    talk
        Called with each WebSocket's connection in a thread of its own; ends with the connection.
    max_message_bytes
        A longer message ends its connection.

    Raises
    ------
    MissingExtra
        The package websockets is not installed.
    OutputError
        The port is taken.
    """

    def __init__(
        self,
        port: int,
        answer: Callable[[Any, Any], Any],
        talk: Callable[[Any], None],
        max_message_bytes: int = 2**20,
    ) -> None:
        with requires_extra("the page needs the package websockets", "live"):
            from websockets.sync.server import serve
        try:
            listening = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            raise OutputError(
                f"port {port} of 127.0.0.1 cannot be used: {error.strerror}. Give another port",
                code="port-taken",
                numbers={"port": port},
            ) from None
        self.port = listening.getsockname()[1]
        self.hosts = [f"{name}:{self.port}" for name in ("127.0.0.1", "localhost")]

        def answer_own_host(connection: Any, request: Any) -> Any:
            if request.headers.get("Host") not in self.hosts:
                return connection.respond(
                    403, "this page is served to 127.0.0.1 and localhost only"
                )
            return answer(connection, request)

        self._server = serve(
            talk,
            sock=listening,
            origins=[f"http://{host}" for host in self.hosts],
            process_request=answer_own_host,
            open_timeout=OPEN_TIMEOUT_S,
            max_size=max_message_bytes,
            logger=_SILENT,
            compression=None,
        )
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def connections(self) -> set[Any]:
        """The WebSockets that are open."""
        return self._server.connections

    def close(self) -> None:
        """Let every client go, also one that takes nothing."""
        for connection in list(self.connections):
            with suppress(OSError):
                connection.socket.shutdown(socket.SHUT_RDWR)
        self._server.shutdown()
        self._thread.join()


def reply(connection: Any, body: bytes, kind: str, headers: dict[str, str] | None = None) -> Any:
    """An answer with a body of a media type, and further headers."""
    response = connection.respond(200, "")
    all_headers = {"Content-Type": kind, "Content-Length": str(len(body)), **(headers or {})}
    for name, value in all_headers.items():
        if name in response.headers:
            del response.headers[name]
        response.headers[name] = value
    response.body = body
    return response
