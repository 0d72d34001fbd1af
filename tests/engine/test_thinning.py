"""Dense clouds are thinned: the proxy stays off all points, and a tick has less to look at."""

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

R = 5e-3


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
    round_ = 3e-3 * np.column_stack([np.cos(40 * t), 0 * t, np.sin(40 * t)])
    return np.where(t[:, None] < 0.3, round_, along) + draw.normal(0, 1e-5, (len(t), 3))


def test_a_tick_over_a_dense_sheet_fits_into_a_loop_where_one_over_all_points_does_not():
    dense, table = sheet(R / 140, 0.02), _core.Parameters(band=1e-5, stiffness=np.ones(3))
    assert _core.tick_time_bound(dense, table) < 0.8 * _core.max_tick_time
    all_points = _core.Parameters(table, search="editable")
    assert _core.tick_time_bound(dense, all_points) > 2 * _core.max_tick_time


@pytest.mark.parametrize("make, axis", [(wavy, None), (stairs, None), (pen, "y")])
def test_the_proxy_is_off_every_point_and_where_all_points_would_have_it(make, axis):
    points, t = make(np.random.default_rng(3)), np.arange(0, 3, 2e-3)
    middle, top = points.mean(axis=0), points[:, 2].max()
    hips = np.column_stack([
        middle[0] + 2e-3 * np.sin(5 * t), middle[1] + 2e-3 * np.cos(4 * t),
        top + R - 4e-3 + 4.5e-3 * np.cos(3 * t)])  # fmt: skip
    engines = [vfplan.ProxyEngine(points, band=5e-5, ignore_axis=axis) for _ in range(2)]
    engines[1].make_editable()  # with all points
    thin, whole = (engine.run(hips) for engine in engines)
    flat = [1, axis is None, 1]
    off = cKDTree(points * flat).query(thin.proxy * flat)[0]
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
