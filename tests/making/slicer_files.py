"""Files as 3D Slicer writes them."""

from __future__ import annotations

import json

SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/"
    "Schema/markups-schema-v1.0.3.json#"
)


def mrk(points, **markup):
    controls = [
        {"id": str(i), "label": label, "position": xyz, "positionStatus": status}
        for i, (label, xyz, status) in enumerate(points)
    ]
    fiducial = {"type": "Fiducial", "controlPoints": controls, **markup}
    return json.dumps({"@schema": SCHEMA, "markups": [fiducial]})


def marker_files(folder, labels, patient_mm, robot_m):
    """(Slicer's file, the robot's table) of markers in the patient and in front of the robot."""
    source, target = folder / "patient.mrk.json", folder / "robot.csv"
    points = [(label, place, "defined")
              for label, place in zip(labels, patient_mm.tolist(), strict=True)]  # fmt: skip
    source.write_text(mrk(points, coordinateSystem="LPS", coordinateUnits="mm"))
    rows = [f"{label},{x!r},{y!r},{z!r}"
            for label, (x, y, z) in zip(labels, robot_m.tolist(), strict=True)]  # fmt: skip
    target.write_text("\n".join(["label,x_m,y_m,z_m", *rows]) + "\n")
    return source, target
