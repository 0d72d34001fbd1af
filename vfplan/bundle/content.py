"""What a bundle may hold, by the format's table, and a fixture as such a content and back.

The table is `schemas/bundle-2.0.json`. The writer, the validator and `info` ask it; nothing about
paths, types, shapes or units is written down a second time in Python.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import struct
from collections.abc import Collection
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vfplan.errors import InputError
from vfplan.findings import Finding, Findings
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

# Path -> value: text (`str`), `int`, `float`, a NumPy array, or a tuple of texts.
Content = dict[str, Any]

FORMAT = "vfplan-fixture"
VERSION = "2.0"
# Frame of the points -> their unit.
UNITS_OF_FRAME = {"image": "px", "robot_base": "m", "patient_lps": "m"}


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
    mark
        "rendered" by an engine, or "reviewed" beside that: the review digest covers both.
    form, unique
        What each text must be, and whether all of them differ and none is empty.
    needs
        The path of a value without which this one must not be there, and the other way round.
    frames
        In which frames of the points it may be there.
    """

    path: str
    kind: Literal["group", "dataset", "attribute"]
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
    mark: Literal["rendered", "reviewed"] | None = None
    form: str = ""
    needs: str = ""
    frames: tuple[str, ...] = ()
    unique: bool = False

    @property
    def parent(self) -> str:
        """The group that holds it."""
        return self.path[: -len(self.name) - 1] or "/"

    @property
    def name(self) -> str:
        """The last part of the path."""
        return re.split("[/@]", self.path)[-1]


@cache
def document() -> dict[str, Any]:
    """The whole of `bundle-2.0.json`."""
    file = Path(__file__).parents[1] / "schemas" / f"bundle-{VERSION}.json"
    return json.loads(file.read_text("utf-8"))


@cache
def table() -> tuple[Row, ...]:
    """Everything a bundle may hold, in the order of the format."""
    tuples = {"shape", "allowed", "frames"}
    return tuple(
        Row(**{name: tuple(value) if name in tuples else value for name, value in entry.items()})
        for entry in document()["rows"]
    )


@cache
def rows_by_path() -> dict[str, Row]:
    """Path -> its row of the table."""
    return {row.path: row for row in table()}


def rows_of(content: Content) -> list[Row]:
    """The rows of what a bundle of this content holds, its groups among them, but not the root."""
    groups = {rows_by_path()[path].parent for path in content} - {"/"}
    return [row for row in table() if row.path in content or row.path in groups]


def max_size(symbol: str) -> int:
    """The largest size that a symbol of the shapes stands for."""
    return document()["sizes"][symbol]["max"]


def max_number(path: str) -> float:
    """The largest number that a bundle may hold at a path."""
    largest = rows_by_path()[path].max
    return math.inf if largest is None else float(largest)


# The fields of a fixture that are not named as their paths are. `PARTS` has the types of its parts.
RENAMED = {
    "/pieces@error_m": "pieces.error",
    "/mesh/triangles": "mesh",
    "/mesh@sample_radius_m": "sample_radius",
    "/image/pixel_spacing": "image.pixel_spacing_mm",
    "/rendering@contact_radius_m": "rendering.contact_radius",
    "/rendering@band_m": "rendering.band",
    "/rendering@point_radius_m": "rendering.point_radius",
    "/guidance@radius_m": "guidance.radius",
    "/guidance@stiffness_n_per_m": "guidance.stiffness",
    "/guidance@lead_force_n": "guidance.lead_force",
    "/guidance@lead_speed_m_s": "guidance.lead_speed",
    "/registration/residuals": "registration.residuals_m",
    "/registration/tre": "registration.tre_m",
    "/review@by": "reviewed.by",
    "/review@utc": "reviewed.utc",
    "/review@digest": "reviewed.digest",
}

# What the format computes, and what is written out below.
NO_FIELDS = (
    *("/@format", "/@version", "/@id", "/@must_understand", "/leak", "/findings"),
    *("/provenance/input", "/provenance/setting", "/rendering@robot", "/rendering/stability"),
)

