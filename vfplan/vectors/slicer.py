"""Curves that were drawn in 3D Slicer: a `.mrk.json`, or a table of control points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vfplan.errors import CurveError
from vfplan.markers.slicer import fcsv_points, lps_points, markups_of
from vfplan.vectors.curve import VectorDrawing, distinct_points, without_repeated_end

SPLINE_WARNING_M = 1e-4
"""Largest distance [m] of a spline from straight lines without a warning, where a file names
neither."""
SLICER_CURVES = {"Curve": False, "ClosedCurve": True}
"""Slicer's names of curves, and whether they are closed."""


def read_markups(text: str, where: str) -> VectorDrawing:
    """The one curve of a Slicer `.mrk.json`."""
    markups = markups_of(text, where)
    curves = []
    types = []
    for markup in markups:
        types.append(repr(markup.get("type")))
        if markup.get("type") in SLICER_CURVES:
            curves.append(markup)
    if len(curves) != 1:
        listed = ", ".join(types) or "nothing"
        raise CurveError(
            f"holds {listed}. Give one Curve or ClosedCurve",
            where=where,
            code="vector-several",
            numbers={"curves": len(curves)},
        )
    closed = SLICER_CURVES[curves[0]["type"]]
    return VectorDrawing(
        distinct_points(lps_points(curves[0], where), closed, where), closed, True, ""
    )


def read_control_points(text: str, where: str) -> VectorDrawing:
    """A Slicer `.fcsv`, which says no more of its points than their order."""
    control_points = np.array([xyz for _, xyz in fcsv_points(text, where)]).reshape(-1, 3)
    points, closed = without_repeated_end(control_points)
    curve = VectorDrawing(distinct_points(points, closed, where), closed, True, "")
    distance = curve.distance_from_straight()
    if distance <= SPLINE_WARNING_M:
        return curve
    warning = (
        f"{where}: does not say how its points are joined. A spline was laid through them, up to "
        f"{distance * 1e3:.1f} mm from straight lines. Save a .mrk.json Curve to say what is meant"
    )
    return replace(curve, warnings=(warning,))
