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
from vfplan.engine.proxy import Status, Step
from vfplan.errors import SettingError

# Time after which a peer that still runs has failed [s], and so has building the shipped one.
TIMEOUT_S = 120.0

# Length of a peer's own message in an error.
QUOTED_CHARACTERS = 200


@dataclass(frozen=True)
class Peer:
    """An outside program.

    Parameters
    ----------
    command
        As a shell would split it; the folder is appended.
    """

    command: str

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
            raise SettingError(
                f"peer {self.command!r} is no program. Give one that can be run",
                code="no-such-peer",
            )

    def run(self, points: Array, hips: Array, settings: ProxyParameters) -> tuple[Array, Array]:
        """Proxies (T, 3) [m] and times (T,) [µs]; the settings' ignored axis counts.

        Raises
        ------
        SettingError
            The program failed, took longer than two minutes, or wrote something else.
        """
        flat = flattening(settings.ignore_axis)
        with tempfile.TemporaryDirectory(prefix="vfplan-peer-") as name:
            folder = Path(name)
            for file, rows in (("points.csv", points), ("path.csv", hips)):
                np.savetxt(folder / file, rows @ flat, "%.17g", ",", header="x,y,z", comments="")
            (folder / "settings.csv").write_text(settings_table(settings))
            self.call(folder)
            path = folder / "proxies.csv"
            try:
                table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
            except (OSError, ValueError) as error:
                raise SettingError(
                    f"peer {self.name!r}: proxies.csv: {error}. Let it write one row a tick",
                    code="peer-answer",
                ) from None
        if table.shape != (len(hips), 4) or not np.isfinite(table).all():
            raise SettingError(
                f"peer {self.name!r}: proxies.csv holds {table.shape} numbers. Let it write "
                f"({len(hips)}, 4) finite ones",
                code="peer-answer",
            )
        return table[:, :3] + hips @ (np.eye(3) - flat), table[:, 3]

    def call(self, folder: Path) -> None:
        """Run the program on a folder; raises `SettingError`."""
        try:
            done = subprocess.run(
                [*self._words, str(folder)], capture_output=True, text=True, timeout=TIMEOUT_S,
                check=False, env=os.environ | {"LC_ALL": "C"},
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise SettingError(
                f"peer {self.name!r} is not done in {TIMEOUT_S:g} s. Give a faster one",
                code="peer-slow",
            ) from None
        except OSError as error:
            raise SettingError(
                f"peer {self.command!r}: {error.strerror}. Give a program that runs",
                code="no-such-peer",
            ) from None
        if done.returncode:
            message = " ".join(done.stderr.split())[-QUOTED_CHARACTERS:] or "no message"
            raise SettingError(
                f"peer {self.name!r} ended with exit code {done.returncode}: {message}. "
                "Correct that program",
                code="peer-failed",
            )


def flattening(axis: Array | None) -> Array:
    """(3, 3) the map that presses space flat along an axis; the identity without one."""
    if axis is None:
        return np.eye(3)
    return np.eye(3) - np.outer(axis, axis)


def settings_table(parameters: ProxyParameters) -> str:
    """The content of `settings.csv`."""
    names = ("contact_radius", "band", "point_radius", "outer_radius")
    values: dict[str, float] = {name: getattr(parameters, name) for name in names}
    values |= {"stiffness": parameters.stiffness[0], "gain": parameters.gain}
    if parameters.ignore_axis is not None:
        values |= {
            f"ignore_axis_{k}": x for k, x in zip("xyz", parameters.ignore_axis, strict=True)
        }
    return "".join(["name,value\n", *(f"{name},{value:.17g}\n" for name, value in values.items())])


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
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SettingError(
                f"the nanoflann peer did not run: {error}. Run g++ by hand to see why",
                code="peer-not-built",
            ) from None
    if done.returncode:
        errors = [line.strip() for line in done.stderr.splitlines() if "error" in line]
        reason = errors[0] if errors else "no message"
        raise SettingError(
            f"the nanoflann peer did not compile: {reason}. Run apt install libnanoflann-dev",
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
        self._flat = flattening(self.parameters.ignore_axis)
        self._points = points @ self._flat
        self._tree = cKDTree(self._points)

    def reset(self, hip: Array) -> None:
        """Nothing to remember."""

    def step(self, hip: Array) -> Step:
        """One tick."""
        x = self._flat @ hip
        distance, i = self._tree.query(x)
        depth = self.parameters.R - distance
        normal = (x - self._points[i]) / distance if distance > 0 else np.zeros(3)
        push = normal * max(depth, 0.0)
        force = self.parameters.stiffness * push
        return Step(hip + push, normal, force, int(depth > 0), Status.OK)
