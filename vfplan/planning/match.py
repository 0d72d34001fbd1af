"""Markers and a curve -> a registration that is not plainly wrong, and what to look at in it.

Points touched on a surface refine its registration, held against what the markers said.
"""

from __future__ import annotations

import io
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vfplan.display import Report
from vfplan.errors import CurveError, ImageError, MarkerError, SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import MAX_COORDINATE_M, MIN_EXTENT_M, Fixture
from vfplan.geometry.lines import Array, homogeneous, rms_length, row_lengths
from vfplan.io.files import FilePath, naming_place, open_number_table, read_bytes
from vfplan.markers.correspondences import MAX_BYTES
from vfplan.planning.settings import FixtureSettings
from vfplan.settings import Arguments

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage
    from vfplan.markers.correspondences import Correspondences
    from vfplan.markers.find_marks import DrawnMarker
    from vfplan.registration.registration import Registration


# RMS distance of a layout's markers from their centre [m]: metres read as millimetres are below.
# The smallest fixture's markers lie half its extent from their centre.
MIN_LAYOUT_RADIUS_M = MIN_EXTENT_M / 2

# A finding -> the one that is a doubt beside it: nothing says that the unit, or the order of the
# points, was concluded rightly.
UNSURE = {"scale-unchecked": "unit-concluded", "points-numbered": "layout-symmetric"}


@dataclass
class Record:
    """What the steps of `register` have to say; each step adds to it.

    Parameters
    ----------
    report
        For `--json`.
    findings
        What a person should look at.
    inputs, settings
        For the provenance: the SHA-256 of each file read, and what was chosen or left out.
    """

    report: Report = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    inputs: dict[str, str] = field(default_factory=dict)
    settings: Arguments = field(default_factory=dict)

    def doubt(self, code: str, stage: str, text: str, **place: Any) -> None:
        """Add a finding that wants an answer."""
        self.findings.append(doubt(code, stage, text, **place))


@dataclass(frozen=True, eq=False)
class MatchResult:
    """Markers joined to a curve, and the registration that they give."""

    # The curve that the markers carry. That of a slice is in the patient's frame where the markers
    # are given there.
    curve: Fixture
    # (3, 2) the slice's axes in the patient's frame [m/px]; `None` for every other curve.
    slice_axes: Array | None
    correspondences: Correspondences
    registration: Registration


