"""Table I: defaults, derived radii, and every refusal with the value found and what is allowed."""

import numpy as np
import pytest
from motion import grid

from vfplan import ProxyEngine, ProxyParameters
from vfplan.engine import PAPER_BAND
from vfplan.engine.parameters import check_points
from vfplan.errors import SceneError, SettingError

POINT, MAKE = [[0.0, 0.0, 0.0]], ProxyParameters.make


def square(spacing):
    return grid(np.arange(21) * spacing, np.arange(21) * spacing)


def test_defaults_are_the_papers():
    p = MAKE(POINT)
    assert (p.contact_radius, p.r1, p.r2) == (5e-3, 5e-3 - 1e-5, 5e-3 + 1e-5)
    assert (p.outer_radius, p.point_radius, p.gain, p.R) == (10e-3, 0.0, 1.0, 5e-3)
    assert (p.rule, p.ignore_axis, p.max_iterations, p.search) == ("robust", None, 16, "auto")
    assert p.stiffness.tolist() == [1000.0] * 3


def test_frozen_in_every_part():
    p = MAKE(POINT, ignore_axis="z")
    with pytest.raises(AttributeError):
        p.band = 1.0
    for array in (p.stiffness, p.ignore_axis):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


# Points, settings and the band.
BANDS = {
    "the paper's rule": (square(0.5e-3), {"rule": "paper"}, PAPER_BAND),
    "at most half": (square(8e-3), {"contact_radius": 1e-3, "point_radius": 10e-3}, 0.5e-3),
    # 1e-8 R is more than the paper's 10 µm.
    "points of 1 km": (POINT, {"point_radius": 1e3}, 1e-8 * (5e-3 + 1e3)),
}


@pytest.mark.parametrize("points, settings, band", BANDS.values(), ids=BANDS)
def test_a_band_left_open_keeps_its_bounds(points, settings, band):
    assert MAKE(points, **settings).band == band


OUT_OF_RANGE = {"contact_radius": [-5e-3, 0, np.nan, 1e-300, 0.999e-9, 1.01e6, 1e300],
    "point_radius": [-1e-3, -1e-9, np.inf, 1e300],
    "band": [0.0, -1e-5, 5.1e-3, 6e-3, 1e-12, 1e-22, 4.9e-11, 5e-324],
    "outer_radius": [5e-3, 1e300], "gain": [0.0, 1.5],
    "stiffness": [0.0, -1.0, [1e3, -1.0, 1e3], np.inf, np.nan],
    "ignore_axis": [[0, 0, 0], [0, np.nan, 1]]}  # fmt: skip


@pytest.mark.parametrize("setting, name", [
    *(({name: value}, name) for name, values in OUT_OF_RANGE.items() for value in values),
    ({"band": 1e-8, "point_radius": 2.0}, "band"),
    ({"band": 5e-3}, "outer_radius"),  # 2 r_c is no longer beyond r2
    ({"band": 1e-5, "outer_radius": 5.01e-3}, "outer_radius"),
])  # fmt: skip
def test_a_number_outside_its_range_is_refused_by_its_name(setting, name):
    with pytest.raises(SettingError) as caught:
        MAKE(POINT, **setting)
    assert list(caught.value.numbers) == ["stiffness_n_per_m" if name == "stiffness" else name]


@pytest.mark.parametrize("setting", [
    {"contact_radius": "5"}, {"contact_radius": True}, {"stiffness": [1e3, 1e3]},
    {"stiffness": "stiff"}, {"rule": "fast"}, {"ignore_axis": "w"}, {"ignore_axis": [1, 0]},
    {"search": "tree"}, {"max_iterations": 0}, {"max_iterations": 2.5}])  # fmt: skip
def test_what_is_no_such_setting_is_refused(setting):
    with pytest.raises(SettingError) as caught:
        MAKE(POINT, **setting)
    [name] = setting
    assert caught.value.message.startswith(name)


def test_a_band_that_the_coordinates_do_not_resolve_is_refused():
    """1e4 roundings of 1e6 m are 2.2 µm."""
    far = np.array([[0.0, -1e6, 1.0]])
    with pytest.raises(SettingError, match=r"1e4 roundings of the largest coordinate, 1e\+06 m"):
        ProxyEngine(far, band=2.2e-6)
    ProxyEngine(far, band=2.3e-6)
    ProxyEngine(far)


@pytest.mark.parametrize("points, says", [
    (np.empty((0, 3)), "at least one point"), ([], "shape (0,)"), ([0.0, 0.0, 0.0], "shape (3,)"),
    ([[0.0, 0.0]], "shape (1, 2)"),
    ([[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]], "point 1 is [0.0, nan, 0.0]"),
    ([[np.inf, 0.0, 0.0]], "finite"), ([[0.0, 0.0, 1e300]], "at most 1e+06 m"),
    ([["a", "b", "c"]], "real numbers"), ([[1j, 0, 0]], "complex128"),
    ([[True, False, True]], "bool"), ([[0.0, 0.0, 0.0], [1.0]], "rows of different length"),
    (None, "object"), (1.0, "shape ()")])  # fmt: skip
def test_cloud_that_cannot_be_rendered_is_refused(points, says):
    with pytest.raises(SceneError) as caught:
        ProxyEngine(points)
    assert says in str(caught.value)


@pytest.mark.parametrize("cloud", [
    [[1, 2, 3]], np.ones((2, 3), np.float32), np.asfortranarray(np.ones((4, 3)))])  # fmt: skip
def test_whole_numbers_and_float32_become_float64(cloud):
    array = check_points(cloud)
    assert array.dtype == np.float64
    assert array.flags.c_contiguous


def test_axis_is_normalised_whatever_its_length():
    for length in (1e-300, 1.0, 1e300):
        axis = MAKE(POINT, ignore_axis=np.array([0.0, 3.0, 4.0]) / 5 * length).ignore_axis
        assert axis == pytest.approx([0.0, 0.6, 0.8], abs=1e-15)
