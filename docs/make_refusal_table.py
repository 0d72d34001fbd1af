"""Print a table of docs/registration.md:  python docs/make_refusal_table.py MODEL SETS [N ...]

Good markers in random layouts, with localisation errors of 0.1 to 2 mm an axis: how many sets are
refused all the same, and why; of how many it is said that another labelling seems right, and of how
many that the markers cannot show theirs. The same markers with two labels exchanged, or with all in
another order: how many are refused, warned of, or more than 1 mm wrong without a word. MODEL is
"affine", "similarity" or "rigid", with the pixel spacing known, or "affine-unknown".
"""

from __future__ import annotations

import sys
from collections import Counter
from unittest import mock

import numpy as np
from numpy.typing import NDArray

import vfplan
from vfplan.registration import diagnosis as diagnosing
from vfplan.registration.diagnosis import refuse_sure_faults
from vfplan.registration.labelling import SURE

PIXEL = 0.6e-3  # m
NOISE = (0.1e-3, 2e-3)  # m an axis
NOISES = ("equal", "one axis 3 times", "markers 1/2 to 2 times", "heavy tails")
SPREAD_PX = (870.0, 780.0)
WRONG = 1e-3  # m


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
    error = rng.normal(0, 1, (n, 3))
    if kind == NOISES[1]:
        error *= [1, 1, 3]
    elif kind == NOISES[2]:
        error *= np.exp(rng.uniform(-np.log(2), np.log(2), (n, 1)))
    elif kind == NOISES[3]:
        error = rng.standard_t(3, (n, 3))
    size = np.exp(rng.uniform(*np.log(NOISE)))
    return np.column_stack([source * [PIXEL, -PIXEL], np.zeros(n)]) + size * error


def judged(source: NDArray, target: NDArray, model: str, true: NDArray | None = None) -> str:
    """ "refused", what is said of the labels, or whether a set without a word is right."""
    name, _, unknown = model.partition("-")
    try:
        found = vfplan.fit_registration(
            source, target, model=name, pixel_spacing=None if unknown else PIXEL
        )
        with mock.patch.object(diagnosing, "_masked", return_value=[]):  # slow, and refuses nothing
            diagnosis = diagnosing.diagnose(found)
        refuse_sure_faults(found, diagnosis)
    except vfplan.VfplanError as error:
        return f"refused {error}"
    if diagnosis.relabelled:
        return "seems" if diagnosis.relabelled.seems else "cannot"
    if true is None:
        return "taken"
    away = np.linalg.norm(found.apply(source) - true, axis=1).max()
    return "wrong" if away > max(WRONG, 2 * found.tre95_curve_m(source).max()) else "taken"


def exchanged(rng: np.random.Generator, n: int) -> NDArray:
    """Two labels exchanged."""
    i, j = rng.permutation(n)[:2]
    order = np.arange(n)
    order[[i, j]] = j, i
    return order


def reordered(rng: np.random.Generator, n: int) -> NDArray:
    """All labels reversed, shifted or mixed up."""
    whole = (np.arange(n)[::-1], np.roll(np.arange(n), rng.integers(1, n)), rng.permutation(n))
    return whole[rng.integers(3)]


def row(model: str, n: int, sets: int) -> str:
    """The table's line for a model and a number of markers; the good sets refused go to stderr."""
    rng = np.random.default_rng(n)
    good, pairs, whole = Counter(), Counter(), Counter()
    for k in range(sets):
        source = layout(rng, n)
        target = measured(rng, source, NOISES[k % len(NOISES)])
        true = np.column_stack([source * [PIXEL, -PIXEL], np.zeros(n)])
        verdict = judged(source, target, model)
        good[verdict.partition(" ")[0]] += 1
        if verdict.startswith("refused"):
            print(f"{model}, {n} markers, set {k}: {verdict}", file=sys.stderr)
        for count, order in ((pairs, exchanged(rng, n)), (whole, reordered(rng, n))):
            if k < sets // 20 and (order != np.arange(n)).any():
                count[judged(source, target[order], model, true).partition(" ")[0]] += 1
    shares = [
        f"{c['refused'] / c.total():.1%} / {(c['seems'] + c['cannot']) / c.total():.1%} / "
        f"{c['wrong']} of {c.total()}"
        for c in (pairs, whole)
    ]
    counts = f"{good['refused']} / {good['seems']} / {good['cannot']} of {sets}"
    return f"| {model} | {n} | {counts} | {shares[0]} | {shares[1]} |"


def bound(n: int) -> float:
    """The most that good markers of any layout are refused as exchanged (affine, equal noise)."""
    from scipy.special import chndtr, fdtri

    dof, pairs = 3 * n - 9, n * (n - 1) / 2
    limit = fdtri(dof, dof, 1 - SURE)
    shift = np.geomspace(dof / 4, dof * 8, 4000)
    return float(pairs * chndtr(shift / limit, dof, shift).max())


if __name__ == "__main__":
    MODEL, SETS = sys.argv[1], int(sys.argv[2])
    for N in map(int, sys.argv[3:] or (4, 5, 6, 9, 12)):
        print(row(MODEL, N, SETS), flush=True)
    for N in (4, 5, 6):
        print(f"exchanged labels, {N} good markers: refused in at most {bound(N):.1e} of sets")
