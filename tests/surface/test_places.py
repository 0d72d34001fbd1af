"""Where outlines lie: every series is right to a micrometre, or refused by name."""

import sys

import bones
import motion
import numpy as np
import pytest
from bones import BENT
from refusals import refuses
from scipy.spatial import cKDTree

from vfplan.errors import CurveError, InputError, MissingExtra
from vfplan.surface.build import SurfaceSettings, surface
from vfplan.surface.outline import outline_of
from vfplan.surface.volumes import read_nrrd

COARSE = SurfaceSettings(tolerance_m=1e-3)
GAP = 5
GRID = bones.grid_round(GAP, pixel=1.0)


def turned(points):
    """Points in a patient who lies askew: turned about all axes, and moved."""
    turn = motion.turned([0, 0, 1], 0.3) @ motion.turned([1, 0, 0], -0.2)
    return points @ turn.T + [12, -30, 400]


def struct(tmp_path, rings, **more):
    return bones.write_rtstruct(tmp_path / "s.dcm", rings, **more)


def rings(gap=GAP):
    return bones.outlines(BENT, gap)


def coarse(tmp_path, drawn, **more):
    """The surface of outlines, to a millimetre."""
    return surface(struct(tmp_path, drawn, **more), settings=COARSE)


def told(made):
    return " | ".join(finding.text for finding in made.fixture.findings)


def test_outlines_of_a_leaning_gantry_give_the_bone_itself(tmp_path):
    """The table moves along z while the slices lean by 15 degrees: cuts of the true bone."""
    lean = np.radians(15)
    gantry = np.array([[1, 0, 0], [0, np.cos(lean), 0], [0, np.sin(lean), 1]])
    places = np.arange(-25, 26, 3.0)
    rays = np.c_[np.cos(bones.EVEN), np.sin(bones.EVEN)]
    drawn = []
    for z in places:
        near, far = np.zeros(len(rays)), np.full(len(rays), 30.0)
        for _ in range(50):
            middle = (near + far) / 2
            points = np.c_[middle[:, None] * rays, np.full(len(rays), z)] @ gantry.T
            inside = BENT.level(points) < 0
            near, far = np.where(inside, middle, near), np.where(inside, far, middle)
        drawn.append((near[:, None] * rays, z))
    path = struct(tmp_path, drawn, place=lambda points: points @ gantry.T)
    made = surface(path, settings=SurfaceSettings(tolerance_m=5e-4))
    assert made.report["spacing_mm"] == pytest.approx(3 * np.cos(lean), abs=1e-6)
    assert made.report["normal"] == pytest.approx([0, -np.sin(lean), np.cos(lean)], abs=1e-7)
    wanted = np.concatenate([np.c_[ring, np.full(len(ring), z)] for ring, z in drawn]) @ gantry.T
    assert cKDTree(outline_places(made)).query(wanted)[0].max() < 1e-3
    points = 1e3 * made.fixture.points
    height = np.linalg.solve(gantry, points.T)[2]
    away = BENT.distance(points[(height > places[0] + 0.1) & (height < places[-1] - 0.1)])
    assert np.sqrt((away**2).mean()) <= 0.05
    assert np.abs(away).max() <= 0.15


def label_maps(tmp_path, grid, labels):
    writers = {"dcm": bones.write_seg, "seg.nrrd": bones.write_nrrd, "nii.gz": bones.write_nifti}
    return [write(tmp_path / f"g.{end}", labels, grid) for end, write in writers.items()]


def outline_places(made):
    """(M, 3) corners of all outlines in the patient [mm]."""
    R = made.sliced.R_slice_patient
    found = []
    for outline in made.sliced.outlines:
        found += [np.c_[ring, np.full(len(ring), outline.z)] @ R for ring in outline.rings]
    return 1e3 * np.concatenate(found)


