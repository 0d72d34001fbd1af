"""What a plan chose from its tolerance: in the report, in the bundle, and kept by the surface."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ELBOW
from drawing import distance_to_line
from margins import MADE
from refusals import refuses

from vfplan.bundle.read import read_fixture
from vfplan.bundle.write import write_fixture
from vfplan.errors import SettingError
from vfplan.fixture import Fixture
from vfplan.planning.plan import plan, register
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.replaying.guiding import make_engine

R = 5e-3


def elbow(**settings):
    given = ExtractSettings(pixel_spacing_mm=(0.5, 0.5), **settings.pop("extraction", {}))
    return plan(*ELBOW, extraction=given, settings=FixtureSettings(points_only=True, **settings))


@pytest.fixture(scope="module")
def made():
    return elbow()


def test_report_budgets_the_tolerance(made):
    report = made.report["register"]
    chosen = report["chosen"]
    assert chosen["tolerance_m"] == 1e-5
    shares = chosen["error_m"]
    parts = [shares[name] for name in ("spacing", "band", "iterations")]
    assert shares["total"] == pytest.approx(sum(parts))
    assert shares["total"] <= 1e-5
    assert report["sampling_error_m"] == shares["spacing"]
    assert made.fixture.band == chosen["band_m"] >= shares["spacing"]
    assert made.fixture.max_iterations == chosen["max_iterations"]


def test_what_the_scene_does_without_is_counted(made):
    report = made.report["register"]
    points = max(0, made.report["extract"]["points"] - report["points"])
    assert report["left_out"] == {"points": points, "coordinates": 1}
    assert elbow(tolerance_m=1e-4).report["register"]["left_out"]["points"] > points
    assert "coordinates" not in elbow(ignore_axis="none").report["register"]["left_out"]


def test_a_tolerance_beyond_what_the_radius_allows_is_said_to_be_cut(made):
    cut = elbow(tolerance_m=5e-3)
    chosen = cut.report["register"]["chosen"]
    assert chosen["tolerance_m"] == 5e-3
    assert chosen["tolerance_used_m"] == pytest.approx(5 / 64 * R)
    assert chosen["error_m"]["total"] <= chosen["tolerance_used_m"]
    assert cut.fixture.provenance.settings["chosen_tolerance_m"] == chosen["tolerance_used_m"]
    (reduced,) = [finding for finding in cut.findings if finding.code == "tolerance-reduced"]
    assert "0.3906 mm" in reduced.text
    assert "tolerance-reduced" not in [finding.code for finding in made.findings]
    assert made.report["register"]["chosen"]["tolerance_used_m"] == 1e-5


def test_a_tolerance_finer_than_the_engine_is_refused():
    with refuses(SettingError, "tolerance-fine"):
        elbow(tolerance_m=9e-11)


def test_density_and_bare_clouds_choose_nothing(made):
    dense = elbow(density_per_m=2000.0)
    assert "chosen" not in dense.report["register"]
    assert dense.fixture.max_iterations is None
    mask = elbow(extraction={"method": "mask"})
    assert "chosen" not in mask.report["register"]
    assert mask.fixture.max_iterations is None


def test_a_curve_of_lines_and_arcs_needs_no_choice():
    made = plan(*ELBOW, extraction=ExtractSettings(pixel_spacing_mm=(0.5, 0.5)))
    report, settings = made.report["register"], made.fixture.provenance.settings
    assert "chosen" not in report
    assert not [name for name in settings if name.startswith("chosen_")]
    points = report["points"]
    assert report["left_out"] == {"points": points, "coordinates": 1, "settings": 3}
    assert made.fixture.band > 1e-6  # the points can still be rendered


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5, 1e-6])
def test_rendered_surface_keeps_the_tolerance(made, tmp_path, tolerance):
    """On a smooth curve the proxy is R from the finely drawn line, give or take the tolerance."""
    curve = made.extracted.fixture
    planned = register(curve, *ELBOW[1:], settings=FixtureSettings(tolerance_m=tolerance))
    fine = planned.registration.apply(curve.points)
    fine[:, 2] = 0
    engine = make_engine(planned.fixture, "robust")
    hips = pressed(planned.fixture.points)
    engine.reset(hips[0])
    proxy = engine.run(hips).proxy
    held = np.linalg.norm((proxy - hips)[:, :2], axis=1) > 1e-4
    assert held.mean() > 0.5
    away = distance_to_line(proxy[held] * [1, 1, 0], fine)
    assert np.abs(away - R).max() <= tolerance + 0.2e-6  # the polyline's own sagitta


def pressed(points):
    """A HIP that comes from the left and runs along the curve, 1 mm behind its surface."""
    picks = points[np.linspace(0, len(points) - 1, 4000).astype(int)].copy()
    step = np.gradient(points, axis=0)[np.linspace(0, len(points) - 1, 4000).astype(int)]
    normal = np.column_stack([-step[:, 1], step[:, 0], 0 * step[:, 0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    path = picks + 4e-3 * normal
    width = 41
    smooth = np.column_stack([np.convolve(path[:, k], np.ones(width) / width, "valid")
                              for k in range(3)])  # fmt: skip
    start = smooth[0] + 8e-3 * normal[0]
    return np.vstack([np.linspace(start, smooth[0], 80), smooth])


def test_points_that_are_there_twice_are_one_place(made):
    markers, cloud = ELBOW[1:], Fixture("image", np.arange(12.0).reshape(4, 3) * [9, 1, 0], MADE)
    once = register(cloud, *markers).report
    twice = register(replace(cloud, points=np.repeat(cloud.points, 2, 0)), *markers).report
    assert once["spacing_m"] == pytest.approx(twice["spacing_m"])
    assert once["spacing_m"] > 1e-3
    alone = register(replace(cloud, points=cloud.points[:1]), *markers).report
    assert (alone["points"], alone["spacing_m"]) == (1, None)


def test_a_coarse_vector_curve_is_one_curve_as_points_and_as_arcs(tmp_path):
    u = np.linspace(260, 600, 60)
    v = 400 + 40 * np.sin(u / 55)
    drawn = tmp_path / "drawn.csv"
    np.savetxt(drawn, np.c_[u, v], delimiter=",", header="u_px,v_px", comments="")
    made = plan(*ELBOW, curve=drawn)
    assert made.fixture.curve.pieces.error > 1e-6  # arcs leave the chords between the vertices
    path = tmp_path / "fixture.h5"
    write_fixture(made.fixture, path)  # refuses points that the pieces do not lead to
    assert np.array_equal(read_fixture(path).points, made.fixture.points)
