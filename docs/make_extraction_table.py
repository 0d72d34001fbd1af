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
from collections import Counter
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
MISSING_PX = 2.5
"""Pixels from the measured points from which a place of the true curve is missing."""
WRONG_SHARE = 0.05
"""Of the curve: more wrong or missing than this is a wrong curve."""
WRONG_END_PX = 5.0
"""Pixels from the true end from which an end is wrong."""
WORD_PX = 40.0
"""Pixels: a finding or an entry of the account this near to a wrong place speaks of it."""
QUIET = {
    "plain": "line alone",
    "words": "words beside",
    "crosses": "marker crosses beside",
    "linear light": "linear light",
}
"""Kinds of `tests/making/slices.py` on which nothing disturbs the line, and their names in the
table."""
OUTCOMES = {
    "right": "right",
    "refused": "refused",
    "told": "wrong with a finding",
    "silent": "wrong without a finding",
}
"""How an answer is judged, and how the tables say so."""


@dataclass
class Answer:
    """What an extraction answered for one slice.

    findings: (code, (u, v) or None)
    account: (u, v, half of its size)
    """

    points: np.ndarray | None = None
    sigma: np.ndarray | None = None
    closed: bool = False
    refusal: str = ""
    findings: list = field(default_factory=list)
    account: list = field(default_factory=list)
    seconds: float = 0.0


@dataclass
class Result:
    """The judgement on one slice.

    outcome: "right", "refused", "told" or "silent"
    errors: across the line, of a right answer [px]
    z: the errors over the stated deviation
    ends: distances of both ends from the true ones [px]
    """

    kind: str
    seed: int
    how: str
    clear: bool
    outcome: str
    why: str = ""
    findings: list = field(default_factory=list)
    errors: np.ndarray | None = None
    z: np.ndarray | None = None
    ends: list = field(default_factory=list)
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
    options = parser.parse_args()
    if options.answer:
        answer_all(*options.answer, options.package)
        return
    names = [*extraction_kinds.CLEAR, *extraction_kinds.AMBIGUOUS]
    quiet_names = tuple(QUIET)
    if options.kinds:
        names = options.kinds
        quiet_names = ()
    with tempfile.TemporaryDirectory() as folder:
        cache = options.cache or folder
        drawings = draw_slices(names, options.seed, options.slices, cache)
        drawings += draw_quiet_slices(quiet_names, options.seed, 2 * options.slices, cache)
        pictures = Path(folder) / "pictures"
        with pictures.open("wb") as file:
            pickle.dump([drawing.image for drawing in drawings], file)
        builds = {"this build": (sys.executable, options.package)}
        if options.beside:
            builds["beside"] = (options.beside, "vfplan")
        results = {}
        for name, (python, package) in builds.items():
            answers = run_build(python, package, pictures, not options.no_speed)
            results[name] = []
            for drawing, answer in zip(drawings, answers["slices"], strict=True):
                results[name].append(judge(drawing, answer))
            if options.verbose:
                print_not_right(name, results[name])
            print_summary(name, results[name], answers)
    for clear in (True, False):
        print_table(results, clear)


def draw_slices(names, seed, count, folder):
    """The slices of some kinds, drawn or read from the folder."""
    drawings = []
    for kind in names:
        for k in range(seed, seed + count):
            path = Path(folder) / f"{kind.replace(' ', '_')}_{k}.pickle"
            if not path.exists():
                path.write_bytes(pickle.dumps(extraction_kinds.draw(kind, k)))
            drawings.append(pickle.loads(path.read_bytes()))
    return drawings


def draw_quiet_slices(names, seed, count, folder):
    """Quiet slices of the table of kinds, drawn or read from the folder."""
    drawings = []
    for kind in names:
        for k in range(seed, seed + count):
            path = Path(folder) / f"quiet_{kind.replace(' ', '_')}_{k}.pickle"
            if not path.exists():
                drawing = slices.draw(kind, k)
                drawing.kind = f"quiet: {kind}"
                path.write_bytes(pickle.dumps(drawing))
            drawings.append(pickle.loads(path.read_bytes()))
    return drawings


def run_build(python, package, pictures, speed):
    """Extract from all pictures with one build, in a process of its own."""
    out = pictures.with_name("answers")
    words = [python, __file__, "--package", package, "--answer", str(pictures), str(out)]
    if not speed:
        words.append("--no-speed")
    subprocess.run(words, check=True)
    return pickle.loads(out.read_bytes())


# --- In the process of the build that is measured ------------------------------------------------


def answer_all(pictures, out, package):
    """Extract from each picture and keep the answers, then measure speed."""
    import contextlib
    import importlib

    from vfplan.errors import VfplanError

    module = importlib.import_module(package)
    answers = []
    with open(pictures, "rb") as file:
        images = pickle.load(file)
    # The first extraction loads the libraries.
    with contextlib.suppress(VfplanError):
        module.extract_curve(images[0], stroke="longest")
    for image in images:
        answers.append(answer_of(module, image))
    result = {"slices": answers}
    if "--no-speed" not in sys.argv:
        result["speed"] = speed_of(module)
    Path(out).write_bytes(pickle.dumps(result))


