"""`vfplan campaign`: how sure is a plan."""

from __future__ import annotations

import os
import time
from typing import Any

import click

from vfplan.cli.options import FIXTURE, MILLI, option, settings, taking
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command, progress
from vfplan.cli.values import FILE, PNG, Numbers, Real, Whole
from vfplan.errors import SettingError


@command(
    "campaign",
    first_screen="-o --trials --seed --fle-image --fle-robot --tremor --stiffness-range --workers "
    "--scheduler --picture-out --json",
)
@FIXTURE
@click.argument("sessions", type=FILE, nargs=-1, metavar="[SESSION...]")
@taking(
    option("-o", "--output", "folder", type=FILE, required=True, metavar="DIR",
           help="The campaign's folder; a later call goes on with what is there."),
    option("--trials", type=Whole(1), default=1000, help="How many trials, in whole blocks of 64."),
    option("--seed", type=Whole(0, 2**63 - 1), default=0,
           help="Trial k draws from (seed, k), whatever the workers."),
    option("--fle-image", "fle_image_px", type=Real(0), default=0, metavar="PX",
           help="RMS error of a marker's picked pixel."),
    option("--fle-robot", "fle_robot_m", type=Real(0), metavar="MM", **MILLI,
           help="RMS error of a touched marker; without it, what FIXTURE's residuals say."),
    option("--tremor", "tremor_m", type=Real(0), default=0, metavar="MM", **MILLI,
           help="RMS of the hand's tremor, 8 to 12 Hz."),
    option("--stiffness-range", type=Numbers(2, metavar="A,B"),
           help="K drawn evenly from A to B [N/m]."),
    option("--hand", "hand_stiffness", type=Real(0, min_open=True), default=500.0,
           metavar="N_PER_M", help="Stiffness of the hand that follows the session."),
    option("--beyond", type=Numbers(*range(1, 21), metavar="MM[,MM...]", positive=False),
           default="0,0.5,1", help="Depths beyond the true curve whose probability is told."),
    option("--margin-for", type=Numbers(*range(1, 21), metavar="P[,P...]"), default="0.05,0.01",
           help="Probabilities whose margin is told."),
    option("--workers", type=Whole(1, 4096),
           help="Processes on this machine; without it, one a core."),
    option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, e.g. tcp://HOST:8786."),
    option("--picture-out", type=PNG, help="Where along the curve, and how far."),
    option("--overwrite", is_flag=True, help="Replace the picture if it exists."),
)  # fmt: skip
def command(
    fixture, sessions, folder, trials, workers, scheduler, picture_out, beyond, margin_for, **given
) -> Report:
    """Plan again and again, each time with other errors, and see how far the tool comes.

    A trial draws marker errors on both sides and of the curve, fits the registration, carries the
    curve, and renders that fixture to a hand that wants to go where SESSION went; without a SESSION
    along both sides of the drawn curve, at 5 cm/s and 5 mm past contact, clear of open ends by the
    distance at which the proxy stops and 5 mm: how safe an end is, a SESSION tells. Told is how far
    the tool came beyond the true curve: with what probability, where, and which margin makes it
    less probable than wished (`vfplan plan --margin p=0.01 --campaign DIR` takes it from there).
    """
    if workers is not None and scheduler is not None:
        raise click.UsageError("--workers and --scheduler: one of them")
    if not all(0 < p < 1 for p in margin_for):
        raise SettingError("--margin-for: probabilities above 0 and below 1 are wanted")
    from vfplan.bundle import read_fixture
    from vfplan.campaign import CampaignSettings, read_campaign, run_campaign
    from vfplan.campaign.statistics import summary
    from vfplan.replaying.approach import approach_sessions
    from vfplan.session import read_session

    planned = read_fixture(fixture)
    heard = [read_session(path) for path in sessions] or approach_sessions(planned, to_ends=False)
    how = settings(CampaignSettings, given)
    began = time.perf_counter()
    with progress("campaign", trials) as done:
        made = run_campaign(
            planned, heard, folder, trials, how, scheduler=scheduler,
            workers=workers or os.cpu_count() or 1, done=done,
        )  # fmt: skip
    elapsed = time.perf_counter() - began
    asked, table = read_campaign(folder, trials)
    data = summary(asked, table, [1e-3 * mm for mm in beyond], list(margin_for))
    data |= {"trials_made": made, "trials_per_minute": 60 * made / elapsed}
    if picture_out is not None:
        from vfplan.campaign.figures import draw_campaign

        with outputs(picture_out) as (picture,):
            draw_campaign(planned, table, 1e-3 * beyond[0], picture)
    return Report(data, _text(data))


def _text(data: dict[str, Any]) -> str:
    from vfplan.campaign.settings import BLOCK

    lines = [f"{data['trials']} trials counted; {data['trials_made']} made now, in whole blocks of "
             f"{BLOCK}, {data['trials_per_minute']:.0f} a minute"]  # fmt: skip
    lines += [
        f"  beyond the true curve by more than {e['beyond_mm']:g} mm: p = {e['p']:.3g} "
        f"(95 %: {e['low']:.3g} to {e['high']:.3g})"
        for e in data["p_enter"]
    ]
    for m in data.get("margin_for", ()):
        high = "no trial bounds it from above" if m["high"] is None else f"{m['high']:.3f}"
        low = "0" if m["low"] is None else f"{m['low']:.3f}"
        lines.append(
            f"  margin for p < {m['p']:g}: {m['margin_mm']:.3f} mm (95 %: {low} to {high})"
        )
    return "\n".join(lines)
