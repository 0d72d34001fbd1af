"""Read files from others in a process apart, with limits on its memory and its time.

libhdf5 and the libraries that read ROS bags can be made to crash, to loop without end or to take
all memory by a file made for it, or by one flipped bit. They therefore read in a process of their
own, which does nothing else: what comes back is numbers and JSON. A reader that ends early, or is
ended by a limit, is an error as any other of that file.

One helper process, started when it is first needed and isolated from the current folder and the
environment (`python -I`), forks a child for each reading; it ends with the program.
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
from vfplan.io.disk import jsonable
from vfplan.io.reading import OneFile, stream_over

MEMORY_BYTES = 768 << 20  # of a reader, beyond what it shares with the helper
STEP_S = 8  # of a processor's time between two answers
_TYPES = ("<f8", "|i1", "|u1", "<u2")
_LENGTH = struct.Struct("<Q")
_MOST_HEAD, _MOST_ARRAY = 16 << 20, 256 << 20


def apart(
    job: str,
    *args: Any,
    file: OneFile | BinaryIO | None = None,
    where: str,
    kind: type[VfplanError] = InputError,
) -> Iterator[Any]:
    """What `job`, "module:function" of vfplan, yields when it is called in a process apart.

    job: a generator function of JSON values, or of tuples of arrays: float64, int8, uint8, uint16
    args: its arguments, after the file; JSON values
    file: opened here, so that it is the very file whose digest is known; handed over as a stream
    where, kind: the name in, and the kind of, the error of a reader that crashed or was ended
    Raises VfplanError: what the job raised, or one of `kind` when it did not come to its end
    """
    read_end, write_end = os.pipe()
    with open(read_end, "rb") as pipe:
        try:
            request = {"job": job, "args": args, "file": file is not None, "step_s": STEP_S}
            _ask(request, write_end, file)
        finally:
            os.close(write_end)
        while (answer := _received(pipe)) is not None:
            if "value" in answer:
                yield answer["value"]
            elif "arrays" in answer:
                yield tuple(_array(pipe, *shape) for shape in answer["arrays"])
            elif "error" in answer:
                _raise(answer["error"])
            else:
                return
    raise kind(
        f"cannot be read: its reader crashed, took more than {MEMORY_BYTES >> 20} MiB, or was busy "
        f"for {STEP_S} s without a result",
        where=where,
    )


def one(job: str, *args: Any, **given: Any) -> Any:
    """The one value that `job` yields; else as `apart`."""
    (value,) = apart(job, *args, **given)
    return value


def _raise(error: dict[str, Any]) -> NoReturn:
    kind = getattr(errors, str(error["kind"]), InputError)
    known = isinstance(kind, type) and issubclass(kind, VfplanError)
    raise (kind if known else InputError)(
        str(error["message"]),
        where=error["where"],
        code=error.get("code"),
        numbers=error.get("numbers"),
    )


def _received(pipe: BinaryIO) -> dict[str, Any] | None:
    """The next answer's head; `None` where there is none: the child is no more."""
    try:
        head = _exactly(pipe, _LENGTH.unpack(_exactly(pipe, 8))[0], _MOST_HEAD)
        answer = json.loads(head)
    except (EOFError, ValueError):
        return None
    return answer if isinstance(answer, dict) else None


def _array(pipe: BinaryIO, kind: str, shape: list[int]) -> np.ndarray:
    size = math.prod(shape) * np.dtype(_TYPES[_TYPES.index(kind)]).itemsize
    return np.frombuffer(bytearray(_exactly(pipe, size, _MOST_ARRAY)), kind).reshape(shape)


def _exactly(pipe: BinaryIO, size: int, most: int = 8) -> bytes:
    data = pipe.read(size) if 0 <= size <= most else b""
    if len(data) != size:
        raise EOFError
    return data


# --- The helper's side of the program ----------------------------------------------------------

_lock = threading.Lock()
_helper: tuple[int, socket.socket] | None = None  # the process that started it, the way to it


def _ask(request: dict[str, Any], answers: int, file: OneFile | BinaryIO | None) -> None:
    global _helper
    data = json.dumps(request).encode()
    handed = [answers] if file is None else [answers, file.fileno()]
    with _lock:
        for attempt in range(2):
            if _helper is None or _helper[0] != os.getpid():
                _helper = os.getpid(), _start()
            try:
                socket.send_fds(_helper[1], [data], handed)
            except OSError:  # it is gone; once more with a new one
                _helper = None
                if attempt:
                    raise
            else:
                return


