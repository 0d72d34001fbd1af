"""The paper's Table I as one validated object, and the checks of all that is set beforehand.

Both engines (`vfplan.ProxyEngine` and the NumPy reference) take their settings from here. A check
returns the value in the one form that they use, or raises with what was found and what is allowed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import attrgetter, ge, gt, le
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.errors import SceneError, SettingError

MOST_POINTS = 4_000_000  # in one bundle (schemas/bundle-2.0.json); more are refused unmade
LIMIT = _core.largest_coordinate  # |x| [m]: beyond it float64 does not resolve a nanometre
UNIT = 1e-9  # how far from 1 the length of a unit vector may be, as in parameters.hpp
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}

Vector = NDArray[np.float64]

Rule = Literal["robust", "paper", "exact"]
RULES: tuple[Rule, ...] = ("robust", "paper")  # those that render points
Search = Literal["auto", "grid", "brute"]
MAX_ITERATIONS = 16  # of the robust rule, a tick

# Of R, and of the largest coordinate: what roundings may take from the clearance of rule "exact".
EXACT_BAND = _core.curve_band
MESH_BAND = _core.mesh_band  # for triangles: also what single precision takes, as in STL
PAPER_BAND = 10e-6  # r2 - rc = rc - r1 of Algorithm 1 [m]

# What float64 serves among coordinates of up to 1e6 m. Squares of such radii neither under- nor
# overflow, in the float32 seeds of the native loops either.
SMALLEST_RADIUS = _core.smallest_radius  # [m]
LARGEST_RADIUS = _core.largest_radius  # [m]
# Of R: the square of a distance is rounded to 2e-16 of itself, and a step's least counted part is
# a millionth of the band. Below, the proxy lags and eq. (1) loses its digits.
FINEST_BAND = _core.finest_band
# Roundings of the largest coordinate that a band holds: its hundredth, rest, is a hundred still.
ROUNDINGS_A_BAND = _core.roundings_a_band


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

    # By the paper's symbols:
    rc = property(attrgetter("contact_radius"), doc="Contact radius [m].")
    r3 = property(attrgetter("outer_radius"), doc="Neighbour radius [m].")
    rv = property(attrgetter("point_radius"), doc="Radius of each cloud point [m].")
    xi = property(attrgetter("gain"), doc="Gain ξ of eq. (5).")

    @property
    def r1(self) -> float:
        """Inner radius r_c - band [m]."""
        return self.contact_radius - self.band

    @property
    def r2(self) -> float:
        """Outer edge of the contact band, r_c + band [m]."""
        return self.contact_radius + self.band

    @property
    def R(self) -> float:
        """Distance r_c + r_v at which the proxy rests on a point [m]."""
        return self.contact_radius + self.point_radius

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
        least, most = SMALLEST_RADIUS, LARGEST_RADIUS
        rc = number("contact_radius", contact_radius, "m", least=least, most=most)
        rv = number("point_radius", point_radius, "m", least=0.0, most=most)
        axis = check_axis(ignore_axis)
        far = float(np.abs(points).max())
        least = ROUNDINGS_A_BAND * float(np.finfo(float).eps) * far
        if rule == "exact":
            band = max((EXACT_BAND if axis is not None else MESH_BAND) * (rc + rv), least)
        elif band is None:
            band = PAPER_BAND if rule == "paper" else default_band(points, rc, rv, axis)
        band = number("band", band, "m", above=0.0, most=rc, why="at most contact_radius")
        band = number("band", band, "m", least=FINEST_BAND * (rc + rv), why="1e-8 (r_c + r_v)")
        why = f"1e4 roundings of the largest coordinate, {far:g} m"
        band = number("band", band, "m", least=least, why=why)
        r3 = 2 * rc if outer_radius is None else outer_radius
        r3 = number("outer_radius", r3, "m", above=rc + band, most=2 * most, why="r3 > r2")
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

    `vfplan::band_for` of the C++ header cloud/band.hpp: for even points the dimple's depth; more
    for noise, pixels' stairs and gaps. Never less than 1e-8 R, nor more than r_c / 2.
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


def check_points(points: ArrayLike) -> Vector:
    """A cloud as (N, 3) contiguous float64 [m]; `SceneError` when it cannot be one."""
    cloud = real_array(points, "points")
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise SceneError(f"points of shape {cloud.shape}: allowed is (N, 3)")
    if len(cloud) == 0:
        raise SceneError("points of shape (0, 3): at least one point is needed")
    check_range(cloud, "point")
    return cloud


def check_stiffness(stiffness: float | ArrayLike) -> Vector:
    """The diagonal of K as (3,) [N/m], every entry above 0; else `SettingError`."""
    k = _of_shape(stiffness, "stiffness", {(): "one number", (3,): "(3,)"})
    k = np.array(np.broadcast_to(k, 3))
    if not (np.all(np.isfinite(k)) and np.all(k > 0)):
        raise SettingError(f"stiffness {k.tolist()} N/m: each must be finite and above 0")
    return _frozen(k)


def check_axis(axis: str | ArrayLike | None) -> Vector | None:
    """The ignored axis as a (3,) unit vector, or `None`; else `SettingError`.

    One that is of unit length, as a bundle's is, stays as it is to the bit: a controller renders it
    so, and a replay must do the same.
    """
    if axis is None:
        return None
    if isinstance(axis, str):
        if axis not in AXES:
            raise SettingError(f"ignore_axis {axis!r}: allowed are None, x, y, z or a direction")
        return _frozen(np.array(AXES[axis]))
    direction = _of_shape(axis, "ignore_axis", {(3,): "(3,)"})
    largest = float(np.max(np.abs(direction)))
    if not (math.isfinite(largest) and largest > 0):
        raise SettingError(f"ignore_axis {direction.tolist()}: must be finite and not zero")
    if largest < 2 and abs(float(np.linalg.norm(direction)) - 1) < UNIT:
        return _frozen(direction.copy())
    direction = direction / largest  # first, so that the norm neither over- nor underflows
    return _frozen(direction / np.linalg.norm(direction))


def _of_shape(values: ArrayLike, name: str, shapes: dict[tuple[int, ...], str]) -> Vector:
    """A setting as float64 of one of these shapes, which a message names; else `SettingError`."""
    try:
        array = real_array(values, name)
    except SceneError as error:
        raise SettingError(error.message) from None
    if array.shape not in shapes:
        allowed = " or ".join(shapes.values())
        raise SettingError(f"{name} of shape {array.shape}: allowed is {allowed}")
    return array


def real_array(values: Any, name: str) -> Vector:
    """Values as contiguous float64 of their own shape; `SceneError` when they are no numbers."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise SceneError(f"{name}: rows of different length; allowed is an array") from None
    if array.dtype.kind not in "fiu":
        raise SceneError(f"{name} of dtype {array.dtype}: allowed are real numbers (float64)")
    return np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)


