"""From a planned slice and its markers to a fixture: `plan` calls `extract`, then `register`.

    slice              -> the drawn curve                        extract()
    markers            -> the registration and its error         register(): match, target_error
    curve              -> points, lines and arcs for the robot   register(): add_margin, render
    all of these       -> the fixture, with a guide if wanted    register(): make_fixture

`extract` gives the curve as a `Fixture` whose points are pixels of the slice. `register` turns that
into a `Fixture` whose points lie in front of the robot.

A safety margin against registration error: a fixture that is thicker by it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vfplan.engine.proxy import slow_tick_text
from vfplan.errors import InputError, SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture, Provenance, size_doubt
from vfplan.io.files import now_utc
from vfplan.planning.extraction import ExtractResult, extract
from vfplan.planning.match import MatchResult, RefineResult, match, refine
from vfplan.planning.rendering import RenderingResult, add_guidance, render
from vfplan.planning.settings import ExtractSettings, FixtureSettings

if TYPE_CHECKING:
    from vfplan.fixture import Fixture
    from vfplan.images.read import PlannedImage
    from vfplan.planning.settings import FixtureSettings
    from vfplan.registration.registration import Registration


@dataclass(frozen=True)
class Margin:
    """What was added to the point radius."""

    # "tre95", or "given" for a number of metres.
    kind: str
    # The margin [m], the same all along the curve.
    largest_m: float

    @property
    def report(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "kind": self.kind,
            "side": "both",
            "largest_m": self.largest_m,
            "added_point_radius_m": self.largest_m,
        }


def add_margin(
    curve: Fixture, registration: Registration, settings: FixtureSettings
) -> tuple[FixtureSettings, Margin]:
    """The settings with a point radius that is larger by the margin that they ask for.

    "tre95" is the largest value, along the curve, of the bound that the registration's error stays
    within over the whole curve with probability 0.95. A number is a margin [m].

    Raises SettingError: an unknown margin
    """
    margin = settings.margin
    if margin == "tre95":
        kind, bound_m = "tre95", float(registration.tre95_curve_m(curve.points).max())
    else:
        is_number = isinstance(margin, Real) and not isinstance(margin, bool)
        if not is_number or not 0 <= margin < np.inf:
            raise SettingError(
                f"margin is {margin!r}. Give metres of at least 0, 'tre95' or none",
                code="margin-unknown",
            )
        kind, bound_m = "given", float(margin)
    # Up to the next nanometre: an id must not depend on a processor's last bit.
    margin_m = float(np.ceil(bound_m * 1e9) / 1e9)
    thicker = replace(settings, point_radius=settings.point_radius + margin_m)
    return thicker, Margin(kind, margin_m)


@dataclass(frozen=True, eq=False)
class RegisterResult:
    """A fixture, the registration it rests on, the report that `--json` prints, and findings."""

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
        A file of a curve that was drawn on the slice as vectors; no pen is then looked for.
    extraction, settings
        How the curve is extracted, and how it becomes a fixture.

    Raises
    ------
    ImageError, CurveError, MarkerError, SettingError, MissingExtra
        As `extract` and `register` do.
    InputError
        The slice and the markers are in the wrong order, or the environment variable
        SOURCE_DATE_EPOCH is no time.
    CheckFailed
        A gate does not hold, or a guide leads into what is forbidden.
    """
    refuse_wrong_order(image, markers, markers2)
    extracted = extract(image, extraction, curve=curve)
    registered = register(extracted.fixture, markers, markers2, settings, image=extracted.image)
    return PlanResult(registered.fixture, extracted, registered)


def refuse_wrong_order(
    image: str | Path, markers: str | Path | None, markers2: str | Path | None
) -> None:
    """Refuse markers in the place of the slice.

    Raises `InputError` where the first file is a table of markers, or no picture while another is.
    """
    from vfplan.images.read import is_picture_file

    if is_picture_file(image) or not Path(image).is_file():
        return
    found = "it holds markers" if holds_markers(image) else None
    for path in (markers, markers2):
        if path is not None and is_picture_file(path):
            found = f"{path} is a picture"
    if found is not None:
        raise InputError(
            f"the files are in the wrong order: {found}. Give the slice first and the markers "
            "after it: IMAGE MARKERS [MARKERS2]",
            where=str(image),
            code="wrong-order",
        )


def holds_markers(path: str | Path) -> bool:
    """Whether a file is a sound table of markers; a table of a curve has no labels."""
    from vfplan.markers.correspondences import read_sides

    if Path(path).suffix.lower() not in (".csv", ".txt", ".tsv"):
        return False
    try:
        read_sides(Path(path))
    except InputError:
        return False
    return True


