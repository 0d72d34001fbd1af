"""The registration's picture: arrows and band where they belong, exaggeration stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from layouts import grid, planar, solid
from margins import CLOCKWISE, LINE, registered
from matplotlib.text import Text
from numpy.testing import assert_allclose
from refusals import refuses

from vfplan import PlannedImage
from vfplan.errors import SettingError
from vfplan.figures import registration as picture
from vfplan.figures import style
from vfplan.fixture import Curve, Fixture, Provenance
from vfplan.registration.registration import fit_registration


def texts(figure):
    return [text.get_text() for text in figure.findobj(Text)]


def stated_factor(figure, start):
    """The factor that the legend states of what begins so."""
    [stated] = [text for text in texts(figure) if text.startswith(start)]
    return float(stated.split()[-1].rstrip("x"))


@pytest.fixture
def figure(monkeypatch, tmp_path):
    kept = []
    monkeypatch.setattr(style, "save_png", lambda figure, path: kept.append(figure))

    def draw(registration, curve, **kwargs):
        picture.draw_registration(registration, curve, tmp_path / "p.png", **kwargs)
        return kept[-1]

    return draw


def test_arrows_are_the_residuals_times_the_stated_factor(figure):
    target = planar(grid())
    target[3] += [0.003, -0.004, 0]
    registration = fit_registration(grid(), target, labels=[f"x{i}" for i in range(1, 10)])
    image = PlannedImage(np.full((780, 800, 3), 120, np.uint8))
    made = figure(registration, LINE, image=image)
    labels = texts(made)
    factor = stated_factor(made, "residual (")
    linear = registration.T_target_source[:3, :2]
    expected = registration.vectors @ np.linalg.pinv(linear).T * factor
    assert_allclose(tips_of(made), expected, atol=1e-9)
    assert any(line.startswith("x4") and "outlier" in line for line in labels)
    assert any("mm in the slice, " in line and "mm of a residual" in line for line in labels)


def test_the_band_is_the_bound_times_the_stated_factor(figure):
    registration = registered()
    made = figure(registration, CLOCKWISE)
    factor = stated_factor(made, "95 % band")
    right, left = np.split(made.axes[0].patches[0].get_xy()[:-1], 2)
    assert len(left) == 801  # closed: the last piece too
    widths = np.linalg.norm(left[::-1] - right, axis=1)[:-1] / 2
    bound = registration.tre95_curve_m(CLOCKWISE.points) / registration.scale
    assert_allclose(widths, bound * factor, rtol=1e-6)


def test_left_out_markers_and_an_exact_fit(figure):
    target = planar(grid())
    target[3] += [0.03, -0.04, 0]
    assert "left out" in texts(figure(fit_registration(grid(), target, robust=True), LINE))
    exact = fit_registration(np.round(grid()), np.c_[np.round(grid()), np.zeros(9)])
    assert texts(figure(exact, LINE))


def test_no_label_lies_on_another(figure):
    places = np.array([(20 + 55 * (k % 5), 40 + 250 * (k // 5)) for k in range(25)], float)
    registration = fit_registration(places, planar(places) + 1e-4 * np.sin(places.sum(1))[:, None])
    made = figure(registration, LINE, image=PlannedImage(np.full((1300, 260, 3), 120, np.uint8)))
    labels = [text for text in made.axes[0].texts if " mm (" in text.get_text()]
    boxes = [label.get_window_extent() for label in labels]
    assert len(boxes) == 25
    assert [box.count_overlaps(boxes) for box in boxes] == [1] * 25


def in_space():
    """A registration of eight markers in the patient's frame, and a curve between them."""
    source, target = solid(8)
    registration = fit_registration(source, target, model="affine")
    t = np.linspace(0, 1, 50)[:, None]
    points = source.min(axis=0) * (1 - t) + source.max(axis=0) * t
    curve = Curve(np.zeros(50, np.int32), np.array([False]))
    provenance = Provenance("2026-01-01T00:00:00Z", "vfplan test")
    return registration, Fixture("patient_lps", points, provenance, curve=curve)


def tips_of(made):
    """How far each arrow with a head goes; a leader has none."""
    looks = [(text, getattr(text, "arrowprops", None) or {}) for text in made.axes[0].texts]
    arrows = [text for text, look in looks if look.get("arrowstyle") == "-|>"]
    return [np.array(text.xy) - text.xyann for text in arrows]


def slice_in_patient():
    place = np.zeros((4, 3))
    place[:3, 0] = [0, 0.3e-3, 0.4e-3]
    place[:3, 1] = [0.6e-3, 0, 0]
    place[:, 2] = [-0.2, -0.1, -0.1, 1]
    return PlannedImage(np.full((780, 800, 3), 120, np.uint8), T_patient_image=place)


def test_markers_in_the_patient_are_projected_onto_the_slice(figure):
    registration, line = in_space()
    image = slice_in_patient()
    place = image.T_patient_image
    made = figure(registration, line, image=image)
    factor = stated_factor(made, "residual (")
    # The residual in the patient's frame, without its part across the slice: least squares.
    A = registration.T_target_source[:3, :3] @ place[:3, :2]
    solved = np.linalg.lstsq(A, registration.vectors.T, rcond=None)[0].T
    assert_allclose(tips_of(made), factor * solved, atol=1e-9)
    offset = registration.source - place[:3, 2]
    expected = np.column_stack([offset @ place[:3, 0] / 0.25e-6, offset @ place[:3, 1] / 0.36e-6])
    [markers] = [x for x in made.axes[0].lines if x.get_label() == "marker"]
    assert_allclose(markers.get_xydata(), expected, atol=1e-9)
    assert any("mm in the slice" in text for text in texts(made))


def test_a_surface_is_shown_by_its_points(figure):
    registration, line = in_space()
    made = figure(registration, replace(line, curve=None), image=slice_in_patient())
    points = made.axes[0].collections[0]
    assert len(points.get_offsets()) == 50
    assert_allclose(points.get_array(), 1e3 * registration.tre_m(line.points))
    assert not any(text.startswith("95 % band") for text in texts(made))


def test_a_slice_whose_place_in_the_patient_is_unknown_is_refused(tmp_path):
    registration, line = in_space()
    image = PlannedImage(np.zeros((780, 800, 3), np.uint8))
    for known, curve in ((None, LINE), (image, LINE), (None, line)):
        with refuses(SettingError, "no-slice"):
            picture.draw_registration(registration, curve, tmp_path / "p.png", image=known)
