"""Stage proxy: engines x spacing on scenes whose exact proxy is known.

Error: distance of the rendered from the exact proxy, tick by tick [m]. Beside it stand

force_rms_n, force_max_n
    RMS and maximum of |rendered - true force| over the same HIP path: the RMS force error of
    Ruffaldi, Morris et al., "Standardized evaluation of haptic rendering systems" (2006).
surface_error_m
    How far the proxy stands from the planned surface, either way, in contact; what a tolerance is
    about. `inside_m` is the part of it that counts: nearer to the exact geometry than R.
followed_rms_m, followed_ticks
    The RMS error over the ticks in which an engine can follow the exact proxy at all
    (`Case.followable`), and how many of the `ticks` those are.
clearance_min_m
    min |p_i - proxy| - R over the cloud.
lag_rms_m, friction
    The part of proxy - HIP across the exact force, and its ratio to the exact depth: what a hand
    feels as friction though none is rendered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from vfplan.bench.cases import Case, NoisySheet, R, cases, chosen_points, fitted, is_drawn, is_mesh
from vfplan.bench.peers import NearestPointPenalty, Peer
from vfplan.bench.record import Array, BenchRun, Record, Setting, errors_of, timed_ticks
from vfplan.engine.parameters import ProxyParameters
from vfplan.engine.proxy import ProxyEngine
from vfplan.planning.settings import DEFAULT_ARCS_M
from vfplan.planning.tolerance import choose
from vfplan.reference import PaperProxy
from vfplan.stability.study import DEFAULT_STIFFNESS
from vfplan.vectors.read import FINE_M

NUMPY_WORK = 4e7
"""Number of points times ticks up to which the NumPy reference runs in good time."""

BRUTE_WORK = 10 * NUMPY_WORK
"""Number of points times ticks up to which a look at every point in every tick does."""

CONTACT_DEPTH_M = 0.1e-3
"""A HIP further than this behind the surface [m] has a well-known normal."""

Make = Callable[[Case], tuple[Any, dict[str, Any]]]


@dataclass(frozen=True)
class Method:
    """One rule and one engine, with its settings.

    Parameters
    ----------
    make
        An engine on the cloud of a case, or on what is fitted to it, and figures of that.
    max_work
        Number of points times ticks beyond which it does not run.
    settings
        Those besides the spacing.
    full_only
        It does not run in a quick run.
    slow
        It does not run in a quick run where there is one spacing alone.
    needs_shape
        For drawings and meshes alone, which hold more than points.
    in_space
        On the cloud of an extruded drawing, without an ignored axis.
    """

    make: Make
    max_work: float = np.inf
    settings: tuple[tuple[str, Setting], ...] = ()
    full_only: bool = False
    slow: bool = False
    needs_shape: bool = False
    in_space: bool = False


def engine_on_points(
    case: Case, kind: type = ProxyEngine, **settings: Any
) -> tuple[Any, dict[str, Any]]:
    """An engine on the cloud of a case."""
    axis = case.scene.ignore_axis
    return kind(case.scene.points, ignore_axis=axis, stiffness=DEFAULT_STIFFNESS, **settings), {}


def engine_on_arcs(case: Case) -> tuple[Any, dict[str, Any]]:
    """Rule "exact" on lines and arcs through the cloud of a drawing."""
    pieces = fitted(case.scene)
    engine = ProxyEngine.along(pieces, R, stiffness=DEFAULT_STIFFNESS)
    return engine, {"lines_and_arcs": pieces.count}


def exact_engine(case: Case) -> tuple[Any, dict[str, Any]]:
    """Rule "exact" on what the scene is made of: lines and arcs, or triangles."""
    if is_mesh(case.scene):
        corners, triangles = case.scene.mesh
        engine = ProxyEngine.on(corners, triangles, R, stiffness=DEFAULT_STIFFNESS)
        return engine, {"triangles": len(triangles)}
    return engine_on_arcs(case)


def limited(iterations: int, full_only: bool = False) -> Method:
    """Rule "robust" with a limit on its iterations in a tick."""
    return Method(
        partial(engine_on_points, max_iterations=iterations),
        settings=(("max_iterations", iterations),), full_only=full_only,
    )  # fmt: skip


BRUTE = (("search", "brute"),)
METHODS: dict[str, Method] = {
    "robust": Method(engine_on_points),
    "robust, 1 iteration": limited(1),
    "robust, 2 iterations": limited(2, full_only=True),
    "robust, 4 iterations": limited(4),
    "robust, 8 iterations": limited(8, full_only=True),
    "robust, every point": Method(
        partial(engine_on_points, search="brute"), BRUTE_WORK, BRUTE, full_only=True
    ),
    "robust, not planar": Method(engine_on_points, settings=(("planar", False),), in_space=True),
    "paper": Method(partial(engine_on_points, rule="paper")),
    "paper, every point": Method(
        partial(engine_on_points, rule="paper", search="brute"), BRUTE_WORK, BRUTE, full_only=True
    ),
    "paper in NumPy": Method(partial(engine_on_points, kind=PaperProxy), NUMPY_WORK, slow=True),
    "nearest-point penalty": Method(partial(engine_on_points, kind=NearestPointPenalty)),
    "exact": Method(exact_engine, needs_shape=True),
}


def scenes(quick: bool, tolerance_m: float, peers: Sequence[Peer] = ()) -> Iterator[list[BenchRun]]:
    """The runs of each scene and route."""
    spacings = (1e-3, 0.5e-3) if quick else (2e-3, 1e-3, 0.5e-3, 0.25e-3)
    for case in cases(quick):
        runs = []
        for spacing in case.spacings or spacings:
            runs += runs_on(case.at(spacing), spacing, quick, peers)
        yield [*runs, chosen_run(case, tolerance_m)]


def runs_on(case: Case, spacing: float, quick: bool, peers: Sequence[Peer]) -> Iterator[BenchRun]:
    """The runs of every method on a case in good time, and of the peers."""
    has_shape = is_drawn(case.scene) or is_mesh(case.scene)
    for name, method in METHODS.items():
        method_case: Case | None = case.solid if method.in_space else case
        if method_case is None or (method.needs_shape and not has_shape):
            continue
        if quick and (method.full_only or (method.slow and case.spacings)):
            continue
        if len(method_case.scene.points) * len(case.hips) > method.max_work:
            continue
        settings: dict[str, Setting] = {"spacing_m": spacing, **dict(method.settings)}
        engine, figures = method.make(method_case)
        points = method_case.scene.points
        yield engine_run(method_case, name, settings, engine, points, figures)
    points = case.scene.points
    axis = case.scene.ignore_axis
    for peer in peers:
        parameters = ProxyParameters.make(
            points, rule="paper", ignore_axis=axis, stiffness=DEFAULT_STIFFNESS
        )
        figures = {"points": len(points), "band_m": parameters.band}
        run = partial(peer.run, points, case.hips, parameters)
        score = partial(judge, case, points, figures=figures)
        yield BenchRun(case.name, peer.name, {"spacing_m": spacing}, run, score, "m", peer=True)


def chosen_run(case: Case, tolerance_m: float) -> BenchRun:
    """What a plan makes of it: lines and arcs, triangles, or `robust` on the tolerance's points.

    A drawing is measured as a plan measures vectors.
    """
    scene = case.scene
    choice = choose(tolerance_m, R, planar=scene.ignore_axis is not None)
    settings: dict[str, Setting] = {"tolerance_m": choice.tolerance_m}
    points = chosen_points(scene, choice)
    figures: dict[str, Any] = {}
    if is_drawn(scene):
        settings["arcs_m"] = DEFAULT_ARCS_M
        engine, figures = engine_on_arcs(case.at(FINE_M))
    elif is_mesh(scene):
        engine, figures = exact_engine(case)
    elif isinstance(scene, NoisySheet):
        # A measured cloud has no tolerance: it is taken as `vfplan import` takes it.
        settings["spacing_m"] = scene.spacing
        points = scene.points
        engine = ProxyEngine(points, ignore_axis=scene.ignore_axis, stiffness=DEFAULT_STIFFNESS)
    else:
        settings |= {
            "spacing_m": choice.spacing_m,
            "band_m": choice.band_m,
            "max_iterations": choice.max_iterations,
        }
        engine = ProxyEngine(
            points, ignore_axis=scene.ignore_axis, stiffness=DEFAULT_STIFFNESS, band=choice.band_m,
            max_iterations=choice.max_iterations,
        )  # fmt: skip
    figures["left_out"] = dict(engine.left_out)
    return engine_run(case, "chosen by tolerance", settings, engine, points, figures, chosen=True)


def engine_run(
    case: Case,
    name: str,
    settings: dict[str, Setting],
    engine: Any,
    points: Array,
    figures: dict[str, Any],
    chosen: bool = False,
) -> BenchRun:
    """An engine on the path of a case."""
    figures = {"points": len(points), "band_m": engine.parameters.band, **figures}

    def run() -> tuple[Array, Array]:
        trace, us = timed_ticks(engine, case.hips)
        return trace.proxy, us

    score = partial(judge, case, points, figures=figures)
    return BenchRun(case.name, name, settings, run, score, "m", chosen)


def judge(case: Case, points: Array, proxy: Array, figures: dict[str, Any]) -> Record:
    """Every figure of a rendered proxy (T, 3) [m] against the exact one, beside other figures."""
    truth = case.truth
    hips = case.hips
    errors = np.linalg.norm(proxy - truth, axis=1)

    # The error of the force, and of the ticks that an engine can follow.
    force = case.scene.force(hips, proxy, DEFAULT_STIFFNESS)
    force_errors = np.linalg.norm(force - case.scene.force(hips, truth, DEFAULT_STIFFNESS), axis=1)
    followed = errors[case.followable]
    record = {
        "ticks": len(errors),
        "followed_ticks": len(followed),
        "followed_rms_m": root_mean_square(followed),
        "force_rms_n": root_mean_square(force_errors),
        "force_max_n": float(force_errors.max()),
    }

    # The surface. Where the proxy is the exact one, as in free motion, its clearance is known.
    clearance = case.clearance.copy()
    has_moved = (proxy != truth).any(axis=1)
    clearance[has_moved] = case.scene.clearance(proxy[has_moved]) - R
    exact_pull = truth - hips
    depth = np.linalg.norm(exact_pull, axis=1)
    in_contact = depth > CONTACT_DEPTH_M
    record["surface_error_m"] = float(np.abs(clearance[in_contact]).max(initial=0.0))
    record["inside_m"] = float(max(0.0, -clearance.min()))

    # What a hand feels as friction: the part of the pull across the exact normal.
    if in_contact.any():
        normal = exact_pull[in_contact] / depth[in_contact, None]
        pull = (proxy - hips)[in_contact]
        along = (pull * normal).sum(axis=1)
        lag = np.linalg.norm(pull - along[:, None] * normal, axis=1)
        record["lag_rms_m"] = root_mean_square(lag)
        record["friction"] = root_mean_square(lag / depth[in_contact])

    flat = np.ones(3)
    if case.scene.ignore_axis is not None:
        flat = np.array([1.0, 1.0, 0.0])
    nearest, _ = cKDTree(points * flat).query(proxy * flat)
    record["clearance_min_m"] = float(nearest.min() - R)
    return errors_of(errors, **record, **figures)


def root_mean_square(values: Array) -> float:
    """The root of the mean square; 0 of no values."""
    return 0.0 if not len(values) else float(np.sqrt(np.mean(values**2)))
