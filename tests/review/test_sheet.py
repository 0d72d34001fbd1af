"""The review sheet: a covered end is plain to see, and no caption collides."""

from __future__ import annotations

import re
from dataclasses import replace
from io import BytesIO
from itertools import combinations, pairwise

import bundles
import cv2
import drawn_ends
import numpy as np
import pytest
from captures import capture
from drawing import blend, coverage, flat, to_uint8
from PIL import Image
from refusals import refuses
from review_slices import MARKERS, SLICE
from vector_files import RING_MM, polyline, slicer

import vfplan
from vfplan import PlannedImage
from vfplan.curve.account import AccountEntry
from vfplan.display import isolated
from vfplan.errors import InputError
from vfplan.findings import doubt, note
from vfplan.fixture import Stroke
from vfplan.planning.extraction import extract
from vfplan.review.markers import Marker
from vfplan.review.paper import (
    BAND_COLOUR,
    BODY,
    BRIDGE_COLOUR,
    CONTENT_WIDTH,
    DPI,
    FOOT,
    GUIDE_COLOUR,
    HEADING,
    INSET_PX,
    LINE_COLOUR,
    PAGE_HEIGHT,
    PAGE_WIDTH,
    STRONG,
    WALL_COLOUR,
    Paper,
    shortened,
)
from vfplan.review.picture import AHEAD_RADIUS, FREE_RADIUS
from vfplan.review.plan import Plan
from vfplan.review.rendered import Outline, check_slice
from vfplan.review.session import Session
from vfplan.review.sheet import ZOOM, draw_sheet, facts_of, png_of, verdict_of

RED = (255, 0, 0)
BLANK = np.zeros((320, 380, 3), np.uint8)


def drawn_part(sheet, box):
    """The pixels of a box on the sheet."""
    top = box.page * PAGE_HEIGHT + box.y
    return sheet.pixels[top : top + box.height, box.x : box.x + box.width]


def is_coloured(sheet, box, colour):
    """(H, W) where a box of the sheet has nearly this colour."""
    return np.abs(drawn_part(sheet, box).astype(int) - colour).sum(axis=2) < 60


def words_of(sheet):
    return [box.words for box in sheet.boxes if box.kind == "text"]


def picture_of(sheet):
    return next(box for box in sheet.boxes if box.kind == "picture")


def insets(sheet, words):
    return [b for b in sheet.boxes if b.kind == "inset" and b.words.startswith(words)]


def overlap(one, other):
    across = one.x < other.right and other.x < one.right
    return one.page == other.page and across and one.y < other.bottom and other.y < one.bottom


def checked(shown):
    """The sheet: no two texts overlap, none covers an inset, and all stand on the paper."""
    sheet = draw_sheet(shown)
    assert (sheet.pixels.shape[1:], sheet.pixels.shape[0] % PAGE_HEIGHT) == ((PAGE_WIDTH, 3), 0)
    for one, other in combinations(sheet.boxes, 2):
        # A caption may stand on the slice itself.
        assert {one.kind, other.kind} == {"text", "picture"} or not overlap(one, other)
    for box in sheet.boxes:
        assert 0 <= box.x <= box.right <= PAGE_WIDTH, box
        assert 0 <= box.y <= box.bottom <= PAGE_HEIGHT, box
    return sheet


def line_of(points, *, bridged=None):
    points = np.asarray(points, float)
    return Stroke(points, False, np.full(len(points), 0.1), bridged, width=3.0)


STRAIGHT, BEYOND = line_of(np.linspace((60, 160), (300, 160), 241)), np.arange(241) > 120


# ---- a covered end ----


@pytest.mark.parametrize("covered", ["start", "end"])
@pytest.mark.parametrize("seed", range(5))
def test_covered_end_is_plain_to_see_in_its_inset(seed, covered):
    drawn = drawn_ends.draw(seed, covered=covered, tone=(0, 255, 40, 200, 60)[seed])
    sheet = draw_sheet(drawn_ends.shown(drawn))
    [inset, _] = insets(sheet, covered.capitalize())
    assert (inset.width, inset.height, inset.zoom) == (INSET_PX, INSET_PX, ZOOM)
    assert INSET_PX / DPI * 25.4 >= 40  # millimetres in print

    # Each pixel of the slice is a square of 8 x 8 equal pixels: nothing is drawn over it.
    u, v, width, height = inset.window
    squares = drawn_part(sheet, inset).reshape(height, ZOOM, width, ZOOM, 3).swapaxes(1, 2)
    around = np.pad(drawn.image + 1.0, ((height, height), (width, width), (0, 0))) - 1
    wanted = around[v + height :, u + width :][:height, :width]
    is_there = wanted[:, :, 0] >= 0
    assert (squares[is_there] == wanted[is_there][:, None, None]).all()


