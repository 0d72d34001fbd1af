"""What is refused, and that good markers are not: planted mistakes, outliers, scales, bounds."""

from __future__ import annotations

import numpy as np
import pytest
from bundles import PROVENANCE
from conftest import ROOT
from docs_modules import load
from layouts import NAMES, bent, every_model, fit, grid, planar, solid
from marker_sets import marker_sets

from vfplan.errors import CheckFailed, MarkerError
from vfplan.fixture import Curve, Fixture, Stroke
from vfplan.registration.checks import refuse_large_error, refuse_wrong_markers
from vfplan.registration.registration import own_bound, target_error

table = load(ROOT / "docs" / "make_registration_table.py")


def refusal(registration, max_residual_m=1e-3, **settings):
    with pytest.raises((CheckFailed, MarkerError)) as caught:
        refuse_wrong_markers(registration, max_residual_m, **settings)
    return caught.value


def judged(sets, model, change=lambda rng, markers: markers.target, **settings):
    rng = np.random.default_rng(1)
    chosen = marker_sets(sets, model=model, **settings)
    return [table.judge(markers, change(rng, markers), model)[0] for markers in chosen]


COUNT = pytest.mark.parametrize("sets", [30, pytest.param(600, marks=pytest.mark.full)])


@COUNT
@every_model
def test_good_markers_are_not_refused(model, sets):
    assert judged(sets, model, fle_m=0.5e-3, seed=2).count("refused") == 0
    assert judged(sets, model).count("refused") <= 0.01 * sets


@every_model
@pytest.mark.parametrize("sets", [300, pytest.param(600, marks=pytest.mark.full)])
def test_few_good_markers_have_a_doubt_to_answer(model, sets):
    chosen = [markers for markers in marker_sets(sets, model=model) if not markers.is_symmetric]
    verdicts = [table.judge(markers, markers.target, model)[0] for markers in chosen]
    assert verdicts.count("doubt") <= 0.05 * len(verdicts)


@COUNT
@every_model
@pytest.mark.parametrize("mistake", ["reversed", "shifted", "exchanged", "permuted"])
def test_no_label_mistake_passes_in_silence(mistake, model, sets):
    def change(rng, markers):
        return markers.target[table.mistaken_orders(rng, len(markers.source))[mistake]]

    assert "silent" not in judged(sets, model, change)


@COUNT
@every_model
def test_an_outlier_is_refused_or_doubted(model, sets):
    rng = np.random.default_rng(1)
    refused, three = 0, []
    for markers in marker_sets(sets, model=model):
        verdict, _ = table.judge(markers, table.with_outlier(rng, markers.target), model)
        refused += verdict == "refused"
        if len(markers.source) == 3:
            three.append(verdict)
        else:
            assert verdict in ("refused", "doubt")
    assert refused >= 290 / 294 * sets - 1
    # An error across the plane of three markers leaves no residual. A note says so of all of them.
    assert "silent" not in three
    assert three.count("note") <= 0.1 * len(three)


@every_model
def test_exchanged_labels_are_named(model):
    rng = np.random.default_rng(3)
    for _ in range(20):
        target = planar(grid(), seed=rng.integers(1 << 30))
        right = fit(grid(), target, model).fre_rms_m
        i, j = sorted(rng.permutation(9)[:2])
        target[[i, j]] = target[[j, i]]
        error = refusal(fit(grid(), target, model))
        assert (error.code, error.numbers["action"]) == ("labels-mistaken", "exchanged")
        assert error.numbers["labels"] == [NAMES[{i: j, j: i}.get(k, k)] for k in range(9)]
        assert error.numbers["fre_rms_m_corrected"] == pytest.approx(right)
        assert NAMES[i] in error.message
        assert f"{1e3 * right:.2f} mm" in error.message
        # As they are given, the markers would be refused for their residuals all the same.
        assert "--markers-as-given" not in error.message
        error = refusal(fit(grid(), target, model), None)
        assert "--markers-as-given" in error.message
        assert error.exit_code == 1


@pytest.mark.parametrize("order, action", [
    (np.arange(9)[::-1], "reversed"),
    (np.roll(np.arange(9), 1), "shifted"),
    (np.arange(9).reshape(3, 3).T.ravel(), "transposed"),
])  # fmt: skip
def test_the_usual_mistakes_have_names(order, action):
    rng = np.random.default_rng(0)
    source = rng.uniform(60, 960, (9, 2))
    target = planar(source)
    error = refusal(fit(source, target[np.argsort(order)]))
    assert (error.code, error.numbers["action"]) == ("labels-mistaken", action)


