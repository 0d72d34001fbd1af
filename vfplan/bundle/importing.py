"""Points and meshes of any origin -> a fixture: what `vfplan import` does.

PLY may be ASCII, or binary of either order, with whatever other properties and elements; STL ASCII
or binary; of OBJ the vertices and triangles are read. All that a file promises is read, or an
error; numbers keep the precision they are written in, and nothing is repaired.
"""

from __future__ import annotations

import io
import itertools
import re
import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.bundle.content import max_size, rows_by_path
from vfplan.bundle.leak import (
    joined_corners,
    largest_cover,
    open_edges,
    pieces_of,
    sides_of,
    turned_facets,
    widest_opening,
)
from vfplan.engine import PAPER_BAND
from vfplan.engine.parameters import ProxyParameters, check_axis, check_points
from vfplan.errors import InputError, SceneError, SettingError
from vfplan.findings import Finding, doubt, note
from vfplan.fixture import Curve, Fixture, Frame, Provenance, Rendering
from vfplan.geometry.lines import Array, flattened
from vfplan.io.files import (
    MAX_TEXT_BYTES,
    METRES,
    FilePath,
    check_text_size,
    named_columns,
    naming_place,
    open_number_table,
    other_unit,
    read_bytes,
)

# Corners of a rim that are closer than this share of the mesh's size are one.
WELD_SHARE = 1e-5
SUFFIXES = (".ply", ".stl", ".obj", ".csv", ".npy")
# How 3D Slicer writes the axes of the patient into the header of a mesh.
SPACE = re.compile(rb"SPACE=([^\s\0;,]*)")
# How a header names the unit and the frame of the numbers, as `vfplan export` does.
WORDS = r"\b(?:units?[ :=]+|frame |vfplan, )(px|[cmu]?m|in|image|robot_base|patient_lps)"
SAID = re.compile(WORDS + r"\s*(?:[,;]|space=|$)", re.MULTILINE)
# A name of such axes -> the sign of each against LPS.
SIGNS_OF_SPACE = {"LPS": (1, 1, 1), "RAS": (-1, -1, 1)}
# Longest header of a PLY file that is looked for [bytes].
HEADER_BYTES = 1 << 16
# PLY's name of a type -> NumPy's.
TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
USED_PROPERTIES = {"vertex": ("x", "y", "z"), "face": ("vertex_indices", "vertex_index")}
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
TEXT_SOLID = re.compile(rb"\s*solid\b[^\n]*\n", re.IGNORECASE)
TEXT_END = re.compile(rb"\s*endsolid\b[^\n]*", re.IGNORECASE)
TEXT_FACET = re.compile(
    rb"\s*facet\s+normal(?:\s+\S+){3}\s+outer\s+loop"
    + 3 * rb"\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)"
    + rb"\s+endloop\s+endfacet\b",
    re.IGNORECASE,
)

Points = Array
Triangles = NDArray[np.int32]
# Name of a property -> its values, a row for each vertex or face.
Columns = dict[str, NDArray]


@dataclass(frozen=True, eq=False)
class Mesh:
    """What a file holds."""

    # (N, 3) in the file's unit.
    points: Array
    # (K, 3) rows of `points`; `None` when the file holds no faces.
    triangles: NDArray[np.integer] | None = None
    # What else the file says, each as "element.property".
    left_out: tuple[str, ...] = ()
    # The patient's axes that it says its numbers have; "" where it says none.
    space: str = ""
    # The units and frames that it names.
    said: tuple[str, ...] = ()


