"""Slices with a drawn curve that is known: real ones, and ones as people draw them."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from docs_modules import load
from drawing import normal_errors, rms

import vfplan

# File, RMS error [px], pen lifts, and how far both ends may lie off [px], none of a closed curve.
# The ink of slice c goes on for 2.7 px beyond the last point of its truth, on a pen of 2.5 px.
SLICES = [
    ("pelvis_a.png", 0.06, 0, 1.4),
    ("pelvis_a_q80.jpg", 0.08, 0, 1.6),
    ("pelvis_b.png", 0.02, 0, None),
    ("pelvis_b_q80.jpg", 0.05, 0, None),
    ("pelvis_c.png", 0.1, 2, 2.2),
]


@pytest.mark.parametrize("name, limit_px, lifts, end_limit_px", SLICES)
def test_a_real_slice_is_measured_right(shared_data, name, limit_px, lifts, end_limit_px):
    closed = end_limit_px is None
    folder = shared_data / "planned"
    truth = np.loadtxt(folder / f"{name[:8]}_truth_px.csv", delimiter=",", skiprows=1)[:, :2]
    extraction = vfplan.extract_curve(folder / name)
    (stroke,) = extraction.strokes
    assert stroke.closed == closed
    error = normal_errors(stroke.points_px, truth, closed)
    assert rms(error) < limit_px
    assert [finding.code for finding in extraction.findings] == ["bridge"] * lifts
    assert len([entry for entry in extraction.account if entry.what == "bridge"]) == lifts
    if not closed:
        distance = np.hypot(*(truth[[0, -1]] - stroke.points_px[[0, -1]]).T)
        backward = np.hypot(*(truth[[-1, 0]] - stroke.points_px[[0, -1]]).T)
        assert min(distance.max(), backward.max()) < end_limit_px


table = load(ROOT / "docs" / "make_drawn_slices.py")


@pytest.mark.parametrize("count", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_no_line_that_a_person_clicks_on_is_lost_in_silence_and_the_bound_holds(count, tmp_path):
    results = [table.result_of(kind, k, tmp_path) for kind in table.KINDS for k in range(count)]
    assert [r for r in results if not r.is_told and not r.is_whole] == []
    assert np.mean([r.is_within for r in results]) >= 0.9
