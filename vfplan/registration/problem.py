"""What is to be fitted: checked markers, in coordinates that no unit or origin can spoil."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import MarkerError, SettingError
from vfplan.registration.models import MODELS, Array, Model, ModelName, homogeneous, make_model

# Longest over shortest RMS extent. Beyond it a layout determines nothing across its length: an
# affine TRE at one length off the line would be a thousand times the marker error.
MAX_CONDITION = 1e3


@dataclass(frozen=True, eq=False)
class Normaliser:
    """Raw source -> centred coordinates of unit RMS radius, and the target's centre."""

    spacing: Array  # (k,) metres (or, unknown, 1) in a raw unit along each axis
    centre: Array  # (k,) centre of the markers in the raw unit times `spacing`
    radius: float  # RMS distance of the markers from it
    target_centre: Array  # (3,) [m]

    def __call__(self, points: Array) -> Array:
        """Normalised s (..., k) of raw points (..., k)."""
        return (points * self.spacing - self.centre) / self.radius

    @property
    def matrix(self) -> Array:
        """(k+1, k+1): raw [x 1] -> [s 1]."""
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
    s: Array  # (N, k) source
    y: Array  # (N, 3) target, centred [m]
    weights: Array  # (N, 3) relative weights; 1 where every marker is as good as the others
    # Standard deviation that weight 1 stands for; `None` when none was stated
    sigma_unit_m: float | None
    condition: float
    floor_m: float  # residuals below this are rounding, not error

    @property
    def x(self) -> Array:
        """(N, k+1) [s, 1]."""
        return homogeneous(self.s)


def make_problem(
    source: ArrayLike,
    target: ArrayLike,
    model: ModelName,
    pixel_spacing: float | tuple[float, float] | None,
    sigma: ArrayLike | None,
    labels: Sequence[str] | None,
) -> Problem:
    """Check everything that can be wrong with the markers, then normalise them.

    Raises MarkerError: shapes that do not fit, non-finite values, too few markers, coincident or
        collinear ones
    Raises SettingError: an unknown model, a bad pixel spacing, `rigid` from pixels without one
    """
    if model not in MODELS:
        raise SettingError(f"model is {model!r}; allowed: {', '.join(MODELS)}")
    raw = _positions(source, "source", (2, 3))
    target_m = _positions(target, "target", (3,))
    names = tuple(range(len(raw))) if labels is None else tuple(labels)
    _check_pairs(raw, target_m, names)
    spacing = _spacing(pixel_spacing, raw.shape[1], model)
    _check_count(len(raw), make_model(model, raw.shape[1], 1.0))
    metric = raw * spacing
    centre = metric.mean(axis=0)
    radius = float(np.sqrt(((metric - centre) ** 2).sum(axis=1).mean()))
    rank = 3 if model == "affine" and raw.shape[1] == 3 else 2
    condition = _condition(metric - centre, metric, "source", rank)
    target_centre = target_m.mean(axis=0)
    y = target_m - target_centre
    _condition(y, target_m, "target", rank)
    normaliser = Normaliser(spacing, centre, radius, target_centre)
    weights, unit = _weights(sigma, len(raw), names)
    # The largest number a residual is a difference of [m]; sources carried over by the scale.
    scale = np.linalg.norm(y) / np.linalg.norm(metric - centre)
    floor = 64 * np.finfo(float).eps * float(np.abs(target_m).max() + np.abs(metric).max() * scale)
    return Problem(
        make_model(model, raw.shape[1], radius),
        normaliser,
        normaliser(raw),
        y,
        weights,
        unit,
        condition,
        floor,
    )


def _numbers(values: ArrayLike, what: str) -> Array:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise MarkerError(f"{what} not numbers in rows of equal length") from None


def _positions(values: ArrayLike, what: str, dimensions: tuple[int, ...]) -> Array:
    array = _numbers(values, f"{what} positions are")
    if array.ndim != 2 or array.shape[1] not in dimensions:
        allowed = " or ".join(f"(N, {d})" for d in dimensions)
        raise MarkerError(f"{what} has shape {array.shape}; {allowed} is wanted")
    return array


def _check_pairs(raw: Array, target: Array, names: Sequence[str]) -> None:
    if len(raw) != len(target):
        raise MarkerError(f"{len(raw)} source and {len(target)} target positions; as many wanted")
    if len(names) != len(raw):
        raise MarkerError(f"{len(names)} labels for {len(raw)} markers; one each is wanted")
    if len(set(names)) != len(names):
        doubled = next(name for name in names if list(names).count(name) > 1)
        raise MarkerError(f"label {doubled!r} occurs more than once; each marker may occur once")
    for what, array in (("source", raw), ("target", target)):
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        if bad.size:
            i = int(bad[0])
            raise MarkerError(
                f"{what} position of marker {names[i]!r} is {array[i].tolist()}; finite numbers "
                "are wanted"
            )
        if np.abs(array).max(initial=0.0) > 1e100:
            raise MarkerError(f"{what} holds {np.abs(array).max():g}; at most 1e100 is allowed")


