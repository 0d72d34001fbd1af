"""The transforms that markers can determine: solving for them, and how errors move them.

All in normalised coordinates: a source point s is centred and scaled to unit RMS radius (metric
where the model needs it), a target y is centred [m], x~ = [s, 1], and y = M x~ with M (3, k+1).

- affine: M is free; ordinary (or weighted) least squares.
- similarity: M = [a R | t]; S. Umeyama, "Least-squares estimation of transformation parameters
  between two point patterns", IEEE PAMI 13 (1991).
- rigid: a is known. K. S. Arun et al., IEEE PAMI 9 (1987), with Umeyama's sign.

A planar source is embedded at z = 0, so that its rotation is a proper rotation in space.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ModelName = Literal["affine", "similarity", "rigid"]
MODELS: tuple[ModelName, ...] = ("affine", "similarity", "rigid")
LONGEST_TURN = 0.3  # rad, and of the log of the scale, in one step
HALVINGS = 20


@dataclass(frozen=True)
class Affine:
    """Any linear map and a translation: 3 (k + 1) parameters."""

    dimension: int
    name: ModelName = "affine"

    @property
    def parameters(self) -> int:
        """Number of free parameters p."""
        return 3 * (self.dimension + 1)

    @property
    def minimal(self) -> int:
        """Markers that determine the transform without a residual."""
        return self.dimension + 1

    def solve(self, s: Array, y: Array, w: Array) -> Array:
        """M (..., 3, k+1) that minimises the weighted squares; s (..., N, k), y and w (..., N, 3).

        By QR, so that the condition number is not squared.
        """
        x = homogeneous(s)
        if not np.ptp(w, axis=-1).any():
            return np.swapaxes(_weighted_lstsq(x, y, w[..., 0]), -1, -2)
        axes = [_weighted_lstsq(x, y[..., a : a + 1], w[..., a]) for a in range(3)]
        return np.swapaxes(np.concatenate(axes, axis=-1), -1, -2)

    def through(self, s: Array, y: Array) -> Array:
        """M (..., 3, k+1) through exactly k + 1 markers."""
        return np.swapaxes(np.linalg.solve(homogeneous(s), y), -1, -2)

    def tangent(self, m: Array) -> Array:
        """(3 (k+1), p): how row-major M moves with each parameter."""
        return np.eye(self.parameters)


@dataclass(frozen=True)
class Orthogonal:
    """A rotation and a translation; with `scale=None` a scale too (similarity)."""

    dimension: int
    scale: float | None
    name: ModelName

    @property
    def parameters(self) -> int:
        """Number of free parameters p."""
        return 7 if self.scale is None else 6

    @property
    def minimal(self) -> int:
        """Markers that determine the transform."""
        return 3

    def solve(self, s: Array, y: Array, w: Array) -> Array:
        """M (..., 3, k+1) that minimises the weighted squares; s (..., N, k), y and w (..., N, 3).

        Closed form where a marker's three weights are equal; with a weight an axis, Gauss-Newton
        from the closed form of their means.
        """
        m = _procrustes(s, y, w.mean(axis=-1), self.scale)
        if not np.ptp(w, axis=-1).any():
            return m
        batch = m.shape[:-2]
        flat = (
            np.broadcast_to(a, (*batch, *a.shape[-2:])).reshape(-1, *a.shape[-2:])
            for a in (s, y, w, m)
        )
        refined = [self._refine(*one) for one in zip(*flat, strict=True)]
        return np.array(refined).reshape(m.shape)

    def through(self, s: Array, y: Array) -> Array:
        """M (..., 3, k+1) that fits three markers best, as if they were equally good."""
        return _procrustes(s, y, np.ones(y.shape[:-1]), self.scale)

    def tangent(self, m: Array) -> Array:
        """(3 (k+1), p): how row-major M moves with a rotation, a translation (and log scale)."""
        k = self.dimension
        moves = np.zeros((3, k + 1, self.parameters))
        for axis in range(3):
            moves[:, :k, axis] = np.cross(np.eye(3)[axis], m[:, :k], axis=0)
            moves[axis, k, 3 + axis] = 1.0
        if self.scale is None:
            moves[:, :k, 6] = m[:, :k]
        return moves.reshape(3 * (k + 1), self.parameters)

    def _refine(self, s: Array, y: Array, w: Array, m: Array) -> Array:
        """The least squares near M; a step is halved until it lessens them, so none runs away."""
        x, root = homogeneous(s), np.sqrt(w)
        error = root * (y - x @ m.T)
        for _ in range(50):
            rows = root.reshape(-1, 1) * (marker_rows(x) @ self.tangent(m))
            step = np.linalg.lstsq(rows, error.ravel(), rcond=None)[0]
            step *= min(1.0, LONGEST_TURN / max(np.abs(np.delete(step, [3, 4, 5])).max(), 1e-300))
            least = float((error**2).sum())
            for _ in range(HALVINGS):
                moved = self.moved(m, step)
                found = root * (y - x @ moved.T)
                if (found**2).sum() < least:
                    break
                step /= 2
            else:
                break
            m, error = moved, found
            if (error**2).sum() > (1 - 1e-14) * least:
                break
        return m

    def moved(self, m: Array, step: Array) -> Array:
        """M after a rotation, a translation (and log scale) as in `tangent`."""
        k = self.dimension
        linear = rotation(step[:3]) @ m[:, :k]
        if self.scale is None:
            linear = linear * np.exp(step[6])
        return np.column_stack([linear, m[:, k] + step[3:6]])


Model = Affine | Orthogonal


def make_model(name: ModelName, dimension: int, metric_scale: float) -> Model:
    """The model by name; `metric_scale` is metres in one unit of the normalised source."""
    if name == "affine":
        return Affine(dimension)
    return Orthogonal(dimension, None if name == "similarity" else metric_scale, name)


def homogeneous(s: Array) -> Array:
    """[s, 1] along the last axis."""
    return np.concatenate([s, np.ones((*s.shape[:-1], 1))], axis=-1)


def marker_rows(x: Array) -> Array:
    """(3N, 3 (k+1)): row-major M -> the N predicted positions, from x~ (N, k+1)."""
    return np.einsum("ab,ni->nabi", np.eye(3), x).reshape(3 * len(x), -1)


def homography(h: Array, s: Array) -> Array:
    """Positions (N, 3) of s (N, 2): y = M x~ / (1 + q·s), by row-major M, then q (11,)."""
    return homogeneous(s) @ h[:9].reshape(3, 3).T / (1 + s @ h[9:])[:, None]


def homography_rows(h: Array, s: Array) -> Array:
    """(N, 3, 11): how they move with h."""
    below = (1 + s @ h[9:])[:, None, None]
    linear = marker_rows(homogeneous(s)).reshape(len(s), 3, 9) / below
    bent = -homography(h, s)[:, :, None] * s[:, None, :] / below
    return np.concatenate([linear, bent], axis=2)


def root_of_inverse(rows: Array) -> Array:
    """(p, p) A with A Aᵀ the inverse of XᵀX, from X (n, p): with a positive diagonal, so unique."""
    r = np.linalg.qr(rows, mode="r")
    return np.linalg.solve(r * np.sign(np.diag(r))[:, None], np.eye(len(r)))


def rotation(axis_angle: Array) -> Array:
    """The rotation matrix of a rotation vector [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(axis_angle).as_matrix()


def _weighted_lstsq(x: Array, y: Array, w: Array) -> Array:
    """(..., k+1, D) for x (..., N, k+1), y (..., N, D), w (..., N)."""
    root = np.sqrt(w)[..., None]
    q, r = np.linalg.qr(root * x)
    return np.linalg.solve(r, np.swapaxes(q, -1, -2) @ (root * y))


def _procrustes(s: Array, y: Array, w: Array, scale: float | None) -> Array:
    """Umeyama's solution, with weights (..., N); a planar source stands at z = 0."""
    k = s.shape[-1]
    if k == 2:
        s = np.concatenate([s, np.zeros((*s.shape[:-1], 1))], axis=-1)
    total = w.sum(axis=-1)[..., None]
    s_mean = np.einsum("...n,...nk->...k", w, s) / total
    y_mean = np.einsum("...n,...nk->...k", w, y) / total
    s0, y0 = s - s_mean[..., None, :], y - y_mean[..., None, :]
    u, d, vt = np.linalg.svd(np.einsum("...n,...na,...nb->...ab", w, y0, s0))
    sign = np.ones_like(d)
    sign[..., 2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    r = (u * sign[..., None, :]) @ vt
    if scale is None:
        size = np.einsum("...n,...na,...na->...", w, s0, s0)
        r = r * ((d * sign).sum(axis=-1) / size)[..., None, None]
    else:
        r = r * scale
    t = y_mean - np.einsum("...ab,...b->...a", r, s_mean)
    return np.concatenate([r[..., :k], t[..., None]], axis=-1)


@dataclass(frozen=True, eq=False)
class Geometry:
    """The linear part A (3, k) of T, taken apart."""

    # (k,) metres in a source unit along the principal directions, largest first
    singular_values: Array
    axis_scales: Array  # (k,) length of each column: metres in a unit along u, v (or x, y, z)
    anisotropy: float  # s_1 / s_k - 1; 0 for square pixels
    shear: float  # largest |cosine| of the angle between two columns, signed; 0 for a right angle
    # (3,) unit u x v of a planar source in the target frame: with u to the right and v down it
    # points away from who looks at the image. `None` for a 3-D source.
    normal: Array | None

    @property
    def scale(self) -> float:
        """Geometric mean of the singular values."""
        return float(np.exp(np.log(self.singular_values).mean()))


def geometry(transform: Array) -> Geometry:
    """Take apart a T (3, 3) of a planar source or (4, 4) of a 3-D one."""
    planar = transform.shape[0] == 3
    a = transform[:3, : 2 if planar else 3]
    values = np.linalg.svd(a, compute_uv=False)
    lengths = np.linalg.norm(a, axis=0)
    cosines = (a.T @ a / np.outer(lengths, lengths))[np.triu_indices(a.shape[1], 1)]
    normal = np.cross(a[:, 0], a[:, 1]) if planar else None
    return Geometry(
        values,
        lengths,
        float(values[0] / values[-1] - 1),
        float(cosines[np.abs(cosines).argmax()]),
        None if normal is None else normal / np.linalg.norm(normal),
    )
