"""The review sheet: one picture on which a person sees whether a plan is right.

From top to bottom: the verdict; the slice in its true greys with the ink visible; both ends of
each line and every bridge enlarged; the findings; the other ink. A grey box that hides the end of
a line leaves no trace in the ink, so no program can tell. An eye can, if it sees the end enlarged
and nothing is drawn over it. That is what this sheet is for.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.io.staging import write_whole
from vfplan.review import paper
from vfplan.review.insets import (
    INSET_PX,
    Inset,
    draw_distance,
    draw_inset,
    ends_of,
    insets_of,
    runs_of,
)
from vfplan.review.labels import Labeller
from vfplan.review.paper import (
    BAND_COLOUR,
    BLACK,
    BODY,
    BRIDGE_COLOUR,
    CONTENT_WIDTH,
    DPI,
    GREY,
    HEADING,
    LINE_COLOUR,
    MARGIN,
    MARGIN_COLOUR,
    PAGE_HEIGHT,
    PAGE_WIDTH,
    SMALL,
    SMALL_BOLD,
    STRONG,
    TITLE,
    WHITE,
    Box,
    Paper,
)
from vfplan.review.sheet_input import SheetInput, SheetStroke
from vfplan.review.views import draw_tag, draw_views, nice_length

Array = NDArray[np.float64]

# The picture of the slice, and the column of facts on its right [px of the page].
PICTURE_WIDTH = 1090
PICTURE_HEIGHT = 980
COLUMN_LEFT = MARGIN + PICTURE_WIDTH + 32
COLUMN_WIDTH = PAGE_WIDTH - MARGIN - COLUMN_LEFT

WHAT_TO_LOOK_FOR = (
    "Does the line stop there, or does a box or a label hide the rest of it? If it goes on, "
    "draw the rest with vfplan review."
)

# Where the foot of a page begins; nothing else stands below.
FOOT = PAGE_HEIGHT - MARGIN - BODY.line_height

# Between the edge of the ink and the outline beside it [px of the page].
OUTLINE_GAP = 7.0

# Half the pen's width where nobody knows it [px of the slice]: half of what pens mostly are.
USUAL_HALF_WIDTH = 2.0

# Circles round the ends of a line that no outline, arrow or caption enters [px of the page].
FREE_RADIUS = 20

# The longest arrow of a residual is about this long [px of the page].
ARROW_LENGTH = 90

# A row of insets: four of them, each with two lines of caption above.
INSETS_IN_A_ROW = 4
INSET_STEP = (CONTENT_WIDTH - INSET_PX) / (INSETS_IN_A_ROW - 1)
CAPTION_HEIGHT = 2 * SMALL.line_height + 12

# Entries of the account that are listed; the others are summed up.
LISTED_ENTRIES = 12


@dataclass(frozen=True, eq=False)
class Sheet:
    """A finished sheet: (H, W, 3) uint8 pixels, red first, and what stands where on its pages."""

    pixels: NDArray[np.uint8]
    boxes: tuple[Box, ...]

    def png(self) -> bytes:
        """The sheet as a PNG file that prints at its own size, 200 dots an inch."""
        return _png(self.pixels)

    def page_pngs(self) -> list[bytes]:
        """Each page as a PNG file of its own."""
        count = len(self.pixels) // PAGE_HEIGHT
        return [_png(part) for part in np.split(self.pixels, count)]


def write_sheet(shown: SheetInput, path: Path) -> None:
    """Write the sheet as a PNG; raises `OutputError`."""
    write_whole(path, [draw_sheet(shown).png()], overwrite=True)


def draw_sheet(shown: SheetInput) -> Sheet:
    """Draw the sheet of what is to be reviewed."""
    sheet = Paper()
    top = _draw_head(sheet, shown)
    if shown.rgb is None:
        left, free, top = draw_views(sheet, shown, top)
        _draw_facts(sheet, shown, left, free, PAGE_WIDTH - MARGIN - left)
        _draw_lists(sheet, shown, top)
    else:
        rgb = as_uint8(shown.rgb)
        top = _draw_slice(sheet, shown, rgb, top)
        _draw_insets(sheet, insets_of(shown), rgb, shown, top + 20)
    _draw_feet(sheet, shown)
    return Sheet(sheet.image(), tuple(sheet.boxes))


def as_uint8(rgb: NDArray[Any]) -> NDArray[np.uint8]:
    """The slice in 8 bits: as it is, or of 16 bits so that its brightest value is white."""
    if rgb.dtype == np.uint8:
        return rgb
    return np.rint(rgb * (255.0 / max(1, int(rgb.max())))).astype(np.uint8)


def _draw_head(sheet: Paper, shown: SheetInput) -> float:
    """The verdict, and what is reviewed."""
    if shown.open_doubts or shown.missing_slice:
        lines = len(paper.wrapped(shown.verdict, CONTENT_WIDTH - 32, TITLE))
        bar = slice(MARGIN - 10, MARGIN + lines * TITLE.line_height + 10)
        sheet.canvas[bar, MARGIN : PAGE_WIDTH - MARGIN] = BLACK
        top = sheet.paragraph(MARGIN + 16, MARGIN, shown.verdict, CONTENT_WIDTH - 32, TITLE, WHITE)
        top += 12
    else:
        top = sheet.paragraph(MARGIN, MARGIN, shown.verdict, CONTENT_WIDTH, TITLE)
    words = f"Review sheet of {shown.title}."
    if shown.side is not None:
        words += f" The slice is seen from {shown.side}."
    return sheet.paragraph(MARGIN, top + 4, words, CONTENT_WIDTH, BODY, GREY) + 14


def _draw_feet(sheet: Paper, shown: SheetInput) -> None:
    """The digest on every page, and which page of how many it is."""
    for page in range(sheet.page + 1):
        number = f"page {page + 1} of {sheet.page + 1}"
        left = PAGE_WIDTH - MARGIN - BODY.width_of(number)
        sheet.text(MARGIN, FOOT, f"digest {shown.digest}", BODY, page=page)
        sheet.text(left, FOOT, number, BODY, GREY, page=page)


def _room(sheet: Paper, top: float, height: float) -> float:
    """Where something of this height may stand: here, or at the top of a new page."""
    if top + height <= FOOT - 12:
        return top
    sheet.add_page()
    return float(MARGIN)


# ---- the slice ----


@dataclass(frozen=True, eq=False)
class _Panel:
    """The picture of the slice; `zoom` is how many pixels of the page one of the slice takes."""

    left: int
    top: int
    width: int
    height: int
    zoom: float

    def within(self, points_px: Any) -> Array:
        """Pixels of the slice to pixels of this picture; (0, 0) is the middle of the first."""
        return (np.asarray(points_px, dtype=float) + 0.5) * self.zoom - 0.5


def _draw_slice(sheet: Paper, shown: SheetInput, rgb: NDArray[np.uint8], top: float) -> float:
    height, width = rgb.shape[:2]
    zoom = min(PICTURE_WIDTH / width, PICTURE_HEIGHT / height)
    size = max(1, round(width * zoom)), max(1, round(height * zoom))
    if zoom < 1:
        method = cv2.INTER_AREA
    elif zoom < 2:
        method = cv2.INTER_LINEAR
    else:
        method = cv2.INTER_NEAREST
    panel = _Panel(MARGIN, round(top), *size, zoom)
    picture = cv2.resize(rgb, size, interpolation=method)
    placed = sheet.picture(panel.left, panel.top, picture)
    sheet.frame(placed)

    part = sheet.canvas[panel.top : panel.top + panel.height, panel.left :][:, : panel.width]
    region = _draw_lines(part, shown, panel)
    widest = _draw_bands(part, shown, panel)
    arrows = _arrow_times(shown, panel)
    _draw_markers(part, shown, panel, arrows)
    labeller = Labeller(_kept_visible(shown, panel, region, arrows))
    _draw_captions(sheet, part, shown, panel, labeller)

    bottom = _draw_scale_bar(sheet, shown, panel)
    if labeller.left_out:
        words = f"{labeller.left_out} captions had no room here; the lists below name all."
        bottom = sheet.paragraph(MARGIN, bottom, words, PICTURE_WIDTH, SMALL, GREY)
    column = _draw_legend(sheet, shown, arrows, widest, COLUMN_LEFT, top)
    column = _draw_facts(sheet, shown, COLUMN_LEFT, column + 10, COLUMN_WIDTH)
    return max(bottom, column)


def _half_width(stroke: SheetStroke, panel: _Panel) -> float:
    """From the middle of the line to the outline beside its ink [px of the page]."""
    half = USUAL_HALF_WIDTH if stroke.width_px is None else stroke.width_px / 2
    return half * panel.zoom + OUTLINE_GAP


def _region(
    strokes: tuple[SheetStroke, ...], panel: _Panel, half_widths: list[float]
) -> NDArray[np.uint8]:
    """(H, W) 255 where a picture of the slice lies within a distance of the lines."""
    region = np.zeros((panel.height, panel.width), np.uint8)
    for stroke, half in zip(strokes, half_widths, strict=True):
        points = panel.within(stroke.points_px)
        if stroke.is_ordered:
            thickness = max(1, round(2 * half))
            paper.draw_line(region, points, 255, thickness, stroke.closed)
        else:
            for point in points:
                paper.draw_disc(region, point, half, 255)
    return region


def _draw_lines(part: NDArray[np.uint8], shown: SheetInput, panel: _Panel) -> NDArray[np.uint8]:
    """Draw the outline beside each line; returns the region that it surrounds."""
    half_widths = [_half_width(stroke, panel) for stroke in shown.strokes]
    region = _region(shown.strokes, panel, half_widths)
    contours, _ = cv2.findContours(
        (region > 127).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE
    )
    casing, outline = np.zeros_like(region), np.zeros_like(region)
    cv2.drawContours(casing, contours, -1, 255, 4, cv2.LINE_AA)
    cv2.drawContours(outline, contours, -1, 255, 2, cv2.LINE_AA)
    for stroke in shown.strokes:
        for end in ends_of(stroke):
            for cover in (casing, outline):
                paper.draw_disc(cover, panel.within(end), FREE_RADIUS, 0)
    bridges = np.zeros_like(region)
    for stroke, half in zip(shown.strokes, half_widths, strict=True):
        for run in runs_of(stroke.bridged, stroke.closed):
            points = panel.within(stroke.points_px[run])
            paper.draw_line(bridges, points, 255, round(2 * half) + 12)
    paper.blend(part, casing, WHITE, 0, 0)
    paper.blend(part, np.where(bridges > 0, 0, outline).astype(np.uint8), LINE_COLOUR, 0, 0)
    paper.blend(part, np.where(bridges > 0, outline, 0).astype(np.uint8), BRIDGE_COLOUR, 0, 0)
    return region


def _draw_bands(part: NDArray[np.uint8], shown: SheetInput, panel: _Panel) -> dict[str, bool]:
    """Draw margin and 95 % band where they reach beyond the outline; says which were drawn."""
    drawn = {"margin": False, "bound": False}
    if shown.metres_per_px is None:
        return drawn
    first = 0
    for stroke in shown.strokes:
        count = len(stroke.points_px)
        at = panel.within(stroke.points_px)
        outline = _half_width(stroke, panel) + 3
        to_page = panel.zoom / shown.metres_per_px
        if shown.margin_m and shown.margin_m * to_page > outline:
            distance = np.full(count, shown.margin_m * to_page)
            draw_distance(part, at, distance, stroke.closed, MARGIN_COLOUR, dashed=False)
            drawn["margin"] = True
        if shown.tre95_m is not None:
            distance = shown.tre95_m[first : first + count] * to_page
            if distance.max() > outline:
                draw_distance(part, at, distance, stroke.closed, BAND_COLOUR, dashed=True)
                drawn["bound"] = True
        first += count
    return drawn


def _arrow_times(shown: SheetInput, panel: _Panel) -> float | None:
    """How much longer than true the residuals are drawn; `None` where there are none."""
    lengths = [float(np.hypot(*m.residual_px)) for m in shown.markers if m.residual_px is not None]
    if not lengths:
        return None
    longest = max(lengths) * panel.zoom
    if not 0 < longest < ARROW_LENGTH:
        return 1.0
    return nice_length(ARROW_LENGTH / longest)


def _draw_markers(
    part: NDArray[np.uint8], shown: SheetInput, panel: _Panel, times: float | None
) -> None:
    """Draw each marker where it was given, and its residual."""
    for marker in shown.markers:
        at = panel.within(marker.place)
        for colour, thickness in ((WHITE, 5), (BLACK, 2)):
            _draw_cross(part, at, colour, thickness, marker.used)
        if marker.residual_px is not None:
            _draw_arrow(part, at, np.asarray(marker.residual_px) * panel.zoom * times)


def _draw_cross(
    part: NDArray[np.uint8], at: Array, colour: paper.Colour, thickness: int, used: bool
) -> None:
    """A ring and four ticks round a place, which stays free; a slanted cross where left out."""
    paper.draw_disc(part, at, 13, colour, thickness)
    turns = (0, 90, 180, 270) if used else (45, 135, 225, 315)
    for turn in turns:
        way = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
        inner = 13 if used else 4
        paper.draw_line(part, np.array([at + inner * way, at + 21 * way]), colour, thickness)


def _draw_arrow(part: NDArray[np.uint8], at: Array, way: Array) -> None:
    length = float(np.hypot(*way))
    if length < 1:
        return
    along = way / length
    across = np.array([-along[1], along[0]])
    tip, head = at + way, min(14.0, length)
    shaft = np.array([at, tip - 0.7 * head * along])
    corners = np.array(
        [tip, tip - head * along + 0.4 * head * across, tip - head * along - 0.4 * head * across]
    )
    paper.draw_line(part, shaft, WHITE, 7)
    paper.draw_line(part, corners, WHITE, 4, True)
    paper.draw_line(part, shaft, BLACK, 3)
    cv2.fillConvexPoly(part, paper.fixed_point(corners), BLACK, cv2.LINE_AA, paper.SHIFT)


def _scale_bar(shown: SheetInput, panel: _Panel) -> tuple[float, str]:
    """The length of the bar on the page, and what it stands for."""
    if shown.metres_per_px is None:
        length = nice_length(0.2 * panel.width / panel.zoom)
        return length * panel.zoom, f"{length:g} px"
    mm_per_page_px = shown.metres_per_px * 1e3 / panel.zoom
    length = nice_length(0.2 * panel.width * mm_per_page_px)
    return length / mm_per_page_px, f"{length:g} mm"


def _draw_scale_bar(sheet: Paper, shown: SheetInput, panel: _Panel) -> float:
    """Draw a bar below the picture; returns where the next thing below begins."""
    length, words = _scale_bar(shown, panel)
    top = panel.top + panel.height + 8
    middle = top + SMALL.line_height / 2
    bar = np.array([[panel.left + 2, middle], [panel.left + 2 + length, middle]])
    paper.draw_line(sheet.canvas, bar, BLACK, 4)
    sheet.text(panel.left + length + 16, top, words, SMALL)
    return float(top + SMALL.line_height)


def _kept_visible(
    shown: SheetInput, panel: _Panel, region: NDArray[np.uint8], times: float | None
) -> NDArray[np.bool_]:
    """(H, W) what no caption may cover: the ink, the ends, the markers and the residuals."""
    keep = cv2.dilate(region, np.ones((9, 9), np.uint8))
    for stroke in shown.strokes:
        for end in ends_of(stroke):
            paper.draw_disc(keep, panel.within(end), FREE_RADIUS + 8, 255)
    for marker in shown.markers:
        at = panel.within(marker.place)
        paper.draw_disc(keep, at, 24, 255)
        if marker.residual_px is not None:
            tip = at + np.asarray(marker.residual_px) * panel.zoom * times
            paper.draw_line(keep, np.array([at, tip]), 255, 20)
    return keep > 0


def _draw_captions(
    sheet: Paper, part: NDArray[np.uint8], shown: SheetInput, panel: _Panel, labeller: Labeller
) -> None:
    """Start and end first, then findings, markers and other ink, as long as there is room."""
    box = Box(sheet.page, panel.left, panel.top, panel.width, panel.height, "picture")

    def tag(place: Any, words: str, *, is_dark: bool = False) -> None:
        draw_tag(sheet, part, box, labeller, panel.within(place), words, is_dark=is_dark)

    for number, stroke in enumerate(shown.strokes, 1):
        suffix = "" if len(shown.strokes) == 1 else f" {number}"
        for words, end in zip(("start", "end"), ends_of(stroke), strict=False):
            tag(end, words + suffix)
        for k, run in enumerate(runs_of(stroke.bridged, stroke.closed), 1):
            tag(stroke.points_px[run[len(run) // 2]], f"bridge {k}" + (suffix and f" of{suffix}"))
    for number, finding in enumerate(shown.findings, 1):
        if finding.place_px is not None:
            tag(finding.place_px, f"F{number}", is_dark=True)
    for marker in shown.markers:
        words = f"{marker.label} {marker.residual_m * 1e3:.2f} mm"
        if not marker.used:
            words += ", left out"
        tag(marker.place, words)
    for entry in shown.account or ():
        tag((entry.u, entry.v), str(entry.number))


def _draw_legend(
    sheet: Paper, shown: SheetInput, arrows: float | None, drawn: dict[str, bool], left: float,
    top: float,
) -> float:  # fmt: skip
    """What the lines on the picture mean."""
    rows: list[tuple[str, paper.Colour, bool]] = [
        ("Outline beside the line that was taken", LINE_COLOUR, False)
    ]
    if any(stroke.bridged.any() for stroke in shown.strokes):
        rows.append(("The same, carried over a gap", BRIDGE_COLOUR, False))
    if drawn["margin"]:
        rows.append(("Margin, true scale", MARGIN_COLOUR, False))
    elif shown.margin_m:
        rows.append(("Margin: within the outline, see the last inset", MARGIN_COLOUR, False))
    if drawn["bound"]:
        rows.append(("95 % band of the registration, true scale", BAND_COLOUR, True))
    elif shown.tre95_m is not None:
        rows.append(("95 % band: within the outline, see the last inset", BAND_COLOUR, True))
    if arrows is not None:
        times = "true length"
        if arrows != 1:
            times = f"{arrows:g} times as long"
        rows.append((f"Marker as given; arrow: residual, {times}", BLACK, False))
    sheet.text(left, top, "On the picture", HEADING)
    top += HEADING.line_height + 4
    for words, colour, is_dashed in rows:
        middle = top + BODY.line_height / 2
        ends = ((0, 44),) if not is_dashed else ((0, 12), (17, 29), (34, 44))
        for start, end in ends:
            paper.draw_line(
                sheet.canvas, np.array([[left + start, middle], [left + end, middle]]), colour, 4
            )
        top = sheet.paragraph(left + 56, top, words, COLUMN_WIDTH - 56, BODY) + 6
    if shown.account:
        top = sheet.paragraph(left, top, "Plain numbers: other ink, listed below.", COLUMN_WIDTH)
    return top + 10


def _draw_facts(sheet: Paper, shown: SheetInput, left: float, top: float, width: float) -> float:
    """From where the slice is seen, and the numbers of the plan."""
    facts = shown.facts
    has_ends = any(ends_of(stroke) and not stroke.closed for stroke in shown.strokes)
    if has_ends and shown.rgb is not None:
        facts = (("Look at each end", WHAT_TO_LOOK_FOR), *facts)
    if shown.side is not None:
        facts = (("The slice is seen from", shown.side), *facts)
    for heading, words in facts:
        top = _room(sheet, top, HEADING.line_height + BODY.line_height)
        sheet.text(left, top, heading, HEADING)
        top = sheet.paragraph(left, top + HEADING.line_height, words, width) + 10
    return top


# ---- the insets ----


def _draw_insets(
    sheet: Paper, insets: list[Inset], rgb: NDArray[np.uint8], shown: SheetInput, top: float
) -> None:
    """Rows of four insets, and the lists after them; a row that does not fit begins a new page."""
    row_height = CAPTION_HEIGHT + INSET_PX + 30
    last_row = top
    for first in range(0, len(insets), INSETS_IN_A_ROW):
        top = _room(sheet, top, row_height)
        last_row = top
        for k, inset in enumerate(insets[first : first + INSETS_IN_A_ROW]):
            left = round(MARGIN + k * INSET_STEP)
            caption = paper.shortened(inset.caption, INSET_PX, SMALL_BOLD)
            sheet.text(left, top, caption, SMALL_BOLD)
            words = paper.shortened(_inset_in_words(inset, shown), INSET_PX, SMALL)
            sheet.text(left, top + SMALL.line_height, words, SMALL, GREY)
            draw_inset(sheet, inset, rgb, shown, left, round(top + CAPTION_HEIGHT))
        top += row_height
    beside = len(insets) % INSETS_IN_A_ROW
    # Short lists stand in what the last row leaves free, so that most sheets are one page.
    left = MARGIN + beside * INSET_STEP
    lines = list_lines(shown, PAGE_WIDTH - MARGIN - left)
    if beside in (1, 2) and sum(line.height for line in lines) <= row_height:
        for line in lines:
            last_row = line.draw(sheet, left, last_row)
    else:
        _draw_lists(sheet, shown, top)


def _inset_in_words(inset: Inset, shown: SheetInput) -> str:
    u, v = inset.place
    place = f"({u:.0f}, {v:.0f}), {inset.zoom} times"
    if inset.has_line:
        return f"{place}, with the line"
    if inset.is_raised:
        return f"{place}, contrast raised"
    if inset.has_band:
        return f"{inset.zoom} times; 95 %: ±{float(shown.tre95_m.max()) * 1e3:.2f} mm"
    if shown.metres_per_px is None:
        return place
    return f"{place}, {INSET_PX // inset.zoom * shown.metres_per_px * 1e3:.1f} mm across"


# ---- the lists ----


@dataclass(frozen=True)
class _Line:
    """A line of a list, how far it is indented, and the room above it [px of the page]."""

    words: str
    style: paper.Style = BODY
    indent: float = 0
    above: float = 0

    @property
    def height(self) -> float:
        return self.style.line_height + self.above

    def draw(self, sheet: Paper, left: float, top: float) -> float:
        """Write it; returns where the next line begins."""
        sheet.text(left + self.indent, top + self.above, self.words, self.style)
        return top + self.height


def _draw_lists(sheet: Paper, shown: SheetInput, top: float) -> float:
    """The findings and the other ink, over the whole width."""
    for line in list_lines(shown, CONTENT_WIDTH):
        # A heading does not stand alone at the foot of a page.
        needed = line.height if line.style is BODY else line.height + BODY.line_height
        top = _room(sheet, top, needed)
        top = line.draw(sheet, MARGIN, top)
    return top


def list_lines(shown: SheetInput, width: float) -> list[_Line]:
    """The findings and the other ink, line by line."""
    return [*_finding_lines(shown, width), *_account_lines(shown, width)]


def _finding_lines(shown: SheetInput, width: float) -> list[_Line]:
    if not shown.findings:
        return [_Line("Findings: none", HEADING)]
    lines = [_Line("Findings", HEADING)]
    for number, finding in enumerate(shown.findings, 1):
        kind = "wants an answer" if finding.is_open else finding.severity
        head = f"F{number}  {kind}: {finding.code}"
        if finding.place_px is not None:
            head += f", at ({finding.place_px[0]:.0f}, {finding.place_px[1]:.0f})"
        style = STRONG if finding.is_open else BODY
        lines.append(_Line(paper.shortened(head, width, style), style, above=6))
        words = finding.text
        if finding.answered_by is not None:
            words += f" Answered by {finding.answered_by}, {finding.answered_utc}."
        for line in paper.wrapped(words, width - 30, BODY):
            lines.append(_Line(line, indent=30))
    return lines


def _account_lines(shown: SheetInput, width: float) -> list[_Line]:
    """The ink in the pen's colour that was not taken."""
    if shown.rgb is None:
        return []
    if shown.account is None:
        return [_Line("Other ink: not kept in the bundle", HEADING, above=20)]
    if not shown.account:
        return [_Line("Other ink in the pen's colour: none", HEADING, above=20)]
    lines = [_Line("Other ink in the pen's colour", HEADING, above=20)]
    for entry in shown.account[:LISTED_ENTRIES]:
        what = f"{entry.what}, " if entry.what else ""
        words = (
            f"{entry.number}: {what}{entry.pixels} px ({entry.share:.1%}) at "
            f"({entry.u:.0f}, {entry.v:.0f})"
        )
        lines.append(_Line(paper.shortened(words, width, BODY)))
    rest = shown.account[LISTED_ENTRIES:]
    if rest:
        pixels = sum(entry.pixels for entry in rest)
        lines.append(_Line(f"and {len(rest)} smaller, {pixels} px together"))
    return lines


def _png(pixels: NDArray[np.uint8]) -> bytes:
    """A PNG file (ISO/IEC 15948) with its size in print.

    Each row is stored as its difference from the row above (filter "Up"): most of a sheet repeats
    the row above, so this takes half the time of OpenCV's encoder.
    """
    height, width, _ = pixels.shape
    rows = pixels.reshape(height, -1)
    filtered = np.empty((height, 1 + rows.shape[1]), np.uint8)
    filtered[:, 0] = 2
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    per_metre = round(DPI / 0.0254)
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)),
        (b"IDAT", zlib.compress(filtered, level=1)),
        (b"IEND", b""),
    )
    parts = [b"\x89PNG\r\n\x1a\n"]
    for name, data in chunks:
        checksum = zlib.crc32(data, zlib.crc32(name))
        parts += [struct.pack(">I", len(data)), name, data, struct.pack(">I", checksum)]
    return b"".join(parts)