def match(
    curve: Fixture,
    markers: FilePath | Correspondences,
    markers2: FilePath | None,
    settings: FixtureSettings,
    image: PlannedImage | None,
    record: Record,
    tip: FilePath | None = None,
) -> MatchResult:
    """Read the markers, fit the registration, and refuse what is plainly wrong.

    Raises
    ------
    MarkerError
        Markers that determine no transform, or that no slice or robot can have.
    CheckFailed
        Positions that meet no drawn marks, mistaken labels, or large residuals.
    ImageError
        An image of another size than the slice.
    SettingError
        Markers to be found in a slice that is not there, or a model that cannot be fitted.
    """
    from vfplan.markers.check_marks import compare_with_marks
    from vfplan.markers.correspondences import read_markers
    from vfplan.registration.checks import refuse_wrong_markers, registration_findings, side_finding
    from vfplan.registration.registration import fit_registration
    from vfplan.registration.tip import read_tip

    if curve.frame == "robot_base":
        raise CurveError(
            "the curve is in frame 'robot_base' already. Give one of an image",
            code="curve-in-robot-frame",
        )
    refuse_other_size(curve, image)
    # An image with another SHA-256 is not the slice that the curve was drawn on.
    slice_image = image
    known = curve.provenance.inputs.get("image")
    if image is not None and known and image.sha256 and known != image.sha256:
        slice_image = None

    # The markers, and the curve in the frame that they carry it from.
    spacing_mm = curve.image and curve.image.pixel_spacing_mm
    pairs, where = markers, None
    if isinstance(markers, (str, Path)):
        pairs = read_markers(markers, markers2, common=settings.common, spacing_mm=spacing_mm)
        where = str(markers) if markers2 is None else f"{markers}, {markers2}"
    if tip is not None:
        tool, place, record.inputs["tip"] = read_tip(tip)
        pairs = replace(pairs, tool=tool, tip=place)
    slice_axes = None
    if (pairs.source_frame, curve.frame) == ("patient_lps", "image"):
        curve, slice_axes = in_patient(curve, slice_image)
    if pairs.source_frame != curve.frame:
        raise MarkerError(
            f"markers are given in frame {pairs.source_frame!r}, the curve in "
            f"{curve.frame!r}. Give both in one frame",
            code="frame-differs",
        )
    is_in_image = pairs.source_frame == "image"
    labels, source = pairs.labels, pairs.source
    drawn_markers, marks = None, None
    with naming_place(where):
        refuse_implausible(pairs, curve, slice_image)

        # The positions as given, or where the marks are drawn.
        if settings.find_markers:
            drawn_markers = find_drawn(pairs, slice_image)
            source = np.array([marker.position_px for marker in drawn_markers])

        # The transform, and the gates on it.
        pixel_spacing_m = None
        if is_in_image and spacing_mm is not None:
            pixel_spacing_m = tuple(1e-3 * along for along in spacing_mm)
        registration = fit_registration(
            source, pairs.target, model=settings.model, robust=settings.robust,
            labels=labels, pixel_spacing=pixel_spacing_m, sigma=pairs.sigma,
            seen_from=settings.seen_from,
        )  # fmt: skip
        as_given = settings.markers_as_given
        if slice_image is not None and is_in_image:
            marks = compare_with_marks(
                slice_image.rgb, labels, pairs.source, markers_as_given=as_given
            )
        refuse_wrong_markers(registration, settings.max_residual_m, markers_as_given=as_given)

    # What is not refused and a person should look at.
    record.inputs |= pairs.inputs
    found = [*pairs.findings, *registration_findings(registration)]
    unsure = {UNSURE.get(finding.code) for finding in found}
    for finding in found:
        if finding.code in unsure:
            finding = replace(finding, severity="doubt")
        record.findings.append(finding)
    target_frame = pairs.target_frame
    side = side_finding(registration)
    if side is not None and settings.seen_from is None and target_frame == "robot_base":
        record.findings.append(side)
    if marks is not None:
        record.report["marks_drawn"] = marks[0]
    if drawn_markers:
        record.report["markers_found"] = [asdict(marker) for marker in drawn_markers]
    elif marks is not None:
        record.findings += marks[1]
    if target_frame != "robot_base":
        record.doubt(
            "target-not-robot", "register",
            f"The target markers, and so the fixture, are in {target_frame}, "
            "which no robot renders. Register it to the robot's own frame first.",
        )  # fmt: skip
    if image is not slice_image:
        record.doubt(
            "image-other", "register",
            "The image given is not the file that the curve was drawn on (SHA-256 "
            "differs), so nothing was compared with it. Give that file.",
        )  # fmt: skip
    return MatchResult(curve, slice_axes, replace(pairs, source=source), registration)


def refuse_other_size(curve: Fixture, image: PlannedImage | None) -> None:
    """Refuse an image of another size than the slice: its pixels are not those of the curve."""
    if image is None or curve.image is None:
        return
    size = (image.width_px, image.height_px)
    drawn_on = (curve.image.width_px, curve.image.height_px)
    if size != drawn_on:
        raise ImageError(
            f"The image has {size[0]} x {size[1]} px, and the slice that the curve was drawn on "
            f"had {drawn_on[0]} x {drawn_on[1]}. Give the original, not cut and not scaled.",
            code="image-size-differs", numbers={"width_px": size[0], "height_px": size[1]},
        )  # fmt: skip


