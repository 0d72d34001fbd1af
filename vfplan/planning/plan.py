"""From a planned slice and its markers to a fixture: `plan` calls `extract`, then `register`.

    slice              -> the drawn curve                        extract()
    markers            -> the registration and its error         register(): match, target_error
    curve              -> points, lines and arcs for the robot   register(): margin_of, render
    all of these       -> the fixture, with a guide if wanted    register(): make_fixture

`extract` gives the curve as a `Fixture` whose points are pixels of the slice. `register` turns that
into a `Fixture` whose points lie in front of the robot. What its steps have to say goes into one
`Record`.
"""

from __future__ import annotations

import time
import warnings
from contextlib import suppress
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vfplan.display import Report
from vfplan.engine.parameters import FINEST_BAND, ProxyParameters, check_axis
from vfplan.engine.proxy import slow_tick_text
from vfplan.errors import CheckFailed, InputError, SettingError
from vfplan.findings import Findings, note
from vfplan.fixture import Fixture, Guidance, Provenance, Rendering, Stroke, size_doubt
from vfplan.geometry.lines import Array, unit_normal
from vfplan.io.files import FilePath
from vfplan.planning.extraction import UNTURNED, ExtractResult, extract
from vfplan.planning.match import MatchResult, Record, match, refine
from vfplan.planning.settings import (
    CURVE95,
    ExtractSettings,
    FixtureSettings,
    margin_length,
    overridden,
)
from vfplan.planning.tolerance import (
    BAND_SHARE,
    CarriedPoints,
    Choice,
    carry,
    check_arcs_error,
    choose,
    lines_and_arcs_of,
)
from vfplan.settings import Arguments, flat, incomplete_recipe, recalled

if TYPE_CHECKING:
    from vfplan.engine.guide import Guide
    from vfplan.images.read import PlannedImage
    from vfplan.markers.correspondences import Correspondences
    from vfplan.registration.registration import Registration, TargetError

# An ignored axis further than this from the slice's normal would collapse the curve.
MAX_IGNORED_TILT_DEG = 45.0


@dataclass(frozen=True, eq=False)
class RegisterResult:
    """A fixture, the registration it rests on, the report that `--json` prints, and findings."""

    fixture: Fixture
    registration: Registration
    report: Report
    findings: Findings = ()


@dataclass(frozen=True, eq=False)
class PlanResult:
    """A fixture, and the two steps it came from."""

    fixture: Fixture
    extracted: ExtractResult
    registered: RegisterResult

    @property
    def report(self) -> Report:
        """What `plan --json` reports."""
        return {"extract": self.extracted.report, "register": self.registered.report}

    @property
    def findings(self) -> Findings:
        """What a person should look at."""
        return self.extracted.findings + self.registered.findings


