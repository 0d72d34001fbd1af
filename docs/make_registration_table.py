"""Print the tables of docs/registration.md: python docs/make_registration_table.py [SETS] [--write]

Markers with planted noise and planted mistakes (tests/making/marker_sets.py), registered as
`vfplan plan` registers them: how many are refused, how many have a doubt to answer or a note, how
many pass in silence; and how often the 95 % bounds hold. SETS is the number of sets a row, 600 by
default. With --write the tables take the place of those on the page.
"""

from __future__ import annotations

import csv
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import vfplan
from vfplan.errors import VfplanError
from vfplan.registration.checks import (
    POSSIBLE_PERSPECTIVE,
    SURE_PERSPECTIVE,
    error_findings,
    refuse_wrong_markers,
    registration_findings,
)
from vfplan.registration.registration import Registration, fit_registration, target_error

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "making"))
from marker_sets import (  # noqa: E402
    SPACING_M,
    MarkerSet,
    marker_sets,
    mistaken_orders,
    with_outlier,
)

SAMPLES = ROOT / "samples"
PAGE = ROOT / "docs" / "registration.md"
MODELS = ("affine", "similarity", "rigid")
CAMERA_M = 0.6
"""Distance of the camera from the plate that is photographed [m]."""
FOCAL_LENGTH_PX = 1200
"""Focal length of that camera [px]."""
REPEATS = 7
"""Times that a processor time is measured; the median is printed."""


def curve_of(markers: MarkerSet) -> NDArray[np.float64]:
    """A wavy curve (60, 2) [px] across the markers' layout, inside it."""
    centre = markers.source.mean(axis=0)
    _, extent, axes = np.linalg.svd(markers.source - centre, full_matrices=False)
    extent = extent / np.sqrt(len(markers.source))
    t = np.linspace(-1, 1, 60)
    wave = np.column_stack([extent[0] * t, 0.6 * extent[1] * np.sin(4 * t)])
    return centre + wave @ axes


def judge(markers: MarkerSet, target: NDArray[np.float64], model: str) -> tuple[str, str]:
    """ "refused", "doubt", "note" or "silent" for touched markers, and the codes."""
    try:
        r = fit_registration(markers.source, target, model=model, pixel_spacing=SPACING_M)
        refuse_wrong_markers(r, 1e-3)
        curve = curve_of(markers)
        error = target_error(r, curve)
    except VfplanError as refusal:
        return "refused", refusal.code
    if error.curve95_m.max() > 5e-3:
        return "refused", "tre-large"
    findings = [*registration_findings(r), *error_findings(error)]
    for severity in ("doubt", "note"):
        codes = [finding.code for finding in findings if finding.severity == severity]
        if codes:
            return severity, " ".join(codes)
    return "silent", ""


def row(name: str, model: str, verdicts: list[tuple[str, str]]) -> str:
    """A line of the table."""
    count = Counter(verdict for verdict, _ in verdicts)
    return (
        f"| {name} | {model} | {len(verdicts)} | {count['refused']} | {count['doubt']} | "
        f"{count['note']} | {count['silent']} |"
    )


def label_rows(sets: int, models: tuple[str, ...] = MODELS) -> list[str]:
    """Good sets, mistaken labels and outliers."""
    lines = []
    for model in models:
        verdicts: dict[str, list[tuple[str, str]]] = {
            "good, FLE 0.5 mm": [],
            "good, FLE 0.1 to 1 mm": [],
            "good, FLE 0.1 to 1 mm, no symmetric layout": [],
            "labels mistaken": [],
            "one outlier, 4 to 12 markers": [],
            "one outlier, 3 markers": [],
        }
        rng = np.random.default_rng(1)
        for markers in marker_sets(sets, model=model, fle_m=0.5e-3, seed=2):
            verdicts["good, FLE 0.5 mm"].append(judge(markers, markers.target, model))
        for markers in marker_sets(sets, model=model):
            verdict = judge(markers, markers.target, model)
            verdicts["good, FLE 0.1 to 1 mm"].append(verdict)
            if not markers.is_symmetric:
                verdicts["good, FLE 0.1 to 1 mm, no symmetric layout"].append(verdict)
            for order in mistaken_orders(rng, len(markers.source)).values():
                verdicts["labels mistaken"].append(judge(markers, markers.target[order], model))
            name = "one outlier, 4 to 12 markers"
            if len(markers.source) == 3:
                name = "one outlier, 3 markers"
            verdicts[name].append(judge(markers, with_outlier(rng, markers.target), model))
        for name, verdicts_of_row in verdicts.items():
            if verdicts_of_row:
                lines.append(row(name, model, verdicts_of_row))
    return lines


