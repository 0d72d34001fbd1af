"""Print a table of docs/registration.md:  python docs/make_perspective_table.py SETS [PHOTOS]

A plate photographed by a camera that is tilted, its markers touched with 0.3 mm of noise an axis,
and an affine registration: how often perspective is said, how often the 95 % bounds hold at a point
and over the whole curve, how many sets that pass a gate of 1 mm are worse than it, and how many
good markers are called suspect. With PHOTOS, a folder of `calib.image_points.N.txt` and
`calib.object_points.N.txt`, the same for markers taken at random from real photographs.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import vfplan

NOISE = 0.3e-3  # m an axis
GATE = 1e-3  # m
DISTANCE = 0.6  # of the camera [m]
FOCAL = 1200.0  # px


def photographed(plate: NDArray, tilt_deg: float) -> NDArray:
    """(N, 2) pixels of points (N, 2) [m] of a plate tilted about an axis across the picture."""
    turn = np.radians(tilt_deg)
    x, y = plate.T
    depth = DISTANCE + np.sin(turn) * (0.8 * x + 0.6 * y)
    along, across = 0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x
    seen = np.cos(turn) * along
    return (
        FOCAL
        * np.column_stack([0.8 * seen - 0.6 * across, 0.6 * seen + 0.8 * across])
        / (depth[:, None])
    )


def plates(n: int, tilt_deg: float, sets: int) -> Iterator[tuple[NDArray, ...]]:
    """(markers [px], touched [m], curve [px], the curve's true place [m])."""
    rng = np.random.default_rng(n)
    t = np.linspace(0, 1, 60)
    curve = np.column_stack([-0.1 + 0.2 * t, 0.05 * np.sin(6 * t)])
    for _ in range(sets):
        place = rng.uniform(-0.13, 0.13, (n, 2))
        touched = np.c_[place, np.zeros(n)] + rng.normal(0, NOISE, (n, 3))
        true = np.c_[curve, np.zeros(len(t))]
        yield photographed(place, tilt_deg), touched, photographed(curve, tilt_deg), true


def photos(folder: Path, view: int, n: int, sets: int) -> Iterator[tuple[NDArray, ...]]:
    """The same with markers at random from a photograph, held against all its points."""
    pixels = np.loadtxt(folder / f"calib.image_points.{view}.txt")[:, :2]
    plate = np.loadtxt(folder / f"calib.object_points.{view}.txt")[:, :2] * 1e-3
    space = np.c_[plate, np.zeros(len(plate))]
    rng = np.random.default_rng(n)
    for _ in range(sets):
        own = rng.permutation(len(pixels))[:n]
        yield pixels[own], space[own], pixels, space


def row(name: str, cases: Iterator[tuple[NDArray, ...]]) -> str:
    """The table's line."""
    count: Counter[str] = Counter()
    for source, target, curve, true in cases:
        r = vfplan.fit_registration(source, target)
        error = np.linalg.norm(r.apply(curve) - true, axis=1)
        point, whole = r.tre95_m(curve), r.tre95_curve_m(curve)
        passes = whole.max() <= GATE
        count["said"] += r.perspective is not None and r.perspective.said
        count["point"] += (error <= point).mean()
        count["whole"] += bool((error <= whole).all())
        count["passes"] += bool(passes)
        count["worse"] += bool(passes and error.max() > GATE)
        count["suspects"] += len(r.outliers) / len(source)
        count["sets"] += 1
    share = {k: f"{v / count['sets']:.1%}" for k, v in count.items()}
    return (
        f"| {name} | {share['said']} | {share['point']} | {share['whole']} | "
        f"{count['worse']} of {count['passes']} | {share['suspects']} |"
    )


if __name__ == "__main__":
    SETS = int(sys.argv[1])
    for N in (6, 9, 16):
        for TILT in (0, 2, 5, 20):
            print(row(f"{N} markers, {TILT}°", plates(N, TILT, SETS)), flush=True)
    for FOLDER in map(Path, sys.argv[2:]):
        for VIEW in (0, 3):
            for N in (6, 9, 16):
                print(row(f"photograph {VIEW}, {N} markers", photos(FOLDER, VIEW, N, SETS)))
