"""The scale that markers give, held against the scale that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vfplan.errors import MarkerError
from vfplan.findings import Finding, doubt, note
from vfplan.registration.distributions import f_exceeds
from vfplan.registration.fit import RARE_PROBABILITY, fit_model, fit_similarity
from vfplan.registration.models import Affine
from vfplan.registration.registration import Registration

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
    fit, problem = registration.fit, registration.fit.problem
    k = problem.model.dimension
    if k == 2 and registration.pixel_spacing is None:
        return []
    if registration.model == "rigid":
        fit = fit_similarity(problem, fit.used)
    axes = k if registration.model == "affine" else 1
    radius = problem.normaliser.radius
    covariance = fit.covariance.reshape(3, k + 1, 3, k + 1)
    departures = []
    for axis in range(axes):
        column = fit.m[:, axis]
        length = float(np.linalg.norm(column))
        variance = column @ covariance[:, axis, :, axis] @ column / length**2
        departures.append((length / radius - 1, float(np.sqrt(max(variance, 0.0))) / radius))
    return departures


def refuse_wrong_scale(registration: Registration) -> None:
    """Refuse a scale that is more than twice the known one, or less than half (`MarkerError`)."""
    for departure, standard_error in scale_departures(registration):
        ratio = 1 + departure
        is_another_unit = not 1 / MAX_RATIO <= ratio <= MAX_RATIO
        if is_another_unit and abs(departure) > STANDARD_ERRORS * standard_error:
            raise MarkerError(
                f"the markers give {ratio:.4g} times the known scale; {1 / MAX_RATIO:g} to "
                f"{MAX_RATIO:g} times are allowed. Look for millimetres given as metres, or give "
                "the right --pixel-spacing",
                code="scale-wrong",
                numbers={"ratio": ratio},
            )


def scale_findings(registration: Registration) -> list[Finding]:
    """A scale that departs from the known one by more than its error, or that nothing checks."""
    departures = scale_departures(registration)
    if not departures:
        along_u, along_v = registration.T_target_source[:3, :2].T
        pixel_mm = 1e3 * float(np.sqrt(np.linalg.norm(np.cross(along_u, along_v))))
        text = (
            "The pixel size is not known, so the scale was not checked: one pixel is "
            f"{pixel_mm:.3g} mm by the markers. Give --pixel-spacing MM if you know it."
        )
        return [note("scale-unchecked", "register", text)]
    departure, standard_error = max(departures, key=lambda pair: abs(pair[0]))
    if abs(departure) <= max(DEPARTURE, STANDARD_ERRORS * standard_error):
        return []
    text = (
        f"The markers give a scale that departs by {departure:+.2%} from the known one (standard "
        f"error {standard_error:.2%}). Check the pixel spacing."
    )
    return [doubt("scale-departs", "register", text)]


def stretch_findings(registration: Registration) -> list[Finding]:
    """Pixels that are not square, or not of the given ratio, where the model or a user says so.

    By the F test of an affine map against a similarity.
    """
    problem, used = registration.fit.problem, registration.used
    affine = Affine(2)
    if problem.model.dimension != 2 or 3 * used.sum() <= affine.parameters:
        return []
    free = fit_model(replace(problem, model=affine), used)
    square = fit_similarity(problem, used) if registration.model == "affine" else registration.fit
    long, short = np.linalg.svd(free.m[:, :2], compute_uv=False)
    if registration.model == "affine" and long < MAX_STRETCH * short:
        return []
    free_squares = max(free.variance * free.dof, problem.rounding_floor_m**2)
    square_squares = square.variance * square.dof
    more = square.dof - free.dof
    f = ((square_squares - free_squares) / more) / (free_squares / free.dof)
    if f_exceeds(more, free.dof, max(f, 0.0)) > RARE_PROBABILITY:
        return []
    text = (
        f"By the markers a pixel is {long / short:.3g} times as long as wide. Look for a column "
        "in another unit, or for another --pixel-spacing or --model."
    )
    return [doubt("pixels-stretched", "register", text)]
