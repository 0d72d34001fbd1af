"""A bundle of every released version, kept for ever, read by this program and by others."""

import json
import subprocess

import bundles
import h5py
import numpy as np
import pytest
from conftest import ROOT, need_program

import vfplan
from vfplan.bundle import describe, migrate, require_signature, validate
from vfplan.errors import InputError, SignatureError, VersionError
from vfplan.io.disk import jsonable

ARCHIVE = ROOT / "tests" / "data" / "bundles"
CURRENT = sorted(ARCHIVE.glob("1.*.h5"))
OLD = sorted(ARCHIVE.glob("0.*.h5"))
SIGNED = ARCHIVE / "1.0-signed.h5"
KEYS = ARCHIVE / "signed.pub"


def test_the_archive_is_there():
    assert len(CURRENT) >= 6
    assert len(OLD) >= 2


@pytest.mark.parametrize("path", CURRENT, ids=lambda p: p.stem)
def test_every_value_is_what_it_was_when_it_was_written(path):
    assert jsonable(describe(path, values=True)) == json.loads(
        path.with_suffix(".json").read_text()
    )
    assert not [issue for issue in validate(path) if issue.severity == "error"]


@pytest.mark.parametrize(("name", "make"), [("minimal", "minimal"), ("everything", "whole")])
def test_a_bundle_of_version_0_1_is_refused_and_migrated(name, make, tmp_path):
    old, new = ARCHIVE / f"0.1-{name}.h5", tmp_path / "new.h5"
    with pytest.raises(VersionError, match=r"vfplan migrate"):
        vfplan.read_fixture(old)
    before = old.read_bytes()
    content = migrate(old, new)
    assert old.read_bytes() == before
    fixture = vfplan.read_fixture(new)
    assert "migrated from 0.1 to 1.0" in fixture.provenance.history[-1]
    assert content["/provenance/history"] == fixture.provenance.history
    wanted = getattr(bundles, make)()
    bundles.same(bundles.replace(fixture, provenance=wanted.provenance), wanted)
    with pytest.raises(InputError, match="no migration"):
        migrate(new, tmp_path / "again.h5")


def test_the_signed_bundle_still_verifies():
    seal = require_signature(SIGNED, KEYS, case="case 17", robot_serial="R-0042")
    assert seal.describe()["registered_utc"] == "2026-01-02T03:00:00Z"
    with pytest.raises(SignatureError):
        require_signature(SIGNED, KEYS, max_age=3600)


def raw_sums(path):
    """What tests/native/read_golden.c prints, by h5py."""
    with h5py.File(path) as file:
        lines = [f"@{name} {file.attrs[name].decode()}" for name in sorted(file.attrs)]
        found = []
        file.visititems(
            lambda name, thing: (
                found.append((name, thing[...].tobytes())) if hasattr(thing, "shape") else None
            )
        )
    return [*lines, *sorted(f"/{n} {len(b)} {np.frombuffer(b, 'u1').sum()}" for n, b in found)]


def test_libhdf5_1_10_reads_the_archive_without_our_code(tmp_path):
    compiler = need_program("h5cc", "libhdf5-dev")
    program = tmp_path / "read_golden"
    source = ROOT / "tests" / "native" / "read_golden.c"
    subprocess.run([compiler, "-o", program, source], check=True, cwd=tmp_path)
    for path in (*CURRENT, *OLD):
        done = subprocess.run([program, path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, path
        lines = done.stdout.splitlines()
        count = sum(line.startswith("@") for line in lines)
        assert [*lines[:count], *sorted(lines[count:])] == raw_sums(path)


def test_h5dump_sees_the_data_behind_the_seal():
    program = need_program("h5dump", "hdf5-tools")
    done = subprocess.run(
        [program, "-d", "/rendering/stiffness", SIGNED], capture_output=True, text=True, check=True
    )
    assert "(0): 1000, 1000, 800" in done.stdout
