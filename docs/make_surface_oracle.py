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

from vfplan.registration.touch import NearestOnMesh
from vfplan.surface.build import SurfaceSettings, surface

GAP_MM = 3.0
"""Distance between slices [mm]."""
PIXEL_MM = 0.1
"""Size of a pixel [mm]."""
HALF_SIDE_MM = 40.0
"""Half of a slice's side [mm]."""


def borders(program: str, path: Path, bone: bones.Bone) -> NDArray:
    """(M, 3) middles of the edges between plastimatch's voxels inside and outside [mm]."""
    heights_mm = bone.places(GAP_MM)
    n = round(2 * HALF_SIDE_MM / PIXEL_MM)
    origin_mm = [-HALF_SIDE_MM, -HALF_SIDE_MM, heights_mm[0]]
    spacing_mm = [PIXEL_MM, PIXEL_MM, GAP_MM]
    masks = path.parent / "masks"
    command = [program, "convert", "--input", path, "--output-prefix", masks]
    command += ["--prefix-format", "nrrd", "--origin", " ".join(map(str, origin_mm))]
    command += ["--dim", f"{n} {n} {len(heights_mm)}"]
    command += ["--spacing", " ".join(map(str, spacing_mm))]
    subprocess.run(command, check=True, capture_output=True)
    is_inside = nrrd.read(str(next(masks.glob("*.nrrd"))))[0] != 0
    edges = []
    for axis in (0, 1):
        index = np.argwhere(np.diff(is_inside, axis=axis)).astype(float)
        index[:, axis] += 0.5
        edges.append(index * spacing_mm + origin_mm)
    return np.concatenate(edges)


def compared(program: str, bone: bones.Bone) -> NDArray:
    """(M,) distances [mm] of plastimatch's borders from the surface."""
    with tempfile.TemporaryDirectory() as folder:
        path = bones.write_rtstruct(Path(folder) / "s.dcm", bones.outlines(bone, GAP_MM))
        places = borders(program, path, bone)
        fixture = surface(path, settings=SurfaceSettings(tolerance_m=4e-4)).fixture
    nearest, _ = NearestOnMesh(fixture.points, fixture.mesh)(1e-3 * places)
    return 1e3 * np.linalg.norm(1e-3 * places - nearest, axis=1)


def main(words: list[str]) -> None:
    """Print the table."""
    program = "plastimatch"
    if words:
        program = words[0]
    for name in ("BENT", "TUNNEL", "BRANCHES"):
        distance = compared(program, getattr(bones, name))
        rms = np.sqrt((distance**2).mean())
        print(f"| {name.lower()} | {len(distance)} | {rms:.3f} mm | {distance.max():.3f} mm |")


if __name__ == "__main__":
    main(sys.argv[1:])
