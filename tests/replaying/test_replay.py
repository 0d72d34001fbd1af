"""A replay's numbers against NumPy that knows only the per-tick output."""

from __future__ import annotations

import dataclasses
import re
import sys
from itertools import groupby
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, output
from meshes import sphere
from motion import PEAK_KIB
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refuses
from replays import at_1_khz, codes_of, fixture_of, line, meshed, probing

import vfplan
from vfplan.errors import InputError, SessionError, SettingError
from vfplan.fixture import Fixture
from vfplan.replaying.findings import open_words, verdict_sentence
from vfplan.replaying.metrics import NUMBERS
from vfplan.replaying.replay import replay
from vfplan.session.events import Event, Poses
from vfplan.session.session import Session, resampled

PAPER = {"rule": "paper", "engine": "reference"}
LIMITS = (("force_max_n", "at_most", 100.0),)


def spans_of(mask):
    """(first, last) of each run of True, one by one."""
    groups = groupby(range(len(mask)), key=lambda k: bool(mask[k]))
    rows = [list(group) for is_on, group in groups if is_on]
    return [(group[0], group[-1]) for group in rows]


def norm(a):
    return np.sqrt((a**2).sum(axis=1))


@pytest.fixture(scope="module")
def pressed():
    return replay(fixture_of(line()), probing(seed=3), **PAPER)


def test_metrics_are_what_numpy_finds(pressed):
    t, m = pressed.ticks, pressed.metrics
    gap = t.proxy - t.hip
    assert m["ticks"] == len(t.time) == 3000
    assert m["duration_s"] == pytest.approx(t.time[-1] - t.time[0])
    depth = norm(gap)
    assert_allclose(t.penetration, depth)
    assert_allclose(t.overlap, np.maximum(0, (t.normal * gap).sum(1) - 5e-3), atol=1e-18)
    force = norm(t.force)
    assert_allclose(t.force, 1000 * gap * [1, 1, 0], atol=1e-12)
    step = norm(np.diff(t.force, axis=0))
    flat = t.proxy[:, None, :2] - line()[None, :, :2]
    expected = {
        "contact_ticks": np.count_nonzero(depth > 1e-9), "penetration_max_m": depth.max(),
        "penetration_rms_m": np.sqrt(np.mean(depth**2)), "overlap_max_m": t.overlap.max(),
        "force_max_n": force.max(), "force_rms_n": np.sqrt(np.mean(force**2)),
        "force_step_max_n": step.max(), "force_step_max_tick": step.argmax() + 1,
        "entrenched_ticks": np.count_nonzero(t.state == 2),
        "energy_j": (t.force[:-1] * np.diff(t.hip, axis=0)).sum(),
        "clearance_min_m": np.sqrt((flat**2).sum(2)).min() - 5e-3,
    }  # fmt: skip
    assert {name: m[name] for name in expected} == pytest.approx(expected, rel=1e-9, abs=1e-15)
    for state in (-1, 0, 1, 2):
        assert m["states"][str(state)] == np.count_nonzero(t.state == state)


def test_episodes_are_what_numpy_finds(pressed):
    t, episodes = pressed.ticks, pressed.metrics["episodes"]
    spans = spans_of(t.penetration > 1e-9)
    assert len(episodes) == len(spans) == 4
    dt = np.diff(t.time, append=t.time[-1])
    dx = np.diff(t.hip, axis=0, append=t.hip[-1:])
    work = (t.force * dx).sum(1)
    for episode, (a, b) in zip(episodes, spans, strict=True):
        part = slice(a, b + 1)
        deep = a + t.penetration[part].argmax()
        expected = {
            "start_tick": a, "end_tick": b, "ticks": b + 1 - a, "start_s": t.time[a],
            "end_s": t.time[b + 1], "dwell_s": dt[part].sum(),
            "penetration_max_m": t.penetration[deep], "overlap_max_m": t.overlap[part].max(),
            "force_max_n": norm(t.force[part]).max(), "energy_j": work[part].sum(),
            "energy_peak_j": max(0.0, work[part].cumsum().max()),
            "speed_at_touch_m_s": norm(t.hip[[a]] - t.hip[[a - 1]])[0] / 1e-3,
        }  # fmt: skip
        found = {name: episode[name] for name in expected}
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-15)
        assert_allclose(episode["impulse_ns"], (t.force * dt[:, None])[part].sum(0))
        assert episode["deepest"]["tick"] == deep
        assert episode["energy_peak_j"] >= episode["energy_j"]
        assert episode["deepest_along"]["s_m"] == pytest.approx(t.proxy[deep, 0], abs=0.26e-3)


