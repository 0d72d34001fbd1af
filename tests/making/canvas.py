"""One picture, three rasterisers: exact coverage (`drawing`), Agg (matplotlib's) and Skia.

Places are (u, v) px, the centre of the top-left pixel is (0, 0). Nothing here uses vfplan.
"""

from __future__ import annotations

from importlib.util import find_spec

import cv2
import numpy as np
from drawing import arc_of, blend, coverage, jpeg, polyline, samples_near, to_uint8, unit

# Skia has no wheels for every platform.
RASTERISERS = ("exact", "agg", *(["skia"] if find_spec("skia") else []))
FINE = 8  # samples a pixel along either axis, of a filled shape drawn exactly


class Canvas:
    """A picture that is drawn on; `paint` lays (H, W) coverage of a colour over it.

    Parameters
    ----------
    ground
        (H, W, 3) float 0..255.
    rasteriser
        One of `RASTERISERS`.
    """

    def __init__(self, ground, rasteriser):
        self.picture = np.array(ground, float)
        self.rasteriser = rasteriser

    @property
    def shape(self):
        return self.picture.shape[:2]

    def paint(self, share, colour):
        self.picture = blend(self.picture, share, colour)

    def line(self, points, width, colour, closed=False, cap="round"):
        """A pen of one width [px] along (M, 2) points."""
        self.paint(self.line_share(np.asarray(points, float), width, closed, cap), colour)

    def line_share(self, points, width, closed=False, cap="round"):
        if self.rasteriser == "exact":
            return coverage(self.shape, points, width, closed, cap)
        return BY_LIBRARY[self.rasteriser](self.shape, points, closed, width, cap)

    def fill(self, points, colour):
        """What a simple closed outline of (M, 2) points encloses."""
        points = np.asarray(points, float)
        if self.rasteriser == "exact":
            self.paint(_filled(self.shape, points), colour)
        else:
            self.paint(BY_LIBRARY[self.rasteriser](self.shape, points, True, None), colour)

    def disc(self, centre, radius, colour):
        turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
        self.fill(np.add(centre, radius * unit(turn)), colour)

    def box(self, centre, width, height, colour):
        self.fill(rectangle(centre, width, height), colour)

    def pressed(self, points, widths, colour):
        """A pen whose width changes along (M, 2) points, (M,) px each."""
        if self.rasteriser == "exact":
            self.paint(_pressed(self.shape, np.asarray(points), np.asarray(widths)), colour)
        else:
            self.fill(_outline(np.asarray(points), np.asarray(widths)), colour)

    def text(self, words, at, colour, size=0.5, thick=1):
        share = np.zeros((*self.shape, 3), np.uint8)
        place = (round(at[0]), round(at[1]))
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(share, words, place, font, size, (255, 255, 255), thick, cv2.LINE_AA)
        self.paint(share[..., 0] / 255.0, colour)

    def image(self, quality=None):
        """(H, W, 3) uint8, after JPEG of a `quality`."""
        picture = to_uint8(self.picture)
        return jpeg(picture, quality) if quality else picture


def rectangle(centre, width, height):
    """(4, 2) corners."""
    half = np.array([width, height]) / 2
    return np.add(centre, half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))


def _agg(shape, points, closed, width, cap="round"):
    from matplotlib.backends.backend_agg import RendererAgg
    from matplotlib.path import Path
    from matplotlib.transforms import Affine2D

    height, columns = shape
    renderer = RendererAgg(columns, height, 72)
    pen = renderer.new_gc()
    pen.set_foreground((0, 0, 0, 1), isRGBA=True)
    pen.set_snap(False)
    pen.set_linewidth(width or 0.0)
    pen.set_capstyle(cap)
    pen.set_joinstyle("round")
    ring = np.vstack([points, points[:1]]) if closed else points
    codes = [Path.MOVETO] + [Path.LINETO] * (len(ring) - 1)
    if closed:
        codes[-1] = Path.CLOSEPOLY
    place = Affine2D().scale(1, -1).translate(0.5, height - 0.5)
    face = None if width else (0, 0, 0, 1)
    path = Path(ring, codes)
    path.should_simplify = False  # drops points up to a ninth of a pixel off
    renderer.draw_path(pen, path, place, face)
    return np.asarray(renderer.buffer_rgba())[..., 3] / 255.0


def _skia(shape, points, closed, width, cap="round"):
    import skia

    picture = np.zeros((*shape, 4), np.uint8)
    path = skia.PathBuilder() if hasattr(skia, "PathBuilder") else skia.Path()
    path.moveTo(*(points[0] + 0.5))
    for at in points[1:] + 0.5:
        path.lineTo(*at)
    if closed:
        path.close()
    path = path.detach() if hasattr(path, "detach") else path
    style = skia.Paint.kStroke_Style if width else skia.Paint.kFill_Style
    caps = {"round": "kRound_Cap", "butt": "kButt_Cap"}
    pen = skia.Paint(
        AntiAlias=True,
        Style=style,
        StrokeWidth=float(width or 0),
        StrokeCap=getattr(skia.Paint, caps[cap]),
        StrokeJoin=skia.Paint.kRound_Join,
        Color=skia.ColorBLACK,
    )
    with skia.Surface(picture) as canvas:
        canvas.drawPath(path, pen)
    return picture[..., 3] / 255.0


BY_LIBRARY = {"agg": _agg, "skia": _skia}


def _filled(shape, points):
    """By samples on a fine grid."""
    low = np.maximum(np.floor(points.min(0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(points.max(0)).astype(int) + 2, shape[::-1])
    share = np.zeros(shape)
    if (high <= low).any():
        return share
    size = (high - low) * FINE
    fine = np.zeros(size[::-1], np.uint8)
    at = np.rint(((points - low + 0.5) * FINE - 0.5) * 16).astype(np.int32)
    cv2.fillPoly(fine, [at], 1, shift=4)
    cut = fine.reshape(high[1] - low[1], FINE, high[0] - low[0], FINE).mean((1, 3))
    share[low[1] : high[1], low[0] : high[0]] = cut
    return share


def _pressed(shape, points, widths):
    length = arc_of(points)
    dense = polyline(points)
    at = np.linspace(0, length[-1], len(dense))
    radius = np.interp(at, length, widths) / 2
    share = np.zeros(shape)
    pixels, _, distance, index = samples_near(shape, dense, radius.max(), FINE)
    share[pixels] = (distance <= radius[index]).reshape(len(pixels[0]), -1).mean(1)
    return share


def _outline(points, widths):
    """Of a pen pressed along points: both sides and half a disc at either end."""
    tangent = np.gradient(points, axis=0)
    tangent /= np.hypot(*tangent.T)[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    half = widths[:, None] / 2
    turn = np.linspace(0, np.pi, 12)[1:-1, None]

    def cap(at, out, side, radius):
        return at + radius * (np.cos(turn) * side + np.sin(turn) * out)

    end = cap(points[-1], tangent[-1], normal[-1], half[-1])
    begin = cap(points[0], -tangent[0], -normal[0], half[0])
    return np.vstack([points + half * normal, end, (points - half * normal)[::-1], begin])
