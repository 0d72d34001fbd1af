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
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.curve.vector import FINE_M
from vfplan.engine.tolerance import Choice, choose
from vfplan.fixture import Pieces
from vfplan.planning.settings import DEFAULT_ARCS_M
from vfplan.study.bench.cases import Case, cases, chosen_points, fitted, is_drawn
from vfplan.study.bench.peers import NearestPointPenalty, Peer
from vfplan.study.bench.record import Array, Errors, Setting, Trial, timed_ticks

R = 5e-3
STIFFNESS = 1000.0
SPACINGS = {True: (1e-3, 0.5e-3), False: (2e-3, 1e-3, 0.5e-3, 0.25e-3)}
# Looking at every point in every tick is left out beyond so many points x ticks.
NUMPY_WORK, BRUTE_WORK = 4e7, 4e8
HELD_M = 0.1e-3  # a HIP further than this behind the surface has a normal to speak of

Make = Callable[[Array, str | None], Any]


@dataclass(frozen=True)
class Method:
    """A way to render."""

    make: Make  # (points, ignored axis) -> engine
    most_work: float = np.inf  # points x ticks beyond which it is left out
    settings: tuple[tuple[str, Setting], ...] = ()  # beyond the spacing
    full_only: bool = False  # left out of a quick run
    in_space: bool = False  # given the cloud of an extruded drawing, without an ignored axis


def _native(**settings: Any) -> Make:
    def make(points: Array, axis: str | None) -> Any:
        from vfplan.engine.proxy import ProxyEngine

        return ProxyEngine(points, ignore_axis=axis, stiffness=STIFFNESS, **settings)

    return make


def _python(name: str) -> Make:
    def make(points: Array, axis: str | None) -> Any:
        from vfplan.reference import PaperProxy

        kind = {"paper": PaperProxy, "penalty": NearestPointPenalty}[name]
        return kind(points, ignore_axis=axis, stiffness=STIFFNESS)

    return make


def _limited(n: int) -> Method:
    return Method(
        _native(max_iterations=n), settings=(("max_iterations", n),), full_only=n not in (1, 4)
    )


METHODS: dict[str, Method] = {
    "robust": Method(_native()),
    **{f"robust, {n} iteration{'s' * (n > 1)}": _limited(n) for n in (1, 2, 4, 8)},
    "robust, every point": Method(_native(search="brute"), BRUTE_WORK, (("search", "brute"),)),
    "robust, not planar": Method(_native(), settings=(("planar", False),), in_space=True),
    "paper": Method(_native(rule="paper")),
    "paper, every point": Method(
        _native(rule="paper", search="brute"), BRUTE_WORK, (("search", "brute"),), True
    ),
    "paper in NumPy": Method(_python("paper"), NUMPY_WORK),
    "nearest-point penalty": Method(_python("penalty")),
}


def scenes(
    quick: bool, tolerance_m: float, peers: Sequence[Peer] = (), surface: Path | None = None
) -> Iterator[list[Trial]]:
    """The trials of each scene and route."""
    for case in cases(quick, surface):
        yield list(_trials(case, quick, tolerance_m, peers))


def _trials(case: Case, quick: bool, tolerance_m: float, peers: Sequence[Peer]) -> Iterator[Trial]:
    choice = choose(tolerance_m, R, planar=case.scene.ignore_axis is not None)
    for spacing in SPACINGS[quick]:
        finer = Rendered(case.at(spacing), choice)
        for name, method in METHODS.items():
            if method.full_only and quick:
                continue
            if method.in_space:
                solid = finer.solid
                if solid is not None:
                    yield from solid.trials(name, method, spacing)
            else:
                yield from finer.trials(name, method, spacing)
        if is_drawn(finer.case.scene):
            yield finer.exact_trial(spacing)
        for peer in peers:
            yield finer.peer_trial(peer, spacing)
    best = Rendered(case, choice, points=chosen_points(case.scene, choice))
    yield best.chosen_trial()