def test_energy_splits_into_sampling_and_the_proxy(pressed):
    # With F̄ the mean of F_k and F_{k+1}: F̄·Δx = F̄·Δp - ΔV exactly, V = ½ (p-x)·K(p-x), and V is 0
    # at both ends. So what holding does not explain, the proxy did.
    t, m = pressed.ticks, pressed.metrics
    mean = 0.5 * (t.force[:-1] + t.force[1:])
    by_proxy = (mean * np.diff(t.proxy, axis=0)).sum()
    assert m["energy_j"] - m["energy_hold_j"] == pytest.approx(by_proxy, rel=1e-6, abs=1e-12)
    assert m["energy_hold_j"] > 0
    assert all(e["passive"] for e in m["episodes"])
    # Every part of the loss or gain lies in an episode.
    for name in ("energy_j", "energy_hold_j"):
        assert sum(e[name] for e in m["episodes"]) == pytest.approx(m[name], rel=1e-9), name


def test_blocks_do_not_change_the_numbers(pressed):
    session = pressed.metrics["session"]
    assert session["rate_hz"] == pytest.approx(1000)
    assert session["jitter_rms_s"] == pytest.approx(0, abs=1e-12)

    pieces = SimpleNamespace(name="pieces", frame="robot_base", sha256=None, notes={},
                             blocks=lambda: probing(seed=3).blocks(7))  # fmt: skip
    other = replay(fixture_of(line()), pieces, **PAPER)
    for name in ("proxy", "force", "penetration", "overlap", "state"):
        assert_array_equal(getattr(other.ticks, name), getattr(pressed.ticks, name))
    episodes = zip(other.metrics["episodes"], pressed.metrics["episodes"], strict=True)
    for mine, theirs in ((other.metrics, pressed.metrics), *episodes):
        for name, value in theirs.items():
            if isinstance(value, int | float) and name not in ("elapsed_s", "real_time_factor"):
                assert mine[name] == pytest.approx(value, rel=1e-9, abs=1e-15), name


def test_repeats_and_jumps_are_reported():
    session = probing()
    hip = session.hip.copy()
    hip[200:204] = hip[199]
    hip[2000] += [10.0, 0, 0]
    found = replay(fixture_of(line()), Session(session.time, hip), **PAPER)
    seen = found.metrics["session"]
    assert (seen["repeats"], seen["repeats_longest"]) == (4, 4)
    assert (seen["jumps"], seen["jump_ticks"]) == (2, [2000, 2001])
    assert "session-jump" in codes_of(found)


def test_doubtful_time_units_and_held_positions_are_named():
    session = probing(seconds=10)
    held = Session(session.time, np.repeat(session.hip[::10], 10, axis=0))
    slow = Session(1e3 * session.time[::10], session.hip[::10])  # 100 Hz in milliseconds
    far = Session(session.time, 1e3 * session.hip + 5)  # millimetres
    doubts = {"session-held", "session-time", "never-near"}
    for one, code in ((session, None), (held, "session-held"), (slow, "session-time"),
                      (far, "never-near")):  # fmt: skip
        found = replay(fixture_of(line()), one, limits=LIMITS, rule="robust")
        assert codes_of(found) & doubts == ({code} - {None})
        assert (found.verdict == "not-tested") == (code in ("session-time", "never-near"))
        assert ("seconds" in verdict_sentence(found.metrics)) == (code == "session-time")
        assert (found.metrics["samples_read"], found.metrics["samples_left_out"]) == (one.ticks, 0)


@pytest.mark.parametrize("depth", [-8e-3, 1e-6, 4e-3, 12e-3])
@pytest.mark.parametrize("rule", ["exact", "robust"])
def test_a_start_under_the_skin_is_led_out_or_proves_nothing(depth, rule):
    points, triangles = sphere(30e-3, 3)
    hip = np.tile([0, 0, 30e-3 - depth], (900, 1)) * np.linspace(1, 0.9, 900)[:, None]
    body = dataclasses.replace(meshed(points, triangles), sample_radius=1e-3)
    found = replay(body, at_1_khz(hip), limits=LIMITS, rule=rule)
    is_outside = depth < 5e-3
    assert found.verdict == ("pass" if is_outside else "not-tested")
    assert ("started-in-mesh" in codes_of(found)) == (not is_outside)
    assert (np.linalg.norm(found.ticks.proxy[-1]) > 34e-3) == is_outside
    assert found.metrics["force_step_max_n"] < 0.05


