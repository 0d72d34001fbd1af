"""From files of 3D Slicer's Markups to the words of `vfplan plan`, without Slicer.

The curve and the list of the markers lie in the patient. The list of the robot holds the places at
which the robot's tip touched the same markers, in the frame of its base and under the same labels.
As in the files of `vfplan export`, the robot's axes take the place of LPS.
"""

import csv
import json
import math
from pathlib import Path


def read_robot_list(path):
    """The places [m] of a fiducial list of the robot, by label."""
    markups = json.loads(Path(path).read_text(encoding="utf-8"))["markups"]
    if len(markups) != 1 or markups[0]["type"] != "Fiducial":
        raise ValueError(f"{path} is no single fiducial list. Choose one.")
    markup = markups[0]
    unit, system = markup.get("coordinateUnits", "mm"), markup.get("coordinateSystem", "LPS")
    if (unit if isinstance(unit, str) else unit[0]) != "mm" or system not in ("LPS", "RAS"):
        raise ValueError(
            f"{path} has the unit {unit} and the axes {system}. Save it in mm and LPS."
        )
    sign = -1 if system == "RAS" else 1
    places = {}
    for point in markup["controlPoints"]:
        if point.get("positionStatus", "defined") != "defined":
            continue
        x, y, z = point["position"]
        if point["label"] in places or not all(map(math.isfinite, (x, y, z))):
            raise ValueError(f"{path}: the point {point['label']} is there twice, or is no place.")
        places[point["label"]] = (sign * x / 1000, sign * y / 1000, z / 1000)
    return places


def plan_words(curve, markers, robot_list, folder, curve_type="spline", program="vfplan"):
    """Write the robot's list as a table in the folder; returns the words and the bundle's path.

    curve_type: as Slicer's curve node calls it; vfplan knows "spline" and "linear"
    """
    if curve_type not in ("spline", "linear"):
        raise ValueError(f"the curve is of type {curve_type}. Make it a spline or linear.")
    folder = Path(folder)
    table, bundle = folder / "robot.csv", folder / "plan.h5"
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["label", "x_m", "y_m", "z_m"])
        for label, place in read_robot_list(robot_list).items():
            writer.writerow([label, *map(repr, place)])
    words = [program, "plan", curve, markers, table, "--model", "rigid"]
    words += ["--curve-type", curve_type, "-o", bundle]
    return [str(word) for word in words], bundle
