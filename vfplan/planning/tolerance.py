"""One tolerance in, every setting out: spacing, band and iteration limit; and the points so spaced.

The planned surface is where a curve is R = r_c + r_v away. A tolerance τ bounds how far the proxy
may rest from it, and where along it, while the HIP is at most `depth` behind it and moves at most
at `speed`. Three things add up to that, and each gets its share:

spacing, 0.4 τ
    Between two points a distance h apart the union of their spheres falls short of the tube that
    the sphere sweeps along the curve; on the convex side of a bend of curvature κ by at most

        d = R − √(R² − h²/4) + |κ| h²/8,

    the dimple of a straight line and the sagitta of the bend; R and the sagitta once the spheres no
    longer meet. For small h that is h²/8 · (1/R + |κ|); 1/R alone misses by a factor of 3.5 at a
    2 mm bend (R = 5 mm). A share t of the tolerance allows

        h(s) = √(8 t / (1/(R − t/2) + |κ(s)|)),

    with which d ≤ t exactly, since R − √(R² − h²/4) = h²/4 / (R + √(R² − h²/4)) and the root is at
    least R − t; spheres that do not touch hold no tolerance, so t counts up to R. That is as few
    points as can be, and the tick's cost follows their density.
band, 0.5 τ
    The engine calls anything within R ± b contact, so the proxy rests up to b off either way. It
    glides over the dimples as long as b >= d, and is the smoother for a band that is not narrower
    than it need be: b = 0.5 τ.
iterations, 0.1 τ
    Each iteration slides along the tangent plane and returns to the surface. On a surface whose
    offset has the radius of curvature ρ, with the HIP δ behind it, what is left of a lag e after
    one iteration is e δ/ρ; nothing is sharper than ρ = R, the ball around a single point. While the
    HIP runs on by v T a tick its exact proxy runs by w = v T ρ / (ρ - δ), so after n iterations the
    lag stays at e = w qⁿ / (1 - qⁿ), q = δ/R. From e <= 0.1 τ:

        n = ⌈ ln(1 + w / 0.1 τ) / ln(1/q) ⌉, and one more for each face that can hold the proxy.

    The engine stops earlier where nothing moves; the limit is what a worst tick can cost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import MOST_POINTS, number
from vfplan.errors import SettingError

DIMPLE_SHARE, BAND_SHARE, LAG_SHARE = 0.4, 0.5, 0.1
COARSEST = 0.5  # of R: points further apart than this no band makes smooth
SPEED_M_S = 0.1  # of a careful hand
RATE_HZ = 1000.0
DEPTH = 0.5  # of R: how far behind the surface the tolerance is to hold
FACES = 3  # in space; two in the plane
DENSE = 4  # steps in each interval of the fine curve


@dataclass(frozen=True)
class Choice:
    """The cheapest settings that keep a tolerance."""

    tolerance_m: float  # how far the proxy may be from where the planned surface puts it [m]
    # The tolerance that the settings below keep [m]: `tolerance_m`, or `largest_tolerance` where
    # that is less
    kept_m: float
    sampling_tolerance_m: float  # what of it the spacing may use, the dimples' depth [m]
    spacing_m: float  # distance of the points on a straight stretch [m]; less where the curve bends
    band_m: float  # r2 - r_c [m]
    max_iterations: int  # a tick

    @property
    def lag_m(self) -> float:
        """What of the tolerance the iteration limit may use [m]."""
        return LAG_SHARE / BAND_SHARE * self.band_m


def choose(
    tolerance_m: float,
    radius_m: float,
    *,
    planar: bool = True,
    speed_m_s: float = SPEED_M_S,
    rate_hz: float = RATE_HZ,
    depth_m: float | None = None,
) -> Choice:
    """The settings that a tolerance allows.

    tolerance_m: τ [m] > 0. Of more than `largest_tolerance(radius_m)` only that is used; `kept_m`
        tells.
    radius_m: R = r_c + r_v [m]
    planar: whether the fixture ignores an axis
    speed_m_s, rate_hz: the fastest hand and the servo rate that the tolerance is to hold for
    depth_m: the deepest press that it is to hold for, below R [m]; `None`: R/2
    Raises SettingError: a value that is not positive and finite, or a depth that is not below R
    """
    tolerance_m = number("tolerance", tolerance_m, "m", above=0.0)
    radius_m = number("radius", radius_m, "m", above=0.0)
    speed_m_s = number("speed", speed_m_s, "m/s", above=0.0)
    rate_hz = number("rate", rate_hz, "Hz", above=0.0)
    depth = DEPTH * radius_m if depth_m is None else number("depth", depth_m, "m", above=0.0)
    if depth >= radius_m:
        raise SettingError(f"depth {depth:g} m: below R = {radius_m:g} m is wanted")
    kept = min(tolerance_m, largest_tolerance(radius_m))
    dimple = DIMPLE_SHARE * kept
    return Choice(
        tolerance_m=tolerance_m,
        kept_m=kept,
        sampling_tolerance_m=dimple,
        spacing_m=math.sqrt(8 * radius_m * dimple),
        band_m=BAND_SHARE * kept,
        max_iterations=iterations(LAG_SHARE * kept, radius_m, depth, speed_m_s / rate_hz)
        + (FACES - 1 if planar else FACES),
    )


def iterations(lag_m: float, radius_m: float, depth_m: float, step_m: float) -> int:
    """How many iterations a tick keep the lag below `lag_m` on the sharpest convex surface."""
    q = depth_m / radius_m
    run = step_m / (1 - q)
    return max(1, math.ceil(math.log1p(run / lag_m) / -math.log(q)))


def largest_tolerance(radius_m: float) -> float:
    """The tolerance at which points stand half of R apart [m]; beyond it they are bumps."""
    return (COARSEST * radius_m) ** 2 / (8 * radius_m) / DIMPLE_SHARE


@dataclass(frozen=True)
class TightBend:
    """A stretch where the curve bends tighter than the proxy's radius, so it cannot be followed."""

    arclength_m: float  # where the curvature is largest, along the curve [m]
    position_m: tuple[float, float, float]  # (x, y, z) of that place [m]
    radius_m: float  # radius of curvature there [m]


