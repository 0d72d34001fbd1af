"""The proxy engine: a thin Python face over the native one.

Everything is checked here (`vfplan.engine.parameters`), then handed to C++; a tick computes
nothing in Python.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.engine import renderable as allowed
from vfplan.engine.parameters import ProxyParameters, Rule, Search, check_points
from vfplan.engine.ticks import Status, Step, Trace, check_edit, check_hip, check_path
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Fixture, Pieces

WIDTHS = {None: 0, 2: 2, 4: 4, 8: 8}  # float64 in a SIMD register; None: the processor's most


class ProxyEngine:
    """Renders a forbidden region around a cloud of points: proxy, normal and force for each HIP.

    Until `reset` is called the first HIP is also the first proxy.

    Parameters
    ----------
    points
        (N, 3) cloud [m].
    contact_radius, band, point_radius, stiffness, rule, ignore_axis, outer_radius, gain
        Table I; see `ProxyParameters.make`.
    max_iterations
        Most iterations of rule "robust" in a tick, at least 1; `None`: 16.
    search
        "grid", "brute" (every point, every time) or "auto": a grid where one pays.
    simd_width
        2, 4 or 8 float64 at a time, at most what the processor has; `None`: its most. Same bits.

    Raises
    ------
    SettingError
        A parameter outside its range.
    SceneError
        Points that are no finite (N, 3) cloud.
    """

    status = Status.OK  # of the last step
    _real_time = False  # made for a loop that cannot wait

    def __init__(
        self,
        points: ArrayLike,
        contact_radius: float = 5e-3,
        band: float | None = None,
        point_radius: float = 0.0,
        stiffness: float | ArrayLike = 1000.0,
        rule: Rule = "robust",
        ignore_axis: str | ArrayLike | None = None,
        outer_radius: float | None = None,
        gain: float = 1.0,
        *,
        max_iterations: int | None = None,
        search: Search = "auto",
        simd_width: int | None = None,
    ) -> None:
        if rule == "exact":
            raise SettingError("rule 'exact' renders no points: use ProxyEngine.of")
        cloud = check_points(points)
        self.parameters = ProxyParameters.make(
            cloud,
            contact_radius=contact_radius,
            band=band,
            point_radius=point_radius,
            stiffness=stiffness,
            rule=rule,
            ignore_axis=ignore_axis,
            outer_radius=outer_radius,
            gain=gain,
        )
        if not isinstance(simd_width, int | np.integer | None) or simd_width not in WIDTHS:
            raise SettingError(f"simd_width {simd_width!r}: allowed are None, 2, 4, 8")
        native = self.parameters.native(max_iterations, search)
        self._points = len(cloud)
        self._source = cloud.copy(), native, WIDTHS[simd_width]
        self._engine = _core.Engine(cloud, native, WIDTHS[simd_width])

    @classmethod
    def of(
        cls, fixture: Fixture, rule: Rule | None = None, *, offline: bool = False
    ) -> ProxyEngine:
        """The engine of a fixture, with the rendering that the fixture asks for.

        Parameters
        ----------
        rule
            `None`: "exact" where the fixture knows its curve, else "robust". Rule "paper" has its
            own band. Of a mesh, rules "robust" and "paper" render samples (`renderable.sampled`).
        offline
            For a replay or a study, which can wait: takes ticks of any length.

        Raises
        ------
        SceneError
            No rendering, one that no engine takes, strokes that guide, rule "exact" without what
            it renders, or so much around one place that a tick may take too long for 1 kHz.
        """
        allowed.check_renderable(fixture)
        if fixture.guidance is not None:
            raise SceneError(
                "the fixture guides: vfplan.Guide.of makes the guide, and of fixture.forbidden "
                "an engine is made"
            )
        rule = rule or allowed.best_rule(fixture)
        names = "contact_radius", "point_radius", "stiffness", "ignore_axis"
        settings = {name: getattr(fixture, name) for name in names}
        kind = allowed.exact_of(fixture)
        if rule == "exact" and kind is None:
            raise SceneError("rule 'exact': needs a curve of pieces and an axis, or a mesh without")
        fixture = allowed.as_rendered(fixture, rule)
        if not offline and (doubt := allowed.work_doubt(fixture, rule)) is not None:
            raise SceneError(doubt)
        if rule == "exact" and kind == "curve":
            return cls.along(fixture.pieces, **settings)
        if rule == "exact":
            del settings["ignore_axis"]
            return cls.on(fixture.points, fixture.mesh, **settings)
        settings["band"] = None if rule == "paper" else fixture.band
        self = cls(fixture.points, rule=rule, max_iterations=fixture.max_iterations, **settings)
        self._real_time = not offline
        return self

    @classmethod
    def along(
        cls,
        pieces: Pieces,
        contact_radius: float = 5e-3,
        point_radius: float = 0.0,
        stiffness: float | ArrayLike = 1000.0,
        ignore_axis: str | ArrayLike | None = "z",
        outer_radius: float | None = None,
    ) -> ProxyEngine:
        """Rule "exact": an engine that renders lines and arcs [m] as they are.

        Settings are as for the class, an axis must be ignored; raises as it does.
        """
        shape = allowed.check_pieces(pieces)
        if ignore_axis is None:
            raise SettingError("lines and arcs are planar: ignore_axis None; allowed is an axis")
        return cls._exact(shape, contact_radius, point_radius, stiffness, ignore_axis, outer_radius)

    @classmethod
    def on(
        cls,
        points: ArrayLike,
        triangles: ArrayLike,
        contact_radius: float = 5e-3,
        point_radius: float = 0.0,
        stiffness: float | ArrayLike = 1000.0,
        outer_radius: float | None = None,
    ) -> ProxyEngine:
        """Rule "exact": an engine that renders triangles, from both sides.

        Corners (N, 3) [m], (K, 3) rows of them, and settings as for the class; raises as it does.
        """
        shape = allowed.check_triangles(points, triangles)
        return cls._exact(shape, contact_radius, point_radius, stiffness, None, outer_radius)

    @classmethod
    def _exact(cls, shape: tuple, rc: float, rv: float, k: ArrayLike, axis, r3) -> ProxyEngine:
        """Of what `check_pieces` or `check_triangles` gives."""
        self = cls.__new__(cls)
        made = ProxyParameters.make(shape[0], rc, None, rv, k, "exact", axis, r3)
        self._points, self._source = len(shape[0]), None
        self._engine = _core.Engine(*shape, made.native())
        self.parameters = replace(made, band=self._engine.band)
        return self

    @property
    def rule(self) -> Rule:
        """Which rule moves the proxy."""
        return self.parameters.rule

    @property
    def native(self) -> _core.Engine:
        """The engine behind it, which checks nothing; for a loop in Python at full speed."""
        return self._engine

    @property
    def left_out(self) -> dict[str, int]:
        """What this scene did not need, and how much of it was left out; absent: nothing was."""
        p = self.parameters
        out = {}
        if p.ignore_axis is not None:
            out["coordinates"] = self._points  # one of three, of each point
        if p.point_radius == 0:
            out["point_radius"] = 1
        if np.all(p.stiffness == p.stiffness[0]):
            out["stiffness_axes"] = 2
        if self._engine.cells == 0:
            out["grid"] = 1
        return out

    @property
    def bytes(self) -> int:
        """Memory the native engine holds [bytes]."""
        return self._engine.bytes

    def reset(self, hip: ArrayLike) -> None:
        """Put the proxy at `hip` (3,) [m], wherever that is."""
        self._engine.reset(check_hip(hip, finite=True))

    def step(self, hip: ArrayLike) -> Step:
        """One servo loop for the HIP at `hip` (3,) [m]."""
        rows, state, status = self._engine.step(check_hip(hip))
        self.status = Status(status)
        return Step(rows[0], rows[1], rows[2], state, self.status)

    def run(self, hips: ArrayLike) -> Trace:
        """One tick for each row of `hips` (T, 3) [m], from the current proxy on; no GIL held."""
        trace = Trace(*self._engine.run(check_path(hips))[:5])
        self.status = Status(int(trace.status[-1])) if len(trace) else self.status
        return trace

    def run_timed(self, hips: ArrayLike) -> tuple[Trace, NDArray[np.float64]]:
        """As `run`, and how long each tick took, (T,) [µs], read around the native `step`."""
        *answer, seconds = self._engine.run(check_path(hips), timed=True)
        return Trace(*answer), 1e6 * seconds

    def exchange(self, other: ProxyEngine | Fixture) -> None:
        """Go on with another engine's fixture, from the next step on; `other` is then spent.

        The proxy goes on from where it is. Where that is inside, it is led out from there, on its
        own side where there is a way (else the status has CROSSED). Until
        the rule has taken over the force changes by at most K (R / 256 + |step of the HIP|) a tick,
        and the status is CHANGING. A thread of its own may call this while another one steps.

        Raises
        ------
        SceneError
            A fixture that no engine takes; 4096 changes wait for a step.
        """
        made = ProxyEngine.of(other) if isinstance(other, Fixture) else other
        if not isinstance(made, ProxyEngine) or made is self:
            what = "itself" if made is self else type(other).__name__
            raise SceneError(f"exchange: for {what}; another ProxyEngine or a Fixture is wanted")
        if not self._engine.exchange(made._engine):
            raise SceneError("exchange: 4096 changes wait for a step, none more can")
        self.parameters, self._points, self._source = made.parameters, made._points, made._source

    def edit(self, remove: ArrayLike | None = None, add: ArrayLike | None = None) -> bool:
        """Take points of the cloud away and add others, from the next step on.

        At most 64 changes are taken up a step; while some wait, and until the force is there, the
        status is CHANGING. A thread of its own may call this while another one steps. False where
        so many wait that this edit will go with the next one.

        Parameters
        ----------
        remove
            (n,) numbers of points: as they were given first, those added going on from there.
        add
            (m, 3) points [m].

        Raises
        ------
        SceneError
            Numbers of points that are not there, points out of range or so close together that a
            tick would take too long, none left; rule "exact", which renders no points.
        """
        gone, new = check_edit(remove, add)
        self.make_editable()
        try:
            done = self._engine.edit(gone, new)
        except ValueError as error:
            raise SceneError(str(error).removeprefix("vfplan: ")) from None
        self._points += len(new) - len(gone)
        return done

    def make_editable(self) -> None:
        """Exchange the engine for one whose points can be edited, as the first `edit` does."""
        if self._source is None:
            raise SceneError(
                "edit: rule 'exact' renders no points, which could be edited; rule 'robust' does"
            )
        if self._source:
            points, native, width = self._source
            native.search = _core.Search.editable
            allowed.check_editing(points, native, self._real_time)
            if not self._engine.exchange(_core.Engine(points, native, width)):
                raise SceneError("edit: 4096 changes wait for a step, none more can")
            self._source = ()

    def distance(self, positions: ArrayLike) -> NDArray[np.float64]:
        """Distance (T,) [m] of `positions` (T, 3) [m] to the fixture, across an ignored axis.

        To curve or triangles under rule "exact", else to the nearest point. Clearance: less R.
        """
        return self._engine.distance(check_path(positions))
