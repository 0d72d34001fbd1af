"""`vfplan surface`: from outlines to a fixture that a controller samples, and nobody's name."""

import bones
import numpy as np
import pytest
import slicer_files
from bones import BENT
from motion import turned
from refusals import refuses
from replays import at_1_khz, write_session
from vfplan.cli.register import registered_text

import vfplan
from vfplan.errors import CurveError, ImageError, InputError
from vfplan.surface.build import SurfaceSettings, surface

NAME, NUMBER, UID = "Zacharias^Quint", "PID-778899", "1.2.826.0.1.3680043.99.123456"
WHO = {"PatientName": NAME, "PatientID": NUMBER, "PatientBirthName": "Yldefons",
       "StudyInstanceUID": UID, "SeriesInstanceUID": UID, "FrameOfReferenceUID": UID,
       "StudyDate": "19871231"}  # fmt: skip
SECRETS = ("Zacharias", "Quint", NUMBER, "Yldefons", UID, "1.2.826.99.7", "19871231")
MARKS = np.array([[20, 0, -30], [-20, 5, -10], [10, 25, 20], [-12, -20, 36], [14, -22, 8.0]])


TURN, SHIFT = turned([0, 0, 1], 0.4), [0.5, 0.1, 0.3]


def moved(points):
    """Points [mm] of the patient as the robot touches them [m]."""
    return 1e-3 * points @ TURN.T + SHIFT


@pytest.fixture
def struct(tmp_path):
    return bones.write_rtstruct(tmp_path / "s.dcm", bones.outlines(BENT, 5), **WHO)


@pytest.fixture
def markers(tmp_path):
    """(Slicer's file, the robot's) of five markers around the bone."""
    labels = [f"m{k}" for k in range(len(MARKS))]
    return slicer_files.marker_files(tmp_path, labels, MARKS, moved(MARKS))


@pytest.fixture
def called(vfplan_cli, tmp_path):
    """Call a command in the test's folder; it ends with this code."""

    def call(*words, code=0, **more):
        return vfplan_cli(*words, cwd=tmp_path, **more).fails(code)

    return call


def test_outlines_become_a_registered_fixture_that_holds_a_proxy(struct, markers, called, tmp_path):
    report = called("surface", struct, "-o", "s.h5", "--picture-out", "s.png", "--json").json
    assert (report["slices"], report["spacing_mm"]) == (16, pytest.approx(5))
    assert report["structures"] == [{"number": 1, "name": "bone", "chosen": True}]
    assert report["open_edges"] == 0
    assert report["elapsed_s"] > 0
    assert report["contour_error_mm"]["rms"] < 0.05
    assert (tmp_path / "s.png").stat().st_size > 20_000
    planned = vfplan.read_fixture(tmp_path / "s.h5")
    assert planned.frame == "patient_lps"
    assert (len(planned.points), len(planned.mesh)) == (report["points"], report["triangles"])

    register = ("register", "s.h5", *markers, "--model", "rigid")
    called(*register, "-o", "f.h5", "--json")
    fixture = vfplan.read_fixture(tmp_path / "f.h5")
    assert fixture.frame == "robot_base"
    assert np.array_equal(fixture.mesh, planned.mesh)
    assert np.abs(fixture.points - moved(1e3 * planned.points)).max() < 1e-9
    called("validate", "f.h5")

    # A hand that pushes through the bone's flank: the proxy stays R outside the true surface.
    along = np.linspace(40, -5, 900)
    session = at_1_khz(moved(np.c_[np.full(900, 1.0), along, np.zeros(900)]))
    write_session(tmp_path / "h.csv", session)
    replayed = called("replay", "f.h5", "h.csv", "-o", "r.h5", "--json").json
    assert replayed["contact_ticks"] > 300
    assert replayed["entrenched_ticks"] == 0
    back = 1e3 * (vfplan.replay(fixture, session).trace.proxy - SHIFT) @ TURN
    assert 4.8 < BENT.distance(back)[500:].min() < 5.2

    # Touched by a ball of 1 mm, 0.8 mm further along x than the markers say: the bone is there.
    rng = np.random.default_rng(8)
    mesh = planned.points[planned.mesh].astype(float)
    normal = np.cross(mesh[:, 1] - mesh[:, 0], mesh[:, 2] - mesh[:, 0])
    rows = rng.choice(len(mesh), 300)
    normal = normal[rows] / np.linalg.norm(normal[rows], axis=1)[:, None]
    centres = 1e3 * (mesh[rows].mean(axis=1) + 1e-3 * normal) + [0.8, 0, 0]
    rows = [f"{x!r},{y!r},{z!r}" for x, y, z in moved(centres).tolist()]
    (tmp_path / "t.csv").write_text("\n".join(["x_m,y_m,z_m", *rows]))
    touched = (*register, "--touched", "t.csv")
    run = called(*touched, "--tip-radius", "1", "-o", "t.h5", "--json")
    assert run.json["touched"]["moved_max_m"] == pytest.approx(8e-4, rel=0.02)
    assert run.json["touched"]["rms_m"] < 5e-5
    assert "Did a marker move, or is something else touched?" in run.stderr
    assert "pixel" not in registered_text(run.json)
    refined = vfplan.read_fixture(tmp_path / "t.h5")
    assert np.abs(refined.points - moved(1e3 * planned.points + [0.8, 0, 0])).max() < 5e-5
    worst = run.json["tre"]
    assert refined.points[worst["worst_point"]] == pytest.approx(worst["worst_target_m"], abs=1e-9)
    (tmp_path / "t.csv").write_text("a,b\n1,2\n")
    assert (
        "column 'x_m' is missing from the header 'a,b'"
        in called(*touched, "-o", "u.h5", code=3).error_line
    )
    assert not (tmp_path / "u.h5").exists()


