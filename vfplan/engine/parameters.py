"""The paper's Table I as one checked object, and the checks of all that is set beforehand.

Both engines (`vfplan.ProxyEngine` and the NumPy reference) take their settings from here. A check
returns the value in the one form that they use, or raises an error with the value and the range.
The ranges of the engine's parameters stand in C++ (vfplan/parameters.hpp).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.engine import PAPER_BAND
from vfplan.errors import SceneError, SettingError, VfplanError
from vfplan.fixture import Pieces, StoredIndices

Vector = NDArray[np.float64]

Rule = Literal["robust", "paper", "exact"]
# The rules that render points.
RULES: tuple[Rule, ...] = ("robust", "paper")

# Most points that a bundle may hold (schemas/bundle-2.0.json).
MAX_POINTS = 4_000_000

# Largest absolute coordinate [m]. Beyond it float64 does not resolve a nanometre.
MAX_COORDINATE = _core.largest_coordinate

# Smallest band as a share of R.
#
# A squared distance is rounded to 2e-16 of itself, and the smallest step that counts is a millionth
# of the band. In a finer band the proxy lags, and eq. (1) loses its digits.
FINEST_BAND = _core.finest_band

# How far from 1 the length of a unit vector may be, as in the C++ header parameters.hpp.
UNIT_TOLERANCE = 1e-9

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


class ProxyParameters(_core.Parameters):
    """Table I of the paper, checked; made by `ProxyParameters.make` and never changed.

    The native engine has the fields: `rule`, `contact_radius`, `band`, `point_radius`,
    `outer_radius` [m], `gain`, `stiffness` (3,) [N/m], `ignore_axis` (3,) or `None`,
    `max_iterations`, `max_hip_step` and `search`; and what follows from them: `r1`, `r2`, and the
    distance `R` at which the proxy rests on a point [m].
    """

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
        *,
        max_iterations: int | None = None,
        search: Literal["auto", "grid", "brute"] = "auto",
        max_hip_step: float = 0.0,
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
            largest coordinate. `None`: 10 µm; with rule "robust" more where a ball of r_c + r_v
            sinks deeper between the points, by noise, pixels' stairs or gaps, but at most r_c / 2
            (`vfplan::band_for` of the C++ header cloud/band.hpp). Rule "exact" takes what roundings
            need.
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
        max_iterations
            Most iterations of rule "robust" in a tick, at least 1; `None`: 16.
        search
            "grid", "brute" (every point, every time) or "auto": a grid where it is faster.
        max_hip_step
            A HIP further than this from the last good one counts as no HIP [m]; 0: any is good.
            A study's path may leap, so 0 is the default here. `vfplan.Controller` has 0.02.

        Raises
        ------
        SettingError
            A parameter outside its range.
        SceneError
            Points that are no finite (N, 3) cloud.
        """
        points = check_points(points)
        rule = one_of("rule", rule, get_args(Rule))
        radius = real_number("contact_radius", contact_radius)
        follows_points = rule == "exact" or (rule == "robust" and band is None)
        parameters = cls(
            contact_radius=radius,
            band=PAPER_BAND if band is None else real_number("band", band),
            point_radius=real_number("point_radius", point_radius),
            outer_radius=real_number(
                "outer_radius", 2 * radius if outer_radius is None else outer_radius
            ),
            gain=real_number("gain", gain),
            stiffness=check_stiffness(stiffness),
            ignore_axis=check_axis(ignore_axis),
            rule=rule,
            search=one_of("search", search, ("auto", "grid", "brute")),
            max_iterations=check_iterations(max_iterations),
            max_hip_step=real_number("max_hip_step", max_hip_step),
        )
        with core_settings(stiffness="n_per_m"):
            if follows_points:
                parameters = cls(parameters, band=_core.band_for(points, parameters))
            _core.check(parameters, points)
        return parameters


def one_of(name: str, value: Any, names: tuple[str, ...]) -> Any:
    """The value, which is one of some names; raises `SettingError` for anything else."""
    if value not in names:
        raise SettingError(f"{name} is {value!r}. Choose one of {', '.join(names)}.")
    return value


def check_iterations(value: int | None) -> int:
    """Iterations in a tick, at most 1e6; `None`: 16.

    Raises `SettingError` for anything that is no integer of at least 1.
    """
    if value is None:
        return 16
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


def check_triangles(points: ArrayLike, triangles: ArrayLike) -> tuple[Vector, StoredIndices]:
    """Points (N, 3) [m] and triangles (K, 3), rows of points, as the engine takes them.

    Raises `SceneError` for shapes that do not fit, and for rows that are not there.
    """
    points = check_points(points)
    rows = np.asarray(triangles)
    if rows.ndim != 2 or rows.shape[1] != 3 or len(rows) == 0 or rows.dtype.kind not in "iu":
        raise SceneError(
            f"triangles has shape {rows.shape} and type {rows.dtype}. Give three numbers of points "
            "a row: (K, 3) integers."
        )
    if rows.min() < 0 or rows.max() >= len(points):
        raise SceneError(
            f"triangles name points {rows.min()} to {rows.max()}. The cloud has points 0 to "
            f"{len(points) - 1}: give numbers of these."
        )
    return points, np.ascontiguousarray(rows, dtype=np.int32)


