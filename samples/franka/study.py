"""How often an arm's own limits stop it, raw and governed: `python study.py [-o TABLE.md]`.

Starts the arm's protocol simulator on the loopback, and renders four scenes over the real protocol
with a hand that slides off, or begins inside: the end of a curve, the edge of a sheet, a hole in
it, and a start inside. It wants `franka-sim`, `pylibfranka` and vfplan in one environment of their
own, as `make franka-env` makes it.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
from loop import Run, connect, render, tip

import vfplan

STIFFNESSES = (500.0, 1000.0, 2000.0, 3000.0)
TICKS = 1500
HOST = (
    f"127.0.0.{2 + os.getpid() % 250}"  # the port is fixed: two studies at once need two addresses
)
HAND = 800.0
"""Stiffness of the hand that holds the arm [N/m]."""
DAMPER = 30.0
"""Damping of that hand [N s/m]."""


def sheet(side: float = 0.06, spacing: float = 1e-3, hole: float = 0.0) -> np.ndarray:
    """(n, 3) a level square about 0, with a hole of this radius in its middle [m]."""
    grid = np.arange(-side / 2, side / 2 + spacing / 2, spacing)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    kept = np.hypot(x, y) >= hole
    return np.column_stack([x, y, 0 * x])[kept]


def line(length: float = 0.04, spacing: float = 4e-4) -> np.ndarray:
    """(n, 3) a straight curve along x that ends at 0 [m]."""
    x = np.arange(-length, spacing / 2, spacing)
    return np.column_stack([x, 0 * x, 0 * x])


# name: cloud, the axis it is endless along, where the hand begins and where it goes [m], the clouds
# in their own frame. A hand would go 21 mm past contact, the curve's along y, the sheets' along z.
SCENES = {
    "end of a curve": (line(), "z", [(-0.01, 0.006, 0), (-0.01, -0.016, 0), (0.02, -0.016, 0)]),
    "edge of a sheet": (sheet(), None, [(0.02, 0, 0.006), (0.02, 0, -0.016), (0.05, 0, -0.016)]),
    "hole in a sheet": (
        sheet(hole=0.009), None, [(-0.02, 0, 0.006), (-0.02, 0, -0.016), (0.0, 0, -0.016)],
    ),
    "start inside": (sheet(), None, [(0, 0, 0.002), (0, 0, -0.016), (0.05, 0, -0.016)]),
}  # fmt: skip


# Under a hand that presses on a sheet: name, and what happens to it.
PRESSED = [(0, 0, 0.006), (0, 0, -0.01), (0.01, 0, -0.01)]
CHANGES = ("it moves", "it is exchanged", "it is edited", "all three", "a new engine and a reset")


class Changing:
    """A sheet under the hand that moves, is exchanged, is edited, tick by tick.

    It breathes, 5 mm at 0.5 Hz, seen at 60 Hz, 30 ms late, with 0.25 mm of noise. Every 300 ticks
    it is exchanged, for one 1 mm higher, and one with a hole of 9 mm: by `exchange`, or, for
    comparison, by a new engine and a reset. From tick 400 on a burr takes 16 points a tick away.
    """

    def __init__(self, what: str, origin: np.ndarray, stiffness: float) -> None:
        self.what, self.origin, self.stiffness = what, origin, stiffness
        self.engine, self.tick = self.made(0), 0
        self.frame = vfplan.MovingFrame(pivot=origin)
        self.draw = np.random.default_rng(1)

    def made(self, i: int) -> vfplan.ProxyEngine:
        cloud = (sheet(), np.add(sheet(), [0, 0, 1e-3]), sheet(hole=0.009))[i % 3]
        engine = vfplan.ProxyEngine(cloud + self.origin, stiffness=self.stiffness)
        engine.make_editable()
        return engine

    def reset(self, hip: np.ndarray) -> None:
        self.frame.pose(-0.03, np.eye(4))

    def step(self, hip: np.ndarray) -> vfplan.Step:
        t, self.tick = self.tick / 1000, self.tick + 1
        everything = self.what == "all three"
        if (everything or self.what == "it moves") and self.tick % 17 == 0:
            pose = np.eye(4)
            pose[:3, 3] = self.draw.normal(0, 0.25e-3 / 3**0.5, 3)
            pose[2, 3] += 5e-3 * np.sin(np.pi * (t - 0.03))
            self.frame.pose(t - 0.03, pose)
        if self.tick % 300 == 0:
            other = self.made(self.tick // 300)
            if everything or self.what == "it is exchanged":
                self.engine.exchange(other)
            elif self.what == "a new engine and a reset":
                self.engine = other
                self.engine.reset(hip)
        if (everything or self.what == "it is edited") and 400 <= self.tick < 440:
            first = 16 * (self.tick - 400) + 1500
            self.engine.edit(remove=range(first, first + 16))
        return self.frame.step(self.engine, t, hip)


def run(robot, model, name: str, stiffness: float, governed: bool) -> Run:
    """One scene about the tip as it is now; afterwards the hand brings it back."""
    cloud, axis, way = SCENES.get(name, (None, None, PRESSED))
    home = tip(robot.read_once())
    origin = home - np.array(way[0])
    if cloud is None:
        engine = Changing(name, origin, stiffness)
    else:
        engine = vfplan.ProxyEngine(cloud + origin, stiffness=stiffness, ignore_axis=axis)
    engine.reset(home)
    limits = vfplan.read_robot("fr3")
    governor = vfplan.Governor.of(limits, stiffness, torques=True) if governed else None
    stops = np.array([*way, way[0]]) + origin
    return render(robot, model, engine, governor, TICKS, hand(stops[:-1]))


def hand(stops: np.ndarray):
    """Torques of a hand that goes through the stops, and holds joints from turning fast."""

    def torques(state, jacobian: np.ndarray, k: int) -> np.ndarray:
        share = min(k / (0.8 * TICKS), 1.0) * (len(stops) - 1)
        i = min(int(share), len(stops) - 2)
        goal = stops[i] + (share - i) * (stops[i + 1] - stops[i])
        speed = jacobian @ np.array(state.dq)
        eased = min(1.0, k / 100)
        pull = eased * (HAND * (goal - tip(state)) - DAMPER * speed[:3])
        return jacobian[:3].T @ pull - 0.5 * np.array(state.dq)

    return torques


def study(repeats: int, stiffnesses=STIFFNESSES, scenes=(*SCENES, *CHANGES)) -> list[tuple]:
    """Rows (scene, K, governed, Run) over the protocol."""
    rows = []
    with as_file(files("vfplan.arm") / "models" / "fr3.xml") as model_file:
        here = Path(__file__).parent / "simulator.py"
        for name in scenes:
            for stiffness in stiffnesses:
                for governed in (False, *[True] * repeats):
                    # A fresh simulator for each, so that all begin in the same posture.
                    server = subprocess.Popen(
                        [sys.executable, str(here), str(model_file), HOST],
                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                    )  # fmt: skip
                    try:
                        robot = waited(server)
                        rows.append(
                            (
                                name,
                                stiffness,
                                governed,
                                run(robot, robot.load_model(), name, stiffness, governed),
                            )
                        )
                        del robot
                    finally:
                        server.terminate()
                        server.wait(30)
                    print(*rows[-1], file=sys.stderr, flush=True)
    return rows


def waited(server: subprocess.Popen, seconds: float = 60.0):
    """The robot, as soon as the simulator serves it."""
    import pylibfranka

    end = time.monotonic() + seconds
    while True:
        try:
            return connect(HOST)
        except (pylibfranka.NetworkException, pylibfranka.CommandException):
            if server.poll() is not None or time.monotonic() > end:
                raise
            time.sleep(0.3)


def table(rows: list[tuple]) -> str:
    """The aborts, as a table in Markdown."""
    lines = ["| scene | K [N/m] | engine's force step, raw [N] | raw | governed |",
             "|---|---|---|---|---|"]  # fmt: skip
    for name in dict.fromkeys(row[0] for row in rows):
        for stiffness in dict.fromkeys(row[1] for row in rows):
            raw = [r for n, k, g, r in rows if (n, k, g) == (name, stiffness, False)]
            held = [r for n, k, g, r in rows if (n, k, g) == (name, stiffness, True)]
            step = max(r.force_step_n for r in raw)
            lines.append(
                f"| {name} | {stiffness:.0f} | {step:.2f} | {aborts(raw)} | {aborts(held)} |"
            )
    return "\n".join(lines) + "\n"


def aborts(runs: list[Run]) -> str:
    return f"{sum(r.error is not None for r in runs)} of {len(runs)}"


def main(arguments: list[str]) -> int:
    """Run the study; 1 where a governed run was stopped, or no raw one was."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--repeats", type=int, default=4, help="governed runs of each scene")
    given = parser.parse_args(arguments)
    rows = study(given.repeats)
    text = table(rows)
    print(text, end="")
    if given.output:
        given.output.write_text(text)
    governed = [r for *_, g, r in rows if g]
    raw = [r for *_, g, r in rows if not g]
    return int(any(r.error for r in governed) or not any(r.error for r in raw))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
