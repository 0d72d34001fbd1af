"""A plan under review: what it begins with, and what the steps made of that.

It begins with a slice, a curve bundle or a fixture bundle, and its markers.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.curve.coverage import Box
from vfplan.errors import ImageError, InputError, SettingError, VfplanError
from vfplan.findings import Finding, doubt
from vfplan.fixture import Curve, Fixture, Provenance, SourceImage
from vfplan.images.read import MAX_BYTES, MAX_MEGAPIXELS, PlannedImage, read_image
from vfplan.io.files import read_whole
from vfplan.markers.correspondences import Correspondences, read_markers
from vfplan.planning.extraction import PEN_SETTINGS
from vfplan.planning.plan import refuse_wrong_order, register
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.review.geometry import Geometry, extraction_of, geometry_of_slice
from vfplan.review.ink import SliceInk
from vfplan.review.markers import Fit, fit_of
from vfplan.review.rendered import Shown, labels_left_out, strokes_on_slice
from vfplan.review.strokes import MendedStroke

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"

# Grey level of the ground on which a curve lies whose slice is not at hand.
BLANK_GREY = 235


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
    exclude
        Boxes that the settings exclude, (u, v, width, height) [px].
    inputs
        Role -> SHA-256 of the files.
    marker_files
        The marker files as they were given; empty if the markers come from a bundle.
    fixture
        The bundle's content, if one was given.
    case, robot_serial
        What that bundle was signed for; empty where it was not.
    """

    path: Path
    slice_path: Path | None
    image: PlannedImage
    extraction: ExtractSettings
    planning: FixtureSettings
    geometry: Geometry
    fit: Fit
    exclude: tuple[Box, ...]
    inputs: dict[str, str]
    marker_files: tuple[Path, Path | None] | tuple[()] = ()
    fixture: Fixture | None = None
    case: str = ""
    robot_serial: str = ""

    @property
    def is_slice_missing(self) -> bool:
        """Whether the curve was drawn on a slice that was not given."""
        return self.slice_path is None and self.inputs.get("image") is not None

    def describe(self) -> dict[str, Any]:
        """The slice as the page needs it."""
        # The patient's sides at the borders of a DICOM slice.
        sides = None
        if self.image.T_patient_image is not None:
            right, down, _ = self.image.T_patient_image[:3].T
            sides = {"left": _side(-right), "right": _side(right), "top": _side(-down),
                     "bottom": _side(down)}  # fmt: skip
        return {
            "name": self.path.name, "width_px": self.image.width_px,
            "height_px": self.image.height_px, "pixel_spacing_mm": self.image.pixel_spacing_mm,
            "has_slice": self.slice_path is not None, "has_ink": self.geometry.ink is not None,
            "grey_max": int(np.iinfo(self.image.rgb.dtype).max), "sides": sides,
        }  # fmt: skip

    def geometry_with(self, ink: SliceInk, exclude: tuple[Box, ...]) -> Geometry:
        """The slice extracted anew by the pen of this ink, with the ink in the boxes left out."""
        settings = self.extraction_with(ink, exclude)
        return geometry_of_slice(self.slice_path, settings, ink.without(exclude))

    def extraction_with(self, ink: SliceInk, exclude: tuple[Box, ...]) -> ExtractSettings:
        """The extraction's settings for the pen of this ink, with these boxes excluded."""
        return replace(self.extraction, colour=ink.colour, exclude=exclude or None)


@dataclass(frozen=True, eq=False)
class Outcome:
    """The plan as it would be written now: a fixture with its findings, or why there is none."""

    fixture: Fixture | None
    findings: tuple[Finding, ...]
    why_not: str = ""
    code: str = ""


