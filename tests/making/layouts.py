"""Marker layouts with a known transform: a grid, planar and solid ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

R = Rotation.from_rotvec([3.0, 0.2, 0.1]).as_matrix()
MODELS = ("affine", "similarity", "rigid")
every_model = pytest.mark.parametrize("model", MODELS)
flat_and_solid = pytest.mark.parametrize("kind", ["planar", "solid"])
PX = 0.6e-3
NAMES = [f"x{i}" for i in range(1, 10)]


def grid(n=9, jitter=12.0, seed=3):
    u, v = np.meshgrid([100.0, 400.0, 700.0], [80.0, 380.0, 680.0])
    layout = np.column_stack([u.ravel(), v.ravel()])
    return (layout + np.random.default_rng(seed).normal(0, jitter, (9, 2)))[:n]


def planar(source, noise=3e-4, seed=0):
    flat = np.column_stack([source * PX, np.zeros(len(source))])
    error = np.random.default_rng(seed).normal(0, noise, (len(source), 3))
    return flat @ R.T + [0.4, -0.1, 0.02] + error


def solid(n=6, noise=3e-4):
    rng = np.random.default_rng(5)
    source = rng.uniform(-0.1, 0.1, (n, 3))
    return source, source @ R.T + [0.4, 0.1, 0.2] + rng.normal(0, noise, (n, 3))


def markers(kind, n=8):
    """Source, target and pixel spacing of good "planar" or "solid" markers."""
    return (grid(), planar(grid()), PX) if kind == "planar" else (*solid(n), None)


def fit(source, target, model="affine", **settings):
    """The registration of markers with names, and with their pixel spacing if planar."""
    from vfplan.registration.registration import fit_registration

    spacing = {"pixel_spacing": PX} if np.shape(source)[1] == 2 else {}
    known = {"labels": NAMES[: len(source)]} | spacing
    return fit_registration(source, target, model=model, **known | settings)


def photograph(shared_data, view):
    """(N, 2) pixels and (N, 3) places [mm] of the corners of a board in a real photograph."""
    names = ("image_points", "object_points")
    folder = shared_data / "photo_px_to_mm"
    return [np.loadtxt(folder / f"calib.{name}.{view}.txt") for name in names]


def bent(source, noise=3e-4):
    """Markers whose picture is the homography of a plane."""
    target = planar(source, 0) / (1 + (source - [400, 380]) @ [2e-4, -1e-4])[:, None]
    return target + np.random.default_rng(0).normal(0, noise, target.shape)
