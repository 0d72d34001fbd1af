"""Pages of paper to draw on, a record of what stands where, and places for captions.

All lengths are in pixels of the page. A page is A4 at 200 dots an inch, so that a sheet can be
printed at its own size; several pages stand one below the other in one picture. Lines and pictures
are drawn with OpenCV and letters with Pillow: importing either takes a tenth of what Matplotlib
takes.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.geometry.lines import Array
from vfplan.palette import BRIDGED, CLOUD, ERROR, PROXY, TIP, TUBE, WALL

Pixels = NDArray[np.uint8]
Colour = tuple[int, int, int]


def colour_of(hexadecimal: str) -> Colour:
    """(red, green, blue) of "#rrggbb"."""
    return tuple(bytes.fromhex(hexadecimal[1:]))


# Dots an inch in print.
DPI = 200

# Width of A4, 210 mm, in pixels.
PAGE_WIDTH = round(210 / 25.4 * DPI)

# Height of A4, 297 mm, in pixels.
PAGE_HEIGHT = round(297 / 25.4 * DPI)

# Width of the empty border of a page: 7.6 mm, which printers can print.
MARGIN = 60

CONTENT_WIDTH = PAGE_WIDTH - 2 * MARGIN

WHITE = colour_of("#ffffff")
BLACK = colour_of("#141414")
GREY = colour_of("#464646")

# What each colour means on every sheet.
LINE_COLOUR = colour_of(CLOUD)
BRIDGE_COLOUR = colour_of(BRIDGED)
BAND_COLOUR = colour_of(ERROR)
WALL_COLOUR = colour_of(WALL)
GUIDE_COLOUR = colour_of(TUBE)
TIP_COLOUR = colour_of(TIP)
PROXY_COLOUR = colour_of(PROXY)

# The marks around a name that is written by itself; see `vfplan.display.isolated`.
ISOLATES = re.compile("[\u2068\u2069]")

# Bits of a fraction in OpenCV's coordinates: they are whole numbers of 1/16 pixel.
SHIFT = 4


@dataclass(frozen=True)
class Box:
    """A rectangle on a page with its corner (x, y), and what stands in it.

    `kind` is "text", "picture" (a slice or a view) or "inset". For an inset `window` is
    (u, v, width, height) [px of the slice] and `zoom` the pixels of the page to one of the slice.
    A text has a `style` and a `colour`.
    """

    page: int
    x: float
    y: float
    width: float
    height: float
    kind: str
    words: str = ""
    window: tuple[int, int, int, int] | None = None
    zoom: int = 1
    style: Style | None = None
    colour: Colour = (0, 0, 0)

    @property
    def right(self) -> float:
        """The first column beyond it."""
        return self.x + self.width

    @property
    def bottom(self) -> float:
        """The first row beyond it."""
        return self.y + self.height


@dataclass(frozen=True)
class Style:
    """How letters look: height in points, and weight."""

    points: float
    bold: bool = False

    @property
    def line_height(self) -> int:
        """From one line of text to the next."""
        return round(1.35 * self.points * DPI / 72)

    @property
    def baseline(self) -> float:
        """From the top of a line to where its letters stand."""
        return 0.78 * self.line_height

    def width_of(self, words: str) -> float:
        """How long a line of text is."""
        font = _font(self.points, self.bold)
        return sum(font.getlength(part) for part in ISOLATES.split(words))


# Height of the letters [points] of all text but the headings; smaller was called too small.
BASE = 8.0

TITLE = Style(1.9 * BASE, bold=True)
HEADING = Style(1.2 * BASE, bold=True)
BODY = Style(BASE)
STRONG = Style(BASE, bold=True)

# Side [px of the page] of an inset, a place that is enlarged: 46 mm in print.
INSET_PX = 360

# Row at which the foot of a page begins; nothing else stands below it.
FOOT = PAGE_HEIGHT - MARGIN - BODY.line_height


class Paper:
    """Pages that are filled one after the other; `image()` is all of them."""

    def __init__(self) -> None:
        self.boxes: list[Box] = []
        self._pages: list[Pixels] = []
        self.add_page()

    def add_page(self) -> None:
        """Begin a new, white page; everything is drawn on the last one."""
        self._pages.append(np.full((PAGE_HEIGHT, PAGE_WIDTH, 3), 255, np.uint8))

    def space_for(self, y: float, height: float) -> float:
        """The row `y` if something of this height fits there, else the top of a new page."""
        if y + height <= FOOT - 6:
            return y
        self.add_page()
        return float(MARGIN)

    @property
    def page(self) -> int:
        """The number of the last page, from 0."""
        return len(self._pages) - 1

    @property
    def canvas(self) -> Pixels:
        """(PAGE_HEIGHT, PAGE_WIDTH, 3) the last page, red first."""
        return self._pages[-1]

    def text(
        self, x: float, y: float, words: str, style: Style = BODY, colour: Colour = BLACK,
        page: int = -1,
    ) -> None:  # fmt: skip
        """Write one line of text; on the last page unless another is named."""
        words, page = printable(words), page % len(self._pages)
        size = style.width_of(words), style.line_height
        self.boxes.append(Box(page, x, y, *size, "text", words, style=style, colour=colour))

    def paragraph(
        self, x: float, y: float, words: str, width: float, style: Style = BODY,
        colour: Colour = BLACK,
    ) -> float:  # fmt: skip
        """Write text in lines of at most this width; returns where the next line begins."""
        for line in wrapped(words, width, style):
            self.text(x, y, line, style, colour)
            y += style.line_height
        return y

    def picture(self, x: int, y: int, rgb: Pixels, **box: Any) -> Box:
        """Lay a picture on the page, pixel by pixel, with a frame wholly outside of it."""
        height, width = rgb.shape[:2]
        self.canvas[y - 2 : y + height + 2, x - 2 : x + width + 2] = BLACK
        self.canvas[y : y + height, x : x + width] = rgb
        placed = Box(self.page, x, y, width, height, **{"kind": "picture", **box})
        self.boxes.append(placed)
        return placed

    def image(self) -> Pixels:
        """(pages * PAGE_HEIGHT, PAGE_WIDTH, 3) all pages, red first."""
        from PIL import Image, ImageDraw

        pages = [Image.fromarray(canvas) for canvas in self._pages]
        for box in self.boxes:
            if box.style is not None:
                x, y = round(box.x), round(box.y) + box.style.baseline
                font = _font(box.style.points, box.style.bold)
                draw = ImageDraw.Draw(pages[box.page])
                # Each isolated name by itself, as wide as it was taken to be.
                for part in ISOLATES.split(box.words):
                    draw.text((round(x), y), part, fill=box.colour, font=font, anchor="ls")
                    x += font.getlength(part)
        return np.vstack([np.asarray(page) for page in pages])


def wrapped(words: str, width: float, style: Style) -> list[str]:
    """The lines that a text takes; a word longer than a line is broken."""
    if style.width_of(printable(words)) <= width:
        return [printable(words)]
    lines = [""]
    # A no-break space is no end of a word.
    for word in map(printable, words.split(" ")):
        if style.width_of(f"{lines[-1]} {word}".strip()) <= width:
            lines[-1] = f"{lines[-1]} {word}".strip()
            continue
        lines.append("")
        for letter in word:
            if lines[-1] and style.width_of(lines[-1] + letter) > width:
                lines.append("")
            lines[-1] += letter
    return [line for line in lines if line]


def shortened(words: str, width: float, style: Style) -> str:
    """The text, cut with an ellipsis in its middle if it is longer than this width."""
    words = shown = printable(words)
    kept = len(words)
    while kept and style.width_of(shown) > width:
        kept -= 1
        shown = f"{words[: (kept + 1) // 2]}…{words[len(words) - kept // 2 :]}"
    return shown


def printable(words: str) -> str:
    """The text in one line, without characters that cannot be seen: labels come from files.

    A letter that the font lacks becomes its code, such as [U+6A19]. The marks around an isolated
    name are kept; they are not drawn.
    """
    return "".join(c if ISOLATES.match(c) else _drawn(c) for c in words)


@cache
def _drawn(letter: str) -> str:
    if unicodedata.category(letter)[0] in "CZ":
        return " "
    # A font draws the same box for all that it lacks, and U+FFFF is no letter.
    seen, lacking = (bytes(_font(BASE, True).getmask(c)) for c in (letter, "\uffff"))
    return f"[U+{ord(letter):04X}]" if seen == lacking else letter


@cache
def _font(points: float, bold: bool) -> Any:
    """DejaVu Sans, which comes with Matplotlib and has nearly every alphabet's letters."""
    from PIL import ImageFont

    place = Path(find_spec("matplotlib").submodule_search_locations[0])
    file = place / f"mpl-data/fonts/ttf/DejaVuSans{'-Bold' * bold}.ttf"
    return ImageFont.truetype(file, points * DPI / 72)


