"""Marker files -> two sides joined by label; units and frames are read, never guessed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError
from vfplan.markers.slicer import parse_fcsv, parse_mrk_json
from vfplan.markers.table import MarkerFrame, MarkerPoints, parse_table, read_text


@dataclass(frozen=True, eq=False)
class Correspondences:
    """The same markers seen in two frames.

    Parameters
    ----------
    labels
        (N,) labels, in the order of the source file.
    source
        (N, 2) [px] in "image", or (N, 3) [m] in "patient_lps".
    source_frame
        "image" or "patient_lps".
    target
        (N, 3) [m] in `target_frame`.
    sigma
        (N,) or (N, 3) standard deviation of `target` an axis [m]; `None` when none was given.
    target_frame
        "robot_base"; "patient_lps" where the target side came from a Slicer file.
    """

    labels: tuple[str, ...]
    source: NDArray[np.float64]
    source_frame: MarkerFrame
    target: NDArray[np.float64]
    sigma: NDArray[np.float64] | None = None
    target_frame: MarkerFrame = "robot_base"


def read_markers(path: str | Path, path2: str | Path | None = None) -> Correspondences:
    """Read markers from one file that holds both sides, or from two files joined by label.

    One file: a CSV with `label,u_px,v_px,x_m,y_m,z_m`. Two files, each a CSV (`label,u_px,v_px` or
    `label,x_m,y_m,z_m`), a Slicer `.mrk.json` or a Slicer `.fcsv`. Image pixels are always a
    source and a CSV of robot positions is always the target, in whichever order the files come; a
    Slicer file (patient LPS) takes the other side. Two Slicer files: the first is the source.

    Raises
    ------
    MarkerError
        A file that cannot be read or parsed; a label that is missing, doubled or extra; two files
        for the same side.
    """
    if path2 is None:
        sides = _read(Path(path))
        if len(sides) != 2:
            raise MarkerError(
                f"holds only {sides[0].frame} positions; give a second file with the other side, "
                "or one CSV with label,u_px,v_px,x_m,y_m,z_m",
                where=str(path),
            )
        source, target = sides
    else:
        source, target = _sides(_single(Path(path)), _single(Path(path2)))
    return _join(source, target)


def _read(path: Path) -> list[MarkerPoints]:
    where = str(path)
    kind = path.suffix.lower()
    if kind not in (".json", ".fcsv", ".csv"):
        raise MarkerError(
            f"has suffix {path.suffix!r}; .csv, .mrk.json or .fcsv is wanted", where=where
        )
    text = read_text(path)
    if kind == ".json":
        return [parse_mrk_json(text, where)]
    return [parse_fcsv(text, where)] if kind == ".fcsv" else parse_table(text, where)


def _single(path: Path) -> MarkerPoints:
    sides = _read(path)
    if len(sides) == 2:
        raise MarkerError(
            "holds both sides already; give it alone, or two files with one side each",
            where=str(path),
        )
    return sides[0]


def _sides(a: MarkerPoints, b: MarkerPoints) -> tuple[MarkerPoints, MarkerPoints]:
    if a.frame == b.frame != "patient_lps":
        raise MarkerError(
            f"both files hold {a.frame} positions ({a.where}); one of each side is wanted",
            where=b.where,
        )
    swapped = b.frame == "image" or a.frame == "robot_base"
    return (b, a) if swapped else (a, b)


def _join(source: MarkerPoints, target: MarkerPoints) -> Correspondences:
    for one, other in ((source, target), (target, source)):
        missing = [label for label in one.labels if label not in other.labels]
        if missing:
            names = ", ".join(map(repr, missing))
            raise MarkerError(
                f"no marker {names}, which {one.where} has; both sides need the same labels",
                where=other.where,
            )
    order = [target.labels.index(label) for label in source.labels]
    return Correspondences(
        source.labels,
        source.positions,
        source.frame,
        target.positions[order],
        None if target.sigma is None else target.sigma[order],
        target.frame,
    )
