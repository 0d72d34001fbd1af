"""Sessions in, results out: what is read is what was written, and bad recordings are refused."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from types import SimpleNamespace as as_is

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refuses
from replays import write_session

from vfplan.errors import InputError, OutputError, SessionError, SettingError, VersionError
from vfplan.session.read import open_session, read_npz, read_session
from vfplan.session.result import CsvWriter, ResultWriter, TickBlock, read_result, require_fixture
from vfplan.session.session import BLOCK, SamplingReport, Session, resampled


def recording(ticks):
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, ticks))
    return time, rng.normal(0.4, 0.05, (ticks, 3))


def write_hdf5(path, items, **attributes):
    with h5py.File(path, "w") as file:
        file.update(items)
        file.attrs.update(attributes)


def write_all(folder, time, hip):
    write_hdf5(folder / "s.h5", {"time": time, "hip": hip})
    np.savez(folder / "s.npz", time=time, hip=hip)
    np.savez_compressed(folder / "packed.npz", time=time, hip=np.asfortranarray(hip))
    write_session(folder / "s.csv", as_is(time=time, hip=hip))
    return [folder / name for name in ("s.h5", "s.npz", "packed.npz", "s.csv")]


@pytest.mark.parametrize("ticks", [2, 999, BLOCK, 2 * BLOCK + 7])
def test_every_format_gives_the_same_bits(tmp_path, ticks):
    time, hip = recording(ticks)
    for path in write_all(tmp_path, time, hip):
        session = read_session(path)
        assert_array_equal(session.time, time, err_msg=path.name)
        assert_array_equal(session.hip, hip, err_msg=path.name)
        assert len(session.sha256) == 64
        assert session.frame == "robot_base"
        sizes = [len(block) for block, _ in open_session(path).blocks()]
        assert sizes == [len(time[k : k + BLOCK]) for k in range(0, ticks, BLOCK)], path.name


def test_csv_is_read_by_its_columns_and_units(tmp_path):
    (tmp_path / "s.csv").write_text("force,z,y,x,t\n9,3,2,1,0\n9,6,5,4,0.001\n")
    session = read_session(tmp_path / "s.csv", units="mm")
    assert_allclose(session.hip, [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]], rtol=1e-15)
    assert session.notes["ignored_columns"] == ["force"]
    (tmp_path / "s.csv").write_text("t,x_cm,y_cm,z_cm\n0,1,2,3\n0.001,4,5,6\n")
    assert read_session(tmp_path / "s.csv", units="cm").hip[0].tolist() == [0.01, 0.02, 0.03]


BAD_CSV = {
    "empty": ("", "table-empty"),
    "one row": ("t,x,y,z\n0,1,2,3\n", "too-few-samples"),
    "missing column": ("t,x,y\n0,1,2\n1,2,3\n", "column-missing"),
    "column twice": ("t,x,y,z,x\n0,1,2,3,4\n", "column-doubled"),
    "NaN": ("t,x,y,z\n0,1,2,3\n1,nan,2,3\n", "sample-not-finite"),
    "overflow": ("t,x,y,z\n0,1,2,3\n1,1e999,2,3\n", "sample-not-finite"),
    "too far": ("t,x,y,z\n0,1,2,3\n1,1,-1.1e6,3\n", "sample-out-of-range"),
    "no clock": ("t,x,y,z\n0,1,2,3\n1e300,1,2,3\n", "sample-out-of-range"),
    "time creeps": ("t,x,y,z\n0,1,2,3\n1e-300,1,2,3\n", "time-not-increasing"),
    "time back": ("t,x,y,z\n1,1,2,3\n0.5,1,2,3\n", "time-not-increasing"),
    "short line": ("t,x,y,z\n0,1,2,3\n1,2,3\n", "row-length"),
    "words": ("t,x,y,z\n0,1,2,3\n1,two,3,4\n", "no-number"),
    "underscore": ("t,x,y,z\n0,1,2,3\n1,1_0,3,4\n", "no-number"),
    "hexadecimal": ("t,x,y,z\n0,1,2,3\n1,0x10,3,4\n", "no-number"),
    "digits of another script": ("t,x,y,z\n0,1,2,3\n1,\u0663,3,4\n", "no-number"),
    "lone return": ("t,x,y,z\n0,1,2,3\n1.0\r5,2,3,4\n", "no-number"),
    "two separators": ("t;x;y,z\n0;1;2;3\n", "separator-ambiguous"),
    "both decimal marks": ("t;x;y;z\n0;1,5;2;3\n1;1.5;2;3\n", "decimal-ambiguous"),
    "thousands": ("t;x;y;z\n0;1,000,000;2;3\n1;1;2;3\n", "no-number"),
    "binary": ("\x00\x01\x02\n", "column-missing"),
}


@pytest.mark.parametrize("text, code", BAD_CSV.values(), ids=BAD_CSV)
def test_bad_csv_is_refused(tmp_path, text, code):
    path = tmp_path / "s.csv"
    path.write_text(text)
    with refuses(SessionError, code) as caught:
        read_session(path)
    assert caught.value.where.startswith("s.csv")


def test_bad_line_is_named(tmp_path):
    path = tmp_path / "s.csv"
    write_session(path, Session(*recording(50_000)))
    lines = path.read_text().split("\n")
    lines[40_000] = "1,2,x,4"
    path.write_text("\n".join(lines))
    with refuses(SessionError, "no-number") as caught:
        read_session(path)
    assert caught.value.where == "s.csv, line 40001"


DISORDER = {
    # name: (order of the samples, how many are swapped and doubled when they are mended)
    "doubled between blocks": ([*range(BLOCK), *range(BLOCK - 1, BLOCK + 3)], (0, 1)),
    "swapped": ([*range(500), 501, 500, *range(502, 1000)], (1, 0)),
    "a datagram": ([*range(500), *range(510, 520), *range(500, 510), *range(520, 2000)], (10, 0)),
    "late": ([*range(500), *range(501, 2000), 500], (1, 0)),
    "far too late": ([*range(500), *range(501, 70_000), 500], (0, 1)),
    "many doubled": (sorted([*range(500)] * 2), None),
    "begins again": ([*range(500), *range(400)], None),
    "many swapped": ([k ^ 1 for k in range(500)], None),
}


@pytest.mark.parametrize("order, counts", DISORDER.values(), ids=DISORDER)
def test_few_samples_out_of_order_are_mended_and_counted(tmp_path, order, counts):
    time, hip = recording(max(order) + 1)
    for path in write_all(tmp_path, time[order], hip[order]):
        if counts is None:
            with refuses(SessionError, "time-not-increasing") as refused:
                read_session(path)
            left = len(order) - max(order) - 1
            left_out = f" and leave {left} of them out" if left else ""
            assert str(refused.value).endswith(f"to sort the {len(order)} samples{left_out}")
        session = open_session(path, skip_unordered=counts is None).load()
        swapped, doubled = counts or session.notes["mended"].values()
        assert session.notes["mended"] == {"swapped": swapped, "doubled": doubled}
        assert session.ticks == len(order) - doubled
        assert np.array_equal(session.hip, hip[np.isin(time, session.time)])


def test_what_is_only_late_is_no_gap():
    draw = np.random.default_rng(9)
    even = 1e-3 * np.arange(12_000)
    steady = np.column_stack((even / 10, 0 * even, 0 * even))
    held = np.repeat(steady[::10], 10, axis=0)
    lost = np.sort(draw.permutation(12_000)[:-1200])
    late = even + 6e-4 * (np.arange(12_000) % 10 == 5)
    for time, hip, missing in (
        (even + draw.normal(scale=1e-4, size=12_000), steady, 0),
        (even + draw.uniform(-3e-4, 3e-4, 12_000), steady, 0),
        (late, steady, 0),
        (even, held, 0),
        (even[lost], steady[lost], 1200),
    ):
        report = SamplingReport()
        report.update(time, hip)
        seen = report.report()
        assert seen["missing_samples"] == pytest.approx(missing, rel=0.02)
        assert seen["changes"] == (1199 if hip is held else len(time) - 1)


THREE = {"time": np.arange(3.0), "hip": np.ones((3, 3))}
BAD_ARRAYS = [
    ({"time": np.arange(3.0)}, "dataset-missing"),
    ({**THREE, "hip": np.zeros((3, 2))}, "shape-wrong"),
    ({**THREE, "hip": np.zeros((3, 3), complex)}, "type-wrong"),
    ({"time": np.zeros(0), "hip": np.zeros((0, 3))}, "too-few-samples"),
    ({**THREE, "hip": np.full((3, 3), np.nan)}, "sample-not-finite"),
    ({**THREE, "time": np.array([object()])}, "npz-broken"),
]


@pytest.mark.parametrize("arrays, code", BAD_ARRAYS)
def test_bad_arrays_are_refused(tmp_path, arrays, code):
    np.savez(tmp_path / "s.npz", **arrays)
    with refuses(SessionError, code):
        read_session(tmp_path / "s.npz")
    if code != "npz-broken":
        write_hdf5(tmp_path / "s.h5", arrays)
        with refuses(SessionError, code):
            read_session(tmp_path / "s.h5")


def test_damaged_archives_are_refused(tmp_path):
    path = tmp_path / "packed.npz"
    time, hip = recording(500)
    np.savez_compressed(path, time=time, hip=hip)
    packed = path.read_bytes()
    encrypted, head = bytearray(packed), packed.find(b"PK\x01\x02")
    encrypted[head + 8] |= 1
    for damaged in (encrypted, packed[:200] + b"\x55" * 200 + packed[400:], packed[:900]):
        path.write_bytes(damaged)
        with refuses(SessionError, "npz-broken"):
            read_session(path)
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("time", "hip"):
            archive.writestr(name, b"raw bytes")
    with refuses(SessionError, "npz-broken"):
        read_session(path)


def test_a_file_of_apparent_size_does_not_raise_the_limits_without_end(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr("vfplan.session.read.raise_limits", lambda *more: asked.append(more))
    with (tmp_path / "s.npz").open("wb+") as file:
        file.truncate(3 << 30)
        with refuses(SessionError, "npz-broken"):
            next(read_npz(file, "m", "robot_base"))
    assert asked == [(2 << 30, 8)]


ODD_HDF5 = {
    "empty": (dict.fromkeys(THREE, h5py.Empty("f8")), "/", {}, "dataset-odd"),
    "elsewhere": ({**THREE, "hip": h5py.ExternalLink("o.h5", "/hip")}, "/", {}, "dataset-odd"),
    "a fixture": ({"points": THREE["hip"]}, "/", {"format": np.bytes_(b"vfplan-fixture")},
                  "fixture-as-session"),
    "units of hip": (THREE, "hip", {"units": "mm"}, "units-or-frame-differ"),
    "frame of hip": (THREE, "hip", {"frame": "camera"}, "units-or-frame-differ"),
    "unit of time": (THREE, "time", {"unit": "ms"}, "units-or-frame-differ"),
}  # fmt: skip


@pytest.mark.parametrize("items, where, attributes, code", ODD_HDF5.values(), ids=ODD_HDF5)
def test_an_odd_hdf5_is_refused_also_where_it_states_other_units(
    tmp_path, items, where, attributes, code
):
    write_hdf5(tmp_path / "o.h5", THREE)
    write_hdf5(tmp_path / "s.h5", items)
    with h5py.File(tmp_path / "s.h5", "a") as file:
        file[where].attrs.update(attributes)
    with refuses(SessionError, code):
        read_session(tmp_path / "s.h5")


def test_a_file_may_state_its_frame_and_units(tmp_path):
    stated = {"units": "mm", "frame": "robot_base"}
    write_hdf5(tmp_path / "s.h5", THREE, **stated)
    np.savez(tmp_path / "s.npz", **THREE, **stated)
    for name in ("s.h5", "s.npz"):
        assert read_session(tmp_path / name, units="mm").hip[0, 0] == 1e-3
        for options in ({}, {"units": "mm", "frame": "patient_lps"}):
            with refuses(SessionError, "units-or-frame-differ"):
                read_session(tmp_path / name, **options)


@pytest.mark.parametrize(
    "said", [{"frame": np.arange(500)}, {"units": ["m"]}, {"frame": [b"robot_base"]}]
)
def test_what_is_no_single_text_names_no_frame_and_one_element_is_a_text(tmp_path, said):
    np.savez(tmp_path / "s.npz", **THREE, **said)
    write_hdf5(tmp_path / "s.h5", THREE, **said)
    for name in ("s.h5", "s.npz"):
        assert len(read_session(tmp_path / name).time) == 3
        if "units" in said:
            with refuses(SessionError, "units-or-frame-differ") as refused:
                read_session(tmp_path / name, units="mm")
            assert "is 'm', and" in str(refused.value)


def test_missing_file_directory_and_unknown_unit(tmp_path):
    for read, error in ((read_session, SessionError), (read_result, InputError)):
        with refuses(error, "file-missing"):
            read(tmp_path / "none.csv")
        with refuses(error, "not-a-file"):
            read(tmp_path)
    (tmp_path / "s.csv").write_text("t,x,y,z\n0,1,2,3\n0,1,2,3\n")
    with refuses(SettingError, "unit-unknown"):
        read_session(tmp_path / "s.csv", units="inch")


@pytest.mark.parametrize("columns, code", [(2, "shape-wrong"), (3, "time-not-increasing")])
def test_session_checks_its_arrays(columns, code):
    with refuses(SessionError, code):
        Session(np.zeros(3), np.zeros((3, columns)))


@pytest.mark.parametrize("rate", [100.0, 1000.0, 1234.5])
def test_resampling_is_linear_and_does_not_depend_on_blocks(rate):
    time, hip = recording(2 * BLOCK + 100)
    session = resampled(Session(time, hip), rate).load()
    ticks = int(np.floor((time[-1] - time[0]) * rate + 1e-9)) + 1
    assert_allclose(session.time, time[0] + np.arange(ticks) / rate, rtol=1e-12)
    assert_allclose(session.hip.T, [np.interp(session.time, time, along) for along in hip.T])
    for impossible in (1e12, 0.0):
        with refuses(SettingError, "rate-out-of-range"):
            resampled(session, impossible)


def ticks_of(count):
    rng = np.random.default_rng(2)
    time, hip = recording(count)
    rows = [rng.normal(size=(count, 3)) for _ in range(3)]
    state = rng.integers(-1, 3, count).astype(np.int8)
    return TickBlock(time, hip, *rows, state, rng.random(count), rng.random(count))


@pytest.fixture
def result(tmp_path):
    """The file of a result of 20 ticks."""
    with ResultWriter(tmp_path / "r.h5", {}) as writer:
        writer.append(ticks_of(20))
    return tmp_path / "r.h5"


def test_result_file_reads_back(tmp_path):
    path = tmp_path / "r.h5"
    block = ticks_of(BLOCK + 10)
    with ResultWriter(path, {"rule": "robust", "scene": {"points": 3}, "none": None}) as writer:
        writer.append(block)
        writer.append(replace(block, time=block.time + block.time[-1] + 1))
    with h5py.File(path) as file:
        assert file.attrs["format"] == "vfplan-result"
        assert "none" not in file.attrs
        shapes = {name: d.shape for name, d in file.items()}
        assert file["state"].dtype == np.int8
    n = 2 * len(block)
    vectors = dict.fromkeys(("hip", "proxy", "normal", "force"), (n, 3))
    rows = dict.fromkeys(("time", "state", "penetration", "overlap"), (n,))
    assert shapes == vectors | rows
    found, attrs = read_result(path)
    assert attrs["rule"] == "robust"
    for name in shapes:
        once = getattr(block, name)
        again = once + once[-1] + 1 if name == "time" else once
        assert_array_equal(getattr(found, name), np.concatenate((once, again)))


SPOILED = {
    "NaN": ("force", 3, np.nan, "value-invalid"),
    "too large to square": ("proxy", 5, 1e200, "value-invalid"),
    "no state": ("state", 6, 7, "value-invalid"),
    "time back": ("time", 7, 0.0, "time-not-increasing"),
    "text": ("overlap", None, np.full(20, b"abc"), "type-wrong"),
    "cut": ("overlap", None, np.zeros(19), "shape-wrong"),
}


@pytest.mark.parametrize("name, row, value, code", SPOILED.values(), ids=SPOILED)
def test_a_result_that_no_replay_gives_is_refused(result, name, row, value, code):
    read_result(result)
    with h5py.File(result, "a") as file:
        values = file[name][:] if row is not None else value
        del file[name]  # the checksum of a chunk that is written again is right again
        if row is not None:
            values[row] = value
        file[name] = values
    with refuses(InputError, code) as found:
        read_result(result)
    assert found.value.kind == "InputError"


@pytest.mark.parametrize("record", ["{", "[]", 3])
def test_a_result_with_a_broken_record_of_its_fixture_is_refused(record):
    require_fixture({}, "ab")  # replayed from arrays
    with refuses(InputError, "record-broken"):
        require_fixture({"fixture": record}, "ab")


def test_result_is_not_overwritten_and_others_are_not_read(result):
    with refuses(OutputError, "output-exists"):
        ResultWriter(result, {})
    for name, value, kind, code in (
        ("version", "2.0", VersionError, "version"), ("format", "other", InputError, "not-a-result")
    ):  # fmt: skip
        with h5py.File(result, "a") as file:
            file.attrs[name] = value
        with refuses(kind, code) as found:
            read_result(result)
        assert value in found.value.message
    result.write_bytes(result.read_bytes()[:100])
    with refuses(InputError, "hdf5-broken") as found:
        read_result(result)
    assert found.value.kind == "InputError"
    assert found.value.message.endswith("Give a result of vfplan replay")


def test_csv_of_ticks_reads_back_to_the_same_bits(tmp_path):
    block = ticks_of(20)
    with CsvWriter(tmp_path / "r.csv") as writer:
        writer.append(block)
    rows = np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1)
    assert_array_equal(rows[:, 0], block.time)
    assert_array_equal(rows[:, 10:13], block.force)
    assert_array_equal(rows[:, 13], block.state)
    assert_array_equal(rows[:, 15], block.overlap)
