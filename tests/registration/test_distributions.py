"""Fisher's F, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import fdtrc, fdtri

from vfplan.registration.models import f_exceeds, f_quantile


def degrees_of_freedom(count):
    rng = np.random.default_rng(count)
    fractions, whole = np.linspace(1, 3, 30), np.arange(1, 61)
    return rng.choice(np.concatenate([fractions, whole]), count), rng.integers(1, 300, count)


def test_probabilities_are_scipys():
    dof, other_dof = degrees_of_freedom(2000)
    f = np.exp(np.random.default_rng(1).normal(0, 2, 2000))
    expected = fdtrc(dof, other_dof, f)
    assert f_exceeds(dof, other_dof, f) == pytest.approx(expected, rel=1e-11, abs=1e-300)


@pytest.mark.parametrize("probability", [0.01, 0.5, 0.95, 0.99, 0.999, 1 - 1e-6])
def test_quantiles_are_scipys(probability):
    dof, other_dof = degrees_of_freedom(1000)
    expected = fdtri(dof, other_dof.astype(float), probability)
    assert f_quantile(dof, other_dof, probability) == pytest.approx(expected, rel=1e-9)


def test_two_and_two_degrees_of_freedom_have_a_closed_form():
    """F of two and two degrees of freedom exceeds f with 1 / (1 + f)."""
    assert f_quantile(2, 2, 0.95) == pytest.approx(19.0, rel=1e-12)
    assert f_exceeds(2, 2, 3.0) == pytest.approx(0.25, rel=1e-14)


def test_the_ends_of_the_range():
    assert f_exceeds(3, 4, 0.0) == 1
    assert f_exceeds(3, 4, np.inf) == 0
    assert np.isnan(f_exceeds(3, 4, np.nan))
