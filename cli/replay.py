"""`vfplan replay`: what a controller would have rendered over a recorded session."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import click
from vfplan.cli import options
from vfplan.cli.next_commands import file_beside, page_shows, review_command
from vfplan.cli.options import FILE, DecimalNumber, WholeNumber, number_of, option, options_in_order
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import CommandResult, command, command_line, progress, rough_ticks

from vfplan.display import Report, command_of, count, in_singular, millimetres, quoted, wrote
from vfplan.io.files import parse_decimal
from vfplan.io.writing import not_written, write_whole
from vfplan.settings import settings_from_options

# Scenes a second in the file for viewers.
VIEWER_RATE_HZ = 100.0

# Number of ticks that are kept for the pictures of `--report`.
TICKS_OF_REPORT = 65536


def parse_limit(text: str) -> tuple[str, float]:
    """`NAME=NUMBER`: a number of the report and its limit."""
    name, _, number = text.partition("=")
    try:
        return name, parse_decimal(number)
    except ValueError:
        raise ValueError(f"{text!r} is no limit. Type NAME=NUMBER, e.g. force_max_n=20") from None


LIMIT = options.Parsed("NAME=NUMBER", parse_limit)

LINK_OPTIONS = options_in_order(
    option("--drop", type=DecimalNumber(0, 1, max_open=True), metavar="P",
           help="Lossy link: lose each packet with this probability."),
    option("--jitter", "jitter_s", type=number_of("MS", 1e-3, least=0),
           help="Lossy link: delay each sample by up to this time, at random [ms]."),
    option("--delay", "delay_ticks", type=WholeNumber(0), metavar="TICKS",
           help="Lossy link: delay all samples by this many ticks."),
    option("--quantise", "quantum_m", type=DecimalNumber(0, min_open=True), metavar="UM",
           # A division keeps 10 µm the number that 1e-5 is.
           callback=lambda _ctx, _param, value: None if value is None else value / 1e6,
           help="Lossy link: round positions to multiples of this [µm]."),
    option("--seed", type=WholeNumber(0), metavar="N", default=0,
           help="Lossy link: seed of its random numbers."),
)  # fmt: skip
MOTION_OPTIONS = options_in_order(
    option("--poses", type=FILE, metavar="POSES.csv",
           help="Move the fixture by these poses: t,x,y,z,qw,qx,qy,qz [s, --units], and `arrived` "
           "for the time when the loop got the pose."),
    option("--events", type=FILE, metavar="EVENTS.csv",
           help="Exchange and edit the fixture at the ticks of this file."),
    option("--pose-limits", type=options.numbers_of(3, metavar="AGE,SPEED,TURN"),
           help="With --poses: the age at which a pose is stale, and the largest speed and turn of "
           "the frame [s, m/s, rad/s].  [default: 0.1,0.25,1]"),
    option("--pivot", type=options.VECTOR,
           help="With --poses: the point of the fixture whose speed is bounded [m].  [default: "
           "0,0,0]"),
)  # fmt: skip
SESSION_OPTIONS = options_in_order(
    options.UNITS,
    option("--frame", metavar="NAME",
           help="Frame of the session's positions, or the frame_id of a ROS bag's messages.  "
           "[default: robot_base]"),
    option("--child-frame", metavar="NAME",
           help="Read the messages of this child_frame_id of a ROS bag."),
    option("--sender", type=WholeNumber(1), metavar="N",
           help="Read this sender alone, where several share a topic of a ROS bag."),
    option("--time", type=click.Choice(["header", "log"]),
           help="Take a ROS bag's times from the messages' headers, or from its log.  [default: "
           "header, where every message has one]"),
    option("--skip-unordered", is_flag=True,
           help="Sort samples however many are out of order, and leave doubled ones out."),
    option("--row-major", is_flag=True, help="Read a ROS bag's matrices row by row."),
    option("--topic", metavar="NAME",
           help="Read this topic of a ROS bag. Needed if several topics hold positions."),
    option("--field", metavar="NAME",
           help="Read this field of a ROS bag's messages, e.g. pose or O_T_EE."),
    option("--tool-tip", type=options.VECTOR,
           help="Place of the tip in the frame of a ROS bag's poses [m]."),
    option("--rate", "rate_hz", type=number_of("HZ"),
           help="Resample the session to this rate by straight lines [Hz]."),
)  # fmt: skip


@command(
    "replay",
    first_screen="-o --csv --mcap --report --rule --robot --governor --poses --events --at-most "
    "--at-least --rate --require-signature --json",
)
@options.FIXTURE
@options.SESSION
@options_in_order(
    options.output_option("Write the result of each tick to this HDF5 file.", required=False),
    option("--csv", "csv_out", type=options.CSV, help="Write the result of each tick as CSV."),
    option("--mcap", type=options.OutputFile(".mcap"), metavar="FILE",
           help="Write ticks and scene for Foxglove and Rerun into this MCAP file."),
    option("--report", type=FILE, metavar="DIR",
           help="Write an HTML report with pictures into this folder."),
    option("--image", type=FILE, metavar="IMAGE",
           help="Draw the depth on this planned slice, in the report."),
    option("--rule", type=click.Choice(["robust", "paper", "exact", "both"]),
           help="Rule by which the proxy moves. `both` compares robust with paper.  [default: "
           "exact if the fixture has lines and arcs, otherwise robust]"),
    option("--engine", type=click.Choice(["native", "reference"]), default="native", is_eager=True,
           help="Use the engine of the controller, or the paper's algorithms in NumPy, which "
           "render rule paper only."),
    SESSION_OPTIONS,
    MOTION_OPTIONS,
    options.robot_option("Check forces, force steps and speeds by the limits of this robot."),
    option("--governor", is_flag=False,
           type=options.numbers_of(2, metavar="[STEP,MAX]", word="robot"),
           flag_value="robot",
           help="Limit the force step and the force to STEP,MAX [N], or without numbers to the "
           "limits of --robot or franka."),
    option("--at-most", type=LIMIT, multiple=True,
           help="Require that this number of the report is no larger; repeatable."),
    option("--at-least", type=LIMIT, multiple=True,
           help="Require that this number of the report is no smaller; repeatable."),
    LINK_OPTIONS,
    options.signature_options(),
)  # fmt: skip
def vfplan_replay(fixture, session, output, csv_out, **arguments) -> CommandResult:
    """Replay SESSION (a recording of HIP positions) against FIXTURE.h5, tick by tick.

    SESSION is a CSV with a header t,x,y,z, an HDF5 or .npz file with time and hip, or a ROS bag.
    docs/replay.md defines every number of the report. The exit code is 1 if a limit does not hold,
    or if there are limits and the tool never touched the fixture. The files are written all the
    same.
    """
    from vfplan.replaying.findings import verdict_sentence

    report_folder = arguments["report"]
    index_path = None
    if report_folder is not None:
        refuse_folder(report_folder)
        index_path = report_folder / "index.html"
    else:
        options.refuse_unused("without --report DIR", "image")
    if arguments["drop"] is None and arguments["jitter_s"] is None:
        options.refuse_unused("without --drop or --jitter", "seed")
    if arguments["poses"] is None:
        options.refuse_unused("without --poses POSES.csv", "pose_limits", "pivot")
    mcap = arguments["mcap"]
    if mcap is not None and (arguments["poses"] or arguments["events"]):
        raise click.UsageError("--mcap shows a fixture at rest. Leave --poses and --events out")
    written = [path for path in (output, csv_out, mcap, index_path) if path is not None]
    with outputs(output, csv_out, index_path, mcap) as (result, table, index, shown):
        arguments["mcap"] = shown
        replayed = replay_with_outputs(fixture, session, result, table, arguments)
        if index is not None:
            from vfplan.report.page import page

            text = page(replayed, image=arguments["image"], command=command_line())
            write_whole(index, [text.encode("utf-8", "backslashreplace")], overwrite=True)
    metrics = replayed.metrics
    warnings = list(options.not_compared(metrics["fixture"], arguments).values())
    if unanswered := len(replayed.fixture.open_findings):
        image = None if replayed.fixture.image is None else fixture.parent
        has_page = page_shows(replayed.fixture, has_slice=image is not None)
        review = review_command(fixture, image, has_page=has_page)
        what = f"Nobody has answered {count(unanswered, 'finding')} of this fixture."
        warnings.append(f"{what} Answer first: {review}")
    return CommandResult(
        metrics,
        "\n".join([replay_text(metrics), *map(wrote, written)]),
        warnings=warnings,
        failed=failed_line(metrics),
        verdict=f"{replayed.verdict}, {verdict_sentence(metrics)}",
        next_step=next_step(metrics, fixture, arguments["robot"], index_path, bool(written)),
    )


def replay_with_outputs(
    fixture: Path, session: Path, result_path: Path | None, csv_path: Path | None, arguments: dict
) -> Any:
    """Replay a session as the options say, and write each tick to the files that are wanted.

    With the rule `both` they hold the robust ticks.
    """
    from vfplan.bundle.read import read_fixture
    from vfplan.replaying.link import Link
    from vfplan.replaying.replay import replay
    from vfplan.robot import read_robot
    from vfplan.session.bags import McapWriter, RosOptions, as_ticks
    from vfplan.session.events import as_the_loop_saw, read_poses
    from vfplan.session.read import open_session
    from vfplan.session.result import CsvWriter, ResultWriter
    from vfplan.session.session import resampled

    # The session, and what happens to the fixture during it.
    source = open_session(
        session, units=arguments["units"], frame=arguments["frame"] or "robot_base",
        ros=settings_from_options(RosOptions, arguments),
        skip_unordered=arguments["skip_unordered"],
    )  # fmt: skip
    poses, events = arguments["poses"], arguments["events"]
    if poses is not None:
        poses = read_poses(poses, arguments["units"])
    if arguments["rate_hz"]:
        source = resampled(source, arguments["rate_hz"])
    else:
        poses, events = as_the_loop_saw(session, poses, events)
    names = ("max_age_s", "max_speed_m_s", "max_turn_rad_s")
    moving = dict(zip(names, arguments["pose_limits"] or (), strict=False))
    if arguments["pivot"] is not None:
        moving["pivot"] = arguments["pivot"]

    # The rule, and the limits of the robot and of the caller.
    rule = arguments["rule"] or ("paper" if arguments["engine"] == "reference" else None)
    robot = read_robot(arguments["robot"])
    governed_robot = None
    if arguments["governor"] is not None:
        governed_robot = robot or read_robot("franka")
        if arguments["governor"]:
            step_n, max_n = arguments["governor"]
            governed_robot = replace(governed_robot, force_step_limit_n=step_n, force_limit_n=max_n)
    senses = ("at_most", "at_least")
    limits = [(name, sense, limit) for sense in senses for name, limit in arguments[sense]]

    with ExitStack() as files:
        tables = []
        if result_path is not None:
            tables.append(files.enter_context(ResultWriter(result_path, {})))
        if csv_path is not None:
            tables.append(files.enter_context(CsvWriter(csv_path)))
        viewer = None
        # When a bag began [s since 1970]; 0 for a session that does not say.
        start = str(source.notes.get("start_utc", "1970-01-01T00:00:00Z"))
        start_s = datetime.fromisoformat(start).timestamp()
        if arguments["mcap"] is not None:
            scene = read_fixture(fixture)
            viewer = files.enter_context(McapWriter(arguments["mcap"], (scene, VIEWER_RATE_HZ)))
        done = files.enter_context(progress("replay", rough_ticks(session)))

        def take(name: str, block: Any) -> None:
            """Write a block of ticks of the rule of this name."""
            if rule == "both" and name == "paper":
                return
            for table in tables:
                table.append(block)
            if viewer is not None:
                viewer.write(as_ticks(block, viewer.kept), start_s + float(block.time[-1]))
            # The ticks of both rules are the same ones.
            done(len(block))

        replayed = replay(
            fixture, source, rule=rule, engine=arguments["engine"], robot=robot,
            link=settings_from_options(Link, arguments), governor=governed_robot,
            limits=tuple(limits), sinks=[take], trust=options.trust(arguments),
            keep=TICKS_OF_REPORT if arguments["report"] is not None else 0,
            poses=poses, events=events, moving=moving,
        )  # fmt: skip
        if result_path is not None:
            tables[0].set(replayed.record)
    if viewer is not None and viewer.full:
        raise not_written(arguments["mcap"], viewer.full)
    return replayed


# Lines of the report on a screen, of all replays and of those with this part; a number of
# `NUMBERS` stands there with its unit, and any other as it is in the report.
FIGURES = {
    "penetration_max_m": "penetration  max {penetration_max_m}",
    "force_max_n": "force        max {force_max_n}, step max {force_step_max_n}",
    "clearance_min_m": "clearance    min {clearance_min_m}; {entrenched_ticks} ticks inside",
    "guide": "guide        tube of {tube}: up to {lateral_max_m} from the guide's line; outside "
             "for {guide[outside_s]:.3f} s, force max {guide[force_max_n]:.3f} N",
    "exchanges": "changes      {exchanges} exchanges, {edits} points edited; {changing_ticks} "
                 "ticks until the force was there",
    "fixture_energy_j": "motion       gave the hand {fixture_energy_j} besides; poses up to "
                        "{pose_age_max_s} old, {stale_ticks} ticks stale, {poses_refused} poses "
                        "refused",
    "governor": "governor     {governor[force_step_n]:g} N a tick, {governor[force_max_n]:g} N at "
                "most: up to {governor[held_back_max_n]:.3f} N held back in "
                "{governor[held_ticks]} ticks, of an engine that steps by "
                "{governor[engine_force_step_max_n]:.3f} N",
}  # fmt: skip


def replay_text(report: Report) -> str:
    """The report of a replay on a screen."""
    from vfplan.replaying.findings import check_text, guides_alone, untested_reason
    from vfplan.replaying.link import apart_text, link_text
    from vfplan.replaying.metrics import episode_count

    engine = f" ({report['engine']} engine)" if report["engine"] != "native" else ""
    untested = untested_reason(report)
    lines = [f"NOT TESTED: {untested}"] if untested else []
    rule = "guide" if guides_alone(report) else f"rule {report['rule']}{engine}"
    lines.append(
        f"{rule}: {report['ticks']} ticks at "
        f"{report['session']['rate_hz']:.6g} Hz, {report['duration_s']:.3f} s, "
        f"{report['contact_ticks']} in contact, {count(episode_count(report), 'episode')}"
    )
    lines += figure_lines(report)
    if "paper" in report:
        lines += ["rule paper, side by side:", *figure_lines(report["paper"], "  ")]
        lines.append(apart_text(report["apart"]))
    if "link" in report:
        lines.append(f"lossy link   {link_text(report['link'])}")
    lines += ["{severity}: {code}: {message}".format(**found) for found in report["findings"]]
    lines += [
        f"{'pass' if check['pass'] else 'FAIL'}: {check_text(check)}"
        for check in report.get("checks", [])
    ]
    return in_singular("\n".join(lines))


def figure_lines(report: Report, indent: str = "") -> list[str]:
    """The figures of one rule."""
    from vfplan.replaying.metrics import NUMBERS

    told = report | {
        number.key: f"{number.text(report[number.key])} {number.unit}".rstrip()
        for number in (number.suiting(report.get(number.key)) for number in NUMBERS)
        if number.key in report
    }
    figures = dict(FIGURES)
    if "guide" in report:
        told["tube"] = millimetres(report["guide"]["radius_m"])
        if not report["arc_m"]:
            figures["guide"] = "guide        never had hold of the tip"
    return [indent + line.format(**told) for key, line in figures.items() if key in report]


def failed_line(report: Report) -> str:
    """Why the exit code is 1; empty where it is 0."""
    from vfplan.replaying.findings import check_text, untested_reason

    checks = report.get("checks", [])
    if checks and report["verdict"] == "not-tested":
        return in_singular(f"not tested: {untested_reason(report)}")
    return "; ".join(check_text(check) for check in checks if not check["pass"])


def next_step(
    report: Report, fixture: Path, robot: Path | None, index_page: Path | None,
    wrote_files: bool,
) -> str:  # fmt: skip
    """What to do after the replay of a fixture; fixture and robot are named as they were typed.

    index_page: the page of the report, if one was made
    wrote_files: whether the same command finds its own files when it is given again
    """
    from vfplan.replaying.findings import has_touched, untested_reason

    again = command_line(overwrite=wrote_files)
    if "start_depth_m" in report:
        return "replay a session that begins outside the mesh; check --units and the registration"
    if not has_touched(report):
        return "replay a session that touches the fixture; check --units and the session's frame"
    if untested_reason(report):
        return f"replay a session that is mended: {untested_reason(report)}"
    if "checks" not in report:
        return f"hold it against a robot's limits, such as: {again} --robot franka"
    if report["verdict"] == "fail":
        if index_page is not None:
            return f"look at the ticks that failed: {index_page}"
        folder = quoted(file_beside(fixture, "report", ""))
        return f"draw the session tick by tick: {again} --report {folder}"
    return command_of("stability", fixture, "--robot", str(robot or "franka"))
