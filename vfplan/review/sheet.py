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

import numpy as np
from numpy.typing import NDArray

from vfplan.images.read import as_uint8
from vfplan.io.writing import write_whole
from vfplan.review import paper
from vfplan.review.insets import (
    INSET_STEP,
    INSETS_IN_A_ROW,
    ROW_HEIGHT,
    draw_insets,
    insets_of,
)
from vfplan.review.paper import (
    BLACK,
    BODY,
    CONTENT_WIDTH,
    DPI,
    FOOT,
    GREY,
    MARGIN,
    PAGE_HEIGHT,
    PAGE_WIDTH,
    TITLE,
    WHITE,
    Box,
    Paper,
)
from vfplan.review.picture import COLUMN_WIDTH, draw_picture
from vfplan.review.sheet_input import SheetInput
from vfplan.review.sheet_text import draw_facts, draw_lists, list_lines, total_height
from vfplan.review.views import draw_views

COLUMN_X = PAGE_WIDTH - MARGIN - COLUMN_WIDTH
"""Where the column of facts begins, beside the picture [px of the page]."""


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
        lines = len(paper.wrapped(content.verdict, CONTENT_WIDTH - 32, TITLE))
        bar = slice(MARGIN - 10, MARGIN + lines * TITLE.line_height + 10)
        sheet.canvas[bar, MARGIN : PAGE_WIDTH - MARGIN] = BLACK
        y = sheet.paragraph(MARGIN + 16, y, content.verdict, CONTENT_WIDTH - 32, TITLE, WHITE)
        y += 12
    else:
        y = sheet.paragraph(MARGIN, y, content.verdict, CONTENT_WIDTH, TITLE)
    words = f"Review sheet of {content.title}."
    if content.side is not None:
        words += f" The slice is seen from {content.side}."
    y = sheet.paragraph(MARGIN, y + 4, words, CONTENT_WIDTH, BODY, GREY) + 14
    if content.rgb is None:
        free_x, free_y, y = draw_views(sheet, content, y)
        draw_facts(sheet, content, free_x, free_y, PAGE_WIDTH - MARGIN - free_x)
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
        lines = list_lines(content, PAGE_WIDTH - MARGIN - x)
        height_below = total_height(list_lines(content, CONTENT_WIDTH))
        is_beside = in_last_row > 0 and total_height(lines) <= ROW_HEIGHT
        if is_beside and not sheet.has_space(y, height_below):
            for line in lines:
                last_row = line.draw(sheet, x, last_row)
        else:
            draw_lists(sheet, content, y)
    # The digest on every page, and which page of how many it is.
    for page in range(sheet.page + 1):
        number = f"page {page + 1} of {sheet.page + 1}"
        sheet.text(MARGIN, FOOT, f"digest {content.digest}", BODY, page=page)
        x = PAGE_WIDTH - MARGIN - BODY.width_of(number)
        sheet.text(x, FOOT, number, BODY, GREY, page=page)
    return Sheet(sheet.image(), tuple(sheet.boxes))


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
