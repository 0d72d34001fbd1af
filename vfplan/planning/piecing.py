"""The carried curve as lines and arcs, in the plane across the fixture's ignored axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.fixture import Fixture, Pieces


def with_pieces(fixture: Fixture, strokes: list[NDArray[np.float64]], tolerance: float) -> Fixture:
    """The fixture with its strokes as lines and arcs beside its points.

    Parameters
    ----------
    fixture
        One with a curve and an ignored axis; what guides is not rendered from pieces.
    strokes
        (M, 3) the measured curve of each, in the fixture's frame [m].
    tolerance
        How far the measured curve may lie from its pieces [m].

    Raises
    ------
    SettingError
        A fixture in space, without strokes, or that guides.
    """
    from vfplan.curve.arcs import fit_arcs, measure, places, plane

    if fixture.ignore_axis is None or fixture.curve is None or fixture.guidance is not None:
        raise SettingError("lines and arcs: only of strokes that forbid, across an ignored axis")
    frame = plane(fixture.ignore_axis)
    height = float((np.concatenate(strokes) @ fixture.ignore_axis).mean())
    vertices, bulges, counts, error = [], [], [], 0.0
    for points, closed in zip(strokes, fixture.curve.closed, strict=True):
        flat = points @ frame.T
        arcs = fit_arcs(flat, bool(closed), tolerance)
        error = max(error, measure(arcs, places(flat, bool(closed), tolerance)))
        vertices.append(arcs.vertices @ frame + height * fixture.ignore_axis)
        bulges.append(arcs.bulges)
        counts.append(len(arcs.bulges))
    stroke = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    pieces = Pieces(
        np.concatenate(vertices), np.concatenate(bulges), stroke, fixture.curve.closed, error
    )
    return replace(fixture, curve=replace(fixture.curve, pieces=pieces))
