"""The review sheet: one picture on which a person sees whether a plan is right.

From top to bottom: the verdict; the slice in its true greys with the ink visible; both ends of
each line and every bridge enlarged; the findings; the other ink. A grey box that hides the end of
a line leaves no trace in the ink, so no program can tell. An eye can, if it sees the end enlarged
and nothing is drawn over it. That is what this sheet is for.

So nothing is drawn on an inset of an end or of a bridge. A pixel of the slice is a square of 8 x 8
equal pixels, in the slice's own greys; what the square shows is what the file holds. The middle of
an inset is marked by four small triangles outside of its frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.fixture import Stroke
from vfplan.geometry.lines import arc_lengths, runs
from vfplan.images.read import as_uint8
from vfplan.io.writing import write_whole
from vfplan.review import paper
from vfplan.review.paper import BLACK, BODY, GREY, HEADING, INSET_PX, MARGIN, STRONG, Box, Paper
from vfplan.review.picture import COLUMN_WIDTH, draw_picture, draw_rendered, draw_views
from vfplan.review.rendered import described, kind_of
from vfplan.review.sheet_input import WORDS_OF_ENTRY, LineEnd, SheetInput, ends_of

# Pixels of the page to one of the slice in an inset.
ZOOM = 8

# The same in the wider view of an end.
WIDER_ZOOM = ZOOM // 2

# Side [px of the slice] of what an inset shows.
SHOWN_PX = INSET_PX // ZOOM

# Radius [px of the slice] of the disc ahead of an end whose greys are compared: a box that covers
# an end is larger than that.
AHEAD_PX = 10.0

# Range of greys, of 256, within which a ground counts as even; noise of a CT spans more.
ONE_GREY = 2

INSETS_IN_A_ROW = paper.CONTENT_WIDTH // INSET_PX
INSET_STEP = (paper.CONTENT_WIDTH - INSET_PX) / (INSETS_IN_A_ROW - 1)
CAPTION_HEIGHT = 3 * BODY.line_height + BODY.line_height // 2
ROW_HEIGHT = CAPTION_HEIGHT + INSET_PX + BODY.line_height


# Entries of the account that are listed; the others are summed up.
LISTED_ENTRIES = 12

WHAT_TO_LOOK_FOR = (
    "Does the line stop there, or does a box or a label hide the rest of it? If it goes on, "
    "draw the rest with vfplan review."
)


@dataclass(frozen=True)
class TextLine:
    """A line of a list, its indent, and the space above it [px of the page].

    `is_head` is true where the next line belongs to this one: both stand on one page.
    """

    words: str
    style: paper.Style = BODY
    indent: float = 0
    above: float = 0
    is_head: bool = False

    @property
    def height(self) -> float:
        """The space that it takes [px of the page]."""
        return self.style.line_height + self.above

    def draw(self, sheet: Paper, x: float, y: float) -> float:
        """Write it; returns where the next line begins."""
        sheet.text(x + self.indent, y + self.above, self.words, self.style)
        return y + self.height


def total_height(lines: Iterable[TextLine]) -> float:
    """The space that lines take one below the other [px of the page]."""
    return sum(line.height for line in lines)


def draw_facts(sheet: Paper, content: SheetInput, x: float, y: float, width: float) -> float:
    """What to look for at the ends, and the numbers of the plan.

    Where there is room, a number stands beside its heading.
    """
    facts = []
    if content.rgb is not None:
        facts = _facts_of_ends(content)
    for heading, words in (*facts, *content.facts):
        y = sheet.space_for(y, HEADING.line_height + BODY.line_height)
        sheet.text(x, y, heading, HEADING)
        heading_width = HEADING.width_of(f"{heading}  ")
        if heading_width + BODY.width_of(words) <= width:
            sheet.text(x + heading_width, y + HEADING.baseline - BODY.baseline, words)
            y += HEADING.line_height + 10
        else:
            y = sheet.paragraph(x, y + HEADING.line_height, words, width) + 10
    return y


def _facts_of_ends(content: SheetInput) -> list[tuple[str, str]]:
    """What to look for at an end, and at which end a cover would not show."""
    facts = []
    for number, stroke in enumerate(content.strokes, 1):
        for end in ends_of(stroke):
            if end.direction is None:
                continue
            if not facts:
                facts.append(("Look at each end", WHAT_TO_LOOK_FOR))
            grey = grey_ahead(content, stroke, end)
            if grey is None:
                continue
            name = end.name if len(content.strokes) == 1 else f"{end.name} of line {number}"
            words = (
                f"All pixels ahead of the {name} have one grey, {grey} of 255. A cover of that "
                "grey has no border that could be seen. Compare with the slice before it was "
                "drawn on."
            )
            facts.append((f"One grey ahead of the {end.name}", words))
    return facts


def draw_lists(sheet: Paper, content: SheetInput, y: float) -> float:
    """The findings and the other ink, over the whole width."""
    lines = list_lines(content, paper.CONTENT_WIDTH)
    for number, line in enumerate(lines):
        # A heading does not stand alone at the foot of a page.
        together = number
        while lines[together].is_head:
            together += 1
        y = sheet.space_for(y, total_height(lines[number : together + 1]))
        y = line.draw(sheet, MARGIN, y)
    return y


def list_lines(content: SheetInput, width: float) -> list[TextLine]:
    """The findings and the other ink, line by line."""
    lines = []
    if content.fixture is not None and content.fixture.rendering is not None:
        heading = f"The robot renders a {kind_of(content.fixture)}"
        lines = text_lines(heading, width, HEADING, is_head=True)
        for heading, words in described(content.fixture):
            lines += text_lines(f"{heading}: {words}", width, BODY)
    heading = "Findings"
    if not content.findings:
        heading = "Findings: none"
    above = 20 if lines else 0
    lines += text_lines(heading, width, HEADING, above=above, is_head=bool(content.findings))
    for number, finding in enumerate(content.findings, 1):
        kind, style = ("wants an answer", STRONG) if finding.is_open else (finding.severity, BODY)
        head = f"F{number}  {kind}: {finding.code}"
        if finding.place_px is not None:
            head += f", at ({finding.place_px[0]:.0f}, {finding.place_px[1]:.0f})"
        lines += text_lines(head, width, style, above=6, is_head=True)
        words = finding.text
        if finding.answered_by is not None:
            words += f" Answered by {finding.answered_by}, {finding.answered_utc}."
        lines += text_lines(words, width, BODY, indent=30)
    if content.rgb is None:
        return lines
    account = content.account
    heading = f"Other ink in the pen's colour{'' if account else ': none'}"
    lines += text_lines(heading, width, HEADING, above=20, is_head=bool(account))
    for entry in account[:LISTED_ENTRIES]:
        what = ""
        if entry.what != "ink":
            what = WORDS_OF_ENTRY[entry.what] + ", "
        words = (
            f"{entry.number}: {what}{entry.pixels} px ({entry.share:.1%}) at ({entry.u:.0f}, "
            f"{entry.v:.0f})"
        )
        lines += text_lines(words, width, BODY)
    smaller = account[LISTED_ENTRIES:]
    if smaller:
        pixels = sum(entry.pixels for entry in smaller)
        lines += text_lines(f"and {len(smaller)} smaller, {pixels} px together", width, BODY)
    return lines


def text_lines(
    words: str, width: float, style: paper.Style, *, indent: float = 0, above: float = 0,
    is_head: bool = False,
) -> list[TextLine]:  # fmt: skip
    """A text in lines of at most this width; the first has the space above it."""
    lines = paper.wrapped(words, width - indent, style)
    return [
        TextLine(line, style, indent, 0 if number else above, is_head)
        for number, line in enumerate(lines)
    ]


@dataclass(frozen=True, eq=False)
class Inset:
    """A place that is enlarged: its caption, its middle (u, v), and how it is drawn.

    `is_raised` spreads the greys, `has_line` draws the line, `has_band` the line and its bands.
    `note` stands in the caption in place of the size.
    """

    caption: str
    place: paper.Array
    zoom: int = ZOOM
    is_raised: bool = False
    has_line: bool = False
    has_band: bool = False
    note: str = ""

    @property
    def window(self) -> tuple[int, int, int, int]:
        """(u, v, width, height): the part of the slice that is enlarged."""
        size = INSET_PX // self.zoom
        u, v = np.floor(self.place + 0.5).astype(int).tolist()
        return u - size // 2, v - size // 2, size, size


def grey_ahead(content: SheetInput, stroke: Stroke, end: LineEnd) -> int | None:
    """The one grey, 0 to 255, of all pixels ahead of an end; `None` if there are several.

    A cover of the grey that surrounds it leaves no border. A person who knows that the ground is
    even can compare the slice with the one that was not drawn on.
    """
    if end.direction is None or stroke.sigma is None:
        return None
    rgb = as_uint8(content.rgb)
    half_width = (stroke.width or 0.0) / 2
    # The blur of the pen's own end reaches two pixels.
    centre = end.place + end.direction * (half_width + 2.0 + AHEAD_PX)
    low = np.maximum(np.floor(centre - AHEAD_PX).astype(int), 0)
    high = np.ceil(centre + AHEAD_PX).astype(int) + 1
    part = rgb[low[1] : high[1], low[0] : high[0]]
    rows, columns = np.mgrid[low[1] : low[1] + part.shape[0], low[0] : low[0] + part.shape[1]]
    inside = np.hypot(columns - centre[0], rows - centre[1]) <= AHEAD_PX
    colours = part[inside].astype(int)
    if len(colours) == 0 or np.ptp(colours) > ONE_GREY:
        return None
    return int(np.median(colours))


def insets_of(content: SheetInput) -> list[Inset]:
    """What the sheet enlarges, in the order in which it stands there."""
    insets = []
    is_single = len(content.strokes) == 1
    for number, stroke in enumerate(content.strokes, 1):
        name = "the line"
        if not is_single:
            name = f"line {number}"
        for end in ends_of(stroke):
            caption = f"{end.name.capitalize()} of {name}"
            is_even = grey_ahead(content, stroke, end) is not None
            insets.append(
                Inset(caption, end.place, note="one grey ahead: look twice" if is_even else "")
            )
            # A line without ink hides nothing, and the line itself has to be visible.
            has_line = stroke.sigma is None
            wider = f"{caption}, wider"
            insets.append(Inset(wider, end.place, WIDER_ZOOM, is_raised=True, has_line=has_line))
    for number, stroke in enumerate(content.strokes, 1):
        of_line = ""
        if not is_single:
            of_line = f" of line {number}"
        # One inset a bridge, or several along a long one.
        for count, run in enumerate(runs(stroke.bridged, stroke.closed), 1):
            points = stroke.points[run]
            along = arc_lengths(points, False)
            parts = max(1, int(np.ceil(along[-1] / (0.75 * SHOWN_PX))))
            for part in range(parts):
                place = points[np.searchsorted(along, along[-1] * (part + 0.5) / parts)]
                caption = f"Bridge {count}{of_line}, {along[-1]:.0f} px"
                if parts > 1:
                    caption += f", part {part + 1} of {parts}"
                insets.append(Inset(caption, place))
    for entry in content.account:
        place = np.array([entry.u, entry.v])
        if entry.what != "ink" and not _is_enlarged(place, insets):
            insets.append(Inset(f"{entry.number}: {WORDS_OF_ENTRY[entry.what]}", place))
    for number, finding in enumerate(content.findings, 1):
        if finding.place_px is not None and not _is_enlarged(finding.place_px, insets):
            insets.append(Inset(f"F{number}: {finding.code}", np.array(finding.place_px)))
    if content.metres_per_px is not None and (content.tre95_m is not None or content.outlines):
        # Where the registration's error may be largest, enlarged so that all of it fits in.
        points = np.concatenate([stroke.points for stroke in content.strokes])
        bound_m = np.zeros(1) if content.tre95_m is None else content.tre95_m
        worst = int(np.argmax(bound_m))
        half_m = max(bound_m[worst], content.margin_m or 0.0, reach_of(content))
        zoom = ZOOM
        while zoom > 1 and half_m / content.metres_per_px * zoom > 0.4 * INSET_PX:
            zoom //= 2
        insets.append(Inset("Error and outline, true scale", points[worst], zoom, has_band=True))
    return insets


def reach_of(content: SheetInput) -> float:
    """How far from the line the robot pushes [m]; 0 where it renders nothing."""
    if not content.outlines:
        return 0.0
    guidance, rendering = content.fixture.guidance, content.fixture.rendering
    if guidance is not None:
        return guidance.radius
    return rendering.contact_radius + rendering.point_radius


def _is_enlarged(place: paper.Array | tuple[float, float], insets: list[Inset]) -> bool:
    return any(
        inset.zoom == ZOOM and np.abs(inset.place - place).max() <= SHOWN_PX // 3
        for inset in insets
    )


def draw_insets(
    sheet: Paper, insets: list[Inset], rgb: NDArray[np.uint8], content: SheetInput, y: float
) -> tuple[float, float]:
    """Draw rows of insets; a row that does not fit begins a new page.

    Returns the top of the last row, and where the next thing below begins.
    """
    last_row = y
    for first in range(0, len(insets), INSETS_IN_A_ROW):
        y = sheet.space_for(y, ROW_HEIGHT)
        last_row = y
        for k, inset in enumerate(insets[first : first + INSETS_IN_A_ROW]):
            x = round(MARGIN + k * INSET_STEP)
            for line, words in enumerate((inset.caption, *_described(inset, content))):
                style = STRONG
                if line:
                    style = BODY
                shown = paper.shortened(words, INSET_PX, style)
                sheet.text(x, y + line * BODY.line_height, shown, style)
            draw_inset(sheet, inset, rgb, content, x, round(y + CAPTION_HEIGHT))
        y += ROW_HEIGHT
    return last_row, y


def _described(inset: Inset, content: SheetInput) -> tuple[str, str]:
    """How much an inset enlarges and where it lies, and what is to be known of it."""
    u, v = inset.place
    where = f"enlarged {inset.zoom} times, at ({u:.0f}, {v:.0f})"
    if inset.note:
        return where, inset.note
    if inset.has_line:
        return where, "with the line drawn"
    if inset.is_raised:
        return where, "contrast raised"
    if inset.has_band and content.tre95_m is None:
        return where, "what the robot renders"
    if inset.has_band:
        return where, f"95 %: ±{float(content.tre95_m.max()) * 1e3:.2f} mm"
    if content.metres_per_px is None:
        return where, f"{INSET_PX // inset.zoom} px across"
    return where, f"{INSET_PX // inset.zoom * content.metres_per_px * 1e3:.1f} mm across"


def draw_inset(
    sheet: Paper, inset: Inset, rgb: NDArray[np.uint8], content: SheetInput, x: int, y: int
) -> Box:
    """Draw an inset with its frame at a place of the page."""
    window = inset.window
    u, v, width, height = window
    pixels = np.full((height, width, 3), 255, np.uint8)
    is_outside = np.ones((height, width), bool)
    first_u, first_v = max(u, 0), max(v, 0)
    last_u, last_v = min(u + width, rgb.shape[1]), min(v + height, rgb.shape[0])
    if first_u < last_u and first_v < last_v:
        place = slice(first_v - v, last_v - v), slice(first_u - u, last_u - u)
        pixels[place] = rgb[first_v:last_v, first_u:last_u]
        is_outside[place] = False
    if inset.is_raised:
        pixels = _spread(pixels, is_outside)
    enlarged, outside = (
        picture.repeat(inset.zoom, axis=0).repeat(inset.zoom, axis=1)
        for picture in (pixels, is_outside)
    )
    # What lies outside of the slice is striped, so that nobody takes it for black or white there.
    rows, columns = np.nonzero(outside)
    is_stripe = (rows + columns) % 16 < 2
    enlarged[rows[is_stripe], columns[is_stripe]] = GREY
    if inset.has_line:
        for stroke in content.strokes:
            paper.draw_cased(
                enlarged, _within(inset, stroke.points), paper.LINE_COLOUR, 2, stroke.closed
            )
    if inset.has_band:
        _draw_band(enlarged, inset, content)
    size = enlarged.shape[0]
    box = sheet.picture(
        x, y, enlarged, kind="inset", words=inset.caption, window=window, zoom=inset.zoom
    )
    sheet.frame(box)
    middle = np.array([x + size / 2, y + size / 2])
    for direction in ((0, -1), (0, 1), (-1, 0), (1, 0)):
        tip = middle + (size / 2 + 3) * np.array(direction)
        base = tip + 9 * np.array(direction)
        across = 6 * np.array(direction[::-1])
        corners = paper.fixed_point(np.array([tip, base + across, base - across]))
        cv2.fillConvexPoly(sheet.canvas, corners, BLACK, cv2.LINE_AA, paper.SHIFT)
    return box


def _within(inset: Inset, points: paper.Array) -> paper.Array:
    """(M, 2) places of the slice in an inset [px of the page]."""
    u, v, _, _ = inset.window
    return (points - (u, v) + 0.5) * inset.zoom - 0.5


def _spread(pixels: NDArray[np.uint8], is_outside: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The same picture with its greys spread evenly from black to white; ink keeps its hue.

    Each grey becomes as bright as the share of pixels that are darker, and half of those that are
    as dark (histogram equalisation). So greys that differ by one are told apart, and a box of one
    grey stands out of the noise around it.
    """
    grey = pixels.min(axis=2)
    inside = grey[~is_outside]
    if inside.size == 0:
        return pixels
    count = np.bincount(inside, minlength=256)
    brightness = np.rint(255 * (count.cumsum() - count / 2) / inside.size)
    shift = brightness[grey].astype(np.int16) - grey
    return np.clip(pixels + shift[:, :, None], 0, 255).astype(np.uint8)


