"""`vfplan extract`: the curve drawn on a slice, in sub-pixel points."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from vfplan.cli import options
from vfplan.cli.next_commands import page_command, rectify_command, register_command
from vfplan.cli.options import FILE, options_in_order, output_option, setting_options
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, announce_if_slow, command

from vfplan.display import Report, wrote
from vfplan.errors import CheckFailed, CurveError, MarkerError, SettingError
from vfplan.planning.settings import ExtractSettings
from vfplan.settings import settings_from_options

# Codes of refusals that a person can mend on the review page.
MENDED_ON_PAGE = {
    *("several-candidates", "line-forks", "double-line", "runs-side-by-side", "bridge-too-long"),
    *("fit-left-ink", "too-little-ink", "no-line", "only-a-frame", "too-many-pieces"),
    *("image-grey", "place-off-curve", "start-is-end", "end-of-a-ring", "stroke-number"),
    *("labels-mistaken", "residual-large", "tre-large", "markers-meet-no-marks", "no-mark-near"),
    *("one-mark-two-markers", "mirrored", "scale-wrong", "one-side-only"),
    *("too-few-markers", "markers-coincide", "markers-collinear", "markers-coplanar"),
}

# Options, typed or from a file, that the page would refuse as the command did: it opens without.
ENDS = ("--start", "--end", "--settings")
REFUSED_WITH = {"stroke-number": ("--stroke", "--settings"), "place-off-curve": ENDS,
                "start-is-end": ENDS, "end-of-a-ring": ENDS}  # fmt: skip


@command(
    "extract",
    first_screen="-o --colour --stroke --roi --max-gap --start --end --curve --pixel-spacing "
    "--overlay-out --json",
    settings_file=True,
)
@click.argument("image", type=FILE)
@options_in_order(
    output_option("Write the curve to this bundle, in the frame of the image."),
    options.EXTRACT_OPTIONS,
    setting_options(ExtractSettings, "density_per_mm"),
)  # fmt: skip
def vfplan_extract(image, output, mask_out, overlay_out, **arguments) -> CommandResult:
    """Measure the curve that is drawn on IMAGE.

    IMAGE is a PNG, JPEG, TIFF, BMP or DICOM file. It may also be a curve drawn as vectors: a
    Slicer .mrk.json or .fcsv, an ImageJ .roi, or a CSV with u_px,v_px or X,Y.

    If the command would have to guess the curve, it says why and what to do (exit 3). It then
    writes nothing but the picture of --overlay-out, which shows the place.
    """
    from vfplan.bundle.write import write_fixture
    from vfplan.planning.extraction import extract

    settings = settings_from_options(ExtractSettings, arguments)
    with (
        announce_if_slow(f"extracting the curve of {image.name}"),
        pointing_to_page(image, output=output),
        drawing_refusal(image, settings, overlay_out),
    ):
        extracted = extract(image, settings, curve=arguments["curve"])
    with outputs(output, mask_out, overlay_out) as (path, mask, overlay):
        write_fixture(extracted.fixture, path)
        write_pictures(extracted, mask, overlay)
    return CommandResult(
        extracted.report, f"{extracted_text(extracted.report)}\n{wrote(output)}",
        findings=extracted.findings, verdict=findings_verdict("extracted", extracted.fixture),
        next_step=register_command(output, image if extracted.image is not None else None),
    )  # fmt: skip


def findings_verdict(done: str, fixture: Any) -> str:
    """How a command ended: what it did, and how many findings want an answer."""
    open_count = len(fixture.open_findings)
    few = {0: "no finding wants", 1: "1 finding wants"}
    return f"{done}; {few.get(open_count, f'{open_count} findings want')} an answer"


@contextmanager
def drawing_refusal(image: Path, settings: Any, overlay: Path | None) -> Iterator[None]:
    """Write the overlay also where the curve is refused: the place, or the numbered candidates."""
    try:
        yield
    except CurveError as error:
        if overlay is not None:
            from vfplan.figures.slice import draw_refusal
            from vfplan.planning.extraction import read_slice

            draw_refusal(read_slice(image, settings), error, overlay)
            error.message = f"{error.message.rstrip('.')}. The picture {overlay} shows the place."
        raise


@contextmanager
def pointing_to_page(*files: Path | None, **options: Any) -> Iterator[None]:
    """Name the command that opens the review page where a person can mend a refusal there.

    files, options: as `page_command` takes them
    """
    try:
        yield
    except (CurveError, MarkerError, CheckFailed, SettingError) as error:
        from vfplan.registration.checks import TO_RECTIFY

        general = "vfplan review IMAGE"
        page = page_command(*files, **options, leaving_out=REFUSED_WITH.get(error.code, ()))
        if general in error.message:
            # The sentence with the command comes last, without a full stop that would be copied.
            sentences = re.split(r"(?<=\.) ", error.message)
            message = " ".join(sorted(sentences, key=lambda text: general in text))
            error.message = message.removesuffix(".").replace(general, page)
        elif TO_RECTIFY in error.message:
            ways = f"on a page ({page}) or with two commands: {rectify_command(*files, **options)}"
            error.message = error.message.replace(TO_RECTIFY, ways)
        elif error.code in MENDED_ON_PAGE or error.numbers.get("arcs_m"):
            # The page can leave out the lines and arcs that were asked for.
            error.message = f"{error.message.rstrip('.')}. To mend it on a page: {page}"
        raise


def write_pictures(extracted: Any, mask: Path | None, overlay: Path | None) -> None:
    """Write the mask and the overlay, where they are wanted."""
    if mask is None and overlay is None:
        return
    from vfplan.figures.slice import draw_mask, draw_overlay

    if extracted.image is None or extracted.extraction is None:
        raise SettingError(
            "a vector curve alone has no image to draw it on. Leave --mask-out and --overlay-out "
            "out",
            code="picture-without-image",
        )
    if mask is not None:
        if extracted.extraction.method == "vector":
            raise SettingError(
                "a vector curve has no mask. Leave --mask-out out", code="no-mask-of-a-vector"
            )
        draw_mask(extracted.extraction, mask)
    if overlay is not None:
        draw_overlay(extracted.image, extracted.extraction, overlay, findings=extracted.findings)


def extracted_text(report: Report) -> str:
    """The extraction on a few lines."""
    lines = []
    if "image" in report:
        line = "{width_px} x {height_px} px".format(**report["image"])
        if "mask_pixels" in report:
            line += f", {report['mask_pixels']} in the pen"
        lines.append(line)
    for stroke in report["strokes"]:
        shape = "closed" if stroke["closed"] else "open"
        lengths = " = ".join(
            f"{stroke[f'length_{unit}']:.1f} {unit}"
            for unit in ("px", "mm")
            if stroke.get(f"length_{unit}")
        )
        lines.append(f"  {shape} curve, {lengths}, {stroke['points']} points")
        if stroke.get("bridged_points"):
            lines[-1] += f", {stroke['bridged_points']} of them bridged"
    return "\n".join(lines)
