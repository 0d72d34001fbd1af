"""`vfplan ar`: the wall in a camera's picture, and the calibration of the camera."""

from __future__ import annotations

import math
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import click

from vfplan.camera import CODECS, LIMIT_MM
from vfplan.cli import options
from vfplan.cli.options import FILE, DecimalNumber, OutputFile, Parsed, option, options_in_order
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command, command_line, noted_signals
from vfplan.display import Report, command_of, quoted, wrote
from vfplan.io.files import parse_decimal
from vfplan.settings import Arguments

if TYPE_CHECKING:
    from vfplan.camera.overlay import Overlay
    from vfplan.fixture import Fixture


@command("ar")
@click.argument("files", type=FILE, nargs=-1, metavar="FIXTURE.h5 CAMERA|VIDEO|IMAGE")
@options_in_order(
    option("--camera", type=FILE, metavar="CALIB.json",
           help="The camera's calibration, from --calibrate."),
    option("-o", "--output", metavar="OUT", type=OutputFile(".png", ".jpg", *CODECS, ".json"),
           help="Write a video, or the last picture with a wall, or the calibration (.json)."),
    option("--measured-mm", type=DecimalNumber(0, min_open=True), metavar="MM",
           help="Length of the printed scale of 100 mm by a ruler."),
    option("--limit-mm", type=DecimalNumber(0, min_open=True), metavar="MM", default=LIMIT_MM,
           help="Show no wall that may be off by more [mm]: half of a pen's line."),
    option("--tags", type=FILE, metavar="TAGS.csv",
           help="Use tags on the object instead of a sheet: label,x_m,y_m,z_m of the four touched "
           "corners of each, labelled 17.0 to 17.3 for tag 17."),
    option("--session", type=FILE, metavar="SESSION",
           help="Show the tool tip, the proxy and the force of a session, by the engine."),
    option("--live", "live_source", metavar="RESULT.h5|udp://HOST:PORT",
           help="Show the same of a controller, or of a result at its own pace, as `vfplan live`."),
    option("--window", is_flag=True, help="Show the frames of a camera or video in a browser."),
    options.BROWSER,
    option("--session-start", type=Parsed("S", parse_decimal), default=0.0, metavar="S",
           help="Time of the session at the first frame [s]."),
    option("--seconds", type=DecimalNumber(0, min_open=True), metavar="S",
           help="Stop after this time [s].  [default: at the end of the video, or on Ctrl-C]"),
    option("--calibrate", is_flag=True,
           help="Calibrate the camera by pictures or videos of the printed board."),
    option("--board-out", type=OutputFile(".pdf"), metavar="PDF",
           help="Write the board of a calibration, to be printed."),
    options.PAPER,
    options.OVERWRITE,
)  # fmt: skip
def vfplan_ar(files, output, board_out, paper, calibrate, **arguments) -> CommandResult:
    """Show the wall of FIXTURE.h5 in the picture of a CAMERA (its number), a VIDEO or an IMAGE.

    The camera looks at the sheet of the plan, from `vfplan review --print-out`. The line, its 95 %
    bands and the outline at which the proxy stops are drawn where they are. A frame in which that
    is not certain shows no wall and says why. With --calibrate all files show the board.
    """
    if board_out is not None:
        options.refuse_unused("with --board-out", "files", "output", "calibrate", *OF_THE_WALL)
        from vfplan.camera.sheet import draw_board, write_pdf

        with outputs(board_out) as (path,):
            write_pdf(draw_board(paper), path)
        return CommandResult(
            {"board": str(board_out)}, wrote(board_out), verdict="drawn",
            next_step=f"print {quoted(board_out)} at 100 %, put it on a flat plate, take 15 "
            "pictures from all sides, then vfplan ar --calibrate PICTURES -o CALIB.json",
        )  # fmt: skip
    options.refuse_unused("without --board-out", "paper")
    writes_calibration = output is not None and output.suffix.lower() == ".json"
    wanted_files = len(files) > 0 if calibrate else len(files) == 2
    if not wanted_files or writes_calibration != calibrate:
        raise click.UsageError(
            "give FIXTURE.h5 and a source, or --calibrate PICTURES -o CALIB.json"
        )
    if calibrate:
        options.refuse_unused("with --calibrate", *OF_THE_WALL)
        return calibrate_camera(files, output)
    check_options_of_wall(files[1], arguments)
    return show_wall(*files, output, arguments)


