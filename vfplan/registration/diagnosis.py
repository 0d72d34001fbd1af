"""What may be wrong with a registration, named: suspects, labels, layout, scale, perspective.

A `Diagnosis` warns of what is suspicious, once in twenty to a hundred good sets. What is refused is
beyond doubt: from good markers it comes less than once in ten thousand sets, whatever their layout
(docs/registration.md). An outlier is never among it: errors with heavy tails look like one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import comb

import numpy as np

from vfplan.errors import MarkerError
from vfplan.registration.fit import agreeing, f_limit, one_to_blame, solve
from vfplan.registration.labelling import Relabelling, better_labelling, name_labelling
from vfplan.registration.models import Affine, Orthogonal
from vfplan.registration.result import Registration

LONG_LAYOUT = 10.0
# Chance of this much stretch from markers without any; and how much an affine map may show, as a
# camera 25° off does.
STRETCHED, SQUARE = 1e-4, 1.1
LARGEST_RADIUS_M = 1.0  # RMS, of markers seen in one slice: no scanner is so wide
# Above this share in its own prediction a marker's error moves the fit and leaves no residual.
UNCHECKED_LEVERAGE = 0.9
QUICK_SUBSETS = 20_000

# Residuals over the stated sigmas: beyond it the sigmas, or the markers, are others.
MAX_OVER_SIGMA = 10.0
# Along u and v; more is another unit, not a printer's stretch.
MAX_SCALE_FACTOR = 2.0

Label = str | int
Scales = tuple[float, ...] | None


@dataclass(frozen=True)
class Diagnosis:
    """What the markers say against themselves."""

    suspects: dict[Label, str]  # label -> why it is suspected
    swapped: tuple[Label, Label] | None  # two labels that seem exchanged; `None` when none do
    # Another labelling that fits far better, or as well; `None` when none does
    relabelled: Relabelling | None
    labellings: int  # that fit about as well as the given one, and that one
    unchecked: tuple[Label, ...]  # labels of markers no other marker checks (leverage above 0.9)
    # Scale found over the known one, minus 1; along u and v for the affine model
    spacing_departure: Scales
    spacing_departure_sigma: Scales  # standard errors of the departures
    warnings: tuple[str, ...]  # one sentence for each of these that a user should read


def diagnose(registration: Registration) -> Diagnosis:
    """Everything the markers say against themselves; nothing is repaired or dropped."""
    fit, labels = registration.fit, registration.labels
    everyone = fit if fit.used.all() else solve(fit.problem)
    relabelled = better_labelling(everyone, square=registration.pixel_spacing is not None)
    pair = relabelled and relabelled.pair
    swapped = None if pair is None else (labels[pair[0]], labels[pair[1]])
    hidden = np.flatnonzero(fit.used & (fit.leverage > UNCHECKED_LEVERAGE))
    unchecked = tuple(labels[i] for i in hidden)
    departure, sigma = _departure(registration)
    suspects = _suspects(registration, swapped)
    warnings = (
        *label_warnings(registration, relabelled),
        *(() if swapped else suspect_warnings(registration, suspects)),
        *perspective_warning(registration),
        *layout_warnings(registration, unchecked),
        *scale_warnings(registration, departure, sigma),
        *stretch_warning(registration),
    )
    return Diagnosis(
        suspects,
        swapped,
        relabelled,
        relabelled.alike if relabelled and not relabelled.seems else 1,
        unchecked,
        departure,
        sigma,
        warnings,
    )


def _suspects(registration: Registration, swapped: tuple[Label, Label] | None) -> dict[Label, str]:
    suspects: dict[Label, str] = {}
    if swapped:
        suspects |= {a: f"its label and {b}'s seem exchanged" for a, b in (swapped, swapped[::-1])}
    n, labels = int(registration.used.sum()), registration.labels
    for i, label in enumerate(labels):
        if label not in registration.outliers or label in suspects:
            continue
        limit = f_limit(n, int(registration.studentised_dof[i]))
        size = registration.residuals_m[i] * 1e3
        verb = "stays in the fit" if registration.used[i] else "left out of the fit"
        f = registration.studentised_f[i]
        suspects[label] = f"residual {size:.3g} mm, F {f:.3g} over {limit:.3g}; {verb}"
    alone = one_to_blame(registration.fit)
    if alone is not None:
        why = "no transform explains it with the others, which agree without it"
        suspects.setdefault(labels[alone], why)
    for label in _masked(registration):
        suspects.setdefault(label, "disagrees with the markers that agree best")
    return suspects


def _masked(registration: Registration) -> list[Label]:
    """Markers that a robust search would leave out: several bad ones hide each other's F."""
    problem = registration.fit.problem
    subsets = comb(len(problem.s), problem.model.minimal)
    if registration.perspective or registration.robust or subsets > QUICK_SUBSETS:
        return []
    used = agreeing(problem, alpha=0.01)
    return [label for label, good in zip(registration.labels, used, strict=True) if not good]


