"""Make the shipped sample: an elbow-like CT slice, its plan, its markers and a probing session.

    python samples/make_elbow.py [FOLDER]

The setting is that of the paper's Fig. 5 and Experiment 2: a slice of 871 x 786 pixels with a red
hand-drawn curve and nine labelled markers, printed on paper and fixed to the robot's table. The
print's scale and the pen's width are such that the paper's way, every mask pixel a point, gives its
2204 points at 5.3 points/mm. Everything is drawn here; no patient's image is involved.

Writes `elbow.png`, `elbow_markers_image.csv`, `elbow_markers_robot.csv`, `elbow_session.csv` and
`elbow_truth.json` (what the drawing knows and a plan must recover). The same bytes every time.
"""

from __future__ import annotations

import json
import sys
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from scipy.interpolate import make_interp_spline, splev, splprep
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

WIDTH = 871
"""Columns of the slice [px]."""
HEIGHT = 786
"""Rows of the slice [px]."""
MM_PER_PX = 0.5
"""Scale of the print [mm/px]."""
LENGTH_PX = 2204 / 5.3 / MM_PER_PX
"""Length of a curve of 2204 points at 5.3 points/mm [px]."""
PEN_PX = 2.6488
"""Width of the pen [px]. It makes 5.3 mask pixels to a millimetre of curve."""
PEN_COLOUR = np.array([226, 26, 32])
"""Red, green and blue of the pen."""
FLE_SIGMA_M = 0.2e-3
"""How well a marker is touched with the robot's tip, each axis [m]."""
RATE_HZ = 1000.0
"""Ticks a second of the session [Hz]."""
APPROACH_M = 0.012
"""Distance from the curve at which a visit begins and ends [m]."""
PRESS_M = 0.0025
"""How far beyond the curve the hand presses [m]."""
SLIDE_M = 0.045
"""How far along the curve the hand slides [m]."""
MEAN_SPEED_M_S = 0.12
"""Mean speed of a careful hand [m/s]."""
VISITS_M = [0.05, 0.17, 0.29]
"""Where along the curve the visits begin [m]."""

# Outlines in pixels, drawn by eye after sagittal slices of an elbow.
SOFT_TISSUE = [(330, -60), (300, 120), (215, 250), (190, 390), (250, 520), (420, 600), (600, 640),
               (930, 700), (930, 470), (720, 430), (600, 330), (570, 150), (590, -60)]  # fmt: skip
HUMERUS = [(405, -60), (398, 90), (388, 200), (352, 285), (348, 360), (395, 415), (462, 418),
           (508, 370), (506, 300), (484, 220), (490, 90), (502, -60)]  # fmt: skip
ULNA = [(287, 255), (262, 300), (254, 380), (282, 462), (350, 512), (470, 540), (640, 580),
        (930, 640), (930, 565), (760, 520), (640, 480), (560, 440), (556, 392), (531, 382),
        (508, 425), (452, 454), (380, 450), (330, 410), (314, 350), (322, 290),
        (308, 252)]  # fmt: skip
PLAN = [(252, 226), (236, 262), (231, 318), (229, 380), (245, 440), (282, 492), (342, 530),
        (420, 546), (495, 566), (550, 572), (610, 590), (665, 622), (720, 640), (790, 672),
        (850, 700)]  # fmt: skip
MARKERS_PX = [(120.4, 98.2), (432.7, 66.9), (748.1, 104.6), (96.3, 402.8), (447.2, 330.5),
              (768.9, 372.1), (118.8, 690.4), (441.6, 702.3), (752.5, 724.7)]  # fmt: skip


def smooth_outline(outline: list[tuple[int, int]]) -> np.ndarray:
    """(800, 2) points of a spline through an outline [px]."""
    spline, _ = splprep(np.array(outline, float).T, s=0, per=False)
    return np.stack(splev(np.linspace(0, 1, 800), spline), axis=1)


