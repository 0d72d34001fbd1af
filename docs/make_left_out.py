"""Print what five scenes do without: `python docs/make_left_out.py`.

The table of docs/engine.md. Each scene is planned or imported by its command, in a process of its
own. Of it are listed: libraries that were not imported, groups that the bundle does not have, parts
of the engine's work that were left out, and what memory the engine takes.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from importlib.resources import as_file, files
from pathlib import Path

import h5py
import numpy as np
from accuracy_tables import table

import vfplan
from vfplan.bench.proxy import BoxMesh

LIBRARIES = ("scipy", "skimage", "matplotlib", "pydicom", "cryptography", "pyvista", "cv2", "PIL")
GROUPS = (
    "curve", "pieces", "mesh", "image", "registration", "guidance", "rendering/stability", "review"
)  # fmt: skip
RUN = """
import atexit, json, sys
atexit.register(
    lambda: print(json.dumps([name for name in {libraries} if name not in sys.modules]))
)
from vfplan.cli.main import cli
cli()
"""


def write_inputs(folder: Path) -> None:
    """A curve of points, a cloud in space, and a box of triangles."""
    s = np.linspace(0, 0.1, 201)
    curve = np.column_stack([s, 0.02 * np.sin(40 * s), 0 * s])
    np.savetxt(folder / "curve.csv", curve, delimiter=",", header="x,y,z", comments="")
    np.savetxt(folder / "cloud.csv", vfplan.scenes.Sphere(spacing=1e-3).points, delimiter=",",
               header="x,y,z", comments="")  # fmt: skip
    corners, triangles = BoxMesh().mesh
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    (folder / "box.obj").write_text("\n".join(lines) + "\n")


def make() -> str:
    """The table in Markdown."""
    rows = []
    with tempfile.TemporaryDirectory() as name, as_file(files("vfplan.samples")) as sample:
        folder = Path(name)
        write_inputs(folder)
        inputs = ["elbow.png", "elbow_markers_image.csv", "elbow_markers_robot.csv"]
        plan = ["plan", *(str(sample / file) for file in inputs), "--no-sheet"]
        unit = ["--units", "m", "--frame", "robot_base"]
        scenes = {
            "drawn curve": plan,
            "drawn curve, for a robot": [*plan, "--robot", "franka"],
            "curve of points": ["import", "curve.csv", *unit, "--ignore-axis", "z"],
            "cloud in space": ["import", "cloud.csv", *unit],
            "box of triangles": ["import", "box.obj", *unit],
        }
        for scene, command in scenes.items():
            run = [sys.executable, "-c", RUN.format(libraries=LIBRARIES), *command, "-o", "out.h5",
                   "--overwrite"]  # fmt: skip
            done = subprocess.run(run, cwd=folder, capture_output=True, text=True)
            if done.returncode:
                sys.exit(f"{scene}: {done.stderr}")
            unused = json.loads(done.stdout.splitlines()[-1])
            with h5py.File(folder / "out.h5") as bundle:
                absent = [group for group in GROUPS if group not in bundle]
            engine = vfplan.ProxyEngine.of(vfplan.read_fixture(folder / "out.h5"))
            memory = f"{engine.native.bytes / 1e3:.3g} kB"
            lists = [", ".join(names) for names in (unused, absent, engine.left_out)]
            rows.append([scene, engine.rule, *lists, memory])
    head = ["scene", "rule", "not imported", "not in the bundle", "not in a tick", "engine holds"]
    return table(head, rows)


if __name__ == "__main__":
    print(make())