def reading_rows() -> list[str]:
    """The sample's markers, read wrongly in 24 ways, by what `plan` says of them."""
    labels = []
    pixels = []
    with open(SAMPLES / "elbow_markers_image.csv") as file:
        for line in csv.DictReader(file):
            labels.append(line["label"])
            pixels.append([float(line["u_px"]), float(line["v_px"])])
    pixels = np.array(pixels)
    robot = []
    with open(SAMPLES / "elbow_markers_robot.csv") as file:
        for line in csv.DictReader(file):
            robot.append([float(line["x_m"]), float(line["y_m"]), float(line["z_m"])])
    robot = np.array(robot)
    width = 871
    height = 786
    views = {
        "v counted from below": np.column_stack([pixels[:, 0], height - 1 - pixels[:, 1]]),
        "u counted from the right": np.column_stack([width - 1 - pixels[:, 0], pixels[:, 1]]),
        "u from the right and v from below": [width - 1, height - 1] - pixels,
        "u and v exchanged": pixels[:, ::-1],
        "pixels times 0.5": 0.5 * pixels,
        "pixels times 0.9": 0.9 * pixels,
        "pixels times 1.1": 1.1 * pixels,
        "pixels times 2": 2.0 * pixels,
        "pixels shifted by 50 px": pixels + 50,
        "pixels shifted by 10 px": pixels + 10,
        "pixels shifted by 3 px": pixels + 3,
        "pixels counted from 1": pixels + 1,
    }
    outlier = robot.copy()
    outlier[3, 0] += 0.02
    exchanged = np.arange(9)
    exchanged[[1, 5]] = 5, 1
    places = {
        "millimetres given as metres": 1e3 * robot,
        "centimetres given as metres": 1e2 * robot,
        "inches given as metres": robot / 0.0254,
        "metres 1000 times too small": 1e-3 * robot,
        "y of the robot mirrored": robot * [1, -1, 1],
        "x and y of the robot exchanged": robot[:, [1, 0, 2]],
        "one column in millimetres": robot * [1e3, 1, 1],
        "labels reversed": robot[::-1],
        "labels shifted by one": np.roll(robot, 1, axis=0),
        "two labels exchanged": robot[exchanged],
        "one marker 20 mm off": outlier,
        "markers of another case": robot[[2, 0, 1, 5, 3, 4, 8, 6, 7]] * [1.02, 0.97, 1],
    }
    by_verdict: dict[str, list[str]] = {}
    for name, wrong_pixels in views.items():
        verdict = verdict_of_plan(labels, wrong_pixels, robot)
        by_verdict.setdefault(verdict, []).append(name)
    for name, wrong_places in places.items():
        verdict = verdict_of_plan(labels, pixels, wrong_places)
        by_verdict.setdefault(verdict, []).append(name)
    lines = []
    for verdict, names in sorted(by_verdict.items()):
        lines.append(f"| {verdict} | {'; '.join(names)} |")
    return lines


