"""The picture of the slice on a sheet: an outline beside the ink, bands, markers and captions.

A bundle without a slice, from three sides at one scale.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np

from vfplan.display import (
    MAX_NUMBERED,
    MM,
    coordinates,
    finding_name,
    isolated,
    millimetres,
    nice_length,
)
from vfplan.findings import Finding
from vfplan.fixture import Fixture, Stroke
from vfplan.geometry.lines import Array, distance_to, nearest_to, normals, row_lengths, runs
from vfplan.review import paper
from vfplan.review.geometry import ASKS_ABOUT_INK, away_from
from vfplan.review.paper import BLACK, BODY, GREY, INSET_PX, LINE_COLOUR, MARGIN, STRONG, Pixels
from vfplan.review.plan import Plan
from vfplan.review.rendered import Outline, onto_plane, outlines_of
from vfplan.review.strokes import CLOSE_PX


def ends_of(stroke: Stroke) -> Iterator[tuple[str, Array, Array]]:
    """Both ends of an open line.

    Each with its name, "start" or "end", its place (u, v) [px of the slice], and the unit vector in
    which the line would go on.
    """
    ways = stroke.points[::-1], stroke.points
    for name, end, line in zip(("start", "end"), stroke.end_points, ways, strict=False):
        step = end - line[max(0, len(line) - 9)]
        yield name, end, step / max(float(np.hypot(*step)), 1e-9)


# Side [px of the page] of a view: two stand side by side.
VIEW_PX = paper.CONTENT_WIDTH // 2 - BODY.line_height

# From the top of a view to that of the next: its heading stands above it, its scale below.
VIEW_STEP = VIEW_PX + 3 * BODY.line_height

# Points of a view at most: it has no pixels for more.
MAX_DRAWN = 50_000


# Across what axis each view is, its words, and its directions: right, down, to the viewer.
SIDES = (
    ("z", "Seen from above (+z): x to the right, y up", [[1, 0, 0], [0, -1, 0], [0, 0, 1]]),
    ("y", "Seen from the side (-y): x to the right, z up", [[1, 0, 0], [0, 0, -1], [0, -1, 0]]),
    ("x", "Seen from the side (+x): y to the right, z up", [[0, 1, 0], [0, 0, -1], [1, 0, 0]]),
)


def draw_views(sheet: paper.Paper, plan: Plan, y: float) -> tuple[float, float, float]:
    """Draw the three views.

    Returns the corner of the quarter that they leave free, and where the next thing below begins.
    """
    low, high = plan.fixture.points.min(axis=0), plan.fixture.points.max(axis=0)
    wall_m = plan.fixture.contact_radius + plan.fixture.point_radius if plan.kind == "wall" else 0.0
    scale = (VIEW_PX - 2 * MARGIN) / max(float((high - low).max()) + 2 * wall_m, 1e-9)
    # Each view cuts what is rendered in its middle.
    middle = (low + high) / 2
    outlines = []
    axis = plan.fixture.ignore_axis if plan.kind == "guide" else None
    for number, (letter, words, turn) in enumerate(SIDES):
        row, column = divmod(number, 2)
        x = MARGIN + column * (paper.CONTENT_WIDTH - VIEW_PX)
        view_y = round(y) + row * VIEW_STEP
        right, down, towards = np.array(turn)
        corner = middle - (right + down) / scale * (VIEW_PX / 2 - 0.5)
        plane = np.column_stack([right / scale, down / scale, corner])
        # A tube that is infinite along an axis has no outline where it is seen from the side.
        is_endless = axis is not None and abs(axis @ towards) < 0.5
        sheet.text(x, view_y, words, STRONG)
        canvas = draw_points(plane, towards, plan.fixture)
        if not is_endless:
            for outline in outlines_of(plan.fixture, plane, (VIEW_PX, VIEW_PX)):
                draw_rendered(canvas, outline, lambda points: points)
                outlines.append(outline)
        box = sheet.picture(x, view_y + 34, canvas)
        unit, per_metre = ("px", 1.0) if plan.fixture.frame == "image" else ("mm", MM)
        draw_scale_bar(sheet, x, box.bottom + 6, 160, scale / per_metre, unit)
        if outlines and not is_endless:
            cut = f"the outline is cut at {letter} = {MM * abs(towards) @ middle:.1f} mm"
            sheet.text(box.right - BODY.width_of(cut), box.bottom + 6, cut)
    free_x, free_y = MARGIN + paper.CONTENT_WIDTH - VIEW_PX, y + VIEW_STEP
    rows = rendered_legend(outlines)
    if rows:
        free_y = draw_legend_rows(sheet, "In each view", rows, free_x, free_y, VIEW_PX)
        if axis is not None:
            words = "The tube has no end along its axis, so it is not drawn from the side."
            free_y = sheet.paragraph(free_x, free_y, words, VIEW_PX, BODY, GREY) + 10
    return free_x, free_y, y + 2 * VIEW_STEP


def draw_scale_bar(
    sheet: paper.Paper, x: float, y: float, longest_px: float, unit_px: float, unit: str
) -> None:
    """Draw a bar of a round length with its words beside it; a unit takes so many pixels."""
    length = nice_length(longest_px / unit_px)
    end, middle, words = x + length * unit_px, round(y + BODY.line_height / 2), f"{length:g} {unit}"
    sheet.canvas[middle - 2 : middle + 2, round(x) : round(end)] = BLACK
    sheet.text(end + 14, y, words)


def draw_points(plane: Array, towards: Array, fixture: Fixture) -> Pixels:
    """The points, or the triangles, those in front over those behind.

    `plane` takes (u, v, 1) [px] of the view to the fixture's frame [m], and `towards` is the
    direction to the viewer.
    """
    canvas = np.full((VIEW_PX, VIEW_PX, 3), 255, np.uint8)
    flat, mesh = onto_plane(plane)(fixture.points), fixture.mesh
    if mesh is not None and len(mesh) <= MAX_DRAWN:
        # Darker the more a triangle is turned away from the viewer.
        corners = fixture.points[mesh]
        across = np.cross(*np.diff(corners, axis=1).swapaxes(0, 1))
        facing = np.abs(across @ towards) / np.maximum(row_lengths(across), 1e-30)
        colours = (0.35 + 0.6 * facing[:, None]) * (255 + np.array(LINE_COLOUR)) / 2
        for k in np.argsort(corners.mean(axis=1) @ towards):
            outline = paper.fixed_point(flat[mesh[k]])
            cv2.fillConvexPoly(canvas, outline, colours[k].tolist(), cv2.LINE_AA, paper.SHIFT)
        return canvas
    drawn = flat[:: max(1, len(flat) // MAX_DRAWN)]
    radius = float(np.clip(400 / np.sqrt(len(drawn)), 1.5, 4))
    for place in drawn:
        paper.draw_disc(canvas, place, radius, LINE_COLOUR)
    return canvas


# Width [px of the page] of the column of facts beside the slice, and where it begins.
COLUMN_WIDTH = round(1.3 * INSET_PX)
COLUMN_X = paper.PAGE_WIDTH - MARGIN - COLUMN_WIDTH

# Width [px of the page] of the slice at most.
PICTURE_WIDTH = paper.CONTENT_WIDTH - COLUMN_WIDTH - BODY.line_height

# Times that a slice's one side is as long as the other, from which it is long. A wide one takes the
# whole page, and what stands beside others stands below it.
LONG = 2

# Height [px of the page] of the slice at most: a row of insets fits below.
PICTURE_HEIGHT = 980

# The same on a sheet with findings: their words fit below that row.
PICTURE_HEIGHT_WITH_FINDINGS = 800

# Paper [px of the page] for captions on the long sides of a tall slice, and of a wide one.
CAPTION_PAPER = np.array([240, 4 * BODY.line_height])

# Radius [px of the page] around an end that no blue outline, arrow or caption enters.
FREE_RADIUS = 20

# Radius [px of the page] of the disc ahead of an end that no caption enters: a cover of the end
# lies there, and it has to be visible.
AHEAD_RADIUS = 5 * FREE_RADIUS

# Distance [px of the page] from the outline beside the ink to what the robot renders, at least:
# nearer, two lines and their casings look like one.
OUTLINES_APART = 5.0

# Radius [px of the page] of the circle of a marker.
MARK_RADIUS = 13

# Distance [px of the page] from a marker to the outer end of its ticks.
MARK_REACH = 21

# How much farther apart than mostly the channels of a pixel are, of 256, that counts as coloured:
# ink, and what else was drawn on the slice.
COLOURED = 60

# Widths [px of the page] of a marker's name that are tried one after the other.
NAME_WIDTHS = range(500, 90, -60)


@dataclass(frozen=True, eq=False)
class Panel:
    """The picture of the slice: where it stands, its pixels on the page, and its scale.

    Those pixels are the slice's, and of a long one the paper around it. `corner` is where the slice
    begins in them, `zoom` how many pixels of the page one of the slice takes, and
    `rendered_distance` from a line to where the robot begins to push [px of the page]; infinite
    where it does not.
    """

    canvas: Pixels
    corner: Array
    zoom: float
    rendered_distance: float

    def place(self, points_px: Any) -> Array:
        """Pixels of the slice to pixels of this picture; (0, 0) is the middle of the first."""
        return (np.asarray(points_px, dtype=float) + 0.5) * self.zoom - 0.5 + self.corner

    def half_width(self, stroke: Stroke) -> float:
        """Half the width of a line's ink [px of the page]."""
        # As wide as pens mostly are, if nobody knows.
        return (4.0 if stroke.width is None else stroke.width) / 2 * self.zoom

    def outline_distance(self, stroke: Stroke) -> float:
        """From the middle of a line to the outline beside its ink [px of the page]."""
        # The outline leaves 7 px of the page free beside the ink; 3 px within a narrow wall.
        ink, wall = self.half_width(stroke), self.rendered_distance
        if abs(wall - ink - 7) >= OUTLINES_APART:
            return ink + 7
        return wall - OUTLINES_APART if wall - ink >= OUTLINES_APART + 3 else wall + OUTLINES_APART


