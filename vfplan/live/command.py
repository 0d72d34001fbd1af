"""`vfplan live`: ticks as they come, on a page, in 3D Slicer and in an MCAP file."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from vfplan.cli.options import FIXTURE, option, options_in_order
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command
from vfplan.cli.stopping import noted_signals
from vfplan.cli.values import DecimalNumber, OutputFile, WholeNumber


@command("live")
@FIXTURE
@click.argument("source", metavar="RESULT.h5|udp://HOST:PORT")
@options_in_order(
    option("--openigtlink", type=WholeNumber(0, 65535), metavar="PORT",
           help="Serve OpenIGTLink on 127.0.0.1 at this port (18944 is usual; 0: any free)."),
    option("--web", type=WholeNumber(0, 65535), metavar="PORT",
           help="Serve a page to watch on 127.0.0.1 at this port (8080, say; 0: any free)."),
    option("--mcap", type=OutputFile(".mcap"), metavar="FILE", help="Keep every tick."),
    option("--rate", type=DecimalNumber(1, 1000), default=100.0, metavar="HZ",
           help="How many ticks a second are shown."),
    option("--seconds", type=DecimalNumber(0, min_open=True), metavar="S",
           help="Stop after so long; without it at the result's end, or on Ctrl-C."),
    option("--overwrite", is_flag=True, help="Replace the MCAP file if it exists."),
)  # fmt: skip
def command(fixture, source, openigtlink, web, mcap, rate, seconds) -> Report:
    """Show ticks as they come: a result of `vfplan replay -o` at its own pace, or a controller.

    A controller sends with vfplan/telemetry.hpp to udp://HOST:PORT. Ctrl-C ends the showing in
    order: the MCAP file is finished and kept.
    """
    if openigtlink is None and web is None and mcap is None:
        raise click.UsageError("nothing to do: give --openigtlink, --web or --mcap")
    from vfplan.bundle import read_fixture
    from vfplan.live.sources import MOST_CLIENTS, Feed, of_port, of_result
    from vfplan.session.mcapfile import McapWriter

    shown, feed, servers = read_fixture(fixture), Feed(rate), []
    ticks = of_port(source) if source.startswith("udp:") else of_result(Path(source))
    with ExitStack() as stack:
        if openigtlink is not None:
            from vfplan.live.server import Server

            servers.append(_closed(stack, Server(shown, openigtlink, feed)))
            click.echo(f"vfplan: OpenIGTLink at 127.0.0.1:{servers[-1].port}", err=True)
        if web is not None:
            from vfplan.live.page import live_page
            from vfplan.live.web import Web

            servers.append(_closed(stack, Web(*live_page(shown, fixture.name), web, feed)))
            click.echo(f"vfplan: page at http://127.0.0.1:{servers[-1].port}/", err=True)
        kept = None
        if mcap is not None:
            (temporary,) = stack.enter_context(outputs(mcap))
            kept = stack.enter_context(McapWriter(temporary))
        data = _follow(ticks, feed if servers else None, kept, seconds)
    warnings = [f"{n} clients were refused: {MOST_CLIENTS} are served at a time"
                for n in [sum(s.refused for s in servers)] if n]  # fmt: skip
    text = f"{data['ticks']} ticks, {data['dropped']} dropped by the controller, " \
           f"{data['lost_datagrams']} datagrams lost"  # fmt: skip
    if mcap is None:
        return Report(data, text, warnings=warnings)
    data["mcap"], failed = str(mcap), ""
    if kept.full:
        failed = f"{mcap}: {kept.full.strerror}; it holds the first {kept.kept} ticks"
    text += f"\nwrote {mcap}"
    return Report(data, text, 2 * bool(failed), warnings, failed)


def _closed(stack: ExitStack, server: Any) -> Any:
    """The server, closed with the stack."""
    stack.callback(server.close)
    return server


def _follow(ticks: Any, feed: Any, kept: Any, seconds: float | None) -> dict[str, Any]:
    """Pass on every tick until the source ends, the time is over, or a signal comes."""
    data = {"ticks": 0, "dropped": 0, "lost_datagrams": 0, "bad_datagrams": 0}
    began = time.monotonic()
    with noted_signals() as stopped:
        for found in ticks:
            if len(found.ticks):
                data["ticks"] += len(found.ticks)
                if feed is not None:
                    feed.put(found.ticks)
                if kept is not None:
                    kept.write(found.ticks, time.time())
                    if kept.full and feed is None:
                        break
            data["dropped"], data["lost_datagrams"] = found.dropped, found.lost
            data["bad_datagrams"] = found.bad
            if stopped() or (seconds is not None and time.monotonic() - began >= seconds):
                break
    return data
