"""`vfplan import` and `export`: other people's files in and out."""

import json

import bundles
import numpy as np
import pytest

import vfplan
from vfplan.bundle.exporting import export
from vfplan.bundle.importing import import_cloud
from vfplan.bundle.leak import largest_cover
from vfplan.bundle.read import read_bundle
from vfplan.engine.proxy import sampled
from vfplan.errors import InputError, SettingError
from vfplan.geometry.lines import row_lengths

TETRAHEDRON = np.array([[0, 0, 0], [30, 0, 0], [0, 30, 0], [0, 0, 30]], dtype=float)
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
XYZ = b"property float x\nproperty float y\nproperty float z\n"
PLY = b"ply\nformat %b 1.0\nelement vertex %d\n" + XYZ


@pytest.fixture
def stl(tmp_path):
    """A tetrahedron of 30 mm edges, as ASCII STL in mm."""
    lines = ["solid t"]
    for face in TETRAHEDRON[np.array(FACES)]:
        corners = ["vertex {:.9g} {:.9g} {:.9g}".format(*corner) for corner in face]
        lines += ["facet normal 0 0 0", "outer loop", *corners, "endloop", "endfacet"]
    path = tmp_path / "t.stl"
    path.write_text("\n".join([*lines, "endsolid t"]))
    return path


@pytest.mark.parametrize("options, spacing", [((), 5e-4), (("--spacing", "2"), 2e-3)])
def test_a_mesh_is_kept_as_drawn_certified_and_in_metres(options, spacing, stl, vfplan_cli,
                                                         tmp_path):  # fmt: skip
    run = vfplan_cli("import", stl, "--units", "mm", *options, "-o", tmp_path / "a.h5",
                     "--json").sound  # fmt: skip
    assert run.json["leak"]["/leak@certified"] == 1
    assert run.json["leak"]["/leak@largest_m"] == pytest.approx(spacing / np.sqrt(3))
    assert run.json["extent_m"] == [[0, 0, 0], [0.03, 0.03, 0.03]]
    assert (run.json["points"], run.json["triangles"]) == (4, 4)
    fixture = vfplan.read_fixture(tmp_path / "a.h5")
    assert np.array_equal(fixture.points[fixture.mesh], TETRAHEDRON[np.array(FACES)] / 1000)
    assert fixture.sample_radius == pytest.approx(spacing / np.sqrt(3))
    assert fixture.band == max(1e-5, 5e-3 - np.sqrt(25e-6 - spacing**2 / 3))
    # What rules "robust" and "paper" render has a certificate of its own.
    made = sampled(fixture)
    leak = read_bundle(bundles.stored(tmp_path / "samples.h5", made))[0]
    assert leak["/leak@certified"] == 1
    assert leak["/leak@largest_m"] == largest_cover(made.mesh, made.points)
    assert leak["/leak@largest_m"] <= spacing / np.sqrt(3) * (1 + 1e-9)


def test_a_drawn_mesh_that_says_nothing_of_samples_leaks(stl, vfplan_cli, tmp_path):
    assert vfplan_cli("import", stl, "--units", "mm", "-o", tmp_path / "a.h5").sound
    fixture = vfplan.read_fixture(tmp_path / "a.h5")
    with pytest.raises(vfplan.errors.SceneError, match="leaks"):
        vfplan.write_fixture(bundles.replace(fixture, sample_radius=None), tmp_path / "b.h5")


def test_a_facet_that_is_there_twice_is_told(stl, tmp_path):
    facets = stl.read_text().split("outer loop")
    stl.write_text("outer loop".join([*facets[:2], facets[1], *facets[2:]]))
    (told,) = import_cloud(stl, units="mm").findings
    assert told.code == "edges-shared"
    assert told.text.startswith("3 edges belong to three triangles or more")
    assert np.isin(told.place_m, (0, 0.03)).all()


@pytest.mark.parametrize(
    "wrong",
    [{"curve": "shut"}, {"spacing": np.nan}, {"contact_radius": np.nan}, {"point_radius": -1e-3}],
)
def test_settings_that_mean_nothing_are_refused(wrong, stl):
    with pytest.raises(SettingError, match="Give "):
        import_cloud(stl, units="mm", **wrong)


