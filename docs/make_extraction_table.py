"""Measure the ridge's error, time and memory on drawn curves, the tables in extraction.md:

python docs/make_extraction_table.py [speed | deviation]

Four curves (two open, two closed) for each picture and pen, drawn by exact coverage
(`tests/support/drawing.py`); minutes, not seconds. With `speed` only time and memory; with
`deviation` only the stated deviation's z-scores on straight lines, rings and corners.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from drawing import (
    anatomy,
    blend,
    compare,
    coverage,
    flat,
    jpeg,
    straight_coverage,
    to_uint8,
    wavy,
)

import vfplan
from vfplan.curve import load_libraries

SHAPE = (380, 430)
PENS = (2, 3, 5, 8)
RED, DARK = (255, 0, 0), (178, 34, 34)
# name, colour, opacity, gamma of the blending, scale after drawing, JPEG quality
PICTURES = [
    ("PNG", RED, 1.0, 1.0, 1.0, None),
    ("PNG, 35 % opaque", RED, 0.35, 1.0, 1.0, None),
    ("PNG, linear light", RED, 1.0, 2.2, 1.0, None),
    ("PNG, rescaled by 1.37", RED, 1.0, 1.0, 1.37, None),
    ("PNG, enlarged by 2.5", RED, 1.0, 1.0, 2.5, None),
    ("JPEG 90", RED, 1.0, 1.0, 1.0, 90),
    ("JPEG 75", RED, 1.0, 1.0, 1.0, 75),
    ("JPEG 50", RED, 1.0, 1.0, 1.0, 50),
    ("JPEG 75, dark pen at 60 %", DARK, 0.6, 1.0, 1.0, 75),
]


def main() -> None:
    """Print what is asked for."""
    if sys.argv[1:] in ([], ["deviation"]):
        print_deviation()
    if not sys.argv[1:]:
        print_errors()
    if sys.argv[1:] in ([], ["speed"]):
        print_speed()


def print_deviation() -> None:
    """Print RMS error and z-scores of straight lines by slope, of rings and of corners."""
    print("| line | PNG: RMS error [px] | RMS z | JPEG 80: RMS error [px] | RMS z |")
    print("|---|---|---|---|---|")
    slopes = (0.0, 0.003, 0.02, 0.05, 0.125, 0.3, 0.5, 1.0)
    kinds = [(f"straight, slope {x:g}", straight, x) for x in slopes]
    kinds += [(f"ring, radius {x} px", ring, x) for x in (12, 25, 60)]
    kinds += [(f"corner of {x}°", corner, x) for x in (90, 150)]
    for name, draw, value in kinds:
        drawn = [draw(value, pen, k) for pen in (2, 2.2, 3, 4.5, 5) for k in (0, 1)]
        cells = [name]
        for quality in (None, 80):
            found = [scored(*line, quality) for line in drawn]
            z = [e.z_rms for e in found]
            cells += [f"{root_mean_square([e.rms for e in found]):.3f}"]
            cells += [f"{root_mean_square(z):.1f} ({min(z):.1f}–{max(z):.1f})"]
        print("| " + " | ".join(cells) + " |", flush=True)


def root_mean_square(values):
    """Of a list of numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


def straight(slope, pen, k):
    """Truth, coverage and whether it is closed: once along rows, once along columns."""
    ends, share = straight_coverage(slope, (60.13, 59.71)[k], pen, bool(k))
    return ends, share, False


def ring(radius, pen, k):
    """A circle off the pixels' middles."""
    t = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    middle = 100 + np.array([(0.37, -0.19), (-0.42, 0.08)][k])
    curve = middle + radius * np.column_stack([np.cos(t), np.sin(t)])
    return curve, coverage((200, 200), curve, pen, True), True


def corner(degrees, pen, k):
    """Two straight legs of 80 px."""
    turn = (0.31, 1.87)[k] + np.radians(degrees) * np.array([-0.5, 0.5])
    legs = 100.2 + 80 * np.column_stack([np.cos(turn), np.sin(turn)])
    curve = np.array([legs[0], [100.2, 100.2], legs[1]])
    return curve, coverage((200, 200), curve, pen), False


def scored(curve, share, closed, quality):
    """Extract a line drawn on light grey and compare it with its truth."""
    image = to_uint8(blend(flat(share.shape), share, RED))
    stroke = vfplan.extract_curve(jpeg(image, quality) if quality else image).strokes[0]
    return compare(stroke, curve, closed)


def print_errors() -> None:
    """Print one row a picture: RMS error for each pen, and the range of the z-scores' RMS."""
    shares = {
        (seed, pen): coverage(SHAPE, wavy(SHAPE, seed, seed % 2 == 0), pen, seed % 2 == 0)
        for seed in (1, 2, 3, 4)
        for pen in PENS
    }
    print("| picture | RMS error [px], pens of 2 / 3 / 5 / 8 px | RMS z |\n|---|---|---|")
    for name, *look in PICTURES:
        found = [[measure(shares[seed, pen], seed, *look) for seed in (1, 2, 3, 4)] for pen in PENS]
        rms = [np.sqrt(np.mean([e.rms**2 for e in pen])) for pen in found]
        z = [np.sqrt(np.mean([e.z_rms**2 for e in pen])) for pen in found]
        cells = " / ".join(f"{x:.3f}" for x in rms)
        print(f"| {name} | {cells} | {min(z):.1f}–{max(z):.1f} |", flush=True)


def print_speed() -> None:
    """Print processor time (the best of five runs) and peak memory above the decoded image."""
    load_libraries()
    small = drawn((786, 871))
    large = np.tile(small[:683, :683].mean(2, dtype=np.uint32).astype(np.uint8), (6, 6))[:4096]
    large = np.repeat(large[:, :4096, None], 3, axis=2)
    large[:786, :871] = small
    large[4080:4082, 4080:4082] = RED  # so that the pen's box is the whole picture
    print("| picture | time [ms] | peak memory [bytes a pixel] |\n|---|---|---|")
    pictures = {"871 x 786, PNG": small, "871 x 786, JPEG 75": jpeg(small, 75)}
    for name, image in (pictures | {"4096 x 4096, PNG": large}).items():
        best = min(seconds(image) for _ in range(5))
        tracemalloc.start()
        vfplan.extract_curve(image)
        peak = tracemalloc.get_traced_memory()[1] / image[..., 0].size
        tracemalloc.stop()
        print(f"| {name} | {1e3 * best:.0f} | {peak:.1f} |", flush=True)


def drawn(shape):
    """A slice with a closed 3 px curve."""
    share = coverage(shape, wavy(shape, 2, True), 3, True)
    return to_uint8(blend(anatomy(shape, 2), share, RED))


def seconds(image):
    """Processor time of one extraction."""
    start = time.process_time()
    vfplan.extract_curve(image)
    return time.process_time() - start


def measure(share, seed, colour, opacity, gamma, scale, quality):
    """Draw one curve, extract it and compare it with its truth."""
    picture = blend(anatomy(SHAPE, seed), share, colour, opacity, gamma)
    curve = (wavy(SHAPE, seed, seed % 2 == 0) + 0.5) * scale - 0.5
    if scale != 1.0:
        how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=how)
    image = to_uint8(picture)
    image = jpeg(image, quality) if quality else image
    stroke = vfplan.extract_curve(image, stroke="longest").strokes[0]
    return compare(stroke, curve, stroke.closed)


if __name__ == "__main__":
    main()
