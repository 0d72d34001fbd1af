"""Open a session file by what it is: CSV, HDF5, `.npz`, MCAP of `vfplan live` or a ROS bag.

The generator functions run in the sandbox (`vfplan.io.sandbox`): a crafted file can crash libhdf5,
or unpack without end.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from vfplan.errors import SessionError, SettingError
from vfplan.io.files import FilePath, OpenedFile, named_columns, open_number_table
from vfplan.io.hdf5 import h5py
from vfplan.io.sandbox import raise_limits, run_in_sandbox, run_once
from vfplan.session.bags import RosOptions, bag_sha256, bag_stamp
from vfplan.session.channels import is_bag
from vfplan.session.events import CHANGE_COLUMNS
from vfplan.session.session import (
    FRAMES,
    Blocks,
    Session,
    SessionStream,
    in_order,
    portions,
    unit_factor,
)

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
ZIP_SIGNATURE = b"PK\x03\x04"


def read_session(
    path: FilePath, *, units: str = "m", frame: str = "robot_base", ros: RosOptions | None = None
) -> Session:
    """Read a whole recording of HIP positions.

    Parameters
    ----------
    path
        CSV with a header that names t (s), x, y, z; HDF5 or `.npz` with `time` (T,) and
        `hip` (T, 3); MCAP of `vfplan live`; or a ROS 1 or ROS 2 bag.
    units
        Of the positions in the file: "m", "cm", "mm", "um" or "in".
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
    path: FilePath, *, units: str = "m", frame: str = "robot_base", ros: RosOptions | None = None,
    skip_unordered: bool = False,
) -> SessionStream:  # fmt: skip
    """Open a recording to be read block by block; as `read_session` otherwise.

    skip_unordered: sort samples however many are out of order, and leave doubled ones out
    """
    path = Path(path)
    if path.is_dir() and is_bag(path):
        return _open_bag(path, units, frame, ros, skip_unordered)
    file = OpenedFile(path, SessionError)
    name = path.name
    source = {"file": file, "where": name, "kind": SessionError}

    # An MCAP file may be ours or a ROS bag; the other bags are told by their suffix.
    # One that is still written, or was cut off, ends in .part.
    is_our_mcap = is_cut = False
    if name.endswith((".mcap", ".mcap.part")):
        is_our_mcap, is_cut = run_once("vfplan.session.bags:has_our_topic", **source)
    if is_bag(path) and not is_our_mcap:
        return _open_bag(path, units, frame, ros, skip_unordered)
    if ros is not None and dataclasses.replace(ros, frame=None) != RosOptions():
        message = "is no ROS bag. Leave out what chooses among a bag's messages, such as --topic"
        raise SettingError(message, where=name, code="ros-options-unused")

    notes = {"units": units}
    signature = file.view().read(8)
    if signature.startswith(b"MATLAB "):
        how = "writetable(table(t, x, y, z), 'session.csv')"
        message = f"is a MATLAB file, which is not read. Write a CSV in MATLAB: {how}"
        raise SessionError(message, where=name, code="matlab-file")
    if is_our_mcap:
        notes |= {"format": "mcap"} | ({"cut": True} if is_cut else {})
        read = partial(run_in_sandbox, "vfplan.session.bags:read_hips", **source)
    elif signature == HDF5_SIGNATURE or signature.startswith(ZIP_SIGNATURE):
        notes["format"] = "hdf5" if signature == HDF5_SIGNATURE else "npz"
        job = f"vfplan.session.read:read_{notes['format']}"
        read = partial(run_in_sandbox, job, units, frame, **source)
    else:
        notes["format"] = "csv"
        table = open_number_table(file.view, name, SessionError, ("t",))
        columns = ("t", *named_columns(table, units))
        ignored = [column for column in table.columns if column and column not in columns]
        # Counts that stay 0 say that the fixture never changed; what is no number counts nothing.
        for column in CHANGE_COLUMNS:
            with suppress(SessionError):
                if column in ignored and not any(rows.any() for rows in table.blocks((column,))):
                    ignored.remove(column)
        if ignored:
            notes["ignored_columns"] = ignored
        end = file.view()
        end.seek(-2, os.SEEK_END)
        if not {*end.read()} & {*b"\r\n"}:
            notes["open_end"] = True

        def read() -> Blocks:
            for rows in table.blocks(columns):
                yield rows[:, 0].copy(), rows[:, 1:]

    return _stream(read, file.require_unchanged, skip_unordered, name, frame, file.sha256(), notes)


