"""A rigid registration refined by points touched on the bone: each lies on its surface.

The transform is the one that brings the touched points onto the surface, by their distances to the
nearest place on it (Y. Chen and G. Medioni, "Object modelling by registration of multiple range
images", Image and Vision Computing 10, 1992: point to plane), with a loss that grows slowly for
points that touched something else. Markers give the start, and are held against what comes out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError, SettingError
from vfplan.registration.models import Array, Orthogonal, homogeneous, root_of_inverse
from vfplan.registration.nearest import NearestOnMesh
from vfplan.registration.result import Registration

LEAST, MOST = 12, 100_000  # touched points: twice as many as degrees of freedom
FARTHEST_M = 0.02  # half of the points from where the markers put the surface: more is a wrong unit
# How much the distances change, RMS, for a motion of 1 that the patch holds least. The normals of a
# sampled surface are off by hundredths of a radian, which alone would seem to hold as much.
HELD = 0.03
STRAY = 1e-4  # a good touch is as far off with this probability: it touched something else
ROUNDS, MOST_STEPS = 3, 20  # each round with the scale of the one before
ROUNDING_M = 1e-9


@dataclass(frozen=True, eq=False)
class Touched:
    """What touching made of a registration."""

    registration: Registration  # the refined one; its covariance is the touched points'
    # (T,) signed distance of each point from the surface [m], less the tip's radius
    distances_m: Array
    before_m: Array  # (T,) the same under the markers' registration
    # (T,) bool: points that lie on the surface; the others touched something else
    used: NDArray[np.bool_]
    held: float  # as `HELD`, of this patch

    @property
    def rms_m(self) -> float:
        """Of the distances of the points used [m]."""
        return float(np.sqrt((self.distances_m[self.used] ** 2).mean()))


def refine_by_touch(
    registration: Registration,
    touched: Array,
    points: Array,
    triangles: NDArray[np.int32],
    tip_radius: float = 0.0,
) -> Touched:
    """Bring points touched on a bone onto its surface.

    registration: rigid, from the surface's frame to the robot's, good to some millimetres
    touched: (T, 3) places of the tip's centre in the robot's frame [m]
    points, triangles: the surface in the source frame [m], its triangles anticlockwise from outside
    tip_radius: of the ball that touches [m]
    Raises SettingError: a registration that is not rigid
    Raises MarkerError: too few points, points that lie nowhere near the surface, or on a patch that
        leaves a motion free
    """
    from scipy.special import stdtrit

    model = registration.fit.problem.model
    if not isinstance(model, Orthogonal) or model.name != "rigid" or model.dimension != 3:
        raise SettingError(
            f"touching refines a rigid registration in space, not {registration.model}; give "
            "--model rigid"
        )
    if not LEAST <= len(touched) <= MOST:
        raise MarkerError(f"{len(touched)} touched points; {LEAST} to {MOST} are wanted")
    patch = _Patch(registration, touched, NearestOnMesh(points, triangles), tip_radius)
    m = registration.fit.m
    before = patch.look(m)[0]
    if np.median(np.abs(before)) > FARTHEST_M:
        raise MarkerError(
            f"half of the touched points are more than {np.median(np.abs(before)) * 1e3:.0f} mm "
            f"from the surface that the markers place; at most {FARTHEST_M * 1e3:.0f} mm is "
            "allowed: is a unit or a frame wrong?"
        )
    for _ in range(ROUNDS):
        m = patch.fitted(m, model, "cauchy")
    # The robust fit has found what is surface; of that, least squares give the least error.
    distances = patch.look(m)[0]
    sigma, dof = _scale(distances), len(touched) - 6
    for _ in range(ROUNDS):
        farthest = float(stdtrit(dof, 1 - STRAY / 2)) * max(sigma, ROUNDING_M)
        used = np.abs(distances) <= farthest
        if used.sum() < LEAST:
            raise MarkerError(
                f"only {used.sum()} touched points lie on one surface; {LEAST} wanted"
            )
        kept = replace(patch, touched=touched[used])
        m = kept.fitted(m, model, "linear")
        distances = patch.look(m)[0]
        dof = int(used.sum()) - 6
        sigma = float(np.sqrt((distances[used] ** 2).sum() / dof))
    _, normals, places = kept.look(m)
    held = _check_held(normals, places)
    refined = _with_error(registration, m, distances[used], normals, places)
    return Touched(refined, distances, before, used, held)


@dataclass(frozen=True, eq=False)
class _Patch:
    """The touched points and the surface, seen through one transform after another."""

    registration: Registration
    touched: Array
    mesh: NearestOnMesh
    tip_radius: float

    def look(self, m: Array) -> tuple[Array, Array, Array]:
        """Distances (T,), and normals and nearest places (T, 3) on the surface, in the target."""
        normaliser = self.registration.fit.problem.normaliser
        y = self.touched - normaliser.target_centre
        s = np.linalg.solve(m[:, :3], (y - m[:, 3]).T).T
        source = (s * normaliser.radius + normaliser.centre) / normaliser.spacing
        nearest, rows = self.mesh(source)
        places = homogeneous(normaliser(nearest)) @ m.T
        turn = m[:, :3] / np.cbrt(np.linalg.det(m[:, :3]))
        normals = self.mesh.normals(rows) @ turn.T
        away = y - places
        side = np.where((away * normals).sum(axis=1) < 0, -1.0, 1.0)
        length = np.linalg.norm(away, axis=1)
        # Beyond an edge the nearest place's own direction is the distance's gradient.
        far = length > ROUNDING_M
        normals = np.where(
            far[:, None], side[:, None] * away / np.where(far, length, 1)[:, None], normals
        )
        return side * length - self.tip_radius, normals, places

    def fitted(self, m: Array, model: Orthogonal, loss: str) -> Array:
        """The transform after a fit that starts from m; `loss` is that of SciPy."""
        from scipy.optimize import least_squares

        scale = max(_scale(self.look(m)[0]), ROUNDING_M)

        def distances(step: Array) -> Array:
            return self.look(model.moved(m, step))[0]

        def slopes(step: Array) -> Array:
            moved = model.moved(m, step)
            _, normals, places = self.look(moved)
            return _jacobian(normals, places - moved[:, 3])

        found = least_squares(
            distances,
            np.zeros(6),
            slopes,
            loss=loss,
            f_scale=scale,
            x_scale="jac",
            max_nfev=MOST_STEPS,
        )
        return model.moved(m, found.x)


def _scale(distances: Array) -> float:
    """Standard deviation of normal distances that a fit has left, by the median of their sizes.

    With the factor for few of them of P. J. Rousseeuw and A. M. Leroy, "Robust regression and
    outlier detection", 1987, ch. 5: six parameters make half of a few distances small.
    """
    few = 1 + 5 / max(len(distances) - 6, 1)
    return 1.4826 * few * float(np.median(np.abs(distances)))


def _jacobian(normals: Array, arms: Array) -> Array:
    """(T, 6) how distances change as the surface turns about its arms' origin, and moves."""
    return -np.hstack([np.cross(arms, normals), normals])


