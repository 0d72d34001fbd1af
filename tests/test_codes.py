"""Calls that are refused by a code which no other test raises; `--all` says if one is left over.

`support/codes.py` watches the codes that the tests raise, and `conftest.py` asks it at the end.
"""

from __future__ import annotations

import gzip
import io
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace as as_is

import bundles
import meshes
import numpy as np
import pytest
import slicer_files
from captures import capture
from conftest import ROOT, file_with
from layouts import solid
from refusals import refuses
from replays import probing
from rosbags import rosbag2
from rosbags.typesys import Stores, get_typestore
from vfplan.cli.extract import write_pictures
from vfplan.cli.outputs import refuse_folder, refuse_place

import vfplan
from vfplan.arm.rehearsal import check_session
from vfplan.bench import peers
from vfplan.bench.pipeline import bench, thin_hue_mask
from vfplan.bundle.importing import drawn
from vfplan.bundle.read import read_bundle
from vfplan.bundle.validation import validate
from vfplan.burr import burr
from vfplan.campaign import trial
from vfplan.campaign.store import open_folder, workers_of_cluster
from vfplan.conformance.vectors import changed
from vfplan.errors import InputError, VfplanError
from vfplan.fixture import Stroke
from vfplan.images.read import read_image
from vfplan.io.files import MAX_COLUMNS, MAX_LINE_BYTES, decompress, open_number_table, opened_file
from vfplan.live.sources import stream_udp
from vfplan.planning import match
from vfplan.planning.extraction import read_vectors, resample
from vfplan.planning.plan import add_guidance, ignored_axis
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.registration.registration import fit_registration
from vfplan.registration.touch import refine_by_touch
from vfplan.replaying.changing import ChangingFixture, load_exchange
from vfplan.replaying.findings import run_findings
from vfplan.replaying.guiding import make_engine
from vfplan.review import markers, rendered, strokes
from vfplan.review.geometry import route_over
from vfplan.review.server import Draft
from vfplan.review.session import Session
from vfplan.review.steps import apply
from vfplan.scenes import god_object
from vfplan.scenes.outline import Look
from vfplan.session import bags
from vfplan.session.events import Event, _check_counts
from vfplan.session.result import ResultWriter, read_result
from vfplan.surface import mesh, outline, sources, volumes
from vfplan.surface.build import read_contours

SMALL, SOLID = bundles.small(), bundles.patient()


def table(data, columns=("a",)):
    list(open_number_table(lambda: io.BytesIO(data), "t.csv", InputError).blocks(columns))


def mended(points, closed=False):
    points = np.array(points, float)
    return strokes.MendedStroke.of(Stroke(points, closed, width=3.0))


def ink(mask):
    piece = as_is(mask=mask)
    return as_is(piece=piece, box=(0, 0, *mask.shape), number=1, pixels=int(mask.sum()))


def stored(folder, fixture):
    return bundles.stored(folder / "f.h5", fixture)


def stored_result(folder):
    with ResultWriter(folder / "r.h5", {}):
        pass
    return folder / "r.h5"


def taken_up(draft):
    """A draft with a step that there is not."""
    draft.keep(as_is(steps=[{"do": "fly"}], undone=[]))
    return draft.take_up(as_is(apply=lambda step: apply(None, step)))


def two_slices(folder):
    """Open curves on slices that say where they lie."""
    place = {"ImageOrientationPatient": [1, 0, 0, 0, 1, 0], "PixelSpacing": [0.5, 0.5]}
    for z in range(2):
        capture(folder, **place, ImagePositionPatient=[0, 0, z]).rename(folder / f"{z}.dcm")
    return folder


def touched(source, target):
    """Twelve points on the sides of a cube, of which one lies beside it."""
    corners, triangles = meshes.box((0.1, 0.1, 0.1))
    tips = corners[triangles].mean(axis=1)
    tips[0] += [-4e-3, 0, 0]
    registration = fit_registration(source, target, model="rigid")
    refine_by_touch(registration, registration.apply(tips), corners, triangles)


def empty_bag(path):
    """A bag that says that it holds a message."""
    with rosbag2.Writer(path, version=9) as writer:
        kind = "geometry_msgs/msg/PoseStamped"
        writer.add_connection("/pose", kind, typestore=get_typestore(Stores.ROS2_HUMBLE))
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace("message_count: 0", "message_count: 1"))
    return path


def odd_mcap(path):
    """A recording of ticks that another version made."""
    with path.open("wb") as file:
        writer = pytest.importorskip("mcap.writer").Writer(file)
        writer.start()
        topic = writer.register_channel(bags.TOPIC, "json", 0)
        writer.add_message(topic, log_time=0, data=b"{}", publish_time=0)
        writer.finish()
    return path


def no_scheduler(*args, **words):
    raise OSError("Timed out")


# (M, 2) a closed curve on a slice [px].
RING = 100 + 40 * np.array([(np.cos(t), np.sin(t)) for t in np.arange(0, 6.28, 0.02)])

