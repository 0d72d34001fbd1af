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
from vfplan.planning.plan import plan
from vfplan.planning.settings import ExtractSettings
from vfplan.replaying.replay import replay

TICKS = 60_000
RUNS = 40


def prepared(sample: Path, folder: Path) -> tuple[Path, Path]:
    """The fixture and the session of a minute."""
    fixture = folder / "fixture.h5"
    session = folder / "session.csv"
    result = plan(
        sample / "elbow.png",
        sample / "elbow_markers_image.csv",
        sample / "elbow_markers_robot.csv",
        extraction=ExtractSettings(pixel_spacing_mm=(0.5, 0.5)),
    )
    vfplan.write_fixture(result.fixture, fixture)
    hip = vfplan.read_session(sample / "elbow_session.csv").hip
    to_and_fro = np.concatenate([hip, hip[::-1]])
    lines = ["t,x,y,z"]
    for k, (x, y, z) in enumerate(np.resize(to_and_fro, (TICKS, 3))):
        lines.append(f"{k / 1e3:.3f},{x:.7f},{y:.7f},{z:.7f}")
    session.write_text("\n".join(lines) + "\n")
    return fixture, session


def main() -> None:
    """Replay and print."""
    with tempfile.TemporaryDirectory() as name, as_file(files("vfplan.samples")) as sample:
        fixture, session = prepared(sample, Path(name))
        processor_s = []
        wall_s = []
        for _ in range(RUNS):
            processor_start = time.process_time()
            wall_start = time.perf_counter()
            metrics = replay(fixture, session, keep=0).metrics
            processor_s.append(time.process_time() - processor_start)
            wall_s.append(time.perf_counter() - wall_start)
    duration_s = metrics["duration_s"]
    contact = metrics["contact_ticks"] / metrics["ticks"]
    print(
        f"{metrics['ticks']} ticks, {contact:.0%} in contact, {metrics['scene']['points']} points: "
        f"{min(processor_s):.2f} s of processor time, {duration_s / min(processor_s):.0f} times "
        f"real time; {duration_s / min(wall_s):.0f} times by the wall clock"
    )


if __name__ == "__main__":
    main()
