"""The carried curve as lines and arcs, in the plane across the fixture's ignored axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.fixture import Fixture, Pieces
from vfplan.planning.settings import DEFAULT_ARCS_M, FixtureSettings

if TYPE_CHECKING:
    from vfplan.registration import Registration

Vector = NDArray[np.float64]
SMALL = 0.05  # of a margin or gate: what lines and arcs may depart beside it


def pieces_of(
    curve: Fixture, registration: Registration, axis: Vector | None, settings: FixtureSettings
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

    Raises
    ------
    SettingError
        Lines and arcs are asked for, and there can be none.
    """
    from vfplan.curve.arcs import fit_arcs, measure, places, plane

    if settings.points_only:
        return None
    if axis is None or curve.curve is None:
        if settings.arcs_m is None:
            return None
        raise SettingError("lines and arcs: only of drawn strokes, across an ignored axis")
    frame, tolerance = plane(axis), settings.arcs_m or DEFAULT_ARCS_M
    carried = registration.apply(curve.points)
    flat, height = carried @ frame.T, float((carried @ axis).mean())
    vertices, bulges, counts, error = [], [], [], 0.0
    for number, closed in enumerate(curve.curve.closed):
        stroke = flat[curve.curve.stroke == number], bool(closed), tolerance
        arcs = fit_arcs(*stroke)
        error = max(error, measure(arcs, places(*stroke)))
        vertices.append(arcs.vertices @ frame + height * axis)
        bulges.append(arcs.bulges)
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
    counted = ("margin", largest_m), ("--max-tre", settings.max_tre_m), ("guide", settings.guide_m)
    for name, beside in counted:
        if beside and pieces.error > SMALL * beside:
            raise SettingError(
                f"the lines and arcs depart by {pieces.error * 1e3:.4g} mm from the curve, which "
                f"the {name} of {beside * 1e3:.4g} mm does not count; at most {SMALL:g} of it is "
                f"allowed: --arcs {SMALL * beside * 1e3:.2g}, or less"
            )