def answer_of(module, image):
    """What a build answers for one picture."""
    from vfplan.errors import CurveError

    start = time.process_time()
    try:
        extraction = module.extract_curve(image)
    except CurveError as error:
        seconds = time.process_time() - start
        return Answer(refusal=f"{getattr(error, 'code', '')}: {error}", seconds=seconds)
    seconds = time.process_time() - start
    stroke = extraction.strokes[0]
    answer = Answer(stroke.points_px, stroke.sigma_px, stroke.closed, seconds=seconds)
    if hasattr(extraction, "account"):
        for finding in extraction.findings:
            # That a line leaves the picture is true of the slice, and tells no fault of the curve.
            if finding.severity == "doubt" and finding.code != "leaves-picture":
                answer.findings.append((finding.code, finding.place_px))
        for item in extraction.account:
            half = float(getattr(item, "size_px", 0.0)) / 2
            answer.account.append((item.u, item.v, half))
    else:
        # Builds before 1.0 gave sentences, and marks with their boxes.
        for sentence in extraction.warnings:
            answer.findings.append((sentence, place_in(sentence)))
        for mark in extraction.set_aside:
            u, v, width, height = mark["box"]
            answer.account.append((u + width / 2, v + height / 2, max(width, height) / 2))
    return answer


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
    # A speck in the corner makes the pen's bounding box the whole picture.
    large[4080:4082, 4080:4082] = (255, 0, 0)
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


# --- The judgement -------------------------------------------------------------------------------


def judge(drawn, answer):
    """Hold an answer against what was drawn."""
    how = f"{drawn.rasteriser} {drawn.quality or 'PNG'}"
    result = Result(drawn.kind, drawn.seed, how, drawn.clear, "right", seconds=answer.seconds)
    for code, _ in answer.findings:
        result.findings.append(code)
    if answer.refusal:
        result.outcome = "refused"
        result.why = answer.refusal
        return result
    wrong, places = faults(drawn, answer)
    if wrong:
        result.why = wrong
        result.outcome = "silent"
        if is_told(answer, places):
            result.outcome = "told"
        return result
    inner = inner_points(answer)
    error = normal_errors(answer.points[inner], drawn.truth, drawn.closed)
    result.errors = error
    result.z = error / answer.sigma[inner]
    if not drawn.closed:
        result.ends = end_distances(drawn, answer)
    return result


def faults(drawn, answer):
    """What is wrong with the curve, and the places where it is; "" where it is right."""
    if drawn.truth is None:
        return "no curve is right here", np.array(drawn.places)
    error = normal_errors(answer.points, drawn.truth, drawn.closed)
    dense = polyline(drawn.truth, drawn.closed, 0.5)
    distance = cKDTree(answer.points).query(dense)[0]
    is_wrong = np.abs(error) > WRONG_PX
    missing = distance > MISSING_PX
    faults = []
    places = [answer.points[is_wrong], dense[missing]]
    # The points beyond a true end are judged as the end is.
    inner = inner_points(answer)
    if is_wrong[inner].mean() > WRONG_SHARE:
        faults.append(f"{np.abs(error).max():.1f} px off")
    if missing.mean() > WRONG_SHARE:
        faults.append(f"{missing.mean():.0%} missing")
    if answer.closed != drawn.closed:
        if answer.closed:
            faults.append("closed")
        else:
            faults.append("open")
        places.append(dense[[0, -1]])
    elif not drawn.closed:
        ends = end_distances(drawn, answer)
        if max(ends) > WRONG_END_PX:
            faults.append(f"an end {max(ends):.1f} px off")
            places.append(dense[[0, -1]])
    if drawn.places:
        places.append(np.array(drawn.places))
    return ", ".join(faults), np.vstack(places)


def inner_points(answer):
    """(M,) bool: the points that are not close to an open end."""
    if answer.closed:
        return np.ones(len(answer.points), bool)
    ends = answer.points[[0, -1]]
    distance = np.hypot(*np.moveaxis(answer.points[:, None] - ends, 2, 0)).min(1)
    return distance > END_PX


def end_distances(drawn, answer):
    """How far both ends lie from the true ones, matched to each other [px]."""
    ends = answer.points[[0, -1]]
    truth = drawn.truth[[0, -1]]
    forward = np.hypot(*(ends - truth).T)
    backward = np.hypot(*(ends - truth[::-1]).T)
    if forward.max() <= backward.max():
        return forward.tolist()
    return backward.tolist()


def is_told(answer, places):
    """Whether a finding or an entry of the account lies close to a place."""
    tree = cKDTree(places)
    for _, place in answer.findings:
        if place is None or tree.query(place)[0] <= WORD_PX:
            return True
    return any(tree.query((u, v))[0] <= WORD_PX + half for u, v, half in answer.account)


# --- The tables ----------------------------------------------------------------------------------


def with_outcome(results, outcome):
    """The results with this outcome."""
    return [r for r in results if r.outcome == outcome]