def import_cloud(
    path: FilePath,
    *,
    units: str,
    frame: Frame | None = None,
    curve: str | None = None,
    spacing: float | None = None,
    stiffness: Any = 1000.0,
    contact_radius: float = 5e-3,
    point_radius: float = 0.0,
    ignore_axis: Any = None,
) -> Fixture:
    """A fixture from a .ply, .stl, .obj, .csv or .npy file.

    Parameters
    ----------
    path
        PLY, STL and OBJ may hold triangles: they are kept as they were drawn, and their corners
        are the points. CSV: columns x, y, z. NPY: (N, 3). What else the file says (colours,
        strokes, ...) is left out; `settings["left_out"]` names it.
    units
        Unit of the file's numbers, a key of `METRES`.
    frame
        Frame of the file's numbers. `None`: the one that the file says (`SPACE=` is
        "patient_lps"), else "robot_base".
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
    radius = contact_radius + point_radius
    if units not in METRES:
        raise SettingError(f"Unit {units!r} is unknown. Give one of {', '.join(METRES)}.")
    if curve not in (None, "open", "closed"):
        raise SettingError(f"Curve {curve!r} is unknown. Give 'open' or 'closed'.")
    if spacing is None:
        spacing = radius / 10
    if not (0 < contact_radius < np.inf and 0 <= point_radius < np.inf and 0 < spacing < np.inf):
        raise SettingError(
            f"The radii of tool and points are {contact_radius} and {point_radius} m, and the "
            f"spacing is {spacing} m. Give finite numbers above 0; only points may have radius 0."
        )
    axis = check_axis(ignore_axis)
    with naming_place(path):
        cloud, digest = read_cloud(Path(path), units)
        for name in cloud.said:
            unit = "px" if name == "image" else name
            if unit not in (units, "robot_base", "patient_lps"):
                text = f"The file says unit {unit}, and {units} was given as the unit. "
                text += f"{other_unit(unit)}."
                raise InputError(text, code="units-differ")
        frames = {f"frame {name}": name for name in cloud.said if name != units}
        frames |= {f"SPACE={cloud.space}": "patient_lps"} if cloud.space else {}
        frames |= {f"--frame {frame}": frame} if frame else {}
        if len({*frames.values()}) > 1:
            text = f"Frames differ: {'; '.join(frames)}. Leave --frame out, or correct the header."
            raise InputError(text, code="frames-differ")
        numbers = cloud.points * SIGNS_OF_SPACE[cloud.space or "LPS"]
        points = check_cloud(METRES[units] * numbers)
    ignored = list(cloud.left_out)
    mesh = sample_radius = strokes = None
    findings: list[Finding] = []
    if cloud.triangles is None:
        if curve is None:
            distinct = np.sort(np.unique(points, axis=0, return_index=True)[1])
            if len(distinct) < len(points):
                ignored.append(f"{len(points) - len(distinct)} points that are there twice")
                points = points[distinct]
        table = (contact_radius, None, point_radius)
        band = ProxyParameters.make(points, *table, ignore_axis=axis).band
        if curve is not None:
            strokes = Curve(np.zeros(len(points), np.int32), np.array([curve == "closed"]))
        else:
            findings = cloud_findings(points, axis, radius - band)
    else:
        if curve is not None:
            raise SettingError(
                f"The file holds triangles, whose corners have no order, so it is no {curve} "
                "curve. Leave --curve out.",
                where=path,
            )
        unused = len(points) - len(np.unique(cloud.triangles))
        if unused > 0:
            ignored.append(f"{unused} points of no triangle")
        points, mesh, findings = joined_and_turned(points, cloud.triangles)
        if len(mesh) < len(cloud.triangles):
            ignored.append(f"{len(cloud.triangles) - len(mesh)} facets without area")
        # No place of a triangle is farther from its corners than its longest side over sqrt(3).
        sample_radius = float(spacing / np.sqrt(3))
        # A mesh that no rule could sample when the bundle is loaded is refused now.
        try:
            samples, _ = _core.sampled(points, mesh, sample_radius)
        except ValueError as error:
            extent = np.ptp(points, axis=0).max()
            raise SceneError(
                f"As read, the mesh is {extent:.3g} m across, and samples {1e3 * spacing:g} mm "
                f"apart are more than {max_size('N')} points or {max_size('K')} triangles. Check "
                "--units, or give a larger --spacing.",
                code="spacing-too-fine", numbers={"spacing_m": spacing},
            ) from error  # fmt: skip
        band = sample_band(sample_radius, radius)
        widest, place = widest_opening(points, mesh, samples, radius - band)
        if widest:
            at = ", ".join(f"{1e3 * x:z.1f}" for x in place)
            text = (
                f"Through the widest opening of the mesh, at ({at}) mm, goes a ball of "
                f"{2e3 * widest:.3g} mm; the proxy is one of {2e3 * radius:g} mm. Close it, or "
                "give a larger --contact-radius."
            )
            findings.append(doubt("mesh-open", "import", text, place_m=tuple(place.tolist())))
    settings = {"units": units, "curve": curve or "none"}
    if ignored:
        settings["left_out"] = short_text(", ".join(ignored))
    return Fixture(
        frame=next(iter(frames.values()), "robot_base"),
        points=points,
        provenance=Provenance.now({"cloud": digest}, settings),
        mesh=mesh,
        sample_radius=sample_radius,
        curve=strokes,
        findings=tuple(findings),
        rendering=Rendering(
            stiffness=np.broadcast_to(np.asarray(stiffness, dtype=float), 3).copy(),
            contact_radius=contact_radius,
            band=band,
            point_radius=point_radius,
            ignore_axis=axis,
        ),
    )


def check_cloud(points: Points) -> Points:
    """The points in one piece of memory; refuses a cloud that no bundle can hold."""
    if not 1 <= len(points) <= max_size("N"):
        raise InputError(
            f"It holds {len(points)} points, and a bundle 1 to {max_size('N')}. Give a file "
            "with fewer of them, or with some."
        )
    points = check_points(points)
    limit_m = rows_by_path()["/points"].max_abs["m"]
    is_near = (np.abs(points) <= limit_m).all(axis=1)
    if not is_near.all():
        k = int(is_near.argmin())
        raise InputError(
            f"Point {k} is at {points[k].tolist()} m, and a bundle reaches {limit_m} m. Check "
            "--units, or move the points nearer to the origin of their frame.",
            code="cloud-too-far",
        )
    return points


def short_text(text: str) -> str:
    """A text as one of at most 203 characters, without control characters and slashes."""
    clean = "".join("?" if c in "/\\" or not c.isprintable() else c for c in text)
    return clean if len(clean) <= 200 else clean[:200] + "..."


def mesh_band(points: Points, triangles: Triangles, radius: float) -> float:
    """The paper's band, or how deep a proxy of `radius` dips between a mesh's corners [m]."""
    return sample_band(largest_cover(triangles, points), radius)


def sample_band(cover: float, radius: float) -> float:
    """The paper's band, or how deep a proxy of `radius` dips where samples are `cover` away [m]."""
    return max(PAPER_BAND, float(radius - np.sqrt(max(radius**2 - cover**2, 0.0))))


