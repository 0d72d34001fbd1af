"""Markers to a transform, with its error wherever it is used.

The registration's error at other points than the markers, and the bounds that it stays within.

The fit's parameters have the covariance C of M (row-major, normalised coordinates). At a point with
x~ = [s, 1] the transform errs by δ = (I₃ ⊗ x~ᵀ) vec(δM), a normal vector of covariance
Σ = (I₃ ⊗ x~ᵀ) C (I₃ ⊗ x~). For the affine model with equal weights this is σ² h I₃ with the
leverage h = x~ᵀ (XᵀX)⁻¹ x~. For the rigid model its trace is the formula of J. M. Fitzpatrick,
J. B. West and C. R. Maurer, "Predicting error in rigid-body point-based registration", IEEE TMI 17
(1998).

The pointwise bound b(r) covers each point with probability 0.95, hence all of a curve less often.
The bound of the curve is κ b(r). With A Aᵀ the parameters' covariance in units of σ² and ω uniform
on the unit sphere of their p dimensions, the largest ratio along the curve is
g(ω) = max_r |J_r A ω| / b(r). The error's size does not depend on its direction ω, and its square
over p is F-distributed with p and ν degrees of freedom. So

    P(the whole curve within κ b) = E_ω[ F_cdf(κ² / (p g(ω)²); p, ν) ],

and κ solves P = 0.95. The expectation is over fixed directions, the points of a sequence that fills
the sphere evenly (R. D. Richtmyer, LA-1342, 1951), so the same input gives the same bound.

Outliers among the markers: judged by an F test, and left out by a robust fit.

A marker is an outlier if it lies further from where the others put it than chance explains. A plain
fit keeps it and names it. A robust fit rests on the markers alone that agree with each other.

They are found without a random number. Least trimmed squares (P. J. Rousseeuw, "Least median of
squares regression", J. Am. Stat. Assoc. 79, 1984) over the transforms through all minimal subsets
finds the half of the markers that agrees best. A forward search (A. C. Atkinson and M. Riani,
"Robust diagnostic regression analysis", 2000) then takes in one marker after another, for as long
as the next one fits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations, islice
from math import comb
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from vfplan.display import Report
from vfplan.errors import MarkerError, SettingError
from vfplan.findings import Finding, doubt, note
from vfplan.fixture import Frame, RegistrationRecord, Stroke
from vfplan.geometry import ROWS_AT_ONCE, PixelSpacing
from vfplan.geometry.lines import Array, Flags, homogeneous, rms_length, row_lengths, unit_normal
from vfplan.registration.models import (
    GOOD_SET_PROBABILITY,
    Fit,
    ModelName,
    Orthogonal,
    Problem,
    f_exceeds,
    f_quantile,
    fit_model,
    is_spread_out,
    make_problem,
    marker_rows,
    rms,
)

# Probability that an error stays within its bound, and that an interval holds the true value.
PROBABILITY = 0.95

# Number of directions of the expectation. With this many κ is within 0.2 % of its limit.
DIRECTIONS = 8192

# Number of points of the curve that κ is taken over. The error changes slowly along it, so more
# points give the same.
CURVE_POINTS = 64


# Length of a curve [px] whose errors hang together, by the smoothing of a line.
PLACE_PX = 10.0


@dataclass(frozen=True, eq=False)
class TargetError:
    """The predicted error of a registered curve of M points."""

    # (M,) predicted RMS error at each point [m].
    rms_m: Array
    # (M,) bound at each point, with probability 0.95 for that point [m].
    bound95_m: Array
    # (M,) bound of both for all points at once, with probability 0.95 [m].
    curve95_m: Array
    # (M,) the part of it that is the curve's own error [m]; the squares of its parts add up.
    own_m: Array
    # Index of the point with the largest bound.
    worst: int
    # (M,) whether a point is predicted worse than every marker: it lies beyond them.
    is_extrapolated: Flags


def target_error(
    registration: Registration, points: ArrayLike, own: ArrayLike = 0.0
) -> TargetError:
    """The predicted error along a curve (M, 2|3) given in the source frame.

    own: the bound of the curve's own error there, (M,) of `own_bound` in the source frame's unit
    """
    rms_m, bound95_m = registration.tre_m(points), registration.tre95_m(points)
    curve95_m = registration.tre95_curve_m(points, own)
    own_m = registration.mean_scale * np.broadcast_to(own, rms_m.shape)
    at_markers_m = registration.tre_m(registration.source[registration.used])
    is_beyond = rms_m > at_markers_m.max() * (1 + 1e-9)
    return TargetError(rms_m, bound95_m, curve95_m, own_m, int(curve95_m.argmax()), is_beyond)


def own_bound(strokes: Sequence[Stroke], px: float = 1.0) -> Array:
    """(M,) distance that drawn strokes' own errors stay within at all points at once, with 0.95.

    What ink shows and what it does not, because it was bridged or placed by hand, have their own
    deviations, and share the probability of an error. `px` is a pixel in the strokes' unit.
    """
    sigma = np.concatenate(
        [np.zeros(len(s.points)) if s.sigma is None else s.sigma for s in strokes]
    )
    unseen = np.concatenate([stroke.bridged | stroke.edited for stroke in strokes])
    parts = [part for part in (unseen, ~unseen) if part.any()]
    steps = [np.full(len(s.points), s.length / len(s.points)) for s in strokes]
    places = np.concatenate(steps) / (PLACE_PX * px)
    bound = np.zeros(len(sigma))
    for part in parts:
        within = (1 - (1 - PROBABILITY) / len(parts)) ** (1 / max(1.0, places[part].sum()))
        bound[part] = normal_quantile((1 + within) / 2) * sigma[part]
    return bound


def pointwise_bound(covariances: Array, dof: int) -> Array:
    """(M,) radius [m] that an error stays within with 0.95, for covariances (M, 3, 3) [m²].

    |δ|² is a sum of three squares weighted by Σ's eigenvalues λ. G. E. P. Box ("Some theorems on
    quadratic forms", Ann. Math. Stat. 25, 1954) replaces it by Σλ times an F variable of
    (Σλ)²/Σλ² and `dof` degrees of freedom. That is exact where the eigenvalues that are not 0 are
    equal, as they are for the affine model.
    """
    eigenvalues = np.maximum(np.linalg.eigvalsh(covariances), 0.0)
    total = eigenvalues.sum(axis=1)
    squares = (eigenvalues**2).sum(axis=1)
    freedom = np.full_like(total, 3.0)
    np.divide(total**2, squares, out=freedom, where=squares > 0)
    return np.sqrt(total * f_quantile(freedom, dof, PROBABILITY))


def whole_curve_factor(rows: Array, pointwise_m: Array, dof: int) -> float:
    """κ of at least 1, by which the pointwise bound must grow to hold for all points at once.

    rows: (M, 3, p) [m] how the error follows from p unit normals
    pointwise_m: (M,) the points' own bounds [m]
    dof: degrees of freedom of the standard deviation
    """
    if not pointwise_m.max() > 0:
        return 1.0  # An exact fit has no error to bound.
    p = rows.shape[2]
    chosen = np.linspace(0, len(rows) - 1, min(len(rows), CURVE_POINTS)).round().astype(int)
    directions = _directions(p)
    # The g(ω)² of each direction ω.
    largest = np.zeros(DIRECTIONS)
    for row in rows[chosen] / pointwise_m[chosen, None, None]:
        np.maximum(largest, ((row @ directions) ** 2).sum(axis=0), out=largest)

    # Neighbours of the sorted values are nearly equal, so their mean stands for all of them.
    largest = np.sort(largest).reshape(-1, 16).mean(axis=1)

    def probability(kappa: float) -> float:
        return 1 - float(f_exceeds(p, dof, kappa**2 / (p * largest)).mean())

    low, high = 0.0, 1.0
    while probability(high) < PROBABILITY:
        low, high = high, 2 * high
    while high - low > 1e-5 * high:
        middle = (low + high) / 2
        if probability(middle) < PROBABILITY:
            low = middle
        else:
            high = middle
    return max(1.0, high)


@cache
def _directions(p: int) -> Array:
    """(p, DIRECTIONS) unit vectors, evenly over the sphere."""
    # Multiples of the square roots of primes, one a parameter, are Richtmyer's sequence.
    primes = np.array([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37])
    steps = np.arange(1, DIRECTIONS + 1)[:, None]
    uniform = np.mod(steps * np.sqrt(primes[:p]) + 0.5, 1.0)
    normal = normal_quantile(uniform)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.ascontiguousarray(normal.T)


# What a standard normal variable stays below with a probability.
normal_quantile = np.vectorize(NormalDist().inv_cdf, otypes=[float])


# All minimal subsets are tried, and this many take some seconds.
MAX_SUBSETS = 500_000

# The forward search stops before a good marker once in twenty sets. That leaves out a good marker
# now and then, and seldom takes in a wrong one.
STOP_PROBABILITY = 0.05


def is_outlier(fit: Fit) -> Flags:
    """(N,) the markers whose F is above its limit, and those that a robust fit left out."""
    # The probability is shared evenly among the markers (Bonferroni).
    share = GOOD_SET_PROBABILITY / fit.used.sum()
    limits = f_quantile(3, np.maximum(fit.dof - 3 * fit.used, 1), 1 - share)
    return (np.nan_to_num(fit.studentised_f) > limits) | ~fit.used


def single_outlier(registration: Registration) -> tuple[int, float] | None:
    """The marker of largest F, and the RMS residual of the others without it [m].

    `None` where no marker is an outlier, or the others do not agree either.
    """
    f = np.where(registration.used, np.nan_to_num(registration.studentised_f), 0.0)
    worst = int(f.argmax())
    if not (registration.used[worst] and is_outlier(registration)[worst]):
        return None
    others = registration.used & (np.arange(len(f)) != worst)
    others_m = rms_length(fit_model(registration.problem, others).vectors[others])
    return (worst, others_m) if others_m <= registration.fre_rms_m / 2 else None


def outlier_findings(registration: Registration) -> Iterator[Finding]:
    """Markers further from the others' prediction than chance explains, and those left out."""
    for i in np.flatnonzero(is_outlier(registration)):
        label, place = registration.labels[i], registration.place_px(i)
        distance_m, loo_m = registration.residuals_m[i], registration.loo_m[i]
        if not registration.used[i]:
            yield left_out_note(label, distance_m, place)
            continue
        away_mm = 1e3 * (loo_m if np.isfinite(loo_m) else distance_m)
        text = (
            f"Marker {label} lies {away_mm:.2f} mm from where the others put it. Touch it again, "
            "or leave it out with --robust."
        )
        yield doubt("marker-suspect", "register", text, place_px=place)


