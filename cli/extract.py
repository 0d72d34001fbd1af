"""`vfplan extract`: the curve drawn on a slice, in sub-pixel points."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from vfplan.cli.options import CURVE, option, output, settings, taking
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command, patience
from vfplan.cli.values import FILE, Number

from vfplan.errors import CheckFailed, CurveError, MarkerError, SettingError

# Codes of refusals that a person can mend on the review page.
MENDED_ON_PAGE = {
    *("several-candidates", "line-forks", "double-line", "runs-side-by-side", "bridge-too-long"),
    *("fit-left-ink", "too-little-ink", "no-line", "only-a-frame", "too-many-pieces"),
    *("labels-mistaken", "residual-large", "tre-large", "markers-meet-no-marks", "no-mark-near"),
}


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

    Where the curve would have to be guessed, the command says why and what to do, and writes
    nothing but the picture of --overlay-out, which shows the place (exit 3).
    """
    from vfplan.bundle import write_fixture
    from vfplan.planning import ExtractSettings, extract

    how = settings(ExtractSettings, given)
    page = review_command(image, output=output)
    with (
        patience(f"extracting the curve of {image.name}"),
        naming_page(page),
        pictured(image, how, overlay_out),
    ):
        extracted = extract(image, how, curve=given["curve"])
    with outputs(output, mask_out, overlay_out) as (path, mask, overlay):
        write_fixture(extracted.fixture, path)
        write_pictures(extracted, mask, overlay)
    text = f"{extracted_text(extracted.report)}\nwrote {output}"
    return Report(extracted.report, text, findings=extracted.findings)


@contextmanager
def pictured(image: Path, settings: Any, overlay: Path | None) -> Iterator[None]:
    """Write the overlay also where the curve is refused: its place, the lines to choose from."""
    try:
        yield
    except CurveError as error:
        if overlay is not None:
            from vfplan.figures.slice import draw_refusal
            from vfplan.images.read import MAX_MEGAPIXELS, read_image

            planned = read_image(
                image, frame=settings.frame, pixel_spacing_mm=settings.pixel_spacing_mm,
                imager_spacing=bool(settings.imager_spacing),
                max_megapixels=settings.max_megapixels or MAX_MEGAPIXELS,
            )  # fmt: skip
            draw_refusal(planned, error, overlay)
            error.message += f" {overlay} shows it."
        raise


@contextmanager
def naming_page(page: str) -> Iterator[None]:
    """Name the command that opens the review page where a person can mend what is refused."""
    try:
        yield
    except (CurveError, MarkerError, CheckFailed) as error:
        if "vfplan review IMAGE" in error.message:
            message = error.message.removesuffix("vfplan review IMAGE.")
            if message != error.message:  # no full stop that would be copied with the command
                message += page
            error.message = message.replace("vfplan review IMAGE", page)
        elif error.code in MENDED_ON_PAGE:
            sentence = error.message.rstrip(".")
            error.message = f"{sentence}. To mend it on a page: {page}"
        raise


def review_command(*files: Path | None, output: Path) -> str:
    """The command that opens the review page of a slice and its markers."""
    given = [str(file) for file in files if file is not None]
    return shlex.join(["vfplan", "review", *given, "-o", str(output)])


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
    if report.get("account"):
        lines.append(f"  {account_text(report['account'])}")
    return "\n".join(lines)


def account_text(account: list[dict[str, Any]]) -> str:
    """All other ink and the stretches that do not show, in one line."""
    parts = []
    ink = [entry for entry in account if entry["what"] == "ink"]
    if ink:
        share = sum(entry["share"] for entry in ink)
        largest = ink[0]
        pieces = "1 piece" if len(ink) == 1 else f"{len(ink)} pieces"
        parts.append(
            f"other ink: {pieces}, {share:.1%} of the pen's pixels, the largest at "
            f"({largest['u']:.0f}, {largest['v']:.0f})"
        )
    hidden = [entry for entry in account if entry["what"] != "ink"]
    if hidden:
        places = ", ".join(f"({entry['u']:.0f}, {entry['v']:.0f})" for entry in hidden[:4])
        parts.append(f"gaps or covers over the curve: {len(hidden)}, at {places}")
    return "; ".join(parts)
