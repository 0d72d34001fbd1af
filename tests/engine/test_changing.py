"""A fixture exchanged or edited under the hand: side kept, force bounded, as one made afresh."""

import itertools

import numpy as np
import pytest
from motion import even, grid, play, same, sizes, turned

import vfplan
from vfplan import Status
from vfplan.errors import SceneError

K, R, BAND = 1000.0, 5e-3, 5e-5


def sheet(z=0.0, half=20e-3, spacing=1e-3, hole=0.0):
    points = grid(even(half, spacing), even(half, spacing), z)
    return points[np.hypot(*points[:, :2].T) >= hole]


def engine(points, **settings):
    return vfplan.ProxyEngine(points, **{"band": BAND, **settings})


def along(ends, **settings):
    """Rule "exact" on one line."""
    line = vfplan.fixture.Pieces(np.array(ends), np.zeros(2), np.array([0, 0]), np.array([False]))
    return vfplan.ProxyEngine.along(line, **settings)


def pressed(points=None, depth=2e-3):
    """An engine whose proxy the hand has pressed against a sheet; the HIP's last place."""
    e = engine(sheet() if points is None else points)
    path = np.linspace([0, 0, 8e-3], [0, 0, -depth], 300)
    e.run(path)
    return e, path[-1]


def led(e, hips, last, k=K, r=R, before=None):
    """Steps along `hips`, each force within K (R/256 + |step of the HIP|) of the one before."""
    hips = np.asarray(hips)
    before = hips[0] if before is None else before
    first = e.step(hips[0])
    rest = e.run(hips[1:])
    force = np.vstack((last, first.force, rest.force))
    changing = np.concatenate(([True], rest.status & Status.CHANGING > 0))
    changing[1:] |= np.concatenate(([first.status & Status.CHANGING > 0], changing[1:-1]))
    allowed = np.maximum(k * (r / 256 + sizes(hips, before)), np.linalg.norm(last) / 90)
    allowed *= 1 + 1e-9
    assert (sizes(force) <= allowed)[changing].all()
    return first, rest


def test_an_exchange_does_not_pop_through():
    """A plan moved by 0.3 mm under a hand 7 N deep: an engine made anew would turn the force."""
    e, h = pressed()
    before = e.step(h).force
    assert before == pytest.approx([0, 0, 7.0], abs=0.06)
    e.exchange(engine(sheet(0.3e-3)))
    first, rest = led(e, np.tile(h, (600, 1)), before)
    assert first.status & Status.INSIDE
    assert first.status & Status.CHANGING
    assert rest.force[-1] == pytest.approx([0, 0, 7.3], abs=0.06)
    assert rest.status[-1] == e.status == Status.OK
    assert (rest.proxy[:, 2] > 4.9e-3).all()


def test_a_hole_that_opens_lets_the_force_go_slowly():
    """6 mm open under the proxy; an engine made anew would drop 2 N in one tick."""
    e, h = pressed(depth=-3e-3)
    before = e.step(h).force
    e.exchange(engine(sheet(hole=6e-3)))
    _, rest = led(e, np.tile(h, (300, 1)), before)
    assert not rest.force[-1].any()
    changing = np.count_nonzero(rest.status & Status.CHANGING)
    assert changing == pytest.approx(90, abs=3), "the force is gone within 0.1 s"


@pytest.mark.parametrize("k, other", [(3000, 100), (1000, 1), (1, 1000), (1000, 1e6)])
def test_whatever_the_stiffnesses_the_force_goes_in_small_steps_and_ends_in_free_space(k, other):
    e, h = pressed()
    e.exchange(engine(sheet(), stiffness=k))
    before = e.run(np.tile(h, (2000, 1))).force[-1]
    e.exchange(engine(sheet(), stiffness=other))
    away = np.add(h, [0, 0, 50e-3])
    path = np.vstack((np.tile(h, (5, 1)), np.linspace(h, away, 50), np.tile(away, (95, 1))))
    force = e.run(path).force
    assert sizes(force, before).max() <= 1 + 1e-9
    assert sizes(force[:5], before).max() <= max(k, other) * R / 256 * (1 + 1e-9)
    assert not force[-1].any(), "gone within 0.1 s of a clear way"


