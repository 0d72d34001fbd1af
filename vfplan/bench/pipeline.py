"""Stages extract, register, sample and plan, and all stages as one document.

extract
    Methods x image scale x JPEG quality x pen width. Errors are distances from the drawn centre
    line in pixels of the slice at scale 1, so that a coarse and a fine capture of one drawing
    compare. The baseline is what a user would write first: threshold the hue, thin the mask. The
    pen is a disc swept along the curve, and paints its exact share of every pixel.
register
    Models x number of markers x noise. The markers lie on a jittered grid over an 871 x 786 slice
    of 0.5 mm pixels; each is touched with normal noise of a known size an axis. The error is that
    of the whole planned curve, over many draws of the noise.
sample
    Spacing against the error of the fixture's surface and against the cost of a tick. The surface
    that a cloud renders is where the nearest point is R away; the surface that was planned is where
    the curve is R away. The error is the gap between the two at places of the planned surface: 0
    beside a point, and the depth of the dimple between two points. The time is that of a tick of
    the robust engine on this cloud, along the curve.
plan
    The whole pipeline on the shipped elbow. The error is how far the surface that the fixture's
    cloud renders lies from the true one, on either side of it, at places of the true surface. The
    true surface is that of the drawn curve on the robot's table. With the shipped markers, which
    were touched with 0.2 mm noise, the registration's error counts too; with exact markers only
    extraction and sampling contribute.
"""

from __future__ import annotations

import os
import platform
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from importlib.resources import files
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from vfplan.bench.peers import Peer
from vfplan.bench.proxy import Elbow, R, elbow_truth, proxy_scenes
from vfplan.bench.record import (
    FEWEST_REPEATS,
    LOOKS,
    TOLERANCE_M,
    Array,
    BenchRun,
    Record,
    Scenes,
    Settings,
    errors_of,
    mark_pareto,
    measure_runs,
    summaries,
    timed,
    timed_ticks,
)
from vfplan.display import Progress, Report
from vfplan.engine.proxy import ProxyEngine
from vfplan.errors import CurveError
from vfplan.fixture import Pieces
from vfplan.geometry.lines import arc_lengths, interpolated, normals, row_lengths
from vfplan.planning.plan import plan
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.planning.tolerance import RATE_HZ, choose, sample_curve
from vfplan.registration.models import homogeneous
from vfplan.scenes.outline import Run, arc, in_space, segment

# Width of the drawn slice at scale 1 [px].
WIDTH_PX = 640

# Height of the drawn slice at scale 1 [px].
HEIGHT_PX = 3 * WIDTH_PX // 4

# A pixel's coverage is counted on a grid of this many places along u and along v.
SUBPIXELS = 8


def extract_scenes(quick: bool) -> Scenes:
    """The runs of each pen and quality."""
    scales, pens_px, qualities = [0.5, 0.75, 1.0, 1.5, 2.0], [1.5, 3.0, 5.0], [None, 90, 75, 50]
    if quick:
        scales, pens_px, qualities = [0.5, 1.0], [3.0], [None, 75]
    for pen_px, quality in product(pens_px, qualities):
        scene = f"pen {pen_px:g} px, " + ("lossless" if quality is None else f"JPEG {quality}")
        runs = []
        for scale, (method, extract) in product(scales, EXTRACTIONS.items()):
            run = partial(timed, partial(extract, pen_slice(pen_px, quality, scale)))
            score = partial(score_points, truth=curve(), scale=scale)
            # The chosen setting is the slice as it is.
            chosen = method == "ridge" and scale == 1
            runs.append(BenchRun(scene, method, {"scale": scale}, run, score, "px", chosen))
        yield runs


@lru_cache(maxsize=32)
def pen_slice(pen_px: float, quality: int | None = None, scale: float = 1.0) -> NDArray[np.uint8]:
    """(H, W, 3) uint8, red first: the bench's curve, drawn on a slice.

    pen_px: the pen's width at scale 1 [px]
    quality: JPEG quality with 4:2:0 chroma; `None`: lossless
    scale: pixels of the image for each pixel of the original: how fine the slice was captured
    """
    if quality is not None:
        import cv2

        flags = [cv2.IMWRITE_JPEG_QUALITY, quality]
        flags += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
        _, data = cv2.imencode(".jpg", pen_slice(pen_px, None, scale)[..., ::-1], flags)
        return np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])
    shape = (round(HEIGHT_PX * scale), round(WIDTH_PX * scale))
    # A pixel's centre is a whole number.
    share = coverage(shape, (curve() + 0.5) * scale - 0.5, pen_px * scale)
    grey = grey_slice(shape, scale)[..., None]
    painted = grey + share[..., None] * (np.array([226.0, 26.0, 32.0]) - grey)
    rgb = np.clip(np.rint(painted), 0, 255).astype(np.uint8)
    rgb.setflags(write=False)
    return rgb


