"""Points touched on a surface refine its registration, held against what the markers said."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError, SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture
from vfplan.io.files import naming_place
from vfplan.io.table import read_table
from vfplan.markers.correspondences import MAX_BYTES
from vfplan.registration import Registration

COLUMNS = ("x_m", "y_m", "z_m")

# The largest ball that a probe has [m].
MAX_TIP_RADIUS_M = 0.05


@dataclass(frozen=True, eq=False)
class RefineResult:
    """A registration refined by touch, with its part of the report."""

    registration: Registration
    report: dict[str, Any]
    findings: tuple[Finding, ...]
    # SHA-256 of the file of touched points.
    sha256: str


def refine(
    curve: Fixture, registration: Registration, path: str | Path, tip_radius: float
) -> RefineResult:
    """Refine the registration of a surface by the points in a file.

    Raises SettingError: the fixture is no surface, the registration is not rigid, or the radius is
        out of range
    Raises MarkerError: the file cannot be read, or its points do not hold the bone
    """
    from vfplan.registration import refine_by_touch

    if curve.mesh is None:
        raise SettingError(
            "touched points refine the registration of a surface, which this is not. Leave "
            "--touched out",
            code="touch-no-mesh",
        )
    if not 0 <= tip_radius < MAX_TIP_RADIUS_M:
        raise SettingError(
            f"tip radius is {1e3 * tip_radius:g} mm. Give 0 to {1e3 * MAX_TIP_RADIUS_M:g} mm",
            code="tip-radius-range",
        )
    points, sha256 = read_points(path)
    with naming_place(path):
        refined = refine_by_touch(registration, points, curve.points, curve.mesh, tip_radius)

    # How far the surface moves, against what the markers allow.
    before, after = registration.apply(curve.points), refined.registration.apply(curve.points)
    moved_m = np.linalg.norm(after - before, axis=1)
    bound_m = registration.tre95_curve_m(curve.points)
    moved_over_bound = float((moved_m / np.maximum(bound_m, 1e-12)).max())
    strays = np.flatnonzero(~refined.used) + 1
    report = {
        "points": len(points),
        "left_out": strays,
        "rms_m": refined.rms_m,
        "before_rms_m": float(np.sqrt((refined.before_m[refined.used] ** 2).mean())),
        "held": refined.constraint,
        "moved_max_m": float(moved_m.max()),
        "moved_over_markers_bound95": moved_over_bound,
        "tip_radius_m": tip_radius,
    }
    findings = []
    if len(strays):
        rows = ", ".join(map(str, strays[:8]))
        if len(strays) > 8:
            rows += ", ..."
        text = (
            f"{len(strays)} of {len(points)} touched points lie off the surface and are left "
            f"out: {rows}. Check that the bone was touched there."
        )
        findings.append(doubt("touch-left-out", "register", text))
    if moved_over_bound > 1:
        text = (
            f"Touching moves the surface by up to {1e3 * moved_m.max():.3f} mm, "
            f"{moved_over_bound:.1f} times the markers' 95 % bound. Did a marker move, or is "
            "something else touched?"
        )
        findings.append(doubt("touch-moves-far", "register", text))
    return RefineResult(refined.registration, report, tuple(findings), sha256)


def read_points(path: str | Path) -> tuple[NDArray[np.float64], str]:
    """(T, 3) places [m] that a robot touched, and their file's SHA-256.

    Columns `label` and `t` may stand beside them.

    Raises MarkerError: the file cannot be read, has other columns, or holds a value that is not a
        finite number
    """
    table, sha256 = read_table(path, MAX_BYTES, MarkerError)
    names = [name.casefold() for name in table.header]
    if not set(COLUMNS) <= set(names) <= {*COLUMNS, "label", "t"}:
        raise MarkerError(
            f"its columns are {','.join(names)[:80]!r}. Give {','.join(COLUMNS)}",
            where=str(path),
            code="column-missing",
        )
    columns = tuple(table.header[names.index(name)] for name in COLUMNS)
    table.check_decimals(columns)
    places = np.empty((len(table.rows), 3))
    for i, row in enumerate(table.rows):
        for k, column in enumerate(columns):
            places[i, k] = table.number(row, column)
    return places, sha256
