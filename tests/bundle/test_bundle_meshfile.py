"""PLY, STL and OBJ in every form they come in: the same surface, or a clear refusal."""

from __future__ import annotations

import hashlib
import io
import struct
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from conftest import file_with
from meshes import sphere
from refusals import refuses
from scipy.spatial.transform import Rotation

import vfplan
from vfplan.bundle.exporting import export
from vfplan.bundle.importing import STL_FACET, drawn, import_cloud, read_mesh
from vfplan.errors import InputError, SceneError, SessionError, SettingError
from vfplan.fixture import RegistrationRecord
from vfplan.session.read import read_session

POINTS = np.array([[0, 0, 0], [0.1, 0, 0], [0, 1 / 3, 0], [0, 0, -2.5e-3]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32)
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def ply(form="ascii", number="double", index="int", length="uchar", line="\n", more=()):
    """The tetrahedron as PLY; `more` properties of each vertex are 7s."""
    head = ["ply", f"format {form} 1.0", "comment made for a test", "obj_info none"]
    head += [f"element vertex {len(POINTS)}", *(f"property {number} {axis}" for axis in "xyz")]
    head += [f"property uchar {name}" for name in more]
    head += [f"element face {len(FACES)}", f"property list {length} {index} vertex_indices"]
    start = line.join([*head, "end_header", ""]).encode()
    if form == "ascii":
        rows = [" ".join([*map(repr, p), *["7"] * len(more)]) for p in POINTS.tolist()]
        rows += ["3 " + " ".join(map(str, face)) for face in FACES.tolist()]
        return start + line.join([*rows, ""]).encode()
    order = ORDERS[form]
    real = {"double": "f8", "float": "f4"}[number]
    vertex = np.zeros(len(POINTS), [("p", order + real, 3), ("more", "u1", len(more))])
    vertex["p"], vertex["more"] = POINTS, 7
    kinds = {"uchar": "u1", "int": "i4", "uint": "u4", "ushort": "u2"}
    face = np.zeros(len(FACES), [("n", order + kinds[length]), ("v", order + kinds[index], 3)])
    face["n"], face["v"] = 3, FACES
    return start + vertex.tobytes() + face.tobytes()


FORMS = {
    "ascii": ply(),
    "ascii_crlf": ply(line="\r\n"),
    "ascii_colours": ply(more=("red", "green")),
    "little": ply("binary_little_endian"),
    "little_crlf": ply("binary_little_endian", line="\r\n"),
    "little_wide": ply("binary_little_endian", index="uint", length="int"),
    "big": ply("binary_big_endian", index="ushort"),
    "big_colours": ply("binary_big_endian", more=("red", "green", "blue")),
    "vertex_index": ply().replace(b"vertex_indices", b"vertex_index"),
    "newline_at_the_end": ply("binary_little_endian") + b"\n",
}


@pytest.mark.parametrize("name", FORMS)
def test_a_ply_file_is_read_bit_for_bit(name):
    mesh = read_mesh(FORMS[name], ".ply")
    assert mesh.points.tobytes() == POINTS.tobytes()
    assert np.array_equal(mesh.triangles, FACES)
    assert mesh.left_out[:1] == (("vertex.red",) if "colours" in name else ())


def test_single_precision_stays_what_it_is():
    mesh = read_mesh(ply("binary_little_endian", number="float"), ".ply")
    assert np.array_equal(mesh.points, POINTS.astype(np.float32))


QUAD = ply().replace(b"3 0 2 1", b"4 0 2 1 3")
LITTLE = ply("binary_little_endian")
LITTLE_QUAD = LITTLE[: -13 * 3] + struct.pack("<B4i", 4, 0, 2, 1, 3) + LITTLE[-13 * 2 :]
WRONG_PLY = {
    "a quadrangle": (QUAD, "quad|length|columns"),
    "a quadrangle, binary": (LITTLE_QUAD, "differ in length"),
    "a vertex that is not there": (ply().replace(b"3 0 3 2", b"3 0 4 2"), "0 to 4 of 4"),
    "a negative vertex": (ply().replace(b"3 0 3 2", b"3 0 -1 2"), "-1"),
    "half a vertex": (ply().replace(b"3 0 3 2", b"3 0 1.5 2"), "vertices"),
    "a line too few": (ply().rpartition(b"3 0 3 2")[0], "7 lines of data, and 8"),
    "a line too many": (ply() + b"3 0 1 2\n", "9 lines"),
    "a byte too few": (LITTLE[:-1], "left"),
    "a byte too many": (LITTLE + b"\1", "follow"),
    "no z": (ply().replace(b"double z", b"double w"), "'z'"),
    "an unknown type": (ply().replace(b"double z", b"quad z"), "'quad'"),
    "an unknown format": (ply().replace(b"format ascii", b"format xdr"), "'xdr'"),
    "no end of the header": (ply().replace(b"end_header", b"end"), "end_header"),
    "a word for a number": (ply().replace(b"0.1", b"one"), "one"),
    "more than the file can hold": (ply().replace(b"vertex 4", b"vertex 99999"), "99999"),
}


@pytest.mark.parametrize("data, reason", WRONG_PLY.values(), ids=WRONG_PLY)
def test_a_ply_file_that_is_not_what_it_says_is_refused(data, reason):
    with pytest.raises(InputError, match=reason):
        read_mesh(data, ".ply")


def test_what_is_not_used_is_named(tmp_path, vfplan_cli):
    mesh = read_mesh(ply().replace(b"vertex_indices", b"corners"), ".ply")
    assert mesh.triangles is None
    assert mesh.left_out == ("face.corners",)
    (tmp_path / "a.csv").write_text("x,y,z,stroke,sigma_m\n0,0,0,0,1e-5\n0.001,0,0,0,1e-5\n")
    run = vfplan_cli("import", tmp_path / "a.csv", "--units", "m", "-o", tmp_path / "a.h5").sound
    assert "left out: stroke, sigma_m" in run.stderr
    settings = vfplan.read_fixture(tmp_path / "a.h5").provenance.settings
    assert settings["left_out"] == "stroke, sigma_m"


def text_stl(faces=FACES, name="bone", upper=False):
    lines = [f"solid {name}"]
    for face in faces:
        corners = ["vertex " + " ".join(map(repr, POINTS[i].tolist())) for i in face]
        lines += ["facet normal 0 0 1", "outer loop", *corners, "endloop", "endfacet"]
    text = "\n".join([*lines, f"endsolid {name}", ""])
    return (text.upper() if upper else text).encode()


def binary_stl(points=POINTS, faces=FACES, head=b""):
    facets = np.zeros(len(faces), STL_FACET)
    facets["corners"] = points[faces]
    return head.ljust(80, b"\0") + struct.pack("<I", len(faces)) + facets.tobytes()


STL = {
    "text": text_stl(), "upper": text_stl(upper=True), "crlf": text_stl().replace(b"\n", b"\r\n"),
    "name": text_stl(name="a facet of vertex 1"),
    "two solids": text_stl(faces=FACES[:1]) + text_stl(faces=FACES[1:]),
    "binary": binary_stl(), "binary solid": binary_stl(head=b"solid facet"),
}  # fmt: skip


@pytest.mark.parametrize("data", STL.values(), ids=STL)
def test_an_stl_file_gives_the_same_surface(data):
    mesh = read_mesh(data, ".stl")
    wanted = POINTS if b"vertex" in data.lower() else POINTS.astype(np.float32)
    assert np.array_equal(mesh.points[mesh.triangles], wanted[FACES])
    assert len(drawn(mesh.points, mesh.triangles)[0]) == 4


WRONG_STL = {
    "four corners": text_stl().replace(b"endloop", b"vertex 1 2 3\nendloop", 1),
    "misspelt": text_stl().replace(b"vertex", b"vortex", 1),
    "word": text_stl().replace(b"-0.0025", b"minus", 1),
    "cut": text_stl()[:-20], "more": text_stl() + b"facet", "empty": b"",
    "short": binary_stl()[:-1], "long": binary_stl() + b"\0",
}  # fmt: skip


@pytest.mark.parametrize("data", WRONG_STL.values(), ids=WRONG_STL)
def test_an_stl_file_that_is_not_whole_is_refused(data):
    with pytest.raises(InputError):
        read_mesh(data, ".stl")


OBJ = "\n".join(
    ["mtllib a.mtl", *("v " + " ".join(map(repr, p)) for p in POINTS.tolist()), "vn 0 0 1", "s off"]
    + [f"f {a + 1}/1/1 {b - len(POINTS)}// {c + 1}" for a, b, c in FACES.tolist()]
).encode()
WRONG_OBJ = b"f 1 2 3 4", b"v 1 2", b"v 1 2 3 2", b"f 1 2 0", b"f 1 2 99", b"f 1 2 -99", b"f a b c"


def test_an_obj_file_gives_the_same_surface():
    mesh = read_mesh(OBJ, ".obj")
    assert np.array_equal(mesh.points, POINTS)
    assert np.array_equal(mesh.triangles, FACES)
    assert mesh.left_out == ("mtllib", "vn", "s")
    for wrong in WRONG_OBJ:
        with pytest.raises(InputError):
            read_mesh(OBJ + b"\n" + wrong, ".obj")


def said(text):
    """A file of each kind whose header says something."""
    ply_with = ply().replace(b"1.0\n", b"1.0\ncomment 3D Slicer output. %b\n" % text, 1)
    return {
        ".ply": ply_with, ".obj": b"# 3D Slicer output. %b\n" % text + OBJ,
        ".stl": binary_stl(head=b"3D Slicer output. " + text),
        "text.stl": text_stl(name=text.decode()),
    }  # fmt: skip


@pytest.mark.parametrize("kind", said(b""))
def test_the_patients_axes_that_a_mesh_names_are_obeyed(kind, tmp_path):
    def imported(text, frame=None):
        path = file_with(tmp_path / f"a.{kind.removeprefix('.')}", said(text)[kind])
        return import_cloud(path, units="m", frame=frame)

    plain, lps, ras = map(imported, (b"bone", b"SPACE=LPS", b"SPACE=RAS;"))
    assert [one.frame for one in (plain, lps, ras)] == ["robot_base", "patient_lps", "patient_lps"]
    assert np.array_equal(plain.points, lps.points)
    assert np.array_equal(ras.points[ras.mesh] * [-1, -1, 1], lps.points[lps.mesh])
    assert imported(b"bone", "patient_lps").frame == "patient_lps"
    for text, frame, code in (
        (b"SPACE=LAS", None, "space-unknown"), (b"SPACE=LPS SPACE=RAS", None, "space-unknown"),
        (b"SPACE=RAS", "robot_base", "frames-differ"),
    ):  # fmt: skip
        with refuses(InputError, code):
            imported(text, frame)


@pytest.mark.parametrize("text, units, frame, wanted", [
    (b"frame image, unit px", "mm", None, "units-differ"),
    (b"frame image", "mm", None, "units-differ"), (b"frame robot_base, unit m", "mm", None,
    "units-differ"), (b"Exported with units: MM\r", "m", None, "units-differ"),
    (b"frame robot_base, unit m", "m", "patient_lps", "frames-differ"),
    (b"frame robot_base, unit m SPACE=LPS", "m", None, "frames-differ"),
    (b"frame patient_lps, unit m SPACE=LPS", "m", None, "patient_lps"),
    (b"frame patient_lps, unit m", "m", None, "patient_lps"),
    (b"one unit in each file, frame image 7", "m", None, "robot_base"),
])  # fmt: skip
def test_the_unit_and_frame_that_a_ply_names_are_obeyed(text, units, frame, wanted, tmp_path):
    (tmp_path / "a.ply").write_bytes(ply().replace(b"1.0\n", b"1.0\ncomment %b\n" % text, 1))
    if wanted.endswith("differ"):
        with refuses(InputError, wanted):
            import_cloud(tmp_path / "a.ply", units=units, frame=frame)
    else:
        assert import_cloud(tmp_path / "a.ply", units=units, frame=frame).frame == wanted


def test_another_unit_than_that_of_our_own_files_is_refused(tmp_path):
    (tmp_path / "a.ply").write_bytes(ply())
    export(import_cloud(tmp_path / "a.ply", units="m"), tmp_path / "a.stl")
    with refuses(InputError, "units-differ") as caught:
        import_cloud(tmp_path / "a.stl", units="cm")
    assert "Give --units mm" in caught.value.message
    assert np.ptp(import_cloud(tmp_path / "a.stl", units="mm").points, axis=0)[0] == 0.1
    (tmp_path / "a.csv").write_text("x_px,y_px,z_px\n1,2,3\n")
    with refuses(InputError, "units-differ") as caught:
        import_cloud(tmp_path / "a.csv", units="mm")
    assert "--units px" not in caught.value.message
    with refuses(SceneError, "spacing-too-fine") as caught:
        import_cloud(tmp_path / "a.ply", units="m", contact_radius=1e-5)
    assert "0.333 m across" in caught.value.message


def test_a_mesh_goes_back_to_the_patient_as_stl(tmp_path):
    path = file_with(tmp_path / "a.stl", binary_stl(head=b"SPACE=RAS"))
    made = import_cloud(path, units="m")
    T = np.array([[0, -1, 0, 0.5], [1, 0, 0, 0.2], [0, 0, 1, 0.1], [0, 0, 0, 1]])
    record = RegistrationRecord(
        "rigid", "patient_lps", T, ("a",), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), 0, 0, 0
    )
    moved = made.points @ T[:3, :3].T + T[:3, 3]
    carried = replace(made, frame="robot_base", points=moved, registration=record)
    for name, fixture in (("b.stl", made), ("c.stl", carried)):
        export(fixture, tmp_path / name)
        back = import_cloud(tmp_path / name, units="mm")
        assert back.frame == "patient_lps"
        assert np.abs(back.points[back.mesh] - made.points[made.mesh]).max() < 1e-7
    export(replace(made, frame="robot_base"), tmp_path / "b.stl", overwrite=True)
    assert import_cloud(tmp_path / "b.stl", units="mm").frame == "robot_base"


