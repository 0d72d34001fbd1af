"""Curve + markers -> transform with its error -> points -> a fixture in the markers' frame."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.fixture import Fixture, Frame, Provenance, Rendering
from vfplan.planning.carrying import Carried, carry
from vfplan.planning.chosen import as_settings, capped, choice_of, costs, describe_choice, left_out
from vfplan.planning.guiding import add_guidance
from vfplan.planning.margin import add_margin
from vfplan.planning.matching import match
from vfplan.planning.piecing import with_pieces
from vfplan.planning.provenance import file_sha256, make_provenance
from vfplan.planning.settings import FixtureSettings
from vfplan.planning.touching import touch

if TYPE_CHECKING:
    from vfplan.engine.tolerance import Choice
    from vfplan.images.read import PlannedImage
    from vfplan.registration import Registration

# An ignored axis further than this from the slice's normal would collapse the curve.
MAX_IGNORED_TILT_DEG = 45.0


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
    from vfplan.bundle import size_doubt
    from vfplan.registration.diagnosis import check_max_tre, target_error
    from vfplan.registration.report import describe as describe_registration

    settings = settings or FixtureSettings()
    if curve.mesh is not None and settings.density_per_m is not None:
        raise SettingError("a surface is sampled already; a density has no effect on it")
    started = time.perf_counter()
    matched = match(curve, markers, markers2, settings, image)
    curve, registration, diagnosis = matched.curve, matched.registration, matched.diagnosis
    refined = None if touched is None else touch(curve, registration, touched, tip_radius)
    final = registration if refined is None else refined.registration
    error = target_error(final, curve.points)
    if settings.max_tre_m is not None:
        check_max_tre(error, settings.max_tre_m)
    guarded, making, margin = add_margin(curve, final, settings)
    fixture, carried = build_fixture(
        guarded,
        final,
        making,
        _hashes(markers=markers, markers2=markers2, touched=touched),
        matched.pairs.target_frame,
        matched.slice_axes,
    )
    fixture = _note_left_out(fixture, registration)
    fixture, guide, guide_warnings = add_guidance(fixture, settings)
    report = describe_registration(registration, curve.points, diagnosis=diagnosis, error=error)
    report["target_frame"] = fixture.frame
    report |= describe_fixture(fixture, carried, guarded, making)
    if matched.held is not None:
        report["marks_drawn"] = matched.held.as_dict()
    report |= guide
    if matched.found:
        report["markers_found"] = [asdict(marker) for marker in matched.found]
    if margin is not None:
        report["margin"] = margin.report
    if refined is not None:
        report |= {"T_robot_image": final.T_target_source, "touched": refined.report}
    report["elapsed_s"] = time.perf_counter() - started
    doubt = size_doubt(fixture.points)
    warnings = (
        *diagnosis.warnings,
        *(error.warnings if refined is None else refined.warnings),
        *matched.warnings,
        *capped(choice_of(guarded, making)),
        *guide_warnings,
        *((doubt,) if doubt else ()),
    )
    return Planned(fixture, final, report, warnings)


def build_fixture(
    curve: Fixture,
    registration: Registration,
    settings: FixtureSettings,
    inputs: dict[str, str],
    frame: Frame = "robot_base",
    slice_axes: NDArray[np.float64] | None = None,
) -> tuple[Fixture, Carried]:
    """The fixture, and what became of the curve's points on the way.

    `slice_axes` (3, 2) span the slice in the source frame, where that is not the image itself.

    Only in the robot's frame a bundle holds its slice and its registration (docs/format.md).
    """
    in_robot = frame == "robot_base"
    choice = choice_of(curve, settings)
    tolerance = choice and choice.sampling_tolerance_m
    carried = carry(curve, registration, settings, tolerance)
    fixture = Fixture(
        frame=frame,
        points=carried.points,
        provenance=_provenance(curve, settings, inputs),
        sigma=carried.sigma,
        curve=carried.curve,
        image=curve.image if in_robot else None,
        rendering=_rendering(
            carried.points, settings, registration, choice, curve.mesh, slice_axes
        ),
        registration=registration.record(carried.source, source_frame=curve.frame)
        if in_robot
        else None,
        mesh=curve.mesh,
    )
    if settings.arcs_m is not None:
        fixture = with_pieces(fixture, _strokes(curve, registration), settings.arcs_m)
    given = fixture.provenance.settings
    found = as_settings(choice, left_out(fixture, carried, curve, choice))
    return replace(fixture, provenance=replace(fixture.provenance, settings=given | found)), carried


def _strokes(curve: Fixture, registration: Registration) -> list[NDArray[np.float64]]:
    """The measured curve of each stroke (M, 3), carried over [m]; none of a bare cloud."""
    if curve.curve is None:
        return []
    carried = registration.apply(curve.points)
    return [carried[curve.curve.stroke == k] for k in range(len(curve.curve.closed))]


def _provenance(curve: Fixture, settings: FixtureSettings, inputs: dict[str, str]) -> Provenance:
    """The curve's provenance, continued."""
    before = curve.provenance
    if curve.mesh is not None:  # its samples keep the tolerance that it was made with
        settings = replace(settings, tolerance_m=None)
    now = make_provenance(before.inputs | inputs, settings)
    return replace(now, settings=before.settings | now.settings, history=before.history)


