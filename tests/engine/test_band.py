"""The band that a cloud asks for, against closed forms, brute-force neighbours and dirt."""

import numpy as np
import pytest
from conftest import dimple_depth
from motion import grid

from vfplan import ProxyParameters

R, Z = 5e-3, np.array([0.0, 0.0, 1.0])


def band(points, axis=None, radius=R):
    return ProxyParameters.make(points, radius, ignore_axis=axis).band


def line(h, n=200):
    return np.arange(n)[:, None] * h * np.array([1.0, 0, 0])


def sheet(h, n=41, height=0.0):
    return grid(np.arange(n) * h, np.arange(n) * h, height)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6, 0.95])
@pytest.mark.parametrize("radius", [1e-5, 5e-3, 1e3])
def test_even_points_ask_for_their_dimple(share, radius):
    for points, axis in ((line(share * radius), Z), (sheet(share * radius), None)):
        dimple = dimple_depth(share * radius, radius, planar=axis is not None)
        asked = min(max(1e-5, dimple), radius / 2)
        assert band(points, axis, radius) == pytest.approx(asked, rel=1e-9)


@pytest.mark.parametrize("gap", [1e-5, 1e-4, 4e-3])
def test_duplicates_strays_and_second_layers_do_not_count(gap):
    alone = band(sheet(1e-3))
    assert band(np.vstack([sheet(1e-3), sheet(1e-3, height=gap)])) == pytest.approx(alone, rel=0.2)
    dirty = np.vstack([sheet(1e-3), sheet(1e-3), sheet(1e-3) + 1e-12, [[0.3, 0.3, 0.3]]])
    assert band(dirty) == pytest.approx(alone, rel=1e-5)
    two = np.vstack([line(2e-3), line(2e-3) + gap * np.eye(3)[1]])
    assert band(two, Z) == pytest.approx(band(line(2e-3), Z), rel=1e-9)


def test_what_stands_alone_asks_for_nothing():
    for points in (np.zeros((1, 3)), np.zeros((500, 3)), [[0.0, 0, 0], [5.0, 0, 0]]):
        assert band(points) == band(points, Z) == 1e-5
    assert band(line(1.01 * R), Z) == 1e-5, "points further apart than R are objects of their own"


def test_corners_and_rims_are_no_roughness():
    h = 0.8e-3
    wedge = np.vstack([sheet(h, 30), sheet(h, 30)[:, [2, 1, 0]] * [1, 1, -1]])
    assert band(wedge) == pytest.approx(dimple_depth(h, R, planar=False), rel=1e-6)


def test_the_stairs_of_a_mask_ask_for_a_third_of_a_pixel():
    """Whatever the width of the pen: a disc's rim, which has stairs of every slope."""
    pixels = grid(np.arange(-80, 81) * 0.25e-3, np.arange(-80, 81) * 0.25e-3)
    off = np.abs(np.hypot(*pixels[:, :2].T) - 15e-3)
    asked = [band(pixels[off < half], Z) for half in (0.4e-3, 0.6e-3, 1.1e-3)]
    assert 0.2 * 0.25e-3 < min(asked) <= max(asked) < 0.6 * 0.25e-3


def alpha_edges(points, radius):
    """Lengths of the edges that a ball rests on, by trying every pair."""
    i, j = (v.ravel() for v in np.triu_indices(len(points), 1))
    chord = points[j] - points[i]
    size = np.linalg.norm(chord, axis=1)
    i, chord, size = (v[(size > 0) & (size < np.sqrt(0.5) * radius)] for v in (i, chord, size))
    aside = np.column_stack([-chord[:, 1], chord[:, 0]]) / size[:, None]
    up = np.sqrt(radius**2 - size**2 / 4)[:, None] * aside
    found = []
    for centre in (points[i] + chord / 2 + up, points[i] + chord / 2 - up):
        away = np.linalg.norm(centre[:, None] - points[None], axis=2).min(axis=1)
        found.append(size[away > radius * (1 - 1e-9)])
    return np.sort(np.concatenate(found))


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
def test_noise_asks_for_what_a_ball_sinks_into(share):
    """A slow reference: every edge of the cloud's alpha shape, weighted by length."""
    rng = np.random.default_rng(3)
    points = line(0.5e-3, 120)[:, :2] + share * 0.5e-3 * rng.normal(size=(120, 2))
    size = alpha_edges(points, R)
    kept = np.cumsum(size) / size.sum()
    usual, deep = (dimple_depth(size[np.searchsorted(kept, q)], R, planar=True) for q in (0.5, 0.9))
    found = band(np.pad(points, ((0, 0), (0, 1))), Z)
    assert found == pytest.approx(usual + 2 * (deep - usual), rel=0.3)
