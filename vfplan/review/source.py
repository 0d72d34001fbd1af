"""What a review begins with: a slice, a curve bundle or a fixture bundle, and its markers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import ImageColor

from vfplan.errors import ImageError, InputError, SettingError
from vfplan.findings import Finding
from vfplan.fixture import Fixture
from vfplan.images.read import MAX_MEGAPIXELS, PlannedImage, read_image
from vfplan.markers import read_markers
from vfplan.planning import ExtractSettings, FixtureSettings
from vfplan.review.geometry import Geometry, geometry_of_slice
from vfplan.review.ink import Ink
from vfplan.review.markers import Fit, Marker, markers_of
from vfplan.review.strokes import Stroke

HDF5 = b"\x89HDF\r\n\x1a\n"
BLANK_GREY = 235
"""Grey level of the ground on which a curve is shown whose slice is not at hand."""


@dataclass(frozen=True, eq=False)
class Source:
    """The files of a review, read, and what extraction and registration say of them.

    Parameters
    ----------
    path
        The slice or the bundle.
    slice_path
        The slice; `None` where a bundle was given without it.
    image
        The slice, or a blank ground of its size.
    extraction, planning
        The settings in force.
    geometry, fit
        The curve and the markers before the first step.
    boxes
        Boxes that the settings exclude, (u, v, width, height) [px].
    inputs
        Role -> SHA-256 of the files.
    marker_files
        The marker files as they were given; empty where the markers come from a bundle.
    fixture
        The bundle's content, where one was given.
    """

    path: Path
    slice_path: Path | None
    image: PlannedImage
    extraction: ExtractSettings
    planning: FixtureSettings
    geometry: Geometry
    fit: Fit
    boxes: tuple[tuple[int, int, int, int], ...]
    inputs: dict[str, str]
    marker_files: tuple[Path, Path | None] | tuple[()] = ()
    fixture: Fixture | None = None

    @property
    def settings_in_force(self) -> dict[str, Any]:
        """The extraction's settings, for the provenance; a bundle has its own."""
        if self.fixture is not None:
            return dict(self.fixture.provenance.settings)
        return {k: v for k, v in asdict(self.extraction).items() if v is not None}

    @property
    def image_of_markers(self) -> PlannedImage | None:
        """The slice against whose drawn marks the markers are held."""
        return None if self.slice_path is None else self.image

    @property
    def fixture_findings(self) -> tuple[Finding, ...]:
        """The findings of the bundle."""
        return () if self.fixture is None else self.fixture.findings

    @property
    def approved(self) -> dict[str, Any] | None:
        """Who approved the bundle, and when; `None` where nobody has."""
        if self.fixture is None or self.fixture.reviewed is None:
            return None
        return asdict(self.fixture.reviewed)

    @property
    def sha256(self) -> str:
        """What a draft belongs to: the slice or, without it, the bundle's points."""
        return self.inputs.get("image") or next(iter(self.inputs.values()), "")

    def describe(self) -> dict[str, Any]:
        """The slice as the page needs it."""
        spacing = self.image.pixel_spacing_mm
        return {
            "name": self.path.name,
            "width_px": self.image.width_px,
            "height_px": self.image.height_px,
            "pixel_spacing_mm": None if spacing is None else list(spacing),
            "has_slice": self.slice_path is not None,
            "sides": _sides(self.image),
        }

    def geometry_with(self, boxes: tuple[tuple[int, int, int, int], ...]) -> Geometry:
        """The slice extracted anew, with ink in the boxes left out."""
        settings = self.extraction_with(boxes)
        ink = self.geometry.ink.without(boxes)
        return geometry_of_slice(self.slice_path, settings, ink)

    def extraction_with(self, boxes: tuple[tuple[int, int, int, int], ...]) -> ExtractSettings:
        """The extraction's settings with these boxes excluded."""
        return replace(self.extraction, exclude=boxes or None)


