"""The main job on real input: a planned CT slice in, a bundle out, a Franka session replayed."""

from __future__ import annotations

import numpy as np
import pytest

import vfplan

SLICES = ["pelvis_a.png", "pelvis_b_q80.jpg"]
MORE_SLICES = ["pelvis_a_q80.jpg", "pelvis_b.png", "pelvis_c.png"]


def moved_onto(recording, fixture, folder):
    """A hand-guided recording, shrunk to the curve's size and laid over its middle."""
    t, *xyz = np.loadtxt(recording, delimiter=",", skiprows=1).T
    hip = np.array(xyz).T
    low, high = fixture.points.min(axis=0), fixture.points.max(axis=0)
    size = np.ptp(hip, axis=0)[:2].max()
    hip = (hip - hip.mean(axis=0)) * (high - low)[:2].max() / size + (low + high) / 2
    path = folder / "session.csv"
    rows = "\n".join(f"{a:.3f},{x:.7f},{y:.7f},{z:.7f}"
                     for a, (x, y, z) in zip(t, hip, strict=True))  # fmt: skip
    path.write_text(f"t,x,y,z\n{rows}\n")
    return path, hip


@pytest.mark.parametrize(
    "image", [*SLICES, *(pytest.param(name, marks=pytest.mark.slow) for name in MORE_SLICES)]
)
def test_plan_then_replay_a_franka_recording(vfplan_cli, shared_data, tmp_path, image):
    planned, name = shared_data / "planned", image[:8]
    bundle, result = tmp_path / "f.h5", tmp_path / "r.h5"
    assert vfplan_cli(
        "plan", planned / image, planned / f"{name}_markers_image.csv",
        planned / f"{name}_markers_robot.csv", *("-o", bundle, "--pixel-spacing", 0.5954),
    ).sound  # fmt: skip
    fixture = vfplan.read_fixture(bundle)
    session, hip = moved_onto(shared_data / "panda_sessions" / "recording_1.csv", fixture, tmp_path)

    report = vfplan_cli("replay", bundle, session, "-o", result, "--json").sound.json
    assert report["ticks"] == len(hip)
    assert report["contact_ticks"] > 0
    assert report["clearance_min_m"] >= -fixture.band
    assert report["force_max_n"] == pytest.approx(1000 * report["penetration_max_m"])

    # The result says the same: the proxy never came nearer to a point than R - band, and the
    # force is K times its distance from the HIP across the slice.
    blocks, _ = vfplan.read_result(result)
    axis = fixture.ignore_axis
    across = np.eye(3) - np.outer(axis, axis)
    pull = (blocks.proxy - blocks.hip) @ across
    assert np.abs(blocks.force - 1000 * pull).max() < 1e-9
    assert np.array_equal(blocks.hip, np.round(hip, 7))