@lru_cache(maxsize=1)
def curve() -> Array:
    """(M, 2) the true centre line at scale 1 [px], 0.05 px apart: straight, wavy, bent tightly."""
    t = np.linspace(0, 1, 40_001)
    u = 70 + 430 * t + 45 * np.sin(2 * np.pi * t) * t
    v = 250 + 95 * np.sin(5.2 * t + 0.4) + 26 * np.sin(17 * t + 1.0) * t
    line = np.column_stack([u, v])
    s = arc_lengths(line, False)
    return interpolated(np.arange(0, s[-1], 0.05), s, line)


def coverage(shape: tuple[int, int], line: Array, width: float) -> Array:
    """(H, W) share of each pixel that a pen of `width` px along `line` (M, 2) covers."""
    # Only the pixels close to the line can hold ink.
    tree = cKDTree(line)
    places = np.indices(shape)[::-1].reshape(2, -1).T
    away, _ = tree.query(places, distance_upper_bound=width / 2 + 1)
    rows, cols = np.nonzero(np.isfinite(away).reshape(shape))

    # Of each of these, the share of its inner places that the pen covers.
    offset = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    du, dv = np.tile(offset, SUBPIXELS), np.repeat(offset, SUBPIXELS)
    inner = np.column_stack([(cols[:, None] + du).ravel(), (rows[:, None] + dv).ravel()])
    distance, _ = tree.query(inner, distance_upper_bound=width / 2 + 1)
    share = np.zeros(shape)
    share[rows, cols] = (distance <= width / 2).reshape(len(rows), -1).mean(axis=1)
    return share


@lru_cache(maxsize=8)
def grey_slice(shape: tuple[int, int], scale: float) -> Array:
    """(H, W) grey 0..255: soft tissue, two bright-rimmed bones, fine noise; the same every time."""
    from scipy.ndimage import gaussian_filter

    v, u = np.mgrid[0 : shape[0], 0 : shape[1]] / scale
    grey = 105 + 45 * np.sin(u / 83 + 1) * np.cos(v / 61)
    for centre, size in (((190, 150), 88), ((430, 330), 70)):
        depth = size - np.hypot(u - centre[0], 1.2 * (v - centre[1]))
        grey = np.where(depth > 0, 140 + 95 * np.exp(-((depth / 7) ** 2)), grey)
    rng = np.random.default_rng(3)
    return np.clip(gaussian_filter(grey, 0.8) + rng.normal(0, 2.5, shape), 5, 250)


def score_points(points_px: Array, truth: Array, scale: float) -> Record:
    """Distances of extracted points from the true line, and of the line from them [px]."""
    points, count = (points_px + 0.5) / scale - 0.5, len(truth)
    line = Pieces(in_space(truth), np.zeros(count), np.zeros(count, np.int32), np.zeros(1, bool))
    distances = ProxyEngine.along(line).distance(in_space(points))
    uncovered, _ = cKDTree(points).query(truth[::5])
    return errors_of(distances, uncovered_px=float(uncovered.max()), points=len(points))


def extract_points(picture: Any, method: str) -> Array:
    """The points that `vfplan.extract_curve` gives [px]."""
    from vfplan.curve.extraction import extract_curve

    strokes = extract_curve(picture, method=method, stroke="longest").strokes
    return np.concatenate([stroke.points_px for stroke in strokes])


def thin_hue_mask(picture: Any) -> Array:
    """The baseline: the pixels of a reddish hue, thinned; the recipe that a search finds first."""
    import cv2
    from skimage.morphology import skeletonize

    hue, saturation, value = cv2.split(cv2.cvtColor(picture, cv2.COLOR_RGB2HSV))
    mask = ((hue < 10) | (hue > 170)) & (saturation > 100) & (value > 80)
    if not mask.any():
        raise CurveError("no pixel passes the gate on hue. Draw in red", code="no-hue")
    v, u = np.nonzero(skeletonize(mask))
    return np.column_stack([u, v]).astype(float)


EXTRACTIONS: dict[str, Callable[[Any], Array]] = {
    "ridge": partial(extract_points, method="ridge"),
    "skeleton": partial(extract_points, method="skeleton"),
    "mask (the paper's)": partial(extract_points, method="mask"),
    "hue + thinning": thin_hue_mask,
}

