"""What the engines accept: clouds, HIP positions, stiffness, directions, numbers.

Each check returns the value in the one form that the engines use, or raises with the value found
and what is allowed. Nothing is repaired.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import SceneError, SettingError

MOST_POINTS = 4_000_000  # in one bundle (schemas/bundle-1.1.json); more are refused unmade
LIMIT = 1e6  # |coordinate| [m]: beyond it float64 no longer resolves a nanometre
UNIT = 1e-9  # how far from 1 the length of a unit vector may be, as in parameters.hpp
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}

Vector = NDArray[np.float64]


def check_points(points: ArrayLike) -> Vector:
    """A cloud as (N, 3) contiguous float64 [m]; `SceneError` when it cannot be one."""
    cloud = real_array(points, "points")
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise SceneError(f"points of shape {cloud.shape}: allowed is (N, 3)")
    if len(cloud) == 0:
        raise SceneError("points of shape (0, 3): at least one point is needed")
    _check_range(cloud, "point")
    return cloud


def check_edit(
    remove: ArrayLike | None, add: ArrayLike | None
) -> tuple[NDArray[np.uint32], Vector]:
    """Numbers of points to remove (n,) and points to add (m, 3) [m]; else `SceneError`."""
    gone = np.asarray([] if remove is None else remove)
    if gone.ndim != 1 or (gone.size and gone.dtype.kind not in "iu"):
        raise SceneError(f"remove of shape {gone.shape}, {gone.dtype}: allowed is (n,), integers")
    if gone.size and not 0 <= gone.min() <= gone.max() < 2**32:
        raise SceneError(f"remove {gone.min()} to {gone.max()}: allowed are numbers of points")
    new = np.empty((0, 3)) if add is None or np.size(add) == 0 else check_points(add)
    return np.ascontiguousarray(gone, dtype=np.uint32), new


def check_path(hips: ArrayLike, name: str = "hips") -> Vector:
    """HIP positions as (T, 3) contiguous float64 [m]; non-finite ones are left to the engine."""
    path = real_array(hips, name)
    if path.ndim != 2 or path.shape[1] != 3:
        raise SceneError(f"{name} of shape {path.shape}: allowed is (T, 3)")
    return path


def check_hip(hip: ArrayLike, name: str = "hip", *, finite: bool = False) -> Vector:
    """One HIP as (3,) float64 [m]; with `finite`, NaN and infinity raise `SceneError`."""
    position = real_array(hip, name)
    if position.shape != (3,):
        raise SceneError(f"{name} of shape {position.shape}: allowed is (3,)")
    if finite:
        _check_range(position[None, :], name)
    return position


def check_stiffness(stiffness: float | ArrayLike) -> Vector:
    """The diagonal of K as (3,) [N/m], every entry above 0; else `SettingError`."""
    try:
        k = real_array(stiffness, "stiffness")
    except SceneError as error:
        raise SettingError(error.message) from None
    if k.shape not in {(), (3,)}:
        raise SettingError(f"stiffness of shape {k.shape}: allowed is one number or (3,)")
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
    try:
        direction = real_array(axis, "ignore_axis")
    except SceneError as error:
        raise SettingError(error.message) from None
    if direction.shape != (3,):
        raise SettingError(f"ignore_axis of shape {direction.shape}: allowed is (3,)")
    largest = float(np.max(np.abs(direction)))
    if not (math.isfinite(largest) and largest > 0):
        raise SettingError(f"ignore_axis {direction.tolist()}: must be finite and not zero")
    if largest < 2 and abs(float(np.linalg.norm(direction)) - 1) < UNIT:
        return _frozen(direction.copy())
    direction = direction / largest  # first, so that the norm neither over- nor underflows
    return _frozen(direction / np.linalg.norm(direction))


def real_array(values: Any, name: str) -> Vector:
    """Values as contiguous float64 of their own shape; `SceneError` when they are no numbers."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise SceneError(f"{name}: rows of different length; allowed is an array") from None
    if array.dtype.kind not in "fiu":
        raise SceneError(f"{name} of dtype {array.dtype}: allowed are real numbers (float64)")
    return np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)


def _check_range(rows: Vector, name: str) -> None:
    good = np.all(np.abs(rows) <= LIMIT, axis=1)  # false on NaN
    if not good.all():
        i = int(np.argmin(good))
        found = rows[i].tolist()
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
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise SettingError(f"{name} {value!r}: allowed is one number")
    found = float(value)
    allowed = " and ".join(
        f"{text} {bound:g}"
        for text, bound in (("above", above), ("at least", least), ("at most", most))
        if bound is not None
    )
    holds = (
        math.isfinite(found)
        and (above is None or found > above)
        and (least is None or found >= least)
        and (most is None or found <= most)
    )
    if not holds:
        reason = f" ({why})" if why else ""
        unit = f" {unit}" if unit else ""
        raise SettingError(f"{name} {found:g}{unit}: allowed is {allowed}{unit}{reason}")
    return found


def _frozen(array: Vector) -> Vector:
    array.flags.writeable = False
    return array
