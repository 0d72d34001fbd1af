"""A stack's zero level as triangles: marching cubes, then every corner onto the level itself.

W. E. Lorensen and H. E. Cline, "Marching cubes", SIGGRAPH 1987, as scikit-image has it (Lewiner's
tables: closed and without ambiguity). Corners near a grid node are drawn together first, so that no
triangle is a needle, and edges opposite wide corners are flipped last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.surface.outline import Outline
from vfplan.surface.stack import Stack

Array = NDArray[np.float64]
Triangles = NDArray[np.int32]
BLOCK = 8  # nodes along a side that one look from the middle may settle
MAX_NODES = 150_000_000  # 600 MB of single precision
SNAP = 0.25  # of a grid step: corners nearer to a node become one
NEWTON_STEPS = 6


@dataclass(frozen=True, eq=False)
class Level:
    """The surface of one stack, in its own frame."""

    points: Array  # (N, 3) corners [m]
    triangles: Triangles  # (K, 3) rows of `points`, seen anticlockwise from outside
    off_m: float  # how far the farthest corner that could be moved onto the level is from it [m]


def zero_level(stack: Stack, step: float, *, closed: bool) -> Level:
    """The surface on which a stack's function is 0.

    stack: the slices
    step: size of a grid cell [m]; across the slices as much or less, so that each is a grid plane
    closed: whether flat caps close it, half a slice beyond its first and last slice
    Raises SettingError: a step that takes more nodes than fit in memory
    """
    from skimage.measure import marching_cubes

    axes = _axes(stack, step, closed)
    values = _grid(stack, axes, step)
    if closed:
        values[:, :, 0] = values[:, :, -1] = step
    corners, triangles, *_ = marching_cubes(values, 0.0, gradient_direction="descent")
    corners = corners.astype(np.float64)
    places = np.column_stack(
        [np.interp(corners[:, a], np.arange(len(axes[a])), axes[a]) for a in range(3)]
    )
    in_plane = corners[:, 2] == np.rint(corners[:, 2])
    places, in_plane, triangles = _snapped(corners, places, in_plane, triangles)
    low, high = axes[2][0], axes[2][-1]
    on_end = (places[:, 2] == low) | (places[:, 2] == high)
    cap = on_end & ~in_plane
    points, off = _onto_level(stack, places, on_end, cap, step, (low, high))
    return Level(points, without_caps(points, triangles), off)


def _axes(stack: Stack, step: float, closed: bool) -> tuple[Array, Array, Array]:
    """Coordinates of the grid's planes; with caps the outermost two fall together."""
    rings = np.concatenate([ring for outline in stack.outlines for ring in outline.rings])
    low, high = rings.min(axis=0) - 2 * step, rings.max(axis=0) + 2 * step
    x, y = (np.arange(low[a], high[a] + step, step) for a in range(2))
    places = stack.z
    if closed:
        first, last = (places[1] - places[0]) / 2, (places[-1] - places[-2]) / 2
        places = np.r_[places[0] - first, places, places[-1] + last]
    pieces = np.maximum(1, np.ceil(np.diff(places) / step - 1e-9)).astype(int)
    nodes = len(x) * len(y) * (float(pieces.sum()) + 3)
    if nodes > MAX_NODES:
        raise SettingError(
            f"a grid of {1e3 * step:.3g} mm has {nodes:.3g} nodes over this structure. At most "
            f"{MAX_NODES:.3g} are taken: give a larger --tolerance."
        )
    cuts = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(places[:-1], places[1:], pieces, strict=True)
    ]
    z = np.concatenate([*cuts, places[-1:]])
    return x, y, np.r_[z[0], z, z[-1]] if closed else z


def _grid(stack: Stack, axes: tuple[Array, Array, Array], step: float) -> NDArray[np.float32]:
    """The function at every node, exact where the surface may be near.

    Far from an outline its distance is carried on linearly from the middle of a block.
    """
    x, y, z = axes
    which, w, _ = stack.weights(z)
    slices: dict[int, Array] = {}
    values = np.empty((len(x), len(y), len(z)), dtype=np.float32)
    places = stack.z
    for plane in range(len(z)):
        total = 0.0
        for k, weight in zip(which[plane], w[plane], strict=True):
            if weight == 0:
                continue
            if k not in slices:
                gap = np.diff(places)[max(0, k - 1) : k + 1].max()
                slices[k] = _slice_values(stack.outlines[k], x, y, 2 * step + gap)
            total = total + weight * slices[k]
        values[:, :, plane] = total
        for k in [k for k in slices if k < which[plane].min()]:
            del slices[k]
    return values


