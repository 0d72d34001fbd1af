"""Files that want to do harm: refused with a reason, quickly, in little memory, without a crash."""

import hashlib
import io
import os
import random
import signal
import sys
import time
from pathlib import Path

import bundles
import damage
import h5py
import hostile
import pytest
from conftest import ROOT, file_with, output

import vfplan
from vfplan.bundle import seal
from vfplan.bundle.read import read_bundle
from vfplan.bundle.validation import validate
from vfplan.errors import BundleError, CorruptError

pytestmark = pytest.mark.slow

MOST_SECONDS, MOST_MIB = 10, 512  # of processor time, so that a busy machine fails nothing
ARCHIVE = ROOT / "tests" / "data" / "bundles"
FRESH_MIB = 150  # what a process has taken before it reads its first file


@pytest.fixture(scope="module")
def corpus():
    return list(hostile.files())


@pytest.fixture(scope="module")
def sealed_bytes(tmp_path_factory):
    """The bytes of a bundle of one of the made-up fixtures, by its name."""
    folder = tmp_path_factory.mktemp("bundles")

    def of(name):
        path = folder / f"{name}.h5"
        if not path.exists():
            vfplan.write_fixture(getattr(bundles, name)(), path)
        return path.read_bytes()

    return of


def test_the_corpus_is_refused_and_invalid_with_a_reason_in_time_and_memory(corpus):
    """One process reads and validates it all; its peak memory bounds that of each file."""

    def work():
        problems = []
        for name, data, sound in corpus:
            started, reason = time.process_time(), None
            try:
                read_bundle(data)
            except BundleError as error:
                reason = error.message
            valid = not any(issue.severity == "error" for issue in validate(data))
            seconds = time.process_time() - started
            if reason == "" or (reason is None) != sound or seconds > MOST_SECONDS:
                problems.append(f"{name}: refused for {reason!r} in {seconds} s")
            if valid != sound:
                problems.append(f"{name}: valid {valid}")
        return "\n".join(problems)

    problems, added = damage.in_child(work)
    assert problems == ""
    assert added < MOST_MIB - FRESH_MIB


def test_a_seal_that_was_grown_again_is_refused(sealed_bytes):
    """What is verified are the file's bytes, not what they can be written as."""
    for data in (sealed_bytes("whole"), (ARCHIVE / "2.0-signed.h5").read_bytes()):
        length = len(data) - damage.SEAL
        payload = seal.with_end_of_file(data[:length], length + 4096)
        block = bytearray(data[length : -damage.TAIL].ljust(4096 - damage.TAIL, b"\0"))
        block[12:16] = (4096).to_bytes(4, "little")
        block[24:56] = hashlib.sha256(payload).digest()
        tail = seal.TAIL.pack(hashlib.sha256(block).digest(), 4096, 0, seal.TAIL_MAGIC)
        with pytest.raises(CorruptError, match="longer than its texts need"):
            read_bundle(payload + bytes(block) + tail)


@pytest.mark.parametrize("mode", ["r+", "a"])
@pytest.mark.parametrize("change", [False, True])
def test_a_bundle_that_h5py_opened_for_writing_is_as_it_was_or_refused(mode, change, tmp_path):
    path = bundles.stored(tmp_path / "a.h5", bundles.whole())
    before = path.read_bytes()
    with h5py.File(path, mode) as file:
        file.attrs.update({"touched": 1} if change else {})
    if not change:
        assert path.read_bytes() == before
        return
    with pytest.raises(CorruptError, match="opened for writing by another program"):
        vfplan.read_fixture(path)


def test_a_bundle_that_was_cut_is_a_truncated_file_to_libhdf5(sealed_bytes):
    data = sealed_bytes("whole")
    for length in (len(data) - 1, len(data) - damage.SEAL, len(data) - damage.SEAL - 1):
        with pytest.raises(OSError, match="truncated file"):
            h5py.File(io.BytesIO(data[:length]))


