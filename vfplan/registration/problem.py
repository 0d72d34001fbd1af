"""The markers, checked and brought into coordinates that no unit and no origin can spoil."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import MarkerError, SettingError
from vfplan.registration.models import (
    MODELS,
    Array,
    Model,
    ModelName,
    homogeneous,
    make_model,
    rms_length,
)

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
    # Standard deviation that a weight of 1 stands for [m]; `None` where none was stated.
    sigma_unit_m: float | None
    # Longest over shortest extent of the source; 1 is best.
    condition: float
    # Residuals below this are rounding and no error [m].
    rounding_floor_m: float

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

    Raises MarkerError: shapes that do not fit, values that are not finite, too few markers, markers
        in one place or on a line
    Raises SettingError: an unknown model, a bad pixel spacing, `rigid` from pixels without one
    """
    if model not in MODELS:
        raise SettingError(f"model is {model!r}. Give {', '.join(MODELS)}", code="model-unknown")
    raw = _positions(source, "source", (2, 3))
    target_m = _positions(target, "target", (3,))
    if labels is None:
        labels = range(len(raw))
    names = tuple(labels)
    _check_both_sides(raw, target_m, names)
    spacing = _spacing(pixel_spacing, raw.shape[1], model)
    # Where the minimum leaves no residual, one marker more is needed to know an error at all.
    smallest = make_model(model, raw.shape[1], 1.0)
    needed, reason = smallest.minimal, "fewer leave it undetermined"
    if 3 * smallest.minimal == smallest.parameters:
        reason = f"{needed} leave no residual, hence no error estimate"
        needed += 1
    if len(raw) < needed:
        raise MarkerError(
            f"{len(raw)} markers are too few: the {model} model from {raw.shape[1]}-D needs at "
            f"least {needed} ({reason}). Add markers",
            code="too-few-markers",
            numbers={"markers": len(raw), "needed": needed},
        )

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
    weights, sigma_unit_m = _weights(sigma, len(raw), names)
    # A residual is a difference of numbers as large as these [m].
    scale = np.linalg.norm(y) / np.linalg.norm(metric - centre)
    largest = float(np.abs(target_m).max() + np.abs(metric).max() * scale)
    return Problem(
        model=make_model(model, raw.shape[1], radius),
        normaliser=normaliser,
        s=normaliser(raw),
        y=y,
        weights=weights,
        sigma_unit_m=sigma_unit_m,
        condition=condition,
        rounding_floor_m=64 * np.finfo(float).eps * largest,
    )


def _numbers(values: ArrayLike, what: str) -> Array:
    try:
        return np.array(values, dtype=np.float64)
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
    if len(raw) != len(target):
        raise MarkerError(
            f"{len(raw)} source and {len(target)} target positions. Give as many of both",
            code="markers-shape",
        )
    if len(names) != len(raw):
        raise MarkerError(
            f"{len(names)} labels for {len(raw)} markers. Give one each", code="markers-shape"
        )
    for name in names:
        if names.count(name) > 1:
            raise MarkerError(
                f"label {name!r} occurs more than once. Give each marker a label of its own",
                code="label-doubled",
                numbers={"label": name},
            )
    for what, array in (("source", raw), ("target", target)):
        for name, position in zip(names, array, strict=True):
            if not np.isfinite(position).all():
                raise MarkerError(
                    f"{what} position of marker {name!r} is {position.tolist()}. Give finite "
                    "numbers",
                    code="markers-not-finite",
                    numbers={"label": name},
                )
        largest = float(np.abs(array).max(initial=0.0))
        if largest > MAX_COORDINATE:
            raise MarkerError(
                f"{what} holds {largest:g}. Give numbers of at most {MAX_COORDINATE:g}",
                code="markers-too-large",
                numbers={"largest": largest},
            )


def _spacing(
    pixel_spacing: float | tuple[float, float] | None, dimension: int, model: ModelName
) -> Array:
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
        spacing = np.broadcast_to(np.array(pixel_spacing, dtype=float), (2,)).copy()
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
            code="markers-collinear",
            numbers=numbers,
        )
    if not extent[rank - 1] > smallest:
        raise MarkerError(
            f"the markers lie in a plane in the {what}, which determines no affine map. Give "
            "--model similarity or rigid",
            code="markers-coplanar",
            numbers=numbers,
        )
    return float(extent[0] / extent[rank - 1])


def _weights(
    sigma: ArrayLike | None, n: int, names: Sequence[str | int]
) -> tuple[NDArray[np.float64], float | None]:
    """Relative weights (N, 3) with mean 1, and the standard deviation that a weight of 1 has."""
    if sigma is None:
        return np.ones((n, 3)), None
    array = _numbers(sigma, "sigma is")
    if array.shape not in ((n,), (n, 3)):
        raise MarkerError(
            f"sigma has shape {array.shape}. Give ({n},) or ({n}, 3)", code="sigma-shape"
        )
    table = np.broadcast_to(array.reshape(n, -1), (n, 3))
    for name, row in zip(names, table, strict=True):
        if not (np.isfinite(row) & (row > 0)).all():
            raise MarkerError(
                f"sigma of marker {name!r} is {row.tolist()}. Give finite numbers above 0",
                code="sigma-range",
                numbers={"label": name},
            )
    unit = float(1 / np.sqrt((1 / table**2).mean()))
    return (unit / table) ** 2, unit
