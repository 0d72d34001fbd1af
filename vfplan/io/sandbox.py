"""Read untrusted files in a child process with limits on its memory and time.

A crafted file, or one flipped bit, can make libhdf5, an image decoder or a library for ROS bags
crash, loop without end, or take all memory. Such readers therefore run in a child process, which
sends back only numbers and JSON. A reader that crashes or exceeds a limit becomes an ordinary
error of that file.

One helper process starts when it is first needed, isolated from the current folder and the
environment (`python -I`). It forks a child for each reading and ends with the program.
"""

from __future__ import annotations

import importlib
import json
import math
import os
import resource
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np

from vfplan import errors
from vfplan.errors import InputError, VfplanError
from vfplan.io.files import OpenedFile, stream_over, to_json_types

MEMORY_BYTES = 768 << 20
"""Bytes that a reader may take beyond what it shares with the helper. The libraries that are
loaded take about 200 MiB, and a block of any reader below 300 MiB."""

STEP_S = 8
"""Seconds of processor time between two answers. A whole slice or block takes well below one."""

MAX_HEAD_BYTES = 16 << 20
"""Bytes of an answer's JSON. The parent takes no more from a child, which the file may control."""

MAX_ARRAY_BYTES = 256 << 20
"""Bytes of one array of an answer."""

_ARRAY_TYPES = ("<f8", "|i1", "|u1", "<u2")
_LENGTH = struct.Struct("<Q")


def run_in_sandbox(
    job: str,
    *args: Any,
    file: OpenedFile | BinaryIO | None = None,
    where: str,
    kind: type[VfplanError] = InputError,
) -> Iterator[Any]:
    """Yield what `job` yields when it is called in a child process.

    job: "module:function" of a generator function of JSON values, or of tuples of arrays
        (float64, int8, uint8, uint16)
    args: its arguments, after the file; JSON values
    file: opened here, so that it is the very file whose digest is known; handed over as a stream
    where, kind: place and class of the error when the reader crashed or exceeded a limit
    Raises VfplanError: what the job raised, or one of `kind` when it did not come to its end
    """
    read_end, write_end = os.pipe()
    with open(read_end, "rb") as pipe:
        try:
            request = {"job": job, "args": args, "file": file is not None, "step_s": STEP_S}
            send_request(request, write_end, file)
        finally:
            os.close(write_end)
        while True:
            answer = next_answer(pipe)
            if answer is None:
                break
            if "value" in answer:
                yield answer["value"]
            elif "arrays" in answer:
                arrays = []
                for dtype, shape in answer["arrays"]:
                    known = np.dtype(_ARRAY_TYPES[_ARRAY_TYPES.index(dtype)])
                    size = math.prod(shape) * known.itemsize
                    data = bytearray(_read_exactly(pipe, size, MAX_ARRAY_BYTES))
                    arrays.append(np.frombuffer(data, known).reshape(shape))
                yield tuple(arrays)
            elif "error" in answer:
                record = answer["error"]
                error_class = getattr(errors, str(record["kind"]), None)
                if not (isinstance(error_class, type) and issubclass(error_class, VfplanError)):
                    error_class = InputError
                raise error_class(
                    str(record["message"]),
                    where=record["where"],
                    code=record.get("code"),
                    numbers=record.get("numbers"),
                )
            else:
                return
    raise kind(
        f"cannot be read: its reader crashed, took more than {MEMORY_BYTES >> 20} MiB, or "
        f"was busy for {STEP_S} s without a result. Save the file again, or give a smaller "
        "one",
        where=where,
        code="reader-stopped",
        numbers={"memory_bytes": MEMORY_BYTES, "step_s": STEP_S},
    )


def run_once(job: str, *args: Any, **options: Any) -> Any:
    """The only value that `job` yields; otherwise as `run_in_sandbox`."""
    (value,) = run_in_sandbox(job, *args, **options)
    return value


def next_answer(pipe: BinaryIO) -> dict[str, Any] | None:
    """The head of the child's next answer; `None` where the child has ended without one."""
    try:
        (length,) = _LENGTH.unpack(_read_exactly(pipe, _LENGTH.size, _LENGTH.size))
        answer = json.loads(_read_exactly(pipe, length, MAX_HEAD_BYTES))
    except (EOFError, ValueError):
        return None
    return None if not isinstance(answer, dict) else answer


def _read_exactly(pipe: BinaryIO, size: int, max_bytes: int) -> bytes:
    if not 0 <= size <= max_bytes:
        raise EOFError
    data = pipe.read(size)
    if len(data) != size:
        raise EOFError
    return data


