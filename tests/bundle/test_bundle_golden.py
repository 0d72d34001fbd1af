"""A bundle of every released version, kept for ever, read by this program and by others."""

import hashlib
import io
import json
import struct
import subprocess

import bundles
import damage
import golden
import h5py
import hostile
import numpy as np
import pytest
from conftest import ROOT, need_program

import vfplan
from vfplan.bundle import migration, seal
from vfplan.bundle.migration import migrate
from vfplan.bundle.read import require_signature
from vfplan.bundle.validation import describe, validate
from vfplan.errors import BundleError, InputError, SignatureError
from vfplan.io.files import to_json_types

ARCHIVE = ROOT / "tests" / "data" / "bundles"
CURRENT = sorted(ARCHIVE.glob("2.*.h5"))
OLD = sorted(ARCHIVE.glob("[01].*.h5"))
SIGNED = ARCHIVE / "2.0-signed.h5"
SUMS = json.loads((ARCHIVE / "engine_sums.json").read_text())
KEYS = ARCHIVE / "signed.pub"


def test_the_archive_is_there():
    assert len(CURRENT) >= 8
    assert {path.stem for path in OLD} == SUMS.keys()


@pytest.mark.parametrize("path", CURRENT, ids=lambda p: p.stem)
def test_every_value_is_what_it_was_when_it_was_written(path):
    assert to_json_types(describe(path, values=True)) == json.loads(
        path.with_suffix(".json").read_text()
    )
    assert not [issue for issue in validate(path) if issue.severity == "error"]


@pytest.mark.parametrize("path", OLD, ids=lambda p: p.stem)
def test_an_older_bundle_is_refused_and_migrated(path, tmp_path):
    """Every value is kept to the bit, and so is what an engine makes of it."""
    new = tmp_path / "new.h5"
    with pytest.raises(BundleError, match=r"vfplan migrate"):
        vfplan.read_fixture(path)
    before = path.read_bytes()
    content = migrate(path, new)
    assert path.read_bytes() == before
    fixture = vfplan.read_fixture(new)
    version = path.stem.partition("-")[0]
    digest = hashlib.sha256(before).hexdigest()
    assert f"migrated from {version} to 2.0, SHA-256 {digest}" in fixture.provenance.history[-1]
    assert content["/provenance/history"] == fixture.provenance.history
    assert golden.engine_sums(fixture) == SUMS[path.stem]
    if path.with_suffix(".json").exists():
        wanted = json.loads(path.with_suffix(".json").read_text())
        found = to_json_types(describe(new, values=True))
        renewed = {"version", "/@version", "seal", "/provenance/history"}
        if {"/mesh/triangles", "/pieces/vertices"} & wanted.keys():
            renewed.add("/@id")  # which covers them now
        for name in wanted.keys() - renewed:
            assert found[name] == wanted[name], name
    else:
        make = getattr(bundles, golden.MADE[path.stem.partition("-")[2]])()
        bundles.same(bundles.replace(fixture, provenance=make.provenance), make)
    with pytest.raises(InputError) as raised:
        migrate(new, tmp_path / "again.h5")
    assert raised.value.code == "no-migration-needed"


def test_the_migrated_bundle_names_who_signed_the_old_one(tmp_path):
    content = migrate(ARCHIVE / "1.0-signed.h5", tmp_path / "new.h5")
    assert "was signed by key" in content["/provenance/history"][-1]
    assert not describe(tmp_path / "new.h5")["seal"]["signed"]


def old_file(function):
    """The bytes of an old bundle without a seal, after `function` changed it."""
    stream = io.BytesIO((ARCHIVE / "0.1-everything.h5").read_bytes())
    with h5py.File(stream, "r+", libver=("v110", "v110")) as file:
        function(file)
    return stream.getvalue()


def in_old_seal(payload):
    """An HDF5 file with the seal of versions 1.0 and 1.1 in front."""
    digest = hashlib.sha256(payload).digest()
    head = struct.pack("<8sHHIQ32s", b"VFPLSEAL", 1, 0, 512, len(payload), digest)
    head = head.ljust(480, b"\0")
    return head + hashlib.sha256(head).digest() + payload


