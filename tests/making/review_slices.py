"""Drawn slices that extraction refuses or doubts, each with the line that is meant."""

from __future__ import annotations

import cv2
import numpy as np
from canvas import RASTERISERS, Canvas
from drawing import anatomy, normal_errors

SHAPE = (320, 380)
RED = (255, 0, 0)


def wave(first=40, last=330, height=80):
    """(M, 2) an open line across the slice."""
    u = np.linspace(first, last, 600)
    return np.column_stack([u, height + 30 * np.sin((u - 40) / 58)])


def _canvas():
    return Canvas(anatomy(SHAPE, 1), RASTERISERS[0])


def _write(path, picture):
    cv2.imwrite(str(path), picture[..., ::-1])
    return path


def clear(path):
    truth = wave()
    canvas = _canvas()
    canvas.line(truth, 3.0, RED)
    return _write(path, canvas.image(None)), truth


def two_candidates(path):
    """Two lines of about one length; the lower is meant."""
    truth = wave(60, 300, 220)
    canvas = _canvas()
    canvas.line(wave(), 3.0, RED)
    canvas.line(truth, 3.0, RED)
    return _write(path, canvas.image(None)), truth


def fork(path):
    """A line with a branch; the line from the left to the right is meant."""
    truth = wave()
    canvas = _canvas()
    canvas.line(truth, 3.0, RED)
    start = truth[300]
    branch = start + np.linspace(0, 1, 100)[:, None] * np.array([80.0, 110.0])
    canvas.line(branch, 3.0, RED)
    return _write(path, canvas.image(None)), truth


def double(path, gap=8.0):
    """Two lines side by side, `gap` px apart; the upper is meant."""
    truth = wave()
    canvas = _canvas()
    canvas.line(truth, 3.0, RED)
    canvas.line(truth + np.array([0.0, gap]), 3.0, RED)
    return _write(path, canvas.image(None)), truth


def hidden_end(path):
    """A line whose last 30 px lie under a grey box."""
    truth = wave()
    canvas = _canvas()
    canvas.line(truth, 3.0, RED)
    picture = canvas.image(None)
    picture[20:90, 300:350] = 128
    return _write(path, picture), truth, (300, 20, 50, 70)


def miss(curve, truth, ends_px=2.0):
    """How far a curve lies from the truth across it at most, its last pixels at open ends apart."""
    curve = np.asarray(curve)
    inner = np.hypot(*(curve - truth[0]).T) > ends_px
    inner &= np.hypot(*(curve - truth[-1]).T) > ends_px
    return float(np.abs(normal_errors(curve[inner], truth, False)).max())