def verdict_of_plan(
    labels: list[str], pixels: NDArray[np.float64], robot: NDArray[np.float64]
) -> str:
    """What `plan` says of the sample with these markers."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "markers.csv"
        table = ["label,u_px,v_px,x_m,y_m,z_m"]
        for label, place, touched in zip(labels, pixels, robot, strict=True):
            numbers = [repr(float(number)) for number in (*place, *touched)]
            table.append(",".join([label, *numbers]))
        path.write_text("\n".join(table))
        try:
            result = vfplan.plan(SAMPLES / "elbow.png", path)
        except VfplanError as refusal:
            return f"refused: {refusal.code}"
    doubts = [f.code for f in result.registered.findings if f.severity == "doubt"]
    if not doubts:
        return "SILENT"
    return f"doubt: {', '.join(doubts)}"


def coverage_row(model: str, sets: int) -> str:
    """How often the bounds hold, over sets that the model describes."""
    holds_at_points = []
    holds_everywhere = []
    for markers in marker_sets(sets, model=model, seed=3):
        r: Registration = fit_registration(
            markers.source, markers.target, model=model, pixel_spacing=SPACING_M
        )
        curve = curve_of(markers)
        error = np.linalg.norm(r.apply(curve) - markers.true_place(curve), axis=1)
        holds_at_points.append((error <= r.tre95_m(curve)).mean())
        holds_everywhere.append((error <= r.tre95_curve_m(curve)).all())
    return (
        f"| {model} | {sets} | {np.mean(holds_at_points):.1%} | {np.mean(holds_everywhere):.1%} |"
    )


def photographed_sets(tilt_deg: float, sets: int) -> Iterator[tuple[Registration, bool]]:
    """Registrations of a plate photographed at an angle, and whether their bound holds.

    Affine maps of 6 to 12 markers with an FLE of 0.1 to 0.5 mm, anywhere on a plate of 260 mm.
    """
    rng = np.random.default_rng(4)
    t = np.linspace(0, 1, 60)
    curve = np.column_stack([-0.1 + 0.2 * t, 0.05 * np.sin(6 * t)])
    for _ in range(sets):
        n, fle_m = int(rng.integers(6, 13)), rng.uniform(1e-4, 5e-4)
        plate = rng.uniform(-0.13, 0.13, (n, 2))
        noise = rng.normal(0, fle_m / np.sqrt(3), (n, 3))
        touched = np.column_stack([plate, np.zeros(n)]) + noise
        r = fit_registration(photographed(plate, tilt_deg), touched)
        mapped = r.apply(photographed(curve, tilt_deg))
        error = np.linalg.norm(mapped - np.column_stack([curve, np.zeros(60)]), axis=1)
        yield r, bool((error <= r.tre95_curve_m(photographed(curve, tilt_deg))).all())


def photograph_row(tilt_deg: float, sets: int) -> str:
    """How often an angle is refused, doubted or noted, and how often the bound holds."""
    count: Counter[str] = Counter()
    for r, is_bound in photographed_sets(tilt_deg, sets):
        findings = {finding.code: finding.severity for finding in registration_findings(r)}
        findings.pop("layout-symmetric", None)
        findings.pop("markers-unchecked", None)
        verdict = "silent"
        if r.fre_rms_m > 1e-3:
            verdict = "refused"
        elif "doubt" in findings.values():
            verdict = "doubt"
        elif findings:
            verdict = "note"
        count[verdict] += 1
        count["bound"] += is_bound
        count["safe"] += is_bound or verdict != "silent"
    return (
        f"| {tilt_deg:g}° | {sets} | {count['refused']} | {count['doubt']} | {count['note']} | "
        f"{count['silent']} | {count['bound'] / sets:.0%} | {count['safe'] / sets:.1%} |"
    )


def visible_tilt_deg(n: int, fle_m: float, probability: float) -> float:
    """The tilt that is found in nine of ten sets, by a test of this probability.

    The F of the test is noncentral: λ is the sum of squares that perspective leaves over σ². It
    grows with the square of the tilt's tangent.
    """
    from scipy.special import fdtri, ncfdtr

    rng = np.random.default_rng(5)
    noncentrality = []
    for _ in range(200):
        plate = rng.uniform(-0.13, 0.13, (n, 2))
        exact = fit_registration(photographed(plate, 1.0), np.column_stack([plate, np.zeros(n)]))
        noncentrality.append((exact.residuals_m**2).sum() / (fle_m**2 / 3))
    limit = fdtri(2, 3 * n - 11, 1 - probability)
    for tilt_deg in np.arange(0.1, 90, 0.1):
        growth = (np.tan(np.radians(tilt_deg)) / np.tan(np.radians(1.0))) ** 2
        power = 1 - ncfdtr(2, 3 * n - 11, growth * np.array(noncentrality), limit)
        if power.mean() >= 0.9:
            return float(tilt_deg)
    return float("nan")


def tilt_row(n: int) -> str:
    """The tilt that is noted, and that is doubted, in nine of ten sets of n markers."""
    cells = [str(n)]
    for fle_m in (1e-4, 3e-4, 5e-4, 1e-3):
        noted = visible_tilt_deg(n, fle_m, POSSIBLE_PERSPECTIVE)
        doubted = visible_tilt_deg(n, fle_m, SURE_PERSPECTIVE)
        cells.append(f"{noted:.1f}°, {doubted:.1f}°")
    return f"| {' | '.join(cells)} |"


def rectified_row(view: int) -> str | None:
    """A real photograph of a board, registered as it is and rectified by the board's corners."""
    folder = Path(os.environ.get("VFPLAN_DATA", ROOT.parent / "shared" / "data")) / "photo_px_to_mm"
    if not folder.is_dir():
        return None
    pixels = np.loadtxt(folder / f"calib.image_points.{view}.txt")
    board_m = np.loadtxt(folder / f"calib.object_points.{view}.txt") / 1e3
    flat_mm = 1e3 * board_m[:, :2]
    corners = []
    for side in ([-1, -1], [1, -1], [1, 1], [-1, 1]):
        corners.append(int(np.argmax(flat_mm @ side)))
    rectified = rectified_px(pixels, pixels[corners], flat_mm[corners])
    others = np.setdiff1d(np.arange(len(pixels)), corners)
    as_it_is = fit_registration(pixels[others], board_m[others])
    straight = fit_registration(rectified[others], board_m[others])
    return f"| {view} | {1e3 * as_it_is.fre_rms_m:.2f} mm | {1e3 * straight.fre_rms_m:.2f} mm |"


