"""Guidance: a tube around the drawn curve that the guide follows locally."""

import warnings

import numpy as np
import pytest
from motion import NATIVE, K, compiled, output, sizes, unit_circle

from vfplan import Guide, Status
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Pieces


def hairpin(apart=0.01):
    """(300, 3) two straight strands joined by a half circle [m], equally spaced."""
    r, leg = apart / 2, 0.03
    s = np.linspace(0, 2 * leg + np.pi * r, 300)
    a = np.clip((s - leg) / r, 0, np.pi)
    x = np.minimum(s, leg) - np.maximum(s - leg - np.pi * r, 0) + r * np.sin(a)
    return np.column_stack([x, r - r * np.cos(a), 0 * s])


def circle(radius, n=200):
    return radius * unit_circle(np.arange(n) * 2 * np.pi / n)


def along_x(n=11):
    return np.outer(np.linspace(0, 0.1, n), [1, 0, 0])


@pytest.mark.slow
@pytest.mark.parametrize("ticks", [100_000, pytest.param(10_000_000, marks=pytest.mark.full)])
def test_a_guide_keeps_its_promises(tmp_path, ticks):
    program = compiled(tmp_path, NATIVE / "guide_ticks.cpp", "-O2")
    lines = output(program, ticks, timeout=600).splitlines()
    assert len(lines) == 22
    limits = {"beyond": 1e-9, "lines": 1e-5, "jump": K * 2e-5, "drag": 1e-3, "recede": 1e-15,
              "excess": 1e-12, "allocations": 0}  # fmt: skip
    for line in lines:
        found = {k: float(v) for k, v in (p.split() for p in line.split(": ")[1].split(", "))}
        assert all(found[name] <= limit for name, limit in limits.items()), line
        assert found["forced"] > 0.1 * ticks / 22, line


