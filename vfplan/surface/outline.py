"""Rings in the patient -> outlines of slices -> runs of slices, each one function in space.

All that matters of a series is where its rings lie: flipped, oblique and tilted ones (whose slices
slide along each other) need nothing more than the slices' common normal.

A ring inside another is a hole, as DICOM's exclusive or has it (PS3.3 C.8.8.6.3), and so is what a
keyhole's channel leads to. Rings that cross are refused: which side is inside they do not say.

Between two slices runs the cubic of both signed distances and, as slopes, those of the parabolas
through each and its neighbours. Beyond the first and the last slice the outline stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, InputError, requires_extra
from vfplan.geometry.lines import Array, plane, row_lengths
from vfplan.io.files import naming_place
from vfplan.vectors.curve import FINE_M

if TYPE_CHECKING:
    from shapely import Polygon


# Largest width of a keyhole's channel [m]. No tool draws bone as thin.
CHANNEL_M = 1e-4
# Smallest way along the ring from one side of a channel to the other, in widths of a channel.
MIN_CHANNEL_LENGTH = 20.0
# Largest distance of a flat ring from its plane [m]. Tenths of a millimetre round as far.
FLAT_M = 5e-5
# Largest distance between two statements of one place [m]. Single precision rounds as far.
SAME_M = 2e-5
# Distance between doubled slices, as a share of the usual one. No series is cut so finely.
DOUBLED = 0.1
# Widest gap, in usual distances, that is bridged unless a person gives another.
WIDEST = 1.5
# Largest share of a ring's area that little loops at its ends may enclose.
STRAY_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Outline:
    """What a slice shows of a structure."""

    # Place of the slice along the normal [m].
    z: float
    # Polygons with holes, in the slice's plane [m], that do not overlap.
    parts: tuple[Polygon, ...]

    def signed(self, xy: Array) -> tuple[Array, Array]:
        """Signed distance (M,) [m] of points (M, 2), below 0 inside, and its gradient (M, 2).

        The distance is the exact one to the nearest of the edges that meet in the two nearest
        corners; its sign is the side of that edge, or in a corner of both (J. A. Baerentzen and
        H. Aanaes, "Signed distance computation using the angle weighted pseudonormal", IEEE TVCG
        11, 2005).
        """
        start, along, normal, corner_normal, before, after, corners = self.edges
        # The edges that begin or end in the two nearest corners.
        _, nearest_corners = corners.query(xy, k=2, workers=-1)
        candidates = np.concatenate([nearest_corners, before[nearest_corners]], axis=1)

        # The place on each candidate, as a share t of the edge, that is nearest to the point.
        way = along[candidates]
        offset = to_complex(xy)[:, None] - start[candidates]
        t = np.clip((offset * way.conj()).real / (way.real**2 + way.imag**2), 0.0, 1.0)
        offset -= t * way
        square = offset.real**2 + offset.imag**2
        nearest = np.arange(len(xy)), square.argmin(axis=1)
        offset, t, edge = offset[nearest], t[nearest], candidates[nearest]
        distance = np.sqrt(square[nearest])

        at_corner = corner_normal[np.where(t <= 0, edge, after[edge])]
        outwards = np.where((t > 0) & (t < 1), normal[edge], at_corner)
        is_apart = distance > 1e-12
        distance[(offset * outwards.conj()).real < 0] *= -1
        # Divided by the signed distance the gradient points outwards on both sides.
        gradient = np.where(is_apart, offset / np.where(is_apart, distance, 1), normal[edge])
        return distance, gradient.view(np.float64).reshape(-1, 2)

    @cached_property
    def rings(self) -> tuple[Array, ...]:
        """(M, 2) corners of each ring: outer ones anticlockwise, holes clockwise."""
        return rings_of(self.parts)

    @cached_property
    def cut_rings(self) -> tuple[Array, ...]:
        """The same with corners at most `FINE_M` apart, so that the nearest one finds the edge."""
        from shapely import segmentize

        return rings_of(segmentize(self.parts, FINE_M))

    @cached_property
    def edges(self) -> tuple[Any, ...]:
        """The edges of all rings, ready to be searched; places and ways are complex, x + iy.

        (E,) each: the corner [m] that an edge starts in, the way to its end, its unit normal
        outwards, the sum of the normals of both edges that meet in its start, and the edges before
        and after it in its ring; and a k-d tree of the starts.
        """
        from scipy.spatial import cKDTree

        start = np.concatenate(self.cut_rings)
        numbers = np.split(np.arange(len(start)), np.cumsum([len(r) for r in self.cut_rings])[:-1])
        before = np.concatenate([np.roll(ring, 1) for ring in numbers])
        after = np.concatenate([np.roll(ring, -1) for ring in numbers])
        along = to_complex(start[after] - start)
        normal = -1j * along / np.abs(along)
        tree = cKDTree(start)
        return to_complex(start), along, normal, normal + normal[before], before, after, tree


def rings_of(parts: Any) -> tuple[Array, ...]:
    """(M, 2) corners of each ring of some polygons: outer ones anticlockwise, holes clockwise."""
    from shapely import orient_polygons

    parts = orient_polygons(list(parts))
    rings = [ring for part in parts for ring in (part.exterior, *part.interiors)]
    return tuple(np.array(ring.coords)[:-1, :2] for ring in rings)


def to_complex(xy: Array) -> NDArray[np.complex128]:
    """(M,) points of the plane (M, 2) as complex numbers."""
    return np.ascontiguousarray(xy, float).view(np.complex128)[:, 0]


def outline_of(rings: list[Array], z: float) -> tuple[Outline, int]:
    """The polygons that closed rings (M, 2) [m] of one slice bound.

    Also how many rings lie inside another and are taken for holes. Raises `CurveError` for a ring
    without area, one that crosses itself or another, or one that is there twice, and `MissingExtra`
    where shapely is not installed.
    """
    with requires_extra("making a surface of outlines needs shapely", "surface"):
        from shapely import get_parts

    polygons = sorted(map(polygon_of, rings), key=lambda polygon: -polygon.area)
    parts: list[Any] = []
    holes = 0
    for polygon in polygons:
        for part in parts:
            if is_inside(polygon, part):
                parts.remove(part)
                parts += get_parts(part.difference(polygon)).tolist()
                holes += 1
                break  # Parts do not overlap, so no other one can hold the polygon.
        else:
            parts.append(polygon)
    return Outline(z, tuple(parts)), holes


def polygon_of(ring: Array) -> Polygon:
    """One ring as a polygon; a keyhole's channel becomes a hole.

    Raises `CurveError` as `outline_of` does.
    """
    from shapely import Polygon, get_parts, is_valid_reason, make_valid

    ring = with_closed_channel(without_repeated_corners(ring))
    polygon = Polygon(ring) if len(ring) > 2 else Polygon()
    # Of a ring that crosses itself this is the area that it runs round more often to the left.
    ring_area = polygon.area
    if not ring_area > 0:
        text = "an outline encloses nothing. Remove or redraw it."
        raise CurveError(text, code="outline-empty")
    if polygon.is_valid:
        return polygon

    pieces = get_parts(get_parts(make_valid(polygon, method="linework")))
    pieces = [piece for piece in pieces if piece.geom_type == "Polygon"]
    largest = max(pieces, key=lambda piece: piece.area)
    # Pieces that the outline runs round the wrong way, or apart from the rest, are crossings.
    if abs(largest.area - ring_area) > STRAY_SHARE * ring_area:
        # The reason reads "Self-intersection[X Y]".
        place = is_valid_reason(polygon).partition("[")[2].rstrip("]").split()
        x, y = (1e3 * float(text) for text in place[:2])
        raise CurveError(
            f"an outline crosses itself at ({x:z.1f}, {y:z.1f}) mm. Redraw it.",
            code="outline-crosses", numbers={"x_mm": x, "y_mm": y},
        )  # fmt: skip
    return largest


def without_repeated_corners(ring: Array) -> Array:
    """The ring without corners that repeat the one before."""
    return ring[np.any(ring != np.roll(ring, 1, axis=0), axis=1)]


def with_closed_channel(ring: Array) -> Array:
    """The ring with both sides of a keyhole's channel laid on each other."""
    from scipy.spatial import cKDTree

    edge_lengths = row_lengths(np.diff(ring, axis=0, append=ring[:1]))
    # Place of each corner along the ring, counted from the second one; only differences count.
    position = np.cumsum(edge_lengths)
    pairs = cKDTree(ring).query_pairs(CHANNEL_M, output_type="ndarray")
    along = np.abs(position[pairs[:, 0]] - position[pairs[:, 1]])
    along = np.minimum(along, edge_lengths.sum() - along)
    ring = ring.copy()
    for first, second in np.sort(pairs[along > MIN_CHANNEL_LENGTH * CHANNEL_M], axis=1):
        ring[second] = ring[first]
    return without_repeated_corners(ring)


