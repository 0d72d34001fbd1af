"""Points and meshes of any origin -> a fixture: what `vfplan import` does."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.bundle.content import max_size
from vfplan.bundle.leak import largest_cover
from vfplan.bundle.meshfile import Mesh, read_mesh
from vfplan.engine.parameters import PAPER_BAND, check_axis, check_points, default_band
from vfplan.errors import InputError, SceneError, SettingError
from vfplan.fixture import Curve, Fixture, Frame, Provenance, Rendering
from vfplan.io.files import (
    MAX_TEXT_BYTES,
    NumberTable,
    naming_place,
    npy_header,
    open_number_table,
    read_bytes,
)

METRES = {"m": 1.0}
"""Unit of a file's numbers -> metres."""
METRES["cm"] = 1e-2
METRES["mm"] = 1e-3
METRES["um"] = 1e-6
METRES["in"] = 0.0254
SUFFIXES = (".ply", ".stl", ".csv", ".npy")
MAX_BYTES = 1 << 31
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
        raise SettingError(f"Unit {units!r} is unknown. Give one of {', '.join(METRES)}.")
    if curve not in (None, "open", "closed"):
        raise SettingError(f"Curve {curve!r} is unknown. Give 'open' or 'closed'.")
    radius = contact_radius + point_radius
    if not 0 < radius < np.inf:
        raise SettingError(
            f"R = contact radius + point radius is {radius} m. Give radii whose sum is above 0."
        )
    axis = check_axis(ignore_axis)
    cloud, digest = read_cloud(Path(path), units)
    points = check_cloud(METRES[units] * cloud.points, str(path))
    ignored = list(cloud.left_out)
    mesh = None
    sample_radius = None
    strokes = None
    if cloud.triangles is None:
        band = default_band(points, contact_radius, point_radius, axis)
        if curve is not None:
            stroke = np.zeros(len(points), dtype=np.int32)
            strokes = Curve(stroke, np.array([curve == "closed"]))
    else:
        if curve is not None:
            raise SettingError(
                f"The file holds triangles, whose corners have no order, so it is no {curve} "
                "curve. Leave --curve out.",
                where=str(path),
            )
        unused = len(points) - len(np.unique(cloud.triangles))
        if unused > 0:
            ignored.append(f"{unused} points of no triangle")
        if spacing is None:
            spacing = radius / 10
        check_spacing(points[cloud.triangles], spacing)
        points, mesh = drawn(points, cloud.triangles)
        # No place of a triangle is farther from its corners than its longest side over sqrt(3).
        sample_radius = float(spacing / np.sqrt(3))
        # A mesh that no rule could sample when the bundle is loaded is refused now.
        try:
            _core.sampled(points, mesh, sample_radius)
        except ValueError as error:
            raise too_many_samples(spacing) from error
        band = sample_band(sample_radius, radius)
    settings = {"units": units, "curve": curve or "none"}
    if ignored:
        settings["left_out"] = short_text(", ".join(ignored))
    return Fixture(
        frame=frame,
        points=points,
        provenance=Provenance.now({"cloud": digest}, settings),
        mesh=mesh,
        sample_radius=sample_radius,
        curve=strokes,
        rendering=Rendering(
            stiffness=np.broadcast_to(np.asarray(stiffness, dtype=float), 3).copy(),
            contact_radius=contact_radius,
            band=band,
            point_radius=point_radius,
            ignore_axis=axis,
        ),
    )


def check_cloud(points: Points, where: str) -> Points:
    """The points in one piece of memory; refuses a cloud that no bundle can hold."""
    with naming_place(where):
        if not 1 <= len(points) <= max_size("N"):
            raise InputError(
                f"It holds {len(points)} points, and a bundle 1 to {max_size('N')}. Give a file "
                "with fewer of them, or with some."
            )
        is_finite = np.isfinite(points).all(axis=1)
        if not is_finite.all():
            raise InputError(
                f"Point {is_finite.argmin()} is not finite. Remove it, or write its coordinates."
            )
        return check_points(points)


def short_text(text: str) -> str:
    """A text as one of at most 203 characters, without control characters and slashes."""
    clean = ""
    for character in text:
        if character.isprintable() and character not in "/\\":
            clean += character
        else:
            clean += "?"
    if len(clean) > 200:
        clean = clean[:200] + "..."
    return clean


def mesh_band(points: Points, triangles: NDArray[np.int32], radius: float) -> float:
    """The paper's band, or how deep a proxy of `radius` dips between a mesh's corners [m]."""
    cover = largest_cover(triangles, points)
    return sample_band(cover, radius)


