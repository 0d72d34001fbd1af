"""The transforms that markers can determine, the markers, checked and normalised, and their fit.

A source point s is centred and scaled to unit RMS radius, so that no unit and no origin spoils the
numbers; a target y is centred [m], x~ = [s, 1], and y = M x~ with M of shape (3, k + 1).

- affine: M is free. Ordinary or weighted least squares.
- similarity: M = [a R | t]. S. Umeyama, "Least-squares estimation of transformation parameters
  between two point patterns", IEEE PAMI 13 (1991).
- rigid: the same with a known scale a. K. S. Arun, T. S. Huang and S. D. Blostein, "Least-squares
  fitting of two 3-D point sets", IEEE PAMI 9 (1987), with Umeyama's sign.

A planar source stands at z = 0, so that its rotation is a proper rotation in space.

Fisher's F distribution stands here too, because importing scipy.special takes a quarter of the time
of planning a fixture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from vfplan.errors import MarkerError, SettingError
from vfplan.geometry import PixelSpacing
from vfplan.geometry.lines import Array, Flags, Indices, homogeneous, rms_length, row_lengths

ModelName = Literal["affine", "similarity", "rigid"]
MODELS: tuple[ModelName, ...] = get_args(ModelName)


@dataclass(frozen=True)
class Affine:
    """Any linear map and a translation: 3 (k + 1) parameters."""

    dimension: int

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

    @property
    def parameters(self) -> int:
        """Number of free parameters p."""
        return 7 if self.scale is None else 6

    # Number of markers that determine the transform.
    minimal = 3

    def solve(self, s: Array, y: Array, w: Array) -> Array:
        """M (..., 3, k+1) of least weighted squares, for s (..., N, k), y and w (..., N, 3).

        The closed form holds where the three weights of each marker are equal. Otherwise a descent
        starts from the closed form with the means of the weights.
        """
        m = _procrustes(s, y, w.mean(axis=-1), self.scale)
        if not np.ptp(w, axis=-1).any():
            return m
        batch = m.shape[:-2]
        s, y, w = (np.broadcast_to(values, (*batch, *values.shape[-2:])) for values in (s, y, w))
        refined = np.empty_like(m)
        for index in np.ndindex(batch):
            refined[index] = self._refined(s[index], y[index], w[index], m[index])
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
        from cv2 import Rodrigues

        k = self.dimension
        linear = Rodrigues(step[:3])[0] @ m[:, :k]
        if self.scale is None:
            linear = linear * np.exp(step[6])
        return np.column_stack([linear, m[:, k] + step[3:6]])

    def _refined(self, s: Array, y: Array, w: Array, m: Array) -> Array:
        """The least squares that a descent from M reaches."""
        from scipy.optimize import least_squares

        x, root = homogeneous(s), np.sqrt(w)

        def errors(step: Array) -> Array:
            return (root * (y - x @ self.moved(m, step).T)).ravel()

        start = np.zeros(self.parameters)
        found = least_squares(errors, start, "3-point", ftol=1e-15, xtol=1e-15, gtol=1e-15)
        return self.moved(m, found.x)


Model = Affine | Orthogonal


def make_model(name: ModelName, dimension: int, metric_scale: float) -> Model:
    """The model of a name; `metric_scale` is how many metres a unit of the normalised source is."""
    if name == "affine":
        return Affine(dimension)
    return Orthogonal(dimension, metric_scale if name == "rigid" else None)


def rms(values: ArrayLike) -> float:
    """Root mean square of numbers."""
    return float(np.sqrt(np.square(values).mean()))


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
    s0, y0 = s - s_mean[..., None, :], y - y_mean[..., None, :]
    # Umeyama, eq. (40) to (42).
    u, d, vt = np.linalg.svd(np.einsum("...n,...na,...nb->...ab", w, y0, s0))
    sign = np.ones_like(d)
    sign[..., 2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    linear = (u * sign[..., None, :]) @ vt
    if scale is None:
        size = np.einsum("...n,...na,...na->...", w, s0, s0)
        scale = ((d * sign).sum(axis=-1) / size)[..., None, None]
    linear = linear * scale
    t = y_mean - np.einsum("...ab,...b->...a", linear, s_mean)
    return np.concatenate([linear[..., :k], t[..., None]], axis=-1)


# Longest over shortest RMS extent of a layout. A longer layout determines nothing across itself:
# at one length beside the line, the error would be a thousand times that of a marker.
MAX_CONDITION = 1e3

# Larger coordinates overflow when they are squared.
MAX_COORDINATE = 1e100


@dataclass(frozen=True, eq=False)
class Normaliser:
    """Raw source coordinates to centred ones of unit RMS radius, and the centre of the target."""

    # (k,) metres in one raw unit along each axis; 1 where that is not known.
    spacing: Array
    # (k,) centre of the markers in raw units times `spacing`.
    centre: Array
    # RMS distance of the markers from their centre, in the same unit.
    radius: float
    # (3,) centre of the target markers [m].
    target_centre: Array

    def __call__(self, points: Array) -> Array:
        """Normalised s (..., k) of raw points (..., k)."""
        return (points * self.spacing - self.centre) / self.radius

    @property
    def matrix(self) -> Array:
        """(k+1, k+1) matrix from raw [x 1] to [s 1]."""
        k = len(self.spacing)
        matrix = np.eye(k + 1)
        matrix[:k, :k] = np.diag(self.spacing / self.radius)
        matrix[:k, k] = -self.centre / self.radius
        return matrix


@dataclass(frozen=True, eq=False)
class Problem:
    """Checked markers in normalised coordinates."""

    model: Model
    normaliser: Normaliser
    # (N, k) source.
    s: Array
    # (N, 3) target, centred [m].
    y: Array
    # (N, 3) relative weights; 1 where every marker is as good as the others.
    weights: Array
    # Longest over shortest extent of the source; 1 is best.
    condition: float
    # Residuals below this are rounding and no error [m].
    rounding_floor_m: float

    @property
    def x(self) -> Array:
        """(N, k+1) [s, 1]."""
        return homogeneous(self.s)


def is_spread_out(problem: Problem, index: Indices) -> Flags:
    """(P,) whether a subset determines the transform: not on a line, for a 3-D affine not flat."""
    s = problem.s[index]
    centred = s - s.mean(axis=1, keepdims=True)
    squares = np.linalg.eigvalsh(np.swapaxes(centred, 1, 2) @ centred)[:, ::-1]
    rank = problem.model.dimension if isinstance(problem.model, Affine) else 2
    return squares[:, rank - 1] > 1 / MAX_CONDITION**2


def fewest_markers(model: ModelName, dimension: int) -> tuple[int, str]:
    """How many markers a model needs, in pixels (2) or in space (3), and why no fewer will do."""
    smallest = make_model(model, dimension, 1.0)
    if 3 * smallest.minimal > smallest.parameters:
        return smallest.minimal, "fewer leave it undetermined"
    # Where the minimum leaves no residual, one marker more is needed to know an error at all.
    return smallest.minimal + 1, f"{smallest.minimal} leave no residual, hence no error estimate"


def make_problem(
    source: ArrayLike,
    target: ArrayLike,
    model: ModelName,
    pixel_spacing: float | PixelSpacing,
    sigma: ArrayLike | None,
    labels: Sequence[str] | None,
) -> Problem:
    """Check everything that can be wrong with the markers, then normalise them.

    Raises MarkerError: shapes that do not fit, values that are not finite, too few markers, markers
        in one place or on a line
    Raises SettingError: an unknown model, a bad pixel spacing, `rigid` from pixels without one
    """
    if model not in MODELS:
        raise SettingError(f"model is {model!r}. Give {', '.join(MODELS)}", code="model-unknown")
    raw = _positions(source, "source", (2, 3))
    target_m = _positions(target, "target", (3,))
    names = tuple(range(len(raw)) if labels is None else labels)
    _check_both_sides(raw, target_m, names)
    spacing = _spacing(pixel_spacing, raw.shape[1], model)
    needed, reason = fewest_markers(model, raw.shape[1])
    if len(raw) < needed:
        raise MarkerError(
            f"{len(raw)} markers are too few: the {model} model from {raw.shape[1]}-D needs at "
            f"least {needed} ({reason}). Add markers",
            code="too-few-markers", numbers={"markers": len(raw), "needed": needed},
        )  # fmt: skip

    metric = raw * spacing
    centre = metric.mean(axis=0)
    radius = rms_length(metric - centre)
    # An affine map of a solid needs depth; every other transform needs markers off a line.
    rank = 3 if model == "affine" and raw.shape[1] == 3 else 2
    condition = _condition(metric - centre, metric, "source", rank)
    target_centre = target_m.mean(axis=0)
    y = target_m - target_centre
    _condition(y, target_m, "target", rank)

    normaliser = Normaliser(spacing, centre, radius, target_centre)
    # A residual is a difference of numbers as large as these [m].
    scale = np.linalg.norm(y) / np.linalg.norm(metric - centre)
    largest = float(np.abs(target_m).max() + np.abs(metric).max() * scale)
    return Problem(
        model=make_model(model, raw.shape[1], radius),
        normaliser=normaliser,
        s=normaliser(raw),
        y=y,
        weights=_weights(sigma, names),
        condition=condition,
        rounding_floor_m=64 * np.finfo(float).eps * largest,
    )


def _numbers(values: ArrayLike, what: str) -> Array:
    try:
        return np.array(values, float)
    except (TypeError, ValueError):
        raise MarkerError(
            f"{what} not numbers in rows of equal length. Give an array of numbers",
            code="markers-not-numbers",
        ) from None


def _positions(values: ArrayLike, what: str, dimensions: tuple[int, ...]) -> Array:
    array = _numbers(values, f"{what} positions are")
    if array.ndim != 2 or array.shape[1] not in dimensions:
        allowed = " or ".join(f"(N, {d})" for d in dimensions)
        raise MarkerError(
            f"{what} has shape {array.shape}. Give an array of shape {allowed}",
            code="markers-shape",
        )
    return array


def _check_both_sides(raw: Array, target: Array, names: Sequence[str | int]) -> None:
    if not len(raw) == len(target) == len(names):
        raise MarkerError(
            f"{len(raw)} source and {len(target)} target positions, {len(names)} labels. Give as "
            "many of each",
            code="markers-shape",
        )
    for name in names:
        if names.count(name) > 1:
            text = f"label {name!r} occurs more than once. Give each marker a label of its own"
            raise MarkerError(text, code="label-doubled", numbers={"label": name})
    for what, array in (("source", raw), ("target", target)):
        for name, position in zip(names, array, strict=True):
            if not np.isfinite(position).all():
                raise MarkerError(
                    f"{what} position of marker {name!r} is {position.tolist()}. Give finite "
                    "numbers",
                    code="markers-not-finite", numbers={"label": name},
                )  # fmt: skip
        largest = float(np.abs(array).max(initial=0.0))
        if largest > MAX_COORDINATE:
            text = f"{what} holds {largest:g}. Give numbers of at most {MAX_COORDINATE:g}"
            raise MarkerError(text, code="markers-too-large", numbers={"largest": largest})


def _spacing(pixel_spacing: float | PixelSpacing, dimension: int, model: ModelName) -> Array:
    if pixel_spacing is None:
        if dimension == 2 and model == "rigid":
            raise SettingError(
                "a rigid registration of pixels needs the pixel spacing, which is not known. Give "
                "--pixel-spacing, or --model similarity or affine",
                code="pixel-spacing-missing",
            )
        return np.ones(dimension)
    if dimension == 3:
        raise SettingError(
            "a pixel spacing was given, but the source is 3-D [m], not pixels. Leave it out",
            code="pixel-spacing-useless",
        )
    try:
        spacing = np.broadcast_to(np.array(pixel_spacing, float), (2,)).copy()
    except (TypeError, ValueError):
        spacing = np.array([np.nan])
    if not (np.isfinite(spacing) & (spacing > 0)).all():
        raise SettingError(
            f"pixel spacing is {pixel_spacing!r}. Give one or two finite numbers above 0 [m]",
            code="pixel-spacing-range",
        )
    return spacing


def _condition(centred: Array, positions: Array, what: str, rank: int) -> float:
    """Longest over the `rank`-th longest RMS extent; refuses a layout that determines nothing."""
    extent = np.linalg.svd(centred, compute_uv=False)
    rounding = 16 * np.finfo(float).eps * np.abs(positions).max() * np.sqrt(len(positions))
    if not extent[0] > rounding:
        raise MarkerError(
            f"all markers stand at one place in the {what}, which determines no transform. Check "
            "the file's columns",
            code="markers-coincide",
        )
    smallest = max(extent[0] / MAX_CONDITION, rounding)
    numbers = {"condition": float(extent[0] / max(extent[rank - 1], rounding))}
    if not extent[1] > smallest:
        raise MarkerError(
            f"the markers lie on a line in the {what}: beside it they spread by less than "
            f"1/{MAX_CONDITION:g} of their length. Add a marker off the line",
            code="markers-collinear", numbers=numbers,
        )  # fmt: skip
    if not extent[rank - 1] > smallest:
        raise MarkerError(
            f"the markers lie in a plane in the {what}, which determines no affine map. Give "
            "--model similarity or rigid",
            code="markers-coplanar", numbers=numbers,
        )  # fmt: skip
    return float(extent[0] / extent[rank - 1])


def _weights(sigma: ArrayLike | None, names: Sequence[str | int]) -> Array:
    """Relative weights (N, 3) with mean 1."""
    n = len(names)
    if sigma is None:
        return np.ones((n, 3))
    array = _numbers(sigma, "sigma is")
    if array.shape not in ((n,), (n, 3)):
        raise MarkerError(
            f"sigma has shape {array.shape}. Give ({n},) or ({n}, 3)", code="sigma-shape"
        )
    table = np.broadcast_to(array.reshape(n, -1), (n, 3))
    for name, row in zip(names, table, strict=True):
        if not (np.isfinite(row) & (row > 0)).all():
            text = f"sigma of marker {name!r} is {row.tolist()}. Give finite numbers above 0"
            raise MarkerError(text, code="sigma-range", numbers={"label": name})
    return table**-2 / (table**-2).mean()


# A set of good markers is suspected once in a hundred: of an outlier, of mistaken labels, or of
# larger residuals than stated.
GOOD_SET_PROBABILITY = 0.01

# What good markers or touched points show once in 10,000 sets has another cause.
RARE_PROBABILITY = 1e-4


@dataclass(frozen=True, eq=False)
class Fit:
    """A problem and its least squares solution."""

    problem: Problem
    # (3, k+1) the transform in normalised coordinates.
    m: Array
    # (N,) the markers that the fit rests on.
    used: Flags
    # (N, 3) target minus transformed source [m].
    vectors: Array
    # (N, 3, 3) the hat matrix's diagonal blocks H_i; of a marker not used, what it would be.
    hat: Array
    # Estimated variance of a target coordinate of weight 1 [m²].
    variance: float
    # Degrees of freedom, 3 N - p.
    dof: int
    # (3 (k+1), p) A, so that variance times A Aᵀ is the covariance of row-major M.
    covariance_root: Array

    @property
    def covariance_m(self) -> Array:
        """(3 (k+1), 3 (k+1)) covariance of row-major M."""
        return self.variance * self.covariance_root @ self.covariance_root.T

    @property
    def leverage(self) -> Array:
        """(N,) share of each marker in its own prediction: the mean of its block's diagonal."""
        return np.trace(self.hat, axis1=1, axis2=2) / 3

    @cached_property
    def loo_m(self) -> Array:
        """(N,) error at each marker of the fit without it [m]; NaN where that is undetermined.

        Every fit is made again without each marker.
        """
        problem, used = self.problem, self.used
        errors = row_lengths(self.vectors)
        for i in np.flatnonzero(used):
            others = np.flatnonzero(used & (np.arange(len(used)) != i))
            errors[i] = np.nan
            if len(others) >= problem.model.minimal and is_spread_out(problem, others[None])[0]:
                s, y, weights = (of[others] for of in (problem.s, problem.y, problem.weights))
                m = problem.model.solve(s, y, weights)
                errors[i] = np.linalg.norm(problem.y[i] - m @ problem.x[i])
        return errors

    @cached_property
    def studentised_f(self) -> Array:
        """(N,) F of each marker against the others, with 3 and ν - 3 degrees of freedom.

        q = eᵀ W (I - H)⁻¹ e is what the sum of squares loses without the marker, and F is q / 3
        over the mean square of the others (Cook and Weisberg, section 2.2). A marker that the fit
        did not use is tested as a new observation, which gives the same F. NaN where no degree of
        freedom is left to judge by.
        """
        used, vectors = self.used, self.vectors
        blocks = np.eye(3) + np.where(used, -1.0, 1.0)[:, None, None] * self.hat
        regular = np.linalg.svd(blocks, compute_uv=False)[:, -1] > 1e-9
        deleted = np.full_like(vectors, np.nan)
        deleted[regular] = np.linalg.solve(blocks[regular], vectors[regular][:, :, None])[:, :, 0]
        lost = (self.problem.weights * vectors * deleted).sum(axis=1)
        floor = self.problem.rounding_floor_m**2
        total = float((self.problem.weights * vectors**2)[used].sum())
        others = np.maximum(total - lost * used, floor)
        others_dof = self.dof - 3 * used
        f = (lost / 3) / (others / np.maximum(others_dof, 1))
        f[lost <= floor] = 0.0  # The fit is exact, but for rounding.
        f[~(others_dof > 0) | ~np.isfinite(lost)] = np.nan
        return f