CROSS = np.zeros((90, 90), bool)
CROSS[44:46] = CROSS[:, 44:46] = True

# fmt: off
CALLS = {
    # What a campaign or a rehearsal is given.
    "folder-not-made": lambda d: open_folder(d / "no" / "c", {}),
    "not-rendered": lambda d: trial.checked_registration(replace(SOLID, frame="patient_lps")),
    "no-fle": lambda d: trial.fle_of(as_is(source=np.zeros((3, 2)), model="affine")),
    "session-length": lambda d: check_session(
        as_is(frame="robot_base", hip=[SMALL.points[0]], name="s.csv"), SMALL),
    # Replays, live views, burrs.
    "changes-guide": lambda d: ChangingFixture(bundles.guided(), "robust", None, None, {}, None),
    "rule-without-region": lambda d: make_engine(as_is(guidance=1, region=None), "paper"),
    "exchange-guides": lambda d: load_exchange(Event(0, bundles.guided()), "robust", None),
    "nothing-to-burr": lambda d: burr(bundles.guided(), probing(), 1e-3),
    "address-unusable": lambda d: stream_udp("udp://192.0.2.1:5005"),
    "no-hue": lambda d: thin_hue_mask(np.zeros((5, 5, 3), np.uint8)),
    # Settings of a plan.
    "guide-without-curve": lambda d: add_guidance(
        SMALL, FixtureSettings(guide_m=1e-3), match.Record()),
    "no-normal": lambda d: ignored_axis(
        "normal", as_is(T_target_source=np.eye(4), source=np.zeros((3, 3)))),
    "density-of-surface": lambda d: vfplan.register(
        bundles.sheet(), "m.csv", settings=FixtureSettings(density_per_m=1e3)),
    "density-of-mask": lambda d: resample(as_is(method="mask"), None, 1.0),
    "find-markers-in-space": lambda d: match.find_drawn(as_is(source_frame="patient_lps"), None),
    "find-markers-no-image": lambda d: match.find_drawn(as_is(source_frame="image"), None),
    "touch-no-mesh": lambda d: match.refine(SMALL, None, "t.csv", 0.0, None),
    "tip-radius-range": lambda d: match.refine(bundles.sheet(), None, "t.csv", -1.0, None),
    "touch-no-surface": lambda d: touched(*solid(noise=1e-5)),
    "picture-without-image": lambda d: write_pictures(
        as_is(image=None, extraction=None), d / "m.png", None),
    "no-triangle": lambda d: drawn(np.zeros((3, 3)), np.array([[0, 1, 2]])),
    # The page of a review.
    "knot-exists": lambda d: mended(RING).insert_knot(RING[0]),
    "too-few-knots": lambda d: mended([(0, 0), (1, 0)]).delete_knot(0, None),
    "stretch-off-curve": lambda d: mended(RING, True).redraw(np.array([RING[0], (9, 9)]), None),
    "stretch-too-short": lambda d: mended(RING, True).redraw(RING[[0, 0]], None),
    "ink-no-line": lambda d: route_over(ink(np.ones((3, 3), bool))),
    "ink-forks": lambda d: route_over(ink(CROSS)),
    "no-drawn-curve": lambda d: Session.open(stored(d, SMALL)),
    "slice-unplaced": lambda d: rendered.strokes_on_slice(
        replace(SOLID, frame="patient_lps"), as_is(T_patient_image=None)),
    "markers-not-for-robot": lambda d: markers.fit_of(
        as_is(target_frame="patient_lps"), None, None),
    "draft-does-not-fit": lambda d: taken_up(Draft(d / "draft.json", {}, {})),
    # Recorded sessions and results.
    "topic-empty": lambda d: vfplan.read_session(
        empty_bag(d / "bag"), ros=bags.RosOptions(topic="/pose")),
    "layout-unknown": lambda d: bags.read_ticks(odd_mcap(d / "a.mcap")),
    "result-empty": lambda d: read_result(stored_result(d)),
    "loop-counts-invalid": lambda d: _check_counts("events", np.array([2.0]), 1, "s.csv"),
    "no-such-peer": lambda d: bench(["proxy"], quick=True, peers=[peers.Peer("")]),
    "corrupt.shape": lambda d: read_bundle(file_with(
        d / "f.h5", changed("curve", {"/curve/closed": np.zeros(3, np.uint8)}))),
    # Files, tables and folders.
    "file-unreadable": lambda d: opened_file(d / "a\0b"),
    "compressed-data-cut": lambda d: decompress(gzip.compress(b"whole")[:-8], "gzip", 99),
    "compressed-data-damaged": lambda d: decompress(b"none", "bzip2", 99),
    "line-too-long": lambda d: table(b"x" * (MAX_LINE_BYTES + 1)),
    "too-many-columns": lambda d: table(b"x," * MAX_COLUMNS + b"x"),
    "folder-is-a-file": lambda d: refuse_folder(file_with(d / "f", "")),
    "output-is-a-directory": lambda d: refuse_place(d),
    # Outlines, label maps, surfaces.
    "structure-none": lambda d: outline.choose_structure((), None),
    "surface-too-fine": lambda d: mesh.grid_axes(
        as_is(outlines=[as_is(rings=[RING])], z=np.array([0.0, 1.0])), 1e-2, False),
    "voxel-size": lambda d: volumes.checked_place(1e-9 * np.eye(4)),
    "voxel-axes": lambda d: volumes.checked_place(np.full((4, 4), 1e-3)),
    "volume-unsupported": lambda d: volumes.places_of_labels(np.zeros((2, 1, 1, 1), int)),
    "not-a-label-map": lambda d: volumes.places_of_labels(np.full((1, 1, 1, 1), -1)),
    "outline-not-finite": lambda d: sources.ring_of_contour(
        as_is(get_item=lambda name: as_is(value=["1", "nan", "2"]))),
    "source-several": lambda d: read_contours([Path("a.nrrd"), Path("b.nrrd")], None, None),
    "slice-alone": lambda d: outline.runs_of_slices(
        [as_is(z=0.0), as_is(z=1e-3), as_is(z=2e-3)], np.array([5e-4]), np.eye(3)[2], None),
    "curve-not-closed": lambda d: sources.read_slicer_curves(
        [file_with(d / "f.mrk.json", slicer_files.mrk([]))]),
    "outline-open": lambda d: sources.read_drawn_slices(two_slices(d), None),
}
# The same, where what is wrong is made so: what is put in the place of which name.
PATCHED = {
    "no-scheduler": (
        "distributed.Client", no_scheduler,
        lambda d: workers_of_cluster("tcp://none", b"").__enter__()),
    "not-settled": (
        "vfplan.scenes.god_object.MAX_STEPS", 0,
        lambda d: god_object.follow(
            (as_is(look=lambda x: Look(np.full(1, 9.0), np.eye(3)[:1], np.zeros((1, 3, 3)))),),
            np.zeros(3), np.ones(3), 1.0)),
    "peer-not-built": (
        "vfplan.bench.peers.which", lambda name: "false", lambda d: peers.build_nanoflann(d)),
    "no-compiler": (
        "vfplan.bench.peers.which", lambda name: None, lambda d: peers.build_nanoflann(d)),
    "peer-slow": ("vfplan.bench.peers.TIMEOUT_S", 0.05, lambda d: peers.Peer("sleep").call("9")),
}
# fmt: on


