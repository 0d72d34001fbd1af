"""Scenes whose exact proxy is known, and the paper's own six.

>>> scene = Sheet()                                # Experiment 1, 40 401 points
>>> hips = scene.path("front", speed=0.1)          # (T, 3) HIP positions at 1 kHz
>>> proxy = scene.truth(hips, radius=5e-3)         # (T, 3) exact proxy
>>> force = scene.force(hips, proxy, 1000.0)       # (T, 3) exact force

The truth is that of the exact geometry, not of its samples: what an engine gets wrong against it
is the error a user sees.

First what every scene offers, then those drawn in the plane, then those in space.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from vfplan import fixture
from vfplan.engine.parameters import Vector, check_stiffness
from vfplan.engine.proxy import ProxyEngine, check_path
from vfplan.geometry.lines import arc_lengths, in_space, interpolated, normals
from vfplan.scenes import god_object, outline
from vfplan.scenes.outline import Run, Runs, Shape, Sides, Spheres

# Corners (K, 3) [m] of scripted paths, by name.
Routes = dict[str, Vector]
# Corners of rectangles, and their sides from there, (M, 3) [m] each.
Squares = tuple[Vector, Vector, Vector]


@dataclass(frozen=True, eq=False)
class Scene(ABC):
    """A cloud with a known truth.

    Parameters
    ----------
    spacing
        Distance between neighbouring points [m].
    """

    spacing: float = 0.5e-3
    name: ClassVar[str]
    # (3,) 1 along each axis whose coordinate counts, 0 where the scene is endless.
    flat: ClassVar[Vector] = np.ones(3)

    def __init_subclass__(cls) -> None:
        """Every scene is a dataclass as this one is, and has its class's name: "double-sheet"."""
        dataclass(frozen=True, eq=False)(cls)
        if "name" not in vars(cls):
            cls.name = re.sub("(?<=[a-z])(?=[A-Z])", "-", cls.__name__).lower()

    @cached_property
    @abstractmethod
    def points(self) -> Vector:
        """(N, 3) cloud [m]."""

    @cached_property
    @abstractmethod
    def pieces(self) -> Shape:
        """The exact geometry that the cloud samples."""

    @property
    @abstractmethod
    def routes(self) -> Routes:
        """Corners (K, 3) [m] of each scripted HIP path, the first one free of contact."""

    @property
    def ignore_axis(self) -> str | None:
        """What the engine is to be given: "z" for a scene in the plane."""
        return None

    def path(self, route: str, speed: float = 0.05) -> Vector:
        """(T, 3) HIP positions along a route, `speed` [m/s] sampled at 1 kHz."""
        return travel(self.routes[route], speed)

    def truth(self, hips: ArrayLike, radius: float = 5e-3, start: Vector | None = None) -> Vector:
        """The exact proxy (T, 3) [m] for each HIP (T, 3) [m], one after the other.

        The minimum of |x - HIP| over the positions at least `radius` = r_c + r_v from the exact
        geometry, reached by sliding from where the proxy was; `start` or the first HIP begins.

        Raises
        ------
        SceneError
            The start lies inside the fixture.
        """
        path = check_path(hips)
        proxy = np.asarray(start, float) if start is not None else path[0]
        flat = self.flat
        out = np.empty_like(path)
        for i, hip in enumerate(path):
            pieces = self.pieces_between(proxy * flat, hip * flat, radius)
            proxy = god_object.follow(pieces, proxy * flat, hip * flat, radius)
            out[i] = proxy + hip * (1 - flat)
        return out

    def pieces_between(self, proxy: Vector, hip: Vector, radius: float) -> Shape:
        """The pieces that a proxy (3,) can meet on its path to a HIP (3,); here all of them."""
        return self.pieces

    def force(self, hips: ArrayLike, proxy: Vector, stiffness: ArrayLike = 1000.0) -> Vector:
        """Eq. (8) for HIPs and proxies (T, 3): the exact force (T, 3) [N]."""
        return (proxy - check_path(hips)) * self.flat * check_stiffness(stiffness)

    def clearance(self, x: Vector) -> Vector:
        """(T,) distance of the positions x (T, 3) from the exact geometry [m]."""
        flat = x * self.flat
        views = [god_object.look(self.pieces_between(place, place, 0.0), place) for place in flat]
        return np.array([view.distance.min() for view in views])


