"""The outlines of one slice: rings -> polygons with holes -> signed distance, exact.

A ring inside another is a hole, as DICOM's exclusive or has it (PS3.3 C.8.8.6.3), and so is what a
keyhole's channel leads to. Rings that cross are refused: which side is inside they do not say.

What every reader gives: closed rings in the patient, each flat, and which slices hold none.

Outlines on slices -> one function in space: cubic between the slices' signed distances.

Between two slices runs the cubic with both values and, as slopes, those of the parabolas through
each and its neighbours; beyond the first and the last slice the outline stays as it is there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, InputError, requires_extra
from vfplan.vectors.curve import FINE_M

if TYPE_CHECKING:
    from scipy.spatial import cKDTree
    from shapely import Polygon


Array = NDArray[np.float64]
Indices = NDArray[np.intp]
CHANNEL_M = 1e-4
"""Largest width of a keyhole's channel [m]. No tool draws bone as thin."""
MIN_CHANNEL_LENGTH = 20.0
"""Smallest way along the ring from one side of a channel to the other, in widths of a channel."""
STRAY_SHARE = 1e-3
"""Largest share of a ring's area that little loops at its ends may enclose."""


class Edges(NamedTuple):
    """The edges of all rings of an outline. Places and directions are complex numbers, x + iy."""

    start: NDArray[np.complex128]
    """(E,) the corner that each edge starts in [m]."""
    along: NDArray[np.complex128]
    """(E,) the way from there to its end [m]."""
    normal: NDArray[np.complex128]
    """(E,) the unit normal of each edge, outwards."""
    corner_normal: NDArray[np.complex128]
    """(E,) the sum of the normals of both edges that meet in its start."""
    before: Indices
    """(E,) the edge before each in its ring."""
    after: Indices
    """(E,) the edge after each in its ring."""
    corners: cKDTree
    """The starts, as a k-d tree."""


@dataclass(frozen=True, eq=False)
class Outline:
    """What a slice shows of a structure."""

    z: float
    """Place of the slice along the normal [m]."""
    parts: tuple[Polygon, ...]
    """Polygons with holes, in the slice's plane [m], that do not overlap."""

    def signed(self, xy: Array) -> tuple[Array, Array]:
        """Signed distance (M,) [m] of points (M, 2), below 0 inside, and its gradient (M, 2).

        The distance is the exact one to the nearest of the edges that meet in the two nearest
        corners; its sign is the side of that edge, or in a corner of both (J. A. Baerentzen and
        H. Aanaes, "Signed distance computation using the angle weighted pseudonormal", IEEE TVCG
        11, 2005).
        """
        edges = self.edges
        # The edges that begin or end in the two nearest corners.
        _, corners = edges.corners.query(xy, k=2, workers=-1)
        candidates = np.concatenate([corners, edges.before[corners]], axis=1)

        # The place on each candidate, as a share t of the edge, that is nearest to the point.
        along = edges.along[candidates]
        offset = to_complex(xy)[:, None] - edges.start[candidates]
        t = np.clip((offset * along.conj()).real / (along.real**2 + along.imag**2), 0.0, 1.0)
        offset -= t * along
        square = offset.real**2 + offset.imag**2
        nearest = np.arange(len(xy)), square.argmin(axis=1)
        offset = offset[nearest]
        t = t[nearest]
        edge = candidates[nearest]
        distance = np.sqrt(square[nearest])

        at_corner = edges.corner_normal[np.where(t <= 0, edge, edges.after[edge])]
        normal = np.where((t > 0) & (t < 1), edges.normal[edge], at_corner)
        has_distance = distance > 1e-12
        distance[(offset * normal.conj()).real < 0] *= -1
        # Divided by the signed distance the gradient points outwards on both sides.
        gradient = np.where(
            has_distance, offset / np.where(has_distance, distance, 1.0), edges.normal[edge]
        )
        return distance, gradient.view(np.float64).reshape(-1, 2)

    @cached_property
    def rings(self) -> tuple[Array, ...]:
        """(M, 2) corners of each ring: outer ones anticlockwise, holes clockwise."""
        from shapely import orient_polygons

        rings = []
        for part in orient_polygons(list(self.parts)):
            for ring in (part.exterior, *part.interiors):
                rings.append(np.array(ring.coords)[:-1, :2])
        return tuple(rings)

    @property
    def outer_rings(self) -> tuple[Array, ...]:
        """Those that are no holes."""
        return tuple(ring for ring in self.rings if area(ring) > 0)

    @cached_property
    def cut_rings(self) -> tuple[Array, ...]:
        """The same with corners at most `FINE_M` apart."""
        return tuple(map(with_short_edges, self.rings))

    @cached_property
    def edges(self) -> Edges:
        """The edges of all rings, ready to be searched."""
        from scipy.spatial import cKDTree

        ends = []
        before = []
        count = 0
        for ring in self.cut_rings:
            ends.append(np.roll(ring, -1, axis=0))
            before.append(np.roll(np.arange(count, count + len(ring)), 1))
            count += len(ring)
        start = np.concatenate(self.cut_rings)
        before = np.concatenate(before)
        after = np.empty_like(before)
        after[before] = np.arange(count)
        along = to_complex(np.concatenate(ends) - start)
        normal = -1j * along / np.abs(along)
        corner_normal = normal + normal[before]
        return Edges(to_complex(start), along, normal, corner_normal, before, after, cKDTree(start))


