"""A camera that takes pictures of a printed page: the place of every pixel on it is known."""

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from vfplan.camera.pose import Camera

SIZE = (1280, 720)
# A wide angle with the distortion of a webcam.
MATRIX = np.array([[942.0, 0.0, 655.0], [0.0, 939.0, 351.0], [0.0, 0.0, 1.0]])
CAMERA = Camera(*SIZE, MATRIX, np.array([0.09, -0.19, 0.0012, -0.0008, 0.05]))
# Samples along a side of a pixel, and pixels of the undistorted picture beyond its edge.
FINE, EDGE = 2, 120
# Dots of a page a metre.
DOTS = 6000.0


def page(figure, stretch=(1.0, 1.0)):
    """A page as a picture, as a printer gives it that stretches it."""
    figure.set_dpi(2 * DOTS * 0.0254)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    whole = np.asarray(canvas.buffer_rgba())[..., :3]
    size = np.round(np.multiply(whole.shape[1::-1], stretch) / 2).astype(int)
    return cv2.resize(whole, size, interpolation=cv2.INTER_AREA)


def _fine(n):
    return (n + 0.5 + EDGE) * FINE - 0.5


def _distortion():
    """Where each sample of the camera's picture lies in the undistorted one."""
    n = np.indices((SIZE[1] * FINE, SIZE[0] * FINE)).reshape(2, -1)[::-1].T
    pixels = ((n + 0.5) / FINE - 0.5)[:, None]
    often = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, 20, 1e-9)
    ideal = cv2.undistortPoints(
        pixels, MATRIX, CAMERA.distortion_coefficients, None, None, MATRIX, often
    )
    ideal = _fine(ideal).reshape(SIZE[1] * FINE, SIZE[0] * FINE, 2)
    return cv2.convertMaps(ideal.astype(np.float32), None, cv2.CV_16SC2)


MAPS = []


def photograph(picture, T, rng, *, covered=(), disturbed=True):
    """(720, 1280, 3) of a page from a pose; `covered`: places [m] and radii that a hand hides."""
    MAPS.extend(() if MAPS else _distortion())
    height, width = picture.shape[:2]
    metres = np.array([[1, 0, 0.5 - width / 2], [0, 1, 0.5 - height / 2], [0, 0, DOTS]]) / DOTS
    fine = np.array([[FINE, 0, _fine(0)], [0, FINE, _fine(0)], [0, 0, 1]])
    onto = fine @ MATRIX @ T[:3, [0, 1, 3]] @ metres
    picture = picture.copy()
    for place, radius in covered:
        centre = np.round(DOTS * np.asarray(place) + [width / 2, height / 2]).astype(int).tolist()
        cv2.circle(picture, centre, round(DOTS * radius), (190, 150, 120), -1)
    size = [round(_fine(n + EDGE) + 0.5) for n in SIZE]
    table = tuple(int(value) for value in rng.integers(60, 150, 3))
    ideal = cv2.warpPerspective(picture, onto, size, borderValue=table)
    frame = cv2.remap(ideal, *MAPS, cv2.INTER_LINEAR)
    frame = cv2.resize(frame, SIZE, interpolation=cv2.INTER_AREA)
    if not disturbed:
        return frame
    frame = np.clip(np.rint(_disturbed(frame, rng)), 0, 255).astype(np.uint8)
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(60, 95))]
    return cv2.imdecode(cv2.imencode(".jpg", frame, quality)[1], 1)


def _disturbed(frame, rng):
    """With less contrast, a shadow, glare, blur by motion and by the lens, and noise."""
    frame = 25 + frame * np.float32(rng.uniform(0.6, 0.8))
    v, u = np.indices(frame.shape[:2], np.float32)
    u, v, turn = u - rng.uniform(150, 1130), v - rng.uniform(100, 620), rng.uniform(0, 2 * np.pi)
    side = (u * np.cos(turn) + v * np.sin(turn)) / rng.uniform(4, 60)
    frame *= 1 - rng.uniform(0, 0.5) / (1 + np.exp(-np.clip(side, -50, 50)))[..., None]
    frame += rng.uniform(0, 200) * np.exp(-(u**2 + v**2) / rng.uniform(30, 120) ** 2)[..., None]
    kernel, turn = np.zeros((9, 9), np.float32), rng.uniform(0, np.pi)
    for way in np.linspace(-0.5, 0.5, 25) * rng.uniform(0, 3):
        shift = np.array([[1, 0, way * np.cos(turn)], [0, 1, way * np.sin(turn)]])
        kernel += cv2.warpAffine(np.pad(np.ones((1, 1), np.float32), 4), shift, (9, 9))
    frame = cv2.filter2D(frame, -1, kernel / kernel.sum())
    frame = cv2.GaussianBlur(frame, (0, 0), rng.uniform(0.3, 0.9))
    return frame + rng.normal(0, rng.uniform(1, 4), frame.shape).astype(np.float32)


def pose(rng, distance=(0.42, 0.65), tilt=35):
    """(4, 4) T_camera_page; the middle of the page is near that of the picture."""
    around, T = rng.uniform(0, 2 * np.pi), np.eye(4)
    tilted = np.radians(rng.uniform(0, tilt)) * np.array([np.cos(around), np.sin(around), 0])
    roll = np.array([0, 0, rng.uniform(-np.pi, np.pi)])
    T[:3, :3] = cv2.Rodrigues(tilted)[0] @ cv2.Rodrigues(roll)[0]
    T[:3, 3] = rng.uniform(-0.03, 0.03), rng.uniform(-0.02, 0.02), rng.uniform(*distance)
    return T
