"""What a review shows: the plan on its slice, and what the robot will render of it.

The page and the sheet are views of `Shown`. What is rendered stands there as an outline that its
own engine gives, in values and in words.

A wall has the outline at which the tool's centre stops, and a guide that of the tube in which the
tip is held. Nothing here computes them from the drawn line: the engine that the bundle makes is
asked where it pushes.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.bundle import rendered_values
from vfplan.display import MM, millimetres
from vfplan.engine.browser import bodies_of
from vfplan.engine.guide import Guide
from vfplan.engine.proxy import ProxyEngine, best_rule
from vfplan.errors import InputError, VfplanError
from vfplan.findings import Finding
from vfplan.fixture import Fixture, Rendering, Stroke
from vfplan.geometry.lines import plane_normal, runs
from vfplan.images.read import SLICER_POINTS
from vfplan.planning.settings import LEAD_SPEED_M_S, ExtractSettings, margin_length
from vfplan.registration.registration import (
    Registration,
    describe_side,
    fit_registration,
)
from vfplan.review.acceptance import digest_of
from vfplan.review.markers import Marker, bound95_m, size_of
from vfplan.settings import MISFIT, incomplete_recipe, value_as

if TYPE_CHECKING:
    from vfplan.curve.account import AccountEntry
    from vfplan.images.read import PlannedImage
    from vfplan.review.geometry import Geometry

Array = NDArray[np.float64]
Kind = Literal["wall", "guide"]

# Nodes of the grid along the longer side of a picture, at least and at most. Between them the
# outline is interpolated; a tool smaller than three steps wants a finer grid.
GRID_NODES = (400, 1000)

# Steps of the grid along a side of a block. A block far from the outline is asked about once.
BLOCK = 16

# Places along a guide, and directions around each of its ends, at which its engine is asked.
GUIDE_PLACES, END_DIRECTIONS = 240, 16

# How far beyond the tube the guide is asked, as a share of its radius: it then pushes back.
BEYOND_TUBE = 0.01


@dataclass(frozen=True, eq=False)
class Outline:
    """Where the engine pushes, cut by a plane: `lines` are (M, 2) places of its picture [px].

    Of a guide the tip is held on the left of each line, seen with v downwards. `pull` is the place
    and the unit direction of its pull; `None` where nothing pulls.
    """

    kind: Kind
    lines: tuple[Array, ...]
    pull: tuple[Array, Array] | None = None


def kind_of(fixture: Fixture) -> Kind:
    """Whether the robot keeps the tool off the line, or holds it there."""
    return "wall" if fixture.guidance is None else "guide"


@dataclass(frozen=True, eq=False)
class Shown:
    """A plan as every view shows it: the page, the sheet, and the lists of a command.

    Parameters
    ----------
    fixture
        What would be written, with its findings and their answers.
    name
        What it is called, such as a file's name.
    image
        The slice that the curve was drawn on; `None` where it is not at hand.

    Raises
    ------
    InputError
        The image is not the one that the curve was drawn on.
    """

    fixture: Fixture
    name: str
    image: PlannedImage | None = None

    def __post_init__(self) -> None:
        if self.image is not None:
            check_slice(self.fixture, self.image)

    @cached_property
    def geometry(self) -> Geometry:
        """The lines on the slice and the pen's ink there; neither where it is not at hand."""
        from vfplan.review.geometry import Geometry, extraction_of
        from vfplan.review.ink import SliceInk

        fixture, image, ink = self.fixture, self.image, None
        if image is None:
            return Geometry()
        if "curve" not in fixture.provenance.inputs:
            settings = extraction_of(fixture, ExtractSettings())
            ink = SliceInk(image.rgb, settings.colour, settings.exclude or (), settings.roi)
        return Geometry(strokes_on_slice(fixture, image), ink)

    @cached_property
    def strokes(self) -> tuple[Stroke, ...]:
        """The lines on the slice [px], with the pen's width where a pen drew them."""
        return self.geometry.lines

    @cached_property
    def account(self) -> tuple[AccountEntry, ...]:
        """Other ink, and where the line shows none, the largest first."""
        return self.geometry.account

    @cached_property
    def registration(self) -> Registration | None:
        """The one that the fixture was made with, if the bundle's own markers give it again."""
        return registration_again(self.fixture)

    @cached_property
    def digest(self) -> str:
        """By which it is accepted."""
        return digest_of(self.fixture, slice_shown=self.image is not None)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What a person should look at."""
        return self.fixture.findings

    @property
    def is_slice_missing(self) -> bool:
        """Whether the curve was drawn on a slice that is not at hand."""
        return self.image is None and "image" in self.fixture.provenance.inputs

    @property
    def kind(self) -> Kind | None:
        """What the robot renders; `None` of a curve that it does not render yet."""
        return None if self.fixture.rendering is None else kind_of(self.fixture)

    @cached_property
    def plane(self) -> Array | None:
        """(3, 3) from (u, v, 1) of the slice to the fixture's frame [m]; `None` if unknown."""
        return plane_of(self.fixture, self.image)

    @cached_property
    def side(self) -> str | None:
        """From where the robot sees the slice, such as "above (robot +z)"; `None` if unknown."""
        if self.plane is None or self.fixture.registration is None:
            return None
        return describe_side(-plane_normal(self.plane))

    @cached_property
    def outlines(self) -> tuple[Outline, ...]:
        """What the robot renders, on the slice; none where it is unknown how that lies."""
        source = self.image or self.fixture.image
        if self.plane is None or source is None:
            return ()
        return outlines_of(self.fixture, self.plane, (source.width_px, source.height_px))

    def bodies(self) -> dict[str, Any]:
        """What renders the fixture in a browser, and where that lies on the slice.

        `plane` takes (u, v, 1) [px] to the fixture's frame [m], and `back` a way there [m] onto the
        slice [px].

        Raises `VfplanError` for what no engine takes.
        """
        fixture = self.fixture
        if self.plane is None or fixture.rendering is None:
            raise InputError("The curve has no markers yet.", code="not-rendered")
        back = onto_plane(self.plane, fixture.ignore_axis)(np.eye(3) + self.plane[:, 2]).T
        radius_m = 0.0 if fixture.region is None else fixture.contact_radius
        return {
            "bodies": bodies_of(fixture), "plane": self.plane.tolist(), "back": back.tolist(),
            "radius_px": radius_m / self.metres_per_px,
        }  # fmt: skip

    @cached_property
    def metres_per_px(self) -> float | None:
        """The size of a pixel, by the markers, else as the image says; `None` if unknown."""
        if self.plane is not None:
            return size_of(self.plane)
        spacings = [image.pixel_spacing_mm for image in (self.image, self.fixture.image) if image]
        spacing_mm = next(filter(None, spacings), None)
        return None if spacing_mm is None else float(np.sqrt(np.prod(spacing_mm))) / MM

    @cached_property
    def tre95_m(self) -> Array | None:
        """(M,) the 95 % bound of the error along all strokes, by the markers and their own [m]."""
        if self.registration is None or not self.strokes:
            return None
        place = None
        if self.registration.source.shape[1] == 3:
            place = _place_in_patient(self.image)
        return bound95_m(self.registration, self.strokes, place)

    @cached_property
    def other_ink(self) -> tuple[AccountEntry, ...]:
        """The account without the gaps that a bridge of the line crosses."""
        bridged = [stroke.points[stroke.bridged] for stroke in self.strokes]
        places = np.vstack([np.full((1, 2), np.inf), *bridged])

        def is_listed(entry: AccountEntry) -> bool:
            away = np.hypot(*(places - (entry.u, entry.v)).T).min()
            return entry.what == "ink" or away > max(1.0, entry.pixels / 2)

        return tuple(filter(is_listed, self.account))

    @property
    def slicer_points(self) -> Array:
        """(K, 2) the points that a person set in Slicer [px]; none of any other curve."""
        recipe = self.fixture.provenance.settings
        points = value_as(tuple[tuple[float, float], ...], recipe.get(SLICER_POINTS, ""))
        return np.array(() if points is MISFIT else points).reshape(-1, 2)

    @cached_property
    def margin_m(self) -> float | None:
        """What the plan added to the radius around each point; `None` where it added nothing."""
        margin = self.fixture.provenance.settings.get("margin")
        bound_m = None if self.tre95_m is None else float(self.tre95_m.max())
        return margin_length(margin, bound_m)

    @cached_property
    def markers(self) -> tuple[Marker, ...]:
        """The markers on the slice, or where they lie in front of the robot if there is none."""
        record, left_out = self.fixture.registration, labels_left_out(self.fixture)
        if record is None or (self.image is not None and self.plane is None):
            return ()
        places, residuals_px = record.target, [None] * len(record.labels)
        if self.image is not None:
            T = record.T_robot_image
            residuals = record.target - (record.source @ T[:3, :-1].T + T[:3, -1])
            residuals_px = residuals @ np.linalg.pinv(self.plane[:, :2]).T
            places = record.source
            if record.source_frame != "image":
                places = onto_plane(self.image.T_patient_image[:3])(places)
        return tuple(
            Marker(label, place, is_used=label not in left_out, residual_m=float(residual_m),
                   residual_px=residual_px)
            for label, place, residual_m, residual_px in zip(
                record.labels, places, record.residuals_m, residuals_px, strict=True
            )
        )  # fmt: skip

    @property
    def bounds(self) -> Iterator[tuple[Stroke, Array]]:
        """Each stroke with the 95 % bound of its points, (M,) [m]; none if that is unknown."""
        if self.tre95_m is not None:
            stops = np.cumsum([len(stroke.points) for stroke in self.strokes])[:-1]
            yield from zip(self.strokes, np.split(self.tre95_m, stops), strict=True)