def test_box_of_the_grey_around_it_shows_as_even_among_noise():
    drawn = drawn_ends.draw(3, covered="end", tone=110)
    u, v, width, height = drawn.box
    sheet = draw_sheet(drawn_ends.shown(drawn))
    [_, wider] = insets(sheet, "End")
    seen = drawn_part(sheet, wider)[:: wider.zoom, :: wider.zoom].astype(float)
    left, top = u - wider.window[0], v - wider.window[1]
    inside = seen[max(top, 0) : top + height, max(left, 0) : left + width, 1]
    beside = seen[max(top, 0) : top + height, left - 12 : left - 2, 1]
    assert inside.std() < 1
    assert beside.std() > 20


def test_nothing_covers_the_ends_on_the_picture_itself():
    drawn = drawn_ends.draw(1, covered="")
    plain = draw_sheet(drawn_ends.shown(drawn))
    picture = picture_of(plain)
    zoom = picture.width / drawn.image.shape[1]
    size = picture.width, picture.height
    bare = cv2.resize(drawn.image, size, interpolation=cv2.INTER_NEAREST)
    changed = (drawn_part(plain, picture) != bare).any(axis=2)
    rows, columns = np.indices(changed.shape)
    for u, v in (drawn.line[[0, -1]] + 0.5) * zoom - 0.5:
        away = np.hypot(columns - u, rows - v)
        # A thin line leads from the caption to the end; it stops 8 px before it.
        assert changed[away < FREE_RADIUS - 4].mean() <= 0.15
        assert not changed[away < 6].any()


@pytest.mark.parametrize("patch", [None, 255])
def test_cover_of_the_grey_around_it_is_told_in_words(patch):
    """A line that ends on white bone; under the patch it goes on, or it ends there."""
    line = np.column_stack([np.linspace(40, 150, 221), np.full(221, 120.0)])
    picture = flat((240, 300), 90.0)
    cv2.rectangle(picture, (100, 60), (260, 180), (255.0,) * 3, -1)
    picture = to_uint8(blend(picture, coverage(picture.shape[:2], line, 3.0), RED)).copy()
    if patch is not None:
        picture[100:140, 140:220] = patch
        line = line[line[:, 0] < 139.5]
    words = words_of(checked(drawn_ends.shown_of(picture, line_of(line))))
    # The ground at the start is even too.
    assert words.count("one grey ahead: look twice") == 2


