"""Image -> pen coverage -> centre line -> a curve in the image's pixels."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vfplan.errors import ImageError, SettingError
from vfplan.findings import Finding, doubt, note
from vfplan.fixture import Curve, Fixture, Provenance, SourceImage
from vfplan.io.files import now_utc
from vfplan.planning.carrying import along, in_strokes, length_of
from vfplan.planning.settings import ExtractSettings
from vfplan.planning.tolerance import sample_curve

if TYPE_CHECKING:
    from vfplan.curve import Extraction, Stroke
    from vfplan.images.read import PlannedImage

# Settings that only a pen's drawing, and only an image, can follow.
OF_A_PEN = (
    *("colour", "method", "roi", "max_gap_px"),
    *("exclude", "start", "end", "accept_width"),
)
OF_AN_IMAGE = ("pixel_spacing_mm", "frame", "imager_spacing", "max_megapixels")
# Size of a pixel [mm]: from a microscope's to one as large as the patient.
SPACING_MM = (1e-5, 1e3)


@dataclass(frozen=True, eq=False)
class Extracted:
    """A curve, what it was taken from, and the report for `--json`.

    A vector curve given alone comes from no image: `image` and `extraction` are `None`.
    """

    fixture: Fixture
    image: PlannedImage | None
    extraction: Extraction | None
    report: dict[str, Any]
    findings: tuple[Finding, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """The texts of the findings."""
        return tuple(finding.text for finding in self.findings)


def extract(
    path: str | Path,
    settings: ExtractSettings | None = None,
    *,
    curve: str | Path | None = None,
) -> Extracted:
    """Read a planned slice and extract its curve.

    Parameters
    ----------
    path
        The slice; or, alone, a vector curve.
    settings
        How the curve is read.
    curve
        A vector curve drawn on the slice, taken instead of a pen's: Slicer's `.mrk.json` or
        `.fcsv` (a DICOM slice says where it lies), ImageJ's `.roi`, a CSV `u_px,v_px` or `X,Y`, or
        a DICOM presentation state.

    Raises `ImageError`, `CurveError`, `SettingError` or `MissingExtra`.
    """
    now_utc()  # refuses a SOURCE_DATE_EPOCH that is no time before any work is done
    settings = settings or ExtractSettings()
    from vfplan.curve import load_libraries
    from vfplan.images.read import MAX_MEGAPIXELS, read_image
    from vfplan.vectors.read import SUFFIXES

    alone = Path(path).suffix.lower() in SUFFIXES
    if curve is not None or alone:
        _refuse_settings(settings, OF_A_PEN)
    elif settings.curve_origin is not None:
        raise SettingError("curve_origin has no effect without a vector curve; leave it out")
    if alone:
        _refuse_settings(settings, OF_AN_IMAGE)
        return _vector_alone(path, settings)
    image = read_image(
        path,
        frame=settings.frame,
        pixel_spacing_mm=settings.pixel_spacing_mm,
        imager_spacing=bool(settings.imager_spacing),
        max_megapixels=settings.max_megapixels or MAX_MEGAPIXELS,
    )
    _check_spacing(image, asked=settings.pixel_spacing_mm is not None, where=str(path))
    if curve is None:
        load_libraries()
    started = time.perf_counter()
    inputs = {"image": image.sha256}
    if curve is None:
        extraction = _drawn_with_a_pen(image, settings)
    else:
        extraction, inputs["curve"] = _drawn_as_vectors(image, curve, settings)
    if settings.density_per_mm is not None:
        extraction = resample(extraction, image.pixel_spacing_mm, settings.density_per_mm)
    elapsed = time.perf_counter() - started
    fixture = planned_curve(extraction, image, settings, inputs=inputs)
    report = describe_extraction(extraction, image) | {"elapsed_s": elapsed}
    findings = tuple(extraction.findings)
    return Extracted(replace(fixture, findings=findings), image, extraction, report, findings)


def _check_spacing(image: PlannedImage, *, asked: bool, where: str) -> None:
    least, largest = SPACING_MM
    for spacing in image.pixel_spacing_mm or ():
        if not least <= spacing <= largest:
            fault = f"pixel spacing is {spacing:g} mm; {least:g} to {largest:g} mm are allowed"
            raise SettingError(fault) if asked else ImageError(fault, where=where)


def _refuse_settings(settings: ExtractSettings, names: tuple[str, ...]) -> None:
    """A setting that a vector curve leaves without effect would be taken for one that had it."""
    for name in names:
        value = getattr(settings, name)
        if (value or None) != getattr(ExtractSettings(), name):
            raise SettingError(f"{name} {value!r} has no effect on a vector curve; leave it out")


def _drawn_with_a_pen(image: PlannedImage, settings: ExtractSettings) -> Extraction:
    from vfplan.curve import extract_curve

    given = {name: getattr(settings, name) for name in (*OF_A_PEN, "stroke")}
    return extract_curve(image, **{k: v for k, v in given.items() if v is not None})


def _drawn_as_vectors(
    image: PlannedImage, path: str | Path, settings: ExtractSettings
) -> tuple[Extraction, str]:
    from vfplan.curve import vector_stroke
    from vfplan.vectors.presentation import check_drawn_on
    from vfplan.vectors.read import onto_slice, read_vector_curve

    curve = read_vector_curve(path, settings.curve_origin, settings.stroke)
    placed = onto_slice(curve, image.T_patient_image, str(path))
    extraction = vector_stroke(placed.fine(1.0), curve.closed, image, str(path))
    findings = [note("vector-curve", "extract", text) for text in curve.warnings]
    for text in check_drawn_on(curve.drawn_on, image, settings.frame, str(path)):
        findings.append(doubt("vector-image-unknown", "extract", text))
    return replace(extraction, findings=tuple(findings)), curve.sha256


def _vector_alone(path: str | Path, settings: ExtractSettings) -> Extracted:
    """A curve in the patient's frame [m], or in the pixels of an image that is not given."""
    from vfplan.vectors.read import FINE_M, read_vector_curve

    started = time.perf_counter()
    curve = read_vector_curve(path, settings.curve_origin, settings.stroke)
    flat = curve.points.shape[1] == 2
    density = settings.density_per_mm
    if flat and density is not None:
        raise SettingError("a density per millimetre needs a pixel spacing, and so an image")
    step = 1.0 if flat else FINE_M if density is None else 1e-3 / density
    points = curve.fine(step)
    points = np.c_[points, np.zeros(len(points))] if flat else points
    fixture = Fixture(
        frame="image" if flat else "patient_lps",
        points=points,
        provenance=Provenance.now({"curve": curve.sha256}, settings),
        curve=Curve(np.zeros(len(points), np.int32), np.array([curve.closed])),
    )
    length = length_of(points, curve.closed)
    stroke = {"length_px": length} if flat else {"length_mm": length * 1e3}
    report: dict[str, Any] = {
        "frame": fixture.frame,
        "strokes": [stroke | {"closed": curve.closed, "points": len(points)}],
        "points": len(points),
        "elapsed_s": time.perf_counter() - started,
    }
    findings = tuple(note("vector-curve", "extract", text) for text in curve.warnings)
    return Extracted(replace(fixture, findings=findings), None, None, report, findings)


