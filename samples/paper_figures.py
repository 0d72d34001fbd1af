"""The paper's Figs. 2, 4, 5 and 6, laid out as there, with this run's numbers beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from vfplan.figures.replay import MM, plane_basis, shade_episodes
from vfplan.figures.style import new_figure, save_png, style
from vfplan.palette import CLOUD, CONTACT, FORCE, HIP, PROXY
from vfplan.replaying import Replay
from vfplan.replaying.thinning import contact_marks

MARK_HZ = 10.0
SIMULATED_HZ = 3.0  # marks a second: the pointer is slow
MARKS = 14  # at least, on the shortest path
LABELS = {"point": "(a) single point", "segment": "(b) segment", "teapot": "(c) teapot",
          "omega": "(d) hand-drawn Ω"}  # fmt: skip


def draw_simulations(shown: dict[str, tuple[str, Replay, dict[str, Any]]], path: Path) -> None:
    """Fig. 2: one panel a scene with its numbers; `shown`: panel -> (scene, replay, numbers)."""
    rows, columns = (2, 2) if len(shown) > 1 else (1, 1)
    figure = new_figure(4.6 * columns + 0.4, 4.2 * rows)
    with style():
        panels = figure.subplots(rows, columns, squeeze=False)
    for axes, (scene, run, numbers) in zip(panels.flat, shown.values(), strict=True):
        in_plane(axes, run, max(SIMULATED_HZ, MARKS / run.metrics["duration_s"]))
        axes.set_title(LABELS[scene], loc="left", fontsize=9)
        axes.set_xlabel("x [mm]\n" + "\n".join(lines_of(numbers)), fontsize=8)
        axes.set_ylabel("y [mm]", fontsize=8)
    panels[0, 0].legend(loc="best", fontsize=7, markerscale=2)
    save_png(figure, path)


def in_plane(axes: Axes, run: Replay, mark_hz: float) -> None:
    """Blue crosses, green HIP, red contact circles about the proxy, magenta normals, black u."""
    ticks, fixture = run.ticks, run.fixture
    basis = plane_basis(fixture.ignore_axis)
    cloud, hip, proxy, normal = (
        a @ basis for a in (MM * fixture.points, MM * ticks.hip, MM * ticks.proxy, ticks.normal)
    )
    radius = MM * fixture.contact_radius
    picks = contact_marks(run.ticks, mark_hz)
    axes.plot(*cloud.T, "x", ms=2.0, mew=0.5, color=CLOUD, label="cloud", zorder=2)
    axes.plot(*hip.T, ".", ms=2.0, color=HIP, label="HIP", zorder=3)
    axes.plot(*proxy[picks].T, ".", ms=2.0, color=CONTACT, label="proxy, $r_c$", zorder=4)
    axes.add_collection(
        PatchCollection(
            [Circle(tuple(c), radius) for c in proxy[picks]],
            facecolor="none", edgecolor=CONTACT, lw=0.5, alpha=0.8,
        )
    )  # fmt: skip
    arrow = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.003}
    axes.quiver(*proxy[picks].T, *(radius * normal[picks]).T, color=PROXY, zorder=5, **arrow)
    axes.quiver(*proxy[picks].T, *(hip - proxy)[picks].T, color="black", zorder=5, **arrow)
    axes.set_aspect("equal", adjustable="datalim")


def draw_experiment(run: Replay, numbers: dict[str, Any], path: Path) -> None:
    """Figs. 4 and 6: (a) force over time, one trial green; (b) its trajectory; the numbers."""
    planar = run.fixture.ignore_axis is not None
    figure = new_figure(10.5, 4.6)
    with style():
        left, middle, right = figure.add_gridspec(1, 3, width_ratios=(4, 4, 2.1))
        force = figure.add_subplot(left)
        space = figure.add_subplot(middle, projection=None if planar else "3d")
        side = figure.add_subplot(right)
    ticks = run.ticks
    trial = max(run.metrics["episodes"], key=lambda e: e["penetration_max_m"])
    shade_episodes(force, run)
    force.axvspan(trial["start_s"], trial["end_s"], color="#a9dcb4", lw=0, zorder=0)
    for axis, name in enumerate("xyz"):
        force.plot(ticks.time, ticks.force[:, axis], lw=0.8, label=f"$F_{name}$")
    force.plot(ticks.time, np.linalg.norm(ticks.force, axis=1), color=FORCE, lw=1, label="$|F|$")
    force.set_xlabel("time [s]")
    force.set_ylabel("force on the hand [N]")
    force.margins(y=0.14)  # room for the legend above the peaks
    force.legend(ncols=4, fontsize=7, loc="upper right")
    force.set_title("(a) VF force; one trial in dark green", loc="left", fontsize=9)
    span = slice(*np.searchsorted(ticks.time, (trial["start_s"] - 0.15, trial["end_s"] + 0.15)))
    draw_trial = _trial_in_plane if planar else _trial_in_space
    draw_trial(space, run, span)
    space.set_title("(b) that trial, marks at 10 Hz", loc="left", fontsize=9)
    side.set_axis_off()
    side.text(0, 1, "\n".join(lines_of(numbers)), va="top", fontsize=8.5, linespacing=1.5)
    save_png(figure, path)


def _picks(run: Replay, span: slice) -> Any:
    picks = contact_marks(run.ticks, MARK_HZ)
    return picks[(picks >= span.start) & (picks < span.stop)]


def _trial_in_plane(axes: Axes, run: Replay, span: slice) -> None:
    ticks, fixture = run.ticks, run.fixture
    picks = _picks(run, span)
    basis = plane_basis(fixture.ignore_axis)
    radius = MM * fixture.contact_radius
    axes.plot(*(MM * fixture.points @ basis).T, "x", ms=3, mew=0.6, color=CLOUD, label="cloud")
    axes.plot(*(MM * ticks.hip[span] @ basis).T, ".", ms=2, color=HIP, label="HIP")
    proxy = MM * ticks.proxy[picks] @ basis
    axes.plot(*proxy.T, ".", ms=4, color=PROXY, label="proxy")
    circles = [Circle(tuple(c), radius) for c in proxy]
    axes.add_collection(PatchCollection(circles, facecolor="none", edgecolor=CONTACT, lw=0.7))
    axes.quiver(*proxy.T, *(radius * ticks.normal[picks] @ basis).T, angles="xy",
                scale_units="xy", scale=1, width=0.004, color=PROXY)  # fmt: skip
    _window(axes, MM * ticks.hip[span] @ basis, 1.5 * radius)
    axes.set_xlabel("in plane, 1 [mm]")
    axes.set_ylabel("in plane, 2 [mm]")
    axes.legend(fontsize=7, loc="best", markerscale=1.5)


def _window(axes: Axes, path: Any, margin: float) -> None:
    low, high = path.min(axis=0) - margin, path.max(axis=0) + margin
    axes.set_xlim(low[0], high[0], auto=True)  # the aspect may widen either
    axes.set_ylim(low[1], high[1], auto=True)
    axes.set_aspect("equal", adjustable="datalim")


def _trial_in_space(axes: Any, run: Replay, span: slice) -> None:
    """The square is seen along its own plane, x across and y up; z goes into the page."""
    ticks, fixture = run.ticks, run.fixture
    picks = _picks(run, span)
    radius = MM * fixture.contact_radius
    hip, proxy = MM * ticks.hip[span], MM * ticks.proxy[picks]
    low, high = hip.min(axis=0) - 1.6 * radius, hip.max(axis=0) + 1.6 * radius
    cloud = MM * fixture.points
    cloud = cloud[((cloud > low) & (cloud < high)).all(axis=1)]
    thin = max(1, len(cloud) // 3000)
    axes.plot(*cloud[::thin, :][:, [0, 2, 1]].T, ".", ms=0.8, color=CLOUD, alpha=0.5, label="cloud")
    axes.plot(*hip[:, [0, 2, 1]].T, ".", ms=1.5, color=HIP, label="HIP")
    axes.plot(*proxy[:, [0, 2, 1]].T, ".", ms=4, color=PROXY, label="proxy")
    turn = np.linspace(0, 2 * np.pi, 41)[:, None]
    for centre, normal in zip(proxy, ticks.normal[picks], strict=True):
        across = np.cross(normal, [0.0, 0.0, 1.0])
        ring = centre + radius * (np.cos(turn) * normal + np.sin(turn) * across)
        axes.plot(*ring[:, [0, 2, 1]].T, color=CONTACT, lw=0.6)
        tip = centre + radius * normal
        axes.plot(*np.stack([centre, tip])[:, [0, 2, 1]].T, color=PROXY, lw=1.0)
    axes.view_init(elev=14, azim=-70)
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
        axis.set_tick_params(labelsize=7)
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("z [mm]")
    axes.set_zlabel("y [mm]")
    axes.legend(fontsize=7, loc="upper left")


def draw_plan(image: Path, path: Path) -> dict[str, Any]:
    """Fig. 5: (a) the planned slice, (b) its binary image; the numbers of both."""
    from vfplan.curve import extract_curve
    from vfplan.images.read import read_image

    planned = read_image(image)
    found = extract_curve(planned, method="mask")
    numbers = {
        "width_px": planned.width_px,
        "height_px": planned.height_px,
        "mask_pixels": int(found.mask.sum()),
        "in_the_paper": {"width_px": 871, "height_px": 786, "points": 2204},
    }
    figure = new_figure(9.0, 4.4)
    with style():
        left, right = figure.subplots(1, 2)
    left.imshow(planned.rgb)
    right.imshow(found.mask, cmap="gray", interpolation="nearest")
    left.set_title(
        f"(a) planned slice, {planned.width_px} x {planned.height_px} px", loc="left", fontsize=9
    )
    right.set_title(f"(b) binary image, {numbers['mask_pixels']} pixels", loc="left", fontsize=9)
    for axes in (left, right):
        axes.set_axis_off()
    save_png(figure, path)
    return numbers


def lines_of(numbers: dict[str, Any]) -> list[str]:
    """The numbers of a figure as short lines."""
    theirs = numbers.get("in_the_paper", {})
    lines = [f"N = {numbers['points']:,}".replace(",", " ")]
    if "points" in theirs:
        lines[0] += f"  (paper: {theirs['points']:,})".replace(",", " ")
    if "density_per_mm" in numbers:
        given = theirs.get("density_per_mm")
        lines.append(f"{numbers['density_per_mm']:.3g} points/mm  (paper: {given:g})")
    for rule in ("paper", "robust"):
        n = numbers[rule]
        times = f"{n['contacts']} contact{'s' * (n['contacts'] != 1)}"
        lines += [
            f"rule {rule}: {times}, $F_{n['strongest_axis']}$ "
            f"{n['force_least_n']:.1f} to {n['force_most_n']:+.1f} N",
            f"   clearance {n['clearance_min_um']:+.1f} µm, "
            f"{n['entrenched_ticks']} of {n['ticks']} ticks inside",
        ]
    return lines
