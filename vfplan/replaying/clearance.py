"""What is measured at each tick, and how near the proxies came to the fixture, without the engine.

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

from vfplan import _core
from vfplan.engine.parameters import Rule
from vfplan.engine.proxy import exact_shape
from vfplan.fixture import Fixture, Pieces
from vfplan.geometry import ROUNDING, ROUNDING_M
from vfplan.session.result import TickBlock, concatenate_ticks

Array = NDArray[np.float64]

# A penetration above this is contact [m]. Below it is the rounding of p + (x - p).
CONTACT_M = ROUNDING_M

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
        self._last = None
        self._done = 0

    def push(self, block: TickBlock, hand: Array) -> Steps | None:
        """The ticks whose successor is now known; `None` while there are none."""
        if self._last is not None:
            block = concatenate_ticks([self._last[0], block])
            hand = np.concatenate((self._last[1], hand))
        self._last = block[-1:], hand[-1:]
        return None if len(block) < 2 else self._steps(block, hand)

    def finish(self) -> Steps:
        """The last tick: its differences are zero."""
        block, hand = self._last
        return self._steps(concatenate_ticks([block, block]), np.concatenate((hand, hand)))

    def _steps(self, block: TickBlock, hand: Array) -> Steps:
        changes = [np.diff(rows, axis=0) for rows in (block.time, hand, block.hip, block.force)]
        steps = Steps(self._done, block[:-1], hand[:-1], *changes)
        self._done += len(steps)
        return steps


# Distances of a group of ticks that are measured without dividing it further. It sets the speed
# alone.
FEW_PAIRS = 1_000


def clearance_of(fixture: Fixture, rule: Rule) -> Clearance | None:
    """To what the rule renders: the curve, the triangles, the points; `None` where all guides."""
    radius = fixture.contact_radius + fixture.point_radius
    if rule == "exact":
        kind = exact_shape(fixture)
        if kind == "curve":
            return CurveClearance(fixture.region.pieces, radius, fixture.ignore_axis)
        if kind == "mesh":
            return MeshClearance(fixture.points, fixture.mesh, radius)
    points = fixture.forbidden
    return None if not len(points) else PointClearance(points, radius, fixture.ignore_axis)


class Clearance:
    """Keep the minimum over all ticks of the distance to something, minus `radius`, R [m]."""

    def __init__(self, radius: float) -> None:
        self._radius = radius
        self._distance = np.inf

    @property
    def minimum_m(self) -> float:
        """The smallest clearance so far [m]; below 0 the proxy's ball overlaps the fixture."""
        return float(self._distance - self._radius)

    def update(self, proxy: Array) -> None:
        """Add the proxies of a block, (n, 3) [m]."""
        raise NotImplementedError


class CurveClearance(Clearance):
    """To lines and arcs, across an ignored axis."""

    def __init__(self, pieces: Pieces, radius: float, axis: Array) -> None:
        super().__init__(radius)
        self._curve = (pieces.vertices, pieces.bulges, pieces.stroke, pieces.closed.view(np.uint8))
        self._axis = axis

    def update(self, proxy: Array) -> None:
        """Add the proxies of a block, (n, 3) [m]."""
        distances = _core.distance_to_pieces(*self._curve, self._axis, np.ascontiguousarray(proxy))
        self._distance = min(self._distance, float(distances.min()))


class NearestClearance(Clearance):
    """To many small items, each within a ball about its middle.

    Ticks that follow each other are close together. Of all items only those are looked at that can
    be nearest to one of a group of ticks; the group is halved until few pairs are left.

    middles, sizes: (N, 3) and (N,) of the balls [m]
    """

    def __init__(self, middles: Array, sizes: Array, radius: float) -> None:
        super().__init__(radius)
        self._middles, self._sizes = middles, sizes

    def update(self, proxy: Array) -> None:
        """Add the proxies of a block, (n, 3) [m]."""
        self._search(proxy, np.arange(len(self._middles)))

    def _search(self, places: Array, items: NDArray[np.intp]) -> None:
        """Measure from the places (n, 3) to those of the items that may be nearest."""
        low, high = places.min(axis=0), places.max(axis=0)
        reach = float(np.linalg.norm(high - low)) / 2 * (1 + ROUNDING)
        distance = row_norms(self._middles[items] - (low + high) / 2)
        sizes = self._sizes[items]
        least = distance - sizes - reach
        items = items[(least < self._distance) & (least <= (distance + sizes).min() + reach)]
        if len(places) > 1 and len(places) * len(items) > FEW_PAIRS:
            half = len(places) // 2
            self._search(places[:half], items)
            self._search(places[half:], items)
        elif len(items):
            self._distance = min(self._distance, float(self._measure(places, items).min()))

    def _measure(self, places: Array, items: NDArray[np.intp]) -> Array:
        """The distance of each place (n, 3) from each item, in any order."""
        raise NotImplementedError


class MeshClearance(NearestClearance):
    """To triangles (K, 3), rows of corners (N, 3) [m]."""

    def __init__(self, points: Array, triangles: NDArray[np.int32], radius: float) -> None:
        self._corners = points[triangles]
        middles = self._corners.mean(axis=1)
        sizes = np.linalg.norm(self._corners - middles[:, None], axis=2).max(axis=1)
        super().__init__(middles, sizes, radius)

    def _measure(self, places: Array, items: NDArray[np.intp]) -> Array:
        from vfplan.registration.touch import on_triangles

        places = np.repeat(places, len(items), axis=0)
        corners = np.tile(self._corners[items], (len(places) // len(items), 1, 1))
        return np.linalg.norm(on_triangles(places, corners) - places, axis=1)


class PointClearance(NearestClearance):
    """To points (N, 3) [m], across an ignored axis where there is one."""

    def __init__(self, points: Array, radius: float, axis: Array | None) -> None:
        super().__init__(flattened(points, axis), np.zeros(len(points)), radius)
        self._axis = axis

    def update(self, proxy: Array) -> None:
        """Add the proxies of a block, (n, 3) [m]."""
        super().update(flattened(proxy, self._axis))

    def _measure(self, places: Array, items: NDArray[np.intp]) -> Array:
        return np.sqrt(((places[:, None] - self._middles[items]) ** 2).sum(axis=2))


def is_enclosed(place: Array, corners: Array) -> bool:
    """Whether a closed mesh of triangles (K, 3, 3), all turned alike, has a place (3,) inside."""
    # The solid angle of each triangle (A. van Oosterom and J. Strackee, 1983).
    a, b, c = np.moveaxis(corners - place, 1, 0)
    x, y, z = row_norms(a), row_norms(b), row_norms(c)
    below = x * y * z + dots(a, b) * z + dots(b, c) * x + dots(c, a) * y
    angle = 2 * np.arctan2(dots(a, np.cross(b, c)), below).sum()
    return abs(angle) > 0.99 * 4 * np.pi
