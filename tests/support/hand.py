"""A person at the review page: looks, clicks, drags, types."""

from __future__ import annotations

import json
import time

READY = "Boolean(window.review && review.state && review.state.outline_px)"


class Hand:
    """A person at the page: places are pixels of the slice."""

    def __init__(self, browser, address):
        self.browser = browser
        browser.size(1300, 860)
        browser.open(address)
        browser.until(READY)

    def state(self, path="review.state"):
        return self.browser.run(path)

    def at(self, place):
        """Where a place of the slice is in the window."""
        box = self.browser.run(
            "(() => { const b = document.getElementById('stage').getBoundingClientRect();"
            " return [b.left, b.top, review.view.zoom, review.view.x, review.view.y]; })()"
        )
        left, top, zoom, x, y = box
        return left + place[0] * zoom + x, top + place[1] * zoom + y

    def click(self, place):
        self.browser.click(*self.at(place))

    def drag(self, start, stop):
        self.browser.drag(self.at(start), self.at(stop))

    def press(self, button, seconds=30):
        """Click on a button by its id or its words, until a click arrives there.

        What lies above it may grow under the mouse, and a disabled button takes no click.
        """
        end = time.monotonic() + seconds
        words = json.dumps(button)
        is_there = f"(one) => one && (one.id === {words} || one.textContent.startsWith({words}))"
        is_hit = f"({is_there})(window.hit?.closest('button, input, textarea'))"
        while True:
            self.browser.run(
                "window.hit = null; document.addEventListener('click',"
                " (event) => { window.hit = event.target; }, {capture: true, once: true})"
            )
            self.browser.click(*self.place_of(button))
            if self.browser.run(is_hit):
                return
            assert time.monotonic() < end, f"no click arrives at {button}"

    def place_of(self, button):
        """The middle of a button in the window, once two looks find it there and uncovered."""
        end = time.monotonic() + 10
        before = None
        while True:
            place = self.browser.run(
                f"(() => {{ const wanted = {json.dumps(button)};"
                " const node = document.getElementById(wanted) || [...document.querySelectorAll("
                "'button')].find((b) => b.offsetParent && b.textContent.startsWith(wanted));"
                " if (!node) return null; node.scrollIntoView({block: 'nearest'});"
                " const b = node.getBoundingClientRect();"
                " const middle = [b.left + b.width / 2, b.top + b.height / 2];"
                " return node.contains(document.elementFromPoint(...middle)) ? middle : null; })()"
            )
            if place is not None and place == before:
                return place
            assert time.monotonic() < end, f"{button} does not stand still and uncovered"
            before = place
            time.sleep(0.03)

    def until_steps(self, count):
        self.browser.until(f"review.state.steps.length === {count} && {READY}")

    def name(self):
        self.press("name")
        self.browser.type("A. Planner")

    def look_along(self):
        """Look along the line until all of it was in view."""
        for _ in range(60):
            if not any(self.state("review.state.unseen.map((runs) => runs.length)")):
                return
            # The button takes no click once all was in view, which may be now.
            self.browser.click(*self.place_of("look"))
            time.sleep(0.4)
        raise AssertionError(self.state("review.state.unseen"))

    def accept_all(self):
        """Accept each doubt in turn by its button."""
        open_doubts = (
            "review.state.findings.filter((f) => f.severity === 'doubt'"
            " && f.answered_by === null).length"
        )
        for _ in range(20):
            left = self.browser.until(f"{READY} ? [{open_doubts}] : null")[0]
            if not left:
                return
            self.press("Accept as it is")
            self.browser.until(f"{READY} && {open_doubts} === {left - 1}")

    def fill(self, field, value, event="change"):
        """Write into a field, or choose in a list, and leave it."""
        self.browser.run(
            f"(() => {{ const field = document.querySelector({json.dumps(field)});"
            " if (field.closest('details')) field.closest('details').open = true;"
            f" field.value = {json.dumps(value)}; field.dispatchEvent(new Event('{event}')); }})()"
        )

    def finish(self):
        """Look, accept and approve."""
        self.name()
        self.look_along()
        self.accept_all()
        self.approve()

    def approve(self):
        self.browser.until("review.state.approvable", seconds=30)
        self.press("approve")
        self.browser.until("document.getElementById('done').open")