# Path in the bundle -> field of the fixture. A test holds it against the classes of a fixture.
FIELDS = {
    row.path: RENAMED.get(row.path, re.sub("[/@]", ".", row.path).strip("."))
    for row in table()
    if row.kind != "group" and not row.path.startswith(NO_FIELDS)
}

# Fields of a `StabilityVerdict` in the order of `/rendering/stability`.
STABILITY_FIELDS = tuple(field.name for field in fields(StabilityVerdict) if field.name != "robot")

# The parts of a fixture that `FIELDS` names in front of a point, and their types.
PARTS = {
    "curve": Curve, "pieces": Pieces, "image": SourceImage, "rendering": Rendering,
    "guidance": Guidance, "registration": RegistrationRecord, "reviewed": Review,
    "provenance": Provenance,
}  # fmt: skip


# --- Fixture -> content -------------------------------------------------------------------------


def to_content(fixture: Fixture) -> Content:
    """Every value that a bundle of this fixture holds, but for those that the format computes."""
    content = {}
    for path, field in FIELDS.items():
        value = fixture
        for name in field.split("."):
            # A part that the fixture does not have has no path.
            value = getattr(value, name, None)
        is_empty = isinstance(value, tuple) and not value
        if value is not None and not is_empty:
            content[path] = as_content(value, rows_by_path()[path])
    if fixture.stability is not None:
        numbers = [getattr(fixture.stability, name) for name in STABILITY_FIELDS]
        content["/rendering@robot"] = fixture.stability.robot
        content["/rendering/stability"] = np.array(numbers, dtype="<f8")
    if fixture.findings:
        content |= content_of_findings(fixture.findings)
    inputs, settings = fixture.provenance.inputs, fixture.provenance.settings
    if inputs:
        content["/provenance/input_roles"] = tuple(inputs)
        content["/provenance/input_sha256"] = tuple(inputs.values())
    if settings:
        content["/provenance/setting_names"] = tuple(settings)
        content["/provenance/setting_values"] = tuple(map(setting_text, settings.values()))
    return content


def as_content(value: Any, row: Row) -> Any:
    """A value as a content holds it in this row."""
    if row.kind == "dataset":
        is_text = row.type == "text"
        return tuple(map(str, value)) if is_text else np.ascontiguousarray(value, f"<{row.type}")
    types = {"text": str, "f8": float}
    return types.get(row.type, int)(value)


def content_of_findings(findings: Findings) -> Content:
    """The group `/findings`."""
    content = {
        f"/findings/{name}": tuple(getattr(finding, name) for finding in findings)
        for name in FINDING_TEXTS
    }
    for name, size in (("place_px", 2), ("place_m", 3)):
        places = [getattr(finding, name) for finding in findings]
        if any(places):
            has_place = [place is not None for place in places]
            content[f"/findings/has_{name}"] = np.array(has_place, dtype="<u1")
            content[f"/findings/{name}"] = np.array([p or size * (0.0,) for p in places], "<f8")
    if any(finding.answered_by is not None for finding in findings):
        for name in ("answered_by", "answered_utc"):
            answers = tuple(getattr(finding, name) or "" for finding in findings)
            content[f"/findings/{name}"] = answers
    return content


FINDING_TEXTS = ("code", "severity", "text", "stage")


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


# --- What a review covers -----------------------------------------------------------------------


def review_digest(fixture: Fixture) -> str:
    """The digest that a review of this fixture holds (docs/format.md, section 3).

    It covers all that is rendered, the registration, the findings with their answers, and the case.
    """
    content = to_content(fixture)
    marked = {path for path in content if rows_by_path()[path].mark is not None}
    return digest_of_content("vfplan review 1", content, marked)


