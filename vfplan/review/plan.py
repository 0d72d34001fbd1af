"""A plan under review: what it begins with, and what the steps made of that.

It begins with a slice, a curve bundle or a fixture bundle, and its markers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bundle import rendered_values
from vfplan.bundle.seal import is_bundle
from vfplan.curve.account import AccountEntry
from vfplan.curve.coverage import Box
from vfplan.display import MM, Report, command_of, count, micrometres, millimetres
from vfplan.engine.browser import bodies_of
from vfplan.errors import InputError, SettingError, VfplanError
from vfplan.findings import Finding, Findings, doubt
from vfplan.fixture import Curve, Fixture, Provenance, SourceImage, Stroke
from vfplan.geometry.lines import Array, evenly, plane_normal, row_lengths
from vfplan.images.read import (
    MADE_FLAT_BY,
    MAX_BYTES,
    MAX_MEGAPIXELS,
    SLICE_IN_WORDS,
    SLICER_POINTS,
    PlannedImage,
    StackedSlice,
    flat_as_planned,
    flat_findings,
    height_in_words,
    made_flat,
    plane_of_slice,
    read_stack,
    side_of_patient,
    slice_file,
)
from vfplan.io.files import FilePath, naming_place, read_bytes
from vfplan.markers.correspondences import Correspondences
from vfplan.planning.extraction import PEN_SETTINGS, VECTOR_SETTINGS, extract, read_slice
from vfplan.planning.plan import planning_of, refuse_wrong_order, register
from vfplan.planning.settings import CURVE95, ExtractSettings, FixtureSettings, overridden
from vfplan.registration.checks import perspective_test
from vfplan.registration.registration import describe_side, left_out_note
from vfplan.review.geometry import Geometry, extraction_of, geometry_of_slice, ink_of
from vfplan.review.markers import Fit, Marker, bound95_m, fit_of, fit_of_files, size_of
from vfplan.review.rendered import (
    Kind,
    Outline,
    check_slice,
    digest_of,
    kind_of,
    onto_plane,
    outlines_of,
    registration_again,
    sigma_of,
    slice_not_shown,
    strokes_on_slice,
)
from vfplan.review.strokes import MendedStroke, SliceInk
from vfplan.settings import MISFIT, flat, incomplete_recipe, recalled, recorded, value_as

# What the page calls the values that the robot renders beside the line, and their units.
RENDERED_IN_WORDS = {
    "kind": ("What the robot renders", ""),
    "/@frame": ("Frame", ""),
    "/rendering@contact_radius_m": ("Distance from the line", " mm"),
    "/rendering@point_radius_m": ("Radius of each point", " mm"),
    "/rendering@band_m": ("Band", " mm"),
    "/rendering@max_iterations": ("Iterations in a tick, at most", ""),
    "/rendering/stiffness": ("Stiffness", " N/m"),
    "/rendering/ignore_axis": ("Infinite along", ""),
    "/guidance@radius_m": ("Radius of the guide", " mm"),
    "/guidance@stiffness_n_per_m": ("Stiffness of the guide", " N/m"),
    "/guidance@ends": ("Ends of the guide", ""),
    "/guidance@lead_force_n": ("Pull of the guide", " N"),
    "/guidance@lead_speed_m_s": ("Speed at which the pull ends", " m/s"),
    "/guidance@stroke": ("Stroke that guides", ""),
}

# Settings by name.
Settings = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Source:
    """The files of a review, read, and what extraction and registration say of them.

    Parameters
    ----------
    path
        The slice or the bundle.
    slice_path
        The slice; `None` if a bundle was given without it.
    image
        The slice, or a blank ground of its size.
    extraction, planning
        The settings in force.
    geometry, fit
        The curve and the markers before the first step.
    inputs
        Role -> SHA-256 of the files that the curve comes from.
    sha256
        Role ("source", "markers", "markers2", "slice", "curve") -> SHA-256 of a file as it was read
        when the review was opened. No file is read again.
    recipe
        The settings of extraction and the robot, as a bundle records them.
    bundle
        The content of the bundle, if one was given.
    as_opened
        The fixture that is approved as it is in that bundle while no step changes it; `None`
        without a bundle, or where other markers or settings were given.
    notes
        Findings: what was given in place of the bundle's recipe, and that the slice was made flat.
    case, robot_serial
        What that bundle was signed for; empty where it was not.
    """

    path: Path
    slice_path: Path | None
    image: PlannedImage
    extraction: ExtractSettings = field(default_factory=ExtractSettings)
    planning: FixtureSettings = field(default_factory=FixtureSettings)
    geometry: Geometry = field(default_factory=Geometry)
    fit: Fit = field(default_factory=Fit)
    inputs: dict[str, str] = field(default_factory=dict)
    sha256: dict[str, str] = field(default_factory=dict)
    recipe: Settings = field(default_factory=dict)
    bundle: Fixture | None = None
    as_opened: Fixture | None = None
    notes: Findings = ()
    case: str = ""
    robot_serial: str = ""
    # The slices among which one can be chosen, and the number of this one from 0.
    stack: tuple[StackedSlice, ...] = ()
    position: int = 0

    def describe(self) -> Report:
        """The slice as the page needs it."""
        # The patient's sides at the borders of a DICOM slice.
        sides = None
        if self.image.T_patient_image is not None:
            right, down, _ = self.image.T_patient_image[:3].T
            directions = {"left": -right, "right": right, "top": -down, "bottom": down}
            sides = {name: side_of_patient(towards)[0] for name, towards in directions.items()}
        return {
            "name": self.path.name, "width_px": self.image.width_px,
            "height_px": self.image.height_px, "pixel_spacing_mm": self.image.pixel_spacing_mm,
            "has_slice": self.slice_path is not None, "has_ink": self.geometry.ink is not None,
            "grey_max": int(np.iinfo(self.image.rgb.dtype).max), "sides": sides,
            "is_flat": self.is_flat, "position": self.position, "grey_range": self.image.grey_range,
            "series": [one.series for one in self.stack],
            "in_words": self.recipe.get(SLICE_IN_WORDS, ""),
        }  # fmt: skip

    def turned_to(self, position: int, fit: Fit) -> Source:
        """The source on another slice of the stack, by its number from 0.

        Its markers are those that files give; without those, the markers of the fit.
        """
        chosen = self.stack[position]
        extraction = replace(self.extraction, frame=chosen.frame)
        source = source_of_slice(chosen.path, None, extraction, self.planning)
        on_slice = replace(fit, pixel_spacing_mm=source.image.pixel_spacing_mm)
        if fit.given is not None:
            on_slice = fit_of(fit.given, source.image, self.planning)
        return replace(source.in_stack(self.stack, position), fit=on_slice)

    def in_stack(self, stack: tuple[StackedSlice, ...], position: int) -> Source:
        """The source, with the stack of which it is one slice, and that said in its recipe."""
        series = [k for k, one in enumerate(stack) if one.series == stack[position].series]
        words = f"{self.path.name}, slice {series.index(position) + 1} of {len(series)}"
        if self.image.T_patient_image is not None:
            words += f", {height_in_words(self.image)}"
        recipe = self.recipe | {SLICE_IN_WORDS: words}
        return replace(self, stack=stack, position=position, recipe=recipe)

    @property
    def is_flat(self) -> bool:
        """Whether it is a photograph that was made flat."""
        return MADE_FLAT_BY in self.recipe

    def geometry_with(self, ink: SliceInk) -> Geometry:
        """The slice extracted anew by the pen of this ink, without what that leaves out."""
        return geometry_of_slice(self.image, self.extraction_with(ink))

    def extraction_with(self, ink: SliceInk) -> ExtractSettings:
        """The extraction's settings for the pen and the boxes of this ink."""
        return replace(self.extraction, colour=ink.colour, exclude=ink.exclude or None)


