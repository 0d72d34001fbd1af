"""Which candidate is the planned curve, or why none is: every refusal says what there was."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate, inked_ends
from vfplan.curve.kinds import MIN_LENGTH_PX, crowd_of, dashes_of
from vfplan.curve.marks import Mark
from vfplan.curve.pieces import Piece
from vfplan.errors import CurveError

MOST_MARKS, CROWD = 3000, 16  # in all, and specks of the longest line's size: more is noise
LONGER = 2.5  # times a dash: a mark this long is no other dash
NEAR_PX = 40.0  # between two candidates' ends: parts of one line, it may be
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
    ends = [(i, at) for i, c in enumerate(candidates, 1) for at, _ in inked_ends(c, mask)]
    gaps = [
        (float(np.hypot(*(a - b))), i, j, (a + b) / 2 + origin)
        for k, (i, a) in enumerate(ends)
        for j, b in ends[k + 1 :]
        if i != j
    ]
    gap, i, j, (u, v) = min(gaps, key=lambda g: g[:3], default=(np.inf, 0, 0, (0.0, 0.0)))
    if gap > NEAR_PX:
        return ""
    return (
        f"; {i} and {j} end {gap:.0f} px apart at ({u:.0f}, {v:.0f}): a gap is bridged up to "
        "--max-gap where both tangents agree, and what is drawn over the line may bend them; "
        "--stroke all takes both with the gap open"
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


def refuse_noise(count: int, colour: str) -> None:
    """Raise `CurveError` when there are more marks than anyone draws."""
    if count > MOST_MARKS:
        raise CurveError(
            f"no planned curve: {count} marks in {colour} (at most {MOST_MARKS}): noise or a "
            "coloured picture; look in a part of it (--roi)"
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


def set_aside(
    marks: list[Mark],
    lines: list[Candidate],
    chosen: list[Candidate],
    origin: tuple[int, int],
    specks: Sequence[Piece] = (),
) -> tuple[dict, ...]:
    """What was not used, with its place: panels, lines of other kinds or not chosen, `specks`.

    `lines` are all that were told apart, the candidates first.
    """
    u, v = origin
    aside = [
        {"kind": m.kind, "box": (m.box[0] + u, m.box[1] + v, *m.box[2:]), "area_px": m.area_px}
        for m in marks
        if m.kind in ("panel", "other colour")
    ]
    for number, line in enumerate((c for c in lines if c.kind != "speck"), 1):
        if not any(line is c for c in chosen):
            box = (line.box[0] + u, line.box[1] + v, *line.box[2:])
            entry = {"kind": line.kind, "box": box, "length_px": round(line.length_px, 1)}
            entry["stroke"] = number
            if line.junctions:
                entry["junctions"] = [(a + u, b + v) for a, b in line.junctions]
            aside.append(entry)
    for piece in specks:
        if piece.kind == "speck":
            low, high = piece.pixels.min(0), piece.pixels.max(0)
            box = tuple(int(x) for x in (*(low + origin), *(high - low + 1)))
            aside.append({"kind": "speck", "box": box, "length_px": round(piece.length_px, 1)})
    return tuple(aside)
