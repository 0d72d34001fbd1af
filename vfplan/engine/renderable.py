"""Whether an engine takes what a bundle holds, and how long its ticks may take.

The format allows any radius above 0, a stiffness of 0, any band below R; float64 serves a narrower
range (docs/engine.md). A bundle outside it is sound, and no robot renders it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.engine.parameters import ProxyParameters, Rule, Vector, check_points
from vfplan.errors import SceneError, SettingError
from vfplan.findings import Finding, doubt, note
from vfplan.fixture import Fixture, Pieces


def check_renderable(fixture: Fixture) -> ProxyParameters:
    """What rule "robust" renders a fixture with; refuses one outside the engine's ranges.

    Raises
    ------
    SceneError
        No rendering, or one that the robust rule's engine refuses; the message has the value and
        what is allowed.
    """
    if fixture.rendering is None:
        raise SceneError("no rendering parameters: `vfplan register` makes a fixture of a curve")
    try:
        return ProxyParameters.make(
            fixture.points,
            contact_radius=fixture.contact_radius,
            band=fixture.band,
            point_radius=fixture.point_radius,
            stiffness=fixture.stiffness,
            ignore_axis=fixture.ignore_axis,
        )
    except SettingError as error:
        raise SceneError(f"no engine renders it: {error.message}") from error


def exact_of(fixture: Fixture) -> Literal["curve", "mesh"] | None:
    """What rule "exact" renders: lines and arcs across an axis, triangles in space, or nothing."""
    if fixture.rendering is None or fixture.region is None:
        return None
    if fixture.ignore_axis is not None:
        return "curve" if fixture.region.pieces else None
    return "mesh" if fixture.mesh is not None and fixture.guidance is None else None


def best_rule(fixture: Fixture) -> Rule:
    """The rule nearest to the truth, of what is forbidden; "robust" where all strokes guide.

    "exact" where lines and arcs across an axis are known, and for a mesh whose triangles are few
    enough around any place for 1 kHz: the controller's own choice (`vfplan::by_triangles`).

    Raises `SceneError` for a mesh that no engine takes.
    """
    if exact_of(fixture) != "mesh":
        return "exact" if exact_of(fixture) else "robust"
    native = check_renderable(fixture).native(None)
    triangles = check_triangles(fixture.points, fixture.mesh)
    return "exact" if _core.by_triangles(*triangles, native) else "robust"


def sampled(fixture: Fixture) -> Fixture:
    """A mesh with the samples that rules "robust" and "paper" render, and edits number.

    The corners keep their numbers, and samples of the triangles follow them until no place of a
    triangle is farther than `sample_radius` from one. The triangles between the samples replace
    those of the mesh, so that the certificate of what comes back is that of its samples. A fixture
    that asks for no samples comes back as it is.

    Raises `SceneError` for more samples than a bundle may hold.
    """
    if fixture.mesh is None or fixture.sample_radius is None:
        return fixture
    corners, triangles = check_triangles(fixture.points, fixture.mesh)
    try:
        samples, pieces = _core.sampled(corners, triangles, fixture.sample_radius)
    except ValueError as error:
        raise SceneError(str(error).removeprefix("vfplan: ")) from None
    registration = fixture.registration
    if registration is not None:
        registration = replace(registration, tre_m=None)  # of the corners alone
    return replace(
        fixture,
        points=samples,
        mesh=pieces,
        sigma=None,
        registration=registration,
        sample_radius=None,
    )


def as_rendered(fixture: Fixture, rule: Rule) -> Fixture:
    """The fixture whose points a rule renders: of a mesh its samples, unless rule "exact" does."""
    if rule == "exact":
        return fixture
    return sampled(fixture)


def check_triangles(points: ArrayLike, triangles: ArrayLike) -> tuple[Vector, NDArray[np.int32]]:
    """Points (N, 3) and triangles (K, 3) of them as the engine takes them.

    Raises `SceneError` for shapes that do not fit, and for rows that are not there.
    """
    points, rows = check_points(points), np.asarray(triangles)
    if rows.ndim != 2 or rows.shape[1:] != (3,) or not len(rows) or rows.dtype.kind not in "iu":
        raise SceneError(f"triangles {rows.shape} {rows.dtype}: allowed are (K, 3) rows of points")
    if rows.min() < 0 or rows.max() >= len(points):
        least, most = rows.min(), rows.max()
        raise SceneError(f"triangles of points {least} to {most}: there are 0 to {len(points) - 1}")
    return points, np.ascontiguousarray(rows, dtype=np.int32)


def check_pieces(pieces: Pieces) -> tuple[Vector, Vector, NDArray[np.int32], NDArray[np.uint8]]:
    """Vertices (V, 3), bulges (V,), strokes (V,) and closed (S,) as the engine takes them.

    Raises
    ------
    SceneError
        Shapes that do not fit, a bulge beyond a half circle, strokes that are not 0, 1, ... in
        order.
    """
    vertices = check_points(pieces.vertices)
    bulges = np.array(pieces.bulges, np.float64)
    stroke, closed = np.asarray(pieces.stroke), np.asarray(pieces.closed)
    if bulges.shape != (len(vertices),) or stroke.shape != (len(vertices),):
        found = f"{bulges.shape} bulges and {stroke.shape} strokes"
        raise SceneError(f"{found}: allowed is one of each for {len(vertices)} vertices")
    most = float(np.abs(bulges).max())
    if not most <= 1:  # also where it is no number
        raise SceneError(f"bulge {most:g}: allowed is up to 1, a half circle")
    steps = np.diff(stroke)
    ends = stroke[:1].tolist(), stroke[-1:].tolist()
    if ends != ([0], [len(closed) - 1]) or not np.all((steps == 0) | (steps == 1)):
        raise SceneError(f"strokes of vertices: allowed are 0 to {len(closed) - 1}, in order")
    return vertices, bulges, stroke.astype(np.int32), closed.astype(np.uint8)


MAX_BAND_SHARE = 0.01
"""Largest band of a cloud that says nothing, in R. A wider one shows that the points are rough or
far apart: the proxy may sink by that much without a word."""


def mesh_findings(fixture: Fixture) -> list[Finding]:
    """What a person should know of a cloud or mesh before a robot renders it.

    Raises `SceneError` for a rendering that no engine takes.

    Returns
    -------
    list of Finding
        `mesh-coarse`: facets that are felt, because the body they stand for would be more than
        R / 20 from them. `band-wide`: a band above 1 % of R where points are rendered.
    """
    if fixture.rendering is None:
        return []
    findings = []
    radius = fixture.contact_radius + fixture.point_radius
    rule = best_rule(fixture)
    if rule == "exact" and exact_of(fixture) == "mesh":
        native = check_renderable(fixture).native(None)
        triangles = check_triangles(fixture.points, fixture.mesh)
        count, sagitta = _core.coarse_facets(*triangles, native)
        if count:
            text = (
                f"The mesh has {count} facets that are too coarse to be smoothed: the body they "
                f"stand for is up to {1e3 * sagitta:.3g} mm away from them, and at most "
                f"{50 * radius:.3g} mm (R / 20) can be smoothed. The tool will feel their edges. "
                "Import a finer mesh."
            )
            findings.append(doubt("mesh-coarse", "import", text))
    if rule == "robust" and fixture.band > MAX_BAND_SHARE * radius:
        text = (
            f"The band is {1e3 * fixture.band:.3g} mm, {100 * fixture.band / radius:.2g} % of R: "
            "the points are rough or far apart, and the tool may sink by that much. Import denser "
            "or smoother points."
        )
        findings.append(note("band-wide", "import", text))
    return findings


MOST_TICK_WORK = _core.most_tick_work  # [s] that a loop of 1 kHz gives a tick


def work_of(fixture: Fixture, rule: Rule | None = None) -> float:
    """Time [s] that a tick takes at most: 2.5 times the worst that a search over the fixture finds.

    Of the best rule unless one is given. The C++ header tick_time.hpp computes it from what it
    counts, with the times of the machine of docs/engine.md, so it is the same everywhere.

    Raises `SceneError` for a rendering that no engine takes.
    """
    native = check_renderable(fixture).native(fixture.max_iterations)
    if (rule or best_rule(fixture)) == "exact":
        if exact_of(fixture) == "mesh":
            return _core.tick_work(*check_triangles(fixture.points, fixture.mesh), native)
        return _core.tick_work(*check_pieces(fixture.region.pieces), native)
    return _core.tick_work(check_points(sampled(fixture).points), native)


def work_doubt(fixture: Fixture, rule: Rule | None = None) -> str | None:
    """Why a loop of 1 kHz cannot wait for a fixture's ticks; `None` where it can."""
    work = work_of(fixture, rule)
    if work <= MOST_TICK_WORK:
        return None
    return (
        f"a tick may take {1e6 * work:.0f} us, at most {1e6 * MOST_TICK_WORK:.0f} us are given"
        " at 1 kHz: too many points or pieces around one place, or max_iterations too high"
    )


def check_editing(points: NDArray[np.float64], native: _core.Parameters, real_time: bool) -> None:
    """Refuse to edit a cloud whose ticks are short enough for a loop only thinned."""
    if real_time and _core.tick_work(points, native) > MOST_TICK_WORK:
        raise SceneError("edit: so dense a cloud is thinned, and cannot be edited at 1 kHz")
