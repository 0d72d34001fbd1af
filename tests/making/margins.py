"""A registered line and ring with a margin."""

from __future__ import annotations

import numpy as np
from layouts import PX, grid, planar

from vfplan.fixture import Curve, Fixture, Provenance
from vfplan.registration.registration import fit_registration

MADE = Provenance("2024-01-01T00:00:00Z", "vfplan 0")


def drawn(points, closed=False):
    points = np.asarray(points, float)
    stroke = Curve(np.zeros(len(points), np.int32), np.array([closed]))
    return Fixture("image", np.c_[points, np.zeros(len(points))], MADE, curve=stroke)


def registered():
    return fit_registration(grid(), planar(grid()), model="affine", pixel_spacing=PX)


T = np.linspace(0, 2 * np.pi, 800, endpoint=False)


LINE = drawn(np.c_[np.linspace(200, 600, 401), np.full(401, 380.0)])


CLOCKWISE = drawn(np.c_[400 + 150 * np.cos(T), 380 + 150 * np.sin(T)], closed=True)
