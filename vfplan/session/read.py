"""Open a session file by what it is: CSV, HDF5, `.npz`, MCAP of `vfplan live` or a ROS bag."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator
from pathlib import Path

from vfplan.errors import SessionError, SettingError
from vfplan.io.apart import apart, one
from vfplan.io.reading import OneFile
from vfplan.session.csvfile import WANTED, csv_columns, read_csv
from vfplan.session.ros import RosOptions, bag_sha256, bag_stamp, is_bag
from vfplan.session.types import Pair, Session, SessionStream, unit_factor

_MAGIC = {b"\x89HDF\r\n\x1a\n": "hdf5", b"PK\x03\x04": "npz"}
# Read in a process apart.
_ARRAYS, _BAG, _MCAP = (f"vfplan.session.{name}:" for name in ("arrays", "ros", "mcapfile"))


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
        `hip` (T, 3); MCAP of `vfplan live`; or a ROS 1 or ROS 2 bag.
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
    if path.is_dir() and is_bag(path):
        return _bag(path, factor, units, frame, ros)
    file, name, length = _opened(path), path.name, None
    given = {"file": file, "where": name, "kind": SessionError}
    ours = path.suffix == ".mcap" and one(_MCAP + "is_ours", name, **given)
    if is_bag(path) and not ours:
        return _bag(path, factor, units, frame, ros)
    if ros is not None:
        raise SettingError("topic, field and tool tip are for ROS bags", where=name)
    first = file.view().read(8)
    kind = "mcap" if ours else next((k for m, k in _MAGIC.items() if first.startswith(m)), "csv")
    notes: dict[str, object] = {"format": kind, "units": units}
    read = functools.partial(apart, f"{_ARRAYS}read_{kind}", name, factor, **given)
    if kind == "mcap":
        read = functools.partial(apart, _MCAP + "read_hips", name, factor, **given)
    elif kind == "csv":
        with file.view() as stream:
            aside = [column for column in csv_columns(stream, name) if column not in WANTED]
        notes |= {"ignored_columns": aside} if aside else {}
        read = functools.partial(read_csv, file, name, factor)
    else:
        length, stated = one(f"{_ARRAYS}{kind}_header", name, **given)
        _agree(stated, {"units": units, "frame": frame, "time unit": "s"}, name)
    checked = functools.partial(_steady, read, file.require_unchanged)
    return SessionStream(checked, name, frame, file.sha256(), notes, length)


def _bag(
    path: Path, factor: float, units: str, frame: str, ros: RosOptions | None
) -> SessionStream:
    """A bag is several files, or opens its own: it is held to what it was when first seen."""
    place, name, before, sha256 = str(path.resolve()), path.name, bag_stamp(path), bag_sha256(path)
    asked = dataclasses.astuple(ros or RosOptions())
    chosen, notes = one(_BAG + "bag_header", place, *asked, where=name, kind=SessionError)

    def require_unchanged() -> None:
        if bag_stamp(path) != before:
            raise SessionError("was changed while it was read", where=name)

    read = functools.partial(
        apart, _BAG + "read_bag", place, factor, *chosen, where=name, kind=SessionError
    )
    checked = functools.partial(_steady, read, require_unchanged)
    notes = {"format": "ros", "units": units, **notes}
    return SessionStream(checked, name, frame, sha256, notes)


def _steady(
    read: Callable[[], Iterator[Pair]], require_unchanged: Callable[[], None]
) -> Iterator[Pair]:
    """What is read, of a file whose digest is still the one that was taken."""
    yield from read()
    require_unchanged()


def _opened(path: Path) -> OneFile:
    try:
        return OneFile(path, SessionError)
    except SessionError as error:
        wanted = "a session file or a ROS bag wanted"
        raise SessionError(f"{error.message}; {wanted}", where=str(path)) from None


def _agree(stated: list[tuple[str, str, str]], asked: dict[str, str], where: str) -> None:
    """What a file says of itself is never overruled in silence."""
    for name, value, place in stated:
        if value != asked[name]:
            raise SessionError(
                f"the file says {name} = {value!r} ({place}), the call {asked[name]!r}; "
                "they must agree",
                where=where,
            )
