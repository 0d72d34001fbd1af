"""Everything that is wrong with a bundle, what it holds, and what differs between two.

`vfplan validate`, `info` and `diff` show it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vfplan.bundle import leak
from vfplan.bundle.content import Content, Row, findings_of, from_content, table
from vfplan.bundle.read import read_bundle
from vfplan.bundle.seal import opened_source, unsealed
from vfplan.display import Report, millimetres
from vfplan.engine.proxy import MAX_TICK_TIME, best_rule, slow_tick_text, tick_time_bound
from vfplan.errors import BundleError, SceneError, VfplanError
from vfplan.findings import acceptance
from vfplan.fixture import Fixture, size_doubt
from vfplan.io.files import FilePath

Severity = Literal["error", "warning", "note"]
UNSIGNED = "is not signed: protected against accident, not against intent. Sign it: vfplan sign"
# Relative difference of a stored certificate from a recomputed one that is rounding.
CERTIFICATE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Issue:
    """One thing found in a bundle: where, a code for programs, how grave, and a sentence."""

    location: str
    code: str
    severity: Severity
    message: str


def validate(source: FilePath | bytes) -> list[Issue]:
    """Every issue of a bundle; it is valid when none is an error.

    A file whose seal does not hold yields that one issue: its bytes are given to no parser.

    Raises
    ------
    InputError
        There is no such file.
    """
    with opened_source(source) as stream:
        try:
            sealed = unsealed(stream)
        except BundleError as error:
            return [Issue(error.where or "/", error.code, "error", error.message)]
        issues = []
        if not sealed.signed:
            issues.append(Issue("/", "seal.unsigned", "note", UNSIGNED))
        content, broken_rules = sealed.read(strict=False)
        # The certificate needs the memory.
        del sealed
    issues += [Issue(*issue) for issue in broken_rules]
    is_valid = not any(issue.severity == "error" for issue in issues)
    if is_valid:
        issues += certificate_issues(content)
        if "/rendering/stiffness" in content and (doubt := engine_doubt(from_content(content))):
            issues.append(Issue("/rendering", doubt[0], "warning", doubt[1]))
    issues += content_issues(content)
    if is_valid:
        issues += finding_issues(content)
    return issues


def finding_issues(content: Content) -> Iterator[Issue]:
    """What planning found, and whether a person has looked at it."""
    for finding in findings_of(content):
        text = finding.text
        if finding.answered_by is not None:
            text += acceptance(finding.answered_by, finding.answered_utc)
        yield Issue("/findings", finding.code, "warning" if finding.is_open else "note", text)
    if "/rendering/stiffness" in content and "/review@by" not in content:
        yield Issue(
            "/review", "review.missing", "note", "nobody has reviewed it. Look at it: vfplan review"
        )


def certificate_issues(content: Content) -> Iterator[Issue]:
    """The whole certificate computed again, with what reading leaves out for its cost."""
    if "/leak@kind" not in content:
        return
    for path, wanted in leak.certificate(content).items():
        # Reading compared the kind; of two places that leak alike, either may be stated.
        if path in ("/leak@kind", "/leak/place"):
            continue
        stated = content.get(path, np.nan)
        is_alike = np.shape(stated) == np.shape(wanted)
        if not is_alike or not np.allclose(stated, wanted, rtol=CERTIFICATE_TOLERANCE, atol=1e-12):
            text = f"is {stated}, and the fixture gives {wanted}. Write it anew"
            yield Issue(path, "corrupt.leak", "error", text)

    # What a proxy can go around, which no rule forbids.
    if content["/leak@kind"] == "cloud":
        size = content["/leak@largest_m"]
        text = (
            f"a bare cloud, nothing certified; the loneliest point is {size:.6g} m from the next. "
            "Import it as a curve or a mesh"
        )
        yield Issue("/leak", "leak.uncertified", "note", text)
    if "/leak/open_ends" in content:
        count = len(content["/leak/open_ends"])
        text = f"{count} open ends to pass around. Close the curve, or draw it longer"
        yield Issue("/leak/open_ends", "leak.open_ends", "note", text)
    if "/leak@between_m" in content:
        size = content["/leak@between_m"]
        text = (
            f"an open end is {size:.6g} m from the nearest other stroke. Join the two if nothing "
            "may pass between"
        )
        yield Issue("/leak@between_m", "leak.between", "note", text)
    if "/leak@open_edges" in content:
        count = content["/leak@open_edges"]
        text = f"an open sheet: {count} rim edges. Close the mesh if nothing may pass the rim"
        yield Issue("/leak@open_edges", "leak.open_edges", "note", text)


def engine_doubt(fixture: Fixture) -> tuple[str, str] | None:
    """(code, sentence) of a rendering outside the engine's ranges, or too slow for 1 kHz."""
    try:
        text = slow_tick_text(fixture)
    except SceneError as error:
        return "rendering.engine", error.message
    more = "Use it for replay and study, not on a robot"
    return None if text is None else ("rendering.work", f"{text}. {more}")


