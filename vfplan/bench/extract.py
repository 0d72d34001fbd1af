"""Stage extract: methods x image scale x JPEG quality x pen width, against the drawn centre line.

Errors are distances from the true centre line in pixels of the slice at scale 1, so that a coarse
and a fine capture of one drawing compare. The baseline is what a user would write first: threshold
the hue, thin the mask.

Slices with a known planned curve: a pen's stroke painted by its exact share of every pixel.

The pen is a disc swept along the curve. A pixel's coverage is the share of its square within half
a pen's width of the centre line, counted on an 8 x 8 grid inside each pixel near the curve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from vfplan.bench.record import Array, BenchRun, Record, errors_of, timed
from vfplan.errors import CurveError

WIDTH_PX = 640
"""Width of the drawn slice at scale 1 [px]."""

HEIGHT_PX = 3 * WIDTH_PX // 4
"""Height of the drawn slice at scale 1 [px]."""

SUBPIXELS = 8
"""A pixel's coverage is counted on a grid of this many places along u and along v."""


def pen_slice(pen_px: float, quality: int | None = None, scale: float = 1.0) -> NDArray[np.uint8]:
    """(H, W, 3) uint8, red first: the bench's curve, drawn on a slice.

    pen_px: the pen's width at scale 1 [px]
    quality: JPEG quality with 4:2:0 chroma; `None`: lossless
    scale: pixels of the image for each pixel of the original: how fine the slice was captured
    """
    rgb = painted_slice(pen_px, scale)
    if quality is None:
        return rgb
    import cv2

    flags = [cv2.IMWRITE_JPEG_QUALITY, quality]
    flags += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
    _, data = cv2.imencode(".jpg", rgb[..., ::-1], flags)
    return np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])


@lru_cache(maxsize=32)
def painted_slice(pen_px: float, scale: float) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 before any JPEG; kept, since every quality begins with it."""
    shape = (round(HEIGHT_PX * scale), round(WIDTH_PX * scale))
    share = coverage(shape, to_pixels(curve(), scale), pen_px * scale)
    grey = grey_slice(shape, scale)[..., None]
    pen = np.array([226.0, 26.0, 32.0])
    painted = grey + share[..., None] * (pen - grey)
    rgb = np.clip(np.rint(painted), 0, 255).astype(np.uint8)
    rgb.setflags(write=False)
    return rgb


@lru_cache(maxsize=1)
def curve() -> Array:
    """(M, 2) the true centre line at scale 1 [px], 0.05 px apart: straight, wavy, bent tightly."""
    t = np.linspace(0, 1, 40_001)
    u = 70 + 430 * t + 45 * np.sin(2 * np.pi * t) * t
    v = 250 + 95 * np.sin(5.2 * t + 0.4) + 26 * np.sin(17 * t + 1.0) * t
    dense = np.column_stack([u, v])
    s = np.r_[0, np.cumsum(np.hypot(*np.diff(dense, axis=0).T))]
    even = np.arange(0, s[-1], 0.05)
    return np.column_stack([np.interp(even, s, u), np.interp(even, s, v)])


def to_pixels(points: Array, scale: float) -> Array:
    """Positions at scale 1 as those of the scaled image; a pixel's centre is a whole number."""
    return (points + 0.5) * scale - 0.5


def from_pixels(points: Array, scale: float) -> Array:
    """The inverse of `to_pixels`."""
    return (points + 0.5) / scale - 0.5


def coverage(shape: tuple[int, int], line: Array, width: float) -> Array:
    """(H, W) share of each pixel that a pen of `width` px along `line` (M, 2) covers."""
    from scipy.ndimage import distance_transform_edt
    from scipy.spatial import cKDTree

    # Only the pixels close to the line can hold ink.
    is_off_line = np.ones(shape, bool)
    u, v = np.rint(line).astype(int).T
    is_off_line[v, u] = False
    rows, cols = np.nonzero(distance_transform_edt(is_off_line) <= width / 2 + 2)

    # Of each of these, the share of its inner places that the pen covers.
    offset = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    du = np.tile(offset, SUBPIXELS)
    dv = np.repeat(offset, SUBPIXELS)
    inner = np.column_stack([(cols[:, None] + du).ravel(), (rows[:, None] + dv).ravel()])
    distance, _ = cKDTree(line).query(inner, distance_upper_bound=width / 2 + 1)
    share = np.zeros(shape)
    share[rows, cols] = (distance <= width / 2).reshape(len(rows), -1).mean(axis=1)
    return share


