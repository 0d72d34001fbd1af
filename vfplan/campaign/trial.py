"""One trial: other marker errors, another registration, another fixture, the same hand's wish.

The truth is the bundle's own: its markers where the registration puts them, its curve where it
stands. A trial draws errors of the markers on both sides and of the curve, fits the registration
anew, carries the curve with it, and renders that fixture to a hand that wants to go where the
session went. How far the tool came beyond the *true* curve is what the trial tells.

The hand is a spring k_h towards its wish w, the fixture one of stiffness K towards the proxy p, and
at rest the tool is at x = (k_h w + K p) / (k_h + K). A recorded session holds x; its wish follows
from the same equation with the proxy of the bundle as it is. In a trial the proxy is that of the
recorded x: the tool moves across the surface, by less than the surface does, which leaves the
nearest place on it where it was to second order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.campaign.settings import CampaignSettings, fle_of, tremor
from vfplan.engine.proxy import ProxyEngine
from vfplan.errors import SceneError
from vfplan.fixture import Fixture, RegistrationRecord
from vfplan.registration.models import homogeneous
from vfplan.registration.problem import Problem, make_problem
from vfplan.replaying.quantities import CONTACT_M, dots, row_norms
from vfplan.session import Session

Array = NDArray[np.float64]
Deepest = tuple[float, Array]  # how deep [m], and the proxy there
# On the way to the deepest place so many ticks are looked at together, and each so many first.
STRETCH, SPARSE = 16, 4
MOST_DEPARTURE_M = 1e-5  # of lines and arcs from the curve, whose points are rendered here
ROUGH_M = 1e-5  # what sampling and the curve's own deviations may add between these
FREE = -1.0  # depth [m] of a trial in which nothing was touched


@dataclass(frozen=True)
class Outcome:
    """What a trial tells."""

    # How far the tool came beyond the true curve's surface at most [m]; below 0 it never did
    depth_m: float
    # Index of the true curve's point nearest to where that was; -1 where nothing was touched
    point: int
    # Largest force and largest change of it in a tick [N]
    force_n: float
    force_step_n: float


class Trials:
    """The trials of a fixture and its sessions; trial k uses session k modulo their number.

    Parameters
    ----------
    fixture
        In `robot_base`, with rendering and registration.
    sessions
        Recordings of HIP positions in `robot_base`.
    settings
        What differs from trial to trial.

    Raises
    ------
    SceneError
        A fixture without rendering or registration, or not in `robot_base`.
    """

    def __init__(
        self, fixture: Fixture, sessions: list[Session], settings: CampaignSettings
    ) -> None:
        record = _registered(fixture)
        self.fixture, self.sessions = fixture, sessions
        fle = fle_of(record) if settings.fle_robot_m is None else settings.fle_robot_m
        self.settings = replace(settings, fle_robot_m=fle)
        T = record.T_robot_image
        self._curve = _back(T, fixture.points)
        self._source, self._target = record.source, _apply(T, record.source)
        image = fixture.image
        spacing = None if image is None else image.pixel_spacing_mm
        metres = None if spacing is None else (1e-3 * spacing[0], 1e-3 * spacing[1])
        self._markers = make_problem(self._source, self._target, record.model, metres, None, None)
        self._along = homogeneous(self._markers.normaliser(self._curve))
        self._sigma = fixture.sigma

    def __getstate__(self) -> dict[str, Any]:
        """Without the engines, which belong to one process."""
        kept = dict(self.__dict__)
        for name in ("_true", "_wishes"):
            kept.pop(name, None)
        return kept

    @property
    def dimension(self) -> int:
        """How many standard normals a trial's geometry takes."""
        return self.markers + (0 if self._sigma is None else len(self._sigma))

    @property
    def markers(self) -> int:
        """How many of them are the markers'; they stand first."""
        return self._source.size + self._target.size

    def draw(self, trial: int) -> tuple[Array, np.random.Generator]:
        """The trial's standard normals (`dimension`,), and the generator for the rest."""
        rng = np.random.Generator(np.random.Philox(key=[self.settings.seed, trial]))
        return rng.standard_normal(self.dimension), rng

    def run(self, trial: int) -> dict[str, Any]:
        """One trial as a row of the campaign's table."""
        z, rng = self.draw(trial)
        problem = self._problem(z)
        outcome = self.replay(self._carried(problem, z), trial, rng)
        return {"trial": trial, **outcome.__dict__}

    def planned(self, z: Array) -> Array:
        """The fixture's points (N, 3) [m] that these normals lead to."""
        return self._carried(self._problem(z), z)

    def _problem(self, z: Array) -> Problem:
        """The markers as these normals pick and touch them."""
        image, robot = np.split(z[: self.markers], [self._source.size])
        axis_image = self.settings.fle_image_px / np.sqrt(self._source.shape[1])
        axis_robot = self.settings.fle_robot_m / np.sqrt(3.0)
        true = self._markers
        source = self._source + axis_image * image.reshape(self._source.shape)
        target = true.y + axis_robot * robot.reshape(true.y.shape)
        return replace(true, s=true.normaliser(source), y=target)

    def _carried(self, problem: Problem, z: Array) -> Array:
        m = problem.model.solve(problem.s, problem.y, problem.weights)
        points = self._along @ m.T + problem.normaliser.target_centre
        if self._sigma is not None:
            points += (self._sigma * z[self.markers :])[:, None] * self._across
        return points

    @cached_property
    def _across(self) -> Array:
        """(N, 3) unit vectors across the curve, in its plane."""
        along = np.gradient(self.fixture.points, axis=0)
        normal = self.fixture.ignore_axis
        if normal is None:
            normal = np.linalg.svd(self.fixture.points - self.fixture.points.mean(axis=0))[2][2]
        across = np.cross(along, normal)
        return across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]

    def _engine(self, points: Array, stiffness: Array) -> ProxyEngine:
        r = self.fixture.rendering
        assert r is not None
        return ProxyEngine(
            points, r.contact_radius, r.band, r.point_radius, stiffness,
            ignore_axis=r.ignore_axis, max_iterations=r.max_iterations,
        )  # fmt: skip

    @cached_property
    def _true(self) -> ProxyEngine:
        return self._engine(self.fixture.points, self.fixture.stiffness)

    @cached_property
    def _wishes(self) -> list[tuple[Session, Array, Array]]:
        """Each session, how far its wish lies ahead (T, 3), and its room to the curve (T,) [m]."""
        found = []
        for session in self.sessions:
            self._true.reset(session.hip[0])
            pull = session.hip - self._true.run(session.hip).proxy
            pushed = pull * self.fixture.stiffness / self.settings.hand_stiffness
            room = self._true.distance(session.hip) - self._radius
            found.append((session, pushed, np.where(pull.any(axis=1), -np.inf, room)))
        return found

    @property
    def _radius(self) -> float:
        return self.fixture.contact_radius + self.fixture.point_radius

    def replay(self, points: Array, trial: int, rng: np.random.Generator) -> Outcome:
        """Render these points (N, 3) [m] to the trial's hand, and look how far the tool came."""
        session, pushed, room = self._wishes[trial % len(self._wishes)]
        hip, stiffness, k_h = session.hip, self.fixture.stiffness, self.settings.hand_stiffness
        if self.settings.stiffness_range is not None:
            stiffness = np.full(3, rng.uniform(*self.settings.stiffness_range))
        if self.settings.tremor_m > 0:
            hip = hip + tremor(session.time, self.settings.tremor_m, rng)
        strayed = float(row_norms(points - self.fixture.points).max())
        near = room < strayed + 3 * self.settings.tremor_m  # elsewhere nothing can touch
        edges = np.flatnonzero(np.diff(near, prepend=False, append=False))
        engine = self._engine(points, stiffness)
        deepest, force, step = (FREE, hip[0]), 0.0, 0.0
        for run in map(slice, edges[::2], edges[1::2]):
            engine.reset(hip[run.start])
            trace = engine.run(hip[run])
            tool = (k_h * (hip[run] + pushed[run]) + stiffness * trace.proxy) / (k_h + stiffness)
            away = trace.proxy - tool
            felt = stiffness * away
            force = max(force, float(row_norms(felt).max()))
            step = max(step, float(row_norms(np.diff(felt, axis=0)).max(initial=0.0)))
            deepest = self._beyond(tool, trace.proxy, trace.normal, strayed, deepest)
        return Outcome(deepest[0], self._point(*deepest), force, step)

    def _beyond(
        self, tool: Array, rendered: Array, normal: Array, strayed: float, deepest: Deepest
    ) -> Deepest:
        """`deepest`, or what of (T, 3) places of the tool lies deeper beyond the true surface.

        The depth is that to the `rendered` surface's proxies (T, 3), and how far these lie inside
        the true one, but for what sampling adds. Where that may lead beyond the deepest place
        found, the true engine follows the tool, from some ticks before on.
        """
        starts = np.arange(0, len(tool), STRETCH)
        inside = self._radius - self._true.native.distance(rendered[::SPARSE].copy())
        most = np.maximum.reduceat(dots(rendered - tool, normal), starts) + ROUGH_M
        most += np.maximum.reduceat(inside, starts // SPARSE) - self.fixture.contact_radius
        for k in np.argsort(-most, kind="stable"):
            if most[k] <= deepest[0]:
                break
            first = max(0, starts[k] - STRETCH)
            outside = rendered[first] + 2 * strayed * normal[first]
            depth, proxy = self._deep(outside, tool[first : starts[k] + STRETCH])
            tick = int(depth.argmax())
            deepest = max(deepest, (float(depth[tick]), proxy[tick]), key=itemgetter(0))
        return deepest

    def _deep(self, start: Array, tool: Array) -> tuple[Array, Array]:
        """(T,) depth beyond the true surface, and (T, 3) the nearest places on it [m]."""
        engine = self._true.native
        engine.reset(start)
        proxy, normal = engine.run(tool)[:2]
        away = proxy - tool
        depth = dots(away, normal) - self.fixture.contact_radius
        return np.where(np.abs(away).max(axis=1) > CONTACT_M, depth, FREE), proxy

    def _point(self, depth: float, proxy: Array) -> int:
        """The true curve's point nearest to where the tool came deepest; -1: nothing touched."""
        if depth == FREE:
            return -1
        away = self.fixture.points - proxy
        if (axis := self.fixture.ignore_axis) is not None:
            away -= np.outer(away @ axis, axis)
        return int(dots(away, away).argmin())


def _registered(fixture: Fixture) -> RegistrationRecord:
    if fixture.frame != "robot_base" or fixture.rendering is None:
        raise SceneError(f"a fixture in frame {fixture.frame!r} renders nothing; robot_base wanted")
    if fixture.guidance is not None:
        raise SceneError("the fixture guides; a campaign tries forbidden regions only")
    if fixture.pieces is not None and fixture.pieces.error > MOST_DEPARTURE_M:
        raise SceneError(
            f"the fixture's lines and arcs lie up to {fixture.pieces.error * 1e3:.3g} mm from the "
            f"curve, and a campaign renders its points; {MOST_DEPARTURE_M * 1e3:g} mm are allowed"
        )
    if fixture.registration is None:
        raise SceneError("the fixture has no registration, so there is nothing to vary")
    if fixture.provenance.settings.get("margin") is not None:
        raise SceneError(
            "the fixture has a margin already, which is not where the curve is: plan it without"
        )
    return fixture.registration


def _apply(T: Array, source: Array) -> Array:
    return (np.column_stack([source, np.ones(len(source))]) @ T.T)[:, :3]


def _back(T: Array, points: Array) -> Array:
    """(N, 2|3) places in the source frame that T carries to `points`."""
    k = T.shape[0] - 1
    return np.linalg.lstsq(T[:3, :k], (points - T[:3, k]).T, rcond=None)[0].T
