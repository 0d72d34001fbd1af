"""The pipeline against known truth: the shipped sample, and real slices where they are there."""

from __future__ import annotations

import hashlib
import json
import sys

import numpy as np
import pytest
from conftest import ELBOW, ROOT
from drawing import distance_to_line
from refusals import refuses

import vfplan
from vfplan.errors import CurveError, SettingError
from vfplan.geometry.lines import step_lengths
from vfplan.planning.extraction import extract
from vfplan.planning.plan import ignored_axis, plan, render
from vfplan.planning.settings import ExtractSettings, FixtureSettings

SAMPLES = ROOT / "samples"
SPACING = ExtractSettings(pixel_spacing_mm=(0.5, 0.5))


def elbow(**kwargs):
    return plan(*ELBOW, **{"extraction": SPACING, **kwargs})


def test_sample_fixture_lies_on_the_true_curve_within_the_registration_error():
    made = elbow()
    truth = json.loads((SAMPLES / "elbow_truth.json").read_text())
    curve = np.array(truth["curve_px"])
    line = np.c_[curve, np.ones(len(curve))] @ np.array(truth["T_robot_image"]).T
    off = distance_to_line(made.fixture.points, line)
    tre_rms_m = made.fixture.registration.tre_rms_m
    assert off[1:-1].max() < 2 * tre_rms_m
    # Along the line an end is known to a pixel, which is 0.5 mm.
    assert off.max() < 2 * tre_rms_m + 0.5e-3
    assert made.report["extract"]["strokes"][0]["length_mm"] == pytest.approx(
        truth["length_px"] * truth["pixel_spacing_mm"], rel=0.01
    )


def test_sample_reproduces_the_papers_cloud():
    made = elbow(extraction=ExtractSettings(method="mask", pixel_spacing_mm=(0.5, 0.5)))
    assert len(made.fixture.points) == made.report["extract"]["mask_pixels"]
    assert len(made.fixture.points) == 2204
    assert made.report["extract"]["density_per_mm"] == pytest.approx(5.3, rel=0.01)
    assert made.fixture.curve is None


@pytest.mark.slow
def test_another_linear_algebra_kernel_gives_the_same_fixture(vfplan_cli, tmp_path):
    curve = tmp_path / "curve.h5"
    assert vfplan_cli("extract", SAMPLES / "elbow.png", "-o", curve).sound
    ids, bounds = set(), []
    # OpenBLAS takes the kernel from here; where another library is used, all runs are alike.
    for kernel in ("Prescott", "Haswell"):
        out = tmp_path / f"{kernel}.h5"
        run = vfplan_cli(*("register", curve, *ELBOW[1:], "-o", out, "--margin", "tre95", "--json"),
                         env={"OPENBLAS_CORETYPE": kernel})  # fmt: skip
        ids.add(vfplan_cli("info", out, "--json").json["/@id"])
        bounds.append(run.json["tre"]["curve95_max_m"])
    assert len(ids) == 1
    assert bounds[1] == pytest.approx(bounds[0], rel=1e-10)


def test_a_time_that_is_none_is_refused_in_one_line(vfplan_cli, tmp_path):
    words = ("plan", *ELBOW, "-o", tmp_path / "f.h5")
    for time in ("abc", "", "-1", "1e9"):
        run = vfplan_cli(*words, env={"SOURCE_DATE_EPOCH": time})
        run.fails(3, f"SOURCE_DATE_EPOCH is {time!r}")
        assert not (tmp_path / "f.h5").exists()


def test_provenance_names_inputs_by_hash_and_nothing_by_path():
    provenance = elbow().fixture.provenance
    assert set(provenance.inputs) == {"image", "markers", "markers2"}
    assert all(len(value) == 64 for value in provenance.inputs.values())
    assert "elbow" not in repr(provenance)
    assert {"colour", "model", "tolerance_m"} <= set(provenance.settings)


