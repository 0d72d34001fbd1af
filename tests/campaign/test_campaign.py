"""Campaigns: closed forms, the same bits whoever makes them, and folders that go on."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from conftest import names_in
from refusals import refuses
from replays import fixture_of
from scipy.stats import norm

from vfplan.campaign.store import (
    BLOCK,
    entering,
    margin_for,
    margins,
    quantile,
    read_campaign,
    require_same_plan,
    run_campaign,
)  # fmt: skip
from vfplan.campaign.trial import CampaignSettings, Trials
from vfplan.errors import CheckFailed, InputError, OutputError, SceneError, SettingError
from vfplan.fixture import Curve, RegistrationRecord
from vfplan.replaying.link import approach_sessions
from vfplan.session.session import Session

pyarrow = pytest.importorskip("pyarrow", reason="needs pip install 'vfplan[campaign]'")

K, HAND, R, PRESS, FLE = 1000.0, 500.0, 5e-3, 3e-3, 6e-4
SHARE = K / (K + HAND)


def line_fixture():
    """A straight curve along x between nine markers, drawn at 0.5 mm a pixel."""
    T = np.array([[5e-4, 0, 0.3], [0, -5e-4, 0.2], [0, 0, 0.05]])
    u, v = np.meshgrid([100.0, 300.0, 500.0], [100.0, 300.0, 500.0])
    source = np.column_stack([u.ravel(), v.ravel()])
    pixels = np.column_stack([np.linspace(150, 450, 301), np.full(301, 300.0)])

    def carried(p):
        return np.column_stack([p, np.ones(len(p))]) @ T.T

    targets = carried(source)
    labels = tuple(f"m{k}" for k in range(9))
    sigma = np.full(9, 1e-4)
    record = RegistrationRecord("affine", "image", T, labels, source, targets, sigma, 1e-4)
    return replace(fixture_of(carried(pixels), stiffness=K, band=5e-6), registration=record)


def pressing(ticks=400):
    """A hand that presses PRESS deep onto the middle of the line from above, and lets go."""
    depth = R + 1e-3 - (PRESS + 1e-3) * np.sin(np.pi * np.linspace(0, 1, ticks))
    middle = line_fixture().points[150]
    hip = middle + np.column_stack([0 * depth, depth, 0 * depth])
    return Session(np.arange(ticks) * 1e-3, hip, name="pressing")


def settings(**more):
    return CampaignSettings(**({"fle_robot_m": FLE, "hand_stiffness": HAND} | more))


def leverage(at):
    """h of pixels (u, v, 1): the variance of their places over a marker's, each axis."""
    x = np.column_stack([line_fixture().registration.source, np.ones(9)])
    return at @ np.linalg.inv(x.T @ x) @ at.T


MIDDLE = np.array([300.0, 300.0, 1.0])  # of the line
SPREAD = SHARE * FLE / np.sqrt(3) * np.sqrt(leverage(MIDDLE))  # of the tool's depth [m]
MEAN = PRESS - R  # depth beyond the true curve of a hand that presses as recorded


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return campaign(tmp_path_factory.mktemp("campaign") / "c", 1000)


def campaign(where, trials=BLOCK, asked=None, **more):
    """As many trials of the pressed line in a folder, which is given back."""
    run_campaign(line_fixture(), [pressing()], where, trials, asked or settings(), **more)
    return where


def same_files(one, other):
    names = names_in(one)
    assert names == names_in(other)
    assert all((one / name).read_bytes() == (other / name).read_bytes() for name in names)


def test_a_line_pressed_at_one_place_is_a_normal_distribution(folder):
    depth = read_campaign(folder)[1]["depth_m"]
    assert len(depth) == 1024, "whole blocks"
    assert depth.mean() == pytest.approx(MEAN, abs=4 * SPREAD / 32)
    assert depth.std() == pytest.approx(SPREAD, rel=4 / np.sqrt(2 * 1024))
    for sigmas in (0.0, 1.0, 2.0):
        (entry,) = entering(depth, [MEAN + sigmas * SPREAD])
        assert entry["low"] <= norm.sf(sigmas) <= entry["high"]


