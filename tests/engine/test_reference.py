"""The paper's rule against closed forms, state by state, and the paper's own slips kept."""

import numpy as np
import pytest
from motion import grid

from vfplan import ProxyParameters, reference
from vfplan.errors import SettingError
from vfplan.reference import PaperProxy

RC, BAND = 5e-3, 10e-6
ORIGIN = np.zeros((1, 3))
PAR = ProxyParameters.make(ORIGIN, rule="paper")


def sheet():
    return grid(np.arange(-40, 41) * 0.5e-3, np.arange(-40, 41) * 0.5e-3)


def tick(proxy, hip, points=ORIGIN, **settings):
    engine = PaperProxy(points, **settings)
    engine.reset(proxy)
    return engine.step(hip)


@pytest.mark.parametrize("distance, state", [
    (4.9899e-3, 2), (RC - BAND, 1), (RC, 1), (RC + BAND, 1), (5.0101e-3, 0), (9.9999e-3, 0),
    (2 * RC, -1), (10.01e-3, -1)])  # fmt: skip
@pytest.mark.parametrize("rv", [0.0, 2e-3])
def test_states_are_the_lists_of_algorithm_1(distance, state, rv):
    """The proxy lies on -x, so that de is exact; bounds belong to 'in contact' and 'out'."""
    engine = PaperProxy(ORIGIN, point_radius=rv, outer_radius=2 * RC)
    edges = {RC - BAND: engine.parameters.r1, RC + BAND: engine.parameters.r2}
    edge = edges.get(distance, distance)
    engine.reset([-(edge + rv), 0, 0])
    assert engine.step([-1.0, 0, 0]).state == state


FAR = np.array([[-5.1e-3, 0, 0], [9e-3, 0, 0]])  # the first point is left, the second met
TICKS = {
    "no neighbour: to the HIP": ([0.02, 0, 0], [0.011, 0, 0], {}, -1, [0.011, 0, 0]),
    # Eq. (3): from 8 mm towards a HIP beyond the point, the proxy stops r_c from it.
    "free: to the sphere": ([8e-3, 0, 0], [-3e-3, 0, 0], {}, 0, [RC, 0, 0]),
    "free: 3-4-5 triangle": ([8e-3, 3e-3, 0], [0.0, 3e-3, 0], {}, 0, [4e-3, 3e-3, 0]),
    "free: nothing is hit": ([8e-3, 0, 0], [6e-3, 1e-3, 0], {}, 0, [6e-3, 1e-3, 0]),
    "free: past the point": ([8e-3, 0, 0], [8e-3, -6e-3, 0], {}, 0, [8e-3, -6e-3, 0]),
    "free: at rest": ([8e-3, 0, 0], [8e-3, 0, 0], {}, 0, [8e-3, 0, 0]),
    # Away from the near point, n·u > 0, and through the far one: the proxy jumps to the HIP.
    "special case 2": ([0, 0, 0], [0.03, 0, 0], {"points": FAR}, 0, [0.03, 0, 0]),
    "no special case": ([0, 0, 0], [0.03, 0, 0], {"points": FAR[1:]}, 0, [4e-3, 0, 0]),
    # Eq. (4)-(6) on one point: n is radial, u_p tangential, the step at most r1.
    "contact: near": ([RC, 0, 0], [3e-3, 2e-3, 0], {}, 1, [RC, 2e-3, 0]),
    "contact: far": ([RC, 0, 0], [3e-3, 1.0, 0], {}, 1, [RC, PAR.r1, 0]),
    "contact: slow": ([RC, 0, 0], [3e-3, 2e-3, 0], {"gain": 0.25}, 1, [RC, 0.5e-3, 0]),
    # Algorithm 3 takes d from u_p, which is 0: held for ever, since the paper says so.
    "lift off": ([0, 0, RC], [0, 0, RC + 0.06], {"points": sheet()}, 1, [0, 0, RC]),
    "lift off aslant": ([RC, 0, 0], [RC + 3e-3, 4e-3, 0], {}, 1, [RC + 2.4e-3, 3.2e-3, 0]),
    # Eq. (7) on one point: out to r_c along n whatever the HIP does.
    "entrenched": ([2e-3, 0, 0], [-1.0, 0, 0], {}, 2, [RC, 0, 0]),
}


