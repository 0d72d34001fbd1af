"""Scripted sessions whose forces are known exactly, and real recordings on planned curves."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import dimple_depth
from replays import at_1_khz, fixture_of

import vfplan
from vfplan import ProxyParameters
from vfplan.geometry.lines import row_lengths, step_lengths
from vfplan.replaying.replay import replay
from vfplan.scenes import SCENES
from vfplan.scenes.god_object import follow
from vfplan.scenes.outline import Sides
from vfplan.session.read import read_session
from vfplan.session.session import Session

K = 1000.0
RC = 5e-3

SCRIPTED = (
    "sheet-front sheet-back circle-outside circle-inside sphere-outside sphere-inside corner-floor "
    "corner-wall corner-deep channel-through"
)


@pytest.mark.parametrize("name, route", [pair.split("-") for pair in SCRIPTED.split()])
def test_forces_are_those_of_the_closed_form(name, route):
    scene = SCENES[name]()
    hips = scene.path(route, speed=0.2)
    force = scene.force(hips, scene.truth(hips), K)
    chosen = ProxyParameters.make(scene.points, ignore_axis=scene.ignore_axis)
    fixture = fixture_of(scene.points, axis=chosen.ignore_axis, curve=False, band=chosen.band,
                         stiffness=K)  # fmt: skip
    found = replay(fixture, at_1_khz(hips))
    planar = scene.ignore_axis is not None
    allowed = K * (chosen.band + dimple_depth(scene.spacing, RC, planar=planar))
    off = row_lengths(found.ticks.force - force)
    assert off.max() <= allowed, f"{off.max():.4f} N at tick {off.argmax()}, {allowed:.4f} allowed"
    m = found.metrics
    exact = row_lengths(force)
    assert m["force_max_n"] == pytest.approx(exact.max(), abs=allowed)
    assert m["force_rms_n"] == pytest.approx(np.sqrt(np.mean(exact**2)), abs=allowed)
    work = (force[:-1] * np.diff(hips, axis=0)).sum()
    path = step_lengths(hips).sum()
    assert m["energy_j"] == pytest.approx(work, abs=allowed * path)
    assert m["clearance_min_m"] >= -chosen.band
    assert m["entrenched_ticks"] == 0


@pytest.mark.parametrize("depth", [5e-3, 47e-3])
def test_round_the_end_of_a_curve_the_force_falls_at_once(depth):
    """The exact proxy drops K (depth + R) in one tick; the robust one the same, a tick later."""
    x = np.arange(-250, 1) * 0.4e-3
    points = np.stack([x, 0 * x, 0 * x], axis=1)
    along = -4e-3 + 1e-4 * np.arange(80)
    press = np.stack([np.full(400, along[0]), np.linspace(0.02, -depth, 400), np.zeros(400)], 1)
    hips = np.concatenate((press, np.stack([along, 0 * along - depth, 0 * along], axis=1)))
    proxy, exact = hips[0], []
    for hip in hips:
        proxy = follow((Sides(points[:1], (points[-1:] - points[:1],)),), proxy, hip, RC)
        exact.append(K * (proxy - hip))
    found = replay(fixture_of(points, band=1e-5), at_1_khz(hips))
    falls, ticks = [], []
    for force in (np.array(exact), found.ticks.force):
        step = step_lengths(force)
        falls.append(step.max())
        ticks.append(int(step.argmax()) + 1)
    assert falls == pytest.approx([K * (depth + RC)] * 2, abs=0.025)
    assert found.metrics["force_step_max_n"] == falls[1]
    assert 0 <= ticks[1] - ticks[0] <= 1


@pytest.fixture(scope="module")
def pelvis(shared_data):
    folder = shared_data / "planned"
    names = ("pelvis_a.png", "pelvis_a_markers_image.csv", "pelvis_a_markers_robot.csv")
    return vfplan.plan(*(folder / name for name in names)).fixture


def across(recorded, fixture):
    """The recording, made on a table elsewhere, moved so that it starts off the curve and meets it.

    Tried are 40 places along the curve for the path's middle; the first good one is taken.
    """
    for place in fixture.points[:: len(fixture.points) // 40]:
        hip = recorded.hip - recorded.hip.mean(axis=0) + place
        gaps = (hip[::20, None] - fixture.points)[..., :2]  # the slice lies flat
        near = np.sqrt((gaps**2).sum(axis=2)).min(axis=1)
        if near[0] > 0.01 and near.min() < 1e-3:
            return Session(recorded.time, hip)
    raise AssertionError("no place along the curve will do")


@pytest.mark.parametrize("number", [1, 2, 3])
def test_real_recordings_on_a_planned_curve(shared_data, pelvis, number):
    recorded = read_session(shared_data / "panda_sessions" / f"recording_{number}.csv")
    both = replay(pelvis, across(recorded, pelvis), rule="both", robot=vfplan.read_robot("franka"))
    m = both.metrics
    assert m["session"]["rate_hz"] == pytest.approx(1000)
    assert m["session"]["speed_max_m_s"] < 1
    assert len(m["episodes"]) > 0
    assert m["clearance_min_m"] >= -pelvis.band - 1e-12
    assert m["inside_ticks"] == 0
    assert m["too_fast_ticks"] < 0.2 * m["contact_ticks"]
    # The proxy never left the side it came from: the hand crossed the curve, the proxy did not.
    assert m["overlap_max_m"] > 1e-3
    assert sum(e["ticks"] for e in m["episodes"]) == m["contact_ticks"]
    ends = [e["end_along"]["s_m"] for e in m["episodes"]]
    length = step_lengths(pelvis.points).sum()
    assert 0 <= min(ends) <= max(ends) <= length + 1e-9
