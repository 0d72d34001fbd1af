"""Measure the extraction on drawn slices whose curve is known, the tables in extraction.md:

    python docs/make_extraction_table.py                       8 slices a kind, minutes
    python docs/make_extraction_table.py --slices 4 --seed 100
    python docs/make_extraction_table.py --beside PYTHON       and an older build beside it

PYTHON is the interpreter of an environment with another build of vfplan. The slices are those of
`tests/making/extraction_kinds.py` and, for quiet pictures, of `tests/making/slices.py`.
"""

from __future__ import annotations

import argparse
import pickle
import subprocess
import sys
import tempfile
import time
import tracemalloc
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "making"))
import extraction_kinds
import slices
from drawing import anatomy, blend, coverage, normal_errors, polyline, to_uint8, wavy

END_PX = 6.0
"""Pixels of line at an open end that the error across the line leaves out."""
WRONG_PX = 1.0
"""Pixels from the true curve from which a point is wrong."""
WRONG_SHARE = 0.05
"""Of the curve: more wrong or missing than this is a wrong curve."""
WRONG_END_PX = 5.0
"""Pixels from the true end from which an end is wrong."""
WORD_PX = 40.0
"""Pixels: a finding or an entry of the account this near to a wrong place speaks of it."""
QUIET = ("plain", "words", "crosses", "linear light")
"""Kinds of `tests/making/slices.py` on which nothing disturbs the line."""


@dataclass
class Answer:
    """What an extraction said of one slice."""

    points: np.ndarray | None = None
    sigma: np.ndarray | None = None
    closed: bool = False
    refusal: str = ""
    findings: list = field(default_factory=list)  # (code, (u, v) or None)
    account: list = field(default_factory=list)  # (u, v, half of its size)
    seconds: float = 0.0


