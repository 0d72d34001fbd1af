"""The bound on a tick's work: told of every bundle, and a fixture beyond it kept from a robot."""

import subprocess
from dataclasses import replace

import bundles
import numpy as np
import pytest
from conftest import quick_compiler
from motion import NATIVE, compiled, grid
from replays import of_lines
from scipy.spatial import cKDTree

import vfplan
from vfplan import _core
from vfplan.bundle.validation import validate
from vfplan.engine.proxy import MAX_TICK_TIME, worst_tick_time
from vfplan.errors import SceneError


def crowded():
    """40,000 points in a ball of 10 mm: sound, and far too much for 1 kHz."""
    draw = np.random.default_rng(3)
    points = draw.normal(size=(40_000, 3))
    radius = 0.005 * draw.random((len(points), 1)) ** (1 / 3)
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    return replace(bundles.small(), points=points + 0.4)


def serrated():
    """A comb of 3,000 teeth on 20 mm, held as its lines."""
    at = np.arange(3000)
    return of_lines(np.column_stack([at * 7e-6, at % 2 * 2e-3, 0 * at]))


def patient():
    """Few points, and 10,000 iterations a tick."""
    base = bundles.small()
    return replace(base, rendering=replace(base.rendering, max_iterations=10_000))


@pytest.mark.parametrize("make", [crowded, patient, serrated])
def test_validate_and_info_tell_of_a_bundle_that_is_too_much_for_a_robot(
    make, vfplan_cli, tmp_path
):
    vfplan.write_fixture(make(), tmp_path / "a.h5")
    (issue,) = (i for i in validate(tmp_path / "a.h5") if i.code == "rendering.work")
    assert issue.severity == "warning"
    assert "a tick may take" in issue.message
    work = vfplan_cli("info", tmp_path / "a.h5", "--json").json["tick_work"]
    assert work["us"] > work["at_most_us"] == pytest.approx(1e6 * MAX_TICK_TIME)


@pytest.mark.parametrize("name", ["small", "whole", "sheet"])
def test_nothing_is_said_of_one_that_is_not(name, tmp_path):
    fixture = getattr(bundles, name)()
    vfplan.write_fixture(fixture, tmp_path / "a.h5")
    assert not [i for i in validate(tmp_path / "a.h5") if i.code == "rendering.work"]
    assert 0 < worst_tick_time(fixture) < MAX_TICK_TIME


def test_an_engine_for_a_robot_refuses_it_and_one_for_a_replay_does_not():
    with pytest.raises(SceneError, match="a tick may take"):
        vfplan.ProxyEngine.of(crowded())
    vfplan.ProxyEngine.of(crowded(), offline=True)
    with pytest.raises(SceneError, match="too many points or pieces"):
        vfplan.ProxyEngine.of(serrated())
    assert vfplan.ProxyEngine.of(serrated(), "robust").rule == "robust"
    assert vfplan.ProxyEngine.of(serrated(), offline=True).rule == "exact"


def test_the_bound_of_a_curve_counts_at_least_what_is_around_any_place():
    """Lines of a scribble against brute force: both ends of a line are features too."""
    draw = np.random.default_rng(6)
    corners = draw.normal(size=(400, 2)) * 0.02
    p = _core.Parameters(ignore_axis=np.array([0.0, 0, 1]))
    found = _core.proven_tick_work(np.column_stack([corners, np.zeros(400)]), np.zeros(400),
        np.zeros(400, np.int32), np.zeros(1, np.uint8), p)  # fmt: skip
    near = (found / 32 - 9.5e-6) / 12.5e-9
    low, high = np.minimum(corners[1:], corners[:-1]), np.maximum(corners[1:], corners[:-1])
    places = draw.normal(size=(2000, 1, 2)) * 0.02
    gap = np.maximum(np.maximum(low - places, places - high), 0)
    lines = (np.hypot(*np.moveaxis(gap, 2, 0)) <= 1.2 * 5e-3).sum(axis=1)
    joints = (np.linalg.norm(places - corners, axis=2) <= 1.2 * 5e-3).sum(axis=1)
    assert (lines + joints).max() <= near <= 799


@pytest.mark.parametrize("planar", [False, True])
def test_the_bound_counts_at_least_what_is_around_any_place(planar):
    """With one iteration less, the difference is one iteration: its points against brute force."""
    draw = np.random.default_rng(5)
    points = draw.uniform(0, 0.05, (3000, 3)) * [1, 1, 0.1]
    axis = np.array([0.0, 0, 1]) if planar else None
    few, more = (_core.Parameters(ignore_axis=axis, max_iterations=n) for n in (1, 101))
    taken = _core.proven_tick_work(points, more) - _core.proven_tick_work(points, few)
    an_iteration, columns = taken / 100, points[:, :2] if planar else points
    reach = 1.35 * 5e-3  # of the list of neighbours: 1.2 R and what it lasts
    most = cKDTree(columns).query_ball_point(columns[::10], reach, return_length=True).max()
    assert an_iteration >= 4.5e-6 + 1.25e-9 * most
    assert an_iteration <= 4.5e-6 + 1.25e-9 * len(points) + 10e-9 * len(points)


def test_what_a_search_finds_is_less_than_what_is_proven_and_the_same_in_every_run():
    """A sheet: its ticks never use all their iterations."""
    points = grid(np.arange(81) * 5e-4, np.arange(81) * 5e-4)
    p = _core.Parameters(band=1.3e-5)
    found = _core.tick_work(points, p)
    assert found == _core.tick_work(points, p)
    assert 5e-6 < found < 0.7 * _core.proven_tick_work(points, p)
    # A search does not meet the longest of such ticks.
    p = _core.Parameters(band=1.3e-5, max_iterations=100)
    assert _core.tick_work(points, p) == _core.proven_tick_work(points, p)


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """One call makes an engine of a fixture; by a second word, offline."""
    folder, flags = tmp_path_factory.mktemp("work"), ("-O0", "-DVFPLAN_NARROW")
    return compiled(folder, NATIVE / "tick_work.cpp", *flags, compiler=quick_compiler())


@pytest.mark.slow
@pytest.mark.parametrize(("make", "options", "code", "says"), [
    (bundles.small, [], 0, ""), (bundles.sheet, [], 0, "by its triangles"),
    (crowded, [], 2, "a tick may take"), (crowded, ["offline"], 0, ""),
    (bundles.minimal, [], 2, "without rendering parameters")])  # fmt: skip
def test_an_engine_is_made_of_a_fixture_in_one_call(make, options, code, says, program, tmp_path):
    vfplan.write_fixture(make(), tmp_path / "a.h5")
    words = [program, tmp_path / "a.h5", *options]
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stdout
    assert says in done.stdout
