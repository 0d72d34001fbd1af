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
from vfplan.scenes.primitives import Look, Pieces, stack

STRIDE = 0.1  # longest step along a contact, in R
CLOSE = 1e-2  # below this step, in R, Newton's method is tried on the pieces that hold the proxy
SETTLED = 1e-10  # below this step, in R, nothing more is gained
STEPS = 20000


def look(pieces: tuple[Pieces, ...], x: Vector) -> Look:
    """Distances, gradients and Hessians of all pieces at x (3,)."""
    return stack([piece.look(x) for piece in pieces])


def follow(pieces: tuple[Pieces, ...], proxy: Vector, hip: Vector, radius: float) -> Vector:
    """The local minimum of |x - hip| over the free space that a proxy slides into.

    pieces: the exact geometry
    proxy: (3,) where the proxy was [m]: in the free space
    hip: (3,) [m]
    radius: R = r_c + r_v [m]
    Raises SceneError: the proxy starts inside the fixture by more than a rounding, or finds no rest
    """
    *_, rest = way(pieces, proxy, hip, radius)
    return rest


def way(pieces: tuple[Pieces, ...], proxy: Vector, hip: Vector, radius: float) -> Iterator[Vector]:
    """The positions (3,) [m] that `follow` goes through, its rest the last.

    Each lies in the free space, less than R / 7 from the one before or no further from it than the
    fixture is: so nothing is jumped over.
    """
    scale = 1.0 / radius
    x, target = proxy * scale, hip * scale  # lengths in R: all tolerances are relative
    seen = _look_scaled(pieces, x, scale)
    if seen.distance.min() < 1 - 1e-9:
        where = float(seen.distance.min() * radius)
        raise SceneError(f"proxy at {where:g} m from the fixture: allowed is R = {radius:g} m")
    stride = STRIDE
    for _ in range(STEPS):
        reach = max(stride, float(seen.distance.min()) - 1)
        v, weight = _nearest_step(target - x, seen, 2 * reach)
        length = float(np.linalg.norm(v))
        if length < CLOSE:
            y = _newton(pieces, x, target, seen, weight, scale)
            if y is not None and np.linalg.norm(y - x) < 10 * length + SETTLED:
                yield y * radius
                return
        if length < SETTLED or stride < SETTLED:
            yield x * radius
            return
        y, after = _restore(pieces, x + v * min(1.0, reach / length), scale)
        free = after.distance.min() > 1 - 1e-12  # in a narrow place there may be no way out
        if free and np.linalg.norm(y - target) < np.linalg.norm(x - target):
            x, seen, stride = y, after, min(2 * stride, STRIDE)
            yield x * radius
        else:
            stride /= 4
    raise SceneError(f"the exact proxy for hip {hip.tolist()} found no rest in {STEPS} steps")


def sensitivity(pieces: tuple[Pieces, ...], proxy: Vector, hip: Vector, radius: float) -> float:
    """How far the exact proxy moves for a small step of the HIP, at most, over that step's length.

    1 in free motion and on a plane; 1 / (1 - depth/R) on the ball around one point, and without
    bound as the HIP comes to its centre: there no engine can follow. From the conditions of Karush,
    Kuhn and Tucker, by the implicit function theorem: 1 over the least eigenvalue of I - Σ f_j H_j
    in the directions that no touched piece holds.

    pieces, radius: as for `follow`
    proxy, hip: (3,) the exact proxy of this HIP, and the HIP [m]
    """
    from scipy.optimize import nnls

    seen = look(pieces, proxy)
    held = np.flatnonzero(seen.distance < radius * (1 + 1e-9))
    pull = proxy - hip
    if held.size == 0 or np.linalg.norm(pull) < 1e-9 * radius:
        return 1.0
    force, _ = nnls(seen.normal[held].T, pull)
    pushing = force > 1e-9 * force.max(initial=0.0)
    held, force = held[pushing], force[pushing]
    free = _complement(seen.normal[held])
    if not len(free):
        return 0.0
    bent = np.eye(3) - np.einsum("k,kij->ij", force, seen.hessian[held])
    least = np.linalg.eigvalsh(free @ bent @ free.T)[0]
    return float(1 / least) if least > 0 else np.inf


