"""Markers and a curve -> a registration that is not plainly wrong, and what to look at in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CheckFailed, CurveError, MarkerError, SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture
from vfplan.io.files import naming_place
from vfplan.planning.settings import FixtureSettings

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage
    from vfplan.markers import Correspondences
    from vfplan.markers.drawn import DrawnMarker
    from vfplan.markers.marks import MarkComparison
    from vfplan.registration import Registration

# Relative difference of two pixel spacings that are decimals of the same number.
SAME_SPACING = 1e-6

# RMS distance of a layout's markers from their centre [m]. Millimetres read as metres are above,
# metres read as millimetres are below.
LAYOUT_RADIUS_M = (5e-4, 10.0)


@dataclass(frozen=True, eq=False)
class MatchResult:
    """Markers joined to a curve, and the registration that they give."""

    # The curve that the markers carry. That of a slice is in the patient's frame where the markers
    # are given there.
    curve: Fixture
    # (3, 2) the slice's axes in the patient's frame [m/px]; `None` for every other curve.
    slice_axes: NDArray[np.float64] | None
    correspondences: Correspondences
    registration: Registration
    # Markers whose pixels were taken from the slice.
    found: tuple[DrawnMarker, ...]
    # The given positions against the marks drawn; `None` where no slice was given.
    marks: MarkComparison | None
    findings: tuple[Finding, ...]

    @property
    def report(self) -> dict[str, Any]:
        """What `register --json` reports of the marks that the slice shows."""
        report: dict[str, Any] = {}
        if self.marks is not None:
            report["marks_drawn"] = self.marks.as_dict()
        if self.found:
            report["markers_found"] = [asdict(marker) for marker in self.found]
        return report


def match(
    curve: Fixture,
    markers: str | Path,
    markers2: str | Path | None,
    settings: FixtureSettings,
    image: PlannedImage | None = None,
) -> MatchResult:
    """Read the markers, fit the registration, and refuse what is plainly wrong.

    Raises
    ------
    MarkerError
        Markers that determine no transform, or that no slice or robot can have.
    CheckFailed
        Positions that meet no drawn marks, mistaken labels, or large residuals.
    SettingError
        Markers to be found in a slice that is not there, or a model that cannot be fitted.
    """
    from vfplan.markers import read_markers
    from vfplan.markers.marks import compare_with_marks
    from vfplan.registration import fit_registration
    from vfplan.registration.checks import (
        refuse_wrong_markers,
        registration_findings,
        side_finding,
    )

    if curve.frame == "robot_base":
        raise CurveError(
            "the curve is in frame 'robot_base' already; one of an image is wanted",
            code="curve-in-robot-frame",
        )
    slice_image = image if _is_drawn_on(curve, image) else None
    correspondences = read_markers(markers, markers2, common=settings.common)
    curve, slice_axes = _in_frame_of_markers(curve, correspondences, slice_image)
    marks, found = None, ()
    with _naming(markers if markers2 is None else f"{markers}, {markers2}"):
        refuse_implausible(correspondences, curve, slice_image)
        given = correspondences
        if settings.find_markers:
            found = _find_drawn(correspondences, image, slice_image)
            positions = np.array([marker.position_px for marker in found])
            correspondences = replace(correspondences, source=positions)
        registration = fit_registration(
            correspondences.source,
            correspondences.target,
            model=settings.model,
            robust=settings.robust,
            labels=correspondences.labels,
            pixel_spacing=_known_spacing(curve, correspondences),
            sigma=correspondences.sigma,
            seen_from=settings.seen_from,
        )
        if slice_image is not None and given.source_frame == "image":
            marks = compare_with_marks(
                slice_image.rgb,
                given.labels,
                given.source,
                markers_as_given=settings.markers_as_given,
            )
        refuse_wrong_markers(
            registration, settings.max_residual_m, markers_as_given=settings.markers_as_given
        )
    findings = [*correspondences.findings, *registration_findings(registration)]
    if settings.seen_from is None and correspondences.target_frame == "robot_base":
        side = side_finding(registration)
        findings += [] if side is None else [side]
    if marks is not None and not found:
        findings += marks.findings
    findings += _frame_findings(correspondences, is_other_image=image is not slice_image)
    return MatchResult(
        curve, slice_axes, correspondences, registration, found, marks, tuple(findings)
    )


@contextmanager
def _naming(where: object) -> Iterator[None]:
    """Refusals raised inside name the marker files, where they name no place."""
    with naming_place(where):
        try:
            yield
        except CheckFailed as error:
            error.where = error.where or str(where)
            raise


def _known_spacing(curve: Fixture, correspondences: Correspondences) -> tuple[float, float] | None:
    """Metres a pixel along u and v, where the markers are pixels and the curve's image says it."""
    if correspondences.source_frame != "image" or curve.image is None:
        return None
    spacing_mm = curve.image.pixel_spacing_mm
    if spacing_mm is None:
        return None
    return spacing_mm[0] * 1e-3, spacing_mm[1] * 1e-3


def _is_drawn_on(curve: Fixture, image: PlannedImage | None) -> bool:
    """Whether the image may be the curve's own: nothing says that it is another."""
    known = curve.provenance.inputs.get("image")
    return image is not None and (not known or not image.sha256 or known == image.sha256)


