"""Meshes with openings of known width: each that the proxy fits through is told, and no other."""

from __future__ import annotations

from dataclasses import replace

import bundles
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vfplan.bundle.exporting import export
from vfplan.bundle.importing import import_cloud

RADIUS_MM = 5.0
AT = np.array([30.0, -400.0, 90.0])


def plate(width, length, wave=0.0):
    """(points, triangles) [mm] of a sheet of 100 mm with a slot; `wave` is how high it is bent."""

    def axis(half, hole):
        beside = np.linspace(hole / 2, half, 30)
        within = np.linspace(-hole / 2, hole / 2, max(2, round(hole)))
        return np.unique(np.concatenate((-beside, within, beside)))

    x, y = axis(50, width), axis(50, length)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.column_stack((points, wave * np.cos(points[:, 1] / 30)))
    i, j = (grid.ravel() for grid in np.indices((len(x) - 1, len(y) - 1)))
    is_hole = (np.abs(x[i] + x[i + 1]) < width) & (np.abs(y[j] + y[j + 1]) < length)
    corner = (i * len(y) + j)[~is_hole]
    beyond = corner + len(y)
    lower = np.column_stack((corner, beyond, beyond + 1))
    return points, np.concatenate((lower, np.column_stack((corner, beyond + 1, corner + 1))))


def imported(path, points, faces):
    """The fixture of a mesh [mm] that went through a PLY [m]."""
    export(replace(bundles.small(), points=1e-3 * points, mesh=faces), path)
    return import_cloud(path, units="m", contact_radius=1e-3 * RADIUS_MM)


# (width, length, height of the bend) [mm]; the proxy is a ball of 10 mm.
FEW = [(12, 60, 0), (9.8, 60, 0), (12, 60, 8), (10.2, 10.2, 0), (4, 80, 8), (30, 30, 0)]
ROWS = np.random.default_rng(8).uniform((6, 14, 0), (14, 80, 8), (54, 3)).tolist()
CASES = FEW + [pytest.param(*row, marks=pytest.mark.slow) for row in ROWS]


@pytest.mark.parametrize("width, length, wave", CASES)
def test_an_opening_that_the_proxy_fits_through_is_told(tmp_path, width, length, wave):
    points, faces = plate(width, length, wave)
    turn = Rotation.random(random_state=int(100 * width))
    fixture = imported(tmp_path / "m.ply", turn.apply(points) + AT, faces)
    told = [finding for finding in fixture.findings if finding.code == "mesh-open"]
    if abs(width - 2 * RADIUS_MM) > 0.2:
        assert bool(told) == (width > 2 * RADIUS_MM)
    for finding in told:
        ball = float(finding.text.split(" mm, goes a ball of ")[1].split()[0])
        assert abs(ball - width) < 0.15
        place = turn.inv().apply(1e3 * np.array(finding.place_m) - AT)
        assert (np.abs(place[:2]) < (0.3, length / 2)).all()


def test_a_closed_mesh_and_a_bare_sheet_have_no_opening(tmp_path):
    for wave in (0.0, 8.0):
        assert not imported(tmp_path / f"{wave}.ply", *plate(0.5, 0.5, wave)).findings
