"""Draw lines by hand, and print how often their stated 95 % bound holds, by kind of drawing:

    python docs/make_drawn_bound.py [PLANS_A_KIND=20 [FIRST_SEED=0]]
    python docs/make_drawn_bound.py numbers    what five numbers of curve and review rest on

The slices are those of `tests/making/as_people_draw.py`, and lines at whose end other ink of the
pen begins. A hand draws each line by clicks every 30 px, 1.5 px off. In % are the ends that lie
within the largest bound of their line (*ends*), the lines that lie within it everywhere (*curve*),
and those of which each point and each end lies within the bound that is stated there (*along*).
Then come the largest error of a line, its largest bound and its usual one, by median [px].
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "making"))
import as_people_draw
import extraction_kinds
from drawing import blend, coverage, flat, polyline, to_uint8
from slices import RED, SHAPE, Family, _begin, direction, drawn, turned

from vfplan.curve import account, tuned
from vfplan.curve.extraction import extract_curve
from vfplan.errors import CurveError
from vfplan.registration.registration import own_bound
from vfplan.review import strokes
from vfplan.review.strokes import REACH_PX, SliceInk, path_through

CLICK_PX, OFF_PX = 30.0, 1.5


def label_at_an_end(canvas, rng):
    """The letters begin on the end of the line."""
    curve, _ = drawn(canvas, rng)
    at = curve[-1] + [rng.uniform(-12, 0), rng.uniform(0, 14)]
    words = rng.choice(as_people_draw.WORDS)
    canvas.text(words, at, RED, rng.uniform(0.4, 0.7), int(rng.integers(1, 3)))
    return curve


def arrow_at_an_end(canvas, rng):
    """An arrow's tip lies on the end of the line."""
    curve, width = drawn(canvas, rng)
    back = turned(direction(curve), rng.uniform(0.6, 2.5) * rng.choice([-1, 1]))
    for angle, length in ((0, rng.uniform(50, 90)), (-0.4, 12), (0.4, 12)):
        canvas.line([curve[-1], curve[-1] + length * turned(back, angle)], width, RED)
    return curve


AT_AN_END = {"label at an end": label_at_an_end, "arrow at an end": arrow_at_an_end}
KINDS = as_people_draw.KINDS | AT_AN_END
draw = Family(KINDS, {}, _begin).draw


@dataclass
class Result:
    """A line as it was drawn, and how far it lies off the true one [px].

    error, bound: (M,) at each point
    end_error: (2,) from each true end, (0,) of a ring
    turn_deg: the sharpest turn within the reach of an end
    """

    error: np.ndarray
    bound: np.ndarray
    end_error: np.ndarray
    turn_deg: float

    @property
    def ends(self):
        """Whether each end lies within the line's largest bound."""
        return self.end_error <= self.bound.max()

    @property
    def curve(self):
        """Whether all of the line does."""
        return self.error.max() <= self.bound.max()

    @property
    def along(self):
        """Whether each point and each end lies within the bound that is stated there."""
        ends = self.end_error <= self.bound[[0, -1]][: len(self.end_error)]
        return bool((self.error <= self.bound).all() and ends.all())


def result_of(kind, seed):
    """Draw the line of one slice by hand."""
    slice_ = draw(kind, seed)
    truth, closed = slice_.truth, slice_.closed
    rng = np.random.default_rng([seed, 3])
    fine = polyline(truth, closed, 0.02)
    count = max(6, round(0.02 * len(fine) / CLICK_PX))
    clicks = fine[np.linspace(0, len(fine) - 1, count + closed).astype(int)[:count]]
    angle = rng.uniform(0, 2 * np.pi, count)
    clicks = clicks + OFF_PX * np.column_stack([np.cos(angle), np.sin(angle)])
    clicks = np.clip(clicks, 0, np.array(slice_.image.shape[1::-1]) - 1)
    path = path_through(clicks, closed)
    line = SliceInk(slice_.image, "red").draw(path, closed, REACH_PX, (True, True))
    error = cKDTree(fine).query(line.points)[0]
    ends = np.empty(0) if closed else np.hypot(*(line.end_points - truth[[0, -1]]).T)
    step = np.diff(line.points[::2], axis=0)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(*step.T))))
    return Result(error, own_bound([line]), ends, np.degrees(turn[-int(REACH_PX) :].max()))


