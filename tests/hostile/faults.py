"""Run commands in forked copies of this process, each with one failing write; see test_faults.py.

    LD_PRELOAD=fault_shim.so python faults.py FOLDER ERRNO < cases.json

A case is {"name", "words", "keep"}: a command, run in a copy of FOLDER. Prints, as JSON, what each
run left behind: exit code, stdout, stderr, and whether the folder is as it was.
"""

from __future__ import annotations

import ctypes
import io
import json
import os
import shutil
import sys
import tempfile
from contextlib import chdir, redirect_stdout, suppress
from pathlib import Path


def contents(folder):
    """Every file's name, mode and bytes, hidden ones too."""
    found = sorted(path for path in folder.rglob("*"))
    return {
        str(p.relative_to(folder)): (p.stat().st_mode, p.read_bytes() if p.is_file() else b"")
        for p in found
    }


def forked(words, folder, nth, number, shim):
    """(exit code or minus the signal, stdout, stderr, writes counted) of one run."""
    pipes = [os.pipe() for _ in range(3)]
    child = os.fork()
    if child == 0:
        for target, (_, end) in zip((1, 2, 100), pipes, strict=True):
            os.dup2(end, target)
        os.chdir(folder)
        code = 70
        shim.fault_arm(nth, number)
        try:
            from vfplan.cli.main import cli

            cli.main(words)
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os.write(100, str(shim.fault_count()).encode())
            os._exit(code)
    for _, end in pipes:
        os.close(end)
    texts = []
    for end, _ in pipes:
        with open(end, encoding="utf-8", errors="replace") as pipe:
            texts.append(pipe.read())
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), texts[0], texts[1], int(texts[2] or 0)


def warm(words, source):
    """Once in this process: what the command imports is there, in every copy."""
    from vfplan.cli.main import cli

    with tempfile.TemporaryDirectory() as place:
        shutil.copytree(source, place, dirs_exist_ok=True)
        with chdir(place), redirect_stdout(io.StringIO()), suppress(SystemExit):
            cli.main(words)


def outcomes(case, source, number, shim):
    """One row a write of the command: what came when it failed."""
    warm(case["words"], source)
    writes, row = 1, 0
    while row <= writes:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "work"
            shutil.copytree(source, folder)
            before = contents(folder)
            nth = row - 1  # the first run counts
            code, out, err, counted = forked(case["words"], folder, nth, number, shim)
            writes = counted if row == 0 else writes
            same = contents(folder) == before
        yield {"case": case["name"], "write": nth, "of": writes, "code": code, "stdout": out,
               "stderr": err, "as_before": same}  # fmt: skip
        row += 1


def main(source, number):
    import cv2

    cv2.setNumThreads(1)  # no threads may stand in a process that forks
    from vfplan.cli.main import COMMANDS, cli

    for name in COMMANDS:
        cli.get_command(None, name)
    shim = ctypes.CDLL(os.environ["LD_PRELOAD"])
    cases = json.load(sys.stdin)
    rows = [row for case in cases for row in outcomes(case, Path(source), number, shim)]
    json.dump(rows, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