# --- In the program: start the helper and send it requests --------------------------------------

_lock = threading.Lock()
# The process that started the helper, and the socket to it.
_helper: tuple[int, socket.socket] | None = None


def send_request(
    request: dict[str, Any], answer_pipe: int, file: OpenedFile | BinaryIO | None
) -> None:
    """Send a request to the helper, which is started if there is none."""
    global _helper
    data = json.dumps(request).encode()
    descriptors = [answer_pipe]
    if file is not None:
        descriptors.append(file.fileno())
    with _lock:
        for attempt in range(2):
            # A forked copy of the program starts a helper of its own.
            if _helper is None or _helper[0] != os.getpid():
                _helper = os.getpid(), start_helper()
            try:
                socket.send_fds(_helper[1], [data], descriptors)
            except OSError:
                # The helper has ended. Try once more with a new one.
                _helper = None
                if attempt == 1:
                    raise
            else:
                return


def isolated_python(code: str, *args: str) -> list[str]:
    """The command line that runs Python code with this process's modules and no others.

    With -I neither the current folder nor PYTHON variables count. The folders that this process
    imports from are named instead, without the current one.
    """
    current = os.path.realpath(os.curdir)
    package_folder = str(Path(__file__).resolve().parents[2])
    folders = []
    for folder in sys.path:
        if os.path.isabs(folder) and os.path.realpath(folder) not in (current, package_folder):
            folders.append(folder)
    folders.append(package_folder)
    return [sys.executable, "-I", "-c", f"import sys; sys.path[:] = {folders!r}; {code}", *args]


def start_helper() -> socket.socket:
    """Start the helper; returns the socket on which it takes requests."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        code = f"from vfplan.io.sandbox import serve; serve({theirs.fileno()})"
        # With more than one thread no child could be forked safely.
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        helper = subprocess.Popen(
            isolated_python(code),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            # Ctrl-C in a terminal then reaches the program alone.
            start_new_session=True,
            env={**os.environ, **threads},
            cwd="/",
        )
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
    try:
        with open(descriptors[0], "wb") as pipe:
            try:
                arguments = list(request["args"])
                if request["file"]:
                    arguments.insert(0, stream_over(descriptors[1]))
                resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
                # The library rosbags unpacks compressed bags into temporary files.
                resource.setrlimit(resource.RLIMIT_FSIZE, (MEMORY_BYTES, MEMORY_BYTES))
                _set_soft_limit(resource.RLIMIT_DATA, MEMORY_BYTES)
                _extend_time(request["step_s"])
                for result in function(*arguments):
                    if isinstance(result, tuple):
                        _send_arrays(pipe, result)
                    else:
                        _send(pipe, {"value": result})
                    _extend_time(request["step_s"])
                _send(pipe, {"end": True})
            except VfplanError as error:
                record = {
                    "kind": error.kind,
                    "message": error.message,
                    "where": error.where,
                    "code": error.code,
                    "numbers": to_json_types(error.numbers),
                }
                _send(pipe, {"error": record})
            except MemoryError:
                pass  # Without an answer, the parent says that the reader was stopped.
    except BaseException:
        pass
    finally:
        os._exit(0)


def raise_limits(memory_bytes: int, seconds: int) -> None:
    """Called by a job that knows the size of its file: allow more memory and processor time."""
    memory = resource.getrlimit(resource.RLIMIT_DATA)[0]
    time_s = resource.getrlimit(resource.RLIMIT_CPU)[0]
    _set_soft_limit(resource.RLIMIT_DATA, memory + memory_bytes)
    _set_soft_limit(resource.RLIMIT_CPU, time_s + seconds)


def _extend_time(step_s: int) -> None:
    _set_soft_limit(resource.RLIMIT_CPU, math.ceil(time.process_time()) + step_s)


def _set_soft_limit(limit: int, value: int) -> None:
    resource.setrlimit(limit, (value, resource.getrlimit(limit)[1]))


def _send_arrays(pipe: BinaryIO, arrays: tuple[np.ndarray, ...]) -> None:
    shapes = []
    data = []
    for array in arrays:
        dtype = array.dtype.str
        if dtype not in _ARRAY_TYPES:
            dtype = "<f8"
        shapes.append([dtype, array.shape])
        data.append(np.ascontiguousarray(array, dtype).tobytes())
    _send(pipe, {"arrays": shapes}, *data)


def _send(pipe: BinaryIO, head: dict[str, Any], *data: bytes) -> None:
    text = json.dumps(head).encode()
    pipe.writelines((_LENGTH.pack(len(text)), text, *data))
    pipe.flush()
