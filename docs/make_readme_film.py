"""Draw the film of the README: a line is drawn, planned, and a tool tip is pushed back from it.

    python docs/make_readme_film.py        writes docs/pictures/draw_plan_push.gif; ten seconds

Everything on it is computed: the plan of the shipped slice, and the forces of the engine along a
path of the tip that is written down below.
"""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import matplotlib.colors
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from PIL import Image

import vfplan
from vfplan.palette import CLOUD, FORCE, PROXY, TIP, TUBE

ROOT = Path(__file__).resolve().parents[1]
SAMPLES = ROOT / "samples"
FILM = ROOT / "docs" / "pictures" / "draw_plan_push.gif"
# The part of the slice that is shown [px].
LEFT_PX = 195
RIGHT_PX = 535
TOP_PX = 350
BOTTOM_PX = 620

FRAMES_DRAWN = 14
FRAMES_PLANNED = 12
FRAMES_PUSHED = 44
FRAME_MS = 90
PEN = "#e81920"
MM_PER_PX = 0.5
N_PER_FORCE_PX = 0.2
"""Length of the force's arrow on the picture [N a pixel]."""


def main() -> None:
    """Draw all frames and write them as one film."""
    picture = cv2.cvtColor(cv2.imread(str(SAMPLES / "elbow.png")), cv2.COLOR_BGR2RGB)
    empty = without_line(picture)
    plan = vfplan.plan(
        SAMPLES / "elbow.png",
        SAMPLES / "elbow_markers_image.csv",
        SAMPLES / "elbow_markers_robot.csv",
    )
    truth = json.loads((SAMPLES / "elbow_truth.json").read_text())
    line = np.array(truth["curve_px"])
    frames = []
    for step in range(1, FRAMES_DRAWN + 1):
        frames.append(drawn_frame(empty, line, step / FRAMES_DRAWN))
    frames += [planned_frame(empty, line, plan)] * FRAMES_PLANNED
    hips, proxies, forces = pushed(plan, line)
    for step in range(FRAMES_PUSHED):
        frames.append(pushed_frame(empty, line, hips[: step + 1], proxies[step], forces[step]))
    write(frames)


def without_line(picture: np.ndarray) -> np.ndarray:
    """The slice before anybody drew on it: the red pixels filled from around."""
    red = picture[..., 0].astype(int) - picture[..., 1:].max(axis=2)
    mask = cv2.dilate((red > 25).astype(np.uint8), np.ones((7, 7), np.uint8))
    ground = cv2.cvtColor(cv2.inpaint(picture, mask, 5, cv2.INPAINT_TELEA), cv2.COLOR_RGB2GRAY)
    return np.repeat(ground[..., None], 3, axis=2)


