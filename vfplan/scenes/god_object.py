"""The exact proxy: descend |x - HIP| over the free space until nothing nearer is within reach.

This is the god-object of Zilles and Salisbury (1995) for a ball of radius R among exact pieces. It
is slow and takes small steps on purpose: a proxy that slides there continuously, and no other
local minimum, is the truth that the engines are measured against.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vfplan.engine.parameters import Vector
from vfplan.errors import SceneError
from vfplan.scenes.outline import Look, Shape

# Longest step along a contact, in R.
STRIDE = 0.1

# Below this step, in R, Newton's method is tried on the pieces that hold the proxy.
CLOSE = 1e-2

# Below this step, in R, nothing more is gained.
SETTLED = 1e-10

# Number of steps after which a proxy counts as lost.
MAX_STEPS = 20000

# Number of Newton's steps; it doubles the correct digits in each.
MAX_NEWTON_STEPS = 8

# Number of steps back into the free space; two or three are usual.
MAX_RESTORING_STEPS = 30


def look(pieces: Shape, x: Vector) -> Look:
    """Distances, gradients and Hessians of all pieces at x (3,)."""
    looks = [piece.look(x) for piece in pieces]
    return Look(*map(np.concatenate, zip(*looks, strict=True)))


def follow(pieces: Shape, proxy: Vector, hip: Vector, radius: float) -> Vector:
    """The local minimum of |x - hip| over the free space that a proxy slides into.

    Parameters
    ----------
    pieces
        The exact geometry.
    proxy
        (3,) where the proxy was [m]: in the free space.
    hip
        (3,) [m].
    radius
        R = r_c + r_v [m].

    Raises
    ------
    SceneError
        The proxy starts inside the fixture by more than a rounding, or never settles.
    """
    *_, minimum = slide(pieces, proxy, hip, radius)
    return minimum


def slide(pieces: Shape, proxy: Vector, hip: Vector, radius: float) -> Iterator[Vector]:
    """The positions (3,) [m] that `follow` goes through, its minimum the last.

    Each lies in the free space, less than R / 7 from the one before or no further from it than the
    fixture is: so nothing is jumped over.
    """
    # Lengths are in R, so that all tolerances are relative.
    scale = 1.0 / radius
    x, target = proxy * scale, hip * scale
    view = _look_scaled(pieces, x, scale)
    if view.distance.min() < 1 - 1e-9:
        distance_m = float(view.distance.min() * radius)
        raise SceneError(
            f"the proxy is {distance_m:g} m from the fixture, nearer than R = {radius:g} m. "
            "Start further away",
            code="starts-inside", numbers={"distance_m": distance_m, "radius_m": radius},
        )  # fmt: skip
    stride = STRIDE
    for _ in range(MAX_STEPS):
        reach = max(stride, float(view.distance.min()) - 1)
        v, weight = _nearest_step(target - x, view, 2 * reach)
        length = float(np.linalg.norm(v))
        if length < CLOSE:
            minimum = _exact_minimum(pieces, x, target, view, weight, scale)
            if minimum is not None and np.linalg.norm(minimum - x) < 10 * length + SETTLED:
                yield minimum * radius
                return
        if length < SETTLED or stride < SETTLED:
            yield x * radius
            return

        # A hollow piece curves into a straight step, so the step ends with the shortest one back
        # into the free space. In a narrow place there may be none.
        y = x + v * min(1.0, reach / length)
        y_view = _look_scaled(pieces, y, scale)
        for _ in range(MAX_RESTORING_STEPS):
            if y_view.distance.min() >= 1 - 1e-15:
                break
            back, _ = _nearest_step(np.zeros(3), y_view, STRIDE)
            y = y + back
            y_view = _look_scaled(pieces, y, scale)
        is_free = y_view.distance.min() > 1 - 1e-12
        if is_free and np.linalg.norm(y - target) < np.linalg.norm(x - target):
            x, view, stride = y, y_view, min(2 * stride, STRIDE)
            yield x * radius
        else:
            stride /= 4
    raise SceneError(
        f"the exact proxy for hip {hip.tolist()} did not settle in {MAX_STEPS} steps. Move "
        "it in smaller steps",
        code="not-settled",
    )


def _look_scaled(pieces: Shape, x: Vector, scale: float) -> Look:
    """As `look`, with lengths in R."""
    view = look(pieces, x / scale)
    return Look(view.distance * scale, view.normal, view.hessian / scale)


def _nearest_step(w: Vector, view: Look, reach: float) -> tuple[Vector, Vector]:
    """The step closest to w that keeps, to first order, every close distance at 1 or above.

    Returns the step and the weight (M,) of each piece that bounds it. Solved as a least-distance
    problem by non-negative least squares (Lawson and Hanson, "Solving Least Squares Problems",
    chapter 23).
    """
    from scipy.optimize import nnls

    weight = np.zeros(len(view.distance))
    close = np.flatnonzero(view.distance < 1 + reach)
    slack = view.normal[close] @ w - (1 - view.distance[close])
    if close.size == 0 or slack.min() >= 0:
        return w, weight
    # The division keeps the problem well scaled for tiny steps.
    size = float(np.abs(slack).max())
    system = np.vstack([view.normal[close].T, -slack / size])
    dual, _ = nnls(system, np.array([0.0, 0.0, 0.0, 1.0]), maxiter=100 * (close.size + 3))
    residual = system @ dual - [0.0, 0.0, 0.0, 1.0]
    if residual[3] > -1e-14:
        # Squeezed from all sides there is no step.
        return np.zeros(3), weight
    weight[close] = dual / -residual[3] * size
    return w - residual[:3] / residual[3] * size, weight


def _exact_minimum(
    pieces: Shape, x: Vector, hip: Vector, view: Look, weight: Vector, scale: float
) -> Vector | None:
    """The exact minimum on the pieces that hold x; `None` where it is not one.

    Newton's method on the conditions of Karush, Kuhn and Tucker: the pull towards the HIP is a sum
    of pushes from the pieces that hold the proxy, and the proxy touches each of those.
    """
    active = np.flatnonzero(weight > 1e-12)
    if active.size == 0:
        # Nothing holds the proxy: it is at the HIP.
        y, holds = hip, True
    else:
        y, force, count = x, weight[active], active.size
        error = np.full(3 + count, np.inf)
        for _ in range(MAX_NEWTON_STEPS):
            normal = view.normal[active]
            system = np.zeros((3 + count, 3 + count))
            system[:3, :3] = np.eye(3) - np.einsum("k,kij->ij", force, view.hessian[active])
            system[:3, 3:] = -normal.T
            system[3:, :3] = normal
            error = np.concatenate([y - hip - force @ normal, view.distance[active] - 1])
            if np.abs(error).max() < 1e-14:
                break
            change = np.linalg.lstsq(system, -error, rcond=1e-12)[0]
            y = y + change[:3]
            force = force + change[3:]
            view = _look_scaled(pieces, y, scale)
        holds = force.min() > -1e-9 and np.abs(error).max() < 1e-12
    is_free = _look_scaled(pieces, y, scale).distance.min() > 1 - 1e-12
    is_closer = np.linalg.norm(y - hip) < np.linalg.norm(x - hip) + 1e-12
    return y if holds and is_free and is_closer else None
