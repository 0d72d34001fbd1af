"""Print the figures in docs/live.md:  python docs/make_live.py [ROUNDS]

What a tick of the sample controller takes without telemetry, with it, and with it while its reader
sleeps: 5 s of each in turn, ROUNDS times (10). Printed are the median over the rounds and the best
p99.9, and what ten minutes of ticks take as MCAP.
"""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

import vfplan
from vfplan.session.bags import TICK, McapWriter, read_ticks

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 5
TEN_MINUTES = 600_000
STEP = re.compile(r"p50 ([\d.]+)  p99 ([\d.]+)  p99.9 ([\d.]+)")


def prepared(folder: Path) -> list[str]:
    """The sample controller's command on the sample's fixture."""
    samples = ROOT / "samples"
    fixture = folder / "elbow.h5"
    build = folder / "build"
    plan = [Path(sys.executable).with_name("vfplan"), "plan", samples / "elbow.png"]
    plan += [samples / "elbow_markers_image.csv", samples / "elbow_markers_robot.csv"]
    plan += ["-o", fixture, "--pixel-spacing", "0.5", "-q"]
    configure = ["cmake", "-S", samples / "controller", "-B", build]
    configure += [f"-Dvfplan_DIR={vfplan.cmake_dir()}"]
    for command in (plan, configure, ["cmake", "--build", build]):
        subprocess.run([*map(str, command)], check=True, capture_output=True)
    # A controller is run with a real-time priority, where the system lets it.
    priority = ["chrt", "-f", "50"]
    if subprocess.run([*priority, "true"], check=False, capture_output=True).returncode:
        priority = []
    return [
        *priority,
        str(build / "controller"),
        str(fixture),
        "--unsigned",
        "--seconds",
        str(SECONDS),
    ]


def loop(command: list[str], rounds: int) -> None:
    """Print the step's percentiles, in turn so that the machine's moods strike all alike."""
    reading = listening_socket()
    sleeping = listening_socket()
    threading.Thread(target=read_for_ever, args=(reading,), daemon=True).start()
    ways = {
        "without": [],
        "with a reader": ["--telemetry", f"127.0.0.1:{reading.getsockname()[1]}"],
        "its reader sleeps": ["--telemetry", f"127.0.0.1:{sleeping.getsockname()[1]}"],
    }
    percentiles: dict[str, list[tuple[float, ...]]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, words in ways.items():
            run = subprocess.run([*command, *words], check=True, capture_output=True, text=True)
            figures = STEP.search(run.stdout)
            assert figures is not None, run.stdout
            percentiles[name].append(tuple(map(float, figures.groups())))
    for name, rows in percentiles.items():
        p50, p99, p999 = np.median(rows, axis=0)
        best = min(row[2] for row in rows)
        print(
            f"step [us], {name:17}: p50 {p50:.2f}  p99 {p99:.2f}  p99.9 {p999:.2f}, best {best:.2f}"
        )


def listening_socket() -> socket.socket:
    """A socket that takes datagrams on this machine."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listening.bind(("127.0.0.1", 0))
    return listening


def read_for_ever(listening: socket.socket) -> None:
    """Take every datagram, and drop it."""
    while True:
        listening.recv(2048)


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


def main(words: list[str]) -> None:
    """Print all figures."""
    rounds = 10
    if words:
        rounds = int(words[0])
    with tempfile.TemporaryDirectory() as folder:
        mcap(Path(folder) / "ten.mcap")
        loop(prepared(Path(folder)), rounds)


if __name__ == "__main__":
    main(sys.argv[1:])
