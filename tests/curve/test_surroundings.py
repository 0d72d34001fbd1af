"""What stands around a line in published pictures never becomes a curve without a doubt."""

from __future__ import annotations

import pytest
from surroundings import table


@pytest.mark.parametrize(
    "share, least_right", [(0.1, 0.9), pytest.param(1.0, 0.95, marks=pytest.mark.slow)]
)
def test_no_bar_scale_box_or_icon_is_a_silent_curve_and_lines_are_right(share, least_right):
    counts = table(500, share)
    drawn = [row for (_, has_line), row in counts.items() if has_line]
    assert sum(row["silent"] for row in counts.values()) == 0
    assert sum(row["right"] for row in drawn) >= least_right * sum(row.total() for row in drawn)