@dataclass(frozen=True, eq=False)
class Outcome:
    """The plan as it would be written now: a fixture with its findings, or why there is none."""

    fixture: Fixture | None
    findings: Findings
    why_not: str = ""
    code: str = ""


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan as the page, the sheet, the approval and the commands have it.

    It is what the steps made of the source.

    Parameters
    ----------
    source
        What the review begins with.
    geometry, fit
        The curve and the markers.
    is_shaped
        Whether a hand has shaped the curve, so that extraction anew would undo that.
    answers
        Finding -> the same, answered. One with other words or at another place is another.
    """

    source: Source
    geometry: Geometry
    fit: Fit
    is_shaped: bool = False
    answers: dict[Finding, Finding] = field(default_factory=dict)

    @classmethod
    def of(cls, fixture: Fixture, name: str, image: PlannedImage | None = None) -> Plan:
        """A fixture as it is, on its slice if that is given, to be shown and not mended.

        Raises `ImageError` where the image is not the one that the curve was drawn on.
        """
        path, geometry = Path(name), Geometry()
        if image is not None:
            check_slice(fixture, image)
            geometry = geometry_of_bundle(fixture, image, extraction_of(fixture, ExtractSettings()))
        source = Source(path, image and path, image, geometry=geometry,
                        inputs=fixture.provenance.inputs)  # fmt: skip
        plan = cls(source, geometry, source.fit)
        plan.__dict__["outcome"] = Outcome(fixture, fixture.findings)
        return plan

    @property
    def findings(self) -> Findings:
        """What a person should look at, with the answers that were given."""
        return tuple(self.answers.get(finding, finding) for finding in self.outcome.findings)

    @property
    def why_not(self) -> list[str]:
        """What stands against an approval besides looks, one sentence each."""
        reasons = []
        if not self.geometry.strokes:
            reasons.append("There is no curve yet. Choose a candidate, or draw the curve.")
        elif self.outcome.why_not:
            reasons.append(self.outcome.why_not)
        unanswered = sum(finding.is_open for finding in self.findings)
        if unanswered:
            reasons.append(f"Answer {count(unanswered, 'finding')}.")
        return reasons

    @cached_property
    def outcome(self) -> Outcome:
        """The plan as it would be written, made once."""
        outcome = self._outcome()
        # Whether this review shows the slice; an earlier one may have.
        findings = [f for f in outcome.findings if f.code != "slice-not-shown"]
        if self.is_slice_missing:
            findings.append(slice_not_shown())
        opened, fixture = self.source.bundle, outcome.fixture
        if fixture is not None and fixture is not opened:
            findings += self.source.notes
            if opened is not None and opened.rendering is not None:
                findings += differences(opened, fixture)
        return replace(outcome, findings=tuple(findings))

    @cached_property
    def fixture(self) -> Fixture | None:
        """What would be written, with its findings and their answers; `None` if nothing would."""
        fixture = self.outcome.fixture
        return fixture and replace(fixture, findings=self.findings)

    @property
    def is_to_be_flat(self) -> bool:
        """Whether it is a photograph at an angle, which `vfplan rectify` makes flat.

        The markers tell, or they are refused and fit once it is flat.
        """
        from vfplan.registration.rectify import flattening

        registration, limit_m = self.fit.registration, self.fit.settings.max_residual_m
        if self.source.is_flat or registration is None:
            return False
        test = perspective_test(registration)
        if test is not None and test.is_possible:
            return True
        is_off = limit_m is not None and not registration.fre_rms_m <= limit_m
        try:
            flattened = flattening(self.fit.pairs(), self.source.image, limit_m, MAX_MEGAPIXELS)
        except VfplanError:
            return False
        # A bound may be large for other reasons than an angle.
        is_better = 2 * flattened.error_m <= registration.fle_rms_m
        return is_off or (self.outcome.code == "tre-large" and is_better)

    @property
    def has_other_markers(self) -> bool:
        """Whether they are not those of the bundle that was opened."""
        return self.fit.given is None or len(self.fit.given.inputs) > 0

    @property
    def exclude(self) -> tuple[Box, ...]:
        """Boxes in which ink does not count, (u, v, width, height) [px]."""
        ink = self.geometry.ink
        return () if ink is None else ink.exclude

    @property
    def image(self) -> PlannedImage | None:
        """The slice that the curve was drawn on; `None` where it is not at hand."""
        return self.source.slice_path and self.source.image

    @property
    def is_slice_missing(self) -> bool:
        """Whether the curve was drawn on a slice that is not at hand."""
        return self.image is None and "image" in self.source.inputs

    @cached_property
    def strokes(self) -> tuple[Stroke, ...]:
        """The lines on the slice [px], with the pen's width where a pen drew them."""
        return self.geometry.lines

    @cached_property
    def account(self) -> tuple[AccountEntry, ...]:
        """Other ink, and where the line shows none, the largest first."""
        return self.geometry.account

    @cached_property
    def digest(self) -> str:
        """By which it is accepted."""
        return digest_of(self.fixture, slice_shown=self.image is not None)

    @property
    def kind(self) -> Kind | None:
        """What the robot renders; `None` of a curve that it does not render yet."""
        return kind_of(self.fixture)

    @cached_property
    def plane(self) -> Array | None:
        """(3, 3) from (u, v, 1) of the slice to the fixture's frame [m]; `None` if unknown."""
        return plane_of_slice(self.fixture, self.image)

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

    def bodies(self) -> Report:
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

    @property
    def spacing_mm(self) -> tuple[float, float] | None:
        """The size of a pixel (along u, along v) that the image has or that was given."""
        spacings = [image.pixel_spacing_mm for image in (self.image, self.fixture.image) if image]
        return next(filter(None, spacings), None)

    @cached_property
    def metres_per_px(self) -> float | None:
        """The size of a pixel, by the markers, else as the image says; `None` if unknown."""
        if self.plane is not None:
            return size_of(self.plane)
        return self.spacing_mm and float(np.sqrt(np.prod(self.spacing_mm))) / MM

    @cached_property
    def tre95_m(self) -> Array | None:
        """(M,) the 95 % bound of the error along all strokes, by the markers and their own [m]."""
        registration, place = registration_again(self.fixture), None
        if registration is None or not self.strokes:
            return None
        if registration.source.shape[1] == 3:
            place = self.image.T_patient_image[:3]
        return bound95_m(registration, self.strokes, place)

    @cached_property
    def other_ink(self) -> tuple[AccountEntry, ...]:
        """The account without the bridges of the line."""
        return tuple(entry for entry in self.account if entry.what != "bridge")

    @property
    def slicer_points(self) -> Array:
        """(K, 2) the points that a person set in Slicer [px]; none of any other curve."""
        recipe = self.fixture.provenance.settings
        points = value_as(tuple[tuple[float, float], ...], recipe.get(SLICER_POINTS, ""))
        return np.array(() if points is MISFIT else points).reshape(-1, 2)

    @property
    def bound95_m(self) -> float | None:
        """The 95 % bound over the whole line, as its planning found it [m]; `None` if unknown.

        Earlier bundles do not hold it, so it is computed of the lines on their slice.
        """
        kept = self.fixture.provenance.settings.get(CURVE95)
        return float(self.tre95_m.max()) if kept is None and self.tre95_m is not None else kept

    @property
    def margin_m(self) -> float | None:
        """What the plan added to the radius around each point; `None` where it added nothing."""
        recipe = self.fixture.provenance.settings
        if "margin" not in recipe or self.fixture.rendering is None:
            return None
        return self.fixture.point_radius - float(recipe.get("point_radius", 0.0))

    @cached_property
    def markers(self) -> tuple[Marker, ...]:
        """The markers on the slice."""
        record, left_out = self.fixture.registration, self.fixture.labels_left_out
        if record is None or self.image is None or self.plane is None:
            return ()
        T, places = record.T_robot_image, record.source
        residuals = record.target - (record.source @ T[:3, :-1].T + T[:3, -1])
        residuals_px = residuals @ np.linalg.pinv(self.plane[:, :2]).T
        if record.source_frame != "image":
            places = onto_plane(self.image.T_patient_image[:3])(places)
        rows = zip(record.labels, places, record.residuals_m, residuals_px, strict=True)
        return tuple(
            Marker(label, place, is_used=label not in left_out, residual_m=float(m), residual_px=px)
            for label, place, m, px in rows
        )

    @property
    def bounds(self) -> Iterator[tuple[Stroke, Array]]:
        """Each stroke with the 95 % bound of its points, (M,) [m]; none if that is unknown."""
        if self.tre95_m is not None:
            stops = np.cumsum([len(stroke.points) for stroke in self.strokes])[:-1]
            yield from zip(self.strokes, np.split(self.tre95_m, stops), strict=True)

    def _outcome(self) -> Outcome:
        source, of_curve = self.source, self.geometry.all_findings
        if not self.geometry.strokes:
            return Outcome(None, of_curve)
        # What no step changed is approved as it is in the bundle.
        before = [id(stroke.points) for stroke in source.geometry.strokes]
        after = [id(stroke.points) for stroke in self.geometry.strokes]
        is_same = self.fit is source.fit and before == after
        if source.as_opened is not None and is_same:
            findings = tuple(map(self.geometry.as_settled, source.as_opened.findings))
            return Outcome(source.as_opened, findings)
        curve = self.curve()
        if not self.fit.markers:
            return Outcome(curve, of_curve)
        if self.fit.why_not:
            return Outcome(None, of_curve, sentence(self.fit.why_not), "markers")
        # A margin from the bound is made anew; a number cannot be.
        margin, opened = self.fit.settings.margin, source.bundle
        is_of_opened = opened is not None and margin == opened.provenance.settings.get("margin")
        if is_of_opened and self.has_other_markers and type(margin) is float:
            text = (
                f"The margin of {millimetres(margin)} was made for other markers. Run vfplan "
                "campaign on a plan with these, and give its --margin and --campaign."
            )
            return Outcome(None, of_curve, text, "margin-of-other-markers")
        pairs, settings = self.fit.pairs(), self.fit.settings
        from vfplan.stability.study import with_verdict_by

        try:
            planned = register(curve, pairs, None, settings, image=self.image).fixture
            planned = with_verdict_by(source.recipe, planned)
        except VfplanError as error:
            return Outcome(None, of_curve, sentence(error.message), error.code)
        # Markers that were found already are not looked for again; the recipe keeps how they were.
        planned = with_left_out(planned.with_settings(recorded(source.planning)), self.fit)
        return Outcome(planned, (*of_curve, *planned.findings))

    def curve(self) -> Fixture:
        """The curve in the image's pixels, as `vfplan extract` would write it."""
        strokes, ink, image = self.geometry.strokes, self.geometry.ink, self.source.image
        points = np.vstack([stroke.points for stroke in strokes])
        sigma = np.concatenate([stroke.sigma for stroke in strokes])
        settings = self.source.recipe | recorded(self.fit.settings)
        if ink is not None:
            settings = settings | recorded(self.source.extraction_with(ink))
        # The files of the bundle's markers are named as long as these are its markers.
        inputs = self.source.inputs
        if self.has_other_markers:
            inputs = {role: inputs[role] for role in inputs if role in ("image", "curve")}
        return Fixture(
            frame="image",
            points=np.c_[points, np.zeros(len(points))],
            provenance=Provenance.now(inputs, settings),
            # A curve that was drawn as vectors has no deviation.
            sigma=sigma if sigma.any() else None,
            curve=Curve.of(strokes),
            image=SourceImage(image.width_px, image.height_px, image.pixel_spacing_mm),
        )