def check_pieces(pieces: Pieces) -> tuple[Vector, Vector, StoredIndices, NDArray[np.uint8]]:
    """Vertices (V, 3) [m], bulges (V,), strokes (V,) and closed (S,) as the engine takes them.

    Raises
    ------
    SceneError
        Shapes that do not fit, a bulge beyond a half circle, or strokes that are not numbered 0, 1,
        ... in order.
    """
    vertices = check_points(pieces.vertices)
    count = len(vertices)
    bulges = np.array(pieces.bulges, np.float64)
    stroke = np.asarray(pieces.stroke)
    closed = np.asarray(pieces.closed)
    if bulges.shape != (count,) or stroke.shape != (count,):
        raise SceneError(
            f"bulges has shape {bulges.shape} and stroke {stroke.shape}. Give one of each for the "
            f"{count} vertices."
        )
    largest = float(np.abs(bulges).max())
    if not largest <= 1:  # NaN is refused too.
        raise SceneError(
            f"a bulge is {largest:g}. Give bulges of at most 1, which is a half circle.",
            numbers={"bulge": largest},
        )
    is_ordered = np.isin(np.diff(stroke), (0, 1)).all()
    if not is_ordered or stroke[0] != 0 or stroke[-1] != len(closed) - 1:
        raise SceneError(
            f"strokes of vertices are not in order. Number them from 0 to {len(closed) - 1}."
        )
    return vertices, bulges, stroke.astype(np.int32), closed.astype(np.uint8)


def check_stiffness(stiffness: float | ArrayLike) -> Vector:
    """The diagonal of K as (3,) [N/m], of which the core checks the range."""
    entries = real_array(stiffness, "stiffness", SettingError)
    if entries.shape not in ((), (3,)):
        raise SettingError(
            f"stiffness has shape {entries.shape}. Give one number, or one for each axis: (3,)."
        )
    return np.array(np.broadcast_to(entries, 3))


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
        return np.array(AXES[axis])
    direction = real_array(axis, "ignore_axis", SettingError)
    if direction.shape != (3,):
        raise SettingError(f"ignore_axis has shape {direction.shape}. Give x, y and z: (3,).")
    largest = float(np.max(np.abs(direction)))
    if not (math.isfinite(largest) and largest > 0):
        raise SettingError(
            f"ignore_axis is {direction.tolist()}. Give finite numbers that are not all 0.",
            numbers={"ignore_axis": direction.tolist()},
        )
    if largest < 2 and abs(float(np.linalg.norm(direction)) - 1) < UNIT_TOLERANCE:
        return direction.copy()
    # Scaled first, so that the norm neither overflows nor underflows.
    direction = direction / largest
    return direction / np.linalg.norm(direction)


def real_array(values: Any, name: str, error: type[VfplanError] = SceneError) -> Vector:
    """Values as contiguous float64 of their own shape; raises an error for no numbers."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise error(
            f"{name} has rows of different length. Give an array of real numbers."
        ) from None
    if array.dtype.kind not in "fiu":
        raise error(f"{name} has type {array.dtype}. Give real numbers (float64).")
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
) -> float:
    """One finite number within its range, as a float.

    Parameters
    ----------
    above, least, most
        The value must be above the first, at least the second and at most the third.

    Raises
    ------
    SettingError
        Anything else. The message has the value and the range, `numbers` the value by its name.
    """
    checked = real_number(name, value)
    is_above = above is None or checked > above
    is_within = (least is None or checked >= least) and (most is None or checked <= most)
    if math.isfinite(checked) and is_above and is_within:
        return checked
    limits = (("above", above), ("at least", least), ("at most", most))
    bounds = " and ".join(f"{word} {limit:g}" for word, limit in limits if limit is not None)
    unit = f" {unit}" if unit else ""
    of = "of " if above is None else ""
    message = f"{name} is {checked:g}{unit}. Give a value {of}{bounds}{unit}."
    raise SettingError(message, numbers={name: checked})


def real_number(name: str, value: Any) -> float:
    """One number as a float; raises `SettingError` for anything else. The core checks its range."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise SettingError(f"{name} is {value!r}. Give one number.")
    return float(value)


@contextmanager
def core_settings(**units: str) -> Iterator[None]:
    """Raise what the core finds out of its range as `SettingError`, with the core's own sentences.

    `units` says of the core's parameters which unit the caller's name of each ends with.
    """
    try:
        yield
    except _core.OutOfRange as error:
        message, name, value = error.args
        chosen = f"{name}_{units[name]}" if name in units else name
        raise SettingError(message.replace(name, chosen, 1), numbers={chosen: value}) from None


@contextmanager
def core_errors(kind: type[VfplanError]) -> Iterator[None]:
    """Raise what the core refuses as an error of `kind`, with the core's own sentence."""
    try:
        yield
    except ValueError as error:
        if isinstance(error, VfplanError):
            raise
        raise kind(str(error.args[0]).removeprefix("vfplan: ")) from None