def isolated(code: str, *args: str) -> list[str]:
    """The words that run Python code which may import what this process can, whatever lies about.

    With -I neither the current folder nor PYTHON variables count; the folders that this process
    imports from, the current one aside, are named instead.
    """
    here = os.path.realpath(os.curdir)
    own = str(Path(__file__).resolve().parents[2])
    paths = [p for p in sys.path if os.path.isabs(p) and os.path.realpath(p) not in (here, own)]
    return [
        sys.executable,
        "-I",
        "-c",
        f"import sys; sys.path[:] = {[*paths, own]!r}; {code}",
        *args,
    ]


def _start() -> socket.socket:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        code = f"from vfplan.io.apart import serve; serve({theirs.fileno()})"
        # One thread, or no child could be forked safely; out of the terminal's process group, so
        # that Ctrl-C comes to the program alone.
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        helper = subprocess.Popen(
            isolated(code),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            start_new_session=True,
            env={**os.environ, **threads},
            cwd="/",
        )
    helper.returncode = 0  # it ends by itself when `ours` closes: nobody waits for it
    return ours


# --- In the helper and its children ------------------------------------------------------------


def serve(descriptor: int) -> NoReturn:
    """Fork a child for each request that comes by a socket, until it closes."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # children go without a trace
    link = socket.socket(fileno=descriptor)
    while True:
        data, handed, _, _ = socket.recv_fds(link, 1 << 16, 2)
        if not data:
            os._exit(0)
        request = json.loads(data)
        module, _, name = request["job"].partition(":")
        loaded = importlib.import_module(module)
        getattr(loaded, "prepare", lambda: None)()  # once, not in every child
        function = getattr(loaded, name)
        if os.fork() == 0:
            link.close()
            _work(function, request, handed)
        for end in handed:
            os.close(end)


def _work(function: Any, request: dict[str, Any], handed: list[int]) -> NoReturn:
    try:
        with open(handed[0], "wb") as pipe:
            try:
                given = [stream_over(handed[1])] if request["file"] else []
                _limit(request["step_s"])
                for found in function(*given, *request["args"]):
                    _answer(pipe, found)
                    _more_time(request["step_s"])
                _send(pipe, {"end": True})
            except VfplanError as error:
                what = {
                    "kind": error.kind,
                    "message": error.message,
                    "where": error.where,
                    "code": error.code,
                    "numbers": jsonable(error.numbers),
                }
                _send(pipe, {"error": what})
            except MemoryError:
                pass  # as the parent says it of a reader without an end
    except BaseException:
        pass
    finally:
        os._exit(0)


def _limit(step_s: int) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # rosbags unpacks compressed bags into temporary files.
    resource.setrlimit(resource.RLIMIT_FSIZE, (MEMORY_BYTES, MEMORY_BYTES))
    _soften(resource.RLIMIT_DATA, MEMORY_BYTES)
    _more_time(step_s)


def allow(memory_bytes: int, seconds: int) -> None:
    """Called by a job: so much more of both, for what is as large as it says."""
    _soften(resource.RLIMIT_DATA, resource.getrlimit(resource.RLIMIT_DATA)[0] + memory_bytes)
    _soften(resource.RLIMIT_CPU, resource.getrlimit(resource.RLIMIT_CPU)[0] + seconds)


def _more_time(step_s: int) -> None:
    _soften(resource.RLIMIT_CPU, math.ceil(time.process_time()) + step_s)


def _soften(limit: int, value: int) -> None:
    resource.setrlimit(limit, (value, resource.getrlimit(limit)[1]))


def _answer(pipe: BinaryIO, found: Any) -> None:
    if not isinstance(found, tuple):
        _send(pipe, {"value": found})
        return
    kinds = [part.dtype.str if part.dtype.str in _TYPES else "<f8" for part in found]
    arrays = [np.ascontiguousarray(a, kind) for a, kind in zip(found, kinds, strict=True)]
    shapes = [[kind, a.shape] for kind, a in zip(kinds, arrays, strict=True)]
    _send(pipe, {"arrays": shapes}, *(a.tobytes() for a in arrays))


def _send(pipe: BinaryIO, head: dict[str, Any], *data: bytes) -> None:
    text = json.dumps(head).encode()
    pipe.writelines((_LENGTH.pack(len(text)), text, *data))
    pipe.flush()
