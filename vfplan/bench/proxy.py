"""Stage proxy: engines x spacing on scenes whose exact proxy is known.

Error: distance of the rendered from the exact proxy, tick by tick [m]. Beside it stand

force_rms_n, force_max_n
    RMS and maximum of |rendered - true force| over the same HIP path: the RMS force error of
    Ruffaldi, Morris et al., "Standardized evaluation of haptic rendering systems" (2006).
surface_error_m
    How far the proxy rests from the planned surface, either way, in contact; what a tolerance is
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
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from vfplan.bench.cases import Case, NoisySheet, cases, chosen_points, fitted, is_drawn, is_mesh
from vfplan.bench.peers import NearestPointPenalty, Peer
from vfplan.bench.record import Array, Record, Setting, Trial, errors_of, timed_ticks
from vfplan.engine.parameters import ProxyParameters
from vfplan.engine.proxy import ProxyEngine
from vfplan.planning.settings import DEFAULT_ARCS_M
from vfplan.planning.tolerance import choose
from vfplan.reference import PaperProxy
from vfplan.vectors.read import FINE_M

R = 5e-3
STIFFNESS = 1000.0
SPACINGS = {True: (1e-3, 0.5e-3), False: (2e-3, 1e-3, 0.5e-3, 0.25e-3)}
# Looking at every point in every tick is left out beyond so many points x ticks.
NUMPY_WORK, BRUTE_WORK = 4e7, 4e8
HELD_M = 0.1e-3  # a HIP further than this behind the surface has a normal to speak of

Make = Callable[[Case], tuple[Any, dict[str, Any]]]


@dataclass(frozen=True)
class Method:
    """A way to render."""

    make: Make  # an engine on a case's cloud or what is fitted to it, and what is told of that
    most_work: float = np.inf  # points x ticks beyond which it is left out
    settings: tuple[tuple[str, Setting], ...] = ()  # beyond the spacing
    full_only: bool = False  # left out of a quick run
    slow: bool = False  # left out of a quick run where there is one spacing alone
    shaped: bool = False  # for drawings and meshes alone, which hold more than points
    in_space: bool = False  # given the cloud of an extruded drawing, without an ignored axis


def _engine(kind: type = ProxyEngine, **settings: Any) -> Make:
    return lambda case: (_on(case.scene.points, case, kind, **settings), {})


def _on(points: Array, case: Case, kind: type = ProxyEngine, **settings: Any) -> Any:
    return kind(points, ignore_axis=case.scene.ignore_axis, stiffness=STIFFNESS, **settings)


def _along(case: Case) -> tuple[Any, dict[str, Any]]:
    pieces = fitted(case.scene)
    engine = ProxyEngine.along(pieces, R, stiffness=STIFFNESS)
    return engine, {"lines_and_arcs": pieces.count}


def _exact(case: Case) -> tuple[Any, dict[str, Any]]:
    """Rule "exact" on what the scene is made of: lines and arcs, or triangles."""
    if is_mesh(case.scene):
        corners, triangles = case.scene.mesh
        engine = ProxyEngine.on(corners, triangles, R, stiffness=STIFFNESS)
        return engine, {"triangles": len(triangles)}
    return _along(case)


def _limited(n: int) -> Method:
    return Method(
        _engine(max_iterations=n), settings=(("max_iterations", n),), full_only=n not in (1, 4)
    )


BRUTE = (("search", "brute"),)
METHODS: dict[str, Method] = {
    "robust": Method(_engine()),
    **{f"robust, {n} iteration{'s' * (n > 1)}": _limited(n) for n in (1, 2, 4, 8)},
    "robust, every point": Method(_engine(search="brute"), BRUTE_WORK, BRUTE, True),
    "robust, not planar": Method(_engine(), settings=(("planar", False),), in_space=True),
    "paper": Method(_engine(rule="paper")),
    "paper, every point": Method(_engine(rule="paper", search="brute"), BRUTE_WORK, BRUTE, True),
    "paper in NumPy": Method(_engine(PaperProxy), NUMPY_WORK, slow=True),
    "nearest-point penalty": Method(_engine(NearestPointPenalty)),
    "exact": Method(_exact, shaped=True),
}


def scenes(quick: bool, tolerance_m: float, peers: Sequence[Peer] = ()) -> Iterator[list[Trial]]:
    """The trials of each scene and route."""
    for case in cases(quick):
        trials = []
        for spacing in case.spacings or SPACINGS[quick]:
            trials += _trials(case.at(spacing), spacing, quick, peers)
        yield [*trials, chosen_trial(case, tolerance_m)]


def _trials(case: Case, spacing: float, quick: bool, peers: Sequence[Peer]) -> Iterator[Trial]:
    """The trials of every method that this case can meet in good time."""
    scene, solid = case.scene, case.solid
    for name, method in METHODS.items():
        seen = solid if method.in_space else case
        has_shape = is_drawn(scene) or is_mesh(scene)
        left_out = method.shaped and not has_shape
        if quick and (method.full_only or (method.slow and case.spacings)):
            left_out = True
        if seen is None or left_out or len(seen.scene.points) * len(case.hips) > method.most_work:
            continue
        given: dict[str, Setting] = {"spacing_m": spacing, **dict(method.settings)}
        yield _trial(seen, name, given, *method.make(seen))
    for peer in peers:
        yield _peer_trial(case, peer, spacing)


def chosen_trial(case: Case, tolerance_m: float) -> Trial:
    """What a plan makes of it: lines and arcs, triangles, or `robust` on the tolerance's points.

    A drawing is measured as a plan measures vectors.
    """
    scene = case.scene
    choice = choose(tolerance_m, R, planar=scene.ignore_axis is not None)
    given: dict[str, Setting] = {"tolerance_m": choice.tolerance_m}
    points = chosen_points(scene, choice)
    if is_drawn(scene):
        given["arcs_m"] = DEFAULT_ARCS_M
        engine, more = _along(case.at(FINE_M))
    elif is_mesh(scene):
        engine, more = _exact(case)
    elif isinstance(scene, NoisySheet):  # a measured cloud has no tolerance: as `vfplan import`
        given["spacing_m"] = scene.spacing
        points = scene.points
        engine, more = _on(points, case), {}
    else:
        settings = {"band": choice.band_m, "max_iterations": choice.max_iterations}
        given |= {"spacing_m": choice.spacing_m, "band_m": choice.band_m}
        given["max_iterations"] = choice.max_iterations
        engine, more = _on(points, case, **settings), {}
    more["left_out"] = dict(engine.left_out)
    return _trial(case, "chosen by tolerance", given, engine, more, points, chosen=True)


def _trial(
    case: Case,
    name: str,
    settings: dict[str, Setting],
    engine: Any,
    more: dict[str, Any],
    points: Array | None = None,
    chosen: bool = False,
) -> Trial:
    points = case.scene.points if points is None else points
    more = {"points": len(points), "band_m": engine.parameters.band, **more}

    def run() -> tuple[Array, Array]:
        trace, us = timed_ticks(engine, case.hips)
        return trace.proxy, us

    score = lambda proxy: judge(case, points, proxy, more)  # noqa: E731 - reads as its field
    return Trial(case.name, name, settings, run, score, "m", chosen)


def _peer_trial(case: Case, peer: Peer, spacing: float) -> Trial:
    """An outside program on this cloud, with the paper's settings."""
    points, axis = case.scene.points, case.scene.ignore_axis
    par = ProxyParameters.make(points, rule="paper", ignore_axis=axis, stiffness=STIFFNESS)
    more = {"points": len(points), "band_m": par.band}
    return Trial(
        case.name, peer.name, {"spacing_m": spacing}, lambda: peer.run(points, case.hips, par),
        lambda proxy: judge(case, points, proxy, more), "m", peer=True,
    )  # fmt: skip


