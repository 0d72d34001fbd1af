"""Markers that are surely wrong make no fixture; good ones, however unlucky, always do."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from layouts import PX, grid, planar, solid

from vfplan.errors import MarkerError
from vfplan.registration import fit_registration
from vfplan.registration.diagnosis import diagnose, refuse_sure_faults

SAMPLES = ROOT / "samples"


def layout(rng, n):
    """Markers over a slice, in no order, not all on a line [px]."""
    while True:
        source = rng.uniform(0, [870, 780], (n, 2))
        extent = np.linalg.svd(source - source.mean(axis=0), compute_uv=False)
        if extent[1] > extent[0] / 10:
            return source


def noise(rng, n, kind):
    """Localisation errors of RMS about 0.3 mm an axis: equal, one axis worse, markers unlike."""
    error = rng.normal(0, 3e-4, (n, 3))
    if kind == "axis":
        return error * [0.5, 0.5, 1.5]
    if kind == "markers":
        return error * np.exp(rng.uniform(-np.log(2), np.log(2), (n, 1)))
    return error


def refused(source, target, model="affine", **kwargs):
    """The refusal's message, or None."""
    try:
        r = fit_registration(source, target, model=model, pixel_spacing=PX, **kwargs)
        refuse_sure_faults(r, diagnose(r))
    except MarkerError as error:
        return error.message
    return None


ON_A_LINE = np.array([[708.8, 487.9], [299.6, 774.3], [833.8, 431], [825.2, 460.5], [404.3, 569.1]])
TOUCHED = [  # the second 93 mm off; the others lie on a line to within 6 mm [m]
    [0.4271, -0.2976, -0.0011],
    [0.1828, -0.3712, 0.0012],
    [0.4981, -0.2575, 0.0001],
    [0.4966, -0.2747, 0.0016],
    [0.2440, -0.3432, 0.0004],
]


@pytest.mark.parametrize("model", ["affine", "similarity", "rigid"])
def test_a_bad_marker_that_leaves_next_to_no_layout_is_named_not_refused(model):
    r = fit_registration(ON_A_LINE, TOUCHED, model=model, pixel_spacing=0.6e-3)
    found = diagnose(r)
    refuse_sure_faults(r, found)
    assert list(found.suspects) == [1]
    assert r.tre95_curve_m(ON_A_LINE).max() > 0.02


@pytest.mark.parametrize("kind", ["equal", "axis", "markers"])
def test_good_markers_are_not_refused(kind):
    rng = np.random.default_rng(7)
    for k in range(300):
        n = int(rng.integers(4, 13))
        model = ("affine", "similarity", "rigid")[k % 3]
        source = layout(rng, n)
        target = planar(source, 0) + noise(rng, n, kind)
        assert refused(source, target, model) is None


@pytest.mark.parametrize("model", ["affine", "similarity", "rigid"])
@pytest.mark.parametrize("n", [6, 9, 12])
def test_exchanged_labels_are_refused_by_name(model, n):
    rng = np.random.default_rng(8)
    for _ in range(25):
        source = layout(rng, n)
        target = planar(source, 0) + noise(rng, n, "equal")
        i, j = rng.permutation(n)[:2]
        target[[i, j]] = target[[j, i]]
        message = refused(source, target, model)
        if np.linalg.norm(source[i] - source[j]) > 30:  # nearer, an exchange hardly matters
            assert message is not None
            assert "exchanged" in message or "explain" in message or "put them" in message


def test_exchanged_labels_stay_refused_unless_both_are_left_out():
    target = planar(grid())
    target[[1, 5]] = target[[5, 1]]
    assert "labels of 1 and 5 are exchanged" in refused(grid(), target)
    assert refused(grid(), target, robust=True) is None
    few = planar(grid(5))  # too few for a robust fit to leave out two
    few[[0, 4]] = few[[4, 0]]
    assert refused(grid(5), few, robust=True) is not None


@pytest.mark.parametrize("model", ["affine", "similarity", "rigid"])
@pytest.mark.parametrize("off_m", [0.002, 0.01])
def test_an_outlier_is_warned_of_and_not_refused(model, off_m):
    """Errors with heavy tails look the same, and they are common."""
    target = planar(grid())
    target[3] += [0, off_m, 0]
    assert refused(grid(), target, model) is None
    r = fit_registration(grid(), target, model=model, pixel_spacing=PX)
    assert r.outliers == (3,)
    assert any("suspect marker 3" in warning for warning in diagnose(r).warnings)


def test_three_labels_in_a_ring():
    target = planar(grid())
    target[[0, 4, 8]] = target[[4, 8, 0]]
    assert refused(grid(), target) is not None


@pytest.mark.parametrize("factor", [1e-3, 0.1, 0.4, 2.5, 25.4, 1e3])
def test_a_scale_that_is_another_unit_is_refused(factor):
    assert "times the known scale" in refused(grid(), planar(grid()) * factor)
    source, target = solid(6)
    r = fit_registration(source, target * factor, model="similarity")
    with pytest.raises(MarkerError, match="times the known scale"):
        refuse_sure_faults(r, diagnose(r))


@pytest.fixture
def plan(vfplan_cli, tmp_path):
    """Plan the sample with some edit of its marker files."""

    def run(robot=None, image=None, *options):
        paths = []
        for name, edit in (("image", image), ("robot", robot)):
            head, *lines = (SAMPLES / f"elbow_markers_{name}.csv").read_text().split()
            rows = [[row[0], *map(float, row[1:])] for row in (x.split(",") for x in lines)]
            rows = rows if edit is None else edit(rows)
            path = tmp_path / f"{name}.csv"
            path.write_text("\n".join([head, *(",".join(map(str, row)) for row in rows)]) + "\n")
            paths.append(path)
        out = tmp_path / "f.h5"
        return vfplan_cli("plan", SAMPLES / "elbow.png", *paths, "-o", out, *options), out

    return run


def exchange(rows):
    rows[1][0], rows[5][0] = rows[5][0], rows[1][0]
    return rows


def outlier(rows):
    rows[3][1] += 0.01
    return rows


WRONG = {
    "exchanged labels": (exchange, None, "labels of x2 and x6 are exchanged"),
    "millimetres": (lambda r: [[a, 1e3 * x, 1e3 * y, 1e3 * z] for a, x, y, z in r], None, "10 m"),
    "read as mm": (lambda r: [[a, x / 1e3, y / 1e3, z / 1e3] for a, x, y, z in r], None, "0.0005"),
    "rows for columns": (None, lambda r: [[a, v, u] for a, u, v in r], "row"),
    "off the slice": (None, lambda r: [*r[:-1], [r[-1][0], 871.0, 700.0]], "outside the slice"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_markers_make_no_fixture(plan, name):
    robot, image, message = WRONG[name]
    run, out = plan(robot, image)
    assert run.code == 3
    assert message in run.error_line
    assert "robot.csv" in run.error_line
    assert not out.exists()
    run, _ = plan(robot, image, "--json")
    assert run.json["error"]["kind"] == "MarkerError"


def test_robust_goes_on_without_them(plan):
    for edit, names in ((exchange, {"x2", "x6"}), (outlier, {"x4"})):
        run, out = plan(edit, None, "--robust", "--json")
        assert run.code == 0
        assert set(run.json["register"]["outliers"]) == names
        out.unlink()


def test_a_column_far_off_is_warned_of(plan):
    run, out = plan(lambda rows: [[a, x, y, 20.0 + z] for a, x, y, z in rows])
    assert run.code == 0
    assert "m from the origin along an axis" in run.stderr
    assert out.exists()
