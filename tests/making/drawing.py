"""Pictures with a known centre line, drawn by exact coverage; nothing here uses vfplan.

The pen is a disc swept along the curve, so a pixel's coverage is the share of its square that lies
within half a pen's width of the curve. It is computed on a 12 x 12 grid inside each pixel near the
curve, with the distance to the curve's own polyline (vertices every 0.05 px).
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

SUB = 12


def arc_of(curve, closed=False):
    """The length of a curve up to each point; of a closed one, back to the first too."""
    ring = np.vstack([curve, curve[:1]]) if closed else curve
    return np.r_[0.0, np.cumsum(np.hypot(*np.diff(ring, axis=0).T))]


def at_arcs(wanted, curve):
    """The places of an open curve at lengths of arc; (M, 2)."""
    return np.column_stack([np.interp(wanted, arc_of(curve), axis) for axis in np.transpose(curve)])


def unit(angle):
    """The unit vectors at angles [rad] from u towards v; (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def to_ends(points):
    """(M,) the distance of each point from the nearer of the first and the last."""
    return np.hypot(*np.moveaxis(points[:, None] - points[[0, -1]], 2, 0)).min(1)


def polyline(points, closed=False, step=0.05):
    """The points every `step` px of arc along straight segments; (M, 2)."""
    ring = np.vstack([points, points[:1]]) if closed else points
    length = arc_of(ring)[-1]
    return at_arcs(np.linspace(0, length, max(2, int(np.ceil(length / step)) + 1)), ring)


def samples_near(shape, dense, radius, fine):
    """The pixels near a line; of fine x fine samples in each: places, distances, nearest points."""
    near = np.zeros(shape, np.uint8)
    at = np.rint(dense).astype(int)
    inside = (at >= 0).all(1) & (at < [shape[1], shape[0]]).all(1)
    near[at[inside, 1], at[inside, 0]] = 1
    reach = 2 * int(np.ceil(radius + 1.5)) + 1
    rows, cols = np.nonzero(cv2.dilate(near, np.ones((reach, reach), np.uint8)))
    offset = (np.arange(fine) + 0.5) / fine - 0.5
    du, dv = (grid.ravel() for grid in np.meshgrid(offset, offset))
    places = np.column_stack([(cols[:, None] + du).ravel(), (rows[:, None] + dv).ravel()])
    distance, index = cKDTree(dense).query(places, workers=1)
    return (rows, cols), places.T, distance, index


def coverage(shape, points, width, closed=False, cap="round"):
    """(H, W) float64 share of each pixel that a pen of `width` px covers.

    An open line ends in a half disc ("round") or at its end ("butt").
    """
    dense = polyline(points, closed)
    pixels, (u, v), distance, index = samples_near(shape, dense, width / 2, SUB)
    covered = distance <= width / 2
    if cap != "round" and not closed:
        for end, inner, where in ((0, 8, index == 0), (-1, -9, index == len(dense) - 1)):
            out = dense[end] - dense[inner]
            beyond = (u - dense[end, 0]) * out[0] + (v - dense[end, 1]) * out[1] > 0
            covered &= ~(where & beyond)
    result = np.zeros(shape)
    result[pixels] = covered.reshape(len(pixels[0]), -1).mean(1)
    return result


def straight_coverage(slope, turned):
    """(2, 2) ends, and exact coverage, of a line over 300 px of columns, or `turned`, of rows.

    The pen is 3 px wide. It begins at row 60.13 of column 60 and is cut off upright. `coverage`
    counts samples, 12 in a row: too few for a line nearly along one.
    """
    shape, columns, start = (420, 420), (60, 360), 60.13
    share = np.zeros(shape)
    row = np.arange(shape[0])[:, None]
    for strip in (np.arange(64) + 0.5) / 64 - 0.5:
        u = np.arange(shape[1]) + strip
        middle, half = start + slope * (u - columns[0]), 1.5 * np.hypot(1, slope)
        inside = np.minimum(row + 0.5, middle + half) - np.maximum(row - 0.5, middle - half)
        share += np.clip(inside, 0, 1) * ((u > columns[0]) & (u < columns[1])) / 64
    ends = np.array([[columns[0], start], [columns[1], start + slope * 300]])
    return (ends[:, ::-1], share.T) if turned else (ends, share)


def blend(background, share, colour, opacity=1.0, gamma=1.0):
    """Paint `colour` (0..255) over (H, W, 3) float 0..255; `gamma` 2.2 blends in linear light."""
    a = (share * opacity)[..., None]
    base, pen = (background / 255.0) ** gamma, (np.asarray(colour) / 255.0) ** gamma
    return 255.0 * (base * (1 - a) + pen * a) ** (1 / gamma)


def to_uint8(picture):
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def jpeg(picture, quality):
    """The picture after JPEG, 4:2:0; (H, W, 3) uint8 RGB in and out."""
    flags = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR]
    flags.append(cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420)
    ok, data = cv2.imencode(".jpg", picture[..., ::-1], flags)
    assert ok
    return cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1].copy()


