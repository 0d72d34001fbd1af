"""The safety margin: a fixture that is thicker by the bound of its registration."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ELBOW
from margins import CLOCKWISE, LINE, registered
from refusals import refuses

from vfplan import FixtureSettings
from vfplan.errors import SettingError
from vfplan.planning.plan import margin_of, plan
from vfplan.registration.registration import target_error


@pytest.mark.parametrize("curve", [LINE, CLOCKWISE])
def test_the_margin_is_the_bound_of_the_whole_curve(curve):
    error = target_error(registered(), curve.points)
    bound_m = registered().tre95_curve_m(curve.points).max()
    assert bound_m <= margin_of(error, "tre95") <= bound_m + 1e-9
    assert margin_of(error, "tre95+0.25") == pytest.approx(bound_m + 0.25e-3, abs=2e-9)


@pytest.mark.parametrize("given", [0, 0.0, 2.5e-3])
def test_a_given_margin_is_added_to_the_point_radius(given):
    made = plan(*ELBOW, settings=FixtureSettings(margin=given, point_radius=1e-3))
    assert made.fixture.point_radius == 1e-3 + given
    assert made.report["register"]["margin"] == {
        "kind": "given", "side": "both", "largest_m": given, "added_point_radius_m": given
    }  # fmt: skip


@pytest.mark.parametrize("margin", ["tre99", True, -1, np.inf, np.nan, "1"])
def test_an_unknown_margin_is_refused(margin):
    with refuses(SettingError, "margin-unknown"):
        margin_of(target_error(registered(), LINE.points), margin)