@dataclass(frozen=True, eq=False)
class Plan:
    """What the steps made of the source.

    Parameters
    ----------
    source
        What the review begins with.
    geometry, fit
        The curve and the markers.
    exclude
        Boxes in which ink does not count, (u, v, width, height) [px].
    is_shaped
        Whether a hand has shaped the curve, so that extraction anew would undo that.
    answers
        A finding's key -> who accepted it, and when.
    """

    source: Source
    geometry: Geometry
    fit: Fit
    exclude: tuple[Box, ...] = ()
    is_shaped: bool = False
    answers: dict[str, tuple[str | None, str]] = field(default_factory=dict)
    # Holds the outcome once there is one; steps that do not change it hand it on.
    _made: dict[str, Outcome] = field(default_factory=dict)

    def changed(self, **changes: Any) -> Plan:
        """The plan with another curve, or other markers; it has no outcome yet."""
        return replace(self, _made={}, **changes)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What a person should look at, with the answers that were given."""
        findings = []
        for finding in self.outcome.findings:
            if key_of(finding) in self.answers:
                by, at = self.answers[key_of(finding)]
                finding = replace(finding, answered_by=by or "", answered_utc=at)
            findings.append(finding)
        return tuple(findings)

    @property
    def why_not(self) -> list[str]:
        """What stands against an approval, one sentence each; empty where nothing does."""
        reasons = []
        if not self.geometry.strokes:
            reasons.append("There is no curve yet. Choose a candidate, or draw the curve.")
        elif self.outcome.why_not:
            reasons.append(self.outcome.why_not)
        for number, stroke in enumerate(self.geometry.strokes, 1):
            if not stroke.viewed.all():
                share = max(1.0 - stroke.viewed.mean(), 0.01)
                reasons.append(
                    f"{share:.0%} of stroke {number} was not in view yet at full size. Look along "
                    "it."
                )
        unanswered = sum(finding.is_open for finding in self.findings)
        if unanswered == 1:
            reasons.append("One finding wants an answer.")
        elif unanswered:
            reasons.append(f"{unanswered} findings want an answer.")
        return reasons

    @property
    def outcome(self) -> Outcome:
        """The plan as it would be written, made once."""
        if "outcome" not in self._made:
            outcome = self._outcome()
            # Whether this review shows the slice; an earlier one may have.
            findings = [f for f in outcome.findings if f.code != "slice-not-shown"]
            if self.source.is_slice_missing:
                text = (
                    "The slice is not shown, so neither the line's ends nor other ink can be seen. "
                    "Open the bundle with its slice: --slice IMAGE."
                )
                findings.append(doubt("slice-not-shown", "extract", text))
            self._made["outcome"] = replace(outcome, findings=tuple(findings))
        return self._made["outcome"]

    @cached_property
    def shown(self) -> Shown | None:
        """What the page and the sheet show of it; `None` where there is no fixture."""
        fixture, source, geometry = self.outcome.fixture, self.source, self.geometry
        if fixture is None:
            return None
        return Shown(
            source.path.name, replace(fixture, findings=self.findings),
            source.image if source.slice_path is not None else None, geometry.strokes,
            geometry.account, self.fit.registration,
        )  # fmt: skip

    def _outcome(self) -> Outcome:
        source, of_curve = self.source, self.geometry.all_findings
        if not self.geometry.strokes:
            return Outcome(None, of_curve)
        # What no step changed is approved as it is in the bundle.
        before = [stroke.points for stroke in source.geometry.strokes]
        after = [stroke.points for stroke in self.geometry.strokes]
        is_same = self.fit is source.fit and list(map(id, before)) == list(map(id, after))
        if source.fixture is not None and is_same:
            return Outcome(source.fixture, source.fixture.findings)
        curve = self.curve()
        if not self.fit.markers:
            return Outcome(curve, of_curve)
        if self.fit.why_not:
            return Outcome(None, of_curve, _sentence(self.fit.why_not), "markers")
        with self.fit.as_files() as files:
            # The files themselves, as long as nobody changed a marker.
            if self.fit is source.fit and source.marker_files:
                files = source.marker_files
            image = None
            if source.slice_path is not None:
                image = source.image
            try:
                planned = register(curve, *files, self.fit.settings, image=image)
            except VfplanError as error:
                # The page has no options; what is wrong with the markers is mended on it.
                message = error.message.replace(", or give --markers-as-given", "")
                return Outcome(None, of_curve, _sentence(message), error.code)
        return Outcome(planned.fixture, (*of_curve, *planned.findings))

    def curve(self) -> Fixture:
        """The curve in the image's pixels, as `vfplan extract` would write it."""
        strokes, ink, image = self.geometry.strokes, self.geometry.ink, self.source.image
        points = np.vstack([stroke.points for stroke in strokes])
        sigma = np.concatenate([stroke.sigma for stroke in strokes])
        # A bundle has its own settings.
        fixture = self.source.fixture
        settings = dict(vars(self.source.extraction) if fixture is None
                        else fixture.provenance.settings)  # fmt: skip
        if self.exclude:
            settings["exclude"] = self.exclude
        if ink is not None and ink.colour != self.source.extraction.colour:
            settings["colour"] = ink.colour
        return Fixture(
            frame="image",
            points=np.c_[points, np.zeros(len(points))],
            provenance=Provenance.now(self.source.inputs, settings),
            # A curve that was drawn as vectors has no deviation.
            sigma=sigma if sigma.any() else None,
            curve=Curve.of(strokes),
            image=SourceImage(image.width_px, image.height_px, image.pixel_spacing_mm),
        )


