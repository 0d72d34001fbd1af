"""`vfplan live`: ticks as they come, on a page, in 3D Slicer and in an MCAP file."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from statistics import median
from typing import Any

import click

from vfplan.cli.options import (
    CSV,
    FIXTURE,
    DecimalNumber,
    OutputFile,
    WholeNumber,
    option,
    options_in_order,
)
from vfplan.cli.outputs import is_overwriting
from vfplan.cli.run import CommandResult, command, command_line, noted_signals
from vfplan.display import command_of, count, quoted, wrote
from vfplan.errors import OutputError
from vfplan.io.writing import made_folder, move_into_place, not_written

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
           help="Receive the fixture's poses from an OpenIGTLink server, as PLUS and Slicer are."),
    option("--poses-out", type=CSV, metavar="FILE",
           help="Write these poses at the end, for `replay --poses`."),
    option("--poses-axes", type=click.Choice(["as-sent", "ras"]), default="as-sent",
           help="ras: the poses are of Slicer's world. They are turned into LPS."),
    option("--rate", type=DecimalNumber(1, 1000), default=100.0, metavar="HZ",
           help="Show this many ticks a second."),
    option("--seconds", type=DecimalNumber(0, min_open=True), metavar="S",
           help="Stop after this time [s].  [default: at the end of the result, or on Ctrl-C]"),
    option("--overwrite", is_flag=True, help="Replace the files if they exist."),
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
    servers: list[Any] = []
    writer = receiver = None
    with ExitStack() as stack:
        if openigtlink is not None:
            from vfplan.live.server import Server

            server = Server(scene, openigtlink, feed)
            stack.callback(server.close)
            servers.append(server)
            click.echo(f"vfplan: OpenIGTLink at 127.0.0.1:{server.port}", err=True)
        if web is not None:
            from vfplan.live.server import Web, live_page

            page = Web(*live_page(scene, fixture.name), web, feed)
            stack.callback(page.close)
            servers.append(page)
            click.echo(f"vfplan: page at http://127.0.0.1:{page.port}/", err=True)
        if poses_from is not None:
            from vfplan.live.server import PoseReceiver, write_poses

            receiver = PoseReceiver(poses_from, is_ras=poses_axes == "ras")
            stack.callback(receiver.close)
        if mcap is not None:
            # Nothing deletes this file, so that a recording that is cut off can be replayed.
            part = mcap.with_name(f"{mcap.name}.part")
            if part.exists():
                raise OutputError(
                    "is there, of a recording that was cut off. Replay it, and move it away",
                    where=str(part), code="part-exists",
                )  # fmt: skip
            stack.enter_context(made_folder(mcap.parent))
            try:
                writer = stack.enter_context(McapWriter(part, (scene, rate)))
            except OSError as error:
                raise not_written(part, error) from error
        data, end = pass_on(ticks, feed, writer, seconds, stop_when_full=not (servers or receiver))
    if writer is not None and data["ticks"]:
        move_into_place([(part, mcap)], overwrite=is_overwriting())
        data["mcap"] = str(mcap)
    elif writer is not None:
        part.unlink()

    warnings = []
    if refused := sum(server.refused for server in servers):
        warnings.append(f"{refused} clients were refused: {MAX_CLIENTS} are served at a time")
    if bad := data["bad_datagrams"]:
        why = data["first_bad_datagram"]
        warnings.append(f"{bad} datagrams were left out, the first because {why}")
    text = (
        f"{data['ticks']} ticks, {data['dropped']} dropped by the controller, "
        f"{data['lost_datagrams']} datagrams lost"
    )
    if "mcap" in data:
        text += f"\n{wrote(mcap)}"
    if receiver is not None:
        text += f"\n{len(receiver.poses)} poses from {poses_from}, axes {poses_axes}"
        warnings += pose_warnings(receiver)
        data |= {"poses": len(receiver.poses), "poses_left_out": receiver.left_out.total()}
        if receiver.poses:
            # Without a tick the times count from the first pose.
            zero = feed.zero_s if data["ticks"] else receiver.poses[0][1]
            write_poses(poses_out, receiver, zero, overwrite=is_overwriting())
            text += f"\n{wrote(poses_out)}"
    if not data["ticks"] or (receiver is not None and not receiver.poses):
        missing = (
            f"no pose came from {poses_from}" if data["ticks"] else f"no tick came from {source}"
        )
        return CommandResult(
            data, text, 1, warnings, missing, verdict="nothing to show",
            next_step="check that the sender runs, and sends what the address names",
        )  # fmt: skip
    if writer is not None and writer.full:
        failed = f"{mcap}: {writer.full.strerror}; it holds the first {writer.kept} ticks"
        return CommandResult(
            data, text, 2, warnings, failed, verdict="shown, and recorded in part",
            next_step="free some space, and record again into another file",
        )  # fmt: skip
    verdict = f"shown {end}"
    next_step = f"keep every tick of the next run: {command_line()} --mcap FILE.mcap"
    if writer is not None:
        verdict = f"shown and recorded {end}"
        words = ["replay", fixture, mcap]
        if receiver is not None:
            words += ["--poses", poses_out]
        next_step = f"open {quoted(mcap)} in Foxglove, or replay it: {command_of(*words)}"
    return CommandResult(data, text, 0, warnings, verdict=verdict, next_step=next_step)


def pass_on(
    ticks: Iterator[Any], feed: Any, writer: Any, seconds: float | None, *, stop_when_full: bool
) -> tuple[dict[str, Any], str]:
    """Pass every tick on until the source ends, the time is over, or a signal comes: which."""
    data = {"ticks": 0, "dropped": 0, "lost_datagrams": 0, "bad_datagrams": 0,
            "first_bad_datagram": ""}  # fmt: skip
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
            if stopped():
                end = "until it was stopped"
                break
            if seconds is not None and time.monotonic() - started >= seconds:
                end = f"for {seconds:g} s"
                break
    return data, end


def pose_warnings(receiver: Any) -> list[str]:
    """What did not come as a pose, and why."""
    why = "the connection of the poses ended, or held no OpenIGTLink of version 1 or 2"
    warnings = [f"{why}, and was not made again"] if receiver.has_ended else []
    if receiver.reconnected:
        warnings.append(f"{why}, and was made again {count(receiver.reconnected, 'time')}")
    for why, poses in receiver.left_out.items():
        warnings.append(f"{count(poses, 'pose')} left out: {why}")
    if not receiver.poses and receiver.other_devices:
        warnings.append("poses came of " + ", ".join(sorted(receiver.other_devices)))
    delay_s = median([received - measured for measured, received, _ in receiver.poses] or [0])
    if abs(delay_s) > MAX_POSE_DELAY_S:
        warnings.append(f"poses came {delay_s:.3g} s after their own time. Set both clocks alike")
    return warnings
