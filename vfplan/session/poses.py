"""A tracker's poses as CSV: t,x,y,z,qw,qx,qy,qz, and `arrived` where they came later."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vfplan.errors import SessionError
from vfplan.io.reading import OneFile
from vfplan.session.csvfile import csv_columns, read_csv
from vfplan.session.types import Array

WANTED = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")
LARGEST_M = 1e6  # of a place; what the engine takes


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of a fixture's frame in the session's."""

    time: Array  # (n,) when the tracker looked [s], on the session's clock
    pose: Array  # (n, 7) place [m] and unit quaternion w x y z
    arrived: Array  # (n,) when the loop had it [s], never decreasing


def read_poses(path: str | Path) -> Poses:
    """Read a CSV of poses; raises `SessionError` for one that is none."""
    name = str(path)
    file = OneFile(Path(path), SessionError)
    with file.view() as stream:
        late = "arrived" in csv_columns(stream, name, WANTED)
    wanted = (*WANTED, "arrived") if late else WANTED
    pieces = list(read_csv(file, name, 1.0, wanted))
    time = np.concatenate([piece[0] for piece in pieces] or [np.empty(0)])
    rows = np.concatenate([piece[1] for piece in pieces] or [np.empty((0, len(wanted) - 1))])
    arrived = rows[:, 7] if late else time
    _check(time, rows[:, :7], arrived, name)
    return Poses(time, rows[:, :7].copy(), arrived)


def _check(time: Array, pose: Array, arrived: Array, name: str) -> None:
    if not len(time):
        raise SessionError("holds no pose", where=name)
    rigid = np.abs(np.linalg.norm(pose[:, 3:], axis=1) - 1) < 1e-3
    good = np.isfinite(np.column_stack((time, pose, arrived))).all(axis=1) & rigid
    good &= np.abs(pose[:, :3]).max(axis=1) <= LARGEST_M
    good[1:] &= np.diff(arrived) >= 0
    if not good.all():
        i = int(np.argmin(good))
        raise SessionError(
            f"pose {i + 1}, {pose[i].tolist()} at {time[i]} s, arrived {arrived[i]} s: finite "
            "numbers, a place within 1e6 m, a unit quaternion and times of arrival in order wanted",
            where=name,
        )
