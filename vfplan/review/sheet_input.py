"""Everything that a review sheet shows, as one plain record, and how it is filled.

`of_plan` and `of_extraction` fill it from what was just planned, `of_fixture` from a bundle that
was read, with its slice where that is given.

The numbers of a plan in words, as they stand beside the picture on a sheet.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.findings import Finding
from vfplan.fixture import Fixture, Stroke
from vfplan.geometry.lines import length_of
from vfplan.review.acceptance import digest_of

if TYPE_CHECKING:
    from vfplan.images.read import PlannedImage
    from vfplan.planning.extraction import ExtractResult
    from vfplan.planning.plan import PlanResult
    from vfplan.registration.registration import Registration


def facts_of(
    record: SheetInput,
    fixture: Fixture,
    strokes: tuple[Stroke, ...],
) -> tuple[tuple[str, str], ...]:
    """What stands beside the picture, in words."""
    heading = "Geometry" if not strokes else "Line"
    facts = [(heading, _geometry_in_words(record, fixture, strokes))]
    registration = fixture.registration
    if record.metres_per_px is not None:
        # Where markers and image say different sizes, both stand there.
        size = f"{record.metres_per_px * 1e3:.4g}"
        stated = size
        by_markers = registration is not None and registration.source_frame == "image"
        if by_markers and fixture.image is not None and fixture.image.pixel_spacing_mm is not None:
            along_u, along_v = fixture.image.pixel_spacing_mm
            stated = f"{math.sqrt(along_u * along_v):.4g}"
        words = f"{size} mm"
        if stated != size:
            words += f" by the markers, as the lengths here; {stated} mm by the image"
        facts.append(("Pixel", words))
    if registration is not None:
        left_out = labels_left_out(fixture)
        used = []
        for number, label in enumerate(registration.labels):
            if label not in left_out:
                used.append(number)
        worst = max(used, key=lambda number: registration.residuals_m[number])
        markers = str(len(used))
        if len(used) < len(registration.labels):
            markers += f" of {len(registration.labels)}"
        words = (
            f"{markers}, {registration.model}; residual "
            f"{registration.fre_rms_m * 1e3:.2f} mm rms, largest "
            f"{registration.residuals_m[worst] * 1e3:.2f} mm at "
            f"{registration.labels[worst]}"
        )
        facts.append(("Markers", words))
    error = "not known"
    if fixture.frame == "image":
        error = "not registered yet"
    elif record.tre95_m is not None:
        bound = float(record.tre95_m.max())
        error = f"moves the line by at most {bound * 1e3:.2f} mm"
        if record.metres_per_px is not None:
            error += f" ({bound / record.metres_per_px:.1f} px)"
        error += " (95 %)"
    elif registration is not None and registration.tre_m is not None:
        largest = float(registration.tre_m.max())
        error = f"{largest * 1e3:.2f} mm rms at most; the 95 % bound is not kept in the bundle"
    if fixture.frame == "image" or registration is not None:
        facts.append(("Error of the registration", error))
    if record.margin_m is not None:
        facts.append(("Margin", f"{record.margin_m * 1e3:.2f} mm on every side"))
    elif "margin" in fixture.provenance.settings:
        facts.append(("Margin", "the 95 % bound"))
    elif fixture.rendering is not None:
        facts.append(("Margin", "none"))
    if fixture.rendering is not None:
        radius = fixture.rendering.contact_radius + fixture.rendering.point_radius
        what = "line"
        if fixture.mesh is not None:
            what = "surface"
        elif fixture.curve is None:
            what = "points"
        stiffness = stiffness_in_words(fixture.rendering.stiffness)
        facts.append(
            ("The wall", f"{radius * 1e3:.2f} mm from the {what} to the tool's centre; {stiffness}")
        )
    return tuple(facts)


def _geometry_in_words(record: SheetInput, fixture: Fixture, strokes: tuple[Stroke, ...]) -> str:
    if not strokes and fixture.mesh is not None:
        return f"{len(fixture.points)} points, {len(fixture.mesh)} triangles"
    if not strokes:
        return f"{len(fixture.points)} points"
    parts = []
    for stroke in strokes:
        if not stroke.is_ordered:
            parts.append(f"{len(stroke.points)} pixels in no order")
            continue
        shape = "closed" if stroke.closed else "open"
        length = length_of(stroke.points, stroke.closed)
        words = f"{shape}, {length:.0f} px"
        if record.metres_per_px is not None:
            words += f" = {length * record.metres_per_px * 1e3:.1f} mm"
        if stroke.width is not None:
            words += f"; the pen is {stroke.width:.1f} px wide"
        parts.append(words)
    return ". ".join(parts)


def stiffness_in_words(stiffness: NDArray[np.float64]) -> str:
    """The stiffness of the wall, one number where it is the same along all axes."""
    x, y, z = stiffness
    return f"{x:g} N/m" if x == y == z else f"{x:g} N/m along x, {y:g} along y, {z:g} along z"


def labels_left_out(fixture: Fixture) -> list[str]:
    """The labels of the markers that a robust registration did not use."""
    return str(fixture.provenance.settings.get("markers_left_out", "")).split(",")


Array = NDArray[np.float64]


@dataclass(frozen=True)
class AccountEntry:
    """Ink in the pen's colour that was not taken: where, how much [px], and its share of all.

    Where `is_ink` is false it is a stretch of the line that shows no ink; `what` says why.
    """

    number: int
    u: float
    v: float
    pixels: int
    share: float
    what: str = ""
    is_ink: bool = True


@dataclass(frozen=True, eq=False)
class SheetMarker:
    """A marker where it was given.

    `place` is (u, v) [px] on a slice, else (x, y, z) [m] in the frame of the fixture.
    `residual_px` is (2,) from there to where the other markers say it lies, in the plane of the
    slice, or `None`; `residual_m` is the length of the whole residual.
    """

    label: str
    place: Array
    residual_px: Array | None
    residual_m: float
    used: bool = True


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
        Other ink, the largest first; `None` where nobody knows.
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
    account: tuple[AccountEntry, ...] | None = None
    markers: tuple[SheetMarker, ...] = ()
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

    @property
    def unanswered(self) -> int:
        """How many findings want an answer."""
        return sum(finding.is_open for finding in self.findings)

    @property
    def verdict(self) -> str:
        """The title of the sheet: what a person has to look at, and then to do."""
        if self.missing_slice:
            return "The slice is missing: this sheet shows no end of the line"
        if self.reviewed and not self.unanswered:
            return f"Approved by {self.reviewed}"
        then = "approve"
        if self.unanswered == 1:
            then = "answer 1 finding"
        elif self.unanswered:
            then = f"answer {self.unanswered} findings"
        # No program can tell whether something covers an end.
        ends = sum(len(stroke.end_points) for stroke in self.strokes)
        places = "the whole line"
        if self.rgb is None:
            places = "the three views"
        elif ends == 2:
            places = "both ends of the line"
        elif ends > 2:
            places = f"all {ends} ends"
        return f"Look at {places}, then {then}"


def of_plan(plan: PlanResult, title: str) -> SheetInput:
    """What the sheet of a new plan shows."""
    if plan.extracted.image is None:
        return of_fixture(plan.fixture, title)
    return of_fixture(
        plan.fixture,
        title,
        image=plan.extracted.image,
        registration=plan.registered.registration,
        extracted=plan.extracted,
    )


def of_extraction(extracted: ExtractResult, title: str) -> SheetInput:
    """What the sheet of a curve shows that is not registered yet."""
    if extracted.image is None:
        return of_fixture(extracted.fixture, title)
    return of_fixture(extracted.fixture, title, image=extracted.image, extracted=extracted)


def of_fixture(
    fixture: Fixture,
    title: str,
    *,
    image: PlannedImage | None = None,
    registration: Registration | None = None,
    extracted: ExtractResult | None = None,
) -> SheetInput:
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
    from vfplan.planning.settings import ExtractSettings
    from vfplan.registration.registration import describe_side

    if image is not None:
        check_slice(fixture, image)
    drawn = fixture.provenance.inputs.get("image") is not None
    pen = ""
    if drawn and "curve" not in fixture.provenance.inputs:
        pen = str(fixture.provenance.settings.get("colour", ExtractSettings().colour))
    # From where the robot sees the slice, where the bundle says how it lies.
    side = None
    axes = _pixel_axes(fixture, image)
    if axes is not None and fixture.registration is not None:
        side = describe_side(-np.cross(axes[:, 0], axes[:, 1]))
    reviewed = ""
    if fixture.reviewed is not None:
        reviewed = f"{fixture.reviewed.by}, {fixture.reviewed.utc}"
    record = SheetInput(
        title=title,
        digest=digest_of(fixture, slice_shown=image is not None),
        findings=fixture.findings,
        reviewed=reviewed,
        margin_m=_margin_of(fixture, None),
        side=side,
        frame=fixture.frame,
        pen=pen,
    )
    if image is None:
        markers: tuple[SheetMarker, ...] = ()
        if fixture.registration is not None:
            markers = _markers_of(fixture, fixture.registration.target, None)
        return replace(
            record,
            points_m=fixture.points,
            triangles=fixture.mesh,
            markers=markers,
            missing_slice=drawn,
            facts=facts_of(record, fixture, ()),
        )
    if extracted is None:
        strokes = strokes_on_slice(fixture, image)
        account = account_again(fixture, image, strokes)
    else:
        strokes, account = extracted.extraction.strokes, account_of(extracted)
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
    spacing_mm = image.pixel_spacing_mm
    if spacing_mm is None and fixture.image is not None:
        spacing_mm = fixture.image.pixel_spacing_mm
    if axes is not None:
        metres_per_px = _size_of(axes)
    elif spacing_mm is not None:
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
        raise InputError(
            "This bundle was not drawn on a slice. Leave --slice out.", code="slice-unknown"
        )
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
    units_per_px = _size_of(_pixel_axes(fixture, image)) if fixture.frame != "image" else 1.0
    drawn = fixture.strokes
    if fixture.curve is None:
        drawn = (Stroke(fixture.points, False, fixture.sigma, is_ordered=False),)
    strokes = []
    for stroke in drawn:
        sigma = stroke.sigma
        if sigma is not None:
            sigma = sigma / units_per_px
        strokes.append(replace(stroke, points=convert(stroke.points), sigma=sigma))
    return tuple(strokes)


def to_pixels(fixture: Fixture, image: PlannedImage | None) -> Callable[[Array], Array]:
    """From the frame of the fixture back to the pixels of its slice."""
    if fixture.frame == "image":
        return lambda points: points[:, :2]
    if fixture.frame == "patient_lps":
        return _onto_plane(_place_in_patient(image))
    record = fixture.registration
    if record is None:
        raise InputError(
            "This bundle does not say how it was registered, so its curve cannot be drawn on the "
            "slice. Leave --slice out.",
            code="slice-unregistered",
        )
    if record.source_frame == "image":
        return _onto_plane(record.T_robot_image)
    back = np.linalg.inv(record.T_robot_image)
    onto = _onto_plane(_place_in_patient(image))
    return lambda points: onto(points @ back[:3, :3].T + back[:3, 3])


def _place_in_patient(image: PlannedImage) -> Array:
    if image.T_patient_image is None:
        raise InputError(
            "The slice does not say where it lies in the patient, so the curve cannot be drawn on "
            "it. Give the DICOM file, or leave --slice out.",
            code="slice-unplaced",
        )
    return image.T_patient_image[:3]


def _onto_plane(transform: Array) -> Callable[[Array], Array]:
    """(M, 3) points of a plane to the (u, v) that a (3, 3) transform of [u v 1] brings there."""
    back = np.linalg.pinv(transform[:3, :2])
    return lambda points: (points - transform[:3, 2]) @ back.T


def account_of(extracted: ExtractResult) -> tuple[AccountEntry, ...]:
    """The ink that was not taken, the largest first."""
    words = {"ink": "", "bridge": "gap in the line", "hidden": "line hidden"}
    entries = []
    for entry in extracted.extraction.account:
        what, is_ink = words.get(entry.what, entry.what), entry.what == "ink"
        entries.append(
            AccountEntry(entry.number, entry.u, entry.v, entry.pixels, entry.share, what, is_ink)
        )
    return tuple(entries)


def account_again(
    fixture: Fixture, image: PlannedImage, strokes: tuple[Stroke, ...]
) -> tuple[AccountEntry, ...]:
    """The account of a bundle, made again on its slice; none for a curve of vectors."""
    from vfplan.planning.settings import ExtractSettings
    from vfplan.review.geometry import extraction_of, list_account
    from vfplan.review.ink import SliceInk

    if "curve" in fixture.provenance.inputs:
        return ()
    settings = extraction_of(fixture, ExtractSettings())
    ink = SliceInk(image.rgb, settings.colour, settings.exclude or (), settings.roi)
    lines = []
    for stroke in strokes:
        width = ink.width_along(stroke.points, stroke.closed) if stroke.is_ordered else 0.0
        lines.append(replace(stroke, width=width))
    entries = []
    for entry in list_account(ink.mask, lines):
        what = "gap in the line, or line hidden" if not entry.is_ink else ""
        u, v = entry.middle
        entries.append(
            AccountEntry(entry.number, u, v, entry.pixels, entry.share, what, entry.is_ink)
        )
    return tuple(entries)


def _margin_of(fixture: Fixture, tre95_m: Array | None) -> float | None:
    """What the plan added to the radius around each point; `None` where it added nothing."""
    margin = fixture.provenance.settings.get("margin")
    if margin is None or (margin == "tre95" and tre95_m is None):
        return None
    return float(tre95_m.max()) if margin == "tre95" else float(margin)


def _pixel_axes(fixture: Fixture, image: PlannedImage | None) -> Array | None:
    """(3, 2) steps of a pixel along u and v in the frame of the fixture [m]; `None` if unknown."""
    record = fixture.registration
    if record is not None and record.source_frame == "image":
        return record.T_robot_image[:3, :2]
    if image is None or image.T_patient_image is None:
        return None
    axes = image.T_patient_image[:3, :2]
    if record is not None:
        axes = record.T_robot_image[:3, :3] @ axes
    return axes


def _size_of(axes: Array) -> float:
    """The geometric mean of a pixel's sides [m]."""
    return float(np.sqrt(np.prod(np.linalg.svd(axes)[1])))


