"""`vfplan validate`: every issue, with place, code and severity; exit 1 if one is an error."""

from dataclasses import replace

import bundles
import damage
import hostile
import numpy as np
import pytest

import vfplan


def test_a_sound_bundle_is_valid_and_says_what_it_is_not(vfplan_cli, tmp_path):
    run = vfplan_cli("validate", bundles.stored(tmp_path / "a.h5", bundles.whole()), "--json").sound
    assert run.json["valid"]
    codes = {issue["code"] for issue in run.json["issues"]}
    assert codes == {"seal.unsigned", "leak.open_ends", "leak.between", "review.missing"}
    assert {issue["severity"] for issue in run.json["issues"]} == {"note"}


def test_every_issue_is_found_not_the_first_one(vfplan_cli, tmp_path):
    def harm(f):
        hostile.text(f["points"], "unit", "mm")
        f["sigma"][3] = -1
        hostile.text(f["provenance"], "created_utc", "yesterday")
        f["registration/labels"][1] = b"x1"

    (tmp_path / "a.h5").write_bytes(damage.sealed(hostile.changed(harm)))
    run = vfplan_cli("validate", tmp_path / "a.h5", "--json").fails(1)
    assert not run.json["valid"]
    found = {(i["location"], i["code"]) for i in run.json["issues"] if i["severity"] == "error"}
    assert found == {("/points", "corrupt.unit"), ("/sigma", "corrupt.range"),
                     ("/provenance@created_utc", "corrupt.value"),
                     ("/registration/labels", "corrupt.value")}  # fmt: skip
    assert "NOT valid: 4 errors" in vfplan_cli("validate", tmp_path / "a.h5").stdout


def test_a_file_that_is_no_bundle_is_invalid_and_a_missing_one_bad_input(vfplan_cli, tmp_path):
    (tmp_path / "a.h5").write_text("label,u_px\n")
    run = vfplan_cli("validate", tmp_path / "a.h5", "--json")
    assert (run.code, run.json["valid"], "`vfplan plan`" in run.stdout) == (1, False, True)
    assert vfplan_cli("validate", tmp_path / "none.h5").code == 3


@pytest.mark.parametrize("across_m, moved_m, doubtful", [
    (0.05, 0.4, False), (2.5, 1, False), (50, 0, True), (5e-5, 0.4, True), (0.05, 50, True),
])  # fmt: skip
def test_a_size_that_a_wrong_unit_gives_is_warned_of(across_m, moved_m, doubtful, vfplan_cli,
                                                     tmp_path):  # fmt: skip
    base = bundles.minimal()
    points = base.points - base.points[0]
    points = points * across_m / np.ptp(points, axis=0).max() + moved_m
    vfplan.write_fixture(replace(base, points=points), tmp_path / "a.h5")
    run = vfplan_cli("validate", tmp_path / "a.h5", "--json").sound
    assert ("points.size" in {i["code"] for i in run.json["issues"]}) is doubtful


@pytest.mark.parametrize("change, says", [
    ({"contact_radius": 5e-10, "band": 1e-11}, "contact_radius is 5e-10 m"),
    ({"band": 4e-11}, "band is 4e-11 m"),
    ({"stiffness": np.array([1000.0, 0.0, 1000.0])}, "stiffness"),
])  # fmt: skip
def test_what_the_format_allows_and_no_engine_renders_is_warned_of(change, says, vfplan_cli,
                                                                   tmp_path):  # fmt: skip
    """The format is wider than the engine: the bundle is valid, and nothing replays it."""
    base = bundles.small()
    bare = replace(base, rendering=replace(base.rendering, **change))
    run = vfplan_cli("validate", bundles.stored(tmp_path / "a.h5", bare), "--json")
    assert (run.code, run.json["valid"]) == (0, True)
    (issue,) = (i for i in run.json["issues"] if i["code"] == "rendering.engine")
    assert (issue["severity"], issue["location"]) == ("warning", "/rendering")
    assert says in issue["message"]
    (tmp_path / "s.csv").write_text("t,x,y,z\n0,0.4,0,0.2\n0.001,0.4,0,0.2\n")
    for words in (["replay", "a.h5", "s.csv"], ["stability", "a.h5"]):
        refused = vfplan_cli(*words, cwd=tmp_path).fails(3)
        assert refused.stderr.startswith("vfplan: error: a.h5: no engine renders it: " + says)


def test_a_path_is_warned_of(vfplan_cli, tmp_path):
    fixture = bundles.whole()
    fixture.provenance.settings["source"] = "/home/someone/slice.png"
    run = vfplan_cli("validate", bundles.stored(tmp_path / "a.h5", fixture), "--json").sound
    warned = {i["code"] for i in run.json["issues"] if i["severity"] == "warning"}
    assert warned == {"provenance.path"}
