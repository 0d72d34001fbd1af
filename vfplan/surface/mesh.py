"""A stack's zero level as triangles: marching cubes, then every corner onto the level itself.

W. E. Lorensen and H. E. Cline, "Marching cubes", SIGGRAPH 1987, as scikit-image has it (Lewiner's
tables: closed and without ambiguity). Corners near a grid node are drawn together first, so that no
triangle is a needle, and edges opposite wide corners are flipped last.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, SettingError
from vfplan.geometry import ROUNDING_M
from vfplan.geometry.lines import Array, Flags, Indices, row_lengths
from vfplan.surface.outline import Outline, Stack

# Along x, y and z.
Axes = tuple[Array, Array, Array]
Triangles = NDArray[np.int32]
# Number of nodes along a side of a block. Far from the outline one distance serves all of them.
BLOCK = 8
# Largest number of nodes of a grid, which take 600 MB in single precision.
MAX_NODES = 150_000_000
# Distance from a node, in grid steps, within which corners become one. With half of it angles fall
# below 4 degrees.
SNAP = 0.25
# Smallest slope by which a value is divided to become a distance. It is less at ridges alone.
MIN_SLOPE = 0.1
# Angle of a corner from which on it is flipped away. With 165 degrees angles of 4.2 degrees remain,
# and with 130 degrees angles of 6.
WIDE_CORNER_DEG = 150.0


def level_surface(stack: Stack, step: float, *, closed: bool) -> tuple[Array, Triangles, float]:
    """The surface on which a stack's function is 0, in the frame of the stack.

    (N, 3) corners [m], (K, 3) rows of them, seen anticlockwise from outside, and how far the
    farthest corner that could be moved onto the level is from it [m].

    Parameters
    ----------
    stack
        The slices.
    step
        Size of a grid cell [m]; across the slices as much or less, so that each is a grid plane.
    closed
        Whether flat caps close it, half a slice beyond its first and last slice.

    Raises
    ------
    SettingError
        The step takes more nodes than fit in memory.
    """
    from skimage.measure import marching_cubes

    axes = grid_axes(stack, step, closed)
    values = grid_values(stack, axes, step)
    if closed:
        values[:, :, [0, -1]] = step
    if values.min() > -ROUNDING_M:
        parts = [part for outline in stack.outlines for part in outline.parts]
        inner = max(2 * part.area / part.length for part in parts)
        raise CurveError(
            f"the structure is thinner than the grid of {1e3 * step:.2g} mm, about "
            f"{1e3 * inner:.2g} mm, and would vanish. Give a smaller --tolerance.",
            code="structure-thin", numbers={"grid_mm": 1e3 * step, "thickness_mm": 1e3 * inner},
        )  # fmt: skip
    nodes, triangles, *_ = marching_cubes(values, 0.0, gradient_direction="descent")
    nodes = nodes.astype(float)
    places, in_plane, triangles = snapped(nodes, triangles, axes)

    ends = (axes[2][0], axes[2][-1])
    on_end = np.isin(places[:, 2], ends)
    points, distance_max = moved_onto_level(stack, places, on_end, on_end & ~in_plane, step, ends)
    return points, without_wide_corners(points, triangles), distance_max


def grid_axes(stack: Stack, step: float, closed: bool) -> Axes:
    """Coordinates of the grid's planes; with caps the outermost two fall together."""
    corners = np.concatenate([ring for outline in stack.outlines for ring in outline.rings])
    low = corners.min(axis=0) - 2 * step
    high = corners.max(axis=0) + 2 * step
    x = np.arange(low[0], high[0] + step, step)
    y = np.arange(low[1], high[1] + step, step)

    places = stack.z
    if closed:
        first = (places[1] - places[0]) / 2
        last = (places[-1] - places[-2]) / 2
        places = np.r_[places[0] - first, places, places[-1] + last]
    pieces = np.maximum(1, np.ceil(np.diff(places) / step - 1e-9)).astype(int)
    nodes = len(x) * len(y) * (float(pieces.sum()) + 3)
    if nodes > MAX_NODES:
        raise SettingError(
            f"a grid of {1e3 * step:.3g} mm has {nodes:.3g} nodes over this structure; at most "
            f"{MAX_NODES:.3g} are taken. Give a larger --tolerance.",
            code="surface-too-fine", numbers={"nodes": nodes, "nodes_max": MAX_NODES},
        )  # fmt: skip
    gaps = zip(places, places[1:], pieces, strict=False)
    cuts = [np.linspace(first, last, count, endpoint=False) for first, last, count in gaps]
    return x, y, np.pad(np.concatenate([*cuts, places[-1:]]), int(closed), "edge")


