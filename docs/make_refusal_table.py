"""Print a table of docs/registration.md:  python docs/make_refusal_table.py MODEL SETS

Good markers in random layouts: how many sets are refused all the same. The same markers with two
labels exchanged: how many are refused.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

import vfplan
from vfplan.registration.diagnosis import diagnose
from vfplan.registration.refusal import SURE_EXCHANGE, refuse_sure_faults

PIXEL = 0.6e-3  # m
NOISE = 0.3e-3  # m an axis
NOISES = ("equal", "one axis 3 times", "markers 1/2 to 2 times")
SPREAD_PX = (870.0, 780.0)


def layout(rng: np.random.Generator, n: int) -> NDArray:
    """Markers anywhere in the slice; every other layout near a grid, as people place them."""
    while True:
        source = rng.uniform(0, SPREAD_PX, (n, 2))
        if rng.random() < 0.5:
            side = int(np.ceil(np.sqrt(n)))
            cells = np.stack(np.divmod(np.arange(n), side), axis=1) / (side - 1)
            source = 60 + cells * [700, 600] + rng.normal(0, rng.choice([1, 5, 30]), (n, 2))
        extent = np.linalg.svd(source - source.mean(axis=0), compute_uv=False)
        if extent[1] > extent[0] / 10:
            return source


def measured(rng: np.random.Generator, source: NDArray, kind: str) -> NDArray:
    """The markers as a robot with localisation errors touches them [m]."""
    n = len(source)
    error = rng.normal(0, NOISE, (n, 3))
    if kind == NOISES[1]:
        error *= [1, 1, 3]
    elif kind == NOISES[2]:
        error *= np.exp(rng.uniform(-np.log(2), np.log(2), (n, 1)))
    return np.column_stack([source * [PIXEL, -PIXEL], np.zeros(n)]) + error


def refused(source: NDArray, target: NDArray, model: str) -> bool:
    """Whether the markers make no fixture."""
    try:
        found = vfplan.fit_registration(source, target, model=model, pixel_spacing=PIXEL)
        refuse_sure_faults(found, diagnose(found))
    except vfplan.VfplanError:
        return True
    return False


def exchanged(rng: np.random.Generator, target: NDArray) -> NDArray:
    """Two labels exchanged."""
    i, j = rng.permutation(len(target))[:2]
    order = np.arange(len(target))
    order[[i, j]] = j, i
    return target[order]


def row(model: str, n: int, sets: int) -> str:
    """The table's line for a model and a number of markers."""
    rng = np.random.default_rng(n)
    false, swap, tried = 0, 0, sets // 20
    for k in range(sets):
        source = layout(rng, n)
        target = measured(rng, source, NOISES[k % 3])
        false += refused(source, target, model)
        if k < tried:
            swap += refused(source, exchanged(rng, target), model)
    return f"| {model} | {n} | {false} of {sets} | {swap / tried:.1%} |"


def bound(n: int) -> float:
    """The most that good markers of any layout are refused as exchanged (affine, equal noise)."""
    from scipy.special import chndtr, fdtri

    dof, pairs = 3 * n - 9, n * (n - 1) / 2
    limit = fdtri(dof, dof, 1 - SURE_EXCHANGE / pairs)
    shift = np.geomspace(dof / 4, dof * 8, 4000)
    return float(pairs * chndtr(shift / limit, dof, shift).max())


if __name__ == "__main__":
    MODEL, SETS = sys.argv[1], int(sys.argv[2])
    for N in (4, 5, 6, 9, 12):
        print(row(MODEL, N, SETS), flush=True)
    for N in (4, 5, 6):
        print(f"exchanged labels, {N} good markers: refused in at most {bound(N):.1e} of sets")
