"""The paper's two experiments on a simulated Panda, as it did them: `vfplan demo panda -o DIR`.

The same scripted hands as in `experiments.py`, but the tip is a Panda's that renders the fixture by
its torques, with friction and a tick of delay; the governor stands behind the engine. Experiment 1
feels a square from both faces: the force follows the depth with the slope K on either side.
Experiment 2 probes the curve planned on the shipped slice; the arm stands 15 cm nearer to it, or
its far end were out of reach.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from vfplan.samples.experiments import planned_curve, probing_hand, square

from vfplan.session import Session, read_session

FILES = (
    "panda-1-depth.png", "panda-1-arm.png", "panda-1-efforts.png",
    "panda-2-depth.png", "panda-2-arm.png", "panda-2-efforts.png",
)  # fmt: skip


def draw(folder: Path) -> dict[str, dict[str, Any]]:
    """Run both on the simulated arm; leave `FILES` in `folder`, return each run's numbers."""
    from vfplan.arm import Arm, rehearse
    from vfplan.arm.figures import depth, draw_forces, draw_in_space
    from vfplan.figures.style import save_png

    hand: Session = read_session(str(files("vfplan.samples") / "elbow_session.csv"))
    numbers = {}
    for name, fixture, session, base in (
        ("panda-1", square(), probing_hand(), None),
        ("panda-2", planned_curve(), hand, (0.15, 0.0, 0.0)),
    ):
        found = rehearse(fixture, session, Arm("panda", base=base))
        save_png(depth(found), folder / f"{name}-depth.png")
        save_png(draw_in_space(found), folder / f"{name}-arm.png")
        save_png(draw_forces(found), folder / f"{name}-efforts.png")
        deep = found.ticks.penetration
        force = np.linalg.norm(found.motion.force, axis=1)
        touched = deep > 1e-4
        slope = float((deep[touched] @ force[touched]) / (deep[touched] @ deep[touched]))
        numbers[name] = {**found.metrics, "points": len(fixture.points), "slope_n_per_m": slope}
    return numbers
