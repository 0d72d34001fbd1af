"""`vfplan rectify`: a photograph taken at an angle, made flat by its markers."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from typing import Any

import click
from vfplan.cli import options
from vfplan.cli.options import FILE, PNG, options_in_order, output_option, setting_options
from vfplan.cli.outputs import outputs, refuse_outputs
from vfplan.cli.run import CommandResult, announce_if_slow, command

from vfplan.display import command_of, millimetres, quoted, wrote
from vfplan.findings import doubt
from vfplan.io.writing import write_whole
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.settings import settings_from_options


@command("rectify")
@click.argument("image", type=FILE)
@click.argument("markers", type=FILE)
@click.argument("markers2", type=FILE, required=False)
@options_in_order(
    output_option("Write the flat picture to this file, and its markers beside it.", kind=PNG),
    setting_options(FixtureSettings, "find_markers max_residual_m common"),
    setting_options(ExtractSettings, "frame pixels max_megapixels"),
)  # fmt: skip
def vfplan_rectify(image, markers, markers2, output, **arguments) -> CommandResult:
    """Make IMAGE, a photograph of a planned sheet taken at an angle, flat by its MARKERS.

    MARKERS are as for `vfplan plan`, at least five. Next to OUT.png stands OUT_markers.csv with
    their places in the flat picture.
    """
    import cv2

    from vfplan.images.raster import with_made_flat
    from vfplan.images.read import MAX_MEGAPIXELS, flat_findings, made_flat
    from vfplan.markers.correspondences import read_markers
    from vfplan.planning.extraction import UNTURNED, read_slice
    from vfplan.planning.match import find_drawn
    from vfplan.registration.rectify import flattening

    markers_path = output.with_name(f"{output.stem}_markers.csv")
    refuse_outputs(output, markers_path)
    reading = settings_from_options(ExtractSettings, arguments)
    settings = FixtureSettings(**options.given_settings(FixtureSettings, arguments))
    with announce_if_slow(f"making {image.name} flat"):
        photograph = read_slice(image, reading)
        pairs = read_markers(markers, markers2, common=settings.common)
        if settings.find_markers:
            found = find_drawn(pairs, photograph)
            pairs = replace(pairs, source=[marker.position_px for marker in found])
        flat = flattening(
            pairs, photograph, settings.max_residual_m, reading.max_megapixels or MAX_MEGAPIXELS
        )
        picture = made_flat(photograph, flat.numbers)
    findings = [*photograph.findings, *pairs.findings, *flat_findings(flat.told)]
    if photograph.orientation != 1 and reading.pixels is None:
        findings.append(doubt("pixels-unturned", "register", f"{markers}: {UNTURNED}"))
    is_encoded, data = cv2.imencode(".png", picture.rgb[..., ::-1])
    assert is_encoded
    places = flat.places(pairs.source).round(4).tolist()
    with outputs(output, markers_path) as (path, table):
        write_whole(path, [with_made_flat(data.tobytes(), flat.told)], overwrite=False)
        write_whole(table, [marker_table(pairs, places).encode()], overwrite=False)
    rows = [
        {"label": label, "u_px": place[0], "v_px": place[1], "residual_m": residual}
        for label, place, residual in zip(pairs.labels, places, flat.residuals_m, strict=True)
    ]
    files = [output, markers_path]
    if pairs.target_frame != "robot_base":
        files.append(markers2)
    spacing = f"{flat.pixel_spacing_mm:g}"
    following = command_of("plan", *files, "--pixel-spacing", spacing)
    return CommandResult(
        {"output": str(output), "markers_output": str(markers_path),
         "homography": flat.homography, "residual_rms_m": flat.residual_rms_m,
         "marker_error_m": flat.error_m, "pixel_spacing_mm": flat.pixel_spacing_mm,
         "width_px": flat.width_px, "height_px": flat.height_px, "markers": rows},
        f"{len(rows)} markers fit a homography to {millimetres(flat.residual_rms_m)} rms; a marker "
        f"is off by {millimetres(flat.error_m)}\n{flat.width_px} x {flat.height_px} px of "
        f"{spacing} mm\n{wrote(output)} and {quoted(markers_path)}",
        findings=findings, verdict="made flat", next_step=following,
    )  # fmt: skip


def marker_table(pairs: Any, places: list[list[float]]) -> str:
    """A CSV of the markers on the flat picture, with the positions in front of the robot."""
    header = ["label", "u_px", "v_px"]
    rows = [[label, *place] for label, place in zip(pairs.labels, places, strict=True)]
    if pairs.target_frame == "robot_base":
        header += ["x_m", "y_m", "z_m"]
        rows = [[*row, *target] for row, target in zip(rows, pairs.target.tolist(), strict=True)]
        if pairs.sigma is not None:
            sigma = pairs.sigma.reshape(len(rows), -1).tolist()
            header += ["sigma_m"] if len(sigma[0]) == 1 else ["sigma_x_m", "sigma_y_m", "sigma_z_m"]
            rows = [[*row, *values] for row, values in zip(rows, sigma, strict=True)]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()
