"""The picture of the slice on a sheet: an outline beside the ink, bands, markers and captions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.curve.centreline import runs
from vfplan.display import nice_length
from vfplan.fixture import Stroke
from vfplan.review import paper
from vfplan.review.captions import Labeller
from vfplan.review.insets import INSET_PX, draw_distance, ends_of
from vfplan.review.paper import (
    BAND_COLOUR,
    BLACK,
    BODY,
    BRIDGE_COLOUR,
    CONTENT_WIDTH,
    GREY,
    HEADING,
    LINE_COLOUR,
    MARGIN,
    MARGIN_COLOUR,
    WHITE,
    Box,
    Paper,
)
from vfplan.review.sheet_input import SheetInput
from vfplan.review.views import draw_tag

Array = NDArray[np.float64]

COLUMN_WIDTH = round(1.3 * INSET_PX)
"""Width [px of the page] of the column of facts beside the slice."""

PICTURE_WIDTH = CONTENT_WIDTH - COLUMN_WIDTH - BODY.line_height
"""Width [px of the page] of the slice at most."""

PICTURE_HEIGHT = 980
"""Height [px of the page] of the slice at most: a row of insets fits below it."""

OUTLINE_GAP = 7.0
"""Distance [px of the page] between the edge of the ink and the outline beside it."""

USUAL_HALF_WIDTH = 2.0
"""Half the pen's width [px of the slice] if nobody knows it: half of what pens mostly are."""

FREE_RADIUS = 20
"""Radius [px of the page] around an end that no outline, arrow or caption enters."""


AHEAD_RADIUS = 5 * FREE_RADIUS
"""Radius [px of the page] of the disc ahead of an end that no caption enters: a cover of the end
lies there, and it has to be visible."""

ARROW_LENGTH = INSET_PX // 4
"""Length [px of the page] of the longest arrow of a residual, about."""


@dataclass(frozen=True, eq=False)
class Panel:
    """The picture of the slice; `zoom` is how many pixels of the page one of the slice takes."""

    x: int
    y: int
    width: int
    height: int
    zoom: float

    def place(self, points_px: Any) -> Array:
        """Pixels of the slice to pixels of this picture; (0, 0) is the middle of the first."""
        return (np.asarray(points_px, dtype=float) + 0.5) * self.zoom - 0.5

    def outline_distance(self, stroke: Stroke) -> float:
        """From the middle of a line to the outline beside its ink [px of the page]."""
        half_width = stroke.width / 2 if stroke.width is not None else USUAL_HALF_WIDTH
        return half_width * self.zoom + OUTLINE_GAP


def draw_picture(
    sheet: Paper, content: SheetInput, rgb: NDArray[np.uint8], y: float, column_x: float,
    column_width: float,
) -> tuple[float, float]:  # fmt: skip
    """Draw the slice with all that is marked on it, and the legend in the column beside it.

    Returns where the next thing below begins, in the left part and in the column.
    """
    height, width = rgb.shape[:2]
    zoom = min(PICTURE_WIDTH / width, PICTURE_HEIGHT / height)
    size = max(1, round(width * zoom)), max(1, round(height * zoom))
    if zoom < 1:
        method = cv2.INTER_AREA
    elif zoom < 2:
        method = cv2.INTER_LINEAR
    else:
        method = cv2.INTER_NEAREST
    panel = Panel(MARGIN, round(y), *size, zoom)
    box = sheet.picture(panel.x, panel.y, cv2.resize(rgb, size, interpolation=method))
    sheet.frame(box)

    canvas = sheet.canvas[panel.y : panel.y + panel.height, panel.x : panel.x + panel.width]
    region = _draw_outline(canvas, content, panel)
    drawn_bands = _draw_bands(canvas, content, panel)
    enlargement = _residual_enlargement(content, panel)
    _draw_markers(canvas, content, panel, enlargement)
    labeller = Labeller(_kept_visible(content, panel, region, enlargement))
    _draw_captions(sheet, canvas, box, content, panel, labeller)

    bottom = _draw_scale_bar(sheet, content, panel)
    if labeller.omitted:
        words = f"There was no place for {labeller.omitted} captions; the lists below name all."
        bottom = sheet.paragraph(MARGIN, bottom, words, PICTURE_WIDTH, BODY, GREY)
    column_y = _draw_legend(sheet, content, enlargement, drawn_bands, column_x, y, column_width)
    return bottom, column_y


