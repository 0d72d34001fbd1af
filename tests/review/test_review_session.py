"""A review's state: what steps do, that they can be undone, and that a draft gives it again."""

from __future__ import annotations

import json
import shutil
from contextlib import nullcontext, suppress
from dataclasses import replace
from operator import attrgetter

import as_people_draw
import bundles
import cv2
import numpy as np
import pytest
import review_slices
import slicer_files
import slices
from captures import capture, ct_series
from drawing import normal_errors, polyline
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from refusals import refuses
from review_slices import (
    MARKERS,
    SAMPLES,
    SLICE,
    clear,
    double,
    fork,
    half_double,
    marker_table,
    miss,
    photographed,
    two_candidates,
)
from scipy.spatial import cKDTree
from vfplan.cli.info import summary_text

import vfplan
from vfplan.bundle.validation import describe
from vfplan.errors import CheckFailed, CurveError, ImageError, InputError, SettingError
from vfplan.findings import doubt
from vfplan.fixture import Stroke
from vfplan.geometry.lines import step_lengths
from vfplan.markers.correspondences import read_markers
from vfplan.planning.settings import FixtureSettings
from vfplan.registration.registration import own_bound
from vfplan.review.plan import Plan
from vfplan.review.server import Draft
from vfplan.review.session import Session
from vfplan.review.sheet import facts_of
from vfplan.review.strokes import HAND_SIGMA_PX, MendedStroke, SliceInk

TRUTH = np.array(json.loads((SAMPLES / "elbow_truth.json").read_text())["curve_px"])


def curve_of(session):
    return session.state()["curve_px"][0]


def text(session):
    return json.dumps(session.state(), sort_keys=True)


def opened(kind, folder):
    """A drawn slice under review, and what else is known of it."""
    path, *more = kind(folder / "slice.png")
    return Session.open(path), *more


def codes_of(session):
    return [finding.code for finding in session.current.findings]


def do(session, name, **fields):
    """The session after one step."""
    return session.apply({"do": name, **fields})


def after(session, steps):
    for step in steps:
        session = session.apply(step)
    return session


def undone(session):
    while session.steps:
        session = session.undo()
    return session


def looked_at(session):
    """The session with every stroke in view and every doubt accepted."""
    for stroke in range(len(session.state()["curve_px"])):
        session = session.apply({"do": "viewed", "stroke": stroke, "from": 0.0, "to": 1.0})
    for number, finding in enumerate(session.state()["findings"]):
        if finding["severity"] == "doubt" and finding["answered_by"] is None:
            session = do(session, "answer", finding=number, by="A. Planner")
    return session


@pytest.fixture(scope="module")
def sample():
    return Session.open(SLICE, *MARKERS, pixel_spacing_mm=0.5)


def test_the_sample_is_approved_into_a_reviewed_fixture(sample):
    state = sample.state()
    assert state["refusal"] is None
    assert miss(state["curve_px"][0], TRUTH) < 0.3
    assert 25 <= len(state["knots_px"][0]) <= 35
    assert not state["approvable"]
    with refuses(CheckFailed, "not-approvable"):
        sample.approve("A. Planner")
    done = looked_at(sample)
    assert done.state()["why_not"] == []
    fixture = done.approve("A. Planner")
    assert fixture.reviewed.by == "A. Planner"
    assert not fixture.open_findings
    planned = vfplan.plan(SLICE, *MARKERS, extraction=sample.source.extraction)
    assert np.allclose(fixture.points, planned.fixture.points, atol=1e-9)


@pytest.mark.parametrize("kind", [two_candidates, fork])
def test_a_refused_slice_is_settled_by_choosing(kind, tmp_path):
    session, truth = opened(kind, tmp_path)
    state = session.state()
    assert (state["curve_px"], state["refusal"]["stage"]) == ([], "extract")
    names = [way["name"] for way in state["candidates"]]
    assert names[:2] == {fork: ["1a", "1b"]}.get(kind, ["1", "2"])
    misses = []
    for way in state["candidates"]:
        chosen = do(session, "choose", candidate=way["name"])
        curve = curve_of(chosen)
        # An earlier draft has its number.
        number = session.current.geometry.names[way["name"]]
        assert curve_of(do(session, "choose", candidate=number)) == curve
        misses.append(miss(curve, truth) if len(curve) > 0.8 * np.ptp(truth[:, 0]) else 1e9)
        looked_at(chosen).approve("A. Planner")
    assert min(misses) < 0.3


@pytest.mark.parametrize("kind, count", [(review_slices.several, 1), (double, 2)])
def test_a_candidate_is_the_line_of_its_number_in_the_terminal(kind, count, tmp_path):
    session, *_ = opened(kind, tmp_path)
    state = session.state()
    told, ways = state["refusal"]["text"], state["candidates"]
    for way in ways[:count]:
        assert "{name}: {words}".format(**way) in told
        taken = do(session, "choose", candidate=way["name"])
        whole = Session.open(session.source.path, stroke=int(way["name"]))
        assert curve_of(taken) == curve_of(whole)
    assert not any(f"{way['name']}: " in told for way in ways[count:])


@pytest.mark.parametrize("kind", [half_double, review_slices.smooth])
def test_a_line_that_was_refused_as_two_runs_is_asked_about_however_it_is_taken(kind, tmp_path):
    session, truth = opened(kind, tmp_path)
    if session.state()["refusal"] is not None:
        assert session.state()["refusal"]["code"] == "runs-side-by-side"
        session = do(session, "choose", candidate=1)
    whole = [*truth[::60].tolist(), truth[-1].tolist()]
    drawn = do(session, "draw", points=whole, replace=True)
    for taken in (session, drawn):
        assert "width-changes" in codes_of(taken)
        assert taken.why_not()


def findings_of(session):
    return {(found.code, found.text, found.severity) for found in session.current.findings}