def _complement(rows: Vector) -> Vector:
    """(K, 3) an orthonormal basis of what is across all rows (M, 3)."""
    _, size, basis = np.linalg.svd(rows)
    return basis[int((size > 1e-6).sum()) :]


def _look_scaled(pieces: tuple[Pieces, ...], x: Vector, scale: float) -> Look:
    seen = look(pieces, x / scale)
    return Look(seen.distance * scale, seen.normal, seen.hessian / scale)


def _nearest_step(w: Vector, seen: Look, reach: float) -> tuple[Vector, Vector]:
    """The step nearest to w that keeps, to first order, every near distance at 1 or above.

    Returns the step and the weight (M,) of each piece that bounds it. Solved as a least-distance
    problem by non-negative least squares (Lawson and Hanson, "Solving Least Squares Problems",
    chapter 23).
    """
    from scipy.optimize import nnls

    weight = np.zeros(len(seen.distance))
    near = np.flatnonzero(seen.distance < 1 + reach)
    slack = seen.normal[near] @ w - (1 - seen.distance[near])
    if near.size == 0 or slack.min() >= 0:
        return w, weight
    size = float(np.abs(slack).max())  # keeps the problem well scaled for tiny steps
    system = np.vstack([seen.normal[near].T, -slack / size])
    dual, _ = nnls(system, np.array([0.0, 0.0, 0.0, 1.0]), maxiter=100 * (near.size + 3))
    rest = system @ dual - [0.0, 0.0, 0.0, 1.0]
    if rest[3] > -1e-14:  # squeezed from all sides: no step
        return np.zeros(3), weight
    weight[near] = dual / -rest[3] * size
    return w - rest[:3] / rest[3] * size, weight


def _restore(pieces: tuple[Pieces, ...], x: Vector, scale: float) -> tuple[Vector, Look]:
    """Back into the free space by the shortest way, and what is seen from there.

    A hollow piece curves into a straight step.
    """
    seen = _look_scaled(pieces, x, scale)
    for _ in range(30):
        if seen.distance.min() >= 1 - 1e-15:
            break
        v, _ = _nearest_step(np.zeros(3), seen, STRIDE)
        x = x + v
        seen = _look_scaled(pieces, x, scale)
    return x, seen


def _newton(pieces, x: Vector, hip: Vector, seen: Look, weight: Vector, scale: float):
    """The exact rest on the pieces that hold x; `None` where it is not one.

    Newton's method on the conditions of Karush, Kuhn and Tucker: the pull towards the HIP is a sum
    of pushes from the pieces that hold the proxy, and each of those is touched.
    """
    held = np.flatnonzero(weight > 1e-12)
    y, force = (x, weight[held]) if held.size else (hip, weight[held])
    for _ in range(8 if held.size else 0):
        k = held.size
        system = np.zeros((3 + k, 3 + k))
        system[:3, :3] = np.eye(3) - np.einsum("k,kij->ij", force, seen.hessian[held])
        system[:3, 3:], system[3:, :3] = -seen.normal[held].T, seen.normal[held]
        wrong = np.concatenate([y - hip - force @ seen.normal[held], seen.distance[held] - 1])
        if np.abs(wrong).max() < 1e-14:
            break
        change = np.linalg.lstsq(system, -wrong, rcond=1e-12)[0]
        y, force = y + change[:3], force + change[3:]
        seen = _look_scaled(pieces, y, scale)
    rests = not held.size or (force.min() > -1e-9 and np.abs(wrong).max() < 1e-12)
    free = _look_scaled(pieces, y, scale).distance.min() > 1 - 1e-12
    nearer = np.linalg.norm(y - hip) < np.linalg.norm(x - hip) + 1e-12
    return y if rests and free and nearer else None
