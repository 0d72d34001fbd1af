"""`vfplan review`: a slice, a curve or a fixture on a page to mend and approve, or as a sheet."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from vfplan.cli import options
from vfplan.cli.options import option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command, patience
from vfplan.cli.stopping import noted_signals
from vfplan.cli.values import FILE, HDF5, PNG, Whole

if TYPE_CHECKING:
    from vfplan.fixture import Fixture

FAREWELL_S = 0.5
"""Seconds that the page has to show its last message before the server goes."""


@command("review")
@click.argument("source", type=FILE, metavar="SLICE|CURVE.h5|FIXTURE.h5")
@click.argument("markers", type=FILE, required=False)
@click.argument("markers2", type=FILE, required=False)
@options.taking(
    option("-o", "--output", type=HDF5, metavar="OUT.h5",
           help="Open the review page; what is approved there is written to this bundle."),
    option("--sheet-out", type=PNG, metavar="PNG",
           help="Write the review sheet alone: the slice, both ends and every bridge enlarged, the "
           "markers and the findings."),
    option("--slice", "slice_", type=FILE, metavar="IMAGE",
           help="The slice that a bundle was drawn on, checked by its SHA-256."),
    option("--by", default="", metavar="NAME", help="The name that the page proposes."),
    option("--key", type=FILE, metavar="KEY",
           help="The private key, from `vfplan keygen`, that signs what is approved."),
    option("--case", default="", metavar="CASE", help="Case token that the signature covers."),
    option("--no-browser", is_flag=True, help="Print the address only; open no browser."),
    option("--port", type=Whole(0, 65535), default=0, metavar="N",
           help="The page's port on 127.0.0.1; 0: any free one."),
    options.OVERWRITE,
    options.CURVE,
    options.MAKING,
)  # fmt: skip
def command(source, markers, markers2, output, sheet_out, slice_, **given) -> Report:
    """Show a plan to a person, who mends it and approves it.

    SOURCE is a planned slice, a curve bundle or a fixture bundle, MARKERS as for `vfplan plan`.
    With -o a page opens in the browser. There a curve that `vfplan extract` refuses is chosen or
    drawn, knots and markers are moved, findings are answered. The first line printed is the page's
    address. Exit code 0: approved and written; 1: left. Every step is kept in OUT.h5.draft.json,
    and the next call takes it up.

    With --sheet-out only the review sheet is drawn.
    """
    if (output is None) == (sheet_out is None):
        raise click.UsageError("give -o OUT.h5 for the page, or --sheet-out PNG for the sheet")
    if sheet_out is not None:
        return _sheet(source, markers, markers2, sheet_out, slice_, given)
    return _page(source, markers, markers2, output, slice_, given)


def _page(
    source: Path,
    markers: Path | None,
    markers2: Path | None,
    output: Path,
    slice_: Path | None,
    given: dict[str, Any],
) -> Report:
    """Serve the review page until the person approves or leaves."""
    from vfplan.planning import ExtractSettings
    from vfplan.review.draft import Draft, draft_path
    from vfplan.review.server import ReviewServer
    from vfplan.review.session import Session
    from vfplan.review.source import settings_of

    if given["case"] and given["key"] is None:
        raise click.UsageError("--case belongs to a signature; give --key too")
    reading = options.settings(ExtractSettings, given)
    settings = settings_of(reading, options.fixture_settings(given))
    files = {
        "source": source, "markers": markers, "markers2": markers2, "slice": slice_,
        "curve": given["curve"],
    }  # fmt: skip
    draft = Draft(draft_path(output), files, settings)
    with patience(f"opening {source.name}"):
        session = Session.open(
            source, markers, markers2, slice=slice_, curve=given["curve"], **settings
        )
        session = draft.take_up(session)
    server = ReviewServer(
        session, draft, port=given["port"], by=given["by"], signs=given["key"] is not None
    )

    def write(fixture: Fixture) -> str:
        _write(fixture, output, given)
        return f"{output.name} is written."

    # With --json, standard output holds one document and nothing else.
    as_json = click.get_current_context().params["as_json"]
    try:
        # Whoever reads the address may stop the review at once, so signals are noted before it.
        with noted_signals() as stopped:
            click.echo(server.address, err=as_json)
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
            if not given["no_browser"]:
                click.launch(server.address)
            by = server.run(write, stopped)
            time.sleep(FAREWELL_S)
    finally:
        server.close()
    session = server.session
    data = {"approved_by": by, "steps": len(session.steps), "draft": None}
    if by is None:
        data["draft"] = str(draft.path) if draft.path.exists() else None
        return Report(
            data, "", failed="left without approval; nothing is written", verdict="not approved",
            next_step="The same command takes the review up where it was left.",
            findings=session.findings,
        )  # fmt: skip
    data["output"] = str(output)
    return Report(
        data, f"wrote {output}", findings=session.findings, verdict=f"approved by {by}",
        next_step=f"vfplan replay {output} SESSION --report DIR",
    )  # fmt: skip


def _write(fixture: Fixture, output: Path, given: dict[str, Any]) -> None:
    """Write an approved bundle; signed where there is a key."""
    from vfplan.bundle import sign, write_fixture

    with outputs(output) as (path,):
        if given["key"] is None:
            write_fixture(fixture, path)
            return
        with tempfile.TemporaryDirectory() as folder:
            unsigned = Path(folder) / "approved.h5"
            write_fixture(fixture, unsigned)
            sign(unsigned, path, given["key"], case=given["case"])


def _sheet(
    source: Path,
    markers: Path | None,
    markers2: Path | None,
    sheet_out: Path,
    slice_: Path | None,
    given: dict[str, Any],
) -> Report:
    """Draw the review sheet."""
    from vfplan.review.sheet import write_sheet

    with patience(f"drawing the review sheet of {source.name}"):
        shown = _shown(source, markers, markers2, slice_, given)
        with outputs(sheet_out) as (path,):
            write_sheet(shown, path)
    data = {"digest": shown.digest, "sheet": str(sheet_out)}
    text = f"digest {shown.digest}\nwrote {sheet_out}"
    return Report(
        data, text, findings=shown.findings, verdict=shown.verdict,
        next_step=f"Look at {sheet_out}. Then approve: vfplan review, or vfplan accept.",
    )  # fmt: skip


def _shown(
    source: Path,
    markers: Path | None,
    markers2: Path | None,
    slice_: Path | None,
    given: dict[str, Any],
) -> Any:
    """What the sheet shows of a source."""
    from vfplan.planning import ExtractSettings, extract, plan
    from vfplan.review import sheet_input

    if source.name.lower().endswith(HDF5.suffixes):
        return _shown_of_bundle(source, markers, markers2, slice_, given)
    if slice_ is not None:
        raise click.UsageError("--slice belongs to a bundle; SOURCE is a slice itself")
    reading = options.settings(ExtractSettings, given)
    if markers is None:
        return sheet_input.of_extraction(
            extract(source, reading, curve=given["curve"]), source.name
        )
    made = plan(
        source, markers, markers2, extraction=reading, curve=given["curve"],
        settings=options.fixture_settings(given),
    )  # fmt: skip
    return sheet_input.of_plan(made, source.name)


def _shown_of_bundle(
    source: Path,
    markers: Path | None,
    markers2: Path | None,
    slice_: Path | None,
    given: dict[str, Any],
) -> Any:
    from vfplan.bundle import read_fixture
    from vfplan.images.read import read_image
    from vfplan.planning import register
    from vfplan.review import sheet_input

    fixture = read_fixture(source)
    image = None
    if slice_ is not None:
        image = read_image(
            slice_, frame=given["frame"], pixel_spacing_mm=given["pixel_spacing_mm"],
            imager_spacing=bool(given["imager_spacing"]),
        )  # fmt: skip
        sheet_input.check_slice(fixture, image)
    if markers is None:
        return sheet_input.of_fixture(fixture, source.name, image=image)
    if fixture.frame == "robot_base":
        raise click.UsageError("MARKERS have no effect on a fixture, which is registered already")
    planned = register(fixture, markers, markers2, options.fixture_settings(given), image=image)
    return sheet_input.of_fixture(
        planned.fixture, source.name, image=image, registration=planned.registration
    )  # fmt: skip
