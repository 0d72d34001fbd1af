"""Print what one setting at a time does to error and tick: `python docs/make_sweeps.py`.

The table of docs/accuracy.md, section Sweeps. A hand slides over a ball of 30 mm, or over a sheet,
at 30 % of R behind the surface and at 0.1 m/s, 1000 ticks. The true proxy is known in closed form.
A minute.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vfplan import ProxyEngine
from vfplan.scenes import Sphere

sys.path.insert(0, str(Path(__file__).parent))
from accuracy_tables import micrometres, microseconds, table

BALL_M = 0.03
TICKS = 1000


@dataclass(frozen=True)
class Cost:
    """RMS and largest error [m], median and p99.9 of a tick [µs], memory [bytes], largest K |e|."""

    error_m: float
    force_n: float
    median_us: float
    tail_us: float
    megabytes: float


def slide(points, hips, truth, stiffness=1000.0, **settings) -> Cost:
    """What it costs to slide over a cloud."""
    engine = ProxyEngine(points, stiffness=stiffness, **settings)
    repeats = []
    for _ in range(3):
        engine.reset(truth[0] + (truth[0] - hips[0]))
        trace, us = engine.run_timed(hips)
        repeats.append(us)
    us = np.min(repeats, axis=0)
    # The first ticks close the contact.
    error = np.linalg.norm(trace.proxy - truth, axis=1)[50:]
    median, tail = np.quantile(us, [0.5, 0.999])
    rms = float(np.sqrt(np.mean(error**2)))
    return Cost(rms, stiffness * float(error.max()), median, tail, engine.native.bytes / 1e6)


def on_ball(spacing=0.5e-3, radius=5e-3, speed=0.1, offset=0.0, dtype=float, **settings) -> Cost:
    """A great circle that no row of points follows."""
    angle = speed * 1e-3 / BALL_M * np.arange(TICKS)
    first, second = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [0.1, 0.9, 0.5]]).T)[0].T
    out = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    points = (Sphere(spacing=spacing).points + offset).astype(dtype).astype(float)
    truth = (BALL_M + radius) * out + offset
    return slide(points, truth - 0.3 * radius * out, truth, contact_radius=radius, **settings)


def on_sheet(count: int) -> Cost:
    """A sheet of about so many points, 0.5 mm apart."""
    side = round(count**0.5)
    x, z = np.meshgrid(0.5e-3 * np.arange(side), 0.5e-3 * np.arange(side))
    points = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    place = np.linspace(0.3, 0.6, TICKS)[:, None] * [0.0155, 0.0, 0.0131] + [0.0, 5e-3, 0.0]
    return slide(points, place - [0.0, 1.5e-3, 0.0], place)


def sweeps():
    """Name, values, costs, and what a user makes of it."""
    radii = (1, 2, 5, 10, 20)
    yield (
        "contact radius [mm]", radii, [on_ball(radius=1e-3 * r) for r in radii],
        "The error stays; a larger ball holds more points and costs more. Take your tool's radius.",
    )  # fmt: skip
    densities = (0.5, 1, 2, 4, 8)
    yield (
        "points a millimetre", densities, [on_ball(spacing=1e-3 / d) for d in densities],
        "Twice as many divide the error by four, down to the band. More than 4 buy nothing here.",
    )  # fmt: skip
    speeds = (0.02, 0.1, 0.3, 1)
    yield (
        "hand speed [m/s]", speeds, [on_ball(speed=v) for v in speeds],
        "The proxy keeps up with the hand, by more iterations in a tick.",
    )  # fmt: skip
    stiffness = (100, 1000, 10000, 100000)
    costs = [on_ball(stiffness=float(k)) for k in stiffness]
    forces = ", ".join(f"{cost.force_n:.2g}" for cost in costs)
    yield (
        "K [N/m]", stiffness, costs,
        f"K does not move the proxy. It scales the error of the force: {forces} N at most.",
    )  # fmt: skip
    gains = (0.1, 0.3, 0.6, 1)
    yield (
        "ξ of rule `paper`", gains, [on_ball(rule="paper", gain=g) for g in gains],
        "A small ξ lets the proxy lag, and costs no less. `robust` and `exact` have no ξ.",
    )  # fmt: skip
    offsets = (0, 1, 10, 1000)
    costs = [on_ball(offset=float(o), dtype=np.float32) for o in offsets]
    yield (
        "float32 points, metres from the origin", offsets, costs,
        "float32 is enough within a robot's reach, and not in coordinates of a hall.",
    )  # fmt: skip
    counts = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
    costs = [on_sheet(n) for n in counts]
    yield (
        "points N on a sheet, 0.5 mm apart", [f"10^{len(str(n)) - 1}" for n in counts], costs,
        "A tick does not feel the size of the cloud. Memory does: 10^7 points take "
        f"{costs[-1].megabytes:.0f} MB.",
    )  # fmt: skip


def make() -> str:
    """The table in Markdown."""
    rows = []
    for name, values, costs, meaning in sweeps():
        errors = ", ".join(micrometres(cost.error_m) for cost in costs)
        ticks = ", ".join(
            f"{microseconds(cost.median_us)} / {microseconds(cost.tail_us)}" for cost in costs
        )
        rows.append([name, ", ".join(map(str, values)), errors, ticks, meaning])
    head = ["setting", "values", "RMS error [µm]", "tick, median / p99.9 [µs]", "what it means"]
    return table(head, rows)


if __name__ == "__main__":
    print(make())
