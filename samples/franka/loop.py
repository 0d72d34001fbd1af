"""Render a fixture on a Franka arm, over its own protocol, at 1 kHz.

    python loop.py FIXTURE.h5 --robot HOST --keys KEYS.pub --case CASE --max-age 12h
    python loop.py FIXTURE.h5 --robot HOST --unsigned [--seconds 10] [--no-governor] [--log LOG.csv]
                   [--no-real-time] [--tool-tip X,Y,Z] [--collision-force N] [--collision-torque NM]

Needs `pylibfranka`, Franka's own binding. Your hand holds the arm. The arm compensates its own
weight, and the only torques that are commanded are the fixture's, limited by the governor. The loop
does not start while the tip is inside the fixture. It stops by itself at the bits of `status` at
which docs/controller.md says that a loop stops the arm. Stop it by the arm's button, or by Ctrl-C.

It ends with the exit codes of docs/controller.md, as samples/controller does.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import vfplan
from vfplan import Status
from vfplan.engine.governor import GovernorStatus
from vfplan.errors import InputError, MissingExtra, OutputError, UnsafeError, VfplanError
from vfplan.io.files import parse_seconds
from vfplan.io.writing import write_whole

RATE_HZ = 1000
ARM = "fr3"
"""Whose limits the governor keeps."""
COLLISION_TORQUE_NM = 40.0
"""External torque of a joint at which the arm stops [N m]."""
COLLISION_FORCE_N = 40.0
"""The same of a force at the tip [N]: twice what the governor lets the fixture command."""

NO_OFFSET = np.zeros(3)
MAX_TIP_STEP = 0.02
"""The tip goes no further in a tick [m]."""

ENGINE_STOPS = {
    Status.BAD_HIP: (
        "the arm's position was not finite, or beyond 1e6 m",
        "Check the arm's connection and its state.",
    ),
    Status.STALE: (
        "the pose of the moving fixture was too old, or the loop's clock did not go on",
        "Check the tracker before you start again.",
    ),
    Status.JUMPED: (
        "the arm's position was further from the one before than an arm can go",
        "Check the arm's connection and its state.",
    ),
    Status.CROSSED: (
        "the way out of the fixture led to its other side",
        "Lead the arm out by hand, to the side on which it may be.",
    ),
}
"""At which bits of an engine's status the loop stops: what has happened, and what to do."""
GOVERNOR_STOPS = {
    GovernorStatus.BAD_FORCE: (
        "the force was not finite, or beyond 1e6 N",
        "Check the fixture: vfplan info.",
    ),
    GovernorStatus.BAD_JACOBIAN: (
        "the arm's Jacobian was not finite, or beyond 1e6 m",
        "Check the arm's connection and its state.",
    ),
}
"""The same of a governor's status."""

LOG_COLUMNS = "t,x,y,z,proxy_x,proxy_y,proxy_z,force_x,force_y,force_z,state,status"
"""Columns of the log: a session of `vfplan replay`, and what was answered. The force is the one
that was commanded."""
LOG_COLUMNS_OF_GOVERNOR = ",engine_x,engine_y,engine_z"
"""Further columns if a governor limits the force: the engine's own."""


@dataclass
class Run:
    """How a run ended.

    ticks: how many ticks there were
    force_max_n: the engine's largest force [N]
    force_step_n: the largest change of the engine's force from one tick to the next [N]
    torque_step_nm: the largest change of a joint's commanded torque [N m]
    bits: in how many ticks each bit of the engine's and the governor's status was set
    error: why the arm or this loop stopped before its time; `None` if neither did
    """

    ticks: int = 0
    force_max_n: float = 0.0
    force_step_n: float = 0.0
    torque_step_nm: float = 0.0
    bits: dict[str, int] = field(default_factory=dict)
    error: str | None = None


def connect(
    host: str,
    torque_nm: float = COLLISION_TORQUE_NM,
    force_n: float = COLLISION_FORCE_N,
    *,
    is_real_time: bool = True,
) -> Any:
    """Connect to the arm, clear its errors, and set where it reports a collision.

    Unless `is_real_time` is False, libfranka refuses to start without a real-time kernel.
    """
    import pylibfranka

    config = pylibfranka.RealtimeConfig
    robot = pylibfranka.Robot(host, config.kEnforce if is_real_time else config.kIgnore)
    robot.automatic_error_recovery()
    torques, forces = [torque_nm] * 7, [force_n] * 6
    robot.set_collision_behavior(torques, torques, forces, forces)
    return robot