def test_nothing_of_another_file_is_opened(tmp_path):
    """A secret beside the bundle is not read, whichever way the bundle points at it."""
    secret = file_with(tmp_path / "secret.h5", b"\0" * 560)
    before = secret.stat().st_atime_ns
    os.utime(secret, ns=(0, 0))
    for function in (
        lambda f: f.create_dataset("leak/x", (70,), "<f8", external=[(str(secret), 0, 560)]),
        lambda f: f.__setitem__("x", hostile.h5py.ExternalLink(str(secret), "/")),
    ):
        with pytest.raises(BundleError):
            read_bundle(damage.sealed(hostile.changed(function)))
    assert secret.stat().st_atime_ns == 0 != before


def sweep(data, cases):
    wanted = read_bundle(data)[0]
    text, _ = damage.in_child(lambda: "".join(damage.verdict(case, wanted) for case in cases))
    return text


@pytest.mark.parametrize("name, step", [("whole", 1), ("large", 40_009)])
def test_a_flipped_bit_is_refused_by_the_seal(name, step, sealed_bytes):
    data = sealed_bytes(name)
    cases = (damage.flipped(data, i, False) for i in range(0, len(data), step))
    assert set(sweep(data, cases)) == {"."}


@pytest.mark.parametrize(
    "name, step",
    [("small", 1), ("whole", 13), ("large", 40_009),
     pytest.param("whole", 1, marks=pytest.mark.full)],
)  # fmt: skip
def test_a_flipped_bit_under_a_good_seal_is_refused_or_read_as_h5py_reads_it(
    name, step, sealed_bytes
):
    """Who can seal a file anew can change its values, but never into what h5py does not see."""
    data = sealed_bytes(name)
    cases = (damage.flipped(data, i, True) for i in range(0, len(data), step))
    text, _ = damage.in_child(lambda: "".join(map(damage.verdict_of_two, cases)))
    assert set(text) == {".", "="}


def test_every_prefix_is_refused_also_under_a_seal_of_its_own(sealed_bytes):
    data = sealed_bytes("whole")
    assert set(sweep(data, (data[:i] for i in range(len(data))))) == {"."}
    length = len(data) - damage.SEAL
    found = sweep(data, (damage.cut(data, i, True) for i in range(len(data))))
    assert set(found[: length - 7] + found[length + 1 :]) == {"."}
    assert found[length] == "="  # and of the zeros in front of it some, which are put back


def test_25_kills_while_writing_leave_the_old_file_or_the_new_one(tmp_path):
    path = tmp_path / "a.h5"
    old, new = bundles.large(20_000), bundles.large(30_000)
    vfplan.write_fixture(old, path)
    draw = random.Random(4)
    for _ in range(25):
        child = os.fork()
        if child == 0:
            while True:
                for fixture in (new, old):
                    vfplan.write_fixture(fixture, path, overwrite=True)
        time.sleep(draw.uniform(0.0, 0.08))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        assert len(vfplan.read_fixture(path).points) in (20_000, 30_000)


@pytest.mark.parametrize("command", ["info", "validate"])
@pytest.mark.parametrize("name", ["largest", pytest.param("largest_cloud", marks=pytest.mark.full)])
def test_four_million_points_are_read_within_bounds(name, command, tmp_path_factory):
    """The largest files the format allows, each command in a process of its own."""
    path = tmp_path_factory.getbasetemp() / f"{name}.h5"
    if not path.exists():
        damage.in_child(lambda: vfplan.write_fixture(getattr(bundles, name)(), path) or "")
    program = Path(sys.executable).with_name("vfplan")
    # A process inherits the peak of the one that starts it, so a small one stands between.
    small = (
        "import resource, subprocess, sys; code = subprocess.run(sys.argv[1:]).returncode; "
        "used = resource.getrusage(resource.RUSAGE_CHILDREN); "
        "print(used.ru_maxrss, used.ru_utime + used.ru_stime); sys.exit(code)"
    )
    said = output(sys.executable, "-c", small, program, command, path, "-q")
    peak_kib, seconds = map(float, said.split())
    assert peak_kib / 1024 < 420
    assert seconds < (MOST_SECONDS if command == "info" else 15)
