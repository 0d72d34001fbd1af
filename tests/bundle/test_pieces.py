"""Lines and arcs in a bundle: written, read back in both languages, planned, replayed."""

from __future__ import annotations

from conftest import ELBOW, ROOT

SESSION = ROOT / "samples" / "elbow_session.csv"
PLAN = "plan", *ELBOW
SPACING = "--pixel-spacing", 0.5


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
    assert vfplan_cli(*command).sound
    run = vfplan_cli("campaign", tmp_path / "f.h5", SESSION, "-o", tmp_path / "c", "--trials", 64)
    assert run.code == 3
    assert "a campaign renders its points" in run.error_line