def version_2(file):
    hostile.text(file, "version", "2.0")


def link_out_of_the_file(file):
    del file["sigma"]
    file["sigma"] = h5py.ExternalLink("/etc/passwd", "/points")


def data_out_of_the_file(file):
    del file["sigma"]
    file.create_dataset("sigma", (70,), "<f8", external=[("/etc/passwd", 0, 560)])


def unknown_group(file):
    file.create_group("surprise")


def signed_and_cut(data):
    """A bundle of this version whose seal somebody removed."""
    payload = data[: -damage.SEAL]
    return seal.with_end_of_file(payload, len(payload))


def moved_pieces():
    """A bundle of version 1.1 whose lines and arcs lie 50 mm beside its points."""
    stream = io.BytesIO((ARCHIVE / "1.1-pieces.h5").read_bytes()[512:])
    with h5py.File(stream, "r+", libver=("v110", "v110")) as file:
        file["pieces/vertices"][...] = file["pieces/vertices"][...] + np.array([0.05, 0, 0])
    return in_old_seal(stream.getvalue())


LAUNDERED = {
    "lines and arcs of another curve": (moved_pieces, "unsafe.pieces"),
    "a seal removed": (lambda: SIGNED.read_bytes()[: -damage.SEAL], "corrupt.hdf5"),
    "a seal removed with care": (lambda: signed_and_cut(SIGNED.read_bytes()), "corrupt.seal"),
    "an old seal around it": (
        lambda: in_old_seal(signed_and_cut(SIGNED.read_bytes())),
        "version.major",
    ),
    "version 1.0 without its seal": (
        lambda: (ARCHIVE / "1.0-everything.h5").read_bytes()[512:],
        "corrupt.seal",
    ),
    "version 2.0 without a seal": (lambda: old_file(version_2), "corrupt.seal"),
    "a link out of the file": (lambda: old_file(link_out_of_the_file), "unsafe.link"),
    "data out of the file": (lambda: old_file(data_out_of_the_file), "unsafe.layout"),
    "an unknown group": (lambda: old_file(unknown_group), "unsafe.unknown"),
    "a flipped bit": (
        lambda: damage.flipped((ARCHIVE / "1.1-pieces.h5").read_bytes(), 9000, False),
        "corrupt.seal",
    ),
    "a cut seal": (lambda: (ARCHIVE / "1.1-pieces.h5").read_bytes()[:400], "corrupt.seal"),
}


@pytest.mark.parametrize("name", LAUNDERED)
def test_no_bundle_is_brought_in_by_migrating_what_is_left_of_it(name, tmp_path):
    make, code = LAUNDERED[name]
    (tmp_path / "old.h5").write_bytes(make())
    with pytest.raises(BundleError) as raised:
        migrate(tmp_path / "old.h5", tmp_path / "new.h5")
    assert raised.value.code == code
    assert raised.value.where.startswith(str(tmp_path / "old.h5"))
    assert not (tmp_path / "new.h5").exists()


def test_an_old_file_that_crashes_its_reader_is_an_error_as_any_other(tmp_path, monkeypatch):
    monkeypatch.setattr(migration, "JOB", "os:abort")
    with pytest.raises(BundleError, match="its reader crashed"):
        migrate(ARCHIVE / "1.1-pieces.h5", tmp_path / "new.h5")


def test_the_signed_bundle_still_verifies():
    seal = require_signature(SIGNED, KEYS, case="case 17", robot_serial="R-0042")
    assert seal.describe()["signed_utc"] == "2026-01-02T03:00:00Z"
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


def test_h5dump_sees_the_data_in_front_of_the_seal():
    program = need_program("h5dump", "hdf5-tools")
    done = subprocess.run(
        [program, "-d", "/rendering/stiffness", SIGNED], capture_output=True, text=True, check=True
    )
    assert "(0): 1000, 1000, 800" in done.stdout
