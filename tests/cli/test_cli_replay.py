"""`vfplan replay`: its report, its files, its exit codes, and what it does not load."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial

import bundles
import h5py
import numpy as np
import pytest
from conftest import ELBOW, file_with, names_in, output
from meshes import sphere
from replays import at_1_khz, fixture_of, line, meshed, probing, write_session

import vfplan
from vfplan.bundle.seal import keygen, sign
from vfplan.findings import doubt

PAPER = ("--rule", "paper", "--engine", "reference")
KEYS = {
    "rule", "ticks", "duration_s", "contact_ticks", "episodes", "penetration_max_m",
    "penetration_rms_m", "overlap_max_m", "force_max_n", "force_rms_n", "force_step_max_n",
    "clearance_min_m", "entrenched_ticks", "energy_j", "states", "scene", "left_out", "step_us",
    "elapsed_s",
}  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("replay")
    write_session(folder / "session.csv", probing())
    return bundles.stored(folder / "line.h5", fixture_of(line())), folder / "session.csv"


@pytest.fixture
def replayed(vfplan_cli, files):
    return partial(vfplan_cli, "replay", *files)


@pytest.mark.parametrize("how", [(), PAPER])
def test_report_has_the_promised_keys_and_files(replayed, tmp_path, how):
    out, table = tmp_path / "r.h5", tmp_path / "r.csv"
    found = replayed(*how, "-o", out, "--csv", table, "--json").sound.json
    assert set(found) >= KEYS
    assert set(found["states"]) == {"-1", "0", "1", "2"}
    times = [found["step_us"][name] for name in ("median", "p99", "p999", "max")]
    assert times == sorted(times)
    assert 0.01 < times[0] < 1e4
    assert set(found["scene"]) >= {"planar", "points", "point_radius_m"}
    assert len(found["fixture"]["sha256"]) == len(found["session"]["sha256"]) == 64
    with h5py.File(out) as file:
        assert (file.attrs["format"], file["force"].shape) == ("vfplan-result", (3000, 3))
        force = np.linalg.norm(file["force"][:], axis=1)
    assert force.max() == pytest.approx(found["force_max_n"], rel=1e-12)
    assert (len(table.read_text().splitlines()), names_in(tmp_path)) == (3001, ["r.csv", "r.h5"])


def test_the_reference_engine_implies_the_papers_rule(replayed):
    run = replayed("--engine", "reference").sound
    assert run.stdout.startswith("rule paper (reference engine): ")
    replayed("--engine", "reference", "--rule", "robust").fails(2, "'paper' only")


@pytest.mark.parametrize("fault", [("--quantise", "10"), ("--jitter", "1"), ("--delay", "2")])
def test_a_link_that_loses_nothing_is_told_too(replayed, fault):
    run = replayed(*fault).sound
    assert "lossy link" in run.stdout
    assert "packets lost" not in run.stdout
    # A seed is for what is random.
    assert replayed(*fault, "--seed", "3").code == 2 * ("--jitter" not in fault)


def test_inputs_are_never_replaced(vfplan_cli, files, tmp_path):
    fixture, session = tmp_path / "f.h5", tmp_path / "s.csv"
    for path, source in zip((fixture, session), files, strict=True):
        path.write_bytes(source.read_bytes())
    for option, path in (("-o", fixture), ("--csv", session)):
        vfplan_cli("replay", fixture, session, option, path,
                   "--overwrite").fails(2, "is an input of this call")  # fmt: skip
    assert (fixture.read_bytes(), session.read_bytes()) == tuple(p.read_bytes() for p in files)
    assert names_in(tmp_path) == ["f.h5", "s.csv"]


@pytest.mark.parametrize("how", [(), PAPER])
def test_replay_loads_no_picture_library(files, tmp_path, how):
    code = (
        "import sys; from click.testing import CliRunner; from vfplan.cli.main import cli; "
        f"r = CliRunner().invoke(cli, ['replay', *{[str(f) for f in files]!r}, *{how!r}]); "
        "assert r.exit_code == 0, r.output; "
        "print(*{m.split('.')[0] for m in sys.modules})"
    )
    loaded = set(output(sys.executable, "-c", code, cwd=tmp_path).split())
    heavy = {"cv2", "skimage", "matplotlib", "pyvista", "vtk", "vtkmodules", "scipy"}
    assert not loaded & heavy


def test_report_folder(replayed, tmp_path):
    assert replayed("--report", tmp_path / "out", "--json").sound
    assert names_in(tmp_path / "out") == ["index.html"]
    assert replayed("--report", tmp_path / "out").code == 2
    assert replayed("--report", tmp_path / "out", "--overwrite").sound
    assert replayed("--image", tmp_path / "no.png").code == 2


def test_signature_can_be_demanded(vfplan_cli, files, tmp_path):
    signed, (public, _) = tmp_path / "signed.h5", keygen(tmp_path / "key")
    sign(files[0], signed, tmp_path / "key", case="C1", despite_findings=True)
    demand = ("--require-signature", public)
    assert vfplan_cli("replay", files[0], files[1], *demand).code == 4
    assert vfplan_cli("replay", signed, files[1], *demand, "--case", "C2").code == 4
    demand += ("--case", "C1", "--report", tmp_path / "page")
    run = vfplan_cli("replay", signed, files[1], *demand, "--json").sound
    assert "<p>Case C1; approved by nobody" in (tmp_path / "page" / "index.html").read_text()
    assert [run.json["fixture"][name] for name in ("signed", "signature_checked")] == [True, True]
    assert vfplan_cli("replay", signed, files[1], "--case", "C1").code == 2


def test_depth_on_the_planned_slice(vfplan_cli, root, tmp_path):
    image, *markers = ELBOW
    fixture = tmp_path / "f.h5"
    assert vfplan_cli("plan", image, *markers, "--pixel-spacing", "0.5", "-o", fixture).sound
    call = ("replay", fixture, root / "samples" / "elbow_session.csv", "--report")
    run = vfplan_cli(*call, tmp_path / "one", "--image", image, "--json").sound
    assert not {"band_m", "max_iterations"} & set(run.json["scene"])
    assert run.json["scene"]["lines_and_arcs"] == vfplan.read_fixture(fixture).pieces.count
    assert "penetration on the slice" in (tmp_path / "one" / "index.html").read_text()
    other = file_with(tmp_path / "other.png", image.read_bytes() + b" ")
    drawn = tmp_path / "two"
    for words in (
        (*call, drawn, "--image", other),
        ("review", fixture, "--slice", other, "--sheet-out", drawn.with_suffix(".png")),
    ):
        vfplan_cli(*words).fails(3, f"{other}: This is not the slice that the curve was drawn on")
    assert not list(tmp_path.glob("two*"))


@pytest.mark.parametrize("limits, code, verdict", [
    ([], 0, "not-tested"),
    (["--at-most", "force_max_n=1000"], 0, "pass"),
    (["--at-most", "force_max_n=1e-6"], 1, "fail"),
])  # fmt: skip
def test_verdict_of_a_session_that_touches(replayed, limits, code, verdict, tmp_path):
    report = "--report", tmp_path / "rep"
    run = replayed(*limits, "-o", tmp_path / "r.h5", *report, "--json")
    assert (run.code, run.json["verdict"], (tmp_path / "r.h5").exists()) == (code, verdict, True)
    assert run.json["next"].endswith(str(report[1] / "index.html")) == bool(code)
    run = replayed(*limits, "--json")
    told = replayed(*limits).stdout.splitlines()[-2:]
    assert told[0].startswith(f"verdict: {verdict}, never beyond the drawn line; ")
    assert told[1] == f"next: {run.json['next'].replace(' --json', '')}"


@pytest.mark.parametrize("limits", [(), ("--at-least", "force_max_n=3")])
def test_a_session_that_begins_inside_is_told_to_begin_outside(vfplan_cli, limits, tmp_path):
    vfplan.write_fixture(meshed(*sphere(30e-3, 4)), tmp_path / "ball.h5")
    hip = np.outer(np.linspace(5e-3, 8e-3, 300), [0, 0, 1.0])
    write_session(tmp_path / "deep.csv", at_1_khz(hip))
    run = vfplan_cli("replay", tmp_path / "ball.h5", tmp_path / "deep.csv", *limits)
    verdict, following = run.stdout.splitlines()[-2:]
    assert " mm inside the surface; " in verdict
    assert following.startswith("next: replay a session that begins outside the mesh")


def test_limits_on_a_session_that_stays_away_are_not_tested(vfplan_cli, files, tmp_path):
    session, far = probing(), tmp_path / "far.csv"
    write_session(far, vfplan.Session(session.time, session.hip + np.array([0, 1.0, 0])))
    limits = "--robot", "franka", "--at-most", "force_max_n=5"
    run = vfplan_cli("replay", files[0], far, *limits, "--report", tmp_path / "page", "--json")
    assert (run.code, run.json["verdict"]) == (1, "not-tested")
    assert 'verdict not-tested">NOT TESTED' in (tmp_path / "page" / "index.html").read_text()
    assert vfplan_cli("replay", files[0], far, *limits).stdout.startswith("NOT TESTED")
    run = vfplan_cli("replay", files[0], far, "--at-most", "duration_s=0.001", "--json")
    assert (run.code, run.json["verdict"]) == (1, "fail")


def test_open_findings_are_told(vfplan_cli, files, tmp_path):
    bundle, session = files
    fixture = vfplan.read_fixture(bundle)
    doubtful = replace(fixture, findings=(doubt("size-unusual", "plan", "Large."),))
    vfplan.write_fixture(doubtful, tmp_path / "d.h5")
    for path, count in ((bundle, 0), (tmp_path / "d.h5", 1)):
        warnings = vfplan_cli("replay", path, session, "--json").json.get("warnings", [])
        assert len(warnings) == count
        # The bundle has no slice, so its review needs none.
        assert not any("--slice" in warning for warning in warnings)
