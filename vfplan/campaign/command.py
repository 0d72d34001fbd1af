"""`vfplan campaign`: how sure is a plan."""

from __future__ import annotations

import os
import shlex
import time

import click

from vfplan.cli.options import (
    FILE,
    FIXTURE,
    MM_OR_ZERO,
    OVERWRITE,
    PNG,
    DecimalNumber,
    WholeNumber,
    numbers_of,
    option,
    options_in_order,
)
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command, command_line, progress
from vfplan.display import MAX_LISTED, wrote
from vfplan.errors import SettingError
from vfplan.settings import settings_from_options


@command(
    "campaign",
    first_screen="-o --trials --seed --fle-image --fle-robot --tremor --stiffness-range --workers "
    "--scheduler --picture-out --json",
)
@FIXTURE
@click.argument("sessions", type=FILE, nargs=-1, metavar="[SESSION...]")
@options_in_order(
    option("-o", "--output", "folder", type=FILE, required=True, metavar="DIR",
           help="Keep the trials in this folder. The same command continues there."),
    option("--trials", type=WholeNumber(1), metavar="N", default=1000,
           help="Number of trials. They are made in blocks of 64."),
    # A block's file holds whole numbers of 64 bits with a sign.
    option("--seed", type=WholeNumber(0, 2**63 - 1), metavar="N", default=0,
           help="Seed of the random numbers."),
    option("--fle-image", "fle_image_px", type=DecimalNumber(0), default=0, metavar="PX",
           help="RMS error of a marker that is picked in the image [px]."),
    option("--fle-robot", "fle_robot_m", type=MM_OR_ZERO,
           help="RMS error of a marker that the robot touches [mm].  [default: from the residuals "
           "of FIXTURE]"),
    option("--tremor", "tremor_m", type=MM_OR_ZERO, default="0",
           help="RMS of the hand's tremor, 8 to 12 Hz [mm]."),
    option("--stiffness-range", type=numbers_of(2, metavar="A,B"),
           help="Draw the stiffness K evenly from A to B [N/m].  [default: that of FIXTURE]"),
    option("--hand", "hand_stiffness", type=DecimalNumber(0, min_open=True), default=500.0,
           metavar="N_PER_M", help="Stiffness of the hand that follows the session [N/m]."),
    option("--beyond", type=numbers_of(*range(1, MAX_LISTED + 1), metavar="MM[,MM...]",
                                    positive=False), default="0,0.5,1",
           help="Report the probability of these depths beyond the true curve [mm]."),
    option("--margin-for", type=numbers_of(*range(1, MAX_LISTED + 1), metavar="P[,P...]"),
           default="0.05,0.01", help="Report the margin for these probabilities."),
    option("--workers", type=WholeNumber(1, 4096), metavar="N",
           help="Number of processes on this machine.  [default: one a core]"),
    option("--scheduler", metavar="ADDRESS",
           help="Use the workers of this Dask scheduler, e.g. tcp://HOST:8786."),
    option("--picture-out", type=PNG, metavar="PNG",
           help="Write a picture of where along the curve the tool enters."),
    OVERWRITE,
)  # fmt: skip
def vfplan_campaign(
    fixture, sessions, folder, trials, workers, scheduler, picture_out, beyond, margin_for,
    **arguments,
) -> CommandResult:  # fmt: skip
    """Simulate the plan many times, each with other errors, and report how far the tool enters.

    Each trial draws errors of the markers and of the curve, registers again, and renders the
    fixture to a hand that moves as in SESSION. Without a SESSION the hand presses along both sides
    of the curve, 5 mm deep at 5 cm/s. Only a SESSION tests the ends of an open curve. To use the
    reported margin: `vfplan plan ... --campaign DIR --margin p=0.01`.
    """
    if workers is not None and scheduler is not None:
        raise click.UsageError("--workers and --scheduler exclude each other. Give one")
    for probability in margin_for:
        if not 0 < 1 - probability < 1:
            raise SettingError(
                f"{probability:g} is no probability. Give --margin-for numbers between 0 and 1",
                code="no-probability",
            )
    from vfplan.bundle.read import read_fixture
    from vfplan.campaign.store import draw_campaign, read_campaign, run_campaign, summary
    from vfplan.campaign.trial import CampaignSettings
    from vfplan.replaying.link import approach_sessions
    from vfplan.session.read import read_session

    planned = read_fixture(fixture)
    hands = [read_session(path) for path in sessions]
    if not hands:
        hands = approach_sessions(planned, to_ends=False)
    settings = settings_from_options(CampaignSettings, arguments)
    started = time.perf_counter()
    with progress("campaign", trials) as done:
        new_trials = run_campaign(
            planned, hands, folder, trials, settings, scheduler=scheduler,
            workers=workers or os.cpu_count() or 1, done=done,
        )  # fmt: skip
    elapsed_s = time.perf_counter() - started
    question, table = read_campaign(folder, trials)
    data = summary(question, table, [1e-3 * mm for mm in beyond], list(margin_for))
    data |= {"trials_made": new_trials, "trials_per_minute": 60 * new_trials / elapsed_s}
    lines = [f"{data['trials']} trials, {data['trials_made']} of them made now"]
    lines += [
        f"  beyond the true curve by more than {entry['beyond_mm']:g} mm: p = "
        f"{entry['p']:.3g} (95 %: {entry['low']:.3g} to {entry['high']:.3g})"
        for entry in data["p_enter"]
    ]
    for margin in data["margin_for"]:
        low, high = (margin[end] for end in ("low", "high"))
        low = "0" if low is None else f"{low:.3f}"
        high = "no trial bounds it from above" if high is None else f"{high:.3f}"
        lines.append(
            f"  margin for p < {margin['p']:g}: {margin['margin_mm']:.3f} mm (95 %: {low} to "
            f"{high})"
        )
    if picture_out is not None:
        with outputs(picture_out) as (picture,):
            draw_campaign(planned, table, 1e-3 * beyond[0], picture)
        lines.append(wrote(picture_out))

    # A hand that never touches the fixture tests nothing.
    if not data["trials_in_contact"]:
        return CommandResult(
            data, "\n".join(lines), failed="not tested: the tool never touched the fixture",
            verdict="not-tested",
            next_step="give a SESSION that touches the fixture, in the robot's frame",
        )  # fmt: skip
    entry = data["p_enter"][0]
    verdict = (
        f"the tool goes more than {entry['beyond_mm']:g} mm beyond the true curve with "
        f"p = {entry['p']:.3g} (95 %: {entry['low']:.3g} to {entry['high']:.3g})"
    )
    next_step = f"more trials bound the margin from above: {command_line()} --trials {4 * trials}"
    for margin in data["margin_for"]:
        if margin["high"] is not None:
            words = ["--margin", f"p={margin['p']:g}", "--campaign", str(folder)]
            next_step = (
                f"add a margin of up to {margin['high']:.3f} mm: vfplan plan IMAGE MARKERS "
                f"{shlex.join(words)}"
            )
    return CommandResult(data, "\n".join(lines), verdict=verdict, next_step=next_step)
