"""`vfplan plan`: from a planned slice and its markers to a fixture, in one step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from vfplan.cli.extract import extracted_text, write_pictures
from vfplan.cli.options import (
    FILE,
    ROBOT,
    curve_options,
    extract_settings,
    fixture_options,
    fixture_settings,
    output,
)
from vfplan.cli.register import registered_text, write_registration_picture
from vfplan.cli.run import Report, command, outputs, patience, refuse_existing


@command("plan", short_help="A planned slice and its markers in, a fixture out.")
@click.argument("image", type=FILE)
@click.argument("markers", type=FILE)
@click.argument("markers2", type=FILE, required=False)
@output("The fixture bundle to write.")
@curve_options
@fixture_options
@ROBOT
def command(
    image: Path,
    markers: Path,
    markers2: Path | None,
    output: Path,
    overwrite: bool,
    robot: str | None,
    mask_out: Path | None,
    overlay_out: Path | None,
    picture_out: Path | None,
    **given: Any,
) -> Report:
    """Extract the curve drawn on IMAGE, register it by MARKERS and write a fixture bundle.

    MARKERS is one CSV (label,u_px,v_px,x_m,y_m,z_m), or two files joined by label: CSV, Slicer
    .mrk.json or .fcsv. With --robot the fixture's stiffness must be stable in closed loop with
    that robot (exit 1 if it is not), and the verdict is stored in the bundle.
    """
    from vfplan.bundle import write_fixture
    from vfplan.planning import plan
    from vfplan.robot import read_robot

    reading, making, arm = extract_settings(given), fixture_settings(given), read_robot(robot)
    refuse_existing(output, mask_out, overlay_out, picture_out, overwrite=overwrite)
    with patience(f"planning on {image.name}"):
        made = plan(
            image, markers, markers2, extraction=reading, settings=making, curve=given["curve"]
        )
    fixture, verdict = made.fixture, {}
    if arm is not None:
        from vfplan.stability import approved

        fixture = approved(made.fixture, arm)
        verdict = {"stability": fixture.stability.as_dict()}
    given_paths = (output, mask_out, overlay_out, picture_out)
    with outputs(*given_paths) as (path, mask, overlay, picture):
        write_fixture(fixture, path)
        write_pictures(made.extracted, mask, overlay)
        write_registration_picture(
            made.registered, made.extracted.fixture, made.extracted.image, picture
        )
    text = f"{extracted_text(made.extracted.report)}\n{registered_text(made.registered.report)}"
    if verdict:
        text += "\nstable up to {k_max_n_per_m:.0f} N/m with robot {robot}".format(
            **verdict["stability"]
        )
    return Report(made.report | verdict, f"{text}\nwrote {output}", warnings=list(made.warnings))
