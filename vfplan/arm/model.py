"""A jointed arm: where its tip is, how it gets somewhere, what mass is felt there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.arm.mjcf import compile_model, mujoco
from vfplan.engine.parameters import number
from vfplan.errors import InputError, SettingError
from vfplan.robot import Robot, read_robot

Array = NDArray[np.float64]

# Shipped arms, and the robot file that has each one's limits.
ARMS = {"panda": "franka", "fr3": "fr3"}
MOST_JOINTS = 16
_BELOW, _ABOVE = np.array([7, 2, 3]), np.array([5, 6, 1])  # of a 3 x 3, row after row
POINTER_M = (0.0, 0.0, 0.1)  # a straight pointer on the flange

_DAMPING = 1e-4  # of the inverse, squared singular values [m²]
_ARM_M = 0.3  # one radian of turning counts as much as this way
_WEIGHTS = np.array([1.0, 1, 1, _ARM_M, _ARM_M, _ARM_M])[:, None]


@dataclass(frozen=True, eq=False)
class Posture:
    """An arm held still."""

    q: Array  # (n,) joint angles [rad]
    tip: Array  # (3,) the tip [m]
    margin: Array  # (n,) how far each joint is from its nearer limit [rad]; below 0 beyond it
    condition: float  # of the (3, n) position Jacobian, largest over smallest singular value
    mass_kg: float  # the least apparent mass at the tip over all directions, 1 / λ_max(J M⁻¹ Jᵀ)


class Arm:
    """A shipped arm or an MJCF file, with its base placed and a tool on its site `tip`.

    choice: "panda", "fr3", or the path of an MJCF file with hinges only and `<site name="tip"/>`
    robot: whose limits it has; `None`: those of the shipped robot file
    base: (3,) or (7,) the arm's base in the fixture's frame: x, y, z [m] and a quaternion w, x, y,
        z
    tool: (3,) the tip in the frame of the site `tip` [m]
    Raises InputError: a model that cannot be read, or is no such arm
    Raises SettingError: a base or tool of another form; no robot for a file
    Raises MissingExtra: no MuJoCo
    """

    def __init__(
        self,
        choice: str | Path = "panda",
        robot: Robot | None = None,
        *,
        base: Sequence[float] | None = None,
        tool: Sequence[float] = POINTER_M,
    ) -> None:
        if robot is None:
            if str(choice) not in ARMS:
                raise SettingError(f"arm {choice}: a robot is wanted, whose limits it has")
            robot = read_robot(ARMS[str(choice)])
        self.name, self.robot = str(choice), robot
        self._mj = mujoco()
        self.model = compile_model(choice, tuple(ARMS))
        self.site = self._checked()
        self.model.opt.timestep = 1 / robot.rate_hz
        self.model.opt.gravity[:] = 0  # the arm compensates it by itself
        self.model.opt.disableflags |= self._mj.mjtDisableBit.mjDSBL_CONTACT
        if base is not None:
            self._place(base)
        self.model.site_pos[self.site] += _numbers("tool", tool, (3,))
        self.data = self._mj.MjData(self.model)
        self.joints = int(self.model.nv)
        self.low, self.high = self.model.jnt_range.T.copy()
        self.low[self.model.jnt_limited == 0], self.high[self.model.jnt_limited == 0] = (
            -np.inf,
            np.inf,
        )
        self.ready = (
            self.model.key_qpos[0].copy()
            if self.model.nkey
            else np.clip(self.model.qpos0, self.low, self.high)
        )
        self._J = np.zeros((6, self.joints))

    def _checked(self) -> int:
        model, kinds = self.model, self._mj.mjtJoint
        wrong = [j for j in range(model.njnt) if model.jnt_type[j] != kinds.mjJNT_HINGE]
        if wrong or not 1 <= model.njnt <= MOST_JOINTS:
            raise InputError(
                f"{model.njnt} joints, {len(wrong)} of them no hinges; 1 to {MOST_JOINTS} hinges "
                "wanted",
                where=self.name,
            )
        site = self._mj.mj_name2id(model, self._mj.mjtObj.mjOBJ_SITE, "tip")
        if site < 0:
            raise InputError('no <site name="tip"/>, where the tool is', where=self.name)
        for name in ("torque_limit_nm", "torque_step_limit_nm", "joint_speed_limit_rad_s"):
            limits = getattr(self.robot, name)
            if limits is not None and len(limits) != model.njnt:
                raise SettingError(
                    f"robot {self.robot.name!r} has {name} of {len(limits)} joints, the arm has "
                    f"{model.njnt}"
                )
        return site

    def _place(self, base: Sequence[float]) -> None:
        pose = _numbers("base", base, (3, 7))
        turn = pose[3:] if len(pose) == 7 else np.array([1.0, 0, 0, 0])
        if not np.linalg.norm(turn) > 1e-6:
            raise SettingError(f"base {pose.tolist()}: its quaternion has no direction")
        turn = turn / np.linalg.norm(turn)
        for body in range(1, self.model.nbody):
            if self.model.body_parentid[body]:
                continue
            there, turned = np.zeros(3), np.zeros(4)
            self._mj.mju_rotVecQuat(there, self.model.body_pos[body], turn)
            self._mj.mju_mulQuat(turned, turn, self.model.body_quat[body])
            self.model.body_pos[body] = pose[:3] + there
            self.model.body_quat[body] = turned

    def hold(self, q: ArrayLike) -> None:
        """Put the arm into posture q (n,) [rad], at rest."""
        self._mj.mj_resetData(self.model, self.data)
        self.data.qpos[:] = q
        self._mj.mj_forward(self.model, self.data)

    def look(self) -> tuple[Array, Array, Array]:
        """Tip (3,) [m], its turn (3, 3), and the Jacobian (6, n): position first, then turning.

        Views that follow the arm, the Jacobian at the next call.
        """
        self._mj.mj_jacSite(self.model, self.data, self._J[:3], self._J[3:], self.site)
        turn = self.data.site_xmat[self.site].reshape(3, 3)
        return self.data.site_xpos[self.site], turn, self._J

    def reach(self, place: Array, turn: Array, start: Array) -> tuple[Array, float]:
        """Joint angles (n,) that bring the tip to a place, and how far from it they leave it [m].

        Damped least squares from `start`, held within the joints' ranges; the tip's turn (3, 3) is
        kept unless that costs way.
        """
        q, left = self._descend(place, turn, np.clip(start, self.low, self.high), _WEIGHTS)
        if left > 1e-5:  # the tool may tilt
            q, left = self._descend(place, turn, q, _WEIGHTS * [[1], [1], [1], [0], [0], [0]])
        return q, left

    def _descend(self, place: Array, turn: Array, q: Array, weights: Array) -> tuple[Array, float]:
        best, least = q, np.inf
        for _ in range(100):
            self.data.qpos[:] = q
            self._mj.mj_kinematics(self.model, self.data)
            self._mj.mj_comPos(self.model, self.data)
            tip, now, look = self.look()
            way = place - tip
            left = float(np.linalg.norm(way))
            if left < least:
                best, least = q, left
            J, e = weights * look, weights[:, 0] * np.concatenate((way, turning(turn, now)))
            if np.linalg.norm(e) < 1e-6:
                break
            size = max(1.0, float(np.linalg.norm(e)) / 0.1)
            step = J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), e / size)
            q = np.clip(q + step, self.low, self.high)
        return best, least

    def posture(self, q: Array) -> Posture:
        """What holds in joint angles q (n,) [rad]."""
        self.hold(q)
        tip, _, look = self.look()
        J = look[:3].copy()
        values = np.linalg.svd(J, compute_uv=False)
        condition = float(values[0] / values[-1]) if values[-1] > 0 else np.inf
        inverse = J @ np.linalg.solve(self.inertia(), J.T)
        mass = 1 / float(np.linalg.eigvalsh(inverse)[-1])
        margin = np.minimum(q - self.low, self.high - q)
        return Posture(q.copy(), tip.copy(), margin, condition, mass)

    def inertia(self) -> Array:
        """(n, n) the joint-space inertia M of the posture it holds [kg·m²]."""
        columns = np.eye(self.joints)
        out = np.zeros((self.joints, self.joints))
        for j in range(self.joints):
            self._mj.mj_mulM(self.model, self.data, out[j], columns[j])
        return out


def turning(wanted: Array, now: Array) -> Array:
    """(3,) the turn from `now` to `wanted` [rad]: its axis by its sine, for less than 90°."""
    e = (wanted @ now.T).ravel()
    return 0.5 * (e[_BELOW] - e[_ABOVE])


def _numbers(name: str, values: Sequence[float], sizes: tuple[int, ...]) -> Array:
    row = np.array([number(name, v, "") for v in values])
    if len(row) not in sizes:
        raise SettingError(
            f"{name} of {len(row)} numbers: allowed are {' or '.join(map(str, sizes))}"
        )
    return row
