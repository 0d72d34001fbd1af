"""The bundle on disk: what is written is what is read, and nothing else is read."""

import dataclasses
import os
import sys
import time
from dataclasses import replace

import bundles
import damage
import fuzz_bundle
import h5py
import numpy as np
import pytest
from conftest import output

import vfplan
from vfplan.bundle import content
from vfplan.bundle.content import FIELDS, to_content
from vfplan.bundle.read import read_bundle
from vfplan.bundle.write import completed, to_payload
from vfplan.errors import BundleError, InputError
from vfplan.findings import doubt
from vfplan.fixture import Fixture, Pieces
from vfplan.session.result import RESULT_FORMAT


@pytest.mark.parametrize("name", [
    "minimal", "whole", "sheet", "pixels", "patient", "guided", "reviewed"])  # fmt: skip
def test_h5py_reads_the_same_values(name):
    """Two readers that share no code."""
    data = damage.sealed(to_payload(completed(to_content(getattr(bundles, name)()))))
    values, _ = read_bundle(data)
    assert damage.equal(values, damage.by_h5py(data, values))


MAKE = (bundles.minimal, bundles.whole, bundles.drawn, bundles.doubtful, bundles.reviewed)


@pytest.mark.parametrize("make", MAKE)
def test_the_same_fixture_is_read_bit_for_bit_and_gives_the_same_bytes(make, tmp_path):
    vfplan.write_fixture(make(), tmp_path / "a.h5")
    bundles.same(vfplan.read_fixture(tmp_path / "a.h5"), make())
    time.sleep(1.1)  # a time stamp would be another one
    vfplan.write_fixture(make(), tmp_path / "b.h5")
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_what_cannot_be_found_is_bad_input_and_a_foreign_file_no_bundle(tmp_path):
    for path in (tmp_path / "none.h5", tmp_path):
        with pytest.raises(InputError):
            vfplan.read_fixture(path)
    for data in (b"", b"label,u_px\n", os.urandom(5000)):
        (tmp_path / "a.h5").write_bytes(data)
        with pytest.raises(BundleError):
            vfplan.read_fixture(tmp_path / "a.h5")


def test_a_result_of_a_replay_is_named_as_such(tmp_path):
    with h5py.File(tmp_path / "result.h5", "w") as file:
        file.attrs["format"] = RESULT_FORMAT
        file["time"] = np.arange(5) / 1000
    with pytest.raises(BundleError, match="is a result of") as raised:
        vfplan.read_fixture(tmp_path / "result.h5")
    assert raised.value.code == "corrupt.seal"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e308])
@pytest.mark.parametrize("mesh", [None, np.array([[2, 3, 4]], np.int32)])
def test_a_fixture_with_a_point_that_is_not_finite_is_not_written(mesh, value, tmp_path):
    fixture = bundles.minimal()
    fixture.points[3:5, 1] = value
    if mesh is not None:
        fixture = replace(fixture, curve=None, mesh=mesh)
    with pytest.raises(InputError, match=r"not finite|allowed"):
        vfplan.write_fixture(fixture, tmp_path / "a.h5")
    assert os.listdir(tmp_path) == []


def part(name, **values):
    """A change of one part of a fixture."""
    return lambda f: replace(f, **{name: replace(getattr(f, name), **values)})


IN_METRES = doubt("odd", "extract", "Odd.", place_m=(0.0, 0.0, 0.0))
# What is done to a fixture, and the place of what is wrong, not of what follows from it.
WRONG = {
    "flat points": (lambda f: replace(f, points=f.points[:, :2]), "/points"),
    "no points": (lambda f: replace(f, points=f.points[:0]), None),
    "one sigma too few": (lambda f: replace(f, sigma=f.sigma[1:]), "/sigma"),
    "a stroke too many": (
        lambda f: part("curve", stroke=f.curve.stroke + 1)(f), "/curve/stroke"),
    "two stiffnesses": (part("rendering", stiffness=np.ones(2)), "/rendering/stiffness"),
    "a triangle of no points": (
        lambda f: replace(f, curve=None, mesh=np.int32([[0, 1, 70]])), "/mesh/triangles"),
    "an answer without a time": (
        lambda f: replace(f, findings=(replace(bundles.FINDINGS[3], answered_utc=None),
                                       bundles.FINDINGS[3])), "/findings/answered_utc"),
    "a place in metres on a slice": (
        lambda f: replace(bundles.pixels(), findings=(IN_METRES,)), "/findings/place_m"),
    "NUL": (
        lambda f: part("registration", labels=("x1\0", *f.registration.labels[1:]))(f), None),
}  # fmt: skip