@pytest.mark.slow
@pytest.mark.full
def test_sanitizers_find_nothing(tmp_path):
    flags = ["-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    output(compiled(tmp_path, NATIVE / "guide_ticks.cpp", *flags), 50_000)


def test_force_is_zero_in_the_tube_and_a_spring_beyond():
    guide = Guide(along_x(), 1e-3, stiffness=K)
    inside = guide.step([0.03, 0.9e-3, 0])
    assert inside.force.tolist() == [0, 0, 0]
    assert inside.proxy == pytest.approx([0.03, 0.9e-3, 0])
    guide.reset([0.04, 0, 3e-3])
    beyond = guide.step([0.04, 0, 3e-3])
    assert beyond.force == pytest.approx([0, 0, -2.0])
    assert beyond.proxy == pytest.approx([0.04, 0, 1e-3])
    assert (beyond.arc_m, beyond.lateral_m, beyond.remaining_m) == pytest.approx([0.04, 3e-3, 0.06])
    assert beyond.held
    assert beyond.status == Status.OK


def test_a_hand_that_crosses_to_the_other_strand_of_a_hairpin_stays_on_its_own():
    guide, y = Guide(hairpin(), 1e-3, stiffness=K), np.linspace(0, 0.0099, 2000)
    trace = guide.run(np.column_stack([np.full_like(y, 0.01), y, 0 * y]))
    assert trace.arc_m == pytest.approx(0.01)
    assert sizes(trace.force).max() <= K * np.diff(y).max() * (1 + 1e-9)
    assert trace.force[-1] == pytest.approx([0, -K * 8.9e-3, 0])


def test_a_crossing_is_gone_through_straight_on():
    turn = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    eight = np.column_stack([0.03 * np.sin(turn), 0.02 * np.sin(2 * turn), 0 * turn])
    guide = Guide(eight, 1e-3, closed=True)
    length = guide.lengths_m[0]
    arcs = np.linspace(0.2 * length, 0.8 * length, 4000)  # through the crossing at one half
    trace = guide.run(np.add(guide.at(arcs), [0, 0, 2e-3]))
    assert np.abs(trace.arc_m - arcs).max() < 1e-6
    assert trace.force == pytest.approx(np.broadcast_to([0, 0, -1.0], (4000, 3)), abs=1e-6)


@pytest.mark.parametrize("points, closed, radius, fits, why", [
    (circle(2e-3), True, 2.1e-3, 2e-3, "turns round"),
    (hairpin(), False, 5.2e-3, 4.95e-3, "beside each other|turns round"),
    (hairpin(apart=4e-3), False, 6e-3, 2e-3, "beside each other|turns round")])  # fmt: skip
def test_a_tube_that_runs_into_itself_is_refused_with_the_place(points, closed, radius, fits, why):
    with pytest.raises(SettingError, match=rf"radius .* mm fit, as .*({why}).* at arc .* mm, \["):
        Guide(points, radius, closed)
    assert len(Guide(points, 0.97 * fits, closed).lengths_m) == 1


def test_a_bend_tighter_than_the_tube_is_refused_or_said():
    corner = np.vstack([along_x(101), [0.1, 0, 0] + along_x(101)[1:, [1, 0, 2]]])
    with pytest.raises(SettingError, match=r"radius 2 mm: at most 0\.\d+ mm fit the bends.*arc 9"):
        Guide(corner, 2e-3)
    with pytest.warns(UserWarning, match="bends more tightly at arc 9"):
        guide = Guide(corner, 2e-3, cut_bends=True)
    assert guide.tight_bend is not None
    above = corner + np.array([0, 0, 0.12])
    with pytest.raises(SettingError, match=r", 120\] mm"):
        Guide(above, 2e-3, ignore_axis="z")
    with pytest.warns(UserWarning, match=r", 120\] mm"):
        guide = Guide(above, 2e-3, cut_bends=True, ignore_axis="z")
    assert guide.at(0.0)[0] == pytest.approx(above[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Guide(circle(0.02), 1e-3, closed=True).tight_bend is None


def test_a_tick_searches_a_part_of_a_curve_that_is_as_near_everywhere():
    """In the middle of a ring with a dent that lies in another part; then within the tube."""
    ring = circle(0.1, 19_000)
    ring[9500:9550] *= 1 - 1e-6
    guide = Guide(ring, 1e-3, closed=True, hold="on_entry")
    trace = guide.run([[0, 0, 0], 0.9995 * ring[7]])
    assert trace.lateral_m == pytest.approx([0.1, 0.5e-4], rel=1e-9)
    assert (trace.held.tolist(), trace.force.any()) == ([False, True], False)


def test_a_closed_curve_goes_round_and_an_open_one_stops():
    arcs = np.linspace(0, 2.5, 3000)
    ring = Guide(circle(0.02), 1e-3, closed=True)
    length = ring.lengths_m[0]
    assert length == pytest.approx(2 * np.pi * 0.02, rel=1e-6)
    trace = ring.run(ring.at(arcs % 1 * length))
    assert np.abs((trace.arc_m - arcs * length + length / 2) % length - length / 2).max() < 1e-6
    line = Guide(along_x(), 1e-3)
    past = line.run([[0.09, 0, 0], [0.1, 0, 0], [0.103, 0, 0]])
    assert past.force[-1] == pytest.approx([-2.0, 0, 0], abs=1e-9) or past.status[-1]
    assert past.remaining_m[-1] == 0


def test_an_open_end_lets_go_without_giving_energy_and_takes_hold_again():
    guide = Guide(along_x(), 1e-3, ends="open", stiffness=K)
    out = np.linspace(0.08, 0.13, 1000)
    hips = np.column_stack([out, np.full_like(out, 3e-3), 0 * out])
    hips = np.vstack([hips, np.repeat(hips[-1:], 300, axis=0)])
    trace = guide.run(hips)
    force = np.linalg.norm(trace.force, axis=1)
    assert force[:300] == pytest.approx(2.0, abs=1e-6)
    assert force[-1] == 0
    assert not trace.held[-1]
    assert (sizes(trace.force) <= K * (sizes(hips) + 2e-5)).all()
    back = np.linspace(0.13, 0.05, 1000)
    inside = guide.run(np.column_stack([back, 0.5e-3 + 0 * back, 0 * back]))
    assert inside.held[-1]
    assert not inside.force.any()


def test_of_several_curves_the_nearest_at_the_start_is_kept():
    one, other = along_x(), np.add(along_x(), [0, 0.01, 0])
    guide = Guide([one, other], 1e-3, closed=[False, False])
    y = np.linspace(0.008, 0, 500)
    trace = guide.run(np.column_stack([0.02 + 0 * y, y, 0 * y]))
    assert (trace.stroke == 1).all()
    assert trace.force[-1] == pytest.approx([0, 9.0, 0])


def half_circles(frame=((1, 0, 0), (0, 1, 0), (0, 0, 1)), count=4):
    """A line, half a circle to the left of it, and a line back; or their first vertices."""
    vertices = np.array([[0, 0, 0], [0.03, 0, 0], [0.03, 0.01, 0], [0, 0.01, 0]]) @ np.array(frame)
    bulges = np.array([0.0, 1.0, 0.0, 0.0])
    return Pieces(vertices[:count], bulges[:count], np.zeros(count, np.int32), np.zeros(1, bool))


@pytest.mark.parametrize("tilt", [[0.0, 0, 1], [0.6, 0, 0.8]])
def test_lines_and_arcs_are_followed_as_they_are(tilt):
    """On the arc the lateral error is that of the circle, to a rounding; a corner stays one."""
    tilt = np.array(tilt)
    frame = np.stack([np.cross([0, 1, 0], tilt), [0, 1, 0], tilt])
    guide = Guide(half_circles(frame), 1e-3, ignore_axis=tilt)
    assert guide.closed == (False,)
    assert guide.lengths_m == pytest.approx([0.06 + np.pi * 5e-3], rel=1e-12)
    turn = np.linspace(-np.pi / 2, np.pi / 2, 500)
    round_ = unit_circle(turn)
    deep = 5e-3 + 2e-3 * np.cos(3 * turn)
    hips = ([0.03, 5e-3, 0] + deep[:, None] * round_) @ frame + 0.05 * tilt
    guide.reset([0.03, 0, 0] @ frame)
    trace = guide.run(hips)
    assert trace.lateral_m == pytest.approx(np.abs(deep - 5e-3), abs=1e-15)
    assert trace.arc_m == pytest.approx(0.03 + 5e-3 * (turn + np.pi / 2), abs=1e-12)
    outside = np.sign(deep - 5e-3) * np.maximum(np.abs(deep - 5e-3) - 1e-3, 0)
    assert trace.force == pytest.approx(-K * (outside[:, None] * round_) @ frame, abs=1e-9)


def test_nothing_acts_along_an_ignored_axis():
    tilt = np.array([0.6, 0.0, 0.8])
    guide = Guide(hairpin(), 1e-3, ignore_axis=tilt)
    hip = np.array([0.01, 3e-3, 0.0])
    one = guide.step(hip)
    guide.reset(hip + 0.05 * tilt)
    assert one.force == pytest.approx(guide.step(hip + 0.05 * tilt).force)
    assert one.force @ tilt == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(one.force) > 1


def test_a_lead_pulls_along_to_its_speed_and_stops_before_the_end():
    guide = Guide(along_x(), 1e-3, stiffness=K, lead_force=2.0, lead_speed=0.02)
    mass, damping, dt = 1.0, 20.0, 1e-3
    x, v, forces, speeds = np.zeros(3), np.zeros(3), [], []
    for _ in range(14000):
        force = guide.step(x).force
        v = v + dt * (force - damping * v) / mass
        x = x + dt * v
        forces.append(force)
        speeds.append(v[0])
    assert sizes(forces).max() <= K * (np.abs(speeds).max() * dt + 2e-5)
    # Balance of pull and damping: f (1 - v / v_max) = b v.
    assert np.median(speeds[:4000]) == pytest.approx(2 / (2 / 0.02 + damping), rel=0.01)
    assert max(speeds) <= 0.02
    assert 0.098 < x[0] < 0.101
    assert abs(v[0]) < 1e-4


def test_a_bad_hip_changes_nothing():
    guide = Guide(along_x(), 1e-3)
    good, bad = guide.step([0.03, 3e-3, 0]), guide.step([np.nan, 0, 0])
    assert bad.status == Status.BAD_HIP
    assert (bad.force == good.force).all()
    assert guide.step([0.03, 3e-3, 0]).force == pytest.approx(good.force)


@pytest.mark.parametrize("error, message, change", [
    (SettingError, "radius .*-1 m", {"radius": -1}),
    (SettingError, "stiffness .*0 N/m", {"stiffness": 0}),
    (SettingError, "ends .*'wrap'.*stop, open", {"ends": "wrap"}),
    (SettingError, "closed .*2 values", {"closed": [True, False]}),
    (SettingError, "lead_speed .*0 m/s", {"lead_speed": 0}),
    (SceneError, "2 points that differ", {"points": [[0, 0, 0], [0, 0, 0]]}),
    (SettingError, "radius 500 mm: at most 100 mm, the extent", {"radius": 0.5}),
    (SceneError, r"points .*\[\]", {"points": []}), (SceneError, "points .*3", {"points": 3}),
    (SceneError, r"points .*\(3,\)", {"points": [[[0, 0, 0]], [0, 0, 0]]}),
    (SettingError, r"at most 4\.9\d* mm fit, as ",
     {"points": half_circles(), "radius": 5.2e-3, "ignore_axis": "z"}),
    (SettingError, "across an ignored axis", {"points": half_circles()}),
    (SceneError, "2 points that differ", {"points": half_circles(count=1), "ignore_axis": "z"})
])  # fmt: skip
def test_bad_settings_are_refused(error, message, change):
    with pytest.raises(error, match=message):
        Guide(**({"points": along_x(), "radius": 1e-3} | change))


def test_a_strand_that_is_not_there_is_an_error():
    with pytest.raises(IndexError):
        Guide(along_x(), 1e-3).at(0.05, 1)
