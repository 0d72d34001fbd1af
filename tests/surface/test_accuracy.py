"""Surfaces against bones with a closed form: polygons, label maps, and all formats alike."""

import resource
import subprocess
import sys
import time

import bones
import numpy as np
import pytest
from bones import BENT, BRANCHES, TUNNEL

from vfplan.surface.build import SurfaceSettings, surface

pytestmark = pytest.mark.slow


def off(bone, made, high=None):
    """Distances of the surface's points from the bone, but for the caps [mm]."""
    points = 1e3 * made.fixture.points
    high = bone.high if high is None else high
    return bone.distance(points[(points[:, 2] >= bone.low) & (points[:, 2] <= high)])


def rms(values):
    return float(np.sqrt((values**2).mean()))


def narrowest_deg(corners):
    """The narrowest angle of triangles (K, 3, 3)."""
    sides = np.roll(corners, -1, axis=1) - corners
    sides /= np.linalg.norm(sides, axis=2, keepdims=True)
    return np.degrees(np.arccos((-sides * np.roll(sides, 1, axis=1)).sum(axis=2).max()))


LONG = [pytest.param(BENT, gap, marks=pytest.mark.full) for gap in (1, 2, 3)]
LONG += [pytest.param(bone, 2, marks=pytest.mark.full) for bone in (TUNNEL, BRANCHES)]
CASES = [*LONG, (BENT, 5), (TUNNEL, 5), (BRANCHES, 5)]


@pytest.mark.parametrize("bone, gap", CASES)
def test_polygons_give_the_bone(bone, gap, tmp_path):
    path = bones.write_rtstruct(tmp_path / "s.dcm", bones.outlines(bone, gap))
    made = surface(path, settings=SurfaceSettings(tolerance_m=5e-4))
    away = off(bone, made, bone.places(gap)[-1])
    assert rms(away) <= 0.05
    assert np.abs(away).max() <= 0.15
    report = made.report
    assert report["slices"] == len(bone.places(gap))
    assert report["spacing_mm"] == pytest.approx(gap, abs=1e-6)
    assert report["open_edges"] == 0
    assert report["contour_error_mm"]["max"] < 0.2
    assert report["level_error_mm"] < 1e-4
    assert narrowest_deg(made.fixture.points[made.fixture.mesh]) > 4
    # The outlines between slices are surely no worse than what a slice left out is missed by.
    assert rms(away) < report["left_out_slice_mm"]["rms"] + 0.02


@pytest.mark.parametrize("gap", [pytest.param(1, marks=pytest.mark.full), 3, 5])
def test_label_maps_give_the_bone_to_a_quarter_of_a_pixel(gap, tmp_path):
    grid = bones.grid_round(gap)
    path = bones.write_nifti(tmp_path / "s.nii.gz", grid.labels(BENT), grid)
    made = surface(path, settings=SurfaceSettings(tolerance_m=5e-4))
    away = off(BENT, made, BENT.places(gap)[-1])
    assert rms(away) <= 0.12
    assert made.report["open_edges"] == 0


def test_all_formats_of_one_object_agree(tmp_path):
    gap = 3
    grid = bones.grid_round(gap)
    labels = grid.labels(BENT)
    outlines = bones.outlines(BENT, gap)
    drawn = {
        "rtstruct": bones.write_rtstruct(tmp_path / "s.dcm", outlines),
        "slicer": bones.write_curves(tmp_path / "s.mrk.json", outlines),
        "slicer ras": bones.write_curves(tmp_path / "r.mrk.json", outlines, ras=True),
    }
    mapped = {
        "seg": bones.write_seg(tmp_path / "g.dcm", labels, grid),
        "nrrd": bones.write_nrrd(tmp_path / "s.seg.nrrd", labels, grid),
        "nrrd ras": bones.write_nrrd(
            tmp_path / "r.nrrd", labels, grid, space="right-anterior-superior"
        ),
        "nifti": bones.write_nifti(tmp_path / "s.nii", labels, grid),
    }
    coarse = SurfaceSettings(tolerance_m=1e-3)
    made = {name: surface(path, settings=coarse) for name, path in (drawn | mapped).items()}
    last = BENT.places(gap)[-1]
    for name in made:
        assert np.abs(off(BENT, made[name], last)).max() < (0.05 if name in drawn else 0.25), name
    volumes = {name: m.report["volume_mm3"] for name, m in made.items()}
    assert list(volumes.values()) == pytest.approx([volumes["rtstruct"]] * 7, rel=0.005)
    # The label maps are the same voxels: the same surface, whatever the file.
    for name in mapped:
        points = made[name].fixture.points
        assert np.abs(points - made["nifti"].fixture.points).max() < 1e-6, name


@pytest.mark.full
def test_a_fractional_segmentation_is_finer_than_a_binary_one(tmp_path):
    """Shares of 0 to 255 say where in a pixel the border runs."""
    grid = bones.grid_round(3)
    fine = bones.Grid(
        grid.corner - [0.1875, 0.1875, 0], grid.axes / [4, 4, 1],
        (4 * grid.size[0], 4 * grid.size[1], grid.size[2]),
    )  # fmt: skip
    inside = fine.labels(BENT)
    share = inside.reshape(grid.size[0], 4, grid.size[1], 4, -1).mean(axis=(1, 3))
    levels = np.rint(255 * share).astype(np.uint8)
    path = bones.write_seg(tmp_path / "f.dcm", levels, grid, kind="FRACTIONAL")
    made = surface(path, settings=SurfaceSettings(tolerance_m=2e-4))
    assert rms(off(BENT, made, BENT.places(3)[-1])) < 0.04


@pytest.mark.full
def test_a_whole_series_takes_seconds_and_a_bounded_memory(tmp_path):
    """512 x 512 x 200 voxels of a pelvis' size: half of the figures that docs/surface.md states."""
    big = bones.Grid(np.array([-205.0, -205, -100]), np.diag([0.8, 0.8, 1.0]), (512, 512, 200))

    def level(points):
        return np.hypot(np.hypot(points[:, 0], 1.4 * points[:, 1]) - 110, points[:, 2]) - 60

    labels = np.empty(big.size, np.uint8)
    for k in range(200):
        one = bones.Grid(big.corner + k * big.axes[:, 2], big.axes, (512, 512, 1))
        labels[:, :, k] = one.labels(bones.Bone(level, None, -59, 59))[:, :, 0]
    path = bones.write_nrrd(tmp_path / "p.seg.nrrd", labels, big)
    program = "import sys; from vfplan.surface.build import surface; surface(sys.argv[1])"
    started = time.perf_counter()
    subprocess.run([sys.executable, "-c", program, str(path)], check=True, cwd=tmp_path)
    elapsed = time.perf_counter() - started
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"512 x 512 x 200: {elapsed:.1f} s, {used.ru_utime:.1f} s CPU, "
          f"{used.ru_maxrss / 1e6:.2f} GB")  # fmt: skip
    assert used.ru_maxrss < 3e6
