"""Rule "exact": the seven guarantees against the curve itself, and its truth in closed form.

`curves.py` draws the cases and judges them.
"""

import itertools
from collections import Counter
from dataclasses import replace

import curves
import numpy as np
import pytest
from curves import R
from motion import drag, play, unbroken, unit_circle
from oracle.guarantees import Rooms
from replays import of_pieces

from vfplan import ProxyEngine, scenes
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Pieces
from vfplan.scenes.outline import in_space, unit_vectors

LINE = curves.pieces([(np.array([[-0.04, 0], [0.04, 0]]), np.zeros(2), False)])
SLACK = 1e-13  # rounding of a distance in a scene of 2 m [m]


def case(seed, tally, rooms=False):
    """One curve, twelve paths: guarantees 1 to 3 in every tick, the last one held."""
    rng = np.random.default_rng(seed)
    curve = curves.curve(rng)
    parts, vertices = curves.links(curve), curve.vertices[:, :2]
    share = rng.choice([1.0, 1.0, 0.6])
    engine = ProxyEngine.along(curve, share * R, R - share * R)
    kept = R - engine.parameters.band
    painted = Rooms(curves.samples(curve, R / 40), kept, np.eye(2), R / 40) if rooms else None
    proxy = vertices.mean(axis=0) + np.array([1, 0.3]) * (np.ptp(vertices) + 6 * R)
    if rng.random() < 0.15:
        proxy = vertices[rng.integers(len(vertices))] + rng.normal(size=2) * R / 2

    def draw(proxy, normal):
        return in_space(curves.path(rng, proxy[:2], normal[:2], vertices))

    def away(x):
        return curves.distance(parts, x[:, :2])

    paths = drag(engine, tally, draw, np.append(proxy, 0), 2, away, (SLACK, SLACK))
    for trace, hips, before, out in paths:
        x = trace.proxy[:, :2]
        if painted is not None:
            crossed = painted.of(before[:, :2]) != painted.of(x)
            tally["through"] += int((out & crossed).sum())
        if out[-3]:
            tally["rests"] += 1
            tally["restless"] += int(not np.array_equal(x[-1], x[-2]))
            tally["stuck"] += int(curves.way_left(parts, x[-1], hips[-1, :2]) > 0.05)


@pytest.mark.parametrize("seeds, ticks",
    [(range(40), 2.5e4), pytest.param(range(100, 15000), 1e7, marks=pytest.mark.full)])  # fmt: skip
def test_never_inside_never_grows_and_rests(seeds, ticks):
    tally = Counter()
    for seed in seeds:
        case(seed, tally, rooms=seed < 40 and seed % 4 == 0)
    unbroken(tally)
    assert tally["contact"] > 0.4 * tally["ticks"], tally
    assert tally["ticks"] > ticks, tally


@pytest.mark.parametrize("slope", 10.0 ** np.arange(-9, 1))
def test_rests_at_once_in_a_hollow_kink_however_slight(slope):
    """There the offsets meet at (0, R / cos): met from both sides, with roundings for a way."""
    bent = np.array([[-0.04, 0.04 * slope], [0, 0], [0.04, 0.04 * slope]]), np.zeros(3), False
    engine = ProxyEngine.along(curves.pieces([bent]), R)
    for x in (-1e-2, -1e-3, 3e-3, 0.0):
        for hip in ([0.1 * x * slope, -2e-3, 0], [1e-3 * x * slope, 1e-8, 0]):
            trace = play(engine, [hip, hip], [x, 0.03, 0])
            best = np.hypot(hip[0], R * np.hypot(1, slope) - hip[1])
            assert (trace.status == 0).all()
            assert (trace.proxy[0] == trace.proxy[1]).all()
            assert abs(np.hypot(*(trace.proxy[0] - hip)[:2]) - best) < 1e-7 * R


