"""Stage register: models x number of markers x noise; target registration error against time.

The markers lie on a jittered grid over an 871 x 786 slice of 0.5 mm pixels; each is touched with
normal noise of a known size an axis. The error is that of the whole planned curve, over many draws
of the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from vfplan.bench.record import Array, BenchRun, Record, errors_of, timed

PIXEL_M = 0.5e-3
"""Size of a pixel of the slice [m]."""

DEFAULT_MARKERS = 9
"""Number of markers of the setting that counts as chosen, as on the sample."""


def scenes(quick: bool, tolerance_m: float) -> Iterator[list[BenchRun]]:
    """The runs of each noise and print; the tolerance has no say here."""
    noises_mm = [0.05, 0.2, 1.0]
    counts = [4, 6, 9, 16, 25, 49]
    draws = 100
    if quick:
        noises_mm = [0.2]
        counts = [4, 9, 25]
        draws = 30
    for noise_mm in noises_mm:
        # Only the affine map can follow a print that a copier stretched in one direction.
        for name, stretch in (("true scale", 1.0), ("stretched 1 %", 1.01)):
            scene = f"{noise_mm:g} mm noise, {name}"
            T = true_map(stretch)
            runs = []
            for count in counts:
                source = markers_px(count)
                rng = np.random.default_rng(11)
                noise = rng.normal(0, 1e-3 * noise_mm, (draws, count, 3))
                targets = apply(T, source) + noise
                for method, fit in METHODS.items():
                    run = partial(fit_all, fit, source, targets)
                    chosen = method == "affine" and count == DEFAULT_MARKERS
                    settings = {"markers": count}
                    score = partial(score_maps, T=T)
                    runs.append(BenchRun(scene, method, settings, run, score, "m", chosen))
            yield runs


def true_map(stretch: float = 1.0) -> Array:
    """(3, 3) map on [u v 1] into the robot's frame [m]: tilted, turned, stretched along u."""
    tilt = np.radians(12.0)
    turn = np.radians(25.0)
    x = np.array([np.cos(turn), np.sin(turn), 0.0])
    y = np.cross([np.sin(tilt), 0.0, -np.cos(tilt)], x)
    y -= (y @ x) * x
    y /= np.linalg.norm(y)
    return np.column_stack([PIXEL_M * stretch * x, PIXEL_M * y, [0.35, 0.1, 0.05]])


def markers_px(count: int) -> Array:
    """(count, 2) marker positions on a jittered grid that surrounds the curve [px]."""
    rng = np.random.default_rng(count)
    side = int(np.ceil(np.sqrt(count)))
    u, v = np.meshgrid(np.linspace(90, 780, side), np.linspace(80, 705, side))
    grid = np.column_stack([u.ravel(), v.ravel()])
    picked = np.round(np.linspace(0, len(grid) - 1, count)).astype(int)
    return grid[picked] + rng.uniform(-25, 25, (count, 2))


def apply(T: Array, points: Array) -> Array:
    """T (3, 3) on [u v 1]."""
    return np.column_stack([points, np.ones(len(points))]) @ T.T


def fit_all(
    fit: Callable[[Array, Array], Array], source: Array, targets: Array
) -> tuple[list[Array], Array]:
    """The map of each draw of the noise, and the time of each fit [µs]."""
    maps = []
    times = []
    for target in targets:
        T, us = timed(partial(fit, source, target))
        maps.append(T)
        times.append(us)
    return maps, np.concatenate(times)


def score_maps(maps: list[Array], T: Array) -> Record:
    """Target registration error over the planned curve and all draws [m]."""
    t = np.linspace(0, 1, 60)
    curve = np.column_stack([200 + 480 * t, 380 + 170 * np.sin(5 * t)])
    true = apply(T, curve)
    errors = np.array([np.linalg.norm(apply(m, curve) - true, axis=1) for m in maps])
    return errors_of(errors, draws=len(maps))


def fit_model(source: Array, target: Array, model: str) -> Array:
    """The map that `vfplan.fit_registration` gives."""
    from vfplan.registration.registration import fit_registration

    registration = fit_registration(source, target, model=model, pixel_spacing=PIXEL_M)
    return registration.T_target_source


def fit_bare(source: Array, target: Array) -> Array:
    """The paper's ordinary least squares, bare: no residuals, no covariance, no checks."""
    X = np.column_stack([source, np.ones(len(source))])
    return np.linalg.lstsq(X, target, rcond=None)[0].T


METHODS: dict[str, Callable[[Array, Array], Array]] = {
    "affine": partial(fit_model, model="affine"),
    "similarity": partial(fit_model, model="similarity"),
    "rigid": partial(fit_model, model="rigid"),
    "bare least squares": fit_bare,
}
