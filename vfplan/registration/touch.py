"""A rigid registration refined by points touched on the surface: each of them lies on it.

The transform is the one that brings the touched points onto the surface, by their distances to the
nearest place on it (Y. Chen and G. Medioni, "Object modelling by registration of multiple range
images", Image and Vision Computing 10, 1992: point to plane). A loss that grows slowly first finds
which points touched the surface and which something else. The markers give the start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError, SettingError
from vfplan.geometry import ROUNDING_M
from vfplan.geometry.lines import Array, Flags, Indices, homogeneous, rms_length, row_lengths
from vfplan.registration.models import RARE_PROBABILITY, Orthogonal, root_of_inverse
from vfplan.registration.registration import Registration


class NearestOnMesh:
    """Finds the nearest place on a mesh, by VTK.

    points: (N, 3) corners [m]
    triangles: (K, 3) rows of them
    """

    def __init__(self, points: Array, triangles: NDArray[np.int32]) -> None:
        import pyvista
        from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator

        self.points, self.triangles = points, triangles
        self._locator = vtkStaticCellLocator()
        self._locator.SetDataSet(pyvista.PolyData.from_regular_faces(points, triangles))
        self._locator.BuildLocator()

    def __call__(self, places: Array) -> tuple[Array, Indices]:
        """Nearest place (M, 3) on the mesh to each of (M, 3), and the triangle it lies in (M,)."""
        from vtkmodules.vtkCommonCore import reference

        nearest, rows = np.empty_like(places), np.empty(len(places), np.intp)
        row, part, square = reference(0), reference(0), reference(0.0)
        for k, place in enumerate(places):
            self._locator.FindClosestPoint(place, nearest[k], row, part, square)
            rows[k] = row
        return nearest, rows

    def normals(self, rows: Indices) -> Array:
        """(M, 3) unit normals of triangles, to the side from which they turn anticlockwise."""
        a, b, c = np.moveaxis(self.points[self.triangles[rows]], 1, 0)
        normal = np.cross(b - a, c - a)
        return normal / np.maximum(row_lengths(normal), np.finfo(float).tiny)[:, None]


# Largest number of touched points. A tracked tip that slides for a minute gives fewer.
MAX_POINTS = 100_000

# Largest median distance [m] of the points from the surface that the markers place. More is a wrong
# unit or a wrong frame.
MAX_START_DISTANCE_M = 0.02

# Smallest RMS change of the distances for a motion of 1 in the direction that the patch constrains
# least. The normals of a sampled surface are off by hundredths of a radian, which looks the same.
MIN_CONSTRAINT = 0.03

# Number of rounds of fitting. Each uses the spread that the round before has left.
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class TouchRefinement:
    """A registration refined by touched points."""

    # The refined one; its covariance is that of the touched points' fit.
    registration: Registration
    # (T,) signed distance of each point from the surface, less the tip's radius [m].
    distances_m: Array
    # (T,) the same under the markers' registration [m].
    before_m: Array
    # (T,) the points that lie on the surface; the others touched something else.
    used: Flags
    # How well the patch constrains the motion that it constrains least; see `MIN_CONSTRAINT`.
    constraint: float


def refine_by_touch(
    registration: Registration,
    tip_positions: Array,
    points: Array,
    triangles: NDArray[np.int32],
    tip_radius: float = 0.0,
) -> TouchRefinement:
    """Bring points touched on a surface onto it.

    Parameters
    ----------
    registration
        Rigid, from the surface's frame to the robot's, good to some millimetres.
    tip_positions
        (T, 3) places of the tip's centre in the robot's frame [m].
    points, triangles
        The surface in the source frame [m], its triangles anticlockwise from outside.
    tip_radius
        Radius of the ball that touches [m].

    Raises
    ------
    SettingError
        A registration that is not rigid.
    MarkerError
        Too few points, points far from the surface, or a patch that leaves a motion free.
    """
    from scipy.special import stdtrit

    model = registration.problem.model
    if registration.model != "rigid" or model.dimension != 3:
        raise SettingError(
            f"touching refines a rigid registration in space, and this one is "
            f"{registration.model}. Give --model rigid",
            code="touch-not-rigid",
        )
    # Twice as many points as degrees of freedom.
    min_points = 2 * model.parameters
    if not min_points <= len(tip_positions) <= MAX_POINTS:
        text = f"{len(tip_positions)} points were touched. Give {min_points} to {MAX_POINTS}"
        raise MarkerError(text, code="touch-count", numbers={"points": len(tip_positions)})
    patch = _Patch(registration, tip_positions, NearestOnMesh(points, triangles), tip_radius)
    m = registration.m
    before_m = patch.distances(m)
    start_m = float(np.median(np.abs(before_m)))
    if start_m > MAX_START_DISTANCE_M:
        raise MarkerError(
            f"half of the touched points are more than {1e3 * start_m:.0f} mm from the surface "
            f"that the markers place; at most {1e3 * MAX_START_DISTANCE_M:.0f} mm is allowed. Look "
            "for a wrong unit or frame",
            code="touch-far", numbers={"median_distance_m": start_m},
        )  # fmt: skip

    # A robust fit finds which points lie on the surface.
    for _ in range(ROUNDS):
        m = patch.fit(m, model, "cauchy")
    distances_m = patch.distances(m)
    dof = len(tip_positions) - model.parameters
    sigma_m = _robust_spread(distances_m)

    # Least squares of those points give the smallest error.
    for _ in range(ROUNDS):
        limit = float(stdtrit(dof, 1 - RARE_PROBABILITY / 2)) * max(sigma_m, ROUNDING_M)
        used = np.abs(distances_m) <= limit
        if used.sum() < min_points:
            raise MarkerError(
                f"only {used.sum()} touched points lie on one surface, and {min_points} are "
                "needed. Touch more points on the bone",
                code="touch-no-surface", numbers={"points": int(used.sum())},
            )  # fmt: skip
        on_surface = replace(patch, tip_positions=tip_positions[used])
        m = on_surface.fit(m, model, "linear")
        distances_m = patch.distances(m)
        dof = int(used.sum()) - model.parameters
        sigma_m = float(np.sqrt((distances_m[used] ** 2).sum() / dof))

    _, normals, places = on_surface.nearest(m)
    constraint = refuse_free_motion(normals, places)

    # The covariance is that of the distances' fit.
    jacobian = _jacobian(normals, places - m[:, 3])
    refined = replace(
        registration,
        m=m,
        vectors=registration.problem.y - registration.problem.x @ m.T,
        variance=float((distances_m[used] ** 2).sum()) / dof,
        dof=dof,
        covariance_root=model.tangent(m) @ root_of_inverse(jacobian),
    )
    return TouchRefinement(refined, distances_m, before_m, used, constraint)


@dataclass(frozen=True, eq=False)
class _Patch:
    """Touched points and the surface, compared under one transform after another."""

    registration: Registration
    tip_positions: Array
    mesh: NearestOnMesh
    tip_radius: float

    def distances(self, m: Array) -> Array:
        """(T,) signed distances from the surface, less the tip's radius [m]."""
        return self.nearest(m)[0]

    def nearest(self, m: Array) -> tuple[Array, Array, Array]:
        """Distances (T,), and normals and nearest places (T, 3) on the surface in the target."""
        normaliser = self.registration.problem.normaliser
        y = self.tip_positions - normaliser.target_centre
        s = np.linalg.solve(m[:, :3], (y - m[:, 3]).T).T
        source = (s * normaliser.radius + normaliser.centre) / normaliser.spacing
        nearest, rows = self.mesh(source)
        places = homogeneous(normaliser(nearest)) @ m.T
        turn = m[:, :3] / np.cbrt(np.linalg.det(m[:, :3]))
        normals = self.mesh.normals(rows) @ turn.T
        offset = y - places
        side = np.where((offset * normals).sum(axis=1) < 0, -1.0, 1.0)
        length = row_lengths(offset)
        # Beyond an edge the distance grows along the way to the nearest place, not the normal.
        is_away = length > ROUNDING_M
        normals[is_away] = side[is_away, None] * offset[is_away] / length[is_away, None]
        return side * length - self.tip_radius, normals, places

    def fit(self, m: Array, model: Orthogonal, loss: Literal["cauchy", "linear"]) -> Array:
        """The transform after a least squares fit that starts from M; `loss` as SciPy names it."""
        from scipy.optimize import least_squares

        scale = max(_robust_spread(self.distances(m)), ROUNDING_M)

        def distances(step: Array) -> Array:
            return self.distances(model.moved(m, step))

        start = np.zeros(model.parameters)
        result = least_squares(distances, start, loss=loss, f_scale=scale, x_scale="jac")
        return model.moved(m, result.x)


