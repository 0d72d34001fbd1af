"""What is measured at each tick, as pure functions of positions, normals and forces.

Tick k holds the HIP x_k, the proxy p_k, the normal n_k (pointing out of the fixture) and the force
F_k = K (p_k - x_k) on the hand, which acts from t_k until t_{k+1}. Forward differences are written
Δx_k = x_{k+1} - x_k; the last tick of a session has no successor and its Δ are zero.
Every quantity is defined here, once; docs/replay.md says the same in words.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vfplan.geometry import ROUNDING_M
from vfplan.session import TickBlock
from vfplan.session.result import concatenate_ticks

Array = NDArray[np.float64]

CONTACT_M = ROUNDING_M
"""A penetration above this is contact [m]. Below it is the rounding of p + (x - p)."""

SUMS = (
    "dwell_s", "impulse_ns", "energy_j", "energy_hold_j", "slide_m", "press_path", "drag_work",
)  # fmt: skip
PEAKS = "penetration_max_m", "overlap_max_m", "force_max_n", "force_step_max_n", "lag_max_m"


def row_norms(vectors: Array) -> Array:
    """(n,) Euclidean lengths of (n, 3) vectors."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def dots(a: Array, b: Array) -> Array:
    """(n,) scalar products of the rows of two (n, 3) arrays."""
    return np.einsum("ij,ij->i", a, b)


def flattened(places: Array, axis: Array | None) -> Array:
    """(n, 3) places without their part along an ignored axis (a unit vector, or `None`)."""
    return places if axis is None else places - np.outer(places @ axis, axis)


def penetration(hip: Array, proxy: Array) -> Array:
    """(n,) |p_k - x_k| [m]: how far the hand has pushed past where the proxy was stopped."""
    return row_norms(proxy - hip)


def overlap(hip: Array, proxy: Array, normal: Array, contact_radius: float) -> Array:
    """(n,) max(0, n·(p - x) - r_c) [m]: how far the HIP is beyond the cloud's own surface.

    The cloud's surface is that of the balls of radius r_v about its points; the proxy rests r_c
    above it (R - r_v = r_c).
    """
    return np.maximum(0.0, dots(normal, proxy - hip) - contact_radius)


@dataclass(frozen=True, eq=False)
class Steps:
    """Consecutive ticks, each with what changes until the next one."""

    # Number of the first tick, counted from the session's first
    first: int
    # The ticks, n of them
    ticks: TickBlock
    # (n, 3) where the hand truly was [m]; differs from `ticks.hip` only behind a lossy link
    hand: Array
    # Forward differences of time, hand, HIP and force: (n,) [s], (n, 3) [m] and [N]
    dt: Array
    dhand: Array
    dhip: Array
    dforce: Array

    def __len__(self) -> int:
        return len(self.ticks)

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """(n,) whether the fixture pushes: |p - x| above 1 nm. This is what *contact* means."""
        return self.ticks.penetration > CONTACT_M

    @cached_property
    def force_n(self) -> Array:
        """(n,) |F_k| [N]."""
        return row_norms(self.ticks.force)

    @cached_property
    def force_step_n(self) -> Array:
        """(n,) |F_{k+1} - F_k| [N]."""
        return row_norms(self.dforce)

    @cached_property
    def work_j(self) -> Array:
        """(n,) F_k · Δx_k [J], with the hand's own motion: above 0 the hand receives energy."""
        return dots(self.ticks.force, self.dhand)

    @cached_property
    def hold_j(self) -> Array:
        """(n,) -½ ΔF_k · Δx_k [J]: what holding F_k over the tick adds.

        Against a force that changes evenly from F_k to F_{k+1} while the hand moves; above 0 for a
        spring, loading and unloading alike.
        """
        return -0.5 * dots(self.dforce, self.dhand)

    @cached_property
    def speed(self) -> Array:
        """(n,) |Δx_k| / Δt_k of the HIP [m/s]; 0 at the last tick."""
        step = row_norms(self.dhip)
        return np.divide(step, self.dt, out=np.zeros_like(step), where=self.dt > 0)

    @cached_property
    def _along(self) -> tuple[Array, Array]:
        """Δx_t (n, 3) and |Δx_t| (n,) [m], the length zero where the fixture does not push."""
        normal = self.ticks.normal
        along = self.dhip - dots(normal, self.dhip)[:, None] * normal
        return along, np.where(self.held, row_norms(along), 0.0)

    @cached_property
    def sliding(self) -> tuple[Array, Array, Array]:
        """Normal force, tangential drag and tangential path, each (n,).

        N_k = n·F [N]; drag D_k = -F·Δx_t/|Δx_t| [N], above 0 where the tangential part of the
        force opposes the HIP's tangential motion Δx_t = Δx - (n·Δx) n; path |Δx_t| [m]. Zero where
        the fixture does not push.
        """
        along, path = self._along
        force = self.ticks.force
        press = np.where(self.held, dots(self.ticks.normal, force), 0.0)
        drag = np.divide(-dots(force, along), path, out=np.zeros_like(path), where=path > 0)
        return press, drag, path

    @cached_property
    def lag_m(self) -> Array:
        """(n,) how far the proxy trails behind the HIP along the HIP's tangential motion [m].

        (x - p)·Δx_t/|Δx_t|; below 0 where it runs ahead, 0 where the HIP does not slide.
        """
        along, path = self._along
        behind = dots(self.ticks.hip - self.ticks.proxy, along)
        return np.divide(behind, path, out=np.zeros_like(path), where=path > 0)

    @cached_property
    def sums(self) -> dict[str, Array]:
        """What is summed over ticks, by the report's name: (n,), and F_k Δt_k (n, 3) [N·s]."""
        press, drag, path = self.sliding
        impulse = self.ticks.force * self.dt[:, None]
        columns = impulse, self.work_j, self.hold_j, path, press * path, drag * path
        return dict(zip(SUMS, (self.dt, *columns), strict=True))

    @cached_property
    def peaks(self) -> dict[str, Array]:
        """(n,) of what the largest is reported, by the report's name."""
        ticks = self.ticks
        columns = ticks.penetration, ticks.overlap, self.force_n, self.force_step_n
        return dict(zip(PEAKS, (*columns, np.abs(self.lag_m)), strict=True))


class PairedTicks:
    """Turn blocks into `Steps`, one tick behind; `finish` gives the last tick."""

    def __init__(self) -> None:
        # The last tick and its hand, whose successor is still to come.
        self._last: tuple[TickBlock, Array] | None = None
        self._done = 0

    def push(self, block: TickBlock, hand: Array | None = None) -> Steps | None:
        """The ticks whose successor is now known; `None` while there are none."""
        if hand is None:
            hand = block.hip
        if self._last is not None:
            block = concatenate_ticks([self._last[0], block])
            hand = np.concatenate((self._last[1], hand))
        self._last = block[-1:], hand[-1:]
        return None if len(block) < 2 else self._steps(block, hand)

    def finish(self) -> Steps:
        """The last tick: its differences are zero."""
        assert self._last is not None, "finish() before any block"
        block, hand = self._last
        return self._steps(concatenate_ticks([block, block]), np.concatenate((hand, hand)))

    def _steps(self, block: TickBlock, hand: Array) -> Steps:
        steps = Steps(
            self._done,
            block[:-1],
            hand[:-1],
            np.diff(block.time),
            np.diff(hand, axis=0),
            np.diff(block.hip, axis=0),
            np.diff(block.force, axis=0),
        )
        self._done += len(steps)
        return steps