def check_slice(fixture: Fixture, image: PlannedImage) -> None:
    """Raise `InputError` unless the image is the one that the curve was drawn on."""
    known = fixture.provenance.inputs.get("image")
    if known is None:
        text = "This bundle was not drawn on a slice. Leave --slice out."
        raise InputError(text, code="slice-unknown")
    if known != image.sha256:
        raise InputError(
            f"This is not the slice that the curve was drawn on: its SHA-256 begins with "
            f"{image.sha256[:12]}, the bundle names {known[:12]}. Give the original file.",
            code="slice-other",
            numbers={"expected": known, "found": image.sha256},
        )


def strokes_on_slice(fixture: Fixture, image: PlannedImage | None) -> tuple[Stroke, ...]:
    """The strokes of a bundle in the pixels of its slice; a bare cloud is one without order.

    The slice need not be given where the bundle itself says how its pixels lie.
    """
    convert = to_pixels(fixture, image)
    is_image = fixture.frame == "image"
    units_per_px = 1.0 if is_image else size_of(plane_of(fixture, image))
    drawn = fixture.strokes
    if fixture.curve is None:
        drawn = (Stroke(fixture.points, False, fixture.sigma, is_ordered=False),)
    strokes = []
    for stroke in drawn:
        sigma = None if stroke.sigma is None else stroke.sigma / units_per_px
        strokes.append(replace(stroke, points=convert(stroke.points), sigma=sigma))
    return tuple(strokes)


