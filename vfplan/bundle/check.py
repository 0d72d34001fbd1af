"""Rules that tie several values of a bundle together; the numbers are those of docs/format.md.

Each rule reports to `Findings`; a rule whose values are missing has been reported already and says
nothing. native/include/vfplan/hdf5/rules.hpp holds the same rules for controllers.
"""

from __future__ import annotations

import hashlib
import re
from typing import Any

import numpy as np

from vfplan.bundle import leak
from vfplan.bundle.content import Content, setting
from vfplan.bundle.findings import Findings
from vfplan.bundle.table import Table
from vfplan.errors import CorruptError

UTC_TIME = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z")
SHA256 = re.compile(r"[0-9a-f]{64}")
NAME = re.compile(r"[A-Za-z0-9_.-]+")
UNIT_TOLERANCE = 1e-9
SAME = 1e-9  # relative agreement of a stored certificate with a recomputed one


def object_id(content: Content) -> str:
    """The id of a bundle's geometry: equal for equal points in the same frame."""
    digest = hashlib.sha256(content["/@frame"].encode() + b"\0")
    digest.update(np.ascontiguousarray(content["/points"], dtype="<f8").data)
    return digest.hexdigest()[:32]


def check(content: Content, table: Table, findings: Findings) -> None:
    """Apply every rule, in the order of docs/format.md."""
    for rule in (
        _understood, _groups, _frames, _identity, _curve, _mesh, _rendering, _registration,
        _provenance, _leak,
    ):  # fmt: skip
        if table.version == "0.1" and rule in (_identity, _leak):
            continue
        if rule is _leak and not findings.valid:
            findings.note("leak.unchecked", "/leak", "not checked, because of the errors above")
            continue
        try:
            rule(content, findings)
        except KeyError:
            continue  # the value is missing or wrong, and has been reported


def _has(content: Content, group: str) -> bool:
    return any(path.startswith((group + "/", group + "@")) for path in content)


def _understood(content: Content, findings: Findings) -> None:
    from vfplan.bundle.table import table

    known = {row.path for row in table().rows}
    for path in content.get("/@must_understand", "").split(" "):
        if path and path not in known:
            findings.error(
                "version.must_understand", path, "must be understood, and this program does not"
            )


def _groups(content: Content, findings: Findings) -> None:
    frame = content["/@frame"]
    for group, frames in (
        ("/image", ("image", "robot_base")),
        ("/rendering", ("robot_base", "patient_lps")),
        ("/registration", ("robot_base",)),
        ("/mesh", ("robot_base", "patient_lps")),
    ):
        if _has(content, group) and frame not in frames:
            findings.error("corrupt.group", group, f"must not be in the frame {frame!r}")
    if _has(content, "/mesh") and _has(content, "/curve"):
        findings.error("corrupt.group", "/mesh", "must not stand beside /curve")


def _frames(content: Content, findings: Findings) -> None:
    if content["/@frame"] == "image" and np.any(content["/points"][:, 2] != 0):
        findings.error("corrupt.value", "/points", "third column must be 0 in the frame image")


def _identity(content: Content, findings: Findings) -> None:
    wanted = object_id(content)
    if content["/@id"] != wanted:
        findings.error("corrupt.id", "/@id", f"is {content['/@id']!r}; the points give {wanted!r}")


def _curve(content: Content, findings: Findings) -> None:
    stroke = content["/curve/stroke"]
    same, next_ = stroke[1:] == stroke[:-1], stroke[1:] == stroke[:-1] + 1
    if stroke[0] != 0 or not np.all(same | next_):
        findings.error("corrupt.value", "/curve/stroke", "must count 0, 1, ... along the points")
    elif stroke[-1] + 1 != len(content["/curve/closed"]):
        findings.error(
            "corrupt.shape",
            "/curve/closed",
            f"has {len(content['/curve/closed'])} strokes; the points have {stroke[-1] + 1}",
        )


def _mesh(content: Content, findings: Findings) -> None:
    highest, count = int(content["/mesh/triangles"].max()), len(content["/points"])
    if highest >= count:
        findings.error("corrupt.value", "/mesh/triangles", f"names point {highest} of {count}")


def _rendering(content: Content, findings: Findings) -> None:
    axis = content.get("/rendering/ignore_axis")
    if axis is not None:
        length = float(np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2))
        if abs(length - 1) > UNIT_TOLERANCE:
            findings.error(
                "corrupt.value", "/rendering/ignore_axis", f"has length {length}; 1 wanted"
            )
    radius = content["/rendering@contact_radius_m"] + content["/rendering@point_radius_m"]
    if content["/rendering@band_m"] >= radius:
        findings.error("corrupt.value", "/rendering@band_m", f"must be less than R = {radius} m")


