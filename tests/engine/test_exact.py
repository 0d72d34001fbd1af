"""Rule "exact": the seven guarantees against the curve itself, and its truth in closed form.

`curves.py` draws the cases and judges them.
"""

from __future__ import annotations

from collections import Counter

import curves
import numpy as np
import pytest
from curves import R
from oracle.guarantees import Rooms

import vfplan
from vfplan import scenes
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Curve, Fixture, Pieces, Provenance, Rendering

LINE = np.array([[-0.04, 0], [0.04, 0]]), np.zeros(2), False
SLACK = 1e-13  # rounding of a distance in a scene of 2 m [m]


def in_space(flat):
    return np.column_stack([flat, np.zeros(len(flat))])


def case(seed, tally, rooms=False):
    """One curve, twelve paths: guarantees 1 to 3 in every tick, the last one held."""
    rng = np.random.default_rng(seed)
    curve = curves.curve(rng)
    parts, vertices = curves.links(curve), curve.vertices[:, :2]
    share = rng.choice([1.0, 1.0, 0.6])
    engine = vfplan.ProxyEngine.along(curve, share * R, R - share * R)
    band = engine.parameters.band
    painted = Rooms(curves.samples(curve, R / 40), R - band, np.eye(2), R / 40) if rooms else None
    proxy = vertices.mean(axis=0) + np.array([1, 0.3]) * (np.ptp(vertices) + 6 * R)
    if rng.random() < 0.15:
        proxy = vertices[rng.integers(len(vertices))] + rng.normal(size=2) * R / 2
    normal = np.array([1.0, 0])
    engine.reset([*proxy, 0])
    for _ in range(12):
        hips = curves.path(rng, proxy, normal, vertices)
        hips = np.vstack([hips, hips[-1:], hips[-1:]])
        trace = engine.run(in_space(hips))
        x = trace.proxy[:, :2]
        before = np.vstack([proxy, x[:-1]])
        out = (trace.status & vfplan.Status.INSIDE) == 0
        assert np.isfinite(trace.force).all()
        low = R - band - curves.distance(parts, x)
        grown = np.hypot(*(x - hips).T) - np.hypot(*(before - hips).T)
        tally["ticks"] += len(x)
        tally["contact"] += int((trace.state > 0).sum())
        tally["inside"] += int((out & (low > SLACK)).sum())
        tally["grown"] += int((out & (grown > band + SLACK)).sum())
        tally["limit"] += int((trace.status & vfplan.Status.LIMIT > 0).sum())
        if painted is not None:
            tally["through"] += int((out & (painted.of(before) != painted.of(x))).sum())
        if out[-3]:
            tally["rests"] += 1
            tally["restless"] += int(not np.array_equal(x[-1], x[-2]))
            tally["stuck"] += int(curves.way_left(parts, x[-1], hips[-1]) > 0.05)
        proxy, normal = x[-1], trace.normal[-1, :2]


BROKEN = "inside", "grown", "limit", "through", "restless", "stuck"


def test_never_inside_never_grows_and_rests():
    tally = Counter()
    for seed in range(40):
        case(seed, tally, rooms=seed % 4 == 0)
    print(dict(tally))  # pytest -s: the numbers of docs/algorithm.md
    assert [tally[name] for name in BROKEN] == [0] * len(BROKEN), tally
    assert tally["contact"] > 0.4 * tally["ticks"] > 1e4, tally


@pytest.mark.full
def test_never_inside_in_ten_million_ticks():
    tally = Counter()
    for seed in range(100, 15000):
        case(seed, tally)
    assert [tally[name] for name in BROKEN] == [0] * len(BROKEN), tally
    assert tally["ticks"] > 1e7, tally


