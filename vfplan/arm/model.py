"""A jointed arm: where its tip is, how it gets somewhere, what mass is felt there.

Its model file is a shipped one, or the user's, which is read as what it is: untrusted text.
It may name only what an arm without shapes needs. Nothing that opens another file, runs a plugin or
multiplies itself is let through to MuJoCo.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import ArrayLike

from vfplan import _core
from vfplan.errors import InputError, SettingError, requires_extra
from vfplan.geometry.lines import Array
from vfplan.io.files import MAX_SETTINGS_BYTES, FilePath, read_whole
from vfplan.robot import Robot, read_robot

_LOG = logging.getLogger("vfplan")

# Largest number of elements. An arm has about a hundred.
MAX_NODES = 5_000

# Largest number of elements within each other. An arm has about twenty.
MAX_DEPTH = 64

ELEMENTS = {
    *("mujoco", "compiler", "option", "flag", "default", "statistic", "keyframe", "key"),
    *("worldbody", "body", "frame", "inertial", "joint", "geom", "site", "camera", "light"),
    *("actuator", "motor", "general", "position", "velocity", "contact", "exclude"),
}
# Attributes that name a file or a folder, or load code.
FORBIDDEN = {"file", "meshdir", "texturedir", "assetdir", "plugin", "mesh", "hfield"}


def mujoco() -> Any:
    """The module; `MissingExtra` without it."""
    with requires_extra("a simulated arm needs MuJoCo", "arm"):
        import mujoco
    if mujoco.get_mju_user_warning() is None:
        # By itself it would write them into a file of the current folder.
        mujoco.set_mju_user_warning(_LOG.warning)
    return mujoco


def compile_model(choice: FilePath) -> Any:
    """The `MjModel` of a shipped arm, or of an MJCF file.

    Raises InputError: a file that cannot be read, that names what is not allowed here, or that
        MuJoCo refuses
    Raises MissingExtra: no MuJoCo
    """
    module = mujoco()
    if str(choice) in ARMS:
        model = files("vfplan.arm") / "models" / f"{choice}.xml"
        return module.MjModel.from_xml_string(model.read_text("utf-8"))
    try:
        data = read_whole(Path(choice), MAX_SETTINGS_BYTES)
    except InputError as error:
        advice = f"or give {', '.join(ARMS)} or an MJCF file"
        raise InputError(f"{error.message}, {advice}", where=choice) from None
    check(data, str(choice))
    try:
        return module.MjModel.from_xml_string(data.decode("utf-8"))
    except (ValueError, module.FatalError) as error:
        raise InputError(
            f"MuJoCo refuses it: {error}. Correct the MJCF file", where=choice
        ) from None


def check(data: bytes, where: str) -> None:
    """Raise `InputError` for the first thing in an MJCF that is not allowed here."""
    parser = expat.ParserCreate()
    node_count = depth = 0

    def refuse(what: str) -> None:
        raise InputError(
            f"line {parser.CurrentLineNumber}: {what}", where=where, code="mjcf-not-allowed",
            numbers={"line": parser.CurrentLineNumber},
        )  # fmt: skip

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal node_count, depth
        node_count += 1
        depth += 1
        if node_count == 1 and name != "mujoco":
            refuse(f"<{name}> is no MJCF. Give a file whose root is <mujoco>")
        if name not in ELEMENTS:
            refuse(f"<{name}> is not allowed. Give an arm without shapes, in one file")
        for attribute, value in attributes.items():
            if attribute in FORBIDDEN:
                refuse(
                    f'{attribute}="..." is not allowed. Put all into this file, as no other is read'
                )
            if "nan" in value.lower().split():
                refuse("a number is nan. Give finite numbers")
        if node_count > MAX_NODES or depth > MAX_DEPTH:
            refuse(
                f"it has more than {MAX_NODES} elements, or {MAX_DEPTH} within each other. "
                "Give a smaller file"
            )

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = lambda *_: refuse("a document type is not allowed. Remove it")
    parser.EntityDeclHandler = lambda *_: refuse("an entity is not allowed. Remove it")
    try:
        data.decode("utf-8")
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(
            f"is no XML: {error}. Give an MJCF file", where=where, code="not-xml"
        ) from None
    except UnicodeDecodeError:
        raise InputError("is not text. Give an MJCF file", where=where, code="not-xml") from None


# Shipped arms, each with the robot file that has its limits.
ARMS = {"panda": "franka", "fr3": "fr3"}

# Largest number of joints that the engine takes. A model with more is no arm.
MAX_JOINTS = _core.most_joints

# Distance [m] that counts as much as one radian of turning in the inverse kinematics.
ARM_LENGTH_M = 0.3

# Number of steps after which the inverse kinematics ends. A place in reach needs about ten.
KINEMATICS_STEPS = 100

# Largest error that one step of the inverse kinematics works off [m].
LONGEST_STEP_M = 0.1

# Damping of the inverse kinematics, squared singular values [m²]. It bounds the step near a
# singular posture and changes no result.
DAMPING = (LONGEST_STEP_M / 10) ** 2

# Error below which the inverse kinematics is solved [m].
SOLVED_M = 1e-6


class Arm:
    """A shipped arm or an MJCF file, with its base placed and a tool on its site `tip`.

    choice: "panda", "fr3", or the path of an MJCF file with hinges only and `<site name="tip"/>`
    robot: whose limits it has; `None`: those of the shipped robot file
    base: (3,) or (7,) the arm's base in the fixture's frame: x, y, z [m] and a quaternion w, x, y,
        z
    tool: (3,) the tip in the frame of the site `tip` [m]; by default a straight pointer of 100 mm
    Raises InputError: a model that cannot be read, or is no such arm
    Raises SettingError: a base without direction; no robot for a file
    Raises MissingExtra: no MuJoCo
    """

    def __init__(
        self,
        choice: FilePath = "panda",
        robot: Robot | None = None,
        *,
        base: Sequence[float] | None = None,
        tool: Sequence[float] = (0.0, 0.0, 0.1),
    ) -> None:
        if robot is None and str(choice) not in ARMS:
            if not Path(choice).exists():
                raise SettingError(
                    f"there is no arm {choice}, and no file of that name. Give "
                    f"{', '.join(ARMS)} or an MJCF file",
                    code="arm-unknown",
                )
            raise SettingError(
                f"arm {choice} has no limits of its own. Name a robot with --robot",
                code="arm-without-robot",
            )
        self.name = str(choice)
        self.robot = robot = robot or read_robot(ARMS[self.name])
        self._mj = mujoco()
        self.model = compile_model(choice)
        self.site = tip_site(self.model, robot, self.name)
        self.model.opt.timestep = 1 / robot.rate_hz
        # The arm compensates gravity by itself.
        self.model.opt.gravity[:] = 0
        self.model.opt.disableflags |= self._mj.mjtDisableBit.mjDSBL_CONTACT
        if base is not None:
            move_base(self.model, np.array(base, float))
        self.model.site_pos[self.site] += tool
        self.data = self._mj.MjData(self.model)
        self.joints = int(self.model.nv)
        self.low, self.high = self.model.jnt_range.T.copy()
        is_endless = self.model.jnt_limited == 0
        self.low[is_endless], self.high[is_endless] = -np.inf, np.inf
        ready = np.clip(self.model.qpos0, self.low, self.high)
        self.ready = self.model.key_qpos[0].copy() if self.model.nkey else ready
        self._jacobian = np.zeros((6, self.joints))

    def hold(self, q: ArrayLike) -> None:
        """Put the arm into posture q (n,) [rad], at rest."""
        self._mj.mj_resetData(self.model, self.data)
        self.data.qpos[:] = q
        self._mj.mj_forward(self.model, self.data)

    def read_tip(self) -> tuple[Array, Array, Array]:
        """Tip (3,) [m], its rotation (3, 3), and the Jacobian (6, n): position first, then turning.

        Views that follow the arm, the Jacobian at the next call.
        """
        self._mj.mj_jacSite(
            self.model, self.data, self._jacobian[:3], self._jacobian[3:], self.site
        )
        rotation = self.data.site_xmat[self.site].reshape(3, 3)
        return self.data.site_xpos[self.site], rotation, self._jacobian

    def inverse_kinematics(
        self, place: Array, rotation: Array, start: Array
    ) -> tuple[Array, float]:
        """Joint angles (n,) that bring the tip to a place, and how far from it they stay [m].

        Damped least squares from `start`, within the joints' ranges. The tip keeps its rotation
        (3, 3) unless that costs reach.
        """
        weights = np.array([1.0, 1, 1, ARM_LENGTH_M, ARM_LENGTH_M, ARM_LENGTH_M])[:, None]
        start = np.clip(start, self.low, self.high)
        q, distance = self._descend(place, rotation, start, weights)
        if distance > SOLVED_M:
            position_only = np.array([1.0, 1, 1, 0, 0, 0])[:, None]
            q, distance = self._descend(place, rotation, q, weights * position_only)
        return q, distance

    def _descend(
        self, place: Array, rotation: Array, q: Array, weights: Array
    ) -> tuple[Array, float]:
        """The best joint angles on the descent from q, and the tip's distance to the place."""
        best_q, best_distance = q, np.inf
        for _ in range(KINEMATICS_STEPS):
            self.data.qpos[:] = q
            self._mj.mj_kinematics(self.model, self.data)
            self._mj.mj_comPos(self.model, self.data)
            tip, tip_rotation, jacobian = self.read_tip()
            difference = place - tip
            distance = float(np.linalg.norm(difference))
            if distance < best_distance:
                best_q, best_distance = q, distance
            J = weights * jacobian
            # The turn [rad] from one rotation to the other: its axis by its sine, below 90°.
            R = rotation @ tip_rotation.T
            turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
            error = weights[:, 0] * np.concatenate((difference, turn))
            length = float(np.linalg.norm(error))
            if length < SOLVED_M:
                break
            scale = max(1.0, length / LONGEST_STEP_M)
            step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), error / scale)
            q = np.clip(q + step, self.low, self.high)
        return best_q, best_distance

    def posture(self, q: Array) -> tuple[float, float]:
        """Condition and smallest apparent mass [kg] of the posture with joint angles q (n,) [rad].

        The condition is the largest over the smallest singular value of the (3, n) position
        Jacobian; the mass is the smallest over all directions, 1 / λ_max(J M⁻¹ Jᵀ).
        """
        self.hold(q)
        J = self.read_tip()[2][:3]
        values = np.linalg.svd(J, compute_uv=False)
        condition = float(values[0] / values[-1]) if values[-1] > 0 else np.inf
        inverse = J @ np.linalg.solve(self.inertia(), J.T)
        return condition, 1 / float(np.linalg.eigvalsh(inverse)[-1])

    def inertia(self) -> Array:
        """(n, n) the joint-space inertia M of the posture it holds [kg·m²]."""
        out = np.zeros((self.joints, self.joints))
        for row, column in zip(out, np.eye(self.joints), strict=True):
            self._mj.mj_mulM(self.model, self.data, row, column)
        return out