def test_the_margin_for_p_makes_entering_as_rare_as_wished(folder):
    """Trials with the margin in the point radius: the share that enters is within its interval."""
    depth = read_campaign(folder)[1]["depth_m"] + 2e-3 - MEAN - 2e-3  # a press that just touches
    mm = margins(depth, [0.05], SHARE)[0]
    assert mm["margin_mm"] == pytest.approx(1e3 * norm.isf(0.05) * SPREAD / SHARE, rel=0.15)
    assert mm["low"] <= mm["margin_mm"] <= mm["high"]
    after = int((depth - SHARE * 1e-3 * mm["margin_mm"] > 0).sum())
    assert after == int(np.floor(0.05 * len(depth)))


def line_depths():
    """Quantiles 0.05, 0.5, 0.95 of the depth [m] of a hand that goes along the line.

    The surface is moved across the line by a + b s, so that a hand that goes along it is deepest
    where it begins or where it ends.
    """
    clear = (R + 5e-3) / 5e-4  # [px]
    at = np.array([[150 + clear, 300, 1], [450 - clear, 300, 1]])
    both = FLE**2 / 3 * leverage(at)
    deepest = SHARE * np.random.default_rng(1).multivariate_normal([0, 0], both, 10**6).max(axis=1)
    return np.quantile(deepest, [0.05, 0.5, 0.95])


@pytest.mark.parametrize("fle", [FLE, pytest.param(4 * FLE, id="slipping")])
def test_a_hand_of_no_session_does_not_slip_round_open_ends(fle):
    f = line_fixture()
    trials = Trials(f, approach_sessions(f, 200.0, to_ends=False), settings(fle_robot_m=fle))
    depth = np.array([trials.run(k)["depth_m"] for k in range(400)])
    for q, wanted in zip((0.05, 0.5, 0.95), fle / FLE * line_depths(), strict=True):
        _, low, high = quantile(np.sort(depth), q)
        assert low - 1e-5 <= wanted <= high + 1e-5


def test_a_stroke_too_short_to_press_on_is_refused():
    f = line_fixture()
    short = replace(f, points=f.points[:39], curve=Curve(np.zeros(39, np.int32), f.curve.closed))
    with refuses(InputError, "stroke-too-short"):
        approach_sessions(short, to_ends=False)


def test_the_same_bits_for_any_workers_and_after_a_stop(tmp_path):
    told = []
    few, rest = tmp_path / "few", tmp_path / "rest"
    campaign(few, 3 * BLOCK, workers=2, done=told.append)
    assert sum(told) == 3 * BLOCK
    assert run_campaign(line_fixture(), [pressing()], rest, BLOCK, settings()) == BLOCK
    assert run_campaign(line_fixture(), [pressing()], rest, 3 * BLOCK, settings()) == 2 * BLOCK
    same_files(few, rest)


def test_another_question_or_a_foreign_folder_is_refused(folder, tmp_path):
    with refuses(OutputError, "another-campaign"):
        campaign(folder, asked=settings(seed=1))
    with refuses(OutputError, "another-campaign"):
        run_campaign(line_fixture(), [pressing(300)], folder, 64, settings())
    (tmp_path / "mine.txt").write_text("x")
    with refuses(OutputError, "folder-not-empty"):
        campaign(tmp_path)
    with refuses(InputError, "too-few-trials", trials=1024, wanted=2000):
        read_campaign(folder, 2000)


def test_a_damaged_block_is_refused_by_name(tmp_path):
    block = campaign(tmp_path / "c") / "block-00000000.parquet"
    whole = block.read_bytes()
    for data in (whole[:100], b"", whole[:200] + b"\xff" * 50 + whole[250:]):
        block.write_bytes(data)
        with refuses(InputError, "damaged-block") as found:
            read_campaign(tmp_path / "c")
        assert found.value.where == str(block)


