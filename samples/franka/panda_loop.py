"""Render a fixture on a Franka Panda: the loop of loop.py, over panda-python (libfranka 0.9.2).

    python panda_loop.py FIXTURE.h5 --robot HOST ...

It takes the options of loop.py, stops at the same bits, and ends with the same exit codes. A thread
of panda-python commands the torque that this loop gave last. Nobody has run it on an arm.
"""

from __future__ import annotations

import atexit
import sys
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import loop
import numpy as np

try:
    import panda_py
    from panda_py import controllers, libfranka
except ImportError:
    print("panda-python is missing. Run: pip install panda-python==1.1.1", file=sys.stderr)
    sys.exit(2)

# What loop.py takes from pylibfranka, Franka's binding for the arms after the Panda.
RealtimeConfig = libfranka.RealtimeConfig
ControlException = CommandException = RuntimeError


class Torques:
    """Torques (7,) of a tick [N m]."""

    def __init__(self, torque: Sequence[float]) -> None:
        self.torque, self.motion_finished = torque, False


class Robot:
    """The arm, by the names of pylibfranka."""

    def __init__(self, host: str, realtime: Any) -> None:
        self._panda = panda_py.Panda(host, realtime_config=realtime)
        self.automatic_error_recovery = self._panda.recover
        self.set_collision_behavior = self._panda.get_robot().set_collision_behavior
        self.read_once = self._panda.get_state

    def load_model(self) -> Any:
        """The model, whose Jacobian is that of the end effector."""
        model, frame = self._panda.get_model(), libfranka.Frame.kEndEffector
        return SimpleNamespace(zero_jacobian=lambda state: model.zero_jacobian(frame, state))

    def start_torque_control(self) -> Control:
        """Begin to command torques, with none."""
        return Control(self._panda)


class Control:
    """A running torque control; whatever ends this program ends it too."""

    def __init__(self, panda: Any) -> None:
        self._panda = panda
        # No damping and no filter: what is commanded are the governor's torques.
        self._controller = controllers.AppliedTorque(damping=np.zeros(7), filter_coeff=1.0)
        self._controller.set_control(np.zeros(7))
        panda.start_controller(self._controller)
        atexit.register(panda.stop_controller)
        self._context = panda.create_context(frequency=loop.RATE_HZ)

    def readOnce(self) -> tuple[Any, float]:
        """Wait for the next tick, and read the arm; raises RuntimeError when it has stopped."""
        if not self._context.ok():
            raise ControlException("the arm's control has ended")
        return self._panda.get_state(), 1 / loop.RATE_HZ

    def writeOnce(self, command: Torques) -> None:
        """Command the torques, and after the last ones end the control."""
        self._controller.set_control(np.array(command.torque))
        if command.motion_finished:
            self._panda.stop_controller()
            atexit.unregister(self._panda.stop_controller)


def main(words: list[str]) -> int:
    """The loop, with this binding and the Panda's limits."""
    sys.modules["pylibfranka"] = sys.modules[__name__]
    loop.ARM = "franka"
    return loop.main(words)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
