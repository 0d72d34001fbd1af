"""The plan at true scale, with tags that a camera finds: printed on a page, or put on a bone.

The frame of the sheet has its origin in the middle of the plan and of the page, x to the right, y
down and z into the paper [m]. Tags on a bone are carried into the same frame. The layout is the
same on every paper. A printed tag's number follows from the plan's digest, so no other plan has it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.transforms import Affine2D

from vfplan.bundle import review_digest
from vfplan.display import MM
from vfplan.errors import InputError, MarkerError
from vfplan.figures.style import HALO, style
from vfplan.fixture import Fixture
from vfplan.geometry.lines import Array, homogeneous, ring_of
from vfplan.geometry.lines import plane as across
from vfplan.images.read import as_uint8, plane_of_slice
from vfplan.io.writing import write_whole
from vfplan.markers.correspondences import read_sides
from vfplan.palette import CLOUD, TUBE, WALL
from vfplan.review.plan import Plan as ReviewedPlan
from vfplan.review.rendered import outlines_of

# Width and height of the pages [mm].
PAGES = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}

# Shorter side of what every page holds in its middle: A4's, with 8 mm left for the printer [mm].
SHORT_MM = 194.0

# Longer side: that of Letter, likewise.
LONG_MM = 263.0

# Side of a tag [mm]: 8 squares, of 5 px each in a picture of 1280 x 720 from 65 cm.
TAG_MM = 28.0

# The same in a PDF [px]: 30 a square, because some viewers blur what they enlarge.
TAG_PX = 240

# Height [mm] of the tags with words or the scale beside them, above and below the plan.
EDGE_MM = TAG_MM + 12.0

# Length [mm] of the printed scale.
SCALE_MM = 100.0

# Tags of 6 x 6 squares: of their 1000 numbers any two differ in 9 squares or more.
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_1000)

# Of a calibration: squares along the sides, and the sides of a square and of its tag [m].
BOARD = cv2.aruco.CharucoBoard((7, 10), 25e-3, 18e-3, DICTIONARY)

# Pixels a metre in which the engine is asked for its outline.
PX_PER_M = 1e4

# Of so many points of the outline one is kept: they are then half a millimetre apart.
THIN = 4

# Number -> corners of a tag.
TagCorners = dict[int, Array]

# The colour of where the proxy stops, and of where it stays.
COLOURS = {"wall": WALL, "guide": TUBE}


@dataclass(frozen=True, eq=False)
class Plan:
    """A fixture in the frame of its sheet; `size_mm` is its width and height with the tool."""

    fixture: Fixture
    T_sheet_fixture: Array
    size_mm: Array

    def place(self, points: Array) -> Array:
        """(N, 3) points of the fixture on the sheet [m]."""
        return points @ self.T_sheet_fixture[:3, :3].T + self.T_sheet_fixture[:3, 3]

    def lines(self) -> list[Array]:
        """The strokes on the sheet, (M, 3) each [m]."""
        strokes = self.fixture.strokes
        return [self.place(ring_of(stroke.points, stroke.closed)) for stroke in strokes]

    def outlines(self) -> Iterator[tuple[str, Array]]:
        """Where the engine stops the proxy, or holds it: kind, and (M, 3) on the sheet [m]."""
        # As far again beside the tool, which an inner corner needs.
        size = np.ceil(1.2 * PX_PER_M / MM * self.size_mm).astype(int)
        onto = np.array([[1, 0, -size[0] / 2], [0, 1, -size[1] / 2], [0, 0, 0], [0, 0, PX_PER_M]])
        onto /= PX_PER_M
        plane = (np.linalg.inv(self.T_sheet_fixture) @ onto)[:3]
        for outline in outlines_of(self.fixture, plane, tuple(size.tolist())):
            for line in outline.lines:
                line = np.vstack([line[:-1:THIN], line[-1:]])
                yield outline.kind, homogeneous(line) @ onto[:3].T

    @property
    def digest(self) -> str:
        """Of all that is rendered and of the registration, approved or not."""
        return review_digest(replace(self.fixture, findings=(), reviewed=None, case=None))


def plan_of(fixture: Fixture) -> Plan:
    """The plan of a fixture, as its slice was looked at; without a slice from above.

    Raises
    ------
    InputError
        No robot renders it, or it lies in no plane.
    """
    plane, axis = plane_of_slice(fixture, None), fixture.ignore_axis if fixture.rendering else None
    if plane is not None:
        right, down = np.linalg.qr(plane[:, :2])[0].T
        right, down = right * np.sign(right @ plane[:, 0]), down * np.sign(down @ plane[:, 1])
    elif axis is not None:
        right, down = across(axis * np.sign(axis[np.abs(axis).argmax()])) * [[1], [-1]]
    if fixture.rendering is None or (plane is None and axis is None):
        message = "No robot renders this in a plane. Plan a line with its markers: vfplan plan"
        raise InputError(message, code="no-plane")
    turn = np.stack([right, down, np.cross(right, down)])
    places = fixture.points @ turn.T
    low, high = places.min(axis=0), places.max(axis=0)
    beside = fixture.contact_radius + fixture.point_radius
    if fixture.guidance is not None:
        beside = max(beside, fixture.guidance.radius)
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = turn, -(low + high) / 2
    return Plan(fixture, transform, MM * (high - low + 2 * beside)[:2])


def whole_of(plan: Plan) -> tuple[float, float]:
    """Width and height of all that is printed [mm], on an upright page if that holds the plan."""
    for whole in ((SHORT_MM, LONG_MM), (LONG_MM, SHORT_MM)):
        if (plan.size_mm <= [whole[0], whole[1] - 2 * EDGE_MM]).all():
            return whole
    width, height = plan.size_mm.tolist()
    raise InputError(
        f"The plan is {width:.0f} x {height:.0f} mm with the tool beside its line. A page holds "
        f"{SHORT_MM:g} x {LONG_MM - 2 * EDGE_MM:g} mm, or {LONG_MM:g} x "
        f"{SHORT_MM - 2 * EDGE_MM:g} mm. Plan a part of the line with --roi, or put tags on the "
        "object and touch their corners: vfplan ar FIXTURE.h5 CAMERA --camera CALIB.json "
        "--tags TAGS.csv",
        code="sheet-too-small", numbers={"width_mm": width, "height_mm": height},
    )  # fmt: skip


def printed_tags(plan: Plan) -> TagCorners:
    """Number -> (4, 3) corners [m] of the sheet's tags, clockwise from the upper left."""
    width, height = whole_of(plan)
    side = TAG_MM / MM * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    x = np.array([-width, -TAG_MM, width - 2 * TAG_MM]) / 2 / MM
    y = np.array([-height, height - 2 * TAG_MM]) / 2 / MM
    corners = np.stack(np.meshgrid(x, y, 0), axis=-1).reshape(-1, 1, 3)
    tags, numbers, digest = {}, list(range(1000)), int(plan.digest, 16)
    for corner in corners:
        digest, row = divmod(digest, len(numbers))
        tags[numbers.pop(row)] = corner + side
    return tags


