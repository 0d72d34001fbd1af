"""`vfplan stability`: closed loop, passivity and extreme cases, and the gate on K."""

from __future__ import annotations

import json
from dataclasses import replace

import click
from vfplan.cli import options
from vfplan.cli.next_commands import approval_command
from vfplan.cli.options import FILE, OVERWRITE, DecimalNumber, WholeNumber, option, options_in_order
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import CommandResult, command, progress

from vfplan.display import command_of, count, wrote
from vfplan.io.files import naming_place, to_json_types
from vfplan.io.writing import write_whole

REPORT_FILE = "stability.json"
PICTURE_FILE = "passivity.png"

ABOVE_0 = DecimalNumber(min=0, min_open=True)

# The largest stiffness that a bundle may hold [N/m] (schemas/bundle-2.0.json).
MAX_STIFFNESS = 1e6


@command(
    "stability",
    first_screen="--robot --mass --damping --rate --delay-ticks --stiffness -o --part --json",
)
@click.argument("fixture", type=FILE, required=False)
@options_in_order(
    options.robot_option("Judge the stiffness in closed loop with this robot."),
    option("--mass", "mass_kg", type=ABOVE_0, metavar="KG",
           help="Moving mass at the tip [kg].  [default: 1]"),
    option("--damping", "damping_n_s_per_m", type=DecimalNumber(min=0), metavar="N_S_PER_M",
           help="Viscous damping at the tip [N s/m].  [default: 5]"),
    option("--rate", "rate_hz", type=ABOVE_0, metavar="HZ",
           help="Control rate [Hz].  [default: 1000]"),
    option("--delay-ticks", type=WholeNumber(0, 1000), metavar="N",
           help="Ticks between a position and its force.  [default: 0]"),
    option("--filter", "filter_hz", type=DecimalNumber(min=0), metavar="HZ",
           help="Cutoff of the robot's filter on forces [Hz]; 0: none.  [default: the robot's]"),
    option("--stiffness", type=DecimalNumber(0, MAX_STIFFNESS, min_open=True),
           metavar="N_PER_M",
           help="Stiffness K to judge [N/m].  [default: the bundle's, or 1000]"),
    option("--margin", type=DecimalNumber(min=1), metavar="FACTOR", default=1.25,
           help="Require that K times this factor is stable."),
    option("--part", "parts", multiple=True,
           type=click.Choice(["closed-loop", "passivity", "extremes"]),
           help="Run this part only; repeatable."),
    option("--full", is_flag=True, help="Run the long cases too, which takes many minutes."),
    option("--jobs", type=WholeNumber(1, 64), metavar="N", default=2,
           help="Number of processes."),
    option("-o", "--output", type=FILE, metavar="DIR",
           help="Write the report and the picture into this folder."),
    OVERWRITE,
)  # fmt: skip
def vfplan_stability(
    fixture, output, robot, stiffness, margin, parts, full, jobs, **robot_figures
) -> CommandResult:
    """Judge the stiffness K of FIXTURE (or --stiffness) with a robot, and test the engine.

    The exit code is 1 if K times the margin is not stable, or if a case did not end as it should.
    The files are written all the same.
    """
    from vfplan.bundle.read import read_fixture
    from vfplan.bundle.validation import describe
    from vfplan.robot import read_robot
    from vfplan.stability.study import DEFAULT_ROBOT, study

    refuse_folder(output, REPORT_FILE, PICTURE_FILE)
    judged_robot = read_robot(robot) or DEFAULT_ROBOT
    if typed := {name: value for name, value in robot_figures.items() if value is not None}:
        judged_robot = replace(judged_robot, **typed)
    judged = None if fixture is None else read_fixture(fixture)
    with naming_place(fixture):
        studied = study(
            judged, judged_robot, stiffness=stiffness, safety_factor=margin, parts=parts, full=full,
            jobs=jobs, progress=progress,
        )  # fmt: skip
    lines = [studied.as_text()]
    if output is not None:
        from vfplan.figures.style import passivity_plot, save_png

        picture_path = None
        if any(row.case.startswith("passivity/") for row in studied.rows):
            picture_path = output / PICTURE_FILE
        with outputs(output / REPORT_FILE, picture_path) as (report, picture):
            text = json.dumps(to_json_types(studied.as_dict()), indent=2) + "\n"
            write_whole(report, [text.encode()], overwrite=True)
            if picture is not None:
                save_png(passivity_plot(studied.rows), picture)
        lines.append(wrote(output))

    # What did not hold, and what to do about it.
    judgement = studied.verdict
    subject = f"K = {judgement.k_n_per_m:g} N/m"
    failed = []
    if studied.failed:
        cases = count(len(studied.failed), "case")
        failed.append(f"{cases} did not end as it should, first {studied.failed[0].case}")
        verdict = "fail: a case did not end as it should"
        next_step = "report the cases that failed; the engine is not to be trusted with them"
    else:
        verdict = f"pass: {subject} is stable with robot {judged_robot.name!r}"
        words = ("--robot", robot or "franka")
        if judged is None:
            again = command_of("plan", "IMAGE", "MARKERS", *words)
            next_step = f"judge a plan in the same way: {again}"
        elif judged_robot is DEFAULT_ROBOT:
            # Neither a robot nor one of its figures was typed.
            again = command_of("stability", fixture, *words)
            next_step = f"judge it with your own robot: {again}"
        else:
            next_step = approval_command(fixture, describe(fixture))
    if not judgement.stable:
        failed.insert(0, f"{subject} does not pass")
        verdict = f"fail: {subject} is not stable with robot {judged_robot.name!r}"
        next_step = (
            "plan with a smaller --stiffness, or judge it with the robot's true --mass and "
            "--damping"
        )
    return CommandResult(
        studied.as_dict(), "\n".join(lines), failed="; ".join(failed), verdict=verdict,
        next_step=next_step,
    )  # fmt: skip
