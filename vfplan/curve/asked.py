"""What a person asks for: a part of the slice, the curve's two ends, a filled region's outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.beside import Piece
from vfplan.curve.candidates import Candidate
from vfplan.curve.marks import Mark
from vfplan.curve.path import arc_length, evenly
from vfplan.curve.pen import Pen
from vfplan.curve.ridge import Centreline
from vfplan.errors import CurveError, SettingError

NEAR_WIDTHS, NEAR_PX = 3.0, 10.0  # from the line: a place farther off is not meant to be on it
NEAR_BORDER, ALONG = 1.5, 2.0  # widths from a border to the end that it cuts; widths along it
BORDER_PX = 1.0  # from a border, an outline that it cuts
# Of an outline, where half of a pixel's square is covered.
MARGIN_PX = 3
SMOOTH_PX = 1.5  # along the outline: the pixels' own staircase
SIGMA_PX = 0.1  # at least: an edge has one side only, and programs differ in how they fill

Place = tuple[float, float] | None
Box = tuple[int, int, int, int]


def check_places(method: str, stroke: int | str | None, given: list, outline: bool) -> None:
    """Raise `SettingError` for places or an outline that the other settings leave no meaning."""
    if given and (method == "mask" or stroke == "all"):
        raise SettingError(
            "a start or end wants one curve in order; method 'mask' and stroke 'all' have none"
        )
    if outline and (method != "ridge" or stroke is not None):
        raise SettingError("an outline has no method and no stroke to choose; leave them out")


def part_of(rgb: NDArray, roi: Box | None, exclude: Sequence[Box]) -> NDArray:
    """The picture without colour in what is excluded, and around the region."""
    import cv2

    rows, cols = rgb.shape[:2]
    for box in (*([] if roi is None else [roi]), *exclude):
        if np.shape(box) != (4,) or np.asarray(box).dtype.kind not in "iu":
            raise SettingError(f"region {box} is not u, v, width, height in whole pixels")
        u, v, width, height = box
        inside = u >= 0 and v >= 0 and width > 0 and height > 0 and u + width <= cols
        if not (inside and v + height <= rows):
            raise SettingError(f"region {u},{v},{width},{height} does not lie in {cols}x{rows} px")
    looked_at = np.zeros((rows, cols), bool)
    for (u, v, width, height), kept in (
        ((0, 0, cols, rows) if roi is None else roi, True),
        *((box, False) for box in exclude),
    ):
        looked_at[v : v + height, u : u + width] = kept
    grey = cv2.transform(rgb, np.full((1, 3), 1 / 3))
    return np.where(looked_at[..., None], rgb, grey[..., None])


def cut_off(
    line: Candidate,
    found: Centreline,
    outline: bool,
    roi: Box | None,
    exclude: Sequence[Box],
    shape: tuple[int, ...],
) -> tuple[Candidate, list[str]]:
    """The line, its ends on a border of what is looked at `cut`, and a warning for each of them.

    And one for each border along which its measured points run. An outline has no ends, and the
    picture's own border may cut it too.
    """
    boxes = [("excluded", box) for box in exclude] + ([] if roi is None else [("region", roi)])
    boxes += [("picture", (0, 0, shape[1], shape[0]))] if outline else []
    points, width = found.points[~found.bridged], 0.0 if outline else line.width_px
    cut, warnings = np.array(line.cut), []
    for name, box in boxes:
        border = f"the border of the {name} {','.join(map(str, box))}"
        ends, beside = (
            _from_border(at, box, shape, name == "picture") for at in (line.path[[0, -1]], points)
        )
        met, along = ends < NEAR_BORDER * width, points[beside < max(width / 2, BORDER_PX)]
        if met.any() and not line.closed:
            at = line.path[[0, -1]][met & ~cut]
            warnings += [f"the curve ends at ({u:.0f}, {v:.0f}) on {border}" for u, v in at]
            cut |= met
        elif len(along) > ALONG * width:
            u, v = along[len(along) // 2]
            over = f"for {len(along)} px, around ({u:.0f}, {v:.0f})"
            warnings.append(f"the curve runs along {border} {over}")
    told = [f"{each}: what lies beyond is cut off" for each in warnings]
    return replace(line, cut=tuple(cut)), told


def _from_border(
    points: NDArray, box: Box, shape: tuple[int, ...], own: bool
) -> NDArray[np.float64]:
    """(M,) how far points (M, 2) lie from a box's border; the picture's own only counts as such."""
    size, low, high = shape[1::-1], np.array(box[:2]), np.add(box[:2], box[2:])
    if not own:
        low, high = np.where(low > 0, low, -np.inf), np.where(high < size, high, np.inf)
    return np.abs(np.maximum(low - 0.5 - points, points - high + 0.5).max(1))


def through(candidates: list[Candidate], places: NDArray) -> list[Candidate]:
    """The candidates that pass by all of the places [px]."""
    return [c for c in candidates if all(_distance(c.path, p) <= _reach(c) for p in places)]


def between(
    line: Candidate, found: Centreline, start: Place, end: Place
) -> tuple[Candidate, Centreline]:
    """The measured line from `start` to `end` (u, v) [px], in that direction; its lost ends `cut`.

    One of them alone gives the direction, and cuts off what lies beyond it; on a ring `start` says
    where it begins.

    Raises CurveError: a place lies off the line; both are the same place; an `end` was given for a
        ring
    """
    if found.closed:
        if end is not None:
            raise CurveError("the curve is closed and has no end; leave --end out")
        return line, _rolled(found, -_index(line, found, start, "--start"))
    last = len(found.points) - 1
    first = None if start is None else _index(line, found, start, "--start")
    stop = None if end is None else _index(line, found, end, "--end")
    if first is None:
        first = 0 if stop > last / 2 else last
    if stop is None:
        stop = last if first < last / 2 else 0
    if first == stop:
        raise CurveError("--start and --end lie on the same point of the curve")
    keep = np.arange(min(first, stop), max(first, stop) + 1)
    keep = keep if first < stop else keep[::-1]
    points = found.points[keep]
    length = float(arc_length(points, False)[-1])
    sigma, bridged = found.sigma[keep], found.bridged[keep]
    lost = (_distance(points[[0, -1]], at) > _reach(line) for at in found.points[[0, -1]])
    part = replace(found, points=points, sigma=sigma, bridged=bridged, length=length)
    return replace(line, cut=tuple(lost)), part


def _rolled(found: Centreline, by: int) -> Centreline:
    names = ("points", "sigma", "bridged")
    return replace(found, **{name: np.roll(getattr(found, name), by, axis=0) for name in names})


def _index(line: Candidate, found: Centreline, place: Place, option: str) -> int:
    away = _distance(found.points, place)
    if away > _reach(line):
        raise CurveError(
            f"{option} {place[0]:g},{place[1]:g} lies {away:.0f} px off the curve; at most "
            f"{_reach(line):.0f} px are allowed"
        )
    return int(np.hypot(*(found.points - place).T).argmin())


def _distance(points: NDArray, place: NDArray) -> float:
    return float(np.hypot(*(points - place).T).min())


def _reach(line: Candidate) -> float:
    return max(NEAR_WIDTHS * line.width_px, NEAR_PX)


def region_of(marks: list[Mark]) -> Mark:
    """The one filled region; raises `CurveError` for none or several."""
    filled = [m for m in marks if m.kind == "panel"]
    if len(filled) != 1:
        places = ", ".join(f"({m.box[0]}, {m.box[1]})" for m in filled[:6])
        raise CurveError(
            f"--outline wants one filled region, found {len(filled)}"
            + (f" at {places}; look in a part of the image (--roi, --exclude)" if filled else "")
        )
    return filled[0]


def outline_of(
    rgb: NDArray, mark: Mark, mask: NDArray[np.bool_]
) -> tuple[Candidate, Centreline, list[str]]:
    """The outer outline of a filled mark of the (H, W) mask, and a warning where it has holes."""
    import cv2
    from scipy.ndimage import gaussian_filter1d
    from skimage.measure import find_contours

    u, v, width, height = mark.box
    top, left = max(v - MARGIN_PX, 0), max(u - MARGIN_PX, 0)
    box = (slice(top, v + height + MARGIN_PX), slice(left, u + width + MARGIN_PX))
    _, label = cv2.connectedComponents(mask[box].view(np.uint8), connectivity=8)
    inside = mark.branches[0].path[len(mark.branches[0].path) // 2] - [left, top]
    own = (label == label[inside[1], inside[0]]).view(np.uint8)
    near = cv2.dilate(own, np.ones((3, 3), np.uint8)) > 0
    alpha = np.where(near, _coverage(rgb[box], mark.pen), 0.0)
    rings = sorted(find_contours(np.pad(alpha, 1), 0.5), key=lambda c: -abs(_area(c)))
    ring = rings[0][:-1] if _area(rings[0]) > 0 else rings[0][:0:-1]
    even, _ = evenly(ring[:, ::-1] - 1, True)
    smooth = gaussian_filter1d(even, SMOOTH_PX, axis=0, mode="wrap")
    sigma = np.full(len(even), np.hypot(SIGMA_PX, np.sqrt(((even - smooth) ** 2).mean())))
    points = np.roll(smooth, -int(smooth.sum(1).argmin()), 0) + np.array([left, top])
    none = np.zeros(len(points), bool)
    line = Centreline(points, sigma, none, True, float(arc_length(points, True)[-1]))
    holes = sum(abs(_area(c)) > 1 for c in rings[1:])
    warnings = [f"the filled region has {holes} holes; its outer outline is taken"] if holes else []
    return Candidate(points, True, none, (mark,)), line, warnings


def claim_inside(outline: NDArray, pieces: list[Piece], ink: dict[str, int]) -> list[Piece]:
    """The pieces without a region's own inside, which is counted as the curve's ink."""
    import cv2

    ring, beside = outline.astype(np.float32), []
    for piece in pieces:
        place = piece.pixels[0].tolist()
        if piece.kind == "own" and cv2.pointPolygonTest(ring, place, False) > 0:
            ink["own"] -= len(piece.pixels)
            ink["curve"] += len(piece.pixels)
        else:
            beside.append(piece)
    return beside


def _coverage(rgb: NDArray, pen: Pen) -> NDArray[np.float64]:
    return rgb @ pen.along * (255.0 / np.iinfo(rgb.dtype).max) / pen.strength


def _area(contour: NDArray) -> float:
    """Of a closed (row, column) contour: above 0 where it runs clockwise as seen."""
    import cv2

    return cv2.contourArea(contour[:, ::-1].astype(np.float32), oriented=True)