def to_complex(xy: Array) -> NDArray[np.complex128]:
    """(M,) points of the plane (M, 2) as complex numbers."""
    return np.ascontiguousarray(xy, dtype=np.float64).view(np.complex128)[:, 0]


def with_short_edges(ring: Array) -> Array:
    """The ring with corners at most `FINE_M` apart, so that the nearest one finds the edge."""
    along = np.roll(ring, -1, axis=0) - ring
    pieces = np.maximum(1, np.ceil(np.linalg.norm(along, axis=1) / FINE_M)).astype(int)
    edge = np.repeat(np.arange(len(ring)), pieces)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return ring[edge] + (number / pieces[edge])[:, None] * along[edge]


def outline_of(rings: list[Array], z: float, where: str) -> tuple[Outline, int]:
    """The polygons that closed rings (M, 2) [m] of one slice bound.

    Also how many rings lie inside another and are taken for holes. Raises `CurveError` for a ring
    without area, one that crosses itself or another, or one that is there twice, and `MissingExtra`
    where shapely is not installed.
    """
    with requires_extra("making a surface of outlines needs shapely", "surface"):
        from shapely import Polygon

    polygons = [polygon_of(ring, where) for ring in rings]
    polygons.sort(key=lambda polygon: -polygon.area)
    parts: list[Any] = []
    holes = 0
    for polygon in polygons:
        outer = None
        for index, part in enumerate(parts):
            if is_inside(polygon, part, where):
                outer = index
                break  # Parts do not overlap, so no other one can hold the polygon.
        if outer is None:
            parts.append(polygon)
            continue
        remainder = parts.pop(outer).difference(polygon)
        if isinstance(remainder, Polygon):
            parts.append(remainder)
        else:
            parts.extend(remainder.geoms)
        holes += 1
    return Outline(z, tuple(parts)), holes


def polygon_of(ring: Array, where: str) -> Polygon:
    """One ring as a polygon; a keyhole's channel becomes a hole.

    Raises `CurveError` as `outline_of` does.
    """
    from shapely import Polygon, get_parts, is_valid_reason, make_valid

    ring = without_repeated_corners(ring)
    if len(ring) < 3:
        raise CurveError(
            f"an outline has {len(ring)} corners. Draw at least 3.",
            where=where,
            code="outline-empty",
            numbers={"corners": len(ring)},
        )
    ring = with_closed_channel(ring)
    polygon = Polygon(ring)
    ring_area = abs(area(ring))
    if not ring_area > 0:
        raise CurveError(
            "an outline encloses nothing. Remove or redraw it.", where=where, code="outline-empty"
        )
    if polygon.is_valid:
        return polygon

    pieces = []
    for part in get_parts(make_valid(polygon, method="linework")):
        for piece in get_parts(part):
            if piece.geom_type == "Polygon":
                pieces.append(piece)
    largest = max(pieces, key=lambda piece: piece.area)
    # Pieces that the outline runs round the wrong way, or apart from the rest, are crossings.
    if abs(largest.area - ring_area) > STRAY_SHARE * ring_area:
        # The reason reads "Self-intersection[X Y]".
        place = is_valid_reason(polygon).partition("[")[2].rstrip("]").split()
        x, y = (1e3 * float(text) for text in place[:2])
        raise CurveError(
            f"an outline crosses itself at ({x:.1f}, {y:.1f}) mm. Redraw it.",
            where=where,
            code="outline-crosses",
            numbers={"x_mm": x, "y_mm": y},
        )
    return largest


