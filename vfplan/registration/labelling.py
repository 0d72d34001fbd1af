"""Another labelling of the same markers that fits many times better than the given one.

Labels exchanged, reversed, shifted by one, transposed on a grid or mixed up leave residuals as big
as the layout is irregular: millimetres on a grid that a hand has set, while the curve lands
centimetres away. So the markers are matched as two *sets*: three markers far apart in the source
are sent to every ordered three of the target, the others follow, each is given the target nearest
to it (all at once, as an assignment), and what fits is kept. The labellings found, and the
usual mistakes, are held against the given one by their sums of squares; with one marker left out
on both sides too, so that a single bad one does not hide the mistake. Few markers fit an affine map
in almost any order: where the pixel spacing is known, the similarity must speak for a labelling
too. What fits about as well as the given labelling is a rival, and counted: the markers cannot show
which is right, and that is said; where one is an outlier, only of what does so without one too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from vfplan.registration.fit import Fit, f_limit, spans, studentised_f
from vfplan.registration.models import Affine, Array, Orthogonal, homogeneous
from vfplan.registration.problem import Problem

# One labelling of a good set fits better by F of this tail only where the layout is symmetric to
# within the noise and the noise happens to undo the difference; there are a few dozen such.
SURE = 5e-6
SEEMS = 1e-4
AS_GOOD = 1e-2
ALL_ORDERS = 5  # markers: every order is looked at
# All ordered threes of 32 markers; of more, the usual mistakes alone are tried.
MAX_SEEDS = 30_000
# The map through three markers fits worse than the one through all: by the noise that it carries
# to the others, at most this many times in sum of squares where the three lie far apart.
SLACK = 30.0
MOST_KEPT = 60
PROBES = 4

Order = tuple[int, ...]


@dataclass(frozen=True)
class Relabelling:
    """A labelling that fits better than the given one, or about as well."""

    order: Order  # (N,) source marker i fits the target marker `order[i]`
    gain: float  # the given labelling's sum of squares over this one's
    rms_m: float  # what this labelling leaves at the markers, RMS [m]
    seems: bool  # whether it fits far better; else it is a rival, that the markers cannot rule out
    sure: bool  # whether good markers cannot look like this
    alone: bool  # whether no other labelling fits about as well as this one
    alike: int = 1  # labellings that fit about as well as the given one, and that one

    @property
    def pair(self) -> tuple[int, int] | None:
        """The two markers that it exchanges, where it does no more and fits far better."""
        moved = [i for i, j in enumerate(self.order) if i != j]
        return (moved[0], moved[1]) if self.seems and len(moved) == 2 else None


def better_labelling(fit: Fit, *, square: bool = False) -> Relabelling | None:
    """The labelling that fits the markers best, where one fits about as well as theirs or better.

    fit: of all markers. Any model, planar or solid.
    square: whether the pixel spacing is known, so that a true map is near a similarity
    """
    problem = fit.problem
    problems = [problem]
    if square and isinstance(problem.model, Affine) and problem.model.dimension == 2:
        problems.append(replace(problem, model=Orthogonal(2, None, "similarity")))
    limits = [_limit(one, AS_GOOD) for one in problems]
    worths = [_squares(p, [_identity(p)], 0)[0] * k for p, k in zip(problems, limits, strict=True)]
    orders = sorted(set().union(*map(_candidates, problems, worths)) - {_identity(problem)})
    if not orders:
        return None
    gains = np.array([_gains(one, orders, 0) for one in problems])
    possible = (gains * np.array(limits)[:, None] >= 1).all(axis=0)
    orders, gains = [orders[k] for k in np.flatnonzero(possible)], gains[:, possible]
    if not orders:
        return None
    found = [_best(one, orders, gains.min(axis=0), d) for one in problems for d in _dropped(one)]
    best = max(found, key=lambda one: (one.sure, one.seems, one.gain))
    # Where a marker is an outlier a rival must fit about as well with one left out too.
    spared = max(_dropped(problem)) if _outlying(fit) else 0
    rivals = int((_gains(problem, orders, spared) * _limit(problem, AS_GOOD, spared) >= 1).sum())
    return replace(best, alike=1 + rivals) if best.seems or rivals else None


def _outlying(fit: Fit) -> bool:
    """Whether a marker's F is over the limit, so that the residuals are not noise alone."""
    f = np.nan_to_num(studentised_f(fit))
    return bool(f.max() > f_limit(len(f), max(fit.dof - 3, 1)))


def _best(problem: Problem, orders: list[Order], least: Array, dropped: int) -> Relabelling:
    """The best of the labellings by one model; it fits far better only where `least` agrees."""
    gains = _gains(problem, orders, dropped)
    best = int(gains.argmax())
    gain = float(gains[best])
    alike = int((gains >= gain / _limit(problem, AS_GOOD, dropped)).sum())
    rms = float(np.sqrt(_squares(problem, [orders[best]], 0)[0] / len(problem.s)))
    seems, sure = (
        bool(gain > _limit(problem, alpha, dropped) and (dropped or least[best] > 1))
        for alpha in (SEEMS, SURE)
    )
    return Relabelling(orders[best], gain, rms, seems, sure, alike == 1)


def _dropped(problem: Problem) -> list[int]:
    """How many markers may be left out so that enough is left to judge by."""
    return [d for d in (0, 1) if d == 0 or _dof(problem, d) >= 3]


def _dof(problem: Problem, dropped: int) -> int:
    return 3 * (len(problem.s) - dropped) - problem.model.parameters


def _gains(problem: Problem, orders: list[Order], dropped: int) -> Array:
    given = _squares(problem, [_identity(problem)], dropped)[0]
    return np.asarray(given / _squares(problem, orders, dropped))


