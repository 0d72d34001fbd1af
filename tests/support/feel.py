"""Force steps that a sliding hand feels and that the exact proxy does not make.

A curve of arcs is pressed and followed for 160 s at 1 kHz, 0 to 8 mm deep, in minimum-jerk strokes
with a tremor of 8 to 12 Hz, over clouds as they come: even, noisy, of a mask's pixels, dense and
sparse by turns, with gaps. The truth is the nearest place on the curve's offset, in closed form:
nowhere does the HIP reach a centre of curvature, so that it is unique and never jumps.

Error: distance from the exact proxy [m]. Beside it stand

force_jumps, force_jumps_large
    Ticks whose force step differs from the exact proxy's by more than 0.6 N, and 2 N.
force_step_max_n
    The largest such difference [N].
limit_share
    The share of ticks that used up their iterations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vfplan import ProxyEngine, Status, Trace
from vfplan.bench.record import Array, Record, errors_of, timed_ticks
from vfplan.geometry.lines import row_lengths, step_lengths
from vfplan.scenes import Drawn, outline

R, STIFFNESS, RATE_HZ = 5e-3, 1000.0, 1000.0
SPACING, PIXEL = 0.5e-3, 0.25e-3  # of the even cloud, and of a mask
DEEPEST_M, TREMOR_M = 8e-3, 5e-5
JUMP_N, LARGE_N = 0.6, 2.0
# Radius [m] and turn [rad]; left turns are hollows, wide enough for R and half of nine pixels.
BENDS = ((30e-3, 0.2), (6e-3, -0.7), (8e-3, 0.9), (20e-3, -0.8), (12e-3, 0.9), (7e-3, -1.0),
         (40e-3, 0.2), (40e-3, -0.2), (9e-3, 0.8), (10e-3, -0.5), (30e-3, 0.2))  # fmt: skip


class Wave(Drawn):
    """A curve of eleven arcs, hollow and bulging by turns, touched from its left."""

    @cached_property
    def runs(self) -> tuple[outline.Run, ...]:
        """The arcs, each leaving along the last one's tangent."""
        links, at, heading = [], np.zeros(2), 0.0
        for radius, turn in BENDS:
            side = np.sign(turn) * np.array([-np.sin(heading), np.cos(heading)])
            start = np.arctan2(-side[1], -side[0])
            links.append(outline.arc(at + radius * side, radius, float(start), turn))
            at, heading = links[-1].b, heading + turn
        return (outline.Run(tuple(links)),)

    @property
    def routes(self) -> dict[str, Array]:
        """None: a hand's strokes are `hand`."""
        return {}

    def exact(self, hips: Array, radius: float) -> Array:
        """(T, 3) the nearest places [m] to the HIPs (T, 3) at least `radius` left of the curve."""
        flat, best = hips[:, :2], np.full(len(hips), np.inf)
        truth = hips.copy()
        for link in self.runs[0].links:
            sign = np.sign(link.sweep)
            away = flat - link.centre
            turned = (np.arctan2(away[:, 1], away[:, 0]) - link.start) * sign
            turned = np.clip((turned + np.pi) % (2 * np.pi) - np.pi, 0, abs(link.sweep))
            angle = link.start + turned * sign
            outwards = np.column_stack([np.cos(angle), np.sin(angle)])
            foot = link.centre + (link.radius - sign * radius) * outwards
            off = np.hypot(*(flat - foot).T)
            behind = ((flat - foot) * outwards).sum(axis=1) * sign > 0
            near = off < best
            best[near] = off[near]
            truth[near, :2] = np.where(behind[:, None], foot, flat)[near]
        return truth

    def hand(self, seconds: float, radius: float, rng: np.random.Generator) -> Array:
        """(T, 3) HIP positions at 1 kHz [m]: strokes along the curve, pressed and trembling."""
        run, count = self.runs[0], round(seconds * RATE_HZ)
        ends, ticks = [np.array([0.5 * run.length, 0.0])], []
        while sum(ticks) < count:
            ends.append(np.array([rng.uniform(0.15, 0.85) * run.length, rng.uniform(0, DEEPEST_M)]))
            took = max(0.3, abs(ends[-1][0] - ends[-2][0]) / rng.uniform(0.01, 0.08))
            ticks.append(round(took * RATE_HZ))
        stroke = np.repeat(np.arange(len(ticks)), ticks)[:count]
        u = np.concatenate([np.arange(n) / n for n in ticks])[:count, None]
        eased = u**3 * (10 - 15 * u + 6 * u * u)
        a, b = np.array(ends)[stroke], np.array(ends)[stroke + 1]
        s, deep = (a + eased * (b - a)).T
        fine = np.linspace(0, run.length, 20001)
        places = run.sample(run.length / 20000)
        tangent = np.gradient(places, axis=0)
        tangent /= row_lengths(tangent)[:, None]
        left = np.column_stack([-tangent[:, 1], tangent[:, 0]])
        at, n = (np.column_stack([np.interp(s, fine, v) for v in w.T]) for w in (places, left))
        time = np.arange(count)[:, None, None] / RATE_HZ
        turns = 2 * np.pi * (rng.uniform(8, 12, (1, 2, 3)) * time + rng.uniform(0, 1, (1, 2, 3)))
        hips = at + (radius - deep)[:, None] * n + TREMOR_M * np.sin(turns).sum(axis=2)
        return outline.in_space(hips)


