"""The arm's protocol simulator on this machine alone: `python simulator.py MODEL.xml ADDRESS`.

`franka-sim` listens on every interface by itself; here it is bound to ADDRESS, one of the
loopback's. It judges an arm's limits, not a busy machine's deadlines. MODEL.xml is one of vfplan's
own, which needs no network; `study.py` passes it.
"""

from __future__ import annotations

import os
import signal
import sys

PORT = 1337  # libfranka knows no other


def main(model: str, host: str) -> None:
    os.environ["FR3_MJCF"] = model
    from franka_sim.franka_sim_server import FrankaSimServer

    server = FrankaSimServer(
        host=host,
        port=PORT,
        enable_gripper=False,
        enforce_comm_constraints=False,
        enforce_motion_limits=True,
    )
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        server.start()
    finally:
        server.stop()


if __name__ == "__main__":
    main(*sys.argv[1:])
