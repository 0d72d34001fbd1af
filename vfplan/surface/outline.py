"""The outlines of one slice: rings -> polygons with holes -> signed distance, exact.

A ring inside another is a hole, as DICOM's exclusive or has it (PS3.3 C.8.8.6.3), and so is what a
keyhole's channel leads to. Rings that cross are refused: which side is inside they do not say.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError

if TYPE_CHECKING:
    from shapely import Polygon

Array = NDArray[np.float64]
CHANNEL_M = 1e-4  # a keyhole's channel is narrower; no tool draws bone as thin as this
CHANNEL_TURNS = 20.0  # along the ring its two sides are at least so many widths apart
STRAY_SHARE = 1e-3  # of a ring's area: what little loops at its ends may enclose
MANY = 1 << 12  # points of one look that are worth a thread
EDGE_M = 2.5e-4  # longer edges are cut, so that the nearest corner finds the nearest edge


@dataclass(frozen=True, eq=False)
class Outline:
    """What a slice shows of a structure."""

    z: float  # place of the slice along the normal [m]
    parts: tuple[Polygon, ...]  # polygons with holes, in the slice's plane [m], that do not overlap

    def signed(self, xy: Array) -> tuple[Array, Array]:
        """Signed distance (M,) [m] of points (M, 2), below 0 inside, and its gradient (M, 2).

        The distance is the exact one to the nearest of the edges that meet in the two nearest
        corners; its sign is the side of that edge, or in a corner of both (J. A. Baerentzen and
        H. Aanaes, "Signed distance computation using the angle weighted pseudonormal", IEEE TVCG
        11, 2005).
        """
        start, along, normal, corner, tree, before, after = self._edges
        place = _complex(xy)
        near = tree.query(xy, k=2, workers=-1 if len(xy) > MANY else 1)[1]
        edges = np.concatenate([near, before[near]], axis=1)
        away, way = place[:, None] - start[edges], along[edges]
        t = np.clip((away * way.conj()).real / (way.real**2 + way.imag**2), 0.0, 1.0)
        away -= t * way
        square = away.real**2 + away.imag**2
        best = np.arange(len(xy)), square.argmin(axis=1)
        away, t, edge = away[best], t[best], edges[best]
        side = np.where(
            (t > 0) & (t < 1), normal[edge], corner[np.where(t <= 0, edge, after[edge])]
        )
        signed = np.sqrt(square[best])
        far = signed > 1e-12
        signed[(away * side.conj()).real < 0] *= -1
        gradient = np.where(far, away / np.where(far, signed, 1.0), normal[edge])
        return signed, gradient.view(np.float64).reshape(-1, 2)

    @cached_property
    def rings(self) -> tuple[Array, ...]:
        """(M, 2) corners of each ring: outer ones anticlockwise, holes clockwise."""
        from shapely import orient_polygons

        found = []
        for part in orient_polygons(list(self.parts)):
            found += [np.array(r.coords)[:-1, :2] for r in (part.exterior, *part.interiors)]
        return tuple(found)

    @property
    def outer_rings(self) -> tuple[Array, ...]:
        """Those that are no holes."""
        return tuple(ring for ring in self.rings if area(ring) > 0)

    @cached_property
    def cut_rings(self) -> tuple[Array, ...]:
        """The same with corners at most `EDGE_M` apart."""
        return tuple(map(_cut, self.rings))

    @cached_property
    def _edges(self) -> tuple[Any, ...]:
        """Start, way and outward normal of each edge and the normal of the corner it starts in, as
        complex numbers; a k-d tree of these corners; the edges before and after each."""
        from scipy.spatial import cKDTree

        cut = self.cut_rings
        start = np.concatenate(cut)
        end = np.concatenate([np.roll(ring, -1, axis=0) for ring in cut])
        first = np.cumsum([0] + [len(ring) for ring in cut[:-1]])
        before = np.arange(len(start)) - 1
        before[first] = first + [len(ring) - 1 for ring in cut]
        along = _complex(end - start)
        normal = -1j * along / np.abs(along)
        after = np.empty_like(before)
        after[before] = np.arange(len(before))
        corner = normal + normal[before]
        return _complex(start), along, normal, corner, cKDTree(start), before, after


def _complex(xy: Array) -> NDArray[np.complex128]:
    """(M,) x + iy of points (M, 2)."""
    return np.ascontiguousarray(xy).view(np.complex128)[:, 0]


def _cut(ring: Array) -> Array:
    """The ring with corners at most `EDGE_M` apart."""
    along = np.roll(ring, -1, axis=0) - ring
    pieces = np.maximum(1, np.ceil(np.linalg.norm(along, axis=1) / EDGE_M)).astype(int)
    index = np.repeat(np.arange(len(ring)), pieces)
    part = (np.arange(len(index)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[index]
    return ring[index] + part[:, None] * along[index]


def outline_of(rings: list[Array], z: float, where: str) -> tuple[Outline, list[str]]:
    """The polygons that closed rings (M, 2) [m] of one slice bound, and what a person should know.

    Raises CurveError: a ring without area, one that crosses itself or another, or one that is there
        twice
    """
    from shapely import Polygon

    remarks: list[str] = []
    pieces = []
    for ring in rings:
        pieces.append(_polygon(ring, where))
    parts: list[Any] = []
    for piece in sorted(pieces, key=lambda p: -p.area):
        outer = next((i for i, part in enumerate(parts) if _overlap(part, piece, where)), None)
        if outer is None:
            parts.append(piece)
            continue
        hole = parts.pop(outer).difference(piece)
        parts += [hole] if isinstance(hole, Polygon) else list(hole.geoms)
        remarks.append(f"{where}: an outline inside another is taken for a hole")
    return Outline(z, tuple(parts)), remarks


def _polygon(ring: Array, where: str) -> Any:
    """One ring as a polygon; a keyhole's channel becomes a hole."""
    from shapely import Polygon, is_valid_reason, make_valid
    from shapely.geometry import MultiPolygon

    ring = ring[np.any(ring != np.roll(ring, 1, axis=0), axis=1)]
    if len(ring) < 3:
        raise CurveError(f"{where}: an outline has {len(ring)} corners. Draw at least 3.")
    ring = _without_channel(ring)
    polygon = Polygon(ring)
    signed = abs(area(ring))
    if not signed > 0:
        raise CurveError(f"{where}: an outline encloses nothing. Remove or redraw it.")
    if polygon.is_valid:
        return polygon
    found = make_valid(polygon, method="linework")
    parts = [p for p in getattr(found, "geoms", [found]) if p.geom_type.endswith("Polygon")]
    parts = [q for p in parts for q in (p.geoms if isinstance(p, MultiPolygon) else [p])]
    largest = max(parts, key=lambda p: p.area)
    # Pieces that the outline runs round the wrong way, or apart from the rest, are crossings.
    if abs(largest.area - signed) > STRAY_SHARE * signed:
        place = is_valid_reason(polygon).partition("[")[2].rstrip("]").split()
        at = ", ".join(f"{1e3 * float(x):.1f}" for x in place[:2])
        raise CurveError(f"{where}: an outline crosses itself at ({at}) mm. Redraw it.")
    return largest


