"""Stage proxy: engines x spacing on scenes whose exact proxy is known.

Error: distance of the rendered from the exact proxy, tick by tick [m]. Beside it stand

force_rms_n
    RMS of |rendered - true force| over the same HIP path: the RMS force error of Ruffaldi, Morris
    et al., "Standardized evaluation of haptic rendering systems" (2006).
surface_error_m
    How far the proxy stands from the planned surface, either way, in contact; what a tolerance is
    about. `inside_m` is the part of it that counts: nearer to the exact geometry than R.
    `meets_tolerance` says whether neither exceeds the tolerance of a plan.

Each scene has a HIP path and its exact proxy, computed once. Two are triangle meshes: a ball, whose
surface bends, and a box, which has edges and corners. Their exact proxy is known in closed form.
Rule "exact" is given the triangles; any other rule is given the corners of the mesh refined to the
spacing.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib.resources import as_file, files
from itertools import product
from typing import Any, ClassVar

import numpy as np
from scipy.spatial import ConvexHull

from vfplan.bench.peers import Mesh, Peer
from vfplan.bench.record import (
    TOLERANCE_M,
    Array,
    BenchRun,
    Record,
    Scenes,
    Settings,
    errors_of,
    timed_ticks,
)
from vfplan.engine.parameters import ProxyParameters
from vfplan.engine.proxy import ProxyEngine
from vfplan.fixture import Pieces
from vfplan.geometry.lines import row_lengths
from vfplan.planning.settings import DEFAULT_ARCS_M
from vfplan.planning.tolerance import SPEED_M_S, Choice, choose
from vfplan.registration.models import homogeneous
from vfplan.scenes import SCENES, Drawn, Scene, Sheet, Sphere, Walls
from vfplan.scenes.outline import Run, in_space, polyline
from vfplan.stability.contacts import RADIUS as R
from vfplan.stability.study import DEFAULT_STIFFNESS
from vfplan.vectors.curve import FINE_M

# Into how many stretches each edge of an octahedron is cut: 5000 triangles on a ball of 30 mm.
FACE_CUTS = 25


class Meshed(Scene):
    """A scene of triangles: `mesh` is its corners (N, 3) [m] and triangles (K, 3)."""

    @cached_property
    def points(self) -> Array:
        """The corners of the mesh, refined until no edge is longer than the spacing [m]."""
        from vfplan.bundle.importing import refined

        return refined(*self.mesh, self.spacing)[0]


def convex_mesh(corners: Array) -> Mesh:
    """The corners (N, 3) of a convex body around the origin, and its triangles (K, 3)."""
    triangles = ConvexHull(corners).simplices.astype(np.int32)
    one, two, three = np.moveaxis(corners[triangles], 1, 0)
    is_inward = (np.cross(two - one, three - one) * one).sum(axis=1) < 0
    triangles[is_inward] = triangles[is_inward, ::-1]
    return corners, triangles


class BallMesh(Meshed, Sphere):
    """A ball of 30 mm as triangles of about 2 mm."""

    @cached_property
    def mesh(self) -> Mesh:
        """An octahedron's faces, cut and pushed outwards."""
        places = np.array(list(product(range(-FACE_CUTS, FACE_CUTS + 1), repeat=3)), float)
        places = places[np.abs(places).sum(axis=1) == FACE_CUTS]
        return convex_mesh(self.radius * places / row_lengths(places)[:, None])


class BoxMesh(Meshed, Walls):
    """A box of 60 x 40 x 30 mm around the origin as twelve triangles."""

    # Half its sides [m].
    half: ClassVar[Array] = np.array([0.03, 0.02, 0.015])

    @property
    def squares(self) -> tuple[Array, Array, Array]:
        """The six faces: corners, and the two sides that start there."""
        sides = 2 * np.diag(self.half)
        corners = np.vstack([0 * sides, sides]) - self.half
        return corners, np.tile(sides[[1, 2, 0]], (2, 1)), np.tile(sides[[2, 0, 1]], (2, 1))

    @cached_property
    def mesh(self) -> Mesh:
        """Its corners, and two triangles a face."""
        return convex_mesh(np.array(list(product((-1, 1), repeat=3))) * self.half)

    @property
    def routes(self) -> dict[str, Array]:
        """Press on the top, slide over an edge and down a side."""
        x, _, z = self.half
        top, side = z + 0.003, x + 0.003
        path = [(0.0, 0.004, z + 0.015), (0.0, 0.004, top), (side, 0.005, top),
                (side, 0.006, -0.005), (x + 0.015, 0.006, -0.005)]  # fmt: skip
        return {"over an edge": np.array(path)}


