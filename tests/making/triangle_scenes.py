"""A triangle mesh as a scene: a bone's surface, with the exact proxy of its triangles.

The part of the surface around the HIP's path is taken. Which triangles can matter in a tick is
looked up (those within 3 R of proxy and HIP); on them the proxy is the exact one of the scenes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from vfplan.bench.record import Array
from vfplan.errors import InputError
from vfplan.geometry.lines import row_lengths
from vfplan.scenes import Scene
from vfplan.scenes.outline import Look, Pieces, from_nearest, nearest_on_sides

R = 5e-3
PRESS_M, SLIDE_M, OFF_M = 2e-3, 25e-3, 15e-3
PATCH_M = 35e-3  # of the surface, around the path


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles with corners (M, 3, 3) [m]."""

    corners: Array

    def look(self, x: Array) -> Look:
        """See `Pieces.look`."""
        nearest, flat = nearest_on(self.corners, x)
        return from_nearest(x, nearest, flat)


def nearest_on(corners: Array, x: Array) -> tuple[Array, Array]:
    """(M, 3) nearest points of triangles to x, and (M, 2, 3) directions along which they are flat.

    Inside a face both of its directions are flat, on an edge the edge, at a corner none.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ends = [(a, b), (b, c), (c, a)]
    on_edges = [nearest_on_sides(start, (end - start,), x) for start, end in ends]
    places, along = (np.array(part) for part in zip(*on_edges, strict=True))
    edge = ((x - places) ** 2).sum(axis=2).argmin(axis=0)
    rows = np.arange(len(a))
    nearest, flat = places[edge, rows], np.stack([along[edge, rows, 0], 0 * a], axis=1)
    normal = np.cross(b - a, c - a)
    normal /= row_lengths(normal)[:, None]
    foot = x - ((x - a) * normal).sum(axis=1)[:, None] * normal
    sides = [(np.cross(e - s, foot - s) * normal).sum(axis=1) for s, e in ends]
    over = (np.array(sides) > 0).all(axis=0)
    u = (b - a) / row_lengths(b - a)[:, None]
    nearest[over] = foot[over]
    flat[over, 0], flat[over, 1] = u[over], np.cross(normal, u)[over]
    return nearest, flat


class Bone(Scene):
    """A closed surface read from a mesh file."""

    source: Path = field(default=Path(), kw_only=True)  # PLY or STL, in millimetres

    @cached_property
    def _whole(self) -> tuple[Array, Array]:
        from vfplan.bundle.importing import import_cloud

        fixture = import_cloud(self.source, units="mm", spacing=1.0)
        if fixture.mesh is None:
            raise InputError("holds no triangles", where=self.source.name)
        return fixture.points, fixture.mesh

    @cached_property
    def _mesh(self) -> tuple[Array, Array]:
        """The triangles around the path."""
        points, triangles = self._whole
        way = self.routes["press and slide"]
        middle = points[triangles].mean(axis=1)
        t = np.clip((middle - way[1]) @ (way[2] - way[1]) / ((way[2] - way[1]) ** 2).sum(), 0, 1)
        away = row_lengths(middle - way[1] - t[:, None] * (way[2] - way[1]))
        return points, triangles[away < PATCH_M]

    @cached_property
    def corners(self) -> Array:
        """(M, 3, 3) [m], without triangles of no area."""
        points, triangles = self._mesh
        corners = points[triangles]
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return corners[row_lengths(sides) > 1e-14]

    @cached_property
    def points(self) -> Array:
        """(N, 3) corners of the mesh, refined until no edge is longer than the spacing [m]."""
        from vfplan.bundle.importing import refined

        return refined(*self._mesh, self.spacing)[0]

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """All triangles."""
        return (Triangles(self.corners),)

    @property
    def routes(self) -> dict[str, Array]:
        """Down on the middle of its longest side, along it 2 mm behind the surface, and off."""
        low, high = self._whole[0].min(axis=0), self._whole[0].max(axis=0)
        axis = int((high - low).argmax())
        out = np.eye(3)[(axis + 1) % 3]
        along = np.eye(3)[axis]
        start = self._top((low + high) / 2, out, axis)
        end = self._top((low + high) / 2 + SLIDE_M * along, out, axis)
        press = (R - PRESS_M) * out
        way = [start + OFF_M * out, start + press, end + press, end + OFF_M * out]
        return {"press and slide": np.array(way)}

    def _top(self, centre: Array, out: Array, axis: int) -> Array:
        """The mesh's point furthest out in a slice of 5 mm across its long axis."""
        points = self._whole[0]
        ring = points[np.abs(points[:, axis] - centre[axis]) < 5e-3]
        return ring[(ring @ out).argmax()]

    def pieces_between(self, proxy: Array, hip: Array, radius: float) -> tuple[Pieces, ...]:
        """See `Scene.near`: those within 3 R of anywhere the proxy may go, and the nearest one."""
        away = row_lengths(self._centres - hip)
        reach = max(3 * radius + np.linalg.norm(hip - proxy), away.min())
        return (Triangles(self.corners[away - self._sizes <= reach]),)

    @cached_property
    def _centres(self) -> Array:
        return self.corners.mean(axis=1)

    @cached_property
    def _sizes(self) -> Array:
        return np.linalg.norm(self.corners - self._centres[:, None], axis=2).max(axis=1)
