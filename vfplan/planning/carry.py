"""A curve carried through a registration: its points, sampled by need, and its lines and arcs."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import ROUND_DOWN, Context
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.fixture import Curve, Fixture, Pieces
from vfplan.geometry.polyline import length_of
from vfplan.planning.settings import DEFAULT_ARCS_M, MIN_ARCS_M, FixtureSettings
from vfplan.planning.tolerance import TightBend, sample_curve

if TYPE_CHECKING:
    from vfplan.registration import Registration

Array = NDArray[np.float64]

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
    # Where the curve bends tighter than the proxy's radius.
    tight_bends: tuple[TightBend, ...] = ()


def carry(
    curve: Fixture,
    registration: Registration,
    settings: FixtureSettings,
    tolerance_m: float | None = None,
) -> CarriedPoints:
    """Carry a curve into the registration's target frame; sample it where it is ordered.

    `tolerance_m` is what the spacing alone may use; `None`: the settings say a density.
    """
    scale = scale_m_per_unit(registration)
    if curve.curve is None:
        points = np.round(registration.apply(curve.points), DECIMALS)
        sigma = curve.sigma
        if sigma is not None:
            sigma = sigma * scale
        return CarriedPoints(points, curve.points, spacing_of_cloud(points), sigma)

    if tolerance_m is None:
        tolerance_m = settings.tolerance_m
    points, strokes, tight_bends = [], [], []
    length_m, sampling_error_m, gaps = 0.0, 0.0, 0
    for stroke in curve.strokes:
        sampled = sample_curve(
            registration.apply(stroke.points),
            stroke.closed,
            radius_m=settings.contact_radius + settings.point_radius,
            tolerance_m=tolerance_m,
            density_per_m=settings.density_per_m,
        )
        points.append(sampled.points)
        strokes.append(stroke.at(sampled.parameter))
        length_m += length_of(sampled.points, stroke.closed)
        gaps += len(sampled.points)
        if not stroke.closed:
            gaps -= 1
        sampling_error_m = max(sampling_error_m, sampled.sampling_error_m)
        tight_bends += sampled.tight_bends

    sigma = None
    if curve.sigma is not None:
        sigma = np.concatenate([stroke.sigma for stroke in strokes]) * scale
    return CarriedPoints(
        points=np.round(np.concatenate(points), DECIMALS),
        source=np.concatenate([stroke.points for stroke in strokes]),
        spacing_m=length_m / gaps,
        sigma=sigma,
        curve=Curve.of(strokes),
        sampling_error_m=sampling_error_m,
        tight_bends=tuple(tight_bends),
    )


def spacing_of_cloud(points: Array) -> float | None:
    """Median distance [m] from each place of a cloud to its nearest other place."""
    from scipy.spatial import cKDTree

    places = np.unique(points, axis=0)
    return None if len(places) < 2 else float(np.median(cKDTree(places).query(places, 2)[0][:, 1]))


def scale_m_per_unit(registration: Registration) -> float:
    """The scale of the map [m per source unit]: geometric mean over its principal directions."""
    k = registration.source.shape[1]
    scales = np.linalg.svd(registration.T_target_source[:3, :k])[1][:k]
    return float(np.exp(np.log(scales).mean()))


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
    from vfplan.geometry.arcs import fit_arcs, plane

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
    tolerance_m = (settings.arcs_m or DEFAULT_ARCS_M) - ROUNDING_M
    measured = registration.apply(curve.points)
    flat, height = measured @ frame.T, float((measured @ axis).mean())
    vertices, bulges, counts, error_m = [], [], [], 0.0
    for number, is_closed in enumerate(curve.curve.closed):
        arcs = fit_arcs(flat[curve.curve.stroke == number], bool(is_closed), tolerance_m)
        samples = carried.points[carried.curve.stroke == number] @ frame.T
        departure_m = max(arcs.error, float(arcs.distance(samples).max()))
        error_m = max(error_m, departure_m + ROUNDING_M)
        vertices.append(np.round(arcs.vertices @ frame + height * axis, VERTEX_DECIMALS))
        bulges.append(np.round(arcs.bulges, DECIMALS))
        counts.append(len(arcs.bulges))
    numbers = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    return Pieces(
        np.concatenate(vertices), np.concatenate(bulges), numbers, curve.curve.closed, error_m
    )


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
        guide's radius.
    """
    # A gate that nobody named is no reason to refuse coarse lines and arcs.
    max_tre_m = settings.max_tre_m
    if isinstance(max_tre_m, str):
        max_tre_m = None
    lengths = ("margin", margin_m), ("--max-tre", max_tre_m), ("guide", settings.guide_m)
    for name, length_m in lengths:
        if not length_m or pieces.error <= ARCS_SHARE_OF_MARGIN * length_m:
            continue
        allowed_mm = Context(2, ROUND_DOWN).create_decimal(ARCS_SHARE_OF_MARGIN * length_m * 1e3)
        advice = f"{float(allowed_mm):g}, or less" if allowed_mm >= 1e3 * MIN_ARCS_M else "none"
        raise SettingError(
            f"the lines and arcs lie up to {1e3 * pieces.error:.4g} mm beside the curve, and "
            f"the {name} of {1e3 * length_m:.4g} mm allows {ARCS_SHARE_OF_MARGIN:g} of "
            f"itself. Give --arcs {advice}",
            code="arcs-coarse",
            numbers={"error_m": pieces.error, "length_m": length_m},
        )