def touched_tags(path: Path, plan: Plan) -> TagCorners:
    """The same of tags on an object, by the places of their corners in the fixture's frame.

    A marker file has a row for each corner, labelled as "17.0" to "17.3": the number of a tag of
    6 x 6 squares, and that of the corner, clockwise from the upper left one of the upright tag.
    """
    touched = read_sides(path)[-1]
    rows = dict(zip(touched.labels, plan.place(touched.positions), strict=True))
    numbers = {label.partition(".")[0] for label in rows}
    try:
        if touched.frame != plan.fixture.frame:
            raise ValueError(touched.frame)
        return {int(n): np.stack([rows.pop(f"{n}.{k}") for k in range(4)]) for n in numbers}
    except (KeyError, ValueError):
        where = f"four corners in {plan.fixture.frame}"
        message = f"has a tag without {where}. Label them as 17.0, 17.1, 17.2 and 17.3"
        raise MarkerError(message, where=path, code="tag-corners") from None


def draw_print(shown: ReviewedPlan, paper: str, signed_case: str = "") -> tuple[Figure, str]:
    """A page with the plan, its slice where that is given, the tags and the scale.

    With it a sentence on what of the slice has no room; empty where all of it has.
    signed_case: the case of the bundle's signature
    """
    plan, cut = plan_of(shown.fixture), ""
    width, height = whole_of(plan)
    figure, axes = new_page(paper, height > width)
    if shown.image is not None and shown.plane is not None:
        onto = np.eye(3)
        onto[:2] = MM * (plan.T_sheet_fixture[:3] @ np.vstack([shown.plane, [0, 0, 1]]))[:2]
        cut = cut_words(onto, shown.image.rgb.shape, (width, height - 2 * EDGE_MM))
        picture = axes.imshow(as_uint8(shown.image.rgb), interpolation="none", zorder=0)
        picture.set_transform(Affine2D(onto) + axes.transData)
        area = (-width / 2, EDGE_MM - height / 2), width, height - 2 * EDGE_MM
        picture.set_clip_path(Rectangle(*area, transform=axes.transData))
    for number, corners in printed_tags(plan).items():
        tag = cv2.aruco.generateImageMarker(DICTIONARY, number, TAG_PX)
        draw_squares(axes, tag, *MM * corners[0, :2], TAG_MM)
    lines = [(COLOURS[kind], line) for kind, line in plan.outlines()]
    lines += [(CLOUD, line) for line in plan.lines()]
    for colour, line in lines:
        axes.plot(*MM * line.T[:2], color=colour, lw=0.8, zorder=3, path_effects=HALO)
    case, reviewed = shown.fixture.case or signed_case, shown.fixture.reviewed
    words = f"{shown.source.path.name}, {f'case {case}' if case else 'no named case'}, approved by "
    words += "nobody" if reviewed is None else f"{reviewed.by}, {reviewed.utc}"
    axes.text(
        -width / 2, EDGE_MM - 0.5 - height / 2, f"{words}\ndigest {shown.digest}\n{cut}".rstrip(),
        family="monospace", fontsize=6, va="bottom", parse_math=False,
    )  # fmt: skip
    draw_scale(axes, -width / 2 + 2, height / 2 - EDGE_MM + 4)
    return figure, cut


