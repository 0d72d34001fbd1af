"""The sample, and slices that extraction refuses or doubts, each with the line that is meant."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from canvas import RASTERISERS, Canvas
from drawing import anatomy, normal_errors

SAMPLES = Path(__file__).parents[2] / "samples"
SLICE = SAMPLES / "elbow.png"
MARKERS = (SAMPLES / "elbow_markers_image.csv", SAMPLES / "elbow_markers_robot.csv")
SHAPE = (320, 380)
RED = (255, 0, 0)


def wave(first=40, last=330, height=80):
    """(M, 2) an open line across the slice."""
    u = np.linspace(first, last, 600)
    return np.column_stack([u, height + 30 * np.sin((u - 40) / 58)])


BRANCH = wave()[300] + np.linspace(0, 1, 100)[:, None] * (80.0, 110.0)


def _canvas(*lines):
    canvas = Canvas(anatomy(SHAPE, 1), RASTERISERS[0])
    for line in lines:
        canvas.line(line, 3.0, RED)
    return canvas


def _write(path, picture):
    cv2.imwrite(str(path), picture[..., ::-1])
    return path


def _drawn(path, *lines):
    return _write(path, _canvas(*lines).image())


def clear(path):
    truth = wave()
    return _drawn(path, truth), truth


def two_candidates(path):
    """Two lines of about one length; the lower is meant."""
    truth = wave(60, 300, 220)
    return _drawn(path, wave(), truth), truth


def lifted(path):
    """A line in two pieces, farther apart than extraction bridges."""
    return _drawn(path, wave(40, 160), wave(200, 330))


def fork(path):
    """A line with a branch; the line from the left to the right is meant."""
    return _drawn(path, wave(), BRANCH), wave()


def several(path):
    """An open line, and one that forks."""
    return _drawn(path, wave(), BRANCH, wave(60, 250, 260)), wave()


def double(path, gap=8.0):
    """Two lines side by side, `gap` px apart; the upper is meant."""
    truth = wave()
    return _drawn(path, truth, truth + np.array([0.0, gap])), truth


def half_double(path):
    """A line of which a part was drawn once more, 3 px beside it."""
    truth = wave()
    return _drawn(path, truth, truth[200:420] + np.array([0.0, 3.0])), truth


def smooth(path):
    """A line that a stylus pressed harder in its middle: it grows wide and thin again smoothly."""
    truth, canvas = wave(), _canvas()
    for k in range(0, len(truth) - 8, 4):
        width = 3.0 + 2.5 * np.exp(-(((k / len(truth) - 0.5) / 0.12) ** 2))
        canvas.line(truth[k : k + 9], width, RED)
    return _write(path, canvas.image()), truth


def loops(path):
    """A line that crosses itself twice; no way around a hole passes its other loop."""
    t = np.linspace(-3.5, 9.78, 800)
    u, v = 190 + 22 * (t - np.pi) - 50 * np.sin(t), 150 - 60 * np.cos(t)
    truth = np.column_stack([u, v - 0.1 * (u - 190)])
    return _drawn(path, truth), truth


def overshoot(path):
    """A ring whose ends cross and go on beyond each other; the ring is meant."""
    turn, canvas = np.linspace(0, 2 * np.pi, 600), _canvas()
    ring = np.column_stack([190 + 140 * np.cos(turn), 150 + 100 * np.sin(turn)])
    canvas.line(np.vstack([ring[0] - (14, 14), ring, ring[-1] + (14, 14)]), 4.3, RED)
    return _write(path, canvas.image()), ring


def crumb(path):
    """A line, and a short one of the same pen that is meant."""
    t = np.linspace(0.3, 2.8, 400)
    truth = np.column_stack([200 - 22 * np.cos(t), 290 - 22 * np.sin(t)])
    return _drawn(path, wave(), truth), truth


def blue(path):
    """One line, drawn in blue."""
    picture = np.full((200, 300, 3), 90, np.uint8)
    cv2.line(picture, (60, 100), (240, 110), (0, 0, 255), 3, cv2.LINE_AA)
    return _write(path, picture), np.linspace((60, 100), (240, 110), 400)


def hidden_end(path):
    """A line whose last 30 px lie under a grey box."""
    truth = wave()
    picture = _canvas(truth).image()
    picture[20:90, 300:350] = 128
    return _write(path, picture), truth, (300, 20, 50, 70)


def miss(curve, truth):
    """How far a curve lies from the truth across it at most, its last pixels at open ends apart."""
    curve = np.asarray(curve)
    inner = np.hypot(*(curve - truth[0]).T) > 2.0
    inner &= np.hypot(*(curve - truth[-1]).T) > 2.0
    return float(np.abs(normal_errors(curve[inner], truth, False)).max())


def shifted(path, off_px):
    """The sample's markers on the slice, one of them beside its place; and where it belongs."""
    lines = MARKERS[0].read_text().splitlines()
    label, u, v = lines[4].split(",")
    lines[4] = f"{label},{float(u) + off_px:.2f},{v}"
    path.write_text("\n".join(lines) + "\n")
    return path, (float(u), float(v))


def marker_table(path, places_px, robot_m, labels=None):
    """One file with both positions of each marker; without labels they are m0, m1 and so on."""
    labels = labels or [f"m{k}" for k in range(len(places_px))]
    table = zip(labels, np.c_[places_px, robot_m].tolist(), strict=True)
    rows = [",".join(map(str, (label, *row))) for label, row in table]
    path.write_text("\n".join(["label,u_px,v_px,x_m,y_m,z_m", *rows]) + "\n")
    return path


def photographed(folder, seed=0):
    """The sample seen by a camera beside it, its markers' pixels there, and the homography."""
    picture = cv2.imread(str(SLICE))
    height, width = picture.shape[:2]
    corners = np.float32([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]])
    pulled = np.random.default_rng(seed).uniform(0.02, 0.12, (4, 2)) * [width, height]
    inward = np.sign([width / 2, height / 2] - corners)
    homography = cv2.getPerspectiveTransform(corners, np.float32(corners + inward * pulled))
    path = folder / f"photo-{seed}.png"
    cv2.imwrite(str(path), cv2.warpPerspective(picture, homography, (width, height), flags=2))
    rows = [line.split(",") for line in MARKERS[0].read_text().split()]
    places = np.array([row[1:] for row in rows[1:]], float)
    places = cv2.perspectiveTransform(places[None], homography)
    lines = [f"{row[0]},{u:.4f},{v:.4f}" for row, (u, v) in zip(rows[1:], places[0], strict=True)]
    markers = folder / f"photo-{seed}.csv"
    markers.write_text("\n".join(["label,u_px,v_px", *lines, ""]))
    return path, markers, homography
