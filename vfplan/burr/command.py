"""`vfplan burr`: a ball at the tip removes what it reaches; the demonstration of editing."""

from __future__ import annotations

from typing import Any

from vfplan.cli import options
from vfplan.cli.options import CSV, PNG, DecimalNumber, option, options_in_order, output_option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command, command_line, progress
from vfplan.display import micrometres, millimetres


@command("burr")
@options_in_order(
    options.FIXTURE,
    options.SESSION,
    option("--radius", "radius_mm", type=DecimalNumber(0, min_open=True), metavar="MM",
           required=True,
           help="Radius of the ball at the tip [mm]. It is smaller than the contact radius."),
    output_option("Write the result of each tick to this HDF5 file.", required=False),
    option("--events-out", type=CSV, metavar="EVENTS.csv",
           help="Write the edits, for `vfplan replay --rule robust --events`."),
    option("--picture-out", type=PNG, metavar="PNG",
           help="Write a picture of what was removed, and of the force over time."),
    options.UNITS,
    options.signature_options(),
)  # fmt: skip
def vfplan_burr(
    fixture, session, radius_mm, output, events_out, picture_out, **arguments
) -> CommandResult:
    """Let the hand of SESSION burr FIXTURE.h5 away with a ball at the tip.

    The ball removes the points within it, and new points appear on its surface. The ball is smaller
    than the contact radius, so the hand has to press in by the difference first. The command then
    replays the session with these edits. It demonstrates editing under the hand, and does not
    simulate bone.
    """
    from vfplan.bundle.read import read_sealed
    from vfplan.burr.burr import burr
    from vfplan.session.events import write_events
    from vfplan.session.read import read_session
    from vfplan.session.result import write_result

    planned, seal = read_sealed(fixture, trust=options.trust(arguments))
    hand = read_session(session, units=arguments["units"], frame=planned.frame)
    with progress("burr", len(hand.hip)) as done:
        burred = burr(planned, hand, 1e-3 * radius_mm, done=done)
    with outputs(output, events_out, picture_out) as (result, events, picture):
        if result is not None:
            write_result(burred.replayed, result)
        if events is not None:
            write_events(events, burred.events)
        if picture is not None:
            from vfplan.burr.burr import burr_figure
            from vfplan.figures.style import save_png

            save_png(burr_figure(burred), picture)

    metrics = burred.metrics
    warnings = options.not_compared_warnings(seal, arguments) + [
        finding["message"] for finding in metrics["findings"] if finding["code"] == "burr-held"
    ]
    written = [f"wrote {path}" for path in (output, events_out, picture_out) if path is not None]
    text = "\n".join([burr_text(metrics), *written])
    figures = metrics["burr"]
    if not figures["replayed_to_the_bit"]:
        return CommandResult(
            metrics, text, warnings=warnings, failed="the replay of the edits gives other forces",
            verdict="fail: the replay of the edits gives other forces",
            next_step="report it with both files; edits must replay to the bit",
        )  # fmt: skip
    if not figures["burring_ticks"]:
        return CommandResult(
            metrics, text, warnings=warnings, verdict="not-tested: the ball removed nothing",
            next_step="press deeper than the contact radius less the ball's, or take a larger "
            "--radius",
        )  # fmt: skip
    return CommandResult(
        metrics, text, warnings=warnings,
        verdict=f"burred {figures['places_lowered']} places, up to "
        f"{millimetres(figures['deepest_m'], 2)} deep",
        next_step=f"draw it, and keep the edits for vfplan replay: {command_line()} "
        "--picture-out burr.png --events-out edits.csv",
    )  # fmt: skip


def burr_text(metrics: dict[str, Any]) -> str:
    """What was removed, and how the force went."""
    burr = metrics["burr"]
    same = "REPLAYED OTHERWISE"
    if burr["replayed_to_the_bit"]:
        same = "the replay has the same bits"
    return (
        f"burred in {burr['burring_ticks']} of {metrics['ticks']} ticks: {burr['points_taken']} "
        f"points went and came back deeper, {burr['places_lowered']} places, up to "
        f"{millimetres(burr['deepest_m'], 2)}\n"
        f"force        max {metrics['force_max_n']:.3f} N (K times the margin: "
        f"{burr['margin_force_n']:.3f} N); under edits its step was at most "
        f"{burr['force_step_of_bound']:.2f} of K (R/256 + step of the HIP)\n"
        f"clearance    min {micrometres(metrics['clearance_min_m'])}; {same}"
    )
