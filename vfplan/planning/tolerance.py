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

A curve carried through a registration: its points, sampled by need, and its lines and arcs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import MAX_POINTS, number
from vfplan.errors import SettingError
from vfplan.fixture import Curve, Fixture, Pieces
from vfplan.geometry.lines import Array, Spline, length_of, row_lengths, spline_through
from vfplan.planning.settings import DEFAULT_ARCS_M, FixtureSettings

if TYPE_CHECKING:
    from vfplan.registration.registration import Registration


# Shares of the tolerance; see above.
DIMPLE_SHARE = 0.4
BAND_SHARE = 0.5
LAG_SHARE = 0.1

# Spacing over R: points further apart than this no band makes smooth.
MAX_SPACING_SHARE = 0.5

# The speed of a careful hand [m/s].
SPEED_M_S = 0.1
RATE_HZ = 1000.0

# Depth over R: how far behind the surface the tolerance is to hold.
DEPTH = 0.5

# Steps in each interval of the fine curve.
STEPS = 4


@dataclass(frozen=True)
class Choice:
    """The cheapest settings that keep a tolerance."""

    # How far the proxy may be from where the planned surface puts it [m].
    tolerance_m: float
    # The tolerance that the settings below keep [m]: `tolerance_m`, or `largest_tolerance` where
    # that is less.
    used_tolerance_m: float
    # What of it the spacing may use, the dimples' depth [m].
    sampling_tolerance_m: float
    # Distance of the points on a straight stretch [m]; less where the curve bends.
    spacing_m: float
    # r2 - r_c [m].
    band_m: float
    # In a tick.
    max_iterations: int

    @property
    def lag_m(self) -> float:
        """What of the tolerance the iteration limit may use [m]."""
        return LAG_SHARE / BAND_SHARE * self.band_m


def choose(tolerance_m: float, radius_m: float, *, planar: bool = True) -> Choice:
    """The settings that a tolerance allows.

    tolerance_m: τ [m] > 0. Of more than `largest_tolerance(radius_m)` only that is used;
        `used_tolerance_m` says so.
    radius_m: R = r_c + r_v [m]
    planar: whether the fixture ignores an axis
    Raises SettingError: a value that is not positive and finite
    """
    tolerance_m = number("tolerance", tolerance_m, "m", above=0.0)
    radius_m = number("radius", radius_m, "m", above=0.0)
    used_m = min(tolerance_m, largest_tolerance(radius_m))
    dimple_m = DIMPLE_SHARE * used_m
    # Faces that can hold the proxy.
    faces = 2 if planar else 3
    return Choice(
        tolerance_m=tolerance_m, used_tolerance_m=used_m, sampling_tolerance_m=dimple_m,
        spacing_m=math.sqrt(8 * radius_m * dimple_m), band_m=BAND_SHARE * used_m,
        max_iterations=iterations(LAG_SHARE * used_m) + faces,
    )  # fmt: skip


def iterations(lag_m: float) -> int:
    """How many iterations a tick keep the lag below `lag_m` on the sharpest convex surface."""
    run_m = SPEED_M_S / RATE_HZ / (1 - DEPTH)
    return max(1, math.ceil(math.log1p(run_m / lag_m) / -math.log(DEPTH)))


def largest_tolerance(radius_m: float) -> float:
    """The tolerance at which points stand half of R apart [m]; beyond it they are bumps."""
    return (MAX_SPACING_SHARE * radius_m) ** 2 / (8 * radius_m) / DIMPLE_SHARE


@dataclass(frozen=True, eq=False)
class Sampling:
    """Points along a curve."""

    # (N, 3) [m].
    points: Array
    # (N,) of each point along the curve [m].
    arclength: Array
    # (N,) float index into the fine curve.
    parameter: Array
    # Largest distance between neighbours along the curve [m].
    spacing_m: float
    # Bound on how far the union of spheres lies from the swept curve [m].
    sampling_error_m: float