def read_tip(state: Any, offset: np.ndarray = NO_OFFSET) -> np.ndarray:
    """(3,) the tip in the frame of the arm's base [m]; `offset` (3,) in the end effector's [m]."""
    # O_T_EE is a 4 x 4 matrix, column by column.
    pose = np.reshape(state.O_T_EE, (4, 4)).T
    return pose[:3, :3] @ offset + pose[:3, 3]


def tip_jacobian(state: Any, model: Any, offset: np.ndarray = NO_OFFSET) -> np.ndarray:
    """(6, 7) of the tip: its velocity and turning, from those of the joints."""
    # It comes column by column, of the end effector.
    jacobian = np.array(model.zero_jacobian(state)).reshape(7, 6).T
    arm = np.reshape(state.O_T_EE, (4, 4)).T[:3, :3] @ offset
    jacobian[:3] += np.cross(jacobian[3:], arm, axis=0)
    return jacobian


def render(
    robot: Any,
    model: Any,
    engine: Any,
    governor: vfplan.Governor | None,
    ticks: int,
    other_torque: Callable[[Any, np.ndarray, int], np.ndarray] | None = None,
    stop_signals: Sequence[int] = (),
    log: list[list[float]] | None = None,
    tip_offset: np.ndarray = NO_OFFSET,
) -> Run:
    """Run the control loop for a number of ticks, or until the arm stops.

    The bits of `ENGINE_STOPS` and `GOVERNOR_STOPS` end the run early, as a signal does. The
    fixture's torque then fades, and the loop tells the arm that the motion has finished.

    governor
        A governor of torques; `None` commands the engine's force as it is.
    other_torque
        Gives torques (7,) [N m] to add, from the state, the Jacobian (6, 7) and the tick. This is
        the place for the rest of your control law.
    stop_signals
        A list to which a signal adds its number, which asks the loop to stop.
    log
        A list that takes a row for each tick with a sound position, as `write_log` writes it.
    tip_offset
        (3,) the tip in the frame of the end effector [m].
    """
    import pylibfranka

    run = Run()
    force = np.zeros(3)
    torque = last_other = np.zeros(7)
    try:
        control = robot.start_torque_control()
        for tick in range(ticks):
            state, _ = control.readOnce()
            jacobian = tip_jacobian(state, model, tip_offset)

            last_force = force
            tip = read_tip(state, tip_offset)
            step = engine.step(tip)
            count_bits(run, step.status)
            stop_at(run, tick, step.status, ENGINE_STOPS)
            if stop_signals and run.error is None:
                run.error = (
                    f"Signal {stop_signals[0]} stopped the loop in tick {tick}. Start it again."
                )
            # A loop that stops lets the fixture's force end: the bits mean that it is not to be
            # trusted, or that the fixture is not where the patient is.
            force = step.force if run.error is None else np.zeros(3)

            last_torque = torque
            if governor is None:
                commanded = force
                torque = jacobian[:3].T @ force
                if not np.isfinite(torque).all():
                    torque = np.zeros(7)
                    stop_at(run, tick, GovernorStatus.BAD_JACOBIAN, GOVERNOR_STOPS)
            else:
                commanded = governor.step(force, jacobian[:3])
                torque = governor.torque_nm
                count_bits(run, governor.status)
                stop_at(run, tick, governor.status, GOVERNOR_STOPS)
            if log is not None and not step.status & (Status.BAD_HIP | Status.JUMPED):
                log.append(log_row((tick + 1) / RATE_HZ, tip, step, commanded))
            # The loop ends when the fixture's torque has faded, whatever the hook adds.
            has_stopped = run.error is not None and not torque.any()
            if other_torque is not None:
                other = np.asarray(other_torque(state, jacobian, tick))
                if np.isfinite(other).all():
                    last_other = other
                elif run.error is None:
                    run.error = f"In tick {tick} other_torque was not finite. The loop stopped."
                torque = torque + last_other

            run.ticks = tick + 1
            run.force_max_n = max(run.force_max_n, float(np.linalg.norm(force)))
            force_step_n = float(np.linalg.norm(force - last_force))
            run.force_step_n = max(run.force_step_n, force_step_n)
            torque_step_nm = float(np.abs(torque - last_torque).max())
            run.torque_step_nm = max(run.torque_step_nm, torque_step_nm)

            command = pylibfranka.Torques(torque.tolist())
            command.motion_finished = tick + 1 == ticks or has_stopped
            control.writeOnce(command)
            if has_stopped:
                break
    except (pylibfranka.ControlException, pylibfranka.CommandException) as error:
        run.error = str(error).splitlines()[0]
    return run


def count_bits(run: Run, status: Status | GovernorStatus) -> None:
    """Count the bits of a tick's status."""
    for bit in type(status):
        if status & bit:
            name = bit.name.lower()
            run.bits[name] = run.bits.get(name, 0) + 1


