"""Which candidate is the planned curve, or why none is: every refusal says what there was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate, inked_ends
from vfplan.curve.joining import angle_deg
from vfplan.curve.kinds import MIN_LENGTH_PX
from vfplan.curve.marks import Mark
from vfplan.errors import CurveError

CROWD = 16  # specks of the longest line's size: more is noise
CROWD_SHARE = 4.0  # a mark this many times shorter than a line is still of its size
LEAST_DASHES, DASH_SHARE, ALIKE = 5, 0.8, 1.4  # of one size: this share, within this factor
LONGER = 2.5  # times a dash: a mark this long is no other dash
NEAR_PX = 40.0  # between two candidates' ends: parts of one line, it may be; and farther apart,
FACING_DEG = 30.0, 75.0  # from the way between them, where they run so; of two alike, over a bend
FRAMES = 6.0  # times longer than the curve in it: the frame itself may be the planned curve
WINDOW = 0.9  # of the picture's sides: the viewer's own frame
DESCRIBED = 8  # candidates at most, in an error message


def choose(
    candidates: list[Candidate],
    others: list[Candidate],
    mask: NDArray[np.bool_],
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
        error = CurveError(
            f"{len(candidates)} candidates and none was chosen (--stroke all, longest or a "
            f"number; --roi; --colour): {listed}{_near_ends(candidates[:DESCRIBED], mask, origin)}"
        )
        error.candidates = tuple(c.path + origin for c in candidates)
        raise error
    chosen = candidates if stroke == "all" else candidates[:1]
    for candidate in chosen:
        _refuse_junctions(candidate, origin)
    return chosen


def _near_ends(
    candidates: list[Candidate], mask: NDArray[np.bool_], origin: tuple[int, int]
) -> str:
    """What two candidates' ends close by may mean, and the way round it."""
    ends = [(i, *end) for i, c in enumerate(candidates, 1) for end in inked_ends(c, mask)]
    thin, *_, broad = sorted(c.width_px for c in candidates)
    facing = FACING_DEG[len(candidates) == 2 and broad <= ALIKE * thin]
    gaps = [
        (float(np.hypot(*(b - a))), i, j, (a + b) / 2 + origin)
        for k, (i, a, from_a) in enumerate(ends)
        for j, b, from_b in ends[k + 1 :]
        if i != j
        and (
            np.hypot(*(b - a)) <= NEAR_PX
            or max(angle_deg(from_a, b - a), angle_deg(from_b, a - b)) <= facing
        )
    ]
    if not gaps:
        return ""
    gap, i, j, (u, v) = min(gaps, key=lambda g: g[:3])
    return (
        f"; {i} and {j} end {gap:.0f} px apart at ({u:.0f}, {v:.0f}): something drawn over one "
        "line, as a box is, may hide or bend it there; a gap is bridged up to --max-gap where both "
        "tangents agree; --stroke all takes both with the gap open"
    )


def against_advice(
    chosen: list[Candidate],
    others: list[Candidate],
    origin: tuple[int, int],
    shape: tuple[int, ...],
) -> list[str]:
    """A warning for a line that was chosen though it looks like something else, and for one set
    aside that is longer than what was chosen and drawn round neither that nor the picture.
    """
    warnings = [
        f"stroke {_place(c, origin)} looks like {_article(c.kind)}, and is taken because it was "
        "named"
        for c in chosen
        if not c.is_candidate
    ]
    for other in others:
        longer = all(other.length_px > c.length_px and not _round(other, c) for c in chosen)
        window = other.kind == "frame" and (other.box[2:] > WINDOW * np.array(shape[1::-1])).all()
        if longer and not window and not any(other is c for c in chosen):
            warnings.append(
                f"{_article(other.kind)} {_place(other, origin)}, {other.length_px:.0f} px long, "
                "was set aside though it is longer than the curve"
            )
    return warnings


def _round(frame: Candidate, line: Candidate) -> bool:
    """Whether a line's box encloses that of another, as a panel's frame does what stands in it.

    Of one that is many times longer, what it encloses is a small part of what was drawn.
    """
    if frame.length_px > FRAMES * line.length_px:
        return False
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


def refuse_crowd(
    candidates: list[Candidate],
    others: list[Candidate],
    marks: list[Mark],
    colour: str,
    max_gap_px: float,
) -> None:
    """Raise `CurveError` when the longest line is one among many specks of its size."""
    told = [*candidates, *others]
    shaped = [c for c in others if c.kind != "speck"]
    _refuse_dashes(candidates, shaped, dashes_of(marks, told), colour, max_gap_px)
    count = len(crowd_of(candidates[0], marks, told)) if candidates else 0
    if count > CROWD:
        raise CurveError(
            f"no planned curve: the longest line in {colour}, {candidates[0].length_px:.0f} px, "
            f"stands among {count} specks of its size (at most {CROWD}): noise or a coloured "
            "picture; look in a part of it (--roi)"
        )


def _refuse_dashes(
    candidates: list[Candidate],
    others: list[Candidate],
    dashes: list[Mark],
    colour: str,
    max_gap_px: float,
) -> None:
    """Raise `CurveError` for dashes that were not joined, when the longest line is but one more."""
    if not dashes or (others and not candidates):
        return
    dash = float(np.median([m.length_px + m.width_px for m in dashes]))
    if candidates:
        line = candidates[0]
        whole = line.length_px >= sum(m.length_px for m in dashes)
        if whole or max(m.length_px for m in line.marks) > LONGER * dash:
            return
    raise CurveError(
        f"no planned curve: {len(dashes)} dots or dashes in {colour}, about {dash:.0f} px each, "
        "were not joined: a dashed line is followed where its dashes are longer than its gaps and "
        f"these no longer than --max-gap ({max_gap_px:g} px); draw it solid, or give it as vectors "
        "(--curve)"
    )


def _inventory(aside: tuple[dict, ...], colour: str) -> str:
    """What there is in the pen's colour, when none of it is a line."""
    if not aside:
        return f"nothing in {colour} is a line of {MIN_LENGTH_PX:.0f} px or more"
    order = sorted(aside, key=lambda a: a.get("stroke", np.inf))
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


def crowd_of(line: Candidate, marks: list[Mark], told: list[Candidate]) -> list[Mark]:
    """The specks that are at least a quarter as long as a line's longest mark.

    Noise makes short lines of red, and lines joined from them, among hundreds nearly as long; a
    drawing does not.
    """
    longest = max(m.length_px for m in line.marks)
    return [m for m in _loose(marks, told) if CROWD_SHARE * m.length_px >= longest]


def dashes_of(marks: list[Mark], told: list[Candidate]) -> list[Mark]:
    """The specks, if most of them are of one size and width, as the dashes of one line are."""
    loose = _loose(marks, told)
    if len(loose) < LEAST_DASHES:
        return []
    area = np.array([m.area_px for m in loose])
    alike = np.abs(np.log(area / np.median(area))) < np.log(ALIKE)
    if alike.sum() < max(LEAST_DASHES, DASH_SHARE * len(loose)):
        return []
    return [m for m, one in zip(loose, alike, strict=True) if one]


def _loose(marks: list[Mark], told: list[Candidate]) -> list[Mark]:
    """The marks that are specks, or part of lines too short to be more."""
    own = {id(m) for c in told if c.kind != "speck" for m in c.marks}
    return [m for m in marks if m.kind != "panel" and id(m) not in own]
