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
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from vfplan.bench.cases import Elbow, elbow_map
from vfplan.bench.record import Array, Record, Setting, Trial, errors_of, timed
from vfplan.bench.sample import Line, planned_surface
from vfplan.planning import ExtractSettings, FixtureSettings, plan

R = 5e-3
TOLERANCES = {True: (1e-4, 1e-5), False: (3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6)}
STRIDE = 5  # every fifth place of the true surface, 0.1 mm apart, is looked at


def scenes(quick: bool, tolerance_m: float) -> Iterator[list[Trial]]:
    """The trials with the shipped and with exact markers."""
    surface = true_surface()
    for name, exact in (("elbow, markers touched", False), ("elbow, exact markers", True)):
        yield list(_trials(name, exact, surface, TOLERANCES[quick], tolerance_m))


def _trials(
    scene: str, exact: bool, surface: Array, tolerances: tuple[float, ...], chosen_m: float
) -> Iterator[Trial]:
    for method, given, extraction, settings in _ways(sorted({*tolerances, chosen_m}, reverse=True)):
        run = partial(_plan, extraction, settings, exact)
        chosen = method == "ridge" and given["tolerance_m"] == chosen_m
        yield Trial(scene, method, given, run, partial(_score, surface=surface), "m", chosen)


Way = tuple[str, dict[str, Setting], ExtractSettings, FixtureSettings]


def _ways(tolerances: list[float]) -> Iterator[Way]:
    """The ways through the pipeline: their methods, settings by name, and settings."""
    for tolerance in tolerances:
        fixture = FixtureSettings(tolerance_m=tolerance)
        given: dict[str, Setting] = {"tolerance_m": tolerance}
        yield "ridge", given, ExtractSettings(), fixture
        yield "skeleton", given, ExtractSettings(method="skeleton"), fixture
        spacing = ExtractSettings(pixel_spacing_mm=(0.5, 0.5))
        yield "ridge, rigid", given, spacing, replace(fixture, model="rigid")
    yield "the paper's: every mask pixel", {}, ExtractSettings(method="mask"), FixtureSettings()


def _plan(extraction: ExtractSettings, settings: FixtureSettings, exact: bool) -> tuple[Any, Array]:
    folder = files("vfplan.samples")
    image, source, target = (
        Path(str(folder / f"elbow{name}"))
        for name in (".png", "_markers_image.csv", "_markers_robot.csv")
    )
    with tempfile.TemporaryDirectory(prefix="vfplan-bench-") as name:
        if exact:
            target = _exact_markers(source, Path(name) / "robot.csv")
        return timed(partial(plan, image, source, target, extraction=extraction, settings=settings))


def _exact_markers(source: Path, target: Path) -> Path:
    rows = [line.split(",") for line in source.read_text().splitlines()[1:]]
    px = np.array([[float(u), float(v), 1.0] for _, u, v in rows])
    lines = [
        f"{label},{x:.17g},{y:.17g},{z:.17g}"
        for (label, _, _), (x, y, z) in zip(rows, px @ elbow_map().T, strict=True)
    ]
    target.write_text("\n".join(["label,x_m,y_m,z_m", *lines]) + "\n")
    return target


def true_surface() -> Array:
    """(K, 3) places R beside the true curve in the plane of the table [m]."""
    return planned_surface(Line("elbow", *Elbow().runs))[::STRIDE]


def _score(planned: Any, surface: Array) -> Record:
    """|distance to the nearest point - R| at the true surface, in the plane of the table [m]."""
    points = planned.fixture.points * [1.0, 1.0, 0.0]
    nearest, _ = cKDTree(points).query(surface)
    report = planned.report["register"]
    more = {"points": len(points), "predicted_tre_m": report["tre_rms_m"]}
    if "sampling_error_m" in report:
        more["sampling_error_m"] = report["sampling_error_m"]
    return errors_of(nearest - R, **more)