def to_pixels(fixture: Fixture, image: PlannedImage | None) -> Callable[[Array], Array]:
    """From the frame of the fixture back to the pixels of its slice."""
    if fixture.frame == "image":
        return lambda points: points[:, :2]
    if fixture.frame == "patient_lps":
        return onto_plane(_place_in_patient(image))
    record = fixture.registration
    if record is None:
        raise InputError(
            "This bundle does not say how it was registered, so its curve cannot be drawn on the "
            "slice. Leave --slice out.",
            code="slice-unregistered",
        )
    if record.source_frame == "image":
        return onto_plane(record.T_robot_image)
    back = np.linalg.inv(record.T_robot_image)
    onto = onto_plane(_place_in_patient(image))
    return lambda points: onto(points @ back[:3, :3].T + back[:3, 3])


def _place_in_patient(image: PlannedImage) -> Array:
    if image.T_patient_image is None:
        raise InputError(
            "The slice does not say where it lies in the patient, so the curve cannot be drawn on "
            "it. Give the DICOM file, or leave --slice out.",
            code="slice-unplaced",
        )
    return image.T_patient_image[:3]


def plane_of(fixture: Fixture, image: PlannedImage | None) -> Array | None:
    """(3, 3) from (u, v, 1) of the slice to the frame of the fixture [m]; `None` if unknown."""
    record = fixture.registration
    if record is not None and record.source_frame == "image":
        return record.T_robot_image
    if image is None or image.T_patient_image is None:
        return None
    plane = image.T_patient_image[:3]
    if record is not None:
        plane = record.T_robot_image[:3, :3] @ plane
        plane[:, 2] += record.T_robot_image[:3, 3]
    return plane