@dataclass(frozen=True, eq=False)
class Sampled:
    """Points along a curve."""

    points: NDArray[np.float64]  # (N, 3) [m]
    arclength: NDArray[np.float64]  # (N,) of each point along the curve [m]
    parameter: NDArray[np.float64]  # (N,) float index into the fine curve
    spacing_m: float  # largest distance between neighbours along the curve [m]
    sampling_error_m: float  # bound on how far the union of spheres lies from the swept curve [m]
    tight_bends: tuple[TightBend, ...]  # where the radius of curvature is below `radius_m`


def sample_curve(
    points_m: NDArray,
    closed: bool,
    *,
    radius_m: float,
    tolerance_m: float | None = 1e-5,
    density_per_m: float | None = None,
) -> Sampled:
    """Sample a fine curve by need, or at a given density.

    Parameters
    ----------
    points_m
        (M, 3) fine curve [m], in order, closely spaced; a cubic spline is laid through it.
    closed
        Whether the last point joins the first.
    radius_m
        R = r_c + r_v [m].
    tolerance_m
        How far the union of spheres may lie from the swept curve, on either side [m].
    density_per_m
        Points a metre of arc; takes the place of the tolerance, which may be `None` then.

    Raises
    ------
    SettingError
        A radius, tolerance or density that is not positive and finite, or takes more points than a
        bundle holds; fewer than two points, or points that are not finite.
    """
    points = _checked(points_m, radius_m, tolerance_m, density_per_m)
    curve = _Fine.of(points, closed)
    if density_per_m is None:
        kept = min(tolerance_m, radius_m)
        wanted = _least_nearby(
            np.sqrt(8 * kept / (1 / (radius_m - kept / 2) + curve.kappa)), curve.arc, closed
        )
    else:
        wanted = np.full(len(curve.arc), 1 / density_per_m)
    at = _places(curve.arc, wanted, closed)
    parameter = np.interp(at, curve.arc, curve.parameter)
    gaps = np.diff(np.r_[at, curve.arc[-1]] if closed else at)
    return Sampled(
        points=curve.spline(parameter),
        arclength=at,
        parameter=parameter,
        spacing_m=float(gaps.max()),
        sampling_error_m=_bound(at, gaps, curve, radius_m),
        tight_bends=_tight_bends(curve, radius_m),
    )


