"""Markers and a curve -> a registration without a fault that is sure."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, MarkerError, SettingError
from vfplan.fixture import Fixture
from vfplan.planning.placing import in_patient
from vfplan.planning.plausible import check_plausible
from vfplan.planning.readings import Held, hold_against_marks
from vfplan.planning.settings import FixtureSettings

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage
    from vfplan.markers import Correspondences
    from vfplan.markers.finding import FoundMarker
    from vfplan.registration import Registration
    from vfplan.registration.diagnosis import Diagnosis


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
    curve: Fixture, markers: str | Path, markers2: str | Path | None, image: PlannedImage | None
) -> tuple[Correspondences, Fixture, NDArray[np.float64] | None]:
    """The markers, and the curve in their source frame (see `Matched`)."""
    from vfplan.markers import read_markers

    if curve.frame == "robot_base":
        raise CurveError("the curve is in frame 'robot_base' already; one of an image is wanted")
    pairs = read_markers(markers, markers2)
    if (pairs.source_frame, curve.frame) == ("patient_lps", "image"):
        return pairs, *in_patient(curve, image if _drawn_on(curve, image) else None)
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
        (`vfplan.registration.refusal`)
    Raises SettingError: markers to be found in a slice that is not there, a model that cannot be
        fitted
    """
    from vfplan.registration.diagnosis import diagnose
    from vfplan.registration.refusal import refuse_sure_faults

    pairs, curve, slice_axes = _pairs(curve, markers, markers2, image)
    with _named(markers if markers2 is None else f"{markers}, {markers2}"):
        check_plausible(pairs, curve, image if _drawn_on(curve, image) else None)
        held = None
        if pairs.source_frame == "image" and image is not None and _drawn_on(curve, image):
            held = hold_against_marks(image.rgb, pairs)
        found = _find(pairs, curve, image) if settings.find_markers else ()
        if found:
            pairs = replace(pairs, source=np.array([marker.position_px for marker in found]))
        registration = _fit(curve, pairs, settings)
        diagnosis = diagnose(registration)
        refuse_sure_faults(registration, diagnosis)
    doubts = held.warnings if held is not None and not found else ()
    warnings = (*doubts, *_frame_warning(pairs), *_image_warning(curve, image))
    return Matched(curve, slice_axes, pairs, registration, diagnosis, found, held, warnings)


@contextmanager
def _named(files: str | Path) -> Iterator[None]:
    """Name the marker files in errors that do not say where they are."""
    try:
        yield
    except MarkerError as error:
        if error.where is None:
            raise MarkerError(error.message, where=str(files)) from None
        raise


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
    pairs: Correspondences, curve: Fixture, image: PlannedImage | None
) -> tuple[FoundMarker, ...]:
    from vfplan.markers.finding import find_markers

    if pairs.source_frame != "image":
        raise SettingError("markers can be found in an image only; these are given in 3-D")
    if image is None:
        raise SettingError("to find the markers the image is needed, which was not given")
    if not _drawn_on(curve, image):
        raise SettingError(
            "the image given is not the one the curve was drawn on (SHA-256 differs)"
        )
    return find_markers(image.rgb, pairs.labels, pairs.source)


def _drawn_on(curve: Fixture, image: PlannedImage | None) -> bool:
    """Whether the image may be the curve's own: nothing says that it is another."""
    known = curve.provenance.inputs.get("image")
    return image is not None and (not known or not image.sha256 or known == image.sha256)


def _frame_warning(pairs: Correspondences) -> tuple[str, ...]:
    if pairs.target_frame == "robot_base":
        return ()
    return (
        f"the target markers, and so the fixture, are in {pairs.target_frame}: no robot renders it "
        "before it is registered to its own frame",
    )


def _image_warning(curve: Fixture, image: PlannedImage | None) -> tuple[str, ...]:
    if image is None or _drawn_on(curve, image):
        return ()
    return (
        "the image given is not the file the curve was drawn on (SHA-256 differs): nothing was "
        "checked against it",
    )