@pytest.mark.parametrize("seed", range(16))
def test_ink_and_covers_of_ends_stay_visible_and_no_captions_overlap_on_random_slices(seed):
    """Nor do many captions lie on the wall."""
    rng = np.random.default_rng([seed, 1])
    drawn = drawn_ends.draw(seed, covered=["", "start", "end"][seed % 3])
    shape = drawn.image.shape
    findings = [
        (note if k % 3 else doubt)("a-code", "extract", "Look here. " * (k + 1),
                                   place_px=tuple(rng.uniform(0, 300, 2)))
        for k in range(int(rng.integers(0, 9)))
    ]  # fmt: skip
    markers = drawn_ends.markers(rng, shape, int(rng.integers(4, 41)))
    account = drawn_ends.account(rng, shape, int(rng.integers(0, 30)))
    more = {"findings": tuple(findings), "metres_per_px": 5e-4, "side": "above (robot +z)"}
    more["outlines"] = (Outline("wall", (drawn.line - [0, 12], drawn.line - [0, -12])),)
    sheet = checked(drawn_ends.shown(drawn, markers=markers, account=account, **more))
    # Captions, outlines and arrows leave the middle of the ink as it is, but where a marker or its
    # arrow lies on the line.
    picture = picture_of(sheet)
    zoom = picture.width / shape[1]
    at = np.rint((drawn.line + 0.5) * zoom - 0.5).astype(int)
    seen = drawn_part(sheet, picture)[at[:, 1], at[:, 0]]
    columns, rows = np.rint(drawn.line).astype(int).T
    is_ink = drawn.image[rows, columns] @ [1, -1, 0] > 150
    is_seen = seen @ [1, -1, 0] > 60
    assert is_seen[is_ink].mean() > 0.85
    # No caption lies on the line, nor ahead of an end, where its cover is.
    ends = (drawn.line[[0, -1]] + 0.5) * zoom - 0.5
    ahead = drawn.line[[0, -1]] - drawn.line[[8, -9]]
    centres = ends + AHEAD_RADIUS * ahead / np.hypot(*ahead.T)[:, None]
    captions = [b for b in sheet.boxes if b.kind == "text" and overlap(b, picture)]
    on_wall, at = 0, np.vstack([at, at - [0, 12 * zoom], at - [0, -12 * zoom]])
    for box in captions:
        frame = np.array([[box.x, box.y], [box.right, box.bottom]]) - (picture.x, picture.y)
        covered = (at == at.clip(*frame)).all(axis=1)
        assert not covered[: len(drawn.line)].any(), box.words
        on_wall += covered.any()
        away = np.hypot(*(centres.clip(*frame) - centres).T)
        assert (away >= AHEAD_RADIUS - 1).all(), box.words
    assert on_wall <= 2


# ---- what a sheet shows ----


@pytest.fixture(scope="module")
def planned_sheet():
    """What the sheet of the sample shows with a margin and other ink: the longest column."""
    planned = vfplan.plan(SLICE, *MARKERS, settings=vfplan.FixtureSettings(margin="tre95"))
    other_ink = AccountEntry(1, 239.0, 296.0, 412, 0.175, 30.0, "ink")
    return drawn_ends.with_values(
        Plan.of(planned.fixture, "elbow.h5", planned.extracted.image), account=(other_ink,)
    )


@pytest.mark.parametrize("count, pages", [(0, 1), (1, 1), (6, 2)])
def test_a_sheet_without_findings_is_one_page(count, pages, planned_sheet):
    text = "Number {}. Look at the place, and accept it or cut the curve there."
    findings = [doubt("ink-touches", "plan", text.format(k), place_px=(300.0 + 90 * k, 300.0))
                for k in range(count)]  # fmt: skip
    sheet = checked(drawn_ends.with_values(planned_sheet, findings=tuple(findings)))
    assert len(sheet.page_pngs()) == pages
    # Heading, heads and texts stand together; all heads begin in the same column.
    texts = [box for box in sheet.boxes if box.kind == "text"]
    [heading] = [box for box in texts if box.words.startswith("Findings")]
    heads = [box for box in texts if box.words.startswith("#") and "wants an answer" in box.words]
    assert len(heads) == count
    assert {(box.page, box.x) for box in heads} <= {(heading.page, heading.x)}
    # A list that goes on in another column has its heading there too.
    of_lists = texts[texts.index(heading) : -2 * pages]
    for box, after in pairwise(of_lists):
        is_near = (after.page, after.x) == (box.page, box.x) or after.y - box.y < 40
        assert is_near or after.style == HEADING or after.words.endswith("continued"), after.words


@pytest.mark.parametrize("count, pieces", [(0, 0), (4, 11), (5, 9), (8, 3), (9, 0)])
def test_no_line_stands_alone_on_a_page(count, pieces):
    finding = doubt("width-changes", "extract", "Is all of it the curve?", place_px=(300.0, 300.0))
    ink = tuple(AccountEntry(k + 1, 200.0, 296.0, 12, 0.1, 30.0, "ink") for k in range(pieces))
    more = {"metres_per_px": 5e-4, "findings": (finding,) * count, "account": ink}
    sheet = checked(drawn_ends.shown(drawn_ends.draw(2, covered=""), **more))
    lines = [box for box in sheet.boxes if box.kind == "text" and box.y < FOOT]
    for box, after in pairwise(lines):
        if box.style == HEADING and not box.words.endswith("none"):
            assert box.page == after.page, box.words
    for page in range(len(sheet.page_pngs())):
        assert sum(box.page == page for box in lines) != 1


