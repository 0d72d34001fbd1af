"""What the scrubber needs: a few thousand frames and the cloud, in millimetres, rounded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.figures.replay import plane_basis
from vfplan.replaying import Replay
from vfplan.replaying.overview import thinned

Array = NDArray[np.float64]
FRAMES = 4000
CLOUD = 6000
MM = 1e3


def scrubber_data(replayed: Replay) -> dict[str, Any]:
    """Frames as flat lists in the picture's axes; the third axis of a planar scene is left out.

    Lengths in mm to 1 µm, times in s, forces in N. Longer sessions show of each stretch the tick
    with the deepest penetration.
    """
    fixture = replayed.fixture
    ticks = thinned(replayed.ticks, -(-len(replayed.ticks) // FRAMES))
    axis = fixture.ignore_axis
    basis = np.eye(3) if axis is None else plane_basis(axis)
    centre = fixture.points.mean(axis=0)
    step = -(-len(fixture.points) // CLOUD)
    return {
        "dims": basis.shape[1],
        "radius": MM * fixture.contact_radius,
        "cloud": _flat(MM * (fixture.points[::step] - centre) @ basis, 3),
        "time": np.round(ticks.time, 6).tolist(),
        "hip": _flat(MM * (ticks.hip - centre) @ basis, 3),
        "proxy": _flat(MM * (ticks.proxy - centre) @ basis, 3),
        "normal": _flat(ticks.normal @ basis, 3),
        "force": _flat(ticks.force @ basis, 4),
        "depth": np.round(MM * ticks.penetration, 4).tolist(),
        "state": ticks.state.tolist(),
        "episodes": [[e["start_s"], e["end_s"]] for e in replayed.metrics["episodes"]],
    }


def _flat(rows: Array, decimals: int) -> list[float]:
    # Adding 0 turns -0.0 into 0.0.
    return (np.round(rows, decimals) + 0.0).ravel().tolist()
