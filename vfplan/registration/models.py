"""The transforms that markers can determine: how each is fitted, and how its parameters move it.

Everything here is in normalised coordinates (see `vfplan.registration.problem`). A source point s
is centred and scaled to unit RMS radius, a target y is centred [m], x~ = [s, 1], and y = M x~ with
M of shape (3, k + 1).

- affine: M is free. Ordinary or weighted least squares.
- similarity: M = [a R | t]. S. Umeyama, "Least-squares estimation of transformation parameters
  between two point patterns", IEEE PAMI 13 (1991).
- rigid: the same with a known scale a. K. S. Arun, T. S. Huang and S. D. Blostein, "Least-squares
  fitting of two 3-D point sets", IEEE PAMI 9 (1987), with Umeyama's sign.

A planar source stands at z = 0, so that its rotation is a proper rotation in space.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ModelName = Literal["affine", "similarity", "rigid"]
MODELS: tuple[ModelName, ...] = ("affine", "similarity", "rigid")


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
        """Number of markers that determine the transform without a residual."""
        return self.dimension + 1

    def solve(self, s: Array, y: Array, w: Array) -> Array:
        """M (..., 3, k+1) of least weighted squares, for s (..., N, k), y and w (..., N, 3)."""
        x = homogeneous(s)
        if not np.ptp(w, axis=-1).any():
            return np.swapaxes(_weighted_least_squares(x, y, w[..., 0]), -1, -2)
        # Each target axis has weights of its own, so each is a least squares problem of its own.
        columns = [_weighted_least_squares(x, y[..., a : a + 1], w[..., a]) for a in range(3)]
        return np.swapaxes(np.concatenate(columns, axis=-1), -1, -2)

    def tangent(self, m: Array) -> Array:
        """(3 (k+1), p) derivative of row-major M with respect to the parameters."""
        return np.eye(self.parameters)


@dataclass(frozen=True)
class Orthogonal:
    """A rotation and a translation, and a scale where `scale` is `None` (similarity)."""

    dimension: int
    scale: float | None
    name: ModelName

    @property
    def parameters(self) -> int:
        """Number of free parameters p."""
        return 7 if self.scale is None else 6

    @property
    def minimal(self) -> int:
        """Number of markers that determine the transform."""
        return 3

    def solve(self, s: Array, y: Array, w: Array) -> Array:
        """M (..., 3, k+1) of least weighted squares, for s (..., N, k), y and w (..., N, 3).

        The closed form holds where the three weights of each marker are equal. Otherwise
        Gauss-Newton starts from the closed form with the means of the weights.
        """
        m = _procrustes(s, y, w.mean(axis=-1), self.scale)
        if not np.ptp(w, axis=-1).any():
            return m
        batch = m.shape[:-2]
        refined = np.empty_like(m)
        for index in np.ndindex(batch):
            refined[index] = self._gauss_newton(
                np.broadcast_to(s, (*batch, *s.shape[-2:]))[index],
                np.broadcast_to(y, (*batch, *y.shape[-2:]))[index],
                np.broadcast_to(w, (*batch, *w.shape[-2:]))[index],
                m[index],
            )
        return refined

    def tangent(self, m: Array) -> Array:
        """(3 (k+1), p) derivative of row-major M with respect to the parameters.

        The parameters are a rotation vector, a translation, and for the similarity the logarithm
        of the scale.
        """
        k = self.dimension
        derivative = np.zeros((3, k + 1, self.parameters))
        for axis in range(3):
            derivative[:, :k, axis] = np.cross(np.eye(3)[axis], m[:, :k], axis=0)
            derivative[axis, k, 3 + axis] = 1.0
        if self.scale is None:
            derivative[:, :k, 6] = m[:, :k]
        return derivative.reshape(3 * (k + 1), self.parameters)

    def moved(self, m: Array, step: Array) -> Array:
        """M after the step (p,) in the parameters of `tangent`."""
        k = self.dimension
        linear = rotation(step[:3]) @ m[:, :k]
        if self.scale is None:
            linear = linear * np.exp(step[6])
        return np.column_stack([linear, m[:, k] + step[3:6]])

    def _gauss_newton(self, s: Array, y: Array, w: Array, m: Array) -> Array:
        """The least squares that a descent from M reaches; no step ever makes the sum larger."""
        x = homogeneous(s)
        root = np.sqrt(w)
        error = root * (y - x @ m.T)
        for _ in range(50):
            rows = root.reshape(-1, 1) * (marker_rows(x) @ self.tangent(m))
            step = np.linalg.lstsq(rows, error.ravel(), rcond=None)[0]
            before = float((error**2).sum())
            # Halve the step until it makes the sum smaller.
            for _ in range(20):
                candidate = self.moved(m, step)
                candidate_error = root * (y - x @ candidate.T)
                if (candidate_error**2).sum() < before:
                    break
                step /= 2
            else:
                return m
            m, error = candidate, candidate_error
            if (error**2).sum() > (1 - 1e-14) * before:
                return m
        return m


Model = Affine | Orthogonal


def make_model(name: ModelName, dimension: int, metric_scale: float) -> Model:
    """The model of a name; `metric_scale` is how many metres a unit of the normalised source is."""
    if name == "affine":
        return Affine(dimension)
    if name == "similarity":
        return Orthogonal(dimension, None, name)
    return Orthogonal(dimension, metric_scale, name)


def rms_length(vectors: Array) -> float:
    """RMS length of vectors (N, k)."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def homogeneous(s: Array) -> Array:
    """[s, 1] along the last axis."""
    return np.concatenate([s, np.ones((*s.shape[:-1], 1))], axis=-1)


