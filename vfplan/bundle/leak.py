"""The leak certificate: could the proxy pass between two samples of the fixture?

The proxy's centre keeps R - band from every point (R = r_c + r_v). It cannot cross a segment whose
ends are at most 2 (R - band) apart, nor a triangle no point of which is farther than R - band from
the nearest corner (its covering radius: the circumradius, or less if the triangle is obtuse). Of
bare points nothing follows: how they connect is not in the file. With an ignored axis everything
is measured across it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.bundle.content import Content
from vfplan.geometry.lines import Array, Flags, flattened, row_lengths

# Of points or strokes, or (K, 3) of the corners of triangles.
Rows = NDArray[np.integer]

# Number of triangles or points that are looked at together, to bound memory.
BLOCK = 1 << 18
# Pieces of a cloud whose way to the next piece is measured, and places of an opening looked around.
LARGEST_PIECES = 64
# Largest area of a sheet for that of the skin over its rim. Half a sphere has twice as much.
SHEET = 1.5
# Places along an opening that are tried at first.
MAX_CELLS = 64


def certificate(content: Content) -> Content:
    """The values of `/leak`, computed from the rest of a bundle's content with `/rendering`.

    What every reader computes again comes from the reader in C++ (vfplan/bundle/leak.hpp).
    """
    corners, axis = content["/points"], content.get("/rendering/ignore_axis")
    radius = content["/rendering@contact_radius_m"] + content["/rendering@point_radius_m"]
    kind, largest, limit, holds, rows = _core.certificate(
        corners,
        axis,
        float(radius - content["/rendering@band_m"]),
        stroke=content.get("/curve/stroke"),
        closed=content.get("/curve/closed"),
        triangles=content.get("/mesh/triangles"),
        sample_radius=content.get("/mesh@sample_radius_m"),
    )
    leak = {"/leak@kind": kind}
    if kind == "cloud":
        # How the points of a bare cloud connect is not known, so there is no limit.
        largest, row = loneliest(flattened(corners, axis))
        place = corners[row]
    else:
        place = corners[rows].mean(axis=0)
        leak["/leak@limit_m"] = limit
    if kind == "mesh" and (count := open_edges(content["/mesh/triangles"])):
        leak["/leak@open_edges"] = count
    if kind == "curve":
        leak |= open_ends(content)
    leak["/leak@largest_m"] = float(largest)
    leak["/leak/place"] = place
    leak["/leak@certified"] = int(holds)
    return leak


def largest_cover(triangles: Rows, points: Array) -> float:
    """How far a place of a triangle is from the triangle's nearest corner, at most [m]."""
    rows = np.ascontiguousarray(triangles, np.int32)
    return _core.certificate(points, None, 0.0, triangles=rows)[1]


def stroke_ends(stroke: Rows) -> tuple[Rows, Rows]:
    """Index of the first and of the last point of each stroke."""
    first = np.append(0, np.flatnonzero(stroke[1:] != stroke[:-1]) + 1)
    return first, np.append(first[1:], len(stroke)) - 1


def open_edges(triangles: Rows) -> int:
    """Number of edges that belong to exactly one triangle."""
    sides = sides_of(triangles)
    sides.sort()
    is_new = np.concatenate([[True], sides[1:] != sides[:-1], [True]])
    return int(np.count_nonzero(is_new[1:] & is_new[:-1]))


def sides_of(triangles: Rows) -> Rows:
    """(3 K,) edges as (lower << 32 | higher) end, each once for every triangle that it is of."""
    following = np.roll(triangles, -1, axis=1)
    sides = np.minimum(triangles, following).astype(np.int64)
    sides <<= 32
    sides |= np.maximum(triangles, following)
    return sides.ravel()