def sentence(text: str) -> str:
    """A message as a sentence."""
    return text[:1].upper() + text[1:].removesuffix(".") + "."


def with_left_out(planned: Fixture, fit: Fit) -> Fixture:
    """A fixture by the markers in use of a fit, told of those that a person left out."""
    others = fit.with_markers(tuple(replace(one, is_used=not one.is_used) for one in fit.markers))
    if not others.used:
        return planned
    record, sigma, left_out = planned.registration, sigma_of(planned), others.pairs()
    residuals_m = row_lengths(fit.registration.apply(left_out.source) - left_out.target)
    labels = *planned.labels_left_out, *left_out.labels
    settings = {"markers_left_out": Fixture.labels_as_text(labels)}
    if sigma is not None:
        # A deviation that nobody gave counts nowhere.
        rows = [m.sigma_m if len(m.sigma_m) == len(sigma[0]) else sigma[0] for m in others.used]
        settings["markers_sigma_m"] = flat((*sigma, *rows))
    is_on_slice = record.source_frame == "image"
    places = [marker.place if is_on_slice else None for marker in others.used]
    return replace(
        planned.with_settings(settings),
        findings=(*planned.findings, *map(left_out_note, left_out.labels, residuals_m, places)),
        registration=replace(
            record, labels=(*record.labels, *left_out.labels),
            source=np.vstack([record.source, left_out.source]),
            target=np.vstack([record.target, left_out.target]),
            residuals_m=np.r_[record.residuals_m, residuals_m],
        ),
    )  # fmt: skip