class Drawn(Scene):
    """A scene drawn in the plane z = 0 and endless along z.

    Parameters
    ----------
    extrude
        0: points in the plane, the engine ignores z. Above 0: a cloud of that height [m] around
        z = 0, rows `spacing` apart, for an engine in 3-D.
    """

    extrude: float = 0.0
    flat: ClassVar[Vector] = np.array([1.0, 1.0, 0.0])

    @cached_property
    @abstractmethod
    def runs(self) -> tuple[outline.Run, ...]:
        """The outline."""

    @cached_property
    def points(self) -> Vector:
        """(N, 3) cloud [m]."""
        flat = outline.sample(self.runs, self.spacing)
        half = round(self.extrude / self.spacing / 2)
        heights = np.arange(-half, half + 1) * self.spacing
        return np.column_stack([np.tile(flat, (len(heights), 1)), np.repeat(heights, len(flat))])

    @cached_property
    def pieces(self) -> Shape:
        """The exact outline."""
        return outline.pieces(self.runs)

    @cached_property
    def lines_and_arcs(self) -> fixture.Pieces:
        """The exact outline as rule "exact" takes it."""
        return outline.lines_and_arcs(self.runs)

    def clearance(self, x: Vector) -> Vector:
        """See `Scene.clearance`; all positions at once."""
        return ProxyEngine.along(self.lines_and_arcs).distance(x)

    @property
    def ignore_axis(self) -> str | None:
        """ "z" when the cloud is flat."""
        return None if self.extrude else "z"


def travel(corners: Vector, speed: float, rate: float = 1000.0) -> Vector:
    """(T, 3) positions on straight lines between corners (K, 3), `speed` [m/s] at `rate` [Hz].

    Both ends belong to the path; the last step may be shorter.
    """
    corners = np.asarray(corners, float)
    edges = arc_lengths(corners, False)
    s = np.append(np.arange(0.0, edges[-1], speed / rate), edges[-1])
    return interpolated(s, edges, corners)


def corners_mm(*points: tuple[float, ...]) -> Vector:
    """The corners of a path in millimetres, (u, v) or (x, y, z), as (K, 3) in metres."""
    return np.array([[*point, 0.0][:3] for point in points]) * 1e-3


class Circle(Drawn):
    """A circle around the origin.

    Parameters
    ----------
    radius
        [m].
    """

    radius: float = 0.03

    @cached_property
    def runs(self) -> Runs:
        """One full arc."""
        return (Run((outline.arc(np.zeros(2), self.radius, 0.0, 2 * np.pi),), closed=True),)

    @property
    def routes(self) -> Routes:
        """Once around, from 2 to 13 mm deep, outside; and the same from the inside out."""
        turn = np.linspace(0, 2 * np.pi, 361)
        deep = (7.5 - 5.5 * np.cos(3 * turn)) * 1e-3
        round_ = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
        outer = self.radius + 5e-3
        free = np.array([[outer + 5e-3, 0, 0]])
        inner = max(self.radius - 5e-3, 0.0)
        return {
            "outside": np.vstack([free, (outer - deep)[:, None] * round_, free]),
            "inside": np.vstack([0 * free, (inner + deep)[:, None] * round_, 0 * free]),
        }


class Bend(Drawn):
    """Two straight legs that meet in the origin, one along +x.

    Parameters
    ----------
    angle
        Between the legs [rad].
    leg
        Length of each [m].
    """

    angle: float = np.pi / 2
    leg: float = 0.04

    @cached_property
    def runs(self) -> Runs:
        """Both legs."""
        first = np.array([self.leg, 0.0])
        second = self.leg * np.array([np.cos(self.angle), np.sin(self.angle)])
        return outline.polyline(first, np.zeros(2), second)

    def _at(self, along: float, other: float) -> tuple[float, float]:
        """Position [mm] by its signed distances from the two legs' lines."""
        x = (other + along * np.cos(self.angle)) / np.sin(self.angle)
        return (float(x), along)


class Wedge(Bend):
    """The bend met from outside: a convex edge."""

    @property
    def routes(self) -> Routes:
        """Press on one leg, slide over the edge onto the other, lift off."""
        at = self._at
        # In front of the edge the path goes round it, where the proxy does not jump.
        corner = at(-2, 2), at(-2, -2), at(2, -2)
        return {"over": corners_mm(at(-12, 15), at(1, 15), *corner, at(15, 1), at(15, -12))}