def draw_picture(
    sheet: paper.Paper, plan: Plan, rgb: Pixels, y: float
) -> tuple[float, float, list[str]]:
    """Draw the slice with all that is marked on it, and the legend in the column beside it.

    Below a wide slice the legend stands on the left. Returns where the next thing below begins, in
    the left part and in the column, and the markers for whose captions there is no room.
    """
    height, width = rgb.shape[:2]
    is_tall, is_wide = height > LONG * width, width > LONG * height
    corner = CAPTION_PAPER * (is_tall, is_wide)
    highest = PICTURE_HEIGHT_WITH_FINDINGS if plan.findings else PICTURE_HEIGHT
    zoom = min((paper.CONTENT_WIDTH if is_wide else PICTURE_WIDTH) / width, highest / height)
    size = max(1, round(width * zoom)), max(1, round(height * zoom))
    # Made smaller, up to twice as large, and larger.
    method = (cv2.INTER_AREA, cv2.INTER_LINEAR, cv2.INTER_NEAREST)[min(int(zoom), 2)]
    y = round(y)
    drawn = cv2.resize(rgb, size, interpolation=method)
    box = sheet.picture(*np.add(corner, (MARGIN, y)).tolist(), drawn)
    bottom = box.bottom + corner[1]
    canvas = sheet.canvas[y:bottom, MARGIN : box.right + corner[0]]
    lines = [line for outline in plan.outlines for line in outline.lines]
    rendered = np.vstack([[(np.inf, np.inf)], *lines])
    to_rendered = distance_to(plan.strokes[0].points[0], rendered) * zoom
    panel = Panel(canvas, corner, zoom, to_rendered)
    spread = np.ptp(canvas, axis=2)
    coloured = (spread > np.median(spread) + COLOURED).astype(np.uint8)

    # What was drawn is checked first, so its ink and its outline lie on top.
    before, ink = canvas.copy(), np.zeros(canvas.shape[:2], np.uint8)
    for outline in plan.outlines:
        draw_rendered(canvas, outline, panel.place)
    shunned = cv2.dilate((canvas != before).any(axis=2).astype(np.uint8), np.ones((5, 5)))
    for stroke in plan.strokes:
        draw_along(ink, panel, stroke, min(panel.half_width(stroke), to_rendered - 1.5))
    canvas[ink > 127] = before[ink > 127]
    pen = max([BLACK, *before[ink > 127].tolist()], key=lambda rgb: max(rgb) - min(rgb))
    region = draw_ink_outline(plan, panel)
    has_band = False
    for stroke, half_m in plan.bounds:
        # The 95 % band where it reaches beyond the outline.
        reach = half_m * panel.zoom / plan.metres_per_px
        if reach.max() > panel.outline_distance(stroke) + 3:
            paper.draw_bound(panel.canvas, panel.place(stroke.points), reach, stroke.closed)
            has_band = True
    # No caption covers what has a colour, what lies ahead of an end, markers and residuals; no
    # leader crosses the line or an end either.
    keep = cv2.dilate(coloured, np.ones((9, 9), np.uint8))
    if corner.any():
        # Nor does one cover the frame of a slice that has paper around it.
        cv2.rectangle(keep, corner.tolist(), (corner + size).tolist(), 1, 4)
    for stroke in plan.strokes:
        for _, end, direction in ends_of(stroke):
            place = panel.place(end)
            paper.draw_disc(region, place, 2 * FREE_RADIUS, 255)
            paper.draw_disc(keep, place + AHEAD_RADIUS * direction, AHEAD_RADIUS, 1)
    keep[cv2.dilate(region, np.ones((9, 9), np.uint8)) > 0] = 254
    enlargement = draw_markers(plan, panel, keep)
    draw_slicer_points(plan, panel, keep)
    unnamed, numbered = draw_captions(sheet, plan, panel, keep, shunned, y)

    unit_px, unit = zoom, "px"
    if plan.metres_per_px is not None:
        unit_px, unit = zoom / (MM * plan.metres_per_px), "mm"
    draw_scale_bar(sheet, box.x + 2, bottom + 8, 0.2 * box.width, unit_px, unit)
    bottom += 8.0 + BODY.line_height
    column = (MARGIN, bottom + 10, PICTURE_WIDTH) if is_wide else (COLUMN_X, y, COLUMN_WIDTH)
    end = draw_legend(sheet, plan, enlargement, has_band, numbered, pen, *column)
    return *((end, bottom) if is_wide else (bottom, end)), unnamed


