"""What the engine's probes share: something to stand on, and how to tell that the proxy left it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.arcs import plane, strokes_of
from vfplan.engine.checks import Vector, check_axis
from vfplan.engine.parameters import ProxyParameters, Trace
from vfplan.engine.proxy import ProxyEngine
from vfplan.engine.renderable import best_rule, exact_of
from vfplan.fixture import Fixture, Pieces
from vfplan.replaying.clearance import MeshClearance
from vfplan.stability import contacts


@dataclass(frozen=True, eq=False)
class Ground:
    """A cloud, a place where the proxy touches it, and the way off it."""

    points: Vector  # (N, 3) [m]
    # (3,) the proxy's place as it touches [m], and the unit vector away from the cloud
    touch: Vector
    out: Vector
    settings: dict[str, Any] = field(default_factory=dict)  # the engine's
    # The points are the vertices of these lines and arcs, or of triangles (K, 3), and the engine
    # renders them
    exact: Pieces | NDArray[np.int32] | None = None

    def engine(self, **more: Any) -> ProxyEngine:
        """An engine whose proxy starts 0.2 R off the touch."""
        if self.exact is None:
            engine = ProxyEngine(self.points, **self.settings | more)
        elif isinstance(self.exact, Pieces):
            engine = ProxyEngine.along(replace(self.exact, vertices=self.points), **self.settings)
        else:
            engine = ProxyEngine.on(self.points, self.exact, **self.settings)
        engine.reset(self.start(engine))
        return engine

    def start(self, engine: ProxyEngine) -> Vector:
        """(3,) 0.2 R off the touch [m]."""
        return self.touch + 0.2 * engine.parameters.R * self.out

    @property
    def side(self) -> Vector:
        """(3,) a unit vector along the surface, across an ignored axis."""
        axis = check_axis(self.settings.get("ignore_axis"))
        if axis is None:
            axis = np.eye(3)[int(np.argmin(np.abs(self.out)))]
        along = np.cross(self.out, axis)
        return along / np.linalg.norm(along)


def patch() -> Ground:
    """The small flat sheet, R = 5 mm."""
    contact = contacts.patch()
    return Ground(contact.points, contact.touch, contact.normals[0])


def of_fixture(fixture: Fixture) -> Ground | None:
    """The first place of a bundle that a ball can touch; `None` when there is none."""
    for contact in contacts.along(fixture, 3):
        settings = {
            "contact_radius": fixture.contact_radius,
            "point_radius": fixture.point_radius,
            "stiffness": fixture.stiffness,
        }
        way, across = (contact.touch, contact.normals[0]), {"ignore_axis": fixture.ignore_axis}
        kind = exact_of(fixture) if best_rule(fixture) == "exact" else None
        if kind == "curve":
            return Ground(fixture.pieces.vertices, *way, settings | across, fixture.pieces)
        if kind == "mesh":
            return Ground(fixture.points, *way, settings, fixture.mesh)
        return Ground(fixture.points, *way, settings | across | {"band": fixture.band})
    return None


def walk_path(ground: Ground, engine: ProxyEngine, ticks: int, seed: int = 7) -> Vector:
    """(T, 3) a random HIP path around the touch, up to 2 R into the cloud and off it [m]."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, ticks)[:, None]
    wave = np.zeros((ticks, 3))
    for k in range(1, 12):
        phase = rng.uniform(0, 2 * np.pi, 3)
        wave += rng.normal(size=3) / k * np.sin(2 * np.pi * k * s + phase)
    lead = np.minimum(1.0, 20 * s)  # leaves the free start smoothly
    R = engine.parameters.R
    return ground.start(engine) + lead * R * (0.8 * wave - 0.7 * ground.out)


def breach(engine: ProxyEngine, ground: Ground, trace: Trace) -> float:
    """How far the proxy came inside R - band of the ground, at most over the ticks [m].

    0 where it never did; infinite where an answer is not finite, or where the path never touched
    and so showed nothing.
    """
    answers = (trace.proxy, trace.normal, trace.force)
    if not (all(np.isfinite(a).all() for a in answers) and trace.force.any()):
        return float("inf")
    p = engine.parameters
    return max(0.0, -p.band - _clearance(ground, trace.proxy, p))


def _clearance(ground: Ground, proxy: Vector, p: ProxyParameters) -> float:
    """Least distance from what is rendered less R, across the axis [m]; with no engine's code."""
    if isinstance(ground.exact, Pieces):
        frame = plane(p.ignore_axis)
        strokes = strokes_of(replace(ground.exact, vertices=ground.points), frame)
        return float(np.min([stroke.distance(proxy @ frame.T) for stroke in strokes]) - p.R)
    if ground.exact is not None:
        clearance = MeshClearance(ground.points, ground.exact, p.R)
        clearance.update(proxy)
        return clearance.minimum_m
    from scipy.spatial import cKDTree

    axis = p.ignore_axis
    across = np.eye(3) - (0 if axis is None else np.outer(axis, axis))
    return float(cKDTree(ground.points @ across).query(proxy @ across)[0].min() - p.R)


def walked(ground: Ground, ticks: int = 3000, **settings: Any) -> float:
    """The breach over a random walk."""
    engine = ground.engine(**settings)
    trace = engine.run(walk_path(ground, engine, ticks))
    return breach(engine, ground, trace)


def moved(ground: Ground, offset: Vector, scale: float) -> Ground:
    """The ground scaled about the origin, then shifted; R is scaled by the caller's settings."""
    return replace(
        ground, points=scale * ground.points + offset, touch=scale * ground.touch + offset
    )
