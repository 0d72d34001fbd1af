"""A bundle of every released version, kept for ever, read by this program and by others."""

import json

import h5py
import numpy as np
import pytest
from conftest import ROOT, need_program, output
from golden import ARCHIVE, engine_sums
from refusals import refuses

from vfplan.bundle.read import read_bundle, read_fixture
from vfplan.bundle.seal import Trust, read_keys
from vfplan.bundle.validation import describe, validate
from vfplan.errors import BundleError, SignatureError
from vfplan.io.files import to_json_types

CURRENT = sorted(ARCHIVE.glob("2.*.h5"))
PIECES = ROOT / "tests" / "data" / "oracle" / "bundles" / "pieces.h5"
SIGNED = ARCHIVE / "2.0-signed.h5"
SUMS = json.loads((ARCHIVE / "engine_sums.json").read_text())
KEYS = ARCHIVE / "signed.pub"


def test_the_archive_is_there():
    assert len(CURRENT) >= 8
    assert SUMS.keys() <= {path.stem for path in (*CURRENT, PIECES)}


@pytest.mark.parametrize("path", CURRENT, ids=lambda p: p.stem)
def test_every_value_is_what_it_was_when_it_was_written(path):
    wanted = json.loads(path.with_suffix(".json").read_text())
    for value in wanted.values():
        if isinstance(value, dict):
            value.pop("values", None)  # The table's SHA-256 stands beside them.
    assert to_json_types(describe(path)) == wanted
    assert not [issue for issue in validate(path) if issue.severity == "error"]


@pytest.mark.parametrize("name", SUMS)
def test_an_engine_makes_of_it_what_it_made_to_the_bit(name):
    path = PIECES if name == PIECES.stem else ARCHIVE / f"{name}.h5"
    assert engine_sums(read_fixture(path)) == SUMS[name]


UNSEALED = {
    "has its seal in front": (b"VFPLSEAL\1\0" + bytes(5000), "version.seal"),
    "is no fixture bundle": (bytes(5000), "corrupt.seal"),
    "has no seal": (SIGNED.read_bytes()[:-512], "corrupt.seal"),
}


@pytest.mark.parametrize("found", UNSEALED)
def test_a_file_without_a_seal_is_refused(found, tmp_path):
    path = tmp_path / "old.h5"
    data, code = UNSEALED[found]
    path.write_bytes(data)
    with refuses(BundleError, code) as raised:
        read_fixture(path)
    assert found in raised.value.message


def test_the_signed_bundle_still_verifies():
    keys = read_keys(KEYS)
    seal = read_bundle(SIGNED, trust=Trust(keys, "case 17", "R-0042"))[1]
    assert seal["signed_utc"] == "2026-01-02T03:00:00Z"
    with pytest.raises(SignatureError):
        read_bundle(SIGNED, trust=Trust(keys, max_age=3600))


def raw_sums(path):
    """What tests/native/read_golden.c prints, by h5py."""
    with h5py.File(path) as file:
        lines = [f"@{name} {file.attrs[name].decode()}" for name in sorted(file.attrs)]
        things = {}
        file.visititems(things.__setitem__)
        found = [(n, t[...].tobytes()) for n, t in things.items() if hasattr(t, "shape")]
    return [*lines, *sorted(f"/{n} {len(b)} {np.frombuffer(b, 'u1').sum()}" for n, b in found)]


def test_libhdf5_1_10_reads_the_archive_without_our_code(tmp_path):
    compiler = need_program("h5cc", "libhdf5-dev")
    program = tmp_path / "read_golden"
    output(compiler, "-o", program, ROOT / "tests" / "native" / "read_golden.c", cwd=tmp_path)
    for path in CURRENT:
        lines = output(program, path).splitlines()
        count = sum(line.startswith("@") for line in lines)
        assert [*lines[:count], *sorted(lines[count:])] == raw_sums(path)