def test_an_arrow_near_the_border_begins_at_its_marker():
    """The residual's arrow at half the length, and the whole arrow of a guide's pull."""
    line = line_of([[100, 100], [200, 100]])
    near = Marker("a", (60.0, 20.0), residual_m=1e-3, residual_px=(0.0, -0.3))
    outline = Outline("guide", (line.points,), (np.array([375.0, 100]), np.array([1.0, 0])))
    sheet = checked(drawn_ends.shown_of(BLANK, line, markers=(near,), outlines=(outline,)))
    assert "in the slice, drawn 50 times as long" in " ".join(words_of(sheet))
    seen = drawn_part(sheet, picture_of(sheet)).astype(int)
    zoom = seen.shape[1] / BLANK.shape[1]
    above = seen[: round(20 * zoom), round(60.5 * zoom)].sum(axis=1)
    assert abs(np.flatnonzero(above)[0] - (20.5 - 0.3 * 50) * zoom) < 6
    greens = np.argwhere(np.abs(seen - GUIDE_COLOUR).sum(axis=2) < 30)[:, 1]
    assert seen.shape[1] - 20 < greens.max() < seen.shape[1] - 3


def test_both_outlines_show_at_one_distance_and_a_bar_is_as_long_as_it_says():
    line = replace(STRAIGHT, bridged=BEYOND)
    wall = Outline("wall", (line.points - [0, -4.06], line.points - [0, 4.06]))
    sheet = checked(drawn_ends.shown_of(BLANK, line, outlines=(wall,)))
    picture = picture_of(sheet)
    for colour in (LINE_COLOUR, BRIDGE_COLOUR, WALL_COLOUR):
        assert is_coloured(sheet, picture, colour).any(axis=0).sum() > 200
    [words] = [box for box in sheet.boxes if box.words == "50 px"]
    bar = sheet.pixels[round(words.y) + 15, : round(words.x), 0] < 99
    assert abs(bar.sum() - 50 * picture.width / 380) < 1


def test_names_with_one_beginning_differ_and_a_letter_without_font_is_told():
    shown = [shortened(f"{'lateral epicondyle ' * 9}{k}", 200.0, STRONG) for k in "12\u6a19"]
    assert len(set(shown)) == 3
    assert shown[2].endswith("6A19]")


def test_a_number_that_rounds_to_zero_has_no_sign():
    fixture = bundles.sheet()
    rendering = replace(fixture.rendering, ignore_axis=np.array([-1e-9, 0.0, 1.0]))
    shown = Plan.of(replace(fixture, points=fixture.points - 1e-7, rendering=rendering), "f.h5")
    words = " ".join(words_of(draw_sheet(shown)))
    assert "(0.0000, 0.0000, 1.0000)" in words
    assert "x 0.00 to" in words


def test_sheet_page_and_report_say_one_bound_and_the_margin_that_was_added(tmp_path):
    planned = vfplan.plan(SLICE, *MARKERS, settings=vfplan.FixtureSettings(margin="tre95+0.2"))
    bound_m = planned.registered.report["tre"]["curve95_max_m"]
    path = bundles.stored(tmp_path / "f.h5", planned.fixture)
    fixture = vfplan.read_fixture(path)
    shown = Plan.of(fixture, "f.h5", planned.extracted.image)
    page = Session.open(path, slice=SLICE).state()["tre95_m"]
    told = (shown.bound95_m, page, shown.margin_m - 2e-4)
    assert told == pytest.approx([bound_m] * 3, abs=2e-9)
    assert fixture.point_radius == pytest.approx(shown.margin_m, abs=1e-12)


def test_terminal_and_sheet_say_one_length_and_what_a_pixel_is(tmp_path, vfplan_cli):
    run = vfplan_cli("plan", SLICE, *MARKERS, "--pixel-spacing", "0.49", "-o", tmp_path / "f.h5")
    fixture = vfplan.read_fixture(tmp_path / "f.h5")
    shown = Plan.of(fixture, "f.h5", vfplan.read_image(SLICE))
    facts = dict(facts_of(shown))
    length = f"{1e3 * fixture.strokes[0].length:.1f} mm"
    assert f" px = {length}, " in run.stdout
    assert facts["Line"].startswith(f"open, {length};")
    assert facts["Pixel"] == f"{1e3 * shown.metres_per_px:.4g} mm as registered, 0.49 mm as given"