def labels_left_out(fixture: Fixture) -> list[str]:
    """The labels of the markers that a robust registration did not use."""
    return str(fixture.provenance.settings.get("markers_left_out", "")).split(",")


def sigma_of(fixture: Fixture) -> tuple[tuple[float, ...], ...] | None:
    """The deviations of each marker of a registered bundle [m]; `None` where it has none."""
    known = fixture.provenance.settings
    if "markers_sigma_m" not in known:
        return None
    sigma = value_as(tuple[tuple[float, ...], ...], known["markers_sigma_m"])
    is_told = sigma is not MISFIT and {len(row) for row in sigma} in ({1}, {3})
    if not is_told or len(sigma) != len(fixture.registration.labels):
        raise incomplete_recipe(f"markers_sigma_m is {known['markers_sigma_m']!r}")
    return sigma


def registration_again(fixture: Fixture) -> Registration | None:
    """The registration that the bundle's markers give; `None` where that is not the bundle's own.

    A bundle does not hold the bound along its curve.
    """
    record = fixture.registration
    if record is None:
        return None
    used = [label not in labels_left_out(fixture) for label in record.labels]
    spacing_m = None
    if record.source_frame == "image" and fixture.image and fixture.image.pixel_spacing_mm:
        spacing_m = tuple(spacing / MM for spacing in fixture.image.pixel_spacing_mm)
    sigma = sigma_of(fixture)
    try:
        again = fit_registration(
            record.source[used], record.target[used], model=record.model, pixel_spacing=spacing_m,
            sigma=None if sigma is None else np.array(sigma)[used].squeeze(),
        )  # fmt: skip
    except VfplanError:
        return None
    is_own = np.allclose(again.T_target_source, record.T_robot_image, rtol=1e-6, atol=1e-9)
    return again if is_own else None


def outlines_of(fixture: Fixture, plane: Array, size: tuple[int, int]) -> tuple[Outline, ...]:
    """The outlines of a fixture in a plane; none where no engine renders it.

    Parameters
    ----------
    fixture
        What is rendered.
    plane
        (3, 3), takes (u, v, 1) [px] into the frame of the fixture [m].
    size
        Width and height of the picture [px].
    """
    if fixture.rendering is None:
        return ()
    outlines: list[Outline] = []
    try:
        if fixture.region is not None:
            outlines.append(_of_wall(fixture.region, plane, size))
        if fixture.guidance is not None:
            outlines += _of_guide(fixture, plane)
    except VfplanError:
        return ()
    return tuple(outlines)


