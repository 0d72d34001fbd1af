"""`vfplan ar`: the wall in a camera's picture, and the calibration of the camera."""

from __future__ import annotations

import json
import shlex
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from vfplan.cli import options
from vfplan.cli.options import FILE, DecimalNumber, OutputFile, option, options_in_order
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import CommandResult, command, command_line, noted_signals
from vfplan.display import MM, count


@command("ar", first_screen="--camera -o --measured-mm --tags --session --calibrate --board-out")
@click.argument("fixture", type=FILE, required=False, metavar="[FIXTURE.h5]")
@click.argument("source", type=FILE, required=False, metavar="[CAMERA|VIDEO|IMAGE]")
@click.argument("more", type=FILE, nargs=-1, metavar="")
@options_in_order(
    option("--camera", type=FILE, metavar="CALIB.json",
           help="The camera's calibration, from --calibrate."),
    option("-o", "--output", metavar="OUT",
           type=OutputFile(".png", ".jpg", ".mp4", ".avi", ".json"),
           help="Write the picture or the video with the wall (.png, .jpg, .mp4, .avi), or the "
           "calibration (.json)."),
    option("--frames-out", type=OutputFile(), metavar="DIR",
           help="Write each frame as a picture into this folder."),
    option("--measured-mm", type=DecimalNumber(0, min_open=True), metavar="MM",
           help="Length of the printed scale of 100 mm by a ruler."),
    option("--limit", "limit_m", type=options.MM, metavar="MM", default="0.5",
           help="Show no wall that may be off by more [mm]: half of a pen's line."),
    option("--tags", type=FILE, metavar="TAGS.csv",
           help="Take tags on the object in place of the sheet: label,x_m,y_m,z_m, with four "
           "touched corners of each, 17.0 to 17.3."),
    option("--session", type=FILE, metavar="SESSION",
           help="Show the tool, the proxy and the force of a session replayed by the engine."),
    option("--session-start", type=DecimalNumber(), default=0.0, metavar="S",
           help="Time of the session at the first frame [s]."),
    options.UNITS,
    option("--seconds", type=DecimalNumber(0, min_open=True), metavar="S",
           help="Stop after this time [s].  [default: at the end of the video, or on Ctrl-C]"),
    option("--calibrate", is_flag=True,
           help="Calibrate a camera by pictures or a video of the printed board."),
    option("--board-out", type=OutputFile(".pdf"), metavar="PDF",
           help="Write the board of a calibration, to be printed."),
    options.PAPER,
    options.OVERWRITE,
    options.signature_options(),
)  # fmt: skip
def vfplan_ar(fixture, source, more, output, board_out, paper, calibrate, **arguments):
    """Show the wall of FIXTURE.h5 in the picture of a CAMERA (its number), a VIDEO or an IMAGE.

    The camera looks at the sheet of the plan, from `vfplan review --print-out`. The line, its 95 %
    bands and the outline at which the tool stops are drawn where they are. A frame in which that is
    not certain shows no wall and says why.

    With --calibrate all files are pictures of the board, and -o is the calibration.
    """
    files = [path for path in (fixture, source, *more) if path is not None]
    if board_out is not None:
        from vfplan.camera.sheet import draw_board

        return write_board(draw_board(paper), board_out)
    if output is not None and calibrate != (output.suffix.lower() == ".json"):
        raise click.UsageError(f"{output} is not what this call writes. --calibrate writes .json")
    if calibrate:
        if not files or output is None:
            raise click.UsageError("give pictures of the board, and -o CALIB.json")
        return calibrate_camera(files, output)
    if len(files) != 2:
        raise click.UsageError("give FIXTURE.h5 and one CAMERA, VIDEO or IMAGE")
    return show_wall(fixture, source, output, arguments)


def write_board(figure: Any, board_out: Path) -> CommandResult:
    """Write the board of a calibration."""
    from vfplan.camera.sheet import write_pdf

    with outputs(board_out) as (path,):
        write_pdf(figure, path)
    return CommandResult(
        {"board": str(board_out)}, f"wrote {board_out}", verdict="drawn",
        next_step=f"print {board_out} at 100 %, glue it to a flat plate, take 15 pictures from all "
        "sides, then vfplan ar --calibrate PICTURES -o CALIB.json",
    )  # fmt: skip