def _draw_outline(
    canvas: NDArray[np.uint8], content: SheetInput, panel: Panel
) -> NDArray[np.uint8]:
    """Draw the outline beside each line; returns the region that it surrounds, 255 inside."""
    region = np.zeros((panel.height, panel.width), np.uint8)
    for stroke in content.strokes:
        distance = panel.outline_distance(stroke)
        points = panel.place(stroke.points)
        if stroke.is_ordered:
            thickness = max(1, round(2 * distance))
            paper.draw_line(region, points, 255, thickness, stroke.closed)
        else:
            for point in points:
                paper.draw_disc(region, point, distance, 255)
    contours, _ = cv2.findContours(
        (region > 127).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE
    )
    casing, outline = np.zeros_like(region), np.zeros_like(region)
    cv2.drawContours(casing, contours, -1, 255, 4, cv2.LINE_AA)
    cv2.drawContours(outline, contours, -1, 255, 2, cv2.LINE_AA)
    for stroke in content.strokes:
        for end in ends_of(stroke):
            paper.draw_disc(casing, panel.place(end.place), FREE_RADIUS, 0)
            paper.draw_disc(outline, panel.place(end.place), FREE_RADIUS, 0)
    bridges = np.zeros_like(region)
    for stroke in content.strokes:
        thickness = round(2 * panel.outline_distance(stroke)) + 12
        for run in runs(stroke.bridged, stroke.closed):
            paper.draw_line(bridges, panel.place(stroke.points[run]), 255, thickness)
    paper.blend(canvas, casing, WHITE, 0, 0)
    paper.blend(canvas, np.where(bridges > 0, 0, outline).astype(np.uint8), LINE_COLOUR, 0, 0)
    paper.blend(canvas, np.where(bridges > 0, outline, 0).astype(np.uint8), BRIDGE_COLOUR, 0, 0)
    return region


def _draw_bands(canvas: NDArray[np.uint8], content: SheetInput, panel: Panel) -> set[str]:
    """Draw margin and 95 % band if they reach beyond the outline; says which were drawn."""
    drawn: set[str] = set()
    if content.metres_per_px is None:
        return drawn
    first = 0
    for stroke in content.strokes:
        count = len(stroke.points)
        points = panel.place(stroke.points)
        outline = panel.outline_distance(stroke) + 3
        to_page = panel.zoom / content.metres_per_px
        if content.margin_m and content.margin_m * to_page > outline:
            distance = np.full(count, content.margin_m * to_page)
            draw_distance(canvas, points, distance, stroke.closed, MARGIN_COLOUR, dashed=False)
            drawn.add("margin")
        if content.tre95_m is not None:
            distance = content.tre95_m[first : first + count] * to_page
            if distance.max() > outline:
                draw_distance(canvas, points, distance, stroke.closed, BAND_COLOUR, dashed=True)
                drawn.add("bound")
        first += count
    return drawn


def _residual_enlargement(content: SheetInput, panel: Panel) -> float | None:
    """How much longer than true the residuals are drawn; `None` if there are none."""
    longest = None
    for marker in content.markers:
        if marker.residual_px is not None:
            length = float(np.hypot(*marker.residual_px)) * panel.zoom
            longest = max(length, longest or 0.0)
    if longest is None:
        return None
    return 1.0 if not 0 < longest < ARROW_LENGTH else nice_length(ARROW_LENGTH / longest)


def _draw_markers(
    canvas: NDArray[np.uint8], content: SheetInput, panel: Panel, enlargement: float | None
) -> None:
    """Draw each marker where it was given, and its residual as an arrow."""
    for marker in content.markers:
        centre = panel.place(marker.place)
        # A ring and four ticks leave the place itself free; slanted ticks mean that it is unused.
        turns, inner = (0, 90, 180, 270), 13
        if not marker.used:
            turns, inner = (45, 135, 225, 315), 4
        for colour, thickness in ((WHITE, 5), (BLACK, 2)):
            paper.draw_disc(canvas, centre, 13, colour, thickness)
            for turn in turns:
                direction = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
                tick = np.array([centre + inner * direction, centre + 21 * direction])
                paper.draw_line(canvas, tick, colour, thickness)
        if marker.residual_px is None:
            continue
        residual = np.asarray(marker.residual_px) * panel.zoom * enlargement
        length = float(np.hypot(*residual))
        if length < 1:
            continue
        along = residual / length
        across = np.array([-along[1], along[0]])
        tip, head = centre + residual, min(14.0, length)
        shaft = np.array([centre, tip - 0.7 * head * along])
        base = tip - head * along
        corners = np.array([tip, base + 0.4 * head * across, base - 0.4 * head * across])
        paper.draw_line(canvas, shaft, WHITE, 7)
        paper.draw_line(canvas, corners, WHITE, 4, True)
        paper.draw_line(canvas, shaft, BLACK, 3)
        cv2.fillConvexPoly(canvas, paper.fixed_point(corners), BLACK, cv2.LINE_AA, paper.SHIFT)