def _departure(registration: Registration) -> tuple[Scales, Scales]:
    """Scale over the known scale, minus 1, and its standard error; a rigid fit's, were it free."""
    fit, problem = registration.fit, registration.fit.problem
    k = problem.model.dimension
    if k == 2 and registration.pixel_spacing is None:
        return None, None
    if registration.model == "rigid":
        fit = solve(replace(problem, model=Orthogonal(k, None, "similarity")), fit.used)
    columns = fit.m[:, :k]  # the known spacing is in the normalised source already
    lengths = np.linalg.norm(columns, axis=0)
    c = fit.covariance.reshape(3, k + 1, 3, k + 1)
    variance = np.einsum("aj,ajbj,bj->j", columns, c[:, :k, :, :k], columns) / lengths**2
    sigma = np.sqrt(np.maximum(variance, 0.0)) / problem.normaliser.radius
    each = slice(k if registration.model == "affine" else 1)
    departure = lengths / problem.normaliser.radius - 1
    return tuple(departure[each].tolist()), tuple(sigma[each].tolist())


def label_warnings(registration: Registration, other: Relabelling | None) -> tuple[str, ...]:
    """Labels exchanged, in another order, or that these markers cannot show."""
    if other is None:
        return ()
    name = name_labelling(other.order, registration.labels)
    if other.seems:
        return (
            f"it seems that {name}: so the markers would miss their places by "
            f"{other.rms_m * 1e3:.3g} mm rms only; check the labels",
        )
    return (
        f"these {len(registration.labels)} markers cannot show how they are labelled: "
        f"{other.alike} labellings fit about as well; they miss their places by "
        f"{registration.fre_rms_m * 1e3:.3g} mm rms, and if {name}, by {other.rms_m * 1e3:.3g} mm; "
        "check the labels, or move or add a marker",
    )


def suspect_warnings(registration: Registration, suspects: dict[Label, str]) -> tuple[str, ...]:
    """Each suspect marker; a single one with how far it is off, and how the others fit then."""
    names = list(suspects)
    if len(names) == 1 and not registration.perspective:
        used, one = registration.used, registration.labels.index(names[0])
        rest = used & (np.arange(len(used)) != one)
        if used[one] and 3 * rest.sum() > registration.fit.problem.model.parameters:
            left = solve(registration.fit.problem, rest).vectors[rest]
            return (
                f"suspect marker {names[0]}: it is {registration.loo_m[one] * 1e3:.3g} mm from "
                "where the others put it, and without it they fit to "
                f"{np.sqrt((left**2).sum(axis=1).mean()) * 1e3:.3g} mm rms; it stays in the fit: "
                "check it, and correct it or leave it out with --robust",
            )
    return tuple(f"suspect marker {label}: {why}" for label, why in suspects.items())


def perspective_warning(registration: Registration) -> tuple[str, ...]:
    """A camera that does not look straight on."""
    seen = registration.perspective
    if seen is None or not seen.said:
        return ()
    left, show = np.sqrt(3 * seen.variance), "show" if seen.sure else "may show"
    return (
        f"the markers {show} perspective, as a camera that does not look straight on gives: a "
        f"homography leaves {left * 1e3:.3g} mm a marker, the {registration.model} model "
        f"{np.sqrt(3) * registration.sigma_m * 1e3:.3g} mm; the bounds are widened by what the "
        "model misses; rectify the picture",
    )


def layout_warnings(registration: Registration, unchecked: tuple[Label, ...]) -> tuple[str, ...]:
    """A layout that hides errors: long, or with markers that nothing checks."""
    found = []
    if registration.condition > LONG_LAYOUT:
        found.append(
            f"the markers' layout is {registration.condition:.0f} times as long as wide: the error "
            "grows fast across it"
        )
    if unchecked:
        names = ", ".join(map(str, unchecked))
        found.append(
            f"no other marker checks {names}: an error there moves the fit and leaves no residual"
        )
    s, labels = registration.fit.problem.s, registration.labels
    for a, b in np.argwhere(np.triu(np.linalg.norm(s[:, None] - s, axis=2) < 1e-6, 1)):
        found.append(f"markers {labels[a]} and {labels[b]} stand at the same place in the source")
    return tuple(found)