@dataclass(frozen=True, eq=False)
class Rendered:
    """A cloud of a case, ready for engines."""

    case: Case
    choice: Choice
    points: Array = None  # (N, 3) [m]; the scene's own where none are given

    def __post_init__(self) -> None:
        if self.points is None:
            object.__setattr__(self, "points", self.case.scene.points)

    @cached_property
    def solid(self) -> Rendered | None:
        """The drawing extruded far enough that its ends are not felt; `None` for a solid scene."""
        scene = self.case.scene
        if scene.ignore_axis is None:
            return None
        return Rendered(self.case.with_scene(replace(scene, extrude=6 * R)), self.choice)

    def trials(self, name: str, method: Method, spacing: float) -> Iterator[Trial]:
        """The trial of one method; none where it would take too long."""
        if len(self.points) * len(self.case.hips) > method.most_work:
            return
        engine = method.make(self.points, self.case.scene.ignore_axis)
        settings: dict[str, Setting] = {"spacing_m": spacing, **dict(method.settings)}
        yield self._trial(name, settings, engine)

    def exact_trial(self, spacing: float) -> Trial:
        """Rule `exact` along lines and arcs fitted to the drawing's points."""
        pieces = fitted(self.case.scene)
        return self._trial("exact", {"spacing_m": spacing}, _along(pieces), pieces=pieces)

    def chosen_trial(self) -> Trial:
        """What a plan makes of it: lines and arcs, or `robust` with what the tolerance gives.

        A drawing is measured as a plan measures vectors.
        """
        choice, scene = self.choice, self.case.scene
        given: dict[str, Setting] = {"tolerance_m": choice.tolerance_m}
        if is_drawn(scene):
            given["arcs_m"], pieces = DEFAULT_ARCS_M, fitted(replace(scene, spacing=FINE_M))
            made = _along(pieces)
            return self._trial("chosen by tolerance", given, made, chosen=True, pieces=pieces)
        given |= {
            "spacing_m": choice.spacing_m,
            "band_m": choice.band_m,
            "max_iterations": choice.max_iterations,
        }
        make = _native(band=choice.band_m, max_iterations=choice.max_iterations)
        engine = make(self.points, scene.ignore_axis)
        return self._trial("chosen by tolerance", given, engine, chosen=True)

    def _trial(
        self,
        name: str,
        settings: dict[str, Setting],
        engine: Any,
        chosen: bool = False,
        pieces: Pieces | None = None,
    ) -> Trial:
        case, points = self.case, self.points
        more = {"points": len(points), "band_m": engine.parameters.band}
        if pieces is not None:
            more["lines_and_arcs"] = pieces.count
        if chosen:
            more["left_out"] = dict(engine.left_out)

        def run() -> tuple[Array, Array]:
            trace, us = timed_ticks(engine, case.hips)
            return trace.proxy, us

        return Trial(
            case.name, name, settings, run, lambda p: judge(case, points, p, more), "m", chosen
        )

    def peer_trial(self, peer: Peer, spacing: float) -> Trial:
        """An outside program on this cloud, with the paper's settings."""
        from vfplan.engine.parameters import ProxyParameters

        case, points = self.case, self.points
        par = ProxyParameters.make(
            points, rule="paper", ignore_axis=case.scene.ignore_axis, stiffness=STIFFNESS
        )
        more = {"points": len(points), "band_m": par.band}
        return Trial(
            case.name,
            peer.name,
            {"spacing_m": spacing},
            lambda: peer.run(points, case.hips, par),
            lambda p: judge(case, points, p, more),
            "m",
            peer=True,
        )


def _along(pieces: Pieces) -> Any:
    from vfplan.engine.proxy import ProxyEngine

    return ProxyEngine.along(pieces, R, stiffness=STIFFNESS)


def judge(case: Case, points: Array, proxy: Array, more: dict[str, Any]) -> Errors:
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
    return Errors.of(off, **_followed(case, off), **figures, **more)


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
    from scipy.spatial import cKDTree

    flat = np.ones(3) if case.scene.ignore_axis is None else np.array([1.0, 1.0, 0.0])
    return float(cKDTree(points * flat).query(proxy * flat)[0].min() - R)
