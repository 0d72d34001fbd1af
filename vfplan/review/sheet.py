"""The review sheet: one picture on which a person sees whether a plan is right.

From top to bottom: the verdict; the slice in its true greys with the ink visible; both ends of
each line and every bridge enlarged; the findings; the other ink. A grey box that hides the end of
a line leaves no trace in the ink, so no program can tell. An eye can, if it sees the end enlarged
and nothing is drawn over it. That is what this sheet is for.

So nothing is drawn on an inset of an end, and on one of a bridge only a hairline. A pixel of the
slice is a square of 8 x 8 equal pixels, in the slice's own greys; what the square shows is what the
file holds. The middle of an inset is marked by four small triangles outside of its frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import chain, pairwise
from pathlib import Path

import cv2
import numpy as np

from vfplan.display import MAX_NUMBERED, MM, coordinates, count, finding_name, isolated, millimetres
from vfplan.findings import acceptance
from vfplan.fixture import Fixture, Stroke
from vfplan.geometry.lines import Array, arc_lengths, distance_to, length_of
from vfplan.images.read import SLICE_IN_WORDS, as_uint8, height_in_words
from vfplan.io.writing import write_whole
from vfplan.review import paper, picture
from vfplan.review.paper import BLACK, BODY, GREY, HEADING, INSET_PX, MARGIN, STRONG, Paper, Pixels
from vfplan.review.plan import Plan
from vfplan.review.rendered import described, slice_not_shown

# Pixels of the page to one of the slice in an inset.
ZOOM = 8

# Side [px of the slice] of what an inset shows.
SHOWN_PX = INSET_PX // ZOOM

# Range of greys, of 256, within which a ground counts as even; noise of a CT spans more.
ONE_GREY = 2

# Radius [px of the slice] of the disc ahead of an end whose greys are compared: a box that covers
# an end is larger than that.
AHEAD_PX = 10.0

# Distance [px of the page] from one stripe to the next outside of the slice.
STRIPES_PX = 4 * ZOOM

INSETS_IN_A_ROW = paper.CONTENT_WIDTH // INSET_PX
INSET_STEP = (paper.CONTENT_WIDTH - INSET_PX) / (INSETS_IN_A_ROW - 1)
CAPTION_HEIGHT = 3 * BODY.line_height + BODY.line_height // 2
ROW_HEIGHT = CAPTION_HEIGHT + INSET_PX + 16


# Distance [px of the page] from a list to the heading of the next.
LIST_GAP = 14

# What the sheet calls an entry of the account that is no ink.
GAP = "gap in the line, or line hidden"

WHAT_TO_LOOK_FOR = (
    "Does the line end there, or does a box or label hide the rest? Then draw it: vfplan review. "
    "Striped: outside the slice."
)


def verdict_of(plan: Plan) -> str:
    """The title of the sheet: what is planned, what a person has to look at, and then to do."""
    kind = f"A {plan.kind}. " if plan.kind else ""
    unanswered, reviewed = len(plan.fixture.open_findings), plan.fixture.reviewed
    if plan.is_slice_missing:
        return f"{kind}The slice is missing, so the ends are not checked"
    if reviewed is not None and not unanswered:
        return f"{kind}Approved by {reviewed.by}, {reviewed.utc}"
    # No program can tell whether something covers an end.
    ends = sum(len(stroke.end_points) for stroke in plan.strokes)
    places = {0: "the whole drawing", 2: "both ends of the line"}.get(ends, f"all {ends} ends")
    places = "the three views" if plan.image is None else places
    then = f"answer {count(unanswered, 'finding')}" if unanswered else "approve"
    return f"{kind}Look at {places}, then {then}"


def facts_of(plan: Plan) -> list[tuple[str, str]]:
    """The numbers of a plan in words: (heading, text) as they stand beside the picture."""
    recipe, image = plan.fixture.provenance.settings, plan.image
    slice_in_words = recipe.get(SLICE_IN_WORDS, "")
    if not slice_in_words and image is not None and image.T_patient_image is not None:
        slice_in_words = height_in_words(image)
    margin = "none" if plan.kind else ""
    if plan.margin_m is not None:
        margin = f"{millimetres(plan.margin_m, 2)} on every side"
    elif "margin" in recipe:
        margin = "the 95 % bound"
    facts = [
        ("Line" if plan.strokes else "Geometry", geometry_in_words(plan)),
        ("Slice", slice_in_words),
        ("Pixel", pixel_in_words(plan)),
        ("Markers", markers_in_words(plan.fixture)),
        ("Place of the line", error_in_words(plan)),
        ("Margin", margin),
    ]
    return [(heading, words) for heading, words in facts if words]


def geometry_in_words(plan: Plan) -> str:
    """The length of each line and the width of its pen, or how many points there are."""
    parts = []
    for number, stroke in enumerate(plan.strokes):
        if not stroke.is_ordered:
            parts.append(f"{len(stroke.points)} pixels in no order")
            continue
        words = "closed, " if stroke.closed else "open, "
        if len(plan.strokes) > 1:
            words = f"Line {number + 1}: {words}"
        if plan.fixture.frame == "image":
            words += f"{stroke.length:.1f} px"
            if plan.spacing_mm is not None:
                length_mm = length_of(stroke.points * plan.spacing_mm, stroke.closed)
                words += f" = {length_mm:.1f} mm"
        else:
            # As long as it is in front of the robot: a pixel need not be a square there.
            words += millimetres(plan.fixture.strokes[number].length, 1)
        if stroke.width is not None:
            words += f"; the pen is {stroke.width:.1f} px wide"
        parts.append(words)
    if not plan.strokes:
        parts = [f"{len(plan.fixture.points)} points"]
    return ". ".join(parts)


def pixel_in_words(plan: Plan) -> str:
    """The size of a pixel by the markers, and as it is given; empty without a slice."""
    parts = []
    if plan.image is None:
        return ""
    if plan.fixture.registration is not None:
        parts.append(f"{MM * plan.metres_per_px:.4g} mm as registered")
    if plan.spacing_mm is not None:
        sides = dict.fromkeys(f"{side:.4g}" for side in plan.spacing_mm)
        parts.append(f"{' x '.join(sides)} mm as given")
    return ", ".join(parts)


def markers_in_words(fixture: Fixture) -> str:
    """How many markers there are, and how well they fit; empty without any."""
    registration = fixture.registration
    if registration is None:
        return ""
    left_out, labels = fixture.labels_left_out, registration.labels
    used = [number for number, label in enumerate(labels) if label not in left_out]
    worst = max(used, key=lambda number: registration.residuals_m[number])
    rms, largest = registration.fre_rms_m, registration.residuals_m[worst]
    return (
        f"{len(used)} of {len(labels)}, {registration.model}; residual {millimetres(rms, 2)} rms, "
        f"largest {millimetres(largest, 2)} at {isolated(labels[worst])}"
    )


def error_in_words(plan: Plan) -> str:
    """How far the line may lie off its place."""
    fixture = plan.fixture
    if fixture.frame == "image":
        return "not registered yet"
    if fixture.registration is None:
        return ""
    bound = plan.bound95_m
    if bound is not None:
        pixels = f" ({bound / plan.metres_per_px:.1f} px)" if plan.metres_per_px else ""
        return f"the line lies within {millimetres(bound, 2)}{pixels} of its place (95 %)"
    if fixture.registration.tre_m is None:
        return "not known"
    largest = millimetres(fixture.registration.tre_m.max(), 2)
    return f"{largest} rms at most; the 95 % bound is not kept in the bundle"


def draw_facts(sheet: Paper, plan: Plan, x: float, y: float, width: float) -> float:
    """What to look for at the ends, and the numbers of the plan."""
    facts = facts_of(plan)
    has_ends = any(len(stroke.end_points) for stroke in plan.strokes)
    if has_ends and plan.image is not None and plan.fixture.reviewed is None:
        facts.insert(0, ("Look at each end", WHAT_TO_LOOK_FOR))
    for heading, words in facts:
        y = sheet.space_for(y, 2 * BODY.line_height)
        sheet.text(x, y, heading, STRONG)
        y = sheet.paragraph(x, y + BODY.line_height, words, width) + 4
    return y


# Lines that stand together: the words, the style and the indent [px of the page] of each.
Block = list[tuple[str, paper.Style, float]]


def lists_of(plan: Plan, unnamed: Sequence[str]) -> list[tuple[str, list[Block]]]:
    """The findings, other ink, unnamed markers and what is rendered: (heading, entries) each."""
    findings, shown = [], plan.findings
    if plan.is_slice_missing and all(one.code != "slice-not-shown" for one in shown):
        # Whoever accepts this sheet is asked about that.
        shown = (*shown, slice_not_shown())
    for number, finding in sorted(enumerate(shown, 1), key=lambda row: not row[1].is_open):
        kind, style = ("wants an answer", STRONG) if finding.is_open else (finding.severity, BODY)
        head, words = f"{finding_name(number)}  {kind}: {finding.code}", finding.text
        if finding.place_px is not None:
            head += f", at ({coordinates(finding.place_px)})"
        if ink := picture.ink_at(plan, finding):
            head += f", other ink {ink}"
        if finding.answered_by is not None:
            words += acceptance(finding.answered_by, finding.answered_utc)
        findings.append([(head, style, 0), (words, BODY, 30)])
    lists = [("Findings" if findings else "Findings: none", findings)]
    if plan.image is not None:
        # Each has its number of the account, in which bridges are counted too.
        words = []
        for entry in plan.other_ink[:MAX_NUMBERED]:
            what = f"longest side {entry.size_px:.0f} px, area {entry.pixels} px"
            if entry.what != "ink":
                what = f"{GAP}, {entry.pixels} px"
            where = f"({entry.share:.1%}) at ({coordinates(entry.middle)})"
            words.append(f"{entry.number}: {what} {where}")
        rest = plan.other_ink[MAX_NUMBERED:]
        if rest:
            words.append(f"and {len(rest)} smaller, {sum(e.pixels for e in rest)} px together")
        rows = [[(line, BODY, 0)] for line in words or ["none"]]
        lists.append(("Other ink", rows))
    if unnamed:
        lists.append(("Markers without room", [[(marker, BODY, 0)] for marker in unnamed]))
    if plan.kind:
        rows = [[(f"{name}: {words}", BODY, 0)] for name, words in described(plan.fixture)]
        lists.append((f"The robot renders a {plan.kind}", rows))
    return lists


def draw_lists(
    sheet: Paper, plan: Plan, corner: tuple[float, float], y: float, unnamed: Sequence[str] = ()
) -> None:
    """Draw each list from (x, y) the corner on if it fits there above `y`, else from `y` on."""
    page, end, (corner_x, corner_y) = sheet.page, y, np.subtract(corner, (0, LIST_GAP))
    y -= LIST_GAP

    def lines_of(block: Block, x: float) -> list[tuple[str, paper.Style, float, float]]:
        """Each line with its style, its x, and its height with the gap above a heading."""
        return [
            (line, style, x + indent, style.line_height + LIST_GAP * (style is HEADING))
            for words, style, indent in block
            for line in paper.wrapped(words, paper.PAGE_WIDTH - MARGIN - x - indent, style)
        ]  # fmt: skip

    def draw(block: Block, x: float, y: float, page: int) -> float:
        for line, style, left, height in lines_of(block, x):
            y = sheet.space_for(y, height) + height
            sheet.text(left, y - style.line_height, line, style, page=page)
        return y

    def height_of(block: Block, x: float) -> float:
        return sum(height for *_, height in lines_of(block, x))

    for heading, entries in lists_of(plan, unnamed):
        # No line stands alone on a page: no heading, and neither the first nor the last of a list.
        cuts = pairwise([0, *range(2, len(entries) - 1), len(entries)])
        blocks = [[*chain(*entries[start:stop])] for start, stop in cuts]
        blocks[0].insert(0, (heading, HEADING, 0))
        whole = [*chain(*blocks)]
        if corner_y + height_of(whole, corner_x) <= end:
            corner_y = draw(whole, corner_x, corner_y, page)
            continue
        for number, block in enumerate(blocks):
            top = sheet.space_for(y, height_of(block, MARGIN))
            if number and top != y:
                block.insert(0, (f"{heading}, continued", STRONG, 0))
            y = draw(block, MARGIN, top, -1)


@dataclass(eq=False)
class Inset:
    """A place that is enlarged: its caption, its middle (u, v), and how it is drawn.

    `note` stands in the caption. `is_raised` spreads the greys, `has_line` draws the line,
    `has_band` the line and its bands, and `bridge` (M, 2) is drawn as a hairline.
    """

    caption: str
    place: Array
    note: str
    zoom: int = ZOOM
    is_raised: bool = False
    has_line: bool = False
    has_band: bool = False
    bridge: Array | None = None

    @property
    def window(self) -> tuple[int, int, int, int]:
        """(u, v, width, height): the part of the slice that is enlarged."""
        size = INSET_PX // self.zoom
        u, v = np.floor(self.place + 0.5).astype(int).tolist()
        return u - size // 2, v - size // 2, size, size

    def within(self, points: Array) -> Array:
        """(M, 2) places of the slice in the inset [px of the page]."""
        return (points - self.window[:2] + 0.5) * self.zoom - 0.5


def is_even_ahead(rgb: Pixels, stroke: Stroke, end: Array, direction: Array) -> bool:
    """Whether all pixels ahead of an end have one grey.

    A cover of the grey that surrounds it leaves no border. A person who knows that the ground is
    even can compare the slice with the one that was not drawn on.
    """
    if stroke.sigma is None:
        return False
    # The blur of the pen's own end reaches two pixels.
    centre = end + direction * ((stroke.width or 0.0) / 2 + 2.0 + AHEAD_PX)
    disc = np.zeros(rgb.shape[:2], np.uint8)
    paper.draw_disc(disc, centre, AHEAD_PX, 255)
    greys = rgb[disc > 127].astype(int)
    return len(greys) > 0 and np.ptp(greys) <= ONE_GREY


def insets_of(plan: Plan) -> list[Inset]:
    """What the sheet enlarges, in the order in which it stands there."""
    insets, rgb = [], as_uint8(plan.image.rgb)
    for number, stroke in enumerate(plan.strokes, 1):
        name = "the line" if len(plan.strokes) == 1 else f"line {number}"
        ends = zip(picture.ends_of(stroke), stroke.edited[[0, -1]], strict=False)
        for (which, end, direction), is_by_hand in ends:
            caption = f"{which.capitalize()} of {name}"
            is_even = is_even_ahead(rgb, stroke, end, direction)
            note = "one grey ahead: look twice" if is_even else ""
            insets.append(Inset(caption, end, note))
            # A line without ink hides nothing, and the line itself has to be visible.
            has_line = is_by_hand or stroke.sigma is None
            note = "with the line drawn" if has_line else "contrast raised"
            insets.append(Inset(f"{caption}, wider", end, note, ZOOM // 2, True, has_line))
    # One inset a bridge, or several along a long one.
    for name, points in picture.bridges_of(plan):
        along = arc_lengths(points, False)
        parts = max(1, int(np.ceil(along[-1] / (0.75 * SHOWN_PX))))
        for part in range(parts):
            place = points[np.searchsorted(along, along[-1] * (part + 0.5) / parts)]
            note = f"orange: {along[-1]:.0f} px"
            if parts > 1:
                note += f", part {part + 1} of {parts}"
            insets.append(Inset(name.capitalize(), place, note, bridge=points))
    gaps = [entry for entry in plan.other_ink if entry.what != "ink"]
    others = [(f"{entry.number}: {GAP}", "", entry.middle) for entry in gaps]
    for name, finding in picture.placed_findings(plan):
        others.append(("Finding", f" {name}", finding.place_px))
    for caption, name, place in others:
        # One that lies in an inset already is named there, and not enlarged again.
        shown = [
            inset for inset in insets
            if inset.zoom == ZOOM and np.abs(inset.place - place).max() <= SHOWN_PX // 3
        ]  # fmt: skip
        if not shown:
            shown = [Inset(caption, np.array(place), "")]
            insets += shown
        for inset in shown:
            inset.caption += name
    if plan.metres_per_px is not None and (plan.tre95_m is not None or plan.outlines):
        # Where the registration's error may be largest, enlarged so that all of it fits in.
        points = np.concatenate([stroke.points for stroke in plan.strokes])
        bound_m, note = np.zeros(1), "what the robot renders"
        if plan.tre95_m is not None:
            rendered = {"wall": ", red wall", "guide": ", green tube"}.get(plan.kind, "")
            bound_m, note = plan.tre95_m, f"purple 95 %{rendered}, blue line"
        worst = int(np.argmax(bound_m))
        half_px, zoom = bound_m[worst] / plan.metres_per_px, ZOOM
        lines = [line for outline in plan.outlines for line in outline.lines]
        if lines:
            half_px = max(half_px, distance_to(points[worst], np.vstack(lines)))
        while zoom > 1 and half_px * zoom > 0.4 * INSET_PX:
            zoom //= 2
        caption = "Error and outline, to scale"
        insets.append(Inset(caption, points[worst], note, zoom, has_band=True))
    return insets


def draw_insets(
    sheet: Paper, insets: list[Inset], rgb: Pixels, plan: Plan, y: float
) -> tuple[tuple[float, float], float]:
    """Draw rows of insets; a row that does not fit begins a new page.

    Returns the corner of what the last row leaves free, and where the next thing below begins.
    """
    last_row = y
    for number, inset in enumerate(insets):
        column = number % INSETS_IN_A_ROW
        if column == 0:
            last_row = sheet.space_for(y, ROW_HEIGHT)
            y = last_row + ROW_HEIGHT
        x = round(MARGIN + column * INSET_STEP)
        width = f"{INSET_PX // inset.zoom} px"
        if plan.metres_per_px is not None:
            width = millimetres(INSET_PX / inset.zoom * plan.metres_per_px, 1)
        where = f"{inset.zoom}x: {width} at ({coordinates(inset.place)})"
        for line, words in enumerate((inset.caption, where, inset.note)):
            style = BODY if line else STRONG
            words = paper.shortened(words, INSET_STEP - 6, style)
            sheet.text(x, last_row + line * BODY.line_height, words, style)
        draw_inset(sheet, inset, rgb, plan, x, round(last_row + CAPTION_HEIGHT))
    in_last_row = len(insets) % INSETS_IN_A_ROW
    return (MARGIN + in_last_row * INSET_STEP, last_row if in_last_row else y), y


def draw_inset(sheet: Paper, inset: Inset, rgb: Pixels, plan: Plan, x: int, y: int) -> None:
    """Draw an inset with its frame at a place of the page."""
    u, v, size, _ = inset.window
    rows, columns = np.arange(v, v + size), np.arange(u, u + size)
    inner = rows.clip(0, rgb.shape[0] - 1), columns.clip(0, rgb.shape[1] - 1)
    is_outside = (rows != inner[0])[:, None] | (columns != inner[1])
    pixels = rgb[np.ix_(*inner)]
    pixels[is_outside] = 255
    if inset.is_raised:
        pixels = spread_greys(pixels)
    # What lies outside of the slice is striped, so that nobody takes it for black or white there.
    pixels[is_outside & (np.add.outer(rows, columns) % (STRIPES_PX // inset.zoom) == 0)] = GREY
    enlarged = pixels.repeat(inset.zoom, axis=0).repeat(inset.zoom, axis=1)
    if inset.has_line:
        for stroke in plan.strokes:
            line = inset.within(stroke.points)
            paper.draw_cased(enlarged, line, paper.LINE_COLOUR, 2, stroke.closed)
    if inset.bridge is not None:
        paper.draw_line(enlarged, inset.within(inset.bridge), paper.BRIDGE_COLOUR, 2)
    if inset.has_band:
        draw_band(enlarged, inset, plan)
    sheet.picture(
        x, y, enlarged, kind="inset", words=inset.caption, window=inset.window, zoom=inset.zoom
    )
    half = len(enlarged) / 2
    for direction in np.array([[0, -1], [0, 1], [-1, 0], [1, 0]]):
        tip = np.array([x, y]) + half + (half + 3) * direction
        base, across = tip + 9 * direction, 6 * direction[::-1]
        corners = paper.fixed_point(np.array([tip, base + across, base - across]))
        cv2.fillConvexPoly(sheet.canvas, corners, BLACK, cv2.LINE_AA, paper.SHIFT)


def spread_greys(pixels: Pixels) -> Pixels:
    """The same picture with its greys spread evenly from black to white; ink keeps its hue.

    So greys that differ by one are told apart, and a box of one grey stands out of the noise
    around it.
    """
    grey = pixels.min(axis=2)
    shift = cv2.equalizeHist(grey).astype(np.int16) - grey
    return np.clip(pixels + shift[:, :, None], 0, 255).astype(np.uint8)


def draw_band(enlarged: Pixels, inset: Inset, plan: Plan) -> None:
    """Draw line, 95 % band and what the robot renders to scale, over a paler slice."""
    enlarged[:] = 128 + enlarged // 2
    to_page = inset.zoom / plan.metres_per_px
    for outline in plan.outlines:
        picture.draw_rendered(enlarged, outline, inset.within)
    for stroke, half_m in plan.bounds:
        paper.draw_bound(enlarged, inset.within(stroke.points), half_m * to_page, stroke.closed)
    for stroke in plan.strokes:
        if stroke.is_ordered:
            points = inset.within(stroke.points)
            paper.draw_line(enlarged, points, paper.LINE_COLOUR, 2, stroke.closed)


@dataclass(frozen=True, eq=False)
class Sheet:
    """A finished sheet: (H, W, 3) uint8 pixels, red first, and what stands where on its pages."""

    pixels: Pixels
    boxes: tuple[paper.Box, ...]

    def page_pngs(self) -> list[bytes]:
        """Each page as a PNG file of its own."""
        return list(map(png_of, np.split(self.pixels, len(self.pixels) // paper.PAGE_HEIGHT)))


def write_sheet(plan: Plan, path: Path) -> None:
    """Write the sheet as a PNG; raises `OutputError`."""
    write_whole(path, [png_of(draw_sheet(plan).pixels)], overwrite=True)


def draw_sheet(plan: Plan, title: str = "") -> Sheet:
    """Draw the sheet of what is to be reviewed; its title says what to do, or what is given."""
    sheet = Paper()
    # The verdict, in white on black where it is more than a look, and what is reviewed.
    is_more = plan.fixture.open_findings or plan.is_slice_missing
    indent, colour = (16, paper.WHITE) if is_more else (0, BLACK)
    x, width, words = MARGIN + indent, paper.CONTENT_WIDTH - 2 * indent, title or verdict_of(plan)
    y = sheet.paragraph(x, float(MARGIN), words, width, paper.TITLE, colour)
    if is_more:
        bar = slice(MARGIN - 10, round(y) + 10)
        sheet.canvas[bar, MARGIN : paper.PAGE_WIDTH - MARGIN] = BLACK
    words = f"Review sheet of {isolated(plan.source.path.name)}."
    if plan.fixture.case:
        words += f" Case {isolated(plan.fixture.case)}."
    if plan.side is not None:
        words += f" By the markers, the slice is seen from {plan.side}."
    y = sheet.paragraph(MARGIN, y + max(4, indent), words, paper.CONTENT_WIDTH, BODY, GREY) + 14
    if plan.image is None:
        free_x, free_y, y = picture.draw_views(sheet, plan, y)
        draw_facts(sheet, plan, free_x, free_y, paper.PAGE_WIDTH - MARGIN - free_x)
        draw_lists(sheet, plan, (MARGIN, y), y)
    else:
        rgb = as_uint8(plan.image.rgb)
        bottom, column_y, unnamed = picture.draw_picture(sheet, plan, rgb, y)
        column_y = draw_facts(sheet, plan, picture.COLUMN_X, column_y + 4, picture.COLUMN_WIDTH)
        insets = insets_of(plan)
        corner, y = draw_insets(sheet, insets, rgb, plan, max(bottom, column_y) + 8)
        draw_lists(sheet, plan, corner, y, unnamed)
    # The digest and the file's name on every page, and which page of how many it is.
    name = isolated(paper.shortened(plan.source.path.name, INSET_PX, BODY))
    for page in range(sheet.page + 1):
        number = f"{name}, page {page + 1} of {sheet.page + 1}"
        sheet.text(MARGIN, paper.FOOT, f"digest {plan.digest}", page=page)
        x = paper.PAGE_WIDTH - MARGIN - BODY.width_of(number)
        sheet.text(x, paper.FOOT, number, BODY, GREY, page=page)
    return Sheet(sheet.image(), tuple(sheet.boxes))


def png_of(pixels: Pixels) -> bytes:
    """A PNG file that prints at its own size, 200 dots an inch."""
    from PIL import Image

    file = BytesIO()
    Image.fromarray(pixels).save(file, "PNG", dpi=(paper.DPI, paper.DPI), compress_level=1)
    return file.getvalue()
