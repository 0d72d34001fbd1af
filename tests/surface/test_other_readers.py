"""Meshes and label maps that trimesh and SimpleITK write and read: the same places as ours."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vfplan.bundle.exporting import export
from vfplan.bundle.importing import import_cloud
from vfplan.surface.sources import read_contours

TURNS = [*Rotation.create_group("O").as_matrix(), *Rotation.random(6, random_state=5).as_matrix()]


@pytest.mark.parametrize(
    "suffix, form",
    [("stl", "stl"), ("stl", "stl_ascii"), ("ply", "ply"), ("ply", "ascii"), ("obj", "obj")],
)
def test_a_mesh_of_trimesh_is_read_as_it_is_and_ours_by_trimesh(tmp_path, suffix, form):
    trimesh = pytest.importorskip("trimesh")
    made = trimesh.creation.box((10.0, 20.0, 35.0)).subdivide()
    made.apply_transform(trimesh.transformations.random_rotation_matrix())
    made.apply_translation((40.0, -7.0, 300.0))
    path = tmp_path / f"m.{suffix}"
    if form == "ascii":
        path.write_bytes(trimesh.exchange.ply.export_ply(made, encoding="ascii"))
    else:
        made.export(path, file_type=form)
    fixture = import_cloud(path, units="mm")
    ours = trimesh.Trimesh(1e3 * fixture.points, fixture.mesh, process=False)
    assert np.allclose(ours.bounds, made.bounds, rtol=0, atol=1e-4)
    assert ours.volume == pytest.approx(made.volume, rel=1e-5)
    export(fixture, tmp_path / "back.stl")
    export(fixture, tmp_path / "back.ply")
    for name, scale in (("back.stl", 1.0), ("back.ply", 1e3)):
        back = trimesh.load(tmp_path / name)
        assert np.allclose(scale * back.bounds, made.bounds, rtol=0, atol=1e-4)
        assert scale**3 * back.volume == pytest.approx(made.volume, rel=1e-5)


@pytest.mark.parametrize("suffix", [".nrrd", ".nii.gz"])
@pytest.mark.parametrize("number", [0, 5, 11, 24, 27] + [
    pytest.param(k, marks=pytest.mark.slow) for k in range(len(TURNS))])  # fmt: skip
def test_a_label_map_of_simpleitk_lies_where_simpleitk_says(tmp_path, suffix, number):
    sitk = pytest.importorskip("SimpleITK")
    labels = np.zeros((9, 14, 12), np.uint8)
    low, high = np.array([2, 4, 1]), np.array([5, 11, 3])
    labels[1:4, 4:12, 2:6] = 1
    image = sitk.GetImageFromArray(labels)
    image.SetSpacing((0.7, 1.1, 2.0))
    image.SetOrigin((-31.0, 12.5, 407.0))
    image.SetDirection(TURNS[number].ravel().tolist())
    path = tmp_path / f"m{suffix}"
    sitk.WriteImage(image, str(path))
    rings = 1e3 * np.concatenate(read_contours([path]).rings)
    indices = np.array([image.TransformPhysicalPointToContinuousIndex(p) for p in rings.tolist()])
    # An outline runs around the pixels, a little rounded, in the planes of the slices.
    across = np.argmax(np.ptp(indices, axis=0) - (high - low) < 0.25)
    around = 0.5 * (np.arange(3) != across)
    assert np.allclose(indices.min(axis=0), low - around, rtol=0, atol=0.25)
    assert np.allclose(indices.max(axis=0), high + around, rtol=0, atol=0.25)
