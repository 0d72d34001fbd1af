"""Points and meshes of any origin -> a fixture: what `vfplan import` does."""

from __future__ import annotations

import hashlib
import warnings
from functools import partial
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.bundle.files import now_utc
from vfplan.bundle.leak import largest_cover
from vfplan.bundle.meshfile import check_mesh
from vfplan.bundle.table import table
from vfplan.disk import opened_file
from vfplan.errors import InputError, SceneError, SettingError
from vfplan.fixture import Curve, Fixture, Frame, Provenance, Rendering

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
LEAST_BAND = 1e-5  # m, the paper's
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
        PLY and STL (read in float32 precision) may hold triangles: they are refined until no edge
        is longer than `spacing`, and kept, so that the fixture can be certified. CSV: columns x,
        y, z. NPY: (N, 3).
    units
        Unit of the file's numbers, a key of `METRES`.
    curve
        "open" or "closed": the points are one curve, in order; `None`: a bare cloud.
    spacing
        Longest edge of a mesh [m]; `None`: a tenth of R.
    stiffness, contact_radius, point_radius, ignore_axis
        As in `Rendering` [N/m, m]; one stiffness serves all axes. The band is the paper's 10 um,
        or the dimple between a mesh's samples if that is deeper.

    Raises
    ------
    InputError
        The file cannot be read, is empty, or holds numbers that are not finite.
    SettingError
        A parameter outside its range.
    """
    if units not in METRES:
        raise SettingError(f"unit {units!r}; one of {', '.join(METRES)} wanted")
    points, triangles, digest = _read(Path(path), units)
    points = points * METRES[units]
    radius = contact_radius + point_radius
    _check(points, radius, str(path))
    mesh, band = None, LEAST_BAND
    if triangles is not None and curve is None:
        points, mesh = refined(points, triangles, radius / 10 if spacing is None else spacing)
        cover, _ = largest_cover(mesh, points)
        band = max(band, float(radius - np.sqrt(max(radius**2 - cover**2, 0.0))))
    settings = {"units": units, "curve": curve or "none"}
    return Fixture(
        frame=frame,
        points=points,
        provenance=Provenance(
            now_utc(), f"vfplan {installed_version('vfplan')}", {"cloud": digest}, settings
        ),
        mesh=mesh,
        curve=_as_curve(len(points), curve),
        rendering=Rendering(
            stiffness=np.broadcast_to(np.asarray(stiffness, dtype=float), 3).copy(),
            contact_radius=contact_radius,
            band=band,
            point_radius=point_radius,
            ignore_axis=_unit(ignore_axis),
        ),
    )


def _as_curve(count: int, curve: str | None) -> Curve | None:
    if curve is None:
        return None
    if curve not in ("open", "closed"):
        raise SettingError(f"curve {curve!r}; 'open' or 'closed' wanted")
    return Curve(np.zeros(count, dtype=np.int32), np.array([curve == "closed"]))


def _unit(axis: Any) -> Points | None:
    if axis is None:
        return None
    axis = np.asarray(axis, dtype=float)
    length = np.linalg.norm(axis)
    if axis.shape != (3,) or not np.isfinite(length) or length == 0:
        raise SettingError(f"ignored axis {axis.tolist()}; three finite numbers, not all 0, wanted")
    return axis / length


def _check(points: Points, radius: float, where: str) -> None:
    cap = table().sizes["N"]
    if not 1 <= len(points) <= cap:
        raise InputError(f"{len(points)} points; 1 to {cap} allowed", where=where)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(f"point {bad[0]} is not finite", where=where)
    if not radius > 0 or not np.isfinite(radius):
        raise SettingError(f"R = contact radius + point radius = {radius} m; more than 0 wanted")


def _read(path: Path, units: str) -> tuple[Points, Triangles | None, str]:
    readers = {".ply": _mesh, ".stl": _mesh, ".csv": partial(_csv, units=units), ".npy": _npy}
    if path.suffix.lower() not in readers:
        raise InputError(f"ends in none of {', '.join(readers)}", where=str(path))
    with opened_file(path) as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    points, triangles = readers[path.suffix.lower()](path)
    return points, triangles, digest


def _npy(path: Path) -> tuple[Points, None]:
    try:
        points = np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise InputError(f"is no .npy file of numbers: {error}", where=str(path)) from error
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise InputError(
            f"holds {points.dtype} of shape {points.shape}; numbers (N, 3) wanted", where=str(path)
        )
    return points.astype(float), None


def _csv(path: Path, units: str) -> tuple[Points, None]:
    try:
        with open(path, encoding="utf-8-sig") as file:
            first = file.readline().split(",")
        named = not _is_number(first[0])
        columns = _columns([name.strip().lower() for name in first], units) if named else (0, 1, 2)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty table is refused below
            points = np.loadtxt(
                path,
                delimiter=",",
                skiprows=int(named),
                usecols=columns,
                ndmin=2,
                encoding="utf-8-sig",
            )
    except (ValueError, IndexError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read as x,y,z: {error}", where=str(path)) from error
    return points.reshape(-1, 3), None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _columns(names: list[str], units: str) -> tuple[int, ...]:
    bare = [name.rpartition("_")[0] or name for name in names]
    if not {"x", "y", "z"} <= set(bare):
        raise ValueError(f"the header names {', '.join(names)}; x, y and z wanted")
    said = {name[2:] for name in names if name[:2] in ("x_", "y_", "z_")}
    if said & METRES.keys() - {units}:
        raise ValueError(f"the header names {', '.join(names)}; {units} was given as their unit")
    return tuple(bare.index(axis) for axis in "xyz")


def _mesh(path: Path) -> tuple[Points, Triangles | None]:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkObject
    from vtkmodules.vtkIOGeometry import vtkSTLReader
    from vtkmodules.vtkIOPLY import vtkPLYReader

    check_mesh(path)
    vtkObject.GlobalWarningDisplayOff()  # an error is found below, and said in one line
    reader = vtkPLYReader() if path.suffix.lower() == ".ply" else vtkSTLReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    if data is None or data.GetNumberOfPoints() == 0:
        raise InputError("no point can be read from it", where=str(path))
    points = vtk_to_numpy(data.GetPoints().GetData()).astype(float)
    faces = data.GetPolys()
    if faces.GetNumberOfCells() == 0:
        return points, None
    if faces.GetMaxCellSize() != 3 or not faces.IsHomogeneous() == 3:
        raise InputError("holds faces that are not triangles", where=str(path))
    triangles = vtk_to_numpy(faces.GetConnectivityArray()).reshape(-1, 3).astype(np.int32)
    return points, triangles


def refined(points: Points, triangles: Triangles, spacing: float) -> tuple[Points, Triangles]:
    """The same surface with no edge longer than `spacing` [m] and without unused points.

    Every longer edge is halved, in both triangles it belongs to, until none is left.

    Raises `SceneError` when that takes more points or triangles than a bundle may hold.
    """
    if not (np.isfinite(spacing) and spacing > 0):
        raise SettingError(f"spacing {spacing} m; more than 0 wanted")
    caps = table().sizes
    used, triangles = np.unique(triangles, return_inverse=True)
    points, triangles = points[used], triangles.reshape(-1, 3).astype(np.int64)
    while True:
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        edges, which = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        long = length > spacing
        if not long.any():
            return points, triangles.astype(np.int32)
        middle = np.where(long, len(points) + np.cumsum(long) - 1, -1)
        points = np.vstack([points, points[edges[long]].mean(axis=1)])
        triangles = _split(triangles, middle[which.reshape(-1, 3)], points)
        if len(points) > caps["N"] or len(triangles) > caps["K"]:
            raise SceneError(
                f"spacing {spacing} m takes more than {caps['N']} points or {caps['K']} triangles"
            )


def _split(triangles: NDArray[np.int64], middle: NDArray[np.int64], points: Points) -> Any:
    """Split triangles at the middles (-1: none) of their edges 01, 12, 20."""
    count = (middle >= 0).sum(axis=1)
    # Turn each so that a single split is on edge 01 and two splits are on 01 and 12.
    turn = np.where(count == 1, np.argmax(middle >= 0, axis=1), 0)
    turn = np.where(count == 2, (np.argmax(middle < 0, axis=1) + 1) % 3, turn)
    order = (np.arange(3) + turn[:, None]) % 3
    a, b, c = np.take_along_axis(triangles, order, axis=1).T
    ab, bc, ca = np.take_along_axis(middle, order, axis=1).T
    one, two, three = (count == n for n in (1, 2, 3))
    across = np.linalg.norm(points[a] - points[bc], axis=1)
    other = np.linalg.norm(points[c] - points[ab], axis=1)
    short = two & (across <= other)
    tall = two & ~short
    pieces = [
        (count == 0, (a, b, c)),
        (one, (a, ab, c)), (one, (ab, b, c)),
        (two, (ab, b, bc)),
        (short, (a, ab, bc)), (short, (a, bc, c)),
        (tall, (a, ab, c)), (tall, (ab, bc, c)),
        (three, (a, ab, ca)), (three, (ab, b, bc)), (three, (ca, bc, c)), (three, (ab, bc, ca)),
    ]  # fmt: skip
    return np.concatenate([np.column_stack(corners)[rows] for rows, corners in pieces])
