"""Print the figures in docs/live.md:  python docs/make_live.py [ROUNDS]

What a tick of the sample controller takes without telemetry, with it, and with it while its reader
sleeps: 5 s of each in turn, ROUNDS times (10), the median over the rounds and the
best p99.9. And what ten minutes of
ticks take as MCAP.
"""

from __future__ import annotations

import re
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

import vfplan
from vfplan.session.mcapfile import TICK, McapWriter, read_ticks

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 5
TEN_MINUTES = 600_000
STEP = re.compile(r"p50 ([\d.]+)  p99 ([\d.]+)  p99.9 ([\d.]+)")


def prepared(folder: Path) -> list[str]:
    """The sample controller's command on the sample's fixture."""
    samples, fixture = ROOT / "samples", folder / "elbow.h5"
    markers = [samples / f"elbow_markers_{side}.csv" for side in ("image", "robot")]
    made = [samples / "elbow.png", *markers, "-o", fixture, "--pixel-spacing", "0.5", "-q"]
    build = folder / "build"
    for command in (
        [Path(sys.executable).with_name("vfplan"), "plan", *made],
        ["cmake", "-S", samples / "controller", "-B", build, f"-Dvfplan_DIR={vfplan.cmake_dir()}"],
        ["cmake", "--build", build],
    ):
        subprocess.run([*map(str, command)], check=True, capture_output=True)
    first = ["chrt", "-f", "50"]  # as a controller is run, where the system lets it
    if subprocess.run([*first, "true"], check=False, capture_output=True).returncode:
        first = []
    return [
        *first,
        str(build / "controller"),
        str(fixture),
        "--unsigned",
        "--seconds",
        str(SECONDS),
    ]


def loop(command: list[str], rounds: int) -> None:
    """Print the step's percentiles, in turn so that the machine's moods strike all alike."""
    awake, asleep = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    for listening in (awake, asleep):
        listening.bind(("127.0.0.1", 0))
    threading.Thread(target=lambda: [awake.recv(2048) for _ in iter(int, 1)], daemon=True).start()
    sent = {
        name: ["--telemetry", f"127.0.0.1:{s.getsockname()[1]}"]
        for name, s in (("with a reader", awake), ("its reader sleeps", asleep))
    }
    found: dict[str, list[tuple[float, ...]]] = {}
    for _ in range(rounds):
        for name, words in {"without": [], **sent}.items():
            said = subprocess.run([*command, *words], check=True, capture_output=True, text=True)
            figures = STEP.search(said.stdout)
            assert figures is not None, said.stdout
            found.setdefault(name, []).append(tuple(map(float, figures.groups())))
    for name, rows in found.items():
        p50, p99, p999 = (statistics.median(column) for column in zip(*rows, strict=True))
        best = min(row[2] for row in rows)
        print(
            f"step [us], {name:17}: p50 {p50:.2f}  p99 {p99:.2f}  p99.9 {p999:.2f}, best {best:.2f}"
        )


def mcap(path: Path) -> None:
    """Print what ten minutes at 1 kHz take: a hand's path with the last bits of real numbers."""
    ticks = np.zeros(TEN_MINUTES, TICK)
    ticks["index"] = np.arange(TEN_MINUTES)
    ticks["t"] = ticks["index"] / 1000
    rng = np.random.default_rng(1)
    for name in ("hip", "proxy", "normal", "force"):
        ticks[name] = rng.normal(scale=1e-6, size=(TEN_MINUTES, 3)).cumsum(axis=0)
    began = time.perf_counter()
    with McapWriter(path) as writer:
        for k in range(0, TEN_MINUTES, 10):
            writer.write(ticks[k : k + 10], time.time())
    written = time.perf_counter()
    assert read_ticks(path).tobytes() == ticks.tobytes()
    read = time.perf_counter() - written
    size = path.stat().st_size / 1e6
    print(f"MCAP, 10 min: {size:.0f} MB, written in {written - began:.0f} s, read in {read:.0f} s")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        mcap(Path(name) / "ten.mcap")
        loop(prepared(Path(name)), int(sys.argv[1]) if len(sys.argv) > 1 else 10)
