"""The markers' pixels held against the marks that the slice shows.

A wrong reading of pixels (rows counted from below, a view at 80 %, from 1 instead of 0) fits as
well as the right one, for it is an affine map too: no residual shows it, only the slice can.
Positions are (N, 2) (u, v) px, the centre of the top-left pixel at (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError
from vfplan.markers.finding import find_markers
from vfplan.markers.finding.marks import NEAR_PX, ROUNDED_PX, Kind, kinds_of_spots

if TYPE_CHECKING:
    from vfplan.markers import Correspondences

Array = NDArray[np.float64]

FEWEST = 3
ON_MARK_PX = 2.0
SHIFT_PX = 0.6  # half a pixel is a convention of where pixels begin, more is a mistake
LONE_PX = 1.5
DRAWN_PX = 0.1  # a mark's centre as found
IS, MAY_BE = 0.01, 0.05  # chance of such positions counted from 0
SURE, POSSIBLE = 1e6, 0.05  # odds of another reading
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
    given, kinds = pairs.source, kinds_of_spots(rgb)
    if not kinds:
        return Held(0)
    kind = min(kinds, key=lambda one: one.square_from(given))
    n, near = len(given), len(kind.met_by(given)[0])
    enough = max(FEWEST, (n + 1) // 2)
    if near >= enough:
        how, sure = _as_well(given, rgb.shape, kinds, near)
    else:
        how, sure = _instead(given, rgb.shape, kinds, max(enough, 2 * near))
    if sure:
        raise MarkerError(
            f"{near} of the {n} given positions have a mark near them on the slice, but where they "
            f"{how} they meet the marks drawn: correct u_px and v_px (the centre of the top-left "
            "pixel is 0, 0; u to the right, v down, in pixels of the file)"
        )
    if near >= enough:
        rival = (
            f"the given positions meet the marks drawn as well if {how.removeprefix('are ')}, so "
            "the slice cannot tell which is right: check u_px and v_px, and move a marker out of "
            "the symmetry; --seen-from tells a mirrored one"
        )
        return replace(_compared(rgb, pairs, kinds, kind), rivals=(rival,) if how else ())
    unsure = (
        f"no marks are drawn at most of the given positions; where they {how} they meet marks of "
        "one kind: check u_px and v_px"
    )
    warnings = (unsure,) if how else _others(kinds, n, near)
    if warnings or not near:
        return Held(near, warnings=warnings)
    return _compared(rgb, pairs, kinds, kind)


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


def _read(names: list[str]) -> str:
    return f"are read {', or '.join(names)}" if names else ""


def _as_well(
    given: Array, shape: tuple[int, ...], kinds: list[Kind], near: int
) -> tuple[str, bool]:
    """The readings that meet the marks about as well, by the odds of normal errors, or surely."""
    own_square = min(kind.square_from(given) for kind in kinds)
    odds = {}
    for name, read in other_readings(given, shape).items():
        squares = [k.square_from(read) for k in kinds if len(k.met_by(read)[0]) >= near]
        odds[name] = len(given) * np.log(own_square / min(squares, default=1e9))
    if own_square > ON_MARK_PX**2:
        sure = _read([name for name, value in odds.items() if value > np.log(SURE)])
        if how := sure or _sure_scale(given, kinds):
            return how, True
    return _read([name for name, value in odds.items() if value > np.log(POSSIBLE)]), False


def _sure_scale(given: Array, kinds: list[Kind]) -> str:
    """The scale that meets the marks surely better than no change and any shift, if one does."""
    kind = min(kinds, key=lambda one: one.square_from(given))
    own, drawn = kind.met_by(given)
    scale = _scale_to(given[own], drawn)
    others = (kind.square_from(given + by) for by in (0.0, (drawn - given[own]).mean(axis=0)))
    odds = len(given) * np.log(min(others) / kind.square_from(scale * given))
    return f"are multiplied by {scale:.3g}" if odds > np.log(SURE) else ""


def _scale_to(given: Array, drawn: Array) -> float:
    """The number that takes the given positions nearest to the drawn ones."""
    return float((given * drawn).sum() / (given**2).sum())


def _instead(
    given: Array, shape: tuple[int, ...], kinds: list[Kind], needed: int
) -> tuple[str, bool]:
    """What puts the positions onto marks of a kind by no chance, and whether that is sure."""
    names = [  # of a symmetric layout several, and the marks cannot tell which
        name
        for name, read in other_readings(given, shape).items()
        if any(kind.chance(read, needed) < BY_CHANCE for kind in kinds)
    ]
    if names:
        return _read(names), True
    laid = [_laid(given, kind, needed) for kind in kinds]
    return max(laid, key=lambda one: (one[1], bool(one[0])))


def _laid(given: Array, kind: Kind, needed: int) -> tuple[str, bool]:
    """The scale, the shift or both, whichever meets marks best; a shift may lead to labels."""
    both = _scale_and_shift(given, kind.places_px) or (1.0, np.zeros(2))
    met = both[1] + both[0] * given
    if kind.chance(met, needed, free=2) >= BY_CHANCE:
        return "", False
    hits, drawn = kind.met_by(met)
    own = given[hits]
    alone, move = (_scale_to(own, drawn), np.zeros(2), 1), (1.0, (drawn - own).mean(axis=0), 1)
    fits = [alone, move, (*both, 2)]
    chances = [kind.chance(t + s * given, needed, free=free) for s, t, free in fits]
    scale, shift, _ = fits[int(np.argmin(chances))]
    far, n, count = np.abs(shift).max(), len(given), len(kind.places_px)
    times = "" if abs(scale - 1) <= SAME_SCALE else f"multiplied by {scale:.3g} and "
    if far < 0.5 or (far <= NEAR_PX and times):
        return f"are multiplied by {scale:.3g}", True
    how = f"are {times}moved by ({round(shift[0]):+d}, {round(shift[1]):+d}) px"
    no_labels = far > LABEL_PX, abs(count - n) <= n // 3, kind.stamped(min(n, count))
    return how, sum(no_labels) >= 2


def _others(kinds: list[Kind], n: int, near: int) -> tuple[str, ...]:
    """A warning where about as many marks of one shape as markers, or more, stand elsewhere."""
    for kind in kinds:
        if not kind.faint and kind.stamped(n - n // 3):
            count, (u, v) = len(kind.places_px), kind.places_px[0]
            return (
                f"{near} of the {n} given positions have a mark near them, but {count} of one kind "
                f"are drawn, one at ({u:.0f}, {v:.0f}): check u_px and v_px",
            )
    return ()


def _scale_and_shift(given: Array, places: Array) -> tuple[float, Array] | None:
    """(scale, shift) that puts most of the given positions onto marks; `None`: hardly any."""
    pairs = len(given) // 2 if len(places) <= MOST_MARKS else 0  # the mark of one may not be drawn
    apart = np.linalg.norm(given[:, None] - given[None], axis=2)
    found: list[tuple[int, float, Array]] = [(0, 1.0, np.zeros(2))]
    for _ in range(pairs):
        pair = np.array(np.unravel_index(apart.argmax(), apart.shape))
        apart[pair], apart[:, pair] = 0, 0
        found += _through(given, places, *given[pair])
    hits, scale, shift = max(found, key=lambda one: one[0])
    return (scale, shift) if hits > FEWEST else None


def _through(given: Array, places: Array, one: Array, other: Array) -> list[Any]:
    """The (hits, scale, shift) of most hits that takes two given positions to two marks."""
    a, b = np.nonzero(~np.eye(len(places), dtype=bool))
    edge, drawn = other - one, places[b] - places[a]
    scale = drawn @ edge / max(edge @ edge, 1e-9)  # markers may lie at one place
    straight = np.linalg.norm(drawn - scale[:, None] * edge, axis=1) < NEAR_PX
    good = straight & (scale > SCALES[0]) & (scale < SCALES[1])
    scale, shift = scale[good], places[a[good]] - scale[good, None] * one
    moved = shift[:, None] + scale[:, None, None] * given
    near = np.linalg.norm(moved[:, :, None] - places, axis=3).min(axis=2) < NEAR_PX / 2
    hits = near.sum(axis=1)
    return [(int(hits[k]), float(scale[k]), shift[k]) for k in hits.argsort()[-1:]]


def _compared(rgb: NDArray, pairs: Correspondences, kinds: list[Kind], kind: Kind) -> Held:
    """How far the positions lie from their marks, and what that says."""
    own, drawn = kind.met_by(pairs.source)
    index, away = own, pairs.source[own] - drawn
    if _doubts(pairs, index, away):  # the rough centres may be to blame
        fitted = _measured(rgb, pairs, index, drawn)
        if 2 * len(fitted[0]) > len(index):  # else they are neither crosses nor dots
            index, away = fitted
    rms, (u, v) = float(np.sqrt((away**2).sum(axis=1).mean())), away.mean(axis=0)
    bare = () if kind.faint else _bare(pairs, kinds, kind, own)
    return Held(len(index), rms, (float(u), float(v)), _doubts(pairs, index, away) + bare)


def _bare(pairs: Correspondences, kinds: list[Kind], kind: Kind, own: NDArray) -> tuple[str, ...]:
    """A warning for markers without a mark near them, where the others have one."""
    bare = np.setdiff1d(np.flatnonzero(~kind.spotted(pairs.source)), own)
    if len(bare) > len(own) // 3:  # marks of two kinds are markers too
        bare = np.setdiff1d(bare, np.concatenate([k.met_by(pairs.source)[0] for k in kinds]))
    if not len(bare) or len(own) < max(FEWEST, len(bare)):
        return ()
    names = ", ".join(pairs.labels[i] for i in bare)
    return (f"no mark is drawn within {NEAR_PX:.0f} px of {names}, though the others have theirs",)


def _measured(
    rgb: NDArray, pairs: Correspondences, index: NDArray, drawn: Array
) -> tuple[NDArray, Array]:
    """The same distances from marks that were fitted, where a cross or a dot fits."""
    kept, away = [], []
    for tried, (i, place) in enumerate(zip(index, drawn, strict=True)):
        if tried > 1 + 2 * len(kept):  # nor will the others fit: it takes long to see that
            break
        try:
            (found,) = find_markers(rgb, [""], place[None], search_px=ON_MARK_PX)
        except MarkerError:
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