class Corner(Bend):
    """The bend met from inside: a concave corner."""

    @property
    def routes(self) -> Routes:
        """Along each leg, 3 mm deep, into the other; and straight into the corner."""
        at = self._at
        return {
            "floor": corners_mm(at(12, 25), at(-3, 25), at(-3, -5), at(12, 15)),
            "wall": corners_mm(at(25, 12), at(25, -3), at(-5, -3), at(15, 12)),
            "deep": corners_mm(at(12, 13), at(-6, -8), at(12, 13)),
        }


class Channel(Drawn):
    """Two parallel straight walls, open at both ends.

    Parameters
    ----------
    width
        Between the walls [m]; the proxy of the paper's r_c needs 10 mm.
    length
        [m].
    """

    width: float = 10.005e-3
    length: float = 0.06

    @cached_property
    def runs(self) -> Runs:
        """Both walls."""
        a, up = np.array([-self.length / 2, 0]), np.array([0, self.width / 2])
        return (*outline.polyline(a + up, up - a), *outline.polyline(a - up, -a - up))

    @property
    def routes(self) -> Routes:
        """In at one end, pressed against each wall, out at the other end."""
        end = self.length * 500 + 15
        return {
            "through": corners_mm((-end, 0), (-10, 0), (-5, 4), (5, -4), (10, 0), (end, 0)),
            "askew": corners_mm((-end, 3), (end, 3)),
        }


_OMEGA_MM = [
    (-14, 0), (-20, 9), (-31, 23), (-35.5, 43), (-25, 65), (0, 74.5),
    (25.5, 64), (35, 44), (30, 22.5), (19.5, 9.5), (14, 0),
]  # fmt: skip


class Omega(Drawn):
    """The paper's hand-drawn Ω, drawn anew: an open curve with two feet."""

    @cached_property
    def runs(self) -> Runs:
        """Left foot, ring, right foot."""
        ring = np.array(_OMEGA_MM) * 1e-3
        left_end = np.array([-0.042, 0.0])
        foot = outline.polyline(left_end, ring[0])
        return (*foot, outline.smooth(ring), *outline.polyline(ring[-1], -left_end))

    @property
    def routes(self) -> Routes:
        """Beside the line, 3 mm from it on its upper side; on the line itself; inside the ring."""
        line = np.vstack([run.sample(1e-3) for run in self.runs])
        ring = self.runs[1].sample(1e-3)

        # The line moved to its left, without what lies closer to another part of it.
        distance = 3e-3
        moved = in_space(np.vstack([outside(run.sample(2.5e-4), -distance) for run in self.runs]))
        moved = moved[self.clearance(moved) > (1 - 1e-3) * distance]

        left, right = corners_mm((-60, 10)), corners_mm((60, 10))
        return {
            "beside": np.vstack([left, moved, right]),
            "over": np.vstack([left, in_space(line), right]),
            "inside": np.vstack([corners_mm((0, -15), (0, 5)), in_space(ring[5:-5]),
                                 corners_mm((0, -15))]),
        }  # fmt: skip


_SPOUT_MM = [(34, 0), (45, 8), (53, 22), (64, 29), (75, 36), (84, 50), (96, 63)]
_SPOUT_TOP_MM = [(87, 69), (76, 60), (69, 49), (60, 47), (53, 56), (45, 67), (36, 73)]
_LID_MM = [(36, 78), (23, 86), (8, 90), (5.5, 94), (8.5, 100), (0, 105)]
_HANDLE_MM = [
    (-36, 73), (-45, 69), (-58, 73), (-78, 68), (-88, 50), (-80, 30), (-62, 19), (-46, 10),
    (-34, 0),
]  # fmt: skip


class Teapot(Drawn):
    """A teapot's silhouette of 184 mm, spout to the right: closed, with corners and hollows."""

    @cached_property
    def runs(self) -> Runs:
        """Counter-clockwise from the right end of the base."""
        # The lid is its own mirror image.
        lid = [*_LID_MM, *((-x, y) for x, y in reversed(_LID_MM[:-1]))]
        lines = [np.array(line_mm) * 1e-3
                 for line_mm in (_SPOUT_MM, _SPOUT_TOP_MM, lid, _HANDLE_MM)]  # fmt: skip
        runs: list[Run] = []
        for line, following in zip(lines, [*lines[1:], lines[0]], strict=True):
            runs += [outline.smooth(line), *outline.polyline(line[-1], following[0])]
        return tuple(runs)

    @property
    def routes(self) -> Routes:
        """From the left over handle, lid and spout along the line; all around it."""
        line = np.vstack([outside(run.sample(1e-3), 2e-3) for run in self.runs])
        below = np.array([[0.0, -0.02, 0.0]])
        over = line[line[:, 1] > 0.05]
        start = np.array([[0.1104, 0.05, 0.0]])
        return {
            "around": np.vstack([below, in_space(line), in_space(line[:5]), below]),
            "over": np.vstack([start, in_space(over), start * [-1, 1, 1]]),
        }


