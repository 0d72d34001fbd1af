"""The paper's rule against closed forms, state by state, and the paper's own slips kept."""

import numpy as np
import pytest

from vfplan import ProxyParameters, Status, reference
from vfplan.errors import SceneError, SettingError
from vfplan.reference import PaperProxy

RC, BAND = 5e-3, 10e-6
ORIGIN = np.zeros((1, 3))
PAR = ProxyParameters.make(ORIGIN, rule="paper")


def sheet(h=0.5e-3, half=40):
    x, y = np.meshgrid(np.arange(-half, half + 1) * h, np.arange(-half, half + 1) * h)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def tick(proxy, hip, points=ORIGIN, **settings):
    engine = PaperProxy(points, **settings)
    engine.reset(proxy)
    return engine.step(hip)


def test_without_a_reset_the_first_hip_is_the_first_proxy():
    step = PaperProxy(ORIGIN).step([1.0, 0, 0])
    assert step.proxy.tolist() == [1.0, 0, 0]
    assert step.force.tolist() == [0.0, 0, 0]


def test_no_neighbour_takes_the_proxy_to_the_hip():
    step = tick([0.02, 0, 0], [0.011, 0, 0])
    assert (step.state, step.proxy.tolist(), step.normal.tolist()) == (-1, [0.011, 0, 0], [0, 0, 0])


@pytest.mark.parametrize(
    ("distance", "state"),
    [
        (4.9899e-3, 2),
        (RC - BAND, 1),
        (RC, 1),
        (RC + BAND, 1),
        (5.0101e-3, 0),
        (9.9999e-3, 0),
        (2 * RC, -1),
        (10.01e-3, -1),
    ],
)
@pytest.mark.parametrize("rv", [0.0, 2e-3])
def test_states_are_the_lists_of_algorithm_1(distance, state, rv):
    """The proxy lies on -x, so that de is exact; bounds belong to 'in contact' and 'out'."""
    engine = PaperProxy(ORIGIN, point_radius=rv, outer_radius=2 * RC)
    edge = {RC - BAND: engine.parameters.r1, RC + BAND: engine.parameters.r2}.get(
        distance, distance
    )
    engine.reset([-(edge + rv), 0, 0])
    assert engine.step([-1.0, 0, 0]).state == state


def test_free_motion_stops_at_the_contact_sphere():
    """Eq. (3): from 8 mm towards a HIP beyond the point, the proxy stops r_c from it."""
    step = tick([8e-3, 0, 0], [-3e-3, 0, 0])
    assert step.state == 0
    assert step.proxy == pytest.approx([RC, 0, 0], abs=1e-15)
    assert step.force == pytest.approx([8.0, 0, 0])  # 1000 N/m x 8 mm
    oblique = tick([8e-3, 3e-3, 0], [0.0, 3e-3, 0]).proxy
    assert oblique == pytest.approx([4e-3, 3e-3, 0], abs=1e-15)  # 3-4-5 triangle


def test_free_motion_goes_all_the_way_when_nothing_is_hit():
    for hip in ([6e-3, 1e-3, 0], [8e-3, -6e-3, 0]):
        assert tick([8e-3, 0, 0], hip).proxy == pytest.approx(hip, abs=1e-17)


def test_free_motion_at_rest_stays():
    assert tick([8e-3, 0, 0], [8e-3, 0, 0]).proxy.tolist() == [8e-3, 0, 0]


def test_special_case_two_detaches_without_a_look():
    """Away from the near point, n·u > 0, and through the far one: the proxy jumps to the HIP."""
    points = np.array([[-5.1e-3, 0, 0], [9e-3, 0, 0]])
    step = tick([0.0, 0, 0], [0.03, 0, 0], points=points)
    assert step.state == 0
    assert step.proxy == pytest.approx([0.03, 0, 0], abs=1e-17)
    kept = tick([0.0, 0, 0], [0.03, 0, 0], points=points[1:])
    assert kept.proxy == pytest.approx([4e-3, 0, 0], abs=1e-17)


def test_contact_slides_along_the_tangent_plane():
    """Eq. (4)-(6) on one point: n is radial, u_p tangential, the step at most r1."""
    near = tick([RC, 0, 0], [3e-3, 2e-3, 0])
    assert near.state == 1
    assert near.normal.tolist() == [1.0, 0, 0]
    assert near.proxy == pytest.approx([RC, 2e-3, 0], abs=1e-17)
    far = tick([RC, 0, 0], [3e-3, 1.0, 0])
    assert far.proxy == pytest.approx([RC, PAR.r1, 0], abs=1e-17)
    slow = tick([RC, 0, 0], [3e-3, 2e-3, 0], gain=0.25)
    assert slow.proxy == pytest.approx([RC, 0.5e-3, 0], abs=1e-17)


def test_contact_lift_off_along_the_normal_is_held_for_ever():
    """Algorithm 3 takes d from u_p, which is 0: kept, since the paper says so."""
    step = tick([0, 0, RC], [0, 0, RC + 0.06], points=sheet())
    assert step.proxy == pytest.approx([0, 0, RC], abs=1e-12)
    assert step.force == pytest.approx([0, 0, -60.0], abs=1e-6)


def test_contact_lift_off_aslant_goes_by_the_tangential_length():
    hip = [RC + 3e-3, 4e-3, 0]
    assert tick([RC, 0, 0], hip).proxy == pytest.approx([RC + 4e-3 * 0.6, 4e-3 * 0.8, 0], abs=1e-17)


def test_entrenched_is_lifted_by_the_larger_root():
    """Eq. (7) on one point: out to r_c along n whatever the HIP does."""
    step = tick([2e-3, 0, 0], [-1.0, 0, 0])
    assert step.state == 2
    assert step.proxy == pytest.approx([RC, 0, 0], abs=1e-17)


