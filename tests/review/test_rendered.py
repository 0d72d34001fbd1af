"""What is rendered is shown: each value that the engine uses changes the sheet, and its outline."""

from __future__ import annotations

from dataclasses import replace

import bundles
import numpy as np
import pytest
from drawing import distance_to_line
from review_slices import MARKERS, SLICE
from scipy.spatial import cKDTree

import vfplan
from vfplan import PlannedImage
from vfplan.fixture import Guidance, StabilityVerdict
from vfplan.planning.settings import FixtureSettings
from vfplan.review import paper
from vfplan.review.plan import Plan
from vfplan.review.rendered import described, in_one_line, onto_plane, outlines_of, rendered_in_json
from vfplan.review.session import Session
from vfplan.review.sheet import draw_sheet, facts_of, verdict_of

ASIDE = np.array([0.03, 0.0, 0.0])
TILTED = np.array([0.0, np.sqrt(0.75), -0.5])
VERDICT = StabilityVerdict("arm", 2.0, 5.0, 1000.0, 2, 1000.0, 2500.0, 1.2)


@pytest.fixture(scope="module")
def made():
    """The five kinds of bundle, and the slice of those that were drawn on one."""
    guide = FixtureSettings(guide_m=2e-3, guide_pull=(3.0,))
    planned = [vfplan.plan(SLICE, *MARKERS, settings=s).fixture for s in (None, guide)]
    mesh = bundles.sheet()
    return dict(zip(("curve", "guide"), planned, strict=True)) | {
        "mesh": mesh, "cloud": bundles.patient(), "surface": replace(mesh, sample_radius=5e-4),
    }  # fmt: skip


def rendering(fixture, **changes):
    return replace(fixture, rendering=replace(fixture.rendering, **changes))


def guidance(fixture, **changes):
    return fixture.guidance and replace(fixture, guidance=replace(fixture.guidance, **changes))


def pieces(fixture, change):
    return fixture.pieces and replace(fixture, curve=replace(fixture.curve, pieces=change))


def aside(fixture):
    """The whole plan elsewhere in front of the robot: line, pieces and markers."""
    fixture = replace(fixture, points=fixture.points + ASIDE)
    fixture = CHANGES["pieces aside"](fixture) or fixture
    record = fixture.registration
    if record is None:
        return fixture
    T = record.T_robot_image.copy()
    T[:3, -1] += ASIDE
    target = record.target + ASIDE
    return replace(fixture, registration=replace(record, T_robot_image=T, target=target))


CHANGES = {
    "K": lambda f: rendering(f, stiffness=4 * f.stiffness),
    "K of one axis": lambda f: rendering(f, stiffness=f.stiffness * (1, 1, 0.5)),
    "R": lambda f: rendering(f, contact_radius=f.contact_radius + 5e-4),
    "points' radius": lambda f: rendering(f, point_radius=2e-4),
    "band": lambda f: rendering(f, band=3e-3),
    "iterations": lambda f: rendering(f, max_iterations=1),
    "no axis": lambda f: None if f.ignore_axis is None else rendering(f, ignore_axis=None),
    "tilted axis": lambda f: None if f.ignore_axis is None else rendering(f, ignore_axis=TILTED),
    "points aside": lambda f: None if f.pieces else replace(f, points=f.points + ASIDE),
    "plan aside": aside,
    "pieces aside": lambda f: f.pieces and pieces(
        f, replace(f.pieces, vertices=f.pieces.vertices + ASIDE)),
    "no pieces": lambda f: pieces(f, None),
    "straight pieces": lambda f: f.pieces and pieces(
        f, replace(f.pieces, bulges=20 * f.pieces.bulges)),
    "a triangle less": lambda f: None if f.mesh is None else replace(f, mesh=f.mesh[1:]),
    "no triangles": lambda f: None if f.mesh is None else replace(f, mesh=None, sample_radius=None),
    "samples": lambda f: None if f.mesh is None else replace(f, sample_radius=3e-4),
    "frame": lambda f: None if f.registration else replace(f, frame="patient_lps"),
    "tube": lambda f: guidance(f, radius=5e-4),
    "K of the tube": lambda f: guidance(f, stiffness=5000.0),
    "pull": lambda f: guidance(f, lead_force=30.0),
    "pull back": lambda f: guidance(f, lead_force=-3.0),
    "no pull": lambda f: guidance(f, lead_force=None),
    "speed": lambda f: guidance(f, lead_speed=0.05),
    "ends": lambda f: guidance(f, ends="open"),
    "no guide": lambda f: f.guidance and replace(f, guidance=None),
    "a guide": lambda f: None if f.curve is None else replace(f, guidance=Guidance(3e-3, 1000.0)),
    "verdict": lambda f: replace(f, stability=VERDICT),
    "unstable": lambda f: replace(f, stability=replace(VERDICT, k_max_n_per_m=900.0)),
}  # fmt: skip


def words(shown):
    return str((verdict_of(shown), described(shown.fixture), facts_of(shown)))