def stop_at(
    run: Run, tick: int, status: Status | GovernorStatus, stops: dict[Any, tuple[str, str]]
) -> None:
    """Give the run its reason to stop, if the status has one and there is none yet."""
    for bit, (what_happened, advice) in stops.items():
        if status & bit and run.error is None:
            run.error = f"In tick {tick} {what_happened}. The loop stopped. {advice}"


def log_row(t: float, tip: np.ndarray, step: vfplan.Step, commanded: np.ndarray) -> list[float]:
    """A tick of the log, with the engine's own force as its last columns."""
    return [t, *tip, *step.proxy, *commanded, step.state, int(step.status), *step.force]


def check_log(path: Path) -> None:
    """Refuse a place of the log before the arm moves."""
    if path.exists():
        raise OutputError("the log is there already. Give --log another name.", where=str(path))
    if not path.parent.is_dir():
        raise OutputError("there is no such folder. Give --log a place in one.", where=str(path))


def write_log(path: Path, rows: list[list[float]], is_governed: bool) -> None:
    """Write a session as `vfplan replay` reads it; numbers read back to the same bits."""
    header = LOG_COLUMNS
    if is_governed:
        header += LOG_COLUMNS_OF_GOVERNOR
    count = len(header.split(","))
    lines = [header]
    for row in rows:
        lines.append(",".join(f"{value:.17g}" for value in row[:count]))
    write_whole(path, ["\n".join([*lines, ""]).encode()], overwrite=False)


