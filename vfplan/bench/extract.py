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
from vfplan.bench.record import Array, BenchRun, Record, errors_of, timed
from vfplan.errors import CurveError


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
                picture = pictures.picture(pen_px, quality, scale)
                score = partial(score_points, truth=pictures.curve(), scale=scale)
                for method, extract in METHODS.items():
                    run = partial(timed, partial(extract, picture))
                    # The chosen setting is the slice as it is.
                    chosen = method == "ridge" and scale == 1
                    settings = {"scale": scale}
                    runs.append(BenchRun(scene, method, settings, run, score, "px", chosen))
            yield runs


def score_points(points_px: Array, truth: Array, scale: float) -> Record:
    """Distances of extracted points from the true line, and of the line from them [px]."""
    points = pictures.from_pixels(points_px, scale)
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
    from vfplan.curve import extract_curve

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
