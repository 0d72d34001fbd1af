"""`plan` is `extract`, then `register`: from a planned slice and its markers to a fixture.

    slice   -> the drawn curve                             extract()
    markers -> transform with its error; the gate on it    register(): match, refine, target_error
    curve   -> points, lines and arcs, and their margin    register(): add_margin, render
    all     -> fixture, with a guide where one is wanted   register(): make_fixture, add_guidance

`extract` ends in a curve (a `Fixture` in the image's pixels); `register` begins with one.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vfplan.engine.choosing import slow_tick_text
from vfplan.errors import SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture, Provenance, size_doubt
from vfplan.io.files import now_utc
from vfplan.planning.extraction import ExtractResult, extract
from vfplan.planning.guidance import add_guidance
from vfplan.planning.margin import add_margin
from vfplan.planning.match import MatchResult, match
from vfplan.planning.rendering import RenderingResult, render
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.planning.touch import RefineResult, refine

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage
    from vfplan.registration import Registration


@dataclass(frozen=True, eq=False)
class RegisterResult:
    """A fixture, the registration it rests on, and what was found, as `--json` reports it."""

    fixture: Fixture
    registration: Registration
    report: dict[str, Any]
    findings: tuple[Finding, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """The texts of the findings."""
        return tuple(finding.text for finding in self.findings)


@dataclass(frozen=True, eq=False)
class PlanResult:
    """A fixture, and the two steps it came from."""

    fixture: Fixture
    extracted: ExtractResult
    registered: RegisterResult

    @property
    def report(self) -> dict[str, Any]:
        """What `plan --json` reports."""
        return {"extract": self.extracted.report, "register": self.registered.report}

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What a person should look at."""
        return self.extracted.findings + self.registered.findings

    @property
    def warnings(self) -> tuple[str, ...]:
        """The texts of the findings."""
        return tuple(finding.text for finding in self.findings)


def plan(
    image: str | Path,
    markers: str | Path,
    markers2: str | Path | None = None,
    *,
    extraction: ExtractSettings | None = None,
    curve: str | Path | None = None,
    settings: FixtureSettings | None = None,
) -> PlanResult:
    """From a planned slice and its markers to a fixture in the robot's frame.

    Parameters
    ----------
    image
        The slice with the curve drawn on it.
    markers, markers2
        One file with both positions of each marker, or two joined by label.
    curve
        A vector curve drawn on the slice, instead of a pen's.
    extraction, settings
        How the curve is read, and how it becomes a fixture.

    Raises
    ------
    ImageError, CurveError, MarkerError, SettingError, MissingExtra
        As `extract` and `register` do.
    InputError
        SOURCE_DATE_EPOCH is no time.
    CheckFailed
        A gate that does not hold, or a guide that leads into what is forbidden.
    """
    extracted = extract(image, extraction, curve=curve)
    registered = register(extracted.fixture, markers, markers2, settings, image=extracted.image)
    return PlanResult(registered.fixture, extracted, registered)