def _of_wall(region: Fixture, plane: Array, size: tuple[int, int]) -> Outline:
    """Where the tool's centre is as far from the region as the engine lets it come."""
    from skimage.measure import find_contours

    radius = region.contact_radius + region.point_radius
    metres_per_px = float(np.linalg.norm(plane[:, :2], 2))
    low, high = (max(size) / nodes for nodes in reversed(GRID_NODES))
    step = float(np.clip(radius / metres_per_px / 3, low, high))
    distance = ProxyEngine.of(region, offline=True).distance
    columns, rows = (int(np.ceil(length / step / BLOCK)) + 1 for length in size)

    def asked(nodes: Array) -> Array:
        places = np.column_stack([nodes[:, ::-1] * step, np.ones(len(nodes))])
        return distance(places @ plane.T) - radius

    # From the middle of a block the distance changes by no more than the way.
    blocks = np.indices((rows, columns)).reshape(2, -1).T * BLOCK + BLOCK / 2
    beyond = asked(blocks).reshape(rows, columns).repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)
    near = np.argwhere(np.abs(beyond) <= (BLOCK / np.sqrt(2) + 2) * step * metres_per_px)
    beyond[tuple(near.T)] = asked(near.astype(float))
    contours = find_contours(beyond, 0.0)
    return Outline("wall", tuple(contour[:, ::-1] * step for contour in contours))