def fit_model(problem: Problem, used: Flags | None = None) -> Fit:
    """Fit the markers that are `used` (N,), by default all of them."""
    if used is None:
        used = np.ones(len(problem.s), bool)
    model, weights = problem.model, problem.weights
    m = model.solve(problem.s[used], problem.y[used], weights[used])
    vectors = problem.y - problem.x @ m.T
    dof = 3 * int(used.sum()) - model.parameters
    squares = float((weights[used] * vectors[used] ** 2).sum())

    # How the mapped markers move with the parameters, and from it the parameters' covariance.
    tangent = model.tangent(m)
    jacobian = (marker_rows(problem.x) @ tangent).reshape(len(used), 3, -1)
    weighted = np.sqrt(weights)[:, :, None] * jacobian
    inverse_root = root_of_inverse(weighted[used].reshape(-1, model.parameters))
    spread = jacobian @ inverse_root
    hat = spread @ np.swapaxes(spread, 1, 2) * weights[:, None, :]
    return Fit(problem, m, used, vectors, hat, squares / dof, dof, tangent @ inverse_root)


def fit_similarity(problem: Problem, used: Flags) -> Fit:
    """Fit a similarity to the markers that are `used` (N,), whatever the problem's own model."""
    return fit_model(replace(problem, model=Orthogonal(problem.model.dimension, None)), used)


