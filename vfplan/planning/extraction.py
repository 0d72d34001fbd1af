"""A planned slice -> its pen's coverage -> the centre line -> a curve in the image's pixels."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vfplan.bundle.content import max_number
from vfplan.display import Report
from vfplan.errors import CurveError, ImageError, SettingError
from vfplan.findings import Finding, Findings, doubt, note
from vfplan.fixture import Curve, Fixture, Provenance, SourceImage, Stroke
from vfplan.geometry import PixelSpacing
from vfplan.geometry.lines import in_space, length_of
from vfplan.io.files import FilePath
from vfplan.planning.settings import ExtractSettings
from vfplan.planning.tolerance import sample_curve
from vfplan.settings import flat

if TYPE_CHECKING:
    from vfplan.curve.extraction import Extraction
    from vfplan.images.read import PlannedImage
    from vfplan.vectors.curve import VectorDrawing

# Settings that only a pen's drawing can follow.
PEN_SETTINGS = "colour", "method", "roi", "max_gap_px", "exclude", "start", "end", "accept_width"

# Settings that only a vector curve can follow.
VECTOR_SETTINGS = ("curve_origin", "curve_type")

# Settings that only an image can follow.
IMAGE_SETTINGS = ("pixel_spacing_mm", "frame", "imager_spacing", "max_megapixels", "pixels")

# Largest difference of Slicer's two types of curve without a doubt, in contact radii.
MAX_TYPE_DIFFERENCE = 0.1

# A small contact radius [m], where none is known yet.
SMALL_RADIUS_M = 1e-3

# The doubt about pixels of a program that may not have turned a picture as EXIF says.
UNTURNED = (
    "The pixels may have been counted in a program that does not turn pictures by their EXIF tag. "
    "Compare them with the picture, and say it: --pixels as-shown or --pixels as-stored"
)

# Points of Slicer's curve that a sheet marks: each takes 16 signs, and a setting holds 4096.
MAX_SLICER_POINTS = 250

# Size of a microscope's pixel [mm].
MIN_SPACING_MM = 1e-5


@dataclass(frozen=True, eq=False)
class ExtractResult:
    """A curve, what it was taken from, and the report for `--json`.

    A vector curve given alone comes from no image: `image` and `extraction` are `None`.
    """

    fixture: Fixture
    image: PlannedImage | None
    extraction: Extraction | None
    report: Report
    findings: Findings = ()


def extract(
    source: FilePath | PlannedImage, settings: ExtractSettings | None = None, *,
    curve: FilePath | None = None, contact_radius: float = SMALL_RADIUS_M,
) -> ExtractResult:  # fmt: skip
    """Read a planned slice and extract its curve.

    Parameters
    ----------
    source
        The slice, also one that is read already; or, alone, a vector curve.
    settings
        How the curve is read.
    curve
        A vector curve drawn on the slice, instead of a pen's: Slicer's `.mrk.json` or `.fcsv` (a
        DICOM slice says where it lies), ImageJ's `.roi`, a CSV `u_px,v_px` or `X,Y`, or a DICOM
        presentation state.
    contact_radius
        What the tool will keep from the curve [m]; Slicer's types of curve may differ by a share
        of it.

    Raises `ImageError`, `CurveError`, `SettingError` or `MissingExtra`.
    """
    from vfplan.curve.extraction import extract_curve
    from vfplan.images.read import OVERLAY
    from vfplan.vectors import SUFFIXES

    settings = settings or ExtractSettings()
    is_read = not isinstance(source, (str, Path))
    is_vector_alone = not is_read and Path(source).suffix.lower() in SUFFIXES
    if curve is not None or is_vector_alone:
        _refuse_settings(settings, PEN_SETTINGS)
    else:
        _refuse_settings(settings, VECTOR_SETTINGS, "without a vector curve")
    if is_vector_alone:
        _refuse_settings(settings, IMAGE_SETTINGS)
        return vector_alone(source, settings, contact_radius)

    image = source if is_read else read_slice(source, settings)

    # The curve, as it was drawn.
    if curve is None:
        import cv2  # noqa: F401 - the measured time holds no import
    started = time.perf_counter()
    inputs, by_hand = {"image": image.sha256}, {}
    if curve is None:
        given = {name: getattr(settings, name) for name in (*PEN_SETTINGS, "stroke")}
        try:
            extraction = extract_curve(image, **{k: v for k, v in given.items() if v is not None})
        except CurveError as error:
            if any(finding.code == "overlay-left-out" for finding in image.findings):
                error.message = f"{OVERLAY} {error.message}"
            raise
    else:
        extraction, inputs["curve"], by_hand = read_vectors(image, curve, settings, contact_radius)
    if settings.density_per_mm is not None:
        extraction = resample(extraction, image.pixel_spacing_mm, settings.density_per_mm)
    elapsed = time.perf_counter() - started

    findings = (*slice_findings(image, settings), *extraction.findings)
    strokes = extraction.strokes
    points = np.concatenate([stroke.points for stroke in strokes])
    sigma = None
    if extraction.method != "vector":
        sigma = np.concatenate([stroke.sigma for stroke in strokes])
    provenance = Provenance.now(inputs, settings)
    fixture = Fixture(
        frame="image", points=in_space(points),
        provenance=replace(provenance, settings=provenance.settings | by_hand), sigma=sigma,
        curve=None if extraction.method == "mask" else Curve.of(strokes),
        image=SourceImage(image.width_px, image.height_px, image.pixel_spacing_mm),
        findings=findings,
    )  # fmt: skip
    report = describe_extraction(extraction, image) | {"elapsed_s": elapsed}
    return ExtractResult(fixture, image, extraction, report, findings)


# Ratio of the two pixel spacings that were typed. A comma separates them, so that 1,5 typed for 1.5
# has a ratio of 5, while pixels of slices are nearly square.
MAX_SPACING_RATIO = 2.0


def slice_findings(image: PlannedImage, settings: ExtractSettings) -> Findings:
    """What a person should look at in the slice, whatever curve is drawn on it."""
    along_u, along_v = settings.pixel_spacing_mm or (1.0, 1.0)
    if max(along_u, along_v) <= MAX_SPACING_RATIO * min(along_u, along_v):
        return image.findings
    text = (
        f"The pixel spacing is {along_u:g} mm along u and {along_v:g} mm along v. Type it "
        "with a point if the comma was meant as one."
    )
    return (*image.findings, note("pixel-spacing-uneven", "extract", text))


def read_slice(path: FilePath, settings: ExtractSettings) -> PlannedImage:
    """The slice, with pixels of a size that a bundle can hold.

    Raises `ImageError`, or `SettingError` where the size was typed.
    """
    from vfplan.images.read import MAX_MEGAPIXELS, read_image

    image = read_image(
        path, frame=settings.frame, pixel_spacing_mm=settings.pixel_spacing_mm,
        imager_spacing=bool(settings.imager_spacing),
        max_megapixels=settings.max_megapixels or MAX_MEGAPIXELS, pixels=settings.pixels,
    )  # fmt: skip
    largest = max_number("/image/pixel_spacing")
    for spacing in image.pixel_spacing_mm or ():
        if not MIN_SPACING_MM <= spacing <= largest:
            message = f"pixel spacing is {spacing:g} mm. Give {MIN_SPACING_MM:g} to {largest:g} mm"
            if settings.pixel_spacing_mm is not None:
                raise SettingError(message, code="pixel-spacing-range")
            raise ImageError(message, where=path, code="pixel-spacing-range")
    return image


def _refuse_settings(
    settings: ExtractSettings, names: tuple[str, ...], curve: str = "on a vector curve"
) -> None:
    """A setting that a curve leaves without effect would be taken for one that had it."""
    for name in names:
        value = getattr(settings, name)
        if (value or None) != getattr(ExtractSettings(), name):
            raise SettingError(
                f"{name} {value!r} has no effect {curve}. Leave it out",
                code="setting-without-effect",
            )


def read_vectors(
    image: PlannedImage,
    path: FilePath,
    settings: ExtractSettings,
    contact_radius: float = SMALL_RADIUS_M,
) -> tuple[Extraction, str, dict[str, str]]:
    """A vector curve on its slice, the SHA-256 of its file, and what its recipe says of it."""
    from vfplan.curve.account import fold_findings
    from vfplan.curve.extraction import vector_stroke
    from vfplan.images.read import SLICER_POINTS
    from vfplan.vectors.curve import check_drawn_on
    from vfplan.vectors.read import SLICER_SUFFIXES, onto_slice, read_vector_curve

    curve = read_vector_curve(path, settings.curve_origin, settings.stroke, settings.curve_type)
    placed = onto_slice(curve, image.T_patient_image, str(path), image.pixel_spacing_mm)
    extraction = vector_stroke(placed.stroke(1.0), image, str(path))
    findings = [*vector_findings(curve, contact_radius), *fold_findings(extraction.strokes)]
    doubts = check_drawn_on(curve.drawn_on, image, settings.frame, str(path))
    findings += [doubt("vector-image-unknown", "extract", text) for text in doubts]
    if curve.points.shape[1] == 2 and image.orientation != 1 and settings.pixels is None:
        findings.append(doubt("pixels-unturned", "extract", f"{path}: {UNTURNED}"))
    set_by_hand = {}
    if Path(path).suffix.lower() in SLICER_SUFFIXES and len(placed.points) <= MAX_SLICER_POINTS:
        set_by_hand[SLICER_POINTS] = flat(placed.points.round(1).tolist())
    return replace(extraction, findings=tuple(findings)), curve.sha256, set_by_hand


def vector_findings(curve: VectorDrawing, contact_radius: float) -> Iterator[Finding]:
    """What a vector curve's file leaves open."""
    for text in curve.warnings:
        yield note("vector-curve", "extract", text)
    if curve.type_difference_m > MAX_TYPE_DIFFERENCE * contact_radius:
        yield curve_type_doubt(curve.type_difference_m)