@pytest.mark.parametrize("code", CALLS)
def test_the_call_is_refused_by_the_code(code, tmp_path):
    with refuses(VfplanError, code):
        CALLS[code](tmp_path)


@pytest.mark.parametrize("code", PATCHED)
def test_the_call_is_refused_where_it_is_made_so(code, monkeypatch, tmp_path):
    name, value, call = PATCHED[code]
    monkeypatch.setattr(name, value)
    with refuses(VfplanError, code):
        call(tmp_path)


def test_what_a_replay_of_a_run_and_of_changes_remarks():
    report = {"clearance_min_m": -1e-3, "episodes": [], "crossed_ticks": 1, "poses_refused": 2}
    report |= {f"{name}_ticks": 3 for name in ("inside", "too_fast")}
    found = run_findings(report, as_is(band=1e-5, rule="paper", r1=1e-3))
    assert [(one["code"], one["severity"]) for one in found] == [
        ("proxy-inside", "warning"), ("started-inside", "warning"), ("crossed", "warning"),
        ("poses-refused", "warning"), ("too-fast", "warning"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "fixture, code", [(SMALL, "leak.uncertified"), (bundles.sheet(), "leak.open_edges")]
)
def test_what_validate_remarks(fixture, code, tmp_path):
    assert code in [issue.code for issue in validate(stored(tmp_path, fixture))]


def test_what_of_another_image_is_doubted(monkeypatch, tmp_path):
    folder, settings = ROOT / "samples", ExtractSettings(pixel_spacing_mm=(0.5, 0.5))
    image = read_image(folder / "elbow.png", pixel_spacing_mm=(0.5, 0.5))
    curve = vfplan.extract(folder / "elbow.png", settings).fixture
    pairs = [folder / f"elbow_markers_{side}.csv" for side in ("image", "robot")]
    found = vfplan.register(curve, *pairs, image=replace(image, sha256="0" * 64)).findings
    assert "image-other" in [finding.code for finding in found]

    path = file_with(tmp_path / "c.csv", "u_px,v_px\n1,1\n50,9\n")
    monkeypatch.setattr("vfplan.vectors.curve.check_drawn_on", lambda *words: ("Check it.",))
    (finding,) = read_vectors(image, path, settings)[0].findings
    assert finding.code == "vector-image-unknown"
