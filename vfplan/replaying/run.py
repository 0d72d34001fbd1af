"""One engine's run over a session: its ticks, their numbers, and the time that each took.

A replay in a bounded number of ticks, for pictures: of each stretch, its deepest tick.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.proxy import Trace
from vfplan.fixture import Fixture
from vfplan.replaying.changing import ChangingFixture
from vfplan.replaying.clearance import CONTACT_M, PairedTicks, overlap, penetration
from vfplan.replaying.guiding import GovernedForces, Guided, make_engine
from vfplan.replaying.link import Link, LossyLink
from vfplan.replaying.metrics import Metrics, StepTimes
from vfplan.robot import Robot
from vfplan.session.result import TABLE, TickBlock, concatenate_ticks, select_ticks


def no_ticks() -> TickBlock:
    """A block without ticks."""
    return TickBlock(*(np.empty((0, *columns), dtype) for columns, dtype, _ in TABLE.values()))


class ThinnedTicks:
    """Keep at most `capacity` ticks; every tick while the session is that short.

    capacity: ticks kept, 2 at least; 0: none; `None`: all of them
    """

    def __init__(self, capacity: int | None = 65536) -> None:
        self._capacity = capacity
        self._blocks = [no_ticks()]
        self.stride = 1

    def update(self, block: TickBlock) -> None:
        """Take in the next ticks."""
        if self._capacity == 0:
            return
        self._blocks.append(thinned(block, self.stride))
        while self._capacity is not None and len(self.ticks) > self._capacity:
            self._blocks = [thinned(self.ticks, 2)]
            self.stride *= 2

    @property
    def ticks(self) -> TickBlock:
        """What was kept, in order."""
        if len(self._blocks) > 1:
            self._blocks = [concatenate_ticks(self._blocks)]
        return self._blocks[0]


def thinned(block: TickBlock, stride: int) -> TickBlock:
    """Of every `stride` ticks in a row the one with the deepest penetration (the first)."""
    if stride == 1:
        return block
    n = len(block)
    depth = np.full(-(-n // stride) * stride, -1.0)
    depth[:n] = block.penetration
    rows = depth.reshape(-1, stride)
    picks = rows.argmax(axis=1) + np.arange(len(rows)) * stride
    return block[picks]


def contact_marks(ticks: TickBlock, rate_hz: float) -> NDArray[np.intp]:
    """Indices of ticks in contact, at most `rate_hz` of them a second: the first of each slot."""
    slot = np.floor((ticks.time - ticks.time[0]) * rate_hz).astype(np.int64)
    in_contact = np.flatnonzero(ticks.penetration > CONTACT_M)
    _, first = np.unique(slot[in_contact], return_index=True)
    return in_contact[first]


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
