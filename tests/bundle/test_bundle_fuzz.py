"""The fuzz target, for a bounded time: nothing but `BundleError` may come out of the reader."""

import subprocess
import sys
from pathlib import Path

import fuzz_bundle
import hostile
import pytest
from conftest import ROOT, need_header, need_program, output

import vfplan

pytestmark = pytest.mark.slow


def test_the_mutator_knows_the_checksums():
    """Repairing a sound file changes nothing: every checksum computed here is libhdf5's own."""
    good = hostile.sound()
    assert len(list(fuzz_bundle.checked_spans(good))) > 20
    assert fuzz_bundle.repaired(good) == good


def test_the_fuzz_target_runs_under_atheris(tmp_path):
    pytest.importorskip("atheris")
    command = [sys.executable, Path(fuzz_bundle.__file__), "-runs=60", "-seed=1"]
    command += [tmp_path, "-timeout=10", "-rss_limit_mb=2048"]
    done = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, cwd=tmp_path, timeout=200, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert "NEW" in done.stderr  # its modules are watched
    assert "Done 60" in done.stderr


@pytest.mark.parametrize("first, count", [
    (0, 400), pytest.param(400, 100_000, marks=pytest.mark.full)])  # fmt: skip
def test_mutants_meet_no_fault_that_a_sanitizer_sees(first, count, tmp_path):
    """The reader in C++ with the sanitizers of addresses and undefined behaviour."""
    compiler = need_program("g++", "g++")
    need_header("openssl/evp.h", "libssl-dev")
    program = tmp_path / "bundle_sweep"
    words = [compiler, "-std=c++20", "-O1", "-fsanitize=address,undefined"]
    words += ["-fno-sanitize-recover=all", f"-I{Path(vfplan.__file__).parent / 'include'}"]
    words += [ROOT / "tests" / "native" / "bundle_sweep.cpp", "-lcrypto", "-o", program]
    output(*words)
    with open(tmp_path / "verdicts", "wb") as verdicts, open(tmp_path / "faults", "wb") as faults:
        child = subprocess.Popen(
            [program, "stream"], stdin=subprocess.PIPE, stdout=verdicts, stderr=faults
        )
        with child.stdin:
            for data in fuzz_bundle.mutants(first, count):
                child.stdin.write(len(data).to_bytes(4, "little") + data)
    assert child.wait() == 0, (tmp_path / "faults").read_text()[-3000:]
    found = (tmp_path / "verdicts").read_bytes().strip()
    assert len(found) == count
    assert b"!" not in found, "the list of all findings has errors where the reader refuses"