def fixed_point(points: Array) -> NDArray[np.int32]:
    """Points on a page as OpenCV's drawing functions take them with `SHIFT`."""
    return np.rint(np.multiply(points, 1 << SHIFT)).astype(np.int32)


def draw_line(
    canvas: Pixels, points: Array, colour: Any, thickness: int, closed: bool = False
) -> None:
    """Draw a line along (N, 2) points with smooth edges."""
    cv2.polylines(canvas, [fixed_point(points)], closed, colour, thickness, cv2.LINE_AA, SHIFT)


def draw_cased(
    canvas: Pixels, points: Array, colour: Colour, thickness: int, closed: bool = False
) -> None:
    """Draw a line with a white edge on either side, which shows on dark and on light ground."""
    draw_line(canvas, points, WHITE, thickness + 3, closed)
    draw_line(canvas, points, colour, thickness, closed)


# Length of an arrow's head [px of the page].
ARROW_HEAD = 14.0


def draw_arrow(canvas: Pixels, start: Array, tip: Array, colour: Colour) -> None:
    """Draw a cased arrow; none that is shorter than a pixel."""
    length = float(np.hypot(*(tip - start)))
    if length >= 1:
        head = min(ARROW_HEAD, length) / length
        for shade, thickness in ((WHITE, 7), (colour, 3)):
            ends = fixed_point(np.array([start, tip])).tolist()
            cv2.arrowedLine(canvas, *ends, shade, thickness, cv2.LINE_AA, SHIFT, head)


