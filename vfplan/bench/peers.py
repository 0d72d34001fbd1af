"""What a user would pick instead: outside programs in the same run, and a penalty force.

An outside program is anything that reads points and a path and writes proxies.

A peer is called as

    CMD FOLDER

FOLDER holds `points.csv` (a header `x,y,z`, metres), `path.csv` (the same; one HIP a tick) and
`settings.csv` (a header `name,value`; the names contact_radius, band, point_radius, outer_radius,
stiffness, gain, and for a planar scene ignore_axis_x, ignore_axis_y and ignore_axis_z). The program
sets itself up, starts with the proxy at the first HIP, and writes `proxies.csv` with a header
`x,y,z,us`: after each tick the proxy [m] and the time the tick took [µs]. Cloud and path of a
planar scene are pressed flat along its axis before the peer sees them, so that a program made for
space gets the same answer.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import tempfile
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np

from vfplan.bench.record import Array
from vfplan.engine.parameters import ProxyParameters
from vfplan.engine.ticks import Status, Step
from vfplan.errors import SettingError

TIMEOUT_S = 120.0


@dataclass(frozen=True)
class Peer:
    """An outside program."""

    command: str  # as a shell would split it; the folder is appended

    @property
    def name(self) -> str:
        """The program's file name."""
        return Path(self._words[0]).stem

    @property
    def _words(self) -> list[str]:
        return shlex.split(self.command)

    def check(self) -> None:
        """Raise `SettingError` when the program cannot be started at all."""
        if not self.command.strip() or which(self._words[0]) is None:
            raise SettingError(f"peer {self.command!r}: no such program")

    def run(self, points: Array, hips: Array, settings: ProxyParameters) -> tuple[Array, Array]:
        """Proxies (T, 3) [m] and times (T,) [µs]; the settings' ignored axis is honoured.

        Raises SettingError: the program failed, took longer than two minutes, or wrote something
            else
        """
        axis = settings.ignore_axis
        flat = np.eye(3) if axis is None else np.eye(3) - np.outer(axis, axis)
        with tempfile.TemporaryDirectory(prefix="vfplan-peer-") as name:
            folder = Path(name)
            _write(folder / "points.csv", points @ flat)
            _write(folder / "path.csv", hips @ flat)
            (folder / "settings.csv").write_text(_settings(settings))
            self._call(folder)
            table = self._read(folder / "proxies.csv", len(hips))
        return table[:, :3] + hips @ (np.eye(3) - flat), table[:, 3]

    def _call(self, folder: Path) -> None:
        try:
            done = subprocess.run(
                [*self._words, str(folder)],
                capture_output=True,
                text=True,
                timeout=TIMEOUT_S,
                check=False,
                env=os.environ | {"LC_ALL": "C"},
            )
        except subprocess.TimeoutExpired:
            raise SettingError(f"peer {self.name!r}: not done in {TIMEOUT_S:g} s") from None
        except OSError as error:
            raise SettingError(f"peer {self.command!r}: {error.strerror}") from None
        if done.returncode:
            said = " ".join(done.stderr.split())[-200:] or "no message"
            raise SettingError(f"peer {self.name!r}: exit code {done.returncode}: {said}")

    def _read(self, path: Path, ticks: int) -> Array:
        try:
            table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
        except (OSError, ValueError) as error:
            raise SettingError(f"peer {self.name!r}: proxies.csv: {error}") from None
        if table.shape != (ticks, 4) or not np.isfinite(table).all():
            raise SettingError(
                f"peer {self.name!r}: proxies.csv holds {table.shape} numbers; "
                f"({ticks}, 4) finite ones are wanted"
            )
        return table


def _write(path: Path, rows: Array) -> None:
    np.savetxt(path, rows, delimiter=",", header="x,y,z", comments="", fmt="%.17g")


def _settings(par: ProxyParameters) -> str:
    values: dict[str, Any] = {
        "contact_radius": par.rc,
        "band": par.band,
        "point_radius": par.rv,
        "outer_radius": par.r3,
        "stiffness": par.stiffness[0],
        "gain": par.xi,
    }
    if par.ignore_axis is not None:
        values |= {f"ignore_axis_{k}": a for k, a in zip("xyz", par.ignore_axis, strict=True)}
    return "name,value\n" + "".join(f"{k},{v:.17g}\n" for k, v in values.items())


BUILD_S = 120.0  # after which building the shipped peer is given up


def build_nanoflann(folder: Path) -> Peer:
    """Compile the shipped peer, the paper's rule on nanoflann's tree, into `folder`.

    Raises SettingError: there is no compiler or no nanoflann here, or it does not compile; the
        message says what to install
    """
    compiler = which(os.environ.get("CXX", "g++")) or which("clang++")
    if compiler is None:
        raise SettingError(
            "the nanoflann peer did not run: no C++ compiler (apt install g++)", code="no-compiler"
        )
    program = folder / "nanoflann_peer"
    with as_file(files("vfplan.samples") / "peer" / "nanoflann_peer.cpp") as source:
        command = [compiler, "-std=c++20", "-O3", "-o", str(program), str(source)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=BUILD_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SettingError(
                f"the nanoflann peer did not run: {error}", code="peer-not-built"
            ) from None
    if done.returncode:
        first = next((line for line in done.stderr.splitlines() if "error" in line), "")
        raise SettingError(
            f"the nanoflann peer did not compile: {first.strip()} (apt install libnanoflann-dev)",
            code="peer-not-built",
        )
    return Peer(shlex.quote(str(program)))


class NearestPointPenalty:
    """A vector field: pushed out of the ball of radius R around the nearest point, no memory.

    The "proxy" of a penalty force F = K (R - |x|) x/|x| is where that force would be zero. Once the
    HIP is past the cloud it is pushed out on the other side.

    points: (N, 3) [m]
    parameters: as for `ProxyEngine`
    """

    def __init__(self, points: Array, **parameters: Any) -> None:
        from scipy.spatial import cKDTree

        self.parameters = ProxyParameters.make(points, rule="paper", **parameters)
        axis = self.parameters.ignore_axis
        self._flat = np.eye(3) if axis is None else np.eye(3) - np.outer(axis, axis)
        self._points = points @ self._flat
        self._tree = cKDTree(self._points)

    def reset(self, hip: Array) -> None:
        """Nothing to remember."""

    def step(self, hip: Array) -> Step:
        """One tick."""
        x = self._flat @ hip
        distance, i = self._tree.query(x)
        away = x - self._points[i]
        short = self.parameters.R - distance
        normal = away / distance if distance > 0 else np.zeros(3)
        push = normal * max(short, 0.0)
        force = self.parameters.stiffness * push
        return Step(hip + push, normal, force, 1 if short > 0 else 0, Status.OK)
