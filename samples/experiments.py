"""The paper's two experiments, with a scripted hand: `vfplan demo experiments -o DIR`.

Experiment 1 probes both sides of a square of 40 401 points, Experiment 2 a curve of about 2204
points (5.3 a millimetre) planned on the shipped elbow slice. The hand that the paper recorded is
not published; these presses and slides are scripted, so the pictures show the same things, not the
same numbers.
"""

from __future__ import annotations

from importlib.resources import files
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.fixture import Fixture, Provenance, Rendering
from vfplan.replaying.replay import replay
from vfplan.session.session import Session

Array = NDArray[np.float64]


def square() -> Fixture:
    """Experiment 1: x, z = 0.4 to 0.5 m at y = 0.1 m, a point every 0.5 mm."""
    from vfplan.engine.parameters import ProxyParameters

    side = np.linspace(0.4, 0.5, 201)
    x, z = np.meshgrid(side, side, indexing="ij")
    points = np.stack([x.ravel(), np.full(x.size, 0.1), z.ravel()], axis=1)
    # The band becomes 12.5 µm, the depth of the dimple between four points.
    parameters = ProxyParameters.make(points)
    rendering = Rendering(parameters.stiffness, parameters.contact_radius, parameters.band)
    provenance = Provenance("2026-01-01T00:00:00Z", "vfplan")
    return Fixture("robot_base", points, provenance, rendering=rendering)


def probing_hand(rate: float = 1000.0) -> Session:
    """A hand that presses and slides on the front, goes around the edge, and does so on the back.

    Way points joined by minimum-jerk moves; no move is faster than 0.25 m/s.

    rate: ticks a second
    """
    front_depths_m = (4e-3, 7e-3, 9e-3)
    back_depths_m = (3e-3, 8e-3)
    stops = [(0.43, 0.125, 0.45)]
    for side, depths_m in ((1, front_depths_m), (-1, back_depths_m)):
        surface = 0.1 + side * 5e-3
        for k, depth in enumerate(depths_m):
            x = 0.425 + 0.022 * k
            stops.append((x, surface + side * 0.01, 0.47))
            stops.append((x, surface - side * depth, 0.46))
            stops.append((x + 0.012, surface - side * 0.6 * depth, 0.43))
            stops.append((x + 0.012, surface + side * 0.012, 0.43))
        if side == 1:
            # Around the edge of the square to its back.
            stops.append((0.53, 0.12, 0.44))
            stops.append((0.53, 0.08, 0.44))
    return Session(*minimum_jerk(np.array(stops), rate), name="probing both sides")


def minimum_jerk(stops: Array, rate: float, speed: float = 0.25) -> tuple[Array, Array]:
    """Time (T,) [s] and positions (T, 3) [m] through way points, at rest in each of them.

    10 s³ - 15 s⁴ + 6 s⁵ (Flash & Hogan 1985), whose greatest speed is 1.875 times the mean.
    """
    parts = [stops[:1]]
    for start, end in pairwise(stops):
        ticks = max(100, round(1.875 * np.linalg.norm(end - start) / speed * rate))
        s = (np.arange(1, ticks + 1) / ticks)[:, None]
        # By products, which round alike on every processor; NumPy's powers do not.
        way = s * s * s * (10 - s * (15 - 6 * s))
        parts.append(start + way * (end - start))
    hip = np.concatenate(parts)
    return np.arange(len(hip)) / rate, hip


def planned_curve() -> Fixture:
    """Experiment 2: the elbow's curve, 5.3 points a millimetre, infinite along its normal."""
    from vfplan.planning.plan import plan
    from vfplan.planning.settings import ExtractSettings, FixtureSettings

    sample = files("vfplan.samples")
    return plan(
        sample / "elbow.png",
        sample / "elbow_markers_image.csv",
        sample / "elbow_markers_robot.csv",
        extraction=ExtractSettings(pixel_spacing_mm=(0.5, 0.5)),
        settings=FixtureSettings(density_per_m=5300.0),
    ).fixture


FILES = (
    "experiment-1-force.png",
    "experiment-1-scene.png",
    "experiment-2-force.png",
    "experiment-2-scene.png",
    "experiment-2-slice.png",
)
"""The pictures that `draw` writes."""


def draw(folder: Path) -> dict[str, dict[str, float]]:
    """Draw the paper's Figs. 4a, 4b, 6a and 6b, and the depth on the slice, as `FILES`.

    Returns the numbers of each experiment.
    """
    from vfplan.figures.replay import scene, slice_depth, timeline
    from vfplan.figures.style import save_png
    from vfplan.images.read import read_image

    numbers = {}
    hand = Path(str(files("vfplan.samples") / "elbow_session.csv"))
    for name, fixture, session in (
        ("experiment-1", square(), probing_hand()),
        ("experiment-2", planned_curve(), hand),
    ):
        replayed = replay(fixture, session)
        metrics = replayed.metrics
        save_png(timeline(replayed), folder / f"{name}-force.png")
        save_png(scene(replayed), folder / f"{name}-scene.png")
        # Adding 0 turns a rounded -0.0 into 0.0.
        clearance_min_um = round(1e6 * metrics["clearance_min_m"], 2) + 0.0
        numbers[name] = {
            "points": len(fixture.points),
            "ticks": metrics["ticks"],
            "contacts": len(metrics["episodes"]),
            "force_max_n": metrics["force_max_n"],
            "penetration_max_mm": 1e3 * metrics["penetration_max_m"],
            "clearance_min_um": clearance_min_um,
        }
    image = read_image(files("vfplan.samples") / "elbow.png")
    save_png(slice_depth(replayed, image), folder / "experiment-2-slice.png")
    return numbers
