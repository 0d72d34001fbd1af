"""Points touched on a surface refine its registration, held against what the markers said."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.errors import MarkerError, SettingError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture
from vfplan.io.files import naming_place
from vfplan.io.table import read_table
from vfplan.registration import Registration

COLUMNS = ("x_m", "y_m", "z_m")
MAX_BYTES = 16 * 2**20


@dataclass(frozen=True, eq=False)
class Refined:
    """A registration refined by touch, with its part of the report."""

    registration: Registration
    report: dict[str, Any]
    findings: tuple[Finding, ...]
    sha256: str  # of the file of touched points


def touch(
    curve: Fixture, registration: Registration, path: str | Path, tip_radius: float
) -> Refined:
    """Refine the registration of a surface by the points in a file.

    Raises SettingError: the fixture is no surface, the registration is not rigid, or the radius is
        out of range
    Raises MarkerError: the file cannot be read, or its points do not hold the bone
    """
    from vfplan.registration.touch import refine_by_touch

    if curve.mesh is None:
        raise SettingError("touched points refine the registration of a surface; this is none")
    if not 0 <= tip_radius < 0.05:
        raise SettingError(f"tip radius {1e3 * tip_radius:g} mm; 0 to 50 mm are allowed")
    points, sha256 = read_touched(path)
    with naming_place(path):
        found = refine_by_touch(registration, points, curve.points, curve.mesh, tip_radius)
    moved = np.linalg.norm(
        found.registration.apply(curve.points) - registration.apply(curve.points), axis=1
    )
    bound = registration.tre95_curve_m(curve.points)
    beyond = float((moved / np.maximum(bound, 1e-12)).max())
    stray = np.flatnonzero(~found.used)
    report = {
        "points": len(points),
        "left_out": stray + 1,
        "rms_m": found.rms_m,
        "before_rms_m": float(np.sqrt((found.before_m[found.used] ** 2).mean())),
        "held": found.constraint,
        "moved_max_m": float(moved.max()),
        "moved_over_markers_bound95": beyond,
        "tip_radius_m": tip_radius,
    }
    return Refined(found.registration, report, _findings(report), sha256)


def _findings(report: dict[str, Any]) -> tuple[Finding, ...]:
    findings = []
    if len(report["left_out"]):
        rows = ", ".join(map(str, report["left_out"][:8]))
        text = (
            f"{len(report['left_out'])} of {report['points']} touched points lie off the surface "
            f"and are left out: {rows}{', ...' if len(report['left_out']) > 8 else ''}"
        )
        findings.append(doubt("touch-left-out", "register", text))
    if report["moved_over_markers_bound95"] > 1:
        text = (
            f"touching moves the surface by up to {1e3 * report['moved_max_m']:.3f} mm, "
            f"{report['moved_over_markers_bound95']:.1f} times what the markers' 95 % bound "
            "allows: did a marker move, or is something else touched?"
        )
        findings.append(doubt("touch-moves-far", "register", text))
    return tuple(findings)


def read_touched(path: str | Path) -> tuple[np.ndarray, str]:
    """(T, 3) places [m] that a robot touched, and their file's SHA-256.

    Columns `label` and `t` may stand beside them.

    Raises MarkerError: the file cannot be read, has other columns, or holds a value that is not a
        finite number
    """
    table, sha256 = read_table(path, MAX_BYTES, MarkerError)
    names = [name.casefold() for name in table.header]
    if not set(COLUMNS) <= set(names) <= {*COLUMNS, "label", "t"}:
        raise MarkerError(
            f"its columns are {','.join(names)[:80]!r}; {','.join(COLUMNS)} is wanted",
            where=str(path),
            code="column-missing",
        )
    columns = tuple(table.header[names.index(name)] for name in COLUMNS)
    table.check_decimals(columns)
    places = [[table.number(row, column) for column in columns] for row in table.rows]
    return np.array(places).reshape(-1, 3), sha256