# Size of a pixel of the slice [m].
PIXEL_M = 0.5e-3

# Number of markers of the setting that counts as chosen, as on the sample.
DEFAULT_MARKERS = 9


def register_scenes(quick: bool) -> Scenes:
    """The runs of each noise and print."""
    noises_mm, counts, draws = [0.05, 0.2, 1.0], [4, 6, 9, 16, 25, 49], 100
    if quick:
        noises_mm, counts, draws = [0.2], [4, 9, 25], 30
    # Only the affine map can follow a print that a copier stretched in one direction.
    prints = (("true scale", 1.0), ("stretched 1 %", 1.01))
    for noise_mm, (name, stretch) in product(noises_mm, prints):
        T = elbow_truth()[1] * [stretch, 1.0, 1.0]
        runs = []
        for count in counts:
            source = markers_px(count)
            noise = np.random.default_rng(11).normal(0, 1e-3 * noise_mm, (draws, count, 3))
            for method, fit in FITS.items():
                run = partial(fit_all, fit, source, homogeneous(source) @ T.T + noise)
                chosen = method == "affine" and count == DEFAULT_MARKERS
                scene = f"{noise_mm:g} mm noise, {name}"
                score = partial(score_maps, T=T)
                runs.append(BenchRun(scene, method, {"markers": count}, run, score, "m", chosen))
        yield runs


def markers_px(count: int) -> Array:
    """(count, 2) marker positions on a jittered grid that surrounds the curve [px]."""
    rng = np.random.default_rng(count)
    side = int(np.ceil(np.sqrt(count)))
    u, v = np.meshgrid(np.linspace(90, 780, side), np.linspace(80, 705, side))
    grid = np.column_stack([u.ravel(), v.ravel()])
    picked = np.round(np.linspace(0, len(grid) - 1, count)).astype(int)
    return grid[picked] + rng.uniform(-25, 25, (count, 2))


def fit_all(
    fit: Callable[[Array, Array], Array], source: Array, targets: Array
) -> tuple[list[Array], Array]:
    """The map of each draw of the noise, and the time of each fit [µs]."""
    fits = [timed(partial(fit, source, target)) for target in targets]
    return [T for T, _ in fits], np.concatenate([us for _, us in fits])


def score_maps(maps: list[Array], T: Array) -> Record:
    """Target registration error over the planned curve and all draws [m]."""
    t = np.linspace(0, 1, 60)
    curve = homogeneous(np.column_stack([200 + 480 * t, 380 + 170 * np.sin(5 * t)]))
    errors = np.array([row_lengths(curve @ m.T - curve @ T.T) for m in maps])
    return errors_of(errors, draws=len(maps))


def fit_model(source: Array, target: Array, model: str) -> Array:
    """The map that `vfplan.fit_registration` gives."""
    from vfplan.registration.registration import fit_registration

    return fit_registration(source, target, model=model, pixel_spacing=PIXEL_M).T_target_source


def fit_bare(source: Array, target: Array) -> Array:
    """The paper's ordinary least squares, bare: no residuals, no covariance, no checks."""
    return np.linalg.lstsq(homogeneous(source), target, rcond=None)[0].T


FITS: dict[str, Callable[[Array, Array], Array]] = {
    **{model: partial(fit_model, model=model) for model in ("affine", "similarity", "rigid")},
    "bare least squares": fit_bare,
}

# Arc between the true curve's vertices [m].
FINE_M = 20e-6

# Points a metre of the paper's Experiment 2.
PAPER_DENSITY = 5.3e3

# Number of ticks along the curve.
TICKS = 600

# Depth to which the HIP is pressed in [m].
PRESS_M = 1e-3


@dataclass(frozen=True, eq=False)
class TrueCurve:
    """A true curve in the plane z = 0, and the name of its scene."""

    name: str
    run: Run

    @cached_property
    def fine(self) -> Array:
        """(M, 3) [m], every 20 µm of arc."""
        return in_space(self.run.sample(FINE_M))

    @cached_property
    def normals(self) -> Array:
        """(M, 3) unit normals at the vertices of `fine`, to the left."""
        return in_space(normals(self.fine[:, :2], self.run.closed))


