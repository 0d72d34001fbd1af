"""A fixture as the flat content of a bundle, path -> value, and back.

Values are text (`str`), `int`, `float`, NumPy arrays, or tuples of text; a part that the fixture
does not have has no path.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np

from vfplan.bundle.format import Row, table
from vfplan.errors import CorruptError, InputError
from vfplan.fixture import (
    Curve,
    Fixture,
    Guidance,
    Pieces,
    Provenance,
    RegistrationRecord,
    Rendering,
    SourceImage,
    StabilityVerdict,
)

Content = dict[str, Any]
NUMBER = re.compile(r"-?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)?")


# part -> {path: field}; the first path is there if and only if the part is.
_PARTS: dict[str, dict[str, str]] = {
    "curve": {
        "/curve/stroke": "stroke",
        "/curve/closed": "closed",
        "/curve/bridged": "bridged",
    },
    "pieces": {
        "/pieces/vertices": "vertices",
        "/pieces/bulges": "bulges",
        "/pieces/stroke": "stroke",
        "/pieces@error_m": "error",
    },
    "image": {
        "/image@width_px": "width_px",
        "/image@height_px": "height_px",
        "/image/pixel_spacing": "pixel_spacing_mm",
    },
    "rendering": {
        "/rendering/stiffness": "stiffness",
        "/rendering@contact_radius_m": "contact_radius",
        "/rendering@band_m": "band",
        "/rendering@point_radius_m": "point_radius",
        "/rendering/ignore_axis": "ignore_axis",
        "/rendering@max_iterations": "max_iterations",
    },
    "guidance": {
        "/guidance@radius_m": "radius",
        "/guidance@stiffness_n_per_m": "stiffness",
        "/guidance@ends": "ends",
        "/guidance@lead_force_n": "lead_force",
        "/guidance@lead_speed_m_s": "lead_speed",
        "/guidance@stroke": "stroke",
    },
    "registration": {
        "/registration@model": "model",
        "/registration@source_frame": "source_frame",
        "/registration@fre_rms_m": "fre_rms_m",
        "/registration@loo_rms_m": "loo_rms_m",
        "/registration@tre_rms_m": "tre_rms_m",
        "/registration/T_robot_image": "T_robot_image",
        "/registration/labels": "labels",
        "/registration/source": "source",
        "/registration/target": "target",
        "/registration/residuals": "residuals_m",
        "/registration/covariance": "covariance",
        "/registration/tre": "tre_m",
    },
}
_OWN = {"/@frame": "frame", "/points": "points", "/sigma": "sigma", "/mesh/triangles": "mesh"}


def to_content(fixture: Fixture) -> Content:
    """Every value that a bundle of this fixture holds, but for `format` and `version`."""
    content = _coded(fixture, _OWN)
    for name, fields in _PARTS.items():
        content |= _coded(getattr(fixture, name), fields)
    if fixture.stability is not None:
        numbers = [getattr(fixture.stability, field) for field in _STABILITY]
        content["/rendering@robot"] = fixture.stability.robot
        content["/rendering/stability"] = np.array(numbers, dtype="<f8")
    return content | _provenance(fixture.provenance)


def _coded(part: Any, fields: dict[str, str]) -> Content:
    """The values of a part that are there, of the types in the format's table."""
    values = {path: getattr(part, field, None) for path, field in fields.items()}
    rows = {row.path: row for row in table().rows}
    return {path: _typed(v, rows[path]) for path, v in values.items() if v is not None}


def _typed(value: Any, row: Row) -> Any:
    if row.kind == "attribute":
        return {"f8": float, "text": str}.get(row.type, int)(value)
    if row.type == "text":
        return tuple(map(str, value))
    return np.ascontiguousarray(value, dtype=f"<{row.type}")


def from_content(content: Content) -> Fixture:
    """The fixture that a checked content describes."""
    curve = _part(Curve, "curve", content)
    if curve is not None:
        curve = replace(curve, pieces=_part(Pieces, "pieces", content, closed=curve.closed))
    image = _part(SourceImage, "image", content)
    if image is not None and image.pixel_spacing_mm is not None:
        image = replace(image, pixel_spacing_mm=tuple(image.pixel_spacing_mm.tolist()))
    return Fixture(
        **{field: content.get(path) for path, field in _OWN.items()},
        provenance=_to_provenance(content),
        curve=curve,
        image=image,
        rendering=_part(Rendering, "rendering", content),
        registration=_part(RegistrationRecord, "registration", content),
        stability=_to_stability(content),
        guidance=_part(Guidance, "guidance", content),
    )


def _part(kind: type, name: str, content: Content, **more: Any) -> Any:
    """A part of the fixture; `None` where the content has none. Bytes in tables are flags."""
    fields = _PARTS[name]
    if next(iter(fields)) not in content:
        return None
    values = {field: content.get(path) for path, field in fields.items()}
    flags = {f: v.astype(bool) for f, v in values.items() if getattr(v, "dtype", None) == np.uint8}
    return kind(**values | flags | more)


# The numbers of `/rendering/stability`, in order.
_STABILITY = (
    "mass_kg",
    "damping_n_s_per_m",
    "rate_hz",
    "delay_ticks",
    "k_n_per_m",
    "k_max_n_per_m",
    "margin",
)


def _to_stability(content: Content) -> StabilityVerdict | None:
    if not {"/rendering@robot", "/rendering/stability"} <= content.keys():
        return None
    numbers = dict(zip(_STABILITY, content["/rendering/stability"].tolist(), strict=True))
    numbers["delay_ticks"] = round(numbers["delay_ticks"])
    return StabilityVerdict(content["/rendering@robot"], **numbers)


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
        settings={n: setting(v) for n, v in zip(names, values, strict=True)},
        history=tuple(content.get("/provenance/history", ())),
    )


def _written(value: Any) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)) and np.isfinite(value):
        return repr(float(value))
    if isinstance(value, str):
        return f'"{value}"'
    raise InputError(f"a setting of value {value!r}; text, a finite number or a boolean is wanted")


def setting(text: str) -> str | float | int | bool:
    """The value of a setting as it is written in a bundle.

    `true`, `false`, a JSON number, or text between double quotes, verbatim.
    """
    if text in ("true", "false"):
        return text == "true"
    if len(text) >= 2 and text[0] == text[-1] == '"':
        return text[1:-1]
    match = NUMBER.fullmatch(text)
    if match is None or not math.isfinite(float(text)):
        raise CorruptError(f"{text!r} is not a setting's value", where="/provenance/setting_values")
    return float(text) if match[2] or match[3] else int(text)