def register(
    curve: Fixture,
    markers: str | Path,
    markers2: str | Path | None = None,
    settings: FixtureSettings | None = None,
    *,
    image: PlannedImage | None = None,
    touched: str | Path | None = None,
    tip_radius: float = 0.0,
) -> RegisterResult:
    """Carry a curve into the frame of the target markers and sample it for rendering.

    That is the robot's, or "patient_lps" where the target side is a Slicer file.

    Parameters
    ----------
    curve
        A fixture in frame "image" or "patient_lps" with its strokes; or a surface in
        "patient_lps", whose samples and triangles are carried over as they are.
    markers, markers2
        One file with both positions of each marker, or two joined by label.
    settings
        The registration, the sampling and the rendering.
    image
        The slice the curve was drawn on; needed to find the markers in it, and where they are
        given in the patient's frame, to which a DICOM slice carries the curve.
    touched, tip_radius
        Points that the robot touched on the surface refine a rigid registration of one; the radius
        [m] of the ball that touched them.

    Raises
    ------
    MarkerError
        Markers that determine no transform, or that no slice or robot can have.
    CurveError, SettingError
    CheckFailed
        A gate that does not hold: positions that meet no drawn marks, mistaken labels, residuals
        above `settings.max_residual_m`, an error that may be larger than `settings.max_tre_m`. Or
        a guide that leads into what is forbidden.
    """
    from vfplan.registration import (
        describe_checks,
        error_findings,
        refuse_large_error,
        registration_report,
        target_error,
    )

    # A SOURCE_DATE_EPOCH that is no time is refused before any work is done.
    now_utc()
    settings = settings or FixtureSettings()
    if curve.mesh is not None and settings.density_per_m is not None:
        raise SettingError(
            "a surface is sampled already; a density has no effect on it. Leave --density out",
            code="density-of-surface",
        )
    started = time.perf_counter()

    # Markers -> transform, or a refusal that names the marker.
    matched = match(curve, markers, markers2, settings, image)
    # `drawn` is the curve as it is measured: in pixels, or in the patient's frame of its slice.
    drawn = matched.curve
    registration = matched.registration
    refined = None
    if touched is not None:
        refined = refine(drawn, registration, touched, tip_radius)
        registration = refined.registration

    # How far the curve may lie from where it belongs.
    error = target_error(registration, drawn.points)
    if settings.max_tre_length_m is not None:
        refuse_large_error(error, settings.max_tre_length_m, registration, drawn.points)
    margin = None
    margin_m = 0.0
    if settings.margin is not None:
        settings, margin = add_margin(drawn, registration, settings)
        margin_m = margin.largest_m

    # The curve in the target frame, sampled as finely as the tolerance asks.
    rendered = render(drawn, registration, settings, matched.slice_axes, margin_m)
    fixture = make_fixture(matched, registration, rendered, settings, refined)
    guide_report: dict[str, Any] = {}
    guide_findings: tuple[Finding, ...] = ()
    if settings.guide_m is not None:
        fixture, guide_report, guide_findings = add_guidance(fixture, settings)

    # What a person should look at.
    findings = list(matched.findings)
    if refined is None:
        findings += error_findings(error)
    else:
        findings += refined.findings
    findings += rendered.findings
    findings += guide_findings
    size = size_doubt(fixture.points)
    if size is not None:
        findings.append(doubt("size-unusual", "plan", size))
    if fixture.pieces is not None:
        work = slow_tick_text(fixture)
        if work is not None:
            findings.append(doubt("tick-too-long", "plan", work))
    # The curve's own findings keep no place: theirs is in the frame that the fixture has left.
    earlier = [replace(finding, place_m=None) for finding in curve.findings]
    fixture = replace(fixture, findings=(*earlier, *findings))

    # The report: the markers' own fit, and what the touched points made of it.
    report = registration_report(matched.registration, drawn.points, error=error)
    report |= describe_checks(matched.registration)
    report |= {"target_frame": fixture.frame} | rendered.report | matched.report | guide_report
    if margin is not None:
        report["margin"] = margin.report
    if refined is not None:
        report |= {"T_robot_image": registration.T_target_source, "touched": refined.report}
        report["tre"]["worst_target_m"] = registration.apply(drawn.points[[error.worst]])[0]
    report["elapsed_s"] = time.perf_counter() - started
    return RegisterResult(fixture, registration, report, tuple(findings))


def make_fixture(
    matched: MatchResult,
    registration: Registration,
    rendered: RenderingResult,
    settings: FixtureSettings,
    refined: RefineResult | None,
) -> Fixture:
    """The carried curve as a fixture, with the files and settings that it came from.

    Only in the robot's frame a bundle holds its slice and its registration (docs/format.md).
    """
    source = matched.curve
    carried = rendered.carried
    target_frame = matched.correspondences.target_frame

    # The curve's provenance, continued.
    inputs = source.provenance.inputs | matched.correspondences.inputs
    if refined is not None:
        inputs = inputs | {"touched": refined.sha256}
    choices = rendered.settings
    fit = matched.registration
    if not fit.used.all():
        excluded = [str(fit.labels[i]) for i in np.flatnonzero(~fit.used)]
        choices["markers_left_out"] = ",".join(excluded)
    if source.mesh is not None:
        # The samples of a surface keep the tolerance that they were made with.
        settings = replace(settings, tolerance_m=None)
    earlier = source.provenance
    now = Provenance.now(inputs, settings)
    provenance = replace(
        now, settings=earlier.settings | now.settings | choices, history=earlier.history
    )

    image = None
    record = None
    if target_frame == "robot_base":
        image = source.image
        record = registration.record(carried.source, source_frame=source.frame)
    return Fixture(
        frame=target_frame,
        points=carried.points,
        provenance=provenance,
        sigma=carried.sigma,
        curve=carried.curve,
        image=image,
        rendering=rendered.rendering,
        registration=record,
        mesh=source.mesh,
        sample_radius=source.sample_radius,
    )