@pytest.mark.parametrize("series", ["oblique", "tilted"])
def test_a_label_map_lies_where_its_file_says(series, tmp_path):
    """The same voxels written in another order, or carried, to within a micrometre."""
    labels = GRID.labels(BENT)
    plain = surface(bones.write_nifti(tmp_path / "p.nii", labels, GRID), settings=COARSE)
    wanted = outline_places(plain)
    corner, axes = GRID.corner, GRID.axes
    if series == "oblique":
        corner, axes = turned(corner), (turned(axes.T) - turned(np.zeros((1, 3)))).T
        wanted = turned(wanted)
    else:  # the gantry leans: each slice slides along its rows against the one below
        shear = np.array([[1, 0, 0], [0, 1, 0.2], [0, 0, 1]])
        corner, axes = shear @ corner, shear @ axes
        wanted = wanted @ shear.T
    there = bones.Grid(corner, axes, GRID.size)
    files = label_maps(tmp_path, there, np.ascontiguousarray(labels))
    for path in files if series == "oblique" else files[:1]:
        found = outline_places(surface(path, settings=COARSE))
        assert len(found) == len(wanted)
        # NIfTI holds its places in single precision: 3e-5 mm at 400 mm.
        assert cKDTree(found).query(wanted)[0].max() < 1e-3, path.name


def test_uneven_slices_keep_their_places(tmp_path):
    places = [z for z in BENT.places(2) if z % 6 or z % 4 == 0]
    uneven = [(ring, z) for ring, z in rings(2) if z in places]
    settings = SurfaceSettings(tolerance_m=4e-4, max_spacing_m=5e-3)
    made = surface(struct(tmp_path, uneven), settings=settings)
    points = 1e3 * made.fixture.points
    inside = (points[:, 2] > places[0]) & (points[:, 2] < places[-1])
    assert np.abs(BENT.distance(points[inside])).max() < 0.05
    assert made.report["spacing_range_mm"] == pytest.approx([2, 4], abs=1e-6)
    assert "2 to 4 mm apart" in told(made)


EIGHT = np.c_[10 * np.sin(bones.EVEN[::4]), 6 * np.sin(2 * bones.EVEN[::4])]
REFUSED = {
    "slices-missing": ([(r, z) for r, z in rings() if z != 2], None, {"gap_mm": 10, "usual_mm": 5}),
    "slices-doubled": ([*rings(), (BENT.rings(0.0)[0], 2.03)], None,
                       {"gap_mm": 0.03, "usual_mm": 5}),
    "outline-doubled": ([*rings(), *(r for r in rings() if r[1] == 2)], "slice at z = 2.00 mm", {}),
    "outline-crosses": ([(EIGHT, z) for z in (0.0, 2.0)], "slice at z = 0.00 mm",
                        {"x_mm": 0, "y_mm": 0}),
    "outlines-cross": ([(bones.ring((x, 0), (8, 8)), z) for z in (0.0, 2.0) for x in (0, 9)],
                       "slice at z = 0.00 mm", {}),
    "slices-too-few": (rings()[:1], None, {"slices": 1, "slices_min": 2}),
}  # fmt: skip


@pytest.mark.parametrize("code", REFUSED)
def test_outlines_that_make_no_surface_are_refused(code, tmp_path):
    drawn, where, numbers = REFUSED[code]
    with refuses(CurveError, code) as refused:
        coarse(tmp_path, drawn)
    assert refused.value.where == where
    assert not numbers or refused.value.numbers == pytest.approx(numbers, abs=1e-6)


def test_doubled_frames_are_refused(tmp_path):
    flat = bones.Grid(GRID.corner, GRID.axes * [1, 1, 0], GRID.size)
    path = bones.write_seg(tmp_path / "g.dcm", GRID.labels(BENT), flat)
    with refuses(InputError, "slices-doubled"):
        surface(path, settings=COARSE)


def test_slices_that_are_not_parallel_are_refused(tmp_path):
    def wedge(points):
        return points + np.c_[np.zeros((len(points), 2)), points[:, 0] * points[:, 2] * 1e-2]

    with refuses(CurveError, "outline-not-flat"):
        coarse(tmp_path, rings(), place=wedge)


