"""Open a session file by what it is: CSV, HDF5, `.npz`, MCAP of `vfplan live` or a ROS bag."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator
from pathlib import Path

from vfplan.errors import SessionError, SettingError
from vfplan.io.files import OpenedFile
from vfplan.io.sandbox import run_in_sandbox, run_once
from vfplan.io.table import open_number_table
from vfplan.session.events import CHANGE_COLUMNS
from vfplan.session.ros import RosOptions, bag_sha256, bag_stamp, is_bag
from vfplan.session.session import Samples, Session, SessionStream, unit_factor

HIP_COLUMNS = ("t", "x", "y", "z")
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
ZIP_SIGNATURE = b"PK\x03\x04"


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
        return _open_bag(path, factor, units, frame, ros)
    try:
        file = OpenedFile(path, SessionError)
    except SessionError as error:
        error.message += ", or give another session file or ROS bag"
        raise
    name = path.name
    source = {"file": file, "where": name, "kind": SessionError}

    # An MCAP file may be ours or a ROS bag; the other bags are told by their suffix.
    is_our_mcap = path.suffix == ".mcap" and run_once(
        "vfplan.session.mcapfile:has_our_topic", name, **source
    )
    if is_bag(path) and not is_our_mcap:
        return _open_bag(path, factor, units, frame, ros)
    if ros is not None:
        raise SettingError(
            "topic, field and tool tip are for ROS bags, and this is none. Leave them out",
            where=name,
            code="ros-options-unused",
        )

    notes: dict[str, object] = {"units": units}
    length = None
    signature = file.view().read(8)
    if is_our_mcap:
        notes["format"] = "mcap"
        read = functools.partial(
            run_in_sandbox, "vfplan.session.mcapfile:read_hips", name, factor, **source
        )
    elif signature == HDF5_SIGNATURE or signature.startswith(ZIP_SIGNATURE):
        kind = "hdf5" if signature == HDF5_SIGNATURE else "npz"
        notes["format"] = kind
        length, statements = run_once(f"vfplan.session.arrays:{kind}_header", name, **source)
        # Where the file says its own units or frame, neither it nor the call overrules the other.
        expected = {"units": units, "frame": frame, "time unit": "s"}
        for statement, value, place in statements:
            if value != expected[statement]:
                raise SessionError(
                    f"the file says {statement} = {value!r} ({place}), the call "
                    f"{expected[statement]!r}. Correct one of them",
                    where=name,
                    code="units-or-frame-differ",
                )
        read = functools.partial(
            run_in_sandbox, f"vfplan.session.arrays:read_{kind}", name, factor, **source
        )
    else:
        notes["format"] = "csv"
        table = open_number_table(file.view, name, SessionError, HIP_COLUMNS)
        ignored = [column for column in table.columns if column not in HIP_COLUMNS]
        # Counts that stay 0 say that the fixture never changed.
        for column in CHANGE_COLUMNS:
            if column in ignored and not any(rows.any() for rows in table.blocks((column,))):
                ignored.remove(column)
        if ignored:
            notes["ignored_columns"] = ignored

        def read() -> Iterator[Samples]:
            for rows in table.blocks(HIP_COLUMNS):
                yield rows[:, 0].copy(), rows[:, 1:] * factor

    read = functools.partial(_read_unchanged, read, file.require_unchanged)
    return SessionStream(read, name, frame, file.sha256(), notes, length)


def _open_bag(
    path: Path, factor: float, units: str, frame: str, ros: RosOptions | None
) -> SessionStream:
    # A bag may be several files, which its library opens by itself. None of them may change
    # between the digest and the end of the reading.
    name = path.name
    stamp = bag_stamp(path)
    sha256 = bag_sha256(path)
    if ros is None:
        ros = RosOptions()
    chosen, notes = run_once(
        "vfplan.session.ros:bag_header",
        str(path.resolve()),
        *dataclasses.astuple(ros),
        where=name,
        kind=SessionError,
    )

    def require_unchanged() -> None:
        if bag_stamp(path) != stamp:
            raise SessionError(
                "was changed while it was read. Try again when it is complete",
                where=name,
                code="file-changed",
            )

    read = functools.partial(
        run_in_sandbox,
        "vfplan.session.ros:read_bag",
        str(path.resolve()),
        factor,
        *chosen,
        where=name,
        kind=SessionError,
    )
    read = functools.partial(_read_unchanged, read, require_unchanged)
    return SessionStream(read, name, frame, sha256, {"format": "ros", "units": units, **notes})


def _read_unchanged(
    read: Callable[[], Iterator[Samples]], require_unchanged: Callable[[], None]
) -> Iterator[Samples]:
    """Read to the end, and then refuse a file that no longer has the digest that was taken."""
    yield from read()
    require_unchanged()
