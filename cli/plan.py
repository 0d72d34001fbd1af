"""`vfplan plan`: from a planned slice and its markers to a fixture, in one step."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from vfplan.cli import options
from vfplan.cli.extract import (
    extracted_text,
    naming_page,
    pictured,
    review_command,
    write_pictures,
)
from vfplan.cli.options import option
from vfplan.cli.outputs import outputs, refuse_beside
from vfplan.cli.register import registered_text, write_registration_picture
from vfplan.cli.run import Report, command, patience
from vfplan.cli.values import FILE

from vfplan.findings import Finding, doubt


@command(
    "plan",
    first_screen="-o --colour --stroke --roi --curve --pixel-spacing --model --find-markers "
    "--max-residual --max-tre --markers-as-given --common --seen-from --stiffness "
    "--contact-radius --margin --guide --json",
    settings_file=True,
)
@click.argument("image", type=FILE)
@click.argument("markers", type=FILE)
@click.argument("markers2", type=FILE, required=False)
@options.taking(
    options.output("The fixture bundle to write."),
    options.CURVE,
    options.MAKING,
    options.ROBOT,
    option("--rehearse", metavar="panda|fr3|FILE.xml",
           help="Let a simulated arm go along the curve first, on each side; write nothing (exit "
           "1) where it would not reach or would stop. Its limits: --robot's, or its own."),
    option("--base", **options.BASE,
           help="That arm's base in the fixture's frame [m].  [default: 0,0,0]"),
    option("--tool", **options.TOOL, help="That arm's tip in its flange's frame [m]."),
    option("--no-sheet", is_flag=True,
           help="Leave out the review sheet, which is written beside the bundle as "
           "STEM-sheet.png."),
)  # fmt: skip
def command(
    image, markers, markers2, output, mask_out, overlay_out, picture_out, no_sheet, **given
) -> Report:
    """Extract the curve drawn on IMAGE, register it by MARKERS and write a fixture bundle.

    MARKERS is one CSV (label,u_px,v_px,x_m,y_m,z_m), or two files joined by label: CSV, Slicer
    .mrk.json or .fcsv. With --robot the fixture's stiffness must be stable in closed loop with
    that robot (exit 1 if it is not), and the verdict is stored in the bundle. With --rehearse a
    simulated arm must be able to render it.

    Look at the review sheet that is written beside the bundle: it shows both ends of the line
    enlarged, and everything that was doubtful.
    """
    from vfplan.bundle import write_fixture
    from vfplan.planning import ExtractSettings, plan
    from vfplan.robot import read_robot

    sheet_path = None
    if not no_sheet:
        sheet_path = output.with_name(f"{output.stem}-sheet.png")
        refuse_beside(sheet_path)
    reading, making = options.settings(ExtractSettings, given), options.fixture_settings(given)
    robot = read_robot(given["robot"])
    page = review_command(image, markers, markers2, output=output)
    with (
        patience(f"planning on {image.name}"),
        naming_page(page),
        pictured(image, reading, overlay_out),
    ):
        made = plan(
            image, markers, markers2, extraction=reading, settings=making, curve=given["curve"]
        )
    fixture, verdict, findings = made.fixture, {}, list(made.findings)
    options.hold_campaign(given, fixture)
    if robot is not None:
        from vfplan.stability import approved

        fixture = approved(made.fixture, robot)
        verdict = {"stability": fixture.stability.as_dict()}
        findings += strong_pull(fixture, robot)
    if given["rehearse"] is not None:
        verdict |= {"rehearsal": rehearsed(fixture, robot, given)}
    made = replace(made, fixture=replace(fixture, findings=tuple(findings)))
    with outputs(output, mask_out, overlay_out, picture_out, sheet_path) as (
        path, mask, overlay, picture, sheet,
    ):  # fmt: skip
        write_fixture(made.fixture, path)
        if sheet is not None:
            digest = write_review_sheet(made, output.name, sheet)
            verdict |= {"sheet": str(sheet_path), "digest": digest}
        write_pictures(made.extracted, mask, overlay)
        write_registration_picture(
            made.registered, made.extracted.fixture, made.extracted.image, picture
        )
    text = f"{extracted_text(made.extracted.report)}\n{registered_text(made.registered.report)}"
    if "rehearsal" in verdict:
        from vfplan.arm.command import rehearsed_text

        text += "".join(f"\n{rehearsed_text(found)}" for found in verdict["rehearsal"])
    if "stability" in verdict:
        text += "\nstable up to {k_max_n_per_m:.0f} N/m with robot {robot}".format(
            **verdict["stability"]
        )
    text += f"\nwrote {output}"
    ending = "planned; no finding wants an answer"
    if made.fixture.open_findings:
        ending = f"planned; {len(made.fixture.open_findings)} findings want an answer"
    approved_path = output.with_name(f"{output.stem}-approved.h5")
    next_step = f"vfplan review {output} --slice {image} -o {approved_path}"
    if sheet_path is not None:
        text += f" and {sheet_path}, its review sheet"
        next_step = f"look at {sheet_path}, then {next_step}"
    return Report(
        made.report | verdict, text, findings=findings, verdict=ending, next_step=next_step
    )


def write_review_sheet(made: Any, title: str, path: Path) -> str:
    """Write the sheet that shows a plan to a person; returns its digest."""
    from vfplan.review.sheet import write_sheet
    from vfplan.review.sheet_input import of_plan

    shown = of_plan(made, title)
    write_sheet(shown, path)
    return shown.digest


def strong_pull(fixture: Any, robot: Any) -> list[Finding]:
    """That the robot cannot pull along the guide as it is asked to."""
    pull = fixture.guidance and fixture.guidance.lead_force
    limit = robot.force_limit_n
    if not pull or limit is None or abs(pull) <= limit:
        return []
    text = (
        f"The guide pulls with {abs(pull):g} N, but robot {robot.name!r} is limited to "
        f"{limit:g} N. Its governor holds the rest back, also of the tube's force."
    )
    return [doubt("guide-pull-strong", "plan", text)]


def rehearsed(fixture: Any, robot: Any, given: dict[str, Any]) -> list[dict[str, Any]]:
    """What a simulated arm says along each side of the curve; `CheckFailed` where it says no."""
    from vfplan.arm import Arm, rehearse
    from vfplan.arm.command import objections
    from vfplan.errors import CheckFailed
    from vfplan.replaying.approach import approach_sessions

    arm, said = Arm(given["rehearse"], robot, base=given["base"], tool=given["tool"]), []
    for way in approach_sessions(fixture, arm.robot.rate_hz):
        with patience(f"rehearsing {way.name}"):
            found = rehearse(fixture, way, arm)
        if not found.passed:
            why = objections(found.metrics)[0]
            raise CheckFailed(f"arm {arm.name}, {way.name}: {why}; nothing is written")
        said.append({"way": way.name, **found.metrics})
    return said
