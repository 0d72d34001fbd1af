"""Fisher's F distribution, for arrays of arguments as for numbers.

It stands here because importing scipy.special takes a quarter of the time of planning a fixture.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.registration.models import Array


def f_exceeds(dof: ArrayLike, other_dof: ArrayLike, f: ArrayLike) -> Array:
    """The probability that F of these degrees of freedom exceeds f >= 0."""
    share = np.divide(other_dof, np.multiply(dof, f) + other_dof)
    a, b = np.divide(other_dof, 2), np.divide(dof, 2)
    return _beta_share(share, a, b, _log_beta(a, b))


def f_quantile(dof: ArrayLike, other_dof: ArrayLike, probability: float) -> Array:
    """What F of these degrees of freedom stays below with a probability."""
    a, b = np.broadcast_arrays(np.divide(dof, 2), np.divide(other_dof, 2))
    # Newton's method for log F, whose distribution is nearly symmetric; in bounds, which are halved
    # where a step would lead out of them.
    log_f, low, high = np.zeros(a.shape), np.full(a.shape, -700.0), np.full(a.shape, 700.0)
    log_beta = _log_beta(a, b)
    for _ in range(100):
        f = np.exp(log_f)
        excess = 1 - probability - _beta_share(b / (a * f + b), b, a, log_beta)
        low, high = np.where(excess < 0, log_f, low), np.where(excess < 0, high, log_f)
        x = a * f / (a * f + b)
        density = np.exp(a * np.log(x) + b * np.log1p(-x) - log_beta)
        tried = log_f - excess / np.maximum(density, 1e-300)
        tried = np.where((low <= tried) & (tried <= high), tried, (low + high) / 2)
        largest_step = np.abs(tried - log_f).max(initial=0.0)
        log_f = tried
        if not largest_step >= 1e-12:
            break
    return np.exp(log_f)


def _beta_share(x: ArrayLike, a: ArrayLike, b: ArrayLike, log_beta: ArrayLike) -> Array:
    """The regularised incomplete beta function I_x(a, b), by its continued fraction.

    `log_beta` is the logarithm of the beta function of a and b.

    NIST's Digital Library of Mathematical Functions, 8.17.22, evaluated from the front. It
    converges quickly below the mean; above it I_x(a, b) = 1 - I_(1-x)(b, a).
    """
    x, a, b = np.broadcast_arrays(x, a, b)
    is_above = x > (a + 1) / (a + b + 2)
    x = np.where(is_above, 1 - x, x)
    a, b = np.where(is_above, b, a), np.where(is_above, a, b)
    d = 1 / (1 - (a + b) * x / (a + 1))
    c, fraction = np.ones_like(d), d
    for m in range(1, 10_000):
        for factor in (
            m * (b - m) / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1 / (1 + factor * x * d)
            c = 1 + factor * x / c
            fraction = fraction * c * d
        if not (np.abs(c * d - 1) >= 1e-15).any():  # Of no number it never is.
            break
    x = np.maximum(x, np.finfo(float).tiny)
    share = fraction / a * np.exp(a * np.log(x) + b * np.log1p(-x) - log_beta)
    return np.where(is_above, 1 - share, share)


def _log_beta(a: ArrayLike, b: ArrayLike) -> Array:
    """The logarithm of the beta function."""
    log_gamma = np.vectorize(math.lgamma, otypes=[float])
    return log_gamma(a) + log_gamma(b) - log_gamma(np.add(a, b))