def draw_disc(canvas: Pixels, centre: Any, radius: float, colour: Any, thickness: int = -1) -> None:
    """Draw a disc, or a ring if a thickness is given."""
    place, size = fixed_point(centre).tolist(), round(radius * (1 << SHIFT))
    cv2.circle(canvas, place, size, colour, thickness, cv2.LINE_AA, SHIFT)


def contours_of(mask: Pixels) -> list[NDArray[np.int32]]:
    """The outlines of what is brighter than 127, inner ones too."""
    return cv2.findContours((mask > 127).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]


def draw_bound(canvas: Pixels, points: Array, distance: Array, closed: bool) -> None:
    """Draw, in dashes, around what lies within (M,) distances of a line (M, 2) [px of the page]."""
    within = np.zeros(canvas.shape[:2], np.uint8)
    for k in range(len(points)):
        draw_disc(within, points[k], distance[k], 255)
        if k or closed:
            thickness = max(1, round(distance[k] + distance[k - 1]))
            draw_line(within, points[[k - 1, k]], 255, thickness)
    size = np.array(within.shape[::-1])
    for contour in contours_of(within):
        outline = contour[:, 0]
        inner = ((outline > 0) & (outline < size - 1)).all(axis=1)
        for start in range(0, len(outline), 22):
            dash = outline[start : start + 14][inner[start : start + 14]]
            if len(dash) > 1:
                draw_line(canvas, dash, BAND_COLOUR, 2)


# Distance [px of the page] from one place that is tried for a caption to the next.
STEP = BODY.line_height // 3

# Length [px of the page] of a leader at most: one of twelve lines of text is hard to follow.
REACH = 12 * BODY.line_height

# Distance [px of the page] from a point to its caption, at least.
NEAREST = BODY.line_height // 2

# Length [px of the page] around its point that a leader does not cover.
LEADER_GAP = 0.4 * BODY.line_height

# By how much [px of the page] a leader may be longer for a pixel less on what is to be kept clear.
PIXEL_CROSSED = 4.0

# Cost [px of the page] of a pixel that no caption may cover: more than any other place has.
COVERED = 1e6

# By how much [px of the page] a leader may be longer for one row less on what is better left clear.
ROW_COVERED = 5.0

# Distance [px of the page] between two captions, and from a caption to the picture's edge.
CLEARANCE = BODY.line_height // 8


def place_for_caption(
    taken: Pixels, shunned: Pixels, point: Array, width: int, height: int
) -> tuple[int, int, Array] | None:
    """A place for a caption of this size close to a point (x, y); `None` if there is none.

    It takes the closest place inside the picture where nothing is taken: no other caption, and
    nothing that has to stay visible. A place counts as farther away if it or its leader covers
    what is better left clear.

    Parameters
    ----------
    taken
        (H, W), 1 where no caption may cover the picture, 254 where a leader is better not, and 255
        where none may be. The place and its leader are entered there.
    shunned
        (H, W), 1 where a caption or a leader is better not.

    Returns
    -------
    tuple or None
        Its corner x, y, and the leader (2, 2) from the point to its edge.
    """
    size, extent = np.array(taken.shape[::-1]), np.array([width, height])
    (right, lowest), first = size - extent - CLEARANCE, CLEARANCE
    y, x = np.mgrid[first:lowest:STEP, first:right:STEP].reshape(2, -1)
    corners = np.column_stack([x, y])
    targets = np.clip(point, corners, corners + extent)
    lengths = np.hypot(*(targets - point).T)
    # Of two that are as close, the one whose middle is closer.
    costs = lengths + 0.1 * np.hypot(*(corners + extent / 2 - point).T)
    weights = np.where(taken > 0, COVERED, shunned * ROW_COVERED / height)
    sums = cv2.boxFilter(weights, -1, extent.tolist(), anchor=(0, 0), normalize=False)
    costs += sums[y, x]
    tried = np.flatnonzero((costs < COVERED) & (lengths >= NEAREST) & (lengths <= REACH))
    best, found = np.inf, None
    for number in tried[np.argsort(costs[tried])].tolist():
        if costs[number] >= best:
            break
        start = point + (targets[number] - point) * LEADER_GAP / lengths[number]
        way = np.linspace(start, targets[number], int(lengths[number])).clip(0, size - 1)
        leader = tuple(way.astype(int).T[::-1])
        crossed = np.count_nonzero((taken[leader] > 1) | (shunned[leader] > 0))
        cost = costs[number] + PIXEL_CROSSED * crossed
        if cost < best and (taken[leader] < 255).all():
            best, found = cost, (number, leader, start)
    if found is None:
        return None
    number, leader, start = found
    left, top = corners[number].tolist()
    taken[leader] = 255
    around = slice(top - CLEARANCE, top + height + CLEARANCE)
    taken[around, left - CLEARANCE : left + width + CLEARANCE] = 255
    return left, top, np.array([start, targets[number]])
