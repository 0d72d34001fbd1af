"""The markers' layout: relabellings it cannot tell apart, labels exchanged, where it reaches."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from vfplan.registration.models import Affine, Array, Orthogonal, homogeneous
from vfplan.registration.residuals import Fit, f_limit, solve, studentised_f

MAX_PAIRS = 5000
MAX_SYMMETRIC = 60
# Of the layout's RMS radius: bad residuals must not make every layout look symmetric.
MAX_TOLERANCE = 0.02
# RMS extent of the layout's narrow direction over the error of a marker: less explains nothing.
MIN_EXTENT = 3.0
REST_EXTENT = 2.0  # of what is left without a bad marker: fewer, so that its error is less known


def extent_and_error(fit: Fit) -> tuple[float, float]:
    """RMS extent [m] across the transformed layout, and the error [m] of a marker an axis."""
    used = fit.problem.s[fit.used]
    moved = (used - used.mean(axis=0)) @ fit.m[:, :-1].T
    extent = np.linalg.svd(moved, compute_uv=False)[1] / np.sqrt(len(used))
    return float(extent), float(np.sqrt(fit.variance))


def one_to_blame(fit: Fit) -> int | None:
    """The one marker without which the others agree where the transform does not explain them all.

    A similarity judges a planar affine fit, which follows a bad marker.
    """
    extent, error = extent_and_error(fit)
    if extent >= MIN_EXTENT * error:
        return None
    if isinstance(fit.problem.model, Affine) and fit.problem.model.dimension == 2:
        fit = solve(replace(fit.problem, model=Orthogonal(2, None, "similarity")), fit.used)
    if fit.dof < 6:
        return None
    f = np.nan_to_num(np.where(fit.used, studentised_f(fit), 0.0))
    worst = int(f.argmax())
    rest = solve(fit.problem, fit.used & (np.arange(len(f)) != worst))
    extent, error = extent_and_error(rest)
    alone = f[worst] > f_limit(len(f), rest.dof) and extent >= REST_EXTENT * error
    return worst if alone else None


def swapped_labels(fit: Fit, alpha: float = 0.01) -> tuple[int, int] | None:
    """The two markers whose labels seem exchanged: with them swapped the fit is far better.

    Every pair is tried; the best one counts if the sum of squares falls by more than F_{1-α/n; ν,ν}
    for n pairs. `None` too where there are more than `MAX_PAIRS` pairs.
    """
    from scipy.special import fdtri

    problem = fit.problem
    pairs = np.array(list(combinations(np.flatnonzero(fit.used), 2)))
    if len(pairs) > MAX_PAIRS:
        return None
    y = np.repeat(problem.y[None], len(pairs), axis=0)
    rows = np.arange(len(pairs))[:, None]
    y[rows, pairs] = problem.y[pairs[:, ::-1]]
    s, weights = problem.s[fit.used], problem.weights[fit.used]
    m = problem.model.solve(s[None], y[:, fit.used], weights[None])
    error = y[:, fit.used] - np.einsum("pak,nk->pna", m, homogeneous(s))
    sse = np.maximum((weights * error**2).sum(axis=(1, 2)), problem.floor_m**2)
    best = int(sse.argmin())
    limit = fdtri(float(fit.dof), float(fit.dof), 1 - alpha / len(pairs))
    if fit.variance * fit.dof > limit * sse[best]:
        return int(pairs[best, 0]), int(pairs[best, 1])
    return None


def symmetries(fit: Fit) -> int | None:
    """How many labellings of this layout fit equally well: 1 if it has no symmetry, 8 for a grid.

    An affine symmetry of a layout becomes a rotation or reflection once the layout's second moment
    is made round, so it is found by where it sends one marker (3-D: two). Markers count as
    exchanged when they coincide to three times the localisation error. `None`: not checked, too
    many markers.
    """
    problem, n = fit.problem, len(fit.problem.s)
    if n > MAX_SYMMETRIC:
        return None
    s = problem.s - problem.s.mean(axis=0)
    _, extent, axes = np.linalg.svd(s, full_matrices=False)
    rank = int((extent > extent[0] * 1e-3).sum())
    s = s @ axes[:rank].T
    unit = 1.0
    if problem.model.name == "affine":
        s = s / extent[:rank] * np.sqrt(n)
        unit = float(extent[0] / np.sqrt(n))
    metres = np.linalg.norm(problem.y) / np.linalg.norm(problem.s) * unit
    tolerance = float(np.clip(3 * np.sqrt(3 * fit.variance) / metres, 1e-6, MAX_TOLERANCE))
    proper_only = problem.s.shape[1] == 3 and rank == 3
    maps = _plane_maps(s, tolerance) if rank == 2 else _space_maps(s, tolerance, proper_only)
    found = {order for q in maps if (order := _permutation(s, q, tolerance)) is not None}
    return len(found | {tuple(range(n))})


def _plane_maps(s: Array, tolerance: float) -> list[Array]:
    """Rotations and reflections that send the farthest marker onto one as far."""
    first = int(np.hypot(*s.T).argmax())
    z = s[:, 0] + 1j * s[:, 1]
    maps = []
    for i in np.flatnonzero(np.abs(np.abs(z) - np.abs(z[first])) < tolerance):
        for start, conjugate in ((z[first], 1), (np.conj(z[first]), -1)):
            turn = z[i] / start / abs(z[i] / start)
            a, b = turn.real, turn.imag
            maps.append(np.array([[a, -b], [b, a]]) @ np.diag([1, conjugate]))
    return maps


def _space_maps(s: Array, tolerance: float, proper_only: bool) -> list[Array]:
    """Rotations (and reflections) that send two markers onto two that lie alike."""
    radius = np.linalg.norm(s, axis=1)
    first = int(radius.argmax())
    across = np.linalg.norm(np.cross(s[first], s), axis=1)
    second = int(across.argmax())
    base = _triad(s[first], s[second])
    apart = np.linalg.norm(s[:, None] - s[None], axis=2)
    alike = (
        (np.abs(radius - radius[first]) < tolerance)[:, None]
        & (np.abs(radius - radius[second]) < tolerance)[None]
        & (np.abs(apart - apart[first, second]) < 2 * tolerance)
    )
    maps = []
    for i, j in np.argwhere(alike):
        if i != j and np.linalg.norm(np.cross(s[i], s[j])) > 0.1 * across[second]:
            image = _triad(s[i], s[j])
            for sign in (1.0,) if proper_only else (1.0, -1.0):
                maps.append(image @ np.diag([1.0, 1.0, sign]) @ base.T)
    return maps


def _triad(a: Array, b: Array) -> Array:
    normal = np.cross(a, b)
    columns = [a / np.linalg.norm(a), normal / np.linalg.norm(normal)]
    return np.column_stack([columns[0], np.cross(columns[1], columns[0]), columns[1]])


def _permutation(s: Array, q: Array, tolerance: float) -> tuple[int, ...] | None:
    distance = np.linalg.norm((s @ q.T)[:, None] - s[None], axis=2)
    nearest = distance.argmin(axis=1)
    if len(set(nearest.tolist())) < len(s) or distance.min(axis=1).max() > tolerance:
        return None
    return tuple(nearest.tolist())


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
