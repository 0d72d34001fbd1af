"""Draw the pictures of docs/howto/review.md: the review page in each of its states.

    python docs/make_review.py        needs chromium (apt-get install chromium)

The page is driven by the test suite's own browser, as a person would: clicks, drags and keys.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from vfplan.review.server import Draft, ReviewServer
from vfplan.review.session import Session

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from chromium import Page  # noqa: E402
from hand import Hand  # noqa: E402

PICTURES = ROOT / "docs" / "pictures"
SLICE = ROOT / "samples" / "elbow.png"
MARKERS = (ROOT / "samples/elbow_markers_image.csv", ROOT / "samples/elbow_markers_robot.csv")
TRUTH = np.array(json.loads((ROOT / "samples" / "elbow_truth.json").read_text())["curve_px"])
PEN_BGR = [32, 25, 232]
"""Colour of the sample's pen, blue first."""
JPEG_QUALITY = 88


class Film:
    """One review on a page, photographed."""

    def __init__(self, folder: Path, *files: Path) -> None:
        self._folder = Path(tempfile.mkdtemp(dir=folder))
        session = Session.open(*files, pixel_spacing_mm=0.5)
        draft = Draft(self._folder / "draft.json", {}, {})
        self._server = ReviewServer(session, draft, by="A. Surgeon")
        self.browser = Page(shutil.which("chromium"), self._folder / "profile")
        self.hand = Hand(self.browser, self._server.address)

    def __enter__(self) -> Film:
        return self

    def __exit__(self, *_: object) -> None:
        self.browser.__exit__()
        self._server.close()

    def shoot(self, name: str) -> None:
        """Write docs/pictures/NAME.jpg once the page rests."""
        time.sleep(1.0)
        path = self._folder / f"{name}.png"
        self.browser.picture(path)
        picture = cv2.imread(str(path))
        cv2.imwrite(
            str(PICTURES / f"{name}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        )
        print(f"wrote {PICTURES / name}.jpg")


def drawn(folder: Path, name: str, *lines: np.ndarray, box: tuple[int, ...] = ()) -> Path:
    """The sample with further lines of the same pen, or a grey box over a part of it."""
    picture = cv2.imread(str(SLICE))
    for line in lines:
        places = np.rint(line * 16).astype(np.int32)[:, None]
        cv2.polylines(picture, [places], False, PEN_BGR, 3, cv2.LINE_AA, shift=4)
    if box:
        u, v, width, height = box
        picture[v : v + height, u : u + width] = 96
    path = folder / name
    cv2.imwrite(str(path), picture)
    return path


def bend(start: np.ndarray, *steps: tuple[float, float]) -> np.ndarray:
    """A smooth line from a place by steps [px]."""
    corners = np.vstack([start, start + np.cumsum(steps, axis=0)])
    places = np.linspace(0, len(corners) - 1, 200)
    u = np.interp(places, range(len(corners)), corners[:, 0])
    v = np.interp(places, range(len(corners)), corners[:, 1])
    line = np.column_stack([u, v])
    return cv2.GaussianBlur(line, (1, 41), 0, borderType=cv2.BORDER_REPLICATE)


def sample(folder: Path) -> None:
    """The sample as it opens, in light and dark; a finding; approved."""
    with Film(folder, SLICE, *MARKERS) as film:
        film.shoot("review_page")
        film.browser.dark()
        film.hand.look_along()
        knot = film.hand.state("review.state.knots_px[0][9]")
        film.browser.run(f"review.view.goTo({knot}, 4)")
        film.hand.click(knot)
        film.shoot("review_page_knot")


def push(folder: Path) -> None:
    """The mouse is the tool, held 5 mm behind the wall: the proxy stays outside."""
    with Film(folder, SLICE, *MARKERS) as film:
        film.browser.until("review.state.digest")
        place = film.hand.state("review.state.curve_px[0][300]")
        film.browser.run(f"review.view.goTo({place}, 3)")
        film.browser.key("u")
        film.browser.until("review.push.engine !== null")
        for way in np.linspace(-40, 10, 30):
            where = film.hand.at((place[0], place[1] + way))
            film.browser.press(*where, "mouseMoved", "none")
            time.sleep(0.03)
        film.shoot("review_page_push")


def fork(folder: Path) -> None:
    """A refused slice: the branches to choose from; then the curve is drawn by clicks."""
    branch = bend(TRUTH[520], (20, 45), (60, 50), (90, 10))
    with Film(folder, drawn(folder, "fork.png", branch)) as film:
        film.shoot("review_page_fork")
        film.browser.key("f")
        film.browser.key("d")
        for place in TRUTH[5:640:70]:
            film.hand.click(place)
        film.browser.press(*film.hand.at(TRUTH[640]), "mouseMoved", "none")
        film.shoot("review_page_draw")


def hidden(folder: Path) -> None:
    """The end lies under a grey box: the inset shows it, and the rest is drawn by hand."""
    end = TRUTH[-1]
    box = (int(end[0]) - 34, int(end[1]) - 40, 60, 60)
    with Film(folder, drawn(folder, "hidden.png", box=box), *MARKERS) as film:
        last = film.hand.state("review.state.curve_px[0].at(-1)")
        film.browser.run(f"review.view.goTo({last}, 6)")
        film.shoot("review_page_hidden")
        film.browser.key("d")
        for place in (last, TRUTH[-20], TRUTH[-1]):
            film.hand.click(place)
        film.browser.key("Enter")
        film.browser.until("review.state.edited[0].length > 0")
        film.shoot("review_page_hidden_drawn")


def marker(folder: Path) -> None:
    """A misplaced marker: its residual, the gate that refuses it, and home again."""
    with Film(folder, SLICE, *MARKERS) as film:
        place = film.hand.state("review.state.markers[3].place_px")
        film.hand.drag(place, (place[0] + 9, place[1] - 7))
        film.hand.until_steps(1)
        film.browser.run("document.getElementById('marker-table').scrollIntoView()")
        film.shoot("review_page_marker")


def other_ink(folder: Path) -> None:
    """Ink that is not the curve, and a doubt to answer."""
    letter = bend(TRUTH[-1] + [12, 4], (14, 12), (22, -4), (14, 8))
    with Film(folder, drawn(folder, "ink.png", letter), *MARKERS) as film:
        film.hand.look_along()
        film.browser.key("n")
        film.shoot("review_page_finding")


def main() -> None:
    """Every picture."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for state in (sample, push, fork, hidden, marker, other_ink):
            state(folder)


if __name__ == "__main__":
    main()
