"""`ProxyEngine`: the native engine as a Python object, and which rule it renders a fixture with.

Everything is checked here and in `vfplan.engine.parameters`, and then handed to C++. A tick
computes nothing in Python.

The format allows any radius above 0, a stiffness of 0, and any band below R. float64 serves a
narrower range (docs/engine.md). A bundle outside that range is sound, but no robot renders it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import IntFlag
from inspect import signature
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from vfplan import _core
from vfplan.engine.parameters import (
    ProxyParameters,
    Rule,
    Vector,
    check_pieces,
    check_points,
    check_range,
    check_triangles,
    core_errors,
    real_array,
)
from vfplan.errors import SceneError, SettingError
from vfplan.findings import Finding, doubt, note
from vfplan.fixture import Fixture, Pieces
from vfplan.geometry.lines import Array


class Status(IntFlag):
    """What a tick has to say beside its result; 0 when all is well."""

    OK = 0
    # The HIP was not finite, or beyond 1e6 m. The proxy stayed, and the force is the last one.
    #
    # Before the first good HIP proxy and force are 0.
    BAD_HIP = 1
    # The proxy is inside the fixture and on its way out.
    INSIDE = 2
    # The tick used up its iterations. The proxy is safe and goes on at the next tick.
    LIMIT = 4
    # The moving fixture's pose is too old, and its last frame stands.
    #
    # Before the first pose nothing is rendered.
    STALE = 8
    # The fixture was exchanged or edited, and the force is on its way to K (proxy - HIP).
    CHANGING = 16
    # With INSIDE: no way out was found on the side where the proxy was before the exchange. Of a
    # `Controller` also: a reset was beyond a wall from where the proxy was before.
    CROSSED = 32
    # The HIP was further than `max_hip_step` from the last good one. Proxy and force stay as they
    # are until it is back, or until a reset.
    JUMPED = 64
    # Of a `Controller`: the fixtures' force is larger than the governor's limits let it be.
    CAPPED = 128


@dataclass(frozen=True, eq=False)
class Step:
    """The answer of one tick.

    Parameters
    ----------
    proxy, normal, force
        (3,) proxy position [m], unit normal (0 when there is none), force on the hand [N]. After a
        proxy has come out of a mesh, and while the status has `INSIDE`, the normal is that of the
        end of its way.
    state
        -1 no neighbour, 0 free motion, 1 in contact, 2 entrenched.
    status
        A `Status`.
    """

    proxy: Vector
    normal: Vector
    force: Vector
    state: int
    status: Status


class Trace(Step):
    """The answer to a path: the fields of `Step`, with one row a tick.

    `state` is (T,) int8 and `status` (T,) uint8.
    """

    def __len__(self) -> int:
        return len(self.state)

    def first(self) -> Step:
        """The answer of the first tick."""
        state, status = int(self.state[0]), Status(int(self.status[0]))
        return Step(self.proxy[0], self.normal[0], self.force[0], state, status)

    @classmethod
    def of(cls, steps: list[Step]) -> Trace:
        """The trace of steps that follow each other."""
        rows = [np.reshape([getattr(step, name) for step in steps], (-1, 3))
                for name in ("proxy", "normal", "force")]  # fmt: skip
        states = np.array([step.state for step in steps], np.int8)
        return cls(*rows, states, np.array([step.status for step in steps], np.uint8))


def check_path(hips: ArrayLike, name: str = "hips") -> Vector:
    """HIP positions as (T, 3) contiguous float64 [m].

    Positions that are not finite are left to the engine. Raises `SceneError` for another shape.
    """
    path = real_array(hips, name)
    if path.ndim != 2 or path.shape[1] != 3:
        raise SceneError(f"{name} has shape {path.shape}. Give one position a row: (T, 3).")
    return path


def check_hip(hip: ArrayLike, name: str = "hip", *, finite: bool = False) -> Vector:
    """One position as (3,) float64 [m].

    Raises `SceneError` for another shape. With `finite` it also raises it for NaN, infinity, and a
    coordinate beyond 1e6 m.
    """
    position = real_array(hip, name)
    if position.shape != (3,):
        raise SceneError(f"{name} has shape {position.shape}. Give x, y and z: (3,).")
    if finite:
        check_range(position[None, :], name)
    return position


# Longest tick that a loop of 1 kHz can wait for [s].
MAX_TICK_TIME = _core.max_tick_time

# Largest band of a cloud that is no finding, as a share of R.
#
# A wider band shows that the points are rough or far apart. The tool may sink by that much.
MAX_BAND_SHARE = 0.01


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
            fixture.points, band=fixture.band, max_iterations=fixture.max_iterations,
            **settings_of(fixture),
        )  # fmt: skip
    except SettingError as error:
        raise SceneError(f"no engine renders it: {error.message}", numbers=error.numbers) from error


def settings_of(fixture: Fixture) -> dict[str, Any]:
    """The parameters that a fixture gives to the engine of any rule."""
    names = ("contact_radius", "point_radius", "stiffness", "ignore_axis")
    return {name: getattr(fixture, name) for name in names}


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
    same way (`vfplan::bundle::best_rule`).

    Raises `SceneError` for a mesh that no engine takes.
    """
    shape = exact_shape(fixture)
    is_fast = shape == "mesh" and tick_time_bound(fixture, "exact") <= MAX_TICK_TIME
    return "exact" if shape == "curve" or is_fast else "robust"


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
    surface = check_triangles(fixture.points, fixture.mesh)
    with core_errors(SceneError):
        points, mesh = _core.sampled(*surface, fixture.sample_radius)
    # The errors are those of the corners alone.
    registration = fixture.registration and replace(fixture.registration, tre_m=None)
    return replace(
        fixture, points=points, mesh=mesh, sigma=None, registration=registration, sample_radius=None
    )


