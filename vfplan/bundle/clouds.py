"""Points and meshes of any origin -> a fixture: what `vfplan import` does."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.bundle.leak import largest_cover
from vfplan.bundle.meshfile import Mesh, read_mesh
from vfplan.bundle.schema import max_size
from vfplan.engine.parameters import PAPER_BAND, check_axis, check_points, default_band
from vfplan.errors import InputError, SceneError, SettingError
from vfplan.fixture import Curve, Fixture, Frame, Provenance, Rendering
from vfplan.io.files import MAX_TEXT_BYTES, naming_place, read_bytes
from vfplan.io.npy import npy_header
from vfplan.io.table import NumberTable, open_number_table

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
SUFFIXES = (".ply", ".stl", ".csv", ".npy")
MOST_BYTES = 1 << 31
Points = NDArray[np.float64]
Triangles = NDArray[np.int32]


def import_cloud(
    path: str | Path,
    *,
    units: str,
    frame: Frame = "robot_base",
    curve: str | None = None,
    spacing: float | None = None,
    stiffness: Any = 1000.0,
    contact_radius: float = 5e-3,
    point_radius: float = 0.0,
    ignore_axis: Any = None,
) -> Fixture:
    """A fixture from a .ply, .stl, .csv or .npy file.

    Parameters
    ----------
    path
        PLY and STL may hold triangles: they are kept as they were drawn, and their corners are the
        points. CSV: columns x, y, z. NPY: (N, 3). What else the file says (colours, strokes, ...)
        is left out; `settings["left_out"]` names it.
    units
        Unit of the file's numbers, a key of `METRES`.
    curve
        "open" or "closed": the points are one curve, in order; `None`: a bare cloud.
    spacing
        Longest distance between neighbours [m] of the samples that a rule takes of the triangles
        when it renders points; `None`: a tenth of R.
    stiffness, contact_radius, point_radius, ignore_axis
        As in `Rendering` [N/m, m]; one stiffness serves all axes. The band is the paper's 10 um,
        or what a ball sinks into between the samples if that is deeper.

    Raises
    ------
    InputError
        The file cannot be read, is empty, or holds numbers that are not finite.
    SettingError
        A parameter outside its range.
    """
    if units not in METRES:
        raise SettingError(f"unit {units!r}; one of {', '.join(METRES)} wanted")
    found, digest = _read(Path(path), units)
    points, triangles = found.points * METRES[units], found.triangles
    radius = contact_radius + point_radius
    if not 0 < radius < np.inf:
        raise SettingError(f"R = contact radius + point radius = {radius} m; more than 0 wanted")
    with naming_place(path):
        if not 1 <= len(points) <= max_size("N"):
            raise InputError(f"{len(points)} points; 1 to {max_size('N')} are allowed")
        if not (finite := np.isfinite(points).all(axis=1)).all():
            raise InputError(f"point {finite.argmin()} is not finite")
        points = check_points(points)
    mesh, sample_radius = None, None
    axis, left_out = check_axis(ignore_axis), list(found.left_out)
    if triangles is not None:
        if curve is not None:
            raise SettingError(
                f"curve {curve!r}: triangles have corners in no order", where=str(path)
            )
        if unused := len(points) - len(np.unique(triangles)):
            left_out.append(f"{unused} points of no triangle")
        if spacing is None:
            spacing = radius / 10
        _check_spacing(points[triangles], spacing)
        points, mesh = drawn(points, triangles)
        # No place of a triangle is farther from its corners than its longest side over sqrt(3).
        sample_radius = float(spacing / np.sqrt(3))
        _check_samples(points, mesh, spacing, sample_radius)
        band = sample_band(sample_radius, radius)
    else:
        band = default_band(points, contact_radius, point_radius, axis)
    settings = {"units": units, "curve": curve or "none"}
    if left_out:  # as one short text without control characters
        text = ", ".join(left_out)
        clean = "".join(c if c.isprintable() and c not in "/\\" else "?" for c in text)
        settings["left_out"] = clean if len(clean) <= 200 else clean[:200] + "..."
    return Fixture(
        frame=frame,
        points=points,
        provenance=Provenance.now({"cloud": digest}, settings),
        mesh=mesh,
        sample_radius=sample_radius,
        curve=_as_curve(len(points), curve),
        rendering=Rendering(
            stiffness=np.broadcast_to(np.asarray(stiffness, dtype=float), 3).copy(),
            contact_radius=contact_radius,
            band=band,
            point_radius=point_radius,
            ignore_axis=axis,
        ),
    )


def mesh_band(points: Points, triangles: NDArray[np.int32], radius: float) -> float:
    """The paper's band, or how deep a proxy of `radius` dips between a mesh's corners [m]."""
    cover, _ = largest_cover(triangles, points)
    return sample_band(cover, radius)


def sample_band(cover: float, radius: float) -> float:
    """The paper's band, or how deep a proxy of `radius` dips where samples are `cover` away [m]."""
    return max(PAPER_BAND, float(radius - np.sqrt(max(radius**2 - cover**2, 0.0))))


def _as_curve(count: int, curve: str | None) -> Curve | None:
    if curve is None:
        return None
    if curve not in ("open", "closed"):
        raise SettingError(f"curve {curve!r}; 'open' or 'closed' wanted")
    return Curve(np.zeros(count, dtype=np.int32), np.array([curve == "closed"]))


