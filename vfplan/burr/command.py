"""`vfplan burr`: a ball at the tip takes away what it reaches; the demonstration of editing."""

from __future__ import annotations

from typing import Any

from vfplan.cli import options
from vfplan.cli.options import option, taking
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command, progress
from vfplan.cli.values import CSV, PNG, Real


@command("burr")
@taking(
    options.FIXTURE,
    options.SESSION,
    option("--radius", "radius_mm", type=Real(0, min_open=True), metavar="MM", required=True,
           help="Of the ball at the tip; below the fixture's contact radius."),
    options.output("Per-tick result, HDF5.", required=False),
    option("--events-out", type=CSV, metavar="EVENTS.csv",
           help="Write the edits, for `vfplan replay --rule robust --events`."),
    option("--picture-out", type=PNG, metavar="PNG",
           help="Write what was taken away, and the force over time."),
    options.UNITS,
    options.signature(),
)  # fmt: skip
def command(fixture, session, radius_mm, output, events_out, picture_out, **given) -> Report:
    """Let SESSION's hand burr FIXTURE.h5 with a ball at the tip.

    Points within the ball around the HIP go, and deeper ones appear on the ball: a hand that
    presses beyond the margin, contact radius less the ball's, takes away what it presses on. The
    session is then replayed with these edits. A demonstration of editing under the hand: the
    removal is a ball's, not a bone's.
    """
    from vfplan.bundle import read_fixture
    from vfplan.burr.burr import burr
    from vfplan.session import read_session, write_result
    from vfplan.session.events import write_events

    planned = read_fixture(fixture, trust=options.trust(given))
    hand = read_session(session, units=given["units"], frame=planned.frame)
    with progress("burr", len(hand.hip)) as done:
        burred = burr(planned, hand, 1e-3 * radius_mm, done=done)
    with outputs(output, events_out, picture_out) as (result, events, picture):
        if result is not None:
            write_result(burred.replayed, result)
        if events is not None:
            write_events(events, burred.events)
        if picture is not None:
            from vfplan.burr.figures import burr_figure
            from vfplan.figures.style import save_png

            save_png(burr_figure(burred), picture)
    held = [f["message"] for f in burred.metrics["findings"] if f["code"] == "burr-held"]
    return Report(burred.metrics, _text(burred.metrics), warnings=held)


def _text(found: dict[str, Any]) -> str:
    burr = found["burr"]
    same = "the replay has the same bits" if burr["replayed_to_the_bit"] else "REPLAYED OTHERWISE"
    return (
        f"burred in {burr['burring_ticks']} of {found['ticks']} ticks: {burr['points_taken']} "
        f"points went and came back deeper, {burr['places_lowered']} places, up to "
        f"{1e3 * burr['deepest_m']:.2f} mm\n"
        f"force        max {found['force_max_n']:.3f} N (K times the margin: "
        f"{burr['margin_force_n']:.3f} N); under edits its step was at most "
        f"{burr['force_step_of_bound']:.2f} of K (R/256 + step of the HIP)\n"
        f"clearance    min {1e6 * found['clearance_min_m']:.2f} µm; {same}"
    )
