"""`vfplan diff`: what differs between two bundles, and from which tick on it matters."""

from dataclasses import replace

import bundles
import numpy as np
import pytest
from replays import at_1_khz, write_session

import vfplan
from vfplan.replaying.link import Comparison
from vfplan.session.result import TickBlock


@pytest.fixture
def pair(tmp_path):
    one = bundles.whole()
    other = replace(one, rendering=replace(one.rendering, stiffness=np.array([1000.0, 900, 800])))
    for name, fixture in (("a", one), ("b", other)):
        vfplan.write_fixture(fixture, tmp_path / f"{name}.h5")
    return tmp_path


@pytest.fixture
def differ(vfplan_cli, pair):
    return lambda *names: vfplan_cli("diff", *names, "--json", cwd=pair)


def test_a_difference_is_named_by_its_path_and_size(vfplan_cli, pair, differ):
    run = differ("a.h5", "b.h5").fails(1)
    (found,) = run.json["differences"]
    assert found == {"path": "/rendering/stiffness", "what": "value", "count": 1,
                     "first_index": [1], "max_abs": 100.0}  # fmt: skip
    assert run.json["verdict"] == "fail"
    assert "verdict: differ\n" in vfplan_cli("diff", pair / "a.h5", pair / "b.h5").stdout


def test_parts_that_only_one_has_are_named(differ, pair):
    vfplan.write_fixture(bundles.minimal(), pair / "c.h5")
    found = differ("a.h5", "c.h5").json["differences"]
    assert {"path": "/sigma", "what": "only in A"} in found
    assert {"path": "/points", "what": "shape", "a": [70, 3], "b": [12, 3]} in found


def test_first_tick_is_the_first_row_that_differs():
    still, zero = np.zeros((5, 3)), np.zeros(5)
    a = TickBlock(np.arange(5.0), still, still, still, still, zero, zero, zero)
    proxy, force = still.copy(), still.copy()
    proxy[3], force[2] = (0, 3, 4), (5e-324, 0, 0)
    for b, first, far in ((a, None, 0.0), (replace(a, proxy=proxy), 3, 5.0),
                          (replace(a, proxy=proxy, force=force), 2, 5.0)):  # fmt: skip
        apart = Comparison()
        apart.update(a, b)
        found = apart.report()
        assert (found.get("first_difference_tick"), found["proxy_max_m"]) == (first, far)


def test_a_session_tells_when_the_difference_is_felt(differ, pair):
    """A dive onto the arc from above: free at first, pressed upon later."""
    points = bundles.whole().points
    axis = bundles.whole().rendering.ignore_axis
    along = points[20] - points[19]
    normal = np.cross(axis, along / np.linalg.norm(along))
    depth = np.linspace(-0.02, 0.004, 400)
    hip = points[20] - np.sign(normal[1]) * depth[:, None] * normal * -1
    write_session(pair / "s.csv", at_1_khz(hip))
    run = differ("a.h5", "b.h5", "s.csv").fails(1)
    a, b = (vfplan.replay(pair / f"{name}.h5", pair / "s.csv").ticks.force for name in "ab")
    assert run.json["first_tick"] == np.flatnonzero((a != b).any(axis=1))[0] > 0
    assert run.json["first_tick_time_s"] == pytest.approx(run.json["first_tick"] * 1e-3)
    assert run.json["force_max_n"] > 0
    same = differ("a.h5", "a.h5", "s.csv")
    assert (same.code, same.json["verdict"], same.json["first_tick"]) == (0, "pass", None)


def test_a_session_that_touches_neither_tests_nothing(differ, pair):
    write_session(pair / "far.csv", at_1_khz(np.linspace([5, 5, 0], [5, 5, 1e-4], 100)))
    run = differ("a.h5", "a.h5", "far.csv")
    assert (run.code, run.json["verdict"], run.json["first_tick"]) == (1, "not-tested", None)