def pushed(plan: vfplan.PlanResult, line: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tip and proxy on the slice (n, 2) [px], and the force [N], for each frame."""
    first, last = np.searchsorted(arc_length(line), [250.0, 430.0])
    along = line[np.linspace(first, last, FRAMES_PUSHED).astype(int)]
    tangent = np.gradient(along, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]])
    # The tip comes from 12 mm outside, presses 6 mm beyond the line, and leaves again.
    shape = np.interp(np.linspace(0, 1, FRAMES_PUSHED), [0, 0.3, 0.75, 1], [12, -6, -6, 12])
    hips_px = along + normal * (shape / MM_PER_PX)[:, None]
    # Twenty ticks a frame are enough for the engine; the film is slower than the hand.
    ticks = np.linspace(0, FRAMES_PUSHED - 1, 20 * FRAMES_PUSHED)
    u = np.interp(ticks, range(FRAMES_PUSHED), hips_px[:, 0])
    v = np.interp(ticks, range(FRAMES_PUSHED), hips_px[:, 1])
    engine = vfplan.ProxyEngine.of(plan.fixture)
    registration = plan.registered.registration
    trace = engine.run(registration.apply(np.column_stack([u, v])))
    origin = registration.apply(np.zeros((1, 2)))
    # (3, 2) the slice's axes in the robot's frame [m a pixel].
    axes = (registration.apply(np.eye(2)) - origin).T
    proxies_px = (np.linalg.pinv(axes) @ (trace.proxy - origin).T).T
    forces = np.linalg.norm(trace.force, axis=1)
    frames = np.linspace(0, len(ticks) - 1, FRAMES_PUSHED).astype(int)
    return hips_px, proxies_px[frames], forces[frames]


def arc_length(line: np.ndarray) -> np.ndarray:
    """Length along a line up to each of its points [px]."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def drawn_frame(empty: np.ndarray, line: np.ndarray, share: float) -> Image.Image:
    """The slice with a part of the line drawn."""
    figure, axis = stage(empty, "1  Draw a red line on the slice.")
    line = line[is_shown(line)]
    part = line[: max(2, round(share * len(line)))]
    axis.plot(part[:, 0], part[:, 1], color=PEN, linewidth=2.6)
    return picture_of(figure)


def planned_frame(picture: np.ndarray, line: np.ndarray, plan: vfplan.PlanResult) -> Image.Image:
    """The slice with the measured line and the markers."""
    registration = plan.registered.registration
    bound_mm = 1e3 * plan.report["register"]["tre"]["curve95_max_m"]
    text = f"2  vfplan measures it and finds it in front of the robot, within {bound_mm:.2f} mm."
    figure, axis = stage(picture, text)
    axis.plot(line[:, 0], line[:, 1], color="white", linewidth=4.5)
    axis.plot(line[:, 0], line[:, 1], color=CLOUD, linewidth=2.2)
    for label, (u, v) in zip(registration.labels, registration.source[:, :2], strict=True):
        if is_shown(np.array([[u, v]]))[0]:
            axis.plot(u, v, "+", color=TUBE, markersize=13, markeredgewidth=2)
            axis.annotate(label, (u, v), (7, -4), textcoords="offset points", color=TUBE)
    return picture_of(figure)


def pushed_frame(
    picture: np.ndarray, line: np.ndarray, hips: np.ndarray, proxy: np.ndarray, force: float
) -> Image.Image:
    """The slice with the tip, its path, the proxy, and the force on the tip."""
    text = "3  The robot has loaded the file. Here the tool tip is free."
    if force > 0.05:
        text = f"3  The tool tip is pushed back with {force:.1f} N."
    figure, axis = stage(picture, text)
    axis.plot(line[:, 0], line[:, 1], color=CLOUD, linewidth=2.2)
    axis.plot(hips[:, 0], hips[:, 1], color="white", linewidth=4)
    axis.plot(hips[:, 0], hips[:, 1], color=TIP, linewidth=1.6)
    circle = plt.Circle(proxy, 5 / MM_PER_PX, fill=False, color=PROXY, linewidth=2)
    axis.add_patch(circle)
    axis.plot(*proxy, "o", color=PROXY, markersize=6)
    axis.plot(*hips[-1], "o", color=TIP, markeredgecolor="white", markersize=10)
    if force > 0.05:
        direction = (proxy - hips[-1]) / np.linalg.norm(proxy - hips[-1])
        tip = hips[-1] + direction * force / N_PER_FORCE_PX
        arrow = {"arrowstyle": "-|>", "color": FORCE, "linewidth": 2.2, "shrinkA": 0, "shrinkB": 0}
        axis.annotate("", tip, hips[-1], arrowprops=arrow)
    return picture_of(figure)


def is_shown(points: np.ndarray) -> np.ndarray:
    """Which of the points lie in the part of the slice that is shown."""
    u, v = points.T
    return (u > LEFT_PX) & (u < RIGHT_PX) & (v > TOP_PX) & (v < BOTTOM_PX)


def stage(picture: np.ndarray, text: str) -> tuple[plt.Figure, Axes]:
    """A figure with the part of the slice and a caption below it."""
    figure = plt.figure(figsize=(6.4, 5.5), dpi=80)
    axis = figure.add_axes((0, 0.07, 1, 0.93))
    axis.imshow(picture)
    axis.set(xlim=(LEFT_PX, RIGHT_PX), ylim=(BOTTOM_PX, TOP_PX), xticks=[], yticks=[])
    axis.set_frame_on(False)
    figure.text(0.02, 0.022, text, fontsize=12)
    return figure, axis


def picture_of(figure: plt.Figure) -> Image.Image:
    """The figure as a picture."""
    figure.canvas.draw()
    picture = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3].copy())
    plt.close(figure)
    return picture


def write(frames: list[Image.Image]) -> None:
    """One film that repeats for ever; all frames share their colours, which keeps it small."""
    colours = Image.new("P", (1, 1))
    colours.putpalette(shared_colours().ravel().tolist())
    plain = [frame.quantize(palette=colours, dither=Image.Dither.NONE) for frame in frames]
    plain[0].save(FILM, save_all=True, append_images=plain[1:], duration=FRAME_MS, loop=0)
    print(f"wrote {FILM}, {FILM.stat().st_size / 1e3:.0f} kB")


def shared_colours() -> np.ndarray:
    """128 greys, and each colour of the film mixed with 25 of them, (n, 3)."""
    greys = np.repeat(np.linspace(0, 255, 128)[:, None], 3, axis=1)
    mixed = [greys]
    for colour in (PEN, CLOUD, TIP, PROXY, TUBE):
        pure = 255 * np.array(matplotlib.colors.to_rgb(colour))
        for share in (1.0, 0.8, 0.6, 0.4, 0.2):
            mixed.append(share * pure + (1 - share) * greys[::26])
    return np.concatenate(mixed).round().astype(int)


if __name__ == "__main__":
    main()