def _open_bag(
    path: Path, units: str, frame: str, ros: RosOptions | None, skip: bool
) -> SessionStream:
    # A bag may be several files, which its library opens by itself. None of them may change
    # between the digest and the end of the reading.
    name = path.name
    stamp = bag_stamp(path)
    sha256 = bag_sha256(path)
    ros = ros or RosOptions()
    tip = ros.tool_tip and tuple(x / unit_factor(units) for x in ros.tool_tip)
    options = dataclasses.astuple(dataclasses.replace(ros, tool_tip=tip))
    read = partial(
        run_in_sandbox, "vfplan.session.bags:read_bag", str(path.resolve()), *options,
        where=name, kind=SessionError,
    )  # fmt: skip
    notes = next(filter(None, read()))
    # Another frame is one of the bag's own.
    frame = frame if frame in FRAMES else FRAMES[0]

    def samples() -> Blocks:
        return (answer for answer in read() if isinstance(answer, tuple))

    def require_unchanged() -> None:
        if bag_stamp(path) != stamp:
            message = "was changed while it was read. Try again when it is complete"
            raise SessionError(message, where=name, code="file-changed")

    notes |= {"format": "ros", "units": units}
    if ros.tool_tip is not None:
        notes["tool_tip_m"] = list(ros.tool_tip)
    return _stream(samples, require_unchanged, skip, name, frame, sha256, notes)


def _stream(
    read: Callable[[], Blocks], require_unchanged: Callable[[], None], skip: bool,
    name: str, frame: str, sha256: str, notes: dict[str, object],
) -> SessionStream:  # fmt: skip
    """Samples in order; a file that no longer has the digest that was taken is refused."""
    mended = {}
    factor = unit_factor(str(notes["units"]))

    def samples() -> Blocks:
        for time, hip in in_order(read(), mended, name, skip=skip):
            yield time, hip * factor
        require_unchanged()

    return SessionStream(samples, name, frame, sha256, {**notes, "mended": mended})


# The arrays of a session, with the shape of a row.
ROWS = {"time": (), "hip": (3,)}
# The attribute `format` of a fixture bundle.
FIXTURE_FORMAT = "vfplan-fixture"


def read_hdf5(stream: BinaryIO, units: str, frame: str) -> Blocks:
    """Yield (time [s], hip) a block at a time.

    Raises SessionError: not HDF5, a dataset missing, wrong shapes or types, or an attribute of the
        root, of `hip` or of `time` that names other units or another frame
    """
    with opened_hdf5(stream) as file:
        if "time" not in file and plain_attribute(file.attrs.get("format")) == FIXTURE_FORMAT:
            message = "is a fixture and no recording. Give the fixture first, and then a recording"
            raise SessionError(message, code="fixture-as-session")
        datasets = plain_datasets(file, ROWS)
        check_arrays(datasets, ROWS)
        time, hip = datasets.values()
        for place, *wanted in ((file, units, frame), (hip, units, frame), (time, "s", None)):
            check_said(place.attrs, f"attribute {{}} of {place.name}", *wanted)
        yield from portions(time, hip)