def find_drawn(pairs: Correspondences, slice_image: PlannedImage | None) -> tuple[DrawnMarker, ...]:
    """The markers as they are drawn on the slice, for `--find-markers`."""
    from vfplan.markers.find_marks import find_markers

    if pairs.source_frame != "image":
        raise SettingError(
            "these markers are given in 3-D, where none are drawn. Leave --find-markers out",
            code="find-markers-in-space",
        )
    if slice_image is None:
        raise SettingError(
            "to find the markers the slice is needed that the curve was drawn on. Give it by "
            "--image, or leave --find-markers out",
            code="find-markers-no-image",
        )
    return find_markers(slice_image.rgb, pairs.labels, pairs.source)


def in_patient(curve: Fixture, image: PlannedImage | None) -> tuple[Fixture, Array]:
    """The curve in "patient_lps" [m], and the slice's two axes there, (3, 2) [m/px].

    curve: in frame "image"
    image: the slice it was drawn on; DICOM says where that lies (`T_patient_image`)
    Raises MarkerError: no slice, or one that does not say where it lies
    Raises SettingError: a pixel spacing that is not the slice's own
    """
    place = image.T_patient_image if image is not None else None
    if place is None:
        reason = "which no slice places in the patient. Give the DICOM slice it was drawn on with "
        reason += "--image"
        if image is not None:
            reason = "its slice does not say soundly where it lies in the patient. Give a slice "
            reason += "that does"
        raise MarkerError(
            f"markers are given in frame 'patient_lps', the curve in 'image', and {reason}",
            code="slice-without-place",
        )
    axes = place[:3, :2]
    spacing_mm = 1e3 * np.linalg.norm(axes, axis=0)
    given_mm = curve.image and curve.image.pixel_spacing_mm
    # Two decimals of one number differ by their rounding to single precision.
    rounding = 8 * float(np.finfo(np.float32).eps)
    if given_mm is not None and not np.allclose(given_mm, spacing_mm, rtol=rounding, atol=0):
        raise SettingError(
            f"the curve's pixel spacing is {given_mm[0]:g}, {given_mm[1]:g} mm, that of "
            f"the slice in the patient {spacing_mm[0]:g}, {spacing_mm[1]:g} mm. Leave "
            "--pixel-spacing out",
            code="pixel-spacing-differs",
        )
    scale = float(np.sqrt(spacing_mm.prod()))
    sigma = curve.sigma * scale * 1e-3 if curve.sigma is not None else None
    points = (homogeneous(curve.points[:, :2]) @ place.T)[:, :3]
    return replace(curve, frame="patient_lps", points=points, sigma=sigma), axes


def refuse_implausible(pairs: Correspondences, curve: Fixture, image: PlannedImage | None) -> None:
    """Refuse markers that no slice and no robot can have.

    A planar fit is exact under any unit, so a wrong one leaves no residual.

    Raises MarkerError: a layout that is far too large or too small, or a marker outside the image
    """
    layouts = {"target": pairs.target}
    if pairs.source_frame != "image":
        layouts["source"] = pairs.source
    for name, positions in layouts.items():
        radius = rms_length(positions - positions.mean(axis=0))
        # Markers in one place, but for rounding, are left to the fit, which names them.
        is_spread = radius > 1e-9 * np.abs(positions).max()
        # Millimetres read as metres are above.
        if is_spread and not MIN_LAYOUT_RADIUS_M <= radius <= MAX_COORDINATE_M:
            raise MarkerError(
                f"the {name} markers lie {radius:.3g} m (rms) from their centre; "
                f"{MIN_LAYOUT_RADIUS_M:g} to {MAX_COORDINATE_M:g} m are allowed. Name their "
                "unit in the header, as x_m, x_cm or x_mm",
                code="layout-size", numbers={"radius_m": radius},
            )  # fmt: skip

    size = image or curve.image
    if pairs.source_frame != "image" or size is None:
        return
    corner = np.array([size.width_px, size.height_px]) - 0.5
    for label, place in zip(pairs.labels, pairs.source, strict=True):
        if not ((place >= -0.5) & (place <= corner)).all():
            u, v = place
            raise MarkerError(
                f"marker {label} at u = {u:z.6g}, v = {v:z.6g} px lies outside the slice of "
                f"{size.width_px} x {size.height_px} px. Use this slice's own markers, with u_px "
                "to the right and v_px down",
                code="marker-outside-slice",
                numbers={"label": label, "u_px": float(u), "v_px": float(v)},
            )


