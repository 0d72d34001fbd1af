"""The paper's Table I as one checked object, and the checks of all that is set beforehand.

Both engines (`vfplan.ProxyEngine` and the NumPy reference) take their settings from here. A check
returns the value in the one form that they use, or raises an error with the value and the range.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.errors import SceneError, SettingError, VfplanError

Vector = NDArray[np.float64]

Rule = Literal["robust", "paper", "exact"]
Search = Literal["auto", "grid", "brute"]
RULES: tuple[Rule, ...] = ("robust", "paper")
"""The rules that render points."""

MAX_POINTS = 4_000_000
"""Most points that a bundle may hold (schemas/bundle-2.0.json)."""

MAX_ITERATIONS = 16
"""Iterations of rule "robust" in a tick, unless a caller says otherwise."""

MAX_COORDINATE = _core.largest_coordinate
"""Largest absolute coordinate [m]. Beyond it float64 does not resolve a nanometre."""

PAPER_BAND = 10e-6
"""The band of Algorithm 1, r2 - r_c = r_c - r1 [m]."""

EXACT_BAND = _core.curve_band
"""Band of rule "exact" on lines and arcs, as a share of R: what roundings may take."""

MESH_BAND = _core.mesh_band
"""The same on triangles, whose corners may come in single precision, as in an STL file."""

FINEST_BAND = _core.finest_band
"""Smallest band as a share of R.

A squared distance is rounded to 2e-16 of itself, and the smallest step that counts is a millionth
of the band. In a finer band the proxy lags, and eq. (1) loses its digits.
"""

ROUNDINGS_A_BAND = _core.roundings_a_band
"""Smallest band in roundings of the largest coordinate. A hundredth of it is still a hundred."""

UNIT_TOLERANCE = 1e-9
"""How far from 1 the length of a unit vector may be, as in the C++ header parameters.hpp."""

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


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
    def rc(self) -> float:
        """Contact radius r_c [m]."""
        return self.contact_radius

    @property
    def rv(self) -> float:
        """Radius r_v of each cloud point [m]."""
        return self.point_radius

    @property
    def r1(self) -> float:
        """Inner radius r_c - band [m]."""
        return self.contact_radius - self.band

    @property
    def r2(self) -> float:
        """Outer edge of the contact band, r_c + band [m]."""
        return self.contact_radius + self.band

    @property
    def r3(self) -> float:
        """Neighbour radius [m]."""
        return self.outer_radius

    @property
    def xi(self) -> float:
        """Gain ξ of eq. (5)."""
        return self.gain

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
        """Check every setting, and choose those that were not given.

        Parameters
        ----------
        points
            (N, 3) cloud [m], from which the default band follows. Rule "exact": vertices.
        contact_radius, point_radius
            r_c from 1e-9 to 1e6 and r_v from 0 to 1e6 [m].
        band
            r2 - r_c = r_c - r1 [m], from 1e-8 (r_c + r_v) to r_c, and at least 2.2e-12 of the
            largest coordinate. `None`: `default_band`; with rule "paper" 10 µm. Rule "exact" takes
            what roundings need.
        stiffness
            K [N/m] > 0, one number or one an axis.
        rule
            "robust", "paper" or "exact".
        ignore_axis
            `None`, "x", "y", "z" or a (3,) direction, which is normalised here.
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
            raise SettingError(f"rule is {rule!r}. Choose one of {', '.join(get_args(Rule))}.")
        rc = real_number("contact_radius", contact_radius)
        rv = real_number("point_radius", point_radius)
        axis = check_axis(ignore_axis)

        largest = float(np.abs(points).max())
        rounding_band = ROUNDINGS_A_BAND * float(np.finfo(float).eps) * largest
        if rule == "exact" and axis is not None:
            band = max(EXACT_BAND * (rc + rv), rounding_band)
        elif rule == "exact":
            band = max(MESH_BAND * (rc + rv), rounding_band)
        elif band is None and rule == "paper":
            band = PAPER_BAND
        elif band is None:
            band = default_band(points, rc, rv, axis)
        band = real_number("band", band)
        if outer_radius is None:
            outer_radius = 2 * rc
        r3 = real_number("outer_radius", outer_radius)
        xi = real_number("gain", gain)
        parameters = cls(rule, rc, band, rv, r3, xi, check_stiffness(stiffness), axis)
        with core_settings():
            _core.check(parameters.native(), points)
        return parameters

    def native(self, iterations: int | None = None, search: str = "auto") -> _core.Parameters:
        """The parameters as the native engine takes them.

        `iterations` is the most in a tick; `None`: `MAX_ITERATIONS`. Raises `SettingError` for
        another search, and for iterations that are no integer of at least 1.
        """
        if search not in get_args(Search):
            raise SettingError(
                f"search is {search!r}. Choose one of {', '.join(get_args(Search))}."
            )
        parameters = _core.Parameters()
        parameters.rule = getattr(_core.Rule, self.rule)
        parameters.contact_radius = self.contact_radius
        parameters.band = self.band
        parameters.point_radius = self.point_radius
        parameters.outer_radius = self.outer_radius
        parameters.gain = self.gain
        parameters.set_stiffness(self.stiffness)
        if self.ignore_axis is not None:
            parameters.set_ignore_axis(self.ignore_axis)
        parameters.max_iterations = check_iterations(iterations)
        parameters.search = getattr(_core.Search, search)
        return parameters