def area(ring: Array) -> float:
    """Signed area [m²] of a ring (M, 2), above 0 where it runs anticlockwise."""
    x, y = (ring - ring.mean(axis=0)).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _without_channel(ring: Array) -> Array:
    """The ring with both sides of a keyhole's channel laid on each other."""
    from scipy.spatial import cKDTree

    steps = np.linalg.norm(np.diff(ring, axis=0, append=ring[:1]), axis=1)
    at, length = np.cumsum(steps), steps.sum()
    pairs = cKDTree(ring).query_pairs(CHANNEL_M, output_type="ndarray")
    apart = np.abs(at[pairs[:, 0]] - at[pairs[:, 1]])
    pairs = pairs[np.minimum(apart, length - apart) > CHANNEL_TURNS * CHANNEL_M]
    ring = ring.copy()
    for i, j in pairs:
        ring[max(i, j)] = ring[min(i, j)]
    return ring[np.any(ring != np.roll(ring, 1, axis=0), axis=1)]


def _overlap(part: Any, piece: Any, where: str) -> bool:
    """Whether a piece lies inside a part; refuses what crosses its border or is there twice."""
    if not part.intersects(piece):
        return False
    common = part.intersection(piece).area
    if abs(part.area - common) + abs(piece.area - common) < 1e-9 * part.area:
        raise CurveError(f"{where}: the same outline is there twice. Remove one.")
    if common > (1 - STRAY_SHARE) * piece.area:
        return True
    if common > STRAY_SHARE * piece.area:
        x, y = part.boundary.intersection(piece.boundary).centroid.coords[0]
        raise CurveError(
            f"{where}: two outlines cross near ({1e3 * x:.1f}, {1e3 * y:.1f}) mm. Redraw one."
        )
    return False
