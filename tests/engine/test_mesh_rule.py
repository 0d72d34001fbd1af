"""Which rule a mesh is rendered by when nothing is asked for, and what then stands on triangles."""

import json
from dataclasses import replace

import meshes
import numpy as np
import pytest
from conftest import ROOT
from replays import meshed

import vfplan
from vfplan.bundle.importing import refined
from vfplan.engine.proxy import MAX_TICK_TIME, best_rule, tick_time_bound
from vfplan.replaying.replay import replay
from vfplan.session.session import Session
from vfplan.stability.cases import breach, breach_by_jump, random_path
from vfplan.stability.closed_loop import engine_for
from vfplan.stability.contacts import contacts_along


@pytest.mark.parametrize("shape", [meshes.box(), meshes.sphere(0.02, 3)])
def test_a_mesh_is_rendered_from_its_triangles(shape):
    """However much finer than it need be."""
    for points, triangles in (shape, refined(*shape, 3e-3)):
        fixture = meshed(points, triangles)
        assert best_rule(fixture) == vfplan.ProxyEngine.of(fixture).rule == "exact"
    assert best_rule(meshed(*shape, axis=(0.0, 0.0, 1.0))) == "robust"


def test_ticks_too_long_for_its_triangles_leave_its_points():
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 2e-3, (900, 3))
    fixture = meshed(points, np.arange(900, dtype=np.int32).reshape(-1, 3))
    heap = replace(fixture, mesh=np.vstack([fixture.mesh, *rng.integers(0, 900, (3, 900, 3))]))
    assert tick_time_bound(heap, "exact") > MAX_TICK_TIME
    assert best_rule(heap) == "robust"


def test_of_a_ball_of_many_triangles_a_controller_leads_a_start_out_with_the_same_bits(tmp_path):
    fixture, hip = meshed(*meshes.sphere(0.01, 6)), np.array([6e-3, 1e-3, 2e-3])
    vfplan.write_fixture(fixture, tmp_path / "a.h5")
    engine = vfplan.ProxyEngine.of(fixture)
    controller = vfplan.Controller(tmp_path / "a.h5", accept_unsigned=True, accept_unreviewed=True)
    assert engine.rule == controller.rule == "robust"
    for made in (engine, controller):
        made.reset(hip)
    for _ in range(1000):
        step = engine.step(hip)
        assert np.array_equal(step.proxy, controller.step(hip).proxy)
    assert step.status == 0
    assert np.linalg.norm(step.proxy) == pytest.approx(0.015, abs=5e-5)


def test_replay_gate_and_probes_stand_on_the_triangles():
    """A box of 12 triangles has no point near the middle of its sides."""
    fixture, s = meshed(*refined(*meshes.box(), 12e-3)), np.linspace(0, 1, 400)[:, None]
    hips = (1 - s) * [0.0, 0.03, 0.0] + s * [0.0, 0.012, 0.004]
    found = replay(fixture, Session(np.arange(400) / 1000, hips)).metrics
    assert found["rule"] == "exact"
    assert found["clearance_min_m"] == pytest.approx(0.0, abs=1e-7)
    assert {engine_for(place, "exact").rule for place in contacts_along(fixture, 2)} == {"exact"}
    place = next(contacts_along(fixture, 2))
    engine = engine_for(place, "exact")
    for measure in (
        lambda: breach(engine, engine.run(random_path(place, 500))),
        lambda: breach_by_jump(place, engine, 1.0),
    ):
        engine.reset(place.start)
        assert measure() < 1e-9


CASES = sorted((ROOT / "tests" / "data" / "mesh_rest").glob("*.json"))
STILL = 400  # ticks that the HIP is held
LAST = 100  # of these, in which nothing may change


def approaches(hip, radius, count):
    """Straight ways to the HIP from `count` random places 2.5 radii away, in 51 ticks each."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        direction = rng.normal(size=3)
        start = hip + 2.5 * radius * direction / np.linalg.norm(direction)
        yield start + np.linspace(0, 1, 51)[:, None] * (hip - start)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_the_proxy_rests_where_the_hip_rests(case):
    """Three meshes on which it once did not.

    Without a stall test the proxy of the ball of 80 triangles went round a cycle of 9 micrometres
    for ever, or used up its iterations in every tick without a move.
    """
    drawn = json.loads(case.read_text())
    points, triangles = np.array(drawn["points"]), np.array(drawn["triangles"], dtype=np.int32)
    contact_radius, point_radius = drawn["contact_radius"], drawn["point_radius"]
    hip = np.array(drawn["hip"])
    engine = vfplan.ProxyEngine.on(points, triangles, contact_radius, point_radius)
    radius, band = contact_radius + point_radius, engine.parameters.band
    rests = 0
    for way in approaches(hip, radius, 120):
        if engine.distance(way[:1])[0] < 1.2 * radius:
            continue
        rests += 1
        engine.reset(way[0])
        trace = engine.run(np.vstack([way, np.repeat(hip[None], STILL, axis=0)]))
        assert (engine.distance(trace.proxy) >= radius - band - 1e-12).all()
        assert not (trace.status[-LAST:] & vfplan.Status.LIMIT).any()
        assert (trace.proxy[-LAST:] == trace.proxy[-1]).all()
    assert rests > 30