def draw_along(mask: Pixels, panel: Panel, stroke: Stroke, distance: float) -> None:
    """Draw, in 255, what lies within a distance [px of the page] of a line."""
    points = panel.place(stroke.points)
    if stroke.is_ordered:
        paper.draw_line(mask, points, 255, max(1, round(2 * distance)), stroke.closed)
    else:
        for point in points:
            paper.draw_disc(mask, point, distance, 255)


def draw_ink_outline(plan: Plan, panel: Panel) -> Pixels:
    """Draw the outline beside each line; returns the region that it surrounds, 255 inside."""
    region, bridges, free = (np.zeros(panel.canvas.shape[:2], np.uint8) for _ in range(3))
    for stroke in plan.strokes:
        # A closed line has no end that something could cover.
        for end in stroke.end_points:
            paper.draw_disc(free, panel.place(end), FREE_RADIUS, 255)
        distance = panel.outline_distance(stroke)
        draw_along(region, panel, stroke, distance)
        for run in runs(stroke.bridged | stroke.edited, stroke.closed):
            thickness = max(1, round(2 * distance)) + 12
            paper.draw_line(bridges, panel.place(stroke.points[run]), 255, thickness)
    contours, before = paper.contours_of(region), panel.canvas.copy()
    cv2.drawContours(panel.canvas, contours, -1, paper.WHITE, 4, cv2.LINE_AA)
    bridged = panel.canvas.copy()
    cv2.drawContours(panel.canvas, contours, -1, LINE_COLOUR, 2, cv2.LINE_AA)
    cv2.drawContours(bridged, contours, -1, paper.BRIDGE_COLOUR, 2, cv2.LINE_AA)
    panel.canvas[bridges > 0] = bridged[bridges > 0]
    panel.canvas[free > 127] = before[free > 127]
    return region