def default_band(points: Vector, rc: float, rv: float, axis: Vector | None) -> float:
    """The paper's band of 10 µm, or how deep a ball of r_c + r_v sinks between the points [m].

    `vfplan::band_for` of the C++ header cloud/band.hpp computes it. For even points it is the depth
    of the dimple between them; noise, pixels' stairs and gaps need more. It is at least 1e-8 R and
    at most r_c / 2.
    """
    parameters = _core.Parameters()
    parameters.contact_radius = rc
    parameters.point_radius = rv
    if axis is not None:
        parameters.set_ignore_axis(axis)
    with core_settings():
        return _core.band_for(points, parameters)


def check_iterations(value: int | None) -> int:
    """Iterations in a tick, at most 1e6; `None`: `MAX_ITERATIONS`.

    Raises `SettingError` for anything that is no integer of at least 1.
    """
    if value is None:
        return MAX_ITERATIONS
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise SettingError(f"max_iterations is {value!r}. Give an integer of at least 1.")
    return min(int(value), 10**6)


def check_points(points: ArrayLike) -> Vector:
    """A cloud as (N, 3) contiguous float64 [m]; raises `SceneError` for anything else."""
    cloud = real_array(points, "points")
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise SceneError(f"points has shape {cloud.shape}. Give one point a row: (N, 3).")
    if len(cloud) == 0:
        raise SceneError("points has shape (0, 3). Give at least one point.")
    check_range(cloud, "point")
    return cloud


def check_stiffness(stiffness: float | ArrayLike) -> Vector:
    """The diagonal of K as (3,) [N/m], every entry above 0; raises `SettingError` for others."""
    entries = setting_array(stiffness, "stiffness")
    if entries.shape not in ((), (3,)):
        raise SettingError(
            f"stiffness has shape {entries.shape}. Give one number, or one for each axis: (3,)."
        )
    diagonal = np.array(np.broadcast_to(entries, 3))
    if not (np.all(np.isfinite(diagonal)) and np.all(diagonal > 0)):
        raise SettingError(
            f"stiffness is {diagonal.tolist()} N/m. Give finite values above 0.",
            numbers={"stiffness_n_per_m": diagonal.tolist()},
        )
    return read_only(diagonal)