@pytest.mark.parametrize("inside", [False, True])
def test_a_ring_is_followed_as_it_is(inside):
    """Outside and in the hollow the rest is the HIP, carried to the ring's offset."""
    ring = curves.pieces([(np.array([[0.02, 0], [-0.02, 0]]), np.ones(2), True)])
    engine, turn = ProxyEngine.along(ring, R), np.linspace(0.1, 14, 3000)
    round_ = unit_circle(turn)
    depth, rest = np.linspace(1e-3, 1e-2, 3000)[:, None], 0.015 if inside else 0.025
    hips = round_ * (rest + (depth if inside else -depth))
    trace = play(engine, hips, round_[0] * (0.01 if inside else 0.03))
    assert np.abs(trace.proxy - rest * round_).max() < 1e-14
    assert trace.normal == pytest.approx(round_ * (-1 if inside else 1), abs=1e-9)
    assert (trace.status == 0).all()


def test_lets_go_and_slides_without_lag():
    engine = ProxyEngine.along(LINE, R)
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
        engine = ProxyEngine.along(scene.lines_and_arcs, R)
        assert np.abs(play(engine, hips).proxy - scene.truth(hips, R)).max() < 1e-9


def test_distance_is_to_the_curve():
    rng = np.random.default_rng(7)
    for _ in range(20):
        curve = curves.curve(rng)
        x = curve.vertices[:, :2].mean(axis=0) + rng.normal(size=(200, 2)) * 4 * R
        found = ProxyEngine.along(curve, R).distance(in_space(x) + np.array([0, 0, 0.7]))
        assert found == pytest.approx(curves.distance(curves.links(curve), x), abs=1e-13)


def test_of_takes_the_curve_where_there_is_one():
    whole = of_pieces(LINE)
    rules = [ProxyEngine.of(whole, rule).rule for rule in (None, "paper", "robust")]
    assert rules == ["exact", "paper", "robust"]
    engine = ProxyEngine.of(whole)
    assert engine.distance([[0.01, 0.004, 9]])[0] == pytest.approx(0.004, abs=1e-17)
    in_depth = of_pieces(LINE, axis=None)
    assert ProxyEngine.of(in_depth).rule == "robust"
    with pytest.raises(SceneError, match="needs a curve"):
        ProxyEngine.of(in_depth, "exact")


def test_what_is_no_curve_is_refused():
    with pytest.raises(SettingError, match=r"ProxyEngine\.of"):
        ProxyEngine(LINE.vertices, rule="exact", ignore_axis="z")
    with pytest.raises(SettingError, match="planar"):
        ProxyEngine.along(LINE, ignore_axis=None)
    wrong = {"half circle": {"bulges": np.array([1.5, 0])}, "one of each": {"bulges": np.zeros(3)},
        "strokes": {"stroke": np.array([1, 0]), "closed": np.array([False] * 2)},
        "finite": {"vertices": LINE.vertices * np.nan}}  # fmt: skip
    for said, change in wrong.items():
        pieces = replace(LINE, **change)
        with pytest.raises(SceneError, match=said):
            ProxyEngine.along(pieces)


@pytest.mark.parametrize("ratio", [1e2, 1e5, 1e7, 1e9])
def test_the_rule_lets_go_wherever_the_way_is_clear(ratio):
    """Round the end of a line in a few steps, at coordinates of up to `ratio` times R."""
    draw, r = np.random.default_rng(5), 1 / ratio
    for _ in range(60):
        turn, middle = draw.uniform(0, 2 * np.pi), draw.uniform(-1, 1, 2)
        along = unit_vectors(turn)
        frame = np.stack([along, [-along[1], along[0]]])

        def place(x, y, frame=frame, middle=middle):
            return np.append(middle + [x * r, y * r] @ frame, 0)

        ends = np.array([place(-100, 0), place(100, 0)])
        line = Pieces(ends, np.zeros(2), np.zeros(2, np.int32), np.array([False]))
        engine = ProxyEngine.along(line, contact_radius=r)
        x, down = 100 + draw.uniform(-2, 4), -draw.uniform(1.2, 5)
        stops = [place(99, 2), place(103, down), place(x, down)]
        engine.reset(stops[0])
        for a, b in itertools.pairwise(stops):
            engine.run(np.linspace(a, b, draw.integers(2, 9)))
        proxy = engine.run(np.tile(stops[-1], (50, 1))).proxy[-1]
        assert np.linalg.norm(proxy - stops[-1]) < 1e-3 * r
