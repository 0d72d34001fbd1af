"""A fixture as the flat content of a bundle, path -> value, and back.

Values are text (`str`), `int`, `float`, NumPy arrays, or tuples of text; a part that the fixture
does not have has no path.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

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


def to_content(fixture: Fixture) -> Content:
    """Every value that a bundle of this fixture holds, but for `format` and `version`."""
    content: Content = {"/@frame": fixture.frame, "/points": _f8(fixture.points)}
    if fixture.sigma is not None:
        content["/sigma"] = _f8(fixture.sigma)
    if fixture.curve is not None:
        content |= _curve(fixture.curve)
    if fixture.mesh is not None:
        content["/mesh/triangles"] = np.ascontiguousarray(fixture.mesh, dtype="<i4")
    if fixture.image is not None:
        content |= _image(fixture.image)
    if fixture.rendering is not None:
        content |= _rendering(fixture.rendering)
    if fixture.guidance is not None:
        content |= _present({p: getattr(fixture.guidance, f) for p, f in _GUIDANCE})
    if fixture.registration is not None:
        content |= _registration(fixture.registration)
    if fixture.stability is not None:
        content |= _stability(fixture.stability)
    return content | _provenance(fixture.provenance)


def from_content(content: Content) -> Fixture:
    """The fixture that a checked content describes."""
    return Fixture(
        frame=content["/@frame"],
        points=content["/points"],
        provenance=_to_provenance(content),
        sigma=content.get("/sigma"),
        curve=_to_curve(content) if "/curve/stroke" in content else None,
        image=_to_image(content) if "/image@width_px" in content else None,
        rendering=_to_rendering(content) if "/rendering/stiffness" in content else None,
        registration=_to_registration(content) if "/registration@model" in content else None,
        stability=_to_stability(content),
        mesh=content.get("/mesh/triangles"),
        guidance=Guidance(**{field: content.get(path) for path, field in _GUIDANCE})
        if "/guidance@radius_m" in content
        else None,
    )


def _f8(values: Any) -> np.ndarray:
    return np.ascontiguousarray(values, dtype="<f8")


def _present(content: Content) -> Content:
    return {path: value for path, value in content.items() if value is not None}


def _curve(curve: Curve) -> Content:
    content = {
        "/curve/stroke": np.ascontiguousarray(curve.stroke, dtype="<i4"),
        "/curve/closed": np.ascontiguousarray(curve.closed, dtype="u1"),
    }
    if curve.bridged is not None:
        content["/curve/bridged"] = np.ascontiguousarray(curve.bridged, dtype="u1")
    if curve.pieces is not None:
        content["/pieces/vertices"] = _f8(curve.pieces.vertices)
        content["/pieces/bulges"] = _f8(curve.pieces.bulges)
        content["/pieces/stroke"] = np.ascontiguousarray(curve.pieces.stroke, dtype="<i4")
        content["/pieces@error_m"] = float(curve.pieces.error)
    return content


def _to_curve(content: Content) -> Curve:
    bridged = content.get("/curve/bridged")
    closed = content["/curve/closed"].astype(bool)
    pieces = None
    if "/pieces/vertices" in content:
        fields = (content[f"/pieces/{name}"] for name in ("vertices", "bulges", "stroke"))
        pieces = Pieces(*fields, closed, content["/pieces@error_m"])
    return Curve(
        stroke=content["/curve/stroke"],
        closed=closed,
        bridged=None if bridged is None else bridged.astype(bool),
        pieces=pieces,
    )


def _image(image: SourceImage) -> Content:
    content: Content = {
        "/image@width_px": int(image.width_px),
        "/image@height_px": int(image.height_px),
    }
    if image.pixel_spacing_mm is not None:
        content["/image/pixel_spacing"] = _f8(image.pixel_spacing_mm)
    return content


def _to_image(content: Content) -> SourceImage:
    spacing = content.get("/image/pixel_spacing")
    return SourceImage(
        width_px=content["/image@width_px"],
        height_px=content["/image@height_px"],
        pixel_spacing_mm=None if spacing is None else (float(spacing[0]), float(spacing[1])),
    )


def _rendering(rendering: Rendering) -> Content:
    content: Content = {
        "/rendering/stiffness": _f8(rendering.stiffness),
        "/rendering@contact_radius_m": float(rendering.contact_radius),
        "/rendering@band_m": float(rendering.band),
        "/rendering@point_radius_m": float(rendering.point_radius),
    }
    if rendering.ignore_axis is not None:
        content["/rendering/ignore_axis"] = _f8(rendering.ignore_axis)
    if rendering.max_iterations is not None:
        content["/rendering@max_iterations"] = int(rendering.max_iterations)
    return content


def _to_rendering(content: Content) -> Rendering:
    return Rendering(
        stiffness=content["/rendering/stiffness"],
        contact_radius=content["/rendering@contact_radius_m"],
        band=content["/rendering@band_m"],
        point_radius=content["/rendering@point_radius_m"],
        ignore_axis=content.get("/rendering/ignore_axis"),
        max_iterations=content.get("/rendering@max_iterations"),
    )


# (path, field) of the guidance
_GUIDANCE = (
    ("/guidance@radius_m", "radius"),
    ("/guidance@stiffness_n_per_m", "stiffness"),
    ("/guidance@ends", "ends"),
    ("/guidance@lead_force_n", "lead_force"),
    ("/guidance@lead_speed_m_s", "lead_speed"),
    ("/guidance@stroke", "stroke"),
)

# (path, field) of the registration's plain values
_REGISTRATION = (
    ("/registration@model", "model"),
    ("/registration@source_frame", "source_frame"),
    ("/registration@fre_rms_m", "fre_rms_m"),
    ("/registration@loo_rms_m", "loo_rms_m"),
    ("/registration@tre_rms_m", "tre_rms_m"),
    ("/registration/T_robot_image", "T_robot_image"),
    ("/registration/labels", "labels"),
    ("/registration/source", "source"),
    ("/registration/target", "target"),
    ("/registration/residuals", "residuals_m"),
    ("/registration/covariance", "covariance"),
    ("/registration/tre", "tre_m"),
)


def _registration(record: RegistrationRecord) -> Content:
    content: Content = {path: getattr(record, field) for path, field in _REGISTRATION}
    for path, value in content.items():
        if value is None:
            continue
        if path.endswith("_m"):
            content[path] = float(value)
        elif path == "/registration/labels":
            content[path] = tuple(str(label) for label in value)
        elif "@" not in path:
            content[path] = _f8(value)
    return _present(content)


def _to_registration(content: Content) -> RegistrationRecord:
    return RegistrationRecord(**{field: content.get(path) for path, field in _REGISTRATION})


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


def _stability(verdict: StabilityVerdict) -> Content:
    numbers = [getattr(verdict, field) for field in _STABILITY]
    return {"/rendering@robot": verdict.robot, "/rendering/stability": _f8(numbers)}


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
