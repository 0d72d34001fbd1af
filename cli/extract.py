"""`vfplan extract`: the curve drawn on a slice, in sub-pixel points."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from vfplan.cli.options import CURVE, option, output, settings, taking
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command, patience
from vfplan.cli.values import FILE, Number

from vfplan.errors import CurveError, SettingError


@command(
    "extract",
    first_screen="-o --colour --stroke --roi --max-gap --start --end --curve --pixel-spacing "
    "--overlay-out --json",
    settings_file=True,
)
@click.argument("image", type=FILE)
@taking(
    output("The curve to write: a bundle in the frame of the image."),
    CURVE,
    option("--density", "density_per_mm", type=Number("PTS_PER_MM"),
           help="Points a millimetre; needs a pixel spacing.  [default: one a pixel]"),
)  # fmt: skip
def command(image, output, mask_out, overlay_out, **given) -> Report:
    """Extract the curve drawn on IMAGE to sub-pixel points.

    IMAGE is a PNG, JPEG, TIFF, BMP or DICOM file; or, alone, a vector curve: a Slicer .mrk.json
    Curve or ClosedCurve or .fcsv, an ImageJ .roi, or a CSV u_px,v_px or X,Y.

    With several candidates and none chosen by --stroke, --roi or --colour, each is described,
    --overlay-out shows them with their numbers, and nothing else is written (exit 3).
    """
    from vfplan.bundle import write_fixture
    from vfplan.planning import ExtractSettings, extract

    how = settings(ExtractSettings, given)
    with patience(f"extracting the curve of {image.name}"), numbered(image, how, overlay_out):
        extracted = extract(image, how, curve=given["curve"])
    with outputs(output, mask_out, overlay_out) as (path, mask, overlay):
        write_fixture(extracted.fixture, path)
        write_pictures(extracted, mask, overlay)
    text = f"{extracted_text(extracted.report)}\nwrote {output}"
    return Report(extracted.report, text, findings=extracted.findings)


@contextmanager
def numbered(image: Path, settings: Any, overlay: Path | None) -> Iterator[None]:
    """Draw the candidates with their numbers when there are several and none was chosen."""
    try:
        yield
    except CurveError as error:
        if overlay is not None and error.candidates:
            from vfplan.figures.slice import draw_candidates
            from vfplan.images.read import MAX_MEGAPIXELS, read_image

            seen = read_image(
                image, frame=settings.frame, pixel_spacing_mm=settings.pixel_spacing_mm,
                imager_spacing=bool(settings.imager_spacing),
                max_megapixels=settings.max_megapixels or MAX_MEGAPIXELS,
            )  # fmt: skip
            draw_candidates(seen, error.candidates, overlay)
            error.message += f"; {overlay} shows them with their numbers"
        raise


def write_pictures(extracted: Any, mask: Path | None, overlay: Path | None) -> None:
    """Write the pictures that were asked for."""
    if mask is None and overlay is None:
        return
    from vfplan.figures.slice import draw_mask, draw_overlay

    if extracted.image is None or extracted.extraction is None:
        raise SettingError("a vector curve given alone has no image to draw it on")
    if mask is not None:
        if extracted.extraction.method == "vector":
            raise SettingError("a vector curve has no mask; leave --mask-out out")
        draw_mask(extracted.extraction, mask)
    if overlay is not None:
        draw_overlay(extracted.image, extracted.extraction, overlay, findings=extracted.findings)


def extracted_text(report: dict[str, Any]) -> str:
    """The extraction on a few lines."""
    lines = []
    if "image" in report:
        size = "{width_px} x {height_px} px".format(**report["image"])
        pen = f", {report['mask_pixels']} in the pen" if "mask_pixels" in report else ""
        lines.append(size + pen)
    for stroke in report["strokes"]:
        shape = "closed" if stroke["closed"] else "open"
        px, mm = stroke.get("length_px"), stroke.get("length_mm")
        lengths = [f"{px:.1f} px" if px is not None else "", f"{mm:.1f} mm" if mm else ""]
        line = f"  {shape} curve, {' = '.join(filter(None, lengths))}, {stroke['points']} points"
        if stroke.get("bridged_points"):
            line += f", {stroke['bridged_points']} of them bridged"
        lines.append(line)
    if rest := report.get("ink", {}).get("taken_for"):
        ink = report["ink"]
        others = ", ".join(f"{kind} {n / ink['pixels']:.1%}" for kind, n in rest.items())
        lines.append(f"  {ink['explained']:.1%} of the pen's pixels are the curve's; {others}")
    for mark in report.get("set_aside", ()):
        u, v, width, height = mark["box"]
        way = f" (--stroke {mark['stroke']} takes it)" if "stroke" in mark else ""
        lines.append(f"  set aside: {mark['kind']}, {width} x {height} px at ({u}, {v}){way}")
    return "\n".join(lines)
