"""The HTML report holds all it needs, its numbers are the replay's, and it works in a browser."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from chromium import Page
from conftest import need_program
from replays import fixture_of, line, probing

from vfplan.errors import OutputError
from vfplan.replaying import replay
from vfplan.report import write_report
from vfplan.report.page import page
from vfplan.report.scrubber import scrubber_data
from vfplan.robot import read_robot


@pytest.fixture(scope="module")
def pressed():
    limits = (("force_max_n", "at_most", 3.0),)
    robot = read_robot("franka")
    return replay(fixture_of(line()), probing(), rule="both", robot=robot, limits=limits)


@pytest.fixture(scope="module")
def written(pressed, tmp_path_factory):
    return write_report(pressed, tmp_path_factory.mktemp("report") / "out")


class Links(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        self.found += [v for k, v in attrs if k in ("src", "href", "srcset", "action", "data")]


def test_page_is_one_file_that_refers_to_nothing(written):
    assert [p.name for p in written.parent.iterdir()] == ["index.html"]
    text = written.read_text()
    links = Links()
    links.feed(text)
    assert links.found
    assert all(link.startswith("data:image/png;base64,") for link in links.found)
    assert not re.search(r"https?://|@import|url\(", text)
    assert "default-src 'none'" in text


def test_numbers_and_verdict_are_the_replays(pressed, written):
    text = written.read_text()
    assert "FAIL: 1 of 4 limits" in text
    assert f"{pressed.metrics['force_max_n']:.3f}" in text
    assert text.count('class="go"') == len(pressed.metrics["episodes"]) == 4


def test_scrubber_holds_the_ticks(pressed):
    data = scrubber_data(pressed)
    assert data["dims"] == 2
    assert len(data["time"]) == 3000
    np.testing.assert_allclose(data["depth"], 1e3 * pressed.ticks.penetration, atol=1e-4)
    hip = np.reshape(data["hip"], (-1, 2)) - np.reshape(data["proxy"], (-1, 2))
    np.testing.assert_allclose(np.hypot(*hip.T), data["depth"], atol=2e-3)


def test_text_from_outside_cannot_become_markup(pressed):
    evil = "</script><b onload=alert(1)>"
    session = {**pressed.metrics["session"], "name": evil}
    changed = type(pressed)(
        pressed.rule, pressed.engine, pressed.ticks, {**pressed.metrics, "session": session},
        pressed.fixture,
    )  # fmt: skip
    assert evil not in page(changed)


def test_report_is_not_overwritten(pressed, written):
    before = written.read_bytes()
    with pytest.raises(OutputError, match="exists already"):
        write_report(pressed, written.parent)
    write_report(pressed, written.parent, overwrite=True)
    step = rb"<td>time a tick.*?</tr>"
    assert re.sub(step, b"", written.read_bytes()) == re.sub(step, b"", before)


def test_in_a_browser(pressed, written, tmp_path):
    program = need_program("chromium", "chromium")
    with Page(program, tmp_path / "profile") as browser:
        browser.open(written.as_uri())
        spoken = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
        problems = [e for e in browser.events if e["method"] in spoken]
        assert problems == []
        asked = [
            e["params"]["request"]["url"][:40]
            for e in browser.events
            if e["method"] == "Network.requestWillBeSent"
        ]
        assert all(url.startswith(("file:", "data:")) for url in asked), asked
        assert sum(url.startswith("file:") for url in asked) == 1
        check_scrubber(browser, pressed)
        printed = browser.do("Page.printToPDF", printBackground=True, preferCSSPageSize=True)
        pdf = base64.b64decode(printed["data"])
        assert pdf.startswith(b"%PDF")
        assert 2 <= pdf.count(b"/Type /Page\n") <= 8
        boxes = {tuple(map(float, b.split())) for b in re.findall(rb"/MediaBox \[(.*?)\]", pdf)}
        (a4,) = boxes
        assert a4 == pytest.approx((0, 0, 210 / 25.4 * 72, 297 / 25.4 * 72), abs=1)


def check_scrubber(browser, pressed):
    """The slider moves the picture and the read-out; an episode's button goes to its deepest."""
    picture = "document.getElementById('view').toDataURL()"
    readout = "document.getElementById('readout').textContent"
    deepest = pressed.metrics["penetration_max_m"]
    assert f"|proxy − HIP| = {1e3 * deepest:.3f} mm" in browser.run(readout)
    seen = set()
    for tick in (0, 375, 500, 2999):
        browser.run(
            f"(() => {{ const s = document.getElementById('time'); s.value = {tick}; "
            "s.dispatchEvent(new Event('input')); })()"
        )
        time = pressed.ticks.time[tick]
        assert f"t = {time:.3f} s" in browser.run(readout)
        assert f"{1e3 * pressed.ticks.penetration[tick]:.3f} mm" in browser.run(readout)
        seen.add(browser.run(picture))
    assert len(seen) == 4
    browser.run("document.querySelectorAll('button.go')[2].click()")
    at = pressed.metrics["episodes"][2]["deepest"]["t_s"]
    assert f"t = {at:.3f} s" in browser.run(readout)
    browser.run("document.getElementById('follow').click()")
    assert browser.run(picture) not in seen
    drawn = json.loads(
        browser.run(
            "JSON.stringify(Array.from(document.images).map(i => [i.complete, i.naturalWidth]))"
        )
    )
    assert all(complete and width > 300 for complete, width in drawn)
    assert browser.run("document.documentElement.scrollWidth <= window.innerWidth")
