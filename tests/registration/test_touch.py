"""Points touched on a bone refine a registration: as well as predicted, or refused."""

import bones
import numpy as np
import pytest
from refusals import refuses

from vfplan.errors import MarkerError, SettingError
from vfplan.geometry.lines import row_lengths
from vfplan.registration.models import RARE_PROBABILITY, rms
from vfplan.registration.registration import fit_registration
from vfplan.registration.touch import NearestOnMesh, refine_by_touch
from vfplan.surface.build import SurfaceSettings, surface

MARKS = 1e-3 * np.array(
    [[20, 0, -30], [-20, 5, -10], [10, 25, 20], [-12, -20, 36], [14, -22, 8.0], [30, 4, 12]]
)
C, S = np.cos(0.7), np.sin(0.7)
R_TRUE = np.array([[C, -S, 0], [S, C, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, C, S], [0, -S, C]])
SHIFT = np.array([0.45, -0.1, 0.3])


def robot(points):
    return points @ R_TRUE.T + SHIFT


@pytest.fixture(scope="module")
def bone(tmp_path_factory):
    path = tmp_path_factory.mktemp("bone") / "s.dcm"
    bones.write_rtstruct(path, bones.outlines(bones.BENT, 5))
    return surface(path, settings=SurfaceSettings(tolerance_m=4e-4)).fixture


def marked(rng, error=1e-3):
    """A registration by markers whose places are off by `error` an axis [m]."""
    return fit_registration(MARKS, robot(MARKS) + rng.normal(0, error, MARKS.shape), model="rigid")


def touches(bone, rng, count, where):
    """Places on the true bone that a robot touched."""
    chosen = np.flatnonzero(where(1e3 * bone.points))
    return robot(bone.points[rng.choice(chosen, count)]) + rng.normal(0, 1e-4, (count, 3))


def flank(points):
    return (np.abs(points[:, 2]) < 30) & (points[:, 0] > -5)


def refined(bone, start, touched, **settings):
    return refine_by_touch(start, touched, bone.points, bone.mesh, **settings)


def off(registration, bone):
    return row_lengths(registration.apply(bone.points) - robot(bone.points))


@pytest.mark.parametrize("count", [20, pytest.param(600, marks=pytest.mark.full)])
def test_the_predicted_error_is_the_error(bone, count):
    """Over repetitions: mean square error against its prediction, and the share of the bounds."""
    rng = np.random.default_rng(11)
    rows = []
    for _ in range(count):
        start = marked(rng, 5e-4)
        fitted = refined(bone, start, touches(bone, rng, 40, flank))
        assert 5e-5 < rms(fitted.distances_m[fitted.used]) < 2e-4
        assert fitted.constraint > 0.03
        found = fitted.registration
        away, at = off(found, bone), bone.points[::97]
        whole = (away[::97] <= found.tre95_curve_m(at)).all()
        rows.append([(off(start, bone) ** 2).mean(), (away**2).mean(),
                     (found.tre_m(at) ** 2).mean(), (away[::97] <= found.tre95_m(at)).mean(),
                     whole, fitted.used.mean()])  # fmt: skip
    markers, error, predicted, inside, whole, used = np.mean(rows, axis=0)
    assert 1 - used < 4 * RARE_PROBABILITY  # that a good touch is left out: of 24,000, 2.4
    assert 0.7 < np.sqrt(error / predicted) < 1.4
    assert inside > 0.8
    assert error < markers / 2
    if count > 100:
        assert 0.93 <= inside <= 0.97
        assert 0.93 <= whole <= 0.97


def test_what_touched_something_else_is_left_out(bone):
    rng = np.random.default_rng(6)
    points = touches(bone, rng, 60, flank)
    points[[5, 17, 40]] += [[4e-3, 0, 0], [0, -3e-3, 2e-3], [0, 0, 5e-3]] @ R_TRUE.T
    found = refined(bone, marked(rng), points)
    assert not found.used[[5, 17, 40]].any()
    assert found.used.sum() > 50
    bound = found.registration.tre95_curve_m(bone.points)
    assert bound.max() < 1.5e-3
    assert (off(found.registration, bone) <= bound).all()


def test_a_ball_tip_touches_with_its_radius(bone):
    rng = np.random.default_rng(5)
    rows = rng.choice(np.flatnonzero(flank(1e3 * bone.points)), 60)
    step = 1e-6
    level = bones.BENT.level
    at = 1e3 * bone.points[rows]
    steps = step * np.eye(3)
    normal = np.stack([(level(at + e) - level(at - e)) / step for e in steps], axis=1)
    normal /= row_lengths(normal)[:, None]
    centres = robot(bone.points[rows] + 1.5e-3 * normal)
    found = refined(bone, marked(rng), centres, tip_radius=1.5e-3)
    assert np.sqrt((off(found.registration, bone) ** 2).mean()) < 1e-4


def test_a_patch_that_leaves_a_motion_free_is_refused(bone):
    rng = np.random.default_rng(2)

    def cap(points):  # a flat end: it holds three motions of six
        return points[:, 2] > 39.49

    with refuses(MarkerError, "touch-free-motion"):
        refined(bone, marked(rng), touches(bone, rng, 50, cap))


def test_points_nowhere_near_the_bone_are_refused(bone):
    rng = np.random.default_rng(1)
    points = touches(bone, rng, 30, flank)
    affine = fit_registration(MARKS, robot(MARKS) + rng.normal(0, 1e-4, MARKS.shape))
    for start, touched, code in (
        (marked(rng), 1e3 * points, "touch-far"),
        (marked(rng), points[:11], "touch-count"),
        (affine, points, "touch-not-rigid"),
    ):
        with pytest.raises((MarkerError, SettingError)) as caught:
            refined(bone, start, touched)
        assert caught.value.code == code
        assert caught.value.numbers.get("points", 11) == 11


def test_the_nearest_place_on_a_mesh_is_the_nearest(bone):
    """Against all triangles, one by one, by trimesh."""
    triangles = pytest.importorskip("trimesh").triangles
    rng = np.random.default_rng(4)
    places = bone.points[rng.integers(0, len(bone.points), 60)] + rng.normal(0, 2e-3, (60, 3))
    found, rows = NearestOnMesh(bone.points, bone.mesh)(places)
    corners = bone.points[bone.mesh]
    for place, near in zip(places, found, strict=True):
        all_of_them = triangles.closest_point(corners, np.broadcast_to(place, (len(corners), 3)))
        best = row_lengths(all_of_them - place).min()
        assert np.linalg.norm(near - place) <= best + 1e-12
    weights = triangles.points_to_barycentric(corners[rows], found)
    assert weights.min() > -1e-9
    assert np.allclose((weights[:, :, None] * corners[rows]).sum(axis=1), found, atol=1e-12)