@pytest.mark.parametrize("rate_hz", [None, 1000.0, 250.0])
def test_a_pass_says_for_how_long_nothing_is_known(rate_hz):
    session = probing()
    keep = np.ones(3000, bool)
    keep[1000:1500] = keep[2000:2007] = False
    recorded = Session(session.time[keep], session.hip[keep])
    if rate_hz is not None:
        recorded = resampled(recorded, rate_hz)
    found = replay(fixture_of(line()), recorded, **PAPER, limits=LIMITS)
    assert found.verdict == "pass"
    seen = found.metrics["session"]
    if rate_hz is not None:
        # The lines that fill the gaps are no samples.
        assert seen["gaps"] == 0
        seen = seen["recorded"]
    assert (seen["gaps"], seen["missing_samples"]) == (2, 507)
    assert seen["gap_s"] == pytest.approx(0.501 + 0.008)
    assert [gap["length_s"] for gap in seen["gap_list"]] == pytest.approx([0.501, 0.008])
    assert "session-gap" in codes_of(found)
    assert "but nothing is known of 0.509 s without samples" in verdict_sentence(found.metrics)
    name = "session.gaps" if rate_hz is None else "session.recorded.gaps"
    gapless = [(name, "at_most", 0)]
    assert replay(fixture_of(line()), recorded, **PAPER, limits=gapless).verdict == "fail"
    assert open_words(replay(fixture_of(line()), session, **PAPER, limits=LIMITS).metrics) == ""


@pytest.mark.parametrize("whole", ["\n", "\r\n"])
def test_a_table_whose_last_line_is_open_is_told_of(tmp_path, whole):
    path, rows = tmp_path / "s.csv", ["t,x,y,z", "0,0,0.01,0.02", "0.001,0,0.01,0.0234"]
    for encoding in ("utf-8", "utf-16"):
        for end in (whole, ""):
            path.write_bytes((whole.join(rows) + end).encode(encoding))
            told = codes_of(replay(fixture_of(line()), path))
            assert ("session-open-end" in told) == (end == "")


@pytest.mark.parametrize("rule", ["exact", "robust"])
@pytest.mark.parametrize("opens, ends_mm, is_within", [
    (True, (50, -27), True), (True, (-50, -33), False), (False, (50, 28), False),
])  # fmt: skip
def test_a_pass_says_that_the_tool_pressed_from_within_an_open_mesh(
    opens, ends_mm, is_within, rule
):
    """A ball of 60 mm with a hole, through which the proxy goes, at its top."""
    points, triangles = sphere(30e-3, 3)
    if opens:
        triangles = triangles[points[triangles][..., 2].mean(axis=1) < 24e-3]
        used, triangles = np.unique(triangles, return_inverse=True)
        points, triangles = points[used], triangles.reshape(-1, 3)
    hip = np.outer(1e-3 * np.linspace(*ends_mm, 800), [0, 0, 1])
    found = replay(meshed(points, triangles), at_1_khz(hip), limits=LIMITS, rule=rule)
    assert (found.verdict, "pressed-within" in codes_of(found)) == ("pass", is_within)
    assert ("pressed from within" in open_words(found.metrics)) == is_within


@pytest.mark.parametrize("changed", ["poses", "exchange"])
def test_a_deep_start_proves_nothing_where_the_fixture_changes_either(changed):
    body = meshed(*sphere(30e-3, 3))
    session = at_1_khz(np.outer(np.linspace(10e-3, 34e-3, 900), [0, 0, 1]))
    times = np.arange(0, 1, 0.02)
    far = dataclasses.replace(body, points=body.points + np.array([0.3, 0, 0]))
    fixture, changes = {
        "poses": (body, {"poses": Poses(times, np.tile([0, 0, 0, 1.0, 0, 0, 0], (50, 1)), times)}),
        "exchange": (far, {"events": [Event(10, body)]}),
    }[changed]
    found = replay(fixture, session, limits=LIMITS, rule="exact", **changes)
    assert found.verdict == "not-tested"
    assert "started-in-mesh" in codes_of(found)


def test_of_many_episodes_only_the_deepest_are_asked_whether_they_are_within(monkeypatch):
    asked = []
    monkeypatch.setattr("vfplan.replaying.replay.share_around", lambda *_: asked.append(1) or 0)
    points, triangles = sphere(30e-3, 2)
    time = 1e-3 * np.arange(3000)
    hip = np.outer(36e-3 - 8e-3 * np.sin(2 * np.pi * 10 * time), [0, 0, 1])
    found = replay(meshed(points, triangles[1:]), Session(time, hip), rule="robust")
    # Once more at the start.
    assert (len(found.metrics["episodes"]), len(asked)) == (30, 1 + 20)


