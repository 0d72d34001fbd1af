"""Print the table of docs/registration.md:  python docs/make_registration_table.py

Markers drawn with known noise, fitted again and again; predicted errors against true ones.
"""

from __future__ import annotations

import numpy as np

import vfplan
from vfplan.registration import bounds

PIXEL = 0.6e-3  # m
NOISE = 0.3e-3  # m an axis
FITS = 3000
LAYOUTS = {
    "9, grid": np.array([[u, v] for v in (80.0, 380, 680) for u in (100.0, 400, 700)]),
    "6, strip": np.array(
        [[100.0, 305], [220, 270], [340, 320], [460, 290], [580, 310], [700, 285]]
    ),
    "4, kite": np.array([[100.0, 100], [700, 150], [300, 600], [420, 380]]),
}


def curve() -> np.ndarray:
    """A wave across the middle of the image [px]."""
    t = np.linspace(0, 1, 120)
    return np.column_stack([150 + 500 * t, 350 + 150 * np.sin(6 * t)])


def flat(points: np.ndarray) -> np.ndarray:
    """The true map: a table at z = 20 mm, seen from above."""
    return np.column_stack([points * [PIXEL, -PIXEL] + [0.4, -0.1], np.full(len(points), 0.02)])


def row(model: str, name: str) -> str:
    """Refit one layout and say what happened."""
    rng, points, source = np.random.default_rng(0), curve(), LAYOUTS[name]
    predicted, true, point, whole, widen = [], [], [], [], None
    for _ in range(FITS):
        target = flat(source) + rng.normal(0, NOISE, (len(source), 3))
        fit = vfplan.fit_registration(source, target, model=model, pixel_spacing=PIXEL)
        error = np.linalg.norm(fit.apply(points) - flat(points), axis=1)
        bound = fit.tre95_m(points)
        # The factor depends on the layout and the curve, not on the noise that was drawn.
        widen = widen or float((fit.tre95_curve_m(points) / bound)[0])
        predicted.append(fit.tre_m(points) ** 2)
        true.append(error**2)
        point.append(error <= bound)
        whole.append([(error <= bound).all(), (error <= widen * bound).all()])
    ratio = np.sqrt(np.mean(predicted) / np.mean(true))
    narrow, wide = np.mean(whole, axis=0)
    return (
        f"| {model} | {name} | {ratio:.3f} | {np.mean(point):.1%} | {narrow:.1%} | "
        f"{widen:.2f} | {wide:.1%} |"
    )


if __name__ == "__main__":
    bounds.MOST_UNSEEN = 0.0  # the band of the model alone
    for model in ("affine", "similarity", "rigid"):
        for name in LAYOUTS:
            print(row(model, name), flush=True)
