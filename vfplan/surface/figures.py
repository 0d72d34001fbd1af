"""A picture of a surface: with its outlines in space, and cut on three of its slices."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vfplan.bundle.dicom import crossings
from vfplan.figures.style import new_figure, save_png, style
from vfplan.geometry.lines import Array
from vfplan.palette import FORCE, TUBE, WALL
from vfplan.surface.outline import rings_of

if TYPE_CHECKING:
    from vfplan.surface.build import Surface
    from vfplan.surface.outline import Stack

# Where the eye is: above the slices' plane, and around their normal from x on [degrees].
ELEVATION, AZIMUTH = 20, -65
BONE_COLOUR = (0.93, 0.88, 0.76)
# Number of outlines that are drawn on the surface. More would hide it.
MAX_OUTLINES = 60


def draw_surface(result: Surface, path: Path) -> None:
    """Write the surface seen from the side with its outlines, and cuts at and between slices.

    On the right the outlines of three slices, and the surface's own cut half a gap beyond each, in
    the slices' plane [mm].
    """
    figure = new_figure(11.0, 6.4)
    with style():
        grid = figure.add_gridspec(3, 2, width_ratios=(1.5, 1))
        large = figure.add_subplot(grid[:, 0], projection="3d", computed_zorder=False)
        draw_from_side(large, result)
        large.set_title(
            f"{result.report['slices']} slices, {result.report['spacing_mm']:.3g} mm apart; "
            f"{result.report['triangles']} triangles"
        )
        stack = max(result.sliced.stacks, key=lambda stack: len(stack.outlines))
        count = len(stack.outlines)
        for row, share in enumerate((0.8, 0.5, 0.2)):  # Of the stack's height, from the top.
            axes = figure.add_subplot(grid[row, 1])
            draw_cut(axes, result, stack, min(int(share * count), count - 2))
            if row == 0:
                figure.legend(*axes.get_legend_handles_labels(), loc="lower left", ncols=3)
        save_png(figure, path)


def draw_cut(axes: Any, result: Surface, stack: Stack, k: int) -> None:
    """The outline of slice k, and the surface's cuts there and half a gap beyond."""
    from matplotlib.collections import LineCollection

    z = stack.z
    outline = [1e3 * np.vstack([ring, ring[:1]]) for ring in stack.outlines[k].rings]
    there, halfway = (cut_pieces(result, place) for place in (z[k], (z[k] + z[k + 1]) / 2))
    for lines, label, colors, lw in (
        (outline, "outline", TUBE, 2.2),
        (there, "surface there", FORCE, 0.9),
        (halfway, "half a gap on", WALL, 0.9),
    ):
        axes.add_collection(LineCollection(lines, colors=colors, lw=lw, label=label))
    axes.autoscale()
    axes.set_aspect("equal")
    axes.set_title(f"{1e3 * z[k]:z.1f} mm (axes in mm)", fontsize="medium")
    axes.tick_params(labelsize="small")


def cut_pieces(result: Surface, z: float) -> Array:
    """(N, 2, 2) pieces of the surface's cut at one height, in the slices' plane [mm]."""
    local = result.fixture.points @ result.sliced.R_slice_patient.T
    # The surface has corners on the slice itself; a nanometre beyond, it is cut between corners.
    return 1e3 * crossings(local[result.fixture.mesh], 2, z + 1e-9)[:, :, :2]


def draw_from_side(axes: Any, result: Surface) -> None:
    """The surface from the side and a little above, with the outlines that face the eye."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection
    from shapely import Polygon

    local = 1e3 * result.fixture.points @ result.sliced.R_slice_patient.T
    axes.view_init(ELEVATION, AZIMUTH)
    axes.plot_trisurf(
        *local.T, triangles=result.fixture.mesh, color=BONE_COLOUR, lw=0, antialiased=False
    )
    up, around = np.radians([ELEVATION, AZIMUTH])
    to_eye = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    outlines = result.sliced.outlines
    lines = []
    for outline in outlines[:: max(1, len(outlines) // MAX_OUTLINES)]:
        for ring in rings_of([Polygon(part.exterior) for part in outline.parts]):  # No holes.
            line = 1e3 * np.c_[ring, np.full(len(ring), outline.z)]
            step = np.roll(line, -1, axis=0) - line
            # A ring runs anticlockwise round what is inside.
            faces_eye = np.cross(step, [0, 0, 1]) @ to_eye > 0
            lines += list(np.stack([line, line + step], axis=1)[faces_eye])
    axes.add_collection3d(Line3DCollection(lines, colors=TUBE, lw=0.8, zorder=2))
    axes.set_aspect("equal")
    axes.set_axis_off()
