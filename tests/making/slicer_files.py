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