# Scenes of a quick run, each with the route through it.
QUICK = (("segment", "above"), ("sheet", "front"), ("circle", "outside"), ("corner", "floor"),
         ("omega", "beside"))  # fmt: skip

# Scenes of a full run, each with the route through it.
FULL = (("point", "across"), ("segment", "above"), ("sheet", "front"), ("sheet", "back"),
        ("sheet", "edge"), ("double-sheet", "above"), ("circle", "outside"), ("circle", "inside"),
        ("sphere", "outside"), ("sphere", "inside"), ("wedge", "over"), ("corner", "floor"),
        ("corner", "deep"), ("three-walls", "edge"), ("channel", "through"), ("omega", "beside"),
        ("omega", "over"), ("omega", "inside"), ("teapot", "over"))  # fmt: skip

# Scenes of triangles, each with the route over it.
MESHES = (("ball-mesh", BallMesh, "outside"), ("box-mesh", BoxMesh, "over an edge"))

# Standard deviation of a noisy cloud's points along each axis, as a share of their spacing.
NOISE = 0.1

# Spacing of the cloud of a million points [m]: 1001 x 1001 on the sheet of Experiment 1.
LARGE_SPACING_M = 0.1e-3

# Number of ticks of a path in a quick run, and on a million points.
QUICK_TICKS = 700


@dataclass(frozen=True, eq=False)
class Case:
    """A scene and a path through it.

    Parameters
    ----------
    name
        For the reader.
    scene
        Its geometry.
    hips
        (T, 3) [m].
    spacings
        The only ones whose clouds are tried [m]; `None`: those of the stage.
    """

    name: str
    scene: Scene
    hips: Array
    spacings: tuple[float, ...] | None = None

    @cached_property
    def truth(self) -> Array:
        """(T, 3) the exact proxy [m]."""
        return self.scene.truth(self.hips, R)


class NoisySheet(Sheet):
    """The sheet of Experiment 1 as a tracked probe measures it: every point has an error."""

    name: ClassVar[str] = "noisy-sheet"

    @cached_property
    def points(self) -> Array:
        """(N, 3) [m]; the same errors every time."""
        exact = super().points
        return exact + NOISE * self.spacing * np.random.default_rng(7).normal(size=exact.shape)


def cases(quick: bool) -> Iterator[Case]:
    """All cases, the cheap ones first."""
    ticks = QUICK_TICKS if quick else None
    for name, route in QUICK if quick else FULL:
        scene = SCENES[name]()
        yield Case(f"{name}, {route}", scene, scene.path(route, SPEED_M_S)[:ticks])
    for name, mesh_class, route in MESHES:
        mesh = mesh_class()
        path = mesh.path(route, SPEED_M_S)[:ticks]
        yield Case(f"{name}, {route}", mesh, path, spacings=(1e-3,) if quick else None)
    noisy = NoisySheet()
    path = noisy.path("front", SPEED_M_S)[:ticks]
    yield Case("sheet, 10 % noise", noisy, path, spacings=(noisy.spacing,) if quick else None)
    if not quick:
        yield experiment_2()
        large = Sheet(spacing=LARGE_SPACING_M)
        path = large.path("front", SPEED_M_S)[:QUICK_TICKS]
        yield Case("sheet, 1,002,001 points", large, path, spacings=(LARGE_SPACING_M,))


