"""Labels in another order are named and refused, whatever the layout; good ones are left alone."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from layouts import MODELS, PX, planar, solid

from vfplan.errors import MarkerError
from vfplan.registration import fit_registration
from vfplan.registration.diagnosis import diagnose, refuse_sure_faults
from vfplan.registration.labelling import better_labelling, name_labelling

N = 9
GRID = np.array([[100.0 + 300 * i, 80 + 300 * j] for j in range(3) for i in range(3)])
REVERSED = tuple(range(N))[::-1]
TRANSPOSED = (0, 3, 6, 1, 4, 7, 2, 5, 8)
SHIFTED = (*range(1, N), 0)
MIXED = (4, 0, 7, 1, 8, 2, 6, 5, 3)
ORDERS_OF_FOUR = [(3, 2, 1, 0), (1, 2, 3, 0), (0, 2, 1, 3), (2, 1, 0, 3), (1, 0, 3, 2)]


def by_hand(rng, jitter_px):
    """A 3 x 3 grid as a hand sets it."""
    return GRID + rng.uniform(-jitter_px, jitter_px, GRID.shape)


def said(source, target, model="affine", labels=None, **kwargs):
    """What refuses the markers, or None."""
    try:
        r = fit_registration(source, target, model=model, labels=labels, **kwargs)
        refuse_sure_faults(r, diagnose(r))
    except MarkerError as error:
        return error.message
    return None


@pytest.mark.parametrize("order", [REVERSED, TRANSPOSED], ids=["reversed", "transposed"])
@pytest.mark.parametrize("robust", [False, True], ids=["all", "robust"])
def test_grids_that_a_hand_set(order, robust):
    rng = np.random.default_rng(21)
    silent = 0
    for k in range(24):
        source = by_hand(rng, np.geomspace(5, 80, 24)[k])
        target = planar(source, seed=k)[list(order)]
        model = MODELS[k % 3]
        message = said(source, target, model, robust=robust, pixel_spacing=PX)
        if message is None:
            r = fit_registration(source, target, model=model, robust=robust, pixel_spacing=PX)
            silent += diagnose(r).relabelled is None
        else:
            assert "in reverse order" in message or "transposed" in message
    assert silent == 0


@pytest.mark.parametrize(
    ("order", "name"),
    [
        (REVERSED, "in reverse order (a is labelled i, b is labelled h, c is labelled g, ...)"),
        (TRANSPOSED, "transposed, rows for columns of 3 x 3 (b is labelled d, c is labelled g, "),
        (SHIFTED, "shifted by 1 (a is labelled i, b is labelled a, c is labelled b, ...)"),
        (MIXED, "in another order (a is labelled b, b is labelled d, c is labelled f, ...)"),
    ],
)
def test_the_order_is_named(order, name):
    source = by_hand(np.random.default_rng(1), 40)
    message = said(source, planar(source)[list(order)], labels=list("abcdefghi"))
    assert f"the labels are {name}" in message
    if order == REVERSED:  # the others leave more than a third of the layout
        assert "so by 0." in message  # what is left with the right labels [mm]


@pytest.mark.parametrize("n", [5, 7, 12, 20, 40])
def test_any_layout_and_any_number(n):
    rng = np.random.default_rng(n)
    for _ in range(4):
        source = rng.uniform(0, [870, 780], (n, 2))
        for order in (np.arange(n)[::-1], np.roll(np.arange(n), int(rng.integers(1, n)))):
            assert said(source, planar(source)[order]) is not None


@pytest.mark.parametrize("model", MODELS)
def test_markers_in_space(model):
    source, target = solid(8)
    assert said(source, target, model) is None
    for order in (np.arange(8)[::-1], np.roll(np.arange(8), 3)):
        assert said(source, target[order], model) is not None


def test_one_bad_marker_does_not_hide_the_order():
    source = by_hand(np.random.default_rng(3), 15)
    for bad in range(N):
        target = planar(source)
        target[bad] += [0.006, -0.004, 0.003]
        assert "in reverse order" in said(source, target[list(REVERSED)])
        assert said(source, target) is None


def test_a_mistyped_marker_is_the_only_doubt():
    """x5 of the sample with two digits exchanged: 27 mm off, and no word of other labels."""
    rows = [
        np.loadtxt(ROOT / f"samples/elbow_markers_{name}.csv", delimiter=",", skiprows=1, dtype=str)
        for name in ("image", "robot")
    ]
    source, target = (table[:, 1:].astype(float) for table in rows)
    assert target[4, 0] == 0.574602
    target[4, 0] = 0.547602
    for spacing in (None, 0.5e-3):
        r = fit_registration(source, target, labels=rows[0][:, 0].tolist(), pixel_spacing=spacing)
        found = diagnose(r)
        assert found.relabelled is None
        (warning,) = found.warnings
        assert warning.startswith("suspect marker x5: it is 26.9 mm from where the others put it")
        assert "without it they fit to 0.2" in warning


def test_a_grid_to_the_pixel_has_no_better_labelling():
    fit = fit_registration(GRID, planar(GRID)).fit
    assert not better_labelling(fit).seems


def test_stated_sigmas_that_the_residuals_exceed_ten_times_are_refused():
    source = by_hand(np.random.default_rng(4), 60)
    target = planar(source)
    assert said(source, target, sigma=np.full(N, 1e-4)) is None
    assert "what the stated sigmas allow" in said(source, target, sigma=np.full(N, 2e-5))


def test_an_exchange_is_called_one():
    assert name_labelling((2, 1, 0), "abc") == "the labels of a and c are exchanged"


@pytest.mark.full
def test_good_markers_of_any_layout_are_not_refused():
    rng = np.random.default_rng(5)
    for k in range(3000):
        n = int(rng.integers(4, 13))
        source = rng.uniform(0, [870, 780], (n, 2)) if k % 2 else by_hand(rng, rng.choice([1, 9]))
        error = rng.standard_t(3, (len(source), 3)) * 10 ** rng.uniform(-4, -3)
        target = planar(source, 0) + error
        assert said(source, target, MODELS[k % 3], pixel_spacing=PX) is None


@pytest.mark.parametrize("spacing", [PX, None])
def test_four_markers_say_so_where_they_cannot_show_their_labels(spacing):
    """No other order is far off without a word, and with a pixel spacing most are refused."""
    rng = np.random.default_rng(8)
    refused = 0
    for k in range(48):
        source = rng.uniform(0, [870, 780], (4, 2))
        target = planar(source, 5e-4, seed=k)
        order = list(ORDERS_OF_FOUR[k % len(ORDERS_OF_FOUR)])
        if said(source, target[order], pixel_spacing=spacing) is not None:
            refused += 1
            continue
        r = fit_registration(source, target[order], pixel_spacing=spacing)
        warnings = " ".join(diagnose(r).warnings)
        assert any(words in warnings for words in ("cannot show how", "it seems", "symmetric"))
    assert refused >= (40 if spacing else 20)


def test_what_the_pixel_spacing_rules_out_is_no_rival():
    """An affine map takes a kite's labels in other orders too; a similarity does not."""
    source = np.array([[100.0, 400], [420, 740], [760, 420], [400, 60]])
    target = planar(source, 1e-3, seed=2)
    without = diagnose(fit_registration(source, target))
    assert "cannot show how they are labelled" in " ".join(without.warnings)
    assert not any("label" in w for w in diagnose(
        fit_registration(source, target, pixel_spacing=PX)).warnings)  # fmt: skip
