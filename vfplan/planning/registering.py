"""Curve + markers -> transform with its error -> points -> a fixture in the markers' frame."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vfplan.engine.renderable import work_doubt
from vfplan.errors import SettingError
from vfplan.fixture import Fixture, Provenance, Rendering, size_doubt
from vfplan.io.reading import OneFile, now_utc
from vfplan.planning.carrying import Carried, carry, pieces_of, require_small
from vfplan.planning.guiding import add_guidance
from vfplan.planning.margin import add_margin
from vfplan.planning.matching import Matched, match
from vfplan.planning.rendering import (
    as_settings,
    capped,
    choice_of,
    describe_carried,
    left_out,
    rendering_of,
)
from vfplan.planning.settings import FixtureSettings
from vfplan.planning.touching import touch

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage
    from vfplan.registration import Registration


@dataclass(frozen=True, eq=False)
class Planned:
    """A fixture, the registration it rests on, and what was found, as `--json` reports it."""

    fixture: Fixture
    registration: Registration
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()


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
        Markers that determine no transform, or that are surely wrong; see
        `vfplan.planning.matching.match`.
    CurveError, SettingError
    CheckFailed
        The registration's error may be larger than `settings.max_tre_m`, or the guide leads into
        what is forbidden.
    """
    now_utc()  # what is no time is refused before NumPy stumbles on it
    from vfplan.registration.report import check_max_tre, target_error
    from vfplan.registration.report import describe as describe_registration

    settings = settings or FixtureSettings()
    if curve.mesh is not None and settings.density_per_m is not None:
        raise SettingError("a surface is sampled already; a density has no effect on it")
    started = time.perf_counter()
    matched = match(curve, markers, markers2, settings, image)
    drawn, by_markers = matched.curve, matched.registration
    refined = None if touched is None else touch(drawn, by_markers, touched, tip_radius)
    registration = by_markers if refined is None else refined.registration
    error = target_error(registration, drawn.points)
    if settings.max_tre_m is not None:
        check_max_tre(error, settings.max_tre_m)
    guarded, making, margin = drawn, settings, None
    if settings.margin is not None:
        guarded, making, margin = add_margin(drawn, registration, settings)
    choice = choice_of(guarded, making)
    carried = carry(guarded, registration, making, choice and choice.sampling_tolerance_m)
    rendering = rendering_of(
        carried.points, making, registration, choice, guarded.mesh, matched.slice_axes
    )
    pieces = pieces_of(guarded, registration, rendering.ignore_axis, making)
    if pieces:
        require_small(pieces, 0.0 if margin is None else margin.largest_m, settings)
        # The choice is that of the points alone.
        carried, choice = replace(carried, curve=replace(carried.curve, pieces=pieces)), None
    counts = left_out(rendering, carried, len(guarded.points), choice)
    read = {"markers": markers, "markers2": markers2, "touched": touched}
    hashes = {role: OneFile(Path(path)).sha256() for role, path in read.items() if path is not None}
    found = as_settings(choice, counts) | _markers_left_out(by_markers)
    fixture = _fixture(
        matched,
        guarded,
        registration,
        carried,
        rendering,
        _provenance(guarded, making, hashes, found),
    )
    guide, guide_warnings = {}, ()
    if settings.guide_m is not None:
        fixture, guide, guide_warnings = add_guidance(fixture, settings)
    report = describe_registration(
        by_markers, drawn.points, diagnosis=matched.diagnosis, error=error
    )
    report["target_frame"] = fixture.frame
    report |= describe_carried(carried, rendering, choice, counts)
    report |= matched.report | guide
    if margin is not None:
        report["margin"] = margin.report
    if refined is not None:
        report |= {"T_robot_image": registration.T_target_source, "touched": refined.report}
    report["elapsed_s"] = time.perf_counter() - started
    doubts = size_doubt(fixture.points), work_doubt(fixture) if pieces else None
    warnings = (
        *matched.diagnosis.warnings,
        *(error.warnings if refined is None else refined.warnings),
        *matched.warnings,
        *capped(choice),
        *guide_warnings,
        *(doubt for doubt in doubts if doubt),
    )
    return Planned(fixture, registration, report, warnings)


def _fixture(
    matched: Matched,
    curve: Fixture,
    registration: Registration,
    carried: Carried,
    rendering: Rendering,
    provenance: Provenance,
) -> Fixture:
    """Only in the robot's frame a bundle holds its slice and its registration (docs/format.md)."""
    in_robot = matched.pairs.target_frame == "robot_base"
    record = registration.record(carried.source, source_frame=curve.frame) if in_robot else None
    return Fixture(
        frame=matched.pairs.target_frame,
        points=carried.points,
        provenance=provenance,
        sigma=carried.sigma,
        curve=carried.curve,
        image=curve.image if in_robot else None,
        rendering=rendering,
        registration=record,
        mesh=curve.mesh,
    )


def _provenance(
    curve: Fixture, settings: FixtureSettings, inputs: dict[str, str], found: dict[str, Any]
) -> Provenance:
    """The curve's provenance, continued."""
    before = curve.provenance
    if curve.mesh is not None:  # its samples keep the tolerance that it was made with
        settings = replace(settings, tolerance_m=None)
    now = Provenance.now(before.inputs | inputs, settings)
    return replace(now, settings=before.settings | now.settings | found, history=before.history)


def _markers_left_out(registration: Registration) -> dict[str, str]:
    """The bundle says which markers its registration does not rest on."""
    if registration.used.all():
        return {}
    pairs = zip(registration.labels, registration.used, strict=True)
    return {"markers_left_out": ",".join(str(label) for label, used in pairs if not used)}
