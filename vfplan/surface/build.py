"""Outlines -> a surface in the patient, as a fixture that is certified, with its errors."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.bundle import mesh_band
from vfplan.bundle.leak import largest_cover, open_edges
from vfplan.errors import SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture, Provenance, Rendering
from vfplan.io.files import now_utc
from vfplan.registration.nearest import NearestOnMesh
from vfplan.surface.contours import Contours
from vfplan.surface.mesh import Level, zero_level
from vfplan.surface.slicing import Sliced, slice_contours
from vfplan.surface.sources import read_contours
from vfplan.surface.stack import Stack

Array = NDArray[np.float64]
# A triangle of the grid's cells reaches so far from its corners at most, in grid steps: measured
# 0.89 over the shapes of the tests; the report has each surface's own.
COVER = 0.9
DIMPLE_SHARE = 0.45  # of the tolerance; the band is as much, the rest is the chords'
FINEST_STEP_M = 5e-5


@dataclass(frozen=True)
class SurfaceSettings:
    """How a surface is made.

    Parameters
    ----------
    tolerance_m
        How far the rendered surface may lie from the one through the outlines [m].
    keep_open
        Leave the ends open instead of flat caps half a slice beyond.
    max_spacing_m
        The largest distance between slices that is interpolated across [m]; `None`: one and a
        half times the usual one.
    contact_radius, point_radius, stiffness
        As in `Rendering` [m, m, N/m].
    """

    tolerance_m: float = 1e-4
    keep_open: bool = False
    max_spacing_m: float | None = None
    contact_radius: float = 5e-3
    point_radius: float = 0.0
    stiffness: tuple[float, ...] = (1000.0,)

    @property
    def step_m(self) -> float:
        """Size of the grid whose samples keep the tolerance for the proxy's radius R [m]."""
        radius = self.contact_radius + self.point_radius
        if not 0 < self.tolerance_m < radius:
            raise SettingError(
                f"tolerance {1e3 * self.tolerance_m:g} mm: above 0 and below R = "
                f"{1e3 * radius:g} mm is wanted."
            )
        step = math.sqrt(2 * radius * DIMPLE_SHARE * self.tolerance_m) / COVER
        if step < FINEST_STEP_M:
            raise SettingError(
                f"tolerance {1e3 * self.tolerance_m:g} mm asks for triangles of "
                f"{1e3 * step:.2g} mm. {1e3 * FINEST_STEP_M:g} mm are the finest."
            )
        return step


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface, the slices it came from, and the report for `--json`."""

    fixture: Fixture
    sliced: Sliced
    report: dict[str, Any]
    findings: tuple[Finding, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """The texts of the findings."""
        return tuple(finding.text for finding in self.findings)


def surface(
    *sources: str | Path,
    structure: str | None = None,
    colour: str = "red",
    settings: SurfaceSettings | None = None,
) -> Surface:
    """The surface through the outlines of a structure, in the patient's LPS frame [m].

    Parameters
    ----------
    sources
        An RTSTRUCT, DICOM SEG, `.seg.nrrd` or NIfTI label map; Slicer closed curves, one or more
        `.mrk.json`; or a folder of DICOM slices with a closed curve drawn on each.
    structure
        Its name or number where a source holds several.
    colour
        The pen's, on drawn slices.
    settings
        Sampling, ends and rendering.

    Raises
    ------
    InputError, CurveError
        A source that cannot be read, or whose slices leave the surface in doubt.
    SettingError
        A tolerance out of range, or too fine for this structure.
    """
    now_utc()  # what is no time is refused before NumPy stumbles on it
    settings = settings or SurfaceSettings()
    started = time.perf_counter()
    step = settings.step_m
    contours = read_contours([Path(source) for source in sources], structure, colour)
    sliced = slice_contours(contours, settings.max_spacing_m)
    levels = [zero_level(stack, step, closed=not settings.keep_open) for stack in sliced.stacks]
    points, triangles = _joined(levels, sliced.R_slice_patient)
    radius = settings.contact_radius + settings.point_radius
    fixture = Fixture(
        frame="patient_lps",
        points=points,
        provenance=Provenance.now(contours.inputs, settings),
        mesh=triangles,
        rendering=Rendering(
            stiffness=np.array(np.broadcast_to(settings.stiffness, 3), dtype=float),
            contact_radius=settings.contact_radius,
            band=mesh_band(points, triangles, radius),
            point_radius=settings.point_radius,
        ),
    )
    report = _report(contours, sliced, levels, fixture, settings)
    report["elapsed_s"] = time.perf_counter() - started
    texts = (*contours.remarks, *sliced.remarks, *_ends(sliced, settings), *_errors(report))
    findings = tuple(doubt("surface-doubt", "surface", text) for text in texts)
    return Surface(replace(fixture, findings=findings), sliced, report, findings)


def _joined(levels: list[Level], R_slice_patient: Array) -> tuple[Array, NDArray[np.int32]]:
    """Points [m] in the patient and triangles of all runs of slices together."""
    first = np.cumsum([0, *(len(level.points) for level in levels[:-1])])
    triangles = [level.triangles + k for level, k in zip(levels, first, strict=True)]
    points = np.concatenate([level.points for level in levels]) @ R_slice_patient
    return points, np.concatenate(triangles).astype(np.int32)


def _report(
    contours: Contours,
    sliced: Sliced,
    levels: list[Level],
    fixture: Fixture,
    settings: SurfaceSettings,
) -> dict[str, Any]:
    gaps = 1e3 * sliced.gaps_m
    edges = open_edges(fixture.mesh)
    cover, _ = largest_cover(fixture.mesh, fixture.points)
    return {
        "slices": sum(len(stack.outlines) for stack in sliced.stacks),
        "spacing_mm": float(np.median(gaps)),
        "spacing_range_mm": [float(gaps.min()), float(gaps.max())],
        "normal": sliced.R_slice_patient[2],
        "structures": [
            {"number": s.number, "name": s.name, "chosen": s.number == contours.chosen}
            for s in contours.structures
        ],
        "outlines": len(contours.rings),
        "points": len(fixture.points),
        "triangles": len(fixture.mesh),
        "ends": "open" if settings.keep_open else "capped",
        "open_edges": edges,
        "volume_mm3": None if edges else 1e9 * _volume(fixture.points, fixture.mesh),
        "area_mm2": 1e6 * _area(fixture.points, fixture.mesh),
        "extent_m": [fixture.points.min(axis=0), fixture.points.max(axis=0)],
        "tolerance_mm": 1e3 * settings.tolerance_m,
        "grid_mm": 1e3 * settings.step_m,
        "largest_opening_mm": 1e3 * cover,
        "band_mm": 1e3 * fixture.band,
        "contour_error_mm": contour_error(sliced, fixture.points, fixture.mesh),
        "left_out_slice_mm": left_out_error(sliced),
        "level_error_mm": 1e3 * max(level.off_m for level in levels),
    }


def _volume(points: Array, triangles: NDArray[np.int32]) -> float:
    a, b, c = np.moveaxis((points - points.mean(axis=0))[triangles], 1, 0)
    return float((np.cross(a, b) * c).sum() / 6)


def _area(points: Array, triangles: NDArray[np.int32]) -> float:
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _ends(sliced: Sliced, settings: SurfaceSettings) -> tuple[str, ...]:
    """What became of the ends, where nothing was outlined."""
    places = [f"{1e3 * z:.2f}" for stack in sliced.stacks for z in (stack.z[0], stack.z[-1])]
    where = f"at {', '.join(places)} mm along the slices' normal"
    if settings.keep_open:
        return (f"the ends {where} are left open: a proxy can enter there",)
    return (
        f"the ends {where} are closed by flat caps half a slice beyond: a guess, for nothing is "
        "outlined there (--keep-open leaves them open)",
    )


def _errors(report: dict[str, Any]) -> tuple[str, ...]:
    found = []
    worst = report["contour_error_mm"]
    if worst["max"] > report["tolerance_mm"]:
        place = ", ".join(f"{1e3 * x:.1f}" for x in worst["place_m"])
        found.append(
            f"the surface cuts corners of the outlines by up to {worst['max']:.3f} mm, at ({place})"
            f" mm; the tolerance is {report['tolerance_mm']:g} mm: give a smaller one"
        )
    return tuple(found)


MAX_POINTS = 10_000  # of the outlines that are held against the surface
A_SLICE = 200


def contour_error(sliced: Sliced, points: Array, triangles: NDArray[np.int32]) -> dict[str, Any]:
    """Distance of the outlines to the mesh: RMS and largest [mm], and where."""
    corners = [
        np.c_[ring, np.full(len(ring), outline.z)]
        for stack in sliced.stacks
        for outline in stack.outlines
        for ring in outline.cut_rings
    ]
    places = np.concatenate(corners)
    places = places[:: max(1, len(places) // MAX_POINTS)] @ sliced.R_slice_patient
    nearest, _ = NearestOnMesh(points, triangles)(places)
    away = np.linalg.norm(places - nearest, axis=1)
    return _summary(away, places)


def left_out_error(sliced: Sliced) -> dict[str, Any] | None:
    """How far each inner slice's outlines are from the surface through all others [mm].

    With the slices twice as far apart this is more than what the surface is off between slices,
    about 16 times where it is smooth, and finds a slice that lies or is drawn wrong. `None` where a
    run has fewer than four slices.
    """
    away, places = [], []
    for stack in sliced.stacks:
        for k in range(1, len(stack.outlines) - 1) if len(stack.outlines) > 3 else ():
            rest = Stack(stack.outlines[max(0, k - 2) : k] + stack.outlines[k + 1 : k + 3])
            corners = np.concatenate(stack.outlines[k].cut_rings)
            corners = corners[:: max(1, len(corners) // A_SLICE)]
            at = np.c_[corners, np.full(len(corners), stack.outlines[k].z)]
            value, gradient = rest.signed(at)
            away.append(np.abs(value) / np.maximum(np.linalg.norm(gradient, axis=1), 0.1))
            places.append(at @ sliced.R_slice_patient)
    return _summary(np.concatenate(away), np.concatenate(places)) if away else None


def _summary(away: Array, places: Array) -> dict[str, Any]:
    worst = int(away.argmax())
    return {
        "rms": 1e3 * float(np.sqrt((away**2).mean())),
        "max": 1e3 * float(away[worst]),
        "place_m": places[worst],
    }
