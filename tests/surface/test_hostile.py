"""Damaged and hostile files: refused by name, quickly, in bounded memory, whatever is in them."""

import gzip
import io
import json
import struct

import bones
import numpy as np
import pytest
from bones import BENT
from conftest import memory_below

from vfplan.errors import VfplanError
from vfplan.surface import volumes
from vfplan.surface.build import SurfaceSettings, surface

pytestmark = pytest.mark.slow

COARSE = SurfaceSettings(tolerance_m=2e-3)


@pytest.fixture(scope="module")
def zoo(tmp_path_factory):
    """One small file of each kind."""
    folder = tmp_path_factory.mktemp("zoo")
    grid = bones.Grid(np.array([-30.0, -22, -38]), np.diag([4.0, 4, 25]), (16, 11, 4))
    labels = grid.labels(BENT)
    outlines = [(ring[::20], z) for ring, z in bones.outlines(BENT, 25)]
    return {
        "rtstruct.dcm": bones.write_rtstruct(folder / "s.dcm", outlines).read_bytes(),
        "seg.dcm": bones.write_seg(folder / "g.dcm", labels, grid).read_bytes(),
        "l.seg.nrrd": bones.write_nrrd(folder / "l.nrrd", labels, grid).read_bytes(),
        "l.nii.gz": bones.write_nifti(folder / "l.nii.gz", labels, grid).read_bytes(),
        "l.nii": bones.write_nifti(folder / "l.nii", labels, grid).read_bytes(),
        "c.mrk.json": bones.write_curves(folder / "c.mrk.json", outlines, every=2).read_bytes(),
    }


def made_or_refused(path):
    """A surface, or one line that says why there is none."""
    try:
        assert np.isfinite(surface(path, settings=COARSE).fixture.points).all()
    except VfplanError as refusal:
        assert refusal.message and "\n" not in refusal.message  # noqa: PT017, PT018
        assert refusal.exit_code in (2, 3)  # noqa: PT017


@pytest.mark.parametrize(
    "kind", ["rtstruct.dcm", "seg.dcm", "l.seg.nrrd", "l.nii.gz", "l.nii", "c.mrk.json"]
)
def test_cut_and_changed_files_are_read_or_refused(kind, zoo, tmp_path):
    data, path = zoo[kind], tmp_path / kind
    path.write_bytes(data)
    assert surface(path, settings=COARSE).report["open_edges"] == 0
    rng = np.random.default_rng(6)
    for cut in (0, 1, 3, 130, len(data) // 2, len(data) - 2):
        path.write_bytes(data[:cut])
        made_or_refused(path)
    for _ in range(12):
        changed = bytearray(data)
        for at in rng.integers(0, min(len(data), 1500), 3):
            changed[at] = rng.integers(256)
        path.write_bytes(changed)
        made_or_refused(path)


def element(group, number, kind, value):
    head = struct.pack("<HH", group, number) + kind
    if kind in (b"SQ", b"OB"):
        return head + struct.pack("<HI", 0, len(value)) + value
    return head + struct.pack("<H", len(value)) + value


def refused(path, data, *codes):
    """Refused with one of these codes, with less than 100 MB taken on the way."""
    path.write_bytes(data)
    with memory_below(100e6), pytest.raises(VfplanError) as error:
        surface(path)
    assert error.value.code in codes, error.value


def test_files_that_unpack_to_more_than_they_say(zoo, tmp_path):
    head, _, _ = zoo["l.seg.nrrd"].partition(b"\n\n")
    bomb = gzip.compress(bytes(300_000_000), 1)
    refused(tmp_path / "b.nrrd", head + b"\n\n" + bomb, "unpacks-too-large")
    bomb = gzip.compress(gzip.decompress(zoo["l.nii.gz"]) + bytes(300_000_000), 1)
    refused(tmp_path / "b.nii.gz", bomb, "unpacks-too-large")


@pytest.mark.parametrize("kind", ["l.seg.nrrd", "l.nii.gz"])
def test_voxels_are_unpacked_in_a_process_of_their_own(kind, zoo, tmp_path, monkeypatch):
    monkeypatch.setattr(volumes, "decompress", pytest.fail)
    (tmp_path / kind).write_bytes(zoo[kind])
    assert surface(tmp_path / kind, settings=COARSE).report["open_edges"] == 0


def test_headers_that_promise_what_no_memory_holds(zoo, tmp_path):
    from pydicom import dcmread

    huge = zoo["l.seg.nrrd"].replace(b"sizes: 16 11 4", b"sizes: 99999 99999 99999")
    refused(tmp_path / "h.nrrd", huge, "volume-too-large")
    tight = zoo["l.seg.nrrd"].replace(b"sizes: 16 11 4", b"sizes: 800 800 800")
    refused(tmp_path / "t.nrrd", tight, "volume-too-large")
    nifti = bytearray(zoo["l.nii"])
    nifti[42:48] = struct.pack("<3h", 32000, 32000, 32000)
    refused(tmp_path / "h.nii", nifti, "volume-too-large", "volume-unreadable")
    data = dcmread(io.BytesIO(zoo["seg.dcm"]))
    data.Rows = data.Columns = 60000
    data.save_as(tmp_path / "h.dcm")
    refused(tmp_path / "h.dcm", (tmp_path / "h.dcm").read_bytes(), "volume-too-large")


def test_dicom_of_endless_elements_is_refused_before_it_is_parsed(tmp_path):
    kind = element(8, 0x16, b"UI", b"1.2.840.10008.5.1.4.1.1.481.3\0")
    items = element(0x3006, 0x20, b"SQ", 200_001 * b"\xfe\xff\x00\xe0\0\0\0\0")
    deflated = element(2, 0x10, b"UI", b"1.2.840.10008.1.2.1.99")
    for more in (items, bytes(34_000_000), deflated):
        refused(tmp_path / "i.dcm", kind + more, "dicom-costly")


def test_json_of_another_shape_is_refused(tmp_path):
    for text in ("[" * 100_000, "{}", '{"@schema": 3}', json.dumps({"@schema": "x", "markups": 1})):
        refused(tmp_path / "a.mrk.json", text.encode(), "not-json", "schema-unknown")
