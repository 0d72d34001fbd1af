"""`plan` is `extract`, then `register`: from a planned slice and its markers to a fixture.

    slice   -> the drawn curve                             extract()
    markers -> transform with its error; the gate on it    register(): match, touch, target_error
    curve   -> what keeps its margin -> points, settings   register(): add_margin, render
    all     -> fixture, with a guide where one is asked    register(): _fixture, add_guidance

`extract` ends in a curve (a `Fixture` in the image's pixels); `register` begins with one.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vfplan.engine.renderable import work_doubt
from vfplan.errors import SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture, Provenance, size_doubt
from vfplan.io.files import now_utc
from vfplan.planning.extracting import Extracted, describe_extraction, extract, planned_curve
from vfplan.planning.guiding import add_guidance
from vfplan.planning.margin import add_margin
from vfplan.planning.match import MatchResult, match
from vfplan.planning.rendering import Rendered, render
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.planning.touching import touch

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage
    from vfplan.registration import Registration

__all__ = [
    "ExtractSettings", "Extracted", "FixtureSettings", "Plan", "Planned", "describe_extraction",
    "extract", "plan", "planned_curve", "register",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Planned:
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
class Plan:
    """A fixture, and the two steps it came from."""

    fixture: Fixture
    extracted: Extracted
    registered: Planned

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
) -> Plan:
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
        The registration's error may be larger than `settings.max_tre_m`, or the guide leads into
        what is forbidden.
    """
    extracted = extract(image, extraction, curve=curve)
    registered = register(extracted.fixture, markers, markers2, settings, image=extracted.image)
    return Plan(registered.fixture, extracted, registered)


def register(
    curve: Fixture,
    markers: str | Path,
    markers2: str | Path | None = None,
    settings: FixtureSettings | None = None,
    *,
    image: PlannedImage | None = None,
    touched: str | Path | None = None,
    tip_radius: float = 0.0,
) -> Planned:
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
    now_utc()  # refuses a SOURCE_DATE_EPOCH that is no time before any work is done
    from vfplan.registration import describe
    from vfplan.registration.checks import (
        describe_checks,
        error_findings,
        refuse_large_error,
    )
    from vfplan.registration.error import target_error

    settings = settings or FixtureSettings()
    if curve.mesh is not None and settings.density_per_m is not None:
        raise SettingError("a surface is sampled already; a density has no effect on it")
    started = time.perf_counter()
    # Markers -> transform, with its error along the curve.
    matched = match(curve, markers, markers2, settings, image)
    drawn, registration = matched.curve, matched.registration
    refined = None if touched is None else touch(drawn, registration, touched, tip_radius)
    registration = registration if refined is None else refined.registration
    error = target_error(registration, drawn.points)
    if (max_tre_m := settings.largest_tre_m) is not None:
        refuse_large_error(error, max_tre_m, registration, drawn.points)
    # The curve -> what keeps its margin -> points, and how they are rendered.
    guarded, making, margin = drawn, settings, None
    if settings.margin is not None:
        guarded, making, margin = add_margin(drawn, registration, settings)
    added_m = 0.0 if margin is None else margin.largest_m
    rendered = render(guarded, registration, making, matched.slice_axes, added_m)
    # All of it -> a fixture.
    inputs = matched.correspondences.inputs | (
        {} if refined is None else {"touched": refined.sha256}
    )
    provenance = _provenance(guarded, making, inputs, rendered.settings | _left_out(matched))
    fixture = _fixture(matched, guarded, registration, rendered, provenance)
    guide, guide_findings = {}, ()
    if settings.guide_m is not None:
        fixture, guide, guide_findings = add_guidance(fixture, settings)
    # What was found on the way: the markers' own fit, and what the touched points made of it.
    report = describe(matched.registration, drawn.points, error=error)
    report |= describe_checks(matched.registration)
    report |= {"target_frame": fixture.frame} | rendered.report | matched.report | guide
    if margin is not None:
        report["margin"] = margin.report
    if refined is not None:
        report |= {"T_robot_image": registration.T_target_source, "touched": refined.report}
        report["tre"]["worst_target_m"] = registration.apply(drawn.points[[error.worst]])[0]
    report["elapsed_s"] = time.perf_counter() - started
    findings = list(matched.findings)
    findings += error_findings(error) if refined is None else refined.findings
    findings += rendered.findings
    findings += guide_findings
    findings += _fixture_findings(fixture)
    # What was found before travels on, without places in a frame that the fixture leaves.
    before = tuple(replace(finding, place_m=None) for finding in curve.findings)
    fixture = replace(fixture, findings=(*before, *findings))
    return Planned(fixture, registration, report, tuple(findings))


def _left_out(matched: MatchResult) -> dict[str, str]:
    """The bundle says which markers its registration does not rest on."""
    fitted = matched.registration
    if fitted.used.all():
        return {}
    pairs = zip(fitted.labels, fitted.used, strict=True)
    return {"markers_left_out": ",".join(str(label) for label, used in pairs if not used)}


def _provenance(
    curve: Fixture,
    settings: FixtureSettings,
    inputs: dict[str, str],
    found: dict[str, Any],
) -> Provenance:
    """The curve's provenance, continued by the files that were read and what was found."""
    before = curve.provenance
    if curve.mesh is not None:  # its samples keep the tolerance that it was made with
        settings = replace(settings, tolerance_m=None)
    now = Provenance.now(before.inputs | inputs, settings)
    return replace(now, settings=before.settings | now.settings | found, history=before.history)


def _fixture(
    matched: MatchResult,
    curve: Fixture,
    registration: Registration,
    rendered: Rendered,
    provenance: Provenance,
) -> Fixture:
    """Only in the robot's frame a bundle holds its slice and its registration (docs/format.md)."""
    carried, in_robot = rendered.carried, matched.correspondences.target_frame == "robot_base"
    record = registration.record(carried.source, source_frame=curve.frame) if in_robot else None
    return Fixture(
        frame=matched.correspondences.target_frame,
        points=carried.points,
        provenance=provenance,
        sigma=carried.sigma,
        curve=carried.curve,
        image=curve.image if in_robot else None,
        rendering=rendered.rendering,
        registration=record,
        mesh=curve.mesh,
    )


def _fixture_findings(fixture: Fixture) -> list[Finding]:
    """What of the fixture itself a person should look at."""
    findings = []
    size = size_doubt(fixture.points)
    if size is not None:
        findings.append(doubt("size-unusual", "plan", size))
    if fixture.curve is not None and fixture.curve.pieces is not None:
        work = work_doubt(fixture)
        if work is not None:
            findings.append(doubt("tick-too-long", "plan", work))
    return findings