def test_open_line_has_both_ends_each_bridge_and_each_hidden_stretch_enlarged():
    points = np.column_stack([np.linspace(20, 360, 341), np.full(341, 160.0)])
    bridged = np.zeros(341, bool)
    bridged[100:110] = True
    bridged[200:290] = True  # 90 px are more than one inset shows
    hidden = AccountEntry(1, 160.0, 160.0, 12, 0.02, 12.0, "gap")
    ink = AccountEntry(2, 100.0, 90.0, 8, 0.01, 4.0, "ink")
    line, places = line_of(points, bridged=bridged), [(30.0, 165.0), (60.0, 160.0), (65.0, 160.0)]
    findings = tuple(doubt("a-code", "extract", "So.", place_px=place) for place in places)
    more = {"account": (hidden, ink), "findings": findings}
    sheet = checked(drawn_ends.shown_of(BLANK, line, **more))
    # An inset names all findings that it shows.
    assert [box.words for box in insets(sheet, "")] == [
        "Start of the line #1", "Start of the line, wider", "End of the line",
        "End of the line, wider", "Bridge 1", "Bridge 2", "Bridge 2", "Bridge 2",
        "1: gap in the line, or line hidden", "Finding #2 #3",
    ]  # fmt: skip
    notes = {"orange: 9 px", *(f"orange: 89 px, part {k} of 3" for k in (1, 2, 3))}
    assert notes <= set(words_of(sheet))
    windows = [box.window for box in insets(sheet, "Bridge 2")]
    assert {u + k for u, _, width, _ in windows for k in range(width)} >= {*range(215, 315)}