def test_the_same_outlines_give_the_same_bits(struct, called, tmp_path):
    for name in ("a.h5", "b.h5"):
        epoch = {"SOURCE_DATE_EPOCH": "1700000000"}
        called("surface", struct, "-o", name, "--tolerance", "2", env=epoch)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_no_output_names_the_patient(struct, vfplan_cli, tmp_path):
    grid = bones.grid_round(5, pixel=1.0)
    named = f"bone of {NAME.replace('^', ' ')}"
    bones.write_seg(tmp_path / "g.dcm", grid.labels(BENT), grid, name=named, **WHO)
    bones.write_rtstruct(tmp_path / "two.dcm", bones.outlines(BENT, 5), names=[named, "b"], **WHO)
    (tmp_path / "cut.dcm").write_bytes(struct.read_bytes()[:3000])
    bad = bytearray(struct.read_bytes())
    at = bad.rindex(UID.encode())
    bad[at - 6 : at] = b"\xff" * 6
    (tmp_path / "bad.dcm").write_bytes(bad)
    told = ""
    for name in ("g.dcm", "two.dcm", "cut.dcm", "bad.dcm"):
        run = vfplan_cli("surface", name, "-o", f"{name}.h5", "--picture-out", f"{name}.png",
                         "--tolerance", "3", "--json", "-vv", cwd=tmp_path)  # fmt: skip
        told += run.stdout + run.stderr
    written = b"".join(p.read_bytes() for p in tmp_path.iterdir() if p.suffix in (".h5", ".png"))
    assert len(written) > 20_000
    for secret in SECRETS:
        assert secret not in told, secret
        assert secret.encode() not in written, secret


def test_pydicoms_own_samples_are_read_or_refused_by_name(called, tmp_path):
    """An RTSTRUCT without preamble is plainly DICOM; its structures hold 1 to 4 points each."""
    from pydicom.data import get_testdata_file

    called("surface", get_testdata_file("rtstruct.dcm"), "-o", "s.h5", code=3)
    with refuses(InputError, "structure-several", structures=3):
        surface(get_testdata_file("rtstruct.dcm"))
    with refuses(CurveError, "slices-too-few", slices=1):
        surface(get_testdata_file("liver_1frame.dcm"))
    with refuses(InputError, "source-unknown"):
        surface(get_testdata_file("CT_small.dcm"))
    assert not (tmp_path / "s.h5").exists()


def test_drawn_dicom_slices_become_a_surface(tmp_path):
    """A red outline on each slice, found by its pen: sub-pixel, where each slice lies."""
    from captures import capture
    from drawing import blend, coverage, flat, to_uint8

    folder = tmp_path / "series"
    folder.mkdir()
    pixel, shape = 0.4, (120, 160)

    def draw(k, z, ink):
        picture = to_uint8(blend(flat(shape, 180), ink, (230, 20, 40)))
        made = capture(
            tmp_path, picture, PixelSpacing=[pixel, pixel],
            ImageOrientationPatient=[1, 0, 0, 0, 1, 0], ImagePositionPatient=[-24, -24, float(z)],
        )  # fmt: skip
        made.rename(folder / f"{UID}.{9 - k}.dcm")
        return picture

    for k, z in enumerate(BENT.places(5)[4:12]):
        line = (BENT.rings(z)[0] + [24, 24]) / pixel
        ink = coverage(shape, line, 3, closed=True)
        picture = draw(k, z, ink)
    made = surface(folder, settings=SurfaceSettings(tolerance_m=3e-4))
    points = 1e3 * made.fixture.points
    inside = (points[:, 2] > -18) & (points[:, 2] < 17)
    away = BENT.distance(points[inside])
    assert np.sqrt((away**2).mean()) < 0.05
    assert np.abs(away).max() < 0.15
    # What is asked about one slice is asked about the surface.
    u, v = np.rint(line[0]).astype(int)
    draw(k, z, np.where(np.hypot(*(np.indices(shape)[::-1] - [[[u]], [[v]]])) < 6, 0, ink))
    assert any("file 1 of 8 by name: " in f.text for f in surface(folder).fixture.findings)
    capture(tmp_path, flat(shape, 90).astype(np.uint8)).rename(folder / f"{UID}.99.dcm")
    assert any("1 of 9 slices show no drawing" in f.text for f in surface(folder).fixture.findings)
    capture(tmp_path, picture).rename(folder / f"{UID}.98.dcm")
    with refuses(ImageError, "slice-without-place") as caught:
        surface(folder)
    assert caught.value.where.endswith("file 9 of 10 by name")
    assert UID not in str(caught.value)


def test_what_is_no_source_is_refused(called, tmp_path):
    (tmp_path / "a.txt").write_text("hello")
    called("surface", "a.txt", "-o", "s.h5", code=3)
    wide = called("surface", "a.txt", "-o", "s.h5", "--tolerance", "6", "--json", code=2)
    assert wide.json["error"]["numbers"]["tolerance_max_mm"] == 5
