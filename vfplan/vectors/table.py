"""A curve as a table: a CSV with the columns u_px,v_px, or with ImageJ's X,Y."""

from __future__ import annotations

from vfplan.errors import CurveError, MarkerError
from vfplan.io.table import split_rows
from vfplan.vectors import imagej
from vfplan.vectors.curve import VectorDrawing, distinct_points, without_repeated_end


def read_table(text: str, origin: imagej.PixelOrigin | None, where: str) -> VectorDrawing:
    """A CSV with the columns u_px,v_px, or with ImageJ's X,Y."""
    rows = [row for _, row in split_rows(text, where, MarkerError)]
    header = [name.strip() for name in rows[0]] if rows else []
    if imagej.is_xy_table(header):
        points = imagej.read_xy_table(rows, origin, where)
    elif header == ["u_px", "v_px"]:  # With a label as well it is a list of markers.
        imagej.refuse_origin(origin, "u_px,v_px")
        points = imagej.parse_pixels(rows[1:], where)
    else:
        raise CurveError(
            f"is no image, and as a curve its header is {','.join(header)[:60]!r}. Give "
            "u_px,v_px or ImageJ's X,Y",
            where=where,
            code="table-header",
        )
    points, closed = without_repeated_end(points)
    return VectorDrawing(distinct_points(points, closed, where), closed, False, "")
