"""What a sheet enlarges: both ends of each line, every bridge, and the places of findings.

Nothing is drawn on an inset of an end or of a bridge. A pixel of the slice is a square of 8 x 8
equal pixels, in the slice's own greys; what the square shows is what the file holds. The middle of
an inset is marked by four small triangles outside of its frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.fixture import Stroke
from vfplan.geometry.lines import arc_lengths, runs
from vfplan.images.read import as_uint8
from vfplan.review import paper
from vfplan.review.paper import BLACK, BODY, CONTENT_WIDTH, MARGIN, STRONG, Box, Paper
from vfplan.review.sheet_input import SheetInput

Array = NDArray[np.float64]

INSET_PX = 360
"""Side [px of the page] of an inset: 46 mm in print."""

ZOOM = 8
"""Pixels of the page to one of the slice in an inset."""

WIDER_ZOOM = ZOOM // 2
"""The same in the wider view of an end."""

SHOWN_PX = INSET_PX // ZOOM
"""Side [px of the slice] of what an inset shows."""

AHEAD_PX = 10.0
"""Radius [px of the slice] of the disc ahead of an end whose greys are compared: a box that covers
an end is larger than that."""

ONE_GREY = 2
"""Range of greys, of 256, within which a ground counts as even; noise of a CT spans more."""

INSETS_IN_A_ROW = CONTENT_WIDTH // INSET_PX
INSET_STEP = (CONTENT_WIDTH - INSET_PX) / (INSETS_IN_A_ROW - 1)
CAPTION_HEIGHT = 3 * BODY.line_height + BODY.line_height // 2
ROW_HEIGHT = CAPTION_HEIGHT + INSET_PX + BODY.line_height


@dataclass(frozen=True, eq=False)
class LineEnd:
    """An end of a line, or the start of a closed one.

    `name` is "start" or "end", `place` is (u, v) [px of the slice], and `direction` the unit
    vector in which the line would go on; `None` for a closed line.
    """

    name: str
    place: Array
    direction: Array | None


@dataclass(frozen=True, eq=False)
class Inset:
    """A place that is enlarged: its caption, its middle (u, v), and how it is drawn.

    `is_raised` spreads the greys, `has_line` draws the line, `has_band` the line and its bands.
    `note` stands in the caption in place of the size.
    """

    caption: str
    place: Array
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
    return None if len(colours) == 0 or np.ptp(colours) > ONE_GREY else int(np.median(colours))


def insets_of(content: SheetInput) -> list[Inset]:
    """What the sheet enlarges, in the order in which it stands there."""
    insets = []
    is_single = len(content.strokes) == 1
    for number, stroke in enumerate(content.strokes, 1):
        name = "the line" if is_single else f"line {number}"
        for end in ends_of(stroke):
            caption = f"{end.name.capitalize()} of {name}"
            note = ""
            if grey_ahead(content, stroke, end) is not None:
                note = "one grey ahead: look twice"
            insets.append(Inset(caption, end.place, note=note))
            # A line without ink hides nothing, and the line itself has to be visible.
            insets.append(
                Inset(
                    f"{caption}, wider",
                    end.place,
                    WIDER_ZOOM,
                    is_raised=True,
                    has_line=stroke.sigma is None,
                )
            )
    for number, stroke in enumerate(content.strokes, 1):
        of_line = "" if is_single else f" of line {number}"
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
    for entry in content.account or ():
        place = np.array([entry.u, entry.v])
        if not entry.is_ink and not _is_enlarged(place, insets):
            insets.append(Inset(f"{entry.number}: {entry.what}", place))
    for number, finding in enumerate(content.findings, 1):
        if finding.place_px is not None and not _is_enlarged(finding.place_px, insets):
            insets.append(Inset(f"F{number}: {finding.code}", np.array(finding.place_px)))
    if content.tre95_m is not None and content.metres_per_px is not None:
        # Where the registration's error may be largest, enlarged so that the band fits in.
        points = np.concatenate([stroke.points for stroke in content.strokes])
        worst = int(np.argmax(content.tre95_m))
        half_m = max(content.tre95_m[worst], content.margin_m or 0.0)
        zoom = ZOOM
        while zoom > 1 and half_m / content.metres_per_px * zoom > 0.4 * INSET_PX:
            zoom //= 2
        insets.append(Inset("Error and margin, true scale", points[worst], zoom, has_band=True))
    return insets


def _is_enlarged(place: Array | tuple[float, float], insets: list[Inset]) -> bool:
    for inset in insets:
        distance = np.abs(inset.place - place).max()
        if inset.zoom == ZOOM and distance <= SHOWN_PX // 3:
            return True
    return False


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
            caption = paper.shortened(inset.caption, INSET_PX, STRONG)
            sheet.text(x, y, caption, STRONG)
            for line, words in enumerate(_described(inset, content), 1):
                words = paper.shortened(words, INSET_PX, BODY)
                sheet.text(x, y + line * BODY.line_height, words)
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
    enlarged = np.repeat(np.repeat(pixels, inset.zoom, axis=0), inset.zoom, axis=1)
    # What lies outside of the slice is striped, so that nobody takes it for black or white there.
    outside = np.repeat(np.repeat(is_outside, inset.zoom, axis=0), inset.zoom, axis=1)
    rows, columns = np.nonzero(outside)
    is_stripe = (rows + columns) % 16 < 2
    enlarged[rows[is_stripe], columns[is_stripe]] = paper.GREY
    if inset.has_line:
        for stroke in content.strokes:
            paper.draw_cased(enlarged, _within(inset, stroke), paper.LINE_COLOUR, 2, stroke.closed)
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


def _within(inset: Inset, stroke: Stroke) -> Array:
    """(M, 2) the points of a line in an inset [px of the page]."""
    u, v, _, _ = inset.window
    return (stroke.points - (u, v) + 0.5) * inset.zoom - 0.5


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
    first = 0
    for stroke in content.strokes:
        count = len(stroke.points)
        points = _within(inset, stroke)
        to_page = inset.zoom / content.metres_per_px
        bound_px = content.tre95_m[first : first + count] * to_page
        first += count
        if content.margin_m:
            margin_px = np.full(count, content.margin_m * to_page)
            draw_distance(
                enlarged, points, margin_px, stroke.closed, paper.MARGIN_COLOUR, dashed=False
            )
        draw_distance(enlarged, points, bound_px, stroke.closed, paper.BAND_COLOUR, dashed=True)
        if stroke.is_ordered:
            paper.draw_line(enlarged, points, paper.LINE_COLOUR, 2, stroke.closed)


def draw_distance(
    canvas: NDArray[np.uint8],
    points: Array,
    distance: Array,
    closed: bool,
    colour: paper.Colour,
    *,
    dashed: bool,
) -> None:
    """Draw the outline of what lies within a distance, (M,), of a line, (M, 2) [px of the page]."""
    within = np.zeros(canvas.shape[:2], np.uint8)
    if closed:
        points, distance = np.vstack([points, points[:1]]), np.append(distance, distance[:1])
    # Points whose neighbourhood does not reach the canvas draw nothing.
    reach = float(distance.max()) + 1
    size = np.array(within.shape[::-1])
    reaches = ((points > -reach) & (points < size + reach)).all(axis=1)
    for k in np.flatnonzero(reaches):
        paper.draw_disc(within, points[k], distance[k], 255)
        if k:
            thickness = max(1, round(distance[k] + distance[k - 1]))
            paper.draw_line(within, points[k - 1 : k + 1], 255, thickness)
    contours, _ = cv2.findContours(
        (within > 127).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE
    )
    height, width = within.shape
    for contour in contours:
        outline = contour[:, 0]
        x, y = outline.T
        inner = (x > 0) & (y > 0) & (x < width - 1) & (y < height - 1)
        length = len(outline)
        if dashed:
            length = 14
        for start in range(0, len(outline), length + 8):
            dash = outline[start : start + length]
            dash = dash[inner[start : start + length]]
            if len(dash) > 1:
                paper.draw_line(canvas, dash.astype(float), colour, 2)