def _robust_spread(distances: Array) -> float:
    """Standard deviation of normal distances that a fit has left, by the median of their sizes.

    The factor for few of them is that of P. J. Rousseeuw and A. M. Leroy, "Robust regression and
    outlier detection", 1987, ch. 5: six parameters make half of a few distances small.
    """
    few = 1 + 5 / max(len(distances) - 6, 1)
    return 1.4826 * few * float(np.median(np.abs(distances)))


def _jacobian(normals: Array, arms: Array) -> Array:
    """(T, 6) how distances change as the surface turns about the arms' origin, and moves."""
    return -np.hstack([np.cross(arms, normals), normals])


def refuse_free_motion(normals: Array, places: Array) -> float:
    """How well the worst motion is constrained; refuses a patch that leaves one free."""
    arms = places - places.mean(axis=0)
    jacobian = _jacobian(normals, arms / rms_length(arms))
    _, sizes, motions = np.linalg.svd(jacobian / np.sqrt(len(jacobian)), full_matrices=False)
    constraint = float(sizes[-1])
    if constraint < MIN_CONSTRAINT:
        turn, shift = motions[-1, :3], motions[-1, 3:]
        is_turn = np.linalg.norm(turn) > np.linalg.norm(shift)
        motion, axis = ("turning about", turn) if is_turn else ("sliding along", shift)
        x, y, z = axis / np.linalg.norm(axis)
        raise MarkerError(
            f"the touched patch does not hold the bone: {motion} ({x:+z.2f}, {y:+z.2f}, {z:+z.2f}) "
            f"changes the distances by {constraint:.3f} of the motion, and at least "
            f"{MIN_CONSTRAINT} is needed. Touch places that face another way",
            code="touch-free-motion", numbers={"constraint": constraint},
        )  # fmt: skip
    return constraint
