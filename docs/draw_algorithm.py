"""Draw the pictures of docs/algorithm.md:  python docs/draw_algorithm.py

The paper's four states on a drawn curve, and the concave corner with either rule.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import vfplan
from vfplan import palette
from vfplan.figures import style
from vfplan.scenes import Corner, Omega, travel

PICTURES = Path(__file__).with_name("pictures")
RC = 5e-3
NAMES = {-1: "no neighbour", 0: "free motion", 1: "in contact", 2: "entrenched"}


def circle(axes, centre, radius, **look):
    """A circle around a position [m], drawn in millimetres."""
    angle = np.linspace(0, 2 * np.pi, 181)
    x = centre[0] + radius * np.cos(angle)
    y = centre[1] + radius * np.sin(angle)
    axes.plot(1e3 * x, 1e3 * y, **look)


def arrow(axes, start, vector, colour):
    """An arrow from a position [m] along a vector [m], drawn in millimetres."""
    tail = 1e3 * np.asarray(start)[:2]
    head = 1e3 * (np.asarray(start) + vector)[:2]
    axes.annotate("", head, tail, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.5})


def states() -> None:
    """Four proxies above the top of an Ω, one in each state, with n and u."""
    scene = Omega(spacing=1e-3)
    top = np.array([0.0, 74.5e-3, 0.0])
    with style.style():
        figure = style.new_figure(7.5, 2.6)
        panels = figure.subplots(1, 4, sharex=True, sharey=True)
    for axes, height in zip(panels, (13e-3, 7.2e-3, RC, 3.2e-3), strict=True):
        shift = np.array([[0, height, 0], [4e-3, min(height - 3e-3, 1.5e-3), 0]])
        proxy, hip = top + shift
        engine = vfplan.reference.PaperProxy(scene.points, ignore_axis="z")
        engine.reset(proxy)
        step = engine.step(hip)
        axes.plot(*(1e3 * scene.points[:, :2].T), ".", color=palette.CLOUD, ms=3)
        circle(axes, proxy, RC, color=palette.PROXY, lw=1.4)
        circle(axes, proxy, 2 * RC, color=palette.PROXY, lw=0.6, ls=":")
        axes.plot(*(1e3 * proxy[:2]), "o", color=palette.PROXY, ms=3)
        axes.plot(*(1e3 * hip[:2]), "o", color=palette.TIP, ms=5)
        arrow(axes, proxy, hip - proxy, palette.FORCE)
        if step.state >= 0:
            arrow(axes, proxy, 6e-3 * step.normal, palette.PROXY)
        circle(axes, step.proxy, RC, color=palette.PROXY, lw=1.0, ls="--")
        axes.set_title(f"{step.state}: {NAMES[step.state]}")
        axes.set_aspect("equal")
        axes.set(xlim=(-14, 16), ylim=(64, 99), xlabel="x [mm]")
    panels[0].set_ylabel("y [mm]")
    style.save_png(figure, PICTURES / "algorithm_states.png")


def corner() -> None:
    """Along a floor into a wall, 2 mm deep, at 0.5 m/s: where each rule's proxy went."""
    scene = Corner(leg=0.05)
    stops = [[0.03, 0.01, 0], [0.03, -2e-3, 0], [-5e-3, -2e-3, 0]]
    hips = np.vstack([travel(stops, 0.5), np.tile(stops[-1], (60, 1))])
    with style.style():
        figure = style.new_figure(7.5, 3.2)
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, rule in zip(panels, ("paper", "robust"), strict=True):
        engine = vfplan.ProxyEngine(scene.points, rule=rule, ignore_axis="z")
        engine.reset(hips[0])
        proxy = engine.run(hips).proxy
        gaps = np.linalg.norm(proxy[:, None] - scene.points[None], axis=2).min(axis=1)
        worst = int(gaps.argmin())
        axes.plot(*(1e3 * scene.points[:, :2].T), ".", color=palette.CLOUD, ms=3, label="cloud")
        axes.plot(*(1e3 * hips[:, :2].T), color=palette.TIP, lw=1.0, label="HIP")
        axes.plot(
            *(1e3 * proxy[:, :2].T), ".-", color=palette.RULE[rule], lw=1, ms=3, label="proxy"
        )
        drawn_tick = -1
        if gaps[worst] < RC - 1e-4:
            drawn_tick = worst
        circle(axes, proxy[drawn_tick], RC, color=palette.PROXY, lw=1.2)
        depth = 1e3 * max(RC - gaps[worst], 0.0)
        axes.set_title(f"{rule}: {depth:.3f} mm inside at worst")
        axes.set_aspect("equal")
        axes.set(xlim=(-8, 34), ylim=(-5, 19), xlabel="x [mm]")
        axes.legend(loc="upper right")
    panels[0].set_ylabel("y [mm]")
    style.save_png(figure, PICTURES / "algorithm_corner.png")


def main() -> None:
    """Both pictures."""
    PICTURES.mkdir(exist_ok=True)
    states()
    corner()


if __name__ == "__main__":
    main()