def check_range(rows: Vector, name: str) -> None:
    """Refuse (N, 3) rows that are not finite or lie beyond `LIMIT`; raises `SceneError`."""
    good = np.all(np.abs(rows) <= LIMIT, axis=1)  # false on NaN
    if not good.all():
        found = rows[i := int(np.argmin(good))].tolist()
        raise SceneError(f"{name} {i} is {found} m: allowed are finite values up to {LIMIT:g} m")


def number(
    name: str,
    value: Any,
    unit: str,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    why: str = "",
) -> float:
    """One finite number within its bounds, as float; else `SettingError` naming what is allowed."""
    value = value[()] if isinstance(value, np.ndarray) and not value.ndim else value
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise SettingError(f"{name} {value!r}: allowed is one number")
    found = float(value)
    bounds = ("above", above, gt), ("at least", least, ge), ("at most", most, le)
    asked = [bound for bound in bounds if bound[1] is not None]
    if not (math.isfinite(found) and all(holds(found, limit) for _, limit, holds in asked)):
        allowed = " and ".join(f"{text} {limit:g}" for text, limit, _ in asked)
        unit, why = unit and f" {unit}", why and f" ({why})"
        raise SettingError(f"{name} {found:g}{unit}: allowed is {allowed}{unit}{why}")
    return found


def _frozen(array: Vector) -> Vector:
    array.flags.writeable = False
    return array