def rectified_px(
    places_px: NDArray[np.float64], corners_px: NDArray[np.float64], corners_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where places (N, 2) of a photograph come to lie once four corners are where they belong."""
    import cv2

    transform = cv2.getPerspectiveTransform(np.float32(corners_px), np.float32(corners_mm))
    return cv2.perspectiveTransform(places_px[None], transform)[0]


def photographed(plate: NDArray[np.float64], tilt_deg: float) -> NDArray[np.float64]:
    """(N, 2) pixels of points (N, 2) [m] of a plate tilted about an axis across the picture."""
    tilt = np.radians(tilt_deg)
    along = 0.8 * plate[:, 0] + 0.6 * plate[:, 1]
    across = 0.8 * plate[:, 1] - 0.6 * plate[:, 0]
    depth = CAMERA_M + np.sin(tilt) * along
    foreshortened = np.cos(tilt) * along
    x = 0.8 * foreshortened - 0.6 * across
    y = 0.6 * foreshortened + 0.8 * across
    return FOCAL_LENGTH_PX * np.column_stack([x, y]) / (depth[:, None])


def processor_time() -> str:
    """Processor time of `register`'s work in a plan of the sample, modules loaded."""
    from vfplan.planning.extraction import extract
    from vfplan.planning.match import Record, match
    from vfplan.planning.plan import register
    from vfplan.planning.settings import FixtureSettings

    files = SAMPLES / "elbow_markers_image.csv", SAMPLES / "elbow_markers_robot.csv"
    extracted = extract(SAMPLES / "elbow.png")
    whole_s = []
    for _ in range(REPEATS):
        started = time.process_time()
        register(extracted.fixture, *files, image=extracted.image)
        whole_s.append(time.process_time() - started)
    match_s = []
    for _ in range(REPEATS):
        started = time.process_time()
        matched = match(extracted.fixture, *files, FixtureSettings(), extracted.image, Record())
        target_error(matched.registration, extracted.fixture.points)
        match_s.append(time.process_time() - started)
    return (
        f"register: {np.median(whole_s):.3f} s of processor time, of these "
        f"{np.median(match_s):.3f} s markers, fit, checks and error; the rest is sampling, lines "
        "and arcs"
    )


def tables(sets: int) -> Iterator[tuple[str, list[str]]]:
    """The tables of the page, each by its header."""
    yield (
        "| kind of marker set | model | number of sets | refused | with a doubt "
        "| with notes only | without a finding |",
        label_rows(sets),
    )
    yield "| what `plan` says | mistakes that get this answer |", reading_rows()
    coverage = []
    for model in MODELS:
        coverage.append(coverage_row(model, 5 * sets))
    yield (
        "| model | number of sets | bound of a point holds | bound of the whole curve holds |",
        coverage,
    )
    photographs = []
    for tilt in (0, 1, 2, 5, 10, 20):
        photographs.append(photograph_row(tilt, sets))
    yield (
        "| tilt of the camera | number of photographs | refused | with a doubt | with notes only "
        "| without a finding | the bound holds "
        "| the bound holds, or vfplan refused or gave a doubt or a note |",
        photographs,
    )
    tilts = []
    for markers in (6, 8, 10, 12):
        tilts.append(tilt_row(markers))
    yield (
        "| number of markers | two tilts at FLE 0.1 mm | two tilts at FLE 0.3 mm "
        "| two tilts at FLE 0.5 mm | two tilts at FLE 1 mm |",
        tilts,
    )
    rectified = []
    for view in (0, 3):
        line = rectified_row(view)
        if line is not None:
            rectified.append(line)
    if rectified:
        yield (
            "| number of the photograph | RMS residual without rectifying "
            "| RMS residual after rectifying |",
            rectified,
        )


def write_table(header: str, lines: list[str]) -> None:
    """Put a table in the place of the one on the page that has the same header."""
    page = PAGE.read_text().splitlines()
    start = page.index(header)
    end = start
    while end < len(page) and page[end].startswith("|"):
        end += 1
    page[start:end] = lines
    PAGE.write_text("\n".join(page) + "\n")


def main(words: list[str]) -> None:
    """Print all tables, and write them to the page if asked for."""
    sets = 600
    for word in words:
        if word.isdigit():
            sets = int(word)
    for header, rows in tables(sets):
        columns = header.count("|") - 1
        table = [header, f"|{'---|' * columns}", *rows]
        print("\n".join(table), flush=True)
        print()
        if "--write" in words:
            write_table(header, table)
    print(processor_time())


if __name__ == "__main__":
    main(sys.argv[1:])
