"""A fixture as the content of a bundle, path -> value, and back.

A part that the fixture does not have has no path.

The format's table: what a bundle may hold, read from `schemas/bundle-2.0.json`.

The writer, the validator and `info` ask this table; nothing about paths, types, shapes or units is
written down a second time in Python.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vfplan.errors import InputError
from vfplan.findings import Finding
from vfplan.fixture import (
    Curve,
    Fixture,
    Guidance,
    Pieces,
    Provenance,
    RegistrationRecord,
    Rendering,
    Review,
    SourceImage,
    StabilityVerdict,
)

Content = dict[str, Any]
"""Path -> value: text (`str`), `int`, `float`, a NumPy array, or a tuple of texts."""

Kind = Literal["group", "dataset", "attribute"]
FORMAT = "vfplan-fixture"
VERSION = "2.0"
OLDER = "1.1"
"""The newest version that only `migrate` reads; its table covers those before it as well."""


@dataclass(frozen=True)
class Row:
    """One thing a bundle may hold.

    Parameters
    ----------
    path
        "/group/name", or "/group@name" for an attribute.
    kind, type, shape
        What it is; `shape` mixes numbers and the size symbols of the table.
    unit, frame
        As written in the file's own `unit` and `frame` attributes; "@frame" and "@source_frame"
        stand for the frame that attribute names (for a unit: px in "image", else m).
    required
        "always", "group" (whenever its group is there), "rendering" (whenever `/rendering` is
        there) or "optional".
    since
        The first version that has it.
    """

    path: str
    kind: Kind
    required: str
    since: str
    meaning: str
    type: str = ""
    shape: tuple[int | str, ...] = ()
    unit: str | None = None
    frame: str | None = None
    allowed: tuple[str, ...] | None = None
    min: float | None = None
    max: float | None = None
    above: float | None = None
    max_abs: dict[str, float] | None = None

    @property
    def parent(self) -> str:
        """The group that holds it."""
        if self.kind == "attribute":
            return self.path.partition("@")[0]
        parent = self.path.rpartition("/")[0]
        return "/" if parent == "" else parent

    @property
    def name(self) -> str:
        """The last part of the path."""
        separator = "@" if self.kind == "attribute" else "/"
        return self.path.rpartition(separator)[2]


@cache
def document(version: str = VERSION) -> dict[str, Any]:
    """The whole of `bundle-VERSION.json`."""
    file = Path(__file__).parents[1] / "schemas" / f"bundle-{version}.json"
    return json.loads(file.read_text("utf-8"))


@cache
def table(version: str = VERSION) -> tuple[Row, ...]:
    """Everything a bundle may hold, in the order of the format."""
    rows = []
    for entry in document(version)["rows"]:
        fields = dict(entry)
        for name in ("shape", "allowed"):
            if name in fields:
                fields[name] = tuple(fields[name])
        rows.append(Row(**fields))
    return tuple(rows)


@cache
def rows_by_path() -> dict[str, Row]:
    """Path -> its row of the table."""
    return {row.path: row for row in table()}


def max_size(symbol: str) -> int:
    """The largest size that a symbol of the shapes stands for."""
    return document()["sizes"][symbol]["max"]


def max_number(path: str) -> float:
    """The largest number that a bundle may hold at a path."""
    largest = rows_by_path()[path].max
    return math.inf if largest is None else float(largest)


def max_payload_bytes() -> int:
    """The largest payload of a bundle [bytes]."""
    return document()["limits"]["payload_bytes"]


# Where each value of a bundle lives in a `Fixture`. A test holds this list against the schema:
# a path without a field, or a field without a path, fails. `/findings`, `/provenance` and
# `/rendering/stability` are written out below, and `/@format`, `/@version`, `/@id`,
# `/@must_understand` and `/leak` are what the format computes.
FIELDS = {
    "/@frame": "frame",
    "/points": "points",
    "/sigma": "sigma",
    "/curve/stroke": "curve.stroke",
    "/curve/closed": "curve.closed",
    "/curve/bridged": "curve.bridged",
    "/curve/edited": "curve.edited",
    "/pieces/vertices": "pieces.vertices",
    "/pieces/bulges": "pieces.bulges",
    "/pieces/stroke": "pieces.stroke",
    "/pieces@error_m": "pieces.error",
    "/mesh/triangles": "mesh",
    "/mesh@sample_radius_m": "sample_radius",
    "/image@width_px": "image.width_px",
    "/image@height_px": "image.height_px",
    "/image/pixel_spacing": "image.pixel_spacing_mm",
    "/rendering/stiffness": "rendering.stiffness",
    "/rendering/ignore_axis": "rendering.ignore_axis",
    "/rendering@contact_radius_m": "rendering.contact_radius",
    "/rendering@band_m": "rendering.band",
    "/rendering@point_radius_m": "rendering.point_radius",
    "/rendering@max_iterations": "rendering.max_iterations",
    "/guidance@radius_m": "guidance.radius",
    "/guidance@stiffness_n_per_m": "guidance.stiffness",
    "/guidance@ends": "guidance.ends",
    "/guidance@lead_force_n": "guidance.lead_force",
    "/guidance@lead_speed_m_s": "guidance.lead_speed",
    "/guidance@stroke": "guidance.stroke",
    "/registration@model": "registration.model",
    "/registration@source_frame": "registration.source_frame",
    "/registration@fre_rms_m": "registration.fre_rms_m",
    "/registration@loo_rms_m": "registration.loo_rms_m",
    "/registration@tre_rms_m": "registration.tre_rms_m",
    "/registration/T_robot_image": "registration.T_robot_image",
    "/registration/labels": "registration.labels",
    "/registration/source": "registration.source",
    "/registration/target": "registration.target",
    "/registration/residuals": "registration.residuals_m",
    "/registration/covariance": "registration.covariance",
    "/registration/tre": "registration.tre_m",
    "/review@by": "reviewed.by",
    "/review@utc": "reviewed.utc",
    "/review@digest": "reviewed.digest",
}
"""Path in the bundle -> field of the fixture."""

STABILITY_FIELDS = (
    "mass_kg",
    "damping_n_s_per_m",
    "rate_hz",
    "delay_ticks",
    "k_n_per_m",
    "k_max_n_per_m",
    "margin",
)
"""Fields of a `StabilityVerdict` in the order of `/rendering/stability`."""

PARTS = {
    "curve": Curve,
    "pieces": Pieces,
    "image": SourceImage,
    "rendering": Rendering,
    "guidance": Guidance,
    "registration": RegistrationRecord,
    "reviewed": Review,
}
"""The parts of a fixture that `FIELDS` names in front of a point, and their types."""


def to_content(fixture: Fixture) -> Content:
    """Every value that a bundle of this fixture holds, but for those that the format computes."""
    rows = rows_by_path()
    content: Content = {}
    for path, field in FIELDS.items():
        value = value_of_field(fixture, field)
        if value is None:
            continue
        row = rows[path]
        if row.kind == "dataset" and row.type == "text":
            content[path] = tuple(map(str, value))
        elif row.kind == "dataset":
            content[path] = np.ascontiguousarray(value, dtype=f"<{row.type}")
        elif row.type == "text":
            content[path] = str(value)
        elif row.type == "f8":
            content[path] = float(value)
        else:
            content[path] = int(value)
    if fixture.stability is not None:
        numbers = [getattr(fixture.stability, name) for name in STABILITY_FIELDS]
        content["/rendering@robot"] = fixture.stability.robot
        content["/rendering/stability"] = np.array(numbers, dtype="<f8")
    put_findings(content, fixture.findings)
    put_provenance(content, fixture.provenance)
    return content


def value_of_field(fixture: Fixture, field: str) -> Any:
    """The value of "part.field" or "field"; `None` where the fixture has none."""
    value: Any = fixture
    for name in field.split("."):
        if value is None:
            return None
        value = getattr(value, name)
    return value


def put_findings(content: Content, findings: tuple[Finding, ...]) -> None:
    """Add the group `/findings` to a content; nothing where nothing was found."""
    if not findings:
        return
    for name in ("code", "severity", "text", "stage"):
        content[f"/findings/{name}"] = tuple(getattr(finding, name) for finding in findings)
    for name, no_place in (("place_px", (0.0, 0.0)), ("place_m", (0.0, 0.0, 0.0))):
        has_place = np.zeros(len(findings), dtype="<u1")
        places = np.zeros((len(findings), len(no_place)), dtype="<f8")
        for i, finding in enumerate(findings):
            place = getattr(finding, name)
            if place is not None:
                has_place[i] = 1
                places[i] = place
        if has_place.any():
            content[f"/findings/has_{name}"] = has_place
            content[f"/findings/{name}"] = places
    if any(finding.answered_by is not None for finding in findings):
        for name in ("answered_by", "answered_utc"):
            answers = [getattr(finding, name) or "" for finding in findings]
            content[f"/findings/{name}"] = tuple(answers)


def put_provenance(content: Content, provenance: Provenance) -> None:
    """Add the group `/provenance` to a content."""
    content["/provenance@created_utc"] = provenance.created_utc
    content["/provenance@software"] = provenance.software
    if provenance.inputs:
        content["/provenance/input_roles"] = tuple(provenance.inputs)
        content["/provenance/input_sha256"] = tuple(provenance.inputs.values())
    if provenance.settings:
        values = [setting_text(value) for value in provenance.settings.values()]
        content["/provenance/setting_names"] = tuple(provenance.settings)
        content["/provenance/setting_values"] = tuple(values)
    if provenance.history:
        content["/provenance/history"] = tuple(provenance.history)


def setting_text(value: Any) -> str:
    """A setting as a bundle holds it: `true`, `false`, a JSON number, or text between quotes."""
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, np.generic):
        value = value.item()
    try:
        if isinstance(value, (bool, int, float)) and math.isfinite(value):
            return json.dumps(value)
    except OverflowError:
        raise InputError(
            "A setting is an integer beyond 1.8e308, which no bundle can hold. Give it as text."
        ) from None
    raise InputError(
        f"A setting has the value {value!r:.80}. Give text, a finite number or a boolean."
    )


def from_content(content: Content) -> Fixture:
    """The fixture that a checked content describes."""
    parts: dict[str, dict[str, Any]] = {}
    for path, field in FIELDS.items():
        if path not in content:
            continue
        value = content[path]
        if isinstance(value, np.ndarray) and value.dtype == np.uint8:
            value = value.astype(bool)
        # A field of the fixture itself has no part in front: its part is "".
        part, _, name = field.rpartition(".")
        parts.setdefault(part, {})[name] = value
    values = parts.pop("")
    pieces = parts.pop("pieces", None)
    for name, part_values in parts.items():
        values[name] = PARTS[name](**part_values)
    if pieces is not None:
        curve = values["curve"]
        values["curve"] = replace(curve, pieces=Pieces(closed=curve.closed, **pieces))
    if "image" in values and values["image"].pixel_spacing_mm is not None:
        spacing = tuple(values["image"].pixel_spacing_mm.tolist())
        values["image"] = replace(values["image"], pixel_spacing_mm=spacing)
    return Fixture(
        **values,
        provenance=provenance_of(content),
        stability=stability_of(content),
        findings=findings_of(content),
    )


def stability_of(content: Content) -> StabilityVerdict | None:
    """The verdict of the stability gate; `None` where there is none."""
    if "/rendering@robot" not in content or "/rendering/stability" not in content:
        return None
    numbers = dict(zip(STABILITY_FIELDS, content["/rendering/stability"].tolist(), strict=True))
    numbers["delay_ticks"] = round(numbers["delay_ticks"])
    return StabilityVerdict(content["/rendering@robot"], **numbers)


def findings_of(content: Content) -> tuple[Finding, ...]:
    """What a checked content says that a person should look at."""
    findings = []
    for i in range(len(content.get("/findings/code", ()))):
        fields: dict[str, Any] = {}
        for name in ("code", "severity", "text", "stage"):
            fields[name] = content[f"/findings/{name}"][i]
        for name in ("place_px", "place_m"):
            if f"/findings/{name}" in content and content[f"/findings/has_{name}"][i]:
                fields[name] = tuple(content[f"/findings/{name}"][i].tolist())
        for name in ("answered_by", "answered_utc"):
            if f"/findings/{name}" in content:
                fields[name] = content[f"/findings/{name}"][i] or None
        findings.append(Finding(**fields))
    return tuple(findings)


def provenance_of(content: Content) -> Provenance:
    """Where the bundle came from."""
    roles = content.get("/provenance/input_roles", ())
    digests = content.get("/provenance/input_sha256", ())
    settings = {}
    for name, text in zip(
        content.get("/provenance/setting_names", ()),
        content.get("/provenance/setting_values", ()),
        strict=True,
    ):
        if text.startswith('"'):
            settings[name] = text[1:-1]
        else:
            settings[name] = json.loads(text)
    return Provenance(
        created_utc=content["/provenance@created_utc"],
        software=content["/provenance@software"],
        inputs=dict(zip(roles, digests, strict=True)),
        settings=settings,
        history=tuple(content.get("/provenance/history", ())),
    )
