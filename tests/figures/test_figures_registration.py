"""The registration's picture: arrows and band where they belong, exaggeration stated."""

from __future__ import annotations

import numpy as np
import pytest
from layouts import grid, planar, solid
from margins import CLOCKWISE, LINE, registered

from vfplan import PlannedImage
from vfplan.errors import SettingError
from vfplan.figures import registration as picture
from vfplan.figures import style
from vfplan.registration import fit_registration


def texts(figure):
    axes = figure.axes[0]
    found = [text.get_text() for text in axes.texts]
    return found + [text.get_text() for legend in figure.legends for text in legend.get_texts()]


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
    names = [f"x{i}" for i in range(1, 10)]
    registration = fit_registration(grid(), target, labels=names)
    image = PlannedImage(np.full((780, 800, 3), 120, np.uint8))
    made = figure(registration, LINE, image=image)
    labels = texts(made)
    stated = next(line for line in labels if line.startswith("residual, drawn"))
    factor = float(stated.split()[-1].rstrip("x"))
    tips = [
        (np.array(text.xy) - text.xyann)
        for text in made.axes[0].texts
        if getattr(text, "arrow_patch", None) is not None
    ]
    linear = registration.T_target_source[:3, :2]
    expected = registration.residual_vectors_m @ np.linalg.pinv(linear).T * factor
    np.testing.assert_allclose(tips, expected, atol=1e-9)
    assert any(line.startswith("x4") and "outlier" in line for line in labels)
    assert any(line.startswith("95 % band, drawn") for line in labels)
    assert any("mm in the slice" in line for line in labels)
    assert any("mm of a residual" in line for line in labels)


def test_the_band_is_the_bound_times_the_stated_factor(figure):
    registration = registered()
    made = figure(registration, CLOCKWISE)
    stated = next(line for line in texts(made) if line.startswith("95 % band"))
    factor = float(stated.split()[-1].rstrip("x"))
    quads = [path.vertices[:4] for path in made.axes[0].collections[0].get_paths()]
    assert len(quads) == 800  # closed: the last piece too
    widths = [np.linalg.norm(quad[1] - quad[0]) / 2 for quad in quads]
    bound = registration.tre95_curve_m(CLOCKWISE.points) / registration.geometry.scale
    np.testing.assert_allclose(widths, bound * factor, rtol=1e-6)


def test_left_out_markers_and_an_exact_fit(figure):
    target = planar(grid())
    target[3] += [0.03, -0.04, 0]
    robust = fit_registration(grid(), target, robust=True)
    assert "left out" in texts(figure(robust, LINE))
    exact = fit_registration(np.round(grid()), np.c_[np.round(grid()), np.zeros(9)])
    assert texts(figure(exact, LINE))


def test_no_picture_in_space(tmp_path):
    registration = fit_registration(*solid(8), model="rigid")
    with pytest.raises(SettingError, match="no slice"):
        picture.draw_registration(registration, LINE, tmp_path / "p.png")