def test_entrenched_lift_clears_every_entrenched_point():
    rng = np.random.default_rng(3)
    for _ in range(50):
        points = rng.uniform(-4e-3, 4e-3, (20, 3)) * [1, 1, 0.05]
        proxy = np.array([0, 0, 3e-3])
        below = np.linalg.norm(points - proxy, axis=1) < PAR.r1
        step = tick(proxy, proxy, points=points)
        assert step.state == 2
        assert np.linalg.norm(points[below] - step.proxy, axis=1).min() == pytest.approx(RC)


def test_normal_of_a_sheet_is_its_normal():
    for z in (RC, 3e-3, -RC):
        step = tick([0.1e-3, 0.2e-3, z], [0, 0, 0], points=sheet())
        assert step.normal == pytest.approx([0, 0, np.sign(z)], abs=2e-2)
    centred = tick([0, 0, RC], [0, 0, 0], points=sheet())
    assert centred.normal == pytest.approx([0, 0, 1], abs=1e-12)


def test_normal_of_a_line_is_across_it():
    line = np.arange(-60, 61)[:, None] * 0.25e-3 * np.array([[1.0, 0, 0]])
    step = tick([0, 3e-3, 4e-3], [0, 0, 0], points=line)
    assert step.normal == pytest.approx([0, 0.6, 0.8], abs=1e-12)


def test_normal_by_hand_from_two_points():
    """Eq. (1) and (2) with weights 1 (at r1) and φ(7.5 mm) worked out on paper."""
    r1, r3 = PAR.r1, PAR.outer_radius
    t = (7.5e-3 - r1) / (r3 - r1)
    phi = (1 + 4 * t) * (1 - t) ** 4
    expected = np.array([1.0, phi, 0]) / np.hypot(1.0, phi)
    points = np.array([[-r1, 0, 0], [0, -7.5e-3, 0]])
    found = reference.normal_vector(points, np.zeros(3), r1, r3)
    assert found == pytest.approx(expected, abs=1e-15)


def test_wendland_is_one_inside_zero_outside_and_falls_between():
    r = np.linspace(0, 12e-3, 2000)
    phi = reference.wendland(r, PAR.r1, PAR.outer_radius)
    assert np.all(phi[r <= PAR.r1] == 1)
    assert np.all(phi[r >= PAR.outer_radius] == 0)
    assert np.all(np.diff(phi) <= 0)


def test_cancelling_normals_and_coincident_points_give_none():
    pair = np.array([[4e-3, 0, 0], [-4e-3, 0, 0]])
    step = tick([0, 0, 0], [0, 1e-3, 0], points=pair)
    assert (step.state, step.normal.tolist(), step.proxy.tolist()) == (2, [0, 0, 0], [0, 0, 0])
    on_it = tick([0, 0, 0], [0, 1e-3, 0], points=np.vstack([ORIGIN, [[0, -4e-3, 0]]]))
    assert on_it.normal.tolist() == [0, 1, 0]


def test_point_radius_keeps_the_papers_weight():
    """φ uses r, not r - r_v: with r_v >= r3 - r1 nothing weighs anything on contact."""
    assert (
        tick([0, 0, 11e-3], [0, 0, 0], points=sheet(), point_radius=6e-3).normal.tolist() == [0] * 3
    )
    small = tick([0, 0, 7e-3], [0, 0, 0], points=sheet(), point_radius=2e-3)
    assert small.normal == pytest.approx([0, 0, 1], abs=1e-12)


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


def test_stiffness_acts_along_each_axis():
    step = tick([0, 0, RC], [1e-3, 2e-3, -1e-3], points=sheet(), stiffness=[1, 2, 3])
    assert step.force == pytest.approx((step.proxy - [1e-3, 2e-3, -1e-3]) * [1, 2, 3], rel=1e-14)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e7])
def test_bad_hip_leaves_the_proxy_and_says_so(bad):
    engine = PaperProxy(ORIGIN)
    first = engine.step([0, bad, 0])
    assert (first.status, first.state) == (Status.BAD_HIP, -1)
    assert np.concatenate([first.proxy, first.normal, first.force]).tolist() == [0] * 9
    engine.reset([8e-3, 0, 0])
    good = engine.step([-3e-3, 0, 0])
    step = engine.step([0, bad, 0])
    assert step.status == Status.BAD_HIP
    assert step.proxy.tolist() == good.proxy.tolist()
    assert step.force.tolist() == good.force.tolist()


def test_run_is_step_after_step_and_goes_on_from_there():
    rng = np.random.default_rng(5)
    hips = np.array([0, 0, 4e-3]) + np.cumsum(rng.normal(0, 0.5e-3, (300, 3)), axis=0)
    one, two = PaperProxy(sheet(half=10)), PaperProxy(sheet(half=10))
    steps = [one.step(hip) for hip in hips]
    halves = [two.run(hips[:100]), two.run(hips[100:]), two.run(np.empty((0, 3)))]
    for name in ("proxy", "normal", "force", "state", "status"):
        rows = np.concatenate([getattr(half, name) for half in halves])
        assert np.array_equal(rows, np.array([getattr(step, name) for step in steps]))
    assert len(halves[2]) == 0


def test_what_cannot_be_rendered_is_refused():
    with pytest.raises(SettingError, match="'paper' only"):
        PaperProxy(ORIGIN, rule="robust")
    with pytest.raises(SceneError):
        PaperProxy(np.empty((0, 3)))
    with pytest.raises(SceneError):
        PaperProxy(ORIGIN).reset([np.nan, 0, 0])
    with pytest.raises(SceneError):
        PaperProxy(ORIGIN).run([0.0, 0, 0])
