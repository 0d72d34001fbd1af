"""Render a fixture on a Franka arm, over its own protocol, at 1 kHz.

    python loop.py FIXTURE.h5 --robot HOST --require-signature KEYS.pub --case CASE --max-age S
    python loop.py FIXTURE.h5 --robot HOST --unsigned [--seconds 10] [--no-governor]

Needs `pylibfranka`, Franka's own binding. The arm is held by your hand: the only torques are the
fixture's, governed, and the arm compensates its own weight. Stop it by its button, or by Ctrl-C.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import vfplan

THRESHOLDS = [100.0] * 7, [100.0] * 6  # the governor limits what is commanded, not these


@dataclass
class Run:
    """How a run ended: its ticks, the largest steps commanded, and the arm's own error, if any."""

    ticks: int = 0
    force_max_n: float = 0.0
    force_step_n: float = 0.0  # the engine's
    torque_step_nm: float = 0.0  # commanded, largest of a joint
    error: str | None = None


def connect(host: str) -> Any:
    """The arm at HOST, its errors taken back."""
    import pylibfranka

    robot = pylibfranka.Robot(host, pylibfranka.RealtimeConfig.kIgnore)
    robot.automatic_error_recovery()
    joints, cartesian = THRESHOLDS
    robot.set_collision_behavior(joints, joints, cartesian, cartesian)
    return robot


def tip(state: Any) -> np.ndarray:
    """(3,) the tip in the arm's base [m]: the last column of O_T_EE, which is column-major."""
    return np.array(state.O_T_EE[12:15])


def render(
    robot: Any,
    model: Any,
    engine: Any,
    governor: Any,
    ticks: int,
    more: Callable[[Any, np.ndarray, int], np.ndarray] | None = None,
) -> Run:
    """Run the loop for `ticks`, or until the arm stops.

    `governor` is a `vfplan.Governor` of torques, or `None`: the engine's force as it is. `more`
    gives torques (7,) [N m] to add, from the state, the Jacobian (6, 7) and the tick: the rest of
    a control law.
    """
    import pylibfranka

    run, control = Run(), robot.start_torque_control()
    force, torque = np.zeros(3), np.zeros(7)
    try:
        for k in range(ticks):
            state, _ = control.readOnce()
            jacobian = np.array(model.zero_jacobian(state)).reshape(7, 6).T  # column-major
            before, last = force, torque
            force = engine.step(tip(state)).force
            if governor is None:
                torque = jacobian[:3].T @ force
            else:
                governor.step(force, jacobian[:3])
                torque = governor.torque_nm
            if more is not None:
                torque = torque + more(state, jacobian, k)
            run.ticks = k + 1
            run.force_max_n = max(run.force_max_n, float(np.linalg.norm(force)))
            run.force_step_n = max(run.force_step_n, float(np.linalg.norm(force - before)))
            run.torque_step_nm = max(run.torque_step_nm, float(np.abs(torque - last).max()))
            command = pylibfranka.Torques(torque.tolist())
            command.motion_finished = k + 1 == ticks
            control.writeOnce(command)
    except (pylibfranka.ControlException, pylibfranka.CommandException) as error:
        run.error = str(error).splitlines()[0]
    return run


def main(arguments: list[str]) -> int:
    """Read a bundle, and render it on the arm."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("fixture")
    parser.add_argument("--robot", required=True, metavar="HOST")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--no-governor", action="store_true")
    maker = parser.add_mutually_exclusive_group(required=True)
    maker.add_argument("--require-signature", metavar="KEYS", help="one of these must have signed")
    maker.add_argument("--unsigned", action="store_true", help="anybody may have made the fixture")
    parser.add_argument("--case", help="for which case it must be signed")
    parser.add_argument("--robot-serial", help="for which robot it must be signed")
    parser.add_argument("--max-age", type=float, metavar="S", help="how long ago, at most [s]")
    parser.add_argument(
        "--despite-findings", action="store_true", help="take it though findings are open"
    )
    given = parser.parse_args(arguments)
    trust = None
    if given.unsigned:
        if (given.case, given.robot_serial, given.max_age) != (None, None, None):
            parser.error("--case, --robot-serial and --max-age need --require-signature")
        print(f"warning: {given.fixture} is loaded without a signature: it is undamaged, but "
              "anybody may have made it, for any patient", file=sys.stderr)  # fmt: skip
    else:
        from vfplan.bundle import Trust, read_keys

        keys = read_keys(given.require_signature)
        trust = Trust(keys, given.case, given.robot_serial, given.max_age)
    fixture = vfplan.read_fixture(given.fixture, trust=trust)
    if fixture.open_findings and not given.despite_findings:
        codes = ", ".join(finding.code for finding in fixture.open_findings)
        parser.error(f"findings of its planning are not answered: {codes}")
    if fixture.guidance is not None:
        parser.error("the fixture guides; this loop renders forbidden regions only")
    stiffness = float(np.max(fixture.stiffness))
    engine = vfplan.ProxyEngine.of(fixture)
    limits = vfplan.read_robot("fr3")
    governor = vfplan.Governor.of(limits, stiffness, torques=True)
    robot = connect(given.robot)
    engine.reset(tip(robot.read_once()))
    run = render(
        robot, robot.load_model(), engine, None if given.no_governor else governor,
        round(1000 * given.seconds),
    )  # fmt: skip
    print(f"{run.ticks} ticks, force up to {run.force_max_n:.2f} N, torque steps up to "
          f"{run.torque_step_nm:.3f} N m")  # fmt: skip
    if run.error:
        print(run.error, file=sys.stderr)
    return int(run.error is not None)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
