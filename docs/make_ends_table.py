"""Measure how far extracted lines end from the drawn ones, the tables of ends in extraction.md:

python docs/make_ends_table.py

Arcs at many angles for each pen, over bright soft tissue and over ground that is darker, of the
pen's own brightness in places and full of bones' edges; drawn by exact coverage
(`tests/support/drawing.py`). Minutes, not seconds.
"""

from __future__ import annotations

import functools
import sys
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from drawing import anatomy, blend, coverage, jpeg, to_uint8

import vfplan

SHAPE, RED = (150, 150), (255, 0, 0)
PENS = (2.2, 3, 4.5, 8)
QUALITIES = (None, 80, 75)
ARCS = 10
ALLOWED_PX, EARLY_PX = 1.5, 2.0
STEP_PX = 0.25  # of an arc's points
SOFT_PX = 4.0


def main() -> None:
    """Print both tables."""
    names = [f"JPEG {quality}" if quality else "PNG" for quality in QUALITIES]
    print("| ground | pen [px] | " + " | ".join(names) + " |\n" + "|---" * 5 + "|")
    for ground in ("soft", "bones"):
        for width in PENS:
            cells = [share_within(ground, width, quality) for quality in QUALITIES]
            print(f"| {ground} | {width} | " + " | ".join(cells) + " |", flush=True)
    print("\n| pen [px] | flat end | JPEG 80 | JPEG 75 |\n|---|---|---|---|")
    for width in PENS:
        print(f"| {width} | " + " | ".join(f"{x:.1f}" for x in differences(width)) + " |")


def arc(seed: int) -> np.ndarray:
    """(M, 2) px, 110 px long, turning by up to 1.5 rad."""
    rng = np.random.default_rng(seed)
    count = int(110 / STEP_PX)
    heading = rng.uniform(0, 2 * np.pi) + rng.uniform(-1.5, 1.5) * np.linspace(-0.5, 0.5, count)
    path = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0) * STEP_PX
    return path - (path.min(0) + path.max(0)) / 2 + 75 + rng.uniform(-1, 1, 2)


@functools.cache
def share_of(seed: int, width: float, cap: str) -> np.ndarray:
    """The coverage of an arc's pen."""
    return coverage(SHAPE, arc(seed), width, cap=cap)


def painted(ground: str, seed: int, share: np.ndarray) -> np.ndarray:
    """The picture of a line."""
    under = anatomy(SHAPE, seed)
    under = cv2.GaussianBlur(under, (0, 0), SOFT_PX) / 4 + 180 if ground == "soft" else under
    return to_uint8(blend(under, share, RED))


def share_within(ground: str, width: float, quality: int | None) -> str:
    """Ends within 1.5 px in percent: round, round where the truth stops 2 px early, flat."""
    found = {"round": [], "early": [], "flat": []}
    cut = int(EARLY_PX / STEP_PX)
    for seed in range(ARCS):
        curve = arc(seed)
        for name, cap in (("round", "round"), ("flat", "butt")):
            picture = painted(ground, seed, share_of(seed, width, cap))
            image = jpeg(picture, quality) if quality else picture
            ends = vfplan.extract_curve(image).strokes[0].points_px[[0, -1]]
            found[name] += distances(ends, curve[[0, -1]])
            if name == "round":
                found["early"] += distances(ends, curve[[cut, -1 - cut]])
    return " / ".join(f"{100 * np.mean(np.array(d) <= ALLOWED_PX):.0f}" for d in found.values())


def distances(ends: np.ndarray, truth: np.ndarray) -> list[float]:
    """Of two ends from the nearer of two true ones [px]."""
    return [float(np.hypot(*(truth - end).T).min()) for end in ends]


def differences(width: float) -> list[float]:
    """RMS grey levels around a round end, the medians over arcs on soft ground.

    First the difference from the flat end most like it, then what JPEG 80 and 75 do to it.
    """
    found = []
    for seed in range(ARCS // 2):
        curve = arc(seed)
        u, v = np.rint(curve[-1]).astype(int)
        reach = int(width / 2) + 3
        window = (slice(v - reach, v + reach + 1), slice(u - reach, u + reach + 1))
        picture = painted("soft", seed, share_of(seed, width, "round"))
        out = (curve[-1] - curve[-2]) / STEP_PX
        others = [
            painted("soft", seed, coverage(SHAPE, np.vstack([curve, end]), width, cap="butt"))
            for end in curve[-1] + np.arange(0.3, 0.5, 0.05)[:, None] * width * out
        ]
        others += [jpeg(picture, 80), jpeg(picture, 75)]
        rms = [np.sqrt(np.mean((1.0 * other - picture)[window] ** 2)) for other in others]
        found.append([min(rms[:-2]), *rms[-2:]])
    return list(np.median(found, axis=0))


if __name__ == "__main__":
    main()
