"""Print what commands cost beside another build, in processor time:

    python docs/make_command_costs.py --beside PYTHON
    python docs/make_command_costs.py --beside PYTHON --runs 15

PYTHON is the interpreter of an environment with another build of vfplan. Both builds run by turns,
on one thread, so that both meet the same machine. Times are user and system together, of the whole
process: its start and its imports are in it.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

import vfplan

RUNS = 7
TICKS = 60_000
"""Ticks of the replayed session: a minute at 1 kHz."""


def main() -> None:
    """Run each command by turns, and print its costs and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--beside", metavar="PYTHON", required=True)
    parser.add_argument("--runs", type=int, default=RUNS)
    arguments = parser.parse_args()

    print(f"{'command':16}{'other build':>12}{'this build':>12}{'ratio':>8}")
    with tempfile.TemporaryDirectory() as name, as_file(files("vfplan.samples")) as sample:
        folder = Path(name)
        inputs = ["elbow.png", "elbow_markers_image.csv", "elbow_markers_robot.csv"]
        plan = ["plan", *(str(sample / file) for file in inputs), "--overwrite"]
        session = str(write_session(sample, folder))
        # A build from before the review sheet has no option that leaves it out.
        words = [arguments.beside, "-m", "vfplan", "plan", "--help-all"]
        help_text = subprocess.run(words, capture_output=True, text=True).stdout
        bare = ["--no-sheet"] if "--no-sheet" in help_text else []
        commands = {
            "plan --help": (["plan", "--help"], ["plan", "--help"]),
            "plan --no-sheet": (
                [*plan, "-o", "old.h5", *bare],
                [*plan, "-o", "new.h5", "--no-sheet"],
            ),
            "plan": ([*plan, "-o", "old.h5"], [*plan, "-o", "new.h5"]),
            "replay": (["replay", "old.h5", session], ["replay", "new.h5", session]),
        }
        for label, (other, own) in commands.items():
            other_s = []
            own_s = []
            for run in range(arguments.runs + 1):
                other_cost = processor_time(arguments.beside, other, folder)
                own_cost = processor_time(sys.executable, own, folder)
                if run > 0:  # The first run fills the caches.
                    other_s.append(other_cost)
                    own_s.append(own_cost)
            other_median = statistics.median(other_s)
            own_median = statistics.median(own_s)
            ratio = own_median / other_median
            print(f"{label:16}{other_median:10.3f} s{own_median:10.3f} s{ratio:8.3f}")


def write_session(sample: Path, folder: Path) -> Path:
    """A minute of the sample's session, to and fro."""
    hip = vfplan.read_session(sample / "elbow_session.csv").hip
    to_and_fro = np.concatenate([hip, hip[::-1]])
    lines = ["t,x,y,z"]
    for tick, (x, y, z) in enumerate(np.resize(to_and_fro, (TICKS, 3))):
        lines.append(f"{tick / 1e3:.3f},{x:.7f},{y:.7f},{z:.7f}")
    path = folder / "session.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def processor_time(python: str, arguments: list[str], folder: Path) -> float:
    """Seconds of user and system time that one command takes."""
    environment = dict(os.environ)
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
        environment[variable] = "1"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [python, "-m", "vfplan", *arguments]
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if result.returncode != 0:
        sys.exit(f"{' '.join(command)} ended with {result.returncode}:\n{result.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
