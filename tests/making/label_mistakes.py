"""Marker sets with a known transform, and the mistakes that people make with their labels.

Nothing here uses vfplan. A set has 3 to 12 markers on a grid, a ring or at random, in a slice of
1024 x 1024 px of 0.5 mm, in any pose; each position in the robot's frame has a localisation error
whose size (FLE, the RMS of its length) is drawn log-uniformly from 0.1 to 1 mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from drawing import unit
from scipy.spatial.transform import Rotation

SIDE_PX, PX_M = 1024.0, 0.5e-3
LAYOUTS = ("grid", "ring", "random")
MISTAKES = ("reversed", "shifted", "exchanged", "permuted")
JITTERS_PX = (0.3, 5.0, 20.0)  # as printed, as set with care, as a hand sets them


@dataclass
class MarkerSet:
    """Markers in the order of their labels.

    `source` (N, 2) [px]; `target` (N, 3) in the robot's frame [m]; `truth` (3, 3) takes [u v 1] to
    that frame; `orders` has, for each mistake, which marker's position stands under each label.
    """

    number: int
    layout: str
    fle_m: float
    source: np.ndarray
    target: np.ndarray
    truth: np.ndarray
    orders: dict[str, np.ndarray]


def marker_set(number):
    """The set with this number; the same wherever and whenever it is drawn."""
    rng = np.random.default_rng([37, number])
    layout = LAYOUTS[number % 3]
    n = int(rng.integers(3, 13))
    source = _placed(layout, n, rng)
    rotation = Rotation.from_quat(np.roll(rng.normal(size=4), -1)).as_matrix()
    truth = np.column_stack([rotation[:, :2] * PX_M, rng.uniform(-0.5, 0.5, 3)])
    fle = float(np.exp(rng.uniform(np.log(1e-4), np.log(1e-3))))
    places = np.column_stack([source, np.ones(n)]) @ truth.T
    target = places + rng.normal(0, fle / np.sqrt(3), (n, 3))
    return MarkerSet(number, layout, fle, source, target, truth, _orders(n, rng))


def _placed(layout, n, rng):
    if layout == "random":
        return rng.uniform(60, SIDE_PX - 60, (n, 2))
    if layout == "ring":
        turn = 2 * np.pi * np.arange(n) / n + rng.uniform(0, 2 * np.pi)
        places = SIDE_PX / 2 + 380 * unit(turn)
    else:
        columns = int(np.ceil(np.sqrt(n)))
        step = 760 / max(columns - 1, 1)
        cells = np.array([[k % columns, k // columns] for k in range(n)])
        places = 130 + step * cells
    return places + rng.normal(0, JITTERS_PX[int(rng.integers(3))], (n, 2))


def _orders(n, rng):
    forward = np.arange(n)
    exchanged = forward.copy()
    a, b = rng.choice(n, 2, replace=False)
    exchanged[[a, b]] = exchanged[[b, a]]
    permuted = forward
    while (permuted == forward).any():
        permuted = rng.permutation(n)
    return {
        "reversed": forward[::-1],
        "shifted": np.roll(forward, int(rng.choice([-1, 1]))),
        "exchanged": exchanged,
        "permuted": permuted,
    }


def curve_error(T_robot_image, truth):
    """Largest distance of a circle of 300 px about the middle from its true place [m]."""
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    u, v = SIDE_PX / 2 + 300 * np.cos(turn), SIDE_PX / 2 + 300 * np.sin(turn)
    circle = np.column_stack([u, v, np.ones(len(u))])
    return float(np.linalg.norm(circle @ (T_robot_image - truth).T, axis=1).max())