def name_labelling(order: Order, labels: Sequence[str | int]) -> str:
    """What the labelling does to the given one, in words; lower-case, no full stop."""
    moved = [i for i, j in enumerate(order) if i != j]
    if len(moved) == 2:
        return f"the labels of {labels[moved[0]]} and {labels[moved[1]]} are exchanged"
    how = _usual(len(order)).get(order, "in another order")
    few = ", ".join(f"{labels[i]} is labelled {labels[order[i]]}" for i in moved[:3])
    return f"the labels are {how} ({few}{', ...' if len(moved) > 3 else ''})"


def _identity(problem: Problem) -> Order:
    return tuple(range(len(problem.s)))


def _limit(problem: Problem, alpha: float, dropped: int = 0) -> float:
    from scipy.special import fdtri

    dof = float(_dof(problem, dropped))
    return float(fdtri(dof, dof, 1 - alpha))


def _usual(n: int) -> dict[Order, str]:
    """Transpositions of a grid's markers, cyclic shifts of either direction, and reversal."""
    forward = np.arange(n)
    usual = [(np.roll(forward, k)[::-1], "in another order") for k in range(1, n)]
    for r in (r for r in range(2, n // 2 + 1) if n % r == 0):
        how = f"transposed, rows for columns of {r} x {n // r}"
        usual.append((forward.reshape(r, -1).T, how))
    usual += [(np.roll(forward, -k), f"shifted by {min(k, n - k)}") for k in range(1, n)]
    usual.append((forward[::-1], "in reverse order"))
    return {tuple(order.ravel().tolist()): how for order, how in usual}


def _candidates(problem: Problem, worth: float) -> set[Order]:
    """Labellings that may leave less than `worth` [m²]: about as good as the given one's."""
    n = len(problem.s)
    if n <= ALL_ORDERS:
        return set(permutations(range(n)))
    if n * (n - 1) * (n - 2) > MAX_SEEDS:
        return {*_usual(n), *_exchanges(n)}
    matched = (_matched(problem, base, SLACK * worth) for base in _bases(problem, 2))
    return set().union(_exchanges(n), *matched)


def _exchanges(n: int) -> Iterator[Order]:
    """Every two labels exchanged."""
    for i, j in combinations(range(n), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        yield tuple(order)


def _bases(problem: Problem, count: int) -> list[list[int]]:
    """Threes of source markers far apart from each other, no marker in two of them."""
    from scipy.linalg import qr

    open_ = np.arange(len(problem.s))
    bases = []
    while len(bases) < count and len(open_) >= 3:
        r, pivots = qr(problem.x[open_].T, mode="r", pivoting=True)
        if abs(r[2, 2]) < 1e-6:  # what is left lies on a line
            break
        bases.append(open_[pivots[:3]].tolist())
        open_ = np.delete(open_, pivots[:3])
    return bases


def _matched(problem: Problem, base: list[int], worth: float) -> set[Order]:
    """The labellings under the maps of `base` to every three targets, where they may be worth it.

    The least that an assignment can cost, every marker but one to its nearest, decides which to
    try; a few markers decide it first for most.
    """
    seeds = np.array(list(permutations(range(len(problem.s)), 3)))
    if problem.model.dimension == 2:
        share = np.linalg.solve(problem.x[base].T, problem.x.T).T  # x~ as a mean of the three
        moved = share @ problem.y[seeds]
    else:  # bodies are alike in both frames
        body = Orthogonal(3, None, "similarity")
        source = np.broadcast_to(problem.s[base], (len(seeds), 3, 3))
        moved = problem.x @ np.swapaxes(body.through(source, problem.y[seeds]), 1, 2)
    others = [k for k in range(len(problem.s)) if k not in base][:PROBES]
    near = _apart(moved[:, others], problem.y).min(axis=2)
    moved = moved[_all_but_one(near) <= worth]
    apart = _apart(moved, problem.y)
    least = np.maximum(_all_but_one(apart.min(axis=2)), _all_but_one(apart.min(axis=1)))
    kept = np.argsort(least, kind="stable")[: min(MOST_KEPT, int((least <= worth).sum()))]
    return {_assigned(apart[k]) for k in kept}


def _apart(moved: Array, y: Array) -> Array:
    """(S, K, N) squared distances of moved (S, K, 3) from y (N, 3)."""
    return sum((moved[:, :, None, a] - y[:, a]) ** 2 for a in range(3))


def _all_but_one(squares: Array) -> Array:
    return squares.sum(axis=-1) - squares.max(axis=-1)


def _assigned(cost: Array) -> Order:
    from scipy.optimize import linear_sum_assignment

    return tuple(linear_sum_assignment(cost)[1].tolist())


def _squares(problem: Problem, orders: Sequence[Order], dropped: int) -> NDArray[np.float64]:
    """(P,) weighted sum of squares of each labelling [m²], its worst marker left out or not."""
    n = len(problem.s)
    index = np.array(orders)
    keep = np.ones((1, n), dtype=bool)
    if dropped:
        rests = np.array([np.delete(np.arange(n), k) for k in range(n)])
        keep = ~np.eye(n, dtype=bool)[spans(problem, rests)]
    y = problem.y[index][:, None]
    weights = problem.weights[index][:, None] * keep[None, :, :, None]
    s = np.broadcast_to(problem.s, (*weights.shape[:2], *problem.s.shape))
    m = problem.model.solve(s, np.broadcast_to(y, weights.shape), weights)
    error = y - homogeneous(problem.s) @ np.swapaxes(m, -1, -2)
    return np.maximum((weights * error**2).sum(axis=(-2, -1)).min(axis=1), problem.floor_m**2)
