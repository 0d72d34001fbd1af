"""`vfplan replay`: what a controller would have rendered over a recorded session."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from vfplan.cli import options, values
from vfplan.cli.options import FIXTURE, SESSION, option
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.replay_text import failed_line, next_step, replay_text
from vfplan.cli.run import Report, command, command_line, progress, rough_ticks
from vfplan.cli.values import FILE, Number, Numbers, Parsed, Real, Whole

from vfplan.io.files import parse_decimal
from vfplan.io.staging import write_whole


def _bound(text: str) -> tuple[str, float]:
    """A number of the report and its limit."""
    name, _, number = text.partition("=")
    try:
        return name, parse_decimal(number)
    except ValueError:
        raise ValueError(f"{text!r}; NAME=NUMBER wanted, e.g. force_max_n=20") from None


BOUND, SENSES = Parsed("NAME=NUMBER", _bound), ("at_most", "at_least")
OPTIONS = options.taking(
    option("--csv", "csv_out", type=values.CSV, help="Per-tick result as CSV."),
    option("--report", type=FILE, metavar="DIR",
           help="Folder for one self-contained HTML report with pictures."),
    option("--image", type=FILE, metavar="IMAGE",
           help="The planned slice: the report maps depth back onto it."),
    option("--rule", type=click.Choice(["robust", "paper", "exact", "both"]),
           help="How the proxy moves; `both`: robust and paper side by side.  [default: exact "
           "where the fixture holds lines and arcs, else robust; paper with --engine reference]"),
    option("--engine", type=click.Choice(["native", "reference"]), default="native", is_eager=True,
           help="The controller's own core, or the paper's algorithms in NumPy, which have the "
           "rule `paper` only."),
    options.UNITS,
    option("--frame", default="robot_base", help="Frame of the session's positions."),
    option("--topic", help="ROS bag: the topic; needed when several hold positions."),
    option("--field", help="ROS bag: the message's field, e.g. pose or O_T_EE."),
    option("--tool-tip", type=options.VECTOR, help="ROS bag: the tip in the pose's frame [m]."),
    option("--rate", "rate_hz", type=Number("HZ"), help="Resample the session by straight lines."),
    option("--poses", type=FILE, metavar="POSES.csv",
           help="Where the moving fixture was: t,x,y,z,qw,qx,qy,qz, and `arrived` where a pose "
           "came later than its time."),
    option("--events", type=FILE, metavar="EVENTS.csv",
           help="Exchanges and edits of the fixture, each with its tick."),
    option("--pose-limits", type=Numbers(3, metavar="AGE,SPEED,TURN"),
           help="With --poses: age from which a pose is stale, and how fast the frame goes and "
           "turns at most [s, m/s, rad/s], as in the controller.  [default: 0.1,0.25,1]"),
    option("--pivot", type=options.VECTOR,
           help="With --poses: the point of the fixture whose speed is bounded [m].  [default: "
           "0,0,0]"),
    options.robot("Hold forces, force steps and speeds against a robot's limits."),
    option("--governor", type=Numbers(2, metavar="[STEP,MAX]", word="robot"), is_flag=False,
           flag_value="robot",
           help="Hold the force and its change a tick to STEP,MAX [N], as the governor in a "
           "controller does; without numbers to the limits of --robot, or of franka."),
    option("--at-most", type=BOUND, multiple=True,
           help="A check: this number of the report is no larger. Repeatable."),
    option("--at-least", type=BOUND, multiple=True,
           help="A check: this number of the report is no smaller. Repeatable."),
    option("--drop", type=Real(0, 1, max_open=True), metavar="P",
           help="Lossy link: probability that a packet is lost."),
    option("--jitter", "jitter_s", type=Real(0), metavar="MS", **options.MILLI,
           help="Lossy link: samples are up to this much older than their stamp."),
    option("--delay", "delay_ticks", type=Whole(0), metavar="TICKS",
           help="Lossy link: samples arrive this many ticks late."),
    option("--quantise", "quantum_m", type=Real(0, min_open=True), metavar="UM",
           callback=lambda c, p, v: v and v / 1e6,
           help="Lossy link: positions are rounded to multiples of this."),
    option("--seed", type=Whole(0), default=0, help="Lossy link: seed of its random numbers."),
)  # fmt: skip


@command(
    "replay",
    first_screen="-o --csv --report --rule --robot --governor --poses --events --at-most "
    "--at-least --rate --require-signature --json",
)
@FIXTURE
@SESSION
@options.output("Per-tick result, HDF5.", required=False)
@OPTIONS
@options.signature()
def command(fixture, session, output, csv_out, **given) -> Report:
    """Replay SESSION (a recording of HIP positions) against FIXTURE.h5, tick by tick.

    SESSION is a CSV with a header t,x,y,z, an HDF5 or .npz file with time and hip, or a ROS bag.
    Reports contact episodes, forces, penetration, energy and timing; every number is defined in
    docs/replay.md. Exit 1 when a limit that was given does not hold, or when limits were given and
    the tool never touched the fixture; the files are written then too, as the record of it.
    """
    report = given["report"]
    refuse_folder(report)
    if report is None and given["image"] is not None:
        raise click.UsageError("--image is for the pictures of --report DIR")
    with outputs(output, csv_out, report and report / "index.html") as (result, table, index):
        replayed = _replayed(fixture, session, result, table, given)
        if index is not None:
            from vfplan.report.page import page

            text = page(replayed, image=given["image"], command=command_line())
            write_whole(index, [text.encode("utf-8")], overwrite=True)
        text = replay_text(replayed.metrics)
    return Report(
        replayed.metrics,
        text,
        failed=failed_line(replayed.metrics),
        verdict=replayed.verdict,
        next_step=next_step(replayed.metrics),
    )


def _replayed(fixture: Path, session: Path, result: Path | None, table: Path | None,
              given: dict[str, Any]) -> Any:  # fmt: skip
    from vfplan.replaying import Link, replay
    from vfplan.robot import read_robot
    from vfplan.session.events import as_the_loop_saw

    source = _source(session, given)
    poses, events = given["poses"], given["events"]
    if not given["rate_hz"]:
        poses, events = as_the_loop_saw(session, poses, events)
    limits = [(name, sense, limit) for sense in SENSES for name, limit in given[sense]]
    implied = "paper" if given["engine"] == "reference" else None
    rule, robot = given["rule"] or implied, read_robot(given["robot"])
    with progress("replay", source.ticks or rough_ticks(session)) as done, ExitStack() as files:
        writer, sinks = _files(files, result, table, rule)
        # The ticks of both rules are the same ones.
        sinks.append(lambda name, block: done((rule != "both" or name != "paper") * len(block)))
        replayed = replay(
            fixture,
            source,
            rule=rule,
            engine=given["engine"],
            robot=robot,
            link=options.settings(Link, given),
            governor=_governing(given["governor"], robot),
            limits=tuple(limits),
            keep=65536 if given["report"] else 0,
            sinks=sinks,
            trust=options.trust(given),
            poses=poses,
            events=events,
            moving=_moving(given),
        )
        if writer is not None:
            writer.set(replayed.record)
    return replayed


def _moving(given: dict[str, Any]) -> dict[str, Any]:
    """The settings of the moving frame that were given."""
    names = ("max_age_s", "max_speed_m_s", "max_turn_rad_s")
    moving = dict(zip(names, given["pose_limits"] or (), strict=False))
    moving |= {} if given["pivot"] is None else {"pivot": given["pivot"]}
    if moving and given["poses"] is None:
        raise click.UsageError("--pose-limits and --pivot are for a fixture that moves: --poses")
    return moving


def _governing(asked: tuple[float, ...] | None, robot: Any) -> Any:
    """The robot whose limits the governor has; `None`: no governor."""
    from vfplan.robot import read_robot

    if asked is None:
        return None
    robot = robot or read_robot("franka")
    if not asked:
        return robot
    return replace(robot, force_step_limit_n=asked[0], force_limit_n=asked[1])


def _source(session: Path, given: dict[str, Any]) -> Any:
    from vfplan.session import RosOptions, open_session, resampled

    ros = RosOptions(given["topic"], given["field"], given["tool_tip"])
    asked = ros if ros != RosOptions() else None
    source = open_session(session, units=given["units"], frame=given["frame"], ros=asked)
    return resampled(source, given["rate_hz"]) if given["rate_hz"] else source


def _files(
    files: ExitStack, result: Path | None, table: Path | None, rule: str | None
) -> tuple[Any, list[Any]]:
    """The result's writer, and sinks that fill it and the CSV; closed with `files`.

    With rule `both` the paper's ticks go to the group `paper`, and the CSV holds the robust ones.
    """
    from vfplan.session import CsvWriter, ResultWriter

    sinks: list[Any] = []
    second = "paper" if rule == "both" else None
    writer = None
    if result is not None:
        groups = ("",) if second is None else ("", second)
        writer = files.enter_context(ResultWriter(result, {}, groups=groups))
        append = writer.append
        sinks.append(lambda name, block: append(block, second if name == second else ""))
    if table is not None:
        lines = files.enter_context(CsvWriter(table))
        sinks.append(lambda name, block: None if name == second else lines.append(block))
    return writer, sinks
