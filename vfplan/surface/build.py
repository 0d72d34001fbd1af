"""Outlines -> a surface in the patient, as a fixture that is certified, with its errors."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bundle.importing import mesh_band
from vfplan.bundle.leak import largest_cover, open_edges
from vfplan.display import Report
from vfplan.errors import SettingError
from vfplan.findings import doubt
from vfplan.fixture import Fixture, Provenance, Rendering
from vfplan.geometry.lines import Array, row_lengths
from vfplan.io.files import FilePath, now_utc
from vfplan.planning.extraction import MAX_TYPE_DIFFERENCE, curve_type_doubt
from vfplan.registration.touch import NearestOnMesh
from vfplan.surface.mesh import MIN_SLOPE, grid_axes, level_surface
from vfplan.surface.outline import Contours, SlicedVolume, Stack, holes_of, slice_contours
from vfplan.surface.sources import read_contours

# Largest distance of a place in a triangle from its corners, in grid steps.
#
# Over the shapes of the tests 0.89 is measured. The report has each surface's own.
COVER = 0.9
# Share of the tolerance for dimples between corners. The band takes as much, chords the rest.
DIMPLE_SHARE = 0.45
# How often the grid's step is halved for thin walls: each time takes eight times the memory.
MAX_HALVINGS = 2
# Around a piece that a disk misses, in widths of the disk: more than a corner of 20 degrees has.
LONG_MISS = 6.0
# Number of points of the outlines that are held against the surface.
MAX_CHECKED_POINTS = 10_000
# The same of each slice that is left out. A structure shows on some fifty slices.
MAX_CHECKED_POINTS_OF_SLICE = 200


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
    curve_type
        As in `ExtractSettings`.
    """

    tolerance_m: float = 1e-4
    keep_open: bool = False
    max_spacing_m: float | None = None
    contact_radius: float = 5e-3
    point_radius: float = 0.0
    stiffness: tuple[float, ...] = (1000.0,)
    curve_type: str | None = None

    @property
    def step_m(self) -> float:
        """Size of the grid whose samples keep the tolerance for the proxy's radius R [m]."""
        radius = self.contact_radius + self.point_radius
        if not 0 < self.tolerance_m < radius:
            raise SettingError(
                f"tolerance {1e3 * self.tolerance_m:g} mm is out of range. Give one above 0 and "
                f"below R = {1e3 * radius:g} mm.",
                code="out-of-range",
                numbers={"tolerance_mm": 1e3 * self.tolerance_m, "tolerance_max_mm": 1e3 * radius},
            )
        return math.sqrt(2 * radius * DIMPLE_SHARE * self.tolerance_m) / COVER


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface with its findings, the slices it came from, and the report for `--json`."""

    fixture: Fixture
    sliced: SlicedVolume
    report: Report


def surface(
    *sources: FilePath, structure: str | None = None, colour: str = "red",
    settings: SurfaceSettings | None = None,
) -> Surface:  # fmt: skip
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
    now_utc()  # A SOURCE_DATE_EPOCH that is no time is refused before the work begins.
    settings = settings or SurfaceSettings()
    started = time.perf_counter()
    step = settings.step_m
    closed = not settings.keep_open
    paths = [Path(source) for source in sources]
    contours = read_contours(paths, structure, colour, settings.curve_type)
    sliced = slice_contours(contours, settings.max_spacing_m)
    step, thin = step_for_thin(sliced, step, closed)
    levels = [level_surface(stack, step, closed=closed) for stack in sliced.stacks]
    # One mesh of all runs of slices, in the patient.
    corners, faces, distances = zip(*levels, strict=True)
    points = np.concatenate(corners) @ sliced.R_slice_patient
    starts = np.cumsum([0, *map(len, corners)])
    triangles = np.concatenate([rows + start for rows, start in zip(faces, starts, strict=False)])
    triangles = triangles.astype(np.int32)

    radius = settings.contact_radius + settings.point_radius
    fixture = Fixture(
        frame="patient_lps",
        points=points,
        provenance=Provenance.now(contours.inputs, settings),
        mesh=triangles,
        rendering=Rendering(
            stiffness=np.array(np.broadcast_to(settings.stiffness, 3), float),
            contact_radius=settings.contact_radius,
            band=mesh_band(points, triangles, radius),
            point_radius=settings.point_radius,
        ),
    )
    report = report_of(contours, sliced, fixture, settings)
    report |= {"level_error_mm": 1e3 * max(distances), "grid_mm": 1e3 * step}
    report["elapsed_s"] = time.perf_counter() - started
    texts = [*contours.remarks, *sliced.remarks, ends_remark(sliced, settings)]
    if thin:
        texts.append(
            f"{thin} parts or holes of outlines are thinner in places than the grid of "
            f"{1e3 * step:.2g} mm and may be missing there. Give a smaller --tolerance."
        )
    worst = report["contour_error_mm"]
    if worst["max"] > report["tolerance_mm"]:
        place = ", ".join(f"{1e3 * x:z.1f}" for x in worst["place_m"])
        texts.append(
            f"the surface cuts corners of the outlines by up to {worst['max']:.3f} mm, at ({place})"
            f" mm; the tolerance is {report['tolerance_mm']:g} mm. Give a smaller --tolerance."
        )
    findings = tuple(doubt("surface-doubt", "surface", text) for text in texts)
    if contours.type_difference_m > MAX_TYPE_DIFFERENCE * settings.contact_radius:
        findings += (replace(curve_type_doubt(contours.type_difference_m), stage="surface"),)
    return Surface(replace(fixture, findings=findings), sliced, report)


def step_for_thin(sliced: SlicedVolume, step: float, closed: bool) -> tuple[float, int]:
    """The grid's step, halved while parts or holes are thinner, and how many still are."""
    shapes = []
    for outline in sliced.outlines:
        shapes += [*outline.parts, *holes_of(outline)]
    for halvings in range(MAX_HALVINGS + 1):
        shapes = [shape for shape in shapes if is_thin(shape, step)]
        if not shapes or halvings == MAX_HALVINGS:
            break
        try:
            for stack in sliced.stacks:
                grid_axes(stack, step / 2, closed)
        except SettingError:
            break
        step /= 2
    return step, len(shapes)


