"""Vary the numbers of the robust rule one by one, and print what each change does.

    .venv/bin/python docs/make_tuned.py            every number, halved and doubled; minutes
    .venv/bin/python docs/make_tuned.py max_tilt fit_spacings  only these

The headers are copied, one number of rules/constants.hpp is changed, and a small library is built
from them with g++ and driven in place of the installed engine.
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from vfplan import scenes
from vfplan.engine.parameters import ProxyParameters

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / room) for room in ("making", "support", "engine", ".")]
import test_rests  # noqa: E402
import test_robust_scenes  # noqa: E402

INCLUDE = ROOT / "vfplan" / "native" / "include"
R = 5e-3
DRIVER = """
#include "vfplan/engine.hpp"
extern "C" {
void* make(const double* xyz, long n, int planar, double band) {
    vfplan::Parameters p;
    p.band = band;
    if (planar) p.ignore_axis = vfplan::Vec3{{0, 0, 1}};
    return new vfplan::Engine(xyz, n, p, vfplan::Width::two);
}
void drop(void* e) { delete static_cast<vfplan::Engine*>(e); }
void reset(void* e, const double* h) {
    static_cast<vfplan::Engine*>(e)->reset({{h[0], h[1], h[2]}});
}
void run(void* e, const double* h, long n, double* proxy) {
    for (long i = 0; i < 3 * n; i += 3) {
        const auto s = static_cast<vfplan::Engine*>(e)->step({{h[i], h[i + 1], h[i + 2]}});
        for (int k = 0; k < 3; ++k) proxy[i + k] = s.proxy[k];
    }
}
}
"""


class Varied:
    """What the measurements use of `vfplan.ProxyEngine`, over a library of its own."""

    library: ctypes.CDLL

    def __init__(self, points, ignore_axis=None):
        self.parameters = ProxyParameters.make(points, ignore_axis=ignore_axis)
        cloud = np.ascontiguousarray(points, np.float64)
        is_planar = int(ignore_axis is not None)
        band = ctypes.c_double(self.parameters.band)
        count = ctypes.c_long(len(cloud))
        self._engine = ctypes.c_void_p(self.library.make(pointer(cloud), count, is_planar, band))

    def __del__(self):
        self.library.drop(self._engine)

    def reset(self, hip):
        """As `ProxyEngine.reset`."""
        self.library.reset(self._engine, pointer(np.ascontiguousarray(hip, np.float64)))

    def run(self, hips):
        """As `ProxyEngine.run`, the proxy only."""
        path = np.ascontiguousarray(hips, np.float64)
        proxy = np.empty_like(path)
        count = ctypes.c_long(len(path))
        self.library.run(self._engine, pointer(path), count, pointer(proxy))
        return SimpleNamespace(proxy=proxy)


def pointer(array):
    """Where an array's numbers lie."""
    return array.ctypes.data_as(ctypes.c_void_p)


def numbers() -> dict[str, float]:
    """The numbers of rules/constants.hpp, in its order."""
    text = (INCLUDE / "vfplan" / "rules" / "constants.hpp").read_text()
    values = {}
    for statement in re.findall(r"inline constexpr \w+ ([^;]+);", text):
        for definition in statement.split(", "):
            name, value = definition.split(" = ")
            values[name.strip()] = float(value)
    return values


def build(folder: Path, name: str | None, value: float) -> ctypes.CDLL:
    """The engine with one number changed."""
    headers = folder / "include"
    shutil.rmtree(headers, ignore_errors=True)
    shutil.copytree(INCLUDE, headers)
    tuned = headers / "vfplan" / "rules" / "constants.hpp"
    if name:
        tuned.write_text(re.sub(rf"\b{name} = [^,;]+", f"{name} = {value:.17g}", tuned.read_text()))
    (folder / "driver.cpp").write_text(DRIVER)
    out = folder / f"{name}_{value:g}.so"
    flags = "-std=c++20 -O1 -ffp-contract=off -DVFPLAN_NARROW -shared -fPIC"
    command = ["g++", *flags.split()]
    subprocess.run([*command, f"-I{headers}", folder / "driver.cpp", "-o", out], check=True)
    library = ctypes.CDLL(str(out))
    library.make.restype = ctypes.c_void_p
    return library


