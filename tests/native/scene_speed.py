"""Speed of a tick on each scene of `vfplan bench proxy`, of this build and of others, in one run.

    python tests/native/scene_speed.py [--rounds 7] [--spacing-mm 0.5] [include-folder ...]

Each build times nanoflann's peer beside the engine, so that both see the same machine. Needs g++
and libnanoflann-dev. The builds take turns, and of each figure the smallest counts.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from vfplan.bench.proxy import Case, R, cases
from vfplan.engine.parameters import ProxyParameters

HERE = Path(__file__).parent
OURS = HERE.parents[1] / "vfplan/native/include"


def write(case: Case, to: Path) -> int:
    """Writes a scene for scene_speed.cpp; returns its number of points."""
    points = np.asarray(case.scene.points, float)
    axis = case.scene.ignore_axis
    planar = axis is not None
    if planar and axis != "z":
        raise ValueError(f"{case.name} ignores {axis}: only z is foreseen")
    paper = ProxyParameters.make(points, rule="paper", ignore_axis=axis)
    robust = ProxyParameters.make(points, rule="robust", ignore_axis=axis)
    head = [len(points), len(case.hips), planar, R, paper.outer_radius, paper.band, robust.band]
    np.concatenate([np.float64(head), points.ravel(), case.hips.ravel()]).tofile(to)
    return len(points)


def build(include: Path, to: Path) -> Path:
    """Compiles scene_speed.cpp against the headers of a build."""
    command = ["g++", "-std=c++20", "-O3", "-ffp-contract=off", f"-I{include}"]
    subprocess.run([*command, HERE / "scene_speed.cpp", "-o", to], check=True)
    return to


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--spacing-mm", type=float, default=0.5)
    parser.add_argument("include", nargs="*", type=Path, help="headers of other builds")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        includes = [*(include.resolve() for include in asked.include), OURS]
        programs = [build(include, folder / f"build{i}") for i, include in enumerate(includes)]
        names, counts, files = [], [], []
        for case in cases(quick=True):
            files.append(folder / f"{len(files)}.f64")
            spaced = case if case.spacings else case.at(1e-3 * asked.spacing_mm)
            counts.append(write(spaced, files[-1]))
            names.append(case.name)
        figures = np.full((len(programs), len(files), 4), np.inf)
        for _ in range(asked.turns):
            for i, program in enumerate(programs):
                command = [program, str(asked.rounds), *files]
                text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
                figures[i] = np.minimum(figures[i], np.fromstring(text, sep=" ").reshape(-1, 4))
    print(" " * 36, end="")
    for include in includes:
        print(f" | {include.parents[2].name:^37s}", end="")
    print()
    columns = " | nanoflann  paper        robust  worst"
    print(f"{'us a tick':28s} {'points':>7s}{columns * len(includes)}")
    for j, scene in enumerate(names):
        print(f"{scene:28s} {counts[j]:7d}", end="")
        for peer, paper, median, worst in figures[:, j]:
            print(f" | {peer:9.2f} {paper:6.2f} {peer / paper:5.1f}x", end="")
            print(f" {median:7.2f} {worst:6.2f}", end="")
        print()


if __name__ == "__main__":
    main()
