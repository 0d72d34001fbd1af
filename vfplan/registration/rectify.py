"""A photograph taken at an angle, made flat by the homography of its markers.

A camera that looks at a sheet from the side sees a homography of it (R. Hartley and A. Zisserman,
"Multiple view geometry in computer vision", 2004, ch. 8). The flat picture is what a camera far
above the sheet would see. It is neither turned nor mirrored against the photograph.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfplan.errors import CheckFailed, MarkerError
from vfplan.geometry.lines import Array, homogeneous, row_lengths
from vfplan.images.read import PlannedImage
from vfplan.markers.correspondences import Correspondences
from vfplan.registration.checks import (
    MIN_FOR_HOMOGRAPHY,
    fit_homography,
    homography_rows,
    label_mistake,
    mapped_by_homography,
    perspective_test,
)
from vfplan.registration.models import GOOD_SET_PROBABILITY, rms
from vfplan.registration.registration import fit_registration

# Smallest over largest singular value of the equations of a homography that is determined. Markers
# of which all but one lie on a line have less than 1e-9, even spread ones about 1e-2.
DETERMINED = 1e-5

# The flat picture reaches beyond the markers by so many times their own extent at most. What lies
# further out cannot be planned on, and the horizon would be infinitely far.
REACH = 1.0


@dataclass(frozen=True, eq=False)
class Flattening:
    """How a photograph becomes a flat picture.

    Parameters
    ----------
    homography
        (3, 3) from pixels of the photograph to pixels of the flat picture.
    width_px, height_px
        Size of the flat picture.
    pixel_spacing_mm
        Of the flat picture: about that of the photograph where it shows the markers finest.
    residuals_m
        (N,) distance of each marker from where the homography puts it.
    error_m
        RMS error of a marker by these residuals, with the homography's own freedom counted.
    enlargement
        How many pixels of the flat picture, at most, a pixel of a marker becomes along a direction.
    """

    homography: Array
    width_px: int
    height_px: int
    pixel_spacing_mm: float
    residuals_m: Array
    error_m: float
    enlargement: float

    @property
    def residual_rms_m(self) -> float:
        """RMS of the residuals."""
        return rms(self.residuals_m)

    @property
    def numbers(self) -> tuple[float, ...]:
        """As `vfplan.images.read.made_flat` takes it, and a bundle's recipe keeps it."""
        size = (self.width_px, self.height_px, self.pixel_spacing_mm)
        return (*self.homography.ravel().tolist(), *size)

    @property
    def told(self) -> str:
        """As `vfplan.images.read.flat_findings` takes it, and the flat PNG keeps it."""
        return f"{1e3 * self.residual_rms_m:.3g} {self.enlargement:.3g} {self.pixel_spacing_mm:g}"


def projected(homography: Array, places: Array) -> Array:
    """(N, 2) places (N, 2) mapped by a homography (3, 3)."""
    mapped = homogeneous(places) @ homography.T
    return mapped[:, :2] / mapped[:, 2:]


