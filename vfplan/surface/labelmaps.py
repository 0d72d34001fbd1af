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
"""Standard deviation of the smoothing [px], as the stairs of a mask are a pixel long."""
PAD_PX = round(4 * SMOOTHING_PX)
"""Empty pixels around a mask: as far as the smoothing reaches (SciPy cuts at 4 deviations)."""
MIN_VOXEL_M = 1e-5
"""Shortest side of a voxel [m]. The finest scans of micro-CT have it."""
MAX_VOXEL_M = 0.1
"""Longest side of a voxel [m]. A longer one is a slip of units."""
MIN_VOXEL_VOLUME = 0.1
"""Smallest volume of a voxel over that of a box with its sides. It is 0.87 where a gantry leans by
30 degrees."""


@dataclass(frozen=True, eq=False)
class LabelVolume:
    """A label map as its file has it."""

    layers: NDArray
    """(L, I, J, K) integers."""
    place_of: dict[int, tuple[int, int]]
    """Number of a structure -> its layer, and the label that its voxels have there."""
    T_lps_voxel: Array
    """(4, 4) maps [i j k 1] to patient LPS [m]."""
    structures: tuple[Structure, ...]
    """As in `Contours`."""
    inputs: dict[str, str]
    """As in `Contours`."""

    @property
    def slice_axis(self) -> int:
        """The axis along which the voxels are longest; the last of equal ones."""
        sides = np.linalg.norm(self.T_lps_voxel[:3, :3], axis=0)
        return 2 - int(np.argmax(np.round(sides[::-1] / sides.max(), 6)))


def checked_place(T_lps_voxel: Array, where: str) -> Array:
    """The affine itself; raises `InputError` where it gives voxels no sound place."""
    columns = T_lps_voxel[:3, :3]
    sides = np.linalg.norm(columns, axis=0)
    are_sound = ((sides >= MIN_VOXEL_M) & (sides <= MAX_VOXEL_M)).all()
    if not (np.isfinite(T_lps_voxel).all() and are_sound):
        listed = ", ".join(f"{1e3 * side:.3g}" for side in sides)
        raise InputError(
            f"its voxels have sides of {listed} mm; {1e3 * MIN_VOXEL_M:g} to "
            f"{1e3 * MAX_VOXEL_M:g} mm are allowed. Check the unit of the file.",
            where=where,
            code="voxel-size",
        )
    if abs(np.linalg.det(columns / sides)) < MIN_VOXEL_VOLUME:
        raise InputError(
            "its voxels' axes are nearly in one plane. Export the label map again.",
            where=where,
            code="voxel-axes",
        )
    return T_lps_voxel


def rings_of_mask(inside: NDArray) -> tuple[list[Array], bool]:
    """(rings, smoothed): (M, 2) row and column [px] of each border of an (H, W) mask.

    Where smoothing would lose or join parts or holes, that slice keeps its stairs and `smoothed`
    is false.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    rows = np.flatnonzero(inside.any(axis=1))
    columns = np.flatnonzero(inside.any(axis=0))
    if not len(rows):
        return [], True
    cut_out = inside[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    mask = np.pad(cut_out != 0, PAD_PX)
    distance = distance_transform_edt(~mask) - distance_transform_edt(mask)
    distance -= np.where(mask, -0.5, 0.5)
    borders = zero_rings(distance)
    smooth_borders = zero_rings(gaussian_filter(distance, SMOOTHING_PX))
    keeps_parts = len(smooth_borders) == len(borders)
    if keeps_parts:
        borders = smooth_borders
    first = np.array([rows[0], columns[0]])
    return [ring + first - PAD_PX for ring in borders], keeps_parts


def rings_of_share(share: NDArray) -> list[Array]:
    """(M, 2) row and column [px] of the half-tone borders of an (H, W) share of 0 to 1."""
    if not share.any():
        return []
    padded = np.pad(share.astype(np.float64), 1)
    return [ring - 1 for ring in zero_rings(0.5 - padded)]


def zero_rings(values: Array) -> list[Array]:
    """Closed rings of the level 0, joined across corners that touch, without the repeated end."""
    from skimage.measure import find_contours

    return [ring[:-1] for ring in find_contours(values, 0.0) if len(ring) > 3]


def stairs_remark(slice_count: int) -> tuple[str, ...]:
    """What a person should know where slices could not be smoothed."""
    if slice_count == 0:
        return ()
    return (
        f"{slice_count} slices keep their stairs, because smoothing would lose or join parts of "
        "the structure. Look at thin parts in the label map.",
    )


def contours_of_volume(volume: LabelVolume, structure: str | None) -> Contours:
    """The outlines of one structure of a label map, slice by slice.

    The slices are those of the axis along which the voxels are longest, the last where all are
    equal.

    Raises
    ------
    InputError
        There is no such structure, or there are several and none was named.
    CurveError
        The structure has no voxels.
    """
    chosen = choose_structure(volume.structures, structure)
    across = volume.slice_axis
    steps = volume.T_lps_voxel[:3, :3]
    first, second = (axis for axis in range(3) if axis != across)
    normal = np.cross(steps[:, first], steps[:, second])
    layer, label = volume.place_of[chosen.number]
    slices = np.moveaxis(volume.layers[layer], across, 2)
    rings: list[Array] = []
    empty = []
    slices_with_stairs = 0
    for k in range(slices.shape[2]):
        corner = volume.T_lps_voxel[:3, 3] + k * steps[:, across]
        borders, is_smooth = rings_of_mask(slices[:, :, k] == label)
        if not is_smooth:
            slices_with_stairs += 1
        for border in borders:
            rings.append(corner + border @ steps[:, (first, second)].T)
        if not borders:
            empty.append(corner)
    if not rings:
        raise CurveError(
            f"structure {chosen.number} has no voxels. Choose another with --structure.",
            code="structure-empty",
            numbers={"structure": chosen.number},
        )
    return Contours(
        tuple(rings),
        volume.structures,
        chosen.number,
        volume.inputs,
        normal=normal / np.linalg.norm(normal),
        empty=np.array(empty).reshape(-1, 3),
        remarks=stairs_remark(slices_with_stairs),
    )