@dataclass(frozen=True, eq=False)
class _Fine:
    """The cubic spline through a fine curve's points, over their index, and dense values of it."""

    spline: Callable[[NDArray], NDArray]
    parameter: NDArray  # (D,) dense float indices
    arc: NDArray  # (D,) [m]
    kappa: NDArray  # (D,) |κ| [1/m], the largest within a dense step on either side

    @classmethod
    def of(cls, points: NDArray, closed: bool) -> _Fine:
        from scipy.interpolate import CubicSpline

        ring = np.vstack([points, points[:1]]) if closed else points
        ends = "periodic" if closed and len(ring) > 3 else "not-a-knot"
        spline = CubicSpline(np.arange(len(ring)), ring, bc_type=ends)
        t = np.linspace(0, len(ring) - 1, DENSE * (len(ring) - 1) + 1)
        first, second = spline(t, 1), spline(t, 2)
        speed = np.linalg.norm(first, axis=1)
        kappa = np.linalg.norm(np.cross(first, second), axis=1) / np.maximum(speed, 1e-12) ** 3
        wide = np.r_[kappa[:1], kappa, kappa[-1:]]
        kappa = np.maximum.reduce([wide[:-2], kappa, wide[2:]])
        arc = np.r_[0.0, np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t))]
        return cls(spline, t, arc, kappa)


def _checked(
    points_m: NDArray, radius_m: float, tolerance_m: float | None, density_per_m: float | None
) -> NDArray:
    number("radius", radius_m, "m", above=0.0)
    if density_per_m is None:
        number("tolerance", tolerance_m, "m", above=0.0)
    else:
        number("density", density_per_m, "a metre", above=0.0)
    points = np.asarray(points_m, float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise SettingError(f"a curve is (M, 3) with M of 2 or more; got {points.shape}")
    if not np.isfinite(points).all():
        raise SettingError("the curve holds points that are not finite")
    return points


def _least_nearby(wanted: NDArray, arc: NDArray, closed: bool) -> NDArray:
    """The smallest spacing wanted within one spacing and the steps that it ends in.

    A gap must suit all that it spans. Minima of two runs of 1, 2, 4 ... cover the window of each.
    """
    at, reach = arc, wanted.max()
    if closed:
        arc = np.r_[arc[:-1] - arc[-1], arc, arc[1:] + arc[-1]]
        wanted = np.r_[wanted[:-1], wanted, wanted[1:]]
    first = np.maximum(np.searchsorted(arc, at - reach) - 1, 0)
    last = np.minimum(np.searchsorted(arc, at + reach, "right") + 1, len(arc))
    least, run = np.empty(len(at)), 1
    while run <= (last - first).max():
        rows = np.flatnonzero((last - first >= run) & (last - first < 2 * run))
        least[rows] = np.minimum(wanted[first[rows]], wanted[last[rows] - run])
        wanted, run = np.minimum(wanted[:-run], wanted[run:]), 2 * run
    return least


def _places(arc: NDArray, wanted: NDArray, closed: bool) -> NDArray:
    """Arc lengths such that each gap fits the spacing wanted there; whole gaps, evenly shared."""
    density = 1 / wanted
    steps = np.diff(arc)
    count = np.r_[0.0, np.cumsum(steps * np.maximum(density[1:], density[:-1]))]
    if not count[-1] < MOST_POINTS:
        raise SettingError(
            f"the spacing asked for takes {count[-1]:.3g} points over {arc[-1]:.3g} m; at most "
            f"{MOST_POINTS} fit into a bundle"
        )
    whole = max(1, int(np.ceil(count[-1] - 1e-9)))
    if closed:
        whole = max(3, whole)
    at = np.interp(np.linspace(0, count[-1], whole + 1), count, arc)
    return at[:-1] if closed else at


def _bound(at: NDArray, gaps: NDArray, curve: _Fine, radius: float) -> float:
    """R − √(R² − h²/4) + |κ| h²/8, the largest over all gaps [m]."""
    gap = np.minimum(np.searchsorted(at, curve.arc, side="right") - 1, len(gaps) - 1)
    dimple = radius - np.sqrt(np.maximum(radius**2 - gaps**2 / 4, 0.0))
    return float((dimple[gap] + gaps[gap] ** 2 / 8 * curve.kappa).max())


def _tight_bends(curve: _Fine, radius: float) -> tuple[TightBend, ...]:
    tight = np.flatnonzero(curve.kappa * radius > 1)
    if not len(tight):
        return ()
    runs = np.split(tight, np.flatnonzero(np.diff(tight) > 1) + 1)
    worst = [int(run[np.argmax(curve.kappa[run])]) for run in runs]
    places = curve.spline(curve.parameter[worst])
    return tuple(
        TightBend(float(curve.arc[i]), tuple(map(float, place)), float(1 / curve.kappa[i]))
        for i, place in zip(worst, places, strict=True)
    )