def test_points_at_one_place_become_one_in_order():
    """Each triangle has corners of its own, zeros of either sign; others are of none."""
    draw = np.random.default_rng(2)
    corners = np.round(draw.normal(size=(900, 3)) * 4) / 4 * draw.choice([-1.0, 1.0], (900, 1))
    own = np.arange(900).reshape(-1, 3) + 7
    points, triangles = drawn(np.vstack([np.full((7, 3), 50.0), corners]), own)
    corners = corners.reshape(-1, 3, 3)
    kept = corners[[len(np.unique(c + 0.0, axis=0)) == 3 for c in corners]]
    wanted = np.unique(kept.reshape(-1, 3) + 0.0, axis=0)
    assert np.array_equal(np.unique(points + 0.0, axis=0), wanted)
    assert np.array_equal(points[triangles], kept)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", "<i4"])
def test_arrays_of_every_kind_come_back(order, kind, tmp_path):
    points = np.asarray(np.arange(30).reshape(10, 3), dtype=kind, order=order)
    np.save(tmp_path / "a.npy", points)
    fixture = import_cloud(tmp_path / "a.npy", units="mm")
    assert np.array_equal(fixture.points, points.astype(float) * 1e-3)
    digest = hashlib.sha256((tmp_path / "a.npy").read_bytes()).hexdigest()
    assert fixture.provenance.inputs == {"cloud": digest}
    with pytest.raises(SettingError, match="Give one of m, cm"):
        import_cloud(tmp_path / "a.npy", units="furlong")


