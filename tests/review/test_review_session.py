"""A review's state: what steps do, that they can be undone, and that a draft gives it again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from review_slices import clear, double, fork, hidden_end, miss, two_candidates, wave

import vfplan
from vfplan.errors import CheckFailed, ImageError, InputError, SettingError
from vfplan.review import Session
from vfplan.review.draft import Draft

ROOT = Path(__file__).parents[2]
SLICE = ROOT / "samples" / "elbow.png"
MARKERS = (ROOT / "samples/elbow_markers_image.csv", ROOT / "samples/elbow_markers_robot.csv")
TRUTH = json.loads((ROOT / "samples/elbow_truth.json").read_text())


def text(session):
    return json.dumps(session.state(), sort_keys=True)


def looked_at(session):
    """The session with every stroke in view and every doubt accepted."""
    for stroke in range(len(session.state()["curve_px"])):
        session = session.apply({"do": "viewed", "stroke": stroke, "from": 0.0, "to": 1.0})
    for number, finding in enumerate(session.state()["findings"]):
        if finding["severity"] == "doubt" and finding["answered_by"] is None:
            session = session.apply({"do": "answer", "finding": number, "by": "A. Planner"})
    return session


@pytest.fixture(scope="module")
def sample():
    return Session.open(SLICE, *MARKERS, pixel_spacing_mm=0.5)


def test_the_sample_is_approved_into_a_reviewed_fixture(sample, tmp_path):
    state = sample.state()
    assert state["refusal"] is None
    assert miss(state["curve_px"][0], np.array(TRUTH["curve_px"])) < 0.3
    assert 25 <= len(state["knots_px"][0]) <= 35
    assert not state["approvable"]
    with pytest.raises(CheckFailed) as refused:
        sample.approve("A. Planner")
    assert refused.value.code == "not-approvable"
    done = looked_at(sample)
    assert done.state()["why_not"] == []
    fixture = done.approve("A. Planner")
    assert fixture.reviewed.by == "A. Planner"
    assert len(fixture.reviewed.digest) == 64
    assert not fixture.open_findings
    vfplan.write_fixture(fixture, tmp_path / "f.h5")
    again = vfplan.read_fixture(tmp_path / "f.h5")
    assert again.reviewed == fixture.reviewed
    planned = vfplan.plan(SLICE, *MARKERS, extraction=sample.source.extraction)
    assert np.allclose(fixture.points, planned.fixture.points, atol=1e-9)


def test_the_sample_without_markers_is_approved_as_a_curve():
    session = looked_at(Session.open(SLICE))
    curve = session.approve("A. Planner")
    assert curve.frame == "image"
    assert curve.reviewed is not None
    with pytest.raises(SettingError):
        session.approve("  ")


@pytest.mark.parametrize("kind", [two_candidates, fork])
def test_a_refused_slice_is_settled_by_choosing(kind, tmp_path):
    path, truth = kind(tmp_path / "slice.png")
    session = Session.open(path)
    state = session.state()
    assert state["curve_px"] == []
    assert state["refusal"]["stage"] == "extract"
    assert len(state["candidates"]) >= 2
    with pytest.raises(SettingError):
        session.apply({"do": "choose", "candidate": len(state["candidates"]) + 1})
    misses = []
    for way in state["candidates"]:
        chosen = session.apply({"do": "choose", "candidate": way["number"]})
        for inner in chosen.state()["candidates"] if not chosen.state()["curve_px"] else []:
            deeper = chosen.apply({"do": "choose", "candidate": inner["number"]})
            misses.append(miss(deeper.state()["curve_px"][0], truth))
        if chosen.state()["curve_px"]:
            curve = chosen.state()["curve_px"][0]
            misses.append(miss(curve, truth) if len(curve) > 0.8 * np.ptp(truth[:, 0]) else 1e9)
            looked_at(chosen).approve("A. Planner")
    assert min(misses) < 0.3


@pytest.mark.parametrize("kind", [two_candidates, fork, double])
def test_a_refused_slice_is_settled_by_drawing(kind, tmp_path):
    path, truth = kind(tmp_path / "slice.png")
    session = Session.open(path)
    shaken = np.random.default_rng(5).normal(0, 1.0, truth[::60].shape)
    clicks = [*(truth[::60] + shaken).tolist(), truth[-1].tolist()]
    drawn = session.apply({"do": "draw", "points": clicks})
    assert miss(drawn.state()["curve_px"][0], truth) < 0.3
    looked_at(drawn).approve("A. Planner")


def test_a_forked_slice_is_settled_by_excluding_the_branch(tmp_path):
    path, truth = fork(tmp_path / "slice.png")
    session = Session.open(path)
    settled = session.apply({"do": "exclude", "box": [186, 104, 100, 130]})
    assert settled.state()["boxes"] == [[186, 104, 100, 130]]
    if settled.state()["curve_px"]:
        assert miss(settled.state()["curve_px"][0], truth) < 0.5


def test_a_hidden_end_is_drawn_and_marked_as_edited(tmp_path):
    path, truth, box = hidden_end(tmp_path / "slice.png")
    session = Session.open(path)
    end = session.state()["curve_px"][0][-1]
    assert abs(end[0] - box[0]) < 4
    hidden = truth[truth[:, 0] > box[0] + 4]
    clicks = [end, *hidden[::15].tolist(), hidden[-1].tolist()]
    drawn = session.apply({"do": "draw", "points": clicks})
    curve = np.array(drawn.state()["curve_px"][0])
    assert np.hypot(*(curve[-1] - truth[-1])) < 0.5
    (first, last) = drawn.state()["edited"][0][-1]
    assert last == len(curve) - 1
    assert curve[first][0] > box[0] - 3
    assert miss(curve[:first], truth) < 0.3
    fixture = looked_at(drawn).approve("A. Planner")
    assert fixture.curve.edited.sum() == sum(b - a + 1 for a, b in drawn.state()["edited"][0])
    assert (fixture.sigma[fixture.curve.edited] == 1.0).all()
    codes = [finding.code for finding in fixture.findings]
    assert "drawn-by-hand" in codes


def test_a_knot_snaps_to_its_ink_and_stays_where_there_is_none(tmp_path):
    path, truth = clear(tmp_path / "slice.png")
    session = Session.open(path)
    knots = session.state()["knots_px"][0]
    u, v = knots[10]
    near = session.apply({"do": "move_knot", "stroke": 0, "knot": 10, "to": [u + 1, v + 4]})
    assert miss(near.state()["curve_px"][0], truth) < 0.3
    assert near.state()["edited"] == [[]]
    far = session.apply({"do": "move_knot", "stroke": 0, "knot": 10, "to": [u, v + 40]})
    assert np.hypot(*np.subtract(far.state()["knots_px"][0][10], [u, v + 40])) < 1.0
    assert far.state()["edited"][0]
    assert not far.approvable
    back = far.apply({"do": "delete_knot", "stroke": 0, "knot": 10})
    assert miss(back.state()["curve_px"][0], truth) < 0.3
    cut = session.apply({"do": "cut", "stroke": 0, "start": knots[3], "end": knots[20]})
    assert np.allclose(cut.state()["curve_px"][0][0], knots[3], atol=1e-3)
    assert np.allclose(cut.state()["curve_px"][0][-1], knots[20], atol=1e-3)


def test_two_strokes_are_joined_and_ink_is_taken(tmp_path):
    path, _ = two_candidates(tmp_path / "slice.png")
    session = Session.open(path)
    session = session.apply({"do": "choose", "candidate": 2})
    (ink,) = session.state()["account"]
    with_both = session.apply({"do": "take", "ink": ink["number"], "as": "part"})
    assert len(with_both.state()["curve_px"]) == 2
    assert with_both.state()["account"] == []
    joined = with_both.apply({"do": "join", "stroke": 0, "other": 1})
    (curve,) = joined.state()["curve_px"]
    assert joined.state()["edited"][0]
    steps = np.hypot(*np.diff(np.array(curve), axis=0).T)
    assert steps.max() < 2.5
    left = session.apply({"do": "leave", "ink": ink["number"]})
    assert left.state()["account"][0]["left_out"]


def test_a_misplaced_marker_is_moved_home_and_the_bound_follows(sample):
    right = sample.state()
    place = right["markers"][3]["place_px"]
    wrong = sample.apply({"do": "move_marker", "marker": "x4", "to": [place[0] + 6, place[1]]})
    assert wrong.state()["tre95_m"] > 2 * right["tre95_m"]
    worst = max(wrong.state()["markers"], key=lambda marker: marker["residual_m"])
    assert worst["label"] == "x4"
    home = wrong.apply({"do": "move_marker", "marker": "x4", "to": place})
    assert home.state()["tre95_m"] == right["tre95_m"]
    without = wrong.apply({"do": "leave_out_marker", "marker": "x4"})
    assert without.state()["tre95_m"] < wrong.state()["tre95_m"]
    assert [m["used"] for m in without.state()["markers"]].count(False) == 1


def test_markers_are_added_renamed_deleted_and_pasted(sample):
    session = Session.open(SLICE)
    session = session.apply({"do": "set_markers", "table": sample.current.fit.table()})
    assert session.state()["tre95_m"] == pytest.approx(sample.state()["tre95_m"])
    more = session.apply({"do": "add_marker", "label": "M10", "at": [100, 100]})
    assert more.state()["markers"][-1]["target_m"] is None
    assert more.state()["tre95_m"] == session.state()["tre95_m"]
    whole = more.apply({"do": "move_marker", "marker": "M10", "target_m": [0.39, 0.11, 0.02]})
    assert whole.state()["markers"][-1]["residual_m"] is not None
    with pytest.raises(SettingError):
        more.apply({"do": "rename_marker", "marker": "M10", "label": "x1"})
    with pytest.raises(SettingError):
        session.apply({"do": "set_markers", "table": "label;u_px\n"})
    few = session
    for marker in session.state()["markers"][2:]:
        few = few.apply({"do": "delete_marker", "marker": marker["label"]})
    assert few.state()["tre95_m"] is None
    assert few.state()["refusal"]["code"] == "markers"


def test_an_answer_dies_with_what_it_answered(sample):
    place = sample.state()["markers"][3]["place_px"]
    wrong = sample.apply({"do": "move_marker", "marker": "x4", "to": [place[0] + 6, place[1]]})
    if wrong.state()["refusal"] is not None:
        pytest.skip("the gate refuses it, so there is nothing to answer")
    assert looked_at(wrong).approvable
    worse = looked_at(wrong).apply({"do": "move_marker", "marker": "x4", "to": [90.0, 480.0]})
    assert not worse.approvable


def test_a_bundle_is_reviewed_with_and_without_its_slice(sample, tmp_path):
    path = tmp_path / "f.h5"
    vfplan.write_fixture(vfplan.plan(SLICE, *MARKERS).fixture, path)
    for slice_ in (None, SLICE):
        session = Session.open(path, slice=slice_)
        assert session.state()["image"]["has_slice"] == (slice_ is not None)
        assert miss(session.state()["curve_px"][0], np.array(TRUTH["curve_px"])) < 0.3
        fixture = looked_at(session).approve("A. Planner")
        assert np.array_equal(fixture.points, vfplan.read_fixture(path).points)
    other, _ = clear(tmp_path / "other.png")
    with pytest.raises(ImageError) as refused:
        Session.open(path, slice=other)
    assert refused.value.code == "another-slice"
    moved = session.apply({"do": "move_marker", "marker": "x1", "to": [121.0, 98.0]})
    fixture = looked_at(moved).approve("A. Planner")
    assert not np.array_equal(fixture.points, vfplan.read_fixture(path).points)
    assert fixture.rendering.contact_radius == vfplan.read_fixture(path).rendering.contact_radius


BAD_STEPS = [
    {}, {"do": 3}, {"do": "fly"}, [], "x", {"do": "move_knot"},
    {"do": "move_knot", "stroke": 5, "knot": 0, "to": [1, 1]},
    {"do": "move_knot", "stroke": 0, "knot": 99, "to": [1, 1]},
    {"do": "move_knot", "stroke": 0, "knot": -1, "to": [1, 1]},
    {"do": "move_knot", "stroke": 0, "knot": 1, "to": [1]},
    {"do": "move_knot", "stroke": 0, "knot": 1, "to": [float("nan"), 1]},
    {"do": "move_knot", "stroke": 0, "knot": 1, "to": [-50, 1]},
    {"do": "move_knot", "stroke": 0, "knot": True, "to": [1, 1]},
    {"do": "draw", "points": []}, {"do": "draw", "points": [[1, 1]]},
    {"do": "draw", "points": [[1, 1], [1, 1]]}, {"do": "draw", "points": [[1, 1]] * 501},
    {"do": "draw", "points": [[1, 1], [9, 9]], "closed": "no"},
    {"do": "cut", "stroke": 0}, {"do": "cut", "stroke": 0, "start": [789, 673], "end": [249, 229]},
    {"do": "exclude", "box": [1, 1, 0, 0]}, {"do": "exclude", "box": [5000, 1, 9, 9]},
    {"do": "join", "stroke": 0, "other": 0}, {"do": "take", "ink": 77}, {"do": "leave", "ink": 77},
    {"do": "choose", "candidate": 0}, {"do": "move_marker", "marker": "no", "to": [1, 1]},
    {"do": "move_marker", "marker": "x1"}, {"do": "add_marker", "label": "x1"},
    {"do": "add_marker", "label": ""}, {"do": "add_marker", "label": "a\u202eb\x07"},
    {"do": "rename_marker", "marker": "x1", "label": "y" * 65},
    {"do": "leave_out_marker", "marker": "x1", "out": 1}, {"do": "set_markers", "table": 3},
    {"do": "answer", "finding": 99}, {"do": "answer", "finding": "no-such-code"},
    {"do": "viewed", "stroke": 0, "from": -1}, {"do": "viewed", "stroke": 9},
]  # fmt: skip


@pytest.mark.parametrize("step", BAD_STEPS)
def test_a_step_that_does_not_fit_is_refused_and_changes_nothing(sample, step):
    before = json.dumps(sample.quick_state())
    with pytest.raises(SettingError) as refused:
        sample.apply(step)
    assert refused.value.code not in ("setting", "error")
    assert json.dumps(sample.quick_state()) == before


def test_unknown_settings_and_files_are_refused(tmp_path):
    with pytest.raises(SettingError):
        Session.open(SLICE, speed=3)
    with pytest.raises(ImageError):
        Session.open(tmp_path / "none.png")
    with pytest.raises(SettingError):
        Session.open(SLICE, slice=SLICE)


def test_a_draft_of_other_files_or_settings_is_refused(sample, tmp_path):
    files = {"source": SLICE}
    path = tmp_path / "o.h5.draft.json"
    session = sample.apply({"do": "reverse", "stroke": 0})
    Draft(path, files, {"model": "affine"}).keep(session)
    taken = Draft(path, files, {"model": "affine"}).take_up(sample)
    assert text(taken) == text(session)
    for wrong in (Draft(path, {"source": MARKERS[0]}, {"model": "affine"}), Draft(path, files, {})):
        with pytest.raises(InputError) as refused:
            wrong.take_up(sample)
        assert refused.value.code == "another-draft"
    for damage in (b"", b"[]", b"{", path.read_bytes()[:-20], b'{"steps": 3}'):
        path.write_bytes(damage)
        with pytest.raises(InputError):
            Draft(path, files, {"model": "affine"}).take_up(sample)


# A stateful machine: any order of steps, undo and redo.

PLACES = st.tuples(st.floats(0, 870), st.floats(0, 785)).map(list)
STEPS = st.one_of(
    st.fixed_dictionaries(
        {"do": st.just("move_knot"), "stroke": st.integers(0, 1), "knot": st.integers(0, 34),
         "to": PLACES}),
    st.fixed_dictionaries({"do": st.just("insert_knot"), "at": PLACES}),
    st.fixed_dictionaries({"do": st.just("delete_knot"), "knot": st.integers(0, 34)}),
    st.fixed_dictionaries(
        {"do": st.just("draw"), "points": st.lists(PLACES, min_size=2, max_size=6),
         "closed": st.booleans(), "add": st.booleans()}),
    st.fixed_dictionaries({"do": st.just("cut"), "start": PLACES}),
    st.fixed_dictionaries({"do": st.just("cut"), "end": PLACES}),
    st.fixed_dictionaries({"do": st.just("join"), "other": st.integers(0, 2)}),
    st.fixed_dictionaries({"do": st.just("delete_stroke"), "stroke": st.integers(0, 1)}),
    st.fixed_dictionaries({"do": st.just("reverse"), "stroke": st.integers(0, 1)}),
    st.fixed_dictionaries({"do": st.just("take"), "ink": st.integers(1, 2),
                           "as": st.sampled_from(["curve", "part"])}),
    st.fixed_dictionaries({"do": st.just("leave"), "ink": st.integers(1, 2)}),
    st.fixed_dictionaries({"do": st.just("move_marker"), "marker": st.sampled_from(["x1", "x5"]),
                           "to": PLACES}),
    st.fixed_dictionaries({"do": st.just("add_marker"),
                           "label": st.sampled_from(["M1", "M2", "x1"]), "at": PLACES}),
    st.fixed_dictionaries({"do": st.just("delete_marker"), "marker": st.integers(0, 9)}),
    st.fixed_dictionaries({"do": st.just("leave_out_marker"), "marker": st.integers(0, 9)}),
    st.fixed_dictionaries({"do": st.just("viewed"), "stroke": st.integers(0, 1),
                           "from": st.floats(0, 0.5), "to": st.floats(0.5, 1)}),
)  # fmt: skip


class Review(RuleBasedStateMachine):
    """Every state is sound, nothing that was is changed, and the way back is whole."""

    begun = None

    @initialize()
    def begin(self):
        if Review.begun is None:
            Review.begun = Session.open(SLICE, *MARKERS, pixel_spacing_mm=0.5)
        self.session = Review.begun
        self.before = json.dumps(self.session.quick_state())

    @rule(step=STEPS)
    def step(self, step):
        before = json.dumps(self.session.quick_state())
        try:
            session = self.session.apply(step)
        except SettingError:
            assert json.dumps(self.session.quick_state()) == before
            return
        assert json.dumps(self.session.quick_state()) == before
        self.session = session

    @precondition(lambda self: self.session.steps)
    @rule()
    def undo_and_redo(self):
        there = json.dumps(self.session.quick_state())
        back = self.session.undo()
        assert json.dumps(back.redo().quick_state()) == there
        self.session = back

    @precondition(lambda self: self.session.undone)
    @rule()
    def redo(self):
        self.session = self.session.redo()

    @invariant()
    def is_sound(self):
        if not hasattr(self, "session"):
            return
        for stroke in self.session.current.geometry.strokes:
            count = len(stroke.points)
            assert np.isfinite(stroke.points).all()
            assert np.isfinite(stroke.sigma).all()
            for flags in (stroke.sigma, stroke.bridged, stroke.edited, stroke.viewed):
                assert len(flags) == count
            assert len(stroke.knots) >= 2
            assert (np.diff(stroke.knots) > 0).all()
            assert stroke.knots[0] >= 0
            assert stroke.knots[-1] < count
            if not stroke.closed:
                assert (stroke.knots[0], stroke.knots[-1]) == (0, count - 1)
            steps = np.hypot(*np.diff(stroke.points, axis=0).T)
            assert steps.max() < 12.0, "the line is torn"

    def teardown(self):
        if not hasattr(self, "session"):
            return
        steps = json.loads(json.dumps(self.session.steps))
        again = Review.begun
        for step in steps:
            again = again.apply(step)
        assert json.dumps(again.quick_state()) == json.dumps(
            {**self.session.quick_state(), "can_redo": False}
        )
        session = self.session
        while session.steps:
            session = session.undo()
        state = {**session.quick_state(), "can_redo": False}
        assert json.dumps(state) == self.before


Review.TestCase.settings = settings(
    max_examples=25,
    phases=[Phase.generate],
    stateful_step_count=14,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)
TestReview = pytest.mark.slow(Review.TestCase)


def test_undo_of_everything_returns_the_whole_first_state(sample):
    session = sample
    for step in (
        {"do": "move_knot", "stroke": 0, "knot": 5, "to": [300.0, 300.0]},
        {"do": "move_marker", "marker": "x2", "to": [430.0, 66.0]},
        {"do": "viewed"},
        {"do": "answer", "finding": 0, "by": "A. Planner"},
        {"do": "exclude", "box": [0, 0, 20, 20]},
        {"do": "draw", "points": wave().tolist()[::100]},
    ):
        session = session.apply(step)
    again = sample
    for step in session.steps:
        again = again.apply(step)
    assert text(again) == text(session)
    while session.steps:
        session = session.undo()
    assert {**session.state(), "can_redo": False} == sample.state()
