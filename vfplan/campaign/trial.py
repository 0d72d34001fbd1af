"""One trial: other marker errors, another registration, another fixture, the same hand's wish.

The truth is the bundle's own: its markers where the registration puts them, its curve where it
stands. A trial draws errors of the markers on both sides and of the curve, fits the registration
anew, carries the curve with it, and renders that fixture to a hand that wants to go where the
session went. Its outcome is how far the tool went beyond the *true* curve.

The hand is a spring k_h towards its wish w, the fixture one of stiffness K towards the proxy p, and
at rest the tool is at x = (k_h w + K p) / (k_h + K). A recorded session holds x; its wish follows
from the same equation with the proxy of the bundle as it is. In a trial the proxy is that of the
recorded x: the tool moves across the surface, by less than the surface does, which leaves the
nearest place on it where it was to second order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vfplan.display import Report
from vfplan.engine.proxy import ProxyEngine
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Fixture, RegistrationRecord
from vfplan.geometry.lines import Array, flattened, row_lengths
from vfplan.registration.models import homogeneous, make_model, make_problem
from vfplan.replaying.metrics import CONTACT_M, dots, row_norms
from vfplan.session.session import Session

# Number of trials in a block, about half a second of work.
BLOCK = 64

# Lower end of the band of physiological tremor [Hz] (Riviere, Gangloff, de Mathelin 2006).
TREMOR_LOWEST_HZ = 8.0

# Upper end of that band [Hz].
TREMOR_HIGHEST_HZ = 12.0


@dataclass(frozen=True)
class CampaignSettings:
    """What differs from trial to trial. What is `None` or 0 does not differ.

    Parameters
    ----------
    seed
        At least 0. Trial k draws from Philox keyed by (seed, k), whatever the others do.
    fle_image_px
        RMS distance [px] of a marker's picked pixel from its true one.
    fle_robot_m
        RMS distance [m] of a touched marker from its true place; `None`: as the residuals of the
        fixture's own registration say, all of it on this side.
    tremor_m
        RMS distance [m] of the hand from where it wants to be, at 8 to 12 Hz.
    stiffness_range
        Smallest and largest K [N/m] of the rendering, drawn evenly; `None`: the fixture's own.
    hand_stiffness
        k_h [N/m] of the hand that follows the session: a firm grip is 300 to 1000 N/m.

    Raises
    ------
    SettingError
        A stiffness range outside its own.
    """

    seed: int = 0
    fle_image_px: float = 0.0
    fle_robot_m: float | None = None
    tremor_m: float = 0.0
    stiffness_range: tuple[float, float] | None = None
    hand_stiffness: float = 500.0

    def __post_init__(self) -> None:
        low, high = self.stiffness_range or (1.0, 1.0)
        if not (0 < low <= high <= 1e6):
            raise SettingError(
                f"stiffness range is {low:g},{high:g}. Give A,B with 0 < A <= B <= 1e6 N/m",
                code="stiffness-range",
            )


def tremor(time: Array, rms_m: float, rng: np.random.Generator) -> Array:
    """(T, 3) [m] a sum of three waves of 8 to 12 Hz along each axis, of `rms_m` in all."""
    hz = rng.uniform(TREMOR_LOWEST_HZ, TREMOR_HIGHEST_HZ, (3, 3))
    phase = rng.uniform(0, 2 * np.pi, (3, 3))
    waves = np.sin(2 * np.pi * hz * time[:, None, None] + phase).sum(axis=2)
    return rms_m * np.sqrt(2.0 / 9.0) * waves


def fle_of(record: RegistrationRecord) -> float:
    """RMS localisation error [m] of a marker, from the residuals of a registration.

    Raises
    ------
    SettingError
        Too few markers to estimate their error from.
    """
    count, dimension = record.source.shape
    degrees_of_freedom = 3 * count - make_model(record.model, dimension, 1.0).parameters
    if degrees_of_freedom < 1:
        raise SettingError(
            f"{count} markers leave nothing to estimate their error from. Give --fle-robot MM",
            code="no-fle",
        )
    return float(np.sqrt(3 * (record.residuals_m**2).sum() / degrees_of_freedom))


# A campaign renders the points of a fixture, and its lines and arcs may lie this far from them [m].
MAX_DEPARTURE_M = 1e-5

# Number of ticks in which the true engine follows the tool before it begins anew.
STRETCH_TICKS = 16

# The depth of a trial in which nothing was touched [m].
NEVER_TOUCHED_M = -1.0


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
        record = checked_registration(fixture)
        self.fixture, self.sessions = fixture, sessions
        fle_m = fle_of(record) if settings.fle_robot_m is None else settings.fle_robot_m
        self.settings = replace(settings, fle_robot_m=fle_m)

        # The true markers: the image's, and where the registration puts them.
        T = record.T_robot_image
        target = (homogeneous(record.source) @ T.T)[:, :3]

        # The true curve in the source frame, as T carries it to the fixture's points.
        k = T.shape[0] - 1
        curve = np.linalg.lstsq(T[:3, :k], (fixture.points - T[:3, k]).T, rcond=None)[0].T

        spacing_mm = getattr(fixture.image, "pixel_spacing_mm", None)
        spacing_m = spacing_mm and tuple(1e-3 * mm for mm in spacing_mm)
        self._markers = make_problem(record.source, target, record.model, spacing_m, None, None)
        self._along = homogeneous(self._markers.normaliser(curve))

    def run(self, trial: int) -> Report:
        """One trial as a row of the campaign's table.

        It holds how far the tool went beyond the true curve's surface at most (below 0 it never
        did), the true curve's point nearest to where that was (-1 where nothing was touched), the
        largest force, and its largest change in a tick.
        """
        rng = np.random.Generator(np.random.Philox(key=[self.settings.seed, trial]))
        return {"trial": trial} | self.replay(self.planned(rng), trial, rng)

    def planned(self, rng: np.random.Generator) -> Array:
        """The fixture's points (N, 3) [m] with the errors that are drawn."""
        # The markers as they are picked and touched.
        true, source = self._markers, self.fixture.registration.source
        axis_image = self.settings.fle_image_px / np.sqrt(source.shape[1])
        axis_robot = self.settings.fle_robot_m / np.sqrt(3.0)
        source = source + axis_image * rng.standard_normal(source.shape)
        target = true.y + axis_robot * rng.standard_normal(true.y.shape)
        problem = replace(true, s=true.normaliser(source), y=target)

        # The curve by the registration that they give.
        m = problem.model.solve(problem.s, problem.y, problem.weights)
        points = self._along @ m.T + problem.normaliser.target_centre
        if self.fixture.sigma is not None:
            shifts = self.fixture.sigma * rng.standard_normal(len(points))
            points += shifts[:, None] * self._across
        return points

    @cached_property
    def _across(self) -> Array:
        """(N, 3) unit vectors across the curve, in its plane."""
        normal = self.fixture.ignore_axis
        if normal is None:
            centred = self.fixture.points - self.fixture.points.mean(axis=0)
            normal = np.linalg.svd(centred, full_matrices=len(centred) < 3)[2][2]
        across = np.cross(np.gradient(self.fixture.points, axis=0), normal)
        return across / np.maximum(row_lengths(across), 1e-300)[:, None]

    def _engine(self, points: Array, stiffness: Array) -> ProxyEngine:
        """An engine that renders points as the fixture's own are."""
        rendering = self.fixture.rendering
        return ProxyEngine(
            points, rendering.contact_radius, rendering.band, rendering.point_radius, stiffness,
            ignore_axis=rendering.ignore_axis, max_iterations=rendering.max_iterations,
        )  # fmt: skip

    @cached_property
    def _true_engine(self) -> ProxyEngine:
        """The engine of the true curve."""
        return self._engine(self.fixture.points, self.fixture.stiffness)

    @cached_property
    def _ahead(self) -> list[Array]:
        """(T, 3) how far the wish of each session's hand lies ahead of the tool [m]."""
        ahead = []
        for session in self.sessions:
            self._true_engine.reset(session.hip[0])
            pull = session.hip - self._true_engine.run(session.hip).proxy
            ahead.append(pull * self.fixture.stiffness / self.settings.hand_stiffness)
        return ahead

    def replay(self, points: Array, trial: int, rng: np.random.Generator) -> Report:
        """Render these points (N, 3) [m] to the trial's hand, and measure how far the tool goes."""
        number = trial % len(self.sessions)
        session, hip = self.sessions[number], self.sessions[number].hip
        stiffness, hand = self.fixture.stiffness, self.settings.hand_stiffness
        if self.settings.stiffness_range is not None:
            stiffness = np.full(3, rng.uniform(*self.settings.stiffness_range))
        if self.settings.tremor_m > 0:
            hip = hip + tremor(session.time, self.settings.tremor_m, rng)
        engine = self._engine(points, stiffness)
        engine.reset(hip[0])
        trace = engine.run(hip)
        tool = (hand * (hip + self._ahead[number]) + stiffness * trace.proxy) / (hand + stiffness)
        forces = stiffness * (trace.proxy - tool)

        # The true engine follows the tool. It begins each stretch anew, some ticks earlier and
        # outside the true surface, because the tool may pass an end of the true curve on a side
        # on which the rendered one kept it.
        shift = float(row_norms(points - self.fixture.points).max())
        proxy, normal = np.empty_like(tool), np.empty_like(tool)
        for start in range(0, len(tool), STRETCH_TICKS):
            first, end = max(0, start - STRETCH_TICKS), start + STRETCH_TICKS
            self._true_engine.reset(trace.proxy[first] + 2 * shift * trace.normal[first])
            true = self._true_engine.run(tool[first:end])
            proxy[start:end] = true.proxy[start - first :]
            normal[start:end] = true.normal[start - first :]
        pull = proxy - tool
        depth = dots(pull, normal) - self.fixture.contact_radius
        depth[np.abs(pull).max(axis=1) <= CONTACT_M] = NEVER_TOUCHED_M
        tick, point = int(depth.argmax()), -1
        if depth[tick] != NEVER_TOUCHED_M:
            # The true curve's point nearest to the deepest place.
            place = flattened(proxy[tick] - self.fixture.points, self.fixture.ignore_axis)
            point = int(row_norms(place).argmin())
        return {
            "depth_m": float(depth[tick]), "point": point,
            "force_n": float(row_norms(forces).max()),
            "force_step_n": float(row_norms(np.diff(forces, axis=0)).max()),
        }  # fmt: skip


