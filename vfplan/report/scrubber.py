"""What the scrubber and the plots need: frames, envelopes and the cloud, in mm, rounded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.display import MAX_DRAWN, MM
from vfplan.figures.replay import axis_names, plane_basis
from vfplan.figures.style import WIDTH_PX
from vfplan.fixture import Fixture
from vfplan.replaying import Replay
from vfplan.replaying.quantities import row_norms
from vfplan.replaying.thinning import thinned
from vfplan.session import TickBlock

Array = NDArray[np.float64]

COLUMNS = WIDTH_PX
"""Number of columns of the whole session's envelope, one for each pixel of the plot's width."""

ZOOM_COLUMNS = COLUMNS // 2
"""Number of columns of an episode's envelope. It is drawn coarser, to keep the page small."""

MAX_ZOOMS = 40
"""Number of episodes with an envelope of their own. A page of more would be slow to open."""


def placing(fixture: Fixture) -> tuple[Array, Array]:
    """The picture's axes as columns, (3, 2) in a plane or (3, 3), and the point that is 0 [m]."""
    basis = np.eye(3)
    if fixture.ignore_axis is not None:
        basis = plane_basis(fixture.ignore_axis)
    return basis, fixture.points.mean(axis=0)


def scene_data(fixture: Fixture) -> dict[str, Any]:
    """What stands still in the scene."""
    basis, centre = placing(fixture)
    step = -(-len(fixture.points) // MAX_DRAWN)
    return {
        "dims": basis.shape[1],
        "axes": axis_names(basis),
        "radius": MM * fixture.contact_radius,
        "cloud": _flat(MM * (fixture.points[::step] - centre) @ basis, 3),
    }


def scrubber_data(replayed: Replay) -> dict[str, Any]:
    """Frames as flat lists in the picture's axes; the third axis of a planar scene is left out.

    Lengths in mm to 1 µm, times in s, forces in N. Longer sessions show of each stretch the tick
    with the deepest penetration.
    """
    ticks = thinned(replayed.ticks, -(-len(replayed.ticks) // MAX_DRAWN))
    basis, centre = placing(replayed.fixture)
    episodes = replayed.metrics["episodes"]
    first_episode = episodes[0]["index"] if episodes else 0
    # An envelope of each episode with what is around it, and one of the whole session.
    zooms = []
    for episode in episodes[:MAX_ZOOMS]:
        start, end = episode["start_s"], episode["end_s"]
        margin = max(0.05, 0.2 * (end - start))
        zooms.append(envelope(replayed.ticks, (start - margin, end + margin), ZOOM_COLUMNS))
    whole = (float(replayed.ticks.time[0]), float(replayed.ticks.time[-1]))
    zooms.append(envelope(replayed.ticks, whole, COLUMNS))
    return {
        **scene_data(replayed.fixture),
        "time": np.round(ticks.time, 6).tolist(),
        "hip": _flat(MM * (ticks.hip - centre) @ basis, 3),
        "proxy": _flat(MM * (ticks.proxy - centre) @ basis, 3),
        "normal": _flat(ticks.normal @ basis, 3),
        "force": _flat(ticks.force @ basis, 4),
        "depth": np.round(MM * ticks.penetration, 4).tolist(),
        "state": ticks.state.tolist(),
        "episodes": [[episode["start_s"], episode["end_s"]] for episode in episodes],
        "first_episode": first_episode,
        "zooms": zooms,
    }


def envelope(ticks: TickBlock, span: tuple[float, float], columns: int) -> dict[str, Any]:
    """Smallest and largest force [N] and depth [mm] of stretches of equal length."""
    first = np.searchsorted(ticks.time, span[0])
    last = np.searchsorted(ticks.time, span[1], "right")
    starts = np.unique(np.linspace(first, last, columns, endpoint=False).astype(int))
    data: dict[str, Any] = {
        "span": list(span),
        "time": np.round(ticks.time[starts], 6).tolist(),
    }
    for name, values in (("force", row_norms(ticks.force)), ("depth", MM * ticks.penetration)):
        for end, extreme in (("low", np.minimum), ("high", np.maximum)):
            parts = extreme.reduceat(values[:last], starts)
            data[f"{name}_{end}"] = (np.round(parts, 4) + 0.0).tolist()
    return data


def tick_row(fixture: Fixture) -> Callable[[NDArray[np.void]], list[float]]:
    """How a tick of telemetry goes to the live page.

    t, state, status, HIP, proxy, normal and force in the picture's axes, |F| and |proxy - HIP|.
    """
    basis, centre = placing(fixture)

    def row(tick: NDArray[np.void]) -> list[float]:
        parts = [
            np.array([tick["t"], tick["state"], tick["status"]], float),
            MM * (tick["hip"] - centre) @ basis,
            MM * (tick["proxy"] - centre) @ basis,
            tick["normal"] @ basis,
            tick["force"] @ basis,
            [np.linalg.norm(tick["force"]), MM * np.linalg.norm(tick["proxy"] - tick["hip"])],
        ]
        return _flat(np.concatenate(parts), 4)

    return row


def _flat(rows: Array, decimals: int) -> list[float]:
    # Adding 0 turns -0.0 into 0.0.
    return (np.round(rows, decimals) + 0.0).ravel().tolist()