def grid_values(stack: Stack, axes: Axes, step: float) -> NDArray[np.float32]:
    """The function at every node, exact where the surface may be near.

    Far from an outline its distance is carried on linearly from the middle of a block.
    """
    x, y, z = axes
    inside = np.clip(z, stack.z[0], stack.z[-1])
    weights = np.column_stack([base(inside) for base in stack.bases])
    gaps = np.diff(stack.z)

    @lru_cache(maxsize=4)
    def distances(k: int) -> Array:
        return slice_values(stack.outlines[k], x, y, 2 * step + gaps[max(0, k - 1) : k + 1].max())

    values = np.empty((len(x), len(y), len(z)), np.float32)
    for plane in range(len(z)):
        total = 0.0
        for k in np.flatnonzero(weights[plane]):
            total = total + weights[plane, k] * distances(k)
        values[:, :, plane] = total
    return values


def slice_values(outline: Outline, x: Array, y: Array, reach: float) -> Array:
    """(X, Y) signed distances, exact within `reach` of the outline."""
    x_middles, y_middles = block_middles(x), block_middles(y)
    centres = np.stack(np.meshgrid(x_middles, y_middles, indexing="ij"), axis=-1).reshape(-1, 2)
    distance, gradient = outline.signed(centres)
    rows, columns = np.arange(len(x)) // BLOCK, np.arange(len(y)) // BLOCK
    block = np.add.outer(rows * len(y_middles), columns)
    dx, dy = x[:, None] - centres[block, 0], y[None, :] - centres[block, 1]
    values = distance[block] + dx * gradient[block, 0] + dy * gradient[block, 1]
    i, j = np.nonzero(np.abs(distance)[block] < reach + np.hypot(dx, dy))
    values[i, j] = outline.signed(np.column_stack([x[i], y[j]]))[0]
    return values