class Elbow(Drawn):
    """Experiment 2: the curve drawn on the shipped slice, where the robot truly has it."""

    name: ClassVar[str] = "experiment-2"

    @cached_property
    def runs(self) -> Any:
        """Half a millimetre a segment."""
        return (Run(tuple(run.links[0] for run in polyline(*elbow_truth()[0][:, :2]))),)

    @property
    def routes(self) -> dict[str, Array]:
        """The shipped session."""
        return {}


def elbow_truth() -> tuple[Array, Array]:
    """The true curve (M, 3) of the shipped slice in the robot's frame [m], and its map (3, 3).

    The map leads from the slice's [u v 1] into that frame.
    """
    truth = json.loads((files("vfplan.samples") / "elbow_truth.json").read_text())
    pixels, T = np.array(truth["curve_px"]), np.array(truth["T_robot_image"])
    return homogeneous(pixels) @ T.T, T


def experiment_2() -> Case:
    """The shipped elbow, probed by the shipped session."""
    with as_file(files("vfplan.samples") / "elbow_session.csv") as path:
        hips = np.loadtxt(path, delimiter=",", skiprows=1)[:, 1:]
    # Scenes have their middle in z = 0.
    hips[:, 2] -= elbow_truth()[0][:, 2].mean()
    return Case("experiment-2, session", Elbow(), hips)


def fitted(scene: Drawn) -> Pieces:
    """Lines and arcs through a drawing's points, as a plan fits them."""
    from vfplan.geometry.lines import fit_arcs

    fits = [fit_arcs(run.sample(scene.spacing), run.closed, DEFAULT_ARCS_M) for run in scene.runs]
    return Pieces.joined([(in_space(fit.vertices), fit.bulges, fit.closed) for fit in fits])


def evenly_sampled(scene: Scene, choice: Choice) -> Scene:
    """The scene with the cloud that a tolerance asks for on a surface, or on a curve in space."""
    spacing = choice.spacing_m
    if scene.name not in ("point", "segment"):
        # On a surface it is the side of a square.
        spacing /= np.sqrt(2 * (1 + R / getattr(scene, "radius", np.inf)))
    return replace(scene, spacing=spacing)


# A HIP further than this behind the surface [m] has a well-known normal.
CONTACT_DEPTH_M = 0.1e-3


def engine_on_points(scene: Scene, **settings: Any) -> ProxyEngine:
    """An engine on the cloud of a scene."""
    axis = scene.ignore_axis
    return ProxyEngine(scene.points, ignore_axis=axis, stiffness=DEFAULT_STIFFNESS, **settings)


def exact_engine(scene: Scene) -> tuple[ProxyEngine, Record]:
    """Rule "exact" on a mesh's triangles, or on lines and arcs through the cloud of a drawing."""
    if isinstance(scene, Meshed):
        corners, triangles = scene.mesh
        engine = ProxyEngine.on(corners, triangles, R, stiffness=DEFAULT_STIFFNESS)
        return engine, {"points": len(scene.points), "triangles": len(triangles)}
    pieces = fitted(scene)
    engine = ProxyEngine.along(pieces, R, stiffness=DEFAULT_STIFFNESS)
    return engine, {"points": len(scene.points), "lines_and_arcs": pieces.count}


def proxy_scenes(quick: bool, peers: Sequence[Peer]) -> Scenes:
    """The runs of each scene and route."""
    spacings = (1e-3, 0.5e-3) if quick else (2e-3, 1e-3, 0.5e-3, 0.25e-3)
    for case in cases(quick):
        runs = []
        *coarser, finest = case.spacings or spacings
        # The triangles are the same at every spacing.
        on_points = [peer for peer in peers if not peer.needs_mesh]
        for spacing in coarser:
            runs += runs_on(case, spacing, on_points)
        runs += runs_on(case, finest, peers)
        yield [*runs, chosen_run(case)]


# The settings of the engines on points that are compared, by the name of the method.
ON_POINTS = {
    "robust": {}, "robust, 1 iteration": {"max_iterations": 1},
    "robust, 4 iterations": {"max_iterations": 4}, "paper": {"rule": "paper"},
}  # fmt: skip


