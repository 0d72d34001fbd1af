"""A ball at the tip burrs a sheet: force bounded, never through, replayed to the bit."""

from __future__ import annotations

import shlex

import numpy as np
from refusals import refuses
from replays import fixture_of, write_session

import vfplan
from vfplan.bundle.write import write_fixture
from vfplan.burr import burr, burr_figure
from vfplan.errors import SettingError

K, R, B, BAND = 1000.0, 5e-3, 3e-3, 5e-5
SPACE = {"axis": None, "curve": False, "band": BAND, "stiffness": K}


def scene():
    g = np.arange(-14e-3, 14.01e-3, 0.7e-3)
    x, y = np.meshgrid(g, g)
    points = np.stack((x.ravel(), y.ravel(), 0.5e-3 * np.sin(100 * x.ravel())), axis=1)
    t = 1e-3 * np.arange(2500)
    z = np.where(t < 0.5, 10e-3 - 14e-3 * t, 3e-3 - 1e-3 * (t - 0.5))
    hip = np.stack((4e-3 * np.sin(4 * t), 3e-3 * np.cos(3 * t), z), axis=1)
    return fixture_of(points, **SPACE), vfplan.Session(t, hip)


def test_a_burr_takes_away_what_it_is_pressed_on_and_nothing_else():
    fixture, session = scene()
    burred = burr(fixture, session, B)
    found = burred.replayed.metrics["burr"]
    assert found["replayed_to_the_bit"]
    assert found["places_lowered"] > 100
    assert found["deepest_m"] > 0.5e-3
    assert found["force_step_of_bound"] <= 1 + 1e-9
    assert burred.replayed.metrics["clearance_min_m"] >= -BAND
    assert burred.replayed.metrics["inside_ticks"] == 0
    # What the hand never came near is as it was; what is left lies outside the ball's last places.
    flat = np.hypot(*fixture.points[:, :2].T) > 12e-3
    assert np.array_equal(fixture.points[flat], burred.after[flat])
    assert np.linalg.norm(burred.after - session.hip[-1], axis=1).min() > B - 2 * BAND - 1e-6
    # Beyond R - B there is no more to press against: the force stays near K (R - B).
    assert burred.replayed.metrics["force_max_n"] < 1.6 * K * (R - B)
    untouched = burr(fixture, vfplan.Session(session.time[:400], session.hip[:400]), B)
    assert untouched.events == []


def test_a_round_bone_is_burred_towards_its_middle():
    """A hand 2 mm deep from pole to pole of a ball feels no more than the margin's force."""
    n = 8000
    height, turn = 1 - (2 * np.arange(n) + 1) / n, np.pi * (1 + 5**0.5) * np.arange(n)
    flat = np.sqrt(1 - height**2)
    points = 20e-3 * np.stack((flat * np.cos(turn), flat * np.sin(turn), height), axis=1)
    fixture = fixture_of(points, **SPACE)
    t = 1e-3 * np.arange(3000)
    angle, away = np.pi * np.clip(t - 0.5, 0, 2.5) / 2.5, 25e-3 - 2e-3 * np.minimum(t / 0.5, 1)
    hip = away[:, None] * np.stack((np.sin(angle), 0 * t, np.cos(angle)), axis=1)
    burred = burr(fixture, vfplan.Session(t, hip), 0.8 * R)
    assert burred.replayed.metrics["burr"]["deepest_m"] < 1.2e-3
    assert burred.replayed.metrics["force_max_n"] < 2 * K * 0.2 * R
    assert not [f for f in burred.replayed.metrics["findings"] if f["code"] == "burr-held"]


def test_a_line_pressed_through_is_told():
    """From both sides, deeper than the proxy is wide: it stays behind, and the report says so."""
    x = np.arange(-20e-3, 20e-3, 0.5e-3)
    points = np.stack((x, 0 * x, 0 * x), axis=1)
    fixture = fixture_of(points, axis=[0, 0, 1.0], curve=False, band=BAND, stiffness=K)
    t = 1e-3 * np.arange(1500)
    y = 8e-3 * np.cos(2 * np.pi * t / 1.5)
    burred = burr(fixture, vfplan.Session(t, np.stack((0 * t, y, 0 * t), axis=1)), 0.9 * R)
    (held,) = [f for f in burred.replayed.metrics["findings"] if f["code"] == "burr-held"]
    assert f"The force reached {burred.replayed.metrics['force_max_n']:.3g} N" in held["message"]
    assert len(burr_figure(burred).axes) == 3  # its points, their colours, and the force


def test_a_ball_that_is_not_felt_first_is_refused():
    fixture, session = scene()
    for radius in (R, 0.0, np.nan):
        with refuses(SettingError, "burr-radius"):
            burr(fixture, session, radius)


def test_the_command_writes_what_replays(vfplan_cli, tmp_path):
    fixture, session = scene()
    write_fixture(fixture, tmp_path / "f.h5")
    write_session(tmp_path / "s.csv", session)
    out = ("-o", "r.h5", "--events-out", "e.csv", "--picture-out", "p.png", "--json")
    done = vfplan_cli("burr", "f.h5", "s.csv", "--radius", "3", *out, cwd=tmp_path).sound
    assert done.json["burr"]["replayed_to_the_bit"]
    assert (tmp_path / "p.png").stat().st_size > 10_000
    again = ("replay", "f.h5", "s.csv", "--events", "e.csv", "-o", "again.h5")
    assert vfplan_cli(*again, cwd=tmp_path).sound
    for named in (out[2:6], out[:4], ("-o", "other.h5")):
        words = ("burr", "f.h5", "s.csv", "--radius=3", *named, "--units", "m", "--overwrite")
        pasted = vfplan_cli(*words, cwd=tmp_path).sound.stdout.split("next: ")[-1]
        _, *again = shlex.split(pasted[pasted.rindex("vfplan ") :])
        assert {again.count(word) for word in again if word.startswith("-")} == {1}
        assert vfplan_cli(*again, cwd=tmp_path).sound
    one, other = (vfplan.read_result(tmp_path / name) for name in ("r.h5", "again.h5"))
    assert np.array_equal(one[0].force, other[0].force)
