"""Everything that a review sheet shows, as one plain record, and how it is filled.

`of_plan` fills it from what was just planned, `of_fixture` from a bundle that was read, with its
slice where that is given. The numbers of a plan in words stand beside the picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.account import AccountEntry
from vfplan.errors import InputError, VfplanError
from vfplan.findings import Finding
from vfplan.fixture import Fixture, Stroke
from vfplan.geometry.lines import length_of, plane_normal
from vfplan.planning.settings import ExtractSettings
from vfplan.registration.registration import Registration, describe_side, fit_registration
from vfplan.review.acceptance import digest_of
from vfplan.review.geometry import Geometry, extraction_of
from vfplan.review.ink import SliceInk
from vfplan.review.markers import Marker
from vfplan.review.rendered import Outline, kind_of, onto_plane, outlines_of

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage
    from vfplan.planning.extraction import ExtractResult
    from vfplan.planning.plan import PlanResult

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LineEnd:
    """An end of a line, or the start of a closed one.

    `name` is "start" or "end", `place` is (u, v) [px of the slice], and `direction` the unit
    vector in which the line would go on; `None` for a closed line.
    """

    name: str
    place: Array
    direction: Array | None


def ends_of(stroke: Stroke) -> list[LineEnd]:
    """Both ends of a line, or the start of a closed one."""
    points = stroke.points
    if not stroke.is_ordered:
        return []
    if stroke.closed:
        return [LineEnd("start", points[0], None)]
    ends = []
    for name, line in (("start", points[::-1]), ("end", points)):
        step = line[-1] - line[max(0, len(line) - 9)]
        length = max(float(np.hypot(*step)), 1e-9)
        ends.append(LineEnd(name, line[-1], step / length))
    return ends


# What the sheet calls an entry of the account.
WORDS_OF_ENTRY = {
    "ink": "",
    "bridge": "gap in the line",
    "hidden": "line hidden",
    "gap": "gap in the line, or line hidden",
}


@dataclass(frozen=True, eq=False)
class SheetInput:
    """What a sheet shows.

    Parameters
    ----------
    title
        What is reviewed, such as a file's name.
    digest
        By which it is accepted.
    findings
        What a person should look at.
    rgb
        (H, W, 3) uint8 or uint16, the slice; `None` where there is none.
    strokes
        The lines on the slice.
    account
        Other ink, and where the line shows none, the largest first.
    markers
        Where they were given.
    metres_per_px
        The size of a pixel; `None` where nobody knows.
    margin_m
        What was added to the radius around the line [m].
    tre95_m
        (M,) the 95 % bound of the registration's error along all strokes' points [m].
    side
        From where the slice is seen, such as "above (robot +z)".
    facts
        (heading, text) in the order in which they stand beside the picture.
    reviewed
        Who approved it and when, in words; empty where nobody has.
    fixture
        What is rendered; `None` where nothing is.
    plane
        (3, 3), takes (u, v, 1) of the slice into the frame of the fixture [m].
    points_m, triangles
        (N, 3) and (K, 3): the geometry of a bundle that shows no slice.
    frame
        The frame of `points_m`.
    missing_slice
        The curve was drawn on a slice, and that was not given.
    pen
        The colour of the pen as it was named; empty where no pen drew the curve.
    """

    title: str
    digest: str
    findings: tuple[Finding, ...] = ()
    rgb: NDArray[Any] | None = None
    strokes: tuple[Stroke, ...] = ()
    account: tuple[AccountEntry, ...] = ()
    markers: tuple[Marker, ...] = ()
    metres_per_px: float | None = None
    margin_m: float | None = None
    tre95_m: Array | None = None
    side: str | None = None
    facts: tuple[tuple[str, str], ...] = ()
    reviewed: str = ""
    points_m: Array | None = None
    triangles: NDArray[np.int32] | None = None
    frame: str = "robot_base"
    missing_slice: bool = False
    pen: str = ""
    fixture: Fixture | None = None
    plane: Array | None = None

    @cached_property
    def outlines(self) -> tuple[Outline, ...]:
        """What the robot renders, on the slice; none where it is unknown how that lies."""
        if self.fixture is None or self.plane is None or self.rgb is None:
            return ()
        return outlines_of(self.fixture, self.plane, self.rgb.shape[1::-1])

    def bands(self) -> Iterator[tuple[Stroke, bool, Array]]:
        """Margin and 95 % bound along each stroke: whether it is the bound, and (M,) [m]."""
        first = 0
        for stroke in self.strokes:
            stop = first + len(stroke.points)
            if self.margin_m:
                yield stroke, False, np.full(stop - first, self.margin_m)
            if self.tre95_m is not None:
                yield stroke, True, self.tre95_m[first:stop]
            first = stop

    @property
    def unanswered(self) -> int:
        """How many findings want an answer."""
        return sum(finding.is_open for finding in self.findings)

    @property
    def verdict(self) -> str:
        """The title of the sheet: what a person has to look at, and then to do."""
        kind = ""
        if self.fixture is not None and self.fixture.rendering is not None:
            kind = f"A {kind_of(self.fixture)}. "
        if self.missing_slice:
            return f"{kind}The slice is missing: this sheet shows no end of the line"
        if self.reviewed and not self.unanswered:
            return f"Approved by {self.reviewed}"
        then = "approve"
        if self.unanswered:
            then = (
                "answer 1 finding" if self.unanswered == 1 else f"answer {self.unanswered} findings"
            )
        # No program can tell whether something covers an end.
        ends = sum(len(stroke.end_points) for stroke in self.strokes)
        places = {0: "the whole line", 2: "both ends of the line"}.get(ends, f"all {ends} ends")
        if self.rgb is None:
            places = "the three views"
        return f"{kind}Look at {places}, then {then}"


def facts_of(
    record: SheetInput, fixture: Fixture, strokes: tuple[Stroke, ...]
) -> tuple[tuple[str, str], ...]:
    """The numbers of a plan in words: (heading, text) as they stand beside the picture."""
    facts = [
        ("Line" if strokes else "Geometry", _geometry_in_words(record, fixture, strokes)),
        ("Pixel", _pixel_in_words(record, fixture)),
        ("Markers", _markers_in_words(fixture)),
        ("Error of the registration", _error_in_words(record, fixture)),
        ("Margin", _margin_in_words(record, fixture)),
    ]
    return tuple((heading, words) for heading, words in facts if words)


def _geometry_in_words(record: SheetInput, fixture: Fixture, strokes: tuple[Stroke, ...]) -> str:
    parts = []
    for stroke in strokes:
        if not stroke.is_ordered:
            parts.append(f"{len(stroke.points)} pixels in no order")
            continue
        length = length_of(stroke.points, stroke.closed)
        words = f"{'closed' if stroke.closed else 'open'}, {length:.0f} px"
        if record.metres_per_px is not None:
            words += f" = {length * record.metres_per_px * 1e3:.1f} mm"
        if stroke.width is not None:
            words += f"; the pen is {stroke.width:.1f} px wide"
        parts.append(words)
    if not strokes:
        parts = [f"{len(fixture.points)} points"]
        if fixture.mesh is not None:
            parts = [f"{parts[0]}, {len(fixture.mesh)} triangles"]
    return ". ".join(parts)


def _pixel_in_words(record: SheetInput, fixture: Fixture) -> str:
    if record.metres_per_px is None:
        return ""
    # Where markers and image say different sizes, both stand there.
    size = stated = f"{record.metres_per_px * 1e3:.4g}"
    by_markers = fixture.registration is not None and fixture.registration.source_frame == "image"
    spacing_mm = None
    if fixture.image is not None:
        spacing_mm = fixture.image.pixel_spacing_mm
    if by_markers and spacing_mm is not None:
        stated = f"{math.sqrt(spacing_mm[0] * spacing_mm[1]):.4g}"
    if stated == size:
        return f"{size} mm"
    return f"{size} mm by the markers, as the lengths here; {stated} mm by the image"


def _markers_in_words(fixture: Fixture) -> str:
    registration = fixture.registration
    if registration is None:
        return ""
    left_out, labels = labels_left_out(fixture), registration.labels
    used = [number for number, label in enumerate(labels) if label not in left_out]
    worst = max(used, key=lambda number: registration.residuals_m[number])
    count = f"{len(used)} of {len(labels)}" if len(used) < len(labels) else f"{len(used)}"
    return (
        f"{count}, {registration.model}; residual {registration.fre_rms_m * 1e3:.2f} mm rms, "
        f"largest {registration.residuals_m[worst] * 1e3:.2f} mm at {labels[worst]}"
    )


def _error_in_words(record: SheetInput, fixture: Fixture) -> str:
    if fixture.frame == "image":
        return "not registered yet"
    if fixture.registration is None:
        return ""
    if record.tre95_m is not None:
        bound = float(record.tre95_m.max())
        words = f"moves the line by at most {bound * 1e3:.2f} mm"
        if record.metres_per_px is not None:
            words += f" ({bound / record.metres_per_px:.1f} px)"
        return f"{words} (95 %)"
    if fixture.registration.tre_m is None:
        return "not known"
    largest = float(fixture.registration.tre_m.max())
    return f"{largest * 1e3:.2f} mm rms at most; the 95 % bound is not kept in the bundle"


def _margin_in_words(record: SheetInput, fixture: Fixture) -> str:
    if record.margin_m is not None:
        return f"{record.margin_m * 1e3:.2f} mm on every side"
    if "margin" in fixture.provenance.settings:
        return "the 95 % bound"
    if fixture.rendering is not None:
        return "none"
    return ""


def of_plan(plan: PlanResult, title: str) -> SheetInput:
    """What the sheet of a new plan shows."""
    return of_fixture(
        plan.fixture,
        title,
        image=plan.extracted.image,
        registration=plan.registered.registration,
        extracted=plan.extracted,
    )


def of_fixture(
    fixture: Fixture, title: str, *, image: PlannedImage | None = None,
    registration: Registration | None = None, extracted: ExtractResult | None = None,
) -> SheetInput:  # fmt: skip
    """What the sheet of a bundle shows.

    Parameters
    ----------
    fixture
        The bundle.
    title
        What it is called on the sheet.
    image
        The slice that the curve was drawn on, where it is known.
    registration
        The registration the fixture was made with. Without it, it is made again from the markers
        that the bundle holds.
    extracted
        The curve as it was measured on the slice, with the account of other ink. Without it, the
        points of the bundle are carried back onto the slice.

    Raises
    ------
    InputError
        The image is not the one that the curve was drawn on.
    """
    if image is not None:
        check_slice(fixture, image)
    inputs = fixture.provenance.inputs
    plane = plane_of(fixture, image)
    record = SheetInput(
        title=title,
        digest=digest_of(fixture, slice_shown=image is not None),
        findings=fixture.findings,
        frame=fixture.frame,
        fixture=fixture,
        plane=plane,
    )
    if fixture.reviewed is not None:
        record = replace(record, reviewed=f"{fixture.reviewed.by}, {fixture.reviewed.utc}")
    if "image" in inputs and "curve" not in inputs:
        colour = fixture.provenance.settings.get("colour", ExtractSettings().colour)
        record = replace(record, pen=str(colour))
    # From where the robot sees the slice, where the bundle says how it lies.
    if plane is not None and fixture.registration is not None:
        record = replace(record, side=describe_side(-plane_normal(plane)))
    if image is None:
        record = replace(
            record,
            margin_m=_margin_of(fixture, None),
            points_m=fixture.points,
            triangles=fixture.mesh,
            markers=_markers_of(fixture),
            missing_slice="image" in inputs,
        )
        return replace(record, facts=facts_of(record, fixture, ()))
    if extracted is None:
        strokes = strokes_on_slice(fixture, image)
        account = account_again(fixture, image, strokes)
    else:
        strokes, account = extracted.extraction.strokes, extracted.extraction.account
    if registration is None:
        registration = _registration_again(fixture)
    tre95_m = None
    if registration is not None:
        points = np.concatenate([stroke.points for stroke in strokes])
        if registration.source.shape[1] == 3:
            place = _place_in_patient(image)
            points = points @ place[:, :2].T + place[:, 2]
        tre95_m = registration.tre95_curve_m(points)
    # The size of a pixel: by the markers, else as the image or the bundle says.
    metres_per_px = None
    if plane is not None:
        metres_per_px = _size_of(plane)
    spacing_mm = image.pixel_spacing_mm or (fixture.image and fixture.image.pixel_spacing_mm)
    if plane is None and spacing_mm is not None:
        metres_per_px = float(np.sqrt(spacing_mm[0] * spacing_mm[1])) * 1e-3
    record = replace(
        record,
        rgb=image.rgb,
        strokes=strokes,
        account=account,
        metres_per_px=metres_per_px,
        markers=_markers_on_slice(fixture, image),
        tre95_m=tre95_m,
        margin_m=_margin_of(fixture, tre95_m),
    )
    return replace(record, facts=facts_of(record, fixture, strokes))


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
    units_per_px = 1.0
    if fixture.frame != "image":
        units_per_px = _size_of(plane_of(fixture, image))
    drawn = fixture.strokes
    if fixture.curve is None:
        drawn = (Stroke(fixture.points, False, fixture.sigma, is_ordered=False),)
    strokes = []
    for stroke in drawn:
        sigma = None
        if stroke.sigma is not None:
            sigma = stroke.sigma / units_per_px
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


def account_again(
    fixture: Fixture, image: PlannedImage, strokes: tuple[Stroke, ...]
) -> tuple[AccountEntry, ...]:
    """The account of a bundle, made again on its slice; none for a curve of vectors."""
    if "curve" in fixture.provenance.inputs:
        return ()
    settings = extraction_of(fixture, ExtractSettings())
    ink = SliceInk(image.rgb, settings.colour, settings.exclude or (), settings.roi)
    return Geometry(strokes, ink).account


def _margin_of(fixture: Fixture, tre95_m: Array | None) -> float | None:
    """What the plan added to the radius around each point; `None` where it added nothing."""
    margin = fixture.provenance.settings.get("margin")
    if margin is None or (margin == "tre95" and tre95_m is None):
        return None
    if margin == "tre95":
        return float(tre95_m.max())
    return float(margin)


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


def _size_of(plane: Array) -> float:
    """The geometric mean of a pixel's sides [m]."""
    return float(np.sqrt(np.prod(np.linalg.svd(plane[:, :2])[1])))