# Where the sample of a line is drawn [px of the page].
SOLID = ((0, 44),)
DASHED = ((0, 12), (17, 29), (34, 44))


class LegendRow(NamedTuple):
    """What a mark means, its colour, and the dashes of its line; without any it is a ring."""

    words: str
    colour: paper.Colour
    dashes: tuple[tuple[int, int], ...] = SOLID


# What the legend says of what the robot renders, and its colour. The proxy stops at a wall, and
# stays in a guide's tube.
RENDERED = {
    "wall": LegendRow("Red line: the wall. It holds the tip back", paper.WALL_COLOUR),
    "guide": LegendRow("Green line: the tip is held within it", paper.GUIDE_COLOUR),
}

# Length of the arrow of a guide's pull, and its distance from the tube [px of the page].
PULL_LENGTH, PULL_GAP = 70.0, 21.0


def rendered_legend(outlines: Iterable[Outline]) -> list[LegendRow]:
    """What the legend says of these outlines, once for each kind."""
    drawn = [outline for outline in outlines if outline.lines]
    rows = [RENDERED[kind] for kind in sorted({outline.kind for outline in drawn})]
    if any(outline.pull is not None for outline in drawn):
        rows.append(LegendRow("Green arrow: the guide's pull", paper.GUIDE_COLOUR))
    return rows


