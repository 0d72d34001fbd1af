"""A tracker's poses as CSV: t,x,y,z,qw,qx,qy,qz, and `arrived` where they came later."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vfplan.engine.parameters import MAX_COORDINATE
from vfplan.errors import SessionError
from vfplan.geometry import UNIT_ROUNDED
from vfplan.io.files import OpenedFile
from vfplan.io.table import open_number_table
from vfplan.session.session import Array

POSE_COLUMNS = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of a fixture's frame in the session's frame."""

    # (n,) when the tracker looked [s], on the session's clock
    time: Array
    # (n, 7) place [m] and unit quaternion w x y z
    pose: Array
    # (n,) when the control loop had it [s], never decreasing
    arrived: Array


def read_poses(path: str | Path) -> Poses:
    """Read a CSV of poses.

    Raises SessionError: the file is no such table, or a pose in it is not one
    """
    file = OpenedFile(Path(path), SessionError)
    table = open_number_table(file.view, str(path), SessionError, POSE_COLUMNS)
    columns = (*POSE_COLUMNS, "arrived") if "arrived" in table.columns else POSE_COLUMNS
    blocks = list(table.blocks(columns))
    if not blocks:
        raise SessionError("holds no pose. Give at least one", where=str(path), code="poses-empty")
    rows = np.concatenate(blocks)
    time = rows[:, 0].copy()
    pose = rows[:, 1:8].copy()
    arrived = rows[:, 8].copy() if "arrived" in table.columns else time

    length = np.linalg.norm(pose[:, 3:], axis=1)
    good = np.isfinite(rows).all(axis=1)
    good &= np.abs(length - 1) < UNIT_ROUNDED
    good &= np.abs(pose[:, :3]).max(axis=1) <= MAX_COORDINATE
    good[1:] &= np.diff(arrived) >= 0
    if not good.all():
        i = int(np.argmin(good))
        raise SessionError(
            f"pose {i + 1} is {pose[i].tolist()} at {time[i]} s and arrived at {arrived[i]} s. A "
            "pose has finite numbers, a place within 1e6 m, a unit quaternion, and arrives after "
            "the pose before it",
            where=str(path),
            code="pose-invalid",
            numbers={"pose": i + 1},
        )
    return Poses(time, pose, arrived)