def is_inside(piece: Polygon, part: Polygon) -> bool:
    """Whether a piece lies inside a part; refuses what crosses its border or is there twice."""
    if not part.intersects(piece):
        return False
    common = part.intersection(piece).area
    if abs(part.area - common) + abs(piece.area - common) < 1e-9 * part.area:
        raise CurveError("the same outline is there twice. Remove one.", code="outline-doubled")
    if common > (1 - STRAY_SHARE) * piece.area:
        return True
    if common > STRAY_SHARE * piece.area:
        x, y = part.boundary.intersection(piece.boundary).centroid.coords[0]
        raise CurveError(
            f"two outlines cross near ({1e3 * x:z.1f}, {1e3 * y:z.1f}) mm. Redraw one.",
            code="outlines-cross", numbers={"x_mm": 1e3 * x, "y_mm": 1e3 * y},
        )  # fmt: skip
    return False


@dataclass(frozen=True)
class Structure:
    """One of the structures that a source holds."""

    # As the source numbers it.
    number: int
    # As the source names it; empty where it does not.
    name: str = ""


@dataclass(frozen=True, eq=False)
class Contours:
    """One structure as a stack of outlines."""

    # Each (M, 3), patient LPS [m], its last corner joined to its first.
    rings: tuple[Array, ...]
    # All structures of the source.
    structures: tuple[Structure, ...]
    # The number of this one.
    chosen: int
    # Role -> SHA-256 of the source's bytes.
    inputs: dict[str, str]
    # (3,) unit normal of the slices where the source states it; `None`: what the rings give.
    normal: Array | None = None
    # (E, 3) a point of each slice that is known to show nothing of the structure.
    empty: Array = field(default_factory=lambda: np.empty((0, 3)))
    # What a person should know.
    remarks: tuple[str, ...] = ()
    # How far Slicer's two types of curve differ [m], where neither was chosen.
    type_difference_m: float = 0.0