def draw_rendered(canvas: Pixels, outline: Outline, place: Any) -> None:
    """Draw where the engine pushes; `place` takes pixels of the slice to the canvas."""
    colour = RENDERED[outline.kind].colour
    for line in outline.lines:
        paper.draw_cased(canvas, place(line), colour, 2)
    if outline.pull is not None and outline.lines:
        # Beside the tube, so that the ink stays free.
        start, along = outline.pull
        start, line = place(start), place(np.vstack(outline.lines))
        across = np.array([-along[1], along[0]])
        middle = start + (distance_to(start, line) + PULL_GAP) * across
        half, size = PULL_LENGTH / 2 * along, np.array(canvas.shape[1::-1])
        if ((middle >= 0) & (middle < size)).all():
            # All of the arrow lies on the canvas, with its head.
            middle = np.clip(middle, 0.6 * PULL_LENGTH, size - 0.6 * PULL_LENGTH)
        paper.draw_arrow(canvas, middle - half, middle + half, colour)


def draw_markers(plan: Plan, panel: Panel, keep: Pixels) -> float | None:
    """Draw each marker where it was given, and its residual as an arrow; `keep` gets both.

    Returns how much longer than true the residuals are drawn, as on the page; `None` for none.
    """
    known = [(*m.place, *m.residual_px) for m in plan.markers if m.is_used]
    places, moved = np.hsplit(np.reshape(known, (-1, 4)), 2)
    longest = np.hypot(*moved.T).max(initial=0.0)
    size = np.array([plan.image.width_px, plan.image.height_px])
    arrow_px = max(size[0], 300) / 10
    enlargement = 1.0 if known else None
    if 0 < longest < arrow_px:
        enlargement = min(nice_length(arrow_px / longest), 500.0)
        tips = places + enlargement * moved
        is_cut = not np.array_equal(tips, tips.clip(0, size - 1))
        if is_cut and arrow_px * panel.zoom > 4 * paper.ARROW_HEAD:
            # Half as long an arrow is still plain. What the border cuts then too has no head.
            enlargement = nice_length(enlargement / 2)
    for marker in plan.markers:
        centre = tip = panel.place(marker.place)
        paper.draw_disc(keep, centre, 24, 254)
        if marker.is_used:
            tip = centre + np.asarray(marker.residual_px) * panel.zoom * enlargement
            paper.draw_line(keep, np.array([centre, tip]), 254, 20)
        draw_mark(panel.canvas, centre, tip, is_used=marker.is_used)
    return enlargement