COLUMNS = ("x_m", "y_m", "z_m")

# The largest ball that a probe has [m].
MAX_TIP_RADIUS_M = 0.05


def refine(
    curve: Fixture, registration: Registration, path: FilePath, tip_radius: float, record: Record
) -> Registration:
    """Refine the registration of a surface by the points in a file.

    Raises SettingError: the fixture is no surface, the registration is not rigid, or the radius is
        out of range
    Raises MarkerError: the file cannot be read, or its points do not hold the bone
    """
    from vfplan.registration.models import rms
    from vfplan.registration.touch import refine_by_touch

    if curve.mesh is None:
        raise SettingError(
            "touched points refine the registration of a surface, which this is not. Leave "
            "--touched out",
            code="touch-no-mesh",
        )
    if not 0 <= tip_radius < MAX_TIP_RADIUS_M:
        raise SettingError(
            f"tip radius is {1e3 * tip_radius:g} mm. Give 0 to {1e3 * MAX_TIP_RADIUS_M:g} mm",
            code="tip-radius-range",
        )
    points, record.inputs["touched"] = read_points(path)
    with naming_place(path):
        refined = refine_by_touch(registration, points, curve.points, curve.mesh, tip_radius)

    # How far the surface moves, against what the markers allow.
    before, after = registration.apply(curve.points), refined.registration.apply(curve.points)
    moved_m = row_lengths(after - before)
    bound_m = registration.tre95_curve_m(curve.points)
    moved_over_bound = float((moved_m / np.maximum(bound_m, 1e-12)).max())
    strays = np.flatnonzero(~refined.used) + 1
    record.report["touched"] = {
        "points": len(points), "left_out": strays, "rms_m": rms(refined.distances_m[refined.used]),
        "before_rms_m": rms(refined.before_m[refined.used]),
        "held": refined.constraint, "moved_max_m": float(moved_m.max()),
        "moved_over_markers_bound95": moved_over_bound, "tip_radius_m": tip_radius,
    }  # fmt: skip
    if len(strays):
        rows = ", ".join(map(str, strays[:8])) + (", ..." if len(strays) > 8 else "")
        record.doubt(
            "touch-left-out", "register",
            f"{len(strays)} of {len(points)} touched points lie off the surface "
            f"and are left out: {rows}. Check that the bone was touched there.",
        )  # fmt: skip
    if moved_over_bound > 1:
        record.doubt(
            "touch-moves-far", "register",
            f"Touching moves the surface by up to {1e3 * moved_m.max():.3f} mm, "
            f"{moved_over_bound:.1f} times the markers' 95 % bound. Did a marker move, or is "
            "something else touched?",
        )  # fmt: skip
    return refined.registration


def read_points(path: FilePath) -> tuple[Array, str]:
    """(T, 3) places [m] that a robot touched, and their file's SHA-256; other columns are not read.

    Raises MarkerError: the file cannot be read, or has no such columns of finite numbers
    """
    data, sha256 = read_bytes(Path(path), MAX_BYTES, MarkerError)
    table = open_number_table(lambda: io.BytesIO(data), str(path), MarkerError, COLUMNS)
    points = np.concatenate([np.empty((0, 3)), *table.blocks(COLUMNS)])
    if not np.isfinite(points).all():
        row = 1 + int(np.argmin(np.isfinite(points).all(axis=1)))
        message = f"point {row} is not finite. Correct its row"
        raise MarkerError(message, where=path, code="no-number")
    return points, sha256
