"""A curve carried through a registration: its points, sampled by need, and its lines and arcs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import ROUND_DOWN, Context
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.fixture import Curve, Fixture, Pieces
from vfplan.planning.settings import ARCS_M, DEFAULT_ARCS_M, FixtureSettings
from vfplan.planning.tolerance import TightBend, sample_curve

if TYPE_CHECKING:
    from vfplan.registration import Registration

GRID_DECIMALS = 9
SMALL = 0.05  # of a margin or gate: what lines and arcs may depart beside it

Vector = NDArray[np.float64]
VERTEX_DECIMALS = 10
"""Decimals of a vertex [m]. Processors differ at 1e-16 m; rounding turns a joint by 1e-7 rad at
most, which no rule takes for a corner."""
BULGE_DECIMALS = 9
"""Decimals of a bulge. Processors differ at 1e-13."""
PIECE_ROUNDING_M = 1e-9
"""What both roundings move a piece by at most [m], for chords up to 1 m."""


@dataclass(frozen=True, eq=False)
class Carried:
    """The fixture's points and what came with them."""

    points: NDArray[np.float64]  # (N, 3) in `robot_base` [m]
    source: NDArray[np.float64]  # (N, 3) the same points in the curve's own frame
    # Mean distance between neighbours along the curve; for a bare cloud the median distance to the
    # nearest other place, `None` where there is one place alone [m]
    spacing_m: float | None
    sigma: NDArray[np.float64] | None  # (N,) standard deviation across the curve [m]
    # Strokes and order; `None` for a bare cloud (every mask pixel a point)
    curve: Curve | None = None
    # Bound on what the spacing adds to the surface [m]; `None` for a bare cloud
    sampling_error_m: float | None = None
    tight_bends: tuple[TightBend, ...] = ()  # where the curve bends tighter than the proxy's radius


def carry(
    curve: Fixture,
    registration: Registration,
    settings: FixtureSettings,
    tolerance_m: float | None = None,
) -> Carried:
    """Carry a curve into the registration's target frame; sample it where it is ordered.

    `tolerance_m` is what the spacing alone may use; `None`: the settings say a density.
    """
    if curve.curve is None:
        points = _on_grid(registration.apply(curve.points))
        sigma = None if curve.sigma is None else curve.sigma * metres_per_unit(registration)
        return Carried(points, curve.points, _spacing(points), sigma)
    members = [curve.curve.stroke == k for k in range(len(curve.curve.closed))]
    samples = [
        sample_curve(
            registration.apply(curve.points[own]),
            bool(closed),
            radius_m=settings.contact_radius + settings.point_radius,
            tolerance_m=settings.tolerance_m if tolerance_m is None else tolerance_m,
            density_per_m=settings.density_per_m,
        )
        for own, closed in zip(members, curve.curve.closed, strict=True)
    ]
    pairs = list(zip(members, samples, strict=True))
    counts = [len(s.points) for s in samples]
    length = sum(length_of(s.points, c) for s, c in zip(samples, curve.curve.closed, strict=True))
    flags: dict[str, NDArray[np.bool_]] = {}
    for name in ("bridged", "edited"):
        marks = getattr(curve.curve, name)
        if marks is not None:
            shares = [along(marks[own].astype(float), s.parameter) for own, s in pairs]
            flags[name] = np.concatenate(shares) > 0
    sigma = None
    if curve.sigma is not None:
        scale = metres_per_unit(registration)
        sigma = np.concatenate([along(curve.sigma[own], s.parameter) for own, s in pairs]) * scale
    return Carried(
        points=_on_grid(np.concatenate([s.points for s in samples])),
        source=np.concatenate([along(curve.points[own], s.parameter) for own, s in pairs]),
        spacing_m=length / (sum(counts) - np.count_nonzero(~curve.curve.closed)),
        sigma=sigma,
        curve=replace(in_strokes(counts, curve.curve.closed), **flags),
        sampling_error_m=max(s.sampling_error_m for s in samples),
        tight_bends=tuple(bend for s in samples for bend in s.tight_bends),
    )


def _spacing(points: NDArray[np.float64]) -> float | None:
    from scipy.spatial import cKDTree

    places = np.unique(points, axis=0)
    if len(places) < 2:
        return None
    return float(np.median(cKDTree(places).query(places, 2)[0][:, 1]))