def drawn(shown):
    """A sheet without its foot, where the digest stands."""
    return draw_sheet(shown).pixels[:-100]


@pytest.mark.parametrize("has_slice", [False, True])
@pytest.mark.parametrize("name", ["curve", "guide", "mesh", "cloud", "surface"])
def test_each_rendered_value_shows_on_the_sheet(name, has_slice, made):
    if has_slice and name not in ("curve", "guide"):
        pytest.skip("it was not drawn on a slice")
    fixture, image = made[name], vfplan.read_image(SLICE) if has_slice else None
    before = Plan.of(fixture, "f.h5", image=image)
    changed = {change: make(fixture) for change, make in CHANGES.items()}
    changed = {change: after for change, after in changed.items() if after is not None}
    assert len(changed) >= 10
    for change, after in changed.items():
        shown = Plan.of(after, "f.h5", image=image)
        # The picture where the words may stay what they are.
        show = drawn if change == "straight pieces" else words
        assert not np.array_equal(show(shown), show(before)), change
        if change not in ("verdict", "unstable"):
            assert rendered_in_json(after) != rendered_in_json(fixture), change


@pytest.mark.parametrize("name, reach", [("curve", 5e-3), ("guide", 2e-3)])
def test_the_outline_lies_where_the_engine_pushes(name, reach, made):
    fixture = made[name]
    T = fixture.registration.T_robot_image
    moved = CHANGES["pieces aside"](fixture)
    # A slice at whose upper left border the line lies.
    places_px = onto_plane(T)(fixture.points)
    cropped = T @ np.column_stack([np.eye(3)[:, :2], [*places_px.min(axis=0), 1]])
    truths = (fixture, fixture.points, T), (moved, fixture.points + ASIDE, T)
    for rendered, truth, plane in (*truths, (fixture, fixture.points, cropped)):
        [outline] = outlines_of(rendered, plane, (871, 786))
        line = np.vstack(outline.lines)
        assert all(np.allclose(one[0], one[-1], atol=1e-3) for one in outline.lines)
        places = np.pad(line, ((0, 0), (0, 1)), constant_values=1.0) @ plane.T
        assert np.abs(distance_to_line(places, truth) - reach).max() < 0.03e-3
        # It leads round both ends, so that nothing of the line is left out.
        assert distance_to_line(truth, places).max() < 1.01 * reach
        assert (outline.pull is not None) == (name == "guide") == (outline.kind == "guide")
    if name == "guide":
        # A tube with open ends has no caps.
        [outline] = outlines_of(CHANGES["ends"](fixture), T, (871, 786))
        assert len(outline.lines) == 2


@pytest.mark.parametrize("name", ["curve", "guide", "guide without pull", "whole"])
def test_the_picture_shows_the_outline_at_the_ends_too_and_the_legend_what_is_there(name, made):
    plans = {"whole": bundles.whole(), "guide without pull": CHANGES["no pull"](made["guide"])}
    image = vfplan.read_image(SLICE)
    if name == "whole":
        image = PlannedImage(np.zeros((786, 871, 3), np.uint8), None, "ab" * 32)
    shown = Plan.of((made | plans)[name], "f.h5", image)
    sheet, [outline] = draw_sheet(shown), shown.outlines
    [box] = [box for box in sheet.boxes if box.kind == "picture"]
    picture = sheet.pixels[box.y : box.bottom, box.x : box.right].astype(int)
    colour = paper.WALL_COLOUR if outline.kind == "wall" else paper.GUIDE_COLOUR
    drawn = cKDTree(np.argwhere(np.abs(picture - colour).sum(axis=2) < 100)[:, ::-1])
    line, zoom = np.vstack(outline.lines), box.width / image.width_px
    for end in np.vstack([stroke.points[[0, -1]] for stroke in shown.strokes]):
        near = line[np.hypot(*(line - end).T) < 16]
        # A leader leads to the end.
        assert (drawn.query((near + 0.5) * zoom - 0.5)[0] < 2).mean() > 0.8
    words = " ".join(box.words for box in sheet.boxes)
    assert ("arrow: the guide's pull" in words) == (name == "guide")
    assert (" green tube, blue line" in words) == (outline.kind == "guide")
    not_used = "Wall: none; the wall's 5.00 mm and 1000 N/m are not used"
    assert (not_used in words) == (outline.kind == "guide")


def test_a_session_and_one_line_say_what_is_rendered(made):
    assert in_one_line(made["curve"]) == "wall, 1000 N/m, 5.00 mm, along z; approved by nobody"
    assert in_one_line(bundles.reviewed()).endswith("approved by A. Planner")
    session = Session.open(SLICE, *MARKERS, guide_m=2e-3)
    state = session.state()
    assert state["rendered"] == rendered_in_json(session.current.outcome.fixture)
    assert state["rendered"]["kind"] == "guide"
    assert Session.open(SLICE).state()["outline_px"] == []