def key_of(finding: Finding) -> str:
    """What an answer belongs to: a finding with other words or at another place is another one."""
    place = finding.place_px or finding.place_m or ()
    return json.dumps([finding.code, finding.stage, finding.text, [round(x, 3) for x in place]])


def _sentence(text: str) -> str:
    """A message as a sentence."""
    return text[:1].upper() + text[1:].removesuffix(".") + "."


def open_source(
    path: str | Path, markers: str | Path | None, markers2: str | Path | None,
    slice_path: str | Path | None, curve_path: str | Path | None, settings: dict[str, Any],
) -> Source:  # fmt: skip
    """Read the files of a review; see `vfplan.review.session.Session.open`."""
    path = Path(path)
    slice_path = Path(slice_path) if slice_path is not None else None
    curve_path = Path(curve_path) if curve_path is not None else None
    extraction, planning = split_settings(settings)
    if is_bundle(path):
        if curve_path is not None:
            text = "A bundle has its curve. Leave --curve out."
            raise SettingError(text, code="curve-given-twice")
        source = _of_bundle(path, slice_path, extraction, planning)
    else:
        if slice_path is not None:
            text = f"{path} is a slice itself. Leave --slice out; it belongs to a bundle."
            raise SettingError(text, code="slice-given-twice")
        refuse_wrong_order(path, markers, markers2)
        source = _of_slice(path, curve_path, extraction, planning)
    if markers is None:
        if source.fixture is not None:
            refuse_planning_of_planned(source.fixture, planning)
        return source
    pairs = read_markers(markers, markers2, common=planning.common)
    files = (Path(markers), Path(markers2) if markers2 is not None else None)
    fit = fit_of(pairs, source.image, planning)
    return replace(source, fit=fit, marker_files=files, fixture=None)


def settings_of(extraction: ExtractSettings, planning: FixtureSettings) -> dict[str, Any]:
    """Both settings by name, as `Session.open` takes them."""
    return {**vars(extraction), **vars(planning)}