def choose_structure(structures: tuple[Structure, ...], wanted: str | None) -> Structure:
    """The structure of this name or number; without one the only structure.

    Raises `InputError` where there is none, or several and `wanted` is `None` or fits not one.
    """
    if not structures:
        raise InputError(
            "holds no structure. Give a file in which one is outlined.", code="structure-none"
        )
    # A name counts before a number.
    matches = [structure for structure in structures if wanted in (None, structure.name)]
    matches = matches or [structure for structure in structures if str(structure.number) == wanted]
    if len(matches) == 1:
        return matches[0]
    several = matches or structures
    names = (f"{one.number} {one.name!r}" if one.name else str(one.number) for one in several)
    listed = ", ".join(names)
    numbers = {"structures": len(several)}
    if not matches:
        text = f"holds no structure of that name or number. Choose one of {listed}."
        raise InputError(text, code="structure-unknown", numbers=numbers)
    text = f"holds {len(several)} structures that fit: {listed}. Choose one with --structure."
    raise InputError(text, code="structure-several", numbers=numbers)


@dataclass(frozen=True, eq=False)
class Stack:
    """Two or more outlines in the order of their places; x and y in their planes, z across [m]."""

    outlines: tuple[Outline, ...]

    @property
    def z(self) -> Array:
        """(S,) places of the slices [m]."""
        return np.array([outline.z for outline in self.outlines])

    @cached_property
    def bases(self) -> list[Any]:
        """For each slice, what it adds to the value at any height: a piecewise cubic in z.

        Its slope at each slice is that of the parabola through the slice and its neighbours, or of
        the one through the last three slices; of two slices it is the straight line.
        """
        from scipy.interpolate import CubicHermiteSpline

        ones, order = np.eye(len(self.outlines)), min(2, len(self.outlines) - 1)
        slopes = np.gradient(ones, self.z, axis=0, edge_order=order)
        return [CubicHermiteSpline(self.z, *rows) for rows in zip(ones, slopes.T, strict=True)]

    def signed(self, points: Array) -> tuple[Array, Array]:
        """The function (M,) [m] at points (M, 3), below 0 inside, and its gradient (M, 3)."""
        places = self.z
        heights = np.clip(points[:, 2], places[0], places[-1])
        is_beyond = heights != points[:, 2]
        upwards = np.argsort(heights, kind="stable")
        value = np.zeros(len(points))
        gradient = np.zeros((len(points), 3))
        for k, outline in enumerate(self.outlines):
            # A slice counts as far as the second one from it.
            ends = places[max(0, k - 2)], places[min(k + 2, len(places) - 1)]
            first, last = (
                np.searchsorted(heights, end, side, sorter=upwards)
                for end, side in zip(ends, ("left", "right"), strict=True)
            )
            rows = upwards[first:last]
            weight = self.bases[k](heights[rows])
            slope = np.where(is_beyond[rows], 0.0, self.bases[k](heights[rows], 1))
            counts = (weight != 0) | (slope != 0)
            rows, weight, slope = rows[counts], weight[counts], slope[counts]
            distance, direction = outline.signed(points[rows, :2])
            value[rows] += weight * distance
            gradient[rows, :2] += weight[:, None] * direction
            gradient[rows, 2] += slope * distance
        return value, gradient


