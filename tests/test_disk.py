"""Files appear whole or not at all, and only once their bytes are on the disk."""

from __future__ import annotations

import os

import pytest
from vfplan.cli.run import outputs

from vfplan.errors import OutputError


@pytest.fixture
def calls(monkeypatch):
    """What is asked of the disk, in order: ("fsync", name) and ("replace", name)."""
    seen = []
    fsync, replace = os.fsync, os.replace

    def spy_fsync(descriptor):
        seen.append(("fsync", os.path.basename(os.readlink(f"/proc/self/fd/{descriptor}"))))
        fsync(descriptor)

    def spy_replace(source, target):
        seen.append(("replace", os.path.basename(target)))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", spy_fsync)
    monkeypatch.setattr(os, "replace", spy_replace)
    return seen


def test_outputs_are_on_the_disk_before_and_after_their_rename(calls, tmp_path):
    first, second = tmp_path / "a.h5", tmp_path / "b.csv"
    with outputs(first, None, second) as (a, _, b):
        a.write_bytes(b"1")
        b.write_bytes(b"2")
        names = a.name, b.name
    wanted = [("fsync", names[0]), ("fsync", names[1])]
    wanted += [("replace", "a.h5"), ("replace", "b.csv"), ("fsync", tmp_path.name)]
    assert calls == wanted
    assert first.read_bytes() == b"1"
    assert second.read_bytes() == b"2"


def test_a_failed_fsync_leaves_the_old_files_and_nothing_else(monkeypatch, tmp_path):
    old = tmp_path / "a.h5"
    old.write_bytes(b"old")

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"), outputs(old) as (path,):
        path.write_bytes(b"new")
    assert old.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.h5"]


def test_a_folder_that_takes_no_file_is_one_clear_error(monkeypatch, tmp_path):
    def refused(*args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkstemp", refused)
    with pytest.raises(OutputError, match="Permission denied"), outputs(tmp_path / "a.h5"):
        pass