def most_off(rows: Array, errors: Array, floor: float) -> tuple[int, Array, float, float]:
    """The place that the others contradict most in a fit of n places, as `studentised_f` judges.

    rows: (n, 3, p) how the places move with the parameters, times the roots of their weights
    errors: (n, 3) what the fit leaves, likewise
    floor: sums of squares below it are rounding

    Returns its number, its error (3,) in a fit of the others, their mean square, and the
    probability that one of n good places is as far off.
    """
    n, _, p = rows.shape
    left = np.linalg.svd(rows.reshape(-1, p), full_matrices=False)[0].reshape(n, 3, p)
    kept = np.eye(3) - left @ left.transpose(0, 2, 1)
    apart = (np.linalg.pinv(kept) @ errors[..., None])[..., 0]
    lost = (errors * apart).sum(axis=1)
    worst, dof = int(lost.argmax()), 3 * (n - 1) - p
    square = max(float((errors**2).sum() - lost[worst]), floor) / dof
    return worst, apart[worst], square, n * float(f_exceeds(3, dof, lost[worst] / 3 / square))


def f_exceeds(dof: ArrayLike, other_dof: ArrayLike, f: ArrayLike) -> Array:
    """The probability that F of these degrees of freedom exceeds f >= 0."""
    share = np.divide(other_dof, np.multiply(dof, f) + other_dof)
    a, b = np.divide(other_dof, 2), np.divide(dof, 2)
    return _beta_share(share, a, b, _log_beta(a, b))


