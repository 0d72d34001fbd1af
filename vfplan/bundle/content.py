"""What a bundle may hold, by the format's table, and a fixture as such content, path -> value.

The table is read from `schemas/bundle-1.1.json`; writer and describer ask it, and nothing about
paths, types, shapes or units is written down a second time in Python. Values are text (`str`),
`int`, `float`, NumPy arrays, or tuples of text; a part that the fixture does not have has no path.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib import resources
from typing import Any, Literal

import numpy as np

from vfplan.errors import InputError
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
Kind = Literal["group", "dataset", "attribute"]


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
        holder, _, _ = self.path.partition("@")
        if self.kind == "attribute":
            return holder
        return holder.rpartition("/")[0] or "/"

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self.path.rpartition("@" if self.kind == "attribute" else "/")[2]


@cache
def document() -> dict[str, Any]:
    """The whole of `bundle-1.1.json`."""
    text = resources.files("vfplan.schemas").joinpath("bundle-1.1.json").read_text("utf-8")
    return json.loads(text)


@cache
def table() -> tuple[Row, ...]:
    """Everything a bundle may hold, in the order of the format."""
    lists = ("shape", "allowed")
    return tuple(
        Row(**{name: tuple(v) if name in lists else v for name, v in entry.items()})
        for entry in document()["rows"]
    )


def most(symbol: str) -> int:
    """The largest size that a symbol of the shapes stands for."""
    return document()["sizes"][symbol]["max"]


def most_bytes() -> int:
    """Of a payload."""
    return document()["limits"]["payload_bytes"]


_PARTS = {
    "curve": Curve,
    "pieces": Pieces,
    "image": SourceImage,
    "rendering": Rendering,
    "guidance": Guidance,
    "registration": RegistrationRecord,
}
_UNIT = re.compile("_(m|mm|px|n|m_s|n_per_m)$")
_OWN = {"/@frame": "frame", "/points": "points", "/sigma": "sigma", "/mesh/triangles": "mesh"}


@cache
def fields_of(part: str) -> dict[str, str]:
    """path -> field of a part: those of one name, but for the unit that either may end in."""
    names = {_UNIT.sub("", field.name): field.name for field in fields(_PARTS[part])}
    rows = [(row.path, _UNIT.sub("", row.name)) for row in table() if row.parent == f"/{part}"]
    return {path: names[name] for path, name in rows if name in names}


def to_content(fixture: Fixture) -> Content:
    """Every value that a bundle of this fixture holds, but for `format` and `version`."""
    content = _coded(fixture, _OWN)
    for part in _PARTS:
        content |= _coded(getattr(fixture, part), fields_of(part))
    if fixture.stability is not None:
        numbers = [getattr(fixture.stability, field) for field in _STABILITY]
        content["/rendering@robot"] = fixture.stability.robot
        content["/rendering/stability"] = np.array(numbers, dtype="<f8")
    return content | _provenance(fixture.provenance)


def _coded(part: Any, names: dict[str, str]) -> Content:
    """The values of a part that are there, of the types in the format's table."""
    values = {path: getattr(part, field, None) for path, field in names.items()}
    rows = {row.path: row for row in table()}
    return {path: _typed(v, rows[path]) for path, v in values.items() if v is not None}


def _typed(value: Any, row: Row) -> Any:
    if row.kind == "attribute":
        return {"f8": float, "text": str}.get(row.type, int)(value)
    if row.type == "text":
        return tuple(map(str, value))
    return np.ascontiguousarray(value, dtype=f"<{row.type}")


def from_content(content: Content) -> Fixture:
    """The fixture that a checked content describes."""
    curve = _part("curve", content)
    if curve is not None:
        curve = replace(curve, pieces=_part("pieces", content, closed=curve.closed))
    image = _part("image", content)
    if image is not None and image.pixel_spacing_mm is not None:
        image = replace(image, pixel_spacing_mm=tuple(image.pixel_spacing_mm.tolist()))
    return Fixture(
        **{field: content.get(path) for path, field in _OWN.items()},
        provenance=_to_provenance(content),
        curve=curve,
        image=image,
        rendering=_part("rendering", content),
        registration=_part("registration", content),
        stability=_to_stability(content),
        guidance=_part("guidance", content),
    )


def _part(name: str, content: Content, **more: Any) -> Any:
    """A part of the fixture; `None` where the content has none. Bytes in tables are flags."""
    paths = fields_of(name)
    if not paths.keys() & content.keys():
        return None
    values = {field: content.get(path) for path, field in paths.items()}
    flags = {f: v.astype(bool) for f, v in values.items() if getattr(v, "dtype", None) == np.uint8}
    return _PARTS[name](**values | flags | more)


# The numbers of `/rendering/stability`, in order.
_STABILITY = [field.name for field in fields(StabilityVerdict) if field.name != "robot"]


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
        raise InputError("a setting is an integer beyond 1.8e308: no bundle can hold it") from None
    raise InputError(
        f"a setting of value {value!r:.80}: text, a finite number or a boolean is wanted"
    )


def _setting(text: str) -> str | float | int | bool:
    """`true`, `false`, a JSON number, or text between double quotes, verbatim: all was checked."""
    return text[1:-1] if text.startswith('"') else json.loads(text)