def calibrate_camera(files: list[Path], output: Path) -> CommandResult:
    """Calibrate by pictures, or by two frames a second of a video."""
    import cv2

    from vfplan.camera.overlay import Frames
    from vfplan.camera.pose import calibrate
    from vfplan.io.writing import write_whole

    def pictures() -> Iterator[Any]:
        for file in files:
            due_s = 0.0
            for time_s, frame in Frames(file):
                if time_s >= due_s:
                    yield cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
                    due_s = time_s + 0.5

    camera, used = calibrate(pictures())
    data = camera.as_json()
    with outputs(output) as (path,):
        write_whole(path, [json.dumps(data, indent=2).encode()], overwrite=True)
    text = f"{count(used, 'picture')} fit to {camera.rms_px:.3f} px\nwrote {output}"
    following = shlex.join(["vfplan", "ar", "FIXTURE.h5", "0", "--camera", str(output)])
    return CommandResult(
        data | {"pictures": used, "output": str(output)}, text, verdict="calibrated",
        next_step=following,
    )  # fmt: skip


def show_wall(
    fixture: Path, source: Path, output: Path | None, arguments: dict[str, Any]
) -> CommandResult:
    """Draw the wall on every frame of a source."""
    import numpy as np

    from vfplan.bundle.read import read_sealed
    from vfplan.camera.overlay import Frames, FrameWriter, Overlay
    from vfplan.camera.pose import read_camera
    from vfplan.camera.sheet import Sheet, target_of_tags
    from vfplan.io.files import naming_place
    from vfplan.replaying.replay import replay
    from vfplan.session.read import read_session

    folder = arguments["frames_out"]
    refuse_folder(folder)
    planned, seal = read_sealed(fixture, trust=options.trust(arguments))
    camera = read_camera(arguments["camera"])
    warnings = options.not_compared_warnings(seal.describe(), arguments)
    if arguments["tags"] is not None:
        target = target_of_tags(arguments["tags"], planned)
    else:
        with naming_place(fixture):
            target = Sheet(planned).target
        if arguments["measured_mm"] is None:
            warnings.append(
                "The scale of the print was not checked. Measure its 100 mm with a ruler, and give "
                "--measured-mm"
            )
    ticks = None
    if arguments["session"] is not None:
        hand = read_session(arguments["session"], units=arguments["units"], frame=planned.frame)
        ticks = replay(planned, hand).ticks
    overlay = Overlay(
        planned, target, camera, arguments["limit_m"], arguments["measured_mm"], ticks
    )
    with ExitStack() as stack:
        (path,) = stack.enter_context(outputs(output))
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
        is_stopped = stack.enter_context(noted_signals())
        frames = Frames(source, camera.size_px)
        writer = FrameWriter(path, folder, frames.rate_hz)
        reports, seconds = [], []
        for time_s, frame in frames:
            started = time.perf_counter()
            reports.append(overlay.show(frame, time_s + arguments["session_start"]))
            seconds.append(time.perf_counter() - started)
            writer.write(frame, reports[-1]["refused"] is None)
            if is_stopped() or time_s > (arguments["seconds"] or np.inf):
                break
        writer.close()

    shown = [report for report in reports if report["refused"] is None]
    refusals = Counter(report["refused"] for report in reports if report["refused"] is not None)
    data: dict[str, Any] = {"frames": len(reports), "shown": len(shown), "refusals": refusals}
    data |= {
        "refused": None,
        "reprojection_px": None,
        "bound_mm": None,
        "pose_T_camera_sheet": None,
    }
    if shown:
        data["pose_T_camera_sheet"] = shown[-1]["pose_T_camera_sheet"]
        for name in ("reprojection_px", "bound_mm"):
            data[name] = float(np.median([report[name] for report in shown]))
    else:
        data["refused"] = refusals.most_common(1)[0][0]
        data["reason"] = next(r["reason"] for r in reports if r["refused"] == data["refused"])
    latency_s = float(np.median(seconds))
    data |= {"frames_per_s": 1 / latency_s, "latency_ms": 1e3 * latency_s,
             "output": None if output is None else str(output)}  # fmt: skip
    lines = [f"{len(shown)} of {count(len(reports), 'frame')} show the wall; "
             f"{MM * latency_s:.0f} ms a frame"]  # fmt: skip
    if shown:
        lines.append(f"bound {data['bound_mm']:.2f} mm, corners {data['reprojection_px']:.2f} px")
    lines += [f"{number} without: {code}" for code, number in refusals.items()]
    lines += [f"wrote {written}" for written in (output, folder) if written is not None]
    text = "\n".join(lines)
    if not shown:
        return CommandResult(
            data, text, warnings=warnings, failed=data["reason"],
            verdict=f"no wall: {data['refused']}", next_step="do what the reason says",
        )  # fmt: skip
    look = f"look at {output}"
    if output is None:
        look = f"keep what it shows: {command_line()} -o OUT.png"
    return CommandResult(data, text, warnings=warnings, verdict="shown", next_step=look)
