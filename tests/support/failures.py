"""Where the paper's rule fails: each scene in code, measured for either rule.

Run as a program it prints the table of docs/algorithm.md:

    .venv/bin/python tests/support/failures.py
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

import vfplan
from vfplan.scenes import Channel, Corner, grid, travel

K = 1000.0
RC = 5e-3


def floor(h=0.5e-3, half=0.03):
    """A square in the plane y = 0, around the origin."""
    side = 2 * half
    return grid(np.array([-half, 0, -half]), np.array([side, 0, 0]), np.array([0, 0, side]), h)


def inside(points, proxy):
    """Depth of the proxy below RC from the nearest point, a value a tick [m]."""
    return RC - cKDTree(points).query(proxy)[0]


def measure(points, hips, rule, **settings):
    engine = vfplan.ProxyEngine(points, rule=rule, stiffness=K, **settings)
    engine.reset(hips[0])
    return engine.run(hips)


def lift_off(rule):
    """Press 5 mm deep on a sheet, lift 60 mm exactly along its normal."""
    hips = travel([[0, 0.02, 0], [0, -0.005, 0], [0, 0.055, 0]], speed=0.2)
    trace = measure(floor(), hips, rule)
    return {"pull-back after 60 mm of lift [N]": float(np.linalg.norm(trace.force[-1]))}


def corner(rule):
    """Slide along the floor into the wall of a 90 degree corner, 2 mm deep, 0.1 to 2 m/s."""
    scene = Corner(leg=0.06, extrude=0.04)
    worst, ticks = 0.0, 0
    for speed in (0.1, 0.5, 1.0, 2.0):
        way = [[0.04, 0.01, 0], [0.04, -2e-3, 0], [-5e-3, -2e-3, 0]]
        hips = np.vstack([travel(way, speed), np.tile(way[-1], (300, 1))])
        trace = measure(scene.points, hips, rule)
        worst = max(worst, float(inside(scene.points, trace.proxy).max()))
        ticks = max(ticks, int((trace.state == 2).sum()))
    return {"inside the other wall [mm]": 1e3 * worst, "ticks entrenched": ticks}


def press_through(rule, speed, rate):
    """Press through a sheet at constant speed; the worst of 40 phases of the sampling."""
    points, worst = floor(half=0.02), 0.0
    for phase in np.arange(40) / 40:
        start = np.array([0.1e-3, 0.03 + phase * speed / rate, 0.2e-3])
        hips = travel([start, start * [1, 0, 1] - [0, 0.03, 0]], speed, rate)
        trace = measure(points, hips, rule)
        through = trace.proxy[:, 1] < 0
        depth = np.where(through, RC - trace.proxy[:, 1], inside(points, trace.proxy))
        worst = max(worst, float(depth.max()))
    return {f"inside at {speed:g} m/s, {rate:g} Hz [mm]": 1e3 * worst}


def point_radius(rule, rv):
    """Slide 32 mm along a sheet of fat points, 2 mm below its surface."""
    way = [[-0.016, 0.03, 0], [-0.016, RC + rv - 2e-3, 0], [0.016, RC + rv - 2e-3, 0]]
    trace = measure(floor(), travel(way, 0.1), rule, point_radius=rv)
    return {f"false drag at r_v = {1e3 * rv:g} mm [N]": float(np.abs(trace.force[:, 0]).max())}


def channel(rule):
    """Through a channel 10.005 mm wide that the proxy of 10 mm just fits, pressing on its walls."""
    scene = Channel(spacing=0.5e-3, extrude=0.03)
    way = [[-0.045, 0, 0], [-0.02, 0, 0], [0.0, 3e-3, 0], [0.02, -3e-3, 0], [0.045, 0, 0]]
    trace = measure(scene.points, travel(way, 0.1), rule)
    depth = inside(scene.points, trace.proxy)
    return {
        "inside in the channel [mm]": 1e3 * float(depth.max()),
        "ticks inside": int((depth > 0.1e-3).sum()),
    }


def coarse(rule, spacing):
    """Press 3 mm into a coarse sheet and slide 30 mm askew."""
    points = floor(spacing, half=0.032)
    way = [[-0.015, 0.02, -0.01], [-0.015, -3e-3, -0.01], [0.015, -3e-3, 0.007]]
    trace = measure(points, travel(way, 0.05), rule)
    depth = inside(points, trace.proxy).max()
    return {
        f"inside at spacing {1e3 * spacing:g} mm [mm]": 1e3 * float(depth),
        f"lowest proxy at spacing {1e3 * spacing:g} mm [mm]": 1e3 * float(trace.proxy[:, 1].min()),
    }


BAND = 1e3 * 12.6e-6  # the default band of these clouds at 0.5 mm [mm]

# Scene, its settings, what is measured, at least for "paper", at most for "robust".
CASES = [
    (lift_off, (), "pull-back after 60 mm of lift [N]", 49.9, 1e-9),
    (corner, (), "inside the other wall [mm]", 3.2, BAND),
    (corner, (), "ticks entrenched", 150, 0),
    (press_through, (0.5, 50.0), "inside at 0.5 m/s, 50 Hz [mm]", 0.29, BAND),
    (press_through, (1.0, 50.0), "inside at 1 m/s, 50 Hz [mm]", 4.85, BAND),
    (press_through, (5.0, 1000.0), "inside at 5 m/s, 1000 Hz [mm]", 0, BAND),
    (press_through, (10.0, 1000.0), "inside at 10 m/s, 1000 Hz [mm]", 0.29, BAND),
    (point_radius, (6e-3,), "false drag at r_v = 6 mm [N]", 31.0, 1e-3),
    (point_radius, (10e-3,), "false drag at r_v = 10 mm [N]", 31.0, 1e-3),
    (channel, (), "inside in the channel [mm]", 3.0, BAND),
    (channel, (), "ticks inside", 200, 0),
    (coarse, (4e-3,), "inside at spacing 4 mm [mm]", 0.05, 0.8769),  # the band
    (coarse, (4e-3,), "lowest proxy at spacing 4 mm [mm]", 4.0, 5.0),
    (coarse, (8e-3,), "inside at spacing 8 mm [mm]", 1.5, 0.0101),
    (coarse, (8e-3,), "lowest proxy at spacing 8 mm [mm]", -9e9, -4.0),
]


if __name__ == "__main__":
    print(f"{'measured, K = 1000 N/m':44s} {'paper':>9s} {'robust':>9s}")
    for scene, settings, what, _, _ in CASES:
        paper, robust = (scene(rule, *settings)[what] for rule in ("paper", "robust"))
        print(f"{what:44s} {paper:9.4g} {robust:9.4g}")
