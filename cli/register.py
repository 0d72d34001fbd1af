"""`vfplan register`: carry a curve into the robot's frame and make it a fixture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from vfplan.cli.options import FILE, fixture_options, fixture_settings, output
from vfplan.cli.run import Report, command, outputs, refuse_existing


@command("register", short_help="Markers and a curve in, a fixture out.")
@click.argument("curve", type=FILE, metavar="CURVE.h5")
@click.argument("markers", type=FILE)
@click.argument("markers2", type=FILE, required=False)
@output("The fixture bundle to write.")
@fixture_options
def command(
    curve: Path, markers: Path, markers2: Path | None, output: Path, overwrite: bool, **given: Any
) -> Report:
    """Register CURVE.h5 to the robot by MARKERS and write a fixture bundle.

    MARKERS is one CSV (label,u_px,v_px,x_m,y_m,z_m), or two files joined by label: CSV, Slicer
    .mrk.json or .fcsv.
    """
    from vfplan.bundle import read_fixture, write_fixture
    from vfplan.pipeline import register

    settings = fixture_settings(given)
    refuse_existing(output, overwrite=overwrite)
    planned = register(read_fixture(curve), markers, markers2, settings)
    with outputs(output) as (path,):
        write_fixture(planned.fixture, path)
    text = f"{registered_text(planned.report)}\nwrote {output}"
    return Report(planned.report, text, warnings=list(planned.warnings))


def registered_text(report: dict[str, Any]) -> str:
    """The registration on a few lines."""

    def mm(metres: float | None) -> str:
        return "unknown" if metres is None else f"{metres * 1e3:.3f} mm"

    worst = max(report["residuals"], key=lambda r: r["residual_m"])
    lines = [
        f"{report['model']} registration from {report['markers']} markers",
        f"  FRE {mm(report['fre_rms_m'])} rms, worst {worst['label']} {mm(worst['residual_m'])}",
        f"  leave-one-out {mm(report['loo_rms_m'])} rms",
        f"  predicted TRE over the curve {mm(report['tre_rms_m'])} rms",
    ]
    if report["outliers"]:
        lines.append(f"  outliers: {', '.join(map(str, report['outliers']))}")
    lines.append(f"{report['points']} points, {mm(report['spacing_m'])} apart")
    if "sampling_error_m" in report:
        lines[-1] += (
            f"; {report['left_out']['points']} points left out, which adds at most "
            f"{report['sampling_error_m'] * 1e6:.1f} um to the surface"
        )
    return "\n".join(lines)
