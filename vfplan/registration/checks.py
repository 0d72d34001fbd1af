"""The reasons to refuse a registration, and what a person should look at before it is used.

`refuse_wrong_markers` is the gate: labels that are mistaken, residuals that no marker has, a scale
that is another unit. `registration_findings` lists the rest. Nothing is repaired.

- Scale: what the markers give, held against what is known.
- Angle: a camera that looks at a plane from the side sees a homography of it (R. Hartley and
  A. Zisserman, "Multiple view geometry in computer vision", 2004, ch. 8), with two parameters more
  than an affine map. No model here follows them, and no error bound counts them.
- Labels: two orders of them are compared by the ratio of the sums of squares that they leave. For
  two orders that are equally good it is F-distributed with ν and ν degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, permutations
from typing import Any

import numpy as np

from vfplan.display import Report, coordinates
from vfplan.errors import CheckFailed, MarkerError
from vfplan.findings import Finding, doubt, note
from vfplan.fixture import Fixture
from vfplan.geometry.lines import Array, homogeneous, plane_normal, rms_length, row_lengths
from vfplan.registration.models import (
    GOOD_SET_PROBABILITY,
    RARE_PROBABILITY,
    Affine,
    Orthogonal,
    Problem,
    f_exceeds,
    fit_model,
    fit_similarity,
    marker_rows,
    most_off,
)
from vfplan.registration.registration import (
    Registration,
    TargetError,
    describe_side,
    outlier_findings,
    single_outlier,
)

# Largest scale over the known scale. More is another unit or another picture, not a printer's
# stretch.
MAX_RATIO = 2.0

# A scale that departs by less than half a per cent moves a marker by less than half a millimetre.
DEPARTURE = 0.005

# A scale departs from the known one by chance if it does by less than four standard errors.
STANDARD_ERRORS = 4.0

# An affine map may show this much stretch: a camera that looks on at 25 degrees makes it.
MAX_STRETCH = 1.1


def scale_departures(registration: Registration) -> list[tuple[float, float]]:
    """(scale over the known scale minus 1, its standard error), one each along u and v if affine.

    Of a rigid registration: what its scale would be if it were free. Empty where no scale is known.
    """
    fit = registration
    problem = registration.problem
    k = problem.model.dimension
    if k == 2 and registration.pixel_spacing is None:
        return []
    if registration.model == "rigid":
        fit = fit_similarity(problem, fit.used)
    axes = k if registration.model == "affine" else 1
    radius = problem.normaliser.radius
    covariance = fit.covariance_m.reshape(3, k + 1, 3, k + 1)
    departures = []
    for axis in range(axes):
        column = fit.m[:, axis]
        length = float(np.linalg.norm(column))
        variance = column @ covariance[:, axis, :, axis] @ column / length**2
        departures.append((length / radius - 1, float(np.sqrt(max(variance, 0.0))) / radius))
    return departures


def scale_findings(registration: Registration) -> Iterator[Finding]:
    """A scale that departs from the known one by more than its error, or that nothing checks."""
    departures = scale_departures(registration)
    if not departures:
        pixel_m2 = np.linalg.norm(plane_normal(registration.T_target_source[:3]))
        pixel_mm = 1e3 * float(np.sqrt(pixel_m2))
        text = (
            "The pixel size is not known, so the scale was not checked: one pixel is "
            f"{pixel_mm:.3g} mm by the markers. Give --pixel-spacing MM if you know it."
        )
        yield note("scale-unchecked", "register", text)
        return
    departure, standard_error = max(departures, key=lambda pair: abs(pair[0]))
    if abs(departure) <= max(DEPARTURE, STANDARD_ERRORS * standard_error):
        return
    text = (
        f"The markers give a scale that departs by {departure:+.2%} from the known one (standard "
        f"error {standard_error:.2%}). Check the pixel spacing."
    )
    yield doubt("scale-departs", "register", text)


def stretch_findings(registration: Registration) -> Iterator[Finding]:
    """Pixels that are not square, or not of the given ratio, where the model or a user says so.

    By the F test of an affine map against a similarity.
    """
    problem, used = registration.problem, registration.used
    affine = Affine(2)
    if problem.model.dimension != 2 or 3 * used.sum() <= affine.parameters:
        return
    free = fit_model(replace(problem, model=affine), used)
    square = fit_similarity(problem, used) if registration.model == "affine" else registration
    long, short = np.linalg.svd(free.m[:, :2], compute_uv=False)
    if registration.model == "affine" and long < MAX_STRETCH * short:
        return
    free_squares = max(free.variance * free.dof, problem.rounding_floor_m**2)
    square_squares = square.variance * square.dof
    more = square.dof - free.dof
    f = ((square_squares - free_squares) / more) / (free_squares / free.dof)
    if f_exceeds(more, free.dof, max(f, 0.0)) > RARE_PROBABILITY:
        return
    text = (
        f"By the markers a pixel is {long / short:.3g} times as long as wide. Look for a column "
        "in another unit, or for another --pixel-spacing or --model."
    )
    yield doubt("pixels-stretched", "register", text)


# Good markers show so much perspective once in 200 sets: it wants an answer.
SURE_PERSPECTIVE = 1 / 200

# The same of five markers: one bad marker among five looks like perspective once in 10,000 sets.
SURE_BY_FIVE = 1e-5

# Good markers show so much perspective once in ten sets: it is a note. With a smaller probability
# more sets of a slice tilted by 1 or 2 degrees would pass, although their bound does not hold.
POSSIBLE_PERSPECTIVE = 0.1


# How a message says what makes a photograph flat; `vfplan plan` puts the whole command there.
TO_RECTIFY = "with vfplan rectify"


@dataclass(frozen=True, eq=False)
class PerspectiveTest:
    """Whether a homography explains planar markers better than an affine map does."""

    # Probability that good markers show as much perspective.
    p_value: float
    # RMS localisation error of a marker under the homography [m].
    fle_rms_m: float
    # Largest distance between the homography and the affine map at a marker [m].
    departure_m: float
    # Whether the probability is small, and no single bad marker explains the residuals as well.
    is_significant: bool
    # The marker without which the homography fits better than chance explains, and how well [m].
    outlier: tuple[int, float] | None

    @property
    def is_possible(self) -> bool:
        """Whether a person should think of it."""
        return self.is_significant or self.p_value < POSSIBLE_PERSPECTIVE

    def advice(self, labels: Sequence[Any], also: str = "") -> str:
        """What the homography leaves, and what to do; also: what else leaves how much."""
        text = (
            "The slice seems to be photographed at an angle: a homography leaves "
            f"{_mm(self.fle_rms_m)} a marker{also}. "
        )
        if self.outlier is None:
            return f"{text}Make it flat {TO_RECTIFY}"
        index, others_m = self.outlier
        return (
            f"{text}It leaves {_mm(others_m)} without {labels[index]}: touch that again, or leave "
            f"it out (delete its row, and give --common), and make it flat {TO_RECTIFY}"
        )


@lru_cache(1)
def perspective_test(registration: Registration, fewest: int = 6) -> PerspectiveTest | None:
    """F test of the two parameters that a homography has more than an affine map.

    `None` for markers in space, for fewer than `fewest`, and for an exact fit. All markers count,
    also those that a robust fit left out. Five leave hardly a residual to judge good markers by.
    """
    problem = registration.problem
    n = len(problem.s)
    if problem.model.dimension != 2 or n < fewest:
        return None
    affine = fit_model(replace(problem, model=Affine(2)))
    affine_squares = affine.variance * affine.dof
    if not affine_squares > n * problem.rounding_floor_m**2:
        return None
    h = fit_homography(problem, affine.m)
    if not (1 + problem.s @ h[9:] > 0).all():
        return None  # A marker would lie behind the camera.

    mapped = mapped_by_homography(h, problem.s)
    dof = 3 * n - len(h)
    errors = np.sqrt(problem.weights) * (problem.y - mapped)
    rows = homography_rows(h, problem).reshape(n, 3, -1)
    worst, _, square, probability = most_off(rows, errors, problem.rounding_floor_m**2)
    squares = max(float((errors**2).sum()), problem.rounding_floor_m**2)
    f = max(affine_squares - squares, 0.0) / 2 / (squares / dof)
    p_value = float(f_exceeds(2, dof, f))
    sure = SURE_BY_FIVE if n == MIN_FOR_HOMOGRAPHY else SURE_PERSPECTIVE

    # The probability that any marker of a good set is as much of an outlier as the worst one here.
    f_of_markers = np.nan_to_num(affine.studentised_f)
    outlier_probability = n * float(f_exceeds(3, affine.dof - 3, f_of_markers.max()))
    return PerspectiveTest(
        p_value=p_value,
        fle_rms_m=float(np.sqrt(3 * squares / dof)),
        departure_m=float(row_lengths(mapped - problem.x @ affine.m.T).max()),
        is_significant=p_value < min(sure, outlier_probability),
        outlier=(worst, float(np.sqrt(3 * square))) if probability <= SURE_PERSPECTIVE else None,
    )


# Four markers determine a homography and leave no residual in the sheet.
MIN_FOR_HOMOGRAPHY = 5


def fit_homography(problem: Problem, m: Array) -> Array:
    """(11,) the homography of least weighted squares: row-major M, then q of 1 + q·s.

    By Gauss-Newton from the affine map M (3, 3).
    """
    h = np.append(m, [0.0, 0.0])
    for _ in range(30):
        error = np.sqrt(problem.weights) * (problem.y - mapped_by_homography(h, problem.s))
        step = np.linalg.lstsq(homography_rows(h, problem), error.ravel(), rcond=None)[0]
        h = h + step
        if np.abs(step[9:]).max() < 1e-12:
            break
    return h


def homography_rows(h: Array, problem: Problem) -> Array:
    """(3N, 11) how the weighted positions of the markers move with the numbers of a homography."""
    depth = (1 + problem.s @ h[9:])[:, None, None]
    mapped = mapped_by_homography(h, problem.s)
    linear = marker_rows(problem.x).reshape(len(problem.s), 3, 9) / depth
    bend = -mapped[:, :, None] * problem.s[:, None, :] / depth
    rows = np.concatenate([linear, bend], axis=2) * np.sqrt(problem.weights)[:, :, None]
    return rows.reshape(-1, len(h))


def mapped_by_homography(h: Array, s: Array) -> Array:
    """(N, 3) positions M x~ / (1 + q·s) of s (N, 2), for row-major M and then q in h (11,)."""
    return homogeneous(s) @ h[:9].reshape(3, 3).T / (1 + s @ h[9:])[:, None]


# Another order of the labels is sure, and refused, if it fits better by an F of this probability.
# Of 10,000 sets of good markers none is refused by it (docs/make_registration_table.py).
SURE_MISTAKE = 5e-6

# Both of two exchanged markers are among the 12 of largest residual, for a mistake is large.
MAX_SUSPECTS = 12

# Of four markers all 24 orders of the labels are compared; five would have 120.
MAX_FOR_EVERY_ORDER = 4


@dataclass(frozen=True)
class LabelMistake:
    """Another order of the same labels."""

    # (N,) source marker i belongs to the target marker `order[i]`.
    order: tuple[int, ...]
    # What it does to the given order, as a verb: "exchanged", "reversed", "shifted", ...
    action: str
    # RMS residual that it leaves [m].
    fre_rms_m: float
    # Probability that good markers fit another order so much better.
    p_value: float

    @property
    def moved(self) -> list[int]:
        """The markers whose labels it changes."""
        return [i for i, j in enumerate(self.order) if i != j]

    def sentence(self, labels: Sequence[str | int]) -> str:
        """What seems to have happened, and how well the markers fit without it."""
        moved = [str(labels[i]) for i in self.moved]
        names = ", ".join(moved if len(moved) <= 4 else [*moved[:4], "..."])
        if len(moved) == 2:
            names = " and ".join(moved)
        return (
            f"The labels {names} seem {self.action}. In the other order all markers fit to "
            f"{_mm(self.fre_rms_m)}"
        )

    def refusal(self, registration: Registration, advice: str) -> CheckFailed:
        """The error that refuses the labels as they are given."""
        labels = registration.labels
        return CheckFailed(
            f"{self.sentence(labels)} (as given: {_mm(registration.fre_rms_m)}). {advice}",
            code="labels-mistaken",
            numbers={
                "fre_rms_m": registration.fre_rms_m,
                "fre_rms_m_corrected": self.fre_rms_m,
                "p_value": self.p_value,
                "action": self.action,
                "labels": [labels[j] for j in self.order],
            },
        )


@lru_cache(1)
def label_mistake(registration: Registration) -> LabelMistake | None:
    """The likeliest of the usual mistakes with labels; `None` where the given labels are right.

    That is where they fit better than every other order by an F that equally good orders reach once
    in a hundred sets.
    """
    everyone = registration.problem
    judge = everyone
    if registration.pixel_spacing is not None and isinstance(everyone.model, Affine):
        # Four or five markers fit an affine map in almost any order. The true map is close to a
        # similarity where the pixel spacing is known.
        judge = replace(everyone, model=Orthogonal(2, None))
    n = len(everyone.s)
    dof = 3 * n - judge.model.parameters

    # Two markers may be exchanged if both are among those that fit worst.
    squares = (judge.weights * fit_model(judge).vectors ** 2).sum(axis=1)
    suspects = np.sort(np.argsort(-squares, kind="stable")[:MAX_SUSPECTS])
    orders = usual_orders(n, suspects.tolist())
    if not orders:
        return None

    # Weighted sums of squared residuals [m²] with the targets in each order.
    index = np.array([tuple(range(n)), *orders])
    y, weights = judge.y[index], judge.weights[index]
    s = np.broadcast_to(judge.s, (len(index), *judge.s.shape))
    m = judge.model.solve(s, y, weights)
    squares = weights * (y - judge.x @ np.swapaxes(m, -1, -2)) ** 2
    as_given, *others = np.maximum(squares.sum(axis=(1, 2)), judge.rounding_floor_m**2)
    best = int(np.argmin(others))
    if f_exceeds(dof, dof, others[best] / as_given) <= GOOD_SET_PROBABILITY:
        return None
    order, action = list(orders.items())[best]
    index = np.array(order)
    corrected = replace(everyone, y=everyone.y[index], weights=everyone.weights[index])
    p_value = float(f_exceeds(dof, dof, as_given / others[best]))
    return LabelMistake(order, action, rms_length(fit_model(corrected).vectors), p_value)


def usual_orders(n: int, suspects: Sequence[int]) -> dict[tuple[int, ...], str]:
    """The orders that people mistake for the right one, with what was done to the labels.

    n: number of markers
    suspects: markers of which two may be exchanged
    """
    forward = np.arange(n)
    orders = {}

    def add(action: str, order: Array) -> None:
        orders[tuple(order.ravel().tolist())] = action

    if n <= MAX_FOR_EVERY_ORDER:
        orders = dict.fromkeys(permutations(range(n)), "reordered")
    for rows in range(2, n // 2 + 1):
        if n % rows == 0:
            grid = forward.reshape(rows, -1)
            add("transposed", grid.T)
            add("reversed by rows", grid[::-1])
            add("reversed by columns", grid[:, ::-1])
    for shift in range(1, n):
        add("reversed and shifted", np.roll(forward[::-1], shift))
        add("shifted", np.roll(forward, shift))
    add("reversed", forward[::-1])
    for pair in combinations(suspects, 2):
        exchanged = forward.copy()
        exchanged[[*pair]] = pair[::-1]
        add("exchanged", exchanged)
    orders.pop(tuple(range(n)), None)
    return orders


# A marker with so large a share in its own prediction can be wrong and leave hardly a residual.
UNCHECKED_LEVERAGE = 0.9

# With so large a share a marker's error of 20 mm leaves less than 1 mm among ten markers.
DECISIVE_LEVERAGE = 0.98

# RMS residual of a similarity [m] that markers touched with care do not exceed; as --max-residual.
UNSTRETCHED_RESIDUAL_M = 1e-3

# Share of the curve that may lie beyond the markers before a person has to look.
EXTRAPOLATED_SHARE = 0.05


def refuse_wrong_markers(
    registration: Registration, max_residual_m: float | None, *, markers_as_given: bool = False
) -> None:
    """Refuse a registration whose markers are surely wrong.

    Parameters
    ----------
    max_residual_m
        Largest RMS residual of the markers used [m]; `None`: any.
    markers_as_given
        Take the labels as they are, even where another order fits clearly better.

    Raises
    ------
    CheckFailed
        Mistaken labels, or larger residuals.
    MarkerError
        A scale that is more than twice the known one, or less than half of it.
    """
    labels = registration.labels

    # Another order of the labels fits clearly better. A robust fit that has left the mistaken
    # markers out does not rest on them.
    mistake = label_mistake(registration)
    is_sure = mistake is not None and mistake.p_value < SURE_MISTAKE
    if is_sure and not markers_as_given and registration.used[mistake.moved].any():
        advice = "Correct the labels"
        # As they are given, the markers would only be refused for their residuals.
        if max_residual_m is None or registration.fre_rms_m <= max_residual_m:
            advice += ", or give --markers-as-given"
        raise mistake.refusal(registration, advice)

    # Larger residuals than careful touching leaves. The likeliest cause says what to do.
    if max_residual_m is not None and not registration.fre_rms_m <= max_residual_m:
        perspective = perspective_test(registration, fewest=MIN_FOR_HOMOGRAPHY)
        outlier = single_outlier(registration)
        if mistake is not None and mistake.p_value < GOOD_SET_PROBABILITY:
            advice = f"{mistake.sentence(labels)}. Correct the labels"
        elif perspective is not None and perspective.is_significant:
            advice = "No homography fits them either. Look for mistaken labels or a bent sheet"
            if perspective.outlier or perspective.fle_rms_m <= max_residual_m:
                advice = perspective.advice(labels)
        elif outlier is not None:
            index, others_m = outlier
            advice = (
                f"Without {labels[index]} the others fit to {_mm(others_m)}: touch it again, or "
                "leave it out with --robust"
            )
        else:
            advice = (
                "Look for the file of another case, mistaken labels, a wrong unit or markers that "
                "moved"
            )
        raise CheckFailed(
            f"the markers miss their places by {_mm(registration.fre_rms_m)} rms, and "
            f"--max-residual allows {1e3 * max_residual_m:g} mm. {advice}",
            code="residual-large",
            numbers={"fre_rms_m": registration.fre_rms_m, "max_residual_m": max_residual_m},
        )
    # A scale that is another unit, and more than by chance.
    for departure, standard_error in scale_departures(registration):
        ratio = 1 + departure
        is_another_unit = not 1 / MAX_RATIO <= ratio <= MAX_RATIO
        if is_another_unit and abs(departure) > STANDARD_ERRORS * standard_error:
            raise MarkerError(
                f"the markers give {ratio:.4g} times the known scale; {1 / MAX_RATIO:g} to "
                f"{MAX_RATIO:g} times are allowed. Look for millimetres given as metres, or give "
                "the right --pixel-spacing",
                code="scale-wrong", numbers={"ratio": ratio},
            )  # fmt: skip


# What a point of a curve may be where no ink shows it, and what `cause_of_own_error` says of it.
UNSEEN = (
    ("bridged", "bridge", "the gap that the curve bridges there", "Close the gap with the pen"),
    ("edited", "by-hand", "the part that was drawn by hand there", "Draw that part with the pen"),
)

# Times a curve's usual deviation from which a place is unsure for a reason of its own.
UNUSUAL = 2.0


def refuse_large_error(
    error: TargetError, max_tre_m: float, curve: Fixture, *, taken_from: str = "",
    is_touched: bool = False,
) -> None:  # fmt: skip
    """Refuse a registration that may be further off along the curve than a person allows.

    curve: what was registered, as it was drawn
    taken_from: the other setting that gave `max_tre_m`, where nobody stated the limit itself
    is_touched: whether touched points refined what the markers gave
    Raises CheckFailed: the 95 % bound of the whole curve is above `max_tre_m`. The message names
        the largest part of the bound, and its place
    """
    point = error.worst
    value_m = float(error.curve95_m[point])
    if value_m <= max_tre_m:
        return
    cause, why, advice = "markers", "the markers", "Add markers around the curve"
    if 2 * error.own_m[point] ** 2 > value_m**2:
        cause, why, advice = cause_of_own_error(curve, point)
    elif is_touched:
        cause, why, advice = "touched", "the touched points", "Touch more places"
    place = f"({coordinates(1e3 * curve.points[point], 1)}) mm"
    if curve.frame == "image":
        place = f"({coordinates(curve.points[point, :2])}) px"
    allowed = f"{1e3 * max_tre_m:g} mm" + (f" (the {taken_from})" if taken_from else "")
    raise CheckFailed(
        f"the curve may lie {_mm(value_m)} from its place at {place} (95 % bound), mostly because "
        f"of {why}, and --max-tre allows {allowed}. {advice}, or give another --max-tre",
        where=f"curve point {point}",
        code="tre-large",
        numbers={
            "curve95_max_m": value_m, "max_tre_m": max_tre_m, "point": point, "cause": cause,
        },
    )  # fmt: skip


def cause_of_own_error(curve: Fixture, point: int) -> tuple[str, str, str]:
    """Why a drawn curve itself is unsure at a point: a name, words for it, and what helps."""
    for flags, *cause in UNSEEN:
        is_so = getattr(curve.curve, flags, None)
        if is_so is not None and is_so[point]:
            return tuple(cause)
    if curve.sigma[point] > UNUSUAL * np.median(curve.sigma):
        why = "other ink or ends of the curve that cross it there"
        return "crossing", why, "Erase what does not belong to the curve"
    return "ink", "the blur of the line", "Give a sharper picture"


def registration_findings(registration: Registration) -> Iterator[Finding]:
    """What the markers say against themselves and is not refused."""
    # Another order of the labels fits better than chance explains, or about as well.
    mistake = label_mistake(registration)
    if mistake is not None and mistake.p_value < GOOD_SET_PROBABILITY:
        text = (
            f"{mistake.sentence(registration.labels)} "
            f"(as given: {_mm(registration.fre_rms_m)}). Check the labels."
        )
        yield doubt("labels-doubtful", "register", text)
    elif mistake is not None:
        text = (
            "The markers form a symmetric pattern: exchanged labels would go unnoticed. Add one "
            "off it."
        )
        yield note("layout-symmetric", "register", text)

    # A slice that was photographed at an angle leaves residuals that no single marker explains.
    perspective = perspective_test(registration)
    if perspective is not None and perspective.is_significant:
        also = f", the {registration.model} model {_mm(registration.fle_rms_m)}"
        text = perspective.advice(registration.labels, also)
        text += "; the error bound does not count the angle."
        yield doubt("perspective", "register", text)
    else:
        yield from outlier_findings(registration)
        if perspective is not None and perspective.is_possible:
            text = (
                "If the slice is a photograph, its small angle may move the markers by "
                f"{_mm(perspective.departure_m)}, which the error bound does not count."
            )
            yield note("perspective", "register", text)

    yield from unchecked_findings(registration)
    yield from scale_findings(registration)
    yield from stretch_findings(registration)


def unchecked_findings(registration: Registration) -> Iterator[Finding]:
    """Markers whose error would move the fixture and leave hardly a residual.

    Of three markers that is true whatever they measured, so it is a note. Of more it is a doubt
    where a marker alone decides its own place, for another marker near it would check it; and where
    an affine map's stretch explains what a marker may have caused.
    """
    # The share in the direction that is checked least.
    share = np.linalg.eigvals(registration.hat).real.max(axis=1)
    unchecked = np.flatnonzero(registration.used & (share > UNCHECKED_LEVERAGE))
    if not len(unchecked):
        return
    if registration.used.sum() == 3:
        text = (
            "Three markers cannot check each other: an error across the slice moves the fixture "
            "and shows nowhere. A fourth marker would show it."
        )
        yield note("markers-unchecked", "register", text)
        return
    names = ", ".join(str(registration.labels[i]) for i in unchecked)
    text = f"No other marker checks {names}: an error there moves the fixture and shows nowhere."
    place = registration.place_px(int(unchecked[0]))
    residual_m, used = 0.0, registration.used
    if registration.model == "affine" and registration.problem.model.dimension == 2:
        residual_m = rms_length(fit_similarity(registration.problem, used).vectors[used])
    finding = doubt
    if share[unchecked].max() > DECISIVE_LEVERAGE:
        text += " Add a marker near it."
    elif residual_m > UNSTRETCHED_RESIDUAL_M:
        text += (
            f" Without the stretch of the affine map the markers miss by {_mm(residual_m)} rms. "
            "Add a marker."
        )
    else:
        finding = note
        text += " Add a marker near it to be sure."
    yield finding("markers-unchecked", "register", text, place_px=place)


def error_findings(error: TargetError) -> Iterator[Finding]:
    """That part of the curve lies beyond the markers."""
    beyond = int(error.is_extrapolated.sum())
    if not beyond:
        return
    share = beyond / len(error.rms_m)
    text = (
        f"{share:.0%} of the curve lies beyond the markers, where the error grows. Add a marker "
        "there."
    )
    finding = note if share < EXTRAPOLATED_SHARE else doubt
    yield finding("curve-extrapolated", "register", text)


def side_finding(registration: Registration) -> Finding | None:
    """That the slice is seen from below, where nobody said from which side it is looked at.

    A mirrored planar layout fits as well as the right one, turned over. So a robot file with x and
    y exchanged shows by the side alone.
    """
    faces = registration.image_faces
    if faces is None or faces[2] >= 0:
        return None
    text = (
        f"By the markers the slice is seen from {describe_side(faces)}. If you look at it from "
        "above, the robot's positions are mirrored, as with x and y exchanged. Say which with "
        "--seen-from above or below."
    )
    return doubt("faces-down", "register", text)


def describe_checks(registration: Registration) -> Report:
    """The scale against the known one, and the test for perspective, as `--json` reports them."""
    report = {}
    if departures := scale_departures(registration):
        report["spacing_departure"] = [departure for departure, _ in departures]
        report["spacing_departure_sigma"] = [sigma for _, sigma in departures]
    if perspective := perspective_test(registration):
        report["perspective"] = {"p_value": perspective.p_value, "said": perspective.is_significant}
    return report


def _mm(length_m: float) -> str:
    return f"{1e3 * length_m:.2f} mm"