KINDS = [(slices, kind) for kind in (*slices.KINDS, *slices.TRAPS, *slices.HIDDEN)]
KINDS += [(as_people_draw, kind) for kind in as_people_draw.KINDS]


@pytest.mark.slow
@pytest.mark.parametrize("family, kind", KINDS)
def test_a_line_that_is_clicked_has_the_findings_of_extraction(family, kind, tmp_path):
    """Each line that extraction takes by its number, once it is clicked."""
    path = tmp_path / "slice.png"
    cv2.imwrite(str(path), family.draw(kind, 0).image[..., ::-1])
    session = Session.open(path)
    for number in (None, 1, 2, 3):
        wanted = Session.open(path, stroke=number)
        for stroke in wanted.current.geometry.strokes:
            # A place on the ink, as a line that runs into letters is measured beside it.
            middle = stroke.points[len(stroke.points) // 3 : -len(stroke.points) // 3]
            away = cKDTree(session.current.geometry.ink.bones[0]).query(middle)[0]
            taken = do(session, "choose", at=middle[away.argmin()].tolist())
            is_same = np.array_equal(curve_of(taken), curve_of(wanted))
            assert findings_of(taken) == findings_of(wanted) if is_same else number is not None


def test_a_short_line_beside_a_long_one_is_asked_about_however_it_is_taken(tmp_path):
    session, truth = opened(review_slices.crumb, tmp_path)
    meant, asked = Session.open(tmp_path / "slice.png", stroke=2), {"curve-short", "ink-outweighs"}
    assert findings_of(do(session, "take", ink=1)) == findings_of(meant)
    drawn = do(session, "draw", points=truth[::57].tolist(), replace=True)
    both = session.apply({"do": "take", "ink": 1, "as": "part"})
    # A line that is drawn on and on is not short for ever.
    longer = do(drawn, "draw", points=[truth[0].tolist(), [170, 250], [90, 250]])
    for one, wanted in ((meant, asked), (drawn, asked), (both, set()), (longer, {"ink-outweighs"})):
        assert {code for code, *_ in findings_of(one)} & asked == wanted


def test_a_ring_is_whole_without_its_overshooting_ends_which_are_asked_about(tmp_path):
    session, truth = opened(review_slices.overshoot, tmp_path)
    taken = do(session, "choose", at=truth[200].tolist())
    assert cKDTree(curve_of(taken)).query(truth)[0].max() < 0.6
    assert miss(curve_of(taken), truth) < 0.3
    assert codes_of(taken) == ["ink-joins", "ink-joins"]
    # The list of other ink names each by the same place and size.
    asked = {finding.text.partition(" px joins")[0] for finding in taken.current.findings}
    words, entries = "At ({u:.0f}, {v:.0f}): ink of {size_px:.0f}", taken.state()["account"]
    assert {words.format(**entry) for entry in entries} == asked


def test_a_click_on_ink_that_no_way_passes_takes_the_line_straight_on(tmp_path):
    session, truth = opened(review_slices.loops, tmp_path)
    ways = [way.points for way in session.current.geometry.candidates.values()]
    away = np.min([cKDTree(points).query(truth)[0] for points in ways], axis=0)
    taken = do(session, "choose", at=truth[away.argmax()].tolist())
    assert miss(curve_of(taken), truth) < 0.3
    assert "curve-crosses" in str(findings_of(taken))
    with refuses(SettingError, "no-line-there"):
        do(session, "choose", at=[10, 300])


@pytest.mark.parametrize("kind", [two_candidates, fork, double])
def test_a_refused_slice_is_settled_by_drawing(kind, tmp_path):
    session, truth = opened(kind, tmp_path)
    shaken = np.random.default_rng(5).normal(0, 1.0, truth[::60].shape)
    clicks = [*(truth[::60] + shaken).tolist(), truth[-1].tolist()]
    drawn = do(session, "draw", points=clicks)
    assert miss(curve_of(drawn), truth) < 0.3
    looked_at(drawn).approve("A. Planner")


def test_a_hidden_end_is_drawn_and_marked_as_edited(tmp_path):
    session, truth, box = opened(review_slices.hidden_end, tmp_path)
    end = curve_of(session)[-1]
    assert abs(end[0] - box[0]) < 4
    hidden = truth[truth[:, 0] > box[0] + 4]
    clicks = [end, *hidden[::15].tolist(), hidden[-1].tolist()]
    drawn = do(session, "draw", points=clicks)
    curve = np.array(curve_of(drawn))
    assert np.hypot(*(curve[-1] - truth[-1])) < 0.5
    (first, last) = drawn.state()["edited"][0][-1]
    assert last == len(curve) - 1
    assert curve[first][0] > box[0] - 3
    assert miss(curve[:first], truth) < 0.3
    fixture = looked_at(drawn).approve("A. Planner")
    assert fixture.curve.edited.sum() == sum(b - a + 1 for a, b in drawn.state()["edited"][0])
    assert (fixture.sigma[fixture.curve.edited] == 1.0).all()
    assert "placed by hand and not measured" in str(fixture.findings)


def test_a_knot_snaps_to_its_ink_and_stays_where_there_is_none(tmp_path):
    session, truth = opened(clear, tmp_path)
    knots = session.state()["knots_px"][0]
    u, v = knots[10]
    near = do(session, "move_knot", stroke=0, knot=10, to=[u + 1, v + 4])
    assert miss(curve_of(near), truth) < 0.3
    assert near.state()["edited"] == [[]]
    far = do(session, "move_knot", stroke=0, knot=10, to=[u, v + 40])
    assert np.hypot(*np.subtract(far.state()["knots_px"][0][10], [u, v + 40])) < 1.0
    assert far.state()["edited"][0]
    assert far.why_not()
    assert miss(curve_of(do(far, "delete_knot", stroke=0, knot=10)), truth) < 0.3
    cut = do(session, "cut", stroke=0, start=knots[3], end=knots[20])
    assert np.allclose(curve_of(cut)[0], knots[3], atol=1e-3)
    assert np.allclose(curve_of(cut)[-1], knots[20], atol=1e-3)
    # What was asked about an end that is cut off is settled.
    geometry = session.current.geometry
    asked = doubt("end-other-colour", "extract", "Is it?", place_px=tuple(curve_of(session)[-1]))
    whole = replace(geometry, findings=(asked,))
    assert whole.with_stroke(0, cut.current.geometry.strokes[0]).findings == ()
    assert whole.with_stroke(0, geometry.strokes[0].reversed()).findings == (asked,)


def test_two_strokes_are_joined_and_ink_is_taken(tmp_path):
    session, _ = opened(two_candidates, tmp_path)
    session = do(session, "choose", candidate=2)
    (ink,) = session.state()["account"]
    with_both = session.apply({"do": "take", "ink": ink["number"], "as": "part"})
    assert (len(with_both.state()["curve_px"]), with_both.state()["account"]) == (2, [])
    joined = do(with_both, "join", stroke=0, other=1)
    (curve,) = joined.state()["curve_px"]
    assert joined.state()["bridged"][0]
    assert joined.state()["edited"] == [[]]
    assert step_lengths(curve).max() < 2.5
    assert do(session, "leave", ink=ink["number"]).state()["account"][0]["left_out"]


def test_a_gap_between_strokes_of_the_curve_is_asked_about():
    session = Session.open(SLICE)
    curve = curve_of(session)
    cut = do(session, "cut", stroke=0, start=curve[0], end=curve[400])
    both = do(cut, "draw", points=[curve[k] for k in (428, 600, 800)], add=True)
    assert "ink-at-end" in codes_of(both)


def test_a_line_that_touches_little_ink_is_drawn():
    session = do(Session.open(SLICE), "exclude", box=[612, 585, 31, 33])
    places = [[237.495, 418.7], [275.744, 426.902], [612.017, 584.504], [399.175, 298.024]]
    drawn = do(session, "draw", points=places, replace=True)
    assert np.allclose(curve_of(drawn)[-1], places[-1], atol=0.1)


def test_strokes_that_touch_are_joined_without_a_doubled_place():
    session = Session.open(SLICE)
    for places, how in (([20, 700], [60, 702]), "replace"), (([60, 702], [100, 700]), "add"):
        session = session.apply({"do": "draw", "points": places, how: True})
    [joined] = do(session, "join", stroke=0, other=1).current.geometry.strokes
    assert step_lengths(joined.points).min() > 0.9


@pytest.mark.parametrize("gap", [40, 100, 140, 600])
def test_the_bound_of_a_join_holds_or_it_is_refused(gap):
    u = np.arange(400.0 + gap)
    wave = np.column_stack([u, 150 + 30 * np.sin(u / 50)])
    one, other = (MendedStroke.of(Stroke(half, False)) for half in (wave[:200], wave[-200:]))
    with refuses(CurveError, "gap-unknown") if gap == 600 else nullcontext():
        joined = one.join(other, None)
        assert cKDTree(joined.points).query(wave)[0].max() <= own_bound([joined]).max()


@pytest.mark.parametrize("bend", [0.0, 0.005])
def test_the_bound_of_a_join_round_a_u_turn_grows_with_the_gap_until_it_is_refused(bend):
    u, bounds = np.arange(100.0), []
    for gap in (20, 60, 100, 144, 151, 240, 600):
        legs = [np.column_stack([u, y * (gap + bend * (99 - u) ** 2) / 2]) for y in (1, -1)]
        bounds.append(np.inf)
        with suppress(CurveError):
            joined = MendedStroke.join(*(MendedStroke.of(Stroke(leg, False)) for leg in legs), None)
            bounds[-1] = own_bound([joined]).max()
            # The pen went round half a circle.
            assert 99 + gap / 2 - joined.points[:, 0].max() <= bounds[-1]
    assert bounds == sorted(bounds)
    assert max(bounds[:5]) < np.inf


def test_a_line_that_is_mostly_bare_is_told_as_unsure_as_a_hand():
    image = np.full((300, 700, 3), 99, np.uint8)
    for u, width in ((30, 3), (50, 5), (640, 3)):
        cv2.line(image, (u, 150), (u + 20, 150), (255, 0, 0), width, cv2.LINE_AA)
    path = np.linspace([30.0, 150], [660, 150], 631)
    assert SliceInk(image, "red").measure(path, False, 8.0).sigma.max() < 2 * HAND_SIGMA_PX


def test_of_too_few_markers_no_bound_is_told(sample):
    labels = [marker.label for marker in sample.current.fit.markers[2:]]
    few = after(sample, [{"do": "delete_marker", "marker": label} for label in labels]).state()
    assert (few["tre95_m"], few["refusal"]["code"]) == (None, "markers")


@pytest.mark.parametrize("kind", ["plain", "words", "crosses", "lifts", "arrow_head"])
@pytest.mark.parametrize("seed", range(2))
def test_the_account_is_that_of_extract_with_the_same_numbers(kind, seed, tmp_path):
    path = tmp_path / "slice.png"
    cv2.imwrite(str(path), slices.draw(kind.replace("_", " "), 4 * seed).image[..., ::-1])
    extracted = vfplan.extract(path)
    session = Session.open(path)
    # What the page shows, and the sheet of the bundle, which does not hold the pen's width.
    bundle = bundles.stored(tmp_path / "curve.h5", extracted.fixture)
    of_bundle = Plan.of(vfplan.read_fixture(bundle), "curve.h5", image=vfplan.read_image(path))
    width, known = attrgetter("width"), attrgetter("number", "u", "v", "pixels", "share")
    wanted = extracted.extraction
    for plan in (session.current, of_bundle):
        assert list(map(width, plan.strokes)) == list(map(width, wanted.strokes))
        assert list(map(known, plan.account)) == list(map(known, wanted.account))
    width_px = extracted.report["strokes"][0]["width_px"]
    assert f"the pen is {width_px:.1f} px wide" in dict(facts_of(of_bundle))["Line"]


def test_the_page_finds_what_plan_finds_where_another_pen_crosses_also_after_a_mend(tmp_path):
    session, truth = opened(clear, tmp_path)
    picture = cv2.imread(str(tmp_path / "slice.png"))
    for u, v in np.rint(truth[[40, 300, 560]]).astype(int):
        cv2.line(picture, (u - 15, v - 45), (u + 15, v + 45), (255, 80, 0), 3, cv2.LINE_AA)
    cv2.imwrite(str(tmp_path / "slice.png"), picture)
    extracted = vfplan.extract(tmp_path / "slice.png")
    session = Session.open(tmp_path / "slice.png")
    assert session.current.findings == extracted.findings
    assert {finding.code for finding in extracted.findings} == {"bridge"}
    u, v = session.state()["knots_px"][0][8]
    mended = do(session, "move_knot", stroke=0, knot=8, to=[u, v + 3])
    assert mended.current.findings == extracted.findings


def spatial_markers(folder, image):
    """The sample's markers for a DICOM slice: in the patient's frame, some off the slice."""
    rng = np.random.default_rng(5)
    pairs = read_markers(*MARKERS)
    place = image.T_patient_image[:3]
    normal = np.cross(place[:, 0], place[:, 1])
    normal /= np.linalg.norm(normal)
    depths = rng.uniform(-0.02, 0.02, len(pairs.labels))
    patient = np.c_[pairs.source, np.ones(len(depths))] @ place.T + depths[:, None] * normal
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    robot = patient @ turn.T + (0.4, 0.1, 0.3) + rng.normal(0, 2e-4, patient.shape)
    return slicer_files.marker_files(folder, pairs.labels, 1e3 * patient, robot)


def test_markers_of_the_patients_frame_lie_on_the_slice_and_can_be_moved(tmp_path):
    rgb = vfplan.read_image(SLICE).rgb
    path = capture(tmp_path, rgb, PixelSpacing=[0.5, 0.5], ImagePositionPatient=[10, 20, 30],
                   ImageOrientationPatient=[1, 0, 0, 0, 1, 0])  # fmt: skip
    files = spatial_markers(tmp_path, vfplan.read_image(path))
    planned = vfplan.plan(path, *files, settings=FixtureSettings(model="rigid"))
    session = looked_at(Session.open(path, *files, model="rigid"))
    state = session.state()
    assert state["refusal"] is None
    truth = read_markers(*MARKERS).source
    places = np.array([marker["place_px"] for marker in state["markers"]])
    assert np.abs(places - truth).max() < 1e-6
    assert max(abs(marker["depth_m"]) for marker in state["markers"]) > 0.01
    assert state["mm_per_px"] == pytest.approx(0.5)
    assert np.array_equal(session.current.outcome.fixture.points, planned.fixture.points)
    # A marker that is moved and moved back gives the same plan; its depth stays.
    place = state["markers"][2]["place_px"]
    wrong = do(session, "move_marker", marker="x3", to=[place[0] + 8, place[1]])
    assert wrong.state()["tre95_m"] > state["tre95_m"]
    assert wrong.state()["markers"][2]["depth_m"] == state["markers"][2]["depth_m"]
    home = do(wrong, "move_marker", marker="x3", to=place)
    assert home.state()["tre95_m"] == pytest.approx(state["tre95_m"], rel=1e-9)
    assert np.allclose(home.current.outcome.fixture.points, planned.fixture.points, atol=1e-9)
    # A bundle of such a plan is shown on its slice too.
    bundle = bundles.stored(tmp_path / "f.h5", planned.fixture)
    again = Session.open(bundle, slice=path)
    [curve] = again.state()["curve_px"]
    [drawn] = state["curve_px"]
    assert np.abs(normal_errors(np.array(curve), np.array(drawn), False)).max() < 0.05
    with pytest.raises(InputError):
        Session.open(bundle)
    with refuses(SettingError, "slice-without-place"):
        Session.open(SLICE, *files)


def test_a_curve_drawn_as_vectors_is_reviewed_on_its_slice(tmp_path):
    curve = tmp_path / "curve.csv"
    rows = [f"{u:.1f},{v:.1f}" for u, v in zip(np.linspace(200, 600, 30), 300 + 40 * np.sin(
        np.linspace(0, 3, 30)), strict=True)]  # fmt: skip
    curve.write_text("\n".join(["u_px,v_px", *rows]) + "\n")
    session = looked_at(Session.open(SLICE, *MARKERS, curve=curve))
    planned = vfplan.plan(SLICE, *MARKERS, curve=curve)
    assert np.allclose(session.current.outcome.fixture.points, planned.fixture.points, atol=1e-9)
    assert session.current.curve().sigma is None
    assert session.current.curve().provenance.inputs == planned.extracted.fixture.provenance.inputs
    assert session.state()["account"] == []
    with refuses(SettingError, "no-ink"):
        do(session, "exclude", box=[10, 10, 50, 50])
    knot = session.state()["knots_px"][0][5]
    moved = do(session, "move_knot", stroke=0, knot=5, to=[knot[0], knot[1] + 9])
    assert moved.state()["edited"][0]
    with refuses(SettingError, "curve-given-twice"):
        Session.open(tmp_path / "none.h5", curve=curve)


def test_a_curve_that_a_hand_has_shaped_counts_as_drawn_by_hand_in_a_box(tmp_path):
    session, _ = opened(clear, tmp_path)
    knots = session.state()["knots_px"][0]
    u, v = knots[4]
    shaped = do(session, "move_knot", stroke=0, knot=4, to=[u, v + 20])
    place = np.round(knots[-6])
    box = {"do": "exclude", "box": [*(place - 12), 24, 24]}
    boxed = shaped.apply(box)
    assert curve_of(boxed) == curve_of(shaped)
    [stroke], points = boxed.current.geometry.strokes, np.array(curve_of(boxed))
    assert stroke.edited[np.hypot(*(points - place).T) < 8].all()
    assert not stroke.edited[np.hypot(*(points - knots[-3]).T) < 4].any()
    whole = ",".join(f"{number:.0f}" for number in box["box"])
    assert boxed.current.curve().provenance.settings["exclude"] == whole
    # A curve that no hand has shaped is extracted anew.
    anew = session.apply(box)
    assert anew.state()["refusal"] is not None or not any(anew.state()["edited"])


def test_an_answer_dies_with_what_it_answered(sample):
    place = sample.state()["markers"][3]["place_px"]
    wrong = do(sample, "move_marker", marker="x4", to=[place[0] + 6, place[1]])
    assert not looked_at(wrong).why_not()
    worse = do(looked_at(wrong), "move_marker", marker="x4", to=[90.0, 480.0])
    assert worse.why_not()


def test_a_bundle_is_reviewed_with_and_without_its_slice(sample, tmp_path):
    path = bundles.stored(tmp_path / "f.h5", vfplan.plan(SLICE, *MARKERS).fixture)
    renamed = shutil.copy(path, tmp_path / "f.bundle")
    for slice_, bundle in ((None, renamed), (SLICE, path)):
        session = Session.open(bundle, slice=slice_)
        assert session.state()["image"]["has_slice"] == (slice_ is not None)
        assert miss(curve_of(session), TRUTH) < 0.3
        fixture = looked_at(session).approve("A. Planner")
        assert np.array_equal(fixture.points, vfplan.read_fixture(path).points)
    other, _ = clear(tmp_path / "other.png")
    with refuses(ImageError, "another-slice"):
        Session.open(path, slice=other)


@pytest.mark.parametrize(
    "other, off, code", [("x2", 5, "one-mark-two-markers"), ("x1", 40, "no-mark-near")]
)
def test_marks_are_found_one_for_each_marker_or_none(sample, other, off, code):
    places = {row["label"]: row["place_px"] for row in sample.state()["markers"]}
    place = [places[other][0] + off, places[other][1]]
    moved = do(sample, "move_marker", marker="x1", to=place)
    with refuses(SettingError, code):
        do(moved, "find_markers")


def test_a_review_without_the_slice_asks_about_that(tmp_path):
    planned = vfplan.plan(SLICE, *MARKERS).fixture
    session = Session.open(bundles.stored(tmp_path / "f.h5", planned))
    asked = [f for f in session.current.findings if f.code == "slice-not-shown"]
    assert [f.severity for f in asked] == ["doubt"]
    looked = session.apply({"do": "viewed", "stroke": 0, "from": 0.0, "to": 1.0})
    assert len(looked.why_not()) == 1
    fixture = do(looked, "answer", finding="slice-not-shown").approve("A. Planner")
    (answered,) = [f for f in fixture.findings if f.code == "slice-not-shown"]
    assert answered.answered_by == "A. Planner"
    # A changed curve is asked about too.
    moved = do(session, "move_marker", marker="x1", to=[121.0, 98.0])
    assert "slice-not-shown" in [f.code for f in moved.current.findings if f.is_open]
    kept = bundles.stored(tmp_path / "kept.h5", fixture)
    # The next review asks again, unless it shows the slice.
    codes = [f.code for f in Session.open(kept).current.findings if f.is_open]
    assert codes == ["slice-not-shown"]
    assert "slice-not-shown" not in codes_of(Session.open(kept, slice=SLICE))


KNOT = {"stroke": 0, "knot": 1}
BAD_FIELDS = {
    "fly": [{}],
    "move_knot": [
        {}, {"stroke": 5, "knot": 0, "to": [1, 1]}, {"stroke": 0, "knot": 99, "to": [1, 1]},
        {"stroke": 0, "knot": -1, "to": [1, 1]}, {"stroke": 0, "knot": True, "to": [1, 1]},
        {**KNOT, "to": [1]}, {**KNOT, "to": [float("nan"), 1]}, {**KNOT, "to": [-50, 1]},
        {**KNOT, "to": [None, 1]},
    ],
    "draw": [
        {"points": []}, {"points": [[1, 1]]}, {"points": [[1, 1], [1, 1]]},
        {"points": [[1, 1]] * 501}, {"points": [[1, 1], [9, 9]], "closed": "no"},
        {"points": [[1, 1], [9, 9]], "add": "no"},
        {"points": [[1, 1], [9, 9]], "add": True, "replace": True},
    ],
    "cut": [{"stroke": 0}, {"stroke": 0, "start": [789, 673], "end": [249, 229]}],
    "exclude": [{"box": [1, 1, 0, 0]}, {"box": [5000, 1, 9, 9]}],
    "join": [{"stroke": 0, "other": 0}], "take": [{"ink": 77}], "leave": [{"ink": 77}],
    "choose": [{"candidate": 0}, {"candidate": "1"}],
    "choose_pen": [{"colour": colour} for colour in ("no colour", "grey", "", 3, None)],
    "move_marker": [{"marker": "no", "to": [1, 1]}, {"marker": "x1"}],
    "add_marker": [{"label": "x1"}, {"label": ""}, {"label": "a\u202eb\x07"}],
    "rename_marker": [{"marker": "x1", "label": "y" * 65}, {"marker": "x1", "label": "x2"}],
    "leave_out_marker": [{"marker": "x1", "out": 1}],
    "choose_slice": [{"slice": 0}],
    "set_plan": [{"model": "bent"}, {"contact_radius": [0]}, {"pixel_spacing_mm": [0, 1]}],
    "answer": [{"finding": 99}, {"finding": "no-such-code"}],
    "viewed": [{"stroke": 0, "from": -1}, {"stroke": 9}],
}  # fmt: skip
BAD_STEPS = [{"do": name, **fields} for name, rows in BAD_FIELDS.items() for fields in rows]
BAD_STEPS += [{}, {"do": 3}, [], "x"]


@pytest.mark.parametrize("step", BAD_STEPS)
def test_a_step_that_does_not_fit_is_refused_and_changes_nothing(sample, step):
    before = json.dumps(sample.quick_state())
    with pytest.raises(SettingError) as refused:
        sample.apply(step)
    assert refused.value.code not in ("setting", "error")
    wrong = [name for name in ("closed", "add") if isinstance(step, dict) and name in step]
    assert not wrong or wrong[0] in refused.value.message
    assert json.dumps(sample.quick_state()) == before


def test_unknown_settings_are_refused():
    with pytest.raises(SettingError):
        Session.open(SLICE, speed=3)


def test_a_draft_of_other_files_or_settings_is_refused(sample, tmp_path):
    files = {"source": "0" * 64}
    path = tmp_path / "o.h5.draft.json"
    step = {"do": "reverse", "stroke": 0}
    session = sample.apply(step).apply(step).undo()
    Draft(path, files, {"model": "affine"}).keep(session)
    taken = Draft(path, files, {"model": "affine"}).take_up(sample)
    assert (text(taken), len(taken.redo().steps)) == (text(session), 2)
    for wrong in (Draft(path, {"source": "1" * 64}, {"model": "affine"}), Draft(path, files, {})):
        with refuses(InputError, "another-draft"):
            wrong.take_up(sample)
    for damage in (b"", b"[]", b"{", path.read_bytes()[:-20], b'{"steps": 3}'):
        path.write_bytes(damage)
        with pytest.raises(InputError):
            Draft(path, files, {"model": "affine"}).take_up(sample)


# Any order of steps, undo and redo.

PLACES = st.tuples(st.floats(0, 870), st.floats(0, 785)).map(list)
LINES = st.lists(PLACES, min_size=2, max_size=6)
STROKES, KNOTS, INK = (st.integers(*ends) for ends in ((0, 1), (0, 34), (1, 2)))
LABELS = st.sampled_from([f"x{k}" for k in range(1, 11)])


def a(name, **fields):
    return st.fixed_dictionaries({"do": st.just(name), **fields})


STEPS = st.one_of(
    a("move_knot", stroke=STROKES, knot=KNOTS, to=PLACES),
    a("insert_knot", at=PLACES), a("delete_knot", knot=KNOTS),
    a("draw", points=LINES, closed=st.booleans(), add=st.booleans()),
    a("cut", start=PLACES), a("cut", end=PLACES), a("join", other=st.integers(0, 2)),
    a("delete_stroke", stroke=STROKES), a("reverse", stroke=STROKES),
    a("take", ink=INK, **{"as": st.sampled_from(["curve", "part"])}),
    a("leave", ink=INK),
    a("move_marker", marker=st.sampled_from(["x1", "x5"]), to=PLACES),
    a("add_marker", label=st.sampled_from(["M1", "M2", "x1"]), at=PLACES),
    a("delete_marker", marker=LABELS), a("leave_out_marker", marker=LABELS),
    a("answer", finding=st.just(0)), a("exclude", box=st.just([0, 0, 20, 20])),
)  # fmt: skip


def check_sound(session):
    for stroke in session.current.geometry.strokes:
        count = len(stroke.points)
        assert np.isfinite(np.c_[stroke.points, stroke.sigma]).all()
        assert len(stroke.bridged) == len(stroke.edited) == count
        assert 0 <= stroke.knots[0] < stroke.knots[-1] < count
        assert stroke.closed or (stroke.knots[0], stroke.knots[-1]) == (0, count - 1)
        assert step_lengths(stroke.points).max() < 12.0, "the line is torn"


@pytest.mark.slow
@settings(max_examples=40, phases=[Phase.generate], deadline=None, derandomize=True,
          suppress_health_check=list(HealthCheck))  # fmt: skip
@given(steps=st.lists(STEPS | st.sampled_from(["undo", "redo"]), min_size=8, max_size=14))
def test_every_state_is_sound_nothing_that_was_changes_and_the_way_back_is_whole(sample, steps):
    known = lambda session: json.dumps(session.quick_state())  # noqa: E731
    session = sample
    for step in steps:
        before, shown = session, known(session)
        with suppress(SettingError):
            session = getattr(before, step)() if isinstance(step, str) else before.apply(step)
        check_sound(session)
        assert known(before) == shown
        if step == "undo" and session is not before:
            assert known(session.redo()) == shown
    session = replace(session, undone=())
    assert text(after(sample, json.loads(json.dumps(session.steps)))) == text(session)
    assert text(replace(undone(session), undone=())) == text(sample)


def test_findings_follow_the_curve_and_a_drawn_line_takes_the_place_of_what_it_overlaps(tmp_path):
    session, truth = opened(fork, tmp_path)
    half = do(session, "draw", points=truth[:250:40].tolist())
    assert "ink-joins" in codes_of(half)
    ink = max(half.state()["account"], key=lambda entry: entry["pixels"])["number"]
    left = do(half, "leave", ink=ink).current
    settled = [f for f in left.findings if f.code == "ink-joins" and not f.is_open]
    assert [f.text.partition(" joins ")[2] for f in settled] == [
        "the curve and was left out. Is it a part of it? A person left it out."
    ]
    somewhere = left.geometry.entry(ink).piece.places[0]  # as of a line that goes on there
    asked = doubt("ink-at-end", "extract", "Is it?", place_px=tuple(somewhere))
    assert left.geometry.as_settled(asked).severity == "note"
    with refuses(SettingError, "replace-or-add"):
        do(half, "draw", points=[[20, 280], [60, 290]])
    # From elsewhere, along the whole line and beyond: nothing is folded, and nothing is lost.
    whole = do(half, "draw", points=truth[::60].tolist())
    assert miss(curve_of(whole), truth) < 0.5
    assert "curve-folds" not in codes_of(whole)
    again = do(whole, "draw", points=truth[60:500:40].tolist(), add=True)
    assert "curve-folds" in codes_of(again)
    assert do(again, "delete_stroke", stroke=1).current.findings == whole.current.findings


def test_a_line_of_another_pen_is_taken_by_its_colour(tmp_path):
    path, _ = review_slices.blue(tmp_path / "blue.png")
    session = Session.open(path)
    refusal = session.state()["refusal"]
    pen = refusal["other_pen"]
    assert (refusal["code"], pen) == ("no-line", "#0000ff")
    taken = do(session, "choose_pen", colour=pen)
    wanted = Session.open(path, colour=pen)
    assert taken.state()["refusal"] is None
    assert taken.state()["curve_px"] == wanted.state()["curve_px"]
    # The file names the pen, and a box that is excluded later is measured by the same pen.
    assert taken.current.curve().provenance.settings == wanted.current.curve().provenance.settings
    box = {"do": "exclude", "box": [0, 0, 100, 200]}
    assert taken.apply(box).state()["curve_px"] == wanted.apply(box).state()["curve_px"]
    assert taken.undo().state() == session.state() | {"can_redo": True}


def test_a_photograph_is_made_flat_by_a_step_and_its_bundle_opens_flat(tmp_path):
    photo, marks, seen_by = photographed(tmp_path)
    seen = Session.open(photo, marks, MARKERS[1])
    assert seen.state()["refusal"]["code"] == "residual-large"
    assert seen.state()["at_angle"]
    flat = do(seen, "rectify")
    state = flat.state()
    assert (state["refusal"], state["at_angle"], state["image"]["is_flat"]) == (None, False, True)
    numbers = flat.current.source.recipe["made_flat_by"].split(",")
    to_flat = np.reshape(numbers[:9], (3, 3)).astype(float)
    meant = cv2.perspectiveTransform(TRUTH[None], to_flat @ seen_by)[0]
    assert miss(curve_of(flat), meant) < 0.3
    assert "picture-made-flat" in [finding["code"] for finding in state["findings"]]
    with refuses(SettingError, "rectify-first"):
        do(flat, "rectify")
    approved = looked_at(flat).approve("A. Planner")
    assert approved.provenance.inputs["image"] == seen.source.sha256["source"]
    again = Session.open(bundles.stored(tmp_path / "flat.h5", approved), slice=photo)
    assert again.state()["image"]["width_px"] == state["image"]["width_px"]
    mended = do(again, "delete_knot", stroke=0, knot=5)
    assert "picture-made-flat" in [finding["code"] for finding in mended.state()["findings"]]
    assert miss(curve_of(again), np.array(curve_of(flat))) < 0.01
    assert text(seen.apply(flat.steps[0])) == text(flat)


def test_slices_of_a_folder_lie_in_the_order_of_the_patient(tmp_path):
    session = Session.open(ct_series(tmp_path / "ct"))
    names = [one.path.stem.split("-")[::2] for one in session.source.stack]
    assert names == [["1", str(k)] for k in range(6)] + [["2", str(k)] for k in range(5)]
    turned = do(session, "choose_slice", slice=9)
    place = turned.current.source.image.T_patient_image
    assert place[2, 2] == pytest.approx(9e-3)
    with refuses(SettingError, "no-such-slice"):
        do(session, "choose_slice", slice=11)
    # Turning on is one choice, with which a review begins: nothing of it is undone.
    turned = do(session, "choose_slice", slice=2).apply(turned.steps[0])
    assert (len(turned.steps), turned.quick_state()["can_undo"]) == (1, False)
    with refuses(SettingError, "nothing-to-undo"):
        turned.undo()
    drawn = do(turned, "draw", points=[[20, 20], [100, 60], [180, 90]])
    with refuses(SettingError, "slice-drawn-on"):
        do(drawn, "choose_slice", slice=0)
    (tmp_path / "none").mkdir()
    with refuses(ImageError, "no-slices"):
        Session.open(tmp_path / "none")
    frames = np.arange(4, dtype=np.uint8)[:, None, None, None] * np.ones((1, 40, 50, 1), np.uint8)
    several = Session.open(capture(tmp_path, frames, "MONOCHROME2"))
    assert [one.frame for one in several.source.stack] == [1, 2, 3, 4]


@pytest.mark.parametrize("name, sign", [("v.nrrd", 1), ("v.nii.gz", -1), ("v.nii", 1)])
def test_a_slice_of_a_volume_lies_as_a_radiologist_looks_at_it(tmp_path, name, sign):
    nrrd, nibabel = pytest.importorskip("nrrd"), pytest.importorskip("nibabel")
    voxels = np.random.default_rng(0).integers(-1000, 2000, (40, 30, 12)).astype(np.int16)
    path, steps = tmp_path / name, np.diag([0.5, 0.6, 2.0])
    if name == "v.nrrd":
        header = {"space": "left-posterior-superior", "space directions": steps}
        nrrd.write(str(path), voxels, header | {"space origin": [1, 2, 3]})
    else:
        # NIfTI counts to the right and the front; the second file is stored the other way round.
        place = np.diag([*(-sign * steps.diagonal()[:2]), 2.0, 1.0])
        far = np.array([0.0, 0.0]) if sign > 0 else np.array([0.5 * 39, 0.6 * 29])
        place[:3, 3] = [*(-np.array([1, 2]) - far), 3]
        stored = voxels[::sign, ::sign]
        nibabel.save(nibabel.Nifti1Image(stored, place), path)
    session = Session.open(path)
    assert (len(session.source.stack), session.source.position) == (12, 6)
    image = do(session, "choose_slice", slice=4).current.source.image
    greys = voxels[:, :, 4].T.astype(float)
    share = (greys - voxels.min()) / (int(voxels.max()) - int(voxels.min()))
    assert (image.rgb[..., 0] == np.rint(65535 * share)).all()
    assert image.pixel_spacing_mm == pytest.approx((0.5, 0.6))
    expected = [[5e-4, 0, 1e-3], [0, 6e-4, 2e-3], [0, 0, 11e-3], [0, 0, 1]]
    assert np.allclose(image.T_patient_image, expected, atol=1e-8)


def test_voxels_that_are_no_numbers_turn_no_slice_black(tmp_path):
    nrrd = pytest.importorskip("nrrd")
    voxels = np.ones((20, 20, 4), np.float32)
    voxels[0, 0, 0] = np.nan
    header = {"space": "left-posterior-superior", "space directions": np.eye(3)}
    nrrd.write(str(tmp_path / "v.nrrd"), voxels, header | {"space origin": [0, 0, 0]})
    with refuses(ImageError, "volume-unsupported"):
        Session.open(tmp_path / "v.nrrd")


def test_model_distance_side_and_pixel_size_are_set_by_a_step(sample):
    fields = {"model": "similarity", "contact_radius": [4e-3], "pixel_spacing_mm": [0.5, 0.5]}
    done = do(sample, "set_plan", seen_from="above", **fields)
    planned = vfplan.plan(
        SLICE, *MARKERS, extraction=sample.source.extraction,
        settings=FixtureSettings(model="similarity", contact_radius=4e-3, seen_from="above"),
    ).fixture  # fmt: skip
    fixture = done.current.outcome.fixture
    assert np.allclose(fixture.points, planned.points, atol=1e-9)
    assert fixture.rendering.contact_radius == 4e-3
    assert fixture.provenance.inputs == planned.provenance.inputs
    mirrored = do(sample, "set_plan", seen_from="below")
    assert "--seen-from" in mirrored.state()["refusal"]["text"]
    with refuses(SettingError, "step-malformed") as refused:
        do(sample, "set_plan", contact_radius=[None])
    assert "contact_radius is [null]" in refused.value.message
    coarse = Session.open(SLICE, *MARKERS, guide_m=1e-4, arcs_m=5e-5)
    assert coarse.state()["refusal"]["code"] == "arcs-coarse"
    assert do(coarse, "set_plan", arcs_m=None).state()["refusal"] is None


@pytest.mark.slow
def test_the_bound_of_the_whole_curve_holds_with_parts_drawn_by_hand(tmp_path):
    """Clicks every 30 px, 1.5 px off; 40 lines with lifts and nine markers 0.1 mm off."""
    path, table, held = tmp_path / "slice.png", tmp_path / "m.csv", []
    places = np.array([[u, v] for u in (30, 190, 350) for v in (30, 160, 290)])
    for seed in range(40):
        rng = np.random.default_rng([seed, 7])
        slice_ = as_people_draw.draw("lifted pen", seed)
        cv2.imwrite(str(path), slice_.image[..., ::-1])
        robot = np.c_[4e-4 * places, np.zeros(9)] + rng.normal(0, 1e-4, (9, 3))
        marker_table(table, places, robot)
        clicks = slice_.truth[:: max(1, round(len(slice_.truth) / 12))]
        clicks = np.clip(clicks + rng.normal(0, 1.5, clicks.shape), 0, [379, 319]).tolist()
        drawn = {"do": "draw", "points": clicks, "replace": True}
        session = Session.open(path, table, markers_as_given=True).apply(drawn)
        reached = session.current.fit.registration.apply(session.current.geometry.strokes[0].points)
        truth = np.pad(4e-4 * polyline(slice_.truth, False, 0.25), [(0, 0), (0, 1)])
        held.append(cKDTree(truth).query(reached)[0].max() <= session.state()["tre95_m"])
    assert np.mean(held) >= 0.93


@pytest.mark.parametrize("step", ["leave_out_marker", "delete_marker"])
@pytest.mark.parametrize("settings", [{}, {"robust": True}])
def test_a_marker_left_out_by_a_step_is_told_as_robust_tells_it(sample, tmp_path, settings, step):
    pairs, odd = read_markers(*MARKERS), 'x4, "left"'
    off = pairs.target + [[0, 0, 4e-3 * (label == "x4")] for label in pairs.labels]
    markers = marker_table(tmp_path / "m.csv", pairs.source, off, pairs.labels)
    markers.write_text(markers.read_text().replace("x4", '"x4, ""left"""'))
    by_hand = Session.open(SLICE, markers, pixel_spacing_mm=0.5, **settings)
    by_hand = do(by_hand, step, marker=odd)
    planned = vfplan.plan(SLICE, markers, extraction=sample.source.extraction,
                          settings=FixtureSettings(robust=True)).fixture  # fmt: skip
    told = [[f for f in one.findings if f.code == "marker-left-out"]
            for one in (by_hand.current, planned)]  # fmt: skip
    assert told[0] == told[1] != []
    fixture = by_hand.current.fixture
    assert dict(facts_of(by_hand.current))["Markers"].startswith("8 of 9, ")
    assert [m.label for m in by_hand.current.markers if not m.is_used] == [odd]
    path = bundles.stored(tmp_path / "f.h5", fixture)
    assert "affine, 8 of 9 markers" in summary_text(describe(path, work=True))
    again = Session.open(path, slice=SLICE)
    u, v = again.quick_state()["knots_px"][0][7]
    moved = do(again, "move_knot", stroke=0, knot=7, to=[u, v + 0.5])
    assert "marker-left-out" in codes_of(moved)
    assert fixture.registration.labels == moved.current.fixture.registration.labels
