"""The planned slice -> the surgeon's curve, in sub-pixel points, or a refusal that says why."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.asked import (
    between,
    check_places,
    claim_inside,
    cut_off,
    outline_of,
    part_of,
    region_of,
    through,
)
from vfplan.curve.beside import intruders, pieces_beside, set_aside
from vfplan.curve.candidates import Candidate, candidates_of, refuse_crowd
from vfplan.curve.choice import against_advice, choose, refuse_grey, refuse_junctions
from vfplan.curve.covers import covered_ends
from vfplan.curve.doubts import a_bar, nearly_closed, several, side_by_side
from vfplan.curve.evidence import doubted_bridges, refuse_strayed, unexplained
from vfplan.curve.kinds import tell_apart
from vfplan.curve.marks import find_marks
from vfplan.curve.path import arc_length, drawn_length
from vfplan.curve.pen import Pen
from vfplan.curve.ridge import Centreline, trace
from vfplan.errors import CurveError, SettingError
from vfplan.images.read import PlannedImage, as_image

Method = Literal["ridge", "skeleton", "mask"]
METHODS: tuple[Method, ...] = ("ridge", "skeleton", "mask")


@dataclass(frozen=True, eq=False)
class Stroke:
    """One extracted line.

    Parameters
    ----------
    points_px
        (M, 2) float64 (u, v), in drawing order (an unordered set for method "mask").
    sigma_px
        (M,) standard deviation of each point across the line; `None` for a vector curve.
    closed
        Whether the last point joins the first.
    bridged
        (M,) bool, points carried across a pen lift or under something drawn over the line.
    length_px
        Arc length, the closing step included.
    width_px
        Mean width of the pen; `None` for a vector curve.
    """

    points_px: NDArray[np.float64]
    sigma_px: NDArray[np.float64] | None
    closed: bool
    bridged: NDArray[np.bool_]
    length_px: float
    width_px: float | None

    @property
    def ends_px(self) -> NDArray[np.float64]:
        """(2, 2) first and last point; (0, 2) for a closed line."""
        return np.zeros((0, 2)) if self.closed else self.points_px[[0, -1]]


@dataclass(frozen=True, eq=False)
class Extraction:
    """What was found on a slice.

    Parameters
    ----------
    mask
        (H, W) bool, the pixels in the pen's colour within `roi` and beside `exclude`; none of a
        vector curve.
    strokes
        The chosen lines, the longest first.
    method
        How they were measured.
    set_aside
        Marks in the pen's colour that were not taken for curves, and candidates not chosen: each a
        dict with `kind`, `box`, `length_px` and the number that chooses it, `stroke`. Specks are
        named just beyond a curve's end only.
    warnings
        What a person should know before trusting the result.
    ink
        The pixels of the mask by what they were taken for: "curve", or a kind as in `set_aside`.
    """

    mask: NDArray[np.bool_]
    strokes: tuple[Stroke, ...]
    method: Method | Literal["vector"]
    set_aside: tuple[dict, ...] = ()
    warnings: tuple[str, ...] = field(default=())
    ink: dict[str, int] = field(default_factory=dict)


def extract_curve(
    image: PlannedImage | NDArray,
    *,
    colour: str = "red",
    method: Method = "ridge",
    roi: tuple[int, int, int, int] | None = None,
    stroke: int | Literal["all", "longest"] | None = None,
    max_gap_px: float = 20.0,
    exclude: Sequence[tuple[int, int, int, int]] = (),
    start: tuple[float, float] | None = None,
    end: tuple[float, float] | None = None,
    accept_width: bool = False,
    outline: bool = False,
) -> Extraction:
    """Extract the planned curve from a slice.

    Parameters
    ----------
    image
        A `PlannedImage`, or an (H, W, 3) array of uint8 or uint16, red first.
    colour
        The pen: a CSS colour name or `#rrggbb`.
    method
        "ridge" measures the line's centre in coverage, "skeleton" thins the mask to pixels,
        "mask" takes every pixel of the chosen mark as the paper does.
    roi
        (u, v, width, height) px: look only there.
    stroke
        Which candidate: its number in the error message, counting from 1; "longest"; "all".
        `None` wants exactly one candidate. Numbers beyond the candidates' name lines that were
        set aside, as `stroke` in their entries says; one of them is taken with a warning.
    max_gap_px
        Pen lifts up to this long are bridged where both tangents agree.
    exclude
        Rectangles as `roi`, in which nothing is looked at.
    start, end
        (u, v) px on the curve: where it begins and ends, and so its direction. Of several
        candidates the one through them is taken.
    accept_width
        Take a run that is wider than the rest as one pen's, pressed harder.
    outline
        Take the outline of the one filled region.

    Raises
    ------
    CurveError
        No candidate, or too many marks to tell one; several and none chosen; the chosen one forks,
        crosses or touches itself, is two lines side by side, or is bridged or measured away from
        the ink that is seen.
    SettingError
        A parameter outside its range.
    """
    planned = as_image(image)
    _check(method, stroke, max_gap_px)
    given, rgb = [p for p in (start, end) if p is not None], planned.rgb
    if given or outline:
        check_places(method, stroke, given, outline)
    if roi is not None or len(exclude):
        rgb = part_of(rgb, roi, exclude)
    pen = Pen.of_colour(colour)
    marks, mask = find_marks(rgb, pen, colour)
    if not marks:
        refuse_grey(planned.rgb)
    candidates, others = tell_apart(candidates_of(marks, mask, max_gap_px, rgb), mask)
    told = [*candidates, *others]
    if outline:
        line, measured, notes = outline_of(rgb, region_of(marks), mask)
        both = [(line, measured)]
    else:
        refuse_crowd(candidates, others, marks, colour, max_gap_px)
        if given and stroke is None:
            candidates = through(candidates, np.array(given)) or candidates
        chosen = candidates
        if len(candidates) != 1 or stroke is not None:
            aside = set_aside(marks, told, candidates)
            chosen = choose(candidates, others, mask, stroke, colour, aside)
        for line in chosen:
            if line.junctions:
                refuse_junctions(line)
        both = [(c, _measure(rgb, c, method, mask)) for c in chosen]
        notes = against_advice(chosen, others, mask.shape) if others else []
    pieces, ink = pieces_beside(mask, both, told, marks)
    if outline:
        pieces = claim_inside(measured.points, pieces, ink)
    lines, asked = [line for line, _ in both], []
    for k, (line, whole) in enumerate(both):  # of ends that were cut off nothing more is said
        line, part = between(line, whole, start, end) if given else (line, whole)
        line, cut = cut_off(line, part, outline, roi, exclude, rgb.shape)
        both[k] = (line, whole)
        asked.append(_stroke(part, line))
        notes += cut
    specks, found = unexplained(both, pieces, mask, max_gap_px)
    notes += found
    for line, measured in both:
        if method == "ridge":
            notes += doubted_bridges(line, measured, mask, max_gap_px)
            refuse_strayed(line, measured)
            notes += intruders(line, measured, mask)
            notes += covered_ends(rgb, line, measured)
        notes += several(line, measured.single)
        notes += a_bar(line, pen)
        notes += side_by_side(line, measured.widening, accept_width)
        notes += nearly_closed(line, mask, max_gap_px)
    aside = set_aside(marks, told, lines, [*specks, *(p for p in pieces if p.kind == "offshoot")])
    return Extraction(mask, tuple(asked), method, aside, tuple(notes), ink)


def load_libraries() -> None:
    """Import what extraction needs, so that a measured time holds none of it."""
    for name in ("cv2", "scipy.interpolate", "scipy.ndimage", "scipy.spatial"):
        importlib.import_module(name)
    importlib.import_module("skimage.morphology").skeletonize  # noqa: B018 - loaded when named


def vector_stroke(points_px: NDArray, closed: bool, image: PlannedImage, where: str) -> Extraction:
    """A curve that was drawn as vectors on an image, as an `Extraction` with an empty mask.

    Raises `CurveError` when it does not lie in the image.
    """
    limit = np.array([image.width_px, image.height_px]) - 0.5
    outside = ((points_px < -0.5) | (points_px > limit)).any(1)
    if outside.any():
        u, v = points_px[np.argmax(outside)]
        raise CurveError(
            f"leaves the image of {image.width_px}x{image.height_px} px at ({u:.1f}, {v:.1f})",
            where=where,
        )
    length = float(arc_length(points_px, closed)[-1])
    none = np.zeros(len(points_px), bool)
    stroke = Stroke(points_px, None, closed, none, length, None)
    mask = np.zeros(image.rgb.shape[:2], bool)
    return Extraction(mask, (stroke,), "vector")


def _check(method: str, stroke: int | str | None, max_gap_px: float) -> None:
    if method not in METHODS:
        raise SettingError(f"method {method!r} is unknown; allowed: {', '.join(METHODS)}")
    if stroke not in (None, "all", "longest") and not (
        isinstance(stroke, int) and stroke is not True and stroke >= 1
    ):
        raise SettingError(f"stroke {stroke!r} is not 'all', 'longest' or a number from 1")
    if not 0 <= max_gap_px < float("inf"):
        raise SettingError(f"max gap {max_gap_px} px is not a finite number from 0")


def _measure(rgb: NDArray, candidate: Candidate, method: Method, mask: NDArray) -> Centreline:
    if method == "ridge":
        return trace(
            rgb,
            candidate.path,
            candidate.closed,
            candidate.bridged,
            candidate.mark.pen,
            candidate.width_px,
        )
    if method == "skeleton":
        sigma = np.full(len(candidate.path), 0.5)
        length = drawn_length(candidate.path, candidate.closed)
        return Centreline(candidate.path, sigma, candidate.bridged, candidate.closed, length)
    return _every_pixel(mask, candidate)


def _stroke(line: Centreline, candidate: Candidate) -> Stroke:
    return Stroke(
        line.points, line.sigma, line.closed, line.bridged, line.length, candidate.width_px
    )


def _every_pixel(mask: NDArray, candidate: Candidate) -> Centreline:
    import cv2

    _, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=8)
    own = {int(labels[m.branches[0].path[0][1], m.branches[0].path[0][0]]) for m in candidate.marks}
    rows, cols = np.nonzero(np.isin(labels, list(own)))
    points = np.column_stack([cols, rows]).astype(float)
    sigma = np.full(len(points), candidate.width_px / np.sqrt(12))
    none = np.zeros(len(points), bool)
    length = drawn_length(candidate.path, candidate.closed)
    return Centreline(points, sigma, none, candidate.closed, length)
