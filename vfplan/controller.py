"""`Controller`: from a bundle to the force that an arm is given, the short way and the safe one.

The C++ class of `vfplan/controller.hpp` does the work. Both give the same bits.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from vfplan import _core
from vfplan.bundle.seal import Trust, check_trust, opened_source, read_keys, unsealed
from vfplan.engine.governor import Governor, GovernorStatus
from vfplan.engine.moving import check_rigid, check_time
from vfplan.engine.parameters import Vector, core_errors, core_settings, real_array, real_number
from vfplan.engine.proxy import TOO_MANY_CHANGES, Status, check_hip
from vfplan.errors import SceneError, SettingError, SignatureError
from vfplan.io.files import FilePath

# In `Command.stopping`: `request_stop` was called.
ASKED = 1 << 15


@dataclass(frozen=True, eq=False)
class Command:
    """The answer of one tick.

    Parameters
    ----------
    force, rendered
        (3,) what to command, and what the fixtures give before the governor [N].
    proxy, normal, state, status
        As in `Step`.
    governor_status
        A `GovernorStatus`.
    stopping
        Why the force fades: bits of `status`, of `governor_status` times 256, or `ASKED`; 0 while
        the loop goes on.
    stop
        Whether the force has faded to 0, and the loop should end.
    """

    force: Vector
    rendered: Vector
    proxy: Vector
    normal: Vector
    state: int
    status: Status
    governor_status: GovernorStatus
    stopping: int
    stop: bool


class Controller(_core.Controller):
    """Forbidden regions and guides of bundles, a moving frame and a governor behind one `step`.

    What must stop an arm lets the force fade, and then `Command.stop` is set: a bad position or a
    jump that lasts `hold_time_s`, an old pose, a way out to the other side or a reset there, a bad
    force or Jacobian, and `request_stop`, which any thread may call. `reset` begins anew.

    The native class has `stiffness`, of all springs together at most [N/m], `contact_radius` [m]
    and `rule` of the first fixture, and `size`, the number of different fixtures.

    Parameters
    ----------
    path
        The bundle, in the frame robot_base.
    keys
        A file of public keys, several, or what `read_keys` returns: one must have signed it. Or a
        `Trust`, which also holds the case, the robot and the age.
    case, robot_serial, max_age_s
        For which case and robot it was signed, and how long ago at most [s].
    tool
        The tool that touched the markers.
    accept_unsigned, accept_unreviewed, accept_doubts
        Take a bundle without keys, one that nobody approved, one with open doubts.
    governor
        One with the arm's limits; `None`: 1 N a tick, 20 N, 1 kg, 1 kHz. Its stiffness is replaced
        by that of the fixtures.
    moving
        (max_age_s, max_speed_m_s, max_turn_rad_s) of a fixture that moves.
    max_hip_step, hold_time_s
        A tip further than this from the last one is no position [m] (0: off); for how long the
        force is then held. Ten good ticks make up for a bad one.
    max_stiffness_n_per_m
        To which `set_stiffness` may raise K of the bundle.

    Raises
    ------
    BundleError
        A bundle that is not what is demanded.
    SettingError, SceneError
        Settings out of range, or a fixture that no engine takes.
    """

    def __init__(
        self,
        path: FilePath,
        keys: FilePath | Sequence[FilePath] | Mapping[bytes, Any] | Trust | None = None,
        case: str | None = None,
        robot_serial: str | None = None,
        max_age_s: float | None = None,
        *,
        tool: str | None = None,
        accept_unsigned: bool = False,
        accept_unreviewed: bool = False,
        accept_doubts: bool = False,
        governor: Governor | None = None,
        moving: tuple[float, float, float] | None = None,
        max_hip_step: float = 0.02,
        hold_time_s: float = 0.02,
        max_stiffness_n_per_m: float = 0.0,
    ) -> None:
        demands = (case, robot_serial, max_age_s)
        if isinstance(keys, Trust):
            if demands != (None, None, None):
                raise SettingError(
                    "A Trust holds the case, the robot and the age. Give them there."
                )
            demands, keys = (keys.case, keys.robot_serial, keys.max_age), keys.keys
        if isinstance(keys, FilePath):
            keys = [keys]
        if keys is not None and not isinstance(keys, Mapping):
            keys = {name: key for file in keys for name, key in read_keys(file).items()}
        self._trust = Trust(dict(keys), *demands) if keys else None
        if not keys and (demands != (None, None, None) or not accept_unsigned):
            raise SignatureError(
                "comes without keys to check it with. Give keys, or accept_unsigned=True alone.",
                where=path, code="signature.missing",
            )  # fmt: skip
        governor = governor or Governor(
            force_step_n=1.0, force_max_n=20.0, stiffness_n_per_m=1.0, mass_kg=1.0
        )
        if moving is not None:
            moving = real_array(moving, "moving")
        with self._demanded(path) as data:
            super().__init__(
                data,
                accept_unreviewed=accept_unreviewed,
                accept_doubts=accept_doubts,
                tool=tool,
                governor=governor.limits,
                max_hip_step=real_number("max_hip_step", max_hip_step),
                hold_time=real_number("hold_time_s", hold_time_s),
                max_stiffness=real_number("max_stiffness_n_per_m", max_stiffness_n_per_m),
                moving=moving,
            )
        self._joints = 0

    @contextmanager
    def _demanded(self, path: FilePath) -> Iterator[bytes]:
        """A bundle's bytes, signed as demanded; what the core refuses of them is raised as ours."""
        units = {"force_step": "n", "force_max": "n", "hold_time": "s"}
        units |= dict.fromkeys(("stiffness", "max_stiffness"), "n_per_m")
        with opened_source(path) as stream, core_errors(SceneError), core_settings(**units):
            sealed = unsealed(stream)
            if self._trust is not None:
                check_trust(sealed, self._trust)
            yield sealed.data

    def add(self, path: FilePath) -> None:
        """Render another bundle too, before the loop begins; the same wall is felt once."""
        with self._demanded(path) as data:
            super().add(data)

    def exchange(self, path: FilePath, which: int = 0) -> None:
        """Go on with another bundle, which meets the same demands, in place of one's region."""
        with self._demanded(path) as data:
            if not super().exchange(data, which):
                raise SceneError(f"exchange: {TOO_MANY_CHANGES}")

    def set_stiffness(self, stiffness_n_per_m: float, which: int = 0) -> None:
        """Change K of a region, to the bundle's or `max_stiffness_n_per_m` at most."""
        with core_errors(SceneError), core_settings(force_step="n", stiffness="n_per_m"):
            if not super().set_stiffness(stiffness_n_per_m, which):
                raise SceneError(f"set_stiffness: {TOO_MANY_CHANGES}")

    def reset(self, tip: ArrayLike) -> None:
        """Begin the loop, or go on after a stop, with the tip at (3,) [m]."""
        super().reset(check_hip(tip, finite=True))

    def step(
        self, tip: ArrayLike, time_s: float | None = None, jacobian: ArrayLike | None = None
    ) -> Command:
        """One tick with the tip at (3,) [m].

        `time_s` is the loop's clock, for a fixture that moves. With the `jacobian` (3, n) of the
        tip [m], `torque_nm` is what to command.
        """
        if jacobian is not None:
            jacobian = real_array(jacobian, "jacobian")
            self._joints = jacobian.shape[1]
        rows, state, status, governor, *ending = super().step(check_hip(tip), time_s, jacobian)
        return Command(*rows, state, Status(status), GovernorStatus(governor), *ending)

    def pose(self, t: float, base_from_fixture: ArrayLike) -> bool:
        """Hand over the moving fixture's pose (4, 4) at `t` [s]: as `MovingFrame.pose`."""
        return super().pose(check_time(t), check_rigid(base_from_fixture))

    @property
    def torque_nm(self) -> Vector:
        """(n,) the torques to command [N·m], of the last tick that had a Jacobian."""
        return self.torque(self._joints)
