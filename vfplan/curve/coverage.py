"""Un-mixing: how much of each pixel a pen covers, whatever the grey below it.

Over grey g, a pen of colour c and coverage a shows p = (1 - a) g (1, 1, 1) + a c. The part of p
across the grey axis is a c' where c' is the pen's chroma, whatever g is: bones and air drop out.
Chroma is a plane, so one other pen of known hue can be taken out as well. The picture is worked on
in strips of rows, and only where it has any colour, so that large pictures need little memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned
from vfplan.errors import SettingError
from vfplan.geometry.lines import Array, Flags, windows

# (N, 2) columns and rows of pixels.
Pixels = NDArray[np.int64]

# Hues that are looked for in a picture where the named pen drew no curve.
MOST_PENS = 6
# Steps of the hue by which pixels are counted [degrees].
HUE_STEP_DEG = 5


@dataclass(frozen=True, eq=False)
class Pen:
    """Two directions in the plane of chroma, the plane across grey.

    Parameters
    ----------
    along
        (3,) unit vector of the pen's own chroma.
    across
        (3,) unit vector at right angles to it, positive towards yellow for a red pen.
    name
        What the caller named it.
    """

    along: Array
    across: Array
    name: str

    @classmethod
    def of_colour(cls, colour: str) -> Pen:
        """The pen of a CSS colour name or `#rrggbb`; raises `SettingError` for grey or nonsense."""
        rgb = np.array([255.0, 0.0, 0.0])
        if colour != "red":  # The default needs no import of matplotlib.
            from matplotlib.colors import to_rgb

            try:
                rgb = 255.0 * np.array(to_rgb(colour))
            except ValueError:
                raise SettingError(
                    f"The colour {colour!r} is unknown. Give the name of a colour or #rrggbb.",
                    code="colour-unknown",
                ) from None
        chroma = rgb - rgb.mean()
        strength = float(np.linalg.norm(chroma))
        if strength < tuned.CHROMA_FLOOR:
            raise SettingError(
                f"The colour {colour!r} has a chroma of {strength:.0f}, too little to tell it from "
                f"a grey slice. Name one of {tuned.CHROMA_FLOOR:.0f} or more, such as red.",
                code="colour-grey",
                numbers={"chroma": strength, "chroma_min": tuned.CHROMA_FLOOR},
            )
        along = chroma / strength
        return cls(along, np.cross(np.ones(3), along) / np.sqrt(3.0), colour)

    def turned(self, angle_rad: float) -> Pen:
        """The pen whose hue lies at an angle from this one."""
        cos, sin = np.cos(angle_rad), np.sin(angle_rad)
        along = cos * self.along + sin * self.across
        return Pen(along, cos * self.across - sin * self.along, self.name)

    def degrees_from(self, other: Pen) -> float:
        """The angle of this pen's hue from that of another [degrees]."""
        return float(np.degrees(np.arctan2(self.along @ other.across, self.along @ other.along)))


# (u, v, width, height) [px].
Box = tuple[int, int, int, int]


@dataclass(frozen=True)
class Region:
    """The part of a picture that is looked at.

    Parameters
    ----------
    inside
        The box to look in; `None` for the whole picture.
    outside
        Boxes that are not looked at.
    """

    inside: Box | None = None
    outside: tuple[Box, ...] = ()

    @classmethod
    def of(cls, roi: Box | None, exclude: Sequence[Box], shape: tuple[int, ...]) -> Region:
        """The region of the options `roi` and `exclude`; raises `SettingError`."""
        outside = tuple(_checked_box(box, shape) for box in exclude)
        return cls(None if roi is None else _checked_box(roi, shape), outside)

    def shown(self, rgb: NDArray) -> NDArray:
        """A (H, W, 3) picture, black where it is not looked at."""
        if self == Region():
            return rgb
        inside = _part(self.inside or (0, 0, *rgb.shape[1::-1]))
        shown = np.zeros_like(rgb)
        shown[inside] = rgb[inside]
        for box in self.outside:
            shown[_part(box)] = 0
        return shown


