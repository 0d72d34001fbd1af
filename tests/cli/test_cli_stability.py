"""`vfplan stability` as a user runs it, and the gate of `vfplan plan`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundles import PROVENANCE, stored, whole
from conftest import ELBOW, names_in
from vfplan.cli.stability import MAX_STIFFNESS

from vfplan.bundle.content import max_number
from vfplan.bundle.read import read_fixture
from vfplan.fixture import Fixture

KEYS = {"cases", "k_max_n_per_m", "k_linear_bound_n_per_m", "stable", "left_out", "elapsed_s"}


@pytest.fixture
def dot(tmp_path):
    """A bundle of one point in space: few scenes to run."""
    rendering = replace(whole().rendering, ignore_axis=None)
    fixture = Fixture("robot_base", np.array([[0.4, 0.0, 0.2]]), PROVENANCE, rendering=rendering)
    return stored(tmp_path / "dot.h5", fixture)


@pytest.mark.slow
def test_study_of_a_point(vfplan_cli, dot, tmp_path):
    folder = tmp_path / "report"
    options = ("--part", "closed-loop", "--part", "passivity")
    run = vfplan_cli("stability", dot, *options, "-o", folder, "--json")
    assert run.json.keys() >= KEYS
    assert run.json["stable"] is True
    assert run.json["k_linear_bound_n_per_m"] == pytest.approx(10_000)
    loops = [row for row in run.json["cases"] if row["case"].startswith("closed-loop/")]
    loops = [row for row in loops if row["case"] != "closed-loop/blows"]
    assert {row["scene"] for row in loops} == {"point", "bundle"}
    least = {rule: min(row["measured"] for row in loops if row["rule"] == rule)
             for rule in ("robust", "paper")}  # fmt: skip
    assert run.json["k_max_n_per_m"] == least["robust"]
    assert run.json["k_max_by_rule_n_per_m"] == least
    assert "closed-loop/flat" in run.json["left_out"]
    for row in run.json["cases"]:
        assert row.keys() >= {"case", "outcome", "detail", "limit", "measured"}
    assert names_in(folder) == ["passivity.png", "stability.json"]
    vfplan_cli("stability", dot, "--part", "closed-loop", "-o", folder).fails(2, "overwrite")


def test_a_stiffness_beyond_the_bound_exits_1_and_names_what_passes(vfplan_cli, dot):
    assert max_number("/rendering/stiffness") == MAX_STIFFNESS
    options = ("--robot", "franka", "--stiffness", 3000, "--part", "closed-loop", "--json")
    run = vfplan_cli("stability", dot, *options).fails(1)
    assert run.json["stable"] is False
    assert run.json["k_pass_n_per_m"] == pytest.approx(1629 / 1.25, rel=0.03)
    assert run.json["robot"]["delay_ticks"] == 1


def test_without_a_robot_the_next_step_asks_for_one(vfplan_cli, dot):
    run = vfplan_cli("stability", dot, "--part", "closed-loop", "--json")
    assert "'assumed'" in run.json["verdict"]
    assert run.json["next"].endswith(f": vfplan stability {dot} --robot franka")


def test_the_step_that_is_open_after_a_stable_bundle(vfplan_cli, dot, tmp_path):
    words = ("--damping", 5, "--part", "closed-loop", "--json")
    assert vfplan_cli("stability", dot, *words).json["next"].startswith("vfplan review")
    key, signed = tmp_path / "k.key", tmp_path / "signed.h5"
    assert vfplan_cli("keygen", "-o", key).sound
    case = ("--case", "C 1", "--despite-findings")
    assert vfplan_cli("sign", dot, "--key", key, *case, "-o", signed).sound
    following = vfplan_cli("stability", signed, *words).json["next"]
    assert following == f"vfplan verify {signed} --keys {key.with_suffix('.pub')} --case 'C 1'"


def test_options_win_over_the_robot(vfplan_cli, dot):
    words = "--robot franka --delay-ticks 0 --damping 20 --rate 500 --filter 0 --part closed-loop"
    run = vfplan_cli("stability", dot, *words.split(), "--json")
    assert run.json["k_linear_bound_n_per_m"] == pytest.approx(20 * 500 * 2)
    assert [blow["rests"] for blow in run.json["blows"]] == [True, True, True]


@pytest.mark.parametrize(
    "filter_hz, damping, least_hz",
    [(1e-12, 5, 0.5), (1e-6, 5, 0.5), (0.1, 5, 0.5), (5, 1000, 100)],
)
def test_a_filter_behind_which_a_hand_bears_every_stiffness_is_refused(
    filter_hz, damping, least_hz, vfplan_cli, dot
):
    words = ("stability", dot, "--filter", filter_hz, "--damping", damping, "--json")
    run = vfplan_cli(*words).fails(2, f"at least {least_hz:g} Hz, or 0", error="filter-slow")
    assert run.json["error"]["numbers"] == {"filter_hz": filter_hz, "least_hz": least_hz}


def test_bad_input(vfplan_cli, tmp_path):
    assert vfplan_cli("stability", tmp_path / "none.h5").code in (3, 4)
    assert vfplan_cli("stability", "--mass", -1).code == 2
    for option in ("mass", "damping", "rate", "stiffness", "margin"):
        for value in ("nan", "inf"):
            vfplan_cli("stability", f"--{option}", value).fails(2, option, value)


def test_plan_stores_the_verdict(vfplan_cli, tmp_path):
    output = tmp_path / "fixture.h5"
    run = vfplan_cli("plan", *ELBOW, "-o", output, "--robot", "franka").sound
    stored = read_fixture(output).stability
    assert stored.robot == "franka"
    assert stored.stable
    # Each number says what it is for: `vfplan stability` tries more than the bundle's own rule.
    largest = f"{stored.k_max_n_per_m:.0f} N/m"
    assert f"stable up to {largest} with robot franka, on this curve alone\n" in run.stdout
    again = vfplan_cli("plan", *ELBOW, "-o", output, "--robot", "franka", "--overwrite", "--json")
    assert again.json["stability"]["k_max_n_per_m"] == stored.k_max_n_per_m
    words = ("stability", output, "--robot", "franka", "--part", "closed-loop")
    assert (
        "1629 N/m in all scenes tried, by all rules for robots" in vfplan_cli(*words).sound.stdout
    )


def test_plan_refuses_what_is_not_stable_and_writes_nothing(vfplan_cli, tmp_path):
    words = ("-o", tmp_path / "fixture.h5", "--robot", "franka", "--stiffness", 5000)
    vfplan_cli("plan", *ELBOW, *words).fails(1, "allowed with a margin of 1.25")
    assert not list(tmp_path.iterdir())
