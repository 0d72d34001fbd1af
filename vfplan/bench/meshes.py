"""Scenes of a triangle mesh: a ball, whose surface bends, and a box, which has edges and corners.

Their exact proxy is known in closed form. Rule "exact" is given the triangles; any other rule is
given the corners of the mesh refined to the spacing.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vfplan.bench.record import Array
from vfplan.scenes import Sphere
from vfplan.scenes.primitives import Rectangles
from vfplan.scenes.solid import Walls

Triangles = NDArray[np.int32]
FACE_CUTS = 25
"""Into how many stretches each edge of an octahedron is cut: 5000 triangles on a ball of 30 mm."""


class BallMesh(Sphere):
    """A ball of 30 mm as triangles of about 2 mm."""

    @cached_property
    def mesh(self) -> tuple[Array, Triangles]:
        """Corners (N, 3) [m], triangles (K, 3): an octahedron's faces, cut and pushed outwards."""
        corners, triangles = cut_octahedron(FACE_CUTS)
        return self.radius * corners / np.linalg.norm(corners, axis=1)[:, None], triangles

    @cached_property
    def points(self) -> Array:
        """The corners of the mesh, refined until no edge is longer than the spacing [m]."""
        return refined_points(self.mesh, self.spacing)


class BoxMesh(Walls):
    """A box of 60 x 40 x 30 mm around the origin as twelve triangles."""

    @property
    def half(self) -> Array:
        """Half its sides [m]."""
        return np.array([0.03, 0.02, 0.015])

    @property
    def squares(self) -> tuple[Array, Array, Array]:
        """The six faces: corners, and the two sides that start there."""
        corners, first, second = [], [], []
        for axis in range(3):
            one, two = (axis + 1) % 3, (axis + 2) % 3
            for sign in (-1.0, 1.0):
                corner = -self.half
                corner[axis] *= -sign
                corners.append(corner)
                first.append(2 * self.half[one] * np.eye(3)[one])
                second.append(2 * self.half[two] * np.eye(3)[two])
        return np.array(corners), np.array(first), np.array(second)

    @cached_property
    def mesh(self) -> tuple[Array, Triangles]:
        """Corners (8, 3) [m] and triangles (12, 3)."""
        signs = np.array(list(product((-1, 1), repeat=3)))
        faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        triangles = []
        for a, b, c, d in faces:
            triangles += [(a, b, c), (a, c, d)]
        return signs * self.half, np.array(triangles, np.int32)

    @cached_property
    def points(self) -> Array:
        """The corners of the mesh, refined until no edge is longer than the spacing [m]."""
        return refined_points(self.mesh, self.spacing)

    @cached_property
    def pieces(self) -> tuple[Rectangles, ...]:
        """The faces."""
        return (Rectangles(*self.squares),)

    @property
    def routes(self) -> dict[str, Array]:
        """Press on the top, slide over an edge and down a side."""
        x, _, z = self.half
        top = z + 0.003
        side = x + 0.003
        path = [
            (0.0, 0.004, z + 0.015),
            (0.0, 0.004, top),
            (side, 0.005, top),
            (side, 0.006, -0.005),
            (x + 0.015, 0.006, -0.005),
        ]
        return {"over an edge": np.array(path)}


def cut_octahedron(cuts: int) -> tuple[Array, Triangles]:
    """Corners (N, 3) and triangles (K, 3) of an octahedron, each face cut into cuts² triangles."""
    places: list[tuple[int, ...]] = []
    triangles: list[tuple[int, int, int]] = []
    for signs in product((-1, 1), repeat=3):
        number = {}
        for i in range(cuts + 1):
            for j in range(cuts + 1 - i):
                number[i, j] = len(places)
                places.append((signs[0] * i, signs[1] * j, signs[2] * (cuts - i - j)))
        for i, j in number:
            if i + j < cuts:
                triangles.append((number[i, j], number[i + 1, j], number[i, j + 1]))
            if i + j < cuts - 1:
                triangles.append((number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]))
    corners, row = np.unique(np.array(places, float), axis=0, return_inverse=True)
    return corners, row.ravel()[np.array(triangles)].astype(np.int32)


def refined_points(mesh: tuple[Array, Triangles], spacing: float) -> Array:
    """(N, 3) points on a mesh, none of its edges longer than `spacing` [m]."""
    from vfplan.bundle.importing import refined

    return refined(*mesh, spacing)[0]