def test_labels_as_given_leave_the_residual_gate():
    target = planar(grid())
    target[[1, 5]] = target[[5, 1]]
    r = fit(grid(), target)
    assert refusal(r, markers_as_given=True).code == "residual-large"
    refuse_wrong_markers(r, None, markers_as_given=True)


def test_the_residual_gate_names_the_marker_and_its_numbers():
    target = planar(grid())
    target[3] += [0, 0.01, 0]
    r = fit(grid(), target)
    error = refusal(r)
    assert error.code == "residual-large"
    assert error.numbers == {"fre_rms_m": r.fre_rms_m, "max_residual_m": 1e-3}
    assert "x4" in error.message
    refuse_wrong_markers(r, 5e-3)
    refuse_wrong_markers(r, None)
    refuse_wrong_markers(fit(grid(), target, robust=True), 1e-3)
    seen = refusal(fit(grid(), bent(grid(), noise=1e-4)))
    assert (seen.code, "homography" in seen.message) == ("residual-large", True)


@pytest.mark.parametrize("factor", [1e-3, 0.1, 0.4, 2.5, 25.4, 1e3])
def test_a_scale_that_is_another_unit_is_refused(factor):
    error = refusal(fit(grid(), planar(grid()) * factor), None)
    assert error.code == "scale-wrong"
    assert error.numbers["ratio"] == pytest.approx(factor, rel=0.02)
    source, target = solid(6)
    assert refusal(fit(source, target * factor, "similarity"), None).code == "scale-wrong"


def test_a_tie_or_an_exact_fit_is_never_refused():
    source = grid(jitter=0.0)
    for noise in (0.0, 1e-12, 3e-4):
        for seed in range(20):
            refuse_wrong_markers(fit(source, planar(source, noise, seed)), 1e-3)


@pytest.mark.parametrize("name, cause, advice", [
    ("bridged", "bridge", "gap that the curve bridges there"),
    ("edited", "by-hand", "Draw that part with the pen"),
    ("other", "crossing", "Erase what does not belong"),
    ("blur", "ink", "sharper picture"),
    ("none", "markers", "Add markers around"),
    ("touched", "touched", "Touch more places"),
])  # fmt: skip
def test_a_large_bound_is_refused_and_names_its_largest_part_and_the_place(name, cause, advice):
    r, drawn = fit(grid(), planar(grid())), grid()
    is_there = np.arange(len(drawn)) == 4
    high = 0.0 if cause in ("markers", "touched") else 9.0
    sigma = np.where(is_there | (name == "blur"), high, 0.1)
    flags = {name: is_there} if name in ("bridged", "edited") else {}
    stroke = Stroke(np.pad(drawn, [(0, 0), (0, 1)]), False, sigma, **flags)
    curve = Fixture("image", stroke.points, PROVENANCE, curve=Curve.of([stroke]), sigma=sigma)
    error = target_error(r, drawn, own_bound([stroke]))
    assert error.curve95_m.max() > error.bound95_m.max() > error.rms_m.max()
    refuse_large_error(error, error.curve95_m.max(), curve)
    with pytest.raises(CheckFailed, match=advice) as caught:
        refuse_large_error(error, 1e-4, curve, is_touched=name == "touched")
    assert (caught.value.code, caught.value.exit_code) == ("tre-large", 1)
    assert caught.value.numbers == {
        "curve95_max_m": error.curve95_m.max(), "max_tre_m": 1e-4, "point": error.worst,
        "cause": cause,
    }  # fmt: skip
    assert "({:.0f}, {:.0f}) px".format(*drawn[error.worst]) in caught.value.message
    assert "(the " not in caught.value.message
    assert cause in ("markers", "touched", "ink") or error.worst == 4
    with pytest.raises(CheckFailed, match=r"0\.1 mm \(the contact radius\)"):
        refuse_large_error(error, 1e-4, curve, taken_from="contact radius")


@pytest.mark.parametrize("sets", [pytest.param(1, marks=pytest.mark.full)])
def test_no_wrong_reading_of_the_sample_passes_in_silence(sets):
    rows = table.reading_rows()
    assert sum(row.count(";") + 1 for row in rows) == 24
    assert not [row for row in rows if "SILENT" in row]
