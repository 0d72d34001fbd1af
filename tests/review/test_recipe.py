"""A plan is mended by the recipe in its bundle, and from the bytes that were read at first."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from refusals import refuses
from review_slices import clear, fork

import vfplan
from vfplan.bundle import rendered_values
from vfplan.bundle.content import table
from vfplan.errors import InputError, SettingError
from vfplan.planning.extraction import extract
from vfplan.planning.plan import register
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.review.plan import RENDERED_IN_WORDS
from vfplan.review.session import Session
from vfplan.review.steps import STEPS
from vfplan.robot import Robot, read_robot
from vfplan.settings import recalled
from vfplan.stability import study

PLACES = [(u, v) for u in (20, 190, 360) for v in (20, 160, 300)]
OFF_M = np.random.default_rng(3).normal(0, 1e-4, (9, 3))
TARGETS = [(0.3 + 5e-4 * u, -5e-4 * v, 0.02) for u, v in PLACES] + OFF_M
SPACED = ExtractSettings(pixel_spacing_mm=(0.5, 0.5))


@pytest.fixture
def files(tmp_path):
    """A slice with crosses, and the markers there with their deviations."""
    clear(tmp_path / "s.png")
    picture = cv2.imread(str(tmp_path / "s.png"))
    rows = ["label,u_px,v_px,x_m,y_m,z_m,sigma_m"]
    for k, (place, (x, y, z)) in enumerate(zip(PLACES, TARGETS, strict=True)):
        cv2.drawMarker(picture, place, (255, 255, 0), cv2.MARKER_CROSS, 11, 2)
        rows.append(f"M{k},{place[0]},{place[1]},{x},{y},{z},{1e-4 * (1 + k % 3)}")
    cv2.imwrite(str(tmp_path / "s.png"), picture)
    (tmp_path / "m.csv").write_text("\n".join(rows))
    return tmp_path / "s.png", tmp_path / "m.csv"


@pytest.fixture
def planned(files, tmp_path, monkeypatch):
    """Plan, write the bundle and open it; every robot is stable up to 5000 N/m."""
    stable = [SimpleNamespace(measured=5000.0, unit="N/m", values={})]
    monkeypatch.setattr(study, "closed_loop_case", lambda *_: stable)
    curve = extract(files[0], SPACED).fixture

    def run(robot=None, **settings):
        fixture = register(curve, files[1], None, FixtureSettings(**settings)).fixture
        if robot is not None:
            fixture = study.with_verdict(fixture, robot)
        vfplan.write_fixture(fixture, tmp_path / "f.h5", overwrite=True)
        return fixture, Session.open(tmp_path / "f.h5", slice=files[0])

    return run


def mended(session, by):
    """The fixture after a knot was moved by so many pixels."""
    u, v = session.quick_state()["knots_px"][0][7]
    step = {"do": "move_knot", "stroke": 0, "knot": 7, "to": [u, v + by]}
    outcome = session.apply(step).current.outcome
    assert not outcome.why_not
    return outcome.fixture


def recipe(fixture):
    known = fixture.provenance.settings
    kinds = ((ExtractSettings, ""), (FixtureSettings, ""), (Robot, "robot_"))
    return [recalled(kind, known, prefix) for kind, prefix in kinds]


def codes(session):
    return {finding.code for finding in session.current.findings}


def random_recipe(rng):
    pick = lambda *values: values[rng.integers(len(values))]  # noqa: E731
    settings = {
        "model": pick("affine", "similarity", "rigid"), "ignore_axis": pick(None, "z", "none"),
        "stiffness": pick((300.0,), (200.0, 300.0, 1e3 * rng.uniform(0.1, 1))),
        "contact_radius": rng.uniform(2e-3, 8e-3), "point_radius": pick(0.0, rng.uniform(0, 1e-3)),
        "max_residual_m": pick(None, rng.uniform(5e-4, 2e-3)), "max_tre_m": pick(None, 2e-3),
        "density_per_m": pick(None, 4e3), "robust": pick(True, False),
        "seen_from": pick(None, "above", (0.0, 0.1, 1.0)), "points_only": pick(True, False),
    }  # fmt: skip
    guide = {"guide_m": rng.uniform(1e-3, 5e-3), "guide_ends": pick("stop", "open"),
             "guide_pull": pick((), (1.5, rng.uniform(0.01, 0.1)))}  # fmt: skip
    return settings | pick(guide, {"margin": pick(None, "tre95", 3e-4)})


def test_a_mend_keeps_thirty_random_recipes_and_no_mend_keeps_every_bit(planned):
    rng = np.random.default_rng(49)
    for _ in range(30):
        settings = random_recipe(rng)
        fixture, session = planned((None, read_robot("fr3"))[rng.integers(2)], **settings)
        assert recipe(fixture)[:2] == [SPACED, FixtureSettings(**settings)]
        new = mended(session, 0.3)
        before, same, after = map(rendered_values, (fixture, mended(session, 0), new))
        assert before.keys() == same.keys() == after.keys()
        assert all(np.array_equal(before[name], same[name]) for name in before)
        assert recipe(new) == recipe(fixture)
        assert (new.stability is None) == (fixture.stability is None)
        for name in after:
            # A margin is made anew, along a line that is another now, and the band follows it.
            if settings.get("margin") == "tre95" and name[11:] in ("point_radius_m", "band_m"):
                assert after[name] == pytest.approx(before[name], abs=1e-5)
            elif name.startswith(("/rendering", "/guidance", "/@")):
                assert np.array_equal(after[name], before[name])


def test_what_a_mend_makes_of_margin_and_gates_is_told(planned):
    fixture, session = planned(margin="tre95")
    for number in range(1, 6):
        session = session.apply({"do": "leave_out_marker", "marker": f"M{number}"})
    was, now = fixture.point_radius, session.current.outcome.fixture.point_radius
    assert now >= max(session.state()["tre95_m"], 1.2 * was)
    (text,) = [f.text for f in session.current.findings if "Radius of each point" in f.text]
    assert text == f"Radius of each point: {1e3 * now:.9g} mm, was {1e3 * was:.9g} mm."
    assert not session.state()["approvable"]
    # A gate is that of the plan, and the margin of a campaign holds for its own markers alone.
    step = {"do": "move_marker", "marker": "M4", "to": [192, 160]}
    for settings, code in (({"max_residual_m": 3e-4}, "residual-large"),
                           ({"margin": 1e-3}, "margin-of-other-markers")):  # fmt: skip
        assert planned(**settings)[1].apply(step).current.outcome.code == code


def test_what_differs_is_told_in_the_words_of_the_page(planned):
    _, session = planned(read_robot("fr3"), contact_radius=5e-3, stiffness=300.0)
    session = session.apply({"do": "set_plan", "contact_radius": [3e-3]})
    told = [f.text for f in session.current.findings if f.code == "differs-from-opened"]
    assert told[0] == "Distance from the line: 3 mm, was 5 mm."
    assert re.fullmatch(r"The line was fitted anew, up to \d\.\d\d µm off .* bundle\.", told[1])
    # Every value has its words.
    rendered = {row.path for row in table() if row.mark == "rendered"} | {"kind"}
    of_line = {path for path in rendered if re.match("/(points|curve|pieces|mesh)", path)}
    assert RENDERED_IN_WORDS.keys() == rendered - of_line


def test_other_markers_are_planned_by_the_recipe_unless_told(planned, files, tmp_path):
    settings = {"guide_m": 2e-3, "max_tre_m": None, "stiffness": 300.0, "contact_radius": 3e-3}
    fixture, _ = planned(read_robot("franka"), **settings)
    path = tmp_path / "f.h5"
    again = Session.open(path, files[1], slice=files[0])
    assert recipe(again.current.outcome.fixture) == recipe(fixture)
    assert "recipe-overridden" not in codes(again)
    other = Session.open(path, files[1], slice=files[0], stiffness=500.0)
    assert other.current.outcome.fixture.guidance.stiffness == 500.0
    assert {"recipe-overridden", "differs-from-opened"} <= codes(other)
    # What is approved as it is in the file cannot be planned otherwise, but said again.
    for given in ({"stiffness": 1000.0}, {"max_tre_m": "contact radius"}):
        with refuses(SettingError, "planned-already", settings=list(given)):
            Session.open(path, **given)
    assert Session.open(path, **settings).source.notes == ()


@pytest.mark.parametrize(
    "name, value",
    [("max_residual_m", None), ("FixtureSettings.unset", None), ("robust", "no"),
     ("model", "kriging"), ("guide_m", "wide"), ("stiffness", "x"), ("stiffness", "1,2"),
     ("robot_rate_hz", True), ("robot_safety_factor", "1"), ("Robot.unset", None),
     ("markers_sigma_m", "1;2"), ("roi", "1,2,3"), ("ignore_axis", "w")],
)  # fmt: skip
def test_an_incomplete_recipe_is_refused_by_name(planned, tmp_path, name, value):
    fixture, _ = planned(read_robot("fr3"))
    known = {**fixture.provenance.settings, name: value}
    if value is None:
        del known[name]
    provenance = replace(fixture.provenance, settings=known)
    vfplan.write_fixture(replace(fixture, provenance=provenance), tmp_path / "g.h5")
    with refuses(InputError, "recipe-incomplete"):
        Session.open(tmp_path / "g.h5")


IN_TURN = [
    {"do": "choose_pen", "colour": "#ff0000"}, {"do": "find_markers"},
    {"do": "exclude", "box": [300, 20, 60, 80]},
    {"do": "move_knot", "stroke": 0, "knot": 5, "to": [90, 100]},
    {"do": "insert_knot", "stroke": 0, "at": [101, 104]},
    {"do": "delete_knot", "stroke": 0, "knot": 4}, {"do": "cut", "start": [100, 97]},
    {"do": "take", "ink": 1, "as": "part"}, {"do": "join", "stroke": 0, "other": 1},
    {"do": "draw", "points": [[60, 200], [200, 220], [300, 200]], "add": True},
    {"do": "reverse", "stroke": 0}, {"do": "delete_stroke", "stroke": 1}, {"do": "viewed"},
    {"do": "move_marker", "marker": "M1", "to": [21, 161]}, {"do": "delete_marker", "marker": "M2"},
    {"do": "add_marker", "label": "M9", "at": [80, 80], "target_m": [0.34, -0.04, 0.02]},
    {"do": "rename_marker", "marker": "M9", "label": "X"}, {"do": "answer", "finding": 0},
    {"do": "leave_out_marker", "marker": "X"}, {"do": "cut", "start": [150, 97]},
    {"do": "leave", "ink": 1}, {"do": "set_plan", "contact_radius": [4e-3]},
]  # fmt: skip


@pytest.mark.parametrize("kind", ["slice", "bundle", "fork"])
def test_no_step_reads_a_file_again(planned, files, tmp_path, kind):
    steps = IN_TURN
    _, session = planned()
    if kind == "fork":
        fork(files[0])
        steps = [{"do": "choose", "candidate": "1a"}]
    if kind != "bundle":
        session = Session.open(*files)
    known = session.source.inputs | session.source.sha256
    for path in (*files, tmp_path / "f.h5"):
        path.write_bytes(b"another file")
    for step in steps:
        session = session.apply(step)
        session.state()
        used = session.current.outcome.fixture.provenance.inputs
        assert used["image"] == known["image"]
        is_same_fit = session.current.fit is session.source.fit
        assert (used.get("markers") == known["markers"]) == is_same_fit
    done = {step["do"] for step in steps} - {"viewed"}
    assert done in ({"choose"}, STEPS.keys() - {"choose", "choose_slice", "rectify"})
