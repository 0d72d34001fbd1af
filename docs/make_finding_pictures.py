"""Draw docs/pictures/findings.png: small slices with the code that vfplan gives to each.

    python docs/make_finding_pictures.py                 the picture of docs/findings.md
    python docs/make_finding_pictures.py --slices DIR    each slice as DIR/CODE.png, to try it

Each slice is drawn here, given to `vfplan.extract_curve`, and labelled with the code of the refusal
or of the first finding. A slice that gets another code than the one it is drawn for is an error.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np

import vfplan
from vfplan.errors import CurveError

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "making"))

from drawing import anatomy  # noqa: E402

PICTURE = ROOT / "docs" / "pictures" / "findings.png"
HEIGHT_PX = 150
WIDTH_PX = 220
COLOURS = {"red": (255, 0, 0), "blue": (40, 60, 220), "yellow": (255, 220, 0), "black": (0, 0, 0)}
PEN_PX = 3
COLUMNS = 4
FRACTION_BITS = 4
"""Bits behind the point of the coordinates that OpenCV draws at: 1/16 of a pixel."""


def main(arguments: list[str]) -> None:
    """Draw every slice, extract it, and put all on one sheet."""
    slices = drawn_slices()
    if arguments:
        folder = Path(arguments[1])
        folder.mkdir(parents=True, exist_ok=True)
        for code, picture in slices.items():
            cv2.imwrite(str(folder / f"{code}.png"), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
        return
    rows = -(-len(slices) // COLUMNS)
    figure, axes = plt.subplots(
        rows, COLUMNS, figsize=(2.6 * COLUMNS, 2.05 * rows), layout="constrained", dpi=110
    )
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, (code, picture) in zip(axes.flat, slices.items(), strict=False):
        answer, place = verdict(picture)
        if answer != code:
            raise SystemExit(f"The slice drawn for {code} got {answer}. Draw another one.")
        axis.imshow(picture)
        axis.set_title(code, fontsize=9, family="monospace")
        if place is not None:
            axis.plot(
                *place, "o", markersize=22, fillstyle="none", color="black", markeredgewidth=1.6
            )
    figure.savefig(PICTURE)
    print(f"wrote {PICTURE}")


def verdict(picture: np.ndarray) -> tuple[str, tuple[float, float] | None]:
    """The code that vfplan gives to a slice, and the place [px] where it gives one."""
    try:
        extraction = vfplan.extract_curve(picture)
    except CurveError as refusal:
        place = None
        if "u_px" in refusal.numbers:
            place = (refusal.numbers["u_px"], refusal.numbers["v_px"])
        return refusal.code, place
    if not extraction.findings:
        return "nothing", None
    finding = extraction.findings[0]
    return finding.code, finding.place_px


def drawn_slices() -> dict[str, np.ndarray]:
    """One slice for each code, by the code that it is drawn for."""
    curve = wave(20, 200)
    end = curve[-1]
    beyond = end + np.array([12.0, 6.0])
    wide = slice_with(wave(20, 120))
    draw_line(wide, wave(119, 200), width_px=2 * PEN_PX)
    return {
        "line-forks": slice_with(curve, branch(curve[100], (30, 45))),
        "several-candidates": slice_with(wave(20, 90), wave(120, 200)),
        "double-line": slice_with(wave(20, 200, 70), wave(20, 200, 76)),
        "runs-side-by-side": wide,
        "no-line": slice_with(curve, colour="blue"),
        "only-a-frame": slice_with(frame()),
        "image-grey": slice_with(curve, colour="black"),
        "ink-at-end": slice_with(curve, branch(beyond, (8, 0))),
        "end-other-colour": covered(curve, end, (16, 16)),
        "stretch-hidden": covered(curve, curve[90], (16, 26)),
        "width-changes": slice_with(curve, branch(curve[60], (2, -6))),
    }


def wave(first: float, last: float, height: float = 75.0) -> np.ndarray:
    """A gentle curve from left to right, (n, 2) [px]."""
    u = np.arange(first, last + 0.5)
    return np.column_stack([u, height + 25 * np.sin(u / 38)])


def branch(start: np.ndarray, step: tuple[float, float]) -> np.ndarray:
    """A straight line from a point."""
    return np.array([start, np.asarray(start) + step])


def frame() -> np.ndarray:
    """A rectangle along the border of the picture."""
    right = WIDTH_PX - 5
    bottom = HEIGHT_PX - 5
    return np.array([(4, 4), (right, 4), (right, bottom), (4, bottom), (4, 4)])


def slice_with(*lines: np.ndarray, colour: str = "red") -> np.ndarray:
    """A slice with lines, each given by its points."""
    grey = np.clip(anatomy((HEIGHT_PX, WIDTH_PX), seed=3), 0, 255).astype(np.uint8)
    picture = grey.copy()
    if grey.ndim == 2:
        picture = np.repeat(grey[..., None], 3, axis=2)
    for points in lines:
        draw_line(picture, points, colour)
    return picture


def draw_line(
    picture: np.ndarray, points: np.ndarray, colour: str = "red", width_px: int = PEN_PX
) -> None:
    """Draw a line onto a slice."""
    places = np.rint(np.asarray(points) * 2**FRACTION_BITS).astype(np.int32)[:, None]
    cv2.polylines(picture, [places], False, COLOURS[colour], width_px, cv2.LINE_AA, FRACTION_BITS)


def covered(curve: np.ndarray, middle: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A slice whose line has a yellow box over a part of it."""
    picture = slice_with(curve)
    low = np.rint(middle - np.divide(size, 2)).astype(int)
    high = low + size
    cv2.rectangle(picture, low.tolist(), high.tolist(), COLOURS["yellow"], cv2.FILLED)
    return picture


if __name__ == "__main__":
    main(sys.argv[1:])
