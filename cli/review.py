"""`vfplan review`: a plan on a page, to mend and approve, or as a sheet."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from vfplan.cli import options
from vfplan.cli.extract import drawing_refusal, pointing_to_page
from vfplan.cli.next_commands import (
    accept_command,
    file_beside,
    public_key_of,
    sign_command,
    typed_options,
    verify_command,
)
from vfplan.cli.options import FILE, HDF5, OVERWRITE, PNG, OutputFile, option, options_in_order
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, announce_if_slow, command, command_line, noted_signals

from vfplan.display import command_of, quoted, wrote
from vfplan.io.files import naming_place
from vfplan.io.writing import remove_quietly, write_whole
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.settings import Arguments, settings_from_options

if TYPE_CHECKING:
    from vfplan.fixture import Fixture

# Seconds that the page has to show its last message before the server goes.
FAREWELL_S = 0.5

# The file that leads the browser to the page. The address is the key to the review, and every user
# sees the arguments of a program, but only its own user can read this file.
DOOR = '<!DOCTYPE html><meta http-equiv="refresh" content="0; url={address}">\n'


@command("review", settings_file=True)
@click.argument("source", type=FILE, metavar="SOURCE")
@click.argument("markers", type=FILE, required=False)
@click.argument("markers2", type=FILE, required=False)
@options_in_order(
    option("-o", "--output", type=HDF5, metavar="OUT.h5",
           help="Open the review page, and write the approved plan to this bundle."),
    option("--sheet-out", type=PNG, metavar="PNG",
           help="Write the review sheet only: the slice, both ends and every bridge enlarged, the "
           "markers and the findings."),
    option("--print-out", type=OutputFile(".pdf"), metavar="PDF",
           help="Write a page with the plan at true scale, and tags for `vfplan ar`."),
    options.PAPER,
    option("--slice", "slice_path", type=FILE, metavar="IMAGE",
           help="Show a bundle on its slice: a file, or its folder (checked by its SHA-256)."),
    option("--by", default="", metavar="NAME", help="Propose this name on the page."),
    option("--key", type=FILE, metavar="KEY",
           help="Sign the approved plan with this private key, from `vfplan keygen`."),
    option("--case", default="", metavar="CASE", help="Sign it for this case only."),
    options.BROWSER,
    OVERWRITE,
    options.EXTRACT_OPTIONS,
    options.FIXTURE_OPTIONS,
)  # fmt: skip
def vfplan_review(output, sheet_out, print_out, **arguments) -> CommandResult:
    """Show a plan to a person, who mends it and approves it.

    SOURCE is a planned slice, a curve bundle or a fixture bundle, or a volume (NRRD, NIfTI, DICOM
    or a folder of it), whose slice is chosen on the page. MARKERS are as for `vfplan plan`.
    With -o a page opens in the browser. There the person chooses or draws the curve, moves knots
    and markers, and answers findings. The command prints the address of the page first. It ends
    with exit code 0 after an approval, and with 1 if the person left without one. OUT.h5.draft.json
    keeps every step, and the same command goes on from there.

    With --sheet-out or --print-out the command only draws the review sheet or the plan.
    """
    drawn = [path for path in (sheet_out, print_out) if path is not None]
    if output is None and not drawn:
        raise click.UsageError(
            "no output is named. Give -o OUT.h5 for the page, or --sheet-out PNG for the sheet"
        )
    if output is not None and drawn:
        raise click.UsageError(
            "-o opens the page, and --sheet-out and --print-out only draw. Leave -o out, and call "
            "the command again for the page"
        )
    if print_out is None:
        options.refuse_unused("without --print-out", "paper")
    if output is not None:
        return serve_page(output, arguments)
    options.refuse_unused("without the page of -o", "port", "by", "key", "case")
    return draw_sheet(sheet_out, print_out, arguments)


def serve_page(output: Path, arguments: Arguments) -> CommandResult:
    """Serve the review page until the person approves or leaves."""
    from vfplan.bundle.seal import check_texts, read_private
    from vfplan.review.rendered import visible_name
    from vfplan.review.server import Draft, ReviewServer, draft_path
    from vfplan.review.session import Session

    if arguments["key"] is None:
        options.refuse_unused("without --key KEY, which signs for it", "case")
    by = arguments["by"] and visible_name(arguments["by"])
    # Before anybody looks at a plan that could not be signed afterwards.
    check_texts(arguments["case"])
    if arguments["key"] is not None:
        read_private(arguments["key"])
    given = options.given_settings(ExtractSettings, arguments) | options.given_of_plan(arguments)
    files = {role: arguments[role] for role in ("markers", "markers2", "curve")}
    source = arguments["source"]
    with announce_if_slow(f"opening {source.name}"):
        session = Session.open(source, **files, slice=arguments["slice_path"], **given)
    draft = Draft(draft_path(output), session.source.sha256, given)

    def write(fixture: Fixture) -> str:
        write_approved(fixture, output, arguments)
        return f"{output.name} is written."

    # With --json, standard output holds one document and nothing else.
    as_json = click.get_current_context().params["as_json"]
    with ExitStack() as stack:
        stack.enter_context(draft.held())
        session = draft.take_up(session)
        signs = arguments["key"] is not None
        server = ReviewServer(session, draft, port=arguments["port"], by=by, signs=signs)
        stack.callback(server.close)
        # Whoever reads the address may stop the review at once, so signals are noted before it.
        with noted_signals() as is_stopped:
            click.echo(server.address, err=as_json)
            if not arguments["no_browser"]:
                open_door(stack, output, server.address)
            approver = server.run(write, is_stopped)
            time.sleep(FAREWELL_S)
    session = server.session
    findings = session.current.findings
    data = {"approved_by": approver, "steps": len(session.steps), "draft": None}
    if approver is None:
        if draft.path.exists():
            data["draft"] = str(draft.path)
        return CommandResult(
            data, failed="left without approval; nothing is written", verdict="not approved",
            next_step=f"continue where it was left: {command_line()}",
            findings=findings,
        )  # fmt: skip
    data["output"] = str(output)
    if arguments["key"] is None:
        signed_for = {"case": session.source.case, "robot_serial": session.source.robot_serial}
        next_step = sign_command(output, signed_for)
    else:
        next_step = verify_command(output, public_key_of(arguments["key"]), arguments)
    return CommandResult(
        data, wrote(output), findings=findings, verdict=f"approved by {approver}",
        next_step=next_step,
    )  # fmt: skip


def open_door(stack: ExitStack, beside: Path, address: str) -> None:
    """Open a page in the browser by a door of mode 0600, which stands until the stack is left."""
    door = beside.resolve().with_name(f"{beside.name}.page.html")
    stack.callback(remove_quietly, door)
    write_whole(door, [DOOR.format(address=address).encode()], overwrite=True, mode=0o600)
    # A program that opens pages may run as long as its browser does.
    threading.Thread(target=open_page, args=(door, address), daemon=True).start()


def open_page(door: Path, address: str) -> None:
    """Open the page in the browser by its door, and say where it is if there is none."""
    if sys.platform in ("darwin", "win32"):
        code = click.launch(str(door))
    else:
        # xdg-open lists every browser that it looked for, so its own words are not shown. In a
        # session of its own the browser outlives a Ctrl-C that ends the review.
        streams = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
        try:
            code = subprocess.call(["xdg-open", door], **streams, start_new_session=True)
        except OSError:
            code = 1
    if code:
        click.echo(
            f"vfplan: warning: no browser was found. Open {address} in one; with --no-browser "
            "none is looked for.",
            err=True,
        )


def write_approved(fixture: Fixture, output: Path, arguments: Arguments) -> None:
    """Write an approved bundle, signed where there is a key."""
    from vfplan.bundle.seal import sign
    from vfplan.bundle.write import write_fixture

    with outputs(output) as (path,):
        if arguments["key"] is None:
            write_fixture(fixture, path)
            return
        with tempfile.TemporaryDirectory() as folder:
            unsigned = Path(folder) / "approved.h5"
            write_fixture(fixture, unsigned)
            sign(unsigned, path, arguments["key"], case=arguments["case"])


def draw_sheet(
    sheet_out: Path | None, print_out: Path | None, arguments: Arguments
) -> CommandResult:
    """Draw the review sheet, or the plan for a printer, or both."""
    from vfplan.bundle.read import read_sealed
    from vfplan.review.rendered import rendered_in_json
    from vfplan.review.sheet import verdict_of, write_sheet

    source, cut, seal = arguments["source"], "", {}
    is_bundle = source.name.lower().endswith(HDF5.suffixes)
    files = [source, *filter(None, (arguments["markers"], arguments["markers2"]))]
    written = [str(path) for path in (sheet_out, print_out) if path is not None]
    approved = Path(written[0]).with_name(f"{source.stem}-approved.h5")
    with announce_if_slow(f"drawing the review sheet of {source.name}"):
        if is_bundle:
            shown = sheet_of_bundle(arguments)
            seal = read_sealed(source)[1]
        else:
            settings = settings_from_options(ExtractSettings, arguments)
            with (
                pointing_to_page(*files, output=approved, overwrites=False),
                drawing_refusal(source, settings, sheet_out),
            ):
                shown = sheet_of_slice(arguments, settings)
        with outputs(sheet_out, print_out) as (sheet, page_of_plan):
            if sheet is not None:
                write_sheet(shown, sheet)
            if page_of_plan is not None:
                from vfplan.camera.sheet import draw_print, write_pdf

                with naming_place(source):
                    figure, cut = draw_print(shown, arguments["paper"], seal.get("case", ""))
                    write_pdf(figure, page_of_plan)
    if is_bundle and shown.fixture.reviewed is not None:
        following = sign_command(source, {"case": shown.fixture.case} | seal)
    elif shown.image is None and not shown.is_slice_missing and is_bundle and len(files) == 1:
        # The page shows drawn curves; whatever else is accepted by the digest of its sheet.
        following = accept_command(source, shown.digest)
    else:
        name, ending = "review", ["-o", approved]
        if shown.is_slice_missing:
            picture = sheet_out or file_beside(source, "sheet", ".png")
            ending = ["--slice", source.parent, "--sheet-out", picture, "--overwrite"]
        elif shown.image is None:
            # A curve without a slice becomes a fixture first.
            name = "register" if is_bundle else "plan"
            ending = ["-o", file_beside(approved.with_name(source.name), "fixture")]
            if len(files) == 1:
                files.append("MARKERS")
        following = command_of(name, *files, *typed_options(name, overwrites=False), *ending)
    return CommandResult(
        {"digest": shown.digest, "sheet": sheet_out and str(sheet_out),
         "print": print_out and str(print_out), "rendered": rendered_in_json(shown.fixture)},
        f"digest {shown.digest}\n{wrote(sheet_out, print_out)}", findings=shown.findings,
        warnings=[cut] * bool(cut), verdict=verdict_of(shown),
        next_step=f"look at {quoted(written[0])}, then {following}",
    )  # fmt: skip


def sheet_of_slice(arguments: Arguments, settings: ExtractSettings) -> Any:
    """What the sheet of a planned slice shows, with or without markers."""
    from vfplan.planning.extraction import extract
    from vfplan.planning.plan import plan
    from vfplan.review.plan import Plan

    source, markers, curve = (arguments[name] for name in ("source", "markers", "curve"))
    options.refuse_unused("where SOURCE is a slice itself", "slice_path")
    if markers is None:
        extracted = extract(source, settings, curve=curve)
        return Plan.of(extracted.fixture, source.name, extracted.image)
    planned = plan(
        source, markers, arguments["markers2"], extraction=settings, curve=curve,
        settings=FixtureSettings(**options.given_of_plan(arguments)),
    )  # fmt: skip
    return Plan.of(planned.fixture, source.name, planned.extracted.image)


def sheet_of_bundle(arguments: Arguments) -> Any:
    """What the sheet of a curve or a fixture shows, with or without its slice and markers."""
    from vfplan.bundle.read import read_fixture
    from vfplan.images.read import flat_as_planned, slice_file
    from vfplan.planning.extraction import read_slice
    from vfplan.planning.plan import planning_of, register
    from vfplan.review.geometry import extraction_of
    from vfplan.review.plan import Plan, refuse_extraction_of_extracted, refuse_planning_of_planned
    from vfplan.stability.study import with_verdict_by

    source, markers = arguments["source"], arguments["markers"]
    fixture = read_fixture(source)
    extraction = settings_from_options(ExtractSettings, arguments)
    refuse_extraction_of_extracted(fixture, options.given_settings(ExtractSettings, arguments))
    image = None
    if arguments["slice_path"] is not None:
        file = slice_file(fixture, arguments["slice_path"])
        image = read_slice(file, extraction_of(fixture, extraction))
        image = flat_as_planned(image, fixture.provenance.settings)
    given = options.given_of_plan(arguments)
    if markers is None:
        refuse_planning_of_planned(fixture, given)
        return Plan.of(fixture, source.name, image)
    if fixture.frame == "robot_base":
        raise click.UsageError(
            "MARKERS have no effect on a fixture, which is registered already. Leave them out"
        )
    settings = planning_of(fixture, given)
    planned = register(fixture, markers, arguments["markers2"], settings, image=image)
    verdict = with_verdict_by(fixture.provenance.settings, planned.fixture)
    return Plan.of(verdict, source.name, image)
