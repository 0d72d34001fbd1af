"""A fixture as the content of a bundle, path -> value, and back.

A part that the fixture does not have has no path.
"""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from typing import Any

import numpy as np

from vfplan.bundle.schema import Content, Row, rows_by_path
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

_STABILITY = [field.name for field in fields(StabilityVerdict) if field.name != "robot"]
"""The numbers of `/rendering/stability`, in order."""

_PARTS = {
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
    content: Content = {}
    for path, field in FIELDS.items():
        value = _value_at(fixture, field)
        if value is not None:
            content[path] = _as_typed(value, rows_by_path()[path])
    if fixture.stability is not None:
        numbers = [getattr(fixture.stability, field) for field in _STABILITY]
        content["/rendering@robot"] = fixture.stability.robot
        content["/rendering/stability"] = np.array(numbers, dtype="<f8")
    return content | _findings_content(fixture.findings) | _provenance(fixture.provenance)


def _value_at(fixture: Fixture, field: str) -> Any:
    """The value of "part.field" or "field"; `None` where the fixture has none."""
    value: Any = fixture
    for name in field.split("."):
        if value is None:
            return None
        value = getattr(value, name)
    return value


def _as_typed(value: Any, row: Row) -> Any:
    """A value of the type in its row of the format's table."""
    if row.kind == "attribute":
        kinds = {"f8": float, "text": str}
        return kinds.get(row.type, int)(value)
    if row.type == "text":
        return tuple(map(str, value))
    return np.ascontiguousarray(value, dtype=f"<{row.type}")


def from_content(content: Content) -> Fixture:
    """The fixture that a checked content describes."""
    own: dict[str, Any] = {}
    parts: dict[str, dict[str, Any]] = {name: {} for name in _PARTS}
    for path, field in FIELDS.items():
        if path not in content:
            continue
        value = _as_field(content[path])
        part, _, name = field.rpartition(".")
        if part:
            parts[part][name] = value
        else:
            own[name] = value
    pieces = parts.pop("pieces")
    made = {name: _PARTS[name](**values) for name, values in parts.items() if values}
    if pieces:
        curve = made["curve"]
        made["curve"] = replace(curve, pieces=Pieces(closed=curve.closed, **pieces))
    if "image" in made and made["image"].pixel_spacing_mm is not None:
        spacing = tuple(made["image"].pixel_spacing_mm.tolist())
        made["image"] = replace(made["image"], pixel_spacing_mm=spacing)
    return Fixture(
        **own,
        **made,
        provenance=_to_provenance(content),
        stability=_to_stability(content),
        findings=findings_of(content),
    )


def _as_field(value: Any) -> Any:
    """A value as a fixture has it: bytes in tables are flags."""
    if isinstance(value, np.ndarray) and value.dtype == np.uint8:
        return value.astype(bool)
    return value


def _to_stability(content: Content) -> StabilityVerdict | None:
    if not {"/rendering@robot", "/rendering/stability"} <= content.keys():
        return None
    numbers = dict(zip(_STABILITY, content["/rendering/stability"].tolist(), strict=True))
    numbers["delay_ticks"] = round(numbers["delay_ticks"])
    return StabilityVerdict(content["/rendering@robot"], **numbers)


def _findings_content(findings: tuple[Finding, ...]) -> Content:
    """The group `/findings`; nothing where nothing was found."""
    if not findings:
        return {}
    content: Content = {
        "/findings/code": tuple(finding.code for finding in findings),
        "/findings/severity": tuple(finding.severity for finding in findings),
        "/findings/text": tuple(finding.text for finding in findings),
        "/findings/stage": tuple(finding.stage for finding in findings),
    }
    for name, columns in (("place_px", 2), ("place_m", 3)):
        places = [getattr(finding, name) for finding in findings]
        has_place = np.array([place is not None for place in places])
        if has_place.any():
            zeros = (0.0,) * columns
            rows = [zeros if place is None else place for place in places]
            content[f"/findings/has_{name}"] = has_place.astype("<u1")
            content[f"/findings/{name}"] = np.array(rows, dtype="<f8")
    if any(finding.answered_by is not None for finding in findings):
        content["/findings/answered_by"] = tuple(f.answered_by or "" for f in findings)
        content["/findings/answered_utc"] = tuple(f.answered_utc or "" for f in findings)
    return content


def findings_of(content: Content) -> tuple[Finding, ...]:
    """What a checked content says that a person should look at."""
    findings = []
    for i, code in enumerate(content.get("/findings/code", ())):
        places: dict[str, Any] = {}
        for name in ("place_px", "place_m"):
            if f"/findings/{name}" in content and content[f"/findings/has_{name}"][i]:
                places[name] = tuple(content[f"/findings/{name}"][i].tolist())
        answered = {}
        for name in ("answered_by", "answered_utc"):
            if f"/findings/{name}" in content:
                answered[name] = content[f"/findings/{name}"][i] or None
        findings.append(
            Finding(
                code,
                content["/findings/severity"][i],
                content["/findings/text"][i],
                content["/findings/stage"][i],
                **places,
                **answered,
            )
        )
    return tuple(findings)


def _provenance(provenance: Provenance) -> Content:
    content: Content = {
        "/provenance@created_utc": provenance.created_utc,
        "/provenance@software": provenance.software,
    }
    if provenance.inputs:
        content["/provenance/input_roles"] = tuple(provenance.inputs)
        content["/provenance/input_sha256"] = tuple(provenance.inputs.values())
    if provenance.settings:
        content["/provenance/setting_names"] = tuple(provenance.settings)
        content["/provenance/setting_values"] = tuple(map(_written, provenance.settings.values()))
    if provenance.history:
        content["/provenance/history"] = tuple(provenance.history)
    return content


def _to_provenance(content: Content) -> Provenance:
    names = content.get("/provenance/setting_names", ())
    values = content.get("/provenance/setting_values", ())
    roles = content.get("/provenance/input_roles", ())
    hashes = content.get("/provenance/input_sha256", ())
    return Provenance(
        created_utc=content["/provenance@created_utc"],
        software=content["/provenance@software"],
        inputs=dict(zip(roles, hashes, strict=True)),
        settings={n: _setting(v) for n, v in zip(names, values, strict=True)},
        history=tuple(content.get("/provenance/history", ())),
    )


def _written(value: Any) -> str:
    """A setting as a bundle holds it."""
    if isinstance(value, str):
        return f'"{value}"'
    plain = value.item() if isinstance(value, np.generic) else value
    try:
        if isinstance(plain, (bool, int, float)) and math.isfinite(plain):
            return json.dumps(plain)
    except OverflowError:
        raise InputError("a setting is an integer beyond 1.8e308: no bundle can hold it.") from None
    raise InputError(
        f"a setting of value {value!r:.80}: text, a finite number or a boolean is wanted."
    )


def _setting(text: str) -> str | float | int | bool:
    """`true`, `false`, a JSON number, or text between double quotes, verbatim: all was checked."""
    return text[1:-1] if text.startswith('"') else json.loads(text)