@dataclass(frozen=True, eq=False)
class SlicedVolume:
    """A structure's slices."""

    # (3, 3) rotation into the frame of the stacks: two axes in the slices' planes, the normal.
    R_slice_patient: Array
    # One for each run of slices without an empty one between.
    stacks: tuple[Stack, ...]
    # What a person should know.
    remarks: tuple[str, ...]

    @property
    def outlines(self) -> list[Outline]:
        """Those of all runs, in their order."""
        return [outline for stack in self.stacks for outline in stack.outlines]

    @property
    def gaps_m(self) -> Array:
        """Distances between neighbouring slices of a run [m]."""
        return np.concatenate([np.diff(stack.z) for stack in self.stacks])


def slice_contours(contours: Contours, max_gap_m: float | None) -> SlicedVolume:
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
    R_slice_patient = np.vstack([plane(normal), normal])
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
    groups: list[tuple[float, list[Array]]] = []
    for ring in sorted(rings, key=lambda ring: float(ring[:, 2].mean())):
        z = float(ring[:, 2].mean())
        if groups and z - groups[-1][0] <= SAME_M:
            groups[-1][1].append(ring)
        else:
            groups.append((z, [ring]))
    for z, rings_of_slice in groups:
        place = slice_name(normal, z)
        with naming_place(place):
            outline, holes = outline_of([ring[:, :2] for ring in rings_of_slice], z)
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
    gaps_mm = 1e3 * SlicedVolume(R_slice_patient, stacks, ()).gaps_m
    if np.ptp(gaps_mm) > 1e3 * SAME_M:
        remarks.append(
            f"the slices are {gaps_mm.min():.3g} to {gaps_mm.max():.3g} mm apart. The surface is "
            "interpolated by their true places: check that no slice is missing."
        )
    return SlicedVolume(R_slice_patient, stacks, tuple(remarks))