def curve_type_doubt(difference_m: float) -> Finding:
    """That a file of Slicer does not say which type of curve it shows."""
    text = (
        f"Slicer's file does not say whether the curve is a spline or straight lines, which differ "
        f"by up to {1e3 * difference_m:.2g} mm. A spline was taken. Look up Curve Type in Slicer's "
        "Markups module, and say it: --curve-type spline or --curve-type linear"
    )
    return doubt("slicer-curve-type", "extract", text)


def vector_alone(path: FilePath, settings: ExtractSettings, contact_radius: float) -> ExtractResult:
    """A curve in the patient's frame [m], or in the pixels of an image that is not given."""
    from vfplan.curve.account import fold_findings
    from vfplan.vectors.curve import FINE_M
    from vfplan.vectors.read import onto_slice, read_vector_curve

    started = time.perf_counter()
    curve = read_vector_curve(path, settings.curve_origin, settings.stroke, settings.curve_type)
    curve = curve if curve.measured_from is None else onto_slice(curve, None, str(path))
    is_in_image = curve.points.shape[1] == 2
    step = 1.0 if is_in_image else FINE_M
    if settings.density_per_mm is not None:
        if is_in_image:
            raise SettingError(
                "a density per millimetre needs a pixel spacing, and so an image. Leave it out",
                code="density-without-spacing",
            )
        step = 1e-3 / settings.density_per_mm
    stroke = curve.stroke(step)
    frame, points = "patient_lps", stroke.points
    described: Report = {"length_mm": stroke.length * 1e3}
    findings = [*vector_findings(curve, contact_radius)]
    if is_in_image:
        frame, points = "image", in_space(points)
        described = {"length_px": stroke.length}
        findings += fold_findings([stroke])
    described |= {"closed": stroke.closed, "points": len(points)}
    provenance = Provenance.now({"curve": curve.sha256}, settings)
    fixture = Fixture(frame, points, provenance, curve=Curve.of([stroke]), findings=tuple(findings))
    report = {
        "frame": frame, "strokes": [described], "points": len(points),
        "elapsed_s": time.perf_counter() - started,
    }  # fmt: skip
    return ExtractResult(fixture, None, None, report, fixture.findings)