def as_rendered(fixture: Fixture, rule: Rule) -> Fixture:
    """The fixture whose points a rule renders: of a mesh its samples, unless rule "exact" does."""
    return fixture if rule == "exact" else sampled(fixture)


def mesh_findings(fixture: Fixture) -> Iterator[Finding]:
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
        return
    radius = fixture.contact_radius + fixture.point_radius
    rule = best_rule(fixture)
    if rule == "exact" and exact_shape(fixture) == "mesh":
        triangles = check_triangles(fixture.points, fixture.mesh)
        count, sagitta = _core.coarse_facets(*triangles, check_renderable(fixture))
        if count > 0:
            text = (
                f"The mesh has {count} facets that are too coarse to be smoothed: the body they "
                f"stand for is up to {1e3 * sagitta:.3g} mm away from them, and at most "
                f"{50 * radius:.3g} mm (R / 20) can be smoothed. The tool will feel their edges. "
                "Import a finer mesh."
            )
            yield doubt("mesh-coarse", "import", text)
    if rule == "robust" and fixture.band > MAX_BAND_SHARE * radius:
        text = (
            f"The band is {1e3 * fixture.band:.3g} mm, {100 * fixture.band / radius:.2g} % of R: "
            "the points are rough or far apart, and the tool may sink by that much. Import denser "
            "or smoother points."
        )
        yield note("band-wide", "import", text)


def tick_time_bound(fixture: Fixture, rule: Rule | None = None) -> float:
    """The longest time that a tick may take [s], with the best rule unless one is given.

    It follows from counts: a rule stops a tick at its budget, and ends the iteration under way
    (the C++ header tick_time.hpp, docs/engine.md).

    Raises `SceneError` for a rendering that no engine takes.
    """
    parameters = check_renderable(fixture)
    rule = rule or best_rule(fixture)
    if rule != "exact":
        return _core.tick_time_bound(check_points(sampled(fixture).points), parameters)
    if exact_shape(fixture) == "mesh":
        return _core.tick_time_bound(*check_triangles(fixture.points, fixture.mesh), parameters)
    return _core.tick_time_bound(*check_pieces(fixture.region.pieces), parameters)