def area(ring: Array) -> float:
    """Signed area [m²] of a ring (M, 2), above 0 where it runs anticlockwise."""
    x, y = (ring - ring.mean(axis=0)).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def without_repeated_corners(ring: Array) -> Array:
    """The ring without corners that repeat the one before."""
    return ring[np.any(ring != np.roll(ring, 1, axis=0), axis=1)]


def with_closed_channel(ring: Array) -> Array:
    """The ring with both sides of a keyhole's channel laid on each other."""
    from scipy.spatial import cKDTree

    edge_lengths = np.linalg.norm(np.diff(ring, axis=0, append=ring[:1]), axis=1)
    # Place of each corner along the ring, counted from the second one; only differences count.
    position = np.cumsum(edge_lengths)
    pairs = cKDTree(ring).query_pairs(CHANNEL_M, output_type="ndarray")
    along = np.abs(position[pairs[:, 0]] - position[pairs[:, 1]])
    along = np.minimum(along, edge_lengths.sum() - along)
    ring = ring.copy()
    for first, second in np.sort(pairs[along > MIN_CHANNEL_LENGTH * CHANNEL_M], axis=1):
        ring[second] = ring[first]
    return without_repeated_corners(ring)


def is_inside(piece: Polygon, part: Polygon, where: str) -> bool:
    """Whether a piece lies inside a part; refuses what crosses its border or is there twice."""
    if not part.intersects(piece):
        return False
    common = part.intersection(piece).area
    if abs(part.area - common) + abs(piece.area - common) < 1e-9 * part.area:
        raise CurveError(
            "the same outline is there twice. Remove one.", where=where, code="outline-doubled"
        )
    if common > (1 - STRAY_SHARE) * piece.area:
        return True
    if common > STRAY_SHARE * piece.area:
        x, y = part.boundary.intersection(piece.boundary).centroid.coords[0]
        raise CurveError(
            f"two outlines cross near ({1e3 * x:.1f}, {1e3 * y:.1f}) mm. Redraw one.",
            where=where,
            code="outlines-cross",
            numbers={"x_mm": 1e3 * x, "y_mm": 1e3 * y},
        )
    return False


@dataclass(frozen=True)
class Structure:
    """One of the structures that a source holds."""

    number: int
    """As the source numbers it."""
    name: str = ""
    """As the source names it; empty where it does not."""


