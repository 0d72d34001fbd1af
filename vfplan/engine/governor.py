"""The governor between engine and arm: no force or torque changes faster than the arm accepts.

A thin Python face over `vfplan/governor.hpp`, which has the same words; the same bits come out.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.engine.parameters import Vector, number, real_array
from vfplan.engine.ticks import check_hip, check_path
from vfplan.errors import SceneError, SettingError
from vfplan.robot import Robot

# Of the torque steps that an arm accepts, the part that `Governor.of` uses: the arm's own control
# (friction, Coriolis, an impedance law) changes the torque in the same tick.
HEADROOM = 0.95


class GovernorStatus(IntFlag):
    """What a tick of the governor has to say; 0 when all is well."""

    OK = 0
    BAD_FORCE = 1
    """The force was not finite, or beyond 1e6 N: taken for none, and faded out."""
    BAD_JACOBIAN = 2
    """The Jacobian was not finite, or beyond 1e6 m: force and torques fade out."""
    NO_JACOBIAN = 4
    """Torques are limited, but without a Jacobian only forces were."""
    TORQUE_LAGS = 8
    """The arm turns faster than its torques may follow: `torque_nm` is not Jᵀ F."""
    OVERDRAWN = 16
    """The force held back gave more than the spring had stored."""


@dataclass(frozen=True, eq=False)
class Governed:
    """What a governor made of a path of forces, row by row."""

    # (T, 3) [N] and (T, n) [N·m] to command; n is 0 without Jacobians
    force: Vector
    torque: Vector
    held_back: Vector  # (T,) |force asked for - force to command| [N]
    status: NDArray[np.uint8]  # (T,) uint8, values of `GovernorStatus`


class Governor:
    """Limits a force, its change a tick, and the joint torques that it takes, and theirs.

    One scale for the whole step, so that the direction of the change is kept; below its limits the
    output is the input, bit for bit. Before the first tick the force is 0.

    Parameters
    ----------
    force_step_n, force_max_n
        Largest change of the force from one tick to the next, and largest force [N].
    torque_step_nm, torque_max_nm
        The same of each joint's torque [N·m], one number or one a joint (n,); `None`: no limit.
    stiffness_n_per_m
        K of the fixture's spring, the largest of its axes.
    mass_kg
        The least moving mass at the tip: the arm's, without the hand that may be gone.
    rate_hz
        Ticks a second.

    Raises
    ------
    SettingError
        A value outside its range; a `force_step_n` with which a force that fades out gives more
        energy than the spring had stored. The message names the least that is passive,
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
        limits = _core.GovernorLimits()
        limits.force_max = number("force_max_n", force_max_n, "N", above=0.0, most=1e6)
        limits.stiffness = number("stiffness_n_per_m", stiffness_n_per_m, "N/m", above=0.0)
        limits.mass = number("mass_kg", mass_kg, "kg", above=0.0)
        rate = number("rate_hz", rate_hz, "Hz", above=0.0)
        limits.period = 1 / rate
        self.least_passive_step_n = limits.least_passive_step
        """The least `force_step_n` that is passive with the other settings [N]."""
        self.least_reversing_step_n = limits.least_reversing_step
        """The least one that is so too when the force turns round at its largest [N]."""
        limits.force_step = number(
            "force_step_n",
            force_step_n,
            "N a tick",
            least=max(self.least_passive_step_n, 1e-6 * limits.force_max),
            why="force_max_n / rate_hz * sqrt(stiffness / mass) / 2: slower, a released force "
            "gives more energy than the spring had stored",
        )
        steps = _each("torque_step_nm", torque_step_nm)
        maxima = _each("torque_max_nm", torque_max_nm)
        self._by_torque = torque_step_nm is not None or torque_max_nm is not None
        self._joints = _joints(steps, maxima)
        for j in range(_core.most_joints):
            limits.set_torque(j, _of_joint(steps, j), _of_joint(maxima, j))
        try:
            self._governor = _core.Governor(limits)
        except ValueError as error:
            raise SettingError(str(error).removeprefix("vfplan: ")) from None
        self.reset()

    @classmethod
    def of(cls, robot: Robot, stiffness_n_per_m: float, *, torques: bool = False) -> Governor:
        """The governor that a robot file's limits ask for.

        With `torques` its joints' limits count too, steps of them by `HEADROOM`.

        Raises
        ------
        SettingError
            A robot file without the limits, or limits that are not passive with this stiffness.
        """
        if robot.force_limit_n is None or robot.force_step_limit_n is None:
            raise SettingError(
                f"robot {robot.name!r} has no force_limit_n and force_step_limit_n; a governor "
                "needs both"
            )
        joints: dict[str, Any] = {}
        if torques:
            if robot.torque_limit_nm is None or robot.torque_step_limit_nm is None:
                raise SettingError(
                    f"robot {robot.name!r} has no torque_limit_nm and torque_step_limit_nm; a "
                    "governor of torques needs both"
                )
            joints = {
                "torque_max_nm": robot.torque_limit_nm,
                "torque_step_nm": HEADROOM * np.asarray(robot.torque_step_limit_nm),
            }
        return cls(
            force_step_n=robot.force_step_limit_n,
            force_max_n=robot.force_limit_n,
            stiffness_n_per_m=stiffness_n_per_m,
            mass_kg=robot.mass_kg,
            rate_hz=robot.rate_hz,
            **joints,
        )

    @property
    def native(self) -> _core.Governor:
        """The governor behind it, which checks nothing; for a loop in Python at full speed."""
        return self._governor

    def reset(self) -> None:
        """As before the first tick: no force, no torque, nothing given."""
        self._governor.reset()
        self.held_back_n = 0.0
        self.status = GovernorStatus.OK
        self._turned = 0

    def step(self, force: ArrayLike, jacobian: ArrayLike | None = None) -> Vector:
        """The force to command for the engine's force, (3,) [N] both.

        Parameters
        ----------
        jacobian
            (3, n) of the position of the point on which the force acts [m]; needed where torques
            are limited. Then `torque_nm` is what to command.

        Raises
        ------
        SceneError
            Arrays of another shape; no Jacobian though torques are limited.
        """
        asked = check_hip(force, "force")
        if jacobian is None:
            self._check_joints(None)
            row, self.held_back_n, status = self._governor.step(asked)
        else:
            matrix = real_array(jacobian, "jacobian")
            self._check_joints(matrix.shape)
            row, self.held_back_n, status = self._governor.step(asked, matrix)
        self.status = GovernorStatus(status)
        return row.reshape(3)

    def run(self, forces: ArrayLike, jacobians: ArrayLike | None = None) -> Vector:
        """One tick a row: (T, 3) [N], from (T, 3) [N] and, by torques, (T, 3, n) [m]."""
        return self.trace(forces, jacobians).force

    def trace(self, forces: ArrayLike, jacobians: ArrayLike | None = None) -> Governed:
        """As `run`, with the torques and what was held back in each tick."""
        asked = check_path(forces, "forces")
        matrices = None
        if jacobians is not None:
            matrices = real_array(jacobians, "jacobians")
            if matrices.shape[:1] != (len(asked),):
                raise SceneError(
                    f"jacobians of shape {matrices.shape}: allowed is ({len(asked)}, 3, n)"
                )
        self._check_joints(None if matrices is None else matrices.shape[1:])
        done = Governed(*self._governor.run(asked, matrices))
        if len(asked):
            self.held_back_n = float(done.held_back[-1])
            self.status = GovernorStatus(int(done.status[-1]))
        return done

    def _check_joints(self, shape: tuple[int, ...] | None) -> None:
        if shape is None:
            if self._by_torque:
                raise SceneError("no jacobian: a governor of torques needs one (3, n) each tick")
            return
        least, most = (self._joints,) * 2 if self._joints else (1, _core.most_joints)
        if len(shape) != 2 or shape[0] != 3 or not least <= shape[1] <= most:
            wanted = f"{least}" if least == most else f"{least} to {most}"
            raise SceneError(f"jacobian of shape {shape}: allowed is (3, n), n {wanted}")
        self._turned = shape[1]

    @property
    def torque_nm(self) -> Vector:
        """(n,) what to command [N·m]: Jᵀ F of the last tick unless TORQUE_LAGS; (0,) before."""
        if not self._turned:
            return np.empty(0)
        return self._governor.torque(self._turned).reshape(self._turned)

    @property
    def energy_given_j(self) -> float:
        """What forces held back have given since the reset, had each pushed a free mass [J]."""
        return self._governor.energy_given

    @property
    def energy_stored_j(self) -> float:
        """The tank: what the springs held that those forces were released from [J]."""
        return self._governor.energy_stored


def _each(name: str, values: float | ArrayLike | None) -> Vector | None:
    if values is None:
        return None
    try:
        found = real_array(values, name)
    except SceneError as error:
        raise SettingError(error.message) from None
    if found.ndim > 1 or not 1 <= found.size <= _core.most_joints:
        raise SettingError(
            f"{name} of shape {found.shape}: allowed is one number or (n,), n at most "
            f"{_core.most_joints}"
        )
    for value in found.ravel().tolist():
        number(name, value, "N·m", above=0.0)
    return found


def _joints(*limits: Vector | None) -> int | None:
    """How many joints the limits are for; `None` where they say one number for all."""
    sizes = {len(limit) for limit in limits if limit is not None and limit.ndim == 1}
    if len(sizes) > 1:
        raise SettingError(
            f"torque_step_nm and torque_max_nm of {min(sizes)} and {max(sizes)} joints: allowed "
            "is the same number of both"
        )
    return sizes.pop() if sizes else None


def _of_joint(limits: Vector | None, j: int) -> float:
    if limits is None or (limits.ndim == 1 and j >= len(limits)):
        return float("inf")
    return float(limits if limits.ndim == 0 else limits[j])
