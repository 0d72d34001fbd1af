"""`vfplan plan`: from a planned slice and its markers to a fixture, in one step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from vfplan.cli import options
from vfplan.cli.extract import (
    drawing_refusal,
    extracted_text,
    findings_verdict,
    pointing_to_page,
    write_pictures,
)
from vfplan.cli.next_commands import accept_command, page_shows, review_command
from vfplan.cli.options import FILE, option, options_in_order, output_option
from vfplan.cli.outputs import outputs, refuse_outputs
from vfplan.cli.register import registered_text, write_registration_picture
from vfplan.cli.run import CommandResult, announce_if_slow, command

from vfplan.display import MM, Report, quoted, wrote
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.settings import Arguments, settings_from_options


@command(
    "plan",
    first_screen="-o --colour --stroke --roi --curve --pixel-spacing --model --find-markers "
    "--max-residual --max-tre --markers-as-given --common --seen-from --stiffness "
    "--contact-radius --margin --guide --json",
    settings_file=True,
)
@click.argument("image", type=FILE)
@options.MARKERS
@options_in_order(
    output_option("Write the fixture to this bundle.  [default: IMAGE's name with .h5, in the "
                  "working folder]", required=False),
    options.EXTRACT_OPTIONS,
    options.FIXTURE_OPTIONS,
    options.TIP,
    options.ROBOT,
    option("--rehearse", metavar="panda|fr3|FILE.xml",
           help="Move a simulated arm along each side of the curve first. Write nothing if it does "
           "not reach or would stop (exit 1)."),
    option("--base", **options.ARM_BASE,
           help="Base of that arm in the fixture's frame [m].  [default: 0,0,0]"),
    option("--tool", **options.ARM_TOOL, help="Tip of that arm in its flange's frame [m]."),
    option("--case", metavar="CASE",
           help="Case that the plan is for, which must not name a patient. It is signed for no "
           "other."),
    option("--no-sheet", is_flag=True,
           help="Write no review sheet beside the bundle."),
)  # fmt: skip
def vfplan_plan(
    image, markers, markers2, output, mask_out, overlay_out, picture_out, no_sheet, **arguments
) -> CommandResult:
    """Turn the curve drawn on IMAGE into a fixture for the robot, by MARKERS.

    MARKERS is one CSV (label,u_px,v_px,x_m,y_m,z_m), or two files joined by label: CSV, Slicer
    .mrk.json or .fcsv. Afterwards look at the review sheet beside the bundle. It shows both ends
    of the line enlarged, and all findings.
    """
    from vfplan.bundle.seal import check_texts
    from vfplan.bundle.write import write_fixture
    from vfplan.planning.plan import plan
    from vfplan.robot import read_robot

    # The files that have no option of their own are checked before any work, as the others were.
    if output is None:
        output = Path(f"{image.stem}.h5")
    sheet_path = None if no_sheet else output.with_name(f"{output.stem}-sheet.png")
    refuse_outputs(output, sheet_path)

    if arguments["rehearse"] is None:
        options.refuse_unused("without --rehearse ARM", "base", "tool")

    # From the slice to a fixture.
    extraction = settings_from_options(ExtractSettings, arguments)
    settings = FixtureSettings(**options.given_of_plan(arguments))
    robot = read_robot(arguments["robot"])
    check_texts(arguments["case"] or "")
    with (
        announce_if_slow(f"planning on {image.name}"),
        pointing_to_page(image, markers, markers2, output=output),
        drawing_refusal(image, extraction, overlay_out),
    ):
        planned = plan(
            image, markers, markers2, extraction=extraction, settings=settings,
            curve=arguments["curve"], tip=arguments["tip"],
        )  # fmt: skip
    fixture = replace(planned.fixture, case=arguments["case"])
    data = dict(planned.report)
    drawn = planned.extracted.report
    if fixture.curve is not None and extraction.method == "ridge":
        # As long as the sheet says, in front of the robot; pixels of a skeleton go in stairs.
        pairs = zip(drawn["strokes"], fixture.strokes, strict=True)
        rows = [row | {"length_mm": MM * stroke.length} for row, stroke in pairs]
        drawn = drawn | {"strokes": rows}
    lines = [extracted_text(drawn), registered_text(planned.registered.report)]
    options.check_campaign_matches(arguments, fixture)

    # Robot and arm have a say before anything is written.
    if robot is not None:
        from vfplan.stability.study import with_verdict

        fixture = with_verdict(fixture, robot)
        data["stability"] = fixture.stability.as_dict()
        largest = f"{fixture.stability.k_max_n_per_m:.0f} N/m"
        lines.append(f"stable up to {largest} with robot {robot.name}, on this curve alone")
    if arguments["rehearse"] is not None:
        from vfplan.arm.command import rehearsed_text

        data["rehearsal"] = [*rehearse_approaches(fixture, robot, arguments)]
        lines += map(rehearsed_text, data["rehearsal"])

    # The bundle and its sheet.
    paths = (output, mask_out, overlay_out, picture_out, sheet_path)
    with outputs(*paths) as (path, mask, overlay, picture, sheet):
        write_fixture(fixture, path)
        if sheet is not None:
            from vfplan.review.plan import Plan
            from vfplan.review.sheet import write_sheet

            shown = Plan.of(fixture, output.name, planned.extracted.image)
            write_sheet(shown, sheet)
            data |= {"sheet": str(sheet_path), "digest": shown.digest}
        write_pictures(planned.extracted, mask, overlay)
        write_registration_picture(
            planned.registered, planned.extracted.fixture, planned.extracted.image, picture
        )
    data["output"] = str(output)

    # The last lines: how it ended, and what to do.
    slice_path = image if planned.extracted.image is not None else None
    has_page = page_shows(fixture, has_slice=slice_path is not None)
    next_step = review_command(output, slice_path, has_page=has_page)
    if sheet_path is not None and not has_page:
        next_step = accept_command(output, data["digest"])
    wrote_line = wrote(output)
    if sheet_path is not None:
        wrote_line += f" and {quoted(sheet_path)}, its review sheet"
        next_step = f"look at {quoted(sheet_path)}, then {next_step}"
    return CommandResult(
        data, "\n".join([*lines, wrote_line]), findings=fixture.findings,
        verdict=findings_verdict("planned", fixture), next_step=next_step,
    )  # fmt: skip


def rehearse_approaches(fixture: Any, robot: Any, arguments: Arguments) -> Iterator[Report]:
    """The rehearsal of a simulated arm along each side of the curve.

    Raises
    ------
    CheckFailed
        The arm does not reach a place, or would stop.
    """
    from vfplan.arm.model import Arm
    from vfplan.arm.rehearsal import objections, rehearse
    from vfplan.errors import CheckFailed
    from vfplan.replaying.link import approach_sessions

    arm = Arm(arguments["rehearse"], robot, base=arguments["base"], tool=arguments["tool"])
    for session in approach_sessions(fixture, arm.robot.rate_hz):
        with announce_if_slow(f"rehearsing {session.name}"):
            rehearsal = rehearse(fixture, session, arm)
        if not rehearsal.passed:
            reason = objections(rehearsal.metrics)[0]
            raise CheckFailed(
                f"arm {arm.name}, {session.name}: {reason}, so nothing is written. Move the "
                "base with --base, or look at it with vfplan rehearse",
                code="rehearsal-failed",
            )
        yield {"way": session.name, **rehearsal.metrics}