def _markers_on_slice(fixture: Fixture, image: PlannedImage) -> tuple[SheetMarker, ...]:
    """The markers where they lie on the slice, or where they project onto it."""
    record, steps = fixture.registration, _pixel_axes(fixture, image)
    if record is None or steps is None:
        return ()
    if record.source_frame == "image":
        places = record.source
        reached = record.source @ steps.T + record.T_robot_image[:3, 2]
    else:
        places = _onto_plane(image.T_patient_image[:3])(record.source)
        reached = record.source @ record.T_robot_image[:3, :3].T + record.T_robot_image[:3, 3]
    in_plane = (record.target - reached) @ np.linalg.pinv(steps).T
    return _markers_of(fixture, places, in_plane)


def _markers_of(
    fixture: Fixture, places: Array, residuals_px: Array | None
) -> tuple[SheetMarker, ...]:
    record = fixture.registration
    left_out = labels_left_out(fixture)
    markers = []
    for i, label in enumerate(record.labels):
        residual_px = residuals_px[i] if residuals_px is not None else None
        residual_m = float(record.residuals_m[i])
        markers.append(
            SheetMarker(label, places[i], residual_px, residual_m, label not in left_out)
        )
    return tuple(markers)


def _registration_again(fixture: Fixture) -> Registration | None:
    """The registration that the bundle's markers give; `None` where that is not the bundle's own.

    A bundle holds neither weights of markers nor the bound along its curve.
    """
    from vfplan.errors import VfplanError
    from vfplan.registration.registration import fit_registration

    record = fixture.registration
    if record is None:
        return None
    left_out = labels_left_out(fixture)
    used = np.array([label not in left_out for label in record.labels])
    spacing_m = None
    if record.source_frame == "image" and fixture.image is not None:
        spacing = fixture.image.pixel_spacing_mm
        if spacing is not None:
            spacing_m = (spacing[0] * 1e-3, spacing[1] * 1e-3)
    try:
        again = fit_registration(
            record.source[used], record.target[used], model=record.model, pixel_spacing=spacing_m
        )
    except VfplanError:
        return None
    if not np.allclose(again.T_target_source, record.T_robot_image, rtol=1e-6, atol=1e-9):
        return None
    return again
