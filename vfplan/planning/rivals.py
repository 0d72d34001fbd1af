"""The readings of given pixels that a mistake makes, and which of them meet the marks drawn.

Positions are (N, 2) (u, v) px, the centre of the top-left pixel at (0, 0).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError

if TYPE_CHECKING:
    from vfplan.markers import Correspondences
    from vfplan.markers.finding.marks import Kind

Array = NDArray[np.float64]

NEAR_PX = 8.0  # a mark further from a given position is not its own
ON_MARK_PX = 2.0
ROUNDED_PX = 0.25  # a mark's centre, as programs round it
SURE, POSSIBLE = 1e6, 0.05  # odds of another reading


def other_readings(given: Array, shape: tuple[int, ...]) -> dict[str, Array]:
    """The positions as each mistake has them, by its name."""
    below = np.array([0.0, shape[0] - 1.0])
    right = np.array([shape[1] - 1.0, 0.0])
    return {
        "with v counted from below": below + given * [1, -1],
        "with u counted from the right": right + given * [-1, 1],
        "with u counted from the right and v from below": right + below - given,
        "with row and column exchanged": given[:, ::-1],
    }


def hits_of(places: Array, kind: Kind) -> dict[int, int]:
    """Position -> the mark near it, where each is the other's nearest."""
    apart = np.linalg.norm(places[:, None] - kind.places_px[None], axis=2)
    marks = apart.argmin(axis=1)
    return {
        i: int(k)
        for i, k in enumerate(marks)
        if apart[i, k] <= NEAR_PX and apart[:, k].argmin() == i
    }


def rivals_of(
    pairs: Correspondences, shape: tuple[int, ...], kinds: list[Kind], near: int
) -> tuple[str, ...]:
    """A warning of the readings that meet the marks about as well, by the odds of normal errors."""
    n, own_square = len(pairs.labels), min(square_from(pairs.source, kind) for kind in kinds)
    odds = {}
    for name, read in other_readings(pairs.source, shape).items():
        squares = [square_from(read, kind) for kind in kinds if len(hits_of(read, kind)) >= near]
        odds[name] = n * np.log(own_square / min(squares, default=1e9))
    sure = [name for name, value in odds.items() if value > np.log(SURE)]
    if sure and own_square > ON_MARK_PX**2:
        raise MarkerError(misread(pairs, near, "are read " + ", or ".join(sure)))
    if own_square > ON_MARK_PX**2 and (scale := _sure_scale(pairs.source, kinds)):
        raise MarkerError(misread(pairs, near, f"are multiplied by {scale:.3g}"))
    names = ", or ".join(name for name, value in odds.items() if value > np.log(POSSIBLE))
    said = (
        f"the given positions meet the marks drawn as well if read {names}, so the slice cannot "
        "tell which is right: check u_px and v_px, and move a marker out of the symmetry; "
        "--seen-from tells a mirrored one"
    )
    return (said,) if names else ()


def _sure_scale(given: Array, kinds: list[Kind]) -> float | None:
    """The scale that meets the marks surely better than no change and any shift; `None`: none."""
    kind = min(kinds, key=lambda one: square_from(given, one))
    hits = hits_of(given, kind)
    own, drawn = given[list(hits)], kind.places_px[list(hits.values())]
    scale = scale_to(own, drawn)
    others = (square_from(given + shift, kind) for shift in (0.0, (drawn - own).mean(axis=0)))
    odds = len(given) * np.log(min(others) / square_from(scale * given, kind))
    return scale if odds > np.log(SURE) else None


def scale_to(given: Array, drawn: Array) -> float:
    """The number that takes the given positions nearest to the drawn ones."""
    return float((given * drawn).sum() / (given**2).sum())


def square_from(places: Array, kind: Kind) -> float:
    """Mean square distance from the marks, of a position without one `NEAR_PX` squared."""
    hits = hits_of(places, kind)
    away = places[list(hits)] - kind.places_px[list(hits.values())]
    bare = (len(places) - len(hits)) * NEAR_PX**2
    return max(float((away**2).sum() + bare) / len(places), ROUNDED_PX**2)


def misread(pairs: Correspondences, near: int, how: str) -> str:
    """The refusal of positions that meet the marks if they are read (or moved) so."""
    n = len(pairs.labels)
    return (
        f"{near} of the {n} given positions have a mark near them on the slice, but where they "
        f"{how} they meet the marks drawn: correct u_px and v_px (the centre of the top-left "
        "pixel is 0, 0; u to the right, v down, in pixels of the file)"
    )