@pytest.mark.parametrize("known", [{"sigma": None, "width": None}, {"edited": BEYOND}])
def test_line_without_ink_is_drawn_in_the_wider_view_alone(known):
    """And orange on the picture, where a hand placed it."""
    sheet = checked(drawn_ends.shown_of(BLANK, replace(STRAIGHT, **known)))
    [close, wider] = insets(sheet, "End")
    assert not drawn_part(sheet, close).any()
    seen = drawn_part(sheet, wider).astype(int)
    is_blue = seen[..., 2] - seen[..., 0] > 60
    assert is_blue.any()
    assert not is_blue[:, INSET_PX // 2 + 8 :].any()  # it ends in the middle
    is_orange = is_coloured(sheet, picture_of(sheet), BRIDGE_COLOUR).any()
    is_told = "Orange: over a gap, or by hand" in words_of(sheet)
    assert is_told == is_orange == ("edited" in known)


@pytest.mark.parametrize("size", [(40, 40), (4096, 4096), (60, 3000), (2500, 50)])
def test_any_size_of_slice_fits(size):
    rng = np.random.default_rng(5)
    image = rng.integers(0, 120, (*size, 3), dtype=np.uint8)
    t = np.linspace(0.1, 0.9, 500)[:, None]
    line = line_of(t * (size[1], size[0]) + (0, 2) * np.sin(20 * t))
    more = {"metres_per_px": 1e-4, "tre95_m": np.full(500, 2e-4)}
    markers = drawn_ends.markers(rng, size, 6)
    sheet = checked(drawn_ends.shown_of(image, line, markers=markers, **more))
    [inset, _] = insets(sheet, "Start")
    assert inset.width == INSET_PX
    assert size != (60, 3000) or picture_of(sheet).width == CONTENT_WIDTH
    words = " ".join(words_of(sheet))
    assert all(f"M{k} " in words for k in range(6))
    # The picture's legend names the band where it is drawn there; the last inset always has it.
    *_, last = insets(sheet, "")
    purple = [is_coloured(sheet, box, BAND_COLOUR).any() for box in (picture_of(sheet), last)]
    assert purple == ["95 % band of markers and drawing, to scale" in words, True]
    assert " purple 95 %" in words


def test_a_hundred_findings_and_forty_markers_are_all_named():
    rng = np.random.default_rng(7)
    drawn = drawn_ends.draw(2, covered="")
    places = [tuple(rng.uniform(0, 300, 2)) for _ in range(100)]
    findings = tuple(doubt("ink-left", "extract", f"Number {k}.", place_px=place)
                     for k, place in enumerate(places))  # fmt: skip
    markers = drawn_ends.markers(rng, drawn.image.shape, 40)
    ink = tuple(AccountEntry(k, *places[k], 500 + k, 0.01, 9.0, "ink") for k in range(1, 31))
    shown = drawn_ends.shown(drawn, findings=findings, markers=markers, account=ink)
    on_sheet = words_of(checked(shown))
    assert {word for word in on_sheet if word.isdecimal()} <= {str(k) for k in range(1, 13)}
    words = " ".join(on_sheet)
    for number in range(1, 101):
        assert f"#{number}  wants an answer" in words
    assert all(f"M{k} " in words for k in range(40))
    assert "100" in verdict_of(shown)


def test_text_from_files_can_do_no_harm():
    drawn = drawn_ends.draw(4, covered="")
    names = ("a\nb\x1b[31m", "\u202eabc", "x" * 300, "名前 мм", "")
    rng = np.random.default_rng(1)
    places = drawn_ends.markers(rng, drawn.image.shape, len(names))
    given = tuple(replace(m, label=name) for m, name in zip(places, names, strict=True))
    finding = doubt("code" * 40, "plan", "word " * 200 + "y" * 400, answered_by="\x00" * 9)
    shown = drawn_ends.shown(drawn, markers=given, findings=(finding,))
    fixture = replace(shown.fixture, case="c" * 60)
    words = words_of(checked(drawn_ends.with_values(shown, fixture=fixture)))
    assert fixture.case in "".join(words)
    assert "accepted as it is by" in " ".join(words)
    # Names are shortened beside their numbers.
    for marker in given:
        number = f" {1e3 * marker.residual_m:.2f} mm" if marker.is_used else " left out"
        assert any(line.endswith(number) for line in words), marker


def test_a_name_from_right_to_left_leaves_the_number_beside_it():
    name, seen = "علامة", []
    for x, words in ((100, f"{isolated(name)} 1.23 mm"), (100 + BODY.width_of(name), " 1.23 mm")):
        page = Paper()
        page.text(x, 100.0, words)
        seen.append(page.image()[:200, round(100 + BODY.width_of(name)) :])
    assert (seen[0] < 255).any()
    assert np.array_equal(*seen)


def test_findings_and_the_list_name_ink_by_one_number_and_size():
    rgb = vfplan.read_image(SLICE).rgb.copy()
    rgb[548:588, 430:440] = 95
    rgb[330:352, 225:250] = rgb[695:697, 790:804] = rgb[200:203, 500:512] = (237, 28, 36)
    image = PlannedImage(rgb, None, "ab" * 32)
    found = extract(image, vfplan.ExtractSettings(accept_width=True)).fixture
    words = "\n".join(words_of(checked(Plan.of(found, "f.h5", image))))
    # A bridge, where no ink is, has no row.
    rows = dict(re.findall(r"^(\d+): (longest side \d+ px|bridge)", words, re.M))
    assert "bridge" not in rows.values()
    told = re.findall(r": ink-.*, other ink (\d+)\n.*ink of (\d+ px)", words)
    assert len(told) == words.count(", other ink ") >= 2
    assert all(rows[number] == f"longest side {side}" for number, side in told)


# ---- a bundle ----


@pytest.mark.parametrize(
    "name", ["minimal", "small", "sheet", "whole", "guided", "patient", "large"]
)
def test_bundle_without_a_slice_has_three_views(name):
    """A large cloud too is drawn in time."""
    fixture = getattr(bundles, name)()
    finding = doubt("size-unusual", "plan", "So.", place_m=tuple(fixture.points[0]))
    shown = Plan.of(replace(fixture, findings=(finding,)), "f.h5")
    sheet = checked(shown)
    is_listed = "#2  wants an answer: slice-not-shown" in words_of(sheet)
    assert is_listed == shown.is_slice_missing
    views = [(drawn_part(sheet, box) < 200).any() for box in sheet.boxes if box.kind == "picture"]
    assert views == [True] * 3


def test_a_guide_without_end_along_its_axis_is_drawn_from_above_alone():
    sheet = checked(Plan.of(bundles.guided(), "f.h5"))
    views = [box for box in sheet.boxes if box.kind == "picture"]
    greens = [(drawn_part(sheet, view) == GUIDE_COLOUR).all(axis=2).any() for view in views]
    assert greens == [True, False, False]
    assert any(words.startswith("The tube has no end along its axis") for words in words_of(sheet))


def test_bundle_is_drawn_on_its_slice_where_it_was_measured():
    fixture = bundles.whole()
    image = PlannedImage(np.zeros((786, 871, 3), np.uint8), None, "ab" * 32)
    shown = Plan.of(fixture, "f.h5", image=image)
    arc, circle = shown.strokes
    turn = np.linspace(0, np.pi, 40)
    truth = np.column_stack([300 + 60 * np.cos(turn), 400 - 60 * np.sin(turn)])
    assert np.abs(arc.points - truth).max() < 1e-6
    assert circle.closed
    record = fixture.registration
    for marker, place, target in zip(shown.markers, record.source, record.target, strict=True):
        assert np.array_equal(marker.place, place)
        # A step of the residual on the slice is the residual in the robot's frame, but for its part
        # across the slice.
        moved = record.T_robot_image[:, :2] @ marker.residual_px
        normal = np.cross(record.T_robot_image[:, 0], record.T_robot_image[:, 1])
        left = target - record.T_robot_image @ [*place, 1] - moved
        assert np.linalg.norm(np.cross(left, normal)) < 1e-9 * np.linalg.norm(normal)
    assert {"start 1", "end 1", "line 2"} <= {*words_of(checked(shown))}


def test_a_slice_of_what_was_drawn_on_none_is_refused():
    image = PlannedImage(np.zeros((786, 871, 3), np.uint8), None, "cd" * 32)
    with refuses(InputError, "slice-unknown"):
        check_slice(bundles.sheet(), image)


def test_png_prints_at_its_own_size():
    image = Image.open(BytesIO(png_of(draw_sheet(drawn_ends.shown(drawn_ends.draw(0))).pixels)))
    image.load()
    assert (image.size[0], image.info["dpi"]) == (PAGE_WIDTH, pytest.approx((DPI, DPI), abs=0.1))


def test_points_that_were_set_in_slicer_stand_beside_the_line(tmp_path):
    pixels = np.full((80, 100), 90, np.uint8)
    slice_file = capture(
        tmp_path, pixels, "MONOCHROME2", PixelSpacing=[0.5, 0.25],
        ImagePositionPatient=[-12.5, -20, 5], ImageOrientationPatient=[1, 0, 0, 0, 1, 0],
    )  # fmt: skip
    points_px = (RING_MM[::3, :2] + (12.5, 20)) / (0.25, 0.5)
    curve = slicer(tmp_path, RING_MM[::3], "ClosedCurve")
    path = bundles.stored(tmp_path / "c.h5", extract(slice_file, curve=curve).fixture)
    # From the bundle, so that every view shows them.
    marked = Plan.of(vfplan.read_fixture(path), "c", vfplan.read_image(slice_file))
    assert np.allclose(marked.slicer_points, points_px, atol=0.05)
    others = {k: v for k, v in marked.fixture.provenance.settings.items() if "slicer_" not in k}
    provenance = replace(marked.fixture.provenance, settings=others)
    plain = Plan.of(replace(marked.fixture, provenance=provenance), "c", marked.image)
    with_ticks, without = checked(marked), checked(plain)
    assert [str(words_of(sheet)).count("set in") for sheet in (with_ticks, without)] == [1, 0]
    assert "start" not in words_of(with_ticks)
    # Each tick stands close to its point, and nothing is drawn on the line.
    box = picture_of(with_ticks)
    changed = (drawn_part(with_ticks, box) != drawn_part(without, box)).any(axis=2)
    zoom = box.width / pixels.shape[1]
    ticks = np.argwhere(changed)[:, ::-1] / zoom
    away = np.linalg.norm(ticks[:, None] - (points_px + 0.5), axis=2)
    assert (away.min(axis=0) < 5).all()
    assert away.min() > 1
    drawn = extract(slice_file, curve=polyline(tmp_path, points_px)).fixture
    assert not Plan.of(drawn, "c").slicer_points.size
