"""A curve drawn as an ImageJ selection: `.roi`, or a table of its X,Y coordinates.

ImageJ counts the coordinates of area selections from a pixel's corner, and those of line selections
from its centre (class `ij.gui.Roi`, since ImageJ 1.52u of March 2020; before, all from the corner).
Here a whole number is a pixel's centre.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, MissingExtra, SettingError
from vfplan.io.files import parse_decimal

if TYPE_CHECKING:
    from roifile import ImagejRoi

PixelOrigin = Literal["centre", "corner"]
ORIGINS: dict[str, float] = {"centre": 0.0, "corner": 0.5}  # of ImageJ's zero: u = x - this
AREAS = ("POLYGON", "FREEHAND", "TRACED")
LINES = ("POLYLINE", "FREELINE")
# The file tells its format, not its program: 228 is 1.52i to 1.54, and so both ways of counting.
FIRST_OF_CENTRES, LAST_OF_CORNERS = 229, 227
SPLINE_FIT = 1  # of the options
SAY = "say where it counts a pixel from: --curve-origin centre or corner"


def is_roi(data: bytes) -> bool:
    """Whether the bytes begin as an ImageJ selection does."""
    return data[:4] == b"Iout"


def read_roi(
    data: bytes, origin: PixelOrigin | None, where: str
) -> tuple[NDArray[np.float64], bool, tuple[str, ...]]:
    """The (M, 2) vertices (u, v) [px] of a `.roi`, whether it is closed, and warnings.

    Raises `CurveError` where the file is damaged or no polygon and no polyline, or where it does
    not tell how it counts and `origin` is `None`; `SettingError` where it tells and `origin` is
    given; `MissingExtra` without the package roifile.
    """
    roi = _decoded(data, where)
    kind = roi.roitype.name
    if roi.composite or roi.subtype != 0 or kind not in (*AREAS, *LINES):
        shown = "a composite" if roi.composite else f"of type {kind}, subtype {roi.subtype.name}"
        wanted = ", ".join((*AREAS, *LINES)).lower()
        raise CurveError(f"is {shown}; one of {wanted} is wanted", where=where)
    if roi.options & SPLINE_FIT:
        raise CurveError(
            "is fitted with a spline that the file does not hold; Edit > Selection > Interpolate "
            "makes its points part of it",
            where=where,
        )
    closed = kind in AREAS
    if closed and origin is not None:
        raise SettingError(f"curve_origin {origin!r} has no effect on ImageJ's {kind.lower()}")
    counted, warnings = ("corner", ()) if closed else _of_a_line(roi.version, origin, where)
    with np.errstate(invalid="ignore"):  # what is not finite is refused with the other points
        points = np.asarray(roi.coordinates(), np.float64).reshape(-1, 2)
    return points - ORIGINS[counted], closed, warnings


def _of_a_line(
    version: int, origin: PixelOrigin | None, where: str
) -> tuple[PixelOrigin, tuple[str, ...]]:
    if version >= FIRST_OF_CENTRES and origin is not None:
        raise SettingError(f"curve_origin {origin!r} has no effect on a selection of this format")
    if origin is not None:
        return origin, ()
    if version <= LAST_OF_CORNERS:
        raise CurveError(f"is of an ImageJ before 1.52i (format {version}); {SAY}", where=where)
    if version >= FIRST_OF_CENTRES:
        return "centre", ()
    told = (
        "is taken to count from pixels' centres; had an ImageJ before 1.52u (March 2020) "
        f"written it, it would lie half a pixel off: {SAY}"
    )
    return "centre", (f"{where}: {told}",)


def _decoded(data: bytes, where: str) -> ImagejRoi:
    try:
        import roifile
    except ModuleNotFoundError:
        raise MissingExtra(
            "reading an ImageJ .roi needs the package roifile: pip install 'vfplan[imagej]'",
            where=where,
        ) from None
    logging.getLogger("roifile").addHandler(logging.NullHandler())
    try:
        roi = roifile.ImagejRoi.frombytes(data)
        roi.coordinates()
    except Exception as error:  # a file from outside: numpy, struct and codecs raise all kinds
        reason = " ".join(str(error).split()) or type(error).__name__
        raise CurveError(f"the ImageJ selection cannot be read: {reason}", where=where) from None
    return roi


def is_xy_table(header: list[str]) -> bool:
    """Whether a table's header is that of ImageJ's coordinates, with or without row numbers."""
    return [name for name in header if name][:2] == ["X", "Y"]


def read_xy_table(
    rows: list[list[str]], origin: PixelOrigin | None, where: str
) -> NDArray[np.float64]:
    """The (M, 2) points (u, v) [px] of ImageJ's X,Y coordinates, whose header is `rows[0]`.

    Raises `CurveError` where it is a table of every pixel, or where `origin` is `None`: the table
    does not tell lines from areas; or as `pixels_of`.
    """
    header = [name.strip() for name in rows[0]]
    if header not in (["X", "Y"], ["", "X", "Y"]):
        raise CurveError(
            f"its columns are {','.join(header)[:60]!r}, as of every pixel of an area; "
            "a curve's are X,Y",
            where=where,
        )
    if origin is None:
        raise CurveError(
            f"holds X,Y [px] of a line or of an area, which ImageJ counts differently; {SAY} "
            "(a line's and an area's)",
            where=where,
        )
    return pixels_of([row[len(header) - 2 :] for row in rows[1:]], where) - ORIGINS[origin]


def pixels_of(rows: list[list[str]], where: str) -> NDArray[np.float64]:
    """The (M, 2) numbers of a table's rows; raises `CurveError` where one has other than two."""
    try:
        return np.array(
            [[parse_decimal(x), parse_decimal(y)] for x, y in rows], np.float64
        ).reshape(-1, 2)
    except ValueError as error:
        raise CurveError(f"holds a row without two numbers: {error}", where=where) from None