@dataclass(frozen=True, eq=False)
class Scanned:
    """A cloud of the curve, and how far its surface lies from the curve [m]."""

    name: str
    points: Array = field(repr=False)
    thick: float = 0.0


def clouds(wave: Wave) -> Iterator[Scanned]:
    """The curve as it comes: sampled evenly, measured, painted, in haste."""
    even, rng = wave.points, np.random.default_rng(25)
    yield Scanned("even", even)
    for share in (0.05, 0.2, 0.5):
        off = share * SPACING * rng.normal(size=(len(even), 2))
        yield Scanned(f"noise {share:.0%}", even + outline.in_space(off))
    for pixels in (3, 5, 9):
        yield Scanned(f"mask {pixels} px", mask(wave, pixels, PIXEL), pixels / 2 * PIXEL)
    yield Scanned("mask 3 coarse px", mask(wave, 3, SPACING), 1.5 * SPACING)
    fine = outline.in_space(wave.runs[0].sample(1e-5))
    s = np.arange(len(fine)) * 1e-5
    waxing = 0.05e-3 * 20 ** (0.5 - 0.5 * np.cos(s / 6e-3))  # 50 um to 1 mm apart, to and fro
    yield Scanned("density 1:20", fine[np.diff(np.floor(np.cumsum(1e-5 / waxing)), append=0) > 0])
    along = np.arange(len(even)) * SPACING
    gone = rng.uniform(1e-3, 2.5e-3, 1 + int(along[-1] / 11e-3))
    yield Scanned("gaps", even[along % 11e-3 >= gone[(along / 11e-3).astype(int)]])


def mask(wave: Wave, pixels: int, pitch: float) -> Array:
    """(N, 3) the middles of the pixels, `pitch` apart [m], that a pen so many wide covers."""
    low, high = wave.points.min(axis=0) - 5e-3, wave.points.max(axis=0) + 5e-3
    x, y = (np.arange(a, b, pitch) for a, b in zip(low[:2], high[:2], strict=True))
    grid = outline.in_space(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    return grid[wave.clearance(grid) <= pixels / 2 * pitch]


def scenes(seconds: float = 160.0) -> Iterator[tuple[str, Record]]:
    """Each cloud with what rules `robust`, `paper` and `exact` do on it."""
    wave = Wave(spacing=SPACING)
    for cloud in clouds(wave):
        radius = R + cloud.thick
        hips = wave.hand(seconds, radius, np.random.default_rng(0))
        truth = wave.exact(hips, radius)
        engines = {
            "robust": ProxyEngine(cloud.points, R, ignore_axis="z"),
            "paper": ProxyEngine(cloud.points, R, ignore_axis="z", rule="paper"),
            "exact": ProxyEngine.along(wave.lines_and_arcs, radius),
        }
        points, band_m = len(cloud.points), engines["robust"].parameters.band
        records: Record = {"points": points, "band_m": band_m}
        for name, engine in engines.items():
            records[name] = judge(timed_ticks(engine, hips)[0], hips, truth)
        yield cloud.name, records


def judge(trace: Trace, hips: Array, truth: Array) -> Record:
    """What a rendered path's force does that the exact one does not."""
    off = (trace.proxy - truth)[:, :2]
    steps = STIFFNESS * step_lengths(off)
    figures = {
        "force_jumps": int((steps > JUMP_N).sum()),
        "force_jumps_large": int((steps > LARGE_N).sum()),
        "force_step_max_n": float(steps.max()),
        "limit_share": float((trace.status & Status.LIMIT > 0).mean()),
    }
    return errors_of(row_lengths(off), **figures)
