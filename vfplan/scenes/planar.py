"""Scenes drawn in the plane: circle, cylinder, bends, channel, the paper's Ω and a teapot."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from vfplan.engine.parameters import Vector
from vfplan.errors import SettingError
from vfplan.scenes import outline
from vfplan.scenes.base import Drawn, way
from vfplan.scenes.outline import Run


class Circle(Drawn):
    """A circle around the origin.

    Parameters
    ----------
    radius
        [m].
    """

    radius: float = 0.03

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """One full arc."""
        return (Run((outline.arc(np.zeros(2), self.radius, 0.0, 2 * np.pi),), closed=True),)

    @property
    def routes(self) -> dict[str, Vector]:
        """Once around, from 2 to 13 mm deep, outside; and the same from the inside out."""
        turn = np.linspace(0, 2 * np.pi, 361)
        deep = (7.5 - 5.5 * np.cos(3 * turn)) * 1e-3
        round_ = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
        out, far = self.radius + 5e-3, np.array([[1.0, 0, 0]])
        outside = [far * (out + 5e-3), (out - deep)[:, None] * round_, far * (out + 5e-3)]
        inner = max(self.radius - 5e-3, 0.0)
        inside = [0 * far, (inner + deep)[:, None] * round_, 0 * far]
        return {"outside": np.vstack(outside), "inside": np.vstack(inside)}


class Cylinder(Circle):
    """The circle as a cloud in space, along z.

    Parameters
    ----------
    extrude
        Height [m].
    """

    extrude: float = 0.06


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

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.angle < np.pi:
            raise SettingError(f"angle {self.angle:g} rad: allowed is between 0 and pi")

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """Both legs."""
        u, v = self._legs
        return outline.polyline(u * self.leg, np.zeros(2), v * self.leg)

    @property
    def _legs(self) -> tuple[Vector, Vector]:
        return np.array([1.0, 0.0]), np.array([np.cos(self.angle), np.sin(self.angle)])

    def _at(self, along: float, other: float) -> tuple[float, float]:
        """Position [mm] by its signed distances from the two legs' lines."""
        x = (other + along * np.cos(self.angle)) / np.sin(self.angle)
        return (float(x), along)


class Wedge(Bend):
    """The bend met from outside: a convex edge."""

    @property
    def routes(self) -> dict[str, Vector]:
        """Press on one leg, slide over the edge onto the other, lift off."""
        at = self._at
        corner = at(-2, 2), at(-2, -2), at(2, -2)  # round it in front, where the way has no jump
        over = way(at(-12, 15), at(1, 15), *corner, at(15, 1), at(15, -12))
        return {
            "over": over,
            "back": over[::-1],
        }