def marker_rows(x: Array) -> Array:
    """(3N, 3 (k+1)) matrix from row-major M to the N mapped positions, for x~ (N, k+1)."""
    return np.einsum("ab,ni->nabi", np.eye(3), x).reshape(3 * len(x), -1)


def root_of_inverse(rows: Array) -> Array:
    """(p, p) A with A Aᵀ the inverse of XᵀX, for X (n, p).

    By QR, so that the condition number is not squared. The diagonal of the triangle is made
    positive, so A is the same on every machine.
    """
    r = np.linalg.qr(rows, mode="r")
    return np.linalg.solve(r * np.sign(np.diag(r))[:, None], np.eye(len(r)))


def rotation(rotation_vector: Array) -> Array:
    """(3, 3) rotation of a rotation vector [rad], by O. Rodrigues' formula (1840)."""
    x, y, z = rotation_vector
    angle = float(np.sqrt(x * x + y * y + z * z))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # np.sinc(a) is sin(pi a) / (pi a), which stays exact as the angle goes to 0.
    sine = np.sinc(angle / np.pi)
    cosine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.eye(3) + sine * cross + cosine * cross @ cross


def _weighted_least_squares(x: Array, y: Array, w: Array) -> Array:
    """(..., k+1, D) for x (..., N, k+1), y (..., N, D), w (..., N); by QR."""
    root = np.sqrt(w)[..., None]
    q, r = np.linalg.qr(root * x)
    return np.linalg.solve(r, np.swapaxes(q, -1, -2) @ (root * y))


def _procrustes(s: Array, y: Array, w: Array, scale: float | None) -> Array:
    """Umeyama's solution with weights (..., N); M (..., 3, k+1)."""
    k = s.shape[-1]
    if k == 2:
        s = np.concatenate([s, np.zeros((*s.shape[:-1], 1))], axis=-1)
    total = w.sum(axis=-1)[..., None]
    s_mean = np.einsum("...n,...nk->...k", w, s) / total
    y_mean = np.einsum("...n,...nk->...k", w, y) / total
    s0 = s - s_mean[..., None, :]
    y0 = y - y_mean[..., None, :]
    # Umeyama, eq. (40) to (42).
    u, d, vt = np.linalg.svd(np.einsum("...n,...na,...nb->...ab", w, y0, s0))
    sign = np.ones_like(d)
    sign[..., 2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    linear = (u * sign[..., None, :]) @ vt
    if scale is None:
        size = np.einsum("...n,...na,...na->...", w, s0, s0)
        linear = linear * ((d * sign).sum(axis=-1) / size)[..., None, None]
    else:
        linear = linear * scale
    t = y_mean - np.einsum("...ab,...b->...a", linear, s_mean)
    return np.concatenate([linear[..., :k], t[..., None]], axis=-1)


@dataclass(frozen=True, eq=False)
class Geometry:
    """What the linear part A (3, k) of a transform T says about scale and direction."""

    # (k,) metres in one source unit along the principal directions, largest first.
    singular_values: Array
    # (k,) metres in one source unit along each source axis: the length of A's columns.
    axis_scales: Array
    # Largest singular value over the smallest, minus 1: 0 for square pixels.
    anisotropy: float
    # Cosine of the angle between two columns, the one of largest size: 0 for a right angle.
    shear: float
    # (3,) unit vector u x v of a planar source in the target frame. With u to the right and v
    # down it points away from whoever looks at the slice. `None` for a source in space.
    normal: Array | None

    @property
    def scale(self) -> float:
        """Geometric mean of the singular values."""
        return float(np.exp(np.log(self.singular_values).mean()))


def geometry(transform: Array) -> Geometry:
    """Scale and direction of a T (3, 3) of a planar source or (4, 4) of one in space."""
    k = transform.shape[0] - 1
    a = transform[:3, :k]
    values = np.linalg.svd(a, compute_uv=False)
    lengths = np.linalg.norm(a, axis=0)
    cosines = (a.T @ a / np.outer(lengths, lengths))[np.triu_indices(k, 1)]
    normal = None
    if k == 2:
        normal = np.cross(a[:, 0], a[:, 1])
        normal /= np.linalg.norm(normal)
    return Geometry(
        singular_values=values,
        axis_scales=lengths,
        anisotropy=float(values[0] / values[-1] - 1),
        shear=float(cosines[np.abs(cosines).argmax()]),
        normal=normal,
    )
