"""The paper's Table I as one validated object, and what every engine answers with.

Both engines (the native one behind `vfplan.ProxyEngine` and the NumPy reference) take their
settings from here, so that a default or a check exists once.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.engine.checks import LIMIT, Vector, check_axis, check_points, check_stiffness, number
from vfplan.errors import SettingError

Rule = Literal["robust", "paper", "exact"]
RULES: tuple[Rule, ...] = ("robust", "paper")  # those that render points
Search = Literal["auto", "grid", "brute"]
MAX_ITERATIONS = 16  # of the robust rule, a tick

# Of R, and of the largest coordinate: what roundings may take from the clearance of rule "exact".
EXACT_BAND = 1e-7
MESH_BAND = 1e-5  # where it renders triangles: also what single precision takes, as in STL
PAPER_BAND = 10e-6  # r2 - rc = rc - r1 of Algorithm 1 [m]

# What float64 serves among coordinates of up to 1e6 m. Squares of such radii neither under- nor
# overflow, in the float32 seeds of the native loops either.
SMALLEST_RADIUS, LARGEST_RADIUS = 1e-9, LIMIT  # [m]
# Of R: the square of a distance is rounded to 2e-16 of itself, and a step's least counted part is
# a millionth of the band. Below, the proxy lags and eq. (1) loses its digits.
FINEST_BAND = 1e-8
# Roundings of the largest coordinate that a band holds: its hundredth, rest, is a hundred still.
ROUNDINGS_A_BAND = 1e4


class Status(IntFlag):
    """What a tick has to say beside its result; 0 when all is well."""

    OK = 0
    BAD_HIP = 1
    """The HIP was not finite (or beyond 1e6 m): the proxy stayed and the force is its last.

    Before the first good HIP both are 0.
    """
    INSIDE = 2
    """The proxy is inside the fixture and on its way out."""
    LIMIT = 4
    """The tick used up its iterations; the proxy is safe and goes on at the next tick."""
    STALE = 8
    """The moving fixture's pose is too old: its last frame stands.

    Before the first pose nothing is rendered.
    """
    CHANGING = 16
    """The fixture was exchanged or edited, and the force is on its way to K (proxy - HIP)."""
    CROSSED = 32
    """With INSIDE: no way out was found on the side where the proxy was before the exchange."""


@dataclass(frozen=True, eq=False)
class Step:
    """One tick's answer.

    Parameters
    ----------
    proxy, normal, force
        (3,) proxy position [m], unit normal (0 when there is none), force on the hand [N].
    state
        -1 no neighbour, 0 free motion, 1 in contact, 2 entrenched.
    status
        A `Status`.
    """

    proxy: Vector
    normal: Vector
    force: Vector
    state: int
    status: Status


@dataclass(frozen=True, eq=False)
class Trace:
    """A path's answer, row by row what `Step` is for one tick.

    Parameters
    ----------
    proxy, normal, force
        (T, 3) float64 [m], [1], [N].
    state
        (T,) int8.
    status
        (T,) uint8, values of `Status`.
    """

    proxy: Vector
    normal: Vector
    force: Vector
    state: NDArray[np.int8]
    status: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.state)

    @classmethod
    def of(cls, steps: list[Step]) -> Trace:
        """Steps one after the other."""
        rows = (np.array([getattr(s, n) for s in steps]) for n in ("proxy", "normal", "force"))
        state, status = ([getattr(s, n) for s in steps] for n in ("state", "status"))
        vectors = (row.reshape(-1, 3) for row in rows)
        return cls(*vectors, np.array(state, np.int8), np.array(status, np.uint8))


@dataclass(frozen=True, eq=False)
class ProxyParameters:
    """Table I of the paper, checked; made by `ProxyParameters.make`.

    Parameters
    ----------
    rule
        "robust", "paper" or "exact".
    contact_radius, band, point_radius, outer_radius
        r_c, r2 - r_c, r_v and r3 [m].
    gain
        ξ of eq. (5), in (0, 1].
    stiffness
        (3,) the diagonal of K [N/m].
    ignore_axis
        (3,) unit vector along which the fixture is infinite; `None` in 3-D.
    """

    rule: Rule
    contact_radius: float
    band: float
    point_radius: float
    outer_radius: float
    gain: float
    stiffness: Vector
    ignore_axis: Vector | None

    @property
    def r1(self) -> float:
        """Inner radius r_c - band [m]."""
        return self.contact_radius - self.band

    @property
    def rc(self) -> float:
        """Contact radius [m]."""
        return self.contact_radius

    @property
    def r2(self) -> float:
        """Outer edge of the contact band, r_c + band [m]."""
        return self.contact_radius + self.band

    @property
    def r3(self) -> float:
        """Neighbour radius [m]."""
        return self.outer_radius

    @property
    def rv(self) -> float:
        """Radius of each cloud point [m]."""
        return self.point_radius

    @property
    def R(self) -> float:
        """Distance r_c + r_v at which the proxy rests on a point [m]."""
        return self.contact_radius + self.point_radius

    @property
    def xi(self) -> float:
        """Gain ξ of eq. (5)."""
        return self.gain

    @classmethod
    def make(
        cls,
        points: ArrayLike,
        contact_radius: float = 5e-3,
        band: float | None = None,
        point_radius: float = 0.0,
        stiffness: float | ArrayLike = 1000.0,
        rule: Rule = "robust",
        ignore_axis: str | ArrayLike | None = None,
        outer_radius: float | None = None,
        gain: float = 1.0,
    ) -> ProxyParameters:
        """Check every setting, and choose those that were left open.

        Parameters
        ----------
        points
            (N, 3) cloud [m]; the default band follows from it. Rule "exact": vertices.
        contact_radius, point_radius
            r_c from 1e-9 to 1e6 and r_v from 0 to 1e6 [m].
        band
            r2 - r_c = r_c - r1 [m], from 1e-8 (r_c + r_v) to r_c, and at least 2.2e-12 of the
            largest coordinate. `None`: what the cloud asks for (`default_band`); rule "paper":
            10 µm; rule "exact": what roundings take.
        stiffness
            K [N/m] > 0, one number or one an axis.
        rule
            "robust", "paper" or "exact".
        ignore_axis
            `None`, "x", "y", "z" or a (3,) direction (normalised here).
        outer_radius
            r3 [m] > r2, at most 2e6; `None`: 2 r_c.
        gain
            ξ in (0, 1].

        Raises
        ------
        SettingError
            A parameter outside its range.
        SceneError
            Points that are no finite (N, 3) cloud.
        """
        points = check_points(points)
        if rule not in get_args(Rule):
            raise SettingError(f"rule {rule!r}: allowed are {', '.join(get_args(Rule))}")
        rc = number("contact_radius", contact_radius, "m", above=0.0)
        rc = number("contact_radius", rc, "m", least=SMALLEST_RADIUS, most=LARGEST_RADIUS)
        rv = number("point_radius", point_radius, "m", least=0.0, most=LARGEST_RADIUS)
        axis = check_axis(ignore_axis)
        far = float(np.abs(points).max())
        least = ROUNDINGS_A_BAND * float(np.finfo(float).eps) * far
        if rule == "exact":
            band = max((EXACT_BAND if axis is not None else MESH_BAND) * (rc + rv), least)
        elif band is None:
            band = PAPER_BAND if rule == "paper" else default_band(points, rc, rv, axis)
        band = number("band", band, "m", above=0.0, most=rc, why="at most contact_radius")
        if not rc - band < rc + band:
            raise SettingError(f"band {band:g} m: r1 must be less than r2 (r_c = {rc:g} m)")
        band = number("band", band, "m", least=FINEST_BAND * (rc + rv), why="1e-8 (r_c + r_v)")
        why = f"1e4 roundings of the largest coordinate, {far:g} m"
        band = number("band", band, "m", least=least, why=why)
        r3 = 2 * rc if outer_radius is None else outer_radius
        r3 = number("outer_radius", r3, "m", above=rc + band, why="r3 > r2")
        r3 = number("outer_radius", r3, "m", most=2 * LARGEST_RADIUS)
        xi = number("gain", gain, "", above=0.0, most=1.0)
        return cls(rule, rc, band, rv, r3, xi, check_stiffness(stiffness), axis)

    def native(self, iterations: int | None = None, search: str = "auto") -> _core.Parameters:
        """As the native engine takes them; iterations a tick `None`: 16.

        Raises `SettingError` for another search, or no integer of at least 1.
        """
        if search not in get_args(Search):
            raise SettingError(f"search {search!r}: allowed are {', '.join(get_args(Search))}")
        p = _core.Parameters()
        for name in ("contact_radius", "band", "point_radius", "outer_radius", "gain"):
            setattr(p, name, getattr(self, name))
        p.rule = getattr(_core.Rule, self.rule)
        p.search = getattr(_core.Search, search)
        p.max_iterations = iterations_of(iterations)
        p.set_stiffness(self.stiffness)
        if self.ignore_axis is not None:
            p.set_ignore_axis(self.ignore_axis)
        return p


def default_band(points: Vector, rc: float, rv: float, axis: Vector | None) -> float:
    """The paper's band of 10 µm, or what a ball of r_c + r_v sinks between the points [m].

    `vfplan::band_for` of the C++ header dips.hpp: for even points the dimple's depth; more for
    noise, pixels' stairs and gaps. Never less than 1e-8 R, nor more than r_c / 2.
    """
    p = _core.Parameters()
    p.contact_radius, p.point_radius = rc, rv
    if axis is not None:
        p.set_ignore_axis(axis)
    return _core.band_for(points, p)


def iterations_of(value: int | None) -> int:
    """Iterations a tick; `None`: 16. Raises `SettingError` for what is no integer of at least 1."""
    if value is None:
        return MAX_ITERATIONS
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise SettingError(f"max_iterations {value!r}: allowed is an integer of at least 1")
    return min(int(value), 10**6)
