"""Labels that were mistaken: the usual other orders, and how likely each of them is.

Two orders of the labels are compared by the ratio of the sums of squares that they leave. For two
orders that are equally good it is F-distributed with ν and ν degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from vfplan.registration.distributions import f_exceeds
from vfplan.registration.fit import GOOD_SET_PROBABILITY, fit_model
from vfplan.registration.models import Affine, Array, Orthogonal, homogeneous
from vfplan.registration.problem import Problem
from vfplan.registration.registration import Registration

# Another order of the labels is sure, and refused, if it fits better by an F of this probability.
# Of 10,000 sets of good markers none is refused by it (docs/make_registration_table.py).
SURE_PROBABILITY = 5e-6

# Both of two exchanged markers are among the 12 of largest residual, for a mistake is large.
MAX_SUSPECTS = 12

# Of four markers all 24 orders of the labels are compared; five would have 120.
MAX_FOR_EVERY_ORDER = 4


@dataclass(frozen=True)
class LabelMistake:
    """Another order of the same labels."""

    # (N,) source marker i belongs to the target marker `order[i]`.
    order: tuple[int, ...]
    # What it does to the given order, as a verb: "exchanged", "reversed", "shifted", ...
    action: str
    # RMS residual that it leaves [m].
    fre_rms_m: float
    # Probability that good markers fit another order so much better.
    p_value: float

    @property
    def moved(self) -> list[int]:
        """The markers whose labels it changes."""
        return [i for i, j in enumerate(self.order) if i != j]

    def sentence(self, labels: Sequence[str | int]) -> str:
        """What seems to have happened, and how well the markers fit without it."""
        moved = [str(labels[i]) for i in self.moved]
        fit = f"{self.action}, all markers fit to {1e3 * self.fre_rms_m:.2f} mm"
        if len(moved) == 2:
            return f"{moved[0]} and {moved[1]} seem exchanged: {fit}"
        names = ", ".join(moved[:4])
        if len(moved) > 4:
            names += ", ..."
        return f"the labels {names} seem {fit}"


def label_mistakes(registration: Registration) -> list[LabelMistake]:
    """The usual mistakes with labels that fit about as well as the given ones, or better.

    An order is one of them unless the given one fits better by an F that equally good orders reach
    once in a hundred sets. The likeliest comes first.
    """
    everyone = registration.fit.problem
    judge = everyone
    if registration.pixel_spacing is not None and isinstance(everyone.model, Affine):
        # Four or five markers fit an affine map in almost any order. The true map is close to a
        # similarity where the pixel spacing is known.
        judge = replace(everyone, model=Orthogonal(2, None, "similarity"))
    n = len(everyone.s)
    dof = 3 * n - judge.model.parameters

    # Two markers may be exchanged if both are among those that fit worst.
    fit = fit_model(judge)
    squares = (judge.weights * fit.vectors**2).sum(axis=1)
    suspects = np.sort(np.argsort(-squares, kind="stable")[:MAX_SUSPECTS])
    orders = usual_orders(n, suspects.tolist())
    if not orders:
        return []

    as_given = _sums_of_squares(judge, [tuple(range(n))])[0]
    others = _sums_of_squares(judge, list(orders))
    fre = np.sqrt(_sums_of_squares(everyone, list(orders), weighted=False) / n)
    named = list(orders.items())
    mistakes = []
    # The given order does not fit clearly better than these ones.
    for k in np.flatnonzero(f_exceeds(dof, dof, others / as_given) > GOOD_SET_PROBABILITY):
        order, action = named[k]
        p_value = float(f_exceeds(dof, dof, as_given / others[k]))
        mistakes.append(LabelMistake(order, action, float(fre[k]), p_value))
    mistakes.sort(key=lambda mistake: mistake.p_value)
    return mistakes


def usual_orders(n: int, suspects: Sequence[int]) -> dict[tuple[int, ...], str]:
    """The orders that people mistake for the right one, with what was done to the labels.

    n: number of markers
    suspects: markers of which two may be exchanged
    """
    forward = np.arange(n)
    orders: dict[tuple[int, ...], str] = {}
    if n <= MAX_FOR_EVERY_ORDER:
        for order in permutations(range(n)):
            orders[order] = "reordered"
    for rows in range(2, n // 2 + 1):
        if n % rows == 0:
            grid = forward.reshape(rows, -1)
            orders[tuple(grid.T.ravel().tolist())] = "transposed"
            orders[tuple(grid[::-1].ravel().tolist())] = "reversed by rows"
            orders[tuple(grid[:, ::-1].ravel().tolist())] = "reversed by columns"
    for shift in range(1, n):
        orders[tuple(np.roll(forward[::-1], shift).tolist())] = "reversed and shifted"
        orders[tuple(np.roll(forward, shift).tolist())] = "shifted"
    orders[tuple(forward[::-1].tolist())] = "reversed"
    for i, j in combinations(suspects, 2):
        exchanged = list(range(n))
        exchanged[i], exchanged[j] = j, i
        orders[tuple(exchanged)] = "exchanged"
    orders.pop(tuple(forward.tolist()), None)
    return orders


def _sums_of_squares(
    problem: Problem, orders: Sequence[tuple[int, ...]], *, weighted: bool = True
) -> Array:
    """(P,) sum of squared residuals [m²] with the targets in each order."""
    index = np.array(orders)
    y, weights = problem.y[index], problem.weights[index]
    s = np.broadcast_to(problem.s, (len(index), *problem.s.shape))
    m = problem.model.solve(s, y, weights)
    squares = (y - homogeneous(problem.s) @ np.swapaxes(m, -1, -2)) ** 2
    if weighted:
        squares = squares * weights
    return np.maximum(squares.sum(axis=(1, 2)), problem.rounding_floor_m**2)
