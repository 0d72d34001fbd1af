"""Rings in the patient -> stacks of outlines, with doubts about their places stated or refused.

All that matters of a series is where its rings lie: flipped, oblique and tilted ones (whose slices
slide along each other) need nothing more than the slices' common normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError
from vfplan.surface.outline import Contours, Outline, Stack, outline_of

Array = NDArray[np.float64]
FLAT_M = 5e-5
"""Largest distance of a flat ring from its plane [m]. Tenths of a millimetre round as far."""
SAME_M = 2e-5
"""Largest distance between two statements of one place [m]. Single precision rounds as far."""
DOUBLED = 0.1
"""Distance between doubled slices, as a share of the usual one. No series is cut so finely."""
WIDEST = 1.5
"""Widest gap, in usual distances, that is bridged unless a person gives another."""


@dataclass(frozen=True, eq=False)
class SlicedVolume:
    """A structure's slices."""

    R_slice_patient: Array
    """(3, 3) rotation into the frame of the stacks: two axes in the slices' planes, the normal."""
    stacks: tuple[Stack, ...]
    """One for each run of slices without an empty one between."""
    remarks: tuple[str, ...]
    """What a person should know."""

    @property
    def gaps_m(self) -> Array:
        """Distances between neighbouring slices of a run [m]."""
        return np.concatenate([np.diff(stack.z) for stack in self.stacks])


def slice_contours(contours: Contours, max_gap_m: float | None = None) -> SlicedVolume:
    """Sort rings into slices and slices into runs.

    Parameters
    ----------
    contours
        What a reader found.
    max_gap_m
        The largest distance between slices that is interpolated across [m]; `None`: one and a
        half times the usual one.

    Raises
    ------
    CurveError
        Rings are not flat, not parallel, cross or repeat each other; or slices are doubled,
        missing, or alone.
    """
    normal = common_normal(contours)
    R_slice_patient = rotation_into_slices(normal)
    rings = [ring @ R_slice_patient.T for ring in contours.rings]
    for number, ring in enumerate(rings, start=1):
        height = ring[:, 2]
        distance = float(np.abs(height - height.mean()).max())
        if distance > FLAT_M:
            raise CurveError(
                f"outline {number} of {len(rings)} lies up to {1e3 * distance:.3g} mm off the "
                f"slices' common plane; {1e3 * FLAT_M:g} mm is rounding. Give parallel slices.",
                code="outline-not-flat",
                numbers={"distance_mm": 1e3 * distance, "distance_max_mm": 1e3 * FLAT_M},
            )
    outlines = []
    with_holes = []
    for z, rings_of_slice in grouped_by_height(rings):
        place = slice_name(normal, z)
        flat_rings = [ring[:, :2] for ring in rings_of_slice]
        outline, holes = outline_of(flat_rings, z, place)
        outlines.append(outline)
        if holes:
            with_holes.append(place)
    stacks = runs_of_slices(outlines, contours.empty @ normal, normal, max_gap_m)

    remarks = []
    if with_holes:
        remarks.append(
            f"{first_of(with_holes)}: an outline inside another is taken for a hole. Remove it if "
            "there is none."
        )
    remarks += branching_remarks(stacks, normal)
    gaps_m = SlicedVolume(R_slice_patient, stacks, ()).gaps_m
    if np.ptp(gaps_m) > SAME_M:
        gaps_mm = 1e3 * gaps_m
        remarks.append(
            f"the slices are {gaps_mm.min():.3g} to {gaps_mm.max():.3g} mm apart. The surface is "
            "interpolated by their true places: check that no slice is missing."
        )
    return SlicedVolume(R_slice_patient, stacks, tuple(remarks))


def slice_name(normal: Array, z: float) -> str:
    """The name of a slice in messages."""
    axis = int(np.abs(normal).argmax())
    if normal[axis] == 1:
        return f"slice at {'xyz'[axis]} = {1e3 * z:.2f} mm"
    along = ", ".join(f"{x:.3f}" for x in normal)
    return f"slice {1e3 * z:.2f} mm along ({along})"


def first_of(places: list[str]) -> str:
    """The first of some places, and how many more there are."""
    return places[0] if len(places) == 1 else f"{places[0]} and {len(places) - 1} more"


def common_normal(contours: Contours) -> Array:
    """(3,) the slices' common normal; an axis of the patient to the last bit where it is one."""
    normal = contours.normal
    if normal is None:
        centred = [ring - ring.mean(axis=0) for ring in contours.rings]
        spreads = np.array([np.ptp(ring, axis=0) for ring in centred])
        flat = spreads.max(axis=0) <= 1e-9 * max(spreads.max(), 1e-3)
        if flat.any():
            return np.eye(3)[int(flat.argmax())]
        scatter = sum(ring.T @ ring for ring in centred)
        extent, vectors = np.linalg.eigh(scatter)
        if not extent[1] > 1e-6 * extent[2]:
            raise CurveError(
                "the outlines lie on one line, so their plane is not known. Redraw them.",
                code="outline-empty",
            )
        normal = vectors[:, 0]
    axis = int(np.abs(normal).argmax())
    return np.eye(3)[axis] if abs(abs(normal[axis]) - 1) < 1e-15 else normal * np.sign(normal[axis])


