"""Replays and controller logs of archived bundles, as sums over the bits of their arrays."""

from __future__ import annotations

import hashlib
import json
import tempfile
from pathlib import Path

import numpy as np
from conftest import output
from vfplan.samples.experiments import probing_hand, square

import vfplan
from vfplan.replaying.replay import replay
from vfplan.robot import Robot
from vfplan.session.events import Poses
from vfplan.session.session import Session

DATA = Path(__file__).parents[1] / "data"
SAMPLES = Path(vfplan.__file__).parent / "samples"
ARCHIVE, OURS = DATA / "bundles", DATA / "oracle" / "bundles"
TICKS = 3000


class Random:
    """The generator of tests/native/scenes.hpp: NumPy's may differ from version to version."""

    def __init__(self, state):
        self.state = state

    def __call__(self, low, high):
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % (1 << 64)
        return low + (high - low) * ((self.state >> 11) * 2.0**-53)


def hand(points, ticks=TICKS, seed=42):
    """(ticks,) times and (ticks, 3) positions [s, m] of a hand that wanders about some points.

    Every 250 ticks it takes another aim: it creeps there, goes there, jumps onto a point, or rests.
    """
    random = Random(seed)
    at = points[0] + 0.03
    path = np.empty((ticks, 3))
    for tick in range(ticks):
        if tick % 250 == 0:
            kind = int(random(0, 4))
            spread = 0.0 if kind == 2 else 0.012
            near = points[int(random(0, len(points)))]
            aim = near + [random(-spread, spread) for _ in range(3)]
            if kind == 2:
                at = aim
        share = {0: 0.02, 1: 0.2}.get(kind, 0.0)
        at = at + share * (aim - at)
        path[tick] = at
    return np.arange(ticks) / 1000, path


def tracked(ticks=TICKS):
    """Poses at 40 Hz, 12 ms late, of a fixture that wanders."""
    random = Random(9)
    time = np.arange(0, ticks / 1000, 0.025)
    place, turn = np.zeros(3), np.zeros(3)
    rows = []
    for _ in time:
        place = place + [random(-1e-3, 1e-3) for _ in range(3)]
        turn = turn + [random(-5e-3, 5e-3) for _ in range(3)]
        w = float(np.sqrt(1 - turn[0] ** 2 - turn[1] ** 2 - turn[2] ** 2))
        rows.append([*place, w, *turn])
    return Poses(time, np.array(rows), time + 0.012)


def archived(name):
    """The path of an archived bundle."""
    path = ARCHIVE / f"{name}.h5"
    return path if path.exists() else OURS / f"{name}.h5"


def summed(**arrays):
    """What is frozen of a run: a sum for each array, and numbers that tell how large a change is.

    Parameters
    ----------
    arrays : dict
        `hip`, `proxy`, `force` (T, 3) [m, m, N], `state` (T,), and more.
    """
    frozen = {}
    for name, values in arrays.items():
        raw = np.ascontiguousarray(values, "<f8").tobytes()
        frozen[name] = hashlib.sha256(raw).hexdigest()[:16]
    force = arrays["force"]
    frozen["contact_ticks"] = int(np.count_nonzero(np.any(force != 0, axis=1)))
    frozen["force_mean_n"] = [float(f"{x:.12g}") for x in force.mean(axis=0)]
    frozen["proxy_mean_m"] = [float(f"{x:.12g}") for x in arrays["proxy"].mean(axis=0)]
    return frozen


def replays():
    """{case: what is frozen of it} for every archived bundle, the experiment and the sample."""
    robot = Robot("a robot", 1.0, 5.0, 1000.0, force_limit_n=12.0, force_step_limit_n=0.5)
    cases = {}

    def add(name, fixture, session, **how):
        ticks = replay(fixture, session, **how).ticks
        columns = {c: getattr(ticks, c) for c in ("hip", "proxy", "normal", "force", "state")}
        cases[name] = summed(**columns)

    for name, rules in (
        ("2.0-everything", ("robust", "paper")),
        ("2.0-patient", ("robust", "paper")),
        ("2.0-mesh", ("exact", "robust")),
        ("2.0-guided", ("robust",)),
        ("pieces", ("exact", "robust")),
    ):
        fixture = vfplan.read_fixture(archived(name))
        session = Session(*hand(fixture.points))
        for rule in rules:
            add(f"{name}, {rule}", fixture, session, rule=rule)
    for rule in ("robust", "paper"):
        add(f"experiment 1, {rule}", square(), probing_hand(), rule=rule)
    elbow = vfplan.read_fixture(archived("elbow"))
    for rule in ("robust", "paper", "exact"):
        add(f"elbow, {rule}", elbow, SAMPLES / "elbow_session.csv", rule=rule)
    add("elbow, governed", elbow, SAMPLES / "elbow_session.csv", governor=robot)
    session = Session(*hand(elbow.points))
    add("elbow, moving", elbow, session, poses=tracked())
    guided = vfplan.read_fixture(archived("elbow-guided"))
    add("elbow, guided", guided, Session(*hand(guided.points)))
    return cases


CONTROLLED = (
    ("2.0-everything", "--rule", "robust"),
    ("2.0-everything", "--rule", "paper", "--form", "admittance"),
    ("2.0-mesh", "--form", "velocity"),
    ("pieces",),
    ("elbow", "--governor", "0.5,12"),
    ("elbow", "--rule", "robust", "--form", "velocity"),
    ("elbow-guided",),
)
LOGGED = {"hip": ("x", "y", "z"), "proxy": ("proxy_x", "proxy_y", "proxy_z"),
          "force": ("force_x", "force_y", "force_z"), "state": ("state",)}  # fmt: skip


def build_controller(tree, folder):
    """The sample controller, compiled as soon as can be: its bits depend on no such flag."""
    source = tree / "samples" / "controller"
    flags = "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DVFPLAN_NARROW"
    output("cmake", "-S", source, "-B", folder, f"-Dvfplan_DIR={vfplan.cmake_dir()}", flags)
    output("cmake", "--build", folder, timeout=900)
    return folder / "controller"


def controller_logs(tree):
    """{case: what is frozen of the log} of the sample controller in simulated time."""
    cases = {}
    with tempfile.TemporaryDirectory() as folder:
        program = build_controller(tree, Path(folder) / "build")
        for name, *options in CONTROLLED:
            log = Path(folder) / f"{len(cases)}.csv"
            wanted = ["--unsigned", "--simulated-time", "--seconds", "3", "--log", log]
            output(program, archived(name), *wanted, *options)
            table = np.genfromtxt(log, delimiter=",", names=True)
            arrays = {k: np.column_stack([table[c] for c in names]) for k, names in LOGGED.items()}
            cases[" ".join([name, *options])] = summed(**arrays)
    return cases


def text(tree, name):
    """What tests/data/oracle/replays.json and controller.json hold."""
    made = replays() if name == "replays.json" else controller_logs(tree)
    lines = [f"{json.dumps(case)}: {json.dumps(frozen)}" for case, frozen in made.items()]
    renew = json.dumps(f"python tests/oracle/renew.py {name}")
    return f'{{"renew": {renew}, "cases": {{\n' + ",\n".join(lines) + "\n}}\n"


def parsed(text):
    """{case: one line of text} of such a file."""
    return lines(json.loads(text)["cases"])


def lines(cases):
    """{case: one line of text} of what was made."""
    return {case: json.dumps(frozen) for case, frozen in cases.items()}
