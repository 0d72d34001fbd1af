"""Simulate the arm's protocol on this machine alone: `python simulator.py MODEL.xml ADDRESS`.

By itself `franka-sim` listens on every network interface; here it is bound to ADDRESS, one of the
loopback interface. It judges an arm's limits, but not whether a busy machine meets its deadlines.
MODEL.xml is one of vfplan's own models, so no network is needed; `study.py` passes it.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys

PORT = 1337
"""Port of the arm's protocol. libfranka knows no other."""


def main(model: str, address: str) -> None:
    """Serve an arm until the process is told to end."""
    os.environ["FR3_MJCF"] = model
    from franka_sim.franka_sim_server import FrankaSimServer

    server = FrankaSimServer(
        host=address,
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
    parser = argparse.ArgumentParser(description="Simulate an arm's protocol on this machine.")
    parser.add_argument("model", metavar="MODEL.xml", help="vfplan/arm/models/fr3.xml")
    parser.add_argument("address", metavar="ADDRESS", help="of the loopback, as 127.0.0.2")
    options = parser.parse_args()
    main(options.model, options.address)