def _read(path: Path, units: str) -> tuple[Mesh, str]:
    """What a file holds, and the SHA-256 of the very bytes it was read from."""
    suffix, where = path.suffix.lower(), str(path)
    if suffix not in SUFFIXES:
        raise InputError(f"ends in none of {', '.join(SUFFIXES)}", where=where)
    most = MAX_TEXT_BYTES if suffix == ".csv" else MOST_BYTES
    data, digest = read_bytes(path, most)
    if suffix == ".npy":
        found = _npy(data, where)
    elif suffix == ".csv":
        found = _csv(data, units, where)
    else:
        found = read_mesh(data, suffix, where)
    return found, digest


def _npy(data: bytes, where: str) -> Mesh:
    stream = io.BytesIO(data)
    try:
        npy_header(stream)
        stream.seek(0)
        points = np.lib.format.read_array(stream, allow_pickle=False)
    except (ValueError, EOFError, OverflowError, MemoryError) as error:
        raise InputError(f"is no .npy file of numbers: {error}", where=where) from error
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise InputError(
            f"holds {points.dtype} of shape {points.shape}; numbers (N, 3) wanted", where=where
        )
    if stream.read(1):
        raise InputError("holds more bytes than its header wants", where=where)
    return Mesh(points.astype(float))


def _csv(data: bytes, units: str, where: str) -> Mesh:
    table = open_number_table(lambda: io.BytesIO(data), where, InputError, header_optional=True)
    columns = table.columns[:3]
    if table.header_lines:
        columns = _named_columns(table, units)
    elif len(columns) < 3:
        raise InputError(
            f"has {len(columns)} columns; x, y and z are wanted", where=where, code="column-missing"
        )
    points = np.concatenate([np.empty((0, 3)), *table.blocks(columns)])
    left_out = [name for name in table.columns if name not in columns]
    return Mesh(points, left_out=tuple(left_out))


def _named_columns(table: NumberTable, units: str) -> tuple[str, ...]:
    """The columns x, y and z, whose names may end in their unit (x_mm)."""
    columns = []
    for axis in "xyz":
        named = [name for name in table.columns if name.partition("_")[0] == axis]
        if not named:
            raise InputError(
                f"the header names {', '.join(table.columns)[:80]}; x, y and z are wanted",
                where=table.where,
                code="column-missing",
            )
        columns.append(named[0])
        unit = named[0].partition("_")[2]
        if unit in (METRES.keys() | {"px"}) - {units}:
            raise InputError(
                f"the header names {named[0]}; {units} was given as the unit of its numbers",
                where=table.where,
                code="units-differ",
            )
    return tuple(columns)


def drawn(points: Points, triangles: NDArray[np.integer]) -> tuple[Points, Triangles]:
    """The triangles as they were drawn, on points that are each there once.

    Points at one place become one. Those of no triangle are left out, and so are triangles that
    bound nothing because two of their corners are one point.

    Raises `SceneError` if no triangle is left.
    """
    _, first, number = np.unique(points, axis=0, return_index=True, return_inverse=True)
    rows = first[number.ravel()][triangles]
    has_area = (rows != np.roll(rows, 1, axis=1)).all(axis=1)
    if not has_area.any():
        raise SceneError("no triangle has three corners apart", code="no-triangle")
    used, rows = np.unique(rows[has_area], return_inverse=True)
    return points[used], rows.reshape(-1, 3).astype(np.int32)


def refined(
    points: Points, triangles: NDArray[np.integer], spacing: float
) -> tuple[Points, Triangles]:
    """The same surface with no side of a triangle longer than `spacing` [m].

    It is cleaned as `drawn` does. Every longer side is halved, in both triangles it belongs to,
    until none is left; the new points follow the corners.

    Raises `SceneError` when that takes more points or triangles than a bundle may hold.
    """
    _check_spacing(points[triangles], spacing)
    try:
        return _core.refined(*drawn(points, triangles), spacing)
    except ValueError as error:
        raise _too_many(spacing) from error


def _check_spacing(corners: NDArray[np.float64], spacing: float) -> None:
    """Refuse a spacing [m] that takes too many samples of triangles (K, 3, 3), at once."""
    if not (np.isfinite(spacing) and spacing > 0):
        raise SettingError(
            f"spacing {spacing} m; more than 0 wanted",
            code="spacing-out-of-range",
            numbers={"spacing_m": spacing},
        )
    one, two, three = np.moveaxis(corners, 1, 0)
    area = np.linalg.norm(np.cross(two - one, three - one), axis=1).sum() / 2
    # No triangle without a longer side has more area than one with three sides of that length.
    if area > max_size("K") * np.sqrt(3) / 4 * spacing**2:
        raise _too_many(spacing)


def _check_samples(
    points: Points, triangles: Triangles, spacing: float, sample_radius: float
) -> None:
    """Refuse a mesh that no rule could sample when the bundle is loaded."""
    try:
        _core.sampled(points, triangles, sample_radius)
    except ValueError as error:
        raise _too_many(spacing) from error


def _too_many(spacing: float) -> SceneError:
    return SceneError(
        f"spacing {spacing} m takes more than {max_size('N')} points or {max_size('K')} "
        "triangles. Give a larger --spacing",
        code="spacing-too-fine",
        numbers={"spacing_m": spacing},
    )
