"""A label map's slice -> rings with the care that whole pixels need.

A mask knows its border to half a pixel only. The signed distance to the half-tone border, smoothed
by one pixel, crosses 0 where the border was on average: about 0.13 of a pixel off (RMS) on a bone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, InputError
from vfplan.surface.contours import Contours, Structure, choose_structure

Array = NDArray[np.float64]
SMOOTHING_PX = 1.0
PAD = 4
MIN_VOXEL_M = 1e-5
"""Shortest side of a voxel [m]; the finest scans of micro-CT have it."""
MAX_VOXEL_M = 0.1
"""Longest side of a voxel [m]. A longer one is a slip of units."""


@dataclass(frozen=True, eq=False)
class LabelVolume:
    """A label map as its file has it."""

    layers: NDArray  # (L, I, J, K) integers
    place_of: dict[int, tuple[int, int]]
    """Number of a structure -> its layer, and the label that its voxels have there."""
    T_lps_voxel: Array  # (4, 4) maps [i j k 1] to patient LPS [m]
    # As in `Contours`
    structures: tuple[Structure, ...]
    inputs: dict[str, str]

    @property
    def slice_axis(self) -> int:
        """The axis along which the voxels are longest; the last of equal ones."""
        sides = np.linalg.norm(self.T_lps_voxel[:3, :3], axis=0)
        return 2 - int(np.argmax(np.round(sides[::-1] / sides.max(), 6)))


def checked_place(T_lps_voxel: Array, where: str) -> Array:
    """The affine itself; raises `InputError` where it gives voxels no sound place."""
    columns = T_lps_voxel[:3, :3]
    sides = np.linalg.norm(columns, axis=0)
    if not (
        np.isfinite(T_lps_voxel).all() and ((sides >= MIN_VOXEL_M) & (sides <= MAX_VOXEL_M)).all()
    ):
        shown = ", ".join(f"{1e3 * side:.3g}" for side in sides)
        raise InputError(
            f"its voxels have sides of {shown} mm. "
            f"{1e3 * MIN_VOXEL_M:g} to {1e3 * MAX_VOXEL_M:g} mm are "
            "allowed.",
            where=where,
        )
    if abs(np.linalg.det(columns / sides)) < 0.1:
        raise InputError("its voxels' axes are nearly in one plane.", where=where)
    return T_lps_voxel


def rings_of_mask(inside: NDArray) -> tuple[list[Array], bool]:
    """(rings, smoothed): (M, 2) row and column [px] of each border of an (H, W) mask.

    Where smoothing would lose or join parts or holes, that slice keeps its stairs and `smoothed`
    is false.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if not len(rows):
        return [], True
    first = np.array([rows[0], columns[0]])
    part = np.pad(inside[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] != 0, PAD)
    distance = distance_transform_edt(~part) - distance_transform_edt(part)
    distance -= np.where(part, -0.5, 0.5)
    plain = _zero(distance)
    smooth = _zero(gaussian_filter(distance, SMOOTHING_PX))
    keeps_parts = len(smooth) == len(plain)
    borders = plain
    if keeps_parts:
        borders = smooth
    return [ring + first - PAD for ring in borders], keeps_parts


def rings_of_share(share: NDArray) -> list[Array]:
    """(M, 2) row and column [px] of the half-tone borders of an (H, W) share of 0 to 1."""
    if not share.any():
        return []
    padded = np.pad(share.astype(np.float64), 1)
    return [ring - 1 for ring in _zero(0.5 - padded)]


def _zero(values: Array) -> list[Array]:
    """Closed rings of the level 0, joined across corners that touch, without the repeated end."""
    from skimage.measure import find_contours

    return [ring[:-1] for ring in find_contours(values, 0.0) if len(ring) > 3]


def contours_of_volume(volume: LabelVolume, structure: str | None) -> Contours:
    """The outlines of one structure of a label map, slice by slice.

    The slices are those of the axis along which the voxels are longest, the last where all are
    equal.

    Raises InputError: no such structure, or several and none was named
    Raises CurveError: the structure has no voxels
    """
    chosen = choose_structure(volume.structures, structure)
    across = volume.slice_axis
    columns = volume.T_lps_voxel[:3, :3]
    one, other = (a for a in range(3) if a != across)
    normal = np.cross(columns[:, one], columns[:, other])
    layer, label = volume.place_of[chosen.number]
    slices = np.moveaxis(volume.layers[layer], across, 2)
    rings: list[Array] = []
    empty, stairs = [], 0
    for k in range(slices.shape[2]):
        place = volume.T_lps_voxel[:3, 3] + k * columns[:, across]
        borders, is_smooth = rings_of_mask(slices[:, :, k] == label)
        if not is_smooth:
            stairs += 1
        for border in borders:
            rings.append(place + border @ columns[:, (one, other)].T)
        if not borders:
            empty.append(place)
    if not rings:
        raise CurveError(
            f"the structure {chosen.number} has no voxels. Choose another with --structure."
        )
    remarks = ()
    if stairs:
        text = "smoothing would lose or join parts of the structure"
        remarks = (f"{stairs} slices keep their stairs: {text}",)
    return Contours(
        tuple(rings),
        volume.structures,
        chosen.number,
        volume.inputs,
        normal / np.linalg.norm(normal),
        np.array(empty).reshape(-1, 3),
        remarks,
    )