@pytest.mark.parametrize("seed", range(6))
def test_whatever_is_exchanged_for_whatever_the_force_is_bounded_and_the_side_kept(seed):
    draw = np.random.default_rng(seed)
    e, h = pressed(depth=0.5e-3)
    last = e.step(h)
    stiffest = K
    for _ in range(25):
        k, r = draw.uniform(300, 2000), draw.uniform(3e-3, 7e-3)
        z = draw.uniform(-1e-3, 1e-3)
        settings = {"stiffness": k, "contact_radius": r, "band": 5e-2 * r}
        kind = draw.integers(4)
        if kind == 0:
            ends = [[-1, 0, z], [1, 0, z]]
            other = along(ends, contact_radius=r, stiffness=k, ignore_axis=[0, 1, 0])
        else:
            axis = {"ignore_axis": [0, 1, 0]} if kind == 1 else {}
            rule = "paper" if kind == 2 else "robust"
            settings |= {"stiffness": [k, 0.5 * k, 0.8 * k]} if kind == 3 else {}
            other = engine(sheet(z), rule=rule, **settings, **axis)
        e.exchange(other)
        n = int(draw.integers(1, 400))
        to = [*draw.uniform(-6e-3, 6e-3, 2), draw.uniform(-2e-3, 1e-3)]
        hips = np.linspace(h, to, n + 1)[1:]
        stiffest = max(stiffest, k)  # of all that the force may still be on its way from
        _, rest = led(e, hips, last.force, stiffest, r, h)
        h = hips[-1]
        last = e.step(h)
        for proxy, status in ((rest.proxy, rest.status), (last.proxy[None], [int(last.status)])):
            if kind != 2 and len(proxy):
                out = (np.asarray(status) & Status.INSIDE) == 0
                assert (e.distance(proxy)[out] >= r * 0.95 - 1e-9).all()
            assert (proxy[:, 2] > z).all()


def wall(kind, turn, height):
    """A plane by one of three rules, turned, and shifted along its normal."""
    shift, axis = height * turn[:, 2], [0, 1, 0]
    if kind == 0:
        return engine(sheet(half=40e-3) @ turn.T + shift)
    ends = np.array([[-60e-3, 0, 0], [60e-3, 0, 0]])
    if kind == 1:
        return engine(np.linspace(*ends, 240) @ turn.T + shift, ignore_axis=axis)
    return along(ends @ turn.T + shift, ignore_axis=axis)


@pytest.mark.parametrize("seed", range(8))
def test_a_plan_moved_over_the_proxy_pushes_it_out_on_its_own_side(seed):
    """By up to 3 R and 17 degrees; past its middle the shortest way out would lead beyond."""
    draw, past = np.random.default_rng(seed), 0
    for i in range(36):
        y = np.array([0, 1.0, 0])
        turn = turned(y, draw.uniform(-3, 3))
        e, up, deep = wall(i % 3, turn, 0), turn[:, 2], draw.uniform(0, 4e-3)
        e.run(np.linspace(8e-3, -deep, 100)[:, None] * up)
        last, axis = e.step(-deep * up), y if i % 3 else draw.normal(size=3)
        turn, height = turned(axis, draw.uniform(-0.3, 0.3)) @ turn, draw.uniform(-3 * R, 3 * R)
        over = turn[:, 2] @ last.proxy - height
        if BAND - R < over < R:  # else its place is free
            e.exchange(wall(i % 3, turn, height))
            _, rest = led(e, np.tile(-deep * up, (1200, 1)), last.force)
            assert not (rest.status & Status.CROSSED).any()
            assert not rest.status[-1]
            assert (rest.proxy @ turn[:, 2] - height)[-1] >= R - BAND
            past += over < 0
    assert past >= 2


@pytest.mark.parametrize("ticks", [2, 5, 40])
@pytest.mark.parametrize("kind", range(3))
def test_walls_exchanged_in_quick_succession_keep_the_side(kind, ticks):
    """6, 3 and 3 mm on: the last lies beyond the proxy that the others push out."""
    e, up, hip = wall(kind, np.eye(3), 0), np.array([0, 0, 1.0]), np.array([0, 0, -1e-3])
    e.run(np.linspace(8e-3, -1e-3, 100)[:, None] * up)
    last = e.step(hip).force
    for height in (6e-3, 9e-3, 12e-3):
        e.exchange(wall(kind, np.eye(3), height))
        _, rest = led(e, np.tile(hip, (ticks, 1)), last)
        assert not (rest.status & Status.CROSSED).any()
        last = rest.force[-1]
    _, rest = led(e, np.tile(hip, (2000, 1)), last)
    assert not rest.status[-1]
    assert rest.proxy[-1, 2] == pytest.approx(12e-3 + R, abs=2 * BAND)


def test_where_no_free_way_is_left_it_is_told():
    """A room that is filled: out through what was its wall."""
    g, side = np.linspace(-9e-3, 9e-3, 37), np.full(37, 9e-3)
    pairs = ((g, side), (g, -side), (side, g), (-side, g))
    room = np.concatenate([np.stack(pair, 1) for pair in pairs])
    e = engine(np.insert(room, 1, 0, axis=1), ignore_axis=[0, 1, 0])
    e.run(np.linspace([0, 0, 0], [1e-3, 0, 3e-3], 50))
    e.exchange(engine(grid(g, g)[:, [1, 2, 0]], ignore_axis=[0, 1, 0]))
    trace = e.run(np.tile([1e-3, 0, 3e-3], (1500, 1)))
    told = trace.status & Status.CROSSED > 0
    assert told.sum() > 100
    assert (trace.status[told] & Status.INSIDE > 0).all()
    assert not trace.status[-1]
    assert np.abs(trace.proxy[-1]).max() > 13e-3


