"""Pages of paper to draw on, and a record of what stands where.

All lengths are in pixels of the page. A page is A4 at 200 dots an inch, so that a sheet can be
printed at its own size; several pages stand one below the other in one picture. Lines and pictures
are drawn with OpenCV and letters with Pillow: importing either takes a tenth of what Matplotlib
takes.
"""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.palette import BRIDGED, CLOUD, HIP, PROXY

Colour = tuple[int, int, int]


def colour_of(hexadecimal: str) -> Colour:
    """(red, green, blue) of "#rrggbb"."""
    red, green, blue = (int(hexadecimal[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue


DPI = 200
PAGE_WIDTH = 1654  # A4 is 210 mm wide ...
PAGE_HEIGHT = 2339  # ... and 297 mm high
MARGIN = 60
CONTENT_WIDTH = PAGE_WIDTH - 2 * MARGIN

WHITE: Colour = (255, 255, 255)
BLACK: Colour = (20, 20, 20)
GREY: Colour = (110, 110, 110)
PALE: Colour = (225, 225, 225)

# What each colour means on every sheet.
LINE_COLOUR: Colour = colour_of(CLOUD)
BRIDGE_COLOUR: Colour = colour_of(BRIDGED)
MARGIN_COLOUR: Colour = colour_of(HIP)
BAND_COLOUR: Colour = colour_of(PROXY)

# OpenCV takes coordinates as whole numbers of 1/16 pixel.
SHIFT = 4


@dataclass(frozen=True)
class Box:
    """A rectangle on a page, and what stands in it.

    `kind` is "text", "picture" (a slice or a view) or "inset". For an inset `shows` is
    (u, v, width, height) [px of the slice] and `zoom` the pixels of the page to one of the slice.
    """

    page: int
    left: float
    top: float
    width: float
    height: float
    kind: str
    words: str = ""
    shows: tuple[int, int, int, int] | None = None
    zoom: int = 1

    @property
    def right(self) -> float:
        """The first column beyond it."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """The first row beyond it."""
        return self.top + self.height

    def overlaps(self, other: Box) -> bool:
        """Whether the two have a pixel in common."""
        return (
            self.page == other.page
            and self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )


@dataclass(frozen=True)
class Style:
    """How letters look: height in points, and weight."""

    points: float
    bold: bool = False

    @property
    def line_height(self) -> int:
        """From one line of text to the next."""
        return round(1.35 * self.points * DPI / 72)

    def width_of(self, words: str) -> float:
        """How long a line of text is."""
        return _font(self.points, self.bold).getlength(words)


TITLE = Style(15, bold=True)
HEADING = Style(9.5, bold=True)
BODY = Style(8)
STRONG = Style(8, bold=True)
SMALL = Style(7)
SMALL_BOLD = Style(7, bold=True)
TAG = Style(7.5, bold=True)


class Paper:
    """Pages that are filled one after the other; `image()` is all of them."""

    def __init__(self) -> None:
        self.boxes: list[Box] = []
        self._pages: list[NDArray[np.uint8]] = []
        self._texts: list[list[tuple[float, float, str, Style, Colour]]] = []
        self.add_page()

    def add_page(self) -> None:
        """Begin a new, white page; everything is drawn on the last one."""
        self._pages.append(np.full((PAGE_HEIGHT, PAGE_WIDTH, 3), 255, np.uint8))
        self._texts.append([])

    @property
    def page(self) -> int:
        """The number of the last page, from 0."""
        return len(self._pages) - 1

    @property
    def canvas(self) -> NDArray[np.uint8]:
        """(PAGE_HEIGHT, PAGE_WIDTH, 3) the last page, red first."""
        return self._pages[-1]

    def text(
        self,
        left: float,
        top: float,
        words: str,
        style: Style = BODY,
        colour: Colour = BLACK,
        *,
        page: int | None = None,
    ) -> Box:
        """Write one line of text."""
        shown = printable(words)
        number = self.page if page is None else page
        self._texts[number].append((left, top, shown, style, colour))
        box = Box(number, left, top, style.width_of(shown), style.line_height, "text", shown)
        self.boxes.append(box)
        return box

    def paragraph(
        self,
        left: float,
        top: float,
        words: str,
        width: float,
        style: Style = BODY,
        colour: Colour = BLACK,
    ) -> float:
        """Write text in lines of at most this width; returns where the next line begins."""
        for line in wrapped(words, width, style):
            self.text(left, top, line, style, colour)
            top += style.line_height
        return top

    def picture(self, left: int, top: int, rgb: NDArray[np.uint8], **box: Any) -> Box:
        """Lay a picture on the page, pixel by pixel."""
        height, width = rgb.shape[:2]
        self.canvas[top : top + height, left : left + width] = rgb
        placed = Box(self.page, left, top, width, height, **{"kind": "picture", **box})
        self.boxes.append(placed)
        return placed

    def frame(self, box: Box, colour: Colour = BLACK, thickness: int = 2) -> None:
        """Draw a frame round a box, wholly outside of it."""
        left, top = round(box.left) - thickness, round(box.top) - thickness
        right, bottom = round(box.right) + thickness, round(box.bottom) + thickness
        canvas = self._pages[box.page]
        canvas[top : top + thickness, left:right] = colour
        canvas[bottom - thickness : bottom, left:right] = colour
        canvas[top:bottom, left : left + thickness] = colour
        canvas[top:bottom, right - thickness : right] = colour

    def image(self) -> NDArray[np.uint8]:
        """(pages * PAGE_HEIGHT, PAGE_WIDTH, 3) all pages, red first."""
        for canvas, texts in zip(self._pages, self._texts, strict=True):
            for text in texts:
                _write(canvas, *text)
            texts.clear()
        return np.vstack(self._pages)


def _write(
    canvas: NDArray[np.uint8], left: float, top: float, words: str, style: Style, colour: Colour
) -> None:
    from PIL import Image, ImageDraw

    size = int(style.width_of(words)) + 2, style.line_height + 4
    letters = Image.new("L", size)
    font = _font(style.points, style.bold)
    at = (0, 0.78 * style.line_height)
    ImageDraw.Draw(letters).text(at, words, fill=255, font=font, anchor="ls")
    cover = np.asarray(letters)
    height, width = canvas.shape[:2]
    x, y = round(left), round(top)
    blend(canvas, cover[: max(0, height - y), : max(0, width - x)], colour, x, y)


def wrapped(words: str, width: float, style: Style) -> list[str]:
    """The lines that a text takes; a word longer than a line is broken."""
    lines = [""]
    for word in printable(words).split():
        longer = f"{lines[-1]} {word}".strip()
        if style.width_of(longer) <= width:
            lines[-1] = longer
            continue
        if lines[-1]:
            lines.append("")
        while style.width_of(word) > width:
            fitting = len(word)
            while fitting > 1 and style.width_of(word[:fitting]) > width:
                fitting -= 1
            lines[-1] = word[:fitting]
            lines.append("")
            word = word[fitting:]
        lines[-1] = word
    return lines


def shortened(words: str, width: float, style: Style) -> str:
    """The text, cut off with an ellipsis where it is longer than this width."""
    shown = printable(words)
    if style.width_of(shown) <= width:
        return shown
    while shown and style.width_of(shown + "…") > width:
        shown = shown[:-1]
    return shown + "…"


def printable(words: str) -> str:
    """The text in one line, without signs that are not to be seen: labels come from files."""
    return "".join(" " if unicodedata.category(sign)[0] in "CZ" else sign for sign in words)


@cache
def _font(points: float, bold: bool) -> Any:
    """DejaVu Sans, which comes with Matplotlib and has nearly every alphabet's letters."""
    from PIL import ImageFont

    place = Path(find_spec("matplotlib").submodule_search_locations[0])
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(place / "mpl-data/fonts/ttf" / name, points * DPI / 72)


def fixed_point(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """(N, 1, 2) points on a page as OpenCV's drawing functions take them with `SHIFT`."""
    return np.rint(np.reshape(points, (-1, 1, 2)) * (1 << SHIFT)).astype(np.int32)


def draw_line(
    canvas: NDArray[np.uint8],
    points: NDArray[np.float64],
    colour: Any,
    thickness: int,
    closed: bool = False,
) -> None:
    """Draw a line along (N, 2) points with smooth edges."""
    cv2.polylines(canvas, [fixed_point(points)], closed, colour, thickness, cv2.LINE_AA, SHIFT)


def draw_cased(
    canvas: NDArray[np.uint8],
    points: NDArray[np.float64],
    colour: Colour,
    thickness: int,
    closed: bool = False,
) -> None:
    """Draw a line with a white edge on either side, which shows on dark and on light ground."""
    draw_line(canvas, points, WHITE, thickness + 3, closed)
    draw_line(canvas, points, colour, thickness, closed)


def draw_disc(
    canvas: NDArray[np.uint8], centre: Any, radius: float, colour: Any, thickness: int = -1
) -> None:
    """Draw a disc, or a ring where a thickness is given."""
    at = tuple(int(x) for x in fixed_point(np.asarray(centre, dtype=float)).ravel())
    cv2.circle(canvas, at, round(radius * (1 << SHIFT)), colour, thickness, cv2.LINE_AA, SHIFT)


def blend(
    canvas: NDArray[np.uint8], cover: NDArray[np.uint8], colour: Colour, left: int, top: int
) -> None:
    """Lay a colour over part of a canvas as far as (H, W) `cover` says, 0 none to 255 wholly."""
    height, width = cover.shape
    part = canvas[top : top + height, left : left + width]
    rows, columns = np.nonzero(cover)
    share = cover[rows, columns, None].astype(np.float32) / 255
    under = part[rows, columns]
    part[rows, columns] = np.rint(under + share * (np.array(colour) - under)).astype(np.uint8)
