"""What stands around a line in published pictures never becomes a curve without a doubt."""

from __future__ import annotations

from collections import Counter

import pytest
from surroundings import table


@pytest.mark.parametrize(
    ("share", "least_right"), [(0.1, 0.9), pytest.param(1.0, 0.95, marks=pytest.mark.slow)]
)
def test_no_bar_scale_box_or_icon_is_a_silent_curve_and_lines_are_right(share, least_right):
    counts = table(500, share)
    total = sum(counts.values(), Counter())
    lines = sum(row.total() for (_, has_line), row in counts.items() if has_line)
    assert total["silent"] == 0
    assert total["right"] >= least_right * lines