def differences(opened: Fixture, fixture: Fixture) -> list[Finding]:
    """A doubt for each rendered value that is not that of the opened bundle; one for the line."""
    before, after = rendered_values(opened), rendered_values(fixture)
    texts, is_other_line = [], False
    for name in before | after:
        was, now = before.get(name), after.get(name)
        if np.array_equal(was, now):
            continue
        if re.match("/(points|curve|pieces|mesh)", name):
            is_other_line = True
            continue
        heading, unit = RENDERED_IN_WORDS[name]
        texts.append(f"{heading}: {in_words(now, unit)}, was {in_words(was, unit)}.")
    if is_other_line and fixture.frame == opened.frame:
        from scipy.spatial import cKDTree

        # Both lines with a point every hundredth of a millimetre.
        now, was = (
            np.vstack([evenly(1e5 * stroke.points, stroke.closed) for stroke in one.strokes])
            for one in (fixture, opened)
        )
        apart_m = 1e-5 * max(cKDTree(a).query(b)[0].max() for a, b in ((now, was), (was, now)))
        distance = millimetres(apart_m) if apart_m > 1e-5 else micrometres(apart_m)
        texts.append(f"The line was fitted anew, up to {distance} off that of the opened bundle.")
    return [doubt("differs-from-opened", "plan", text) for text in texts]


