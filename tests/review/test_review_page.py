"""The review page in a browser, driven by a hand: mouse, wheel and keys."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest
from captures import capture, ct_series
from chromium import CTRL, SHIFT, Page
from conftest import need_program
from hand import READY, Hand
from refusals import refuses
from review_slices import (
    MARKERS,
    SLICE,
    blue,
    fork,
    half_double,
    hidden_end,
    lifted,
    marker_table,
    miss,
    photographed,
    shifted,
    two_candidates,
)

import vfplan
from vfplan.errors import ImageError
from vfplan.findings import doubt
from vfplan.geometry.lines import normals
from vfplan.markers.correspondences import read_markers
from vfplan.review.server import Draft, ReviewServer
from vfplan.review.session import Session


@pytest.fixture
def browser(tmp_path):
    with Page(need_program("chromium", "chromium"), tmp_path / "profile") as page:
        yield page
        assert page.wrong() == []


@pytest.fixture
def run(tmp_path):
    """Begin `vfplan review` of files as a program of its own; ended with the test."""
    begun = []

    def begin(*words):
        command = [sys.executable, "-m", "vfplan", "review", *map(str, words), "--no-browser"]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        program = subprocess.Popen([*command, "-o", str(tmp_path / "o.h5")], **pipes)
        begun.append(program)
        program.address = program.stdout.readline().strip()
        assert program.address.startswith("http://127.0.0.1:"), program.stderr.read()
        return program

    yield begin
    for program in begun:
        program.kill()
        program.communicate()


@pytest.fixture
def opened(run, browser):
    """Begin a review of files: a hand at its page, which knows the program."""

    def begin(*words):
        program = run(*words)
        hand = Hand(browser, program.address)
        hand.program = program
        return hand

    return begin


def test_the_sample_from_slice_to_signed_fixture(browser, opened, tmp_path, vfplan_cli):
    assert vfplan_cli("keygen", "-o", tmp_path / "surgeon.key").sound
    signing = ("--key", tmp_path / "surgeon.key", "--case", "case-7")
    hand = opened(SLICE, *MARKERS, "--pixel-spacing", 0.5, *signing)
    output = tmp_path / "o.h5"
    assert browser.run("document.getElementById('approve').textContent") == "Approve and sign"
    # The band is as wide along the line as on the sheet.
    [(line, bound_m)] = (plan := Session.open(SLICE, *MARKERS, pixel_spacing_mm=0.5).current).bounds
    reach = (bound_m / plan.metres_per_px)[:, None] * normals(line.points, False)
    for k in (bound_m.argmin(), bound_m.argmax()):
        places = [(line.points[k] + share * reach[k]).tolist() for share in (0.9, 1.1)]
        is_filled = "document.querySelector('#bands path').isPointInFill(new DOMPoint(...{}))"
        assert [browser.run(is_filled.format(place)) for place in places] == [True, False]
    # The wheel zooms at the pointer: the place below it stays.
    before = hand.at((400, 300))
    browser.wheel(*before, -400)
    browser.until("review.view.zoom > 1.5")
    assert np.allclose(hand.at((400, 300)), before, atol=1.0)
    browser.key("f")
    hand.finish()
    assert browser.run(STATUS) == "approved"
    said = hand.program.communicate(timeout=30)
    assert (hand.program.returncode, output.exists()) == (0, True), said
    assert vfplan_cli("verify", output, "--keys", tmp_path / "surgeon.pub", "--json").sound
    fixture = vfplan.read_fixture(output)
    assert fixture.reviewed.by == "A. Planner"
    assert not fixture.open_findings
    assert not output.with_name("o.h5.draft.json").exists()


def test_the_first_view_is_a_look_at_the_line_and_belongs_to_the_first_name(
    browser, opened, tmp_path
):
    """A small slice is shown larger than one to one at once."""
    hand = opened(blue(tmp_path / "small.png")[0], "--colour", "blue")
    for name, runs in (("", [0]), ("A. Planner", [0]), ("B. Planner", [1])):
        hand.fill("#name", name)
        browser.until(f"review.state.unseen[0].length === {runs[0]}")
        time.sleep(0.5)
        assert hand.state("review.state.unseen.map((runs) => runs.length)") == runs
    hand.press("fit")
    browser.until("review.state.unseen[0].length === 0")


def test_a_line_is_drawn_in_one_go_and_one_that_lies_apart_is_asked_about(
    browser, opened, tmp_path
):
    path, truth = fork(tmp_path / "slice.png")
    hand = opened(path)
    browser.key("f")
    # Several ways lie at the line's first part: a click takes the longest.
    longest = max(way["length_px"] for way in hand.state("review.state.candidates"))
    hand.click(truth[100])
    browser.until("review.state.curve_px.length === 1")
    assert len(hand.state("review.state.curve_px[0]")) == pytest.approx(longest, abs=8)
    assert not hand.state("document.getElementById('others-card').hidden")
    for places, button, strokes in (
        (truth[::20], None, 1),
        (np.add(truth[:200:20], (0, 150)), "add-stroke", 2),
    ):
        browser.key("d")
        browser.press_at(*hand.at(places[0]))
        for place in places:
            browser.press(*hand.at(place), "mouseMoved")
        browser.press(*hand.at(places[-1]), "mouseReleased")
        if button:
            browser.until("document.getElementById('where').open")
            # The line stays in view, and an Enter too many does no harm.
            assert browser.run(f"{PREVIEW} && document.activeElement.id") == "not-drawn"
            assert browser.run(STATUS) == "line not in the plan"
            hand.press(button)
        browser.until(f"review.state.curve_px.length === {strokes} && {READY}")
        if strokes == 1:
            hand.until_steps(2)
            assert miss(hand.state("review.state.curve_px[0]"), truth) < 0.5
    browser.until(f"{PREVIEW} === ''")


def test_a_refusal_names_only_what_the_page_has(browser, opened, tmp_path):
    """A line that was drawn twice in part, and five markers of a photograph."""
    hand = opened(half_double(tmp_path / "twice.png")[0])
    words = browser.run("document.getElementById('refusal-text').textContent")
    assert "two runs" in words
    assert "accept" not in words
    # The same of any text: an option is named by its control, and left out where there is none.
    browser.run("import('./dom.js').then((dom) => { window.words = dom.inPageWords; })")
    browser.until("Boolean(window.words)")
    for text, shown in (
        ("It is short. If it is meant: --stroke 2.", "It is short."),
        ("It is long. If it is meant: vfplan review IMAGE.", "It is long."),
        ("Off by 2 mm, or give another --max-tre. Add one.", "Off by 2 mm. Add one."),
        ("Give --seen-from above.", "Give “The slice is seen from” above."),
        ("Not what --seen-from names.", "Not what “The slice is seen from” names."),
        ("Give --pixel-spacing MM if you know it.", "Fill in “A pixel is” if you know it."),
        ("Give --pixel-spacing ALONG_U,ALONG_V, or --model similarity or affine",
         "Give “A pixel is”, or “From slice to robot” one scale or any stretch"),
        ("None is red. Another is: --colour '#0000ff'. So is this.", "None is red. So is this."),
        ("Leave a out (give --common) with vfplan rectify. --max-tre allows 1.",
         "Leave a out. The plan allows 1."),
        ("Made for others. Run vfplan campaign, --margin.",) * 2,
    ):  # fmt: skip
        assert browser.run(f"window.words({json.dumps(text)})") == shown
    hand.program.kill()
    photo, places, _ = photographed(tmp_path)
    files = [tmp_path / "image.csv", tmp_path / "robot.csv"]
    for file, known in zip(files, (places, MARKERS[1]), strict=True):
        file.write_text("\n".join(known.read_text().split()[:6]))
    hand = opened(photo, *files)
    assert "--" not in browser.run("document.getElementById('refusal-text').textContent")
    hand.press("Make the picture flat")
    browser.until("review.state.image.is_flat && review.state.refusal === null", seconds=60)


@pytest.mark.parametrize("arcs, offers", [
    ((), ""), (("--arcs", 0.05), "Take finer lines and arcs")])  # fmt: skip
def test_finer_arcs_are_offered_in_place_of_typed_ones_only(arcs, offers, browser, opened):
    opened(SLICE, *MARKERS, "--guide", 0.015, *arcs)
    assert browser.run("review.state.refusal.code") == "arcs-coarse"
    assert browser.run("document.getElementById('other-ways').textContent") == offers


@pytest.mark.slow
def test_a_hidden_end_by_the_keyboard_alone(browser, opened, tmp_path):
    path, truth, box = hidden_end(tmp_path / "slice.png")
    hand = opened(path)
    browser.run("document.getElementById('stage').focus()")
    browser.key("d")
    end = hand.state("review.state.curve_px[0].at(-1)")
    hidden = truth[truth[:, 0] > box[0] + 6]
    places = np.vstack([[end], hidden[::20], hidden[-1:]]).tolist()
    cross = "document.getElementById('cross').transform.baseVal[0].matrix"
    browser.key("ArrowRight")
    for place in places:
        for _ in range(60):
            off = [place[k] - browser.run(f"{cross}.{name}") for k, name in enumerate("ef")]
            axis = int(abs(off[1]) > abs(off[0]))
            if abs(off[axis]) < 0.51:
                break
            arrow = (("ArrowLeft", "ArrowRight"), ("ArrowUp", "ArrowDown"))[axis][off[axis] > 0]
            browser.key(arrow, modifiers=SHIFT if abs(off[axis]) >= 10 else 0)
        browser.key(" ")
    browser.key("Enter")
    browser.until("review.state.edited[0].length > 0")
    hand.finish()
    assert hand.program.wait(timeout=30) == 0
    fixture = vfplan.read_fixture(tmp_path / "o.h5")
    assert miss(fixture.points[~fixture.curve.edited, :2], truth) < 0.3
    assert np.hypot(*(fixture.points[-1, :2] - truth[-1])) < 1.5


def test_a_misplaced_marker_is_dragged_home_and_the_bound_follows(browser, opened, tmp_path):
    """The bound on the screen follows the drag within 150 ms, as the page itself measures."""
    wrong, home = shifted(tmp_path / "wrong.csv", 4)
    hand = opened(SLICE, wrong, MARKERS[1], "--pixel-spacing", 0.5)
    before = hand.state("review.state.tre95_m")
    browser.run(
        "window.waits = []; window.sent = 0; const send = review.send.bind(review);"
        " review.send = (m) => { if (m.preview || m.step) window.sent = performance.now();"
        " send(m); };"
        " new MutationObserver(() => window.waits.push(performance.now() - window.sent)).observe("
        "document.getElementById('bound'), {childList: true, characterData: true, subtree: true});"
    )
    start = (home[0] + 4, home[1])
    browser.press_at(*hand.at(start))
    for share in np.linspace(0, 1, 12)[1:]:
        place = hand.at((start[0] + share * (home[0] - start[0]), start[1]))
        browser.press(*place, "mouseMoved")
        time.sleep(0.06)
    browser.press(*hand.at(home), "mouseReleased")
    hand.until_steps(1)
    browser.until("review.state.tre95_m", lambda bound: bound < 0.6 * before)
    waits = browser.run("window.waits")
    assert len(waits) >= 2
    assert np.median(waits) < 150
    assert hand.state("review.state.steps.length") == 1


def deep_slice(path):
    """A slice of 16 bits with a red line, and a patch whose grey differs by 1 of 65,535."""
    picture = np.full((300, 400, 3), 20_000, np.uint16)
    picture[100:140, 100:160] = 20_001
    picture[200:203, 60:340] = (0, 0, 60_000)  # OpenCV writes blue first
    cv2.imwrite(str(path), picture)
    return path


WINDOW = "['low', 'high'].map((id) => Number(document.getElementById(id).value))"


def grey_at(browser, u, v):
    """The red channel of the picture that the browser has, at a pixel of the slice."""
    return browser.run(
        "(() => { const c = document.createElement('canvas'), s = document.getElementById('slice');"
        " c.width = s.naturalWidth; c.height = s.naturalHeight; const p = c.getContext('2d');"
        f" p.drawImage(s, 0, 0); return p.getImageData({u}, {v}, 1, 1).data[0]; }})()"
    )


def test_greys_between_black_and_white_keep_the_depth_of_16_bits(browser, opened, tmp_path):
    hand = opened(deep_slice(tmp_path / "deep.png"))
    browser.until("document.getElementById('slice').complete")
    assert grey_at(browser, 120, 120) == grey_at(browser, 10, 10) == round(20_000 / 257)
    hand.fill("#low", 20_000, "input")
    hand.fill("#high", 20_002, "input")
    browser.until("document.getElementById('slice').src.includes('high=20002')")
    browser.until("document.getElementById('slice').complete")
    assert (grey_at(browser, 10, 10), grey_at(browser, 120, 120)) == (0, 128)
    # Black stays below white, whichever slider moves.
    hand.fill("#low", 60_000, "input")
    assert browser.run("Number(document.getElementById('high').value)") == 60_001
    # A drag with the right button: to the right for a wider window, down for a brighter slice.
    browser.run("document.getElementById('high').value = 60100")
    before = browser.run(WINDOW)
    start = np.array(hand.at((200, 150)))
    for kind, off in (("mousePressed", 0), ("mouseMoved", (-20, 30)), ("mouseReleased", (-20, 30))):
        browser.press(*(start + off), kind, "right")
    low, high = browser.run(WINDOW)
    assert high - low == pytest.approx(65_535 / 400, abs=2)
    assert (low + high) / 2 == pytest.approx(np.mean(before) - 30 * 65_535 / 400, abs=2)
    assert hand.state("review.state.steps.length") == 0
    browser.run("document.getElementById('greys').click()")
    browser.until("document.getElementById('slice').src.includes('low=0&high=65535')")


@pytest.mark.parametrize("button, window", [("bone", (-500, 1500)), ("soft", (-160, 240))])
def test_presets_set_the_window_of_a_ct(button, window, browser, opened, tmp_path):
    stored = np.linspace(0, 4000, 120_000).reshape(300, 400, 1).astype(np.uint16)
    scale = {"Modality": "CT", "RescaleIntercept": -1000, "RescaleSlope": 1}
    hand = opened(capture(tmp_path, stored, "MONOCHROME2", **scale))
    assert not browser.run(f"document.getElementById('{button}').hidden")
    browser.run(f"document.getElementById('{button}').click()")
    wanted = (np.array(window) + 1000) / 4000 * hand.state("review.state.image.grey_max")
    assert browser.run(WINDOW) == pytest.approx(wanted, abs=1)
    shown = "['low', 'high'].map((id) => document.getElementById(`${id}-text`).textContent)"
    assert browser.run(shown) == [str(value) for value in window]


@pytest.mark.slow
def test_markers_are_found_renamed_placed_and_left_out(browser, opened, tmp_path):
    pairs = read_markers(*MARKERS)
    beside = pairs.source + np.array([1.5, 0.0])
    markers = marker_table(tmp_path / "m.csv", beside, pairs.target, pairs.labels)
    hand = opened(SLICE, markers, "--pixel-spacing", 0.5)
    # The marks on the slice are found, a pixel and a half beside.
    hand.press("find-marks")
    browser.until("review.state.steps.length === 1", seconds=60)
    places = np.array(hand.state("review.state.markers.map((m) => m.place_px)"))
    assert np.abs(places - pairs.source).max() < 0.6
    hand.fill("#marker-table input[maxlength]", "first")
    browser.until("review.state.markers[0].label === 'first'")
    bound = hand.state("review.state.tre95_m")
    browser.run("document.querySelector('#marker-table input[type=checkbox]').click()")
    browser.until(f"!review.state.markers[0].used && review.state.tre95_m !== {bound}")
    browser.key("m")
    hand.click((300, 120))
    browser.until("review.state.markers.length === 10")
    browser.key("j", modifiers=SHIFT)
    browser.key("Delete")
    browser.until("review.state.markers.length === 9 && review.selected === null")
    words = hand.state("[...document.querySelectorAll('#steps li')].map((li) => li.textContent)")
    assert [word.split(",")[0] for word in words] == [
        "find markers", "rename marker", "leave out marker", "add marker",
        "delete marker",
    ]  # fmt: skip
    for _ in range(5):
        browser.key("z", modifiers=CTRL)
    hand.until_steps(0)
    assert hand.state("review.state.markers.length") == 9


@pytest.mark.slow
def test_buttons_insert_cut_turn_and_join(browser, opened, tmp_path):
    hand = opened(lifted(tmp_path / "slice.png"), "--stroke", "all")
    for _ in range(4):
        browser.key("k")
    count = hand.state("review.state.knots_px[0].length")
    hand.press("Insert behind")
    browser.until(f"review.state.knots_px[0].length === {count + 1}")
    place = hand.state("review.state.knots_px[0][Number(review.selected.key.split('/')[1])]")
    hand.press("Cut before")
    hand.until_steps(2)
    assert hand.state("review.selected.key") == "0/0"
    assert np.allclose(hand.state("review.state.curve_px[0][0]"), place, atol=0.1)
    browser.key("k")
    hand.press("Turn round")
    hand.until_steps(3)
    assert np.allclose(hand.state("review.state.curve_px[0].at(-1)"), place, atol=0.1)
    last = "document.querySelector('#steps li:last-child').textContent"
    assert browser.run(last) == "reverse, stroke 1"
    lengths = hand.state("review.state.curve_px.map((line) => line.length)")
    hand.press("Join with stroke 2")
    hand.until_steps(4)
    [joined] = hand.state("review.state.curve_px.map((line) => line.length)")
    assert joined >= sum(lengths)
    # What was cut off is other ink now.
    assert hand.state("review.state.account.length")


LOOKS = "[...document.querySelectorAll('#over *')].map((n) => getComputedStyle(n).stroke)"


def test_a_tool_changes_the_look_of_nothing_and_an_inset_is_hatched_outside(browser, opened):
    opened(SLICE, *MARKERS)
    browser.until(
        "document.querySelector('#over .unseen-part') === null"
    )  # the first view is a look
    drawn = browser.run(LOOKS)
    for key in "dxmuv":
        browser.key(key)
        assert browser.run(LOOKS) == drawn
    browser.run("review.step({do: 'draw', points: [[0, 99], [60, 99]], replace: true})")
    canvas = "document.querySelector('#ends canvas').getContext('2d')"
    browser.until(f"[...{canvas}.getImageData(0, 0, 9, 168).data]", {0x88, 0xDD}.issubset)


PREVIEW = "document.getElementById('preview').getAttribute('points')"
STATUS = "document.getElementById('status').textContent"
FELT = STATUS.replace("status", "felt")


def test_what_a_step_settled_is_offered_no_longer(browser, opened, tmp_path):
    """Ink that was taken or left out, and the line that was chosen."""
    hand = opened(two_candidates(tmp_path / "slice.png")[0])
    for chosen, other in ("12", "21", "12"):
        hand.press(f"{chosen}Take this line")
        browser.until(f"document.getElementById('others').textContent.startsWith('{other}Take')")
        assert browser.run(PREVIEW) == ""
    browser.run("document.querySelector('#account button').click()")
    offered = "[...document.querySelectorAll('#context button')].map((one) => one.textContent)"
    assert browser.run(offered) == ["Take as the curve", "Take as a part", "Leave out"]
    hand.press("Leave out")
    browser.until(offered, lambda words: words == ["Take as the curve", "Take as a part"])
    hand.press("Take as a part")
    hand.until_steps(5)
    assert browser.run(offered) == []


def test_a_field_that_holds_no_length_is_told_and_changes_nothing(browser, opened):
    hand = opened(SLICE, *MARKERS)
    hand.fill("#plan-distance", "wide")
    told = browser.until("document.getElementById('toast').textContent")
    assert told == "“wide” is no length. Write a number of millimetres above 0."
    assert browser.run("document.getElementById('plan-distance').value") == "5"
    assert hand.state("review.state.steps.length") == 0


RENEW = "review.receive({state: review.state, version: review.version})"


def press_while_the_page_is_renewed(browser, hand, button):
    """Press a button, let the whole state arrive three times, and release it."""
    place = hand.place_of(button)
    browser.press_at(*place)
    for _ in range(3):
        browser.run(RENEW)
    browser.press(*place, "mouseReleased")


def test_a_press_counts_though_a_state_arrives_before_its_release(browser, opened, tmp_path):
    hand = opened(two_candidates(tmp_path / "slice.png")[0])
    press_while_the_page_is_renewed(browser, hand, "1Take this line")
    hand.until_steps(1)
    browser.key("k")
    press_while_the_page_is_renewed(browser, hand, "Turn round")
    hand.until_steps(2)
    press_while_the_page_is_renewed(browser, hand, "undo")
    hand.until_steps(1)


def test_a_knot_follows_the_pointer_though_a_state_arrives_during_the_drag(browser, opened):
    hand = opened(SLICE)
    knot = hand.state("review.state.knots_px[0][12]")
    home = (knot[0] + 30, knot[1] + 50)
    browser.drag(hand.at(knot), hand.at(home), release=False)
    before = browser.run(PREVIEW)
    browser.run(RENEW)
    time.sleep(0.2)
    assert before == browser.run(PREVIEW) != ""
    browser.press(*hand.at(home), "mouseReleased")
    hand.until_steps(1)
    assert np.allclose(hand.state("review.state.knots_px[0][12]"), home, atol=1.0)


def test_what_stands_in_a_field_and_the_focus_outlive_a_new_state(browser, opened):
    hand = opened(SLICE, *MARKERS)
    label = hand.state("review.state.markers[0].label")
    browser.run("document.querySelector('#marker-table input[maxlength]').focus()")
    browser.type("left ")
    browser.run(RENEW)
    browser.type("side ")
    browser.key("Enter")
    browser.until(f"{READY} && review.state.markers[0].label === 'left side {label}'")
    assert browser.run("document.activeElement.value") == f"left side {label}"
    # With the keyboard on a button that is made anew, the focus is on the new one.
    browser.run("document.querySelector('#ends button').focus()")
    browser.run(RENEW)
    assert browser.run("document.activeElement === document.querySelector('#ends button')")


@pytest.mark.slow
def test_the_view_of_a_dicom_slice_moves_zooms_and_says_where_one_is(browser, opened, tmp_path):
    place = {"ImagePositionPatient": [10, 20, 30], "ImageOrientationPatient": [1, 0, 0, 0, 1, 0]}
    path = capture(tmp_path, vfplan.read_image(SLICE).rgb, PixelSpacing=[0.5, 0.5], **place)
    hand = opened(path, *MARKERS, "--margin", "tre95")
    letters = "[...document.querySelectorAll('#letters span')].map((n) => n.textContent).join('')"
    assert sorted(browser.run(letters)) == ["A", "L", "P", "R"]
    assert browser.run("document.getElementById('bar-text').textContent") == "50 mm"
    whole = hand.state("[review.view.x, review.view.y, review.view.zoom]")
    # Under the pointer: pixels and millimetres.
    browser.press(*hand.at((300.0, 40.0)), "mouseMoved", "none")
    place = browser.run("document.getElementById('place').textContent")
    found = [float(word.rstrip(",")) for word in place.split() if word[0].isdigit()]
    assert np.allclose(found, (300, 40, 150, 20), atol=0.6)
    # A drag moves the slice; with Space it does so with any tool, and draws nothing.
    for tool in ("v", "d"):
        browser.key(tool)
        if tool == "d":
            browser.do("Input.dispatchKeyEvent", type="keyDown", key=" ")
        before = hand.at((300, 40))
        hand.drag((300, 40), (340, 60))
        browser.do("Input.dispatchKeyEvent", type="keyUp", key=" ")
        zoom = hand.state("review.view.zoom")
        assert np.allclose(np.subtract(hand.at((300, 40)), before) / zoom, (40, 20), atol=0.5)
    assert browser.run("document.querySelectorAll('#clicks circle').length") == 0
    browser.key("Escape")
    browser.key("1")
    assert hand.state("review.view.zoom") == 1
    browser.key("+")
    assert hand.state("review.view.zoom") == pytest.approx(1.25)
    browser.key("f")
    assert hand.state("[review.view.x, review.view.y, review.view.zoom]") == whole
    # What the tool's centre is kept out of is drawn as the engine of the robot gives it.
    outline = "document.querySelector('#lines .rendered.wall')"
    drawn = f"{outline}.getAttribute('points').split(' ').length"
    assert browser.run(drawn) == len(hand.state("review.state.outline_px[0]"))
    # A box that was dragged is gone with its undo.
    browser.key("x")
    hand.drag((600, 60), (700, 160))
    hand.until_steps(1)
    browser.key("z", modifiers=CTRL)
    hand.until_steps(0)
    boxes = (
        "[...document.querySelectorAll('#over rect')].filter((n) =>"
        " getComputedStyle(n).visibility === 'visible').length"
    )
    assert browser.run(boxes) == 0


def test_reload_and_killed_server(browser, opened, run):
    hand = opened(SLICE, *MARKERS)
    knot = hand.state("review.state.knots_px[0][5]")
    hand.drag(knot, (knot[0] - 40, knot[1]))
    hand.until_steps(1)
    moved = hand.state("review.state.curve_px")
    browser.do("Page.reload")
    browser.loaded(2)
    browser.until(f"{READY} && review.state.steps.length === 1")
    assert hand.state("review.state.curve_px") == moved
    hand.program.kill()
    hand.program.wait()
    browser.until(f"{STATUS} === 'connection lost'")
    assert "steps are kept" in browser.run("document.getElementById('toast').textContent")
    again = run(SLICE, *MARKERS)
    browser.open(again.address)
    browser.until(f"{READY} && review.state.steps.length === 1")
    assert hand.state("review.state.curve_px") == moved
    assert "1 step" in browser.run("document.getElementById('draft-text').textContent")
    hand.press("Resume")
    browser.until("!document.getElementById('draft').open")
    hand.press("leave")
    browser.until("document.getElementById('done').open")
    assert again.wait(timeout=30) == 1


def test_every_control_has_a_name_and_the_page_fits_its_window(browser, opened):
    opened(SLICE, *MARKERS)
    unnamed = browser.run(
        "[...document.querySelectorAll('button, input, textarea, [role]')].filter((n) =>"
        " !(n.textContent.trim() || n.getAttribute('aria-label') || n.labels?.length || n.title"
        " || ['status', 'alert'].includes(n.getAttribute('role')))).map((n) => n.outerHTML)"
    )
    assert unnamed == []
    for width, height in ((1300, 860), (1000, 700), (700, 900)):
        browser.size(width, height)
        assert browser.run("document.documentElement.scrollWidth <= innerWidth")
        assert browser.run("document.documentElement.scrollHeight <= innerHeight")
        browser.until("review.view.isIn([0, 0]) && review.view.isIn([870, 785])")
    browser.key("Tab")
    outline = "getComputedStyle(document.activeElement).outlineStyle"
    assert browser.run(f"document.activeElement !== document.body && {outline}") == "solid"


@pytest.mark.slow
def test_a_large_slice_with_many_findings_and_markers_stays_fluent(browser, tmp_path, monkeypatch):
    """4096 x 4096 pixels, 100 findings, 40 markers: drags above 30 frames a second."""
    rng = np.random.default_rng(1)
    picture = np.full((4096, 4096, 3), 60, np.uint8)
    picture += rng.integers(0, 40, picture.shape[:2], np.uint8)[..., None]
    t = np.linspace(0, 1, 4000)
    truth = np.column_stack([500 + 3000 * t, 2000 + 900 * np.sin(7 * t)])
    line = np.rint(truth * 16).astype(np.int32)[:, None]
    cv2.polylines(picture, [line], False, (0, 0, 255), 5, cv2.LINE_AA, shift=4)
    path = tmp_path / "large.png"
    cv2.imwrite(str(path), picture)
    places = rng.uniform(100, 4000, (40, 2))
    markers = marker_table(tmp_path / "m.csv", places, np.insert(1e-4 * places, 2, 0.01, axis=1))
    # Every state has the findings: the page gets a new one whenever it has looked at the line.
    places = [(200 + 37 * k, 300 + 31 * k) for k in range(100)]
    found = [doubt("x", "extract", f"F {k}", place_px=p) for k, p in enumerate(places)]
    findings = [finding.as_dict() for finding in found]
    state = Session.state
    with_findings = lambda self, by: {**state(self, by), "findings": findings}  # noqa: E731
    monkeypatch.setattr(Session, "state", with_findings)
    session = Session.open(path, markers)
    server = ReviewServer(session, Draft(tmp_path / "d.json", session.source.sha256, {}))
    try:
        hand = Hand(browser, server.address)
        browser.until("document.getElementById('slice').complete")
        browser.until("document.querySelectorAll('.pin').length === 100")
        assert browser.run("document.querySelectorAll('.marker').length") == 40
        knot = hand.state("review.state.knots_px[0][9]")
        marker = hand.state("review.state.markers[7].place_px")
        places = {"pan": (2000, 3500), "knot": knot, "marker": marker}
        rates = {kind: frames(browser, hand, place) for kind, place in places.items()}
        assert min(rates.values()) > 30, rates
    finally:
        server.close()


def frames(browser, hand, place):
    """Frames a second that the browser draws while something is dragged."""
    start = hand.at(place)
    browser.press_at(*start)
    browser.run(
        "window.frames_ = []; (function next(t) { window.frames_.push(t);"
        " if (window.frames_.length < 400) requestAnimationFrame(next); })(performance.now())"
    )
    for k in range(60):
        browser.press(start[0] + 1.5 * k, start[1] + 0.8 * k, "mouseMoved")
    times = np.array(browser.run("window.frames_"))
    browser.press(start[0] + 90, start[1] + 48, "mouseReleased")
    return 1e3 * (len(times) - 1) / (times[-1] - times[0])


@pytest.mark.slow
def test_marks_are_clicked_in_order_where_the_robots_places_alone_are_known(
    browser, opened, tmp_path
):
    hand = opened(SLICE, MARKERS[1])
    truth = np.loadtxt(MARKERS[0], delimiter=",", skiprows=1, usecols=(1, 2))
    for place in truth + np.random.default_rng(2).uniform(-3, 3, truth.shape):
        hand.click(place)
    browser.until("review.state.markers.every((marker) => marker.place_px)")
    places = np.array(hand.state("review.state.markers.map((marker) => marker.place_px)"))
    assert np.abs(places - truth).max() < 0.1
    assert hand.state("document.querySelector('[data-tool=marker]').ariaChecked") == "true"
    browser.key("Escape")
    browser.picture(tmp_path / "markers.png")
    # No label lies on the yellow labels that are printed on the slice.
    picture = cv2.imread(str(SLICE)).astype(int)
    is_label = picture[..., 1] - picture[..., 0] > 60
    boxes = browser.run(
        "[...document.querySelectorAll('.marker text')].map((text) => {"
        " const b = text.getBoundingClientRect();"
        " const s = document.getElementById('stage').getBoundingClientRect();"
        " return [...review.view.onSlice([b.left - s.left, b.top - s.top]),"
        " ...review.view.onSlice([b.right - s.left, b.bottom - s.top])]; })"
    )
    assert len(boxes) == len(truth)
    for left, top, right, bottom in np.round(boxes).astype(int).clip(0):
        assert not is_label[top:bottom, left:right].any()
    browser.until("review.state.refusal === null && review.state.tre95_m < 1e-3")
    # Of two markers on one mark the hint tells, and a drag takes the one that is selected.
    first = hand.state("review.state.markers[0].label")
    browser.run(f"review.step({{do: 'move_marker', marker: '{first}', to: {places[1].tolist()}}})")
    browser.until(f"document.getElementById('hint').textContent.startsWith('{first} and ')")
    taken = []
    while 0 not in taken or len(taken) < 2:  # a click on the selected one takes the one beneath
        hand.click(places[1])
        taken.append(hand.state("review.selected.key"))
        assert len(taken) < 5
    while hand.state("review.selected.key") != 0:
        hand.click(places[1])
    hand.drag(places[1], places[0])
    browser.until("document.getElementById('hint').textContent === ''")
    assert np.abs(hand.state("review.state.markers[0].place_px") - places[0]).max() < 1.0


def test_push_feels_what_the_robot_will_render(browser, opened):
    """Each tick of a given way to the bit, and a hand that presses is told the force."""
    hand = opened(SLICE, *MARKERS, "--pixel-spacing", 0.5)
    browser.until("review.state.digest")
    browser.key("u")
    browser.until("review.push.engine !== null")
    session = Session.open(SLICE, *MARKERS, pixel_spacing_mm=(0.5, 0.5))
    start = session.current.geometry.strokes[0].points[200]
    path = start + np.array([[0.0, -40], [0, 4], [20, 6], [-30, 3]])
    ways = [f"moveTo(review.push.inRobot({place}), 60)" for place in path.tolist()]
    calls = ", ".join(f"review.push.engine.{way}" for way in ways)
    answers = browser.run(f"[{calls}].map((answer) => [...answer.proxy, ...answer.force])")
    shown = session.current
    path = np.array([row[0] * path[:, 0] + row[1] * path[:, 1] + row[2] for row in shown.plane]).T
    engine, before = vfplan.ProxyEngine.of(shown.fixture), path[0]
    engine.reset(before)
    for to, answer in zip(path, answers, strict=True):
        for k in range(1, 61):
            step = engine.step(before + ((to - before) * k) / 60)
        assert [*step.proxy, *step.force] == answer
        before = to
    assert np.linalg.norm(answers[-1][3:]) > 1.0
    for way in np.linspace(-40, 32, 20):
        browser.press(*hand.at((start[0], start[1] + way)), "mouseMoved", "none")
        time.sleep(0.05)
    felt = browser.until(FELT)
    assert float(felt.split()[0]) > 1.0
    # The arrow's head stays on the stage, and its newtons stand beside it.
    top = "document.querySelector('{}').getBoundingClientRect().top"
    assert browser.run(f"{top.format('.tool-force')} > {top.format('#stage')}")
    assert browser.run("document.querySelector('.tool-newtons').textContent").endswith(" N")
    # A hand that leaves the stage and comes back on the other side drags no tool along.
    silent = f"{FELT} === ''"
    browser.press(*browser.run("[innerWidth - 30, innerHeight / 2]"), "mouseMoved", "none")
    browser.until(silent)
    browser.press(*hand.at((start[0], start[1] + 60)), "mouseMoved", "none")
    assert float(browser.until(FELT).split()[0]) == 0.0
    # In a window of another size the hand is elsewhere, until it moves.
    browser.size(1300, 840)
    browser.until(f"{silent} && document.getElementById('push').childElementCount === 0")
    # A plan that is refused is felt no longer, and the hint says why.
    label = session.current.fit.markers[2].label
    browser.run(f"review.step({{do: 'move_marker', marker: '{label}', to: [600, 300]}})")
    browser.until(f"{silent} && review.state.refusal !== null")
    browser.until("document.getElementById('hint').textContent.startsWith('No plan yet: ')")
    browser.key("Escape")
    browser.until("document.getElementById('push').childElementCount === 0")


@pytest.mark.slow
def test_a_slice_of_a_folder_is_chosen_by_scrolling_and_drawn_on(browser, opened, tmp_path):
    hand = opened(ct_series(tmp_path / "ct"))
    stack = hand.state("review.state.image")
    assert (stack["series"], stack["position"]) == (["CT 1"] * 6 + ["CT 2"] * 5, 3)
    # A window stays at its values, also behind slices that do not hold them.
    hand.fill("#low", 30_000, "input")
    window = browser.run(WINDOW)
    for way, position in ((100, 5), (-100, 3), (100, 5)):
        browser.run(
            "for (let k = 0; k < 2; k += 1) document.getElementById('stage').dispatchEvent("
            f"new WheelEvent('wheel', {{deltaY: {way}, shiftKey: true, cancelable: true}}))"
        )
        browser.until(f"review.state.image.position === {position}")
        assert position == 5 or browser.run(WINDOW) == window
    assert hand.state("review.state.image.name").endswith("-5.dcm")
    hand.fill("#series", "CT 2")
    browser.until("review.state.image.position === 8")
    hand.fill("#plan-distance", "3,5")
    browser.until("review.state.plan.contact_radius === 0.0035")
    browser.picture(tmp_path / "stack.png")
    browser.key("d")
    for place in ((40, 40), (110, 90), (180, 60)):
        hand.click(place)
    browser.key("Enter")
    browser.until("review.state.curve_px.length === 1")
    hand.finish()
    assert hand.program.wait(timeout=30) == 0
    chosen = next((tmp_path / "ct").glob("2-*-2.dcm"))
    known = vfplan.read_fixture(tmp_path / "o.h5").provenance
    image = vfplan.read_image(chosen)
    assert known.inputs["image"] == image.sha256
    z_mm = 1e3 * image.T_patient_image[2, 2]
    words = f"{chosen.name}, slice 3 of 5, its middle at patient z = {z_mm:.2f} mm"
    assert known.settings["slice_in_words"] == words
    # The folder is searched for the bundle's slice.
    again = Session.open(tmp_path / "o.h5", slice=tmp_path / "ct")
    assert again.source.slice_path == chosen
    assert again.current.fixture.provenance.settings == known.settings
    (tmp_path / "empty").mkdir()
    with refuses(ImageError, "another-slice"):
        Session.open(tmp_path / "o.h5", slice=tmp_path / "empty")