# The options of the wall alone.
OF_THE_WALL = (
    "camera", "measured_mm", "limit_mm", "tags", "session", "live_source", "window", "port",
    "no_browser", "session_start", "seconds",
)  # fmt: skip


def check_options_of_wall(source: Path, arguments: Arguments) -> None:
    """Refuse options that exclude each other, or that would change nothing."""
    from vfplan.images.read import is_picture_file

    if is_picture_file(source):
        options.refuse_unused("on a picture", "window", "port", "no_browser", "seconds")
    if not arguments["window"]:
        options.refuse_unused("without --window", "port", "no_browser")
    if arguments["session"] is None:
        options.refuse_unused("without --session", "session_start")
    elif arguments["live_source"] is not None:
        raise click.UsageError("give --session or --live, not both")
    if arguments["tags"] is not None:
        options.refuse_unused("with --tags", "measured_mm")


def calibrate_camera(files: tuple[Path, ...], output: Path) -> CommandResult:
    """Calibrate by pictures, or by two frames a second of a video."""
    import json

    import cv2

    from vfplan.camera.overlay import frames_of
    from vfplan.camera.pose import calibrate
    from vfplan.io.files import to_json_types
    from vfplan.io.writing import write_whole

    pictures = {(file, int(2 * time_s)): cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
                for file in files for time_s, _, frame in frames_of(file, (0, 0))}  # fmt: skip
    camera, rms_px, used = calibrate(pictures.values())
    data = to_json_types(asdict(camera)) | {"rms_px": rms_px}
    with outputs(output) as (path,):
        write_whole(path, [json.dumps(data, indent=2).encode()], overwrite=True)
    return CommandResult(
        data | {"pictures": used, "output": str(output)},
        f"{used} pictures fit to {rms_px:.3f} px\n{wrote(output)}", verdict="calibrated",
        next_step=command_of("ar", "FIXTURE.h5", "0", "--camera", output),
    )  # fmt: skip


def show_wall(
    fixture: Path, source: Path, output: Path | None, arguments: Arguments
) -> CommandResult:
    """Draw the wall on every frame of a source, show and write the frames, and say how many."""
    import cv2

    from vfplan.camera.overlay import Film, frames_of

    refusals, seconds = Counter(), []
    shown = last = window = None
    end_s = arguments["seconds"] or math.inf
    with outputs(output) as (path,), noted_signals() as is_stopped, ExitStack() as stack:
        overlay = overlay_of(stack, fixture, arguments)
        if arguments["window"]:
            window = open_window(stack, fixture, arguments)
        film = Film(path)
        begun = time.monotonic()
        for time_s, rate_hz, frame in frames_of(source, overlay.camera.size):
            if window is not None:
                # A film is shown at its own pace.
                time.sleep(max(0.0, begun + time_s - time.monotonic()))
            started = time.monotonic()
            last = overlay.show(frame, time_s + arguments["session_start"])
            seconds.append(time.monotonic() - started)
            frame = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
            if last["refused"] is None:
                shown = last
            else:
                refusals[last["refused"]] += 1
            film.add(frame, rate_hz, last["refused"])
            if window is not None:
                window.show(frame, last["refused"], started)
            if is_stopped() or time_s >= end_s:
                break
        sender, failed = arguments["live_source"], ""
        if shown is not None and sender is not None and not overlay.tools_shown:
            failed = f"no tick of {sender} came. Start what sends them, and check the address"
            # A command that fails leaves no file.
            film.picture = output = None
        film.close()

    # Of a video the last frame with a wall speaks for all, or the last one.
    latencies_ms = [] if window is None else window.latencies_ms
    return shown_frames(shown or last, refusals, seconds, latencies_ms, output, failed, arguments)


