"""Outlines of a bone on slices 4 mm apart, markers around it, and places a robot touched.

    python samples/make_bone.py

Writes `bone.mrk.json` (a Slicer closed curve a slice), `bone_markers.mrk.json`, `bone_robot.csv`
and `bone_touched.csv` into the current folder. The bone is a bent ellipsoid of 36 x 28 x 90 mm; the
robot's markers are off by 0.4 mm an axis, its touches by 0.1 mm.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

SCHEMA = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/"
SCHEMA += "Resources/Schema/markups-schema-v1.0.3.json#"
HALVES = np.array([18.0, 14.0, 45.0])
"""Half axes of the ellipsoid [mm]."""
PLACES = np.arange(-36, 37, 4.0)
"""Heights of the slices [mm]."""
MARKS = np.array([[38, 0, -30], [-30, 25, -10], [10, 35, 40], [-25, -30, 36], [34, -22, 8.0]])
TURN = 0.4
"""Turn of the robot's frame about the patient's z axis [rad]."""
SHIFT = np.array([0.5, 0.1, 0.3])
"""Origin of the patient's frame in the robot's [m]."""


def bone(angle, z):
    """(M, 3) places on the bone at an angle round it and a height [mm]."""
    size = np.sqrt(1 - (z / HALVES[2]) ** 2)
    x = 8 * (z / 40) ** 2 + HALVES[0] * size * np.cos(angle)
    return np.column_stack([x, HALVES[1] * size * np.sin(angle), np.broadcast_to(z, x.shape)])


def robot(points):
    """The patient's millimetres in the robot's metres."""
    c = np.cos(TURN)
    s = np.sin(TURN)
    return 1e-3 * points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + SHIFT


def markup(kind, points, names=None):
    controls = [
        {"id": str(k), "label": f"m{k}" if names else "", "position": p.tolist()}
        for k, p in enumerate(points, 1)
    ]
    return {"type": kind, "coordinateSystem": "LPS", "coordinateUnits": "mm",
            "controlPoints": controls}  # fmt: skip


def write_markups(path, markups):
    Path(path).write_text(json.dumps({"@schema": SCHEMA, "markups": markups}, indent=1))


def write_table(path, header, rows):
    Path(path).write_text("\n".join([header, *rows]) + "\n")


if __name__ == "__main__":
    rng = np.random.default_rng(2)
    around = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    write_markups("bone.mrk.json", [markup("ClosedCurve", bone(around, z)) for z in PLACES])
    write_markups("bone_markers.mrk.json", [markup("Fiducial", MARKS, names=True)])
    seen = robot(MARKS) + rng.normal(0, 4e-4, MARKS.shape)
    rows = [f"m{k},{x:.6f},{y:.6f},{z:.6f}" for k, (x, y, z) in enumerate(seen, 1)]
    write_table("bone_robot.csv", "label,x_m,y_m,z_m", rows)
    places = bone(rng.uniform(0, 2 * np.pi, 80), rng.uniform(-34, 34, 80))
    felt = robot(places) + rng.normal(0, 1e-4, places.shape)
    write_table("bone_touched.csv", "x_m,y_m,z_m", [f"{x:.6f},{y:.6f},{z:.6f}" for x, y, z in felt])
