"""Outlines of a bone on slices 4 mm apart, markers around it, and places a robot touched.

    python samples/make_bone.py

Writes `bone.mrk.json` (a Slicer closed curve a slice), `bone_markers.mrk.json`, `bone_robot.csv`
and `bone_touched.csv` into the current folder. The bone is a bent ellipsoid of 36 x 28 x 90 mm. The
robot measures the markers to 0.4 mm an axis, and the touched places to 0.1 mm.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/"
    "Resources/Schema/markups-schema-v1.0.3.json#"
)
HALF_AXES_MM = np.array([18.0, 14.0, 45.0])
"""Half axes of the ellipsoid [mm]."""
SLICE_HEIGHTS_MM = np.arange(-36, 37, 4.0)
"""Heights of the slices [mm]."""
MARKERS_MM = np.array([[38, 0, -30], [-30, 25, -10], [10, 35, 40], [-25, -30, 36], [34, -22, 8.0]])
"""Places of the markers in the patient's frame [mm]."""
YAW_RAD = 0.4
"""Turn of the robot's frame about the patient's z axis [rad]."""
ORIGIN_M = np.array([0.5, 0.1, 0.3])
"""Origin of the patient's frame in the robot's [m]."""


def bone_points(angle, z):
    """(M, 3) points of the bone [mm], at an angle around it [rad] and a height [mm]."""
    width = np.sqrt(1 - (z / HALF_AXES_MM[2]) ** 2)
    x = 8 * (z / 40) ** 2 + HALF_AXES_MM[0] * width * np.cos(angle)
    y = HALF_AXES_MM[1] * width * np.sin(angle)
    return np.column_stack([x, y, np.broadcast_to(z, x.shape)])


def robot_from_patient(points):
    """Points of the patient's frame [mm] in the robot's [m]."""
    c = np.cos(YAW_RAD)
    s = np.sin(YAW_RAD)
    return 1e-3 * points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + ORIGIN_M


def markup(kind, points, label=""):
    """A Slicer markup; its points are named by the label and a number, if a label is given."""
    controls = []
    for number, point in enumerate(points, start=1):
        name = ""
        if label:
            name = f"{label}{number}"
        controls.append({"id": str(number), "label": name, "position": point.tolist()})
    return {
        "type": kind,
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "controlPoints": controls,
    }


def write_markups(path, markups):
    """Write a file of Slicer markups."""
    Path(path).write_text(json.dumps({"@schema": SCHEMA, "markups": markups}, indent=1))


def write_table(path, header, rows):
    """Write a table of text."""
    Path(path).write_text("\n".join([header, *rows]) + "\n")


def main():
    """Write the four files into the current folder."""
    rng = np.random.default_rng(2)

    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    outlines = []
    for height in SLICE_HEIGHTS_MM:
        outlines.append(markup("ClosedCurve", bone_points(angles, height)))
    write_markups("bone.mrk.json", outlines)
    write_markups("bone_markers.mrk.json", [markup("Fiducial", MARKERS_MM, label="m")])

    measured = robot_from_patient(MARKERS_MM) + rng.normal(0, 4e-4, MARKERS_MM.shape)
    rows = []
    for number, (x, y, z) in enumerate(measured, start=1):
        rows.append(f"m{number},{x:.6f},{y:.6f},{z:.6f}")
    write_table("bone_robot.csv", "label,x_m,y_m,z_m", rows)

    places = bone_points(rng.uniform(0, 2 * np.pi, 80), rng.uniform(-34, 34, 80))
    touched = robot_from_patient(places) + rng.normal(0, 1e-4, places.shape)
    rows = []
    for x, y, z in touched:
        rows.append(f"{x:.6f},{y:.6f},{z:.6f}")
    write_table("bone_touched.csv", "x_m,y_m,z_m", rows)


if __name__ == "__main__":
    main()