def _of_guide(fixture: Fixture, plane: Array) -> Iterator[Outline]:
    """Where the guide brings a tip back that lies just outside of its tube."""
    with warnings.catch_warnings():
        # The bend that it warns of is a finding of the plan.
        warnings.simplefilter("ignore")
        guide = Guide.of(fixture, hold="at_once")
    normal, axis = plane_normal(plane), fixture.ignore_axis
    normal = normal / np.linalg.norm(normal)
    onto_picture = onto_plane(plane, axis)
    turns = np.linspace(0.0, np.pi, END_DIRECTIONS + 2)[1:-1, None]
    for number, length in enumerate(guide.lengths_m):
        closed = guide.closed[number]
        places = guide.at(np.linspace(0.0, length, GUIDE_PLACES), number)
        along = np.gradient(places, axis=0)
        if closed:
            along[[0, -1]] = places[1] - places[-2]
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
        side = np.cross(normal, along)
        side /= np.maximum(np.linalg.norm(side, axis=1), 1e-12)[:, None]
        # Along one side, around the end, back along the other side, and around the start.
        paths = [(places, side), (places[::-1], -side[::-1])]
        if not closed:
            end = np.cos(turns) * side[-1] + np.sin(turns) * along[-1]
            start = -np.cos(turns) * side[0] - np.sin(turns) * along[0]
            around = [np.repeat(places[[k]], END_DIRECTIONS, axis=0) for k in (-1, 0)]
            paths = [(np.vstack([places, around[0], places[::-1], around[1], places[:1]]),
                      np.vstack([side, end, -side[::-1], start, side[:1]]))]  # fmt: skip
        pull = _pull_of(guide, places[GUIDE_PLACES // 2], onto_picture)
        tips = [at + (1 + BEYOND_TUBE) * guide.radius * away for at, away in paths]
        lines = tuple(onto_picture(line) for path in tips for line in _held(guide, path))
        yield Outline("guide", lines, pull)


def _held(guide: Guide, tips: Array) -> Iterator[Array]:
    """To where the guide brings each tip, in lines without the tips that it leaves free."""
    answers = []
    for tip in tips:
        guide.reset(tip)
        answers.append(guide.step(tip))
    held = np.array([answer.held and answer.lateral_m > guide.radius for answer in answers])
    proxies = np.array([answer.proxy for answer in answers])
    for run in runs(held, False):
        if len(run) > 1:
            yield proxies[run]


def _pull_of(
    guide: Guide, place: Array, onto_picture: Callable[[Array], Array]
) -> tuple[Array, Array] | None:
    """A place of a picture and the direction in which the guide pulls a tip that rests there."""
    guide.reset(place)
    force = guide.run(np.repeat(place[None], 2, axis=0)).force[-1]
    start, end = onto_picture(np.array([place, place + force * guide.radius]))
    length = float(np.hypot(*(end - start)))
    return (start, (end - start) / length) if length > 0 else None


def onto_plane(plane: Array, axis: Array | None = None) -> Callable[[Array], Array]:
    """From places (M, 3) to the (u, v) that (3, 3) `plane` brings there, straight down onto it.

    Or along `axis`, unless that lies in the plane.
    """
    back, normal = np.linalg.pinv(plane[:3, :2]), plane_normal(plane)
    along = normal if axis is None else axis
    if abs(along @ normal) < 0.05 * np.linalg.norm(along) * np.linalg.norm(normal):
        along = normal

    def onto(points: Array) -> Array:
        beside = points - plane[:3, 2]
        return (beside - np.outer(beside @ normal / (along @ normal), along)) @ back.T

    return onto


def rendered_in_json(fixture: Fixture) -> dict[str, Any]:
    """Everything that the engine uses, by name; a long table by its size and its SHA-256."""
    return {name: _plain(value) for name, value in rendered_values(fixture).items()}


def _plain(value: Any) -> Any:
    """A value as JSON holds it."""
    if not isinstance(value, np.ndarray):
        return value
    if value.size <= 3:
        return value.tolist()
    sha256 = hashlib.sha256(np.ascontiguousarray(value)).hexdigest()
    return {"shape": list(value.shape), "sha256": sha256}


def described(fixture: Fixture) -> tuple[tuple[str, str], ...]:
    """What the robot renders in words: (heading, text), one a line; none of a bare curve."""
    if fixture.rendering is None:
        return ()
    rendering = fixture.rendering
    rows = [_wall_in_words(fixture, rendering), _guide_in_words(fixture)]
    axis, infinite = rendering.ignore_axis, "along no axis: the fixture lies in space"
    if axis is not None:
        numbers = ", ".join(f"{number:.4f}" for number in axis)
        name = axis_in_words(axis)
        name = f"{name} " if name in "xyz" else ""
        infinite = f"along {name}({numbers}), where it gives no force"
    rows += [("Infinite", infinite), ("Rule", _rule_in_words(fixture, rendering)),
             ("Robot", _robot_in_words(fixture)), ("Place", _place_in_words(fixture))]  # fmt: skip
    record = fixture.registration
    if record is not None:
        markers = [f"{label} {' '.join(f'{MM * x:.1f}' for x in place)}"
                   for label, place in zip(record.labels, record.target, strict=True)]  # fmt: skip
        rows.append(("Markers in front of the robot [mm]", ", ".join(markers)))
    return tuple(row for row in rows if row is not None)


def _wall_in_words(fixture: Fixture, rendering: Rendering) -> tuple[str, str]:
    drawn = "line" if fixture.curve is not None else "points"
    what = drawn if fixture.mesh is None else "surface"
    if fixture.guidance is not None:
        what = "strokes that do not guide"
    radius = rendering.contact_radius + rendering.point_radius
    words = f"{millimetres(radius, 2)} from the {what} to the tool's centre"
    if rendering.point_radius:
        words += f", of which {millimetres(rendering.point_radius, 2)} belong to the points"
    stiffness = stiffness_in_words(rendering.stiffness)
    if fixture.region is None:
        return "Wall", f"none; {millimetres(radius, 3)} and {stiffness} have no effect"
    return "Wall", f"{words}; {stiffness}"


def _guide_in_words(fixture: Fixture) -> tuple[str, str] | None:
    guidance = fixture.guidance
    if guidance is None:
        return None
    what = "the line" if guidance.stroke is None else f"stroke {guidance.stroke}"
    words = f"holds the tip within {millimetres(guidance.radius, 2)} of {what}; "
    words += f"{guidance.stiffness:g} N/m beyond"
    if guidance.lead_force:
        goal = "end" if guidance.lead_force > 0 else "start"
        speed = MM * (guidance.lead_speed or LEAD_SPEED_M_S)
        words += f"; pulls with {abs(guidance.lead_force):g} N to the {goal}, up to {speed:g} mm/s"
    else:
        words += "; no pull"
    if not fixture.curve.closed.all():
        words += "; " + ("stops" if guidance.ends == "stop" else "lets go") + " at the ends"
    return "Guide", words


def _rule_in_words(fixture: Fixture, rendering: Rendering) -> str:
    """Which rule moves the proxy over what, and how exactly."""
    count = f"{len(fixture.points)} points"
    if fixture.pieces is not None and rendering.ignore_axis is not None:
        count = f"{fixture.pieces.count} lines and arcs"
    elif fixture.mesh is not None:
        count += f", {len(fixture.mesh)} triangles"
        if fixture.sample_radius is not None:
            count += f", sampled every {millimetres(fixture.sample_radius, 4)}"
    try:
        rule = "guide" if fixture.region is None else best_rule(fixture)
    except VfplanError as error:
        rule = f"none, for {error.message}"
    most = "as many iterations as the engine allows"
    if rendering.max_iterations is not None:
        most = f"at most {rendering.max_iterations} iterations a tick"
    return f"{rule}, {count}; band {1e6 * rendering.band:.4g} µm; {most}"


def _robot_in_words(fixture: Fixture) -> str:
    verdict = fixture.stability
    if verdict is None:
        return "none: the stiffness was checked with no robot"
    judged = "stable" if verdict.stable else "NOT STABLE"
    return (
        f"{verdict.robot}: {judged}, {verdict.k_n_per_m:g} N/m of at most "
        f"{verdict.k_pass_n_per_m:.0f} N/m"
    )


def _place_in_words(fixture: Fixture) -> str:
    """The frame, and the box around what is rendered."""
    places = fixture.points
    if fixture.pieces is not None and fixture.ignore_axis is not None:
        places = fixture.pieces.vertices
    ranges = zip("xyz", places.min(axis=0), places.max(axis=0), strict=True)
    box = ", ".join(f"{axis} {MM * low:.2f} to {MM * high:.2f}" for axis, low, high in ranges)
    return f"{fixture.frame}, {box} mm"


def stiffness_in_words(stiffness: Array) -> str:
    """The stiffness of the wall, one number where it is the same along all axes."""
    x, y, z = stiffness
    if x == y == z:
        return f"{x:g} N/m"
    return f"{x:g} N/m along x, {y:g} along y, {z:g} along z"


def axis_in_words(axis: Array) -> str:
    """The axis of the frame that a direction follows within a degree, else its three numbers."""
    largest = int(np.abs(axis).argmax())
    if abs(axis[largest]) > np.cos(np.radians(1.0)):
        return "xyz"[largest]
    return f"({', '.join(f'{number:.3f}' for number in axis)})"


def in_one_line(fixture: Fixture) -> str:
    """What is rendered and who approved it, such as "wall, 1000 N/m, 5.00 mm, along z"."""
    rendering, guidance = fixture.rendering, fixture.guidance
    if rendering is None:
        words = "a curve, which no robot renders yet"
    else:
        stiffness, radius = rendering.stiffness, rendering.contact_radius + rendering.point_radius
        if guidance is not None:
            stiffness, radius = np.full(3, guidance.stiffness), guidance.radius
        axis = rendering.ignore_axis
        words = f"{kind_of(fixture)}, {stiffness_in_words(stiffness)}, {millimetres(radius, 2)}, "
        words += "in space" if axis is None else f"along {axis_in_words(axis)}"
        if guidance is not None and guidance.lead_force:
            words += f", pulls with {guidance.lead_force:g} N"
    reviewed = fixture.reviewed
    return f"{words}; " + (
        "approved by nobody" if reviewed is None else f"approved by {reviewed.by}"
    )