def claimed(shape):
    """An .npy file whose header claims another shape than its 24 bytes have."""
    stream = io.BytesIO()
    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + bytes(24)


@pytest.mark.parametrize("header", [
    "{'a':1}\n  b\n c\n", "{'descr': '<f8', (", "-" * 9000, "(" * 400, " " * 20060])  # fmt: skip
def test_a_header_that_is_none_is_refused_in_one_line(header, tmp_path):
    head = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode()
    (tmp_path / "a.npy").write_bytes(head)
    with pytest.raises(InputError, match=r"no \.npy file of numbers: the header is ") as raised:
        import_cloud(tmp_path / "a.npy", units="mm")
    assert "\n" not in str(raised.value)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for name in ("time", "hip"):
            archive.writestr(f"{name}.npy", head)
    with pytest.raises(SessionError, match=r"cannot be read as \.npz: ") as raised:
        read_session(tmp_path / "a.npz")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("shape", [(2, 3), (10**15, 3), (0, 3), (3,), (1, 3, 1), (-1, 3)])
def test_an_array_that_is_not_as_long_as_it_says_is_refused(shape, tmp_path):
    (tmp_path / "a.npy").write_bytes(claimed(shape))
    with pytest.raises(InputError):
        import_cloud(tmp_path / "a.npy", units="mm")


