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
    others: list[Candidate],
    stroke: int | str | None,
    colour: str,
    origin: tuple[int, int],
    aside: tuple[dict, ...],
) -> list[Candidate]:
    """The lines to measure; raises `CurveError` for none, doubt or a junction.

    A number chooses among the candidates and, counting on, the `others` that were set aside: who
    names a line has settled what it is. `aside` describes them as the caller's report does.
    """
    named = [c for c in others if c.kind != "speck"]
    numbered = [*candidates, *named]
    if isinstance(stroke, int) and stroke <= len(numbered):
        _refuse_junctions(numbered[stroke - 1], origin)
        return [numbered[stroke - 1]]
    if not candidates:
        raise CurveError(f"no planned curve: {_inventory(aside, colour)}")
    if isinstance(stroke, int):
        more = f" and {len(named)} set aside" if named else ""
        raise CurveError(f"no candidate number {stroke}: there are {len(candidates)}{more}")
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
    chosen = candidates if stroke == "all" else candidates[:1]
    for candidate in chosen:
        _refuse_junctions(candidate, origin)
    return chosen


def against_advice(
    chosen: list[Candidate], others: list[Candidate], origin: tuple[int, int]
) -> list[str]:
    """A warning for a line that was chosen though it looks like something else, and for one set
    aside that is longer than what was chosen and not drawn round it.
    """
    warnings = [
        f"stroke {_place(c, origin)} looks like {_article(c.kind)}, and is taken because it was "
        "named"
        for c in chosen
        if not c.is_candidate
    ]
    for other in others:
        longer = all(other.length_px > c.length_px and not _round(other, c) for c in chosen)
        if longer and not any(other is c for c in chosen):
            warnings.append(
                f"{_article(other.kind)} {_place(other, origin)}, {other.length_px:.0f} px long, "
                "was set aside though it is longer than the curve"
            )
    return warnings


def _round(frame: Candidate, line: Candidate) -> bool:
    """Whether a line's box encloses that of another."""
    (u, v, w, h), (a, b, c, d) = frame.box, line.box
    return u <= a and v <= b and u + w >= a + c and v + h >= b + d


def _place(line: Candidate, origin: tuple[int, int]) -> str:
    return f"at ({line.box[0] + origin[0]}, {line.box[1] + origin[1]})"


def _article(kind: str) -> str:
    return {"text": "text"}.get(kind, f"{'an' if kind == 'arrow' else 'a'} {kind}")


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
    order = sorted(aside, key=lambda a: a.get("stroke", MOST_MARKS))
    shown = [
        f"{a['kind']} at ({a['box'][0]}, {a['box'][1]})"
        + (f" [{a['stroke']}]" if "stroke" in a else "")
        for a in order[:6]
    ]
    more = f" and {len(aside) - 6} more" if len(aside) > 6 else ""
    way = "; --stroke with its number takes one all the same" if "stroke" in order[0] else ""
    return f"all that is {colour} was set aside: {', '.join(shown)}{more}{way}"


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