def tip_site(model: Any, robot: Robot, name: str) -> int:
    """The number of the site `tip` of an arm of hinges whose limits the robot has."""
    others = int(np.count_nonzero(model.jnt_type != mujoco().mjtJoint.mjJNT_HINGE))
    if others or not 1 <= model.njnt <= MAX_JOINTS:
        raise InputError(
            f"the arm has {model.njnt} joints, {others} of them no hinges. Give an arm of 1 "
            f"to {MAX_JOINTS} hinges",
            where=name, code="not-an-arm",
            numbers={"joints": int(model.njnt), "no_hinges": others},
        )  # fmt: skip
    site = mujoco().mj_name2id(model, mujoco().mjtObj.mjOBJ_SITE, "tip")
    if site < 0:
        raise InputError(
            "no <site name=\"tip\"/> says where the tool is. Add one to the last body",
            where=name, code="no-tip",
        )  # fmt: skip
    for limit_name in ("torque_limit_nm", "torque_step_limit_nm", "joint_speed_limit_rad_s"):
        limits = getattr(robot, limit_name)
        if limits is not None and len(limits) != model.njnt:
            raise SettingError(
                f"robot {robot.name!r} has {limit_name} of {len(limits)} joints, the arm has "
                f"{model.njnt}. Give the robot of this arm",
                code="robot-of-another-arm",
            )
    return site


def move_base(model: Any, pose: Array) -> None:
    """Move every body that stands on the ground by the base's pose (3,) or (7,)."""
    quaternion = pose[3:] if len(pose) == 7 else np.array([1.0, 0, 0, 0])
    length = np.linalg.norm(quaternion)
    if not length > 1e-6:
        raise SettingError(
            f"the quaternion of base {pose.tolist()} has no direction. Give W,X,Y,Z of length 1",
            code="base-without-direction",
        )
    quaternion = quaternion / length
    for body in range(1, model.nbody):
        if model.body_parentid[body]:
            continue
        position, rotation = model.body_pos[body], model.body_quat[body]
        mujoco().mju_mulPose(
            position, rotation, pose[:3], quaternion, position.copy(), rotation.copy()
        )
