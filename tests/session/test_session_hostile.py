"""Sessions and results from others: none crashes the program, hangs it or fills its memory."""

from __future__ import annotations

import json
import os
import random
import sys
import zipfile
import zlib

import h5py
import numpy as np
import pytest
from conftest import file_with, output
from motion import PEAK_KIB
from refusals import refuses
from replays import write_session

import vfplan
import vfplan.io.sandbox
import vfplan.session.read
import vfplan.session.result
from vfplan.errors import InputError
from vfplan.session.read import open_session, read_session
from vfplan.session.result import ResultWriter, TickBlock, read_result

pytestmark = pytest.mark.slow

GIB = 1 << 30
HEAD = "t,x,y,z\n0,1,2,3\n"


def recording(count=40):
    time = np.arange(count) * 1e-3
    return time, np.column_stack((time, time + 1, time - 1))


def hdf5_session(path):
    """As recorders write them: chunked, compressed, with text of variable length."""
    time, hip = recording()
    with h5py.File(path, "w") as file:
        file.create_dataset("time", data=time, chunks=(16,), compression="gzip")
        file.create_dataset("hip", data=hip, chunks=(16, 3), fletcher32=True)
        file["hip"].attrs["units"] = "m"
        file.attrs["frame"] = "robot_base"


def result(path):
    time, hip = recording()
    state = np.zeros(40, np.int8)
    rows = [hip + k for k in range(4)]
    with ResultWriter(path, {"rule": "robust", "scene": {"points": 3}}) as writer:
        writer.append(TickBlock(time, *rows, state, time, time))


def spoiled(data, rng):
    """One to three bits flipped, or a stretch of bytes put elsewhere."""
    found = bytearray(data)
    if rng.random() < 0.1:
        at, to, size = rng.randrange(len(data)), rng.randrange(len(data)), rng.randrange(1, 64)
        found[to : to + size] = found[at : at + size]
        return bytes(found)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def refused(path, read):
    try:
        read(path)
    except vfplan.VfplanError:
        return 1
    return 0


KINDS = {"session": (hdf5_session, read_session), "result": (result, read_result)}


@pytest.mark.parametrize("kind", KINDS)
def test_no_flipped_bit_ends_or_stops_the_program(tmp_path, kind, monkeypatch):
    """libhdf5 crashes or loops on some of them: its process does, and the reading is refused."""
    monkeypatch.setattr(vfplan.io.sandbox, "STEP_S", 1)  # of 8, to save time
    (make, read), path, rng = KINDS[kind], tmp_path / "a.h5", random.Random(300)
    make(path)
    data, found = path.read_bytes(), 0
    assert not refused(path, read)
    for _ in range(300):
        path.write_bytes(spoiled(data, rng))
        found += refused(path, read)
    assert 0 < found < 300


# --- Bombs -------------------------------------------------------------------------------------


TEXTS = {
    "line.csv": lambda: "t,x,y,z\n0,0,0," + "1" * 200_000_000,
    "header.csv": lambda: "t,x,y,z," + "a" * 200_000_000,
    "columns.csv": lambda: "t,x,y,z" + ",c" * 30_000 + "\n" + ("0" + ",0" * 30_003 + "\n") * 50,
}


def npz_head(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("time", "hip"):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                member.write(b"\x93NUMPY\x02\x00" + (3_000_000_000).to_bytes(4, "little"))
                member.write(bytes(50_000_000))


def npz_members(path):
    with zipfile.ZipFile(path, "w") as archive:
        for k in range(5000):
            archive.writestr(f"{k}.npy", b"")


def hdf5_chunk(path):
    """A chunk that says 1 GiB, and is."""
    packer = zlib.compressobj(1)
    data = b"".join(packer.compress(bytes(1 << 24)) for _ in range(64)) + packer.flush()
    with h5py.File(path, "w") as file:
        for name, tail in (("time", ()), ("hip", (3,))):
            shape = (2**27, *tail)
            made = file.create_dataset(name, shape, "<f8", chunks=shape, compression="gzip")
            made.id.write_direct_chunk((0,) * len(shape), data)


def ros_yaml(path):
    path.mkdir()
    deep = "{a: " * 400 + "1" + "}" * 400
    lines = "\n".join(f"- {deep}" for _ in range(4000))
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n" + lines)


BOMBS = {"head.npz": npz_head, "members.npz": npz_members, "chunk.h5": hdf5_chunk, "bag": ros_yaml}
MEASURED = f"""
import json, sys, time
import vfplan.io.sandbox, vfplan.session.read
vfplan.io.sandbox.STEP_S = 2  # of 8, to save time
begun = time.process_time()
try:
    vfplan.session.read.read_session(sys.argv[1])
    found = None
except vfplan.VfplanError as error:
    found = error.exit_code, str(error)
print(json.dumps([found, time.process_time() - begun, {PEAK_KIB} * 1024]))
"""


@pytest.mark.parametrize("name", [*TEXTS, *BOMBS])
def test_what_would_fill_memory_is_refused_at_once(name, tmp_path):
    """The processor's time and the peak memory of the program; its reader has its own limits."""
    if name == "bag":
        pytest.importorskip("rosbags")
    if name in TEXTS:
        (tmp_path / name).write_text(TEXTS[name]())
    else:
        BOMBS[name](tmp_path / name)
    told = output(sys.executable, "-c", MEASURED, tmp_path / name, cwd=tmp_path)
    found, seconds, peak = json.loads(told)
    assert found, "was read"
    assert found[0] == 3
    assert seconds < 10
    assert peak < GIB


# --- One file, one digest ----------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".h5"])
def test_the_file_that_is_played_is_the_one_whose_digest_is_told(tmp_path, suffix):
    """Another file takes the name between the digest and the first tick."""
    (time, hip), path, other = recording(), tmp_path / f"s{suffix}", tmp_path / f"o{suffix}"
    for place, values in ((path, hip), (other, hip + 1)):
        if suffix == ".npz":
            np.savez(place, time=time, hip=values)
        elif suffix == ".h5":
            with h5py.File(place, "w") as file:
                file.update(time=time, hip=values)
        else:
            write_session(place, vfplan.Session(time, values))
    stream = open_session(path)
    os.replace(other, path)
    np.testing.assert_array_equal(stream.load().hip, hip)
    assert stream.sha256 != open_session(path).sha256


def test_a_file_written_to_while_it_is_read_is_refused(tmp_path):
    path = file_with(tmp_path / "s.csv", HEAD + "1,1,2,3\n")
    os.utime(path, (1, 1))
    stream = open_session(path)
    path.write_text(HEAD + "1,1,2,4\n")
    with refuses(InputError, "file-changed"):
        stream.load()