def block_middles(axis: Array) -> Array:
    """Coordinates of the middle node of each block along an axis."""
    return axis[np.minimum(np.arange(0, len(axis), BLOCK) + BLOCK // 2, len(axis) - 1)]


def snapped(nodes: Array, triangles: Triangles, axes: Axes) -> tuple[Array, Flags, Triangles]:
    """Triangles of marching cubes with corners near one node as one.

    nodes: (N, 3) corners in units of the grid

    Corners [m], whether each lies in a plane of the grid across the slices' normal, and the
    triangles without those that this folds away.
    """
    columns = [np.interp(nodes[:, k], np.arange(len(axis)), axis) for k, axis in enumerate(axes)]
    in_plane = nodes[:, 2] == np.rint(nodes[:, 2])

    # Corners with one key become one, in their middle: the node's number, or a corner's own.
    nearest = np.rint(nodes)
    is_close = np.abs(nodes - nearest).max(axis=1) < SNAP
    size = nearest.max(axis=0) + 1
    key = (nearest[:, 0] * size[1] + nearest[:, 1]) * size[2] + nearest[:, 2]
    key[~is_close] = -1 - np.flatnonzero(~is_close)
    _, merged = np.unique(key, return_inverse=True)
    sums = [np.bincount(merged, column) for column in columns]
    middles = np.column_stack(sums) / np.bincount(merged)[:, None]
    in_plane = np.bincount(merged, in_plane) > 0

    faces = merged[triangles]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    # Two triangles on the same corners enclose nothing between them.
    corners = np.sort(faces, axis=1)
    _, row, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    faces = faces[count[row.ravel()] == 1]
    used, faces = np.unique(faces, return_inverse=True)
    return middles[used], in_plane[used], faces.reshape(-1, 3).astype(np.int32)


def moved_onto_level(
    stack: Stack, places: Array, on_end: Flags, on_cap: Flags, step: float,
    ends: tuple[float, float],
) -> tuple[Array, float]:  # fmt: skip
    """Corners (N, 3) moved onto the level, and the largest distance that is left [m].

    Newton's method along the gradient. Corners on the end planes stay in them, caps as a whole. A
    corner keeps the nearest place that it came by.
    """
    best_points = places.copy()
    best_distance = np.full(len(places), np.inf)
    points = places.copy()
    moving = np.flatnonzero(~on_cap)
    # A corner moves for as long as it comes nearer: three steps, and a few more at ridges.
    while len(moving):
        value, gradient = stack.signed(points[moving])
        gradient[on_end[moving], 2] = 0.0
        distance = np.abs(value)
        is_better = distance < best_distance[moving]
        better = moving[is_better]
        best_distance[better] = distance[is_better]
        best_points[better] = points[better]
        continues = is_better & (distance > ROUNDING_M)
        moving, value, gradient = moving[continues], value[continues], gradient[continues]
        # Near a ridge the gradient is small. The step is half a cell at most.
        square = np.maximum((gradient**2).sum(axis=1), MIN_SLOPE**2)
        move = -(value / square)[:, None] * gradient
        length = row_lengths(move)
        move *= np.minimum(1.0, step / 2 / np.maximum(length, 1e-15))[:, None]
        points[moving] = best_points[moving] + move
        points[moving, 2] = np.clip(points[moving, 2], *ends)
    return best_points, float(best_distance[~on_cap].max(initial=0.0))


def without_wide_corners(points: Array, triangles: Triangles) -> Triangles:
    """The same surface with the edges opposite wide corners flipped.

    points: (N, 3) corners
    triangles: (K, 3) rows of them, alike in orientation
    """
    triangles = triangles.copy()
    around = np.arange(len(triangles))
    while True:  # Each flip makes the widest corner of two triangles narrower, so this ends.
        cosines = corner_cosines(points[triangles[around]])
        smallest = cosines.min(axis=1)
        wide = np.flatnonzero(smallest < np.cos(np.radians(WIDE_CORNER_DEG)))
        wide = wide[np.argsort(smallest[wide], kind="stable")]
        rows = around[wide]
        at_wide_corner = np.zeros(len(points), bool)
        at_wide_corner[triangles[rows]] = True
        around = np.flatnonzero(at_wide_corner[triangles].any(axis=1))
        flips = possible_flips(triangles, around, rows, cosines[wide].argmin(axis=1))
        if not flip_where_better(points, triangles, flips):
            return triangles


def possible_flips(
    triangles: Triangles, around: Indices, rows: Indices, wide_corners: Indices
) -> list[tuple[int, ...]]:
    """The flips opposite wide corners that make a new edge.

    Each (row, other_row, a, b, c, d): the edge b-c between two triangles may become the edge a-d.

    around: all triangles at the corners of `rows`
    rows, wide_corners: triangles and which corner of each is wide

    No triangle is in two of the flips.
    """
    owner = {}
    for row, (a, b, c) in zip(around.tolist(), triangles[around].tolist(), strict=True):
        owner[a, b] = owner[b, c] = owner[c, a] = row
    flips = []
    used = set()
    for row, corner in zip(rows.tolist(), wide_corners.tolist(), strict=True):
        a, b, c = np.roll(triangles[row], -corner).tolist()
        other_row = owner.get((c, b))
        if other_row is None or row in used or other_row in used:
            continue
        d = int(triangles[other_row].sum()) - b - c
        if (a, d) not in owner and (d, a) not in owner:
            used.update((row, other_row))
            owner[a, d] = row  # A second flip must not make the same edge.
            flips.append((row, other_row, a, b, c, d))
    return flips


def flip_where_better(points: Array, triangles: Triangles, flips: list[tuple[int, ...]]) -> bool:
    """Flip where that makes the narrowest corner wider; whether any was."""
    row, other_row, a, b, c, d = np.array(flips, np.int64).reshape(-1, 6).T
    before = triangles[np.stack([row, other_row])]
    after = np.stack([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
    narrowest_before = corner_cosines(points[before]).max(axis=2).max(axis=0)
    narrowest_after = corner_cosines(points[after]).max(axis=2).max(axis=0)
    is_better = narrowest_after < narrowest_before
    triangles[row[is_better]] = after[0, is_better]
    triangles[other_row[is_better]] = after[1, is_better]
    return bool(is_better.any())


def corner_cosines(corners: Array) -> Array:
    """(..., 3) cosines of the angles of triangles (..., 3, 3)."""
    forward = np.roll(corners, -1, axis=-2) - corners
    back = np.roll(corners, 1, axis=-2) - corners
    sizes = np.sqrt((forward**2).sum(axis=-1) * (back**2).sum(axis=-1))
    return np.asarray((forward * back).sum(axis=-1) / np.maximum(sizes, np.finfo(float).tiny))