def row(results):
    """What a row of the table says."""
    ends = np.concatenate([r.ends for r in results])
    shares = (
        ends.mean() if len(ends) else np.nan,
        *(np.mean([getattr(r, name) for r in results]) for name in ("curve", "along")),
    )
    sizes = np.median([(r.error.max(), r.bound.max(), np.median(r.bound)) for r in results], axis=0)
    cells = *(f"{100 * share:.1f}" for share in shares), *(f"{size:.2f}" for size in sizes)
    return f"{len(results)} | {' | '.join(cells)}"


def print_table(count, first):
    """Print what holds, by kind."""
    print("| kind | plans | ends | curve | along | error | largest bound | usual bound |")
    print("|---" * 8 + "|")
    every = []
    for kind in KINDS:
        results = [result_of(kind, seed) for seed in range(first, first + count)]
        every += results
        print(f"| {kind} | {row(results)} |", flush=True)
    print(f"| all | {row(every)} |")


def holds_at_corner(turn_deg, gap_px):
    """Whether the bound of a line holds whose pen was lifted at a corner; `None` if refused."""
    corner, half = np.array([170.3, 130.7]), np.radians(turn_deg) / 2
    ways = np.array([[-np.cos(half), np.sin(half)], [np.cos(half), np.sin(half)]])
    legs = [corner + np.linspace(0, 130, 200)[:, None] * way for way in ways]
    lift = (gap_px + 3.0) / 2 / np.cos(half)
    shown = [leg[np.hypot(*(leg - corner).T) > lift] for leg in legs]
    share = np.maximum(*(coverage(SHAPE, leg, 3.0) for leg in shown))
    try:
        lines = extract_curve(to_uint8(blend(flat(SHAPE), share, RED)), max_gap_px=50.0).strokes
    except CurveError:
        return None
    found = np.vstack([polyline(line.points, False, 0.1) for line in lines])
    truth = np.vstack([legs[0][::-1], legs[1]])[20:-20]
    return cKDTree(found).query(truth)[0].max() <= own_bound(lines).max()


def sharp_corners(kinds, count=30, first=9000):
    """How many slices of these kinds have a doubt on a corner near an end, and how many it is of.

    Slices that are refused, or about which another doubt asks, do not count.
    """
    asked, slices = 0, 0
    for kind in kinds:
        for seed in range(first, first + count):
            try:
                found = extract_curve(extraction_kinds.draw(kind, seed).image).findings
            except CurveError:
                continue
            codes = {finding.code for finding in found if finding.is_open} - {"leaves-picture"}
            slices += codes <= {"corner-near-end"}
            asked += codes == {"corner-near-end"}
    return f"{asked} of {slices}"


def with_values(room, name, values):
    """A number of a room at each of these values, and then as it was."""
    own = getattr(room, name)
    for value in values:
        setattr(room, name, value)
        print(f"{name} {value:g}: ", end="", flush=True)
        yield
    setattr(room, name, own)


def print_numbers():
    """Print what the stated measurements of numbers are with other values of them."""
    for _ in with_values(tuned, "CORNER_SIGMAS", (1.0, 1.25, 1.5, 2.0)):
        every = [
            holds_at_corner(turn, gap)
            for turn in np.linspace(5, 100, 20)
            for gap in (6.0, 10.0, 14.0, 18.0, 24.0, 32.0, 40.0)
        ]
        made = [holds for holds in every if holds is not None]
        print(f"{sum(made)} of {len(made)} lifts keep their bound")
    for _ in with_values(strokes, "ONTO_PATH_POINTS", (0, 3, 6, 12, 24)):
        turns = [result_of(kind, seed).turn_deg for kind in AT_AN_END for seed in range(30)]
        print(f"95 % turn by at most {np.quantile(turns, 0.95):.0f} deg")
    print(
        "plans | ends | curve | along | error | largest bound | usual bound, as in the table, with"
    )
    for name, values in (("HAND_SIGMAS", (1.5, 3, 6, np.inf)), ("FADE_POINTS", (5, 20, 80))):
        for _ in with_values(strokes, name, values):
            print(row([result_of(kind, seed) for kind in KINDS for seed in range(20)]))
    for _ in with_values(account, "HOOK_DEG", (45, 55, 65, 75, 85)):
        clear = sharp_corners(extraction_kinds.CLEAR, count=10)
        letters = sharp_corners(["letter at an end"])
        print(f"asked about are {clear} clear slices, {letters} letters at an end")


def main(words):
    """Print the table, or the numbers."""
    if "numbers" in words:
        print_numbers()
        return
    numbers = iter(map(int, words))
    print_table(next(numbers, 20), next(numbers, 0))


if __name__ == "__main__":
    main(sys.argv[1:])
