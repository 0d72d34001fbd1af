"""Pictures of a planned slice: the pen's mask, the curve found on it, or what a refusal speaks of.

A curve is shown by an outline beside it, which does not cover its ink.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from vfplan.display import MAX_NUMBERED, finding_name
from vfplan.figures.style import DPI, HALO, MARGIN_IN, TEXT_PT, WIDTH_PX, draw_scale, on_slice
from vfplan.geometry.lines import normals
from vfplan.images.read import as_uint8, side_of_patient
from vfplan.io.writing import write_whole
from vfplan.palette import BRIDGED, CLOUD, CYCLE, ERROR, FORCE, TUBE, WALL

if TYPE_CHECKING:
    from vfplan.curve.account import AccountEntry
    from vfplan.curve.extraction import Extraction
    from vfplan.errors import CurveError
    from vfplan.findings import Finding
    from vfplan.fixture import RegistrationRecord, Stroke
    from vfplan.images.read import PlannedImage


# Width [px of the picture] of the largest slice: two pages side by side.
MAX_WIDTH_PX = 2 * WIDTH_PX

# Number of arrow heads along a stroke, which show its direction.
ARROWS = 6

# Distance [px of the picture] between the edge of the ink and the outline.
OUTLINE_GAP_PX = 3.0

# Distance [px of the picture] between the outline and the arrow heads along it.
ARROW_GAP_PX = 3 * OUTLINE_GAP_PX

# Length [px of the picture] of an arrow.
ARROW_PX = 32

# Diameter [pt] of the ring around a place that a refusal speaks of.
RING_PT = 3 * TEXT_PT

# Distance [px of the slice] from a line up to which a place belongs to it.
ON_LINE_PX = 20.0

# Distance [pt] of a word from the place that it speaks of: clear of the ring.
WORD_DISTANCE_PT = RING_PT / 2 + 1


def draw_mask(extraction: Extraction, path: Path) -> None:
    """Write the pen's mask, white on black, at the image's own size (the paper's Fig. 5b)."""
    _, data = cv2.imencode(".png", extraction.mask.astype(np.uint8) * 255)
    write_whole(path, [data.tobytes()], overwrite=True)


def draw_overlay(
    image: PlannedImage, extraction: Extraction, path: Path, *,
    markers: RegistrationRecord | None = None, findings: Sequence[Finding] = (),
) -> None:  # fmt: skip
    """Write the slice in its true greys with what was found on it; the ink stays visible.

    Drawn: an outline beside each curve with its start, direction and bridged parts; all other ink
    with its number in the account; the findings that have a place, by their numbers; and the
    markers where given. A length in mm and the patient's sides stand where the image tells them.
    """
    with drawing_on(image, path) as (axes, scale):
        if extraction.method == "mask":
            (stroke,) = extraction.strokes
            axes.plot(*stroke.points.T, ".", ms=1, color=CLOUD, label="pixels of the mask")
        else:
            for stroke in extraction.strokes:
                draw_stroke(axes, stroke, scale)
            name_ends(axes, extraction.strokes)
        draw_account(axes, extraction.account)
        if markers is not None:
            # Crosses without labels: most slices have the labels on them already.
            places = markers.source.T[:2]
            axes.plot(*places, "+", ms=10, mew=1.5, color=TUBE, label="marker", zorder=6)
        for number, finding in enumerate(findings, 1):
            if finding.place_px is not None:
                write_beside(axes, image, finding.place_px, finding_name(number), FORCE)


def draw_refusal(image: PlannedImage, error: CurveError, path: Path) -> None:
    """Write the slice with what a refusal speaks of: its place, and the lines to choose from."""
    place = [error.numbers.get(name, np.nan) for name in ("u_px", "v_px")]
    away_px = [np.hypot(*(line - place).T).min() for line in error.lines]
    with drawing_on(image, path) as (axes, _):
        for number, line in enumerate(error.lines[:MAX_NUMBERED], 1):
            colour = CYCLE[(number - 1) % len(CYCLE)]
            words = f"--stroke {number}"
            # The number of a line that was chosen and refused would be refused again.
            is_chosen = error.code != "several-candidates"
            if number in error.forked or (is_chosen and away_px[number - 1] < 2 * OUTLINE_GAP_PX):
                words = f"{number}: page only"
            if error.code == "line-dotted":
                words = "the dotted line"
            axes.plot(*line.T, color=colour, lw=1.2, label=words)
            write_beside(axes, image, line[0], str(number), colour)
        # Between two lines that are far apart there is nothing to see.
        if "u_px" in error.numbers and min(away_px, default=0.0) <= ON_LINE_PX:
            axes.plot(*place, "o", ms=RING_PT, mfc="none", mec=WALL, mew=2, zorder=8)
            write_beside(axes, image, place, error.code, WALL)


def write_beside(
    axes: Any, image: PlannedImage, place: Sequence[float], text: str, colour: str
) -> None:
    """Write a word beside a place, towards the middle of the slice, where it has room."""
    is_left, is_low = place[0] < image.width_px / 2, place[1] > image.height_px / 2
    look = {"color": colour, "weight": "bold", "bbox": {"fc": "white", "ec": colour, "pad": 1.5}}
    shift = np.where([is_left, is_low], WORD_DISTANCE_PT, -WORD_DISTANCE_PT)
    where = {"ha": "left" if is_left else "right", "va": "bottom" if is_low else "top", "zorder": 9}
    axes.annotate(text, place, xytext=shift, textcoords="offset points", **where, **look)


@contextmanager
def drawing_on(image: PlannedImage, path: Path) -> Iterator[tuple[Any, float]]:
    """Write the slice with what the block draws on it: axes, and the picture's pixels a pixel."""
    size = image.width_px, image.height_px
    scale = np.clip(image.width_px, WIDTH_PX, MAX_WIDTH_PX) / image.width_px
    middle = MARGIN_IN / 2 / (image.height_px * scale / DPI + MARGIN_IN)
    legend = {"loc": "center", "bbox_to_anchor": (0.5, middle), "fontsize": "small",
              "columnspacing": 1.0, "handlelength": 1.4, "handletextpad": 0.5, "ncols": 6,
              "frameon": False}  # fmt: skip
    with on_slice(path, size, scale / DPI, MARGIN_IN, **legend) as (_, axes):
        axes.imshow(as_uint8(image.rgb), interpolation="nearest")
        yield axes, scale
        if image.pixel_spacing_mm is not None:
            draw_scale(axes, image.pixel_spacing_mm[0])
        draw_sides(axes, image)


def draw_sides(axes: Any, image: PlannedImage) -> None:
    """The patient's sides at the four edges, as DICOM names them."""
    if image.T_patient_image is None:
        return
    along_u, along_v = image.T_patient_image[:3, :2].T
    directions = ((0.98, 0.5, along_u), (0.02, 0.5, -along_u), (0.5, 0.03, along_v),
                  (0.5, 0.97, -along_v))  # fmt: skip
    look = {"ha": "center", "va": "center", "weight": "bold", "color": FORCE,
            "transform": axes.transAxes, "path_effects": HALO, "zorder": 8}  # fmt: skip
    for x, y, direction in directions:
        axes.text(x, y, side_of_patient(direction), **look)


def draw_stroke(axes: Any, stroke: Stroke, scale: float) -> None:
    """An outline along the ink, and the direction."""
    points = stroke.points
    # A curve that was given as points has no ink, and no width.
    distance = (stroke.width or 0.0) / 2 + OUTLINE_GAP_PX / scale
    left = normals(points, stroke.closed)
    for beside in (points + distance * left, points - distance * left):
        # Within a narrow bend there is no room beside the ink.
        is_free = cKDTree(points).query(beside)[0] > 0.9 * distance
        outline = np.where(is_free[:, None], beside, np.nan)
        axes.plot(*outline.T, color=CLOUD, lw=1.0, path_effects=HALO, label="curve", zorder=3)
        if stroke.bridged.any():
            outline = outline[stroke.bridged]
            axes.plot(*outline.T, ".", color=BRIDGED, ms=2, label="bridged", zorder=4)
    # Arrows beside the line, to the right of who goes along it.
    shown = np.linspace(0, len(points) - 1, ARROWS + 2)[1:-1].astype(int)
    along = ARROW_PX / scale * np.column_stack([left[:, 1], -left[:, 0]])
    starts = points + (distance + ARROW_GAP_PX / scale) * left
    look = {"arrowstyle": "-|>", "color": CLOUD, "shrinkA": 0, "shrinkB": 0}
    for place, way in zip(starts[shown], along[shown], strict=True):
        axes.annotate("", place + way, place, arrowprops=look, zorder=5)
    axes.plot([], [], ls="none", marker=">", color=CLOUD, label="direction")


def name_ends(axes: Any, strokes: Sequence[Stroke]) -> None:
    """Where each line, in pixels, starts and ends; of several with their numbers."""
    look = {"textcoords": "offset points", "fontsize": "small", "color": FORCE, "weight": "bold",
            "path_effects": HALO, "zorder": 6}  # fmt: skip
    for number, stroke in enumerate(strokes, 1):
        name = f" {number}" if len(strokes) > 1 else ""
        axes.annotate(f"start{name}", stroke.points[0], xytext=(9, 9), **look)
        if not stroke.closed:
            axes.annotate(f"end{name}", stroke.points[-1], xytext=(9, -14), **look)


def draw_account(axes: Any, account: tuple[AccountEntry, ...]) -> None:
    """A box around each piece of other ink, with its number; the smallest of many are left out."""
    from matplotlib.patches import Rectangle

    for entry in account[:MAX_NUMBERED]:
        if entry.what != "ink":
            continue
        left, top, width, height = entry.box
        corner = left - 3.5, top - 3.5
        look = {"fill": False, "ec": ERROR, "lw": 1.2, "ls": "--", "label": "other ink"}
        axes.add_patch(Rectangle(corner, width + 6, height + 6, path_effects=HALO, **look))
        words = {"color": ERROR, "fontsize": "small", "va": "bottom", "clip_on": True}
        axes.text(*corner, str(entry.number), path_effects=HALO, **words)
