"""Rule exact on a mesh comes to rest where the HIP rests: three meshes on which it once did not.

Without a stall test the proxy of the ball of 80 triangles went round a cycle of 9 micrometres for
ever, or used up its iterations in every tick without a move. The other two did so from fewer
places.
"""

import json

import numpy as np
import pytest
from conftest import ROOT

import vfplan

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