def _check_held(normals: Array, places: Array) -> float:
    """How well the worst motion is held; refuses a patch that leaves one free."""
    arms = places - places.mean(axis=0)
    radius = np.sqrt((arms**2).sum(axis=1).mean())
    slopes = _jacobian(normals, arms / radius)
    _, sizes, motions = np.linalg.svd(slopes / np.sqrt(len(slopes)), full_matrices=False)
    held = float(sizes[-1])
    if held < HELD:
        turn, shift = motions[-1, :3], motions[-1, 3:]
        turning = np.linalg.norm(turn) > np.linalg.norm(shift)
        axis = turn if turning else shift
        shown = ", ".join(f"{x:+.2f}" for x in axis / np.linalg.norm(axis))
        what = f"turning about ({shown})" if turning else f"sliding along ({shown})"
        raise MarkerError(
            f"the touched patch does not hold the bone: {what} changes the distances by "
            f"{held:.3f} of the motion, {HELD} at least is wanted; touch places that face another "
            "way"
        )
    return held


def _with_error(
    registration: Registration,
    m: Array,
    distances: Array,
    normals: Array,
    places: Array,
) -> Registration:
    """The registration with another transform, and the covariance of these distances' fit."""
    fit = registration.fit
    slopes = _jacobian(normals, places - m[:, 3])
    dof = len(distances) - 6
    refined = replace(
        fit,
        m=m,
        vectors=fit.problem.y - fit.problem.x @ m.T,
        variance=float((distances**2).sum()) / dof,
        dof=dof,
        root=fit.problem.model.tangent(m) @ root_of_inverse(slopes),
    )
    return replace(registration, fit=refined)
