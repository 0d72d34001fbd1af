"""`vfplan rehearse`: will this arm render this fixture with this hand?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vfplan.cli import options
from vfplan.cli.options import option, taking
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import Report, command, command_line, progress, rough_ticks
from vfplan.cli.telling import told
from vfplan.cli.values import FILE, PNG, Number
from vfplan.io.staging import write_whole

TEXT = (
    "arm {arm}: {ticks} ticks, {duration_s:.3f} s, {reached} reached; {real_time_factor:.0f} times "
    "real time",
    "\nforce        max {force_max_n:.3f} N, step max {force_step_max_n:.3f} N; penetration max "
    "{penetration_max_m:mm}",
    "\ntorque       max {torque_max_nm:.2f} N·m (joint {torque_max_joint}), step max "
    "{torque_step_max_nm:.4f} N·m (joint {torque_step_max_joint})",
    "\njoints       {joint_margin_min_rad:.3f} rad left of joint {joint_margin_min_joint}'s range",
    "\npostures     condition at most {worst:.2f}; mass at the tip from {mass_min_kg:.2f} kg, "
    "stable there up to {k_max_n_per_m:.0f} N/m ({k_n_per_m:.0f} N/m rendered)",
    "\ngovernor     up to {governor[held_back_max_n]:.3f} N held back in {governor[held_ticks]} "
    "ticks, work {governor[work_j]:mJ}",
)
REFLEX = (
    "would stop: {kind}",
    " of joint {joint}",
    " at tick {tick}",
    ", {s_m:mm.1} along stroke {stroke}",
    ": {value:.4g}, {limit:.4g} allowed",
)


@command(
    "rehearse",
    first_screen="-o --arm --robot --base --tool --no-governor --report --picture-out --json",
)
@taking(
    options.FIXTURE,
    options.SESSION,
    options.output("Per-tick result of the simulated tip, HDF5.", required=False),
    option("--arm", default="panda", metavar="panda|fr3|FILE.xml",
           help="The arm: a shipped one, or an MJCF file of hinges with a site `tip`."),
    options.robot("The limits it has; its own for a shipped arm."),
    option("--base", **options.BASE, help="Its base in the fixture's frame [m].  [default: 0,0,0]"),
    option("--tool", **options.TOOL, help="The tip in the flange's frame [m]."),
    option("--no-governor", is_flag=True, help="Command the engine's force as it is."),
    option("--hand", "hand_n_per_m", type=Number("N_PER_M"), default="600",
           help="How stiffly the hand wants the tip where the session is."),
    options.UNITS,
    option("--report", type=FILE, metavar="DIR",
           help="Folder for one self-contained HTML page with pictures."),
    option("--picture-out", type=PNG, metavar="PNG", help="Write the arm over the fixture."),
    options.signature(),
)  # fmt: skip
def command(fixture, session, output, report, picture_out, **given) -> Report:
    """Let SESSION's hand move a simulated arm that renders FIXTURE.h5 at its own rate.

    The hand is a spring and damper that want the tip where the session is. Says whether the arm
    reaches every place, and what would have stopped it: torques and their steps, joints at their
    limits, speeds, forces, each with its tick, joint and place along the curve. Exit 1 when it does
    not reach or would have stopped; the files are written then too, as the record of it.
    """
    from vfplan.arm import Arm, rehearse
    from vfplan.arm.loop import Hand
    from vfplan.bundle import read_sealed
    from vfplan.robot import read_robot

    refuse_folder(report)
    planned, seal = read_sealed(fixture, trust=options.trust(given))
    robot = read_robot(given["robot"])
    arm = Arm(given["arm"], robot, base=given["base"], tool=given["tool"])
    wanted, warnings = _session(session, given["units"], planned.frame, arm.robot.rate_hz)
    hand = Hand(stiffness=given["hand_n_per_m"])
    with progress("rehearse", len(wanted.hip)) as done:
        found = rehearse(
            planned, wanted, arm, governed=not given["no_governor"], hand=hand, done=done
        )
    with outputs(output, picture_out, report and report / "index.html") as (result, picture, index):
        if result is not None:
            from vfplan.session import ResultWriter

            with ResultWriter(result, {"rehearsal": found.metrics}) as file:
                file.append(found.ticks)
        if picture is not None:
            from vfplan.arm.figures import in_space
            from vfplan.figures.style import save_png

            save_png(in_space(found), picture)
        if index is not None:
            from vfplan.arm.page import page

            about = {"command": command_line(), "fixture": fixture.name,
                     "fixture's SHA-256": seal.describe()["sha256"]}  # fmt: skip
            write_whole(index, [page(found, about).encode("utf-8")], overwrite=True)
    return Report(
        found.metrics, rehearsed_text(found.metrics), exit_code=int(not found.passed),
        warnings=warnings,
    )  # fmt: skip


def _session(path: Path, units: str, frame: str, rate_hz: float) -> tuple[Any, list[str]]:
    """The whole session at the arm's rate, and what was done for that."""
    import numpy as np

    from vfplan.session import open_session, resampled

    source = open_session(path, units=units, frame=frame)
    with progress("read", rough_ticks(path)):
        whole = source.load()
    rate = 1 / float(np.median(np.diff(whole.time)))
    if 0.99 < rate / rate_hz < 1.01:
        return whole, []
    return resampled(whole, rate_hz).load(), [
        f"{path}: sampled at {rate:.6g} Hz, resampled to the arm's {rate_hz:g} Hz by straight lines"
    ]


def rehearsed_text(found: dict[str, Any]) -> str:
    """The short report of one rehearsal."""
    more = {"reached": "every place" if found["reachable"] else "NOT every place"}
    more["worst"] = found["condition_max"] or float("inf")
    return "\n".join([told(found | more, *TEXT), *objections(found)])


def objections(found: dict[str, Any]) -> list[str]:
    """Why it did not pass, a line each: places not reached, then what would have stopped it."""
    missed = found.get("unreached", [])[:5]
    short = [told(place, "not reached: tick {tick}, {left_m:mm.1} short") for place in missed]
    return [*short, *(told(reflex, *REFLEX) for reflex in found["reflexes"])]