def _part(box: Box) -> Slices:
    """The rows and columns of a box."""
    u, v, width, height = box
    return slice(v, v + height), slice(u, u + width)


def _checked_box(box: Box, shape: tuple[int, ...]) -> Box:
    if np.shape(box) != (4,) or np.asarray(box).dtype.kind not in "iu":
        raise SettingError(
            f"The region {box} is no box. Give u, v, width and height in whole pixels.",
            code="region-not-a-box",
        )
    u, v, width, height = (int(x) for x in box)
    rows, columns = shape[:2]
    fits = u >= 0 and v >= 0 and width > 0 and height > 0
    if not fits or u + width > columns or v + height > rows:
        raise SettingError(
            f"The region {u},{v},{width},{height} leaves the picture. Keep it within its "
            f"{columns}x{rows} px.",
            code="region-outside",
            numbers={"region": [u, v, width, height], "width_px": columns, "height_px": rows},
        )
    return u, v, width, height


# Rows worked on at a time.
STRIP_ROWS = 128
# Pixels around a strip that its blurs and its local maximum reach.
HALO_PX = 20
# Steps of `Ink.other` in the pen's strength.
OTHER_UNIT = 100.0
# Coverage below which float16 holds 0. NumPy converts such a number ten times slower than 0.
TINY_COVERAGE = 2.0**-25
# Brightness of red, green and blue (ITU-R BT.601), which JPEG keeps at full resolution.
LUMINANCE = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True, eq=False)
class Ink:
    """What a picture shows of a pen.

    Parameters
    ----------
    rgb
        (H, W, 3) the picture, as it is looked at.
    coverage
        (H, W) float16, of the pen, in its own strength: 1 in the middle of an opaque line.
    other
        (H, W) uint8, colour of other pens, in hundredths of the pen's strength.
    mask
        (H, W) bool, the pen's ink.
    """

    rgb: NDArray
    coverage: NDArray[np.float16]
    other: NDArray[np.uint8]
    mask: Flags

    @property
    def size(self) -> NDArray[np.int64]:
        """Columns and rows."""
        return np.array(self.mask.shape[::-1])

    @cached_property
    def pixels(self) -> Pixels:
        """(n, 2) columns and rows of the mask's pixels."""
        v, u = np.nonzero(self.mask)
        return np.column_stack([u, v])

    def coverage_at(self, places: NDArray) -> NDArray[np.float16]:
        """(N,) the coverage at the pixels nearest to places (N, 2)."""
        u, v = np.clip(np.rint(places).astype(int), 0, self.size - 1).T
        return self.coverage[v, u]


# A part of the picture: its rows and columns with what lies around them, and the columns that it
# fills, with the same columns.
Slices = tuple[slice, slice]
Window = tuple[Slices, Slices]


def inner_part(values: NDArray, window: Window) -> NDArray:
    """The inner part of an array over the outer part of a window."""
    (outer_rows, _), (rows, _) = window
    return values[rows.start - outer_rows.start : rows.stop - outer_rows.start]


def find_ink(rgb: NDArray, pen: Pen, region: Region = Region()) -> Ink:
    """The pen's coverage, other pens and the mask of a (H, W, 3) picture.

    Where an outline is filled with a lighter shade of its own colour, the fill is taken off first.
    """
    ink, is_broad = _ink_on(region.shown(rgb), pen)
    unfilled = _without_fills(ink) if is_broad else None
    return ink if unfilled is None else _ink_on(unfilled, pen)[0]


