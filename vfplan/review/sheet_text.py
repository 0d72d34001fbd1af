"""The words on a sheet: the facts beside the picture, the findings, and the other ink."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from vfplan.review import paper
from vfplan.review.insets import ends_of, grey_ahead
from vfplan.review.paper import BODY, CONTENT_WIDTH, HEADING, MARGIN, STRONG, Paper
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