def read_cloud(path: Path, units: str) -> tuple[Mesh, str]:
    """What a file holds, and the SHA-256 of the very bytes it was read from."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            f"The name ends in none of {', '.join(SUFFIXES)}. Give a file of such a kind."
        )
    data, digest = read_bytes(path, MAX_TEXT_BYTES if suffix == ".csv" else 1 << 31)
    if suffix == ".npy":
        return read_npy(data), digest
    if suffix == ".csv":
        return read_csv(data, units, str(path)), digest
    return read_mesh(data, suffix), digest


def read_npy(data: bytes) -> Mesh:
    """The points of a NumPy file."""
    stream = io.BytesIO(data)
    try:
        points = np.lib.format.read_array(stream, allow_pickle=False)
    except Exception as error:  # NumPy parses the header as Python source.
        reason = str(error)[:80].partition("\n")[0]
        raise InputError(
            f"It is no .npy file of numbers: the header is not that of the data ({reason}). Save "
            "an array (N, 3) with numpy.save."
        ) from error
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise InputError(
            f"It holds {points.dtype} of shape {points.shape}. Save numbers of shape (N, 3)."
        )
    if stream.read(1):
        raise InputError("It holds more bytes than its header says. Save the array once more.")
    return Mesh(points.astype(float))


def read_csv(data: bytes, units: str, where: str) -> Mesh:
    """The points of a table: columns x, y and z, or the first three where there is no header."""
    numbers = open_number_table(lambda: io.BytesIO(data), where, InputError, header_optional=True)
    columns = numbers.columns[:3]
    if numbers.header_lines:
        columns = named_columns(numbers, units)
    elif len(columns) < 3:
        raise InputError(
            f"It has {len(columns)} columns. Give a table with x, y and z.", code="column-missing"
        )
    points = np.concatenate([np.empty((0, 3)), *numbers.blocks(columns)])
    return Mesh(points, left_out=tuple(name for name in numbers.columns if name not in columns))


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


def joined_and_turned(
    points: Points, triangles: NDArray[np.integer]
) -> tuple[Points, Triangles, list[Finding]]:
    """The triangles as `drawn` gives them, joined and turned alike where they meet, and notes."""
    points, mesh = drawn(points, triangles)
    findings = []
    reach = WELD_SHARE * float(np.ptp(points, axis=0).max())
    corner = joined_corners(points, mesh, reach)
    joined = np.count_nonzero(corner != np.arange(len(points)))
    if joined:
        points, mesh = drawn(points, corner[mesh])
        text = f"{joined} corners of rims less than {1e6 * reach:.3g} um from another were joined."
        findings.append(note("corners-welded", "import", text))
    is_turned = turned_facets(mesh)
    if is_turned.any():
        mesh[is_turned] = mesh[is_turned][:, [0, 2, 1]]
        text = f"{is_turned.sum()} of {len(mesh)} facets were turned over to face as the others do."
        findings.append(note("facets-turned", "import", text))
    one, two, three = np.moveaxis(points[mesh] - points[0], 1, 0)
    if not open_edges(mesh) and (one * np.cross(two, three)).sum() < 0:
        text = "The mesh is closed and its facets face inwards. Both sides are rendered alike."
        findings.append(note("mesh-inside-out", "import", text))
    edges, count = np.unique(sides_of(mesh), return_counts=True)
    shared = edges[count > 2] >> 32
    if len(shared):
        text = f"{len(shared)} edges belong to three triangles or more: faces doubled or crossed."
        place_m = tuple(points[shared[0]].tolist())
        findings.append(note("edges-shared", "import", text, place_m=place_m))
    return points, mesh, findings


def cloud_findings(points: Points, axis: NDArray | None, reach: float) -> list[Finding]:
    """`cloud-in-pieces`, where a proxy that keeps `reach` [m] from points passes between pieces."""
    pieces, widest = pieces_of(flattened(points, axis), 2 * reach)
    if pieces == 1:
        return []
    text = (
        f"The cloud is in {pieces} pieces more than {2e3 * reach:.4g} mm apart, and the proxy goes "
        f"between them: the widest gap found is {1e3 * widest:.3g} mm. Import denser points."
    )
    return [doubt("cloud-in-pieces", "import", text)]


def refined(
    points: Points, triangles: NDArray[np.integer], spacing: float
) -> tuple[Points, Triangles]:
    """The same surface, cleaned as `drawn` does, with no side longer than `spacing` [m].

    Every longer side is halved, in both triangles it belongs to, until none is left; the new points
    follow the corners. Raises `ValueError` when that takes more than a bundle may hold.
    """
    return _core.sampled(*drawn(points, triangles), 0.0, spacing)


# --- Mesh files ---------------------------------------------------------------------------------


def read_mesh(data: bytes, suffix: str) -> Mesh:
    """The points and triangles of a file's bytes; `suffix` is ".ply", ".stl" or ".obj".

    Of STL every facet has three points of its own (`refined` makes them one).

    Raises `InputError` when the file is not whole, or holds faces that are not triangles.
    """
    try:
        mesh, header = {".ply": read_ply, ".stl": read_stl, ".obj": read_obj}[suffix](data)
    except (KeyError, ValueError, IndexError, OverflowError, TypeError) as error:
        reason = f"{error} is unknown or missing" if isinstance(error, KeyError) else error
        raise InputError(
            f"cannot be read as {suffix[1:].upper()}: {reason}. Export it once more, with "
            "triangles alone."
        ) from error
    spaces = {name.decode("latin-1").upper() for name in SPACE.findall(header)}
    if len(spaces) > 1 or not spaces <= {*SIGNS_OF_SPACE}:
        said = " and ".join(f"SPACE={short_text(name)}" for name in sorted(spaces))
        raise InputError(
            f"The file says {said}. Save it from Slicer with LPS or RAS as its coordinate system.",
            code="space-unknown",
        )
    said = tuple(SAID.findall(header.decode("latin-1").lower()))
    return replace(mesh, space="".join(spaces), said=said)


def read_obj(data: bytes) -> tuple[Mesh, bytes]:
    """The vertices and triangles of an OBJ file, and its comments."""
    check_text_size(data)
    numbers, corners, comments = array("d"), array("q"), []
    left_out: dict[str, None] = {}
    for line in io.BytesIO(data.replace(b"\\\n", b" ")):
        match line.split():
            case [b"v", *words] if len(words) in (3, 6) or words[3:] == [b"1"]:
                numbers.extend(map(float, words[:3]))
            case [b"f", *words] if len(words) == 3:
                for word in words:
                    number = int(word.partition(b"/")[0])
                    corners.append(number - 1 if number > 0 else len(numbers) // 3 + number)
                    if not number or corners[-1] < 0:
                        raise ValueError(f"a face names vertex {number}")
            case [b"v" | b"f", *_]:
                raise ValueError(f"it says {line.strip()[:60]!r}")
            case [word, *_] if not word.startswith(b"#"):
                left_out[word.decode("latin-1")] = None
            case [_, *_]:
                comments.append(line)
    points = np.array(numbers).reshape(-1, 3)
    faces = np.array(corners, dtype=np.int64).reshape(-1, 3)
    if faces.size and faces.max() >= len(points):
        raise ValueError(f"its faces name vertex {faces.max() + 1} of {len(points)}")
    return Mesh(points, faces if len(faces) else None, tuple(left_out)), b"".join(comments)


# --- PLY ---------------------------------------------------------------------------------------


@dataclass
class Element:
    """One element of a header: its vertices, for example."""

    name: str
    count: int
    # Each as (name, type, type of the list's length, which is "" for a single number).
    properties: list[tuple[str, str, str]] = field(default_factory=list)


def read_ply(data: bytes) -> tuple[Mesh, bytes]:
    """The points and triangles of a PLY file, and its header."""
    order, elements, start = read_ply_header(data)
    if order:
        tables = binary_tables(data, start, elements, order)
    else:
        tables = text_tables(data, start, elements)
    vertex = tables["vertex"]
    points = np.column_stack([vertex["x"], vertex["y"], vertex["z"]]).astype(float)
    if points.shape[1:] != (3,):
        raise ValueError("its vertices have lists for coordinates")
    left_out = tuple(
        f"{element.name}.{name}"
        for element in elements
        for name, _, _ in element.properties
        if element.count > 0 and name not in USED_PROPERTIES.get(element.name, ())
    )
    of_faces = tables.get("face", {})
    faces = of_faces.get("vertex_indices", of_faces.get("vertex_index"))
    if faces is None or len(faces) == 0:
        return Mesh(points, left_out=left_out), data[:start]
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise ValueError("it holds faces that are not triangles")
    lowest, highest = float(faces.min()), float(faces.max())
    if not (lowest >= 0 and highest < len(points)) or np.any(faces != np.floor(faces)):
        raise ValueError(f"its faces name vertices {lowest:g} to {highest:g} of {len(points)}")
    return Mesh(points, faces.astype(np.int32), left_out), data[:start]


def read_ply_header(data: bytes) -> tuple[str, list[Element], int]:
    """(byte order, elements, offset of what follows)."""
    end = re.search(rb"^end_header[ \t\r]*\n", data[:HEADER_BYTES], re.MULTILINE)
    if data[:3] != b"ply" or end is None:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    order = None
    elements: list[Element] = []
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", form, "1.0"]:
                order = ORDERS[form]
            case ["element", name, count]:
                elements.append(Element(name, int(count)))
                if not 0 <= int(count) <= len(data):
                    raise ValueError(f"{count} of {name!r} in {len(data)} bytes")
            case ["property", "list", length, kind, name]:
                elements[-1].properties.append((name, TYPES[kind], TYPES[length]))
            case ["property", kind, name]:
                elements[-1].properties.append((name, TYPES[kind], ""))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"its header says {line.strip()[:60]!r}")
    if order is None:
        raise ValueError("its header names no format")
    return order, elements, end.end()


def binary_tables(
    data: bytes, start: int, elements: list[Element], order: str
) -> dict[str, Columns]:
    """The elements' properties, by the elements' names, of a binary file from byte `start` on."""
    tables = {}
    for element in elements:
        row = row_type(element, order, data[start : start + HEADER_BYTES])
        size = element.count * row.itemsize
        if len(data) - start < size:
            raise ValueError(
                f"{element.count} of {element.name!r} take {size} bytes, and {len(data) - start} "
                "are left"
            )
        table = np.frombuffer(data, row, element.count, start)
        tables[element.name] = columns_of(table, element)
        start += size
    if data[start:].strip():
        raise ValueError(f"{len(data) - start} bytes follow its last element")
    return tables


def row_type(element: Element, order: str, data: bytes) -> np.dtype:
    """The type of an element's rows; each list is as long as in the first row, where `data` begins.

    A list is two fields: its length, under "#" and its name, and its items.
    """
    fields: list[tuple] = []
    for name, kind, length_kind in element.properties:
        if length_kind == "":
            fields.append((name, order + kind))
            continue
        offset = np.dtype(fields).itemsize
        length_type = np.dtype(order + length_kind)
        length = 0
        if element.count > 0 and offset + length_type.itemsize <= len(data):
            length = int(np.frombuffer(data, length_type, 1, offset)[0])
        if not 0 <= length <= len(data):
            raise ValueError(f"{element.name!r} begins with a list of {length}")
        fields += [("#" + name, length_type), (name, order + kind, (length,))]
    return np.dtype(fields)


def text_tables(data: bytes, start: int, elements: list[Element]) -> dict[str, Columns]:
    """The elements' properties, by the elements' names, of a text file from byte `start` on."""
    check_text_size(data)
    count = sum(1 for _ in lines_of(data, start))
    wanted = sum(element.count for element in elements)
    if count != wanted:
        raise ValueError(f"it has {count} lines of data, and {wanted} by its header")
    # Lines are read one by one: a list of millions would take more memory than the file.
    lines = lines_of(data, start)
    tables = {}
    for element in elements:
        # Whatever the header says, the numbers of a text are float64.
        kinds = [(name, "f8", length and "f8") for name, _, length in element.properties]
        numbers = replace(element, properties=kinds)
        if element.count == 0:
            table = np.empty(0, row_type(numbers, "", b""))
        else:
            first = next(lines)
            rows = itertools.chain([first], itertools.islice(lines, element.count - 1))
            row = row_type(numbers, "", np.array(first.split(), dtype=float).tobytes())
            table = np.loadtxt(rows, row, comments=None, ndmin=1, encoding="latin-1")
        tables[element.name] = columns_of(table, element)
    return tables


def lines_of(data: bytes, start: int) -> Iterator[bytes]:
    """The lines from byte `start` on that are not blank."""
    return (line for line in io.BytesIO(data[start:]) if line.strip())


def columns_of(table: NDArray, element: Element) -> Columns:
    """The properties of an element by their names."""
    for name, _, length_kind in element.properties:
        if length_kind != "" and np.any(table["#" + name] != table[name].shape[1]):
            raise ValueError(
                f"the lists of {element.name!r} differ in length; triangles alone can be read"
            )
    return {name: table[name] for name, _, _ in element.properties}


# --- STL ---------------------------------------------------------------------------------------


def read_stl(data: bytes) -> tuple[Mesh, bytes]:
    """The facets of an STL file, each with three points of its own, and its header."""
    # A text of 80 bytes and the count of facets come first.
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else 0
    size = 84 + count * STL_FACET.itemsize
    # Some binary files begin with "solid" as those of text do, so the length decides.
    if len(data) == size:
        corners = np.frombuffer(data, STL_FACET, count, 84)["corners"].astype(float)
        header = data[:80]
    elif TEXT_SOLID.match(data):
        corners = text_facets(data)
        header = b"".join(TEXT_SOLID.findall(data))
    else:
        raise ValueError(f"it has {len(data)} bytes, and {size} by its own count of facets")
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)), header


def text_facets(data: bytes) -> Array:
    """(K, 3, 3) corners of the facets of all solids of a text."""
    check_text_size(data)
    numbers = array("d")
    offset = 0
    while solid := TEXT_SOLID.match(data, offset):
        offset = solid.end()
        while facet := TEXT_FACET.match(data, offset):
            numbers.extend(map(float, facet.groups()))
            offset = facet.end()
        end = TEXT_END.match(data, offset)
        if end is None:
            raise ValueError(f"neither a facet nor 'endsolid' follows byte {offset}")
        offset = end.end()
    if data[offset:].strip():
        raise ValueError(f"something else follows its last 'endsolid', at byte {offset}")
    return np.array(numbers).reshape(-1, 3, 3)
