"""The guarantees of the robust rule as brute-force checks that know nothing of the engine.

Each check takes what happened, looks at every point of the cloud, and returns (T,) booleans or
numbers, a value a tick. Nothing here is shared with the product: distances are NumPy's, free space
is painted on a raster.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SLACK = 1e-11  # rounding [m] in a scene of a metre


@dataclass(frozen=True)
class Past:
    """What an engine did: cloud, radii, and a row a tick; all across an ignored axis.

    `before` (T, 3) is the proxy that each tick began with.
    """

    points: np.ndarray
    radius: float
    band: float
    hip: np.ndarray
    before: np.ndarray
    proxy: np.ndarray
    state: np.ndarray

    @property
    def pull(self):
        """(T,) |proxy - HIP| [m]."""
        return np.linalg.norm(self.proxy - self.hip, axis=1)


def across(x, axis):
    return x if axis is None else x - np.multiply.outer(x @ axis, axis)


def clearance(past: Past, x) -> np.ndarray:
    """(T,) distance to the nearest point [m]."""
    return np.linalg.norm(x[:, None] - past.points[None], axis=2).min(axis=1)


def never_inside(past: Past) -> np.ndarray:
    """1. How far the proxy is below R - band at the end of each tick that began free [m]."""
    limit = past.radius - past.band
    began = clearance(past, past.before) >= limit - SLACK
    return np.where(began, np.maximum(limit - clearance(past, past.proxy), 0.0), 0.0)


def free_to_go(past: Past) -> np.ndarray:
    """2. Whether nothing lies between proxy and HIP.

    Nothing does when each point that the straight way passes within R + band is left behind: the
    way's nearest position to it is the start. The start must be outside, the HIP at R or further.
    """
    u = past.hip - past.before
    w = past.points[None] - past.before[:, None]
    ahead = np.einsum("tnk,tk->tn", w, u)
    square = np.einsum("tk,tk->t", u, u)[:, None]
    t = np.clip(ahead / np.where(square > 0, square, 1.0), 0.0, 1.0)
    near = np.linalg.norm(w - t[:, :, None] * u[:, None], axis=2)
    blocked = (near < past.radius + past.band) & (ahead > 0)
    outside = np.linalg.norm(w, axis=2).min(axis=1) >= past.radius - past.band
    clear = clearance(past, past.hip) >= past.radius
    return ~blocked.any(axis=1) & outside & clear


def growth(past: Past) -> np.ndarray:
    """3. How much |proxy - HIP| grew in each tick, the HIP held where the tick has it [m]."""
    return past.pull - np.linalg.norm(past.before - past.hip, axis=1)


class Rooms:
    """1, swept: the rooms of a plane's free space, painted on a raster.

    A cell counts as free when any position in it may be: two cells of different rooms are then
    surely walled off from each other, and no way leads from one to the other.
    """

    def __init__(self, points, radius: float, frame, cell: float) -> None:
        from scipy.ndimage import label
        from scipy.spatial import cKDTree

        self.frame, self.cell = frame, cell
        flat = points @ frame.T
        self.corner = flat.min(axis=0) - 3 * radius
        count = np.ceil((flat.max(axis=0) + 3 * radius - self.corner) / cell).astype(int) + 1
        i, j = np.meshgrid(*(np.arange(n) for n in count), indexing="ij")
        centres = self.corner + np.stack([i, j], axis=-1).reshape(-1, 2) * cell
        distance = cKDTree(flat).query(centres)[0].reshape(count)
        self.room, self.count = label(distance >= radius - cell, structure=np.ones((3, 3)))

    def of(self, x) -> np.ndarray:
        """(T,) number of the room of each position; what lies off the raster is in the open."""
        at = np.round((x @ self.frame.T - self.corner) / self.cell).astype(np.int64)
        at = np.clip(at, 0, np.array(self.room.shape) - 1)  # the margin is one room
        return self.room[tuple(at.T)]