def refuse_planning_of_planned(fixture: Fixture, planning: FixtureSettings) -> None:
    """Refuse settings that would plan a fixture otherwise; a curve is not planned yet.

    An unchanged fixture is approved as it is in the file, so such a setting would have no effect.
    """
    if fixture.frame == "image" or fixture.rendering is None:
        return
    usual = vars(FixtureSettings())
    without_effect = [name for name, value in vars(planning).items() if value != usual[name]]
    if without_effect:
        text = (
            "The fixture is planned already, and these settings would not change it: "
            f"{', '.join(without_effect)}. Leave them out, or plan anew with them: vfplan plan "
            "IMAGE MARKERS."
        )
        raise SettingError(text, code="planned-already", numbers={"settings": without_effect})


def refuse_extraction_of_extracted(fixture: Fixture, settings: ExtractSettings) -> None:
    """Refuse settings that would measure a bundle's curve otherwise; it is measured already."""
    recorded = extraction_of(fixture, ExtractSettings())
    usual = ExtractSettings()
    names = [*PEN_SETTINGS, "stroke", "density_per_mm", "curve_origin"]
    if "colour" not in fixture.provenance.settings:
        names.remove("colour")  # The page needs to know the pen.
    without_effect = [
        name
        for name in names
        if getattr(settings, name) not in (getattr(usual, name), getattr(recorded, name))
    ]
    if without_effect:
        text = (
            "The curve is extracted already, and these settings would not change it: "
            f"{', '.join(without_effect)}. Leave them out, or extract it anew with them: vfplan "
            "review IMAGE."
        )
        raise SettingError(text, code="extracted-already", numbers={"settings": without_effect})