def open_source(
    path: str | Path,
    markers: str | Path | None,
    markers2: str | Path | None,
    slice_path: str | Path | None,
    settings: dict[str, Any],
) -> Source:
    """Read the files of a review; see `vfplan.review.Session.open`."""
    path = Path(path)
    extraction, planning = split_settings(settings)
    pairs = None if markers is None else read_markers(markers, markers2, common=planning.common)
    files: tuple[Path, Path | None] | tuple[()] = ()
    if markers is not None:
        files = (Path(markers), None if markers2 is None else Path(markers2))
    if is_bundle(path):
        source = _of_bundle(path, slice_path, extraction, planning)
        if pairs is None:
            return source
        fit = replace(source.fit, markers=markers_of(pairs))
        return replace(source, fit=fit, marker_files=files, fixture=None)
    if slice_path is not None:
        raise SettingError(
            f"{path} is a slice itself; a further slice is for bundles only",
            code="slice-given-twice",
        )
    image = _slice(path, extraction)
    boxes = tuple(tuple(box) for box in extraction.exclude or ())
    ink = Ink(image.rgb, colour_of(extraction.colour), boxes)
    return Source(
        path=path,
        slice_path=path,
        image=image,
        extraction=extraction,
        planning=planning,
        geometry=geometry_of_slice(path, extraction, ink),
        fit=Fit(() if pairs is None else markers_of(pairs), planning, image.pixel_spacing_mm),
        boxes=boxes,
        inputs={"image": image.sha256},
        marker_files=files,
    )


def settings_of(extraction: ExtractSettings, planning: FixtureSettings) -> dict[str, Any]:
    """Both settings by name, as `Session.open` takes them."""
    named = {field.name: getattr(extraction, field.name) for field in fields(extraction)}
    return named | {field.name: getattr(planning, field.name) for field in fields(planning)}


def split_settings(settings: dict[str, Any]) -> tuple[ExtractSettings, FixtureSettings]:
    """Settings by name, sorted into those of extraction and those of planning."""
    reading = {field.name for field in fields(ExtractSettings)}
    making = {field.name for field in fields(FixtureSettings)}
    for name in settings:
        if name not in reading | making:
            raise SettingError(
                f"there is no setting {name!r}; the fields of ExtractSettings and FixtureSettings "
                "are allowed",
                code="no-such-setting",
            )
    given = dict(settings)
    spacing = given.get("pixel_spacing_mm")
    if isinstance(spacing, (int, float)):
        given["pixel_spacing_mm"] = (float(spacing), float(spacing))
    return (
        ExtractSettings(**{k: v for k, v in given.items() if k in reading}),
        FixtureSettings(**{k: v for k, v in given.items() if k in making}),
    )


def is_bundle(path: Path) -> bool:
    """Whether a file is a bundle, by its first bytes or, where it cannot be read, its suffix."""
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError:
        return path.suffix == ".h5"
    return head.startswith(HDF5) or HDF5 in (head[512:520], head[1024:1032], head[2048:2056])


def colour_of(name: str) -> np.ndarray:
    """(3,) RGB, 0 to 255, of a pen's name or #rrggbb."""
    try:
        return np.array(ImageColor.getrgb(name)[:3], float)
    except ValueError:
        raise SettingError(
            f"colour {name!r} is neither a colour's name nor #rrggbb", code="no-such-colour"
        ) from None


def _slice(path: Path, settings: ExtractSettings) -> PlannedImage:
    return read_image(
        path,
        frame=settings.frame,
        pixel_spacing_mm=settings.pixel_spacing_mm,
        imager_spacing=bool(settings.imager_spacing),
        max_megapixels=settings.max_megapixels or MAX_MEGAPIXELS,
    )


