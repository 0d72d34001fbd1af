"""Click on drawn lines and print what the page takes, the table in extraction.md:

    python docs/make_drawn_slices.py [SLICES_A_KIND=25 [FIRST_SEED=0]] [-v]

The slices are those of `tests/making/as_people_draw.py`. A click at a random place of the true line
chooses it, as on the page. Where it takes another curve, or the pen was lifted, the whole line is
then drawn by clicks every 30 px, 1.5 px off. Nine markers, each 0.1 mm off, tie a slice to the
robot. `-v` names each slice that the click does not settle.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "making"))
from as_people_draw import KINDS, draw
from drawing import polyline

from vfplan.errors import VfplanError
from vfplan.review.session import Session

PX_M = 4e-4
MARKS = np.array([[u, v] for u in (30, 190, 350) for v in (30, 160, 290)])
NAMED_PX = 40.0
"""A finding this near to a lost place names it."""
END_MM = 0.8
"""The curve may go on so far beyond an end of the line: 2 px."""
LOST = 0.02
"""Share of the line that may be lost without a word."""


@dataclass
class Result:
    """What became of a slice.

    lost, extra: share of the true line that the click missed, and of the curve beside that line
    is_told: whether findings name each place that is lost, or taken too much
    error, bound: of the mended curve, the largest error across the line and the 95 % bound [mm]
    beyond: how far it goes beyond an end of the line [mm]
    """

    lost: float = 1.0
    extra: float = 0.0
    is_told: bool = True
    refusal: str = ""
    error: float = np.nan
    bound: float = np.nan
    beyond: float = 0.0
    where: tuple = ()

    @property
    def is_within(self):
        """Whether the bound holds."""
        return self.error <= self.bound and self.beyond <= END_MM

    @property
    def is_whole(self):
        """Whether the click took the line and nothing else."""
        return not self.refusal and max(self.lost, self.extra) <= LOST


def result_of(kind, seed, folder):
    """Click on one slice, draw what the click does not take, and judge both."""
    rng = np.random.default_rng([seed, 7])
    slice_ = draw(kind, seed)
    place, *hidden = slice_.places
    path, table = folder / "slice.png", folder / "markers.csv"
    cv2.imwrite(str(path), slice_.image[..., ::-1])
    robot = np.pad(PX_M * MARKS, [(0, 0), (0, 1)]) + rng.normal(0, 1e-4, (9, 3))
    rows = [f"m{k},{u},{v},{x},{y},{z}" for k, (u, v, x, y, z) in enumerate(np.c_[MARKS, robot])]
    table.write_text("\n".join(["label,u_px,v_px,x_m,y_m,z_m", *rows]))
    session = Session.open(path, table, markers_as_given=True)
    truth = polyline(slice_.truth, slice_.closed, 0.5)
    result = Result()
    try:
        if not session.current.geometry.strokes:
            session = session.apply({"do": "choose", "at": place.tolist()})
        result = judged(session, truth)
    except VfplanError as error:
        result.refusal = error.code
    if hidden or not result.is_whole:
        clicks = np.vstack([truth[::60], truth[-1:]])[: -2 if slice_.closed else None]
        clicks = np.clip(clicks + rng.normal(0, 1.5, clicks.shape), 0, [379, 319])
        drawn = {"do": "draw", "points": clicks.tolist(), "closed": slice_.closed, "replace": True}
        session = session.apply(drawn)
    points = np.vstack([stroke.points for stroke in session.current.geometry.strokes])
    reached = session.current.fit.registration.apply(points)
    meant = np.pad(PX_M * truth, [(0, 0), (0, 1)])
    distance, nearest = cKDTree(meant).query(reached)
    is_beyond = np.zeros(len(points), bool)
    if not slice_.closed:
        is_beyond = (nearest == 0) | (nearest == len(truth) - 1)
    result.error = 1e3 * float(distance[~is_beyond].max())
    result.beyond = 1e3 * float(distance[is_beyond].max(initial=0.0))
    result.where = np.round(points[distance.argmax()]).tolist()
    result.bound = 1e3 * session.state()["tre95_m"]
    return result


def judged(session, truth):
    """What the curve lost of the true line, or took too much, and whether findings say so."""
    geometry = session.current.geometry
    if not geometry.strokes:
        return Result(refusal=geometry.refusal["code"])
    points = np.vstack([stroke.points for stroke in geometry.strokes])
    pen = max(line.width for line in geometry.lines)
    missing = truth[cKDTree(points).query(truth)[0] > pen]
    beside = points[cKDTree(truth).query(points)[0] > pen]
    told = [f.place_px for f in session.current.findings if f.place_px is not None]
    is_told = is_named(missing, told) and is_named(beside, told)
    return Result(len(missing) / len(truth), len(beside) / len(points), is_told)


def is_named(places, findings):
    """Whether a finding lies near each run of places, but for a few at ends."""
    if len(places) == 0:
        return True
    if not findings:
        return False
    gaps = np.flatnonzero(np.hypot(*np.diff(places, axis=0).T) > NAMED_PX)
    runs = np.split(places, gaps + 1)
    return all(cKDTree(findings).query(run)[0].min() <= NAMED_PX for run in runs)


def cells(results):
    """What a row of the table says."""
    whole = [r for r in results if r.is_whole]
    refused = [r for r in results if r.refusal]
    silent = [r for r in results if not r.is_told and not r.is_whole]
    told = len(results) - len(whole) - len(refused) - len(silent)
    error = np.median([r.error for r in results])
    held = np.mean([r.is_within for r in results])
    return len(whole), told, len(refused), len(silent), f"{error:.2f}", f"{100 * held:.0f}"


def main(words):
    """Print the table."""
    numbers = iter(int(word) for word in words if word.isdigit())
    count, first_seed = next(numbers, 25), next(numbers, 0)
    seeds = range(first_seed, first_seed + count)
    heads = "whole", "with a finding", "refused", "in silence", "error [mm]", "within [%]"
    print(f"| kind | {' | '.join(heads)} |\n{'|---' * (len(heads) + 1)}|")
    every = []
    for kind in KINDS:
        with tempfile.TemporaryDirectory() as folder:
            results = [result_of(kind, seed, Path(folder)) for seed in seeds]
        for seed, result in zip(seeds, results, strict=True):
            if "-v" in words and (not result.is_whole or not result.is_within):
                print(f"# {kind} {seed}: {result}")
        every += results
        print(f"| {kind} | {' | '.join(map(str, cells(results)))} |", flush=True)
    print(f"| all | {' | '.join(map(str, cells(every)))} |")


if __name__ == "__main__":
    main(sys.argv[1:])