def scale_warnings(registration: Registration, departure: Scales, sigma: Scales) -> tuple[str, ...]:
    """Residuals or a scale beyond what is known."""
    from scipy.special import chdtrc

    found = []
    if departure and sigma:
        worst = max(zip(departure, sigma, strict=True), key=lambda d: abs(d[0]))
        if abs(worst[0]) > 0.005 and abs(worst[0]) > 4 * worst[1]:
            found.append(
                f"the scale the markers give departs by {worst[0]:+.2%} from the known one "
                f"(standard error {worst[1]:.2%})"
            )
    y = registration.fit.problem.y
    if (radius := float(np.sqrt((y**2).sum(axis=1).mean()))) > LARGEST_RADIUS_M:
        found.append(f"the markers lie {radius:.3g} m (rms) from their centre: is the unit metres?")
    unit = registration.fit.problem.sigma_unit_m
    if unit is not None:
        ratio = registration.sigma_m / unit
        if chdtrc(registration.dof, registration.dof * ratio**2) < 0.01:
            found.append(f"the residuals are {ratio:.1f} times what the stated sigmas allow")
    return tuple(found)


def stretch_warning(registration: Registration) -> tuple[str, ...]:
    """Pixels stretched: an affine map of a slice fits far better than a model without, by F.

    A printer's stretch, or a screen's, is no reason to doubt an affine map; `SQUARE` is.
    """
    from scipy.special import fdtrc

    fit, problem = registration.fit, registration.fit.problem
    if registration.source.shape[1] != 2 or fit.used.sum() <= Affine(2).minimal:
        return ()
    free = solve(replace(problem, model=Affine(2)), fit.used)
    least = fit
    if registration.model == "affine":
        least = solve(replace(problem, model=Orthogonal(2, None, "similarity")), fit.used)
    more = least.dof - free.dof
    gain = (least.variance * least.dof / max(free.variance, problem.floor_m**2) - free.dof) / more
    long, short = np.linalg.svd(free.m[:, :2], compute_uv=False)
    expected = registration.model == "affine" and long < SQUARE * short
    seen = registration.perspective
    if expected or (seen and seen.said) or fdtrc(more, free.dof, gain) > STRETCHED:
        return ()
    left = [f"{np.sqrt(3 * one.variance) * 1e3:.3g} mm" for one in (free, least)]
    return (
        f"the markers show pixels {long / short:.3g} times as long as wide, where square ones (or "
        f"of the given spacing) would leave {left[1]} a marker, not {left[0]}: is a column in "
        "another unit, or the pixel spacing or the model another?",
    )


def refuse_sure_faults(registration: Registration, diagnosis: Diagnosis) -> None:
    """Refuse markers that are surely wrong and still in the fit.

    Raises MarkerError: labels exchanged or in another order, residuals far beyond the stated
        sigmas, or a scale that is not the known one
    """
    if diagnosis.relabelled:
        _refuse_relabelled(registration, diagnosis.relabelled)
    unit = registration.fit.problem.sigma_unit_m
    if unit is not None and registration.sigma_m > MAX_OVER_SIGMA * unit:
        raise MarkerError(
            f"the residuals are {registration.sigma_m / unit:.3g} times what the stated sigmas "
            f"allow; at most {MAX_OVER_SIGMA:g} times is allowed (wrong labels, or a marker to "
            "leave out with --robust?)"
        )
    if one_to_blame(registration.fit) is None:
        _refuse_scale(diagnosis)


def _refuse_relabelled(registration: Registration, other: Relabelling) -> None:
    fit = registration.fit
    moved = [i for i, j in enumerate(other.order) if i != j]
    if not other.sure or not fit.used[moved].any():
        return
    everyone = solve(fit.problem)
    rms = float(np.sqrt((everyone.vectors**2).sum(axis=1).mean()))
    what = "the labels are wrong, and more than one other labelling fits"
    if other.alone:
        what = name_labelling(other.order, registration.labels)
    raise MarkerError(
        f"{what}: as labelled the markers miss their places by {rms * 1e3:.3g} mm rms, so by "
        f"{other.rms_m * 1e3:.3g} mm; correct the labels, or leave them out with --robust"
    )


def _refuse_scale(diagnosis: Diagnosis) -> None:
    found = diagnosis.spacing_departure or (), diagnosis.spacing_departure_sigma or ()
    for departure, sigma in zip(*found, strict=True):
        within = 1 / MAX_SCALE_FACTOR <= 1 + departure <= MAX_SCALE_FACTOR
        if abs(departure) > 4 * sigma and not within:
            raise MarkerError(
                f"the markers give {1 + departure:.4g} times the known scale; at most "
                f"{MAX_SCALE_FACTOR:g} times, either way, is allowed (millimetres for metres, or a "
                "wrong pixel spacing?)"
            )