def parts_of(count: int, pairs: Rows) -> Rows:
    """(count,) the number of the part that each thing is of, where pairs (n, 2) join things."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (count, count))
    return connected_components(graph, directed=False)[1]


def turned_facets(triangles: Rows) -> Flags:
    """(K,) the facets to turn over so that all that share an edge agree; as few as possible."""
    runs_up = (triangles < np.roll(triangles, -1, axis=1)).ravel()
    key = sides_of(triangles)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    one, two = order[first[count == 2]], order[first[count == 2] + 1]
    # Two facets agree where they run along their edge in opposite ways.
    differ = runs_up[one] == runs_up[two]
    if not differ.any():
        return np.zeros(len(triangles), bool)
    # Each facet stands twice, as it is and turned over (K later), and is joined to what it fits.
    k = len(triangles)
    one, two = one // 3, two // 3
    pairs = np.stack((np.append(one, one + k), np.append(two + k * differ, two + k * ~differ)))
    as_it_is, turned = parts_of(2 * k, pairs.T).reshape(2, k)
    votes = np.bincount(as_it_is, minlength=2 * k)
    fewer = votes[as_it_is] - votes[turned]
    return (fewer < 0) | ((fewer == 0) & (as_it_is > turned))


def rim_edges(triangles: Rows) -> Rows:
    """(E, 2) ends of the edges that belong to exactly one triangle."""
    edges, count = np.unique(sides_of(triangles), return_counts=True)
    return np.column_stack((edges[count == 1] >> 32, edges[count == 1] & 0xFFFFFFFF))


def widest_opening(
    points: Array, triangles: Rows, samples: Array, reach: float
) -> tuple[float, Array]:
    """The largest ball that may go through a mesh, if it is larger than `reach` [m], and where.

    samples: of the mesh, dense against `reach`

    Its radius [m], 0 where there is none. Whatever goes through an opening crosses the skin that is
    stretched over its rim; how large a ball fits on a skin is known. Rims are taken to be simple
    when seen along their thinnest side. The rim around a sheet is no opening.
    """
    widest = (0.0, points[0])
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    piece = parts_of(len(points), np.concatenate((triangles[:, :2], triangles[:, 1:])))
    areas = np.bincount(piece[triangles[:, 0]], row_lengths(np.cross(b - a, c - a)) / 2)
    rim = rim_edges(triangles)
    part = parts_of(len(points), rim)[rim[:, 0]]
    order = np.argsort(part, kind="stable")
    tree = None
    for rows in np.split(order, np.flatnonzero(np.diff(part[order])) + 1):
        edges = points[rim[rows]]
        if len(edges) and np.linalg.norm(np.ptp(edges.reshape(-1, 3), axis=0)) > 2 * reach:
            tree = tree or kd_tree(samples)
            area = areas[piece[rim[rows[0], 0]]]
            widest = max(widest, widest_place(edges, tree, reach, area), key=lambda one: one[0])
    return widest if widest[0] > reach else (0.0, widest[1])


def widest_place(edges: Array, tree: Any, reach: float, area: float) -> tuple[float, Array]:
    """Of a skin over edges (E, 2, 3) the place farthest from a tree's points, and how far [m].

    area: of the mesh that has this rim [m2]; it is 0 m to the skin over a sheet
    """
    centre = edges.mean(axis=(0, 1))
    axes = np.linalg.svd((edges - centre).reshape(-1, 3), full_matrices=False)[2]
    start, end = np.moveaxis((edges - centre) @ axes.T, 1, 0)
    low, high = start[:, :2].min(axis=0), start[:, :2].max(axis=0)
    side = max(reach / 2, float((high - low).max()) / MAX_CELLS)
    grids = np.meshgrid(*(np.arange(a, b, side) + side / 2 for a, b in zip(low, high, strict=True)))
    places = np.column_stack([grid.ravel() for grid in grids])
    around = np.stack(np.meshgrid((-1, 0, 1), (-1, 0, 1)), axis=-1).reshape(-1, 2)
    best = (0.0, centre)
    while side > reach / 100:
        blocks = np.array_split(places, 1 + len(places) * len(edges) // BLOCK)
        skin = np.concatenate([on_skin(block, start, end) for block in blocks])
        is_inside = np.isfinite(skin[:, 2])
        if area < SHEET * side**2 * np.count_nonzero(is_inside) and best[0] == 0:
            break
        distance = np.zeros(len(skin))
        distance[is_inside] = tree.query(skin[is_inside] @ axes + centre)[0]
        nearest = np.argsort(-distance)[:LARGEST_PIECES]
        if distance[nearest[0]] > best[0]:
            best = float(distance[nearest[0]]), skin[nearest[0]] @ axes + centre
        side /= 3
        places = (places[nearest][:, None] + side * around).reshape(-1, 2)
    return best


def on_skin(places: Array, start: Array, end: Array) -> Array:
    """(n, 3) places (n, 2) within a rim, as high as the rim about them; outside it at NaN."""
    u, v = places[:, :1], places[:, 1:]
    spans = (start[:, 1] > v) != (end[:, 1] > v)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (v - start[:, 1]) / (end[:, 1] - start[:, 1])
    is_inside = (spans & (start[:, 0] + share * (end[:, 0] - start[:, 0]) > u)).sum(axis=1) % 2 == 1
    weights = 1 / ((u - start[:, 0]) ** 2 + (v - start[:, 1]) ** 2 + 1e-18)
    height = weights @ start[:, 2] / weights.sum(axis=1)
    return np.column_stack((places, np.where(is_inside, height, np.nan)))


def joined_corners(points: Array, triangles: Rows, reach: float) -> Rows:
    """(N,) for each point itself, or on a rim the first one within `reach` [m] by small steps."""
    rim = np.unique(rim_edges(triangles))
    corner = np.arange(len(points))
    if len(rim):
        parts = parts_of(len(rim), kd_tree(points[rim]).query_pairs(reach, output_type="ndarray"))
        _, first, part = np.unique(parts, return_index=True, return_inverse=True)
        corner[rim] = rim[first[part]]
    return corner


def pieces_of(points: Array, reach: float) -> tuple[int, float]:
    """How many pieces a cloud is in if points up to `reach` [m] apart belong together.

    With it the widest way from one of the largest pieces to the next [m]; 0 for a single piece.
    """
    from scipy.spatial.distance import cdist

    # The points of a cell belong together. Where one point of each does not say, all of them do.
    side = reach / 4
    cells = np.floor((points - points.min(axis=0)) / side).astype(np.int64)
    _, rows, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    order, sizes = np.argsort(cell.ravel(), kind="stable"), np.bincount(cell.ravel())
    members = np.split(order, np.cumsum(sizes)[:-1])
    few = points[rows]
    pairs = kd_tree(few).query_pairs(reach + 2 * np.sqrt(3) * side, output_type="ndarray")
    is_near = row_lengths(few[pairs[:, 0]] - few[pairs[:, 1]]) <= reach
    part = parts_of(len(rows), pairs[is_near])
    waiting = ~is_near & (part[pairs[:, 0]] != part[pairs[:, 1]]) & (sizes[pairs] > 1).any(axis=1)
    near = [
        pair for pair in pairs[waiting]
        if cdist(points[members[pair[0]]], points[members[pair[1]]]).min() <= reach
    ]  # fmt: skip
    part = parts_of(len(rows), np.concatenate((pairs[is_near], np.reshape(near, (-1, 2)))))
    counts = np.bincount(part)
    widest = 0.0
    for number in np.argsort(-counts)[:LARGEST_PIECES] if len(counts) > 1 else ():
        others = kd_tree(few[part != number])
        widest = max(widest, float(others.query(few[part == number])[0].min()))
    return len(counts), widest


def loneliest(points: Array) -> tuple[float, int]:
    """(distance [m], index) of the point farthest from its nearest neighbour; 0 for one point."""
    rows, place = places_of(points)
    best = (0.0, 0)
    if len(rows) == 1:
        return best
    is_alone = np.bincount(place) == 1
    del place
    tree = kd_tree(points[rows])
    for start in range(0, len(rows), BLOCK):
        # In the tree's order neighbours stand near each other.
        block = tree.indices[start : start + BLOCK]
        block = block[is_alone[block]]
        if len(block):
            distance = tree.query(tree.data[block], k=[2], workers=-1)[0][:, 0]
            farthest = int(np.argmax(distance))
            best = max(best, (float(distance[farthest]), int(rows[block[farthest]])))
    return best


def places_of(points: Array) -> tuple[Rows, Rows]:
    """A point of each place, and (N,) the number of the place of each point.

    No tree can part points of one place, so a search among them would look at each.
    """
    # Half the memory of NumPy's own type: no bundle has 2**31 points.
    order = np.lexsort(points.T).astype(np.int32)
    is_new = np.arange(len(points)) == 0
    for column in points.T:
        is_new[1:] |= np.diff(column[order]) != 0
    place = np.empty(len(points), np.int32)
    place[order] = np.cumsum(is_new) - 1
    return order[is_new], place


def kd_tree(points: Array) -> Any:
    """A tree that is quick to make."""
    from scipy.spatial import cKDTree

    return cKDTree(points, leafsize=32, balanced_tree=False, compact_nodes=False)


def open_ends(content: Content) -> Content:
    """Open ends, and how far the farthest of them is from any other stroke."""
    stroke = content["/curve/stroke"]
    is_closed = content["/curve/closed"].astype(bool)
    first, last = stroke_ends(stroke)
    ends = np.column_stack([first, last])[~is_closed].ravel()
    if len(ends) == 0:
        return {}
    leak = {"/leak/open_ends": content["/points"][ends]}
    if len(is_closed) > 1:
        points = flattened(content["/points"], content.get("/rendering/ignore_axis"))
        distance = distance_to_other_strokes(points, stroke, ends)
        farthest = int(np.argmax(distance))
        leak["/leak@between_m"] = float(distance[farthest])
        leak["/leak/between_place"] = content["/points"][ends[farthest]]
    return leak


def distance_to_other_strokes(points: Array, stroke: Rows, ends: Rows) -> Array:
    """(E,) distance [m] of each of these points to the nearest one of another stroke."""
    rows, place = places_of(points)
    tree, stroke_in_tree = kd_tree(points[rows]), stroke[rows]
    # Where several strokes meet, each of them is at another one.
    is_shared = np.bincount(place[stroke != stroke_in_tree[place]], minlength=len(rows)) > 0
    stroke_in_tree[is_shared] = -1
    distance = np.where(is_shared[place[ends]], 0.0, np.inf)
    count = 8
    while len(waiting := np.flatnonzero(np.isinf(distance))):
        count = min(count, len(rows))
        for chosen in np.array_split(waiting, 1 + len(waiting) * count // BLOCK):
            to_nearest, index = tree.query(points[ends[chosen]], k=[*range(1, count + 1)])
            is_same_stroke = stroke_in_tree[index] == stroke[ends[chosen], None]
            distance[chosen] = np.where(is_same_stroke, np.inf, to_nearest).min(axis=1)
        count *= 4
    return distance
