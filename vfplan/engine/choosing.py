"""Which rule renders a fixture, and whether its ticks are short enough for 1 kHz.

The format allows any radius above 0, a stiffness of 0, and any band below R. float64 serves a
narrower range (docs/engine.md). A bundle outside that range is sound, but no robot renders it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.engine.parameters import ProxyParameters, Rule, Vector, check_points, core_errors
from vfplan.errors import SceneError, SettingError
from vfplan.findings import Finding, doubt, note
from vfplan.fixture import Fixture, Pieces

MAX_TICK_TIME = _core.most_tick_work
"""Longest tick that a loop of 1 kHz can wait for [s]."""

MAX_BAND_SHARE = 0.01
"""Largest band of a cloud that is no finding, as a share of R.

A wider band shows that the points are rough or far apart. The tool may sink by that much.
"""


def check_renderable(fixture: Fixture) -> ProxyParameters:
    """The parameters with which rule "robust" renders a fixture.

    Raises
    ------
    SceneError
        A fixture without rendering parameters, or with some that are outside the engine's ranges.
        The message has the value and the range.
    """
    if fixture.rendering is None:
        raise SceneError(
            "the bundle has no rendering parameters. `vfplan register` makes a fixture of a curve."
        )
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
        raise SceneError(f"no engine renders it: {error.message}", numbers=error.numbers) from error


def exact_shape(fixture: Fixture) -> Literal["curve", "mesh"] | None:
    """What rule "exact" renders: lines and arcs across an axis, triangles in space, or nothing."""
    if fixture.rendering is None or fixture.region is None:
        return None
    if fixture.ignore_axis is not None:
        return "curve" if fixture.region.pieces else None
    return "mesh" if fixture.mesh is not None and fixture.guidance is None else None


def best_rule(fixture: Fixture) -> Rule:
    """The rule that comes nearest to what is forbidden; "robust" where all strokes guide.

    It is "exact" where lines and arcs across an axis are known. It is also "exact" for a mesh that
    has so few triangles around any place that a tick fits into 1 kHz. The controller chooses in the
    same way (`vfplan::by_triangles`).

    Raises `SceneError` for a mesh that no engine takes.
    """
    shape = exact_shape(fixture)
    if shape is None:
        return "robust"
    if shape == "curve":
        return "exact"
    native = check_renderable(fixture).native()
    points, triangles = check_triangles(fixture.points, fixture.mesh)
    return "exact" if _core.by_triangles(points, triangles, native) else "robust"


def sampled(fixture: Fixture) -> Fixture:
    """A mesh with the samples that rules "robust" and "paper" render, and that edits number.

    The corners keep their numbers. Samples of the triangles follow them until no place of a
    triangle is farther than `sample_radius` from one. The triangles between the samples replace
    those of the mesh, so that the certificate of the result is that of its samples. A fixture that
    asks for no samples comes back as it is.

    Raises `SceneError` for more samples than a bundle may hold.
    """
    if fixture.mesh is None or fixture.sample_radius is None:
        return fixture
    corners, triangles = check_triangles(fixture.points, fixture.mesh)
    with core_errors(SceneError):
        samples, sample_triangles = _core.sampled(corners, triangles, fixture.sample_radius)
    registration = fixture.registration
    if registration is not None:
        # The errors are those of the corners alone.
        registration = replace(registration, tre_m=None)
    return replace(
        fixture,
        points=samples,
        mesh=sample_triangles,
        sigma=None,
        registration=registration,
        sample_radius=None,
    )


def as_rendered(fixture: Fixture, rule: Rule) -> Fixture:
    """The fixture whose points a rule renders: of a mesh its samples, unless rule "exact" does."""
    return fixture if rule == "exact" else sampled(fixture)


def check_triangles(points: ArrayLike, triangles: ArrayLike) -> tuple[Vector, NDArray[np.int32]]:
    """Points (N, 3) [m] and triangles (K, 3), rows of points, as the engine takes them.

    Raises `SceneError` for shapes that do not fit, and for rows that are not there.
    """
    points = check_points(points)
    rows = np.asarray(triangles)
    if rows.ndim != 2 or rows.shape[1] != 3 or len(rows) == 0 or rows.dtype.kind not in "iu":
        raise SceneError(
            f"triangles has shape {rows.shape} and type {rows.dtype}. Give three numbers of points "
            "a row: (K, 3) integers."
        )
    if rows.min() < 0 or rows.max() >= len(points):
        raise SceneError(
            f"triangles name points {rows.min()} to {rows.max()}. The cloud has points 0 to "
            f"{len(points) - 1}: give numbers of these."
        )
    return points, np.ascontiguousarray(rows, dtype=np.int32)


def check_pieces(pieces: Pieces) -> tuple[Vector, Vector, NDArray[np.int32], NDArray[np.uint8]]:
    """Vertices (V, 3) [m], bulges (V,), strokes (V,) and closed (S,) as the engine takes them.

    Raises
    ------
    SceneError
        Shapes that do not fit, a bulge beyond a half circle, or strokes that are not numbered 0, 1,
        ... in order.
    """
    vertices = check_points(pieces.vertices)
    count = len(vertices)
    bulges = np.array(pieces.bulges, np.float64)
    stroke = np.asarray(pieces.stroke)
    closed = np.asarray(pieces.closed)
    if bulges.shape != (count,) or stroke.shape != (count,):
        raise SceneError(
            f"bulges has shape {bulges.shape} and stroke {stroke.shape}. Give one of each for the "
            f"{count} vertices."
        )
    largest = float(np.abs(bulges).max())
    if not largest <= 1:  # NaN is refused too.
        raise SceneError(
            f"a bulge is {largest:g}. Give bulges of at most 1, which is a half circle.",
            numbers={"bulge": largest},
        )
    steps = np.diff(stroke)
    is_ordered = np.all((steps == 0) | (steps == 1))
    if not is_ordered or stroke[0] != 0 or stroke[-1] != len(closed) - 1:
        raise SceneError(
            f"strokes of vertices are not in order. Number them from 0 to {len(closed) - 1}."
        )
    return vertices, bulges, stroke.astype(np.int32), closed.astype(np.uint8)


def mesh_findings(fixture: Fixture) -> list[Finding]:
    """What a person should know of a cloud or mesh before a robot renders it.

    Raises `SceneError` for a rendering that no engine takes.

    Returns
    -------
    list of Finding
        `mesh-coarse`: facets that are felt, because the body for which they stand would be more
        than R / 20 away from them. `band-wide`: a band above `MAX_BAND_SHARE` where points are
        rendered.
    """
    if fixture.rendering is None:
        return []
    findings = []
    radius = fixture.contact_radius + fixture.point_radius
    rule = best_rule(fixture)
    if rule == "exact" and exact_shape(fixture) == "mesh":
        native = check_renderable(fixture).native()
        points, triangles = check_triangles(fixture.points, fixture.mesh)
        count, sagitta = _core.coarse_facets(points, triangles, native)
        if count > 0:
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


def worst_tick_time(fixture: Fixture, rule: Rule | None = None) -> float:
    """The longest time that a tick may take [s], with the best rule unless one is given.

    It is 3 us and 2.2 times the worst that a search over the fixture finds, but no more than what
    follows from counts (`tick_time_bound` in the C++ header tick_time.hpp, docs/engine.md). The
    search counts what a tick does and does not time it, so the result is the same everywhere.

    Raises `SceneError` for a rendering that no engine takes.
    """
    native = check_renderable(fixture).native(fixture.max_iterations)
    if rule is None:
        rule = best_rule(fixture)
    if rule != "exact":
        return _core.tick_work(check_points(sampled(fixture).points), native)
    if exact_shape(fixture) == "mesh":
        return _core.tick_work(*check_triangles(fixture.points, fixture.mesh), native)
    return _core.tick_work(*check_pieces(fixture.region.pieces), native)


def slow_tick_text(fixture: Fixture, rule: Rule | None = None) -> str | None:
    """Why a loop of 1 kHz cannot wait for a fixture's ticks; `None` where it can."""
    seconds = worst_tick_time(fixture, rule)
    if seconds <= MAX_TICK_TIME:
        return None
    return (
        f"a tick may take {1e6 * seconds:.0f} us, and at most {1e6 * MAX_TICK_TIME:.0f} us are "
        "given at 1 kHz: too many points or pieces around one place, or max_iterations too high. "
        "Give fewer points there, or a smaller max_iterations."
    )
