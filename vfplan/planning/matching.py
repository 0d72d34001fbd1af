"""Markers and a curve -> a registration without a fault that is sure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, MarkerError, SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import at
from vfplan.planning.readings import Held, hold_against_marks
from vfplan.planning.settings import FixtureSettings

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage
    from vfplan.markers import Correspondences
    from vfplan.markers.finding import FoundMarker
    from vfplan.registration import Registration
    from vfplan.registration.diagnosis import Diagnosis

SAME_SPACING = 1e-6  # relative: decimals of the same number
# RMS distance of a layout's markers from their centre [m]: millimetres read as metres are above,
# metres read as millimetres below.
LEAST_RADIUS_M, LARGEST_RADIUS_M = 5e-4, 10.0


@dataclass(frozen=True, eq=False)
class Matched:
    """Markers, their registration, what they say against it, and where the slice shows them.

    `curve` is the one they carry: a slice's, brought into the patient's frame where the markers are
    given there, with `slice_axes` (3, 2) [m/px]; else as it was, and `None`. `held` is `None` where
    no slice was given.
    """

    curve: Fixture
    slice_axes: NDArray[np.float64] | None
    pairs: Correspondences
    registration: Registration
    diagnosis: Diagnosis
    found: tuple[FoundMarker, ...]
    held: Held | None
    warnings: tuple[str, ...]

    @property
    def report(self) -> dict[str, Any]:
        """What `register --json` reports of the marks that the slice shows."""
        report: dict[str, Any] = {}
        if self.held is not None:
            report["marks_drawn"] = self.held.as_dict()
        if self.found:
            report["markers_found"] = [asdict(marker) for marker in self.found]
        return report


def _pairs(
    curve: Fixture, markers: str | Path, markers2: str | Path | None, own: PlannedImage | None
) -> tuple[Correspondences, Fixture, NDArray[np.float64] | None]:
    """The markers, and the curve in their source frame (see `Matched`)."""
    from vfplan.markers import read_markers

    if curve.frame == "robot_base":
        raise CurveError("the curve is in frame 'robot_base' already; one of an image is wanted")
    pairs = read_markers(markers, markers2)
    if (pairs.source_frame, curve.frame) == ("patient_lps", "image"):
        return pairs, *in_patient(curve, own)
    if pairs.source_frame != curve.frame:
        raise MarkerError(
            f"markers are given in frame {pairs.source_frame!r}, the curve in {curve.frame!r}"
        )
    return pairs, curve, None


def match(
    curve: Fixture,
    markers: str | Path,
    markers2: str | Path | None,
    settings: FixtureSettings,
    image: PlannedImage | None = None,
) -> Matched:
    """Read and fit the markers, and refuse those that are surely wrong.

    Raises MarkerError: markers that determine no transform, that no slice or robot can have
        (`check_plausible`), or that contradict each other beyond doubt
        (`vfplan.registration.register`)
    Raises SettingError: markers to be found in a slice that is not there, a model that cannot be
        fitted
    """
    from vfplan.registration.diagnosis import diagnose, refuse_sure_faults

    own = image if _drawn_on(curve, image) else None
    pairs, curve, slice_axes = _pairs(curve, markers, markers2, own)
    with at(markers if markers2 is None else f"{markers}, {markers2}"):
        check_plausible(pairs, curve, own)
        in_image = pairs.source_frame == "image"
        held = hold_against_marks(own.rgb, pairs) if own and in_image else None
        found = _find(pairs, image, own) if settings.find_markers else ()
        if found:
            pairs = replace(pairs, source=np.array([marker.position_px for marker in found]))
        registration = _fit(curve, pairs, settings)
        diagnosis = diagnose(registration)
        refuse_sure_faults(registration, diagnosis)
    doubts = () if held is None else (*held.rivals, *(() if found else held.warnings))
    warnings = (*doubts, *_warnings(pairs, another=image is not own))
    return Matched(curve, slice_axes, pairs, registration, diagnosis, found, held, warnings)


def _fit(curve: Fixture, pairs: Correspondences, settings: FixtureSettings) -> Registration:
    from vfplan.registration import fit_registration

    spacing = curve.image and curve.image.pixel_spacing_mm
    known = spacing and (spacing[0] * 1e-3, spacing[1] * 1e-3)
    return fit_registration(
        pairs.source,
        pairs.target,
        model=settings.model,
        robust=settings.robust,
        labels=pairs.labels,
        pixel_spacing=known if pairs.source_frame == "image" else None,
        sigma=pairs.sigma,
        seen_from=settings.seen_from,
    )


def _find(
    pairs: Correspondences, image: PlannedImage | None, own: PlannedImage | None
) -> tuple[FoundMarker, ...]:
    from vfplan.markers.finding import find_markers

    if pairs.source_frame != "image":
        raise SettingError("markers can be found in an image only; these are given in 3-D")
    if image is None:
        raise SettingError("to find the markers the image is needed, which was not given")
    if own is None:
        raise SettingError(
            "the image given is not the one the curve was drawn on (SHA-256 differs)"
        )
    return find_markers(own.rgb, pairs.labels, pairs.source)


def _drawn_on(curve: Fixture, image: PlannedImage | None) -> bool:
    """Whether the image may be the curve's own: nothing says that it is another."""
    known = curve.provenance.inputs.get("image")
    return image is not None and (not known or not image.sha256 or known == image.sha256)


