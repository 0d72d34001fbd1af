"""A picture of a surface: with its outlines in space, and cut on three of its slices."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.figures.style import new_figure, save_png, style
from vfplan.palette import CONTACT, FORCE, HIP

if TYPE_CHECKING:
    from vfplan.surface import Surface

Array = NDArray[np.float64]
TURNED = np.radians(25)
"""How far to the side the eye is."""
RAISED = np.radians(20)
"""How far above the eye is."""
VIEW = np.array(
    [
        [np.cos(TURNED), np.sin(TURNED), 0],
        [-np.sin(RAISED) * np.sin(TURNED), np.sin(RAISED) * np.cos(TURNED), np.cos(RAISED)],
        [np.cos(RAISED) * np.sin(TURNED), -np.cos(RAISED) * np.cos(TURNED), np.sin(RAISED)],
    ]
)  # rows: to the right, up, towards the eye
CUTS = (0.2, 0.5, 0.8)  # of the stack's height: where it is cut
MAX_RINGS = 60


def draw_surface(made: Surface, path: Path) -> None:
    """Write the surface seen from the side with its outlines, and cuts at and between slices.

    On the right the outlines of three slices, and the surface's own cut half a gap beyond each, in
    the slices' plane [mm].
    """
    figure = new_figure(11.0, 6.4)
    with style():
        grid = figure.add_gridspec(3, 2, width_ratios=(1.5, 1))
        left = figure.add_subplot(grid[:, 0])
        _draw_seen(left, made)
        left.set_title(
            f"{made.report['slices']} slices, {made.report['spacing_mm']:.3g} mm apart; "
            f"{made.report['triangles']} triangles"
        )
        stack = max(made.sliced.stacks, key=lambda s: len(s.outlines))
        for row, share in enumerate(reversed(CUTS)):
            axes = figure.add_subplot(grid[row, 1])
            k = min(int(share * len(stack.outlines)), len(stack.outlines) - 2)
            _draw_cut(axes, made, stack, k)
            if row == 0:
                figure.legend(*axes.get_legend_handles_labels(), loc="lower left", ncols=3)
        save_png(figure, path)


def _draw_cut(axes: Any, made: Surface, stack: Any, k: int) -> None:
    z = stack.z
    middle = (z[k] + z[k + 1]) / 2
    for line, ring in enumerate(stack.outlines[k].rings):
        closed = 1e3 * np.vstack([ring, ring[:1]])
        axes.plot(*closed.T, color=HIP, lw=2.2, label=None if line else "outline")
    for at, colour, name in ((z[k], FORCE, "surface there"), (middle, CONTACT, "half a gap on")):
        for line, piece in enumerate(_cut(made, at)):
            axes.plot(*1e3 * piece.T, color=colour, lw=0.9, label=None if line else name)
    axes.set_aspect("equal")
    axes.set_title(f"{1e3 * z[k]:.1f} mm (axes in mm)", fontsize=9)
    axes.tick_params(labelsize=7)


def _cut(made: Surface, z: float) -> list[Array]:
    """(2, 2) pieces of the surface's cut at one height, in the slices' plane [m]."""
    local = made.fixture.points @ made.sliced.R_slice_patient.T
    # The surface has corners on the slice itself; a nanometre beyond, it is cut between corners.
    height = local[:, 2] - (z + 1e-9)
    corners = made.fixture.mesh[np.ptp((height > 0).astype(int)[made.fixture.mesh], axis=1) > 0]
    pieces = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        one, other = corners[:, a], corners[:, b]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = height[one] / (height[one] - height[other])
        at = local[one, :2] + t[:, None] * (local[other, :2] - local[one, :2])
        at[(height[one] > 0) == (height[other] > 0)] = np.nan
        pieces.append(at)
    found = np.stack(pieces, axis=1)
    return [piece[~np.isnan(piece[:, 0])] for piece in found]


def _draw_seen(axes: Any, made: Surface) -> None:
    """The surface from the side and a little above, lit from the eye, with its outlines."""
    from matplotlib.collections import LineCollection, PolyCollection

    local = 1e3 * made.fixture.points @ made.sliced.R_slice_patient.T
    corners = (local @ VIEW.T)[made.fixture.mesh]
    facing = _facing(corners, made.fixture.mesh, len(local))
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    # Open ends show the inside, which is darker.
    shade = np.where(facing > 0, 0.35 + 0.6 * facing, 0.25 - 0.15 * facing)[order]
    colours = shade[:, None] * np.array([[0.93, 0.88, 0.76]])
    axes.add_collection(
        PolyCollection(corners[order, :, :2], facecolors=colours, edgecolors=colours, lw=0.3)
    )
    outlines = [o for stack in made.sliced.stacks for o in stack.outlines]
    lines = []
    for outline in outlines[:: max(1, len(outlines) // MAX_RINGS)]:
        for ring in outline.outer_rings:
            line = 1e3 * np.c_[ring, np.full(len(ring), outline.z)] @ VIEW.T
            following = np.roll(line, -1, axis=0)
            # Only what faces the eye: a ring runs anticlockwise round what is inside.
            out = np.cross(following - line, VIEW[:, 2])[:, 2] > 0
            lines += list(np.stack([line, following], axis=1)[out, :, :2])
    axes.add_collection(LineCollection(lines, colors=HIP, lw=0.8))
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()


def _facing(corners: Array, triangles: NDArray[np.int32], count: int) -> Array:
    """(K,) cosine between the eye's direction and the surface's normal, smoothed over corners."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    around = np.zeros((count, 3))
    for corner in range(3):
        np.add.at(around, triangles[:, corner], normal)
    smooth = around[triangles].sum(axis=1)
    return smooth[:, 2] / np.maximum(np.linalg.norm(smooth, axis=1), 1e-15)