@dataclass(frozen=True, eq=False)
class Contours:
    """One structure as a stack of outlines."""

    rings: tuple[Array, ...]
    """Each (M, 3), patient LPS [m], its last corner joined to its first."""
    structures: tuple[Structure, ...]
    """All structures of the source."""
    chosen: int
    """The number of this one."""
    inputs: dict[str, str]
    """Role -> SHA-256 of the source's bytes."""
    normal: Array | None = None
    """(3,) unit normal of the slices where the source states it; `None`: what the rings give."""
    empty: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(E, 3) a point of each slice that is known to show nothing of the structure."""
    remarks: tuple[str, ...] = ()
    """What a person should know."""


def choose_structure(structures: tuple[Structure, ...], wanted: str | None) -> Structure:
    """The structure of this name or number; without one the only structure.

    Raises `InputError` where there is none, or several and `wanted` is `None` or fits not one.
    """
    if not structures:
        raise InputError(
            "holds no structure. Give a file in which one is outlined.", code="structure-none"
        )
    names = []
    for structure in structures:
        if structure.name:
            names.append(f"{structure.number} {structure.name!r}")
        else:
            names.append(str(structure.number))
    listed = ", ".join(names)
    if wanted is None:
        if len(structures) > 1:
            raise InputError(
                f"holds {len(structures)} structures: {listed}. Choose one with --structure.",
                code="structure-several",
                numbers={"structures": len(structures)},
            )
        return structures[0]

    # A name counts before a number.
    matches = [structure for structure in structures if structure.name == wanted]
    if not matches:
        for structure in structures:
            if str(structure.number) == wanted:
                matches.append(structure)
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise InputError(
            f"holds several structures of that name. Choose one by its number: {listed}.",
            code="structure-several",
            numbers={"structures": len(matches)},
        )
    raise InputError(
        f"holds no structure of that name or number. Choose one of {listed}.",
        code="structure-unknown",
        numbers={"structures": len(structures)},
    )


@dataclass(frozen=True, eq=False)
class Stack:
    """Two or more outlines in the order of their places; x and y in their planes, z across [m]."""

    outlines: tuple[Outline, ...]

    @property
    def z(self) -> Array:
        """(S,) places of the slices [m]."""
        return np.array([outline.z for outline in self.outlines])

    def weights(self, z: Array) -> tuple[NDArray[np.intp], Array, Array]:
        """Which four slices (M, 4) make up the value at z (M,), with weights and their slopes."""
        places = self.z
        count = len(places)
        inside = np.clip(z, places[0], places[-1])
        first = np.clip(np.searchsorted(places, inside, "right") - 1, 0, count - 2)
        gap = places[first + 1] - places[first]
        t = (inside - places[first]) / gap
        four = first[:, None] + np.arange(-1, 3)
        slopes = slope_weights(places)

        def combine(basis: tuple[Array, Array, Array, Array]) -> Array:
            """Weights of the four slices, from those of both values and both slopes."""
            value_first, slope_first, value_last, slope_last = basis
            weights = np.zeros((len(z), 4))
            weights[:, 1] = value_first
            weights[:, 2] = value_last
            for column in range(4):
                for share, at in ((slope_first, first), (slope_last, first + 1)):
                    step = four[:, column] - at
                    is_close = np.abs(step) <= 2
                    weights[is_close, column] += (share * gap)[is_close] * slopes[
                        at[is_close], step[is_close] + 2
                    ]
            return weights

        # Hermite's cubics and their derivatives: value and slope at the first, then at the last.
        cubics = (
            (1 + 2 * t) * (1 - t) ** 2,
            t * (1 - t) ** 2,
            t**2 * (3 - 2 * t),
            t**2 * (t - 1),
        )
        derivatives = (6 * t**2 - 6 * t, 3 * t**2 - 4 * t + 1, 6 * t - 6 * t**2, 3 * t**2 - 2 * t)
        weights = combine(cubics)
        weight_slopes = combine(derivatives) / gap[:, None]
        weight_slopes[(z < places[0]) | (z > places[-1])] = 0.0
        return np.clip(four, 0, count - 1), weights, weight_slopes

    def signed(self, points: Array) -> tuple[Array, Array]:
        """The function (M,) [m] at points (M, 3), below 0 inside, and its gradient (M, 3)."""
        which, weights, weight_slopes = self.weights(points[:, 2])
        value = np.zeros(len(points))
        gradient = np.zeros((len(points), 3))
        rows, columns = np.nonzero((weights != 0) | (weight_slopes != 0))
        slices = which[rows, columns]
        order = np.argsort(slices, kind="stable")
        first = np.searchsorted(slices[order], np.arange(len(self.outlines) + 1))
        for k in np.flatnonzero(np.diff(first)):
            of_slice = order[first[k] : first[k + 1]]
            row = rows[of_slice]
            column = columns[of_slice]
            distance, direction = self.outlines[k].signed(points[row, :2])
            # A slice stands once in a row: beyond the ends all weights are 0.
            value[row] += weights[row, column] * distance
            gradient[row, :2] += weights[row, column, None] * direction
            gradient[row, 2] += weight_slopes[row, column] * distance
        return value, gradient


def slope_weights(z: Array) -> Array:
    """(S, 5) weights of the values two slices before to two after in the slope at each [1/m].

    Of the parabola through a slice and its neighbours; at the ends of the one through the last
    three slices; of two slices the straight line.
    """
    count = len(z)
    weights = np.zeros((count, 5))
    if count == 2:
        slope = 1.0 / (z[1] - z[0])
        weights[0, 2:4] = -slope, slope
        weights[1, 1:3] = -slope, slope
        return weights
    for at in range(count):
        three = np.clip(at - 1, 0, count - 3) + np.arange(3)
        for one in three:
            others = z[three[three != one]]
            weights[at, one - at + 2] = (2 * z[at] - others.sum()) / np.prod(z[one] - others)
    return weights