def played(points, axis, hips):
    """(T, 3) the proxy along a path."""
    engine = Varied(points, ignore_axis=axis)
    engine.reset(hips[0])
    return engine.run(hips).proxy


TRUTHS: dict[tuple, tuple] = {}


def over(kind: str, route: str, speed: float, noise=0.0, **settings) -> tuple[float, float]:
    """How much longer the spring is than the exact one at most [bands], and how far off [um]."""
    key = (kind, route, speed, *settings.items())
    if key not in TRUTHS:
        scene = scenes.SCENES[kind](**settings)
        hips = scene.path(route, speed=speed)
        TRUTHS[key] = scene, hips, scene.truth(hips, R)
    scene, hips, truth = TRUTHS[key]
    points = scene.points
    if noise > 0:
        points = points + np.random.default_rng(0).normal(0, noise, points.shape)
    proxy = played(points, scene.ignore_axis, hips)
    band = ProxyParameters.make(scene.points, ignore_axis=scene.ignore_axis).band
    longer = np.linalg.norm(proxy - hips, axis=1) - np.linalg.norm(truth - hips, axis=1)
    return longer.max() / band, 1e6 * np.linalg.norm(proxy - truth, axis=1).max()


def cylinder() -> float:
    """Largest error round a cylinder [um]."""
    hips, start = test_robust_scenes.circling()
    exact = hips[:, :2] / np.linalg.norm(hips[:, :2], axis=1)[:, None] * (0.03 + R)
    proxy = played(scenes.Circle(extrude=0.03).points, None, hips)
    return 1e6 * np.linalg.norm(proxy[:, :2] - exact, axis=1)[start:].max()


def sheet() -> float:
    """Largest lag on a flat sheet of 1.5 by 0.75 mm rectangles [um]."""
    x, z = np.meshgrid(np.arange(-9, 10) * 1.5e-3, np.arange(-18, 19) * 0.75e-3)
    points = np.column_stack([x.ravel(), 0 * x.ravel(), z.ravel()])
    hips = scenes.travel([[-4e-3, 8e-3, 0], [-4e-3, 2e-3, 0], [4e-3, 1e-3, 2.6e-3]], 0.1)
    return 1e6 * np.linalg.norm((played(points, None, hips) - hips)[:, [0, 2]], axis=1).max()


def resting() -> float:
    """The most a rest leaves to go [bands], over thick lines and hollows."""
    test_rests.vfplan = SimpleNamespace(ProxyEngine=Varied)
    most = 0.0
    for make, kind in ((test_rests.thick_line, "thick line"), (test_rests.hollow, "hollow")):
        for seed in range(10):
            rng = np.random.default_rng(seed)
            for remaining, _ in test_rests.rests(make(rng), kind, rng):
                most = max(most, remaining)
    return most


MEASURES = {
    "cylinder um": cylinder,
    "oblong sheet um": sheet,
    "noisy corner um": lambda: over("corner", "floor", 0.1, 5e-6, extrude=0.02)[1],
    "ball um": lambda: over("sphere", "inside", 0.2, spacing=1e-3)[1],
    "edge um": lambda: over("wedge", "over", 0.2, spacing=1e-3, extrude=0.02)[1],
    "hollow b": lambda: max(over("circle", "inside", 2.0)[0], over("teapot", "over", 0.5)[0]),
    "channel b": lambda: over("channel", "askew", 2.0, spacing=1e-3)[0],
    "rest b": resting,
}


def row(title: str, library: ctypes.CDLL) -> str:
    """One line of the table."""
    Varied.library = library
    text = f"{title:24}"
    for measure in MEASURES.values():
        text += f"{measure():17.2f}"
    return text


def main(names: list[str]) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        head = " " * 24
        for title in MEASURES:
            head += f"{title:>17}"
        print(head)
        print(row("as built", build(Path(folder), None, 0)), flush=True)
        for name, value in numbers().items():
            if names and name not in names:
                continue
            for factor in (0.5, 2.0):
                changed = build(Path(folder), name, value * factor)
                print(row(f"{name} {value:g} -> {value * factor:g}", changed), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
