"""Marker layouts with a known transform: a grid, planar and solid ones."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

R = Rotation.from_rotvec([3.0, 0.2, 0.1]).as_matrix()
MODELS = ("affine", "similarity", "rigid")
PX = 0.6e-3


def grid(n=9, jitter=12.0, seed=3):
    u, v = np.meshgrid([100.0, 400.0, 700.0], [80.0, 380.0, 680.0])
    layout = np.column_stack([u.ravel(), v.ravel()])
    return (layout + np.random.default_rng(seed).normal(0, jitter, (9, 2)))[:n]


def planar(source, noise=3e-4, seed=0):
    flat = np.column_stack([source * PX, np.zeros(len(source))])
    error = np.random.default_rng(seed).normal(0, noise, (len(source), 3))
    return flat @ R.T + [0.4, -0.1, 0.02] + error


def solid(n=6, noise=3e-4, seed=5):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-0.1, 0.1, (n, 3))
    return source, source @ R.T + [0.4, 0.1, 0.2] + rng.normal(0, noise, (n, 3))
