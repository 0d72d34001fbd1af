"""Stage extract: methods x image scale x JPEG quality x pen width, against the drawn centre line.

Errors are distances from the true centre line in pixels of the slice at scale 1, so that a coarse
and a fine capture of one drawing compare. The baseline is what a user would write first: threshold
the hue, thin the mask.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from vfplan.bench import pictures
from vfplan.bench.record import Array, Record, Trial, errors_of, timed
from vfplan.errors import CurveError

SCALES = {True: (0.5, 1.0), False: (0.5, 0.75, 1.0, 1.5, 2.0)}
PENS = {True: (3.0,), False: (1.5, 3.0, 5.0)}
QUALITIES = {True: (None, 75), False: (None, 90, 75, 50)}
DEFAULT_SCALE = 1.0


def scenes(quick: bool, tolerance_m: float) -> Iterator[list[Trial]]:
    """The trials of each pen and quality; the tolerance has no say here."""
    for pen in PENS[quick]:
        for quality in QUALITIES[quick]:
            yield list(_trials(pen, quality, SCALES[quick]))


def _trials(pen: float, quality: int | None, scales: tuple[float, ...]) -> Iterator[Trial]:
    name = f"pen {pen:g} px, " + ("lossless" if quality is None else f"JPEG {quality}")
    for scale in scales:
        picture = pictures.picture(pen, quality, scale)
        score = partial(_score, truth=pictures.curve(), scale=scale)
        for method, extract in METHODS.items():
            run, chosen = partial(timed, partial(extract, picture)), scale == DEFAULT_SCALE
            yield Trial(
                name, method, {"scale": scale}, run, score, "px", chosen and method == "ridge"
            )


def _score(found: Array, truth: Array, scale: float) -> Record:
    """Distances of the points found from the true line, and of the line from them [px]."""
    points = pictures.from_pixels(found, scale)
    away = from_line(points, truth, cKDTree(truth).query(points)[1])
    missed, _ = cKDTree(points).query(truth[::5])
    return errors_of(away, uncovered_px=float(missed.max()), points=len(points))


def from_line(points: Array, line: Array, nearest: Array) -> Array:
    """(N,) distances of (N, 2) points from a polyline of which they know the `nearest` vertex."""
    found = np.full(len(points), np.inf)
    for start in (nearest - 1, nearest):
        start = np.clip(start, 0, len(line) - 2)
        a, way = line[start], line[start + 1] - line[start]
        share = ((points - a) * way).sum(1) / (way**2).sum(1)
        foot = a + np.clip(share, 0.0, 1.0)[:, None] * way
        found = np.minimum(found, np.hypot(*(points - foot).T))
    return found


def _ours(method: str) -> Callable[[Any], Array]:
    def extract(picture: Any) -> Array:
        from vfplan.curve import extract_curve

        strokes = extract_curve(picture, method=method, stroke="longest").strokes
        return np.concatenate([s.points_px for s in strokes])

    return extract


def _hue_and_thinning(picture: Any) -> Array:
    """A gate on hue and saturation, then thinning: the first recipe that a search finds."""
    import cv2
    from skimage.morphology import skeletonize

    hue, saturation, value = cv2.split(cv2.cvtColor(picture, cv2.COLOR_RGB2HSV))
    mask = ((hue < 10) | (hue > 170)) & (saturation > 100) & (value > 80)
    if not mask.any():
        raise CurveError("no pixel passes the gate on hue")
    v, u = np.nonzero(skeletonize(mask))
    return np.column_stack([u, v]).astype(float)


METHODS: dict[str, Callable[[Any], Array]] = {
    "ridge": _ours("ridge"),
    "skeleton": _ours("skeleton"),
    "mask (the paper's)": _ours("mask"),
    "hue + thinning": _hue_and_thinning,
}