def test_an_empty_slice_parts_a_label_map_in_two(tmp_path):
    labels = GRID.labels(BENT)
    labels[:, :, 7] = 0
    made = surface(bones.write_seg(tmp_path / "g.dcm", labels, GRID), settings=COARSE)
    assert len(made.sliced.stacks) == 2
    gap = 1e3 * made.fixture.points[:, 2]
    assert not ((gap > -3 - 2.4) & (gap < -3 + 2.4)).any()
    assert made.report["open_edges"] == 0


@pytest.mark.parametrize("ends, beyond", [("capped", 2.5), ("open", 0)])
def test_ends_are_capped_half_a_slice_beyond_or_left_open(ends, beyond, tmp_path):
    settings = SurfaceSettings(tolerance_m=1e-3, keep_open=ends == "open")
    made = surface(struct(tmp_path, rings()), settings=settings)
    z = 1e3 * made.fixture.points[:, 2]
    assert [z.min(), z.max()] == pytest.approx([-38 - beyond, 37 + beyond])
    assert made.report["ends"] == ends
    assert (made.report["open_edges"] > 50) == (ends == "open")
    assert (made.report["open_edges"] == 0) == (ends == "capped")
    assert (made.report["volume_mm3"] is None) == (ends == "open")


def keyhole(width):
    """A ring of radius 15 with a hole of radius 5, joined by a channel of that width."""
    outer, inner = bones.ring((0, 0), (15, 15)), bones.ring((0, 0), (5, 5))[::-1]
    inner = np.roll(inner, 1, axis=0)
    up, down = [0, width / 2], [0, -width / 2]
    return np.vstack([outer[:1] + up, outer[1:], outer[:1] + down,
                      inner[:1] + down, inner[1:], inner[:1] + up])  # fmt: skip


@pytest.mark.parametrize("width", [0.0, 0.02])
def test_a_keyhole_is_a_hole(width, tmp_path):
    drawn = [(keyhole(width), z) for z in (0.0, 2.0, 4.0, 6.0)]
    made = coarse(tmp_path, drawn)
    assert [len(o.rings) for o in made.sliced.stacks[0].outlines] == [2] * 4
    assert made.report["volume_mm3"] == pytest.approx(np.pi * (15**2 - 5**2) * 8, rel=5e-3)
    assert made.report["open_edges"] == 0


def test_forks_and_ends_between_slices_are_told_with_their_place(tmp_path):
    one = [(bones.ring((0, 0), (20, 9)), z) for z in (0.0, 2.0, 4.0)]
    two = [(bones.ring((x, 0), (8, 8)), z) for z in (6.0, 8.0, 10.0) for x in (-10, 10)]
    last = [(bones.ring((10, 0), (8, 8)), z) for z in (12.0, 14.0)]
    made = coarse(tmp_path, one + two + last)
    assert "slice at z = 4.00 mm to 6.00 mm: a part forks" in told(made)
    assert "slice at z = 10.00 mm to 12.00 mm: a part begins or ends" in told(made)
    assert made.report["open_edges"] == 0


def test_a_place_of_no_patient_is_refused(tmp_path):
    import nibabel

    image = nibabel.Nifti1Image(GRID.labels(BENT), np.diag([1.0, 1, 5, 1]))
    image.set_sform(None, code=0)
    image.set_qform(None, code=0)
    nibabel.save(image, tmp_path / "n.nii")
    with refuses(InputError, "volume-without-place"):
        surface(tmp_path / "n.nii")
    image.set_sform(np.diag([1.0, 1, 5, 1]), code=1)
    image.set_qform(np.diag([1.0, 1, 5.01, 1]), code=1)
    nibabel.save(image, tmp_path / "n.nii")
    with refuses(InputError, "volume-places-differ") as refused:
        surface(tmp_path / "n.nii")
    assert refused.value.numbers["distance_mm"] == pytest.approx(0.16, abs=0.005)


UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
SPACES = ["RAS", "LAS", "left-posterior-superior", "right-anterior-superior", "PSL", "AIR"]
LETTERS = {"L": (0, 1), "R": (0, -1), "P": (1, 1), "A": (1, -1), "S": (2, 1), "I": (2, -1)}