def rotation_into_slices(normal: Array) -> Array:
    """(3, 3) rows: two axes of the plane and the normal, right-handed."""
    first = np.eye(3)[int(np.abs(normal).argmin())]
    first = first - first @ normal * normal
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first), normal])


def grouped_by_height(rings: list[Array]) -> list[tuple[float, list[Array]]]:
    """(z, rings) of each slice, in the order of their places."""
    groups: list[tuple[float, list[Array]]] = []
    for ring in sorted(rings, key=lambda ring: float(ring[:, 2].mean())):
        z = float(ring[:, 2].mean())
        if groups and z - groups[-1][0] <= SAME_M:
            groups[-1][1].append(ring)
        else:
            groups.append((z, [ring]))
    return groups


def runs_of_slices(
    outlines: list[Outline], empty: Array, normal: Array, max_gap_m: float | None
) -> tuple[Stack, ...]:
    """Stacks of slices that follow each other without an empty one between.

    empty: (E,) places along the normal of slices that show nothing of the structure [m]
    """
    if len(outlines) < 2:
        raise CurveError(
            f"{len(outlines)} slice shows the structure. Give two at least.",
            code="slices-too-few",
            numbers={"slices": len(outlines), "slices_min": 2},
        )
    usual = float(np.median(np.diff([outline.z for outline in outlines])))
    for before, after in pairwise(outlines):
        gap = after.z - before.z
        if gap < DOUBLED * usual:
            raise CurveError(
                f"{slice_name(normal, before.z)} seems doubled: another is {1e3 * gap:.3g} mm "
                f"apart, the others {1e3 * usual:.3g} mm. Remove one of the two.",
                code="slices-doubled",
                numbers={"gap_mm": 1e3 * gap, "usual_mm": 1e3 * usual},
            )
    widest = max_gap_m or WIDEST * usual
    runs = [[outlines[0]]]
    for before, after in pairwise(outlines):
        gap = after.z - before.z
        if ((empty > before.z + SAME_M) & (empty < after.z - SAME_M)).any():
            runs.append([after])
            continue
        if gap > widest + SAME_M:
            raise CurveError(
                f"slices are missing: {slice_name(normal, before.z)} and the next, at "
                f"{1e3 * after.z:.2f} mm, are {1e3 * gap:.3g} mm apart, most {1e3 * usual:.3g} mm. "
                "Add them, or give a larger --max-spacing to interpolate across.",
                code="slices-missing",
                numbers={"gap_mm": 1e3 * gap, "usual_mm": 1e3 * usual},
            )
        runs[-1].append(after)
    stacks = []
    for run in runs:
        if len(run) < 2:
            raise CurveError(
                f"{slice_name(normal, run[0].z)} shows the structure alone, without a neighbour. "
                "Outline it on the next slice too, or remove it.",
                code="slice-alone",
            )
        stacks.append(Stack(tuple(run)))
    return tuple(stacks)


def branching_remarks(stacks: tuple[Stack, ...], normal: Array) -> list[str]:
    """Where parts or holes of the structure fork, join, begin or end between two slices."""
    places_of: dict[str, list[str]] = {}
    for stack in stacks:
        for before, after in pairwise(stack.outlines):
            place = f"{slice_name(normal, before.z)} to {1e3 * after.z:.2f} mm"
            for name, pieces, next_pieces in (
                ("part", list(before.parts), list(after.parts)),
                ("hole", holes_of(before), holes_of(after)),
            ):
                remark = branching(name, pieces, next_pieces)
                if remark:
                    places_of.setdefault(remark, []).append(place)
    return [f"{first_of(places)}: {remark}" for remark, places in places_of.items()]


def holes_of(outline: Outline) -> list[Any]:
    """The holes of an outline's parts, as polygons."""
    from shapely import Polygon

    holes = []
    for part in outline.parts:
        for interior in part.interiors:
            holes.append(Polygon(interior))
    return holes


def branching(name: str, pieces: list[Any], next_pieces: list[Any]) -> str:
    """How the pieces of one slice go on in the next: "" where each has its one continuation."""
    meets = np.zeros((len(pieces), len(next_pieces)), dtype=int)
    for row, piece in enumerate(pieces):
        for column, next_piece in enumerate(next_pieces):
            meets[row, column] = piece.intersects(next_piece)
    counts = np.concatenate([meets.sum(axis=0), meets.sum(axis=1)])
    if (counts > 1).any():
        return (
            f"a {name} forks, and the saddle may be off by a fifth of the slices' distance. Add a "
            "slice there if it matters."
        )
    if (counts == 0).any():
        return (
            f"a {name} begins or ends, and the surface is closed there by interpolation. Check the "
            "outlines of both slices."
        )
    return ""
