"""How often an arm's own limits stop it, raw and governed: `python study.py [-o TABLE.md]`.

It starts the simulator of the arm's protocol on this machine, and renders scenes over the real
protocol under a simulated hand. In four of them the hand slides off the fixture, or begins inside:
the end of a curve, the edge of a sheet, a hole in it, and a start inside. In five the hand presses
on a sheet that moves or changes. It needs `franka-sim`, `pylibfranka` and vfplan in one environment
of their own, as `make franka-env` makes it.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from loop import Run, connect, read_tip, render

import vfplan

STIFFNESSES_N_PER_M = [500.0, 1000.0, 2000.0, 3000.0]
TICKS = 1500
# The port is fixed, so two studies at once need two addresses.
ADDRESS = f"127.0.0.{2 + os.getpid() % 250}"

HAND_STIFFNESS_N_PER_M = 800.0
"""Stiffness of the hand that holds the arm [N/m]."""
HAND_DAMPING_NS_PER_M = 30.0
"""Damping of the hand that holds the arm [N s/m]."""
JOINT_DAMPING_NMS_PER_RAD = 0.5
"""Damping that keeps the joints from turning fast [N m s/rad]."""
TICKS_TO_GRASP = 100
"""Ticks over which the hand takes hold of the arm."""
CONNECT_S = 60.0
"""Seconds to wait for the simulator."""


def sheet(side: float = 0.06, spacing: float = 1e-3, hole: float = 0.0) -> np.ndarray:
    """(n, 3) a level square about 0, with a hole of this radius in its middle [m]."""
    grid = np.arange(-side / 2, side / 2 + spacing / 2, spacing)
    x, y = np.meshgrid(grid, grid)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    outside_hole = np.hypot(points[:, 0], points[:, 1]) >= hole
    return points[outside_hole]


def line(length: float = 0.04, spacing: float = 4e-4) -> np.ndarray:
    """(n, 3) a straight curve along x that ends at 0 [m]."""
    x = np.arange(-length, spacing / 2, spacing)
    return np.column_stack([x, 0 * x, 0 * x])


@dataclass(frozen=True)
class Scene:
    """A cloud and the path of a hand over it, in the cloud's own frame [m].

    The hand would go 21 mm past the contact: along y at the curve, along z at the sheets.

    ignore_axis: the axis along which the cloud is infinite, if there is one
    stops: where the hand begins, and where it goes
    """

    cloud: np.ndarray
    ignore_axis: str | None
    stops: list[tuple[float, float, float]]


SCENES = {
    "end of a curve": Scene(
        line(), "z", [(-0.01, 0.006, 0), (-0.01, -0.016, 0), (0.02, -0.016, 0)]
    ),
    "edge of a sheet": Scene(
        sheet(), None, [(0.02, 0, 0.006), (0.02, 0, -0.016), (0.05, 0, -0.016)]
    ),
    "hole in a sheet": Scene(
        sheet(hole=0.009), None, [(-0.02, 0, 0.006), (-0.02, 0, -0.016), (0.0, 0, -0.016)]
    ),
    "start inside": Scene(sheet(), None, [(0, 0, 0.002), (0, 0, -0.016), (0.05, 0, -0.016)]),
}

CHANGES = ("it moves", "it is exchanged", "it is edited", "all three", "a new engine and a reset")
"""What happens to a sheet while the hand presses on it."""
PRESSING_STOPS = [(0, 0, 0.006), (0, 0, -0.01), (0.01, 0, -0.01)]
"""The path of the hand that presses on the sheet [m]."""


class ChangingSheet:
    """A sheet that moves, is exchanged and is edited while the hand presses on it.

    It breathes by 5 mm at 0.5 Hz. Its pose is measured at 60 Hz, with 0.25 mm of noise, and arrives
    30 ms late. Every 300 ticks it is exchanged, for one 1 mm higher and for one with a hole of
    9 mm: by `exchange`, or, for comparison, by a new engine and a reset. From tick 400 on a burr
    takes 16 points away in each tick.
    """

    def __init__(self, change: str, origin: np.ndarray, stiffness: float) -> None:
        self.moves = change in ("it moves", "all three")
        self.is_exchanged = change in ("it is exchanged", "all three")
        self.is_edited = change in ("it is edited", "all three")
        self.is_replaced = change == "a new engine and a reset"
        self.origin = origin
        self.stiffness = stiffness
        self.engine = self.make_engine(0)
        self.frame = vfplan.MovingFrame(pivot=origin)
        self.tick = 0
        self.rng = np.random.default_rng(1)

    def make_engine(self, number: int) -> vfplan.ProxyEngine:
        """An engine of one of the three sheets, in turn."""
        clouds = (sheet(), np.add(sheet(), [0, 0, 1e-3]), sheet(hole=0.009))
        cloud = clouds[number % len(clouds)]
        engine = vfplan.ProxyEngine(cloud + self.origin, stiffness=self.stiffness)
        engine.make_editable()
        return engine

    def reset(self, hip: np.ndarray) -> None:
        """Begin at rest; the first pose arrived 30 ms ago."""
        self.frame.pose(-0.03, np.eye(4))

    def step(self, hip: np.ndarray) -> vfplan.Step:
        """One tick: what happens to the sheet, then the engine's step."""
        t = self.tick / 1000
        self.tick += 1
        if self.tick % 17 == 0:
            pose = np.eye(4)
            if self.moves:
                pose[:3, 3] = self.rng.normal(0, 0.25e-3 / 3**0.5, 3)
                pose[2, 3] += 5e-3 * np.sin(np.pi * (t - 0.03))
            self.frame.pose(t - 0.03, pose)
        if self.tick % 300 == 0:
            other = self.make_engine(self.tick // 300)
            if self.is_exchanged:
                self.engine.exchange(other)
            elif self.is_replaced:
                self.engine = other
                self.engine.reset(hip)
        if self.is_edited and 400 <= self.tick < 440:
            first = 16 * (self.tick - 400) + 1500
            self.engine.edit(remove=range(first, first + 16))
        return self.frame.step(self.engine, t, hip)


def hand_torque(stops: np.ndarray) -> Callable[[Any, np.ndarray, int], np.ndarray]:
    """Torques (7,) [N m] of a hand that moves through the stops, as `render` asks for them."""

    def torque(state: Any, jacobian: np.ndarray, tick: int) -> np.ndarray:
        # The hand reaches the last stop after 80 % of the ticks.
        progress = min(tick / (0.8 * TICKS), 1.0) * (len(stops) - 1)
        i = min(int(progress), len(stops) - 2)
        goal = stops[i] + (progress - i) * (stops[i + 1] - stops[i])
        joint_velocity = np.array(state.dq)
        velocity = (jacobian @ joint_velocity)[:3]
        grip = min(1.0, tick / TICKS_TO_GRASP)
        pull = HAND_STIFFNESS_N_PER_M * (goal - read_tip(state)) - HAND_DAMPING_NS_PER_M * velocity
        return jacobian[:3].T @ (grip * pull) - JOINT_DAMPING_NMS_PER_RAD * joint_velocity

    return torque


class Row(NamedTuple):
    """One run of the study."""

    scene: str
    stiffness: float
    is_governed: bool
    run: Run


def run_scene(robot: Any, name: str, stiffness: float, is_governed: bool) -> Run:
    """Run one scene. Its cloud is placed so that the hand begins where the tip is now."""
    tip = read_tip(robot.read_once())
    if name in SCENES:
        scene = SCENES[name]
        stops = np.array(scene.stops)
        origin = tip - stops[0]
        engine = vfplan.ProxyEngine(
            scene.cloud + origin, stiffness=stiffness, ignore_axis=scene.ignore_axis
        )
    else:
        stops = np.array(PRESSING_STOPS)
        origin = tip - stops[0]
        engine = ChangingSheet(name, origin, stiffness)
    engine.reset(tip)
    governor = None
    if is_governed:
        governor = vfplan.Governor.of(vfplan.read_robot("fr3"), stiffness, torques=True)
    model = robot.load_model()
    return render(robot, model, engine, governor, TICKS, hand_torque(stops + origin))


def connect_when_ready(server: subprocess.Popen) -> Any:
    """Connect to the simulated arm as soon as the simulator serves it."""
    import pylibfranka

    deadline = time.monotonic() + CONNECT_S
    while True:
        try:
            return connect(ADDRESS, 100.0, 100.0, is_real_time=False)
        except (pylibfranka.NetworkException, pylibfranka.CommandException):
            if server.poll() is not None or time.monotonic() > deadline:
                raise
            time.sleep(0.3)


def study(
    repeats: int,
    stiffnesses: Iterable[float] = STIFFNESSES_N_PER_M,
    scenes: Iterable[str] = (*SCENES, *CHANGES),
) -> list[Row]:
    """Run each scene with each stiffness, raw once and governed `repeats` times."""
    simulator = Path(__file__).parent / "simulator.py"
    rows = []
    with as_file(files("vfplan.arm") / "models" / "fr3.xml") as model_file:
        for name in scenes:
            for stiffness in stiffnesses:
                for is_governed in [False] + [True] * repeats:
                    # Each run has a fresh simulator, so that all begin in the same posture.
                    server = subprocess.Popen(
                        [sys.executable, str(simulator), str(model_file), ADDRESS],
                        stdout=subprocess.DEVNULL,
                        stderr=subprocess.DEVNULL,
                    )
                    try:
                        robot = connect_when_ready(server)
                        run = run_scene(robot, name, stiffness, is_governed)
                        # The connection ends before the simulator does.
                        del robot
                    finally:
                        server.terminate()
                        server.wait(30)
                    rows.append(Row(name, stiffness, is_governed, run))
                    print(*rows[-1], file=sys.stderr, flush=True)
    return rows


def table(rows: list[Row]) -> str:
    """How often the arm stopped, as a table in Markdown."""
    groups: dict[tuple[str, float], tuple[list[Run], list[Run]]] = {}
    for row in rows:
        raw, governed = groups.setdefault((row.scene, row.stiffness), ([], []))
        if row.is_governed:
            governed.append(row.run)
        else:
            raw.append(row.run)
    text = "| scene | K [N/m] | engine's force step, raw [N] | raw | governed |\n"
    text += "|---|---|---|---|---|\n"
    for (scene, stiffness), (raw, governed) in groups.items():
        force_step_n = max(run.force_step_n for run in raw)
        text += (
            f"| {scene} | {stiffness:.0f} | {force_step_n:.2f} "
            f"| {count_stops(raw)} | {count_stops(governed)} |\n"
        )
    return text


def count_stops(runs: list[Run]) -> str:
    """How many of the runs the arm stopped, in words."""
    stops = 0
    for run in runs:
        if run.error is not None:
            stops += 1
    return f"{stops} of {len(runs)}"


def main(words: list[str]) -> int:
    """Run the study; returns 1 if a governed run was stopped, or no raw one was."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--repeats", type=int, default=4, help="governed runs of each scene")
    options = parser.parse_args(words)
    rows = study(options.repeats)
    text = table(rows)
    print(text, end="")
    if options.output:
        options.output.write_text(text)
    raw_stopped = False
    governed_stopped = False
    for row in rows:
        if row.run.error is not None:
            if row.is_governed:
                governed_stopped = True
            else:
                raw_stopped = True
    if governed_stopped or not raw_stopped:
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
