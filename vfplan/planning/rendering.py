"""How a fixture is rendered: what the tolerance chose, and what the scene does without.

A planned curve as a guide: the tube it allows, and whether it leads into what is forbidden.
"""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import FINEST_BAND, ProxyParameters, check_axis
from vfplan.errors import CheckFailed, SettingError
from vfplan.findings import Finding, doubt, note
from vfplan.fixture import Fixture, Guidance, Rendering
from vfplan.planning.settings import FixtureSettings
from vfplan.planning.tolerance import (
    BAND_SHARE,
    CarriedPoints,
    Choice,
    carry,
    check_arcs_error,
    choose,
    lines_and_arcs_of,
)

if TYPE_CHECKING:
    from vfplan.registration.registration import Registration


# Settings that points need and lines and arcs do not.
POINT_SETTINGS = ("spacing", "band", "max_iterations")

# An ignored axis further than this from the slice's normal would collapse the curve.
MAX_IGNORED_TILT_DEG = 45.0


@dataclass(frozen=True, eq=False)
class RenderingResult:
    """The fixture's points, and how they are rendered."""

    carried: CarriedPoints
    rendering: Rendering
    # From the tolerance; `None` where it had nothing to choose.
    choice: Choice | None
    # What the scene does without, counted: points, coordinates, settings.
    left_out: dict[str, int]

    @property
    def report(self) -> dict[str, Any]:
        """What `register --json` reports of the fixture's points."""
        carried = self.carried
        report: dict[str, Any] = {
            "points": len(carried.points),
            "spacing_m": carried.spacing_m,
            "left_out": self.left_out,
        }
        if carried.curve is not None and carried.curve.pieces is not None:
            pieces = carried.curve.pieces
            report["pieces"] = {"lines_and_arcs": pieces.count, "error_m": pieces.error}
        if self.choice is not None:
            choice, spacing_error_m = self.choice, carried.sampling_error_m or 0.0
            report["chosen"] = {
                "tolerance_m": choice.tolerance_m,
                "tolerance_used_m": choice.used_tolerance_m,
                "spacing_m": choice.spacing_m,
                "band_m": choice.band_m,
                "max_iterations": choice.max_iterations,
                "error_m": {
                    "spacing": carried.sampling_error_m,
                    "band": choice.band_m,
                    "iterations": choice.lag_m,
                    "total": spacing_error_m + choice.band_m + choice.lag_m,
                },
            }
        if carried.sampling_error_m is not None:
            report["sampling_error_m"] = carried.sampling_error_m
        if carried.tight_bends:
            report["tight_bends"] = [asdict(bend) for bend in carried.tight_bends]
        return report

    @property
    def settings(self) -> dict[str, float | int]:
        """The same for a bundle's provenance, flat."""
        flat: dict[str, float | int] = {}
        for name, count in self.left_out.items():
            flat[f"left_out_{name}"] = count
        if self.choice is not None:
            flat["chosen_tolerance_m"] = self.choice.used_tolerance_m
            for name in ("spacing_m", "band_m", "max_iterations", "lag_m"):
                flat[f"chosen_{name}"] = getattr(self.choice, name)
        return flat

    @property
    def findings(self) -> tuple[Finding, ...]:
        """That less than the tolerance asked for was used."""
        choice = self.choice
        if choice is None or choice.used_tolerance_m == choice.tolerance_m:
            return ()
        text = (
            f"The tolerance of {choice.tolerance_m * 1e3:g} mm is more than r_c + r_v allow. "
            f"{choice.used_tolerance_m * 1e3:.4g} mm was used, because wider spacing would be "
            "felt as bumps."
        )
        return (note("tolerance-reduced", "plan", text),)


