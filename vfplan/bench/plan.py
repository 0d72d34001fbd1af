"""Stage plan: a slice and its markers in, a fixture out; the whole pipeline on the shipped elbow.

The error is how far the surface that the fixture's cloud renders lies from the one that the drawn
curve has on the robot's table, both ways, at places of the true surface. With the shipped markers
(touched with 0.2 mm noise) it holds the registration's error too; with exact markers it shows what
extraction and sampling alone contribute.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from scipy.spatial import cKDTree

from vfplan.bench.proxy import Elbow, R, elbow_map
from vfplan.bench.record import Array, BenchRun, Record, Setting, errors_of, timed
from vfplan.bench.sample import TrueCurve, planned_surface
from vfplan.planning.plan import plan
from vfplan.planning.settings import ExtractSettings, FixtureSettings

STRIDE = 5
"""Every so many places of the true surface count, 0.1 mm apart."""


class PlanMethod(NamedTuple):
    """A path through the pipeline: its name, its setting for the table, and its settings."""

    name: str
    listed: dict[str, Setting]
    extraction: ExtractSettings
    settings: FixtureSettings


def scenes(quick: bool, tolerance_m: float) -> Iterator[list[BenchRun]]:
    """The runs with the shipped and with exact markers."""
    tolerances = {3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, tolerance_m}
    if quick:
        tolerances = {1e-4, 1e-5, tolerance_m}
    score = partial(score_plan, surface=true_surface())
    for scene, exact in (("elbow, markers touched", False), ("elbow, exact markers", True)):
        runs = []
        for method in methods(sorted(tolerances, reverse=True)):
            run = partial(plan_elbow, method.extraction, method.settings, exact)
            chosen = method.name == "ridge" and method.listed["tolerance_m"] == tolerance_m
            runs.append(BenchRun(scene, method.name, method.listed, run, score, "m", chosen))
        yield runs


def methods(tolerances: list[float]) -> Iterator[PlanMethod]:
    """The paths through the pipeline that are compared."""
    spacing = ExtractSettings(pixel_spacing_mm=(0.5, 0.5))
    skeleton = ExtractSettings(method="skeleton")
    for tolerance in tolerances:
        settings = FixtureSettings(tolerance_m=tolerance)
        listed: dict[str, Setting] = {"tolerance_m": tolerance}
        yield PlanMethod("ridge", listed, ExtractSettings(), settings)
        yield PlanMethod("skeleton", listed, skeleton, settings)
        yield PlanMethod("ridge, rigid", listed, spacing, replace(settings, model="rigid"))
    yield PlanMethod(
        "the paper's: every mask pixel", {}, ExtractSettings(method="mask"), FixtureSettings()
    )


def plan_elbow(
    extraction: ExtractSettings, settings: FixtureSettings, exact: bool
) -> tuple[Any, Array]:
    """The plan on the shipped slice, with the shipped or with exact markers, and its time."""
    folder = Path(str(files("vfplan.samples")))
    image = folder / "elbow.png"
    source = folder / "elbow_markers_image.csv"
    target = folder / "elbow_markers_robot.csv"
    with tempfile.TemporaryDirectory(prefix="vfplan-bench-") as name:
        if exact:
            target = Path(name) / "robot.csv"
            write_exact_markers(source, target)
        call = partial(plan, image, source, target, extraction=extraction, settings=settings)
        return timed(call)


def write_exact_markers(source: Path, target: Path) -> None:
    """Write where the markers of the slice truly are in the robot's frame."""
    lines = ["label,x_m,y_m,z_m"]
    for row in source.read_text().splitlines()[1:]:
        label, u, v = row.split(",")
        x, y, z = elbow_map() @ [float(u), float(v), 1.0]
        lines.append(f"{label},{x:.17g},{y:.17g},{z:.17g}")
    target.write_text("\n".join(lines) + "\n")


def true_surface() -> Array:
    """(K, 3) places R beside the true curve in the plane of the table [m]."""
    return planned_surface(TrueCurve("elbow", *Elbow().runs))[::STRIDE]


def score_plan(planned: Any, surface: Array) -> Record:
    """|distance to the nearest point - R| at the true surface, in the plane of the table [m]."""
    points = planned.fixture.points * [1.0, 1.0, 0.0]
    nearest, _ = cKDTree(points).query(surface)
    report = planned.report["register"]
    figures = {"points": len(points), "predicted_tre_m": report["tre_rms_m"]}
    if "sampling_error_m" in report:
        figures["sampling_error_m"] = report["sampling_error_m"]
    return errors_of(nearest - R, **figures)