def _of_bundle(
    path: Path,
    slice_path: str | Path | None,
    extraction: ExtractSettings,
    planning: FixtureSettings,
) -> Source:
    from vfplan.bundle import read_fixture

    fixture = read_fixture(path)
    points, sigma = _on_slice(fixture, path)
    image = _ground(fixture, points)
    if slice_path is not None:
        given = _slice(Path(slice_path), extraction)
        known = fixture.provenance.inputs.get("image")
        if known != given.sha256:
            raise ImageError(
                f"is not the slice that the curve of {path} was drawn on. Their SHA-256 differ: "
                f"{given.sha256[:12]}... here, {str(known)[:12]}... in the bundle",
                where=str(slice_path),
                code="another-slice",
            )
        image = replace(given, pixel_spacing_mm=image.pixel_spacing_mm or given.pixel_spacing_mm)
    ink = None
    if slice_path is not None:
        colour = fixture.provenance.settings.get("colour", extraction.colour)
        ink = Ink(image.rgb, colour_of(str(colour)))
    strokes = []
    curve = fixture.curve
    for number, closed in enumerate(curve.closed):
        own = curve.stroke == number
        bridged = None if curve.bridged is None else curve.bridged[own]
        edited = None if curve.edited is None else curve.edited[own]
        deviation = None if sigma is None else sigma[own]
        strokes.append(Stroke.measured(points[own], deviation, bool(closed), bridged, edited))
    drawn = tuple(finding for finding in fixture.findings if finding.stage == "extract")
    markers: tuple[Marker, ...] = ()
    record = fixture.registration
    if record is not None:
        planning = _settings_of(fixture, planning)
        markers = tuple(
            Marker(label, tuple(place), tuple(target))
            for label, place, target in zip(
                record.labels, record.source.tolist(), record.target.tolist(), strict=True
            )
        )
    return Source(
        path=path,
        slice_path=None if slice_path is None else Path(slice_path),
        image=image,
        extraction=extraction,
        planning=planning,
        geometry=Geometry(tuple(strokes), ink, drawn),
        fit=Fit(markers, planning, image.pixel_spacing_mm),
        boxes=(),
        inputs=dict(fixture.provenance.inputs),
        fixture=fixture,
    )


def _on_slice(fixture: Fixture, path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """A bundle's points and their deviations on the slice [px]."""
    record = fixture.registration
    if fixture.curve is None or fixture.mesh is not None:
        raise InputError(
            "has no drawn curve that the page could show. Print its sheet: vfplan review "
            f"{path} --sheet-out sheet.png",
            where=str(path),
            code="no-drawn-curve",
        )
    if fixture.frame == "image":
        return fixture.points[:, :2], fixture.sigma
    if record is None or record.T_robot_image.shape != (3, 3):
        raise InputError(
            "was not registered from a slice. Print its sheet: vfplan review "
            f"{path} --sheet-out sheet.png",
            where=str(path),
            code="no-slice-registration",
        )
    axes = record.T_robot_image[:, :2]
    origin = record.T_robot_image[:, 2]
    scale = float(np.sqrt(np.prod(np.linalg.norm(axes, axis=0))))
    sigma = None if fixture.sigma is None else fixture.sigma / scale
    return (fixture.points - origin) @ np.linalg.pinv(axes).T, sigma


def _ground(fixture: Fixture, points: np.ndarray) -> PlannedImage:
    """A blank picture of the slice's size."""
    size = fixture.image
    if size is None:
        width, height = (int(x) + 50 for x in points.max(axis=0))
        spacing = None
    else:
        width, height = size.width_px, size.height_px
        spacing = size.pixel_spacing_mm
    rgb = np.full((height, width, 3), BLANK_GREY, np.uint8)
    return PlannedImage(rgb, spacing, fixture.provenance.inputs.get("image", ""))


def _settings_of(fixture: Fixture, given: FixtureSettings) -> FixtureSettings:
    """How the bundle was rendered and registered, unless the caller says otherwise."""
    rendering = fixture.rendering
    usual = FixtureSettings()
    known = {"model": fixture.registration.model}
    if rendering is not None:
        known |= {
            "stiffness": tuple(float(k) for k in rendering.stiffness),
            "contact_radius": float(rendering.contact_radius),
            "point_radius": float(rendering.point_radius),
        }
    kept = {k: v for k, v in known.items() if getattr(given, k) == getattr(usual, k)}
    return replace(given, **kept)


def _sides(image: PlannedImage) -> dict[str, str] | None:
    """The patient's sides at the borders of a DICOM slice: left, right, top and bottom."""
    place = image.T_patient_image
    if place is None:
        return None
    letters = (("R", "L"), ("A", "P"), ("I", "S"))  # towards -x and +x of LPS, and so on

    def side(direction: np.ndarray) -> str:
        axis = int(np.abs(direction).argmax())
        return letters[axis][int(direction[axis] > 0)]

    right, down = place[:3, 0], place[:3, 1]
    return {"left": side(-right), "right": side(right), "top": side(-down), "bottom": side(down)}
