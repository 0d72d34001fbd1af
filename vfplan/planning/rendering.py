"""How a planned fixture is rendered: radii, band, stiffness, and the axis that is ignored."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.fixture import Rendering
from vfplan.planning.settings import FixtureSettings

if TYPE_CHECKING:
    from vfplan.engine.tolerance import Choice
    from vfplan.registration import Registration

# An ignored axis further than this from the slice's normal would collapse the curve.
MAX_IGNORED_TILT_DEG = 45.0


def rendering_of(
    points: NDArray,
    settings: FixtureSettings,
    registration: Registration,
    choice: Choice | None,
    mesh: NDArray[np.int32] | None,
    slice_axes: NDArray[np.float64] | None,
) -> Rendering:
    """Radii, band, stiffness and ignored axis that the points (N, 3) are rendered with."""
    from vfplan.bundle import mesh_band
    from vfplan.engine.parameters import ProxyParameters

    axis = ignored_axis(settings.ignore_axis, registration, slice_axes)
    band = choice and choice.band_m
    if mesh is not None:
        band = mesh_band(points, mesh, settings.contact_radius + settings.point_radius)
    chosen = ProxyParameters.make(
        points,
        contact_radius=settings.contact_radius,
        band=band,
        point_radius=settings.point_radius,
        stiffness=np.broadcast_to(settings.stiffness, 3),
        ignore_axis=axis,
    )
    return Rendering(
        stiffness=np.array(np.broadcast_to(settings.stiffness, 3), dtype=float),
        contact_radius=settings.contact_radius,
        band=chosen.band,
        point_radius=settings.point_radius,
        ignore_axis=axis,
        max_iterations=choice and choice.max_iterations,
    )


def ignored_axis(
    choice: str | None,
    registration: Registration,
    slice_axes: NDArray[np.float64] | None = None,
) -> NDArray[np.float64] | None:
    """(3,) unit vector along which the fixture is infinite; `None` for a fixture in space.

    A drawn slice is extruded along its plane's normal unless told otherwise, as the paper ignores
    z in Experiment 2; a curve in space is not extruded.

    Raises `SettingError` for an axis that would collapse the slice, or a normal of no slice.
    """
    T = registration.T_target_source
    columns = T[:3, :2] if slice_axes is None else T[:3, :3] @ slice_axes
    planar = slice_axes is not None or registration.source.shape[1] == 2
    choice = choice or ("normal" if planar else "none")
    if choice == "none":
        return None
    if not planar:
        if choice == "normal":
            raise SettingError("a curve in space has no slice normal; ignore x, y, z or none")
        return np.eye(3)["xyz".index(choice)]
    normal = np.cross(columns[:, 0], columns[:, 1])
    normal /= np.linalg.norm(normal)
    if choice == "normal":
        return normal
    axis = np.eye(3)["xyz".index(choice)]
    tilt = np.degrees(np.arccos(min(1.0, abs(axis @ normal))))
    if tilt > MAX_IGNORED_TILT_DEG:
        raise SettingError(
            f"ignoring {choice} would collapse the curve: it is {tilt:.1f} degrees from the "
            f"slice's normal; at most {MAX_IGNORED_TILT_DEG:g} are allowed"
        )
    return axis