def bone(outline: list[tuple[int, int]], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Coverage (H, W) of a bone and its grey values: a bright cortex around a trabecular core."""
    points = smooth_outline(outline)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.fillPoly(mask, [np.round(points * 16).astype(np.int32)], 255, cv2.LINE_AA, shift=4)
    coverage = mask / 255.0
    depth = cv2.distanceTransform((mask > 127).astype(np.uint8), cv2.DIST_L2, 5)
    texture = gaussian_filter(rng.normal(size=mask.shape), 2.0) * 55
    cortex = np.exp(-((depth / 9.0) ** 2))
    return coverage, 150 + texture * (1 - cortex) + 85 * cortex


def slice_image(rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8: the grey slice before anything is drawn on it."""
    grey = np.full((HEIGHT, WIDTH), 12.0)
    skin = np.zeros((HEIGHT, WIDTH), np.uint8)
    outline = smooth_outline([*SOFT_TISSUE, SOFT_TISSUE[0]])
    cv2.fillPoly(skin, [np.round(outline).astype(np.int32)], 255)
    fat = gaussian_filter(skin / 255.0, 2.0)
    muscle = gaussian_filter((cv2.erode(skin, np.ones((27, 27))) / 255.0), 5.0)
    streaks = gaussian_filter(rng.normal(size=grey.shape), (3, 14)) * 60
    grey += fat * 48 + muscle * (38 + streaks)
    for bone_outline in (HUMERUS, ULNA):
        coverage, value = bone(bone_outline, rng)
        grey = grey * (1 - coverage) + value * coverage
    grey = gaussian_filter(grey, 0.8) + rng.normal(0, 3.0, grey.shape)
    return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def planned_curve(rng: np.random.Generator) -> np.ndarray:
    """(M, 2) the curve's centre line [px], 0.05 px apart, with the slow waver of a hand."""
    control = np.array(PLAN, float)
    control += rng.normal(0, 2.0, control.shape)
    chord = lengths_along(control)
    spline = make_interp_spline(chord, control, k=3)
    dense = spline(np.linspace(0, chord[-1], 40_000))
    return interpolate(np.arange(0, LENGTH_PX, 0.05), lengths_along(dense), dense)


def lengths_along(points: np.ndarray) -> np.ndarray:
    """(N,) the length of a polyline up to each of its points."""
    return np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]