def render(
    curve: Fixture,
    registration: Registration,
    settings: FixtureSettings,
    slice_axes: NDArray[np.float64] | None,
    margin_m: float,
) -> RenderingResult:
    """Choose from the tolerance, carry the curve over, and lay lines and arcs along it.

    Parameters
    ----------
    slice_axes
        (3, 2) of a slice's pixels in the patient; `None` for any other curve.
    margin_m
        What was added to the curve for safety.

    Raises
    ------
    SettingError
        A tolerance whose band would be finer than the engine takes, an ignored axis that would
        collapse the curve, or lines and arcs that are too coarse for the margin.
    """
    # From the tolerance: spacing, band and iteration limit. A density or a bare cloud leaves no
    # choice.
    choice, sampling_tolerance_m = None, None
    radius_m = settings.contact_radius + settings.point_radius
    if curve.curve is not None and settings.density_per_m is None:
        smallest_m = FINEST_BAND / BAND_SHARE * radius_m
        if settings.tolerance_m < smallest_m:
            raise SettingError(
                f"tolerance is {1e3 * settings.tolerance_m:g} mm, less than "
                f"{FINEST_BAND / BAND_SHARE:g} of r_c + r_v = {1e3 * radius_m:g} mm. Give at "
                f"least {1e3 * smallest_m:g} mm",
                code="tolerance-fine",
                numbers={"tolerance_m": settings.tolerance_m, "smallest_m": smallest_m},
            )
        is_drawn = curve.image is not None or curve.frame == "image"
        is_planar = settings.ignore_axis != "none" if settings.ignore_axis is not None else is_drawn
        choice = choose(settings.tolerance_m, radius_m, planar=is_planar)
        sampling_tolerance_m = choice.sampling_tolerance_m

    # The curve in the target frame, and how its points are rendered.
    carried = carry(curve, registration, settings, sampling_tolerance_m)
    axis = ignored_axis(settings.ignore_axis, registration, slice_axes)
    band_m, max_iterations = None, None
    if choice is not None:
        band_m, max_iterations = choice.band_m, choice.max_iterations
    if curve.sample_radius is not None:
        from vfplan.bundle.importing import sample_band

        band_m = sample_band(curve.sample_radius, radius_m)
    elif curve.mesh is not None:
        from vfplan.bundle.importing import mesh_band

        band_m = mesh_band(carried.points, curve.mesh, radius_m)
    parameters = ProxyParameters.make(
        carried.points,
        contact_radius=settings.contact_radius,
        band=band_m,
        point_radius=settings.point_radius,
        stiffness=np.broadcast_to(settings.stiffness, 3),
        ignore_axis=axis,
    )
    rendering = Rendering(
        parameters.stiffness, parameters.rc, parameters.band, parameters.rv, axis, max_iterations
    )

    # Where the curve is known as lines and arcs, the choice is that of the points alone.
    pieces = lines_and_arcs_of(curve, registration, axis, settings, carried)
    if pieces is not None:
        check_arcs_error(pieces, margin_m, settings)
        carried = replace(carried, curve=replace(carried.curve, pieces=pieces))
        left_out = {
            "points": len(carried.points),
            "coordinates": 1,
            "settings": len(POINT_SETTINGS),
        }
        return RenderingResult(carried, rendering, None, left_out)
    left_out = {"points": max(0, len(curve.points) - len(carried.points))}
    if axis is not None:
        left_out["coordinates"] = 1
    return RenderingResult(carried, rendering, choice, left_out)


def ignored_axis(
    choice: str | None, registration: Registration, slice_axes: NDArray[np.float64] | None = None
) -> NDArray[np.float64] | None:
    """(3,) unit vector along which the fixture is infinite; `None` for a fixture in space.

    A drawn slice is extruded along its plane's normal unless told otherwise, as the paper ignores
    z in Experiment 2; a curve in space is not extruded.

    Raises `SettingError` for an axis that would collapse the slice, or a normal of no slice.
    """
    T = registration.T_target_source
    is_planar = slice_axes is not None or registration.source.shape[1] == 2
    if choice is None:
        choice = "normal" if is_planar else "none"
    if choice == "none":
        return None
    if not is_planar:
        if choice == "normal":
            raise SettingError(
                "a curve in space has no slice normal. Ignore x, y, z or none", code="no-normal"
            )
        return check_axis(choice)
    columns = T[:3, :2]
    if slice_axes is not None:
        columns = T[:3, :3] @ slice_axes
    normal = np.cross(columns[:, 0], columns[:, 1])
    normal /= np.linalg.norm(normal)
    if choice == "normal":
        return normal
    axis = check_axis(choice)
    tilt_deg = np.degrees(np.arccos(min(1.0, abs(axis @ normal))))
    if tilt_deg > MAX_IGNORED_TILT_DEG:
        raise SettingError(
            f"ignoring {choice} would collapse the curve: it is {tilt_deg:.1f} degrees from "
            f"the slice's normal, and at most {MAX_IGNORED_TILT_DEG:g} are allowed. Ignore "
            "the normal",
            code="axis-collapses",
            numbers={"tilt_deg": float(tilt_deg)},
        )
    return axis


