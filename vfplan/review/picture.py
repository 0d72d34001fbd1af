"""The picture of the slice on a sheet: an outline beside the ink, bands, markers and captions.

A bundle without a slice, from three sides at one scale.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.display import MAX_NUMBERED, MM, millimetres, nice_length
from vfplan.fixture import Stroke
from vfplan.geometry.lines import arc_lengths, runs, values_at
from vfplan.planning.settings import ExtractSettings
from vfplan.review import paper
from vfplan.review.paper import BLACK, BODY, GREY, INSET_PX, LINE_COLOUR, MARGIN, STRONG, WHITE
from vfplan.review.rendered import Outline, Shown, outlines_of


@dataclass(frozen=True, eq=False)
class LineEnd:
    """An end of a line, or the start of a closed one.

    `name` is "start" or "end", `place` is (u, v) [px of the slice], and `direction` the unit
    vector in which the line would go on; `None` for a closed line.
    """

    name: str
    place: paper.Array
    direction: paper.Array | None


def ends_of(stroke: Stroke) -> list[LineEnd]:
    """Both ends of a line, or the start of a closed one."""
    points = stroke.points
    if not stroke.is_ordered:
        return []
    if stroke.closed:
        return [LineEnd("start", points[0], None)]
    ends = []
    for name, line in (("start", points[::-1]), ("end", points)):
        step = line[-1] - line[max(0, len(line) - 9)]
        length = max(float(np.hypot(*step)), 1e-9)
        ends.append(LineEnd(name, line[-1], step / length))
    return ends


# Side [px of the page] of a view: two stand side by side.
VIEW_PX = paper.CONTENT_WIDTH // 2 - BODY.line_height

# Points or triangles of a view: it has no pixels for more.
MAX_DRAWN = 50_000

# Triangles whose edges are drawn; the edges of more would fill the view.
MAX_OUTLINED = 2_000


@dataclass(frozen=True, eq=False)
class View:
    """A view of points in space, from one side.

    `across` and `upward` are the axes that point to the right and upwards, `toward` is the axis
    that points to the viewer, and `sign` tells on which side of it the viewer stands. `middle` is
    the place (3,) [m] in its middle, and `scale` the pixels of the page a metre.
    """

    across: int
    upward: int
    toward: int
    sign: float
    middle: paper.Array
    scale: float

    def project(self, points: paper.Array) -> paper.Array:
        """(M, 2) places in the view [px of the page] of points (M, 3) [m]."""
        flat = (points - self.middle)[:, [self.across, self.upward]] * self.scale * (1, -1)
        return flat + VIEW_PX / 2 - 0.5

    @property
    def plane(self) -> paper.Array:
        """(3, 3) from (u, v, 1) of the view to the place [m] in the middle of what it shows."""
        plane = np.zeros((3, 3))
        plane[self.across, 0], plane[self.upward, 1] = 1 / self.scale, -1 / self.scale
        plane[:, 2] = self.middle - plane @ (VIEW_PX / 2 - 0.5, VIEW_PX / 2 - 0.5, 0)
        return plane

    def depth(self, points: paper.Array) -> paper.Array:
        """(M,) how far points lie towards the viewer."""
        return points[:, self.toward] * self.sign


# The words of each view, and its axes.
SIDES = (
    ("Seen from above (+z)", 0, 1, 2, 1.0),
    ("Seen from the side (-y)", 0, 2, 1, -1.0),
    ("Seen from the side (+x)", 1, 2, 0, 1.0),
)


def draw_views(sheet: paper.Paper, shown: Shown, y: float) -> tuple[float, float, float]:
    """Draw the three views.

    Returns the corner of the quarter that they leave free, and where the next thing below begins.
    """
    everything = [shown.fixture.points, *(marker.place[None] for marker in shown.markers)]
    low = np.vstack(everything).min(axis=0)
    high = np.vstack(everything).max(axis=0)
    scale = (VIEW_PX - 2 * MARGIN) / max(float((high - low).max()), 1e-9)
    # Each view cuts what is rendered in its middle.
    middle = (low + high) / 2
    cut = (shown.fixture.points.min(axis=0) + shown.fixture.points.max(axis=0)) / 2
    outlines: list[Outline] = []
    for number, (words, *axes) in enumerate(SIDES):
        row, column = divmod(number, 2)
        x = MARGIN + column * (paper.CONTENT_WIDTH - VIEW_PX)
        view_y = round(y) + row * (VIEW_PX + 60)
        view = View(*axes, np.where(np.arange(3) == axes[2], cut, middle), scale)
        sheet.text(x, view_y, words, STRONG)
        words = f"{'xyz'[view.across]} to the right, {'xyz'[view.upward]} upwards"
        sheet.text(x + 330, view_y, words, BODY, GREY)
        canvas = _geometry(view, shown)
        for outline in outlines_of(shown.fixture, view.plane, (VIEW_PX, VIEW_PX)):
            draw_rendered(canvas, outline, lambda points: points, ())
            outlines.append(outline)
        box = sheet.picture(x, view_y + 34, canvas)
        sheet.frame(box)
        _draw_marks(sheet, box, view, shown)
        # The length of a bar, below on the left.
        unit, per_metre = ("px", 1.0) if shown.fixture.frame == "image" else ("mm", 1e3)
        length = nice_length(160 / scale * per_metre)
        start = np.array([box.x + 16, box.bottom - 18])
        end = start + np.array([length / per_metre * scale, 0])
        paper.draw_line(sheet.canvas, np.array([start, end]), BLACK, 4)
        sheet.text(start[0], start[1] - 8 - BODY.line_height, f"{length:g} {unit}", BODY)
    free_x, free_y = MARGIN + paper.CONTENT_WIDTH - VIEW_PX, float(y + VIEW_PX + 60)
    rows = rendered_legend(outlines)
    if rows:
        place = ", ".join(f"{axis} = {MM * at:.1f}" for axis, at in zip("xyz", cut, strict=True))
        heading = "In the middle of each view"
        free_y = draw_legend_rows(sheet, heading, rows, free_x, free_y, VIEW_PX)
        free_y = sheet.paragraph(free_x, free_y, f"Cut at {place} mm.", VIEW_PX, BODY, GREY) + 10
    return free_x, free_y, float(y + 2 * (VIEW_PX + 60))


def _geometry(view: View, shown: Shown) -> paper.Pixels:
    """The points or the triangles, those in front over those behind."""
    canvas = np.full((VIEW_PX, VIEW_PX, 3), 255, np.uint8)
    points = shown.fixture.points
    if shown.fixture.mesh is not None and len(shown.fixture.mesh) <= MAX_DRAWN:
        # From the back to the front, darker the more a triangle is turned away.
        corners = points[shown.fixture.mesh]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        facing = np.abs(normals[:, view.toward]) / np.maximum(lengths, 1e-30)
        light = 0.35 + 0.6 * facing[:, None]
        colours = np.rint(light * (255 + np.array(LINE_COLOUR)) / 2).astype(int).tolist()
        flat = view.project(points)
        for k in np.argsort(view.depth(corners.mean(axis=1))):
            outline = paper.fixed_point(flat[shown.fixture.mesh[k]])
            cv2.fillConvexPoly(canvas, outline, colours[k], cv2.LINE_AA, paper.SHIFT)
            if len(shown.fixture.mesh) <= MAX_OUTLINED:
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


def _draw_marks(sheet: paper.Paper, box: paper.Box, view: View, shown: Shown) -> None:
    """Draw the markers and the findings that have a place, with captions."""
    x, y = round(box.x), round(box.y)
    part = sheet.canvas[y : y + VIEW_PX, x : x + VIEW_PX]
    marks = [(marker.label, marker.place) for marker in shown.markers]
    for number, finding in enumerate(shown.findings, 1):
        if finding.place_m is not None:
            marks.append((f"F{number}", np.array(finding.place_m)))
    if not marks:
        return
    keep = np.zeros((VIEW_PX, VIEW_PX), np.uint8)
    keep[VIEW_PX - 70 :, : VIEW_PX // 2] = 1  # The scale stands here.
    drawn = view.project(np.array([place for _, place in marks]))
    for place in drawn:
        paper.draw_disc(part, place, 11, WHITE, 5)
        paper.draw_disc(part, place, 11, BLACK, 2)
        paper.draw_disc(keep, place, 14, 1)
    labeller = paper.Labeller(keep > 0)
    for (words, _), place in zip(marks, drawn, strict=True):
        draw_tag(sheet, part, box, labeller, place, words)


def draw_tag(
    sheet: paper.Paper, part: paper.Pixels, box: paper.Box, labeller: paper.Labeller,
    point: paper.Array, words: str, ground: paper.Colour = WHITE,
) -> None:  # fmt: skip
    """Write a caption in a small plate close to its point, if there is a place for one.

    `ground` is the plate's colour. The letters are black on white, and white on any other.
    """
    words = paper.shortened(words, 220, STRONG)
    width, height = round(STRONG.width_of(words)) + 12, STRONG.line_height + 2
    place = labeller.place(point, width, height)
    if place is None:
        return
    x, y, leader = place
    paper.draw_cased(part, leader, BLACK, 1)
    plate = part[y : y + height, x : x + width]
    plate[:] = BLACK
    plate[2:-2, 2:-2] = ground
    letters = BLACK if ground == WHITE else WHITE
    sheet.text(box.x + x + 6, box.y + y + 1, words, STRONG, letters)


# Width [px of the page] of the column of facts beside the slice.
COLUMN_WIDTH = round(1.3 * INSET_PX)

# Width [px of the page] of the slice at most.
PICTURE_WIDTH = paper.CONTENT_WIDTH - COLUMN_WIDTH - BODY.line_height

# Height [px of the page] of the slice at most: a row of insets fits below it.
PICTURE_HEIGHT = 980

# Distance [px of the page] between the edge of the ink and the outline beside it.
OUTLINE_GAP = 7.0

# Half the pen's width [px of the slice] if nobody knows it: half of what pens mostly are.
USUAL_HALF_WIDTH = 2.0

# Radius [px of the page] around an end that no outline, arrow or caption enters.
FREE_RADIUS = 20


# Radius [px of the page] of the disc ahead of an end that no caption enters: a cover of the end
# lies there, and it has to be visible.
AHEAD_RADIUS = 5 * FREE_RADIUS


@dataclass(frozen=True, eq=False)
class Panel:
    """The picture of the slice; `zoom` is how many pixels of the page one of the slice takes."""

    x: int
    y: int
    width: int
    height: int
    zoom: float

    def place(self, points_px: Any) -> paper.Array:
        """Pixels of the slice to pixels of this picture; (0, 0) is the middle of the first."""
        return (np.asarray(points_px, dtype=float) + 0.5) * self.zoom - 0.5

    def outline_distance(self, stroke: Stroke) -> float:
        """From the middle of a line to the outline beside its ink [px of the page]."""
        half_width = USUAL_HALF_WIDTH if stroke.width is None else stroke.width / 2
        return half_width * self.zoom + OUTLINE_GAP


def draw_picture(
    sheet: paper.Paper, shown: Shown, rgb: paper.Pixels, y: float, column_x: float,
    column_width: float,
) -> tuple[float, float]:  # fmt: skip
    """Draw the slice with all that is marked on it, and the legend in the column beside it.

    Returns where the next thing below begins, in the left part and in the column.
    """
    height, width = rgb.shape[:2]
    zoom = min(PICTURE_WIDTH / width, PICTURE_HEIGHT / height)
    size = max(1, round(width * zoom)), max(1, round(height * zoom))
    enlarged = cv2.INTER_LINEAR if zoom < 2 else cv2.INTER_NEAREST
    method = cv2.INTER_AREA if zoom < 1 else enlarged
    panel = Panel(MARGIN, round(y), *size, zoom)
    box = sheet.picture(panel.x, panel.y, cv2.resize(rgb, size, interpolation=method))
    sheet.frame(box)

    canvas = sheet.canvas[panel.y : panel.y + panel.height, panel.x : panel.x + panel.width]
    ends = [panel.place(end.place) for stroke in shown.strokes for end in ends_of(stroke)]
    # The casings first: outline and line may lie close together.
    for outline in shown.outlines:
        draw_rendered(canvas, outline, panel.place, ends)
    region = _draw_outline(canvas, shown, panel)
    for outline in shown.outlines:
        draw_rendered(canvas, outline, panel.place, ends, is_cased=False)
    has_bound = _draw_bound(canvas, shown, panel)
    enlargement = _residual_enlargement(shown)
    _draw_markers(canvas, shown, panel, enlargement)
    labeller = paper.Labeller(_kept_visible(shown, panel, region, enlargement))
    _draw_captions(sheet, canvas, box, shown, panel, labeller)

    bottom = _draw_scale_bar(sheet, shown, panel)
    if labeller.omitted:
        words = f"There was no place for {labeller.omitted} captions; the lists below name all."
        bottom = sheet.paragraph(MARGIN, bottom, words, PICTURE_WIDTH, BODY, GREY)
    column_y = _draw_legend(sheet, shown, enlargement, has_bound, column_x, y, column_width)
    return bottom, column_y


def _draw_outline(canvas: paper.Pixels, shown: Shown, panel: Panel) -> paper.Pixels:
    """Draw the outline beside each line; returns the region that it surrounds, 255 inside."""
    region = np.zeros((panel.height, panel.width), np.uint8)
    for stroke in shown.strokes:
        distance = panel.outline_distance(stroke)
        points = panel.place(stroke.points)
        if stroke.is_ordered:
            thickness = max(1, round(2 * distance))
            paper.draw_line(region, points, 255, thickness, stroke.closed)
        else:
            for point in points:
                paper.draw_disc(region, point, distance, 255)
    contours = paper.contours_of(region)
    casing, outline = np.zeros_like(region), np.zeros_like(region)
    cv2.drawContours(casing, contours, -1, 255, 4, cv2.LINE_AA)
    cv2.drawContours(outline, contours, -1, 255, 2, cv2.LINE_AA)
    for stroke in shown.strokes:
        for end in ends_of(stroke):
            for layer in (casing, outline):
                paper.draw_disc(layer, panel.place(end.place), FREE_RADIUS, 0)
    bridges = np.zeros_like(region)
    for stroke in shown.strokes:
        thickness = round(2 * panel.outline_distance(stroke)) + 12
        for run in runs(stroke.bridged, stroke.closed):
            paper.draw_line(bridges, panel.place(stroke.points[run]), 255, thickness)
    paper.blend(canvas, casing, WHITE, 0, 0)
    paper.blend(canvas, np.where(bridges > 0, 0, outline).astype(np.uint8), LINE_COLOUR, 0, 0)
    paper.blend(
        canvas, np.where(bridges > 0, outline, 0).astype(np.uint8), paper.BRIDGE_COLOUR, 0, 0
    )
    return region


# The colour of what the robot renders: the tool is kept off a wall, and held in a guide's tube.
RENDERED_COLOUR = {"wall": paper.WALL_COLOUR, "guide": paper.GUIDE_COLOUR}

# What a line means, its colour, and whether it has dashes.
LegendRow = tuple[str, paper.Colour, bool]

# What the legend says of it.
RENDERED_IN_WORDS: dict[str, LegendRow] = {
    "wall": ("Red line: the tool's centre stops there, says the engine", paper.WALL_COLOUR, False),
    "guide": ("Green line with ticks: the tip is held within it; arrow: its pull",
              paper.GUIDE_COLOUR, False),
}  # fmt: skip

# Distance between the ticks of a guide, their length, and that of the arrow of its pull [px of the
# page]. They stand on the side on which the guide pushes back.
TICK_STEP, TICK_LENGTH, PULL_LENGTH = 16.0, 7.0, 70.0


def rendered_legend(outlines: Iterable[Outline]) -> list[LegendRow]:
    """What the legend says of these outlines, once for each kind."""
    return [RENDERED_IN_WORDS[kind] for kind in sorted({outline.kind for outline in outlines})]


def draw_rendered(
    canvas: paper.Pixels, outline: Outline, place: Any, ends: Iterable[paper.Array],
    is_cased: bool = True,
) -> None:  # fmt: skip
    """Draw where the engine pushes, but for what lies close to an end of the line.

    `place` takes pixels of the slice to the canvas, and `ends` are places on the canvas.
    """
    casing, drawn = (np.zeros(canvas.shape[:2], np.uint8) for _ in range(2))
    for line in map(place, outline.lines):
        parts = [line]
        if outline.kind == "guide":
            arc = arc_lengths(line, False)
            at = values_at(line, np.interp(np.arange(0, arc[-1], TICK_STEP), arc, range(len(arc))))
            along = np.gradient(at, axis=0) if len(at) > 1 else np.zeros_like(at)
            along /= np.maximum(np.hypot(*along.T), 1e-9)[:, None]
            outward = TICK_LENGTH * np.column_stack([-along[:, 1], along[:, 0]])
            parts += list(np.stack([at, at + outward], axis=1))
        for part in parts:
            paper.draw_line(casing, part, 255, 5)
            paper.draw_line(drawn, part, 255, 2)
    for layer in (casing, drawn):
        for end in ends:
            paper.draw_disc(layer, end, FREE_RADIUS + 4, 0)
    if is_cased:
        paper.blend(canvas, casing, WHITE, 0, 0)
    paper.blend(canvas, drawn, RENDERED_COLOUR[outline.kind], 0, 0)
    if outline.pull is not None and outline.lines:
        # Beside the tube, so that the ink stays free.
        start, along = outline.pull
        start, line = place(start), place(np.vstack(outline.lines))
        across = np.array([-along[1], along[0]])
        middle = start + (np.hypot(*(line - start).T).min() + TICK_LENGTH + 14) * across
        half = PULL_LENGTH / 2 * along
        paper.draw_arrow(canvas, middle - half, middle + half, RENDERED_COLOUR[outline.kind])


def _draw_bound(canvas: paper.Pixels, shown: Shown, panel: Panel) -> bool:
    """Draw the 95 % band where it reaches beyond the outline; whether it does."""
    is_drawn = False
    for stroke, half_m in shown.bounds:
        reach = half_m * panel.zoom / shown.metres_per_px
        if reach.max() > panel.outline_distance(stroke) + 3:
            paper.draw_bound(canvas, panel.place(stroke.points), reach, stroke.closed)
            is_drawn = True
    return is_drawn


def _residual_enlargement(shown: Shown) -> float | None:
    """How much longer than true the residuals are drawn, as on the page; `None` for none."""
    lengths = [
        float(np.hypot(*marker.residual_px))
        for marker in shown.markers
        if marker.residual_px is not None
    ]
    if not lengths:
        return None
    longest = max(lengths)
    arrow_px = max(shown.image.width_px, 300) / 10
    return min(nice_length(arrow_px / longest), 500.0) if 0 < longest < arrow_px else 1.0


def _draw_markers(
    canvas: paper.Pixels, shown: Shown, panel: Panel, enlargement: float | None
) -> None:
    """Draw each marker where it was given, and its residual as an arrow."""
    for marker in shown.markers:
        centre = panel.place(marker.place)
        # A ring and four ticks leave the place itself free; slanted ticks mean that it is unused.
        turns, inner = ((0, 90, 180, 270), 13) if marker.is_used else ((45, 135, 225, 315), 4)
        for colour, thickness in ((WHITE, 5), (BLACK, 2)):
            paper.draw_disc(canvas, centre, 13, colour, thickness)
            for turn in turns:
                direction = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
                tick = np.array([centre + inner * direction, centre + 21 * direction])
                paper.draw_line(canvas, tick, colour, thickness)
        if marker.residual_px is None:
            continue
        residual = np.asarray(marker.residual_px) * panel.zoom * enlargement
        paper.draw_arrow(canvas, centre, centre + residual, BLACK)


def _kept_visible(
    shown: Shown, panel: Panel, region: paper.Pixels, enlargement: float | None
) -> NDArray[np.bool_]:
    """(H, W) what no caption may cover.

    That is the ink, the ends and what lies ahead of them, the markers and the residuals.
    """
    keep = cv2.dilate(region, np.ones((9, 9), np.uint8))
    for stroke in shown.strokes:
        for end in ends_of(stroke):
            place = panel.place(end.place)
            paper.draw_disc(keep, place, FREE_RADIUS + 8, 255)
            if end.direction is not None:
                paper.draw_disc(keep, place + AHEAD_RADIUS * end.direction, AHEAD_RADIUS, 255)
    for marker in shown.markers:
        place = panel.place(marker.place)
        paper.draw_disc(keep, place, 24, 255)
        if marker.residual_px is not None:
            tip = place + np.asarray(marker.residual_px) * panel.zoom * enlargement
            paper.draw_line(keep, np.array([place, tip]), 255, 20)
    return keep > 0


def _draw_captions(
    sheet: paper.Paper, canvas: paper.Pixels, box: paper.Box, shown: Shown, panel: Panel,
    labeller: paper.Labeller,
) -> None:  # fmt: skip
    """Ends and bridges first, then findings, markers and other ink, as long as places are free."""

    def tag(place: Any, words: str, *, ground: paper.Colour = WHITE) -> None:
        draw_tag(sheet, canvas, box, labeller, panel.place(place), words, ground)

    for number, stroke in enumerate(shown.strokes, 1):
        is_single = len(shown.strokes) == 1
        of_line, of_bridge = ("", "") if is_single else (f" {number}", f" of {number}")
        for end in ends_of(stroke):
            tag(end.place, end.name + of_line, ground=LINE_COLOUR)
        for k, run in enumerate(runs(stroke.bridged, stroke.closed), 1):
            tag(stroke.points[run[len(run) // 2]], f"bridge {k}{of_bridge}")
    for number, finding in enumerate(shown.findings, 1):
        if finding.place_px is not None:
            tag(finding.place_px, f"F{number}", ground=BLACK)
    for marker in shown.markers:
        residual = millimetres(marker.residual_m, 2) if marker.is_used else "left out"
        tag(marker.place, f"{marker.label} {residual}")
    for entry in shown.other_ink[:MAX_NUMBERED]:
        tag((entry.u, entry.v), str(entry.number))


def _draw_scale_bar(sheet: paper.Paper, shown: Shown, panel: Panel) -> float:
    """Draw a bar below the picture; returns where the next thing below begins."""
    if shown.metres_per_px is None:
        length = nice_length(0.2 * panel.width / panel.zoom)
        words, length_px = f"{length:g} px", length * panel.zoom
    else:
        mm_per_page_px = shown.metres_per_px * 1e3 / panel.zoom
        length = nice_length(0.2 * panel.width * mm_per_page_px)
        words, length_px = f"{length:g} mm", length / mm_per_page_px
    y = panel.y + panel.height + 8
    middle = y + BODY.line_height / 2
    bar = np.array([[panel.x + 2, middle], [panel.x + 2 + length_px, middle]])
    paper.draw_line(sheet.canvas, bar, BLACK, 4)
    sheet.text(panel.x + length_px + 16, y, words, BODY)
    return float(y + BODY.line_height)


def _draw_legend(
    sheet: paper.Paper, shown: Shown, enlargement: float | None, has_bound: bool,
    x: float, y: float, width: float,
) -> float:  # fmt: skip
    """What the lines on the picture mean."""
    made, line = shown.fixture.provenance, "the curve that was taken"
    if "image" in made.inputs and "curve" not in made.inputs:
        pen = made.settings.get("colour", ExtractSettings().colour)
        line = f"the line of the pen ({pen}) that was taken"
    if shown.strokes and all(stroke.edited.all() for stroke in shown.strokes):
        line = "the line, which was drawn by hand"
    rows: list[LegendRow] = [(f"Blue outline: beside {line}", LINE_COLOUR, False)]
    rows += rendered_legend(shown.outlines)
    if any(stroke.bridged.any() for stroke in shown.strokes):
        rows.append(("Orange outline: carried over a gap", paper.BRIDGE_COLOUR, False))
    if shown.tre95_m is not None:
        where = "true scale" if has_bound else "see the last enlargement"
        words = f"Purple dashes: 95 % band of markers and drawing, {where}"
        rows.append((words, paper.BAND_COLOUR, True))
    if enlargement is not None:
        length = "true length" if enlargement == 1 else f"drawn {enlargement:g} times as long"
        rows.append((f"Circle: marker as given; arrow: residual, {length}", BLACK, False))
    y = draw_legend_rows(sheet, "On the picture", rows, x, y, width)
    if shown.other_ink:
        y = sheet.paragraph(x, y, "Plain numbers: other ink, listed below.", width)
    return y + 10


def draw_legend_rows(
    sheet: paper.Paper, heading: str, rows: list[LegendRow], x: float, y: float, width: float
) -> float:
    """A sample of each line beside what it means; returns where the next thing begins."""
    sheet.text(x, y, heading, paper.HEADING)
    y += paper.HEADING.line_height + 4
    for words, colour, is_dashed in rows:
        middle = y + BODY.line_height / 2
        dashes = ((0, 12), (17, 29), (34, 44)) if is_dashed else ((0, 44),)
        for start, end in dashes:
            line = np.array([[x + start, middle], [x + end, middle]])
            paper.draw_line(sheet.canvas, line, colour, 4)
        y = sheet.paragraph(x + 56, y, words, width - 56, BODY) + 6
    return y
