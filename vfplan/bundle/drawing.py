"""Lines and arcs for drawing programs: DXF (polylines with bulges) and SVG, in mm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.fixture import Fixture, Pieces

MARGIN_MM = 1.0  # around an SVG's drawing
Vector = NDArray[np.float64]


def dxf(fixture: Fixture) -> bytes:
    """An R12 drawing: one polyline a stroke, in space, extruded along the ignored axis."""
    pieces, axis = _pieces(fixture)
    frame = _arbitrary_axes(axis)
    rows: list[tuple[int, object]] = [(0, "SECTION"), (2, "HEADER"), (9, "$ACADVER")]
    rows += [(1, "AC1009"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    for points, bulges, closed in _strokes(pieces):
        x, y, z = 1e3 * frame @ points.T
        rows += [(0, "POLYLINE"), (8, "0"), (66, 1), (70, int(closed)), (10, 0.0), (20, 0.0)]
        rows += [(30, z.mean()), *zip((210, 220, 230), axis, strict=True)]
        for vertex in zip(x, y, np.full(len(z), z.mean()), bulges, strict=True):
            rows += [(0, "VERTEX"), (8, "0"), *zip((10, 20, 30, 42), vertex, strict=True)]
        rows.append((0, "SEQEND"))
    rows += [(0, "ENDSEC"), (0, "EOF")]
    return "".join(f"{code:3}\n{_text(value)}\n" for code, value in rows).encode()


def svg(fixture: Fixture) -> bytes:
    """A path a stroke, seen with the ignored axis pointing to the viewer."""
    pieces, axis = _pieces(fixture)
    across, up, _ = _arbitrary_axes(axis)
    paths, places = [], []
    for points, bulges, closed in _strokes(pieces):
        flat = 1e3 * np.column_stack([points @ across, -points @ up])
        places.append(flat)
        paths.append(f'<path d="{"".join(_steps(flat, bulges, closed))}"/>')
    reach = np.abs(np.diff(np.concatenate(places), axis=0)).max(initial=0.0) + MARGIN_MM
    low, high = np.min(np.vstack(places), axis=0) - reach, np.max(np.vstack(places), axis=0) + reach
    box = " ".join(f"{v:.6f}" for v in (*low, *(high - low)))
    wide, tall = (f"{v:.6f}mm" for v in high - low)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide}" height="{tall}" viewBox="{box}"'
    style = 'fill="none" stroke="black" stroke-width="0.1"'
    return "\n".join([f"{head} {style}>", *paths, "</svg>", ""]).encode()


def _pieces(fixture: Fixture) -> tuple[Pieces, Vector]:
    if fixture.pieces is None or fixture.rendering is None or fixture.ignore_axis is None:
        raise InputError(
            "a fixture without lines and arcs has no .dxf or .svg; its points have the other forms"
        )
    return fixture.pieces, fixture.ignore_axis


def _strokes(pieces: Pieces) -> Iterator[tuple[Vector, Vector, bool]]:
    for number, closed in enumerate(pieces.closed):
        own = pieces.stroke == number
        yield pieces.vertices[own], pieces.bulges[own], bool(closed)


def _arbitrary_axes(axis: Vector) -> Vector:
    """(3, 3) rows x, y and z of the coordinates that DXF gives to what is extruded along z."""
    steep = max(abs(axis[0]), abs(axis[1])) < 1 / 64
    x = np.cross([0.0, 1.0, 0.0] if steep else [0.0, 0.0, 1.0], axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis])


def _steps(flat: Vector, bulges: Vector, closed: bool) -> Iterator[str]:
    yield f"M{flat[0, 0]:.6f} {flat[0, 1]:.6f}"
    ends = [*flat[1:], *([flat[0]] if closed else [])]
    for a, b, bulge in zip(flat, ends, bulges, strict=False):
        if bulge == 0:
            yield f"L{b[0]:.6f} {b[1]:.6f}"
            continue
        radius = np.hypot(*(b - a)) * (1 + bulge**2) / (4 * abs(bulge))
        yield f"A{radius:.6f} {radius:.6f} 0 0 {int(bulge < 0)} {b[0]:.6f} {b[1]:.6f}"
    if closed:
        yield "Z"


def _text(value: object) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)