def test_an_engine_that_was_stepped_and_is_given_to_a_fresh_one_begins_at_the_first_hip():
    given, fresh = pressed(depth=-4e-3)[0], engine(sheet())
    given.exchange(engine(sheet(4e-3)))
    fresh.exchange(given)
    first = fresh.step([0, 0, 0.05])
    assert (first.proxy[2], *first.force) == (0.05, 0, 0, 0)


def test_an_engine_given_away_is_spent_and_a_bad_hip_holds_the_force():
    e, h = pressed()
    before, other = e.step(h).force, engine(sheet(-1e-3))
    e.exchange(other)
    for act, given in ((other.step, h), (e.exchange, other)):
        with pytest.raises(RuntimeError, match="in exchange"):
            act(given)
    bad = e.step([np.nan, 0, 0])
    assert bad.status & Status.BAD_HIP
    assert np.array_equal(bad.force, before)
    led(e, np.tile(h, (100, 1)), before)
    assert e.parameters is other.parameters


@pytest.mark.parametrize("n", [400, 40_000])
def test_after_any_edits_the_answer_is_a_fresh_engines(n):
    """Within the band before the cloud is made anew, to the bit after it."""
    draw, half = np.random.default_rng(n), 0.5e-3 * np.sqrt(n)
    side = np.arange(-half, half, 1e-3)
    points = grid(side, side)
    points[:, 2] = 0.3e-3 * np.sin(200 * points[:, 0])
    e, start = engine(points), [0, 0, 8e-3]
    e.run(np.linspace(start, [0, 0, 2e-3], 100))
    alive, number = dict(enumerate(points)), len(points)
    for _ in range(12):
        gone = draw.choice(list(alive), 30, replace=False)
        new = np.vstack([alive[i] for i in gone]) + draw.normal(0, 2e-6, (30, 3))
        e.edit(remove=gone, add=new)
        assert e.step([0, 0, 2e-3]).status & Status.CHANGING
        for i in gone:
            del alive[i]
        alive.update(zip(range(number, number + 30), new, strict=True))
        number += 30
    left = np.array(list(alive.values()))
    e.run(np.tile([0, 0, 2e-3], (300, 1)))
    hips = draw.uniform([-15e-3, -15e-3, 0], [15e-3, 15e-3, 7e-3], (40, 3))
    assert np.array_equal(e.distance(hips), engine(left).distance(hips))
    way = np.concatenate([np.linspace(a, b, 60) for a, b in itertools.pairwise(hips)])
    one, other = e.run(way), play(engine(left), way, e.step(way[0]).proxy)
    assert np.abs(one.proxy - other.proxy).max() <= 2 * BAND
    e.native.remake()
    at = e.step(way[0])
    e.run(np.tile(way[0], (100, 1)))
    same(play(e, way, at.proxy), play(engine(left), way, at.proxy))


def test_points_burred_away_under_the_proxy_let_it_in_and_put_back_lead_it_out():
    points = sheet(half=80e-3)
    e, h = pressed(points, depth=-2e-3)
    before = e.step(h).force
    gone = np.flatnonzero(np.hypot(points[:, 0], points[:, 1]) < 8e-3)
    assert e.edit(remove=gone)
    _, rest = led(e, np.tile(h, (400, 1)), before)
    assert not rest.force[-1].any()
    assert np.array_equal(rest.proxy[-1], h)
    assert e.edit(add=points[gone])
    _, rest = led(e, np.tile(h, (800, 1)), np.zeros(3))
    assert rest.status[0] & Status.INSIDE
    assert rest.status[-1] == Status.OK
    assert np.linalg.norm(rest.force[-1]) == pytest.approx(3.0, abs=0.06)


def test_what_cannot_be_edited_is_refused_and_changes_nothing():
    e = engine(sheet(half=3e-3))
    for remove, add, says in (
        ([49], None, "each a point that is there, once"),
        ([3, 3], None, "each a point that is there, once"),
        (list(range(49)), None, "at least one point"),
        ([0.5], None, "integers"),
        ([-1], None, "each a point that is there, once"),
        (None, [[np.nan, 0, 0]], "finite"),
        (None, [[0, 0]], r"\(N, 3\)"),
    ):
        with pytest.raises(SceneError, match=says):
            e.edit(remove=remove, add=add)
    crowd = np.random.default_rng(1).uniform(-5e-4, 5e-4, (1100, 3))
    with pytest.raises(SceneError, match="so many points in one place"):
        e.edit(add=crowd)
    assert e.edit(remove=range(48))
    assert e.edit(add=[[0, 0, 1.0]])
    with pytest.raises(SceneError, match="once"):
        e.edit(remove=[0])
    assert e.edit(remove=[48])
    e.step([0, 0, 0.5])
    assert e.distance([[0, 0, 0.5]]) == pytest.approx([0.5])
