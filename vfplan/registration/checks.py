"""The reasons to refuse a registration, and what a person should look at before it is used.

`refuse_wrong_markers` is the gate: labels that are mistaken, residuals that no marker has, a scale
that is another unit. `registration_findings` lists the rest. Nothing is repaired.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import Any

import numpy as np

from vfplan.errors import CheckFailed, MarkerError
from vfplan.findings import Finding, doubt, note
from vfplan.registration.error import TargetError
from vfplan.registration.fit import Fit, fit_model, studentised_f
from vfplan.registration.models import (
    Affine,
    Array,
    Orthogonal,
    homogeneous,
    marker_rows,
)
from vfplan.registration.problem import Problem
from vfplan.registration.registration import Registration, describe_side

STAGE = "register"

# Another order of the labels is sure, and refused, if it fits better by an F of this probability.
# Of 10,000 sets of good markers none is refused by it (docs/make_registration_table.py).
LABELS_SURE = 5e-6

# Another order of the labels is doubted, or the layout is called symmetric, by this probability.
LABELS_DOUBTED = 1e-2

# Both of two exchanged markers are among this many of largest residual.
MAX_SUSPECTED = 12

# Perspective is told to a person if good markers show as much once in this many sets.
PERSPECTIVE_ONCE_IN = 200

# A homography of a plane has two parameters more than an affine map.
HOMOGRAPHY_PARAMETERS = 11

# Scale over the known scale. More is another unit or another picture, not a printer's stretch.
MAX_SCALE_RATIO = 2.0

# A scale departs from the known one if it does by this share and this many standard errors.
SCALE_DEPARTURE = 0.005
SCALE_STANDARD_ERRORS = 4.0

# Stretch that an affine map shows without a doubt: a camera that looks on at 25 degrees makes it.
MAX_STRETCH = 1.1

# A smaller model is doubted if good markers of square pixels show as much stretch so seldom.
STRETCH_PROBABILITY = 1e-4

# A layout as long as this for its width lets the error grow fast across it.
LONG_LAYOUT = 10.0

# A marker that has this share in its own prediction can be wrong and leave hardly any residual.
UNCHECKED_LEVERAGE = 0.9

# With this share a marker's error of 20 mm leaves less than 1 mm among ten markers.
DECISIVE_LEVERAGE = 0.98

# RMS residual of a similarity [m] that markers touched with care do not exceed; as --max-residual.
UNSTRETCHED_RESIDUAL_M = 1e-3

# RMS distance of the markers from their centre [m]. No scanner's slice is wider.
LARGE_LAYOUT_M = 1.0

# Share of the curve that may lie beyond the markers before a person has to look.
EXTRAPOLATED_SHARE = 0.05


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
    # Whether the given order does not fit clearly better than this one.
    is_possible: bool

    @property
    def moved(self) -> list[int]:
        """The markers whose labels it changes."""
        return [i for i, j in enumerate(self.order) if i != j]

    def sentence(self, labels: Sequence[str | int]) -> str:
        """What seems to have happened, and how well the markers fit without it."""
        moved = [str(labels[i]) for i in self.moved]
        fit = f"{self.action}, all markers fit to {_mm(self.fre_rms_m)}"
        if len(moved) == 2:
            return f"{moved[0]} and {moved[1]} seem exchanged: {fit}"
        return f"the labels {', '.join(moved[:4])}{'' if len(moved) <= 4 else ', ...'} seem {fit}"


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
    mistakes = label_mistakes(registration)
    likeliest = mistakes[0] if mistakes else None
    is_sure = likeliest is not None and likeliest.p_value < LABELS_SURE
    # A robust fit that has left the mistaken markers out does not rest on them.
    if is_sure and registration.used[likeliest.moved].any() and not markers_as_given:
        raise CheckFailed(
            f"{likeliest.sentence(registration.labels)} (as given: "
            f"{_mm(registration.fre_rms_m)}). Correct the labels, or give --markers-as-given",
            code="labels-mistaken",
            numbers=_mistake_numbers(registration, likeliest),
        )
    if max_residual_m is not None and not registration.fre_rms_m <= max_residual_m:
        raise CheckFailed(
            f"the markers miss their places by {_mm(registration.fre_rms_m)} rms, and "
            f"--max-residual allows {1e3 * max_residual_m:g} mm. "
            + _likely_cause(registration, likeliest),
            code="residual-large",
            numbers={"fre_rms_m": registration.fre_rms_m, "max_residual_m": max_residual_m},
        )
    for departure, standard_error in scale_departures(registration):
        ratio = 1 + departure
        is_far = not 1 / MAX_SCALE_RATIO <= ratio <= MAX_SCALE_RATIO
        if is_far and abs(departure) > SCALE_STANDARD_ERRORS * standard_error:
            raise MarkerError(
                f"the markers give {ratio:.4g} times the known scale; at most "
                f"{MAX_SCALE_RATIO:g} times, either way, is allowed. Look for millimetres given as "
                "metres, or for another --pixel-spacing",
                code="scale-wrong",
                numbers={"ratio": ratio},
            )


def refuse_large_error(
    error: TargetError, max_tre_m: float, registration: Registration, points: Array
) -> None:
    """Refuse a registration that may be further off along the curve than a person allows.

    error: along the source `points` (M, 2|3)
    Raises CheckFailed: the 95 % bound of the whole curve is above `max_tre_m`
    """
    value_m = float(error.curve95_m[error.worst])
    if value_m <= max_tre_m:
        return
    advice = "Add markers around the curve"
    if registration.model == "affine" and not _stretch_findings(registration):
        problem = registration.fit.problem
        smaller = replace(problem, model=Orthogonal(problem.model.dimension, None, "similarity"))
        similar = replace(
            registration, model="similarity", fit=fit_model(smaller, registration.used)
        )
        similar_m = float(similar.tre95_curve_m(points).max())
        if similar_m <= max_tre_m:
            advice = f"With --model similarity it is {_mm(similar_m)}"
    raise CheckFailed(
        f"the registration error may reach {_mm(value_m)} (95 % bound over the curve), and "
        f"--max-tre allows {1e3 * max_tre_m:g} mm. {advice}, or give another --max-tre",
        where=f"curve point {error.worst}",
        code="tre-large",
        numbers={"curve95_max_m": value_m, "max_tre_m": max_tre_m, "point": error.worst},
    )


def registration_findings(registration: Registration) -> tuple[Finding, ...]:
    """What the markers say against themselves and is not refused."""
    findings = _label_findings(registration)
    perspective = perspective_test(registration)
    if perspective is not None and perspective.is_significant:
        findings += [
            doubt(
                "perspective",
                STAGE,
                "The slice seems to be photographed at an angle: a homography leaves "
                f"{_mm(perspective.left_m)} a marker, the {registration.model} model "
                f"{_mm(registration.fle_rms_m)}. Rectify the picture; the error bound does not "
                "count the angle.",
            )
        ]
    else:
        findings += _outlier_findings(registration)
    findings += _layout_findings(registration)
    findings += _scale_findings(registration)
    findings += _stretch_findings(registration)
    findings += _sigma_findings(registration)
    return tuple(findings)


def error_findings(error: TargetError) -> tuple[Finding, ...]:
    """That part of the curve lies beyond the markers."""
    beyond = int(error.is_extrapolated.sum())
    if not beyond:
        return ()
    share = beyond / len(error.rms_m)
    kind = note if share < EXTRAPOLATED_SHARE else doubt
    text = f"{share:.0%} of the curve lies beyond the markers, where the error grows."
    if kind is doubt:
        text += " Add a marker there."
    return (kind("curve-extrapolated", STAGE, text),)


def side_finding(registration: Registration) -> Finding | None:
    """That the slice is seen from below, where nobody said from which side it is looked at.

    A mirrored planar layout fits as well as the right one, turned over. So a robot file with x and
    y exchanged shows by the side alone.
    """
    faces = registration.image_faces
    if faces is None or faces[2] >= 0:
        return None
    return doubt(
        "faces-down",
        STAGE,
        f"By the markers the slice is seen from {describe_side(faces)}. If you look at it from "
        "above, the robot's positions are mirrored, as with x and y exchanged. Say which with "
        "--seen-from X,Y,Z.",
    )


def describe_checks(registration: Registration) -> dict[str, Any]:
    """The scale against the known one, and the test for perspective, as `--json` reports them."""
    report: dict[str, Any] = {}
    if departures := scale_departures(registration):
        report["spacing_departure"] = [departure for departure, _ in departures]
        report["spacing_departure_sigma"] = [sigma for _, sigma in departures]
    perspective = perspective_test(registration)
    if perspective is not None:
        report["perspective"] = {
            "p_value": perspective.p_value,
            "said": perspective.is_significant,
        }
    return report


# Labels


def label_mistakes(registration: Registration) -> list[LabelMistake]:
    """The usual mistakes with labels that fit about as well as the given ones, or better.

    Each is judged by the ratio of the sums of squares, which for two orders that are equally good
    is F-distributed with ν and ν degrees of freedom. The likeliest comes first.
    """
    from scipy.special import fdtrc

    everyone = registration.fit.problem
    judge = everyone
    if registration.pixel_spacing is not None and isinstance(everyone.model, Affine):
        # Four or five markers fit an affine map in almost any order. The true map is close to a
        # similarity where the pixel spacing is known.
        judge = replace(everyone, model=Orthogonal(2, None, "similarity"))
    n = len(everyone.s)
    dof = 3 * n - judge.model.parameters
    orders = usual_orders(n, _worst_markers(fit_model(judge)))
    if not orders:
        return []
    given = _sums_of_squares(judge, [tuple(range(n))])[0]
    others = _sums_of_squares(judge, list(orders))
    fre = np.sqrt(_sums_of_squares(everyone, list(orders), weighted=False) / n)
    mistakes = []
    for (order, action), square, fre_rms_m in zip(orders.items(), others, fre, strict=True):
        mistake = LabelMistake(
            order=order,
            action=action,
            fre_rms_m=float(fre_rms_m),
            p_value=float(fdtrc(dof, dof, given / square)),
            is_possible=bool(fdtrc(dof, dof, square / given) > LABELS_DOUBTED),
        )
        if mistake.is_possible:
            mistakes.append(mistake)
    mistakes.sort(key=lambda mistake: mistake.p_value)
    return mistakes


def usual_orders(n: int, suspected: Sequence[int]) -> dict[tuple[int, ...], str]:
    """The orders that people mistake for the right one, with what was done to the labels.

    n: number of markers
    suspected: markers of which two may be exchanged
    """
    forward = np.arange(n)
    orders: dict[tuple[int, ...], str] = {}
    if n <= 4:
        for order in permutations(range(n)):
            orders[order] = "reordered"
    for rows in range(2, n // 2 + 1):
        if n % rows == 0:
            grid = forward.reshape(rows, -1)
            orders[tuple(grid.T.ravel().tolist())] = "transposed"
            orders[tuple(grid[::-1].ravel().tolist())] = "reversed by rows"
            orders[tuple(grid[:, ::-1].ravel().tolist())] = "reversed by columns"
    for shift in range(1, n):
        orders[tuple(np.roll(forward[::-1], shift).tolist())] = "reversed and shifted"
        orders[tuple(np.roll(forward, shift).tolist())] = "shifted"
    orders[tuple(forward[::-1].tolist())] = "reversed"
    for i, j in combinations(suspected, 2):
        exchanged = list(range(n))
        exchanged[i], exchanged[j] = j, i
        orders[tuple(exchanged)] = "exchanged"
    orders.pop(tuple(forward.tolist()), None)
    return orders


def _worst_markers(fit: Fit) -> list[int]:
    squares = (fit.problem.weights * fit.vectors**2).sum(axis=1)
    return sorted(np.argsort(-squares, kind="stable")[:MAX_SUSPECTED].tolist())


def _sums_of_squares(
    problem: Problem, orders: Sequence[tuple[int, ...]], *, weighted: bool = True
) -> Array:
    """(P,) sum of squared residuals [m²] with the targets in each order."""
    index = np.array(orders)
    y, weights = problem.y[index], problem.weights[index]
    s = np.broadcast_to(problem.s, (len(index), *problem.s.shape))
    m = problem.model.solve(s, y, weights)
    squares = (y - homogeneous(problem.s) @ np.swapaxes(m, -1, -2)) ** 2
    if weighted:
        squares = squares * weights
    return np.maximum(squares.sum(axis=(1, 2)), problem.rounding_floor_m**2)


def _label_findings(registration: Registration) -> list[Finding]:
    mistakes = label_mistakes(registration)
    if not mistakes:
        return []
    if mistakes[0].p_value < LABELS_DOUBTED:
        sentence = mistakes[0].sentence(registration.labels)
        return [
            doubt(
                "labels-doubtful",
                STAGE,
                f"{sentence[0].upper()}{sentence[1:]} (as given: {_mm(registration.fre_rms_m)}). "
                "Check the labels.",
            )
        ]
    return [
        note(
            "layout-symmetric",
            STAGE,
            "The markers form a symmetric pattern: exchanged labels would go unnoticed. Move one.",
        )
    ]


def _mistake_numbers(registration: Registration, mistake: LabelMistake) -> dict[str, Any]:
    labels = registration.labels
    return {
        "fre_rms_m": registration.fre_rms_m,
        "fre_rms_m_corrected": mistake.fre_rms_m,
        "p_value": mistake.p_value,
        "action": mistake.action,
        "labels": [labels[j] for j in mistake.order],
    }


# Residuals


def _likely_cause(registration: Registration, mistake: LabelMistake | None) -> str:
    """What would explain large residuals, and what to do about them."""
    labels = registration.labels
    if mistake is not None and mistake.p_value < LABELS_DOUBTED:
        return f"{mistake.sentence(labels)}. Correct the labels"
    perspective = perspective_test(registration)
    if perspective is not None and perspective.is_significant:
        return (
            "The slice seems to be photographed at an angle: a homography leaves "
            f"{_mm(perspective.left_m)} a marker. Rectify the picture"
        )
    worst = _single_outlier(registration)
    if worst is not None:
        index, rest_m = worst
        return (
            f"Without {labels[index]} the others fit to {_mm(rest_m)}: touch it again, or leave it "
            "out with --robust"
        )
    return "Look for the file of another case, mistaken labels, a wrong unit or markers that moved"


def _single_outlier(registration: Registration) -> tuple[int, float] | None:
    """The marker of largest F, and the RMS residual of the others without it [m].

    `None` where no marker is an outlier, or the others do not agree either.
    """
    f = np.where(registration.used, np.nan_to_num(registration.studentised_f), 0.0)
    worst = int(f.argmax())
    rest = registration.used & (np.arange(len(f)) != worst)
    problem = registration.fit.problem
    if not f[worst] > registration.f_limits[worst] or 3 * rest.sum() <= problem.model.parameters:
        return None
    without = fit_model(problem, rest)
    rest_m = float(np.sqrt((without.vectors[rest] ** 2).sum(axis=1).mean()))
    if rest_m > registration.fre_rms_m / 2:
        return None
    return worst, rest_m


def _outlier_findings(registration: Registration) -> list[Finding]:
    findings = []
    for i, label in enumerate(registration.labels):
        if label not in registration.outliers:
            continue
        place = _place_px(registration, i)
        distance = _mm(float(registration.residuals_m[i]))
        if registration.used[i]:
            if np.isfinite(registration.loo_m[i]):
                distance = _mm(float(registration.loo_m[i]))
            text = (
                f"Marker {label} lies {distance} from where the others put it. Touch it again, or "
                "leave it out with --robust."
            )
            findings.append(doubt("marker-suspect", STAGE, text, place_px=place))
        else:
            text = f"Marker {label} was left out: it lies {distance} from where the others put it."
            findings.append(note("marker-left-out", STAGE, text, place_px=place))
    return findings


def _place_px(registration: Registration, index: int) -> tuple[float, float] | None:
    if registration.source.shape[1] != 2:
        return None
    u, v = registration.source[index]
    return float(u), float(v)


# Layout and scale


def _layout_findings(registration: Registration) -> list[Finding]:
    findings = []
    labels = registration.labels
    if registration.condition > LONG_LAYOUT:
        findings.append(
            note(
                "layout-long",
                STAGE,
                f"The markers' layout is {registration.condition:.0f} times as long as wide: the "
                "error grows fast across it.",
            )
        )
    findings += _unchecked_findings(registration)
    s = registration.fit.problem.s
    for i, j in combinations(range(len(s)), 2):
        if np.linalg.norm(s[i] - s[j]) < 1e-6:
            findings.append(
                doubt(
                    "markers-coincide",
                    STAGE,
                    f"Markers {labels[i]} and {labels[j]} stand at one place in the source.",
                    place_px=_place_px(registration, i),
                )
            )
    radius_m = float(np.sqrt((registration.fit.problem.y**2).sum(axis=1).mean()))
    if radius_m > LARGE_LAYOUT_M:
        findings.append(
            doubt(
                "layout-large",
                STAGE,
                f"The markers lie {radius_m:.3g} m (rms) from their centre. Is the unit metres?",
            )
        )
    return findings


def _unchecked_findings(registration: Registration) -> list[Finding]:
    """Markers whose error would move the fixture and leave hardly a residual.

    It is a doubt where there are three markers only, for they cannot check each other across their
    plane; where a marker alone decides its own place; and where an affine map's stretch explains
    what a marker may have caused.
    """
    fit = registration.fit
    share = np.linalg.eigvals(fit.hat).real.max(axis=1)  # of the direction that is checked least
    unchecked = np.flatnonzero(fit.used & (share > UNCHECKED_LEVERAGE))
    if not len(unchecked):
        return []
    names = ", ".join(str(registration.labels[i]) for i in unchecked)
    text = f"No other marker checks {names}: an error there moves the fixture and shows nowhere."
    if fit.used.sum() == 3:
        return [doubt("markers-unchecked", STAGE, f"{text} Touch a fourth marker.")]
    if share[unchecked].max() > DECISIVE_LEVERAGE:
        return [doubt("markers-unchecked", STAGE, f"{text} Add a marker near it.")]
    place = _place_px(registration, int(unchecked[0]))
    if registration.model == "affine" and fit.problem.model.dimension == 2:
        square = replace(fit.problem, model=Orthogonal(2, None, "similarity"))
        vectors_m = fit_model(square, fit.used).vectors[fit.used]
        residual_m = float(np.sqrt((vectors_m**2).sum(axis=1).mean()))
        if residual_m > UNSTRETCHED_RESIDUAL_M:
            text += (
                f" Without the stretch of the affine map the markers miss by {_mm(residual_m)} "
                "rms. Add a marker."
            )
            return [doubt("markers-unchecked", STAGE, text, place_px=place)]
    return [note("markers-unchecked", STAGE, text, place_px=place)]


def scale_departures(registration: Registration) -> list[tuple[float, float]]:
    """(scale over the known scale minus 1, its standard error), one each along u and v if affine.

    Of a rigid registration: what its scale would be if it were free. Empty where no scale is known.
    """
    fit, problem = registration.fit, registration.fit.problem
    k = problem.model.dimension
    if k == 2 and registration.pixel_spacing is None:
        return []
    if registration.model == "rigid":
        fit = fit_model(replace(problem, model=Orthogonal(k, None, "similarity")), fit.used)
    radius = problem.normaliser.radius
    covariance = fit.covariance.reshape(3, k + 1, 3, k + 1)
    departures = []
    for axis in range(k if registration.model == "affine" else 1):
        column = fit.m[:, axis]
        length = float(np.linalg.norm(column))
        variance = column @ covariance[:, axis, :, axis] @ column / length**2
        departures.append((length / radius - 1, float(np.sqrt(max(variance, 0.0))) / radius))
    return departures


def _scale_findings(registration: Registration) -> list[Finding]:
    departures = scale_departures(registration)
    if not departures:
        return []
    departure, standard_error = max(departures, key=lambda pair: abs(pair[0]))
    is_sure = abs(departure) > SCALE_STANDARD_ERRORS * standard_error
    if abs(departure) <= SCALE_DEPARTURE or not is_sure:
        return []
    return [
        doubt(
            "scale-departs",
            STAGE,
            f"The markers give a scale that departs by {departure:+.2%} from the known one "
            f"(standard error {standard_error:.2%}). Check the pixel spacing.",
        )
    ]


def _stretch_findings(registration: Registration) -> list[Finding]:
    """Pixels that are not square, or not of the given ratio, where the model or a user says so."""
    from scipy.special import fdtrc

    problem, used = registration.fit.problem, registration.used
    affine = Affine(2)
    if problem.model.dimension != 2 or 3 * used.sum() <= affine.parameters:
        return []
    free = fit_model(replace(problem, model=affine), used)
    square = registration.fit
    if registration.model == "affine":
        square = fit_model(replace(problem, model=Orthogonal(2, None, "similarity")), used)
    long, short = np.linalg.svd(free.m[:, :2], compute_uv=False)
    if registration.model == "affine" and long < MAX_STRETCH * short:
        return []
    free_squares = max(free.variance * free.dof, problem.rounding_floor_m**2)
    square_squares = square.variance * square.dof
    more = square.dof - free.dof
    f = ((square_squares - free_squares) / more) / (free_squares / free.dof)
    if fdtrc(more, free.dof, max(f, 0.0)) > STRETCH_PROBABILITY:
        return []
    return [
        doubt(
            "pixels-stretched",
            STAGE,
            f"By the markers a pixel is {long / short:.3g} times as long as wide. Look for a "
            "column in another unit, or for another --pixel-spacing or --model.",
        )
    ]


def _sigma_findings(registration: Registration) -> list[Finding]:
    from scipy.special import chdtrc

    unit_m = registration.fit.problem.sigma_unit_m
    if unit_m is None:
        return []
    ratio = registration.sigma_m / unit_m
    if chdtrc(registration.dof, registration.dof * ratio**2) >= 0.01:
        return []
    return [
        doubt(
            "sigma-exceeded",
            STAGE,
            f"The residuals are {ratio:.1f} times what the stated sigmas allow.",
        )
    ]


# Perspective


@dataclass(frozen=True, eq=False)
class PerspectiveTest:
    """Whether a homography explains planar markers better than an affine map does."""

    # Probability that good markers show as much perspective.
    p_value: float
    # RMS localisation error that the homography leaves [m].
    left_m: float
    # Whether it is small, and no single bad marker explains the residuals as well.
    is_significant: bool


def perspective_test(registration: Registration) -> PerspectiveTest | None:
    """F test of the two parameters that a homography has more than an affine map.

    `None` for markers in space, for fewer than six, and for an exact fit. All markers count, also
    those that a robust fit left out.
    """
    from scipy.special import fdtrc

    problem = registration.fit.problem
    n = len(problem.s)
    dof = 3 * n - HOMOGRAPHY_PARAMETERS
    if problem.model.dimension != 2 or n < 6:
        return None
    affine = fit_model(replace(problem, model=Affine(2)))
    affine_squares = affine.variance * affine.dof
    if not affine_squares > n * problem.rounding_floor_m**2:
        return None
    h = _fit_homography(problem, np.append(affine.m, [0.0, 0.0]))
    if not (1 + problem.s @ h[9:] > 0).all():
        return None
    error = problem.y - _homography(h, problem.s)
    left = max(float((problem.weights * error**2).sum()), problem.rounding_floor_m**2)
    f = max(affine_squares - left, 0.0) / 2 / (left / dof)
    p_value = float(fdtrc(2.0, float(dof), f))
    return PerspectiveTest(
        p_value=p_value,
        left_m=float(np.sqrt(3 * left / dof)),
        is_significant=p_value < min(1 / PERSPECTIVE_ONCE_IN, _outlier_probability(affine)),
    )


def _homography(h: Array, s: Array) -> Array:
    """(N, 3) positions M x~ / (1 + q·s) of s (N, 2), for row-major M and then q in h (11,)."""
    return homogeneous(s) @ h[:9].reshape(3, 3).T / (1 + s @ h[9:])[:, None]


def _fit_homography(problem: Problem, h: Array) -> Array:
    """The homography of least weighted squares, by Gauss-Newton from another."""
    root = np.sqrt(problem.weights)
    for _ in range(30):
        below = (1 + problem.s @ h[9:])[:, None, None]
        mapped = _homography(h, problem.s)
        linear = marker_rows(problem.x).reshape(len(problem.s), 3, 9) / below
        bend = -mapped[:, :, None] * problem.s[:, None, :] / below
        rows = np.concatenate([linear, bend], axis=2) * root[:, :, None]
        error = root * (problem.y - mapped)
        flat = rows.reshape(-1, HOMOGRAPHY_PARAMETERS)
        step = np.linalg.lstsq(flat, error.ravel(), rcond=None)[0]
        h = h + step
        if np.abs(step[9:]).max() < 1e-12:
            break
    return h


def _outlier_probability(fit: Fit) -> float:
    """Probability that any marker of a good set has an F as large as the largest one here."""
    from scipy.special import fdtrc

    f = np.nan_to_num(studentised_f(fit))
    return min(1.0, len(f) * float(fdtrc(3.0, float(fit.dof - 3), f.max())))


def _mm(length_m: float) -> str:
    return f"{1e3 * length_m:.2f} mm"
