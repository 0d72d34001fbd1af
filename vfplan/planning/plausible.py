"""What markers in metres, seen in a slice, cannot be: faults that no residual shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError

if TYPE_CHECKING:
    from vfplan.fixture import Fixture
    from vfplan.images.read import PlannedImage
    from vfplan.markers import Correspondences

# RMS distance of a layout's markers from their centre [m]: millimetres read as metres are above,
# metres read as millimetres below.
LEAST_RADIUS_M, LARGEST_RADIUS_M = 5e-4, 10.0
# Marks that must be drawn at the exchanged places before row and column are called exchanged.
LEAST_MARKS = 3


def check_plausible(pairs: Correspondences, curve: Fixture, image: PlannedImage | None) -> None:
    """Refuse markers that no slice and no robot can have.

    A planar fit is exact under any unit and either exchange of axes, so these leave no residual.

    Raises MarkerError: markers spread over more or less than `LARGEST_RADIUS_M` and
        `LEAST_RADIUS_M`, outside the image, or drawn where row and column are exchanged
    """
    _check_size(pairs.target, "target")
    if pairs.source_frame != "image":
        _check_size(pairs.source, "source")
        return
    _check_inside(pairs, curve, image)
    if image is not None and rows_and_columns_exchanged(image.rgb, pairs.source):
        raise MarkerError(
            f"no marker is drawn where the file has {pairs.labels[0]} and the others, but there "
            "are marks with row and column exchanged: u_px is the column, v_px the row"
        )


def _check_size(positions: NDArray[np.float64], what: str) -> None:
    radius = float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).mean()))
    # Markers in one place, but for rounding, are left to the fit, which says so.
    if radius > 1e-9 * np.abs(positions).max() and not LEAST_RADIUS_M <= radius <= LARGEST_RADIUS_M:
        raise MarkerError(
            f"the {what} markers lie {radius:.3g} m (rms) from their centre; {LEAST_RADIUS_M:g} "
            f"to {LARGEST_RADIUS_M:g} m are allowed (millimetres given as metres, or the reverse?)"
        )


def _check_inside(pairs: Correspondences, curve: Fixture, image: PlannedImage | None) -> None:
    size = image or curve.image
    if size is None:
        return
    corner = np.array([size.width_px, size.height_px]) - 0.5
    for label, place in zip(pairs.labels, pairs.source, strict=True):
        if not ((place >= -0.5) & (place <= corner)).all():
            u, v = place
            raise MarkerError(
                f"marker {label} at u = {u:.6g}, v = {v:.6g} px lies outside the slice of "
                f"{size.width_px} x {size.height_px} px (u is the column, v the row)"
            )


def rows_and_columns_exchanged(rgb: NDArray, positions_px: NDArray[np.float64]) -> bool:
    """Whether crosses or dots are drawn at (v, u) of the given (u, v) and nothing at (u, v).

    A slice whose markers are not drawn says nothing.
    """
    from vfplan.markers.finding import anything_drawn, marker_drawn

    if any(anything_drawn(rgb, place) for place in positions_px):
        return False
    turned = sum(marker_drawn(rgb, place) for place in positions_px[:, ::-1])
    return turned >= max(LEAST_MARKS, (len(positions_px) + 1) // 2)