def add_guidance(
    fixture: Fixture, settings: FixtureSettings
) -> tuple[Fixture, dict[str, Any], tuple[Finding, ...]]:
    """The fixture with the guidance that was asked for, its part of the report, and findings.

    Raises SettingError: a tube that runs into itself or is wider than a bend, or a stroke that is
        not there
    Raises CheckFailed: the guide leads into the forbidden region of the other strokes; the message
        has the place
    """
    from vfplan.engine.guide import Guide

    stroke = settings.guide_stroke
    if fixture.curve is None or not len(fixture.curve.closed):
        raise SettingError(
            "a guide needs a drawn curve; this fixture is a surface or a cloud. Leave --guide out",
            code="guide-without-curve",
        )
    stroke_count = len(fixture.curve.closed)
    if stroke is not None and stroke_count == 1:
        raise SettingError(
            f"guide stroke {stroke}: the curve is one stroke, which guides without it. Leave "
            "--guide-stroke out",
            code="guide-stroke",
        )
    if stroke is not None and not 0 <= stroke < stroke_count:
        raise SettingError(
            f"guide stroke {stroke} is not among the {stroke_count} strokes. Give 0 to "
            f"{stroke_count - 1}, or leave it out and all guide",
            code="guide-stroke",
        )
    guiding = fixture.curve.closed
    if stroke is not None:
        guiding = guiding[[stroke]]
    if settings.guide_ends is not None and guiding.all():
        raise SettingError(
            "a closed curve has no ends that could stop or let go. Leave --ends out",
            code="guide-ends",
        )
    guidance = Guidance(
        settings.guide_m, min(settings.stiffness), settings.guide_ends or "stop", stroke,
        *settings.guide_pull,
    )  # fmt: skip
    fixture = replace(fixture, guidance=guidance)
    # The finding below says what the guide warns of.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        guide = Guide.of(fixture, cut_bends=settings.guide_cut_bends)
    report = {
        "radius_m": guidance.radius,
        "stiffness_n_per_m": guidance.stiffness,
        "ends": guidance.ends,
        "lead_force_n": guidance.lead_force or 0.0,
        "lengths_m": guide.lengths_m,
    }
    findings = []
    if guide.tight_bend:
        findings.append(doubt("guide-tight-bend", "plan", guide.tight_bend))
    if stroke is not None:
        report["stroke"] = stroke
        report["clearance_min_m"], overlap = clearance(fixture, guide)
        findings += overlap
    return fixture, {"guide": report}, tuple(findings)


def clearance(fixture: Fixture, guide: Any) -> tuple[float, list[Finding]]:
    """The smallest distance [m] between the guide's curve and the proxy's forbidden positions.

    Raises CheckFailed: the curve itself is forbidden somewhere
    """
    from vfplan.engine.proxy import ProxyEngine

    radius = fixture.contact_radius + fixture.point_radius
    region = ProxyEngine.of(fixture.region, offline=True)
    step = min(guide.radius, 0.1 * radius)
    arcs = np.linspace(0, guide.lengths_m[0], 2 + int(guide.lengths_m[0] / step))
    places = guide.at(arcs)
    clearances = region.distance(places) - radius
    worst = int(clearances.argmin())
    smallest = float(clearances[worst])
    x, y, z = 1e3 * places[worst]
    where = f"at arc {1e3 * arcs[worst]:.4g} mm, [{x:.4g}, {y:.4g}, {z:.4g}] mm"
    if smallest < 0:
        raise CheckFailed(
            f"the guide leads into the forbidden region: {where}, it comes within "
            f"{1e3 * (smallest + radius):.4g} mm, and R = {1e3 * radius:g} mm is the least. "
            "Draw it further away, or give a smaller --contact-radius",
            code="guide-forbidden",
            numbers={"distance_m": smallest + radius, "allowed_m": radius},
        )
    if smallest >= guide.radius:
        return smallest, []
    text = (
        f"The guide's tube of {1e3 * guide.radius:g} mm reaches into the forbidden region "
        f"{where}: {1e3 * smallest:.4g} mm are free there, and both forces act. Give a "
        "narrower --guide."
    )
    place = tuple(places[worst].tolist())
    return smallest, [doubt("guide-in-forbidden", "plan", text, place_m=place)]
