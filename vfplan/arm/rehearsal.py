"""rehearse(fixture, session): will this arm render this fixture with this hand?

A hand moves a simulated arm that renders a fixture, tick by tick. One tick: read the tip, let the
engine answer, govern, and turn the force into torques, which act `delay_ticks` later; the hand,
which is no computer, acts at once. Gravity is compensated, as the arm does by itself; Coulomb and
viscous friction are the joints' own.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.arm.model import Arm, mujoco
from vfplan.display import MAX_LISTED, Advance, millimetres
from vfplan.engine.governor import Governed, Governor
from vfplan.engine.proxy import ProxyEngine
from vfplan.errors import SceneError, SessionError
from vfplan.fixture import Fixture
from vfplan.geometry.lines import Array
from vfplan.replaying.guiding import GovernorMeasure
from vfplan.replaying.metrics import CONTACT_M, CurveRuler, Report, rendered_ticks, row_norms
from vfplan.session.result import TickBlock, select_ticks
from vfplan.session.session import Session
from vfplan.stability.loop import exact_bound
from vfplan.stability.study import largest_rendered_stiffness

# Number of ticks from one report of progress, and one check of the joints' speed, to the next.
CHECK_TICKS = 256

# Largest speed of a joint [rad/s]. In a simulation that left all bounds a joint turns faster.
LOST_SPEED_RAD_S = 100.0


# The hand pulls the tip to the session's place, and the tool to how it was at the start. Its
# damping against the tip's speed beside the place's [N·s/m], its stiffness against turning
# [N·m/rad], and its damping against turning [N·m·s/rad].
HAND_DAMPING, TURN_STIFFNESS, TURN_DAMPING = 25.0, 6.0, 0.4


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """What happened, one row a tick.

    Parameters
    ----------
    tip, proxy, normal
        (T, 3) the tip as the tick began and the proxy [m], the contact's normal.
    rendered, force
        (T, 3) the engine's force and the force that was commanded [N].
    pull
        (T, 3) the hand's force on the tip [N].
    q, speed
        (T, n) joint angles [rad] and their speeds [rad/s] as the tick began.
    torque
        (T, n) the torques that were commanded [N·m].
    state, governed
        (T,) of the engine, and the governor's status.
    """

    tip: Array
    proxy: Array
    normal: Array
    rendered: Array
    force: Array
    pull: Array
    q: Array
    speed: Array
    torque: Array
    state: NDArray[np.int8]
    governed: NDArray[np.uint8]


def run_loop(
    arm: Arm,
    engine: ProxyEngine,
    governor: Governor | None,
    places: Array,
    start: Array,
    hand_stiffness: float,
    done: Advance | None = None,
) -> ArmMotion:
    """Run the loop over the places (T, 3) [m] that the hand wants, from posture `start` (n,) [rad].

    `done`, if given, is called with the number of ticks just run. The run ends early, with fewer
    rows, where the simulation leaves all bounds.
    """
    # Everything that a tick needs is bound to a name here: the loop runs a thousand times a second.
    mj = mujoco()
    model, data, site, joints = arm.model, arm.data, arm.site, arm.joints
    ticks = len(places)
    rows = ArmMotion(
        *np.zeros((6, ticks, 3)), *np.zeros((3, ticks, joints)), np.zeros(ticks, np.int8),
        np.zeros(ticks, np.uint8),
    )  # fmt: skip
    torque_limit = np.asarray(arm.robot.torque_limit_nm or np.inf)
    place_speed = np.gradient(places, 1 / arm.robot.rate_hz, axis=0)
    arm.hold(start)
    tip, rotation, jacobian = arm.read_tip()
    position_jacobian, rotation_jacobian, jacobian_transposed = *np.split(jacobian, 2), jacobian.T
    joint_speed = data.qvel
    wrench, twist = np.zeros(6), np.zeros(3)
    start_quaternion, quaternion = np.zeros((2, 4))
    mj.mju_mat2Quat(start_quaternion, rotation.ravel())
    run_engine = engine.native.run
    delayed = deque([np.zeros(joints)] * arm.robot.delay_ticks)
    engine.reset(tip)

    for k in range(ticks):
        # The robot: position, force, torques.
        mj.mj_step1(model, data)
        mj.mj_jacSite(model, data, position_jacobian, rotation_jacobian, site)
        tick = slice(k, k + 1)
        proxy, normal, rendered, state, *_ = run_engine(tip[None])
        rows.proxy[tick], rows.normal[tick], rows.rendered[tick] = proxy, normal, rendered
        rows.state[tick] = state
        if governor is None:
            rows.force[tick] = rendered
            rows.torque[k] = position_jacobian.T @ rows.rendered[k]
        else:
            rows.torque[tick], (rows.force[tick], _, rows.governed[tick]) = governor.native.run(
                rendered, position_jacobian[None]
            )
        delayed.append(np.minimum(np.maximum(rows.torque[k], -torque_limit), torque_limit))

        # The hand: a force to the place, and a torque against turning.
        mj.mju_mat2Quat(quaternion, data.site_xmat[site])
        mj.mju_subQuat(twist, start_quaternion, quaternion)
        tip_speed = jacobian @ joint_speed
        wrench[:3] = hand_stiffness * (places[k] - tip)
        wrench[:3] -= HAND_DAMPING * (tip_speed[:3] - place_speed[k])
        wrench[3:] = TURN_STIFFNESS * (rotation @ twist) - TURN_DAMPING * tip_speed[3:]

        rows.q[k] = data.qpos
        rows.speed[k] = joint_speed
        rows.tip[k] = tip
        rows.pull[k] = wrench[:3]
        data.qfrc_applied[:] = delayed.popleft() + jacobian_transposed @ wrench
        mj.mj_step2(model, data)

        if k % CHECK_TICKS == CHECK_TICKS - 1:
            if done is not None:
                done(CHECK_TICKS)
            # The comparison is false for a speed that is no number, too.
            if not np.abs(joint_speed).max() < LOST_SPEED_RAD_S:
                return select_ticks(rows, slice(k + 1))
    return rows


SafetyStop = dict[str, Any]

# The unit of what stops an arm, by its kind.
STOP_UNITS = {
    "controller_torque_discontinuity": "N·m", "joint_torque": "N·m", "joint_velocity": "rad/s",
    "joint_position": "rad", "cartesian_reflex": "N", "cartesian_velocity": "m/s",
}  # fmt: skip


def safety_stops(arm: Arm, motion: ArmMotion) -> list[SafetyStop]:
    """The limits of the arm that the motion crossed, in the order in which it would have stopped.

    Each has `tick`, `kind`, `joint` (from 1; absent where no joint is meant), `value` at that tick
    and `limit`. Kinds, named after the arm's own errors where it has them:

    - `controller_torque_discontinuity`: a commanded torque changed too much in a tick [N·m];
    - `joint_torque`, `joint_velocity`, `joint_position` [N·m], [rad/s], [rad];
    - `cartesian_reflex`: the force between hand and tip [N]; `cartesian_velocity` [m/s];
    - `lost`: the simulation left all bounds.
    """
    robot = arm.robot
    tip_speed = row_norms(np.diff(motion.tip, axis=0, append=motion.tip[-1:])) * robot.rate_hz
    stops = []
    for kind, sign, values, limits in (
        ("controller_torque_discontinuity", 1, torque_steps(motion), robot.torque_step_limit_nm),
        ("joint_torque", 1, np.abs(motion.torque), robot.torque_limit_nm),
        ("joint_velocity", 1, np.abs(motion.speed), robot.joint_speed_limit_rad_s),
        ("joint_position", 1, motion.q, arm.high),
        ("joint_position", -1, motion.q, arm.low),
        ("cartesian_reflex", 1, row_norms(motion.pull), robot.force_limit_n),
        ("cartesian_velocity", 1, tip_speed, robot.speed_limit_m_s),
    ):
        if limits is None:
            continue
        columns, bounds = values.reshape(len(values), -1), np.atleast_1d(limits)
        is_over = sign * columns > sign * bounds
        for j in np.flatnonzero(is_over.any(axis=0)).tolist():
            ticks = np.flatnonzero(is_over[:, j]).tolist()
            stop = {"tick": ticks[0], "kind": kind}
            if values.ndim == 2:
                stop["joint"] = j + 1
            stop |= {"value": float(columns[ticks[0], j]), "limit": float(bounds[j])}
            stops.append(stop | {"ticks": len(ticks)})
    if not np.abs(motion.speed[-1]).max() < LOST_SPEED_RAD_S:
        stops.append({"tick": len(motion.q) - 1, "kind": "lost"})
    return sorted(stops, key=lambda stop: (stop["tick"], stop["kind"]))


# Number of places along the session that the arm must reach, and whose postures are judged.
PLACES = 100

# Largest distance of the tip from a place that counts as reached [m].
REACHED_M = 1e-3

# Number of ticks of the longest session, an hour at 1 kHz. All of them are kept in memory.
MAX_TICKS = 3_600_000

# Largest share by which a session's rate differs from the arm's. Clocks of two computers differ by
# less.
SAME_RATE = 0.01


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """The result of a rehearsal."""

    # The report; docs/rehearse.md names its keys
    metrics: Report
    # What the result of a replay holds, of the simulated tip
    ticks: TickBlock
    # The arm's side of it
    motion: ArmMotion
    # Where the hand wanted the tip
    session: Session
    fixture: Fixture
    arm: Arm

    @property
    def passed(self) -> bool:
        """Whether the arm reaches every place, and would not have stopped."""
        return self.metrics["reachable"] and not self.metrics["reflexes"]

    @property
    def verdict(self) -> str:
        """What it shows, in words that begin with "pass" or "fail"."""
        if self.passed:
            return f"pass: {self.arm.name} reaches every place, and nothing stops it"
        if not self.metrics["reachable"]:
            return f"fail: {self.arm.name} does not reach every place"
        return f"fail: {self.arm.name} would stop"


def rehearse(
    fixture: Fixture,
    session: Session,
    arm: Arm,
    *,
    governed: bool = True,
    hand_stiffness: float = 600.0,
    done: Advance | None = None,
) -> Rehearsal:
    """Let the session's hand move a simulated arm that renders the fixture.

    Parameters
    ----------
    session
        Where the hand wants the tip, in the fixture's frame and at the arm's rate.
    governed
        Whether a governor of the arm's limits stands between engine and torques.
    hand_stiffness
        How stiffly it wants that [N/m].
    done
        Called with the number of ticks just run.

    Raises
    ------
    SessionError
        A session longer than an hour.
    InputError, SettingError
        A fixture that cannot be rendered; limits that are not passive with its stiffness; a
        filter of the robot behind which no K is the largest stable one.
    """
    started = time.perf_counter()
    rate_hz = arm.robot.rate_hz
    check_session(session, fixture)

    # The robot's part: engine, governor, and the posture to begin with.
    stiffness = largest_rendered_stiffness(fixture)
    engine = ProxyEngine.of(fixture)
    governor = Governor.of(arm.robot, stiffness, torques=True) if governed else None
    ruler = CurveRuler.of(fixture)
    postures, unreached = reach_places(arm, session, ruler)
    if not unreached:
        # What has no bound is refused before the run, by the mass that is felt along the session.
        exact_bound(replace(arm.robot, mass_kg=min(arm.posture(q)[1] for q in postures)))

    # The run.
    loop_started = time.perf_counter()
    motion = run_loop(arm, engine, governor, session.hip, postures[0], hand_stiffness, done)
    loop_s = time.perf_counter() - loop_started
    tick_count = len(motion.q)
    time_s = session.time[:tick_count]
    ticks = rendered_ticks(time_s, motion.tip, motion, fixture.contact_radius)

    # The figures; the first step of the force is from 0.
    force_steps = row_norms(np.diff(motion.force, axis=0, prepend=np.zeros((1, 3))))
    stops = safety_stops(arm, motion)
    if ruler is not None:
        for stop in stops:
            stop |= ruler.locate(motion.tip[stop["tick"]])
    torque_nm, _, joint = largest_of(np.abs(motion.torque))
    step_nm, tick, step_joint = largest_of(torque_steps(motion))
    metrics = {
        "arm": arm.name,
        "robot": arm.robot.name,
        "rule": engine.parameters.rule,
        "ticks": tick_count,
        "duration_s": tick_count / rate_hz,
        "reachable": not unreached,
        "reflexes": stops,
        "torque_max_nm": torque_nm,
        "torque_max_joint": joint,
        "torque_step_max_nm": step_nm,
        "torque_step_max_joint": step_joint,
        "torque_step_max_tick": tick,
        **posture_figures(arm, motion, ruler),
        "k_n_per_m": stiffness,
        "force_max_n": float(row_norms(motion.force).max()),
        "force_step_max_n": float(force_steps.max()),
        "hand_force_max_n": float(row_norms(motion.pull).max()),
        "contact_ticks": int(np.count_nonzero(ticks.penetration > CONTACT_M)),
        "penetration_max_m": float(ticks.penetration.max()),
        "tip_error_max_m": float(row_norms(motion.tip - session.hip[:tick_count]).max()),
        "clearance_min_m": float(engine.distance(motion.proxy).min()) - engine.parameters.R,
        "real_time_factor": tick_count / rate_hz / loop_s,
    }
    if unreached:
        metrics["unreached"] = unreached
    if governor is not None:
        held_back = row_norms(motion.force - motion.rendered)
        governed = Governed(motion.force, motion.torque, held_back, motion.governed)
        measure = GovernorMeasure()
        measure.update(motion.rendered, governed, motion.tip)
        metrics["governor"] = measure.report(governor)
    metrics["elapsed_s"] = time.perf_counter() - started
    return Rehearsal(metrics, ticks, motion, session, fixture, arm)


def check_session(session: Session, fixture: Fixture) -> None:
    """Raise where the session cannot be rehearsed on this fixture."""
    if fixture.guidance is not None:
        raise SceneError(
            "the fixture guides, and a rehearsal renders forbidden regions only. Give one "
            "without a guide",
            code="guide",
        )
    if not 1 < len(session.hip) <= MAX_TICKS:
        raise SessionError(
            f"the session has {len(session.hip)} samples. Give 2 to {MAX_TICKS}",
            where=session.name, code="session-length", numbers={"samples": len(session.hip)},
        )  # fmt: skip


def reach_places(
    arm: Arm, session: Session, ruler: CurveRuler | None
) -> tuple[list[Array], list[SafetyStop]]:
    """The postures along the session, and the places the arm cannot bring the tip to."""
    arm.hold(arm.ready)
    rotation = arm.read_tip()[1].copy()
    ticks = np.unique(np.linspace(0, len(session.hip) - 1, PLACES).astype(np.intp))
    q = arm.ready
    postures, unreached = [], []
    for k in ticks:
        place = session.hip[k]
        q, distance = arm.inverse_kinematics(place, rotation, q)
        if distance > REACHED_M:
            # Perhaps it is reached from another posture.
            other_q, other_distance = arm.inverse_kinematics(place, rotation, arm.ready)
            if other_distance < distance:
                q, distance = other_q, other_distance
        postures.append(q)
        if distance > REACHED_M:
            entry = {"tick": int(k), "place_m": place.tolist(), "left_m": distance}
            if ruler is not None:
                entry |= ruler.locate(place)
            unreached.append(entry)
    return postures, unreached


def torque_steps(motion: ArmMotion) -> Array:
    """(T, n) how much each torque changes in a tick, the first from 0 [N·m]."""
    return np.abs(np.diff(motion.torque, axis=0, prepend=0 * motion.torque[:1]))


def largest_of(values: Array) -> tuple[float, int, int]:
    """The largest of values (T, n), its tick, and its joint from 1."""
    tick, joint = np.unravel_index(values.argmax(), values.shape)
    return float(values[tick, joint]), int(tick), int(joint) + 1


def posture_figures(arm: Arm, motion: ArmMotion, ruler: CurveRuler | None) -> Report:
    """How close joints are to their limits, the worst condition, and the smallest mass."""
    beyond_rad, tick, joint = largest_of(np.maximum(arm.low - motion.q, motion.q - arm.high))
    ticks = np.unique(np.linspace(0, len(motion.q) - 1, PLACES).astype(int)).tolist()
    conditions, masses_kg = zip(*(arm.posture(motion.q[k]) for k in ticks), strict=True)
    condition, mass_kg = max(conditions), min(masses_kg)
    worst, lightest = ticks[conditions.index(condition)], ticks[masses_kg.index(mass_kg)]
    figures = {
        "joint_margin_min_rad": -beyond_rad,
        "joint_margin_min_joint": joint,
        "joint_margin_min_tick": tick,
        "condition_max": condition if np.isfinite(condition) else None,
        "condition_max_tick": worst,
        "mass_min_kg": mass_kg,
        "mass_min_tick": lightest,
        "k_max_n_per_m": exact_bound(replace(arm.robot, mass_kg=mass_kg)),
    }
    if ruler is not None:
        figures["condition_max_along"] = ruler.locate(motion.tip[worst])
        figures["mass_min_along"] = ruler.locate(motion.tip[lightest])
    return figures


def objections(metrics: Report) -> list[str]:
    """Why it did not pass, a line each: places out of reach, then what would have stopped it."""
    lines = [
        f"not reached: tick {place['tick']}, {millimetres(place['left_m'], 1)} short"
        for place in metrics.get("unreached", [])[:MAX_LISTED]
    ]
    for stop in metrics["reflexes"]:
        joint = f" of joint {stop['joint']}" if "joint" in stop else ""
        line = f"would stop: {stop['kind']}{joint} at tick {stop['tick']}"
        if "s_m" in stop:
            line += f", {millimetres(stop['s_m'], 1)} along stroke {stop['stroke']}"
        if "value" in stop:
            unit = STOP_UNITS[stop["kind"]]
            line += f": {stop['value']:.4g} {unit}, {stop['limit']:.4g} {unit} allowed"
        lines.append(line)
    return lines
