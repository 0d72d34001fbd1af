"""Print the speed in docs/replay.md:  python docs/make_replay_speed.py

A minute at 1 kHz, the sample's session to and fro, replayed against the sample's fixture; reading
the bundle and the CSV and all the numbers of a report are in it. The best of forty runs: on a busy
machine one of them may have had a core to itself.
"""

from __future__ import annotations

import tempfile
import time
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

import vfplan
from vfplan.planning import ExtractSettings, plan
from vfplan.replaying import replay

TICKS = 60_000
RUNS = 40


def prepared(sample: Path, folder: Path) -> tuple[Path, Path]:
    """The fixture and the session of a minute."""
    fixture, session = folder / "fixture.h5", folder / "session.csv"
    made = plan(
        sample / "elbow.png",
        sample / "elbow_markers_image.csv",
        sample / "elbow_markers_robot.csv",
        extraction=ExtractSettings(pixel_spacing_mm=(0.5, 0.5)),
    )
    vfplan.write_fixture(made.fixture, fixture)
    hip = vfplan.read_session(sample / "elbow_session.csv").hip
    there = np.concatenate([hip, hip[::-1]])
    rows = np.resize(there, (TICKS, 3))
    lines = (f"{k / 1e3:.3f},{x:.7f},{y:.7f},{z:.7f}\n" for k, (x, y, z) in enumerate(rows))
    session.write_text("t,x,y,z\n" + "".join(lines))
    return fixture, session


def main() -> None:
    """Replay and print."""
    with tempfile.TemporaryDirectory() as name, as_file(files("vfplan.samples")) as sample:
        fixture, session = prepared(sample, Path(name))
        cpu, wall = [], []
        for _ in range(RUNS):
            began = time.process_time(), time.perf_counter()
            found = replay(fixture, session, keep=0).metrics
            cpu.append(time.process_time() - began[0])
            wall.append(time.perf_counter() - began[1])
    length = found["duration_s"]
    print(
        f"{found['ticks']} ticks, {found['contact_ticks'] / found['ticks']:.0%} in contact, "
        f"{found['scene']['points']} points: {min(cpu):.2f} s of processor time, "
        f"{length / min(cpu):.0f} times real time; {length / min(wall):.0f} times by the wall clock"
    )


if __name__ == "__main__":
    main()
