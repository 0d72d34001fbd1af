"""Draw the picture of docs/controller.md:  python docs/draw_governor.py

What a governor does to energy (a mass that nobody holds, as the force is let go) and to penetration
(a mass that runs into a wall), by its force step; engine and governor are the controller's own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import vfplan
from vfplan.figures import style

PICTURE = Path(__file__).with_name("pictures") / "governor.png"
K, M, T, R = 1000.0, 1.0, 1e-3, 5e-3
RELEASED, SPEED = 15.8, 1.0  # [N], [m/s]


def governor(step: float, most: float) -> vfplan.Governor:
    """One of this force step, and of this force at most [N]."""
    return vfplan.Governor(force_step_n=step, force_max_n=most, stiffness_n_per_m=K, mass_kg=M)


def pushed(step: float) -> tuple[float, float]:
    """Energy [J] that a free mass has after the release, and what the governor says of it."""
    g = governor(step, RELEASED)
    g.run(np.linspace([0, 0, 0], [RELEASED, 0, 0], 1000))
    speed = 0.0
    for _ in range(2000):
        speed += T * g.step([0.0, 0, 0])[0] / M
    return 0.5 * M * speed**2, g.energy_given_j


def impact(step: float | None) -> tuple[float, float]:
    """Deepest penetration [m] and speed of the rebound [m/s] of a mass that meets a wall."""
    x = np.arange(-0.02, 0.02, 2e-4)
    engine = vfplan.ProxyEngine(np.column_stack([x, 0 * x, 0 * x]), stiffness=K, ignore_axis="z")
    g = None if step is None else governor(step, 40.0)
    place, speed = np.array([0.0, 0.02, 0.0]), -SPEED
    engine.reset(place)
    deepest = 0.0
    for _ in range(400):
        s = engine.step(place)
        force = s.force if g is None else g.step(s.force)
        deepest = max(deepest, float(np.linalg.norm(s.proxy - place)))
        speed += T * force[1] / M
        place[1] += T * speed
    return deepest, speed


def main() -> None:
    """Draw it."""
    figure = style.new_figure(7.0, 3.1)
    with style.style():
        left, right = figure.subplots(1, 2)
    least = RELEASED * T * np.sqrt(K / M) / 2
    steps = np.geomspace(least, 4.0, 24)
    found = np.array([pushed(s) for s in steps])
    fine = np.geomspace(0.1, 4.0, 200)
    left.loglog(fine, 1e3 * RELEASED**4 * T**2 / (8 * M * fine**2), lw=0.9, color=style.FORCE,
                label="$F_0^2 t^2 / 8m$")  # fmt: skip
    left.plot(steps, 1e3 * found[:, 0], "o", ms=3, color=style.HIP, label="a free mass, simulated")
    left.plot(steps, 1e3 * found[:, 1], "x", ms=3, color=style.PROXY, label="energy_given")
    left.axhline(1e3 * RELEASED**2 / (2 * K), color=style.CONTACT, lw=0.9, ls="--",
                 label="stored, $F_0^2 / 2K$")  # fmt: skip
    left.axvspan(0.1, least, color="#eeeeee", label="refused")
    left.set_xlabel("force step [N a tick]")
    left.set_ylabel("energy given [mJ]")
    left.set_title(f"a force of {RELEASED} N let go")
    left.legend(fontsize=7)
    bound = 40 * T * np.sqrt(K / M) / 2
    steps = np.linspace(bound, 2.0, 15)
    felt = np.array([impact(s) for s in steps])
    raw = impact(None)
    right.plot(steps, 1e3 * felt[:, 0], "o-", ms=3, color=style.CLOUD, label="deepest [mm]")
    right.axhline(1e3 * raw[0], color=style.CLOUD, lw=0.9, ls="--", label="without a governor")
    other = right.twinx()
    other.plot(steps, felt[:, 1], "s-", ms=3, color=style.PROXY, label="rebound [m/s]")
    other.axhline(raw[1], color=style.PROXY, lw=0.9, ls="--")
    other.set_ylabel("rebound [m/s]", color=style.PROXY)
    other.grid(visible=False)
    right.set_xlabel("force step [N a tick]")
    right.set_ylabel("deepest penetration [mm]", color=style.CLOUD)
    right.set_title(f"1 kg meets the wall at {SPEED:g} m/s")
    lines = [*right.get_lines()[:2], other.get_lines()[0]]
    right.legend(lines, [line.get_label() for line in lines], fontsize=7)
    style.save_png(figure, PICTURE)
    print(f"raw: {1e3 * raw[0]:.2f} mm, {raw[1]:.3f} m/s")
    for s, (deep, back) in zip(steps, felt, strict=True):
        print(f"{s:.3f} N a tick: {1e3 * deep:.2f} mm, rebound {back:.3f} m/s")


if __name__ == "__main__":
    main()
