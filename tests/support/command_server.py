"""Run `vfplan` commands in forked copies of this process, which has loaded their libraries.

    python command_server.py SOCKET_DESCRIPTOR

A request is one JSON object: "words", "cwd", and "out", the folder for the command's `stdout` and
`stderr`. The answer is the exit code, or minus the number of the signal that ended the command.
Each command runs in a process of its own, as from a shell, but without loading libraries again,
which takes longer than most commands.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import socket
import sys
import traceback
from contextlib import suppress

LIBRARIES = (
    "cv2", "h5py", "matplotlib.backends.backend_agg", "matplotlib.pyplot", "pydicom",
    "scipy.linalg", "scipy.ndimage", "scipy.optimize", "scipy.spatial", "scipy.stats",
    "skimage.measure", "skimage.morphology", "vfplan._core", "vfplan.bundle",
    "vfplan.figures.slice", "vfplan.planning", "vfplan.registration", "vfplan.replaying.replay",
    "vfplan.review.sheet", "vfplan.session.result",
)  # fmt: skip


def load() -> None:
    """Import what commands import, with one thread: others would not survive a fork."""
    import vfplan.io.hdf5

    assert vfplan.io.hdf5.h5py
    for name in LIBRARIES:
        with suppress(ImportError):
            importlib.import_module(name)
    # The folder of this file is on no path, since commands shall not find it.
    sys.path.append(os.path.dirname(__file__))
    import codes

    sys.path.pop()
    codes.watch()
    import click
    import cv2
    from vfplan.cli.main import COMMANDS, cli

    cv2.setNumThreads(1)
    for name in COMMANDS:
        with suppress(ImportError):
            cli.get_command(click.Context(cli), name)


def run(request: dict) -> None:
    """The command, in this process; never returns."""
    code = 70
    for descriptor, name in ((1, "stdout"), (2, "stderr")):
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        os.dup2(os.open(os.path.join(request["out"], name), flags, 0o600), descriptor)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    try:
        os.chdir(request["cwd"])
        sys.argv = ["vfplan", *request["words"]]
        from vfplan.cli.main import cli

        cli()
    except SystemExit as end:
        code = 0 if end.code is None else end.code
        if not isinstance(code, int):
            print(code, file=sys.stderr)
            code = 1
    except BaseException:
        traceback.print_exc()
        code = 1
    finally:
        with suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        sys.modules["codes"].tell()
        os._exit(code)


def main(descriptor: int) -> None:
    """Answer one request after another until the socket closes."""
    load()
    link = socket.socket(fileno=descriptor)
    while True:
        data = link.recv(1 << 20)
        if not data:
            return
        child = os.fork()
        if child == 0:
            link.close()
            run(json.loads(data))
        _, status = os.waitpid(child, 0)
        link.send(str(os.waitstatus_to_exitcode(status)).encode())


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    main(int(sys.argv[1]))