def is_thin(shape: Any, width: float) -> bool:
    """Whether a disk of that width misses a stretch of a shape, and not its corners alone."""
    core = shape.buffer(-width / 2, quad_segs=4)
    if core.is_empty:
        return True
    missed = shape.difference(core.buffer(0.55 * width, quad_segs=4))
    return any(piece.length > LONG_MISS * width for piece in getattr(missed, "geoms", [missed]))


def report_of(
    contours: Contours, sliced: SlicedVolume, fixture: Fixture, settings: SurfaceSettings
) -> Report:  # fmt: skip
    """What `--json` says, but for the time it took."""
    gaps_mm = 1e3 * sliced.gaps_m
    held = [asdict(one) | {"chosen": one.number == contours.chosen} for one in contours.structures]
    points = fixture.points
    edges = open_edges(fixture.mesh)
    a, b, c = np.moveaxis((points - points.mean(axis=0))[fixture.mesh], 1, 0)
    volume_mm3 = None if edges else 1e9 * float((np.cross(a, b) * c).sum() / 6)
    area = float(row_lengths(np.cross(b - a, c - a)).sum() / 2)
    corners = []
    for outline in sliced.outlines:
        corners += [at_height(ring, outline.z) for ring in outline.cut_rings]
    places = every_nth(np.concatenate(corners), MAX_CHECKED_POINTS) @ sliced.R_slice_patient
    nearest, _ = NearestOnMesh(points, fixture.mesh)(places)
    contour_error = summary_of(row_lengths(places - nearest), places)
    return {
        "slices": len(sliced.outlines),
        "spacing_mm": float(np.median(gaps_mm)),
        "spacing_range_mm": [float(gaps_mm.min()), float(gaps_mm.max())],
        "normal": sliced.R_slice_patient[2],
        "structures": held,
        "outlines": len(contours.rings),
        "points": len(points),
        "triangles": len(fixture.mesh),
        "ends": "open" if settings.keep_open else "capped",
        "open_edges": edges,
        "volume_mm3": volume_mm3,
        "area_mm2": 1e6 * area,
        "extent_m": [points.min(axis=0), points.max(axis=0)],
        "tolerance_mm": 1e3 * settings.tolerance_m,
        "largest_opening_mm": 1e3 * largest_cover(fixture.mesh, points),
        "band_mm": 1e3 * fixture.band,
        "contour_error_mm": contour_error,
        "left_out_slice_mm": left_out_error(sliced),
    }


def ends_remark(sliced: SlicedVolume, settings: SurfaceSettings) -> str:
    """What became of the ends, where nothing was outlined."""
    places = [f"{1e3 * stack.z[k]:z.2f}" for stack in sliced.stacks for k in (0, -1)]
    where = f"at {', '.join(places)} mm along the slices' normal"
    if settings.keep_open:
        return f"the ends {where} are left open. A proxy can enter there: keep the tool away."
    return (
        f"the ends {where} are closed by flat caps half a slice beyond, a guess, for nothing is "
        "outlined there. Leave them open with --keep-open."
    )


def left_out_error(sliced: SlicedVolume) -> Report | None:
    """How far each inner slice's outlines are from the surface through all others [mm].

    With the slices twice as far apart this is more than what the surface is off between slices,
    about 16 times where it is smooth, and finds a slice that lies or is drawn wrong. `None` where
    no run has more than three slices.
    """
    distances = []
    places = []
    for stack in sliced.stacks:
        outlines = stack.outlines
        for k in range(1, len(outlines) - 1) if len(outlines) > 3 else ():
            # The function between two slices depends on two slices to either side.
            others = Stack(outlines[max(0, k - 2) : k] + outlines[k + 1 : k + 3])
            checked = every_nth(np.concatenate(outlines[k].cut_rings), MAX_CHECKED_POINTS_OF_SLICE)
            corners = at_height(checked, outlines[k].z)
            value, gradient = others.signed(corners)
            distances.append(np.abs(value) / np.maximum(row_lengths(gradient), MIN_SLOPE))
            places.append(corners @ sliced.R_slice_patient)
    return summary_of(np.concatenate(distances), np.concatenate(places)) if distances else None


def at_height(xy: Array, z: float) -> Array:
    """(M, 3) points of a slice's plane (M, 2) in the frame of the stack."""
    return np.c_[xy, np.full(len(xy), z)]


def every_nth(points: Array, count: int) -> Array:
    """Points thinned evenly to about a count."""
    return points[:: max(1, len(points) // count)]


def summary_of(distances: Array, places: Array) -> Report:
    """RMS and largest of distances [m] in millimetres, and the place of the largest."""
    worst = int(distances.argmax())
    return {
        "rms": 1e3 * float(np.sqrt((distances**2).mean())),
        "max": 1e3 * float(distances[worst]),
        "place_m": places[worst],
    }
