"""A curve drawn on a slice that knows its place in the patient, carried there."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError, SettingError
from vfplan.fixture import Fixture

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage

SAME_SPACING = 1e-6  # relative: decimals of the same number


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
