"""A curve drawn as an ImageJ selection: `.roi`, or a table of its X,Y coordinates.

ImageJ counts the coordinates of area selections from a pixel's corner, and those of line selections
from its centre (class `ij.gui.Roi`, since ImageJ 1.52u of March 2020; before, all from the corner).
Here a whole number is a pixel's centre.
"""

from __future__ import annotations

import logging
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, MissingExtra, SettingError
from vfplan.geometry import CORNER_PX
from vfplan.io.files import parse_decimal

PixelOrigin = Literal["centre", "corner"]
ORIGINS = ("centre", "corner")
"""Where ImageJ's zero may lie on the first pixel."""
AREAS = ("POLYGON", "FREEHAND", "TRACED")
LINES = ("POLYLINE", "FREELINE")
UNCLEAR_FORMAT = 228
"""The format of a `.roi` that counts in either way: ImageJ 1.52i to 1.54 wrote it. The lines of
older formats count from corners, those of newer ones from centres."""
NAME_ORIGIN = "Say where it counts a pixel from: --curve-origin centre or corner"


def is_roi(data: bytes) -> bool:
    """Whether the bytes begin as an ImageJ selection does."""
    return data[:4] == b"Iout"


def read_roi(
    data: bytes, origin: PixelOrigin | None, where: str
) -> tuple[NDArray[np.float64], bool, tuple[str, ...]]:
    """The (M, 2) vertices (u, v) [px] of a `.roi`, whether it is closed, and warnings.

    Raises
    ------
    CurveError
        The file is damaged or no polygon and no polyline, or it does not tell how it counts and
        `origin` is `None`.
    SettingError
        The file tells how it counts, and `origin` is given.
    MissingExtra
        The package roifile is not installed.
    """
    try:
        import roifile
    except ModuleNotFoundError:
        raise MissingExtra(
            "reading an ImageJ .roi needs the package roifile. Run pip install 'vfplan[imagej]'",
            where=where,
        ) from None
    logging.getLogger("roifile").addHandler(logging.NullHandler())
    try:
        roi = roifile.ImagejRoi.frombytes(data)
        coordinates = roi.coordinates()
    except Exception as error:  # The file is foreign: numpy, struct and codecs raise all sorts.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise CurveError(
            f"the ImageJ selection cannot be read: {reason}. Save it again in ImageJ",
            where=where,
            code="roi-damaged",
        ) from None

    # What it is.
    selection = roi.roitype.name
    if roi.composite:
        raise _wrong_selection("a composite", where)
    if roi.subtype != 0 or selection not in (*AREAS, *LINES):
        raise _wrong_selection(f"of type {selection}, subtype {roi.subtype.name}", where)
    if roi.options & roifile.ROI_OPTIONS.SPLINE_FIT:
        raise CurveError(
            "is fitted with a spline that the file does not hold. Apply Edit > Selection > "
            "Interpolate in ImageJ, which adds its points",
            where=where,
            code="roi-spline",
        )

    # How it counts.
    closed = selection in AREAS
    warnings: tuple[str, ...] = ()
    if closed:
        refuse_origin(origin, f"ImageJ's {selection.lower()}")
        counted_from = "corner"
    else:
        counted_from, warnings = origin_of_line(roi.version, origin, where)
    with np.errstate(invalid="ignore"):  # What is not finite is refused with the other points.
        points = np.asarray(coordinates, np.float64).reshape(-1, 2)
    return _from_centres(points, counted_from), closed, warnings


def is_xy_table(header: list[str]) -> bool:
    """Whether a table's header is that of ImageJ's coordinates, with or without row numbers."""
    return [name for name in header if name][:2] == ["X", "Y"]


def read_xy_table(
    rows: list[list[str]], origin: PixelOrigin | None, where: str
) -> NDArray[np.float64]:
    """The (M, 2) points (u, v) [px] of ImageJ's X,Y coordinates, whose header is `rows[0]`.

    Raises `CurveError` where it is a table of every pixel, or where `origin` is `None`: the table
    does not tell lines from areas; or as `parse_pixels`.
    """
    header = [name.strip() for name in rows[0]]
    if header not in (["X", "Y"], ["", "X", "Y"]):
        raise CurveError(
            f"its columns are {','.join(header)[:60]!r}, as of every pixel of an area. Give "
            "a curve's X,Y",
            where=where,
            code="table-of-an-area",
        )
    if origin is None:
        raise CurveError(
            f"holds X,Y [px] of a line or of an area, which ImageJ counts differently. "
            f"{NAME_ORIGIN} (a line's and an area's)",
            where=where,
            code="origin-unknown",
        )
    first = len(header) - 2
    points = parse_pixels([row[first:] for row in rows[1:]], where)
    return _from_centres(points, origin)


def refuse_origin(origin: PixelOrigin | None, what: str) -> None:
    """Raise `SettingError` where an origin is given for a file that leaves none open."""
    if origin is not None:
        raise SettingError(
            f"curve_origin {origin!r} has no effect on {what}. Leave it out",
            code="origin-without-effect",
        )


def parse_pixels(rows: list[list[str]], where: str) -> NDArray[np.float64]:
    """The (M, 2) numbers of a table's rows; raises `CurveError` where one has other than two."""
    points = []
    try:
        for x, y in rows:
            points.append((parse_decimal(x), parse_decimal(y)))
    except ValueError as error:
        raise CurveError(
            f"holds a row without two numbers: {error}. Correct the row",
            where=where,
            code="row-not-two-numbers",
        ) from None
    return np.array(points, np.float64).reshape(-1, 2)


def _from_centres(points: NDArray, origin: str) -> NDArray[np.float64]:
    """Points that are counted from a pixel's centre or corner, counted from centres."""
    return points - CORNER_PX if origin == "corner" else points


def _wrong_selection(description: str, where: str) -> CurveError:
    wanted = ", ".join((*AREAS, *LINES)).lower()
    return CurveError(f"is {description}. Give one of {wanted}", where=where, code="roi-selection")


def origin_of_line(
    version: int, origin: PixelOrigin | None, where: str
) -> tuple[PixelOrigin, tuple[str, ...]]:
    """From where on a pixel a line of a format counts, with a warning where that is not sure."""
    if version > UNCLEAR_FORMAT:
        refuse_origin(origin, "a selection of this format")
        return "centre", ()
    if origin is not None:
        return origin, ()
    if version < UNCLEAR_FORMAT:
        raise CurveError(
            f"is of an ImageJ before 1.52i (format {version}). {NAME_ORIGIN}",
            where=where,
            code="origin-unknown",
            numbers={"format": version},
        )
    warning = (
        f"{where}: is taken to count from the centres of pixels. Had an ImageJ before 1.52u "
        f"(March 2020) written it, it would lie half a pixel off. {NAME_ORIGIN}"
    )
    return "centre", (warning,)
