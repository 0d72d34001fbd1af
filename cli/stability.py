"""`vfplan stability`: closed loop, passivity and extreme cases, and the gate on K."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from vfplan.cli import options, values
from vfplan.cli.options import OVERWRITE, option, taking
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import Report, command, progress

from vfplan.io.files import naming_place
from vfplan.io.json_types import to_json_types
from vfplan.io.staging import write_whole

PARTS = ("closed-loop", "passivity", "extremes")
REPORT, TABLE, PASSIVITY = FILES = "stability.json", "cases.csv", "passivity.png"

_above = values.Real(min=0, min_open=True)


@command(
    "stability",
    first_screen="--robot --mass --damping --rate --delay-ticks --stiffness -o --part --json",
)
@click.argument("fixture", type=values.FILE, required=False)
@taking(
    options.ROBOT,
    option("--mass", "mass_kg", type=_above, metavar="KG",
           help="Moving mass at the tip.  [default: 1]"),
    option("--damping", "damping_n_s_per_m", type=values.Real(min=0), metavar="N_S_PER_M",
           help="Viscous damping at the tip.  [default: 5]"),
    option("--rate", "rate_hz", type=_above, metavar="HZ", help="Control rate.  [default: 1000]"),
    option("--delay-ticks", type=values.Whole(0, 1000), metavar="N",
           help="Ticks between a position and its force.  [default: 0]"),
    option("--friction", "friction_n", type=_above, metavar="N", help="Coulomb friction."),
    option("--quantum", "quantum_m", type=_above, metavar="M",
           help="Resolution of a measured position."),
    option("--force-limit", "force_limit_n", type=_above, metavar="N", help="Largest force."),
    option("--force-step-limit", "force_step_limit_n", type=_above, metavar="N",
           help="Largest change of force in a tick."),
    option("--stiffness", type=_above, metavar="N_PER_M",
           help="The K to judge.  [default: the bundle's, or 1000]"),
    option("--margin", type=values.Real(min=1), default=1.25, help="K times this must be stable."),
    option("--part", "parts", multiple=True, type=click.Choice(PARTS),
           help="Only this part (repeatable)."),
    option("--full", is_flag=True, help="Also the long runs (many minutes)."),
    option("--jobs", type=values.Whole(1, 64), default=2, help="Processes."),
    option("-o", "--output", type=values.FILE, metavar="DIR",
           help="Write the report, the tables and the pictures there."),
    OVERWRITE,
)  # fmt: skip
def command(fixture, output, robot, **given) -> Report:
    """Judge the K of FIXTURE (or --stiffness) in closed loop with a robot, and try the engine.

    Exit 1 when K times the margin is not stable, or a case did not come out as it should; the
    report is written all the same.
    """
    from vfplan.bundle import read_fixture
    from vfplan.stability.study import study

    refuse_folder(output, *FILES)
    asked = {name: given.pop(name) for name in ("stiffness", "margin", "parts", "full", "jobs")}
    arm = chosen_robot(robot, given)
    judged = None if fixture is None else read_fixture(fixture)
    with naming_place(fixture):
        found = study(judged, arm, progress=progress, **asked)
    every_case = click.get_current_context().params["verbose"] > 0
    data = found.as_dict()
    text = found.as_text(every_case)
    if not every_case:
        text += "\n-v lists every case"
    if output is not None:
        _write(output, found)
        text += f"\nwrote {output}"
    verdict, next_step = _verdict(found)
    return Report(data, text, failed=_failed(found), verdict=verdict, next_step=next_step)


def _verdict(found: Any) -> tuple[str, str]:
    """How the study ended, and what to do next, a line each."""
    judged = found.verdict
    if not judged.stable:
        return (
            f"fail: K = {judged.k_n_per_m:g} N/m is not stable with this robot",
            "plan with a smaller --stiffness, or judge it with the robot's true --mass and "
            "--damping",
        )
    if found.failed:
        return "fail: a case did not come out as it should", "report the cases that failed"
    return (
        f"pass: K = {judged.k_n_per_m:g} N/m is stable with this robot",
        "vfplan sign FIXTURE.h5 --key KEY, then load it on the robot",
    )


def _failed(found: Any) -> str:
    """What did not hold, in a line; empty where all did."""
    verdict, cases = found.verdict, [row.case for row in found.failed]
    words = [] if verdict.stable else [f"K = {verdict.k_n_per_m:g} N/m does not pass"]
    words += [f"{len(cases)} cases did not come out, the first {cases[0]}"] if cases else []
    return "; ".join(words)


def chosen_robot(choice: str | None, given: dict[str, Any]) -> Any:
    """The robot that `--robot` names, with what single options say instead."""
    from vfplan.robot import read_robot
    from vfplan.stability.study import DEFAULT_ROBOT

    robot = read_robot(choice) or DEFAULT_ROBOT
    return replace(robot, **{name: value for name, value in given.items() if value is not None})


def _write(folder: Path, found: Any) -> None:
    """The report and the table; a picture where there is something to draw."""
    from vfplan.figures.stability import passivity_plot
    from vfplan.figures.style import save_png

    drawn = any(row.case.startswith("passivity/") for row in found.rows)
    paths = (folder / REPORT, folder / TABLE, folder / PASSIVITY if drawn else None)
    with outputs(*paths) as (report, table, picture):
        text = json.dumps(to_json_types(found.as_dict()), indent=2) + "\n"
        write_whole(report, [text.encode()], overwrite=True)
        write_whole(table, [found.as_csv().encode()], overwrite=True)
        if picture is not None:
            save_png(passivity_plot(found.rows), picture)
