"""Stage register: models x number of markers x noise; target registration error against time.

The markers lie on a jittered grid over an 871 x 786 slice of 0.5 mm pixels; each is touched with a
given noise an axis. The error is that of the whole planned curve, over many draws of the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from vfplan.bench.record import Array, Record, Setting, Trial, errors_of, timed

MARKERS = {True: (4, 9, 25), False: (4, 6, 9, 16, 25, 49)}
NOISE_MM = {True: (0.2,), False: (0.05, 0.2, 1.0)}
DRAWS = {True: 30, False: 100}
SPACING_M = 0.5e-3
DEFAULT_MARKERS = 9
# A print that a copier stretched by 1 % in one direction: only the affine map can follow.
STRETCH = {"true scale": 1.0, "stretched 1 %": 1.01}


def scenes(quick: bool, tolerance_m: float) -> Iterator[list[Trial]]:
    """The trials of each noise and print; the tolerance has no say here."""
    for noise in NOISE_MM[quick]:
        for name, stretch in STRETCH.items():
            yield list(_trials(f"{noise:g} mm noise, {name}", noise * 1e-3, stretch, quick))


def _trials(scene: str, noise: float, stretch: float, quick: bool) -> Iterator[Trial]:
    T = true_map(stretch)
    score = partial(_score, T=T, curve=_curve_px())
    for count in MARKERS[quick]:
        source = markers_px(count)
        targets = _touched(source, T, noise, DRAWS[quick])
        for method, fit in METHODS.items():
            run, chosen = partial(_fit_all, fit, source, targets), count == DEFAULT_MARKERS
            given: dict[str, Setting] = {"markers": count}
            yield Trial(scene, method, given, run, score, "m", chosen and method == "affine")


def true_map(stretch: float = 1.0) -> Array:
    """(3, 3) map on [u v 1] into the robot's frame [m]: tilted, turned, stretched along u."""
    tilt, turn = np.radians(12.0), np.radians(25.0)
    x = np.array([np.cos(turn), np.sin(turn), 0.0])
    y = np.cross([np.sin(tilt), 0.0, -np.cos(tilt)], x)
    y -= (y @ x) * x
    y /= np.linalg.norm(y)
    return np.column_stack([SPACING_M * stretch * x, SPACING_M * y, [0.35, 0.1, 0.05]])


def markers_px(count: int) -> Array:
    """(count, 2) marker positions on a jittered grid that surrounds the curve [px]."""
    rng = np.random.default_rng(count)
    side = int(np.ceil(np.sqrt(count)))
    u, v = np.meshgrid(np.linspace(90, 780, side), np.linspace(80, 705, side))
    grid = np.column_stack([u.ravel(), v.ravel()])
    chosen = np.round(np.linspace(0, len(grid) - 1, count)).astype(int)
    return grid[chosen] + rng.uniform(-25, 25, (count, 2))


def _curve_px() -> Array:
    t = np.linspace(0, 1, 60)
    return np.column_stack([200 + 480 * t, 380 + 170 * np.sin(5 * t)])


def _touched(source: Array, T: Array, noise: float, draws: int) -> Array:
    rng = np.random.default_rng(11)
    return apply(T, source) + rng.normal(0, noise, (draws, len(source), 3))


def apply(T: Array, points: Array) -> Array:
    """T (3, 3) on [u v 1]."""
    return np.column_stack([points, np.ones(len(points))]) @ T.T


def _fit_all(fit: Callable[[Array, Array], Array], source: Array, targets: Array) -> Any:
    fits = [timed(partial(fit, source, target)) for target in targets]
    return [found for found, _ in fits], np.concatenate([us for _, us in fits])


def _score(maps: list[Array], T: Array, curve: Array) -> Record:
    """Target registration error over curve and draws [m]."""
    true = apply(T, curve)
    wrong = np.array([np.linalg.norm(apply(found, curve) - true, axis=1) for found in maps])
    return errors_of(wrong, draws=len(maps))


def _ours(model: str) -> Callable[[Array, Array], Array]:
    def fit(source: Array, target: Array) -> Array:
        from vfplan.registration import fit_registration

        found = fit_registration(source, target, model=model, pixel_spacing=SPACING_M)
        return found.T_target_source

    return fit


def _lstsq(source: Array, target: Array) -> Array:
    """The paper's ordinary least squares, bare: no residuals, no covariance, no checks."""
    X = np.column_stack([source, np.ones(len(source))])
    return np.linalg.lstsq(X, target, rcond=None)[0].T


METHODS: dict[str, Callable[[Array, Array], Array]] = {
    "affine": _ours("affine"),
    "similarity": _ours("similarity"),
    "rigid": _ours("rigid"),
    "bare least squares": _lstsq,
}