def flat(shape, grey=220.0):
    return np.full((*shape, 3), float(grey))


def anatomy(shape, seed=0):
    """A grey picture with soft blobs, sharp bright edges, dark air and fine noise, like a CT."""
    rng = np.random.default_rng(seed)
    h, w = shape
    grey = cv2.GaussianBlur(rng.normal(0, 1, shape), (0, 0), 25) * 900 + 120
    rows, cols = np.mgrid[:h, :w]
    for _ in range(8):
        centre, size = rng.uniform(0.1, 0.9, 2) * (w, h), rng.uniform(0.04, 0.18) * w
        ring = np.hypot((cols - centre[0]) * rng.uniform(0.5, 1.5), rows - centre[1])
        grey = np.where(np.abs(ring - size) < rng.uniform(1, 6), 250.0, grey)
    grey = cv2.GaussianBlur(np.clip(grey, 5, 255), (0, 0), 0.7) + rng.normal(0, 2, shape)
    return np.repeat(np.clip(grey, 0, 255)[..., None], 3, axis=2)


def wavy(shape, seed=0, closed=False, margin=0.18, count=4000):
    """A smooth hand-like curve through random places; (count, 2) px, no self-crossing."""
    rng = np.random.default_rng(seed)
    h, w = shape
    if closed:
        t = np.linspace(0, 2 * np.pi, count, endpoint=False)
        radius = np.full(count, 0.30)
        for k in range(2, 6):
            radius += rng.normal(0, 0.075 / k) * np.cos(k * t + rng.uniform(0, 6.28))
        return np.column_stack(
            [w / 2 + rng.uniform(-1, 1) + w * radius * np.cos(t), h / 2 + h * radius * np.sin(t)]
        )
    t = np.linspace(0, 1, count)
    u = w * (margin + (1 - 2 * margin) * t)
    v = np.full(count, h / 2 + rng.uniform(-1, 1))
    for k in range(1, 6):
        v += h * rng.normal(0, 0.12 / k) * np.sin(np.pi * k * t + rng.uniform(0, 6.28))
    angle = rng.uniform(0, 6.28)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    centre = np.array([w / 2, h / 2])
    return (np.column_stack([u, v]) - centre) @ turn.T * 0.85 + centre


def normal_errors(points, truth, closed):
    """Signed distance of each point from the true curve along its normal [px], (M,)."""
    dense = polyline(truth, closed, 0.02)
    index = np.clip(cKDTree(dense).query(points)[1], 1, len(dense) - 2)
    tangent = dense[index + 1] - dense[index - 1]
    tangent /= np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
    offset = points - dense[index]
    across = tangent[:, 0] * offset[:, 1] - tangent[:, 1] * offset[:, 0]
    along = (tangent * offset).sum(1)  # up to half a step between vertices; more beyond an end
    return np.where(np.abs(along) < 0.02, across, np.copysign(np.hypot(across, along), across))


def distance_to_line(places, line):
    """From (N, k) places to the open polygon through (M, k) points, nearly; (N,)."""
    at = np.linspace(0, len(line) - 1, 100 * len(line))
    dense = np.column_stack([np.interp(at, range(len(line)), column) for column in line.T])
    return cKDTree(dense).query(places)[0]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def rms_off(stroke, truth):
    """RMS error across an open true line of all points of a stroke but two at each end [px]."""
    return rms(normal_errors(stroke.points_px, truth, False)[2:-2])
