"""How far a surface is from the outlines it was made of, and how far it may be between them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.registration.nearest import NearestOnMesh
from vfplan.surface.slicing import Sliced
from vfplan.surface.stack import Stack

Array = NDArray[np.float64]
MOST_POINTS = 10_000  # of the outlines that are held against the surface
A_SLICE = 200


def contour_error(sliced: Sliced, points: Array, triangles: NDArray[np.int32]) -> dict[str, Any]:
    """Distance of the outlines to the mesh: RMS and largest [mm], and where."""
    corners = [
        np.c_[ring, np.full(len(ring), outline.z)]
        for stack in sliced.stacks
        for outline in stack.outlines
        for ring in outline.cut_rings
    ]
    places = np.concatenate(corners)
    places = places[:: max(1, len(places) // MOST_POINTS)] @ sliced.R_slice_patient
    nearest, _ = NearestOnMesh(points, triangles)(places)
    away = np.linalg.norm(places - nearest, axis=1)
    return _summary(away, places)


def left_out_error(sliced: Sliced) -> dict[str, Any] | None:
    """How far each inner slice's outlines are from the surface through all others [mm].

    With the slices twice as far apart this is more than what the surface is off between slices,
    about 16 times where it is smooth, and finds a slice that lies or is drawn wrong. `None` where a
    run has fewer than four slices.
    """
    away, places = [], []
    for stack in sliced.stacks:
        for k in range(1, len(stack.outlines) - 1) if len(stack.outlines) > 3 else ():
            rest = Stack(stack.outlines[max(0, k - 2) : k] + stack.outlines[k + 1 : k + 3])
            corners = np.concatenate(stack.outlines[k].cut_rings)
            corners = corners[:: max(1, len(corners) // A_SLICE)]
            at = np.c_[corners, np.full(len(corners), stack.outlines[k].z)]
            value, gradient = rest.signed(at)
            away.append(np.abs(value) / np.maximum(np.linalg.norm(gradient, axis=1), 0.1))
            places.append(at @ sliced.R_slice_patient)
    return _summary(np.concatenate(away), np.concatenate(places)) if away else None


def _summary(away: Array, places: Array) -> dict[str, Any]:
    worst = int(away.argmax())
    return {
        "rms": 1e3 * float(np.sqrt((away**2).mean())),
        "max": 1e3 * float(away[worst]),
        "place_m": places[worst],
    }