def draw_mark(canvas: Pixels, centre: Array, tip: Array, *, is_used: bool = True) -> None:
    """Draw a marker's circle, and its arrow unless that lies within the ticks."""
    # A ring and four ticks leave the place itself free; slanted ticks mean that it is unused.
    first, inner = (0, MARK_RADIUS) if is_used else (45, 4)
    for colour, thickness in ((paper.WHITE, 5), (BLACK, 2)):
        paper.draw_disc(canvas, centre, MARK_RADIUS, colour, thickness)
        for turn in np.radians(first + 90 * np.arange(4)):
            direction = np.array([np.cos(turn), np.sin(turn)])
            tick = centre + np.outer([inner, MARK_REACH], direction)
            paper.draw_line(canvas, tick, colour, thickness)
    if np.hypot(*(tip - centre)) > MARK_REACH:
        paper.draw_arrow(canvas, centre, tip, BLACK)


def bridges_of(plan: Plan) -> Iterator[tuple[str, Array]]:
    """Each bridge: its name, and its points [px of the slice]."""
    bridges = [
        stroke.points[run]
        for stroke in plan.strokes for run in runs(stroke.bridged, stroke.closed)
    ]  # fmt: skip
    for number, points in enumerate(bridges, 1):
        yield f"bridge {number}", points


def placed_findings(plan: Plan) -> list[tuple[str, Finding]]:
    """The findings that have a place on the slice, each with its name."""
    return [
        (finding_name(number), finding)
        for number, finding in enumerate(plan.findings, 1) if finding.place_px is not None
    ]  # fmt: skip


def draw_slicer_points(plan: Plan, panel: Panel, keep: Pixels) -> None:
    """Draw a tick beside the line at each point that was set in Slicer; `keep` gets them too."""
    for place in plan.slicer_points:
        stroke = min(plan.strokes, key=lambda line, at=place: distance_to(at, line.points))
        nearest = nearest_to(place, stroke.points)
        across, point = normals(stroke.points, stroke.closed)[nearest], panel.place(place)
        # An end is left free.
        gap = max(panel.outline_distance(stroke) + 3, FREE_RADIUS + 4)
        tick = point + across * np.array([[gap], [gap + 10.0]])
        paper.draw_cased(panel.canvas, tick, LINE_COLOUR, 3)
        paper.draw_line(keep, tick, 254, 8)


def ink_at(plan: Plan, finding: Finding) -> int:
    """The number of the other ink that a finding asks about; 0 for another finding."""
    if finding.code not in ASKS_ABOUT_INK:
        return 0
    away = [(away_from(one.piece, finding), one.number) for one in plan.other_ink if one.piece]
    away_px, number = min(away, default=(np.inf, 0))
    return number if away_px <= CLOSE_PX else 0


