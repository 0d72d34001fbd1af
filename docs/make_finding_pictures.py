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
SHAPE = (150, 220)
RED = (255, 0, 0)
BLUE = (40, 60, 220)
YELLOW = (255, 220, 0)
BLACK = (0, 0, 0)
PEN_PX = 3
COLUMNS = 4
FRACTION_BITS = 4
"""Of the coordinates that OpenCV draws at: 1/16 of a pixel."""


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
        given, place = verdict(picture)
        if given != code:
            raise SystemExit(f"The slice drawn for {code} got {given}.")
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
    return {
        "line-forks": drawn((curve, RED), (branch(curve[100], (30, 45)), RED)),
        "several-candidates": drawn((wave(20, 90), RED), (wave(120, 200), RED)),
        "double-line": drawn((wave(20, 200, 70), RED), (wave(20, 200, 76), RED)),
        "runs-side-by-side": drawn((wave(20, 120), RED), (wave(119, 200), RED, 2 * PEN_PX)),
        "no-line": drawn((curve, BLUE)),
        "only-a-frame": drawn((frame(), RED)),
        "image-grey": drawn((curve, BLACK)),
        "ink-at-end": drawn((curve, RED), (branch(beyond, (8, 0)), RED)),
        "end-other-colour": covered(curve, end, (16, 16), YELLOW),
        "stretch-hidden": covered(curve, curve[90], (16, 26), YELLOW),
        "width-changes": drawn((curve, RED), (branch(curve[60], (2, -6)), RED)),
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
    height, width = SHAPE
    return np.array([(4, 4), (width - 5, 4), (width - 5, height - 5), (4, height - 5), (4, 4)])


def drawn(*lines: tuple) -> np.ndarray:
    """A slice with lines, each given by its points, its colour and, if it differs, its width."""
    grey = np.clip(anatomy(SHAPE, seed=3), 0, 255).astype(np.uint8)
    picture = np.repeat(grey[..., None], 3, axis=2) if grey.ndim == 2 else grey.copy()
    for points, colour, *width in lines:
        places = np.rint(np.asarray(points) * 2**FRACTION_BITS).astype(np.int32)[:, None]
        thickness = width[0] if width else PEN_PX
        cv2.polylines(picture, [places], False, colour, thickness, cv2.LINE_AA, FRACTION_BITS)
    return picture


def covered(
    curve: np.ndarray, middle: np.ndarray, size: tuple[int, int], colour: tuple[int, int, int]
) -> np.ndarray:
    """A slice whose line has a box of another colour over a part of it."""
    picture = drawn((curve, RED))
    low = np.rint(middle - np.divide(size, 2)).astype(int)
    high = low + size
    cv2.rectangle(picture, low.tolist(), high.tolist(), colour, cv2.FILLED)
    return picture


if __name__ == "__main__":
    main(sys.argv[1:])
