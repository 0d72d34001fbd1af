"""Measure the ridge's error, time and memory on drawn curves, the tables in extraction.md:

python docs/make_extraction_table.py [speed]

Four curves (two open, two closed) for each picture and pen, drawn by exact coverage
(`tests/drawing.py`); minutes, not seconds. With `speed` only time and memory.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from drawing import anatomy, blend, compare, coverage, jpeg, to_uint8, wavy

import vfplan
from vfplan.centreline import load_libraries

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
    if sys.argv[1:] != ["speed"]:
        print_errors()
    print_speed()


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