def sample_scenes(quick: bool) -> Scenes:
    """The runs of each curve."""
    tolerances, curves = [1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7], lines()
    if quick:
        tolerances, curves = [1e-4, 1e-5, 1e-6], curves[1:]
    chosen_m = choose(TOLERANCE_M, R).sampling_tolerance_m
    for line in curves:
        # A HIP along the left side of the curve, pressed in, after an approach from outside.
        picked = np.linspace(0, len(line.fine) - 1, TICKS).astype(int)
        path = (line.fine + (R - PRESS_M) * line.normals)[picked]
        start = line.fine[0] + 3 * R * line.normals[0]
        approach = start + np.linspace(0, 1, 40)[:, None] * (path[0] - start)
        make = partial(sample_run, line, planned_surface(line), np.vstack([approach, path]))

        even = ("by curvature", "even, by R alone")
        runs = [make(method, {"tolerance_m": m}) for m, method in product(tolerances, even)]
        runs.append(make("the paper's density", {"density_per_m": PAPER_DENSITY}))
        yield [*runs, make("by curvature", {"tolerance_m": chosen_m}, chosen=True)]


def lines() -> list[TrueCurve]:
    """A straight line, a circle of 30 mm, an S of 8 mm bends, and a hairpin of 2 mm."""
    straight = Run((segment((0, 0), (0.1, 0)),))
    circle = Run((arc((0, 0), 30e-3, 0, 2 * np.pi),), closed=True)
    bends = Run((arc((0, 0), 8e-3, np.pi, -np.pi), arc((16e-3, 0), 8e-3, np.pi, np.pi)))
    there, back = segment((-30e-3, 2e-3), (0, 2e-3)), segment((0, -2e-3), (-30e-3, -2e-3))
    hairpin = Run((there, arc((0, 0), 2e-3, np.pi / 2, -np.pi), back))
    return [TrueCurve("line", straight), TrueCurve("circle, 30 mm", circle),
            TrueCurve("S, 8 mm bends", bends), TrueCurve("hairpin, 2 mm", hairpin)]  # fmt: skip


def sample_run(
    line: TrueCurve,
    surface: Array,
    hips: Array,
    method: str,
    settings: Settings,
    chosen: bool = False,
) -> BenchRun:
    """One method of sampling with one setting, and the engine's ticks on the cloud it gives."""
    points = SAMPLINGS[method](line, **settings)
    engine = ProxyEngine(points, contact_radius=R, ignore_axis="z")

    def score(trace: object) -> Record:
        return errors_of(surface_error(points, surface), points=len(points))

    run = partial(timed_ticks, engine, hips)
    return BenchRun(line.name, method, settings, run, score, "m", chosen)


def planned_surface(line: TrueCurve) -> Array:
    """(K, 3) places of the planned surface: R beside the curve and round its ends [m].

    What another part of the curve swallows does not belong to it.
    """
    fine, left = line.fine, line.normals
    places = [fine + R * left, fine - R * left]
    if not line.run.closed:
        turn = np.linspace(0, 2 * np.pi, 799)
        ring = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
        places += [end + R * ring for end in fine[[0, -1]]]
    everything = np.vstack(places)
    nearest, _ = cKDTree(fine).query(everything)
    return everything[nearest >= R * (1 - 1e-5)]


def surface_error(points: Array, surface: Array) -> Array:
    """(K,) how far the nearest point is beyond R from each place of the planned surface [m]."""
    nearest, _ = cKDTree(points).query(surface)
    return np.maximum(nearest - R, 0.0)


def sample_as_planned(line: TrueCurve, **settings: float) -> Array:
    """The points that a plan takes from a tolerance or a density."""
    return sample_curve(line.fine, line.run.closed, radius_m=R, **settings).points


def sample_evenly(line: TrueCurve, tolerance_m: float) -> Array:
    """Points as dense as the flat dimple formula h²/8R = tolerance allows, bends or not."""
    return sample_as_planned(line, density_per_m=1 / np.sqrt(8 * R * tolerance_m))


SAMPLINGS: dict[str, Callable[..., Array]] = {
    "by curvature": sample_as_planned,
    "even, by R alone": sample_evenly,
    "the paper's density": sample_as_planned,
}


def plan_scenes(quick: bool) -> Scenes:
    """The runs with the shipped and with exact markers."""
    tolerances = [1e-4, 1e-5] if quick else [3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6]
    # Every fifth place of the true surface counts, 0.1 mm apart.
    score = partial(score_plan, surface=planned_surface(TrueCurve("elbow", *Elbow().runs))[::5])
    sample = Path(str(files("vfplan.samples")))
    source, touched = (sample / f"elbow_markers_{frame}.csv" for frame in ("image", "robot"))
    with tempfile.TemporaryDirectory(prefix="vfplan-bench-") as name:
        exact = Path(name) / "robot.csv"
        write_exact_markers(source, exact)
        for scene, target in (("markers touched", touched), ("exact markers", exact)):
            runs = []
            for method, listed, extraction, settings in plan_methods(tolerances):
                call = partial(plan, sample / "elbow.png", source, target, extraction=extraction,
                               settings=settings)  # fmt: skip
                chosen = method == "ridge" and settings == FixtureSettings()
                runs.append(BenchRun(f"elbow, {scene}", method, listed, partial(timed, call),
                                     score, "m", chosen))  # fmt: skip
            yield runs


