"""Vector curves as files."""

from __future__ import annotations

import json

import numpy as np

SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/"
    "Schema/markups-schema-v1.0.3.json#"
)


T = np.linspace(0, 2 * np.pi, 24, endpoint=False)


RING_MM = np.column_stack([10 * np.cos(T), 10 * np.sin(T), np.full(24, 5.0)])


def slicer(tmp_path, points_mm, kind="Curve", name="c.mrk.json", **more):
    points = [
        {"id": str(i), "label": f"C-{i}", "position": list(p), "positionStatus": "defined"}
        for i, p in enumerate(np.asarray(points_mm).tolist())
    ]
    markup = {"type": kind, "coordinateSystem": "LPS", "controlPoints": points, **more}
    path = tmp_path / name
    path.write_text(json.dumps({"@schema": SCHEMA, "markups": [markup]}))
    return path


def polyline(tmp_path, points, name="c.csv"):
    path = tmp_path / name
    rows = "\n".join(f"{u},{v}" for u, v in points)
    path.write_text(f"u_px,v_px\n{rows}\n")
    return path