def test_the_engine_is_set_as_the_fixture_says():
    fixture = fixture_of(line(), band=7e-6, stiffness=(800.0, 900.0, 1000.0), rv=1e-3)
    rendering = dataclasses.replace(fixture.rendering, max_iterations=3)
    fixture = dataclasses.replace(fixture, rendering=rendering)
    session = probing(1.0)
    engine = vfplan.ProxyEngine(line(), band=7e-6, stiffness=(800.0, 900.0, 1000.0),
                                point_radius=1e-3, ignore_axis="z", max_iterations=3)  # fmt: skip
    engine.reset(session.hip[0])
    found = replay(fixture, session)
    assert_array_equal(found.ticks.force, engine.run(session.hip).force)
    scene = found.metrics["scene"]
    assert (scene["max_iterations"], scene["band_m"], scene["point_radius_m"]) == (3, 7e-6, 1e-3)


def test_wrong_calls_are_refused():
    fixture, session = fixture_of(line()), probing()
    for how, code in (({"rule": "fast"}, "unknown-rule"), ({"engine": "gpu"}, "unknown-engine"),
                      ({"engine": "reference"}, "rule-not-paper")):  # fmt: skip
        with refuses(SettingError, code):
            replay(fixture, session, **how)
    with refuses(SessionError, "frame-differs"):
        replay(fixture, Session(session.time, session.hip, frame="world"), **PAPER)
    curve = Fixture("image", line(), fixture.provenance)
    with pytest.raises(InputError, match="vfplan register"):
        replay(curve, Session(session.time, session.hip, frame="image"), **PAPER)


@pytest.mark.full
def test_memory_does_not_grow_with_the_session():
    def peak_kb(blocks):
        code = (
            "import numpy as np\n"
            "from replays import *\n"
            "from vfplan.replaying.replay import replay\n"
            "from vfplan.session.session import SessionStream\n"
            "def read():\n"
            f"    for k in range({blocks}):\n"
            "        s = probing(16.384)\n"
            "        yield s.time + 16.384 * k, s.hip\n"
            "found = replay(fixture_of(line()), SessionStream(read, 'long'), keep=0)\n"
            f"assert found.metrics['ticks'] == 16384 * {blocks}\n"
            f"print({PEAK_KIB})\n"
        )
        return int(output(sys.executable, "-c", code, cwd=ROOT / "tests" / "making"))

    assert peak_kb(200) < peak_kb(4) + 20_000  # 3.3 million ticks against 65 thousand


# Keys of parts of a report, which docs/replay.md explains by their words.
ELSEWHERE = {"band_m", "contact_episodes", "entrenched_ticks", "lateral_max_m", "p999",
             "speed_max_m_s"}  # fmt: skip
MOVING = {"fixture_energy_j", "pose_age_max_s", "frame_lag_max_m"}


def test_the_page_about_replays_and_the_report_have_the_same_numbers(pressed):
    rows = re.findall(r"^\| (`.*?) \|", (ROOT / "docs" / "replay.md").read_text(), re.MULTILINE)
    explained = set(re.findall(r"`(\w+)`", " ".join(rows)))
    assert {number.key for number in NUMBERS if number.label} - ELSEWHERE <= explained
    found = set(pressed.metrics)
    assert {key for key in explained if key.endswith(("_m", "_n", "_j", "_s"))} - MOVING <= found


def test_of_very_many_episodes_the_deepest_are_reported():
    """Memory does not grow with them; what is left out is counted, with its depth."""
    from vfplan.replaying import metrics as module

    count = 2 * module.MAX_EPISODES + 7
    time = np.arange(40 * count) * 1e-3
    depth = np.zeros(len(time))
    touch = np.arange(20, len(time), 40)  # 40 ms apart: each is an episode of its own
    depth[touch] = 1e-4 * (1 + np.random.default_rng(3).permutation(count) / count)
    hip = np.zeros((len(time), 3))
    hip[:, 0], hip[:, 1] = 0.05, np.where(depth > 0, 5e-3 - depth, 5.5e-3)
    m = replay(fixture_of(line()), Session(time, hip)).metrics
    kept, left = m["episodes"], m["episodes_left_out"]
    assert (len(kept), left["count"]) == (module.MAX_EPISODES, module.MAX_EPISODES + 7)
    assert module.episode_count(m) == count
    starts = [e["start_tick"] for e in kept]
    assert starts == sorted(starts)
    assert all(touch[e["index"]] in range(e["start_tick"], e["end_tick"] + 1) for e in kept)
    assert left["penetration_max_m"] <= min(e["penetration_max_m"] for e in kept)
    assert m["penetration_max_m"] == max(e["penetration_max_m"] for e in kept)
