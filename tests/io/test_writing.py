"""Files appear whole or not at all, and only once their bytes are on the disk."""

from __future__ import annotations

import errno
import os

import pytest
from refusals import refuses
from vfplan.cli.outputs import outputs

from vfplan import read_image
from vfplan.errors import ImageError, InputError, MarkerError, OutputError, SessionError
from vfplan.io.files import read_whole
from vfplan.io.writing import move_into_place, write_whole
from vfplan.markers.correspondences import read_markers
from vfplan.robot import read_robot
from vfplan.session.read import read_session
from vfplan.vectors.read import read_vector_curve


def failing(number):
    """What a system call is on a disk that does not let it."""

    def replacement(*args, **named):
        raise OSError(number, os.strerror(number))

    return replacement


@pytest.fixture
def calls(monkeypatch):
    """What is asked of the disk, in order: ("fsync", name), ("replace", name), ("link", name)."""
    seen = []
    fsync = os.fsync

    def spy_fsync(descriptor):
        seen.append(("fsync", os.path.basename(os.readlink(f"/proc/self/fd/{descriptor}"))))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", spy_fsync)
    for what in ("replace", "link"):
        real = getattr(os, what)

        def spy(source, target, *, what=what, real=real, **given):
            seen.append((what, os.path.basename(target)))
            real(source, target, **given)

        monkeypatch.setattr(os, what, spy)
    return seen


def test_outputs_are_on_the_disk_before_and_after_their_rename(calls, tmp_path):
    first, second = tmp_path / "a.h5", tmp_path / "b.csv"
    with outputs(first, None, second) as (a, _, b):
        a.write_bytes(b"1")
        b.write_bytes(b"2")
        names = a.name, b.name
    wanted = [("fsync", names[0]), ("fsync", names[1])]
    wanted += [("link", "a.h5"), ("link", "b.csv"), ("fsync", tmp_path.name)]
    assert calls == wanted
    assert first.read_bytes() == b"1"
    assert second.read_bytes() == b"2"
    assert sorted(os.listdir(tmp_path)) == ["a.h5", "b.csv"]


def test_a_replacement_is_one_rename(calls, tmp_path):
    """Until it is on the disk, the old file has a second name."""
    (tmp_path / "a").write_bytes(b"old")
    write_whole(tmp_path / "a", [b"new"], overwrite=True)
    assert [what for what, _ in calls] == ["fsync", "link", "replace", "fsync"]
    assert calls[2:] == [("replace", "a"), ("fsync", tmp_path.name)]
    assert (tmp_path / "a").read_bytes() == b"new"
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.parametrize("links", [True, False], ids=["links", "no_links"])
def test_a_file_that_appears_meanwhile_is_not_replaced(links, monkeypatch, tmp_path):
    """Even when it comes after the last look, and on file systems without hard links."""
    target = tmp_path / "a.h5"
    fsync, link = os.fsync, os.link

    def late(descriptor):
        fsync(descriptor)
        target.write_bytes(b"theirs")

    monkeypatch.setattr(os, "fsync", late)
    monkeypatch.setattr(os, "link", link if links else failing(errno.EPERM))
    with refuses(OutputError, "output-exists"):
        write_whole(target, [b"ours"], overwrite=False)
    assert target.read_bytes() == b"theirs"
    assert os.listdir(tmp_path) == ["a.h5"]


def test_without_hard_links_files_are_written_all_the_same(monkeypatch, tmp_path):
    monkeypatch.setattr(os, "link", failing(errno.EPERM))
    write_whole(tmp_path / "a", [b"1"], overwrite=False)
    move_into_place([(tmp_path / "a", tmp_path / "b")], overwrite=False)
    (tmp_path / "a").write_bytes(b"2")
    move_into_place([(tmp_path / "a", tmp_path / "b")], overwrite=True)
    assert (tmp_path / "b").read_bytes() == b"2"
    assert os.listdir(tmp_path) == ["b"]