def stl_of(path, corners):
    """Binary STL of corners (K, 3, 3), which float32 rounds."""
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    return file_with(path, binary_stl(corners.reshape(-1, 3), faces))


SHARES = [pytest.param(share, marks=pytest.mark.slow) for share in np.linspace(0.01, 0.99, 34)]


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.5, 0.8, 1.0, *SHARES])
def test_turned_facets_are_felt_as_if_they_were_not(share, tmp_path):
    points, faces = sphere(20.0, 4)
    draw = np.random.default_rng(3)
    is_turned = draw.permutation(len(faces)) < round(share * len(faces))
    mixed = np.where(is_turned[:, None], faces[:, ::-1], faces)
    fixture = import_cloud(stl_of(tmp_path / "a.stl", points[mixed]), units="mm")
    codes = {finding.code: finding.text for finding in fixture.findings}
    fewer = int(min(is_turned.sum(), (~is_turned).sum()))
    assert ("facets-turned" in codes) == (fewer > 0)
    if fewer:
        assert codes["facets-turned"].startswith(f"{fewer} of {len(faces)} ")
    assert ("mesh-inside-out" in codes) == (share > 0.5)
    turn = np.linspace(0.3, 2.8, 3000)
    hips = 17e-3 * np.column_stack((np.cos(turn), np.sin(turn), 0.3 * np.sin(5 * turn)))
    hips[:200] = np.linspace(1.8 * hips[200], hips[200], 200)
    found = vfplan.replay(fixture, vfplan.Session(1e-3 * np.arange(3000), hips), rule="exact")
    steps = np.linalg.norm(np.diff(found.ticks.force[250:], axis=0), axis=1)
    assert steps.max() < 1.2 * 0.01203, "smooth as the mesh of which no facet is turned"


