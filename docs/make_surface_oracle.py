"""Print a table of docs/surface.md:  python docs/make_surface_oracle.py [PLASTIMATCH]

The same RTSTRUCT by `vfplan surface` and by plastimatch (`pip install plastimatch`), which fills
the outlines into voxels of its own making: how far the border of its voxels on each slice is from
the surface, but for the caps.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "making"))

import bones
import nrrd

from vfplan.registration.nearest import NearestOnMesh
from vfplan.surface import SurfaceSettings, surface

GAP = 3.0
"""Between slices [mm]."""
PIXEL = 0.1
"""Size of a pixel [mm]."""
SIDE = 40.0  # mm, half of the slices'


def borders(program: str, path: Path, bone: bones.Bone) -> NDArray:
    """(M, 3) middles of the edges between plastimatch's voxels inside and outside [mm]."""
    places, n = bone.places(GAP), round(2 * SIDE / PIXEL)
    subprocess.run(
        [program, "convert", "--input", path, "--output-prefix", path.parent / "masks",
         "--prefix-format", "nrrd", "--origin", f"{-SIDE} {-SIDE} {places[0]}",
         "--dim", f"{n} {n} {len(places)}", "--spacing", f"{PIXEL} {PIXEL} {GAP}"],
        check=True, capture_output=True,
    )  # fmt: skip
    inside = nrrd.read(str(next((path.parent / "masks").glob("*.nrrd"))))[0] != 0
    found = []
    for axis in (0, 1):
        index = np.argwhere(np.diff(inside, axis=axis)).astype(float)
        index[:, axis] += 0.5
        found.append(index * [PIXEL, PIXEL, GAP] + [-SIDE, -SIDE, places[0]])
    return np.concatenate(found)


def compared(program: str, bone: bones.Bone) -> NDArray:
    """(M,) distances [mm] of plastimatch's borders from the surface."""
    with tempfile.TemporaryDirectory() as folder:
        path = bones.write_rtstruct(Path(folder) / "s.dcm", bones.outlines(bone, GAP))
        places = borders(program, path, bone)
        made = surface(path, settings=SurfaceSettings(tolerance_m=4e-4)).fixture
    nearest, _ = NearestOnMesh(made.points, made.mesh)(1e-3 * places)
    return 1e3 * np.linalg.norm(1e-3 * places - nearest, axis=1)


if __name__ == "__main__":
    for NAME in ("BENT", "TUNNEL", "BRANCHES"):
        AWAY = compared((sys.argv[1:] or ["plastimatch"])[0], getattr(bones, NAME))
        RMS = np.sqrt((AWAY**2).mean())
        print(f"| {NAME.lower()} | {len(AWAY)} | {RMS:.3f} mm | {AWAY.max():.3f} mm |")