def _on_grid(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The points to the nanometre: an id must not depend on a processor's last bit."""
    return np.round(points, GRID_DECIMALS)


def metres_per_unit(registration: Registration) -> float:
    """The scale of the map [m per source unit]: geometric mean over its principal directions."""
    k = registration.source.shape[1]
    scales = np.linalg.svd(registration.T_target_source[:3, :k])[1][:k]
    return float(np.exp(np.log(scales).mean()))


def along(values: NDArray[np.float64], parameter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (M,) or (M, K) of a fine curve at float indices (N,) of its points.

    Between the last point of a closed curve (index M - 1) and M lies the step back to the first.
    """
    ring = np.concatenate([values, values[:1]])
    below = np.minimum(parameter.astype(int), len(values) - 1)
    part = (parameter - below).reshape(-1, *[1] * (values.ndim - 1))
    return ring[below] * (1 - part) + ring[below + 1] * part


def length_of(points: NDArray[np.float64], closed: bool) -> float:
    """The way along points (N, K), of a closed curve back to the first."""
    ring = np.concatenate([points, points[:1]]) if closed else points
    return float(np.linalg.norm(np.diff(ring, axis=0), axis=1).sum())


def in_strokes(
    counts: list[int], closed: NDArray[np.bool_], bridged: NDArray[np.bool_] | None = None
) -> Curve:
    """Strokes of so many points each, one after the other."""
    return Curve(np.repeat(np.arange(len(counts), dtype=np.int32), counts), closed, bridged)


def pieces_of(
    curve: Fixture,
    registration: Registration,
    axis: Vector | None,
    settings: FixtureSettings,
    carried: Carried,
) -> Pieces | None:
    """The carried strokes as lines and arcs, where they can be rendered as such.

    Parameters
    ----------
    curve
        The measured one, before it is carried over; a bare cloud has no strokes.
    axis
        (3,) that the fixture ignores; `None`: a curve in space.
    settings
        How far the measured curve may lie from its pieces.
    carried
        The points sampled from the same strokes. They lie on the straight lines between the
        measured points, so that the pieces may leave them by more; the pieces' error says so.

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
        raise SettingError("lines and arcs: only of drawn strokes, across an ignored axis")
    frame = plane(axis)
    tolerance = (settings.arcs_m or DEFAULT_ARCS_M) - PIECE_ROUNDING_M
    measured = registration.apply(curve.points)
    flat, height = measured @ frame.T, float((measured @ axis).mean())
    vertices, bulges, counts, error = [], [], [], 0.0
    for number, closed in enumerate(curve.curve.closed):
        arcs = fit_arcs(flat[curve.curve.stroke == number], bool(closed), tolerance)
        samples = carried.points[carried.curve.stroke == number] @ frame.T
        departure = max(arcs.error, float(arcs.distance(samples).max()))
        error = max(error, departure + PIECE_ROUNDING_M)
        # An id must not depend on a processor's last bit.
        vertices.append(np.round(arcs.vertices @ frame + height * axis, VERTEX_DECIMALS))
        bulges.append(np.round(arcs.bulges, BULGE_DECIMALS))
        counts.append(len(arcs.bulges))
    numbers = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    closed = curve.curve.closed
    return Pieces(np.concatenate(vertices), np.concatenate(bulges), numbers, closed, error)


def require_small(pieces: Pieces, largest_m: float, settings: FixtureSettings) -> None:
    """Refuse lines and arcs whose departure from the curve a margin, gate or tube does not count.

    Parameters
    ----------
    largest_m
        The margin that was added [m], or 0.

    Raises
    ------
    SettingError
        They depart by more than `SMALL` of the margin, of `max_tre_m` or of the guide's radius.
    """
    # A gate that nobody named is no reason to refuse coarse lines and arcs.
    max_tre_m = None if isinstance(settings.max_tre_m, str) else settings.max_tre_m
    counted = ("margin", largest_m), ("--max-tre", max_tre_m), ("guide", settings.guide_m)
    for name, beside in counted:
        if beside and pieces.error > SMALL * beside:
            most = float(Context(2, ROUND_DOWN).create_decimal(SMALL * beside * 1e3))
            finer = f"{most:g}, or less" if most >= ARCS_M[0] * 1e3 else "none"
            raise SettingError(
                f"the lines and arcs depart by {pieces.error * 1e3:.4g} mm from the curve, which "
                f"the {name} of {beside * 1e3:.4g} mm does not count; at most {SMALL:g} of it is "
                f"allowed: --arcs {finer}"
            )
