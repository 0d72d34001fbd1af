"""Other processes: a sandbox for untrusted files, a pool for long work, and a page's own server.

A crafted file, or one flipped bit, can make libhdf5, an image decoder or a library for ROS bags
crash, loop without end, or take all memory. Such readers therefore run in a child process, which
sends back only numbers and JSON. A reader that crashes or exceeds a limit becomes an ordinary
error of that file.

One helper process starts when it is first needed, isolated from the current folder and the
environment (`python -I`). It forks a child for each reading and ends with the program.
"""

from __future__ import annotations

import hmac
import importlib
import json
import logging
import math
import os
import pkgutil
import secrets
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from vfplan import errors
from vfplan.errors import InputError, OutputError, VfplanError, requires_extra
from vfplan.io.files import OpenedFile, stream_over, to_json_types

try:
    import resource
except ImportError:  # Windows has none.
    resource: Any = None

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing.connection import Connection

# Bytes that a reader may take beyond what it shares with the helper. The libraries that are loaded
# take about 200 MiB, and a block of any reader below 300 MiB.
MEMORY_BYTES = 768 << 20

# Seconds of processor time between two answers. A whole slice or block takes well below one.
STEP_S = 8

# Bytes of an answer's JSON. The parent takes no more from a child, which the file may control.
MAX_HEAD_BYTES = 16 << 20

# Bytes of one array of an answer.
MAX_ARRAY_BYTES = 256 << 20

# Whether readers run in processes of their own, under limits. The helper needs sockets that keep
# messages apart and pass files on, which Linux alone has.
HAS_SANDBOX = sys.platform == "linux" and resource is not None and hasattr(os, "fork")

_ARRAY_TYPES = ("<f8", "|i1", "|u1", "<u2")


def run_in_sandbox(
    job: str, *args: Any, file: OpenedFile | BinaryIO | None = None, where: str,
    kind: type[VfplanError] = InputError,
) -> Iterator[Any]:  # fmt: skip
    """Yield what `job` yields when it is called in a child process.

    job: "module:function" of a generator function of JSON values, or of tuples of arrays
        (float64, int8, uint8, uint16)
    args: its arguments, after the file; JSON values
    file: opened here, so that it is the very file whose digest is known; handed over as a stream
    where: place of an error that names none
    kind: class of the error when the reader crashed or exceeded a limit
    Raises VfplanError: what the job raised, or one of `kind` when it did not come to its end
    """
    files = [] if file is None else [file]
    if not HAS_SANDBOX:
        logging.getLogger(__name__).info("%s is read without limits: there is no sandbox here", job)
        streams = [stream_over(each.fileno(), each) for each in files]
        yield from pkgutil.resolve_name(job)(*streams, *args)
        return
    # Late: it is slow to load.
    from multiprocessing.connection import Connection

    read_end, write_end = os.pipe()
    with Connection(read_end, writable=False) as pipe:
        try:
            request = {"job": job, "args": args, "step_s": STEP_S}
            send_request(request, [write_end, *(each.fileno() for each in files)])
        finally:
            os.close(write_end)
        while (answer := next_answer(pipe)) is not None:
            if "value" in answer:
                yield answer["value"]
            elif "error" in answer:
                name, message, details = answer["error"]
                error_class = getattr(errors, str(name), None)
                if not (isinstance(error_class, type) and issubclass(error_class, VfplanError)):
                    error_class = InputError
                details["where"] = details["where"] or where
                raise error_class(str(message), **details)
            else:
                return
    raise kind(
        f"cannot be read: its reader crashed, took more than {MEMORY_BYTES >> 20} MiB, or was busy "
        f"for {STEP_S} s without a result. Save the file again, or give a smaller one",
        where=where, code="reader-stopped",
        numbers={"memory_bytes": MEMORY_BYTES, "step_s": STEP_S},
    )  # fmt: skip


def run_once(job: str, *args: Any, **options: Any) -> Any:
    """The only value that `job` yields; otherwise as `run_in_sandbox`."""
    (value,) = run_in_sandbox(job, *args, **options)
    return value


def next_answer(pipe: Connection) -> dict[str, Any] | None:
    """The child's next answer; `None` where the child has ended without one."""
    try:
        answer = json.loads(pipe.recv_bytes(MAX_HEAD_BYTES))
        if "arrays" in answer:
            answer["value"] = tuple(read_array(pipe, *array) for array in answer["arrays"])
    except (EOFError, OSError, TypeError, ValueError):
        return None
    return answer if isinstance(answer, dict) else None


def read_array(pipe: Connection, dtype: str, shape: list[int]) -> NDArray:
    """An array of an answer, of one of the types that are sent."""
    known = np.dtype(_ARRAY_TYPES[_ARRAY_TYPES.index(dtype)])
    return np.frombuffer(bytearray(pipe.recv_bytes(MAX_ARRAY_BYTES)), known).reshape(shape)


# --- In the program: start the helper and send it requests --------------------------------------

_lock = threading.Lock()
# The process that started the helper, and the socket to it.
_helper: tuple[int, socket.socket] | None = None


