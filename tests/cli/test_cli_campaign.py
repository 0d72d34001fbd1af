"""`vfplan campaign`: a report, a folder that goes on, a margin that `register` takes from it."""

import numpy as np
import pytest
from conftest import ELBOW, ROOT
from replays import write_session

import vfplan

pytest.importorskip("pyarrow", reason="needs pip install 'vfplan[campaign]'")


@pytest.fixture(scope="module")
def planned(vfplan_cli, tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "f.h5"
    assert vfplan_cli("plan", *ELBOW, "--pixel-spacing", "0.5", "-o", path, "-q").sound
    return path, ROOT / "samples" / "elbow_session.csv"


@pytest.mark.slow
def test_report_picture_and_going_on(vfplan_cli, planned, tmp_path):
    words = ("campaign", *planned, "-o", tmp_path / "c", "--workers", "1")
    first = vfplan_cli(*words, "--trials", "64", "--json", "--picture-out",
                       tmp_path / "p.png").sound  # fmt: skip
    told = first.json
    assert (told["trials"], told["trials_made"]) == (64, 64)
    assert [e["beyond_mm"] for e in told["p_enter"]] == [0.0, 0.5, 1.0]
    assert told["margin_for"][0]["p"] == 0.05
    assert set(told["depth_quantiles_mm"]) == {"0.5", "0.9", "0.95", "0.99"}
    assert (tmp_path / "p.png").read_bytes()[:4] == b"\x89PNG"
    again = vfplan_cli(*words, "--trials", "128", "--json").json
    assert (again["trials"], again["trials_made"]) == (128, 64)
    part = vfplan_cli(*words, "--trials", "130", "-v").stdout
    assert part.startswith("130 trials, 64 of them made now\n")
    assert "verdict: the tool goes more than 0 mm beyond the true curve with p = " in part

    margin = ("--margin", "p=0.2", "--campaign", tmp_path / "c")
    wider = vfplan_cli("plan", *ELBOW, "--pixel-spacing", "0.5", *margin,
                       "-o", tmp_path / "w.h5", "--json").sound  # fmt: skip
    added = wider.json["register"]["margin"]
    assert added["kind"] == "given"
    assert added["largest_m"] > 1e-3, "the session presses millimetres beyond the curve"


@pytest.mark.parametrize("more, says", [
    (("--fle-robot", "nan"), "'nan' is no number"),
    (("--margin-for", "2"), "2 is no probability"),
    (("--scheduler", "tcp://127.0.0.1:9", "--workers", "2"), "exclude each other"),
])  # fmt: skip
def test_usage(vfplan_cli, planned, tmp_path, more, says):
    run = vfplan_cli("campaign", *planned, "-o", tmp_path / "c", *more).fails(2, says)
    assert run.stdout == ""
    assert not (tmp_path / "c").exists()


def test_a_campaign_that_never_touches_is_not_tested(vfplan_cli, planned, tmp_path):
    session = vfplan.read_session(planned[1])
    far = vfplan.Session(session.time, session.hip + np.array([1.0, 0, 0]))
    write_session(tmp_path / "far.csv", far)
    words = ("campaign", planned[0], tmp_path / "far.csv", "-o", tmp_path / "c", "--trials", "64")
    run = vfplan_cli(*words, "--workers", "1", "--json")
    assert (run.code, run.json["verdict"]) == (1, "not-tested")
    assert run.json["trials_in_contact"] == 0


def test_a_margin_wants_both_words(vfplan_cli, tmp_path):
    for words in (("--margin", "p=0.1"), ("--margin", "p=7", "--campaign", tmp_path)):
        vfplan_cli("plan", *ELBOW, *words, "-o", tmp_path / "x.h5").fails(2)
