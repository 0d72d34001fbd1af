"""`vfplan review`: the review sheet of a slice, a curve or a fixture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from vfplan.cli import options
from vfplan.cli.options import option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command, patience
from vfplan.cli.values import FILE, HDF5, PNG


@command("review")
@click.argument("source", type=FILE, metavar="SLICE|CURVE.h5|FIXTURE.h5")
@click.argument("markers", type=FILE, required=False)
@click.argument("markers2", type=FILE, required=False)
@options.taking(
    option("--sheet-out", type=PNG, metavar="PNG", required=True,
           help="Write the review sheet: the slice, both ends and every bridge enlarged, the "
           "markers and the findings."),
    option("--slice", "slice_", type=FILE, metavar="IMAGE",
           help="The slice that a bundle was drawn on, checked by its SHA-256."),
    options.OVERWRITE,
    options.CURVE,
    options.MAKING,
)  # fmt: skip
def command(source, markers, markers2, sheet_out, slice_, **given) -> Report:
    """Show a plan to a person before it is approved.

    SOURCE is a planned slice, a curve bundle or a fixture bundle. With MARKERS a slice or a curve
    is registered first, as `plan` and `register` do, but no bundle is written.
    """
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