def judge(case: Case, points: Array, proxy: Array, more: dict[str, Any]) -> Record:
    """Every figure of a rendered proxy (T, 3) [m] against the exact one."""
    truth, hips = case.truth, case.hips
    force = case.scene.force(hips, proxy, STIFFNESS)
    wrong = np.linalg.norm(force - case.scene.force(hips, truth, STIFFNESS), axis=1)
    figures = {
        "force_rms_n": float(np.sqrt(np.mean(wrong**2))),
        "force_max_n": float(wrong.max()),
        **_surface(case, proxy),
        **_friction(case, proxy),
        "clearance_min_m": _clearance(case, points, proxy),
    }
    off = np.linalg.norm(proxy - truth, axis=1)
    return errors_of(off, **_followed(case, off), **figures, **more)


def _followed(case: Case, off: Array) -> dict[str, Any]:
    kept = off[case.followable]
    return {
        "ticks": len(off),
        "followed_ticks": len(kept),
        "followed_rms_m": float(np.sqrt(np.mean(kept**2))) if len(kept) else 0.0,
    }


def _surface(case: Case, proxy: Array) -> dict[str, Any]:
    off = case.room.copy()
    moved = (proxy != case.truth).any(axis=1)  # elsewhere, as in free motion, the room is known
    off[moved] = case.scene.clearance(proxy[moved]) - R
    depth = np.linalg.norm(case.truth - case.hips, axis=1)

    def worst(mask: Any) -> float:
        return float(np.abs(off[mask]).max()) if mask.any() else 0.0

    return {
        "surface_error_m": worst(depth > HELD_M),
        "inside_m": float(max(0.0, -off.min())),
    }


def _friction(case: Case, proxy: Array) -> dict[str, Any]:
    pull, exact = proxy - case.hips, case.truth - case.hips
    depth = np.linalg.norm(exact, axis=1)
    held = depth > HELD_M
    if not held.any():
        return {}
    normal = exact[held] / depth[held, None]
    along = (pull[held] * normal).sum(axis=1)
    lag = np.linalg.norm(pull[held] - along[:, None] * normal, axis=1)
    return {
        "lag_rms_m": float(np.sqrt(np.mean(lag**2))),
        "friction": float(np.sqrt(np.mean((lag / depth[held]) ** 2))),
    }


def _clearance(case: Case, points: Array, proxy: Array) -> float:
    flat = np.ones(3) if case.scene.ignore_axis is None else np.array([1.0, 1.0, 0.0])
    return float(cKDTree(points * flat).query(proxy * flat)[0].min() - R)
