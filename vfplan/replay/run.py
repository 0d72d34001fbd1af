"""One rule's run over a session: engine, per-tick results, metrics and timing."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.fixture import Fixture
from vfplan.replay.engines import make_engine
from vfplan.replay.metrics import Metrics
from vfplan.replay.overview import Overview
from vfplan.replay.quantities import overlap, penetration
from vfplan.replay.stepping import Stepper
from vfplan.replay.timing import StepTimes
from vfplan.session import TickBlock

Array = NDArray[np.float64]


class RuleRun:
    """Feed blocks of HIP positions through one engine, and measure.

    Parameters
    ----------
    fixture, rule, engine
        As for `make_engine`.
    keep
        Ticks kept for pictures; `None`: all.
    """

    def __init__(self, fixture: Fixture, rule: str, engine: str, keep: int | None) -> None:
        self.engine = make_engine(fixture, rule, engine)
        self.rule = rule
        self._fixture = fixture
        self._stepper = Stepper()
        self.metrics = Metrics(fixture, self.engine.parameters)
        self.overview = Overview(keep)
        self.times = StepTimes()
        self._started = False

    def feed(self, stamps: Array, hip: Array, hand: Array | None = None) -> TickBlock:
        """Run the engine over the next samples, and take them into the metrics."""
        if not self._started:
            self.engine.reset(hip[0])
            self._started = True
        trace = self.times.run(self.engine, hip)
        block = TickBlock(
            stamps,
            hip,
            trace.proxy,
            trace.normal,
            trace.force,
            trace.state,
            penetration(hip, trace.proxy),
            overlap(hip, trace.proxy, trace.normal, self._fixture.contact_radius),
        )
        self.metrics.note_status(trace.status)
        steps = self._stepper.push(block, hand)
        if steps is not None:
            self.metrics.update(steps)
        self.overview.update(block)
        return block

    def finish(self) -> dict[str, Any]:
        """The metrics of the whole session."""
        self.metrics.update(self._stepper.finish())
        return {**self.metrics.report(), "step_us": self.times.report()}