def shown_frames(
    report: Report, refusals: Counter[str], seconds: list[float],
    latencies_ms: list[float], output: Path | None, failed: str, arguments: Arguments,
) -> CommandResult:  # fmt: skip
    """How many frames show the wall, and why the others do not.

    report: of the frame that speaks for all
    refusals: how often each code refused a frame
    seconds, latencies_ms: how long each frame took, and until a page showed it
    failed: what did not come, although a wall is shown
    """
    written = str(output) if output is not None and report["refused"] is None else None
    frames, ms = len(seconds), 1e3 * median(seconds)
    data = report | {
        "frames": frames, "shown": frames - refusals.total(), "refusals": refusals,
        "latency_ms": ms, "output": written,
    }  # fmt: skip
    text = f"{data['shown']} of {frames} frames show the wall; {ms:.0f} ms a frame"
    if latencies_ms:
        data["window_latency_ms"] = median(latencies_ms)
        text += f"\nthe page shows a frame {data['window_latency_ms']:.0f} ms after it came"
    for code, number in refusals.items():
        text += f"\n{number} without: {code}"
    warnings = []
    if arguments["tags"] is None and arguments["measured_mm"] is None:
        warnings = ["The scale of the print was not checked. Give --measured-mm"]
    verdict = "no tool: no tick came"
    if report["refused"] is not None:
        failed, verdict = data["reason"], f"no wall: {data['refused']}"
    if failed:
        again = f"then try again: {command_line()}"
        return CommandResult(data, text, 1, warnings, failed, verdict=verdict, next_step=again)
    look = f"keep it: {command_line()} -o OUT.png"
    if written is not None:
        text, look = f"{text}\n{wrote(written)}", f"look at {quoted(written)}"
    return CommandResult(data, text, warnings=warnings, verdict="shown", next_step=look)


def overlay_of(stack: ExitStack, fixture: Path, arguments: Arguments) -> Overlay:
    """What draws the plan of a file on the frames of the camera, as the options say."""
    from vfplan.bundle.read import read_sealed
    from vfplan.camera.overlay import Overlay
    from vfplan.camera.pose import read_camera
    from vfplan.camera.sheet import plan_of, printed_tags, touched_tags
    from vfplan.io.files import naming_place

    camera, touched = read_camera(arguments["camera"]), arguments["tags"]
    with naming_place(fixture):
        scene, seal = read_sealed(fixture)
        plan = plan_of(scene)
        tags = printed_tags(plan) if touched is None else touched_tags(touched, plan)
    return Overlay(
        plan, tags, camera, touched is None, arguments["limit_mm"],
        arguments["measured_mm"],
        ticks_to_show(stack, plan.fixture, seal["sha256"], arguments),
    )  # fmt: skip


def ticks_to_show(
    stack: ExitStack, fixture: Fixture, sha256: str, arguments: Arguments
) -> Callable[[float], tuple[Any, str]]:
    """A function that gives the tick of a session or of a live stream, as `Overlay` takes it."""
    session, source = arguments["session"], arguments["live_source"]
    if session is not None:
        from vfplan.replaying.replay import replay
        from vfplan.session.bags import as_ticks

        ticks = as_ticks(replay(fixture, session).ticks)

        def tick_of_session(time_s: float) -> tuple[Any, str]:
            if time_s > ticks["t"][-1]:
                return None, "The session has ended"
            return ticks[int(ticks["t"].searchsorted(time_s))], ""

        return tick_of_session
    if source is None:
        return lambda time_s: (None, "")
    from vfplan.live.sources import SILENT_S, PositionStream, stream_of

    feed, stream, is_over = PositionStream(), stream_of(source, sha256), threading.Event()
    stack.callback(is_over.set)

    def take_all() -> None:
        for ticks, _ in stream:
            if is_over.is_set():
                return
            if len(ticks):
                feed.put(ticks)

        is_over.set()

    threading.Thread(target=take_all, daemon=True).start()
    # A picture, or the first frame, does not come before the first tick.
    feed.after(0, SILENT_S)

    def newest_tick(_time_s: float) -> tuple[Any, str]:
        newest, words = next(iter(feed.after(-1, 0.0)[1]), None), ""
        if newest is None and time.monotonic() - feed.heard_s > SILENT_S:
            words = "The session has ended" if is_over.is_set() else f"No tick comes from {source}"
        return newest, words

    return newest_tick


def open_window(stack: ExitStack, fixture: Path, arguments: Arguments) -> Any:
    """The page of the frames, with its address printed and opened in the browser."""
    from vfplan.camera.overlay import Window
    from vfplan.cli.review import open_door

    window = Window(fixture.name, arguments["port"])
    stack.callback(window.close)
    # With --json, standard output holds one document and nothing else.
    click.echo(window.address, err=click.get_current_context().params["as_json"])
    if not arguments["no_browser"]:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        open_door(stack, Path(folder) / fixture.name, window.address)
    return window