def _kept_visible(
    content: SheetInput, panel: Panel, region: NDArray[np.uint8], enlargement: float | None
) -> NDArray[np.bool_]:
    """(H, W) what no caption may cover.

    That is the ink, the ends and what lies ahead of them, the markers and the residuals.
    """
    keep = cv2.dilate(region, np.ones((9, 9), np.uint8))
    for stroke in content.strokes:
        for end in ends_of(stroke):
            place = panel.place(end.place)
            paper.draw_disc(keep, place, FREE_RADIUS + 8, 255)
            if end.direction is not None:
                paper.draw_disc(keep, place + AHEAD_RADIUS * end.direction, AHEAD_RADIUS, 255)
    for marker in content.markers:
        place = panel.place(marker.place)
        paper.draw_disc(keep, place, 24, 255)
        if marker.residual_px is not None:
            tip = place + np.asarray(marker.residual_px) * panel.zoom * enlargement
            paper.draw_line(keep, np.array([place, tip]), 255, 20)
    return keep > 0


def _draw_captions(
    sheet: Paper,
    canvas: NDArray[np.uint8],
    box: Box,
    content: SheetInput,
    panel: Panel,
    labeller: Labeller,
) -> None:
    """Ends and bridges first, then findings, markers and other ink, as long as places are free."""

    def tag(place: Any, words: str, *, ground: paper.Colour = WHITE) -> None:
        draw_tag(sheet, canvas, box, labeller, panel.place(place), words, ground)

    for number, stroke in enumerate(content.strokes, 1):
        of_line, of_bridge = f" {number}", f" of {number}"
        if len(content.strokes) == 1:
            of_line, of_bridge = "", ""
        for end in ends_of(stroke):
            tag(end.place, end.name + of_line, ground=LINE_COLOUR)
        for k, run in enumerate(runs(stroke.bridged, stroke.closed), 1):
            tag(stroke.points[run[len(run) // 2]], f"bridge {k}{of_bridge}")
    for number, finding in enumerate(content.findings, 1):
        if finding.place_px is not None:
            tag(finding.place_px, f"F{number}", ground=BLACK)
    for marker in content.markers:
        words = f"{marker.label} {marker.residual_m * 1e3:.2f} mm"
        if not marker.used:
            words = f"{marker.label} left out"
        tag(marker.place, words)
    for entry in content.account or ():
        tag((entry.u, entry.v), str(entry.number))


def _draw_scale_bar(sheet: Paper, content: SheetInput, panel: Panel) -> float:
    """Draw a bar below the picture; returns where the next thing below begins."""
    if content.metres_per_px is None:
        length = nice_length(0.2 * panel.width / panel.zoom)
        words, length_px = f"{length:g} px", length * panel.zoom
    else:
        mm_per_page_px = content.metres_per_px * 1e3 / panel.zoom
        length = nice_length(0.2 * panel.width * mm_per_page_px)
        words, length_px = f"{length:g} mm", length / mm_per_page_px
    y = panel.y + panel.height + 8
    middle = y + BODY.line_height / 2
    bar = np.array([[panel.x + 2, middle], [panel.x + 2 + length_px, middle]])
    paper.draw_line(sheet.canvas, bar, BLACK, 4)
    sheet.text(panel.x + length_px + 16, y, words, BODY)
    return float(y + BODY.line_height)


def _draw_legend(
    sheet: Paper,
    content: SheetInput,
    enlargement: float | None,
    drawn_bands: set[str],
    x: float,
    y: float,
    width: float,
) -> float:
    """What the lines on the picture mean."""
    line = f"the line of the pen ({content.pen})" if content.pen else "the curve"
    rows: list[tuple[str, paper.Colour, bool]] = [
        (f"Blue outline: beside {line} that was taken", LINE_COLOUR, False)
    ]
    if any(stroke.bridged.any() for stroke in content.strokes):
        rows.append(("Orange outline: carried over a gap", BRIDGE_COLOUR, False))
    if "margin" in drawn_bands:
        rows.append(("Green line: margin, true scale", MARGIN_COLOUR, False))
    elif content.margin_m:
        rows.append(("Green: margin, see the last enlargement", MARGIN_COLOUR, False))
    if "bound" in drawn_bands:
        rows.append(("Purple dashes: 95 % band of the registration, true scale", BAND_COLOUR, True))
    elif content.tre95_m is not None:
        rows.append(("Purple dashes: 95 % band, see the last enlargement", BAND_COLOUR, True))
    if enlargement is not None:
        length = f"drawn {enlargement:g} times as long" if enlargement != 1 else "true length"
        rows.append((f"Circle: marker as given; arrow: residual, {length}", BLACK, False))
    sheet.text(x, y, "On the picture", HEADING)
    y += HEADING.line_height + 4
    for words, colour, is_dashed in rows:
        middle = y + BODY.line_height / 2
        dashes = ((0, 12), (17, 29), (34, 44)) if is_dashed else ((0, 44),)
        for start, end in dashes:
            line = np.array([[x + start, middle], [x + end, middle]])
            paper.draw_line(sheet.canvas, line, colour, 4)
        y = sheet.paragraph(x + 56, y, words, width - 56, BODY) + 6
    if content.account:
        y = sheet.paragraph(x, y, "Plain numbers: other ink, listed below.", width)
    return y + 10
