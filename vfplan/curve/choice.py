"""Which candidate is the planned curve, or why none is: every refusal says what there was."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate, inked_ends
from vfplan.curve.kinds import MIN_LENGTH_PX
from vfplan.errors import CurveError

LONGER = 2.0  # times longer than a curve outside it: of a frame, less says nothing
WINDOW = 0.9  # of the picture's sides: the viewer's own frame
DESCRIBED = 8  # candidates or places at most, in an error message


def choose(
    candidates: list[Candidate],
    others: list[Candidate],
    mask: NDArray[np.bool_],
    stroke: int | str | None,
    colour: str,
    aside: tuple[dict, ...],
) -> list[Candidate]:
    """The lines to measure; raises `CurveError` for none or doubt.

    A number chooses among the candidates and, counting on, the `others` that were set aside: who
    names a line has settled what it is. `aside` describes them as the caller's report does.
    """
    named = [c for c in others if c.kind != "speck"]
    numbered = [*candidates, *named]
    if isinstance(stroke, int) and stroke <= len(numbered):
        return [numbered[stroke - 1]]
    if not candidates:
        raise CurveError(f"no planned curve: {_inventory(aside, colour)}")
    if isinstance(stroke, int):
        more = f" and {len(named)} set aside" if named else ""
        raise CurveError(f"no candidate number {stroke}: there are {len(candidates)}{more}")
    if stroke is None and len(candidates) > 1:
        shown, left = candidates[:DESCRIBED], len(candidates) - DESCRIBED
        listed = "; ".join(f"{i}: {describe(c)}" for i, c in enumerate(shown, 1))
        error = CurveError(
            f"{len(candidates)} candidates and none was chosen (--stroke all, longest or a "
            f"number; --roi; --exclude; --colour): {listed}"
            f"{f'; and {left} shorter ones' if left > 0 else ''}{_nearest_ends(shown, mask)}"
        )
        error.candidates = tuple(c.path for c in candidates)
        raise error
    return candidates if stroke == "all" else candidates[:1]


def describe(candidate: Candidate) -> str:
    """One candidate in words: shape, length, width, where from and where to."""
    size = f"{candidate.length_px:.0f} px long, {candidate.width_px:.1f} px wide"
    if candidate.junctions:
        u, v = candidate.junctions[0]
        return f"forked, {size}, junction at ({u}, {v})"
    (a, b), (c, d) = candidate.path[[0, -1]]
    if candidate.closed:
        return f"closed, {size}, through ({a:.0f}, {b:.0f})"
    return f"open, {size}, ({a:.0f}, {b:.0f}) to ({c:.0f}, {d:.0f})"


def _nearest_ends(candidates: list[Candidate], mask: NDArray[np.bool_]) -> str:
    """Where two candidates' ends lie nearest, what that may mean, and the way round it."""
    ends = [(i, at) for i, c in enumerate(candidates, 1) for at, _ in inked_ends(c, mask)]
    gaps = [
        (float(np.hypot(*(b - a))), i, j, (a + b) / 2)
        for (i, a), (j, b) in combinations(ends, 2)
        if i != j
    ]
    if not gaps:
        return ""
    gap, i, j, (u, v) = min(gaps, key=lambda g: g[:3])
    return (
        f"; {i} and {j} end {gap:.0f} px apart at ({u:.0f}, {v:.0f}): something drawn over one "
        "line, as a box is, may hide or bend it there; a gap is bridged up to --max-gap where both "
        "tangents agree; --stroke all takes both with the gap open"
    )


def _inventory(aside: tuple[dict, ...], colour: str) -> str:
    """What there is in the pen's colour, when none of it is a line."""
    if not aside:
        return f"nothing in {colour} is a line of {MIN_LENGTH_PX:.0f} px or more"
    order = sorted(aside, key=lambda a: a.get("stroke", np.inf))
    shown = [
        f"{a['kind']} at ({a['box'][0]}, {a['box'][1]})"
        + (f" [{a['stroke']}]" if "stroke" in a else "")
        for a in order[:DESCRIBED]
    ]
    more = f" and {len(aside) - DESCRIBED} more" if len(aside) > DESCRIBED else ""
    way = "; --stroke with its number takes one all the same" if "stroke" in order[0] else ""
    return f"all that is {colour} was set aside: {', '.join(shown)}{more}{way}"


def against_advice(
    chosen: list[Candidate],
    others: list[Candidate],
    shape: tuple[int, ...],
) -> list[str]:
    """A warning for a line that was chosen though it looks like something else, and for one set
    aside that is longer than what was chosen, if it is not the viewer's own frame.
    """
    warnings = [
        f"stroke {_place(c)} looks like {_article(c.kind)}, and is taken because it was named"
        for c in chosen
        if not c.is_candidate
    ]
    for other in others:
        length = other.length_px / (LONGER if other.kind == "frame" else 1.0)
        longer = all(length > c.length_px for c in chosen)
        window = other.kind == "frame" and (other.box[2:] > WINDOW * np.array(shape[1::-1])).all()
        if longer and not window and not any(other is c for c in chosen):
            warnings.append(
                f"{_article(other.kind)} {_place(other)}, {other.length_px:.0f} px long, "
                "was set aside though it is longer than the curve"
            )
    return warnings


def _place(line: Candidate) -> str:
    return f"at ({line.box[0]}, {line.box[1]})"


def _article(kind: str) -> str:
    return {"text": "text"}.get(kind, f"{'an' if kind == 'arrow' else 'a'} {kind}")


def refuse_grey(rgb: NDArray) -> None:
    """Raise `CurveError` when the picture holds no colour at all."""
    if (rgb == rgb[..., :1]).all():
        raise CurveError(
            "no planned curve: the image is grey, so no pen can be told from it; a curve drawn as "
            "vectors can be given beside it (--curve)"
        )


def refuse_junctions(line: Candidate) -> None:
    """Raise `CurveError` for a line that forks."""
    u, v = np.mean(line.junctions, axis=0)
    forks = line.junctions[:DESCRIBED]
    places = ", ".join(f"({a}, {b})" for a, b in forks)
    raise CurveError(
        f"the line forks, touches or crosses itself at {places}: which way it runs would be "
        "a guess",
        where=f"pixel ({u:.0f}, {v:.0f})",
    )