def outside(line: Vector, by: float) -> Vector:
    """A line (K, 2) [m] moved to its right: out of an outline drawn counter-clockwise."""
    return line - by * normals(line, False)


class Point(Scene):
    """The paper's 0-D simulation: one point at the origin."""

    @cached_property
    def points(self) -> Vector:
        """(1, 3) [m]."""
        return np.zeros((1, 3))

    @cached_property
    def pieces(self) -> Shape:
        """The point."""
        return (Sides(np.zeros((1, 3)), (np.zeros((1, 3)),)),)

    @property
    def routes(self) -> Routes:
        """From left to right just above it."""
        return {"across": corners_mm((-20, 1), (20, 1))}


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
    def pieces(self) -> Shape:
        """The segment."""
        side = np.array([[self.length, 0, 0]])
        return (Sides(-side / 2, (side,)),)

    @property
    def routes(self) -> Routes:
        """Press on it from above, slide and lift off."""
        return {"above": corners_mm((3, 12, 0.4), (3, 2, 0.4), (8, 2, 0.4), (8, 12, 0.4))}


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
    def squares(self) -> Squares:
        """Corners and the sides u and v from them, each (M, 3) [m]."""

    @cached_property
    def points(self) -> Vector:
        """(N, 3) [m], edges included."""
        squares = zip(*self.squares, strict=True)
        return np.vstack([grid(corner, u, v, self.spacing) for corner, u, v in squares])

    @cached_property
    def pieces(self) -> Shape:
        """The rectangles."""
        corner, *sides = self.squares
        return (Sides(corner, tuple(sides)),)


class Sheet(Walls):
    """Experiment 1: the square x, z in [0.4, 0.5] m at y = 0.1 m; 40 401 points at 0.5 mm."""

    centre: ClassVar[Vector] = np.array([0.45, 0.1, 0.45])

    @property
    def squares(self) -> Squares:
        """The square."""
        return np.array([[0.4, 0.1, 0.4]]), np.array([[0.1, 0, 0]]), np.array([[0, 0, 0.1]])

    @property
    def routes(self) -> Routes:
        """Press, slide and lift off on each side, and off an edge."""
        slide = corners_mm((-20, 15, -13), (-20, -10, -13), (21, -8, 17), (21, 15, 17))
        edge = corners_mm((20, 12, 3), (35, 1, 3), (60, 1, 3), (60, 12, 3))
        paths = {"front": slide, "back": -slide, "edge": edge}
        return {name: self.centre + path for name, path in paths.items()}


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
    def squares(self) -> Squares:
        """Below and above."""
        h, g = self.side / 2, self.gap / 2
        corner = np.array([[-h, -g, -h], [-h, g, -h]])
        return corner, np.array([[2 * h, 0, 0]] * 2), np.array([[0, 0, 2 * h]] * 2)

    @property
    def routes(self) -> Routes:
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
    def pieces(self) -> Shape:
        """The shell."""
        return (Spheres(np.zeros((1, 3)), np.array([self.radius])),)

    @property
    def routes(self) -> Routes:
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
    def squares(self) -> Squares:
        """Across x, y and z."""
        sides = np.eye(3) * self.side
        return np.zeros((3, 3)), sides[[1, 2, 0]], sides[[2, 0, 1]]

    @property
    def routes(self) -> Routes:
        """Into the corner along the diagonal, and along a wall and an edge into it."""
        return {
            "diagonal": corners_mm((14, 15, 16), (-6, -5, -4), (14, 15, 16)),
            "edge": corners_mm((25, 15, 12), (25, -3, 12), (25, -3, -4), (-5, -3, -4),
                               (15, 15, 15)),
        }  # fmt: skip


# Every scene by its name.
SCENES: dict[str, type[Scene]] = {
    scene.name: scene
    for scene in (
        Point, Segment, Sheet, DoubleSheet, Circle, Sphere, Wedge, Corner, ThreeWalls, Channel,
        Omega, Teapot,
    )
}  # fmt: skip
