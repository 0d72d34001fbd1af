"""The HTML report holds all it needs, its numbers are the replay's, and it works in a browser."""

from __future__ import annotations

import base64
import re
from dataclasses import replace

import bundles
import numpy as np
import pytest
from chromium import Page
from conftest import need_program
from replays import at_1_khz, fixture_of, line, probing

import vfplan
from vfplan.figures.replay import timeline
from vfplan.fixture import Guidance
from vfplan.replaying.link import Link
from vfplan.replaying.metrics import unit_of
from vfplan.replaying.replay import replay
from vfplan.report.page import envelope, page, scrubber_data, settings_table
from vfplan.robot import read_robot


@pytest.fixture(scope="module")
def pressed():
    limits = (("force_max_n", "at_most", 3.0),)
    robot = read_robot("franka")
    return replay(fixture_of(line()), probing(), rule="both", robot=robot, limits=limits)


@pytest.fixture(scope="module")
def written(pressed, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "index.html"
    path.write_text(page(pressed, command="vfplan replay 'a b.h5' s.csv"), "utf-8")
    return path


def test_page_is_one_file_that_refers_to_nothing_and_has_a_review_sheet(written):
    text = written.read_text()
    links = re.findall(r'\b(?:src|href|srcset|action)="([^"]*)"', text)
    assert links
    assert all(link.startswith("data:image/png;base64,") for link in links)
    assert not re.search(r"https?://|@import|url\(", text)
    assert "default-src 'none'" in text
    assert text.count('class="sheet"') == 1
    assert "What was planned" in text


def test_page_opens_with_verdict_slice_and_force_and_ends_with_the_hashes(written):
    text = written.read_text()
    titles = re.findall("<h2>(.*?)</h2>", text)
    assert text.index('class="verdict') < text.index("<h2>")
    assert titles[:2] == ["In space", "Over time"]
    assert titles[-2:] == ["What was replayed", "About this page"]


def test_page_says_when_how_and_of_what_it_was_made(pressed, written, tmp_path):
    text = written.read_text()
    about = text[text.index("About this page") :]
    assert re.search(r"made</td><td>.*\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", about)
    assert f"vfplan {vfplan.__version__}" in about
    assert "vfplan replay &#x27;a b.h5&#x27; s.csv" in about
    assert "made in memory" in about
    assert not re.search(">(?:True|False)<", text)
    assert settings_table({"a": "", "b": {"c": 0}, "d": -5e-16}) == settings_table({"d": 0})
    replayed = replay(bundles.stored(tmp_path / "f.h5", bundles.whole()), probing())
    digest = replayed.metrics["fixture"]["sha256"]
    before, about = page(replayed).split("About this page")
    assert 'class="digest"' not in before.split("What was replayed")[0]
    assert "f.h5" in about
    assert f'<code class="digest">{digest}' in about


def test_verdict_and_numbers_are_the_replays_with_rules_compared_and_units(pressed, written):
    text = written.read_text()
    told = "never beyond the drawn line; 1 of 4 limits broken: largest force at most 3 N; held: "
    assert f"FAIL: {told}" in text
    assert f"{pressed.metrics['force_max_n']:.3f}" in text
    assert re.findall('class="go".*?>(.*?)<', text) == ["1", "2", "3", "4"]
    assert [episode[2] for episode in scrubber_data(pressed)["episodes"]] == [1, 2, 3, 4]
    row = re.search(r"<tr><td[^>]*>largest force</td>(.*?)</tr>", text)[1]
    robust, paper, unit = re.findall(r"<td[^>]*>(.*?)</td>", row)
    assert float(robust) == pytest.approx(pressed.metrics["force_max_n"], abs=1e-3)
    assert float(paper) == pytest.approx(pressed.metrics["paper"]["force_max_n"], abs=1e-3)
    assert unit == "N"
    assert f"{1e6 * pressed.metrics['scene']['band_m']:.2f}" in text
    assert "largest speed of the tool tip is 0.0" in text
    assert " m/s, at most 2 m/s is allowed" in text
    assert [unit_of(n) for n in ("energy_j", "k_n_per_m", "too_fast_ticks", "friction")] == [
        "J", "N/m", "ticks", ""]  # fmt: skip


def test_a_margin_is_not_beyond_the_line():
    limits = (("force_max_n", "at_most", 20.0),)
    for depth, told, shown in ((2e-3, 'beyond">PASS: up to 2.00 mm', 2.0),
                               (-5e-4, 'pass">PASS: never', 5.5)):  # fmt: skip
        hip = np.linspace([0.05, 0.02, 0], [0.05, -depth, 0], 300)
        replayed = replay(fixture_of(line(), rv=1e-3), at_1_khz(hip), limits=limits)
        assert f"{told} beyond the drawn line; " in page(replayed)
        drawn = timeline(replayed).axes[1].get_lines()[-1].get_ydata().max()
        highest = max(scrubber_data(replayed)["zooms"][-1]["depth_high"])
        assert (drawn, highest) == pytest.approx((shown, shown), abs=1e-3)


def test_an_envelope_holds_every_tick(pressed):
    ticks, span = pressed.ticks, (0.5, 1.5)
    found = envelope(ticks, span, 37)
    inside = (ticks.time >= span[0]) & (ticks.time <= span[1])
    force = np.linalg.norm(ticks.force, axis=1)[inside]
    assert len(found["time"]) == 37
    starts = np.searchsorted(ticks.time[inside], np.array(found["time"]) - 1e-9)
    for part, low, high in zip(np.split(force, starts[1:]), found["force_low"],
                               found["force_high"], strict=True):  # fmt: skip
        assert (low, high) == pytest.approx((part.min(), part.max()), abs=1e-4)
    few = envelope(ticks, (0.0, 0.01), 400)
    assert few["time"] == pytest.approx(ticks.time[ticks.time <= 0.01])


def test_scrubber_holds_the_ticks(pressed):
    data = scrubber_data(pressed)
    assert (len(data["time"]), data["limits"]) == (3000, [3.0])
    np.testing.assert_allclose(data["depth"], 1e3 * pressed.ticks.penetration, atol=1e-4)
    hip = np.reshape(data["hip"], (-1, 2)) - np.reshape(data["proxy"], (-1, 2))
    np.testing.assert_allclose(np.hypot(*hip.T), data["depth"], atol=2e-3)


def test_the_page_has_an_engine_where_that_made_the_ticks_alone(pressed):
    guided = replace(fixture_of(line()), guidance=Guidance(1e-3, 1000.0))
    replayed = replay(guided, probing())
    data = scrubber_data(replayed)
    assert (len(data["played"]["bodies"]), data["forbids"]) == (1, False)
    assert "rule robust" not in page(replayed)
    assert timeline(replayed).axes[0].get_title("left").endswith(", guide")
    for more in ({"link": Link(delay_ticks=2)}, {"governor": read_robot("franka")}):
        assert scrubber_data(replay(pressed.fixture, probing(), **more))["played"] is None
    linked = replay(guided, probing(), link=Link(delay_ticks=2))
    assert "lossy link: 2 ticks late, seed 0.</p>" in page(linked)


def test_text_from_outside_cannot_become_markup(pressed):
    evil = "</script><b onload=alert(1)>"
    session = {**pressed.metrics["session"], "name": evil}
    assert evil not in page(replace(pressed, metrics=pressed.metrics | {"session": session}))


def test_the_same_replay_gives_the_same_page(pressed, written):
    anew = r"<td[^>]*>time a tick.*?</tr>|made</td>.*?</tr>|<tr><td>command.*?</tr>"
    assert re.sub(anew, "", page(pressed)) == re.sub(anew, "", written.read_text())


BREAK_IN_LIMITS = "getComputedStyle(document.querySelector('b.fail').closest('table')).breakInside"


def test_in_a_browser(pressed, written, tmp_path):
    with Page(need_program("chromium", "chromium"), tmp_path / "profile") as browser:
        browser.open(written.as_uri())
        spoken = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
        assert [e for e in browser.events if e["method"] in spoken] == []
        assert browser.run("document.querySelectorAll('main > section').length") >= 6
        asked = [e["params"]["request"]["url"][:40] for e in browser.events
                 if e["method"] == "Network.requestWillBeSent"]  # fmt: skip
        assert all(url.startswith(("file:", "data:")) for url in asked), asked
        assert sum(url.startswith("file:") for url in asked) == 1
        check_scrubber(browser, pressed)
        check_zoom(browser, pressed)
        check_engine(browser)
        check_hands_and_eyes(browser)
        shape = "view.clientWidth / view.clientHeight"
        on_screen = browser.run(shape)
        browser.do("Emulation.setEmulatedMedia", media="print")
        assert browser.run(shape) == pytest.approx(on_screen, rel=0.02)
        assert browser.run(BREAK_IN_LIMITS) == "avoid"
        printed = browser.do("Page.printToPDF", printBackground=True, preferCSSPageSize=True)
        pdf = base64.b64decode(printed["data"])
        assert pdf.startswith(b"%PDF")
        assert 2 <= pdf.count(b"/Type /Page\n") <= 8
        (a4,) = {tuple(map(float, b.split())) for b in re.findall(rb"/MediaBox \[(.*?)\]", pdf)}
        assert a4 == pytest.approx((0, 0, 210 / 25.4 * 72, 297 / 25.4 * 72), abs=1)


# How far the force's pixels reach above the middle of the scene [px].
ABOVE_MIDDLE = """Math.max(
...[...view.getContext("2d").getImageData(view.width / 2, 0, 1, 999).data]
.map((value, i) => (i % 4 === 0 && value === 0x22 ? view.height / 2 - i / 4 : -1e9)))"""


def check_scrubber(browser, pressed):
    """The slider moves the picture and the read-out; an episode's button goes to its deepest."""
    picture, readout = "view.toDataURL()", "readout.textContent"
    deepest = pressed.metrics["penetration_max_m"]
    assert f"penetration = {1e3 * deepest:.3f} mm" in browser.run(readout)
    seen = set()
    for tick in (0, 375, 500, 2999):
        browser.run(f"time.value = {tick}, time.dispatchEvent(new Event('input'))")
        assert f"t = {pressed.ticks.time[tick]:.3f} s" in browser.run(readout)
        assert f"{1e3 * pressed.ticks.penetration[tick]:.3f} mm" in browser.run(readout)
        seen.add(browser.run(picture))
    assert len(seen) == 4
    browser.run("document.querySelectorAll('button.go')[2].click()")
    at = pressed.metrics["episodes"][2]["deepest"]["t_s"]
    assert f"t = {at:.3f} s" in browser.run(readout)
    browser.run("document.getElementById('follow').click()")
    assert browser.run(picture) not in seen
    # The force's arrow ends where its length says, 60 px at 2 N; the proxy is in the middle.
    deep = pressed.metrics["episodes"][2]
    mm = browser.run("Math.min(view.width, view.height)") / 40
    above = 60 * deep["force_max_n"] / 2 - 1e3 * deep["penetration_max_m"] * mm
    assert -3 < browser.run(ABOVE_MIDDLE) - above < 1
    assert browser.run("Array.from(document.images).every(i => i.complete && i.naturalWidth > 300)")
    assert browser.run("document.documentElement.scrollWidth <= window.innerWidth")


def check_engine(browser):
    """The page's engine gives the recorded ticks to the bit; then the mouse pushes."""
    told = browser.until("engine.textContent")
    assert "all 3000 proxies and forces are the recorded ones to the bit" in told
    browser.run("document.querySelector('[data-act=whole]').click()")
    browser.run("push.click(), view.scrollIntoView()")
    browser.move_down(0.6)
    felt = browser.until("readout.textContent", lambda text: "hand" in text)
    assert float(re.search(r"force = ([\d.]+) N", felt)[1]) > 0.5
    browser.run("push.click()")


def check_zoom(browser, pressed):
    """A choice shows one episode, the wheel and the keys change the stretch, 0 shows all again."""
    picture = "force.toDataURL()"
    assert browser.run("zoomed.options.length") == 1 + len(pressed.metrics["episodes"])
    seen = []
    for choice in ("whole", 0, 1):
        browser.run(f"zoomed.value = '{choice}', zoomed.dispatchEvent(new Event('change'))")
        seen.append(browser.run(picture))
    for key in ("-", "ArrowLeft"):
        press(browser, "force", key)
        seen.append(browser.run(picture))
    assert len(set(seen)) == 5
    press(browser, "force", "0")
    assert browser.run(picture) == seen[0]


def press(browser, element, key):
    browser.run(f"{element}.focus()")
    browser.key(key)


NAMELESS = """Array.from(document.querySelectorAll('button, input, select, canvas')).filter(
e => !(e.textContent.trim() || e.getAttribute('aria-label') || e.labels?.length)).length"""


def check_hands_and_eyes(browser):
    """Keys move the scene, controls have names, and 390 and 700 px in the dark hold the page."""
    before = browser.run("view.toDataURL()")
    press(browser, "view", "+")
    assert browser.run("view.toDataURL()") != before
    assert browser.run("document.activeElement === view")
    assert browser.run(NAMELESS) == 0
    light = browser.run("getComputedStyle(document.body).backgroundColor")
    browser.dark()
    assert browser.run("getComputedStyle(document.body).backgroundColor") != light
    for width in (390, 700):
        browser.size(width, 800)
        assert browser.run("document.documentElement.scrollWidth") == width