def _find_drawn(
    correspondences: Correspondences, image: PlannedImage | None, slice_image: PlannedImage | None
) -> tuple[DrawnMarker, ...]:
    from vfplan.markers.drawn import find_markers

    if correspondences.source_frame != "image":
        raise SettingError(
            "markers can be found in an image only; these are given in 3-D",
            code="find-markers-in-space",
        )
    if image is None:
        raise SettingError(
            "to find the markers the image is needed, which was not given",
            code="find-markers-no-image",
        )
    if slice_image is None:
        raise SettingError(
            "the image given is not the one the curve was drawn on (SHA-256 differs)",
            code="find-markers-other-image",
        )
    return find_markers(slice_image.rgb, correspondences.labels, correspondences.source)


def _frame_findings(correspondences: Correspondences, *, is_other_image: bool) -> list[Finding]:
    findings = []
    if correspondences.target_frame != "robot_base":
        findings.append(
            doubt(
                "target-not-robot",
                "register",
                f"The target markers, and so the fixture, are in {correspondences.target_frame}. "
                "No robot renders it before it is registered to its own frame.",
            )
        )
    if is_other_image:
        findings.append(
            doubt(
                "image-other",
                "register",
                "The image given is not the file that the curve was drawn on (SHA-256 differs). "
                "Nothing was compared with it.",
            )
        )
    return findings


def _in_frame_of_markers(
    curve: Fixture, correspondences: Correspondences, image: PlannedImage | None
) -> tuple[Fixture, NDArray[np.float64] | None]:
    """The curve in the markers' source frame, and the slice's axes there where it was moved."""
    if (correspondences.source_frame, curve.frame) == ("patient_lps", "image"):
        return in_patient(curve, image)
    if correspondences.source_frame != curve.frame:
        raise MarkerError(
            f"markers are given in frame {correspondences.source_frame!r}, the curve in "
            f"{curve.frame!r}",
            code="frame-differs",
        )
    return curve, None


def in_patient(curve: Fixture, image: PlannedImage | None) -> tuple[Fixture, NDArray[np.float64]]:
    """The curve in "patient_lps" [m], and the slice's two axes there, (3, 2) [m/px].

    curve: in frame "image"
    image: the slice it was drawn on; DICOM says where that lies (`T_patient_image`)
    Raises MarkerError: no slice, or one that does not say where it lies
    Raises SettingError: a pixel spacing that is not the slice's own
    """
    place = None if image is None else image.T_patient_image
    if place is None:
        reason = "the slice does not say soundly where it lies in the patient"
        if image is None:
            reason = "give the DICOM slice it was drawn on (--image)"
        raise MarkerError(
            f"markers are given in frame 'patient_lps', the curve in 'image': {reason}",
            code="slice-without-place",
        )
    axes = place[:3, :2]
    own = 1e3 * np.linalg.norm(axes, axis=0)
    given = None if curve.image is None else curve.image.pixel_spacing_mm
    if given is not None and not np.allclose(given, own, rtol=SAME_SPACING, atol=0):
        raise SettingError(
            f"the curve's pixel spacing is {given[0]:g}, {given[1]:g} mm, that of the slice in the "
            f"patient {own[0]:g}, {own[1]:g} mm; leave --pixel-spacing out",
            code="pixel-spacing-differs",
        )
    pixels = np.c_[curve.points[:, :2], np.ones(len(curve.points))]
    sigma = None if curve.sigma is None else curve.sigma * float(np.sqrt(own.prod())) * 1e-3
    carried = replace(curve, frame="patient_lps", points=(pixels @ place.T)[:, :3], sigma=sigma)
    return carried, axes


def refuse_implausible(
    correspondences: Correspondences, curve: Fixture, image: PlannedImage | None
) -> None:
    """Refuse markers that no slice and no robot can have.

    A planar fit is exact under any unit, so a wrong one leaves no residual.

    Raises MarkerError: a layout larger or smaller than `LAYOUT_RADIUS_M`, or a marker outside the
        image
    """
    _refuse_size(correspondences.target, "target")
    if correspondences.source_frame != "image":
        _refuse_size(correspondences.source, "source")
        return
    size = image or curve.image
    if size is None:
        return
    corner = np.array([size.width_px, size.height_px]) - 0.5
    for label, place in zip(correspondences.labels, correspondences.source, strict=True):
        if not ((place >= -0.5) & (place <= corner)).all():
            u, v = place
            raise MarkerError(
                f"marker {label} at u = {u:.6g}, v = {v:.6g} px lies outside the slice of "
                f"{size.width_px} x {size.height_px} px (u is the column, v the row)",
                code="marker-outside-slice",
                numbers={"label": label, "u_px": float(u), "v_px": float(v)},
            )


def _refuse_size(positions: NDArray[np.float64], what: str) -> None:
    radius = float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).mean()))
    smallest, largest = LAYOUT_RADIUS_M
    # Markers in one place, but for rounding, are left to the fit, which names them.
    is_spread = radius > 1e-9 * np.abs(positions).max()
    if is_spread and not smallest <= radius <= largest:
        raise MarkerError(
            f"the {what} markers lie {radius:.3g} m (rms) from their centre; {smallest:g} to "
            f"{largest:g} m are allowed. Look for millimetres given as metres, or the reverse",
            code="layout-size",
            numbers={"radius_m": radius},
        )