def checked_registration(fixture: Fixture) -> RegistrationRecord:
    """The registration of a fixture that a campaign can vary.

    Raises
    ------
    SceneError
        It is no such fixture.
    """
    if fixture.frame != "robot_base" or fixture.rendering is None:
        raise SceneError(
            f"a fixture in frame {fixture.frame!r} renders nothing. Give one in robot_base",
            code="not-rendered",
        )
    if fixture.guidance is not None:
        raise SceneError(
            "the fixture guides, and a campaign tries forbidden regions only. Give one "
            "without a guide",
            code="guide",
        )
    if fixture.pieces is not None and fixture.pieces.error > MAX_DEPARTURE_M:
        raise SceneError(
            f"the fixture's lines and arcs lie up to {1e3 * fixture.pieces.error:.3g} mm "
            "from the curve, and a campaign renders its points. Plan with --arcs "
            f"{1e3 * MAX_DEPARTURE_M:g}",
            code="arcs-too-far", numbers={"error_m": fixture.pieces.error},
        )  # fmt: skip
    if fixture.registration is None:
        raise SceneError(
            "the fixture has no registration, so there is nothing to vary. Plan or register it",
            code="no-registration",
        )
    if fixture.provenance.settings.get("margin") is not None:
        raise SceneError(
            "the fixture has a margin, so it does not lie where the curve is. Plan it without",
            code="has-margin",
        )
    return fixture.registration
