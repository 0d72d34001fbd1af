"""`vfplan migrate` on the command line; what it keeps is in test_bundle_golden.py."""

from conftest import ROOT

OLD = ROOT / "tests" / "data" / "bundles" / "0.1-everything.h5"


def test_the_new_bundle_is_valid_and_tells_of_its_origin(vfplan_cli, tmp_path):
    new = tmp_path / "new.h5"
    env = {"SOURCE_DATE_EPOCH": "1767323045"}
    run = vfplan_cli("migrate", OLD, "-o", new, "--json", env=env)
    assert (run.code, run.json["version"]) == (0, "2.0")
    assert run.json["history"].startswith("2026-01-02T03:04:05Z")
    assert vfplan_cli("validate", new).code == 0
    first = new.read_bytes()
    assert vfplan_cli("migrate", OLD, "-o", new, "--overwrite", env=env).code == 0
    assert new.read_bytes() == first


def test_what_needs_no_migration_or_is_no_bundle_is_refused(vfplan_cli, tmp_path):
    new = tmp_path / "new.h5"
    assert vfplan_cli("migrate", OLD, "-o", new).code == 0
    assert vfplan_cli("migrate", new, "-o", tmp_path / "b.h5").code == 3
    assert vfplan_cli("migrate", OLD, "-o", new).code == 2
    (tmp_path / "x.h5").write_bytes(OLD.read_bytes()[:-1])
    assert vfplan_cli("migrate", tmp_path / "x.h5", "-o", tmp_path / "b.h5").code == 4
    assert not (tmp_path / "b.h5").exists()


def test_an_old_bundle_elsewhere_is_refused_with_the_command_that_helps(vfplan_cli):
    run = vfplan_cli("info", OLD)
    assert run.code == 4
    assert "vfplan migrate" in run.error_line
    assert "0.1" in run.error_line
    assert "has no seal" in run.error_line