@pytest.mark.parametrize("proxy, hip, settings, state, moved", TICKS.values(), ids=TICKS)
def test_a_tick_has_its_closed_form(proxy, hip, settings, state, moved):
    step = tick(proxy, hip, **settings)
    assert step.state == state
    exactly = 1e-15 if len(settings.get("points", ())) < 3 else 1e-12
    assert step.proxy == pytest.approx(moved, abs=exactly)
    assert step.force == pytest.approx(1000.0 * (np.array(moved) - hip), abs=1e-6)
    if "points" not in settings and state in (-1, 1):
        assert step.normal.tolist() == ([0, 0, 0] if state < 0 else [1.0, 0, 0])


def test_entrenched_lift_clears_every_entrenched_point():
    rng = np.random.default_rng(3)
    for _ in range(50):
        points = rng.uniform(-4e-3, 4e-3, (20, 3)) * [1, 1, 0.05]
        proxy = np.array([0, 0, 3e-3])
        below = np.linalg.norm(points - proxy, axis=1) < PAR.r1
        step = tick(proxy, proxy, points=points)
        assert step.state == 2
        assert np.linalg.norm(points[below] - step.proxy, axis=1).min() == pytest.approx(RC)


LINE = np.arange(-60, 61)[:, None] * 0.25e-3 * np.array([[1.0, 0, 0]])


# φ uses r, not r - r_v: with r_v >= r3 - r1 nothing weighs anything on contact.
@pytest.mark.parametrize("points, rv, proxy, normal, within", [
    *((sheet(), 0, [0.1e-3, 0.2e-3, z], [0, 0, np.sign(z)], 2e-2) for z in (RC, 3e-3, -RC)),
    (sheet(), 0, [0, 0, RC], [0, 0, 1], 1e-12), (LINE, 0, [0, 3e-3, 4e-3], [0, 0.6, 0.8], 1e-12),
    (sheet(), 6e-3, [0, 0, 11e-3], [0, 0, 0], 0),
    (sheet(), 2e-3, [0, 0, 7e-3], [0, 0, 1], 1e-12)])  # fmt: skip
def test_a_normal_is_across_a_sheet_or_line(points, rv, proxy, normal, within):
    step = tick(proxy, [0, 0, 0], points=points, point_radius=rv)
    assert step.normal == pytest.approx(normal, abs=within)


def test_normal_by_hand_from_two_points():
    """Eq. (1) and (2) with weights 1 (at r1) and φ(7.5 mm) worked out on paper."""
    r1, r3 = PAR.r1, PAR.outer_radius
    t = (7.5e-3 - r1) / (r3 - r1)
    phi = (1 + 4 * t) * (1 - t) ** 4
    expected = np.array([1.0, phi, 0]) / np.hypot(1.0, phi)
    points = np.array([[-r1, 0, 0], [0, -7.5e-3, 0]])
    found = reference.normal_vector(points, np.zeros(3), r1, r3)
    assert found == pytest.approx(expected, abs=1e-15)


def test_cancelling_normals_and_coincident_points_give_none():
    pair = np.array([[4e-3, 0, 0], [-4e-3, 0, 0]])
    step = tick([0, 0, 0], [0, 1e-3, 0], points=pair)
    assert (step.state, step.normal.tolist(), step.proxy.tolist()) == (2, [0, 0, 0], [0, 0, 0])
    on_it = tick([0, 0, 0], [0, 1e-3, 0], points=np.vstack([ORIGIN, [[0, -4e-3, 0]]]))
    assert on_it.normal.tolist() == [0, 1, 0]


@pytest.mark.parametrize("axis", ["z", [0, 0, 1], [1.0, 2.0, 3.0], "x"])
def test_ignored_axis_makes_the_fixture_infinite_along_it(axis):
    """A circle of points extruded along any axis: the same motion, shifted along it."""
    engine = PaperProxy(ORIGIN, ignore_axis=axis, stiffness=[1000, 500, 2000])
    a = engine.parameters.ignore_axis
    e = np.cross(a, [0.3, -0.5, 0.8])
    e /= np.linalg.norm(e)
    for height in (0.0, 0.4, -7.0):
        engine.reset(8e-3 * e + height * a)
        hip = -3e-3 * e + (height + 0.1) * a
        step = engine.step(hip)
        assert step.proxy == pytest.approx(RC * e + (height + 0.1) * a, abs=1e-14)
        p = np.eye(3) - np.outer(a, a)
        k = p @ np.diag([1000, 500, 2000]) @ p
        assert step.force == pytest.approx(k @ (step.proxy - hip), abs=1e-12)
        assert step.force @ a == pytest.approx(0, abs=1e-12)
        assert step.normal @ a == pytest.approx(0, abs=1e-12)


def test_what_cannot_be_rendered_is_refused():
    with pytest.raises(SettingError, match="'paper' only"):
        PaperProxy(ORIGIN, rule="robust")