def send_request(request: dict[str, Any], descriptors: list[int]) -> None:
    """Send a request to the helper, which is started if there is none.

    descriptors: of the pipe that takes the answers, and of the file if there is one
    """
    global _helper
    data = json.dumps(request).encode()
    with _lock:
        # A forked copy of the program starts a helper of its own.
        if _helper is None or _helper[0] != os.getpid():
            _helper = os.getpid(), start_helper()
        try:
            socket.send_fds(_helper[1], [data], descriptors)
        except OSError:  # The helper has ended.
            _helper = os.getpid(), start_helper()
            socket.send_fds(_helper[1], [data], descriptors)


def isolated_python(code: str, *args: str) -> list[str]:
    """The command line that runs Python code with this process's modules and no others.

    With -I neither the current folder nor PYTHON variables count. The folders that this process
    imports from are named instead, without the current one.
    """
    package_folder = str(Path(__file__).resolve().parents[2])
    apart = os.path.realpath(os.curdir), package_folder
    others = [one for one in filter(os.path.isabs, sys.path) if os.path.realpath(one) not in apart]
    folders = [*others, package_folder]
    return [sys.executable, "-I", "-c", f"import sys; sys.path[:] = {folders!r}; {code}", *args]


def start_helper() -> socket.socket:
    """Start the helper; returns the socket on which it takes requests."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        code = f"from vfplan.io.sandbox import serve; serve({theirs.fileno()})"
        # With more than one thread no child could be forked safely.
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        nowhere = subprocess.DEVNULL
        helper = subprocess.Popen(
            isolated_python(code), stdin=nowhere, stdout=nowhere, stderr=nowhere,
            pass_fds=[theirs.fileno()], env={**os.environ, **threads}, cwd="/",
            # Ctrl-C in a terminal then reaches the program alone.
            start_new_session=True,
        )  # fmt: skip
    # The helper ends by itself when `ours` closes, so nobody waits for it.
    helper.returncode = 0
    return ours


# --- In the helper and its children --------------------------------------------------------------


def serve(descriptor: int) -> NoReturn:
    """Fork a child for each request that comes by a socket, until the socket closes."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # The system removes ended children.
    link = socket.socket(fileno=descriptor)
    while True:
        data, descriptors, _, _ = socket.recv_fds(link, 1 << 16, 2)
        if not data:
            os._exit(0)
        request = json.loads(data)
        module_name, _, function_name = request["job"].partition(":")
        module = importlib.import_module(module_name)
        # A module may load its libraries here once, and not again in every child.
        if hasattr(module, "prepare"):
            module.prepare()
        if os.fork() == 0:
            link.close()
            run_job(getattr(module, function_name), request, descriptors)
        for opened in descriptors:
            os.close(opened)


def run_job(function: Any, request: dict[str, Any], descriptors: list[int]) -> NoReturn:
    """Run a job in this process under limits, send what it yields, and end the process."""
    from multiprocessing.connection import Connection

    try:
        with Connection(descriptors[0], readable=False) as pipe:
            try:
                files = map(stream_over, descriptors[1:])
                resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
                # The library rosbags unpacks compressed bags into temporary files.
                resource.setrlimit(resource.RLIMIT_FSIZE, (MEMORY_BYTES, MEMORY_BYTES))
                _set_soft_limit(resource.RLIMIT_DATA, MEMORY_BYTES)
                _extend_time(request["step_s"])
                for result in function(*files, *request["args"]):
                    _send_result(pipe, result)
                    _extend_time(request["step_s"])
                _send(pipe, {"end": True})
            except VfplanError as error:
                details = {"where": error.where, "code": error.code, "numbers": error.numbers}
                _send(pipe, {"error": [error.kind, error.message, to_json_types(details)]})
    except BaseException:
        pass  # Without an answer, the parent says that the reader was stopped.
    finally:
        os._exit(0)


def raise_limits(memory_bytes: int, seconds: int) -> None:
    """Called by a job that knows the size of its file: allow more memory and processor time."""
    if not HAS_SANDBOX:
        return
    for limit, more in ((resource.RLIMIT_DATA, memory_bytes), (resource.RLIMIT_CPU, seconds)):
        _set_soft_limit(limit, resource.getrlimit(limit)[0] + more)


def raise_limits_for(file: BinaryIO) -> None:
    """Allow a job as much more memory as twice the size of its file, which is then at its begin."""
    raise_limits(2 * file.seek(0, os.SEEK_END), 0)
    file.seek(0)


def _extend_time(step_s: int) -> None:
    _set_soft_limit(resource.RLIMIT_CPU, math.ceil(time.process_time()) + step_s)


def _set_soft_limit(limit: int, value: int) -> None:
    resource.setrlimit(limit, (value, resource.getrlimit(limit)[1]))


def _send_result(pipe: Connection, result: Any) -> None:
    if not isinstance(result, tuple):
        _send(pipe, {"value": result})
        return
    types = [a.dtype.str if a.dtype.str in _ARRAY_TYPES else "<f8" for a in result]
    shapes = [[dtype, array.shape] for dtype, array in zip(types, result, strict=True)]
    _send(pipe, {"arrays": shapes})
    for array, dtype in zip(result, types, strict=True):
        pipe.send_bytes(np.ascontiguousarray(array, dtype).tobytes())