def plan(
    image: FilePath,
    markers: FilePath,
    markers2: FilePath | None = None,
    *,
    extraction: ExtractSettings | None = None,
    curve: FilePath | None = None,
    settings: FixtureSettings | None = None,
    tip: FilePath | None = None,
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
    tip
        As `register` takes it.

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
    settings = settings or FixtureSettings()
    extracted = extract(image, extraction, curve=curve, contact_radius=settings.contact_radius)
    registered = register(
        extracted.fixture, markers, markers2, settings, image=extracted.image, tip=tip
    )
    return PlanResult(registered.fixture, extracted, registered)


def refuse_wrong_order(
    image: FilePath, markers: FilePath | None, markers2: FilePath | None
) -> None:
    """Refuse markers in the place of the slice.

    Raises `InputError` where the first file is a table of markers, or no picture while another is.
    """
    from vfplan.images.read import is_picture_file
    from vfplan.markers.correspondences import read_sides

    if is_picture_file(image) or not Path(image).is_file():
        return
    order = None
    # A table of a curve has no labels, so it is no sound table of markers. ImageJ's may be either.
    if Path(image).suffix.lower() in (".csv", ".txt", ".tsv"):
        with suppress(InputError):
            first_side = read_sides(Path(image))[0]
            if all(finding.code != "imagej-table" for finding in first_side.findings):
                order = "it holds markers"
    for path in (markers, markers2):
        if path is not None and is_picture_file(path):
            order = f"{path} is a picture"
    if order is not None:
        raise InputError(
            f"the files are in the wrong order: {order}. Give the slice first and the markers "
            "after it: IMAGE MARKERS [MARKERS2]", where=image, code="wrong-order",
        )  # fmt: skip


def register(
    unregistered: Fixture,
    markers: FilePath | Correspondences,
    markers2: FilePath | None = None,
    settings: FixtureSettings | None = None,
    *,
    image: PlannedImage | None = None,
    touched: FilePath | None = None,
    tip_radius: float = 0.0,
    tip: FilePath | None = None,
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
        One file with both positions of each marker, or two joined by label; or, read already,
        markers joined by label.
    settings
        How the markers are registered, the curve is sampled and the fixture is rendered; `None`:
        by the recipe that the bundle records, or as usual where it records none.
    image
        The slice that the curve was drawn on. With it, the positions of the markers are compared
        with the marks that are drawn on the slice. It is needed where the markers are given in the
        patient's frame: a DICOM slice says where its pixels lie there.
    touched
        A file of points that the robot touched on a surface. They refine a rigid registration.
    tip_radius
        The radius of the ball that touched them [m].
    tip
        The file of `vfplan tip` about the tool that touched the markers, which the bundle records.

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
    from vfplan.registration.registration import own_bound, registration_report, target_error

    recipe = recalled(FixtureSettings, unregistered.provenance.settings)
    settings = asked = settings or recipe or FixtureSettings()
    if unregistered.mesh is not None and settings.density_per_m is not None:
        raise SettingError(
            "a surface is sampled already; a density has no effect on it. Leave --density out",
            code="density-of-surface",
        )
    started = time.perf_counter()

    # Markers -> registration, or a refusal that names the marker. Touched points give a second
    # registration, which begins at that of the markers.
    record = Record()
    record.findings += overridden(recipe or asked, asked)
    matched = match(unregistered, markers, markers2, settings, image, record, tip)
    curve, registration = matched.curve, matched.registration
    was_turned = any(finding.code == "picture-turned" for finding in unregistered.findings)
    if was_turned and "pixels" not in unregistered.provenance.settings:
        record.doubt("pixels-unturned", "register", f"{markers}: {UNTURNED}")
    if touched is not None:
        registration = refine(curve, registration, touched, tip_radius, record)

    # How far the curve may lie from where it belongs.
    strokes = curve.strokes or (Stroke(curve.points, False, curve.sigma),)
    px = 1.0 if matched.slice_axes is None else float(np.linalg.norm(matched.slice_axes[:, 0]))
    error = target_error(registration, curve.points, own_bound(strokes, px))
    if touched is None:
        record.findings += error_findings(error)
    # Up to the next nanometre: an id must not depend on a processor's last bit.
    record.settings[CURVE95] = float(np.ceil(error.curve95_m.max() * 1e9) / 1e9)
    if settings.max_tre_length_m is not None:
        taken_from = "contact radius" if settings.max_tre_m == "contact radius" else ""
        refuse_large_error(
            error, settings.max_tre_length_m, unregistered, taken_from=taken_from,
            is_touched=touched is not None,
        )  # fmt: skip

    # A margin makes the fixture thicker: from here on `settings.point_radius` includes it. Lines
    # and arcs must follow the curve more closely than the margin is wide.
    margin_m = 0.0
    if settings.margin is not None:
        margin_m = margin_of(error, settings.margin)
        settings = replace(settings, point_radius=settings.point_radius + margin_m)
        record.report["margin"] = {
            "kind": "tre95" if isinstance(settings.margin, str) else "given", "side": "both",
            "largest_m": margin_m, "added_point_radius_m": margin_m,
        }  # fmt: skip

    # The curve in front of the robot, sampled as finely as the tolerance asks.
    carried, rendering = render(curve, registration, settings, matched.slice_axes, margin_m, record)
    fixture = make_fixture(matched, registration, carried, rendering, asked, record)
    if settings.guide_m is not None:
        fixture = add_guidance(fixture, settings, record)
    if unusual_size := size_doubt(fixture.points):
        record.doubt("size-unusual", "plan", unusual_size)
    if fixture.pieces is not None and (slow_tick := slow_tick_text(fixture)):
        record.doubt("tick-too-long", "plan", slow_tick)
    # Extraction's findings come first. A place [m] in the curve's old frame would mislead here.
    of_extraction = [replace(finding, place_m=None) for finding in unregistered.findings]
    fixture = replace(fixture, findings=(*of_extraction, *record.findings))

    # Residuals and checks are those of the registration by markers. The error is that of the
    # registration in use, which touched points may have refined.
    report = registration_report(matched.registration, curve.points, error)
    report |= describe_checks(matched.registration)
    report |= {"target_frame": fixture.frame} | record.report
    if touched is not None:
        report["T_robot_image"] = registration.T_target_source
        report["tre"]["worst_target_m"] = registration.apply(curve.points[[error.worst]])[0]
    report["elapsed_s"] = time.perf_counter() - started
    return RegisterResult(fixture, registration, report, tuple(record.findings))


def planning_of(bundle: Fixture, given: Arguments) -> FixtureSettings:
    """The settings by which a bundle is planned again: its recipe, with those given in their place.

    Raises `InputError` for a registered fixture without a recipe, and for an incomplete recipe.
    """
    recipe = recalled(FixtureSettings, bundle.provenance.settings)
    if recipe is None and bundle.registration is not None:
        raise incomplete_recipe("it has no settings of planning")
    # A tolerance takes the place of a density.
    if given.get("tolerance_m") is not None:
        given = {"density_per_m": None} | given
    return replace(recipe or FixtureSettings(), **given)


def margin_of(error: TargetError, margin: str | float) -> float:
    """The margin that a fixture is thicker by, all along the curve [m].

    "tre95" is the largest value, along the curve, of the bound that its error stays within over the
    whole curve with probability 0.95; "tre95+MM" adds millimetres. A number is a margin [m].

    Raises SettingError: an unknown margin
    """
    bound_m = margin
    if isinstance(margin, str):
        bound_m = margin_length(margin, float(error.curve95_m.max()))
    if not isinstance(bound_m, Real) or isinstance(bound_m, bool) or not 0 <= bound_m < np.inf:
        raise SettingError(
            f"margin is {margin!r}. Give metres of at least 0, 'tre95', 'tre95+MM' or none",
            code="margin-unknown",
        )
    # Up to the next nanometre: an id must not depend on a processor's last bit.
    return float(np.ceil(bound_m * 1e9) / 1e9)


def make_fixture(
    matched: MatchResult, registration: Registration, carried: CarriedPoints, rendering: Rendering,
    settings: FixtureSettings, record: Record,
) -> Fixture:  # fmt: skip
    """The fixture of the rendered curve, with the files and settings that it came from."""
    curve = matched.curve
    by_markers = matched.registration
    if not by_markers.used.all():
        labels = [str(by_markers.labels[i]) for i in np.flatnonzero(~by_markers.used)]
        record.settings["markers_left_out"] = Fixture.labels_as_text(labels)
    if matched.correspondences.sigma is not None:
        rows = matched.correspondences.sigma.reshape(len(by_markers.labels), -1)
        record.settings["markers_sigma_m"] = flat(rows.tolist())
    provenance = Provenance.now(curve.provenance.inputs | record.inputs, settings)
    # What an earlier registration set, and this one did not, is no setting of this fixture.
    earlier = {
        name: value
        for name, value in curve.provenance.settings.items()
        if name not in FixtureSettings.__dataclass_fields__
    }
    chosen = earlier | provenance.settings | record.settings
    if curve.mesh is not None and "tolerance_m" in curve.provenance.settings:
        # The samples of a surface keep the tolerance that they were made with.
        chosen["tolerance_m"] = curve.provenance.settings["tolerance_m"]
    # Only a bundle in the robot's frame holds its slice and its registration (docs/format.md).
    image, transform = None, None
    if matched.correspondences.target_frame == "robot_base":
        image = curve.image
        tool, tip = matched.correspondences.tool, matched.correspondences.tip
        transform = replace(registration.record(carried.source, curve.frame), tool=tool, tip=tip)
    return Fixture(
        frame=matched.correspondences.target_frame, points=carried.points, sigma=carried.sigma,
        provenance=replace(provenance, settings=chosen, history=curve.provenance.history),
        curve=carried.curve, image=image, rendering=rendering, registration=transform,
        mesh=curve.mesh, sample_radius=curve.sample_radius, case=curve.case,
    )  # fmt: skip


def render(
    curve: Fixture, registration: Registration, settings: FixtureSettings,
    slice_axes: Array | None, margin_m: float, record: Record,
) -> tuple[CarriedPoints, Rendering]:  # fmt: skip
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
    choice = sampling_tolerance_m = band_m = max_iterations = None
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
        is_planar = curve.image is not None or curve.frame == "image"
        if settings.ignore_axis is not None:
            is_planar = settings.ignore_axis != "none"
        choice = choose(settings.tolerance_m, radius_m, planar=is_planar)
        sampling_tolerance_m = choice.sampling_tolerance_m
        band_m, max_iterations = choice.band_m, choice.max_iterations

    # The curve in the target frame, and how its points are rendered.
    carried = carry(curve, registration, settings, sampling_tolerance_m)
    axis = ignored_axis(settings.ignore_axis, registration, slice_axes)
    if curve.sample_radius is not None:
        from vfplan.bundle.importing import sample_band

        band_m = sample_band(curve.sample_radius, radius_m)
    elif curve.mesh is not None:
        from vfplan.bundle.importing import mesh_band

        band_m = mesh_band(carried.points, curve.mesh, radius_m)
    parameters = ProxyParameters.make(
        carried.points, contact_radius=settings.contact_radius, band=band_m,
        point_radius=settings.point_radius, stiffness=np.broadcast_to(settings.stiffness, 3),
        ignore_axis=axis,
    )  # fmt: skip
    rendering = Rendering(
        parameters.stiffness, parameters.contact_radius, parameters.band, parameters.point_radius,
        axis, max_iterations,
    )  # fmt: skip

    # Where the curve is known as lines and arcs, the choice is that of the points alone. What the
    # scene does without is counted.
    pieces = lines_and_arcs_of(curve, registration, axis, settings, carried)
    if pieces is None:
        left_out = {"points": max(0, len(curve.points) - len(carried.points))}
        if axis is not None:
            left_out["coordinates"] = 1
    else:
        check_arcs_error(pieces, margin_m, settings)
        carried = replace(carried, curve=replace(carried.curve, pieces=pieces))
        choice = None
        # Settings that points need and lines and arcs do not: spacing, band and iteration limit.
        left_out = {"points": len(carried.points), "coordinates": 1, "settings": 3}
        record.report["pieces"] = {"lines_and_arcs": pieces.count, "error_m": pieces.error}
    record.report |= {
        "points": len(carried.points), "spacing_m": carried.spacing_m, "left_out": left_out
    }  # fmt: skip
    record.settings |= {f"left_out_{name}": count for name, count in left_out.items()}
    if carried.sampling_error_m is not None:
        record.report["sampling_error_m"] = carried.sampling_error_m
    if choice is not None:
        record_choice(choice, carried.sampling_error_m, record)
    return carried, rendering


def record_choice(choice: Choice, sampling_error_m: float | None, record: Record) -> None:
    """Say what the tolerance chose, and where less of it was used."""
    used_m = choice.used_tolerance_m
    chosen = {name: getattr(choice, name) for name in ("spacing_m", "band_m", "max_iterations")}
    error_m = {
        "spacing": sampling_error_m, "band": choice.band_m, "iterations": choice.lag_m,
        "total": (sampling_error_m or 0.0) + choice.band_m + choice.lag_m,
    }  # fmt: skip
    tolerances = {"tolerance_m": choice.tolerance_m, "tolerance_used_m": used_m}
    record.report["chosen"] = tolerances | chosen | {"error_m": error_m}
    flat = {"tolerance_m": used_m} | chosen | {"lag_m": choice.lag_m}
    record.settings |= {f"chosen_{name}": value for name, value in flat.items()}
    if used_m != choice.tolerance_m:
        text = (
            f"The tolerance of {choice.tolerance_m * 1e3:g} mm is more than r_c + r_v allow. "
            f"{used_m * 1e3:.4g} mm was used, because wider spacing would be felt as bumps."
        )
        record.findings.append(note("tolerance-reduced", "plan", text))


def ignored_axis(
    choice: str | None, registration: Registration, slice_axes: Array | None = None
) -> Array | None:
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
    normal = unit_normal(T[:3, :3] @ slice_axes if slice_axes is not None else T[:3, :2])
    if choice == "normal":
        return normal
    axis = check_axis(choice)
    tilt_deg = np.degrees(np.arccos(min(1.0, abs(axis @ normal))))
    if tilt_deg > MAX_IGNORED_TILT_DEG:
        raise SettingError(
            f"ignoring {choice} would collapse the curve: it is {tilt_deg:.1f} degrees from "
            f"the slice's normal, and at most {MAX_IGNORED_TILT_DEG:g} are allowed. Ignore "
            "the normal", code="axis-collapses", numbers={"tilt_deg": float(tilt_deg)},
        )  # fmt: skip
    return axis


def add_guidance(fixture: Fixture, settings: FixtureSettings, record: Record) -> Fixture:
    """The fixture with the guidance that was asked for.

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
    guiding = fixture.curve.closed
    if stroke is not None:
        if len(guiding) == 1 or not 0 <= stroke < len(guiding):
            raise SettingError(
                f"guide stroke {stroke} is not one of several: the curve has {len(guiding)}. Give "
                f"0 to {len(guiding) - 1}, or leave --guide-stroke out and all guide",
                code="guide-stroke",
            )
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
        "radius_m": guidance.radius, "stiffness_n_per_m": guidance.stiffness,
        "ends": guidance.ends, "lead_force_n": guidance.lead_force or 0.0,
        "lengths_m": guide.lengths_m,
    }  # fmt: skip
    record.report["guide"] = report
    if guide.tight_bend:
        record.doubt("guide-tight-bend", "plan", guide.tight_bend)
    if stroke is not None:
        report |= {"stroke": stroke, "clearance_min_m": clearance(fixture, guide, record)}
    return fixture


def clearance(fixture: Fixture, guide: Guide, record: Record) -> float:
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
    where = f"at arc {1e3 * arcs[worst]:.4g} mm, [{x:z.4g}, {y:z.4g}, {z:z.4g}] mm"
    if smallest < 0:
        raise CheckFailed(
            f"the guide leads into the forbidden region: {where}, it comes within "
            f"{1e3 * (smallest + radius):.4g} mm, and R = {1e3 * radius:g} mm is the least. "
            "Draw it further away, or give a smaller --contact-radius",
            code="guide-forbidden", numbers={"distance_m": smallest + radius, "allowed_m": radius},
        )  # fmt: skip
    if smallest < guide.radius:
        text = (
            f"The guide's tube of {1e3 * guide.radius:g} mm reaches into the forbidden region "
            f"{where}: {1e3 * smallest:.4g} mm are free there, and both forces act. Give a "
            "narrower --guide."
        )
        record.doubt("guide-in-forbidden", "plan", text, place_m=tuple(places[worst].tolist()))
    return smallest
