"""Scenes in space: point, segment, the sheet of Experiment 1, double sheet, sphere, three walls."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import ClassVar

import numpy as np

from vfplan.engine.parameters import Vector
from vfplan.scenes.base import Scene, corners_mm
from vfplan.scenes.primitives import Pieces, Rectangles, Segments, Spheres


class Point(Scene):
    """The paper's 0-D simulation: one point at the origin."""

    @cached_property
    def points(self) -> Vector:
        """(1, 3) [m]."""
        return np.zeros((1, 3))

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """The point."""
        return (Segments(np.zeros((1, 3)), np.zeros((1, 3))),)

    @property
    def routes(self) -> dict[str, Vector]:
        """From left to right just above it, and a press from above."""
        return {
            "across": corners_mm((-20, 1), (20, 1)),
            "press": corners_mm((0.5, 12, 0.3), (0.5, 2, 0.3), (0.5, 12, 0.3)),
        }


class Segment(Scene):
    """The paper's 1-D simulation: a segment along x, in space.

    Parameters
    ----------
    length
        [m].
    """

    length: float = 0.04

    @cached_property
    def points(self) -> Vector:
        """(N, 3) [m], both ends included."""
        x = np.linspace(-0.5, 0.5, max(1, round(self.length / self.spacing)) + 1) * self.length
        return np.column_stack([x, 0 * x, 0 * x])

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """The segment."""
        half = np.array([[self.length / 2, 0, 0]])
        return (Segments(-half, half),)

    @property
    def routes(self) -> dict[str, Vector]:
        """Along it 2 mm above its axis, and a press from each side."""
        end = self.length * 500 + 15
        return {
            "along": corners_mm((-end, 2, 1), (end, 2, 1)),
            "above": corners_mm((3, 12, 0.4), (3, 2, 0.4), (8, 2, 0.4), (8, 12, 0.4)),
            "below": corners_mm((3, -12, 0.4), (3, -2, 0.4), (8, -2, 0.4), (8, -12, 0.4)),
        }


def grid(corner: Vector, u: Vector, v: Vector, spacing: float) -> Vector:
    """Points on the rectangle at `corner` with sides u and v (3,) [m], edges included."""
    nu = max(1, round(float(np.linalg.norm(u)) / spacing))
    nv = max(1, round(float(np.linalg.norm(v)) / spacing))
    i, j = np.meshgrid(np.arange(nu + 1) / nu, np.arange(nv + 1) / nv, indexing="ij")
    return corner + i.reshape(-1, 1) * u + j.reshape(-1, 1) * v


class Walls(Scene):
    """A scene of rectangles, with a grid of points on each."""

    @property
    @abstractmethod
    def squares(self) -> tuple[Vector, Vector, Vector]:
        """Corners and the sides u and v from them, each (M, 3) [m]."""

    @cached_property
    def points(self) -> Vector:
        """(N, 3) [m], edges included."""
        grids = []
        for corner, u, v in zip(*self.squares, strict=True):
            grids.append(grid(corner, u, v, self.spacing))
        return np.vstack(grids)

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """The rectangles."""
        return (Rectangles(*self.squares),)


class Sheet(Walls):
    """Experiment 1: the square x, z in [0.4, 0.5] m at y = 0.1 m; 40 401 points at 0.5 mm."""

    centre: ClassVar[Vector] = np.array([0.45, 0.1, 0.45])

    @property
    def squares(self) -> tuple[Vector, Vector, Vector]:
        """The square."""
        return np.array([[0.4, 0.1, 0.4]]), np.array([[0.1, 0, 0]]), np.array([[0, 0, 0.1]])

    @property
    def routes(self) -> dict[str, Vector]:
        """Press, slide and lift off on each side, and off an edge."""
        slide = corners_mm((-20, 15, -13), (-20, -10, -13), (21, -8, 17), (21, 15, 17))
        edge = corners_mm((20, 12, 3), (35, 1, 3), (60, 1, 3), (60, 12, 3))
        return {
            "front": self.centre + slide,
            "back": self.centre - slide,
            "edge": self.centre + edge,
        }


class DoubleSheet(Walls):
    """Two parallel squares closer than the proxy is wide: no room between them.

    Parameters
    ----------
    gap
        Distance between the sheets, at y = ± gap / 2 [m].
    side
        Side of the squares [m].
    """

    gap: float = 4e-3
    side: float = 0.06

    @property
    def squares(self) -> tuple[Vector, Vector, Vector]:
        """Below and above."""
        h = self.side / 2
        g = self.gap / 2
        corner = np.array([[-h, -g, -h], [-h, g, -h]])
        return corner, np.array([[2 * h, 0, 0]] * 2), np.array([[0, 0, 2 * h]] * 2)

    @property
    def routes(self) -> dict[str, Vector]:
        """Press from above and from below until the HIP is past both sheets, slide, lift off."""
        press = corners_mm((-10, 15, -7), (-10, -5, -7), (11, -5, 8), (11, 15, 8))
        return {"above": press, "below": -press}


class Sphere(Scene):
    """A sphere around the origin, its points on a golden spiral.

    Parameters
    ----------
    radius
        [m].
    """

    radius: float = 0.03

    @cached_property
    def points(self) -> Vector:
        """(N, 3) [m]: one point for each square of side `spacing`."""
        n = max(4, round(4 * np.pi * self.radius**2 / self.spacing**2))
        z = 1 - (2 * np.arange(n) + 1) / n
        turn = np.pi * (3 - np.sqrt(5)) * np.arange(n)
        r = np.sqrt(1 - z * z)
        return self.radius * np.column_stack([r * np.cos(turn), r * np.sin(turn), z])

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """The shell."""
        return (Spheres(np.zeros((1, 3)), np.array([self.radius])),)

    @property
    def routes(self) -> dict[str, Vector]:
        """Press and slide outside, press and slide inside."""
        r = self.radius * 1e3
        outside = r * np.array([(0.94, 0.05, 0.1), (0.5, 0.7, 0.3), (-0.1, 0.8, 0.4)])
        inside = r * np.array([(0.98, 0.05, 0.1), (0.8, 0.6, 0.2), (0.1, 0.9, 0.5)])
        return {
            "outside": corners_mm((r + 12, 1, 2), *outside, (-r, 1.6 * r, 10)),
            "inside": corners_mm((0, 0, 0), *inside, (0, 0, 1)),
        }


class ThreeWalls(Walls):
    """A three-way concave corner: the walls x = 0, y = 0 and z = 0, free where all are positive.

    Parameters
    ----------
    side
        Side of the walls [m].
    """

    side: float = 0.04

    @cached_property
    def points(self) -> Vector:
        """(N, 3) [m]; edges that two walls share stand once."""
        return np.unique(super().points, axis=0)

    @property
    def squares(self) -> tuple[Vector, Vector, Vector]:
        """Across x, y and z."""
        sides = np.eye(3) * self.side
        return np.zeros((3, 3)), sides[[1, 2, 0]], sides[[2, 0, 1]]

    @property
    def routes(self) -> dict[str, Vector]:
        """Into the corner along the diagonal, and along a wall and an edge into it."""
        return {
            "diagonal": corners_mm((14, 15, 16), (-6, -5, -4), (14, 15, 16)),
            "edge": corners_mm(
                (25, 15, 12), (25, -3, 12), (25, -3, -4), (-5, -3, -4), (15, 15, 15)
            ),
        }
