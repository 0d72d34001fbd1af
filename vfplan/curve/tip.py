"""The end of a pen's line as a model: drawn, blurred, and fitted to the pixels around it.

A round pen leaves a half disc beyond the end of its centre line, one that is cut flat nothing. Both
are laid along the line as it bends, with the width and the blur that the line's own profile shows,
and moved along it; what remains of the pixels when ground and line are fitted as well says how
likely each end is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BLURS_PX = np.r_[0.4:0.7:0.05, 0.7:1.6:0.1]  # an edge's standard deviation along a profile,
SAMPLING_PX2 = 0.2  # of which so much variance is the profile's own, read between pixels
SHARPEST_PX = 0.3  # a pixel's aperture
STRIPS = 24  # of the pen, across the line
TABLE_PX = 0.1
BACK_PX, SIDE_PX = 5.0, 3.0  # beyond the tip and the line's edges: pixels that are looked at
SCALE_PX = 6.0  # of the ground's polynomial, to keep its numbers small
RIDGE = 1e-6  # of the mean square: what nothing in the picture determines stays 0


@dataclass(frozen=True, eq=False)
class Tip:
    """A pen's end."""

    half: float  # half the pen's width [px]
    blur: float  # standard deviation of its edges in the picture [px]
    # (A, X) coverage round a round end at `TABLE_PX` steps, along the line from `first` px before
    # its centre, and across from the middle
    disc: NDArray[np.float64]
    first: float  # see there [px]

    @classmethod
    def of_profile(cls, x: NDArray, profile: NDArray, halves: NDArray) -> Tip:
        """The pen whose blurred profile at (K,) x is most like this one; its half among `halves`.

        Height and level of the (K,) profile may be any.
        """
        from scipy.special import ndtr

        pens = np.stack(np.meshgrid(halves, BLURS_PX, indexing="ij"), -1).reshape(-1, 2, 1)
        half, blur = pens[:, 0], pens[:, 1]
        shapes = ndtr((x + half) / blur) - ndtr((x - half) / blur)
        shapes = shapes - shapes.mean(1, keepdims=True)
        explained = (shapes @ (profile - profile.mean())) ** 2 / (shapes**2).sum(1)
        half, blur = pens[np.argmax(explained), :, 0]
        return cls.of_pen(float(half), float(np.sqrt(max(blur**2 - SAMPLING_PX2, SHARPEST_PX**2))))

    @classmethod
    def of_pen(cls, half: float, blur: float) -> Tip:
        """The end of a pen `half` px to either side with edges of standard deviation `blur` px."""
        from scipy.special import ndtr

        first = 3 * blur + TABLE_PX
        along = np.arange(-first, half + 4 * blur, TABLE_PX)
        across = np.arange(0.0, half + 4 * blur, TABLE_PX)
        y = ((np.arange(STRIPS) + 0.5) / STRIPS - 0.5) * 2 * half
        edge = half / STRIPS
        spread = ndtr((across - y[:, None] + edge) / blur) - ndtr(
            (across - y[:, None] - edge) / blur
        )
        inked = ndtr((np.sqrt(half**2 - y**2) - along[:, None]) / blur)
        disc = inked @ spread
        disc[:, -1] = disc[-1] = 0.0
        return cls(half, blur, disc, first)

    def coverage(self, beyond: NDArray, across: NDArray, round_cap: bool) -> NDArray[np.float64]:
        """(T, N) coverage at (T, N) `beyond` px past the line's end and (N,) px across it."""
        from scipy.ndimage import map_coordinates
        from scipy.special import ndtr

        if round_cap:
            across = np.broadcast_to(np.abs(across), beyond.shape)
            at = np.stack([beyond + self.first, across]) / TABLE_PX
            return map_coordinates(self.disc, at, order=1, mode="nearest")
        return ndtr(-beyond / self.blur) * self._line(across)

    def drift(self, beyond: NDArray, across: NDArray) -> NDArray[np.float64]:
        """(T, N) what the line's coverage changes by, up to a factor, when it moves sideways."""
        from scipy.special import ndtr

        left, right = ((across + side) / self.blur for side in (self.half, -self.half))
        return ndtr(-beyond / self.blur) * (np.exp(-(left**2) / 2) - np.exp(-(right**2) / 2))

    def _line(self, across: NDArray) -> NDArray[np.float64]:
        from scipy.special import ndtr

        return ndtr((across + self.half) / self.blur) - ndtr((across - self.half) / self.blur)


@dataclass(frozen=True, eq=False)
class Around:
    """Pixels around a line's end."""

    # (N,) along the path, in its points, and across it [px]
    s: NDArray[np.float64]
    x: NDArray[np.float64]
    # (N,) columns and rows of the picture
    u: NDArray[np.int64]
    v: NDArray[np.int64]

    @classmethod
    def path(
        cls, base: NDArray, normal: NDArray, end: float, half: float, shape: tuple[int, ...]
    ) -> Around:
        """Those of a picture of this shape from before `end` to the end of a (M, 2) path."""
        rows = np.arange(max(0, int(end - half - BACK_PX)), len(base))
        places, normal = base[rows], normal[rows]
        reach = half + SIDE_PX
        low = np.maximum(np.floor(places.min(0) - reach), 0).astype(int)
        high = np.minimum(np.ceil(places.max(0) + reach) + 1, shape[1::-1]).astype(int)
        v, u = (grid.ravel() for grid in np.mgrid[low[1] : high[1], low[0] : high[0]])
        off = np.column_stack([u, v])[:, None] - places
        nearest = (off**2).sum(2).argmin(1)
        off, normal = off[np.arange(len(off)), nearest], normal[nearest]
        x = (off * normal).sum(1)
        s = rows[nearest] + off[:, 0] * normal[:, 1] - off[:, 1] * normal[:, 0]
        keep = (np.abs(x) <= reach) & (s >= rows[0]) & (s <= rows[-1])
        return cls(s[keep], x[keep], u[keep], v[keep])

    def bent(self, start: float, bend: float) -> Around:
        """The same around a path that from `start` on bends by `bend` per px more."""
        on = np.maximum(self.s - start, 0.0)
        return Around(self.s + bend * on * self.x, self.x - bend * on**2 / 2, self.u, self.v)

    def where(self, keep: NDArray) -> Around:
        """Those of which (N,) `keep` is true."""
        return Around(self.s[keep], self.x[keep], self.u[keep], self.v[keep])


def misfit(
    tip: Tip, around: Around, value: NDArray, ends: NDArray, round_cap: bool
) -> NDArray[np.float64]:
    """(T,) mean square of what a line that ends at (T,) `ends` of the path leaves of (N,) values.

    The ground is a quadratic in both directions, the line's own value changes evenly along it, and
    the line may lie a little beside the path and at a small angle to it.
    """
    beyond = around.s - ends[:, None]
    s, x = (around.s - ends.mean()) / SCALE_PX, around.x / SCALE_PX
    ground = np.column_stack([np.ones_like(s), s, x, s * s, s * x, x * x])
    line = tip.coverage(beyond, around.x, round_cap)[..., None]
    aside = tip.drift(beyond, around.x)[..., None]
    basis = np.concatenate([(1 - line) * ground, line * ground[:, :2], aside * ground[:, :2]], 2)
    power = basis.transpose(0, 2, 1) @ basis + RIDGE * len(s) * np.eye(basis.shape[2])
    parts = np.linalg.solve(power, basis.transpose(0, 2, 1) @ value[:, None])
    return ((value - (basis @ parts)[..., 0]) ** 2).mean(1)