@pytest.mark.parametrize("slope", 10.0 ** np.arange(-9, 1))
def test_rests_at_once_in_a_hollow_kink_however_slight(slope):
    """There the offsets meet at (0, R / cos): met from both sides, with roundings for a way."""
    bent = np.array([[-0.04, 0.04 * slope], [0, 0], [0.04, 0.04 * slope]]), np.zeros(3), False
    engine = vfplan.ProxyEngine.along(curves.pieces([bent]), R)
    for x in (-1e-2, -1e-3, 3e-3, 0.0):
        for hip in ([0.1 * x * slope, -2e-3, 0], [1e-3 * x * slope, 1e-8, 0]):
            engine.reset([x, 0.03, 0])
            trace = engine.run([hip, hip])
            best = np.hypot(hip[0], R * np.hypot(1, slope) - hip[1])
            assert (trace.status == 0).all()
            assert (trace.proxy[0] == trace.proxy[1]).all()
            assert abs(np.hypot(*(trace.proxy[0] - hip)[:2]) - best) < 1e-7 * R


def test_the_checks_find_what_samples_miss():
    """The same judge of rule "robust" on the curve's samples: it comes nearer than R."""
    curve = curves.pieces([(np.array([[0.02, 0], [-0.02, 0]]), np.ones(2), True)])
    points = in_space(curves.samples(curve, 1e-3))
    engine = vfplan.ProxyEngine(points, contact_radius=R, ignore_axis="z")
    turn = np.linspace(0, 1, 400)
    hips = in_space(0.022 * np.column_stack([np.cos(turn), np.sin(turn)]))
    engine.reset([0.03, 0, 0])
    x = engine.run(hips).proxy[:, :2]
    assert (R * (1 - 1e-7) - curves.distance(curves.links(curve), x)).max() > 1e-6


@pytest.mark.parametrize("inside", [False, True])
def test_a_ring_is_followed_as_it_is(inside):
    """Outside and in the hollow the rest is the HIP, carried to the ring's offset."""
    ring = curves.pieces([(np.array([[0.02, 0], [-0.02, 0]]), np.ones(2), True)])
    engine = vfplan.ProxyEngine.along(ring, R)
    turn = np.linspace(0.1, 14, 3000)
    round_ = in_space(np.column_stack([np.cos(turn), np.sin(turn)]))
    depth = np.linspace(1e-3, 1e-2, 3000)[:, None]
    rest = 0.015 if inside else 0.025
    engine.reset(round_[0] * (0.01 if inside else 0.03))
    trace = engine.run(round_ * (rest + (depth if inside else -depth)))
    assert np.abs(trace.proxy - rest * round_).max() < 1e-14
    assert trace.normal == pytest.approx(round_ * (-1 if inside else 1), abs=1e-9)
    assert (trace.status == 0).all()


def test_lets_go_and_slides_without_lag():
    engine = vfplan.ProxyEngine.along(curves.pieces([LINE]), R, stiffness=1000.0)
    engine.reset([0, 0.01, 0])
    pressed = engine.step([0.003, -0.002, 0.5])
    assert pressed.proxy == pytest.approx([0.003, R, 0.5], abs=1e-16)
    assert pressed.force == pytest.approx([0, 7, 0], abs=1e-12)
    assert engine.step([0.003, R, 0.1]).force == pytest.approx([0, 0, 0], abs=1e-12)
    assert engine.step([0.003, 0.0061, 0]).proxy == pytest.approx([0.003, 0.0061, 0], abs=0)


def test_scenes_of_the_study_to_a_nanometre():
    """The truth there slides in small steps, and knows nothing of roots and borders."""
    for name, route in (("wedge", "over"), ("omega", "beside"), ("corner", "floor")):
        scene = scenes.SCENES[name]()
        hips = scene.path(route, speed=0.4)
        engine = vfplan.ProxyEngine.along(scene.lines_and_arcs, R)
        engine.reset(hips[0])
        assert np.abs(engine.run(hips).proxy - scene.truth(hips, R)).max() < 1e-9


