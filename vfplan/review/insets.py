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

from vfplan.review import paper
from vfplan.review.paper import BLACK, Box, Paper
from vfplan.review.sheet_input import SheetInput, SheetStroke

Array = NDArray[np.float64]

# An inset is a square of this many pixels of the page, and enlarges this many times.
INSET_PX = 360
ZOOM = 8

# Pixels of the slice across an inset: odd, so that the end lies in the middle of a pixel.
WINDOW_PX = INSET_PX // ZOOM

# The wider view beside each end enlarges this many times.
WIDER_ZOOM = 4

# A bridge up to this long is shown in one inset, with ink on both sides [px of the slice].
BRIDGE_PX = 33

# A finding this close to the middle of an inset is shown there already [px of the slice].
SHOWN_PX = 15


@dataclass(frozen=True, eq=False)
class Inset:
    """A place that is enlarged: its caption, its middle (u, v), and how it is shown.

    `is_raised` spreads the greys, `has_line` draws the line, `has_band` the line and its bands.
    """

    caption: str
    place: Array
    zoom: int = ZOOM
    is_raised: bool = False
    has_line: bool = False
    has_band: bool = False

    @property
    def window(self) -> tuple[int, int, int, int]:
        """(u, v, width, height): the part of the slice that is shown."""
        size = INSET_PX // self.zoom
        u, v = (int(np.floor(x + 0.5)) for x in self.place)
        return u - size // 2, v - size // 2, size, size


def ends_of(stroke: SheetStroke) -> list[Array]:
    """Both ends of a line, or the start of a closed one."""
    if not stroke.is_ordered:
        return []
    if stroke.closed:
        return [stroke.points_px[0]]
    return [stroke.points_px[0], stroke.points_px[-1]]


def runs_of(flags: NDArray[np.bool_], closed: bool) -> list[NDArray[np.intp]]:
    """The indices of each run of flagged points; on a closed line a run may pass its start."""
    steps = np.flatnonzero(np.diff(flags.astype(np.int8)))
    parts = np.split(np.arange(len(flags)), steps + 1)
    runs = [part for part in parts if flags[part[0]]]
    if closed and len(runs) > 1 and flags[0] and flags[-1]:
        runs = [np.concatenate([runs[-1], runs[0]]), *runs[1:-1]]
    return runs


def insets_of(shown: SheetInput) -> list[Inset]:
    """What the sheet enlarges, in the order in which it is shown."""
    insets = []
    for number, stroke in enumerate(shown.strokes, 1):
        name = "the line" if len(shown.strokes) == 1 else f"line {number}"
        insets += _ends(stroke, name)
    for number, stroke in enumerate(shown.strokes, 1):
        insets += _bridges(stroke, "" if len(shown.strokes) == 1 else f" of line {number}")
    for entry in shown.account or ():
        if not entry.is_ink and not _is_shown((entry.u, entry.v), insets):
            insets.append(Inset(f"{entry.number}: {entry.what}", np.array([entry.u, entry.v])))
    for number, finding in enumerate(shown.findings, 1):
        if finding.place_px is not None and not _is_shown(finding.place_px, insets):
            insets.append(Inset(f"F{number}: {finding.code}", np.array(finding.place_px)))
    if shown.tre95_m is not None and shown.metres_per_px is not None:
        insets.append(_widest_band(shown))
    return insets


def _ends(stroke: SheetStroke, name: str) -> list[Inset]:
    captions = (f"Start of {name}", f"End of {name}")
    insets = []
    for caption, place in zip(captions, ends_of(stroke), strict=False):
        insets.append(Inset(caption, place))
        # Where there is no ink, nothing is hidden, and the line itself has to be seen.
        wider = Inset(
            f"{caption}, wider", place, WIDER_ZOOM, is_raised=True, has_line=not stroke.has_ink
        )
        insets.append(wider)
    return insets


def _bridges(stroke: SheetStroke, of_line: str) -> list[Inset]:
    """One inset a bridge, or several along a long one."""
    insets = []
    for number, run in enumerate(runs_of(stroke.bridged, stroke.closed), 1):
        points = stroke.points_px[run]
        along = np.concatenate([[0.0], np.hypot(*np.diff(points, axis=0).T).cumsum()])
        count = max(1, int(np.ceil(along[-1] / BRIDGE_PX)))
        for k in range(count):
            place = points[np.searchsorted(along, along[-1] * (k + 0.5) / count)]
            part = "" if count == 1 else f", part {k + 1} of {count}"
            caption = f"Bridge {number}{of_line}, {along[-1]:.0f} px{part}"
            insets.append(Inset(caption, place))
    return insets


def _is_shown(place: tuple[float, float], insets: list[Inset]) -> bool:
    for inset in insets:
        distance = np.abs(inset.place - place).max()
        if inset.zoom == ZOOM and distance <= SHOWN_PX:
            return True
    return False