def parse_age(text: str) -> float:
    """A length of time as `vfplan verify --max-age` takes it, as seconds."""
    try:
        return parse_seconds(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def parse_place(text: str) -> np.ndarray:
    """A place of three coordinates, within a metre."""
    place = np.array([float(word) for word in text.split(",")])
    if place.shape != (3,) or not (np.abs(place) <= 1).all():
        raise argparse.ArgumentTypeError(f"{text!r} is no X,Y,Z. Give metres, within 1 m")
    return place


def parse_duration(text: str) -> float:
    """Seconds, of one tick at least."""
    seconds = float(text)
    if not 1 / RATE_HZ <= seconds <= 3600:
        raise argparse.ArgumentTypeError(f"{text!r} is out of range. Give 0.001 to 3600")
    return seconds


def parse(words: list[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("fixture")
    parser.add_argument("--robot", required=True, metavar="HOST")
    parser.add_argument("--seconds", type=parse_duration, default=10.0)
    parser.add_argument("--no-governor", action="store_true")
    parser.add_argument(
        "--no-real-time", action="store_true", help="run on any kernel, as beside the simulator"
    )
    parser.add_argument("--collision-torque", type=float, default=COLLISION_TORQUE_NM,
                        metavar="NM", help="of a joint, at which the arm stops")  # fmt: skip
    parser.add_argument("--collision-force", type=float, default=COLLISION_FORCE_N, metavar="N",
                        help="at the tip, at which the arm stops")  # fmt: skip
    parser.add_argument("--tool-tip", type=parse_place, default=NO_OFFSET, metavar="X,Y,Z",
                        help="the tip in the frame of the end effector [m]")  # fmt: skip
    parser.add_argument(
        "--log", type=Path, metavar="CSV", help="write every tick, for `vfplan replay`"
    )
    signer = parser.add_mutually_exclusive_group(required=True)
    signer.add_argument(
        "--keys", "--require-signature", metavar="KEYS", help="one of these must have signed"
    )
    signer.add_argument("--unsigned", action="store_true", help="anybody may have made the fixture")
    parser.add_argument("--case", help="for which case it must be signed")
    parser.add_argument("--robot-serial", help="for which robot it must be signed")
    parser.add_argument(
        "--max-age", type=parse_age, metavar="TIME", help="how long ago: 90s, 30min, 12h or 2d"
    )
    parser.add_argument(
        "--despite-findings", action="store_true", help="take it though findings are open"
    )
    options = parser.parse_args(words)
    demands = (options.case, options.robot_serial, options.max_age)
    if options.unsigned and demands != (None, None, None):
        parser.error(
            "--case, --robot-serial and --max-age read a signature. "
            "Give --keys KEYS, or leave them out."
        )
    return options


def load(options: argparse.Namespace) -> vfplan.Fixture:
    """Read the fixture that is named, and refuse one that must not be rendered."""
    if options.unsigned:
        fixture = vfplan.read_fixture(options.fixture)
        print(
            f"warning: {options.fixture} is loaded without a signature: it is undamaged, but "
            "anybody may have made it, for any patient. Sign it with `vfplan sign`.",
            file=sys.stderr,
        )
    else:
        from vfplan.bundle.seal import Trust, read_keys

        keys = read_keys(options.keys)
        trust = Trust(keys, options.case, options.robot_serial, options.max_age)
        fixture = vfplan.read_fixture(options.fixture, trust=trust)
        if fixture.reviewed is None:
            print(
                f"warning: {options.fixture} is signed, but nobody has reviewed its plan. Ask who "
                "signed it why.",
                file=sys.stderr,
            )
    if fixture.frame != "robot_base":
        raise InputError(
            f"the fixture is in the frame {fixture.frame}, and the arm moves in robot_base. "
            "Register it first: vfplan register.",
            where=options.fixture,
        )
    if fixture.open_findings and not options.despite_findings:
        codes = ", ".join(finding.code for finding in fixture.open_findings)
        raise UnsafeError(
            f"findings of its planning are not answered: {codes}. "
            "Answer them with `vfplan review`, or give --despite-findings.",
            where=options.fixture,
        )
    if fixture.guidance is not None:
        raise InputError(
            "the fixture guides, and this loop renders forbidden regions only. "
            "Plan it without --guide.",
            where=options.fixture,
        )
    return fixture


def make_engine(options: argparse.Namespace) -> tuple[Any, vfplan.Governor | None]:
    """The engine of the fixture, and a governor unless the options leave it out."""
    fixture = load(options)
    engine = vfplan.ProxyEngine.of(fixture, max_hip_step=MAX_TIP_STEP)
    governor = None
    if not options.no_governor:
        stiffness_n_per_m = float(np.max(fixture.stiffness))
        governor = vfplan.Governor.of(vfplan.read_robot(ARM), stiffness_n_per_m, torques=True)
    return engine, governor


def check_binding() -> None:
    """Refuse to go on without Franka's own binding."""
    try:
        import pylibfranka  # noqa: F401
    except ImportError:
        raise MissingExtra(
            "pylibfranka is not installed. Run `make franka-env`, and this file with "
            "`.venv-franka/bin/python`."
        ) from None


def describe_bad_start(path: str, tip: np.ndarray, status: Status) -> str:
    """Why the loop does not start with this tip, and what to do."""
    x, y, z = tip
    if status & Status.INSIDE:
        return (
            f"{path}: the tip, at ({x:.4f}, {y:.4f}, {z:.4f}) m, is inside the fixture, "
            "whose force would push the arm. Lead the arm out by hand, and start again."
        )
    return (
        f"{path}: the tip, at ({x}, {y}, {z}) m, is no position that can be rendered. "
        "Check the arm's connection and its state."
    )


def main(words: list[str]) -> int:
    """Read a fixture, and render it on the arm."""
    options = parse(words)
    try:
        engine, governor = make_engine(options)
        check_binding()
        if options.log is not None:
            check_log(options.log)
    except VfplanError as error:
        print(error, file=sys.stderr)
        return error.exit_code

    try:
        robot = connect(
            options.robot, options.collision_torque, options.collision_force,
            is_real_time=not options.no_real_time,
        )  # fmt: skip
        model = robot.load_model()
        tip = read_tip(robot.read_once(), options.tool_tip)
    except RuntimeError as error:  # as all errors of pylibfranka are
        print(
            f"{options.robot}: the arm is not ready: {str(error).splitlines()[0]} "
            "Check its address and that FCI is enabled.",
            file=sys.stderr,
        )
        return 1
    engine.reset(tip)
    start = engine.step(tip)
    if start.status != 0:
        print(describe_bad_start(options.fixture, tip, start.status), file=sys.stderr)
        return 1
    log = [log_row(0.0, tip, start, np.zeros(3))]
    # From now on a signal ends the loop and not the program, so that the torques fade.
    stop_signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda caught, _: stop_signals.append(caught))
    ticks = round(RATE_HZ * options.seconds)
    run = render(
        robot, model, engine, governor, ticks, stop_signals=stop_signals, log=log,
        tip_offset=options.tool_tip,
    )  # fmt: skip

    print(
        f"{run.ticks} ticks, force up to {run.force_max_n:.2f} N, "
        f"torque steps up to {run.torque_step_nm:.3f} N m"
    )
    bits = [f"{name} in {count} tick{'s' * (count != 1)}" for name, count in run.bits.items()]
    print("status: " + (", ".join(bits) or "all well"))
    if options.log is not None:
        try:
            write_log(options.log, log, governor is not None)
        except OutputError as error:
            print(error, file=sys.stderr)
            return error.exit_code
    if run.error is not None:
        print(run.error, file=sys.stderr)
        return 128 + stop_signals[0] if stop_signals else 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
