"""The scenes of stage proxy, each with a HIP path and its exact proxy, computed once."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from importlib.resources import files
from typing import Any, ClassVar, TypeGuard

import numpy as np
from numpy.typing import NDArray

from vfplan.bench.meshes import BallMesh, BoxMesh
from vfplan.bench.record import Array
from vfplan.fixture import Pieces
from vfplan.planning.settings import DEFAULT_ARCS_M
from vfplan.planning.tolerance import DEPTH, SPEED_M_S, Choice
from vfplan.scenes import SCENES, Drawn, Scene, Sheet
from vfplan.stability.contacts import RADIUS as R

QUICK = (("segment", "above"), ("sheet", "front"), ("circle", "outside"), ("corner", "floor"),
         ("omega", "beside"))  # fmt: skip
"""Scenes of a quick run, each with the route through it."""

FULL = (("point", "across"), ("segment", "above"), ("sheet", "front"), ("sheet", "back"),
        ("sheet", "edge"), ("double-sheet", "above"), ("circle", "outside"), ("circle", "inside"),
        ("sphere", "outside"), ("sphere", "inside"), ("wedge", "over"), ("corner", "floor"),
        ("corner", "deep"), ("three-walls", "edge"), ("channel", "through"), ("omega", "beside"),
        ("omega", "over"), ("omega", "inside"), ("teapot", "over"))  # fmt: skip
"""Scenes of a full run, each with the route through it."""

MESHES = (("ball-mesh", BallMesh, "outside"), ("box-mesh", BoxMesh, "over an edge"))
"""Scenes of triangles, each with the route over it."""

NOISE = 0.1
"""Standard deviation of a noisy cloud's points along each axis, as a share of their spacing."""

LARGE_SPACING_M = 0.1e-3
"""Spacing of the cloud of a million points [m]: 1001 x 1001 on the sheet of Experiment 1."""

QUICK_TICKS = 700
"""Number of ticks of a path in a quick run, and on a million points."""

MAX_SENSITIVITY = 1 / (1 - DEPTH) + 1e-9
"""An engine can follow a proxy that moves by no more than this times what the HIP does."""


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
    origin
        A case of the same geometry and path: clouds of other spacings share its truth.
    spacings
        The only ones that are tried [m]; `None`: those of the stage.
    """

    def __init__(
        self,
        name: str,
        scene: Scene,
        hips: Array,
        origin: Case | None = None,
        spacings: tuple[float, ...] | None = None,
    ) -> None:
        self.name = name
        self.scene = scene
        self.hips = hips
        self.spacings = spacings
        self._origin = origin

    @cached_property
    def truth(self) -> Array:
        """(T, 3) the exact proxy [m]."""
        return self._origin.truth if self._origin else self.scene.truth(self.hips, R)

    @cached_property
    def followable(self) -> NDArray[np.bool_]:
        """(T,) where the exact proxy moves by no more than twice what the HIP does.

        `planning.tolerance` promises no more than that: a HIP at most R/2 behind the sharpest
        surface. Deeper, the exact proxy outruns any engine: with the HIP at the centre of
        the ball around a point it turns round in one tick.
        """
        if self._origin:
            return self._origin.followable
        return self.scene.sensitivity(self.hips, self.truth, R) <= MAX_SENSITIVITY

    @cached_property
    def clearance(self) -> Array:
        """(T,) distance from the exact proxy to the geometry, minus R [m]."""
        return self._origin.clearance if self._origin else self.scene.clearance(self.truth) - R

    def with_scene(self, scene: Scene) -> Case:
        """The same path and truth on another cloud of the same geometry."""
        return Case(self.name, scene, self.hips, self._origin or self, self.spacings)

    @property
    def solid(self) -> Case | None:
        """A drawing extruded far enough that its ends are not felt; `None` for a solid scene."""
        if self.scene.ignore_axis is None:
            return None
        return self.with_scene(replace(self.scene, extrude=6 * R))

    def at(self, spacing: float) -> Case:
        """The same with points `spacing` apart [m]."""
        return self.with_scene(replace(self.scene, spacing=spacing))


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
    drawn = FULL
    ticks = None
    mesh_spacings = None
    noisy_spacings = None
    noisy = NoisySheet()
    if quick:
        drawn = QUICK
        ticks = QUICK_TICKS
        mesh_spacings = (1e-3,)
        noisy_spacings = (noisy.spacing,)
    for name, route in drawn:
        scene = SCENES[name]()
        yield Case(f"{name}, {route}", scene, scene.path(route, SPEED_M_S)[:ticks])
    for name, mesh_class, route in MESHES:
        mesh = mesh_class()
        path = mesh.path(route, SPEED_M_S)[:ticks]
        yield Case(f"{name}, {route}", mesh, path, spacings=mesh_spacings)
    path = noisy.path("front", SPEED_M_S)[:ticks]
    yield Case("sheet, 10 % noise", noisy, path, spacings=noisy_spacings)
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
        from vfplan.scenes import outline

        links = outline.polyline(*elbow_curve()[:, :2])
        return (outline.Run(tuple(run.links[0] for run in links)),)

    @property
    def routes(self) -> dict[str, Array]:
        """The shipped session."""
        return {}


def elbow_truth() -> dict[str, Any]:
    """The true curve and map of the shipped slice."""
    return json.loads((files("vfplan.samples") / "elbow_truth.json").read_text())


def elbow_map() -> Array:
    """(3, 3) true map of the shipped slice's [u v 1] into the robot's frame [m]."""
    return np.array(elbow_truth()["T_robot_image"])


def elbow_curve() -> Array:
    """(M, 3) the true curve of the shipped slice in the robot's frame [m]."""
    px = np.array(elbow_truth()["curve_px"])
    return np.column_stack([px, np.ones(len(px))]) @ elbow_map().T


