"""Rings in the patient -> stacks of outlines, with every doubt about their places told or refused.

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
from vfplan.surface.contours import Contours
from vfplan.surface.outline import Outline, outline_of
from vfplan.surface.stack import Stack

Array = NDArray[np.float64]
FLAT_M = 5e-5
"""Largest distance of a flat ring from its plane [m]. Tenths of a millimetre round as far."""
SAME_M = 2e-5
"""Largest distance between rings of one slice [m], which is rounding."""
DOUBLED = 0.1
"""Slices nearer than this share of the usual distance are doubled: no series is cut so finely."""
WIDEST = 1.5
"""Widest gap, in usual distances, that is bridged unless a person gives another."""
EVEN = 0.01
"""Slices whose distances differ by less than this share are even."""


@dataclass(frozen=True, eq=False)
class Sliced:
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

    def place(self, z: float) -> str:
        """The name of a slice in messages."""
        return _place(self.R_slice_patient[2], z)


def slice_contours(contours: Contours, max_gap_m: float | None = None) -> Sliced:
    """Sort rings into slices and slices into runs.

    contours: what a reader found
    max_gap_m: the largest distance between slices that is interpolated across [m]; `None`: one and
        a half times the usual one
    Raises CurveError: rings that are not flat, not parallel, cross or repeat each other; slices
        that are doubled, missing, or alone
    """
    normal = _normal(contours)
    axes = _axes(normal)
    local = [ring @ axes.T for ring in contours.rings]
    for number, ring in enumerate(local, start=1):
        off = float(np.abs(ring[:, 2] - ring[:, 2].mean()).max())
        if off > FLAT_M:
            raise CurveError(
                f"outline {number} of {len(local)} lies up to {1e3 * off:.3g} mm off the slices' "
                f"common plane. At most {1e3 * FLAT_M:g} mm is rounding: are all slices parallel?"
            )
    groups = _grouped(local)
    remarks: list[str] = []
    outlines = []
    for z, rings in groups:
        outline, more = outline_of([ring[:, :2] for ring in rings], z, _place(normal, z))
        outlines.append(outline)
        remarks += more
    stacks = _runs(outlines, contours.empty @ normal, normal, max_gap_m)
    sliced = Sliced(axes, stacks, ())
    remarks = _counted(remarks) + _partings(sliced)
    gaps_mm = 1e3 * sliced.gaps_m
    if np.ptp(gaps_mm) > EVEN * np.median(gaps_mm):
        remarks.append(
            f"the slices are {gaps_mm.min():.3g} to {gaps_mm.max():.3g} mm apart: the surface is "
            "interpolated by their true places"
        )
    return Sliced(axes, stacks, tuple(remarks))


def _place(normal: Array, z: float) -> str:
    axis = int(np.abs(normal).argmax())
    if normal[axis] == 1:
        return f"slice at {'xyz'[axis]} = {1e3 * z:.2f} mm"
    along = ", ".join(f"{x:.3f}" for x in normal)
    return f"slice {1e3 * z:.2f} mm along ({along})"


def _normal(contours: Contours) -> Array:
    """(3,) the slices' common normal; an axis of the patient to the last bit where it is one."""
    if contours.normal is not None:
        normal = contours.normal
    else:
        centred = [ring - ring.mean(axis=0) for ring in contours.rings]
        spread = max(float(np.ptp(ring, axis=0).max()) for ring in centred)
        for axis in range(3):
            if all(np.ptp(ring[:, axis]) <= 1e-9 * max(spread, 1e-3) for ring in centred):
                return np.eye(3)[axis]
        extent, vectors = np.linalg.eigh(sum(ring.T @ ring for ring in centred))
        if not extent[1] > 1e-6 * extent[2]:
            raise CurveError("the outlines lie on one line. No plane can be told from them.")
        normal = vectors[:, 0]
    axis = int(np.abs(normal).argmax())
    if abs(abs(normal[axis]) - 1) < 1e-15:
        return np.eye(3)[axis]
    return normal * np.sign(normal[axis])