@lru_cache(maxsize=8)
def grey_slice(shape: tuple[int, int], scale: float) -> Array:
    """(H, W) grey 0..255: soft tissue, two bright-rimmed bones, fine noise; the same every time."""
    from scipy.ndimage import gaussian_filter

    v, u = np.mgrid[0 : shape[0], 0 : shape[1]] / scale
    grey = 105 + 45 * np.sin(u / 83 + 1) * np.cos(v / 61)
    for centre, size in (((190, 150), 88), ((430, 330), 70)):
        depth = size - np.hypot(u - centre[0], 1.2 * (v - centre[1]))
        grey = np.where(depth > 0, 140 + 95 * np.exp(-((depth / 7) ** 2)), grey)
    rng = np.random.default_rng(3)
    return np.clip(gaussian_filter(grey, 0.8) + rng.normal(0, 2.5, shape), 5, 250)


def scenes(quick: bool, tolerance_m: float) -> Iterator[list[BenchRun]]:
    """The runs of each pen and quality; the tolerance has no say here."""
    scales = [0.5, 0.75, 1.0, 1.5, 2.0]
    pens_px = [1.5, 3.0, 5.0]
    qualities = [None, 90, 75, 50]
    if quick:
        scales = [0.5, 1.0]
        pens_px = [3.0]
        qualities = [None, 75]
    for pen_px in pens_px:
        for quality in qualities:
            scene = f"pen {pen_px:g} px, lossless"
            if quality is not None:
                scene = f"pen {pen_px:g} px, JPEG {quality}"
            runs = []
            for scale in scales:
                picture = pen_slice(pen_px, quality, scale)
                score = partial(score_points, truth=curve(), scale=scale)
                for method, extract in METHODS.items():
                    run = partial(timed, partial(extract, picture))
                    # The chosen setting is the slice as it is.
                    chosen = method == "ridge" and scale == 1
                    settings = {"scale": scale}
                    runs.append(BenchRun(scene, method, settings, run, score, "px", chosen))
            yield runs


def score_points(points_px: Array, truth: Array, scale: float) -> Record:
    """Distances of extracted points from the true line, and of the line from them [px]."""
    points = from_pixels(points_px, scale)
    distances = from_line(points, truth, cKDTree(truth).query(points)[1])
    uncovered, _ = cKDTree(points).query(truth[::5])
    return errors_of(distances, uncovered_px=float(uncovered.max()), points=len(points))


def from_line(points: Array, line: Array, nearest: Array) -> Array:
    """(N,) distances of (N, 2) points from a polyline whose `nearest` vertex (N,) is known."""
    distances = np.full(len(points), np.inf)
    for first in (nearest - 1, nearest):
        first = np.clip(first, 0, len(line) - 2)
        a = line[first]
        along = line[first + 1] - a
        share = ((points - a) * along).sum(1) / (along**2).sum(1)
        foot = a + np.clip(share, 0.0, 1.0)[:, None] * along
        distances = np.minimum(distances, np.hypot(*(points - foot).T))
    return distances


def extract_points(picture: Any, method: str) -> Array:
    """The points that `vfplan.extract_curve` gives [px]."""
    from vfplan.curve.extraction import extract_curve

    strokes = extract_curve(picture, method=method, stroke="longest").strokes
    return np.concatenate([stroke.points_px for stroke in strokes])


def thin_hue_mask(picture: Any) -> Array:
    """A gate on hue and saturation, then thinning: the first recipe that a search finds."""
    import cv2
    from skimage.morphology import skeletonize

    hue, saturation, value = cv2.split(cv2.cvtColor(picture, cv2.COLOR_RGB2HSV))
    mask = ((hue < 10) | (hue > 170)) & (saturation > 100) & (value > 80)
    if not mask.any():
        raise CurveError("no pixel passes the gate on hue. Draw in red", code="no-hue")
    v, u = np.nonzero(skeletonize(mask))
    return np.column_stack([u, v]).astype(float)


METHODS: dict[str, Callable[[Any], Array]] = {
    "ridge": partial(extract_points, method="ridge"),
    "skeleton": partial(extract_points, method="skeleton"),
    "mask (the paper's)": partial(extract_points, method="mask"),
    "hue + thinning": thin_hue_mask,
}
