"""`vfplan live`: ticks as they come, on a page, in 3D Slicer and in an MCAP file."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from statistics import median
from typing import Any

import click

from vfplan.cli.options import (
    CSV,
    FIXTURE,
    OVERWRITE,
    DecimalNumber,
    OutputFile,
    WholeNumber,
    option,
    options_in_order,
)
from vfplan.cli.outputs import is_overwriting
from vfplan.cli.run import CommandResult, command, command_line, noted_signals
from vfplan.display import Report, command_of, count, in_singular, quoted, wrote
from vfplan.errors import OutputError
from vfplan.io.writing import made_folder, move_into_place, not_written, write_whole

# A source that sends nothing for so long [s] is told once.
SILENT_TOLD_S = 5.0

# Poses that come later than this [s], or before their own time by as much, tell of two clocks.
MAX_POSE_DELAY_S = 0.5


@command("live")
@FIXTURE
@click.argument("source", metavar="RESULT.h5|udp://HOST:PORT")
@options_in_order(
    option("--openigtlink", type=WholeNumber(0, 65535), metavar="PORT",
           help="Serve OpenIGTLink on 127.0.0.1 at this port. 18944 is usual; 0 takes a free one."),
    option("--web", type=WholeNumber(0, 65535), metavar="PORT",
           help="Serve a page to watch on 127.0.0.1 at this port, e.g. 8080; 0 takes a free one."),
    option("--mcap", type=OutputFile(".mcap"), metavar="FILE",
           help="Record every tick in this file."),
    option("--poses-from", metavar="igtl://HOST:PORT/DEVICE",
           help="Receive the fixture's poses from an OpenIGTLink server, such as PLUS or Slicer."),
    option("--poses-out", type=CSV, metavar="FILE",
           help="Write these poses at the end, for `replay --poses`."),
    option("--poses-axes", type=click.Choice(["as-sent", "ras"]), default="as-sent",
           help="ras: the poses are of Slicer's world. They are turned into LPS."),
    option("--rate", type=DecimalNumber(1, 1000), default=100.0, metavar="HZ",
           help="Show this many ticks a second."),
    option("--seconds", type=DecimalNumber(0, min_open=True), metavar="S",
           help="Stop after this time [s].  [default: at the end of the result, or on Ctrl-C]"),
    OVERWRITE,
)  # fmt: skip
def vfplan_live(
    fixture, source, openigtlink, web, mcap, poses_from, poses_out, poses_axes, rate, seconds
) -> CommandResult:
    """Show the ticks of a controller, or of a result of `vfplan replay -o` at its own pace.

    A controller sends with vfplan/telemetry.hpp to udp://HOST:PORT. After Ctrl-C the MCAP file is
    complete; until then it is FILE.mcap.part.
    """
    if (poses_from is None) != (poses_out is None):
        raise click.UsageError("give --poses-from and --poses-out together, or neither")
    if (openigtlink, web, mcap, poses_out) == (None,) * 4:
        raise click.UsageError("no output is asked for. Give --openigtlink, --web or --mcap")
    from vfplan.bundle.read import read_sealed
    from vfplan.engine.proxy import check_renderable
    from vfplan.live.sources import MAX_CLIENTS, PositionStream, stream_of
    from vfplan.session.bags import McapWriter

    scene, seal = read_sealed(fixture)
    check_renderable(scene)
    ticks = stream_of(source, seal["sha256"])

    feed = PositionStream(rate)
    servers = []
    writer = receiver = poses_file = None
    with ExitStack() as stack:
        parts = {path: started_part(stack, path) for path in (mcap, poses_out) if path is not None}
        if openigtlink is not None:
            from vfplan.live.server import Server

            servers.append(stack.enter_context(closing(Server(scene, openigtlink, feed))))
            click.echo(f"vfplan: OpenIGTLink at 127.0.0.1:{servers[-1].port}", err=True)
        if web is not None:
            from vfplan.live.server import Web

            servers.append(stack.enter_context(closing(Web(scene, fixture.name, web, feed))))
            click.echo(f"vfplan: page at http://127.0.0.1:{servers[-1].port}/", err=True)
        sources = {"tick": feed}
        if poses_from is not None:
            from vfplan.live.server import POSE_HEADER, PoseReceiver, pose_rows

            receiver = PoseReceiver(poses_from, is_ras=poses_axes == "ras")
            sources["pose"] = stack.enter_context(closing(receiver))
        try:
            if receiver is not None:
                poses_file = stack.enter_context(parts[poses_out].open("wb", buffering=0))
                poses_file.write(POSE_HEADER.encode())
            if mcap is not None:
                writer = stack.enter_context(McapWriter(parts[mcap], (scene, rate)))
        except OSError as error:
            raise not_written(Path(error.filename or next(iter(parts))), error) from error
        data, told, end = pass_on(
            ticks, feed, writer, sources, poses_file, seconds,
            stop_when_full=not (servers or receiver),
        )  # fmt: skip
    if writer is not None and data["ticks"]:
        move_into_place([(parts[mcap], mcap)], overwrite=is_overwriting())
        data["mcap"] = str(mcap)
    elif writer is not None:
        parts[mcap].unlink()

    warnings = [f"no {what} came for {SILENT_TOLD_S:g} s or longer" for what in told]
    if refused := sum(server.refused for server in servers):
        warnings.append(f"{refused} clients were refused: {MAX_CLIENTS} are served at a time")
    if bad := data["bad_datagrams"]:
        why = data["first_bad_datagram"]
        warnings.append(f"{bad} datagrams were left out, the first because {why}")
    text = "{ticks} ticks, {dropped} dropped by the controller, {lost_datagrams} datagrams lost"
    text = in_singular(text.format(**data))
    if "mcap" in data:
        text += f"\n{wrote(mcap)}"
    if receiver is not None:
        text += f"\n{len(receiver.poses)} poses from {poses_from}, axes {poses_axes}"
        warnings += pose_warnings(receiver)
        data |= {"poses": len(receiver.poses), "poses_left_out": receiver.left_out.total()}
        if receiver.poses:
            # Without a tick the times count from the first pose.
            zero = feed.zero_s if data["ticks"] else receiver.poses[0][1]
            table = POSE_HEADER + pose_rows(receiver.poses, zero)
            write_whole(poses_out, [table.encode()], overwrite=is_overwriting())
            text += f"\n{wrote(poses_out)}"
        parts[poses_out].unlink()
    exit_code, failed, verdict = 0, "", f"shown {end}"
    next_step = f"keep every tick of the next run: {command_line()} --mcap FILE.mcap"
    if not data["ticks"] or (receiver is not None and not receiver.poses):
        exit_code, verdict = 1, "nothing to show"
        failed = f"no tick came from {source}"
        if data["ticks"]:
            failed = f"no pose came from {poses_from}"
        next_step = "check that the sender runs, and sends what the address names"
    elif writer is not None and writer.full:
        exit_code, verdict = 2, "shown, and recorded in part"
        failed = f"{mcap}: {writer.full.strerror}; it holds the first {count(writer.kept, 'tick')}"
        next_step = "free some space, and record again into another file"
    elif writer is not None:
        verdict = f"shown and recorded {end}"
        words = ["replay", fixture, mcap]
        if receiver is not None:
            words += ["--poses", poses_out]
        next_step = f"open {quoted(mcap)} in Foxglove, or replay it: {command_of(*words)}"
    return CommandResult(
        data, text, exit_code, warnings, failed, verdict=verdict, next_step=next_step
    )


def started_part(stack: ExitStack, path: Path) -> Path:
    """The name of an output while it grows, in a folder that is made.

    Nothing deletes this file, so that a recording that is cut off can be replayed.
    """
    part = path.with_name(f"{path.name}.part")
    if part.exists():
        message = "is there, of a recording that was cut off. Replay it, and move it away"
        raise OutputError(message, where=part, code="part-exists")
    stack.enter_context(made_folder(path.parent))
    return part


def pass_on(
    ticks: Iterator[Any], feed: Any, writer: Any, sources: dict[str, Any], poses_file: Any,
    seconds: float | None, *, stop_when_full: bool,
) -> tuple[Report, list[str], str]:  # fmt: skip
    """Pass every tick on until the source ends, the time is over, or a signal comes.

    sources: what comes, and what takes it
    poses_file: where poses are written as they come; `None`: nowhere

    The counts, which sources were silent for long, and why it ended.
    """
    data = {"ticks": 0, "dropped": 0, "lost_datagrams": 0, "bad_datagrams": 0,
            "first_bad_datagram": ""}  # fmt: skip
    told = []
    started, end = time.monotonic(), "to the end"
    with noted_signals() as stopped:
        for portion, counts in ticks:
            data |= counts
            if len(portion):
                data["ticks"] += len(portion)
                feed.put(portion)
                if writer is not None:
                    writer.write(portion, time.time())
                    if writer.full and stop_when_full:
                        break
            # Before the first tick nothing tells the times of poses on its clock.
            # Where they do not fit, the table of all poses says so at the end.
            if poses_file is not None and data["ticks"]:
                with suppress(OSError):
                    poses_file.write(sources["pose"].new_rows(feed.zero_s).encode())
            feed.silent = tell_silent(sources, told)
            if stopped():
                end = "until it was stopped"
                break
            if seconds is not None and time.monotonic() - started >= seconds:
                end = f"for {seconds:g} s"
                break
    return data, told, end


def tell_silent(sources: dict[str, Any], told: list[str]) -> str:
    """Say once of each source that it is silent; returns what is silent now, in words."""
    since = time.monotonic() - SILENT_TOLD_S
    silent = [what for what, source in sources.items() if source.heard_s <= since]
    words = ", ".join(f"no {what} has come for {SILENT_TOLD_S:g} s" for what in silent)
    if not set(silent) <= set(told):
        told[:] = sorted({*told, *silent})
        click.echo(f"vfplan: {words}", err=True)
    return words


def pose_warnings(receiver: Any) -> list[str]:
    """What did not come as a pose, and why."""
    why = "the connection of the poses ended, or held no OpenIGTLink of version 1 or 2"
    warnings = [f"{why}, and was not made again"] if receiver.has_ended else []
    if receiver.reconnected:
        warnings.append(f"{why}, and was made again {count(receiver.reconnected, 'time')}")
    warnings += [f"{count(n, 'pose')} left out: {why}" for why, n in receiver.left_out.items()]
    if not receiver.poses and receiver.other_devices:
        warnings.append("poses came of " + ", ".join(sorted(receiver.other_devices)))
    delay_s = median([received - measured for measured, received, _ in receiver.poses] or [0])
    if abs(delay_s) > MAX_POSE_DELAY_S:
        warnings.append(f"poses came {delay_s:.3g} s after their own time. Set both clocks alike")
    return warnings
