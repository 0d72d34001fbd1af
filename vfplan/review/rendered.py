"""What the robot will render of a plan: as an outline that its own engine gives, and in words.

A wall has the outline at which the proxy stops, and a guide that of the tube in which the
tip is held. Nothing here computes them from the drawn line: the engine that the bundle makes is
asked where it pushes.

A person's word on that is stored in the bundle: answers to findings, a name, and the digest. The
digest is 64 hexadecimal digits over what a review sheet shows: every value of the bundle, so the
SHA-256 of the slice too, and the findings. It does not cover when and by which program the bundle
was made, nor who answered a finding. So the same plan has the same digest tomorrow and after its
acceptance, and no other plan has it. What the bundle holds of the review is another digest,
`vfplan.bundle.review_digest`, which every reader computes again.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vfplan.bundle import rendered_values
from vfplan.bundle.content import digest_of_content, review_digest, to_content
from vfplan.display import MM, Report, coordinates, isolated, millimetres
from vfplan.engine.guide import Guide
from vfplan.engine.proxy import ProxyEngine, best_rule
from vfplan.errors import CheckFailed, ImageError, InputError, SettingError, VfplanError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Fixture, Review, Stroke
from vfplan.geometry.lines import Array, plane_normal, row_lengths, runs, unit_normal
from vfplan.images.read import PlannedImage, plane_of_slice
from vfplan.io.files import now_utc
from vfplan.planning.settings import LEAD_SPEED_M_S
from vfplan.registration.registration import Registration, fit_registration
from vfplan.review.markers import size_of
from vfplan.settings import MISFIT, incomplete_recipe, value_as

Kind = Literal["wall", "guide"]

# Nodes of the grid along the longer side, at least and at most. Between them the outline is
# interpolated; a wall smaller than three steps wants a finer grid.
GRID_NODES = (400, 1000)

# Steps of the grid along a side of a block. A block far from the outline is asked about once.
BLOCK = 16

# What a guide does at the ends of its line.
AT_ENDS = {"stop": "stops", "open": "lets go"}

# Places along a guide, and directions around each of its ends, at which its engine is asked.
GUIDE_PLACES, END_DIRECTIONS = 240, 16

# How far beyond the tube the guide is asked, as a share of its radius: it then pushes back.
BEYOND_TUBE = 0.01


# What changes although the plan does not.
LEFT_OUT = {"/provenance@created_utc", "/provenance@software", "/provenance/history"}

# Characters that Unicode counts as letters, marks or symbols and that show nothing.
INVISIBLE = {*"\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0", *map(chr, range(0xFE00, 0xFE10))}
INVISIBLE |= {*"\u180b\u180c\u180d\u180f", *map(chr, range(0xE0100, 0xE01F0))}

# Characters of a name at most, as a bundle holds them.
MAX_NAME = 64


@dataclass(frozen=True, eq=False)
class Outline:
    """Where the engine pushes, cut by a plane: `lines` are (M, 2) places of its picture [px].

    Of a guide the tip is held on the left of each line, seen with v downwards. `pull` is the place
    and the unit direction of its pull; `None` where nothing pulls.
    """

    kind: Kind
    lines: tuple[Array, ...]
    pull: tuple[Array, Array] | None = None


def kind_of(fixture: Fixture) -> Kind | None:
    """Whether the robot keeps the tip off the line or holds it there; `None` of a bare curve."""
    if fixture.rendering is None:
        return None
    return "wall" if fixture.guidance is None else "guide"


def check_slice(fixture: Fixture, image: PlannedImage) -> None:
    """Raise `ImageError` unless the image is the one that the curve was drawn on."""
    known = fixture.provenance.inputs.get("image")
    if known is None:
        text = "This bundle was not drawn on a slice. Leave --slice out."
        raise InputError(text, code="slice-unknown")
    if known != image.sha256:
        raise ImageError(
            "This is not the slice that the curve was drawn on. Their SHA-256 differ: "
            f"{image.sha256[:12]}... here, {known[:12]}... in the bundle. Give the original.",
            where=image.where, code="another-slice",
            numbers={"expected": known, "found": image.sha256},
        )  # fmt: skip


def strokes_on_slice(fixture: Fixture, image: PlannedImage | None) -> tuple[Stroke, ...]:
    """The strokes of a bundle in the pixels of its slice; a bare cloud is one without order.

    The slice need not be given where the bundle itself says how its pixels lie.
    """
    # In the frame of the image the first two coordinates are pixels.
    plane = np.eye(3)
    if fixture.frame not in ("image", "patient_lps") and fixture.registration is None:
        plane = None
    elif fixture.frame != "image":
        plane = plane_of_slice(fixture, image)
    if plane is None:
        raise InputError(
            "Neither the bundle nor the slice says where the curve lies on the slice. Give the "
            "DICOM slice with --slice, or print the sheet without a slice: vfplan review "
            "FIXTURE.h5 --sheet-out sheet.png",
            code="slice-unplaced",
        )
    drawn = fixture.strokes
    if fixture.curve is None:
        drawn = (Stroke(fixture.points, False, fixture.sigma, is_ordered=False),)
    return tuple(
        replace(
            stroke, points=onto_plane(plane)(stroke.points),
            sigma=None if stroke.sigma is None else stroke.sigma / size_of(plane),
        ) for stroke in drawn
    )  # fmt: skip


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
    used = [label not in fixture.labels_left_out for label in record.labels]
    spacing_m = None
    if record.source_frame == "image" and fixture.image and fixture.image.pixel_spacing_mm:
        spacing_m = tuple(spacing / MM for spacing in fixture.image.pixel_spacing_mm)
    sigma = sigma_of(fixture)
    try:
        again = fit_registration(
            record.source[used], record.target[used], model=record.model, pixel_spacing=spacing_m,
            sigma=sigma and np.array(sigma)[used].squeeze(),
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
    outlines = []
    try:
        if fixture.region is not None:
            outlines.append(wall_outline(fixture.region, plane, size))
        if fixture.guidance is not None:
            outlines += guide_outlines(fixture, plane)
    except VfplanError:
        return ()
    return tuple(outlines)


def wall_outline(region: Fixture, plane: Array, size: tuple[int, int]) -> Outline:
    """Where the proxy is as far from the region as the engine lets it come."""
    from skimage.measure import find_contours

    radius = region.contact_radius + region.point_radius
    metres_per_px, finest = np.linalg.svd(plane[:, :2], compute_uv=False).tolist()
    # Ink at a border is walled off beyond it too.
    sides = np.array(size) + 2 * radius / finest
    low, high = (sides.max() / nodes for nodes in reversed(GRID_NODES))
    step = float(np.clip(radius / metres_per_px / 3, low, high))
    begin = -radius / finest - 2 * step
    distance = ProxyEngine.of(region, offline=True).distance
    columns, rows = np.ceil(sides / step / BLOCK).astype(int) + 1

    def asked(nodes: Array) -> Array:
        places = np.column_stack([begin + nodes[:, ::-1] * step, np.ones(len(nodes))])
        return distance(places @ plane.T) - radius

    # From the middle of a block the distance changes by no more than the way.
    blocks = np.indices((rows, columns)).reshape(2, -1).T * BLOCK + BLOCK / 2
    beyond = asked(blocks).reshape(rows, columns).repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)
    near = np.argwhere(np.abs(beyond) <= (BLOCK / np.sqrt(2) + 2) * step * metres_per_px)
    beyond[tuple(near.T)] = asked(near.astype(float))
    lines = find_contours(beyond, 0.0)
    return Outline("wall", tuple(begin + line[:, ::-1] * step for line in lines))


def guide_outlines(fixture: Fixture, plane: Array) -> Iterator[Outline]:
    """Where the guide brings a tip back that lies just outside of its tube."""
    with warnings.catch_warnings():
        # The bend that it warns of is a finding of the plan.
        warnings.simplefilter("ignore")
        guide = Guide.of(fixture, hold="at_once")
    normal, axis = unit_normal(plane), fixture.ignore_axis
    onto_picture, reach = onto_plane(plane, axis), (1 + BEYOND_TUBE) * guide.radius
    turns = np.linspace(0.0, np.pi, END_DIRECTIONS + 2)[1:-1, None]
    for number, length in enumerate(guide.lengths_m):
        closed = guide.closed[number]
        places = guide.at(np.linspace(0.0, length, GUIDE_PLACES), number)
        along = np.gradient(places, axis=0)
        if closed:
            along[[0, -1]] = places[1] - places[-2]
        along /= np.maximum(row_lengths(along), 1e-12)[:, None]
        side = np.cross(normal, along)
        side /= np.maximum(row_lengths(side), 1e-12)[:, None]
        # Along one side, around the end, back along the other side, and around the start.
        left, right = places + reach * side, (places - reach * side)[::-1]
        paths = [left, right]
        if not closed:
            end, start = (np.cos(turns) * side[k] + np.sin(turns) * along[k] for k in (-1, 0))
            around = places[-1] + reach * end, places[0] - reach * start
            paths = [np.vstack([left, around[0], right, around[1], left[:1]])]
        pull = pull_of(guide, places[GUIDE_PLACES // 2], onto_picture)
        lines = tuple(onto_picture(line) for path in paths for line in held_lines(guide, path))
        yield Outline("guide", lines, pull)


def held_lines(guide: Guide, tips: Array) -> Iterator[Array]:
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


def pull_of(
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
    along = axis
    if axis is None or abs(axis @ normal) < 0.05 * np.linalg.norm(axis) * np.linalg.norm(normal):
        along = normal

    def onto(points: Array) -> Array:
        beside = points - plane[:3, 2]
        return (beside - np.outer(beside @ normal / (along @ normal), along)) @ back.T

    return onto


def rendered_in_json(fixture: Fixture) -> Report:
    """Everything that the engine uses, by name; a long table by its size and its SHA-256."""
    known = rendered_values(fixture)
    for name, value in known.items():
        if isinstance(value, np.ndarray):
            known[name] = value.tolist()
            if value.size > 3:
                sha256 = hashlib.sha256(np.ascontiguousarray(value)).hexdigest()
                known[name] = {"shape": list(value.shape), "sha256": sha256}
    return known


def described(fixture: Fixture) -> tuple[tuple[str, str], ...]:
    """What the robot renders in words: (heading, text), one a line; none of a bare curve."""
    if fixture.rendering is None:
        return ()
    rows = [wall_in_words(fixture), guide_in_words(fixture)]
    axis, infinite = fixture.ignore_axis, "along no axis: the fixture lies in space"
    if axis is not None:
        infinite = f"along ({coordinates(axis, 4)}), where it gives no force"
    rows += [("Infinite", infinite), ("Rule", rule_in_words(fixture)),
             ("Robot", robot_in_words(fixture)), ("Place", place_in_words(fixture))]  # fmt: skip
    record = fixture.registration
    if record is not None:
        places = zip(record.labels, MM * record.target, strict=True)
        # A line breaks between two markers, not within one.
        markers = [
            f"{isolated(label)} {coordinates(place, 1, ' ')}".replace(" ", "\N{NO-BREAK SPACE}")
            for label, place in places
        ]
        rows.append(("Markers in robot coordinates, x y z [mm]", "; ".join(markers)))
    return tuple(filter(None, rows))


def wall_in_words(fixture: Fixture) -> tuple[str, str]:
    """How far and how stiffly the robot keeps the tip off."""
    what = "points"
    if fixture.guidance is not None:
        what = "strokes that do not guide"
    elif fixture.mesh is not None:
        what = "surface"
    elif fixture.curve is not None:
        what = "line"
    radius = fixture.contact_radius + fixture.point_radius
    words = f"begins {millimetres(radius, 2)} from the {what}"
    if fixture.point_radius:
        words += f", of which {millimetres(fixture.point_radius, 2)} belong to the points"
    stiffness = stiffness_in_words(fixture.stiffness)
    if fixture.region is None:
        return "Wall", f"none; the wall's {millimetres(radius, 2)} and {stiffness} are not used"
    return "Wall", f"{words}; {stiffness}"


def guide_in_words(fixture: Fixture) -> tuple[str, str] | None:
    """How the robot holds the tip; `None` where it does not."""
    guidance = fixture.guidance
    if guidance is None:
        return None
    what = "the line" if guidance.stroke is None else f"stroke {guidance.stroke}"
    words = f"holds the tip within {millimetres(guidance.radius, 2)} of {what}; "
    words += f"the tube's own {guidance.stiffness:g} N/m beyond"
    if guidance.lead_force:
        goal = "end" if guidance.lead_force > 0 else "start"
        speed = MM * (guidance.lead_speed or LEAD_SPEED_M_S)
        words += f"; pulls with {abs(guidance.lead_force):g} N to the {goal}, up to {speed:g} mm/s"
    else:
        words += "; no pull"
    if not fixture.curve.closed.all():
        words += f"; {AT_ENDS[guidance.ends]} at the ends"
    return "Guide", words


def rule_in_words(fixture: Fixture) -> str:
    """Which rule moves the proxy over what, and how exactly."""
    count = f"{len(fixture.points)} points"
    if fixture.pieces is not None and fixture.ignore_axis is not None:
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
    if fixture.max_iterations is not None:
        most = f"at most {fixture.max_iterations} iterations a tick"
    return f"{rule}, {count}; band {1e6 * fixture.band:.4g} µm; {most}"


def robot_in_words(fixture: Fixture) -> str:
    """Whether the stiffness is stable, and with which robot."""
    verdict = fixture.stability
    if verdict is None:
        return "none: the stiffness was checked with no robot"
    judged = "stable" if verdict.stable else "NOT STABLE"
    return (
        f"{verdict.robot}: {judged}, {verdict.k_n_per_m:g} N/m of at most "
        f"{verdict.k_pass_n_per_m:.0f} N/m"
    )


def place_in_words(fixture: Fixture) -> str:
    """The frame, and the box around what is rendered."""
    places = fixture.points
    if fixture.pieces is not None and fixture.ignore_axis is not None:
        places = fixture.pieces.vertices
    ends = MM * np.stack([places.min(axis=0), places.max(axis=0)], axis=1)
    box = ", ".join(
        f"{axis} {coordinates(row, 2, ' to ')}" for axis, row in zip("xyz", ends, strict=True)
    )
    return f"{fixture.frame}, {box} mm"


def stiffness_in_words(stiffness: Array) -> str:
    """The stiffness of the wall, one number where it is the same along all axes."""
    x, y, z = stiffness
    return f"{x:g} N/m" if x == y == z else f"{x:g} N/m along x, {y:g} along y, {z:g} along z"


def axis_in_words(axis: Array) -> str:
    """The axis of the frame that a direction follows within a degree, else its three numbers."""
    largest = int(np.abs(axis).argmax())
    if abs(axis[largest]) > np.cos(np.radians(1.0)):
        return "xyz"[largest]
    return f"({coordinates(axis, 3)})"


def in_one_line(fixture: Fixture) -> str:
    """What is rendered and who approved it, such as "wall, 1000 N/m, 5.00 mm, along z"."""
    guidance = fixture.guidance
    if fixture.rendering is None:
        words = "a curve, which no robot renders yet"
    else:
        stiffness, radius = fixture.stiffness, fixture.contact_radius + fixture.point_radius
        if guidance is not None:
            stiffness, radius = np.full(3, guidance.stiffness), guidance.radius
        axis = fixture.ignore_axis
        words = f"{kind_of(fixture)}, {stiffness_in_words(stiffness)}, {millimetres(radius, 2)}, "
        words += "in space" if axis is None else f"along {axis_in_words(axis)}"
        if guidance is not None and guidance.lead_force:
            words += f", pulls with {guidance.lead_force:g} N"
    approver = "nobody" if fixture.reviewed is None else fixture.reviewed.by
    return f"{words}; approved by {approver}"


def slice_not_shown() -> Finding:
    """The doubt of who looked at a plan without its slice."""
    text = (
        "The slice is not shown, so neither the line's ends nor other ink can be seen. Look at the "
        "bundle with its slice: vfplan review FIXTURE.h5 --slice IMAGE -o OUT.h5."
    )
    return doubt("slice-not-shown", "extract", text)


def visible_name(name: str) -> str:
    """A person's name without the blanks around it; refuses one that cannot be read as it is."""
    name = name.strip()
    is_visible = name.isprintable() and not INVISIBLE & set(name) and any(map(str.isalnum, name))
    if not is_visible or len(name) > MAX_NAME:
        raise SettingError(
            f"The name {name[:MAX_NAME]!a} is empty, longer than {MAX_NAME} characters, or holds "
            "signs that cannot be seen. Say who looks at the plan, in letters that show.",
            code="name-missing",
        )
    return name


