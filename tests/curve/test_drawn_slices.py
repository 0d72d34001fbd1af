"""What a click on a drawn line takes: nothing is lost in silence, and the 95 % bound holds."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from docs_modules import load

table = load(ROOT / "docs" / "make_drawn_slices.py")


@pytest.mark.parametrize("count", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_no_line_that_a_person_clicks_on_is_lost_in_silence_and_the_bound_holds(count, tmp_path):
    results = [table.result_of(kind, k, tmp_path) for kind in table.KINDS for k in range(count)]
    assert [r for r in results if not r.is_told and not r.is_whole] == []
    assert np.mean([r.is_within for r in results]) >= 0.9