def _spacing(
    pixel_spacing: float | tuple[float, float] | None, dimension: int, model: ModelName
) -> Array:
    if pixel_spacing is None:
        if dimension == 2 and model == "rigid":
            raise SettingError(
                "a rigid registration of pixels needs the pixel spacing, which is not known; give "
                "it, or use the model similarity or affine"
            )
        return np.ones(dimension)
    if dimension == 3:
        raise SettingError("a pixel spacing was given, but the source is 3-D [m], not pixels")
    try:
        spacing = np.broadcast_to(np.array(pixel_spacing, dtype=float), (2,)).copy()
    except (TypeError, ValueError):
        spacing = np.array([np.nan])
    if not (np.isfinite(spacing) & (spacing > 0)).all():
        raise SettingError(
            f"pixel spacing is {pixel_spacing!r}; one or two finite numbers above 0 [m] wanted"
        )
    return spacing


def _check_count(n: int, model: Model) -> None:
    # One more than the minimum where the minimum leaves no residual, so that an error can be known.
    needed = model.minimal + (3 * model.minimal == model.parameters)
    if n < needed:
        why = (
            f"{model.minimal} leave no residual, hence no error estimate"
            if needed > model.minimal
            else "fewer leave it undetermined"
        )
        raise MarkerError(
            f"{n} markers; the {model.name} model from {model.dimension}-D needs at least {needed} "
            f"({why})"
        )


def _condition(centred: Array, positions: Array, what: str, rank: int) -> float:
    """Longest over the `rank`-th longest RMS extent; refuses what determines nothing."""
    extent = np.linalg.svd(centred, compute_uv=False)
    rounding = 16 * np.finfo(float).eps * np.abs(positions).max() * np.sqrt(len(positions))
    if not extent[0] > rounding:
        raise MarkerError(f"all markers coincide in the {what}; they determine no transform")
    shape = ("coincident", "collinear", "coplanar")
    for r in range(1, rank):
        if not extent[r] > max(extent[0] / MAX_CONDITION, rounding):
            found = extent[0] / extent[r] if extent[r] > 0 else np.inf
            advice = "; use similarity or rigid" if r == 2 else ""
            raise MarkerError(
                f"the markers are {shape[r]} in the {what} (condition {found:.3g}, at most "
                f"{MAX_CONDITION:g} is allowed): they determine no transform{advice}"
            )
    return float(extent[0] / extent[rank - 1])


def _weights(
    sigma: ArrayLike | None, n: int, names: Sequence[str]
) -> tuple[NDArray[np.float64], float | None]:
    if sigma is None:
        return np.ones((n, 3)), None
    array = _numbers(sigma, "sigma is")
    if array.shape not in ((n,), (n, 3)):
        raise MarkerError(f"sigma has shape {array.shape}; ({n},) or ({n}, 3) is wanted")
    table = np.broadcast_to(array.reshape(n, -1), (n, 3))
    bad = np.flatnonzero(~(np.isfinite(table) & (table > 0)).all(axis=1))
    if bad.size:
        i = int(bad[0])
        raise MarkerError(
            f"sigma of marker {names[i]!r} is {table[i].tolist()}; finite numbers above 0 wanted"
        )
    unit = float(1 / np.sqrt((1 / table**2).mean()))
    return (unit / table) ** 2, unit


def outside_hull(markers: Array, points: Array) -> np.ndarray:
    """(M,) bool: points (M, k) outside the convex hull of markers (N, k); flat hulls in 3-D too."""
    from scipy.spatial import ConvexHull

    centre = markers.mean(axis=0)
    _, extent, axes = np.linalg.svd(markers - centre, full_matrices=False)
    basis = axes[extent > extent[0] * 1e-9]
    flat, inside = (markers - centre) @ basis.T, (points - centre) @ basis.T
    planes = ConvexHull(flat).equations
    tolerance = 1e-9 * extent[0]
    beyond = (inside @ planes[:, :-1].T + planes[:, -1] > tolerance).any(axis=1)
    off = np.linalg.norm((points - centre) - inside @ basis, axis=1) > 1e-6 * extent[0]
    return beyond | off
