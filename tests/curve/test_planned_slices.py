"""Real CT slices with a drawn curve whose centre line is known."""

from __future__ import annotations

import numpy as np
import pytest
from drawing import normal_errors

import vfplan

# file, closed, RMS error [px], pen lifts
SLICES = [
    ("pelvis_a.png", False, 0.06, 0),
    ("pelvis_a_q80.jpg", False, 0.08, 0),
    ("pelvis_b.png", True, 0.02, 0),
    ("pelvis_b_q80.jpg", True, 0.05, 0),
    ("pelvis_c.png", False, 0.1, 2),
]


@pytest.mark.parametrize(("name", "closed", "limit_px", "lifts"), SLICES)
def test_a_real_slice_is_measured_right(shared_data, name, closed, limit_px, lifts):
    folder = shared_data / "planned"
    truth = np.loadtxt(folder / f"{name[:8]}_truth_px.csv", delimiter=",", skiprows=1)[:, :2]
    extraction = vfplan.extract_curve(folder / name)
    (stroke,) = extraction.strokes
    assert stroke.closed == closed
    error = normal_errors(stroke.points_px, truth, closed)
    assert np.sqrt(np.mean(error**2)) < limit_px
    assert extraction.findings == ()
    bridges = [entry for entry in extraction.account if entry.what == "bridge"]
    assert len(bridges) == lifts
    if not closed:
        distance = np.hypot(*(truth[[0, -1]] - stroke.points_px[[0, -1]]).T)
        backward = np.hypot(*(truth[[-1, 0]] - stroke.points_px[[0, -1]]).T)
        assert min(distance.max(), backward.max()) < 2.1
