"""Open a session file by what it is: CSV, HDF5, `.npz` or a ROS bag."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

from vfplan.errors import SessionError, SettingError
from vfplan.io.disk import opened_file
from vfplan.session.arrays import hdf5_header, npz_header, read_hdf5, read_npz
from vfplan.session.csvfile import WANTED, csv_columns, read_csv
from vfplan.session.ros import RosOptions, bag_header, bag_sha256, is_bag, read_bag
from vfplan.session.types import Session, SessionStream, unit_factor

_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
_ZIP_MAGIC = b"PK\x03\x04"


def read_session(
    path: str | Path,
    *,
    units: str = "m",
    frame: str = "robot_base",
    ros: RosOptions | None = None,
) -> Session:
    """Read a whole recording of HIP positions.

    Parameters
    ----------
    path
        CSV with a header that names t (s), x, y, z; HDF5 or `.npz` with `time` (T,) and
        `hip` (T, 3); or a ROS 1 or ROS 2 bag.
    units
        Of the positions in the file: "m" or "mm".
    frame
        The frame the positions are in.
    ros
        For a ROS bag: which topic, which field, and where the tool's tip is.

    Raises
    ------
    SessionError
        The file is missing, is none of these, or holds fewer than two samples, a value that is
        not finite, or a time that does not increase.
    MissingExtra
        A ROS bag, and the library `rosbags` is not installed.
    """
    return open_session(path, units=units, frame=frame, ros=ros).load()


def open_session(
    path: str | Path,
    *,
    units: str = "m",
    frame: str = "robot_base",
    ros: RosOptions | None = None,
) -> SessionStream:
    """Open a recording to be read block by block; as `read_session` otherwise."""
    path = Path(path)
    factor = unit_factor(units)
    magic = b"" if path.is_dir() and is_bag(path) else _first_bytes(path)
    if is_bag(path):
        chosen, notes = bag_header(path, ros or RosOptions())
        read = functools.partial(read_bag, path, factor, chosen)
        notes = {"format": "ros", "units": units, **notes}
        return SessionStream(read, path.name, frame, bag_sha256(path), notes)
    if ros is not None:
        raise SettingError("topic, field and tool tip are for ROS bags", where=path.name)
    digest = _sha256(path)
    notes: dict[str, object] = {}
    if magic.startswith(_HDF5_MAGIC):
        length, stated = hdf5_header(path)
        _agree(stated, {"units": units, "frame": frame, "time unit": "s"}, path.name)
        read, kind = functools.partial(read_hdf5, path, factor), "hdf5"
    elif magic.startswith(_ZIP_MAGIC):
        length = npz_header(path)
        read, kind = functools.partial(read_npz, path, factor), "npz"
    else:
        aside = [name for name in csv_columns(path) if name not in WANTED]
        if aside:
            notes["ignored_columns"] = aside
        length = None
        read, kind = functools.partial(read_csv, path, factor), "csv"
    notes = {"format": kind, "units": units, **notes}
    return SessionStream(read, path.name, frame, digest, notes, length)


def _first_bytes(path: Path) -> bytes:
    try:
        with opened_file(path, SessionError) as file:
            return file.read(8)
    except SessionError as error:
        wanted = "a session file or a ROS bag wanted"
        raise SessionError(f"{error.message}; {wanted}", where=str(path)) from None


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _agree(stated: list[tuple[str, str, str]], asked: dict[str, str], where: str) -> None:
    """What a file says of itself is never overruled in silence."""
    for name, value, place in stated:
        if value != asked[name]:
            raise SessionError(
                f"the file says {name} = {value!r} ({place}), the call {asked[name]!r}; "
                "they must agree",
                where=where,
            )