def _note_left_out(fixture: Fixture, registration: Registration) -> Fixture:
    """The bundle says which markers its registration does not rest on."""
    if registration.used.all():
        return fixture
    pairs = zip(registration.labels, registration.used, strict=True)
    names = ",".join(str(label) for label, used in pairs if not used)
    settings = fixture.provenance.settings | {"markers_left_out": names}
    return replace(fixture, provenance=replace(fixture.provenance, settings=settings))


def _rendering(
    points: NDArray,
    settings: FixtureSettings,
    registration: Registration,
    choice: Choice | None,
    mesh: NDArray[np.int32] | None,
    slice_axes: NDArray[np.float64] | None,
) -> Rendering:
    from vfplan.bundle import mesh_band
    from vfplan.engine.parameters import ProxyParameters

    axis = ignored_axis(settings.ignore_axis, registration, slice_axes)
    band = choice and choice.band_m
    if mesh is not None:
        band = mesh_band(points, mesh, settings.contact_radius + settings.point_radius)
    chosen = ProxyParameters.make(
        points,
        contact_radius=settings.contact_radius,
        band=band,
        point_radius=settings.point_radius,
        stiffness=np.broadcast_to(settings.stiffness, 3),
        ignore_axis=axis,
    )
    return Rendering(
        stiffness=np.array(np.broadcast_to(settings.stiffness, 3), dtype=float),
        contact_radius=settings.contact_radius,
        band=chosen.band,
        point_radius=settings.point_radius,
        ignore_axis=axis,
        max_iterations=choice and choice.max_iterations,
    )


def ignored_axis(
    choice: str | None,
    registration: Registration,
    slice_axes: NDArray[np.float64] | None = None,
) -> NDArray[np.float64] | None:
    """(3,) unit vector along which the fixture is infinite; `None` for a fixture in space.

    A drawn slice is extruded along its plane's normal unless told otherwise, as the paper ignores
    z in Experiment 2; a curve in space is not extruded.

    Raises `SettingError` for an axis that would collapse the slice, or a normal of no slice.
    """
    T = registration.T_target_source
    columns = T[:3, :2] if slice_axes is None else T[:3, :3] @ slice_axes
    planar = slice_axes is not None or registration.source.shape[1] == 2
    choice = choice or ("normal" if planar else "none")
    if choice == "none":
        return None
    if not planar:
        if choice == "normal":
            raise SettingError("a curve in space has no slice normal; ignore x, y, z or none")
        return np.eye(3)["xyz".index(choice)]
    normal = np.cross(columns[:, 0], columns[:, 1])
    normal /= np.linalg.norm(normal)
    if choice == "normal":
        return normal
    axis = np.eye(3)["xyz".index(choice)]
    tilt = np.degrees(np.arccos(min(1.0, abs(axis @ normal))))
    if tilt > MAX_IGNORED_TILT_DEG:
        raise SettingError(
            f"ignoring {choice} would collapse the curve: it is {tilt:.1f} degrees from the "
            f"slice's normal; at most {MAX_IGNORED_TILT_DEG:g} are allowed"
        )
    return axis


def describe_fixture(
    fixture: Fixture, carried: Carried, curve: Fixture, settings: FixtureSettings
) -> dict[str, Any]:
    """What `register --json` reports of the fixture's points."""
    choice = choice_of(curve, settings)
    counts = left_out(fixture, carried, curve, choice)
    report: dict[str, Any] = {
        "points": len(fixture.points),
        "spacing_m": carried.spacing_m,
        "left_out": counts,
        "left_out_costs": costs(counts, fixture, carried, choice),
    }
    if choice is not None:
        report["chosen"] = describe_choice(choice, carried)
    if carried.sampling_error_m is not None:
        report["sampling_error_m"] = carried.sampling_error_m
    pieces = fixture.curve and fixture.curve.pieces
    if pieces:
        count = len(pieces.bulges) - int((~pieces.closed).sum())
        report["pieces"] = {"lines_and_arcs": count, "error_m": pieces.error}
    if carried.tight_bends:
        report["tight_bends"] = [asdict(bend) for bend in carried.tight_bends]
    return report


def _hashes(**files: str | Path | None) -> dict[str, str]:
    return {role: file_sha256(path) for role, path in files.items() if path is not None}
