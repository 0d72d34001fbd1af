"""What a fixture may hold that no rule forbids, and hardly anybody wants.

Sizes that a slip of units gives, millimetres for metres or the other way round: the format's own
range catches the grossest only, and an affine registration fits any scale. Holes in a mesh.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.bundle.leak import sorted_edges
from vfplan.fixture import Fixture

LEAST_M, MOST_M = 1e-3, 3.0  # across: a mark on a bone, a patient
FARTHEST_M = 10.0  # from the origin: a robot in the same room


def size_doubt(points: NDArray[np.float64]) -> str | None:
    """What is doubtful about the size of a fixture's points (N, 3) [m]; `None` if nothing is."""
    low, high = points.min(axis=0), points.max(axis=0)
    across = float(np.max(high - low))
    far = float(np.max(np.maximum(np.abs(low), np.abs(high))))
    if far <= FARTHEST_M and (len(points) == 1 or LEAST_M <= across <= MOST_M):
        return None
    return (
        f"the points are {across:.3g} m across and up to {far:.3g} m from the origin along an axis;"
        f" {LEAST_M:g} to {MOST_M:g} m across, within {FARTHEST_M:g} m, is usual: is a unit wrong?"
    )


def mesh_doubts(fixture: Fixture) -> list[str]:
    """What a mesh has that no certificate of its triangles sees: rims, doubled faces."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges, count = np.unique(sorted_edges(fixture.mesh), return_counts=True)
    found, crowded = [], int(np.count_nonzero(count > 2))
    if (count == 1).any():
        ends = np.stack((edges[count == 1] >> 32, edges[count == 1] & 0xFFFFFFFF))
        used, ends = np.unique(ends, return_inverse=True)
        ends = ends.reshape(2, -1)
        graph = coo_array((np.ones(ends.shape[1]), tuple(ends)), (len(used), len(used)))
        rims, which = connected_components(graph, directed=False)
        places = [fixture.points[used[which == k]] for k in range(rims)]
        widest = max(float(np.linalg.norm(np.ptp(rim, axis=0))) for rim in places)
        found.append(
            f"the mesh is open: {ends.shape[1]} edges on {rims} rim{'s' * (rims != 1)}, the widest "
            f"{1e3 * widest:.1f} mm across; the proxy goes round a rim, and through a hole wider "
            f"than {2e3 * fixture.contact_radius:g} mm"
        )
    if crowded:
        found.append(f"{crowded} edges belong to three triangles or more: faces doubled or crossed")
    return found