def test_corners_a_hair_apart_are_one_and_lost_facets_are_counted(tmp_path):
    points, faces = sphere(20.0, 4)
    corners = points[faces] + np.random.default_rng(4).normal(scale=1e-6, size=(len(faces), 3, 3))
    corners = np.concatenate((corners, points[[[0, 0, 1]]]))
    fixture = import_cloud(stl_of(tmp_path / "a.stl", corners), units="mm")
    assert (len(fixture.points), len(fixture.mesh)) == (len(points), len(faces))
    assert [finding.code for finding in fixture.findings] == ["corners-welded"]
    assert "1 facets without area" in fixture.provenance.settings["left_out"]


def grid(spacing, other=None, jitter=0.0):
    x, y = np.meshgrid(np.arange(-40, 40.1, spacing), np.arange(-40, 40.1, other or spacing))
    points = np.column_stack((x.ravel(), y.ravel(), 0 * x.ravel()))
    return points + np.random.default_rng(5).normal(scale=jitter, size=points.shape)


CLOUDS = {
    # name: (points [mm], pieces, points that are there twice); R is 5 mm
    "dense": (grid(2.0), 1, 0),
    "rough": (grid(2.0, jitter=0.3), 1, 0),
    "as wide as the proxy": (grid(9.9), 1, 0),
    "sparse": (grid(14.0), 36, 0),
    "doubled": (np.vstack([grid(14.0)] * 2), 36, 36),
    "scanned twice": (np.vstack([grid(14.0), grid(14.0) + np.array([0, 0, 0.36])]), 36, 0),
    "scan lines": (grid(0.2, 14.0), 6, 0),
    "two sheets": (np.vstack([grid(1.0), grid(1.0) + np.array([92.0, 0, 0])]), 2, 0),
    "two sheets that meet": (np.vstack([grid(1.0), grid(1.0) + np.array([89.5, 0, 0])]), 1, 0),
    "one point": (np.zeros((500, 3)), 1, 499),
}


@pytest.mark.parametrize("points, pieces, doubles", CLOUDS.values(), ids=CLOUDS)
def test_a_cloud_through_which_the_proxy_goes_is_in_pieces(points, pieces, doubles, tmp_path):
    np.save(tmp_path / "c.npy", points)
    fixture = import_cloud(tmp_path / "c.npy", units="mm")
    told = [finding.text for finding in fixture.open_findings]
    assert (f" {pieces} pieces " in "".join(told)) == (pieces > 1) == bool(told)
    assert len(fixture.points) == len(points) - doubles
    said = fixture.provenance.settings.get("left_out", "")
    assert said == (f"{doubles} points that are there twice" if doubles else "")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60))
def test_a_slit_across_a_cloud_is_told_where_the_proxy_fits_through(seed, tmp_path):
    draw = np.random.default_rng(seed)
    width, spacing = draw.uniform(7.0, 13.0), draw.uniform(0.5, 2.5)
    # Three sheets beside each other, some scanned twice, rough, or in lines along the slits.
    sheet = grid(spacing, draw.choice([spacing, 0.2 * spacing]), draw.choice([0.0, 0.02]))
    step = np.array([np.ptp(sheet[:, 0]) + width, 0, 0])
    points = np.vstack([sheet, sheet + step, sheet - step] + [sheet] * draw.integers(2))
    points = Rotation.random(random_state=seed).apply(points)
    np.save(tmp_path / "c.npy", points)
    fixture = import_cloud(tmp_path / "c.npy", units="mm")
    told = any(" 3 pieces " in finding.text for finding in fixture.findings)
    widest_mm = 2e3 * (fixture.contact_radius - fixture.band)
    assert told == (width > widest_mm) or abs(width - widest_mm) < 0.2


def test_a_cloud_farther_away_than_a_bundle_reaches_is_refused(tmp_path):
    np.save(tmp_path / "c.npy", grid(2.0) + 101.0)
    with refuses(InputError, "cloud-too-far"):
        import_cloud(tmp_path / "c.npy", units="m")
    assert import_cloud(tmp_path / "c.npy", units="mm").findings == ()