def _registration(content: Content, findings: Findings) -> None:
    from_image = content["/registration@source_frame"] == "image"
    T, source = content["/registration/T_robot_image"], content["/registration/source"]
    if len(T) != (3 if from_image else 4) or source.shape[1] != (2 if from_image else 3):
        findings.error(
            "corrupt.shape",
            "/registration",
            f"T_robot_image is {T.shape} and source {source.shape}; (3, 3) and (M, 2) from the"
            " frame image, else (4, 4) and (M, 3)",
        )
    elif not from_image and np.any(T[3] != (0, 0, 0, 1)):
        findings.error("corrupt.value", "/registration/T_robot_image", "last row must be 0 0 0 1")
    if np.any(np.diag(content.get("/registration/covariance", np.zeros((1, 1)))) < 0):
        findings.error("corrupt.value", "/registration/covariance", "has a negative variance")
    _unique(content["/registration/labels"], "/registration/labels", findings)


def _unique(names: tuple[str, ...], path: str, findings: Findings) -> None:
    if len(set(names)) != len(names) or "" in names:
        findings.error("corrupt.value", path, "must be different from each other and not empty")


def _provenance(content: Content, findings: Findings) -> None:
    if not UTC_TIME.fullmatch(content["/provenance@created_utc"]):
        findings.error(
            "corrupt.value",
            "/provenance@created_utc",
            f"is {content['/provenance@created_utc']!r}; YYYY-MM-DDThh:mm:ssZ wanted",
        )
    for one, other in (("input_roles", "input_sha256"), ("setting_names", "setting_values")):
        names = content.get(f"/provenance/{one}")
        if (names is None) != (content.get(f"/provenance/{other}") is None):
            findings.error("corrupt.missing", "/provenance", f"{one} and {other} need each other")
        _unique(names or (), f"/provenance/{one}", findings)
        if not all(NAME.fullmatch(name) for name in names or ()):
            findings.error(
                "corrupt.value", f"/provenance/{one}", "may hold letters, digits, '_', '.', '-'"
            )
    for digest in content.get("/provenance/input_sha256", ()):
        if not SHA256.fullmatch(digest):
            findings.error("corrupt.value", "/provenance/input_sha256", f"holds {digest!r}")
    for text in content.get("/provenance/setting_values", ()):
        try:
            setting(text)
        except CorruptError as error:
            findings.error("corrupt.value", "/provenance/setting_values", error.message)


def _leak(content: Content, findings: Findings) -> None:
    if _has(content, "/rendering") != _has(content, "/leak"):
        findings.error("corrupt.leak", "/leak", "must be there if and only if /rendering is")
    kind = leak.kind_of(content)
    if content["/leak@kind"] != kind:
        found = content["/leak@kind"]
        findings.error("corrupt.leak", "/leak@kind", f"is {found!r}; {kind!r} wanted")
        return
    _compare(content, "/leak@limit_m", leak.limit_of(content, kind), findings)
    if kind == "cloud":
        certified = 0
    else:
        points = leak.Across(content)
        if kind == "curve":
            largest = leak.largest_gap(content, points)[0]
        else:
            largest = leak.largest_cover(content["/mesh/triangles"], points)[0]
        _compare(content, "/leak@largest_m", largest, findings)
        certified = int(content["/leak@largest_m"] <= content["/leak@limit_m"])
        if not certified:
            findings.error("unsafe.leak", "/leak", leaking(content))
    if content["/leak@certified"] != certified:
        found = content["/leak@certified"]
        findings.error("corrupt.leak", "/leak@certified", f"is {found}; {certified} wanted")


def leaking(content: Content) -> str:
    """The sentence about a fixture that its own proxy can pass through."""
    place = ", ".join(f"{x:.6g}" for x in content["/leak/place"])
    what = {"curve": "gap between neighbours", "mesh": "covering radius of a triangle"}
    return (
        f"the fixture leaks between samples: {what[content['/leak@kind']]} of"
        f" {content['/leak@largest_m']:.6g} m at ({place}); at most"
        f" {content['/leak@limit_m']:.6g} m holds the proxy back"
    )


def _compare(content: Content, path: str, wanted: float | None, findings: Findings) -> None:
    found: Any = content.get(path)
    if (found is None) != (wanted is None) or (
        wanted is not None and abs(found - wanted) > SAME * max(abs(wanted), 1e-3)
    ):
        findings.error("corrupt.leak", path, f"is {found}; the fixture gives {wanted}")
