"""Files as 3D Slicer writes them."""

from __future__ import annotations

import json


def mrk(points, **markup):
    controls = [
        {"id": str(i), "label": label, "position": xyz, "positionStatus": status}
        for i, (label, xyz, status) in enumerate(points)
    ]
    schema = "https://x/Schema/markups-schema-v1.0.3.json#"
    fiducial = {"type": "Fiducial", "controlPoints": controls, **markup}
    return json.dumps({"@schema": schema, "markups": [fiducial]})
