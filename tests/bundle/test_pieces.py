"""Lines and arcs in a bundle: written, read back in both languages, planned, replayed."""

from __future__ import annotations

import pytest
from conftest import ROOT

import vfplan

SAMPLES = ROOT / "samples"
SESSION = SAMPLES / "elbow_session.csv"
ENDS = ".png", "_markers_image.csv", "_markers_robot.csv"
PLAN = "plan", *(SAMPLES / f"elbow{end}" for end in ENDS)
SPACING = "--pixel-spacing", 0.5


@pytest.fixture(scope="module")
def planned(vfplan_cli, tmp_path_factory):
    """The shipped slice with lines and arcs, and what `plan` said of it."""
    path = tmp_path_factory.mktemp("planned") / "f.h5"
    run = vfplan_cli(*PLAN, "-o", path, *SPACING, "--arcs", 0.001, "--json").sound
    return path, run.json["register"]


def test_plan_fits_pieces_within_what_was_asked(planned, vfplan_cli):
    path, report = planned
    fixture = vfplan.read_fixture(path)
    assert 0 < report["pieces"]["error_m"] <= 1e-6
    assert report["pieces"]["error_m"] == fixture.curve.pieces.error
    engine = vfplan.ProxyEngine.of(fixture)
    assert engine.rule == "exact"
    assert engine.distance(fixture.points).max() < 2e-6
    assert vfplan_cli("validate", path).code == 0


def test_replay_takes_the_curve_where_there_is_one(planned, vfplan_cli):
    exact = vfplan_cli("replay", planned[0], SESSION, "--json").json
    robust = vfplan_cli("replay", planned[0], SESSION, "--rule", "robust", "--json").json
    assert (exact["rule"], robust["rule"]) == ("exact", "robust")
    assert exact["contact_ticks"] == pytest.approx(robust["contact_ticks"], rel=0.01)
    assert abs(exact["clearance_min_m"]) < 1e-9
    assert exact["force_max_n"] == pytest.approx(robust["force_max_n"], rel=0.01)


def test_arcs_of_a_fixture_in_space_are_refused(vfplan_cli, tmp_path):
    path = tmp_path / "f.h5"
    run = vfplan_cli(*PLAN, "-o", path, *SPACING, "--arcs", 0.001, "--ignore-axis", "none")
    assert run.code in (2, 3)
    assert "across an ignored axis" in run.stderr
    assert not path.exists()


def test_arcs_that_a_margin_or_a_gate_does_not_count_are_refused(vfplan_cli, tmp_path):
    command = *PLAN, "-o", tmp_path / "f.h5", *SPACING, "--arcs", 0.05
    for words in (("--margin", "tre95"), ("--max-tre", 0.5), ("--contact-radius", 3)):
        run = vfplan_cli(*command, *words)
        assert (run.code, run.stdout) == (2, "")
        assert "lines and arcs" in run.error_line
        assert not (tmp_path / "f.h5").exists()
    assert vfplan_cli(*command).code == 0
    run = vfplan_cli("campaign", tmp_path / "f.h5", SESSION, "-o", tmp_path / "c", "--trials", 64)
    assert run.code == 3
    assert "a campaign renders its points" in run.error_line