def test_a_start_inside_is_led_out_without_a_jump():
    rng = np.random.default_rng(3)
    for _ in range(20):
        curve = curves.curve(rng)
        engine = vfplan.ProxyEngine.along(curve, R, stiffness=1000.0)
        start = in_space(curve.vertices[rng.integers(len(curve.vertices)), None, :2])
        path = np.cumsum(rng.normal(size=(1500, 3)) * [2e-5, 2e-5, 0], axis=0) + start
        engine.reset(path[0])
        trace = engine.run(path)
        busy = (trace.status & vfplan.Status.INSIDE) > 0
        assert busy[0]
        last = len(busy) - int(np.argmax(busy[::-1]))
        assert last < 1400
        moved = np.hypot(*np.diff(path, axis=0)[:, :2].T)
        jump = np.linalg.norm(np.diff(trace.force, axis=0), axis=1)
        assert (jump[: last - 1] < 1000 * (R / 256 + moved[: last - 1]) + 1e-9).all()


def test_same_bits_whatever_was_before():
    rng = np.random.default_rng(5)
    curve = curves.curve(rng)
    hips = in_space(rng.normal(size=(500, 2)) * 2 * R)
    used, fresh = (vfplan.ProxyEngine.along(curve, R) for _ in range(2))
    used.run(hips[::-1])
    for engine in (used, fresh):
        engine.reset(hips[0] + [1, 0, 0])
    one, other = used.run(hips), [fresh.step(hip) for hip in hips]
    assert np.array_equal(one.proxy, [s.proxy for s in other])
    assert np.array_equal(one.force, [s.force for s in other])


def test_distance_is_to_the_curve():
    rng = np.random.default_rng(7)
    for _ in range(20):
        curve = curves.curve(rng)
        x = curve.vertices[:, :2].mean(axis=0) + rng.normal(size=(200, 2)) * 4 * R
        found = vfplan.ProxyEngine.along(curve, R).distance(in_space(x) + np.array([0, 0, 0.7]))
        assert found == pytest.approx(curves.distance(curves.links(curve), x), abs=1e-13)


def fixture(pieces, axis=(0.0, 0.0, 1.0)):
    points = pieces.vertices
    known = Curve(pieces.stroke, pieces.closed, pieces=pieces)
    rendering = Rendering(
        np.full(3, 800.0), R, 1e-5, ignore_axis=None if axis is None else np.array(axis)
    )
    record = Provenance("2026-01-01T00:00:00Z", "vfplan test")
    return Fixture("robot_base", points, record, curve=known, rendering=rendering)


def test_of_takes_the_curve_where_there_is_one():
    whole = fixture(curves.pieces([LINE]))
    assert [vfplan.ProxyEngine.of(whole, rule).rule for rule in (None, "paper", "robust")] == [
        "exact", "paper", "robust",
    ]  # fmt: skip
    engine = vfplan.ProxyEngine.of(whole)
    assert engine.distance([[0.01, 0.004, 9]])[0] == pytest.approx(0.004, abs=1e-17)
    in_depth = fixture(curves.pieces([LINE]), axis=None)
    assert vfplan.ProxyEngine.of(in_depth).rule == "robust"
    with pytest.raises(SceneError, match="needs a curve"):
        vfplan.ProxyEngine.of(in_depth, "exact")


def test_what_is_no_curve_is_refused():
    ok = curves.pieces([LINE])
    with pytest.raises(SettingError, match=r"ProxyEngine\.of"):
        vfplan.ProxyEngine(ok.vertices, rule="exact", ignore_axis="z")
    with pytest.raises(SettingError, match="planar"):
        vfplan.ProxyEngine.along(ok, ignore_axis=None)
    wrong = {
        "half circle": Pieces(ok.vertices, np.array([1.5, 0]), ok.stroke, ok.closed),
        "one of each": Pieces(ok.vertices, np.zeros(3), ok.stroke, ok.closed),
        "strokes": Pieces(ok.vertices, ok.bulges, np.array([1, 0]), np.array([False] * 2)),
        "finite": Pieces(ok.vertices * np.nan, ok.bulges, ok.stroke, ok.closed),
    }
    for said, pieces in wrong.items():
        with pytest.raises(SceneError, match=said):
            vfplan.ProxyEngine.along(pieces)