def slow_tick_text(fixture: Fixture, rule: Rule | None = None) -> str | None:
    """Why a loop of 1 kHz cannot wait for a fixture's ticks; `None` where it can."""
    seconds = tick_time_bound(fixture, rule)
    if seconds <= MAX_TICK_TIME:
        return None
    return (
        f"a tick may take {1e6 * seconds:.0f} us, and at most {1e6 * MAX_TICK_TIME:.0f} us are "
        "given at 1 kHz: too many points or pieces around one place. Give fewer points there."
    )


TOO_MANY_CHANGES = "4096 changes wait for a step, and no more can. Let the engine step first."


class ProxyEngine:
    """Renders a forbidden region around a cloud of points: proxy, normal and force for each HIP.

    Until `reset` is called the first HIP is also the first proxy.

    Parameters
    ----------
    points
        (N, 3) cloud [m].
    contact_radius, band, point_radius, stiffness, rule, ignore_axis, outer_radius, gain
        Table I; see `ProxyParameters.make`.
    max_iterations, search, max_hip_step
        As `ProxyParameters.make`, and by name only.

    Raises
    ------
    SettingError
        A parameter outside its range.
    SceneError
        Points that are no finite (N, 3) cloud.
    """

    # Status of the last tick.
    status: Status = Status.OK

    __signature__ = signature(ProxyParameters.make).replace(return_annotation=None)
    _real_time = False  # Whether the engine was made for a loop that cannot wait.
    _frame: str | None = None  # That of the fixture, where the engine was made of one.
    _is_editable = False  # Whether the native engine takes edits.

    def __init__(self, points: ArrayLike, *table: Any, **settings: Any) -> None:
        cloud = check_points(points)
        self.parameters = ProxyParameters.make(cloud, *table, **settings)
        if self.rule == "exact":
            raise SettingError("rule 'exact' renders no points. Use ProxyEngine.of, .along or .on.")
        self._points = len(cloud)
        self._source = cloud.copy()
        # Checks nothing; for a loop in Python at full speed.
        self.native = _core.Engine(cloud, self.parameters)

    @classmethod
    def of(
        cls,
        fixture: Fixture,
        rule: Rule | None = None,
        *,
        offline: bool = False,
        max_hip_step: float = 0.0,
    ) -> ProxyEngine:
        """The engine of a fixture, with the rendering that the fixture asks for.

        Parameters
        ----------
        rule
            `None`: "exact" where the fixture knows its curve, else "robust". Rule "paper" has its
            own band. Of a mesh, rules "robust" and "paper" render samples (`sampled`).
        offline
            Takes ticks of any length, for a replay or a study, which can wait.
        max_hip_step
            As `ProxyParameters.make`.

        Raises
        ------
        SceneError
            No rendering, or one that no engine takes; strokes that guide; rule "exact" without what
            it renders; so much around one place that a tick may take too long for 1 kHz.
        """
        check_renderable(fixture)
        if fixture.guidance is not None:
            raise SceneError(
                "the fixture guides. Make its guide with vfplan.Guide.of, and an engine of "
                "fixture.forbidden."
            )
        rule = rule or best_rule(fixture)
        shape = exact_shape(fixture)
        if rule == "exact" and shape is None:
            raise SceneError(
                "rule 'exact' needs a curve of pieces and an axis, or a mesh without one. Take "
                "rule 'robust' for this fixture."
            )
        drawn, fixture = fixture, as_rendered(fixture, rule)
        if not offline and (slow := slow_tick_text(fixture, rule)):
            raise SceneError(slow)
        settings = settings_of(fixture) | {"max_hip_step": max_hip_step}
        if rule != "exact":
            engine = cls(
                fixture.points, band=None if rule == "paper" else fixture.band, rule=rule,
                max_iterations=fixture.max_iterations, **settings,
            )  # fmt: skip
            engine._real_time = not offline
            if drawn.mesh is not None:
                engine.native.set_skin(*check_triangles(drawn.points, drawn.mesh))
        elif shape == "curve":
            engine = cls.along(fixture.pieces, **settings)
        else:
            del settings["ignore_axis"]
            engine = cls.on(fixture.points, fixture.mesh, **settings)
        engine._frame = fixture.frame
        return engine

    @classmethod
    def along(
        cls,
        pieces: Pieces,
        contact_radius: float = 5e-3,
        point_radius: float = 0.0,
        stiffness: float | ArrayLike = 1000.0,
        ignore_axis: str | ArrayLike | None = "z",
        outer_radius: float | None = None,
        max_hip_step: float = 0.0,
    ) -> ProxyEngine:
        """Rule "exact": an engine that renders lines and arcs [m] as they are.

        The settings are those of the class, and an axis must be ignored. Raises as the class does.
        """
        shape = check_pieces(pieces)
        if ignore_axis is None:
            raise SettingError(
                "ignore_axis is None, and lines and arcs are planar. Name the axis across which "
                "they lie."
            )
        table = (contact_radius, None, point_radius, stiffness, "exact", ignore_axis, outer_radius)
        return cls._with_shape(shape, table, max_hip_step)

    @classmethod
    def on(
        cls,
        points: ArrayLike,
        triangles: ArrayLike,
        contact_radius: float = 5e-3,
        point_radius: float = 0.0,
        stiffness: float | ArrayLike = 1000.0,
        outer_radius: float | None = None,
        max_hip_step: float = 0.0,
    ) -> ProxyEngine:
        """Rule "exact": an engine that renders triangles, from both sides.

        `points` are the corners (N, 3) [m], and `triangles` (K, 3) are rows of them. The settings
        are those of the class. Raises as the class does.
        """
        table = (contact_radius, None, point_radius, stiffness, "exact", None, outer_radius)
        return cls._with_shape(check_triangles(points, triangles), table, max_hip_step)

    @classmethod
    def _with_shape(
        cls, shape: tuple[Any, ...], table: tuple[Any, ...], max_hip_step: float
    ) -> ProxyEngine:
        """The engine of rule "exact" on what `check_pieces` or `check_triangles` returned."""
        parameters = ProxyParameters.make(shape[0], *table, max_hip_step=max_hip_step)
        engine = cls.__new__(cls)
        engine._points = len(shape[0])
        engine._source = None
        engine.native = _core.Engine(*shape, parameters)
        engine.parameters = ProxyParameters(parameters, band=engine.native.band)
        return engine

    @property
    def rule(self) -> Rule:
        """The rule that moves the proxy."""
        return self.parameters.rule

    @property
    def left_out(self) -> dict[str, int]:
        """What this scene did not need, and how much of it. What it needed has no key."""
        counts = {}
        if self.parameters.ignore_axis is not None:
            counts["coordinates"] = self._points  # One of three of each point.
        if self.parameters.point_radius == 0:
            counts["point_radius"] = 1
        if np.ptp(self.parameters.stiffness) == 0:
            counts["stiffness_axes"] = 2
        if self.native.cells == 0:
            counts["grid"] = 1
        return counts

    def reset(self, hip: ArrayLike) -> None:
        """Put the proxy at `hip` (3,) [m], wherever that is."""
        self.native.reset(check_hip(hip, finite=True))

    def step(self, hip: ArrayLike) -> Step:
        """One tick for the HIP at `hip` (3,) [m]."""
        return self.run(check_hip(hip)[None]).first()

    def run(self, hips: ArrayLike) -> Trace:
        """One tick for each row of `hips` (T, 3) [m], from the present proxy on.

        Other threads of Python run meanwhile.
        """
        return self.run_timed(hips)[0]

    def run_timed(self, hips: ArrayLike) -> tuple[Trace, Array]:
        """As `run`, and how long each tick took, (T,) [µs], read around the native `step`."""
        *answer, seconds = self.native.run(check_path(hips))
        trace = Trace(*answer)
        if len(trace) > 0:
            self.status = Status(int(trace.status[-1]))
        return trace, 1e6 * seconds

    def exchange(self, other: ProxyEngine | Fixture) -> None:
        """Go on with another engine's fixture from the next step on. `other` is then spent.

        The proxy goes on from where it is. Where that is inside, it is led out on its own side if
        there is a way; else the status has CROSSED. Until the rule has taken over, the status is
        CHANGING, and the force changes by at most K (R / 256 + |step of the HIP|) and 1 N in a
        tick; K is the larger of both. In free space the old force is gone within 0.1 s.
        A thread may call this while another one steps.

        Raises
        ------
        SceneError
            A fixture that no engine takes, or one in another frame, or 4096 changes that wait for
            a step.
        """
        engine = ProxyEngine.of(other) if isinstance(other, Fixture) else other
        if not isinstance(engine, ProxyEngine):
            kind = type(other).__name__
            raise SceneError(f"exchange for {kind}. Give another ProxyEngine, or a Fixture.")
        if engine is self:
            raise SceneError("exchange for itself. Give another ProxyEngine, or a Fixture.")
        if None not in (self._frame, engine._frame) and self._frame != engine._frame:
            raise SceneError(
                f"exchange of a fixture in frame {self._frame!r} for one in {engine._frame!r}. "
                "Give one in the same frame.",
                code="exchange-frame",
            )
        if not self.native.exchange(engine.native):
            raise SceneError(f"exchange: {TOO_MANY_CHANGES}")
        self._frame = self._frame or engine._frame
        self.parameters = engine.parameters
        self._points = engine._points
        self._source = engine._source
        self._is_editable = engine._is_editable

    def edit(self, remove: ArrayLike | None = None, add: ArrayLike | None = None) -> bool:
        """Take points of the cloud away and add others, from the next step on.

        A step takes up at most 64 changes. While some wait, and until the force is there, the
        status is CHANGING. A thread may call this while another one steps. Returns False where so
        many wait that this edit will go with the next one.

        Parameters
        ----------
        remove
            (n,) numbers of points, as they were given first. Added points are numbered on from
            there.
        add
            (m, 3) points [m].

        Raises
        ------
        SceneError
            Numbers of points that are not there; points out of range, or so close together that a
            tick would take too long; no point that remains; rule "exact", which renders no points.
        """
        removed = np.asarray([] if remove is None else remove)
        if removed.ndim != 1 or (removed.size > 0 and removed.dtype.kind not in "iu"):
            raise SceneError(
                f"remove has shape {removed.shape} and type {removed.dtype}. Give the numbers of "
                "the points as (n,) integers."
            )
        # The core refuses the number that no point has.
        removed = np.where((removed < 0) | (removed >= 2**32), 2**32 - 1, removed)
        added = np.empty((0, 3)) if add is None or np.size(add) == 0 else check_points(add)
        self.make_editable()
        with core_errors(SceneError):
            is_taken = self.native.edit(removed.astype(np.uint32), added)
        self._points += len(added) - len(removed)
        return is_taken

    def make_editable(self) -> None:
        """Exchange the native engine for one whose points can be edited, as the first `edit` does.

        Raises `SceneError` for rule "exact", and for a cloud that only thinning makes fit for
        1 kHz.
        """
        if self.rule == "exact":
            raise SceneError("edit: rule 'exact' renders no points to edit. Take rule 'robust'.")
        if self._is_editable:
            return
        points = self._source
        parameters = ProxyParameters(self.parameters, search="editable")
        if self._real_time and _core.tick_time_bound(points, parameters) > MAX_TICK_TIME:
            raise SceneError(
                "edit: so dense a cloud is thinned for 1 kHz, and a thinned one cannot be edited. "
                "Make the engine with offline=True, or of fewer points."
            )
        if not self.native.exchange(_core.Engine(points, parameters)):
            raise SceneError(f"edit: {TOO_MANY_CHANGES}")
        self._source = None
        self._is_editable = True

    def distance(self, positions: ArrayLike) -> Array:
        """Distance (T,) [m] of `positions` (T, 3) [m] from the fixture, across an ignored axis.

        It is measured to the curve or the triangles under rule "exact", else to the nearest point.
        Less R it is the clearance.
        """
        return self.native.distance(check_path(positions))
