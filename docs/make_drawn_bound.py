"""Draw lines by hand, and print how often their stated 95 % bound holds, by kind of drawing:

    python docs/make_drawn_bound.py [PLANS_A_KIND=20 [FIRST_SEED=0]] [-v]

The slices are those of `tests/making/as_people_draw.py`, and lines at whose end other ink of the
pen begins. A hand draws each line by clicks every 30 px, 1.5 px off. *ends*: the share of ends that
lie within the largest bound of their line; *curve*: of lines that lie within it everywhere, *along*:
of lines of which each point and each end lies within the bound that is stated there. `-v` tells of
each line that does not where it lies farthest off.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "making"))
import as_people_draw
from drawing import polyline
from slices import RED, Family, _begin, direction, drawn, turned

from vfplan.registration.registration import own_bound
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


KINDS = as_people_draw.KINDS | {
    "label at an end": label_at_an_end,
    "arrow at an end": arrow_at_an_end,
}
draw = Family(KINDS, {}, _begin).draw


@dataclass
class Result:
    """How far a drawn line lies off the true one [px], and the bound that is stated there.

    error, bound: (M,) at each point
    end_error: (2,) from each true end, none of a ring
    """

    error: np.ndarray
    bound: np.ndarray
    end_error: np.ndarray
    line: object

    @property
    def ends_hold(self):
        return self.end_error <= self.bound.max()

    @property
    def curve_holds(self):
        return self.error.max() <= self.bound.max()

    @property
    def holds_along(self):
        ends = self.end_error <= self.bound[[0, -1]][: len(self.end_error)]
        return bool((self.error <= self.bound).all() and ends.all())


def clicks_on(slice_, rng):
    """Where a hand clicks along the true line of a slice."""
    truth = polyline(slice_.truth, slice_.closed, CLICK_PX)

    return truth


def result_of(kind, seed):
    """Draw the line of one slice."""
    slice_ = draw(kind, seed)
    truth, closed = slice_.truth, slice_.closed
    rng = np.random.default_rng([seed, 3])
    ring = np.vstack([truth, truth[:1]]) if closed else truth
    arc = np.r_[0, np.cumsum(np.hypot(*np.diff(ring, axis=0).T))]
    count = max(6, round(arc[-1] / CLICK_PX))
    at = np.linspace(0, arc[-1], count + closed)[:count]
    clicks = np.stack([np.interp(at, arc, ring[:, k]) for k in (0, 1)], 1)
    angle = rng.uniform(0, 2 * np.pi, count)
    clicks += OFF_PX * np.column_stack([np.cos(angle), np.sin(angle)])
    clicks = np.clip(clicks, 0, np.array(slice_.image.shape[1::-1]) - 1)
    path = path_through(clicks, closed)
    line = SliceInk(slice_.image, "red").draw(path, closed, REACH_PX, (True, True))
    error = cKDTree(polyline(truth, closed, 0.02)).query(line.points)[0]
    ends = np.empty(0) if closed else np.hypot(*(line.end_points - truth[[0, -1]]).T)
    return Result(error, own_bound([line]), ends, line)


def row(results):
    ends = np.concatenate([r.ends_hold for r in results])
    shares = [np.mean([getattr(r, n) for r in results]) for n in ("curve_holds", "holds_along")]
    shares = [ends.mean() if len(ends) else np.nan, *shares]
    bounds = [r.bound.max() for r in results], [np.median(r.bound) for r in results]
    error = [r.error.max() for r in results]
    cells = [f"{100 * s:.1f}" for s in shares] + [f"{np.median(v):.2f}" for v in (error, *bounds)]
    return f"{len(results)} | " + " | ".join(cells)


def main(words):
    """Print the table."""
    numbers = iter(int(word) for word in words if word.isdigit())
    count, first = next(numbers, 20), next(numbers, 0)
    print("| kind | plans | ends | curve | along | error | largest bound | usual bound |")
    print("|---" * 8 + "|")
    every = []
    for kind in KINDS:
        results = [result_of(kind, seed) for seed in range(first, first + count)]
        if "-v" in words:
            for seed, r in enumerate(results, first):
                if not r.holds_along:
                    i = int((r.error / r.bound).argmax()); j = int(r.error.argmax())
                    f=[''.join(c) for c in np.where([r.line.edited, r.line.bridged], 'eb', '')] if 0 else ''
                    print(f"# {kind} {seed}: curve {int(r.curve_holds)} ends {np.round(r.end_error,2)} of {np.round(r.bound[[0,-1]],2)} max {r.bound.max():.2f}; worst ratio at {i} of {len(r.error)} {np.round(r.line.points[i],1)}: {r.error[i]:.2f} of {r.bound[i]:.2f} edited {int(r.line.edited[i])}; greatest at {j}: {r.error[j]:.2f} of {r.bound[j]:.2f}; edited {r.line.edited.sum()}, n bad {(r.error>r.bound).sum()}")
        every += results
        print(f"| {kind} | {row(results)} |", flush=True)
    print(f"| all | {row(every)} |")


if __name__ == "__main__":
    main(sys.argv[1:])
