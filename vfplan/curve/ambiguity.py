"""What a line shows that only a person can settle: such a line is refused."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import tuned
from vfplan.curve.candidates import Candidate
from vfplan.curve.centreline import MeasuredStroke, runs
from vfplan.errors import CurveError
from vfplan.geometry import filters


def refuse_junctions(line: Candidate) -> None:
    """Raise `CurveError` for a line that forks or crosses itself."""
    if len(line.junctions) == 0:
        return
    u, v = (float(x) for x in line.junctions[len(line.junctions) // 2])
    raise CurveError(
        "The line forks or crosses itself here, so it has several ways to go on. "
        "Choose one: vfplan review IMAGE.",
        where=f"pixel ({u:.0f}, {v:.0f})",
        code="line-forks",
        numbers={"u_px": u, "v_px": v},
    )


def relative_width(curve: MeasuredStroke) -> NDArray[np.float64]:
    """(M,) the line's width at each profile over its usual width.

    The lesser of two ratios: another opacity changes the ink across the line but not its width,
    another blur its width but not the ink.
    """
    profiles = curve.profiles
    width = profiles.mass / np.maximum(profiles.peak, 1e-6)
    usable = curve.whole & ~profiles.hidden & profiles.is_line[:, profiles.core].all(1)
    usable &= profiles.inside.all(1)
    usable = np.flatnonzero(usable)
    if len(usable) < tuned.MIN_PROFILES:
        return np.ones(len(width))
    ratio = np.minimum(width / np.quantile(width[usable], tuned.USUAL_SHARE), profiles.mass)
    ratio = np.interp(np.arange(len(ratio)), usable, ratio[usable])
    mode = "wrap" if curve.closed else "edge"
    return filters.windows(ratio, round(tuned.INK_HANGS_PX), mode).mean(axis=1)


def sudden_changes(curve: MeasuredStroke) -> NDArray[np.float64]:
    """(M,) change of the relative width over a short stretch, 0 where it is not sudden.

    A pressed pen changes its width all along; a dot, a letter or a second run begins at once.
    """
    ratio = relative_width(curve)
    half = tuned.SUDDEN_PX // 2
    change = np.zeros(len(ratio))
    change[half:-half] = np.abs(ratio[2 * half :] - ratio[: -2 * half])
    change[change < tuned.AT_ONCE * np.median(change)] = 0.0
    return change


def one_sided(curve: MeasuredStroke) -> NDArray[np.float64]:
    """(M,) how much more ink lies on one side of the line than on the other, of its usual ink.

    The largest over a short stretch. A dot on the line and a control point lie on both sides.
    """
    profiles = curve.profiles
    ink = np.where(profiles.is_line, np.clip(profiles.coverage, 0, None), 0)
    difference = ink @ np.sign(profiles.x)
    usual = max(float(np.median(ink.sum(1))), 1e-6)
    difference = np.abs(difference - np.median(difference)) / usual
    return filters.windows(difference, 2 * tuned.SUDDEN_PX + 1).max(axis=1)


def lasting_change(ratio: NDArray, width: float) -> tuple[float, int]:
    """The largest lasting change of a (M,) relative width, and the point where it is.

    The medians before and after are compared, so that noise counts less than at a sudden change.
    0 where the width changes as much all along, as a pressed pen's does.
    """
    window = max(2 * tuned.SUDDEN_PX, round(tuned.WIDE_RUN_WIDTHS * width))
    if len(ratio) < 3 * window:
        return 0.0, 0
    usual = filters.median(ratio, window)
    reach = (window + tuned.SUDDEN_PX) // 2
    change = np.abs(usual[2 * reach :] - usual[: -2 * reach])
    largest = float(change.max())
    if largest < tuned.LASTING_TIMES * np.median(change):
        return 0.0, 0
    return largest, int(change.argmax()) + reach


def refuse_wide_run(curve: MeasuredStroke) -> None:
    """Raise `CurveError` where the line is wider than elsewhere: two runs side by side."""
    if not sudden_changes(curve).any():
        return
    ratio = np.where(curve.whole, relative_width(curve), 1.0)
    run = max(tuned.SUDDEN_PX, round(tuned.WIDE_RUN_WIDTHS * curve.width))
    size = min(run, len(ratio))
    if curve.closed:
        lasting = filters.median(ratio, size, "wrap")
    else:
        lasting = filters.median(ratio, size, "constant", constant_values=1.0)
    widest = float(lasting.max())
    if widest <= tuned.WIDE or (widest - 1) * curve.width <= 1.0:
        return
    u, v = (float(x) for x in curve.path[lasting.argmax()])
    raise CurveError(
        f"The line is {widest:.2f} times as wide here as elsewhere, so two runs may lie side by "
        "side. Look at it: vfplan review IMAGE. If one pen was pressed harder: --accept-width.",
        where=f"pixel ({u:.0f}, {v:.0f})",
        code="runs-side-by-side",
        numbers={"width_ratio": widest, "u_px": u, "v_px": v},
    )


def refuse_double_line(curve: MeasuredStroke) -> None:
    """Raise `CurveError` where the mean profile has a valley: two lines side by side."""
    profiles = curve.profiles
    mean = profiles.coverage[profiles.valid].mean(0)[profiles.core]
    left = np.maximum.accumulate(mean)
    right = np.maximum.accumulate(mean[::-1])[::-1]
    dip = float((np.minimum(left, right) - mean).max() / mean.max())
    if dip <= tuned.VALLEY:
        return
    u, v = (float(x) for x in curve.path[len(curve.path) // 2])
    raise CurveError(
        "Two lines run side by side, or only the outline of the pen's line is drawn. "
        "Look at it: vfplan review IMAGE.",
        where=f"pixel ({u:.0f}, {v:.0f})",
        code="double-line",
        numbers={"dip": dip, "u_px": u, "v_px": v},
    )


def refuse_long_bridge(curve: MeasuredStroke, max_gap_px: float) -> None:
    """Raise `CurveError` where more of the line is hidden than may be bridged."""
    for run in runs(curve.bridged, curve.closed):
        gap = len(run) - curve.width
        if gap > max_gap_px + tuned.FLANK_PX:
            u, v = (float(x) for x in curve.points[run[len(run) // 2]])
            raise CurveError(
                f"{gap:.0f} px of the line do not show here; at most {max_gap_px:g} px are bridged."
                f" If the curve goes straight on: --max-gap {np.ceil(gap):.0f}.",
                where=f"pixel ({u:.0f}, {v:.0f})",
                code="bridge-too-long",
                numbers={"gap_px": float(gap), "max_gap_px": max_gap_px, "u_px": u, "v_px": v},
            )


def refuse_fit_off_ink(curve: MeasuredStroke, line: Candidate) -> None:
    """Raise `CurveError` where the measured line lies off the ink that it was measured from."""
    visible = curve.points[~curve.bridged]
    distance, nearest = _core.nearest(line.path, visible)
    if not line.closed:  # Beyond the skeleton's ends the line runs on to the end of its ink.
        distance[(nearest == 0) | (nearest == len(line.path) - 1)] = 0
    if distance.max() <= line.width + tuned.FLANK_PX:
        return
    u, v = (float(x) for x in visible[distance.argmax()])
    raise CurveError(
        f"The fitted line lies {distance.max():.1f} px off its ink here. Look at it: "
        "vfplan review IMAGE, or take the ink's skeleton: --method skeleton.",
        where=f"pixel ({u:.0f}, {v:.0f})",
        code="fit-left-ink",
        numbers={"distance_px": float(distance.max()), "u_px": u, "v_px": v},
    )