def digest_of(fixture: Fixture, *, slice_shown: bool = True) -> str:
    """The digest of a fixture with its findings.

    Parameters
    ----------
    fixture
        The bundle's content.
    slice_shown
        Whether the sheet shows the slice that the curve was drawn on. A sheet without it has
        another digest: who saw that sheet has not seen the ends of the line.
    """
    unanswered = (replace(f, answered_by=None, answered_utc=None) for f in fixture.findings)
    content = to_content(replace(fixture, reviewed=None, findings=tuple(unanswered)))
    is_drawn = fixture.provenance.inputs.get("image") is not None
    title = "vfplan review sheet 2"
    if is_drawn and not slice_shown:
        title += ", slice not shown"
    return digest_of_content(title, content, content.keys() - LEFT_OUT)


def accept(
    fixture: Fixture, digest: str, by: str, *, answers: Collection[str] = (),
    answer_all: bool = False,
) -> Fixture:  # fmt: skip
    """The fixture with its findings answered and its review.

    Parameters
    ----------
    fixture
        What is accepted.
    digest
        The digest on the sheet that was looked at: 64 hexadecimal digits.
    by
        Who looked at it.
    answers
        Codes of the findings that are answered.
    answer_all
        Every finding is answered.

    Raises
    ------
    CheckFailed
        The digest is that of another plan, or a doubt stays without an answer. If the sheet did not
        show the slice, the fixture gets the doubt "slice-not-shown", which wants an answer too.
    SettingError
        There is no name, or a code that no open finding has.
    """
    by = visible_name(by)
    typed, digest, with_slice = digest, digest.lower(), digest_of(fixture)
    if digest not in (with_slice, digest_of(fixture, slice_shown=False)):
        raise CheckFailed(
            "This digest is not that of the bundle: the sheet that was looked at shows another "
            "plan. Draw the sheet of this bundle and look at it",
            code="digest-other",
            numbers={"given": typed, "expected": with_slice},
        )
    is_asked = any(finding.code == "slice-not-shown" for finding in fixture.findings)
    if digest != with_slice and not is_asked:
        fixture = replace(fixture, findings=(*fixture.findings, slice_not_shown()))
    open_codes = {finding.code for finding in fixture.open_findings}
    unknown = sorted(set(answers) - open_codes)
    if unknown:
        raise SettingError(
            f"No open finding has the code {unknown[0]!r}. Open are: "
            f"{', '.join(sorted(open_codes)) or 'none'}.",
            code="answer-unknown",
            numbers={"unknown": unknown, "open": sorted(open_codes)},
        )
    left = sorted(open_codes - set(answers))
    if left and not answer_all:
        raise CheckFailed(
            f"These findings have no answer: {', '.join(left)}. Answer each with --answer CODE, or "
            "all with --answer-all.",
            code="findings-unanswered",
            numbers={"unanswered": left},
        )
    now = now_utc()
    findings = tuple(
        replace(finding, answered_by=by, answered_utc=now) if finding.is_open else finding
        for finding in fixture.findings
    )
    accepted = replace(fixture, findings=findings, reviewed=None)
    return replace(accepted, reviewed=Review(by, now, review_digest(accepted)))