def sample_curve(
    points_m: NDArray, closed: bool, *, radius_m: float, tolerance_m: float | None = 1e-5,
    density_per_m: float | None = None,
) -> Sampling:  # fmt: skip
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
    number("radius", radius_m, "m", above=0.0)
    if density_per_m is None:
        number("tolerance", tolerance_m, "m", above=0.0)
    else:
        number("density", density_per_m, "a metre", above=0.0)
    points = np.asarray(points_m, float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2 or not np.isfinite(points).all():
        raise SettingError(
            f"the curve's points have shape {points.shape}. Give (M, 3) finite numbers with M of 2 "
            "or more",
            code="points-shape",
        )
    spline, dense, arc, kappa = dense_values(points, closed)

    # The spacing that each place allows, and with it the points.
    if density_per_m is None:
        dimple_m = min(tolerance_m, radius_m)
        allowed = np.sqrt(8 * dimple_m / (1 / (radius_m - dimple_m / 2) + kappa))
        spacing = smallest_nearby(allowed, arc, closed)
    else:
        spacing = np.full(len(arc), 1 / density_per_m)
    arclength = place_points(arc, spacing, closed)
    parameter = np.interp(arclength, arc, dense)
    gaps = np.diff(np.append(arclength, arc[-1]) if closed else arclength)

    # R − √(R² − h²/4) + |κ| h²/8, the largest over all gaps [m].
    gap = np.minimum(np.searchsorted(arclength, arc, side="right") - 1, len(gaps) - 1)
    dimple = radius_m - np.sqrt(np.maximum(radius_m**2 - gaps**2 / 4, 0.0))
    sampling_error_m = float((dimple[gap] + gaps[gap] ** 2 / 8 * kappa).max())
    return Sampling(
        points=spline(parameter), arclength=arclength, parameter=parameter,
        spacing_m=float(gaps.max()), sampling_error_m=sampling_error_m,
    )  # fmt: skip


def dense_values(points: Array, closed: bool) -> tuple[Spline, Array, Array, Array]:
    """The cubic spline through a fine curve's points (M, 3), over their index, and dense values.

    These are, each (D,): float indices, arc lengths [m], and the largest |κ| within a dense step on
    either side [1/m].
    """
    if closed:
        points = np.vstack([points, points[:1]])
    spline = spline_through(points, periodic=closed and len(points) > 3)
    t = np.linspace(0, len(points) - 1, STEPS * (len(points) - 1) + 1)
    first, second = spline(t, 1), spline(t, 2)
    speed = row_lengths(first)
    kappa = row_lengths(np.cross(first, second)) / np.maximum(speed, 1e-12) ** 3
    wide = np.concatenate([kappa[:1], kappa, kappa[-1:]])
    kappa = np.maximum.reduce([wide[:-2], kappa, wide[2:]])
    steps = (speed[1:] + speed[:-1]) / 2 * np.diff(t)
    return spline, t, np.append(0.0, np.cumsum(steps)), kappa


def smallest_nearby(spacing: Array, arc: Array, closed: bool) -> Array:
    """(D,) the smallest spacing allowed within one spacing and the steps that it ends in.

    A gap must suit all that it spans.
    """
    centre, reach = arc, spacing.max()
    if closed:
        arc = np.concatenate([arc[:-1] - arc[-1], arc, arc[1:] + arc[-1]])
        spacing = np.concatenate([spacing[:-1], spacing, spacing[1:]])
    first = np.maximum(np.searchsorted(arc, centre - reach) - 1, 0)
    last = np.minimum(np.searchsorted(arc, centre + reach, "right") + 1, len(arc))
    # Of each pair of places, the minimum from the one up to the other.
    runs = np.column_stack([first, last]).ravel()
    return np.minimum.reduceat(np.append(spacing, np.inf), runs)[::2]


def place_points(arc: Array, spacing: Array, closed: bool) -> Array:
    """(N,) arc lengths such that each gap fits the spacing there; whole gaps, evenly shared."""
    density = 1 / spacing
    gaps = np.diff(arc) * np.maximum(density[1:], density[:-1])
    count = np.append(0.0, np.cumsum(gaps))
    if not count[-1] < MAX_POINTS:
        raise SettingError(
            f"the spacing asked for takes {count[-1]:.3g} points over {arc[-1]:.3g} m; at most "
            f"{MAX_POINTS} fit into a bundle. Give a larger tolerance",
            code="too-many-points", numbers={"points": float(count[-1])},
        )  # fmt: skip
    whole = max(1, int(np.ceil(count[-1] - 1e-9)))
    if closed:
        whole = max(3, whole)
    places = np.interp(np.linspace(0, count[-1], whole + 1), count, arc)
    return places[:-1] if closed else places


# Decimals of a point [m] and of a bulge. An id must not depend on a processor's last bits; bulges
# differ at 1e-13.
DECIMALS = 9

# Decimals of a vertex [m], one more. Processors differ at 1e-16 m; rounding turns a joint by 1e-7
# rad at most, which no rule takes for a corner.
VERTEX_DECIMALS = DECIMALS + 1

# What both roundings move a line or an arc by at most [m], for chords up to 1 m: the last decimal.
ROUNDING_M = 10.0**-DECIMALS

# Share of a margin, gate or tube that lines and arcs may depart from the curve beside it.
ARCS_SHARE_OF_MARGIN = 0.05

# Share of R that they may depart by in a bundle (docs/format.md, V7).
ARCS_SHARE_OF_RADIUS = 0.01


@dataclass(frozen=True, eq=False)
class CarriedPoints:
    """The fixture's points and what came with them."""

    # (N, 3) in the target frame [m].
    points: Array
    # (N, 3) the same points in the curve's own frame.
    source: Array
    # Mean distance between neighbours along the curve [m]. Of a bare cloud it is the median
    # distance to the nearest other place, `None` where there is one place alone.
    spacing_m: float | None
    # (N,) standard deviation across the curve [m].
    sigma: Array | None
    # Strokes and order; `None` for a bare cloud, where every mask pixel is a point.
    curve: Curve | None = None
    # Bound on what the spacing adds to the surface [m]; `None` for a bare cloud.
    sampling_error_m: float | None = None


def carry(
    curve: Fixture, registration: Registration, settings: FixtureSettings, tolerance_m: float | None
) -> CarriedPoints:
    """Carry a curve into the registration's target frame; sample it where it is ordered.

    `tolerance_m` is what the spacing alone may use; `None`: the settings say a density.
    """
    scale = registration.scale
    if curve.curve is None:
        points = np.round(registration.apply(curve.points), DECIMALS)
        sigma = curve.sigma * scale if curve.sigma is not None else None
        places, spacing_m = np.unique(points, axis=0), None
        if len(places) > 1:
            from scipy.spatial import cKDTree

            spacing_m = float(np.median(cKDTree(places).query(places, 2)[0][:, 1]))
        return CarriedPoints(points, curve.points, spacing_m, sigma)

    points, strokes = [], []
    length_m, sampling_error_m, gaps = 0.0, 0.0, 0
    for stroke in curve.strokes:
        sampled = sample_curve(
            registration.apply(stroke.points), stroke.closed, tolerance_m=tolerance_m,
            radius_m=settings.contact_radius + settings.point_radius,
            density_per_m=settings.density_per_m,
        )  # fmt: skip
        points.append(sampled.points)
        strokes.append(stroke.at(sampled.parameter))
        length_m += length_of(sampled.points, stroke.closed)
        gaps += len(sampled.points) - (not stroke.closed)
        sampling_error_m = max(sampling_error_m, sampled.sampling_error_m)

    sigma = None
    if curve.sigma is not None:
        sigma = np.concatenate([stroke.sigma for stroke in strokes]) * scale
    return CarriedPoints(
        points=np.round(np.concatenate(points), DECIMALS),
        source=np.concatenate([stroke.points for stroke in strokes]),
        spacing_m=length_m / gaps, sigma=sigma, curve=Curve.of(strokes),
        sampling_error_m=sampling_error_m,
    )  # fmt: skip


def lines_and_arcs_of(
    curve: Fixture,
    registration: Registration,
    axis: Array | None,
    settings: FixtureSettings,
    carried: CarriedPoints,
) -> Pieces | None:
    """The carried strokes as lines and arcs, where they can be rendered as such.

    Parameters
    ----------
    curve
        The measured one, before it is carried over; a bare cloud has no strokes.
    axis
        (3,) that the fixture ignores; `None`: a curve in space.
    settings
        How far the measured curve may lie from its lines and arcs.
    carried
        The points sampled from the same strokes. They lie on the straight lines between the
        measured points, so that the lines and arcs may depart from them by more; their error says
        so.

    Raises
    ------
    SettingError
        Lines and arcs are asked for, and there can be none.
    """
    from vfplan.geometry.lines import fit_arcs, plane

    if settings.points_only:
        return None
    if axis is None or curve.curve is None:
        if settings.arcs_m is None:
            return None
        raise SettingError(
            "only drawn strokes across an ignored axis have lines and arcs. Leave --arcs out",
            code="arcs-impossible",
        )
    frame = plane(axis)
    usual_m = min(DEFAULT_ARCS_M, ARCS_SHARE_OF_RADIUS * settings.contact_radius)
    tolerance_m = (settings.arcs_m or usual_m) - ROUNDING_M
    measured = registration.apply(curve.points)
    flat, height = measured @ frame.T, float((measured @ axis).mean())
    strokes, error_m = [], 0.0
    for stroke, is_closed in enumerate(curve.curve.closed):
        arcs = fit_arcs(flat[curve.curve.stroke == stroke], bool(is_closed), tolerance_m)
        samples = carried.points[carried.curve.stroke == stroke] @ frame.T
        departure_m = max(arcs.error, float(arcs.distance(samples).max()))
        error_m = max(error_m, departure_m + ROUNDING_M)
        vertices = np.round(arcs.vertices @ frame + height * axis, VERTEX_DECIMALS)
        strokes.append((vertices, np.round(arcs.bulges, DECIMALS), is_closed))
    return replace(Pieces.joined(strokes), error=error_m)


def check_arcs_error(pieces: Pieces, margin_m: float, settings: FixtureSettings) -> None:
    """Refuse lines and arcs whose departure from the curve a margin, gate or tube does not count.

    Parameters
    ----------
    margin_m
        The margin that was added [m], or 0.

    Raises
    ------
    SettingError
        They depart by more than `ARCS_SHARE_OF_MARGIN` of the margin, of `max_tre_m` or of the
        guide's radius, or by more than `ARCS_SHARE_OF_RADIUS` of R.
    """
    # A gate that nobody named is no reason to refuse coarse lines and arcs.
    max_tre_m = None if isinstance(settings.max_tre_m, str) else settings.max_tre_m
    radius_m = settings.contact_radius + settings.point_radius + margin_m
    asked = {} if settings.arcs_m is None else {"arcs_m": settings.arcs_m}
    for name, length_m, share in (
        ("margin", margin_m, ARCS_SHARE_OF_MARGIN),
        ("largest allowed error", max_tre_m, ARCS_SHARE_OF_MARGIN),
        ("guide", settings.guide_m, ARCS_SHARE_OF_MARGIN),
        ("contact radius", radius_m, ARCS_SHARE_OF_RADIUS),
    ):  # fmt: skip
        if length_m and pieces.error > share * length_m:
            raise SettingError(
                f"the lines and arcs lie up to {1e3 * pieces.error:.4g} mm beside the curve, and "
                f"the {name} of {1e3 * length_m:.4g} mm allows {100 * share:g} % of that. "
                f"Give --arcs {950 * share * length_m:.2g} or less, or none",
                code="arcs-coarse",
                numbers={"error_m": pieces.error, "length_m": length_m, **asked},
            )