def test_provenance_has_the_hash_of_the_bytes_that_were_fitted(monkeypatch, tmp_path):
    markers, drawn = tmp_path / "m.csv", extract(SAMPLES / "elbow.png").fixture
    markers.write_bytes((SAMPLES / "elbow_markers_image.csv").read_bytes())
    fitted = hashlib.sha256(markers.read_bytes()).hexdigest()

    def replaced(*given):
        markers.write_text("another file's")
        return render(*given)

    monkeypatch.setattr(sys.modules["vfplan.planning.plan"], "render", replaced)
    made = vfplan.register(drawn, markers, SAMPLES / "elbow_markers_robot.csv")
    assert made.fixture.provenance.inputs["markers"] == fitted


def test_the_spacing_is_that_of_neighbours():
    sparse = ExtractSettings(pixel_spacing_mm=(0.5, 0.5), density_per_mm=0.05)
    made = elbow(extraction=sparse, settings=FixtureSettings(density_per_m=20.0, points_only=True))
    apart = step_lengths(made.fixture.points).mean()
    assert made.report["register"]["spacing_m"] == pytest.approx(apart, rel=1e-6)
    drawn = step_lengths(made.extracted.fixture.points[:, :2] * 0.5)
    assert made.report["extract"]["spacing_mm"] == pytest.approx(drawn.mean(), rel=1e-6)


def registration_of_a_plane(normal):
    """A planar registration whose plane has the given normal."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    a = np.cross(normal, [0.3, 0.5, 0.8])
    a /= np.linalg.norm(a)
    b = np.cross(normal, a)
    source = np.array([[0, 0], [100, 0], [0, 100], [100, 100], [40, 70]], float)
    return vfplan.fit_registration(source, 1e-3 * (source[:, :1] * a + source[:, 1:] * b))


def test_a_slice_is_extruded_along_its_normal_unless_another_axis_is_given():
    registration = registration_of_a_plane([0, 0.9, 1])
    expected = np.array([0, 0.9, 1]) / np.linalg.norm([0, 0.9, 1])
    assert abs(ignored_axis(None, registration) @ expected) == pytest.approx(1)
    assert ignored_axis("z", registration).tolist() == [0, 0, 1]
    with pytest.raises(SettingError, match=r"47\.7 degrees"):
        ignored_axis("z", registration_of_a_plane([0, 1.1, 1]))


def test_a_registered_fixture_is_not_registered_twice():
    fixture = elbow().fixture
    with pytest.raises(CurveError, match="robot_base"):
        vfplan.register(fixture, SAMPLES / "elbow_markers_image.csv")


@pytest.mark.parametrize("given, code", [
    ({"stiffness": (1.0, 2.0)}, "stiffness-count"),
    ({"guide_m": 1e-3, "guide_pull": (1.0, 0.02, 5.0)}, "guide-pull"),
    ({"guide_m": 1e-3, "guide_pull": (2.0, 0.0)}, "guide-pull"),
    ({"guide_m": 1e-3, "margin": 1e-3}, "guide-margin"),
    ({"guide_ends": "stop"}, "no-guide"),
])  # fmt: skip
def test_settings_that_say_nothing_are_refused(given, code):
    with refuses(SettingError, code):
        FixtureSettings(**given)


def test_settings_hold_in_python_as_on_the_command_line(tmp_path):
    assert FixtureSettings(stiffness=500.0) == FixtureSettings(stiffness=(500.0,))
    with pytest.raises(SettingError, match=r"stiffness is -1 N/m"):
        FixtureSettings(stiffness=-1)
    for density in (0.0, -1.0, np.nan, np.inf):
        with refuses(SettingError, "density-range"):
            ExtractSettings(density_per_mm=density)
    (tmp_path / "line.csv").write_text("u_px,v_px\n5,5\n50,5\n")
    assert len(extract(tmp_path / "line.csv", ExtractSettings(exclude=())).fixture.points) == 46
