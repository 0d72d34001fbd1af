"""The paper's own scenes, drawn by `vfplan demo paper -o DIR`.

    fig2  a point, a segment, the teapot and the Ω, felt with a pointer
    fig4  Experiment 1: a square of 40 401 points, probed on both sides
    fig5  the planned slice and its binary image
    fig6  Experiment 2: every mask pixel of the planned curve a point, z ignored

Each writes PNGs laid out as the paper's figure with its numbers beside it, and `NAME.json` with the
same numbers for both rules. Neither the paper's hand movements nor its images were published. So
the paths here are scripted, and the slice, the teapot and the Ω are drawn anew. What the scenes fix
can be compared with the paper: points, densities, which side is felt, what lies inside.
"""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vfplan.samples.experiments import probing_hand, square

from vfplan.fixture import Fixture, Provenance, Rendering
from vfplan.replaying.replay import Replay, replay
from vfplan.scenes import SCENES
from vfplan.session.read import read_session
from vfplan.session.session import Session

Array = NDArray[np.float64]
SIMULATIONS = {"fig2a": "point", "fig2b": "segment", "fig2c": "teapot", "fig2d": "omega"}
"""The panels of Fig. 2, each with the name of its scene."""
FILES = (
    "fig2.png",
    "fig2.json",
    "fig4.png",
    "fig4.json",
    "fig5.png",
    "fig5.json",
    "fig6.png",
    "fig6.json",
)
"""The files that `draw` writes."""
MOUSE_HZ = 50.0
"""Rate of the pointer of Sect. III-A [Hz]."""
MOUSE_M_S = 0.03
"""Speed of a hand that follows a line [m/s]."""
OFFSET_M = 2e-3
"""Metres from the drawn line to the pointer's path, which so runs 3 mm behind the surface that lies
R = 5 mm before the line."""
WAVER_M = 0.4e-3
"""Metres by which a hand that follows a line strays to either side."""
PAPER: dict[str, dict[str, Any]] = {
    "fig4": {"points": 40401, "density_per_mm": 2.01},
    "fig6": {"points": 2204, "density_per_mm": 5.3},
}
"""The numbers that the paper states."""


def simulation(name: str) -> tuple[Fixture, Session]:
    """One of the four clouds of Fig. 2 in the plane, and a pointer that goes left to right."""
    from vfplan.engine.parameters import ProxyParameters

    scene = SCENES[name]()
    points = scene.points * [1.0, 1.0, 0.0]
    parameters = ProxyParameters.make(points, ignore_axis="z")
    rendering = Rendering(
        parameters.stiffness,
        parameters.contact_radius,
        parameters.band,
        ignore_axis=parameters.ignore_axis,
    )
    provenance = Provenance("2026-01-01T00:00:00Z", "vfplan")
    hip = pointer(scene, name)
    session = Session(np.arange(len(hip)) / MOUSE_HZ, hip, name=f"pointer along the {name}")
    return Fixture("robot_base", points, provenance, rendering=rendering), session


def pointer(scene: Any, name: str) -> Array:
    """(T, 3) the mouse at 50 Hz, not quite steady in place or speed [m]."""
    if name in ("point", "segment"):
        end = np.abs(scene.points[:, 0]).max() + 0.02
        height = OFFSET_M
        if name == "point":
            height = 1e-3
        route = np.array([[-end, height], [end, height]])
    else:
        route = route_along_line(scene, name)
    s = np.r_[0, np.cumsum(np.linalg.norm(np.diff(route, axis=0), axis=1))]
    ticks = round(s[-1] / MOUSE_M_S * MOUSE_HZ)
    share = np.linspace(0, 1, ticks)
    travelled = s[-1] * (share + 0.012 * np.sin(19 * share) * np.sin(np.pi * share))
    x = np.interp(travelled, s, route[:, 0])
    y = np.interp(travelled, s, route[:, 1])
    path = np.column_stack([x, y])
    t = np.arange(ticks) / MOUSE_HZ
    path[:, 1] += WAVER_M * np.sin(2 * np.pi * 0.9 * t) * np.sin(np.pi * share)
    return np.column_stack([path, 0 * share])


