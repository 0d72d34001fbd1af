"""A bundle without a slice, from three sides at one scale."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.review import paper
from vfplan.review.labels import Labeller
from vfplan.review.paper import (
    BLACK,
    BODY,
    CONTENT_WIDTH,
    GREY,
    LINE_COLOUR,
    MARGIN,
    SMALL,
    STRONG,
    TAG,
    WHITE,
    Box,
    Paper,
)
from vfplan.review.sheet_input import SheetInput

Array = NDArray[np.float64]

# A view is a square of this many pixels of the page: two stand side by side.
VIEW_PX = 740
ROOM_PX = 60  # between the geometry and the frame of its view

# More points or triangles than these are thinned: a view has no pixels to show them all.
MAX_POINTS = 60_000
MAX_TRIANGLES = 40_000

# The edges of more triangles than these would fill the view.
MAX_OUTLINED = 2_000


def draw_views(sheet: Paper, shown: SheetInput, top: float) -> tuple[float, float, float]:
    """Draw the three views.

    Returns the left and the upper edge of the quarter that they leave free, and where the next
    thing below begins.
    """
    names = "xyz"
    points = shown.points_m
    everything = [points, *(marker.place[None] for marker in shown.markers)]
    low = np.min([part.min(axis=0) for part in everything], axis=0)
    high = np.max([part.max(axis=0) for part in everything], axis=0)
    middle = (low + high) / 2
    scale = (VIEW_PX - 2 * ROOM_PX) / max(float((high - low).max()), 1e-9)
    # Name, axis to the right, axis upwards, axis of the viewer, and on which side of it he is.
    sides = (
        ("Seen from above (+z)", 0, 1, 2, 1.0),
        ("Seen from the side (-y)", 0, 2, 1, -1.0),
        ("Seen from the side (+x)", 1, 2, 0, 1.0),
    )
    for number, (words, across, upward, toward, sign) in enumerate(sides):
        column, row = number % 2, number // 2
        left = MARGIN + column * (CONTENT_WIDTH - VIEW_PX)
        view_top = round(top) + row * (VIEW_PX + 60)
        sheet.text(left, view_top, words, STRONG)
        axes = f"{names[across]} to the right, {names[upward]} upwards"
        sheet.text(left + 330, view_top, axes, BODY, GREY)
        view = _View(across, upward, toward, sign, middle, scale)
        box = sheet.picture(left, view_top + 34, _geometry(view, shown))
        sheet.frame(box)
        _draw_marks(sheet, box, view, shown)
        _draw_scale(sheet, box, scale, shown.frame)
    free_left, free_top = MARGIN + CONTENT_WIDTH - VIEW_PX, float(top + VIEW_PX + 60)
    return free_left, free_top, float(top + 2 * (VIEW_PX + 60))


class _View:
    """A direction of view: which axes go right, up and to the viewer, and the scale."""

    def __init__(
        self, across: int, upward: int, toward: int, sign: float, middle: Array, scale: float
    ) -> None:
        self.axes = [across, upward]
        self.toward, self.sign = toward, sign
        self.middle, self.scale = middle, scale

    def onto(self, points: Array) -> Array:
        """(M, 2) places in the view [px of the page] of points (M, 3) [m]."""
        flat = (points - self.middle)[:, self.axes] * self.scale * (1, -1)
        return flat + VIEW_PX / 2 - 0.5

    def depth(self, points: Array) -> Array:
        """(M,) how far points lie towards the viewer."""
        return points[:, self.toward] * self.sign


def _geometry(view: _View, shown: SheetInput) -> NDArray[np.uint8]:
    canvas = np.full((VIEW_PX, VIEW_PX, 3), 255, np.uint8)
    points = shown.points_m
    if shown.triangles is not None and len(shown.triangles) <= MAX_TRIANGLES:
        _draw_triangles(canvas, view, points, shown.triangles)
        return canvas
    chosen = points[:: max(1, len(points) // MAX_POINTS)]
    depth = view.depth(chosen)
    order = np.argsort(depth)
    share = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-12)
    radius = float(np.clip(400 / np.sqrt(len(chosen)), 1.5, 4))
    for at, near in zip(view.onto(chosen[order]), share[order], strict=True):
        paper.draw_disc(canvas, at, radius, _shaded(near))
    return canvas


def _shaded(share: float) -> tuple[int, int, int]:
    """Pale for 0, what lies behind, to the full colour for 1, what lies in front."""
    strength = 0.35 + 0.65 * float(share)
    red, green, blue = (round(255 + strength * (c - 255)) for c in LINE_COLOUR)
    return red, green, blue


def _draw_triangles(
    canvas: NDArray[np.uint8], view: _View, points: Array, triangles: NDArray[np.int32]
) -> None:
    """Draw from the back to the front, darker the more a triangle is turned away."""
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    facing = np.abs(normals[:, view.toward]) / np.maximum(lengths, 1e-30)
    order = np.argsort(view.depth(corners.mean(axis=1)))
    flat = view.onto(points)
    for k in order:
        light = 0.35 + 0.6 * float(facing[k])
        colour = tuple(round(light * (255 + c) / 2) for c in LINE_COLOUR)
        outline = paper.fixed_point(flat[triangles[k]])
        cv2.fillConvexPoly(canvas, outline, colour, cv2.LINE_AA, paper.SHIFT)
        if len(triangles) <= MAX_OUTLINED:
            cv2.polylines(canvas, [outline], True, LINE_COLOUR, 1, cv2.LINE_AA, paper.SHIFT)


def _draw_marks(sheet: Paper, box: Box, view: _View, shown: SheetInput) -> None:
    """The markers and the findings that have a place, with captions."""
    left, top = round(box.left), round(box.top)
    part = sheet.canvas[top : top + VIEW_PX, left : left + VIEW_PX]
    places = [(marker.label, marker.place) for marker in shown.markers]
    for number, finding in enumerate(shown.findings, 1):
        if finding.place_m is not None:
            places.append((f"F{number}", np.array(finding.place_m)))
    keep = np.zeros((VIEW_PX, VIEW_PX), np.uint8)
    keep[VIEW_PX - 70 :, : VIEW_PX // 2] = 1  # the scale stands here
    drawn = [view.onto(place[None])[0] for _, place in places]
    for at in drawn:
        paper.draw_disc(part, at, 11, WHITE, 5)
        paper.draw_disc(part, at, 11, BLACK, 2)
        paper.draw_disc(keep, at, 14, 1)
    labeller = Labeller(keep > 0)
    for (words, _), at in zip(places, drawn, strict=True):
        draw_tag(sheet, part, box, labeller, at, words)


def draw_tag(
    sheet: Paper,
    part: NDArray[np.uint8],
    box: Box,
    labeller: Labeller,
    at: Array,
    words: str,
    *,
    is_dark: bool = False,
) -> None:
    """Write a caption in a small plate beside its point, where there is room for one."""
    shown = paper.shortened(words, 220, TAG)
    width, height = round(TAG.width_of(shown)) + 12, TAG.line_height + 2
    place = labeller.place(at, width, height)
    if place is None:
        return
    paper.draw_cased(part, place.leader, BLACK, 1)
    ground, letters = (BLACK, WHITE) if is_dark else (WHITE, BLACK)
    plate = part[place.top : place.top + height, place.left : place.left + width]
    plate[:] = BLACK
    plate[2:-2, 2:-2] = ground
    sheet.text(box.left + place.left + 6, box.top + place.top + 1, shown, TAG, letters)


def _draw_scale(sheet: Paper, box: Box, scale: float, frame: str) -> None:
    unit, per_metre = ("px", 1.0) if frame == "image" else ("mm", 1e3)
    length = nice_length(160 / scale * per_metre)
    across = length / per_metre * scale
    left, low = box.left + 16, box.bottom - 18
    paper.draw_line(sheet.canvas, np.array([[left, low], [left + across, low]]), BLACK, 4)
    sheet.text(left, low - 8 - SMALL.line_height, f"{length:g} {unit}", SMALL)


def nice_length(longest: float) -> float:
    """1, 2 or 5 times a power of ten, at most `longest`: the length of a scale bar."""
    power = 10.0 ** np.floor(np.log10(longest))
    return float(max(power * n for n in (1, 2, 5) if power * n <= longest))
