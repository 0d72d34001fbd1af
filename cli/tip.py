"""`vfplan tip`: where a tool's tip is, from poses about one point."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from vfplan.cli.options import FILE, MM, OutputFile, option, options_in_order, output_option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command

from vfplan.display import count, millimetres
from vfplan.errors import InputError
from vfplan.geometry import UNIT_ROUNDED
from vfplan.io.files import OpenedFile, open_number_table, to_json_types
from vfplan.io.writing import write_whole

if TYPE_CHECKING:
    import numpy as np


@command("tip")
@click.argument("poses", type=FILE, metavar="POSES.csv")
@options_in_order(
    option("--units", type=click.Choice(["m", "mm"]), default="m", help="Unit of the places."),
    option("--row-major", is_flag=True, help="Read 16 numbers row by row."),
    option("--max-error", "max_error_m", type=MM, default="2",
           help="Refuse a tip whose 95 % error is larger [mm]: a wrong unit or order shows so."),
    option("--tool", default="tool", metavar="NAME",
           help="Name of the tool, which a controller can demand."),
    output_option("Write tool and tip to this file, for `plan --tip`.", required=False,
                  kind=OutputFile(".json")),
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
    tip = calibrate_tip(matrices, max_error_m)
    worst = int(tip.residuals_m.argmax())
    place, pivot = (",".join(f"{x:.6f}" for x in point) for point in (tip.offset_m, tip.pivot_m))
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
        text += f"\nwrote {output}"
        recorded = f" --tip {shlex.quote(str(output))}"
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
        is_bare = columns[0] == "column 1"
        if len(columns) != 16 and not (is_bare and len(columns) == 7):
            message = (
                f"has {count(len(columns), 'column')}: {', '.join(columns)[:70]}. Give "
                f"{','.join(named)}, or 16 numbers of a matrix"
            )
            raise InputError(message, where=str(path), code="pose-columns")
    rows = np.concatenate([np.zeros((0, len(columns))), *table.blocks(columns)])
    if len(columns) == 7:
        length = np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
        is_pose = np.abs(length[:, 0] - 1) < UNIT_ROUNDED
        rows[:, 3:] /= np.where(length > 0, length, 1)
        poses = matrices(rows)
    else:
        poses = rows.reshape(-1, 4, 4) if row_major else rows.reshape(-1, 4, 4).transpose(0, 2, 1)
        R = poses[:, :3, :3]
        products = R.transpose(0, 2, 1) @ R - np.eye(3)
        is_pose = np.abs(products).max(axis=(1, 2)) < 2 * UNIT_ROUNDED
        is_pose &= (np.linalg.det(R) > 0) & (np.abs(poses[:, 3] - [0, 0, 0, 1]).max(axis=1) < 1e-6)
    is_pose &= np.isfinite(rows).all(axis=1)
    if not is_pose.all():
        i = int(np.argmin(is_pose))
        message = (
            f"pose {i + 1} is {rows[i].tolist()}, and no unit quaternion or rotation follows the "
            "order that is read. Give w before x, y, z, and a matrix column by column, or "
            "--row-major"
        )
        raise InputError(message, where=str(path), code="pose-invalid", numbers={"pose": i + 1})
    poses[:, :3, 3] *= unit_factor(units)
    return poses
