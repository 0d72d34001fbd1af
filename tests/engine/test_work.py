"""The bound on a tick's work: told of every bundle, and a fixture beyond it kept from a robot."""

from dataclasses import replace

import bundles
import numpy as np
import pytest
from conftest import quick_compiler
from motion import NATIVE, compiled, output
from replays import of_lines
from scipy.spatial import cKDTree

import vfplan
from vfplan import _core
from vfplan.bundle.validation import validate
from vfplan.engine.proxy import MAX_TICK_TIME, Status, tick_time_bound
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


@pytest.mark.parametrize("make", [crowded, serrated])
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
    assert 0 < tick_time_bound(fixture) < MAX_TICK_TIME


def test_an_engine_for_a_robot_refuses_it_and_one_for_a_replay_does_not():
    with pytest.raises(SceneError, match="a tick may take"):
        vfplan.ProxyEngine.of(crowded())
    vfplan.ProxyEngine.of(crowded(), offline=True)
    with pytest.raises(SceneError, match="too many points or pieces"):
        vfplan.ProxyEngine.of(serrated())
    assert vfplan.ProxyEngine.of(serrated(), "robust").rule == "robust"
    assert vfplan.ProxyEngine.of(serrated(), offline=True).rule == "exact"


@pytest.mark.parametrize("planar", [False, True])
def test_the_bound_counts_at_least_what_is_around_any_place(planar):
    """Of one iteration a tick, five are allowed for: their points against brute force."""
    draw = np.random.default_rng(5)
    points = draw.uniform(0, 0.05, (3000, 3)) * [1, 1, 0.1]
    axis = np.array([0.0, 0, 1]) if planar else None
    table = _core.Parameters(ignore_axis=axis, max_iterations=1, stiffness=np.ones(3))
    bound = _core.tick_time_bound(points, table)
    an_iteration, columns = bound / 5, points[:, :2] if planar else points
    reach = 1.35 * 5e-3  # of the list of neighbours: 1.2 R and what it lasts
    most = cKDTree(columns).query_ball_point(columns[::10], reach, return_length=True).max()
    assert 4.5e-6 + 1.25e-9 * most <= an_iteration <= 4.5e-6 + 11.25e-9 * len(points)


def test_a_tick_stops_at_its_budget_wherever_it_is_and_goes_on_in_the_next():
    """Leaps among many points, with 10,000 iterations a tick: safe, and there in the end."""
    draw = np.random.default_rng(0)
    points = draw.uniform(-0.02, 0.02, (20_000, 3)) * [1, 1, 0.3]
    engine = vfplan.ProxyEngine(points, band=5e-5, max_iterations=10_000)
    goals = np.vstack([draw.uniform(-0.035, 0.035, (39, 3)), [0, 0.04, 0.04]])
    trace = engine.run(np.repeat(goals, 25, axis=0))
    assert (trace.status & Status.LIMIT).any()
    outside = (trace.status & Status.INSIDE) == 0
    assert cKDTree(points).query(trace.proxy[outside])[0].min() >= 5e-3 - 5e-5
    assert np.array_equal(trace.proxy[-1], goals[-1])


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """One call makes an engine of a fixture; by a second word, offline."""
    folder, flags = tmp_path_factory.mktemp("work"), ("-O0", "-DVFPLAN_NARROW")
    return compiled(folder, NATIVE / "tick_work.cpp", *flags, compiler=quick_compiler())


@pytest.mark.slow
def test_meshes_of_needles_keep_to_the_work_of_a_tick(tmp_path):
    """Inner steps, counted: discs of needles cover each other, and steps meet needles grazingly."""
    program = compiled(tmp_path, NATIVE / "needle_work.cpp", "-O1", "-DVFPLAN_NARROW")
    bound, worst = np.array([line.split() for line in output(program).splitlines()], float).T
    taken = bound <= MAX_TICK_TIME / 16e-9
    assert 7 < taken.sum() < len(taken)
    assert (worst <= bound).all()


@pytest.mark.slow
@pytest.mark.parametrize("make, options, code, says", [
    (bundles.small, [], 0, ""), (bundles.sheet, [], 0, "by its triangles"),
    (crowded, [], 2, "a tick may take"), (crowded, ["offline"], 0, ""),
    (bundles.minimal, [], 2, "without rendering parameters")])  # fmt: skip
def test_an_engine_is_made_of_a_fixture_in_one_call(make, options, code, says, program, tmp_path):
    assert says in output(program, bundles.stored(tmp_path / "a.h5", make()), *options, code=code)