def split_settings(settings: dict[str, Any]) -> tuple[ExtractSettings, FixtureSettings]:
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
    return ExtractSettings(**of_extraction), FixtureSettings(**of_planning)


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes, lower-case hex; raises `InputError`."""
    return hashlib.sha256(read_whole(path, MAX_BYTES, InputError)).hexdigest()


def is_bundle(path: Path) -> bool:
    """Whether a file is a bundle, by its first bytes or, if it cannot be read, its suffix."""
    try:
        with path.open("rb") as file:
            return file.read(len(HDF5_SIGNATURE)) == HDF5_SIGNATURE
    except OSError:
        return path.suffix == ".h5"


def _of_slice(
    path: Path, curve_path: Path | None, extraction: ExtractSettings, planning: FixtureSettings
) -> Source:
    image = _read_slice(path, extraction)
    exclude = tuple(tuple(box) for box in extraction.exclude or ())
    inputs, ink = {"image": image.sha256}, None
    if curve_path is None:
        ink = SliceInk(image.rgb, extraction.colour, exclude, extraction.roi)
    geometry = geometry_of_slice(path, extraction, ink, curve_path)
    if curve_path is not None:
        inputs["curve"] = sha256_of(curve_path)
    fit = Fit((), planning, image.pixel_spacing_mm)
    return Source(path, path, image, extraction, planning, geometry, fit, exclude, inputs)


def _read_slice(path: Path, settings: ExtractSettings) -> PlannedImage:
    return read_image(
        path,
        frame=settings.frame,
        pixel_spacing_mm=settings.pixel_spacing_mm,
        imager_spacing=bool(settings.imager_spacing),
        max_megapixels=settings.max_megapixels or MAX_MEGAPIXELS,
    )


def _of_bundle(
    path: Path, slice_path: Path | None, extraction: ExtractSettings, planning: FixtureSettings
) -> Source:
    from vfplan.bundle.read import read_sealed

    fixture, seal = read_sealed(path)
    refuse_extraction_of_extracted(fixture, extraction)
    if fixture.curve is None or fixture.mesh is not None:
        text = (
            "This bundle has no drawn curve that the page could show. Print its sheet: vfplan "
            f"review {path} --sheet-out sheet.png"
        )
        raise InputError(text, where=str(path), code="no-drawn-curve")
    slice_image = None
    if slice_path is not None:
        slice_image = _slice_of(fixture, slice_path, path, extraction)
    record = fixture.registration
    is_planar = record is not None and record.source_frame == "image"
    is_placed = slice_image is not None and slice_image.T_patient_image is not None
    if fixture.frame != "image" and not is_planar and (record is None or not is_placed):
        text = (
            "This bundle does not say where its curve lies on a slice. Give the DICOM slice with "
            f"--slice, or print its sheet: vfplan review {path} --sheet-out sheet.png"
        )
        raise InputError(text, where=str(path), code="no-slice-registration")
    drawn = strokes_on_slice(fixture, slice_image)
    image = slice_image
    if image is None:
        # A blank picture of the slice's size.
        spacing = None
        points = np.concatenate([stroke.points for stroke in drawn])
        width, height = (points.max(axis=0) + 50).astype(int).tolist()
        if fixture.image is not None:
            width, height = fixture.image.width_px, fixture.image.height_px
            spacing = fixture.image.pixel_spacing_mm
        rgb = np.full((height, width, 3), BLANK_GREY, np.uint8)
        image = PlannedImage(rgb, spacing, fixture.provenance.inputs.get("image", ""))

    # The curve on the slice, and the pen's ink if it was drawn by a pen.
    ink = None
    extraction = extraction_of(fixture, extraction)
    exclude = extraction.exclude or ()
    if slice_image is not None and "curve" not in fixture.provenance.inputs:
        ink = SliceInk(image.rgb, extraction.colour, exclude, extraction.roi)
    strokes = tuple(MendedStroke.of(stroke) for stroke in drawn)
    of_extraction = tuple(f for f in fixture.findings if f.stage == "extract")

    # The markers of its registration, and how it was rendered.
    fit = Fit((), planning, image.pixel_spacing_mm)
    if record is not None:
        # Rendered and registered as the bundle is, unless the caller says otherwise.
        of_bundle = {"model": record.model}
        if fixture.rendering is not None:
            of_bundle["stiffness"] = tuple(float(k) for k in fixture.rendering.stiffness)
            of_bundle["contact_radius"] = float(fixture.rendering.contact_radius)
            of_bundle["point_radius"] = float(fixture.rendering.point_radius)
        usual = FixtureSettings()
        unset = [n for n in of_bundle if getattr(planning, n) == getattr(usual, n)]
        planning = replace(planning, **{name: of_bundle[name] for name in unset})
        pairs = Correspondences(record.labels, record.source, record.source_frame, record.target)
        fit, left_out = fit_of(pairs, image, planning), labels_left_out(fixture)
        markers = [replace(marker, is_used=marker.label not in left_out) for marker in fit.markers]
        fit = replace(fit, markers=tuple(markers))
    return Source(
        path, slice_path, image, extraction, planning,
        Geometry(strokes, ink, of_extraction), fit, exclude, dict(fixture.provenance.inputs),
        fixture=fixture, case=seal.case, robot_serial=seal.robot_serial,
    )  # fmt: skip


def _slice_of(
    fixture: Fixture, slice_path: Path, path: Path, extraction: ExtractSettings
) -> PlannedImage:
    """The slice that a bundle's curve was drawn on; raises `ImageError` for another."""
    image = _read_slice(slice_path, extraction)
    known = fixture.provenance.inputs.get("image")
    if known != image.sha256:
        text = (
            f"This is not the slice that the curve of {path} was drawn on. Their SHA-256 differ: "
            f"{image.sha256[:12]}... here, {str(known)[:12]}... in the bundle. Give the original."
        )
        raise ImageError(text, where=str(slice_path), code="another-slice")
    if fixture.image is not None and fixture.image.pixel_spacing_mm is not None:
        return replace(image, pixel_spacing_mm=fixture.image.pixel_spacing_mm)
    return image


def _side(direction: np.ndarray) -> str:
    """The letter of the patient's side to which a direction of LPS leads most."""
    # Each pair of letters stands for the negative and the positive direction of an axis.
    axis = int(np.abs(direction).argmax())
    return ("RL", "AP", "FH")[axis][int(direction[axis] > 0)]
