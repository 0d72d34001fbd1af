"""What the transform says about the image: scale, anisotropy, shear, normal, handedness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfplan.errors import MarkerError
from vfplan.registration.models import Array, Orthogonal, homogeneous
from vfplan.registration.residuals import Fit


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
    # (2,) axis_scales over the known pixel spacing, minus 1; `None` when none is known
    spacing_departure: Array | None

    @property
    def scale(self) -> float:
        """Geometric mean of the singular values."""
        return float(np.exp(np.log(self.singular_values).mean()))


def geometry(transform: Array, pixel_spacing: Array | None) -> Geometry:
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
        None if pixel_spacing is None else lengths / pixel_spacing - 1,
    )


def check_handedness(fit: Fit, seen_from: Array | None) -> None:
    """Refuse markers that fit only a mirror image.

    A 3-D source shows it by itself. A planar one fits its mirror image as well (turned over), so
    it is checked against `seen_from`, the direction from which the image is looked at, if given.

    Raises MarkerError: the markers are mirrored
    """
    if fit.problem.model.dimension == 3:
        if _is_mirrored(fit):
            raise MarkerError(
                "the markers are mirrored: they fit a mirror image far better than any rotation "
                "(look for one axis with the wrong sign, two axes or two labels exchanged)"
            )
    elif seen_from is not None:
        normal = np.cross(fit.m[:, 0], fit.m[:, 1])
        faces = -normal / np.linalg.norm(normal)
        if not faces @ seen_from > 0:
            raise MarkerError(
                f"the markers are mirrored: the image faces {faces.round(3).tolist()} in the "
                f"target frame, but is said to be seen from {seen_from.tolist()}"
            )


def _is_mirrored(fit: Fit) -> bool:
    from scipy.special import fdtri

    problem, used = fit.problem, fit.used
    if not isinstance(problem.model, Orthogonal):
        return bool(np.linalg.det(fit.m[:, :3]) < 0)
    flipped = problem.s[used] * [1.0, 1.0, -1.0]
    y, w = problem.y[used], problem.weights[used]
    error = y - homogeneous(flipped) @ problem.model.solve(flipped, y, w).T
    mirrored = max(float((w * error**2).sum()), problem.floor_m**2)
    # Flat layouts fit both ways; only a mirror image that fits far better than noise allows is one.
    return fit.variance * fit.dof > mirrored * fdtri(float(fit.dof), float(fit.dof), 0.999)