def experiment_2() -> Case:
    """The shipped elbow, probed by the shipped session."""
    rows = []
    for line in (files("vfplan.samples") / "elbow_session.csv").read_text().splitlines()[1:]:
        rows.append(line.split(",")[1:])
    hips = np.array(rows, float)
    # Scenes have their middle in z = 0.
    hips[:, 2] -= elbow_curve()[:, 2].mean()
    return Case("experiment-2, session", Elbow(), hips)


def is_drawn(scene: Scene) -> TypeGuard[Drawn]:
    """Whether a plan of it has lines and arcs."""
    return isinstance(scene, Drawn) and scene.ignore_axis is not None


def is_mesh(scene: Scene) -> bool:
    """Whether a plan of it has triangles."""
    return isinstance(scene, (BallMesh, BoxMesh))


def fitted(scene: Drawn, tolerance_m: float = DEFAULT_ARCS_M) -> Pieces:
    """Lines and arcs through a drawing's points, as a plan fits them."""
    from vfplan.geometry.arcs import fit_arcs

    vertices = []
    bulges = []
    strokes = []
    closed = []
    for number, run in enumerate(scene.runs):
        arcs = fit_arcs(run.sample(scene.spacing), run.closed, tolerance_m)
        vertices.append(arcs.vertices)
        bulges.append(arcs.bulges)
        strokes += [number] * len(arcs.bulges)
        closed.append(arcs.closed)
    flat = np.vstack(vertices)
    return Pieces(
        np.column_stack([flat, np.zeros(len(flat))]),
        np.concatenate(bulges),
        np.array(strokes, np.int32),
        np.array(closed),
    )


def chosen_points(scene: Scene, choice: Choice) -> Array:
    """The cloud that a tolerance asks for: by curvature on a drawing, an even one on a surface."""
    if not is_drawn(scene):
        # Spacing on a curve in space, or the side of a square on a surface.
        spacing = choice.spacing_m
        if scene.name not in ("point", "segment"):
            bend = 1 + R / getattr(scene, "radius", np.inf)
            spacing = choice.spacing_m / np.sqrt(2 * bend)
        return replace(scene, spacing=spacing).points
    from vfplan.planning.tolerance import sample_curve

    parts = []
    for run in scene.runs:
        fine = run.sample(min(1e-4, run.length / 50))
        fine = np.column_stack([fine, np.zeros(len(fine))])
        sampled = sample_curve(
            fine, run.closed, radius_m=R, tolerance_m=choice.sampling_tolerance_m
        )
        parts.append(sampled.points)
    points = np.vstack(parts)
    # Corners that two runs share stand once.
    nanometres = np.round(points / 1e-9).astype(np.int64)
    return points[np.sort(np.unique(nanometres, axis=0, return_index=True)[1])]