def _draw_band(enlarged: NDArray[np.uint8], inset: Inset, content: SheetInput) -> None:
    """Draw the line, the 95 % band and the margin at true scale, over a paler slice."""
    enlarged[:] = 128 + enlarged // 2
    to_page = inset.zoom / content.metres_per_px
    for outline in content.outlines:
        draw_rendered(enlarged, outline, lambda points: _within(inset, points), ())
    if content.tre95_m is None:
        for stroke in content.strokes:
            points = _within(inset, stroke.points)
            paper.draw_line(enlarged, points, paper.LINE_COLOUR, 2, stroke.closed)
    for stroke, is_bound, half_m in content.bands():
        points = _within(inset, stroke.points)
        paper.draw_distance(enlarged, points, half_m * to_page, stroke.closed, is_bound)
        if is_bound and stroke.is_ordered:
            paper.draw_line(enlarged, points, paper.LINE_COLOUR, 2, stroke.closed)


# Where the column of facts begins, beside the picture [px of the page].
COLUMN_X = paper.PAGE_WIDTH - MARGIN - COLUMN_WIDTH


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
        count = len(self.pixels) // paper.PAGE_HEIGHT
        return [_png(page) for page in np.split(self.pixels, count)]


def write_sheet(content: SheetInput, path: Path) -> None:
    """Write the sheet as a PNG; raises `OutputError`."""
    write_whole(path, [draw_sheet(content).png()], overwrite=True)