@dataclass
class Result:
    """The judgement on one slice."""

    kind: str
    seed: int
    how: str
    clear: bool
    outcome: str  # "right", "refused", "told", "silent"
    why: str = ""
    findings: list = field(default_factory=list)
    errors: np.ndarray | None = None  # across the line, of a right answer [px]
    z: np.ndarray | None = None  # the same over the stated deviation
    ends: list = field(default_factory=list)  # distances of both ends [px]
    end_kinds: list = field(default_factory=list)
    seconds: float = 0.0


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--slices", type=int, default=8, help="of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first slice of each kind")
    parser.add_argument("--kinds", nargs="*", help="only these kinds")
    parser.add_argument("--beside", metavar="PYTHON", help="an environment with another build")
    parser.add_argument("--package", default="vfplan", help=argparse.SUPPRESS)
    parser.add_argument("--answer", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--cache", help="a folder that keeps the drawn slices")
    parser.add_argument("--verbose", action="store_true", help="name each slice that is not right")
    parser.add_argument("--no-speed", action="store_true")
    given = parser.parse_args()
    if given.answer:
        answer_all(*given.answer, given.package)
        return
    kinds = given.kinds or [*extraction_kinds.CLEAR, *extraction_kinds.AMBIGUOUS]
    quiet = QUIET
    if given.kinds:
        quiet = [kind for kind in given.kinds if kind in QUIET and kind not in kinds]
    with tempfile.TemporaryDirectory() as folder:
        drawn = drawings(kinds, given.seed, given.slices, given.cache or folder)
        drawn += quiet_drawings(quiet, given.seed, 2 * given.slices, given.cache or folder)
        pictures = Path(folder) / "pictures"
        with pictures.open("wb") as file:
            pickle.dump([each.image for each in drawn], file)
        builds = {"this build": (sys.executable, given.package)}
        if given.beside:
            builds["beside"] = (given.beside, "vfplan")
        results = {}
        for name, (python, package) in builds.items():
            answers = run_build(python, package, pictures, not given.no_speed)
            results[name] = [judge(*pair) for pair in zip(drawn, answers["slices"], strict=True)]
            if given.verbose:
                print_not_right(name, results[name])
            print_summary(name, results[name], answers)
    for clear in (True, False):
        print_kinds(results, clear)


def drawings(kinds, seed, count, folder):
    """The slices of some kinds, drawn or taken from the folder."""
    found = []
    for kind in kinds:
        for k in range(seed, seed + count):
            path = Path(folder) / f"{kind.replace(' ', '_')}_{k}.pickle"
            if path.exists():
                drawn = pickle.loads(path.read_bytes())
            else:
                drawn = extraction_kinds.draw(kind, k)
                path.write_bytes(pickle.dumps(drawn))
            found.append(drawn)
    return found


def quiet_drawings(kinds, seed, count, folder):
    """Quiet slices of the table of kinds."""
    found = []
    for kind in kinds:
        for k in range(seed, seed + count):
            path = Path(folder) / f"quiet_{kind.replace(' ', '_')}_{k}.pickle"
            if path.exists():
                drawn = pickle.loads(path.read_bytes())
            else:
                old = slices.draw(kind, k)
                drawn = extraction_kinds.Drawing(
                    f"quiet: {kind}", k, old.rasteriser, old.quality, old.image, old.truth,
                    old.closed, True,
                )  # fmt: skip
                path.write_bytes(pickle.dumps(drawn))
            found.append(drawn)
    return found


def run_build(python, package, pictures, speed):
    """Extract from all pictures with one build, in a process of its own."""
    out = pictures.with_name("answers")
    words = [python, __file__, "--package", package, "--answer", str(pictures), str(out)]
    if not speed:
        words.append("--no-speed")
    subprocess.run(words, check=True)
    return pickle.loads(out.read_bytes())


# In the process of the build that is measured.


def answer_all(pictures, out, package):
    """Extract from each picture and keep the answers, then measure speed."""
    import importlib

    module = importlib.import_module(package)
    answers = []
    with open(pictures, "rb") as file:
        images = pickle.load(file)
    module.extract_curve(images[0], stroke="longest")  # loads the libraries
    for image in images:
        answers.append(answer(module, image))
    kept = {"slices": answers}
    if "--no-speed" not in sys.argv:
        kept["speed"] = speed_of(module)
    # By plain types, so that the other process needs no class of this one.
    Path(out).write_bytes(pickle.dumps(kept))


def answer(module, image):
    """What a build says of one picture."""
    from vfplan.errors import CurveError

    start = time.process_time()
    try:
        extraction = module.extract_curve(image)
    except CurveError as error:
        seconds = time.process_time() - start
        return Answer(refusal=f"{getattr(error, 'code', '')}: {error}", seconds=seconds)
    seconds = time.process_time() - start
    stroke = extraction.strokes[0]
    said = Answer(stroke.points_px, stroke.sigma_px, stroke.closed, seconds=seconds)
    if hasattr(extraction, "account"):
        for finding in extraction.findings:
            if finding.severity == "doubt":
                said.findings.append((finding.code, finding.place_px))
        for item in extraction.account:
            half = float(getattr(item, "size_px", 0.0)) / 2
            said.account.append((item.u, item.v, half))
    else:  # 2dd7600: sentences, and marks with their boxes
        said.findings = [(words, place_in(words)) for words in extraction.warnings]
        for mark in extraction.set_aside:
            u, v, width, height = mark["box"]
            said.account.append((u + width / 2, v + height / 2, max(width, height) / 2))
    return said


def place_in(words):
    """The first place "(u, v)" in a sentence."""
    import re

    match = re.search(r"\((\d+(?:\.\d+)?), (\d+(?:\.\d+)?)\)", words)
    if match is None:
        return None
    return (float(match[1]), float(match[2]))


def speed_of(module):
    """(picture, processor time [ms], peak memory [bytes a pixel]) of two sizes."""
    share = coverage((786, 871), wavy((786, 871), 2, False), 3)
    small = to_uint8(blend(anatomy((786, 871), 2), share, (255, 0, 0)))
    tile = small[:683, :683].mean(2).astype(np.uint8)
    large = np.repeat(np.tile(tile, (6, 6))[:4096, :4096, None], 3, axis=2)
    large[:786, :871] = small
    large[4080:4082, 4080:4082] = (255, 0, 0)  # the pen's box is the whole picture
    rows = []
    for name, image in {"871 x 786": small, "4096 x 4096": large}.items():
        times = []
        for _ in range(5):
            start = time.process_time()
            module.extract_curve(image)
            times.append(time.process_time() - start)
        tracemalloc.start()
        module.extract_curve(image)
        peak = tracemalloc.get_traced_memory()[1] / image[..., 0].size
        tracemalloc.stop()
        rows.append((name, 1e3 * min(times), peak))
    return rows


# The judgement.


def judge(drawn, said):
    """Hold an answer against what was drawn."""
    how = f"{drawn.rasteriser} {drawn.quality or 'PNG'}"
    result = Result(drawn.kind, drawn.seed, how, drawn.clear, "right", seconds=said.seconds)
    result.findings = [code for code, _ in said.findings]
    if said.refusal:
        result.outcome = "refused"
        result.why = said.refusal
        return result
    wrong, places = faults(drawn, said)
    if wrong:
        result.why = wrong
        result.outcome = "told" if is_told(said, places) else "silent"
        return result
    inner = inner_points(said)
    error = normal_errors(said.points[inner], drawn.truth, drawn.closed)
    result.errors = error
    result.z = error / said.sigma[inner]
    if not drawn.closed:
        result.ends = end_distances(drawn, said)
    return result


def faults(drawn, said):
    """What is wrong with the curve, and the places where it is; "" where it is right."""
    if drawn.truth is None:
        return "no curve is right here", np.array(drawn.places)
    error = normal_errors(said.points, drawn.truth, drawn.closed)
    dense = polyline(drawn.truth, drawn.closed, 0.5)
    distance = cKDTree(said.points).query(dense)[0]
    off = np.abs(error) > WRONG_PX
    missing = distance > 2.5
    faults, places = [], [said.points[off], dense[missing]]
    # The points beyond a true end are judged as the end is.
    inner = inner_points(said)
    if off[inner].mean() > WRONG_SHARE:
        faults.append(f"{np.abs(error).max():.1f} px off")
    if missing.mean() > WRONG_SHARE:
        faults.append(f"{missing.mean():.0%} missing")
    if said.closed != drawn.closed:
        faults.append("closed" if said.closed else "open")
        places.append(dense[[0, -1]])
    elif not drawn.closed:
        ends = end_distances(drawn, said)
        if max(ends) > WRONG_END_PX:
            faults.append(f"an end {max(ends):.1f} px off")
            places.append(dense[[0, -1]])
    if drawn.places:
        places.append(np.array(drawn.places))
    return ", ".join(faults), np.vstack(places)


def inner_points(said):
    """(M,) bool: the points that are not close to an open end."""
    if said.closed:
        return np.ones(len(said.points), bool)
    ends = said.points[[0, -1]]
    away = np.hypot(*np.moveaxis(said.points[:, None] - ends, 2, 0)).min(1)
    return away > END_PX


def end_distances(drawn, said):
    """How far both ends lie from the true ones, matched to each other [px]."""
    ends = said.points[[0, -1]]
    truth = drawn.truth[[0, -1]]
    forward = np.hypot(*(ends - truth).T)
    backward = np.hypot(*(ends - truth[::-1]).T)
    if forward.max() <= backward.max():
        return forward.tolist()
    return backward.tolist()


def is_told(said, places):
    """Whether a finding or an entry of the account lies close to a place."""
    tree = cKDTree(places)
    for _, place in said.findings:
        if place is None or tree.query(place)[0] <= WORD_PX:
            return True
    return any(tree.query((u, v))[0] <= WORD_PX + half for u, v, half in said.account)


# The tables.


def root_mean_square(arrays):
    """Of all numbers of several arrays."""
    if not arrays:
        return np.nan
    return float(np.sqrt(np.mean(np.concatenate(arrays) ** 2)))


def print_not_right(name, results):
    """One line for each slice that is not plainly as it should be."""
    for r in results:
        if (r.clear and (r.outcome != "right" or r.findings)) or r.outcome == "silent":
            print(f"# {name}: {r.kind} {r.seed} ({r.how}): {r.outcome}: {r.why}; {r.findings}")


def print_summary(name, results, answers):
    """The figures of the whole set."""
    rows = clear_figures(results) + ambiguous_figures(results) + quiet_figures(results)
    seconds = np.median([r.seconds for r in results])
    rows.append(("processor time a slice, median", f"{1e3 * seconds:.0f} ms"))
    for picture, milliseconds, memory in answers.get("speed", ()):
        rows.append((picture, f"{milliseconds:.0f} ms, {memory:.1f} bytes a pixel"))
    print(f"\n{name}: {len(results)} slices\n| figure | value |\n|---|---|")
    for figure, value in rows:
        print(f"| {figure} | {value} |")


def share(part, whole):
    """ "3 of 8 = 37.5%"."""
    return f"{len(part)} of {len(whole)} = {len(part) / max(len(whole), 1):.1%}"


def clear_figures(results):
    """Rows on the slices with one right answer."""
    clear = [r for r in results if r.clear and not r.kind.startswith("quiet")]
    right = [r for r in clear if r.outcome == "right"]
    if not right:
        return []
    rows = [("clear slices right", share(right, clear))]
    for outcome in ("refused", "told", "silent"):
        part = [r for r in clear if r.outcome == outcome]
        rows.append((f"clear slices {outcome}", share(part, clear)))
    for label, is_png in (("PNG", True), ("JPEG", False)):
        part = [r for r in right if r.how.endswith("PNG") == is_png]
        mean = np.mean([np.sqrt(np.mean(r.errors**2)) for r in part])
        pooled = root_mean_square([r.errors for r in part])
        name = f"RMS across, {label}: mean of slices, pooled"
        rows.append((name, f"{mean:.3f}, {pooled:.3f} px"))
    ends = [e for r in right for e in r.ends]
    rows.append(("ends: median, 95 %", f"{np.median(ends):.2f}, {np.quantile(ends, 0.95):.2f} px"))
    ratio = np.median([np.sqrt(np.mean(r.z**2)) for r in right])
    pooled = root_mean_square([r.z for r in right])
    rows.append(("true error over stated: median of slices, pooled", f"{ratio:.2f}, {pooled:.2f}"))
    told = [r for r in right if r.findings]
    rows.append(("right clear slices with a finding", share(told, right)))
    return rows


def ambiguous_figures(results):
    """Rows on the slices that a person has to look at."""
    rows = []
    grey_boxes = [r for r in results if r.kind == "grey box over an end"]
    others = [r for r in results if not r.clear and r not in grey_boxes]
    for name, part in (("ambiguous slices", others), ("grey boxes over an end", grey_boxes)):
        if part:
            silent = [r for r in part if r.outcome == "silent"]
            rows.append((f"{name} silent", share(silent, part)))
    return rows


def quiet_figures(results):
    """Rows on pictures where nothing disturbs the line."""
    rows = []
    for kind in QUIET:
        part = [r for r in results if r.kind == f"quiet: {kind}" and r.errors is not None]
        if part:
            pooled = root_mean_square([r.errors for r in part])
            rows.append((f"RMS across, quiet, {kind}", f"{pooled:.3f} px"))
    return rows


def print_kinds(results, clear):
    """One row a kind, both builds beside each other."""
    kinds = []
    for r in next(iter(results.values())):
        if r.clear == clear and r.kind not in kinds:
            kinds.append(r.kind)
    if not kinds:
        return
    heads = ["right", "refused", "told", "silent", "with a finding", "RMS px", "ends median px"]
    print(f"\n| kind ({' / '.join(results)}) | {' | '.join(heads)} |")
    print("|---" * (len(heads) + 1) + "|")
    for kind in kinds:
        cells = [kind_cells([r for r in rows if r.kind == kind]) for rows in results.values()]
        joined = [" / ".join(values) for values in zip(*cells, strict=True)]
        print(f"| {kind} | {' | '.join(joined)} |")


def kind_cells(rows):
    """The cells of one kind and one build."""
    cells = [
        str(sum(r.outcome == outcome for r in rows))
        for outcome in ("right", "refused", "told", "silent")
    ]
    right = [r for r in rows if r.outcome == "right"]
    cells.append(str(sum(bool(r.findings) for r in right)))
    if not right:
        return [*cells, "-", "-"]
    cells.append(f"{root_mean_square([r.errors for r in right]):.3f}")
    ends = [e for r in right for e in r.ends]
    cells.append(f"{np.median(ends):.2f}" if ends else "-")
    return cells


if __name__ == "__main__":
    main()