def _slice_values(outline: Outline, x: Array, y: Array, reach: float) -> Array:
    """(X, Y) signed distances, exact within `reach` of the outline."""
    i, j = (np.arange(0, len(axis), BLOCK) for axis in (x, y))
    middles = [axis[np.minimum(k + BLOCK // 2, len(axis) - 1)] for axis, k in ((x, i), (y, j))]
    centre = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2)
    f, g = outline.signed(centre)
    block = np.add.outer(np.arange(len(x)) // BLOCK * len(j), np.arange(len(y)) // BLOCK)
    dx = x[:, None] - centre[block, 0]
    dy = y[None, :] - centre[block, 1]
    values = f[block] + dx * g[block, 0] + dy * g[block, 1]
    a, b = np.nonzero(np.abs(f)[block] < reach + np.hypot(dx, dy))
    values[a, b] = outline.signed(np.column_stack([x[a], y[b]]))[0]
    return values


def _snapped(
    corners: Array, places: Array, in_plane: NDArray[np.bool_], triangles: Triangles
) -> tuple[Array, NDArray[np.bool_], Triangles]:
    """Corners near one node become one; triangles that this folds away go."""
    node = np.rint(corners)
    near = np.abs(corners - node).max(axis=1) < SNAP
    size = node.max(axis=0) + 1
    key = (node[:, 0] * size[1] + node[:, 1]) * size[2] + node[:, 2]
    key[~near] = -1 - np.flatnonzero(~near)
    _, to = np.unique(key, return_inverse=True)
    count = np.bincount(to)
    middle = np.column_stack([np.bincount(to, places[:, a]) / count for a in range(3)])
    flat = np.bincount(to, in_plane) > 0
    faces = to[triangles]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    faces = faces[whole]
    # Two triangles on the same corners enclose nothing between them.
    corners_of = np.sort(faces, axis=1)
    order = np.lexsort(corners_of.T)
    same = (corners_of[order[1:]] == corners_of[order[:-1]]).all(axis=1)
    faces = np.delete(faces, order[np.r_[same, False] | np.r_[False, same]], axis=0)
    used, faces = np.unique(faces, return_inverse=True)
    return middle[used], flat[used], faces.reshape(-1, 3).astype(np.int32)


def _onto_level(
    stack: Stack,
    places: Array,
    on_end: NDArray[np.bool_],
    cap: NDArray[np.bool_],
    step: float,
    ends: tuple[float, float],
) -> tuple[Array, float]:
    """Newton's method along the gradient; corners on the end planes stay in them, caps as a whole.

    A corner keeps the nearest place that it came by.
    """
    points = places.copy()
    moving = np.flatnonzero(~cap)
    best = np.full(len(points), np.inf)
    at = points.copy()
    for _ in range(NEWTON_STEPS):
        f, g = stack.signed(at[moving])
        g[on_end[moving], 2] = 0.0
        better = np.abs(f) < best[moving]
        best[moving[better]] = np.abs(f[better])
        points[moving[better]] = at[moving[better]]
        going = better & (np.abs(f) > 1e-9)
        moving, f, g = moving[going], f[going], g[going]
        if not len(moving):
            break
        square = np.maximum((g**2).sum(axis=1), 0.01)
        move = -(f / square)[:, None] * g
        length = np.linalg.norm(move, axis=1)
        move *= np.minimum(1.0, step / 2 / np.maximum(length, 1e-15))[:, None]
        at[moving] = points[moving] + move
        at[moving, 2] = np.clip(at[moving, 2], *ends)
    reached = best[~cap]
    return points, float(reached.max(initial=0.0))


FLAT = np.cos(np.radians(150.0))  # a corner that is wider
PASSES = 12


def without_caps(points: Array, triangles: Triangles) -> Triangles:
    """The same surface with the edges opposite wide corners flipped.

    points: (N, 3) corners
    triangles: (K, 3) rows of them, alike in orientation
    """
    triangles, near = triangles.copy(), np.arange(len(triangles))
    for _ in range(PASSES):
        cosines = _cosines(points[triangles[near]])
        flat = np.flatnonzero(cosines.min(axis=1) < FLAT)
        flat = flat[np.argsort(cosines[flat].min(axis=1), kind="stable")]
        rows, corner = near[flat], cosines[flat].argmin(axis=1)
        touched = np.zeros(len(points), dtype=bool)
        touched[triangles[rows]] = True
        near = np.flatnonzero(touched[triangles].any(axis=1))
        if not _flipped(points, triangles, _pairs(triangles, near, rows, corner)):
            break
    return triangles


def _pairs(
    triangles: Triangles, near: NDArray[np.intp], rows: NDArray[np.intp], corner: NDArray[np.intp]
) -> list[tuple[int, ...]]:
    """Two triangles and the four corners (a, b, c, d) of each flip of b-c to a-d, a new edge.

    No triangle is in two of them; `near` are all triangles at the corners of `rows`.
    """
    owner = {}
    for row, (a, b, c) in zip(near.tolist(), triangles[near].tolist(), strict=True):
        owner[a, b], owner[b, c], owner[c, a] = row, row, row
    pairs, taken = [], set()
    for row, k in zip(rows.tolist(), corner.tolist(), strict=True):
        b, c, a = (triangles.item(row, (k + turn) % 3) for turn in (1, 2, 3))
        other = owner.get((c, b))
        if other is None or taken & {row, other}:
            continue
        d = int(triangles[other].sum()) - b - c
        if (a, d) not in owner and (d, a) not in owner:
            taken |= {row, other}
            owner[a, d] = row  # a second flip must not make the same edge
            pairs.append((row, other, a, b, c, d))
    return pairs


def _flipped(points: Array, triangles: Triangles, pairs: list[tuple[int, ...]]) -> bool:
    """Flip where that makes the narrowest corner wider; whether any was."""
    row, other, a, b, c, d = np.array(pairs, dtype=np.int64).reshape(-1, 6).T
    new = np.stack([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    old = triangles[np.stack([row, other])]
    narrow = [_cosines(points[two]).max(axis=2).max(axis=0) for two in (old, new)]
    better = narrow[1] < narrow[0]
    triangles[row[better]], triangles[other[better]] = new[0, better], new[1, better]
    return bool(better.any())


def _cosines(corners: Array) -> Array:
    """(..., 3) of the angles of triangles (..., 3, 3)."""
    along = np.roll(corners, -1, axis=-2) - corners
    back = np.roll(corners, 1, axis=-2) - corners
    sizes = np.sqrt((along**2).sum(axis=-1) * (back**2).sum(axis=-1))
    return np.asarray((along * back).sum(axis=-1) / np.maximum(sizes, np.finfo(float).tiny))
