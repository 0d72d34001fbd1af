"""The review sheet: one picture on which a person sees whether a plan is right.

From top to bottom: the verdict; the slice in its true greys with the ink visible; both ends of
each line and every bridge enlarged; the findings; the other ink. A grey box that hides the end of
a line leaves no trace in the ink, so no program can tell. An eye can, if it sees the end enlarged
and nothing is drawn over it. That is what this sheet is for.

The words on a sheet: the facts beside the picture, the findings, and the other ink.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
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
    ends_of,
    grey_ahead,
    insets_of,
)
from vfplan.review.paper import (
    BLACK,
    BODY,
    CONTENT_WIDTH,
    DPI,
    FOOT,
    GREY,
    HEADING,
    MARGIN,
    PAGE_HEIGHT,
    PAGE_WIDTH,
    STRONG,
    TITLE,
    WHITE,
    Box,
    Paper,
)
from vfplan.review.picture import COLUMN_WIDTH, draw_picture, draw_views
from vfplan.review.sheet_input import SheetInput

LISTED_ENTRIES = 12
"""Entries of the account that are listed; the others are summed up."""

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
        facts += _facts_of_ends(content)
    facts += content.facts
    for heading, words in facts:
        y = sheet.space_for(y, HEADING.line_height + BODY.line_height)
        sheet.text(x, y, heading, HEADING)
        beside = HEADING.width_of(f"{heading}  ")
        if beside + BODY.width_of(words) <= width:
            sheet.text(x + beside, y + HEADING.baseline - BODY.baseline, words)
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
            name = end.name
            if len(content.strokes) > 1:
                name += f" of line {number}"
            words = (
                f"All pixels ahead of the {name} have one grey, {grey} of 255. A cover of that "
                "grey has no border that could be seen. Compare with the slice before it was "
                "drawn on."
            )
            facts.append((f"One grey ahead of the {end.name}", words))
    return facts


def draw_lists(sheet: Paper, content: SheetInput, y: float) -> float:
    """The findings and the other ink, over the whole width."""
    lines = list_lines(content, CONTENT_WIDTH)
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
    heading = "Findings: none" if not content.findings else "Findings"
    lines = text_lines(heading, width, HEADING, is_head=bool(content.findings))
    for number, finding in enumerate(content.findings, 1):
        kind, style = finding.severity, BODY
        if finding.is_open:
            kind, style = "wants an answer", STRONG
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
    heading = "Other ink in the pen's colour"
    if content.account is None:
        heading = "Other ink: not kept in the bundle"
    elif not content.account:
        heading += ": none"
    lines += text_lines(heading, width, HEADING, above=20, is_head=bool(content.account))
    account = content.account or ()
    for entry in account[:LISTED_ENTRIES]:
        words = f"{entry.number}: "
        if entry.what:
            words += f"{entry.what}, "
        words += f"{entry.pixels} px ({entry.share:.1%}) at ({entry.u:.0f}, {entry.v:.0f})"
        lines += text_lines(words, width, BODY)
    smaller = account[LISTED_ENTRIES:]
    if smaller:
        pixels = sum(entry.pixels for entry in smaller)
        lines += text_lines(f"and {len(smaller)} smaller, {pixels} px together", width, BODY)
    return lines


def text_lines(
    words: str,
    width: float,
    style: paper.Style,
    *,
    indent: float = 0,
    above: float = 0,
    is_head: bool = False,
) -> list[TextLine]:
    """A text in lines of at most this width; the first has the space above it."""
    lines = []
    for line in paper.wrapped(words, width - indent, style):
        lines.append(TextLine(line, style, indent, above, is_head))
        above = 0
    return lines


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