def planned_curve(
    extraction: Extraction,
    image: PlannedImage,
    settings: ExtractSettings | None = None,
    *,
    inputs: dict[str, str] | None = None,
) -> Fixture:
    """The extracted strokes as a `Fixture` in frame "image": (u, v, 0) in pixels."""
    strokes = extraction.strokes
    points = np.concatenate([s.points_px for s in strokes])
    return Fixture(
        frame="image",
        points=np.c_[points, np.zeros(len(points))],
        provenance=Provenance.now(inputs or {"image": image.sha256}, settings or ExtractSettings()),
        sigma=None
        if extraction.method == "vector"
        else np.concatenate([s.sigma_px for s in strokes]),
        curve=None if extraction.method == "mask" else _curve(extraction),
        image=SourceImage(image.width_px, image.height_px, image.pixel_spacing_mm),
    )


def _curve(extraction: Extraction) -> Curve:
    strokes = extraction.strokes
    bridged = np.concatenate([s.bridged for s in strokes])
    counts, closed = [len(s.points_px) for s in strokes], np.array([s.closed for s in strokes])
    return in_strokes(counts, closed, bridged if bridged.any() else None)


def resample(
    extraction: Extraction, spacing_mm: tuple[float, float] | None, density_per_mm: float
) -> Extraction:
    """The same strokes at a number of points a millimetre instead of one a pixel.

    Raises `SettingError` without a pixel spacing, or for "mask", whose points have no order.
    """
    if extraction.method == "mask":
        raise SettingError("a density needs an ordered curve; method 'mask' gives every pixel")
    if spacing_mm is None:
        raise SettingError("a density per millimetre needs a pixel spacing; the image has none")
    unit = np.array([*spacing_mm, 0.0]) * 1e-3

    def thin(stroke: Stroke) -> Stroke:
        fine = np.c_[stroke.points_px, np.zeros(len(stroke.points_px))] * unit
        at = sample_curve(
            fine, stroke.closed, radius_m=1.0, density_per_m=density_per_mm * 1e3
        ).parameter
        return replace(
            stroke,
            points_px=along(stroke.points_px, at),
            sigma_px=None if stroke.sigma_px is None else along(stroke.sigma_px, at),
            bridged=along(stroke.bridged.astype(float), at) > 0,
        )

    return replace(extraction, strokes=tuple(map(thin, extraction.strokes)))


