"""What a user would pick instead: outside programs in the same run.

An outside program, a *peer*, is anything that reads points and a path and writes proxies. It is
called as

    CMD FOLDER

FOLDER holds `points.csv` (a header `x,y,z`, metres), `path.csv` (the same; one HIP a tick), on a
scene of triangles `corners.csv` and `triangles.csv` (a header `a,b,c`, rows of corners), and
`settings.csv` (a header `name,value`; the names contact_radius, band, point_radius, outer_radius,
stiffness, gain). The program sets itself up, starts with the proxy at the first HIP, and writes
`proxies.csv` with a header `x,y,z,us`: after each tick the proxy [m] and the time the tick took
[µs]. Cloud and path of a planar scene are pressed flat along its axis before the peer sees them, so
that a program made for space gets the same answer.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.resources import as_file, files
from importlib.util import find_spec
from pathlib import Path
from shutil import which

import numpy as np
from numpy.typing import NDArray

from vfplan.bench.record import Array
from vfplan.engine.parameters import ProxyParameters
from vfplan.errors import SettingError
from vfplan.geometry.lines import flattened

Mesh = tuple[Array, NDArray[np.int32]]

# Time after which a peer that still runs has failed [s].
TIMEOUT_S = 120.0


@dataclass(frozen=True)
class Peer:
    """An outside program.

    Parameters
    ----------
    command
        As a shell would split it; the folder is appended.
    title
        What the tables call it; by default the program's file name.
    needs_mesh
        It runs on scenes of triangles alone.
    """

    command: str
    title: str = ""
    needs_mesh: bool = False

    @property
    def name(self) -> str:
        """What the tables call it."""
        return self.title or Path(shlex.split(self.command)[0]).stem

    def check(self) -> None:
        """Raise `SettingError` when the program cannot be started at all."""
        if not self.command.strip() or which(shlex.split(self.command)[0]) is None:
            raise SettingError(
                f"peer {self.command!r} is no program. Give one that can be run",
                code="no-such-peer",
            )

    def run(
        self, points: Array, hips: Array, settings: ProxyParameters, mesh: Mesh | None = None
    ) -> tuple[Array, Array]:
        """Proxies (T, 3) [m] and times (T,) [µs]; the settings' ignored axis counts.

        Raises
        ------
        SettingError
            The program failed, took longer than two minutes, or wrote something else.
        """
        flat_hips = flattened(hips, settings.ignore_axis)
        names = ("contact_radius", "band", "point_radius", "outer_radius", "gain")
        numbers = {name: getattr(settings, name) for name in names}
        numbers["stiffness"] = settings.stiffness[0]
        flat_points = flattened(points, settings.ignore_axis)
        tables = {"path": ("x,y,z", flat_hips), "points": ("x,y,z", flat_points)}
        if mesh is not None:
            tables |= {"corners": ("x,y,z", mesh[0]), "triangles": ("a,b,c", mesh[1])}
        with tempfile.TemporaryDirectory(prefix="vfplan-peer-") as name:
            folder = Path(name)
            for file, (header, rows) in tables.items():
                np.savetxt(folder / f"{file}.csv", rows, "%.17g", ",", header=header, comments="")
            lines = ["name,value", *(f"{name},{value:.17g}" for name, value in numbers.items())]
            (folder / "settings.csv").write_text("\n".join(lines) + "\n")
            self.call(folder)
            try:
                table = np.loadtxt(folder / "proxies.csv", delimiter=",", skiprows=1, ndmin=2)
                is_sound = table.shape == (len(hips), 4) and np.isfinite(table).all()
                found = f"holds {table.shape} numbers"
            except (OSError, ValueError) as error:
                is_sound, found = False, str(error)
        if not is_sound:
            raise SettingError(
                f"peer {self.name!r}: proxies.csv {found}. Let it write ({len(hips)}, 4) finite "
                "ones",
                code="peer-answer",
            )
        return table[:, :3] + (hips - flat_hips), table[:, 3]

    def call(self, folder: Path) -> None:
        """Run the program on a folder; raises `SettingError`."""
        command = [*shlex.split(self.command), str(folder)]
        how = {"capture_output": True, "text": True, "env": os.environ | {"LC_ALL": "C"}}
        try:
            subprocess.run(command, check=True, timeout=TIMEOUT_S, **how)
        except subprocess.TimeoutExpired:
            raise SettingError(
                f"peer {self.name!r} is not done in {TIMEOUT_S:g} s. Give a faster one",
                code="peer-slow",
            ) from None
        except (OSError, subprocess.SubprocessError) as error:
            said = " ".join(str(getattr(error, "stderr", None) or "").split())[-200:]
            raise SettingError(
                f"peer {self.name!r} failed: {error} {said}. Correct that program",
                code="peer-failed",
            ) from None


def build_nanoflann(folder: Path) -> Peer:
    """Compile the shipped peer, the paper's rule on nanoflann's tree, into `folder`.

    Raises SettingError: there is no compiler or no nanoflann here, or it does not compile; the
        message says what to install
    """
    compiler = which(os.environ.get("CXX", "g++")) or which("clang++")
    if compiler is None:
        raise SettingError(
            "the nanoflann peer did not run, because there is no C++ compiler. Run apt install g++",
            code="no-compiler",
        )
    program = folder / "nanoflann_peer"
    with as_file(files("vfplan.samples") / "peer" / "nanoflann_peer.cpp") as source:
        command = [compiler, "-std=c++20", "-O3", "-o", str(program), str(source)]
        try:
            subprocess.run(command, capture_output=True, text=True, check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            said = getattr(error, "stderr", None) or str(error)
            reason = next((line for line in said.splitlines() if "error" in line), said).strip()
            raise SettingError(
                f"the nanoflann peer did not compile: {reason}. Run apt install g++ "
                "libnanoflann-dev",
                code="peer-not-built",
            ) from None
    return Peer(shlex.quote(str(program)))


# Libraries that find the nearest place on a mesh, by the module that Python imports.
MESH_LIBRARIES = {"igl": "libigl", "coal": "coal", "open3d": "Open3D"}


def mesh_peers() -> list[Peer]:
    """A penalty force from the nearest place on a mesh, by each library that is installed."""
    program = files("vfplan.samples") / "peer" / "mesh_peer.py"
    command = f"{shlex.quote(sys.executable)} {shlex.quote(str(program))}"
    return [
        Peer(f"{command} {module}", f"penalty by {library}", needs_mesh=True)
        for module, library in MESH_LIBRARIES.items()
        if find_spec(module) is not None
    ]
