"""What an engine answers with, and the checks of the positions that it is given."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.engine.parameters import Vector, check_points, check_range, real_array
from vfplan.errors import SceneError


class Status(IntFlag):
    """What a tick has to say beside its result; 0 when all is well."""

    OK = 0
    BAD_HIP = 1
    """The HIP was not finite, or beyond 1e6 m. The proxy stayed, and the force is the last one.

    Before the first good HIP proxy and force are 0.
    """
    INSIDE = 2
    """The proxy is inside the fixture and on its way out."""
    LIMIT = 4
    """The tick used up its iterations. The proxy is safe and goes on at the next tick."""
    STALE = 8
    """The moving fixture's pose is too old, and its last frame stands.

    Before the first pose nothing is rendered.
    """
    CHANGING = 16
    """The fixture was exchanged or edited, and the force is on its way to K (proxy - HIP)."""
    CROSSED = 32
    """With INSIDE: no way out was found on the side where the proxy was before the exchange."""


@dataclass(frozen=True, eq=False)
class Step:
    """The answer of one tick.

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
    """The answer to a path, one row a tick, with the fields of `Step`.

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
        """The trace of steps that follow each other."""
        count = len(steps)
        trace = cls(
            proxy=np.empty((count, 3)),
            normal=np.empty((count, 3)),
            force=np.empty((count, 3)),
            state=np.empty(count, np.int8),
            status=np.empty(count, np.uint8),
        )
        for row, step in enumerate(steps):
            trace.proxy[row] = step.proxy
            trace.normal[row] = step.normal
            trace.force[row] = step.force
            trace.state[row] = step.state
            trace.status[row] = step.status
        return trace


def check_path(hips: ArrayLike, name: str = "hips") -> Vector:
    """HIP positions as (T, 3) contiguous float64 [m].

    Positions that are not finite are left to the engine. Raises `SceneError` for another shape.
    """
    path = real_array(hips, name)
    if path.ndim != 2 or path.shape[1] != 3:
        raise SceneError(f"{name} has shape {path.shape}. Give one position a row: (T, 3).")
    return path


def check_hip(hip: ArrayLike, name: str = "hip", *, finite: bool = False) -> Vector:
    """One position as (3,) float64 [m].

    Raises `SceneError` for another shape. With `finite` it also raises it for NaN, infinity, and a
    coordinate beyond 1e6 m.
    """
    position = real_array(hip, name)
    if position.shape != (3,):
        raise SceneError(f"{name} has shape {position.shape}. Give x, y and z: (3,).")
    if finite:
        check_range(position[None, :], name)
    return position


def check_edit(
    remove: ArrayLike | None, add: ArrayLike | None
) -> tuple[NDArray[np.uint32], Vector]:
    """Numbers of points to remove (n,) and points to add (m, 3) [m].

    Raises `SceneError` for what cannot be such numbers or points.
    """
    if remove is None:
        remove = []
    removed = np.asarray(remove)
    if removed.ndim != 1 or (removed.size > 0 and removed.dtype.kind not in "iu"):
        raise SceneError(
            f"remove has shape {removed.shape} and type {removed.dtype}. Give the numbers of the "
            "points as (n,) integers."
        )
    if removed.size > 0 and (removed.min() < 0 or removed.max() >= 2**32):
        raise SceneError(
            f"remove holds {removed.min()} to {removed.max()}. Give numbers of points, which begin "
            "with 0."
        )
    added = np.empty((0, 3))
    if add is not None and np.size(add) > 0:
        added = check_points(add)
    return np.ascontiguousarray(removed, dtype=np.uint32), added