def _without_fills(ink: Ink) -> NDArray | None:
    """The picture as it was before outlines were filled; `None` where none is.

    A fill is even ink that is wider than any pen, with stronger ink around most of it. Over it, a
    pixel shows p = (1 - f) g + f c of the ground g and the pen's colour c.
    """
    import cv2

    square, small = (np.ones((side, side), np.uint8) for side in (tuned.LOCAL_PX, 3))
    coverage = ink.coverage.astype(np.float32).clip(0)
    even = cv2.morphologyEx(coverage, cv2.MORPH_OPEN, square)
    for _ in range(tuned.LOCAL_PX // 3):  # Into the corners, where no square has room.
        even = np.minimum(cv2.dilate(even, np.ones((7, 7), np.uint8)), coverage)
    inside = (even > tuned.HALF * cv2.dilate(even, square)) & (even > tuned.VISIBLE / 10)
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(inside.view(np.uint8))
    result = ink.rgb.astype(np.float32)
    found = False
    for label in np.flatnonzero(boxes[1:, cv2.CC_STAT_AREA] >= tuned.LOCAL_PX**2) + 1:
        u, v, width, height = boxes[label, :4]
        box = slice(max(v - 1, 0), v + height + 1), slice(max(u - 1, 0), u + width + 1)
        filled = labels[box] == label
        rim = filled & (cv2.erode(filled.view(np.uint8), small) == 0)
        beside = cv2.dilate(coverage[box], square)[rim]
        strongest = float(np.median(beside)) if rim.any() else 0.0
        pen = filled & (coverage[box] > tuned.FILL_SHARE * strongest)
        if np.median(even[box][filled]) > tuned.FILL_SHARE * strongest or not pen.any():
            continue
        found = True
        outline, colour = np.median(coverage[box][pen]), np.median(ink.rgb[box][pen], axis=0)
        # The edge of the outline is the pen's alone.
        share = cv2.erode(np.where(filled, even[box] / outline, 0), small)[..., None].clip(0, 0.9)
        result[box] = (result[box] - share * colour) / (1 - share)
    top = np.iinfo(ink.rgb.dtype).max
    return np.rint(result).clip(0, top).astype(ink.rgb.dtype) if found else None


def _ink_on(rgb: NDArray, pen: Pen) -> tuple[Ink, bool]:
    """The ink of a picture as it is, and whether any of it is broader than a pen, however faint."""
    import cv2

    shape = rgb.shape[:2]
    ink = Ink(rgb, np.zeros(shape, np.float16), np.zeros(shape, np.uint8), np.zeros(shape, bool))
    windows = list(_coloured_windows(rgb))
    drawn = _measured_pen(rgb, pen, windows)
    is_broad = False
    if drawn is None or _is_edge_of_another(rgb, pen, drawn[0], windows):
        return ink, is_broad
    pen, strength = drawn
    third = np.ones((tuned.LOCAL_PX // 3, tuned.LOCAL_PX // 3), np.uint8)
    for window in windows:
        along, across = _chroma(rgb, pen, window)
        # Another pen's colour is plain to see there.
        strong = np.hypot(along, across) > tuned.OTHER_CHROMA
        other = strong & (np.abs(across) > _gate() * along)
        unmixed = _without_other(along, across, other)
        # Every third pixel shows as well whether there is room for a square.
        tinted = (unmixed[::3, ::3] > tuned.CHROMA_FLOOR / 2).view(np.uint8)
        is_broad |= bool(cv2.erode(tinted, third).any())
        foreign = np.where(other, np.maximum(np.abs(across), -along), 0) / strength
        inner = window[1]
        ink.mask[inner] = inner_part(_mask(unmixed, along, across, strength), window)
        coverage = inner_part(unmixed, window) / strength
        ink.coverage[inner] = np.where(np.abs(coverage) > TINY_COVERAGE, coverage, 0)
        ink.other[inner] = inner_part(np.minimum(OTHER_UNIT * foreign, 255), window)
    return ink, is_broad


def main_pens(rgb: NDArray) -> Iterator[Pen]:
    """The pens of the hues that most saturated pixels of a picture have, the most frequent first.

    A hue counts together with its neighbours, and no pen is named twice.
    """
    red = Pen.of_colour("red")
    counts = np.zeros(360 // HUE_STEP_DEG)
    for window in _coloured_windows(rgb):
        along, across = (inner_part(plane, window) for plane in _chroma(rgb, red, window))
        strong = np.hypot(along, across) > tuned.OTHER_CHROMA
        angle = np.degrees(np.arctan2(across[strong], along[strong])) % 360
        step = (angle / HUE_STEP_DEG).astype(int) % len(counts)
        counts += np.bincount(step, minlength=len(counts))
    reach = round(tuned.HUE_GATE_DEG / HUE_STEP_DEG)
    for _ in range(MOST_PENS):
        top = int(windows(counts, 3, "wrap").sum(axis=1).argmax())
        around = np.arange(top - 1, top + 2) % len(counts)
        if not counts[around].any():
            break
        # The mean hue of the three steps.
        hue = top + (counts[around] @ [-1, 0, 1]) / counts[around].sum() + 0.5
        yield red.turned(np.radians(HUE_STEP_DEG * hue))
        counts[np.arange(top - reach + 1, top + reach) % len(counts)] = 0


def colour_name(ink: Ink, path: NDArray) -> str:
    """The usual colour of the stronger half of the ink along a path, as `#rrggbb`."""
    u, v = path.astype(int).T
    strong = ink.coverage[v, u] >= np.median(ink.coverage[v, u])
    colour = np.median(ink.rgb[v, u][strong], axis=0) * _scale(ink.rgb)
    red, green, blue = np.rint(colour).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"


def sample(plane: NDArray, u: NDArray, v: NDArray) -> NDArray[np.float32]:
    """Values of a (H, W) or (H, W, 3) plane at sub-pixel places, bilinear.

    Beyond the border the outermost pixels go on.
    """
    height, width = plane.shape[:2]
    u, v = np.clip(u, 0, width - 1), np.clip(v, 0, height - 1)
    column = np.minimum(u.astype(np.intp), max(width - 2, 0))
    top = np.minimum(v.astype(np.intp), max(height - 2, 0))
    right, bottom = np.minimum(column + 1, width - 1), np.minimum(top + 1, height - 1)
    x, y = (u - column).astype(np.float32), (v - top).astype(np.float32)
    if plane.ndim == 3:
        x, y = x[..., None], y[..., None]
    upper = (1 - x) * plane[top, column].astype(np.float32) + x * plane[top, right]
    lower = (1 - x) * plane[bottom, column].astype(np.float32) + x * plane[bottom, right]
    return (1 - y) * upper + y * lower


def brightness(rgb: NDArray, u: NDArray, v: NDArray) -> Array:
    """Brightness on 0..255 at sub-pixel places."""
    return sample(rgb, u, v) @ (LUMINANCE * _scale(rgb))


def _scale(rgb: NDArray) -> float:
    """Grey levels (0..255) a step of the picture's own numbers."""
    return 255.0 / np.iinfo(rgb.dtype).max


def _coloured_windows(rgb: NDArray) -> Iterator[Window]:
    """Strips of the picture, cut to the columns that hold any colour."""
    import cv2

    height, width = rgb.shape[:2]
    lowest = tuned.CHROMA_FLOOR / _scale(rgb)
    for top in range(0, height, STRIP_ROWS):
        bottom = min(top + STRIP_ROWS, height)
        rows = slice(max(top - HALO_PX, 0), min(bottom + HALO_PX, height))
        red, green, blue = cv2.split(rgb[rows])
        difference = cv2.max(cv2.absdiff(red, green), cv2.absdiff(green, blue))
        coloured = np.flatnonzero(cv2.reduce(difference, 0, cv2.REDUCE_MAX)[0] > lowest)
        if not len(coloured):
            continue
        left, right = int(coloured[0]) - HALO_PX, int(coloured[-1]) + HALO_PX + 1
        columns = slice(max(left, 0), min(right, width))
        yield (rows, columns), (slice(top, bottom), columns)


def _chroma(rgb: NDArray, pen: Pen, window: Window) -> tuple[NDArray, NDArray]:
    """The picture's chroma along and across the pen's hue [grey levels]."""
    import cv2

    directions = (_scale(rgb) * np.array([pen.along, pen.across])).astype(np.float32)
    planes = cv2.transform(rgb[window[0]].astype(np.float32), directions)
    return planes[..., 0], planes[..., 1]


def _gate() -> float:
    """Chroma across over chroma along at the edge of the pen's hues."""
    return float(np.tan(np.radians(tuned.HUE_GATE_DEG)))


def _measured_pen(rgb: NDArray, pen: Pen, windows: list[Window]) -> tuple[Pen, float] | None:
    """The pen as it is in this picture, and its strength [grey levels]; `None` without ink.

    Both come from the stronger half of its pixels, through a histogram of the chroma along the
    named colour in steps of a grey level.
    """
    counts, sums = np.zeros(512), np.zeros(512)
    for window in windows:
        along, across = (inner_part(plane, window) for plane in _chroma(rgb, pen, window))
        inked = (along > tuned.CHROMA_FLOOR) & (np.abs(across) < _gate() * along)
        level = along[inked].astype(np.int64)
        counts += np.bincount(level, minlength=512)
        sums += np.bincount(level, weights=across[inked], minlength=512)
    if not counts.any():
        return None
    levels = np.arange(512) + 0.5
    weak = levels < tuned.HALF * _quantile(levels, counts, 0.95)
    counts[weak] = sums[weak] = 0
    angle = float(np.arctan2(sums.sum(), counts @ levels))
    return pen.turned(angle), _quantile(levels, counts, 0.75) / np.cos(angle)


def _is_edge_of_another(rgb: NDArray, named: Pen, drawn: Pen, windows: list[Window]) -> bool:
    """Whether the ink belongs to a pen beyond the named pen's hues, of which JPEG spread some in.

    Such ink is measured near the edge of the named pen's hues. Around that hue there is more of it,
    and its mean then lies beyond the edge.
    """
    if abs(drawn.degrees_from(named)) < tuned.HUE_GATE_DEG / 2:
        return False
    again = _measured_pen(rgb, drawn, windows)
    return again is not None and abs(again[0].degrees_from(named)) > tuned.HUE_GATE_DEG


def _quantile(levels: NDArray, counts: NDArray, share: float) -> float:
    total = np.cumsum(counts)
    return float(levels[np.searchsorted(total, share * total[-1])])


def _without_other(along: NDArray, across: NDArray, other: NDArray) -> NDArray:
    """The pen's part of the chroma beside another pen, whose hue the picture shows there."""
    import cv2

    if not other.any():
        return along
    weight = other * (across / 255) ** tuned.PURITY_POWER
    reach = (0, 0), tuned.OTHER_REACH_PX
    other_along = cv2.GaussianBlur(weight * along, *reach)
    other_across = cv2.GaussianBlur(weight * across, *reach)
    is_mixed = (across * other_across > 0) & (np.abs(other_across) > tuned.MIN_OTHER)
    slope = other_along / np.where(is_mixed, other_across, 1)
    # The chroma across a nearly opposite hue is noise; `profiles` tells such lines apart.
    is_mixed &= slope >= -2
    return np.where(is_mixed, along - across * np.minimum(slope, 2), along)


def _mask(unmixed: NDArray, along: NDArray, across: NDArray, strength: float) -> Flags:
    """Ink above half of the strongest nearby, so that each line keeps its own width.

    More than the pen's own strength is noise of JPEG, and leaves the line beside it as it is.
    """
    import cv2

    inked = np.where(np.abs(across) < 1.5 * _gate() * along, unmixed, 0)
    smooth = cv2.GaussianBlur(inked, (0, 0), tuned.MASK_BLUR_PX)
    strongest = cv2.dilate(smooth, np.ones((tuned.LOCAL_PX, tuned.LOCAL_PX), np.uint8))
    level = np.minimum(strongest, strength)
    return (strongest > tuned.CHROMA_FLOOR) & (smooth > tuned.HALF * level)