def left_out_note(label: str | int, distance_m: float, place: Sequence[float] | None) -> Finding:
    """What is told of a marker that the registration does not rest on."""
    text = (
        f"Marker {label} was left out: it lies {1e3 * distance_m:.2f} mm from where the "
        "others put it. Touch it again to have it count."
    )
    return note("marker-left-out", "register", text, place_px=place)


def consistent_markers(problem: Problem) -> Flags:
    """(N,) the markers that a robust fit rests on.

    Raises SettingError: more minimal subsets than can be searched
    """
    n, minimal = len(problem.s), problem.model.minimal
    subset_count = comb(n, minimal)
    if subset_count > MAX_SUBSETS:
        raise SettingError(
            f"a robust fit searches all {subset_count} subsets of {minimal} of {n} markers, and "
            f"at most {MAX_SUBSETS} are allowed. Give fewer markers, or leave --robust out",
            code="robust-too-many", numbers={"subsets": subset_count},
        )  # fmt: skip
    # As few markers as still leave a residual, and at least half of them.
    half = min(n, max((n + minimal + 1) // 2, problem.model.parameters // 3 + 1))

    # The minimal subset whose transform leaves the least sum over the half that fits it best.
    subsets = combinations(range(n), minimal)
    smallest_sum, best_subset, best_squares = np.inf, [], np.zeros(n)
    while block := list(islice(subsets, ROWS_AT_ONCE)):
        index = np.array(block)
        index = index[is_spread_out(problem, index)]
        if not len(index):
            continue
        # (P, N) weighted squared residual of each marker in an unweighted fit of each subset.
        y = problem.y[index]
        m = problem.model.solve(problem.s[index], y, np.ones_like(y))
        error = problem.y - problem.x @ np.swapaxes(m, -1, -2)
        squares = (problem.weights * error**2).sum(axis=-1)
        sums = np.partition(squares, half - 1, axis=1)[:, :half].sum(axis=1)
        candidate = int(sums.argmin())
        if sums[candidate] < smallest_sum:
            smallest_sum, best_subset = float(sums[candidate]), index[candidate].tolist()
            best_squares = squares[candidate]
    used = np.zeros(n, bool)
    used[best_subset] = True
    used[np.argsort(best_squares, kind="stable")[:half]] = True

    # Take in the marker that fits best, until the best of the others does not fit.
    while not used.all():
        fit = fit_model(problem, used)
        f = np.where(used, np.inf, fit.studentised_f)
        next_marker = int(np.argmin(f))
        if f[next_marker] > f_quantile(3, fit.dof, 1 - STOP_PROBABILITY / n):
            break
        used[next_marker] = True
    return used


# Directions in the robot's frame that have a word.
SIDES = {"above": (0.0, 0.0, 1.0), "below": (0.0, 0.0, -1.0)}

# A set of markers in space is called mirrored if its mirror image fits better by an F that good
# markers reach once in a thousand sets.
MIRRORED_PROBABILITY = 1e-3


@dataclass(frozen=True, eq=False)
class Registration(Fit):
    """A transform source -> target with its errors; `fit_registration` makes it.

    As a `Fit` it has the solved problem, in normalised coordinates.

    Parameters
    ----------
    model
        "affine", "similarity" or "rigid".
    labels
        (N,) labels as given; the markers' indices where none were.
    source
        (N, 2) [px] or (N, 3) [m].
    target
        (N, 3) [m].
    robust
        Whether markers that do not agree with the others were left out.
    pixel_spacing
        (2,) known metres a pixel along u and v; `None` where unknown or the source is in space.
    """

    model: ModelName
    labels: tuple[str, ...] | tuple[int, ...]
    source: Array
    target: Array
    robust: bool = False
    pixel_spacing: Array | None = None

    @cached_property
    def T_target_source(self) -> Array:
        """(3, 3) acting on [u v 1] with the result (x, y, z) [m], or (4, 4) acting on [x y z 1]."""
        normaliser = self.problem.normaliser
        top = self.m @ normaliser.matrix
        top[:, -1] += normaliser.target_centre
        return top if top.shape[1] == 3 else np.vstack([top, [0.0, 0.0, 0.0, 1.0]])

    @cached_property
    def covariance(self) -> Array:
        """(9, 9) or (12, 12) covariance of the first three rows of T, row by row."""
        carry = np.kron(np.eye(3), self.problem.normaliser.matrix.T)
        return carry @ self.covariance_m @ carry.T

    def apply(self, points: ArrayLike) -> Array:
        """Target positions (M, 3) [m] of source points (M, 2|3).

        A planar registration also takes (M, 3) points whose third coordinate is 0, as a fixture in
        the frame "image" holds them.
        """
        x = homogeneous(self.normalised(points))
        return x @ self.m.T + self.problem.normaliser.target_centre

    @property
    def residuals_m(self) -> Array:
        """(N,) length of each marker's residual [m]."""
        return row_lengths(self.vectors)

    @property
    def fre_rms_m(self) -> float:
        """Fiducial registration error √(Σ|e|²/N) over the markers used [m]."""
        return rms(self.residuals_m[self.used])

    @property
    def sigma_m(self) -> float:
        """Estimated standard deviation of a coordinate of a marker of weight 1: √(Σ w e² / ν)."""
        return float(np.sqrt(self.variance))

    @property
    def fle_rms_m(self) -> float:
        """Estimated fiducial localisation error, RMS length [m]; √3 σ for equal markers."""
        weights = self.problem.weights[self.used]
        return float(np.sqrt(self.variance * (1 / weights).sum(axis=1).mean()))

    @property
    def loo_rms_m(self) -> float | None:
        """RMS of `loo_m` over the markers used; `None` where one is undetermined."""
        value = rms(self.loo_m[self.used])
        return value if np.isfinite(value) else None

    @cached_property
    def outliers(self) -> tuple[str, ...] | tuple[int, ...]:
        """Labels of markers whose F is above its limit, and of those a robust fit left out."""
        return tuple(self.labels[i] for i in np.flatnonzero(is_outlier(self)))

    def place_px(self, index: int) -> tuple[float, float] | None:
        """Where a marker stands on the slice; `None` in space."""
        if self.source.shape[1] != 2:
            return None
        u, v = self.source[index]
        return float(u), float(v)

    def tre_m(self, points: ArrayLike) -> Array:
        """(M,) predicted RMS target registration error at source points [m]."""
        return np.sqrt((self._error_rows(points) ** 2).sum(axis=(1, 2)))

    def tre_rms_m(self, points: ArrayLike) -> float:
        """Predicted target registration error [m], RMS over source points."""
        return rms(self.tre_m(points))

    def tre95_m(self, points: ArrayLike) -> Array:
        """(M,) radius [m] that the error stays within at each point with probability 0.95."""
        rows = self._error_rows(points)
        return pointwise_bound(rows @ np.swapaxes(rows, 1, 2), self.dof)

    def tre95_curve_m(self, points: ArrayLike, own: ArrayLike = 0.0) -> Array:
        """(M,) radius [m] that the error stays within at all these points at once, with 0.95.

        The pointwise bound holds at each point with probability 0.95, hence along a whole curve
        less often. This one is wider by the factor that makes up for it (see `error`).

        own: the bound of the curve's own error, (M,) of `own_bound` in the source frame's unit
        """
        bound_m = self.tre95_m(points)
        bound_m *= whole_curve_factor(self._error_rows(points), bound_m, self.dof)
        return np.hypot(bound_m, self.mean_scale * np.asarray(own))

    def _error_rows(self, points: ArrayLike) -> Array:
        """(M, 3, p) how the error [m] at source points follows from p independent unit normals."""
        x = homogeneous(self.normalised(points))
        return (marker_rows(x).reshape(len(x), 3, -1) @ self.covariance_root) * self.sigma_m

    @property
    def mean_scale(self) -> float:
        """Metres a unit of the source: root mean square over the source's axes."""
        linear = self.T_target_source[:3, :-1]
        return float(np.sqrt((linear**2).sum() / linear.shape[1]))

    @property
    def scale(self) -> float:
        """Metres a unit of the source: geometric mean over the map's principal directions."""
        sizes = np.linalg.svd(self.T_target_source[:3, :-1])[1]
        return float(np.exp(np.log(sizes).mean()))

    @property
    def image_faces(self) -> Array | None:
        """(3,) unit vector in the target frame towards whoever looks at the slice.

        With u to the right and v down. `None` for a source in space.
        """
        return None if self.source.shape[1] == 3 else -unit_normal(self.T_target_source[:3])

    def normalised(self, points: ArrayLike) -> Array:
        """(M, k) source points in the fit's own coordinates: centred, of unit RMS radius."""
        try:
            array = np.atleast_2d(np.asarray(points, float))
        except (TypeError, ValueError):
            array = np.empty((0, 0))
        k = self.source.shape[1]
        if k == 2 and array.shape[1:] == (3,) and not array[:, 2].any():
            array = array[:, :2]
        if array.shape[1:] != (k,) or not len(array):
            raise SettingError(
                f"points have shape {array.shape}. Give numbers (M, {k}) in the source",
                code="points-shape",
            )
        if not np.isfinite(array).all():
            raise SettingError(
                "points hold NaN or infinity. Give finite numbers", code="points-not-finite"
            )
        return self.problem.normaliser(array)

    def record(self, points: ArrayLike, source_frame: Frame) -> RegistrationRecord:
        """The part of this that a fixture keeps, whose points are given in the source frame."""
        same = ("model", "source", "target", "residuals_m", "fre_rms_m", "loo_rms_m", "covariance")
        return RegistrationRecord(
            **{name: getattr(self, name) for name in same},
            source_frame=source_frame,
            T_robot_image=self.T_target_source,
            labels=tuple(map(str, self.labels)),
            tre_rms_m=self.tre_rms_m(points),
            tre_m=self.tre_m(points),
        )


def fit_registration(
    source: ArrayLike,
    target: ArrayLike,
    *,
    model: ModelName = "affine",
    robust: bool = False,
    labels: Sequence[str] | None = None,
    pixel_spacing: float | PixelSpacing = None,
    sigma: ArrayLike | None = None,
    seen_from: ArrayLike | str | None = None,
) -> Registration:
    """Fit the transform source -> target that markers determine, with its error everywhere.

    Parameters
    ----------
    source
        (N, 2) pixels u, v, or (N, 3) [m].
    target
        (N, 3) the same markers in the robot's frame [m].
    model
        "affine" (the paper's ordinary least squares), "similarity" or "rigid".
    robust
        Leave out the markers that do not agree with the others. They are named in `outliers` and
        false in `used`. Every minimal subset is tried, so the same markers give the same result.
    labels
        (N,) the markers' names, each once; their indices where `None`.
    pixel_spacing
        (along u, along v) [m/px], or one number; needed for "rigid" from pixels. For "similarity"
        only its ratio counts.
    sigma
        (N,) or (N, 3) standard deviation of each target position an axis [m]. Only ratios count:
        the size of the error is estimated from the residuals.
    seen_from
        (3,) direction in the target frame from which a planar slice is looked at, u to the right
        and v down; "above" is (0, 0, 1) and "below" is (0, 0, -1). A mirrored set of markers is
        then refused. Without it a mirrored planar set cannot be told from one that is turned over;
        a mirrored set in space is always refused.

    Raises
    ------
    MarkerError
        Positions that determine no transform: not finite, too few, in one place, on a line (or for
        an affine map of a solid in a plane), or mirrored.
    SettingError
        An unknown model, a direction without length, a pixel spacing that is missing or out of
        range, or more markers than a robust search allows.
    """
    if seen_from is not None:
        direction = direction_of(seen_from)
    problem = make_problem(source, target, model, pixel_spacing, sigma, labels)
    fit = fit_model(problem, consistent_markers(problem) if robust else None)

    # A source in space shows by itself that it fits only a mirror image. A planar one fits its
    # mirror image as well (turned over), so it is held against the side it is looked at from.
    if problem.model.dimension == 3 and is_mirrored(fit):
        raise MarkerError(
            "the markers are mirrored: they fit a mirror image far better than any rotation. "
            "Look for an axis with the wrong sign, or for two axes or labels exchanged",
            code="mirrored",
        )
    names = tuple(range(len(problem.s)) if labels is None else labels)
    source, target = np.array(source, float), np.array(target, float)
    known_spacing = problem.normaliser.spacing if pixel_spacing is not None else None
    registration = Registration(
        **vars(fit), model=model, labels=names, source=source, target=target, robust=robust,
        pixel_spacing=known_spacing,
    )  # fmt: skip
    faces = registration.image_faces
    if faces is not None and seen_from is not None and not faces @ direction > 0:
        raise MarkerError(
            f"the markers are mirrored: by them the slice is seen from {describe_side(faces)}, "
            "which is not the side that --seen-from names. Look for two axes exchanged or one "
            "with the wrong sign, or correct --seen-from if it is wrong",
            code="mirrored", numbers={"faces": faces.tolist(), "seen_from": direction.tolist()},
        )  # fmt: skip
    return registration


def is_mirrored(fit: Fit) -> bool:
    """Whether markers in space fit a mirror image clearly better than the model, by an F test."""
    problem = fit.problem
    if not isinstance(problem.model, Orthogonal):
        return bool(np.linalg.det(fit.m[:, :3]) < 0)
    flipped = problem.s[fit.used] * [1.0, 1.0, -1.0]
    y, w = problem.y[fit.used], problem.weights[fit.used]
    error = y - homogeneous(flipped) @ problem.model.solve(flipped, y, w).T
    mirrored = max(float((w * error**2).sum()), problem.rounding_floor_m**2)
    # A flat layout fits both ways, so only a mirror image that fits far better counts.
    limit = float(f_quantile(fit.dof, fit.dof, 1 - MIRRORED_PROBABILITY))
    return fit.variance * fit.dof > limit * mirrored


def registration_report(
    registration: Registration, points: ArrayLike, error: TargetError
) -> Report:
    """The registration, its markers, and its predicted error along source `points` (M, 2|3).

    As `--json` reports it. What has no meaning for this source or model is absent, and what cannot
    be known is `None`.
    """
    # What the linear part says of scale and direction: its singular values, largest first, and the
    # largest cosine between two of its columns, which is 0 for right angles.
    k = registration.source.shape[1]
    linear = registration.T_target_source[:3, :k]
    values, lengths = np.linalg.svd(linear, compute_uv=False), np.linalg.norm(linear, axis=0)
    cosines = (linear.T @ linear / np.outer(lengths, lengths))[np.triu_indices(k, 1)]
    unit = "_m_per_px" if k == 2 else ""
    names = ("residuals_m", "vectors", "leverage", "loo_m", "studentised_f", "used")
    columns = (registration.labels, *(getattr(registration, name).tolist() for name in names))
    keys = ("label", "residual_m", "vector_m", "leverage", "loo_m", "f", "used")
    markers = [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]
    report = {
        "model": registration.model,
        "markers": len(registration.labels),
        "T_robot_image": registration.T_target_source,
        "fre_rms_m": registration.fre_rms_m,
        "fle_rms_m": registration.fle_rms_m,
        "loo_rms_m": registration.loo_rms_m,
        "degrees_of_freedom": registration.dof,
        "condition": registration.problem.condition,
        "residuals": markers,
        "outliers": list(registration.outliers),
        f"scale{unit}": registration.scale,
        f"axis_scales{unit}": lengths,
        f"singular_values{unit}": values,
        "anisotropy": float(values[0] / values[-1] - 1),
        "shear": float(cosines[np.abs(cosines).argmax()]),
    }
    if registration.image_faces is not None:
        report["plane_normal"] = -registration.image_faces
        report["image_faces"] = registration.image_faces
        report["seen_from"] = describe_side(registration.image_faces)
    if registration.robust:
        report["robust"] = {"used": int(registration.used.sum())}
    rms_m = rms(error.rms_m)
    place = np.atleast_2d(np.asarray(points, float))[error.worst]
    report["tre_rms_m"] = rms_m
    report["tre"] = {
        "rms_m": rms_m,
        "max_rms_m": float(error.rms_m.max()),
        "bound95_max_m": float(error.bound95_m.max()),
        "curve95_max_m": float(error.curve95_m.max()),
        "worst_point": error.worst,
        "worst_source": place[:k],
        "worst_target_m": registration.apply(place[None])[0],
        "points_extrapolated": int(error.is_extrapolated.sum()),
    }
    return report


def direction_of(seen_from: ArrayLike | str) -> Array:
    """The direction that a side names; raises `SettingError` for what is no side."""
    if isinstance(seen_from, str):
        seen_from = SIDES.get(seen_from, seen_from)
    try:
        direction = np.array(seen_from, float)
    except ValueError:
        direction = np.zeros(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise SettingError(
            f"seen_from is {seen_from!r}. Give above, below or three finite numbers, not all 0",
            code="seen-from-range",
        )
    return direction


def describe_side(faces: Array) -> str:
    """The side of the robot that a slice is seen from, in words: "above (robot +z)"."""
    axis = int(np.abs(faces).argmax())
    name = ("+" if faces[axis] > 0 else "-") + "xyz"[axis]
    side = {"+z": "above", "-z": "below"}.get(name, "the side")
    return f"{side} (robot {name})"