def _axes(normal: Array) -> Array:
    """(3, 3) two axes of the plane and the normal, right-handed; rows."""
    first = np.eye(3)[int(np.abs(normal).argmin())]
    first = first - first @ normal * normal
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first), normal])


def _grouped(rings: list[Array]) -> list[tuple[float, list[Array]]]:
    """(z, rings) of each slice, in the order of their places."""
    groups: list[tuple[float, list[Array]]] = []
    for ring in sorted(rings, key=lambda ring: float(ring[:, 2].mean())):
        z = float(ring[:, 2].mean())
        if groups and z - groups[-1][0] <= SAME_M:
            groups[-1][1].append(ring)
        else:
            groups.append((z, [ring]))
    return groups


def _runs(
    outlines: list[Outline], empty: Array, normal: Array, max_gap: float | None
) -> tuple[Stack, ...]:
    places = np.array([outline.z for outline in outlines])
    if len(outlines) < 2:
        raise CurveError(f"{len(outlines)} slice shows the structure. Give two at least.")
    gaps = np.diff(places)
    usual = float(np.median(gaps))
    for one, other in pairwise(places):
        if other - one < DOUBLED * usual:
            raise CurveError(
                f"two slices are {1e3 * (other - one):.3g} mm apart, the others "
                f"{1e3 * usual:.3g} mm: {_place(normal, one)} seems doubled."
            )
    widest = max_gap or WIDEST * usual
    runs = [[outlines[0]]]
    for before, after in pairwise(outlines):
        if ((empty > before.z + SAME_M) & (empty < after.z - SAME_M)).any():
            runs.append([after])
            continue
        if after.z - before.z > widest + SAME_M:
            raise CurveError(
                f"slices are missing: {_place(normal, before.z)} and the next, at "
                f"{1e3 * after.z:.2f} mm, are {1e3 * (after.z - before.z):.3g} mm apart, most "
                f"{1e3 * usual:.3g} mm. --max-spacing says what is interpolated across."
            )
        runs[-1].append(after)
    for run in runs:
        if len(run) < 2:
            raise CurveError(
                f"{_place(normal, run[0].z)} shows the structure alone, without a neighbour. Two "
                "at least make a surface."
            )
    return tuple(Stack(tuple(run)) for run in runs)


def _counted(remarks: list[str]) -> list[str]:
    """The first of equal remarks, and how many there are."""
    places_of: dict[str, list[str]] = {}
    for remark in remarks:
        place, _, text = remark.partition(": ")
        places_of.setdefault(text, []).append(place)
    counted = []
    for text, places in places_of.items():
        more = ""
        if len(places) > 1:
            more = f" and {len(places) - 1} more"
        counted.append(f"{places[0]}{more}: {text}")
    return counted


def _partings(sliced: Sliced) -> list[str]:
    """Where parts or holes of the structure fork, join, begin or end between two slices."""
    from shapely import Polygon

    def holes_of(outline: Outline) -> list[Any]:
        holes = []
        for part in outline.parts:
            for interior in part.interiors:
                holes.append(Polygon(interior))
        return holes

    remarks: list[str] = []
    for stack in sliced.stacks:
        for a, b in pairwise(stack.outlines):
            place = f"{sliced.place(a.z)} to {1e3 * b.z:.2f} mm"
            change = _change(list(a.parts), list(b.parts))
            if change:
                remarks.append(f"{place}: a part {change}")
            change = _change(holes_of(a), holes_of(b))
            if change:
                remarks.append(f"{place}: a hole {change}")
    return _counted(remarks)


def _change(one: list[Any], other: list[Any]) -> str:
    """How the pieces of one slice go on in the next: "" where each has its one continuation."""
    meets = np.array([[p.intersects(q) for q in other] for p in one]).reshape(len(one), len(other))
    counts = np.concatenate([meets.sum(axis=0), meets.sum(axis=1)])
    if (counts > 1).any():
        return "forks: the saddle may be off by a fifth of the slices' distance"
    if (counts == 0).any():
        return "begins or ends: the surface is closed there by interpolation"
    return ""