def draw_captions(
    sheet: paper.Paper, plan: Plan, panel: Panel, taken: Pixels, shunned: Pixels, top: int
) -> tuple[list[str], bool]:
    """Ends and bridges first, then findings, markers and other ink, as long as places are free.

    None covers what is `taken`, and few what is `shunned`. Returns the captions of markers that
    have no place, and whether other ink has its number; the lists name all else that has none.
    """

    def tag(place: Any, *choices: str, ground: paper.Colour = paper.WHITE) -> bool:
        """Write the first caption that has room close to its place in a small plate of a colour."""
        for words in choices:
            size = round(STRONG.width_of(words)) + 12, STRONG.line_height + 2
            found = paper.place_for_caption(taken, shunned, panel.place(place), *size)
            if found is not None:
                break
        else:
            return False
        (x, y, leader), (width, height) = found, size
        paper.draw_cased(panel.canvas, leader, BLACK, 2)
        plate = panel.canvas[y : y + height, x : x + width]
        letters = BLACK if ground == paper.WHITE else paper.WHITE
        plate[:] = letters
        plate[2:-2, 2:-2] = ground
        sheet.text(MARGIN + x + 6, top + y + 1, words, STRONG, letters)
        return True

    places = []
    for number, stroke in enumerate(plan.strokes, 1):
        of_line = "" if len(plan.strokes) == 1 else f" {number}"
        for name, end, _ in ends_of(stroke):
            places.append((name + of_line, end[None], LINE_COLOUR))
        if of_line and not len(stroke.end_points):
            places.append((f"line{of_line}", stroke.points[:1], LINE_COLOUR))
    places += [(name, points, paper.WHITE) for name, points in bridges_of(plan)]
    placed, named = placed_findings(plan), []
    for name, points, ground in places:
        about = [at for at, one in placed if distance_to(one.place_px, points) <= CLOSE_PX]
        named += about
        # Each plate with the number of a finding is black.
        words = " ".join([name, *about])
        tag(points[len(points) // 2], words, ground=BLACK if about else ground)
    numbers = set()
    for name, finding in placed:
        number = ink_at(plan, finding)
        words = f"{name} ({number})" if number else name
        if name not in named and tag(finding.place_px, words, ground=BLACK):
            numbers.add(number)
    unnamed = []
    for marker in plan.markers:
        residual = millimetres(marker.residual_m, 2) if marker.is_used else "left out"
        # The name is shortened, and the number is not.
        names = dict.fromkeys(paper.shortened(marker.label, w, STRONG) for w in NAME_WIDTHS)
        words = [f"{isolated(name)} {residual}" for name in names]
        if not tag(marker.place, *words):
            unnamed.append(f"{words[0]} at ({coordinates(marker.place)})")
    for entry in plan.other_ink[:MAX_NUMBERED]:
        if entry.number not in numbers and tag(entry.middle, str(entry.number)):
            numbers.add(entry.number)
    return unnamed, any(numbers)


def draw_legend(
    sheet: paper.Paper, plan: Plan, enlargement: float | None, has_band: bool, numbered: bool,
    pen: paper.Colour, x: float, y: float, width: float,
) -> float:  # fmt: skip
    """What the lines on the picture mean, those alone that are drawn there."""
    words = "Blue: beside the line that was taken; not to scale, ends free"
    rows = [LegendRow(words, LINE_COLOUR), *rendered_legend(plan.outlines)]
    if plan.strokes[0].sigma is not None:
        rows.insert(0, LegendRow("Ink: the line that was drawn", pen))
    if len(plan.slicer_points):
        rows.append(LegendRow("Blue ticks: points that were set in Slicer", LINE_COLOUR))
    if any((stroke.bridged | stroke.edited).any() for stroke in plan.strokes):
        rows.append(LegendRow("Orange: over a gap, or by hand", paper.BRIDGE_COLOUR))
    if has_band:
        words = "Purple dashes: 95 % band of markers and drawing, to scale"
        rows.append(LegendRow(words, paper.BAND_COLOUR, DASHED))
    if enlargement is not None:
        length = "true length" if enlargement == 1 else f"drawn {enlargement:g} times as long"
        words = "Marker as given, with its residual in space; arrow: its part in the slice, "
        rows.append(LegendRow(words + length, BLACK, ()))
    y = draw_legend_rows(sheet, "On the picture", rows, x, y, width)
    plates = ["#1: finding"] * bool(placed_findings(plan)) + ["1: other ink"] * numbered
    if plates:
        y = sheet.paragraph(x, y, f"{'; '.join(plates)} (listed below)", width)
    return y + 6


def draw_legend_rows(
    sheet: paper.Paper, heading: str, rows: list[LegendRow], x: float, y: float, width: float
) -> float:
    """A sample of each line beside what it means; returns where the next thing begins."""
    sheet.text(x, y, heading, paper.HEADING)
    y += paper.HEADING.line_height + 4
    for words, colour, dashes in rows:
        middle = y + BODY.line_height / 2
        if not dashes:
            centre = np.array([x + 22, middle + 6])
            draw_mark(sheet.canvas, centre, np.add(centre, (18, 38)))
        for start, end in dashes:
            line = np.array([[x + start, middle], [x + end, middle]])
            paper.draw_line(sheet.canvas, line, colour, 4)
        y = sheet.paragraph(x + 56, y, words, width - 56) + 6
    return y
