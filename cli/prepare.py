"""What is made before a plan: `vfplan rectify`, a photograph made flat, and `vfplan tip`."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from vfplan.cli import options
from vfplan.cli.next_commands import file_beside, flat_markers, plan_flat_command
from vfplan.cli.options import FILE, option, options_in_order, output_option, setting_options
from vfplan.cli.outputs import outputs, refuse_outputs
from vfplan.cli.run import CommandResult, announce_if_slow, command

from vfplan.display import coordinates, count, millimetres, quoted, wrote
from vfplan.errors import InputError
from vfplan.findings import doubt
from vfplan.geometry import UNIT_ROUNDED
from vfplan.io.files import OpenedFile, naming_place, open_number_table, to_json_types
from vfplan.io.writing import write_whole
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.settings import settings_from_options

if TYPE_CHECKING:
    import numpy as np


@command("rectify", settings_file=True)
@click.argument("image", type=FILE)
@options.MARKERS
@options_in_order(
    output_option("Write the flat picture to this file, and its markers beside it.",
                  kind=options.PNG),
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
    from vfplan.registration.rectify import flattening, projected

    markers_path = flat_markers(output)
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
    places = projected(flat.homography, pairs.source).round(4).tolist()
    with outputs(output, markers_path) as (path, table):
        write_whole(path, [with_made_flat(data.tobytes(), flat.told)], overwrite=False)
        write_whole(table, [marker_table(pairs, places).encode()], overwrite=False)
    rows = [
        {"label": label, "u_px": place[0], "v_px": place[1], "residual_m": residual}
        for label, place, residual in zip(pairs.labels, places, flat.residuals_m, strict=True)
    ]
    next_step = plan_flat_command(output, pairs, markers2, output=file_beside(output, "plan"))
    return CommandResult(
        {"output": str(output), "markers_output": str(markers_path),
         "homography": flat.homography, "residual_rms_m": flat.residual_rms_m,
         "marker_error_m": flat.error_m, "pixel_spacing_mm": flat.pixel_spacing_mm,
         "width_px": flat.width_px, "height_px": flat.height_px, "markers": rows},
        f"{len(rows)} markers fit a homography to {millimetres(flat.residual_rms_m)} rms; a marker "
        f"is off by {millimetres(flat.error_m)}\n{flat.width_px} x {flat.height_px} px of "
        f"{flat.pixel_spacing_mm:g} mm\n{wrote(output)} and {quoted(markers_path)}",
        findings=findings, verdict="made flat", next_step=next_step,
    )  # fmt: skip


def marker_table(pairs: Any, places: list[list[float]]) -> str:
    """A CSV of the markers on the flat picture, with the positions in front of the robot."""
    header, columns = ["label", "u_px", "v_px"], [pairs.labels, *zip(*places, strict=True)]
    if pairs.target_frame == "robot_base":
        header += ["x_m", "y_m", "z_m"]
        columns += pairs.target.T.tolist()
        if pairs.sigma is not None:
            sigma = pairs.sigma.reshape(len(places), -1).T.tolist()
            header += ["sigma_m"] if len(sigma) == 1 else ["sigma_x_m", "sigma_y_m", "sigma_z_m"]
            columns += sigma
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *zip(*columns, strict=True)])
    return text.getvalue()


@command("tip")
@click.argument("poses", type=FILE, metavar="POSES.csv")
@options_in_order(
    option("--units", type=options.UNIT, default="m", help="Unit of the places."),
    option("--row-major", is_flag=True, help="Read 16 numbers row by row."),
    option("--max-error", "max_error_m", type=options.MM, default="2",
           help="Refuse a tip whose 95 % error is larger [mm]; a wrong unit or order makes it so."),
    option("--tool", default="tool", metavar="NAME",
           help="Name of the tool, which a controller can demand."),
    output_option("Write tool and tip to this file, for `plan --tip`.", required=False,
                  kind=options.OutputFile(".json")),
)  # fmt: skip
def vfplan_tip(poses, output, tool, units, row_major, max_error_m) -> Any:
    """Find a tool's tip from poses in which the tip stays on one point.

    A row of POSES.csv is x,y,z,qw,qx,qy,qz, also with t before it and a header, or 16 numbers of a
    4 x 4 matrix column by column, as Franka's O_T_EE. Give six poses or more that tilt the tool to
    all sides, each once: the error takes them for independent.
    """
    from vfplan.registration.tip import calibrate_tip

    if not tool or not tool.isprintable():
        raise click.UsageError("--tool is empty, or holds signs that cannot be seen")
    matrices = read_tool_poses(poses, units, row_major)
    with naming_place(poses):
        tip = calibrate_tip(matrices, max_error_m)
    worst = int(tip.residuals_m.argmax())
    place, pivot = (coordinates(point, 6, ",") for point in (tip.offset_m, tip.pivot_m))
    error_mm = 1e3 * tip.error95_m
    text = (
        f"{count(len(matrices), 'pose')}, turned by {tip.turn_deg:.1f}° or more about two axes\n"
        f"tip: {place} m in the tool's frame, to {millimetres(tip.error95_m)} (95 %)\n"
        f"pivot: {pivot} m\n"
        f"residual: {millimetres(tip.residual_rms_m)} rms, "
        f"{millimetres(tip.residuals_m[worst])} at most, in pose {worst + 1}"
    )
    data = {
        "tool": tool, "poses": len(matrices), "tip_m": tip.offset_m, "error95_m": tip.error95_m,
        "pivot_m": tip.pivot_m, "residual_rms_m": tip.residual_rms_m,
        "residual_max_m": tip.residuals_m[worst], "worst_pose": worst + 1,
        "turn_deg": tip.turn_deg,
    }  # fmt: skip
    with outputs(output) as (path,):
        if path is not None:
            write_whole(path, [json.dumps(to_json_types(data)).encode()], overwrite=False)
    recorded = ""
    if output is not None:
        text += f"\n{wrote(output)}"
        recorded = f" --tip {quoted(output)}"
    return CommandResult(
        data, text, verdict=f"the tip is known to {error_mm:.3f} mm",
        next_step="count this error too, where the tool touches the markers: "
        f"vfplan plan IMAGE MARKERS --margin tre95+{error_mm:.3f}{recorded}",
    )  # fmt: skip


def read_tool_poses(path: Path, units: str, row_major: bool) -> np.ndarray:
    """(n, 4, 4) the poses of a table [m].

    Raises InputError: other columns, or a row that is no pose
    """
    import numpy as np

    from vfplan.engine.moving import matrices
    from vfplan.session.events import POSE_COLUMNS
    from vfplan.session.session import unit_factor

    table = open_number_table(OpenedFile(path).view, str(path), InputError, header_optional=True)
    columns = named = POSE_COLUMNS[1:]
    if not set(named) <= set(table.columns):
        # Without these names a pose is 7 bare numbers, or 16 of a matrix.
        columns = table.columns
        if len(columns) != 16 and not (columns[0] == "column 1" and len(columns) == 7):
            message = (
                f"has {count(len(columns), 'column')}: {', '.join(columns)[:70]}. Give "
                f"{','.join(named)}, or 16 numbers of a matrix"
            )
            raise InputError(message, where=path, code="pose-columns")
    rows = np.concatenate([np.zeros((0, len(columns))), *table.blocks(columns)])
    is_pose = np.isfinite(rows).all(axis=1)
    if len(columns) == 7:
        is_pose &= np.abs(np.linalg.norm(rows[:, 3:], axis=1) - 1) < UNIT_ROUNDED
    else:
        poses = rows.reshape(-1, 4, 4).transpose((0, 1, 2) if row_major else (0, 2, 1))
        R = poses[:, :3, :3]
        products = R.transpose(0, 2, 1) @ R - np.eye(3)
        is_pose &= np.abs(products).max(axis=(1, 2)) < 2 * UNIT_ROUNDED
        is_pose &= (np.linalg.det(R) > 0) & (np.abs(poses[:, 3] - [0, 0, 0, 1]).max(axis=1) < 1e-6)
    if not is_pose.all():
        i = int(np.argmin(is_pose))
        message = (
            f"pose {i + 1} is {rows[i].tolist()}, and no unit quaternion or rotation follows the "
            "order that is read. Give w before x, y, z, and a matrix column by column, or "
            "--row-major"
        )
        raise InputError(message, where=path, code="pose-invalid", numbers={"pose": i + 1})
    if len(columns) == 7:
        poses = matrices(rows)
    poses[:, :3, 3] *= unit_factor(units)
    return poses
