"""Ten slices and their review sheets, for readers who do not know which ends a box covers.

    .venv/bin/python tests/making/make_sheets.py DIR

writes DIR/sheets/01.png to 10.png, the slices they show as DIR/slices/01.png to 10.png, and what is
right in DIR/answers.csv (sheet, covered, where the covered end is seen). Give a reader the folder
of sheets alone, and ask: which ends of which lines does something cover?
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import cv2
import drawn_ends
import numpy as np

from vfplan.review.sheet import write_sheet

SEED = 36

# How many sheets show a start, an end, or nothing that is covered.
COVERED = ("start", "start", "start", "end", "end", "end", "", "", "", "")


def main(folder: Path) -> None:
    rng = np.random.default_rng(SEED)
    for name in ("sheets", "slices"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    rows = [("sheet", "covered", "u_px", "v_px")]
    for number, covered in enumerate(rng.permutation(COVERED), 1):
        drawn = drawn_ends.draw(1000 + number, covered=str(covered), tone=rng.uniform(0, 255))
        name = f"{number:02}.png"
        cv2.imwrite(str(folder / "slices" / name), drawn.image[:, :, ::-1])
        write_sheet(drawn_ends.shown(drawn), folder / "sheets" / name)
        place = ("", "")
        if covered:
            end = drawn.line[0] if covered == "start" else drawn.line[-1]
            place = tuple(f"{x:.1f}" for x in end)
        rows.append((name, str(covered) or "none", *place))
    with open(folder / "answers.csv", "w", newline="") as stream:
        csv.writer(stream).writerows(rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