class Corner(Bend):
    """The bend met from inside: a concave corner."""

    @property
    def routes(self) -> dict[str, Vector]:
        """Along each leg, 3 mm deep, into the other; and straight into the corner."""
        at = self._at
        return {
            "floor": way(at(12, 25), at(-3, 25), at(-3, -5), at(12, 15)),
            "wall": way(at(25, 12), at(25, -3), at(-5, -3), at(15, 12)),
            "deep": way(at(12, 13), at(-6, -8), at(12, 13)),
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
    def runs(self) -> tuple[Run, ...]:
        """Both walls."""
        a, b = np.array([-self.length / 2, 0]), np.array([self.length / 2, 0])
        up = np.array([0, self.width / 2])
        return (*outline.polyline(a + up, b + up), *outline.polyline(a - up, b - up))

    @property
    def routes(self) -> dict[str, Vector]:
        """In at one end, pressed against each wall, out at the other end."""
        end = self.length * 500 + 15
        return {
            "through": way((-end, 0), (-10, 0), (-5, 4), (5, -4), (10, 0), (end, 0)),
            "askew": way((-end, 3), (end, 3)),
        }


_OMEGA_MM = [
    (-14, 0), (-20, 9), (-31, 23), (-35.5, 43), (-25, 65), (0, 74.5),
    (25.5, 64), (35, 44), (30, 22.5), (19.5, 9.5), (14, 0),
]  # fmt: skip


class Omega(Drawn):
    """The paper's hand-drawn Ω, drawn anew: an open curve with two feet."""

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """Left foot, ring, right foot."""
        ring = np.array(_OMEGA_MM) * 1e-3
        left, right = np.array([-0.042, 0.0]), np.array([0.042, 0.0])
        foot = outline.polyline(left, ring[0])
        return (*foot, outline.smooth(ring), *outline.polyline(ring[-1], right))

    @property
    def routes(self) -> dict[str, Vector]:
        """Beside the line, 3 mm off it on its upper side; on the line itself; inside the ring."""
        line = np.vstack([run.sample(1e-3) for run in self.runs])
        ring = self.runs[1].sample(1e-3)
        return {
            "beside": np.vstack([way((-60, 10)), _in_space(self._above(3e-3)), way((60, 10))]),
            "over": np.vstack([way((-60, 10)), _in_space(line), way((60, 10))]),
            "inside": np.vstack([way((0, -15), (0, 5)), _in_space(ring[5:-5]), way((0, -15))]),
        }

    def _above(self, by: float) -> Vector:
        """(K, 2) the line moved `by` [m] to its left, what lies nearer to another part left out."""
        sides = [outside(run.sample(2.5e-4), -by) for run in self.runs]
        beside = np.vstack(sides)
        return beside[self.clearance(_in_space(beside)) > (1 - 1e-3) * by]


_SPOUT_MM = [(34, 0), (45, 8), (53, 22), (64, 29), (75, 36), (84, 50), (96, 63)]
_SPOUT_TOP_MM = [(87, 69), (76, 60), (69, 49), (60, 47), (53, 56), (45, 67), (36, 73)]
_LID_MM = [(36, 78), (23, 86), (8, 90), (5.5, 94), (8.5, 100), (0, 105)]
_HANDLE_MM = [
    (-36, 73), (-45, 69), (-58, 73), (-78, 68), (-88, 50), (-80, 30), (-62, 19), (-46, 10),
    (-34, 0),
]  # fmt: skip


class Teapot(Drawn):
    """A teapot's silhouette, spout to the right: a closed outline with corners and hollows.

    Parameters
    ----------
    width
        From handle to spout [m].
    """

    width: float = 0.184

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """Counter-clockwise from the right end of the base."""
        scale = self.width / 184
        right = [(-x, y) for x, y in _LID_MM[-2::-1]]  # the lid is its own mirror image
        lines = [_SPOUT_MM, _SPOUT_TOP_MM, [*_LID_MM, *right], _HANDLE_MM]
        smooth = [outline.smooth(np.array(line) * scale) for line in lines]
        ends = [(np.array(line[0]) * scale, np.array(line[-1]) * scale) for line in lines]
        runs: list[Run] = []
        for i, run in enumerate(smooth):
            runs += [run, *outline.polyline(ends[i][1], ends[(i + 1) % len(ends)][0])]
        return tuple(runs)

    @property
    def routes(self) -> dict[str, Vector]:
        """From the left over handle, lid and spout along the line; all around it."""
        line = np.vstack([outside(run.sample(1e-3), 2e-3) for run in self.runs])
        below = np.array([[0.0, -0.02, 0.0]])
        over = line[line[:, 1] > 0.05 * self.width / 0.184]
        left = np.array([[-0.6 * self.width, 0.05, 0.0]])
        return {
            "around": np.vstack([below, _in_space(line), _in_space(line[:5]), below]),
            "over": np.vstack([-left * [1, -1, 1], _in_space(over), left]),
        }


def outside(line: Vector, by: float) -> Vector:
    """A line (K, 2) [m] moved to its right: out of an outline drawn counter-clockwise."""
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    return line + by * np.column_stack([along[:, 1], -along[:, 0]])


def _in_space(flat: Vector) -> Vector:
    return np.column_stack([flat, np.zeros(len(flat))])
