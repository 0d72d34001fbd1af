"""Vector curves as files."""

from __future__ import annotations

import numpy as np
from slicer_files import SCHEMA, mrk

__all__ = ["RING_MM", "SCHEMA", "polyline", "slicer"]

T = np.linspace(0, 2 * np.pi, 24, endpoint=False)
RING_MM = np.column_stack([10 * np.cos(T), 10 * np.sin(T), np.full(24, 5.0)])


def slicer(tmp_path, points_mm, kind="Curve", name="c.mrk.json", **more):
    points = [(f"C-{i}", p, "defined") for i, p in enumerate(np.asarray(points_mm).tolist())]
    path = tmp_path / name
    path.write_text(mrk(points, type=kind, **{"coordinateSystem": "LPS", **more}))
    return path


def polyline(tmp_path, points, name="c.csv"):
    path = tmp_path / name
    rows = "\n".join(f"{u},{v}" for u, v in points)
    path.write_text(f"u_px,v_px\n{rows}\n")
    return path
