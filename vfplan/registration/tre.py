"""Target registration error: how the markers' error reaches any other point.

The fit's parameters have the covariance C of M (row-major, normalised coordinates). At a point with
x~ = [s, 1] the transform errs by δ = (I₃ ⊗ x~ᵀ) vec(δM), a normal vector of covariance
Σ = (I₃ ⊗ x~ᵀ) C (I₃ ⊗ x~). For the affine model with equal weights this is σ̂² h I₃ with the
leverage h = x~ (XᵀX)⁻¹ x~ᵀ; for the rigid model its trace is the formula of J. M. Fitzpatrick,
J. B. West and C. R. Maurer, IEEE TMI 17 (1998).
"""

from __future__ import annotations

import numpy as np

from vfplan.registration.models import Array


def tre_covariance(covariance: Array, x: Array) -> Array:
    """Σ (M, 3, 3) [m²] at x~ (M, k+1), from C (3 (k+1), 3 (k+1))."""
    k1 = x.shape[1]
    c = covariance.reshape(3, k1, 3, k1)
    return np.einsum("mi,aibj,mj->mab", x, c, x, optimize=True)


def rms(covariances: Array) -> Array:
    """RMS length (M,) [m] of an error with these covariances (M, 3, 3)."""
    return np.sqrt(np.maximum(np.trace(covariances, axis1=1, axis2=2), 0.0))


def bound(covariances: Array, dof: int, probability: float = 0.95) -> Array:
    """Radius (M,) [m] that the error's length stays below with this probability.

    δᵀδ is a sum of three squares weighted by Σ's eigenvalues λ; G. E. P. Box (Ann. Math. Stat. 25,
    1954) replaces it by one F variable of (Σλ)²/Σλ² and `dof` degrees of freedom, times Σλ. Exact
    when the non-zero eigenvalues are equal, as they are for the affine model.
    """
    from scipy.special import fdtri

    eigenvalues = np.maximum(np.linalg.eigvalsh(covariances), 0.0)
    total = eigenvalues.sum(axis=1)
    squares = (eigenvalues**2).sum(axis=1)
    freedom = np.divide(total**2, squares, out=np.full_like(total, 3.0), where=squares > 0)
    return np.sqrt(total * fdtri(freedom, float(dof), probability))