def test_what_a_mesh_leaves_unused_and_what_takes_long_ticks_is_said(vfplan_cli, tmp_path):
    points = b"0 0 0\n9 9 9\n0.01 0 0\n0 0.01 0\n7 7 7\n"
    faces = b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_bytes(PLY % (b"ascii", 5) + faces + points + b"3 0 2 3\n")
    run = vfplan_cli("import", tmp_path / "a.ply", "--units", "m", "-q", "-o", tmp_path / "a.h5")
    assert "left out: 2 points of no triangle" in run.stderr
    assert "us are given" not in run.stderr
    np.save(tmp_path / "c.npy", np.random.default_rng(1).uniform(0, 1, (400_000, 3)))
    run = vfplan_cli("import", tmp_path / "c.npy", "--units", "cm", "-q", "-o", tmp_path / "c.h5")
    assert "a tick may take" in run.stderr


def test_a_bare_cloud_gets_the_band_that_its_spacing_needs(vfplan_cli, tmp_path):
    """A ball of radius 30 mm in points about 1.1 mm apart: dimples deeper than the paper's band.

    Within 10 um the proxy would stick in them, 1.2 mm behind the exact one, which is R outside the
    ball on the line from its centre through the HIP.
    """
    k = np.arange(10_000) + 0.5
    height, turn = 1 - k / 5000, np.pi * (1 + 5**0.5) * k
    ball = np.column_stack([np.sqrt(1 - height**2) * f(turn) for f in (np.cos, np.sin)] + [height])
    np.save(tmp_path / "ball.npy", 0.03 * ball)
    run = vfplan_cli("import", "ball.npy", "--units", "m", "-o", "b.h5", "--json", cwd=tmp_path)
    fixture = vfplan.read_fixture(tmp_path / "b.h5")
    assert run.json["band_m"] == fixture.band
    assert 3e-5 < fixture.band < 1e-4
    t = np.arange(0, 2, 1e-3)
    along = np.column_stack([np.sin(0.4 + t), 0.3 * np.sin(3 * t), np.cos(0.4 + t)])
    along /= row_lengths(along)[:, None]
    deep = np.interp(t, [0, 0.3, 2], [0.036, 0.0305, 0.0305])[:, None]
    found = vfplan.replay(fixture, vfplan.Session(t, deep * along)).trace
    exact = along * np.maximum(deep, 0.035)
    assert row_lengths(found.proxy - exact).max() < fixture.band
    assert row_lengths(found.force - 1000 * (exact - found.hip)).max() < 0.05


@pytest.mark.parametrize("suffix", [".csv", ".ply"])
def test_points_come_back(suffix, vfplan_cli, tmp_path):
    points = bundles.minimal().points
    path = tmp_path / f"c{suffix}"
    export(bundles.minimal(), path)
    run = vfplan_cli("import", path, "--units", "m", "-o", tmp_path / "a.h5", "--json").sound
    assert run.json["leak"]["/leak@kind"] == "cloud"
    assert vfplan.read_fixture(tmp_path / "a.h5").points.tobytes() == points.tobytes()


def test_a_curve_with_a_gap_wider_than_the_proxy_is_not_written(vfplan_cli, tmp_path):
    (tmp_path / "c.csv").write_text("x,y,z\n0,0,0\n5,0,0\n16,0,0\n")
    words = ["--units", "mm", "--curve", "open", "-o", tmp_path / "a.h5"]
    vfplan_cli("import", tmp_path / "c.csv", *words).fails(3, "0.011 m")
    assert not (tmp_path / "a.h5").exists()


UNREADABLE = {
    "a.csv": b"x,y\n1,2\n", "nan.csv": b"x,y,z\n1,2,nan\n", "none.csv": b"x,y,z\n",
    "text.csv": b"x,y,z\n1,2,three\n", "a.npy": b"no array", "a.ply": b"no mesh", "a.stl": b"",
    "a.off": b"v 0 0 0\n", "m.csv": b"x_m,y_m,z_m\n1,2,3\n",
}  # fmt: skip


@pytest.mark.parametrize("name", UNREADABLE)
def test_what_cannot_be_read_is_code_3_in_one_line(name, vfplan_cli, tmp_path):
    (tmp_path / name).write_bytes(UNREADABLE[name])
    out = tmp_path / "out.h5"
    vfplan_cli("import", tmp_path / name, "--units", "mm", "-o", out).fails(3, "error: ")
    assert not out.exists()


