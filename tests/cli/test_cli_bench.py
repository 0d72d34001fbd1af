"""`vfplan bench all --quick`, once, and what its files must hold."""

import json
from itertools import pairwise

import numpy as np
import pytest
from click.testing import CliRunner
from vfplan.cli.main import cli

from vfplan.bench.record import table_lines
from vfplan.display import duration

pytestmark = pytest.mark.slow
STAGES = ("extract", "sample", "register", "proxy", "plan")


@pytest.fixture(scope="module")
def quick(vfplan_cli, nanoflann_peer, tmp_path_factory):
    """The quick bench with the shipped peers: its folder and its document."""
    folder = tmp_path_factory.mktemp("bench") / "out"
    run = vfplan_cli("bench", "all", "--quick", "-o", folder, "--json").sound
    assert run.stderr == "", "no progress in a pipe, no warning with the peer there"
    return folder, run.json


@pytest.fixture(scope="module")
def document(quick):
    return quick[1]


def of(document, **wanted):
    return [r for r in document["results"] if all(r.get(k) == v for k, v in wanted.items())]


def scenes(document, stage):
    return list(dict.fromkeys(r["scene"] for r in of(document, stage=stage)))


def test_results_hold_what_the_contract_names(document):
    for r in document["results"]:
        for key in ("stage", "scene", "method", "settings", "unit", "pareto"):
            assert key in r
        assert 0 <= r["error_rms"] <= r["error_max"]
        assert 0 < r["time_us_median"] <= r["time_us_p999"]
    assert document["machine"]["processor"]
    assert document["elapsed_s"] > 0
    assert [p["name"] for p in document["peers"]][:2] == ["nanoflann_peer", "nearest-point penalty"]


def falling(rows, key, tightest_last):
    ordered = sorted(rows, key=lambda r: r["settings"][key], reverse=not tightest_last)
    return [r["error_rms"] for r in ordered]


def test_errors_fall_as_settings_tighten(document):
    for scene in scenes(document, "extract"):
        rows = of(document, stage="extract", scene=scene, method="ridge")
        errors = falling(rows, "scale", tightest_last=True)
        assert all(fine < coarse for coarse, fine in pairwise(errors))
    for scene in scenes(document, "sample"):
        rows = of(document, stage="sample", scene=scene, method="by curvature")
        errors = falling(rows, "tolerance_m", tightest_last=False)
        assert all(fine < coarse / 2 for coarse, fine in pairwise(errors))
    affine = of(document, stage="register", method="affine")
    for scene in scenes(document, "register"):
        errors = falling([r for r in affine if r["scene"] == scene], "markers", True)
        assert errors[-1] < errors[0] / 1.5
    for scene in scenes(document, "plan"):
        errors = falling(of(document, stage="plan", scene=scene, method="ridge"), "tolerance_m",
                         False)  # fmt: skip
        assert all(fine < 1.05 * coarse for coarse, fine in pairwise(errors))
    for scene in scenes(document, "proxy"):
        rows = of(document, stage="proxy", scene=scene, method="robust")
        if len(rows) < 2:  # a quick run tries one spacing of meshes and noise
            continue
        coarse, fine = falling(rows, "spacing_m", tightest_last=False)
        assert fine < coarse or fine < 1e-9, "the floor on flat pieces is rounding"


def test_no_baseline_is_as_near_as_the_robust_rule(document):
    assert len(scenes(document, "proxy")) == 8
    for scene in scenes(document, "proxy"):
        if "noise" in scene:  # both rest on the noise's peaks
            continue
        rows = {r["method"]: r for r in of(document, stage="proxy", scene=scene)
                if r["settings"].get("spacing_m") == (1e-3 if "mesh" in scene
                                                      else 0.5e-3)}  # fmt: skip
        baselines = {"nearest-point penalty", "paper", "nanoflann_peer"}
        for baseline in baselines & rows.keys():
            assert rows["robust"]["error_rms"] < rows[baseline]["error_rms"], (scene, baseline)
            assert rows["robust"]["force_rms_n"] < rows[baseline]["force_rms_n"]


def test_the_chosen_settings_keep_the_tolerance_and_lie_near_the_front(document):
    tolerance = document["tolerance_m"]
    for scene in scenes(document, "sample"):
        (chosen,) = of(document, stage="sample", scene=scene, chosen=True)
        assert chosen["error_max"] <= tolerance, scene
    for chosen in of(document, stage="proxy", chosen=True):
        # What was measured is further off than the tolerance.
        assert chosen["meets_tolerance"] is ("noise" not in chosen["scene"])


def test_files_say_what_the_document_says(quick, vfplan_cli):
    folder, document = quick
    vfplan_cli("bench", "extract", "--quick", "-o", folder).fails(2, "exists already")
    assert {p.name for p in folder.iterdir()} == {
        "bench.json", *(f"bench_{stage}.png" for stage in (*STAGES, "summary"))
    }  # fmt: skip
    assert json.loads((folder / "bench.json").read_text())["results"] == document["results"]
    lines = table_lines(document)
    assert {f"proxy: {scene}" for scene in scenes(document, "proxy")} < set(lines)
    assert sum(line.endswith("chosen by tolerance") for line in lines) == 8
    assert not any(" us " in line or "e-0" in line for line in lines)


def test_the_summary_is_one_sentence_and_stands_alone(document, monkeypatch):
    monkeypatch.setattr("vfplan.bench.pipeline.bench", lambda *_, **__: document)
    sentence = CliRunner().invoke(cli, ["bench", "summary", "--peer", "true"]).stdout
    assert sentence.strip() == document["summary"]["proxy"]
    rows = of(document, stage="proxy", chosen=True)
    median = duration(1e-6 * np.median([r["time_us_median"] for r in rows]))
    tail = duration(1e-6 * max(r["time_us_p999"] for r in rows))  # in the unit that suits it
    of_setting = f"a tick at default settings takes a median of {median} (p99.9 at most {tail})"
    assert sentence.startswith(f"Over 8 scenes, {of_setting}, with a median RMS error of ")
    for peer in ("paper", "nanoflann_peer", "nearest-point penalty"):
        assert f"; {peer} takes a median of " in sentence


def test_meshes_and_noise_are_among_the_scenes(document):
    told = scenes(document, "proxy")
    assert {"ball-mesh, outside", "box-mesh, over an edge", "sheet, 10 % noise"} <= set(told)
    for scene in ("ball-mesh, outside", "box-mesh, over an edge"):
        rows = {r["method"]: r for r in of(document, stage="proxy", scene=scene)}
        assert rows["exact"]["error_rms"] < rows["robust"]["error_rms"] / 2
        assert rows["exact"]["error_rms"] < rows["nanoflann_peer"]["error_rms"] / 2