def flattening(
    pairs: Correspondences, image: PlannedImage, max_error_m: float | None, max_megapixels: float
) -> Flattening:
    """The way from a photograph to a flat picture, by markers that are drawn on it.

    Parameters
    ----------
    max_error_m
        Gate: largest RMS error of a marker [m]; `None`: any.
    max_megapixels
        Gate: largest flat picture, in millions of pixels.

    Raises
    ------
    MarkerError
        Markers in space, fewer than five, or a layout that determines no homography.
    CheckFailed
        A gate does not hold.
    """
    n = len(pairs.labels)
    if pairs.source_frame != "image":
        text = "these markers are given in space, not in pixels. Give u_px and v_px of each"
        raise MarkerError(text, code="rectify-in-space")
    if n < MIN_FOR_HOMOGRAPHY:
        text = f"{n} markers are too few for a homography. Give at least {MIN_FOR_HOMOGRAPHY}"
        raise MarkerError(
            text, code="too-few-markers", numbers={"markers": n, "needed": MIN_FOR_HOMOGRAPHY}
        )
    affine = fit_registration(pairs.source, pairs.target, labels=pairs.labels, sigma=pairs.sigma)
    problem = affine.problem
    h = fit_homography(problem, affine.m)
    depths = 1 + problem.s @ h[9:]
    strengths = np.linalg.svd(homography_rows(h, problem), compute_uv=False)
    is_determined = strengths[-1] > DETERMINED * strengths[0]
    residuals = row_lengths(problem.y - mapped_by_homography(h, problem.s))
    squares = float((problem.weights.mean(axis=1) * residuals**2).sum())
    error_m = float(np.sqrt(3 * squares / (3 * n - len(h))))
    is_off = not (depths > 0).all() or (max_error_m is not None and error_m > max_error_m)
    if is_off or not is_determined:
        mistake = label_mistake(affine)
        if mistake is not None and mistake.p_value < GOOD_SET_PROBABILITY:
            raise mistake.refusal(affine, "Correct the labels")
    if not is_determined:
        text = "the markers determine no homography: too many lie on one line. Add one off it"
        raise MarkerError(text, code="homography-undetermined")
    if is_off:
        allowed = "any" if max_error_m is None else f"{1e3 * max_error_m:g} mm"
        # The marker that `vfplan plan` names, if it names one.
        test = perspective_test(affine, fewest=MIN_FOR_HOMOGRAPHY)
        if test is not None and test.outlier is not None:
            index, others_m = test.outlier
            advice = (
                f"Without {pairs.labels[index]} it leaves {1e3 * others_m:.2f} mm: touch that "
                "again, or delete its row and give --common"
            )
        else:
            advice = (
                f"{pairs.labels[int(residuals.argmax())]} is off most. Look for mistaken labels, "
                "a bent sheet or a lens that bends straight lines"
            )
        raise CheckFailed(
            f"no homography fits the markers: each is off by {1e3 * error_m:.2f} mm (rms), and "
            f"--max-residual allows {allowed}. {advice}",
            code="residual-large", numbers={"error_m": error_m, "max_residual_m": max_error_m},
        )  # fmt: skip

    # From pixels to places in the sheet [m], along the directions next to the photograph's own.
    to_s = problem.normaliser.matrix
    numerator, denominator = h[:9].reshape(3, 3) @ to_s, np.append(h[9:], 1.0) @ to_s
    centre = h[:9].reshape(3, 3)[:, 2]
    steps = numerator[:, :2] - np.outer(centre, denominator[:2])
    left, _, right = np.linalg.svd(steps, full_matrices=False)
    axes = left @ right
    to_sheet = np.vstack([axes.T @ (numerator - np.outer(centre, denominator)), denominator])

    # A pixel of the size at which the photograph shows the markers finest, in three digits.
    on_sheet = projected(to_sheet, pairs.source)
    scale = to_sheet[:2, :2] - on_sheet[:, :, None] * to_sheet[2, :2]
    scale = scale / depths[:, None, None]
    sizes_mm = 1e3 * np.linalg.svd(scale, compute_uv=False)
    finest_mm = float(sizes_mm.min())
    spacing_mm = float(f"{finest_mm:.3g}")

    # As much of the sheet as the photograph shows, not far beyond the markers.
    first, last = on_sheet.min(axis=0), on_sheet.max(axis=0)
    reach = REACH * (last - first).max()
    first, last = first - reach, last + reach
    right_px, bottom_px = image.width_px - 0.5, image.height_px - 0.5
    corners = np.array([[-0.5, -0.5], [right_px, -0.5], [-0.5, bottom_px], [right_px, bottom_px]])
    if (homogeneous(corners) @ denominator > 0).all():
        shown = projected(to_sheet, corners)
        first, last = np.maximum(first, shown.min(axis=0)), np.minimum(last, shown.max(axis=0))
    width, height = np.ceil((last - first) / (1e-3 * spacing_mm)).astype(int).tolist()
    if width * height > 1e6 * max_megapixels:
        raise CheckFailed(
            f"the flat picture would have {width} x {height} px, and --max-megapixels allows "
            f"{max_megapixels:g} million. Take the photograph from further above",
            code="flat-picture-large", numbers={"width_px": width, "height_px": height},
        )  # fmt: skip
    to_pixels = np.array(
        [[1e3 / spacing_mm, 0.0, -0.5 - 1e3 * first[0] / spacing_mm],
         [0.0, 1e3 / spacing_mm, -0.5 - 1e3 * first[1] / spacing_mm],
         [0.0, 0.0, 1.0]]
    )  # fmt: skip
    homography = to_pixels @ to_sheet
    return Flattening(
        homography / homography[2, 2], width, height, spacing_mm, residuals, error_m,
        float(sizes_mm.max()) / finest_mm,
    )  # fmt: skip
