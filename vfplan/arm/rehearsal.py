"""rehearse(fixture, session): will this arm render this fixture with this hand?"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.arm.loop import Hand, Motion, move
from vfplan.arm.model import Arm, Posture
from vfplan.arm.reflexes import reflexes
from vfplan.engine.governor import Governor, GovernorStatus
from vfplan.engine.proxy import ProxyEngine
from vfplan.errors import SceneError, SessionError
from vfplan.fixture import Fixture
from vfplan.replaying.clearance import clearance_of
from vfplan.replaying.episodes import CurveRuler
from vfplan.replaying.quantities import overlap, penetration, row_norms
from vfplan.session import Session, TickBlock
from vfplan.stability.gate import felt_stiffness
from vfplan.stability.theory import Plant, exact_bound

Array = NDArray[np.float64]

PLACES = 100  # along the session, at which the arm must reach and its posture is judged
REACHED_M = 1e-3  # as far from the place as the tip may stay
MOST_TICKS = 3_600_000  # an hour: all of them are kept


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """What a rehearsal found."""

    metrics: dict[str, Any]  # the report; its keys are in docs/rehearse.md
    ticks: TickBlock  # what a replay's result holds, of the simulated tip
    motion: Motion  # the arm's side of it
    postures: list[Posture]  # of `PLACES` ticks, evenly spread; `posture_ticks` says which
    posture_ticks: NDArray[np.intp]
    session: Session  # where the hand wanted the tip
    fixture: Fixture
    arm: Arm

    @property
    def passed(self) -> bool:
        """Whether the arm reaches every place, and would not have stopped."""
        return self.metrics["reachable"] and not self.metrics["reflexes"]


def rehearse(
    fixture: Fixture,
    session: Session,
    arm: Arm,
    *,
    governed: bool = True,
    hand: Hand | None = None,
    done: Callable[[int], None] | None = None,
) -> Rehearsal:
    """Let the session's hand move a simulated arm that renders the fixture.

    session: where the hand wants the tip, at the arm's rate
    governed: whether a governor of the arm's limits stands between engine and torques
    hand: how stiffly it wants that
    done: called with the number of ticks just run
    Raises SessionError: a session in another frame or at another rate, or longer than an hour
    Raises InputError, SettingError: a fixture that cannot be rendered; limits that are not passive
        with its stiffness
    """
    began = clock.perf_counter()
    _check(session, fixture, arm)
    stiffness = felt_stiffness(fixture)
    engine = ProxyEngine.of(fixture)
    governor = Governor.of(arm.robot, stiffness, torques=True) if governed else None
    ruler = CurveRuler.of(fixture)
    start, unreached = _reach(arm, session, ruler)
    running = clock.perf_counter()
    motion = move(arm, engine, governor, session.hip, start, hand or Hand(), done)
    running = clock.perf_counter() - running
    kept = len(motion.q)
    posture_ticks = np.unique(np.linspace(0, kept - 1, min(PLACES, kept)).astype(np.intp))
    postures = [arm.posture(motion.q[k]) for k in posture_ticks]
    ticks = TickBlock(
        session.time[:kept], motion.tip, motion.proxy, motion.normal, motion.force, motion.state,
        penetration(motion.tip, motion.proxy),
        overlap(motion.tip, motion.proxy, motion.normal, fixture.contact_radius),
    )  # fmt: skip
    clearance = clearance_of(fixture, engine.rule)
    clearance.update(motion.proxy)
    metrics = {
        "arm": arm.name,
        "robot": arm.robot.name,
        "rule": engine.parameters.rule,
        "ticks": kept,
        "duration_s": kept / arm.robot.rate_hz,
        "reachable": not unreached,
        "reflexes": _placed(reflexes(arm, motion), motion, ruler),
        **_torques(motion),
        **_postures(arm, postures, posture_ticks, motion, ruler),
        "k_n_per_m": stiffness,
        "force_max_n": float(row_norms(motion.force).max()),
        "force_step_max_n": _largest_step(motion.force),
        "hand_force_max_n": float(row_norms(motion.pull).max()),
        "contact_ticks": int(np.count_nonzero(ticks.penetration > 1e-9)),
        "penetration_max_m": float(ticks.penetration.max()),
        "tip_error_max_m": float(row_norms(motion.tip - session.hip[:kept]).max()),
        "clearance_min_m": clearance.minimum_m,
        "real_time_factor": kept / arm.robot.rate_hz / running,
    }
    if unreached:
        metrics["unreached"] = unreached
    if governor is not None:
        metrics["governor"] = _governor(governor, motion)
    metrics["elapsed_s"] = clock.perf_counter() - began
    return Rehearsal(metrics, ticks, motion, postures, posture_ticks, session, fixture, arm)


def _check(session: Session, fixture: Fixture, arm: Arm) -> None:
    if session.frame != fixture.frame:
        raise SessionError(
            f"positions in frame {session.frame!r}, the fixture in {fixture.frame!r}; they must "
            "be the same",
            where=session.name,
        )
    if fixture.guidance is not None:
        raise SceneError("the fixture guides; a rehearsal renders forbidden regions only")
    if not 1 < len(session.hip) <= MOST_TICKS:
        raise SessionError(
            f"{len(session.hip)} samples; 2 to {MOST_TICKS} wanted", where=session.name
        )
    rate = 1 / float(np.median(np.diff(session.time)))
    if not 0.99 < rate / arm.robot.rate_hz < 1.01:
        raise SessionError(
            f"sampled at {rate:.6g} Hz, the arm runs at {arm.robot.rate_hz:g} Hz; --rate resamples",
            where=session.name,
        )


def _reach(
    arm: Arm, session: Session, ruler: CurveRuler | None
) -> tuple[Array, list[dict[str, Any]]]:
    """The posture to begin with, and the places the arm cannot bring the tip to."""
    arm.hold(arm.ready)
    turn = arm.look()[1].copy()
    ticks = np.unique(np.linspace(0, len(session.hip) - 1, PLACES).astype(np.intp))
    q, first, unreached = arm.ready, None, []
    for k in ticks:
        q, left = arm.reach(session.hip[k], turn, q)
        if left > REACHED_M:  # from another posture, perhaps
            again, less = arm.reach(session.hip[k], turn, arm.ready)
            q, left = (again, less) if less < left else (q, left)
        first = q if first is None else first
        if left > REACHED_M:
            place = {} if ruler is None else ruler.locate(session.hip[k])
            at = session.hip[k].tolist()
            unreached.append({"tick": int(k), "place_m": at, "left_m": left, **place})
    return first, unreached


def _placed(
    found: list[dict[str, Any]], motion: Motion, ruler: CurveRuler | None
) -> list[dict[str, Any]]:
    if ruler is None:
        return found
    return [reflex | ruler.locate(motion.tip[reflex["tick"]]) for reflex in found]


def _torques(motion: Motion) -> dict[str, Any]:
    steps = np.abs(np.diff(motion.torque, axis=0, prepend=0 * motion.torque[:1]))
    size = np.abs(motion.torque)
    return {
        "torque_max_nm": float(size.max()),
        "torque_max_joint": int(size.max(axis=0).argmax()) + 1,
        "torque_step_max_nm": float(steps.max()),
        "torque_step_max_joint": int(steps.max(axis=0).argmax()) + 1,
        "torque_step_max_tick": int(steps.max(axis=1).argmax()),
    }


def _largest_step(force: Array) -> float:
    return float(row_norms(np.diff(force, axis=0, prepend=np.zeros((1, 3)))).max())


def _postures(
    arm: Arm,
    postures: list[Posture],
    ticks: NDArray[np.intp],
    motion: Motion,
    ruler: CurveRuler | None,
) -> dict[str, Any]:
    margins = np.minimum(motion.q - arm.low, arm.high - motion.q)
    worst = int(np.argmax([p.condition for p in postures]))
    light = int(np.argmin([p.mass_kg for p in postures]))
    robot = arm.robot
    plant = Plant(postures[light].mass_kg, robot.damping_n_s_per_m, 1 / robot.rate_hz)
    condition = postures[worst].condition
    found = {
        "joint_margin_min_rad": float(margins.min()),
        "joint_margin_min_joint": int(margins.min(axis=0).argmin()) + 1,
        "joint_margin_min_tick": int(margins.min(axis=1).argmin()),
        "condition_max": condition if np.isfinite(condition) else None,
        "condition_max_tick": int(ticks[worst]),
        "mass_min_kg": postures[light].mass_kg,
        "mass_min_tick": int(ticks[light]),
        "k_max_n_per_m": exact_bound(plant, robot.delay_ticks),
    }
    if ruler is not None:
        found["condition_max_along"] = ruler.locate(postures[worst].tip)
        found["mass_min_along"] = ruler.locate(postures[light].tip)
    return found


def _governor(governor: Governor, motion: Motion) -> dict[str, Any]:
    held = row_norms(motion.rendered - motion.force)
    work = ((motion.force - motion.rendered)[:-1] * np.diff(motion.tip, axis=0)).sum()
    over = motion.governed & GovernorStatus.OVERDRAWN
    return {
        "held_ticks": int(np.count_nonzero(held)),
        "held_back_max_n": float(held.max()),
        "engine_force_max_n": float(row_norms(motion.rendered).max()),
        "engine_force_step_max_n": _largest_step(motion.rendered),
        "energy_given_j": governor.energy_given_j,
        "energy_stored_j": governor.energy_stored_j,
        "overdrawn_ticks": int(np.count_nonzero(over)),
        "work_j": float(work),
    }