def _markers_on_slice(fixture: Fixture, image: PlannedImage) -> tuple[Marker, ...]:
    """The markers where they lie on the slice, or where they project onto it."""
    record, plane = fixture.registration, plane_of(fixture, image)
    if record is None or plane is None:
        return ()
    steps = plane[:, :2]
    if record.source_frame == "image":
        places = record.source
        reached = record.source @ steps.T + record.T_robot_image[:3, 2]
    else:
        places = onto_plane(image.T_patient_image[:3])(record.source)
        reached = record.source @ record.T_robot_image[:3, :3].T + record.T_robot_image[:3, 3]
    residuals_px = (record.target - reached) @ np.linalg.pinv(steps).T
    return tuple(
        replace(marker, place=place, residual_px=residual_px)
        for marker, place, residual_px in zip(
            _markers_of(fixture), places, residuals_px, strict=True
        )
    )


def _markers_of(fixture: Fixture) -> tuple[Marker, ...]:
    """The markers where they lie in front of the robot."""
    record, left_out = fixture.registration, labels_left_out(fixture)
    if record is None:
        return ()
    return tuple(
        Marker(label, place, is_used=label not in left_out, residual_m=float(residual_m))
        for label, place, residual_m in zip(
            record.labels, record.target, record.residuals_m, strict=True
        )
    )


def labels_left_out(fixture: Fixture) -> list[str]:
    """The labels of the markers that a robust registration did not use."""
    return str(fixture.provenance.settings.get("markers_left_out", "")).split(",")


def _registration_again(fixture: Fixture) -> Registration | None:
    """The registration that the bundle's markers give; `None` where that is not the bundle's own.

    A bundle holds neither weights of markers nor the bound along its curve.
    """
    record = fixture.registration
    if record is None:
        return None
    used = [marker.is_used for marker in _markers_of(fixture)]
    spacing_m = None
    if record.source_frame == "image" and fixture.image is not None:
        spacing_mm = fixture.image.pixel_spacing_mm
        if spacing_mm is not None:
            spacing_m = (spacing_mm[0] * 1e-3, spacing_mm[1] * 1e-3)
    try:
        again = fit_registration(
            record.source[used], record.target[used], model=record.model, pixel_spacing=spacing_m
        )
    except VfplanError:
        return None
    is_own = np.allclose(again.T_target_source, record.T_robot_image, rtol=1e-6, atol=1e-9)
    if not is_own:
        return None
    return again
