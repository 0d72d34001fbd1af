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
        count = len(places)
        inside = np.clip(z, places[0], places[-1])
        first = np.clip(np.searchsorted(places, inside, "right") - 1, 0, count - 2)
        gap = places[first + 1] - places[first]
        t = (inside - places[first]) / gap
        four = first[:, None] + np.arange(-1, 3)
        slopes = slope_weights(places)

        def combine(basis: tuple[Array, Array, Array, Array]) -> Array:
            """Weights of the four slices, from those of both values and both slopes."""
            value_first, slope_first, value_last, slope_last = basis
            weights = np.zeros((len(z), 4))
            weights[:, 1] = value_first
            weights[:, 2] = value_last
            for column in range(4):
                for share, at in ((slope_first, first), (slope_last, first + 1)):
                    step = four[:, column] - at
                    is_close = np.abs(step) <= 2
                    weights[is_close, column] += (share * gap)[is_close] * slopes[
                        at[is_close], step[is_close] + 2
                    ]
            return weights

        # Hermite's cubics and their derivatives: value and slope at the first, then at the last.
        cubics = (
            (1 + 2 * t) * (1 - t) ** 2,
            t * (1 - t) ** 2,
            t**2 * (3 - 2 * t),
            t**2 * (t - 1),
        )
        derivatives = (6 * t**2 - 6 * t, 3 * t**2 - 4 * t + 1, 6 * t - 6 * t**2, 3 * t**2 - 2 * t)
        weights = combine(cubics)
        weight_slopes = combine(derivatives) / gap[:, None]
        weight_slopes[(z < places[0]) | (z > places[-1])] = 0.0
        return np.clip(four, 0, count - 1), weights, weight_slopes

    def signed(self, points: Array) -> tuple[Array, Array]:
        """The function (M,) [m] at points (M, 3), below 0 inside, and its gradient (M, 3)."""
        which, weights, weight_slopes = self.weights(points[:, 2])
        value = np.zeros(len(points))
        gradient = np.zeros((len(points), 3))
        rows, columns = np.nonzero((weights != 0) | (weight_slopes != 0))
        slices = which[rows, columns]
        order = np.argsort(slices, kind="stable")
        first = np.searchsorted(slices[order], np.arange(len(self.outlines) + 1))
        for k in np.flatnonzero(np.diff(first)):
            of_slice = order[first[k] : first[k + 1]]
            row = rows[of_slice]
            column = columns[of_slice]
            distance, direction = self.outlines[k].signed(points[row, :2])
            # A slice stands once in a row: beyond the ends all weights are 0.
            value[row] += weights[row, column] * distance
            gradient[row, :2] += weights[row, column, None] * direction
            gradient[row, 2] += weight_slopes[row, column] * distance
        return value, gradient


def slope_weights(z: Array) -> Array:
    """(S, 5) weights of the values two slices before to two after in the slope at each [1/m].

    Of the parabola through a slice and its neighbours; at the ends of the one through the last
    three slices; of two slices the straight line.
    """
    count = len(z)
    weights = np.zeros((count, 5))
    if count == 2:
        slope = 1.0 / (z[1] - z[0])
        weights[0, 2:4] = -slope, slope
        weights[1, 1:3] = -slope, slope
        return weights
    for at in range(count):
        three = np.clip(at - 1, 0, count - 3) + np.arange(3)
        for one in three:
            others = z[three[three != one]]
            weights[at, one - at + 2] = (2 * z[at] - others.sum()) / np.prod(z[one] - others)
    return weights
