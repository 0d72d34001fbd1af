"""What a tick takes, checked, and what every engine answers with."""

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
        check_range(position[None, :], name)
    return position


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