def route_along_line(scene: Any, name: str) -> Array:
    """(M, 2) a route 2 mm outside the drawn line, from left to right, with its corners cut."""
    line = np.vstack([run.sample(1e-3) for run in scene.runs])
    if name == "teapot":
        # The scene goes counter-clockwise. Its upper half is taken the other way round.
        is_upper = line[:, 1] > 0.3 * line[:, 1].max()
        line = line[is_upper][::-1]
    step = np.gradient(line, axis=0)
    normal = np.column_stack([-step[:, 1], step[:, 0]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    outside = line + OFFSET_M * normal
    # A mean over 13 mm of the line cuts the corners.
    kernel = np.ones(13) / 13
    x = np.convolve(outside[:, 0], kernel, "valid")
    y = np.convolve(outside[:, 1], kernel, "valid")
    route = np.column_stack([x, y])
    first = route[0] - 0.02 * np.array([1.0, -0.3])
    last = route[-1] + 0.02 * np.array([1.0, 0.3])
    return np.vstack([first, route, last])


def planned_mask() -> tuple[Fixture, float]:
    """Experiment 2 in the paper's way: every mask pixel a point; and its density [points/mm]."""
    from vfplan.planning.plan import plan
    from vfplan.planning.settings import ExtractSettings

    sample = files("vfplan.samples")
    result = plan(
        sample / "elbow.png",
        sample / "elbow_markers_image.csv",
        sample / "elbow_markers_robot.csv",
        extraction=ExtractSettings(method="mask", pixel_spacing_mm=(0.5, 0.5)),
    )
    return result.fixture, result.report["extract"]["density_per_mm"]


def scene_of(figure: str) -> tuple[Fixture, Session, float | None]:
    """Fixture, session and density [points/mm] of a figure."""
    if figure in SIMULATIONS:
        return *simulation(SIMULATIONS[figure]), None
    if figure == "fig4":
        fixture = square()
        side = np.unique(fixture.points[:, 0])
        return fixture, probing_hand(), len(side) / (np.ptp(side) * 1e3)
    fixture, density = planned_mask()
    return fixture, read_session(files("vfplan.samples") / "elbow_session.csv"), density


def reproduce(figure: str) -> tuple[Replay, dict[str, Any]]:
    """A replay by the paper's rule, and the numbers of both rules beside the paper's."""
    fixture, session, density = scene_of(figure)
    # The paper's rule has the band of 10 µm that the paper states.
    with_papers_band = replace(fixture, rendering=replace(fixture.rendering, band=1e-5))
    by_paper = replay(with_papers_band, session, rule="paper")
    by_robust = replay(fixture, session, rule="robust")
    numbers: dict[str, Any] = {"points": len(fixture.points)}
    if density is not None:
        numbers["density_per_mm"] = density
    if figure in PAPER:
        numbers["in_the_paper"] = PAPER[figure]
    numbers["paper"] = summary(by_paper)
    numbers["robust"] = summary(by_robust)
    return by_paper, numbers


def simulations_page() -> str:
    """Fig. 2 as one HTML page that needs no network: the mouse is the tip, the engine answers."""
    from vfplan.engine.browser import bodies_of, module, packed
    from vfplan.report.page import document, part, scene_data, scripts

    scenes = {}
    for name in SIMULATIONS.values():
        fixture, _ = simulation(name)
        scenes[name] = scene_data(fixture) | {
            "bodies": {rule: bodies_of(fixture, rule) for rule in ("robust", "paper")}
        }
    body = part("simulations.html").replace("{scene}", part("scene.html"))
    data = {"module": packed(module()), "scenes": scenes}
    return document("Four simulations", body + scripts(data, part("simulations.js")))


def summary(replayed: Replay) -> dict[str, Any]:
    """The numbers of a replay: contacts, depth, force on each side, what went inside."""
    metrics = replayed.metrics
    force = replayed.ticks.force
    axis = int(np.abs(force).max(axis=0).argmax())
    return {
        "contacts": len(metrics["episodes"]),
        "penetration_max_mm": 1e3 * metrics["penetration_max_m"],
        "force_max_n": metrics["force_max_n"],
        "strongest_axis": "xyz"[axis],
        "force_least_n": float(force[:, axis].min()),
        "force_most_n": float(force[:, axis].max()),
        "clearance_min_um": 1e6 * metrics["clearance_min_m"],
        "entrenched_ticks": metrics["entrenched_ticks"],
        "ticks": metrics["ticks"],
    }


def draw(folder: Path) -> dict[str, dict[str, Any]]:
    """Write every figure and its numbers, as `FILES`; returns the numbers of each figure."""
    from vfplan.samples.paper_figures import draw_experiment, draw_plan, draw_simulations

    numbers_of_figures: dict[str, dict[str, Any]] = {}

    numbers_of_scenes = {}
    panels = {}
    for panel, scene in SIMULATIONS.items():
        replayed, numbers = reproduce(panel)
        panels[panel] = (scene, replayed, numbers)
        numbers_of_scenes[scene] = numbers
    draw_simulations(panels, folder / "fig2.png")
    numbers_of_figures["fig2"] = numbers_of_scenes

    replayed, numbers_of_figures["fig4"] = reproduce("fig4")
    draw_experiment(replayed, numbers_of_figures["fig4"], folder / "fig4.png")

    slice_file = files("vfplan.samples") / "elbow.png"
    numbers_of_figures["fig5"] = draw_plan(slice_file, folder / "fig5.png")

    replayed, numbers_of_figures["fig6"] = reproduce("fig6")
    draw_experiment(replayed, numbers_of_figures["fig6"], folder / "fig6.png")

    for figure, numbers in numbers_of_figures.items():
        (folder / f"{figure}.json").write_text(json.dumps(numbers, indent=1) + "\n")
    return numbers_of_figures