@pytest.mark.parametrize("overwrite", [True, False])
def test_all_of_several_files_or_none(overwrite, tmp_path):
    """The last of three has no place to go: the first two are as they were."""
    old, new, folder = (tmp_path / name for name in ("old", "new", "folder"))
    if overwrite:
        old.write_bytes(b"old")
    folder.mkdir()
    for name in "123":
        (tmp_path / name).write_bytes(b"new")
    moves = [(tmp_path / "1", old), (tmp_path / "2", new), (tmp_path / "3", folder)]
    with pytest.raises(OutputError):
        move_into_place(moves, overwrite=overwrite)
    assert sorted(set(os.listdir(tmp_path)) - {*"123"}) == ["folder"] + ["old"] * overwrite
    assert not overwrite or old.read_bytes() == b"old"


def test_the_longest_name_a_file_may_have_can_be_written(tmp_path):
    path = tmp_path / ("x" * 252 + ".h5")
    write_whole(path, [b"1"], overwrite=False)
    with refuses(OutputError, "output-exists"):
        write_whole(path, [b"2"], overwrite=False)
    assert os.listdir(tmp_path) == [path.name]


CURVES = [(read_vector_curve, end, InputError) for end in (".csv", ".mrk.json", ".fcsv", ".roi")]
READERS = [
    *CURVES, (read_image, ".png", ImageError), (read_markers, ".csv", MarkerError),
    (read_session, ".csv", SessionError), (read_session, ".bag", SessionError),
    (read_robot, ".toml", InputError),
]  # fmt: skip


@pytest.mark.parametrize("read, suffix, kind", READERS)
def test_no_reader_waits_for_a_pipe_or_reads_a_device_without_end(tmp_path, read, suffix, kind):
    pipe, device = tmp_path / f"pipe{suffix}", tmp_path / f"device{suffix}"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    for path in (pipe, device):
        with refuses(kind, "not-a-file"):
            read(path)


def test_no_more_is_read_than_allowed(tmp_path):
    path = tmp_path / "long"
    path.write_bytes(b"12345")
    assert read_whole(path, 5) == b"12345"
    with refuses(InputError, "file-too-long", max_bytes=4):
        read_whole(path, 4)
    os.truncate(path, 2**40)  # refused by its size alone
    with pytest.raises(ImageError, match="longer than"):
        read_image(path)


def failing_disk(monkeypatch, nth):
    """From the nth call on, renames, links and fsyncs fail, as on a disk that went read-only.

    Returns a list that grows by an entry a call.
    """
    calls = []
    for name in ("replace", "link", "fsync"):
        real = getattr(os, name)

        def call(*args, real=real, **named):
            calls.append(args)
            return (real if len(calls) <= nth else failing(errno.EROFS))(*args, **named)

        monkeypatch.setattr(os, name, call)
    return calls


@pytest.mark.parametrize("nth", range(9))
def test_no_old_file_is_lost_where_everything_fails_from_some_call_on(nth, tmp_path):
    """It is under its name, or under another, of which the message says one."""
    for name in ("a", "b"):
        (tmp_path / name).write_text(f"old {name}")
        (tmp_path / f"new {name}").write_text(f"new {name}")
    moves = [(tmp_path / f"new {name}", tmp_path / name) for name in ("a", "b")]
    with pytest.MonkeyPatch.context() as patch:
        calls = failing_disk(patch, nth)
        try:
            move_into_place(moves, overwrite=True)
        except OutputError as error:
            assert nth < len(calls)
            refusal = error
        else:
            assert nth >= len(calls)
            return
    texts = {path: path.read_text() for path in tmp_path.iterdir()}
    assert {"old a", "old b"} <= {*texts.values()}
    kept = [text for path, text in texts.items() if str(path) in refusal.message]
    # From the fifth call on the first file is replaced, until all is done.
    assert kept == ["old a"] * (refusal.code == "not-put-back") == ["old a"] * (nth in (4, 5, 6))