def with_findings(results):
    """The results with at least one finding."""
    return [r for r in results if r.findings]


def of_format(results, is_png):
    """The results of pictures in PNG, or of those in JPEG."""
    return [r for r in results if r.how.endswith("PNG") == is_png]


def pooled_rms(results, name):
    """The root mean square of all numbers of an array that each result has."""
    if not results:
        return np.nan
    numbers = np.concatenate([getattr(r, name) for r in results])
    return float(np.sqrt(np.mean(numbers**2)))


def rms_of_each(results, name):
    """The root mean square of each result's own numbers."""
    return [np.sqrt(np.mean(getattr(r, name) ** 2)) for r in results]


def end_distances_of(results):
    """The distances of all ends from the true ones [px]."""
    distances = []
    for r in results:
        distances += r.ends
    return distances


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
        rows.append((f"processor time, {picture} px", f"{milliseconds:.0f} ms"))
        rows.append((f"memory, {picture} px", f"{memory:.1f} bytes a pixel"))
    print(f"\n{name}: {len(results)} slices\n| figure | value |\n|---|---|")
    for figure, value in rows:
        print(f"| {figure} | {value} |")


def share(part, whole):
    """As "3 of 8 = 37.5%"."""
    return f"{len(part)} of {len(whole)} = {len(part) / max(len(whole), 1):.1%}"


def clear_figures(results):
    """Rows on the slices with one right answer."""
    clear = [r for r in results if r.clear and not r.kind.startswith("quiet")]
    right = with_outcome(clear, "right")
    if not right:
        return []
    rows = []
    for outcome, words in OUTCOMES.items():
        rows.append((f"clear slices {words}", share(with_outcome(clear, outcome), clear)))
    rows.append(("right clear slices that have a finding", share(with_findings(right), right)))
    for label, is_png in (("PNG", True), ("JPEG", False)):
        part = of_format(right, is_png)
        mean = np.mean(rms_of_each(part, "errors"))
        pooled = pooled_rms(part, "errors")
        name = f"RMS error across the line, clear slices in {label}"
        rows.append((f"{name}, mean", f"{mean:.3f} px"))
        rows.append((f"{name}, pooled", f"{pooled:.3f} px"))
    ends = end_distances_of(right)
    name = "error of the ends, clear slices"
    rows.append((f"{name}, median", f"{np.median(ends):.2f} px"))
    rows.append((f"{name}, 95 % are below", f"{np.quantile(ends, 0.95):.2f} px"))
    name = "error across the line over stated deviation, clear slices"
    rows.append((f"{name}, median", f"{np.median(rms_of_each(right, 'z')):.2f}"))
    rows.append((f"{name}, pooled", f"{pooled_rms(right, 'z'):.2f}"))
    return rows


def ambiguous_figures(results):
    """Rows on the slices that a person has to look at."""
    rows = []
    covered = [r for r in results if r.kind == "grey box over an end"]
    others = [r for r in results if not r.clear and r not in covered]
    names = {"ambiguous slices": others, "slices with a grey box over an end,": covered}
    for name, part in names.items():
        if part:
            silent = with_outcome(part, "silent")
            rows.append((f"{name} {OUTCOMES['silent']}", share(silent, part)))
    return rows


def quiet_figures(results):
    """Rows on pictures where nothing disturbs the line."""
    rows = []
    for kind, words in QUIET.items():
        part = [r for r in results if r.kind == f"quiet: {kind}" and r.errors is not None]
        if part:
            pooled = pooled_rms(part, "errors")
            name = f"RMS error across the line, quiet slices, {words}, pooled"
            rows.append((name, f"{pooled:.3f} px"))
    return rows


def print_table(results, clear):
    """One row a kind, both builds beside each other."""
    groups = []
    for r in next(iter(results.values())):
        if r.clear == clear and r.kind not in groups:
            groups.append(r.kind)
    if not groups:
        return
    heads = [*OUTCOMES.values(), "right with a finding", "RMS px", "ends median px"]
    print(f"\n| kind ({' / '.join(results)}) | {' | '.join(heads)} |")
    print("|---" * (len(heads) + 1) + "|")
    for kind in groups:
        cells = []
        for rows in results.values():
            cells.append(kind_cells([r for r in rows if r.kind == kind]))
        joined = [" / ".join(values) for values in zip(*cells, strict=True)]
        print(f"| {kind} | {' | '.join(joined)} |")


def kind_cells(rows):
    """The cells of one kind and one build."""
    outcomes = Counter(r.outcome for r in rows)
    right = with_outcome(rows, "right")
    error_cell = "-"
    ends_cell = "-"
    if right:
        error_cell = f"{pooled_rms(right, 'errors'):.3f}"
    ends = end_distances_of(right)
    if ends:
        ends_cell = f"{np.median(ends):.2f}"
    return [
        str(outcomes["right"]),
        str(outcomes["refused"]),
        str(outcomes["told"]),
        str(outcomes["silent"]),
        str(len(with_findings(right))),
        error_cell,
        ends_cell,
    ]


if __name__ == "__main__":
    main()
