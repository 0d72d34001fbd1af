"""One engine's run over a session: its ticks, their numbers, and the time that each took."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.answers import Trace
from vfplan.fixture import Fixture
from vfplan.replaying.changing import ChangingFixture
from vfplan.replaying.engines import make_engine
from vfplan.replaying.governing import GovernedForces
from vfplan.replaying.guiding import Guided
from vfplan.replaying.link import Link, LossyLink
from vfplan.replaying.metrics import Metrics
from vfplan.replaying.quantities import PairedTicks, overlap, penetration
from vfplan.replaying.thinning import ThinnedTicks
from vfplan.replaying.timing import StepTimes
from vfplan.robot import Robot
from vfplan.session import TickBlock
from vfplan.session.result import concatenate_ticks, select_ticks

Array = NDArray[np.float64]


class EngineRun:
    """Feed a session through one engine, block by block, and measure it.

    fixture, rule, engine: as for `make_engine`
    robot: whose limits to watch, or `None`
    link: the link between hand and controller; `None`: a perfect one
    governed_robot: whose limits a governor holds the forces to; `None`: there is no governor
    keep: how many ticks are kept for pictures; `None`: all
    changing: what happens to the fixture meanwhile; it then takes the engine's place
    """

    def __init__(
        self,
        fixture: Fixture,
        rule: str,
        engine: str,
        *,
        robot: Robot | None = None,
        link: Link | None = None,
        governed_robot: Robot | None = None,
        keep: int | None = None,
        changing: ChangingFixture | None = None,
    ) -> None:
        self.rule = rule
        self.changing = changing
        self.engine: Any = changing
        if changing is None:
            self.engine = make_engine(fixture, rule, engine)
        self.link = None
        if link is not None:
            self.link = LossyLink(link)
        self.kept = ThinnedTicks(keep)
        self._governor = None
        if governed_robot is not None:
            stiffness = getattr(self.engine, "stiffness", self.engine.parameters.stiffness)
            self._governor = GovernedForces(governed_robot, stiffness)
        # From this depth on the HIP is beyond the points themselves; a guide has no surface.
        self._surface_depth = np.inf
        if fixture.region is not None:
            self._surface_depth = fixture.contact_radius
        self._pairs = PairedTicks()
        self._metrics = Metrics(fixture, self.engine.parameters, robot)
        self._times = StepTimes()
        # HIP of the last packet that arrived, and the engine's answer to it.
        self._last_packet: tuple[Array, Trace] | None = None

    def feed(self, time: Array, hand: Array) -> TickBlock:
        """Run the engine over the next samples, measure them, and give them back as ticks.

        time: (n,) [s]
        hand: (n, 3) where the tool truly was [m]
        """
        if self.changing is not None:
            self.changing.apply_until(time)

        hip, trace = self._answers(time, hand)
        ticks = self._ticks(time, hip, trace)

        measured = ticks
        hand_in_frame = hand
        if self.changing is not None and len(hand):
            hand_in_frame, in_frame = self.changing.in_fixture_frame(hip, trace)
            measured = self._ticks(time, hand_in_frame, in_frame)

        self._metrics.note_status(trace.status)
        steps = self._pairs.push(measured, hand_in_frame)
        if steps is not None:
            self._metrics.update(steps)
        self.kept.update(ticks)
        return ticks

    def _answers(self, time: Array, hand: Array) -> tuple[Array, Trace]:
        """(n, 3) the HIP that the controller had at each tick [m], and what it answered.

        Behind a lossy link the engine steps on the packets that arrive. A tick without one repeats
        the answer to the last packet, which may be of an earlier block.
        """
        if self.link is None:
            return hand, self._run(hand)
        arrived = self.link.deliver(time, hand)
        hip = arrived.hip
        trace = self._run(hip)
        if self._last_packet is not None:
            # Rows: the packets of this block, 0 to n - 1, and then the packet before them. A tick
            # before this block's first packet has row -1, which NumPy reads as that last row.
            hip = np.concatenate((hip, self._last_packet[0]))
            trace = concatenate_ticks([trace, self._last_packet[1]])
        # The last packet of this block. Where none arrived this is -1, the packet before.
        last = len(arrived.hip) - 1
        self._last_packet = hip[[last]], select_ticks(trace, np.array([last]))
        return hip[arrived.row], select_ticks(trace, arrived.row)

    def _run(self, hip: Array) -> Trace:
        """The engine's answers, with the forces that a governor lets through."""
        is_first = self._last_packet is None and not self._times.ticks
        if is_first and len(hip):
            self.engine.reset(hip[0])
        trace = self._times.run(self.engine, hip)
        return trace if self._governor is None else self._governor.run(hip, trace)

    def _ticks(self, time: Array, hip: Array, trace: Trace) -> TickBlock:
        depth = penetration(hip, trace.proxy)
        beyond = overlap(hip, trace.proxy, trace.normal, self._surface_depth)
        return TickBlock(
            time, hip, trace.proxy, trace.normal, trace.force, trace.state, depth, beyond
        )

    def finish(self) -> dict[str, Any]:
        """The numbers of the whole session."""
        self._metrics.update(self._pairs.finish())
        report = self._metrics.report() | {"step_us": self._times.report()}
        if self.changing is not None:
            report |= self.changing.report()
        if isinstance(self.engine, Guided):
            report |= self.engine.report(report["duration_s"] / report["ticks"])
        if self._governor is not None:
            report["governor"] = self._governor.report()
        return report
