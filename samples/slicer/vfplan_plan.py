"""Plan a fixture from a curve that is drawn in 3D Slicer: run inside Slicer.

    Slicer --python-script vfplan_plan.py

The scene holds a Markups curve named `curve`, and the fiducial lists `markers` and `robot` (see
plan_words.py, which the project tests). It runs `vfplan plan`, and opens the sheet and the page of
the review. Nobody has run this file in Slicer yet.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import slicer

sys.path.insert(0, str(Path(__file__).resolve().parent))
from plan_words import plan_words

# Write the whole path if the program is not on Slicer's search path.
PROGRAM = "vfplan"


def plan(folder):
    """Save the three nodes, plan, and show what came of it."""
    files = []
    for name in ("curve", "markers", "robot"):
        file = str(Path(folder) / f"{name}.mrk.json")
        if not slicer.util.saveNode(slicer.util.getNode(name), file):
            raise OSError(f"{file} could not be written.")
        files.append(file)
    node = slicer.util.getNode("curve")
    curve_type = node.GetCurveTypeAsString(node.GetCurveType())
    words, bundle = plan_words(*files, folder, curve_type, PROGRAM)
    # Slicer's own libraries are of no use to a program outside it.
    environment = slicer.util.startupEnvironment()
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        slicer.util.errorDisplay(done.stderr or done.stdout)
        return
    show(bundle, files[0], environment)
    slicer.util.infoDisplay(done.stdout)


def show(bundle, curve, environment):
    """Open the sheet, and the page of `vfplan review` in the browser."""
    import qt

    sheet = bundle.with_name(f"{bundle.stem}-sheet.png")
    qt.QDesktopServices.openUrl(qt.QUrl.fromLocalFile(str(sheet)))
    approved = bundle.with_name("approved.h5")
    words = [PROGRAM, "review", str(bundle), "--slice", curve, "-o", str(approved)]
    subprocess.Popen(words, env=environment)


if __name__ == "__main__":
    plan(tempfile.mkdtemp(prefix="vfplan-"))
