"""The paper's two experiments on a simulated Panda, as it did them: `vfplan demo panda -o DIR`.

The scripted hands of `experiments.py` hold the tip of a Panda, which renders the fixture by its
torques, with friction and a tick of delay. The governor limits the engine's force. In Experiment 1
a square is felt from both faces, and the force follows the depth with the slope K on either side.
Experiment 2 probes the curve planned on the shipped slice. There the arm stands 15 cm nearer,
because it could not reach the curve's far end otherwise.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from vfplan.samples.experiments import planned_curve, probing_hand, square

from vfplan.session.read import read_session
from vfplan.session.session import Session

FILES = (
    "panda-1-arm.png",
    "panda-1-efforts.png",
    "panda-2-arm.png",
    "panda-2-efforts.png",
)
"""The pictures that `draw` writes."""
TOUCHING_M = 1e-4
"""Metres of depth from which on the tip counts as touching, when the slope is fitted."""


def draw(folder: Path) -> dict[str, dict[str, Any]]:
    """Run both experiments on the simulated arm and draw them, as `FILES`.

    Returns the numbers of each experiment.
    """
    from vfplan.arm.figures import draw_forces, draw_in_space
    from vfplan.arm.model import Arm
    from vfplan.arm.rehearsal import rehearse
    from vfplan.figures.style import save_png

    hand: Session = read_session(str(files("vfplan.samples") / "elbow_session.csv"))
    numbers = {}
    for name, fixture, session, base in (
        ("panda-1", square(), probing_hand(), None),
        ("panda-2", planned_curve(), hand, (0.15, 0.0, 0.0)),
    ):
        rehearsal = rehearse(fixture, session, Arm("panda", base=base))
        save_png(draw_in_space(rehearsal), folder / f"{name}-arm.png")
        save_png(draw_forces(rehearsal), folder / f"{name}-efforts.png")
        # The slope of force over depth, by least squares through the origin.
        depth_m = rehearsal.ticks.penetration
        is_touching = depth_m > TOUCHING_M
        depth_m = depth_m[is_touching]
        force_n = np.linalg.norm(rehearsal.motion.force, axis=1)[is_touching]
        numbers[name] = {
            **rehearsal.metrics,
            "points": len(fixture.points),
            "slope_n_per_m": float((depth_m @ force_n) / (depth_m @ depth_m)),
        }
    return numbers