def check_axis(axis: str | ArrayLike | None) -> Vector | None:
    """The ignored axis as a (3,) unit vector, or `None`; raises `SettingError` for anything else.

    An axis of unit length, as a bundle's is, stays as it is to the bit: a controller renders it so,
    and a replay must do the same.
    """
    if axis is None:
        return None
    if isinstance(axis, str):
        if axis not in AXES:
            raise SettingError(f"ignore_axis is {axis!r}. Give None, x, y, z or a direction (3,).")
        return read_only(np.array(AXES[axis]))
    direction = setting_array(axis, "ignore_axis")
    if direction.shape != (3,):
        raise SettingError(f"ignore_axis has shape {direction.shape}. Give x, y and z: (3,).")
    largest = float(np.max(np.abs(direction)))
    if not (math.isfinite(largest) and largest > 0):
        raise SettingError(
            f"ignore_axis is {direction.tolist()}. Give finite numbers that are not all 0.",
            numbers={"ignore_axis": direction.tolist()},
        )
    if largest < 2 and abs(float(np.linalg.norm(direction)) - 1) < UNIT_TOLERANCE:
        return read_only(direction.copy())
    # Scaled first, so that the norm neither overflows nor underflows.
    direction = direction / largest
    return read_only(direction / np.linalg.norm(direction))


def setting_array(values: ArrayLike, name: str) -> Vector:
    """As `real_array`, for a setting: raises `SettingError`."""
    try:
        return real_array(values, name)
    except SceneError as error:
        raise SettingError(error.message) from None


def real_array(values: Any, name: str) -> Vector:
    """Values as contiguous float64 of their own shape; raises `SceneError` for no numbers."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise SceneError(
            f"{name} has rows of different length. Give an array of real numbers."
        ) from None
    if array.dtype.kind not in "fiu":
        raise SceneError(f"{name} has type {array.dtype}. Give real numbers (float64).")
    return np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)


def check_range(rows: Vector, name: str) -> None:
    """Raise `SceneError` for rows (N, 3) [m] that are not finite, or beyond `MAX_COORDINATE`."""
    # NaN compares as false, so that it is refused too.
    is_good = np.all(np.abs(rows) <= MAX_COORDINATE, axis=1)
    if is_good.all():
        return
    row = int(np.argmin(is_good))
    raise SceneError(
        f"{name} {row} is {rows[row].tolist()} m. Give finite coordinates of at most "
        f"{MAX_COORDINATE:g} m.",
        numbers={"row": row},
    )


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
    """One finite number within its range, as a float.

    Parameters
    ----------
    above, least, most
        The value must be above the first, at least the second and at most the third.
    why
        The reason for the range, for the message.

    Raises
    ------
    SettingError
        Anything else. The message has the value and the range, `numbers` the value by its name.
    """
    checked = real_number(name, value)
    is_allowed = math.isfinite(checked)
    bounds = []
    if above is not None:
        is_allowed &= checked > above
        bounds.append(f"above {above:g}")
    if least is not None:
        is_allowed &= checked >= least
        bounds.append(f"at least {least:g}")
    if most is not None:
        is_allowed &= checked <= most
        bounds.append(f"at most {most:g}")
    if is_allowed:
        return checked

    if unit:
        unit = f" {unit}"
    wanted = "a finite value"
    if above is not None:
        wanted = f"a value {' and '.join(bounds)}{unit}"
    elif bounds:
        wanted = f"a value of {' and '.join(bounds)}{unit}"
    if why:
        wanted += f" ({why})"
    raise SettingError(f"{name} is {checked:g}{unit}. Give {wanted}.", numbers={name: checked})


def real_number(name: str, value: Any) -> float:
    """One number as a float; raises `SettingError` for anything else. The core checks its range."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise SettingError(f"{name} is {value!r}. Give one number.")
    return float(value)


@contextmanager
def core_settings(**names: str) -> Iterator[None]:
    """Raise what the core finds out of its range as `SettingError`, with the core's own sentences.

    `names` says how a caller calls a parameter of the core, where it is not by the same name.
    """
    try:
        yield
    except _core.OutOfRange as error:
        message, name, value = error.args
        given = names.get(name, name)
        raise SettingError(message.replace(name, given, 1), numbers={given: value}) from None


@contextmanager
def core_errors(kind: type[VfplanError]) -> Iterator[None]:
    """Raise what the core refuses as an error of `kind`, with the core's own sentence."""
    try:
        yield
    except ValueError as error:
        raise kind(str(error.args[0]).removeprefix("vfplan: ")) from None


def read_only(array: Vector) -> Vector:
    """The array, which nobody may change from now on."""
    array.flags.writeable = False
    return array