def opening_in_words(content: Content) -> str:
    """How far apart the parts of a certified curve or mesh, or of a bare cloud, are."""
    if not content["/leak@largest_m"]:
        return "a single point"
    size = millimetres(content["/leak@largest_m"])
    return {
        "curve": f"points at most {size} apart",
        "mesh": f"openings of at most {size}",
        "cloud": f"no point further than {size} from the next",
    }[content["/leak@kind"]]


def content_issues(content: Content) -> Iterator[Issue]:
    """What no rule of the format can see: slips of units, and settings that look like paths."""
    if content.get("/@frame") != "image" and "/points" in content:
        text = size_doubt(content["/points"])
        if text is not None:
            yield Issue("/points", "points.size", "warning", text)
    for text in content.get("/provenance/setting_values", ()):
        if text.startswith('"') and ("/" in text or "\\" in text):
            message = f"{text} looks like a path, and bundles hold none. Give another text"
            yield Issue("/provenance/setting_values", "provenance.path", "warning", message)


def describe(path: FilePath, *, work: bool = False) -> Report:
    """Head, seal, findings, and every attribute and table of a bundle by its path in the format.

    Tables with a row for each point or triangle are summed up as `shape`, `min`, `max` and the
    SHA-256 of their little-endian bytes; all others are plain. With `work`, `tick_work` bounds what
    a tick of the engine may take.

    Raises as `read_fixture` does.
    """
    content, seal = read_bundle(path)
    described = {
        "format": content["/@format"],
        "version": content["/@version"],
        "frame": content["/@frame"],
        "points": len(content["/points"]),
        "seal": seal,
        "findings": [finding.as_dict() for finding in findings_of(content)],
        "reviewed": None,
    }
    if "/review@by" in content:
        of_review = {name: content[f"/review@{name}"] for name in ("by", "utc", "digest")}
        described["reviewed"] = of_review
    if work and "/rendering/stiffness" in content:
        described["tick_work"] = tick_work(content)
    return described | {
        row.path: summary(content[row.path], row) for row in table() if row.path in content
    }


def tick_work(content: Content) -> Report:
    """The rule that renders the fixture unless another is named, and the time of its ticks.

    `us` bounds a tick and `at_most_us` is what 1 kHz gives it [us]; rule and bound are `None` where
    no engine renders the fixture.
    """
    try:
        fixture = from_content(content)
        rule = best_rule(fixture)
        time_us = 1e6 * tick_time_bound(fixture, rule)
    except VfplanError:
        rule = time_us = None
    return {"rule": rule, "us": time_us, "at_most_us": 1e6 * MAX_TICK_TIME}


def summary(value: Any, row: Row) -> Any:
    """A value as it is; of a table with a row for each point or triangle a summary."""
    if "N" not in row.shape and "K" not in row.shape:
        return list(value) if isinstance(value, tuple) else value
    data = np.ascontiguousarray(value)
    return {
        "shape": list(data.shape),
        "min": data.min().item(),
        "max": data.max().item(),
        "sha256": hashlib.sha256(data.data).hexdigest(),
    }


def diff(a: FilePath, b: FilePath) -> list[Report]:
    """Differences between the contents of two bundles, in the order of the format's table.

    Each has `path` and `what` ("only in A", "only in B", "shape" or "value"); values that differ
    are given as `a` and `b`, tables by `count`, `first_index` and, if numbers, `max_abs`.

    Raises as `read_fixture` does.
    """
    content_a, content_b = read_bundle(a)[0], read_bundle(b)[0]
    differences = []
    for path in [row.path for row in table() if row.path in content_a or row.path in content_b]:
        if path not in content_b:
            differences.append({"path": path, "what": "only in A"})
        elif path not in content_a:
            differences.append({"path": path, "what": "only in B"})
        elif difference := difference_of(content_a[path], content_b[path]):
            differences.append({"path": path, **difference})
    return differences


def difference_of(a: Any, b: Any) -> Report | None:
    """What differs between two values of one path; `None` if nothing does."""
    if isinstance(a, (str, int, float)):
        return None if a == b else {"what": "value", "a": a, "b": b}
    a, b = np.asarray(a), np.asarray(b)
    if a.shape != b.shape:
        return {"what": "shape", "a": list(a.shape), "b": list(b.shape)}
    differs = a != b
    if not differs.any():
        return None
    difference = {
        "what": "value",
        "count": int(differs.sum()),
        "first_index": np.argwhere(differs)[0].tolist(),
    }
    if a.dtype.kind != "U":
        difference["max_abs"] = float(np.max(np.abs(a.astype(float) - b.astype(float))))
    return difference