def cut_words(onto: Array, shape: tuple[int, ...], room: tuple[float, float]) -> str:
    """What of a slice of this shape, laid by `onto`, is beyond the room [mm] for it; else empty."""
    v, u = np.array(shape[:2]) - 0.5
    corners = np.array([[-0.5, -0.5, 1], [u, -0.5, 1], [-0.5, v, 1], [u, v, 1]]) @ onto[:2].T
    seen = np.clip(corners, -0.5 * np.array(room), 0.5 * np.array(room))
    if (seen == corners).all():
        return ""
    held, whole = (" x ".join(f"{side:.0f}" for side in np.ptp(p, axis=0)) for p in (seen, corners))
    rest = "The review sheet shows all of it: --sheet-out."
    return f"The page holds {held} mm of the slice's {whole} mm. {rest}"


def draw_board(paper: str) -> Figure:
    """A page with the board of a calibration and the scale."""
    figure, axes = new_page(paper, is_upright=True)
    # 12 pixels a millimetre show the squares of the tags, of 2.25 mm, without a remainder.
    width, height = np.multiply(BOARD.getChessboardSize(), BOARD.getSquareLength() * MM)
    picture = BOARD.generateImage((int(12 * width), int(12 * height)))
    draw_squares(axes, picture, -width / 2, -3 - height / 2, width)
    draw_scale(axes, -width / 2, height / 2 + 2)
    return figure


def new_page(paper: str, is_upright: bool) -> tuple[Figure, Axes]:
    """A page at true scale, and axes in its millimetres from the middle, x to the right, y down."""
    size = np.array(PAGES[paper] if is_upright else PAGES[paper][::-1])
    with style():
        figure = Figure(figsize=size / 25.4)
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.set(xlim=np.array([-0.5, 0.5]) * size[0], ylim=np.array([0.5, -0.5]) * size[1])
        axes.set_autoscale_on(False)
    return figure, axes


def draw_squares(axes: Axes, picture: Any, left: float, top: float, width: float) -> None:
    """Draw a picture of black and white squares from its upper left corner on [mm]."""
    bottom = top + width * picture.shape[0] / picture.shape[1]
    axes.imshow(
        picture, "gray", extent=(left, left + width, bottom, top), interpolation="none", zorder=2
    )


def draw_scale(axes: Axes, x: float, y: float) -> None:
    """Draw 100 mm with a tick every 10, to be checked with a ruler."""
    ticks = x + np.linspace(0, SCALE_MM, 11)
    axes.plot([x, ticks[-1]], [y, y], "k", lw=0.8, solid_capstyle="butt")
    axes.vlines(ticks, y - 1.5, y + 1.5, "k", lw=0.5)
    axes.text(ticks[-1] + 5, y, f"{SCALE_MM:g} mm by a ruler, else do not use it", va="center")


def write_pdf(figure: Figure, path: Path) -> None:
    """Write a page as PDF; the same page gives the same bytes."""
    data = BytesIO()
    with style():
        figure.savefig(data, format="pdf", metadata={"CreationDate": None, "Producer": None})
    write_whole(path, [data.getvalue()], overwrite=True)