def _widest_band(shown: SheetInput) -> Inset:
    """Where the registration's error may be largest, enlarged so that the band fits in."""
    points = np.concatenate([stroke.points_px for stroke in shown.strokes])
    worst = int(np.argmax(shown.tre95_m))
    half_px = max(shown.tre95_m[worst], shown.margin_m or 0.0) / shown.metres_per_px
    zoom = ZOOM
    while zoom > 1 and half_px * zoom > 0.4 * INSET_PX:
        zoom //= 2
    return Inset("Error and margin, true scale", points[worst], zoom, has_band=True)


def draw_inset(
    sheet: Paper, inset: Inset, rgb: NDArray[np.uint8], shown: SheetInput, left: int, top: int
) -> Box:
    """Draw an inset with its frame at a place of the page."""
    window = inset.window
    pixels, is_outside = _cut_out(rgb, window)
    if inset.is_raised:
        pixels = _spread(pixels, is_outside)
    enlarged = np.repeat(np.repeat(pixels, inset.zoom, axis=0), inset.zoom, axis=1)
    outside = np.repeat(np.repeat(is_outside, inset.zoom, axis=0), inset.zoom, axis=1)
    _hatch(enlarged, outside)
    if inset.has_line:
        for stroke in shown.strokes:
            paper.draw_cased(enlarged, _within(inset, stroke), paper.LINE_COLOUR, 2, stroke.closed)
    if inset.has_band:
        _draw_band(enlarged, inset, shown)
    size = enlarged.shape[0]
    box = sheet.picture(left, top, enlarged, kind="inset", words=inset.caption, shows=window,
                        zoom=inset.zoom)  # fmt: skip
    sheet.frame(box)
    for x, y, dx, dy in (
        (left + size / 2, top - 3, 0, -1),
        (left + size / 2, top + size + 3, 0, 1),
        (left - 3, top + size / 2, -1, 0),
        (left + size + 3, top + size / 2, 1, 0),
    ):
        tip = np.array([x, y])
        away, across = 9 * np.array([dx, dy]), 6 * np.array([dy, dx])
        corners = paper.fixed_point(np.array([tip, tip + away + across, tip + away - across]))
        cv2.fillConvexPoly(sheet.canvas, corners, BLACK, cv2.LINE_AA, paper.SHIFT)
    return box


def _within(inset: Inset, stroke: SheetStroke) -> Array:
    """(M, 2) the points of a line in an inset [px of the page]."""
    u, v, _, _ = inset.window
    return (stroke.points_px - (u, v) + 0.5) * inset.zoom - 0.5


def _cut_out(
    rgb: NDArray[np.uint8], window: tuple[int, int, int, int]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """The pixels of a window, and which of them lie outside of the slice."""
    u, v, width, height = window
    pixels = np.full((height, width, 3), 255, np.uint8)
    is_outside = np.ones((height, width), bool)
    first_u, first_v = max(u, 0), max(v, 0)
    last_u, last_v = min(u + width, rgb.shape[1]), min(v + height, rgb.shape[0])
    if first_u < last_u and first_v < last_v:
        place = slice(first_v - v, last_v - v), slice(first_u - u, last_u - u)
        pixels[place] = rgb[first_v:last_v, first_u:last_u]
        is_outside[place] = False
    return pixels, is_outside


def _hatch(enlarged: NDArray[np.uint8], outside: NDArray[np.bool_]) -> None:
    """Stripe what lies outside of the slice, so that nobody takes it for black or white there."""
    rows, columns = np.nonzero(outside)
    is_stripe = (rows + columns) % 16 < 2
    enlarged[rows[is_stripe], columns[is_stripe]] = paper.GREY


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


def _draw_band(enlarged: NDArray[np.uint8], inset: Inset, shown: SheetInput) -> None:
    """Draw the line, the 95 % band and the margin at true scale, over a paler slice."""
    enlarged[:] = 128 + enlarged // 2
    first = 0
    for stroke in shown.strokes:
        count = len(stroke.points_px)
        at = _within(inset, stroke)
        bound_px = shown.tre95_m[first : first + count] / shown.metres_per_px * inset.zoom
        first += count
        if shown.margin_m:
            margin = np.full(count, shown.margin_m / shown.metres_per_px * inset.zoom)
            draw_distance(enlarged, at, margin, stroke.closed, paper.MARGIN_COLOUR, dashed=False)
        draw_distance(enlarged, at, bound_px, stroke.closed, paper.BAND_COLOUR, dashed=True)
        if stroke.is_ordered:
            paper.draw_line(enlarged, at, paper.LINE_COLOUR, 2, stroke.closed)


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
        length = 14 if dashed else len(outline)
        for start in range(0, len(outline), length + 8):
            dash = outline[start : start + length]
            dash = dash[inner[start : start + length]]
            if len(dash) > 1:
                paper.draw_line(canvas, dash.astype(float), colour, 2)