def resample(extraction: Extraction, spacing_mm: PixelSpacing, density_per_mm: float) -> Extraction:
    """The same strokes at a number of points a millimetre instead of one a pixel.

    Raises `SettingError` without a pixel spacing, or for "mask", whose points have no order.
    """
    if extraction.method == "mask":
        raise SettingError(
            "a density needs an ordered curve, and method 'mask' gives every pixel. Leave one out",
            code="density-of-mask",
        )
    if spacing_mm is None:
        raise SettingError(
            "a density per millimetre needs a pixel spacing; the image has none. Give "
            "--pixel-spacing",
            code="density-without-spacing",
        )
    unit = np.array([*spacing_mm, 0.0]) * 1e-3
    strokes = []
    for stroke in extraction.strokes:
        fine_m = in_space(stroke.points) * unit
        fine = sample_curve(fine_m, stroke.closed, radius_m=1.0, density_per_m=density_per_mm * 1e3)
        strokes.append(stroke.at(fine.parameter))
    return replace(extraction, strokes=tuple(strokes))


def describe_extraction(extraction: Extraction, image: PlannedImage) -> Report:
    """What `extract --json` reports of a curve, but for the time it took."""
    spacing = image.pixel_spacing_mm
    size = {"width_px": image.width_px, "height_px": image.height_px, "pixel_spacing_mm": spacing}
    if image.orientation != 1:
        size["orientation"] = image.orientation
    report: Report = {"image": size}
    if extraction.method != "vector":
        report["mask_pixels"] = int(extraction.mask.sum())
    strokes = extraction.strokes
    report |= {
        "strokes": [describe_stroke(stroke, spacing) for stroke in strokes],
        "points": sum(len(stroke.points) for stroke in strokes),
        "spacing_mm": None, "density_per_mm": None,
    }  # fmt: skip
    if extraction.method != "vector":
        names = ("number", "u", "v", "pixels", "share", "size_px", "what")
        report["account"] = [
            {name: getattr(entry, name) for name in names} for entry in extraction.account
        ]
    if spacing is not None:
        open_count = sum(stroke.is_ordered and not stroke.closed for stroke in strokes)
        gap_count = report["points"] - open_count
        length_mm = sum(stroke["length_mm"] for stroke in report["strokes"])
        report["spacing_mm"] = length_mm / gap_count
        if length_mm:
            report["density_per_mm"] = gap_count / length_mm
    return report


def describe_stroke(stroke: Stroke, spacing_mm: PixelSpacing) -> Report:
    """One stroke as `extract --json` reports it."""
    length_mm = None
    if spacing_mm is not None and stroke.is_ordered:
        length_mm = length_of(stroke.points * spacing_mm, stroke.closed)
    elif spacing_mm is not None:
        length_mm = float(stroke.length * np.sqrt(spacing_mm[0] * spacing_mm[1]))
    report: Report = {"length_px": float(stroke.length), "length_mm": length_mm}
    if stroke.width is not None:
        report["width_px"] = float(stroke.width)
    report |= {
        "closed": bool(stroke.closed),
        "points": len(stroke.points),
        "ends_px": stroke.end_points,
        "bridged_points": int(np.count_nonzero(stroke.bridged)),
    }
    return report
