"""Which candidate is the planned curve, or why none is: every refusal says what there was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError
from vfplan.extraction.candidates import Candidate
from vfplan.extraction.kinds import MIN_LENGTH_PX, crowd_of
from vfplan.extraction.marks import Mark

MOST_MARKS, CROWD = 3000, 16  # in all, and specks of the longest line's size: more is noise
DESCRIBED = 8  # candidates at most, in an error message


def choose(
    candidates: list[Candidate],
    stroke: int | str | None,
    colour: str,
    origin: tuple[int, int],
    aside: tuple[dict, ...],
) -> list[Candidate]:
    """The candidates to measure; raises `CurveError` for none, doubt or a junction."""
    if not candidates:
        raise CurveError(f"no planned curve: {_inventory(aside, colour)}")
    if stroke is None and len(candidates) > 1:
        listed = "; ".join(
            f"{i}: {describe(c, origin)}" for i, c in enumerate(candidates[:DESCRIBED], 1)
        )
        if len(candidates) > DESCRIBED:
            listed += f"; and {len(candidates) - DESCRIBED} shorter ones"
        raise CurveError(
            f"{len(candidates)} candidates and none was chosen (--stroke all, longest or a "
            f"number; --roi; --colour): {listed}"
        )
    if isinstance(stroke, int) and stroke > len(candidates):
        raise CurveError(f"no candidate number {stroke}: there are {len(candidates)}")
    chosen = {"all": candidates, "longest": candidates[:1], None: candidates[:1]}.get(stroke)
    if chosen is None:
        chosen = [candidates[int(stroke) - 1]]
    for candidate in chosen:
        _refuse_junctions(candidate, origin)
    return chosen


def refuse_grey(rgb: NDArray) -> None:
    """Raise `CurveError` when the picture holds no colour at all."""
    if np.array_equal(rgb[..., 0], rgb[..., 1]) and np.array_equal(rgb[..., 0], rgb[..., 2]):
        raise CurveError(
            "no planned curve: the image is grey, so no pen can be told from it; a curve drawn as "
            "vectors can be given beside it (--curve)"
        )


def refuse_noise(marks: list[Mark], colour: str) -> None:
    """Raise `CurveError` when there are more marks than anyone draws."""
    if len(marks) > MOST_MARKS:
        raise CurveError(
            f"no planned curve: {len(marks)} marks in {colour} (at most {MOST_MARKS}): noise or a "
            "coloured picture; look in a part of it (--roi)"
        )


def refuse_crowd(
    candidates: list[Candidate], others: list[Candidate], marks: list[Mark], colour: str
) -> None:
    """Raise `CurveError` when the longest line is one among many specks of its size."""
    count = crowd_of(candidates[0], marks, candidates + others) if candidates else 0
    if count > CROWD:
        raise CurveError(
            f"no planned curve: the longest line in {colour}, {candidates[0].length_px:.0f} px, "
            f"stands among {count} specks of its size (at most {CROWD}): noise or a coloured "
            "picture; look in a part of it (--roi)"
        )


def _inventory(aside: tuple[dict, ...], colour: str) -> str:
    """What there is in the pen's colour, when none of it is a line."""
    if not aside:
        return f"nothing in {colour} is a line of {MIN_LENGTH_PX:.0f} px or more"
    shown = [f"{a['kind']} at ({a['box'][0]}, {a['box'][1]})" for a in aside[:6]]
    more = f" and {len(aside) - 6} more" if len(aside) > 6 else ""
    return f"all that is {colour} was set aside: {', '.join(shown)}{more}"


def _refuse_junctions(candidate: Candidate, origin: tuple[int, int]) -> None:
    if candidate.junctions:
        u, v = np.mean(candidate.junctions, axis=0) + origin
        places = ", ".join(
            f"({a + origin[0]}, {b + origin[1]})" for a, b in candidate.junctions[:8]
        )
        raise CurveError(
            f"the line forks, touches or crosses itself at {places}: which way it runs would be "
            "a guess",
            where=f"pixel ({u:.0f}, {v:.0f})",
        )


def describe(candidate: Candidate, origin: tuple[int, int] = (0, 0)) -> str:
    """One candidate in words: shape, length, width, where from and where to."""
    size = f"{candidate.length_px:.0f} px long, {candidate.width_px:.1f} px wide"
    if candidate.junctions:
        u, v = candidate.junctions[0]
        return f"forked, {size}, junction at ({u + origin[0]}, {v + origin[1]})"
    (a, b), (c, d) = candidate.path[[0, -1]] + origin
    if candidate.closed:
        return f"closed, {size}, through ({a:.0f}, {b:.0f})"
    return f"open, {size}, ({a:.0f}, {b:.0f}) to ({c:.0f}, {d:.0f})"
