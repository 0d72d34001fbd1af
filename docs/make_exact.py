"""Print how far rules `exact` and `robust` are from the exact proxy on the planar scenes.

python docs/make_exact.py        (the table of docs/engine.md; a few minutes)

The truth is that of `vfplan.scenes`: small steps of a god-object, by another method. A tick
whose truth moves more than 20 times as far as the HIP is the moment of a jump, and left out. Arcs
of a fit go through the scene's points 0.5 mm apart, as a plan has them.
"""

from __future__ import annotations

import numpy as np

import vfplan
from vfplan.bench.proxy import fitted
from vfplan.scenes import SCENES

R = 5e-3
PLANAR = ("circle", "wedge", "corner", "channel", "omega", "teapot")
JUMP = 20
"""How many times as far as the HIP a truth moves in a tick in which it jumps."""
HEAD = "exact um", "fit um", "robust um", "exact N", "robust N", "truth N", "exact us", "robust us"


def judge(engine, scene, hips, truth):
    """RMS error [um], largest force step [N], median tick [us]; of the truth itself without one."""
    proxy = truth
    tick_us = np.zeros(1)
    if engine is not None:
        engine.reset(hips[0])
        trace, tick_us = engine.run_timed(hips)
        proxy = trace.proxy
    is_calm = np.ones(len(hips), bool)
    moved = np.linalg.norm(np.diff(truth, axis=0), axis=1)
    is_calm[1:] = moved <= JUMP * np.linalg.norm(np.diff(hips, axis=0), axis=1) + 1e-12
    is_calm[:-1] &= is_calm[1:]
    error = np.linalg.norm(proxy - truth, axis=1)[is_calm]
    step = np.linalg.norm(np.diff(scene.force(hips, proxy), axis=0), axis=1)[is_calm[1:]]
    return 1e6 * np.sqrt((error**2).mean()), step.max(), np.median(tick_us)


def rows():
    """The lines of the table; the times are last."""
    yield ("{:<16}" + "{:>10}" * 8).format("", *HEAD)
    for name in PLANAR:
        scene = SCENES[name]()
        exact_engine = vfplan.ProxyEngine.along(scene.lines_and_arcs, R)
        robust_engine = vfplan.ProxyEngine(scene.points, R, ignore_axis="z")
        fit_engine = vfplan.ProxyEngine.along(fitted(scene), R)
        for route in scene.routes:
            hips = scene.path(route, speed=0.1)
            truth = scene.truth(hips, R)
            perfect = judge(None, scene, hips, truth)
            exact = judge(exact_engine, scene, hips, truth)
            robust = judge(robust_engine, scene, hips, truth)
            fit = judge(fit_engine, scene, hips, truth)
            errors = f"{exact[0]:>10.4f}{fit[0]:>10.2f}{robust[0]:>10.2f}"
            steps = f"{exact[1]:>10.4f}{robust[1]:>10.4f}{perfect[1]:>10.4f}"
            yield f"{f'{name} {route}':<16}{errors}{steps}{exact[2]:>10.2f}{robust[2]:>10.2f}"


if __name__ == "__main__":
    for line in rows():
        print(line)
