"""One tolerance in, every setting out: spacing, band and iteration limit in closed form.

The planned surface is where a curve is R = r_c + r_v away. A tolerance τ bounds how far the proxy
may rest from it, and where along it, while the HIP is at most `depth` behind it and moves at most
at `speed`. Three things add up to that, and each gets its share:

dimple, 0.4 τ
    Between points h apart the nearest point is further away than the curve, by at most
    d = h²/8 (1/R + |κ|). So h(s) = √(8 · 0.4 τ / (1/R + |κ(s)|)): as few points as can be, and the
    tick's cost follows their density.
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
from dataclasses import dataclass

from vfplan.errors import SettingError

DIMPLE_SHARE, BAND_SHARE, LAG_SHARE = 0.4, 0.5, 0.1
COARSEST = 0.5  # of R: points further apart than this no band makes smooth
SPEED_M_S = 0.1  # of a careful hand
RATE_HZ = 1000.0
DEPTH = 0.5  # of R: how far behind the surface the tolerance is to hold
FACES = 3  # in space; two in the plane


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

    @property
    def surface_spacing_m(self) -> float:
        """Side of a square grid on a plane with the same dimples, h²/4R deep [m]."""
        return self.spacing_m / math.sqrt(2)


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
    depth = DEPTH * radius_m if depth_m is None else depth_m
    for name, value, unit in (
        ("tolerance", tolerance_m, "m"),
        ("radius", radius_m, "m"),
        ("speed", speed_m_s, "m/s"),
        ("rate", rate_hz, "Hz"),
        ("depth", depth, "m"),
    ):
        if not 0 < value < math.inf:
            raise SettingError(f"{name} {value:g} {unit}: a finite number above 0 is wanted")
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
