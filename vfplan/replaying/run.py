"""One engine's run over a session: per-tick results, metrics and timing."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.ticks import Trace
from vfplan.fixture import Fixture
from vfplan.replaying.changing import Changing
from vfplan.replaying.engines import make_engine
from vfplan.replaying.faults import Link, LossyLink
from vfplan.replaying.governing import Governing
from vfplan.replaying.guiding import Guided
from vfplan.replaying.metrics import Metrics
from vfplan.replaying.overview import Overview
from vfplan.replaying.quantities import Stepper, overlap, penetration
from vfplan.replaying.timing import StepTimes
from vfplan.robot import Robot
from vfplan.session import TickBlock
from vfplan.session.result import joined, picked

Array = NDArray[np.float64]


class RuleRun:
    """Feed blocks of HIP positions through one engine, and measure.

    fixture, rule, engine: as for `make_engine`
    robot: whose limits to watch, or `None`
    link: the link between hand and controller; `None`: a perfect one
    governor: the robot whose limits a governor holds the forces to, or `None`: there is no governor
    keep: ticks kept for pictures; `None`: all
    changing: what happens to the fixture meanwhile, in place of an engine
    """

    def __init__(
        self,
        fixture: Fixture,
        rule: str,
        engine: str,
        *,
        robot: Robot | None = None,
        link: Link | None = None,
        governor: Robot | None = None,
        keep: int | None = None,
        changing: Changing | None = None,
    ) -> None:
        self.changing = changing
        self.engine = changing or make_engine(fixture, rule, engine)
        self.rule = rule
        stiffness = getattr(self.engine, "stiffness", self.engine.parameters.stiffness)
        self._governing = None if governor is None else Governing(governor, stiffness)
        self.link = None if link is None else LossyLink(link)
        self.overview = Overview(keep)
        # How far the HIP is beyond a cloud's own surface; a guide has none.
        self._surface = fixture.contact_radius if len(fixture.forbidden) else np.inf
        self._stepper = Stepper()
        self._metrics = Metrics(fixture, self.engine.parameters, robot)
        self._times = StepTimes()
        self._last: tuple[Array, Trace] | None = None  # the last packet, and its tick

    def feed(self, stamps: Array, hand: Array) -> TickBlock:
        """Run the engine over the next samples, and take them into the metrics."""
        if self.changing is not None:
            self.changing.due(stamps)
        hip, trace = self._rendered(stamps, hand)
        block = inner = self._block(stamps, hip, trace)
        if self.changing is not None and len(hand):  # measured in the fixture's frame
            hand, seen = self.changing.seen(hip, trace)
            inner = self._block(stamps, hand, seen)
        self._metrics.note_status(trace.status)
        steps = self._stepper.push(inner, hand)
        if steps is not None:
            self._metrics.update(steps)
        self.overview.update(block)
        return block

    def _block(self, stamps: Array, hip: Array, trace: Trace) -> TickBlock:
        proxy, normal = trace.proxy, trace.normal
        depths = penetration(hip, proxy), overlap(hip, proxy, normal, self._surface)
        return TickBlock(stamps, hip, proxy, normal, trace.force, trace.state, *depths)

    def _rendered(self, stamps: Array, hand: Array) -> tuple[Array, Trace]:
        """What the controller had, and what it answered."""
        if self.link is None:
            return hand, self._ran(hand)
        arrived = self.link.deliver(stamps, hand)
        trace = self._ran(arrived.hip)
        hip = arrived.hip
        if self._last is not None:  # row -1 is then the last packet of the blocks before
            hip = np.concatenate((hip, self._last[0]))
            trace = joined([trace, self._last[1]])
        kept = len(arrived.hip) - 1 if len(arrived.hip) else -1
        self._last = hip[[kept]], picked(trace, np.array([kept]))
        return hip[arrived.row], picked(trace, arrived.row)

    def _ran(self, hip: Array) -> Trace:
        if self._last is None and len(hip) and not self._times.ticks:
            self.engine.reset(hip[0])
        trace = self._times.run(self.engine, hip)
        return trace if self._governing is None else self._governing.run(hip, trace)

    def finish(self) -> dict[str, Any]:
        """The metrics of the whole session."""
        self._metrics.update(self._stepper.finish())
        report = {**self._metrics.report(), "step_us": self._times.report()}
        if self.changing is not None:
            report |= self.changing.report()
        if isinstance(self.engine, Guided):
            report |= self.engine.report(report["duration_s"] / report["ticks"])
        return (
            report if self._governing is None else report | {"governor": self._governing.report()}
        )