def runs_on(case: Case, spacing: float, peers: Sequence[Peer]) -> Iterator[BenchRun]:
    """The runs of every rule on a case, and of the peers."""
    scene = replace(case.scene, spacing=spacing)
    points = scene.points
    for name, settings in ON_POINTS.items():
        engine = engine_on_points(scene, **settings)
        listed = {"spacing_m": spacing, **settings}
        yield engine_run(case, name, listed, engine, {"points": len(points)})
    if isinstance(scene, (Drawn, Meshed)):
        engine, figures = exact_engine(scene)
        yield engine_run(case, "exact", {"spacing_m": spacing}, engine, figures)
    mesh = getattr(scene, "mesh", None)
    parameters = ProxyParameters.make(
        points, rule="paper", ignore_axis=scene.ignore_axis, stiffness=DEFAULT_STIFFNESS
    )
    for peer in peers:
        if mesh is not None or not peer.needs_mesh:
            run = partial(peer.run, points, case.hips, parameters, mesh)
            score = partial(judge, case, points=len(points))
            yield BenchRun(case.name, peer.name, {"spacing_m": spacing}, run, score, "m", peer=True)


def chosen_run(case: Case) -> BenchRun:
    """What a plan makes of it: lines and arcs, triangles, or `robust` on the tolerance's points.

    A drawing is measured as a plan measures vectors.
    """
    scene = case.scene
    choice = choose(TOLERANCE_M, R, planar=scene.ignore_axis is not None)
    settings = {"tolerance_m": choice.tolerance_m}
    if isinstance(scene, Drawn):
        settings["arcs_m"] = DEFAULT_ARCS_M
        engine, figures = exact_engine(replace(scene, spacing=FINE_M))
    elif isinstance(scene, Meshed):
        engine, figures = exact_engine(scene)
    elif isinstance(scene, NoisySheet):
        # A measured cloud has no tolerance: it is taken as `vfplan import` takes it.
        settings["spacing_m"] = scene.spacing
        engine, figures = engine_on_points(scene), {"points": len(scene.points)}
    else:
        dense = evenly_sampled(scene, choice)
        settings |= {"spacing_m": choice.spacing_m, "band_m": choice.band_m,
                     "max_iterations": choice.max_iterations}  # fmt: skip
        engine = engine_on_points(dense, band=choice.band_m, max_iterations=choice.max_iterations)
        figures = {"points": len(dense.points)}
    return engine_run(case, "chosen by tolerance", settings, engine, figures, chosen=True)


def engine_run(
    case: Case,
    name: str,
    settings: Settings,
    engine: ProxyEngine,
    figures: Record,
    chosen: bool = False,
) -> BenchRun:
    """An engine on the path of a case."""

    def run() -> tuple[Array, Array]:
        trace, us = timed_ticks(engine, case.hips)
        return trace.proxy, us

    return BenchRun(case.name, name, settings, run, partial(judge, case, **figures), "m", chosen)


def judge(case: Case, proxy: Array, **figures: Any) -> Record:
    """Every figure of a rendered proxy (T, 3) [m] against the exact one, beside other figures."""
    scene, truth, hips = case.scene, case.truth, case.hips
    force = scene.force(hips, proxy, DEFAULT_STIFFNESS)
    force_errors = row_lengths(force - scene.force(hips, truth, DEFAULT_STIFFNESS))

    # The surface.
    clearance = scene.clearance(proxy) - R
    in_contact = row_lengths(truth - hips) > CONTACT_DEPTH_M
    surface_m = float(np.abs(clearance[in_contact]).max(initial=0.0))
    inside_m = float(max(0.0, -clearance.min()))
    return errors_of(
        row_lengths(proxy - truth),
        force_rms_n=float(np.sqrt(np.mean(force_errors**2))),
        surface_error_m=surface_m,
        inside_m=inside_m,
        meets_tolerance=max(surface_m, inside_m) <= TOLERANCE_M,
        **figures,
    )