def in_words(value: Any, unit: str) -> str:
    """A rendered value in a sentence, a length [m] in millimetres; `None` is not there."""
    if value is None:
        return "not set"
    if isinstance(value, str):
        return value
    numbers = np.ravel(value) * (MM if unit == " mm" else 1)
    return ", ".join(f"{number:.9g}" for number in numbers.tolist()) + unit


def open_source(
    path: FilePath, markers: FilePath | None, markers2: FilePath | None,
    slice_path: FilePath | None, curve_path: FilePath | None, given: Settings,
) -> Source:  # fmt: skip
    """Read the files of a review; see `vfplan.review.session.Session.open`."""
    path = Path(path)
    slice_path = slice_path and Path(slice_path)
    of_extraction, of_planning = split_settings(given)
    if is_bundle(path):
        if curve_path is not None:
            text = "A bundle has its curve. Leave --curve out."
            raise SettingError(text, code="curve-given-twice")
        source = source_of_bundle(path, slice_path, of_extraction, of_planning)
    else:
        if slice_path is not None:
            text = f"{path} is a slice itself. Leave --slice out; it belongs to a bundle."
            raise SettingError(text, code="slice-given-twice")
        refuse_wrong_order(path, markers, markers2)
        extraction, planning = ExtractSettings(**of_extraction), FixtureSettings(**of_planning)
        stack = read_stack(path)
        if extraction.frame is not None or curve_path is not None or len(stack) < 2:
            first = stack[0].path if path.is_dir() else path
            source = source_of_slice(first, curve_path, extraction, planning)
            numbers = [k for k, one in enumerate(stack) if one.frame == extraction.frame]
            if len(stack) > 1 and len(numbers) == 1:
                source = replace(source.in_stack(stack, numbers[0]), stack=(), position=0)
        else:
            # The middle slice of the longest series.
            longest = Counter(one.series for one in stack).most_common(1)[0][0]
            numbers = [k for k, one in enumerate(stack) if one.series == longest]
            middle = numbers[len(numbers) // 2]
            chosen = replace(extraction, frame=stack[middle].frame)
            source = source_of_slice(stack[middle].path, None, chosen, planning)
            source = source.in_stack(stack, middle)
    if markers is None:
        if source.as_opened is not None:
            refuse_planning_of_planned(source.as_opened, of_planning)
        return source
    fit, inputs = fit_of_files(markers, markers2, source.image, source.planning)
    return replace(source, fit=fit, sha256=source.sha256 | inputs, as_opened=None)


def refuse_planning_of_planned(fixture: Fixture, given: Settings) -> None:
    """Refuse settings that would plan a fixture otherwise; a curve is not planned yet.

    An unchanged fixture is approved as it is in the file, so such a setting would have no effect.
    """
    others = other_than_recipe(fixture, FixtureSettings, given)
    if others and fixture.frame != "image" and fixture.rendering is not None:
        raise SettingError(
            "The fixture is planned already, and these settings would not change it: "
            f"{', '.join(others)}. Leave them out, or plan anew with them: vfplan plan IMAGE "
            "MARKERS.",
            code="planned-already",
            numbers={"settings": others},
        )


def refuse_extraction_of_extracted(fixture: Fixture, given: Settings) -> None:
    """Refuse settings that would measure a bundle's curve otherwise; it is measured already."""
    names = {*PEN_SETTINGS, "stroke", "density_per_mm", *VECTOR_SETTINGS}
    if "colour" not in fixture.provenance.settings:
        names.remove("colour")  # The page needs to know the pen.
    others = [name for name in other_than_recipe(fixture, ExtractSettings, given) if name in names]
    if others:
        raise SettingError(
            "The curve is extracted already, and these settings would not change it: "
            f"{', '.join(others)}. Leave them out, or extract it anew with them: vfplan review "
            "IMAGE.",
            code="extracted-already",
            numbers={"settings": others},
        )


def other_than_recipe(fixture: Fixture, kind: type, given: Settings) -> list[str]:
    """What is given otherwise than the recipe of a bundle has it."""
    recipe = recalled(kind, fixture.provenance.settings)
    wanted = replace(recipe or kind(), **given)
    return [name for name in given if getattr(wanted, name) != getattr(recipe, name, MISFIT)]


def made_flat_plan(plan: Plan, ink: SliceInk) -> Plan:
    """The plan on the photograph made flat by its markers, extracted anew by the pen of this ink.

    Raises `VfplanError` where the markers do not allow it.
    """
    from vfplan.registration.rectify import flattening, projected

    source, limit_m = plan.source, plan.fit.settings.max_residual_m
    flattened = flattening(plan.fit.pairs(), source.image, limit_m, MAX_MEGAPIXELS)
    image = made_flat(source.image, flattened.numbers)

    markers, given = list(plan.fit.markers), plan.fit.given
    for number, marker in enumerate(markers):
        if marker.place is not None:
            place = projected(flattened.homography, np.array([marker.place]))[0]
            markers[number] = replace(marker, place=tuple(place.tolist()))
    if given is not None:
        given = replace(given, source=projected(flattened.homography, given.source))
    fit = replace(
        plan.fit, markers=tuple(markers), given=given, pixel_spacing_mm=image.pixel_spacing_mm
    )
    source = replace(
        source, image=image, notes=(*source.notes, *flat_findings(flattened.told)),
        recipe=source.recipe | {MADE_FLAT_BY: flat(flattened.numbers)},
    )  # fmt: skip
    return replace(plan, source=source, geometry=source.geometry_with(ink), fit=fit)


def split_settings(settings: Settings) -> tuple[Settings, Settings]:
    """Settings by name, sorted into those of extraction and those of planning."""
    of_extraction, of_planning = {}, {}
    for name, value in settings.items():
        if name == "pixel_spacing_mm" and isinstance(value, (int, float)):
            value = (float(value), float(value))
        if name in ExtractSettings.__dataclass_fields__:
            of_extraction[name] = value
        elif name in FixtureSettings.__dataclass_fields__:
            of_planning[name] = value
        else:
            raise SettingError(
                f"There is no setting {name!r}. The fields of ExtractSettings and FixtureSettings "
                "are allowed.",
                code="no-such-setting",
            )
    return of_extraction, of_planning


def source_of_slice(
    path: Path, curve_path: FilePath | None, extraction: ExtractSettings,
    planning: FixtureSettings,
) -> Source:  # fmt: skip
    """What a review of a slice begins with."""
    image = read_slice(path, extraction)
    inputs, sha256 = {"image": image.sha256}, {"source": image.sha256}
    recipe = recorded(extraction)
    if curve_path is None:
        geometry = geometry_of_slice(image, extraction)
    else:
        drawn = extract(image, extraction, curve=curve_path, contact_radius=planning.contact_radius)
        strokes = tuple(map(MendedStroke.of, drawn.extraction.strokes))
        geometry = Geometry(strokes, None, drawn.findings)
        inputs, recipe = drawn.fixture.provenance.inputs, drawn.fixture.provenance.settings
        sha256["curve"] = inputs["curve"]
    return Source(
        path, path, image, extraction, planning, geometry,
        Fit((), planning, image.pixel_spacing_mm), inputs, sha256, recipe,
    )  # fmt: skip


def source_of_bundle(
    path: Path, slice_path: Path | None, of_extraction: Settings, of_planning: Settings
) -> Source:
    """What a review of a bundle begins with."""
    from vfplan.bundle.read import read_sealed
    from vfplan.bundle.seal import naming_bundle

    data, of_file = read_bytes(path, MAX_BYTES)
    with naming_bundle(path):
        fixture, seal = read_sealed(data)
    known, sha256 = fixture.provenance.settings, {"source": of_file}
    with naming_place(path):
        refuse_extraction_of_extracted(fixture, of_extraction)
        extraction = replace(extraction_of(fixture, ExtractSettings()), **of_extraction)
        planning = planning_of(fixture, of_planning)
    if fixture.curve is None or fixture.mesh is not None:
        raise InputError(
            "This bundle has no drawn curve that the page could show. Print its sheet: "
            f"{command_of('review', path, '--sheet-out', 'sheet.png')}",
            where=str(path),
            code="no-drawn-curve",
        )
    image, spacing = None, fixture.image and fixture.image.pixel_spacing_mm
    if slice_path is not None:
        slice_path = slice_file(fixture, slice_path)
        image = flat_as_planned(read_slice(slice_path, extraction_of(fixture, extraction)), known)
        check_slice(fixture, image)
        if spacing is not None:
            image = replace(image, pixel_spacing_mm=spacing)
        sha256["slice"] = image.sha256
    with naming_place(path):
        geometry = geometry_of_bundle(fixture, image, extraction)
    geometry = replace(geometry, strokes=tuple(map(MendedStroke.of, geometry.strokes)))
    if image is None:
        # A picture of the slice's size in one light grey.
        points = np.concatenate([stroke.points for stroke in geometry.strokes])
        width, height = (points.max(axis=0) + 50).astype(int).tolist()
        if fixture.image is not None:
            width, height = fixture.image.width_px, fixture.image.height_px
        rgb = np.full((height, width, 3), 235, np.uint8)
        image = PlannedImage(rgb, spacing, fixture.provenance.inputs.get("image", ""))

    # The markers of its registration lie where they were found.
    fit = Fit((), planning, image.pixel_spacing_mm)
    record = fixture.registration
    if record is not None:
        sigma = sigma_of(fixture)
        pairs = Correspondences(
            record.labels, record.source, record.source_frame, record.target,
            sigma and np.array(sigma).squeeze(),
            tool=record.tool, tip=record.tip,
        )  # fmt: skip
        fit = fit_of(pairs, image, replace(planning, find_markers=False))
        # A robust fit leaves out anew what does not fit.
        if not planning.robust:
            fit = fit.without(fixture.labels_left_out)
    from vfplan.stability.study import judge_of  # Here, because a sheet needs none of it.

    robot = {name: value for name, value in known.items() if name.lower().startswith("robot")}
    kept = (MADE_FLAT_BY, SLICE_IN_WORDS, SLICER_POINTS)
    of_slice = {name: known[name] for name in kept if name in known}
    if judge_of(robot) is None and fixture.stability is not None:
        raise incomplete_recipe("it does not say which robot the stiffness is stable with")
    return Source(
        path, slice_path, image, extraction, planning, geometry, fit,
        dict(fixture.provenance.inputs), sha256,
        recorded(extraction) | robot | of_slice, bundle=fixture,
        as_opened=fixture,
        notes=tuple(overridden(recalled(FixtureSettings, known) or planning, planning)),
        case=seal.get("case") or fixture.case or "",
        robot_serial=seal.get("robot_serial", ""),
    )  # fmt: skip


def geometry_of_bundle(
    fixture: Fixture, image: PlannedImage | None, extraction: ExtractSettings
) -> Geometry:
    """The curve of a bundle on its slice, and the pen's ink if a pen drew it."""
    ink = None
    if image is not None and "curve" not in fixture.provenance.inputs:
        ink = ink_of(image, extraction)
    known = tuple(finding for finding in fixture.findings if finding.stage == "extract")
    strokes = strokes_on_slice(fixture, image)
    if ink is not None:
        strokes = tuple(ink.with_hidden(line) if line.is_ordered else line for line in strokes)
    # What the ink asks is made anew: the bundle may come from another program.
    return Geometry(strokes, ink, known, max_gap_px=extraction.max_gap_px, is_as_found=ink is None)