def register(
    unregistered: Fixture,
    markers: str | Path,
    markers2: str | Path | None = None,
    settings: FixtureSettings | None = None,
    *,
    image: PlannedImage | None = None,
    touched: str | Path | None = None,
    tip_radius: float = 0.0,
) -> RegisterResult:
    """Carry a curve or a surface by markers to the robot, and say how it is rendered there.

    The fixture is then in the robot's frame. Where the second positions of the markers come from a
    file of 3D Slicer, it is in the patient's frame, "patient_lps".

    Parameters
    ----------
    unregistered
        What is to be carried: a curve in frame "image" or "patient_lps", or a surface in
        "patient_lps". The points and triangles of a surface are carried as they are.
    markers, markers2
        One file with both positions of each marker, or two joined by label.
    settings
        How the markers are registered, the curve is sampled and the fixture is rendered.
    image
        The slice that the curve was drawn on. With it, the positions of the markers are compared
        with the marks that are drawn on the slice. It is needed where the markers are given in the
        patient's frame: a DICOM slice says where its pixels lie there.
    touched
        A file of points that the robot touched on a surface. They refine a rigid registration.
    tip_radius
        The radius of the ball that touched them [m].

    Raises
    ------
    MarkerError
        Markers that determine no transform, or that no slice or robot can have.
    CurveError, SettingError
    CheckFailed
        A gate does not hold: the markers lie at no drawn marks, their labels are mistaken, their
        residuals exceed `settings.max_residual_m`, or the error may exceed `settings.max_tre_m`.
        Or a guide leads into what is forbidden.
    """
    from vfplan.registration.checks import describe_checks, error_findings, refuse_large_error
    from vfplan.registration.registration import registration_report, target_error

    # A SOURCE_DATE_EPOCH that is no time is refused before any work is done.
    now_utc()
    settings = settings or FixtureSettings()
    if unregistered.mesh is not None and settings.density_per_m is not None:
        raise SettingError(
            "a surface is sampled already; a density has no effect on it. Leave --density out",
            code="density-of-surface",
        )
    started = time.perf_counter()

    # Markers -> registration, or a refusal that names the marker.
    matched = match(unregistered, markers, markers2, settings, image)
    # The curve in the frame in which the markers are given: that of the image, or the patient's.
    curve = matched.curve
    registration = matched.registration
    # Touched points give a second registration, which begins at that of the markers.
    refined = None
    if touched is not None:
        refined = refine(curve, registration, touched, tip_radius)
        registration = refined.registration

    # How far the curve may lie from where it belongs.
    error = target_error(registration, curve.points)
    if settings.max_tre_length_m is not None:
        taken_from = "contact radius" if settings.max_tre_m == "contact radius" else ""
        refuse_large_error(
            error, settings.max_tre_length_m, registration, curve.points, taken_from=taken_from
        )

    # A margin makes the fixture thicker: from here on `settings.point_radius` includes it.
    margin = None
    margin_m = 0.0
    if settings.margin is not None:
        settings, margin = add_margin(curve, registration, settings)
        margin_m = margin.largest_m

    # The curve in front of the robot, sampled as finely as the tolerance asks. `render` needs the
    # margin to check that lines and arcs follow the curve more closely than the margin is wide.
    rendered = render(curve, registration, settings, matched.slice_axes, margin_m)
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
    unusual_size = size_doubt(fixture.points)
    if unusual_size is not None:
        findings.append(doubt("size-unusual", "plan", unusual_size))
    if fixture.pieces is not None:
        slow_tick = slow_tick_text(fixture)
        if slow_tick is not None:
            findings.append(doubt("tick-too-long", "plan", slow_tick))
    # Extraction's findings come first. A place [m] in the curve's old frame would mislead here.
    of_extraction = [replace(finding, place_m=None) for finding in unregistered.findings]
    fixture = replace(fixture, findings=(*of_extraction, *findings))

    # The report. Residuals and checks are those of the registration by markers. The error is that
    # of the registration in use, which touched points may have refined.
    report = registration_report(matched.registration, curve.points, error=error)
    report |= describe_checks(matched.registration)
    report |= {"target_frame": fixture.frame} | rendered.report | matched.report | guide_report
    if margin is not None:
        report["margin"] = margin.report
    if refined is not None:
        report |= {"T_robot_image": registration.T_target_source, "touched": refined.report}
        report["tre"]["worst_target_m"] = registration.apply(curve.points[[error.worst]])[0]
    report["elapsed_s"] = time.perf_counter() - started
    return RegisterResult(fixture, registration, report, tuple(findings))


def make_fixture(
    matched: MatchResult,
    registration: Registration,
    rendered: RenderingResult,
    settings: FixtureSettings,
    refined: RefineResult | None,
) -> Fixture:
    """The fixture of the rendered curve, with the files and settings that it came from."""
    curve = matched.curve
    carried = rendered.carried
    target_frame = matched.correspondences.target_frame

    # What the curve came from, and what was added to it here.
    inputs = curve.provenance.inputs | matched.correspondences.inputs
    if refined is not None:
        inputs = inputs | {"touched": refined.sha256}
    chosen = rendered.settings
    by_markers = matched.registration
    if not by_markers.used.all():
        labels = [str(by_markers.labels[i]) for i in np.flatnonzero(~by_markers.used)]
        chosen["markers_left_out"] = ",".join(labels)
    if curve.mesh is not None:
        # The samples of a surface keep the tolerance that they were made with.
        settings = replace(settings, tolerance_m=None)
    provenance = Provenance.now(inputs, settings)
    provenance = replace(
        provenance,
        settings=curve.provenance.settings | provenance.settings | chosen,
        history=curve.provenance.history,
    )

    # Only a bundle in the robot's frame holds its slice and its registration (docs/format.md).
    image = None
    record = None
    if target_frame == "robot_base":
        image = curve.image
        record = registration.record(carried.source, source_frame=curve.frame)
    return Fixture(
        frame=target_frame,
        points=carried.points,
        provenance=provenance,
        sigma=carried.sigma,
        curve=carried.curve,
        image=image,
        rendering=rendered.rendering,
        registration=record,
        mesh=curve.mesh,
        sample_radius=curve.sample_radius,
    )
