"""The governor between engine and arm: no force or torque changes faster than the arm accepts.

The C++ class of `vfplan/governor.hpp` does the work. Both give the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.engine.parameters import Vector, core_settings, number, real_array, real_number
from vfplan.engine.proxy import check_hip, check_path
from vfplan.errors import SceneError, SettingError
from vfplan.robot import Robot

# The share of an arm's torque steps that `Governor.of` uses.
#
# The arm's own control (friction, Coriolis, an impedance law) changes the torque in the same tick.
HEADROOM = 0.95


class GovernorStatus(IntFlag):
    """What a tick of the governor has to say; 0 when all is well."""

    OK = 0
    # The force was not finite, or beyond 1e6 N. It was taken for 0, and the last one fades out.
    BAD_FORCE = 1
    # The Jacobian was not finite, or beyond 1e6 m. Force and torques fade out.
    BAD_JACOBIAN = 2
    # Torques are limited, but without a Jacobian only forces were.
    NO_JACOBIAN = 4
    # The arm turns faster than its torques may follow: `torque_nm` is not Jᵀ F.
    TORQUE_LAGS = 8
    # The force held back gave more energy than the spring had stored.
    OVERDRAWN = 16


@dataclass(frozen=True, eq=False)
class Governed:
    """What a governor made of a path of forces, one row a tick.

    Parameters
    ----------
    force, torque
        (T, 3) [N] and (T, n) [N·m] to command; n is 0 without Jacobians.
    held_back
        (T,) size of the difference between the engine's force and `force` [N].
    status
        (T,) uint8, values of `GovernorStatus`.
    """

    force: Vector
    torque: Vector
    held_back: Vector
    status: NDArray[np.uint8]


class Governor:
    """Limits a force, its change in a tick, the joint torques that it takes, and their change.

    One factor scales the whole step, so that the direction of the change is kept. Below its limits
    the output is the input, bit for bit. Before the first tick the force is 0.

    Parameters
    ----------
    force_step_n, force_max_n
        Largest change of the force from one tick to the next, and largest force [N].
    torque_step_nm, torque_max_nm
        The same of each joint's torque [N·m], one number or one a joint (n,); `None`: no limit.
    stiffness_n_per_m
        K of the fixture's spring, the largest of its axes.
    mass_kg
        The least moving mass at the tip: the arm's alone, as the hand may let go.
    rate_hz
        Ticks a second.

    Raises
    ------
    SettingError
        A value outside its range, or a `force_step_n` with which a force that fades out gives more
        energy than the spring had stored. The message names the smallest that is passive,
        F_max T √(K/m) / 2.
    """

    def __init__(
        self,
        *,
        force_step_n: float,
        force_max_n: float,
        torque_step_nm: float | ArrayLike | None = None,
        torque_max_nm: float | ArrayLike | None = None,
        stiffness_n_per_m: float,
        mass_kg: float,
        rate_hz: float = 1000.0,
    ) -> None:
        steps, joints = torque_limits("torque_step_nm", torque_step_nm)
        maxima, others = torque_limits("torque_max_nm", torque_max_nm)
        self._limits_torques = torque_step_nm is not None or torque_max_nm is not None
        self._joints = joints or others
        if self._joints != (others or joints):
            raise SettingError(
                f"torque_step_nm and torque_max_nm are of {joints} and {others} joints. Give both "
                "for the same joints."
            )
        limits = _core.GovernorLimits()
        limits.force_step = real_number("force_step_n", force_step_n)
        limits.force_max = real_number("force_max_n", force_max_n)
        limits.stiffness = real_number("stiffness_n_per_m", stiffness_n_per_m)
        limits.mass = real_number("mass_kg", mass_kg)
        limits.period = 1 / number("rate_hz", rate_hz, "Hz", above=0.0)
        limits.torque_step, limits.torque_max = steps, maxima
        # The smallest `force_step_n` that is passive with the other settings [N].
        self.least_passive_step_n = limits.least_passive_step
        with core_settings(force_step="n", force_max="n", stiffness="n_per_m", mass="kg",
                           torque_step="nm", torque_max="nm"):  # fmt: skip
            # Checks nothing; for a loop in Python at full speed.
            self.native = _core.Governor(limits)
        # As the core takes them.
        self.limits = limits
        self.reset()

    @classmethod
    def of(cls, robot: Robot, stiffness_n_per_m: float, *, torques: bool = False) -> Governor:
        """The governor that a robot file's limits ask for.

        With `torques` the limits of its joints count too, and of their steps the share `HEADROOM`.

        Raises
        ------
        SettingError
            A robot file without the limits, or limits that are not passive with this stiffness.
        """
        limits = {}
        for quantity, unit in (("force", "n"), ("torque", "nm"))[: 1 + torques]:
            names = f"{quantity}_limit_{unit}", f"{quantity}_step_limit_{unit}"
            largest, step = (getattr(robot, name) for name in names)
            if largest is None or step is None:
                raise SettingError(
                    f"robot {robot.name!r} has no {' and '.join(names)}. Add both to the robot "
                    f"file: a governor of {quantity}s needs them."
                )
            limits |= {f"{quantity}_max_{unit}": largest, f"{quantity}_step_{unit}": step}
        if torques:
            limits["torque_step_nm"] = HEADROOM * np.asarray(limits["torque_step_nm"])
        return cls(
            **limits, stiffness_n_per_m=stiffness_n_per_m, mass_kg=robot.mass_kg,
            rate_hz=robot.rate_hz,
        )  # fmt: skip

    def reset(self) -> None:
        """Begin anew: no force, no torque, no energy given."""
        self.native.reset()
        self.held_back_n = 0.0
        self.status = GovernorStatus.OK
        # (n,) the torques to command [N·m]; (0,) before the first Jacobian. They are Jᵀ F of the
        # last tick, unless the status has TORQUE_LAGS.
        self.torque_nm = np.zeros(0)

    def step(self, force: ArrayLike, jacobian: ArrayLike | None = None) -> Vector:
        """The force (3,) to command for the engine's force (3,) [N].

        Parameters
        ----------
        jacobian
            (3, n) of the place on which the force acts [m], needed where torques are limited. Then
            `torque_nm` is what to command.

        Raises
        ------
        SceneError
            Arrays of another shape, or no Jacobian though torques are limited.
        """
        if jacobian is not None:
            jacobian = real_array(jacobian, "jacobian")[None]
        return self.trace(check_hip(force, "force")[None], jacobian).force[0]

    def run(self, forces: ArrayLike, jacobians: ArrayLike | None = None) -> Vector:
        """One tick a row: (T, 3) [N], from (T, 3) [N] and Jacobians (T, 3, n) [m]."""
        return self.trace(forces, jacobians).force

    def trace(self, forces: ArrayLike, jacobians: ArrayLike | None = None) -> Governed:
        """As `run`, with the torques and what was held back in each tick."""
        wanted = check_path(forces, "forces")
        matrices = self._checked_jacobians(jacobians, len(wanted))
        torque, (force, held_back, status) = self.native.run(wanted, matrices)
        if len(wanted) > 0:
            self.held_back_n = float(held_back[-1])
            self.status = GovernorStatus(int(status[-1]))
            if matrices is not None:
                self.torque_nm = torque.reshape(matrices.shape[::2])[-1].copy()
        return Governed(force, torque, held_back, status)

    def _checked_jacobians(self, jacobians: ArrayLike | None, ticks: int) -> Vector | None:
        """Jacobians (ticks, 3, n); raises `SceneError` for another shape or a missing one."""
        if jacobians is None:
            if self._limits_torques:
                raise SceneError(
                    "jacobian is missing, and torques are limited. Give one of shape (3, n) in "
                    "each tick."
                )
            return None
        matrices = real_array(jacobians, "jacobians")
        if matrices.shape[:1] != (ticks,):
            raise SceneError(
                f"jacobians has shape {matrices.shape}. Give one for each force: ({ticks}, 3, n)."
            )
        shape = matrices.shape[1:]
        wanted = str(self._joints or f"1 to {_core.most_joints}")
        is_allowed = len(shape) == 2 and shape[0] == 3 and 1 <= shape[1] <= _core.most_joints
        if not is_allowed or self._joints not in (None, shape[1]):
            raise SceneError(f"jacobian has shape {shape}. Give one of shape (3, n), n {wanted}.")
        return matrices

    @property
    def energy_given_j(self) -> float:
        """Energy that forces held back have given since the reset [J].

        It counts as if each had pushed a free mass.
        """
        return self.native.energy_given

    @property
    def energy_stored_j(self) -> float:
        """The tank: energy of the springs from which those forces were released [J]."""
        return self.native.energy_stored


def torque_limits(name: str, values: float | ArrayLike | None) -> tuple[Vector, int | None]:
    """(16,) limits of torques [N·m], infinite where there is none, and for how many joints.

    `None`: for any number. Raises `SettingError` for another shape than () or (n,).
    """
    padded = np.full(_core.most_joints, np.inf)
    if values is None:
        return padded, None
    limits = real_array(values, name, SettingError)
    if limits.ndim > 1 or not 1 <= limits.size <= _core.most_joints:
        raise SettingError(
            f"{name} has shape {limits.shape}. Give one number, or one for each of at most "
            f"{_core.most_joints} joints."
        )
    joints = len(limits) if limits.ndim == 1 else None
    padded[:joints] = limits
    return padded, joints