def test_a_fixture_without_a_registration_is_refused(tmp_path):
    bare = replace(line_fixture(), registration=None)
    with refuses(SceneError, "no-registration"):
        run_campaign(bare, [pressing()], tmp_path / "c", 64, settings())
    with refuses(SettingError, "stiffness-range"):
        settings(stiffness_range=(2.0, 1.0))
    assert not (tmp_path / "c").exists()


def test_margin_from_a_campaign(folder, tmp_path):
    assert margin_for(folder, 0.05) == 0.0, "a press that stays 2 mm away needs none"
    with refuses(CheckFailed, "too-few-trials", trials=BLOCK, needed=3700):
        margin_for(campaign(tmp_path / "c"), 0.001)


def test_a_margin_of_another_plan_or_on_a_margin_is_refused(folder):
    plan = line_fixture()
    require_same_plan(folder, plan)
    record = replace(plan.registration, target=0.5 * plan.registration.target)
    with refuses(CheckFailed, "campaign-of-another-plan"):
        require_same_plan(folder, replace(plan, registration=record))
    margined = replace(plan, provenance=replace(plan.provenance, settings={"margin": "tre95"}))
    with refuses(SceneError, "has-margin"):
        Trials(margined, [pressing()], settings())


@pytest.mark.parametrize("change", ["nan", "column", "share"])
def test_a_folder_with_numbers_that_no_campaign_gives_is_refused(tmp_path, change):
    import pyarrow.parquet

    where = campaign(tmp_path / "c")
    block, question = where / "block-00000000.parquet", where / "campaign.json"
    table = pyarrow.parquet.read_table(block)
    k = table.column_names.index("depth_m")
    if change == "share":
        question.write_text(json.dumps(json.loads(question.read_text()) | {"share": 1e9}))
    elif change == "column":
        pyarrow.parquet.write_table(table.remove_column(k), block)
    else:
        nothing = pyarrow.array(np.full(len(table), np.nan))
        pyarrow.parquet.write_table(table.set_column(k, "depth_m", nothing), block)
    with pytest.raises(InputError):
        margin_for(where, 0.2)


@pytest.mark.full
def test_a_dask_cluster_makes_the_same_bits_though_workers_are_killed(tmp_path):
    distributed = pytest.importorskip("distributed")
    here, there = campaign(tmp_path / "here", 20 * BLOCK), tmp_path / "there"
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        killed = []

        def kill(trials):
            if not killed:
                victim = next(iter(cluster.workers.values())).process.pid
                killed.append(victim)
                os.kill(victim, signal.SIGKILL)

        campaign(there, 20 * BLOCK, scheduler=cluster.scheduler_address, done=kill)
    assert killed
    same_files(here, there)


def test_a_killed_campaign_goes_on(tmp_path):
    """SIGKILL in the middle: what stands are whole blocks, and the rest is made by the next run."""
    where = tmp_path / "c"
    code = "import pathlib, sys; sys.path[:0] = sys.argv[2:]; from test_campaign import *"
    code += "\ncampaign(pathlib.Path(sys.argv[1]), 40 * BLOCK)"
    folders = [os.path.dirname(__file__), *sys.path]
    process = subprocess.Popen([sys.executable, "-c", code, str(where), *folders], cwd=tmp_path)
    while len(list(where.glob("block-*"))) < 3 and process.poll() is None:
        time.sleep(0.01)
    process.kill()
    process.wait()
    made = read_campaign(where)[1]["trial"]
    assert np.array_equal(made, np.arange(len(made)))
    target = len(made) // BLOCK + 1
    campaign(where, target * BLOCK)
    assert len(read_campaign(where)[1]["trial"]) >= target * BLOCK
    assert json.loads((where / "campaign.json").read_text())["settings"]["fle_robot_m"] == FLE