def describe_extraction(extraction: Extraction, image: PlannedImage) -> dict[str, Any]:
    """What `extract --json` reports of a curve, but for the time it took."""
    spacing = image.pixel_spacing_mm
    size = {"width_px": image.width_px, "height_px": image.height_px, "pixel_spacing_mm": spacing}
    points = sum(len(s.points_px) for s in extraction.strokes)
    ordered = extraction.method != "mask"
    drawn = {} if extraction.method == "vector" else {"mask_pixels": int(extraction.mask.sum())}
    report: dict[str, Any] = {
        "image": size,
        **drawn,
        "strokes": [_describe_stroke(s, spacing, ordered) for s in extraction.strokes],
        "points": points,
        "spacing_mm": None,
        "density_per_mm": None,
    }
    if extraction.method != "vector":
        report["account"] = [asdict(entry) for entry in extraction.account]
    if spacing is not None:
        length_mm = sum(s["length_mm"] for s in report["strokes"])
        gaps = sum(len(s.points_px) - (ordered and not s.closed) for s in extraction.strokes)
        report["spacing_mm"] = length_mm / gaps
        report["density_per_mm"] = gaps / length_mm if length_mm else None
    return report


def _describe_stroke(
    stroke: Stroke, spacing: tuple[float, float] | None, ordered: bool
) -> dict[str, Any]:
    length_mm = None
    if spacing is not None and ordered:
        length_mm = length_of(stroke.points_px * spacing, stroke.closed)
    elif spacing is not None:
        length_mm = float(stroke.length_px * np.sqrt(spacing[0] * spacing[1]))
    width = {} if stroke.width_px is None else {"width_px": float(stroke.width_px)}
    return {
        "length_px": float(stroke.length_px),
        "length_mm": length_mm,
        **width,
        "closed": bool(stroke.closed),
        "points": len(stroke.points_px),
        "ends_px": stroke.ends_px if ordered else [],
        "bridged_points": int(np.count_nonzero(stroke.bridged)),
    }
