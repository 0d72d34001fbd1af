"""Outlines on slices -> one function in space: cubic between the slices' signed distances.

Between two slices runs the cubic with both values and, as slopes, those of the parabolas through
each and its neighbours; beyond the first and the last slice the outline stays as it is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.surface.outline import Outline

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stack:
    """Two or more outlines in the order of their places; x and y in their planes, z across [m]."""

    outlines: tuple[Outline, ...]

    @property
    def z(self) -> Array:
        """(S,) places of the slices [m]."""
        return np.array([outline.z for outline in self.outlines])

    def weights(self, z: Array) -> tuple[NDArray[np.intp], Array, Array]:
        """Which four slices (M, 4) make up the value at z (M,), with weights and their slopes."""
        places = self.z
        n = len(places)
        inside = np.clip(z, places[0], places[-1])
        k = np.clip(np.searchsorted(places, inside, "right") - 1, 0, n - 2)
        gap = places[k + 1] - places[k]
        t = (inside - places[k]) / gap
        four = k[:, None] + np.arange(-1, 3)
        slopes = _slopes(places)

        def weigh(basis: tuple[Array, ...]) -> Array:
            at_first, slope_first, at_last, slope_last = basis
            w = np.zeros((len(z), 4))
            w[:, 1], w[:, 2] = at_first, at_last
            for column in range(4):
                for share, at in ((slope_first, k), (slope_last, k + 1)):
                    step = four[:, column] - at
                    near = np.abs(step) <= 2
                    w[near, column] += (share * gap)[near] * slopes[at[near], step[near] + 2]
            return w

        w, dw = weigh(_hermite(t)), weigh(_hermite_slope(t)) / gap[:, None]
        dw[(z < places[0]) | (z > places[-1])] = 0.0
        return np.clip(four, 0, n - 1), w, dw

    def signed(self, points: Array) -> tuple[Array, Array]:
        """The function (M,) [m] at points (M, 3), below 0 inside, and its gradient (M, 3)."""
        which, w, dw = self.weights(points[:, 2])
        value, gradient = np.zeros(len(points)), np.zeros((len(points), 3))
        rows, columns = np.nonzero((w != 0) | (dw != 0))
        slices = which[rows, columns]
        order = np.argsort(slices, kind="stable")
        first = np.searchsorted(slices[order], np.arange(len(self.outlines) + 1))
        for k in np.flatnonzero(np.diff(first)):
            some = order[first[k] : first[k + 1]]
            at, column = rows[some], columns[some]
            f, g = self.outlines[k].signed(points[at, :2])
            # A slice stands once in a row: beyond the ends all weights are 0.
            value[at] += w[at, column] * f
            gradient[at, :2] += w[at, column, None] * g
            gradient[at, 2] += dw[at, column] * f
        return value, gradient


def _slopes(z: Array) -> Array:
    """(S, 5) weights of the values two slices before to two after in the slope at each [1/m].

    Of the parabola through a slice and its neighbours; at the ends of the one through the last
    three slices; of two slices the straight line.
    """
    n = len(z)
    weights = np.zeros((n, 5))
    for at in range(n):
        three = np.arange(3) + np.clip(at - 1, 0, max(n - 3, 0)) if n > 2 else np.arange(2)
        for one in three:
            others = z[three[three != one]]
            slope = (2 * z[at] - others.sum()) if n > 2 else 1.0
            weights[at, one - at + 2] = slope / np.prod(z[one] - others)
    return weights


def _hermite(t: Array) -> tuple[Array, ...]:
    return (
        (1 + 2 * t) * (1 - t) ** 2,
        t * (1 - t) ** 2,
        t**2 * (3 - 2 * t),
        t**2 * (t - 1),
    )


def _hermite_slope(t: Array) -> tuple[Array, ...]:
    return (6 * t**2 - 6 * t, 3 * t**2 - 4 * t + 1, 6 * t - 6 * t**2, 3 * t**2 - 2 * t)
