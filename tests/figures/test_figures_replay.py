"""Pictures of a replay: what is drawn where, and depth carried back onto the slice."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import rgb2hex
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image
from refusals import refuses
from replays import at_1_khz, fixture_of, line, probing

from vfplan import PlannedImage
from vfplan.errors import InputError
from vfplan.figures import replay as pictures
from vfplan.figures.replay import depth_along, plane_basis, scene, timeline
from vfplan.figures.style import save_png
from vfplan.fixture import Guidance, RegistrationRecord
from vfplan.palette import WALL
from vfplan.replaying.metrics import CurveRuler
from vfplan.replaying.replay import ThinnedTicks, replay
from vfplan.report.page import scene_data

T_ROBOT_IMAGE = np.array([[5e-4, 1e-4, 0.3], [-1e-4, 5e-4, -0.1], [1e-5, 2e-5, 0.02]])


@pytest.fixture(scope="module")
def pressed():
    limits = tuple(("force_max_n", "at_most", newtons) for newtons in (1.0, 1000.0))
    return replay(fixture_of(line()), probing(), limits=limits)


def test_timeline_shades_each_episode_and_shows_the_force(pressed):
    top, *_ = timeline(pressed).axes
    spans = [patch.get_extents() for patch in top.patches]
    assert len(spans) == len(pressed.metrics["episodes"]) == 4
    lines = {line.get_label(): line for line in top.get_lines()}
    # A force that is always 0 is left out, and a limit that leaves the force no room.
    assert set(lines) == {"$F_y$", "|F|".join("$$"), "limit 1 N"}
    assert_allclose(lines["$|F|$"].get_ydata().max(), pressed.metrics["force_max_n"])


def test_scene_shows_where_the_proxy_stops_and_where_it_touched(pressed):
    axes = scene(pressed).axes[0]
    wall, _ = axes.collections
    assert rgb2hex(wall.get_edgecolor()[0]) == WALL
    assert_allclose(wall.get_offsets(), 1e3 * pressed.fixture.points[:, :2])
    assert (wall._widths[0], scene_data(pressed.fixture)["wall"]["radius"]) == (5.0, 5.0)
    assert len(axes.lines[-1].get_xdata()) == pressed.metrics["contact_ticks"]
    assert axes.get_aspect() == 1.0


@pytest.mark.parametrize("times", [1, 100])
def test_scene_shows_the_whole_path_or_says_how_much_is_left_out(pressed, times):
    ends = np.linspace([0.05, 5e-3, 0], [0.05 + 0.1 * times, 0.02, 0], 100)
    [axes] = scene(replay(pressed.fixture, at_1_khz(ends))).axes
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()]) / 1e3
    is_seen = ((ends[:, :2] >= low) & (ends[:, :2] <= high)).all()
    assert is_seen == (times == 1)
    assert ("of the tip's path lies outside" in axes.get_title("right")) != is_seen


def test_scene_shows_the_whole_tube_of_a_guide():
    guided = replace(fixture_of(line()), guidance=Guidance(0.05, 1000.0))
    [axes] = scene(replay(guided, probing(1.0))).axes
    assert axes.get_ylim()[0] < -50 < 50 < axes.get_ylim()[1]  # mm
    [tube] = axes.collections[0].get_paths()
    assert tube.contains_points([[-49, 0], [149, 0], [-40, 40]]).tolist() == [True, True, False]


def test_solid_scenes_are_drawn_too(tmp_path):
    save_png(scene(replay(fixture_of(line(), axis=None), probing(1.0))), tmp_path / "s.png")
    assert np.asarray(Image.open(tmp_path / "s.png")).std() > 1


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, 1, 0), (0.1, -0.2, -0.97)])
def test_plane_basis_is_right_handed_and_not_mirrored(axis):
    axis = np.array(axis, float) / np.linalg.norm(axis)
    basis = plane_basis(axis)
    assert_allclose(basis.T @ basis, np.eye(2), atol=1e-12)
    assert_allclose(basis.T @ axis, 0, atol=1e-12)
    assert_array_equal(plane_basis(-axis), basis)
    if abs(axis[2]) > 0.9:
        assert np.cross(*basis.T)[2] > 0  # x to the right, y up


def test_depth_along_the_curve(pressed):
    ruler, depth = CurveRuler(pressed.fixture), depth_along(pressed)
    t = pressed.ticks
    for where in (0.0275, 0.0425):
        k = np.searchsorted(ruler.arclength, where)
        near = np.abs(t.proxy[:, 0] - where) < 0.3e-3
        assert depth[k] == pytest.approx(t.penetration[near].max(), abs=5e-5)
    assert depth[: np.searchsorted(ruler.arclength, 0.02)].max() == 0
    assert depth.max() == t.penetration.max()


def test_depth_is_carried_back_to_the_slice(pressed):
    uv = np.stack([np.linspace(20, 180, len(line())), np.full(len(line()), 60.0)], axis=1)
    points = uv @ T_ROBOT_IMAGE[:, :2].T + T_ROBOT_IMAGE[:, 2]
    record = RegistrationRecord("affine", "image", T_ROBOT_IMAGE, ("a",), uv[:1], points[:1],
                                np.zeros(1), 0.0)  # fmt: skip
    fixture = replace(pressed.fixture, points=points, registration=record)
    moved = replace(pressed, fixture=fixture)
    image = PlannedImage(np.zeros((120, 200, 3), np.uint8))
    wall = SimpleNamespace(kind="wall", lines=[uv + 10])
    axes = pictures.slice_depth(moved, image, [wall]).axes[0]
    assert_allclose(axes.collections[-1].get_segments(), wall.lines)
    assert [text.get_text() for text in axes.texts] == ["start", "end"]
    drawn = np.vstack([axes.lines[0].get_xydata(), axes.collections[0].get_offsets()])
    assert_allclose(np.sort(drawn, axis=0), uv, atol=1e-9)
    with refuses(InputError, "no-image-registration"):
        pictures.slice_depth(pressed, image)


def test_overview_keeps_the_deepest_of_each_stretch(pressed):
    ticks = pressed.ticks
    overview = ThinnedTicks(500)
    for start in range(0, 3000, 250):
        overview.update(ticks[start : start + 250])
    kept = overview.ticks
    assert 250 < len(kept) <= 500
    assert kept.penetration.max() == ticks.penetration.max()
    assert (np.diff(kept.time) > 0).all()
    none = ThinnedTicks(0)
    none.update(ticks)
    assert len(none.ticks) == 0