def check_said(values: Mapping[str, Any], what: str, units: str, frame: str | None) -> None:
    """Raise `SessionError` where a file says other units or another frame than the call.

    Neither overrules the other. what: where the file says it, with {} for the name
    """
    wanted = {"units": units, "unit": units}
    if frame is not None:
        wanted["frame"] = frame
    for name, expected in wanted.items():
        said = np.ravel(values.get(name, expected))
        if said.size != 1 or said.dtype.kind not in "USO":
            continue  # It counts frames, or holds something else than one text.
        value = str(plain_attribute(said[0]))
        if value != expected:
            found = f"{what.format(name)} is {value[:40]!r}"
            message = f"{found}, and the call says {expected!r}. Correct one of them"
            raise SessionError(message, code="units-or-frame-differ")


def read_npz(stream: BinaryIO, units: str, frame: str) -> Blocks:
    """Yield (time [s], hip) a block at a time; refuse arrays as `read_hdf5` does attributes."""
    # Packed numbers of a recording take up to four times as much memory, of which 2 GiB are given.
    size = min(stream.seek(0, 2), 512 << 20)
    raise_limits(4 * size, size >> 26)
    stream.seek(0)
    try:
        with np.load(stream) as archive:
            require_names(archive.files, ROWS)
            arrays = {name: archive[name] for name in ROWS}
            check_said(archive, "array {}", units, frame)
        # A member without a header is bytes, which have no shape.
        check_arrays(arrays, ROWS)
    except SessionError:
        raise
    except Exception as error:
        # NumPy passes on what decompressors and the parser of a header raise.
        reason = str(error).partition("\n")[0] or type(error).__name__
        message = f"cannot be read as .npz: {reason}. Save the arrays again"
        raise SessionError(message, code="npz-broken") from None
    yield from portions(*arrays.values())


@contextmanager
def opened_hdf5(stream: BinaryIO) -> Iterator[h5py.File]:
    """An open HDF5 file; errors of libhdf5 inside become `SessionError`."""
    try:
        with h5py.File(stream, "r") as file:
            yield file
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        message = f"cannot be read as HDF5: {error}. Write the file again"
        raise SessionError(message, code="hdf5-broken") from None


def plain_datasets(file: h5py.Group, names: Iterable[str]) -> dict[str, h5py.Dataset]:
    """The datasets of these names, by name.

    Raises SessionError: there is none, or its data are in another file
    """
    require_names(sorted(file), names)
    datasets = {}
    for name in names:
        # A link to another file is never followed: a session is one file.
        dataset = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
        is_plain = isinstance(dataset, h5py.Dataset) and dataset.shape is not None
        if not is_plain or dataset.external or dataset.is_virtual:
            message = f"{name!r} is a link or no plain dataset. Store the data under that name"
            raise SessionError(message, code="dataset-odd")
        datasets[name] = dataset
    return datasets


def require_names(present: list[str], names: Iterable[str]) -> None:
    """Refuse a file without one of these arrays."""
    for name in names:
        if name not in present:
            held = ", ".join(present)[:80] or "nothing"
            message = f"has no dataset {name!r} (it holds {held}). Give {', '.join(names)}"
            raise SessionError(message, code="dataset-missing")


def plain_attribute(value: Any) -> Any:
    """An attribute's value in Python's types. h5py gives text of fixed length as bytes."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def check_arrays(arrays: dict[str, Any], rows: dict[str, tuple[int, ...]]) -> int:
    """The length T of arrays of real numbers, each (T, *rows[its name]).

    Raises SessionError: arrays of other shapes or types
    """
    length = tuple(next(iter(arrays.values())).shape)[:1] or ("T",)
    for name, array in arrays.items():
        wanted = (*length, *rows[name])
        if tuple(array.shape) != wanted:
            message = f"{name} has shape {tuple(array.shape)}. Give {wanted}"
            raise SessionError(message, code="shape-wrong")
        if array.dtype.kind not in "fiu":
            message = f"{name} has type {array.dtype}. Give real numbers"
            raise SessionError(message, code="type-wrong")
    return int(length[0])
