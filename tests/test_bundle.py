"""The bundle on disk: what is written is what is read, and nothing else is read."""

import os

import bundles
import numpy as np
import pytest

import vfplan
from vfplan.errors import BundleError, InputError, OutputError

MAKE = {"minimal": bundles.minimal, "everything": bundles.whole}


@pytest.mark.parametrize("make", MAKE.values(), ids=MAKE)
def test_what_is_written_is_read_bit_for_bit(make, tmp_path):
    vfplan.write_fixture(make(), tmp_path / "a.h5")
    bundles.same(vfplan.read_fixture(tmp_path / "a.h5"), make())


@pytest.mark.parametrize("make", MAKE.values(), ids=MAKE)
def test_the_same_fixture_gives_the_same_bytes(make, tmp_path):
    for name in ("a.h5", "b.h5"):
        vfplan.write_fixture(make(), tmp_path / name)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_an_existing_file_is_kept_unless_told_otherwise(tmp_path):
    path = tmp_path / "a.h5"
    vfplan.write_fixture(bundles.whole(), path)
    before = path.read_bytes()
    with pytest.raises(OutputError, match="exists"):
        vfplan.write_fixture(bundles.minimal(), path)
    assert path.read_bytes() == before
    vfplan.write_fixture(bundles.minimal(), path, overwrite=True)
    assert len(vfplan.read_fixture(path).points) == 12
    assert os.listdir(tmp_path) == ["a.h5"]


def test_what_cannot_be_found_is_bad_input(tmp_path):
    for path in (tmp_path / "none.h5", tmp_path):
        with pytest.raises(InputError):
            vfplan.read_fixture(path)


@pytest.mark.parametrize("data", [b"", b"label,u_px\n", os.urandom(5000)], ids=len)
def test_a_foreign_file_is_no_bundle(data, tmp_path):
    path = tmp_path / "a.h5"
    path.write_bytes(data)
    with pytest.raises(BundleError):
        vfplan.read_fixture(path)


def test_a_fixture_with_a_point_that_is_not_finite_is_not_written(tmp_path):
    fixture = bundles.minimal()
    fixture.points[3, 1] = np.nan
    with pytest.raises(InputError, match="finite"):
        vfplan.write_fixture(fixture, tmp_path / "a.h5")
    assert os.listdir(tmp_path) == []
