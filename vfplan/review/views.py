"""A bundle without a slice, from three sides at one scale."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.display import nice_length
from vfplan.review import paper
from vfplan.review.captions import Labeller
from vfplan.review.paper import (
    BLACK,
    BODY,
    CONTENT_WIDTH,
    GREY,
    LINE_COLOUR,
    MARGIN,
    STRONG,
    WHITE,
    Box,
    Paper,
)
from vfplan.review.sheet_input import SheetInput

Array = NDArray[np.float64]

VIEW_PX = CONTENT_WIDTH // 2 - BODY.line_height
"""Side [px of the page] of a view: two stand side by side."""

MAX_DRAWN = 50_000
"""Points or triangles of a view: it has no pixels for more."""

MAX_OUTLINED = 2_000
"""Triangles whose edges are drawn; the edges of more would fill the view."""


@dataclass(frozen=True)
class Side:
    """A direction of view.

    `across` and `upward` are the axes that point to the right and upwards, `toward` is the axis
    that points to the viewer, and `sign` tells on which side of it the viewer stands.
    """

    words: str
    across: int
    upward: int
    toward: int
    sign: float


SIDES = (
    Side("Seen from above (+z)", 0, 1, 2, 1.0),
    Side("Seen from the side (-y)", 0, 2, 1, -1.0),
    Side("Seen from the side (+x)", 1, 2, 0, 1.0),
)


@dataclass(frozen=True, eq=False)
class View:
    """A side, the place (3,) [m] in its middle, and the pixels of the page a metre."""

    side: Side
    middle: Array
    scale: float

    def project(self, points: Array) -> Array:
        """(M, 2) places in the view [px of the page] of points (M, 3) [m]."""
        axes = [self.side.across, self.side.upward]
        flat = (points - self.middle)[:, axes] * self.scale * (1, -1)
        return flat + VIEW_PX / 2 - 0.5

    def depth(self, points: Array) -> Array:
        """(M,) how far points lie towards the viewer."""
        return points[:, self.side.toward] * self.side.sign


def draw_views(sheet: Paper, content: SheetInput, y: float) -> tuple[float, float, float]:
    """Draw the three views.

    Returns the corner of the quarter that they leave free, and where the next thing below begins.
    """
    everything = [content.points_m, *(marker.place[None] for marker in content.markers)]
    low = np.vstack(everything).min(axis=0)
    high = np.vstack(everything).max(axis=0)
    scale = (VIEW_PX - 2 * MARGIN) / max(float((high - low).max()), 1e-9)
    for number, side in enumerate(SIDES):
        row, column = divmod(number, 2)
        x = MARGIN + CONTENT_WIDTH - VIEW_PX if column == 1 else MARGIN
        view_y = round(y) + row * (VIEW_PX + 60)
        sheet.text(x, view_y, side.words, STRONG)
        axes = f"{'xyz'[side.across]} to the right, {'xyz'[side.upward]} upwards"
        sheet.text(x + 330, view_y, axes, BODY, GREY)
        view = View(side, (low + high) / 2, scale)
        box = sheet.picture(x, view_y + 34, _geometry(view, content))
        sheet.frame(box)
        _draw_marks(sheet, box, view, content)
        # The length of a bar, below on the left.
        unit, per_metre = "mm", 1e3
        if content.frame == "image":
            unit, per_metre = "px", 1.0
        length = nice_length(160 / scale * per_metre)
        start = np.array([box.x + 16, box.bottom - 18])
        end = start + np.array([length / per_metre * scale, 0])
        paper.draw_line(sheet.canvas, np.array([start, end]), BLACK, 4)
        sheet.text(start[0], start[1] - 8 - BODY.line_height, f"{length:g} {unit}", BODY)
    free_x, free_y = MARGIN + CONTENT_WIDTH - VIEW_PX, float(y + VIEW_PX + 60)
    return free_x, free_y, float(y + 2 * (VIEW_PX + 60))


def _geometry(view: View, content: SheetInput) -> NDArray[np.uint8]:
    """The points or the triangles, those in front over those behind."""
    canvas = np.full((VIEW_PX, VIEW_PX, 3), 255, np.uint8)
    points = content.points_m
    if content.triangles is not None and len(content.triangles) <= MAX_DRAWN:
        # From the back to the front, darker the more a triangle is turned away.
        corners = points[content.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        facing = np.abs(normals[:, view.side.toward]) / np.maximum(lengths, 1e-30)
        light = 0.35 + 0.6 * facing[:, None]
        colours = np.rint(light * (255 + np.array(LINE_COLOUR)) / 2).astype(int).tolist()
        flat = view.project(points)
        for k in np.argsort(view.depth(corners.mean(axis=1))):
            outline = paper.fixed_point(flat[content.triangles[k]])
            cv2.fillConvexPoly(canvas, outline, colours[k], cv2.LINE_AA, paper.SHIFT)
            if len(content.triangles) <= MAX_OUTLINED:
                cv2.polylines(canvas, [outline], True, LINE_COLOUR, 1, cv2.LINE_AA, paper.SHIFT)
        return canvas
    drawn = points[:: max(1, len(points) // MAX_DRAWN)]
    depth = view.depth(drawn)
    order = np.argsort(depth)
    share = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-12)
    radius = float(np.clip(400 / np.sqrt(len(drawn)), 1.5, 4))
    # What lies behind is pale, and what lies in front has the full colour.
    strength = 0.35 + 0.65 * share[order, None]
    colours = np.rint(255 + strength * (np.array(LINE_COLOUR) - 255)).astype(int)
    for place, colour in zip(view.project(drawn[order]), colours.tolist(), strict=True):
        paper.draw_disc(canvas, place, radius, colour)
    return canvas


def _draw_marks(sheet: Paper, box: Box, view: View, content: SheetInput) -> None:
    """Draw the markers and the findings that have a place, with captions."""
    x, y = round(box.x), round(box.y)
    part = sheet.canvas[y : y + VIEW_PX, x : x + VIEW_PX]
    captions = []
    places = []
    for marker in content.markers:
        captions.append(marker.label)
        places.append(marker.place)
    for number, finding in enumerate(content.findings, 1):
        if finding.place_m is not None:
            captions.append(f"F{number}")
            places.append(np.array(finding.place_m))
    if not places:
        return
    keep = np.zeros((VIEW_PX, VIEW_PX), np.uint8)
    keep[VIEW_PX - 70 :, : VIEW_PX // 2] = 1  # The scale stands here.
    drawn = view.project(np.array(places))
    for place in drawn:
        paper.draw_disc(part, place, 11, WHITE, 5)
        paper.draw_disc(part, place, 11, BLACK, 2)
        paper.draw_disc(keep, place, 14, 1)
    labeller = Labeller(keep > 0)
    for words, place in zip(captions, drawn, strict=True):
        draw_tag(sheet, part, box, labeller, place, words)


def draw_tag(
    sheet: Paper,
    part: NDArray[np.uint8],
    box: Box,
    labeller: Labeller,
    point: Array,
    words: str,
    ground: paper.Colour = WHITE,
) -> None:
    """Write a caption in a small plate close to its point, if there is a place for one.

    `ground` is the plate's colour. The letters are black on white, and white on any other.
    """
    words = paper.shortened(words, 220, STRONG)
    width, height = round(STRONG.width_of(words)) + 12, STRONG.line_height + 2
    place = labeller.place(point, width, height)
    if place is None:
        return
    paper.draw_cased(part, place.leader, BLACK, 1)
    letters = BLACK if ground == WHITE else WHITE
    plate = part[place.y : place.y + height, place.x : place.x + width]
    plate[:] = BLACK
    plate[2:-2, 2:-2] = ground
    sheet.text(box.x + place.x + 6, box.y + place.y + 1, words, STRONG, letters)