def draw_sheet(content: SheetInput) -> Sheet:
    """Draw the sheet of what is to be reviewed."""
    sheet = Paper()
    # The verdict, in white on black where it is more than a look, and what is reviewed.
    y = float(MARGIN)
    if content.unanswered or content.missing_slice:
        lines = len(paper.wrapped(content.verdict, paper.CONTENT_WIDTH - 32, paper.TITLE))
        bar = slice(MARGIN - 10, MARGIN + lines * paper.TITLE.line_height + 10)
        sheet.canvas[bar, MARGIN : paper.PAGE_WIDTH - MARGIN] = BLACK
        y = sheet.paragraph(
            MARGIN + 16, y, content.verdict, paper.CONTENT_WIDTH - 32, paper.TITLE, paper.WHITE
        )
        y += 12
    else:
        y = sheet.paragraph(MARGIN, y, content.verdict, paper.CONTENT_WIDTH, paper.TITLE)
    words = f"Review sheet of {content.title}."
    if content.side is not None:
        words += f" The slice is seen from {content.side}."
    y = sheet.paragraph(MARGIN, y + 4, words, paper.CONTENT_WIDTH, BODY, GREY) + 14
    if content.rgb is None:
        free_x, free_y, y = draw_views(sheet, content, y)
        draw_facts(sheet, content, free_x, free_y, paper.PAGE_WIDTH - MARGIN - free_x)
        draw_lists(sheet, content, y)
    else:
        rgb = as_uint8(content.rgb)
        bottom, column_y = draw_picture(sheet, content, rgb, y, COLUMN_X, COLUMN_WIDTH)
        column_y = draw_facts(sheet, content, COLUMN_X, column_y + 10, COLUMN_WIDTH)
        insets = insets_of(content)
        last_row, y = draw_insets(sheet, insets, rgb, content, max(bottom, column_y) + 20)
        # Where the page ends below the insets, short lists stand in what the last row leaves free,
        # so that most sheets are one page.
        in_last_row = len(insets) % INSETS_IN_A_ROW
        x = MARGIN + in_last_row * INSET_STEP
        lines = list_lines(content, paper.PAGE_WIDTH - MARGIN - x)
        height_below = total_height(list_lines(content, paper.CONTENT_WIDTH))
        is_beside = in_last_row > 0 and total_height(lines) <= ROW_HEIGHT
        if is_beside and not sheet.has_space(y, height_below):
            for line in lines:
                last_row = line.draw(sheet, x, last_row)
        else:
            draw_lists(sheet, content, y)
    # The digest on every page, and which page of how many it is.
    for page in range(sheet.page + 1):
        number = f"page {page + 1} of {sheet.page + 1}"
        sheet.text(MARGIN, paper.FOOT, f"digest {content.digest}", BODY, page=page)
        x = paper.PAGE_WIDTH - MARGIN - BODY.width_of(number)
        sheet.text(x, paper.FOOT, number, BODY, GREY, page=page)
    return Sheet(sheet.image(), tuple(sheet.boxes))


def _png(pixels: NDArray[np.uint8]) -> bytes:
    """A PNG file with its size in print."""
    from PIL import Image

    file = BytesIO()
    Image.fromarray(pixels).save(file, "PNG", dpi=(paper.DPI, paper.DPI), compress_level=1)
    return file.getvalue()