def nrrd(path, labels, T_lps_voxel_m, space, units):
    """A label map whose header gives the same place in any space and units."""
    letters = [word[0].upper() for word in space.split("-")] if "-" in space else space
    rows = [LETTERS[letter] for letter in letters]
    unit = UNITS.get(units, 1e-3)
    T = np.array([sign * T_lps_voxel_m[axis] / unit for axis, sign in rows])
    vectors = [f"({','.join(map(repr, column))})" for column in T.T.tolist()]
    head = ["NRRD0004", "type: uint8", "dimension: 3", f"space: {space}", "encoding: raw"]
    head += [f"sizes: {' '.join(map(str, labels.shape))}", "endian: little"]
    head += [f"space directions: {' '.join(vectors[:3])}", f"space origin: {vectors[3]}"]
    head += [f'space units: "{units}" "{units}" "{units}"'] * (units is not None)
    path.write_bytes("\n".join([*head, "", ""]).encode() + labels.tobytes(order="F"))
    return path


def test_a_label_map_lies_where_its_space_and_units_say(tmp_path, monkeypatch):
    # This process goes on, and is no sandbox.
    monkeypatch.setattr("vfplan.surface.volumes.raise_limits", lambda *limits: None)
    labels = np.zeros((5, 6, 7), np.uint8)
    labels[1:4, 2:5, 1:6] = 1
    T = np.c_[1e-3 * turned(np.diag([0.5, 0.7, 2.0])).T, [0.01, -0.02, 0.3]]
    T[:, :3] -= 1e-3 * turned(np.zeros((1, 3))).T
    for space in SPACES:
        for units in (None, *UNITS):
            data = nrrd(tmp_path / "a.nrrd", labels, T, space, units).read_bytes()
            assert np.abs(read_nrrd(data)[2][:3] - T).max() < 1e-12
    unplaced = ("LRS", "mm", "volume-without-place")
    for space, units, code in (("LPS", "inch", "unit-unknown"), unplaced):
        with refuses(InputError, code):
            read_nrrd(nrrd(tmp_path / "a.nrrd", labels, T, space, units).read_bytes())


def plate(thickness):
    return np.array([[-1, -10], [1, -10], [1, 10], [-1, 10]]) * [thickness / 2, 1.0]


def test_thin_walls_stay_or_are_refused_with_their_thickness(tmp_path):
    drawn = [(plate(0.5), float(z)) for z in range(8)]
    made = surface(struct(tmp_path, drawn))
    low, high = made.report["extent_m"]
    assert high[0] - low[0] == pytest.approx(5e-4, abs=2e-5)
    assert made.report["grid_mm"] < 0.5
    with refuses(CurveError, "structure-thin") as refused:
        coarse(tmp_path, [(plate(0.15), float(z)) for z in range(8)])
    assert refused.value.numbers["thickness_mm"] == pytest.approx(0.15, rel=0.01)
    with refuses(CurveError, "outline-empty"):
        surface(struct(tmp_path, [(plate(0.03), float(z)) for z in range(8)]))
    island = [(plate(0.2) + np.array([30, 0]), z) for _, z in drawn]
    thick = [(plate(20.0), z) for _, z in drawn]
    made = coarse(tmp_path, thick + island)
    assert "8 parts or holes of outlines are thinner" in told(made)


def test_a_contour_of_two_points_is_left_out_with_a_doubt(tmp_path):
    made = coarse(tmp_path, [*rings(), (np.array([[0, 0], [3.0, 0]]), 0.0)])
    assert made.report["outlines"] == len(rings())
    assert "1 contours are closed, of two points" in told(made)


def test_a_structure_is_chosen_by_name_or_number(tmp_path):
    path = struct(tmp_path, rings(), names=["femur", "cyst"])
    for name in ("femur", "1"):
        assert surface(path, structure=name, settings=COARSE).report["slices"] == 16
    with refuses(InputError, "structure-unknown") as refused:
        surface(path, structure="tibia")
    assert "1 'femur', 2 'cyst'" in refused.value.message
    with refuses(InputError, "structure-empty", structure=2):
        surface(path, structure="cyst")


def test_without_shapely_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "shapely", None)
    with pytest.raises(MissingExtra, match=r"vfplan\[surface\]"):
        outline_of([np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])], 0.0)
