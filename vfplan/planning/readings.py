"""The markers' pixels held against the marks that the slice shows.

A wrong reading of pixels (rows counted from below, a view at 80 %, from 1 instead of 0) fits as
well as the right one, for it is an affine map too: no residual shows it, only the slice can.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError
from vfplan.planning.rivals import (
    NEAR_PX,
    ON_MARK_PX,
    ROUNDED_PX,
    hits_of,
    misread,
    other_readings,
    rivals_of,
    scale_to,
    square_from,
)

if TYPE_CHECKING:
    from vfplan.markers import Correspondences
    from vfplan.markers.finding.marks import Kind

Array = NDArray[np.float64]

FEWEST = 3
SHIFT_PX = 0.6  # half a pixel is a convention of where pixels begin, more is a mistake
LONE_PX = 1.5
DRAWN_PX = 0.1  # a mark's centre as found
IS, MAY_BE = 0.01, 0.05  # chance of such positions counted from 0
SCALES = (0.2, 5.0)
SAME_SCALE = 0.02
MOST_MARKS = 40  # of a kind; a scale is looked for among fewer
BY_CHANCE = 1e-5  # less is none
LABEL_PX = 40.0  # a mark's label stands nearer


@dataclass(frozen=True)
class Held:
    """How the given positions lie to the marks drawn."""

    near: int  # how many have a mark of one kind near them; 0 where the slice shows none there
    # Distance of those from their marks, and its mean (given minus drawn); `None` where none is
    rms_px: float | None = None
    shift_px: tuple[float, float] | None = None
    warnings: tuple[str, ...] = ()  # what a person should look at
    rivals: tuple[str, ...] = ()  # a warning of other readings, which no found mark settles

    def as_dict(self) -> dict[str, Any]:
        """As a report holds it."""
        if self.rms_px is None:
            return {"near": self.near}
        return {"near": self.near, "rms_px": self.rms_px, "shift_px": self.shift_px}


def hold_against_marks(rgb: NDArray, pairs: Correspondences) -> Held:
    """Compare the given positions with the marks drawn on the slice.

    Raises MarkerError: nothing is drawn near most of the given positions, or marks further off,
        but another reading of them (rows from below, columns from the right, another scale) puts
        them onto marks of one kind
    """
    from vfplan.markers.finding.marks import kinds_of_spots

    given = pairs.source
    kinds = kinds_of_spots(rgb)
    enough = max(FEWEST, (len(given) + 1) // 2)
    if not kinds:
        return Held(0)
    kind = min(kinds, key=lambda one: square_from(given, one))
    own = hits_of(given, kind)
    if len(own) >= enough:
        rivals = rivals_of(pairs, rgb.shape, kinds, len(own))
        return replace(_compared(rgb, pairs, kinds, kind), rivals=rivals)
    how, sure = _met(given, rgb.shape, kinds, max(enough, 2 * len(own)))
    if sure:
        raise MarkerError(misread(pairs, len(own), how))
    if how:
        return Held(len(own), warnings=(_unsure(how),))
    elsewhere = _others(kinds, len(given), len(own))
    if not own or elsewhere:
        return Held(len(own), warnings=elsewhere)
    return _compared(rgb, pairs, kinds, kind)


def _met(given: Array, shape: tuple[int, ...], kinds: list[Kind], needed: int) -> tuple[str, bool]:
    """What puts the positions onto marks of a kind by no chance, and whether that is sure."""
    names = [  # of a symmetric layout several, and the marks cannot tell which
        name
        for name, read in other_readings(given, shape).items()
        if any(_chance(read, kind, shape, needed) < BY_CHANCE for kind in kinds)
    ]
    if names:
        return f"are read {', or '.join(names)}", True
    laid = [_laid(given, shape, kind, needed) for kind in kinds]
    return max(laid, key=lambda one: (one[1], bool(one[0])))


def _laid(given: Array, shape: tuple[int, ...], kind: Kind, needed: int) -> tuple[str, bool]:
    """The scale, the shift or both, whichever meets marks best; a shift may lead to labels."""
    if (both := _scale_and_shift(given, kind.places_px)) is None:
        return "", False
    met = both[1] + both[0] * given
    if _chance(met, kind, shape, needed, free=2) >= BY_CHANCE:
        return "", False
    hits = hits_of(met, kind)
    own, drawn = given[list(hits)], kind.places_px[list(hits.values())]
    alone, move = (scale_to(own, drawn), np.zeros(2), 1), (1.0, (drawn - own).mean(axis=0), 1)
    fits = [alone, move, (*both, 2)]
    chances = [_chance(t + s * given, kind, shape, needed, free=free) for s, t, free in fits]
    scale, shift, _ = fits[int(np.argmin(chances))]
    far = np.abs(shift).max()
    if far < 0.5 or (far <= NEAR_PX and abs(scale - 1) > SAME_SCALE):
        return f"are multiplied by {scale:.3g}", True
    n = len(given)
    no_labels = far > LABEL_PX, abs(len(kind.places_px) - n) <= n // 3, kind.stamped(n)
    return _moved(scale, shift), sum(no_labels) >= 2


def _chance(
    places: Array, kind: Kind, shape: tuple[int, ...], needed: int, *, free: int = 0
) -> float:
    """The chance that so many places lie so near to marks, `free` of them laid onto any mark."""
    from scipy.special import bdtrc

    hits, count = hits_of(places, kind), len(kind.places_px)
    if len(hits) < max(needed, free + 1):
        return 1.0
    away = np.linalg.norm(places[list(hits)] - kind.places_px[list(hits.values())], axis=1)
    near = count * np.pi * np.maximum(np.sort(away), 1.0) ** 2 / (shape[0] * shape[1])
    others = np.arange(len(hits)) - free  # of the k nearest, without those laid and one
    chances = bdtrc(others, len(places) - free, np.minimum(near, 1.0))
    return float(count**free * chances[needed - 1 :].min())


def _others(kinds: list[Kind], n: int, near: int) -> tuple[str, ...]:
    """A warning where at least as many marks of one shape as there are markers stand elsewhere."""
    for kind in kinds:
        if not kind.faint and kind.stamped(n):
            count, (u, v) = len(kind.places_px), kind.places_px[0]
            return (
                f"{near} of the {n} given positions have a mark near them, but {count} of one kind "
                f"are drawn, one at ({u:.0f}, {v:.0f}): check u_px and v_px",
            )
    return ()


def _scale_and_shift(given: Array, places: Array) -> tuple[float, Array] | None:
    """(scale, shift) that puts nearly all given positions onto marks; `None`: none does."""
    if len(given) < FEWEST + 1 or not FEWEST < len(places) <= MOST_MARKS:
        return None
    apart = np.linalg.norm(given[:, None] - given[None], axis=2)
    i, j = np.unravel_index(apart.argmax(), apart.shape)
    a, b = np.nonzero(~np.eye(len(places), dtype=bool))
    edge, drawn = given[j] - given[i], places[b] - places[a]
    scale = drawn @ edge / (edge @ edge)
    straight = np.linalg.norm(drawn - scale[:, None] * edge, axis=1) < NEAR_PX
    good = straight & (scale > SCALES[0]) & (scale < SCALES[1])
    best: tuple[float, Array, int] | None = None
    for s, start in zip(scale[good], places[a[good]], strict=True):
        moved = start + s * (given - given[i])
        away = np.linalg.norm(moved[:, None] - places[None], axis=2)
        hits = int((away.min(axis=1) < NEAR_PX / 2).sum())
        if best is None or hits > best[2]:
            best = float(s), start - s * given[i], hits
    needed = max(FEWEST + 1, int(np.ceil(0.8 * len(given))))
    return best[:2] if best is not None and best[2] >= needed else None


def _moved(scale: float, shift: Array) -> str:
    times = "" if abs(scale - 1) <= SAME_SCALE else f"multiplied by {scale:.3g} and "
    return f"are {times}moved by ({round(shift[0]):+d}, {round(shift[1]):+d}) px"


def _compared(rgb: NDArray, pairs: Correspondences, kinds: list[Kind], kind: Kind) -> Held:
    own = hits_of(pairs.source, kind)
    index = np.array(sorted(own))
    drawn = kind.places_px[[own[i] for i in index]]
    away = pairs.source[index] - drawn
    if _doubts(pairs, index, away):  # the rough centres may be to blame
        fitted = _measured(rgb, pairs, index, drawn)
        if 2 * len(fitted[0]) > len(index):  # else they are neither crosses nor dots
            index, away = fitted
    rms, mean = float(np.sqrt((away**2).sum(axis=1).mean())), away.mean(axis=0)
    bare = () if kind.faint else _bare(pairs, kinds, own)
    return Held(
        len(index), rms, (float(mean[0]), float(mean[1])), _doubts(pairs, index, away) + bare
    )


def _bare(pairs: Correspondences, kinds: list[Kind], own: dict[int, int]) -> tuple[str, ...]:
    """A warning for markers without a mark near them, where the others have one."""
    bare = [i for i in range(len(pairs.labels)) if i not in own]
    if len(bare) > len(own) // 3:  # marks of two kinds are markers too
        bare = [i for i in bare if not any(i in hits_of(pairs.source, kind) for kind in kinds)]
    if not bare or len(own) < max(FEWEST, len(bare)):
        return ()
    names = ", ".join(pairs.labels[i] for i in bare)
    return (f"no mark is drawn within {NEAR_PX:.0f} px of {names}, though the others have theirs",)


def _unsure(how: str) -> str:
    return (
        f"no marks are drawn at most of the given positions; where they {how} they meet marks of "
        "one kind: check u_px and v_px"
    )


def _measured(
    rgb: NDArray, pairs: Correspondences, index: NDArray, drawn: Array
) -> tuple[NDArray, Array]:
    """The same distances from marks that were fitted, where a cross or a dot fits."""
    from vfplan.markers.finding import find_markers

    kept, away, missed = [], [], 0
    for i, place in zip(index, drawn, strict=True):
        try:
            (found,) = find_markers(rgb, [""], place[None], search_px=ON_MARK_PX)
        except MarkerError:
            missed += 1
            if missed > 1 + len(kept):  # nor will the others fit: it takes long to see that
                break
            continue
        kept.append(i)
        away.append(pairs.source[i] - found.position_px)
    return np.array(kept, dtype=int), np.array(away).reshape(-1, 2)


def _doubts(pairs: Correspondences, index: NDArray, away: Array) -> tuple[str, ...]:
    if len(index) < FEWEST:
        return ()
    middle = np.median(away, axis=0)
    off = np.linalg.norm(away - middle, axis=1)
    spread = 1.4826 * float(np.median(off))
    lone = off > LONE_PX + 5 * spread
    rest = away[~lone]
    mean, error = rest.mean(axis=0), rest.std(axis=0, ddof=1) / np.sqrt(len(rest))
    doubts = [
        f"marker {pairs.labels[i]} is given {np.linalg.norm(d):.1f} px from the mark drawn near it"
        for i, d in zip(index[lone], away[lone], strict=True)
    ]
    where = f"the given positions lie ({mean[0]:+.2f}, {mean[1]:+.2f}) px from the marks drawn on "
    origin = _origin(rest, mean)
    if origin or (np.abs(mean) - 3 * error > SHIFT_PX).any():
        doubts.append(f"{where}the slice: {origin}--find-markers takes the marks' own")
    return tuple(doubts)


def _origin(away: Array, mean: Array) -> str:
    """Which other origin of the pixels the marks speak for, and how surely; else empty.

    The likeliest of the three origins; the right one is ruled out by the scatter about the mean.
    """
    from scipy.special import fdtrc

    dof = 2 * len(away) - 2
    variance = max(float(((away - mean) ** 2).sum()) / dof, DRAWN_PX**2)

    def chance(origin: float) -> float:
        rest = np.maximum(np.abs(mean - origin) - ROUNDED_PX, 0.0)
        return float(fdtrc(2, dof, len(away) * float((rest**2).sum()) / 2 / variance))

    one = min((0.0, 0.5, 1.0), key=lambda origin: float(((mean - origin) ** 2).sum()))
    if one == 0 or chance(0.0) > MAY_BE or chance(one) < IS:
        return ""
    name = "from 1 instead of 0" if one == 1 else "from the first pixel's corner, not its centre"
    if chance(0.0) > IS:
        return f"counted {name}, or from 0 and badly clicked? The marks do not decide; "
    return f"counted {name}? "