def plan_methods(
    tolerances: list[float],
) -> Iterator[tuple[str, Settings, ExtractSettings, FixtureSettings]]:
    """The paths through the pipeline: name, setting for the table, and settings of both steps.

    The default at every tolerance, and the others at the one that is chosen: they take seconds.
    """
    as_it_is, chosen = ExtractSettings(), FixtureSettings()
    listed = {"tolerance_m": TOLERANCE_M}
    for tolerance in tolerances:
        yield "ridge", {"tolerance_m": tolerance}, as_it_is, replace(chosen, tolerance_m=tolerance)
    yield "skeleton", listed, ExtractSettings(method="skeleton"), chosen
    spacing = ExtractSettings(pixel_spacing_mm=(0.5, 0.5))
    yield "ridge, rigid", listed, spacing, replace(chosen, model="rigid")
    yield "the paper's: every mask pixel", {}, ExtractSettings(method="mask"), chosen


def write_exact_markers(source: Path, target: Path) -> None:
    """Write where the markers of the slice truly are in the robot's frame."""
    rows = np.loadtxt(source, str, delimiter=",", skiprows=1)
    places = homogeneous(rows[:, 1:].astype(float)) @ elbow_truth()[1].T
    lines = np.column_stack([rows[:, 0], places.astype(str)])
    np.savetxt(target, lines, "%s", ",", header="label,x_m,y_m,z_m", comments="")


def score_plan(planned: Any, surface: Array) -> Record:
    """|distance to the nearest point - R| at the true surface, in the plane of the table [m]."""
    points = planned.fixture.points * [1.0, 1.0, 0.0]
    nearest, _ = cKDTree(points).query(surface)
    return errors_of(nearest - R, points=len(points))


# Time for a tick of a 1 kHz controller [µs].
BUDGET_US = 1e6 / RATE_HZ

# Number of timed rounds; the medians of seven spread by some percent.
REPEATS = 7


def bench(
    stages: Sequence[str] = tuple(LOOKS),
    *,
    quick: bool = False,
    peers: Sequence[Peer] = (),
    progress: Progress = lambda label, total: nullcontext(lambda n: None),
) -> Report:
    """Measure error against run time.

    Parameters
    ----------
    stages
        Some of `LOOKS`.
    quick
        Fewer scenes, settings and repeats: under a minute instead of under ten.
    peers
        Outside programs, used by stage "proxy".
    progress
        A `with` block around each scene, given its name and how many rounds it has; yields what is
        called after each round.

    Returns
    -------
    dict
        The document of docs/accuracy.md: `results`, `peers`, `machine`, `chosen`, ...

    Raises
    ------
    SettingError
        A peer that failed.
    """
    scenes = {
        "extract": extract_scenes, "sample": sample_scenes, "register": register_scenes,
        "proxy": partial(proxy_scenes, peers=peers), "plan": plan_scenes,
    }  # fmt: skip
    for peer in peers:
        peer.check()
    repeats = FEWEST_REPEATS if quick else REPEATS
    started = time.perf_counter()
    records, refused = [], []
    for stage in stages:
        for runs in scenes[stage](quick):
            with progress(f"{stage}: {runs[0].scene}", 1 + repeats) as advance:
                measured, unusable = measure_runs(stage, runs, repeats, advance)
            records += measured
            refused += unusable
    mark_pareto(records)
    document = {
        "format": "vfplan-bench", "version": "1.0", "stages": list(stages), "quick": quick,
        "tolerance_m": TOLERANCE_M, "budget_us": BUDGET_US,
        "chosen": dict(vars(choose(TOLERANCE_M, R))),
        "results": records, "refused": refused,
        "peers": [{"name": p.name, "command": p.command, "ran": True} for p in peers],
        "machine": describe_machine(),
        "elapsed_s": time.perf_counter() - started,
    }  # fmt: skip
    return document | {"summary": summaries(document)}


def describe_machine() -> Report:
    """Processor, cores, system, Python, NumPy."""
    processor = platform.processor() or platform.machine()
    # Other systems have no such file.
    with suppress(OSError):
        named = re.search("model name\\s*: (.*)", Path("/proc/cpuinfo").read_text())
        if named:
            processor = named[1]
    return {
        "processor": processor,
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
