"""plan(image, markers) -> fixture: the whole pipeline, one step a line.

    image -> pen coverage -> centre line        extract()
    markers -> transform with its error         register()
    centre line -> points -> rendering

`extract` ends in a curve (a `Fixture` in the image's pixels), `register` begins with one.
"""

from __future__ import annotations

import datetime
import os
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vfplan.fixture import Curve, Fixture, Provenance, SourceImage

if TYPE_CHECKING:
    from vfplan.centreline import Extraction
    from vfplan.image import PlannedImage

# An ignored axis further than this from the slice's normal would collapse the curve.
MAX_IGNORED_TILT_DEG = 45.0


@dataclass(frozen=True)
class ExtractSettings:
    """How the curve is taken from the image.

    Parameters
    ----------
    colour
        The pen: a name or "#rrggbb".
    method
        "ridge", "skeleton" or "mask" (the paper's: every mask pixel a point).
    stroke
        "all", "longest", an index, or `None`: the only one there is.
    roi
        (u, v, width, height) [px] to look in; `None`: the whole image.
    max_gap_px
        Pen lifts shorter than this are bridged.
    pixel_spacing_mm
        (along u, along v); `None`: what the file says.
    density_per_mm
        Points a millimetre; `None`: one a pixel.
    """

    colour: str = "red"
    method: str = "ridge"
    stroke: str | int | None = None
    roi: tuple[int, int, int, int] | None = None
    max_gap_px: float = 20.0
    pixel_spacing_mm: tuple[float, float] | None = None
    density_per_mm: float | None = None


@dataclass(frozen=True)
class FixtureSettings:
    """How a registered curve becomes a fixture.

    Parameters
    ----------
    model, robust
        The registration; see `vfplan.fit_registration`.
    tolerance_m
        How far the union of spheres may lie from the swept curve [m].
    density_per_m
        Points a metre; takes the place of the tolerance.
    stiffness
        K [N/m], one number or one an axis.
    contact_radius, point_radius
        r_c and r_v [m].
    ignore_axis
        "normal" (of the slice), "x", "y", "z" or "none".
    """

    model: str = "affine"
    robust: bool = False
    tolerance_m: float = 1e-5
    density_per_m: float | None = None
    stiffness: tuple[float, ...] = (1000.0,)
    contact_radius: float = 5e-3
    point_radius: float = 0.0
    ignore_axis: str = "normal"


@dataclass(frozen=True, eq=False)
class Planned:
    """A fixture and what was found on the way, as `--json` reports it."""

    fixture: Fixture
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Extracted:
    """A curve in the image's pixels, what it was taken from, and the report for `--json`."""

    fixture: Fixture
    image: PlannedImage
    extraction: Extraction
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()


def extract(path: str | Path, settings: ExtractSettings) -> Extracted:
    """Read a planned slice and extract its curve.

    Raises `ImageError`, `CurveError` or `SettingError`.
    """
    from vfplan.centreline import extract_curve
    from vfplan.image import read_image

    image = read_image(path, pixel_spacing_mm=settings.pixel_spacing_mm)
    started = time.perf_counter()
    extraction = extract_curve(
        image,
        colour=settings.colour,
        method=settings.method,
        roi=settings.roi,
        stroke=settings.stroke,
        max_gap_px=settings.max_gap_px,
    )
    elapsed = time.perf_counter() - started
    fixture = planned_curve(extraction, image, settings)
    report = describe_extraction(extraction, image) | {"elapsed_s": elapsed}
    return Extracted(fixture, image, extraction, report)


def planned_curve(
    extraction: Extraction, image: PlannedImage, settings: ExtractSettings | None = None
) -> Fixture:
    """The extracted strokes as a `Fixture` in frame "image": (u, v, 0) in pixels."""
    strokes = extraction.strokes
    points = np.concatenate([s.points_px for s in strokes])
    bridged = np.concatenate([s.bridged for s in strokes])
    return Fixture(
        frame="image",
        points=np.c_[points, np.zeros(len(points))],
        provenance=_provenance({"image": image.sha256}, settings or ExtractSettings()),
        sigma=np.concatenate([s.sigma_px for s in strokes]),
        curve=Curve(
            stroke=np.repeat(np.arange(len(strokes)), [len(s.points_px) for s in strokes]).astype(
                np.int32
            ),
            closed=np.array([s.closed for s in strokes]),
            bridged=bridged if bridged.any() else None,
        ),
        image=SourceImage(image.width_px, image.height_px, image.pixel_spacing_mm),
    )


def describe_extraction(extraction: Extraction, image: PlannedImage) -> dict[str, Any]:
    """What `extract --json` reports of a curve, but for the time it took."""
    spacing = image.pixel_spacing_mm
    size = {"width_px": image.width_px, "height_px": image.height_px, "pixel_spacing_mm": spacing}
    points = sum(len(s.points_px) for s in extraction.strokes)
    report: dict[str, Any] = {
        "image": size,
        "mask_pixels": int(np.count_nonzero(extraction.mask)),
        "strokes": [_describe_stroke(s, spacing) for s in extraction.strokes],
        "points": points,
        "spacing_mm": None,
        "density_per_mm": None,
    }
    if spacing is not None:
        length_mm = sum(s["length_mm"] for s in report["strokes"])
        report["spacing_mm"] = length_mm / points
        report["density_per_mm"] = points / length_mm if length_mm else None
    return report


def _describe_stroke(stroke: Any, spacing: tuple[float, float] | None) -> dict[str, Any]:
    points = stroke.points_px
    length_mm = None
    if spacing is not None:
        ring = np.vstack([points, points[:1]]) if stroke.closed else points
        length_mm = float(np.linalg.norm(np.diff(ring, axis=0) * spacing, axis=1).sum())
    return {
        "length_px": float(stroke.length_px),
        "length_mm": length_mm,
        "closed": bool(stroke.closed),
        "points": len(points),
        "ends_px": stroke.ends_px,
        "bridged_points": int(np.count_nonzero(stroke.bridged)),
    }


def _provenance(inputs: dict[str, str], settings: Any) -> Provenance:
    """Provenance now; SOURCE_DATE_EPOCH, when set, is the time (reproducible-builds.org)."""
    from vfplan import __version__

    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    now = int(epoch) if epoch else int(time.time())
    stamp = datetime.datetime.fromtimestamp(now, datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    flat = {k: _plain(v) for k, v in asdict(settings).items() if v is not None}
    return Provenance(stamp, f"vfplan {__version__}", inputs, flat)


def _plain(value: Any) -> str | float | int | bool:
    return ",".join(map(str, value)) if isinstance(value, (tuple, list)) else value