def digest_of_content(title: str, content: Content, paths: Collection[str]) -> str:
    """SHA-256 of some values of a bundle, each with its path, type and shape, under a title."""
    digest = hashlib.sha256(counted(title) + geometry_digest(content))
    for path in sorted(paths):
        row, value = rows_by_path()[path], content[path]
        shape = np.shape(value)
        digest.update(counted(path) + counted(row.type))
        digest.update(struct.pack(f"<{1 + len(shape)}Q", len(shape), *shape))
        if row.type == "text":
            for text in (value,) if isinstance(value, str) else value:
                digest.update(counted(text))
        elif path not in GEOMETRY:
            digest.update(np.ascontiguousarray(value, f"<{row.type}").data)
    return digest.hexdigest()


# What `/@id` is the digest of, behind the frame.
GEOMETRY = ("/points", "/mesh/triangles", "/pieces/vertices", "/pieces/bulges", "/pieces/stroke")


def geometry_digest(content: Content) -> bytes:
    """SHA-256 of the geometry: equal for equal points in the same frame."""
    digest = hashlib.sha256(content["/@frame"].encode() + b"\0")
    for path in GEOMETRY:
        if path in content:
            digest.update(np.ascontiguousarray(content[path]).data)
    return digest.digest()


def counted(text: str) -> bytes:
    """A text in UTF-8, with its length in front of it."""
    data = text.encode()
    return struct.pack("<Q", len(data)) + data


def rendered_values(fixture: Fixture) -> Content:
    """Everything that an engine renders of a fixture, by its path, and its `kind`."""
    content = to_content(fixture)
    values = {path: content[path] for path in content if rows_by_path()[path].mark == "rendered"}
    return {"kind": "wall" if fixture.guidance is None else "guide", **values}


# --- Content -> fixture -------------------------------------------------------------------------


def from_content(content: Content) -> Fixture:
    """The fixture that a checked content describes."""
    parts = {}
    for path, field in FIELDS.items():
        if path in content:
            value = content[path]
            is_truth = isinstance(value, np.ndarray) and value.dtype == np.uint8
            # A field of the fixture itself has no part in front: its part is "".
            part, _, name = field.rpartition(".")
            parts.setdefault(part, {})[name] = value.astype(bool) if is_truth else value
    if "pieces" in parts:
        parts["pieces"]["closed"] = parts["curve"]["closed"]
        parts["curve"]["pieces"] = Pieces(**parts.pop("pieces"))
    image = parts.get("image", {})
    if "pixel_spacing_mm" in image:
        image["pixel_spacing_mm"] = tuple(image["pixel_spacing_mm"].tolist())
    values = parts.pop("")
    if "/rendering@robot" in content:
        numbers = dict(zip(STABILITY_FIELDS, content["/rendering/stability"].tolist(), strict=True))
        numbers["delay_ticks"] = round(numbers["delay_ticks"])
        values["stability"] = StabilityVerdict(content["/rendering@robot"], **numbers)
    roles, digests, names, texts = (
        content.get(f"/provenance/{name}", ())
        for name in ("input_roles", "input_sha256", "setting_names", "setting_values")
    )
    parts["provenance"]["inputs"] = dict(zip(roles, digests, strict=True))
    parts["provenance"]["settings"] = dict(zip(names, map(setting_of, texts), strict=True))
    parts = {name: PARTS[name](**part) for name, part in parts.items()}
    return Fixture(**values, **parts, findings=findings_of(content))


def findings_of(content: Content) -> Findings:
    """What a checked content says that a person should look at."""
    findings = []
    for i in range(len(content.get("/findings/code", ()))):
        values = {name: content[f"/findings/{name}"][i] for name in FINDING_TEXTS}
        for name in ("place_px", "place_m"):
            if f"/findings/{name}" in content and content[f"/findings/has_{name}"][i]:
                values[name] = tuple(content[f"/findings/{name}"][i].tolist())
        for name in ("answered_by", "answered_utc"):
            if f"/findings/{name}" in content:
                values[name] = content[f"/findings/{name}"][i] or None
        findings.append(Finding(**values))
    return tuple(findings)


def setting_of(text: str) -> Any:
    """The setting that a bundle holds as this text."""
    return text[1:-1] if text.startswith('"') else json.loads(text)
