"""Every scene of the bench against its exact proxy: who is nearer, what spacing buys, what is kept.

The same figures that `vfplan bench proxy` writes, without the clock: of `Case` and `judge`.
"""

from dataclasses import replace
from functools import cache

import pytest

from vfplan import ProxyEngine, ProxyParameters
from vfplan.bench.peers import Peer
from vfplan.bench.proxy import FULL, SPEED_M_S, Case, chosen_run, is_drawn, judge
from vfplan.bench.record import timed_ticks
from vfplan.scenes import SCENES

pytestmark = pytest.mark.slow

TOLERANCE = 1e-5
TICKS = 1500  # of the longer paths: enough to meet every feature from one side
ROUNDING = 1e-9  # what no spacing betters: flat pieces, corners, a single point [m]
every_scene = pytest.mark.parametrize("scene", FULL, ids=", ".join)


@cache  # each truth once
def case(scene):
    name, route = scene
    geometry = SCENES[name]()
    return Case(f"{name}, {route}", geometry, geometry.path(route, SPEED_M_S)[:TICKS])


def rendered(case, make, spacing=0.5e-3):
    """Errors of an engine on the case's cloud at a spacing."""
    points = replace(case.scene, spacing=spacing).points
    engine = make(points, ignore_axis=case.scene.ignore_axis)
    return judge(case, points, timed_ticks(engine, case.hips)[0].proxy, {})


def by(rule):
    return lambda points, **settings: ProxyEngine(points, rule=rule, **settings)


@every_scene
def test_robust_is_nearer_than_what_one_would_write_instead(scene, nanoflann_peer):
    robust, paper = (rendered(case(scene), by(rule)) for rule in ("robust", "paper"))
    points = case(scene).at(0.5e-3).scene.points
    settings = ProxyParameters.make(points, rule="paper", ignore_axis=case(scene).scene.ignore_axis)
    pushed, _ = Peer(f"{nanoflann_peer.command} penalty").run(points, case(scene).hips, settings)
    penalty = judge(case(scene), points, pushed, {})
    for other in (paper, penalty):
        if other is penalty and scene == ("point", "across"):
            continue  # the nearest point's ball is the truth where there is one point
        assert robust["error_rms"] < other["error_rms"]
        assert robust["force_rms_n"] < other["force_rms_n"]
    assert robust["inside_m"] < 3e-5


@every_scene
def test_errors_fall_with_the_spacing_to_a_floor(scene):
    coarse, fine = (
        rendered(case(scene), by("robust"), spacing)["followed_rms_m"] for spacing in (1e-3, 0.5e-3)
    )
    assert fine < coarse or fine < ROUNDING or scene[0] == "point"
    if scene[0] in ("circle", "sphere"):
        assert fine < coarse / 3, "the dimples' depth falls with the square of the spacing"


@every_scene
def test_the_chosen_settings_keep_the_tolerance(scene):
    here = case(scene)
    trial = chosen_run(here, TOLERANCE)
    found = trial.score(trial.run()[0])
    assert found["surface_error_m"] <= TOLERANCE
    assert found["inside_m"] <= TOLERANCE
    assert found["followed_rms_m"] <= TOLERANCE
    assert found["followed_ticks"] > 0.75 * found["ticks"]
    if is_drawn(here.scene):  # by lines and arcs: nearer by far, jumps of the truth and all
        assert found["error_rms"] < 2e-6
