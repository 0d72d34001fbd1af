"""Dense clouds are thinned: what is left out is felt by no more than the told part of the band."""

from dataclasses import replace

import bundles
import numpy as np
import pytest
from motion import grid
from scipy.spatial import cKDTree

import vfplan
from vfplan import _core
from vfplan.errors import SceneError
from vfplan.fixture import Rendering

R, Z = 5e-3, np.array([0.0, 0, 1])


def settings(band, axis=None):
    return _core.Parameters(band=band, ignore_axis=axis)


def sheet(spacing, side):
    return grid(np.arange(0, side, spacing), np.arange(0, side, spacing))


def wavy(draw):
    """Strewn over hills, in no order, with noise of a fifth of the spacing."""
    x, y = draw.uniform(0, 0.012, (2, 20_000))
    z = 1e-3 * np.sin(400 * x) * np.cos(300 * y) + draw.uniform(0, 2e-5, x.shape)
    return np.column_stack([x, y, z])


def stairs(draw):
    """Voxels of 0.05 mm on a ball's side."""
    i = np.arange(-70, 71) * 5e-5
    x, y, z = (a.ravel() for a in np.meshgrid(i, i, np.arange(14e-3, 15.1e-3, 5e-5)))
    on = abs(np.sqrt(x * x + y * y + z * z) - 0.015) < 2.5e-5
    return np.column_stack([x, y, z])[on]


def pen(draw):
    """Along a thick line and a circle, in a plane."""
    t = draw.uniform(0, 1, 40_000)
    along = np.column_stack([0.02 * t, np.zeros((len(t), 2))])
    round_ = 3e-3 * np.column_stack([np.cos(40 * t), np.sin(40 * t), 0 * t])
    return np.where(t[:, None] < 0.3, round_, along) + draw.normal(0, 1e-5, (len(t), 3))


@pytest.mark.parametrize(("make", "band", "axis"),
    [(wavy, 3e-5, None), (stairs, 5e-5, None), (pen, 2e-5, Z)])  # fmt: skip
def test_a_ball_that_is_off_what_is_kept_is_off_all(make, band, axis):
    """Places R - band from points that were left out: near enough to one that was kept."""
    draw = np.random.default_rng(8)
    points = make(draw)
    kept, lent = _core.thinned(points, settings(band, axis))
    flat, tree = points[:, : kept.shape[1]], cKDTree(kept)
    gap = tree.query(flat)[0]
    assert lent == band / 2
    assert len(kept) < 0.4 * len(points)
    left_out = flat[gap > 0][:: max(1, np.count_nonzero(gap > 0) // 60)]
    inner, outer = R - band, R - band + lent + 1e-13
    way = draw.normal(size=(len(left_out), 100, kept.shape[1]))
    for spread in (0.3, 0.03, 0.003):  # the worst direction, then about it
        way /= np.linalg.norm(way, axis=2)[:, :, None]
        off = tree.query(left_out[:, None] + inner * way)[0]
        assert off.max() <= outer
        worst = np.take_along_axis(way, off.argmax(axis=1)[:, None, None], axis=1)
        way = worst + spread * draw.normal(size=way.shape)
    inside = 0.99 * inner * draw.random((*way.shape[:2], 1)) * way
    assert tree.query(left_out[:, None] + inside)[0].max() <= outer


def test_a_tick_over_a_dense_sheet_has_hardly_more_to_look_at_than_over_a_coarse_one():
    sparse, dense = sheet(R / 10, 0.02), sheet(R / 140, 0.02)
    kept, lent = _core.thinned(sparse, settings(1e-5))
    assert lent == 0
    assert np.array_equal(kept, sparse)
    kept, lent = _core.thinned(dense, settings(1e-5))
    tree = cKDTree(kept)
    assert max(map(len, tree.query_ball_point(kept[::50], 1.35 * R))) < 3000  # of 110,000
    assert _core.tick_time_bound(dense, settings(1e-5)) < 0.8 * _core.max_tick_time
    all_points = _core.Parameters(settings(1e-5), search="editable")
    assert _core.tick_time_bound(dense, all_points) > 2 * _core.max_tick_time


@pytest.mark.parametrize("make", [wavy, stairs])
def test_the_proxy_is_off_every_point_and_where_all_points_would_have_it(make):
    points, t = make(np.random.default_rng(3)), np.arange(0, 3, 2e-3)
    middle, top = points.mean(axis=0), points[:, 2].max()
    hips = np.column_stack([
        middle[0] + 2e-3 * np.sin(5 * t), middle[1] + 2e-3 * np.cos(4 * t),
        top + R - 4e-3 + 4.5e-3 * np.cos(3 * t)])  # fmt: skip
    engines = [vfplan.ProxyEngine(points, band=5e-5) for _ in range(2)]
    engines[1].make_editable()  # with all points
    thin, whole = (engine.run(hips) for engine in engines)
    off = cKDTree(points).query(thin.proxy)[0]
    assert off.min() >= R - 5e-5
    assert engines[0].distance(thin.proxy) == pytest.approx(off, rel=1e-12)
    assert np.median(np.linalg.norm(thin.proxy - whole.proxy, axis=1)) < 5e-5
    assert (thin.state == 1).sum() > 500


def test_a_cloud_too_dense_for_a_loop_as_a_whole_is_rendered_but_not_edited_in_one():
    rendering = Rendering(np.full(3, 1000.0), R, 1e-5)
    fixture = replace(bundles.small(), points=sheet(R / 60, 0.02), rendering=rendering)
    engine = vfplan.ProxyEngine.of(fixture)
    with pytest.raises(SceneError, match="so dense a cloud is thinned"):
        engine.edit(remove=[5])
    assert vfplan.ProxyEngine.of(fixture, offline=True).edit(remove=[5])