def interpolate(places: np.ndarray, s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(M, D) values at places along a line; `values` are (N, D), those at its lengths `s`."""
    columns = [np.interp(places, s, column) for column in values.T]
    return np.stack(columns, axis=1)


def draw_pen(image: np.ndarray, curve: np.ndarray) -> None:
    """Paint the curve: a pixel's coverage falls linearly over one pixel at the pen's rim."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    distance, _ = cKDTree(curve).query(np.c_[u.ravel(), v.ravel()], distance_upper_bound=PEN_PX)
    alpha = np.clip(PEN_PX / 2 + 0.5 - distance, 0, 1).reshape(HEIGHT, WIDTH, 1)
    image[:] = np.round(image * (1 - alpha) + PEN_COLOUR * alpha).astype(np.uint8)


def draw_markers(image: np.ndarray) -> None:
    """Paint nine cyan crosses with yellow labels x1 to x9."""
    cyan = (40, 210, 240)
    yellow = (250, 250, 40)
    for i, (u, v) in enumerate(MARKERS_PX, start=1):
        for du, dv in ((7, 0), (0, 7)):
            # With shift=4, OpenCV takes coordinates in sixteenths of a pixel.
            start = (round((u - du) * 16), round((v - dv) * 16))
            end = (round((u + du) * 16), round((v + dv) * 16))
            cv2.line(image, start, end, cyan, 1, cv2.LINE_AA, shift=4)
        place = (round(u) + 8, round(v) - 7)
        cv2.putText(image, f"x{i}", place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, yellow, 1, cv2.LINE_AA)


def robot_from_image() -> np.ndarray:
    """(3, 3) true map on [u v 1] into `robot_base` [m]: the print lies flat, turned by 4°."""
    scale = MM_PER_PX * 1e-3
    angle = np.radians(4.0)
    T_robot_image = np.zeros((3, 3))
    T_robot_image[:2, 0] = scale * np.array([np.cos(angle), np.sin(angle)])
    T_robot_image[:2, 1] = scale * np.array([np.sin(angle), -np.cos(angle)])
    T_robot_image[:, 2] = [0.34, 0.16, 0.02]
    return T_robot_image


def waypoints(length: float) -> list[tuple[float, float]]:
    """(along, across) the curve [m]: three visits from one side, round the end, three back."""
    path = [(0.02, APPROACH_M)]
    for place in VISITS_M:
        path += visit(place, place + SLIDE_M, side=1)
    path.append((length + 0.02, APPROACH_M))
    path.append((length + 0.02, -APPROACH_M))
    for place in reversed(VISITS_M):
        path += visit(place + SLIDE_M, place, side=-1)
    return path


def visit(start: float, end: float, side: int) -> list[tuple[float, float]]:
    """Come to the curve from a side, press beyond it, slide along it, and leave again."""
    return [
        (start, side * APPROACH_M),
        (start, -side * PRESS_M),
        (end, -side * PRESS_M),
        (end, side * APPROACH_M),
    ]


def probing_session(curve_m: np.ndarray) -> np.ndarray:
    """(T, 4) t, x, y, z: the hand visits the curve three times from each side.

    Each visit comes from 12 mm away, presses to 2.5 mm beyond the drawn curve, slides 45 mm along
    it and leaves again; minimum-jerk between waypoints, with a hand's slow tremor.
    """
    s = lengths_along(curve_m)
    moves = []
    path = np.array(waypoints(s[-1]))
    for start, end in pairwise(path):
        seconds = max(0.4, np.linalg.norm(end - start) / MEAN_SPEED_M_S)
        x = np.linspace(0, 1, round(seconds * RATE_HZ), endpoint=False)[:, None]
        moves.append(start + (end - start) * (10 * x**3 - 15 * x**4 + 6 * x**5))
    along, across = np.concatenate(moves).T
    t = np.arange(along.size) / RATE_HZ
    across = across + 0.15e-3 * np.sin(2 * np.pi * 7.3 * t)

    # Beyond its end the curve goes on straight.
    inside = np.clip(along, 0, s[-1])
    foot = interpolate(inside, s, curve_m)
    slope = gaussian_filter(np.gradient(curve_m[:, :2], s, axis=0), (40, 0), mode="nearest")
    tangent = interpolate(inside, s, slope)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.c_[-tangent[:, 1], tangent[:, 0]]
    foot[:, :2] += normal * across[:, None] + tangent * (along - inside)[:, None]
    foot[:, 2] += 1.5e-3 * np.sin(2 * np.pi * 0.31 * t)
    return np.c_[t, foot]


def write_csv(path: Path, header: str, rows: list[str]) -> None:
    """Write lines with a header."""
    path.write_text("\n".join([header, *rows]) + "\n")


def main(folder: Path) -> None:
    """Write the five files into `folder`."""
    rng = np.random.default_rng(5)
    image = slice_image(rng)
    curve = planned_curve(rng)
    draw_markers(image)
    draw_pen(image, curve)
    cv2.imwrite(str(folder / "elbow.png"), image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])

    T_robot_image = robot_from_image()
    markers = np.array(MARKERS_PX)
    touched = np.c_[markers, np.ones(9)] @ T_robot_image.T + rng.normal(0, FLE_SIGMA_M, (9, 3))
    rows = []
    for i, (u, v) in enumerate(markers, start=1):
        rows.append(f"x{i},{u:.2f},{v:.2f}")
    write_csv(folder / "elbow_markers_image.csv", "label,u_px,v_px", rows)
    rows = []
    for i, (x, y, z) in enumerate(touched, start=1):
        rows.append(f"x{i},{x:.6f},{y:.6f},{z:.6f}")
    write_csv(folder / "elbow_markers_robot.csv", "label,x_m,y_m,z_m", rows)

    curve_m = np.c_[curve, np.ones(len(curve))] @ T_robot_image.T
    rows = []
    for t, x, y, z in probing_session(curve_m):
        rows.append(f"{t:.3f},{x:.7f},{y:.7f},{z:.7f}")
    write_csv(folder / "elbow_session.csv", "t,x,y,z", rows)

    # Every twentieth point, a pixel apart, and the last one, where the pen was lifted.
    truth_px = np.vstack([curve[:-1:20], curve[-1:]])
    length = float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
    truth = {
        "T_robot_image": T_robot_image.tolist(),
        "pixel_spacing_mm": MM_PER_PX,
        "pen_px": PEN_PX,
        "length_px": round(length, 2),
        "marker_sigma_m": FLE_SIGMA_M,
        "curve_px": np.round(truth_px, 3).tolist(),
    }
    (folder / "elbow_truth.json").write_text(json.dumps(truth) + "\n")


if __name__ == "__main__":
    output_folder = Path(__file__).parent
    if len(sys.argv) > 1:
        output_folder = Path(sys.argv[1])
    main(output_folder)
