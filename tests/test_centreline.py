"""The planned curve against the truth it was drawn from."""

from __future__ import annotations

import numpy as np
import pytest
from drawing import anatomy, blend, compare, coverage, jpeg, to_uint8, wavy

import vfplan
from vfplan.image import read_image

PLANNED = ["pelvis_a.png", "pelvis_b.png", "pelvis_c.png", "pelvis_a_q80.jpg", "pelvis_b_q80.jpg"]


@pytest.mark.parametrize("name", PLANNED)
def test_planned_slices_against_their_truth(shared_data, name):
    folder = shared_data / "planned"
    truth = np.loadtxt(folder / f"{name[:8]}_truth_px.csv", delimiter=",", skiprows=1)
    extraction = vfplan.extract_curve(read_image(folder / name))
    (stroke,) = extraction.strokes
    assert stroke.closed == name.startswith("pelvis_b")
    error = compare(stroke, truth, stroke.closed)
    assert error.rms < (0.13 if name.endswith("jpg") else 0.04)
    assert error.worst < 0.8
    assert error.uncovered < 2
    assert error.ends < 1.5
    assert abs(error.length_ratio - 1) < 0.01
    assert stroke.bridged.any() == name.startswith("pelvis_c")


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize(
    ("width", "png", "q75"), [(2, 0.04, 0.18), (3, 0.03, 0.13), (5, 0.03, 0.10)]
)
def test_drawn_curves_over_anatomy(width, png, q75, closed):
    shape = (360, 420)
    curve = wavy(shape, 7, closed)
    share = coverage(shape, curve, width, closed)
    picture = to_uint8(blend(anatomy(shape, 7), share, (255, 0, 0)))
    for image, allowed in ((picture, png), (jpeg(picture, 75), q75)):
        (stroke,) = vfplan.extract_curve(image).strokes
        error = compare(stroke, curve, closed)
        assert error.rms <= allowed
        assert error.worst <= 0.8
        assert error.uncovered <= 2
        assert error.ends <= 1.5
        assert abs(error.length_ratio - 1) < 0.01