def _send(pipe: Connection, head: dict[str, Any]) -> None:
    pipe.send_bytes(json.dumps(head).encode())


# --- Processes of a pool -----------------------------------------------------------------------

SAFE_PATH = "PYTHONSAFEPATH"


@contextmanager
def worker_processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of `count` processes.

    They import nothing from the current folder. An exception in the block, and thus a signal, ends
    them at once, whatever they do.
    """
    # Here and not above, because whoever reads a file in the sandbox needs none of it.
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import active_children, get_context

    others = set(active_children())
    safe_path_before = os.environ.get(SAFE_PATH)
    # Python is started by -c, which would look for modules in the current folder.
    os.environ[SAFE_PATH] = "1"
    # "spawn", because a forked copy of a process with threads may hang.
    pool = ProcessPoolExecutor(count, get_context("spawn"), begin_worker)
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


def begin_worker() -> None:
    """Prepare a worker: its signals, and its end with the program."""
    # Ctrl-C reaches the workers too, but the program alone decides what ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # On Linux the system ends this process when the program ends, also by SIGKILL (prctl's
    # PR_SET_PDEATHSIG). Elsewhere a killed program leaves its workers waiting.
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(1, signal.SIGKILL)


# Seconds after which a connection that asks for nothing is closed; browsers open such ones.
OPEN_TIMEOUT_S = 2.0

# Connections at a time. Each takes up to four descriptors, and a process has at least 256.
MAX_CONNECTIONS = 48

# Seconds that a client whose buffers are full may take nothing before it is dropped.
SEND_TIMEOUT_S = 1

# Seconds between two looks at a listening socket that could not accept.
ACCEPT_PAUSE_S = 0.05

_SILENT = logging.Logger("websockets", logging.CRITICAL + 1)


class Listener(socket.socket):
    """A listening socket that no number of connections ends.

    Where there are too many, the oldest that has not become a WebSocket is closed.
    """

    websockets: Callable[[], Collection[socket.socket]]
    accepted: tuple[socket.socket, ...] = ()

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection; raises `OSError` once the socket is closed."""
        while True:
            try:
                connection, address = super().accept()
                break
            except OSError:
                if self.fileno() < 0:
                    raise
                # There was no descriptor left, or the client is gone again.
                time.sleep(ACCEPT_PAUSE_S)
        limit = struct.pack("@ll", SEND_TIMEOUT_S, 0)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
        self.accepted = *(one for one in self.accepted if one.fileno() >= 0), connection
        if len(self.accepted) > MAX_CONNECTIONS:
            kept = self.websockets()
            oldest = next(one for one in self.accepted if one not in kept)
            self.accepted = tuple(one for one in self.accepted if one is not oldest)
            with suppress(OSError):
                oldest.shutdown(socket.SHUT_RDWR)
        return connection, address


class Loopback:
    """Serves one program's own pages and WebSockets on 127.0.0.1 until it is closed.

    Any web page that is open in the same browser can reach a port of this computer. So a foreign
    name for the address is refused (DNS rebinding), and a WebSocket is opened for pages from here
    alone.

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
        self, port: int, answer: Callable[[Any, Any], Any], talk: Callable[[Any], None],
        max_message_bytes: int = 2**20,
    ) -> None:  # fmt: skip
        with requires_extra("the page needs the package websockets", "live"):
            from websockets.sync.server import serve
        try:
            listening = Listener(fileno=socket.create_server(("127.0.0.1", port)).detach())
        except OSError as error:
            raise OutputError(
                f"port {port} of 127.0.0.1 cannot be used: {error.strerror}. Give another port",
                code="port-taken", numbers={"port": port},
            ) from None  # fmt: skip
        self.port = listening.getsockname()[1]
        self.token = secrets.token_urlsafe(32)
        self.hosts = [f"{name}:{self.port}" for name in ("127.0.0.1", "localhost")]

        def answer_own_host(connection: Any, request: Any) -> Any:
            if request.headers.get("Host") in self.hosts:
                return answer(connection, request)
            return connection.respond(403, "this page is served to 127.0.0.1 and localhost only")

        self._server = serve(
            talk, sock=listening, origins=[f"http://{host}" for host in self.hosts],
            process_request=answer_own_host, open_timeout=OPEN_TIMEOUT_S,
            max_size=max_message_bytes, logger=_SILENT, compression=None,
        )  # fmt: skip
        listening.settimeout(ACCEPT_PAUSE_S)
        listening.websockets = lambda: [connection.socket for connection in self.connections]
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """What to open in a browser; whoever knows it has the token."""
        return f"http://127.0.0.1:{self.port}/#{self.token}"

    def has_token(self, query: dict[str, list[str]]) -> bool:
        """Whether the parts of an address, as `parse_qs` gives them, hold this run's token."""
        return hmac.compare_digest(query.get("token", [""])[0].encode(), self.token.encode())

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
        response.headers.pop(name, None)
        response.headers[name] = value
    response.body = body
    return response