@pytest.mark.parametrize("change, where", WRONG.values(), ids=WRONG)
def test_a_fixture_that_breaks_a_rule_is_refused_and_nothing_is_left(change, where, tmp_path):
    with pytest.raises(InputError) as raised:
        vfplan.write_fixture(change(bundles.whole()), tmp_path / "a.h5")
    assert where in (None, raised.value.where)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    "value, says",
    [
        (float("nan"), "the value nan"),
        (None, "the value None"),
        ([1, 2], r"the value \[1, 2\]"),
        (b"x", "the value b'x'"),
        (10**400, "an integer beyond 1.8e308"),
    ],
    ids=["nan", "nothing", "list", "bytes", "integer of 401 digits"],
)
def test_what_is_no_setting_is_told_with_its_value(value, says, tmp_path):
    fixture = part("provenance", settings={"a": value})(bundles.whole())
    with pytest.raises(InputError, match=says):
        vfplan.write_fixture(fixture, tmp_path / "a.h5")


OPENS_HDF5 = ["vfplan.bundle.write", "vfplan.session.read", "vfplan.session.result"]


@pytest.mark.parametrize("module", OPENS_HDF5)
def test_no_plugin_can_be_loaded_even_if_h5py_was_there_first(module, tmp_path):
    """A fresh process: the variable is set before h5py, and h5py is not loaded without need."""
    alone = (
        "import sys, os, vfplan; assert 'h5py' not in sys.modules;"
        f"import {module}; assert 'h5py' in sys.modules;"
        "assert os.environ['HDF5_PLUGIN_PRELOAD'] == '::'"
    )
    after = f"import h5py; import {module}; assert h5py.h5pl.size() == 0"
    for code, name in ((alone, "HDF5_PLUGIN_PRELOAD"), (after, "HDF5_PLUGIN_PATH")):
        env = os.environ | {name: "/tmp/plugins"}
        output(sys.executable, "-c", code, env=env, cwd=tmp_path)


def test_every_field_of_a_fixture_has_a_path():
    fields = set(FIELDS.values())
    assert len(fields) == len(FIELDS)
    # Written by hand.
    by_hand = {"provenance.inputs", "provenance.settings", "curve.pieces"}
    for field in dataclasses.fields(Fixture):
        part = content.PARTS.get(field.name)
        if part is None:
            assert (field.name in fields) != (field.name in ("stability", "findings")), field.name
            continue
        for inner in dataclasses.fields(part):
            name = f"{field.name}.{inner.name}"
            assert (name in fields) != (name in by_hand), name
    inner = {f"pieces.{field.name}" for field in dataclasses.fields(Pieces)}
    assert inner - fields == {"pieces.closed"}  # as of the curve


@pytest.mark.parametrize("first, count", [
    (0, 400), pytest.param(400, 100_000, marks=pytest.mark.full)])  # fmt: skip
def test_mutants_under_a_good_seal_are_refused_or_read_as_h5py_reads_them(first, count):
    """The verdicts of two readers that share no code."""
    mutants = fuzz_bundle.mutants(first, count)
    text, _ = damage.in_child(lambda: "".join(map(damage.verdict_of_two, mutants)), limit_s=3600)
    wrong = [first + i for i, verdict in enumerate(text) if verdict == "!"]
    assert not wrong, f"mutants {wrong[:20]}"
    assert len(text) == count
    assert 0.001 < text.count("=") / count < 0.9