def sample_band(cover: float, radius: float) -> float:
    """The paper's band, or how deep a proxy of `radius` dips where samples are `cover` away [m]."""
    return max(PAPER_BAND, float(radius - np.sqrt(max(radius**2 - cover**2, 0.0))))


def read_cloud(path: Path, units: str) -> tuple[Mesh, str]:
    """What a file holds, and the SHA-256 of the very bytes it was read from."""
    suffix = path.suffix.lower()
    where = str(path)
    if suffix not in SUFFIXES:
        raise InputError(
            f"The name ends in none of {', '.join(SUFFIXES)}. Give a file of such a kind.",
            where=where,
        )
    max_bytes = MAX_TEXT_BYTES if suffix == ".csv" else MAX_BYTES
    data, digest = read_bytes(path, max_bytes)
    if suffix == ".npy":
        return read_npy(data, where), digest
    if suffix == ".csv":
        return read_csv(data, units, where), digest
    return read_mesh(data, suffix, where), digest


def read_npy(data: bytes, where: str) -> Mesh:
    """The points of a NumPy file."""
    stream = io.BytesIO(data)
    try:
        npy_header(stream)
        stream.seek(0)
        points = np.lib.format.read_array(stream, allow_pickle=False)
    except (ValueError, EOFError, OverflowError, MemoryError) as error:
        raise InputError(
            f"It is no .npy file of numbers: {error}. Save an array (N, 3) with numpy.save.",
            where=where,
        ) from error
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise InputError(
            f"It holds {points.dtype} of shape {points.shape}. Save numbers of shape (N, 3).",
            where=where,
        )
    if stream.read(1):
        raise InputError(
            "It holds more bytes than its header says. Save the array once more.", where=where
        )
    return Mesh(points.astype(float))


def read_csv(data: bytes, units: str, where: str) -> Mesh:
    """The points of a table: columns x, y and z, or the first three where there is no header."""
    table = open_number_table(lambda: io.BytesIO(data), where, InputError, header_optional=True)
    columns = table.columns[:3]
    if table.header_lines:
        columns = named_columns(table, units)
    elif len(columns) < 3:
        raise InputError(
            f"It has {len(columns)} columns. Give a table with x, y and z.",
            where=where,
            code="column-missing",
        )
    points = np.concatenate([np.empty((0, 3)), *table.blocks(columns)])
    return Mesh(points, left_out=tuple(name for name in table.columns if name not in columns))


def named_columns(table: NumberTable, units: str) -> tuple[str, ...]:
    """The columns x, y and z, whose names may end in their unit (x_mm)."""
    columns = []
    for axis in "xyz":
        candidates = [name for name in table.columns if name.partition("_")[0] == axis]
        if not candidates:
            raise InputError(
                f"The header names {', '.join(table.columns)[:80]}, and no {axis}. Name the "
                "columns of the coordinates x, y and z.",
                where=table.where,
                code="column-missing",
            )
        column = candidates[0]
        columns.append(column)
        unit = column.partition("_")[2]
        if unit != units and (unit in METRES or unit == "px"):
            raise InputError(
                f"The header names {column}, and {units} was given as the unit. Give --units "
                f"{unit}, or name the column by its true unit.",
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
        raise SceneError(
            "No triangle has three different corners. Export the mesh with more digits.",
            code="no-triangle",
        )
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
    check_spacing(points[triangles], spacing)
    try:
        return _core.refined(*drawn(points, triangles), spacing)
    except ValueError as error:
        raise too_many_samples(spacing) from error


def check_spacing(corners: NDArray[np.float64], spacing: float) -> None:
    """Refuse a spacing [m] that takes too many samples of triangles (K, 3, 3), at once."""
    if not (np.isfinite(spacing) and spacing > 0):
        raise SettingError(
            f"The spacing is {spacing} m. Give a number above 0.",
            code="spacing-out-of-range",
            numbers={"spacing_m": spacing},
        )
    one, two, three = np.moveaxis(corners, 1, 0)
    area = np.linalg.norm(np.cross(two - one, three - one), axis=1).sum() / 2
    # No triangle without a longer side has more area than one with three sides of that length.
    if area > max_size("K") * np.sqrt(3) / 4 * spacing**2:
        raise too_many_samples(spacing)


def too_many_samples(spacing: float) -> SceneError:
    """The error of a mesh that takes more samples than a bundle may hold."""
    return SceneError(
        f"A spacing of {spacing} m takes more than {max_size('N')} points or {max_size('K')} "
        "triangles. Give a larger --spacing.",
        code="spacing-too-fine",
        numbers={"spacing_m": spacing},
    )