def _warnings(pairs: Correspondences, *, another: bool) -> Iterator[str]:
    """What of frame and image a person should look at."""
    if pairs.target_frame != "robot_base":
        yield (
            f"the target markers, and so the fixture, are in {pairs.target_frame}: no robot "
            "renders it before it is registered to its own frame"
        )
    if another:
        yield (
            "the image given is not the file the curve was drawn on (SHA-256 differs): nothing was "
            "checked against it"
        )


def in_patient(curve: Fixture, image: PlannedImage | None) -> tuple[Fixture, NDArray[np.float64]]:
    """The curve in "patient_lps" [m], and the slice's two axes there, (3, 2) [m/px].

    curve: in frame "image"
    image: the slice it was drawn on; DICOM says where that lies (`T_patient_image`)
    Raises MarkerError: no slice, or one that does not say where it lies: the markers do not fit the
        curve
    Raises SettingError: a pixel spacing that is not the slice's own
    """
    place = None if image is None else image.T_patient_image
    if place is None:
        why = (
            "give the DICOM slice it was drawn on (--image)"
            if image is None
            else "the slice does not say soundly where it lies in the patient"
        )
        raise MarkerError(f"markers are given in frame 'patient_lps', the curve in 'image': {why}")
    axes = place[:3, :2]
    own = 1e3 * np.linalg.norm(axes, axis=0)
    given = curve.image and curve.image.pixel_spacing_mm
    if given is not None and not np.allclose(given, own, rtol=SAME_SPACING, atol=0):
        raise SettingError(
            f"the curve's pixel spacing is {given[0]:g}, {given[1]:g} mm, that of the slice in the "
            f"patient {own[0]:g}, {own[1]:g} mm; leave --pixel-spacing out"
        )
    pixels = np.c_[curve.points[:, :2], np.ones(len(curve.points))]
    sigma = None if curve.sigma is None else curve.sigma * float(np.sqrt(own.prod())) * 1e-3
    carried = replace(curve, frame="patient_lps", points=(pixels @ place.T)[:, :3], sigma=sigma)
    return carried, axes


def check_plausible(pairs: Correspondences, curve: Fixture, image: PlannedImage | None) -> None:
    """Refuse markers that no slice and no robot can have.

    A planar fit is exact under any unit and either exchange of axes, so these leave no residual.

    Raises MarkerError: markers spread over more or less than `LARGEST_RADIUS_M` and
        `LEAST_RADIUS_M`, or outside the image
    """
    _check_size(pairs.target, "target")
    if pairs.source_frame != "image":
        _check_size(pairs.source, "source")
        return
    _check_inside(pairs, curve, image)


def _check_size(positions: NDArray[np.float64], what: str) -> None:
    radius = float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).mean()))
    # Markers in one place, but for rounding, are left to the fit, which says so.
    if radius > 1e-9 * np.abs(positions).max() and not LEAST_RADIUS_M <= radius <= LARGEST_RADIUS_M:
        raise MarkerError(
            f"the {what} markers lie {radius:.3g} m (rms) from their centre; {LEAST_RADIUS_M:g} "
            f"to {LARGEST_RADIUS_M:g} m are allowed (millimetres given as metres, or the reverse?)"
        )


def _check_inside(pairs: Correspondences, curve: Fixture, image: PlannedImage | None) -> None:
    size = image or curve.image
    if size is None:
        return
    corner = np.array([size.width_px, size.height_px]) - 0.5
    for label, place in zip(pairs.labels, pairs.source, strict=True):
        if not ((place >= -0.5) & (place <= corner)).all():
            u, v = place
            raise MarkerError(
                f"marker {label} at u = {u:.6g}, v = {v:.6g} px lies outside the slice of "
                f"{size.width_px} x {size.height_px} px (u is the column, v the row)"
            )
