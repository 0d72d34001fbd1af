"""The engine in a browser: its WebAssembly module, and what a page hands it of a fixture.

The module is the C++ headers behind `vfplan/native/src/browser.cpp`; `make wasm` builds it.
"""

from __future__ import annotations

import base64
import gzip
import warnings
from importlib.resources import files
from typing import Any

import numpy as np

from vfplan.engine.guide import ENDS, HOLDS, Guide
from vfplan.engine.parameters import Rule, check_pieces, check_points, check_triangles
from vfplan.engine.proxy import ProxyEngine, as_rendered, best_rule, exact_shape
from vfplan.fixture import Fixture

# `Shape` of browser.cpp, and `Rule` of the header parameters.hpp, in their order.
SHAPES = ("points", "pieces", "mesh", "guide_points", "guide_pieces")
RULES = ("robust", "paper", "exact")


# A body as engine.js makes it: its `shape`, and its `arrays` of float64, packed.
Body = dict[str, Any]


def module() -> bytes:
    """The engine as WebAssembly."""
    return (files("vfplan.engine") / "engine.wasm").read_bytes()


def packed(data: bytes) -> str:
    """Bytes as a page carries them: gzip, then base64."""
    return base64.b64encode(gzip.compress(data, mtime=0)).decode("ascii")


def bodies_of(fixture: Fixture, rule: Rule | None = None) -> list[Body]:
    """What renders a fixture, as engine.js makes it: the forbidden region, then the guide.

    Each has its `shape` and three arrays of float64. The proxy is that of the first; the forces of
    both add up.

    Raises `SceneError` or `SettingError` for what no engine takes.
    """
    bodies = []
    if fixture.region is not None:
        bodies.append(_region(fixture.region, rule or best_rule(fixture.region)))
    if fixture.guidance is not None:
        bodies.append(_guide(fixture))
    return bodies


def _region(fixture: Fixture, rule: Rule) -> Body:
    p = ProxyEngine.of(fixture, rule, offline=True).parameters
    parameters = [
        RULES.index(rule), p.contact_radius, p.band, p.point_radius, p.outer_radius, p.gain,
        *p.stiffness, *_axis(p.ignore_axis), p.max_iterations, p.max_hip_step,
    ]  # fmt: skip
    if rule != "exact":
        points = check_points(as_rendered(fixture, rule).points)
        return _body("points", parameters, points, () if fixture.mesh is None else fixture.mesh)
    if exact_shape(fixture) == "curve":
        return _strokes("pieces", parameters, *check_pieces(fixture.pieces))
    return _body("mesh", parameters, *check_triangles(fixture.points, fixture.mesh))


def _guide(fixture: Fixture) -> Body:
    with warnings.catch_warnings():
        # The bend that it warns of is a finding of the plan.
        warnings.simplefilter("ignore")
        guide = Guide.of(fixture)
    parameters = [
        guide.radius, guide.stiffness, ENDS.index(guide.ends), HOLDS.index(guide.hold),
        guide.cut_bends, *_axis(guide.ignore_axis), guide.lead_force,
        guide.lead_speed, guide.period,
    ]  # fmt: skip
    if len(guide.curves) == 4:
        return _strokes("guide_pieces", parameters, *guide.curves)
    points, counts, closed = guide.curves
    stroke = np.repeat(np.arange(len(counts)), counts)
    return _strokes("guide_points", parameters, points, np.zeros(len(points)), stroke, closed)


def _axis(axis: np.ndarray | None) -> np.ndarray:
    return np.zeros(3) if axis is None else axis


def _strokes(shape: str, parameters: list[float], rows: Any, bulges: Any, stroke: Any,
             closed: Any) -> Body:  # fmt: skip
    ties = np.concatenate([np.column_stack([bulges, stroke]).ravel(), closed])
    return _body(shape, parameters, rows, ties)


def _body(shape: str, *arrays: Any) -> Body:
    data = [packed(np.asarray(array, "<f8").tobytes()) for array in arrays]
    return {"shape": SHAPES.index(shape), "arrays": data}
