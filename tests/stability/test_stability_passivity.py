"""The sampled-data passivity bound: tight in closed form, and kept by the engine."""

from dataclasses import replace

import numpy as np
import pytest

from vfplan import Trace
from vfplan.figures.style import passivity_plot
from vfplan.palette import RULE
from vfplan.stability.cases import energy_balance, passivity_cases


def wall(hips, stiffness):
    """A perfect wall y >= 0."""
    proxy = np.maximum(hips, [-np.inf, 0.0, -np.inf])
    force, states = stiffness * (proxy - hips), np.zeros(len(hips), np.int8)
    return Trace(proxy, 0 * proxy, force, states, states.astype(np.uint8))


def pressing(count=400):
    """(T, 3) once into a wall by 2 mm, and back."""
    s = np.linspace(0, 2 * np.pi, count)
    return np.column_stack([0 * s, 1e-3 * (np.cos(s) - 1), 0 * s])


def test_bound_is_reached_by_a_perfect_wall():
    hips = pressing()
    excess, recede, stored = energy_balance(wall(hips, 700.0), hips, 700.0)
    assert abs(excess) < 1e-12 * stored
    assert recede < 1e-18
    assert stored == pytest.approx(0.5 * 700 * 2e-3**2, rel=1e-3)


def test_a_sticky_wall_is_active():
    hips = pressing()
    ideal = wall(hips, 700.0)
    stiffer_out = np.where(np.arange(400)[:, None] > 200, 1.1, 1.0)
    sticky = replace(ideal, force=ideal.force * stiffer_out)
    excess, _, stored = energy_balance(sticky, hips, 700.0)
    assert excess > 0.05 * stored


def test_ignored_axis_does_no_work_and_adds_no_bound():
    s = np.linspace(0, 2 * np.pi, 50)
    hips = np.column_stack([0 * s, -1e-3 + 0 * s, 0.1 * np.sin(s)])
    excess, _, _ = energy_balance(wall(hips, 1.0), hips, 1.0, np.array([0.0, 0.0, 1.0]))
    assert excess == 0.0


@pytest.mark.parametrize("scene", ["flat", "corner", "three-walls", "channel", "point", "omega"])
def test_the_robust_rule_is_passive(scene):
    energy, _ = passivity_cases(scene, "robust", cycles=4)
    assert energy.outcome == "pass", energy.detail
    assert energy.values["active_cycles"] == 0


def test_the_picture_shows_every_rule():
    rows = [row for rule in RULE for row in passivity_cases("channel", rule, cycles=2)]
    axes = passivity_plot(rows).axes[0]
    shown = {line.get_color() for line in axes.lines if len(line.get_xdata()) == 2}
    assert shown >= set(RULE.values())
