"""`vfplan rehearse`: will this arm render this fixture with this hand?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from vfplan.cli import options
from vfplan.cli.options import FILE, number_of, option, options_in_order, output_option
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import CommandResult, command, command_line, progress, rough_ticks
from vfplan.display import Report, millimetres, wrote
from vfplan.io.writing import write_whole

if TYPE_CHECKING:
    from vfplan.session.session import Session


@command("rehearse", first_screen="-o --arm --robot --base --tool --no-governor --report --json")
@options_in_order(
    options.FIXTURE,
    options.SESSION,
    output_option("Write the result of each tick of the simulated tip to this HDF5 file.",
                  required=False),
    option("--arm", default="panda", metavar="panda|fr3|FILE.xml",
           help="Use this shipped arm, or an MJCF file of hinges with a site `tip`."),
    options.robot_option("Take the limits of this robot.  [default: the shipped arm's]"),
    option("--base", **options.ARM_BASE,
           help="Base of the arm in the fixture's frame [m].  [default: 0,0,0]"),
    option("--tool", **options.ARM_TOOL, help="Tip of the arm in its flange's frame [m]."),
    option("--no-governor", is_flag=True,
           help="Send the force of the engine to the arm without a governor."),
    option("--hand", "hand_n_per_m", type=number_of("N_PER_M"), default="600",
           help="Stiffness of the hand that pulls the tip along the session [N/m]."),
    options.UNITS,
    option("--report", type=FILE, metavar="DIR",
           help="Write an HTML page with pictures into this folder."),
    options.signature_options(),
)  # fmt: skip
def vfplan_rehearse(fixture, session, output, report, **arguments) -> CommandResult:
    """Let a hand move a simulated arm along SESSION, while the arm renders FIXTURE.h5.

    The hand is a spring with a damper. The report says whether the arm reaches every place, and
    what would have stopped it, with tick, joint and place along the curve. The exit code is 1 if
    the arm does not reach a place or would have stopped. The files are written all the same.
    """
    from vfplan.arm.model import Arm
    from vfplan.arm.rehearsal import objections, rehearse
    from vfplan.bundle.read import read_sealed
    from vfplan.robot import read_robot

    # The fixture, the arm, and the session at the arm's rate.
    refuse_folder(report)
    planned, seal = read_sealed(fixture, trust=options.trust(arguments))
    robot = read_robot(arguments["robot"])
    arm = Arm(arguments["arm"], robot, base=arguments["base"], tool=arguments["tool"])
    recorded, warnings = read_at_rate(session, arguments["units"], planned.frame, arm.robot.rate_hz)

    with progress("rehearse", len(recorded.hip)) as done:
        rehearsal = rehearse(
            planned, recorded, arm, governed=not arguments["no_governor"],
            hand_stiffness=arguments["hand_n_per_m"], done=done,
        )  # fmt: skip

    # The files.
    index_path = report / "index.html" if report is not None else None
    with outputs(output, index_path) as (result, index):
        if result is not None:
            from vfplan.session.result import ResultWriter

            with ResultWriter(result, {"rehearsal": rehearsal.metrics}) as file:
                file.append(rehearsal.ticks)
        if index is not None:
            from vfplan.arm.figures import page

            facts = {"command": command_line(), "fixture": fixture.name,
                     "fixture's SHA-256": seal["sha256"]}  # fmt: skip
            write_whole(index, [page(rehearsal, facts).encode("utf-8")], overwrite=True)

    # What to do now.
    warnings += options.not_compared(seal, arguments).values()
    metrics = rehearsal.metrics
    written = [wrote(path) for path in (output, index_path) if path is not None]
    failed = ""
    if rehearsal.passed:
        next_step = "rehearse with --arm and --base as the robot really stands, then sign"
    else:
        failed = objections(metrics)[0]
        next_step = "move more slowly or press less there"
        if index_path is None:
            next_step += f"; draw it: {command_line(overwrite=bool(written))} --report DIR"
        if not metrics["reachable"]:
            next_step = "move the arm with --base, or bring the fixture closer"
    return CommandResult(
        metrics, "\n".join([rehearsed_text(metrics), *written]), warnings=warnings, failed=failed,
        verdict=rehearsal.verdict, next_step=next_step,
    )  # fmt: skip


def read_at_rate(path: Path, units: str, frame: str, rate_hz: float) -> tuple[Session, list[str]]:
    """The whole session at the arm's rate, and warnings where it was resampled for that."""
    import numpy as np

    from vfplan.arm.rehearsal import SAME_RATE
    from vfplan.session.read import open_session
    from vfplan.session.session import resampled

    source = open_session(path, units=units, frame=frame)
    with progress("read", rough_ticks(path)):
        whole = source.load()
    rate = 1 / float(np.median(np.diff(whole.time)))
    if abs(rate / rate_hz - 1) < SAME_RATE:
        return whole, []
    warnings = [
        f"{path}: was sampled at {rate:.6g} Hz and is resampled to the arm's {rate_hz:g} Hz by "
        "straight lines. Record at the arm's rate where that matters"
    ]
    at_rate = resampled(whole, rate_hz)
    session = at_rate.load()
    recorded = at_rate.notes["recorded"]
    if recorded["gaps"]:
        warnings.append(
            f"{path}: about {recorded['missing_samples']} samples are missing, in gaps of "
            f"{recorded['gap_s']:.3g} s together, and straight lines fill them. Record without "
            "gaps, or do not rely on the ticks there"
        )
    return session, warnings


def rehearsed_text(metrics: Report) -> str:
    """The short report of one rehearsal."""
    from vfplan.arm.rehearsal import objections

    reached = "every place" if metrics["reachable"] else "NOT every place"
    lines = [
        f"arm {metrics['arm']}: {metrics['ticks']} ticks, {metrics['duration_s']:.3f} s, "
        f"{reached} reached",
        f"force        max {metrics['force_max_n']:.3f} N, step max "
        f"{metrics['force_step_max_n']:.3f} N; penetration max "
        f"{millimetres(metrics['penetration_max_m'])}",
        *objections(metrics),
    ]
    return "\n".join(lines)
