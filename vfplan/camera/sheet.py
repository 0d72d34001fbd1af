"""What the camera looks for: tags at known places, printed with the plan or put on a bone.

The sheet has one layout on A4 and on Letter, around the middle of the page. Its frame has the
origin there, x to the right, y down and z into the paper [m]. The numbers of its tags are drawn by
the plan's digest, so that no other plan has them.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from vfplan.bundle import review_digest
from vfplan.display import MM
from vfplan.errors import InputError, MarkerError
from vfplan.figures.style import style
from vfplan.fixture import Fixture
from vfplan.geometry.lines import plane as across
from vfplan.geometry.lines import ring_of
from vfplan.images.read import as_uint8
from vfplan.io.writing import write_whole
from vfplan.markers.correspondences import read_sides
from vfplan.palette import CLOUD, CONTACT, HIP
from vfplan.review.rendered import Shown, outlines_of, plane_of

Array = NDArray[np.float64]

MM_PER_INCH = 25.4

# The colour of where the tool stops, and of where it is held.
COLOURS = {"wall": CONTACT, "guide": HIP}

# Width and height of the pages [mm].
PAGES = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}

# What both pages hold in the middle with 8 mm left for the printer [mm].
SHORT_MM, LONG_MM = 194.0, 263.0

# Side of a tag [mm]: 8 squares, of 5 px each in a picture of 1280 x 720 from 65 cm.
TAG_MM = 28.0

# Height [mm] at the upper edge for tags and the white around them, and at the lower edge for the
# same and the scale.
HEAD_MM, FOOT_MM = TAG_MM + 5.0, TAG_MM + 17.0

# Length [mm] of the printed scale.
SCALE_MM = 100.0

# Tags of 6 x 6 squares: of their 1000 numbers any two differ in 9 squares or more.
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_1000)

# The board of a calibration: squares along its sides, and their sides [mm].
BOARD_SQUARES, SQUARE_MM, BOARD_TAG_MM = (7, 10), 25.0, 18.0

# Pixels of the plan's outline a millimetre, as the engine is asked for it.
OUTLINE_PX = 10.0

# Of how many points of an outline one is kept; the engine's grid is finer than a picture.
THIN = 4


@dataclass(frozen=True, eq=False)
class Target:
    """Tags at known places, and where the plan lies among them.

    Parameters
    ----------
    tags
        Number -> (4, 3) corners [m], clockwise from the upper left one of the upright tag.
    T_target_fixture
        (4, 4) from the frame of the fixture [m].
    axes
        (3, 2) unit vectors in the plane of the plan: errors are told along it.
    is_printed
        Whether the tags were printed with this plan, so that another number is another plan.
    """

    tags: dict[int, Array]
    T_target_fixture: Array
    axes: Array
    is_printed: bool = True

    def place(self, points: Array) -> Array:
        """(N, 3) places of the fixture among the tags [m]."""
        return points @ self.T_target_fixture[:3, :3].T + self.T_target_fixture[:3, 3]


@dataclass(frozen=True, eq=False)
class Sheet:
    """The plan of a fixture on a page.

    Raises
    ------
    InputError
        No robot renders the fixture, it lies in no plane, or it is larger than the page.
    """

    fixture: Fixture

    def __post_init__(self) -> None:
        """Refuse what no page shows."""
        if self.fixture.rendering is None:
            raise InputError(
                "is a curve that no robot renders yet. Plan it with its markers: vfplan plan",
                code="nothing-rendered",
            )
        width, height = self.size_mm
        if width > self.area_mm[0] or height > self.area_mm[1]:
            raise InputError(
                f"The plan is {width:.0f} x {height:.0f} mm with the tool beside its line. A page "
                f"holds {SHORT_MM:.0f} x {LONG_MM - HEAD_MM - FOOT_MM:.0f} mm, or {LONG_MM:.0f} x "
                f"{SHORT_MM - HEAD_MM - FOOT_MM:.0f} mm. Put tags on the object instead: vfplan ar "
                "--tags",
                code="sheet-too-small", numbers={"width_mm": width, "height_mm": height},
            )  # fmt: skip

    @cached_property
    def axes(self) -> Array:
        """(3, 2) the page's directions to the right and down, in the frame of the fixture."""
        return plan_axes(self.fixture)

    @cached_property
    def box(self) -> Array:
        """(2, 2) the least and the largest place of the line along `axes`, with the tool [m]."""
        beside = self.fixture.contact_radius + self.fixture.point_radius
        if self.fixture.guidance is not None:
            beside = max(beside, self.fixture.guidance.radius)
        places = self.fixture.points @ self.axes
        return np.array([places.min(axis=0) - beside, places.max(axis=0) + beside])

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the plan."""
        width, height = MM * np.diff(self.box, axis=0)[0]
        return float(width), float(height)

    @cached_property
    def is_upright(self) -> bool:
        """Whether the page stands on its short edge."""
        width, height = self.size_mm
        fits = width <= SHORT_MM and height <= LONG_MM - HEAD_MM - FOOT_MM
        return fits or width > LONG_MM or height > SHORT_MM - HEAD_MM - FOOT_MM

    @property
    def whole_mm(self) -> tuple[float, float]:
        """Width and height of all that is printed."""
        return (SHORT_MM, LONG_MM) if self.is_upright else (LONG_MM, SHORT_MM)

    @property
    def area_mm(self) -> tuple[float, float]:
        """Width and height of the place for the plan."""
        return self.whole_mm[0], self.whole_mm[1] - HEAD_MM - FOOT_MM

    @cached_property
    def digest(self) -> str:
        """Of all that is rendered and of the registration, answered and approved or not."""
        return review_digest(replace(self.fixture, findings=(), reviewed=None, case=None))

    @cached_property
    def target(self) -> Target:
        """The tags, and the plan in the middle of its place."""
        numbers = np.random.Generator(
            np.random.Philox(int(hashlib.sha256(self.digest.encode()).hexdigest()[:32], 16))
        ).permutation(1000)
        width, height = self.whole_mm
        side = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * TAG_MM
        columns = (-width / 2, -TAG_MM / 2, width / 2 - TAG_MM)
        corners = [(x, y) for y in (-height / 2, height / 2 - TAG_MM) for x in columns]
        tags = {
            int(number): np.column_stack([corner + side, np.zeros(4)]) / MM
            for number, corner in zip(numbers, corners, strict=False)
        }
        turn = np.vstack([self.axes.T, np.cross(*self.axes.T)])
        transform = np.eye(4)
        transform[:3, :3] = turn
        transform[:2, 3] = [0.0, (HEAD_MM - FOOT_MM) / 2 / MM] - self.box.mean(axis=0)
        transform[2, 3] = -turn[2] @ self.fixture.points.mean(axis=0)
        return Target(tags, transform, np.eye(3)[:, :2])


def plan_axes(fixture: Fixture) -> Array:
    """(3, 2) unit vectors to the right and down as the plan is looked at, in its plane.

    Raises
    ------
    InputError
        It lies in no plane that its registration or its infinite axis tells.
    """
    plane = plane_of(fixture, None)
    if plane is not None:
        right = plane[:, 0] / np.linalg.norm(plane[:, 0])
        down = plane[:, 1] - right * (plane[:, 1] @ right)
        return np.column_stack([right, down / np.linalg.norm(down)])
    if fixture.ignore_axis is None:
        raise InputError(
            "The plan lies in space, and a page shows what lies in a plane. Put tags on the object "
            "instead: vfplan ar --tags",
            code="no-plane",
        )
    # Seen from above, or from the side to which the axis has its largest part.
    axis = fixture.ignore_axis
    first, second = across(axis * np.sign(axis[np.abs(axis).argmax()]))
    return np.column_stack([first, -second])


def target_of_tags(path: Path, fixture: Fixture) -> Target:
    """Tags on an object, whose corners were touched: a marker file with labels as "17.0".

    The label is the number of a tag of 6 x 6 squares and that of a corner, 0 to 3, clockwise from
    the upper left one of the upright tag. All is in the frame of the fixture.
    """
    touched = read_sides(path)[-1]
    if touched.frame != fixture.frame:
        raise MarkerError(
            f"holds places in the frame {touched.frame}. Give them in {fixture.frame}, as the "
            "fixture is",
            where=str(path), code="tag-frame",
        )  # fmt: skip
    places = dict(zip(touched.labels, touched.positions, strict=True))
    numbers = {label.partition(".")[0] for label in places}
    wanted = {f"{number}.{corner}" for number in numbers for corner in range(4)}
    if wanted != set(places) or not all(map(str.isdecimal, numbers)):
        raise MarkerError(
            f"holds {', '.join(touched.labels[:4])} ... Name four corners of each tag, such as "
            "17.0, 17.1, 17.2 and 17.3",
            where=str(path), code="tag-corners",
        )  # fmt: skip
    tags = {int(n): np.array([places[f"{n}.{corner}"] for corner in range(4)]) for n in numbers}
    return Target(tags, np.eye(4), plan_axes(fixture), is_printed=False)


def outlines_in(target: Target, fixture: Fixture) -> list[tuple[str, Array]]:
    """Where the engine stops the tool or holds it: kind, and (M, 3) places among the tags [m]."""
    axes = plan_axes(fixture)
    reach = 2 * (fixture.contact_radius + fixture.point_radius)
    if fixture.guidance is not None:
        reach = max(reach, 2 * fixture.guidance.radius)
    flat = fixture.points @ axes
    low, high = flat.min(axis=0) - reach, flat.max(axis=0) + reach
    normal = np.cross(*axes.T)
    origin = axes @ low + normal * (fixture.points.mean(axis=0) @ normal)
    size = np.ceil((high - low) * MM * OUTLINE_PX).astype(int)
    plane = np.column_stack([axes / (MM * OUTLINE_PX), origin])
    lines = []
    for outline in outlines_of(fixture, plane, (int(size[0]), int(size[1]))):
        for line in outline.lines:
            kept = np.vstack([line[:-1:THIN], line[-1:]])
            places = np.column_stack([kept, np.ones(len(kept))]) @ plane.T
            lines.append((outline.kind, target.place(places)))
    return lines


def draw_print(shown: Shown, paper: str) -> Figure:
    """A page with the plan, its slice where that is given, the tags and the scale."""
    sheet = Sheet(shown.fixture)
    target, (width, height) = sheet.target, sheet.whole_mm
    figure, axes = new_page(paper, sheet.is_upright)
    top, bottom = -height / 2 + HEAD_MM, height / 2 - FOOT_MM
    area = Rectangle((-width / 2, top), width, bottom - top, transform=axes.transData)
    if shown.image is not None and shown.plane is not None:
        # From the middle of a pixel, (u, v), to the page.
        onto = np.eye(3)
        onto[:2] = MM * (target.T_target_fixture[:3] @ np.vstack([shown.plane, [0, 0, 1]]))[:2]
        picture = axes.imshow(as_uint8(shown.image.rgb), interpolation="none", zorder=0)
        picture.set_transform(Affine2D(onto) + axes.transData)
        picture.set_clip_path(area)
    for number, corners in target.tags.items():
        draw_squares(
            axes, cv2.aruco.generateImageMarker(DICTIONARY, number, 8), MM * corners[0, :2]
        )
    for kind, line in outlines_in(target, shown.fixture):
        axes.plot(*MM * line.T[:2], color=COLOURS[kind], lw=0.8, zorder=3)
    for stroke in shown.fixture.strokes:
        line = MM * target.place(ring_of(stroke.points, stroke.closed))
        axes.plot(*line.T[:2], color=CLOUD, lw=0.8, zorder=3)
    if not shown.fixture.strokes:
        axes.plot(*MM * target.place(shown.fixture.points).T[:2], ".", color=CLOUD, ms=1, zorder=3)
    record = shown.fixture.registration
    if record is not None:
        for label, place in zip(record.labels, MM * target.place(record.target), strict=True):
            if abs(place[0]) < width / 2 and top < place[1] < bottom:
                axes.plot(*place[:2], "k+", ms=8, mew=0.6, zorder=4)
                axes.annotate(label, place[:2], (3, 3), textcoords="offset points", zorder=4)
    draw_scale(axes, -width / 2 + 2, bottom + 5)
    words = f"{shown.name}\n{sheet.digest[:32]}\n{sheet.digest[32:]}"
    axes.text(-width / 2 + SCALE_MM + 12, bottom + 1, words, va="top", family="monospace")
    return figure


def new_page(paper: str, is_upright: bool) -> tuple[Figure, Axes]:
    """A page at true scale, and axes in its millimetres from the middle, x to the right, y down."""
    size = PAGES[paper] if is_upright else PAGES[paper][::-1]
    with style():
        figure = Figure(figsize=np.divide(size, MM_PER_INCH))
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.set(xlim=(-size[0] / 2, size[0] / 2), ylim=(size[1] / 2, -size[1] / 2))
        axes.set_autoscale_on(False)
    return figure, axes


def draw_squares(
    axes: Axes, cells: NDArray[np.uint8], corner: Array, cell_mm: float = TAG_MM / 8
) -> None:
    """Draw a picture of black and white squares from its upper left corner on."""
    height, width = np.multiply(cells.shape, cell_mm)
    left, top = corner
    extent = (left, left + width, top + height, top)
    axes.imshow(cells, "gray", extent=extent, interpolation="none", vmin=0, vmax=255, zorder=2)


def draw_scale(axes: Axes, x: float, y: float) -> None:
    """Draw 100 mm with a tick every 10, to be checked with a ruler."""
    axes.plot([x, x + SCALE_MM], [y, y], "k", lw=0.8, solid_capstyle="butt")
    for tick in np.arange(0, SCALE_MM + 1, 10):
        axes.plot([x + tick] * 2, [y - 1.5, y + 1.5], "k", lw=0.5)
    axes.text(x, y + 2, f"{SCALE_MM:g} mm by a ruler, else the print is wrong", va="top")


def board() -> Any:
    """The board of a calibration."""
    squares = SQUARE_MM / MM, BOARD_TAG_MM / MM
    return cv2.aruco.CharucoBoard(BOARD_SQUARES, *squares, DICTIONARY)


def draw_board(paper: str) -> Figure:
    """A page with the board and the scale."""
    figure, axes = new_page(paper, is_upright=True)
    # A tag of 8 squares of 2.25 mm in a square of 25 mm: 4 pixels a millimetre show both.
    width, height = (int(4 * SQUARE_MM * count) for count in BOARD_SQUARES)
    picture = board().generateImage((width, height))
    draw_squares(axes, picture, np.array([-width / 8, -height / 8 - 3]), 0.25)
    draw_scale(axes, -SCALE_MM / 2, height / 8 + 2)
    return figure


def write_pdf(figure: Figure, path: Path) -> None:
    """Write a page as PDF; the same page gives the same bytes."""
    data = BytesIO()
    with style():
        figure.savefig(data, format="pdf", metadata={"CreationDate": None, "Producer": None})
    write_whole(path, [data.getvalue()], overwrite=True)