def slice_name(normal: Array, z: float) -> str:
    """The name of a slice in messages."""
    axis = int(np.abs(normal).argmax())
    if normal[axis] == 1:
        return f"slice at {'xyz'[axis]} = {1e3 * z:z.2f} mm"
    along = ", ".join(f"{x:z.3f}" for x in normal)
    return f"slice {1e3 * z:z.2f} mm along ({along})"


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
        normal = np.linalg.eigh(sum(ring.T @ ring for ring in centred))[1][:, 0]
    axis = int(np.abs(normal).argmax())
    if abs(abs(normal[axis]) - 1) < 1e-15:
        return np.eye(3)[axis]
    return normal * np.sign(normal[axis])


def runs_of_slices(
    outlines: list[Outline], empty: Array, normal: Array, max_gap_m: float | None
) -> tuple[Stack, ...]:
    """Stacks of slices that follow each other without an empty one between.

    empty: (E,) places along the normal of slices that show nothing of the structure [m]
    """
    if len(outlines) < 2:
        raise CurveError(
            f"{len(outlines)} slice shows the structure. Give two at least.",
            code="slices-too-few", numbers={"slices": len(outlines), "slices_min": 2},
        )  # fmt: skip
    usual = float(np.median(np.diff([outline.z for outline in outlines])))
    widest = max_gap_m or WIDEST * usual
    runs = [[outlines[0]]]
    for before, after in pairwise(outlines):
        gap = after.z - before.z
        numbers = {"gap_mm": 1e3 * gap, "usual_mm": 1e3 * usual}
        if gap < DOUBLED * usual:
            raise CurveError(
                f"{slice_name(normal, before.z)} seems doubled: another is {1e3 * gap:.3g} mm "
                f"apart, the others {1e3 * usual:.3g} mm. Remove one of the two.",
                code="slices-doubled", numbers=numbers,
            )  # fmt: skip
        if ((empty > before.z + SAME_M) & (empty < after.z - SAME_M)).any():
            runs.append([after])
            continue
        if gap > widest + SAME_M:
            raise CurveError(
                f"slices are missing: {slice_name(normal, before.z)} and the next, at "
                f"{1e3 * after.z:z.2f} mm, are {1e3 * gap:.3g} mm apart, most {1e3 * usual:.3g} "
                "mm. Add them, or give a larger --max-spacing to interpolate across.",
                code="slices-missing", numbers=numbers,
            )  # fmt: skip
        runs[-1].append(after)
    for run in runs:
        if len(run) < 2:
            raise CurveError(
                f"{slice_name(normal, run[0].z)} shows the structure alone, without a neighbour. "
                "Outline it on the next slice too, or remove it.",
                code="slice-alone",
            )
    return tuple(Stack(tuple(run)) for run in runs)


# What a person should know where parts or holes of two slices do not correspond one by one.
FORKS = (
    "a {} forks, and the saddle may be off by a fifth of the slices' distance. Add a slice there "
    "if it matters."
)
ENDS = (
    "a {} begins or ends, and the surface is closed there by interpolation. Check the outlines of "
    "both slices."
)


def branching_remarks(stacks: tuple[Stack, ...], normal: Array) -> list[str]:
    """Where parts or holes of the structure fork, join, begin or end between two slices."""
    from shapely import intersects

    places_of: dict[str, list[str]] = {}
    for stack in stacks:
        for before, after in pairwise(stack.outlines):
            place = f"{slice_name(normal, before.z)} to {1e3 * after.z:z.2f} mm"
            for name, pieces_of in (("part", lambda outline: outline.parts), ("hole", holes_of)):
                pieces, following = (np.array(pieces_of(o), object) for o in (before, after))
                meets = intersects(pieces[:, None], following[None])
                counts = np.concatenate([meets.sum(axis=0), meets.sum(axis=1)])
                if (counts > 1).any():
                    places_of.setdefault(FORKS.format(name), []).append(place)
                elif (counts == 0).any():
                    places_of.setdefault(ENDS.format(name), []).append(place)
    return [f"{first_of(places)}: {remark}" for remark, places in places_of.items()]


def holes_of(outline: Outline) -> list[Any]:
    """The holes of an outline's parts, as polygons."""
    from shapely import Polygon

    return [Polygon(interior) for part in outline.parts for interior in part.interiors]
