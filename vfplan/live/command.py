"""`vfplan live`: ticks as they come, on a page, in 3D Slicer and in an MCAP file."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from vfplan.cli.options import (
    FIXTURE,
    DecimalNumber,
    OutputFile,
    WholeNumber,
    option,
    options_in_order,
)
from vfplan.cli.outputs import is_overwriting
from vfplan.cli.run import CommandResult, command, command_line, noted_signals
from vfplan.errors import OutputError
from vfplan.io.writing import made_folder, move_into_place, not_written


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
    option("--rate", type=DecimalNumber(1, 1000), default=100.0, metavar="HZ",
           help="Show this many ticks a second."),
    option("--seconds", type=DecimalNumber(0, min_open=True), metavar="S",
           help="Stop after this time [s].  [default: at the end of the result, or on Ctrl-C]"),
    option("--overwrite", is_flag=True, help="Replace the MCAP file if it exists."),
)  # fmt: skip
def vfplan_live(fixture, source, openigtlink, web, mcap, rate, seconds) -> CommandResult:
    """Show the ticks of a controller, or of a result of `vfplan replay -o` at its own pace.

    A controller sends with vfplan/telemetry.hpp to udp://HOST:PORT. After Ctrl-C the MCAP file is
    complete; until then it is FILE.mcap.part.
    """
    if openigtlink is None and web is None and mcap is None:
        raise click.UsageError("no output is asked for. Give --openigtlink, --web or --mcap")
    from vfplan.bundle.read import read_fixture
    from vfplan.live.sources import MAX_CLIENTS, PositionStream, stream_result, stream_udp
    from vfplan.session.bags import McapWriter

    scene = read_fixture(fixture)
    ticks = stream_udp(source) if source.startswith("udp:") else stream_result(Path(source))

    feed = PositionStream(rate)
    servers: list[Any] = []
    writer = None
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
        data = pass_on(ticks, feed, writer, seconds, stop_when_full=not servers)
    if writer is not None and data["ticks"]:
        move_into_place([(part, mcap)], overwrite=is_overwriting())
    elif writer is not None:
        part.unlink()

    refused = sum(server.refused for server in servers)
    warning = f"{refused} clients were refused: {MAX_CLIENTS} are served at a time"
    warnings = [warning] if refused else []
    if data["bad_datagrams"]:
        warnings.append(
            f"{data['bad_datagrams']} datagrams were left out, the first because "
            f"{data['first_bad_datagram']}"
        )
    text = (
        f"{data['ticks']} ticks, {data['dropped']} dropped by the controller, "
        f"{data['lost_datagrams']} datagrams lost"
    )
    if not data["ticks"]:
        return CommandResult(
            data, text, 1, warnings, f"no tick came from {source}", verdict="nothing to show",
            next_step="check that the controller runs, and sends to this address",
        )  # fmt: skip
    if writer is None:
        return CommandResult(
            data, text, warnings=warnings, verdict="shown to the end",
            next_step=f"keep every tick of the next run: {command_line()} --mcap FILE.mcap",
        )  # fmt: skip
    data["mcap"] = str(mcap)
    text += f"\nwrote {mcap}"
    if writer.full:
        failed = f"{mcap}: {writer.full.strerror}; it holds the first {writer.kept} ticks"
        return CommandResult(
            data, text, 2, warnings, failed, verdict="shown, and recorded in part",
            next_step="free some space, and record again into another file",
        )  # fmt: skip
    return CommandResult(
        data, text, warnings=warnings, verdict="shown and recorded to the end",
        next_step=f"open {mcap} in Foxglove, or replay it: vfplan replay {fixture} {mcap}",
    )  # fmt: skip


def pass_on(
    ticks: Iterator[Any], feed: Any, writer: Any, seconds: float | None, *, stop_when_full: bool
) -> dict[str, Any]:
    """Pass every tick on until the source ends, the time is over, or a signal comes."""
    data = {"ticks": 0, "dropped": 0, "lost_datagrams": 0, "bad_datagrams": 0,
            "first_bad_datagram": ""}  # fmt: skip
    started = time.monotonic()
    with noted_signals() as stopped:
        for portion in ticks:
            if len(portion.ticks):
                data["ticks"] += len(portion.ticks)
                feed.put(portion.ticks)
                if writer is not None:
                    writer.write(portion.ticks, time.time())
                    if writer.full and stop_when_full:
                        break
            data |= {"dropped": portion.dropped, "lost_datagrams": portion.lost,
                     "bad_datagrams": portion.bad,
                     "first_bad_datagram": portion.first_bad}  # fmt: skip
            if stopped() or (seconds is not None and time.monotonic() - started >= seconds):
                break
    return data