def f_quantile(dof: ArrayLike, other_dof: ArrayLike, probability: float) -> Array:
    """What F of these degrees of freedom stays below with a probability."""
    a, b = np.broadcast_arrays(np.divide(dof, 2), np.divide(other_dof, 2))
    # Newton's method for log F, whose distribution is nearly symmetric; in bounds, which are halved
    # where a step would lead out of them.
    log_f, low, high = np.zeros(a.shape), np.full(a.shape, -700.0), np.full(a.shape, 700.0)
    log_beta = _log_beta(a, b)
    for _ in range(100):
        f = np.exp(log_f)
        excess = 1 - probability - _beta_share(b / (a * f + b), b, a, log_beta)
        low, high = np.where(excess < 0, log_f, low), np.where(excess < 0, high, log_f)
        x = a * f / (a * f + b)
        density = np.exp(a * np.log(x) + b * np.log1p(-x) - log_beta)
        tried = log_f - excess / np.maximum(density, 1e-300)
        tried = np.where((low <= tried) & (tried <= high), tried, (low + high) / 2)
        largest_step = np.abs(tried - log_f).max(initial=0.0)
        log_f = tried
        if not largest_step >= 1e-12:
            break
    return np.exp(log_f)


def _beta_share(x: ArrayLike, a: ArrayLike, b: ArrayLike, log_beta: ArrayLike) -> Array:
    """The regularised incomplete beta function I_x(a, b), by its continued fraction.

    `log_beta` is the logarithm of the beta function of a and b.

    NIST's Digital Library of Mathematical Functions, 8.17.22, evaluated from the front. It
    converges quickly below the mean; above it I_x(a, b) = 1 - I_(1-x)(b, a).
    """
    x, a, b = np.broadcast_arrays(x, a, b)
    is_above = x > (a + 1) / (a + b + 2)
    x = np.where(is_above, 1 - x, x)
    a, b = np.where(is_above, b, a), np.where(is_above, a, b)
    d = 1 / (1 - (a + b) * x / (a + 1))
    c, fraction = np.ones_like(d), d
    for m in range(1, 10_000):
        for factor in (
            m * (b - m) / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1 / (1 + factor * x * d)
            c = 1 + factor * x / c
            fraction = fraction * c * d
        if not (np.abs(c * d - 1) >= 1e-15).any():  # Of no number it never is.
            break
    x = np.maximum(x, np.finfo(float).tiny)
    share = fraction / a * np.exp(a * np.log(x) + b * np.log1p(-x) - log_beta)
    return np.where(is_above, 1 - share, share)


def _log_beta(a: ArrayLike, b: ArrayLike) -> Array:
    """The logarithm of the beta function."""
    log_gamma = np.vectorize(math.lgamma, otypes=[float])
    return log_gamma(a) + log_gamma(b) - log_gamma(np.add(a, b))
