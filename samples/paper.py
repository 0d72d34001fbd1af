"""The paper's own scenes, drawn by `vfplan demo paper -o DIR`.

    fig2  a point, a segment, the teapot and the Ω, felt with a pointer
    fig4  Experiment 1: a square of 40 401 points, probed on both sides
    fig5  the planned slice and its binary image
    fig6  Experiment 2: every mask pixel of the planned curve a point, z ignored

Each writes PNGs laid out as the paper's figure with its numbers beside it, and `NAME.json` with the
same numbers for both rules. The paper's hands were not published, nor were its images: paths are
scripted, the slice, the teapot and the Ω are drawn anew. So the pictures show the same things, and
only what the scenes fix (points, densities, which side is felt, what lies inside) can be compared.
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
from vfplan.replaying import Replay, replay
from vfplan.scenes import SCENES
from vfplan.session import Session, read_session

Array = NDArray[np.float64]
SIMULATIONS = {"fig2a": "point", "fig2b": "segment", "fig2c": "teapot", "fig2d": "omega"}
FIGURES = ("fig2", "fig4", "fig5", "fig6")
FILES = tuple(f"{name}.{kind}" for name in FIGURES for kind in ("png", "json"))
MOUSE_HZ = 50.0
"""Rate of the pointer of Sect. III-A [Hz]."""
MOUSE_M_S = 0.03
"""Speed of a hand that follows a line [m/s]."""
BESIDE_M = 2e-3  # of the line: 3 mm behind the surface that R = 5 mm puts before it
WAVER_M = 0.4e-3
PAPER: dict[str, dict[str, Any]] = {
    "fig4": {"points": 40401, "density_per_mm": 2.01},
    "fig6": {"points": 2204, "density_per_mm": 5.3},
}


def simulation(name: str) -> tuple[Fixture, Session]:
    """One of the four clouds of Fig. 2 in the plane, and a pointer that goes left to right."""
    from vfplan.engine.parameters import ProxyParameters

    scene = SCENES[name]()
    points = scene.points * [1.0, 1.0, 0.0]
    chosen = ProxyParameters.make(points, ignore_axis="z")
    rendering = Rendering(chosen.stiffness, chosen.rc, chosen.band, ignore_axis=chosen.ignore_axis)
    provenance = Provenance("2026-01-01T00:00:00Z", "vfplan")
    hip = pointer(scene, name)
    session = Session(np.arange(len(hip)) / MOUSE_HZ, hip, name=f"pointer along the {name}")
    return Fixture("robot_base", points, provenance, rendering=rendering), session


def pointer(scene: Any, name: str) -> Array:
    """(T, 3) the mouse at 50 Hz, not quite steady in place or speed [m]."""
    if name in ("point", "segment"):
        end = np.abs(scene.points[:, 0]).max() + 0.02
        way = np.array([[-end, 1e-3 if name == "point" else BESIDE_M], [end, BESIDE_M]])
        way[:, 1] = way[0, 1]
    else:
        way = beside(scene, name)
    s = np.r_[0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))]
    ticks = round(s[-1] / MOUSE_M_S * MOUSE_HZ)
    share = np.linspace(0, 1, ticks)
    at = s[-1] * (share + 0.012 * np.sin(19 * share) * np.sin(np.pi * share))
    path = np.column_stack([np.interp(at, s, way[:, k]) for k in (0, 1)])
    t = np.arange(ticks) / MOUSE_HZ
    path[:, 1] += WAVER_M * np.sin(2 * np.pi * 0.9 * t) * np.sin(np.pi * share)
    return np.column_stack([path, 0 * share])


def beside(scene: Any, name: str) -> Array:
    """(M, 2) 2 mm outside the drawn line, from its left to its right, with corners cut."""
    line = np.vstack([run.sample(1e-3) for run in scene.runs])
    if name == "teapot":  # the upper half, counter-clockwise in the scene: turn it round
        line = line[line[:, 1] > 0.3 * line[:, 1].max()][::-1]
    step = np.gradient(line, axis=0)
    normal = np.column_stack([-step[:, 1], step[:, 0]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    width = 13
    out = np.column_stack([
        np.convolve((line + BESIDE_M * normal)[:, k], np.ones(width) / width, "valid")
        for k in (0, 1)
    ])  # fmt: skip
    ahead = out[0] - 0.02 * np.array([1.0, -0.3])
    return np.vstack([ahead, out, out[-1] + 0.02 * np.array([1.0, 0.3])])


def planned_mask() -> tuple[Fixture, float]:
    """Experiment 2 in the paper's way: every mask pixel a point; and its density [points/mm]."""
    from vfplan.planning import ExtractSettings, plan

    sample = files("vfplan.samples")
    made = plan(
        sample / "elbow.png",
        sample / "elbow_markers_image.csv",
        sample / "elbow_markers_robot.csv",
        extraction=ExtractSettings(method="mask", pixel_spacing_mm=(0.5, 0.5)),
    )
    return made.fixture, made.report["extract"]["density_per_mm"]


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
    """The paper's rule on a scene, and the numbers of both rules beside the paper's."""
    fixture, session, density = scene_of(figure)
    own_band = replace(fixture, rendering=replace(fixture.rendering, band=1e-5))
    runs = {
        "paper": replay(own_band, session, rule="paper"),
        "robust": replay(fixture, session, rule="robust"),
    }
    numbers: dict[str, Any] = {"points": len(fixture.points)}
    if density is not None:
        numbers["density_per_mm"] = density
    if figure in PAPER:
        numbers["in_the_paper"] = PAPER[figure]
    numbers |= {rule: told(run) for rule, run in runs.items()}
    return runs["paper"], numbers


def told(run: Replay) -> dict[str, Any]:
    """What a figure says of a replay: contacts, depth, force on each side, what went inside."""
    m, ticks = run.metrics, run.ticks
    axis = int(np.abs(ticks.force).max(axis=0).argmax())
    return {
        "contacts": len(m["episodes"]),
        "penetration_max_mm": 1e3 * m["penetration_max_m"],
        "force_max_n": m["force_max_n"],
        "strongest_axis": "xyz"[axis],
        "force_least_n": float(ticks.force[:, axis].min()),
        "force_most_n": float(ticks.force[:, axis].max()),
        "clearance_min_um": 1e6 * m["clearance_min_m"],
        "entrenched_ticks": m["entrenched_ticks"],
        "ticks": m["ticks"],
    }


def draw(folder: Path) -> dict[str, dict[str, Any]]:
    """Write every figure and its numbers, `FILES`; the numbers by figure."""
    found = {figure: _draw_one(figure, folder) for figure in FIGURES}
    for figure, numbers in found.items():
        (folder / f"{figure}.json").write_text(json.dumps(numbers, indent=1) + "\n")
    return found


def _draw_one(figure: str, folder: Path) -> dict[str, Any]:
    from vfplan.samples.paper_figures import draw_experiment, draw_plan, draw_simulations

    if figure == "fig5":
        return draw_plan(files("vfplan.samples") / "elbow.png", folder / "fig5.png")
    if figure == "fig2":
        shown = {panel: reproduce(panel) for panel in SIMULATIONS}
        draw_simulations({p: (SIMULATIONS[p], *r) for p, r in shown.items()}, folder / "fig2.png")
        return {SIMULATIONS[panel]: numbers for panel, (_, numbers) in shown.items()}
    run, numbers = reproduce(figure)
    draw_experiment(run, numbers, folder / f"{figure}.png")
    return numbers
