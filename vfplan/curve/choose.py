"""Which line is the curve, or the refusal that says what to choose from."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned
from vfplan.curve.candidates import Candidate, find_candidates, gap_px
from vfplan.curve.coverage import Ink, find_ink
from vfplan.curve.pen import HUES, Pen
from vfplan.curve.region import Region
from vfplan.curve.skeleton import find_groups, find_pieces
from vfplan.errors import CurveError

DESCRIBED = 8
"""Lines that an error message describes."""

Choice = int | Literal["all", "longest"] | None


def choose_lines(
    lines: list[Candidate],
    choice: Choice,
    ink: Ink,
    pen: Pen,
    region: Region,
    max_gap_px: float,
) -> list[Candidate]:
    """The lines that are meant; raises `CurveError` where that is left open.

    Candidates are the longest line and those that are at least half as long. A frame around
    the picture or a part of it is none. A number counts the candidates first, then all other lines.
    """
    frames = [line for line in lines if is_frame(line)]
    others = [line for line in lines if not is_frame(line)]
    candidates = [line for line in others if line.length >= tuned.RIVAL_SHARE * others[0].length]
    numbered = others + frames
    if isinstance(choice, int):
        if choice > len(numbered):
            raise CurveError(
                f"There is no line number {choice}. Choose one of the {len(numbered)} lines.",
                code="stroke-number",
                numbers={"number": choice, "lines": len(numbered)},
            )
        return [numbered[choice - 1]]
    if not candidates:
        raise _no_line_error(frames, ink, pen, region)
    if choice == "all":
        return candidates
    if choice is None and len(candidates) > 1:
        raise _several_error(candidates, max_gap_px)
    return candidates[:1]


def is_frame(line: Candidate) -> bool:
    """Whether a line is a frame: no hand's curve, but a box around a picture or a part of it.

    It is one if it runs along the sides of the upright rectangle around it, all the way round.
    """
    low, high = line.path.min(0), line.path.max(0)
    to_side = np.minimum(line.path - low, high - line.path).min(1)
    on_side = (to_side <= tuned.FLANK_PX).mean() >= tuned.FRAME_SHARE
    return on_side and len(line.path) >= tuned.FRAME_SHARE * 2 * (high - low).sum()


def describe(line: Candidate) -> str:
    """One line in words: its shape, its length, and where it is."""
    (u, v), (last_u, last_v) = line.path[[0, -1]]
    if line.closed:
        return f"closed, {line.length:.0f} px long, through ({u:.0f}, {v:.0f})"
    ends = f"from ({u:.0f}, {v:.0f}) to ({last_u:.0f}, {last_v:.0f})"
    return f"open, {line.length:.0f} px long, {ends}"


def _several_error(candidates: list[Candidate], max_gap_px: float) -> CurveError:
    listed = "; ".join(f"{k}: {describe(line)}" for k, line in enumerate(candidates[:DESCRIBED], 1))
    message = (
        f"There are {len(candidates)} candidates. Choose one with --stroke N, or look in a part "
        f"of the picture with --roi: {listed}"
    )
    numbers: dict = {"candidates": len(candidates)}
    nearest = _nearest_ends(candidates[:DESCRIBED])
    if nearest is not None:
        gap, longest, place = nearest
        message += f". Two of them end {gap:.0f} px apart at ({place[0]:.0f}, {place[1]:.0f}); "
        if gap > longest:
            message += "that is longer than one of them, so they are not joined"
        elif gap <= max_gap_px:
            message += "their directions differ too much to join them"
        else:
            message += f"--max-gap {np.ceil(gap):.0f} joins them where their directions agree"
        numbers |= {"gap_px": gap, "u_px": place[0], "v_px": place[1]}
    error = CurveError(f"{message}.", code="several-candidates", numbers=numbers)
    error.candidates = tuple(line.path for line in candidates)
    return error


def _nearest_ends(lines: list[Candidate]) -> tuple[float, float, tuple[float, float]] | None:
    """The shortest gap between ends of two lines, the longest that joins them, and the middle."""
    nearest = None
    for i, one in enumerate(lines):
        for other in lines[i + 1 :]:
            for end in (0, -1):
                for other_end in (0, -1):
                    gap = gap_px(one, end, other, other_end)
                    if one.may_go_on and other.may_go_on and (nearest is None or gap < nearest[0]):
                        middle = (one.path[end] + other.path[other_end]) / 2
                        longest = min(one.length, other.length)
                        nearest = (gap, longest, (float(middle[0]), float(middle[1])))
    return nearest


def _no_line_error(frames: list[Candidate], ink: Ink, pen: Pen, region: Region) -> CurveError:
    """The refusal where the pen drew no line; it names another pen's line if there is one."""
    if (ink.rgb == ink.rgb[..., :1]).all():
        return CurveError(
            "The picture is grey, so no pen can be told from it. Give a curve that was drawn as "
            "vectors: --curve FILE.",
            code="image-grey",
        )
    if frames:
        error = CurveError(
            f"The only line in {pen.name} is a frame around the picture or a part of it. Take "
            "it all the same with --stroke 1.",
            code="only-a-frame",
        )
        error.candidates = tuple(line.path for line in frames)
        return error
    numbers = {"mask_pixels": int(ink.mask.sum())}
    line = _longest_of_another_pen(ink.rgb, pen, region)
    if line is None:
        return CurveError(
            f"No line was drawn in {pen.name}. Name the pen's colour with --colour NAME or "
            "#rrggbb, or draw again if the pen was black, grey or white.",
            code="no-line",
            numbers=numbers,
        )
    name = _nearest_hue(ink.rgb, line)
    u, v = (float(x) for x in line.path[len(line.path) // 2])
    return CurveError(
        f"No line was drawn in {pen.name}; the longest line of another pen is {line.length:.0f} px "
        f"of {name}. Take it with --colour {name}, or draw again if the pen was black, grey or "
        "white.",
        code="no-line",
        numbers=numbers
        | {"other_colour": name, "other_length_px": line.length, "u_px": u, "v_px": v},
    )


def _longest_of_another_pen(rgb: NDArray, pen: Pen, region: Region) -> Candidate | None:
    """The longest line that a pen of another named colour drew."""
    best = None
    for name in HUES:
        if name == pen.name:
            continue
        try:
            ink = find_ink(rgb, Pen.of_colour(name), region)
            lines = find_candidates(find_pieces(ink, find_groups(ink)), 0.0)
        except CurveError:  # Too many pieces: that is no pen.
            continue
        if lines and (best is None or lines[0].length > best.length):
            best = lines[0]
    return best


def _nearest_hue(rgb: NDArray, line: Candidate) -> str:
    """The name of the pen whose hue is closest to a line's; the hues of two pens may overlap."""
    u, v = line.path.astype(int).T
    colour = rgb[v, u].mean(0)
    agreement = [float(Pen.of_colour(name).along @ colour) for name in HUES]
    return HUES[int(np.argmax(agreement))]
