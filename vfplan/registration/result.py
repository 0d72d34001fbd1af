"""A registration: the transform, and what is known about its error."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import SettingError
from vfplan.fixture import Frame, RegistrationRecord
from vfplan.registration import bounds
from vfplan.registration.bounds import Perspective, perspective
from vfplan.registration.fit import Fit, f_limit, leave_one_out, studentised_f
from vfplan.registration.models import (
    Array,
    Geometry,
    ModelName,
    geometry,
    homogeneous,
    marker_rows,
)


@dataclass(frozen=True, eq=False)
class Registration:
    """A transform source -> target with its errors; made by `fit_registration`.

    Parameters
    ----------
    model
        "affine", "similarity" or "rigid".
    labels
        (N,) labels as given; the markers' indices when none were.
    source
        (N, 2) [px] or (N, 3) [m].
    target
        (N, 3) [m].
    fit
        The solved problem, in normalised coordinates.
    robust
        Whether markers that do not agree were left out.
    pixel_spacing
        (2,) known metres a pixel along u and v; `None` when unknown or the source is 3-D.
    """

    model: ModelName
    labels: tuple[str, ...] | tuple[int, ...]
    source: Array
    target: Array
    fit: Fit
    robust: bool = False
    pixel_spacing: Array | None = None

    @cached_property
    def T_target_source(self) -> Array:
        """(3, 3) acting on [u v 1], or (4, 4) acting on [x y z 1]; the result is [m].

        The planar matrix gives (x, y, z); the 4×4 one gives (x, y, z, 1).
        """
        normaliser = self.fit.problem.normaliser
        top = self.fit.m @ normaliser.matrix
        top[:, -1] += normaliser.target_centre
        if top.shape[1] == 3:
            return top
        return np.vstack([top, [0.0, 0.0, 0.0, 1.0]])

    @cached_property
    def covariance(self) -> Array:
        """(9, 9) or (12, 12) covariance of the first three rows of T, row by row."""
        carry = np.kron(np.eye(3), self.fit.problem.normaliser.matrix.T)
        return carry @ self.fit.covariance @ carry.T

    def apply(self, points: ArrayLike) -> Array:
        """Target positions (M, 3) [m] of source points (M, 2|3).

        A planar registration also takes (M, 3) points whose third coordinate is 0, as a fixture in
        the frame "image" holds them.
        """
        return self._x(points) @ self.fit.m.T + self.fit.problem.normaliser.target_centre

    @property
    def residual_vectors_m(self) -> Array:
        """(N, 3) target minus transformed source [m]."""
        return self.fit.vectors

    @property
    def residuals_m(self) -> Array:
        """(N,) length of each marker's residual [m]."""
        return np.linalg.norm(self.fit.vectors, axis=1)

    @property
    def used(self) -> np.ndarray:
        """(N,) bool: the markers the fit rests on; all, unless it was robust."""
        return self.fit.used

    @property
    def fre_rms_m(self) -> float:
        """Fiducial registration error √(Σ|e|²/N) over the markers used [m]."""
        return float(np.sqrt((self.residuals_m[self.used] ** 2).mean()))

    @property
    def sigma_m(self) -> float:
        """σ̂ [m] an axis of a marker of weight 1; √(Σ w e² / ν)."""
        return float(np.sqrt(self.fit.variance))

    @property
    def fle_rms_m(self) -> float:
        """Estimated fiducial localisation error, RMS length [m]; d σ̂² for equal markers."""
        weights = self.fit.problem.weights[self.used]
        return float(np.sqrt(self.fit.variance * (1 / weights).sum(axis=1).mean()))

    @property
    def dof(self) -> int:
        """ν = 3 N - p."""
        return self.fit.dof

    @property
    def condition(self) -> float:
        """Longest over shortest extent of the markers in the source; 1 is best, no unit."""
        return self.fit.problem.condition

    @property
    def leverage(self) -> Array:
        """(N,) share of each marker in its own prediction, 0..1 for markers used."""
        return self.fit.leverage

    @cached_property
    def loo_m(self) -> Array:
        """(N,) error at each marker of the fit without it [m]; NaN where that is undetermined."""
        return leave_one_out(self.fit)

    @property
    def loo_rms_m(self) -> float | None:
        """RMS of `loo_m` over the markers used; `None` where one is undetermined."""
        value = float(np.sqrt((self.loo_m[self.used] ** 2).mean()))
        return value if np.isfinite(value) else None

    @cached_property
    def perspective(self) -> Perspective | None:
        """The homography that explains what the model leaves; `None` where nothing speaks for one.

        The transform stays the model's: a homography only widens the bounds, and says of markers
        that it explains that they are not to blame.
        """
        return self._homography if self._homography and self._homography.told else None

    @cached_property
    def _homography(self) -> Perspective | None:
        """The homography, also where it is as likely not there."""
        return perspective(self.fit)

    @cached_property
    def studentised_f(self) -> Array:
        """(N,) externally studentised F of each marker; NaN where it has no meaning.

        Against the homography where there is `perspective`.
        """
        seen = self.perspective
        return studentised_f(self.fit) if seen is None else seen.studentised_f

    @property
    def studentised_dof(self) -> NDArray[np.intp]:
        """(N,) degrees of freedom below `studentised_f`; above there are 3."""
        total = self.dof if self.perspective is None else self.perspective.dof
        return total - 3 * self.used.astype(int)

    @cached_property
    def outliers(self) -> tuple[str, ...] | tuple[int, ...]:
        """Labels of markers beyond F_{1-0.05/N; 3, ν-3}, and of those a robust fit left out."""
        n = int(self.used.sum())
        flagged = ~self.used
        for i, (f, dof) in enumerate(zip(self.studentised_f, self.studentised_dof, strict=True)):
            if dof > 0 and f > f_limit(n, int(dof)):
                flagged[i] = True
        return tuple(label for label, bad in zip(self.labels, flagged, strict=True) if bad)

    def tre_covariance(self, points: ArrayLike) -> Array:
        """(M, 3, 3) covariance [m²] of the registration's error at source points, by its model."""
        return bounds.tre_covariance(self.fit.covariance, self._x(points))

    def tre_m(self, points: ArrayLike) -> Array:
        """(M,) predicted RMS target registration error at source points [m].

        Sure `perspective` counts, and no less: what good markers show now and then would bias it.
        """
        if self.perspective is None or not self.perspective.sure:
            return bounds.rms(self.tre_covariance(points))
        parts, away, _ = self._error(points, self.perspective)
        return np.sqrt((parts**2).sum(axis=(1, 2)) + away**2 + 3 * self.perspective.variance)

    def tre_rms_m(self, points: ArrayLike) -> float:
        """Predicted target registration error [m], RMS over source points."""
        return float(np.sqrt((self.tre_m(points) ** 2).mean()))

    def tre95_m(self, points: ArrayLike) -> Array:
        """(M,) radius [m] that the error stays within at each point with probability 0.95.

        Where there is `perspective`: how far the transform lies from the homography there, and the
        bound of a marker measured there, for what the homography leaves may be the lens's, which
        bends the curve as much as it does the markers.
        """
        seen = self.perspective
        parts, away, dof = self._error(points, seen)
        return away + _bound(parts, seen.variance if seen else 0.0, dof)

    def tre95_curve_m(self, points: ArrayLike) -> Array:
        """(M,) radius [m] that the error stays within at all these points at once, with 0.95.

        The pointwise bound holds at each point with probability 0.95, hence along a whole curve
        less often; this one is wider by the one factor that makes up for it. Where there is
        `perspective`, what the homography leaves is a lens's, which no noise makes up for: the
        bound of a marker measured there is added, each point with its share of the 0.05, for it may
        differ from point to point. Where there is none, what the markers cannot rule out counts
        (`bounds.with_unseen`).
        """
        seen = self._homography
        parts, away, dof = self._error(points, seen)
        together = away + _together(parts, dof)
        if seen is None:
            return together
        if not seen.told:
            plain, _, dof = self._error(points, None)
            return bounds.with_unseen(_together(plain, dof), together, seen.p_value)
        share = 1 - 0.05 / min(len(parts), bounds.MAX_POINTS)
        return together + _bound(parts, seen.variance, dof, share)

    def _error(self, points: ArrayLike, seen: Perspective | None) -> tuple[Array, Array, int]:
        """The random part (M, 3, p) [m], the way to `seen` (M,) [m], and degrees of freedom."""
        s = self.normalised(points)
        if seen is None:
            rows = marker_rows(homogeneous(s)).reshape(len(s), 3, -1)
            return rows @ self.fit.root * self.sigma_m, np.zeros(len(s)), self.dof
        away = np.linalg.norm(homogeneous(s) @ self.fit.m.T - seen.apply(s), axis=1)
        parts = seen.rows(s) @ seen.root * np.sqrt(seen.variance)
        return parts, away, seen.dof

    @cached_property
    def geometry(self) -> Geometry:
        """Scale, anisotropy, shear and normal of the transform."""
        return geometry(self.T_target_source)

    def record(
        self, points: ArrayLike | None = None, source_frame: Frame | None = None
    ) -> RegistrationRecord:
        """The part of this that a fixture keeps.

        Parameters
        ----------
        points
            The fixture's points in the source frame, for the TRE along them.
        source_frame
            "image" or "patient_lps"; by default what the source's dimension says.
        """
        frame: Frame = "image" if self.source.shape[1] == 2 else "patient_lps"
        return RegistrationRecord(
            model=self.model,
            source_frame=source_frame or frame,
            T_robot_image=self.T_target_source,
            labels=tuple(map(str, self.labels)),
            source=self.source,
            target=self.target,
            residuals_m=self.residuals_m,
            fre_rms_m=self.fre_rms_m,
            loo_rms_m=self.loo_rms_m,
            tre_rms_m=None if points is None else self.tre_rms_m(points),
            covariance=self.covariance,
            tre_m=None if points is None else self.tre_m(points),
        )

    def normalised(self, points: ArrayLike) -> Array:
        """(M, k) source points in the fit's own coordinates: centred, of unit RMS radius."""
        try:
            array = np.atleast_2d(np.asarray(points, dtype=np.float64))
        except (TypeError, ValueError):
            raise SettingError("points are not numbers in rows of equal length") from None
        k = self.source.shape[1]
        if array.ndim == 2 and k == 2 and array.shape[1] == 3 and not array[:, 2].any():
            array = array[:, :2]
        if array.ndim != 2 or array.shape[1] != k or not len(array):
            raise SettingError(f"points have shape {array.shape}; (M, {k}) in the source is wanted")
        if not np.isfinite(array).all():
            raise SettingError("points hold NaN or infinity; finite numbers are wanted")
        return self.fit.problem.normaliser(array)

    def _x(self, points: ArrayLike) -> Array:
        return homogeneous(self.normalised(points))


def _bound(parts: Array, variance: float, dof: int, probability: float = 0.95) -> Array:
    covariances = parts @ np.swapaxes(parts, 1, 2) + variance * np.eye(3)
    return bounds.bound(covariances, dof, probability)


def _together(parts: Array, dof: int) -> Array:
    """(M,) the bound that holds at all points at once."""
    pointwise = _bound(parts, 0.0, dof)
    return bounds.curve_factor(parts, pointwise, dof) * pointwise