@pytest.mark.parametrize(
    "points, says",
    [(np.zeros((0, 3)), "0 points"), (np.array([[1, 2, 3], [4, np.nan, 6.0]]), "point 1")],
)
def test_points_are_refused_by_their_row_not_by_numbers_in_metres(points, says, tmp_path):
    np.save(tmp_path / "a.npy", points)
    with pytest.raises(InputError, match=says) as raised:
        import_cloud(tmp_path / "a.npy", units="mm")
    assert raised.value.where.endswith("a.npy")


def test_strokes_become_slicer_curves_in_mm(vfplan_cli, tmp_path):
    vfplan.write_fixture(bundles.whole(), tmp_path / "a.h5")
    assert vfplan_cli("export", tmp_path / "a.h5", "-o", tmp_path / "c.mrk.json").sound
    markups = json.loads((tmp_path / "c.mrk.json").read_text())["markups"]
    assert [m["type"] for m in markups] == ["Curve", "ClosedCurve"]
    positions = [p["position"] for m in markups for p in m["controlPoints"]]
    assert np.allclose(np.array(positions) / 1000, bundles.whole().points, atol=1e-15)


def test_the_femur_is_certified(shared_data, tmp_path):
    fixture = import_cloud(next((shared_data / "clouds").glob("*.stl")), units="mm", spacing=4e-3)
    vfplan.write_fixture(fixture, tmp_path / "a.h5")
    assert 0.3 < np.ptp(fixture.points, axis=0).max() < 0.5


def test_pixels_are_no_metres(vfplan_cli, tmp_path):
    """An exported curve of the image frame says its unit."""
    vfplan.write_fixture(bundles.pixels(), tmp_path / "p.h5")
    assert vfplan_cli("export", tmp_path / "p.h5", "-o", tmp_path / "p.csv").sound
    words = ("import", tmp_path / "p.csv", "--units", "mm", "-o", tmp_path / "a.h5")
    vfplan_cli(*words).fails(3, "x_px")
    assert not (tmp_path / "a.h5").exists()


@pytest.mark.parametrize(
    "rows, says",
    [("0,0,0\n", "a single point"), ("0,0,0\n3,0,0\n", "no point further than 3.000 mm from the")],
)
def test_of_a_bare_cloud_no_opening_is_told(rows, says, vfplan_cli, tmp_path):
    (tmp_path / "a.csv").write_text("x_mm,y_mm,z_mm\n" + rows)
    run = vfplan_cli("import", tmp_path / "a.csv", "--units", "mm", "-o", tmp_path / "a.h5")
    assert (run.code, "opening" in run.stdout) == (0, False)
    assert says in run.stdout


@pytest.mark.parametrize("contact_radius_mm, is_coarse", [(1.5, True), (8, False)])
def test_facets_that_are_felt_are_a_finding(contact_radius_mm, is_coarse, vfplan_cli, tmp_path):
    """Facets of 3.3 to 3.7 mm leave a ball of 6 mm by up to 0.38 mm: R / 20 is 0.075 or 0.4 mm."""
    pytest.importorskip("trimesh").creation.icosphere(1, radius=6.0).export(tmp_path / "ball.stl")
    run = vfplan_cli("import", tmp_path / "ball.stl", "--units", "mm", "--contact-radius",
                     contact_radius_mm, "-o", tmp_path / "ball.h5", "--json").sound  # fmt: skip
    assert run.json["rule"] == "exact"
    codes = [finding["code"] for finding in run.json["findings"]]
    assert codes == (["mesh-coarse"] if is_coarse else [])


def test_a_band_above_a_hundredth_of_R_is_a_finding(vfplan_cli, tmp_path):
    """Points 2 mm apart on a sheet, rough by 0.3 mm: the proxy sinks between them."""
    draw = np.random.default_rng(2)
    sheet = np.stack(np.meshgrid(np.arange(0, 60, 2.0), np.arange(0, 60, 2.0)), axis=-1)
    sheet = np.concatenate([sheet, 0.3 * draw.normal(size=(30, 30, 1))], axis=-1).reshape(-1, 3)
    for spread, codes in ((1.0, ["band-wide"]), (0.1, [])):
        np.save(tmp_path / f"{spread}.npy", spread * sheet)
        run = vfplan_cli("import", tmp_path / f"{spread}.npy", "--units", "mm", "-o",
                         tmp_path / f"{spread}.h5", "--json")  # fmt: skip
        assert [finding["code"] for finding in run.json["findings"]] == codes
